// A servo loop on a .pandis file: position in, force out, a thousand times a second.
//
//     g++ -std=c++17 -O3 -march=native -fno-math-errno -fno-trapping-math -I workflow/pandis/native docs/examples/servo.cpp -o servo
//     ./servo results/bunny/export/pandis-exact.pandis 400
//
// A probe of 50 g falls onto the object from above and comes to rest on it. Replace `Probe` by your
// device: read its position, send it the force.
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

struct Probe {
    double position[3], velocity[3] = {0, 0, 0};

    void step(const double force[3], double unit, double seconds) {  // unit: metres per mesh unit
        const double mass = 0.05, damping = 2.0, gravity[3] = {0, -9.81, 0};
        for (int k = 0; k < 3; k++) {
            velocity[k] += (force[k] / mass + gravity[k] - damping / mass * velocity[k]) * seconds;
            position[k] += velocity[k] / unit * seconds;
        }
    }
};

int main(int count, char **words) {
    if (count < 3) return std::puts("usage: servo FIELD.pandis STIFFNESS(N/m)"), 2;
    pandis_field field;
    if (int error = pandis_open_file(&field, words[1])) return std::puts(pandis_error(error)), 1;
    const double unit = 0.10 * field.scale / 1.8;            // the longest side is to be 10 cm
    const double stiffness = std::atof(words[2]) * unit;     // N per mesh unit
    Probe probe{{field.centre[0], field.centre[1] + 0.95 / field.scale, field.centre[2]}};

    using clock = std::chrono::steady_clock;
    const auto period = std::chrono::microseconds(1000);
    auto due = clock::now();
    double longest = 0, force[3] = {0, 0, 0};
    for (int tick = 0; tick < 2000; tick++) {
        std::this_thread::sleep_until(due += period);        // an absolute deadline: no drift
        const auto begin = clock::now();
        int flag = pandis_force(&field, probe.position, stiffness, force);
        const double taken = std::chrono::duration<double>(clock::now() - begin).count();
        if (flag == PANDIS_INVALID) return std::puts("the position is no number"), 1;
        probe.step(force, unit, 1e-3);
        longest = taken > longest ? taken : longest;
    }
    pandis_answer answer;
    pandis_query(&field, probe.position, &answer);
    std::printf("longest tick %.1f us; at rest %.2f mm below the surface, force %.3f %.3f %.3f N\n",
                longest * 1e6, -1e3 * answer.distance * unit, force[0], force[1], force[2]);
    pandis_close(&field);
    return 0;
}

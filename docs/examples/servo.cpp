// A servo loop on a .pandis file: position in, force out, a thousand times a second.
//
//     g++ -std=c++17 -O2 -I workflow/pandis/engine docs/examples/servo.cpp -o servo
//     ./servo results/bunny/export/pandis-exact.pandis 400
//
// A probe of 50 g is let down onto the object from above, guided by a hand that keeps it over one
// place, and comes to rest on it. It is kept out by a proxy, which nothing lets through and which
// rubs; a grid of forces has no distances outside, and gives its penalty force. Replace `Probe` by
// your device: read its position, send it the force.
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>
#if defined(__linux__)
#include <sched.h>
#include <sys/mman.h>
#endif

const double mass = 0.05, gravity = 9.81; // kg, m/s2

// Where the surface, seen from above, lies most level and the solid below is `deep` thick (mesh
// units): looked for along lines through a grid of 40 x 40. False if there is no such place.
bool level_place(const pandis_field *field, double deep, double place[3]) {
    double low[3], high[3], best = 0;
    pandis_bounds(field, low, high);
    for (int line = 0; line < 1600; line++) {
        double p[3] = {low[0] + (line % 40 + 0.5) / 40 * (high[0] - low[0]), high[1],
            low[2] + (line / 40 + 0.5) / 40 * (high[2] - low[2])};
        const double step = (high[1] - low[1]) / 400;
        pandis_answer at, below;
        for (pandis_query(field, p, &at); p[1] > low[1] && !(at.distance < -step);
            pandis_query(field, p, &at))
            p[1] -= step;
        const double under[3] = {p[0], p[1] - deep, p[2]};
        pandis_query(field, under, &below);
        if (!(below.distance < -deep / 2 && below.normal[1] > 0) ||
            !(std::min(at.normal[1], below.normal[1]) > best))
            continue;
        best = std::min(at.normal[1], below.normal[1]);
        std::copy(p, p + 3, place);
    }
    return best > 0;
}

struct Probe {
    double position[3], velocity[3], guide[3]; // mesh units, m/s; the hand keeps it over `guide`

    void step(const double force[3], double unit, double seconds) { // unit: metres per mesh unit
        const double damping = 2.0, stiffness = 500.0;              // Ns/m and N/m of the hand
        for (int k = 0; k < 3; k++) {
            double hand = k == 1 ? -mass * gravity : stiffness * (guide[k] - position[k]) * unit;
            velocity[k] += (force[k] + hand - damping * velocity[k]) / mass * seconds;
            position[k] += velocity[k] / unit * seconds;
        }
    }
};

// What keeps a loop in time, as far as the system lets us: no page is missing, nobody is served
// first.
void keep_time() {
#if defined(__linux__)
    sched_param most = {};
    most.sched_priority = 80;
    if (mlockall(MCL_CURRENT | MCL_FUTURE)) std::puts("memory is not locked: see ulimit -l");
    if (sched_setscheduler(0, SCHED_FIFO, &most)) std::puts("no real-time priority: see ulimit -r");
#endif
}

int main(int count, char **words) {
    if (count < 3) return std::puts("usage: servo FIELD.pandis STIFFNESS(N/m)"), 2;
    pandis_field field; // opened before the loop: this takes long
    if (const pandis_error error = pandis_open_file(&field, words[1]))
        return std::puts(pandis_error_text(error)), 1;
    const double unit = 0.10 / pandis_longest_side(&field); // the longest side is to be 10 cm
    const double stiffness = std::atof(words[2]);           // N/m
    const pandis_object object = {
        &field, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, unit, stiffness}; // in metres
    const pandis_material surface = {
        0.4, 0.3, 0, 0.1}; // friction at rest and sliding; damping, drag
    pandis_contact_options options = pandis_contact_defaults(&object);
    options.materials = &surface, options.material_count = 1;
    pandis_contact contact;
    const bool has_proxy = pandis_contact_open(&contact, &object, &options) == PANDIS_SUCCESS;
    if (!has_proxy) std::puts("no proxy: this field gives its penalty force");
    Probe probe = {};
    if (!level_place(&field, 0.004 / unit, probe.guide))
        return std::puts("nothing to stand on: 4 mm are needed"), 1;
    std::copy(probe.guide, probe.guide + 3, probe.position);
    probe.position[1] += 0.002 / unit;
    double longest = 0, force[3] = {0, 0, 0},
           held = 0; // held: upwards, mean of the last half second
    for (int k = 0; k < 100; k++)
        pandis_force(&field, probe.position, 0, force); // fills the caches
    keep_time();

    using clock = std::chrono::steady_clock;
    const auto period = std::chrono::microseconds(1000);
    auto due = clock::now();
    for (int tick = 0; tick < 2000; tick++) {
        std::this_thread::sleep_until(due += period); // an absolute deadline: no drift
        const auto begin = clock::now();
        pandis_flag flag;
        if (has_proxy) {
            const double place[3] = {
                probe.position[0] * unit, probe.position[1] * unit, probe.position[2] * unit};
            pandis_touch touch;
            flag = pandis_contact_step(&contact, &object, place, 1e-3, &touch);
            std::copy(touch.force, touch.force + 3, force);
        } else {
            flag = pandis_force(&field, probe.position, stiffness * unit, force);
        }
        const double taken = std::chrono::duration<double>(clock::now() - begin).count();
        if (flag == PANDIS_INVALID)
            return std::puts("no answer: the position or the stiffness is no number"), 1;
        probe.step(force, unit, 1e-3);
        longest = std::max(longest, taken);
        if (tick >= 1500) held += force[1] / 500;
    }
    pandis_answer answer;
    pandis_query(&field, probe.position, &answer);
    std::printf(
        "longest tick %.1f us; %.2f mm below the surface, held with %.3f N, moving at %.1e m/s\n",
        longest * 1e6, -1e3 * answer.distance * unit, held, std::abs(probe.velocity[1]));
    pandis_close(&field);
    return 0;
}

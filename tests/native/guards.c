/* A guard that is led by a script, without a device. Prints the cause, the debt (J), and the signs.
 *
 * shakes: energy is missing first, and then the probe shakes, again and again.
 * ramp: a probe slides along a wall while the force comes in, presses, and withdraws; it is
 * passive. vanishes: the wall, which is said to store little, is gone at once, and the force falls
 * no faster than the device allows.
 */
#include "guard.h"

#include <stdio.h>

static guard_limits limits = {3.3, 0, 3.3, 3.3, 1.5, 0, 0.1, 0, 280, 2, 0};

/* The force of a wall of 280 N/m at x = 0 on a probe that is at a place. */
static void tick(guard *g, const double *place, int wall, double dt, const double *speed) {
    device_state state;
    double force[3] = {wall && place[0] < 0 ? -280 * place[0] : 0, 0, 0};
    memset(&state, 0, sizeof state);
    memcpy(state.position, place, sizeof state.position),
        memcpy(state.velocity, speed, sizeof state.velocity);
    state.buttons = 1, state.safe = 1;
    guard_pass(g, &state, dt, 1, force);
}

int main(int count, char **words) {
    const double dt = 1e-3;
    guard g;
    double x[3] = {1e-3, 0, 0}, v[3] = {0, 0, 0};
    if (count < 2) return 1;
    if (!strcmp(words[1], "ramp")) limits.ramp = 500;
    if (!strcmp(words[1], "vanishes")) limits.impulse = limits.step = 0.1, limits.stiffness = 28000;
    guard_start(&g, &limits, dt);
    if (!strcmp(words[1], "shakes")) {
        for (int turn = 0; turn < 17 && !g.cause; turn++)
            for (int k = 0; k < 60 && !g.cause; k++) {
                g.now += dt, g.energy.balance = k < 20 ? -3e-5 : 0;
                g.shaking.last = k >= 2 && k < 20 ? g.now : -1e9;
                guard_troubled(&g);
            }
    } else if (!strcmp(words[1], "ramp")) {
        for (int k = 0; k < 900; k++) { /* 0.5 mm deep, then 5 mm, then out */
            double to = k < 20 ? 1e-3 : k < 250 ? -5e-4 : k < 450 ? -5e-3 : 1e-3;
            double step = fmax(-5e-5, fmin(5e-5, to - x[0]));
            v[0] = step / dt, v[1] = k > 20 ? 0.15 : 0, x[0] += step, x[1] += v[1] * dt;
            tick(&g, x, 1, dt, v);
        }
    } else {
        for (int k = 0; k < 400; k++) {
            double to = k < 20 ? 1e-3 : k < 200 ? -4e-3 : 5e-2;
            double step = fmax(-1e-4, fmin(3e-4, to - x[0]));
            v[0] = step / dt, x[0] += step;
            tick(&g, x, k < 200, dt, v);
        }
    }
    printf("%d %g %lld\n", g.cause, g.energy.debt, g.signs);
    return 0;
}

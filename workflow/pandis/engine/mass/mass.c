/* A device and the hand that holds it as one mass with Coulomb friction, stepped exactly under a
 * constant push.
 *
 * The state of a linear oscillator after a step is linear in the state before it and in the push.
 * The caller computes the six factors from a matrix exponential. Friction acts against the motion.
 * At rest, it cancels any force that is not stronger than itself. A step in which the motion
 * reverses ends at rest at the turning point.
 */
#include <math.h>
#include <stdint.h>

typedef struct {
    /* position and speed after a step, from position, speed and push */
    double xx, xv, xu, vx, vv, vu;
    double friction, stiffness, dt;
} Oscillator;

static double length(const double *a) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

static void step(const Oscillator *o, double *position, double *speed, const double *pushed) {
    double push[3] = {pushed[0], pushed[1], pushed[2]}, to[3], then[3], fast = 0;
    int stuck = 0;
    if (o->friction > 0) {
        double along[3];
        fast = length(speed);
        for (int k = 0; k < 3; k++)
            along[k] = fast > 0 ? speed[k] : push[k] - o->stiffness * position[k];
        double size = length(along);
        stuck = fast == 0 && size <= o->friction;
        for (int k = 0; k < 3; k++) push[k] -= o->friction * along[k] / fmax(size, 1e-300);
    }
    if (stuck) return;
    for (int k = 0; k < 3; k++) {
        to[k] = o->xx * position[k] + o->xv * speed[k] + o->xu * push[k];
        then[k] = o->vx * position[k] + o->vv * speed[k] + o->vu * push[k];
    }
    if (o->friction > 0 && fast > 0 &&
        speed[0] * then[0] + speed[1] * then[1] + speed[2] * then[2] <= 0) {
        double share = fast / fmax(fast + length(then), 1e-300);
        for (int k = 0; k < 3; k++) to[k] = position[k] + speed[k] * share * o->dt / 2, then[k] = 0;
    }
    for (int k = 0; k < 3; k++) position[k] = to[k], speed[k] = then[k];
}

/* Advance every mass by `steps` steps under its push; arrays are (count, 3). */
void mass_steps(const Oscillator *o, int64_t count, int64_t steps, double *position, double *speed,
    const double *push) {
    for (int64_t i = 0; i < count; i++)
        for (int64_t k = 0; k < steps; k++) step(o, position + 3 * i, speed + 3 * i, push + 3 * i);
}

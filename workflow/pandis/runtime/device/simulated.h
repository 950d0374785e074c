/* A simulated device with the hand that holds it: a pull device in simulated time, so that a run is
 * the same on every machine. A force that a driver would refuse is reported as an error, with
 * HDAPI's code, and does not reach the motors.
 *
 * Device and hand are one mass: m x'' = F + press + k (rest - x) + b_hand rest' - (b + b_hand) x',
 * with Coulomb friction against the motion. At rest, friction balances any force that does not
 * exceed it. The motion under a constant force is exact. A tick has four steps; within each,
 * friction has a fixed direction.
 */
#ifndef SIMULATED_H
#define SIMULATED_H

#include "energy.h"
#include "hd.h"

#include <string.h>

#define SIMULATED_SUBSTEPS 4
#define SIMULATED_DELAY 20
#define SIMULATED_ERRORS 16

typedef struct {
    double mass, damping, friction, encoder; /* kg, Ns/m, N, m */
    /* limits beyond which it reports errors: N, N per ms, m/s */
    double force, impulse, speed;
    double hand_stiffness, hand_damping; /* N/m, Ns/m */
    double period;                       /* s */
    /* stiffness of the touched surface, N/m: see energy_book */
    double wall;
    int delay; /* of forces, ticks */
} simulated_spec;

static struct {
    simulated_spec spec;
    const double *rest, *press; /* per tick: the hand's rest position (m) and force (N) */
    long long ticks, tick;      /* ticks after which the hand holds still; the current tick */
    double *path;               /* per tick, unless NULL: true position at its end (m) */
    double position[3], speed[3];
    double late[SIMULATED_DELAY + 1][3], acting[3], sent[3];
    double xx, xv, vx, vv, xu, vu; /* motion of a substep */
    energy energy;                 /* by its true positions and losses */
    int output;
    unsigned int error[SIMULATED_ERRORS];
    int errors;
} simulated;

static void simulated_report(unsigned int code) {
    if (simulated.errors < SIMULATED_ERRORS) simulated.error[simulated.errors++] = code;
}

/* The motion of a substep: the exponential of [[0, 1, 0], [-k/m, -b/m, 1/m], [0, 0, 0]] h, by its
 * series. */
static void simulated_motion(void) {
    const simulated_spec *s = &simulated.spec;
    double h = s->period / SIMULATED_SUBSTEPS;
    double a = -s->hand_stiffness / s->mass * h, b = -(s->damping + s->hand_damping) / s->mass * h,
           c = h / s->mass;
    double term[2][3] = {{1, 0, 0}, {0, 1, 0}}, sum[2][3] = {{1, 0, 0}, {0, 1, 0}};
    for (int n = 1; n < 40; n++)
        for (int row = 0; row < 2; row++) {
            double *t = term[row], x = t[0], v = t[1];
            t[0] = v * a / n, t[1] = (x * h + v * b) / n, t[2] = v * c / n;
            for (int k = 0; k < 3; k++) sum[row][k] += t[k];
        }
    simulated.xx = sum[0][0], simulated.xv = sum[0][1], simulated.xu = sum[0][2];
    simulated.vx = sum[1][0], simulated.vv = sum[1][1], simulated.vu = sum[1][2];
}

/* Prepare a device at rest at `start`, with a hand that moves for `ticks` ticks, at least one. */
static void simulated_prepare(const simulated_spec *spec, const double *start, const double *rest,
    const double *press, long long ticks) {
    memset(&simulated, 0, sizeof simulated);
    simulated.spec = *spec, simulated.rest = rest, simulated.press = press, simulated.ticks = ticks;
    memcpy(simulated.position, start, sizeof simulated.position);
    simulated_motion();
}

/* Report its properties. */
static void simulated_tell(device_spec *spec) {
    const simulated_spec *s = &simulated.spec;
    memset(spec, 0, sizeof *spec);
    snprintf(spec->model, sizeof spec->model, "simulated");
    spec->force = s->force, spec->speed = s->speed, spec->impulse = s->impulse,
    spec->rate = 1 / s->period;
}

/* The position that its encoders report. */
static void simulated_place(double *position) {
    double step = simulated.spec.encoder;
    for (int k = 0; k < 3; k++) {
        double place = simulated.position[k];
        position[k] = step > 0 ? rint(place / step) * step : place;
    }
}

/* Accept a force; one that a driver would refuse is reported as an error and does not reach the
 * motors. */
static void simulated_accept(const double *force) {
    const simulated_spec *s = &simulated.spec;
    double change[3];
    for (int k = 0; k < 3; k++) change[k] = force[k] - simulated.sent[k];
    unsigned int code = HD_SUCCESS;
    if (!(length_of(force) <= s->force * (1 + 1e-9))) code = HD_EXCEEDED_MAX_FORCE;
    else if (length_of(force) > 0 &&
        !(length_of(change) <= s->impulse * s->period * 1e3 * (1 + 1e-9)))
        code = HD_EXCEEDED_MAX_FORCE_IMPULSE; /* a drop to zero is always allowed */
    else if (length_of(simulated.speed) > s->speed) code = HD_EXCEEDED_MAX_VELOCITY;
    if (code) simulated_report(code);
    for (int k = 0; k < 3; k++) simulated.sent[k] = code || !simulated.output ? 0 : force[k];
}

static unsigned int simulated_take_error(void) {
    unsigned int code = HD_SUCCESS;
    if (simulated.errors) {
        code = simulated.error[0];
        memmove(
            simulated.error, simulated.error + 1, sizeof simulated.error - sizeof *simulated.error);
        simulated.errors--;
    }
    return code;
}

/* Move by a step under spring, damping and a push; returns the distance moved. */
static double simulated_step(const double *rest, const double *push) {
    const simulated_spec *s = &simulated.spec;
    double h = s->period / SIMULATED_SUBSTEPS, fast = length_of(simulated.speed), way[3], speed[3],
           whole[3];
    memcpy(whole, push, sizeof whole);
    if (s->friction > 0) {
        double along[3], size = fast;
        for (int k = 0; k < 3; k++) {
            double net = push[k] + s->hand_stiffness * (rest[k] - simulated.position[k]);
            along[k] = fast > 0 ? simulated.speed[k] : net;
        }
        if (!(fast > 0)) {
            size = length_of(along);
            if (size <= s->friction) return 0; /* it sticks */
        }
        for (int k = 0; k < 3; k++) whole[k] -= s->friction * along[k] / size;
    }
    double onward = 0, slower = 0;
    for (int k = 0; k < 3; k++) {
        double x = simulated.position[k] - rest[k], v = simulated.speed[k];
        way[k] = simulated.xx * x + simulated.xv * v + simulated.xu * whole[k] - x;
        speed[k] = simulated.vx * x + simulated.vv * v + simulated.vu * whole[k];
        onward += v * speed[k], slower += speed[k] * speed[k];
    }
    if (s->friction > 0 && fast > 0 && !(onward > 0)) { /* it comes to rest within the step */
        double share = fast / (fast + sqrt(slower));
        for (int k = 0; k < 3; k++) way[k] = simulated.speed[k] * share * h / 2, speed[k] = 0;
    }
    for (int k = 0; k < 3; k++) simulated.position[k] += way[k], simulated.speed[k] = speed[k];
    return length_of(way);
}

/* Move by a tick under the force that acts during it. */
static void simulated_move(void) {
    const simulated_spec *s = &simulated.spec;
    long long now = simulated.tick < simulated.ticks ? simulated.tick : simulated.ticks - 1;
    const double *rest = simulated.rest + 3 * now, *press = simulated.press + 3 * now;
    const double *next = now + 1 < simulated.ticks ? rest + 3 : rest;
    double h = s->period / SIMULATED_SUBSTEPS, push[3], before[3], work = 0, lost = 0;
    memcpy(before, simulated.position, sizeof before);
    for (int k = 0; k < 3; k++)
        push[k] =
            simulated.acting[k] + press[k] + s->hand_damping * (next[k] - rest[k]) / s->period;
    for (int step = 0; step < SIMULATED_SUBSTEPS; step++) {
        double length = simulated_step(rest, push);
        /* a lower bound, whatever the speed was along the way */
        lost += s->damping * length * length / h + s->friction * length;
    }
    for (int k = 0; k < 3; k++) work += simulated.acting[k] * (simulated.position[k] - before[k]);
    energy_book(&simulated.energy, length_of(simulated.acting) > 0, length_of(simulated.acting),
        work, lost, s->wall, length_of(simulated.acting) > s->force * (1 - 1e-6));
}

/* Apply the sent force for a tick, after its delay. */
static void simulated_advance(void) {
    int last = simulated.spec.delay;
    memcpy(simulated.late[last], simulated.sent, sizeof simulated.sent);
    memcpy(simulated.acting, simulated.late[0], sizeof simulated.acting);
    memmove(simulated.late[0], simulated.late[1], (size_t)last * sizeof *simulated.late);
    simulated_move();
    if (simulated.path && simulated.tick < simulated.ticks)
        memcpy(simulated.path + 3 * simulated.tick, simulated.position, sizeof simulated.position);
    simulated.tick++;
}

/* -------------------- as a device */

static unsigned int simulated_open(device *self, const char *name, device_spec *spec) {
    (void)self, (void)name;
    simulated_tell(spec);
    return 0;
}

static int simulated_calibrated(device *self) {
    (void)self;
    return DEVICE_CALIBRATED;
}

static void simulated_read(device *self, device_state *state) {
    (void)self;
    memset(state, 0, sizeof *state);
    simulated_place(state->position);
    memcpy(state->velocity, simulated.speed, sizeof simulated.speed);
    state->rotation[0] = state->rotation[4] = state->rotation[8] = 1;
    state->time = (double)simulated.tick * simulated.spec.period;
    state->buttons = 1, state->safe = 1; /* the hand holds the button */
}

static void simulated_write(device *self, const double *force, const double *torque) {
    (void)self, (void)torque;
    simulated_accept(force);
}

/* When driven by a clock, the device moves as soon as it receives its force. */
static void simulated_write_and_move(device *self, const double *force, const double *torque) {
    simulated_write(self, force, torque);
    simulated_advance();
}

static unsigned int simulated_error(device *self) {
    (void)self;
    return simulated_take_error();
}

static void simulated_output(device *self, int on) {
    (void)self;
    simulated.output = on;
}

static void simulated_stop(device *self) { (void)self; }

static int simulated_next(device *self) {
    (void)self;
    simulated_advance();
    return 1;
}

static void simulated_close(device *self) {
    (void)self;
    simulated.output = 0;
}

/* Fill in the device for a client's run. */
static void simulated_device(device *made) {
    static const device verbs = {simulated_open, simulated_calibrated, simulated_read,
        simulated_write, simulated_error, simulated_output, NULL, simulated_stop, simulated_next,
        simulated_close, NULL};
    *made = verbs;
}

#endif

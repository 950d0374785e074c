/* What stands between a field and a motor: limits, a ramp, an observer of energy. */
#ifndef GUARD_H
#define GUARD_H

#include "energy.h"

#include <string.h>

/* Why a run ended. */
enum {
    CAUSE_DONE = 0,
    CAUSE_LIBRARY = 1,     /* the library cannot be loaded, or lacks a function */
    CAUSE_DEVICE = 2,      /* no such device, another one, or it does not start */
    CAUSE_ERROR = 3,       /* the device has reported an error: its code */
    CAUSE_SPEED = 4,       /* the probe went faster than the limit */
    CAUSE_NUMBER = 5,      /* a position or a force was no number */
    CAUSE_OVERRUN = 6,     /* callbacks computed longer than the deadline, several in a row */
    CAUSE_WATCHDOG = 7,    /* the callback was not called, or did not come back */
    CAUSE_GAP = 8,         /* two calls were too far apart, or one took as long */
    CAUSE_INTERRUPTED = 9  /* somebody has stopped the program */
};

typedef struct {
    double force;             /* largest, N */
    double step;              /* largest change between ticks, N */
    double speed;             /* of the probe, m/s; faster, and the run ends */
    double ramp;              /* ticks until the whole force is given */
    double damping, friction; /* of the device: what takes energy away, Ns/m and N */
    double stiffness;         /* of the wall, N/m: what it can store */
} guard_limits;

typedef struct {
    guard_limits limits;
    double period; /* s */
    double position[3], sent[3];
    double ticks;
    energy energy;
    double strongest, steepest, fastest;
    long long cut, slowed; /* ticks in which the force was more than its limit, or changed by more */
    int cause;
} guard;

static void guard_start(guard *g, const guard_limits *limits, double period) {
    memset(g, 0, sizeof *g);
    g->limits = *limits, g->period = period;
}

/* Observe the way since the last tick, under the force that was sent for it. */
static void guard_observe(guard *g, const double *position) {
    double way[3], work = 0, length;
    for (int k = 0; k < 3; k++) way[k] = position[k] - g->position[k], work += g->sent[k] * way[k];
    length = length_of(way);
    double lost = g->limits.damping * length * length / g->period + g->limits.friction * length;
    energy_book(&g->energy, length_of(g->sent), work, lost, g->limits.stiffness);
}

/* Turn a force that is wanted at a position into one that may be sent; zero once there is a cause. */
static void guard_pass(guard *g, const double *position, double *force) {
    double change[3];
    if (!g->cause && !(length_of(position) <= 1e3 && length_of(force) <= 1e100)) g->cause = CAUSE_NUMBER;
    if (!g->cause && g->ticks > 0) {
        for (int k = 0; k < 3; k++) change[k] = position[k] - g->position[k];
        double speed = length_of(change) / g->period;
        if (speed > g->fastest) g->fastest = speed;
        if (speed > g->limits.speed) g->cause = CAUSE_SPEED;
        guard_observe(g, position);
    }
    if (g->cause) {
        force[0] = force[1] = force[2] = 0;
    } else {
        double size = length_of(force), share = g->limits.ramp > 0 ? g->ticks / g->limits.ramp : 1;
        if (size > g->limits.force) share = fmin(share, 1) * g->limits.force / size, g->cut++;
        for (int k = 0; k < 3; k++) force[k] *= fmin(share, 1);
        for (int k = 0; k < 3; k++) change[k] = force[k] - g->sent[k];
        double step = length_of(change);
        if (step > g->limits.step) {
            for (int k = 0; k < 3; k++) force[k] = g->sent[k] + change[k] * (g->limits.step / step);
            g->slowed++, step = g->limits.step;
        }
        g->steepest = fmax(g->steepest, step), g->strongest = fmax(g->strongest, length_of(force));
        memcpy(g->position, position, sizeof g->position);
    }
    memcpy(g->sent, force, sizeof g->sent);
    g->ticks++;
}

#endif

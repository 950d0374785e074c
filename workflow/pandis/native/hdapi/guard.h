/* What stands between a field and a motor: limits, a ramp, an observer of energy. */
#ifndef GUARD_H
#define GUARD_H

#include <math.h>
#include <string.h>

/* Why a run ended. */
enum {
    CAUSE_DONE = 0,
    CAUSE_LIBRARY = 1,   /* the library cannot be loaded, or lacks a function */
    CAUSE_DEVICE = 2,    /* no such device, or it does not start */
    CAUSE_ERROR = 3,     /* the device has reported an error: its code */
    CAUSE_SPEED = 4,     /* the probe went faster than the limit */
    CAUSE_NUMBER = 5,    /* a position or a force was no number */
    CAUSE_OVERRUN = 6,   /* callbacks computed longer than the deadline, several in a row */
    CAUSE_WATCHDOG = 7   /* the callback was not called, or did not come back */
};

typedef struct {
    double force;    /* largest, N */
    double step;     /* largest change between ticks, N */
    double speed;    /* of the probe, m/s; faster, and the run ends */
    double ramp;     /* ticks until the whole force is given */
    double damping, friction; /* of the device: what takes energy away, Ns/m and N */
} guard_limits;

typedef struct {
    guard_limits limits;
    double period; /* s */
    double position[3], sent[3];
    double ticks;
    double wall, device; /* energy that the wall has taken, and the device lost, since the contact began, J */
    double worst;        /* least sum of the two: below zero, the wall has given more than the device can lose */
    double strongest, steepest, fastest;
    long long cut, slowed; /* ticks in which the force was more than its limit, or changed by more */
    int cause;
} guard;

static void guard_start(guard *g, const guard_limits *limits, double period) {
    memset(g, 0, sizeof *g);
    g->limits = *limits, g->period = period;
}

static double guard_size(const double *v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* Book the energy of the way since the last tick, under the force that was sent for it: exact for a
 * force that is held (Hannaford and Ryu 2002, with the device's own losses). */
static void guard_observe(guard *g, const double *position) {
    double way[3], work = 0, touched = guard_size(g->sent);
    for (int k = 0; k < 3; k++) way[k] = position[k] - g->position[k], work += g->sent[k] * way[k];
    if (!(touched > 0)) {
        g->wall = g->device = 0; /* what was stored in one contact excuses nothing in the next */
        return;
    }
    double length = guard_size(way);
    g->wall -= work;
    g->device += g->limits.damping * length * length / g->period + g->limits.friction * length;
    if (g->wall + g->device < g->worst) g->worst = g->wall + g->device;
}

/* Turn a force that is wanted at a position into one that may be sent. */
static void guard_pass(guard *g, const double *position, double *force) {
    double change[3];
    if (!(guard_size(position) <= 1e3 && guard_size(force) <= 1e100)) g->cause = g->cause ? g->cause : CAUSE_NUMBER;
    if (!g->cause && g->ticks > 0) {
        for (int k = 0; k < 3; k++) change[k] = position[k] - g->position[k];
        double speed = guard_size(change) / g->period;
        if (speed > g->fastest) g->fastest = speed;
        if (speed > g->limits.speed) g->cause = CAUSE_SPEED;
        guard_observe(g, position);
    }
    if (g->cause) {
        force[0] = force[1] = force[2] = 0;
    } else {
        double size = guard_size(force), share = g->limits.ramp > 0 ? g->ticks / g->limits.ramp : 1;
        if (size > g->limits.force) share = fmin(share, 1) * g->limits.force / size, g->cut++;
        for (int k = 0; k < 3; k++) force[k] *= fmin(share, 1);
        for (int k = 0; k < 3; k++) change[k] = force[k] - g->sent[k];
        double step = guard_size(change);
        if (step > g->limits.step) {
            for (int k = 0; k < 3; k++) force[k] = g->sent[k] + change[k] * (g->limits.step / step);
            g->slowed++, step = g->limits.step;
        }
        g->steepest = fmax(g->steepest, step), g->strongest = fmax(g->strongest, guard_size(force));
        memcpy(g->position, position, sizeof g->position);
    }
    memcpy(g->sent, force, sizeof g->sent);
    g->ticks++;
}

#endif

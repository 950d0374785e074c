/* The guard between a field and the motors: arming, limits, and an energy observer that intervenes.
 *
 * In this order, at every tick:
 *
 * 1. After a fault the force is zero, from the tick in which it is detected.
 * 2. Without arming there is no force: a run is armed outside of the object, with the device
 *    calibrated, its safety switch closed, and its button held where it has one. Releasing the
 *    button disarms at once.
 * 3. The force is ramped up; during contact no faster than the device's losses pay for.
 * 4. A wall that gives energy, or shakes, is damped (Hannaford and Ryu 2002): by no more than
 *    the device tolerates, and never so that the force becomes a pull. The run ends if damping
 *    has not stopped the trouble after 50 ms, if the wall shakes a third time within a second, if
 *    energy is missing repeatedly, or if a quarter of a millijoule is missing.
 * 5. The force is limited to the device's peak force. As the motors' average load approaches the
 *    force that they can sustain, the limit falls to that force.
 * 6. Slew: the force added in a tick is limited. Any share of the last force may be removed at
 *    once, up to the device's own limit of change.
 * 7. A force that is not a number, or is beyond the limit, becomes zero, and the run ends.
 *
 * Limits that are negative or not finite are refused before anything is sent.
 */
#ifndef GUARD_H
#define GUARD_H

#include "device.h"
#include "energy.h"
#include "shaking.h"

#include <float.h>
#include <string.h>

/* Causes of a run's end, by name and in words. This is the only list of them. */
#define GUARD_CAUSES(CAUSE)                                                                        \
    CAUSE(DONE, "ran to its end")                                                                  \
    CAUSE(LIBRARY, "the device's library cannot be used")                                          \
    CAUSE(DEVICE, "the device does not start")                                                     \
    CAUSE(ERROR, "the device reported an error")                                                   \
    CAUSE(SPEED, "the probe was faster than the limit")                                            \
    CAUSE(NUMBER, "a position or a force was not a number, or a force was beyond the limit")       \
    CAUSE(OVERRUN, "several callbacks in a row took longer than the deadline")                     \
    CAUSE(WATCHDOG, "the device's scheduler made no call, or a call did not return")               \
    CAUSE(GAP, "two calls of the device's scheduler were too far apart, or one took too long")     \
    CAUSE(INTERRUPTED, "the program was interrupted")                                              \
    CAUSE(CALIBRATION, "the device is not calibrated, or no longer calibrated")                    \
    CAUSE(SWITCH, "the safety switch was opened")                                                  \
    CAUSE(HOT, "a motor is too hot: let it cool, and lower the stiffness")                         \
    CAUSE(                                                                                         \
        UNSTABLE, "the wall gave energy or shook, and damping did not help: lower the stiffness")  \
    CAUSE(BUSY, "another run of this process drives a device: wait for its end")                   \
    CAUSE(LIMITS, "a limit is negative or not finite")                                             \
    CAUSE(ENCODER,                                                                                 \
        "positions and velocities of the device contradict each other: an encoder is stuck or "    \
        "drifts")

#define GUARD_NAME(name, words) CAUSE_##name,
enum { GUARD_CAUSES(GUARD_NAME) CAUSES };
#undef GUARD_NAME

/* Conditions for sending a force: the button is held, the safety switch is closed. */
enum { NEEDS_BUTTON = 1, NEEDS_SWITCH = 2 };

#define GUARD_SLACK 2e-5 /* J that may be missing: an encoder's step can hide this much */
/* J: a deficit of this much ends the run at once, and no tick may give more */
#define GUARD_SPENT 2.5e-4
#define GUARD_PATIENCE 0.05 /* s until damping must have stopped the trouble */
#define GUARD_AGAIN 1.0     /* s within which a third shaking ends the run */
/* signs of instability, of any kind, that are allowed at once, and per second */
#define GUARD_OFTEN 4
#define GUARD_HOT 0.9   /* share of a motor's largest temperature */
#define GUARD_WARM 10.0 /* s over which the motors' load is averaged */
#define GUARD_CHECK 100 /* ticks between two checks of the calibration */
/* m by which a position may deviate from the integrated velocities, ... */
#define GUARD_DRIFT 7e-4
#define GUARD_LAG 0.02   /* ... plus the speed times this lag of the velocities, s, ... */
#define GUARD_FORGET 0.1 /* ... within this many seconds */

typedef struct {
    double force, continuous; /* peak and sustained, N; continuous 0: unknown */
    double step;              /* largest addition between ticks, N */
    double impulse;           /* largest change between ticks, N */
    double speed;             /* of the probe, m/s; above it the run ends */
    double ramp;              /* ticks until the full force is reached */
    /* of the device, Ns/m: the only loss that is certain, since friction may vary */
    double damping;
    double encoder;      /* step of the positions, m; 0: unknown */
    double stiffness;    /* of the wall, N/m: bounds the energy that it can store */
    double most_damping; /* largest damping that may be added, Ns/m */
    int needs;           /* NEEDS_... */
} guard_limits;

typedef struct {
    guard_limits limits;
    double period; /* s */
    double position[3], sent[3], velocity[3];
    /* device's velocity; position minus its integral; recent speed, m/s */
    double reported[3], drift[3], quick;
    /* motion of the touched objects since the last tick: the wall moves with them */
    double carried[3];
    double ticks, given; /* all ticks; those since arming */
    /* s since the start; start of the present trouble, negative if there is none */
    double now, trouble;
    double times[2]; /* of the last shaking and the one before, s */
    double load;     /* mean square of the force over GUARD_WARM s */
    energy energy;
    shaking shaking;
    double strongest, steepest, fastest, added;
    long long cut, slowed, damped; /* ticks in which the force was cut, slewed, damped */
    /* first tick with forces, or -1; number of signs of instability */
    long long armed_at, signs;
    int armed, cause, at_most; /* at_most: the last force was cut */
    /* in the last tick the wall pushed, even if the guard removed its force, or a force was sent */
    int touching;
    int shook; /* the probe shook in the last tick */
    /* signs, decaying by GUARD_OFTEN per second; time of the last one, s */
    double often, sign;
    double share; /* of the full force, by the ramp */
} guard;

static void guard_end(guard *g, int cause) {
    if (!g->cause) g->cause = cause;
}

/* Start with these limits; an invalid one ends the run at once. */
static void guard_start(guard *g, const guard_limits *limits, double period) {
    const double all[] = {limits->force, limits->continuous, limits->step, limits->impulse,
        limits->speed, limits->ramp, limits->damping, limits->encoder, limits->stiffness,
        limits->most_damping};
    memset(g, 0, sizeof *g);
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        if (!(all[k] >= 0 && all[k] <= DBL_MAX)) guard_end(g, CAUSE_LIMITS);
    if (!(period > 0 && period <= DBL_MAX)) guard_end(g, CAUSE_LIMITS);
    g->limits = *limits, g->period = period;
    g->trouble = g->times[0] = g->times[1] = -1e9;
    g->armed_at = -1;
    shaking_start(&g->shaking);
}

/* Check the state of the device, before any field is queried. */
static void guard_watch(guard *g, const device_state *state, int calibrated) {
    if (!(length_of(state->position) <= 1e3)) guard_end(g, CAUSE_NUMBER);
    if (!calibrated) guard_end(g, CAUSE_CALIBRATION);
    if ((g->limits.needs & NEEDS_SWITCH) && !state->safe && g->armed) guard_end(g, CAUSE_SWITCH);
    if (!(state->temperature < GUARD_HOT)) guard_end(g, CAUSE_HOT);
}

/* Energy (J) that only seems to be missing because an encoder reports motion in steps. The whole
 * step is booked with the force at its start, although the force at its end acted over half of it.
 * Zero if the step took less than a tick. */
static double guard_unseen(const guard *g, double length, double speed, double dt) {
    double step = g->limits.encoder;
    if (!(step > 0 && length > 0 && length <= 2 * step)) return 0;
    return 0.5 * g->limits.stiffness * g->share * length * fmax(0, step - speed * dt);
}

/* Account for the motion since the last tick, under the force sent for it, and detect shaking. */
static void guard_observe(guard *g, const double *position, const double *speed, double dt) {
    double way[3], work = 0, length;
    for (int k = 0; k < 3; k++) {
        way[k] = position[k] - g->position[k];
        work += g->sent[k] * (way[k] - g->carried[k]), g->velocity[k] = way[k] / dt;
    }
    length = length_of(way);
    double lost =
        g->limits.damping * length * length / dt + guard_unseen(g, length, length_of(speed), dt);
    energy_book(&g->energy, g->touching, length_of(g->sent), work, lost,
        g->limits.stiffness * g->share, g->at_most);
    g->now += dt;
    shaking_see(&g->shaking, position, g->now, length_of(g->sent) > 0);
    double share = dt / GUARD_WARM, size = length_of(g->sent);
    g->load += (share < 1 ? share : 1) * (size * size - g->load);
    if (g->fastest < length / dt) g->fastest = length / dt;
    if (length / dt > g->limits.speed) guard_end(g, CAUSE_SPEED);
}

/* Compare the motion since the last tick with the device's velocities. A stuck encoder
 * reports no motion while the device moves; a drifting one reports motion that does not happen.
 * NaN velocities disable the check. */
static void guard_compare(guard *g, const device_state *state, double dt) {
    double kept = fmax(0, 1 - dt / GUARD_FORGET), way[3];
    for (int k = 0; k < 3; k++) {
        way[k] = (g->reported[k] + state->velocity[k]) / 2;
        g->drift[k] = kept * g->drift[k] + state->position[k] - g->position[k] - way[k] * dt;
    }
    double speed = fmax(length_of(g->velocity), length_of(way));
    g->quick = fmax(kept * g->quick, speed);
    if (length_of(g->drift) > GUARD_DRIFT + GUARD_LAG * g->quick) guard_end(g, CAUSE_ENCODER);
}

/* Energy (J) that may be given without exceeding the energy taken and lost in this contact and
 * before. */
static double guard_has(const guard *g) { return g->energy.balance + g->energy.debt; }

/* Whether energy is missing in this contact or the probe shakes. Ends the run if that lasts or
 * recurs too often. */
static int guard_troubled(guard *g) {
    int shakes = shaking_now(&g->shaking, g->now),
        wrong = g->energy.balance < -GUARD_SLACK || shakes;
    if (guard_has(g) < -GUARD_SPENT) guard_end(g, CAUSE_UNSTABLE);
    if (shakes && !g->shook) {
        if (g->now - g->times[1] < GUARD_AGAIN) guard_end(g, CAUSE_UNSTABLE);
        g->times[1] = g->times[0], g->times[0] = g->now;
    }
    g->shook = shakes;
    if (!wrong) {
        g->trouble = -1e9;
    } else if (g->trouble < 0) {
        g->trouble = g->now, g->signs++;
        g->often = fmax(0, g->often - GUARD_OFTEN * (g->now - g->sign)) + 1, g->sign = g->now;
        if (g->often > GUARD_OFTEN) guard_end(g, CAUSE_UNSTABLE);
    } else if (g->now - g->trouble >= GUARD_PATIENCE - g->period) {
        guard_end(g, CAUSE_UNSTABLE); /* in the last tick of GUARD_PATIENCE */
    }
    return wrong;
}

/* Damp a force: as far as allowed if troubled, else just enough to regain the energy that the
 * balance lacks. The force never becomes a pull. */
static void guard_damp(guard *g, double *force, double dt, int troubled) {
    double size = length_of(force), fast = length_of(g->velocity), lacking = -guard_has(g);
    if (!(size > 0 && fast > 0) || !(troubled || lacking > 0)) return;
    double damping = troubled ? g->limits.most_damping
                              : fmin(lacking / (fast * fast * dt), g->limits.most_damping);
    double push = 0, normal[3], damped[3];
    for (int k = 0; k < 3; k++) {
        normal[k] = force[k] / size, damped[k] = force[k] - damping * g->velocity[k];
        push += damped[k] * normal[k];
    }
    for (int k = 0; k < 3; k++) force[k] = damped[k] - (push < 0 ? push * normal[k] : 0);
    g->damped++;
}

/* Limit the energy given in the next tick to the balance plus GUARD_SPENT. */
static void guard_save(guard *g, double *force, double dt) {
    double work = 0, room = fmax(0, guard_has(g) + GUARD_SPENT);
    for (int k = 0; k < 3; k++) work += force[k] * g->velocity[k] * dt;
    if (!(work > room)) return;
    for (int k = 0; k < 3; k++) force[k] *= room / work;
    g->damped++;
}

/* Limit a force to the largest that is allowed now. */
static void guard_cut(guard *g, double *force) {
    double most = g->limits.force, size = length_of(force), steady = g->limits.continuous;
    g->at_most = 0;
    if (steady > 0 && steady < most) { /* the limit falls as the load nears the sustained force */
        double room = (steady * steady - g->load) / (0.2 * steady * steady);
        most = steady + (most - steady) * fmin(1, fmax(0, room));
    }
    if (!(size > most)) return;
    for (int k = 0; k < 3; k++) force[k] *= most / size;
    g->cut++, g->at_most = 1;
}

/* Limit both the force added to a share of the last force and the whole change, in proportion to
 * the elapsed time. */
static void guard_slew(guard *g, double *force, double part) {
    const double most = g->limits.step * part, steepest = g->limits.impulse * part;
    double last = length_of(g->sent), along = 0, added[3], change[3], share = 0;
    for (int k = 0; k < 3; k++) along += force[k] * g->sent[k];
    if (last > 0) share = fmin(1, fmax(0, along / (last * last)));
    for (int k = 0; k < 3; k++) added[k] = force[k] - share * g->sent[k];
    double more = length_of(added);
    if (more > most) {
        for (int k = 0; k < 3; k++) force[k] = share * g->sent[k] + added[k] * (most / more);
        more = most, g->slowed++;
    }
    for (int k = 0; k < 3; k++) change[k] = force[k] - g->sent[k];
    double step = length_of(change);
    if (step > steepest) {
        for (int k = 0; k < 3; k++) force[k] = g->sent[k] + change[k] * (steepest / step);
        step = steepest, g->slowed++;
    }
    g->added = fmax(g->added, more), g->steepest = fmax(g->steepest, step);
}

/* Whether a force may be given: after a tick outside of the object, with the button held and the
 * switch closed. */
static int guard_armed(guard *g, const device_state *state, const double *force, int armed) {
    int held = !(g->limits.needs & NEEDS_BUTTON) || state->buttons;
    int closed = !(g->limits.needs & NEEDS_SWITCH) || state->safe;
    if (!armed || !held || !closed) g->armed = 0;
    else if (!g->armed && !(length_of(force) > 0)) {
        g->armed = 1, g->given = 0;
        if (g->armed_at < 0) g->armed_at = (long long)g->ticks;
    }
    return g->armed;
}

/* Raise the share of the full force. A wall that stiffens under a pressing probe gives the probe
 * energy. During contact, the share therefore grows no faster than the device's losses pay for. */
static void guard_ramp(guard *g, double size) {
    double share = g->limits.ramp > 0 ? fmin(1, g->given / g->limits.ramp) : 1;
    if (g->touching && g->limits.stiffness > 0 && size > 0 && share > g->share) {
        double price = size * size / (2 * g->limits.stiffness),
               more = fmin(share - g->share, g->energy.spare / price);
        g->energy.spare -= more * price, g->energy.balance += more * price, share = g->share + more;
    }
    g->share = share;
}

/* Final check: a force that is not a number, or is beyond the limit, becomes zero and ends the run.
 */
static void guard_close(guard *g, double *force) {
    if (length_of(force) <= g->limits.force * (1 + 1e-9)) return; /* false for NaN */
    guard_end(g, CAUSE_NUMBER);
    force[0] = force[1] = force[2] = 0;
}

/* Turn the field's force into one that may be sent: zero once there is a cause to end the run.
 * `since`: time since the last tick, s. */
static void guard_pass(
    guard *g, const device_state *state, double since, int armed, double *force) {
    /* catch-up calls must not look like a fast probe */
    double dt = since > g->period ? since : g->period;
    double part = fmin(1, fmax(0, since / g->period));
    if (!(length_of(force) <= 1e100)) guard_end(g, CAUSE_NUMBER);
    if (!g->cause && g->ticks > 0)
        guard_observe(g, state->position, state->velocity, dt), guard_compare(g, state, dt);
    int troubled = !g->cause && guard_troubled(g);
    int touching = length_of(force) > 0;
    if (g->cause || !guard_armed(g, state, force, armed)) {
        force[0] = force[1] = force[2] = 0;
    } else {
        guard_ramp(g, length_of(force));
        for (int k = 0; k < 3; k++) force[k] *= g->share;
        guard_damp(g, force, dt, troubled);
        guard_save(g, force, dt);
        guard_cut(g, force);
        guard_slew(g, force, part);
        g->strongest = fmax(g->strongest, length_of(force));
        g->given += part;
    }
    guard_close(g, force);
    g->touching = touching || length_of(force) > 0;
    memcpy(g->position, state->position, sizeof g->position);
    memcpy(g->reported, state->velocity, sizeof g->reported);
    memcpy(g->sent, force, sizeof g->sent);
    g->ticks++;
}

#endif

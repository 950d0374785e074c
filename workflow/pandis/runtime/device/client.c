/* Forces on a haptic device: on OpenHaptics, loaded when a run begins, or on the simulated device.
 *
 * At every tick the force of a scene of pandis.h, in metres and newtons of the device's workspace,
 * passes the guard (guard.h) and is sent. After any error the force is zero from that tick on, and
 * the run ends. It also ends when ticks come too late, when the program is interrupted, and after
 * the last tick. Unless the run is armed, positions are only read, and no force is ever sent.
 */
#define _GNU_SOURCE
#define PANDIS_IMPLEMENTATION
#include "../../engine/pandis.h"
#include "../../engine/layout.h"
#include "bridge.h"
#include "guard.h"
#include "hd.h"
#include "simulated.h"

#include <dlfcn.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

/* RELEASE: ticks of zero force before a run releases the device. LOOK: interval of the watchdog's
 * checks, ns. */
#define RELEASE 5
/* longest interval between two calls, s: beyond it, walls give a light hand more than 1 mJ */
#define SLOWEST 0.004
#define LOOK 1000000

static double client_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#include "watchdog.h"

typedef struct {
    pandis_scene *scene;
    guard_limits limits;
    double period, deadline; /* s; a tick that computes longer than the deadline is an overrun */
    int overruns;            /* this many in a row end the run */
    double gap;              /* s; calls further apart, or a call that takes longer, end the run */
    double patience;         /* s without a call until the watchdog ends the run */
    /* N: refuse a device whose largest force differs by more than a tenth; 0: any */
    double expected;
    int armed;
    long long ticks;
    /* per tick: m, N, s of computing, s since the last call */
    double *positions, *forces, *taken, *since;
    double *proxies; /* per tick: proxy on the first touched object; else the position, m */
    /* to a simulation that moves the scene's objects, or NULL; needs a scene with contacts */
    bridge *bridge;
    /* called every `every` ticks, in simulated time only; nonzero ends the run */
    int (*between)(void);
    int every, held; /* ticks between these calls; ticks for which each force is held */
    /* starts a watchdog process once the device is open, and returns 0 if it cannot; or NULL */
    int (*watch)(void);
    watchdog_pulse *pulse; /* shared with that process, or NULL */
} client_order;

typedef struct {
    int cause;
    unsigned int code; /* the device's error, if that is the cause */
    int stand_in, simulated, hangs, watched;
    long long ticks; /* that were run */
    double worst;    /* J, see energy.h; for a simulated device, from its true positions */
    double strongest, steepest, fastest, added;
    long long cut, slowed, damped;
    long long armed_at, signs; /* see guard.h */
    device_spec spec;          /* as the device reported it */
    guard_limits limits;       /* in effect */
    char why[256];
} client_outcome;

/* Static, with a copy of the order, because a callback that hangs may outlive its run. In that case
 * the memory that the order points to must stay alive, and no other run may begin. */
static struct {
    device device;
    device_spec spec;
    client_order order;
    guard guard;
    double middle[3]; /* centre of the device's workspace, and origin of the scene */
    double asked[3];  /* the scene's last force */
    size_t touched;   /* objects touched in the last step of a scene with contacts */
    unsigned int code;
    int overruns, released;
    double last;
    /* shared by the scheduler's thread and the waiting one */
    long long beat;
    int inside, finished, cancelled;
} client;

static volatile sig_atomic_t client_signal;
/* One run at a time, from any thread: it owns the device and the static data of this file. */
enum { CLIENT_FREE, CLIENT_TAKEN, CLIENT_HUNG }; /* hung: a callback has not returned */
static int client_state;
static pthread_t client_ticking; /* the thread of the last tick */

static void client_note_signal(int number) { client_signal = number; }

#include "ticks.h"

static int client_fail(client_outcome *outcome, int cause, const char *why) {
    outcome->cause = cause;
    snprintf(outcome->why, sizeof outcome->why, "%s", why);
    return cause;
}

/* Apply the device's own limits. Returns 0 if it is not the expected device, or not ready. */
static int client_meet(client_outcome *outcome) {
    const device_spec *spec = &client.spec;
    const client_order *order = &client.order;
    guard_limits *limits = &client.guard.limits;
    outcome->spec = *spec;
    if (spec->force > 0) limits->force = fmin(limits->force, spec->force);
    if (spec->continuous > 0)
        limits->continuous =
            limits->continuous > 0 ? fmin(limits->continuous, spec->continuous) : spec->continuous;
    if (spec->speed > 0) limits->speed = fmin(limits->speed, spec->speed);
    if (spec->impulse > 0)
        limits->impulse = fmin(limits->impulse, spec->impulse * order->period * 1e3);
    limits->step = fmin(limits->step, limits->impulse);
    for (int k = 0; k < 3; k++)
        client.middle[k] = spec->high[k] > spec->low[k] ? (spec->low[k] + spec->high[k]) / 2 : 0;
    if (spec->has_switch) limits->needs |= NEEDS_SWITCH;
    if (order->armed && client.device.start && order->period > SLOWEST)
        client_fail(outcome, CAUSE_DEVICE,
            "forces need a call every 4 ms, and this device calls less often");
    else if (order->expected > 0 && (order->armed || spec->force > 0) &&
        !(fabs(spec->force / order->expected - 1) <= 0.1))
        client_fail(outcome, CAUSE_DEVICE,
            "its largest force is that of another model: set hardware.attached.model");
    else if (spec->rate > 0 && fabs(spec->rate * order->period - 1) > 0.1)
        client_fail(outcome, CAUSE_DEVICE, "it runs at another rate than requested");
    else if (order->armed && client.device.calibrated(&client.device) != DEVICE_CALIBRATED)
        client_fail(outcome, CAUSE_CALIBRATION,
            "calibrate it with its maker's program, or put the stylus into its inkwell");
    outcome->limits = *limits;
    return !outcome->cause;
}

/* Warn, before a force is sent, of a hazard that this process cannot prevent. */
static void client_warn(void) {
    fputs("pandis: forces are sent from now on. No second process could take the device (the "
          "library refused it, or it did not\n"
          "start in time). Only this process can end the forces: if it is killed (SIGKILL) or "
          "halted (SIGSTOP, a debugger),\n"
          "the motors hold the last force. Keep the device's switch or its plug within reach.\n",
        stderr);
}

/* Run an order on a device, and release the device whatever happens. */
static int client_run(
    const device *made, const char *name, const client_order *order, client_outcome *outcome) {
    pthread_t pulling;
    int pulled = 0;
    client.device = *made, client.order = *order;
    device *d = &client.device;
    guard_start(&client.guard, &order->limits, order->period);
    if (client.guard.cause) return outcome->cause = client.guard.cause;
    unsigned int code = d->open(d, name, &client.spec);
    if (code) {
        outcome->code = code;
        return client_fail(outcome, CAUSE_DEVICE, "the device cannot be initialised");
    }
    if (!client_meet(outcome)) {
        d->close(d);
        return outcome->cause;
    }
    outcome->watched = order->armed && order->watch && order->watch();
    if (order->armed && d->start && !outcome->watched) client_warn();
    d->output(d, order->armed);
    if (d->start) code = d->start(d, client_tick, NULL);
    else if (!d->next) pulled = !pthread_create(&pulling, NULL, client_pull, NULL), code = !pulled;
    if (!code) client_wait();
    else client.code = code, __atomic_store_n(&client.cancelled, CAUSE_DEVICE, __ATOMIC_SEQ_CST);
    d->output(d, 0); /* first, so that the motors are off even if something hangs */
    outcome->hangs = __atomic_load_n(&client.inside, __ATOMIC_SEQ_CST) &&
        __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG;
    if (!outcome->hangs) { /* otherwise stopping would block for ever */
        if (pulled) pthread_join(pulling, NULL);
        d->stop(d);
    }
    d->close(d);
    long long beat = __atomic_load_n(&client.beat, __ATOMIC_SEQ_CST);
    const guard *g = &client.guard;
    outcome->cause = g->cause ? g->cause : __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    outcome->code = client.code, outcome->ticks = beat < order->ticks ? beat : order->ticks;
    /* a simulated device does not account for the motion of touched objects */
    outcome->worst = client_real() || order->bridge ? g->energy.worst : simulated.energy.worst;
    outcome->strongest = g->strongest, outcome->steepest = g->steepest, outcome->added = g->added;
    outcome->fastest = g->fastest, outcome->cut = g->cut, outcome->slowed = g->slowed,
    outcome->damped = g->damped;
    outcome->armed_at = g->armed_at, outcome->signs = g->signs;
    return outcome->cause;
}

/* Reserve the device for a run; returns 0, or the cause if it is not available. */
static int client_begin(client_outcome *outcome) {
    int state = CLIENT_FREE;
    memset(outcome, 0, sizeof *outcome);
    outcome->armed_at = -1;
    if (__atomic_compare_exchange_n(
            &client_state, &state, CLIENT_TAKEN, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) {
        memset(&client, 0, sizeof client);
        return 0;
    }
    if (state == CLIENT_TAKEN) return client_fail(outcome, CAUSE_BUSY, "");
    return client_fail(
        outcome, CAUSE_WATCHDOG, "the last run's callback never returned: restart the program");
}

/* Let another run begin, unless a callback of this one may still be running. */
static int client_end(const client_outcome *outcome) {
    __atomic_store_n(&client_state, outcome->hangs ? CLIENT_HUNG : CLIENT_FREE, __ATOMIC_SEQ_CST);
    return outcome->cause;
}

#include "signals.h"

/* Run an order on OpenHaptics, or on a stand-in, which must export the symbol `pandis_stand_in`.
 * During the run, signals that would end or stop the program first end the run with zero force. */
int client_device(
    const char *library, const char *name, const client_order *order, client_outcome *outcome) {
    hd_api found;
    device made;
    void *handle = NULL;
    if (client_begin(outcome)) return outcome->cause;
    if (!hd_load(library, &found, &handle)) client_fail(outcome, CAUSE_LIBRARY, dlerror());
    if (outcome->cause) return client_end(outcome);
    hd_device(&found, &made);
    outcome->stand_in = dlsym(handle, "pandis_stand_in") != NULL;
    client.device = made; /* for a signal that arrives before the run begins */
    client_intercept();
    client_run(&made, name, order, outcome);
    client_give_back();
    return client_end(outcome);
}

/* Run an order on the simulated device. `start` (3,): initial position, m. `rest`, `press`: per
 * tick, the hand's rest position (m) and force (N). `path`: per tick, the device's true position at
 * its end (m). With `clock` the client's clock drives it, like a device without a scheduler. */
int client_simulated(const simulated_spec *spec, const double *start, const double *rest,
    const double *press, double *path, int clock, const client_order *order,
    client_outcome *outcome) {
    device made;
    if (client_begin(outcome)) return outcome->cause;
    outcome->simulated = 1;
    simulated_prepare(spec, start, rest, press, order->ticks);
    simulated.path = path;
    simulated_device(&made);
    if (clock) made.write = simulated_write_and_move, made.next = NULL;
    client_run(&made, NULL, order, outcome);
    return client_end(outcome);
}

#include "binding.h"

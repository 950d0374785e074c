/* Forces on a haptic device: on OpenHaptics, loaded when a run begins, or on the simulated device.
 *
 * The force of a scene of pandis.h, in metres and newtons of the device's workspace, passes the guard
 * (guard.h) and is sent at every tick. On any error the force is zero from that tick on, and the run ends;
 * so it does when ticks come too late, when somebody interrupts the program, and after the last tick. Unless
 * the run is armed no force is ever sent: positions are read, and that is all.
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

/* Ticks of zero force before a run lets go of the device; how often the watchdog looks (ns). */
#define RELEASE 5
#define SLOWEST 0.004 /* s between two calls: with longer ones, walls give a light hand more than a millijoule */
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
    double period, deadline; /* s; a tick that computes longer is an overrun ... */
    int overruns;            /* ... and so many in a row end the run */
    double gap;              /* s; calls further apart, or a call that takes longer, end it */
    double patience;         /* s without a call, after which the watchdog ends it */
    double expected;         /* N: a device whose own limit is off by more than a tenth is another; 0: any */
    int armed;
    long long ticks;
    double *positions, *forces, *taken, *since; /* per tick: m, N, s of computing, s since the last call */
    double *proxies; /* per tick: of the first object that is touched; else the position, m */
    bridge *bridge;  /* to a simulation that moves the scene's objects, or NULL; with contacts only */
    int (*between)(void); /* called every so many ticks, where time is that of ticks; not 0: the run ends */
    int every, held;      /* ticks between these calls; and ticks for which each force is held */
    int (*watch)(void);   /* starts a watchdog process, once the device is open; 0: there is none; or NULL */
    watchdog_pulse *pulse; /* of that process, or NULL */
} client_order;

typedef struct {
    int cause;
    unsigned int code; /* of the device, where that is the cause */
    int stand_in, simulated, hangs, watched;
    long long ticks; /* so many were run */
    double worst;    /* J, see guard.h; of the simulated device by where it really was */
    double strongest, steepest, fastest, added;
    long long cut, slowed, damped;
    long long armed_at, signs; /* see guard.h */
    device_spec spec;          /* what the device said of itself */
    guard_limits limits;       /* what was kept */
    char why[256];
} client_outcome;

/* Not on the stack, and with an order of its own: a callback that hangs may outlive its run. What the
 * order points to must live on then, and no other run may begin. */
static struct {
    device device;
    device_spec spec;
    client_order order;
    guard guard;
    double middle[3]; /* of the device's workspace: there the scene's origin lies */
    double asked[3];  /* the last force that the scene had */
    size_t touched;   /* objects, in the last step of a scene with contacts */
    unsigned int code;
    int overruns, released;
    double last;
    /* between the scheduler's thread and the one that waits */
    long long beat;
    int inside, finished, cancelled;
} client;

static volatile sig_atomic_t client_signal;
/* One run at a time, whichever thread asks: the first has the device, and what is static here. */
enum { CLIENT_FREE, CLIENT_TAKEN, CLIENT_HUNG }; /* hung: a callback has not come back */
static int client_state;
static pthread_t client_ticking; /* the thread of the last tick */

static void client_note_signal(int number) { client_signal = number; }

/* In the time of ticks nothing is late. */
static int client_real(void) { return client.device.next == NULL; }

/* Take the device's errors; the first one ends the run. */
static void client_errors(void) {
    for (int k = 0; k < 16; k++) {
        unsigned int code = client.device.error(&client.device);
        if (!code) return;
        if (!client.guard.cause) client.code = code;
        guard_end(&client.guard, CAUSE_ERROR);
    }
}

/* The force that the scene has at a position of the device, and the proxy of a scene that has contacts. */
static void client_ask(const double *position, double *force, double *proxy) {
    pandis_scene *scene = client.order.scene;
    pandis_touch touch;
    double place[3];
    pandis_flag flag;
    int contacts = pandis__scene_in(scene)->contacts != NULL;
    bridge *b = client.order.bridge;
    double dt = client.order.period * client.order.held; /* until the next force */
    for (int k = 0; k < 3; k++) place[k] = position[k] - client.middle[k];
    if (b) bridge_move(b, scene, dt);
    client.touched = 0;
    if (b) flag = pandis_scene_touch(scene, place, dt, force, b->touches, b->count, &client.touched), touch = *b->touches;
    else if (contacts) flag = pandis_scene_touch(scene, place, dt, force, &touch, 1, &client.touched);
    else flag = pandis_scene_force(scene, place, force);
    if (flag == PANDIS_INVALID) guard_end(&client.guard, CAUSE_NUMBER);
    for (int k = 0; client.touched && k < 3; k++) proxy[k] = touch.proxy[k] + client.middle[k];
}

/* What is done at every tick, by whoever drives the time. Returns 0 after the last one. */
static int client_tick(void *data) {
    const client_order *order = &client.order;
    guard *g = &client.guard;
    double begin = client_now(), force[3] = {0};
    device_state state;
    long long tick = client.beat;
    (void)data;
    client_ticking = pthread_self();
    __atomic_store_n(&client.inside, 1, __ATOMIC_SEQ_CST);
    if (__atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG) { /* the device is let go of */
        __atomic_store_n(&client.inside, 0, __ATOMIC_SEQ_CST);
        return 0;
    }
    double since = tick && client_real() ? begin - client.last : order->period;
    client.device.read(&client.device, &state);
    client_errors();
    int look = order->armed && (!g->armed || tick % GUARD_CHECK == 0);
    guard_watch(g, &state, !look || client.device.calibrated(&client.device) == DEVICE_CALIBRATED);
    int cancelled = __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    if (cancelled) guard_end(g, cancelled);
    if (client_real() && since > order->gap) guard_end(g, CAUSE_GAP);
    double proxy[3];
    memcpy(proxy, state.position, sizeof proxy);
    int asks = !g->cause && tick < order->ticks;
    if (asks && order->between && tick % order->every == 0 && order->between()) guard_end(g, CAUSE_INTERRUPTED), asks = 0;
    int due = asks && tick % order->held == 0;
    if (due) client_ask(state.position, client.asked, proxy);
    if (asks) memcpy(force, client.asked, sizeof force);
    double taken = client_now() - begin;
    client.overruns = client_real() && taken > order->deadline ? client.overruns + 1 : 0;
    if (client_real() && client.overruns >= order->overruns) guard_end(g, CAUSE_OVERRUN);
    if (client_real() && taken > order->gap) guard_end(g, CAUSE_GAP);
    /* nobody is armed any more after the last tick, in which no field is asked */
    double asked[3], size = pandis__dot(force, force);
    memcpy(asked, force, sizeof asked);
    for (int k = 0; k < 3; k++) g->carried[k] = order->bridge && due ? order->bridge->carried[k] : 0;
    guard_pass(g, &state, since, order->armed && (tick < order->ticks || g->armed), force);
    if (order->bridge && asks) {
        double share = size > 0 ? pandis__dot(asked, force) / size : 0; /* the guard may have cut it */
        bridge_give(order->bridge, client.touched, fmin(fmax(share, 0), 1), order->period);
    }
    client.device.write(&client.device, force, NULL);
    client_errors();
    if (g->cause && length_of(force) > 0) { /* an error of this very write: there may be no other tick */
        client.device.output(&client.device, 0);
        force[0] = force[1] = force[2] = 0;
        memcpy(g->sent, force, sizeof force);
    }
    if (tick < order->ticks) {
        memcpy(order->positions + 3 * tick, state.position, sizeof state.position);
        memcpy(order->forces + 3 * tick, force, sizeof force);
        memcpy(order->proxies + 3 * tick, proxy, sizeof proxy);
        order->taken[tick] = taken, order->since[tick] = since;
    }
    client.last = begin;
    __atomic_store_n(&client.beat, tick + 1, __ATOMIC_SEQ_CST);
    if (order->pulse) __atomic_store_n(&order->pulse->beat, tick + 1, __ATOMIC_SEQ_CST);
    /* the motors hold the last force: it is zero, whatever ends the run */
    if (g->cause || (tick >= order->ticks && !(length_of(force) > 0))) client.released++;
    int finished = client.released >= RELEASE;
    __atomic_store_n(&client.inside, 0, __ATOMIC_SEQ_CST);
    if (finished) __atomic_store_n(&client.finished, 1, __ATOMIC_SEQ_CST);
    return !finished;
}

/* Drive a pull device by a clock of our own. */
static void *client_pull(void *none) {
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (client_tick(NULL)) {
        due.tv_nsec += (long)(1e9 * client.order.period + 0.5);
        if (due.tv_nsec >= 1000000000) due.tv_nsec -= 1000000000, due.tv_sec++;
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now); /* who is late does not catch up */
        if (now.tv_sec > due.tv_sec || (now.tv_sec == due.tv_sec && now.tv_nsec > due.tv_nsec)) due = now;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
    return none;
}

/* Wait until the run is over; end it when no call comes, one does not come back, or a signal does. */
static void client_wait(void) {
    const struct timespec look = {0, LOOK};
    long long seen = -1;
    double since = client_now();
    while (!__atomic_load_n(&client.finished, __ATOMIC_SEQ_CST)) {
        if (!client_real()) {
            if (client_tick(NULL)) client.device.next(&client.device);
            continue;
        }
        nanosleep(&look, NULL);
        if (client_signal) __atomic_store_n(&client.cancelled, CAUSE_INTERRUPTED, __ATOMIC_SEQ_CST);
        long long beat = __atomic_load_n(&client.beat, __ATOMIC_SEQ_CST);
        if (beat != seen) seen = beat, since = client_now();
        if (client_now() - since < client.order.patience) continue;
        __atomic_store_n(&client.cancelled, CAUSE_WATCHDOG, __ATOMIC_SEQ_CST);
        return;
    }
}

static int client_fail(client_outcome *outcome, int cause, const char *why) {
    outcome->cause = cause;
    snprintf(outcome->why, sizeof outcome->why, "%s", why);
    return cause;
}

/* Keep within what the device allows; 0 if it is not the one that was expected, or not ready. */
static int client_meet(client_outcome *outcome) {
    const device_spec *spec = &client.spec;
    const client_order *order = &client.order;
    guard_limits *limits = &client.guard.limits;
    outcome->spec = *spec;
    if (spec->force > 0) limits->force = fmin(limits->force, spec->force);
    if (spec->continuous > 0)
        limits->continuous = limits->continuous > 0 ? fmin(limits->continuous, spec->continuous) : spec->continuous;
    if (spec->speed > 0) limits->speed = fmin(limits->speed, spec->speed);
    if (spec->impulse > 0) limits->impulse = fmin(limits->impulse, spec->impulse * order->period * 1e3);
    limits->step = fmin(limits->step, limits->impulse);
    for (int k = 0; k < 3; k++)
        client.middle[k] = spec->high[k] > spec->low[k] ? (spec->low[k] + spec->high[k]) / 2 : 0;
    if (spec->has_switch) limits->needs |= NEEDS_SWITCH;
    if (order->armed && client.device.start && order->period > SLOWEST)
        client_fail(outcome, CAUSE_DEVICE, "forces need a call every 4 ms, and this one calls more seldom");
    else if (order->expected > 0 && (order->armed || spec->force > 0) && !(fabs(spec->force / order->expected - 1) <= 0.1))
        client_fail(outcome, CAUSE_DEVICE, "its largest force is that of another model: set hardware.attached.model");
    else if (spec->rate > 0 && fabs(spec->rate * order->period - 1) > 0.1)
        client_fail(outcome, CAUSE_DEVICE, "it runs at another rate than was asked for");
    else if (order->armed && client.device.calibrated(&client.device) != DEVICE_CALIBRATED)
        client_fail(outcome, CAUSE_CALIBRATION, "calibrate it with its maker's program, or put the stylus into its inkwell");
    outcome->limits = *limits;
    return !outcome->cause;
}

/* What nothing here can prevent, told before a force is sent. */
static void client_warn(void) {
    fputs("pandis: forces are sent from now on. No second process could take the device (the library refused it, or it did not\n"
          "start in time), so nobody else can end them: if this process is killed (SIGKILL) or halted (SIGSTOP, a debugger), the\n"
          "motors hold the last force. Keep the device's switch or its plug within reach.\n", stderr);
}

/* Run an order on a device, and let go of it whatever happens. */
static int client_run(const device *made, const char *name, const client_order *order, client_outcome *outcome) {
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
    d->output(d, 0); /* first of all: whatever hangs, the motors are off */
    outcome->hangs = __atomic_load_n(&client.inside, __ATOMIC_SEQ_CST) &&
                     __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG;
    if (!outcome->hangs) { /* else stopping would wait for ever */
        if (pulled) pthread_join(pulling, NULL);
        d->stop(d);
    }
    d->close(d);
    long long beat = __atomic_load_n(&client.beat, __ATOMIC_SEQ_CST);
    const guard *g = &client.guard;
    outcome->cause = g->cause ? g->cause : __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    outcome->code = client.code, outcome->ticks = beat < order->ticks ? beat : order->ticks;
    /* a simulated device does not know that what it touches moves */
    outcome->worst = client_real() || order->bridge ? g->energy.worst : simulated.energy.worst;
    outcome->strongest = g->strongest, outcome->steepest = g->steepest, outcome->added = g->added;
    outcome->fastest = g->fastest, outcome->cut = g->cut, outcome->slowed = g->slowed, outcome->damped = g->damped;
    outcome->armed_at = g->armed_at, outcome->signs = g->signs;
    return outcome->cause;
}

/* Take the device for a run; returns 0, or why it cannot be had. */
static int client_begin(client_outcome *outcome) {
    int state = CLIENT_FREE;
    memset(outcome, 0, sizeof *outcome);
    outcome->armed_at = -1;
    if (__atomic_compare_exchange_n(&client_state, &state, CLIENT_TAKEN, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) {
        memset(&client, 0, sizeof client);
        return 0;
    }
    if (state == CLIENT_TAKEN) return client_fail(outcome, CAUSE_BUSY, "");
    return client_fail(outcome, CAUSE_WATCHDOG, "the last run's callback has never come back: start anew");
}

/* Let another run begin, unless a callback of this one may still be at it. */
static int client_end(const client_outcome *outcome) {
    __atomic_store_n(&client_state, outcome->hangs ? CLIENT_HUNG : CLIENT_FREE, __ATOMIC_SEQ_CST);
    return outcome->cause;
}

#include "signals.h"

/* Run an order on OpenHaptics, or on what stands in for it: what such a library calls itself must say so.
 * While it runs, signals that would end or stop the program end it with zero force first. */
int client_device(const char *library, const char *name, const client_order *order, client_outcome *outcome) {
    hd_api found;
    device made;
    void *handle = NULL;
    if (client_begin(outcome)) return outcome->cause;
    if (!hd_load(library, &found, &handle)) client_fail(outcome, CAUSE_LIBRARY, dlerror());
    if (outcome->cause) return client_end(outcome);
    hd_device(&found, &made);
    outcome->stand_in = dlsym(handle, "pandis_stand_in") != NULL;
    client.device = made; /* for a signal that comes before the run does */
    client_intercept();
    client_run(&made, name, order, outcome);
    client_give_back();
    return client_end(outcome);
}

/* Run an order on the simulated device: `start` (3,), and per tick of the order where the hand would
 * rest (m) and how it presses (N). `path`: where the device really was after each tick (m). With
 * `clock` it is pulled by the client's clock, as a device without a scheduler is. */
int client_simulated(const simulated_spec *spec, const double *start, const double *rest, const double *press,
                     double *path, int clock, const client_order *order, client_outcome *outcome) {
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

/* Forces on a device through HDAPI: on OpenHaptics, loaded when a run begins, or on the simulated device.
 *
 * The force of a scene of pandis.h, in metres and newtons of the device's workspace, passes the guard
 * and is sent at every call that the device's scheduler makes. On any error the force is zero from that
 * call on, and the run ends; so it does when calls come too late, when somebody interrupts the program, and
 * after the last tick. Unless the run is armed no force is ever sent: positions are read, and that is all.
 */
#define _GNU_SOURCE
#define PANDIS_IMPLEMENTATION
#include "../pandis.h"
#include "guard.h"
#include "hd.h"
#include "simulated.h"

#include <dlfcn.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

/* Ticks of zero force before a run lets go of the device; how often the watchdog looks (ns). */
#define RELEASE 5
#define LOOK 1000000

typedef struct {
    pandis_scene *scene;
    guard_limits limits;
    double period, deadline; /* s; a tick that computes longer is an overrun ... */
    int overruns;            /* ... and so many in a row end the run */
    double gap;              /* s; calls further apart, or a call that takes longer, end it */
    double patience;         /* s without a call, after which the watchdog ends it */
    double expected;         /* N: a device whose own limit is lower by a tenth is another; 0: any */
    int armed;
    long long ticks;
    double *positions, *forces, *taken, *since; /* per tick: m, N, s of computing, s since the last call */
} client_order;

typedef struct {
    int cause;
    unsigned int code; /* of the device, where that is the cause */
    int stand_in, simulated, hangs;
    long long ticks; /* so many were run */
    double worst;    /* J, see guard.h; of the simulated device by where it really was */
    double strongest, steepest, fastest;
    long long cut, slowed;
    double nominal_force, rate;
    char model[64], why[256];
} client_outcome;

/* Not on the stack, and with an order of its own: a callback that hangs may outlive its run. What the
 * order points to must live on then, and no other run may begin. */
static struct {
    const hd_api *api;
    client_order order;
    guard guard;
    unsigned int device, code;
    int overruns, released;
    double last;
    /* between the scheduler's thread and the one that waits */
    long long beat;
    int inside, finished, cancelled;
} client;

static volatile sig_atomic_t client_signal;

static void client_note_signal(int number) { client_signal = number; }

static double client_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void client_end(int cause) {
    if (!client.guard.cause) client.guard.cause = cause;
}

/* Take the device's errors from its list; the first one ends the run. */
static void client_errors(void) {
    for (int k = 0; k < 16; k++) {
        hd_error error = client.api->get_error();
        if (error.code == HD_SUCCESS) return;
        if (!client.guard.cause) client.code = error.code;
        client_end(CAUSE_ERROR);
    }
}

/* Forget errors of what went before, or comes after: no run is to blame for them. */
static void client_drain(const hd_api *api) {
    for (int k = 0; k < 64 && api->get_error().code != HD_SUCCESS; k++) continue;
}

/* What the device's scheduler calls at every tick. */
static unsigned int client_tick(void *data) {
    const client_order *order = &client.order;
    const int real = client.api->advance == NULL; /* in the time of ticks nothing is late */
    double begin = client_now(), position[3] = {(double)NAN, (double)NAN, (double)NAN}, force[3] = {0};
    long long tick = client.beat;
    (void)data;
    __atomic_store_n(&client.inside, 1, __ATOMIC_SEQ_CST);
    double since = tick ? begin - client.last : order->period;
    client.api->begin_frame(client.device);
    client.api->get_doubles(HD_CURRENT_POSITION, position);
    for (int k = 0; k < 3; k++) position[k] *= 1e-3;
    client_errors();
    int cancelled = __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    if (cancelled) client_end(cancelled);
    if (real && since > order->gap) client_end(CAUSE_GAP);
    if (!client.guard.cause && tick < order->ticks) pandis_scene_force(order->scene, position, force);
    double taken = client_now() - begin;
    client.overruns = real && taken > order->deadline ? client.overruns + 1 : 0;
    if (real && client.overruns >= order->overruns) client_end(CAUSE_OVERRUN);
    if (real && taken > order->gap) client_end(CAUSE_GAP);
    if (!order->armed) force[0] = force[1] = force[2] = 0;
    guard_pass(&client.guard, position, force); /* after the last tick it leads the force to zero */
    client.api->set_doubles(HD_CURRENT_FORCE, force);
    client.api->end_frame(client.device);
    client_errors();
    if (tick < order->ticks) {
        memcpy(order->positions + 3 * tick, position, sizeof position);
        memcpy(order->forces + 3 * tick, force, sizeof force);
        order->taken[tick] = taken, order->since[tick] = since;
    }
    client.last = begin;
    __atomic_store_n(&client.beat, tick + 1, __ATOMIC_SEQ_CST);
    /* the motors hold the last force: it is zero, whatever ends the run */
    if (client.guard.cause || (tick >= order->ticks && !(length_of(force) > 0))) client.released++;
    int finished = client.released >= RELEASE;
    __atomic_store_n(&client.inside, 0, __ATOMIC_SEQ_CST);
    if (finished) __atomic_store_n(&client.finished, 1, __ATOMIC_SEQ_CST);
    return finished ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

/* Wait until the run is over; end it when no call comes, one does not come back, or a signal does. */
static void client_wait(void) {
    const struct timespec look = {0, LOOK};
    long long seen = -1;
    double since = client_now();
    while (!__atomic_load_n(&client.finished, __ATOMIC_SEQ_CST)) {
        if (client.api->advance) {
            client.api->advance();
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

/* Ask the device what it is, and keep within what it allows; 0 if it is not the one that was expected. */
static int client_meet(client_outcome *outcome) {
    const hd_api *api = client.api;
    guard_limits *limits = &client.guard.limits;
    double number[3] = {0};
    const char *model = api->get_string(HD_DEVICE_MODEL_TYPE);
    snprintf(outcome->model, sizeof outcome->model, "%s", model ? model : "");
    api->get_doubles(HD_NOMINAL_MAX_FORCE, number);
    outcome->nominal_force = number[0];
    if (number[0] > 0) limits->force = fmin(limits->force, number[0]);
    number[0] = 0;
    api->get_doubles(HD_UPDATE_RATE, number);
    outcome->rate = number[0];
    number[0] = 0;
    api->get_doubles(HD_SOFTWARE_VELOCITY_LIMIT, number); /* mm/s */
    if (number[0] > 0) limits->speed = fmin(limits->speed, 1e-3 * number[0]);
    number[0] = 0;
    api->get_doubles(HD_SOFTWARE_FORCE_IMPULSE_LIMIT, number); /* N per ms */
    if (number[0] > 0) limits->step = fmin(limits->step, number[0] * client.order.period * 1e3);
    client_drain(api); /* an old device may not know all of these */
    if (client.order.expected > 0 && outcome->nominal_force > 0 && outcome->nominal_force < 0.9 * client.order.expected) {
        client_fail(outcome, CAUSE_DEVICE, "its largest force is that of another model: set hardware.attached.model");
        return 0;
    }
    if (outcome->rate > 0 && fabs(outcome->rate * client.order.period - 1) > 0.1) {
        client_fail(outcome, CAUSE_DEVICE, "it runs at another rate than was asked for");
        return 0;
    }
    return 1;
}

/* Run an order on a device: in HDAPI's order, and out again whatever happens. */
static int client_run(const hd_api *api, const char *name, const client_order *order, client_outcome *outcome) {
    if (__atomic_load_n(&client.inside, __ATOMIC_SEQ_CST))
        return client_fail(outcome, CAUSE_WATCHDOG, "the last run's callback has never come back: start anew");
    memset(&client, 0, sizeof client);
    client.api = api, client.order = *order;
    guard_start(&client.guard, &order->limits, order->period);
    client_drain(api);
    client.device = api->init_device(name && *name ? name : NULL);
    hd_error error = api->get_error();
    if (client.device == HD_INVALID_HANDLE || error.code != HD_SUCCESS) {
        outcome->code = error.code;
        if (client.device != HD_INVALID_HANDLE) api->disable_device(client.device);
        return client_fail(outcome, CAUSE_DEVICE, "the device cannot be initialised");
    }
    if (!client_meet(outcome)) {
        api->disable_device(client.device);
        return outcome->cause;
    }
    if (order->armed) api->enable(HD_FORCE_OUTPUT);
    else api->disable(HD_FORCE_OUTPUT);
    unsigned long task = api->schedule(client_tick, NULL, HD_PRIORITY);
    api->start();
    error = api->get_error();
    if (error.code == HD_SUCCESS) client_wait();
    else client.code = error.code, __atomic_store_n(&client.cancelled, CAUSE_DEVICE, __ATOMIC_SEQ_CST);
    api->disable(HD_FORCE_OUTPUT); /* first of all: whatever hangs, the motors are off */
    outcome->hangs = __atomic_load_n(&client.inside, __ATOMIC_SEQ_CST) &&
                     __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG;
    if (!outcome->hangs) { /* else stopping would wait for ever */
        api->stop();
        api->unschedule(task);
    }
    api->disable_device(client.device);
    client_drain(api);
    long long beat = __atomic_load_n(&client.beat, __ATOMIC_SEQ_CST);
    outcome->cause = client.guard.cause ? client.guard.cause : __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    outcome->code = client.code, outcome->ticks = beat < order->ticks ? beat : order->ticks;
    outcome->worst = api->advance ? simulated.energy.worst : client.guard.energy.worst;
    outcome->strongest = client.guard.strongest, outcome->steepest = client.guard.steepest;
    outcome->fastest = client.guard.fastest, outcome->cut = client.guard.cut, outcome->slowed = client.guard.slowed;
    return outcome->cause;
}

/* Run an order on OpenHaptics, or on what stands in for it: what such a library calls itself must say so.
 * While it runs SIGINT and SIGTERM end it with zero force, and are then given to whom they were meant for. */
int client_device(const char *library, const char *name, const client_order *order, client_outcome *outcome) {
    static const char *const names[] = {
        "hdInitDevice",   "hdDisableDevice", "hdEnable",    "hdDisable",   "hdBeginFrame",           "hdEndFrame",
        "hdGetDoublev",   "hdSetDoublev",    "hdGetString", "hdGetError",  "hdScheduleAsynchronous", "hdUnschedule",
        "hdStartScheduler", "hdStopScheduler",
    };
    static hd_api api; /* as the client, it may outlive its run */
    hd_api found;
    struct sigaction note, before[2];
    memset(&found, 0, sizeof found), memset(outcome, 0, sizeof *outcome), memset(&note, 0, sizeof note);
    void *held = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    if (!held) return client_fail(outcome, CAUSE_LIBRARY, dlerror());
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        void *function = dlsym(held, names[k]);
        if (!function) return client_fail(outcome, CAUSE_LIBRARY, dlerror());
        memcpy((char *)&found + k * sizeof function, &function, sizeof function); /* as POSIX has it */
    }
    api = found;
    outcome->stand_in = dlsym(held, "pandis_stand_in") != NULL;
    client_signal = 0, note.sa_handler = client_note_signal;
    sigaction(SIGINT, &note, before), sigaction(SIGTERM, &note, before + 1);
    int cause = client_run(&api, name, order, outcome);
    sigaction(SIGINT, before, NULL), sigaction(SIGTERM, before + 1, NULL);
    if (client_signal) raise(client_signal);
    return cause;
}

/* Run an order on the simulated device: `start` (3,), and per tick of the order where the hand would
 * rest (m) and how it presses (N). `path`: where the device really was after each tick (m). */
int client_simulated(const simulated_spec *spec, const double *start, const double *rest, const double *press,
                     double *path, const client_order *order, client_outcome *outcome) {
    memset(outcome, 0, sizeof *outcome);
    outcome->simulated = 1;
    simulated_prepare(spec, start, rest, press, order->ticks);
    simulated.path = path;
    return client_run(&simulated_api, NULL, order, outcome);
}

/* Forces on a device through HDAPI: on OpenHaptics, loaded when a run begins, or on the simulated device.
 *
 * The force of a scene of pandis.h, in metres and newtons of the device's workspace, passes the guard
 * and is sent at every call that the device's scheduler makes. On any error the force is zero, and the
 * run ends. Unless the run is armed no force is ever sent: positions are read, and that is all.
 */
#define _GNU_SOURCE
#define PANDIS_IMPLEMENTATION
#include "../pandis.h"
#include "guard.h"
#include "hd.h"
#include "simulated.h"

#include <dlfcn.h>
#include <stdio.h>
#include <time.h>

/* Ticks of zero force before a run that has failed lets go; how often the watchdog looks (s). */
#define RELEASE 5
#define LOOK 2000000

typedef struct {
    pandis_scene *scene;
    guard_limits limits;
    double period, deadline; /* s; a tick that computes longer is an overrun ... */
    int overruns;            /* ... and so many in a row end the run */
    double patience;         /* s without a call, after which the watchdog ends it */
    int armed;
    long long ticks;
    double *positions, *forces, *taken, *since; /* per tick: m, N, s of computing, s since the last call */
} client_order;

typedef struct {
    int cause;
    unsigned int code;      /* of the device, where that is the cause */
    int stand_in, simulated;
    long long ticks;        /* so many were run */
    double worst;           /* J, see guard.h; on the simulated device the exact one */
    double strongest, steepest, fastest;
    long long cut, slowed;
    double nominal_force, rate;
    char model[64], why[256];
} client_outcome;

typedef struct {
    const hd_api *api;
    const client_order *order;
    client_outcome *outcome;
    guard guard;
    unsigned int device;
    int overruns, releasing;
    double last;
    volatile long long beat;
    volatile int inside, finished, cancelled;
} client;

/* Not on the stack: a callback that hangs may outlive its run. Then no other may begin. */
static client the_client;

static double client_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Take the device's errors from its list; the first one ends the run. */
static void client_errors(client *c) {
    for (int k = 0; k < 16; k++) {
        hd_error error = c->api->get_error();
        if (error.code == HD_SUCCESS) return;
        if (!c->guard.cause) c->guard.cause = CAUSE_ERROR, c->outcome->code = error.code;
    }
}

/* What the device's scheduler calls at every tick. */
static unsigned int client_tick(void *data) {
    client *c = (client *)data;
    const client_order *order = c->order;
    double begin = client_now(), position[3] = {0}, force[3] = {0};
    long long tick = c->beat;
    c->inside = 1;
    c->api->begin_frame(c->device);
    c->api->get_doubles(HD_CURRENT_POSITION, position);
    for (int k = 0; k < 3; k++) position[k] *= 1e-3;
    if (c->cancelled && !c->guard.cause) c->guard.cause = CAUSE_WATCHDOG;
    if (!c->guard.cause && tick < order->ticks) pandis_scene_force(order->scene, position, force);
    double taken = client_now() - begin;
    c->overruns = taken > order->deadline ? c->overruns + 1 : 0;
    if (c->overruns >= order->overruns && !c->guard.cause) c->guard.cause = CAUSE_OVERRUN;
    guard_pass(&c->guard, position, force);
    c->api->set_doubles(HD_CURRENT_FORCE, order->armed ? force : (const double[3]){0, 0, 0});
    c->api->end_frame(c->device);
    client_errors(c);
    if (tick < order->ticks) {
        memcpy(order->positions + 3 * tick, position, sizeof position);
        for (int k = 0; k < 3; k++) order->forces[3 * tick + k] = order->armed ? force[k] : 0;
        order->taken[tick] = taken, order->since[tick] = tick ? begin - c->last : order->period;
    }
    c->last = begin;
    c->beat = tick + 1;
    if (c->guard.cause && ++c->releasing >= RELEASE) c->finished = 1;
    if (tick + 1 >= order->ticks) c->finished = 1;
    c->inside = 0;
    return c->finished ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

/* Wait until the run is over; when no call comes, or one does not come back, end it. */
static void client_wait(client *c) {
    const struct timespec look = {0, LOOK};
    long long seen = -1;
    double since = client_now();
    while (!c->finished) {
        if (c->api->advance) {
            c->api->advance();
            continue;
        }
        nanosleep(&look, NULL);
        if (c->beat != seen) seen = c->beat, since = client_now();
        if (client_now() - since < c->order->patience) continue;
        c->cancelled = 1;
        c->guard.cause = CAUSE_WATCHDOG;
        return;
    }
}

static int client_fail(client_outcome *outcome, int cause, const char *why) {
    outcome->cause = cause;
    snprintf(outcome->why, sizeof outcome->why, "%s", why);
    return cause;
}

/* Run an order on a device: in HDAPI's order, and out again whatever happens. */
static int client_run(const hd_api *api, const char *name, const client_order *order, client_outcome *outcome) {
    client *c = &the_client;
    if (c->inside) return client_fail(outcome, CAUSE_WATCHDOG, "the last run's callback has never come back");
    memset(c, 0, sizeof *c);
    c->api = api, c->order = order, c->outcome = outcome;
    guard_start(&c->guard, &order->limits, order->period);
    c->device = api->init_device(name && *name ? name : NULL);
    hd_error error = api->get_error();
    outcome->code = error.code;
    if (c->device == HD_INVALID_HANDLE || error.code != HD_SUCCESS) {
        if (c->device != HD_INVALID_HANDLE) api->disable_device(c->device);
        return client_fail(outcome, CAUSE_DEVICE, "the device cannot be initialised");
    }
    const char *model = api->get_string(HD_DEVICE_MODEL_TYPE);
    snprintf(outcome->model, sizeof outcome->model, "%s", model ? model : "");
    api->get_doubles(HD_NOMINAL_MAX_FORCE, &outcome->nominal_force);
    double rate[3] = {0};
    api->get_doubles(HD_UPDATE_RATE, rate);
    outcome->rate = rate[0];
    /* what the device itself gives as its limit counts where it is lower */
    if (outcome->nominal_force > 0 && outcome->nominal_force < c->guard.limits.force)
        c->guard.limits.force = outcome->nominal_force;
    if (order->armed) api->enable(HD_FORCE_OUTPUT);
    else api->disable(HD_FORCE_OUTPUT);
    unsigned long task = api->schedule(client_tick, c, HD_PRIORITY);
    api->start();
    error = api->get_error();
    if (error.code == HD_SUCCESS) client_wait(c);
    else c->guard.cause = CAUSE_DEVICE, outcome->code = error.code;
    api->disable(HD_FORCE_OUTPUT); /* first of all: whatever hangs, the motors are off */
    api->stop();
    api->unschedule(task);
    api->disable_device(c->device);
    outcome->cause = c->guard.cause, outcome->ticks = c->beat < order->ticks ? c->beat : order->ticks;
    outcome->worst = api->advance ? simulated.worst : c->guard.worst;
    outcome->strongest = c->guard.strongest, outcome->steepest = c->guard.steepest, outcome->fastest = c->guard.fastest;
    outcome->cut = c->guard.cut, outcome->slowed = c->guard.slowed;
    return outcome->cause;
}

/* Run an order on OpenHaptics, or on what stands in for it: what such a library calls itself must say so. */
int client_device(const char *library, const char *name, const client_order *order, client_outcome *outcome) {
    static const char *const names[] = {
        "hdInitDevice",   "hdDisableDevice", "hdEnable",    "hdDisable",   "hdBeginFrame",           "hdEndFrame",
        "hdGetDoublev",   "hdSetDoublev",    "hdGetString", "hdGetError",  "hdScheduleAsynchronous", "hdUnschedule",
        "hdStartScheduler", "hdStopScheduler",
    };
    hd_api api;
    memset(&api, 0, sizeof api), memset(outcome, 0, sizeof *outcome);
    void *held = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    if (!held) return client_fail(outcome, CAUSE_LIBRARY, dlerror());
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        void *function = dlsym(held, names[k]);
        if (!function) return client_fail(outcome, CAUSE_LIBRARY, dlerror());
        memcpy((char *)&api + k * sizeof function, &function, sizeof function); /* as POSIX has it */
    }
    outcome->stand_in = dlsym(held, "pandis_stand_in") != NULL;
    return client_run(&api, name, order, outcome);
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

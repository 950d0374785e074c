/* A stand-in for OpenHaptics' libHD: its functions over a simulated device, on a thread of its own at
 * 1 kHz. It faults as PANDIS_FAULT says:
 *
 *     init            there is no device
 *     start           the scheduler does not start
 *     error N CODE    the device reports CODE at tick N
 *     unplugged N     from tick N on no more calls are made, and nothing is reported
 *     slow N          the clock stands still for 30 ms within the callback at tick N
 *     hang N          the callback does not come back from tick N for a second and a half
 *     apart N         from tick N on calls are 60 ms apart
 *     raise N         somebody presses Ctrl-C at tick N
 *     weak            it says that it is a device of 1 N
 *     fast            it says that it runs at 4 kHz
 *     nan N           from tick N on positions are no numbers
 *     jump N          at tick N the position jumps by 5 cm
 */
#define _GNU_SOURCE
#include "simulated.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* What tells a stand-in from a device. */
#ifndef UNMARKED
int pandis_stand_in = 1;
#endif

/* For the tests: how often frames were begun and ended, the forces that reached the motors. */
struct { long long begun, ended, calls, enabled, disabled; double largest, sum[3], last[3]; } standin_seen;

static char fault[16];
static long long fault_tick = -1;
static unsigned int fault_code;
static pthread_t thread;
static int threaded;
static volatile int stopping;
static double hand[3];

static int faulty(const char *name) {
    return !strcmp(fault, name) && (fault_tick < 0 || simulated.tick >= fault_tick);
}

unsigned int hdInitDevice(const char *name) {
    static const double press[3] = {0, 0, 0};
    static const simulated_spec touch = {0.045, 0.1, 0.26, 55e-6, 3.3, 3.3, 1.5, 20, 3, 1e-3, 400, 0};
    double start[3] = {0, 0, 0};
    const char *text = getenv("PANDIS_FAULT"), *place = getenv("PANDIS_PLACE");
    memset(&standin_seen, 0, sizeof standin_seen);
    *fault = 0, fault_tick = -1, fault_code = 0;
    if (text) sscanf(text, "%15s %lld %x", fault, &fault_tick, &fault_code);
    if (place) sscanf(place, "%lf %lf %lf", start, start + 1, start + 2);
    memcpy(hand, start, sizeof hand);
    /* errors that nobody has asked for stay in the list */
    unsigned int error[SIMULATED_ERRORS];
    int errors = simulated.errors;
    memcpy(error, simulated.error, sizeof error);
    simulated_prepare(&touch, start, hand, press, 1);
    memcpy(simulated.error, error, sizeof error), simulated.errors = errors;
    if (faulty("init") || (name && strcmp(name, "Default Device"))) {
        simulated_report(HD_DEVICE_FAULT);
        return HD_INVALID_HANDLE;
    }
    return simulated_init(name);
}

void hdDisableDevice(unsigned int device) { simulated_disable_device(device); }

void hdEnable(unsigned int what) {
    standin_seen.enabled += what == HD_FORCE_OUTPUT;
    simulated_enable(what);
}

void hdDisable(unsigned int what) {
    standin_seen.disabled += what == HD_FORCE_OUTPUT;
    simulated_disable(what);
}

void hdBeginFrame(unsigned int device) {
    standin_seen.begun++;
    if (faulty("error") && simulated.tick == fault_tick) simulated_report(fault_code);
    simulated_begin(device);
}

void hdEndFrame(unsigned int device) {
    standin_seen.ended++;
    simulated_end(device);
    double size = length_of(simulated.sent);
    if (size > standin_seen.largest) standin_seen.largest = size;
    for (int k = 0; k < 3; k++) standin_seen.sum[k] += simulated.sent[k], standin_seen.last[k] = simulated.sent[k];
}

void hdGetDoublev(unsigned int what, double *values) {
    simulated_get(what, values);
    if (what == HD_NOMINAL_MAX_FORCE && faulty("weak")) *values = 1;
    if (what == HD_UPDATE_RATE && faulty("fast")) *values = 4000;
    if (what != HD_CURRENT_POSITION) return;
    if (faulty("nan")) values[1] = values[1] * 0 / 0.0;
    if (faulty("jump")) values[0] += 50;
    if (faulty("raise") && simulated.tick == fault_tick) raise(SIGINT);
    if (faulty("hang") && simulated.tick == fault_tick) {
        const struct timespec pause = {1, 500000000};
        nanosleep(&pause, NULL);
    }
    if (faulty("slow") && simulated.tick == fault_tick) {
        const struct timespec pause = {0, 30000000};
        nanosleep(&pause, NULL);
    }
}

void hdSetDoublev(unsigned int what, const double *values) { simulated_set(what, values); }

const char *hdGetString(unsigned int what) {
    return what == HD_DEVICE_MODEL_TYPE ? "stand-in" : simulated_string(what);
}

hd_error hdGetError(void) { return simulated_error(); }

unsigned long hdScheduleAsynchronous(hd_callback callback, void *data, unsigned short priority) {
    return simulated_schedule(callback, data, priority);
}

void hdUnschedule(unsigned long handle) { simulated_unschedule(handle); }

static void *loop(void *none) {
    struct timespec due;
    (void)none;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (!stopping) {
        due.tv_nsec += 1000000;
        if (due.tv_nsec >= 1000000000) due.tv_nsec -= 1000000000, due.tv_sec++;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        if (faulty("unplugged")) continue;
        if (faulty("apart")) {
            const struct timespec pause = {0, 60000000};
            nanosleep(&pause, NULL);
        }
        if (simulated.scheduled) standin_seen.calls++;
        simulated_advance();
    }
    return NULL;
}

void hdStartScheduler(void) {
    if (faulty("start")) {
        simulated_report(HD_TIMER_ERROR);
        return;
    }
    simulated_start();
    stopping = 0, threaded = !pthread_create(&thread, NULL, loop, NULL);
}

void hdStopScheduler(void) {
    stopping = 1;
    if (threaded) pthread_join(thread, NULL);
    threaded = 0;
    simulated_stop();
}

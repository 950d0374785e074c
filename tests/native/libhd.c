/* A stand-in for OpenHaptics' libHD: its functions over a simulated device, on a thread of its own
 * at 1 kHz. It faults as PANDIS_FAULT says:
 *
 *     init            there is no device
 *     nothing         there is none, and it says nothing of it
 *     doubtful        it opens the device, and reports errors of that
 *     start           the scheduler does not start
 *     error N CODE    the device reports CODE at tick N
 *     ending N CODE   the device reports CODE at the end of tick N's frame, and calls no more
 *     unplugged N     from tick N on no more calls are made, and nothing is reported
 *     slow N          the clock stands still for 30 ms within the callback at tick N
 *     hang N          the callback does not come back from tick N for a second and a half
 *     apart N         from tick N on calls are 60 ms apart
 *     raise N [CODE]  the process gets a signal in the callback of tick N; without a number
 * (hexadecimal) Ctrl-C frozen N        from tick N on positions stay as they are, though the hand
 * lifts off at 0.1 m/s creep N CODE    from tick N on positions creep along -x, by so many
 * micrometres (hexadecimal) a tick weak            it says that it is a device of 1 N fast it says
 * that it runs at 4 kHz nan N           from tick N on positions are no numbers jump N          at
 * tick N the position jumps by 5 cm uncalibrated N  from tick N on it is not calibrated; N -1: from
 * the beginning update          its calibration wants to be updated released N      from tick N on
 * no button is held open N          from tick N on its safety switch is open; N -1: from the
 * beginning hot N           from tick N on a motor is hot burning N       from tick N on a motor's
 * temperature is no number aside           its workspace lies 3 cm to the right tired           it
 * stands 0.2 N for long skip N          at tick N the call comes ten ticks late, and the probe has
 * moved on late N          from tick N on a force acts eight ticks later: walls come alive
 *
 * What the motors were given last, whether they are on, and when (s) that was written, is in the
 * file that PANDIS_RECORD names: it outlives the process. Only one process has the device, unless
 * PANDIS_SHARED is set: then several have, each may switch its motors off, and the record is the
 * device's state.
 */
#define _GNU_SOURCE
#include "simulated.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

/* What tells a stand-in from a device. */
#ifndef UNMARKED
int pandis_stand_in = 1;
#endif

/* For the tests: how often frames were begun and ended, the forces that reached the motors. */
struct {
    long long begun, ended, calls, enabled, disabled;
    double largest, sum[3], last[3];
} standin_seen;

static char fault[16];
static long long fault_tick = -1;
static unsigned int fault_code;
static pthread_t thread;
static int threaded;
static volatile int stopping;
static double hand[3];

/* Keep what a process that dies leaves behind: the largest force, the last one, and whether the
 * motors are on. */
static int record = -1, owned = -1, shared;

static void keep(void) {
    struct timespec now;
    double before[4],
        kept[4] = {standin_seen.largest, length_of(standin_seen.last), simulated.output, 0};
    clock_gettime(CLOCK_MONOTONIC, &now);
    kept[3] = (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
    if (shared && pread(record, before, sizeof before, 0) == sizeof before && before[0] > kept[0])
        kept[0] = before[0];
    if (record >= 0 && pwrite(record, kept, sizeof kept, 0) < 0) abort();
}

/* Whether another process has switched the motors off. */
static int switched_off(void) {
    double state[4];
    return shared && pread(record, state, sizeof state, 0) == sizeof state && !(state[2] > 0);
}

/* Have the device for this process alone, whoever else has loaded this library; or share it. */
static int own(void) {
    Dl_info self;
    shared = getenv("PANDIS_SHARED") != NULL;
    if (shared || owned >= 0) return 1;
    if (!dladdr((void *)&standin_seen, &self)) return 0;
    owned = open(self.dli_fname, O_RDONLY | O_CLOEXEC);
    if (owned >= 0 && !flock(owned, LOCK_EX | LOCK_NB)) return 1;
    if (owned >= 0) close(owned);
    owned = -1;
    return 0;
}

static int faulty(const char *name) {
    return !strcmp(fault, name) && (fault_tick < 0 || simulated.tick >= fault_tick);
}

/* What HDAPI knows of frames. */
static int initialised, framed, frames, scheduled;
static double pending[3];
static hd_callback callback;
static void *callback_data;

unsigned int hdInitDevice(const char *name) {
    static const double press[3] = {0, 0, 0};
    simulated_spec touch = {0.045, 0.1, 0.26, 55e-6, 3.3, 3.3, 1.5, 20, 3, 1e-3, 400, 0};
    double start[3] = {0, 0, 0}, rest[3] = {0, 0, 0};
    const char *text = getenv("PANDIS_FAULT"), *place = getenv("PANDIS_PLACE"),
               *kind = getenv("PANDIS_STANDIN");
    memset(&standin_seen, 0, sizeof standin_seen);
    *fault = 0, fault_tick = -1, fault_code = 0;
    if (record < 0 && getenv("PANDIS_RECORD"))
        record = open(getenv("PANDIS_RECORD"), O_CREAT | O_RDWR | O_CLOEXEC, 0600);
    if (text) sscanf(text, "%15s %lld %x", fault, &fault_tick, &fault_code);
    if (place) sscanf(place, "%lf %lf %lf", start, start + 1, start + 2);
    memcpy(rest, start, sizeof rest);
    /* the hand, and how lively the device is: stiffness, damping, resting place along x; damping,
     * friction */
    if (kind)
        sscanf(kind, "%lf %lf %lf %lf %lf", &touch.hand_stiffness, &touch.hand_damping, rest,
            &touch.damping, &touch.friction);
    memcpy(hand, rest, sizeof hand);
    /* errors that nobody has asked for stay in the list */
    unsigned int error[SIMULATED_ERRORS];
    int errors = simulated.errors;
    memcpy(error, simulated.error, sizeof error);
    simulated_prepare(&touch, start, hand, press, 1);
    memcpy(simulated.error, error, sizeof error), simulated.errors = errors;
    framed = frames = scheduled = 0;
    if (faulty("init") || faulty("nothing") || (name && strcmp(name, "Default Device"))) {
        if (!faulty("nothing")) simulated_report(HD_DEVICE_FAULT);
        return HD_INVALID_HANDLE;
    }
    if (faulty("doubtful")) simulated_report(HD_COMM_ERROR), simulated_report(HD_DEVICE_FAULT);
    if (initialised || !own()) {
        simulated_report(HD_INVALID_OPERATION);
        return HD_INVALID_HANDLE;
    }
    initialised = 1;
    return 0;
}

static int is_ours(unsigned int device) {
    if (initialised && device == 0) return 1;
    simulated_report(HD_BAD_HANDLE);
    return 0;
}

void hdDisableDevice(unsigned int device) {
    if (!is_ours(device)) return;
    initialised = simulated.output = 0;
    if (owned >= 0) close(owned);
    owned = -1;
}

void hdEnable(unsigned int what) {
    standin_seen.enabled += what == HD_FORCE_OUTPUT;
    if (what == HD_FORCE_OUTPUT && is_ours(0)) simulated.output = 1;
    keep();
}

void hdDisable(unsigned int what) {
    standin_seen.disabled += what == HD_FORCE_OUTPUT;
    if (what != HD_FORCE_OUTPUT || !is_ours(0)) return;
    simulated.output = 0; /* the motors are off */
    for (int k = 0; k < 3; k++) simulated.sent[k] = standin_seen.last[k] = 0;
    keep();
}

void hdBeginFrame(unsigned int device) {
    standin_seen.begun++;
    if (faulty("error") && simulated.tick == fault_tick) simulated_report(fault_code);
    if (!is_ours(device)) return;
    if (framed) simulated_report(HD_ILLEGAL_BEGIN);
    else if (frames++) simulated_report(HD_FRAME_ERROR); /* one frame a tick */
    framed = 1;
    memset(pending, 0, sizeof pending);
}

void hdEndFrame(unsigned int device) {
    standin_seen.ended++;
    if (!is_ours(device)) return;
    if (switched_off()) simulated.output = 0;
    if (!framed) simulated_report(HD_ILLEGAL_END);
    else simulated_accept(pending);
    if (faulty("ending") && simulated.tick == fault_tick) simulated_report(fault_code);
    framed = 0;
    double size = length_of(simulated.sent);
    if (size > standin_seen.largest) standin_seen.largest = size;
    for (int k = 0; k < 3; k++)
        standin_seen.sum[k] += simulated.sent[k], standin_seen.last[k] = simulated.sent[k];
    keep();
}

unsigned int hdCheckCalibration(void) {
    if (faulty("update")) return HD_CALIBRATION_NEEDS_UPDATE;
    return faulty("uncalibrated") ? HD_CALIBRATION_NEEDS_MANUAL_INPUT : HD_CALIBRATION_OK;
}

void hdGetIntegerv(unsigned int what, int *values) {
    if (what == HD_CURRENT_BUTTONS) *values = !faulty("released");
}

void hdGetBooleanv(unsigned int what, unsigned char *values) {
    if (faulty("mute")) simulated_report(HD_INVALID_ENUM);
    else if (what == HD_CURRENT_SAFETY_SWITCH) *values = !faulty("open");
}

/* What a position is delayed or spoilt by. */
static void spoil(double *values) {
    const struct timespec hang = {1, 500000000}, slow = {0, 30000000};
    if (faulty("nan")) values[1] = values[1] * 0 / 0.0;
    if (faulty("jump")) values[0] += 50;
    if (faulty("raise") && simulated.tick == fault_tick)
        raise(fault_code ? (int)fault_code : SIGINT);
    static double stuck[3];
    if (!faulty("frozen")) memcpy(stuck, values, sizeof stuck);
    else memcpy(values, stuck, sizeof stuck), hand[0] += 1e-4;
    if (faulty("creep")) values[0] -= 1e-3 * fault_code * (double)(simulated.tick - fault_tick);
    if (faulty("hang") && simulated.tick == fault_tick) nanosleep(&hang, NULL);
    if (faulty("slow") && simulated.tick == fault_tick) nanosleep(&slow, NULL);
}

void hdGetDoublev(unsigned int what, double *values) {
    device_spec spec;
    double place[3];
    simulated_tell(&spec);
    simulated_place(place);
    int moves =
        what == HD_CURRENT_POSITION || what == HD_CURRENT_VELOCITY || what == HD_CURRENT_TRANSFORM;
    if (faulty("mute") && !moves) what = 0; /* it knows nothing of itself */
    switch (what) {
    case HD_NOMINAL_MAX_FORCE: *values = faulty("weak") ? 1 : spec.force; break;
    case HD_NOMINAL_MAX_CONTINUOUS_FORCE: *values = faulty("tired") ? 0.2 : 0.88; break;
    case HD_SOFTWARE_VELOCITY_LIMIT: *values = 1e3 * spec.speed; break;
    case HD_SOFTWARE_FORCE_IMPULSE_LIMIT: *values = spec.impulse; break;
    case HD_UPDATE_RATE: *values = faulty("fast") ? 4000 : spec.rate; break;
    case HD_USABLE_WORKSPACE_DIMENSIONS:
        for (int k = 0; k < 3; k++) values[k] = -80, values[k + 3] = 80;
        if (faulty("aside")) values[0] += 30, values[3] += 30;
        break;
    case HD_MOTOR_TEMPERATURE:
        for (int k = 0; k < 3; k++) values[k] = 0.3;
        if (faulty("hot")) values[2] = 0.95;
        if (faulty("burning")) values[1] = values[1] * 0 / 0.0;
        break;
    case HD_CURRENT_POSITION:
        for (int k = 0; k < 3; k++) values[k] = 1e3 * place[k];
        spoil(values);
        break;
    case HD_CURRENT_VELOCITY:
        for (int k = 0; k < 3; k++) values[k] = 1e3 * simulated.speed[k];
        break;
    case HD_CURRENT_TRANSFORM:
        for (int k = 0; k < 16; k++) values[k] = k % 5 == 0;
        for (int k = 0; k < 3; k++) values[12 + k] = 1e3 * place[k];
        break;
    case HD_CURRENT_FORCE: memcpy(values, simulated.sent, sizeof simulated.sent); break;
    default: simulated_report(HD_INVALID_ENUM);
    }
}

void hdSetDoublev(unsigned int what, const double *values) {
    if (what != HD_CURRENT_FORCE) return;
    if (!framed) simulated_report(HD_INVALID_OPERATION);
    else memcpy(pending, values, sizeof pending);
}

const char *hdGetString(unsigned int what) {
    return faulty("mute") ? NULL : what == HD_DEVICE_MODEL_TYPE ? "stand-in" : "";
}

hd_error hdGetError(void) {
    hd_error found = {simulated_take_error(), 0, 0};
    return found;
}

unsigned long hdScheduleAsynchronous(hd_callback own, void *data, unsigned short priority) {
    (void)priority;
    callback = own, callback_data = data, scheduled = 1;
    return 1;
}

void hdUnschedule(unsigned long handle) {
    /* it has ended by itself */
    if (handle != 1 || !scheduled) simulated_report(HD_INVALID_OPERATION);
    scheduled = 0;
}

static void *loop(void *none) {
    struct timespec due;
    (void)none;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (!stopping) {
        due.tv_nsec += 1000000;
        if (due.tv_nsec >= 1000000000) due.tv_nsec -= 1000000000, due.tv_sec++;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        if (faulty("unplugged") || (faulty("ending") && simulated.tick > fault_tick)) continue;
        if (faulty("apart")) {
            const struct timespec pause = {0, 60000000};
            nanosleep(&pause, NULL);
        }
        if (faulty("skip") && simulated.tick == fault_tick) {
            const struct timespec pause = {0, 10000000};
            nanosleep(&pause, NULL);
            for (int k = 0; k < 10; k++) simulated_advance();
            clock_gettime(CLOCK_MONOTONIC, &due);
        }
        if (faulty("late") && simulated.spec.delay < 8) simulated.spec.delay = 8;
        standin_seen.calls += scheduled;
        frames = 0;
        if (scheduled && callback(callback_data) == HD_CALLBACK_DONE) scheduled = 0;
        simulated_advance();
    }
    return NULL;
}

void hdStartScheduler(void) {
    if (faulty("start")) {
        simulated_report(HD_TIMER_ERROR);
        return;
    }
    stopping = 0, threaded = !pthread_create(&thread, NULL, loop, NULL);
}

void hdStopScheduler(void) {
    stopping = 1;
    if (threaded) pthread_join(thread, NULL);
    threaded = 0;
}

/* OpenHaptics' HDAPI 3 as a device: its constants, a table of its functions (so that the library
 * and its stand-in are interchangeable), and the driver.
 *
 * HDAPI uses millimetres, mm/s and newtons; +x points right, +y up, +z towards the user.
 */
#ifndef HD_H
#define HD_H

#include "device.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum {
    HD_SUCCESS = 0x0000,
    HD_INVALID_ENUM = 0x0100,
    HD_INVALID_OPERATION = 0x0102,
    HD_BAD_HANDLE = 0x0104,
    HD_WARM_MOTORS = 0x0200,
    HD_EXCEEDED_MAX_FORCE = 0x0201,
    HD_EXCEEDED_MAX_FORCE_IMPULSE = 0x0202,
    HD_EXCEEDED_MAX_VELOCITY = 0x0203,
    HD_FORCE_ERROR = 0x0204,
    HD_DEVICE_FAULT = 0x0300,
    HD_COMM_ERROR = 0x0302,
    HD_TIMER_ERROR = 0x0304,
    HD_ILLEGAL_BEGIN = 0x0400,
    HD_ILLEGAL_END = 0x0401,
    HD_FRAME_ERROR = 0x0402,

    HD_CURRENT_BUTTONS = 0x2000,
    HD_CURRENT_SAFETY_SWITCH = 0x2001,
    HD_CURRENT_POSITION = 0x2050,
    HD_CURRENT_VELOCITY = 0x2051,
    HD_CURRENT_TRANSFORM = 0x2052,
    HD_DEVICE_MODEL_TYPE = 0x2501,
    HD_USABLE_WORKSPACE_DIMENSIONS = 0x2551,
    HD_UPDATE_RATE = 0x2600,
    HD_NOMINAL_MAX_FORCE = 0x2603,
    HD_NOMINAL_MAX_CONTINUOUS_FORCE = 0x2604,
    HD_MOTOR_TEMPERATURE = 0x2605,
    HD_SOFTWARE_VELOCITY_LIMIT = 0x2606,
    HD_SOFTWARE_FORCE_IMPULSE_LIMIT = 0x2607,
    HD_CURRENT_FORCE = 0x2700,
    HD_CURRENT_TORQUE = 0x2701,
    HD_FORCE_OUTPUT = 0x4000,
    HD_CALIBRATION_OK = 0x5000,
    HD_CALIBRATION_NEEDS_UPDATE = 0x5001,
    HD_CALIBRATION_NEEDS_MANUAL_INPUT = 0x5002
};

#define HD_CALLBACK_DONE 0u
#define HD_CALLBACK_CONTINUE 1u
#define HD_INVALID_HANDLE 0xFFFFFFFFu
#define HD_PRIORITY 65535 /* the highest: no other callback may run first */
#define HD_MOTORS 8
/* bytes of room for a boolean, which has one byte or four, depending on the version */
#define HD_BOOLEAN 8

typedef struct {
    unsigned int code;
    int internal;
    unsigned int device;
} hd_error;

typedef unsigned int (*hd_callback)(void *data);

/* The functions of the library. */
typedef struct {
    unsigned int (*init_device)(const char *name);
    void (*disable_device)(unsigned int device);
    void (*enable)(unsigned int what);
    void (*disable)(unsigned int what);
    void (*begin_frame)(unsigned int device);
    void (*end_frame)(unsigned int device);
    void (*get_doubles)(unsigned int what, double *values);
    void (*get_integers)(unsigned int what, int *values);
    void (*get_booleans)(unsigned int what, unsigned char *values);
    void (*set_doubles)(unsigned int what, const double *values);
    const char *(*get_string)(unsigned int what);
    hd_error (*get_error)(void);
    unsigned int (*check_calibration)(void);
    unsigned long (*schedule)(hd_callback callback, void *data, unsigned short priority);
    void (*unschedule)(unsigned long handle);
    void (*start)(void);
    void (*stop)(void);
} hd_api;

/* Names of the library's functions, and their offsets in the table. */
static const struct {
    size_t at;
    const char *name;
} hd_functions[] = {
    {offsetof(hd_api, init_device), "hdInitDevice"},
    {offsetof(hd_api, disable_device), "hdDisableDevice"},
    {offsetof(hd_api, enable), "hdEnable"},
    {offsetof(hd_api, disable), "hdDisable"},
    {offsetof(hd_api, begin_frame), "hdBeginFrame"},
    {offsetof(hd_api, end_frame), "hdEndFrame"},
    {offsetof(hd_api, get_doubles), "hdGetDoublev"},
    {offsetof(hd_api, get_integers), "hdGetIntegerv"},
    {offsetof(hd_api, get_booleans), "hdGetBooleanv"},
    {offsetof(hd_api, set_doubles), "hdSetDoublev"},
    {offsetof(hd_api, get_string), "hdGetString"},
    {offsetof(hd_api, get_error), "hdGetError"},
    {offsetof(hd_api, check_calibration), "hdCheckCalibration"},
    {offsetof(hd_api, schedule), "hdScheduleAsynchronous"},
    {offsetof(hd_api, unschedule), "hdUnschedule"},
    {offsetof(hd_api, start), "hdStartScheduler"},
    {offsetof(hd_api, stop), "hdStopScheduler"},
};

/* Static because, like the client, it may outlive its run. */
static struct {
    hd_api api;
    unsigned int device;
    /* whether this device reports its motors' temperatures, and a safety switch */
    int heat, safety;
    unsigned long task;
    device_tick tick;
    void *data;
} hd;

/* Read and discard all pending errors. Returns the first. */
static unsigned int hd_drain(void) {
    unsigned int first = HD_SUCCESS;
    for (int k = 0; k < 64; k++) {
        hd_error error = hd.api.get_error();
        if (error.code == HD_SUCCESS) break;
        if (!first) first = error.code;
    }
    return first;
}

/* Whether a safety switch is closed, whatever the size of the library's booleans. */
static int hd_closed(const unsigned char *safety) {
    int any = 0;
    for (int k = 0; k < HD_BOOLEAN; k++) any |= safety[k];
    return any != 0;
}

/* Read `count` numbers; returns 0 if the device does not report them. */
static int hd_ask(unsigned int what, double *values, int count) {
    for (int k = 0; k < count; k++) values[k] = 0;
    hd.api.get_doubles(what, values);
    return hd_drain() == HD_SUCCESS;
}

static unsigned int hd_open(device *self, const char *name, device_spec *spec) {
    double number, box[6];
    unsigned char safety[HD_BOOLEAN] = {0};
    (void)self;
    hd_drain();
    hd.device = hd.api.init_device(name && *name ? name : NULL);
    unsigned int code = hd_drain();
    if (hd.device == HD_INVALID_HANDLE || code) {
        if (hd.device != HD_INVALID_HANDLE) hd.api.disable_device(hd.device);
        return code ? code : HD_DEVICE_FAULT;
    }
    const char *model = hd.api.get_string(HD_DEVICE_MODEL_TYPE);
    snprintf(spec->model, sizeof spec->model, "%s", model ? model : "");
    if (hd_ask(HD_NOMINAL_MAX_FORCE, &number, 1)) spec->force = number;
    if (hd_ask(HD_NOMINAL_MAX_CONTINUOUS_FORCE, &number, 1)) spec->continuous = number;
    if (hd_ask(HD_SOFTWARE_VELOCITY_LIMIT, &number, 1)) spec->speed = 1e-3 * number;
    if (hd_ask(HD_SOFTWARE_FORCE_IMPULSE_LIMIT, &number, 1)) spec->impulse = number;
    if (hd_ask(HD_UPDATE_RATE, &number, 1)) spec->rate = number;
    if (hd_ask(HD_USABLE_WORKSPACE_DIMENSIONS, box, 6))
        for (int k = 0; k < 3; k++) spec->low[k] = 1e-3 * box[k], spec->high[k] = 1e-3 * box[k + 3];
    double heat[HD_MOTORS];
    hd.heat = hd_ask(HD_MOTOR_TEMPERATURE, heat, HD_MOTORS);
    hd.api.get_booleans(HD_CURRENT_SAFETY_SWITCH, safety);
    hd.safety = hd_drain() == HD_SUCCESS;
    /* a device without a switch also reports an open one */
    spec->has_switch = hd.safety && hd_closed(safety);
    return 0;
}

static int hd_calibrated(device *self) {
    (void)self;
    unsigned int found = hd.api.check_calibration();
    if (found == HD_CALIBRATION_OK) return DEVICE_CALIBRATED;
    return found == HD_CALIBRATION_NEEDS_UPDATE ? DEVICE_NEEDS_UPDATE : DEVICE_NEEDS_MANUAL;
}

/* Begin a frame and read the state; hd_write ends the frame. */
static void hd_read(device *self, device_state *state) {
    double heat[HD_MOTORS] = {0}, place[16] = {0};
    int buttons[2] = {0};
    unsigned char safety[HD_BOOLEAN] = {0};
    (void)self;
    memset(state, 0, sizeof *state);
    for (int k = 0; k < 3; k++) state->position[k] = (double)NAN;
    hd.api.begin_frame(hd.device);
    hd.api.get_doubles(HD_CURRENT_POSITION, state->position);
    hd.api.get_doubles(HD_CURRENT_VELOCITY, state->velocity);
    hd.api.get_doubles(HD_CURRENT_TRANSFORM, place); /* column by column */
    hd.api.get_integers(HD_CURRENT_BUTTONS, buttons);
    if (hd.heat) hd.api.get_doubles(HD_MOTOR_TEMPERATURE, heat);
    if (hd.safety) hd.api.get_booleans(HD_CURRENT_SAFETY_SWITCH, safety);
    for (int k = 0; k < 3; k++) {
        state->position[k] *= 1e-3, state->velocity[k] *= 1e-3;
        for (int i = 0; i < 3; i++) state->rotation[3 * i + k] = place[4 * k + i];
    }
    for (int k = 0; k < HD_MOTORS; k++) /* NaN stays */
        if (isnan(heat[k]) || heat[k] > state->temperature) state->temperature = heat[k];
    state->buttons = (unsigned int)buttons[0];
    state->safe = hd_closed(safety);
    state->time = (double)NAN;
}

static void hd_write(device *self, const double *force, const double *torque) {
    (void)self;
    hd.api.set_doubles(HD_CURRENT_FORCE, force);
    if (torque) hd.api.set_doubles(HD_CURRENT_TORQUE, torque);
    hd.api.end_frame(hd.device);
}

static unsigned int hd_next_error(device *self) {
    (void)self;
    return hd.api.get_error().code;
}

static void hd_output(device *self, int on) {
    (void)self;
    if (on) hd.api.enable(HD_FORCE_OUTPUT);
    else hd.api.disable(HD_FORCE_OUTPUT);
}

static unsigned int hd_call(void *data) {
    (void)data;
    return hd.tick(hd.data) ? HD_CALLBACK_CONTINUE : HD_CALLBACK_DONE;
}

static unsigned int hd_start(device *self, device_tick tick, void *data) {
    (void)self;
    hd.tick = tick, hd.data = data;
    hd.task = hd.api.schedule(hd_call, NULL, HD_PRIORITY);
    hd.api.start();
    return hd.api.get_error().code;
}

static void hd_stop(device *self) {
    (void)self;
    hd.api.stop();
    hd.api.unschedule(hd.task);
}

static void hd_close(device *self) {
    (void)self;
    hd.api.disable_device(hd.device);
    hd_drain();
}

/* Fill in the device for a table of functions. */
static void hd_device(const hd_api *api, device *made) {
    static const device verbs = {hd_open, hd_calibrated, hd_read, hd_write, hd_next_error,
        hd_output, hd_start, hd_stop, NULL, hd_close, NULL};
    memset(&hd, 0, sizeof hd);
    hd.api = *api;
    *made = verbs;
}

#endif

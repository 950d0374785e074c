/* What is used of OpenHaptics' HDAPI 3: its numbers, and its functions as a table, so that the same
 * client runs on the library, on a stand-in for it, and on the simulated device.
 *
 * Lengths are millimetres, speeds mm/s, forces newtons; +x to the right, +y up, +z to the user.
 */
#ifndef HD_H
#define HD_H

enum {
    HD_SUCCESS = 0x0000,
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

    HD_CURRENT_POSITION = 0x2050,
    HD_CURRENT_VELOCITY = 0x2051,
    HD_DEVICE_MODEL_TYPE = 0x2501,
    HD_UPDATE_RATE = 0x2600,
    HD_NOMINAL_MAX_FORCE = 0x2603,
    HD_SOFTWARE_VELOCITY_LIMIT = 0x2606,
    HD_SOFTWARE_FORCE_IMPULSE_LIMIT = 0x2607,
    HD_CURRENT_FORCE = 0x2700,
    HD_FORCE_OUTPUT = 0x4000
};

#define HD_CALLBACK_DONE 0u
#define HD_CALLBACK_CONTINUE 1u
#define HD_INVALID_HANDLE 0xFFFFFFFFu
#define HD_PRIORITY 65535 /* the highest: nothing else is to come first */

typedef struct {
    unsigned int code;
    int internal;
    unsigned int device;
} hd_error;

typedef unsigned int (*hd_callback)(void *data);

/* In this order they stand in the table, and in the list of names in client.c. */
typedef struct {
    unsigned int (*init_device)(const char *name);
    void (*disable_device)(unsigned int device);
    void (*enable)(unsigned int what);
    void (*disable)(unsigned int what);
    void (*begin_frame)(unsigned int device);
    void (*end_frame)(unsigned int device);
    void (*get_doubles)(unsigned int what, double *values);
    void (*set_doubles)(unsigned int what, const double *values);
    const char *(*get_string)(unsigned int what);
    hd_error (*get_error)(void);
    unsigned long (*schedule)(hd_callback callback, void *data, unsigned short priority);
    void (*unschedule)(unsigned long handle);
    void (*start)(void);
    void (*stop)(void);
    void (*advance)(void); /* of the simulated device alone: the next tick, now */
} hd_api;

#endif

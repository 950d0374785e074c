/* What every haptic device is to the client: the same few verbs, whoever made it.
 *
 * Lengths are metres, forces newtons, times seconds, whatever the maker's library counts in. Time is
 * driven in one of two ways. A device with a scheduler of its own (*callback*) has `start`: it calls the
 * tick that it is given until that returns 0. Every other one (*pull*) leaves `start` empty: the client
 * calls the tick at the device's rate, by a clock of its own, or, if the device has `next`, whenever that
 * says so (the simulated device's time is that of ticks). Behind this interface: the simulated device
 * (simulated.h) and OpenHaptics' HDAPI (hd.h). Guard and energy stand in front of it, in client.c, so
 * that no device passes them by.
 */
#ifndef DEVICE_H
#define DEVICE_H

/* What a device says of itself; 0 where it says nothing. */
typedef struct {
    char model[64];
    double force, continuous; /* the largest, and the largest for long, N */
    double speed;             /* m/s */
    double impulse;           /* largest change of the force, N per ms */
    double rate;              /* ticks per second */
    double low[3], high[3];   /* of the workspace that can be used, m */
    int has_switch;           /* a safety switch, which was closed when it was opened */
} device_spec;

typedef struct {
    double position[3], velocity[3], rotation[9]; /* m, m/s, row by row */
    double temperature;                           /* of the hottest motor, 0 (cold) to 1 */
    double time;                                  /* s, by the device's clock; NaN: it has none */
    unsigned int buttons;                         /* a bit for each one that is held */
    int safe;                                     /* its safety switch is closed */
} device_state;

enum { DEVICE_CALIBRATED, DEVICE_NEEDS_UPDATE, DEVICE_NEEDS_MANUAL };

typedef struct device device;
typedef int (*device_tick)(void *data);

struct device {
    /* Open it and say what it is; returns 0, or the device's error. */
    unsigned int (*open)(device *self, const char *name, device_spec *spec);
    int (*calibrated)(device *self);
    void (*read)(device *self, device_state *state);
    void (*write)(device *self, const double *force, const double *torque); /* N, Nm; torque may be NULL */
    unsigned int (*error)(device *self); /* the next of its errors, 0 if there is none */
    void (*output)(device *self, int on);
    unsigned int (*start)(device *self, device_tick tick, void *data); /* NULL: a pull device */
    void (*stop)(device *self);
    int (*next)(device *self); /* NULL: by the client's clock */
    void (*close)(device *self);
    void *own;
};

#endif

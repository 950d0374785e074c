/* The interface of every haptic device to the client, whoever made it.
 *
 * Lengths are in metres, forces in newtons and times in seconds, whatever the units of the maker's
 * library. Time is driven in one of two ways. A device with its own scheduler (*callback*) has
 * `start`, which makes it call the given tick until the tick returns 0. Every other device (*pull*)
 * leaves `start` empty. The client then calls the tick at the device's rate, by its own clock. If
 * the device has `next`, the client calls tick and `next` in turn, without a clock; this is how the
 * simulated device runs in simulated time. Implementations: the simulated device (simulated.h) and
 * OpenHaptics' HDAPI (hd.h). The guard and its energy observer are in front of this interface, in
 * client.c, so that no device bypasses them.
 */
#ifndef DEVICE_H
#define DEVICE_H

/* Properties that a device reports; 0: not reported. */
typedef struct {
    char model[64];
    double force, continuous; /* peak and sustained, N */
    double speed;             /* m/s */
    double impulse;           /* largest change of the force, N per ms */
    double rate;              /* ticks per second */
    double low[3], high[3];   /* corners of the usable workspace, m */
    int has_switch;           /* a safety switch, which was closed when the device was opened */
} device_spec;

typedef struct {
    double position[3], velocity[3], rotation[9]; /* m, m/s, row by row */
    double temperature;                           /* of the hottest motor, 0 (cold) to 1 */
    double time;                                  /* s, by the device's clock; NaN: it has none */
    unsigned int buttons;                         /* a bit for each button that is held */
    int safe;                                     /* its safety switch is closed */
} device_state;

enum { DEVICE_CALIBRATED, DEVICE_NEEDS_UPDATE, DEVICE_NEEDS_MANUAL };

typedef struct device device;
typedef int (*device_tick)(void *data);

struct device {
    /* Open it and report its properties; returns 0, or the device's error. */
    unsigned int (*open)(device *self, const char *name, device_spec *spec);
    int (*calibrated)(device *self);
    void (*read)(device *self, device_state *state);
    /* N, Nm; torque may be NULL */
    void (*write)(device *self, const double *force, const double *torque);
    unsigned int (*error)(device *self); /* its next error; 0: none */
    void (*output)(device *self, int on);
    unsigned int (*start)(device *self, device_tick tick, void *data); /* NULL: a pull device */
    void (*stop)(device *self);
    int (*next)(device *self); /* NULL: driven by the client's clock */
    void (*close)(device *self);
    void *own;
};

#endif

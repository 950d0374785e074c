/* A separate process that ends a device's force when the run's process stops ticking because it was
 * killed or halted. It needs a library that lets two processes open the same device.
 * Part of client.c. */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <sys/mman.h>
#include <unistd.h>

/* Seconds without a tick after which the force is ended, and between two checks. */
#define WATCHDOG_PATIENCE 0.05
#define WATCHDOG_LOOK 0.005

enum { WATCHDOG_STARTS, WATCHDOG_READY, WATCHDOG_REFUSED, WATCHDOG_OVER };

/* In memory that both processes share. */
typedef struct {
    long long beat; /* ticks of the run */
    int state;      /* WATCHDOG_OVER is written by the run, the others by the watchdog */
} watchdog_pulse;

/* Fill in a library's functions; returns 0 if one is missing: see dlerror. */
static int hd_load(const char *library, hd_api *api, void **handle) {
    memset(api, 0, sizeof *api);
    if (!(*handle = dlopen(library, RTLD_NOW | RTLD_LOCAL))) return 0;
    for (size_t k = 0; k < sizeof hd_functions / sizeof *hd_functions; k++) {
        void *function = dlsym(*handle, hd_functions[k].name);
        if (!function) return 0;
        /* POSIX allows this conversion */
        memcpy((char *)api + hd_functions[k].at, &function, sizeof function);
    }
    return 1;
}

/* Report the outcome of the start, unless the run is over. */
static int watchdog_say(watchdog_pulse *pulse, int state) {
    int starts = WATCHDOG_STARTS;
    return __atomic_compare_exchange_n(
        &pulse->state, &starts, state, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
}

/* Watch a run until it ends or its process is gone. `file`: descriptor of the shared pulse;
 * `parent`: ID of the run's process. Returns 1 if the watchdog had to end the force. */
int client_watch(const char *library, const char *name, int file, int parent) {
    const struct timespec look = {0, (long)(1e9 * WATCHDOG_LOOK)};
    hd_api api;
    void *handle;
    watchdog_pulse *pulse =
        (watchdog_pulse *)mmap(NULL, sizeof *pulse, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (pulse == MAP_FAILED) return 0;
    if (!hd_load(library, &api, &handle)) return watchdog_say(pulse, WATCHDOG_REFUSED), 0;
    for (int k = 0; k < 64 && api.get_error().code; k++) continue; /* discard earlier errors */
    unsigned int device = api.init_device(name && *name ? name : NULL);
    if (device == HD_INVALID_HANDLE) return watchdog_say(pulse, WATCHDOG_REFUSED), 0;
    if (api.get_error().code || !watchdog_say(pulse, WATCHDOG_READY)) {
        (void)watchdog_say(pulse, WATCHDOG_REFUSED);
        api.disable_device(device);
        return 0;
    }
    long long seen = 0;
    double since = client_now();
    while (__atomic_load_n(&pulse->state, __ATOMIC_SEQ_CST) != WATCHDOG_OVER) {
        nanosleep(&look, NULL);
        long long beat = __atomic_load_n(&pulse->beat, __ATOMIC_SEQ_CST);
        int gone = getppid() != parent;
        if (beat != seen) seen = beat, since = client_now();
        if (!gone && (!seen || client_now() - since < WATCHDOG_PATIENCE)) continue;
        api.disable(HD_FORCE_OUTPUT);
        api.disable_device(device);
        return 1;
    }
    return 0; /* the run releases the device itself */
}

#endif

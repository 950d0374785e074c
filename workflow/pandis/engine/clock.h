/* A clock for measurements, s. Include it with _POSIX_C_SOURCE 199309L or later. */
#ifndef PANDIS_CLOCK_H
#define PANDIS_CLOCK_H
#include <time.h>

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
#endif

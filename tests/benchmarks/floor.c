/* What no query can be faster than: bytes through the caches, multiplications and additions. */
#define _POSIX_C_SOURCE 199309L
#include <stddef.h>
#include <time.h>

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Seconds to read `count` numbers once, after they were read before; whole vectors, many sums. */
double floor_read(const float *data, size_t count, float *sink) {
    float sums[128] = {0};
    double best = 1e9;
    for (int turn = 0; turn < 50; turn++) {
        double start = seconds();
        for (size_t i = 0; i + 128 <= count; i += 128)
            for (int k = 0; k < 128; k++) sums[k] += data[i + k];
        double taken = seconds() - start;
        if (taken < best) best = taken;
        *sink += sums[turn];
    }
    return best;
}

/* Multiplications and additions per second that depend on nothing in memory: 128 chains at once. */
double floor_arithmetic(float *sink) {
    float x[128], best = 0;
    const int rounds = 20000;
    for (int k = 0; k < 128; k++) x[k] = 1.0f + (float)k * 1e-6f;
    for (int turn = 0; turn < 20; turn++) {
        double start = seconds();
        for (int i = 0; i < rounds; i++)
            for (int k = 0; k < 128; k++) x[k] = x[k] * 0.999999f + 1e-7f;
        double rate = 2.0 * 128 * rounds / (seconds() - start);
        if (rate > (double)best) best = (float)rate;
        *sink += x[turn];
    }
    return (double)best;
}

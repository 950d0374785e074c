/* Single queries of a hash grid, for tests/benchmarks/hashgrid.py: distance and normal.
 * Tables are read with 32 bits, which is faster than with 16. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

enum { LEVELS = 16, WIDE = 64, FEATURES = 2 };

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The features of a level at a point: eight entries of its table, interpolated. */
static void look_up(const float *table, const int64_t *level, const float *point, float *out) {
    int64_t size = level[0], entries = level[1], dense = size + 1, node[3];
    float part[3];
    const float *start = table + FEATURES * level[2];
    for (int k = 0; k < 3; k++) {
        float place = fminf(fmaxf((point[k] + 1) / 2, 0), 1) * (float)size;
        node[k] = (int64_t)place;
        if (node[k] > size - 1) node[k] = size - 1;
        part[k] = place - (float)node[k];
    }
    memset(out, 0, FEATURES * sizeof *out);
    int hashed = entries < dense * dense * dense;
    for (int i = 0; i < 8; i++) {
        int64_t x = node[0] + (i & 1), y = node[1] + (i >> 1 & 1), z = node[2] + (i >> 2);
        int64_t at = (z * dense + y) * dense + x;
        if (hashed) at = (int64_t)((uint32_t)(x ^ y * 2654435761LL ^ z * 805459861LL) % entries);
        float share = (i & 1 ? part[0] : 1 - part[0]) * (i >> 1 & 1 ? part[1] : 1 - part[1]) *
            (i >> 2 ? part[2] : 1 - part[2]);
        for (int f = 0; f < FEATURES; f++) out[f] += share * start[FEATURES * at + f];
    }
}

/* A layer of a network, with weights column by column and then the bias; returns what follows. */
static const float *layer(
    const float *w, const float *x, int64_t in, float *y, int64_t out, int rectify) {
    const float *bias = w + in * out;
    memcpy(y, bias, (size_t)out * sizeof *y);
    for (int64_t i = 0; i < in; i++)
        for (int64_t o = 0; o < out; o++) y[o] += w[i * out + o] * x[i];
    for (int64_t o = 0; o < out && rectify; o++) y[o] = y[o] < 0 ? 0 : y[o];
    return bias + out;
}

/* Answer points one by one, and time each of them (s): of seven times the least. */
void ask(const float *numbers, const int64_t *levels, int64_t count, int64_t width,
    const float *points, int64_t asked, float *answers, double *times) {
    const float *weights = numbers;
    for (int64_t l = 0; l < count; l++) weights += FEATURES * levels[3 * l + 1];
    for (int64_t i = 0; i < asked; i++) times[i] = 1e9;
    for (int round = 0; round < 7; round++)
        for (int64_t i = 0; i < asked; i++) {
            float x[LEVELS * FEATURES], a[WIDE], b[WIDE];
            double begin = now();
            for (int64_t l = 0; l < count; l++)
                look_up(numbers, levels + 3 * l, points + 3 * i, x + FEATURES * l);
            const float *w = layer(weights, x, FEATURES * count, a, width, 1);
            w = layer(w, a, width, b, width, 1);
            float *answer = answers + 4 * i, size = 0;
            layer(w, b, width, answer, 4, 0);
            for (int k = 1; k < 4; k++) size += answer[k] * answer[k];
            for (int k = 1; k < 4; k++) answer[k] /= sqrtf(size);
            times[i] = fmin(times[i], now() - begin);
        }
}

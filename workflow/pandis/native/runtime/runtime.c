/* pandis.h as a library, for Python; and a clock around single queries. */
#define _POSIX_C_SOURCE 199309L
#define PANDIS_IMPLEMENTATION
#include "../pandis.h"

#include <time.h>

size_t runtime_field_bytes(void) { return sizeof(pandis_field); }

void runtime_frame(const pandis_field *field, double *numbers) {
    for (int k = 0; k < 3; k++) numbers[k] = field->centre[k];
    numbers[3] = field->scale;
}

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The penalty forces (three doubles each) and flags at points. */
void runtime_forces(const pandis_field *field, const double *points, size_t count, double stiffness, double *forces,
                    unsigned char *flags) {
    for (size_t i = 0; i < count; i++)
        flags[i] = (unsigned char)pandis_force(field, points + 3 * i, stiffness, forces + 3 * i);
}

/* Seconds of each of `queries` single queries, at the points in turn. With some bytes of other work in
 * between, that empty the caches, the queries find nothing in them. */
void runtime_time(const pandis_field *field, const double *points, size_t count, size_t queries, double *taken,
                  unsigned char *other, size_t bytes) {
    pandis_answer answer;
    volatile double sink = 0;
    for (size_t i = 0; i < queries; i++) {
        for (size_t k = 0; k < bytes; k += 16) other[k]++;
        double start = seconds();
        pandis_query(field, points + 3 * (i % count), &answer);
        taken[i] = seconds() - start;
        sink = sink + answer.distance;
    }
}

/* Ask fields at points and print every bit of the answers; count allocations on the way.
 *
 * usage: probe POINTS FIELD.pandis...    POINTS: raw doubles, three each, in mesh units
 *
 * Linked with -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=free.
 */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#include <stdio.h>
#include <stdlib.h>

static int counting = 0, allocations = 0;
#ifndef NO_COUNT
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void __real_free(void *old);
void *__wrap_malloc(size_t size) { return allocations += counting, __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) {
    return allocations += counting, __real_calloc(count, size);
}
void *__wrap_realloc(void *old, size_t size) {
    return allocations += counting, __real_realloc(old, size);
}
void __wrap_free(void *old) { allocations += counting, __real_free(old); }
#endif

static unsigned long long hash(unsigned long long h, const void *data, size_t size) {
    const unsigned char *p = (const unsigned char *)data;
    for (size_t i = 0; i < size; i++) h = (h ^ p[i]) * 1099511628211ull;
    return h;
}

int main(int count, char **names) {
    FILE *file = fopen(names[1], "rb");
    if (!file) return 2;
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file), points = size / 24;
    double *at = (double *)malloc(size);
    rewind(file);
    if (!at || fread(at, 1, size, file) != size) return 2;
    fclose(file);
    for (int i = 2; i < count; i++) {
        pandis_field field;
        pandis_error error = pandis_open_file(&field, names[i]);
        if (error) return printf("%s: %s\n", names[i], pandis_error_text(error)), 1;
        unsigned long long h = 1469598103934665603ull;
        counting = 1;
        for (size_t k = 0; k < points; k++) {
            double force[3];
            pandis_answer answer;
            pandis_query(&field, at + 3 * k, &answer);
            int flag = pandis_force(&field, at + 3 * k, 2.0, force);
            if (answer.flag != PANDIS_INVALID) { /* which NaN it is, is the machine's affair */
                h = hash(h, &answer.distance, sizeof answer.distance);
                h = hash(h, answer.normal, sizeof answer.normal);
            }
            h = hash(hash(h, force, sizeof force), &flag, sizeof flag);
        }
        counting = 0;
        printf("%016llx %d\n", h, allocations);
        pandis_close(&field);
    }
    free(at);
    return 0;
}

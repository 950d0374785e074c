/* Print how many bytes of stack the queries of a field need, at most, over some points.
 *
 * usage: stack FIELD.pandis POINTS       POINTS: raw doubles, three each, in mesh units
 */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#define PAINTED 200000

static pandis_field field;
static double *points;
static size_t count, used;

/* Paint the stack below a caller, and later find how far it was written over. */
__attribute__((noinline)) static void stack(int paint) {
    volatile unsigned char room[PAINTED];
    if (paint) {
        for (size_t k = 0; k < PAINTED; k++) room[k] = 0xa5;
        return;
    }
    size_t k = 0;
    while (k < PAINTED && room[k] == 0xa5) k++;
    used = PAINTED - k;
}

__attribute__((noinline)) static void *ask(void *none) {
    stack(1);
    for (size_t i = 0; i < count; i++) {
        pandis_answer answer;
        pandis_query(&field, points + 3 * i, &answer);
    }
    stack(0);
    return none;
}

int main(int words, char **names) {
    if (words < 3 || pandis_open_file(&field, names[1])) return 2;
    FILE *file = fopen(names[2], "rb");
    if (!file) return 2;
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file);
    rewind(file);
    points = (double *)malloc(size), count = size / 24;
    if (!points || fread(points, 1, size, file) != size) return 2;
    pthread_t thread;
    pthread_create(&thread, NULL, ask, NULL);
    pthread_join(thread, NULL);
    printf("%zu\n", used);
    return 0;
}

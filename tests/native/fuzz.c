/* Hostile files: whatever the bytes, an error or answers, and no access beyond them.
 *
 * With libFuzzer: clang -g -O1 -fsanitize=fuzzer,address,undefined -DLIBFUZZER fuzz.c -lm
 * Without: gcc -g -O1 -fsanitize=address,undefined fuzz.c -lm; usage: fuzz SECONDS SEED
 * FIELD.pandis...
 */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static const double points[][3] = {{0, 0, 0}, {0.3, -0.2, 0.1}, {1, 1, 1}, {-1, 0.999999, 1},
    {40, -3, 2}, {1e300, 0, 0}, {0, (double)NAN, 0}, {5e-324, 0, 5e-324}, {(double)INFINITY, 0, 0},
    {0.9, 0.9, -0.9}, {-0.5, 0.5, 0.5}, {0.05, 0.01, -0.02}, {0.1, -0.7, 0.6}, {-0.89, -0.01, 0.3},
    {2, 2, 2}};

/* Move the vertices of a mesh, to where they may be anything, and ask it. */
static void move(const pandis_field *field) {
    size_t room = pandis_handover_room(field), count = 3 * pandis_vertex_count(field);
    double *where = (double *)malloc(count * sizeof *where);
    void *bytes = malloc(room);
    pandis_handover shared;
    pandis_field moving;
    pandis_answer answer;
    if (where && bytes && !pandis_handover_open(&shared, field, bytes, room)) {
        for (int turn = 0; turn < 4; turn++) {
            static const double stretch[4] = {1, 0.3, -1e12, 0};
            for (size_t i = 0; i < count; i++)
                where[i] = i % 3 == (size_t)turn ? stretch[turn] * field->as.mesh.vertices[i]
                                                 : field->as.mesh.vertices[i];
            int error = pandis_handover_refit(&shared, where, count / 3);
            if (pandis_handover_take(&shared, &moving) != (!error || !turn)) abort();
            for (size_t i = 0; i < sizeof points / sizeof *points; i++)
                pandis_query(&moving, points[i], &answer);
        }
    }
    free(where), free(bytes);
}

/* Open what may be anything, with a checksum that is right, and ask it. */
static int ask(const unsigned char *data, size_t size) {
    pandis_field field;
    /* a block of its own, so that the sanitizer sees its end */
    unsigned char *copy = (unsigned char *)malloc(size ? size : 1);
    if (!copy) return 0;
    memcpy(copy, data, size);
    if (size > 32) {
        uint32_t crc = pandis__crc(copy + 32, size - 32);
        for (int k = 0; k < 4; k++) copy[24 + k] = (unsigned char)(crc >> (8 * k));
    }
    int error = pandis_open(&field, copy, size);
    if (!error) {
        for (size_t i = 0; i < sizeof points / sizeof *points; i++) {
            double force[3];
            pandis_answer answer;
            pandis_answer again;
            pandis_query(&field, points[i], &answer);
            for (double reach = 0; reach < 2; reach += 0.4)
                pandis_query_within(&field, points[i], reach, &again);
            pandis_query_within(&field, points[i], -1, &again);
            if (again.flag != answer.flag) abort();
            int flag = pandis_force(&field, points[i], 400, force);
            for (int k = 0; k < 3; k++)
                if (flag == PANDIS_INVALID ? force[k] != 0 : force[k] != force[k]) abort();
        }
        if (pandis_refit_room(&field)) move(&field);
        pandis_close(&field);
    }
    free(copy);
    return error;
}

#ifdef LIBFUZZER
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    ask(data, size);
    return 0;
}
#else
static uint64_t state;
static uint64_t draw(void) { /* xorshift64* (Vigna 2016) */
    state ^= state >> 12, state ^= state << 25, state ^= state >> 27;
    return state * 2685821657736338717ull;
}

int main(int count, char **names) {
    double until = atof(names[1]);
    long runs = 0, opened = 0;
    clock_t start = clock();
    state = (uint64_t)atoll(names[2]) * 2654435761u + 1;
    for (int turn = 3;; turn = turn + 1 < count ? turn + 1 : 3) {
        FILE *file = fopen(names[turn], "rb");
        if (!file) return 2;
        fseek(file, 0, SEEK_END);
        size_t size = (size_t)ftell(file);
        unsigned char *whole = (unsigned char *)malloc(size),
                      *bad = (unsigned char *)malloc(size + 64);
        rewind(file);
        if (!whole || !bad || fread(whole, 1, size, file) != size) return 2;
        fclose(file);
        for (int i = 0; i < 200; i++) {
            size_t length = size, head = size < 1024 ? size : 1024;
            memcpy(bad, whole, size);
            memset(bad + size, 0x5a, 64);
            if (draw() % 8 == 0) length = draw() % (size + 64);
            for (uint64_t edits = draw() % 6; edits; edits--) {
                /* mostly where the counts are */
                size_t at = draw() % 3 ? draw() % head : draw() % size;
                switch (draw() % 4) {
                case 0: bad[at] ^= (unsigned char)(1u << (draw() % 8)); break;
                case 1: bad[at] = (unsigned char)draw(); break;
                case 2:
                    at = at / 4 * 4;
                    for (int k = 0; k < 4; k++) bad[at + (size_t)k] = draw() % 2 ? 0xff : 0x7f;
                    break;
                default:
                    at = at / 8 * 8;
                    for (int k = 0; k < 8; k++) bad[at + (size_t)k] = (unsigned char)draw();
                }
            }
            if (length >= 24) /* the size, or the rest is never reached */
                for (int k = 0; k < 8; k++)
                    if (draw() % 64) bad[16 + k] = (unsigned char)((uint64_t)length >> (8 * k));
            opened += !ask(bad, length), runs++;
        }
        free(whole), free(bad);
        if ((double)(clock() - start) / CLOCKS_PER_SEC > until && turn + 1 >= count) break;
    }
    printf("%ld files, %ld of them opened\n", runs, opened);
    return 0;
}
#endif

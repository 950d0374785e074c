/* Which faces of a mesh cross or touch, and which nodes of a graph are connected.
 *
 * Compile without reassociation (-ffp-contract=off, no -ffast-math): the predicates need rounding
 * as IEEE 754 has it. */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "predicates.h"
#include "meetings.h"
#include "boxes.h"

/* Search among `count` faces or points. Returns the number of pairs, or -1 if memory is short. */
static int64_t search(Search *s, int32_t count) {
    s->items = malloc((size_t)count * sizeof *s->items);
    s->nodes = malloc((size_t)count * sizeof *s->nodes);
    s->short_of_memory = !s->items || !s->nodes;
    if (!s->short_of_memory) {
        for (int32_t i = 0; i < count; i++) s->items[i] = (Item){box_of(s, i), i};
        build(s, 0, count);
        try_within(s, s->nodes);
    }
    free(s->items), free(s->nodes);
    return s->short_of_memory ? -1 : s->pair_count;
}

/* Find the pairs of faces that meet outside of their common corners and edges, or are folded onto
 * each other if coordinates have an error of `rounding`, of which at least one is in question (all
 * if NULL). Sets `pairs`, to be freed by faces_free, and returns their number, or -1 if memory is
 * short. `count` is at least 1. */
int64_t faces_crossings(const double *places, const int32_t *faces, int32_t count,
    const uint8_t *question, double rounding, int32_t **pairs) {
    Search s = {.places = places, .faces = faces, .question = question, .rounding = rounding};
    int64_t pair_count = search(&s, count);
    *pairs = s.pairs;
    return pair_count;
}

/* Find the pairs of points that are at most `reach` apart: otherwise as faces_crossings. */
int64_t faces_close(const double *points, int32_t count, double reach, int32_t **pairs) {
    Search s = {.places = points, .reach = reach};
    int64_t pair_count = search(&s, count);
    *pairs = s.pairs;
    return pair_count;
}

/* Mark the pairs of faces u, v, a and u, v, b that are folded onto each other within rounding.
 * `corners` has u, v, a, b of each. */
void faces_folded(
    const double *places, const int32_t *corners, int64_t count, double rounding, uint8_t *marks) {
    for (int64_t i = 0; i < count; i++, corners += 4) {
        const double *at[4];
        for (int k = 0; k < 4; k++) at[k] = places + 3 * (ptrdiff_t)corners[k];
        int first = corners[0] > corners[1];
        marks[i] = (uint8_t)folded_flat(at[first], at[!first], at[2], at[3], rounding);
    }
}

void faces_free(int32_t *pairs) { free(pairs); }

static int64_t root_of(int64_t *label, int64_t node) {
    while (label[node] != node) node = label[node] = label[label[node]];
    return node;
}

/* Label each node of a graph with the least node that is connected with it. */
void faces_connect(const int64_t *pairs, int64_t pair_count, int64_t *label, int64_t count) {
    for (int64_t i = 0; i < count; i++) label[i] = i;
    for (int64_t i = 0; i < pair_count; i++) {
        int64_t a = root_of(label, pairs[2 * i]), b = root_of(label, pairs[2 * i + 1]);
        if (a < b) label[b] = a;
        else label[a] = b;
    }
    for (int64_t i = 0; i < count; i++) label[i] = label[label[i]]; /* labels are less than nodes */
}

/* Turn the faces of each patch, from its first face on, so that neighbours agree. `neighbours`
 * holds the face across each of a face's three edges, or -1; `agrees` whether that one runs along
 * the edge the other way. Sets each face's patch (its first face), whether it is turned, and for
 * first faces of patches with only one side `one_sided`. `queue` has room for all faces. */
void faces_orient(const int32_t *neighbours, const uint8_t *agrees, int32_t count, int32_t *patch,
    uint8_t *turned, uint8_t *one_sided, int32_t *queue) {
    for (int32_t i = 0; i < count; i++) patch[i] = -1, turned[i] = one_sided[i] = 0;
    for (int32_t first = 0; first < count; first++) {
        if (patch[first] >= 0) continue;
        int32_t head = 0, tail = 0;
        patch[first] = first, queue[tail++] = first;
        while (head < tail) {
            int32_t face = queue[head++];
            for (int k = 0; k < 3; k++) {
                int32_t next = neighbours[3 * (ptrdiff_t)face + k];
                if (next < 0) continue;
                uint8_t turn = turned[face] ^ !agrees[3 * (ptrdiff_t)face + k];
                if (patch[next] < 0) patch[next] = first, turned[next] = turn, queue[tail++] = next;
                else if (turned[next] != turn) one_sided[first] = 1;
            }
        }
    }
}

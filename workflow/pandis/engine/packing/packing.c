/* Packs a mesh on a lattice into blocks and a tree, as parts/packed.h and compact.h read them.
 *
 * Faces are in the order of the tree. Blocks are as full as possible, because a corner is stored in
 * every block that uses it. Therefore only splits that leave whole blocks (in a block, whole
 * groups) on one side are considered; of these, the surface area heuristic chooses the best. */
#define PANDIS_NO_FILE

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "../parts/types.h"
#include "../parts/basis.h"
#include "../parts/vectors.h"
#include "../parts/triangles.h"
#include "../parts/mesh.h"
#include "../parts/packed.h"
#include "../parts/compact.h"

#define dot pandis__dot
#define cross pandis__cross
#define WIDTH PANDIS__WIDTH
#define BLOCK PANDIS__BLOCK
#define MEDIAN_DEPTH 24 /* from this depth on, split in halves to bound the depth */

#include "sides.h"

typedef struct {
    int32_t vertex_count, face_count;
    const int32_t *vertices, *faces;
    const uint8_t *corner_side, *edge_side, *face_side; /* how the side is found there */
    int32_t *order, *scratch;                           /* faces, in the order of the tree */
    uint32_t *key, *other_key;
    double *area;
    pandis__branch *branches;
    pandis__block_record *blocks;
    uint8_t *packed;
    int32_t branch_count, branch_room, block_count, block_room;
    int64_t size, room;
    int failed;
} Packing;

typedef struct {
    int32_t start, count, low[3], high[3];
    double area;
} Range;

/* -------------------- splits */

static void face_box(const Packing *m, int32_t face, int32_t *low, int32_t *high) {
    for (int c = 0; c < 3; c++) {
        const int32_t *v = m->vertices + 3 * (size_t)m->faces[3 * (size_t)face + c];
        for (int k = 0; k < 3; k++) {
            if (v[k] < low[k]) low[k] = v[k];
            if (v[k] > high[k]) high[k] = v[k];
        }
    }
}

/* Half the area of a box, plus a little for its edges, so that flat boxes have a cost. */
static double half_area(const int32_t *low, const int32_t *high) {
    double x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x * y + y * z + z * x + x + y + z;
}

static Range bound(const Packing *m, int32_t start, int32_t count) {
    Range r = {start, count, {INT32_MAX, INT32_MAX, INT32_MAX}, {-1, -1, -1}, 0};
    for (int32_t i = start; i < start + count; i++) face_box(m, m->order[i], r.low, r.high);
    r.area = half_area(r.low, r.high);
    return r;
}

/* Sort a range by the sum of each face's corner coordinates along an axis. The sort is stable. */
static void sort_range(Packing *m, const Range *r, int axis) {
    int32_t *from = m->order + r->start, *to = m->scratch + r->start;
    uint32_t *a = m->key + r->start, *b = m->other_key + r->start;
    for (int32_t i = 0; i < r->count; i++) {
        a[i] = 0;
        for (int c = 0; c < 3; c++)
            a[i] += (uint32_t)m->vertices[3 * (size_t)m->faces[3 * (size_t)from[i] + c] + axis];
    }
    if (r->count <= BLOCK) { /* by insertion */
        for (int32_t i = 1; i < r->count; i++) {
            uint32_t key = a[i];
            int32_t face = from[i], j = i;
            for (; j > 0 && a[j - 1] > key; j--) a[j] = a[j - 1], from[j] = from[j - 1];
            a[j] = key, from[j] = face;
        }
        return;
    }
    for (int shift = 0; shift < 24; shift += 12) {
        int32_t start[4097] = {0};
        for (int32_t i = 0; i < r->count; i++) start[(a[i] >> shift & 4095) + 1]++;
        for (int k = 0; k < 4096; k++) start[k + 1] += start[k];
        for (int32_t i = 0; i < r->count; i++) {
            int32_t j = start[a[i] >> shift & 4095]++;
            b[j] = a[i], to[j] = from[i];
        }
        uint32_t *swap = a;
        int32_t *exchange = from;
        a = b, b = swap, from = to, to = exchange;
    }
}

/* Find the cheapest cut of a sorted range, at a multiple of `unit`. Returns the cost of both sides.
 */
static double sweep(Packing *m, const Range *r, int32_t unit, int32_t *where) {
    int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, high[3] = {-1, -1, -1};
    int32_t last = (r->count - 1) / unit;
    double best = INFINITY;
    for (int32_t cut = last, i = r->count; cut > 0; cut--) {
        for (; i > cut * unit; i--) face_box(m, m->order[r->start + i - 1], low, high);
        m->area[cut] = half_area(low, high);
    }
    for (int k = 0; k < 3; k++) low[k] = INT32_MAX, high[k] = -1;
    for (int32_t cut = 1, i = 0; cut <= last; cut++) {
        for (; i < cut * unit; i++) face_box(m, m->order[r->start + i], low, high);
        double cost = half_area(low, high) * (cut * unit) + m->area[cut] * (r->count - cut * unit);
        if (cost < best) best = cost, *where = cut * unit;
    }
    return best;
}

static void split(Packing *m, const Range *r, int32_t unit, int depth, Range *left, Range *right) {
    double best = INFINITY;
    int axis = 0, last = 0;
    int32_t where = unit * ((r->count / unit + 1) / 2), cut = where;
    for (int k = 0; k < 3; k++) {
        sort_range(m, r, last = k);
        double cost = sweep(m, r, unit, &cut);
        if (cost < best) best = cost, axis = k, where = cut;
    }
    if (depth >= MEDIAN_DEPTH) where = unit * ((r->count / unit + 1) / 2);
    if (axis != last) sort_range(m, r, axis);
    *left = bound(m, r->start, where), *right = bound(m, r->start + where, r->count - where);
}

/* -------------------- blocks */

static int bit_length(int32_t value) {
    int bits = 0;
    for (; value; value >>= 1) bits++;
    return bits;
}

/* Number of bits for coordinates in a box of this extent. The far side of the box, rounded up to
 * the resolution of a byte coordinate, must fit into a byte. */
static int bits_for(int32_t extent) {
    int bits = bit_length(extent), shift = pandis__coarse(bits);
    return bits + ((extent + (1 << shift) - 1) >> shift > 255);
}

/* List the corners of a range's faces, each once. Returns their number, or -1 if there are too
 * many. `local` gets the indices of each face's corners in the list. */
static int collect(const Packing *m, const Range *r, int32_t *corners, uint8_t *local) {
    int count = 0;
    for (int32_t i = 0; i < 3 * r->count; i++) {
        int32_t v = m->faces[3 * (size_t)m->order[r->start + i / 3] + i % 3];
        int j = 0;
        while (j < count && corners[j] != v) j++;
        if (j == count) {
            if (count == BLOCK) return -1;
            corners[count++] = v;
        }
        local[i] = (uint8_t)j;
    }
    return count;
}

static void *grown(Packing *m, void *old, int64_t wanted, int64_t *room, size_t each) {
    if (wanted <= *room) return old;
    int64_t more = 2 * wanted;
    void *moved = realloc(old, (size_t)more * each);
    if (!moved) return m->failed = 1, old;
    *room = more;
    return moved;
}

/* Sort a block's faces into groups of eight neighbours. `part` gets the groups' boxes.
 * Returns the number of groups. */
static int group(Packing *m, Range whole, Range *part) {
    int count = 1;
    part[0] = whole;
    for (;;) {
        int widest = -1;
        for (int i = 0; i < count; i++)
            if (part[i].count > WIDTH && (widest < 0 || part[i].area > part[widest].area))
                widest = i;
        if (widest < 0) return count;
        Range left, right;
        split(m, &part[widest], WIDTH, 0, &left, &right);
        for (int i = count++; i > widest + 1; i--) part[i] = part[i - 1];
        part[widest] = left, part[widest + 1] = right;
    }
}

static void write_boxes(
    uint8_t *boxes, const Range *part, int count, const int32_t *origin, const int *shift) {
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < WIDTH; i++) {
            int32_t low = i < count ? part[i].low[k] - origin[k] : 0,
                    high = i < count ? part[i].high[k] - origin[k] : 0;
            boxes[WIDTH * k + i] = (uint8_t)(low >> shift[k]);
            boxes[WIDTH * (3 + k) + i] = (uint8_t)((high + (1 << shift[k]) - 1) >> shift[k]);
        }
}

/* Write how sides are found at a block's corners, edges and faces, in two bits each. If the face
 * always determines the side, nothing is written. */
static uint8_t *write_sides(const Packing *m, const Range *whole, const int32_t *corners, int count,
    uint8_t *out, uint32_t *counts) {
    int any = 0, groups = (whole->count + WIDTH - 1) / WIDTH;
    uint8_t *edges = out + (count + 3) / 4, *faces = edges + 6 * groups, *end = faces + 2 * groups;
    memset(out, 0, (size_t)(end - out));
    for (int j = 0; j < count; j++) {
        int side = m->corner_side[corners[j]];
        any |= side, out[j / 4] |= (uint8_t)(side << 2 * (j % 4));
    }
    for (int i = 0; i < whole->count; i++) {
        size_t face = (size_t)m->order[whole->start + i];
        any |= m->face_side[face], faces[i / 4] |= (uint8_t)(m->face_side[face] << 2 * (i % 4));
        for (int e = 3 * i; e < 3 * i + 3; e++) {
            int side = m->edge_side[3 * face + (size_t)(e - 3 * i)];
            any |= side, edges[e / 4] |= (uint8_t)(side << 2 * (e % 4));
        }
    }
    if (!any) return out;
    *counts |= 1u << 27;
    return end;
}

static int32_t add_block(Packing *m, Range whole) {
    int32_t corners[BLOCK];
    uint8_t local[3 * BLOCK];
    Range part[WIDTH];
    int groups = group(m, whole, part), count = collect(m, &whole, corners, local);
    int64_t room = m->block_room;
    m->blocks = grown(m, m->blocks, m->block_count + 1, &room, sizeof *m->blocks);
    m->block_room = (int32_t)room;
    m->packed = grown(m, m->packed, m->size + 2048, &m->room, 1);
    if (m->failed) return 0;
    pandis__block_record *record = m->blocks + m->block_count;
    uint8_t *out = m->packed + m->size, *start = out;
    int bits[3], shift[3];
    record->start = (uint32_t)m->size, record->origin = 0;
    record->counts = (uint32_t)(whole.count - 1) | (uint32_t)(count - 1) << 6;
    for (int k = 0; k < 3; k++) {
        bits[k] = bits_for(whole.high[k] - whole.low[k]);
        shift[k] = pandis__coarse(bits[k]);
        record->counts |= (uint32_t)bits[k] << (12 + 5 * k);
        record->origin |= (uint64_t)(uint32_t)whole.low[k] << (21 * k);
    }
    write_boxes(out, part, groups, whole.low, shift);
    out += 6 * WIDTH;
    for (int g = 0; g < groups; g++)
        for (int k = 0; k < 3; k++, out += 6) {
            uint64_t codes = 0;
            for (int i = 0; i < WIDTH; i++) {
                int face = WIDTH * g + i < whole.count ? WIDTH * g + i : whole.count - 1;
                codes |= (uint64_t)local[3 * face + k] << 6 * i;
            }
            for (int i = 0; i < 6; i++) out[i] = (uint8_t)(codes >> 8 * i);
        }
    int stride = (bits[0] + bits[1] + bits[2]) / 8 + 1;
    for (int j = 0; j < count; j++, out += stride) {
        uint64_t word = 0;
        for (int k = 0, first = 0; k < 3; first += bits[k++])
            word |= (uint64_t)(m->vertices[3 * (size_t)corners[j] + k] - whole.low[k]) << first;
        for (int i = 0; i < stride; i++) out[i] = (uint8_t)(word >> 8 * i);
    }
    out = write_sides(m, &whole, corners, count, out, &m->blocks[m->block_count].counts);
    m->size += out - start;
    return m->block_count++;
}

/* -------------------- tree */

static int fits(const Packing *m, const Range *r) {
    int32_t corners[BLOCK];
    uint8_t local[3 * BLOCK];
    return r->count <= BLOCK && collect(m, r, corners, local) >= 0;
}

/* The number at whose multiples a range of `count` faces is cut, so that few branches and blocks
 * are left half empty. */
static int32_t unit_of(int32_t count) {
    int64_t unit = BLOCK;
    if (count <= BLOCK) return count > WIDTH ? WIDTH : 1;
    while (unit * WIDTH < count) unit *= WIDTH;
    return (int32_t)unit;
}

static int32_t add_branch(Packing *m, Range whole, int depth) {
    int64_t room = m->branch_room;
    m->branches = grown(m, m->branches, m->branch_count + 1, &room, sizeof *m->branches);
    m->branch_room = (int32_t)room;
    if (m->failed) return 0;
    int32_t index = m->branch_count++;
    Range part[WIDTH];
    int32_t unit = unit_of(whole.count);
    int count = 1;
    part[0] = whole;
    while (count < WIDTH) {
        int widest = -1;
        for (int i = 0; i < count; i++)
            if (part[i].count > unit && (widest < 0 || part[i].area > part[widest].area))
                widest = i;
        if (widest < 0) break;
        Range left, right;
        split(m, &part[widest], unit, depth, &left, &right);
        part[widest] = left, part[count++] = right;
    }
    pandis__branch branch;
    memset(&branch, 0, sizeof branch);
    branch.count = (uint8_t)count;
    int shift[3];
    for (int k = 0; k < 3; k++) {
        branch.origin[k] = whole.low[k],
        shift[k] = pandis__coarse(bits_for(whole.high[k] - whole.low[k]));
        branch.shift[k] = (uint8_t)shift[k];
    }
    write_boxes(branch.boxes[0], part, count, whole.low, shift);
    for (int i = 0; i < count && !m->failed; i++)
        branch.child[i] =
            fits(m, &part[i]) ? ~add_block(m, part[i]) : add_branch(m, part[i], depth + 1);
    m->branches[index] = branch;
    return index;
}

void packing_free(Packing *m) {
    if (!m) return;
    free(m->order), free(m->scratch), free(m->key), free(m->other_key);
    free(m->area), free(m->branches), free(m->blocks), free(m->packed);
    free(m);
}

/* Pack a mesh; returns NULL if memory is short. Vertices (V, 3) are integers from 0 to 2^20 - 1; no
 * face may have two equal corners. How sides are found at vertices, half-edges and faces is coded
 * as in parts/packed.h. The arrays are not used after this function returns. */
Packing *packing_build(const int32_t *vertices, int32_t vertex_count, const int32_t *faces,
    int32_t face_count, const uint8_t *corner_side, const uint8_t *edge_side,
    const uint8_t *face_side) {
    Packing *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    size_t f = (size_t)face_count;
    m->vertices = vertices, m->vertex_count = vertex_count, m->faces = faces,
    m->face_count = face_count;
    m->corner_side = corner_side, m->edge_side = edge_side, m->face_side = face_side;
    m->order = malloc(f * sizeof(int32_t)), m->scratch = malloc(f * sizeof(int32_t));
    m->key = malloc(f * sizeof(uint32_t)), m->other_key = malloc(f * sizeof(uint32_t));
    m->area = malloc((f + 1) * sizeof(double));
    if (!m->order || !m->scratch || !m->key || !m->other_key || !m->area)
        return packing_free(m), NULL;
    for (int32_t i = 0; i < face_count; i++) m->order[i] = i;
    add_branch(m, bound(m, 0, face_count), 0);
    m->packed = grown(m, m->packed, m->size + PANDIS__SLACK, &m->room, 1);
    if (m->failed) return packing_free(m), NULL;
    memset(m->packed + m->size, 0, PANDIS__SLACK);
    m->size += PANDIS__SLACK;
    return m;
}

/* The address of a part and its size in bytes: branches, blocks, packed faces and corners. */
const void *packing_part(const Packing *m, int32_t which, int64_t *bytes) {
    switch (which) {
    case 0: return *bytes = (int64_t)sizeof *m->branches * m->branch_count, m->branches;
    case 1: return *bytes = (int64_t)sizeof *m->blocks * m->block_count, m->blocks;
    case 2: return *bytes = m->size, m->packed;
    default: return *bytes = 0, NULL;
    }
}

/* Distances at points of the unit frame, as pandis.h returns them with the budget `most`, and lower
 * bounds of the distance to the surface. */
void packing_distances(const void *branches, const void *blocks, const void *packed, int32_t bits,
    int32_t most, const double *points, int64_t count, double *distance, double *clear) {
    pandis__compact t = {.bits = bits,
        .step = 2 * PANDIS__HALF / ((1 << bits) - 1),
        .reach = 1,
        .most = most ? most : INT32_MAX,
        .branches = branches,
        .blocks = blocks,
        .packed = packed};
    for (int64_t i = 0; i < count; i++) {
        double normal[3];
        pandis__start begin = PANDIS__ANYWHERE;
        pandis__answer_compact(&t, points + 3 * i, &begin, distance + i, normal, clear + i);
    }
}

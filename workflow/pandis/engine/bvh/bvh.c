/* A bounding volume hierarchy over triangles: exact closest points and winding numbers.
 *
 * Eight-wide nodes hold boxes in float, rounded outward; leaves hold up to eight triangles, rounded
 * to 16 bits. Single precision selects the triangles that may be nearest; double precision decides.
 * A box or a triangle is skipped only if it is certainly farther than the best one so far, and of
 * equally near triangles the one with the least index wins. So the result depends only on the point
 * and the triangles: not on the order of the points, on threads or vector width.
 *
 * Compile without reassociation (-ffp-contract=off, no -ffast-math): then every machine with
 * IEEE arithmetic returns the same bits.
 *
 * Signs: Baerentzen and Aanaes 2005 (angle-weighted pseudonormals). Winding numbers: Barill et
 * al. 2018 (dipoles of clusters), solid angles after Van Oosterom and Strackee 1983; in a closed
 * mesh, the crossings of a ray.
 */
#define PANDIS_NO_FILE

#include <stddef.h>
#include <stdint.h>

#include "../parts/types.h"
#include "../parts/basis.h"
#include "../parts/vectors.h"
#include "../parts/triangles.h"
#include "../parts/mesh.h"
#include "../parts/nearest.h"

#include <stdlib.h>

#define WIDTH PANDIS__WIDTH
#define BINS 16
#define MEDIAN_DEPTH 40 /* from this depth on, split in halves to bound the depth */
#define STACK PANDIS__STACK
#define KNOWN 32
#define ROUGH_BETA 1.4f
#define FINE_BETA 2.5f
/* dipoles of clusters farther away than this many spreads of a group of points are evaluated once,
 * at the middle of the group */
#define MIDDLE_BETA 3
#define FAR_LIMIT PANDIS__FAR

enum { FLAG_INVALID = 1, FLAG_TIED = 2, FLAG_OVERRULED = 4, FLAG_ON_SURFACE = 8 };

typedef pandis__node Node;
typedef pandis__leaf Leaf;
typedef pandis__foot Foot;

typedef struct {
    float centre[3][WIDTH], dipole[3][WIDTH], reach[WIDTH]; /* reach: radius squared */
} Cluster;

typedef struct {
    int32_t vertex_count, face_count, node_count, leaf_count;
    double scale; /* largest absolute coordinate */
    double *vertices;
    int32_t *faces;
    int32_t *neighbours;    /* (F, 3): the face across the edge from corner k to k + 1, or -1 */
    double *vertex_normals; /* (V, 3), angle-weighted, unit */
    Node *nodes;
    Cluster *clusters;
    Leaf *leaves;
} Bvh;

#define cross pandis__cross
#define dot pandis__dot
#define normalise pandis__normalise

/* The tree as pandis.h reads it. */
static pandis__mesh view(const Bvh *t) {
    return (pandis__mesh){.vertex_count = t->vertex_count,
        .face_count = t->face_count,
        .node_count = t->node_count,
        .leaf_count = t->leaf_count,
        .most = INT32_MAX,
        .reach = t->scale,
        .vertices = t->vertices,
        .faces = t->faces,
        .neighbours = t->neighbours,
        .vertex_normals = t->vertex_normals,
        .nodes = t->nodes,
        .leaves = t->leaves};
}

static const double *corner(const Bvh *t, int32_t face, int k) {
    return t->vertices + 3 * (size_t)t->faces[3 * (ptrdiff_t)face + k];
}

#include "build.h"
#include "branches.h"

#include "close.h"
#include "ties.h"
#include "winding.h"
#include "crossings.h"
#include "rays.h"

/* -------------------- answers */

/* Whether the points are inside, by the winding number alone; 0 where they are not finite or too
 * far away. */
void bvh_inside(const Bvh *t, const double *points, int64_t count, uint8_t *inside) {
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        int number = fabs(p[0]) < FAR_LIMIT && fabs(p[1]) < FAR_LIMIT && fabs(p[2]) < FAR_LIMIT;
        inside[i] = number && find_side(t, p) < 0;
    }
}

/* Which of the faces low to high - 1 have the outside below them, or the inside above. */
void bvh_look(const Bvh *t, int32_t low, int32_t high, double beside, uint8_t *wrong) {
    for (int32_t face = low; face < high; face++)
        wrong[face] = (uint8_t)looks_wrong(t, face, beside);
}

void bvh_winding(const Bvh *t, const double *points, int64_t count, double *rough, double *exact) {
    for (int64_t i = 0; i < count; i++) {
        if (rough) rough[i] = rough_winding(t, points + 3 * i, ROUGH_BETA);
        if (exact) exact[i] = exact_winding(t, points + 3 * i);
    }
}

/* Winding numbers. Clusters farther away than `beta` radii count as dipoles. A larger `beta` is
 * more exact and takes longer; the tree limits the cost. */
void bvh_turns(const Bvh *t, const double *points, int64_t count, double beta, double *turns) {
    for (int64_t i = 0; i < count; i++) turns[i] = rough_winding(t, points + 3 * i, (float)beta);
}

/* Winding numbers in a closed mesh: whole numbers, but on the surface, where they are as in
 * bvh_turns; NaN at a point that has NaN. */
void bvh_whole(const Bvh *t, const double *points, int64_t count, double beta, double *turns) {
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        int number = isnan(p[0] + p[1] + p[2]) ? UNKNOWN : crossings(t, p, p);
        turns[i] = number == UNKNOWN ? rough_winding(t, p, (float)beta) : number;
    }
}

/* Recent points whose sides are certain. */
typedef struct {
    struct {
        double point[3], distance, side;
    } known[KNOWN];
    int newest;
} Recent;

/* Find the side of a point, whose foot is on the side `sign` as the pseudonormal says: from a
 * recent point, or else from the crossings of a ray that starts away from the surface. Where these
 * are unknown or contradict `sign`, the winding number answers; where it contradicts, too, the
 * exact one decides. Returns the side. */
static double check_side(
    const Bvh *t, const double *p, const Foot *foot, double sign, Recent *recent, int64_t *counts) {
    double side = 0;
    for (int j = 0; j < KNOWN && !side; j++) {
        int k = (recent->newest + j) % KNOWN;
        const double *other = recent->known[k].point;
        double x[3] = {p[0] - other[0], p[1] - other[1], p[2] - other[2]};
        /* a ball whose radius is its centre's distance contains no surface, so balls that overlap
         * are on the same side */
        double reach = foot->distance + recent->known[k].distance;
        if (dot(x, x) * (1 + 1e-12) < reach * reach) side = recent->known[k].side;
    }
    if (!side) {
        double way[3]; /* to the outside, where a ray meets less */
        for (int k = 0; k < 3; k++) way[k] = sign * foot->offset[k];
        int number = crossings(t, p, way);
        if (number != UNKNOWN) side = number > 0 ? -1 : 1;
        if (side != sign) side = find_side(t, p);
        counts[0]++;
    }
    if (side != sign) {
        side = exact_winding(t, p) > 0.5 ? -1 : 1;
        if (side != sign) counts[1]++;
    }
    recent->newest = (recent->newest + KNOWN - 1) % KNOWN;
    memcpy(recent->known[recent->newest].point, p, 3 * sizeof *p);
    recent->known[recent->newest].distance = foot->distance;
    recent->known[recent->newest].side = side;
    return side;
}

/* Label the points order[0 .. count - 1]. Outputs are indexed like the points; face, weights and
 * flags may be NULL. With `close`, distances next to the surface have all digits of single
 * precision. `counts` gets the number of signs compared with a winding number, and of signs that
 * the exact winding number overruled. */
void bvh_label(const Bvh *t, const double *points, const int64_t *order, int64_t count,
    double on_surface, int check, int close, double tie_relative, double tie_cosine,
    double *distance, double *normal, int32_t *face, double *weights, uint8_t *flags,
    int64_t *counts) {
    pandis__mesh m = view(t);
    int32_t last = 0;
    double closest[3]; /* to the last point; at first any surface point */
    memcpy(closest, corner(t, 0, 0), sizeof closest);
    Recent recent = {.newest = 0};
    Opened opened;
    for (int64_t at = 0; at < count; at++) {
        int64_t i = order ? order[at] : at;
        const double *p = points + 3 * i;
        if (!(fabs(p[0]) < FAR_LIMIT && fabs(p[1]) < FAR_LIMIT && fabs(p[2]) < FAR_LIMIT)) {
            distance[i] = normal[3 * i] = normal[3 * i + 1] = normal[3 * i + 2] = NAN;
            if (face) face[i] = -1;
            if (weights) weights[3 * i] = weights[3 * i + 1] = weights[3 * i + 2] = NAN;
            if (flags) flags[i] = FLAG_INVALID;
            continue;
        }
        Foot foot;
        double n[3];
        uint8_t flag = 0;
        /* the previous closest point bounds the distance, with room for rounding */
        double way[3] = {p[0] - closest[0], p[1] - closest[1], p[2] - closest[2]};
        double limit = sqrt(dot(way, way)) * (1 + 1e-9) + 1e-12 * t->scale;
        last = find_nearest(&m, p, limit, tie_relative, &opened);
        if (last == INT32_MAX) last = find_nearest(&m, p, INFINITY, tie_relative, &opened);
        pandis__find_mesh_foot(&m, last, p, &foot);
        for (int k = 0; k < 3; k++) closest[k] = p[k] - foot.offset[k];
        pandis__pseudonormal(&m, last, &foot, n);
        double sign = pandis__sign(&m, p, &foot, n);
        if (check && foot.distance > on_surface) {
            double side = check_side(t, p, &foot, sign, &recent, counts);
            if (side != sign) flag |= FLAG_OVERRULED, sign = side;
        }
        if (foot.distance > on_surface) {
            for (int k = 0; k < 3; k++) normal[3 * i + k] = sign * (foot.offset[k] / foot.distance);
            Tie tie = {p, &foot, last, foot.distance * (1 + tie_relative), tie_cosine};
            if (tie_relative > 0 && has_tie(&m, &tie, &opened)) flag |= FLAG_TIED;
        } else {
            memcpy(normal + 3 * i, n, sizeof n);
            flag |= FLAG_ON_SURFACE;
        }
        distance[i] = sign * (close ? find_distance(t, last, p, &foot) : foot.distance);
        if (face) face[i] = last;
        if (weights) memcpy(weights + 3 * i, foot.weights, sizeof foot.weights);
        if (flags) flags[i] = flag;
    }
}

/* The address of a part of the tree, as stored in a file for pandis.h, and its size in bytes. */
const void *bvh_part(const Bvh *t, int32_t which, int64_t *bytes) {
    int64_t v = t->vertex_count, f = t->face_count;
    switch (which) {
    case 0: return *bytes = 24 * v, t->vertices;
    case 1: return *bytes = 24 * v, t->vertex_normals;
    case 2: return *bytes = 12 * f, t->faces;
    case 3: return *bytes = 12 * f, t->neighbours;
    case 4: return *bytes = (int64_t)sizeof(Node) * t->node_count, t->nodes;
    case 5: return *bytes = (int64_t)sizeof(Leaf) * t->leaf_count, t->leaves;
    default: return *bytes = 0, NULL;
    }
}

/* Range of the leaves below a child; leaves are numbered in the order of a walk. */
static void leaves_below(const Bvh *t, int32_t child, int32_t *first, int32_t *end) {
    int32_t last = child;
    while (child >= 0) child = t->nodes[child].child[0];
    while (last >= 0) {
        int i = WIDTH - 1;
        while (i > 0 && t->nodes[last].low[0][i] > t->nodes[last].high[0][i]) i--;
        last = t->nodes[last].child[i];
    }
    *first = ~child, *end = ~last + 1;
}

/* Find the slab of a child: two planes across the mean normal of its faces, with all faces between
 * them. */
static void find_slab(const Bvh *t, int32_t child, int place, pandis__slabs *out) {
    int32_t first, end;
    double sum[3] = {0}, low = INFINITY, high = -INFINITY;
    float n[3];
    leaves_below(t, child, &first, &end);
    for (int32_t i = first * WIDTH; i < end * WIDTH; i++) {
        int32_t face = t->leaves[i / WIDTH].face[i % WIDTH];
        double u[3], v[3], across[3];
        if (face < 0) continue;
        for (int k = 0; k < 3; k++)
            u[k] = corner(t, face, 1)[k] - corner(t, face, 0)[k],
            v[k] = corner(t, face, 2)[k] - corner(t, face, 0)[k];
        cross(u, v, across);
        for (int k = 0; k < 3; k++) sum[k] += across[k];
    }
    if (!pandis__normalise(sum)) sum[0] = sum[1] = sum[2] = 0;
    for (int k = 0; k < 3; k++) out->normal[k][place] = n[k] = (float)(sum[k] * (1 - 1e-6));
    for (int32_t i = first * WIDTH; i < end * WIDTH; i++) {
        int32_t face = t->leaves[i / WIDTH].face[i % WIDTH];
        for (int c = 0; c < 3 && face >= 0; c++) {
            const double *p = corner(t, face, c);
            double at = (double)n[0] * p[0] + (double)n[1] * p[1] + (double)n[2] * p[2];
            low = at < low ? at : low, high = at > high ? at : high;
        }
    }
    out->low[place] = (float)(low - 1e-6 * t->scale);
    out->high[place] = (float)(high + 1e-6 * t->scale);
}

/* Find the slabs of all nodes (parts/types.h); an unused child has a slab that is never far. */
void bvh_slabs(const Bvh *t, pandis__slabs *out) {
    memset(out, 0, sizeof *out * (size_t)t->node_count);
    for (int32_t i = 0; i < t->node_count; i++)
        for (int k = 0; k < WIDTH; k++)
            if (!(t->nodes[i].low[0][k] > t->nodes[i].high[0][k]))
                find_slab(t, t->nodes[i].child[k], k, out + i);
}

double bvh_reach(const Bvh *t) { return t->scale; }

#include "scan.h"

/* -------------------- order */

#define DIGIT_BITS 15
#define DIGIT (1 << DIGIT_BITS)

static uint32_t spread(uint32_t x) {
    x = (x | (x << 16)) & 0x030000FF, x = (x | (x << 8)) & 0x0300F00F;
    x = (x | (x << 4)) & 0x030C30C3, x = (x | (x << 2)) & 0x09249249;
    return x;
}

/* Sort points along a Morton curve through [-1, 1]^3, so that consecutive points are close. */
int bvh_order(const double *points, int64_t count, int64_t *order) {
    uint32_t *key = malloc((size_t)count * 2 * sizeof *key);
    int64_t *spare = malloc((size_t)count * sizeof *spare);
    if (!key || !spare) return free(key), free(spare), 0;
    uint32_t *other = key + count, *a = key, *b = other;
    int64_t *from = order, *to = spare;
    for (int64_t i = 0; i < count; i++) {
        uint32_t code = 0;
        for (int k = 0; k < 3; k++) {
            double x = (points[3 * i + k] + 1) * 511.5;
            code |= spread(x > 0 ? x < 1023 ? (uint32_t)x : 1023 : 0) << k; /* NaN: 0 */
        }
        a[i] = code, from[i] = i;
    }
    int64_t start[DIGIT + 1];
    for (int shift = 0; shift < 30; shift += DIGIT_BITS) {
        memset(start, 0, sizeof start);
        for (int64_t i = 0; i < count; i++) start[((a[i] >> shift) & (DIGIT - 1)) + 1]++;
        for (int k = 0; k < DIGIT; k++) start[k + 1] += start[k];
        for (int64_t i = 0; i < count; i++) {
            int64_t j = start[(a[i] >> shift) & (DIGIT - 1)]++;
            b[j] = a[i], to[j] = from[i];
        }
        uint32_t *swap = a;
        int64_t *exchange = from;
        a = b, b = swap, from = to, to = exchange;
    }
    if (from != order) memcpy(order, from, (size_t)count * sizeof *order);
    free(key), free(spare);
    return 1;
}

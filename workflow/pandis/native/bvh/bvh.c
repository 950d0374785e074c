/* A bounding volume hierarchy over triangles: exact closest points and winding numbers.
 *
 * Eight-wide nodes hold boxes in float, rounded outward; leaves hold four triangles in double.
 * A box is skipped only if it is certainly farther than the best answer, and among equally near
 * triangles the one with the least index wins, so the answer depends on nothing but the point
 * and the triangles: neither on the order of the points, nor on threads, nor on vector width.
 *
 * Compile without reassociation (-ffp-contract=off, no -ffast-math): then every machine with
 * IEEE arithmetic gives the same bits.
 *
 * Signs: Baerentzen and Aanaes 2005 (angle-weighted pseudonormals). Winding numbers: Barill et
 * al. 2018 (dipoles of clusters), solid angles after Van Oosterom and Strackee 1983.
 */
#define PANDIS_NO_FILE

#include <stddef.h>
#include <stdint.h>

#include "../parts/types.h"
#include "../parts/basis.h"
#include "../parts/mesh.h"

#include <stdlib.h>

#define WIDTH PANDIS__WIDTH
#define LEAF PANDIS__LEAF
#define BINS 16
#define MEDIAN_DEPTH 40 /* from here on halves, so that the depth is bounded */
#define STACK PANDIS__STACK
#define KNOWN 32
#define ROUGH_BETA 1.4f
#define FINE_BETA 2.5f
#define FAR_LIMIT PANDIS__FAR

enum { FLAG_INVALID = 1, FLAG_TIED = 2, FLAG_OVERRULED = 4, FLAG_ON_SURFACE = 8 };

typedef pandis__node Node;
typedef pandis__leaf Leaf;
typedef pandis__entry Entry;
typedef pandis__foot Foot;

typedef struct {
    float centre[3][WIDTH], dipole[3][WIDTH], reach[WIDTH]; /* reach: radius squared */
} Cluster;

typedef struct {
    int32_t vertex_count, face_count, node_count, leaf_count;
    double scale; /* largest coordinate */
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
#define box_bounds pandis__box_bounds
#define leaf_distances pandis__leaf_distances
#define push_children pandis__push

/* The tree as pandis.h asks it. */
static pandis__mesh view(const Bvh *t) {
    return (pandis__mesh){
        .vertex_count = t->vertex_count, .face_count = t->face_count, .node_count = t->node_count,
        .leaf_count = t->leaf_count, .reach = t->scale, .vertices = t->vertices, .faces = t->faces,
        .neighbours = t->neighbours, .vertex_normals = t->vertex_normals, .nodes = t->nodes, .leaves = t->leaves};
}

static const double *corner(const Bvh *t, int32_t face, int k) {
    return t->vertices + 3 * (size_t)t->faces[3 * (ptrdiff_t)face + k];
}

/* ---------------------------------------------------------------- building */

/* A face and where it lies; moved as a whole, so that a range is read from one end to the other. */
typedef struct {
    float low[3], high[3], centroid[3];
    int32_t face;
} Item;

typedef struct {
    Bvh *tree;
    Item *items;
    int node_room, leaf_room, failed;
} Builder;

typedef struct {
    int32_t start, count;
    float low[3], high[3], area;
} Range;

static float half_area(const float *low, const float *high) {
    float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x * y + y * z + z * x;
}

static void bound(Builder *b, Range *r) {
    for (int k = 0; k < 3; k++) r->low[k] = INFINITY, r->high[k] = -INFINITY;
    for (int32_t i = r->start; i < r->start + r->count; i++) {
        const Item *item = b->items + i;
        for (int k = 0; k < 3; k++) {
            if (item->low[k] < r->low[k]) r->low[k] = item->low[k];
            if (item->high[k] > r->high[k]) r->high[k] = item->high[k];
        }
    }
    r->area = half_area(r->low, r->high);
}

/* Split by the binned surface area heuristic; halve where that finds nothing. */
static void split(Builder *b, const Range *r, int depth, Range *left, Range *right) {
    float low[3], high[3], best = INFINITY;
    int best_axis = -1, best_bin = 0;
    for (int k = 0; k < 3; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (int32_t i = r->start; i < r->start + r->count; i++) {
        const float *c = b->items[i].centroid;
        for (int k = 0; k < 3; k++) {
            if (c[k] < low[k]) low[k] = c[k];
            if (c[k] > high[k]) high[k] = c[k];
        }
    }
    for (int axis = 0; axis < 3 && depth < MEDIAN_DEPTH; axis++) {
        if (!(high[axis] > low[axis])) continue;
        float bin_low[BINS][3], bin_high[BINS][3], area[BINS];
        int32_t count[BINS] = {0};
        float factor = BINS * 0.9999f / (high[axis] - low[axis]);
        for (int i = 0; i < BINS; i++)
            for (int k = 0; k < 3; k++) bin_low[i][k] = INFINITY, bin_high[i][k] = -INFINITY;
        for (int32_t i = r->start; i < r->start + r->count; i++) {
            const Item *item = b->items + i;
            int bin = (int)((item->centroid[axis] - low[axis]) * factor);
            count[bin]++;
            for (int k = 0; k < 3; k++) {
                if (item->low[k] < bin_low[bin][k]) bin_low[bin][k] = item->low[k];
                if (item->high[k] > bin_high[bin][k]) bin_high[bin][k] = item->high[k];
            }
        }
        float l[3] = {INFINITY, INFINITY, INFINITY}, h[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (int i = BINS - 1; i > 0; i--) { /* area of all bins from i on */
            for (int k = 0; k < 3; k++) {
                if (bin_low[i][k] < l[k]) l[k] = bin_low[i][k];
                if (bin_high[i][k] > h[k]) h[k] = bin_high[i][k];
            }
            area[i] = h[0] >= l[0] ? half_area(l, h) : 0;
        }
        int32_t before = 0;
        for (int k = 0; k < 3; k++) l[k] = INFINITY, h[k] = -INFINITY;
        for (int i = 0; i < BINS - 1; i++) {
            before += count[i];
            for (int k = 0; k < 3; k++) {
                if (bin_low[i][k] < l[k]) l[k] = bin_low[i][k];
                if (bin_high[i][k] > h[k]) h[k] = bin_high[i][k];
            }
            if (!before || before == r->count) continue;
            float cost = half_area(l, h) * (float)before + area[i + 1] * (float)(r->count - before);
            if (cost < best) best = cost, best_axis = axis, best_bin = i;
        }
    }
    int32_t middle = r->start + r->count / 2;
    if (best_axis >= 0) {
        float factor = BINS * 0.9999f / (high[best_axis] - low[best_axis]);
        int32_t i = r->start, j = r->start + r->count;
        while (i < j) {
            float c = b->items[i].centroid[best_axis];
            if ((int)((c - low[best_axis]) * factor) <= best_bin) {
                i++;
            } else {
                Item swap = b->items[--j];
                b->items[j] = b->items[i];
                b->items[i] = swap;
            }
        }
        middle = i;
    }
    *left = (Range){.start = r->start, .count = middle - r->start};
    *right = (Range){.start = middle, .count = r->start + r->count - middle};
    bound(b, left);
    bound(b, right);
}

static int32_t add_leaf(Builder *b, const Range *r) {
    Bvh *t = b->tree;
    if (t->leaf_count == b->leaf_room) {
        int room = b->leaf_room * 2;
        Leaf *grown = realloc(t->leaves, (size_t)room * sizeof(Leaf));
        if (!grown) return b->failed = 1, 0;
        t->leaves = grown, b->leaf_room = room;
    }
    Leaf *leaf = t->leaves + t->leaf_count;
    memset(leaf, 0, sizeof *leaf);
    leaf->count = r->count;
    for (int lane = 0; lane < LEAF; lane++) {
        int32_t face = b->items[r->start + (lane < r->count ? lane : 0)].face;
        const double *p = corner(t, face, 0), *q = corner(t, face, 1), *s = corner(t, face, 2);
        double ab[3], ac[3], bc[3];
        for (int k = 0; k < 3; k++) {
            ab[k] = q[k] - p[k], ac[k] = s[k] - p[k], bc[k] = s[k] - q[k];
            leaf->a[k][lane] = p[k], leaf->ab[k][lane] = ab[k], leaf->ac[k][lane] = ac[k];
        }
        double aa = dot(ab, ab), cc = dot(ac, ac), bb = dot(bc, bc), mix = dot(ab, ac), n[3];
        cross(ab, ac, n);
        double det = dot(n, n);
        leaf->per_ab[lane] = aa > 0 ? 1 / aa : 0;
        leaf->per_ac[lane] = cc > 0 ? 1 / cc : 0;
        leaf->per_bc[lane] = bb > 0 ? 1 / bb : 0;
        /* without an area no point projects into it: NaN fails every comparison */
        leaf->gram_ab[lane] = det > 0 ? aa / det : NAN;
        leaf->gram_mix[lane] = det > 0 ? mix / det : NAN;
        leaf->gram_ac[lane] = det > 0 ? cc / det : NAN;
        leaf->face[lane] = face;
    }
    return t->leaf_count++;
}

static int32_t add_node(Builder *b, Range root, int depth) {
    Bvh *t = b->tree;
    if (t->node_count == b->node_room) {
        int room = b->node_room * 2;
        Node *nodes = realloc(t->nodes, (size_t)room * sizeof(Node));
        if (nodes) t->nodes = nodes;
        Cluster *clusters = realloc(t->clusters, (size_t)room * sizeof(Cluster));
        if (clusters) t->clusters = clusters;
        if (!nodes || !clusters) return b->failed = 1, 0;
        b->node_room = room;
    }
    int32_t index = t->node_count++;
    Range part[WIDTH];
    int count = 1;
    part[0] = root;
    while (count < WIDTH) {
        int widest = -1;
        for (int i = 0; i < count; i++)
            if (part[i].count > LEAF && (widest < 0 || part[i].area > part[widest].area)) widest = i;
        if (widest < 0) break;
        Range left, right;
        split(b, &part[widest], depth, &left, &right);
        part[widest] = left, part[count++] = right;
    }
    Node node;
    Cluster cluster;
    memset(&node, 0, sizeof node), memset(&cluster, 0, sizeof cluster);
    /* the float box of a point may be off by half a unit in the last place of the coordinates */
    float pad = (float)(t->scale * 4e-7);
    for (int i = 0; i < WIDTH; i++) {
        for (int k = 0; k < 3; k++) {
            node.low[k][i] = i < count ? part[i].low[k] - pad : INFINITY;
            node.high[k][i] = i < count ? part[i].high[k] + pad : -INFINITY;
        }
        if (i >= count) continue;
        double area = 0, centre[3] = {0}, dipole[3] = {0};
        for (int32_t j = part[i].start; j < part[i].start + part[i].count; j++) {
            int32_t face = b->items[j].face;
            const double *p = corner(t, face, 0), *q = corner(t, face, 1), *s = corner(t, face, 2);
            double ab[3], ac[3], n[3];
            for (int k = 0; k < 3; k++) ab[k] = q[k] - p[k], ac[k] = s[k] - p[k];
            cross(ab, ac, n);
            double twice = sqrt(dot(n, n));
            area += twice;
            for (int k = 0; k < 3; k++) {
                dipole[k] += n[k] / 2;
                centre[k] += twice * (p[k] + q[k] + s[k]) / 3;
            }
        }
        double reach = 0;
        for (int k = 0; k < 3; k++)
            centre[k] = area > 0 ? centre[k] / area : (part[i].low[k] + part[i].high[k]) / 2;
        for (int32_t j = part[i].start; j < part[i].start + part[i].count; j++)
            for (int c = 0; c < 3; c++) {
                const double *p = corner(t, b->items[j].face, c);
                double d = 0;
                for (int k = 0; k < 3; k++) d += (p[k] - centre[k]) * (p[k] - centre[k]);
                if (d > reach) reach = d;
            }
        for (int k = 0; k < 3; k++) {
            cluster.centre[k][i] = (float)centre[k];
            cluster.dipole[k][i] = (float)dipole[k];
        }
        cluster.reach[i] = (float)(reach * 1.0001 + 1e-30);
    }
    for (int i = 0; i < count && !b->failed; i++)
        node.child[i] = part[i].count <= LEAF ? ~add_leaf(b, &part[i]) : add_node(b, part[i], depth + 1);
    t->nodes[index] = node, t->clusters[index] = cluster;
    return index;
}

/* The face across each edge: half-edges bucketed by their lower vertex. */
static int find_neighbours(Bvh *t) {
    size_t halves = 3 * (size_t)t->face_count;
    int64_t *start = calloc((size_t)t->vertex_count + 2, sizeof *start);
    int32_t *bucket = malloc(halves * sizeof *bucket);
    if (!start || !bucket) return free(start), free(bucket), 0;
    for (size_t h = 0; h < halves; h++) {
        int32_t u = t->faces[h], v = t->faces[h % 3 == 2 ? h - 2 : h + 1];
        start[(u < v ? u : v) + 2]++;
    }
    for (int32_t v = 0; v < t->vertex_count; v++) start[v + 2] += start[v + 1];
    for (size_t h = 0; h < halves; h++) {
        int32_t u = t->faces[h], v = t->faces[h % 3 == 2 ? h - 2 : h + 1];
        bucket[start[(u < v ? u : v) + 1]++] = (int32_t)h;
        t->neighbours[h] = -1;
    }
    for (int32_t v = 0; v < t->vertex_count; v++)
        for (int64_t i = start[v]; i < start[v + 1]; i++)
            for (int64_t j = i + 1; j < start[v + 1]; j++) {
                size_t g = (size_t)bucket[i], h = (size_t)bucket[j];
                int32_t g1 = t->faces[g % 3 == 2 ? g - 2 : g + 1], h1 = t->faces[h % 3 == 2 ? h - 2 : h + 1];
                if (t->faces[g] == h1 && t->faces[h] == g1 && t->neighbours[g] < 0 && t->neighbours[h] < 0) {
                    t->neighbours[g] = (int32_t)(h / 3);
                    t->neighbours[h] = (int32_t)(g / 3);
                }
            }
    free(start), free(bucket);
    return 1;
}

static void find_vertex_normals(Bvh *t) {
    pandis__mesh m = view(t);
    memset(t->vertex_normals, 0, 3 * (size_t)t->vertex_count * sizeof(double));
    for (int32_t f = 0; f < t->face_count; f++) {
        double n[3];
        if (!pandis__face_normal(&m, f, n)) continue;
        for (int k = 0; k < 3; k++) {
            const double *p = corner(t, f, k), *q = corner(t, f, (k + 1) % 3), *s = corner(t, f, (k + 2) % 3);
            double u[3], v[3], c[3];
            for (int i = 0; i < 3; i++) u[i] = q[i] - p[i], v[i] = s[i] - p[i];
            cross(u, v, c);
            double angle = atan2(sqrt(dot(c, c)), dot(u, v));
            double *sum = t->vertex_normals + 3 * (size_t)t->faces[3 * (ptrdiff_t)f + k];
            for (int i = 0; i < 3; i++) sum[i] += angle * n[i];
        }
    }
    for (int32_t v = 0; v < t->vertex_count; v++) normalise(t->vertex_normals + 3 * (size_t)v);
}

void bvh_free(Bvh *t) {
    if (!t) return;
    free(t->vertices), free(t->faces), free(t->neighbours), free(t->vertex_normals);
    free(t->nodes), free(t->clusters), free(t->leaves);
    free(t);
}

/* Build; NULL if memory is short. Indices and coordinates must have been checked. */
Bvh *bvh_build(const double *vertices, int32_t vertex_count, const int32_t *faces, int32_t face_count) {
    Bvh *t = calloc(1, sizeof *t);
    if (!t) return NULL;
    size_t v = (size_t)vertex_count, f = (size_t)face_count;
    Builder b = {.tree = t, .node_room = 64, .leaf_room = face_count / 2 + 64};
    t->vertex_count = vertex_count, t->face_count = face_count;
    t->vertices = malloc(3 * v * sizeof(double)), t->faces = malloc(3 * f * sizeof(int32_t));
    t->neighbours = malloc(3 * f * sizeof(int32_t)), t->vertex_normals = malloc(3 * v * sizeof(double));
    t->nodes = malloc((size_t)b.node_room * sizeof(Node));
    t->clusters = malloc((size_t)b.node_room * sizeof(Cluster));
    t->leaves = malloc((size_t)b.leaf_room * sizeof(Leaf));
    b.items = malloc(f * sizeof(Item));
    if (!t->vertices || !t->faces || !t->neighbours || !t->vertex_normals || !t->nodes || !t->clusters ||
        !t->leaves || !b.items) {
        b.failed = 1;
    } else {
        memcpy(t->vertices, vertices, 3 * v * sizeof(double));
        memcpy(t->faces, faces, 3 * f * sizeof(int32_t));
        for (size_t i = 0; i < 3 * v; i++)
            if (fabs(vertices[i]) > t->scale) t->scale = fabs(vertices[i]);
        for (size_t i = 0; i < f; i++) {
            Item *item = b.items + i;
            item->face = (int32_t)i;
            for (int k = 0; k < 3; k++) {
                float p = (float)corner(t, (int32_t)i, 0)[k], q = (float)corner(t, (int32_t)i, 1)[k],
                      s = (float)corner(t, (int32_t)i, 2)[k];
                float low = p < q ? p : q, high = p < q ? q : p;
                item->low[k] = s < low ? s : low, item->high[k] = s > high ? s : high;
                item->centroid[k] = (p + q + s) / 3;
            }
        }
        Range all = {.start = 0, .count = face_count};
        bound(&b, &all);
        add_node(&b, all, 0);
        if (!b.failed && !find_neighbours(t)) b.failed = 1;
        if (!b.failed) find_vertex_normals(t);
    }
    free(b.items);
    if (b.failed) return bvh_free(t), NULL;
    return t;
}

/* Whether another closest point, in a direction that differs by the angle, is as near. */
static int has_tie(const Bvh *t, const pandis__mesh *m, const double *p, const Foot *foot, double relative, double cosine) {
    Entry stack[STACK];
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]}, bounds[WIDTH];
    double reach = foot->distance * (1 + relative), limit = reach * reach, d[LEAF];
    int top = 0;
    stack[top++] = (Entry){0, 0};
    while (top) {
        Entry e = stack[--top];
        if (e.child >= 0) {
            box_bounds(t->nodes + e.child, q, bounds);
            top = push_children(t->nodes + e.child, bounds, limit, stack, top);
            continue;
        }
        const Leaf *leaf = t->leaves + ~e.child;
        leaf_distances(leaf, p, d);
        for (int i = 0; i < leaf->count; i++) {
            if (!(d[i] <= limit)) continue;
            Foot second;
            pandis__find_foot(m, leaf->face[i], p, &second);
            if (dot(second.offset, foot->offset) < cosine * second.distance * foot->distance) return 1;
        }
    }
    return 0;
}

/* ---------------------------------------------------------------- winding number */

/* Half the solid angle of a triangle seen from the origin. */
static double half_angle(const double *a, const double *b, const double *c) {
    double n[3];
    cross(b, c, n);
    double la = sqrt(dot(a, a)), lb = sqrt(dot(b, b)), lc = sqrt(dot(c, c));
    return atan2(dot(a, n), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
}

static double exact_winding(const Bvh *t, const double *p) {
    double sum = 0;
    for (int32_t f = 0; f < t->face_count; f++) {
        double c[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) c[i][k] = corner(t, f, i)[k] - p[k];
        sum += half_angle(c[0], c[1], c[2]);
    }
    return sum / 6.283185307179586;
}

/* atan2 to 2e-6, without branches, so that four go at once. */
static double rough_atan2(double y, double x) {
    double ax = fabs(x), ay = fabs(y);
    double high = ax > ay ? ax : ay, low = ax > ay ? ay : ax;
    double z = low / (high > 0 ? high : 1), q = z * z;
    double r = z * (0.99997726 + q * (-0.33262347 + q * (0.19354346 + q * (-0.11643287 + q * (0.05265332 - q * 0.01172120)))));
    r = ay > ax ? 1.5707963267948966 - r : r;
    r = x < 0 ? 3.141592653589793 - r : r;
    return y < 0 ? -r : r;
}

static double leaf_winding(const Leaf *restrict f, const double *restrict p) {
    double sum[LEAF];
    for (int i = 0; i < LEAF; i++) {
        double ax = f->a[0][i] - p[0], ay = f->a[1][i] - p[1], az = f->a[2][i] - p[2];
        double bx = ax + f->ab[0][i], by = ay + f->ab[1][i], bz = az + f->ab[2][i];
        double cx = ax + f->ac[0][i], cy = ay + f->ac[1][i], cz = az + f->ac[2][i];
        double la = sqrt(ax * ax + ay * ay + az * az), lb = sqrt(bx * bx + by * by + bz * bz);
        double lc = sqrt(cx * cx + cy * cy + cz * cz);
        double det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx);
        double down = la * lb * lc + (ax * bx + ay * by + az * bz) * lc + (bx * cx + by * cy + bz * cz) * la +
                      (cx * ax + cy * ay + cz * az) * lb;
        sum[i] = i < f->count ? rough_atan2(det, down) : 0;
    }
    return (sum[0] + sum[1] + sum[2] + sum[3]) / 6.283185307179586;
}

/* Clusters farther than `beta` radii count as dipoles. */
static double rough_winding(const Bvh *t, const double *p, float beta) {
    int32_t stack[STACK];
    int top = 0;
    double sum = 0;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    stack[top++] = 0;
    while (top) {
        int32_t index = stack[--top];
        if (index < 0) {
            sum += leaf_winding(t->leaves + ~index, p);
            continue;
        }
        const Cluster *restrict c = t->clusters + index;
        const Node *node = t->nodes + index;
        float part[WIDTH], distance[WIDTH];
        for (int i = 0; i < WIDTH; i++) {
            float x = c->centre[0][i] - q[0], y = c->centre[1][i] - q[1], z = c->centre[2][i] - q[2];
            float d = x * x + y * y + z * z;
            distance[i] = d;
            float safe = d > 1e-20f ? d : 1e-20f;
            part[i] = (c->dipole[0][i] * x + c->dipole[1][i] * y + c->dipole[2][i] * z) / (safe * sqrtf(safe));
        }
        for (int i = 0; i < WIDTH; i++) {
            if (node->low[0][i] > node->high[0][i]) continue;
            if (distance[i] > beta * beta * c->reach[i]) {
                sum += (double)part[i] / 12.566370614359172;
            } else {
                stack[top++] = node->child[i];
            }
        }
    }
    return sum;
}

/* -1 inside, 1 outside: as roughly as it may be, as exactly as it must. */
static double find_side(const Bvh *t, const double *p) {
    double w = rough_winding(t, p, ROUGH_BETA);
    if (fabs(w - 0.5) < 0.3) {
        w = rough_winding(t, p, FINE_BETA);
        if (fabs(w - 0.5) < 0.3) w = exact_winding(t, p);
    }
    return w > 0.5 ? -1 : 1;
}

/* ---------------------------------------------------------------- answers */

/* Whether the points lie inside, by the winding number alone; 0 where they are no numbers. */
void bvh_inside(const Bvh *t, const double *points, int64_t count, uint8_t *inside) {
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        int number = fabs(p[0]) < FAR_LIMIT && fabs(p[1]) < FAR_LIMIT && fabs(p[2]) < FAR_LIMIT;
        inside[i] = number && find_side(t, p) < 0;
    }
}

void bvh_winding(const Bvh *t, const double *points, int64_t count, double *rough, double *exact) {
    for (int64_t i = 0; i < count; i++) {
        if (rough) rough[i] = rough_winding(t, points + 3 * i, ROUGH_BETA);
        if (exact) exact[i] = exact_winding(t, points + 3 * i);
    }
}

/* Clusters farther than `beta` radii count as dipoles: the larger, the nearer to the exact number, at
 * a price that a tree bounds. */
void bvh_turns(const Bvh *t, const double *points, int64_t count, double beta, double *turns) {
    for (int64_t i = 0; i < count; i++) turns[i] = rough_winding(t, points + 3 * i, (float)beta);
}

typedef struct {
    double point[3], distance, side;
} Known;

/* Answer the points order[0 .. count - 1]. Outputs are indexed as the points are; any but
 * distance and normal may be NULL. `counts` gets: signs compared with a winding number, signs
 * that the exact winding number overruled. */
void bvh_label(const Bvh *t, const double *points, const int64_t *order, int64_t count, double on_surface, int check,
               double tie_relative, double tie_cosine, double *distance, double *normal, int32_t *face,
               double *weights, uint8_t *flags, int64_t *counts) {
    pandis__mesh m = view(t);
    int32_t last = 0;
    double closest[3]; /* of the last point; at first any point of the surface */
    memcpy(closest, corner(t, 0, 0), sizeof closest);
    Known known[KNOWN] = {{{0}, 0, 0}}; /* the last points whose sides are certain */
    int newest = 0;
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
        /* the closest point before is a bound, with room for rounding */
        double way[3] = {p[0] - closest[0], p[1] - closest[1], p[2] - closest[2]};
        double limit = sqrt(dot(way, way)) * (1 + 1e-9) + 1e-12 * t->scale;
        last = pandis__nearest(&m, p, limit * limit);
        if (last == INT32_MAX) last = pandis__nearest(&m, p, INFINITY);
        pandis__find_foot(&m, last, p, &foot);
        for (int k = 0; k < 3; k++) closest[k] = p[k] - foot.offset[k];
        pandis__pseudonormal(&m, last, &foot, n);
        double sign = pandis__sign(&m, p, &foot, n);
        if (check && foot.distance > on_surface) {
            double side = 0;
            for (int j = 0; j < KNOWN && !side; j++) {
                const Known *k = known + (newest + j) % KNOWN;
                double x[3] = {p[0] - k->point[0], p[1] - k->point[1], p[2] - k->point[2]};
                /* no surface inside a ball whose radius is a distance: balls that meet are on one side */
                double reach = foot.distance + k->distance;
                if (dot(x, x) * (1 + 1e-12) < reach * reach) side = k->side;
            }
            if (!side) side = find_side(t, p), counts[0]++;
            if (side != sign) {
                side = exact_winding(t, p) > 0.5 ? -1 : 1;
                if (side != sign) counts[1]++, flag |= FLAG_OVERRULED, sign = side;
            }
            newest = (newest + KNOWN - 1) % KNOWN;
            known[newest] = (Known){{p[0], p[1], p[2]}, foot.distance, side};
        }
        if (foot.distance > on_surface) {
            for (int k = 0; k < 3; k++) normal[3 * i + k] = sign * (foot.offset[k] / foot.distance);
            if (tie_relative > 0 && has_tie(t, &m, p, &foot, tie_relative, tie_cosine)) flag |= FLAG_TIED;
        } else {
            memcpy(normal + 3 * i, n, sizeof n);
            flag |= FLAG_ON_SURFACE;
        }
        distance[i] = sign * foot.distance;
        if (face) face[i] = last;
        if (weights) memcpy(weights + 3 * i, foot.weights, sizeof foot.weights);
        if (flags) flags[i] = flag;
    }
}

/* Where a part of the tree lies, and its bytes: what a file for pandis.h holds. */
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

double bvh_reach(const Bvh *t) { return t->scale; }

/* What a program without a tree does: all triangles for every point. */
void bvh_scan(const Bvh *t, const double *points, int64_t count, double *distance, double *normal) {
    pandis__mesh m = view(t);
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        double best = INFINITY, d[LEAF], n[3];
        int32_t face = INT32_MAX;
        for (const Leaf *leaf = t->leaves; leaf < t->leaves + t->leaf_count; leaf++) {
            leaf_distances(leaf, p, d);
            for (int k = 0; k < leaf->count; k++)
                if (d[k] < best || (d[k] == best && leaf->face[k] < face)) best = d[k], face = leaf->face[k];
        }
        Foot foot;
        if (face == INT32_MAX) {
            distance[i] = normal[3 * i] = normal[3 * i + 1] = normal[3 * i + 2] = NAN;
            continue;
        }
        pandis__find_foot(&m, face, p, &foot);
        pandis__pseudonormal(&m, face, &foot, n);
        double sign = pandis__sign(&m, p, &foot, n);
        distance[i] = sign * foot.distance;
        for (int k = 0; k < 3; k++)
            normal[3 * i + k] = foot.distance > 0 ? sign * (foot.offset[k] / foot.distance) : n[k];
    }
}

/* ---------------------------------------------------------------- order */

#define DIGIT_BITS 15
#define DIGIT (1 << DIGIT_BITS)

static uint32_t spread(uint32_t x) {
    x = (x | (x << 16)) & 0x030000FF, x = (x | (x << 8)) & 0x0300F00F;
    x = (x | (x << 4)) & 0x030C30C3, x = (x | (x << 2)) & 0x09249249;
    return x;
}

/* Sort points along a Morton curve through [-1, 1]^3, so that neighbours follow each other. */
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

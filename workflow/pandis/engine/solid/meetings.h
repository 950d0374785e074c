/* Whether faces of a closed surface meet: a part of solid.c.
 *
 * In floating point, as a filter: the caller asks exact predicates about the result. */

#define LEAST_AREA 1e-6 /* square cells, twice the area */

/* Twice the area of a face times its normal. */
static void area_of(const double *places, const Face *f, double *n) {
    const double *p = places + 3 * (int64_t)f->corner[0];
    const double *q = places + 3 * (int64_t)f->corner[1], *r = places + 3 * (int64_t)f->corner[2];
    double u[3], v[3];
    for (int k = 0; k < 3; k++) u[k] = q[k] - p[k], v[k] = r[k] - p[k];
    cross(u, v, n);
}

static double length(const double *a) { return sqrt(dot(a, a)); }

/* Whether a segment meets a triangle (Moeller and Trumbore 1997). */
static int segment_meets(const double *p, const double *q, const double *const *c) {
    double d[3], u[3], v[3], s[3], h[3], g[3];
    for (int k = 0; k < 3; k++)
        d[k] = q[k] - p[k], u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k],
        s[k] = p[k] - c[0][k];
    cross(d, v, h);
    double det = dot(u, h);
    if (det * det <= 1e-18 * dot(d, d) * dot(u, u) * dot(v, v)) return 0;
    double a = dot(s, h) / det;
    if (a < 0 || a > 1) return 0;
    cross(s, u, g);
    double b = dot(d, g) / det, t = dot(v, g) / det;
    return b >= 0 && a + b <= 1 && t >= 0 && t <= 1;
}

/* Whether a segment lies clearly on one side of a triangle's plane. */
static int beside(const double *p, const double *q, const double *corner, const double *normal) {
    const double least = 1e-12;
    double a = 0, b = 0;
    for (int k = 0; k < 3; k++)
        a += normal[k] * (p[k] - corner[k]), b += normal[k] * (q[k] - corner[k]);
    return (a > least && b > least) || (a < -least && b < -least);
}

/* Whether an edge of a face that has no corner in the other face meets that face. */
static int edge_meets(const double *places, const Face *f, const Face *other, int shared) {
    const double *c[3], *p[3];
    double normal[3];
    for (int k = 0; k < 3; k++) {
        c[k] = places + 3 * (int64_t)other->corner[k];
        p[k] = places + 3 * (int64_t)f->corner[k];
    }
    area_of(places, other, normal);
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        if ((shared >> k | shared >> next) & 1) continue;
        if (beside(p[k], p[next], c[0], normal)) continue;
        if (segment_meets(p[k], p[next], c)) return 1;
    }
    return 0;
}

/* Whether two faces meet outside of their common corners and edges, in floating point. */
static int faces_meet(const double *places, const Face *f, const Face *g) {
    int in_f = 0, in_g = 0, count = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (f->corner[i] == g->corner[j]) in_f |= 1 << i, in_g |= 1 << j, count++;
    if (count == 3) return 1;
    if (count < 2) return edge_meets(places, f, g, in_f) || edge_meets(places, g, f, in_g);
    double m[3], n[3];
    area_of(places, f, m), area_of(places, g, n);
    if (!(dot(m, n) < 0)) return 0;
    double sizes = length(m) * length(n);
    return sizes > 0 && dot(m, n) < -0.99999999 * sizes; /* folded onto each other */
}

/* Faces by the cells that their boxes touch: `entries` of slot i begin at `starts[i]`. */
typedef struct {
    const double *places;
    const Face *faces;
    float *boxes; /* low and high corners, rounded outward */
    int64_t *starts, slots;
    int32_t *entries;
} Grid;

static void box_of(Grid *g, int64_t face) {
    float *box = g->boxes + 6 * face;
    for (int k = 0; k < 3; k++) {
        double range[2] = {INFINITY, -INFINITY};
        for (int c = 0; c < 3; c++)
            widen(range, g->places[3 * (int64_t)g->faces[face].corner[c] + k]);
        box[k] = nextafterf((float)range[0], -INFINITY);
        box[3 + k] = nextafterf((float)range[1], INFINITY);
    }
}

static int64_t slot_of(const Grid *g, const int32_t *cell) {
    uint64_t key = (uint64_t)(cell[0] * INT64_C(73856093)) ^
        (uint64_t)(cell[1] * INT64_C(19349663)) ^ (uint64_t)(cell[2] * INT64_C(83492791));
    return (int64_t)(key & (uint64_t)(g->slots - 1));
}

/* Loop over the cells that the box of a face touches. */
#define FOR_CELLS(cell, box)                                                                       \
    for ((cell)[2] = (int32_t)floorf((box)[2]); (cell)[2] <= (box)[5]; (cell)[2]++)                \
        for ((cell)[1] = (int32_t)floorf((box)[1]); (cell)[1] <= (box)[4]; (cell)[1]++)            \
            for ((cell)[0] = (int32_t)floorf((box)[0]); (cell)[0] <= (box)[3]; (cell)[0]++)

/* Sort faces into the slots of their cells. Returns 0 if memory is short. */
static int fill_grid(Grid *g, int64_t count) {
    int32_t cell[3];
    g->boxes = malloc((size_t)count * 6 * sizeof *g->boxes);
    g->starts = calloc((size_t)g->slots + 2, sizeof *g->starts);
    if (!g->boxes || !g->starts) return 0;
    int64_t *starts = g->starts + 2; /* filling moves each start to the next slot's */
    for (int64_t i = 0; i < count; i++) {
        box_of(g, i);
        FOR_CELLS(cell, g->boxes + 6 * i) starts[slot_of(g, cell)]++;
    }
    for (int64_t i = 1; i < g->slots; i++) starts[i] += starts[i - 1];
    g->entries = malloc((size_t)(starts[g->slots - 1] + 1) * sizeof *g->entries);
    if (!g->entries) return 0;
    starts = g->starts + 1;
    for (int64_t i = 0; i < count; i++)
        FOR_CELLS(cell, g->boxes + 6 * i) g->entries[starts[slot_of(g, cell)]++] = (int32_t)i;
    return 1;
}

/* Whether two boxes have a point in common, and a cell is the first that both touch. */
static int first_common(const float *a, const float *b, const int32_t *cell) {
    for (int k = 0; k < 3; k++) {
        if (a[k] > b[3 + k] || b[k] > a[3 + k]) return 0;
        if ((int32_t)floorf(a[k] > b[k] ? a[k] : b[k]) != cell[k]) return 0;
    }
    return 1;
}

/* Mark the faces that meet a face in question, and that face if there is any. */
static void mark_meetings(const Grid *g, int64_t face, const uint8_t *question, uint8_t *bad) {
    int32_t cell[3];
    const float *box = g->boxes + 6 * face;
    FOR_CELLS(cell, box) {
        int64_t slot = slot_of(g, cell);
        for (int64_t e = g->starts[slot]; e < g->starts[slot + 1]; e++) {
            int64_t other = g->entries[e];
            if (other == face || (bad[other] && bad[face])) continue;
            if (question[other] && other < face) continue; /* tried in its turn */
            if (first_common(box, g->boxes + 6 * other, cell) &&
                faces_meet(g->places, g->faces + face, g->faces + other))
                bad[face] = bad[other] = 1;
        }
    }
}

/* Mark the faces that meet a face of those in question, and of these the ones without area. Places
 * are in cells. Returns 0 if memory is short. */
int32_t solid_meetings(const double *places, const int32_t *corners, int64_t count,
    const uint8_t *question, uint8_t *bad) {
    Grid g = {.places = places, .faces = (const Face *)corners, .slots = 4096};
    while (g.slots < 2 * count) g.slots *= 2;
    int done = fill_grid(&g, count);
    for (int64_t i = 0; i < count && done; i++) {
        double n[3];
        if (!question[i]) continue;
        area_of(places, g.faces + i, n);
        bad[i] |= length(n) < LEAST_AREA;
        mark_meetings(&g, i, question, bad);
    }
    free(g.boxes), free(g.starts), free(g.entries);
    return done;
}

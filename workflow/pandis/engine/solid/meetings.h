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

/* Whether an edge of a face that has no corner in the other face meets that face. */
static int edge_meets(const double *places, const Face *f, const Face *other, int shared) {
    const double *c[3];
    for (int k = 0; k < 3; k++) c[k] = places + 3 * (int64_t)other->corner[k];
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        if ((shared >> k | shared >> next) & 1) continue;
        const double *p = places + 3 * (int64_t)f->corner[k],
                     *q = places + 3 * (int64_t)f->corner[next];
        if (segment_meets(p, q, c)) return 1;
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
    double sizes = length(m) * length(n);
    return sizes > 0 && dot(m, n) < -0.99999999 * sizes; /* folded onto each other */
}

/* Faces by the cells that their boxes touch. */
typedef struct {
    const double *places;
    const Face *faces;
    int64_t *next, *entry_face;
    int64_t *head, slots, entry_count, entry_room, next_room;
} Grid;

static void box_of(const Grid *g, int64_t face, double low[3], double high[3]) {
    for (int k = 0; k < 3; k++) {
        double range[2] = {INFINITY, -INFINITY};
        for (int c = 0; c < 3; c++)
            widen(range, g->places[3 * (int64_t)g->faces[face].corner[c] + k]);
        low[k] = range[0], high[k] = range[1];
    }
}

static int64_t slot_of(const Grid *g, int64_t x, int64_t y, int64_t z) {
    uint64_t key = (uint64_t)(x * 73856093) ^ (uint64_t)(y * 19349663) ^ (uint64_t)(z * 83492791);
    return (int64_t)(key & (uint64_t)(g->slots - 1));
}

static int add_to_grid(Grid *g, int64_t face) {
    double low[3], high[3];
    box_of(g, face, low, high);
    for (int64_t z = (int64_t)floor(low[2]); z <= (int64_t)floor(high[2]); z++)
        for (int64_t y = (int64_t)floor(low[1]); y <= (int64_t)floor(high[1]); y++)
            for (int64_t x = (int64_t)floor(low[0]); x <= (int64_t)floor(high[0]); x++) {
                if (!grow(&g->entry_face, g->entry_count, &g->entry_room, sizeof(int64_t)) ||
                    !grow(&g->next, g->entry_count, &g->next_room, sizeof(int64_t)))
                    return 0;
                int64_t slot = slot_of(g, x, y, z);
                g->entry_face[g->entry_count] = face, g->next[g->entry_count] = g->head[slot];
                g->head[slot] = g->entry_count++;
            }
    return 1;
}

/* Mark the faces that meet a face, and that face if there is any. */
static void mark_meetings(const Grid *g, int64_t face, uint8_t *bad) {
    double low[3], high[3], other_low[3], other_high[3];
    box_of(g, face, low, high);
    for (int64_t z = (int64_t)floor(low[2]); z <= (int64_t)floor(high[2]); z++)
        for (int64_t y = (int64_t)floor(low[1]); y <= (int64_t)floor(high[1]); y++)
            for (int64_t x = (int64_t)floor(low[0]); x <= (int64_t)floor(high[0]); x++)
                for (int64_t e = g->head[slot_of(g, x, y, z)]; e >= 0; e = g->next[e]) {
                    int64_t other = g->entry_face[e];
                    if (other == face || (bad[other] && bad[face])) continue;
                    box_of(g, other, other_low, other_high);
                    int apart = 0;
                    for (int k = 0; k < 3; k++)
                        apart |= low[k] > other_high[k] || high[k] < other_low[k];
                    if (!apart && faces_meet(g->places, g->faces + face, g->faces + other))
                        bad[face] = bad[other] = 1;
                }
}

/* Mark the faces that meet a face of those in question, and of these the ones without area. Places
 * are in cells. Returns 0 if memory is short. */
int32_t solid_meetings(const double *places, const int32_t *corners, int64_t count,
    const uint8_t *question, uint8_t *bad) {
    Grid g = {.places = places, .faces = (const Face *)corners, .slots = 4096};
    while (g.slots < 4 * count) g.slots *= 2;
    g.head = malloc((size_t)g.slots * sizeof *g.head);
    int done = g.head != NULL;
    for (int64_t i = 0; i < g.slots && done; i++) g.head[i] = -1;
    for (int64_t i = 0; i < count && done; i++) done = add_to_grid(&g, i);
    for (int64_t i = 0; i < count && done; i++) {
        double n[3];
        if (!question[i]) continue;
        area_of(places, g.faces + i, n);
        bad[i] |= length(n) < LEAST_AREA;
        mark_meetings(&g, i, bad);
    }
    free(g.head), free(g.next), free(g.entry_face);
    return done;
}

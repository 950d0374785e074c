/* Edges between the tips of neighbouring cones: a part of solid.c.
 *
 * An edge across a sharp edge of the source is flipped, so that the tips on both sides are joined
 * along it, if the new triangles stay in the two cells and meet no other. */

/* A cell whose loop is a fan around a tip of its own. */
typedef struct {
    int64_t cell;
    int32_t tip, first, count; /* its faces: (corner, corner, tip) */
} Cone;

static const Cone *cone_in(const Cone *cones, int64_t count, int64_t cell) {
    int64_t low = 0, high = count;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (cones[middle].cell < cell) low = middle + 1;
        else high = middle;
    }
    return low < count && cones[low].cell == cell ? cones + low : NULL;
}

/* Whether another face of a cone meets one of two new faces. */
static int meets_cone(const Lattice *l, const Cone *cone, Face *const *pair) {
    for (int i = 0; i < cone->count; i++) {
        const Face *f = l->faces + cone->first + i;
        if (f == pair[0] || f == pair[1]) continue;
        if (faces_meet(l->places, pair[0]->corner, f->corner, 0) ||
            faces_meet(l->places, pair[1]->corner, f->corner, 0))
            return 1;
    }
    return 0;
}

/* Whether the segment between the tips of two cells' cones passes through the cells' common side:
 * then the new faces stay in the two cells, which hold no faces but those of the cones. */
static int stays_inside(const Lattice *l, const Cone *a, const Cone *b, int axis) {
    const double *p = l->places + 3 * (int64_t)a->tip, *q = l->places + 3 * (int64_t)b->tip;
    int32_t base[3];
    place_of(l, a->cell, base);
    double t = (base[axis] + 1 - p[axis]) / (q[axis] - p[axis]);
    for (int k = 1; k < 3; k++) {
        int u = (axis + k) % 3;
        double at = p[u] + t * (q[u] - p[u]) - base[u];
        if (!(at > 0 && at < 1)) return 0;
    }
    return 1;
}

/* Whether two new faces are sound: with area, not folded, and facing as the old ones did. */
static int is_sound(const Lattice *l, Face *const *pair, const Face *old) {
    double m[3], n[3], p[3], q[3], sum[3];
    area_of(l->places, pair[0], m), area_of(l->places, pair[1], n), area_of(l->places, old, p),
        area_of(l->places, old + 1, q);
    for (int k = 0; k < 3; k++) sum[k] = p[k] + q[k];
    if (length(m) < LEAST_AREA || length(n) < LEAST_AREA) return 0;
    return dot(m, n) >= -0.9 * length(m) * length(n) && (dot(m, sum) >= 0 || dot(n, sum) >= 0);
}

/* Flip the common edge of two cones' faces to join their tips, if the result is sound. */
static void flip(Lattice *l, const Cone *a, const Cone *b) {
    for (int i = 0; i < a->count; i++)
        for (int j = 0; j < b->count; j++) {
            Face *pair[2] = {l->faces + a->first + i, l->faces + b->first + j};
            int32_t *f = pair[0]->corner, *g = pair[1]->corner;
            if (f[2] != a->tip || g[2] != b->tip || f[0] != g[1] || f[1] != g[0]) continue;
            Face old[2] = {*pair[0], *pair[1]};
            *pair[0] = (Face){{old[0].corner[0], b->tip, a->tip}};
            *pair[1] = (Face){{b->tip, old[0].corner[1], a->tip}};
            if (!is_sound(l, pair, old) ||
                faces_meet(l->places, pair[0]->corner, pair[1]->corner, 0) ||
                meets_cone(l, a, pair) || meets_cone(l, b, pair))
                *pair[0] = old[0], *pair[1] = old[1];
            return;
        }
}

static void flip_edges(Lattice *l, const Cone *cones, int64_t count) {
    for (int64_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++) {
            const Cone *next = cone_in(cones, count, cones[i].cell + l->step[axis]);
            if (next && stays_inside(l, cones + i, next, axis)) flip(l, cones + i, next);
        }
}

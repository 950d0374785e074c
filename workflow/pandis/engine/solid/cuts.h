/* Where triangles cut the edges of the lattice: a part of solid.c. */

/* Columns through a triangle's rim are counted as cut; a triangle's neighbour may repeat the cut.*/
#define MARGIN 1e-7

static int add_cut(Lattice *l, int64_t node, int axis, double at, int64_t triangle) {
    int cap = triangle >= l->triangles - l->caps;
    l->blocked[node] |= (uint8_t)((cap ? CAP_BIT : 1) << axis);
    if (!grow(&l->cuts, l->cut_count, &l->cut_room, sizeof *l->cuts)) return 0;
    l->cuts[l->cut_count++] = (Cut){3 * node + axis, at, (int32_t)triangle};
    return 1;
}

static void widen(double *range, double value) {
    if (value < range[0]) range[0] = value;
    if (value > range[1]) range[1] = value;
}

/* The part of a triangle's projection along axis u at height y along axis v. */
static void row_of(const double *const *c, int u, int v, double y, double *range) {
    range[0] = INFINITY, range[1] = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double *p = c[k], *q = c[(k + 1) % 3];
        if ((y < p[v] && y < q[v]) || (y > p[v] && y > q[v])) continue;
        if (p[v] == q[v]) widen(range, p[u]), widen(range, q[u]);
        else widen(range, p[u] + (q[u] - p[u]) * ((y - p[v]) / (q[v] - p[v])));
    }
}

static double clamped(double value, const double *range) {
    return value < range[0] ? range[0] : value > range[1] ? range[1] : value;
}

static int32_t first_in(const double *range) {
    return range[0] - MARGIN > 0 ? (int32_t)ceil(range[0] - MARGIN) : 0;
}

static int32_t last_in(const double *range, int32_t size) {
    return range[1] + MARGIN < size - 1 ? (int32_t)floor(range[1] + MARGIN) : size - 1;
}

/* Add the cuts of a triangle with the edges along one axis. */
static int cut_along(Lattice *l, int64_t triangle, int axis) {
    const double *c[3];
    corners_of(l, triangle, c);
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    double pu = c[1][u] - c[0][u], pv = c[1][v] - c[0][v];
    double qu = c[2][u] - c[0][u], qv = c[2][v] - c[0][v];
    double area = pu * qv - pv * qu;
    if (fabs(area) < 1e-14) return 1;
    double high[2] = {INFINITY, -INFINITY}, deep[2] = {INFINITY, -INFINITY}, row[2];
    for (int k = 0; k < 3; k++) widen(high, c[k][v]), widen(deep, c[k][axis]);
    for (int32_t j = first_in(high); j <= last_in(high, l->size[v]); j++) {
        row_of(c, u, v, clamped(j, high), row);
        for (int32_t i = first_in(row); i <= last_in(row, l->size[u]); i++) {
            double x = i - c[0][u], y = j - c[0][v];
            double s = (x * qv - y * qu) / area, t = (pu * y - pv * x) / area;
            double depth =
                c[0][axis] + s * (c[1][axis] - c[0][axis]) + t * (c[2][axis] - c[0][axis]);
            depth = clamped(depth, deep);
            double below = floor(depth);
            if (below < 0 || below >= l->size[axis] - 1) continue;
            int64_t node = (int64_t)below * l->step[axis] + i * l->step[u] + j * l->step[v];
            double at = depth - below;
            if (!add_cut(l, node, axis, at, triangle)) return 0;
            /* rounding could see a face through a node on its one side along one axis and on the
             * other along the next: it cuts the edges on both sides of the node */
            if (at < MARGIN && below > 0 && !add_cut(l, node - l->step[axis], axis, 1, triangle))
                return 0;
            if (at > 1 - MARGIN && below < l->size[axis] - 2 &&
                !add_cut(l, node + l->step[axis], axis, 0, triangle))
                return 0;
        }
    }
    return 1;
}

static int in_order(const void *left, const void *right) {
    const Cut *a = left, *b = right;
    if (a->edge != b->edge) return a->edge < b->edge ? -1 : 1;
    if (a->at != b->at) return a->at < b->at ? -1 : 1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

static int cut_edges(Lattice *l) {
    for (int64_t t = 0; t < l->triangles; t++)
        for (int axis = 0; axis < 3; axis++)
            if (!cut_along(l, t, axis)) return 0;
    qsort(l->cuts, (size_t)l->cut_count, sizeof *l->cuts, in_order);
    int64_t count = 0;
    for (int64_t i = 0; i < l->cut_count; i++) { /* where the source cuts, strips have no say */
        const Cut *c = l->cuts + i;
        int source = l->blocked[c->edge / 3] >> c->edge % 3 & 1;
        if (!source || c->triangle < l->triangles - l->strips) l->cuts[count++] = *c;
    }
    l->cut_count = count;
    return 1;
}

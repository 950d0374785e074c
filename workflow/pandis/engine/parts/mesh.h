/* -------------------- closest points of a mesh */

/* Input of a search: how far to look (unit frame). Output: the closest face in mesh.zarr.zip (-1:
 * unknown), its place in the field's own order (-1: none), whether the closest point lies on a
 * corner or an edge, and the direction of that edge (else 0). */
typedef struct {
    double reach;
    int32_t face, place, round;
    double along[3];
} pandis__start;

#define PANDIS__WITHIN(reach) {reach, -1, -1, 0, {0, 0, 0}}
#define PANDIS__ANYWHERE PANDIS__WITHIN((double)INFINITY)

typedef struct {
    double weights[3], offset[3], distance; /* offset: from the closest point to the query */
    /* the corner or the edge (k to k + 1) that contains the closest point; -1: none */
    int corner, edge;
} pandis__foot;

static const double *pandis__corner(const pandis__mesh *t, int32_t face, int k) {
    return t->vertices + 3 * (ptrdiff_t)t->faces[3 * (ptrdiff_t)face + k];
}

/* Compute the unit normal of a face from its two shortest edges, whose cross product is the most
 * accurate. */
static int pandis__face_normal(const pandis__mesh *t, int32_t face, double *n) {
    double side[3][3], length[3];
    for (int k = 0; k < 3; k++) {
        const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
        for (int i = 0; i < 3; i++) side[k][i] = q[i] - p[i];
        length[k] = pandis__dot(side[k], side[k]);
    }
    int longest = length[0] >= length[1] ? (length[0] >= length[2] ? 0 : 2)
                                         : (length[1] >= length[2] ? 1 : 2);
    pandis__cross(side[(longest + 1) % 3], side[(longest + 2) % 3], n);
    return pandis__normalise(n);
}

static double pandis__clamp01(double t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

static void pandis__edge_foot(
    const double *p, const double *a, const double *b, double *s, double *offset, double *squared) {
    double u[3], x[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], x[k] = p[k] - a[k];
    double length = pandis__dot(u, u),
           t = length > 0 ? pandis__clamp01(pandis__dot(u, x) / length) : 0;
    /* from the nearer end, for less cancellation */
    for (int k = 0; k < 3; k++)
        offset[k] = t <= 0.5 ? x[k] - t * u[k] : (p[k] - b[k]) + (1 - t) * u[k];
    *s = t, *squared = pandis__dot(offset, offset);
}

/* Find the closest point on a triangle's edges, and the corner or edge that contains it. Returns
 * the squared distance. */
static double pandis__rim_foot(const double *const *c, const double *p, pandis__foot *foot) {
    double best = (double)INFINITY;
    memset(foot, 0, sizeof *foot);
    foot->corner = foot->edge = -1;
    for (int k = 0; k < 3; k++) {
        double s, offset[3], squared;
        pandis__edge_foot(p, c[k], c[(k + 1) % 3], &s, offset, &squared);
        if (!(squared < best)) continue;
        best = squared;
        memcpy(foot->offset, offset, sizeof offset);
        foot->weights[k] = 1 - s, foot->weights[(k + 1) % 3] = s, foot->weights[(k + 2) % 3] = 0;
        foot->corner = s == 0 ? k : s == 1 ? (k + 1) % 3 : -1;
        foot->edge = foot->corner < 0 ? k : -1;
    }
    return best;
}

/* Find the closest point inside the triangle; returns whether there is one no farther than `best`
 * (squared). The weight of a corner is the distance from the opposite side, which is as accurate on
 * needles as elsewhere. The normal is made orthogonal to a side, because an error along it would
 * change heights most. */
static int pandis__inner_foot(
    const double *const *c, const double *p, double best, pandis__foot *foot) {
    double u[3], v[3], w[3], x[3], y[3], n[3], across[3], offset[3];
    for (int k = 0; k < 3; k++) {
        u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k], w[k] = c[2][k] - c[1][k];
        x[k] = p[k] - c[0][k], y[k] = p[k] - c[1][k];
    }
    pandis__cross(u, v, n);
    double along = pandis__dot(n, u) / pandis__dot(u, u);
    for (int k = 0; k < 3; k++) n[k] -= along * u[k];
    double det = pandis__dot(n, n);
    if (!(det > 0)) return 0;
    pandis__cross(x, n, across);
    double s = -pandis__dot(v, across), r = pandis__dot(u, across);
    if (!(s > 0 && r > 0)) return 0;
    pandis__cross(y, n, across);
    double q = pandis__dot(w, across), height = pandis__dot(n, x) / det;
    if (!(q > 0)) return 0;
    for (int k = 0; k < 3; k++) offset[k] = height * n[k];
    if (!(pandis__dot(offset, offset) <= best)) return 0;
    memcpy(foot->offset, offset, sizeof offset);
    foot->weights[0] = q / (q + s + r), foot->weights[1] = s / (q + s + r);
    foot->weights[2] = r / (q + s + r);
    foot->corner = foot->edge = -1;
    return 1;
}

static void pandis__find_foot(const double *const *c, const double *p, pandis__foot *foot) {
    pandis__inner_foot(c, p, pandis__rim_foot(c, p, foot), foot);
    foot->distance = sqrt(pandis__dot(foot->offset, foot->offset));
}

#define PANDIS__FOUR 4

/* Four triangles: a corner, the sides a to b, a to c and b to c, the normal, and 1 / the squared
 * lengths of these. */
typedef struct {
    double a[3][PANDIS__FOUR], u[3][PANDIS__FOUR], v[3][PANDIS__FOUR], w[3][PANDIS__FOUR],
        n[3][PANDIS__FOUR], per_u[PANDIS__FOUR], per_v[PANDIS__FOUR], per_w[PANDIS__FOUR],
        per_n[PANDIS__FOUR];
} pandis__triangles;

/* Set the corner and the sides of one of four triangles. */
PANDIS__INLINE void pandis__set_triangle(
    pandis__triangles *f, int i, const double *a, const double *b, const double *c) {
    for (int k = 0; k < 3; k++)
        f->a[k][i] = a[k], f->u[k][i] = b[k] - a[k], f->v[k][i] = c[k] - a[k],
        f->w[k][i] = c[k] - b[k];
}

/* Compute the rest. An error of a normal along the first side, over which it would change heights
 * most, is removed: what remains is no greater than the rounding of points. A side without length
 * has the reciprocal infinity. */
PANDIS__INLINE void pandis__complete_triangles(pandis__triangles *f) {
    for (int i = 0; i < PANDIS__FOUR; i++) {
        double ux = f->u[0][i], uy = f->u[1][i], uz = f->u[2][i];
        double vx = f->v[0][i], vy = f->v[1][i], vz = f->v[2][i];
        double wx = f->w[0][i], wy = f->w[1][i], wz = f->w[2][i];
        double nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        double per_u = 1 / (ux * ux + uy * uy + uz * uz);
        double along = (nx * ux + ny * uy + nz * uz) * per_u;
        nx -= along * ux, ny -= along * uy, nz -= along * uz;
        f->n[0][i] = nx, f->n[1][i] = ny, f->n[2][i] = nz;
        f->per_u[i] = per_u, f->per_v[i] = 1 / (vx * vx + vy * vy + vz * vz);
        f->per_w[i] = 1 / (wx * wx + wy * wy + wz * wz);
        f->per_n[i] = 1 / (nx * nx + ny * ny + nz * nz);
    }
}

/* Compute the squared distances to four triangles. */
PANDIS__INLINE void pandis__four_distances(const pandis__triangles *PANDIS__RESTRICT f,
    const double *PANDIS__RESTRICT p, double *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__FOUR; i++) {
        double x = p[0] - f->a[0][i], y = p[1] - f->a[1][i], z = p[2] - f->a[2][i];
        double ux = f->u[0][i], uy = f->u[1][i], uz = f->u[2][i];
        double vx = f->v[0][i], vy = f->v[1][i], vz = f->v[2][i];
        double wx = f->w[0][i], wy = f->w[1][i], wz = f->w[2][i];
        double nx = f->n[0][i], ny = f->n[1][i], nz = f->n[2][i];
        double bx = x - ux, by = y - uy, bz = z - uz;
        /* on a side without length 0 * infinity = NaN, which counts as 0; for a face without area,
         * the foot counts as outside */
        double s = pandis__clamp01((ux * x + uy * y + uz * z) * f->per_u[i]);
        double rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        double best = rx * rx + ry * ry + rz * rz;
        s = pandis__clamp01((vx * x + vy * y + vz * z) * f->per_v[i]);
        rx = x - s * vx, ry = y - s * vy, rz = z - s * vz;
        double d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        s = pandis__clamp01((wx * bx + wy * by + wz * bz) * f->per_w[i]);
        rx = bx - s * wx, ry = by - s * wy, rz = bz - s * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        /* distances from the sides, times length and area: see pandis__inner_foot */
        double cx = y * nz - z * ny, cy = z * nx - x * nz, cz = x * ny - y * nx;
        double qx = by * nz - bz * ny, qy = bz * nx - bx * nz, qz = bx * ny - by * nx;
        double height = nx * x + ny * y + nz * z;
        d = height * height * f->per_n[i];
        int inside = (ux * cx + uy * cy + uz * cz >= 0) & (vx * cx + vy * cy + vz * cz <= 0) &
            (wx * qx + wy * qy + wz * qz >= 0);
        out[i] = inside && d < best ? d : best;
    }
}

/* Compute the squared distances to four faces in double precision. Among faces that are about
 * equally near, the smallest of these numbers decides. */
PANDIS__INLINE void pandis__four_squared(const pandis__mesh *t, const int32_t *faces,
    const double *PANDIS__RESTRICT p, double *PANDIS__RESTRICT out) {
    pandis__triangles four;
    for (int i = 0; i < PANDIS__FOUR; i++)
        pandis__set_triangle(&four, i, pandis__corner(t, faces[i], 0),
            pandis__corner(t, faces[i], 1), pandis__corner(t, faces[i], 2));
    pandis__complete_triangles(&four), pandis__four_distances(&four, p, out);
}

/* Store the feature that contains the closest point. */
static void pandis__keep_feature(
    const double *const *c, const pandis__foot *foot, pandis__start *begin) {
    begin->round = foot->corner >= 0 || foot->edge >= 0;
    if (foot->edge < 0) return;
    for (int k = 0; k < 3; k++) begin->along[k] = c[(foot->edge + 1) % 3][k] - c[foot->edge][k];
    (void)pandis__normalise(begin->along);
}

static void pandis__find_mesh_foot(
    const pandis__mesh *t, int32_t face, const double *p, pandis__foot *foot) {
    const double *c[3];
    for (int k = 0; k < 3; k++) c[k] = pandis__corner(t, face, k);
    pandis__find_foot(c, p, foot);
}

/* Add a face's normal, weighted by the angle at its k-th corner, to the normal of that corner. */
static void pandis__corner_normal(
    const pandis__mesh *t, int32_t face, int k, const double *n, double *sum) {
    const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
    const double *s = pandis__corner(t, face, (k + 2) % 3);
    double u[3], v[3], c[3];
    for (int i = 0; i < 3; i++) u[i] = q[i] - p[i], v[i] = s[i] - p[i];
    pandis__cross(u, v, c);
    double angle = atan2(sqrt(pandis__dot(c, c)), pandis__dot(u, v));
    for (int i = 0; i < 3; i++) sum[i] += angle * n[i];
}

/* Get the normal of a vertex: the stored one or, if the mesh moves, that of its current faces. */
static void pandis__vertex_normal(const pandis__mesh *t, int32_t vertex, double *n) {
    if (!t->around) {
        memcpy(n, t->vertex_normals + 3 * (ptrdiff_t)vertex, 3 * sizeof *n);
        return;
    }
    n[0] = n[1] = n[2] = 0;
    for (int32_t i = t->around[vertex]; i < t->around[vertex + 1]; i++) {
        int32_t at = t->corners_at[i];
        double m[3];
        if (pandis__face_normal(t, at / 3, m)) pandis__corner_normal(t, at / 3, at % 3, m, n);
    }
    (void)pandis__normalise(n);
}

/* Compute the angle-weighted pseudonormal, of unit length, of the feature that contains the closest
 * point. */
static void pandis__pseudonormal(
    const pandis__mesh *t, int32_t face, const pandis__foot *foot, double *n) {
    if (foot->corner >= 0) {
        pandis__vertex_normal(t, t->faces[3 * (ptrdiff_t)face + foot->corner], n);
        if (pandis__dot(n, n) > 0) return;
    }
    int known = pandis__face_normal(t, face, n);
    int32_t other = foot->edge >= 0 ? t->neighbours[3 * (ptrdiff_t)face + foot->edge] : -1;
    double m[3];
    if (other >= 0 && pandis__face_normal(t, other, m)) {
        for (int k = 0; k < 3; k++) n[k] = known ? n[k] + m[k] : m[k];
        known = pandis__normalise(n);
    }
    if (!known) n[0] = n[1] = 0, n[2] = 1;
}

/* Whether no coordinate of a point exceeds the vertices' largest coordinate. A point beyond that is
 * outside: very far away all triangles are about equally near, so their normals do not determine
 * the side. */
static int pandis__within(const pandis__mesh *t, const double *p) {
    return fabs(p[0]) <= t->reach && fabs(p[1]) <= t->reach && fabs(p[2]) <= t->reach;
}

static double pandis__sign(
    const pandis__mesh *t, const double *p, const pandis__foot *foot, const double *n) {
    return pandis__within(t, p) && pandis__dot(foot->offset, n) < 0 ? -1 : 1;
}

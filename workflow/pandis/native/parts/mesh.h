/* ---------------------------------------------------------------- closest points of a mesh */

/* What is known when a search begins: a face that may be near (-1: none), and how far one looks (unit frame).
 * Afterwards the face is the nearest. */
typedef struct {
    int32_t face;
    double reach;
} pandis__start;

typedef struct {
    float bound;
    int32_t child;
} pandis__entry;

typedef struct {
    double weights[3], offset[3], distance; /* offset: from the closest point to the query */
    int corner, edge;                       /* where it lies: a corner, an edge (k to k + 1), or -1, -1 */
} pandis__foot;

static const double *pandis__corner(const pandis__mesh *t, int32_t face, int k) {
    return t->vertices + 3 * (ptrdiff_t)t->faces[3 * (ptrdiff_t)face + k];
}

/* The unit normal of a face; from its two shortest edges, whose product is the most exact. */
static int pandis__face_normal(const pandis__mesh *t, int32_t face, double *n) {
    double side[3][3], length[3];
    for (int k = 0; k < 3; k++) {
        const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
        for (int i = 0; i < 3; i++) side[k][i] = q[i] - p[i];
        length[k] = pandis__dot(side[k], side[k]);
    }
    int longest = length[0] >= length[1] ? (length[0] >= length[2] ? 0 : 2) : (length[1] >= length[2] ? 1 : 2);
    pandis__cross(side[(longest + 1) % 3], side[(longest + 2) % 3], n);
    return pandis__normalise(n);
}

/* One triangle of a leaf. */
static void pandis__set_lane(pandis__leaf *leaf, int lane, const double *p, const double *q, const double *s) {
    double ab[3], ac[3], bc[3], n[3];
    for (int k = 0; k < 3; k++) {
        ab[k] = q[k] - p[k], ac[k] = s[k] - p[k], bc[k] = s[k] - q[k];
        leaf->a[k][lane] = p[k], leaf->ab[k][lane] = ab[k], leaf->ac[k][lane] = ac[k];
    }
    double aa = pandis__dot(ab, ab), cc = pandis__dot(ac, ac), bb = pandis__dot(bc, bc), mix = pandis__dot(ab, ac);
    pandis__cross(ab, ac, n);
    double det = pandis__dot(n, n);
    leaf->per_ab[lane] = aa > 0 ? 1 / aa : 0;
    leaf->per_ac[lane] = cc > 0 ? 1 / cc : 0;
    leaf->per_bc[lane] = bb > 0 ? 1 / bb : 0;
    /* without an area no point projects into it: NaN fails every comparison */
    leaf->gram_ab[lane] = det > 0 ? aa / det : (double)NAN;
    leaf->gram_mix[lane] = det > 0 ? mix / det : (double)NAN;
    leaf->gram_ac[lane] = det > 0 ? cc / det : (double)NAN;
}

/* Lower bounds of the squared distances to the boxes of a node's children. */
static void pandis__box_bounds(const pandis__node *PANDIS__RESTRICT n, const float *PANDIS__RESTRICT p,
                               float *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float sum = 0;
        for (int k = 0; k < 3; k++) {
            float below = n->low[k][i] - p[k], above = p[k] - n->high[k][i];
            float d = below > above ? below : above;
            d = d > 0 ? d : 0;
            sum += d * d;
        }
        out[i] = sum * 0.99999f; /* more than the rounding of all of the above */
    }
}

static double pandis__clamp01(double t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

/* Squared distances to the triangles of a leaf. */
static void pandis__leaf_distances(const pandis__leaf *PANDIS__RESTRICT f, const double *PANDIS__RESTRICT p,
                                   double *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__LEAF; i++) {
        double x = p[0] - f->a[0][i], y = p[1] - f->a[1][i], z = p[2] - f->a[2][i];
        double ux = f->ab[0][i], uy = f->ab[1][i], uz = f->ab[2][i];
        double vx = f->ac[0][i], vy = f->ac[1][i], vz = f->ac[2][i];
        double wx = vx - ux, wy = vy - uy, wz = vz - uz;
        double du = ux * x + uy * y + uz * z, dv = vx * x + vy * y + vz * z;
        double s = pandis__clamp01(du * f->per_ab[i]), t = pandis__clamp01(dv * f->per_ac[i]);
        double rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        double best = rx * rx + ry * ry + rz * rz;
        rx = x - t * vx, ry = y - t * vy, rz = z - t * vz;
        double d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        double bx = x - ux, by = y - uy, bz = z - uz;
        double r = pandis__clamp01((wx * bx + wy * by + wz * bz) * f->per_bc[i]);
        rx = bx - r * wx, ry = by - r * wy, rz = bz - r * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        s = f->gram_ac[i] * du - f->gram_mix[i] * dv;
        t = f->gram_ab[i] * dv - f->gram_mix[i] * du;
        rx = x - s * ux - t * vx, ry = y - s * uy - t * vy, rz = z - s * uz - t * vz;
        d = rx * rx + ry * ry + rz * rz;
        int inside = (s >= 0) & (t >= 0) & (s + t <= 1);
        out[i] = inside && d < best ? d : best;
    }
}

/* Push the children nearer than `limit`, the nearest on top. */
static int pandis__push(const pandis__node *node, const float *bounds, double limit, pandis__entry *stack, int top) {
    int first = top;
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        if (!((double)bounds[i] <= limit) || node->low[0][i] > node->high[0][i]) continue;
        int at = top++;
        for (; at > first && stack[at - 1].bound < bounds[i]; at--) stack[at] = stack[at - 1];
        stack[at].bound = bounds[i], stack[at].child = node->child[i];
    }
    return top;
}

/* Squared distances to the triangles of a leaf, whose vertices have moved. */
PANDIS__APART static void pandis__moved_distances(const pandis__mesh *t, const pandis__leaf *leaf, const double *p,
                                                  double *out) {
    pandis__leaf own;
    for (int lane = 0; lane < PANDIS__LEAF; lane++) {
        int32_t face = leaf->face[lane < leaf->count ? lane : 0];
        pandis__set_lane(&own, lane, pandis__corner(t, face, 0), pandis__corner(t, face, 1), pandis__corner(t, face, 2));
    }
    pandis__leaf_distances(&own, p, out);
}

/* The nearest triangle no farther than `best` (squared), INT32_MAX if there is none. */
static int32_t pandis__nearest(const pandis__mesh *t, const double *p, double best) {
    pandis__entry stack[PANDIS__STACK];
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]}, bounds[PANDIS__WIDTH];
    double d[PANDIS__LEAF];
    int32_t face = INT32_MAX;
    int top = 1;
    stack[0].bound = 0, stack[0].child = 0;
    while (top) {
        pandis__entry e = stack[--top];
        if ((double)e.bound > best) continue;
        if (e.child >= 0) {
            pandis__box_bounds(t->nodes + e.child, q, bounds);
            top = pandis__push(t->nodes + e.child, bounds, best, stack, top);
        } else {
            const pandis__leaf *leaf = t->leaves + ~e.child;
            if (t->around)
                pandis__moved_distances(t, leaf, p, d);
            else
                pandis__leaf_distances(leaf, p, d);
            for (int i = 0; i < leaf->count; i++)
                if (d[i] < best || (d[i] == best && leaf->face[i] < face)) best = d[i], face = leaf->face[i];
        }
    }
    return face;
}

static void pandis__edge_foot(const double *p, const double *a, const double *b, double *s, double *offset,
                              double *squared) {
    double u[3], x[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], x[k] = p[k] - a[k];
    double length = pandis__dot(u, u), t = length > 0 ? pandis__clamp01(pandis__dot(u, x) / length) : 0;
    /* from the nearer end, where less is cancelled */
    for (int k = 0; k < 3; k++) offset[k] = t <= 0.5 ? x[k] - t * u[k] : (p[k] - b[k]) + (1 - t) * u[k];
    *s = t, *squared = pandis__dot(offset, offset);
}

/* The closest point of a triangle, with what it lies on, if that is on its edges. Returns its squared distance. */
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

/* The same inside of it, if it is there and no farther than `best` (squared); returns whether it is. */
static int pandis__inner_foot(const double *const *c, const double *p, double best, pandis__foot *foot) {
    double u[3], v[3], x[3], n[3];
    for (int k = 0; k < 3; k++) u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k], x[k] = p[k] - c[0][k];
    pandis__cross(u, v, n);
    double det = pandis__dot(n, n);
    if (!(det > 0)) return 0;
    double uu = pandis__dot(u, u), uv = pandis__dot(u, v), vv = pandis__dot(v, v), s = 0, r = 0, rest[3];
    memcpy(rest, x, sizeof rest);
    for (int round = 0; round < 2; round++) { /* the second round mends needles */
        double du = pandis__dot(u, rest), dv = pandis__dot(v, rest);
        s += (vv * du - uv * dv) / det, r += (uu * dv - uv * du) / det;
        for (int k = 0; k < 3; k++) rest[k] = x[k] - s * u[k] - r * v[k];
    }
    if (!(s > 0 && r > 0 && s + r < 1)) return 0;
    /* a point of the plane: its offset is along the normal, and exact as such */
    double height = pandis__dot(n, x) / det, offset[3];
    for (int k = 0; k < 3; k++) offset[k] = height * n[k];
    if (!(pandis__dot(offset, offset) <= best)) return 0;
    memcpy(foot->offset, offset, sizeof offset);
    foot->weights[0] = 1 - s - r, foot->weights[1] = s, foot->weights[2] = r;
    foot->corner = foot->edge = -1;
    return 1;
}

static void pandis__find_foot(const double *const *c, const double *p, pandis__foot *foot) {
    pandis__inner_foot(c, p, pandis__rim_foot(c, p, foot), foot);
    foot->distance = sqrt(pandis__dot(foot->offset, foot->offset));
}

static void pandis__find_mesh_foot(const pandis__mesh *t, int32_t face, const double *p, pandis__foot *foot) {
    const double *c[3];
    for (int k = 0; k < 3; k++) c[k] = pandis__corner(t, face, k);
    pandis__find_foot(c, p, foot);
}

/* What one face adds to the normal of its k-th corner: its own, weighted by its angle there. */
static void pandis__corner_normal(const pandis__mesh *t, int32_t face, int k, const double *n, double *sum) {
    const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
    const double *s = pandis__corner(t, face, (k + 2) % 3);
    double u[3], v[3], c[3];
    for (int i = 0; i < 3; i++) u[i] = q[i] - p[i], v[i] = s[i] - p[i];
    pandis__cross(u, v, c);
    double angle = atan2(sqrt(pandis__dot(c, c)), pandis__dot(u, v));
    for (int i = 0; i < 3; i++) sum[i] += angle * n[i];
}

/* The normal of a vertex; where the mesh moves, from its faces as they are. */
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

/* The angle-weighted pseudonormal of what the closest point lies on; unit length. */
static void pandis__pseudonormal(const pandis__mesh *t, int32_t face, const pandis__foot *foot, double *n) {
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

/* On which side of the surface a point is: -1 inside. Beyond all vertices it is outside; very far
 * away all triangles are equally near, and their normals tell nothing. */
static double pandis__sign(const pandis__mesh *t, const double *p, const pandis__foot *foot, const double *n) {
    for (int k = 0; k < 3; k++)
        if (fabs(p[k]) > t->reach) return 1;
    return pandis__dot(foot->offset, n) < 0 ? -1 : 1;
}

PANDIS__APART static int pandis__answer_mesh(const pandis__mesh *t, const double *u, pandis__start *begin,
                                             double *distance, double *normal) {
    pandis__foot foot;
    int32_t known = begin->face >= 0 && begin->face < t->face_count ? begin->face : 0;
    pandis__find_mesh_foot(t, known, u, &foot);
    /* any face is a bound, with room for rounding */
    double limit = foot.distance * (1 + 1e-9) + 1e-12 * t->reach;
    /* a reach, with room for what leaves lose on slivers */
    int beyond = begin->reach < 1e18 && begin->reach < limit;
    if (beyond) limit = begin->reach * (1 + 1e-6) + 1e-5 * t->reach;
    int32_t face = pandis__nearest(t, u, limit * limit);
    if (face == INT32_MAX && beyond) return PANDIS_BEYOND;
    if (face == INT32_MAX) face = pandis__nearest(t, u, (double)INFINITY);
    if (face == INT32_MAX) return PANDIS_INVALID;
    begin->face = face;
    double n[3];
    pandis__find_mesh_foot(t, face, u, &foot);
    pandis__pseudonormal(t, face, &foot, n);
    double sign = pandis__sign(t, u, &foot, n);
    *distance = sign * foot.distance;
    /* closer than this the quotient has lost too many digits */
    for (int k = 0; k < 3; k++) normal[k] = foot.distance > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return fabs(u[0]) <= 1 && fabs(u[1]) <= 1 && fabs(u[2]) <= 1 ? PANDIS_OK : PANDIS_BOUND;
}


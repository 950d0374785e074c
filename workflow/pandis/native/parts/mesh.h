/* ---------------------------------------------------------------- closest points of a mesh */

/* What is known when a search begins (unit frame): how far one looks, and how far the nearest face seems to be, which
 * may be wrong. Afterwards there is the closest point. */
typedef struct {
    double reach, guess, closest[3];
} pandis__start;

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

/* The keys of a node's boxes: of lower bounds of the squared distances to what is in them. */
static void pandis__box_keys(const pandis__node *PANDIS__RESTRICT n, const float *PANDIS__RESTRICT p,
                             int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH];
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
    memcpy(keys, out, sizeof out);
    for (int i = 0; i < PANDIS__WIDTH; i++) keys[i] = n->low[0][i] > n->high[0][i] ? INT32_MAX : (keys[i] & ~7) | i;
}

/* The key of how far one looks: boxes with larger ones are farther. */
static int32_t pandis__limit_key(double limit) {
    double squared = limit * limit * (1 + 1e-6);
    return squared < 3e38 ? pandis__key((float)squared) : INT32_MAX - 1;
}

static double pandis__clamp01(double t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

/* The squared distance to one triangle, in double precision: among those about equally near the nearest is the one of
 * which this number is the least. */
static double pandis__face_squared(const double *a, const double *b, const double *c, const double *p) {
    double x[3], u[3], v[3], w[3], y[3], n[3], r[3];
    for (int k = 0; k < 3; k++) {
        u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = c[k] - b[k], x[k] = p[k] - a[k];
        y[k] = x[k] - u[k];
    }
    double uu = pandis__dot(u, u), vv = pandis__dot(v, v), ww = pandis__dot(w, w), uv = pandis__dot(u, v);
    double du = pandis__dot(u, x), dv = pandis__dot(v, x);
    pandis__cross(u, v, n);
    double det = pandis__dot(n, n);
    double s = pandis__clamp01(du * (uu > 0 ? 1 / uu : 0)), t = pandis__clamp01(dv * (vv > 0 ? 1 / vv : 0));
    for (int k = 0; k < 3; k++) r[k] = x[k] - s * u[k];
    double best = pandis__dot(r, r);
    for (int k = 0; k < 3; k++) r[k] = x[k] - t * v[k];
    double d = pandis__dot(r, r);
    best = d < best ? d : best;
    for (int k = 0; k < 3; k++) w[k] = v[k] - u[k];
    t = pandis__clamp01(pandis__dot(w, y) * (ww > 0 ? 1 / ww : 0));
    for (int k = 0; k < 3; k++) r[k] = y[k] - t * w[k];
    d = pandis__dot(r, r);
    best = d < best ? d : best;
    if (!(det > 0)) return best; /* no point projects into what has no area */
    s = vv / det * du - uv / det * dv;
    t = uu / det * dv - uv / det * du;
    for (int k = 0; k < 3; k++) r[k] = x[k] - s * u[k] - t * v[k];
    d = pandis__dot(r, r);
    return s >= 0 && t >= 0 && s + t <= 1 && d < best ? d : best;
}

#define PANDIS__MAYBE 16 /* faces that are put off before one looks at them in double precision */

/* What is known while one looks for the nearest face: how far it is at most; which faces may be it, and how far they
 * seem to be, squared; of those that were looked at in double precision the nearest, and its squared distance. */
typedef struct {
    double limit, squared;
    int32_t face;
    int count;
    struct {
        double seems;
        float slack[2];
        int32_t face;
    } maybe[PANDIS__MAYBE];
} pandis__seeking;

/* How far a face can seem to be that is no farther than a limit, squared. */
static double pandis__may_seem(double limit, const float *slack) {
    double most = (limit + (double)slack[0]) * (1 + 2 * (double)slack[1]);
    return most * most * (1 + 1e-6);
}

/* Look at the faces that were put off. */
static void pandis__settle(const pandis__mesh *t, const double *p, pandis__seeking *s) {
    for (int i = 0; i < s->count; i++) {
        int32_t face = s->maybe[i].face;
        if (s->maybe[i].seems > pandis__may_seem(s->limit, s->maybe[i].slack)) continue;
        double d = pandis__face_squared(pandis__corner(t, face, 0), pandis__corner(t, face, 1), pandis__corner(t, face, 2), p);
        if (!(d < s->squared || (d == s->squared && face < s->face))) continue;
        s->squared = d, s->face = face;
        d = sqrt(d) * (1 + 1e-12);
        s->limit = d < s->limit ? d : s->limit;
    }
    s->count = 0;
}

/* The vertices of the triangles of a leaf of a mesh that moves: 24 of them, behind the corners on each vertex. */
static const int32_t *pandis__leaf_vertices(const pandis__mesh *t, ptrdiff_t leaf) {
    return t->corners_at + 3 * (ptrdiff_t)t->face_count + 3 * PANDIS__WIDTH * leaf;
}

/* The triangles of a leaf whose vertices have moved, relative to a point. */
PANDIS__APART static void pandis__moved_triangles(const pandis__mesh *t, ptrdiff_t leaf, const double *p,
                                                  float (*out)[3][PANDIS__WIDTH]) {
    const int32_t *vertex = pandis__leaf_vertices(t, leaf);
    for (int i = 0; i < PANDIS__WIDTH; i++)
        for (int c = 0; c < 3; c++) {
            const double *at = t->vertices + 3 * (ptrdiff_t)*vertex++;
            for (int k = 0; k < 3; k++) out[c][k][i] = (float)(at[k] - p[k]);
        }
}

/* How far the triangles of a leaf seem to be in single precision, squared, and the least of these; and what such distances
 * may lose. Zeros, and -1 as the least, where single precision cannot hold squares. */
static double pandis__seem(const pandis__mesh *t, const pandis__leaf *leaf, const double *p, double *seems, float *slack) {
    float v[3][3][PANDIS__WIDTH], q[3] = {0, 0, 0}, d[PANDIS__WIDTH] = {0};
    double step = t->around ? 1 : (double)leaf->step, per_step = 1 / step;
    int small = 1;
    slack[0] = leaf->slack, slack[1] = leaf->share;
    if (t->around) {
        pandis__moved_triangles(t, leaf - t->leaves, p, v);
        memcpy(slack, t->slacks[leaf - t->leaves], sizeof t->slacks[0]);
        for (int k = 0; k < 3; k++) small &= fabs(p[k]) + t->reach < 1e15;
    } else {
        for (int c = 0; c < 9; c++)
            for (int i = 0; i < PANDIS__WIDTH; i++) v[c / 3][c % 3][i] = (float)(int32_t)leaf->corner[c / 3][c % 3][i];
        for (int k = 0; k < 3; k++) {
            double at = (p[k] - (double)leaf->origin[k]) * per_step;
            q[k] = (float)at, small &= fabs(at) < 1e15;
        }
    }
    if (small) pandis__eight_distances(v, q, d);
    float least = d[0];
    for (int i = 0; i < PANDIS__WIDTH; i++) least = d[i] < least ? d[i] : least, seems[i] = (double)d[i] * (step * step);
    return small ? (double)least * (step * step) : -1;
}

/* Put off the triangles of a leaf that may be the nearest. */
static void pandis__look_into(const pandis__mesh *t, const pandis__leaf *leaf, const double *p, pandis__seeking *s) {
    double seems[PANDIS__WIDTH], farthest;
    float slack[2];
    double least = pandis__seem(t, leaf, p, seems, slack);
    if (least > (farthest = pandis__may_seem(s->limit, slack))) return;
    double most = least >= 0 ? sqrt(least) * (1 + (double)slack[1]) + (double)slack[0] : (double)INFINITY;
    if (most < s->limit) s->limit = most, farthest = pandis__may_seem(most, slack);
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        if (seems[i] > farthest || leaf->face[i] < 0) continue;
        if (s->count == PANDIS__MAYBE) pandis__settle(t, p, s);
        s->maybe[s->count].seems = seems[i], s->maybe[s->count].face = leaf->face[i];
        memcpy(s->maybe[s->count++].slack, slack, sizeof slack);
    }
}

/* The nearest face no farther than `limit`, by its distance in double precision; INT32_MAX if there is none. */
static int32_t pandis__nearest(const pandis__mesh *t, const double *p, double limit) {
    struct {
        int32_t keys[PANDIS__WIDTH];
        const pandis__node *node;
    } path[PANDIS__DEEPEST], *at = path;
    pandis__seeking s;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    int32_t within = pandis__limit_key(limit);
    int kept = 0;
    s.limit = limit, s.squared = limit * limit, s.face = INT32_MAX, s.count = 0;
    at->node = t->nodes;
    pandis__box_keys(at->node, q, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = at->node->child[key & 7];
        if (key > within) {
            if (at == path) break;
            at--;
            continue;
        }
        at->keys[key & 7] = INT32_MAX;
        if (child >= 0) {
            (++at)->node = t->nodes + child;
            pandis__box_keys(at->node, q, at->keys);
        } else {
            pandis__look_into(t, t->leaves + ~child, p, &s);
            within = pandis__limit_key(s.limit);
        }
    }
    for (int i = 0; i < s.count; i++)
        if (s.maybe[i].seems <= pandis__may_seem(s.limit, s.maybe[i].slack)) s.maybe[kept++] = s.maybe[i];
    s.count = kept;
    /* a face is certainly nearer than the limit, and no other can be it */
    if (kept == 1 && s.face == INT32_MAX && s.limit < limit) return s.maybe[0].face;
    pandis__settle(t, p, &s);
    return s.face;
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
    double limit = begin->guess * (1 + 1e-9) + 1e-12 * t->reach; /* with room for rounding */
    /* a reach, with room for what leaves lose on slivers */
    int beyond = begin->reach < 1e18 && begin->reach < limit;
    if (beyond) limit = begin->reach * (1 + 1e-6) + 1e-5 * t->reach;
    int32_t face = pandis__nearest(t, u, limit);
    if (face == INT32_MAX && beyond) return PANDIS_BEYOND;
    if (face == INT32_MAX) face = pandis__nearest(t, u, (double)INFINITY);
    if (face == INT32_MAX) return PANDIS_INVALID;
    double n[3];
    pandis__find_mesh_foot(t, face, u, &foot);
    for (int k = 0; k < 3; k++) begin->closest[k] = u[k] - foot.offset[k];
    pandis__pseudonormal(t, face, &foot, n);
    double sign = pandis__sign(t, u, &foot, n);
    *distance = sign * foot.distance;
    /* closer than this the quotient has lost too many digits */
    for (int k = 0; k < 3; k++) normal[k] = foot.distance > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return fabs(u[0]) <= 1 && fabs(u[1]) <= 1 && fabs(u[2]) <= 1 ? PANDIS_OK : PANDIS_BOUND;
}


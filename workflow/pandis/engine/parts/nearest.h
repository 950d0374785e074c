
/* -------------------- the nearest face of a mesh
 *
 * Candidates for the nearest face are found in single precision, leaf by leaf. The nearest of them
 * is then chosen in double precision. */

/* The keys of a node's boxes: lower bounds of the squared distances to their contents. */
PANDIS__INLINE void pandis__box_keys(const pandis__node *PANDIS__RESTRICT n,
    const float *PANDIS__RESTRICT p, int32_t *PANDIS__RESTRICT keys) {
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
    for (int i = 0; i < PANDIS__WIDTH; i++)
        keys[i] = n->low[0][i] > n->high[0][i] ? INT32_MAX : (keys[i] & ~7) | i;
}

/* Raise the keys of a node's boxes to the squared distances from the slabs of their contents. */
PANDIS__INLINE void pandis__slab_keys(const pandis__slabs *PANDIS__RESTRICT s,
    const float *PANDIS__RESTRICT p, int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH], rounding = 1e-6f * (fabsf(p[0]) + fabsf(p[1]) + fabsf(p[2]));
    int32_t raised[PANDIS__WIDTH];
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float at = s->normal[0][i] * p[0] + s->normal[1][i] * p[1] + s->normal[2][i] * p[2];
        float below = s->low[i] - at, above = at - s->high[i];
        float d = (below > above ? below : above) - rounding;
        d = d > 0 ? d : 0;
        out[i] = d * d * 0.99999f;
    }
    memcpy(raised, out, sizeof raised);
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        raised[i] = (raised[i] & ~7) | i;
        keys[i] = raised[i] > keys[i] ? raised[i] : keys[i];
    }
}

/* The key of a search limit: boxes with larger keys are farther. */
static int32_t pandis__limit_key(double limit) {
    double squared = limit * limit * (1 + 1e-6);
    return squared < 3e38 ? pandis__key((float)squared) : INT32_MAX - 1;
}

#define PANDIS__MAYBE 12 /* capacity of the queue of faces that wait for double precision */

/* State of a search for the nearest face: an upper bound of its distance; the nearest face computed
 * in double precision, and its squared distance; how many nodes, leaves and faces may still be
 * visited; the key of the nearest box that was not; and the waiting faces, with their squared
 * distances in single precision. */
typedef struct {
    double limit, squared;
    int32_t face, left, unseen;
    int count;
    struct {
        double seems;
        float slack[2];
        int32_t face;
    } maybe[PANDIS__MAYBE];
} pandis__seeking;

/* Largest squared distance that a face within a limit can have in single precision. */
static double pandis__may_seem(double limit, const float *slack) {
    double most = (limit + (double)slack[0]) * (1 + 2 * (double)slack[1]);
    return most * most * (1 + 1e-6);
}

/* Compute the distances to the waiting faces in double precision. */
PANDIS__INLINE void pandis__settle(const pandis__mesh *t, const double *p, pandis__seeking *s) {
    double squared[PANDIS__FOUR];
    int32_t faces[PANDIS__FOUR];
    for (int i = 0; i < s->count;) {
        int some = 0;
        for (; i < s->count && some < PANDIS__FOUR; i++)
            if (s->maybe[i].seems <= pandis__may_seem(s->limit, s->maybe[i].slack))
                faces[some++] = s->maybe[i].face;
        if (!some) break;
        for (int k = some; k < PANDIS__FOUR; k++) faces[k] = faces[0];
        pandis__four_squared(t, faces, p, squared);
        for (int k = 0; k < some; k++) {
            if (!(squared[k] < s->squared || (squared[k] == s->squared && faces[k] < s->face)))
                continue;
            s->squared = squared[k], s->face = faces[k];
            double d = sqrt(squared[k]) * (1 + 1e-12);
            s->limit = d < s->limit ? d : s->limit;
        }
    }
    s->count = 0;
}

/* The vertices of the eight triangles of a leaf, for a mesh that moves. They are stored after the
 * lists of corners at each vertex. */
static const int32_t *pandis__leaf_vertices(const pandis__mesh *t, ptrdiff_t leaf) {
    return t->corners_at + 3 * (ptrdiff_t)t->face_count + 3 * PANDIS__WIDTH * leaf;
}

/* The triangles of a leaf whose vertices have moved, relative to a point. */
PANDIS__APART static void pandis__moved_triangles(
    const pandis__mesh *t, ptrdiff_t leaf, const double *p, float (*out)[3][PANDIS__WIDTH]) {
    const int32_t *vertex = pandis__leaf_vertices(t, leaf);
    for (int i = 0; i < PANDIS__WIDTH; i++)
        for (int c = 0; c < 3; c++) {
            const double *at = t->vertices + 3 * (ptrdiff_t)*vertex++;
            for (int k = 0; k < 3; k++) out[c][k][i] = (float)(at[k] - p[k]);
        }
}

/* Compute squared distances to the triangles of a leaf in single precision, and their error bounds.
 * Returns the smallest squared distance. If single precision cannot represent the squares, they are
 * set to zero, and -1 is returned. */
PANDIS__INLINE double pandis__seem(
    const pandis__mesh *t, const pandis__leaf *leaf, const double *p, double *seems, float *slack) {
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
            for (int i = 0; i < PANDIS__WIDTH; i++)
                v[c / 3][c % 3][i] = (float)(int32_t)leaf->corner[c / 3][c % 3][i];
        for (int k = 0; k < 3; k++) {
            double at = (p[k] - (double)leaf->origin[k]) * per_step;
            q[k] = (float)at, small &= fabs(at) < 1e15;
        }
    }
    if (small) pandis__eight_distances(v, q, d);
    float least = d[0];
    for (int i = 0; i < PANDIS__WIDTH; i++)
        least = d[i] < least ? d[i] : least, seems[i] = (double)d[i] * (step * step);
    return small ? (double)least * (step * step) : -1;
}

/* Collect the triangles of a leaf that may be nearest. Returns what `pandis__seem` does. */
PANDIS__INLINE double pandis__look_into(
    const pandis__mesh *t, const pandis__leaf *leaf, const double *p, pandis__seeking *s) {
    double seems[PANDIS__WIDTH], farthest;
    float slack[2];
    double least = pandis__seem(t, leaf, p, seems, slack);
    s->left--;
    if (least > pandis__may_seem(s->limit, slack)) return least;
    farthest =
        least >= 0 ? sqrt(least) * (1 + (double)slack[1]) + (double)slack[0] : (double)INFINITY;
    if (farthest < s->limit) s->limit = farthest;
    farthest = pandis__may_seem(s->limit, slack);
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        if (seems[i] > farthest || leaf->face[i] < 0) continue;
        if (s->count == PANDIS__MAYBE) pandis__settle(t, p, s);
        s->left--;
        s->maybe[s->count].seems = seems[i], s->maybe[s->count].face = leaf->face[i];
        memcpy(s->maybe[s->count++].slack, slack, sizeof slack);
    }
    return least;
}

/* Descend with a budget of nodes, leaves and faces, the nearest box first. Boxes whose contents are
 * less than `gap` nearer than the nearest face so far are skipped; `unseen` is the key of the
 * nearest box that was not opened. Slabs are read in later searches: most end before they pay. */
PANDIS__INLINE void pandis__descend_body(
    const pandis__mesh *t, const double *p, double gap, int32_t left, pandis__seeking *s) {
    struct {
        int32_t keys[PANDIS__WIDTH], node;
    } path[PANDIS__DEEPEST], *at = path;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    int32_t within = pandis__limit_key(s->limit > gap ? s->limit - gap : 0);
    int with_slabs = t->slabs && left > PANDIS__SOON && left < INT32_MAX;
    s->left = left, s->unseen = INT32_MAX, at->node = 0;
    pandis__box_keys(t->nodes, q, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = t->nodes[at->node].child[key & 7];
        /* box skipped, or budget spent: the rest is at least this far away */
        if (key > within || s->left < 0) {
            s->unseen = key < s->unseen ? key : s->unseen;
            if (at == path) return;
            at--;
            continue;
        }
        at->keys[key & 7] = INT32_MAX;
        if (child >= 0) {
            s->left--;
            (++at)->node = child;
            pandis__box_keys(t->nodes + child, q, at->keys);
            if (with_slabs) pandis__slab_keys(t->slabs + child, q, at->keys);
        } else {
            pandis__look_into(t, t->leaves + ~child, p, s);
            within = pandis__limit_key(s->limit > gap ? s->limit - gap : 0);
        }
    }
}

PANDIS__COMPILE(pandis__descend,
    (const pandis__mesh *t, const double *p, double gap, int32_t left, pandis__seeking *s),
    (t, p, gap, left, s))

/* Whether a face that was not seen may be nearer than the nearest one so far. */
static int pandis__cut_short(const pandis__seeking *s) {
    return s->unseen <= pandis__limit_key(s->limit);
}

/* Choose the nearest face within `limit` from those that a search has collected. */
PANDIS__INLINE void pandis__choose(
    const pandis__mesh *t, const double *p, double limit, pandis__seeking *s) {
    int kept = 0;
    for (int i = 0; i < s->count; i++)
        if (s->maybe[i].seems <= pandis__may_seem(s->limit, s->maybe[i].slack))
            s->maybe[kept++] = s->maybe[i];
    s->count = kept;
    /* the only candidate is certainly nearer than the limit */
    if (kept == 1 && s->face == INT32_MAX && s->limit < limit) s->face = s->maybe[0].face;
    else pandis__settle(t, p, s);
}

/* Find the nearest face within `limit`, by its distance in double precision; INT32_MAX if there is
 * none. If the search was cut short, `clear` becomes a lower bound of the distances to all other
 * faces; else infinite. With a limit it ends early, and the caller repeats it without. The budget
 * is small unless a face may be close. Once it is spent, more and more boxes are skipped until a
 * search ends within its own budget, which bounds by how much a face can be nearer. */
static int32_t pandis__nearest(
    const pandis__mesh *t, const double *p, double limit, double *clear) {
    pandis__seeking s;
    int again = t->most < INT32_MAX && !(limit < (double)INFINITY);
    s.limit = limit, s.squared = limit * limit, s.face = INT32_MAX, s.count = 0;
    pandis__descend(t, p, 0, t->most < INT32_MAX ? PANDIS__SOON : INT32_MAX, &s);
    int away = s.limit > PANDIS__CLOSE;
    while (again && pandis__cut_short(&s)) {
        pandis__descend(t, p, 0, away ? pandis__few(t->most) : t->most, &s);
        if (!pandis__cut_short(&s)) break;
        int32_t unseen = s.unseen;
        /* keys have the rounding of single precision, so the doubt grows with the distance */
        for (double gap = PANDIS__DOUBT + 2e-5 * s.limit;; gap = fmax(4 * gap, s.limit / 16)) {
            pandis__descend(t, p, gap, PANDIS__CERTAIN, &s);
            unseen = unseen > s.unseen ? unseen : s.unseen;
            if (s.left >= 0 || gap >= s.limit) break;
        }
        s.unseen = unseen;
        again = away && unseen <= pandis__limit_key(PANDIS__CLOSE);
        away = 0;
    }
    pandis__choose(t, p, limit, &s);
    *clear = pandis__cut_short(&s) ? pandis__distance_of(s.unseen) : (double)INFINITY;
    return s.face;
}

/* Bit mask of a node's boxes that a segment meets beyond the share `from` of its length. */
static int pandis__nodes_between(
    const pandis__node *node, const double *p, const double *way, double from) {
    int met = 0;
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        double enter = from, leave = 1;
        for (int k = 0; k < 3; k++) {
            double low = (double)node->low[k][i] - p[k], high = (double)node->high[k][i] - p[k];
            double a = low / way[k], b = high / way[k], first = a < b ? a : b, last = a < b ? b : a;
            if (way[k] == 0) first = low <= 0 && high >= 0 ? from : 2, last = 1;
            enter = first > enter ? first : enter, leave = last < leave ? last : leave;
        }
        met |= (enter <= leave && !(node->low[0][i] > node->high[0][i])) << i;
    }
    return met;
}

/* Find the side of a point (-1: inside) from the first face on the segment to a target. The segment
 * is free up to the share `from` of its length. If it meets too many faces, the target's face
 * decides. */
PANDIS__APART static double pandis__first_sign(
    const pandis__mesh *t, const double *p, const double *target, const double *n, double from) {
    int32_t stack[PANDIS__STACK], left = t->most;
    double way[3], nearest = 1;
    int top = 1;
    for (int k = 0; k < 3; k++) way[k] = target[k] - p[k];
    double own = pandis__dot(n, way) > 0 ? -1 : 1, sign = own;
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (--left < 0) return own;
        if (child >= 0) {
            int met = pandis__nodes_between(t->nodes + child, p, way, from);
            for (int i = 0; i < PANDIS__WIDTH; i++)
                if (met >> i & 1) stack[top++] = t->nodes[child].child[i];
            continue;
        }
        const pandis__leaf *leaf = t->leaves + ~child;
        for (int i = 0; i < PANDIS__WIDTH && leaf->face[i] >= 0; i++) {
            const double *c[3];
            double at;
            for (int k = 0; k < 3; k++) c[k] = pandis__corner(t, leaf->face[i], k);
            int side = pandis__meets(c, p, way, &at);
            if (side && at < nearest) nearest = at, sign = side;
        }
    }
    return sign;
}

/* Find the sign of a point after a search that was cut short: other faces may be nearer, but not
 * nearer than `clear`. */
static double pandis__cut_sign(
    const pandis__mesh *t, const double *p, int32_t face, const pandis__foot *foot, double clear) {
    double target[3], n[3]; /* next to the foot, within the face */
    if (!(foot->distance > 0) || !pandis__face_normal(t, face, n)) return 1;
    for (int k = 0; k < 3; k++) {
        double middle = (pandis__corner(t, face, 0)[k] + pandis__corner(t, face, 1)[k] +
                            pandis__corner(t, face, 2)[k]) /
            3;
        double at = p[k] - foot->offset[k];
        target[k] = at + 1e-3 * (middle - at);
    }
    return pandis__first_sign(t, p, target, n, 0.999 * clear / foot->distance);
}

PANDIS__APART static pandis_flag pandis__answer_mesh(const pandis__mesh *t, const double *u,
    pandis__start *begin, double *distance, double *normal, double *clear) {
    pandis__foot foot;
    /* search up to the reach, plus a margin for the errors of leaves with sliver triangles */
    double limit =
        begin->reach < 1e18 ? begin->reach * (1 + 1e-6) + 1e-5 * t->reach : (double)INFINITY;
    int32_t face = pandis__nearest(t, u, limit, clear);
    int cut = *clear < (double)INFINITY;
    if (face == INT32_MAX && limit < (double)INFINITY && !cut) {
        *clear = begin->reach;
        return PANDIS_BEYOND;
    }
    /* a search with a limit may find another face if it is cut short: repeat it without a limit */
    if (cut && limit < (double)INFINITY) face = pandis__nearest(t, u, (double)INFINITY, clear);
    if (face == INT32_MAX) return PANDIS_INVALID;
    double n[3], sign;
    cut = *clear < (double)INFINITY;
    const double *corner[3] = {
        pandis__corner(t, face, 0), pandis__corner(t, face, 1), pandis__corner(t, face, 2)};
    pandis__find_mesh_foot(t, face, u, &foot);
    pandis__keep_feature(corner, &foot, begin);
    begin->face = begin->place = face;
    pandis__pseudonormal(t, face, &foot, n);
    sign = pandis__sign(t, u, &foot, n);
    if (cut && pandis__within(t, u)) sign = pandis__cut_sign(t, u, face, &foot, *clear);
    *distance = sign * foot.distance;
    *clear = *clear < foot.distance ? *clear : foot.distance;
    /* closer than this, the quotient loses too many digits */
    for (int k = 0; k < 3; k++)
        normal[k] = foot.distance > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return !(fabs(u[0]) <= 1 && fabs(u[1]) <= 1 && fabs(u[2]) <= 1) ? PANDIS_BOUND
        : cut                                                       ? PANDIS_CUT
                                                                    : PANDIS_OK;
}

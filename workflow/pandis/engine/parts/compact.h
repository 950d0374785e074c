/* -------------------- answers of a packed mesh */

/* State of a search: the nearest face so far (squared distance, its key, and block * 64 + place),
 * the remaining budget of groups and blocks, and the key of the nearest group or block that was not
 * visited. */
typedef struct {
    float squared;
    int32_t key, face, left, unseen;
} pandis__near;

PANDIS__INLINE void pandis__search_block(
    const pandis__compact *t, int32_t block, const double *p, pandis__near *best) {
    pandis__packed b;
    float q[3], d[PANDIS__WIDTH];
    int32_t keys[PANDIS__WIDTH], key, nearest[PANDIS__WIDTH];
    pandis__unpack(t, block, &b);
    for (int k = 0; k < 3; k++) q[k] = (float)(p[k] - b.origin[k]);
    pandis__byte_bounds(b.boxes, b.groups, b.shift, q, keys);
    best->left--;
    while ((key = pandis__least(keys)) <= best->key) {
        int group = key & 7, i = 0;
        if (--best->left < 0) {
            best->unseen = key < best->unseen ? key : best->unseen;
            return;
        }
        keys[group] = INT32_MAX;
        pandis__group_distances(&b, group, q, d);
        memcpy(nearest, d, sizeof nearest);
        int32_t least = pandis__least(nearest),
                face = PANDIS__BLOCK * block + PANDIS__WIDTH * group;
        if (least > (best->key | 7)) continue;
        while (nearest[i] != least) i++;
        if (d[i] < best->squared || (d[i] == best->squared && face + i < best->face))
            best->squared = d[i], best->key = pandis__key(d[i]), best->face = face + i;
    }
}

PANDIS__INLINE void pandis__branch_keys(
    const pandis__branch *branch, const double *p, int32_t *keys) {
    float q[3];
    int shift[3];
    for (int k = 0; k < 3; k++)
        q[k] = (float)(p[k] - branch->origin[k]), shift[k] = branch->shift[k];
    pandis__byte_bounds(branch->boxes[0], branch->count, shift, q, keys);
}

/* Descend depth-first, the nearest branch first; for most points this finds the nearest face early.
 */
PANDIS__INLINE void pandis__search_depth_body(
    const pandis__compact *t, const double *p, pandis__near *best) {
    struct {
        int32_t keys[PANDIS__WIDTH];
        const pandis__branch *branch;
    } path[PANDIS__DEEPEST], *at = path;
    at->branch = t->branches;
    pandis__branch_keys(at->branch, p, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = at->branch->child[key & 7];
        if (best->left < 0) { /* budget spent: the rest is at least this far away */
            best->unseen = key < best->unseen ? key : best->unseen;
            if (at-- == path) return;
        } else if (key > best->key) {
            if (at-- == path) return;
        } else {
            at->keys[key & 7] = INT32_MAX;
            if (child < 0) {
                pandis__search_block(t, ~child, p, best);
            } else {
                (++at)->branch = t->branches + child;
                pandis__branch_keys(at->branch, p, at->keys);
            }
        }
    }
}

PANDIS__COMPILE(pandis__search_depth,
    (const pandis__compact *t, const double *p, pandis__near *best), (t, p, best))

/* Search best-first, so that little is missed when the budget is spent. */
PANDIS__INLINE void pandis__search_best_body(
    const pandis__compact *t, const double *p, pandis__near *best) {
    pandis__waiting heap[PANDIS__HEAP];
    int count = 1;
    heap[0].key = heap[0].child = 0;
    best->unseen = INT32_MAX;
    while (count) {
        pandis__waiting e = pandis__next(heap, count--);
        if (e.key > best->key) return;
        if (best->left < 0) {
            best->unseen = e.key < best->unseen ? e.key : best->unseen;
            return;
        }
        if (e.child < 0) {
            pandis__search_block(t, ~e.child, p, best);
            continue;
        }
        const pandis__branch *branch = t->branches + e.child;
        int32_t keys[PANDIS__WIDTH];
        best->left--;
        pandis__branch_keys(branch, p, keys);
        for (int i = 0; i < branch->count; i++) {
            int32_t out;
            if (keys[i] <= best->key &&
                pandis__wait_or_drop(heap, &count, keys[i], branch->child[i], &out))
                best->unseen = out < best->unseen ? out : best->unseen;
        }
    }
}

PANDIS__COMPILE(pandis__search_best,
    (const pandis__compact *t, const double *p, pandis__near *best), (t, p, best))

/* Find the face nearest to a point (in lattice steps). Returns block * 64 + place, or INT32_MAX if
 * no face is within `reach` (steps). If the search was cut short, `clear` becomes a lower bound of
 * the squared distances to all other faces; else infinite. */
static int32_t pandis__search(
    const pandis__compact *t, const double *p, double reach, float *clear) {
    int32_t soon = pandis__soon(t->most);
    pandis__near best = {FLT_MAX, INT32_MAX - 1, INT32_MAX, soon, INT32_MAX};
    if (reach < 1e18) best.squared = (float)(reach * reach), best.key = pandis__key(best.squared);
    pandis__search_depth(t, p, &best);
    if (best.unseen <= best.key && soon < t->most) {
        best.left = t->most - soon;
        pandis__search_best(t, p, &best);
    }
    *clear = (float)INFINITY;
    if (best.unseen <= best.key) best.unseen &= ~7, memcpy(clear, &best.unseen, sizeof *clear);
    return best.face;
}

/* Read the position of a block's corner, in lattice steps. */
static void pandis__packed_corner(const pandis__packed *b, int corner, double *out) {
    uint64_t word = pandis__word(b, corner);
    for (int k = 0; k < 3; word >>= b->bits[k++])
        out[k] = b->origin[k] + (double)(word & ((1u << b->bits[k]) - 1));
}

/* Read the corners of a face: their numbers in the block, and their positions. */
static void pandis__face_corners(
    const pandis__packed *b, int place, int *corners, double (*at)[3]) {
    const unsigned char *faces = b->faces + PANDIS__GROUP_BYTES * (place / PANDIS__WIDTH);
    for (int k = 0; k < 3; k++) {
        corners[k] = (int)(pandis__six_bits(faces + 6 * k) >> 6 * (place % PANDIS__WIDTH) & 63);
        pandis__packed_corner(b, corners[k], at[k]);
    }
}

/* An entry of a two-bit list. */
static int pandis__two_bits(const unsigned char *list, int at) {
    return list[at / 4] >> 2 * (at % 4) & 3;
}

/* Bit mask of the boxes (at most eight) that a ray from a point along x meets. */
static int pandis__boxes_ahead(const unsigned char *boxes, int count, const int32_t *origin,
    const int *shift, const double *p) {
    int met = 0;
    for (int i = 0; i < count; i++) {
        int ahead = p[0] <= (double)(origin[0] + (boxes[3 * PANDIS__WIDTH + i] << shift[0]));
        for (int k = 1; k < 3; k++)
            ahead &= p[k] >= (double)(origin[k] + (boxes[PANDIS__WIDTH * k + i] << shift[k])) &&
                p[k] <= (double)(origin[k] + (boxes[PANDIS__WIDTH * (3 + k) + i] << shift[k]));
        met |= ahead << i;
    }
    return met;
}

/* Twice the signed area that an edge and a point span, seen along x. The edge's two directions give
 * exactly opposite values, so that a ray close to the edge meets exactly one of its two faces. */
static double pandis__beside(const double *a, const double *b, const double *p) {
    int turn = a[1] > b[1] || (a[1] == b[1] && a[2] > b[2]);
    const double *s = turn ? b : a, *e = turn ? a : b;
    double area = (e[1] - s[1]) * (p[2] - s[2]) - (e[2] - s[2]) * (p[1] - s[1]);
    return turn ? -area : area;
}

/* Change of the winding number at a triangle, for a ray from a point along x. */
static int pandis__crossing(const double (*c)[3], const double *p) {
    double area[3], all = 0, x = 0;
    int left = 0;
    for (int k = 0; k < 3; k++) {
        const double *a = c[k], *b = c[(k + 1) % 3];
        area[k] = pandis__beside(a, b, p);
        /* a point on the edge counts as left of it if the edge leads upwards */
        left += area[k] > 0 || (area[k] == 0 && (a[1] < b[1] || (a[1] == b[1] && a[2] < b[2])));
        all += area[k];
    }
    if (left % 3 || !(all < 0 || all > 0)) return 0;
    for (int k = 0; k < 3; k++) x += c[(k + 2) % 3][0] * (area[k] / all);
    return x > p[0] ? (all > 0 ? 1 : -1) : 0;
}

/* Winding number of a point: exits minus entries of a ray along x through the faces. */
PANDIS__APART static int pandis__winding(const pandis__compact *t, const double *p) {
    int32_t stack[PANDIS__STACK];
    int top = 1, turns = 0, shift[3];
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (child >= 0) {
            const pandis__branch *branch = t->branches + child;
            for (int k = 0; k < 3; k++) shift[k] = branch->shift[k];
            int met =
                pandis__boxes_ahead(branch->boxes[0], branch->count, branch->origin, shift, p);
            for (int i = 0; i < branch->count; i++)
                if (met >> i & 1) stack[top++] = branch->child[i];
            continue;
        }
        pandis__packed b;
        pandis__unpack(t, ~child, &b);
        int met = pandis__boxes_ahead(b.boxes, b.groups, b.origin, b.shift, p);
        for (int place = 0; place < b.face_count; place++) {
            double c[3][3];
            int corners[3];
            if (!(met >> place / PANDIS__WIDTH & 1)) continue;
            pandis__face_corners(&b, place, corners, c);
            turns += pandis__crossing((const double (*)[3])c, p);
        }
    }
    return turns;
}

/* Bit mask of the boxes (at most eight) that a segment from a point meets beyond the share `from`
 * of its length. */
static int pandis__boxes_between(const unsigned char *boxes, int count, const int32_t *origin,
    const int *shift, const double *p, const double *way, double from) {
    int met = 0;
    for (int i = 0; i < count; i++) {
        double enter = from, leave = 1;
        for (int k = 0; k < 3; k++) {
            double low =
                (double)(origin[k] + (boxes[PANDIS__WIDTH * k + i] << shift[k])) - p[k] - 1e-6;
            double high = (double)(origin[k] + (boxes[PANDIS__WIDTH * (3 + k) + i] << shift[k])) -
                p[k] + 1e-6;
            double a = low / way[k], b = high / way[k], first = a < b ? a : b, last = a < b ? b : a;
            if (way[k] == 0) first = low <= 0 && high >= 0 ? from : 2, last = 1;
            enter = first > enter ? first : enter, leave = last < leave ? last : leave;
        }
        met |= (enter <= leave) << i;
    }
    return met;
}

/* Find the side of a point from the first face on the segment to a target. The segment is free up
 * to the share `from` of its length. If it meets too many faces, the target's face decides. */
PANDIS__APART static int pandis__first_side(
    const pandis__compact *t, const double *p, const double *target, const double *n, double from) {
    int32_t stack[PANDIS__STACK], left = t->most;
    double way[3], nearest = 1;
    int top = 1, shift[3];
    for (int k = 0; k < 3; k++) way[k] = target[k] - p[k];
    int own = pandis__dot(n, way) > 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE, side = own;
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (child >= 0) {
            const pandis__branch *branch = t->branches + child;
            for (int k = 0; k < 3; k++) shift[k] = branch->shift[k];
            int met = pandis__boxes_between(
                branch->boxes[0], branch->count, branch->origin, shift, p, way, from);
            for (int i = 0; i < branch->count; i++)
                if (met >> i & 1) stack[top++] = branch->child[i];
            continue;
        }
        pandis__packed b;
        pandis__unpack(t, ~child, &b);
        int met = pandis__boxes_between(b.boxes, b.groups, b.origin, b.shift, p, way, from);
        for (int place = 0; place < b.face_count; place++) {
            double corner[3][3], at;
            const double *c[3] = {corner[0], corner[1], corner[2]};
            int corners[3];
            if (!(met >> place / PANDIS__WIDTH & 1)) continue;
            if (place % PANDIS__WIDTH == 0 && --left < 0) return own;
            pandis__face_corners(&b, place, corners, corner);
            int sign = pandis__meets(c, p, way, &at);
            if (sign && at < nearest)
                nearest = at, side = sign < 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
        }
    }
    return side;
}

/* How to find the side of a point with this closest point. */
static int pandis__tells(
    const pandis__packed *b, int place, const int *corners, const pandis__foot *foot) {
    int tells = PANDIS__BY_FACE;
    if (!b->sides) return tells;
    const unsigned char *edges = b->sides + (b->corner_count + 3) / 4,
                        *faces = edges + 6 * b->groups;
    if (foot->corner >= 0) tells = pandis__two_bits(b->sides, corners[foot->corner]);
    else if (foot->edge >= 0) tells = pandis__two_bits(edges, 3 * place + foot->edge);
    return tells == PANDIS__BY_FACE ? pandis__two_bits(faces, place) : tells;
}

/* Find the side of a point after a search that was cut short: other faces may be nearer, but not
 * nearer than `clear`. */
static int pandis__cut_side(const pandis__compact *t, const double *p, const double (*corner)[3],
    const pandis__foot *foot, const double *n, double clear) {
    double target[3]; /* next to the foot, within the face */
    if (!(foot->distance > 0)) return PANDIS__OUTSIDE;
    for (int k = 0; k < 3; k++) {
        double middle = (corner[0][k] + corner[1][k] + corner[2][k]) / 3,
               at = p[k] - foot->offset[k];
        target[k] = at + 1e-3 * (middle - at);
    }
    return pandis__first_side(t, p, target, n, 0.999 * clear / foot->distance);
}

PANDIS__APART static pandis_flag pandis__answer_compact(const pandis__compact *t, const double *u,
    pandis__start *begin, double *distance, double *normal, double *clear) {
    double p[3], corner[3][3], side[2][3], n[3], most = 0, size = t->step;
    const double *c[3] = {corner[0], corner[1], corner[2]};
    float unseen;
    for (int k = 0; k < 3; k++) most = fabs(u[k]) > most ? fabs(u[k]) : most;
    /* a very distant point has the same nearest face as a nearer point in the same direction */
    double nearer = most > 1024 ? 1024 / most : 1;
    for (int k = 0; k < 3; k++) p[k] = (u[k] * nearer + PANDIS__HALF) / t->step;
    /* a little beyond the reach: single precision may overestimate distances */
    double steps = nearer < 1 ? (double)INFINITY : (begin->reach * 1.0001 + 1e-3) / t->step;
    int32_t face = pandis__search(t, p, steps, &unseen);
    /* a search with a reach may find another face if it is cut short: repeat it without a reach */
    if (unseen < FLT_MAX && steps < 1e18)
        steps = (double)INFINITY, face = pandis__search(t, p, steps, &unseen);
    if (face == INT32_MAX && steps < 1e18) {
        *clear = begin->reach;
        return PANDIS_BEYOND;
    }
    if (face == INT32_MAX) return PANDIS_INVALID;
    begin->face = t->original ? t->original[face] : -1, begin->place = face;
    pandis__packed b;
    pandis__foot foot;
    pandis__unpack(t, face / PANDIS__BLOCK, &b);
    int place = face % PANDIS__BLOCK, corners[3], cut = unseen < FLT_MAX;
    pandis__face_corners(&b, place, corners, corner);
    if (nearer < 1) { /* in the unit frame, where squares do not overflow */
        size = 1;
        for (int k = 0; k < 3; k++) p[k] = u[k];
        for (int k = 0; k < 9; k++)
            corner[k / 3][k % 3] = corner[k / 3][k % 3] * t->step - PANDIS__HALF;
    }
    if (!pandis__inner_foot(c, p, (double)INFINITY, &foot)) pandis__rim_foot(c, p, &foot);
    pandis__keep_feature(c, &foot, begin);
    foot.distance = sqrt(pandis__dot(foot.offset, foot.offset));
    for (int k = 0; k < 3; k++)
        side[0][k] = corner[1][k] - corner[0][k], side[1][k] = corner[2][k] - corner[0][k];
    pandis__cross(side[0], side[1], n);
    if (!pandis__normalise(n)) n[0] = n[1] = 0, n[2] = 1;
    int tells = most > t->reach ? PANDIS__OUTSIDE : pandis__tells(&b, place, corners, &foot);
    if (cut && most <= t->reach)
        tells = pandis__cut_side(t, p, (const double (*)[3])corner, &foot, n, sqrt((double)unseen));
    if (tells == PANDIS__BY_RAY)
        tells = pandis__winding(t, p) > 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
    if (tells == PANDIS__BY_FACE)
        tells = pandis__dot(foot.offset, n) < 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
    double sign = tells == PANDIS__INSIDE ? -1 : 1;
    *distance = sign * foot.distance * size;
    *clear = !cut ? foot.distance * size : nearer < 1 ? 0 : sqrt((double)unseen) * t->step;
    if (*clear > foot.distance * size) *clear = foot.distance * size;
    for (int k = 0; k < 3; k++)
        normal[k] = foot.distance * size > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return most > 1 ? PANDIS_BOUND : cut ? PANDIS_CUT : PANDIS_OK;
}

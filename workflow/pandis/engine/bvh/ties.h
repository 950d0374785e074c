/* The nearest face, and whether another closest point is about as near. */

#define NOTED 512 /* more leaves than all but very few searches open */

/* Leaves that a search has opened, and the smallest squared distance in each, as it seems in single
 * precision; `count` may be larger than NOTED, and then the rest is not noted. */
typedef struct {
    double least[NOTED];
    int32_t leaves[NOTED];
    int count;
} Opened;

/* Find the nearest face within `limit` (INT32_MAX: none), and note all leaves with a face that may
 * be farther by at most the fraction `relative`. */
static int32_t find_nearest(
    const pandis__mesh *m, const double *p, double limit, double relative, Opened *opened) {
    struct {
        int32_t keys[WIDTH], node;
    } path[PANDIS__DEEPEST], *at = path;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    int32_t within = pandis__limit_key(limit * (1 + relative));
    pandis__seeking s = {.limit = limit,
        .squared = limit * limit,
        .face = INT32_MAX,
        .left = INT32_MAX,
        .unseen = INT32_MAX};
    opened->count = 0, at->node = 0;
    pandis__box_keys(m->nodes, q, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = m->nodes[at->node].child[key & 7];
        if (key > within) {
            if (at-- == path) break;
            continue;
        }
        at->keys[key & 7] = INT32_MAX;
        if (child >= 0) {
            (++at)->node = child;
            pandis__box_keys(m->nodes + child, q, at->keys);
            continue;
        }
        double least = pandis__look_into(m, m->leaves + ~child, p, &s);
        if (opened->count < NOTED)
            opened->least[opened->count] = least, opened->leaves[opened->count] = ~child;
        opened->count++;
        within = pandis__limit_key(s.limit * (1 + relative));
    }
    pandis__choose(m, p, limit, &s);
    return s.face;
}

/* What a search for ties knows: the point, the face and the foot that are nearest, up to which
 * distance a face counts, and the cosine of the angle by which its direction must differ. */
typedef struct {
    const double *p;
    const Foot *foot;
    int32_t face;
    double reach, cosine;
} Tie;

/* Whether a face is so near to the closest point that no point of it lies in another direction. All
 * distances are at least the foot's, d, so between directions that differ by the angle a there are
 * at least 2 d sin(a / 2). */
static int is_beside(const pandis__mesh *m, int32_t face, const Tie *tie) {
    double d = tie->foot->distance, least = 2 * (1 - tie->cosine) * d * d * (1 - 1e-6);
    for (int j = 0; j < 3; j++) {
        const double *c = pandis__corner(m, face, j);
        double x[3];
        for (int k = 0; k < 3; k++) x[k] = c[k] - tie->p[k] + tie->foot->offset[k];
        if (!(dot(x, x) < least)) return 0;
    }
    return 1;
}

/* Whether another face of a leaf has a closest point within reach, in another direction. */
static int ties_in(const pandis__mesh *m, const Leaf *leaf, const Tie *tie) {
    double seems[WIDTH], squared[PANDIS__FOUR];
    int32_t faces[PANDIS__FOUR];
    float slack[2];
    pandis__seem(m, leaf, tie->p, seems, slack);
    double farthest = pandis__may_seem(tie->reach, slack);
    for (int i = 0; i < WIDTH;) {
        int some = 0;
        for (; i < WIDTH && some < PANDIS__FOUR; i++)
            if (leaf->face[i] >= 0 && leaf->face[i] != tie->face && seems[i] <= farthest &&
                !is_beside(m, leaf->face[i], tie))
                faces[some++] = leaf->face[i];
        if (!some) return 0;
        for (int k = some; k < PANDIS__FOUR; k++) faces[k] = faces[0];
        pandis__four_squared(m, faces, tie->p, squared);
        for (int k = 0; k < some; k++) {
            Foot second;
            if (!(squared[k] <= tie->reach * tie->reach)) continue;
            pandis__find_mesh_foot(m, faces[k], tie->p, &second);
            if (dot(second.offset, tie->foot->offset) <
                tie->cosine * second.distance * tie->foot->distance)
                return 1;
        }
    }
    return 0;
}

/* Whether another closest point is about as near, in another direction; `opened` is what the search
 * for the nearest face has opened. */
static int has_tie(const pandis__mesh *m, const Tie *tie, const Opened *opened) {
    int32_t stack[STACK], keys[WIDTH], within = pandis__limit_key(tie->reach);
    float q[3] = {(float)tie->p[0], (float)tie->p[1], (float)tie->p[2]};
    int top = 0;
    if (opened->count <= NOTED) {
        for (int i = 0; i < opened->count; i++) {
            const Leaf *leaf = m->leaves + opened->leaves[i];
            float slack[2] = {leaf->slack, leaf->share};
            if (opened->least[i] <= pandis__may_seem(tie->reach, slack) && ties_in(m, leaf, tie))
                return 1;
        }
        return 0;
    }
    stack[top++] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (child < 0) {
            if (ties_in(m, m->leaves + ~child, tie)) return 1;
            continue;
        }
        pandis__box_keys(m->nodes + child, q, keys);
        for (int i = 0; i < WIDTH; i++)
            if (keys[i] <= within) stack[top++] = m->nodes[child].child[i];
    }
    return 0;
}

/* ---------------------------------------------------------------- planes that a proxy touches */

#define PANDIS__PLANES 4 /* three that are kept, and the one of the last look */

/* A piece of the surface near a proxy, taken as flat: what is free lies where normal . x >= offset (unit frame). */
typedef struct {
    double normal[3], offset, foot[3];
} pandis__plane;

static double pandis__height(const pandis__plane *p, const double *x) { return pandis__dot(p->normal, x) - p->offset; }

/* The point on one, two or three planes that is nearest to a goal, if the goal is behind all of them together: each
 * has to push, or the point is not the nearest one in front of them. 0 if not so, or if they are nearly parallel. */
static int pandis__onto(const pandis__plane *planes, const int *which, int count, const double *goal, double *y) {
    double gram[3][3], right[3], push[3];
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < count; j++) gram[i][j] = pandis__dot(planes[which[i]].normal, planes[which[j]].normal);
        right[i] = -pandis__height(planes + which[i], goal);
    }
    if (count == 1) {
        push[0] = right[0];
    } else if (count == 2) {
        double cross[3], c = gram[0][1];
        pandis__cross(planes[which[0]].normal, planes[which[1]].normal, cross);
        double det = pandis__dot(cross, cross); /* 1 - c^2, without what that loses */
        if (!(det > 1e-14)) return 0;
        push[0] = (right[0] - c * right[1]) / det, push[1] = (right[1] - c * right[0]) / det;
    } else {
        double across[3][3], sum[3];
        for (int i = 0; i < 3; i++)
            pandis__cross(planes[which[(i + 1) % 3]].normal, planes[which[(i + 2) % 3]].normal, across[i]);
        double det = pandis__dot(planes[which[0]].normal, across[0]);
        if (!(fabs(det) > 1e-9)) return 0;
        for (int k = 0; k < 3; k++)
            sum[k] = (right[0] * across[0][k] + right[1] * across[1][k] + right[2] * across[2][k]) / det;
        for (int i = 0; i < 3; i++) push[i] = pandis__dot(sum, across[i]) / det;
    }
    for (int k = 0; k < 3; k++) y[k] = goal[k];
    for (int i = 0; i < count; i++) {
        if (!(push[i] >= 0)) return 0;
        for (int k = 0; k < 3; k++) y[k] += push[i] * planes[which[i]].normal[k];
    }
    return 1;
}

/* The point nearest to a goal in front of all planes; returns which of them hold it back, a bit for each. With planes
 * that nothing satisfies together, the last one, which was looked at last, decides. */
static int pandis__nearest_in_front(const pandis__plane *planes, int count, const double *goal, double *y) {
    static const int sets[14][4] = {{1, 0}, {1, 1}, {1, 2}, {1, 3}, {2, 0, 1}, {2, 0, 2}, {2, 1, 2}, {2, 0, 3},
                                    {2, 1, 3}, {2, 2, 3}, {3, 0, 1, 2}, {3, 0, 1, 3}, {3, 0, 2, 3}, {3, 1, 2, 3}};
    double slack = 1e-13;
    int behind = 0;
    for (int i = 0; i < count; i++) behind |= pandis__height(planes + i, goal) < 0;
    memcpy(y, goal, 3 * sizeof *y);
    if (!behind) return 0;
    for (int s = 0; s < 14; s++) {
        const int *which = sets[s] + 1;
        int active = 0, good = 1;
        for (int i = 0; i < sets[s][0]; i++) good &= which[i] < count, active |= 1 << which[i];
        if (!good || !pandis__onto(planes, which, sets[s][0], goal, y)) continue;
        for (int i = 0; good && i < count; i++)
            good = active >> i & 1 || pandis__height(planes + i, y) >= -slack;
        if (good) return active;
    }
    int last = count - 1;
    memcpy(y, goal, 3 * sizeof *y);
    double under = pandis__height(planes + last, goal);
    for (int k = 0; under < 0 && k < 3; k++) y[k] -= under * planes[last].normal[k];
    return under < 0 ? 1 << last : 0;
}

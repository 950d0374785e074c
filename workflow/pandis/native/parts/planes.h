/* ---------------------------------------------------------------- planes that a proxy touches */

#define PANDIS__KEPT 8   /* planes from step to step: all walls of a corner, for which three hold the proxy changes with the probe */
#define PANDIS__PLANES 9 /* and the one of the last look */

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

/* Whether a set of planes, by their bits, gives the point: all others lie behind it. */
static int pandis__gives(const pandis__plane *planes, int count, const int *which, int size, const double *goal, double *y) {
    int active = 0;
    if (!pandis__onto(planes, which, size, goal, y)) return 0;
    for (int i = 0; i < size; i++) active |= 1 << which[i];
    for (int i = 0; i < count; i++)
        if (!(active >> i & 1) && pandis__height(planes + i, y) < -1e-13) return 0;
    return active;
}

/* The point nearest to a goal in front of all planes; returns which of them hold it back, a bit for each. With planes
 * that nothing satisfies together, the last one, which was looked at last, decides. */
static int pandis__nearest_in_front(const pandis__plane *planes, int count, const double *goal, double *y) {
    int which[3], active = 0, behind = 0;
    for (int i = 0; i < count; i++) behind |= pandis__height(planes + i, goal) < 0;
    memcpy(y, goal, 3 * sizeof *y);
    if (!behind) return 0;
    for (int i = 0; i < count; i++)
        if (which[0] = i, (active = pandis__gives(planes, count, which, 1, goal, y))) return active;
    for (int j = 1; j < count; j++)
        for (int i = 0; i < j; i++)
            if (which[0] = i, which[1] = j, (active = pandis__gives(planes, count, which, 2, goal, y))) return active;
    for (int k = 2; k < count; k++)
        for (int j = 1; j < k; j++)
            for (int i = 0; i < j; i++)
                if (which[0] = i, which[1] = j, which[2] = k, (active = pandis__gives(planes, count, which, 3, goal, y)))
                    return active;
    int last = count - 1;
    memcpy(y, goal, 3 * sizeof *y);
    double under = pandis__height(planes + last, goal);
    for (int k = 0; under < 0 && k < 3; k++) y[k] -= under * planes[last].normal[k];
    return under < 0 ? 1 << last : 0;
}

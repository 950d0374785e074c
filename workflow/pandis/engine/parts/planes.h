/* -------------------- planes that a proxy touches */

/* planes kept between steps: all walls of a corner, since any three may hold the proxy */
#define PANDIS__KEPT 8
#define PANDIS__PLANES 9 /* plus the plane of the last look */

/* A piece of the surface near a proxy, taken as flat: free space is where normal . x >= offset
 * (unit frame). */
typedef struct {
    double normal[3], offset, foot[3];
} pandis__plane;

static double pandis__height(const pandis__plane *p, const double *x) {
    return pandis__dot(p->normal, x) - p->offset;
}

/* Find the point on two or three planes that is nearest to a goal, if it is also the nearest one in
 * front of them, that is, if each plane pushes. Returns 0 if a plane does not push, or if the
 * planes are nearly parallel. */
static int pandis__onto(const pandis__plane *planes, const int *which, int count,
    const double *under, const double *goal, double *y) {
    const double *a = planes[which[0]].normal, *b = planes[which[1]].normal;
    double push[3], across[3][3], sum[3];
    pandis__cross(a, b, across[2]);
    if (count == 2) {
        /* 1 - c^2 without cancellation */
        double c = pandis__dot(a, b), det = pandis__dot(across[2], across[2]);
        if (!(det > 1e-14)) return 0;
        push[0] = (c * under[which[1]] - under[which[0]]) / det,
        push[1] = (c * under[which[0]] - under[which[1]]) / det;
    } else {
        const double *last = planes[which[2]].normal;
        pandis__cross(b, last, across[0]), pandis__cross(last, a, across[1]);
        double det = pandis__dot(a, across[0]);
        if (!(fabs(det) > 1e-9)) return 0;
        for (int k = 0; k < 3; k++)
            sum[k] = -(under[which[0]] * across[0][k] + under[which[1]] * across[1][k] +
                         under[which[2]] * across[2][k]) /
                det;
        for (int i = 0; i < 3; i++) push[i] = pandis__dot(sum, across[i]) / det;
    }
    for (int k = 0; k < 3; k++) y[k] = goal[k];
    for (int i = 0; i < count; i++) {
        if (!(push[i] >= 0)) return 0;
        for (int k = 0; k < 3; k++) y[k] += push[i] * planes[which[i]].normal[k];
    }
    return 1;
}

/* Find the point nearest to a goal on one to three planes. It counts if the goal is behind one of
 * these planes, and the point in front of all other planes. Returns a bit mask of these planes,
 * or 0 if the point does not count. */
static int pandis__gives(const pandis__plane *planes, int count, const int *which, int size,
    const double *under, int behind, const double *goal, double *y) {
    int set = 0;
    for (int i = 0; i < size; i++) set |= 1 << which[i];
    if (!(set & behind)) return 0;
    if (size == 1)
        for (int k = 0; k < 3; k++) y[k] = goal[k] - under[which[0]] * planes[which[0]].normal[k];
    else if (!pandis__onto(planes, which, size, under, goal, y)) return 0;
    for (int i = 0; i < count; i++)
        if (!(set >> i & 1) && pandis__height(planes + i, y) < -1e-13) return 0;
    return set;
}

/* Find the point nearest to a goal in front of all planes; returns a bit mask of the planes that
 * hold it back. If no point is in front of all planes, the last plane, which is the newest,
 * decides. */
static int pandis__nearest_in_front(
    const pandis__plane *planes, int count, const double *goal, double *y) {
    double under[PANDIS__PLANES];
    int set, behind = 0;
    for (int i = 0; i < count; i++)
        under[i] = pandis__height(planes + i, goal), behind |= (under[i] < 0) << i;
    memcpy(y, goal, 3 * sizeof *y);
    if (!behind) return 0;
    for (int i = 0; i < count; i++)
        if ((set = pandis__gives(planes, count, &i, 1, under, behind, goal, y))) return set;
    for (int j = 1; j < count; j++)
        for (int i = 0; i < j; i++) {
            const int which[2] = {i, j};
            if ((set = pandis__gives(planes, count, which, 2, under, behind, goal, y))) return set;
        }
    for (int k = 2; k < count; k++)
        for (int j = 1; j < k; j++)
            for (int i = 0; i < j; i++) {
                const int which[3] = {i, j, k};
                if ((set = pandis__gives(planes, count, which, 3, under, behind, goal, y)))
                    return set;
            }
    int last = count - 1;
    for (int k = 0; k < 3; k++) y[k] = goal[k] - fmin(0, under[last]) * planes[last].normal[k];
    return under[last] < 0 ? 1 << last : 0;
}

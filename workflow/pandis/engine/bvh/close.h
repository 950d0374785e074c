/* Distances of points next to the surface, to the last digit: a part of bvh.c. */
#include "../faces/sums.h"

/* The share of a point's distance from a triangle's farthest corner below which its distance from
 * the triangle may lose the digits of single precision when computed in double. */
#define CLOSE 0x1p-25

/* The length of twice the area vector of a triangle. */
static double double_area(const double *a, const double *b, const double *c) {
    double n[3];
    for (int k = 0; k < 3; k++) n[k] = exact_area(a, b, c, (k + 1) % 3, (k + 2) % 3);
    return sqrt(dot(n, n));
}

/* The distance of a point from a face. Close to the face, where differences of coordinates leave
 * few digits, it is an exact volume or area divided by its base. */
static double find_distance(const Bvh *t, int32_t face, const double *p, const Foot *foot) {
    const double *c[3];
    double farthest = 0;
    if (foot->corner >= 0 || foot->distance >= 4 * CLOSE * t->scale) return foot->distance;
    for (int k = 0; k < 3; k++) {
        c[k] = corner(t, face, k);
        for (int i = 0; i < 3; i++) farthest = fmax(farthest, fabs(p[i] - c[k][i]));
    }
    if (foot->distance >= CLOSE * farthest) return foot->distance;
    if (foot->edge < 0) {
        double base = double_area(c[0], c[1], c[2]);
        return base > 0 ? fabs(exact_volume(c[0], c[1], c[2], p)) / base : foot->distance;
    }
    const double *a = c[foot->edge], *b = c[(foot->edge + 1) % 3];
    double side[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    return double_area(a, b, p) / sqrt(dot(side, side));
}

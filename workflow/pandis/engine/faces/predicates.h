/* Exact signs of determinants: a part of faces.c and solid.c.
 *
 * Floating point decides where its error bound allows; otherwise exact sums (sums.h). */
#include "sums.h"

#define ROUNDING 0x1p-53
/* Relative errors of the determinants in floating point. */
#define AREA_ERROR ((3 + 16 * ROUNDING) * ROUNDING)
#define VOLUME_ERROR ((7 + 56 * ROUNDING) * ROUNDING)

static double least(double a, double b) { return a < b ? a : b; }

static double most(double a, double b) { return a > b ? a : b; }

static int sign(double x) { return (x > 0) - (x < 0); }

/* The sign of the area of a triangle a, b, c, seen along the axis that is neither x nor y. */
static int turn(const double *a, const double *b, const double *c, int x, int y) {
    double one = (a[x] - c[x]) * (b[y] - c[y]), other = (a[y] - c[y]) * (b[x] - c[x]);
    double area = one - other, size = fabs(one) + fabs(other);
    if (fabs(area) > AREA_ERROR * size || size == 0) return sign(area);
    return sign(exact_area(a, b, c, x, y));
}

#define UNSURE 2

/* On which side of the plane of a, b, c a point is, if floating point can tell. */
static int quick_side(const double *a, const double *b, const double *c, const double *p) {
    double u[3], v[3], w[3], volume = 0, size = 0;
    for (int k = 0; k < 3; k++) u[k] = a[k] - p[k], v[k] = b[k] - p[k], w[k] = c[k] - p[k];
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        double one = u[x] * v[y], other = u[y] * v[x];
        volume += w[k] * (one - other), size += fabs(w[k]) * (fabs(one) + fabs(other));
    }
    return fabs(volume) > VOLUME_ERROR * size || size == 0 ? sign(volume) : UNSURE;
}

/* On which side of the plane of a, b, c a point is: 1, -1, or 0 in the plane. */
static int side(const double *a, const double *b, const double *c, const double *p) {
    int quick = quick_side(a, b, c, p);
    return quick == UNSURE ? sign(exact_volume(a, b, c, p)) : quick;
}

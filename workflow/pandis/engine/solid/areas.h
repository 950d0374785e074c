/* Areas of faces: a part of solid.c. */

#define LEAST_AREA 1e-6 /* square cells, twice the area */

/* Twice the area of a face times its normal. */
static void area_of(const double *places, const Face *f, double *n) {
    const double *p = places + 3 * (int64_t)f->corner[0];
    const double *q = places + 3 * (int64_t)f->corner[1], *r = places + 3 * (int64_t)f->corner[2];
    double u[3], v[3];
    for (int k = 0; k < 3; k++) u[k] = q[k] - p[k], v[k] = r[k] - p[k];
    cross(u, v, n);
}

static double length(const double *a) { return sqrt(dot(a, a)); }

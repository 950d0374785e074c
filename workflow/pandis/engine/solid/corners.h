/* Sharp edges and corners of the source inside a cell: a part of solid.c.
 *
 * A cell whose triangles differ in direction gets a vertex where their planes meet (Kobbelt et al.
 * 2001; Ju et al. 2002), and its loop becomes a cone. The vertex is clamped into the cell, which is
 * convex, so the cone meets no other cell's surface. */

#define SHARP 0.9   /* cosine of the least angle between two normals */
#define WEAK 0.05   /* directions with a smaller share of the largest eigenvalue are not solved */
#define BEYOND 0.25 /* cells outside the cell from which a vertex is still clamped into it */
#define FROM_SIDE 0.002

/* Eigenvalues and eigenvectors (columns) of a symmetric matrix, by Jacobi's rotations. */
static void eigen(double a[3][3], double *value, double q[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) q[i][j] = i == j;
    for (int sweep = 0; sweep < 30; sweep++)
        for (int i = 0; i < 2; i++)
            for (int j = i + 1; j < 3; j++) {
                if (fabs(a[i][j]) < 1e-300) continue;
                double theta = (a[j][j] - a[i][i]) / (2 * a[i][j]);
                double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 3; k++) {
                    double x = a[k][i], y = a[k][j];
                    a[k][i] = c * x - s * y, a[k][j] = s * x + c * y;
                }
                for (int k = 0; k < 3; k++) {
                    double x = a[i][k], y = a[j][k];
                    a[i][k] = c * x - s * y, a[j][k] = s * x + c * y;
                }
                for (int k = 0; k < 3; k++) {
                    double x = q[k][i], y = q[k][j];
                    q[k][i] = c * x - s * y, q[k][j] = s * x + c * y;
                }
            }
    for (int i = 0; i < 3; i++) value[i] = a[i][i];
}

/* The point where planes meet, or the one nearest to the middle of those; `middle` on entry. */
static void meeting_point(
    int count, double normal[][3], const double *const *place, double *point) {
    double a[3][3] = {{0}}, b[3] = {0}, value[3], q[3][3], middle[3];
    memcpy(middle, point, sizeof middle);
    for (int k = 0; k < count; k++) {
        double offset[3], height;
        for (int j = 0; j < 3; j++) offset[j] = place[k][j] - middle[j];
        height = dot(normal[k], offset);
        for (int i = 0; i < 3; i++) {
            b[i] += normal[k][i] * height;
            for (int j = 0; j < 3; j++) a[i][j] += normal[k][i] * normal[k][j];
        }
    }
    eigen(a, value, q);
    double largest = fmax(value[0], fmax(value[1], value[2]));
    for (int i = 0; i < 3; i++) {
        if (value[i] <= WEAK * largest) continue;
        double along = (q[0][i] * b[0] + q[1][i] * b[1] + q[2][i] * b[2]) / value[i];
        for (int j = 0; j < 3; j++) point[j] += along * q[j][i];
    }
}

/* Find the vertex of a loop in the cell at `base`; returns 0 if the surface there is not sharp. */
static int find_corner(const Lattice *l, const int32_t *at, const int8_t *edge, int size, int solid,
    const int32_t *base, double *point) {
    double normal[12][3], least = 1;
    const double *place[12];
    for (int k = 0; k < size; k++) {
        const Vertex *v = l->vertices + at[edge[k]];
        const CellEdge *e = CELL_EDGES + edge[k];
        if (v->origin != ON_SURFACE) return 0;
        place[k] = l->places + 3 * (int64_t)at[edge[k]];
        normal_of(l, v->triangle, normal[k]);
        int out = solid >> e->low & 1 ? 1 : -1;
        if (out * normal[k][e->axis] < 0) /* the source's orientation may be wrong */
            for (int j = 0; j < 3; j++) normal[k][j] = -normal[k][j];
        for (int i = 0; i < k; i++) {
            double cosine = dot(normal[k], normal[i]);
            if (cosine < least) least = cosine;
        }
    }
    if (least >= SHARP) return 0;
    for (int j = 0; j < 3; j++) {
        point[j] = 0;
        for (int k = 0; k < size; k++) point[j] += place[k][j] / size;
    }
    meeting_point(size, normal, place, point);
    for (int j = 0; j < 3; j++) {
        double inside = point[j] - base[j];
        if (!(inside >= -BEYOND && inside <= 1 + BEYOND)) return 0;
        point[j] = base[j] + rounded(fmin(fmax(inside, FROM_SIDE), 1 - FROM_SIDE));
    }
    return 1;
}

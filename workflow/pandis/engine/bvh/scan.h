/* Brute force, as in a program without a tree: all triangles for every point. A part of bvh.c. */

#define LANES 4

typedef struct {
    double a[3][LANES], ab[3][LANES], ac[3][LANES];
    double per_ab[LANES], per_ac[LANES], per_bc[LANES];     /* 1 / squared length */
    double gram_ab[LANES], gram_mix[LANES], gram_ac[LANES]; /* Gram matrix / determinant */
} Lanes;

static void set_lane(Lanes *lanes, int lane, const double *p, const double *q, const double *s) {
    double ab[3], ac[3], bc[3], n[3];
    for (int k = 0; k < 3; k++) {
        ab[k] = q[k] - p[k], ac[k] = s[k] - p[k], bc[k] = s[k] - q[k];
        lanes->a[k][lane] = p[k], lanes->ab[k][lane] = ab[k], lanes->ac[k][lane] = ac[k];
    }
    double aa = dot(ab, ab), cc = dot(ac, ac), bb = dot(bc, bc), mix = dot(ab, ac);
    cross(ab, ac, n);
    double det = dot(n, n);
    lanes->per_ab[lane] = aa > 0 ? 1 / aa : 0;
    lanes->per_ac[lane] = cc > 0 ? 1 / cc : 0;
    lanes->per_bc[lane] = bb > 0 ? 1 / bb : 0;
    /* no point projects into a triangle without area: NaN fails every comparison */
    lanes->gram_ab[lane] = det > 0 ? aa / det : NAN;
    lanes->gram_mix[lane] = det > 0 ? mix / det : NAN;
    lanes->gram_ac[lane] = det > 0 ? cc / det : NAN;
}

/* Squared distances to four triangles, equal to pandis__face_squared to the last bit. */
static void lane_distances(
    const Lanes *restrict f, const double *restrict p, double *restrict out) {
    for (int i = 0; i < LANES; i++) {
        double x = p[0] - f->a[0][i], y = p[1] - f->a[1][i], z = p[2] - f->a[2][i];
        double ux = f->ab[0][i], uy = f->ab[1][i], uz = f->ab[2][i];
        double vx = f->ac[0][i], vy = f->ac[1][i], vz = f->ac[2][i];
        double wx = vx - ux, wy = vy - uy, wz = vz - uz;
        double du = ux * x + uy * y + uz * z, dv = vx * x + vy * y + vz * z;
        double s = pandis__clamp01(du * f->per_ab[i]), t = pandis__clamp01(dv * f->per_ac[i]);
        double rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        double best = rx * rx + ry * ry + rz * rz;
        rx = x - t * vx, ry = y - t * vy, rz = z - t * vz;
        double d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        double bx = x - ux, by = y - uy, bz = z - uz;
        double r = pandis__clamp01((wx * bx + wy * by + wz * bz) * f->per_bc[i]);
        rx = bx - r * wx, ry = by - r * wy, rz = bz - r * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        s = f->gram_ac[i] * du - f->gram_mix[i] * dv;
        t = f->gram_ab[i] * dv - f->gram_mix[i] * du;
        rx = x - s * ux - t * vx, ry = y - s * uy - t * vy, rz = z - s * uz - t * vz;
        d = rx * rx + ry * ry + rz * rz;
        int inside = (s >= 0) & (t >= 0) & (s + t <= 1);
        out[i] = inside && d < best ? d : best;
    }
}

/* Answer points by testing all triangles. Returns 0 if memory is short. */
int bvh_scan(const Bvh *t, const double *points, int64_t count, double *distance, double *normal) {
    pandis__mesh m = view(t);
    int32_t rows = t->face_count / LANES + (t->face_count % LANES > 0);
    Lanes *lanes = malloc((size_t)rows * sizeof *lanes);
    if (!lanes) return 0;
    for (int64_t i = 0; i < (int64_t)rows * LANES; i++) {
        int32_t face = i < t->face_count ? (int32_t)i : t->face_count - 1;
        set_lane(lanes + i / LANES, (int)(i % LANES), corner(t, face, 0), corner(t, face, 1),
            corner(t, face, 2));
    }
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        double best = INFINITY, d[LANES], n[3];
        int32_t face = INT32_MAX;
        for (int32_t row = 0; row < rows; row++) {
            lane_distances(lanes + row, p, d);
            for (int k = 0; k < LANES; k++)
                if (d[k] < best) best = d[k], face = LANES * row + k; /* of equal ones the first */
        }
        Foot foot;
        if (face == INT32_MAX) {
            distance[i] = normal[3 * i] = normal[3 * i + 1] = normal[3 * i + 2] = NAN;
            continue;
        }
        pandis__find_mesh_foot(&m, face, p, &foot);
        pandis__pseudonormal(&m, face, &foot, n);
        double sign = pandis__sign(&m, p, &foot, n);
        distance[i] = sign * foot.distance;
        for (int k = 0; k < 3; k++)
            normal[3 * i + k] = foot.distance > 0 ? sign * (foot.offset[k] / foot.distance) : n[k];
    }
    free(lanes);
    return 1;
}

/* Brute force, as in a program without a tree: all triangles for every point. A part of bvh.c. */

#define LANES PANDIS__FOUR

typedef struct {
    double a[3][LANES], u[3][LANES], v[3][LANES], w[3][LANES], n[3][LANES];
    double per_uu[LANES], per_vv[LANES], per_ww[LANES], per_nn[LANES]; /* 1 / squared length */
} Lanes;

static void set_lane(Lanes *lanes, int lane, const double *p, const double *q, const double *s) {
    for (int k = 0; k < 3; k++)
        lanes->a[k][lane] = p[k], lanes->u[k][lane] = q[k] - p[k], lanes->v[k][lane] = s[k] - p[k],
        lanes->w[k][lane] = s[k] - q[k];
}

static void set_reciprocals(double (*way)[LANES], double *per) {
    for (int i = 0; i < LANES; i++)
        per[i] = 1 / (way[0][i] * way[0][i] + way[1][i] * way[1][i] + way[2][i] * way[2][i]);
}

/* Squared distances to four triangles, equal to pandis__four_squared to the last bit. */
static void lane_distances(
    const Lanes *restrict f, const double *restrict p, double *restrict out) {
    for (int i = 0; i < LANES; i++) {
        double x = p[0] - f->a[0][i], y = p[1] - f->a[1][i], z = p[2] - f->a[2][i];
        double ux = f->u[0][i], uy = f->u[1][i], uz = f->u[2][i];
        double vx = f->v[0][i], vy = f->v[1][i], vz = f->v[2][i];
        double wx = f->w[0][i], wy = f->w[1][i], wz = f->w[2][i];
        double nx = f->n[0][i], ny = f->n[1][i], nz = f->n[2][i];
        double bx = x - ux, by = y - uy, bz = z - uz;
        double s = pandis__clamp01((ux * x + uy * y + uz * z) * f->per_uu[i]);
        double rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        double best = rx * rx + ry * ry + rz * rz;
        s = pandis__clamp01((vx * x + vy * y + vz * z) * f->per_vv[i]);
        rx = x - s * vx, ry = y - s * vy, rz = z - s * vz;
        double d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        s = pandis__clamp01((wx * bx + wy * by + wz * bz) * f->per_ww[i]);
        rx = bx - s * wx, ry = by - s * wy, rz = bz - s * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        double cx = y * nz - z * ny, cy = z * nx - x * nz, cz = x * ny - y * nx;
        double qx = by * nz - bz * ny, qy = bz * nx - bx * nz, qz = bx * ny - by * nx;
        double height = nx * x + ny * y + nz * z;
        d = height * height * f->per_nn[i];
        int inside = (ux * cx + uy * cy + uz * cz >= 0) & (vx * cx + vy * cy + vz * cz <= 0) &
            (wx * qx + wy * qy + wz * qz >= 0);
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
    for (int32_t row = 0; row < rows; row++) {
        Lanes *f = lanes + row;
        pandis__four_normals(f->u, f->v, f->n);
        set_reciprocals(f->u, f->per_uu), set_reciprocals(f->v, f->per_vv),
            set_reciprocals(f->w, f->per_ww);
        set_reciprocals(f->n, f->per_nn);
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

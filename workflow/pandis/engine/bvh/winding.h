/* Winding numbers: a part of bvh.c. */

/* Half the solid angle of a triangle seen from the origin. */
static double half_angle(const double *a, const double *b, const double *c) {
    double n[3];
    cross(b, c, n);
    double la = sqrt(dot(a, a)), lb = sqrt(dot(b, b)), lc = sqrt(dot(c, c));
    return atan2(dot(a, n), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
}

static double exact_winding(const Bvh *t, const double *p) {
    double sum = 0;
    for (int32_t f = 0; f < t->face_count; f++) {
        double c[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) c[i][k] = corner(t, f, i)[k] - p[k];
        sum += half_angle(c[0], c[1], c[2]);
    }
    return sum / 6.283185307179586;
}

/* atan2 to within 2e-6, without branches, so that the compiler can compute four at once. */
static double rough_atan2(double y, double x) {
    double ax = fabs(x), ay = fabs(y);
    double high = ax > ay ? ax : ay, low = ax > ay ? ay : ax;
    double z = low / (high > 0 ? high : 1), q = z * z;
    double r = z *
        (0.99997726 +
            q *
                (-0.33262347 +
                    q * (0.19354346 + q * (-0.11643287 + q * (0.05265332 - q * 0.01172120)))));
    r = ay > ax ? 1.5707963267948966 - r : r;
    r = x < 0 ? 3.141592653589793 - r : r;
    return y < 0 ? -r : r;
}

static double leaf_winding(const Bvh *t, const Leaf *leaf, const double *restrict p) {
    double a[3][WIDTH], b[3][WIDTH], c[3][WIDTH], turns[WIDTH], sum = 0;
    for (int i = 0; i < WIDTH; i++) {
        int32_t face = leaf->face[leaf->face[i] < 0 ? 0 : i];
        for (int k = 0; k < 3; k++) {
            a[k][i] = corner(t, face, 0)[k] - p[k];
            b[k][i] = corner(t, face, 1)[k] - p[k];
            c[k][i] = corner(t, face, 2)[k] - p[k];
        }
    }
    for (int i = 0; i < WIDTH; i++) {
        double ax = a[0][i], ay = a[1][i], az = a[2][i], bx = b[0][i], by = b[1][i], bz = b[2][i];
        double cx = c[0][i], cy = c[1][i], cz = c[2][i];
        double la = sqrt(ax * ax + ay * ay + az * az), lb = sqrt(bx * bx + by * by + bz * bz);
        double lc = sqrt(cx * cx + cy * cy + cz * cz);
        double det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx);
        double down = la * lb * lc + (ax * bx + ay * by + az * bz) * lc +
            (bx * cx + by * cy + bz * cz) * la + (cx * ax + cy * ay + cz * az) * lb;
        turns[i] = rough_atan2(det, down);
    }
    for (int i = 0; i < WIDTH && leaf->face[i] >= 0; i++) sum += turns[i];
    return sum / 6.283185307179586;
}

/* Clusters farther than `beta` radii count as dipoles. */
static double rough_winding(const Bvh *t, const double *p, float beta) {
    int32_t stack[STACK];
    int top = 0;
    double sum = 0;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    stack[top++] = 0;
    while (top) {
        int32_t index = stack[--top];
        if (index < 0) {
            sum += leaf_winding(t, t->leaves + ~index, p);
            continue;
        }
        const Cluster *restrict c = t->clusters + index;
        const Node *node = t->nodes + index;
        float part[WIDTH], distance[WIDTH];
        for (int i = 0; i < WIDTH; i++) {
            float x = c->centre[0][i] - q[0], y = c->centre[1][i] - q[1],
                  z = c->centre[2][i] - q[2];
            float d = x * x + y * y + z * z;
            distance[i] = d;
            float safe = d > 1e-20f ? d : 1e-20f;
            part[i] = (c->dipole[0][i] * x + c->dipole[1][i] * y + c->dipole[2][i] * z) /
                (safe * sqrtf(safe));
        }
        for (int i = 0; i < WIDTH; i++) {
            if (node->low[0][i] > node->high[0][i]) continue;
            if (distance[i] > beta * beta * c->reach[i]) {
                sum += (double)part[i] / 12.566370614359172;
            } else {
                stack[top++] = node->child[i];
            }
        }
    }
    return sum;
}

/* -1 inside, 1 outside. The winding number is computed only as exactly as the answer requires. */
static double find_side(const Bvh *t, const double *p) {
    double w = rough_winding(t, p, ROUGH_BETA);
    if (fabs(w - 0.5) < 0.3) {
        w = rough_winding(t, p, FINE_BETA);
        if (fabs(w - 0.5) < 0.3) w = exact_winding(t, p);
    }
    return w > 0.5 ? -1 : 1;
}

/* -------------------- on both sides of faces */

/* A face counts as long if its spread is at least this share of the largest coordinate. */
#define LONG_FACE 0.02

/* Where a face is tested on both sides: in the middle and near the corners, in barycentric
 * coordinates. */
static const double PLACES[WIDTH / 2][3] = {
    {1.0 / 3, 1.0 / 3, 1.0 / 3}, {0.9, 0.05, 0.05}, {0.05, 0.9, 0.05}, {0.05, 0.05, 0.9}};

/* Add half solid angles of a leaf's triangles, seen from several points at once. */
static void add_turns(const Bvh *t, const Leaf *leaf, double p[3][WIDTH], double *turns) {
    for (int j = 0; j < WIDTH && leaf->face[j] >= 0; j++) {
        const double *u = corner(t, leaf->face[j], 0), *v = corner(t, leaf->face[j], 1),
                     *w = corner(t, leaf->face[j], 2);
        for (int i = 0; i < WIDTH; i++) {
            double ax = u[0] - p[0][i], ay = u[1] - p[1][i], az = u[2] - p[2][i];
            double bx = v[0] - p[0][i], by = v[1] - p[1][i], bz = v[2] - p[2][i];
            double cx = w[0] - p[0][i], cy = w[1] - p[1][i], cz = w[2] - p[2][i];
            double la = sqrt(ax * ax + ay * ay + az * az), lb = sqrt(bx * bx + by * by + bz * bz);
            double lc = sqrt(cx * cx + cy * cy + cz * cz);
            double det =
                ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx);
            double down = la * lb * lc + (ax * bx + ay * by + az * bz) * lc +
                (bx * cx + by * cy + bz * cz) * la + (cx * ax + cy * ay + cz * az) * lb;
            turns[i] += rough_atan2(det, down);
        }
    }
}

/* Winding numbers at points within `spread` of a middle. Clusters that are far away count as
 * dipoles seen from the middle. */
static void rough_windings(
    const Bvh *t, const double *middle, double spread, double p[3][WIDTH], double *windings) {
    int32_t stack[STACK];
    int top = 0;
    double far = 0, turns[WIDTH] = {0};
    float q[3] = {(float)middle[0], (float)middle[1], (float)middle[2]},
          apart = (float)(MIDDLE_BETA * spread);
    stack[top++] = 0;
    while (top) {
        int32_t index = stack[--top];
        if (index < 0) {
            add_turns(t, t->leaves + ~index, p, turns);
            continue;
        }
        const Cluster *restrict c = t->clusters + index;
        const Node *node = t->nodes + index;
        float part[WIDTH], margin[WIDTH];
        for (int i = 0; i < WIDTH; i++) {
            float x = c->centre[0][i] - q[0], y = c->centre[1][i] - q[1],
                  z = c->centre[2][i] - q[2];
            float d = x * x + y * y + z * z, safe = d > 1e-20f ? d : 1e-20f, length = sqrtf(safe);
            margin[i] = length - apart - ROUGH_BETA * sqrtf(c->reach[i]);
            part[i] =
                (c->dipole[0][i] * x + c->dipole[1][i] * y + c->dipole[2][i] * z) / (safe * length);
        }
        for (int i = 0; i < WIDTH; i++) {
            if (node->low[0][i] > node->high[0][i]) continue;
            if (margin[i] > 0) {
                far += (double)part[i];
            } else {
                stack[top++] = node->child[i];
            }
        }
    }
    for (int i = 0; i < WIDTH; i++)
        windings[i] = far / 12.566370614359172 + turns[i] / 6.283185307179586;
}

/* Whether the outside is below a face, or the inside above it, at the distance `beside` from one of
 * the PLACES. */
static int looks_wrong(const Bvh *t, int32_t face, double beside) {
    const double *a = corner(t, face, 0), *b = corner(t, face, 1), *c = corner(t, face, 2);
    double ab[3], ac[3], n[3], middle[3], p[3][WIDTH], windings[WIDTH], spread = 0;
    for (int k = 0; k < 3; k++) ab[k] = b[k] - a[k], ac[k] = c[k] - a[k];
    cross(ab, ac, n);
    double length = sqrt(dot(n, n));
    if (!(length > 0)) return 1;
    for (int i = 0; i < WIDTH; i++)
        for (int k = 0; k < 3; k++) {
            const double *w = PLACES[i / 2];
            p[k][i] = w[0] * a[k] + w[1] * b[k] + w[2] * c[k] +
                (i % 2 ? -beside : beside) * n[k] / length;
        }
    for (int k = 0; k < 3; k++) middle[k] = (a[k] + b[k] + c[k]) / 3;
    for (int i = 0; i < WIDTH; i++) {
        double x[3] = {p[0][i] - middle[0], p[1][i] - middle[1], p[2][i] - middle[2]};
        if (dot(x, x) > spread) spread = dot(x, x);
    }
    /* around a face that is long compared with the object, one walk would meet nearly all other
     * faces, so walk for each point by itself */
    if (sqrt(spread) < LONG_FACE * t->scale) rough_windings(t, middle, sqrt(spread), p, windings);
    else
        for (int i = 0; i < WIDTH; i++) windings[i] = 0.5;
    for (int i = 0; i < WIDTH; i++) {
        double point[3] = {p[0][i], p[1][i], p[2][i]};
        int inside = fabs(windings[i] - 0.5) < 0.3 ? find_side(t, point) < 0 : windings[i] > 0.5;
        if (inside != i % 2) return 1;
    }
    return 0;
}

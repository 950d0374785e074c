/* Whether two triangles meet outside of their common corners and edge: a part of faces.c.
 *
 * Triangles are closed sets; one without area is a segment. All decisions are exact, but for
 * neighbours that are folded onto each other within rounding. */

/* Whether a point on the line of a segment is on the segment, in the plane of two axes. */
static int between(const double *p, const double *q, const double *r, int x, int y) {
    return least(p[x], q[x]) <= r[x] && r[x] <= most(p[x], q[x]) && least(p[y], q[y]) <= r[y] &&
        r[y] <= most(p[y], q[y]);
}

/* Whether two segments meet, in the plane of two axes. Sets `line` if all ends are on one line. */
static int meet_in_plane(
    const double *p, const double *q, const double *r, const double *s, int x, int y, int *line) {
    int a = turn(p, q, r, x, y), b = turn(p, q, s, x, y);
    int c = turn(r, s, p, x, y), d = turn(r, s, q, x, y);
    *line = !(a || b || c || d);
    return (a * b < 0 && c * d < 0) || (!a && between(p, q, r, x, y)) ||
        (!b && between(p, q, s, x, y)) || (!c && between(r, s, p, x, y)) ||
        (!d && between(r, s, q, x, y));
}

/* Whether two segments meet in space. */
static int segments_meet(const double *p, const double *q, const double *r, const double *s) {
    if (side(p, q, r, s)) return 0;
    for (int k = 0; k < 3; k++) {
        int line, answer = meet_in_plane(p, q, r, s, (k + 1) % 3, (k + 2) % 3, &line);
        if (!line) return answer;
    }
    for (int k = 0; k < 3; k++) /* all on one line */
        if (most(least(p[k], q[k]), least(r[k], s[k])) > least(most(p[k], q[k]), most(r[k], s[k])))
            return 0;
    return 1;
}

/* Whether a segment in the plane of a triangle meets it. */
static int meets_flat(const double *p, const double *q, const double *const *c) {
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3, line, inside = 1;
        int way = turn(c[0], c[1], c[2], x, y);
        if (!way) continue;
        for (int i = 0; i < 3; i++) {
            if (meet_in_plane(p, q, c[i], c[(i + 1) % 3], x, y, &line)) return 1;
            inside &= turn(c[i], c[(i + 1) % 3], p, x, y) == way;
        }
        return inside;
    }
    return segments_meet(p, q, c[0], c[1]) || segments_meet(p, q, c[1], c[2]) ||
        segments_meet(p, q, c[2], c[0]);
}

/* Whether a segment whose ends are on these sides of a triangle's plane meets the triangle. */
static int meets(const double *p, const double *q, int from, int to, const double *const *c) {
    if (from * to > 0) return 0;
    if (!from && !to) return meets_flat(p, q, c);
    int a = side(p, q, c[0], c[1]), b = side(p, q, c[1], c[2]), d = side(p, q, c[2], c[0]);
    return !((a > 0 || b > 0 || d > 0) && (a < 0 || b < 0 || d < 0));
}

/* Whether a corner is on the opposite edge, which makes the triangle a segment. */
static int on_opposite(const double *corner, const double *p, const double *q) {
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        if (turn(p, q, corner, x, y) || !between(p, q, corner, x, y)) return 0;
    }
    return 1;
}

/* Whether a triangle's edges without common corners meet another triangle. `common` are bits of
 * corners. */
static int edges_meet(const double *const *f, const double *const *g, int common) {
    int on[3];
    for (int k = 0; k < 3; k++) on[k] = common >> k & 1 ? 0 : side(g[0], g[1], g[2], f[k]);
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        if ((common >> k | common >> next) & 1) continue;
        if (!meets(f[k], f[next], on[k], on[next], g)) continue;
        if (!common || !on_opposite(f[3 - k - next], f[k], f[next])) return 1;
        /* they meet in the common corner at least: in more if an end does */
        if ((!on[k] && meets_flat(f[k], f[k], g)) || (!on[next] && meets_flat(f[next], f[next], g)))
            return 1;
    }
    return 0;
}

/* Whether the corners of a triangle that are not common are all on one side of another's plane: 1,
 * 0, or UNSURE if any is in the plane, or floating point cannot tell. */
static int beside(const double *const *f, const double *const *g, int in_g) {
    int first = 0;
    for (int i = 0; i < 3; i++) {
        if (in_g >> i & 1) continue;
        int way = quick_side(f[0], f[1], f[2], g[i]);
        if (way == 0 || way == UNSURE) return UNSURE;
        if (first && way != first) return 0;
        first = way;
    }
    return 1;
}

/* The axis along which a triangle looks largest. */
static int widest_axis(const double *const *c) {
    double most = -1;
    int axis = 0;
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        double area = fabs(
            (c[1][x] - c[0][x]) * (c[2][y] - c[0][y]) - (c[1][y] - c[0][y]) * (c[2][x] - c[0][x]));
        if (area > most) most = area, axis = k;
    }
    return axis;
}

/* Whether a point on the line of two others is on the other side of the first than the second. */
static int opposite(const double *at, const double *from, const double *p, int x, int y) {
    return (p[x] - at[x]) * (from[x] - at[x]) < 0 || (p[y] - at[y]) * (from[y] - at[y]) < 0;
}

/* Whether an edge of one triangle parts it from another, seen along an axis: all corners of the
 * other that are not common lie beyond the line of that edge, which passes through the common one,
 * or on it, but on the other side of the common one. Then the two do not meet elsewhere, in one
 * plane or not. This is quicker than exact signs in space, which faces in one plane would need. */
static int parts(const double *const *f, const double *const *g, int in_f, int in_g, int axis) {
    int x = (axis + 1) % 3, y = (axis + 2) % 3;
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3, beyond = 0, all = 0;
        if (in_f && !((in_f >> k | in_f >> next) & 1)) continue;
        int way = turn(f[k], f[next], f[3 - k - next], x, y);
        const double *at = f[in_f >> k & 1 ? k : next], *end = f[in_f >> k & 1 ? next : k];
        for (int i = 0; i < 3 && way; i++) {
            if (in_g >> i & 1) continue;
            int sign = turn(f[k], f[next], g[i], x, y);
            beyond += sign == -way || (!sign && in_f && opposite(at, end, g[i], x, y)), all++;
        }
        if (way && beyond == all) return 1;
    }
    return 0;
}

/* Whether two triangles u, v, a and u, v, b overlap beside their common edge. */
static int folded(const double *u, const double *v, const double *a, const double *b) {
    const double *c[3] = {u, v, a};
    int axis = widest_axis(c), flat = 0;
    if (turn(u, v, a, (axis + 1) % 3, (axis + 2) % 3) *
            turn(u, v, b, (axis + 1) % 3, (axis + 2) % 3) <
        0)
        return 0;
    if (side(u, v, a, b)) return 0;
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        int one = turn(u, v, a, x, y), other = turn(u, v, b, x, y);
        if (one * other > 0) return 1;
        flat |= one | other;
    }
    if (flat) return 0;
    int point = u[0] == v[0] && u[1] == v[1] && u[2] == v[2];
    for (int k = 0; k < 3 && point; k++) /* the faces are segments, perhaps in two directions */
        if (turn(u, a, b, (k + 1) % 3, (k + 2) % 3)) return 0;
    for (int k = 0; k < 3; k++) { /* all on one line */
        if (point && (a[k] - u[k]) * (b[k] - u[k]) > 0) return 1;
        if ((v[k] - u[k]) * (a[k] - v[k]) > 0 && (v[k] - u[k]) * (b[k] - v[k]) > 0) return 1;
        if ((u[k] - v[k]) * (a[k] - u[k]) > 0 && (u[k] - v[k]) * (b[k] - u[k]) > 0) return 1;
    }
    return 0;
}

/* Least angle between two faces with a common edge. Nearer to that edge than the coordinates'
 * rounding error divided by the angle, rounding decides which of the two is closest. */
#define LEAST_ANGLE 1e-10

/* Whether two triangles u, v, a and u, v, b are so folded that the angle between them is within its
 * rounding error, for coordinates with an error of `rounding`. */
static int folded_flat(
    const double *u, const double *v, const double *a, const double *b, double rounding) {
    double normals[2][3], error = 0, sine = 0, lengths[2], along = 0, edge = 0;
    for (int k = 0; k < 3; k++) edge += (v[k] - u[k]) * (v[k] - u[k]);
    for (int i = 0; i < 2; i++) {
        const double *tip = i ? b : a;
        double square = 0;
        for (int k = 0; k < 3; k++) {
            int x = (k + 1) % 3, y = (k + 2) % 3;
            normals[i][k] = (v[x] - u[x]) * (tip[y] - u[y]) - (v[y] - u[y]) * (tip[x] - u[x]);
            square += normals[i][k] * normals[i][k];
        }
        lengths[i] = sqrt(square);
        if (!(lengths[i] > 0)) return 0;
        error += sqrt(edge) / lengths[i]; /* a face turns around the edge by error / height */
    }
    for (int k = 0; k < 3; k++) along += normals[0][k] * normals[1][k];
    if (along <= 0) return 0; /* tips on two sides of the edge */
    for (int k = 0; k < 3; k++) {
        double difference = normals[0][k] / lengths[0] - normals[1][k] / lengths[1];
        sine += difference * difference;
    }
    return sqrt(sine) <= most(rounding * error, LEAST_ANGLE);
}

/* Whether two faces meet outside of their common corners and edge, or are folded onto each other
 * within rounding. */
static int faces_meet(
    const double *places, const int32_t *one, const int32_t *other, double rounding) {
    const double *f[3], *g[3];
    int in_f = 0, in_g = 0, count = 0;
    for (int i = 0; i < 3; i++) {
        f[i] = places + 3 * (ptrdiff_t)one[i], g[i] = places + 3 * (ptrdiff_t)other[i];
        for (int j = 0; j < 3; j++)
            if (one[i] == other[j]) in_f |= 1 << i, in_g |= 1 << j, count++;
    }
    if (count == 3) return 1;
    if (count == 2) {
        int a = in_f == 3 ? 2 : in_f == 5 ? 1 : 0, b = in_g == 3 ? 2 : in_g == 5 ? 1 : 0;
        int first = one[(a + 1) % 3] < one[(a + 2) % 3] ? 1 : 2; /* whichever face comes first */
        const double *u = f[(a + first) % 3], *v = f[(a + 3 - first) % 3];
        return folded(u, v, f[a], g[b]) ||
            (rounding > 0 && folded_flat(u, v, f[a], g[b], rounding));
    }
    int f_beside = beside(g, f, in_f), g_beside = UNSURE;
    if (f_beside != UNSURE) g_beside = beside(f, g, in_g);
    if (f_beside == 1 || g_beside == 1) return 0;
    if (f_beside == UNSURE || g_beside == UNSURE) {
        int axis = widest_axis(f);
        if (parts(f, g, in_f, in_g, axis) || parts(g, f, in_g, in_f, axis)) return 0;
    }
    return edges_meet(f, g, in_f) || edges_meet(g, f, in_g);
}

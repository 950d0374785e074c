/* Whether two triangles meet outside of their common corners and edge: a part of faces.c.
 *
 * Triangles are closed sets; one without area is a segment. All decisions are exact. */

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

/* Whether a triangle's edges without common corners meet another triangle; -1 if the other corners
 * are on one side of its plane, so that nothing meets. `common` are bits of corners. */
static int edges_meet(const double *const *f, const double *const *g, int common) {
    int on[3], above = 0, below = 0, all = 3;
    for (int k = 0; k < 3; k++) {
        on[k] = common >> k & 1 ? 0 : side(g[0], g[1], g[2], f[k]);
        above += on[k] > 0, below += on[k] < 0, all -= common >> k & 1;
    }
    if (above == all || below == all) return -1;
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

/* Whether two triangles u, v, a and u, v, b overlap beside their common edge. */
static int folded(const double *u, const double *v, const double *a, const double *b) {
    if (side(u, v, a, b)) return 0;
    int flat = 0;
    for (int k = 0; k < 3; k++) {
        int x = (k + 1) % 3, y = (k + 2) % 3;
        int one = turn(u, v, a, x, y), other = turn(u, v, b, x, y);
        if (one * other > 0) return 1;
        flat |= one | other;
    }
    for (int k = 0; k < 3 && !flat; k++) { /* all on one line */
        if ((v[k] - u[k]) * (a[k] - v[k]) > 0 && (v[k] - u[k]) * (b[k] - v[k]) > 0) return 1;
        if ((u[k] - v[k]) * (a[k] - u[k]) > 0 && (u[k] - v[k]) * (b[k] - u[k]) > 0) return 1;
    }
    return 0;
}

/* Whether two faces meet outside of their common corners and edge. */
static int faces_meet(const double *places, const int32_t *one, const int32_t *other) {
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
        return folded(f[(a + 1) % 3], f[(a + 2) % 3], f[a], g[b]);
    }
    int answer = edges_meet(f, g, in_f);
    return answer ? answer > 0 : edges_meet(g, f, in_g) > 0;
}

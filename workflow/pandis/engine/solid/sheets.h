/* Surfaces with air on both sides: a part of solid.c. */

#define SAMPLING 0.5 /* cells between the points of a triangle that are looked at */

/* Spread marks to the 26 nodes around each; `other` is as large as `marks`. */
static void spread(const Lattice *l, uint8_t *marks, uint8_t *other) {
    for (int axis = 0; axis < 3; axis++) {
        int64_t step = l->step[axis];
        memcpy(other, marks, (size_t)l->nodes);
        for (int64_t i = step; i < l->nodes - step; i++)
            marks[i] = other[i] | other[i - step] | other[i + step];
    }
}

/* Mark the ends of cut edges with air at both ends and no solid node beside them. */
static void mark_cut(const Lattice *l, const uint8_t *near, uint8_t *marks) {
    for (int64_t i = 0; i < l->cut_count; i++) {
        const Cut *c = l->cuts + i;
        int64_t node = c->edge / 3, next = node + l->step[c->edge % 3];
        if (c->triangle >= l->triangles - l->caps) continue;
        if (l->inside[node] || l->inside[next] || (near[node] && near[next])) continue;
        marks[node] = marks[next] = 1;
    }
}

static int any_corner(const Lattice *l, const uint8_t *near, const uint8_t *marks, int64_t node) {
    for (int k = 0; k < 8; k++) {
        int64_t corner = node + (k & 1) + (k >> 1 & 1) * l->step[1] + (k >> 2) * l->step[2];
        if (near[corner] || marks[corner]) return 1;
    }
    return 0;
}

/* Mark the node next to each point of a triangle in whose cell nothing is solid: of small pieces
 * and thin rims, which may cut no edge. */
static void mark_missed(const Lattice *l, const uint8_t *near, int64_t triangle, uint8_t *marks) {
    const double *c[3];
    double longest = 0;
    corners_of(l, triangle, c);
    for (int k = 0; k < 3; k++) {
        double side[3];
        for (int j = 0; j < 3; j++) side[j] = c[(k + 1) % 3][j] - c[k][j];
        longest = fmax(longest, sqrt(dot(side, side)));
    }
    int count = (int)fmax(1, ceil(longest / SAMPLING));
    for (int i = 0; i <= count; i++)
        for (int j = 0; j <= count - i; j++) {
            double s = (double)i / count, t = (double)j / count, p[3];
            for (int k = 0; k < 3; k++)
                p[k] = c[0][k] + s * (c[1][k] - c[0][k]) + t * (c[2][k] - c[0][k]);
            if (any_corner(l, near, marks, node_at(l, (int)p[0], (int)p[1], (int)p[2]))) continue;
            marks[node_at(l, (int)(p[0] + .5), (int)(p[1] + .5), (int)(p[2] + .5))] = 1;
        }
}

/* Make the nodes within `half` cells of such surfaces part of a sheet. */
static int add_sheets(Lattice *l, float half) {
    size_t size = (size_t)l->nodes;
    uint8_t *near = malloc(size), *marks = calloc(size, 1), *other = malloc(size);
    int done = near && marks && other, any = 0;
    if (done) {
        memcpy(near, l->inside, size);
        spread(l, near, other);
        mark_cut(l, near, marks);
        for (int64_t t = 0; t < l->triangles - l->caps; t++) mark_missed(l, near, t, marks);
        any = memchr(marks, 1, size) != NULL;
    }
    if (any && (done = find_feet(l))) {
        spread(l, marks, other);
        spread(l, marks, other);
        for (int64_t i = 0; i < l->nodes; i++)
            if (!l->inside[i] && marks[i] && node_distance(l, i) <= half) l->inside[i] = SHEET;
    }
    free(near), free(marks), free(other);
    return done;
}

/* Brute force, as in a program without a tree: all triangles for every point. A part of bvh.c. */

/* Answer points by testing all triangles. Returns 0 if memory is short. */
int bvh_scan(const Bvh *t, const double *points, int64_t count, double *distance, double *normal) {
    pandis__mesh m = view(t);
    int32_t rows = t->face_count / PANDIS__FOUR + (t->face_count % PANDIS__FOUR > 0);
    pandis__triangles *fours = malloc((size_t)rows * sizeof *fours);
    if (!fours) return 0;
    for (int64_t i = 0; i < (int64_t)rows * PANDIS__FOUR; i++) {
        int32_t face = i < t->face_count ? (int32_t)i : t->face_count - 1;
        pandis__set_triangle(fours + i / PANDIS__FOUR, (int)(i % PANDIS__FOUR), corner(t, face, 0),
            corner(t, face, 1), corner(t, face, 2));
    }
    for (int32_t row = 0; row < rows; row++) pandis__complete_triangles(fours + row);
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        double best = INFINITY, d[PANDIS__FOUR], n[3];
        int32_t face = INT32_MAX;
        for (int32_t row = 0; row < rows; row++) {
            pandis__four_distances(fours + row, p, d);
            for (int k = 0; k < PANDIS__FOUR; k++)
                if (d[k] < best)
                    best = d[k], face = PANDIS__FOUR * row + k; /* of equal ones the first */
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
    free(fours);
    return 1;
}

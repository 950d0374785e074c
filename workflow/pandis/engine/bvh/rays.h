/* Where rays first meet a face: a part of bvh.c. */

/* The length of a ray up to a face, in lengths of its direction, or INFINITY if it misses it. */
static double length_to(const Bvh *t, int32_t face, const double *p, const double *way) {
    const double *c[3] = {corner(t, face, 0), corner(t, face, 1), corner(t, face, 2)};
    double length;
    if (!pandis__meets(c, p, way, &length)) return INFINITY;
    for (int k = 0; k < 3; k++) { /* along a sliver, rounding can place the hit elsewhere */
        double at = p[k] + length * way[k], margin = 1e-6 * t->scale;
        if (at < fmin(c[0][k], fmin(c[1][k], c[2][k])) - margin) return INFINITY;
        if (at > fmax(c[0][k], fmax(c[1][k], c[2][k])) + margin) return INFINITY;
    }
    return length;
}

/* Whether a ray enters the box of a node's child before `limit`. Boxes are widened by what rounding
 * can lose. */
static int enters(
    const Bvh *t, const Node *node, int child, const double *p, const double *way, double limit) {
    double from = 0, to = limit, margin = 1e-12 * t->scale;
    for (int k = 0; k < 3; k++) {
        double low = node->low[k][child] - margin - p[k],
               high = node->high[k][child] + margin - p[k];
        if (way[k] == 0) {
            if (low > 0 || high < 0) return 0;
            continue;
        }
        double a = low / way[k], b = high / way[k];
        from = fmax(from, fmin(a, b)), to = fmin(to, fmax(a, b));
    }
    return from <= to;
}

/* The lengths of rays, `least` or more, up to the first face that is not skipped, or INFINITY. */
void bvh_first_hits(const Bvh *t, const double *points, const double *ways, const int32_t *skipped,
    double least, int64_t count, double *lengths) {
    for (int64_t i = 0; i < count; i++) {
        const double *p = points + 3 * i, *way = ways + 3 * i;
        int32_t stack[STACK];
        int top = 0;
        double best = INFINITY;
        stack[top++] = 0;
        while (top) {
            int32_t index = stack[--top];
            if (index < 0) {
                const Leaf *leaf = t->leaves + ~index;
                for (int k = 0; k < WIDTH && leaf->face[k] >= 0; k++) {
                    if (leaf->face[k] == skipped[i]) continue;
                    double length = length_to(t, leaf->face[k], p, way);
                    if (length >= least && length < best) best = length;
                }
                continue;
            }
            const Node *node = t->nodes + index;
            for (int k = 0; k < WIDTH; k++)
                if (node->low[0][k] <= node->high[0][k] && enters(t, node, k, p, way, best))
                    stack[top++] = node->child[k];
        }
        lengths[i] = best;
    }
}

/* Takes merged vertices apart again: a part of solid.c.
 *
 * Around chosen vertices, each vertex stands for itself again. At the border of that part, faces
 * have corners of both kinds; where such a face would be unsound, its vertices are taken apart,
 * too. */

/* Whether a face, given other corners, would turn over, become a needle or leave the surface: the
 * rules of stays_sound and stays_near. */
static int is_unsound(
    const double *places, const Face *fine, const Face *coarse, double tolerance) {
    double old[3], new[3], u[3], v[3], w[3], way[3], off = 0;
    const double *p[3], *base = places + 3 * (int64_t)fine->corner[0];
    for (int i = 0; i < 3; i++) p[i] = places + 3 * (int64_t)coarse->corner[i];
    area_of(places, fine, old), area_of(places, coarse, new);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) way[k] = p[i][k] - base[k];
        off = larger(off, fabs(dot(old, way)));
    }
    for (int k = 0; k < 3; k++)
        u[k] = p[1][k] - p[0][k], v[k] = p[2][k] - p[1][k], w[k] = p[0][k] - p[2][k];
    double longest = larger(dot(u, u), larger(dot(v, v), dot(w, w)));
    double before = length(old), now = length(new);
    return dot(old, new) < TURN * before * now || now < NARROW * longest ||
        off > MOST_OFF * tolerance * before;
}

/* Let the vertices that are merged with a chosen one stand for themselves. `apart` marks the chosen
 * vertices, and receives those that stand for themselves; `into` has the vertex that stands for
 * each. Returns 0 if memory is short. */
int32_t solid_reopen(const double *places, int64_t vertices, const int32_t *faces, int64_t count,
    double tolerance, int32_t *into, uint8_t *apart) {
    const Face *fine = (const Face *)faces;
    uint8_t *open = calloc((size_t)vertices, 1); /* by the vertex that stands for others */
    if (!open) return 0;
    for (int64_t v = 0; v < vertices; v++) open[into[v]] |= apart[v];
    for (int grown = 1; grown;) {
        grown = 0;
        for (int64_t f = 0; f < count; f++) {
            Face now;
            int some = 0, same = 1;
            for (int k = 0; k < 3; k++) {
                int32_t v = fine[f].corner[k], is_open = open[into[v]];
                now.corner[k] = is_open ? v : into[v], some += is_open;
                same &= now.corner[k] == v;
            }
            const int32_t *c = now.corner;
            if (same || some % 3 == 0 || c[0] == c[1] || c[1] == c[2] || c[2] == c[0] ||
                !is_unsound(places, fine + f, &now, tolerance))
                continue;
            for (int k = 0; k < 3; k++) open[into[fine[f].corner[k]]] = 1;
            grown = 1;
        }
    }
    for (int64_t v = 0; v < vertices; v++)
        if ((apart[v] = open[into[v]])) into[v] = (int32_t)v;
    free(open);
    return 1;
}

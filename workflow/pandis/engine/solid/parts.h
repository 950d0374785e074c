/* The components of the surface: a part of solid.c. */

static int32_t top_of(int32_t *above, int32_t vertex) {
    while (above[vertex] != vertex) vertex = above[vertex] = above[above[vertex]];
    return vertex;
}

/* Number the components of the surface in order of their first vertices; writes each vertex's, and
 * returns their number. */
int64_t solid_parts(const Lattice *l, int32_t *part) {
    int64_t count = 0;
    for (int32_t v = 0; v < l->vertex_count; v++) part[v] = v;
    for (int64_t f = 0; f < l->face_count; f++)
        for (int k = 1; k < 3; k++) {
            int32_t a = top_of(part, l->faces[f].corner[0]),
                    b = top_of(part, l->faces[f].corner[k]);
            if (a < b) part[b] = a;
            else part[a] = b;
        }
    for (int32_t v = 0; v < l->vertex_count; v++) part[v] = top_of(part, v);
    /* a component's first vertex is its own top, and comes before the others */
    for (int32_t v = 0; v < l->vertex_count; v++)
        part[v] = part[v] == v ? -1 - (int32_t)count++ : part[part[v]];
    for (int32_t v = 0; v < l->vertex_count; v++) part[v] = -1 - part[v];
    return count;
}

/* Add up the faces and the volume (cubic cells) of each component, and twice the area: of all, of
 * caps and doors, of sheets. */
void solid_sums(
    const Lattice *l, const int32_t *part, int64_t *faces, double *volume, double *area) {
    for (int64_t f = 0; f < l->face_count; f++) {
        const int32_t *corner = l->faces[f].corner;
        const double *p = l->places + 3 * (int64_t)corner[0];
        int invented = 0, sheet = 0;
        double n[3];
        area_of(l->places, l->faces + f, n);
        for (int k = 0; k < 3; k++) {
            int origin = l->vertices[corner[k]].origin;
            invented += origin == ON_CAP || origin == ON_DOOR, sheet |= origin == ON_SHEET;
        }
        double size = length(n);
        faces[part[corner[0]]]++, volume[part[corner[0]]] += dot(p, n) / 6;
        area[0] += size, area[1] += invented > 1 ? size : 0, area[2] += sheet ? size : 0;
    }
}

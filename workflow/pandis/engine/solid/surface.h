/* The surface between solid nodes and the others: a part of solid.c. */

#define FROM_NODE 1e-3 /* cells: vertices keep this distance from nodes */

/* The work of one sweep through the layers of cells. */
typedef struct {
    int32_t *layers[2]; /* per node of a layer and axis: the vertex on its edge */
    uint8_t *codes;     /* per node of a row: which of its edges, or of its cell's corners */
    int64_t cut;        /* the first cut that has not been passed: edges come in order */
    Loops loops[256];
    Cone *cones;
    int64_t cone_count, cone_room;
} Sweep;

static int add_vertex(Lattice *l, const double *place, int origin, int32_t triangle, int32_t room) {
    if (!grow(&l->vertices, l->vertex_count, &l->vertex_room, sizeof *l->vertices) ||
        !grow(&l->places, l->vertex_count, &l->place_room, 3 * sizeof *l->places))
        return 0;
    memcpy(l->places + 3 * l->vertex_count, place, 3 * sizeof *place);
    l->vertices[l->vertex_count++] = (Vertex){triangle, room, (uint8_t)origin};
    return 1;
}

static int add_face(Lattice *l, int32_t a, int32_t b, int32_t c) {
    if (!grow(&l->faces, l->face_count, &l->face_room, sizeof *l->faces)) return 0;
    l->faces[l->face_count++] = (Face){{a, b, c}};
    return 1;
}

/* The cut of an edge that is nearest to its outer end: one of a triangle if there is any. */
static const Cut *outermost_cut(const Lattice *l, Sweep *s, int64_t node, int axis) {
    int surface = l->blocked[node] >> axis & 1, first_inside = l->inside[node] != 0;
    const Cut *best = NULL;
    int64_t edge = 3 * node + axis;
    while (s->cut < l->cut_count && l->cuts[s->cut].edge < edge) s->cut++;
    for (int64_t i = s->cut; i < l->cut_count && l->cuts[i].edge == edge; i++) {
        int cap = l->cuts[i].triangle >= l->triangles - l->caps;
        if (surface && cap) continue;
        if (!best || first_inside) best = l->cuts + i;
    }
    return best;
}

/* Add the vertex on the edge from a node along an axis, which has one solid end. */
static int add_edge_vertex(
    Lattice *l, Sweep *s, int axis, const int32_t *at, float half, int32_t *index) {
    int64_t node = node_at(l, at[0], at[1], at[2]);
    int64_t next = node + l->step[axis], solid = l->inside[node] ? node : next;
    double along = 0.5, place[3] = {at[0], at[1], at[2]};
    int origin = ON_DOOR, triangle = -1;
    int in_sheet = l->inside[solid] == SHEET, surface = l->blocked[node] >> axis & 1;
    if (surface || (is_blocked(l, node, axis) && !in_sheet)) {
        const Cut *cut = outermost_cut(l, s, node, axis);
        along = cut->at, triangle = cut->triangle;
        origin = triangle >= l->triangles - l->caps ? ON_CAP : ON_SURFACE;
    } else if (in_sheet) {
        double p = node_distance(l, node) - half, q = node_distance(l, next) - half;
        along = fabs(p - q) > 1e-9 ? p / (p - q) : 0.5;
        origin = ON_SHEET;
    }
    place[axis] += rounded(fmin(fmax(along, FROM_NODE), 1 - FROM_NODE));
    *index = (int32_t)l->vertex_count;
    return add_vertex(l, place, origin, triangle, in_sheet ? -1 : l->room[solid]);
}

/* Write for each node of a row which of its edges (bit k: along axis k) have one solid end. */
static void find_edges(const Lattice *l, const int32_t *at, uint8_t *codes) {
    const uint8_t *row = l->inside + node_at(l, 0, at[1], at[2]);
    int32_t count = l->size[0];
    for (int32_t x = 0; x < count; x++) codes[x] = 0;
    for (int32_t x = 0; x < count - 1; x++) codes[x] = !row[x] != !row[x + 1];
    for (int k = 1; k < 3; k++) {
        if (at[k] == l->size[k] - 1) continue;
        const uint8_t *next = row + l->step[k];
        for (int32_t x = 0; x < count; x++) codes[x] |= (uint8_t)((!row[x] != !next[x]) << k);
    }
}

/* Add the vertices on the edges that begin in one layer of nodes. */
static int add_layer(Lattice *l, Sweep *s, int32_t z, float half, int32_t *layer) {
    int32_t at[3] = {0, 0, z};
    for (at[1] = 0; at[1] < l->size[1]; at[1]++) {
        find_edges(l, at, s->codes);
        for (at[0] = 0; at[0] < l->size[0]; at[0]++, layer += 3)
            for (int axis = 0; s->codes[at[0]] >> axis; axis++)
                if (s->codes[at[0]] >> axis & 1 &&
                    !add_edge_vertex(l, s, axis, at, half, layer + axis))
                    return 0;
    }
    return 1;
}

static int add_cone(Lattice *l, Sweep *s, const int32_t *at, const int8_t *edge, int size,
    const double *point, int64_t cell) {
    int32_t tip = (int32_t)l->vertex_count;
    Cone cone = {cell, tip, (int32_t)l->face_count, size};
    if (!grow(&s->cones, s->cone_count, &s->cone_room, sizeof *s->cones)) return 0;
    s->cones[s->cone_count++] = cone;
    if (!add_vertex(l, point, AT_CORNER, -1, l->vertices[at[edge[0]]].room)) return 0;
    for (int k = 0; k < size; k++)
        if (!add_face(l, at[edge[(k + 1) % size]], at[edge[k]], tip)) return 0;
    return 1;
}

/* Add the faces in a cell; `at` gives the vertices on its edges. */
static int add_cell(
    Lattice *l, Sweep *s, const int32_t *at, int solid, const int32_t *base, int64_t cell) {
    const Loops *loops = s->loops + solid;
    double point[3];
    if (loops->count == 1 && find_corner(l, at, loops->edge[0], loops->size[0], solid, base, point))
        return add_cone(l, s, at, loops->edge[0], loops->size[0], point, cell);
    for (int i = 0; i < loops->count; i++) {
        const int8_t *edge = loops->edge[i];
        for (int k = 1; k < loops->size[i] - 1; k++)
            if (!add_face(l, at[edge[k + 1]], at[edge[k]], at[edge[0]])) return 0;
    }
    return 1;
}

/* Write for each cell of a row which of its corners are solid. */
static void find_corners(const Lattice *l, int64_t row, uint8_t *codes) {
    for (int32_t x = 0; x < l->size[0] - 1; x++) codes[x] = 0;
    for (int k = 0; k < 8; k++) {
        const uint8_t *corner =
            l->inside + row + (k & 1) + (k >> 1 & 1) * l->step[1] + (k >> 2) * l->step[2];
        for (int32_t x = 0; x < l->size[0] - 1; x++) codes[x] |= (uint8_t)((corner[x] != 0) << k);
    }
}

/* Add the faces between two layers of nodes, the lower one at height z. */
static int add_cells(Lattice *l, Sweep *s, int32_t z, const int32_t *low, const int32_t *high) {
    int32_t base[3] = {0, 0, z}, at[12];
    for (base[1] = 0; base[1] < l->size[1] - 1; base[1]++) {
        int64_t row = node_at(l, 0, base[1], z);
        find_corners(l, row, s->codes);
        for (base[0] = 0; base[0] < l->size[0] - 1; base[0]++) {
            int solid = s->codes[base[0]];
            if (solid == 0 || solid == 255) continue;
            for (int e = 0; e < 12; e++) {
                int c = CELL_EDGES[e].low;
                int64_t node = base[0] + (c & 1) + l->step[1] * (base[1] + (c >> 1 & 1));
                at[e] = (c >> 2 ? high : low)[3 * node + CELL_EDGES[e].axis];
            }
            if (!add_cell(l, s, at, solid, base, row + base[0])) return 0;
        }
    }
    return 1;
}

/* Add all vertices and faces of the surface. `half` is the half thickness of sheets of nodes. */
static int add_surface(Lattice *l, float half) {
    Sweep *s = calloc(1, sizeof *s);
    if (!s) return 0;
    size_t bytes = (size_t)l->step[2] * 3 * sizeof(int32_t);
    for (int k = 0; k < 2; k++) s->layers[k] = malloc(bytes);
    for (int solid = 0; solid < 256; solid++) find_loops(solid, s->loops + solid);
    s->codes = malloc((size_t)l->size[0]);
    int done = s->layers[0] && s->layers[1] && s->codes;
    for (int32_t z = 0; z < l->size[2] && done; z++) {
        done = add_layer(l, s, z, half, s->layers[z & 1]);
        if (z && done) done = add_cells(l, s, z - 1, s->layers[(z - 1) & 1], s->layers[z & 1]);
    }
    if (done) flip_edges(l, s->cones, s->cone_count);
    free(s->layers[0]), free(s->layers[1]), free(s->codes), free(s->cones), free(s);
    return done;
}

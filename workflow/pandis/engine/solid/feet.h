/* The nearest point of the surface for nodes near and far: a part of solid.c. */

/* Triangles with a longer edge (squared) are split before their nodes are visited. */
#define SPLIT 16
#define EQUAL 1e-5f

typedef struct {
    double corner[3][3];
    int open; /* bit k if the edge from corner k is open */
} Piece;

static int is_rim(const Piece *p, const pandis__foot *foot) {
    if (foot->edge >= 0) return p->open >> foot->edge & 1;
    return foot->corner >= 0 && (p->open >> foot->corner | p->open >> (foot->corner + 2) % 3) & 1;
}

/* Store a node's foot if it is nearer than the one stored; of equally near ones, the first. */
static int add_foot(Lattice *l, int64_t node, const double *at, const Piece *p) {
    pandis__foot foot;
    const double *c[3] = {p->corner[0], p->corner[1], p->corner[2]};
    pandis__find_foot(c, at, &foot);
    uint8_t rim = (uint8_t)is_rim(p, &foot);
    int32_t index = l->nearest[node];
    if (index < 0) {
        if (!grow(&l->feet, l->foot_count, &l->foot_room, sizeof *l->feet)) return 0;
        index = l->nearest[node] = (int32_t)l->foot_count++;
    } else if (foot.distance >= l->feet[index].distance - EQUAL) {
        if (foot.distance < l->feet[index].distance + EQUAL) l->feet[index].rim |= rim;
        return 1;
    }
    Foot *f = l->feet + index;
    for (int k = 0; k < 3; k++) f->place[k] = (float)(at[k] - foot.offset[k]);
    f->distance = (float)foot.distance;
    f->rim = rim;
    return 1;
}

static int visit(Lattice *l, const Piece *p) {
    int32_t low[3], high[3];
    for (int k = 0; k < 3; k++) {
        double range[2] = {INFINITY, -INFINITY};
        for (int c = 0; c < 3; c++) widen(range, p->corner[c][k]);
        range[0] -= 1, range[1] += 1;
        low[k] = first_in(range), high[k] = last_in(range, l->size[k]);
    }
    for (int32_t z = low[2]; z <= high[2]; z++)
        for (int32_t y = low[1]; y <= high[1]; y++)
            for (int32_t x = low[0]; x <= high[0]; x++) {
                double at[3] = {x, y, z};
                if (!add_foot(l, node_at(l, x, y, z), at, p)) return 0;
            }
    return 1;
}

/* Visit the nodes around a triangle, in halves while an edge is long: a box around a long triangle
 * would have nodes far from it. */
static int visit_piece(Lattice *l, const Piece *p, int depth) {
    int k = 0;
    double longest = -1;
    for (int i = 0; i < 3; i++) {
        double side[3], squared;
        for (int j = 0; j < 3; j++) side[j] = p->corner[(i + 1) % 3][j] - p->corner[i][j];
        squared = dot(side, side);
        if (squared > longest) longest = squared, k = i;
    }
    if (longest <= SPLIT || depth == 40) return visit(l, p);
    int next = (k + 1) % 3, last = (k + 2) % 3;
    Piece one = *p, other = *p;
    for (int j = 0; j < 3; j++)
        one.corner[next][j] = other.corner[k][j] = (p->corner[k][j] + p->corner[next][j]) / 2;
    one.open = p->open & ~(1 << next);
    other.open = p->open & ~(1 << last);
    return visit_piece(l, &one, depth + 1) && visit_piece(l, &other, depth + 1);
}

/* Find the feet of all nodes within a cell of the surface, where they are exact. */
static int find_feet(Lattice *l) {
    if (l->nearest) return 1;
    l->nearest = malloc((size_t)l->nodes * sizeof *l->nearest);
    if (!l->nearest) return 0;
    for (int64_t i = 0; i < l->nodes; i++) l->nearest[i] = -1;
    for (int64_t t = 0; t < l->triangles - l->caps; t++) {
        Piece p = {.open = l->open[t]};
        memcpy(p.corner, l->corners + 9 * t, sizeof p.corner);
        if (!visit_piece(l, &p, 0)) return 0;
    }
    return 1;
}

static float distance_to(const Lattice *l, int32_t foot, const int32_t *at) {
    const float *place = l->feet[foot].place;
    float x = place[0] - (float)at[0], y = place[1] - (float)at[1], z = place[2] - (float)at[2];
    return sqrtf(x * x + y * y + z * z);
}

/* The distance of a node from the surface, or 2 if it is not known: more than a cell. */
static double node_distance(const Lattice *l, int64_t node) {
    int32_t at[3];
    place_of(l, node, at);
    return l->nearest[node] < 0 ? 2 : distance_to(l, l->nearest[node], at);
}

/* Give a node the foot of a neighbour if that is nearer. */
static void try_foot(Lattice *l, float *distance, int64_t node, int64_t other, const int32_t *at) {
    int32_t foot = l->nearest[other];
    if (foot < 0 || foot == l->nearest[node]) return;
    float d = distance_to(l, foot, at);
    if (d < distance[node]) distance[node] = d, l->nearest[node] = foot;
}

/* Pass feet on along a row, there and back; first from the row before and the layer before. */
static void pass_row(
    Lattice *l, float *distance, int32_t y, int32_t z, int64_t row, int64_t layer) {
    for (int back = 0; back < 2; back++)
        for (int32_t i = 0; i < l->size[0]; i++) {
            int32_t at[3] = {back ? l->size[0] - 1 - i : i, y, z};
            int64_t node = node_at(l, at[0], y, z);
            if (distance[node] <= 1) continue;
            if (i) try_foot(l, distance, node, back ? node + 1 : node - 1, at);
            if (!back && row) try_foot(l, distance, node, node + row, at);
            if (!back && layer) try_foot(l, distance, node, node + layer, at);
        }
}

/* Find feet of all other nodes by sweeps over vectors (Danielsson 1980): near to exact, which is
 * enough for the sizes of rooms. Returns the distances in cells, or NULL if memory is short. */
static float *sweep_feet(Lattice *l) {
    float *distance = malloc((size_t)l->nodes * sizeof *distance);
    if (!distance) return NULL;
    for (int64_t i = 0; i < l->nodes; i++)
        distance[i] = l->nearest[i] < 0 ? 1e9f : l->feet[l->nearest[i]].distance;
    for (int up = 1; up >= 0; up--)
        for (int32_t j = 0; j < l->size[2]; j++) {
            int32_t z = up ? j : l->size[2] - 1 - j;
            int64_t layer = !j ? 0 : up ? -l->step[2] : l->step[2];
            for (int32_t y = 0; y < l->size[1]; y++)
                pass_row(l, distance, y, z, y ? -l->step[1] : 0, layer);
            for (int32_t y = l->size[1] - 2; y >= 0; y--)
                pass_row(l, distance, y, z, l->step[1], 0);
        }
    return distance;
}

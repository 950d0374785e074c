/* The nearest point of the surface for nodes near and far: a part of solid.c. */

/* Triangles with a longer edge (squared) are split before their nodes are visited. */
#define SPLIT 16
#define EQUAL 1e-5f
#define FAR_AWAY 1e9f /* cells: of nodes without a foot */

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

/* A row of nodes along x: where their feet lie, and their squared distances (-1 if exact). */
typedef struct {
    float *place[3], *squared;
    int32_t *foot;
} Row;

static float row_distance(const Row *r, int32_t i, int32_t x, int32_t y, int32_t z) {
    float dx = r->place[0][i] - (float)x, dy = r->place[1][i] - (float)y,
          dz = r->place[2][i] - (float)z;
    return dx * dx + dy * dy + dz * dz;
}

/* Give nodes of a row the feet of the row beside it where these are nearer. Without branches, so
 * that a compiler uses vectors. */
static void take_feet(const Row *mine, const Row *other, int32_t count, int32_t y, int32_t z) {
    float *restrict px = mine->place[0], *restrict py = mine->place[1],
                    *restrict pz = mine->place[2], *restrict squared = mine->squared;
    int32_t *restrict foot = mine->foot;
    for (int32_t x = 0; x < count; x++) {
        float d = row_distance(other, x, x, y, z);
        int nearer = d < squared[x];
        px[x] = nearer ? other->place[0][x] : px[x];
        py[x] = nearer ? other->place[1][x] : py[x];
        pz[x] = nearer ? other->place[2][x] : pz[x];
        foot[x] = nearer ? other->foot[x] : foot[x];
        squared[x] = nearer ? d : squared[x];
    }
}

/* Pass feet on along a row, there and back. */
static void pass_feet(const Row *r, int32_t count, int32_t y, int32_t z) {
    for (int back = 0; back < 2; back++)
        for (int32_t i = 1; i < count; i++) {
            int32_t x = back ? count - 1 - i : i, from = back ? x + 1 : x - 1;
            float d = row_distance(r, from, x, y, z);
            if (d >= r->squared[x]) continue;
            for (int k = 0; k < 3; k++) r->place[k][x] = r->place[k][from];
            r->foot[x] = r->foot[from], r->squared[x] = d;
        }
}

/* The rows of a layer whose feet's places have been looked up. */
typedef struct {
    float *places; /* (3, rows, nodes) */
    int32_t z;
} Layer;

static Row row_of_layer(const Lattice *l, const Layer *layer, float *squared, int32_t y) {
    int64_t node = node_at(l, 0, y, layer->z);
    Row row = {.squared = squared + node, .foot = l->nearest + node};
    for (int k = 0; k < 3; k++)
        row.place[k] = layer->places + k * l->step[2] + (int64_t)y * l->size[0];
    return row;
}

static void look_up(const Lattice *l, const Layer *layer) {
    const int32_t *foot = l->nearest + l->step[2] * layer->z;
    for (int64_t i = 0; i < l->step[2]; i++)
        for (int k = 0; k < 3; k++)
            layer->places[k * l->step[2] + i] = foot[i] < 0 ? FAR_AWAY : l->feet[foot[i]].place[k];
}

/* Pass feet on within a layer: up its rows and down; first from the layer before, if any. */
static void pass_layer(const Lattice *l, float *squared, const Layer *mine, const Layer *before) {
    for (int down = 0; down < 2; down++)
        for (int32_t j = down; j < l->size[1]; j++) {
            int32_t y = down ? l->size[1] - 1 - j : j, count = l->size[0];
            Row row = row_of_layer(l, mine, squared, y), other;
            if (j) {
                other = row_of_layer(l, mine, squared, down ? y + 1 : y - 1);
                take_feet(&row, &other, count, y, mine->z);
            }
            if (before && !down) {
                other = row_of_layer(l, before, squared, y);
                take_feet(&row, &other, count, y, mine->z);
            }
            pass_feet(&row, count, y, mine->z);
        }
}

/* Find feet of all other nodes by sweeps over vectors (Danielsson 1980): near to exact, which is
 * enough for the sizes of rooms. Returns the distances in cells, or NULL if memory is short. */
static float *sweep_feet(Lattice *l) {
    float *distance = malloc((size_t)l->nodes * sizeof *distance);
    float *places = malloc((size_t)(6 * l->step[2]) * sizeof *places);
    if (!distance || !places) {
        free(distance), free(places);
        return NULL;
    }
    for (int64_t i = 0; i < l->nodes; i++) {
        float d = l->nearest[i] < 0 ? FAR_AWAY : l->feet[l->nearest[i]].distance;
        distance[i] = d <= 1 ? -1 : d * d;
    }
    for (int down = 0; down < 2; down++)
        for (int32_t j = 0; j < l->size[2]; j++) {
            int32_t z = down ? l->size[2] - 1 - j : j;
            Layer mine = {places + 3 * (z % 2) * l->step[2], z};
            Layer before = {places + 3 * ((z + 1) % 2) * l->step[2], down ? z + 1 : z - 1};
            look_up(l, &mine);
            pass_layer(l, distance, &mine, j ? &before : NULL);
        }
    for (int64_t i = 0; i < l->nodes; i++)
        distance[i] = distance[i] < 0 ? l->feet[l->nearest[i]].distance : sqrtf(distance[i]);
    free(places);
    return distance;
}

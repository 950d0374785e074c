/* The surface inside one cell: a part of solid.c.
 *
 * Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2). Edges are numbered by axis, then by their
 * lower corner. On each side of the cell, the surface joins the two edges that it cuts; where it
 * cuts all four, the corners inside are joined. So its pieces are closed loops over edges. Each
 * loop is a fan of triangles none of whose inner edges lies in a side of the cell. Such fans of one
 * cell do not meet, wherever on the edges their corners are (test_solid.py draws them at random),
 * and fans of different cells meet only in the cells' common sides. */

typedef struct {
    int count, size[4];
    int8_t edge[4][12];
} Loops;

typedef struct {
    int low, axis; /* an edge's lower corner, and direction */
} CellEdge;

static const CellEdge CELL_EDGES[12] = {
    {0, 0}, {2, 0}, {4, 0}, {6, 0}, {0, 1}, {1, 1}, {4, 1}, {5, 1}, {0, 2}, {1, 2}, {2, 2}, {3, 2}};

static int cell_edge(int one, int other) {
    int low = one < other ? one : other, axis = (one ^ other) >> 1;
    for (int e = 0; e < 12; e++)
        if (CELL_EDGES[e].low == low && CELL_EDGES[e].axis == axis) return e;
    return -1;
}

/* Whether two edges lie in one side of the cell. */
static int share_side(int one, int other) {
    for (int axis = 0; axis < 3; axis++) {
        const CellEdge *a = CELL_EDGES + one, *b = CELL_EDGES + other;
        if (a->axis == axis || b->axis == axis) continue;
        if ((a->low >> axis & 1) == (b->low >> axis & 1)) return 1;
    }
    return 0;
}

/* Add what follows each edge along the surface in one side of the cell. */
static void join_side(int solid, int axis, int high, int *next) {
    int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = high << axis;
    int ring[4] = {base, base | u, base | u | v, base | v}; /* anticlockwise from the high side */
    int edge[4], leaves[4], count = 0;
    for (int k = 0; k < 4; k++) {
        int one = ring[high ? k : 3 - k], other = ring[high ? (k + 1) % 4 : (6 - k) % 4];
        if ((solid >> one & 1) == (solid >> other & 1)) continue;
        edge[count] = cell_edge(one, other);
        leaves[count++] = solid >> one & 1;
    }
    for (int k = 0; k < count; k++)
        if (leaves[k]) next[edge[k]] = edge[(k + 1) % count];
}

/* Turn a loop until no inner edge of its fan lies in a side of the cell. */
static void turn_loop(int8_t *edge, int size) {
    for (int start = 0; start < size; start++) {
        int fits = 1;
        for (int k = 2; k < size - 1; k++)
            fits &= !share_side(edge[start], edge[(start + k) % size]);
        if (!fits) continue;
        int8_t turned[12];
        for (int k = 0; k < size; k++) turned[k] = edge[(start + k) % size];
        memcpy(edge, turned, (size_t)size);
        return;
    }
}

/* Find the loops of a cell whose solid corners are the bits of `solid`. */
static void find_loops(int solid, Loops *loops) {
    int next[12];
    for (int e = 0; e < 12; e++) next[e] = -1;
    for (int axis = 0; axis < 3; axis++)
        for (int high = 0; high < 2; high++) join_side(solid, axis, high, next);
    loops->count = 0;
    for (int first = 0; first < 12; first++) {
        if (next[first] < 0) continue;
        int8_t *edge = loops->edge[loops->count];
        int size = 0, e = first;
        while (next[e] >= 0) {
            int after = next[e];
            edge[size++] = (int8_t)e;
            next[e] = -1;
            e = after;
        }
        turn_loop(edge, size);
        loops->size[loops->count++] = size;
    }
}

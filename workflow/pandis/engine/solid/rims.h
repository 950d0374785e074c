/* Rims of holes: a part of solid.c. */

/* A graph of edges, and a walk along those not yet used. */
typedef struct {
    const int32_t *edges; /* (count, 2) */
    int64_t count;
    int32_t vertices;
    int64_t *start, *at; /* per vertex: its first half-edge, and its next */
    int64_t *half;       /* half-edges by vertex: 2 edge + end */
    uint8_t *used;       /* per edge */
    int32_t *way;        /* the vertices of the walk */
    int64_t *step;       /* per vertex: its place in the walk, or -1 */
} Walk;

static int start_walk(Walk *w) {
    size_t vertices = (size_t)w->vertices + 2, count = (size_t)w->count + 1;
    w->start = calloc(vertices, sizeof *w->start), w->at = malloc(vertices * sizeof *w->at);
    w->half = malloc(2 * count * sizeof *w->half), w->used = calloc(count, 1);
    w->way = malloc(count * sizeof *w->way), w->step = malloc(vertices * sizeof *w->step);
    if (!w->start || !w->at || !w->half || !w->used || !w->way || !w->step) return 0;
    for (int64_t i = 0; i < 2 * w->count; i++) w->start[w->edges[i] + 1]++;
    for (int32_t v = 0; v < w->vertices; v++) {
        w->start[v + 1] += w->start[v];
        w->at[v] = w->start[v], w->step[v] = -1;
    }
    for (int64_t i = 0; i < 2 * w->count; i++) w->half[w->at[w->edges[i]]++] = i;
    memcpy(w->at, w->start, vertices * sizeof *w->at);
    return 1;
}

/* Go along an unused edge of a vertex; returns the vertex at its other end, or -1. */
static int32_t go_on(Walk *w, int32_t vertex) {
    while (w->at[vertex] < w->start[vertex + 1]) {
        int64_t half = w->half[w->at[vertex]++];
        if (w->used[half / 2]) continue;
        w->used[half / 2] = 1;
        return w->edges[half ^ 1];
    }
    return -1;
}

/* Split the open edges of a mesh into closed loops, whatever their orientation: walk along unused
 * edges, and cut off a loop wherever the walk meets itself. Edges on ways that end are left out.
 * Writes the loops' vertices and sizes; returns the number of loops, or -1 if memory is short. */
int64_t solid_rims(
    const int32_t *edges, int64_t count, int32_t vertices, int32_t *loops, int64_t *sizes) {
    Walk w = {.edges = edges, .count = count, .vertices = vertices};
    int64_t total = start_walk(&w) ? 0 : -1;
    for (int32_t first = 0; first < vertices && total >= 0; first++) {
        int64_t length = 0;
        w.way[0] = first, w.step[first] = 0;
        while (length >= 0) {
            int32_t next = go_on(&w, w.way[length]);
            if (next < 0) {
                w.step[w.way[length--]] = -1;
            } else if (w.step[next] < 0) {
                w.way[++length] = next, w.step[next] = length;
            } else {
                int64_t size = length - w.step[next] + 1;
                if (size > 2) memcpy(loops, w.way + w.step[next], (size_t)size * sizeof *loops);
                if (size > 2) loops += size, sizes[total++] = size;
                for (; w.way[length] != next; length--) w.step[w.way[length]] = -1;
            }
        }
    }
    free(w.start), free(w.at), free(w.half), free(w.used), free(w.way), free(w.step);
    return total;
}

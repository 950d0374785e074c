/* Vertices in order of cost: a part of solid.c. */

/* A binary heap that knows where each vertex is. */
typedef struct {
    int32_t *heap, *where; /* where: place in the heap, or -1 */
    double *cost;          /* per vertex */
    int32_t count;
} Queue;

static int start_queue(Queue *q, int64_t vertices) {
    q->heap = malloc((size_t)vertices * sizeof *q->heap);
    q->where = malloc((size_t)vertices * sizeof *q->where);
    q->cost = malloc((size_t)vertices * sizeof *q->cost);
    q->count = 0;
    if (!q->heap || !q->where || !q->cost) return 0;
    for (int64_t i = 0; i < vertices; i++) q->where[i] = -1;
    return 1;
}

static int is_cheaper(const Queue *q, int32_t one, int32_t other) {
    return q->cost[one] < q->cost[other] || (q->cost[one] == q->cost[other] && one < other);
}

static void put(Queue *q, int32_t place, int32_t vertex) {
    q->heap[place] = vertex, q->where[vertex] = place;
}

static void sift(Queue *q, int32_t place) {
    int32_t vertex = q->heap[place];
    for (; place > 0 && is_cheaper(q, vertex, q->heap[(place - 1) / 2]); place = (place - 1) / 2)
        put(q, place, q->heap[(place - 1) / 2]);
    for (int32_t child = 2 * place + 1; child < q->count; child = 2 * place + 1) {
        if (child + 1 < q->count && is_cheaper(q, q->heap[child + 1], q->heap[child])) child++;
        if (!is_cheaper(q, q->heap[child], vertex)) break;
        put(q, place, q->heap[child]);
        place = child;
    }
    put(q, place, vertex);
}

static void take_out(Queue *q, int32_t vertex) {
    int32_t place = q->where[vertex];
    if (place < 0) return;
    q->where[vertex] = -1;
    int32_t last = q->heap[--q->count];
    if (last == vertex) return;
    put(q, place, last);
    sift(q, place);
}

/* Add a vertex, or move it to its new place; an infinite cost takes it out. */
static void set_cost(Queue *q, int32_t vertex, double cost) {
    if (cost == (double)INFINITY) {
        take_out(q, vertex);
        return;
    }
    q->cost[vertex] = cost;
    if (q->where[vertex] < 0) put(q, q->count++, vertex);
    sift(q, q->where[vertex]);
}

/* Fewer faces for the same surface: a part of solid.c.
 *
 * Vertices are merged into neighbours, cheapest first, as long as the surface stays near (quadric
 * error metrics: Garland and Heckbert 1997). The vertices that remain stay in place, so on the
 * source. The caller finds faces that cross, locks the vertices around them, and takes apart what
 * was merged there (reopen.h). */

#define MOST_NEIGHBOURS 64
#define MOST_OFF 2  /* a merge moves the surface by at most this many times the mean tolerance */
#define TURN 0.2    /* cosine of the angle by which a face may turn in one step */
#define NARROW 1e-4 /* least altitude of a new face, as a share of its longest edge */
#define FLAT_ERROR 1e-8 /* square cells */
#define FLAT_ROUNDS 2
#define SHORT_FIRST 1e-5 /* of equal errors, the shorter edge: weight of its squared length */

/* The weighted sum of squared distances to planes: x'Ax + 2b'x + c, and the weight. */
typedef struct {
    double a[6], b[3], c, weight;
} Quadric;

/* Half-edge 3 f + k leads from corner k of face f to its next. */
typedef struct {
    const double *places;
    Face *faces;
    int64_t face_count, vertex_count;
    int32_t *opposite, *out; /* per half-edge; per vertex: a half-edge that leaves it */
    Quadric *quadrics;
    const uint8_t *locked;
    int32_t *into; /* per vertex: the neighbour it was merged into, or itself */
    Queue queue;
    double bound, most; /* squared: of the mean over planes, now and at most */
    int queued;         /* whether vertices wait in the queue */
} Mesh;

static int32_t after(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }

static int32_t before(int32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

static int32_t origin_of(const Mesh *m, int32_t h) { return m->faces[h / 3].corner[h % 3]; }

static int32_t end_of(const Mesh *m, int32_t h) { return origin_of(m, after(h)); }

/* The next half-edge that leaves the same vertex. */
static int32_t turned(const Mesh *m, int32_t h) { return m->opposite[before(h)]; }

/* The number of half-edges that leave a vertex and can be reached from one of them. */
static int32_t fan_of(const Mesh *m, int32_t vertex) {
    int32_t count = 0, h = m->out[vertex];
    do count++;
    while ((h = turned(m, h)) != m->out[vertex]);
    return count;
}

/* Find the opposite of each half-edge. Returns 1, or 0 if memory is short, or -1 if the mesh is not
 * closed and manifold. Then `into` is -1 for the ends of edges without exactly one face on each
 * side or, if there are no such edges, for vertices whose faces form several fans. */
static int join_halves(Mesh *m) {
    int64_t halves = 3 * m->face_count;
    int done = 0;
    int32_t *start = calloc((size_t)m->vertex_count + 2, sizeof *start);
    int32_t *leaving = malloc((size_t)halves * sizeof *leaving);
    if (start && leaving) {
        for (int32_t h = 0; h < halves; h++) start[origin_of(m, h) + 2]++;
        for (int64_t v = 0; v < m->vertex_count; v++) start[v + 2] += start[v + 1];
        for (int32_t h = 0; h < halves; h++) leaving[start[origin_of(m, h) + 1]++] = h;
        done = 1;
        for (int32_t h = 0; h < halves; h++) {
            int32_t from = end_of(m, h), to = origin_of(m, h), match = -1, matches = 0;
            for (int32_t i = start[from]; i < start[from + 1]; i++)
                if (end_of(m, leaving[i]) == to) match = leaving[i], matches++;
            m->opposite[h] = match, m->out[to] = h;
            if (matches != 1 || from == to) done = m->into[from] = m->into[to] = -1;
        }
        int joined = done == 1;
        for (int32_t v = 0; joined && v < m->vertex_count; v++)
            if (m->out[v] >= 0 && fan_of(m, v) != start[v + 1] - start[v]) done = m->into[v] = -1;
    }
    free(start), free(leaving);
    return done;
}

static void add_quadric(Quadric *q, const Quadric *other) {
    for (int i = 0; i < 6; i++) q->a[i] += other->a[i];
    for (int i = 0; i < 3; i++) q->b[i] += other->b[i];
    q->c += other->c, q->weight += other->weight;
}

static void add_planes(Mesh *m) {
    for (int64_t f = 0; f < m->face_count; f++) {
        const int32_t *corner = m->faces[f].corner;
        double n[3];
        area_of(m->places, m->faces + f, n);
        double area = length(n);
        if (!(area > 0)) continue;
        for (int k = 0; k < 3; k++) n[k] /= area;
        double d = -dot(n, m->places + 3 * (int64_t)corner[0]);
        Quadric q = {{area * n[0] * n[0], area * n[1] * n[1], area * n[2] * n[2],
                         area * n[0] * n[1], area * n[0] * n[2], area * n[1] * n[2]},
            {area * d * n[0], area * d * n[1], area * d * n[2]}, area * d * d, area};
        for (int k = 0; k < 3; k++) add_quadric(m->quadrics + corner[k], &q);
    }
}

/* The mean squared distance of a place from a quadric's planes. */
static double error_at(const Quadric *q, const double *p) {
    double sum = q->c + q->a[0] * p[0] * p[0] + q->a[1] * p[1] * p[1] + q->a[2] * p[2] * p[2] +
        2 * (q->a[3] * p[0] * p[1] + q->a[4] * p[0] * p[2] + q->a[5] * p[1] * p[2]) +
        2 * dot(q->b, p);
    return sum > 0 && q->weight > 0 ? sum / q->weight : 0;
}

/* The cost of merging a vertex into its neighbour; infinite if too large. */
static double cost_of(const Mesh *m, int32_t vertex, int32_t end) {
    const double *p = m->places + 3 * (int64_t)vertex, *q = m->places + 3 * (int64_t)end;
    double error = error_at(m->quadrics + vertex, q);
    double side[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    return error <= m->bound ? error + SHORT_FIRST * dot(side, side) : (double)INFINITY;
}

/* Queue a vertex by its cheapest merge. */
static void ask_again(Mesh *m, int32_t vertex) {
    double least = INFINITY;
    int32_t h = m->out[vertex];
    if (!m->locked[vertex]) do {
            double cost = cost_of(m, vertex, end_of(m, h));
            if (cost < least) least = cost;
        } while ((h = turned(m, h)) != m->out[vertex]);
    set_cost(&m->queue, vertex, least);
}

/* The half-edges that leave a vertex, and the vertices they lead to. */
typedef struct {
    int32_t half[MOST_NEIGHBOURS], end[MOST_NEIGHBOURS];
    int count; /* 0 if there are too many */
} Star;

static void find_star(const Mesh *m, int32_t vertex, Star *s) {
    int32_t h = m->out[vertex];
    s->count = 0;
    do {
        if (s->count == MOST_NEIGHBOURS) {
            s->count = 0;
            return;
        }
        s->half[s->count] = h, s->end[s->count++] = end_of(m, h);
    } while ((h = turned(m, h)) != m->out[vertex]);
}

/* Whether a face keeps its direction and stays wide enough with another place for a corner. */
static int stays_sound(const Mesh *m, int32_t h, const double *place) {
    const double *p = m->places + 3 * (int64_t)origin_of(m, h);
    const double *q = m->places + 3 * (int64_t)end_of(m, h);
    const double *r = m->places + 3 * (int64_t)origin_of(m, before(h));
    double u[3], v[3], w[3], x[3], y[3], old[3], new[3];
    for (int k = 0; k < 3; k++) {
        u[k] = q[k] - p[k], v[k] = r[k] - p[k];
        w[k] = q[k] - place[k], x[k] = r[k] - place[k], y[k] = r[k] - q[k];
    }
    cross(u, v, old), cross(w, x, new);
    double longest = larger(dot(w, w), larger(dot(x, x), dot(y, y))), size = length(new);
    return dot(old, new) >= TURN * length(old) * size && size >= NARROW * longest;
}

/* Whether a place lies near the plane of a face. The mean over all planes would let the narrow
 * sides of thin parts go: their area is small. */
static int stays_near(const Mesh *m, int32_t h, const double *place) {
    const double *p = m->places + 3 * (int64_t)origin_of(m, h);
    double n[3], way[3];
    area_of(m->places, m->faces + h / 3, n);
    for (int k = 0; k < 3; k++) way[k] = place[k] - p[k];
    double height = dot(n, way);
    return height * height <= MOST_OFF * MOST_OFF * m->most * dot(n, n);
}

/* Whether the origin of a half-edge, whose star is given, can be merged into its end. */
static int can_merge(const Mesh *m, int32_t h, const Star *mine) {
    int32_t face = h / 3, other = m->opposite[h] / 3, end = end_of(m, h);
    Star theirs;
    int common = 0;
    find_star(m, end, &theirs);
    for (int i = 0; i < mine->count; i++)
        for (int j = 0; j < theirs.count; j++) common += mine->end[i] == theirs.end[j];
    if (common != 2) return 0;
    const double *place = m->places + 3 * (int64_t)end;
    for (int i = 0; i < mine->count; i++) {
        int32_t half = mine->half[i];
        if (half / 3 != face && half / 3 != other &&
            (!stays_near(m, half, place) || !stays_sound(m, half, place)))
            return 0;
    }
    return 1;
}

static void join(Mesh *m, int32_t one, int32_t other) {
    m->opposite[one] = other, m->opposite[other] = one;
    m->out[origin_of(m, one)] = one, m->out[origin_of(m, other)] = other;
}

/* Merge the origin of a half-edge, whose star is given, into its end. */
static void merge(Mesh *m, int32_t h, const Star *mine) {
    int32_t vertex = origin_of(m, h), end = end_of(m, h), other = m->opposite[h];
    int32_t pairs[2][2] = {{m->opposite[after(h)], m->opposite[before(h)]},
        {m->opposite[after(other)], m->opposite[before(other)]}};
    for (int i = 0; i < mine->count; i++)
        m->faces[mine->half[i] / 3].corner[mine->half[i] % 3] = end;
    m->faces[h / 3].corner[0] = m->faces[other / 3].corner[0] = -1;
    for (int i = 0; i < 2; i++) join(m, pairs[i][0], pairs[i][1]);
    add_quadric(m->quadrics + end, m->quadrics + vertex);
    m->into[vertex] = end;
}

/* Merge a vertex into the neighbour that is cheapest among those it can be merged into; or queue it
 * again if its cost has risen since. Costs of queued vertices are not kept up to date. */
static void merge_cheapest(Mesh *m, int32_t vertex) {
    Star mine;
    double cost[MOST_NEIGHBOURS], least = INFINITY;
    find_star(m, vertex, &mine);
    for (int i = 0; i < mine.count; i++) {
        cost[i] = cost_of(m, vertex, mine.end[i]);
        if (cost[i] < least) least = cost[i];
    }
    if (m->queued && least > m->queue.cost[vertex]) {
        set_cost(&m->queue, vertex, least);
        return;
    }
    for (int tried = 0; tried < mine.count; tried++) {
        int best = 0;
        for (int i = 1; i < mine.count; i++)
            if (cost[i] < cost[best]) best = i;
        if (cost[best] == (double)INFINITY) return;
        cost[best] = INFINITY;
        if (!can_merge(m, mine.half[best], &mine)) continue;
        merge(m, mine.half[best], &mine);
        m->out[vertex] = -1;
        for (int i = 0; i < mine.count && m->queued; i++)
            if (i == best || m->queue.where[mine.end[i]] < 0) ask_again(m, mine.end[i]);
        return;
    }
}

/* Merge the vertices inside flat faces and straight edges, in their own order: most vertices of
 * parts with flat sides, without the queue's jumps through memory. */
static void merge_flat(Mesh *m) {
    double bound = m->bound;
    m->bound = fmin(bound, FLAT_ERROR);
    m->queued = 0;
    for (int round = 0; round < FLAT_ROUNDS; round++)
        for (int32_t v = 0; v < m->vertex_count; v++)
            if (m->out[v] >= 0 && !m->locked[v]) merge_cheapest(m, v);
    m->bound = bound;
    m->queued = 1;
}

/* Lead each vertex to the one that stands for it at the end. */
static void follow_merges(int32_t *into, int64_t vertices) {
    for (int32_t v = 0; v < vertices; v++) {
        int32_t last = v, next;
        while (into[last] != last) last = into[last];
        for (int32_t w = v; w != last; w = next) next = into[w], into[w] = last;
    }
}

/* Simplify a closed manifold mesh in place: dropped faces get -1 as their first corner. `into`
 * receives the vertex that stands for each. The root mean square distance of a merged vertex from
 * its planes is at most `tolerance`. Returns as join_halves. */
int32_t solid_simplify(const double *places, int64_t vertices, int32_t *faces, int64_t count,
    const uint8_t *locked, double tolerance, int32_t *into) {
    Mesh m = {.places = places,
        .faces = (Face *)faces,
        .face_count = count,
        .vertex_count = vertices,
        .locked = locked,
        .into = into,
        .bound = tolerance * tolerance,
        .most = tolerance * tolerance};
    m.opposite = malloc((size_t)(3 * count) * sizeof *m.opposite);
    m.out = malloc((size_t)vertices * sizeof *m.out);
    m.quadrics = calloc((size_t)vertices, sizeof *m.quadrics);
    int done = m.opposite && m.out && m.quadrics && start_queue(&m.queue, vertices);
    if (done) {
        for (int32_t v = 0; v < vertices; v++) m.out[v] = -1, into[v] = v;
        done = join_halves(&m);
    }
    if (done == 1) {
        add_planes(&m);
        merge_flat(&m);
        for (int32_t v = 0; v < vertices; v++)
            if (m.out[v] >= 0) ask_again(&m, v);
        while (m.queue.count) {
            int32_t vertex = m.queue.heap[0];
            take_out(&m.queue, vertex);
            merge_cheapest(&m, vertex);
        }
        follow_merges(into, vertices);
    }
    free(m.opposite), free(m.out), free(m.quadrics);
    free(m.queue.heap), free(m.queue.where), free(m.queue.cost);
    return done;
}

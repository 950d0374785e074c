/* Building the tree: a part of bvh.c. */

/* A face, its box and its centroid. Items are moved as a whole, so that a range of them is
 * contiguous in memory. */
typedef struct {
    float low[3], high[3], centroid[3];
    int32_t face;
} Item;

typedef struct {
    Bvh *tree;
    Item *items;
    int node_room, leaf_room, failed;
} Builder;

typedef struct {
    int32_t start, count;
    float low[3], high[3], area;
} Range;

static float half_area(const float *low, const float *high) {
    float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x * y + y * z + z * x;
}

static void include(float *low, float *high, const float *other_low, const float *other_high) {
    for (int k = 0; k < 3; k++) {
        if (other_low[k] < low[k]) low[k] = other_low[k];
        if (other_high[k] > high[k]) high[k] = other_high[k];
    }
}

static void bound(Builder *b, Range *r) {
    for (int k = 0; k < 3; k++) r->low[k] = INFINITY, r->high[k] = -INFINITY;
    for (int32_t i = r->start; i < r->start + r->count; i++)
        include(r->low, r->high, b->items[i].low, b->items[i].high);
    r->area = half_area(r->low, r->high);
}

/* The index of a centroid's bin; the bins divide an axis between two coordinates. */
static int bin_of(float centroid, float low, float high) {
    float factor = BINS * 0.9999f / (high - low);
    return (int)((centroid - low) * factor);
}

/* Find the cheapest split between two bins of an axis. Returns the last bin on the left, and sets
 * `best` to the cost of the split; or returns -1 if no split costs less than `best`. */
static int cheapest_bin(
    const Builder *b, const Range *r, int axis, float low, float high, float *best) {
    float bin_low[BINS][3], bin_high[BINS][3], area[BINS];
    int32_t count[BINS] = {0}, before = 0;
    int found = -1;
    for (int i = 0; i < BINS; i++)
        for (int k = 0; k < 3; k++) bin_low[i][k] = INFINITY, bin_high[i][k] = -INFINITY;
    for (int32_t i = r->start; i < r->start + r->count; i++) {
        const Item *item = b->items + i;
        int bin = bin_of(item->centroid[axis], low, high);
        count[bin]++;
        include(bin_low[bin], bin_high[bin], item->low, item->high);
    }
    float l[3] = {INFINITY, INFINITY, INFINITY}, h[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int i = BINS - 1; i > 0; i--) { /* area of all bins from i on */
        include(l, h, bin_low[i], bin_high[i]);
        area[i] = h[0] >= l[0] ? half_area(l, h) : 0;
    }
    for (int k = 0; k < 3; k++) l[k] = INFINITY, h[k] = -INFINITY;
    for (int i = 0; i < BINS - 1; i++) {
        before += count[i];
        include(l, h, bin_low[i], bin_high[i]);
        if (!before || before == r->count) continue;
        float cost = half_area(l, h) * (float)before + area[i + 1] * (float)(r->count - before);
        if (cost < *best) *best = cost, found = i;
    }
    return found;
}

/* Split a range by the binned surface area heuristic; halve it if that finds no split. */
static void split(Builder *b, const Range *r, int depth, Range *left, Range *right) {
    float low[3], high[3], best = INFINITY;
    int best_axis = -1, best_bin = 0;
    for (int k = 0; k < 3; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (int32_t i = r->start; i < r->start + r->count; i++)
        include(low, high, b->items[i].centroid, b->items[i].centroid);
    for (int axis = 0; axis < 3 && depth < MEDIAN_DEPTH; axis++) {
        if (!(high[axis] > low[axis])) continue;
        int bin = cheapest_bin(b, r, axis, low[axis], high[axis], &best);
        if (bin >= 0) best_axis = axis, best_bin = bin;
    }
    int32_t middle = r->start + r->count / 2;
    if (best_axis >= 0) {
        int32_t i = r->start, j = r->start + r->count;
        while (i < j) {
            float c = b->items[i].centroid[best_axis];
            if (bin_of(c, low[best_axis], high[best_axis]) <= best_bin) {
                i++;
            } else {
                Item swap = b->items[--j];
                b->items[j] = b->items[i];
                b->items[i] = swap;
            }
        }
        middle = i;
    }
    *left = (Range){.start = r->start, .count = middle - r->start};
    *right = (Range){.start = middle, .count = r->start + r->count - middle};
    bound(b, left);
    bound(b, right);
}

/* The corner of a face with the widest angle, at which single precision loses least. */
static int widest_corner(const Bvh *t, int32_t face) {
    int widest = 0;
    double longest = -1;
    for (int c = 0; c < 3; c++) { /* opposite to the longest side */
        const double *p = corner(t, face, (c + 1) % 3), *q = corner(t, face, (c + 2) % 3);
        double side[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]}, length = dot(side, side);
        if (length > longest) longest = length, widest = c;
    }
    return widest;
}

/* Round the triangles of a leaf to 16 bits, and bound the error of their distances in single
 * precision. */
static void round_triangles(const Bvh *t, const Range *r, Leaf *leaf) {
    float v[3][3][WIDTH], slack[2];
    double extent = 0;
    for (int k = 0; k < 3; k++) {
        leaf->origin[k] = nextafterf(r->low[k], -INFINITY);
        double side = nextafterf(r->high[k], INFINITY) - (double)leaf->origin[k];
        if (side > extent) extent = side;
    }
    int exponent;
    (void)frexp(extent / 65535, &exponent); /* the least power of two that is greater */
    if (exponent < -100) exponent = -100;
    leaf->step = (float)ldexp(1, exponent);
    for (int lane = 0; lane < WIDTH; lane++) {
        int32_t face = leaf->face[leaf->face[lane] < 0 ? 0 : lane];
        int first = widest_corner(t, face);
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) {
                double at = (corner(t, face, (first + c) % 3)[k] - (double)leaf->origin[k]) /
                    (double)leaf->step;
                leaf->corner[c][k][lane] = (uint16_t)rint(at > 65535 ? 65535 : at > 0 ? at : 0);
                v[c][k][lane] = leaf->corner[c][k][lane];
            }
    }
    pandis__slacks(v, slack);
    /* add the effect of rounding: each coordinate of a corner moves by up to half a step, and the
     * point by its last bit */
    double steps = 1 + (double)slack[0] + 4 * 6e-8 * extent / (double)leaf->step;
    leaf->slack = (float)(steps * (double)leaf->step * (1 + 1e-6)), leaf->share = slack[1];
}

static int32_t add_leaf(Builder *b, const Range *r) {
    Bvh *t = b->tree;
    if (t->leaf_count == b->leaf_room) {
        int room = b->leaf_room * 2;
        Leaf *grown = realloc(t->leaves, (size_t)room * sizeof(Leaf));
        if (!grown) return b->failed = 1, 0;
        t->leaves = grown, b->leaf_room = room;
    }
    Leaf *leaf = t->leaves + t->leaf_count;
    memset(leaf, 0, sizeof *leaf);
    for (int lane = 0; lane < WIDTH; lane++)
        leaf->face[lane] = lane < r->count ? b->items[r->start + lane].face : -1;
    round_triangles(t, r, leaf);
    return t->leaf_count++;
}

/* Find the dipole that replaces a range of faces in winding numbers far away: the cluster of a
 * node's child. */
static void find_dipole(const Builder *b, const Range *r, int child, Cluster *cluster) {
    const Bvh *t = b->tree;
    double area = 0, centre[3] = {0}, dipole[3] = {0};
    for (int32_t j = r->start; j < r->start + r->count; j++) {
        int32_t face = b->items[j].face;
        const double *p = corner(t, face, 0), *q = corner(t, face, 1), *s = corner(t, face, 2);
        double ab[3], ac[3], n[3];
        for (int k = 0; k < 3; k++) ab[k] = q[k] - p[k], ac[k] = s[k] - p[k];
        cross(ab, ac, n);
        double twice = sqrt(dot(n, n));
        area += twice;
        for (int k = 0; k < 3; k++) {
            dipole[k] += n[k] / 2;
            centre[k] += twice * (p[k] + q[k] + s[k]) / 3;
        }
    }
    double reach = 0;
    for (int k = 0; k < 3; k++)
        centre[k] = area > 0 ? centre[k] / area : (r->low[k] + r->high[k]) / 2;
    for (int32_t j = r->start; j < r->start + r->count; j++)
        for (int c = 0; c < 3; c++) {
            const double *p = corner(t, b->items[j].face, c);
            double d = 0;
            for (int k = 0; k < 3; k++) d += (p[k] - centre[k]) * (p[k] - centre[k]);
            if (d > reach) reach = d;
        }
    for (int k = 0; k < 3; k++) {
        cluster->centre[k][child] = (float)centre[k];
        cluster->dipole[k][child] = (float)dipole[k];
    }
    cluster->reach[child] = (float)(reach * 1.0001 + 1e-30);
}

/* Divide a range among the children of a node: their ranges, boxes and dipoles. Returns the
 * number of children. */
static int open_node(Builder *b, Range root, int depth, Node *node, Cluster *cluster, Range *part) {
    const Bvh *t = b->tree;
    int count = 1;
    part[0] = root;
    while (count < WIDTH) {
        int widest = -1;
        for (int i = 0; i < count; i++)
            if (part[i].count > WIDTH && (widest < 0 || part[i].area > part[widest].area))
                widest = i;
        if (widest < 0) break;
        Range left, right;
        split(b, &part[widest], depth, &left, &right);
        part[widest] = left, part[count++] = right;
    }
    memset(node, 0, sizeof *node), memset(cluster, 0, sizeof *cluster);
    /* the float box of a point may be off by half a unit in the last place of the coordinates */
    float pad = (float)(t->scale * 4e-7);
    for (int i = 0; i < WIDTH; i++) {
        for (int k = 0; k < 3; k++) {
            node->low[k][i] = i < count ? part[i].low[k] - pad : INFINITY;
            node->high[k][i] = i < count ? part[i].high[k] + pad : -INFINITY;
        }
        if (i < count) find_dipole(b, &part[i], i, cluster);
    }
    return count;
}

static int32_t add_node(Builder *b, Range root, int depth) {
    Bvh *t = b->tree;
    if (t->node_count == b->node_room) {
        int room = b->node_room * 2;
        Node *nodes = realloc(t->nodes, (size_t)room * sizeof(Node));
        if (nodes) t->nodes = nodes;
        Cluster *clusters = realloc(t->clusters, (size_t)room * sizeof(Cluster));
        if (clusters) t->clusters = clusters;
        if (!nodes || !clusters) return b->failed = 1, 0;
        b->node_room = room;
    }
    int32_t index = t->node_count++;
    Range part[WIDTH];
    Node node;
    Cluster cluster;
    int count = open_node(b, root, depth, &node, &cluster, part);
    for (int i = 0; i < count && !b->failed; i++)
        node.child[i] =
            part[i].count <= WIDTH ? ~add_leaf(b, &part[i]) : add_node(b, part[i], depth + 1);
    t->nodes[index] = node, t->clusters[index] = cluster;
    return index;
}

static int32_t end_of(const Bvh *t, size_t h) { return t->faces[h % 3 == 2 ? h - 2 : h + 1]; }

/* Half-edges that wait for their opposite, by their other end; of each end, in order. */
typedef struct {
    int32_t *first, *last; /* per vertex; `first` is -1 where none waits */
    int32_t *next;         /* per half-edge */
} Waiting;

/* Join a half-edge to the first that waits for it, or let it wait at its other end. */
static void join_or_wait(Bvh *t, Waiting *w, int32_t h, int32_t other) {
    int32_t g = w->first[other];
    if (g >= 0 && t->faces[g] == end_of(t, (size_t)h) && t->faces[h] == end_of(t, (size_t)g)) {
        t->neighbours[g] = h / 3, t->neighbours[h] = g / 3;
        w->first[other] = w->next[g];
        return;
    }
    if (g < 0) w->first[other] = h;
    else w->next[w->last[other]] = h;
    w->last[other] = h, w->next[h] = -1;
}

/* Find the face across each edge, by half-edges bucketed by their vertex of lower index. */
static int find_neighbours(Bvh *t) {
    size_t halves = 3 * (size_t)t->face_count, vertices = (size_t)t->vertex_count;
    int64_t *start = calloc(vertices + 2, sizeof *start);
    int32_t *bucket = malloc(halves * sizeof *bucket);
    Waiting w = {malloc(vertices * sizeof *w.first), malloc(vertices * sizeof *w.last),
        malloc(halves * sizeof *w.next)};
    int done = start && bucket && w.first && w.last && w.next;
    for (size_t h = 0; done && h < halves; h++) {
        int32_t u = t->faces[h], v = end_of(t, h);
        start[(u < v ? u : v) + 2]++;
    }
    for (size_t v = 0; done && v < vertices; v++) start[v + 2] += start[v + 1], w.first[v] = -1;
    for (size_t h = 0; done && h < halves; h++) {
        int32_t u = t->faces[h], v = end_of(t, h);
        bucket[start[(u < v ? u : v) + 1]++] = (int32_t)h;
        t->neighbours[h] = -1;
    }
    for (int32_t v = 0; done && v < t->vertex_count; v++)
        for (int turn = 0; turn < 2; turn++) /* join, then forget those that wait in vain */
            for (int64_t i = start[v]; i < start[v + 1]; i++) {
                int32_t u = t->faces[bucket[i]], end = end_of(t, (size_t)bucket[i]);
                int32_t other = u == v ? end : u;
                if (turn) w.first[other] = -1;
                else join_or_wait(t, &w, bucket[i], other);
            }
    free(start), free(bucket), free(w.first), free(w.last), free(w.next);
    return done;
}

static void find_vertex_normals(Bvh *t) {
    pandis__mesh m = view(t);
    memset(t->vertex_normals, 0, 3 * (size_t)t->vertex_count * sizeof(double));
    for (int32_t f = 0; f < t->face_count; f++) {
        double n[3];
        if (!pandis__face_normal(&m, f, n)) continue;
        for (int k = 0; k < 3; k++)
            pandis__corner_normal(
                &m, f, k, n, t->vertex_normals + 3 * (size_t)t->faces[3 * (ptrdiff_t)f + k]);
    }
    for (int32_t v = 0; v < t->vertex_count; v++) normalise(t->vertex_normals + 3 * (size_t)v);
}

void bvh_free(Bvh *t) {
    if (!t) return;
    free(t->vertices), free(t->faces), free(t->neighbours), free(t->vertex_normals);
    free(t->nodes), free(t->clusters), free(t->leaves);
    free(t);
}

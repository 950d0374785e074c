/* Building on several threads: a part of bvh.c.
 *
 * The first two levels are opened. Below them each branch is built separately, in memory of its
 * own. Then all branches are joined in the order in which a single thread would have built them, so
 * that the tree is the same to the last byte on any number of threads.
 */

/* Numbers of branches: of the first two levels, which are opened, and of the first three. The
 * children of branch i are WIDTH * i + 1 to WIDTH * i + WIDTH. */
#define OPENED (1 + WIDTH)
#define BRANCHES (1 + WIDTH + WIDTH * WIDTH)

typedef struct {
    Range range;
    int used, count; /* whether the branch exists; its number of children, 0 if it is not opened */
    Node node;       /* of an opened branch */
    Cluster cluster;
    Bvh part; /* nodes, clusters and leaves of a branch that is not opened */
} Branch;

typedef struct {
    Bvh *tree;
    Item *items;
    int failed; /* set by any thread that runs out of memory */
    Branch branches[BRANCHES];
} Work;

static void drop_branches(Work *w) {
    for (int i = 0; i < BRANCHES; i++) {
        Bvh *part = &w->branches[i].part;
        free(part->nodes), free(part->clusters), free(part->leaves);
    }
    free(w->items), free(w);
}

/* Start to build; NULL if memory is short. Indices and coordinates must have been checked. */
Work *bvh_start(
    const double *vertices, int32_t vertex_count, const int32_t *faces, int32_t face_count) {
    size_t v = (size_t)vertex_count, f = (size_t)face_count;
    Work *w = calloc(1, sizeof *w);
    Bvh *t = calloc(1, sizeof *t);
    if (!w || !t) return free(w), free(t), NULL;
    w->tree = t, t->vertex_count = vertex_count, t->face_count = face_count;
    t->vertices = malloc(3 * v * sizeof(double)), t->faces = malloc(3 * f * sizeof(int32_t));
    t->neighbours = malloc(3 * f * sizeof(int32_t)),
    t->vertex_normals = malloc(3 * v * sizeof(double));
    w->items = malloc(f * sizeof(Item));
    if (!t->vertices || !t->faces || !t->neighbours || !t->vertex_normals || !w->items)
        return drop_branches(w), bvh_free(t), NULL;
    memcpy(t->vertices, vertices, 3 * v * sizeof(double));
    memcpy(t->faces, faces, 3 * f * sizeof(int32_t));
    for (size_t i = 0; i < 3 * v; i++)
        if (fabs(vertices[i]) > t->scale) t->scale = fabs(vertices[i]);
    for (size_t i = 0; i < f; i++) {
        Item *item = w->items + i;
        item->face = (int32_t)i;
        for (int k = 0; k < 3; k++) {
            float p = (float)corner(t, (int32_t)i, 0)[k], q = (float)corner(t, (int32_t)i, 1)[k],
                  s = (float)corner(t, (int32_t)i, 2)[k];
            float low = p < q ? p : q, high = p < q ? q : p;
            item->low[k] = s < low ? s : low, item->high[k] = s > high ? s : high;
            item->centroid[k] = (p + q + s) / 3;
        }
    }
    Builder b = {.tree = t, .items = w->items};
    w->branches[0].range = (Range){.start = 0, .count = face_count};
    w->branches[0].used = 1;
    bound(&b, &w->branches[0].range);
    return w;
}

/* Open a branch of the first two levels; those of one level may be opened at the same time. */
void bvh_open(Work *w, int32_t index) {
    Branch *branch = w->branches + index;
    int leaf = index && branch->range.count <= WIDTH;
    if (!branch->used || leaf) return;
    Builder b = {.tree = w->tree, .items = w->items};
    Range part[WIDTH];
    branch->count = open_node(&b, branch->range, index > 0, &branch->node, &branch->cluster, part);
    for (int i = 0; i < branch->count; i++) {
        Branch *child = w->branches + WIDTH * index + 1 + i;
        child->range = part[i], child->used = 1;
    }
}

/* Build a branch that has not been opened, if there is one at this index; all branches may be built
 * at the same time. */
void bvh_grow(Work *w, int32_t index) {
    Branch *branch = w->branches + index;
    if (!branch->used || branch->count) return;
    Bvh *part = &branch->part;
    *part = (Bvh){.scale = w->tree->scale, .vertices = w->tree->vertices, .faces = w->tree->faces};
    Builder b = {.tree = part,
        .items = w->items,
        .node_room = 64,
        .leaf_room = branch->range.count / 4 + 64};
    part->nodes = malloc((size_t)b.node_room * sizeof(Node));
    part->clusters = malloc((size_t)b.node_room * sizeof(Cluster));
    part->leaves = malloc((size_t)b.leaf_room * sizeof(Leaf));
    b.failed = !part->nodes || !part->clusters || !part->leaves;
    if (!b.failed) {
        if (branch->range.count <= WIDTH) add_leaf(&b, &branch->range);
        else add_node(&b, branch->range, 2);
    }
    if (b.failed) w->failed = 1;
}

/* Find the faces across all edges, while branches are built. */
void bvh_meet(Work *w) {
    if (!find_neighbours(w->tree)) w->failed = 1;
}

/* Find the normals of all vertices, while branches are built. */
void bvh_turn(Work *w) { find_vertex_normals(w->tree); }

/* Append a branch and those below it to the tree; return its index as a node's child. */
static int32_t join(Bvh *t, Branch *all, int index) {
    Branch *branch = all + index;
    if (branch->count) {
        int32_t node = t->node_count++;
        for (int i = 0; i < branch->count; i++)
            branch->node.child[i] = join(t, all, WIDTH * index + 1 + i);
        t->nodes[node] = branch->node, t->clusters[node] = branch->cluster;
        return node;
    }
    Bvh *part = &branch->part;
    int32_t node = t->node_count, leaf = t->leaf_count;
    for (int32_t j = 0; j < part->node_count; j++) {
        Node *to = t->nodes + node + j;
        *to = part->nodes[j];
        for (int i = 0; i < WIDTH; i++)
            if (!(to->low[0][i] > to->high[0][i]))
                to->child[i] = to->child[i] < 0 ? ~(~to->child[i] + leaf) : to->child[i] + node;
    }
    memcpy(t->clusters + node, part->clusters, (size_t)part->node_count * sizeof(Cluster));
    memcpy(t->leaves + leaf, part->leaves, (size_t)part->leaf_count * sizeof(Leaf));
    t->node_count += part->node_count, t->leaf_count += part->leaf_count;
    free(part->nodes), free(part->clusters), free(part->leaves);
    part->nodes = NULL, part->clusters = NULL, part->leaves = NULL;
    return part->node_count ? node : ~leaf;
}

/* Join all branches and return the tree; NULL if memory was short. */
Bvh *bvh_finish(Work *w) {
    Bvh *t = w->tree;
    size_t nodes = 0, leaves = 0;
    for (int i = 0; i < BRANCHES; i++) {
        const Branch *branch = w->branches + i;
        nodes += (size_t)branch->part.node_count + (branch->count > 0),
            leaves += (size_t)branch->part.leaf_count;
    }
    free(w->items), w->items = NULL;
    if (!w->failed) {
        t->nodes = malloc(nodes * sizeof(Node)), t->clusters = malloc(nodes * sizeof(Cluster));
        t->leaves = malloc(leaves * sizeof(Leaf));
    }
    if (!t->nodes || !t->clusters || !t->leaves) return drop_branches(w), bvh_free(t), NULL;
    join(t, w->branches, 0);
    drop_branches(w);
    return t;
}

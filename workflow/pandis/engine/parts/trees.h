/* -------------------- files with trees */

/* Get the child of a node at one of its eight places; returns 0 if there is none. */
typedef int (*pandis__child)(const void *nodes, int32_t node, int place, int32_t *child);

/* Check a tree: a traversal must visit all nodes and leaves in their stored order, each once, and
 * must go no deeper than the stack. Then no query can loop, or visit more leaves than there are. */
static int pandis__walk(
    const void *tree, pandis__child child_of, int32_t node_count, int32_t leaf_count) {
    int32_t path[PANDIS__DEEPEST], nodes = 1, leaves = 0;
    int next[PANDIS__DEEPEST], depth = 0;
    path[0] = 0, next[0] = 0;
    while (depth >= 0) {
        int32_t child;
        int k = next[depth]++;
        if (k >= PANDIS__WIDTH) {
            depth--;
            continue;
        }
        if (!child_of(tree, path[depth], k, &child)) continue;
        if (child < 0) {
            if (~child != leaves || leaves >= leaf_count) return 0;
            leaves++;
        } else {
            if (child != nodes || nodes >= node_count || depth + 1 >= PANDIS__DEEPEST) return 0;
            nodes++, depth++;
            path[depth] = child, next[depth] = 0;
        }
    }
    return nodes == node_count && leaves == leaf_count;
}

static int pandis__node_child(const void *nodes, int32_t node, int place, int32_t *child) {
    const pandis__node *n = (const pandis__node *)nodes + node;
    *child = n->child[place];
    return !(n->low[0][place] > n->high[0][place]);
}

static int pandis__branch_child(const void *nodes, int32_t node, int place, int32_t *child) {
    const pandis__branch *b = (const pandis__branch *)nodes + node;
    *child = b->child[place];
    return place < b->count;
}

/* Open the slabs of a mesh's nodes, whose normals must not be longer than 1. */
PANDIS__ONCE static int pandis__open_slabs(pandis_field *f) {
    pandis__mesh *m = &f->as.mesh;
    m->slabs = (const pandis__slabs *)pandis__section(
        f, "SLAB", (uint64_t)m->node_count, sizeof(pandis__slabs));
    if (!m->slabs) return 0;
    for (int32_t i = 0; i < m->node_count; i++)
        for (int k = 0; k < PANDIS__WIDTH; k++) {
            const pandis__slabs *s = m->slabs + i;
            float x = s->normal[0][k], y = s->normal[1][k], z = s->normal[2][k];
            if (!(x * x + y * y + z * z <= 1 && s->low[k] <= s->high[k])) return 0;
        }
    return 1;
}

/* Open a mesh; every index must be valid. */
PANDIS__ONCE static int pandis__open_mesh(pandis_field *f) {
    pandis__mesh *m = &f->as.mesh;
    m->vertex_count = pandis__whole(f, 0), m->face_count = pandis__whole(f, 1);
    m->node_count = pandis__whole(f, 2), m->leaf_count = pandis__whole(f, 3);
    m->reach = pandis__real(f, 0);
    int32_t most = pandis__whole(f, 4);
    if (most < 0 || (most > 0 && most < 9)) return 0; /* enough for a leaf and all its faces */
    m->most = most ? most : INT32_MAX;
    if (m->vertex_count < 3 || m->face_count < 1 || m->node_count < 1 || m->leaf_count < 1)
        return 0;
    if (!(m->reach >= 0 && m->reach <= 1e30)) return 0;
    uint64_t v = (uint64_t)m->vertex_count, t = (uint64_t)m->face_count;
    m->vertices = (const double *)pandis__section(f, "VERT", 3 * v, sizeof(double));
    m->vertex_normals = (const double *)pandis__section(f, "VNRM", 3 * v, sizeof(double));
    m->faces = (const int32_t *)pandis__section(f, "FACE", 3 * t, sizeof(int32_t));
    m->neighbours = (const int32_t *)pandis__section(f, "NEIG", 3 * t, sizeof(int32_t));
    m->nodes = (const pandis__node *)pandis__section(
        f, "TREE", (uint64_t)m->node_count, sizeof(pandis__node));
    m->leaves = (const pandis__leaf *)pandis__section(
        f, "LEAF", (uint64_t)m->leaf_count, sizeof(pandis__leaf));
    if (!m->faces || !m->neighbours || !m->nodes || !m->leaves) return 0;
    if (!pandis__finite64(m->vertices, 3 * v) || !pandis__finite64(m->vertex_normals, 3 * v))
        return 0;
    for (uint64_t i = 0; i < 3 * t; i++)
        if (m->faces[i] < 0 || m->faces[i] >= m->vertex_count || m->neighbours[i] < -1 ||
            m->neighbours[i] >= m->face_count)
            return 0;
    for (int32_t i = 0; i < m->leaf_count; i++) {
        const pandis__leaf *leaf = m->leaves + i;
        for (int k = 0; k < PANDIS__WIDTH; k++)
            if (leaf->face[k] < (k ? -1 : 0) || leaf->face[k] >= m->face_count) return 0;
        if (!pandis__finite(leaf->origin, 3) || !(leaf->step > 0 && leaf->step <= 1e30f)) return 0;
        if (!(leaf->slack >= 0 && leaf->slack <= 1e30f && leaf->share >= 0 && leaf->share < 0.5f))
            return 0;
    }
    if (pandis__has_section(f, "SLAB") && !pandis__open_slabs(f)) return 0;
    return pandis__walk(m->nodes, pandis__node_child, m->node_count, m->leaf_count);
}

/* Check that a block is within its section, and that its faces refer to its own corners. */
static int pandis__good_block(const pandis__compact *t, int32_t block, uint64_t size) {
    pandis__packed b;
    const pandis__block_record *record = t->blocks + block;
    if (record->start > size || record->counts >> 28 || record->origin >> 63) return 0;
    uint64_t faces = (record->counts & 63) + 1, corners = (record->counts >> 6 & 63) + 1, bits = 0;
    uint64_t groups = (faces + PANDIS__WIDTH - 1) / PANDIS__WIDTH;
    for (int k = 0; k < 3; k++) {
        uint32_t own = record->counts >> (12 + 5 * k) & 31;
        if (own > PANDIS__MOST_BITS + 1 || record->origin >> (21 * k + PANDIS__MOST_BITS) & 1)
            return 0;
        bits += own;
    }
    uint64_t bytes = 6 * PANDIS__WIDTH + PANDIS__GROUP_BYTES * groups + (bits / 8 + 1) * corners;
    if (record->counts >> 27) bytes += (corners + 3) / 4 + 8 * groups;
    if (bytes + PANDIS__SLACK > size - record->start) return 0;
    pandis__unpack(t, block, &b);
    for (int i = 0; i < 3 * b.groups; i++) {
        uint64_t codes = pandis__six_bits(b.faces + 6 * i);
        for (int k = 0; k < PANDIS__WIDTH; k++)
            if ((int)(codes >> 6 * k & 63) >= b.corner_count) return 0;
    }
    return 1;
}

/* Open the list of original faces, which needs an entry for every face of every block. */
PANDIS__ONCE static int pandis__open_originals(pandis_field *f) {
    pandis__compact *t = &f->as.compact;
    const int32_t *original = (const int32_t *)pandis__section(
        f, "ORIG", (uint64_t)t->block_count * PANDIS__BLOCK, sizeof(int32_t));
    if (!original) return 0;
    for (int32_t i = 0; i < t->block_count; i++)
        for (int k = 0; k < PANDIS__BLOCK; k++) {
            int used = k <= (int)(t->blocks[i].counts & 63);
            int32_t face = original[(ptrdiff_t)i * PANDIS__BLOCK + k];
            if (used ? face < 0 : face != -1) return 0;
        }
    t->original = original;
    return 1;
}

PANDIS__ONCE static int pandis__open_compact(pandis_field *f) {
    pandis__compact *t = &f->as.compact;
    t->bits = pandis__whole(f, 0), t->branch_count = pandis__whole(f, 1),
    t->block_count = pandis__whole(f, 2);
    t->reach = pandis__real(f, 0);
    if (t->bits < 4 || t->bits > PANDIS__MOST_BITS || t->branch_count < 1 || t->block_count < 1)
        return 0;
    if (t->block_count > INT32_MAX / PANDIS__BLOCK - 1 || !(t->reach >= 0 && t->reach <= 1))
        return 0;
    int32_t most = pandis__whole(f, 4);
    if (most < 0 || (most > 0 && most < 9)) return 0; /* enough for a block and all its groups */
    t->most = most ? most : INT32_MAX;
    t->step = 2 * PANDIS__HALF / ((1 << t->bits) - 1);
    uint64_t size = (uint64_t)(uint32_t)pandis__whole(f, 3);
    t->branches = (const pandis__branch *)pandis__section(
        f, "BRCH", (uint64_t)t->branch_count, sizeof(pandis__branch));
    t->blocks = (const pandis__block_record *)pandis__section(
        f, "BLCK", (uint64_t)t->block_count, sizeof(pandis__block_record));
    t->packed = (const unsigned char *)pandis__section(f, "PACK", size, 1);
    if (!t->branches || !t->blocks || !t->packed) return 0;
    for (int32_t i = 0; i < t->branch_count; i++) {
        const pandis__branch *b = t->branches + i;
        if (b->count < 1 || b->count > PANDIS__WIDTH) return 0;
        for (int k = 0; k < 3; k++)
            if (b->shift[k] > PANDIS__MOST_BITS || b->origin[k] < 0 ||
                b->origin[k] >> PANDIS__MOST_BITS)
                return 0;
    }
    for (int32_t i = 0; i < t->block_count; i++)
        if (!pandis__good_block(t, i, size)) return 0;
    if (pandis__has_section(f, "ORIG") && !pandis__open_originals(f)) return 0;
    return pandis__walk(t->branches, pandis__branch_child, t->branch_count, t->block_count);
}

/* Pairs of faces that meet, or of points that are close: a part of faces.c.
 *
 * A binary tree of boxes, split at the median along the longest side. Points are treated as faces
 * with a box around them. */

#define IN_LEAF 4

typedef struct {
    double low[3], high[3];
} Box;

typedef struct {
    Box box;
    int32_t face;
} Item;

typedef struct {
    Box box;
    int32_t first, count; /* of a leaf's items; count is 0 otherwise */
    int32_t right;        /* the left child comes next */
    int32_t question;     /* whether any face is in question */
} Node;

typedef struct {
    const double *places;
    const int32_t *faces;    /* NULL: points that are at most `reach` apart are searched for */
    const uint8_t *question; /* per face; NULL: all are */
    double reach, rounding;
    Item *items; /* sorted by the tree, so that neighbours are near in memory */
    Node *nodes;
    int32_t node_count;
    int32_t *pairs;
    int64_t pair_count, room;
    int short_of_memory;
} Search;

static int overlap(const Box *a, const Box *b) {
    for (int k = 0; k < 3; k++)
        if (a->low[k] > b->high[k] || b->low[k] > a->high[k]) return 0;
    return 1;
}

static Box box_of(const Search *s, int32_t face) {
    Box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int k = 0; k < 3 && !s->faces; k++) {
        double x = s->places[3 * (ptrdiff_t)face + k];
        box.low[k] = x - s->reach, box.high[k] = x + s->reach;
    }
    for (int i = 0; i < 3 && s->faces; i++)
        for (int k = 0; k < 3; k++) {
            double x = s->places[3 * (ptrdiff_t)s->faces[3 * (ptrdiff_t)face + i] + k];
            box.low[k] = least(box.low[k], x), box.high[k] = most(box.high[k], x);
        }
    return box;
}

static double middle(const Search *s, int32_t slot, int axis) {
    return s->items[slot].box.low[axis] + s->items[slot].box.high[axis];
}

/* Sort items low to high - 1 so far that those before `half` are not beyond it (Hoare 1961). */
static void split_at(Search *s, int32_t low, int32_t high, int32_t half, int axis) {
    while (high - low > 1) {
        double pivot = middle(s, low + (high - low) / 2, axis);
        int32_t i = low, j = high - 1;
        while (i <= j) {
            while (middle(s, i, axis) < pivot) i++;
            while (middle(s, j, axis) > pivot) j--;
            if (i > j) break;
            Item other = s->items[i];
            s->items[i++] = s->items[j], s->items[j--] = other;
        }
        if (half <= j) high = j + 1;
        else if (half >= i) low = i;
        else return;
    }
}

/* Build the tree over items first to first + count - 1. */
static void build(Search *s, int32_t first, int32_t count) {
    int32_t index = s->node_count++;
    Node *node = s->nodes + index;
    *node = (Node){.box = s->items[first].box};
    Box middles = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int32_t i = first; i < first + count; i++) {
        const Box *box = &s->items[i].box;
        for (int k = 0; k < 3; k++) {
            double x = box->low[k] + box->high[k];
            node->box.low[k] = least(node->box.low[k], box->low[k]);
            node->box.high[k] = most(node->box.high[k], box->high[k]);
            middles.low[k] = least(middles.low[k], x), middles.high[k] = most(middles.high[k], x);
        }
        node->question |= !s->question || s->question[s->items[i].face];
    }
    if (count <= IN_LEAF) {
        node->first = first, node->count = count;
        return;
    }
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (middles.high[k] - middles.low[k] > middles.high[axis] - middles.low[axis]) axis = k;
    split_at(s, first, first + count, first + count / 2, axis);
    build(s, first, count / 2);
    node->right = s->node_count;
    build(s, first + count / 2, count - count / 2);
}

static void add_pair(Search *s, int32_t f, int32_t g) {
    if (s->pair_count == s->room) {
        int64_t room = s->room ? 2 * s->room : 256;
        int32_t *pairs = realloc(s->pairs, (size_t)room * 2 * sizeof *pairs);
        s->short_of_memory |= !pairs;
        if (!pairs) return;
        s->pairs = pairs, s->room = room;
    }
    s->pairs[2 * s->pair_count] = f < g ? f : g;
    s->pairs[2 * s->pair_count++ + 1] = f < g ? g : f;
}

static int points_close(const Search *s, int32_t f, int32_t g) {
    const double *p = s->places + 3 * (ptrdiff_t)f, *q = s->places + 3 * (ptrdiff_t)g;
    double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
    return x * x + y * y + z * z <= s->reach * s->reach;
}

static void try_pair(Search *s, const Item *one, const Item *other) {
    int32_t f = one->face, g = other->face;
    if (!overlap(&one->box, &other->box)) return;
    if (s->question && !s->question[f] && !s->question[g]) return;
    int meet = s->faces ? faces_meet(s->places, s->faces + 3 * (ptrdiff_t)f,
                              s->faces + 3 * (ptrdiff_t)g, s->rounding)
                        : points_close(s, f, g);
    if (meet) add_pair(s, f, g);
}

/* Try the faces of one node with those of another. */
static void try_nodes(Search *s, const Node *a, const Node *b) {
    if (!(a->question || b->question) || s->short_of_memory || !overlap(&a->box, &b->box)) return;
    if (a->count && b->count) {
        for (int32_t i = 0; i < a->count; i++)
            for (int32_t j = 0; j < b->count; j++)
                try_pair(s, s->items + a->first + i, s->items + b->first + j);
    } else if (b->count || (!a->count && a->right - (a - s->nodes) > b->right - (b - s->nodes))) {
        try_nodes(s, a + 1, b), try_nodes(s, s->nodes + a->right, b);
    } else {
        try_nodes(s, a, b + 1), try_nodes(s, a, s->nodes + b->right);
    }
}

/* Try the faces of a node with each other. */
static void try_within(Search *s, const Node *node) {
    if (!node->question || s->short_of_memory) return;
    if (!node->count) {
        try_within(s, node + 1), try_within(s, s->nodes + node->right);
        try_nodes(s, node + 1, s->nodes + node->right);
        return;
    }
    for (int32_t i = 0; i < node->count; i++)
        for (int32_t j = i + 1; j < node->count; j++)
            try_pair(s, s->items + node->first + i, s->items + node->first + j);
}

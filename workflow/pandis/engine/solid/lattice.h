/* The lattice and its arrays: a part of solid.c. */

/* A place where a triangle cuts the edge from a node to its next along an axis. */
typedef struct {
    int64_t edge; /* 3 node + axis */
    double at;    /* 0 at the node, 1 at the next */
    int32_t triangle;
} Cut;

/* The nearest point of the surface to some nodes. */
typedef struct {
    float place[3], distance;
    uint8_t rim; /* whether it lies on an open edge */
} Foot;

/* Where a vertex of the result comes from. */
enum { ON_SURFACE, ON_CAP, ON_DOOR, ON_SHEET, AT_CORNER };

typedef struct {
    int32_t triangle; /* that cuts its edge, or -1 */
    int32_t room;     /* of the node inside */
    uint8_t origin;
} Vertex;

typedef struct {
    int32_t corner[3];
} Face;

/* Lengths are in cells: nodes lie at whole numbers. */
typedef struct {
    int32_t size[3];
    int64_t step[3], nodes;
    const double *corners;   /* (triangles, 3, 3) */
    const uint8_t *open;     /* per triangle: bit k if the edge from corner k to k + 1 is open */
    int64_t triangles, caps; /* the caps come last: they block, and are no surface */
    int64_t strips;          /* the last caps, which continue faces a little beyond open edges */

    uint8_t *blocked; /* per node: bits 0 to 2 if a triangle cuts the edge along x, y, z */
    Cut *cuts;        /* in order */
    int64_t cut_count, cut_room;

    int32_t *nearest; /* per node: index of its foot, or -1; NULL until `find_feet` */
    Foot *feet;
    int64_t foot_count, foot_room;

    int32_t *room;   /* per node; 0 is the outside */
    int32_t *parent; /* per room: rooms that are one have one root */
    float *radius;   /* per room: of its largest ball, cells; 0 if not known */
    int64_t *middle; /* per room: a node far from its walls */
    int64_t room_count, room_room;

    uint8_t *inside; /* per node: 1 in a solid room, 2 in a sheet */
    Vertex *vertices;
    double *places; /* (vertices, 3) */
    int64_t vertex_count, vertex_room, place_room;
    Face *faces;
    int64_t face_count, face_room;
} Lattice;

#define CAP_BIT 8    /* in `blocked`: bits 3 to 5 if a cap cuts the edge */
#define PLACE_BIT 64 /* in `blocked`: a door can stand here */
#define SOLID 1
#define SHEET 2

/* Vertices lie at multiples of this fraction of a cell, so that a caller can place them without
 * rounding: after rounding, faces that share a plane could cross. */
#define FINENESS 268435456.0

/* The larger of two numbers that are not NaN. A compiler inlines it, unlike fmax. */
static double larger(double a, double b) { return a > b ? a : b; }

static double rounded(double along) { return floor(along * FINENESS + 0.5) / FINENESS; }

static int64_t node_at(const Lattice *l, int32_t x, int32_t y, int32_t z) {
    return x + l->step[1] * y + l->step[2] * z;
}

static void place_of(const Lattice *l, int64_t node, int32_t *at) {
    at[0] = (int32_t)(node % l->size[0]);
    at[1] = (int32_t)(node / l->step[1] % l->size[1]);
    at[2] = (int32_t)(node / l->step[2]);
}

static int is_blocked(const Lattice *l, int64_t node, int axis) {
    return l->blocked[node] & ((1 | CAP_BIT) << axis);
}

/* Find the neighbour of a node in direction 0 to 5; returns 0 if there is none, or a wall. */
static int way_to(const Lattice *l, int64_t node, int direction, int64_t *next) {
    int32_t at[3];
    int axis = direction / 2;
    place_of(l, node, at);
    if (direction % 2) {
        *next = node + l->step[axis];
        return at[axis] < l->size[axis] - 1 && !is_blocked(l, node, axis);
    }
    *next = node - l->step[axis];
    return at[axis] > 0 && !is_blocked(l, *next, axis);
}

/* Make room for one more element; returns 0 if memory is short. */
static int grow(void *array, int64_t count, int64_t *room, size_t bytes) {
    if (count < *room) return 1;
    int64_t more = 2 * *room + 4096;
    void *larger = realloc(*(void **)array, (size_t)more * bytes);
    if (!larger) return 0;
    *(void **)array = larger;
    *room = more;
    return 1;
}

static void corners_of(const Lattice *l, int64_t triangle, const double **c) {
    for (int k = 0; k < 3; k++) c[k] = l->corners + 9 * triangle + 3 * k;
}

/* The unit normal of a triangle; 0 if it has no area. */
static void normal_of(const Lattice *l, int64_t triangle, double *n) {
    const double *c[3];
    double u[3], v[3];
    corners_of(l, triangle, c);
    for (int k = 0; k < 3; k++) u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k];
    cross(u, v, n);
    (void)normalise(n);
}

/* How reliable an answer is. */
typedef enum {
    PANDIS_OK = 0, /* within the accuracy of the field */
    /* outside what the field covers: the side is right, but the distance is an estimate, maybe too
       large */
    PANDIS_BOUND = 1,
    /* no answer: an argument is out of range or not finite, or the field overflowed */
    PANDIS_INVALID = 2,
    /* the search was cut short: too many faces are about equally near (around the middle of a
       finely tessellated ball). The distance may be too large, by some hundredths of the object's
       size: see pandis_answer.clear. When the file was made, no query at test points next to the
       surface was cut short */
    PANDIS_CUT = 3,
    PANDIS_BEYOND = 4 /* pandis_query_within only: no surface is within its reach */
} pandis_flag;

/* Reasons why something cannot be opened or changed. Errors are negative and flags are not, so they
 * cannot be confused. */
typedef enum {
    PANDIS_SUCCESS = 0,
    PANDIS_ERROR_FILE = -1,   /* the file cannot be read */
    PANDIS_ERROR_FORMAT = -2, /* not a .pandis file */
    PANDIS_ERROR_ENDIAN = -3, /* wrong byte order, of the file or of this machine */
    /* the file has a later version, or is a mesh of an earlier one */
    PANDIS_ERROR_VERSION = -4,
    PANDIS_ERROR_SIZE = -5,     /* the file is shorter or longer than its header states */
    PANDIS_ERROR_CHECKSUM = -6, /* the bytes of the file have changed */
    /* inconsistent content, or an operation that this kind of field does not support */
    PANDIS_ERROR_CONTENT = -7,
    PANDIS_ERROR_POSE = -8,        /* an object or a pose is invalid: see pandis_object */
    PANDIS_ERROR_ALIGNMENT = -9,   /* the bytes do not begin at a multiple of 8 */
    PANDIS_ERROR_ARITHMETIC = -10, /* compiled with flags that would make results wrong */
    PANDIS_ERROR_LARGE = -11,      /* a network beyond PANDIS_MOST_WIDTH or PANDIS_MOST_DEPTH */
    /* a vertex of a new shape is not finite, or beyond 1e30 in the unit frame */
    PANDIS_ERROR_VERTEX = -12,
    /* a grid of forces cannot have a contact: it has no distances outside */
    PANDIS_ERROR_KIND = -13,
    /* the probe is larger than the free space known around the field's surface */
    PANDIS_ERROR_RADIUS = -14,
    /* a contact option is out of range: see pandis_contact_options */
    PANDIS_ERROR_OPTIONS = -15,
    PANDIS_ERROR_COUNT = -16, /* an array is shorter or longer than required */
    /* the implementation was compiled with another version of this header, or packs structures
       differently */
    PANDIS_ERROR_HEADER = -17
} pandis_error;

/* The kind of a field. */
typedef enum {
    PANDIS_CLOSED = 0,
    PANDIS_NETWORK = 1,
    PANDIS_GRID = 2,
    PANDIS_SPLINE = 3,
    PANDIS_MESH = 4,
    PANDIS_SHAPE = 5,
    PANDIS_COMPACT = 6
} pandis_kind;

/* The answer at a point. */
typedef struct {
    double distance;  /* mesh units, negative inside */
    double normal[3]; /* outward, of unit length */
    /* length of the vector that was normalised: 1 for meshes and closed forms; elsewhere about 1,
     * but clearly less near the medial axis, where two walls are about equally near and the normal
     * is about to flip; 0 for grids of forces, which have no distance outside */
    double slope;
    /* for meshes a lower bound of the distance to the surface, up to rounding; else |distance| */
    double clear;
    pandis_flag flag;
    /* index, in mesh.zarr.zip, of a face that contains the closest point. For a simplified mesh,
     * it is a face at or next to that point. -1 if unknown: only `exact` meshes, and compact ones
     * with a section ORIG, store face indices */
    int32_t face;
    int32_t region; /* material of the surface there (pandis_region); -1 if the file has none */
} pandis_answer;

/* The structures below are internal: read them, but do not rely on them. */
typedef struct {
    int32_t size; /* nodes per axis */
    double low, per_step;
    const float *values;
} pandis__lattice;

typedef struct {
    int32_t width, depth, outputs, stride;
    const float *first, *last, *biases, *scales, *hidden;
    const int16_t *hidden16; /* instead of hidden, scaled by scales */
    pandis__lattice base;    /* size 0: none */
} pandis__network;

typedef struct {
    int32_t rule, size, channels;
    double low[3], high[3], per_step[3]; /* first and last node, nodes per length */
    const float *nodes;
    const uint8_t *covered;
    pandis__lattice cubic;
} pandis__grid;

typedef struct {
    int32_t size, bricks;  /* nodes and bricks per axis */
    double low, per_step;  /* position of node 0, nodes per length */
    const uint16_t *brick; /* for each position: its stored brick, or 65535 */
    const uint64_t *mask;  /* for each stored brick: a bit for each stored block */
    const uint32_t *base;  /* for each stored brick: number of blocks before it */
} pandis__layout;

typedef struct {
    pandis__layout layout[2];
    int32_t far_size;
    double far_low, far_per_step, offset[3], scale[3], inside, outside;
    /* coefficients (offset + scale * stored value): in the band, and beyond it */
    const int16_t *coarse, *far;
    const int8_t *fine;  /* correction that is added in the band */
    const uint8_t *side; /* for each block of coarse lattice cells: whether it is outside */
} pandis__spline;

/* Cache of a spline's coefficients around recent points. An entry has its first node, 64
 * coefficients, and the result of pandis__collect plus one (0: empty). The coarse and the fine
 * lattice have a cube of 8 x 8 x 8 entries each. */
typedef struct {
    struct {
        int first[3], known;
        float c[64];
    } cell[2][512];
} pandis__cells;

#define PANDIS__WIDTH 8

typedef struct {
    float low[3][PANDIS__WIDTH], high[3][PANDIS__WIDTH];
    int32_t child[PANDIS__WIDTH]; /* a node if >= 0, else the complement of a leaf */
} pandis__node;

/* For each child of a node, two parallel planes with all of its faces between them: low <=
 * normal . x <= high. A normal is at most of unit length. Where faces bend little, these planes say
 * more than a box. */
typedef struct {
    float normal[3][PANDIS__WIDTH], low[PANDIS__WIDTH], high[PANDIS__WIDTH];
} pandis__slabs;

/* Up to eight triangles, rounded: a coordinate is origin + corner * step. They are used to find, in
 * single precision, the triangles that may be nearest. A distance d is too large by at most slack +
 * share * d. */
typedef struct {
    /* corner, axis, triangle; unused places repeat the first */
    uint16_t corner[3][3][PANDIS__WIDTH];
    int32_t face[PANDIS__WIDTH];         /* -1: unused */
    float origin[3], step, slack, share; /* of the unit frame; the step is a power of two */
} pandis__leaf;

typedef struct {
    int32_t vertex_count, face_count, node_count, leaf_count;
    int32_t most; /* budget of a query: nodes, leaves and faces */
    double reach; /* largest coordinate */
    const double *vertices;
    const int32_t *faces;
    /* (F, 3): the face across the edge from corner k to k + 1, or -1 */
    const int32_t *neighbours;
    const double *vertex_normals; /* (V, 3), angle-weighted, unit */
    const pandis__node *nodes;
    const pandis__leaf *leaves;
    const pandis__slabs *slabs; /* of each node's children; NULL: none */
    /* for a mesh that moves: for each vertex, the face corners at it */
    const int32_t *around, *corners_at;
    const float (*slacks)[2]; /* likewise: slack and share of each leaf */
} pandis__mesh;

/* Eight boxes around parts of a mesh, in steps of its lattice: from origin + (low << shift) to
 * origin + (high << shift). */
typedef struct {
    int32_t origin[3];
    uint8_t shift[3], count;
    uint8_t boxes[6][PANDIS__WIDTH]; /* low x, y, z, then high */
    int32_t child[PANDIS__WIDTH];    /* a branch if >= 0, else the complement of a block */
} pandis__branch;

/* Position of a block of faces in the section of blocks and in space. origin: 21 bits an axis.
 * counts: faces less one, corners less one (6 bits each), and the bits that its extents need (5
 * each). */
typedef struct {
    uint32_t start, counts;
    uint64_t origin;
} pandis__block_record;

typedef struct {
    int32_t bits, branch_count, block_count;
    int32_t most;       /* budget of a query: groups of faces, and blocks */
    double step, reach; /* step of the lattice and largest coordinate, unit frame */
    const pandis__branch *branches;
    const pandis__block_record *blocks;
    const unsigned char *packed;
    /* for each place of each block: a face of mesh.zarr.zip; NULL: unknown */
    const int32_t *original;
} pandis__compact;

typedef struct {
    int32_t shape;
    double size[3];
} pandis__shape;

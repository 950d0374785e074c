/* pandis.h: distance, normal and contact force of an object, for haptic loops.
 *
 * One header, one file per object, no library except libm, no allocation and no system call per
 * query:
 *
 *     #define PANDIS_IMPLEMENTATION            in one source file, before
 *     #include "pandis.h"
 *
 *     pandis_field bunny;
 *     pandis_error error = pandis_open_file(&bunny, "bunny.pandis");
 *     if (error) return puts(pandis_error_text(error));
 *     ...
 *     double force[3];                         every millisecond
 *     pandis_force(&bunny, position, stiffness, force);
 *     ...
 *     pandis_close(&bunny);
 *
 * Several objects; only those that the probe may touch are queried:
 *
 *     pandis_object objects[2] = {...};        fields and their poses
 *     static double room[PANDIS_SCENE_ROOM(2)];
 *     pandis_scene scene;
 *     error = pandis_scene_open(&scene, objects, 2, room, PANDIS_SCENE_ROOM(2));
 *     pandis_scene_force(&scene, position, force);
 *
 * Positions and distances are in the units of the mesh that the field was made from; distances are
 * negative inside, normals point outward and have unit length. Queries do not change a field: any
 * number of threads may query it. The file format is described in docs/format.md of pandis.
 *
 * C99 or later, or C++11 or later. No flags are needed: with -O2 alone it is about as fast as with
 * -O3 -march=native, since GCC and clang also compile the hot functions for AVX2, which is used on
 * x86-64 machines that have it (not on Windows; PANDIS_NO_DISPATCH disables this). Results are
 * bit-identical for all compilers, machines and vector widths (except clang with
 * -ffp-contract=fast). With -ffast-math or x87 arithmetic it does not compile, because answers
 * would be wrong. pandis_open tests for options of -ffast-math that define no macro. A query needs
 * at most 8 KB of stack, or 80 KB for a network. With a smaller PANDIS_MOST_WIDTH and
 * PANDIS_MOST_DEPTH (by default 1024 and 16), a network needs four bytes times (depth + 2) times
 * width. Define PANDIS_API as `static inline` to keep the names to one source file, and
 * PANDIS_NO_FILE to leave out the functions that open files.
 *
 * For a real-time loop: open fields before the loop (a file is read and checked, which
 * takes 4 ms per megabyte), lock the process's memory (mlockall(MCL_CURRENT | MCL_FUTURE); on
 * Windows raise the working set with SetProcessWorkingSetSize and VirtualLock the bytes given to
 * pandis_open), query every field at a few points, so that its pages are loaded and the caches
 * filled, and set a real-time priority for the thread (SCHED_FIFO). A query allocates nothing,
 * locks nothing and makes no system call. Its time hardly depends on the position, except for
 * meshes: where very many faces are about equally near (the middle of a finely tessellated ball), a
 * query can take some hundreds of times as long as usual. It is cut short after a limited number
 * of steps, which depends on the file: see PANDIS_CUT.
 *
 * This header comes from pandis, a workflow that makes, measures and exports distance fields of
 * triangle meshes for haptic rendering. The header needs nothing else from it.
 *
 * MIT License. Copyright (c) 2026 The pandis authors
 *
 * Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
 * associated documentation files (the "Software"), to deal in the Software without restriction,
 * including without limitation the rights to use, copy, modify, merge, publish, distribute,
 * sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
 * furnished to do so, subject to the following conditions:
 *
 * The above copyright notice and this permission notice shall be included in all copies or
 * substantial portions of the Software.
 *
 * THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
 * NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
 * NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM,
 * DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
 * OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
 */
#ifndef PANDIS_H
#define PANDIS_H

#include <stddef.h>
#include <stdint.h>

/* Version of this header; a file contains its format version (PANDIS_FORMAT_VERSION). */
#define PANDIS_VERSION_MAJOR 0
#define PANDIS_VERSION_MINOR 2
#define PANDIS_VERSION_PATCH 0
#define PANDIS_VERSION "0.2.0"
#define PANDIS_FORMAT_VERSION 4

#ifdef __cplusplus
extern "C" {
#endif

#ifndef PANDIS_API
#define PANDIS_API extern
#endif
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
typedef struct { /* internal except for its size: use the functions below */
    const unsigned char *data;
    size_t size;
    int kind, mapped;
    double centre[3], scale;                   /* of the unit frame: u = (p - centre) * scale */
    double low[3], high[3], margin[2], height; /* see pandis__measure; unit frame */
    const uint8_t *regions; /* one per face, in the field's own order; NULL: unknown */
    union {
        pandis__network network;
        pandis__grid grid;
        pandis__spline spline;
        pandis__mesh mesh;
        pandis__compact compact;
        pandis__shape shape;
    } as;
} pandis_field;

/* -------------------- versions and errors
 *
 * Functions marked [rt] may be called in a real-time loop: they allocate nothing, lock nothing and
 * make no system call. Call all others before the loop. */

/* [rt] The version of the compiled implementation; PANDIS_VERSION is that of this header. */
PANDIS_API const char *pandis_version(void);

/* Check that the compiled implementation has the version and the structures of this header. Call it
 * once if the two are compiled separately. Returns PANDIS_SUCCESS or PANDIS_ERROR_HEADER. */
#define PANDIS_CHECK()                                                                             \
    pandis__check(PANDIS_VERSION, sizeof(pandis_field), sizeof(pandis_contact_options),            \
        sizeof(pandis_touch))
PANDIS_API pandis_error pandis__check(
    const char *version, size_t field, size_t options, size_t touch);

/* [rt] The meaning of an error, as a phrase in static memory. */
PANDIS_API const char *pandis_error_text(pandis_error error);

/* -------------------- fields */

/* Open a field from bytes. They are checked, so that no query reads outside them.
 *
 * field    filled in; closed on error
 * data     kept by the caller until the field is closed; aligned to 8 bytes
 *          (in C11: _Alignas(8) on an array)
 * size     of the data, bytes */
PANDIS_API pandis_error pandis_open(pandis_field *field, const void *data, size_t size);

#ifndef PANDIS_NO_FILE
/* Open a file by reading it into memory. With PANDIS_MMAP defined it is mapped instead (not on
 * Windows), and must not be overwritten while it is open. The path is UTF-8, also on Windows. */
PANDIS_API pandis_error pandis_open_file(pandis_field *field, const char *path);
#endif

/* Close a field; closing it again does nothing. No other thread may still use it. */
PANDIS_API void pandis_close(pandis_field *field);

/* [rt] The kind of a field: PANDIS_CLOSED after pandis_close. */
PANDIS_API pandis_kind pandis_field_kind(const pandis_field *field);

/* [rt] The size of the field's file, bytes. */
PANDIS_API size_t pandis_bytes(const pandis_field *field);

/* [rt] A box around the surface, mesh units. If the file does not store it, the box contains the
 * whole region that the field covers. */
PANDIS_API void pandis_bounds(const pandis_field *field, double low[3], double high[3]);

/* [rt] The length of the longest side of the mesh that the field was made from, mesh units. */
PANDIS_API double pandis_longest_side(const pandis_field *field);

/* [rt] The name of a region (pandis_answer.region): that of its faces' material in the mesh file.
 * NULL if there is no such region. */
PANDIS_API const char *pandis_region(const pandis_field *field, int region);

/* [rt] The provenance of the field: JSON of `*size` bytes, not zero-terminated and valid while the
 * field is open; NULL if there is none. */
PANDIS_API const char *pandis_provenance(const pandis_field *field, size_t *size);

/* [rt] Query one point. If there is no answer (PANDIS_INVALID: a coordinate is not finite, or
 * beyond 1e150), distance, normal and slope are NaN.
 *
 * point    mesh units */
PANDIS_API void pandis_query(
    const pandis_field *field, const double point[3], pandis_answer *answer);

/* [rt] Query one point as pandis_query does, bit for bit, if the surface is nearer than a reach
 * (but a search with a reach may come to its end where the other is cut: PANDIS_CUT). Else the flag
 * may be PANDIS_BEYOND: no surface is nearer than answer->clear, which is the reach (or less, if
 * the search was cut short); the side is unknown, and distance, normal and slope are NaN. For
 * meshes this takes a few box tests at any distance. For other fields, and for a negative or NaN
 * reach, the result is that of pandis_query.
 *
 * point    mesh units
 * reach    mesh units, from 0 on */
PANDIS_API void pandis_query_within(
    const pandis_field *field, const double point[3], double reach, pandis_answer *answer);

/* [rt] The distance alone (mesh units; NaN without an answer) and its flag, bit for bit as
 * pandis_query returns them. For a network whose normal is its gradient, this takes less than half
 * the time; otherwise the same time. */
PANDIS_API pandis_flag pandis_distance(
    const pandis_field *field, const double point[3], double *distance);

/* [rt] The gradient of the distance, and its second derivatives (per mesh unit), row by row. For
 * meshes and closed forms, they are those of the distance to the nearest feature: the second
 * derivatives are 0 next to a face, and those of a round surface next to an edge or a corner. For
 * splines and grids of distances, they follow from the formula. For networks, and where a spline or
 * a grid has no formula (as where the flag is PANDIS_BOUND), they are finite differences over a few
 * thousandths of the object or less. At a crease they are those of one side. Where there is no
 * answer, and for grids of forces, they are NaN and the flag is PANDIS_INVALID. */
PANDIS_API pandis_flag pandis_derivatives(
    const pandis_field *field, const double point[3], double gradient[3], double hessian[9]);

/* [rt] The penalty force -stiffness * min(distance, 0) * normal: zero outside, and where there is
 * no answer.
 *
 * point      mesh units
 * stiffness  force per mesh unit, from 0 to 1e100; else PANDIS_INVALID, and no force */
PANDIS_API pandis_flag pandis_force(
    const pandis_field *field, const double point[3], double stiffness, double force[3]);

/* [rt] Query several points.
 *
 * points     3 * count doubles, mesh units
 * distances  count doubles
 * normals    3 * count doubles, or NULL
 * flags      count bytes, a pandis_flag each, or NULL */
PANDIS_API void pandis_query_many(const pandis_field *field, const double *points, size_t count,
    double *distances, double *normals, unsigned char *flags);

/* -------------------- meshes whose vertices move (`exact` fields alone) */

/* [rt] Number of vertices of a mesh, and bytes of memory that pandis_refit_open requires; both 0
 * for any other field. */
PANDIS_API size_t pandis_vertex_count(const pandis_field *field);
PANDIS_API size_t pandis_refit_room(const pandis_field *field);

/* Open a mesh field with the faces of another one, and with vertices that can move. The new field
 * need not be closed.
 *
 * moving   filled in
 * field    a mesh, which must stay open while `moving` is used
 * room     at least pandis_refit_room bytes of memory, aligned to 8 bytes, kept by the caller
 * size     of the room, bytes
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_CONTENT (not a mesh), PANDIS_ERROR_ALIGNMENT or
 * PANDIS_ERROR_COUNT (too little room). */
PANDIS_API pandis_error pandis_refit_open(
    pandis_field *moving, const pandis_field *field, void *room, size_t size);

/* [rt] Move the vertices. Distances are then bit for bit those of a newly built tree. The unit
 * frame does not change: points beyond its box are flagged PANDIS_BOUND. Then notify scenes
 * (pandis_scene_moved) and contacts (pandis_contact_reshaped). No other thread may use the field
 * during the call.
 *
 * vertices  3 * count doubles, mesh units, in the order of mesh.zarr.zip
 * count     pandis_vertex_count
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_VERTEX, PANDIS_ERROR_COUNT or PANDIS_ERROR_CONTENT; after an
 * error the old shape stays. */
PANDIS_API pandis_error pandis_refit(pandis_field *moving, const double *vertices, size_t count);

#if defined(__GNUC__) || defined(_MSC_VER)
/* A mesh that one thread moves while another queries it; neither waits. Of three shapes one is
 * written, one is queried, and the newest complete one is handed over. One thread calls _refit, the
 * other _take. The contents are internal. */
typedef union {
    double aligned;
    unsigned char bytes[3 * sizeof(pandis_field) + 16];
} pandis_handover;

/* [rt] Bytes for three shapes; 0: not a mesh. */
PANDIS_API size_t pandis_handover_room(const pandis_field *field);

/* Begin a handover. Arguments and errors as for pandis_refit_open; room has pandis_handover_room
 * bytes. */
PANDIS_API pandis_error pandis_handover_open(
    pandis_handover *handover, const pandis_field *field, void *room, size_t size);

/* [rt] Move the vertices, as pandis_refit does, and hand the shape over. */
PANDIS_API pandis_error pandis_handover_refit(
    pandis_handover *handover, const double *vertices, size_t count);

/* [rt] Set `moving` to the newest complete shape, at the beginning of a tick. The shape then
 * does not change until the next call. Returns 1 if the shape is new, as it is in the first call;
 * else 0. If 1 is returned, notify scenes (pandis_scene_moved) and contacts
 * (pandis_contact_reshaped). */
PANDIS_API int pandis_handover_take(pandis_handover *handover, pandis_field *moving);
#endif
/* -------------------- objects and what they feel like */

/* An object: a field and its pose. A point p of the mesh is at scale * rotation * p + translation
 * in the scene. */
typedef struct {
    const pandis_field *field; /* must stay open while the object is used */
    double rotation[9];        /* row by row; orthonormal within 1e-6, and no reflection */
    double translation[3];     /* scene lengths, at most 1e100 */
    double scale;              /* scene lengths per mesh unit, from 1e-100 to 1e100 */
    double stiffness;          /* force per scene length, from 0 to 1e100 */
} pandis_object;

/* [rt] The penalty force of one object.
 *
 * point    scene lengths
 * force    in scene coordinates */
PANDIS_API pandis_flag pandis_object_force(
    const pandis_object *object, const double point[3], double force[3]);

/* Properties of a surface, apart from the object's stiffness. All values are in units of the scene,
 * from 0 to 1e100; if all are zero, the surface is smooth. */
typedef struct {
    /* coefficient of static friction: the proxy stays up to this tangential force per normal force
     */
    double sticking;
    double sliding; /* coefficient of sliding friction, at most `sticking` */
    /* force per speed of the probe along the normal; it never pulls towards the surface */
    double damping;
    double drag; /* force per speed of the proxy along the surface */
} pandis_material;

/* A height above the surface, which a proxy feels. It is never negative, so walls are as tight as
 * without a texture. The proxy follows slopes up to about 0.65; on steeper ones it falls behind. */
typedef struct {
    /* returns the height, from 0 to `most`, at a point of the surface (mesh units) in a region
     * (pandis_answer), and sets its gradient, which is no longer than `steepest`. The loop calls
     * this function, so it must be [rt], too */
    double (*height)(const void *data, const double point[3], int region, double gradient[3]);
    const void *data; /* passed on to `height` */
    double most;      /* mesh units, from 0 on */
    double steepest;  /* from 0 to 15: steeper textures let a probe through thin walls */
} pandis_texture;

/* [rt] A height for textures: waves that vary along a direction of unit length. Their `steepest`
 * is 3.15 * height / length. */
typedef struct {
    double height, length, direction[3]; /* mesh units */
} pandis_ridges;
PANDIS_API double pandis_waves(
    const void *ridges, const double point[3], int region, double gradient[3]);

/* [rt] A height for textures: pseudorandom bumps, one per cube of side `length`. Their `steepest`
 * is 3.25 * height / length. */
typedef struct {
    double height, length; /* mesh units */
} pandis_bumps;
PANDIS_API double pandis_noise(
    const void *bumps, const double point[3], int region, double gradient[3]);

/* [rt] A texture for each region: `count` of them, in the order of the regions; if `height` is
 * NULL, the region is smooth. The first texture also applies to places without a region, or with a
 * region >= `count`, as with materials. The combined texture has pandis_by_region as its height,
 * and the largest `most` and `steepest` of them all. */
typedef struct {
    const pandis_texture *textures;
    int32_t count;
} pandis_patches;
PANDIS_API double pandis_by_region(
    const void *patches, const double point[3], int region, double gradient[3]);

/* -------------------- contacts
 *
 * The force on a probe that is kept out of an object. The proxy is a ball that never goes through
 * the surface. A spring connects it to the probe, which is at the device's position. A contact
 * belongs to one probe, one object and one thread. */

/* Options of a contact. Start from pandis_contact_defaults, and change only the values that should
 * differ. */
typedef struct {
    /* of the proxy, scene lengths; 0: a point. Up to 1e100 for meshes, compact meshes, closed forms
     * and networks; for splines and grids up to 0.95 of the height above the surface that they
     * cover (by default 1 mm for an object of 100 mm), else PANDIS_ERROR_RADIUS. Default 0 */
    double radius;
    /* largest excess of the proxy's speed over the probe's: scene lengths per second, at least 0.
     * It limits jumps of the force at ridges. Default: half the object's longest side */
    double slide;
    /* number of queries after which a step ends (a started look may add two, `regions` one, and a
     * step without an answer 130); the next step goes on from there. At least 8: with fewer, every
     * step would start over. Default 24 */
    int32_t budget;
    /* one per region, kept by the caller, who may change values between steps. The first also
     * applies to places with no region, or with one beyond the last. NULL: smooth */
    const pandis_material *materials;
    size_t material_count; /* 0: smooth */
    /* of the surface, kept by the caller; NULL, the default: none */
    const pandis_texture *texture;
    /* source of regions if the object's field has none: a mesh of the same object, which must stay
     * open; NULL, the default: none */
    const pandis_field *regions;
} pandis_contact_options;

/* [rt] The defaults for an object. */
PANDIS_API pandis_contact_options pandis_contact_defaults(const pandis_object *object);

/* The state of a contact, which may be copied. Its contents are internal. */
#define PANDIS_CONTACT_BYTES 1024
typedef union {
    double aligned;
    unsigned char bytes[PANDIS_CONTACT_BYTES];
} pandis_contact;

/* Bits of pandis_touch.state. */
typedef enum {
    PANDIS_TOUCHING = 1, /* the surface holds the proxy back */
    PANDIS_STICKING = 2, /* friction holds the proxy back, too */
    PANDIS_BEHIND = 4,   /* the budget or `slide` stopped the proxy short of its goal */
    /* the probe began inside and has not come out yet. The side it came from is unknown, so nothing
       pushes it out. It is held at its initial depth, or at the smallest depth since. Where the
       field has no distance that deep inside, there is no force until the probe is out */
    PANDIS_WAITING = 8
} pandis_touch_bits;

/* Result of a step, in units and directions of the scene. */
typedef struct {
    double force[3], proxy[3];
    /* of the surface against which the proxy is pressed, or of several surfaces combined; 0 if
     * there is none */
    double normal[3];
    double depth;     /* how far the probe is pressed past the proxy, along the normal */
    double slip;      /* how far the proxy slid along the surface */
    int state;        /* pandis_touch_bits */
    pandis_flag flag; /* the worst of the queries; PANDIS_INVALID: no force, and the proxy stays */
    /* number of planes that hold the proxy back: 1 on a face, 2 in an edge, 3 in a corner */
    int planes;
    int queries;    /* number of queries in this step */
    int32_t object; /* index of the object in a scene */
    /* index, in mesh.zarr.zip, of the face nearest to the proxy, if the field stores it: see
     * pandis_answer */
    int32_t face;
    int32_t region; /* region at the proxy, likewise */
} pandis_touch;

/* [rt] Begin a contact; the next step is its first.
 *
 * object   must have a field of distances, not a grid of forces (PANDIS_ERROR_KIND)
 * options  copied; NULL: the defaults
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_POSE, PANDIS_ERROR_KIND, PANDIS_ERROR_RADIUS or
 * PANDIS_ERROR_OPTIONS; after an error steps return PANDIS_INVALID. */
PANDIS_API pandis_error pandis_contact_open(
    pandis_contact *contact, const pandis_object *object, const pandis_contact_options *options);

/* [rt] Get or set the options of an open contact. New ones apply from the next step on; after an
 * error the old ones stay. A new radius moves the walls: for a scene's contact, call
 * pandis_scene_moved, too. */
PANDIS_API pandis_contact_options pandis_contact_get(const pandis_contact *contact);
PANDIS_API pandis_error pandis_contact_set(
    pandis_contact *contact, const pandis_contact_options *options);

/* [rt] Move the probe. The proxy follows it through free space and never goes through the surface,
 * however thin a wall is. Along the surface it takes short steps. Up to three planes hold it
 * at once, of the eight that it stores.
 *
 * object    its pose may differ from the last step's: the proxy moves with the object.
 *           With another field or scale the contact restarts; if the probe is then inside,
 *           the state is PANDIS_WAITING
 * position  of the probe, scene lengths
 * dt        seconds since the last step, more than 0. Tested with steps of 0.2 to 5 ms
 *
 * Returns touch->flag. PANDIS_INVALID means that there is no force in this tick: it drops to zero
 * at once. This happens if the position, dt, the stiffness or a material is out of range, or if the
 * field has no answer near the probe or the proxy; after that, the force grows from zero. Apart
 * from damping, the force changes by at most the object's stiffness times (twice the probe's motion
 * + slide * dt). A jump of the object counts as motion of the probe. */
PANDIS_API pandis_flag pandis_contact_step(pandis_contact *contact, const pandis_object *object,
    const double position[3], double dt, pandis_touch *touch);

/* [rt] Notify a contact that its object's field has another shape (pandis_refit): if the surface
 * has moved past the proxy, the next step moves the proxy back out. */
PANDIS_API void pandis_contact_reshaped(pandis_contact *contact);
/* -------------------- scenes
 *
 * Objects that one probe can touch. Each is queried again only when the probe may touch it: a field
 * at distance d cannot be touched before the probe has moved that far. Each probe needs its own
 * scene, in one thread. */

/* The state of a scene. Its contents are internal. */
typedef union {
    double aligned;
    unsigned char bytes[256];
} pandis_scene;

/* Number of objects that are tested together, and of doubles that a scene of `count` objects
 * requires. */
#define PANDIS_SCENE_BLOCK 32
#define PANDIS_SCENE_ROOM(count)                                                                   \
    (8 * PANDIS_SCENE_BLOCK *                                                                      \
        (((count) + sizeof(char) * (PANDIS_SCENE_BLOCK - 1)) / PANDIS_SCENE_BLOCK))

/* Begin a scene.
 *
 * objects      `count` objects, kept by the caller, who may change them between calls:
 *              see pandis_scene_moved
 * room         memory of at least PANDIS_SCENE_ROOM(count) doubles, kept by the caller
 * room_length  number of doubles in `room`
 *
 * Returns PANDIS_SUCCESS; PANDIS_ERROR_POSE if objects are invalid, which are left out; or
 * PANDIS_ERROR_COUNT if there is too little room, and the scene is empty. */
PANDIS_API pandis_error pandis_scene_open(pandis_scene *scene, const pandis_object *objects,
    size_t count, double *room, size_t room_length);

/* [rt] Notify a scene that an object was moved, turned, scaled, reshaped (call
 * pandis_contact_reshaped for its contact, too), or given another field.
 *
 * object   its index
 *
 * Returns PANDIS_SUCCESS; PANDIS_ERROR_POSE if the object is invalid: it is left out until this
 * function finds it valid; or PANDIS_ERROR_COUNT if there is no such object. */
PANDIS_API pandis_error pandis_scene_moved(pandis_scene *scene, size_t object);

/* [rt] The sum of the penalty forces of all objects, in their order: bit for bit that of
 * pandis_object_force, provided that no field's distance error exceeds the bound in its file. The
 * call does not affect pandis_scene_touch, whatever the order of calls. Returns the worst flag of
 * the objects queried.
 *
 * point    scene lengths, at most 1e100 */
PANDIS_API pandis_flag pandis_scene_force(
    pandis_scene *scene, const double point[3], double force[3]);

/* Begin a contact for each object.
 *
 * contacts  `count` contacts, kept by the caller
 * options   `count` options, copied; NULL: the defaults
 * count     number of objects in the scene, else PANDIS_ERROR_COUNT
 *
 * Returns PANDIS_SUCCESS, or the first error of pandis_contact_open. Objects with an error are left
 * out until this function is called again. */
PANDIS_API pandis_error pandis_scene_touch_open(pandis_scene *scene, pandis_contact *contacts,
    const pandis_contact_options *options, size_t count);

/* [rt] Move the probe, and step the contacts of all objects that it may touch. The force is the sum
 * of their forces, in the order of the objects, bit for bit as if all contacts had been stepped. A
 * moved object carries its proxy along.
 *
 * position  scene lengths, at most 1e100
 * dt        seconds since the last step, more than 0
 * touches   filled in for objects that are touched or whose proxy is behind; NULL: none
 * most      capacity of `touches`
 * touched   number of such objects, which may exceed `most`; NULL: not wanted
 *
 * Returns the worst flag. */
PANDIS_API pandis_flag pandis_scene_touch(pandis_scene *scene, const double position[3], double dt,
    double force[3], pandis_touch *touches, size_t most, size_t *touched);

/* [rt] Number of fields queried by the last pandis_scene_force, or of queries made by the last
 * pandis_scene_touch. */
PANDIS_API size_t pandis_scene_queries(const pandis_scene *scene);

#if defined(__GNUC__) || defined(_MSC_VER)
/* -------------------- objects that a simulation moves
 *
 * A simulation hands frames of poses over to the haptic loop; neither waits. Of three frames one is
 * written, one is followed, and the newest complete one is handed over. In each tick every object
 * moves, without a jump, towards the pose predicted for the time when the next frame is due. If the
 * frame is late, the object waits there. One thread calls pandis_poses_give, the other
 * pandis_poses_step. */

/* Pose and velocity of an object in a frame. */
typedef struct {
    double rotation[9], translation[3]; /* as in pandis_object */
    /* of the point at `translation`, scene lengths per second, at most 1e50 */
    double velocity[3];
    double spin[3]; /* axis times radians per second, in scene coordinates */
} pandis_pose;

/* The state of the handover. Its contents are internal. */
typedef union {
    double aligned;
    unsigned char bytes[128];
} pandis_poses;

/* Number of doubles that `count` objects require. */
#define PANDIS_POSES_ROOM(count) (sizeof(char) * 68 * (count))

/* Begin at the current poses of the objects.
 *
 * objects      `count` objects, kept by the caller, and moved by pandis_poses_step
 * room         memory of at least PANDIS_POSES_ROOM(count) doubles, kept by the caller
 * room_length  number of doubles in `room`
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_POSE or PANDIS_ERROR_COUNT. */
PANDIS_API pandis_error pandis_poses_open(
    pandis_poses *poses, pandis_object *objects, size_t count, double *room, size_t room_length);

/* [rt] Hand over a frame, in the simulation's thread.
 *
 * frame    a pose for each object, copied
 * count    number of objects, else PANDIS_ERROR_COUNT
 * period   seconds until the next frame is due, more than 0 and at most 1e6
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_COUNT or PANDIS_ERROR_POSE: a rotation matrix is not a
 * rotation, a value is out of range, or an object turns by more than half a turn in the period.
 * After an error nothing is handed over. */
PANDIS_API pandis_error pandis_poses_give(
    pandis_poses *poses, const pandis_pose *frame, size_t count, double period);

/* [rt] Move the objects, at the beginning of a tick. Returns 1 if there was a new frame, else 0.
 *
 * scene    contains the objects and is notified; or NULL
 * dt       seconds since the last tick, more than 0 */
PANDIS_API int pandis_poses_step(pandis_poses *poses, pandis_scene *scene, double dt);
#endif

#ifdef __cplusplus
}
#endif
#endif /* PANDIS_H */

/* ================================================================ implementation */

#if defined(PANDIS_IMPLEMENTATION) && !defined(PANDIS__IMPLEMENTED)
#define PANDIS__IMPLEMENTED
#include <float.h>
#include <math.h>
#include <string.h>
#if defined(_MSC_VER)
#include <intrin.h>
#endif
#if defined(__FAST_MATH__) || defined(__RECIPROCAL_MATH__) ||                                      \
    (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0) || defined(_M_FP_FAST)
#error "pandis.h needs IEEE arithmetic: compile without -ffast-math (/fp:fast)"
#endif
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16 /* 16: only half-precision arithmetic differs */
#error "pandis.h needs arithmetic without excess precision: compile with -mfpmath=sse"
#endif
#ifndef PANDIS_NO_FILE
#if defined(_WIN32) || !defined(PANDIS_MMAP)
#define PANDIS__READ
#include <stdio.h>
#include <stdlib.h>
#else
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#endif
#endif

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__RESTRICT __restrict
#elif defined(__cplusplus)
#define PANDIS__RESTRICT
#else
#define PANDIS__RESTRICT restrict
#endif

/* The code below needs only -O2. With it, GCC vectorises little, and even less if an operation
 * might trap, so further options are set here; clang needs none. Products and sums are rounded
 * separately, whatever the flags, so that all compilers, machines and vector widths give the same
 * bits. */
#if defined(__cplusplus) && defined(__GNUC__) /* the code is also C, which has no other casts */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wold-style-cast"
#pragma GCC diagnostic ignored "-Wcast-qual"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wuseless-cast"
#endif
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__INTEL_COMPILER)
#pragma GCC push_options
#pragma GCC optimize("O3", "no-trapping-math", "no-math-errno", "fp-contract=off")
#define PANDIS__PUSHED
#endif

/* without optimisation, inlining would make clang's stack frames larger */
#if defined(__GNUC__) && !(defined(__clang__) && !defined(__OPTIMIZE__))
#define PANDIS__ALWAYS inline __attribute__((always_inline))
#else
#define PANDIS__ALWAYS inline
#endif
#define PANDIS__INLINE static PANDIS__ALWAYS

/* Not inlined, so that the function keeps a separate stack frame. */
#if defined(__GNUC__)
#define PANDIS__APART __attribute__((noinline))
#elif defined(_MSC_VER)
#define PANDIS__APART __declspec(noinline)
#else
#define PANDIS__APART
#endif

/* For a function called once before a loop: compile it for size. */
#if defined(__GNUC__) && !defined(__clang__)
#define PANDIS__ONCE __attribute__((cold))
#else
#define PANDIS__ONCE
#endif

#ifndef PANDIS_MOST_WIDTH
#define PANDIS_MOST_WIDTH 1024
#endif
#ifndef PANDIS_MOST_DEPTH
#define PANDIS_MOST_DEPTH 16
#endif

#define PANDIS__LONGEST 1.8 /* longest side of a mesh in the unit frame */
#define PANDIS__HALF (PANDIS__LONGEST / 2)
#define PANDIS__FAR 1e150        /* larger coordinates overflow when squared */
#define PANDIS__EDGE (1 - 1e-12) /* the outermost faces of the box belong to its last cells */
/* number of lanes of a sum, whatever the machine's vector width */
#define PANDIS__LANES 16
/* largest number of points that share a pass over a network's weights */
#define PANDIS__POINTS 8
#define PANDIS__ROWS ((PANDIS_MOST_WIDTH + PANDIS__LANES - 1) / PANDIS__LANES * PANDIS__LANES)
/* capacity of the queue of boxes to visit; if it is full, the farthest are dropped */
#define PANDIS__HEAP 512
#define PANDIS__STACK 704
/* maximum depth of a tree: each level leaves seven entries on the stack */
#define PANDIS__DEEPEST 100
#define PANDIS__NO_BRICK 65535
#define PANDIS__MOST_BITS 20
/* number of boxes and faces that a search visits before it reads slabs or, in a packed mesh, goes
 * on best-first */
#define PANDIS__SOON 192
/* The budget of a mesh may be large because queries next to its surface need it. A search whose
 * nearest face is farther than CLOSE (unit frame) gets a sixteenth of the budget, but at least AWAY
 * and at most four times AWAY. If that is not enough, further searches, of up to CERTAIN boxes and
 * faces each, prove that nothing is nearer by more than DOUBT, or by more than a larger number. */
#define PANDIS__CLOSE 0.15
#define PANDIS__AWAY 500
#define PANDIS__CERTAIN 4000
#define PANDIS__DOUBT 0.9e-3
#define PANDIS__SLACK 16 /* bytes after the last block that are read but not used */
#define PANDIS__BLOCK 64 /* maximum number of faces, and of corners, per block of a packed mesh */

static double pandis__dot(const double *u, const double *v) {
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
}

static void pandis__cross(const double *u, const double *v, double *out) {
    out[0] = u[1] * v[2] - u[2] * v[1];
    out[1] = u[2] * v[0] - u[0] * v[2];
    out[2] = u[0] * v[1] - u[1] * v[0];
}

#define PANDIS__STIFFEST 1e100
#define PANDIS__TINY 1e-150 /* squares of smaller numbers lose digits */

/* Scale a vector to unit length; returns 0 if its length is 0. */
static int pandis__normalise(double *v) {
    double length = sqrt(pandis__dot(v, v));
    if (!(length > PANDIS__TINY)) return 0;
    for (int k = 0; k < 3; k++) v[k] /= length;
    return 1;
}

/* Move a point into a box; returns the distance moved. */
static double pandis__clamp_to(
    const double *low, const double *high, const double *u, double *inside) {
    double off[3];
    for (int k = 0; k < 3; k++) {
        inside[k] = u[k] < low[k] ? low[k] : u[k] > high[k] ? high[k] : u[k];
        off[k] = u[k] - inside[k];
    }
    return sqrt(pandis__dot(off, off));
}

static double pandis__clamp(const double *u, double *inside) {
    static const double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    return pandis__clamp_to(low, high, u, inside);
}
/* -------------------- contents of the opaque states */

typedef struct {
    pandis_contact_options options; /* budget 0: the contact is not open */
    int32_t state, planes, sticks, settled, close, stalled, idle, face, region;
    /* in the object's unit frame */
    pandis_object object; /* with its pose in the last step */
    double ball[5], sunk, lift, pace, rested, proxy[3], probe[3], velocity[3], pull[3], plane[8][7];
} pandis__contact;

typedef struct {
    const pandis_object *objects;
    size_t count;
    double *room;
    size_t queries;           /* in the last call */
    pandis_contact *contacts; /* one per object; NULL: none */
    double probe[3];          /* its position in the last step of the contacts */
} pandis__scene;

#if defined(__GNUC__) || defined(_MSC_VER)
typedef struct {
    pandis_object *objects;
    size_t count;
    pandis_pose *frames;
    double periods[3], *ways, period, gone;
    int32_t writing, asking;
    volatile int32_t waiting; /* a frame's index, plus 4 until it is taken */
} pandis__poses;

typedef struct {
    pandis_field shapes[3];
    int32_t writing, asking;
    volatile int32_t waiting; /* a shape's index, plus 4 until it is taken */
} pandis__handover;
#endif

/* The state behind each handle. Handles are aligned for doubles. As unions with characters, they
 * may alias anything. */
#define PANDIS__STATE(handle)                                                                      \
    typedef char handle##_fits[sizeof(pandis__##handle) <= sizeof(pandis_##handle) ? 1 : -1];      \
    PANDIS__INLINE pandis__##handle *pandis__##handle##_of(pandis_##handle *h) {                   \
        return (pandis__##handle *)(void *)h;                                                      \
    }                                                                                              \
    PANDIS__INLINE const pandis__##handle *pandis__##handle##_in(const pandis_##handle *h) {       \
        return (const pandis__##handle *)(const void *)h;                                          \
    }
PANDIS__STATE(contact)
PANDIS__STATE(scene)
#if defined(__GNUC__) || defined(_MSC_VER)
PANDIS__STATE(poses)
PANDIS__STATE(handover)
#endif

PANDIS_API const char *pandis_version(void) { return PANDIS_VERSION; }

PANDIS__ONCE PANDIS_API pandis_error pandis__check(
    const char *version, size_t field, size_t options, size_t touch) {
    int same = strlen(version) == sizeof PANDIS_VERSION - 1 &&
        !memcmp(version, PANDIS_VERSION, sizeof PANDIS_VERSION - 1);
    same = same && field == sizeof(pandis_field) && options == sizeof(pandis_contact_options) &&
        touch == sizeof(pandis_touch);
    return same ? PANDIS_SUCCESS : PANDIS_ERROR_HEADER;
}

/* -------------------- vectors
 *
 * Sums run in lanes. If the compiler has vector types, these hold the lanes, because the compiler
 * would not keep lanes in registers by itself. Otherwise a vector is a single number. The order of
 * additions is the same for every width. */
#if (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 9)) && !defined(PANDIS_NO_VECTORS)
#if defined(__AVX512F__)
#define PANDIS__VECTOR 16
#elif defined(__AVX__) || (defined(__x86_64__) && !defined(_WIN32))
#define PANDIS__VECTOR 8
#else
#define PANDIS__VECTOR 4
#endif
typedef float pandis__vector __attribute__((vector_size(4 * PANDIS__VECTOR)));
typedef float pandis__floats
    __attribute__((vector_size(4 * PANDIS__VECTOR), aligned(4), may_alias));
typedef int16_t pandis__shorts
    __attribute__((vector_size(2 * PANDIS__VECTOR), aligned(2), may_alias));
typedef int32_t pandis__ints __attribute__((vector_size(4 * PANDIS__VECTOR)));
typedef float pandis__quad __attribute__((vector_size(16)));
typedef int32_t pandis__quad_ints __attribute__((vector_size(16)));
/* four of the eight lanes of two vectors */
#ifdef __clang__
#define PANDIS__PICK(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#else
#define PANDIS__PICK(a, b, i, j, k, l)                                                             \
    __builtin_shuffle(a, b, __extension__(pandis__quad_ints){i, j, k, l})
#endif
/* macros, because the ABI determines how a function returns a vector */
#define pandis__load(p) (*(const pandis__floats *)(p))
#define pandis__load16(p) __builtin_convertvector(*(const pandis__shorts *)(p), pandis__vector)
#else
#define PANDIS__VECTOR 1
typedef float pandis__vector;
#define pandis__load(p) (*(p))
#define pandis__load16(p) ((float)*(p))
#endif
/* GCC needs these intrinsics to convert in one instruction; clang does it by itself */
#if PANDIS__VECTOR == 8 && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define pandis__load16_wide(p)                                                                     \
    __builtin_convertvector(                                                                       \
        (pandis__ints)__builtin_ia32_pmovsxwd256(*(const pandis__shorts *)(p)), pandis__vector)
#ifdef __AVX2__
#undef pandis__load16
#define pandis__load16 pandis__load16_wide
#endif
#else
#define pandis__load16_wide pandis__load16
#if PANDIS__VECTOR == 16 && !defined(__clang__)
#undef pandis__load16
#define pandis__load16(p)                                                                          \
    __builtin_convertvector(                                                                       \
        (pandis__ints)__builtin_ia32_pmovsxwd512_mask(                                             \
            *(const pandis__shorts *)(p), __extension__(pandis__ints){0}, 0xffff),                 \
        pandis__vector)
#endif
#endif
#define PANDIS__PARTS (PANDIS__LANES / PANDIS__VECTOR)

/* Hot functions are compiled twice if the program is for any x86-64 machine: as `name_plain`, and
 * as `name_wide` for AVX2, which is used where the machine has it. Not on Windows, which does not
 * align the stack for such vectors. */
#if PANDIS__VECTOR == 8 && defined(__x86_64__) && !defined(__AVX2__) && !defined(_WIN32) &&        \
    !defined(PANDIS_NO_DISPATCH)
#define PANDIS__WIDE __attribute__((target("avx2")))
#define PANDIS__TWICE(plain, wide) plain wide
#define PANDIS__CHOOSE(name) (__builtin_cpu_supports("avx2") ? name##_wide : name##_plain)
#else
#define PANDIS__WIDE
#define PANDIS__TWICE(plain, wide) plain
#define PANDIS__CHOOSE(name) name##_plain
#endif

/* Define a function with its own stack frame from `name_body`. */
#define PANDIS__COMPILE(name, parameters, arguments)                                               \
    PANDIS__TWICE(                                                                                 \
        PANDIS__APART static void name##_plain parameters { name##_body arguments; },              \
        PANDIS__WIDE PANDIS__APART static void name##_wide parameters { name##_body arguments; })  \
    static void name parameters { PANDIS__CHOOSE(name) arguments; }
/* -------------------- sines */

/* pi / 2 in three parts, the first two of few bits, so that integer multiples of them are exact. */
#define PANDIS__PART1 1.5703125f
#define PANDIS__PART2 4.837512969970703125e-4f
#define PANDIS__PART3 7.549789954891e-8f

/* Compute the sine and cosine within 1.2e-7 for |x| up to 1e4. Beyond that, where no trained
 * network goes, the results are those of 0; if x is not finite, they are NaN. The minimax
 * polynomials on [-pi/4, pi/4] are from Cephes (Moshier). The code has no branch, so that it
 * vectorises. */
PANDIS__INLINE void pandis__sine_cosine(float x, float *sine, float *cosine) {
    const float whole = 12582912.0f; /* adding 1.5 * 2^23 rounds to the nearest whole number */
    float none = x - x;              /* 0, or NaN if x is not finite */
    x = fabsf(x) <= 1e4f ? x : 0.0f;
    float k = (x * 0.636619772367581343f + whole) - whole;
    float r = ((x - k * PANDIS__PART1) - k * PANDIS__PART2) - k * PANDIS__PART3, q = r * r;
    float s = ((-1.9515295891e-4f * q + 8.3321608736e-3f) * q - 1.6666654611e-1f) * q * r + r;
    float c =
        ((2.443315711809948e-5f * q - 1.388731625493765e-3f) * q + 4.166664568298827e-2f) * q * q -
        0.5f * q + 1.0f;
    int32_t quarter = (int32_t)k;
    float a = quarter & 1 ? c : s, b = quarter & 1 ? s : c;
    *sine = (quarter & 2 ? -a : a) + none;
    *cosine = ((quarter + 1) & 2 ? -b : b) + none;
}

/* Add biases to a layer's sums in all lanes, and replace them by their sines; also compute the
 * cosines. With vector types, this is the function above with the same bits: few compilers would
 * use vectors for it without -O3. */
PANDIS__INLINE void pandis__sines(float *z, const float *bias, float *cosines) {
#if PANDIS__VECTOR > 1
    const float whole = 12582912.0f;
    for (int at = 0; at < PANDIS__LANES; at += PANDIS__VECTOR) {
        pandis__vector x = pandis__load(z + at) + pandis__load(bias + at), none = x - x;
        pandis__ints small = (x >= -1e4f) & (x <= 1e4f);
        x = (pandis__vector)((pandis__ints)x & small);
        /* the last bits of this sum are those of the whole number k */
        pandis__vector sum = x * 0.636619772367581343f + whole, k = sum - whole;
        pandis__vector r = ((x - k * PANDIS__PART1) - k * PANDIS__PART2) - k * PANDIS__PART3,
                       q = r * r;
        pandis__vector s =
            ((-1.9515295891e-4f * q + 8.3321608736e-3f) * q - 1.6666654611e-1f) * q * r + r;
        pandis__vector c =
            ((2.443315711809948e-5f * q - 1.388731625493765e-3f) * q + 4.166664568298827e-2f) * q *
                q -
            0.5f * q + 1.0f;
        pandis__ints quarter = (pandis__ints)sum, odd = -(quarter & 1), change;
        change = ((pandis__ints)s ^ (pandis__ints)c) & odd; /* exchanges sine and cosine */
        pandis__ints a = (pandis__ints)s ^ change, b = (pandis__ints)c ^ change;
        a ^= -(quarter >> 1 & 1) & INT32_MIN, b ^= -((quarter + 1) >> 1 & 1) & INT32_MIN;
        s = (pandis__vector)a + none, c = (pandis__vector)b + none;
        memcpy(z + at, &s, sizeof s), memcpy(cosines + at, &c, sizeof c);
    }
#else
    for (int k = 0; k < PANDIS__LANES; k++) pandis__sine_cosine(z[k] + bias[k], z + k, cosines + k);
#endif
}

/* Check the arithmetic that this code relies on: sums are rounded in the order in which they are
 * written, and NaN stays NaN. Some options of -ffast-math break this and define no macro. */
PANDIS__ONCE static int pandis__arithmetic(void) {
    /* sines and cosines of 3 and of -100, from a loop like that of network layers */
    static const float wanted[4] = {0.141120008f, -0.989992497f, 0.506365641f, 0.862318872f};
    volatile float read[2] = {3.0f, -100.0f};
    volatile uint32_t none = 0x7fc00000u; /* NaN, made without a division, which might trap */
    uint32_t bits = none;
    volatile double large = 9007199254740992.0, one = 1;
    float sine[PANDIS__LANES], cosine[PANDIS__LANES], bias[PANDIS__LANES] = {0};
    int good = 1;
    for (int k = 0; k < PANDIS__LANES; k++) sine[k] = read[k & 1];
    memcpy(sine + 15, &bits, sizeof bits);
    pandis__sines(sine, bias, cosine);
    for (int k = 0; k < 15; k++) {
        good &= fabsf(sine[k] - wanted[2 * (k & 1)]) < 1e-6f;
        good &= fabsf(cosine[k] - wanted[2 * (k & 1) + 1]) < 1e-6f;
    }
    double sum = large + one; /* rounds back */
    double big = sum - large, nan = (double)sine[15];
    return good & (big == 0) & (nan != nan);
}
/* -------------------- B-splines */

/* Cubic B-spline weights of the four nodes around t in [0, 1), and their derivatives with respect
 * to t. */
PANDIS__INLINE void pandis__weigh(double t, double *w, double *dw) {
    double s = 1 - t;
    w[0] = s * s * s / 6, w[3] = t * t * t / 6;
    w[1] = (4 - 6 * t * t + 3 * t * t * t) / 6, w[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    dw[0] = -s * s / 2, dw[3] = t * t / 2;
    dw[1] = t * (3 * t - 4) / 2, dw[2] = -s * (3 * s - 4) / 2;
}

/* Find the cell of a point and the weights of its 4 x 4 x 4 nodes; returns 0 outside the lattice.
 */
PANDIS__INLINE int pandis__place(int32_t size, double low, double per_step, const double *p,
    int *first, double (*w)[4], double (*dw)[4]) {
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - low) * per_step, cell = floor(x);
        if (!(cell >= 1 && cell <= size - 3)) return 0; /* NaN too */
        first[k] = (int)cell - 1;
        pandis__weigh(x - cell, w[k], dw[k]);
        for (int i = 0; i < 4; i++) dw[k][i] *= per_step;
    }
    return 1;
}

/* Four numbers at once, if the compiler has vectors; each result is the same as if computed alone.
 */
#if defined(PANDIS__VECTOR) && PANDIS__VECTOR > 1
typedef double pandis__four __attribute__((vector_size(32)));
typedef float pandis__four_floats __attribute__((vector_size(16), aligned(4), may_alias));
#define PANDIS__FOUR_AT_ONCE
#endif

/* Add the value and gradient of the spline that has these 64 coefficients around a point. */
PANDIS__INLINE void pandis__tensor(
    const float *c, double (*w)[4], double (*dw)[4], double *value, double *gradient) {
#ifdef PANDIS__FOUR_AT_ONCE
    pandis__four f = {0, 0, 0, 0}, gx = f, gy = f;
#else
    double f[4] = {0}, gx[4] = {0}, gy[4] = {0};
#endif
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++) {
            double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], d = w[0][x] * dw[1][y];
            const float *row = c + 16 * x + 4 * y;
#ifdef PANDIS__FOUR_AT_ONCE
            pandis__four r =
                __builtin_convertvector(*(const pandis__four_floats *)row, pandis__four);
            f += a * r, gx += b * r, gy += d * r;
#else
            for (int z = 0; z < 4; z++) {
                double r = (double)row[z];
                f[z] += a * r, gx[z] += b * r, gy[z] += d * r;
            }
#endif
        }
    for (int z = 0; z < 4; z++) {
        *value += f[z] * w[2][z];
        gradient[0] += gx[z] * w[2][z], gradient[1] += gy[z] * w[2][z],
            gradient[2] += f[z] * dw[2][z];
    }
}

/* Read the 64 coefficients around a point from a dense lattice. */
static void pandis__gather(const float *values, int32_t size, const int *first, float *c) {
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(c + 16 * x + 4 * y,
                values + ((ptrdiff_t)(first[0] + x) * size + first[1] + y) * size + first[2],
                4 * sizeof *c);
}

/* Compute the value and gradient at a point of the box, from a lattice that covers the box. */
static void pandis__cubic(
    const pandis__lattice *l, const double *u, double *value, double *gradient) {
    double within[3], w[3][4], dw[3][4];
    float c[64];
    int first[3];
    *value = gradient[0] = gradient[1] = gradient[2] = 0;
    for (int k = 0; k < 3; k++)
        within[k] = u[k] < -PANDIS__EDGE ? -PANDIS__EDGE
            : u[k] > PANDIS__EDGE        ? PANDIS__EDGE
                                         : u[k];
    if (!pandis__place(l->size, l->low, l->per_step, within, first, w, dw)) return;
    pandis__gather(l->values, l->size, first, c);
    pandis__tensor(c, w, dw, value, gradient);
}

PANDIS__INLINE int pandis__count_bits(uint64_t x) {
#if defined(__GNUC__)
    return __builtin_popcountll(x);
#else
    int n = 0;
    for (; x; x &= x - 1) n++;
    return n;
#endif
}

/* Index of the first of a block's eight coefficients, or -1 if the block is not stored. */
PANDIS__INLINE int32_t pandis__block_of(const pandis__layout *l, uint16_t brick, int bit) {
    if (brick == PANDIS__NO_BRICK) return -1;
    uint64_t mask = l->mask[brick], one = (uint64_t)1 << bit;
    if (!(mask & one)) return -1;
    return (int32_t)((l->base[brick] + (uint32_t)pandis__count_bits(mask & (one - 1))) * 8);
}

PANDIS__INLINE int32_t pandis__block(const pandis__layout *l, int bx, int by, int bz) {
    ptrdiff_t n = l->bricks;
    uint16_t brick = l->brick[((bx >> 2) * n + (by >> 2)) * n + (bz >> 2)];
    return pandis__block_of(l, brick, ((bx & 3) << 4) | ((by & 3) << 2) | (bz & 3));
}

/* -------------------- eight boxes or triangles at once, in single precision
 *
 * Squared distances are sorted by integer keys, because non-negative floats sort like integers with
 * the same bits. The last three bits of a key are the index of the box. */

PANDIS__INLINE int32_t pandis__least(const int32_t *keys) {
    int32_t least = keys[0];
    for (int i = 1; i < PANDIS__WIDTH; i++) least = keys[i] < least ? keys[i] : least;
    return least;
}

/* Convert a squared distance to a key: boxes with larger keys are farther. */
static int32_t pandis__key(float squared) {
    int32_t key;
    memcpy(&key, &squared, sizeof key);
    return key | 7;
}

/* The distance that a key stands for. */
static double pandis__distance_of(int32_t key) {
    float squared;
    key &= ~7;
    memcpy(&squared, &key, sizeof squared);
    return sqrt((double)squared);
}

/* The part of a budget that is spent in tree order: most queries need no more. */
static int32_t pandis__soon(int32_t most) {
    int32_t soon = most / 4 > PANDIS__SOON ? most / 4 : PANDIS__SOON;
    return most < INT32_MAX && most > soon ? soon : most;
}

/* The part of a budget that is spent far from the surface. */
static int32_t pandis__few(int32_t most) {
    int32_t few = most / 16 < 4 * PANDIS__AWAY ? most / 16 : 4 * PANDIS__AWAY;
    return few > PANDIS__AWAY ? few : PANDIS__AWAY;
}

typedef struct {
    int32_t key, child;
} pandis__waiting;

static void pandis__wait(pandis__waiting *heap, int at, pandis__waiting one) {
    for (; at > 0 && heap[(at - 1) / 2].key > one.key; at = (at - 1) / 2)
        heap[at] = heap[(at - 1) / 2];
    heap[at] = one;
}

static pandis__waiting pandis__next(pandis__waiting *heap, int count) {
    pandis__waiting first = heap[0], last = heap[count - 1];
    int at = 0, below = 1;
    for (; below < count - 1; at = below, below = 2 * at + 1) {
        if (below + 1 < count - 1 && heap[below + 1].key < heap[below].key) below++;
        if (heap[below].key >= last.key) break;
        heap[at] = heap[below];
    }
    heap[at] = last;
    return first;
}

/* Queue a box. If the queue is full, drop this box or the last one, whichever is farther, store its
 * key in `out`, and return 1. */
static int pandis__wait_or_drop(
    pandis__waiting *heap, int *count, int32_t key, int32_t child, int32_t *out) {
    pandis__waiting one = {key, child};
    if (*count < PANDIS__HEAP) {
        pandis__wait(heap, (*count)++, one);
        return 0;
    }
    pandis__waiting last = heap[*count - 1];
    *out = key < last.key ? last.key : key;
    if (key < last.key) pandis__wait(heap, *count - 1, one);
    return 1;
}

PANDIS__INLINE float pandis__clamp01f(float t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

/* Squared distances from a point to eight triangles, given as (3 corners, 3 axes, 8). Each
 * result belongs to some point of the triangle, so it can be too small only by rounding.
 * pandis__slacks bounds how much too large it can be. */
PANDIS__INLINE void pandis__eight_distances(
    float (*v)[3][PANDIS__WIDTH], const float *PANDIS__RESTRICT q, float *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float x = q[0] - v[0][0][i], y = q[1] - v[0][1][i], z = q[2] - v[0][2][i];
        float ux = v[1][0][i] - v[0][0][i], uy = v[1][1][i] - v[0][1][i],
              uz = v[1][2][i] - v[0][2][i];
        float vx = v[2][0][i] - v[0][0][i], vy = v[2][1][i] - v[0][1][i],
              vz = v[2][2][i] - v[0][2][i];
        float wx = vx - ux, wy = vy - uy, wz = vz - uz;
        float s = pandis__clamp01f((ux * x + uy * y + uz * z) / (ux * ux + uy * uy + uz * uz));
        float rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        float best = rx * rx + ry * ry + rz * rz;
        float t = pandis__clamp01f((vx * x + vy * y + vz * z) / (vx * vx + vy * vy + vz * vz));
        rx = x - t * vx, ry = y - t * vy, rz = z - t * vz;
        float d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        float bx = x - ux, by = y - uy, bz = z - uz;
        float r = pandis__clamp01f((wx * bx + wy * by + wz * bz) / (wx * wx + wy * wy + wz * wz));
        rx = bx - r * wx, ry = by - r * wy, rz = bz - r * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        float nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        float per = 1 / (nx * nx + ny * ny + nz * nz);
        s = ((y * vz - z * vy) * nx + (z * vx - x * vz) * ny + (x * vy - y * vx) * nz) * per;
        t = ((uy * z - uz * y) * nx + (uz * x - ux * z) * ny + (ux * y - uy * x) * nz) * per;
        rx = x - s * ux - t * vx, ry = y - s * uy - t * vy, rz = z - s * uz - t * vz;
        d = rx * rx + ry * ry + rz * rz;
        int inside = (s >= 0) & (t >= 0) & (s + t <= 1);
        out[i] = inside && d < best ? d : best;
    }
}

/* How much too large the distance d to any of eight triangles can be in single precision, apart
 * from the rounding of the point: at most slack[0] + slack[1] * d. With B = 1 / the sine of the
 * angle at the first corner and the unit roundoff e, the foot inside a triangle is off by less than
 * e (32 B (d + longest side) + 8 B^2 d). If half the smallest height of a triangle is less than
 * this, half the height is the bound, because an edge is at most that far from any point inside. */
static void pandis__slacks(float (*v)[3][PANDIS__WIDTH], float *slack) {
    const float e = 6e-8f;
    float off[PANDIS__WIDTH], share[PANDIS__WIDTH];
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float ux = v[1][0][i] - v[0][0][i], uy = v[1][1][i] - v[0][1][i],
              uz = v[1][2][i] - v[0][2][i];
        float vx = v[2][0][i] - v[0][0][i], vy = v[2][1][i] - v[0][1][i],
              vz = v[2][2][i] - v[0][2][i];
        float wx = vx - ux, wy = vy - uy, wz = vz - uz;
        float uu = ux * ux + uy * uy + uz * uz, vv = vx * vx + vy * vy + vz * vz,
              ww = wx * wx + wy * wy + wz * wz;
        float nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        float twice = sqrtf(nx * nx + ny * ny + nz * nz), most = uu > vv ? uu : vv;
        float longest = sqrtf(ww > most ? ww : most),
              half = longest > 0 ? twice / (2 * longest) : 0;
        float sine = sqrtf(uu) * sqrtf(vv) / (twice > 0 ? twice : 1e-30f),
              more = e * (32 * sine + 8 * sine * sine);
        float less = e * 32 * sine * longest;
        int wide = less + more * longest < half; /* false after an overflow */
        /* plus the error on edges, and of a height that has lost its digits */
        off[i] = (wide ? less : half) + 64 * e * longest, share[i] = (wide ? more : 0) + 64 * e;
    }
    slack[0] = off[0], slack[1] = share[0];
    for (int i = 1; i < PANDIS__WIDTH; i++) {
        slack[0] = off[i] > slack[0] ? off[i] : slack[0];
        slack[1] = share[i] > slack[1] ? share[i] : slack[1];
    }
}

/* Whether a segment from a point, or its extension, meets a triangle (-1: from inside, 1: from
 * outside). `at` is set to the share of the segment at which they meet. */
static int pandis__meets(const double *const *c, const double *p, const double *way, double *at) {
    double u[3], v[3], x[3], across[3], turned[3];
    for (int k = 0; k < 3; k++)
        u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k], x[k] = p[k] - c[0][k];
    pandis__cross(way, v, across), pandis__cross(x, u, turned);
    double det = pandis__dot(u, across), r = pandis__dot(x, across) / det,
           s = pandis__dot(way, turned) / det;
    *at = pandis__dot(v, turned) / det;
    if (!(r >= 0 && s >= 0 && r + s <= 1 && *at >= 0)) return 0; /* not if det is 0 */
    return det < 0 ? -1 : 1;
}
/* -------------------- closest points of a mesh */

/* Input of a search: how far to look (unit frame). Output: the closest face in mesh.zarr.zip (-1:
 * unknown), its place in the field's own order (-1: none), whether the closest point lies on a
 * corner or an edge, and the direction of that edge (else 0). */
typedef struct {
    double reach;
    int32_t face, place, round;
    double along[3];
} pandis__start;

#define PANDIS__WITHIN(reach) {reach, -1, -1, 0, {0, 0, 0}}
#define PANDIS__ANYWHERE PANDIS__WITHIN((double)INFINITY)

typedef struct {
    double weights[3], offset[3], distance; /* offset: from the closest point to the query */
    /* the corner or the edge (k to k + 1) that contains the closest point; -1: none */
    int corner, edge;
} pandis__foot;

static const double *pandis__corner(const pandis__mesh *t, int32_t face, int k) {
    return t->vertices + 3 * (ptrdiff_t)t->faces[3 * (ptrdiff_t)face + k];
}

/* Compute the unit normal of a face from its two shortest edges, whose cross product is the most
 * accurate. */
static int pandis__face_normal(const pandis__mesh *t, int32_t face, double *n) {
    double side[3][3], length[3];
    for (int k = 0; k < 3; k++) {
        const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
        for (int i = 0; i < 3; i++) side[k][i] = q[i] - p[i];
        length[k] = pandis__dot(side[k], side[k]);
    }
    int longest = length[0] >= length[1] ? (length[0] >= length[2] ? 0 : 2)
                                         : (length[1] >= length[2] ? 1 : 2);
    pandis__cross(side[(longest + 1) % 3], side[(longest + 2) % 3], n);
    return pandis__normalise(n);
}

static double pandis__clamp01(double t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

static void pandis__edge_foot(
    const double *p, const double *a, const double *b, double *s, double *offset, double *squared) {
    double u[3], x[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], x[k] = p[k] - a[k];
    double length = pandis__dot(u, u),
           t = length > 0 ? pandis__clamp01(pandis__dot(u, x) / length) : 0;
    /* from the nearer end, for less cancellation */
    for (int k = 0; k < 3; k++)
        offset[k] = t <= 0.5 ? x[k] - t * u[k] : (p[k] - b[k]) + (1 - t) * u[k];
    *s = t, *squared = pandis__dot(offset, offset);
}

/* Find the closest point on a triangle's edges, and the corner or edge that contains it. Returns
 * the squared distance. */
static double pandis__rim_foot(const double *const *c, const double *p, pandis__foot *foot) {
    double best = (double)INFINITY;
    memset(foot, 0, sizeof *foot);
    foot->corner = foot->edge = -1;
    for (int k = 0; k < 3; k++) {
        double s, offset[3], squared;
        pandis__edge_foot(p, c[k], c[(k + 1) % 3], &s, offset, &squared);
        if (!(squared < best)) continue;
        best = squared;
        memcpy(foot->offset, offset, sizeof offset);
        foot->weights[k] = 1 - s, foot->weights[(k + 1) % 3] = s, foot->weights[(k + 2) % 3] = 0;
        foot->corner = s == 0 ? k : s == 1 ? (k + 1) % 3 : -1;
        foot->edge = foot->corner < 0 ? k : -1;
    }
    return best;
}

/* Find the closest point inside the triangle; returns whether there is one no farther than `best`
 * (squared). The weight of a corner is the distance from the opposite side, which is as accurate on
 * needles as elsewhere. The normal is made orthogonal to a side, because an error along it would
 * change heights most. */
static int pandis__inner_foot(
    const double *const *c, const double *p, double best, pandis__foot *foot) {
    double u[3], v[3], w[3], x[3], y[3], n[3], across[3], offset[3];
    for (int k = 0; k < 3; k++) {
        u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k], w[k] = c[2][k] - c[1][k];
        x[k] = p[k] - c[0][k], y[k] = p[k] - c[1][k];
    }
    pandis__cross(u, v, n);
    double along = pandis__dot(n, u) / pandis__dot(u, u);
    for (int k = 0; k < 3; k++) n[k] -= along * u[k];
    double det = pandis__dot(n, n);
    if (!(det > 0)) return 0;
    pandis__cross(x, n, across);
    double s = -pandis__dot(v, across), r = pandis__dot(u, across);
    if (!(s > 0 && r > 0)) return 0;
    pandis__cross(y, n, across);
    double q = pandis__dot(w, across), height = pandis__dot(n, x) / det;
    if (!(q > 0)) return 0;
    for (int k = 0; k < 3; k++) offset[k] = height * n[k];
    if (!(pandis__dot(offset, offset) <= best)) return 0;
    memcpy(foot->offset, offset, sizeof offset);
    foot->weights[0] = q / (q + s + r), foot->weights[1] = s / (q + s + r);
    foot->weights[2] = r / (q + s + r);
    foot->corner = foot->edge = -1;
    return 1;
}

static void pandis__find_foot(const double *const *c, const double *p, pandis__foot *foot) {
    pandis__inner_foot(c, p, pandis__rim_foot(c, p, foot), foot);
    foot->distance = sqrt(pandis__dot(foot->offset, foot->offset));
}

#define PANDIS__FOUR 4

/* Four triangles: a corner, the sides a to b, a to c and b to c, the normal, and 1 / the squared
 * lengths of these. */
typedef struct {
    double a[3][PANDIS__FOUR], u[3][PANDIS__FOUR], v[3][PANDIS__FOUR], w[3][PANDIS__FOUR],
        n[3][PANDIS__FOUR], per_u[PANDIS__FOUR], per_v[PANDIS__FOUR], per_w[PANDIS__FOUR],
        per_n[PANDIS__FOUR];
} pandis__triangles;

/* Set the corner and the sides of one of four triangles. */
PANDIS__INLINE void pandis__set_triangle(
    pandis__triangles *f, int i, const double *a, const double *b, const double *c) {
    for (int k = 0; k < 3; k++)
        f->a[k][i] = a[k], f->u[k][i] = b[k] - a[k], f->v[k][i] = c[k] - a[k],
        f->w[k][i] = c[k] - b[k];
}

/* Compute the rest. An error of a normal along the first side, over which it would change heights
 * most, is removed: what remains is no greater than the rounding of points. A side without length
 * has the reciprocal infinity. */
PANDIS__INLINE void pandis__complete_triangles(pandis__triangles *f) {
    for (int i = 0; i < PANDIS__FOUR; i++) {
        double ux = f->u[0][i], uy = f->u[1][i], uz = f->u[2][i];
        double vx = f->v[0][i], vy = f->v[1][i], vz = f->v[2][i];
        double wx = f->w[0][i], wy = f->w[1][i], wz = f->w[2][i];
        double nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        double per_u = 1 / (ux * ux + uy * uy + uz * uz);
        double along = (nx * ux + ny * uy + nz * uz) * per_u;
        nx -= along * ux, ny -= along * uy, nz -= along * uz;
        f->n[0][i] = nx, f->n[1][i] = ny, f->n[2][i] = nz;
        f->per_u[i] = per_u, f->per_v[i] = 1 / (vx * vx + vy * vy + vz * vz);
        f->per_w[i] = 1 / (wx * wx + wy * wy + wz * wz);
        f->per_n[i] = 1 / (nx * nx + ny * ny + nz * nz);
    }
}

/* Compute the squared distances to four triangles. */
PANDIS__INLINE void pandis__four_distances(const pandis__triangles *PANDIS__RESTRICT f,
    const double *PANDIS__RESTRICT p, double *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__FOUR; i++) {
        double x = p[0] - f->a[0][i], y = p[1] - f->a[1][i], z = p[2] - f->a[2][i];
        double ux = f->u[0][i], uy = f->u[1][i], uz = f->u[2][i];
        double vx = f->v[0][i], vy = f->v[1][i], vz = f->v[2][i];
        double wx = f->w[0][i], wy = f->w[1][i], wz = f->w[2][i];
        double nx = f->n[0][i], ny = f->n[1][i], nz = f->n[2][i];
        double bx = x - ux, by = y - uy, bz = z - uz;
        /* on a side without length 0 * infinity = NaN, which counts as 0; for a face without area,
         * the foot counts as outside */
        double s = pandis__clamp01((ux * x + uy * y + uz * z) * f->per_u[i]);
        double rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        double best = rx * rx + ry * ry + rz * rz;
        s = pandis__clamp01((vx * x + vy * y + vz * z) * f->per_v[i]);
        rx = x - s * vx, ry = y - s * vy, rz = z - s * vz;
        double d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        s = pandis__clamp01((wx * bx + wy * by + wz * bz) * f->per_w[i]);
        rx = bx - s * wx, ry = by - s * wy, rz = bz - s * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        /* distances from the sides, times length and area: see pandis__inner_foot */
        double cx = y * nz - z * ny, cy = z * nx - x * nz, cz = x * ny - y * nx;
        double qx = by * nz - bz * ny, qy = bz * nx - bx * nz, qz = bx * ny - by * nx;
        double height = nx * x + ny * y + nz * z;
        d = height * height * f->per_n[i];
        int inside = (ux * cx + uy * cy + uz * cz >= 0) & (vx * cx + vy * cy + vz * cz <= 0) &
            (wx * qx + wy * qy + wz * qz >= 0);
        out[i] = inside && d < best ? d : best;
    }
}

/* Compute the squared distances to four faces in double precision. Among faces that are about
 * equally near, the smallest of these numbers decides. */
PANDIS__INLINE void pandis__four_squared(const pandis__mesh *t, const int32_t *faces,
    const double *PANDIS__RESTRICT p, double *PANDIS__RESTRICT out) {
    pandis__triangles four;
    for (int i = 0; i < PANDIS__FOUR; i++)
        pandis__set_triangle(&four, i, pandis__corner(t, faces[i], 0),
            pandis__corner(t, faces[i], 1), pandis__corner(t, faces[i], 2));
    pandis__complete_triangles(&four), pandis__four_distances(&four, p, out);
}

/* Store the feature that contains the closest point. */
static void pandis__keep_feature(
    const double *const *c, const pandis__foot *foot, pandis__start *begin) {
    begin->round = foot->corner >= 0 || foot->edge >= 0;
    if (foot->edge < 0) return;
    for (int k = 0; k < 3; k++) begin->along[k] = c[(foot->edge + 1) % 3][k] - c[foot->edge][k];
    (void)pandis__normalise(begin->along);
}

static void pandis__find_mesh_foot(
    const pandis__mesh *t, int32_t face, const double *p, pandis__foot *foot) {
    const double *c[3];
    for (int k = 0; k < 3; k++) c[k] = pandis__corner(t, face, k);
    pandis__find_foot(c, p, foot);
}

/* Add a face's normal, weighted by the angle at its k-th corner, to the normal of that corner. */
static void pandis__corner_normal(
    const pandis__mesh *t, int32_t face, int k, const double *n, double *sum) {
    const double *p = pandis__corner(t, face, k), *q = pandis__corner(t, face, (k + 1) % 3);
    const double *s = pandis__corner(t, face, (k + 2) % 3);
    double u[3], v[3], c[3];
    for (int i = 0; i < 3; i++) u[i] = q[i] - p[i], v[i] = s[i] - p[i];
    pandis__cross(u, v, c);
    double angle = atan2(sqrt(pandis__dot(c, c)), pandis__dot(u, v));
    for (int i = 0; i < 3; i++) sum[i] += angle * n[i];
}

/* Get the normal of a vertex: the stored one or, if the mesh moves, that of its current faces. */
static void pandis__vertex_normal(const pandis__mesh *t, int32_t vertex, double *n) {
    if (!t->around) {
        memcpy(n, t->vertex_normals + 3 * (ptrdiff_t)vertex, 3 * sizeof *n);
        return;
    }
    n[0] = n[1] = n[2] = 0;
    for (int32_t i = t->around[vertex]; i < t->around[vertex + 1]; i++) {
        int32_t at = t->corners_at[i];
        double m[3];
        if (pandis__face_normal(t, at / 3, m)) pandis__corner_normal(t, at / 3, at % 3, m, n);
    }
    (void)pandis__normalise(n);
}

/* Compute the angle-weighted pseudonormal, of unit length, of the feature that contains the closest
 * point. */
static void pandis__pseudonormal(
    const pandis__mesh *t, int32_t face, const pandis__foot *foot, double *n) {
    if (foot->corner >= 0) {
        pandis__vertex_normal(t, t->faces[3 * (ptrdiff_t)face + foot->corner], n);
        if (pandis__dot(n, n) > 0) return;
    }
    int known = pandis__face_normal(t, face, n);
    int32_t other = foot->edge >= 0 ? t->neighbours[3 * (ptrdiff_t)face + foot->edge] : -1;
    double m[3];
    if (other >= 0 && pandis__face_normal(t, other, m)) {
        for (int k = 0; k < 3; k++) n[k] = known ? n[k] + m[k] : m[k];
        known = pandis__normalise(n);
    }
    if (!known) n[0] = n[1] = 0, n[2] = 1;
}

/* Whether no coordinate of a point exceeds the vertices' largest coordinate. A point beyond that is
 * outside: very far away all triangles are about equally near, so their normals do not determine
 * the side. */
static int pandis__within(const pandis__mesh *t, const double *p) {
    return fabs(p[0]) <= t->reach && fabs(p[1]) <= t->reach && fabs(p[2]) <= t->reach;
}

static double pandis__sign(
    const pandis__mesh *t, const double *p, const pandis__foot *foot, const double *n) {
    return pandis__within(t, p) && pandis__dot(foot->offset, n) < 0 ? -1 : 1;
}

/* -------------------- the nearest face of a mesh
 *
 * Candidates for the nearest face are found in single precision, leaf by leaf. The nearest of them
 * is then chosen in double precision. */

/* The keys of a node's boxes: lower bounds of the squared distances to their contents. */
PANDIS__INLINE void pandis__box_keys(const pandis__node *PANDIS__RESTRICT n,
    const float *PANDIS__RESTRICT p, int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH];
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float sum = 0;
        for (int k = 0; k < 3; k++) {
            float below = n->low[k][i] - p[k], above = p[k] - n->high[k][i];
            float d = below > above ? below : above;
            d = d > 0 ? d : 0;
            sum += d * d;
        }
        out[i] = sum * 0.99999f; /* more than the rounding of all of the above */
    }
    memcpy(keys, out, sizeof out);
    for (int i = 0; i < PANDIS__WIDTH; i++)
        keys[i] = n->low[0][i] > n->high[0][i] ? INT32_MAX : (keys[i] & ~7) | i;
}

/* Raise the keys of a node's boxes to the squared distances from the slabs of their contents. */
PANDIS__INLINE void pandis__slab_keys(const pandis__slabs *PANDIS__RESTRICT s,
    const float *PANDIS__RESTRICT p, int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH], rounding = 1e-6f * (fabsf(p[0]) + fabsf(p[1]) + fabsf(p[2]));
    int32_t raised[PANDIS__WIDTH];
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float at = s->normal[0][i] * p[0] + s->normal[1][i] * p[1] + s->normal[2][i] * p[2];
        float below = s->low[i] - at, above = at - s->high[i];
        float d = (below > above ? below : above) - rounding;
        d = d > 0 ? d : 0;
        out[i] = d * d * 0.99999f;
    }
    memcpy(raised, out, sizeof raised);
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        raised[i] = (raised[i] & ~7) | i;
        keys[i] = raised[i] > keys[i] ? raised[i] : keys[i];
    }
}

/* The key of a search limit: boxes with larger keys are farther. */
static int32_t pandis__limit_key(double limit) {
    double squared = limit * limit * (1 + 1e-6);
    return squared < 3e38 ? pandis__key((float)squared) : INT32_MAX - 1;
}

#define PANDIS__MAYBE 12 /* capacity of the queue of faces that wait for double precision */

/* State of a search for the nearest face: an upper bound of its distance; the nearest face computed
 * in double precision, and its squared distance; how many nodes, leaves and faces may still be
 * visited; the key of the nearest box that was not; and the waiting faces, with their squared
 * distances in single precision. */
typedef struct {
    double limit, squared;
    int32_t face, left, unseen;
    int count;
    struct {
        double seems;
        float slack[2];
        int32_t face;
    } maybe[PANDIS__MAYBE];
} pandis__seeking;

/* Largest squared distance that a face within a limit can have in single precision. */
static double pandis__may_seem(double limit, const float *slack) {
    double most = (limit + (double)slack[0]) * (1 + 2 * (double)slack[1]);
    return most * most * (1 + 1e-6);
}

/* Compute the distances to the waiting faces in double precision. */
PANDIS__INLINE void pandis__settle(const pandis__mesh *t, const double *p, pandis__seeking *s) {
    double squared[PANDIS__FOUR];
    int32_t faces[PANDIS__FOUR];
    for (int i = 0; i < s->count;) {
        int some = 0;
        for (; i < s->count && some < PANDIS__FOUR; i++)
            if (s->maybe[i].seems <= pandis__may_seem(s->limit, s->maybe[i].slack))
                faces[some++] = s->maybe[i].face;
        if (!some) break;
        for (int k = some; k < PANDIS__FOUR; k++) faces[k] = faces[0];
        pandis__four_squared(t, faces, p, squared);
        for (int k = 0; k < some; k++) {
            if (!(squared[k] < s->squared || (squared[k] == s->squared && faces[k] < s->face)))
                continue;
            s->squared = squared[k], s->face = faces[k];
            double d = sqrt(squared[k]) * (1 + 1e-12);
            s->limit = d < s->limit ? d : s->limit;
        }
    }
    s->count = 0;
}

/* The vertices of the eight triangles of a leaf, for a mesh that moves. They are stored after the
 * lists of corners at each vertex. */
static const int32_t *pandis__leaf_vertices(const pandis__mesh *t, ptrdiff_t leaf) {
    return t->corners_at + 3 * (ptrdiff_t)t->face_count + 3 * PANDIS__WIDTH * leaf;
}

/* The triangles of a leaf whose vertices have moved, relative to a point. */
PANDIS__APART static void pandis__moved_triangles(
    const pandis__mesh *t, ptrdiff_t leaf, const double *p, float (*out)[3][PANDIS__WIDTH]) {
    const int32_t *vertex = pandis__leaf_vertices(t, leaf);
    for (int i = 0; i < PANDIS__WIDTH; i++)
        for (int c = 0; c < 3; c++) {
            const double *at = t->vertices + 3 * (ptrdiff_t)*vertex++;
            for (int k = 0; k < 3; k++) out[c][k][i] = (float)(at[k] - p[k]);
        }
}

/* Compute squared distances to the triangles of a leaf in single precision, and their error bounds.
 * Returns the smallest squared distance. If single precision cannot represent the squares, they are
 * set to zero, and -1 is returned. */
PANDIS__INLINE double pandis__seem(
    const pandis__mesh *t, const pandis__leaf *leaf, const double *p, double *seems, float *slack) {
    float v[3][3][PANDIS__WIDTH], q[3] = {0, 0, 0}, d[PANDIS__WIDTH] = {0};
    double step = t->around ? 1 : (double)leaf->step, per_step = 1 / step;
    int small = 1;
    slack[0] = leaf->slack, slack[1] = leaf->share;
    if (t->around) {
        pandis__moved_triangles(t, leaf - t->leaves, p, v);
        memcpy(slack, t->slacks[leaf - t->leaves], sizeof t->slacks[0]);
        for (int k = 0; k < 3; k++) small &= fabs(p[k]) + t->reach < 1e15;
    } else {
        for (int c = 0; c < 9; c++)
            for (int i = 0; i < PANDIS__WIDTH; i++)
                v[c / 3][c % 3][i] = (float)(int32_t)leaf->corner[c / 3][c % 3][i];
        for (int k = 0; k < 3; k++) {
            double at = (p[k] - (double)leaf->origin[k]) * per_step;
            q[k] = (float)at, small &= fabs(at) < 1e15;
        }
    }
    if (small) pandis__eight_distances(v, q, d);
    float least = d[0];
    for (int i = 0; i < PANDIS__WIDTH; i++)
        least = d[i] < least ? d[i] : least, seems[i] = (double)d[i] * (step * step);
    return small ? (double)least * (step * step) : -1;
}

/* Collect the triangles of a leaf that may be nearest. Returns what `pandis__seem` does. */
PANDIS__INLINE double pandis__look_into(
    const pandis__mesh *t, const pandis__leaf *leaf, const double *p, pandis__seeking *s) {
    double seems[PANDIS__WIDTH], farthest;
    float slack[2];
    double least = pandis__seem(t, leaf, p, seems, slack);
    s->left--;
    if (least > pandis__may_seem(s->limit, slack)) return least;
    farthest =
        least >= 0 ? sqrt(least) * (1 + (double)slack[1]) + (double)slack[0] : (double)INFINITY;
    if (farthest < s->limit) s->limit = farthest;
    farthest = pandis__may_seem(s->limit, slack);
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        if (seems[i] > farthest || leaf->face[i] < 0) continue;
        if (s->count == PANDIS__MAYBE) pandis__settle(t, p, s);
        s->left--;
        s->maybe[s->count].seems = seems[i], s->maybe[s->count].face = leaf->face[i];
        memcpy(s->maybe[s->count++].slack, slack, sizeof slack);
    }
    return least;
}

/* Descend with a budget of nodes, leaves and faces, the nearest box first. Boxes whose contents are
 * less than `gap` nearer than the nearest face so far are skipped; `unseen` is the key of the
 * nearest box that was not opened. Slabs are read in later searches: most end before they pay. */
PANDIS__INLINE void pandis__descend_body(
    const pandis__mesh *t, const double *p, double gap, int32_t left, pandis__seeking *s) {
    struct {
        int32_t keys[PANDIS__WIDTH], node;
    } path[PANDIS__DEEPEST], *at = path;
    float q[3] = {(float)p[0], (float)p[1], (float)p[2]};
    int32_t within = pandis__limit_key(s->limit > gap ? s->limit - gap : 0);
    int with_slabs = t->slabs && left > PANDIS__SOON && left < INT32_MAX;
    s->left = left, s->unseen = INT32_MAX, at->node = 0;
    pandis__box_keys(t->nodes, q, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = t->nodes[at->node].child[key & 7];
        /* box skipped, or budget spent: the rest is at least this far away */
        if (key > within || s->left < 0) {
            s->unseen = key < s->unseen ? key : s->unseen;
            if (at == path) return;
            at--;
            continue;
        }
        at->keys[key & 7] = INT32_MAX;
        if (child >= 0) {
            s->left--;
            (++at)->node = child;
            pandis__box_keys(t->nodes + child, q, at->keys);
            if (with_slabs) pandis__slab_keys(t->slabs + child, q, at->keys);
        } else {
            pandis__look_into(t, t->leaves + ~child, p, s);
            within = pandis__limit_key(s->limit > gap ? s->limit - gap : 0);
        }
    }
}

PANDIS__COMPILE(pandis__descend,
    (const pandis__mesh *t, const double *p, double gap, int32_t left, pandis__seeking *s),
    (t, p, gap, left, s))

/* Whether a face that was not seen may be nearer than the nearest one so far. */
static int pandis__cut_short(const pandis__seeking *s) {
    return s->unseen <= pandis__limit_key(s->limit);
}

/* Choose the nearest face within `limit` from those that a search has collected. */
PANDIS__INLINE void pandis__choose(
    const pandis__mesh *t, const double *p, double limit, pandis__seeking *s) {
    int kept = 0;
    for (int i = 0; i < s->count; i++)
        if (s->maybe[i].seems <= pandis__may_seem(s->limit, s->maybe[i].slack))
            s->maybe[kept++] = s->maybe[i];
    s->count = kept;
    /* the only candidate is certainly nearer than the limit */
    if (kept == 1 && s->face == INT32_MAX && s->limit < limit) s->face = s->maybe[0].face;
    else pandis__settle(t, p, s);
}

/* Find the nearest face within `limit`, by its distance in double precision; INT32_MAX if there is
 * none. If the search was cut short, `clear` becomes a lower bound of the distances to all other
 * faces; else infinite. With a limit it ends early, and the caller repeats it without. The budget
 * is small unless a face may be close. Once it is spent, more and more boxes are skipped until a
 * search ends within its own budget, which bounds by how much a face can be nearer. */
static int32_t pandis__nearest(
    const pandis__mesh *t, const double *p, double limit, double *clear) {
    pandis__seeking s;
    int again = t->most < INT32_MAX && !(limit < (double)INFINITY);
    s.limit = limit, s.squared = limit * limit, s.face = INT32_MAX, s.count = 0;
    pandis__descend(t, p, 0, t->most < INT32_MAX ? PANDIS__SOON : INT32_MAX, &s);
    int away = s.limit > PANDIS__CLOSE;
    while (again && pandis__cut_short(&s)) {
        pandis__descend(t, p, 0, away ? pandis__few(t->most) : t->most, &s);
        if (!pandis__cut_short(&s)) break;
        int32_t unseen = s.unseen;
        /* keys have the rounding of single precision, so the doubt grows with the distance */
        for (double gap = PANDIS__DOUBT + 2e-5 * s.limit;; gap = fmax(4 * gap, s.limit / 16)) {
            pandis__descend(t, p, gap, PANDIS__CERTAIN, &s);
            unseen = unseen > s.unseen ? unseen : s.unseen;
            if (s.left >= 0 || gap >= s.limit) break;
        }
        s.unseen = unseen;
        again = away && unseen <= pandis__limit_key(PANDIS__CLOSE);
        away = 0;
    }
    pandis__choose(t, p, limit, &s);
    *clear = pandis__cut_short(&s) ? pandis__distance_of(s.unseen) : (double)INFINITY;
    return s.face;
}

/* Bit mask of a node's boxes that a segment meets beyond the share `from` of its length. */
static int pandis__nodes_between(
    const pandis__node *node, const double *p, const double *way, double from) {
    int met = 0;
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        double enter = from, leave = 1;
        for (int k = 0; k < 3; k++) {
            double low = (double)node->low[k][i] - p[k], high = (double)node->high[k][i] - p[k];
            double a = low / way[k], b = high / way[k], first = a < b ? a : b, last = a < b ? b : a;
            if (way[k] == 0) first = low <= 0 && high >= 0 ? from : 2, last = 1;
            enter = first > enter ? first : enter, leave = last < leave ? last : leave;
        }
        met |= (enter <= leave && !(node->low[0][i] > node->high[0][i])) << i;
    }
    return met;
}

/* Find the side of a point (-1: inside) from the first face on the segment to a target. The segment
 * is free up to the share `from` of its length. If it meets too many faces, the target's face
 * decides. */
PANDIS__APART static double pandis__first_sign(
    const pandis__mesh *t, const double *p, const double *target, const double *n, double from) {
    int32_t stack[PANDIS__STACK], left = t->most;
    double way[3], nearest = 1;
    int top = 1;
    for (int k = 0; k < 3; k++) way[k] = target[k] - p[k];
    double own = pandis__dot(n, way) > 0 ? -1 : 1, sign = own;
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (--left < 0) return own;
        if (child >= 0) {
            int met = pandis__nodes_between(t->nodes + child, p, way, from);
            for (int i = 0; i < PANDIS__WIDTH; i++)
                if (met >> i & 1) stack[top++] = t->nodes[child].child[i];
            continue;
        }
        const pandis__leaf *leaf = t->leaves + ~child;
        for (int i = 0; i < PANDIS__WIDTH && leaf->face[i] >= 0; i++) {
            const double *c[3];
            double at;
            for (int k = 0; k < 3; k++) c[k] = pandis__corner(t, leaf->face[i], k);
            int side = pandis__meets(c, p, way, &at);
            if (side && at < nearest) nearest = at, sign = side;
        }
    }
    return sign;
}

/* Find the sign of a point after a search that was cut short: other faces may be nearer, but not
 * nearer than `clear`. */
static double pandis__cut_sign(
    const pandis__mesh *t, const double *p, int32_t face, const pandis__foot *foot, double clear) {
    double target[3], n[3]; /* next to the foot, within the face */
    if (!(foot->distance > 0) || !pandis__face_normal(t, face, n)) return 1;
    for (int k = 0; k < 3; k++) {
        double middle = (pandis__corner(t, face, 0)[k] + pandis__corner(t, face, 1)[k] +
                            pandis__corner(t, face, 2)[k]) /
            3;
        double at = p[k] - foot->offset[k];
        target[k] = at + 1e-3 * (middle - at);
    }
    return pandis__first_sign(t, p, target, n, 0.999 * clear / foot->distance);
}

PANDIS__APART static pandis_flag pandis__answer_mesh(const pandis__mesh *t, const double *u,
    pandis__start *begin, double *distance, double *normal, double *clear) {
    pandis__foot foot;
    /* search up to the reach, plus a margin for the errors of leaves with sliver triangles */
    double limit =
        begin->reach < 1e18 ? begin->reach * (1 + 1e-6) + 1e-5 * t->reach : (double)INFINITY;
    int32_t face = pandis__nearest(t, u, limit, clear);
    int cut = *clear < (double)INFINITY;
    if (face == INT32_MAX && limit < (double)INFINITY && !cut) {
        *clear = begin->reach;
        return PANDIS_BEYOND;
    }
    /* a search with a limit may find another face if it is cut short: repeat it without a limit */
    if (cut && limit < (double)INFINITY) face = pandis__nearest(t, u, (double)INFINITY, clear);
    if (face == INT32_MAX) return PANDIS_INVALID;
    double n[3], sign;
    cut = *clear < (double)INFINITY;
    const double *corner[3] = {
        pandis__corner(t, face, 0), pandis__corner(t, face, 1), pandis__corner(t, face, 2)};
    pandis__find_mesh_foot(t, face, u, &foot);
    pandis__keep_feature(corner, &foot, begin);
    begin->face = begin->place = face;
    pandis__pseudonormal(t, face, &foot, n);
    sign = pandis__sign(t, u, &foot, n);
    if (cut && pandis__within(t, u)) sign = pandis__cut_sign(t, u, face, &foot, *clear);
    *distance = sign * foot.distance;
    *clear = *clear < foot.distance ? *clear : foot.distance;
    /* closer than this, the quotient loses too many digits */
    for (int k = 0; k < 3; k++)
        normal[k] = foot.distance > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return !(fabs(u[0]) <= 1 && fabs(u[1]) <= 1 && fabs(u[2]) <= 1) ? PANDIS_BOUND
        : cut                                                       ? PANDIS_CUT
                                                                    : PANDIS_OK;
}
/* -------------------- closest points of a packed mesh
 *
 * The mesh's vertices lie on a lattice. Its faces are stored in blocks of up to 64. Each block
 * has its own corners, in as few bits as possible, and eight boxes around eight faces each; a tree
 * of eight-wide branches leads to the blocks. The nearest face is found in single precision,
 * relative to the block; its closest point and the answer are then computed in double precision.
 *
 * The side of a point whose closest point lies on an edge or a corner: all points with that closest
 * point form a convex cone that the surface does not enter, so they are on the same side. Two bits
 * store this side, so no neighbouring face is needed. Where the faces around the edge or corner are
 * nearly coplanar, and inside faces, the nearest face itself determines the side. Where rounding to
 * the lattice has folded the surface over itself, no face does; ray crossings are counted there. */

enum { PANDIS__BY_FACE, PANDIS__OUTSIDE, PANDIS__INSIDE, PANDIS__BY_RAY };

typedef struct {
    /* sides: NULL if every face determines the side */
    const unsigned char *boxes, *faces, *words, *sides;
    int32_t origin[3];
    int face_count, groups, corner_count, bits[3], stride; /* stride: bytes of a corner's word */
    int shift[3];                                          /* of its boxes */
} pandis__packed;

#define PANDIS__GROUP_BYTES 18 /* three times eight corners of six bits */

/* Shift of a box's byte coordinates, if extents need this many bits. */
static int pandis__coarse(int bits) { return bits > 8 ? bits - 8 : 0; }

PANDIS__INLINE void pandis__unpack(const pandis__compact *t, int32_t block, pandis__packed *b) {
    const pandis__block_record *record = t->blocks + block;
    b->face_count = (int)(record->counts & 63) + 1,
    b->corner_count = (int)(record->counts >> 6 & 63) + 1;
    b->groups = (b->face_count + PANDIS__WIDTH - 1) / PANDIS__WIDTH;
    for (int k = 0; k < 3; k++) {
        b->bits[k] = (int)(record->counts >> (12 + 5 * k) & 31);
        b->origin[k] = (int32_t)(record->origin >> (21 * k) & 0x1fffff);
        b->shift[k] = pandis__coarse(b->bits[k]);
    }
    b->stride = (b->bits[0] + b->bits[1] + b->bits[2]) / 8 + 1;
    b->boxes = t->packed + record->start;
    b->faces = b->boxes + 6 * PANDIS__WIDTH;
    b->words = b->faces + PANDIS__GROUP_BYTES * b->groups;
    b->sides = record->counts >> 27 & 1 ? b->words + b->stride * b->corner_count : NULL;
}

/* One of the three corners of eight faces: six bits each, an index into the block's corners. */
PANDIS__INLINE uint64_t pandis__six_bits(const unsigned char *bytes) {
    uint32_t low;
    uint16_t high;
    memcpy(&low, bytes, sizeof low), memcpy(&high, bytes + 4, sizeof high);
    return (uint64_t)high << 32 | low;
}

/* A corner's word: its coordinates one after the other, x from the lowest bit on. */
PANDIS__INLINE uint64_t pandis__word(const pandis__packed *b, int corner) {
    uint64_t word;
    memcpy(&word, b->words + b->stride * corner, sizeof word);
    return word;
}

/* Read the corners of eight faces, relative to the block's origin: (3 corners, 3 axes, 8). */
PANDIS__INLINE void pandis__group_corners(
    const pandis__packed *b, int group, float (*out)[3][PANDIS__WIDTH]) {
    const unsigned char *faces = b->faces + PANDIS__GROUP_BYTES * group;
    uint32_t xy[PANDIS__WIDTH], z[PANDIS__WIDTH], mask[3];
    int second = b->bits[0], third = second + b->bits[1];
    for (int k = 0; k < 3; k++) mask[k] = (1u << b->bits[k]) - 1;
    for (int c = 0; c < 3; c++) {
        uint64_t codes = pandis__six_bits(faces + 6 * c);
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            uint64_t word = pandis__word(b, (int)(codes >> 6 * i & 63));
            xy[i] = (uint32_t)word, z[i] = (uint32_t)(word >> third);
        }
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            out[c][0][i] = (float)(int32_t)(xy[i] & mask[0]);
            out[c][1][i] = (float)(int32_t)(xy[i] >> second & mask[1]);
            out[c][2][i] = (float)(int32_t)(z[i] & mask[2]);
        }
        if (third > 32)
            for (int i = 0; i < PANDIS__WIDTH; i++)
                out[c][1][i] =
                    (float)(int32_t)(pandis__word(b, (int)(codes >> 6 * i & 63)) >> second &
                        mask[1]);
    }
}

/* The keys of eight boxes: lower bounds of the squared distances to the faces in them. */
PANDIS__INLINE void pandis__byte_bounds(const unsigned char *PANDIS__RESTRICT boxes, int count,
    const int *shift, const float *PANDIS__RESTRICT q, int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH];
    float place[6 * PANDIS__WIDTH], scale[3], low[3], high[3];
    /* so that gcc uses vectors */
    for (int i = 0; i < 6 * PANDIS__WIDTH; i++) place[i] = (float)(int32_t)(uint32_t)boxes[i];
    for (int k = 0; k < 3; k++) {
        scale[k] = (float)(1 << shift[k]);
        float slack = 1e-6f * (fabsf(q[k]) + 256 * scale[k]);
        low[k] = q[k] + slack, high[k] = q[k] - slack;
    }
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float below = place[0 * PANDIS__WIDTH + i] * scale[0] - low[0],
              above = high[0] - place[3 * PANDIS__WIDTH + i] * scale[0];
        float x = below > above ? below : above;
        below = place[1 * PANDIS__WIDTH + i] * scale[1] - low[1],
        above = high[1] - place[4 * PANDIS__WIDTH + i] * scale[1];
        float y = below > above ? below : above;
        below = place[2 * PANDIS__WIDTH + i] * scale[2] - low[2],
        above = high[2] - place[5 * PANDIS__WIDTH + i] * scale[2];
        float z = below > above ? below : above;
        x = x > 0 ? x : 0, y = y > 0 ? y : 0, z = z > 0 ? z : 0;
        out[i] = (x * x + y * y + z * z) * 0.99999f;
    }
    memcpy(keys, out, sizeof out);
    for (int i = 0; i < PANDIS__WIDTH; i++) keys[i] = i < count ? (keys[i] & ~7) | i : INT32_MAX;
}

/* Squared distances to the eight triangles of a group. Their normals are exact as long as sides are
 * shorter than 2^12 steps. The error of the closest point inside a triangle is that of rounding,
 * divided by the sine of the triangle's narrowest angle. */
PANDIS__INLINE void pandis__group_distances(const pandis__packed *b, int group,
    const float *PANDIS__RESTRICT q, float *PANDIS__RESTRICT out) {
    float v[3][3][PANDIS__WIDTH];
    pandis__group_corners(b, group, v);
    pandis__eight_distances(v, q, out);
}
/* -------------------- answers of a packed mesh */

/* State of a search: the nearest face so far (squared distance, its key, and block * 64 + place),
 * the remaining budget of groups and blocks, and the key of the nearest group or block that was not
 * visited. */
typedef struct {
    float squared;
    int32_t key, face, left, unseen;
} pandis__near;

PANDIS__INLINE void pandis__search_block(
    const pandis__compact *t, int32_t block, const double *p, pandis__near *best) {
    pandis__packed b;
    float q[3], d[PANDIS__WIDTH];
    int32_t keys[PANDIS__WIDTH], key, nearest[PANDIS__WIDTH];
    pandis__unpack(t, block, &b);
    for (int k = 0; k < 3; k++) q[k] = (float)(p[k] - b.origin[k]);
    pandis__byte_bounds(b.boxes, b.groups, b.shift, q, keys);
    best->left--;
    while ((key = pandis__least(keys)) <= best->key) {
        int group = key & 7, i = 0;
        if (--best->left < 0) {
            best->unseen = key < best->unseen ? key : best->unseen;
            return;
        }
        keys[group] = INT32_MAX;
        pandis__group_distances(&b, group, q, d);
        memcpy(nearest, d, sizeof nearest);
        int32_t least = pandis__least(nearest),
                face = PANDIS__BLOCK * block + PANDIS__WIDTH * group;
        if (least > (best->key | 7)) continue;
        while (nearest[i] != least) i++;
        if (d[i] < best->squared || (d[i] == best->squared && face + i < best->face))
            best->squared = d[i], best->key = pandis__key(d[i]), best->face = face + i;
    }
}

PANDIS__INLINE void pandis__branch_keys(
    const pandis__branch *branch, const double *p, int32_t *keys) {
    float q[3];
    int shift[3];
    for (int k = 0; k < 3; k++)
        q[k] = (float)(p[k] - branch->origin[k]), shift[k] = branch->shift[k];
    pandis__byte_bounds(branch->boxes[0], branch->count, shift, q, keys);
}

/* Descend depth-first, the nearest branch first; for most points this finds the nearest face early.
 */
PANDIS__INLINE void pandis__search_depth_body(
    const pandis__compact *t, const double *p, pandis__near *best) {
    struct {
        int32_t keys[PANDIS__WIDTH];
        const pandis__branch *branch;
    } path[PANDIS__DEEPEST], *at = path;
    at->branch = t->branches;
    pandis__branch_keys(at->branch, p, at->keys);
    for (;;) {
        int32_t key = pandis__least(at->keys), child = at->branch->child[key & 7];
        if (best->left < 0) { /* budget spent: the rest is at least this far away */
            best->unseen = key < best->unseen ? key : best->unseen;
            if (at-- == path) return;
        } else if (key > best->key) {
            if (at-- == path) return;
        } else {
            at->keys[key & 7] = INT32_MAX;
            if (child < 0) {
                pandis__search_block(t, ~child, p, best);
            } else {
                (++at)->branch = t->branches + child;
                pandis__branch_keys(at->branch, p, at->keys);
            }
        }
    }
}

PANDIS__COMPILE(pandis__search_depth,
    (const pandis__compact *t, const double *p, pandis__near *best), (t, p, best))

/* Search best-first, so that little is missed when the budget is spent. */
PANDIS__INLINE void pandis__search_best_body(
    const pandis__compact *t, const double *p, pandis__near *best) {
    pandis__waiting heap[PANDIS__HEAP];
    int count = 1;
    heap[0].key = heap[0].child = 0;
    best->unseen = INT32_MAX;
    while (count) {
        pandis__waiting e = pandis__next(heap, count--);
        if (e.key > best->key) return;
        if (best->left < 0) {
            best->unseen = e.key < best->unseen ? e.key : best->unseen;
            return;
        }
        if (e.child < 0) {
            pandis__search_block(t, ~e.child, p, best);
            continue;
        }
        const pandis__branch *branch = t->branches + e.child;
        int32_t keys[PANDIS__WIDTH];
        best->left--;
        pandis__branch_keys(branch, p, keys);
        for (int i = 0; i < branch->count; i++) {
            int32_t out;
            if (keys[i] <= best->key &&
                pandis__wait_or_drop(heap, &count, keys[i], branch->child[i], &out))
                best->unseen = out < best->unseen ? out : best->unseen;
        }
    }
}

PANDIS__COMPILE(pandis__search_best,
    (const pandis__compact *t, const double *p, pandis__near *best), (t, p, best))

/* Find the face nearest to a point (in lattice steps). Returns block * 64 + place, or INT32_MAX if
 * no face is within `reach` (steps). If the search was cut short, `clear` becomes a lower bound of
 * the squared distances to all other faces; else infinite. */
static int32_t pandis__search(
    const pandis__compact *t, const double *p, double reach, float *clear) {
    int32_t soon = pandis__soon(t->most);
    pandis__near best = {FLT_MAX, INT32_MAX - 1, INT32_MAX, soon, INT32_MAX};
    if (reach < 1e18) best.squared = (float)(reach * reach), best.key = pandis__key(best.squared);
    pandis__search_depth(t, p, &best);
    if (best.unseen <= best.key && soon < t->most) {
        best.left = t->most - soon;
        pandis__search_best(t, p, &best);
    }
    *clear = (float)INFINITY;
    if (best.unseen <= best.key) best.unseen &= ~7, memcpy(clear, &best.unseen, sizeof *clear);
    return best.face;
}

/* Read the position of a block's corner, in lattice steps. */
static void pandis__packed_corner(const pandis__packed *b, int corner, double *out) {
    uint64_t word = pandis__word(b, corner);
    for (int k = 0; k < 3; word >>= b->bits[k++])
        out[k] = b->origin[k] + (double)(word & ((1u << b->bits[k]) - 1));
}

/* Read the corners of a face: their numbers in the block, and their positions. */
static void pandis__face_corners(
    const pandis__packed *b, int place, int *corners, double (*at)[3]) {
    const unsigned char *faces = b->faces + PANDIS__GROUP_BYTES * (place / PANDIS__WIDTH);
    for (int k = 0; k < 3; k++) {
        corners[k] = (int)(pandis__six_bits(faces + 6 * k) >> 6 * (place % PANDIS__WIDTH) & 63);
        pandis__packed_corner(b, corners[k], at[k]);
    }
}

/* An entry of a two-bit list. */
static int pandis__two_bits(const unsigned char *list, int at) {
    return list[at / 4] >> 2 * (at % 4) & 3;
}

/* Bit mask of the boxes (at most eight) that a ray from a point along x meets. */
static int pandis__boxes_ahead(const unsigned char *boxes, int count, const int32_t *origin,
    const int *shift, const double *p) {
    int met = 0;
    for (int i = 0; i < count; i++) {
        int ahead = p[0] <= (double)(origin[0] + (boxes[3 * PANDIS__WIDTH + i] << shift[0]));
        for (int k = 1; k < 3; k++)
            ahead &= p[k] >= (double)(origin[k] + (boxes[PANDIS__WIDTH * k + i] << shift[k])) &&
                p[k] <= (double)(origin[k] + (boxes[PANDIS__WIDTH * (3 + k) + i] << shift[k]));
        met |= ahead << i;
    }
    return met;
}

/* Twice the signed area that an edge and a point span, seen along x. The edge's two directions give
 * exactly opposite values, so that a ray close to the edge meets exactly one of its two faces. */
static double pandis__beside(const double *a, const double *b, const double *p) {
    int turn = a[1] > b[1] || (a[1] == b[1] && a[2] > b[2]);
    const double *s = turn ? b : a, *e = turn ? a : b;
    double area = (e[1] - s[1]) * (p[2] - s[2]) - (e[2] - s[2]) * (p[1] - s[1]);
    return turn ? -area : area;
}

/* Change of the winding number at a triangle, for a ray from a point along x. */
static int pandis__crossing(const double (*c)[3], const double *p) {
    double area[3], all = 0, x = 0;
    int left = 0;
    for (int k = 0; k < 3; k++) {
        const double *a = c[k], *b = c[(k + 1) % 3];
        area[k] = pandis__beside(a, b, p);
        /* a point on the edge counts as left of it if the edge leads upwards */
        left += area[k] > 0 || (area[k] == 0 && (a[1] < b[1] || (a[1] == b[1] && a[2] < b[2])));
        all += area[k];
    }
    if (left % 3 || !(all < 0 || all > 0)) return 0;
    for (int k = 0; k < 3; k++) x += c[(k + 2) % 3][0] * (area[k] / all);
    return x > p[0] ? (all > 0 ? 1 : -1) : 0;
}

/* Winding number of a point: exits minus entries of a ray along x through the faces. */
PANDIS__APART static int pandis__winding(const pandis__compact *t, const double *p) {
    int32_t stack[PANDIS__STACK];
    int top = 1, turns = 0, shift[3];
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (child >= 0) {
            const pandis__branch *branch = t->branches + child;
            for (int k = 0; k < 3; k++) shift[k] = branch->shift[k];
            int met =
                pandis__boxes_ahead(branch->boxes[0], branch->count, branch->origin, shift, p);
            for (int i = 0; i < branch->count; i++)
                if (met >> i & 1) stack[top++] = branch->child[i];
            continue;
        }
        pandis__packed b;
        pandis__unpack(t, ~child, &b);
        int met = pandis__boxes_ahead(b.boxes, b.groups, b.origin, b.shift, p);
        for (int place = 0; place < b.face_count; place++) {
            double c[3][3];
            int corners[3];
            if (!(met >> place / PANDIS__WIDTH & 1)) continue;
            pandis__face_corners(&b, place, corners, c);
            turns += pandis__crossing((const double (*)[3])c, p);
        }
    }
    return turns;
}

/* Bit mask of the boxes (at most eight) that a segment from a point meets beyond the share `from`
 * of its length. */
static int pandis__boxes_between(const unsigned char *boxes, int count, const int32_t *origin,
    const int *shift, const double *p, const double *way, double from) {
    int met = 0;
    for (int i = 0; i < count; i++) {
        double enter = from, leave = 1;
        for (int k = 0; k < 3; k++) {
            double low =
                (double)(origin[k] + (boxes[PANDIS__WIDTH * k + i] << shift[k])) - p[k] - 1e-6;
            double high = (double)(origin[k] + (boxes[PANDIS__WIDTH * (3 + k) + i] << shift[k])) -
                p[k] + 1e-6;
            double a = low / way[k], b = high / way[k], first = a < b ? a : b, last = a < b ? b : a;
            if (way[k] == 0) first = low <= 0 && high >= 0 ? from : 2, last = 1;
            enter = first > enter ? first : enter, leave = last < leave ? last : leave;
        }
        met |= (enter <= leave) << i;
    }
    return met;
}

/* Find the side of a point from the first face on the segment to a target. The segment is free up
 * to the share `from` of its length. If it meets too many faces, the target's face decides. */
PANDIS__APART static int pandis__first_side(
    const pandis__compact *t, const double *p, const double *target, const double *n, double from) {
    int32_t stack[PANDIS__STACK], left = t->most;
    double way[3], nearest = 1;
    int top = 1, shift[3];
    for (int k = 0; k < 3; k++) way[k] = target[k] - p[k];
    int own = pandis__dot(n, way) > 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE, side = own;
    stack[0] = 0;
    while (top) {
        int32_t child = stack[--top];
        if (child >= 0) {
            const pandis__branch *branch = t->branches + child;
            for (int k = 0; k < 3; k++) shift[k] = branch->shift[k];
            int met = pandis__boxes_between(
                branch->boxes[0], branch->count, branch->origin, shift, p, way, from);
            for (int i = 0; i < branch->count; i++)
                if (met >> i & 1) stack[top++] = branch->child[i];
            continue;
        }
        pandis__packed b;
        pandis__unpack(t, ~child, &b);
        int met = pandis__boxes_between(b.boxes, b.groups, b.origin, b.shift, p, way, from);
        for (int place = 0; place < b.face_count; place++) {
            double corner[3][3], at;
            const double *c[3] = {corner[0], corner[1], corner[2]};
            int corners[3];
            if (!(met >> place / PANDIS__WIDTH & 1)) continue;
            if (place % PANDIS__WIDTH == 0 && --left < 0) return own;
            pandis__face_corners(&b, place, corners, corner);
            int sign = pandis__meets(c, p, way, &at);
            if (sign && at < nearest)
                nearest = at, side = sign < 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
        }
    }
    return side;
}

/* How to find the side of a point with this closest point. */
static int pandis__tells(
    const pandis__packed *b, int place, const int *corners, const pandis__foot *foot) {
    int tells = PANDIS__BY_FACE;
    if (!b->sides) return tells;
    const unsigned char *edges = b->sides + (b->corner_count + 3) / 4,
                        *faces = edges + 6 * b->groups;
    if (foot->corner >= 0) tells = pandis__two_bits(b->sides, corners[foot->corner]);
    else if (foot->edge >= 0) tells = pandis__two_bits(edges, 3 * place + foot->edge);
    return tells == PANDIS__BY_FACE ? pandis__two_bits(faces, place) : tells;
}

/* Find the side of a point after a search that was cut short: other faces may be nearer, but not
 * nearer than `clear`. */
static int pandis__cut_side(const pandis__compact *t, const double *p, const double (*corner)[3],
    const pandis__foot *foot, const double *n, double clear) {
    double target[3]; /* next to the foot, within the face */
    if (!(foot->distance > 0)) return PANDIS__OUTSIDE;
    for (int k = 0; k < 3; k++) {
        double middle = (corner[0][k] + corner[1][k] + corner[2][k]) / 3,
               at = p[k] - foot->offset[k];
        target[k] = at + 1e-3 * (middle - at);
    }
    return pandis__first_side(t, p, target, n, 0.999 * clear / foot->distance);
}

PANDIS__APART static pandis_flag pandis__answer_compact(const pandis__compact *t, const double *u,
    pandis__start *begin, double *distance, double *normal, double *clear) {
    double p[3], corner[3][3], side[2][3], n[3], most = 0, size = t->step;
    const double *c[3] = {corner[0], corner[1], corner[2]};
    float unseen;
    for (int k = 0; k < 3; k++) most = fabs(u[k]) > most ? fabs(u[k]) : most;
    /* a very distant point has the same nearest face as a nearer point in the same direction */
    double nearer = most > 1024 ? 1024 / most : 1;
    for (int k = 0; k < 3; k++) p[k] = (u[k] * nearer + PANDIS__HALF) / t->step;
    /* a little beyond the reach: single precision may overestimate distances */
    double steps = nearer < 1 ? (double)INFINITY : (begin->reach * 1.0001 + 1e-3) / t->step;
    int32_t face = pandis__search(t, p, steps, &unseen);
    /* a search with a reach may find another face if it is cut short: repeat it without a reach */
    if (unseen < FLT_MAX && steps < 1e18)
        steps = (double)INFINITY, face = pandis__search(t, p, steps, &unseen);
    if (face == INT32_MAX && steps < 1e18) {
        *clear = begin->reach;
        return PANDIS_BEYOND;
    }
    if (face == INT32_MAX) return PANDIS_INVALID;
    begin->face = t->original ? t->original[face] : -1, begin->place = face;
    pandis__packed b;
    pandis__foot foot;
    pandis__unpack(t, face / PANDIS__BLOCK, &b);
    int place = face % PANDIS__BLOCK, corners[3], cut = unseen < FLT_MAX;
    pandis__face_corners(&b, place, corners, corner);
    if (nearer < 1) { /* in the unit frame, where squares do not overflow */
        size = 1;
        for (int k = 0; k < 3; k++) p[k] = u[k];
        for (int k = 0; k < 9; k++)
            corner[k / 3][k % 3] = corner[k / 3][k % 3] * t->step - PANDIS__HALF;
    }
    if (!pandis__inner_foot(c, p, (double)INFINITY, &foot)) pandis__rim_foot(c, p, &foot);
    pandis__keep_feature(c, &foot, begin);
    foot.distance = sqrt(pandis__dot(foot.offset, foot.offset));
    for (int k = 0; k < 3; k++)
        side[0][k] = corner[1][k] - corner[0][k], side[1][k] = corner[2][k] - corner[0][k];
    pandis__cross(side[0], side[1], n);
    if (!pandis__normalise(n)) n[0] = n[1] = 0, n[2] = 1;
    int tells = most > t->reach ? PANDIS__OUTSIDE : pandis__tells(&b, place, corners, &foot);
    if (cut && most <= t->reach)
        tells = pandis__cut_side(t, p, (const double (*)[3])corner, &foot, n, sqrt((double)unseen));
    if (tells == PANDIS__BY_RAY)
        tells = pandis__winding(t, p) > 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
    if (tells == PANDIS__BY_FACE)
        tells = pandis__dot(foot.offset, n) < 0 ? PANDIS__INSIDE : PANDIS__OUTSIDE;
    double sign = tells == PANDIS__INSIDE ? -1 : 1;
    *distance = sign * foot.distance * size;
    *clear = !cut ? foot.distance * size : nearer < 1 ? 0 : sqrt((double)unseen) * t->step;
    if (*clear > foot.distance * size) *clear = foot.distance * size;
    for (int k = 0; k < 3; k++)
        normal[k] = foot.distance * size > 1e-9 ? sign * (foot.offset[k] / foot.distance) : n[k];
    return most > 1 ? PANDIS_BOUND : cut ? PANDIS_CUT : PANDIS_OK;
}
/* -------------------- networks */

/* Reading the weights limits the speed of a network: prefetch the next rows while the current ones
 * are used. */
#if PANDIS__VECTOR > 1
#define PANDIS__FETCH(p) __builtin_prefetch(p)
#else
#define PANDIS__FETCH(p) ((void)(p))
#endif

/* Define a function for 32-bit and for 16-bit weights. */
#define PANDIS__KINDS(make)                                                                        \
    PANDIS__TWICE(make(pandis__load, float, f_plain, static)                                       \
                      make(pandis__load16, int16_t, h_plain, static),                              \
        make(pandis__load, float, f_wide, PANDIS__WIDE static)                                     \
            make(pandis__load16_wide, int16_t, h_wide, PANDIS__WIDE static))

/* out <- out + the sum over rows of h[i] * weights[i], four rows at once. */
#define PANDIS__ADD(load, type, tail, how)                                                         \
    how void pandis__add_##tail(const type *w, const float *h, int rows, int stride, float *out) { \
        int i = 0;                                                                                 \
        for (; i + 4 <= rows; i += 4, w += 4 * (ptrdiff_t)stride) {                                \
            float a = h[i], b = h[i + 1], c = h[i + 2], d = h[i + 3];                              \
            const type *next = i + 8 <= rows ? w + 4 * (ptrdiff_t)stride : w;                      \
            for (int j = 0; j < stride; j += PANDIS__VECTOR) {                                     \
                for (int r = 0; r < 4; r++) PANDIS__FETCH(next + r * (ptrdiff_t)stride + j);       \
                pandis__vector sum = pandis__load(out + j) +                                       \
                    ((a * load(w + j) + b * load(w + stride + j)) +                                \
                        (c * load(w + 2 * (ptrdiff_t)stride + j) +                                 \
                            d * load(w + 3 * (ptrdiff_t)stride + j)));                             \
                memcpy(out + j, &sum, sizeof sum);                                                 \
            }                                                                                      \
        }                                                                                          \
        for (; i < rows; i++, w += stride)                                                         \
            for (int j = 0; j < stride; j++) out[j] += h[i] * (float)w[j];                         \
    }
PANDIS__KINDS(PANDIS__ADD)

/* The same for several points, whose h and out are `stride` apart: sums stay in registers, and each
 * weight is read once for all points. The order of additions is the same as above. */
#define PANDIS__ADD_MANY(load, type, tail, how)                                                    \
    PANDIS__ALWAYS how void pandis__add_many_##tail(                                               \
        const type *w, const float *h, int rows, int stride, float *out, const int points) {       \
        for (int j = 0; j < stride; j += PANDIS__VECTOR) {                                         \
            pandis__vector sum[PANDIS__POINTS];                                                    \
            const type *row = w + j;                                                               \
            int i = 0;                                                                             \
            for (int p = 0; p < points; p++)                                                       \
                sum[p] = pandis__load(out + p * (ptrdiff_t)stride + j);                            \
            for (; i + 4 <= rows; i += 4, row += 4 * (ptrdiff_t)stride) {                          \
                pandis__vector w0 = load(row), w1 = load(row + stride),                            \
                               w2 = load(row + 2 * (ptrdiff_t)stride),                             \
                               w3 = load(row + 3 * (ptrdiff_t)stride);                             \
                for (int p = 0; p < points; p++) {                                                 \
                    const float *x = h + p * (ptrdiff_t)stride + i;                                \
                    sum[p] = sum[p] + ((x[0] * w0 + x[1] * w1) + (x[2] * w2 + x[3] * w3));         \
                }                                                                                  \
            }                                                                                      \
            for (; i < rows; i++, row += stride)                                                   \
                for (int p = 0; p < points; p++)                                                   \
                    sum[p] = sum[p] + h[p * (ptrdiff_t)stride + i] * load(row);                    \
            for (int p = 0; p < points; p++)                                                       \
                memcpy(out + p * (ptrdiff_t)stride + j, sum + p, sizeof sum[p]);                   \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__ADD_MANY)

/* Sum the lanes of four sums by halves: k and k + 8, then k and k + 4, k and k + 2, k and k + 1. */
PANDIS__INLINE void pandis__fold(float (*lanes)[PANDIS__LANES], float *out) {
#if PANDIS__VECTOR > 1
    pandis__quad l[4][4], four[4];
    memcpy(l, lanes, sizeof l);
    for (int r = 0; r < 4; r++) four[r] = (l[r][0] + l[r][2]) + (l[r][1] + l[r][3]);
    pandis__quad two =
        PANDIS__PICK(four[0], four[1], 0, 1, 4, 5) + PANDIS__PICK(four[0], four[1], 2, 3, 6, 7);
    pandis__quad other =
        PANDIS__PICK(four[2], four[3], 0, 1, 4, 5) + PANDIS__PICK(four[2], four[3], 2, 3, 6, 7);
    two = PANDIS__PICK(two, other, 0, 2, 4, 6) + PANDIS__PICK(two, other, 1, 3, 5, 7);
    memcpy(out, &two, sizeof two);
#else
    for (int r = 0; r < 4; r++) {
        for (int n = PANDIS__LANES / 2; n; n /= 2)
            for (int k = 0; k < n; k++) lanes[r][k] += lanes[r][k + n];
        out[r] = lanes[r][0];
    }
#endif
}

/* out[i] <- the product of row i and y, each summed in PANDIS__LANES lanes, four rows at once. */
#define PANDIS__DOT(load, type, tail, how)                                                         \
    how void pandis__dots_##tail(                                                                  \
        const type *w, const float *y, int rows, int stride, float *out) {                         \
        for (int i = 0; i < rows; i += 4) {                                                        \
            const type *row[4];                                                                    \
            ptrdiff_t next = i + 8 <= rows ? 4 * (ptrdiff_t)stride : 0;                            \
            pandis__vector sum[4][PANDIS__PARTS];                                                  \
            float lanes[4][PANDIS__LANES], four[4];                                                \
            memset(sum, 0, sizeof sum);                                                            \
            for (int r = 0; r < 4; r++)                                                            \
                row[r] = w + (ptrdiff_t)(i + r < rows ? i + r : i) * stride;                       \
            for (int j = 0; j < stride; j += PANDIS__LANES)                                        \
                for (int k = 0; k < PANDIS__PARTS; k++) {                                          \
                    pandis__vector v = pandis__load(y + j + k * PANDIS__VECTOR);                   \
                    for (int r = 0; r < 4; r++)                                                    \
                        PANDIS__FETCH(row[r] + next + j + k * PANDIS__VECTOR);                     \
                    for (int r = 0; r < 4; r++)                                                    \
                        sum[r][k] += load(row[r] + j + k * PANDIS__VECTOR) * v;                    \
                }                                                                                  \
            memcpy(lanes, sum, sizeof lanes);                                                      \
            pandis__fold(lanes, four);                                                             \
            for (int r = 0; r < 4 && i + r < rows; r++) out[i + r] = four[r];                      \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__DOT)

/* out[p][i] <- the product of row i and y of point p, for several points `stride` apart. Four
 * points take two rows at once, because eight sums keep the arithmetic units busy. */
#define PANDIS__DOT_MANY(load, type, tail, how)                                                    \
    PANDIS__ALWAYS how void pandis__dots_many_##tail(const type *w, const float *y, int rows,      \
        int stride, float *out, int apart, const int points) {                                     \
        for (int i = 0; i < rows; i += PANDIS__POINTS / points) {                                  \
            float lanes[PANDIS__POINTS][PANDIS__LANES], sums[PANDIS__POINTS];                      \
            const type *row = w + (ptrdiff_t)i * stride;                                           \
            ptrdiff_t next = i + 1 < rows ? stride : 0;                                            \
            for (int k = 0; k < PANDIS__LANES; k += PANDIS__VECTOR) {                              \
                pandis__vector sum[PANDIS__POINTS];                                                \
                memset(sum, 0, sizeof sum);                                                        \
                for (int j = k; j < stride; j += PANDIS__LANES)                                    \
                    for (int r = 0; r < PANDIS__POINTS; r += points) {                             \
                        pandis__vector v = load(row + (r ? next : 0) + j);                         \
                        for (int p = 0; p < points; p++)                                           \
                            sum[r + p] += v * pandis__load(y + p * (ptrdiff_t)stride + j);         \
                    }                                                                              \
                for (int p = 0; p < PANDIS__POINTS; p++)                                           \
                    memcpy(lanes[p] + k, sum + p, sizeof sum[p]);                                  \
            }                                                                                      \
            for (int p = 0; p < PANDIS__POINTS; p += 4) pandis__fold(lanes + p, sums + p);         \
            for (int r = 0; r < PANDIS__POINTS && i + r / points < rows; r += points)              \
                for (int p = 0; p < points; p++)                                                   \
                    out[p * (ptrdiff_t)apart + i + r / points] = sums[r + p];                      \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__DOT_MANY)

/* Call one of the above, for one, four or eight points. */
#define PANDIS__EITHER(load, type, tail, how)                                                      \
    how void pandis__sums_##tail(                                                                  \
        const type *w, const float *h, int rows, int stride, float *out, int count) {              \
        if (count == 8) pandis__add_many_##tail(w, h, rows, stride, out, 8);                       \
        else if (count == 4) pandis__add_many_##tail(w, h, rows, stride, out, 4);                  \
        else pandis__add_##tail(w, h, rows, stride, out);                                          \
    }                                                                                              \
    how void pandis__products_##tail(                                                              \
        const type *w, const float *y, int rows, int stride, float *out, int apart, int count) {   \
        if (count == 8) pandis__dots_many_##tail(w, y, rows, stride, out, apart, 8);               \
        else if (count == 4) pandis__dots_many_##tail(w, y, rows, stride, out, apart, 4);          \
        else pandis__dots_##tail(w, y, rows, stride, out);                                         \
    }
PANDIS__KINDS(PANDIS__EITHER)

#define PANDIS__ROOM (PANDIS__ROWS * (PANDIS_MOST_DEPTH + 2))

/* Number of rows of memory that a network needs per point: a layer's input, its output, and slopes
 * (of every layer if the normal is the gradient). */
static int pandis__rows(const pandis__network *n) { return n->outputs == 1 ? n->depth + 2 : 3; }

/* Number of points to evaluate together, of so many that are left: 8, 4 or 1. They must fit into
 * the memory that one point of the largest network needs. */
static size_t pandis__points_at_once(const pandis__network *n, size_t left) {
    size_t fit = PANDIS__ROOM / ((size_t)n->stride * (size_t)pandis__rows(n));
    size_t most = fit < left ? fit : left;
    return most >= 8 ? 8 : most >= 4 ? 4 : 1;
}

/* Go back through a network with one output: compute its gradients, stored 4 numbers apart, from
 * the slopes of its sines. `h` and `z` each have room for one layer of all points. */
PANDIS__INLINE void pandis__network_gradient(
    const pandis__network *n, int count, const float *slopes, float *h, float *z, float *gradient) {
    int stride = n->stride;
    ptrdiff_t all = (ptrdiff_t)count * stride;
    for (int p = 0; p < count; p++)
        for (int j = 0; j < stride; j++)
            h[p * (ptrdiff_t)stride + j] =
                n->last[j] * slopes[(n->depth - 1) * all + p * (ptrdiff_t)stride + j];
    for (int layer = n->depth - 1; layer > 0; layer--) {
        ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
        const float *slope = slopes + (layer - 1) * all;
        if (n->hidden)
            PANDIS__CHOOSE(pandis__products_f)(
                n->hidden + at * stride, h, n->width, stride, z, stride, count);
        else
            PANDIS__CHOOSE(pandis__products_h)(
                n->hidden16 + at * stride, h, n->width, stride, z, stride, count);
        for (int p = 0; p < count; p++, z += stride, slope += stride) {
            for (int i = 0; i < n->width; i++)
                z[i] *= n->hidden ? slope[i] : n->scales[at + i] * slope[i];
            for (int i = n->width; i < stride; i++) z[i] = 0;
        }
        z -= all;
        float *swap = h;
        h = z, z = swap;
    }
    PANDIS__CHOOSE(pandis__products_f)(n->first, h, 3, stride, gradient, 4, count);
}

/* Evaluate x -> sin(W x + b) ... -> phi and psi, or phi and its gradient; w0 is folded into W and
 * b. Four or eight points share one pass over the weights; the answers are the same as for single
 * points. If normals are NULL, no gradient is computed. */
PANDIS__INLINE void pandis__answer_network_body(const pandis__network *n, int count, double (*u)[3],
    double *distance, double (*normal)[3], pandis_flag *flag) {
    float room[PANDIS__ROOM], result[PANDIS__POINTS][4] = {{0}};
    double inside[PANDIS__POINTS][3], outside[PANDIS__POINTS];
    int stride = n->stride, own = n->outputs == 1;
    ptrdiff_t all = (ptrdiff_t)count * stride;
    float *h = room, *z = room + all, *slopes = z + all;
    room[0] = 0; /* also written below, which gcc for Windows does not see */
    for (int p = 0; p < count; p++) {
        outside[p] = pandis__clamp(u[p], inside[p]);
        for (int k = 0; k < 3; k++) h[p * (ptrdiff_t)stride + k] = (float)inside[p][k];
    }
    for (int layer = 0; layer < n->depth; layer++) {
        const float *bias = n->biases + (ptrdiff_t)layer * stride;
        float *slope = slopes + (own ? layer * all : 0);
        ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
        for (ptrdiff_t j = 0; j < all; j++) z[j] = 0;
        if (layer > 0 && n->hidden16)
            for (int p = 0; p < count; p++)
                for (int i = 0; i < n->width; i++)
                    h[p * (ptrdiff_t)stride + i] *= n->scales[at + i];
        if (layer == 0) PANDIS__CHOOSE(pandis__sums_f)(n->first, h, 3, stride, z, count);
        else if (n->hidden)
            PANDIS__CHOOSE(pandis__sums_f)(n->hidden + at * stride, h, n->width, stride, z, count);
        else
            PANDIS__CHOOSE(pandis__sums_h)(
                n->hidden16 + at * stride, h, n->width, stride, z, count);
        for (ptrdiff_t j = 0; j < all; j += PANDIS__LANES)
            pandis__sines(z + j, bias + j % stride, slope + j);
        float *swap = h;
        h = z, z = swap;
    }
    PANDIS__CHOOSE(pandis__products_f)(n->last, h, n->outputs, stride, result[0], 4, count);
    for (int p = 0; p < count; p++) {
        for (int k = 0; k < n->outputs; k++)
            result[p][k] += n->biases[(ptrdiff_t)n->depth * stride + k];
        distance[p] = (double)result[p][0];
        for (int k = 0; k < 3 && normal && !own; k++) normal[p][k] = (double)result[p][k + 1];
    }
    if (own && normal) {
        pandis__network_gradient(n, count, slopes, h, z, result[0]);
        for (int p = 0; p < count; p++)
            for (int k = 0; k < 3; k++) normal[p][k] = (double)result[p][k];
    }
    for (int p = 0; p < count; p++) {
        if (n->base.size) {
            double more, slope[3];
            pandis__cubic(&n->base, inside[p], &more, slope);
            distance[p] += more;
            for (int k = 0; k < 3 && normal; k++) normal[p][k] += slope[k];
        }
        distance[p] += outside[p];
        flag[p] = outside[p] > 0 ? PANDIS_BOUND : PANDIS_OK;
    }
}

PANDIS__COMPILE(pandis__answer_network,
    (const pandis__network *n, int count, double (*u)[3], double *distance, double (*normal)[3],
        pandis_flag *flag),
    (n, count, u, distance, normal, flag))
/* -------------------- grids */

enum { PANDIS__NEAREST, PANDIS__TRILINEAR, PANDIS__NORMAL, PANDIS__GRADIENT, PANDIS__TRICUBIC };

static const float *pandis__at(const pandis__grid *g, const int *i) {
    return g->nodes + (((ptrdiff_t)i[0] * g->size + i[1]) * g->size + i[2]) * g->channels;
}

static double pandis__mix(double a, double b, double t) { return a * (1 - t) + b * t; }

/* Find the corner values around a point, x slowest, and the point's position in its cell. */
static void pandis__corners(
    const pandis__grid *g, const double *p, const float **corner, double *t) {
    int first[3];
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - g->low[k]) * g->per_step[k], cell = floor(x);
        cell = cell < g->size - 2 ? cell : g->size - 2;
        first[k] = (int)cell, t[k] = x - cell;
    }
    for (int c = 0; c < 8; c++) {
        int i[3] = {first[0] + (c >> 2), first[1] + (c >> 1 & 1), first[2] + (c & 1)};
        corner[c] = pandis__at(g, i);
    }
}

static pandis_flag pandis__answer_grid(
    const pandis__grid *g, const double *u, double *distance, double *normal) {
    double p[3], t[3], value[4] = {0}, outside = pandis__clamp_to(g->low, g->high, u, p);
    const float *corner[8];
    int cell[3], force = g->rule == PANDIS__NEAREST || g->rule == PANDIS__TRILINEAR;
    if (g->rule == PANDIS__NEAREST) {
        int i[3];
        for (int k = 0; k < 3; k++) i[k] = (int)floor((p[k] - g->low[k]) * g->per_step[k] + 0.5);
        for (int k = 0; k < 3; k++) value[k + 1] = (double)pandis__at(g, i)[k];
    } else if (g->rule == PANDIS__TRICUBIC) {
        pandis__cubic(&g->cubic, p, value, value + 1);
    } else {
        pandis__corners(g, p, corner, t);
        for (int c = 0; c < g->channels; c++) {
            double line[4];
            for (int e = 0; e < 4; e++)
                line[e] = pandis__mix((double)corner[e][c], (double)corner[e + 4][c], t[0]);
            double low = pandis__mix(line[0], line[2], t[1]),
                   high = pandis__mix(line[1], line[3], t[1]);
            value[c + (force ? 1 : 0)] = pandis__mix(low, high, t[2]);
            if (g->rule != PANDIS__GRADIENT) continue;
            double rise[4];
            for (int e = 0; e < 4; e++) rise[e] = (double)corner[e + 4][c] - (double)corner[e][c];
            value[1] = g->per_step[0] *
                pandis__mix(
                    pandis__mix(rise[0], rise[2], t[1]), pandis__mix(rise[1], rise[3], t[1]), t[2]);
            value[2] = g->per_step[1] * pandis__mix(line[2] - line[0], line[3] - line[1], t[2]);
            value[3] = g->per_step[2] * pandis__mix(line[1] - line[0], line[3] - line[2], t[1]);
        }
    }
    if (force && outside > 0) memset(value, 0, sizeof value); /* the surface lies within the box */
    memcpy(normal, value + 1, 3 * sizeof *normal);
    *distance = force ? -sqrt(pandis__dot(normal, normal)) : value[0] + outside;
    int last = g->size - 2;
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - g->low[k]) * g->per_step[k];
        cell[k] = x < last ? (int)x : last;
    }
    ptrdiff_t bit = ((ptrdiff_t)cell[0] * (last + 1) + cell[1]) * (last + 1) + cell[2];
    int covered = g->covered[bit >> 3] >> (7 - (bit & 7)) & 1;
    return covered && outside == 0 ? PANDIS_OK : PANDIS_BOUND;
}
/* -------------------- banded splines */

/* Restore stored coefficients, four at a time: coarse or far ones, and fine ones. */
#ifdef PANDIS__FOUR_AT_ONCE
typedef int16_t pandis__four_shorts __attribute__((vector_size(8), aligned(2), may_alias));
typedef int8_t pandis__four_bytes __attribute__((vector_size(4), aligned(1), may_alias));
typedef int32_t pandis__four_ints __attribute__((vector_size(16)));
#define PANDIS__RESTORE(type, vector, tail)                                                        \
    PANDIS__INLINE void pandis__restore_##tail(                                                    \
        const type *stored, double offset, double scale, float *c) {                               \
        pandis__four_ints whole =                                                                  \
            __builtin_convertvector(*(const vector *)stored, pandis__four_ints);                   \
        *(pandis__four_floats *)c = __builtin_convertvector(                                       \
            offset + scale * __builtin_convertvector(whole, pandis__four), pandis__four_floats);   \
    }
#else
#define PANDIS__RESTORE(type, vector, tail)                                                        \
    PANDIS__INLINE void pandis__restore_##tail(                                                    \
        const type *stored, double offset, double scale, float *c) {                               \
        for (int i = 0; i < 4; i++) c[i] = (float)(offset + scale * (double)stored[i]);            \
    }
#endif
PANDIS__RESTORE(int16_t, pandis__four_shorts, coarse)
PANDIS__RESTORE(int8_t, pandis__four_bytes, fine)

/* Collect the 64 coefficients around a point, block by block; blocks that are not stored give
 * zeros. Returns whether any block is stored; for the coarse lattice, which is useless if
 * incomplete, whether all are. */
PANDIS__INLINE int pandis__collect(const pandis__spline *s, int level, const int *first, float *c) {
    const pandis__layout *l = s->layout + level;
    int found = 0, low[3], blocks[3];
    double offset = s->offset[level], scale = s->scale[level];
    float room[6][6][6], own[8]; /* two or three blocks per axis */
    memset(room, 0, sizeof room);
    for (int k = 0; k < 3; k++)
        low[k] = first[k] >> 1, blocks[k] = ((first[k] + 3) >> 1) - low[k] + 1;
    for (int i = 0; i < blocks[0]; i++)
        for (int j = 0; j < blocks[1]; j++) {
            int bx = low[0] + i, by = low[1] + j, within = ((bx & 3) << 4) | ((by & 3) << 2);
            const uint16_t *row =
                l->brick + ((ptrdiff_t)(bx >> 2) * l->bricks + (by >> 2)) * l->bricks;
            float *line = room[2 * i][2 * j];
            for (int k = 0; k < blocks[2]; k++, line += 2) {
                int bz = low[2] + k;
                int32_t at = pandis__block_of(l, row[bz >> 2], within | (bz & 3));
                if (at < 0 && level == 0) return 0;
                if (at < 0) continue;
                found = 1;
                for (int e = 0; e < 8; e += 4) {
                    if (level) pandis__restore_fine(s->fine + at + e, offset, scale, own + e);
                    else pandis__restore_coarse(s->coarse + at + e, offset, scale, own + e);
                    memcpy(line + 9 * e, own + e, 2 * sizeof *own); /* strides: 36 in x, 6 in y */
                    memcpy(line + 9 * e + 6, own + e + 2, 2 * sizeof *own);
                }
            }
        }
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(c + 16 * x + 4 * y, &room[x + (first[0] & 1)][y + (first[1] & 1)][first[2] & 1],
                4 * sizeof *c);
    return found;
}

/* Add one level's value and gradient; returns what pandis__collect does. With a cache `cells` of
 * this spline, coefficients around recent points are not collected again. */
PANDIS__INLINE int pandis__add_level(const pandis__spline *s, int level, const double *p,
    pandis__cells *cells, double *value, double *gradient) {
    const pandis__layout *l = s->layout + level;
    int first[3], known = 0;
    double w[3][4], dw[3][4];
    float room[64], *c = room;
    if (!pandis__place(l->size, l->low, l->per_step, p, first, w, dw)) return 0;
    int at = (first[0] & 7) << 6 | (first[1] & 7) << 3 | (first[2] & 7);
    if (cells) {
        c = cells->cell[level][at].c;
        if (!memcmp(cells->cell[level][at].first, first, sizeof first))
            known = cells->cell[level][at].known;
    }
    if (!known) {
        known = pandis__collect(s, level, first, c) + 1;
        if (cells)
            memcpy(cells->cell[level][at].first, first, sizeof first),
                cells->cell[level][at].known = known;
    }
    if (known > 1) pandis__tensor(c, w, dw, value, gradient);
    return known - 1;
}

/* Where two walls are about equally near, a spline rounds the crease between them: its gradient is
 * shorter than 1. The distance is linear towards the nearest wall. Therefore the spline is
 * evaluated nearer to that wall, where less is rounded, and its value is extrapolated back. */
#define PANDIS__LIFT 0.7   /* largest shift, in steps of the coarse lattice */
#define PANDIS__SHORT 0.02 /* smallest deficit of the squared gradient */

PANDIS__INLINE void pandis__sharpen(const pandis__spline *s, const double *p, pandis__cells *cells,
    double *value, double *gradient) {
    double missing = (1 - pandis__dot(gradient, gradient) - PANDIS__SHORT) / (1 - PANDIS__SHORT);
    if (!(missing > 0 && *value < 0)) return;
    double lift = PANDIS__LIFT / s->layout[0].per_step, q[3], found = 0, normal[3] = {0};
    lift = (lift < -*value ? lift : -*value) * missing * missing * (3 - 2 * missing);
    for (int k = 0; k < 3; k++) q[k] = p[k] + lift * gradient[k];
    if (!pandis__add_level(s, 0, q, cells, &found, normal)) return;
    pandis__add_level(s, 1, q, cells, &found, normal);
    double slope = sqrt(pandis__dot(gradient, gradient));
    if (!(slope > PANDIS__TINY) || !pandis__normalise(normal)) return;
    *value = found - lift * pandis__dot(gradient, normal);
    for (int k = 0; k < 3; k++) gradient[k] = slope * normal[k]; /* its length does not change */
}

PANDIS__INLINE void pandis__answer_spline_body(const pandis__spline *s, const double *u,
    pandis__cells *cells, double *distance, double *normal, pandis_flag *flag) {
    double p[3], outside = pandis__clamp(u, p), value = 0, gradient[3] = {0};
    for (int k = 0; k < 3; k++)
        p[k] = p[k] < -PANDIS__EDGE ? -PANDIS__EDGE : p[k] > PANDIS__EDGE ? PANDIS__EDGE : p[k];
    *flag = PANDIS_OK;
    if (outside > 0 || !pandis__add_level(s, 0, p, cells, &value, gradient)) {
        int first[3];
        double w[3][4], dw[3][4];
        float c[64];
        value = gradient[0] = gradient[1] = gradient[2] = 0;
        if (pandis__place(s->far_size, s->far_low, s->far_per_step, p, first, w, dw)) {
            for (int i = 0; i < 64; i += 4) {
                ptrdiff_t x = first[0] + (i >> 4), y = first[1] + (i >> 2 & 3);
                const int16_t *stored = s->far + (x * s->far_size + y) * s->far_size + first[2];
                pandis__restore_coarse(stored, s->offset[2], s->scale[2], c + i);
            }
            pandis__tensor(c, w, dw, &value, gradient);
        }
        const pandis__layout *l = s->layout;
        ptrdiff_t block[3], count = 4 * (ptrdiff_t)l->bricks;
        for (int k = 0; k < 3; k++) {
            double cell =
                floor(((p[k] - l->low) * l->per_step < l->size - 2 ? (p[k] - l->low) * l->per_step
                                                                   : l->size - 2) /
                    2);
            block[k] = cell > 0 ? (ptrdiff_t)cell : 0;
        }
        ptrdiff_t bit = (block[0] * count + block[1]) * count + block[2];
        if ((s->side[bit >> 3] >> (7 - (bit & 7)) & 1) || outside > 0)
            value = (value > s->outside ? value : s->outside) + outside;
        else value = value < -s->inside ? value : -s->inside;
        *flag = PANDIS_BOUND;
    } else {
        pandis__add_level(s, 1, p, cells, &value, gradient);
        pandis__sharpen(s, p, cells, &value, gradient);
    }
    *distance = value;
    memcpy(normal, gradient, sizeof gradient);
}

PANDIS__COMPILE(pandis__answer_spline,
    (const pandis__spline *s, const double *u, pandis__cells *cells, double *distance,
        double *normal, pandis_flag *flag),
    (s, u, cells, distance, normal, flag))
/* -------------------- closed forms */

enum { PANDIS__SPHERE, PANDIS__TORUS, PANDIS__BOX, PANDIS__CAPSULE };

/* Evaluate a closed form in the units of its sizes. Sizes: sphere (radius), torus around z (ring,
 * tube), box (half its sides), capsule along z (radius, half its axis). */
static void pandis__answer_shape(
    const pandis__shape *s, const double *p, double *distance, double *normal) {
    double offset[3] = {p[0], p[1], p[2]};
    if (s->shape == PANDIS__BOX) {
        double excess[3], out[3], most;
        int widest = 0;
        for (int k = 0; k < 3; k++) {
            excess[k] = fabs(p[k]) - s->size[k], out[k] = excess[k] > 0 ? excess[k] : 0;
            if (excess[k] > excess[widest]) widest = k;
        }
        most = excess[widest];
        double outside = sqrt(pandis__dot(out, out));
        *distance = outside + (most < 0 ? most : 0);
        if (!(outside > 0)) out[0] = out[1] = out[2] = 0, out[widest] = 1;
        for (int k = 0; k < 3; k++) normal[k] = p[k] < 0 ? -out[k] : out[k];
        return;
    }
    if (s->shape == PANDIS__TORUS) {
        double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
        offset[0] -= s->size[0] * (flat > PANDIS__TINY ? p[0] / flat : 1);
        offset[1] -= s->size[0] * (flat > PANDIS__TINY ? p[1] / flat : 0);
    }
    if (s->shape == PANDIS__CAPSULE) {
        double axis = p[2] < -s->size[1] ? -s->size[1] : p[2] > s->size[1] ? s->size[1] : p[2];
        offset[2] -= axis;
    }
    double length = sqrt(pandis__dot(offset, offset));
    *distance = length - s->size[s->shape == PANDIS__TORUS];
    memcpy(normal, offset, sizeof offset);
    if (!(length > PANDIS__TINY)) normal[s->shape == PANDIS__CAPSULE ? 0 : 2] = 1;
}
/* -------------------- queries */

PANDIS_API pandis_kind pandis_field_kind(const pandis_field *field) {
    return (pandis_kind)field->kind;
}

PANDIS_API size_t pandis_bytes(const pandis_field *field) { return field->size; }

PANDIS_API void pandis_bounds(const pandis_field *field, double low[3], double high[3]) {
    for (int k = 0; k < 3; k++) low[k] = high[k] = 0;
    for (int k = 0; field->kind && k < 3; k++) {
        low[k] = field->centre[k] + field->low[k] / field->scale;
        high[k] = field->centre[k] + field->high[k] / field->scale;
    }
}

PANDIS_API double pandis_longest_side(const pandis_field *field) {
    return field->kind ? PANDIS__LONGEST / field->scale : 0;
}

/* Transform a point into the unit frame; returns 0 if it is not finite, or too far away. */
static int pandis__unit(const pandis_field *field, const double *point, double *u) {
    int finite = 1;
    for (int k = 0; k < 3; k++) {
        u[k] = (point[k] - field->centre[k]) * field->scale;
        finite &= fabs(u[k]) < PANDIS__FAR;
    }
    return finite;
}

/* Convert a distance, a direction and a flag (unit frame) to an answer in mesh units. */
static void pandis__tell(const pandis_field *field, double d, double *n, double clear,
    pandis_flag flag, pandis_answer *answer) {
    if (flag != PANDIS_INVALID && !(fabs(d) <= 4e150 && pandis__dot(n, n) <= 1e300))
        flag = PANDIS_INVALID;
    if (flag == PANDIS_INVALID || flag == PANDIS_BEYOND) {
        answer->distance = answer->normal[0] = answer->normal[1] = answer->normal[2] = (double)NAN;
        answer->slope = (double)NAN;
        answer->clear = flag == PANDIS_BEYOND ? clear / field->scale : (double)NAN;
    } else {
        int forces = field->kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR;
        answer->slope = forces ? 0 : field->kind == PANDIS_SHAPE ? 1 : sqrt(pandis__dot(n, n));
        if (!pandis__normalise(n)) n[0] = n[1] = 0, n[2] = 1;
        answer->distance = d / field->scale;
        int mesh = field->kind == PANDIS_MESH || field->kind == PANDIS_COMPACT;
        answer->clear = mesh ? clear / field->scale : fabs(answer->distance);
        for (int k = 0; k < 3; k++) answer->normal[k] = n[k];
    }
    answer->flag = flag, answer->face = answer->region = -1;
}

/* Answer a query. `cells` is a cache for splines, used with this field only and all zero before its
 * first query; NULL: no cache. */
static void pandis__ask(const pandis_field *field, const double *point, pandis__start *begin,
    pandis__cells *cells, pandis_answer *answer) {
    double u[1][3], d = 0, n[1][3] = {{0}}, clear = 0;
    pandis_flag flag = PANDIS_INVALID;
    if (pandis__unit(field, point, u[0])) {
        switch (field->kind) {
        case PANDIS_NETWORK: pandis__answer_network(&field->as.network, 1, u, &d, n, &flag); break;
        case PANDIS_GRID: flag = pandis__answer_grid(&field->as.grid, u[0], &d, n[0]); break;
        case PANDIS_SPLINE:
            pandis__answer_spline(&field->as.spline, u[0], cells, &d, n[0], &flag);
            break;
        case PANDIS_MESH:
            flag = pandis__answer_mesh(&field->as.mesh, u[0], begin, &d, n[0], &clear);
            break;
        case PANDIS_COMPACT:
            flag = pandis__answer_compact(&field->as.compact, u[0], begin, &d, n[0], &clear);
            break;
        case PANDIS_SHAPE:
            pandis__answer_shape(&field->as.shape, point, &d, n[0]);
            d *= field->scale;
            flag = fabs(u[0][0]) <= 1 && fabs(u[0][1]) <= 1 && fabs(u[0][2]) <= 1 ? PANDIS_OK
                                                                                  : PANDIS_BOUND;
            break;
        default: break;
        }
    }
    pandis__tell(field, d, n[0], clear, flag, answer);
    if (answer->flag == PANDIS_INVALID || answer->flag == PANDIS_BEYOND) return;
    answer->face = begin->face;
    if (field->regions && begin->place >= 0) answer->region = field->regions[begin->place];
}

PANDIS_API void pandis_query(
    const pandis_field *field, const double point[3], pandis_answer *answer) {
    pandis__start begin = PANDIS__ANYWHERE;
    pandis__ask(field, point, &begin, NULL, answer);
}

PANDIS_API void pandis_query_within(
    const pandis_field *field, const double point[3], double reach, pandis_answer *answer) {
    pandis__start begin = PANDIS__WITHIN(reach >= 0 ? reach * field->scale : (double)INFINITY);
    pandis__ask(field, point, &begin, NULL, answer);
}

PANDIS_API pandis_flag pandis_distance(
    const pandis_field *field, const double point[3], double *distance) {
    pandis_answer answer;
    double u[1][3], d = 0, none[3] = {0, 0, 1};
    pandis_flag flag = PANDIS_INVALID;
    if (field->kind == PANDIS_NETWORK && field->as.network.outputs == 1) {
        if (pandis__unit(field, point, u[0]))
            pandis__answer_network(&field->as.network, 1, u, &d, NULL, &flag);
        pandis__tell(field, d, none, 0, flag, &answer);
    } else {
        pandis_query(field, point, &answer);
    }
    *distance = answer.distance;
    return answer.flag;
}

PANDIS_API pandis_flag pandis_force(
    const pandis_field *field, const double point[3], double stiffness, double force[3]) {
    pandis_answer answer;
    force[0] = force[1] = force[2] = 0;
    if (!(stiffness >= 0 && stiffness <= PANDIS__STIFFEST)) return PANDIS_INVALID;
    pandis_query(field, point, &answer);
    double push = answer.distance < 0 ? -stiffness * answer.distance : 0; /* false for NaN */
    for (int k = 0; k < 3; k++) force[k] = push > 0 ? push * answer.normal[k] : 0;
    return answer.flag;
}

/* Query several points of a network, reading every weight once. */
static void pandis__query_network(
    const pandis_field *field, const double *points, size_t count, pandis_answer *answers) {
    double u[PANDIS__POINTS][3], d[PANDIS__POINTS], n[PANDIS__POINTS][3];
    int finite[PANDIS__POINTS];
    pandis_flag flag[PANDIS__POINTS];
    for (size_t p = 0; p < count; p++) {
        finite[p] = pandis__unit(field, points + 3 * p, u[p]);
        for (int k = 0; k < 3 && !finite[p]; k++) u[p][k] = 0;
    }
    pandis__answer_network(&field->as.network, (int)count, u, d, n, flag);
    for (size_t p = 0; p < count; p++)
        pandis__tell(field, d[p], n[p], 0, finite[p] ? flag[p] : PANDIS_INVALID, answers + p);
}

PANDIS_API void pandis_query_many(const pandis_field *field, const double *points, size_t count,
    double *distances, double *normals, unsigned char *flags) {
    pandis_answer answers[PANDIS__POINTS];
    for (size_t i = 0, some; i < count; i += some) {
        some = field->kind == PANDIS_NETWORK ? pandis__points_at_once(&field->as.network, count - i)
                                             : 1;
        if (some > 1) pandis__query_network(field, points + 3 * i, some, answers);
        else pandis_query(field, points + 3 * i, answers);
        for (size_t k = 0; k < some; k++) {
            distances[i + k] = answers[k].distance;
            if (normals) memcpy(normals + 3 * (i + k), answers[k].normal, sizeof answers[k].normal);
            if (flags) flags[i + k] = (unsigned char)answers[k].flag;
        }
    }
}

/* -------------------- derivatives of the distance */

/* Finite-difference steps (unit frame): for gradients in single precision, for distances in single
 * precision, and for distances in double precision. */
#define PANDIS__STEP 1e-3
#define PANDIS__WIDE_STEP 4e-3
#define PANDIS__FINE_STEP 1e-4

/* Second derivatives of the weights of pandis__weigh. */
static void pandis__weigh_twice(double t, double per_step, double *ddw) {
    double square = per_step * per_step;
    ddw[0] = (1 - t) * square, ddw[1] = (3 * t - 2) * square, ddw[2] = (1 - 3 * t) * square,
    ddw[3] = t * square;
}

/* Add the second derivatives of the spline that has these 64 coefficients around a point. */
static void pandis__tensor_twice(
    const float *c, double (*w)[4], double (*dw)[4], double (*ddw)[4], double *hessian) {
    double h[3][3] = {{0}};
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            for (int z = 0; z < 4; z++) {
                double r = (double)c[16 * x + 4 * y + z];
                h[0][0] += r * ddw[0][x] * w[1][y] * w[2][z],
                    h[0][1] += r * dw[0][x] * dw[1][y] * w[2][z];
                h[1][1] += r * w[0][x] * ddw[1][y] * w[2][z],
                    h[0][2] += r * dw[0][x] * w[1][y] * dw[2][z];
                h[2][2] += r * w[0][x] * w[1][y] * ddw[2][z],
                    h[1][2] += r * w[0][x] * dw[1][y] * dw[2][z];
            }
    for (int i = 0; i < 9; i++) hessian[i] += i / 3 < i % 3 ? h[i / 3][i % 3] : h[i % 3][i / 3];
}

/* Find the cell of a point in a lattice, with all weights; returns 0 outside the lattice. */
static int pandis__place_twice(int32_t size, double low, double per_step, const double *p,
    int *first, double (*w)[4], double (*dw)[4], double (*ddw)[4]) {
    if (!pandis__place(size, low, per_step, p, first, w, dw)) return 0;
    for (int k = 0; k < 3; k++)
        pandis__weigh_twice((p[k] - low) * per_step - (first[k] + 1), per_step, ddw[k]);
    return 1;
}

/* Compute the derivatives of a spline in its band; returns 0 elsewhere, and where pandis__sharpen
 * changes the answer. */
static int pandis__bend_spline(
    const pandis__spline *s, const double *u, double *gradient, double *hessian) {
    double w[3][4], dw[3][4], ddw[3][4], value = 0;
    for (int k = 0; k < 3; k++)
        if (!(fabs(u[k]) < PANDIS__EDGE)) return 0;
    for (int level = 0; level < 2; level++) {
        const pandis__layout *l = s->layout + level;
        float c[64];
        int first[3], kept = 0;
        if (pandis__place_twice(l->size, l->low, l->per_step, u, first, w, dw, ddw))
            kept = pandis__collect(s, level, first, c);
        if (level == 0 && !kept) return 0;
        if (!kept) continue;
        pandis__tensor(c, w, dw, &value, gradient);
        pandis__tensor_twice(c, w, dw, ddw, hessian);
    }
    return !(value < 0 && 1 - pandis__dot(gradient, gradient) > PANDIS__SHORT);
}

/* Compute the derivatives of a distance grid; returns 0 outside its box. */
static int pandis__bend_grid(
    const pandis__grid *g, const double *u, double *gradient, double *hessian) {
    for (int k = 0; k < 3; k++)
        if (!(u[k] > g->low[k] && u[k] < g->high[k])) return 0;
    if (g->rule == PANDIS__TRICUBIC) {
        const pandis__lattice *l = &g->cubic;
        double w[3][4], dw[3][4], ddw[3][4], value = 0;
        float c[64];
        int first[3];
        if (!pandis__place_twice(l->size, l->low, l->per_step, u, first, w, dw, ddw)) return 0;
        pandis__gather(l->values, l->size, first, c);
        pandis__tensor(c, w, dw, &value, gradient);
        pandis__tensor_twice(c, w, dw, ddw, hessian);
        return 1;
    }
    const float *corner[8];
    double t[3];
    pandis__corners(g, u, corner, t);
    for (int i = 0; i < 8; i++) {
        double value = (double)corner[i][0], w[3], dw[3];
        for (int k = 0; k < 3; k++) {
            int high = i >> (2 - k) & 1;
            w[k] = high ? t[k] : 1 - t[k], dw[k] = high ? g->per_step[k] : -g->per_step[k];
        }
        for (int k = 0; k < 3; k++) {
            int a = (k + 1) % 3, b = (k + 2) % 3;
            gradient[k] += value * dw[k] * w[a] * w[b];
            hessian[3 * a + b] += value * w[k] * dw[a] * dw[b],
                hessian[3 * b + a] += value * w[k] * dw[a] * dw[b];
        }
    }
    return 1;
}

/* Compute the Hessian of the distance to a point or, if `along` is a unit vector, to a line; the
 * answer is in mesh units. */
static void pandis__bend_round(const pandis_answer *answer, const double *along, double *hessian) {
    for (int i = 0; i < 9; i++) {
        double rest = (i % 4 == 0) - answer->normal[i / 3] * answer->normal[i % 3];
        hessian[i] =
            answer->distance != 0 ? (rest - along[i / 3] * along[i % 3]) / answer->distance : 0;
    }
}

/* Compute the second derivatives of a closed form, which is locally flat, or round about a point or
 * a line. */
static void pandis__bend_shape(
    const pandis__shape *s, const double *p, const pandis_answer *answer, double *hessian) {
    double along[3] = {0, 0, 0};
    pandis_answer round = *answer;
    if (s->shape == PANDIS__BOX) { /* faces are flat; edges are lines; corners are points */
        int beyond[3], count = 0;
        for (int k = 0; k < 3; k++) count += beyond[k] = fabs(p[k]) > s->size[k];
        for (int k = 0; k < 3 && count == 2; k++) along[k] = !beyond[k];
        if (count > 1) pandis__bend_round(answer, along, hessian);
        return;
    }
    round.distance += s->size[s->shape == PANDIS__TORUS];
    if (s->shape == PANDIS__CAPSULE && fabs(p[2]) < s->size[1]) along[2] = 1;
    if (s->shape == PANDIS__TORUS) { /* round the tube, and round the axis */
        double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
        if (flat > PANDIS__TINY) along[0] = -p[1] / flat, along[1] = p[0] / flat;
    }
    pandis__bend_round(&round, along, hessian);
    if (s->shape != PANDIS__TORUS) return;
    double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
    double bend = flat > PANDIS__TINY
        ? (p[0] * answer->normal[0] + p[1] * answer->normal[1]) / (flat * flat)
        : 0;
    for (int i = 0; i < 9; i++) hessian[i] += bend * (along[i / 3] * along[i % 3]);
}

/* Query a point at an offset along an axis. */
static void pandis__query_beside(
    const pandis_field *field, const double *point, double step, int axis, pandis_answer *answer) {
    double beside[3] = {point[0], point[1], point[2]};
    beside[axis] += step;
    pandis_query(field, beside, answer);
}

/* Compute finite differences: of the answers' gradients if `own`, else of distances. */
static void pandis__differ(const pandis_field *field, const double *point, int own,
    const pandis_answer *here, double *gradient, double *hessian) {
    double step = own                   ? PANDIS__STEP
        : field->kind == PANDIS_NETWORK ? PANDIS__WIDE_STEP
                                        : PANDIS__FINE_STEP;
    step /= field->scale;
    pandis_answer high, low, corner[4];
    for (int i = 0; i < 3; i++) {
        pandis__query_beside(field, point, step, i, &high),
            pandis__query_beside(field, point, -step, i, &low);
        if (own) {
            gradient[i] = here->slope * here->normal[i];
            for (int k = 0; k < 3; k++) {
                double rise =
                    (high.slope * high.normal[k] - low.slope * low.normal[k]) / (4 * step);
                hessian[3 * i + k] += rise, hessian[3 * k + i] += rise;
            }
            continue;
        }
        gradient[i] = (high.distance - low.distance) / (2 * step);
        hessian[4 * i] = (high.distance - 2 * here->distance + low.distance) / (step * step);
        for (int k = i + 1; k < 3; k++) {
            for (int c = 0; c < 4; c++) {
                double beside[3] = {point[0], point[1], point[2]};
                beside[i] += c & 1 ? step : -step;
                pandis__query_beside(field, beside, c & 2 ? step : -step, k, corner + c);
            }
            double mixed =
                corner[3].distance - corner[2].distance - corner[1].distance + corner[0].distance;
            hessian[3 * i + k] = hessian[3 * k + i] = mixed / (4 * step * step);
        }
    }
}

PANDIS_API pandis_flag pandis_derivatives(
    const pandis_field *field, const double point[3], double gradient[3], double hessian[9]) {
    pandis__start begin = PANDIS__ANYWHERE;
    pandis_answer answer;
    double u[3] = {0, 0, 0}, own[3] = {0, 0, 0}, bend[9] = {0};
    int kind = field->kind, by_formula = 1;
    pandis__ask(field, point, &begin, NULL, &answer);
    if (kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR)
        answer.flag = PANDIS_INVALID;
    if (answer.flag == PANDIS_INVALID) {
        for (int i = 0; i < 3; i++) gradient[i] = (double)NAN;
        for (int i = 0; i < 9; i++) hessian[i] = (double)NAN;
        return PANDIS_INVALID;
    }
    pandis__unit(field, point, u);
    if (kind == PANDIS_MESH || kind == PANDIS_COMPACT) {
        if (begin.round && fabs(answer.distance) * field->scale > 1e-9)
            pandis__bend_round(&answer, begin.along, bend);
    } else if (kind == PANDIS_SHAPE) {
        pandis__bend_shape(&field->as.shape, point, &answer, bend);
    } else {
        if (answer.flag != PANDIS_OK || kind == PANDIS_NETWORK) by_formula = 0;
        else
            by_formula = kind == PANDIS_SPLINE
                ? pandis__bend_spline(&field->as.spline, u, own, bend)
                : pandis__bend_grid(&field->as.grid, u, own, bend);
        /* the scale is not squared, because distances are scaled, too */
        for (int i = 0; i < 9; i++) bend[i] *= field->scale;
    }
    if (kind == PANDIS_MESH || kind == PANDIS_COMPACT || kind == PANDIS_SHAPE)
        memcpy(own, answer.normal, sizeof own);
    if (!by_formula) {
        /* in the box, the normal of a network with one output is the gradient of its distance */
        int gradients =
            kind == PANDIS_NETWORK && field->as.network.outputs == 1 && answer.flag == PANDIS_OK;
        memset(bend, 0, sizeof bend);
        pandis__differ(field, point, gradients, &answer, own, bend);
    }
    memcpy(gradient, own, sizeof own), memcpy(hessian, bend, sizeof bend);
    return answer.flag;
}
/* -------------------- meshes that move
 *
 * A refit writes only the vertices, the boxes around them, and the error bounds of leaves. Queries
 * compute triangles and vertex normals from the vertices where they need them. */

static uint64_t pandis__whole_words(uint64_t bytes) { return (bytes + 7) / 8 * 8; }

PANDIS_API size_t pandis_vertex_count(const pandis_field *field) {
    return field->kind == PANDIS_MESH ? (size_t)field->as.mesh.vertex_count : 0;
}

PANDIS_API size_t pandis_refit_room(const pandis_field *field) {
    const pandis__mesh *m = &field->as.mesh;
    if (field->kind != PANDIS_MESH) return 0;
    uint64_t v = (uint64_t)m->vertex_count, f = (uint64_t)m->face_count,
             n = (uint64_t)m->node_count;
    uint64_t leaves = (uint64_t)m->leaf_count, corners = leaves * PANDIS__WIDTH * 3;
    uint64_t lists = pandis__whole_words(
        sizeof(int32_t) * (v + 1 + 3 * f + corners) + 2 * sizeof(float) * leaves);
    return (size_t)(3 * v * sizeof(double) + n * sizeof(pandis__node) + lists);
}

/* Compute the box around a leaf, and the error bounds of its distances. */
static void pandis__refit_leaf(
    const pandis__mesh *m, int32_t leaf, float pad, float *low, float *high, float *slack) {
    float v[3][3][PANDIS__WIDTH];
    const double *base = m->vertices + 3 * (ptrdiff_t)*pandis__leaf_vertices(m, leaf);
    pandis__moved_triangles(m, leaf, base, v);
    pandis__slacks(v, slack);
    for (int k = 0; k < 3; k++) {
        float least[PANDIS__WIDTH], most[PANDIS__WIDTH];
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            float x = v[0][k][i], y = v[1][k][i], z = v[2][k][i];
            least[i] = x < y ? (x < z ? x : z) : (y < z ? y : z),
            most[i] = x > y ? (x > z ? x : z) : (y > z ? y : z);
        }
        for (int i = 1; i < PANDIS__WIDTH; i++) {
            least[0] = least[i] < least[0] ? least[i] : least[0];
            most[0] = most[i] > most[0] ? most[i] : most[0];
        }
        low[k] = (float)(base[k] + (double)least[0]) - pad,
        high[k] = (float)(base[k] + (double)most[0]) + pad;
    }
}

/* Compute the boxes of all nodes, bottom up. */
static void pandis__refit_boxes(const pandis__mesh *m, pandis__node *nodes, float (*slacks)[2]) {
    /* the float box of a point may be off by half a unit in the last place of the coordinates */
    float pad = (float)(m->reach * 4e-7);
    for (int32_t index = m->node_count - 1; index >= 0; index--) {
        pandis__node *node = nodes + index;
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            if (node->low[0][i] > node->high[0][i]) continue; /* there is no child */
            float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
            int32_t child = node->child[i];
            if (child < 0) pandis__refit_leaf(m, ~child, pad, low, high, slacks[~child]);
            for (int lane = 0; child >= 0 && lane < PANDIS__WIDTH; lane++)
                for (int k = 0; k < 3; k++) {
                    float below = nodes[child].low[k][lane], above = nodes[child].high[k][lane];
                    low[k] = below < low[k] ? below : low[k],
                    high[k] = above > high[k] ? above : high[k];
                }
            for (int k = 0; k < 3; k++) node->low[k][i] = low[k], node->high[k][i] = high[k];
        }
    }
}

PANDIS__ONCE PANDIS_API pandis_error pandis_refit_open(
    pandis_field *moving, const pandis_field *field, void *room, size_t size) {
    if (field->kind != PANDIS_MESH) return PANDIS_ERROR_CONTENT;
    if (size < pandis_refit_room(field)) return PANDIS_ERROR_COUNT;
    if ((uintptr_t)room % 8) return PANDIS_ERROR_ALIGNMENT;
    const pandis__mesh *m = &field->as.mesh;
    size_t v = (size_t)m->vertex_count, f = (size_t)m->face_count, n = (size_t)m->node_count;
    double *vertices = (double *)room;
    pandis__node *nodes = (pandis__node *)(void *)(vertices + 3 * v);
    int32_t *around = (int32_t *)(void *)(nodes + n), *corners_at = around + v + 1;
    memcpy(vertices, m->vertices, 3 * v * sizeof *vertices);
    memcpy(nodes, m->nodes, n * sizeof *nodes);
    /* the corners at each vertex, in the order of faces in which the original normals were summed
     */
    memset(around, 0, (v + 1) * sizeof *around);
    for (size_t i = 0; i < 3 * f; i++) around[m->faces[i]]++;
    int32_t before = 0;
    for (size_t i = 0; i <= v; i++) {
        int32_t here = around[i];
        around[i] = before, before += here;
    }
    for (size_t i = 0; i < 3 * f; i++) corners_at[around[m->faces[i]]++] = (int32_t)i;
    for (size_t i = v; i > 0; i--) around[i] = around[i - 1];
    around[0] = 0;
    int32_t *listed = corners_at + 3 * f;
    for (int32_t leaf = 0; leaf < m->leaf_count; leaf++)
        for (int i = 0; i < 3 * PANDIS__WIDTH; i++) {
            const pandis__leaf *l = m->leaves + leaf;
            *listed++ = m->faces[3 * (ptrdiff_t)l->face[l->face[i / 3] < 0 ? 0 : i / 3] + i % 3];
        }
    float (*slacks)[2] = (float (*)[2])(void *)listed;
    for (int32_t leaf = 0; leaf < m->leaf_count; leaf++)
        slacks[leaf][0] = m->leaves[leaf].slack, slacks[leaf][1] = m->leaves[leaf].share;
    *moving = *field;
    moving->mapped = 0; /* the bytes belong to the original field, which frees them */
    pandis__mesh *own = &moving->as.mesh;
    own->vertices = vertices, own->nodes = nodes, own->around = around,
    own->corners_at = corners_at;
    own->slacks = (const float (*)[2])slacks;
    own->vertex_normals = NULL, own->slabs = NULL;
    own->most = INT32_MAX; /* no budget is known that suits all shapes */
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_error pandis_refit(pandis_field *moving, const double *vertices, size_t count) {
    pandis__mesh *m = &moving->as.mesh;
    if (moving->kind != PANDIS_MESH || !m->around) return PANDIS_ERROR_CONTENT;
    if (count != (size_t)m->vertex_count) return PANDIS_ERROR_COUNT;
    int good = 1; /* 0 for NaN, too */
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < count; i++)
            good &= fabs((vertices[3 * i + (size_t)k] - moving->centre[k]) * moving->scale) <= 1e30;
    if (!good) return PANDIS_ERROR_VERTEX;
    double *own = (double *)(uintptr_t)m->vertices, most = 0; /* the room is the caller's */
    double low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = 1e300, high[k] = -1e300;
    for (size_t i = 0; i < 3 * count; i += 3)
        for (size_t k = 0; k < 3; k++) {
            double x = (vertices[i + k] - moving->centre[k]) * moving->scale;
            own[i + k] = x, low[k] = x < low[k] ? x : low[k], high[k] = x > high[k] ? x : high[k];
        }
    for (int k = 0; k < 3; k++) {
        moving->low[k] = low[k], moving->high[k] = high[k];
        most = fmax(most, fmax(-low[k], high[k]));
    }
    m->reach = most;
    pandis__refit_boxes(m, (pandis__node *)(uintptr_t)m->nodes, (float (*)[2])(uintptr_t)m->slacks);
    return PANDIS_SUCCESS;
}

/* -------------------- meshes that another thread moves */

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__NEW 4

/* Exchange a number atomically; returns the old one. A thread that reads the number also sees all
 * earlier writes. */
static int32_t pandis__exchange(volatile int32_t *where, int32_t number) {
#if defined(__GNUC__)
    return __atomic_exchange_n(where, number, __ATOMIC_ACQ_REL);
#else
    return (int32_t)_InterlockedExchange((volatile long *)where, (long)number);
#endif
}

static int32_t pandis__peek(const volatile int32_t *where) {
#if defined(__GNUC__)
    return __atomic_load_n(where, __ATOMIC_RELAXED);
#else
    return *where;
#endif
}

PANDIS_API size_t pandis_handover_room(const pandis_field *field) {
    return 3 * pandis_refit_room(field);
}

PANDIS__ONCE PANDIS_API pandis_error pandis_handover_open(
    pandis_handover *handover, const pandis_field *field, void *room, size_t size) {
    pandis__handover *h = pandis__handover_of(handover);
    size_t each = pandis_refit_room(field);
    if (size < 3 * each) return PANDIS_ERROR_COUNT;
    for (int i = 0; i < 3; i++) {
        pandis_error error =
            pandis_refit_open(h->shapes + i, field, (unsigned char *)room + (size_t)i * each, each);
        if (error) return error;
    }
    h->writing = 0, h->asking = 1;
    (void)pandis__exchange(&h->waiting, 2 | PANDIS__NEW);
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_error pandis_handover_refit(
    pandis_handover *handover, const double *vertices, size_t count) {
    pandis__handover *h = pandis__handover_of(handover);
    pandis_error error = pandis_refit(h->shapes + h->writing, vertices, count);
    if (!error) h->writing = pandis__exchange(&h->waiting, h->writing | PANDIS__NEW) & 3;
    return error;
}

PANDIS_API int pandis_handover_take(pandis_handover *handover, pandis_field *moving) {
    pandis__handover *h = pandis__handover_of(handover);
    /* only this thread clears the flag */
    int is_new = (pandis__peek(&h->waiting) & PANDIS__NEW) != 0;
    if (is_new) h->asking = pandis__exchange(&h->waiting, h->asking) & 3;
    *moving = h->shapes[h->asking];
    return is_new;
}
#endif
/* -------------------- scenes */

/* Transform a point of the scene into the coordinates of an object's mesh. */
static void pandis__enter(const pandis_object *o, const double *point, double *p) {
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = point[k] - o->translation[k];
    for (int k = 0; k < 3; k++)
        p[k] =
            (o->rotation[k] * off[0] + o->rotation[3 + k] * off[1] + o->rotation[6 + k] * off[2]) /
            o->scale;
}

/* Query a point in the mesh's coordinates, and add its penalty force. There is none outside, or if
 * there is no answer. */
static void pandis__add_force(
    const pandis_object *o, const double *p, pandis_answer *answer, double *force) {
    pandis_query(o->field, p, answer);
    /* false for NaN */
    double push = answer->distance < 0 ? -o->stiffness * (answer->distance * o->scale) : 0;
    if (!(push > 0)) return;
    for (int k = 0; k < 3; k++) {
        const double *row = o->rotation + 3 * k;
        force[k] += push * pandis__dot(row, answer->normal);
    }
}

PANDIS_API pandis_flag pandis_object_force(
    const pandis_object *object, const double point[3], double force[3]) {
    pandis_answer answer;
    double p[3];
    force[0] = force[1] = force[2] = 0;
    pandis__enter(object, point, p);
    pandis__add_force(object, p, &answer, force);
    return answer.flag;
}

/* Whether a matrix is a rotation to within 1e-6, and a translation at most 1e100. */
static int pandis__places(const double *rotation, const double *translation) {
    double most = 0, across[3];
    for (int i = 0; i < 3; i++) {
        if (!(fabs(translation[i]) <= 1e100)) return 0;
        for (int j = 0; j < 3; j++) {
            double product = 0;
            for (int k = 0; k < 3; k++) product += rotation[3 * k + i] * rotation[3 * k + j];
            double off = fabs(product - (i == j));
            if (!(off <= most)) most = off; /* NaN, too */
        }
    }
    pandis__cross(rotation, rotation + 3, across);
    return most <= 1e-6 && pandis__dot(across, rotation + 6) > 0;
}

static int pandis__lies(const pandis_object *o) {
    if (!o->field || !o->field->kind || !pandis__places(o->rotation, o->translation)) return 0;
    return o->scale >= 1e-100 && o->scale <= 1e100 && o->stiffness >= 0 &&
        o->stiffness <= PANDIS__STIFFEST;
}

/* A scene keeps two balls per object in which the object cannot be touched: one for penalty forces,
 * one for contacts, whose proxies may be elsewhere. Centres and squared radii are stored in blocks,
 * coordinate by coordinate. */
enum { PANDIS__OF_FORCES, PANDIS__OF_CONTACTS };

static double *pandis__ball(const pandis__scene *scene, int use, size_t object) {
    double *balls = scene->room + (size_t)use * (PANDIS_SCENE_ROOM(scene->count) / 2);
    return balls + object / PANDIS_SCENE_BLOCK * 4 * PANDIS_SCENE_BLOCK +
        object % PANDIS_SCENE_BLOCK;
}

static void pandis__keep_ball(double *ball, const double *centre, double radius) {
    for (int k = 0; k < 3; k++) ball[k * PANDIS_SCENE_BLOCK] = centre[k];
    ball[3 * PANDIS_SCENE_BLOCK] = radius > 0 ? radius * radius : -1;
}

/* Distance from a point (unit frame) within which nothing can be touched, by the bounds of the
 * surface. */
static double pandis__clearance(const pandis_field *f, const double *u) {
    double off[3];
    for (int k = 0; k < 3; k++) {
        double below = f->low[k] - u[k], above = u[k] - f->high[k];
        double d = below > above ? below : above;
        off[k] = d > 0 ? d : 0;
    }
    return sqrt(pandis__dot(off, off)) - f->margin[0];
}

/* The worse of two flags, worst first: no answer, an estimate, a search that was cut short. */
static pandis_flag pandis__worse(pandis_flag one, pandis_flag other) {
    static const int rank[] = {0, 2, 3, 1, 0}; /* by flag */
    return rank[one] > rank[other] ? one : other;
}

/* Query an object if it may be touched at a point, and keep the ball in which it cannot be. */
static pandis_flag pandis__visit(
    pandis__scene *scene, size_t index, const double *point, double *force) {
    const pandis_object *o = scene->objects + index;
    const pandis_field *f = o->field;
    double p[3], u[3], size = 0;
    pandis_flag flag = PANDIS_OK;
    int inside = 1;
    pandis__enter(o, point, p);
    for (int k = 0; k < 3; k++) {
        u[k] = (p[k] - f->centre[k]) * f->scale;
        inside &= fabs(u[k]) <= 1;
        size = fmax(size, fmax(fabs(point[k]), fabs(o->translation[k])));
    }
    double clear = pandis__clearance(f, u);
    if (!(clear > 0)) {
        pandis_answer answer;
        pandis__add_force(o, p, &answer, force);
        scene->queries++;
        flag = answer.flag;
        double away = flag == PANDIS_CUT && answer.distance > 0 ? answer.clear : answer.distance;
        if (inside && flag != PANDIS_INVALID)
            clear = away * f->scale - f->margin[flag == PANDIS_BOUND];
    }
    /* less rounding errors, and the stretch of a rotation that is exact only within 1e-6 */
    pandis__keep_ball(pandis__ball(scene, PANDIS__OF_FORCES, index), point,
        clear * (o->scale / f->scale) * (1 - 4e-6) - 1e-12 * size);
    return flag;
}

/* Mark an object to be queried at the next point; leave it out if it is invalid. */
static pandis_error pandis__wake_object(const pandis__scene *scene, size_t object) {
    const double origin[3] = {0};
    int lies = pandis__lies(scene->objects + object);
    for (int use = PANDIS__OF_FORCES; use <= PANDIS__OF_CONTACTS; use++)
        pandis__keep_ball(pandis__ball(scene, use, object), origin, lies ? 0 : 1e150);
    return lies ? PANDIS_SUCCESS : PANDIS_ERROR_POSE;
}

PANDIS_API pandis_error pandis_scene_moved(pandis_scene *scene, size_t object) {
    const pandis__scene *s = pandis__scene_in(scene);
    return object < s->count ? pandis__wake_object(s, object) : PANDIS_ERROR_COUNT;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_scene_open(pandis_scene *scene,
    const pandis_object *objects, size_t count, double *room, size_t room_length) {
    const double origin[3] = {0};
    pandis__scene *s = pandis__scene_of(scene);
    pandis_error error = PANDIS_SUCCESS;
    memset(s, 0, sizeof *s);
    if (room_length < PANDIS_SCENE_ROOM(count)) return PANDIS_ERROR_COUNT;
    s->objects = objects, s->count = count, s->room = room;
    for (size_t i = 0; i < PANDIS_SCENE_ROOM(count) / 8; i++) {
        pandis__keep_ball(pandis__ball(s, PANDIS__OF_FORCES, i), origin, 1e150);
        pandis__keep_ball(pandis__ball(s, PANDIS__OF_CONTACTS, i), origin, 1e150);
    }
    for (size_t i = 0; i < count; i++)
        if (pandis__wake_object(s, i)) error = PANDIS_ERROR_POSE;
    return error;
}

PANDIS_API size_t pandis_scene_queries(const pandis_scene *scene) {
    return pandis__scene_in(scene)->queries;
}

/* Find the next object, from `from` on, that may be touched at a point; the count if there is none.
 */
static size_t pandis__next_awake(
    const pandis__scene *scene, int use, size_t from, const double *point) {
    size_t start = from - from % PANDIS_SCENE_BLOCK;
    for (; start < scene->count; start += PANDIS_SCENE_BLOCK, from = start) {
        const double *ball = pandis__ball(scene, use, start);
        int awake = from > start; /* mid-block: an earlier call already found this block awake */
        for (int i = 0; i < PANDIS_SCENE_BLOCK; i++) {
            double x = point[0] - ball[i], y = point[1] - ball[i + PANDIS_SCENE_BLOCK];
            double z = point[2] - ball[i + 2 * PANDIS_SCENE_BLOCK];
            awake |= x * x + y * y + z * z >= ball[i + 3 * PANDIS_SCENE_BLOCK];
        }
        for (size_t i = from; awake && i < scene->count && i < start + PANDIS_SCENE_BLOCK; i++) {
            const double *own = pandis__ball(scene, use, i);
            double x = point[0] - own[0], y = point[1] - own[PANDIS_SCENE_BLOCK];
            double z = point[2] - own[2 * PANDIS_SCENE_BLOCK];
            if (x * x + y * y + z * z >= own[3 * PANDIS_SCENE_BLOCK]) return i;
        }
    }
    return scene->count;
}

PANDIS_API pandis_flag pandis_scene_force(
    pandis_scene *scene, const double point[3], double force[3]) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_flag worst = PANDIS_OK;
    force[0] = force[1] = force[2] = 0;
    s->queries = 0;
    for (int k = 0; k < 3; k++)
        if (!(fabs(point[k]) <= 1e100)) return PANDIS_INVALID;
    for (size_t i = 0; (i = pandis__next_awake(s, PANDIS__OF_FORCES, i, point)) < s->count; i++)
        worst = pandis__worse(pandis__visit(s, i, point, force), worst);
    return worst;
}

/* -------------------- poses that another thread hands over */

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__HALF_TURN 3.1415926535897932

/* The quaternion (w, x, y, z) of a rotation. */
static void pandis__turn(const double *r, double *q) {
    double trace = r[0] + r[4] + r[8];
    int i = r[4] > r[0] ? 1 : 0;
    if (r[8] > r[4 * i]) i = 2;
    int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > 0) {
        q[0] = 1 + trace, q[1] = r[7] - r[5], q[2] = r[2] - r[6], q[3] = r[3] - r[1];
    } else {
        q[0] = r[3 * k + j] - r[3 * j + k];
        q[1 + i] = 1 + r[4 * i] - r[4 * j] - r[4 * k];
        q[1 + j] = r[3 * j + i] + r[3 * i + j], q[1 + k] = r[3 * k + i] + r[3 * i + k];
    }
}

static void pandis__unit_turn(double *q) {
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int k = 0; k < 4; k++) q[k] /= length;
}

/* Compose two rotations: first q, then p. */
static void pandis__turn_by(const double *p, const double *q, double *both) {
    both[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3];
    both[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2];
    both[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1];
    both[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0];
}

/* Compute the rotation by a spin in `dt` seconds, at most half a turn. A series gives a sixteenth
 * of this rotation, because the sines of libraries differ in their last bits. */
static void pandis__spun(const double *spin, double dt, double *q) {
    double half[3], whole[4];
    for (int k = 0; k < 3; k++) half[k] = spin[k] * dt / 32;
    double square = pandis__dot(half, half);
    double sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42));
    q[0] = 1 - square / 2 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56)));
    for (int k = 0; k < 3; k++) q[1 + k] = sine * half[k];
    for (int i = 0; i < 4; i++) {
        pandis__turn_by(q, q, whole);
        memcpy(q, whole, sizeof whole);
    }
}

/* The rotation of a quaternion. */
static void pandis__turned(const double *q, double *r) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    const double made[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y),
        2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
    memcpy(r, made, sizeof made);
}

/* The current path of an object: quaternion and translation at both ends. */
static double *pandis__way_of(const pandis__poses *poses, size_t object) {
    return poses->ways + 14 * object;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_poses_open(
    pandis_poses *handle, pandis_object *objects, size_t count, double *room, size_t room_length) {
    pandis__poses *poses = pandis__poses_of(handle);
    memset(poses, 0, sizeof *poses);
    if (room_length < PANDIS_POSES_ROOM(count)) return PANDIS_ERROR_COUNT;
    poses->objects = objects, poses->count = count;
    poses->frames = (pandis_pose *)(void *)room,
    poses->ways = room + 3 * count * (sizeof(pandis_pose) / sizeof *room);
    poses->asking = 1;
    poses->waiting = 2;
    for (size_t i = 0; i < count; i++) {
        const pandis_object *o = objects + i;
        double *way = pandis__way_of(poses, i);
        if (!pandis__lies(o)) return PANDIS_ERROR_POSE;
        pandis__turn(o->rotation, way);
        pandis__unit_turn(way);
        memcpy(way + 4, o->translation, sizeof o->translation);
        memcpy(way + 7, way, 7 * sizeof *way);
        pandis_pose pose;
        memset(&pose, 0, sizeof pose);
        memcpy(pose.rotation, o->rotation, sizeof o->rotation);
        memcpy(pose.translation, o->translation, sizeof o->translation);
        for (size_t k = 0; k < 3; k++) poses->frames[k * count + i] = pose;
    }
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_error pandis_poses_give(
    pandis_poses *handle, const pandis_pose *frame, size_t count, double period) {
    pandis__poses *poses = pandis__poses_of(handle);
    if (count != poses->count) return PANDIS_ERROR_COUNT;
    if (!(period > 0 && period <= 1e6)) return PANDIS_ERROR_POSE;
    for (size_t i = 0; i < poses->count; i++) {
        const pandis_pose *pose = frame + i;
        double fast = pandis__dot(pose->velocity, pose->velocity);
        double turns = sqrt(pandis__dot(pose->spin, pose->spin)) * period;
        if (!pandis__places(pose->rotation, pose->translation) || !(fast <= 1e100))
            return PANDIS_ERROR_POSE;
        if (!(turns <= PANDIS__HALF_TURN)) return PANDIS_ERROR_POSE;
    }
    memcpy(poses->frames + (size_t)poses->writing * count, frame, count * sizeof *frame);
    poses->periods[poses->writing] = period;
    poses->writing = pandis__exchange(&poses->waiting, poses->writing | PANDIS__NEW) & 3;
    return PANDIS_SUCCESS;
}

/* Begin a path from an object's current pose to the one that its velocity predicts for the next
 * frame. */
static void pandis__set_out(const pandis__poses *poses, size_t object) {
    const pandis_pose *pose = poses->frames + (size_t)poses->asking * poses->count + object;
    double *from = pandis__way_of(poses, object), *to = from + 7, given[4], spun[4];
    double share = poses->period > 0 ? poses->gone / poses->period : 1, same = 0;
    for (int k = 0; k < 7; k++) from[k] = share < 1 ? from[k] + share * (to[k] - from[k]) : to[k];
    /* after arrival the pose stays the same, to the last bit */
    if (share < 1) pandis__unit_turn(from);
    pandis__turn(pose->rotation, given);
    pandis__spun(pose->spin, poses->periods[poses->asking], spun);
    pandis__turn_by(spun, given, to);
    pandis__unit_turn(to);
    for (int k = 0; k < 4; k++) same += from[k] * to[k];
    for (int k = 0; k < 4 && same < 0; k++) to[k] = -to[k]; /* the shorter way round */
    for (int k = 0; k < 3; k++)
        to[4 + k] = pose->translation[k] + poses->periods[poses->asking] * pose->velocity[k];
}

static int pandis__poses_go(pandis__poses *poses, pandis_scene *scene, double dt) {
    /* only this thread clears the flag */
    int is_new = (pandis__peek(&poses->waiting) & PANDIS__NEW) != 0;
    if (is_new) {
        poses->asking = pandis__exchange(&poses->waiting, poses->asking) & 3;
        for (size_t i = 0; i < poses->count; i++) pandis__set_out(poses, i);
        poses->period = poses->periods[poses->asking], poses->gone = 0;
    }
    if (!(dt > 0) || !(poses->gone < poses->period)) return is_new; /* all have arrived */
    poses->gone += dt;
    double share = poses->gone < poses->period ? poses->gone / poses->period : 1;
    for (size_t i = 0; i < poses->count; i++) {
        const double *from = pandis__way_of(poses, i), *to = from + 7;
        pandis_object *o = poses->objects + i;
        double at[7];
        if (!memcmp(from, to, sizeof at)) continue;
        for (int k = 0; k < 7; k++) at[k] = share < 1 ? from[k] + share * (to[k] - from[k]) : to[k];
        pandis__unit_turn(at);
        pandis__turned(at, o->rotation);
        memcpy(o->translation, at + 4, sizeof o->translation);
        if (scene) (void)pandis_scene_moved(scene, i);
    }
    return is_new;
}

PANDIS_API int pandis_poses_step(pandis_poses *poses, pandis_scene *scene, double dt) {
    return pandis__poses_go(pandis__poses_of(poses), scene, dt);
}
#endif
/* -------------------- textures: heights over a surface */

#define PANDIS__TURN 6.283185307179586

PANDIS_API double pandis_waves(
    const void *ridges, const double point[3], int region, double gradient[3]) {
    const pandis_ridges *w = (const pandis_ridges *)ridges;
    double along = PANDIS__TURN * pandis__dot(point, w->direction) / w->length;
    (void)region;
    for (int k = 0; k < 3; k++)
        gradient[k] = w->height / 2 * PANDIS__TURN / w->length * cos(along) * w->direction[k];
    return w->height / 2 * (1 + sin(along));
}

/* A pseudo-random number from 0 to 1 for a node of the lattice. */
static double pandis__drawn(const int32_t *node) {
    uint32_t h = (uint32_t)node[0] * 0x8da6b343u ^ (uint32_t)node[1] * 0xd8163841u ^
        (uint32_t)node[2] * 0xcb1ab31fu;
    h = (h ^ h >> 15) * 0x2c1b3c6du, h = (h ^ h >> 12) * 0x297a2d39u;
    return (double)(h ^ h >> 15) / 4294967295.0;
}

PANDIS_API double pandis_noise(
    const void *bumps, const double point[3], int region, double gradient[3]) {
    const pandis_bumps *b = (const pandis_bumps *)bumps;
    double blend[3][2], change[3], sum = 0;
    int32_t low[3];
    (void)region;
    for (int k = 0; k < 3; k++) {
        double x = point[k] / b->length, t;
        if (!(fabs(x) < 1e9)) return gradient[0] = gradient[1] = gradient[2] = 0;
        low[k] = (int32_t)floor(x), t = x - floor(x);
        /* this blend has two continuous derivatives */
        blend[k][1] = t * t * t * (10 + t * (6 * t - 15)), blend[k][0] = 1 - blend[k][1];
        change[k] = 30 * t * t * (1 - t) * (1 - t) / b->length;
        gradient[k] = 0;
    }
    for (int corner = 0; corner < 8; corner++) {
        int at[3] = {corner & 1, corner >> 1 & 1, corner >> 2};
        int32_t node[3] = {low[0] + at[0], low[1] + at[1], low[2] + at[2]};
        double value = b->height * pandis__drawn(node);
        sum += value * blend[0][at[0]] * blend[1][at[1]] * blend[2][at[2]];
        for (int k = 0; k < 3; k++) {
            int i = (k + 1) % 3, j = (k + 2) % 3;
            gradient[k] += (at[k] ? value : -value) * change[k] * blend[i][at[i]] * blend[j][at[j]];
        }
    }
    return sum;
}

PANDIS_API double pandis_by_region(
    const void *patches, const double point[3], int region, double gradient[3]) {
    const pandis_patches *p = (const pandis_patches *)patches;
    const pandis_texture *t = p->textures + (region > 0 && region < p->count ? region : 0);
    if (t->height) return t->height(t->data, point, region, gradient);
    return gradient[0] = gradient[1] = gradient[2] = 0;
}
/* -------------------- planes that a proxy touches */

/* planes kept between steps: all walls of a corner, since any three may hold the proxy */
#define PANDIS__KEPT 8
#define PANDIS__PLANES 9 /* plus the plane of the last look */

/* A piece of the surface near a proxy, taken as flat: free space is where normal . x >= offset
 * (unit frame). */
typedef struct {
    double normal[3], offset, foot[3];
} pandis__plane;

static double pandis__height(const pandis__plane *p, const double *x) {
    return pandis__dot(p->normal, x) - p->offset;
}

/* Find the point on two or three planes that is nearest to a goal, if it is also the nearest one in
 * front of them, that is, if each plane pushes. Returns 0 if a plane does not push, or if the
 * planes are nearly parallel. */
static int pandis__onto(const pandis__plane *planes, const int *which, int count,
    const double *under, const double *goal, double *y) {
    const double *a = planes[which[0]].normal, *b = planes[which[1]].normal;
    double push[3], across[3][3], sum[3];
    pandis__cross(a, b, across[2]);
    if (count == 2) {
        /* 1 - c^2 without cancellation */
        double c = pandis__dot(a, b), det = pandis__dot(across[2], across[2]);
        if (!(det > 1e-14)) return 0;
        push[0] = (c * under[which[1]] - under[which[0]]) / det,
        push[1] = (c * under[which[0]] - under[which[1]]) / det;
    } else {
        const double *last = planes[which[2]].normal;
        pandis__cross(b, last, across[0]), pandis__cross(last, a, across[1]);
        double det = pandis__dot(a, across[0]);
        if (!(fabs(det) > 1e-9)) return 0;
        for (int k = 0; k < 3; k++)
            sum[k] = -(under[which[0]] * across[0][k] + under[which[1]] * across[1][k] +
                         under[which[2]] * across[2][k]) /
                det;
        for (int i = 0; i < 3; i++) push[i] = pandis__dot(sum, across[i]) / det;
    }
    for (int k = 0; k < 3; k++) y[k] = goal[k];
    for (int i = 0; i < count; i++) {
        if (!(push[i] >= 0)) return 0;
        for (int k = 0; k < 3; k++) y[k] += push[i] * planes[which[i]].normal[k];
    }
    return 1;
}

/* Find the point nearest to a goal on one to three planes. It counts if the goal is behind one of
 * these planes, and the point in front of all other planes. Returns a bit mask of these planes,
 * or 0 if the point does not count. */
static int pandis__gives(const pandis__plane *planes, int count, const int *which, int size,
    const double *under, int behind, const double *goal, double *y) {
    int set = 0;
    for (int i = 0; i < size; i++) set |= 1 << which[i];
    if (!(set & behind)) return 0;
    if (size == 1)
        for (int k = 0; k < 3; k++) y[k] = goal[k] - under[which[0]] * planes[which[0]].normal[k];
    else if (!pandis__onto(planes, which, size, under, goal, y)) return 0;
    for (int i = 0; i < count; i++)
        if (!(set >> i & 1) && pandis__height(planes + i, y) < -1e-13) return 0;
    return set;
}

/* Find the point nearest to a goal in front of all planes; returns a bit mask of the planes that
 * hold it back. If no point is in front of all planes, the last plane, which is the newest,
 * decides. */
static int pandis__nearest_in_front(
    const pandis__plane *planes, int count, const double *goal, double *y) {
    double under[PANDIS__PLANES];
    int set, behind = 0;
    for (int i = 0; i < count; i++)
        under[i] = pandis__height(planes + i, goal), behind |= (under[i] < 0) << i;
    memcpy(y, goal, 3 * sizeof *y);
    if (!behind) return 0;
    for (int i = 0; i < count; i++)
        if ((set = pandis__gives(planes, count, &i, 1, under, behind, goal, y))) return set;
    for (int j = 1; j < count; j++)
        for (int i = 0; i < j; i++) {
            const int which[2] = {i, j};
            if ((set = pandis__gives(planes, count, which, 2, under, behind, goal, y))) return set;
        }
    for (int k = 2; k < count; k++)
        for (int j = 1; j < k; j++)
            for (int i = 0; i < j; i++) {
                const int which[3] = {i, j, k};
                if ((set = pandis__gives(planes, count, which, 3, under, behind, goal, y)))
                    return set;
            }
    int last = count - 1;
    for (int k = 0; k < 3; k++) y[k] = goal[k] - fmin(0, under[last]) * planes[last].normal[k];
    return under[last] < 0 ? 1 << last : 0;
}
/* -------------------- a proxy, and the known surface near it
 *
 * Everything is in the object's unit frame. The proxy is a point; a probe of radius r offsets the
 * surface by r. The known free space is a ball around a point a little above the proxy, as large as
 * the distance there. The proxy goes from ball to ball. Each ball overlaps the one before, so no
 * surface is on the proxy's path. The surface is represented by planes. Each goes through the
 * foot of a point that was looked at. */

#define PANDIS__HOVER 0.004 /* height from which the surface is looked at */
#define PANDIS__FARTHEST 2  /* largest distance from which a place is looked at, in lifts */
/* a plane is forgotten if its foot is farther away than this, in lifts */
#define PANDIS__STALE 4
/* cosine of the angle below which two planes count as nearly equal */
#define PANDIS__ALIKE 0.99
/* a surface no farther behind a plane than this counts as in front of it */
#define PANDIS__BEHIND 1e-8
#define PANDIS__TRUSTED 0.8      /* free share of an approximate distance to the surface as felt */
#define PANDIS__LEAST_SHARE 0.25 /* likewise, of a distance that is flagged as a bound */
#define PANDIS__GUESSED 0.05     /* assumed excess of a distance if the file does not state it */

enum { PANDIS__BEGINS, PANDIS__CLEAR, PANDIS__TOUCHES };

/* A proxy while it is moved in a step. */
typedef struct {
    pandis__contact *state;
    const pandis_field *field;
    /* offset of the walls from the surface; less if the probe began nearer than that */
    double radius;
    double tolerance; /* for comparing planes */
    double blur;      /* a surface this near, or this little behind a plane, is ignored */
    int exact;        /* the field's distances are exact, not approximate */
    int flat;         /* exact, and no texture changes the surface */
    int queries, count;
    pandis_flag flag;
    pandis__plane plane[PANDIS__PLANES];
    double *x, *ball;
} pandis__proxy;

/* Result of a look at a point: the distance, the radius of the free ball around the point and of
 * the ball that can be entered without a look, and the normal and foot of the surface. */
typedef struct {
    double at[3], distance, free, sure, normal[3], foot[3];
    int32_t face, region;
} pandis__look;

static int pandis__knows_distance(const pandis_field *f) {
    return f->kind && !(f->kind == PANDIS_GRID && f->as.grid.rule <= PANDIS__TRILINEAR);
}

/* Apply a texture to the result of a look. The distance becomes that to the tangent plane of the
 * raised surface below the point, the normal becomes that of this plane, and the free radius
 * shrinks. */
static void pandis__roughen(const pandis__proxy *p, const double *at, pandis_answer *answer,
    double *distance, double *free, double *sure) {
    const pandis_texture *t = p->state->options.texture;
    const pandis_field *f = p->field;
    double foot[3], slope[3], *n = answer->normal;
    for (int k = 0; k < 3; k++) foot[k] = (at[k] - *distance * n[k]) / f->scale + f->centre[k];
    double raised = t->height(t->data, foot, f->regions ? answer->region : p->state->region, slope);
    raised = (raised > 0 ? raised < t->most ? raised : t->most : 0) * f->scale; /* 0 for NaN, too */
    double along = pandis__dot(slope, n), steep = 0;
    for (int k = 0; k < 3; k++) slope[k] -= along * n[k], steep += slope[k] * slope[k];
    if (!(steep <= 1e6)) slope[0] = slope[1] = slope[2] = steep = 0;
    for (int k = 0; k < 3; k++) n[k] = (n[k] - slope[k]) / sqrt(1 + steep);
    *distance = (*distance - raised) / sqrt(1 + steep);
    /* the raised surface lies below a cone over the foot with twice the slope: feet move up to
     * twice as far as points */
    *free = fmin(*free, (*free - raised) / sqrt(1 + 4 * t->steepest * t->steepest)),
    *sure -= t->most * f->scale;
}

/* Lower bound of the distance to a network's surface from a place beyond its box. The surface is
 * inside the box. Its distance from the nearest point of the box is at least a share of the
 * network's distance there. */
PANDIS__ONCE static double pandis__free_beyond(
    const pandis__proxy *p, const double *at, double distance) {
    double way = 0;
    for (int k = 0; k < 3; k++) {
        double over = fmax(0, fabs(at[k]) - 1);
        way += over * over;
    }
    double there = distance - sqrt(way);
    if (there > p->radius) there = PANDIS__TRUSTED * (there - p->radius) + p->radius;
    return there > 0 ? sqrt(way + there * there) : -INFINITY; /* inside: nothing is known */
}

/* Look at a point; 0 if there is no answer. */
static int pandis__look_at(pandis__proxy *p, const double *at, pandis__look *look) {
    const pandis_field *f = p->field;
    pandis_answer answer;
    double point[3];
    for (int k = 0; k < 3; k++) look->at[k] = at[k], point[k] = at[k] / f->scale + f->centre[k];
    pandis_query(f, point, &answer);
    p->queries++;
    p->flag = pandis__worse(answer.flag, p->flag);
    if (answer.flag == PANDIS_INVALID) return 0;
    double distance = answer.distance * f->scale, free = distance, sure;
    if (p->exact) {
        sure = free = fmin(distance, answer.clear * f->scale);
    } else if (answer.flag == PANDIS_OK) {
        sure = distance - f->margin[0],
        free = fmax(PANDIS__TRUSTED * (distance - p->radius) + p->radius, sure);
    } else {
        /* the margin applies in the box; beyond it only the surface's bounds are known */
        int inside = fabs(at[0]) <= 1 && fabs(at[1]) <= 1 && fabs(at[2]) <= 1;
        double guessed = f->margin[1] < 1e300 ? f->margin[1] : PANDIS__GUESSED;
        double away = f->margin[0] < 1e300 ? pandis__clearance(f, at) : -1;
        /* also a lower bound: a spline covers the space up to this distance from the surface */
        double least = f->kind == PANDIS_SPLINE && distance > 0 ? f->as.spline.outside
                                                                : PANDIS__LEAST_SHARE * distance;
        sure = inside ? fmax(away, distance - guessed) : away,
        free = fmin(distance, fmax(least, sure));
        if (inside && distance > 0) free = fmax(free, f->height);
        if (!inside && f->kind == PANDIS_NETWORK)
            free = fmax(free, pandis__free_beyond(p, at, distance));
    }
    look->face = answer.face, look->region = answer.region;
    if (p->state->options.texture) pandis__roughen(p, at, &answer, &distance, &free, &sure);
    look->distance = distance - p->radius, look->free = free - p->radius;
    look->sure = fmin(sure, free) - p->radius;
    for (int k = 0; k < 3; k++) {
        look->normal[k] = answer.normal[k];
        look->foot[k] = at[k] - look->distance * answer.normal[k];
    }
    return 1;
}

static void pandis__drop(pandis__proxy *p, int index) {
    for (int i = index; i + 1 < p->count; i++) p->plane[i] = p->plane[i + 1];
    p->count--;
}

/* Forget planes that the last look shows not to be the surface here. The surface bends away from a
 * plane if the new foot is behind it or, where both planes are nearly parallel, not in front of it;
 * a look from inside does not count, since from there this may hold in any corner. Planes through a
 * free place, planes with the same normal as the new one, and planes whose foot is too far away are
 * forgotten, too. */
static void pandis__forget(
    pandis__proxy *p, const pandis__plane *seen, int inside, const double *place, double height) {
    double stale = PANDIS__STALE * PANDIS__HOVER;
    for (int i = p->count - 1; i >= 0; i--) {
        const pandis__plane *old = p->plane + i;
        double off[3], between[3], cross[3];
        for (int k = 0; k < 3; k++)
            off[k] = old->foot[k] - place[k], between[k] = seen->foot[k] - old->foot[k];
        pandis__cross(old->normal, seen->normal, cross);
        double angle = sqrt(pandis__dot(cross, cross)), apart = sqrt(pandis__dot(between, between));
        int same = angle < fmax(1e-7, p->tolerance) && pandis__dot(old->normal, seen->normal) > 0;
        double ahead = pandis__dot(old->normal, between);
        int bent = angle < 0.1 ? ahead <= 1e-3 * angle * apart : ahead < -p->blur;
        int open = height > p->tolerance && pandis__height(old, place) < height / 2;
        if (same || (bent && !inside) || open || pandis__dot(off, off) > stale * stale)
            pandis__drop(p, i);
    }
}

/* Add the plane of a look as the last one. If the proxy were at `place`, it would be at least
 * `height` above the surface. */
static void pandis__learn(
    pandis__proxy *p, const pandis__look *look, const double *place, double height) {
    pandis__plane seen;
    memcpy(seen.normal, look->normal, sizeof seen.normal);
    memcpy(seen.foot, look->foot, sizeof seen.foot);
    seen.offset = pandis__dot(seen.normal, seen.foot);
    /* two planes that face each other without a gap come from a fold in the surface: ignore the new
     * plane if the look was made less than the blur from it, else forget the old one */
    for (int i = p->count - 1; i >= 0; i--) {
        double gap = pandis__height(p->plane + i, seen.foot);
        if (pandis__dot(p->plane[i].normal, seen.normal) > -PANDIS__ALIKE || fabs(gap) > p->blur)
            continue;
        if (fabs(look->distance) < p->blur) return;
        pandis__drop(p, i);
    }
    pandis__forget(p, &seen, look->distance < -p->blur, place, height);
    if (p->count == PANDIS__PLANES) pandis__drop(p, 0);
    p->plane[p->count++] = seen;
    p->state->face = look->face;
    /* else the region is queried once per step */
    if (p->field->regions || !p->state->options.regions) p->state->region = look->region;
}

static double pandis__between(const double *a, const double *b) {
    double off[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(pandis__dot(off, off));
}

/* Find the point from which to check whether the proxy can be at a place: the nearest point that is
 * `lift` above all planes. If `nearest` is not NULL, the point is twice as high above planes that
 * are unlike it. Where planes meet at a sharp angle or face each other, no such point is near, so
 * the lift is reduced. */
static void pandis__lifted(
    const pandis__proxy *p, const double *place, const double *nearest, double lift, double *at) {
    pandis__plane raised[PANDIS__PLANES];
    double height = lift;
    memcpy(at, place, 3 * sizeof *at);
    if (p->count == 1) {
        double more = fmax(0, lift - fmax(0, pandis__height(p->plane, place)));
        for (int k = 0; k < 3; k++) at[k] += more * p->plane[0].normal[k];
        return;
    }
    for (int turn = 0; turn < 12; turn++) {
        double up[3], lacks = 0;
        for (int i = 0; i < p->count; i++) {
            const pandis__plane *plane = p->plane + i;
            int twice = nearest && pandis__dot(plane->normal, nearest) < PANDIS__ALIKE;
            raised[i] = *plane;
            raised[i].offset += (twice ? 2 : 1) * height + fmin(0, pandis__height(plane, place));
        }
        pandis__nearest_in_front(raised, p->count, place, up);
        for (int i = 0; i < p->count; i++) lacks = fmax(lacks, -pandis__height(raised + i, up));
        double far = pandis__between(up, place), most = PANDIS__FARTHEST * lift;
        if (lacks < 0.01 * height && far <= most * (1 + 1e-9)) {
            memcpy(at, up, sizeof up);
            return;
        }
        height *= lacks < 0.01 * height ? fmax(0.3, fmin(0.9, most / far)) : 0.7;
    }
}

static void pandis__take_ball(pandis__proxy *p, const pandis__look *look) {
    memcpy(p->ball, look->at, 3 * sizeof *p->ball);
    p->ball[3] = look->free, p->ball[4] = look->sure;
}
/* -------------------- how a proxy hops to a target */

#define PANDIS__SMALL 1e-13 /* shorter motions count as 0 (unit frame) */
#define PANDIS__ABOVE 4e-6  /* largest height of the proxy above a plane that it touches */
#define PANDIS__GAP 5e-4    /* largest gap between ball and proxy in an edge or a corner */
#define PANDIS__ASIDE 1e-3  /* sideways offset of a second look, in lifts */
#define PANDIS__SLIVER 2e-4 /* length of a path that need not be known to be free */

/* Whether a look shows a wall that is nearer than all known planes. */
static int pandis__unknown(const pandis__proxy *p, const pandis__look *look) {
    double least = INFINITY;
    for (int i = 0; i < p->count; i++) least = fmin(least, pandis__height(p->plane + i, look->at));
    return p->count && look->distance < least - 0.1 * fabs(least) - p->blur;
}

/* Rebuild the chain of balls from the proxy upwards. Each ball overlaps the one below it, and the
 * lowest reaches the proxy to within a sliver. The chain ends at the lift, or where, in an
 * edge, a ball would miss the proxy by too much. Returns 0 if there was no answer, 2 if an unknown
 * wall was met, else 1. */
static int pandis__climb(pandis__proxy *p) {
    pandis__contact *c = p->state;
    double at[3], lift = fmin(PANDIS__SLIVER / PANDIS__FARTHEST, c->lift), reached = 0;
    for (int failed = 0; failed < 2 && p->queries < c->options.budget;) {
        pandis__look look;
        pandis__lifted(p, p->x, NULL, lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        if (p->flat && pandis__unknown(p, &look)) {
            pandis__learn(p, &look, p->x, 0);
            return 2;
        }
        double away = pandis__between(at, p->x);
        double gap =
            reached > 0 ? pandis__between(at, p->ball) - p->ball[3] : away - PANDIS__SLIVER;
        if (look.free > 0 && gap <= look.free * (1 + 1e-9) && away <= look.free + PANDIS__GAP) {
            pandis__take_ball(p, &look);
            if (lift >= c->lift) return 1;
            /* between planes through the proxy, overlapping balls grow by this factor */
            double sine = fmin(0.5, look.free / fmax(away, PANDIS__SMALL));
            reached = lift, lift *= 0.99 * (1 + sine) / (1 - sine);
        } else {
            if (!(reached > 0)) return 1;
            failed++, lift = sqrt(lift * reached);
        }
        lift = fmin(lift, c->lift);
    }
    if (reached > 0) c->lift = reached;
    return 1;
}

/* Find a larger ball above the proxy. 0: no answer. */
static int pandis__widen(pandis__proxy *p) {
    pandis__look look;
    double at[3];
    pandis__lifted(p, p->x, NULL, PANDIS__HOVER, at);
    if (!pandis__look_at(p, at, &look)) return 0;
    if (!(look.free > p->ball[3] && pandis__between(at, p->x) <= look.free + PANDIS__GAP))
        return pandis__climb(p);
    pandis__take_ball(p, &look);
    return 1;
}

/* Find a new ball. If the surface has moved past the proxy, the proxy is put back onto it. 0: no
 * answer. */
static int pandis__regain(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (look.distance < 0) memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    pandis__take_ball(p, &look);
    return pandis__widen(p);
}

/* The proxy's motion in a step. */
typedef struct {
    double travel;            /* largest distance along the surface */
    double sticking, sliding; /* friction coefficients */
    double soft;              /* share of the motion along the surface that drag leaves */
    double slip;              /* distance that friction and drag allow; negative until known */
    double shrink;            /* share of a hop that is tried */
    double slid, goal[3];     /* distance slid so far; goal without friction */
    int arriving;             /* the proxy is not yet on the planes */
    /* bit sets: planes that hold the proxy back, and planes with friction */
    int active, rubs;
    int held;    /* stopped by `travel` or the budget */
    int stuck;   /* no further motion was found */
    int turned;  /* number of times that another wall was in the way */
    int refused; /* number of times that a step would have led away from the probe */
    /* number of balls that did not join the last one, and of balls that did not reach the target */
    int lost, narrow;
    /* whether the chain of balls was rebuilt; number of further looks at distant planes */
    int climbed, confirmed;
} pandis__way;

/* Move the proxy to a place. */
static void pandis__arrive(pandis__proxy *p, pandis__way *way, const double *place) {
    double step = pandis__between(place, p->x);
    way->shrink = 1;
    if (step > 1e-3 * PANDIS__SLIVER) p->state->settled = 0;
    if (step > PANDIS__SLIVER) p->state->close = 0;
    if (way->active && !way->arriving)
        way->slip = fmax(0, way->slip - step), way->slid += step, way->travel -= step;
    memcpy(p->x, place, 3 * sizeof *place);
}

/* Move towards a target beyond the known free space: look from the rim of the ball, and move from
 * there as far as the new ball reaches. */
static int pandis__go_on(
    pandis__proxy *p, pandis__way *way, const double *at, const double *target) {
    pandis__look look;
    if (way->active && !way->arriving) { /* the proxy is on the surface, and stays there */
        way->held = way->stuck = 1;
        return 1;
    }
    double rim[3], place[3], far = pandis__between(at, p->ball),
                             share = fmin(1, 0.95 * p->ball[3] / far);
    for (int k = 0; k < 3; k++) rim[k] = p->ball[k] + share * (at[k] - p->ball[k]);
    if (!pandis__look_at(p, rim, &look)) return 0;
    if (look.free > 0) {
        double to = pandis__between(target, rim), within = to > look.free ? look.free / to : 1;
        for (int k = 0; k < 3; k++) place[k] = rim[k] + within * (target[k] - rim[k]);
        pandis__take_ball(p, &look);
        if (!p->exact) { /* a field steeper than a distance overstates the free space */
            pandis__look near;
            if (!pandis__look_at(p, place, &near)) return 0;
            if (near.distance < -PANDIS__SLIVER) {
                memcpy(place, rim, sizeof place);
                look = near;
            }
        }
        pandis__arrive(p, way, place);
    }
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Start over with the surface at the proxy. If the proxy has sunk in by less than a sliver, move it
 * out. 0: no answer. */
static int pandis__emerge(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (p->flat && look.distance < 0 && look.distance > -PANDIS__SLIVER)
        memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Look from above the target, and take the free ball there if it joins the last one. Returns 0 if
 * there was no answer, 1 if the hop ends here, 2 if it goes on. In the last case `height` becomes a
 * lower bound of the target's height. */
static int pandis__hop_over(
    pandis__proxy *p, pandis__way *way, const double *target, pandis__look *look, double *height) {
    pandis__contact *c = p->state;
    double at[3];
    pandis__lifted(p, target, NULL, c->lift, at);
    if (!pandis__look_at(p, at, look)) return 0;
    int joined =
        look->free > 0 && pandis__between(at, p->ball) <= (p->ball[3] + look->free) * (1 + 1e-9);
    /* the look shows an unknown wall, or one that was forgotten */
    if (!joined && way->active && (!p->flat || pandis__unknown(p, look)) && way->lost++ < 2) {
        /* the ball must be in front of the foot; else the foot is on a wall's other side */
        double before = 0;
        for (int k = 0; k < 3; k++) before += (p->ball[k] - look->foot[k]) * look->normal[k];
        if (before < 0.5 * p->ball[3] && !pandis__look_at(p, p->x, look)) return 0;
        pandis__learn(p, look, p->x, 0);
        return 1;
    }
    int reaches = pandis__between(p->ball, p->x) <= p->ball[3] + PANDIS__GAP;
    if (!joined && way->active && !(reaches && way->shrink > 0.02) && !way->climbed++) {
        int climbed = pandis__climb(p);
        way->climbed = climbed == 1, way->shrink = 1;
        return climbed > 0;
    }
    if (!joined && way->active)
        way->shrink *= 0.3, c->lift = fmax(0.7 * c->lift, PANDIS__HOVER / 64);
    if (!joined) return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, at, target);
    double gap = pandis__between(target, at) - look->free;
    /* another wall is near: next time look from lower down, between the walls */
    if (gap > (p->flat ? PANDIS__GAP : look->free) && way->narrow++ < 6) {
        c->lift = fmax(c->lift * fmin(0.9, fmax(0.4, PANDIS__GAP / gap)), PANDIS__HOVER / 64);
        pandis__learn(p, look, p->x, 0);
        return 1;
    }
    pandis__take_ball(p, look);
    *height = look->free - pandis__between(target, at);
    return 2;
}

/* Refuse a place that is farther from the probe than the proxy is. `learnt`: whether this hop found
 * a plane. 0: no answer. */
static int pandis__refuse(pandis__proxy *p, pandis__way *way, int learnt) {
    if (learnt && way->refused < 2) { /* another wall, which changes the goal */
        way->refused++;
        return 1;
    }
    /* the known planes are inconsistent: start over from the surface at the proxy */
    if (way->refused++ < 3) {
        if (!pandis__emerge(p)) return 0;
        p->state->close = 1;
        return 1;
    }
    way->shrink *= 0.25;
    if (way->shrink <= 1e-2) way->held = way->stuck = 1; /* the next step tries again */
    return 1;
}

/* Try to bring the proxy to a target. 0: there was no answer. */
static int pandis__hop(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    pandis__contact *c = p->state;
    pandis__look look, near;
    double place[3], step = pandis__between(target, p->x);
    double most = way->active ? way->shrink * fmax(1.9 * p->ball[3], 1e-3 * PANDIS__HOVER) : step;
    if (step > most)
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + most / step * (target[k] - p->x[k]);
    double over = pandis__between(target, p->ball) - p->ball[3], height = 0;
    int closely = !p->flat || c->close; /* look at the place itself, not from above */
    int looked = !closely || over > 0.25 * c->lift;
    if (looked) {
        int goes = pandis__hop_over(p, way, target, &look, &height);
        if (goes < 2) return goes;
    }
    if (!closely && height < -PANDIS__SLIVER) { /* in an edge: the ball does not reach into it */
        pandis__learn(p, &look, target, height);
        if (!pandis__look_at(p, target, &near)) return 0;
        height = near.distance;
        /* on the surface the normal may be an edge's or a fold's */
        if (fabs(height) > p->blur) look = near;
        /* the look shows nothing new: NaN marks it as not to be learnt */
        if (height > (p->flat ? -p->blur : -PANDIS__SLIVER)) look.at[0] = (double)NAN;
    }
    if (closely && height < PANDIS__HOVER) {
        if (!pandis__look_at(p, target, &near)) return 0;
        if (near.distance < -PANDIS__HOVER) { /* deeper than expected */
            way->shrink *= 0.3;
            return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, target, target);
        }
        if (near.free > p->ball[3]) pandis__take_ball(p, &near);
        height = near.distance;
        if (!p->flat || !looked || fabs(height) > p->blur) look = near;
    }
    int learnt = look.at[0] == look.at[0];
    if (learnt) pandis__learn(p, &look, target, height);
    pandis__nearest_in_front(p->plane, p->count, target, place);
    double now = pandis__between(p->x, probe);
    if (pandis__between(place, p->x) > PANDIS__SMALL && way->active &&
        pandis__between(place, probe) > now * (1 + 1e-9) + PANDIS__SMALL)
        return pandis__refuse(p, way, learnt);
    if (pandis__between(place, target) > PANDIS__SLIVER) { /* another wall: look there first */
        way->held = way->stuck = ++way->turned > 6;
        return 1;
    }
    pandis__arrive(p, way, place);
    return 1;
}
/* -------------------- how a proxy follows the probe */

/* Distance by which friction and drag let the proxy move towards a place `step` away, if the proxy
 * is pressed in by `press`. */
static double pandis__rubbed(pandis__contact *c, pandis__way *way, double step, double press) {
    double friction = (c->sticks ? way->sticking : way->sliding) * press;
    if (way->slip < 0) { /* the first call in this step */
        c->sticks = friction > 0 && step <= friction;
        friction = way->sliding * press;
        way->slip = c->sticks               ? 0
            : friction > 0 || way->soft < 1 ? fmax(0, step - friction) * way->soft
                                            : 1e300;
    }
    return fmin(fmax(0, step - friction), way->slip);
}

/* Find the next target on the way to the point in front of all planes that is nearest to the probe:
 * as far along as friction lets the proxy go. Returns the target's distance from the proxy. */
static double pandis__aim(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    way->active = pandis__nearest_in_front(p->plane, p->count, probe, way->goal);
    double wanted = pandis__between(way->goal, p->x), step = wanted;
    way->held = way->arriving = way->rubs = 0;
    double reach = 1; /* share of the path to the probe at which the first plane is met */
    for (int i = 0, touches = 0; i < p->count; i++) {
        double above = pandis__height(p->plane + i, p->x),
               below = -pandis__height(p->plane + i, probe);
        touches |= above <= PANDIS__ABOVE;
        way->arriving = way->active && !touches;
        if (below > 0 && above > 0) reach = fmin(reach, above / (above + below));
    }
    if (way->active && way->arriving) { /* no friction before the proxy has arrived */
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + reach * (probe[k] - p->x[k]);
        return pandis__between(target, p->x);
    }
    if (way->active) {
        pandis__plane touched[PANDIS__PLANES];
        double place[3];
        int count = 0, which[PANDIS__PLANES];
        for (int i = 0; i < p->count; i++)
            if (pandis__height(p->plane + i, p->x) <= PANDIS__ABOVE)
                which[count] = i, touched[count++] = p->plane[i];
        if (count < p->count) { /* only planes that the proxy touches cause friction */
            int rubs = pandis__nearest_in_front(touched, count, probe, place);
            for (int i = 0; i < count; i++) way->rubs |= (rubs >> i & 1) << which[i];
            double far = pandis__between(place, p->x),
                   free = pandis__rubbed(p->state, way, far, pandis__between(place, probe));
            step = fmin(step, free);
        } else {
            step = pandis__rubbed(p->state, way, step, pandis__between(way->goal, probe));
        }
        if (step > way->travel) step = way->travel, way->held = 1;
    }
    double share = wanted > 0 ? step / wanted : 0;
    for (int k = 0; k < 3; k++)
        target[k] = share < 1 ? p->x[k] + share * (way->goal[k] - p->x[k]) : way->goal[k];
    return step;
}

/* If the proxy is behind planes by at most a sliver, move it in front of them. Planes that it is
 * farther behind are dropped: the proxy is in free space, so these planes must be beyond an edge.
 */
static void pandis__come_out(pandis__proxy *p) {
    double place[3], behind = 0;
    for (int i = p->count - 1; i >= 0; i--) {
        double height = pandis__height(p->plane + i, p->x);
        if (height < (p->flat ? -PANDIS__SLIVER : -2 * PANDIS__GAP)) pandis__drop(p, i);
        else behind = fmin(behind, height);
    }
    if (!p->flat || behind > -p->blur) return;
    pandis__nearest_in_front(p->plane, p->count, p->x, place);
    if (pandis__between(place, p->x) < PANDIS__FARTHEST * PANDIS__SLIVER)
        memcpy(p->x, place, sizeof place);
}

/* Look again at a plane, from a point that is nearer to it than to the other planes that hold the
 * proxy. Returns whether the plane changed, or -1 if there was no answer. `height` becomes a lower
 * bound of the proxy's height above the surface, or 0 if none is known. */
static int pandis__look_again(
    pandis__proxy *p, const pandis__plane *plane, double lift, double *height) {
    const pandis__plane held = *plane;
    pandis__look look;
    double at[3], cross[3];
    pandis__lifted(p, p->x, held.normal, lift, at);
    /* a little aside: right above a ridge, every plane through the ridge would confirm itself */
    if (p->field->kind != PANDIS_SHAPE && p->flat)
        for (int k = 0; k < 3; k++)
            at[k] += PANDIS__ASIDE * lift * (held.normal[(k + 1) % 3] - held.normal[(k + 2) % 3]);
    if (!pandis__look_at(p, at, &look)) return -1;
    pandis__cross(look.normal, held.normal, cross);
    for (int j = 0; j < p->count; j++)
        if (!memcmp(p->plane + j, &held, sizeof held)) pandis__drop(p, j--);
    *height = p->flat ? look.free - pandis__between(at, p->x) : 0;
    pandis__learn(p, &look, p->x, *height);
    return pandis__dot(cross, cross) > 1e-18 || *height > p->tolerance;
}

/* Look again at planes that hold the proxy. If the proxy rests, look at all of them, since on a
 * curved surface an old plane may no longer apply, and check whether the proxy has sunk into an
 * unknown wall. If it moves, look only at planes whose foot is distant. Returns how many planes
 * changed, or -1 if there was no answer. */
static int pandis__confirm(pandis__proxy *p, const pandis__way *way, int rests) {
    pandis__plane held[PANDIS__PLANES];
    double height = -1, most = -1;
    int count = p->count, changed = 0;
    memcpy(held, p->plane, sizeof held);
    for (int i = 0; i < count; i++) {
        int distant = pandis__between(held[i].foot, p->x) > PANDIS__STALE * PANDIS__HOVER / 2;
        if (!((way->active | way->rubs) >> i & 1) || !(rests || distant)) continue;
        /* a moving proxy looks from half the lift, so that the new foot does not count as distant
         * again */
        int other = pandis__look_again(p, held + i, (rests ? 1 : 0.5) * p->state->lift, &height);
        if (other < 0) return -1;
        changed += rests ? other : 1, most = fmax(most, height);
    }
    if (rests && !changed && most < -p->blur) {
        pandis__look look;
        if (!pandis__look_at(p, p->x, &look)) return -1;
        if (look.distance < -p->blur) changed = 1, pandis__learn(p, &look, p->x, look.distance);
        else if (look.distance > fmax(p->blur, PANDIS__ABOVE)) {
            /* the proxy does not touch the planes that hold it */
            changed = 1, p->count = 0;
            pandis__learn(p, &look, p->x, 0);
        }
    }
    return changed;
}

/* Bring the proxy as near to the probe as it can come. Returns 0 if there was no answer. */
static int pandis__follow(pandis__proxy *p, pandis__way *way, const double *probe) {
    pandis__contact *c = p->state;
    double target[3];
    /* the probe is in known free space, whatever the planes indicate */
    if (pandis__between(probe, p->ball) < p->ball[4]) {
        memcpy(p->x, probe, 3 * sizeof *probe);
        return 1;
    }
    if (c->state == PANDIS__TOUCHES && p->ball[3] < c->lift / 16 && !pandis__widen(p)) return 0;
    /* queries after which a short remainder is left to the next step: more if the last steps made
     * no progress */
    const int soon = p->queries + 2 + 4 * c->stalled;
    const double before[3] = {p->x[0], p->x[1], p->x[2]};
    /* each turn queries the field or ends the step; the bound is a safeguard */
    for (int turn = 0; turn < 4 * c->options.budget; turn++) {
        pandis__come_out(p);
        double step = pandis__aim(p, way, probe, target);
        if (step <= PANDIS__SMALL) {
            if (!way->active || way->held || c->settled > 8 || p->queries + 3 > c->options.budget)
                return 1;
            c->stalled = 0;
            int changed = pandis__confirm(p, way, 1);
            if (changed < 0) return 0;
            c->settled = changed ? c->settled + 1 : 9;
            continue;
        }
        /* a hop can be this long, even in a groove */
        double small = fmin(PANDIS__HOVER / 8, 1.9 * p->ball[3]);
        if (p->queries >= c->options.budget ||
            (way->active && p->queries >= soon && step < small)) {
            way->held |= p->queries >= c->options.budget;
            c->stalled = pandis__between(p->x, before) > PANDIS__SMALL ? 0
                : c->stalled < 5                                       ? c->stalled + 1
                                                                       : 5;
            return 1;
        }
        int distant = way->active && !way->arriving && p->count > 1 && way->confirmed++ < 6
            ? pandis__confirm(p, way, 0)
            : 0;
        if (distant < 0) return 0;
        if (distant) continue;
        if (!pandis__hop(p, way, probe, target)) return 0;
        if (way->stuck) return 1;
    }
    way->held = 1;
    return 1;
}
/* -------------------- how a proxy walks if hops make no progress
 *
 * Where an approximate surface is rounded, in grooves and corners, planes that were seen from
 * different places contradict each other, and no hop leads nearer to the probe. A walk uses none of
 * these planes. Each of its steps goes straight towards the probe, and then out of the surface
 * along planes that are determined for this step only. */

#define PANDIS__PACE 4.8e-3 /* a walk's longest step; its first is an eighth of that */
/* the longest step around an edge that the proxy may take in part, straight on */
#define PANDIS__CHORD 1.6e-3
/* at an edge the cosine between the normals at both ends of a step is less */
#define PANDIS__FLAT 0.98
/* a walk ends when its steps are below this share of the longest; each failure halves the step */
#define PANDIS__TIRED (1 / 1024.0)
/* a walk begins at this count: contact steps without progress add 2, others subtract 1 */
#define PANDIS__IDLE 16
/* a step makes no progress if it gains less than this share of the possible gain, */
#define PANDIS__GAIN 0.25
/* or, on exact surfaces, less than this, or does not come nearer to the probe */
#define PANDIS__GAIN_EXACT 1e-9
/* or, while the probe rests, moves the proxy by less than this share of what is allowed */
#define PANDIS__CREEP 0.01
#define PANDIS__NEAR (PANDIS__GAP / 2) /* lift from which a ball reaches the proxy */
#define PANDIS__AGAIN 64               /* contact steps after which a resting proxy tries again, */
/* or when the probe has moved by this share of its distance to the proxy */
#define PANDIS__MOVED 0.2
/* sine of the angle between pull and surface normal below which the proxy rests */
#define PANDIS__LEAN 0.05
#define PANDIS__SUNK 1e-6      /* a place counts as free if it is no deeper than this, */
#define PANDIS__SUNK_SHARE 0.1 /* and no deeper than this share of a step */

/* Find the free place nearest to a goal, at most `reach` away. Returns 1 if it is in `look`, 0 if
 * none was found, -1 if there was no answer. `slope` is the rate at which the distance grows along
 * the normal: less than 1 in a rounded corner, and perhaps negative in a cell of a trilinear field.
 * If the place found is farther outside than necessary, one more query tries to improve it. */
PANDIS__ONCE static int pandis__free_place(
    pandis__proxy *p, const double *goal, double reach, double *slope, pandis__look *look) {
    double at[3] = {goal[0], goal[1], goal[2]}, last[3] = {0}, before = 0;
    pandis__look high;
    int over = 0;
    const double sunk = fmin(PANDIS__SUNK, PANDIS__SUNK_SHARE * p->state->pace);
    *slope = fmax(0.1, *slope);
    for (p->count = 0; p->count < 5 && p->queries < p->state->options.budget &&
        pandis__between(at, goal) <= reach;) {
        if (!pandis__look_at(p, at, look)) return -1;
        if (look->distance >= -sunk &&
            (over || !p->count || look->distance <= *slope * 0.02 * reach))
            return 1;
        if (over) { /* not free: use the previous place */
            *look = high;
            return 1;
        }
        if (look->distance >= -sunk) over = 1, high = *look;
        pandis__plane *seen = p->plane + p->count;
        if (p->count && pandis__dot(seen[-1].normal, look->normal) > 0.9) {
            double risen = 0;
            for (int k = 0; k < 3; k++) risen += (at[k] - last[k]) * seen[-1].normal[k];
            double rate = risen != 0 ? (look->distance - before) / risen : *slope;
            *slope = rate > 0 ? fmax(0.1, fmin(1.2, rate)) : fmin(-0.1, fmax(-1.2, rate));
        }
        before = look->distance;
        for (int k = 0; k < 3; k++) {
            last[k] = at[k];
            seen->normal[k] = *slope > 0 ? look->normal[k] : -look->normal[k];
            seen->foot[k] = at[k] - look->distance / *slope * look->normal[k];
        }
        seen->offset = pandis__dot(seen->normal, seen->foot);
        if (over) seen[-1] = *seen, p->count--;
        pandis__nearest_in_front(p->plane, ++p->count, goal, at);
    }
    if (over) *look = high;
    return over;
}

/* Take a free ball above a place, at the lift over the planes that hold the proxy there. Returns 1
 * if the ball joins the last one or contains the proxy, and (with `reaches`) reaches the place;
 * else 0; -1: no answer. The balls must join, because an exact object may be thinner than a step:
 * the path to a free place need not be free. */
static int pandis__covers(pandis__proxy *p, const double *place, int reaches) {
    pandis__look look;
    double at[3];
    pandis__lifted(p, place, NULL, p->state->lift, at);
    if (!pandis__look_at(p, at, &look)) return -1;
    if (!(look.free > 0) || (reaches && pandis__between(at, place) > look.free + PANDIS__GAP))
        return 0;
    if (pandis__between(at, p->ball) > p->ball[3] + look.free &&
        pandis__between(at, p->x) >= look.free)
        return 0;
    pandis__take_ball(p, &look);
    return 1;
}

/* Take a free ball that reaches the proxy, whether or not it joins the last one: at the lift or, if
 * none is found there, nearer to the proxy and in front of all walls found. Returns 1, or 0 if none
 * was found, -1 if there was no answer. */
PANDIS__ONCE static int pandis__stand(pandis__proxy *p) {
    pandis__contact *c = p->state;
    for (int turn = 0; turn < 4 && p->queries < c->options.budget; turn++) {
        pandis__look look;
        double at[3];
        pandis__lifted(p, p->x, NULL, c->lift, at);
        if (!pandis__look_at(p, at, &look)) return -1;
        if (look.free > 0 && pandis__between(at, p->x) <= look.free + PANDIS__GAP) {
            pandis__take_ball(p, &look);
            return 1;
        }
        c->lift = PANDIS__NEAR;
        if (!(look.free > 0)) pandis__learn(p, &look, p->x, 0);
    }
    return 0;
}

/* A step that a walk could take. */
typedef struct {
    double left;          /* distance from the proxy to the probe */
    double pace, length;  /* length as planned, and as found */
    double along, nearer; /* by how much it leads towards the probe, and comes nearer to it */
    double friction;      /* what `along` must exceed */
} pandis__stride;

static void pandis__measure_stride(const pandis__proxy *p, const pandis__way *way,
    const double *probe, const double *place, pandis__stride *s) {
    s->length = pandis__between(place, p->x), s->along = 0;
    s->nearer = s->left - pandis__between(place, probe);
    for (int k = 0; k < 3; k++) s->along += (place[k] - p->x[k]) * (probe[k] - p->x[k]);
    s->along /= fmax(s->length, PANDIS__SMALL);
    s->friction = (p->state->sticks ? way->sticking : way->sliding) *
        sqrt(fmax(0, s->left * s->left - s->along * s->along));
    if (!p->count) s->friction = 0;
}

static int pandis__approaches(const pandis__stride *s) {
    return s->length <= 3 * s->pace && s->along > fmax(s->friction, PANDIS__LEAN * s->left) &&
        s->nearer > 1e-3 * s->pace;
}

/* Whether a place lies behind the surface, whose normal was `side`, and has the opposite normal:
 * then it is on the other side of a thin wall. */
static int pandis__pierces(
    const pandis__proxy *p, const pandis__look *look, const double *side, double length) {
    double behind = 0;
    for (int k = 0; k < 3; k++) behind -= (look->at[k] - p->x[k]) * side[k];
    return behind > 0.1 * length && pandis__dot(side, look->normal) < -0.5;
}

/* Whether a step leads around an edge, and is so long that a part of it may be inside. */
static int pandis__rounds_edge(const pandis__stride *s, const double *side, const double *normal) {
    return s->pace > PANDIS__CHORD && s->length > PANDIS__CHORD &&
        pandis__dot(side, normal) < PANDIS__FLAT;
}

/* Set the lift so that new balls join the last one; if that ball does not reach the proxy, take one
 * that does. Returns what pandis__stand returns. */
static int pandis__lower(pandis__proxy *p) {
    pandis__contact *c = p->state;
    double far = pandis__between(p->ball, p->x), least = fmax(far / PANDIS__FARTHEST, PANDIS__NEAR);
    c->lift = fmin(PANDIS__HOVER, fmax(fmin(c->lift, far), least));
    return far > p->ball[3] + PANDIS__GAP ? pandis__stand(p) : 1;
}

/* Move the proxy by a share of the way to a place. */
static void pandis__take_step(pandis__proxy *p, const pandis__look *look, double share) {
    pandis__contact *c = p->state;
    for (int k = 0; k < 3; k++) p->x[k] += share * (look->at[k] - p->x[k]);
    c->settled = c->close = c->sticks = 0;
    if (p->exact) return;
    /* an empty ball on the surface makes the next step look from above */
    pandis__take_ball(p, look);
    memcpy(p->ball, p->x, 3 * sizeof *p->ball);
    if (p->count || !(look->free > 0)) p->ball[3] = PANDIS__SMALL, p->ball[4] = -1;
}

/* Walk towards the probe, with all but one query of the budget. 0: no answer. */
PANDIS__ONCE static int pandis__walk_on(pandis__proxy *p, pandis__way *way, const double *probe) {
    pandis__contact *c = p->state;
    pandis__plane known[PANDIS__PLANES];
    pandis__look look;
    pandis__stride s;
    double goal[3], slip = -1, clear = 0, slope = 1, side[3] = {0};
    const int most = c->options.budget - 1; /* one query is left for the hops */
    /* the first step leads out of the surface, if the proxy has sunk in */
    int first = !p->exact, anew = 0, good = p->exact ? pandis__lower(p) : 1;
    if (good < 1) return good + 1;
    for (; c->pace > PANDIS__TIRED * PANDIS__PACE && p->queries + 2 <= most; first = 0) {
        s.left = pandis__between(probe, p->x);
        if (s.left <= PANDIS__SMALL) break;
        s.pace = first ? 0 : fmin(fmax(c->pace, clear), s.left);
        for (int k = 0; k < 3; k++) goal[k] = p->x[k] + s.pace / s.left * (probe[k] - p->x[k]);
        const int count = p->count;
        memcpy(known, p->plane, sizeof known);
        good = pandis__free_place(p, goal, first ? PANDIS__PACE : 3 * s.pace, &slope, &look);
        if (good < 0) return 0;
        pandis__measure_stride(p, way, probe, look.at, &s);
        if (good) good = first ? p->count > 0 : pandis__approaches(&s);
        if (good && s.pace > clear && pandis__pierces(p, &look, side, s.length)) good = 0;
        int apart =
            0; /* no ball there joins the last one, but the proxy is in front of the walls */
        if (good && p->exact) {
            int reaches = s.length > PANDIS__SLIVER;
            good = p->queries < c->options.budget ? pandis__covers(p, look.at, reaches) : 0;
            if (good < 0) return 0;
            apart = !good && !anew;
            for (int i = 0; i < p->count; i++)
                apart = apart && pandis__height(p->plane + i, p->x) > -PANDIS__ABOVE;
        }
        double share = 1, slips = slip;
        if (slip < 0) slips = way->soft < 1 ? way->soft * (s.along - s.friction) : 1e300;
        if (p->count && !first) share = fmax(0, fmin(1, fmin(slips, way->travel) / s.length));
        int cuts = share < 1 && pandis__rounds_edge(&s, side, look.normal);
        if (good || first) memcpy(side, look.normal, sizeof side);
        if (!good || cuts) {
            /* balls above the proxy and above the place join if they are over the same planes */
            if (apart && p->queries < most) {
                c->lift = PANDIS__NEAR, anew = 1;
                if (pandis__stand(p) < 0) return 0;
            }
            p->count = count;
            memcpy(p->plane, known, sizeof known);
            if (!first) c->pace = good ? fmax(PANDIS__CHORD, 0.9 * share * s.pace) : c->pace / 2;
            slope = 1, clear = 0;
            continue;
        }
        double moved = share * s.length;
        if (p->count && !first) slip = slips - moved, way->travel -= moved, way->slid += moved;
        clear = p->count ? 0 : look.free;
        pandis__take_step(p, &look, share);
        if (first) continue;
        c->pace = fmin(1.5 * c->pace, PANDIS__PACE);
        if (p->exact) c->idle = PANDIS__IDLE - 2; /* hops are faster, if they advance from here */
        if (share < 1) break;
    }
    return 1;
}

/* Walk, if the proxy is not at rest. 0: no answer. */
PANDIS__ONCE static int pandis__try_walk(
    pandis__proxy *p, pandis__way *way, const double *probe, double moved) {
    pandis__contact *c = p->state;
    c->rested += 1.0 / PANDIS__AGAIN +
        moved / fmax(PANDIS__MOVED * pandis__between(probe, p->x), PANDIS__SMALL);
    if (c->rested > 1) c->rested = 0, c->pace = fmax(c->pace, PANDIS__PACE / 8);
    return pandis__walk_on(p, way, probe);
}

/* Go back to a place that was nearer to the probe, if it lies outside. Hops along planes that
 * contradict each other led away from it; without the way back, the proxy could circle for ever.
 * 0: no answer. */
PANDIS__ONCE static int pandis__go_back(pandis__proxy *p, const double *place, const double *ball) {
    pandis__look look;
    if (!pandis__look_at(p, place, &look)) return 0;
    /* the old place is inside: the hops led the proxy out of the surface */
    if (look.distance < -fmax(PANDIS__SUNK, p->blur)) return 1;
    memcpy(p->x, place, 3 * sizeof *place);
    memcpy(p->ball, ball, 5 * sizeof *ball);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    /* planes that are seen from nearer fit a round surface better */
    p->state->lift = fmax(p->state->lift / 4, PANDIS__HOVER / 64);
    return 1;
}

/* Bring the proxy as near to the probe as it can: by hops, or by a walk if hops make no progress.
 * `moved`: how far the probe moved. 0: no answer. */
static int pandis__come(pandis__proxy *p, pandis__way *way, const double *probe, double moved) {
    pandis__contact *c = p->state;
    const double creep = PANDIS__CREEP * way->travel,
                 least = p->exact ? PANDIS__GAIN_EXACT : PANDIS__GAIN * way->travel;
    if (c->idle < PANDIS__IDLE) c->rested = 1;
    /* the short steps of a walk cannot keep up with a probe that is faster than the proxy may be */
    else if (moved < 0.5 * way->travel && !pandis__try_walk(p, way, probe, moved)) return 0;
    const double before[3] = {p->x[0], p->x[1], p->x[2]};
    double ball[5];
    memcpy(ball, p->ball, sizeof ball);
    if (!pandis__follow(p, way, probe)) return 0;
    double gone = 0, apart = 0, left = 0; /* all of them squared */
    for (int k = 0; k < 3; k++) {
        gone += (p->x[k] - before[k]) * (p->x[k] - before[k]);
        apart += (probe[k] - before[k]) * (probe[k] - before[k]);
        left += (probe[k] - p->x[k]) * (probe[k] - p->x[k]);
    }
    int creeps = p->exact && moved * moved < gone && gone < creep * creep;
    int nowhere =
        left > PANDIS__SMALL * PANDIS__SMALL && (gone < least * least || creeps || apart <= left);
    if (apart < (1 - 1e-9) * left && p->queries <= c->options.budget + 1 &&
        !pandis__go_back(p, before, ball))
        return 0;
    c->idle += nowhere ? 2 * (c->idle < PANDIS__IDLE) : -(c->idle > 0);
    return 1;
}
/* -------------------- contact */

/* Compute the force of the spring and of damping from the positions of the probe and the proxy, in
 * the object's frame and in scene units. */
static void pandis__pull(const pandis__contact *c, const pandis_object *o, const double *normal,
    double damping, double *force) {
    double per = o->scale / o->field->scale;
    for (int k = 0; k < 3; k++) force[k] = o->stiffness * per * c->pull[k];
    double push = pandis__dot(force, normal),
           fast = -damping * pandis__dot(c->velocity, normal) * per;
    if (!(push > 0)) return;
    /* damping is at most the spring's force, so that it starts at zero and never pulls */
    fast = fast > push ? push : fast < -push ? -push : fast;
    for (int k = 0; k < 3; k++) force[k] += fast * normal[k];
}

/* Largest radius of a probe (unit frame) that can return to free space. Where the field has only a
 * lower bound of the distance, no free space would be known for a larger probe. */
static double pandis__widest(const pandis_field *f) {
    if (f->kind == PANDIS_SPLINE) return 0.95 * fmax(f->height, f->as.spline.outside);
    return f->kind == PANDIS_GRID ? 0.95 * f->height : 1e100;
}

#define PANDIS__LEAST_BUDGET 8
#define PANDIS__BUDGET 24
#define PANDIS__STEEPEST 15.0

/* Whether a number is from 0 to `most`; 0 for NaN. */
static int pandis__in_range(double x, double most) { return x >= 0 && x <= most; }

static int pandis__material_is_sound(const pandis_material *m) {
    return pandis__in_range(m->sticking, 1e100) && pandis__in_range(m->sliding, m->sticking) &&
        pandis__in_range(m->damping, 1e100) && pandis__in_range(m->drag, 1e100);
}

PANDIS__ONCE static pandis_error pandis__check_options(
    const pandis_contact_options *options, const pandis_object *o) {
    const pandis_texture *t = options->texture;
    double per = o->field->scale / o->scale;
    int sound = options->budget >= PANDIS__LEAST_BUDGET &&
        pandis__in_range(options->slide, 1e100) && pandis__in_range(options->radius, 1e100) &&
        (!options->material_count || options->materials);
    if (t)
        sound = sound && t->height && pandis__in_range(t->most, 1e100) &&
            pandis__in_range(t->steepest, PANDIS__STEEPEST);
    for (size_t i = 0; sound && i < options->material_count; i++)
        sound = pandis__material_is_sound(options->materials + i);
    if (!sound) return PANDIS_ERROR_OPTIONS;
    return options->radius * per <= pandis__widest(o->field) ? PANDIS_SUCCESS : PANDIS_ERROR_RADIUS;
}

PANDIS__ONCE PANDIS_API pandis_contact_options pandis_contact_defaults(
    const pandis_object *object) {
    pandis_contact_options options;
    memset(&options, 0, sizeof options);
    options.budget = PANDIS__BUDGET;
    if (pandis__lies(object))
        options.slide = 0.5 * PANDIS__LONGEST * object->scale / object->field->scale;
    return options;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_contact_open(
    pandis_contact *contact, const pandis_object *object, const pandis_contact_options *options) {
    pandis__contact *c = pandis__contact_of(contact);
    pandis_contact_options defaults = pandis_contact_defaults(object);
    memset(contact, 0, sizeof *contact);
    if (!pandis__lies(object)) return PANDIS_ERROR_POSE;
    if (!pandis__knows_distance(object->field)) return PANDIS_ERROR_KIND;
    if (!options) options = &defaults;
    pandis_error error = pandis__check_options(options, object);
    if (error) return error;
    c->options = *options, c->object = *object;
    c->lift = PANDIS__HOVER, c->pace = PANDIS__PACE / 8, c->face = c->region = -1;
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_contact_options pandis_contact_get(const pandis_contact *contact) {
    return pandis__contact_in(contact)->options;
}

PANDIS_API pandis_error pandis_contact_set(
    pandis_contact *contact, const pandis_contact_options *options) {
    pandis__contact *c = pandis__contact_of(contact);
    if (!c->options.budget) return PANDIS_ERROR_OPTIONS; /* the contact is not open */
    pandis_error error = pandis__check_options(options, &c->object);
    if (error) return error;
    /* the known free space depends on the old radius and texture */
    if (options->radius != c->options.radius || options->texture != c->options.texture)
        c->ball[3] = -1;
    c->options = *options;
    return PANDIS_SUCCESS;
}

PANDIS_API void pandis_contact_reshaped(pandis_contact *contact) {
    pandis__contact_of(contact)->ball[3] = -1;
}

/* Move the walls outward by `by`, but not beyond the probe, and move the proxy to the probe. */
static void pandis__stand_at(pandis__proxy *p, const double *probe, pandis__look *look, double by) {
    p->state->sunk -= by, p->radius += by;
    look->distance -= by, look->free -= by, look->sure -= by;
    for (int k = 0; k < 3; k++) look->foot[k] = probe[k] - look->distance * look->normal[k];
    p->count = 0;
    memcpy(p->x, probe, 3 * sizeof *probe);
    pandis__take_ball(p, look);
    pandis__learn(p, look, probe, look->distance);
}

/* Begin with the proxy at the probe. If the probe is inside, the walls are moved inward to its
 * depth until it comes out, so that it is neither kicked out nor let through. */
static int pandis__begin(pandis__proxy *p, const double *probe) {
    pandis__look look;
    if (!pandis__look_at(p, probe, &look) || (look.distance < 0 && p->flag != PANDIS_OK)) return 0;
    pandis__stand_at(p, probe, &look, fmin(0, look.distance));
    p->state->state = PANDIS__CLEAR;
    return 1;
}

/* After a start inside, while nothing holds the probe back, move the walls outward to the probe. */
static int pandis__rise(pandis__proxy *p, const double *probe) {
    pandis__look look;
    if (!pandis__look_at(p, probe, &look)) return 0;
    if (look.distance > 0) pandis__stand_at(p, probe, &look, fmin(look.distance, p->state->sunk));
    return 1;
}

/* After a step without an answer, prepare the next one. The force grows from zero again, and the
 * next look is from nearer to the surface. The contact begins anew if the straight way from the
 * probe to the proxy is free, up to the proxy or to the first place without an answer. Otherwise,
 * beside a gap of the field, the proxy could stay for ever. */
PANDIS__ONCE static void pandis__recover(pandis__proxy *p, const double *probe) {
    pandis__contact *c = p->state;
    pandis__look look;
    double at[3] = {probe[0], probe[1], probe[2]};
    memset(c->pull, 0, sizeof c->pull);
    memset(c->velocity, 0, sizeof c->velocity);
    memcpy(c->probe, probe, sizeof c->probe);
    c->lift = fmax(c->lift / 4, PANDIS__HOVER / 64);
    if (!pandis__look_at(p, at, &look)) return;
    for (int turn = 0; turn < 128 && look.free > 0; turn++) {
        double left = pandis__between(at, c->proxy), share = fmin(1, look.free / left);
        for (int k = 0; k < 3; k++) at[k] += share * (c->proxy[k] - at[k]);
        if (left <= PANDIS__GAP || !pandis__look_at(p, at, &look)) {
            c->state = PANDIS__BEGINS;
            return;
        }
    }
}

/* Find the region at the proxy, from a mesh of the same object. */
static void pandis__find_region(pandis__proxy *p) {
    const pandis_field *f = p->field;
    pandis_answer answer;
    double point[3];
    for (int k = 0; k < 3; k++) point[k] = p->x[k] / f->scale + f->centre[k];
    pandis_query(p->state->options.regions, point, &answer);
    p->queries++;
    p->state->region = answer.region;
}

static void pandis__tell_touch(const pandis__proxy *p, const pandis__way *way,
    const pandis_object *o, double damping, pandis_touch *touch) {
    const pandis__contact *c = p->state;
    double per = o->scale / p->field->scale, normal[3], force[3], place[3];
    for (int k = 0; k < 3; k++) normal[k] = way->active ? way->goal[k] - c->probe[k] : c->pull[k];
    if (!pandis__normalise(normal)) normal[0] = normal[1] = normal[2] = 0;
    pandis__pull(c, o, normal, damping, force);
    for (int k = 0; k < 3; k++) place[k] = c->proxy[k] / p->field->scale + p->field->centre[k];
    for (int k = 0; k < 3; k++) {
        const double *row = o->rotation + 3 * k;
        touch->force[k] = pandis__dot(row, force);
        touch->normal[k] = way->active ? pandis__dot(row, normal) : 0;
        touch->proxy[k] = o->scale * pandis__dot(row, place) + o->translation[k];
    }
    touch->slip = way->slid * per, touch->face = c->face, touch->region = c->region;
    touch->state =
        (way->active ? PANDIS_TOUCHING : 0) | (way->active && c->sticks ? PANDIS_STICKING : 0);
    for (int i = 0; i < PANDIS__PLANES; i++) touch->planes += way->active >> i & 1;
    if (way->active) touch->depth = pandis__between(way->goal, c->probe) * per;
    int apart = memcmp(c->proxy, c->probe, sizeof c->probe) != 0;
    if (way->held || (!way->active && apart)) touch->state |= PANDIS_BEHIND;
    if (c->sunk > 0) touch->state |= PANDIS_WAITING;
}

/* Restore the proxy that a contact keeps between steps; unused planes stay uninitialised. */
static void pandis__recall(
    pandis__contact *c, const pandis_field *f, double radius, pandis__proxy *p) {
    p->state = c, p->field = f, p->radius = radius;
    p->tolerance = f->kind == PANDIS_NETWORK ? 1e-6 : 1e-11;
    /* for a lattice, one step, because rounding may have folded faces */
    p->blur = f->kind == PANDIS_COMPACT ? f->as.compact.step : PANDIS__BEHIND;
    p->queries = 0, p->flag = PANDIS_OK;
    p->exact = f->kind == PANDIS_MESH || f->kind == PANDIS_COMPACT || f->kind == PANDIS_SHAPE;
    p->flat = p->exact && !c->options.texture;
    p->x = c->proxy, p->ball = c->ball, p->count = c->planes;
    memcpy(p->plane, c->plane, (size_t)p->count * sizeof *p->plane);
}

/* Store the part of the proxy's state that the next step needs. */
static void pandis__retain(
    pandis__contact *c, const pandis__proxy *p, int active, const double *probe) {
    c->planes = p->count < PANDIS__KEPT ? p->count : PANDIS__KEPT;
    memcpy(c->plane, p->plane + (p->count - c->planes), (size_t)c->planes * sizeof *p->plane);
    if (active) c->state = PANDIS__TOUCHES;
    if (!active) c->sticks = 0;
    if (active || pandis__between(p->x, probe) > 0) return;
    c->state = PANDIS__CLEAR; /* arrived */
    c->lift = PANDIS__HOVER, c->pace = PANDIS__PACE / 8;
    c->settled = c->close = c->idle = 0;
}

/* Stretch the spring from the probe to the proxy, but change it by at most the distance `most`.
 * Also update the probe's smoothed velocity. */
static void pandis__stretch(pandis__contact *c, const double *probe, double most, double dt) {
    double pull[3], change = 0;
    for (int k = 0; k < 3; k++) {
        pull[k] = c->state == PANDIS__TOUCHES ? c->proxy[k] - probe[k] : 0;
        change += (pull[k] - c->pull[k]) * (pull[k] - c->pull[k]);
    }
    double share = change > most * most ? most / sqrt(change) : 1, smoothed = dt / (dt + 0.002);
    for (int k = 0; k < 3; k++) {
        c->pull[k] += share * (pull[k] - c->pull[k]);
        double fast = c->state == PANDIS__TOUCHES ? (probe[k] - c->probe[k]) / dt : 0;
        double before = c->state == PANDIS__TOUCHES ? c->velocity[k] : 0;
        c->velocity[k] = before + smoothed * (fast - before);
        c->probe[k] = probe[k];
    }
}

PANDIS_API pandis_flag pandis_contact_step(pandis_contact *handle, const pandis_object *object,
    const double position[3], double dt, pandis_touch *touch) {
    pandis__contact *contact = pandis__contact_of(handle);
    const pandis_contact_options *options = &contact->options;
    static const pandis_material smooth = {0, 0, 0, 0};
    const pandis_field *f = object->field;
    /* unit-frame lengths per scene length */
    double point[3], probe[3], per = f->scale / object->scale;
    memset(touch, 0, sizeof *touch);
    touch->flag = PANDIS_INVALID, touch->face = touch->region = -1;
    pandis__enter(object, position, point);
    if (!pandis__unit(f, point, probe) || !(dt > 0) || !options->budget) return PANDIS_INVALID;
    if (!pandis__knows_distance(f) || options->radius * per > pandis__widest(f))
        return PANDIS_INVALID;
    const pandis_material *material = options->material_count ? options->materials : &smooth;
    if (contact->region > 0 && (size_t)contact->region < options->material_count)
        material += contact->region;
    if (!pandis__in_range(object->stiffness, PANDIS__STIFFEST) ||
        !pandis__material_is_sound(material))
        return PANDIS_INVALID;
    if (contact->object.field != f || contact->object.scale != object->scale)
        contact->state = PANDIS__BEGINS;
    if (contact->state == PANDIS__BEGINS) contact->sunk = 0;
    contact->object = *object;
    pandis__proxy p; /* unused planes are uninitialised */
    pandis__recall(contact, f, options->radius * per - contact->sunk, &p);
    if (!contact->stalled) contact->lift = fmin(PANDIS__HOVER, 1.5 * contact->lift);

    double moved = contact->state == PANDIS__BEGINS ? 0 : pandis__between(probe, contact->probe);
    double soft =
        material->drag > 0 ? object->stiffness * dt / (object->stiffness * dt + material->drag) : 1;
    pandis__way way = {moved + options->slide * dt * per, material->sticking, material->sliding,
        soft, -1, 1, 0, {0}, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    int answered = 1;
    if (contact->state == PANDIS__BEGINS) answered = pandis__begin(&p, probe);
    else if (!(contact->ball[3] > 0)) answered = pandis__regain(&p);
    if (contact->state != PANDIS__BEGINS)
        answered = answered && pandis__come(&p, &way, probe, moved);
    if (contact->sunk > 0 && !way.active && !memcmp(p.x, probe, sizeof probe))
        answered = answered && pandis__rise(&p, probe);
    if (answered && way.active && p.queries && options->regions && !f->regions)
        pandis__find_region(&p);
    touch->queries = p.queries, touch->flag = p.flag;
    if (contact->state == PANDIS__BEGINS) {
        touch->state = p.flag == PANDIS_INVALID ? 0 : PANDIS_WAITING;
        return touch->flag;
    }
    if (!answered) {
        pandis__recover(&p, probe);
        touch->queries = p.queries;
        return touch->flag = PANDIS_INVALID;
    }
    pandis__retain(contact, &p, way.active, probe);
    /* the spring changes by no more than the probe and the proxy may move */
    pandis__stretch(contact, probe, 2 * moved + options->slide * dt * per, dt);
    pandis__tell_touch(&p, &way, object, material->damping, touch);
    return touch->flag;
}
/* -------------------- contacts of a scene */

PANDIS__ONCE PANDIS_API pandis_error pandis_scene_touch_open(pandis_scene *scene,
    pandis_contact *contacts, const pandis_contact_options *options, size_t count) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_error error = PANDIS_SUCCESS;
    if (count != s->count) return PANDIS_ERROR_COUNT;
    s->contacts = contacts;
    for (int k = 0; k < 3; k++) s->probe[k] = (double)NAN;
    for (size_t i = 0; i < count; i++) {
        pandis_error why =
            pandis_contact_open(contacts + i, s->objects + i, options ? options + i : NULL);
        if (!why) why = pandis__wake_object(s, i);
        if (!error) error = why;
    }
    return error;
}

/* Before a contact is stepped again, move its proxy to the probe's last position: nothing was in
 * the way while the contact was not stepped. */
static void pandis__wake(const pandis__scene *scene, size_t index) {
    pandis__contact *c = pandis__contact_of(scene->contacts + index);
    double point[3], probe[3];
    /* the proxy is not at the probe */
    if (c->state != PANDIS__CLEAR || memcmp(c->proxy, c->probe, sizeof c->probe)) return;
    pandis__enter(&c->object, scene->probe, point); /* the object is at its pose in that step */
    if (!pandis__unit(c->object.field, point, probe)) return;
    memcpy(c->proxy, probe, sizeof probe), memcpy(c->probe, probe, sizeof probe);
}

/* Distance, in scene units, that the probe may move before a contact must be stepped again. */
static double pandis__at_ease(const pandis__contact *c, const pandis_object *o) {
    if (c->state != PANDIS__CLEAR || c->sunk > 0 || pandis__dot(c->pull, c->pull) > 0) return 0;
    if (memcmp(c->proxy, c->probe, sizeof c->probe)) return 0;
    return (c->ball[4] - pandis__between(c->probe, c->ball)) * (o->scale / o->field->scale) *
        (1 - 4e-6);
}

PANDIS_API pandis_flag pandis_scene_touch(pandis_scene *scene, const double position[3], double dt,
    double force[3], pandis_touch *touches, size_t most, size_t *touched) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_flag worst = PANDIS_OK;
    size_t count = 0;
    double size = 0;
    force[0] = force[1] = force[2] = 0;
    s->queries = 0;
    if (touched) *touched = 0;
    if (!s->contacts || !(dt > 0)) return PANDIS_INVALID;
    for (int k = 0; k < 3; k++) {
        if (!(fabs(position[k]) <= 1e100)) return PANDIS_INVALID;
        size = fmax(size, fabs(position[k]));
    }
    for (size_t i = 0; (i = pandis__next_awake(s, PANDIS__OF_CONTACTS, i, position)) < s->count;
        i++) {
        const pandis_object *o = s->objects + i;
        const pandis__contact *c = pandis__contact_in(s->contacts + i);
        pandis_touch touch;
        double far = size;
        if (!c->options.budget) continue; /* the contact could not be opened */
        pandis__wake(s, i);
        worst = pandis__worse(pandis_contact_step(s->contacts + i, o, position, dt, &touch), worst);
        s->queries += (size_t)touch.queries;
        for (int k = 0; k < 3; k++)
            force[k] += touch.force[k], far = fmax(far, fabs(o->translation[k]));
        pandis__keep_ball(
            pandis__ball(s, PANDIS__OF_CONTACTS, i), position, pandis__at_ease(c, o) - 1e-12 * far);
        if (!(touch.state & (PANDIS_TOUCHING | PANDIS_BEHIND))) continue;
        touch.object = (int32_t)i;
        if (touches && count < most) touches[count] = touch;
        count++;
    }
    memcpy(s->probe, position, sizeof s->probe);
    if (touched) *touched = count;
    return worst;
}
/* -------------------- files */

#define PANDIS__HEADER 256
#define PANDIS__SECTION 24
#define PANDIS__MOST_SECTIONS 32
#define PANDIS__ORDER 0x0a0b0c0du

static uint32_t pandis__u32(const unsigned char *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static uint64_t pandis__u64(const unsigned char *p) {
    return pandis__u32(p) | (uint64_t)pandis__u32(p + 4) << 32;
}

static double pandis__f64(const unsigned char *p) {
    uint64_t bits = pandis__u64(p);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* CRC-32 (ISO 3309, as in zip files). */
static uint32_t pandis__crc(const unsigned char *p, size_t size) {
    uint32_t table[256], crc = 0xffffffffu;
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int k = 0; k < 8; k++) c = c & 1 ? 0xedb88320u ^ (c >> 1) : c >> 1;
        table[i] = c;
    }
    for (size_t i = 0; i < size; i++) crc = table[(crc ^ p[i]) & 0xff] ^ (crc >> 8);
    return ~crc;
}

/* The k-th of the 14 integers, or of the 16 reals, of the header. */
static int32_t pandis__whole(const pandis_field *f, int k) {
    uint32_t value = pandis__u32(f->data + 72 + 4 * k);
    return value <= INT32_MAX ? (int32_t)value : -1;
}

static double pandis__real(const pandis_field *f, int k) {
    return pandis__f64(f->data + 128 + 8 * k);
}

/* Find a section by its name, and its size in bytes; NULL if there is none. */
static const unsigned char *pandis__find(const pandis_field *f, const char *name, uint64_t *bytes) {
    const unsigned char *entry = f->data + PANDIS__HEADER;
    *bytes = 0;
    for (uint32_t i = 0, sections = pandis__u32(f->data + 36); i < sections;
        i++, entry += PANDIS__SECTION) {
        if (memcmp(entry, name, 4)) continue;
        *bytes = pandis__u64(entry + 16);
        return f->data + (size_t)pandis__u64(entry + 8);
    }
    return NULL;
}

/* Find a section by its name, if it contains `count` values of `each` bytes. The table of sections
 * must have been checked. */
static const void *pandis__section(
    const pandis_field *f, const char *name, uint64_t count, uint64_t each) {
    uint64_t bytes;
    const unsigned char *section = pandis__find(f, name, &bytes);
    return bytes == count * each ? section : NULL;
}

/* Whether there is a section of this name. */
static int pandis__has_section(const pandis_field *f, const char *name) {
    uint64_t bytes;
    return pandis__find(f, name, &bytes) != NULL;
}

PANDIS_API const char *pandis_provenance(const pandis_field *field, size_t *size) {
    uint64_t bytes = 0;
    const unsigned char *text = field->kind ? pandis__find(field, "PROV", &bytes) : NULL;
    *size = (size_t)bytes;
    return (const char *)text;
}

PANDIS_API const char *pandis_region(const pandis_field *field, int region) {
    uint64_t bytes = 0;
    const char *name = field->regions ? (const char *)pandis__find(field, "RNAM", &bytes) : NULL;
    const char *end = name ? name + bytes : NULL;
    /* the last one ends with a zero */
    for (int i = 0; i < region && name < end; i++) name += strlen(name) + 1;
    return region >= 0 && name < end ? name : NULL;
}

static int pandis__finite(const float *values, uint64_t count) {
    int good = values != NULL;
    for (uint64_t i = 0; good && i < count; i++) good &= fabsf(values[i]) <= 3e38f;
    return good;
}

static int pandis__finite64(const double *values, uint64_t count) {
    int good = values != NULL;
    for (uint64_t i = 0; good && i < count; i++) good &= fabs(values[i]) <= 1e30;
    return good;
}

static uint64_t pandis__cube(int32_t n) { return (uint64_t)n * (uint64_t)n * (uint64_t)n; }
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
/* Open a lattice that covers the box with `cells` cells per axis. */
PANDIS__ONCE static int pandis__open_lattice(
    const pandis_field *f, const char *name, int32_t cells, pandis__lattice *l) {
    l->size = cells + 3, l->low = -1 - 2.0 / cells, l->per_step = (l->size - 1) / (-2 * l->low);
    l->values = (const float *)pandis__section(f, name, pandis__cube(l->size), sizeof(float));
    return pandis__finite(l->values, pandis__cube(l->size));
}

PANDIS__ONCE static int pandis__open_network(pandis_field *f) {
    pandis__network *n = &f->as.network;
    int32_t base = pandis__whole(f, 3), bits = pandis__whole(f, 4);
    n->width = pandis__whole(f, 0), n->depth = pandis__whole(f, 1),
    n->outputs = pandis__whole(f, 2);
    if (n->width < 1 || n->width > PANDIS_MOST_WIDTH || n->depth < 1 ||
        n->depth > PANDIS_MOST_DEPTH)
        return 0;
    if ((n->outputs != 1 && n->outputs != 4) || (bits != 16 && bits != 32) || base < 0 ||
        base > 512)
        return 0;
    n->stride = (n->width + PANDIS__LANES - 1) / PANDIS__LANES * PANDIS__LANES;
    uint64_t row = (uint64_t)n->stride, rows = (uint64_t)(n->depth - 1) * (uint64_t)n->width;
    uint64_t biases = (uint64_t)n->depth * row + 4;
    n->first = (const float *)pandis__section(f, "WIN ", 3 * row, sizeof(float));
    n->last = (const float *)pandis__section(f, "WOUT", (uint64_t)n->outputs * row, sizeof(float));
    n->biases = (const float *)pandis__section(f, "BIAS", biases, sizeof(float));
    if (!pandis__finite(n->first, 3 * row) || !pandis__finite(n->last, (uint64_t)n->outputs * row))
        return 0;
    if (!pandis__finite(n->biases, biases)) return 0;
    if (bits == 32) {
        n->hidden = (const float *)pandis__section(f, "WHID", rows * row, sizeof(float));
        if (!pandis__finite(n->hidden, rows * row)) return 0;
    } else {
        n->hidden16 = (const int16_t *)pandis__section(f, "WHID", rows * row, sizeof(int16_t));
        n->scales = (const float *)pandis__section(f, "SCAL", rows, sizeof(float));
        if (!n->hidden16 || !pandis__finite(n->scales, rows)) return 0;
    }
    return !base || pandis__open_lattice(f, "BASE", base, &n->base);
}

PANDIS__ONCE static int pandis__open_grid(pandis_field *f) {
    pandis__grid *g = &f->as.grid;
    static const int32_t channels[] = {3, 3, 4, 1, 1};
    g->rule = pandis__whole(f, 0), g->size = pandis__whole(f, 1);
    if (g->rule < 0 || g->rule > PANDIS__TRICUBIC || g->size < 2 || g->size > 1024) return 0;
    g->channels = channels[g->rule];
    int own = pandis__u32(f->data + 12) > 1; /* version 1 has only the cube */
    for (int k = 0; k < 3; k++) {
        g->low[k] = own ? pandis__real(f, k) : -1, g->high[k] = own ? pandis__real(f, 3 + k) : 1;
        if (!(g->low[k] >= -1 && g->high[k] <= 1 && g->high[k] - g->low[k] >= 1e-9)) return 0;
        if (g->rule == PANDIS__TRICUBIC && (g->low[k] > -1 || g->high[k] < 1)) return 0;
        g->per_step[k] = (g->size - 1) / (g->high[k] - g->low[k]);
    }
    uint64_t count = pandis__cube(g->size) * (uint64_t)g->channels,
             bits = pandis__cube(g->size - 1);
    g->covered = (const uint8_t *)pandis__section(f, "COVR", (bits + 7) / 8, 1);
    if (!g->covered) return 0;
    if (g->rule == PANDIS__TRICUBIC) return pandis__open_lattice(f, "NODE", g->size - 1, &g->cubic);
    g->nodes = (const float *)pandis__section(f, "NODE", count, sizeof(float));
    return pandis__finite(g->nodes, count);
}

PANDIS__ONCE static int pandis__open_layout(pandis_field *f, int level) {
    static const char *const names[2][4] = {
        {"BBRK", "BMSK", "BBAS", "BCOF"}, {"FBRK", "FMSK", "FBAS", "FCOF"}};
    pandis__spline *s = &f->as.spline;
    pandis__layout *l = s->layout + level;
    int32_t kept = pandis__whole(f, 4 + level), blocks = pandis__whole(f, 6 + level);
    l->size = pandis__whole(f, level), l->bricks = pandis__whole(f, 2 + level);
    l->low = pandis__real(f, level);
    if (l->size < 4 || l->size > 1024 || l->bricks < 1 || l->bricks != (l->size + 7) / 8) return 0;
    if (kept < 0 || kept >= PANDIS__NO_BRICK || blocks < 0 || blocks > INT32_MAX / 8 ||
        !(l->low <= -1 && l->low > -3))
        return 0;
    l->per_step = (l->size - 1) / (-2 * l->low);
    l->brick = (const uint16_t *)pandis__section(f, names[level][0], pandis__cube(l->bricks), 2);
    l->mask = (const uint64_t *)pandis__section(f, names[level][1], (uint64_t)kept, 8);
    l->base = (const uint32_t *)pandis__section(f, names[level][2], (uint64_t)kept, 4);
    const void *stored = pandis__section(f, names[level][3], (uint64_t)blocks * 8, level ? 1 : 2);
    if (level) s->fine = (const int8_t *)stored;
    else s->coarse = (const int16_t *)stored;
    if (!l->brick || !l->mask || !l->base || !stored) return 0;
    for (uint64_t i = 0; i < pandis__cube(l->bricks); i++)
        if (l->brick[i] != PANDIS__NO_BRICK && l->brick[i] >= kept) return 0;
    uint64_t before = 0;
    for (int32_t i = 0; i < kept; i++) {
        if (l->base[i] != before) return 0;
        before += (uint64_t)pandis__count_bits(l->mask[i]);
    }
    return before == (uint64_t)blocks;
}

PANDIS__ONCE static int pandis__open_spline(pandis_field *f) {
    pandis__spline *s = &f->as.spline;
    if (!pandis__open_layout(f, 0) || !pandis__open_layout(f, 1)) return 0;
    s->far_size = pandis__whole(f, 8), s->far_low = pandis__real(f, 2);
    if (s->far_size < 4 || s->far_size > 512 || !(s->far_low <= -1 && s->far_low > -3)) return 0;
    s->far_per_step = (s->far_size - 1) / (-2 * s->far_low);
    for (int k = 0; k < 3; k++) {
        s->offset[k] = pandis__real(f, 3 + k), s->scale[k] = pandis__real(f, 6 + k);
        if (!(fabs(s->offset[k]) <= 1e30 && fabs(s->scale[k]) <= 1e30)) return 0;
    }
    s->inside = pandis__real(f, 9), s->outside = pandis__real(f, 10);
    if (!(s->inside >= 0 && s->inside <= 1e30 && s->outside >= 0 && s->outside <= 1e30)) return 0;
    uint64_t blocks = pandis__cube(4 * s->layout[0].bricks);
    s->far = (const int16_t *)pandis__section(f, "RCOF", pandis__cube(s->far_size), 2);
    s->side = (const uint8_t *)pandis__section(f, "SIDE", (blocks + 7) / 8, 1);
    return s->far && s->side;
}

PANDIS__ONCE static int pandis__open_shape(pandis_field *f) {
    pandis__shape *s = &f->as.shape;
    s->shape = pandis__whole(f, 0);
    for (int k = 0; k < 3; k++) {
        s->size[k] = pandis__real(f, k);
        if (!(s->size[k] >= 0 && s->size[k] <= 1e30)) return 0;
    }
    return s->shape >= 0 && s->shape <= PANDIS__CAPSULE;
}

/* Read the box around the surface, two measured margins and a height. A probe that is farther
 * outside this box than the first margin touches nothing. At a point whose distance is known, a
 * probe touches nothing before it has moved by that distance less a margin: the second margin if
 * the answer is flagged as a bound, else the first. Where an answer in the unit box is positive and
 * flagged as a bound, no surface is nearer than the height. Without the section, nothing is known.
 */
PANDIS__ONCE static int pandis__measure(pandis_field *f) {
    const unsigned char *bounds =
        (const unsigned char *)pandis__section(f, "SAFE", 9, sizeof(double));
    for (int k = 0; k < 2; k++) {
        f->margin[k] = bounds ? pandis__f64(bounds + 48 + 8 * k) : (double)INFINITY;
        if (!(f->margin[k] >= 0)) return 0;
    }
    f->height = bounds ? pandis__f64(bounds + 64) : 0;
    if (!(f->height >= 0 && f->height <= 1e30)) return 0;
    for (int k = 0; k < 3; k++) {
        f->low[k] = bounds ? pandis__f64(bounds + 8 * k) : -1;
        f->high[k] = bounds ? pandis__f64(bounds + 24 + 8 * k) : 1;
        if (!(f->low[k] >= -1e30 && f->low[k] <= f->high[k] && f->high[k] <= 1e30)) return 0;
    }
    return 1;
}

/* Read the region of each face, and the regions' names. */
PANDIS__ONCE static int pandis__open_regions(pandis_field *f) {
    int mesh = f->kind == PANDIS_MESH;
    uint64_t count = mesh ? (uint64_t)f->as.mesh.face_count
                          : (uint64_t)f->as.compact.block_count * PANDIS__BLOCK;
    uint64_t bytes, names = 0;
    const unsigned char *text = pandis__find(f, "RNAM", &bytes);
    const uint8_t *regions = (const uint8_t *)pandis__section(f, "REGN", count, 1);
    if (!regions || !text || !bytes || text[bytes - 1]) return 0;
    for (uint64_t i = 0; i < bytes; i += strlen((const char *)text + i) + 1) names++;
    for (uint64_t i = 0; i < count; i++)
        if (regions[i] >= names) return 0;
    f->regions = regions;
    return 1;
}

PANDIS__ONCE static pandis_error pandis__open(pandis_field *field, const void *data, size_t size) {
    const unsigned char *p = (const unsigned char *)data;
    const uint32_t order = PANDIS__ORDER;
    memset(field, 0, sizeof *field);
    if (!p || size < 8 || memcmp(p, "PANDIS\r\n", 8)) return PANDIS_ERROR_FORMAT;
    if (size < PANDIS__HEADER) return PANDIS_ERROR_SIZE;
    if (pandis__u32(p + 8) != order || memcmp(p + 8, &order, 4)) return PANDIS_ERROR_ENDIAN;
    if (pandis__u32(p + 12) < 1 || pandis__u32(p + 12) > PANDIS_FORMAT_VERSION)
        return PANDIS_ERROR_VERSION;
    if (pandis__u64(p + 16) != size) return PANDIS_ERROR_SIZE;
    if (pandis__u32(p + 28) || pandis__u32(p + 24) != pandis__crc(p + 32, size - 32))
        return PANDIS_ERROR_CHECKSUM;
    if ((uintptr_t)p % 8) return PANDIS_ERROR_ALIGNMENT;
    if (!pandis__arithmetic()) return PANDIS_ERROR_ARITHMETIC;
    field->data = p, field->size = size;
    uint32_t sections = pandis__u32(p + 36);
    if (sections > PANDIS__MOST_SECTIONS ||
        PANDIS__HEADER + (size_t)sections * PANDIS__SECTION > size)
        return PANDIS_ERROR_CONTENT;
    for (uint32_t i = 0; i < sections; i++) {
        const unsigned char *entry = p + PANDIS__HEADER + (size_t)i * PANDIS__SECTION;
        uint64_t start = pandis__u64(entry + 8), bytes = pandis__u64(entry + 16);
        if (start % 8 || start > size || bytes > size - start || pandis__u32(entry + 4))
            return PANDIS_ERROR_CONTENT;
        if (bytes && start < PANDIS__HEADER + (size_t)sections * PANDIS__SECTION)
            return PANDIS_ERROR_CONTENT;
    }
    for (int k = 0; k < 3; k++) field->centre[k] = pandis__f64(p + 40 + 8 * k);
    field->scale = pandis__f64(p + 64);
    if (!(field->scale >= 1e-150 && field->scale <= 1e150)) return PANDIS_ERROR_CONTENT;
    for (int k = 0; k < 3; k++)
        if (!(fabs(field->centre[k]) <= 1e150)) return PANDIS_ERROR_CONTENT;
    int good = 0, kind = (int)pandis__u32(p + 32);
    /* leaves of meshes before version 4 have another format */
    if (kind == PANDIS_MESH && pandis__u32(p + 12) < 4) return PANDIS_ERROR_VERSION;
    if (kind == PANDIS_NETWORK && pandis__whole(field, 0) <= 1024 &&
        pandis__whole(field, 1) <= 16 &&
        (pandis__whole(field, 0) > PANDIS_MOST_WIDTH ||
            pandis__whole(field, 1) > PANDIS_MOST_DEPTH))
        return PANDIS_ERROR_LARGE;
    if (kind == PANDIS_NETWORK) good = pandis__open_network(field);
    if (kind == PANDIS_GRID) good = pandis__open_grid(field);
    if (kind == PANDIS_SPLINE) good = pandis__open_spline(field);
    if (kind == PANDIS_MESH) good = pandis__open_mesh(field);
    if (kind == PANDIS_COMPACT) good = pandis__open_compact(field);
    if (kind == PANDIS_SHAPE) good = pandis__open_shape(field);
    if (!good || !pandis__measure(field)) return PANDIS_ERROR_CONTENT;
    field->kind = kind;
    int meshes = kind == PANDIS_MESH || kind == PANDIS_COMPACT;
    return meshes && pandis__has_section(field, "REGN") && !pandis__open_regions(field)
        ? PANDIS_ERROR_CONTENT
        : PANDIS_SUCCESS;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_open(
    pandis_field *field, const void *data, size_t size) {
    pandis_error error = pandis__open(field, data, size);
    if (error) memset(field, 0, sizeof *field); /* a field that is not open is all zero */
    return error;
}

#ifndef PANDIS_NO_FILE
#ifdef PANDIS__READ
/* Open a file by its UTF-8 path, which Windows requires in UTF-16. */
static FILE *pandis__open_path(const char *path) {
#ifdef _WIN32
    const unsigned char *p = (const unsigned char *)path;
    wchar_t wide[1024];
    size_t n = 0;
    while (*p) {
        static const uint32_t least[4] = {0, 0x80, 0x800, 0x10000};
        int more = *p >= 0xf0 ? 3 : *p >= 0xe0 ? 2 : *p >= 0xc0 ? 1 : 0, length = more;
        uint32_t code = more ? *p & (0x3fu >> more) : *p;
        if ((*p >= 0x80 && *p < 0xc0) || *p >= 0xf8 || n + 3 > sizeof wide / sizeof *wide)
            return NULL;
        for (p++; more; more--, p++) {
            if ((*p & 0xc0) != 0x80) return NULL;
            code = code << 6 | (*p & 0x3fu);
        }
        if (code < least[length] || code > 0x10ffffu || (code >= 0xd800u && code < 0xe000u))
            return NULL;
        if (code >= 0x10000u)
            wide[n++] = (wchar_t)(0xd7c0u + (code >> 10)), code = 0xdc00u + (code & 0x3ffu);
        wide[n++] = (wchar_t)code;
    }
    wide[n] = 0;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}
#endif

PANDIS__ONCE PANDIS_API pandis_error pandis_open_file(pandis_field *field, const char *path) {
    pandis_error error = PANDIS_ERROR_FILE;
    memset(field, 0, sizeof *field);
#ifndef PANDIS__READ
    struct stat found;
    int file = open(path, O_RDONLY);
    if (file < 0) return error;
    if (!fstat(file, &found) && found.st_size > 0) {
        size_t size = (size_t)found.st_size;
        void *data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, file, 0);
        if (data != MAP_FAILED) {
            error = pandis_open(field, data, size);
            if (error) munmap(data, size);
            field->mapped = !error;
        }
    } else if (!fstat(file, &found)) {
        error = PANDIS_ERROR_FORMAT;
    }
    close(file);
#else
    FILE *file = pandis__open_path(path);
    if (!file) return error;
    if (!fseek(file, 0, SEEK_END)) {
        long size = ftell(file);
        rewind(file);
        /* a directory may have a size, but nothing can be read from it */
        void *data = size > 0 && fgetc(file) != EOF ? malloc((size_t)size) : NULL;
        rewind(file);
        if (data && fread(data, 1, (size_t)size, file) == (size_t)size)
            error = pandis_open(field, data, (size_t)size);
        if (error) free(data);
        field->mapped = !error;
    }
    fclose(file);
#endif
    return error;
}
#endif

PANDIS__ONCE PANDIS_API void pandis_close(pandis_field *field) {
#ifndef PANDIS_NO_FILE
    void *data = (void *)(uintptr_t)field->data;
#ifndef PANDIS__READ
    if (field->mapped) munmap(data, field->size);
#else
    if (field->mapped) free(data);
#endif
#endif
    memset(field, 0, sizeof *field);
}

PANDIS__ONCE PANDIS_API const char *pandis_error_text(pandis_error error) {
    switch (error) {
    case PANDIS_SUCCESS: return "no error";
    case PANDIS_ERROR_FILE: return "the file is missing or cannot be read";
    case PANDIS_ERROR_FORMAT: return "this is not a .pandis file";
    case PANDIS_ERROR_ENDIAN: return "the byte order of the file differs from this machine's";
    case PANDIS_ERROR_VERSION:
        return "the file and this pandis.h differ in version: use the pandis.h that came with the "
               "file";
    case PANDIS_ERROR_SIZE:
        return "the file is shorter or longer than its header states: copy it again";
    case PANDIS_ERROR_CHECKSUM: return "the file is damaged: copy it again";
    case PANDIS_ERROR_CONTENT:
        return "the contents of the file are inconsistent, or this kind of field does not support "
               "the operation";
    case PANDIS_ERROR_ALIGNMENT:
        return "the bytes must begin at an address that is a multiple of 8";
    case PANDIS_ERROR_ARITHMETIC:
        return "pandis.h was compiled with flags, or called in a rounding mode, that break its "
               "arithmetic: compile without -ffast-math and the options that it implies";
    case PANDIS_ERROR_LARGE:
        return "the network is wider or deeper than pandis.h was compiled for: see "
               "PANDIS_MOST_WIDTH";
    case PANDIS_ERROR_RADIUS:
        return "the probe is larger than the known free space around the field's surface: use a "
               "smaller radius";
    case PANDIS_ERROR_KIND:
        return "a grid of forces has no distances outside the object, so it cannot have a contact";
    case PANDIS_ERROR_VERTEX: return "a vertex is not finite, or is too far away";
    case PANDIS_ERROR_POSE:
        return "an object has no field, or its rotation, scale, place or stiffness is invalid";
    case PANDIS_ERROR_OPTIONS:
        return "an option of a contact is beyond its range (budget at least 8, slide and radius at "
               "least 0, a texture's steepest at most 15, sliding friction at most the sticking "
               "friction, nothing negative)";
    case PANDIS_ERROR_COUNT: return "an array is shorter or longer than required";
    case PANDIS_ERROR_HEADER:
        return "the program and the compiled implementation differ in version or in the packing of "
               "structures: build both with the same pandis.h and the same packing";
    default: return "unknown error";
    }
}

#ifdef PANDIS__PUSHED
#pragma GCC pop_options
#endif
#if defined(__cplusplus) && defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#endif /* PANDIS_IMPLEMENTATION */

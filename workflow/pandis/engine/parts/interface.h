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

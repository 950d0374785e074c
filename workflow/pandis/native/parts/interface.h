typedef struct {
    const unsigned char *data;
    size_t size;
    int kind, mapped;
    double centre[3], scale;        /* of the unit frame: u = (p - centre) * scale */
    double low[3], high[3], margin[2], height; /* see pandis__measure; unit frame */
    const uint8_t *regions;            /* of each face, in the field's own order; NULL: not said */
    union {
        pandis__network network;
        pandis__grid grid;
        pandis__spline spline;
        pandis__mesh mesh;
        pandis__compact compact;
        pandis__shape shape;
    } as;
} pandis_field;

/* Open a field from bytes that the caller keeps until the end, at an address that is a multiple of
 * 8 (in C11: _Alignas(8) on the array that a tool made of a file). Everything is checked, so that no query can leave the bytes. Returns 0 or a PANDIS_ERROR. */
PANDIS_API int pandis_open(pandis_field *field, const void *data, size_t size);

#ifndef PANDIS_NO_FILE
/* Read a file into memory of its own; with PANDIS_MMAP defined it is mapped instead (not on Windows), and
 * must not be overwritten while it is open. The path is in UTF-8, on Windows, too. */
PANDIS_API int pandis_open_file(pandis_field *field, const char *path);
#endif
PANDIS_API void pandis_close(pandis_field *field);

/* What a field is (PANDIS_NETWORK ... PANDIS_SHAPE; 0 when it is closed), and its bytes. */
PANDIS_API int pandis_kind(const pandis_field *field);
PANDIS_API size_t pandis_bytes(const pandis_field *field);

/* A box around the surface, in mesh units (all that the field covers, if its file does not say where the
 * surface lies). */
PANDIS_API void pandis_bounds(const pandis_field *field, double low[3], double high[3]);

/* The name of a region (pandis_answer.region): of the material that the mesh's file gives its faces. NULL if there is no
 * such region. */
PANDIS_API const char *pandis_region(const pandis_field *field, int region);

/* The length of the longest side of the mesh that the field was made from, in its units. */
PANDIS_API double pandis_longest_side(const pandis_field *field);

/* What the field was made from and how: a text in JSON of `*size` bytes, which does not end with a
 * zero; NULL if there is none. It lives as long as the field is open. */
PANDIS_API const char *pandis_provenance(const pandis_field *field, size_t *size);

/* Answer one point, in mesh units. Where it is no number distance, normal and slope are NaN. */
PANDIS_API void pandis_query(const pandis_field *field, const double point[3], pandis_answer *answer);

/* Answer one point if the surface is nearer than `reach` (mesh units, not negative), to the last bit as
 * pandis_query does. Else the flag may be PANDIS_BEYOND: then no surface is nearer than `clear`, which is the reach
 * (less where the search was cut), nothing is said of the side, and distance, normal and slope are NaN. Of meshes
 * that takes a look at a few boxes, wherever the point is; other fields, and bad reaches, are answered in full. */
PANDIS_API void pandis_query_within(const pandis_field *field, const double point[3], double reach,
                                    pandis_answer *answer);

/* Answer one point, to the last bit as pandis_query does: faster where
 * the point before, with the same hint, was near. Of `exact` meshes; other fields have no use for a hint. */
PANDIS_API void pandis_query_from(const pandis_field *field, const double point[3], pandis_hint *hint,
                                  pandis_answer *answer);

/* The distance alone, with the bits of pandis_query, and its flag: in less than half of the time of a network whose normal
 * is its gradient; of any other field it takes as long. NaN where there is no answer. */
PANDIS_API int pandis_distance(const pandis_field *field, const double point[3], double *distance);

/* The gradient of the distance, and its second derivatives (per mesh unit), row by row. Of meshes and closed forms they are
 * those of what is nearest: 0 next to a face, round next to an edge or a corner; of splines and grids of distances those of
 * their formula; elsewhere (networks, and wherever the flag is PANDIS_BOUND) they are differences over a few thousandths
 * of the object or less. Where the distance has a crease, what is given is that of one side. Returns the flag: PANDIS_INVALID, and
 * NaN, where there is no answer, and of grids of forces. */
PANDIS_API int pandis_derivatives(const pandis_field *field, const double point[3], double gradient[3],
                                  double hessian[9]);

/* The penalty force -k * min(distance, 0) * normal: zero outside, and where there is no answer.
 * Returns the flag: PANDIS_INVALID, and no force, if the stiffness is negative, NaN or more than 1e100. */
PANDIS_API int pandis_force(const pandis_field *field, const double point[3], double stiffness, double force[3]);

/* Answer `count` points, three doubles each; normals (three doubles each) and flags may be NULL. */
PANDIS_API void pandis_query_many(const pandis_field *field, const double *points, size_t count, double *distances,
                                  double *normals, unsigned char *flags);

/* A mesh whose vertices move (`exact` fields alone). `moving` answers all queries as the field does, but for a
 * shape of its own, in room of its own of pandis_refit_room bytes (0: no such field) at a multiple of 8. The field
 * stays open as long, and `moving` needs no closing. Returns 0, PANDIS_ERROR_CONTENT or PANDIS_ERROR_ALIGNMENT. */
PANDIS_API size_t pandis_refit_room(const pandis_field *field);
PANDIS_API int pandis_refit_open(pandis_field *moving, const pandis_field *field, void *room);

/* Move the vertices: three doubles each, in mesh units, as many and in the order as in mesh.zarr.zip. The frame stays:
 * points beyond its box are answered, and flagged as bounds. Distances are then those of a tree that was built
 * anew, to the last bit; nothing is allocated. Tell scenes (pandis_scene_moved). Returns 0, or PANDIS_ERROR_VERTEX,
 * and the old shape stays. No other thread may ask meanwhile. */
PANDIS_API int pandis_refit(pandis_field *moving, const double *vertices);

#if defined(__GNUC__) || defined(_MSC_VER)
/* A shape that one thread moves while another asks, and neither waits: of three shapes one is written, one is asked, and
 * the newest whole one is handed over. One thread refits, one takes. */
typedef struct {
    pandis_field shapes[3];
    int32_t writing, asking;
    volatile int32_t waiting; /* a shape, and 4 if nobody has taken it yet */
} pandis_handover;

/* Three times the room of one shape (0: no such field), at a multiple of 8; the field stays open as long. */
PANDIS_API size_t pandis_handover_room(const pandis_field *field);
PANDIS_API int pandis_handover_open(pandis_handover *handover, const pandis_field *field, void *room);

/* Move the vertices, as pandis_refit does, and hand the shape over. */
PANDIS_API int pandis_handover_refit(pandis_handover *handover, const double *vertices);

/* Make `moving` the newest whole shape, at the beginning of a tick: it stays as it is until the next time. Returns 1
 * if it is another shape than before (tell scenes: pandis_scene_moved), or the first time; else 0. */
PANDIS_API int pandis_handover_take(pandis_handover *handover, pandis_field *moving);
#endif

/* An object of a scene: a field, and where it lies. A point p of the mesh lies at
 * scale * rotation * p + translation of the scene; the rotation, row by row, is one without
 * reflection (columns of unit length, at right angles, within 1e-6), the scale positive, the stiffness
 * not negative, everything finite. */
typedef struct {
    const pandis_field *field;
    double rotation[9], translation[3], scale;
    double stiffness; /* force per length of the scene */
} pandis_object;

/* What a surface feels like, beside its stiffness, which is the object's. Friction is force along the surface per force
 * against it: up to `sticking` the proxy stays where it is, and once it slides, `sliding` (not more) is what it drags.
 * Damping is force per speed of the probe: `damping` along the normal, never so that it pulls towards the surface, and
 * `drag` along the surface. Everything is in units of the scene, and not negative. */
typedef struct {
    double sticking, sliding, damping, drag;
} pandis_material;

/* A height over the surface, which a proxy feels: a function of a point of the surface, in the mesh's own coordinates and
 * units, and of its region (pandis_answer). It returns the height there, from 0 to `most`, and fills in its gradient, no
 * longer than `steepest`. Walls hold as they do without it, for it only adds; `steepest` is
 * 15 at most, or steps answer PANDIS_INVALID. Slopes up to about 0.65 are followed; on
 * steeper ones the proxy falls behind. */
typedef struct {
    double (*height)(const void *data, const double point[3], int region, double gradient[3]);
    const void *data;
    double most, steepest;
} pandis_texture;

/* Heights for textures: waves across a direction of unit length, steepest 3.15 * height / length; */
typedef struct {
    double height, length, direction[3];
} pandis_ridges;
PANDIS_API double pandis_waves(const void *ridges, const double point[3], int region, double gradient[3]);

/* and bumps, one for each cube of a length, as if drawn at random: steepest 3.25 * height / length. */
typedef struct {
    double height, length;
} pandis_bumps;
PANDIS_API double pandis_noise(const void *bumps, const double point[3], int region, double gradient[3]);

/* A texture of its own for each region: `count` of them in the order of the regions, of which one whose height is NULL is
 * smooth. What has no region, or one beyond them, has the first, as with materials. The texture that is made of them has
 * pandis_by_region for its height, and the largest `most` and `steepest` of them all. */
typedef struct {
    const pandis_texture *textures;
    int32_t count;
} pandis_patches;
PANDIS_API double pandis_by_region(const void *patches, const double point[3], int region, double gradient[3]);

/* What a probe that is kept out of an object feels of it. The proxy is a ball that nothing lets through; the probe, which
 * is where the device is, hangs on it by a spring. All zero, and then pandis_contact_open. One contact belongs to one
 * probe and one object; it may be copied. */
typedef struct {
    double radius; /* of the proxy, scene lengths: 0 for a point */
    double slide;  /* scene lengths per second by which the proxy moves beside the probe's own way: it bounds steps of
                    * the force at ridges */
    int32_t budget; /* queries after which a step ends, two more at most, and one of `regions`; what is left goes on in
                     * the next one. At least 8: with fewer, steps answer PANDIS_INVALID, for each would begin anew */
    int32_t materials; /* 1; or so many, one for each region, and pandis_contact_step is given the first of them */
    const pandis_texture *texture; /* of the surface; NULL: none */
    const pandis_field *regions; /* whose regions count, if the object's field has none: a mesh of the same object; or NULL */
    /* the state, in the object's unit frame */
    int32_t state, planes, sticks, settled, close, stalled, face, region;
    pandis_object object; /* as it lay in the last step */
    double ball[5], sunk, lift, proxy[3], probe[3], velocity[3], pull[3], plane[8][7];
} pandis_contact;

/* Bits of pandis_touch.state. TOUCHING: the surface holds the proxy back. STICKING: friction holds it, too. BEHIND: the
 * budget, or `slide`, did not let the proxy go as far as it would. WAITING: the probe has begun inside, and has not come out
 * yet. Nobody knows from which side it came, so nothing pushes it out; but it gets no deeper than it began, or was since.
 * Where the field knows no distance so deep inside, it gives no force until the probe has come out. */
enum { PANDIS_TOUCHING = 1, PANDIS_STICKING = 2, PANDIS_BEHIND = 4, PANDIS_WAITING = 8 };

/* What pandis_contact_step answers, in units and coordinates of the scene. */
typedef struct {
    double force[3], proxy[3];
    double normal[3]; /* of the surface (of several, of all together): against it the proxy is pressed; 0 if it is not */
    double depth;     /* by which the probe is pressed beyond the proxy, along the normal */
    double slip;      /* by which the proxy slid along the surface */
    int state;        /* bits: see above */
    int flag;         /* the worst of the queries; PANDIS_INVALID: no force, and the proxy stays */
    int planes;       /* that hold the proxy back: 1 on a face, 2 in an edge, 3 in a corner */
    int queries;      /* that this step took */
    int32_t object;   /* of a scene */
    int32_t face;     /* of mesh.zarr.zip, nearest to the proxy, where the field says it: see pandis_answer */
    int32_t region;   /* in which the proxy lies, likewise */
} pandis_touch;

/* Begin a contact with a probe of a radius (scene lengths): any on meshes, compact meshes, closed forms and networks; on
 * splines and grids at most 0.95 of the height over the surface up to which they are made, 1 mm of 100 by default. Returns
 * 0, PANDIS_ERROR_POSE (of the object, or the radius is no number from 0 on), PANDIS_ERROR_KIND: a grid of forces knows no
 * distance outside, or PANDIS_ERROR_RADIUS. */
PANDIS_API int pandis_contact_open(pandis_contact *contact, const pandis_object *object, double radius);

/* Move the probe to a position of the scene, `dt` seconds after the last one. On its way to the probe the proxy never goes
 * through the surface: free motion is followed, however thin what lies between; along the surface it takes short steps, on
 * up to three planes at once, of the eight that it knows. The object may have another pose than last time: the proxy goes with it; with
 * another field or scale the contact begins anew. Of several materials (contact->materials) that of the region counts in
 * which the proxy lay before, the first one where there is none. Returns the flag. */
PANDIS_API int pandis_contact_step(pandis_contact *contact, const pandis_object *object, const double position[3],
                                   double dt, const pandis_material *material, pandis_touch *touch);

/* Say that the object's shape is another one (pandis_refit): where it has come over the proxy, the proxy goes out. */
PANDIS_API void pandis_contact_moved(pandis_contact *contact);

/* Objects under one probe. Each is asked again only when the probe may touch it: a field that is
 * nowhere nearer than d cannot be touched before the probe has gone that far. Forces are those of
 * pandis_object_force, added up in the order of the objects, to the last bit as long as no field's
 * distance is further off than its file says. One probe, and one thread, has a scene of its own. */
typedef struct {
    const pandis_object *objects;
    size_t count;
    double *room;
    size_t asked; /* so many fields were asked for the last answer */
    pandis_contact *contacts; /* one for each object, where there are any; what is below is theirs */
    const pandis_material *const *materials;
    double probe[3];
    size_t touched; /* so many objects were touched in the last step */
} pandis_scene;

/* Doubles that a scene of so many objects needs; objects that are looked at together. */
#define PANDIS_SCENE_BLOCK 32
#define PANDIS_SCENE_ROOM(count) \
    (8 * PANDIS_SCENE_BLOCK * (((size_t)(count) + PANDIS_SCENE_BLOCK - 1) / PANDIS_SCENE_BLOCK))

/* Make a scene of objects and room that the caller keeps. Returns 0 or PANDIS_ERROR_POSE. */
PANDIS_API int pandis_scene_open(pandis_scene *scene, const pandis_object *objects, size_t count, double *room);

/* Say that an object was moved, turned, scaled, or given another field. Returns 0 or
 * PANDIS_ERROR_POSE: it is left out until it lies somewhere. */
PANDIS_API int pandis_scene_moved(pandis_scene *scene, size_t object);

/* The sum of the penalty forces of all objects at a point of the scene. Returns the worst flag of
 * those that were asked. It changes nothing of what pandis_scene_touch answers, in whatever order they are called. */
PANDIS_API int pandis_scene_force(pandis_scene *scene, const double point[3], double force[3]);

/* Give the scene a contact for each object, which the caller keeps, and begin them with a probe of a radius. Of materials,
 * one for each object, the array may be NULL, and each of them. Returns 0, or the first error of pandis_contact_open: that
 * object, and whatever lies nowhere, is left out. */
PANDIS_API int pandis_scene_touch_open(pandis_scene *scene, pandis_contact *contacts,
                                       const pandis_material *const *materials, double radius);

/* Move the probe to a position, `dt` seconds after the last one, and step the contacts of all objects that it may touch.
 * The force is the sum of theirs, in the order of the objects, to the last bit that of stepping all of them. Fills in at
 * most `most` touches (NULL: none), of those objects that are touched, or whose proxy is behind; scene->touched says how many are. An object that is
 * moved (pandis_scene_moved) carries its proxy along. Returns the worst flag. */
PANDIS_API int pandis_scene_touch(pandis_scene *scene, const double position[3], double dt, double force[3],
                                  pandis_touch *touches, size_t most);

#if defined(__GNUC__) || defined(_MSC_VER)
/* Where an object lies in a frame of a simulation, and how it moves: rotation and translation are those of pandis_object,
 * the velocity is that of the point at `translation`, per second, and the spin an axis times radians per second, both in
 * the directions of the scene. */
typedef struct {
    double rotation[9], translation[3], velocity[3], spin[3];
} pandis_pose;

/* Poses that a simulation hands over to the haptic loop, and neither waits: of three frames one is written, one is
 * followed, and the newest whole one is handed over. In each tick every object goes on, without a step, towards where it
 * will lie when the next frame is due; there it waits, if that is late. One thread gives, one steps. */
typedef struct {
    pandis_object *objects; /* what is below belongs to pandis_poses_... */
    size_t count;
    pandis_pose *frames;
    double periods[3], *ways, period, gone;
    int32_t writing, asking;
    volatile int32_t waiting; /* a frame, and 4 if nobody has taken it yet */
} pandis_poses;

/* Doubles that so many objects need. */
#define PANDIS_POSES_ROOM(count) (68 * (size_t)(count))

/* Begin where the objects lie. The caller keeps them, and the room. Returns 0, or PANDIS_ERROR_POSE. */
PANDIS_API int pandis_poses_open(pandis_poses *poses, pandis_object *objects, size_t count, double *room);

/* The frame to be filled in next, a pose for each object, by the simulation's thread: all of them, each time. */
PANDIS_API pandis_pose *pandis_poses_frame(const pandis_poses *poses);

/* Hand the frame over; the next one is due `period` seconds later. Returns 0, or PANDIS_ERROR_POSE, and nothing is handed
 * over: a rotation is none, something is not finite, or an object turns more than halfway round until then. */
PANDIS_API int pandis_poses_give(pandis_poses *poses, double period);

/* Move the objects on by `dt` seconds, at the beginning of a tick, and tell the scene that holds them (or NULL). Returns
 * 1 if there was another frame than before, else 0. */
PANDIS_API int pandis_poses_step(pandis_poses *poses, pandis_scene *scene, double dt);
#endif

/* The penalty force of one object at a point of the scene. Returns the flag. */
PANDIS_API int pandis_object_force(const pandis_object *object, const double point[3], double force[3]);

/* What an error code means. */
PANDIS_API const char *pandis_error(int error);

#ifdef __cplusplus
}
#endif
#endif /* PANDIS_H */

/* ================================================================ implementation */

#if defined(PANDIS_IMPLEMENTATION) && !defined(PANDIS__IMPLEMENTED)
#define PANDIS__IMPLEMENTED


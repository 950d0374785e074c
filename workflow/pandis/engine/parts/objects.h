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

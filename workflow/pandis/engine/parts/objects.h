/* ---------------------------------------------------------------- objects and what they feel like */

/* An object: a field, and where it lies. A point p of the mesh lies at scale * rotation * p + translation of the scene. */
typedef struct {
    const pandis_field *field; /* open as long as the object is used */
    double rotation[9];        /* by rows; without reflection: columns of unit length, at right angles, within 1e-6 */
    double translation[3];     /* scene lengths, at most 1e100 */
    double scale;              /* scene lengths per mesh unit, from 1e-100 to 1e100 */
    double stiffness;          /* force per scene length, from 0 to 1e100 */
} pandis_object;

/* [rt] The penalty force of one object.
 *
 * point    scene lengths
 * force    in the directions of the scene */
PANDIS_API pandis_flag pandis_object_force(const pandis_object *object, const double point[3], double force[3]);

/* What a surface feels like, beside its stiffness, which is the object's. Everything is in units of the scene, from 0 to
 * 1e100; all zero is smooth. */
typedef struct {
    double sticking; /* force along the surface per force against it, up to which the proxy stays where it is ... */
    double sliding;  /* ... and what it drags once it slides: at most `sticking` */
    double damping;  /* force per speed of the probe along the normal, never so that it pulls towards the surface */
    double drag;     /* force per speed along the surface */
} pandis_material;

/* A height over the surface, which a proxy feels. It only adds, so walls hold as they do without it. Slopes up to about 0.65
 * are followed; on steeper ones the proxy falls behind. */
typedef struct {
    /* the height, from 0 to `most`, and its gradient, no longer than `steepest`, at a point of the surface (mesh units) and of
     * its region (pandis_answer). It is called in the loop, so it has to be [rt], too */
    double (*height)(const void *data, const double point[3], int region, double gradient[3]);
    const void *data; /* passed on to `height` */
    double most;      /* mesh units, from 0 on */
    double steepest;  /* from 0 to 15: steeper ones let a probe through thin walls */
} pandis_texture;

/* [rt] A height for textures: waves across a direction of unit length; steepest 3.15 * height / length. */
typedef struct {
    double height, length, direction[3]; /* mesh units */
} pandis_ridges;
PANDIS_API double pandis_waves(const void *ridges, const double point[3], int region, double gradient[3]);

/* [rt] A height for textures: bumps, one for each cube of a length, as if drawn at random; steepest 3.25 * height / length. */
typedef struct {
    double height, length; /* mesh units */
} pandis_bumps;
PANDIS_API double pandis_noise(const void *bumps, const double point[3], int region, double gradient[3]);

/* [rt] A texture for each region: `count` of them in the order of the regions, of which one whose height is NULL is
 * smooth. What has no region, or one beyond them, has the first, as with materials. The texture that is made of them has
 * pandis_by_region for its height, and the largest `most` and `steepest` of them all. */
typedef struct {
    const pandis_texture *textures;
    int32_t count;
} pandis_patches;
PANDIS_API double pandis_by_region(const void *patches, const double point[3], int region, double gradient[3]);

/* ---------------------------------------------------------------- contacts
 *
 * What a probe that is kept out of an object feels of it. The proxy is a ball that nothing lets through; the probe, which is
 * where the device is, hangs on it by a spring. One contact belongs to one probe, one object and one thread. */

/* Options of a contact. Start from pandis_contact_defaults, and change only what should differ. */
typedef struct {
    double radius;  /* of the proxy, scene lengths, 0: a point. Up to 1e100 on meshes, compact meshes, closed forms and networks;
                     * on splines and grids up to 0.95 of the height over the surface up to which they are made (1 mm of 100
                     * by default), else PANDIS_ERROR_RADIUS. Default 0 */
    double slide;   /* scene lengths per second, from 0 on, by which the proxy moves beside the probe's own way: it bounds steps
                     * of the force at ridges. Default: half of the object's longest side */
    int32_t budget; /* A step ends after this many queries (a look under way may add two, and `regions` one), and the next step
                     * continues it. At least 8: with fewer, every step would start over. Default 24 */
    const pandis_material *materials; /* of each region, kept by the caller, who may change their values between steps; what
                                       * has no region, or one beyond them, has the first. Default NULL: smooth */
    size_t material_count;            /* 0: smooth */
    const pandis_texture *texture;    /* of the surface, kept by the caller; NULL, the default: none */
    const pandis_field *regions;      /* whose regions count, if the object's field has none: a mesh of the same object, open as
                                       * long; NULL, the default: none */
} pandis_contact_options;

/* [rt] The defaults for an object. */
PANDIS_API pandis_contact_options pandis_contact_defaults(const pandis_object *object);

/* The state of a contact, which may be copied. Its content is the implementation's. */
#define PANDIS_CONTACT_BYTES 1024
typedef union {
    double aligned;
    unsigned char bytes[PANDIS_CONTACT_BYTES];
} pandis_contact;

/* Bits of pandis_touch.state. */
typedef enum {
    PANDIS_TOUCHING = 1, /* the surface holds the proxy back */
    PANDIS_STICKING = 2, /* friction holds it, too */
    PANDIS_BEHIND = 4,   /* the budget, or `slide`, did not let the proxy go as far as it would */
    PANDIS_WAITING = 8   /* the probe began inside and has not come out yet. From which side it came is not known, so nothing
                          * pushes it out; but it is held at the depth where it began, or the least that it has reached since.
                          * Where the field knows no distance so deep inside, there is no force until the probe is out */
} pandis_touch_bits;

/* What a step answers, in units and directions of the scene. */
typedef struct {
    double force[3], proxy[3];
    double normal[3]; /* of the surface (of several, of all together) against which the proxy is pressed; 0 if it is not */
    double depth;     /* by which the probe is pressed beyond the proxy, along the normal */
    double slip;      /* by which the proxy slid along the surface */
    int state;        /* pandis_touch_bits */
    pandis_flag flag; /* the worst of the queries; PANDIS_INVALID: no force, and the proxy stays */
    int planes;       /* that hold the proxy back: 1 on a face, 2 in an edge, 3 in a corner */
    int queries;      /* that this step took */
    int32_t object;   /* of a scene: its index */
    int32_t face;     /* of mesh.zarr.zip, nearest to the proxy, where the field says it: see pandis_answer */
    int32_t region;   /* in which the proxy lies, likewise */
} pandis_touch;

/* [rt] Begin a contact; the next step is its first.
 *
 * object   must have a field of distances, not a grid of forces (PANDIS_ERROR_KIND)
 * options  copied; NULL: the defaults
 *
 * Returns PANDIS_SUCCESS, PANDIS_ERROR_POSE, PANDIS_ERROR_KIND, PANDIS_ERROR_RADIUS or PANDIS_ERROR_OPTIONS; after an error
 * steps answer PANDIS_INVALID. */
PANDIS_API pandis_error pandis_contact_open(pandis_contact *contact, const pandis_object *object,
                                            const pandis_contact_options *options);

/* [rt] The options of a contact that is open, and others for it, which count from the next step on. After an error the old
 * ones stay. Another radius moves the walls: of a scene's contact, call pandis_scene_moved, too. */
PANDIS_API pandis_contact_options pandis_contact_get(const pandis_contact *contact);
PANDIS_API pandis_error pandis_contact_set(pandis_contact *contact, const pandis_contact_options *options);

/* [rt] Move the probe. On its way to the probe the proxy never goes through the surface: free motion is followed, however
 * thin what lies between; along the surface it takes short steps, on up to three planes at once, of the eight that it knows.
 *
 * object    it may have another pose than last time: the proxy goes with it. With another field or scale the contact begins
 *           anew; if the probe is inside then, the state is PANDIS_WAITING
 * position  of the probe, scene lengths
 * dt        seconds since the last step, more than 0. Steps of 0.2 to 5 ms are tried
 *
 * Returns touch->flag. PANDIS_INVALID, where position, dt, the stiffness or a material is beyond its range, means no force in
 * this tick: it drops to zero at once. The force changes by at most the object's stiffness times (twice the way of the probe + slide * dt),
 * beside what damping adds. An object that jumps counts as a way of the probe. */
PANDIS_API pandis_flag pandis_contact_step(pandis_contact *contact, const pandis_object *object, const double position[3],
                                           double dt, pandis_touch *touch);

/* [rt] Tell a contact that its object's field has another shape (pandis_refit): if the surface has moved past the proxy, the
 * next step moves the proxy back out. */
PANDIS_API void pandis_contact_reshaped(pandis_contact *contact);


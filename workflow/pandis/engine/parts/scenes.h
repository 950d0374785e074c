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

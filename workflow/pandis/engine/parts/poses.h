
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

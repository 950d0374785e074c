/* A bridge between a haptic loop and a simulation on another thread that moves the objects of the
 * loop's scene.
 *
 * For each object the loop sums impulse and angular impulse about the scene's origin since the run
 * began. The simulation reads the latest complete sums and subtracts those that it read before, so
 * that nothing is lost or counted twice, whatever the rates of loop and simulation are. Neither
 * waits for the other: three slots change hands, as for poses (parts/poses.h).
 *
 * Each frame of poses comes with every object's response to a push, and with the sums that the
 * frame accounts for. Until the next frame, the loop moves each object according to its inertia and
 * to the impulse that it has received since. Otherwise objects would give way late, and that delay
 * would add energy. */
#ifndef BRIDGE_H
#define BRIDGE_H

#include <string.h>

/* Number of periods that objects may wait for the simulation. Impulses given later are dropped,
 * because they would reach the simulation all at once, as a blow. */
#define BRIDGE_WAITS 4

/* How many numbers an object's sums have (impulse, N s, and angular impulse, N m s), and how many a
 * pose has (quaternion and translation). */
enum { BRIDGE_SUMS = 6, BRIDGE_POSE = 7 };

/* Data of an object that comes with a frame. */
typedef struct {
    /* velocity (m/s, rad/s) per impulse, at the centre of mass */
    double answer[BRIDGE_SUMS * BRIDGE_SUMS];
    double middle[3];          /* the centre of mass */
    double known[BRIDGE_SUMS]; /* the sums that the frame's motion accounts for */
} bridge_frame;

typedef struct {
    pandis__poses *poses;  /* through which the simulation moves the scene's objects */
    size_t count;          /* of objects */
    pandis_touch *touches; /* room for one per object */
    bridge_frame *frames;  /* three per object, in the slots of the poses */
    double *sums, *slots;  /* of all objects: the loop's sums, and three slots to hand them over */
    double *gone;          /* per object: motion by the hand since the frame (m, rad) */
    size_t touched;        /* number of objects touched at the last tick */
    double late;           /* how long the objects have waited for the simulation, s */
    double dropped[3];     /* impulse of the hand that no object received, N s */
    double carried[3];     /* motion of the touched objects in a tick, along the force, m */
    int32_t writing, reading;
    volatile int32_t waiting; /* the slot handed over, with PANDIS__NEW until it is taken */
} bridge;

/* Doubles of room that a bridge needs. */
static size_t bridge_doubles(size_t count) {
    size_t touch = (sizeof(pandis_touch) + sizeof(double) - 1) / sizeof(double);
    return count * (5 * BRIDGE_SUMS + 3 * sizeof(bridge_frame) / sizeof(double) + touch) + touch;
}

static void bridge_begin(bridge *b, pandis_poses *handle, size_t count, double *room) {
    memset(b, 0, sizeof *b), memset(room, 0, bridge_doubles(count) * sizeof *room);
    b->poses = pandis__poses_of(handle), b->count = count;
    b->sums = room, b->gone = room + BRIDGE_SUMS * count, b->slots = b->gone + BRIDGE_SUMS * count;
    b->frames = (bridge_frame *)(void *)(b->slots + 3 * BRIDGE_SUMS * count);
    b->touches = (pandis_touch *)(void *)(b->frames + 3 * count);
    b->reading = 1, b->waiting = 2;
}

/* The pose of an object: a point on its way between frames, displaced as the hand has moved it. */
static void bridge_place(const bridge *b, size_t object, double *pose) {
    const pandis__poses *poses = b->poses;
    const double *from = pandis__way_of(poses, object), *to = from + BRIDGE_POSE,
                 *gone = b->gone + BRIDGE_SUMS * object;
    const bridge_frame *frame = b->frames + (size_t)poses->asking * b->count + object;
    double share = poses->gone < poses->period ? poses->gone / poses->period : 1, turn[4], way[4],
           arm[3], more[3];
    for (int k = 0; k < BRIDGE_POSE; k++)
        pose[k] = share < 1 ? from[k] + share * (to[k] - from[k]) : to[k];
    pandis__unit_turn(pose);
    pandis__spun(gone + 3, 1, turn);
    pandis__turn_by(turn, pose, way), memcpy(pose, way, sizeof way);
    for (int k = 0; k < 3; k++) arm[k] = pose[4 + k] - frame->middle[k];
    pandis__cross(gone + 3, arm, more);
    for (int k = 0; k < 3; k++) pose[4 + k] += gone[k] + more[k];
}

/* Advance the objects by a tick. When a frame arrives, an object's way to it begins at the pose to
 * which the hand has moved the object. */
static void bridge_advance(bridge *b, pandis_scene *scene, double dt) {
    pandis__poses *poses = b->poses;
    /* if the simulation is late, objects wait */
    double pose[BRIDGE_POSE], step = poses->gone < poses->period ? dt : 0;
    int is_new = pandis__poses_go(poses, scene, dt);
    if (is_new) step = dt;
    b->late = step > 0 ? 0 : b->late + dt;
    for (size_t i = 0; i < b->count; i++) {
        const bridge_frame *frame = b->frames + (size_t)poses->asking * b->count + i;
        double *gone = b->gone + BRIDGE_SUMS * i, given[BRIDGE_SUMS], turned[3], moved = 0;
        for (int k = 0; k < BRIDGE_SUMS; k++) moved += fabs(gone[k]);
        if (is_new && moved > 0) {
            double now = poses->gone;
            poses->gone = 0, bridge_place(b, i, pose), poses->gone = now;
            memcpy(pandis__way_of(poses, i), pose, sizeof pose),
                memset(gone, 0, BRIDGE_SUMS * sizeof *gone);
        }
        for (int k = 0; k < BRIDGE_SUMS; k++)
            given[k] = b->sums[BRIDGE_SUMS * i + (size_t)k] - frame->known[k];
        pandis__cross(frame->middle, given, turned);
        for (int k = 0; k < 3; k++) given[3 + k] -= turned[k];
        for (int k = 0; k < BRIDGE_SUMS; k++) {
            for (int j = 0; j < BRIDGE_SUMS; j++)
                gone[k] += step * frame->answer[BRIDGE_SUMS * k + j] * given[j];
            moved += fabs(gone[k]);
        }
        if (!(moved > 0)) continue;
        bridge_place(b, i, pose);
        pandis__turned(pose, poses->objects[i].rotation);
        memcpy(poses->objects[i].translation, pose + 4, sizeof poses->objects[i].translation);
        (void)pandis_scene_moved(scene, i);
    }
}

/* Advance the objects by a tick, and record how far that carries the touched ones, because energy
 * that the hand gets from their motion must not be attributed to the contact. */
static void bridge_move(bridge *b, pandis_scene *scene, double dt) {
    double force[3] = {0}, work = 0, size;
    /* t->normal: the proxy in its object's axes, scene lengths */
    for (size_t i = 0; i < b->touched; i++) {
        pandis_touch *t = b->touches + i;
        const pandis_object *o = b->poses->objects + t->object;
        double arm[3];
        for (int k = 0; k < 3; k++) arm[k] = t->proxy[k] - o->translation[k];
        for (int k = 0; k < 3; k++)
            t->normal[k] =
                o->rotation[k] * arm[0] + o->rotation[3 + k] * arm[1] + o->rotation[6 + k] * arm[2];
    }
    bridge_advance(b, scene, dt);
    for (size_t i = 0; i < b->touched; i++) {
        const pandis_touch *t = b->touches + i;
        const pandis_object *o = b->poses->objects + t->object;
        for (int k = 0; k < 3; k++) {
            double now = o->translation[k] + pandis__dot(o->rotation + 3 * k, t->normal);
            force[k] += t->force[k], work += t->force[k] * (now - t->proxy[k]);
        }
    }
    size = pandis__dot(force, force);
    for (int k = 0; k < 3; k++) b->carried[k] = size > 0 ? work / size * force[k] : 0;
}

/* Give each touched object the opposite of the force that it exerts on the hand, scaled by the
 * share of that force that the guard lets through. If the simulation is late, this is dropped. */
static void bridge_give(bridge *b, size_t touched, double share, double dt) {
    b->touched = touched < b->count ? touched : b->count;
    int late = b->late > BRIDGE_WAITS * b->poses->period;
    for (size_t i = 0; i < b->touched; i++) {
        const pandis_touch *t = b->touches + i;
        double *sums = b->sums + BRIDGE_SUMS * (size_t)t->object, force[3], moment[3];
        for (int k = 0; k < 3; k++) force[k] = -share * dt * t->force[k];
        if (late) {
            for (int k = 0; k < 3; k++) b->dropped[k] += force[k];
            continue;
        }
        pandis__cross(t->proxy, force, moment); /* the force acts at the proxy, not at the hand */
        for (int k = 0; k < 3; k++) sums[k] += force[k], sums[3 + k] += moment[k];
    }
    memcpy(b->slots + BRIDGE_SUMS * b->count * (size_t)b->writing, b->sums,
        BRIDGE_SUMS * b->count * sizeof *b->sums);
    b->writing = pandis__exchange(&b->waiting, b->writing | PANDIS__NEW) & 3;
}

/* The sums of all objects that the loop handed over last. */
static void bridge_read(bridge *b, double *sums) {
    if (pandis__peek(&b->waiting) & PANDIS__NEW)
        b->reading = pandis__exchange(&b->waiting, b->reading) & 3;
    memcpy(sums, b->slots + BRIDGE_SUMS * b->count * (size_t)b->reading,
        BRIDGE_SUMS * b->count * sizeof *sums);
}

#endif

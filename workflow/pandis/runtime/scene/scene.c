/* Scenes of pandis.h, for Python: forces along a path, from the scene or by querying every object.
 */
#ifndef PANDIS_IMPLEMENTATION
#define _POSIX_C_SOURCE 199309L
#define PANDIS_IMPLEMENTATION
#endif
#include "../../engine/clock.h"
#include "../../engine/layout.h"
#include "../../engine/pandis.h"

/* The layouts that Python mirrors. */
const layout_entry *scene_layout(void) {
    static const layout_entry entries[] = {
        LAYOUT_TYPE(pandis_object),
        LAYOUT(pandis_object, field),
        LAYOUT(pandis_object, rotation),
        LAYOUT(pandis_object, translation),
        LAYOUT(pandis_object, scale),
        LAYOUT(pandis_object, stiffness),
        LAYOUT_TYPE(pandis_pose),
        LAYOUT(pandis_pose, rotation),
        LAYOUT(pandis_pose, translation),
        LAYOUT(pandis_pose, velocity),
        LAYOUT(pandis_pose, spin),
        LAYOUT_END,
    };
    return entries;
}

size_t scene_bytes(void) { return sizeof(pandis_scene); }
size_t scene_room(size_t count) { return PANDIS_SCENE_ROOM(count); }

/* For each point, store the force (three doubles), the flag and the number of fields queried; with
 * `taken`, also the duration, s. */
void scene_forces(pandis_scene *scene, const double *points, size_t count, double *forces,
    unsigned char *flags, int64_t *asked, double *taken) {
    for (size_t i = 0; i < count; i++) {
        double start = taken ? seconds() : 0;
        flags[i] = (unsigned char)pandis_scene_force(scene, points + 3 * i, forces + 3 * i);
        if (taken) taken[i] = seconds() - start;
        asked[i] = (int64_t)pandis_scene_queries(scene);
    }
}

/* The forces of scene_forces, computed by querying every object at every point. */
void scene_ask_all(const pandis_object *objects, size_t objects_count, const double *points,
    size_t count, double *forces) {
    for (size_t i = 0; i < count; i++) {
        double own[3], *sum = forces + 3 * i;
        sum[0] = sum[1] = sum[2] = 0;
        for (size_t k = 0; k < objects_count; k++) {
            pandis_object_force(objects + k, points + 3 * i, own);
            for (int axis = 0; axis < 3; axis++) sum[axis] += own[axis];
        }
    }
}

size_t scene_poses_bytes(void) { return sizeof(pandis_poses); }
size_t scene_poses_room(size_t count) { return PANDIS_POSES_ROOM(count); }

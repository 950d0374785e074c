/* Contacts of pandis.h, for Python: a probe that follows a path. */
#ifndef PANDIS_IMPLEMENTATION
#define _POSIX_C_SOURCE 199309L
#define PANDIS_IMPLEMENTATION
#endif
#include "../../engine/clock.h"
#include "../../engine/layout.h"
#include "../../engine/pandis.h"

/* The layouts that Python mirrors. */
const layout_entry *contact_layout(void) {
    static const layout_entry entries[] = {
        LAYOUT_TYPE(pandis_contact_options),
        LAYOUT(pandis_contact_options, radius),
        LAYOUT(pandis_contact_options, slide),
        LAYOUT(pandis_contact_options, budget),
        LAYOUT(pandis_contact_options, materials),
        LAYOUT(pandis_contact_options, material_count),
        LAYOUT(pandis_contact_options, texture),
        LAYOUT(pandis_contact_options, regions),
        LAYOUT_TYPE(pandis_material),
        LAYOUT(pandis_material, sticking),
        LAYOUT(pandis_material, sliding),
        LAYOUT(pandis_material, damping),
        LAYOUT(pandis_material, drag),
        LAYOUT_TYPE(pandis_texture),
        LAYOUT(pandis_texture, height),
        LAYOUT(pandis_texture, data),
        LAYOUT(pandis_texture, most),
        LAYOUT(pandis_texture, steepest),
        LAYOUT_END,
    };
    return entries;
}

size_t contact_bytes(void) { return sizeof(pandis_contact); }
size_t contact_touch_bytes(void) { return sizeof(pandis_touch); }

/* Columns for the results of steps, one row per step; seconds may be NULL. */
typedef struct {
    double *force, *proxy, *normal, *depth, *slip, *seconds;
    int32_t *state, *flag, *planes, *queries, *face, *region;
} contact_rows;

static void put(const contact_rows *rows, size_t i, const pandis_touch *touch) {
    memcpy(rows->force + 3 * i, touch->force, sizeof touch->force);
    memcpy(rows->proxy + 3 * i, touch->proxy, sizeof touch->proxy);
    memcpy(rows->normal + 3 * i, touch->normal, sizeof touch->normal);
    rows->depth[i] = touch->depth, rows->slip[i] = touch->slip, rows->state[i] = touch->state;
    rows->flag[i] = touch->flag, rows->planes[i] = touch->planes, rows->queries[i] = touch->queries;
    rows->face[i] = touch->face, rows->region[i] = touch->region;
}

/* Step along a path of positions (three doubles each), `dt` seconds apart. */
void contact_follow(pandis_contact *contact, const pandis_object *object, const double *path,
    size_t count, double dt, const contact_rows *rows) {
    pandis_touch touch;
    for (size_t i = 0; i < count; i++) {
        double start = rows->seconds ? seconds() : 0;
        pandis_contact_step(contact, object, path + 3 * i, dt, &touch);
        if (rows->seconds) rows->seconds[i] = seconds() - start;
        put(rows, i, &touch);
    }
}

/* Step a scene's contacts along a path. For each step, store the force (three doubles), the flag,
 * and the numbers of queries and of touched objects; with `taken`, also the duration, s. */
void contact_scene_follow(pandis_scene *scene, const double *path, size_t count, double dt,
    double *forces, unsigned char *flags, int64_t *asked, int64_t *touched, double *taken) {
    for (size_t i = 0; i < count; i++) {
        size_t many;
        double start = taken ? seconds() : 0;
        flags[i] = (unsigned char)pandis_scene_touch(
            scene, path + 3 * i, dt, forces + 3 * i, NULL, 0, &many);
        if (taken) taken[i] = seconds() - start;
        asked[i] = (int64_t)pandis_scene_queries(scene), touched[i] = (int64_t)many;
    }
}

/* Make one more step and store at most `most` touches; returns the number of touched objects. */
size_t contact_scene_touches(pandis_scene *scene, const double *position, double dt,
    const contact_rows *rows, int32_t *objects, pandis_touch *room, size_t most) {
    double force[3];
    size_t touched;
    (void)pandis_scene_touch(scene, position, dt, force, room, most, &touched);
    size_t count = touched < most ? touched : most;
    for (size_t i = 0; i < count; i++) {
        put(rows, i, room + i);
        objects[i] = room[i].object;
    }
    return touched;
}

/* The forces of contact_scene_follow, computed by stepping every object's contact every time. */
void contact_step_all(const pandis_object *objects, pandis_contact *contacts, size_t objects_count,
    const double *path, size_t count, double dt, double *forces) {
    pandis_touch touch;
    for (size_t i = 0; i < count; i++) {
        double *sum = forces + 3 * i;
        sum[0] = sum[1] = sum[2] = 0;
        for (size_t k = 0; k < objects_count; k++) {
            pandis_contact_step(contacts + k, objects + k, path + 3 * i, dt, &touch);
            for (int axis = 0; axis < 3; axis++) sum[axis] += touch.force[axis];
        }
    }
}

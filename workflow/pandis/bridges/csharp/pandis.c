/* pandis.h behind handles, for languages that can call C but cannot include headers, such as C#.
 *
 * Fields, and probes that are kept out of objects, are pointers that the caller must close. All
 * other arguments are numbers, arrays of numbers and strings. Any number of threads may use a
 * field, but only one thread may use a probe.
 */
#define PANDIS_IMPLEMENTATION
#include "../../engine/pandis.h"

#include <stdlib.h>

#if defined(_WIN32)
#define SHARED __declspec(dllexport)
#else
#define SHARED __attribute__((visibility("default")))
#endif

typedef struct {
    pandis_object object;
    pandis_contact contact;
    pandis_material material;
} pandis_probe;

/* Open a file. Returns NULL on failure, with the reason in `error`, which stays valid as long as
 * the program runs. */
SHARED pandis_field *pandis_field_open(const char *path, const char **error) {
    pandis_field *field = (pandis_field *)calloc(1, sizeof *field);
    pandis_error code = field ? pandis_open_file(field, path) : PANDIS_ERROR_FILE;
    *error = code ? pandis_error_text(code) : NULL;
    if (code) free(field), field = NULL;
    return field;
}

SHARED void pandis_field_close(pandis_field *field) {
    if (field) pandis_close(field);
    free(field);
}

/* A box around the surface, mesh units. */
SHARED void pandis_field_bounds(const pandis_field *field, double *low, double *high) {
    pandis_bounds(field, low, high);
}

/* Distances (count), normals (3 count) and flags (count) at points (3 count), mesh units. */
SHARED void pandis_field_query(const pandis_field *field, const double *points, int count,
    double *distances, double *normals, unsigned char *flags) {
    pandis_query_many(field, points, (size_t)count, distances, normals, flags);
}

/* Open a probe with a radius (m), which is kept out of a field's object. A mesh point p is at
 * scale * rotation * p + translation; the rotation is 9 numbers, by rows. The stiffness is in N/m.
 * Contact begins at the next position of the probe, which must be outside the object. */
SHARED pandis_probe *pandis_probe_open(const pandis_field *field, const double *rotation,
    const double *translation, double scale, double stiffness, double radius, const char **error) {
    pandis_probe *probe = (pandis_probe *)calloc(1, sizeof *probe);
    pandis_error code = PANDIS_ERROR_FILE;
    if (probe) {
        pandis_object *o = &probe->object;
        o->field = field, o->scale = scale, o->stiffness = stiffness;
        memcpy(o->rotation, rotation, sizeof o->rotation),
            memcpy(o->translation, translation, sizeof o->translation);
        pandis_contact_options options = pandis_contact_defaults(o);
        options.radius = radius, options.materials = &probe->material, options.material_count = 1;
        code = pandis_contact_open(&probe->contact, o, &options);
    }
    *error = code ? pandis_error_text(code) : NULL;
    if (code) free(probe), probe = NULL;
    return probe;
}

SHARED void pandis_probe_close(pandis_probe *probe) { free(probe); }

/* Friction: sticking and sliding coefficients; 0 for none. */
SHARED void pandis_probe_friction(pandis_probe *probe, double sticking, double sliding) {
    probe->material.sticking = sticking, probe->material.sliding = sliding;
}

/* Move the object, and the probe's proxy with it. Returns 0 if the pose is invalid; the object then
 * stays where it is. */
SHARED int pandis_probe_move(
    pandis_probe *probe, const double *rotation, const double *translation) {
    if (!pandis__places(rotation, translation)) return 0;
    memcpy(probe->object.rotation, rotation, sizeof probe->object.rotation);
    memcpy(probe->object.translation, translation, sizeof probe->object.translation);
    return 1;
}

/* Step by dt seconds to a position (m): stores the force on the hand (N) and the proxy's position.
 * Returns the flag. */
SHARED int pandis_probe_tick(
    pandis_probe *probe, const double *position, double dt, double *force, double *proxy) {
    pandis_touch touch;
    int flag = pandis_contact_step(&probe->contact, &probe->object, position, dt, &touch);
    memcpy(force, touch.force, sizeof touch.force), memcpy(proxy, touch.proxy, sizeof touch.proxy);
    return flag;
}

/* What pandis.h promises of versions and lengths, as C and as C++. Returns the number of the first
 * promise that it breaks. */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

static pandis_error check(const char *version, size_t more) {
    return pandis__check(
        version, sizeof(pandis_field) + more, sizeof(pandis_contact_options), sizeof(pandis_touch));
}

int main(void) {
    static double room[PANDIS_SCENE_ROOM(2)], ways[PANDIS_POSES_ROOM(2)];
    static pandis_contact contacts[2];
    static pandis_object objects[2]; /* which lie nowhere */
    static pandis_pose frame[2];
    const size_t rooms = PANDIS_SCENE_ROOM(2), way = PANDIS_POSES_ROOM(2);
    pandis_scene scene;
    pandis_poses poses;
    double point[3] = {0, 0, 0}, force[3];

    if (PANDIS_CHECK() != PANDIS_SUCCESS || strcmp(pandis_version(), PANDIS_VERSION)) return 1;
    if (check("0.0.9", 0) != PANDIS_ERROR_HEADER || check(PANDIS_VERSION, 8) != PANDIS_ERROR_HEADER)
        return 2;
    if (!strstr(pandis_error_text(PANDIS_ERROR_HEADER), "differ in version")) return 3;

    if (pandis_scene_open(&scene, objects, 2, room, rooms - 1) != PANDIS_ERROR_COUNT) return 4;
    if (pandis_scene_force(&scene, point, force) != PANDIS_OK || pandis_scene_queries(&scene))
        return 5;
    if (pandis_scene_moved(&scene, 0) != PANDIS_ERROR_COUNT) return 6; /* it is empty */
    if (pandis_scene_open(&scene, objects, 2, room, rooms) != PANDIS_ERROR_POSE) return 7;
    if (pandis_scene_moved(&scene, 2) != PANDIS_ERROR_COUNT) return 8;
    if (pandis_scene_moved(&scene, 1) != PANDIS_ERROR_POSE) return 9;
    if (pandis_scene_touch(&scene, point, 1e-3, force, NULL, 0, NULL) != PANDIS_INVALID) return 10;
    if (pandis_scene_touch_open(&scene, contacts, NULL, 1) != PANDIS_ERROR_COUNT) return 11;
    if (pandis_scene_touch_open(&scene, contacts, NULL, 2) != PANDIS_ERROR_POSE) return 12;
    if (pandis_scene_touch(&scene, point, 1e-3, force, NULL, 0, NULL) != PANDIS_OK) return 13;

    if (pandis_poses_open(&poses, objects, 2, ways, way - 1) != PANDIS_ERROR_COUNT) return 14;
    if (pandis_poses_open(&poses, objects, 2, ways, way) != PANDIS_ERROR_POSE) return 15;
    if (pandis_poses_give(&poses, frame, 1, 0.01) != PANDIS_ERROR_COUNT) return 16;
    if (pandis_poses_give(&poses, frame, 2, 0.01) != PANDIS_ERROR_POSE) return 17;
    return 0;
}

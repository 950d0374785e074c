/* What a program gets for arguments that are out of range: files of a mesh, a spline and a grid of
 * forces. Returns the number of the first check that fails. */
#define PANDIS_IMPLEMENTATION
#include "pandis.h"

#define CHECK(number, condition)                                                                   \
    if (!(condition)) return number
#define OPENS(contact, object, options) pandis_contact_open(contact, object, options)

static const double nothing = 0, none = (double)NAN, much = 1e101;

/* The texture returns what its data holds: a height, and a slope along x. */
static double height(const void *data, const double point[3], int region, double gradient[3]) {
    const double *pair = (const double *)data;
    (void)point, (void)region;
    gradient[0] = pair[1], gradient[1] = gradient[2] = 0;
    return pair[0];
}

static pandis_object placed(const pandis_field *field) {
    pandis_object object = {field, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, 1, 400};
    return object;
}

static int versions(void) {
    size_t field = sizeof(pandis_field), touch = sizeof(pandis_touch);
    size_t options = sizeof(pandis_contact_options);
    const char *version = PANDIS_VERSION;
    CHECK(1, pandis__check(version, field, options, touch) == PANDIS_SUCCESS);
    CHECK(2, pandis__check("1", field, options, touch) == PANDIS_ERROR_HEADER);
    CHECK(3, pandis__check(version, field, options + 8, touch) == PANDIS_ERROR_HEADER);
    CHECK(4, pandis__check(version, field, options, touch + 8) == PANDIS_ERROR_HEADER);
    CHECK(5, strstr(pandis_error_text((pandis_error)-99), "unknown"));
    for (int error = PANDIS_ERROR_HEADER; error < 0; error++)
        CHECK(6, strlen(pandis_error_text((pandis_error)error)) > 5);
    CHECK(7, strstr(pandis_error_text(PANDIS_ERROR_ALIGNMENT), "multiple of 8"));
    return 0;
}

/* Objects that lie nowhere: opening refuses them, and scenes leave them out. */
static int objects(const pandis_field *mesh) {
    const double scales[] = {nothing, none, much, 1e-101};
    const double stiffnesses[] = {-1, none, much};
    static double room[PANDIS_SCENE_ROOM(1)];
    pandis_field closed;
    pandis_contact contact;
    pandis_scene scene;
    double force[3], at[3] = {0, 0, 0};
    memset(&closed, 0, sizeof closed);
    for (int i = 0; i < 10; i++) {
        pandis_object object = placed(mesh);
        if (i < 4) object.scale = scales[i];
        else if (i < 7) object.stiffness = stiffnesses[i - 4];
        else if (i == 7) object.field = NULL;
        else if (i == 8) object.field = &closed;
        else object.rotation[0] = -1;
        CHECK(11, OPENS(&contact, &object, NULL) == PANDIS_ERROR_POSE);
        CHECK(12, !(pandis_contact_defaults(&object).slide > 0));
        pandis_contact_options options = pandis_contact_get(&contact);
        CHECK(13, pandis_contact_set(&contact, &options) == PANDIS_ERROR_OPTIONS); /* not open */
        CHECK(
            14, pandis_scene_open(&scene, &object, 1, room, sizeof room / 8) == PANDIS_ERROR_POSE);
        CHECK(15, pandis_scene_force(&scene, at, force) == PANDIS_OK && !(force[2] > 0));
    }
    return 0;
}

static int options(const pandis_field *mesh, const pandis_field *spline, const pandis_field *grid) {
    pandis_object object = placed(mesh), forces = placed(grid);
    pandis_contact contact;
    static const double flat[2] = {0, 0};
    const pandis_material rough = {0.5, 0.6, 0, 0}, pulling = {0.5, 0.5, -1, 0};
    CHECK(21, OPENS(&contact, &forces, NULL) == PANDIS_ERROR_KIND);
    CHECK(22, OPENS(&contact, &object, NULL) == PANDIS_SUCCESS);
    const pandis_contact_options defaults = pandis_contact_defaults(&object);
    for (int i = 0; i < 11; i++) {
        pandis_contact_options wrong = defaults;
        pandis_texture texture = {height, flat, 1e-3, 1};
        if (i < 5) wrong.texture = &texture;
        if (i == 0) texture.height = NULL;
        if (i == 1) texture.most = -1;
        if (i == 2) texture.most = none;
        if (i == 3) texture.steepest = 16;
        if (i == 4) texture.steepest = none;
        if (i == 5) wrong.budget = 7;
        if (i == 6) wrong.slide = none;
        if (i == 7) wrong.radius = -1;
        if (i > 7) wrong.material_count = 1;
        if (i == 9) wrong.materials = &rough; /* sliding friction above static friction */
        if (i == 10) wrong.materials = &pulling;
        CHECK(23, pandis_contact_set(&contact, &wrong) == PANDIS_ERROR_OPTIONS);
        CHECK(24, pandis_contact_get(&contact).budget == defaults.budget); /* the old ones stay */
        pandis_contact other;
        CHECK(25, OPENS(&other, &object, &wrong) == PANDIS_ERROR_OPTIONS);
    }
    pandis_object bent = placed(spline);
    pandis_contact_options wide = pandis_contact_defaults(&bent);
    wide.radius = pandis_longest_side(spline);
    CHECK(26, OPENS(&contact, &bent, &wide) == PANDIS_ERROR_RADIUS);
    return 0;
}

/* Steps with arguments that are out of range give no force; the next good one goes on. */
static int steps(const pandis_field *mesh, const pandis_field *grid) {
    pandis_object object = placed(mesh);
    pandis_contact_options options = pandis_contact_defaults(&object);
    pandis_material material = {0, 0, 0, 0};
    pandis_contact contact;
    pandis_touch touch;
    double low[3], high[3], at[3];
    pandis_bounds(mesh, low, high);
    for (int k = 0; k < 3; k++) at[k] = high[k] + 0.01 * (high[k] - low[k]);
    options.materials = &material, options.material_count = 1;
    memset(&contact, 0, sizeof contact);
    CHECK(31, pandis_contact_step(&contact, &object, at, 1e-3, &touch) == PANDIS_INVALID);
    CHECK(32, OPENS(&contact, &object, &options) == PANDIS_SUCCESS);
    for (int i = 0; i < 10; i++) {
        pandis_object wrong = placed(mesh);
        double dt = 1e-3, place[3] = {at[0], at[1], at[2]};
        if (i == 0) dt = 0;
        if (i == 1) dt = none;
        if (i == 2) place[1] = none;
        if (i == 3) place[2] = (double)INFINITY;
        if (i == 4) wrong.stiffness = -1;
        if (i == 5) wrong.stiffness = none;
        if (i == 6) wrong.field = grid;
        if (i == 7) material.damping = -1;
        if (i == 8) material.sliding = 1;
        if (i == 9) material.sticking = none;
        CHECK(33, pandis_contact_step(&contact, &wrong, place, dt, &touch) == PANDIS_INVALID);
        CHECK(34, touch.flag == PANDIS_INVALID && touch.state == 0);
        for (int k = 0; k < 3; k++) CHECK(35, !(fabs(touch.force[k]) > 0));
        memset(&material, 0, sizeof material);
        CHECK(36, pandis_contact_step(&contact, &object, at, 1e-3, &touch) == PANDIS_OK);
    }
    object.scale = 2; /* another size: the contact begins anew, at the probe */
    for (int k = 0; k < 3; k++) at[k] *= 2;
    CHECK(37, pandis_contact_step(&contact, &object, at, 1e-3, &touch) == PANDIS_OK);
    for (int k = 0; k < 3; k++) CHECK(38, touch.proxy[k] == at[k]);
    return 0;
}

/* A texture that breaks its promises never gives a force that is not finite. */
static int textures(const pandis_field *mesh) {
    const double wrong[][2] = {{none, 0}, {-1, 0}, {1, 0}, {0, none}, {0, 1e9}, {2e-3, -1}};
    pandis_object object = placed(mesh);
    double low[3], high[3], side = pandis_longest_side(mesh);
    pandis_bounds(mesh, low, high);
    for (int i = 0; i < 6; i++) {
        pandis_texture texture = {height, wrong[i], 0.01 * side, 1};
        pandis_contact_options options = pandis_contact_defaults(&object);
        pandis_contact contact;
        pandis_touch touch;
        int touched = 0;
        CHECK(41, OPENS(&contact, &object, &options) == PANDIS_SUCCESS);
        options.texture = &texture;
        CHECK(42, pandis_contact_set(&contact, &options) == PANDIS_SUCCESS);
        for (int tick = 0; tick < 400; tick++) {
            double at[3] = {high[0] + (0.1 - 0.0005 * tick) * side, 0.5 * (low[1] + high[1]),
                0.5 * (low[2] + high[2])};
            CHECK(43, pandis_contact_step(&contact, &object, at, 1e-3, &touch) != PANDIS_INVALID);
            for (int k = 0; k < 3; k++) CHECK(44, isfinite(touch.force[k]));
            touched += (touch.state & PANDIS_TOUCHING) != 0;
        }
        CHECK(45, touched > 50);
    }
    return 0;
}

static int scenes(const pandis_field *mesh) {
    static double room[PANDIS_SCENE_ROOM(3)], ways[PANDIS_POSES_ROOM(3)];
    pandis_contact contacts[3];
    pandis_object objects[3] = {placed(mesh), placed(mesh), placed(mesh)};
    pandis_scene scene;
    pandis_poses poses;
    pandis_touch touches[3];
    double low[3], high[3], force[3], at[3];
    size_t touched = 7;
    pandis_bounds(mesh, low, high);
    for (int k = 0; k < 3; k++) at[k] = 0.5 * (low[k] + high[k]);
    CHECK(51, !pandis_scene_open(&scene, objects, 3, room, sizeof room / 8));
    CHECK(52, !pandis_scene_touch_open(&scene, contacts, NULL, 3));
    for (int i = 0; i < 4; i++) {
        double place[3] = {at[0], i < 2 ? at[1] : i == 2 ? none : much, at[2]};
        double dt = i == 0 ? nothing : i == 1 ? none : 1e-3;
        CHECK(53, pandis_scene_touch(&scene, place, dt, force, touches, 3, &touched));
        CHECK(54, !touched && !(fabs(force[0]) > 0));
    }
    /* more objects than there is room for: as many as fit, and their whole number */
    for (int tick = 0; tick < 400; tick++) {
        double place[3] = {high[0] + (0.1 - 0.0005 * tick) * (high[0] - low[0]), at[1], at[2]};
        size_t most = tick % 4;
        memset(touches, 0, sizeof touches);
        pandis_scene_touch(&scene, place, 1e-3, force, tick % 5 ? touches : NULL, most, &touched);
        CHECK(55, touched == 0 || touched == 3);
        for (size_t i = 0; i < 3; i++)
            CHECK(56, (touches[i].state != 0) == (tick % 5 && i < touched && i < most));
    }
    CHECK(57, touched == 3);
    CHECK(58, !pandis_poses_open(&poses, objects, 3, ways, sizeof ways / 8));
    pandis_pose frame[3];
    for (int i = 0; i < 3; i++) {
        memset(frame + i, 0, sizeof *frame);
        memcpy(frame[i].rotation, objects[i].rotation, sizeof frame[i].rotation);
        frame[i].translation[0] = 0.5 * i;
    }
    CHECK(59, !pandis_poses_give(&poses, frame, 3, 0.01));
    CHECK(60, pandis_poses_step(&poses, NULL, 0) == 1 && !(objects[2].translation[0] > 0));
    CHECK(61, pandis_poses_step(&poses, NULL, none) == 0 && !(objects[2].translation[0] > 0));
    for (int i = 0; i < 3; i++) CHECK(62, pandis_poses_step(&poses, NULL, 0.005) == 0);
    CHECK(63, objects[2].translation[0] == 1);
    return 0;
}

static int files(const pandis_field *mesh, const pandis_field *spline, const char *folder) {
    pandis_field field;
    pandis_handover handover;
    static double room[8];
    CHECK(71, pandis_open_file(&field, "") == PANDIS_ERROR_FILE);
    CHECK(72, pandis_open_file(&field, folder) != PANDIS_SUCCESS);
    CHECK(73, pandis_field_kind(&field) == PANDIS_CLOSED);
    CHECK(74, pandis_handover_open(&handover, spline, room, sizeof room) == PANDIS_ERROR_CONTENT);
    CHECK(75, !pandis_region(mesh, 0) && !pandis_region(mesh, -1) && !pandis_region(spline, 9));
    return 0;
}

int main(int count, char **words) {
    pandis_field mesh, spline, grid;
    if (count < 5 || pandis_open_file(&mesh, words[1]) || pandis_open_file(&spline, words[2]) ||
        pandis_open_file(&grid, words[3]))
        return 100;
    int wrong = versions();
    if (!wrong) wrong = objects(&mesh);
    if (!wrong) wrong = options(&mesh, &spline, &grid);
    if (!wrong) wrong = steps(&mesh, &grid);
    if (!wrong) wrong = textures(&mesh);
    if (!wrong) wrong = scenes(&mesh);
    if (!wrong) wrong = files(&mesh, &spline, words[4]);
    pandis_close(&mesh), pandis_close(&spline), pandis_close(&grid);
    return wrong;
}

/* ---------------------------------------------------------------- contacts of a scene */

PANDIS_API int pandis_scene_touch_open(pandis_scene *scene, pandis_contact *contacts,
                                       const pandis_material *const *materials, double radius) {
    int error = 0;
    scene->contacts = contacts, scene->materials = materials, scene->touched = 0;
    for (int k = 0; k < 3; k++) scene->probe[k] = (double)NAN;
    for (size_t i = 0; i < scene->count; i++) {
        int why = pandis_contact_open(contacts + i, scene->objects + i, radius);
        if (!why) why = pandis_scene_moved(scene, i);
        else contacts[i].budget = 0;
        if (!error) error = why;
    }
    return error;
}

/* A contact that was not stepped has gone with the probe: nothing was in its way. */
static void pandis__wake(const pandis_scene *scene, size_t index) {
    pandis_contact *c = scene->contacts + index;
    double point[3], probe[3];
    if (c->state != PANDIS__CLEAR || memcmp(c->proxy, c->probe, sizeof c->probe)) return; /* it is behind */
    pandis__enter(&c->object, scene->probe, point); /* where it lay then */
    if (!pandis__unit(c->object.field, point, probe)) return;
    memcpy(c->proxy, probe, sizeof probe), memcpy(c->probe, probe, sizeof probe);
}

/* How far the probe may go before a contact has to be stepped again, in scene units. */
static double pandis__at_ease(const pandis_contact *c, const pandis_object *o) {
    if (c->state != PANDIS__CLEAR || c->sunk > 0 || pandis__dot(c->pull, c->pull) > 0) return 0;
    if (memcmp(c->proxy, c->probe, sizeof c->probe)) return 0;
    return (c->ball[4] - pandis__between(c->probe, c->ball)) * (o->scale / o->field->scale) * (1 - 4e-6);
}

PANDIS_API int pandis_scene_touch(pandis_scene *scene, const double position[3], double dt, double force[3],
                                  pandis_touch *touches, size_t most) {
    int worst = PANDIS_OK;
    double size = 0;
    force[0] = force[1] = force[2] = 0;
    scene->asked = scene->touched = 0;
    if (!scene->contacts || !(dt > 0)) return PANDIS_INVALID;
    for (int k = 0; k < 3; k++) {
        if (!(fabs(position[k]) <= 1e100)) return PANDIS_INVALID;
        size = fmax(size, fabs(position[k]));
    }
    for (size_t i = 0; (i = pandis__next_awake(scene, PANDIS__OF_CONTACTS, i, position)) < scene->count; i++) {
        const pandis_object *o = scene->objects + i;
        pandis_contact *c = scene->contacts + i;
        pandis_touch touch;
        double far = size;
        if (!c->budget) continue; /* it cannot be touched */
        pandis__wake(scene, i);
        int flag = pandis_contact_step(c, o, position, dt, scene->materials ? scene->materials[i] : NULL, &touch);
        worst = pandis__worse(flag, worst);
        scene->asked += (size_t)touch.queries;
        for (int k = 0; k < 3; k++) force[k] += touch.force[k], far = fmax(far, fabs(o->translation[k]));
        pandis__keep_ball(pandis__ball(scene, PANDIS__OF_CONTACTS, i), position, pandis__at_ease(c, o) - 1e-12 * far);
        if (!(touch.state & (PANDIS_TOUCHING | PANDIS_BEHIND))) continue;
        touch.object = (int32_t)i;
        if (touches && scene->touched < most) touches[scene->touched] = touch;
        scene->touched++;
    }
    memcpy(scene->probe, position, sizeof scene->probe);
    return worst;
}

/* -------------------- contacts of a scene */

PANDIS__ONCE PANDIS_API pandis_error pandis_scene_touch_open(pandis_scene *scene,
    pandis_contact *contacts, const pandis_contact_options *options, size_t count) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_error error = PANDIS_SUCCESS;
    if (count != s->count) return PANDIS_ERROR_COUNT;
    s->contacts = contacts;
    for (int k = 0; k < 3; k++) s->probe[k] = (double)NAN;
    for (size_t i = 0; i < count; i++) {
        pandis_error why =
            pandis_contact_open(contacts + i, s->objects + i, options ? options + i : NULL);
        if (!why) why = pandis__wake_object(s, i);
        if (!error) error = why;
    }
    return error;
}

/* Before a contact is stepped again, move its proxy to the probe's last position: nothing was in
 * the way while the contact was not stepped. */
static void pandis__wake(const pandis__scene *scene, size_t index) {
    pandis__contact *c = pandis__contact_of(scene->contacts + index);
    double point[3], probe[3];
    /* the proxy is not at the probe */
    if (c->state != PANDIS__CLEAR || memcmp(c->proxy, c->probe, sizeof c->probe)) return;
    pandis__enter(&c->object, scene->probe, point); /* the object is at its pose in that step */
    if (!pandis__unit(c->object.field, point, probe)) return;
    memcpy(c->proxy, probe, sizeof probe), memcpy(c->probe, probe, sizeof probe);
}

/* Distance, in scene units, that the probe may move before a contact must be stepped again. */
static double pandis__at_ease(const pandis__contact *c, const pandis_object *o) {
    if (c->state != PANDIS__CLEAR || c->sunk > 0 || pandis__dot(c->pull, c->pull) > 0) return 0;
    if (memcmp(c->proxy, c->probe, sizeof c->probe)) return 0;
    return (c->ball[4] - pandis__between(c->probe, c->ball)) * (o->scale / o->field->scale) *
        (1 - 4e-6);
}

PANDIS_API pandis_flag pandis_scene_touch(pandis_scene *scene, const double position[3], double dt,
    double force[3], pandis_touch *touches, size_t most, size_t *touched) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_flag worst = PANDIS_OK;
    size_t count = 0;
    double size = 0;
    force[0] = force[1] = force[2] = 0;
    s->queries = 0;
    if (touched) *touched = 0;
    if (!s->contacts || !(dt > 0)) return PANDIS_INVALID;
    for (int k = 0; k < 3; k++) {
        if (!(fabs(position[k]) <= 1e100)) return PANDIS_INVALID;
        size = fmax(size, fabs(position[k]));
    }
    for (size_t i = 0; (i = pandis__next_awake(s, PANDIS__OF_CONTACTS, i, position)) < s->count;
        i++) {
        const pandis_object *o = s->objects + i;
        const pandis__contact *c = pandis__contact_in(s->contacts + i);
        pandis_touch touch;
        double far = size;
        if (!c->options.budget) continue; /* the contact could not be opened */
        pandis__wake(s, i);
        worst = pandis__worse(pandis_contact_step(s->contacts + i, o, position, dt, &touch), worst);
        s->queries += (size_t)touch.queries;
        for (int k = 0; k < 3; k++)
            force[k] += touch.force[k], far = fmax(far, fabs(o->translation[k]));
        pandis__keep_ball(
            pandis__ball(s, PANDIS__OF_CONTACTS, i), position, pandis__at_ease(c, o) - 1e-12 * far);
        if (!(touch.state & (PANDIS_TOUCHING | PANDIS_BEHIND))) continue;
        touch.object = (int32_t)i;
        if (touches && count < most) touches[count] = touch;
        count++;
    }
    memcpy(s->probe, position, sizeof s->probe);
    if (touched) *touched = count;
    return worst;
}

/* -------------------- contact */

/* Compute the force of the spring and of damping from the positions of the probe and the proxy, in
 * the object's frame and in scene units. */
static void pandis__pull(const pandis__contact *c, const pandis_object *o, const double *normal,
    double damping, double *force) {
    double per = o->scale / o->field->scale;
    for (int k = 0; k < 3; k++) force[k] = o->stiffness * per * c->pull[k];
    double push = pandis__dot(force, normal),
           fast = -damping * pandis__dot(c->velocity, normal) * per;
    if (!(push > 0)) return;
    /* damping is at most the spring's force, so that it starts at zero and never pulls */
    fast = fast > push ? push : fast < -push ? -push : fast;
    for (int k = 0; k < 3; k++) force[k] += fast * normal[k];
}

/* Largest radius of a probe (unit frame) that can return to free space. Where the field has only a
 * lower bound of the distance, no free space would be known for a larger probe. */
static double pandis__widest(const pandis_field *f) {
    if (f->kind == PANDIS_SPLINE) return 0.95 * fmax(f->height, f->as.spline.outside);
    return f->kind == PANDIS_GRID ? 0.95 * f->height : 1e100;
}

#define PANDIS__LEAST_BUDGET 8
#define PANDIS__BUDGET 24
#define PANDIS__STEEPEST 15.0

/* Whether a number is from 0 to `most`; 0 for NaN. */
static int pandis__in_range(double x, double most) { return x >= 0 && x <= most; }

static int pandis__material_is_sound(const pandis_material *m) {
    return pandis__in_range(m->sticking, 1e100) && pandis__in_range(m->sliding, m->sticking) &&
        pandis__in_range(m->damping, 1e100) && pandis__in_range(m->drag, 1e100);
}

PANDIS__ONCE static pandis_error pandis__check_options(
    const pandis_contact_options *options, const pandis_object *o) {
    const pandis_texture *t = options->texture;
    double per = o->field->scale / o->scale;
    int sound = options->budget >= PANDIS__LEAST_BUDGET &&
        pandis__in_range(options->slide, 1e100) && pandis__in_range(options->radius, 1e100) &&
        (!options->material_count || options->materials);
    if (t)
        sound = sound && t->height && pandis__in_range(t->most, 1e100) &&
            pandis__in_range(t->steepest, PANDIS__STEEPEST);
    for (size_t i = 0; sound && i < options->material_count; i++)
        sound = pandis__material_is_sound(options->materials + i);
    if (!sound) return PANDIS_ERROR_OPTIONS;
    return options->radius * per <= pandis__widest(o->field) ? PANDIS_SUCCESS : PANDIS_ERROR_RADIUS;
}

PANDIS__ONCE PANDIS_API pandis_contact_options pandis_contact_defaults(
    const pandis_object *object) {
    pandis_contact_options options;
    memset(&options, 0, sizeof options);
    options.budget = PANDIS__BUDGET;
    if (pandis__lies(object))
        options.slide = 0.5 * PANDIS__LONGEST * object->scale / object->field->scale;
    return options;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_contact_open(
    pandis_contact *contact, const pandis_object *object, const pandis_contact_options *options) {
    pandis__contact *c = pandis__contact_of(contact);
    pandis_contact_options defaults = pandis_contact_defaults(object);
    memset(contact, 0, sizeof *contact);
    if (!pandis__lies(object)) return PANDIS_ERROR_POSE;
    if (!pandis__knows_distance(object->field)) return PANDIS_ERROR_KIND;
    if (!options) options = &defaults;
    pandis_error error = pandis__check_options(options, object);
    if (error) return error;
    c->options = *options, c->object = *object;
    c->lift = PANDIS__HOVER, c->pace = PANDIS__PACE / 8, c->face = c->region = -1;
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_contact_options pandis_contact_get(const pandis_contact *contact) {
    return pandis__contact_in(contact)->options;
}

PANDIS_API pandis_error pandis_contact_set(
    pandis_contact *contact, const pandis_contact_options *options) {
    pandis__contact *c = pandis__contact_of(contact);
    if (!c->options.budget) return PANDIS_ERROR_OPTIONS; /* the contact is not open */
    pandis_error error = pandis__check_options(options, &c->object);
    if (error) return error;
    /* the known free space depends on the old radius and texture */
    if (options->radius != c->options.radius || options->texture != c->options.texture)
        c->ball[3] = -1;
    c->options = *options;
    return PANDIS_SUCCESS;
}

PANDIS_API void pandis_contact_reshaped(pandis_contact *contact) {
    pandis__contact_of(contact)->ball[3] = -1;
}

/* Move the walls outward by `by`, but not beyond the probe, and move the proxy to the probe. */
static void pandis__stand_at(pandis__proxy *p, const double *probe, pandis__look *look, double by) {
    p->state->sunk -= by, p->radius += by;
    look->distance -= by, look->free -= by, look->sure -= by;
    for (int k = 0; k < 3; k++) look->foot[k] = probe[k] - look->distance * look->normal[k];
    p->count = 0;
    memcpy(p->x, probe, 3 * sizeof *probe);
    pandis__take_ball(p, look);
    pandis__learn(p, look, probe, look->distance);
}

/* Begin with the proxy at the probe. If the probe is inside, the walls are moved inward to its
 * depth until it comes out, so that it is neither kicked out nor let through. */
static int pandis__begin(pandis__proxy *p, const double *probe) {
    pandis__look look;
    if (!pandis__look_at(p, probe, &look) || (look.distance < 0 && p->flag != PANDIS_OK)) return 0;
    pandis__stand_at(p, probe, &look, fmin(0, look.distance));
    p->state->state = PANDIS__CLEAR;
    return 1;
}

/* After a start inside, while nothing holds the probe back, move the walls outward to the probe. */
static int pandis__rise(pandis__proxy *p, const double *probe) {
    pandis__look look;
    if (!pandis__look_at(p, probe, &look)) return 0;
    if (look.distance > 0) pandis__stand_at(p, probe, &look, fmin(look.distance, p->state->sunk));
    return 1;
}

/* After a step without an answer, prepare the next one. The force grows from zero again, and the
 * next look is from nearer to the surface. The contact begins anew if the straight way from the
 * probe to the proxy is free, up to the proxy or to the first place without an answer. Otherwise,
 * beside a gap of the field, the proxy could stay for ever. */
PANDIS__ONCE static void pandis__recover(pandis__proxy *p, const double *probe) {
    pandis__contact *c = p->state;
    pandis__look look;
    double at[3] = {probe[0], probe[1], probe[2]};
    memset(c->pull, 0, sizeof c->pull);
    memset(c->velocity, 0, sizeof c->velocity);
    memcpy(c->probe, probe, sizeof c->probe);
    c->lift = fmax(c->lift / 4, PANDIS__HOVER / 64);
    if (!pandis__look_at(p, at, &look)) return;
    for (int turn = 0; turn < 128 && look.free > 0; turn++) {
        double left = pandis__between(at, c->proxy), share = fmin(1, look.free / left);
        for (int k = 0; k < 3; k++) at[k] += share * (c->proxy[k] - at[k]);
        if (left <= PANDIS__GAP || !pandis__look_at(p, at, &look)) {
            c->state = PANDIS__BEGINS;
            return;
        }
    }
}

/* Find the region at the proxy, from a mesh of the same object. */
static void pandis__find_region(pandis__proxy *p) {
    const pandis_field *f = p->field;
    pandis_answer answer;
    double point[3];
    for (int k = 0; k < 3; k++) point[k] = p->x[k] / f->scale + f->centre[k];
    pandis_query(p->state->options.regions, point, &answer);
    p->queries++;
    p->state->region = answer.region;
}

static void pandis__tell_touch(const pandis__proxy *p, const pandis__way *way,
    const pandis_object *o, double damping, pandis_touch *touch) {
    const pandis__contact *c = p->state;
    double per = o->scale / p->field->scale, normal[3], force[3], place[3];
    for (int k = 0; k < 3; k++) normal[k] = way->active ? way->goal[k] - c->probe[k] : c->pull[k];
    if (!pandis__normalise(normal)) normal[0] = normal[1] = normal[2] = 0;
    pandis__pull(c, o, normal, damping, force);
    for (int k = 0; k < 3; k++) place[k] = c->proxy[k] / p->field->scale + p->field->centre[k];
    for (int k = 0; k < 3; k++) {
        const double *row = o->rotation + 3 * k;
        touch->force[k] = pandis__dot(row, force);
        touch->normal[k] = way->active ? pandis__dot(row, normal) : 0;
        touch->proxy[k] = o->scale * pandis__dot(row, place) + o->translation[k];
    }
    touch->slip = way->slid * per, touch->face = c->face, touch->region = c->region;
    touch->state =
        (way->active ? PANDIS_TOUCHING : 0) | (way->active && c->sticks ? PANDIS_STICKING : 0);
    for (int i = 0; i < PANDIS__PLANES; i++) touch->planes += way->active >> i & 1;
    if (way->active) touch->depth = pandis__between(way->goal, c->probe) * per;
    int apart = memcmp(c->proxy, c->probe, sizeof c->probe) != 0;
    if (way->held || (!way->active && apart)) touch->state |= PANDIS_BEHIND;
    if (c->sunk > 0) touch->state |= PANDIS_WAITING;
}

/* Restore the proxy that a contact keeps between steps; unused planes stay uninitialised. */
static void pandis__recall(
    pandis__contact *c, const pandis_field *f, double radius, pandis__proxy *p) {
    p->state = c, p->field = f, p->radius = radius;
    p->tolerance = f->kind == PANDIS_NETWORK ? 1e-6 : 1e-11;
    /* for a lattice, one step, because rounding may have folded faces */
    p->blur = f->kind == PANDIS_COMPACT ? f->as.compact.step : PANDIS__BEHIND;
    p->queries = 0, p->flag = PANDIS_OK;
    p->exact = f->kind == PANDIS_MESH || f->kind == PANDIS_COMPACT || f->kind == PANDIS_SHAPE;
    p->flat = p->exact && !c->options.texture;
    p->x = c->proxy, p->ball = c->ball, p->count = c->planes;
    memcpy(p->plane, c->plane, (size_t)p->count * sizeof *p->plane);
}

/* Store the part of the proxy's state that the next step needs. */
static void pandis__retain(
    pandis__contact *c, const pandis__proxy *p, int active, const double *probe) {
    c->planes = p->count < PANDIS__KEPT ? p->count : PANDIS__KEPT;
    memcpy(c->plane, p->plane + (p->count - c->planes), (size_t)c->planes * sizeof *p->plane);
    if (active) c->state = PANDIS__TOUCHES;
    if (!active) c->sticks = 0;
    if (active || pandis__between(p->x, probe) > 0) return;
    c->state = PANDIS__CLEAR; /* arrived */
    c->lift = PANDIS__HOVER, c->pace = PANDIS__PACE / 8;
    c->settled = c->close = c->idle = 0;
}

/* Stretch the spring from the probe to the proxy, but change it by at most the distance `most`.
 * Also update the probe's smoothed velocity. */
static void pandis__stretch(pandis__contact *c, const double *probe, double most, double dt) {
    double pull[3], change = 0;
    for (int k = 0; k < 3; k++) {
        pull[k] = c->state == PANDIS__TOUCHES ? c->proxy[k] - probe[k] : 0;
        change += (pull[k] - c->pull[k]) * (pull[k] - c->pull[k]);
    }
    double share = change > most * most ? most / sqrt(change) : 1, smoothed = dt / (dt + 0.002);
    for (int k = 0; k < 3; k++) {
        c->pull[k] += share * (pull[k] - c->pull[k]);
        double fast = c->state == PANDIS__TOUCHES ? (probe[k] - c->probe[k]) / dt : 0;
        double before = c->state == PANDIS__TOUCHES ? c->velocity[k] : 0;
        c->velocity[k] = before + smoothed * (fast - before);
        c->probe[k] = probe[k];
    }
}

PANDIS_API pandis_flag pandis_contact_step(pandis_contact *handle, const pandis_object *object,
    const double position[3], double dt, pandis_touch *touch) {
    pandis__contact *contact = pandis__contact_of(handle);
    const pandis_contact_options *options = &contact->options;
    static const pandis_material smooth = {0, 0, 0, 0};
    const pandis_field *f = object->field;
    /* unit-frame lengths per scene length */
    double point[3], probe[3], per = f->scale / object->scale;
    memset(touch, 0, sizeof *touch);
    touch->flag = PANDIS_INVALID, touch->face = touch->region = -1;
    pandis__enter(object, position, point);
    if (!pandis__unit(f, point, probe) || !(dt > 0) || !options->budget) return PANDIS_INVALID;
    if (!pandis__knows_distance(f) || options->radius * per > pandis__widest(f))
        return PANDIS_INVALID;
    const pandis_material *material = options->material_count ? options->materials : &smooth;
    if (contact->region > 0 && (size_t)contact->region < options->material_count)
        material += contact->region;
    if (!pandis__in_range(object->stiffness, PANDIS__STIFFEST) ||
        !pandis__material_is_sound(material))
        return PANDIS_INVALID;
    if (contact->object.field != f || contact->object.scale != object->scale)
        contact->state = PANDIS__BEGINS;
    if (contact->state == PANDIS__BEGINS) contact->sunk = 0;
    contact->object = *object;
    pandis__proxy p; /* unused planes are uninitialised */
    pandis__recall(contact, f, options->radius * per - contact->sunk, &p);
    if (!contact->stalled) contact->lift = fmin(PANDIS__HOVER, 1.5 * contact->lift);

    double moved = contact->state == PANDIS__BEGINS ? 0 : pandis__between(probe, contact->probe);
    double soft =
        material->drag > 0 ? object->stiffness * dt / (object->stiffness * dt + material->drag) : 1;
    pandis__way way = {moved + options->slide * dt * per, material->sticking, material->sliding,
        soft, -1, 1, 0, {0}, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    int answered = 1;
    if (contact->state == PANDIS__BEGINS) answered = pandis__begin(&p, probe);
    else if (!(contact->ball[3] > 0)) answered = pandis__regain(&p);
    if (contact->state != PANDIS__BEGINS)
        answered = answered && pandis__come(&p, &way, probe, moved);
    if (contact->sunk > 0 && !way.active && !memcmp(p.x, probe, sizeof probe))
        answered = answered && pandis__rise(&p, probe);
    if (answered && way.active && p.queries && options->regions && !f->regions)
        pandis__find_region(&p);
    touch->queries = p.queries, touch->flag = p.flag;
    if (contact->state == PANDIS__BEGINS) {
        touch->state = p.flag == PANDIS_INVALID ? 0 : PANDIS_WAITING;
        return touch->flag;
    }
    if (!answered) {
        pandis__recover(&p, probe);
        touch->queries = p.queries;
        return touch->flag = PANDIS_INVALID;
    }
    pandis__retain(contact, &p, way.active, probe);
    /* the spring changes by no more than the probe and the proxy may move */
    pandis__stretch(contact, probe, 2 * moved + options->slide * dt * per, dt);
    pandis__tell_touch(&p, &way, object, material->damping, touch);
    return touch->flag;
}

/* -------------------- scenes */

/* Transform a point of the scene into the coordinates of an object's mesh. */
static void pandis__enter(const pandis_object *o, const double *point, double *p) {
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = point[k] - o->translation[k];
    for (int k = 0; k < 3; k++)
        p[k] =
            (o->rotation[k] * off[0] + o->rotation[3 + k] * off[1] + o->rotation[6 + k] * off[2]) /
            o->scale;
}

/* Query a point in the mesh's coordinates, and add its penalty force. There is none outside, or if
 * there is no answer. */
static void pandis__add_force(
    const pandis_object *o, const double *p, pandis_answer *answer, double *force) {
    pandis_query(o->field, p, answer);
    /* false for NaN */
    double push = answer->distance < 0 ? -o->stiffness * (answer->distance * o->scale) : 0;
    if (!(push > 0)) return;
    for (int k = 0; k < 3; k++) {
        const double *row = o->rotation + 3 * k;
        force[k] += push * pandis__dot(row, answer->normal);
    }
}

PANDIS_API pandis_flag pandis_object_force(
    const pandis_object *object, const double point[3], double force[3]) {
    pandis_answer answer;
    double p[3];
    force[0] = force[1] = force[2] = 0;
    pandis__enter(object, point, p);
    pandis__add_force(object, p, &answer, force);
    return answer.flag;
}

/* Whether a matrix is a rotation to within 1e-6, and a translation at most 1e100. */
static int pandis__places(const double *rotation, const double *translation) {
    double most = 0, across[3];
    for (int i = 0; i < 3; i++) {
        if (!(fabs(translation[i]) <= 1e100)) return 0;
        for (int j = 0; j < 3; j++) {
            double product = 0;
            for (int k = 0; k < 3; k++) product += rotation[3 * k + i] * rotation[3 * k + j];
            double off = fabs(product - (i == j));
            if (!(off <= most)) most = off; /* NaN, too */
        }
    }
    pandis__cross(rotation, rotation + 3, across);
    return most <= 1e-6 && pandis__dot(across, rotation + 6) > 0;
}

static int pandis__lies(const pandis_object *o) {
    if (!o->field || !o->field->kind || !pandis__places(o->rotation, o->translation)) return 0;
    return o->scale >= 1e-100 && o->scale <= 1e100 && o->stiffness >= 0 &&
        o->stiffness <= PANDIS__STIFFEST;
}

/* A scene keeps two balls per object in which the object cannot be touched: one for penalty forces,
 * one for contacts, whose proxies may be elsewhere. Centres and squared radii are stored in blocks,
 * coordinate by coordinate. */
enum { PANDIS__OF_FORCES, PANDIS__OF_CONTACTS };

static double *pandis__ball(const pandis__scene *scene, int use, size_t object) {
    double *balls = scene->room + (size_t)use * (PANDIS_SCENE_ROOM(scene->count) / 2);
    return balls + object / PANDIS_SCENE_BLOCK * 4 * PANDIS_SCENE_BLOCK +
        object % PANDIS_SCENE_BLOCK;
}

static void pandis__keep_ball(double *ball, const double *centre, double radius) {
    for (int k = 0; k < 3; k++) ball[k * PANDIS_SCENE_BLOCK] = centre[k];
    ball[3 * PANDIS_SCENE_BLOCK] = radius > 0 ? radius * radius : -1;
}

/* Distance from a point (unit frame) within which nothing can be touched, by the bounds of the
 * surface. */
static double pandis__clearance(const pandis_field *f, const double *u) {
    double off[3];
    for (int k = 0; k < 3; k++) {
        double below = f->low[k] - u[k], above = u[k] - f->high[k];
        double d = below > above ? below : above;
        off[k] = d > 0 ? d : 0;
    }
    return sqrt(pandis__dot(off, off)) - f->margin[0];
}

/* The worse of two flags, worst first: no answer, an estimate, a search that was cut short. */
static pandis_flag pandis__worse(pandis_flag one, pandis_flag other) {
    static const int rank[] = {0, 2, 3, 1, 0}; /* by flag */
    return rank[one] > rank[other] ? one : other;
}

/* Query an object if it may be touched at a point, and keep the ball in which it cannot be. */
static pandis_flag pandis__visit(
    pandis__scene *scene, size_t index, const double *point, double *force) {
    const pandis_object *o = scene->objects + index;
    const pandis_field *f = o->field;
    double p[3], u[3], size = 0;
    pandis_flag flag = PANDIS_OK;
    int inside = 1;
    pandis__enter(o, point, p);
    for (int k = 0; k < 3; k++) {
        u[k] = (p[k] - f->centre[k]) * f->scale;
        inside &= fabs(u[k]) <= 1;
        size = fmax(size, fmax(fabs(point[k]), fabs(o->translation[k])));
    }
    double clear = pandis__clearance(f, u);
    if (!(clear > 0)) {
        pandis_answer answer;
        pandis__add_force(o, p, &answer, force);
        scene->queries++;
        flag = answer.flag;
        double away = flag == PANDIS_CUT && answer.distance > 0 ? answer.clear : answer.distance;
        if (inside && flag != PANDIS_INVALID)
            clear = away * f->scale - f->margin[flag == PANDIS_BOUND];
    }
    /* less rounding errors, and the stretch of a rotation that is exact only within 1e-6 */
    pandis__keep_ball(pandis__ball(scene, PANDIS__OF_FORCES, index), point,
        clear * (o->scale / f->scale) * (1 - 4e-6) - 1e-12 * size);
    return flag;
}

/* Mark an object to be queried at the next point; leave it out if it is invalid. */
static pandis_error pandis__wake_object(const pandis__scene *scene, size_t object) {
    const double origin[3] = {0};
    int lies = pandis__lies(scene->objects + object);
    for (int use = PANDIS__OF_FORCES; use <= PANDIS__OF_CONTACTS; use++)
        pandis__keep_ball(pandis__ball(scene, use, object), origin, lies ? 0 : 1e150);
    return lies ? PANDIS_SUCCESS : PANDIS_ERROR_POSE;
}

PANDIS_API pandis_error pandis_scene_moved(pandis_scene *scene, size_t object) {
    const pandis__scene *s = pandis__scene_in(scene);
    return object < s->count ? pandis__wake_object(s, object) : PANDIS_ERROR_COUNT;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_scene_open(pandis_scene *scene,
    const pandis_object *objects, size_t count, double *room, size_t room_length) {
    const double origin[3] = {0};
    pandis__scene *s = pandis__scene_of(scene);
    pandis_error error = PANDIS_SUCCESS;
    memset(s, 0, sizeof *s);
    if (room_length < PANDIS_SCENE_ROOM(count)) return PANDIS_ERROR_COUNT;
    s->objects = objects, s->count = count, s->room = room;
    for (size_t i = 0; i < PANDIS_SCENE_ROOM(count) / 8; i++) {
        pandis__keep_ball(pandis__ball(s, PANDIS__OF_FORCES, i), origin, 1e150);
        pandis__keep_ball(pandis__ball(s, PANDIS__OF_CONTACTS, i), origin, 1e150);
    }
    for (size_t i = 0; i < count; i++)
        if (pandis__wake_object(s, i)) error = PANDIS_ERROR_POSE;
    return error;
}

PANDIS_API size_t pandis_scene_queries(const pandis_scene *scene) {
    return pandis__scene_in(scene)->queries;
}

/* Find the next object, from `from` on, that may be touched at a point; the count if there is none.
 */
static size_t pandis__next_awake(
    const pandis__scene *scene, int use, size_t from, const double *point) {
    size_t start = from - from % PANDIS_SCENE_BLOCK;
    for (; start < scene->count; start += PANDIS_SCENE_BLOCK, from = start) {
        const double *ball = pandis__ball(scene, use, start);
        int awake = from > start; /* mid-block: an earlier call already found this block awake */
        for (int i = 0; i < PANDIS_SCENE_BLOCK; i++) {
            double x = point[0] - ball[i], y = point[1] - ball[i + PANDIS_SCENE_BLOCK];
            double z = point[2] - ball[i + 2 * PANDIS_SCENE_BLOCK];
            awake |= x * x + y * y + z * z >= ball[i + 3 * PANDIS_SCENE_BLOCK];
        }
        for (size_t i = from; awake && i < scene->count && i < start + PANDIS_SCENE_BLOCK; i++) {
            const double *own = pandis__ball(scene, use, i);
            double x = point[0] - own[0], y = point[1] - own[PANDIS_SCENE_BLOCK];
            double z = point[2] - own[2 * PANDIS_SCENE_BLOCK];
            if (x * x + y * y + z * z >= own[3 * PANDIS_SCENE_BLOCK]) return i;
        }
    }
    return scene->count;
}

PANDIS_API pandis_flag pandis_scene_force(
    pandis_scene *scene, const double point[3], double force[3]) {
    pandis__scene *s = pandis__scene_of(scene);
    pandis_flag worst = PANDIS_OK;
    force[0] = force[1] = force[2] = 0;
    s->queries = 0;
    for (int k = 0; k < 3; k++)
        if (!(fabs(point[k]) <= 1e100)) return PANDIS_INVALID;
    for (size_t i = 0; (i = pandis__next_awake(s, PANDIS__OF_FORCES, i, point)) < s->count; i++)
        worst = pandis__worse(pandis__visit(s, i, point, force), worst);
    return worst;
}

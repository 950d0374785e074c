/* -------------------- a proxy, and the known surface near it
 *
 * Everything is in the object's unit frame. The proxy is a point; a probe of radius r offsets the
 * surface by r. The known free space is a ball around a point a little above the proxy, as large as
 * the distance there. The proxy goes from ball to ball. Each ball overlaps the one before, so no
 * surface is on the proxy's path. The surface is represented by planes. Each goes through the
 * foot of a point that was looked at. */

#define PANDIS__HOVER 0.004 /* height from which the surface is looked at */
#define PANDIS__FARTHEST 2  /* largest distance from which a place is looked at, in lifts */
/* a plane is forgotten if its foot is farther away than this, in lifts */
#define PANDIS__STALE 4
/* cosine of the angle below which two planes count as nearly equal */
#define PANDIS__ALIKE 0.99
/* a surface no farther behind a plane than this counts as in front of it */
#define PANDIS__BEHIND 1e-8
#define PANDIS__TRUSTED 0.8      /* free share of an approximate distance to the surface as felt */
#define PANDIS__LEAST_SHARE 0.25 /* likewise, of a distance that is flagged as a bound */
#define PANDIS__GUESSED 0.05     /* assumed excess of a distance if the file does not state it */

enum { PANDIS__BEGINS, PANDIS__CLEAR, PANDIS__TOUCHES };

/* A proxy while it is moved in a step. */
typedef struct {
    pandis__contact *state;
    const pandis_field *field;
    /* offset of the walls from the surface; less if the probe began nearer than that */
    double radius;
    double tolerance; /* for comparing planes */
    double blur;      /* a surface this near, or this little behind a plane, is ignored */
    int exact;        /* the field's distances are exact, not approximate */
    int flat;         /* exact, and no texture changes the surface */
    int queries, count;
    pandis_flag flag;
    pandis__plane plane[PANDIS__PLANES];
    double *x, *ball;
} pandis__proxy;

/* Result of a look at a point: the distance, the radius of the free ball around the point and of
 * the ball that can be entered without a look, and the normal and foot of the surface. */
typedef struct {
    double at[3], distance, free, sure, normal[3], foot[3];
    int32_t face, region;
} pandis__look;

static int pandis__knows_distance(const pandis_field *f) {
    return f->kind && !(f->kind == PANDIS_GRID && f->as.grid.rule <= PANDIS__TRILINEAR);
}

/* Apply a texture to the result of a look. The distance becomes that to the tangent plane of the
 * raised surface below the point, the normal becomes that of this plane, and the free radius
 * shrinks. */
static void pandis__roughen(const pandis__proxy *p, const double *at, pandis_answer *answer,
    double *distance, double *free, double *sure) {
    const pandis_texture *t = p->state->options.texture;
    const pandis_field *f = p->field;
    double foot[3], slope[3], *n = answer->normal;
    for (int k = 0; k < 3; k++) foot[k] = (at[k] - *distance * n[k]) / f->scale + f->centre[k];
    double raised = t->height(t->data, foot, f->regions ? answer->region : p->state->region, slope);
    raised = (raised > 0 ? raised < t->most ? raised : t->most : 0) * f->scale; /* 0 for NaN, too */
    double along = pandis__dot(slope, n), steep = 0;
    for (int k = 0; k < 3; k++) slope[k] -= along * n[k], steep += slope[k] * slope[k];
    if (!(steep <= 1e6)) slope[0] = slope[1] = slope[2] = steep = 0;
    for (int k = 0; k < 3; k++) n[k] = (n[k] - slope[k]) / sqrt(1 + steep);
    *distance = (*distance - raised) / sqrt(1 + steep);
    /* the raised surface lies below a cone over the foot with twice the slope: feet move up to
     * twice as far as points */
    *free = fmin(*free, (*free - raised) / sqrt(1 + 4 * t->steepest * t->steepest)),
    *sure -= t->most * f->scale;
}

/* Lower bound of the distance to a network's surface from a place beyond its box. The surface is
 * inside the box. Its distance from the nearest point of the box is at least a share of the
 * network's distance there. */
PANDIS__ONCE static double pandis__free_beyond(
    const pandis__proxy *p, const double *at, double distance) {
    double way = 0;
    for (int k = 0; k < 3; k++) {
        double over = fmax(0, fabs(at[k]) - 1);
        way += over * over;
    }
    double there = distance - sqrt(way);
    if (there > p->radius) there = PANDIS__TRUSTED * (there - p->radius) + p->radius;
    return there > 0 ? sqrt(way + there * there) : -INFINITY; /* inside: nothing is known */
}

/* Look at a point; 0 if there is no answer. */
static int pandis__look_at(pandis__proxy *p, const double *at, pandis__look *look) {
    const pandis_field *f = p->field;
    pandis_answer answer;
    double point[3];
    for (int k = 0; k < 3; k++) look->at[k] = at[k], point[k] = at[k] / f->scale + f->centre[k];
    pandis_query(f, point, &answer);
    p->queries++;
    p->flag = pandis__worse(answer.flag, p->flag);
    if (answer.flag == PANDIS_INVALID) return 0;
    double distance = answer.distance * f->scale, free = distance, sure;
    if (p->exact) {
        sure = free = fmin(distance, answer.clear * f->scale);
    } else if (answer.flag == PANDIS_OK) {
        sure = distance - f->margin[0],
        free = fmax(PANDIS__TRUSTED * (distance - p->radius) + p->radius, sure);
    } else {
        /* the margin applies in the box; beyond it only the surface's bounds are known */
        int inside = fabs(at[0]) <= 1 && fabs(at[1]) <= 1 && fabs(at[2]) <= 1;
        double guessed = f->margin[1] < 1e300 ? f->margin[1] : PANDIS__GUESSED;
        double away = f->margin[0] < 1e300 ? pandis__clearance(f, at) : -1;
        /* also a lower bound: a spline covers the space up to this distance from the surface */
        double least = f->kind == PANDIS_SPLINE && distance > 0 ? f->as.spline.outside
                                                                : PANDIS__LEAST_SHARE * distance;
        sure = inside ? fmax(away, distance - guessed) : away,
        free = fmin(distance, fmax(least, sure));
        if (inside && distance > 0) free = fmax(free, f->height);
        if (!inside && f->kind == PANDIS_NETWORK)
            free = fmax(free, pandis__free_beyond(p, at, distance));
    }
    look->face = answer.face, look->region = answer.region;
    if (p->state->options.texture) pandis__roughen(p, at, &answer, &distance, &free, &sure);
    look->distance = distance - p->radius, look->free = free - p->radius;
    look->sure = fmin(sure, free) - p->radius;
    for (int k = 0; k < 3; k++) {
        look->normal[k] = answer.normal[k];
        look->foot[k] = at[k] - look->distance * answer.normal[k];
    }
    return 1;
}

static void pandis__drop(pandis__proxy *p, int index) {
    for (int i = index; i + 1 < p->count; i++) p->plane[i] = p->plane[i + 1];
    p->count--;
}

/* Forget planes that the last look shows not to be the surface here. The surface bends away from a
 * plane if the new foot is behind it or, where both planes are nearly parallel, not in front of it;
 * a look from inside does not count, since from there this may hold in any corner. Planes through a
 * free place, planes with the same normal as the new one, and planes whose foot is too far away are
 * forgotten, too. */
static void pandis__forget(
    pandis__proxy *p, const pandis__plane *seen, int inside, const double *place, double height) {
    double stale = PANDIS__STALE * PANDIS__HOVER;
    for (int i = p->count - 1; i >= 0; i--) {
        const pandis__plane *old = p->plane + i;
        double off[3], between[3], cross[3];
        for (int k = 0; k < 3; k++)
            off[k] = old->foot[k] - place[k], between[k] = seen->foot[k] - old->foot[k];
        pandis__cross(old->normal, seen->normal, cross);
        double angle = sqrt(pandis__dot(cross, cross)), apart = sqrt(pandis__dot(between, between));
        int same = angle < fmax(1e-7, p->tolerance) && pandis__dot(old->normal, seen->normal) > 0;
        double ahead = pandis__dot(old->normal, between);
        int bent = angle < 0.1 ? ahead <= 1e-3 * angle * apart : ahead < -p->blur;
        int open = height > p->tolerance && pandis__height(old, place) < height / 2;
        if (same || (bent && !inside) || open || pandis__dot(off, off) > stale * stale)
            pandis__drop(p, i);
    }
}

/* Add the plane of a look as the last one. If the proxy were at `place`, it would be at least
 * `height` above the surface. */
static void pandis__learn(
    pandis__proxy *p, const pandis__look *look, const double *place, double height) {
    pandis__plane seen;
    memcpy(seen.normal, look->normal, sizeof seen.normal);
    memcpy(seen.foot, look->foot, sizeof seen.foot);
    seen.offset = pandis__dot(seen.normal, seen.foot);
    /* two planes that face each other without a gap come from a fold in the surface: ignore the new
     * plane if the look was made less than the blur from it, else forget the old one */
    for (int i = p->count - 1; i >= 0; i--) {
        double gap = pandis__height(p->plane + i, seen.foot);
        if (pandis__dot(p->plane[i].normal, seen.normal) > -PANDIS__ALIKE || fabs(gap) > p->blur)
            continue;
        if (fabs(look->distance) < p->blur) return;
        pandis__drop(p, i);
    }
    pandis__forget(p, &seen, look->distance < -p->blur, place, height);
    if (p->count == PANDIS__PLANES) pandis__drop(p, 0);
    p->plane[p->count++] = seen;
    p->state->face = look->face;
    /* else the region is queried once per step */
    if (p->field->regions || !p->state->options.regions) p->state->region = look->region;
}

static double pandis__between(const double *a, const double *b) {
    double off[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(pandis__dot(off, off));
}

/* Find the point from which to check whether the proxy can be at a place: the nearest point that is
 * `lift` above all planes. If `nearest` is not NULL, the point is twice as high above planes that
 * are unlike it. Where planes meet at a sharp angle or face each other, no such point is near, so
 * the lift is reduced. */
static void pandis__lifted(
    const pandis__proxy *p, const double *place, const double *nearest, double lift, double *at) {
    pandis__plane raised[PANDIS__PLANES];
    double height = lift;
    memcpy(at, place, 3 * sizeof *at);
    if (p->count == 1) {
        double more = fmax(0, lift - fmax(0, pandis__height(p->plane, place)));
        for (int k = 0; k < 3; k++) at[k] += more * p->plane[0].normal[k];
        return;
    }
    for (int turn = 0; turn < 12; turn++) {
        double up[3], lacks = 0;
        for (int i = 0; i < p->count; i++) {
            const pandis__plane *plane = p->plane + i;
            int twice = nearest && pandis__dot(plane->normal, nearest) < PANDIS__ALIKE;
            raised[i] = *plane;
            raised[i].offset += (twice ? 2 : 1) * height + fmin(0, pandis__height(plane, place));
        }
        pandis__nearest_in_front(raised, p->count, place, up);
        for (int i = 0; i < p->count; i++) lacks = fmax(lacks, -pandis__height(raised + i, up));
        double far = pandis__between(up, place), most = PANDIS__FARTHEST * lift;
        if (lacks < 0.01 * height && far <= most * (1 + 1e-9)) {
            memcpy(at, up, sizeof up);
            return;
        }
        height *= lacks < 0.01 * height ? fmax(0.3, fmin(0.9, most / far)) : 0.7;
    }
}

static void pandis__take_ball(pandis__proxy *p, const pandis__look *look) {
    memcpy(p->ball, look->at, 3 * sizeof *p->ball);
    p->ball[3] = look->free, p->ball[4] = look->sure;
}

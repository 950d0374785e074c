/* -------------------- how a proxy hops to a target */

#define PANDIS__SMALL 1e-13 /* shorter motions count as 0 (unit frame) */
#define PANDIS__ABOVE 4e-6  /* largest height of the proxy above a plane that it touches */
#define PANDIS__GAP 5e-4    /* largest gap between ball and proxy in an edge or a corner */
#define PANDIS__ASIDE 1e-3  /* sideways offset of a second look, in lifts */
#define PANDIS__SLIVER 2e-4 /* length of a path that need not be known to be free */

/* Whether a look shows a wall that is nearer than all known planes. */
static int pandis__unknown(const pandis__proxy *p, const pandis__look *look) {
    double least = INFINITY;
    for (int i = 0; i < p->count; i++) least = fmin(least, pandis__height(p->plane + i, look->at));
    return p->count && look->distance < least - 0.1 * fabs(least) - p->blur;
}

/* Rebuild the chain of balls from the proxy upwards. Each ball overlaps the one below it, and the
 * lowest reaches the proxy to within a sliver. The chain ends at the lift, or where, in an
 * edge, a ball would miss the proxy by too much. Returns 0 if there was no answer, 2 if an unknown
 * wall was met, else 1. */
static int pandis__climb(pandis__proxy *p) {
    pandis__contact *c = p->state;
    double at[3], lift = fmin(PANDIS__SLIVER / PANDIS__FARTHEST, c->lift), reached = 0;
    for (int failed = 0; failed < 2 && p->queries < c->options.budget;) {
        pandis__look look;
        pandis__lifted(p, p->x, NULL, lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        if (p->flat && pandis__unknown(p, &look)) {
            pandis__learn(p, &look, p->x, 0);
            return 2;
        }
        double away = pandis__between(at, p->x);
        double gap =
            reached > 0 ? pandis__between(at, p->ball) - p->ball[3] : away - PANDIS__SLIVER;
        if (look.free > 0 && gap <= look.free * (1 + 1e-9) && away <= look.free + PANDIS__GAP) {
            pandis__take_ball(p, &look);
            if (lift >= c->lift) return 1;
            /* between planes through the proxy, overlapping balls grow by this factor */
            double sine = fmin(0.5, look.free / fmax(away, PANDIS__SMALL));
            reached = lift, lift *= 0.99 * (1 + sine) / (1 - sine);
        } else {
            if (!(reached > 0)) return 1;
            failed++, lift = sqrt(lift * reached);
        }
        lift = fmin(lift, c->lift);
    }
    if (reached > 0) c->lift = reached;
    return 1;
}

/* Find a larger ball above the proxy. 0: no answer. */
static int pandis__widen(pandis__proxy *p) {
    pandis__look look;
    double at[3];
    pandis__lifted(p, p->x, NULL, PANDIS__HOVER, at);
    if (!pandis__look_at(p, at, &look)) return 0;
    if (!(look.free > p->ball[3] && pandis__between(at, p->x) <= look.free + PANDIS__GAP))
        return pandis__climb(p);
    pandis__take_ball(p, &look);
    return 1;
}

/* Find a new ball. If the surface has moved past the proxy, the proxy is put back onto it. 0: no
 * answer. */
static int pandis__regain(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (look.distance < 0) memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    pandis__take_ball(p, &look);
    return pandis__widen(p);
}

/* The proxy's motion in a step. */
typedef struct {
    double travel;            /* largest distance along the surface */
    double sticking, sliding; /* friction coefficients */
    double soft;              /* share of the motion along the surface that drag leaves */
    double slip;              /* distance that friction and drag allow; negative until known */
    double shrink;            /* share of a hop that is tried */
    double slid, goal[3];     /* distance slid so far; goal without friction */
    int arriving;             /* the proxy is not yet on the planes */
    /* bit sets: planes that hold the proxy back, and planes with friction */
    int active, rubs;
    int held;    /* stopped by `travel` or the budget */
    int stuck;   /* no further motion was found */
    int turned;  /* number of times that another wall was in the way */
    int refused; /* number of times that a step would have led away from the probe */
    /* number of balls that did not join the last one, and of balls that did not reach the target */
    int lost, narrow;
    /* whether the chain of balls was rebuilt; number of further looks at distant planes */
    int climbed, confirmed;
} pandis__way;

/* Move the proxy to a place. */
static void pandis__arrive(pandis__proxy *p, pandis__way *way, const double *place) {
    double step = pandis__between(place, p->x);
    way->shrink = 1;
    if (step > 1e-3 * PANDIS__SLIVER) p->state->settled = 0;
    if (step > PANDIS__SLIVER) p->state->close = 0;
    if (way->active && !way->arriving)
        way->slip = fmax(0, way->slip - step), way->slid += step, way->travel -= step;
    memcpy(p->x, place, 3 * sizeof *place);
}

/* Move towards a target beyond the known free space: look from the rim of the ball, and move from
 * there as far as the new ball reaches. */
static int pandis__go_on(
    pandis__proxy *p, pandis__way *way, const double *at, const double *target) {
    pandis__look look;
    if (way->active && !way->arriving) { /* the proxy is on the surface, and stays there */
        way->held = way->stuck = 1;
        return 1;
    }
    double rim[3], place[3], far = pandis__between(at, p->ball),
                             share = fmin(1, 0.95 * p->ball[3] / far);
    for (int k = 0; k < 3; k++) rim[k] = p->ball[k] + share * (at[k] - p->ball[k]);
    if (!pandis__look_at(p, rim, &look)) return 0;
    if (look.free > 0) {
        double to = pandis__between(target, rim), within = to > look.free ? look.free / to : 1;
        for (int k = 0; k < 3; k++) place[k] = rim[k] + within * (target[k] - rim[k]);
        pandis__take_ball(p, &look);
        if (!p->exact) { /* a field steeper than a distance overstates the free space */
            pandis__look near;
            if (!pandis__look_at(p, place, &near)) return 0;
            if (near.distance < -PANDIS__SLIVER) {
                memcpy(place, rim, sizeof place);
                look = near;
            }
        }
        pandis__arrive(p, way, place);
    }
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Start over with the surface at the proxy. If the proxy has sunk in by less than a sliver, move it
 * out. 0: no answer. */
static int pandis__emerge(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (p->flat && look.distance < 0 && look.distance > -PANDIS__SLIVER)
        memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Look from above the target, and take the free ball there if it joins the last one. Returns 0 if
 * there was no answer, 1 if the hop ends here, 2 if it goes on. In the last case `height` becomes a
 * lower bound of the target's height. */
static int pandis__hop_over(
    pandis__proxy *p, pandis__way *way, const double *target, pandis__look *look, double *height) {
    pandis__contact *c = p->state;
    double at[3];
    pandis__lifted(p, target, NULL, c->lift, at);
    if (!pandis__look_at(p, at, look)) return 0;
    int joined =
        look->free > 0 && pandis__between(at, p->ball) <= (p->ball[3] + look->free) * (1 + 1e-9);
    /* the look shows an unknown wall, or one that was forgotten */
    if (!joined && way->active && (!p->flat || pandis__unknown(p, look)) && way->lost++ < 2) {
        /* the ball must be in front of the foot; else the foot is on a wall's other side */
        double before = 0;
        for (int k = 0; k < 3; k++) before += (p->ball[k] - look->foot[k]) * look->normal[k];
        if (before < 0.5 * p->ball[3] && !pandis__look_at(p, p->x, look)) return 0;
        pandis__learn(p, look, p->x, 0);
        return 1;
    }
    int reaches = pandis__between(p->ball, p->x) <= p->ball[3] + PANDIS__GAP;
    if (!joined && way->active && !(reaches && way->shrink > 0.02) && !way->climbed++) {
        int climbed = pandis__climb(p);
        way->climbed = climbed == 1, way->shrink = 1;
        return climbed > 0;
    }
    if (!joined && way->active)
        way->shrink *= 0.3, c->lift = fmax(0.7 * c->lift, PANDIS__HOVER / 64);
    if (!joined) return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, at, target);
    double gap = pandis__between(target, at) - look->free;
    /* another wall is near: next time look from lower down, between the walls */
    if (gap > (p->flat ? PANDIS__GAP : look->free) && way->narrow++ < 6) {
        c->lift = fmax(c->lift * fmin(0.9, fmax(0.4, PANDIS__GAP / gap)), PANDIS__HOVER / 64);
        pandis__learn(p, look, p->x, 0);
        return 1;
    }
    pandis__take_ball(p, look);
    *height = look->free - pandis__between(target, at);
    return 2;
}

/* Refuse a place that is farther from the probe than the proxy is. `learnt`: whether this hop found
 * a plane. 0: no answer. */
static int pandis__refuse(pandis__proxy *p, pandis__way *way, int learnt) {
    if (learnt && way->refused < 2) { /* another wall, which changes the goal */
        way->refused++;
        return 1;
    }
    /* the known planes are inconsistent: start over from the surface at the proxy */
    if (way->refused++ < 3) {
        if (!pandis__emerge(p)) return 0;
        p->state->close = 1;
        return 1;
    }
    way->shrink *= 0.25;
    if (way->shrink <= 1e-2) way->held = way->stuck = 1; /* the next step tries again */
    return 1;
}

/* Try to bring the proxy to a target. 0: there was no answer. */
static int pandis__hop(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    pandis__contact *c = p->state;
    pandis__look look, near;
    double place[3], step = pandis__between(target, p->x);
    double most = way->active ? way->shrink * fmax(1.9 * p->ball[3], 1e-3 * PANDIS__HOVER) : step;
    if (step > most)
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + most / step * (target[k] - p->x[k]);
    double over = pandis__between(target, p->ball) - p->ball[3], height = 0;
    int closely = !p->flat || c->close; /* look at the place itself, not from above */
    int looked = !closely || over > 0.25 * c->lift;
    if (looked) {
        int goes = pandis__hop_over(p, way, target, &look, &height);
        if (goes < 2) return goes;
    }
    if (!closely && height < -PANDIS__SLIVER) { /* in an edge: the ball does not reach into it */
        pandis__learn(p, &look, target, height);
        if (!pandis__look_at(p, target, &near)) return 0;
        height = near.distance;
        /* on the surface the normal may be an edge's or a fold's */
        if (fabs(height) > p->blur) look = near;
        /* the look shows nothing new: NaN marks it as not to be learnt */
        if (height > (p->flat ? -p->blur : -PANDIS__SLIVER)) look.at[0] = (double)NAN;
    }
    if (closely && height < PANDIS__HOVER) {
        if (!pandis__look_at(p, target, &near)) return 0;
        if (near.distance < -PANDIS__HOVER) { /* deeper than expected */
            way->shrink *= 0.3;
            return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, target, target);
        }
        if (near.free > p->ball[3]) pandis__take_ball(p, &near);
        height = near.distance;
        if (!p->flat || !looked || fabs(height) > p->blur) look = near;
    }
    int learnt = look.at[0] == look.at[0];
    if (learnt) pandis__learn(p, &look, target, height);
    pandis__nearest_in_front(p->plane, p->count, target, place);
    double now = pandis__between(p->x, probe);
    if (pandis__between(place, p->x) > PANDIS__SMALL && way->active &&
        pandis__between(place, probe) > now * (1 + 1e-9) + PANDIS__SMALL)
        return pandis__refuse(p, way, learnt);
    if (pandis__between(place, target) > PANDIS__SLIVER) { /* another wall: look there first */
        way->held = way->stuck = ++way->turned > 6;
        return 1;
    }
    pandis__arrive(p, way, place);
    return 1;
}

/* -------------------- how a proxy follows the probe */

#define PANDIS__SMALL 1e-13 /* shorter motions count as 0 (unit frame) */
#define PANDIS__ABOVE 4e-6  /* largest height of the proxy above a plane that it touches */
#define PANDIS__GAP 5e-4    /* largest gap between ball and proxy in an edge or a corner */
#define PANDIS__ASIDE 1e-3  /* lifts: sideways offset of a second look */
#define PANDIS__SLIVER 2e-4 /* length of a path that need not be known to be free */

/* Whether a look shows a wall that is nearer than all known planes. */
static int pandis__unknown(const pandis__proxy *p, const pandis__look *look) {
    double least = INFINITY;
    for (int i = 0; i < p->count; i++) least = fmin(least, pandis__height(p->plane + i, look->at));
    return p->count && look->distance < least - 0.1 * fabs(least) - p->blur;
}

/* Rebuild the chain of balls from the proxy upwards. Each ball overlaps the one below it, and the
 * lowest reaches the proxy to within a sliver. The chain ends at the lift, or where a ball would
 * miss the proxy in an edge by too much. 0: no answer; 2: an unknown wall was met. */
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
    /* number of balls that did not join the last one, and that did not reach the proxy's place */
    int lost, narrow;
    /* whether the chain of balls was rebuilt; number of further looks at distant planes */
    int climbed, confirmed;
} pandis__way;

/* Distance that friction and drag let the proxy move to a place `step` away, if it is pressed in by
 * `press`. */
static double pandis__rubbed(pandis__contact *c, pandis__way *way, double step, double press) {
    double friction = (c->sticks ? way->sticking : way->sliding) * press;
    if (way->slip < 0) { /* the first call in this step */
        c->sticks = friction > 0 && step <= friction;
        friction = way->sliding * press;
        way->slip = c->sticks               ? 0
            : friction > 0 || way->soft < 1 ? fmax(0, step - friction) * way->soft
                                            : 1e300;
    }
    return fmin(fmax(0, step - friction), way->slip);
}

/* Find the next target: the point in front of all planes that is nearest to the probe, as far as
 * friction lets the proxy go. Returns its distance. */
static double pandis__aim(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    way->active = pandis__nearest_in_front(p->plane, p->count, probe, way->goal);
    double wanted = pandis__between(way->goal, p->x), step = wanted;
    way->held = way->arriving = way->rubs = 0;
    double reach = 1; /* share of the path to the probe at which the first plane is met */
    for (int i = 0, touches = 0; i < p->count; i++) {
        double above = pandis__height(p->plane + i, p->x),
               below = -pandis__height(p->plane + i, probe);
        touches |= above <= PANDIS__ABOVE;
        way->arriving = way->active && !touches;
        if (below > 0 && above > 0) reach = fmin(reach, above / (above + below));
    }
    if (way->active && way->arriving) { /* no friction before the proxy has arrived */
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + reach * (probe[k] - p->x[k]);
        return pandis__between(target, p->x);
    }
    if (way->active) {
        pandis__plane touched[PANDIS__PLANES];
        double place[3];
        int count = 0, which[PANDIS__PLANES];
        for (int i = 0; i < p->count; i++)
            if (pandis__height(p->plane + i, p->x) <= PANDIS__ABOVE)
                which[count] = i, touched[count++] = p->plane[i];
        if (count < p->count) { /* only planes that the proxy touches cause friction */
            int rubs = pandis__nearest_in_front(touched, count, probe, place);
            for (int i = 0; i < count; i++) way->rubs |= (rubs >> i & 1) << which[i];
            double far = pandis__between(place, p->x),
                   free = pandis__rubbed(p->state, way, far, pandis__between(place, probe));
            step = fmin(step, free);
        } else {
            step = pandis__rubbed(p->state, way, step, pandis__between(way->goal, probe));
        }
        if (step > way->travel) step = way->travel, way->held = 1;
    }
    double share = wanted > 0 ? step / wanted : 0;
    for (int k = 0; k < 3; k++)
        target[k] = share < 1 ? p->x[k] + share * (way->goal[k] - p->x[k]) : way->goal[k];
    return step;
}

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

/* Move towards a place beyond the known free space: to the rim of the ball, from where the next
 * look is taken. */
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

/* Start over from the surface at the proxy, which is moved out if it has sunk in by less than a
 * sliver. 0: no answer. */
static int pandis__emerge(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (p->flat && look.distance < 0 && look.distance > -PANDIS__SLIVER)
        memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Move the proxy in front of the planes that it is behind by at most a sliver. Planes that it is
 * farther behind are dropped: the proxy is free, so they are beyond an edge. */
static void pandis__come_out(pandis__proxy *p) {
    double place[3], behind = 0;
    for (int i = p->count - 1; i >= 0; i--) {
        double height = pandis__height(p->plane + i, p->x);
        if (height < (p->flat ? -PANDIS__SLIVER : -2 * PANDIS__GAP)) pandis__drop(p, i);
        else behind = fmin(behind, height);
    }
    if (!p->flat || behind > -p->blur) return;
    pandis__nearest_in_front(p->plane, p->count, p->x, place);
    if (pandis__between(place, p->x) < PANDIS__FARTHEST * PANDIS__SLIVER)
        memcpy(p->x, place, sizeof place);
}

/* Try to bring the proxy to a target. 0: there was no answer. */
static int pandis__hop(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    pandis__contact *c = p->state;
    pandis__look look, near;
    double at[3], place[3], step = pandis__between(target, p->x);
    double most = way->active ? way->shrink * fmax(1.9 * p->ball[3], 1e-3 * PANDIS__HOVER) : step;
    if (step > most)
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + most / step * (target[k] - p->x[k]);
    double over = pandis__between(target, p->ball) - p->ball[3], height = 0;
    int closely = !p->flat || c->close; /* look at the place itself, not from above */
    int looked = !closely || over > 0.25 * c->lift;
    if (looked) {
        pandis__lifted(p, target, NULL, c->lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        int joined =
            look.free > 0 && pandis__between(at, p->ball) <= (p->ball[3] + look.free) * (1 + 1e-9);
        /* an unknown wall, or one forgotten since */
        if (!joined && way->active && (!p->flat || pandis__unknown(p, &look)) && way->lost++ < 2) {
            /* the ball must be in front of the foot: else that is a wall's other side */
            double before = 0;
            for (int k = 0; k < 3; k++) before += (p->ball[k] - look.foot[k]) * look.normal[k];
            if (before < 0.5 * p->ball[3] && !pandis__look_at(p, p->x, &look)) return 0;
            pandis__learn(p, &look, p->x, 0);
            return 1;
        }
        int reaches = pandis__between(p->ball, p->x) <= p->ball[3] + PANDIS__GAP;
        if (!joined && way->active && !(reaches && way->shrink > 0.02) && !way->climbed++) {
            int climbed = pandis__climb(p);
            way->climbed = climbed == 1, way->shrink = 1;
            return climbed;
        }
        if (!joined && way->active)
            way->shrink *= 0.3, c->lift = fmax(0.7 * c->lift, PANDIS__HOVER / 64);
        if (!joined)
            return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, at, target);
        double gap = pandis__between(target, at) - look.free;
        /* another wall: look from lower, between them */
        if (gap > (p->flat ? PANDIS__GAP : look.free) && way->narrow++ < 6) {
            c->lift = fmax(c->lift * fmin(0.9, fmax(0.4, PANDIS__GAP / gap)), PANDIS__HOVER / 64);
            pandis__learn(p, &look, p->x, 0);
            return 1;
        }
        pandis__take_ball(p, &look);
        height = look.free - pandis__between(target, at); /* lower bound for the target */
    }
    if (!closely && height < -PANDIS__SLIVER) { /* in an edge: the ball does not reach into it */
        pandis__learn(p, &look, target, height);
        if (!pandis__look_at(p, target, &near)) return 0;
        height = near.distance;
        /* on the surface the normal may be an edge's or a fold's */
        if (fabs(height) > p->blur) look = near;
        /* nothing new */
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
    if (look.at[0] == look.at[0]) pandis__learn(p, &look, target, height);
    pandis__nearest_in_front(p->plane, p->count, target, place);
    if (pandis__between(place, p->x) > PANDIS__SMALL && way->active &&
        pandis__between(place, probe) > pandis__between(p->x, probe) * (1 + 1e-9) + PANDIS__SMALL) {
        /* another wall, which changes the goal */
        if (look.at[0] == look.at[0] && way->refused < 2) {
            way->refused++;
            return 1;
        }
        /* the known planes are inconsistent: start over from the surface at the proxy */
        if (way->refused++ < 3) {
            if (!pandis__emerge(p)) return 0;
            c->close = 1;
            return 1;
        }
        way->shrink *= 0.25;
        if (way->shrink > 1e-2) return 1;
        way->held = way->stuck = 1; /* the next step tries again */
        return 1;
    }
    if (pandis__between(place, target) > PANDIS__SLIVER) { /* another wall: look there first */
        way->held = way->stuck = ++way->turned > 6;
        return 1;
    }
    pandis__arrive(p, way, place);
    return 1;
}

/* Look again at a plane, from where it is nearer than the other planes that hold the proxy. Returns
 * whether it changed, -1 if there was no answer. `height` becomes a lower bound of the proxy's
 * height, if there is one. */
static int pandis__look_again(
    pandis__proxy *p, const pandis__plane *plane, double lift, double *height) {
    const pandis__plane held = *plane;
    pandis__look look;
    double at[3], cross[3];
    pandis__lifted(p, p->x, held.normal, lift, at);
    /* a little aside: on a ridge between faces every plane through it would confirm itself */
    if (p->field->kind != PANDIS_SHAPE && p->flat)
        for (int k = 0; k < 3; k++)
            at[k] += PANDIS__ASIDE * lift * (held.normal[(k + 1) % 3] - held.normal[(k + 2) % 3]);
    if (!pandis__look_at(p, at, &look)) return -1;
    pandis__cross(look.normal, held.normal, cross);
    for (int j = 0; j < p->count; j++)
        if (!memcmp(p->plane + j, &held, sizeof held)) pandis__drop(p, j--);
    *height = p->flat ? look.free - pandis__between(at, p->x) : 0;
    pandis__learn(p, &look, p->x, *height);
    return pandis__dot(cross, cross) > 1e-18 || *height > p->tolerance;
}

/* Look again at planes that hold the proxy. If it rests, look at all of them: on a curved surface
 * an old one may no longer apply. Also check whether it has sunk into an unknown wall. If it moves,
 * look only at those seen from far. Returns how many changed, -1 if there was no answer. */
static int pandis__confirm(pandis__proxy *p, const pandis__way *way, int rests) {
    pandis__plane held[PANDIS__PLANES];
    double height = -1, most = -1;
    int count = p->count, changed = 0;
    memcpy(held, p->plane, sizeof held);
    for (int i = 0; i < count; i++) {
        int distant = pandis__between(held[i].foot, p->x) > PANDIS__STALE * PANDIS__HOVER / 2;
        if (!((way->active | way->rubs) >> i & 1) || !(rests || distant)) continue;
        /* a moving proxy looks from half the lift, so that the new foot does not count as distant
         * again */
        int other = pandis__look_again(p, held + i, (rests ? 1 : 0.5) * p->state->lift, &height);
        if (other < 0) return -1;
        changed += rests ? other : 1, most = fmax(most, height);
    }
    if (rests && !changed && most < -p->blur) {
        pandis__look look;
        if (!pandis__look_at(p, p->x, &look)) return -1;
        if (look.distance < -p->blur) changed = 1, pandis__learn(p, &look, p->x, look.distance);
        else if (look.distance > fmax(p->blur, PANDIS__ABOVE)) {
            /* the proxy does not touch the planes that hold it */
            changed = 1, p->count = 0;
            pandis__learn(p, &look, p->x, 0);
        }
    }
    return changed;
}

/* Bring the proxy as near to the probe as it can come. Returns 0 if there was no answer. */
static int pandis__follow(pandis__proxy *p, pandis__way *way, const double *probe) {
    pandis__contact *c = p->state;
    double target[3];
    /* known to be free, whatever the planes indicate */
    if (pandis__between(probe, p->ball) < p->ball[4]) {
        memcpy(p->x, probe, 3 * sizeof *probe);
        return 1;
    }
    if (c->state == PANDIS__TOUCHES && p->ball[3] < c->lift / 16 && !pandis__widen(p)) return 0;
    /* queries after which a short remainder is left to the next step: more if the last steps made
     * no progress */
    const int soon = p->queries + 2 + 4 * c->stalled;
    const double before[3] = {p->x[0], p->x[1], p->x[2]};
    /* each turn queries the field or ends the step; the bound is a safeguard */
    for (int turn = 0; turn < 4 * c->options.budget; turn++) {
        pandis__come_out(p);
        double step = pandis__aim(p, way, probe, target);
        if (step <= PANDIS__SMALL) {
            if (!way->active || way->held || c->settled > 8 || p->queries + 3 > c->options.budget)
                return 1;
            c->stalled = 0;
            int changed = pandis__confirm(p, way, 1);
            if (changed < 0) return 0;
            c->settled = changed ? c->settled + 1 : 9;
            continue;
        }
        /* length of a hop, even in a groove */
        double small = fmin(PANDIS__HOVER / 8, 1.9 * p->ball[3]);
        if (p->queries >= c->options.budget ||
            (way->active && p->queries >= soon && step < small)) {
            way->held |= p->queries >= c->options.budget;
            c->stalled = pandis__between(p->x, before) > PANDIS__SMALL ? 0
                : c->stalled < 5                                       ? c->stalled + 1
                                                                       : 5;
            return 1;
        }
        int distant = way->active && !way->arriving && p->count > 1 && way->confirmed++ < 6
            ? pandis__confirm(p, way, 0)
            : 0;
        if (distant < 0) return 0;
        if (distant) continue;
        if (!pandis__hop(p, way, probe, target)) return 0;
        if (way->stuck) return 1;
    }
    way->held = 1;
    return 1;
}

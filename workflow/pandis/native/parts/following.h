/* ---------------------------------------------------------------- how a proxy follows the probe */

#define PANDIS__SMALL 1e-13  /* of the unit frame: no way at all */
#define PANDIS__ABOVE 4e-6   /* so high over a plane it is not yet there */
#define PANDIS__GAP 5e-4     /* between a ball and the place in an edge or a corner from which it is seen */
#define PANDIS__SLIVER 2e-4  /* so much of a way need not be known to be free */

/* Take a larger ball, above where the proxy is. 0: no answer. */
static int pandis__widen(pandis__proxy *p) {
    pandis__look look;
    double at[3];
    for (double lift = PANDIS__HOVER; p->ball[3] < lift / 4 && lift > PANDIS__LEAST_HOVER; lift /= 4) {
        pandis__lifted(p, p->x, lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        /* it reaches the proxy, or nearly so in a corner */
        if (look.free > p->ball[3] && pandis__between(at, p->x) <= 2 * look.free) pandis__take_ball(p, &look);
    }
    return 1;
}

/* Make the ball anew; puts the proxy onto the surface, where that has come over it. 0: no answer. */
static int pandis__regain(pandis__proxy *p) {
    pandis__look look;
    if (!pandis__look_at(p, p->x, &look)) return 0;
    if (look.distance < 0) memcpy(p->x, look.foot, sizeof look.foot);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    pandis__take_ball(p, &look);
    return pandis__widen(p);
}

/* Begin the chain of balls anew, from the proxy upwards: each overlaps with the one below it, and the lowest reaches the
 * proxy but for a sliver. It is looked from no higher than that chain reaches. 0: no answer. */
static int pandis__climb(pandis__proxy *p) {
    pandis_contact *c = p->state;
    double at[3], lift = PANDIS__SLIVER, reached = 0;
    for (double more = 3; lift <= PANDIS__HOVER && more > 1.2 && p->queries < c->budget;) {
        pandis__look look;
        pandis__lifted(p, p->x, lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        double gap = reached > 0 ? pandis__between(at, p->ball) - p->ball[3] : pandis__between(at, p->x) - PANDIS__SLIVER;
        if (look.free > 0 && gap <= look.free * (1 + 1e-9)) {
            pandis__take_ball(p, &look);
            reached = lift;
        } else if (reached > 0) {
            more = sqrt(more);
        } else {
            break;
        }
        lift = more * reached;
    }
    if (reached > 0) c->lift = reached;
    return 1;
}

/* How the proxy may go in a step. */
typedef struct {
    double travel;           /* along the surface, at most */
    double sticking, sliding; /* friction per force against the surface */
    double soft;             /* share of the way along it that drag leaves */
    double slip;             /* that friction and drag leave; below 0 until it is known */
    double shrink;           /* share of a hop that is tried */
    double slid, goal[3];    /* how far it has slid; where it would go without friction */
    int arriving;            /* it is not yet on the planes */
    int active, held, stuck, turned, refused, lost, narrow, climbed; /* planes that hold it back; whether `travel` or the budget does; no way on was found;
                              * how often another wall was in the way; how often a step
                              * would have led away from the probe; how often a ball did not join the last one, or did
                              * not reach the proxy's place */
} pandis__way;

/* How far the proxy may go along the surface towards a place `step` away, under a pressure. */
static double pandis__rubbed(pandis_contact *c, pandis__way *way, double step, double press) {
    double friction = (c->sticks ? way->sticking : way->sliding) * press;
    if (way->slip < 0) { /* the first look at it in this step */
        c->sticks = friction > 0 && step <= friction;
        friction = way->sliding * press;
        way->slip = c->sticks ? 0 : friction > 0 || way->soft < 1 ? fmax(0, step - friction) * way->soft : 1e300;
    }
    return fmin(fmax(0, step - friction), way->slip);
}

/* Where to go next towards the probe: the point in front of all planes that is nearest to it, as far as friction lets
 * the proxy go. Returns how far that is. */
static double pandis__aim(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    way->active = pandis__nearest_in_front(p->plane, p->count, probe, way->goal);
    double wanted = pandis__between(way->goal, p->x), step = wanted;
    way->held = way->arriving = 0;
    double reach = 1; /* share of the way to the probe at which the first plane is met */
    for (int i = 0, touches = 0; i < p->count; i++) {
        double above = pandis__height(p->plane + i, p->x), below = -pandis__height(p->plane + i, probe);
        touches |= above <= PANDIS__ABOVE;
        way->arriving = way->active && !touches;
        if (below > 0 && above > 0) reach = fmin(reach, above / (above + below));
    }
    if (way->active && way->arriving) { /* it does not rub before it has arrived */
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + reach * (probe[k] - p->x[k]);
        return pandis__between(target, p->x);
    }
    if (way->active) {
        step = pandis__rubbed(p->state, way, step, pandis__between(way->goal, probe));
        if (step > way->travel) step = way->travel, way->held = 1;
    }
    double share = wanted > 0 ? step / wanted : 0;
    for (int k = 0; k < 3; k++) target[k] = share < 1 ? p->x[k] + share * (way->goal[k] - p->x[k]) : way->goal[k];
    return step;
}

/* The proxy has gone somewhere. */
static void pandis__arrive(pandis__proxy *p, pandis__way *way, const double *place) {
    double step = pandis__between(place, p->x);
    way->shrink = 1;
    if (step > 1e-3 * PANDIS__SLIVER) p->state->settled = 0;
    if (step > PANDIS__SLIVER) p->state->close = 0;
    if (way->active && !way->arriving) way->slip = fmax(0, way->slip - step), way->slid += step, way->travel -= step;
    memcpy(p->x, place, 3 * sizeof *place);
}

/* Move towards a place that is beyond what is known to be free: to the rim of the ball, where it is looked at next. */
static int pandis__go_on(pandis__proxy *p, pandis__way *way, const double *at, const double *target) {
    pandis__look look;
    if (way->active && !way->arriving) { /* it lies on the surface, and stays there */
        way->held = way->stuck = 1;
        return 1;
    }
    double rim[3], place[3], far = pandis__between(at, p->ball), share = fmin(1, 0.95 * p->ball[3] / far);
    for (int k = 0; k < 3; k++) rim[k] = p->ball[k] + share * (at[k] - p->ball[k]);
    if (!pandis__look_at(p, rim, &look)) return 0;
    if (look.free > 0) {
        double to = pandis__between(target, rim), within = to > look.free ? look.free / to : 1;
        for (int k = 0; k < 3; k++) place[k] = rim[k] + within * (target[k] - rim[k]);
        pandis__take_ball(p, &look);
        pandis__arrive(p, way, place);
    }
    pandis__learn(p, &look, p->x, 0);
    return 1;
}

/* Try to bring the proxy to a target. 0: there was no answer. */
static int pandis__hop(pandis__proxy *p, pandis__way *way, const double *probe, double *target) {
    pandis_contact *c = p->state;
    pandis__look look;
    double at[3], place[3], step = pandis__between(target, p->x);
    double most = way->active ? way->shrink * fmax(1.6 * p->ball[3], 1e-3 * PANDIS__HOVER) : step;
    if (step > most)
        for (int k = 0; k < 3; k++) target[k] = p->x[k] + most / step * (target[k] - p->x[k]);
    double over = pandis__between(target, p->ball) - p->ball[3], height = 0;
    int closely = !p->flat || c->close; /* at the place itself, not from above */
    if (!closely || over > 0.25 * c->lift) {
        pandis__lifted(p, target, c->lift, at);
        if (!pandis__look_at(p, at, &look)) return 0;
        int joined = look.free > 0 && pandis__between(at, p->ball) <= (p->ball[3] + look.free) * (1 + 1e-9);
        if (!joined && way->active && way->lost++ < 2) { /* a wall that is not known, or not any more */
            double before = 0; /* the ball has to lie in front of it: else it is a wall's other side */
            for (int k = 0; k < 3; k++) before += (p->ball[k] - look.foot[k]) * look.normal[k];
            if (before < 0.5 * p->ball[3] && !pandis__look_at(p, p->x, &look)) return 0;
            pandis__learn(p, &look, p->x, 0);
            return 1;
        }
        if (!joined && way->active && !way->climbed++) return pandis__climb(p);
        if (!joined && way->active) way->shrink *= 0.3;
        if (!joined) return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, at, target);
        double gap = pandis__between(target, at) - look.free;
        if (gap > (closely ? look.free : PANDIS__GAP) && way->narrow++ < 6) { /* another wall is near: between them, and lower in the edge */
            if (gap < look.free) c->lift = fmax(c->lift * fmax(0.4, PANDIS__GAP / gap), PANDIS__HOVER / 64);
            pandis__learn(p, &look, p->x, 0);
            return 1;
        }
        if (look.free < 0.5 * c->lift) c->lift = fmax(look.free, PANDIS__HOVER / 64);
        pandis__take_ball(p, &look);
        height = look.free - pandis__between(target, at); /* of the target, at least */
    }
    if (!closely && height < -PANDIS__SLIVER) { /* in an edge: the ball does not reach into it */
        pandis__learn(p, &look, target, height);
        if (!pandis__look_at(p, target, &look)) return 0;
        height = look.distance;
        if (height > -PANDIS__SLIVER) look.at[0] = (double)NAN; /* nothing new */
    }
    if (closely && height < PANDIS__HOVER) {
        if (!pandis__look_at(p, target, &look)) return 0;
        if (look.distance < -PANDIS__HOVER) { /* not what was expected there */
            way->shrink *= 0.3;
            return way->active && way->shrink > 1e-3 ? 1 : pandis__go_on(p, way, target, target);
        }
        if (look.free > p->ball[3]) pandis__take_ball(p, &look);
        height = look.distance;
    }
    if (look.at[0] == look.at[0]) pandis__learn(p, &look, target, height);
    pandis__nearest_in_front(p->plane, p->count, target, place);
    if (pandis__between(place, p->x) > PANDIS__SMALL && way->active &&
        pandis__between(place, probe) > pandis__between(p->x, probe) * (1 + 1e-9) + PANDIS__SMALL) {
        if (!way->refused++) { /* what is known does not fit: begin with what the surface is where the proxy is */
            if (!pandis__look_at(p, p->x, &look)) return 0;
            p->count = 0;
            pandis__learn(p, &look, p->x, 0);
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

/* Which way to go from the proxy, so that a plane is nearer than the others beside the proxy: those rise twice as fast.
 * Returns 0 if there is no such way. */
static int pandis__towards(const pandis__proxy *p, const pandis__plane *plane, double *up) {
    memcpy(up, plane->normal, 3 * sizeof *up);
    for (int turn = 0; turn < 3 * PANDIS__PLANES; turn++) {
        double rise = pandis__dot(plane->normal, up), least = 1.5 * rise;
        const double *lowest = NULL;
        for (int j = 0; j < p->count; j++) {
            const double *normal = p->plane[j].normal;
            if (pandis__dot(normal, plane->normal) > PANDIS__ALIKE) continue;
            double other = pandis__dot(normal, up) + fmax(0, pandis__height(p->plane + j, p->x)) / p->state->lift;
            if (other < least) least = other, lowest = normal;
        }
        if (!lowest || !(rise > 0)) break;
        double more = 2 * rise - pandis__dot(lowest, up);
        for (int k = 0; k < 3; k++) up[k] += more * lowest[k];
    }
    return pandis__dot(plane->normal, up) > 0 && pandis__normalise(up);
}

/* Look once more at a plane, from where it is nearer than the other planes that hold the proxy. Returns whether it was
 * another, -1 if there was no answer. */
static int pandis__look_again(pandis__proxy *p, const pandis__plane *plane) {
    const pandis__plane held = *plane;
    pandis__look look;
    double at[3], up[3], cross[3];
    if (!pandis__towards(p, &held, up)) memcpy(up, held.normal, sizeof up);
    for (int k = 0; k < 3; k++) at[k] = p->x[k] + p->state->lift * up[k];
    if (!pandis__look_at(p, at, &look)) return -1;
    pandis__cross(look.normal, held.normal, cross);
    for (int j = 0; j < p->count; j++)
        if (!memcmp(p->plane + j, &held, sizeof held)) pandis__drop(p, j--);
    double height = p->flat ? look.free - p->state->lift : 0; /* of the proxy, at least */
    pandis__learn(p, &look, p->x, height);
    return pandis__dot(cross, cross) > 1e-18 || height > p->tolerance;
}

/* Look again at planes that hold the proxy: where it rests, at all of them, for on a curved surface an old one may be left
 * that is none here; on its way, at those seen from far. Returns how many were others, -1 if there was no answer. */
static int pandis__confirm(pandis__proxy *p, const pandis__way *way, int rests) {
    pandis__plane held[PANDIS__PLANES];
    int count = p->count, changed = 0;
    memcpy(held, p->plane, sizeof held);
    for (int i = 0; i < count; i++) {
        int distant = pandis__between(held[i].foot, p->x) > PANDIS__STALE * PANDIS__HOVER / 2;
        if (!(way->active >> i & 1) || !(rests || distant)) continue;
        int other = pandis__look_again(p, held + i);
        if (other < 0) return -1;
        changed += rests ? other : 1;
    }
    return changed;
}

/* Bring the proxy as near to the probe as it can come. Returns 0 if there was no answer. */
static int pandis__follow(pandis__proxy *p, pandis__way *way, const double *probe) {
    pandis_contact *c = p->state;
    double target[3];
    if (pandis__between(probe, p->ball) < p->ball[4]) { /* known to be free, whatever planes say */
        memcpy(p->x, probe, 3 * sizeof *probe);
        return 1;
    }
    if (c->state == PANDIS__TOUCHES && p->ball[3] < PANDIS__HOVER / 16 && !pandis__widen(p)) return 0;
    /* queries after which a small rest waits for the next step: more of them if the last steps came no further */
    const int soon = p->queries + 2 + 4 * c->stalled;
    const double before[3] = {p->x[0], p->x[1], p->x[2]};
    /* each turn asks the field, or ends the step; that none does neither is made sure of */
    for (int turn = 0; turn < 4 * c->budget; turn++) {
        double step = pandis__aim(p, way, probe, target);
        if (step <= PANDIS__SMALL) {
            if (!way->active || way->held || c->sticks || c->settled > 8 || p->queries + 3 > c->budget) return 1;
            c->stalled = 0;
            int changed = pandis__confirm(p, way, 1);
            if (changed < 0) return 0;
            c->settled = changed ? c->settled + 1 : 9;
            continue;
        }
        if (p->queries >= c->budget || (way->active && p->queries >= soon && step < PANDIS__HOVER / 8)) {
            way->held |= p->queries >= c->budget;
            c->stalled = pandis__between(p->x, before) > PANDIS__SMALL ? 0 : c->stalled < 5 ? c->stalled + 1 : 5;
            return 1;
        }
        int distant = way->active && !way->arriving && p->count > 1 ? pandis__confirm(p, way, 0) : 0;
        if (distant < 0) return 0;
        if (distant) continue;
        if (!pandis__hop(p, way, probe, target)) return 0;
        if (way->stuck) return 1;
    }
    way->held = 1;
    return 1;
}


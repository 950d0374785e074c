/* -------------------- how a proxy walks if hops make no progress
 *
 * Where an approximate surface is rounded, in grooves and corners, planes that were seen from
 * different places contradict each other, and no hop leads nearer to the probe. A walk uses none of
 * these planes. Each of its steps goes straight towards the probe, and then out of the surface
 * along planes that are determined for this step only. */

#define PANDIS__PACE 4.8e-3 /* a walk's longest step; its first is an eighth of that */
/* the longest step around an edge that the proxy may take in part, straight on */
#define PANDIS__CHORD 1.6e-3
/* at an edge the cosine between the normals at both ends of a step is less */
#define PANDIS__FLAT 0.98
/* a walk ends when its steps are below this share of the longest; each failure halves the step */
#define PANDIS__TIRED (1 / 1024.0)
/* a walk begins at this count: contact steps without progress add 2, others subtract 1 */
#define PANDIS__IDLE 16
/* a step makes no progress if it gains less than this share of the possible gain, */
#define PANDIS__GAIN 0.25
/* or, on exact surfaces, less than this, or does not come nearer to the probe */
#define PANDIS__GAIN_EXACT 1e-9
/* or, while the probe rests, moves the proxy by less than this share of what is allowed */
#define PANDIS__CREEP 0.01
#define PANDIS__NEAR (PANDIS__GAP / 2) /* lift from which a ball reaches the proxy */
#define PANDIS__AGAIN 64               /* contact steps after which a resting proxy tries again, */
/* or when the probe has moved by this share of its distance to the proxy */
#define PANDIS__MOVED 0.2
/* sine of the angle between pull and surface normal below which the proxy rests */
#define PANDIS__LEAN 0.05
#define PANDIS__SUNK 1e-6      /* a place counts as free if it is no deeper than this, */
#define PANDIS__SUNK_SHARE 0.1 /* and no deeper than this share of a step */

/* Find the free place nearest to a goal, at most `reach` away. Returns 1 if it is in `look`, 0 if
 * none was found, -1 if there was no answer. `slope` is the rate at which the distance grows along
 * the normal: less than 1 in a rounded corner, and perhaps negative in a cell of a trilinear field.
 * If the place found is farther outside than necessary, one more query tries to improve it. */
PANDIS__ONCE static int pandis__free_place(
    pandis__proxy *p, const double *goal, double reach, double *slope, pandis__look *look) {
    double at[3] = {goal[0], goal[1], goal[2]}, last[3] = {0}, before = 0;
    pandis__look high;
    int over = 0;
    const double sunk = fmin(PANDIS__SUNK, PANDIS__SUNK_SHARE * p->state->pace);
    *slope = fmax(0.1, *slope);
    for (p->count = 0; p->count < 5 && p->queries < p->state->options.budget &&
        pandis__between(at, goal) <= reach;) {
        if (!pandis__look_at(p, at, look)) return -1;
        if (look->distance >= -sunk &&
            (over || !p->count || look->distance <= *slope * 0.02 * reach))
            return 1;
        if (over) { /* not free: use the previous place */
            *look = high;
            return 1;
        }
        if (look->distance >= -sunk) over = 1, high = *look;
        pandis__plane *seen = p->plane + p->count;
        if (p->count && pandis__dot(seen[-1].normal, look->normal) > 0.9) {
            double risen = 0;
            for (int k = 0; k < 3; k++) risen += (at[k] - last[k]) * seen[-1].normal[k];
            double rate = risen != 0 ? (look->distance - before) / risen : *slope;
            *slope = rate > 0 ? fmax(0.1, fmin(1.2, rate)) : fmin(-0.1, fmax(-1.2, rate));
        }
        before = look->distance;
        for (int k = 0; k < 3; k++) {
            last[k] = at[k];
            seen->normal[k] = *slope > 0 ? look->normal[k] : -look->normal[k];
            seen->foot[k] = at[k] - look->distance / *slope * look->normal[k];
        }
        seen->offset = pandis__dot(seen->normal, seen->foot);
        if (over) seen[-1] = *seen, p->count--;
        pandis__nearest_in_front(p->plane, ++p->count, goal, at);
    }
    if (over) *look = high;
    return over;
}

/* Take a free ball above a place, at the lift over the planes that hold the proxy there. Returns 1
 * if the ball joins the last one or contains the proxy, and (with `reaches`) reaches the place;
 * else 0; -1: no answer. The balls must join, because an exact object may be thinner than a step:
 * the path to a free place need not be free. */
static int pandis__covers(pandis__proxy *p, const double *place, int reaches) {
    pandis__look look;
    double at[3];
    pandis__lifted(p, place, NULL, p->state->lift, at);
    if (!pandis__look_at(p, at, &look)) return -1;
    if (!(look.free > 0) || (reaches && pandis__between(at, place) > look.free + PANDIS__GAP))
        return 0;
    if (pandis__between(at, p->ball) > p->ball[3] + look.free &&
        pandis__between(at, p->x) >= look.free)
        return 0;
    pandis__take_ball(p, &look);
    return 1;
}

/* Take a free ball that reaches the proxy, whether or not it joins the last one: at the lift or, if
 * none is found there, nearer to the proxy and in front of all walls found. Returns 1, or 0 if none
 * was found, -1 if there was no answer. */
PANDIS__ONCE static int pandis__stand(pandis__proxy *p) {
    pandis__contact *c = p->state;
    for (int turn = 0; turn < 4 && p->queries < c->options.budget; turn++) {
        pandis__look look;
        double at[3];
        pandis__lifted(p, p->x, NULL, c->lift, at);
        if (!pandis__look_at(p, at, &look)) return -1;
        if (look.free > 0 && pandis__between(at, p->x) <= look.free + PANDIS__GAP) {
            pandis__take_ball(p, &look);
            return 1;
        }
        c->lift = PANDIS__NEAR;
        if (!(look.free > 0)) pandis__learn(p, &look, p->x, 0);
    }
    return 0;
}

/* A step that a walk could take. */
typedef struct {
    double left;          /* distance from the proxy to the probe */
    double pace, length;  /* length as planned, and as found */
    double along, nearer; /* by how much it leads towards the probe, and comes nearer to it */
    double friction;      /* what `along` must exceed */
} pandis__stride;

static void pandis__measure_stride(const pandis__proxy *p, const pandis__way *way,
    const double *probe, const double *place, pandis__stride *s) {
    s->length = pandis__between(place, p->x), s->along = 0;
    s->nearer = s->left - pandis__between(place, probe);
    for (int k = 0; k < 3; k++) s->along += (place[k] - p->x[k]) * (probe[k] - p->x[k]);
    s->along /= fmax(s->length, PANDIS__SMALL);
    s->friction = (p->state->sticks ? way->sticking : way->sliding) *
        sqrt(fmax(0, s->left * s->left - s->along * s->along));
    if (!p->count) s->friction = 0;
}

static int pandis__approaches(const pandis__stride *s) {
    return s->length <= 3 * s->pace && s->along > fmax(s->friction, PANDIS__LEAN * s->left) &&
        s->nearer > 1e-3 * s->pace;
}

/* Whether a place lies behind the surface, whose normal was `side`, and has the opposite normal:
 * then it is on the other side of a thin wall. */
static int pandis__pierces(
    const pandis__proxy *p, const pandis__look *look, const double *side, double length) {
    double behind = 0;
    for (int k = 0; k < 3; k++) behind -= (look->at[k] - p->x[k]) * side[k];
    return behind > 0.1 * length && pandis__dot(side, look->normal) < -0.5;
}

/* Whether a step leads around an edge, and is so long that a part of it may be inside. */
static int pandis__rounds_edge(const pandis__stride *s, const double *side, const double *normal) {
    return s->pace > PANDIS__CHORD && s->length > PANDIS__CHORD &&
        pandis__dot(side, normal) < PANDIS__FLAT;
}

/* Set the lift so that new balls join the last one; if that ball does not reach the proxy, take one
 * that does. Returns what pandis__stand returns. */
static int pandis__lower(pandis__proxy *p) {
    pandis__contact *c = p->state;
    double far = pandis__between(p->ball, p->x), least = fmax(far / PANDIS__FARTHEST, PANDIS__NEAR);
    c->lift = fmin(PANDIS__HOVER, fmax(fmin(c->lift, far), least));
    return far > p->ball[3] + PANDIS__GAP ? pandis__stand(p) : 1;
}

/* Move the proxy by a share of the way to a place. */
static void pandis__take_step(pandis__proxy *p, const pandis__look *look, double share) {
    pandis__contact *c = p->state;
    for (int k = 0; k < 3; k++) p->x[k] += share * (look->at[k] - p->x[k]);
    c->settled = c->close = c->sticks = 0;
    if (p->exact) return;
    /* an empty ball on the surface makes the next step look from above */
    pandis__take_ball(p, look);
    memcpy(p->ball, p->x, 3 * sizeof *p->ball);
    if (p->count || !(look->free > 0)) p->ball[3] = PANDIS__SMALL, p->ball[4] = -1;
}

/* Walk towards the probe, with all but one query of the budget. 0: no answer. */
PANDIS__ONCE static int pandis__walk_on(pandis__proxy *p, pandis__way *way, const double *probe) {
    pandis__contact *c = p->state;
    pandis__plane known[PANDIS__PLANES];
    pandis__look look;
    pandis__stride s;
    double goal[3], slip = -1, clear = 0, slope = 1, side[3] = {0};
    const int most = c->options.budget - 1; /* one query is left for the hops */
    /* the first step leads out of the surface, if the proxy has sunk in */
    int first = !p->exact, anew = 0, good = p->exact ? pandis__lower(p) : 1;
    if (good < 1) return good + 1;
    for (; c->pace > PANDIS__TIRED * PANDIS__PACE && p->queries + 2 <= most; first = 0) {
        s.left = pandis__between(probe, p->x);
        if (s.left <= PANDIS__SMALL) break;
        s.pace = first ? 0 : fmin(fmax(c->pace, clear), s.left);
        for (int k = 0; k < 3; k++) goal[k] = p->x[k] + s.pace / s.left * (probe[k] - p->x[k]);
        const int count = p->count;
        memcpy(known, p->plane, sizeof known);
        good = pandis__free_place(p, goal, first ? PANDIS__PACE : 3 * s.pace, &slope, &look);
        if (good < 0) return 0;
        pandis__measure_stride(p, way, probe, look.at, &s);
        if (good) good = first ? p->count > 0 : pandis__approaches(&s);
        if (good && s.pace > clear && pandis__pierces(p, &look, side, s.length)) good = 0;
        int apart =
            0; /* no ball there joins the last one, but the proxy is in front of the walls */
        if (good && p->exact) {
            int reaches = s.length > PANDIS__SLIVER;
            good = p->queries < c->options.budget ? pandis__covers(p, look.at, reaches) : 0;
            if (good < 0) return 0;
            apart = !good && !anew;
            for (int i = 0; i < p->count; i++)
                apart = apart && pandis__height(p->plane + i, p->x) > -PANDIS__ABOVE;
        }
        double share = 1, slips = slip;
        if (slip < 0) slips = way->soft < 1 ? way->soft * (s.along - s.friction) : 1e300;
        if (p->count && !first) share = fmax(0, fmin(1, fmin(slips, way->travel) / s.length));
        int cuts = share < 1 && pandis__rounds_edge(&s, side, look.normal);
        if (good || first) memcpy(side, look.normal, sizeof side);
        if (!good || cuts) {
            /* balls above the proxy and above the place join if they are over the same planes */
            if (apart && p->queries < most) {
                c->lift = PANDIS__NEAR, anew = 1;
                if (pandis__stand(p) < 0) return 0;
            }
            p->count = count;
            memcpy(p->plane, known, sizeof known);
            if (!first) c->pace = good ? fmax(PANDIS__CHORD, 0.9 * share * s.pace) : c->pace / 2;
            slope = 1, clear = 0;
            continue;
        }
        double moved = share * s.length;
        if (p->count && !first) slip = slips - moved, way->travel -= moved, way->slid += moved;
        clear = p->count ? 0 : look.free;
        pandis__take_step(p, &look, share);
        if (first) continue;
        c->pace = fmin(1.5 * c->pace, PANDIS__PACE);
        if (p->exact) c->idle = PANDIS__IDLE - 2; /* hops are faster, if they advance from here */
        if (share < 1) break;
    }
    return 1;
}

/* Walk, if the proxy is not at rest. 0: no answer. */
PANDIS__ONCE static int pandis__try_walk(
    pandis__proxy *p, pandis__way *way, const double *probe, double moved) {
    pandis__contact *c = p->state;
    c->rested += 1.0 / PANDIS__AGAIN +
        moved / fmax(PANDIS__MOVED * pandis__between(probe, p->x), PANDIS__SMALL);
    if (c->rested > 1) c->rested = 0, c->pace = fmax(c->pace, PANDIS__PACE / 8);
    return pandis__walk_on(p, way, probe);
}

/* Go back to a place that was nearer to the probe, if it lies outside. Hops along planes that
 * contradict each other led away from it; without the way back, the proxy could circle for ever.
 * 0: no answer. */
PANDIS__ONCE static int pandis__go_back(pandis__proxy *p, const double *place, const double *ball) {
    pandis__look look;
    if (!pandis__look_at(p, place, &look)) return 0;
    /* the old place is inside: the hops led the proxy out of the surface */
    if (look.distance < -fmax(PANDIS__SUNK, p->blur)) return 1;
    memcpy(p->x, place, 3 * sizeof *place);
    memcpy(p->ball, ball, 5 * sizeof *ball);
    p->count = 0;
    pandis__learn(p, &look, p->x, 0);
    /* planes that are seen from nearer fit a round surface better */
    p->state->lift = fmax(p->state->lift / 4, PANDIS__HOVER / 64);
    return 1;
}

/* Bring the proxy as near to the probe as it can: by hops, or by a walk if hops make no progress.
 * `moved`: how far the probe moved. 0: no answer. */
static int pandis__come(pandis__proxy *p, pandis__way *way, const double *probe, double moved) {
    pandis__contact *c = p->state;
    const double creep = PANDIS__CREEP * way->travel,
                 least = p->exact ? PANDIS__GAIN_EXACT : PANDIS__GAIN * way->travel;
    if (c->idle < PANDIS__IDLE) c->rested = 1;
    /* the short steps of a walk cannot keep up with a probe that is faster than the proxy may be */
    else if (moved < 0.5 * way->travel && !pandis__try_walk(p, way, probe, moved)) return 0;
    const double before[3] = {p->x[0], p->x[1], p->x[2]};
    double ball[5];
    memcpy(ball, p->ball, sizeof ball);
    if (!pandis__follow(p, way, probe)) return 0;
    double gone = 0, apart = 0, left = 0; /* all of them squared */
    for (int k = 0; k < 3; k++) {
        gone += (p->x[k] - before[k]) * (p->x[k] - before[k]);
        apart += (probe[k] - before[k]) * (probe[k] - before[k]);
        left += (probe[k] - p->x[k]) * (probe[k] - p->x[k]);
    }
    int creeps = p->exact && moved * moved < gone && gone < creep * creep;
    int nowhere =
        left > PANDIS__SMALL * PANDIS__SMALL && (gone < least * least || creeps || apart <= left);
    if (apart < (1 - 1e-9) * left && p->queries <= c->options.budget + 1 &&
        !pandis__go_back(p, before, ball))
        return 0;
    c->idle += nowhere ? 2 * (c->idle < PANDIS__IDLE) : -(c->idle > 0);
    return 1;
}

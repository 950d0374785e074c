/* -------------------- how a proxy follows the probe */

/* Distance by which friction and drag let the proxy move towards a place `step` away, if the proxy
 * is pressed in by `press`. */
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

/* Find the next target on the way to the point in front of all planes that is nearest to the probe:
 * as far along as friction lets the proxy go. Returns the target's distance from the proxy. */
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

/* If the proxy is behind planes by at most a sliver, move it in front of them. Planes that it is
 * farther behind are dropped: the proxy is in free space, so these planes must be beyond an edge.
 */
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

/* Look again at a plane, from a point that is nearer to it than to the other planes that hold the
 * proxy. Returns whether the plane changed, or -1 if there was no answer. `height` becomes a lower
 * bound of the proxy's height above the surface, or 0 if none is known. */
static int pandis__look_again(
    pandis__proxy *p, const pandis__plane *plane, double lift, double *height) {
    const pandis__plane held = *plane;
    pandis__look look;
    double at[3], cross[3];
    pandis__lifted(p, p->x, held.normal, lift, at);
    /* a little aside: right above a ridge, every plane through the ridge would confirm itself */
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

/* Look again at planes that hold the proxy. If the proxy rests, look at all of them, since on a
 * curved surface an old plane may no longer apply, and check whether the proxy has sunk into an
 * unknown wall. If it moves, look only at planes whose foot is distant. Returns how many planes
 * changed, or -1 if there was no answer. */
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
    /* the probe is in known free space, whatever the planes indicate */
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
        /* a hop can be this long, even in a groove */
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

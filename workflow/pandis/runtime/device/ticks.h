/* The ticks of a run: the device is read, the scene is queried, and the force, after passing the
 * guard, is sent. Part of client.c. */
#ifndef TICKS_H
#define TICKS_H

/* Whether the run is in real time: in simulated time nothing is late. */
static int client_real(void) { return client.device.next == NULL; }

/* Read the device's errors; the first one ends the run. */
static void client_errors(void) {
    for (int k = 0; k < 16; k++) {
        unsigned int code = client.device.error(&client.device);
        if (!code) return;
        if (!client.guard.cause) client.code = code;
        guard_end(&client.guard, CAUSE_ERROR);
    }
}

/* The scene's force at a position of the device, and the proxy if the scene has contacts. */
static void client_ask(const double *position, double *force, double *proxy) {
    pandis_scene *scene = client.order.scene;
    pandis_touch touch;
    double place[3];
    pandis_flag flag;
    int contacts = pandis__scene_in(scene)->contacts != NULL;
    bridge *b = client.order.bridge;
    double dt = client.order.period * client.order.held; /* until the next force */
    for (int k = 0; k < 3; k++) place[k] = position[k] - client.middle[k];
    if (b) bridge_move(b, scene, dt);
    client.touched = 0;
    if (b)
        flag = pandis_scene_touch(scene, place, dt, force, b->touches, b->count, &client.touched),
        touch = *b->touches;
    else if (contacts)
        flag = pandis_scene_touch(scene, place, dt, force, &touch, 1, &client.touched);
    else flag = pandis_scene_force(scene, place, force);
    if (flag == PANDIS_INVALID) guard_end(&client.guard, CAUSE_NUMBER);
    for (int k = 0; client.touched && k < 3; k++) proxy[k] = touch.proxy[k] + client.middle[k];
}

/* Send a force. If this causes an error, there may be no other tick: switch the motors off now. */
static void client_write(double *force) {
    guard *g = &client.guard;
    client.device.write(&client.device, force, NULL);
    client_errors();
    if (g->cause && length_of(force) > 0) {
        client.device.output(&client.device, 0);
        force[0] = force[1] = force[2] = 0;
        memcpy(g->sent, force, 3 * sizeof *force);
    }
}

static void client_record(
    long long tick, const double *position, const double *force, const double *proxy) {
    const client_order *order = &client.order;
    for (int k = 0; k < 3; k++) {
        order->positions[3 * tick + k] = position[k];
        order->forces[3 * tick + k] = force[k];
        order->proxies[3 * tick + k] = proxy[k];
    }
}

/* One tick, called by the thread that drives the time. Returns 0 after the last one. */
static int client_tick(void *data) {
    const client_order *order = &client.order;
    guard *g = &client.guard;
    double begin = client_now(), force[3] = {0};
    device_state state;
    long long tick = client.beat;
    (void)data;
    client_ticking = pthread_self();
    __atomic_store_n(&client.inside, 1, __ATOMIC_SEQ_CST);
    /* the device has been released */
    if (__atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG) {
        __atomic_store_n(&client.inside, 0, __ATOMIC_SEQ_CST);
        return 0;
    }
    double since = tick && client_real() ? begin - client.last : order->period;
    client.device.read(&client.device, &state);
    client_errors();
    int look = order->armed && (!g->armed || tick % GUARD_CHECK == 0);
    guard_watch(g, &state, !look || client.device.calibrated(&client.device) == DEVICE_CALIBRATED);
    int cancelled = __atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST);
    if (cancelled) guard_end(g, cancelled);
    if (client_real() && since > order->gap) guard_end(g, CAUSE_GAP);
    double proxy[3];
    memcpy(proxy, state.position, sizeof proxy);
    int asks = !g->cause && tick < order->ticks;
    if (asks && order->between && tick % order->every == 0 && order->between())
        guard_end(g, CAUSE_INTERRUPTED), asks = 0;
    int due = asks && tick % order->held == 0;
    if (due) client_ask(state.position, client.asked, proxy);
    if (asks) memcpy(force, client.asked, sizeof force);
    double taken = client_now() - begin;
    client.overruns = client_real() && taken > order->deadline ? client.overruns + 1 : 0;
    if (client_real() && client.overruns >= order->overruns) guard_end(g, CAUSE_OVERRUN);
    if (client_real() && taken > order->gap) guard_end(g, CAUSE_GAP);
    /* after the last tick no field is queried; its zero force must not arm the guard */
    double asked[3], size = pandis__dot(force, force);
    memcpy(asked, force, sizeof asked);
    for (int k = 0; k < 3; k++)
        g->carried[k] = order->bridge && due ? order->bridge->carried[k] : 0;
    guard_pass(g, &state, since, order->armed && (tick < order->ticks || g->armed), force);
    if (order->bridge && asks) {
        /* the share of the force that the guard has let through */
        double share = size > 0 ? pandis__dot(asked, force) / size : 0;
        bridge_give(order->bridge, client.touched, fmin(fmax(share, 0), 1), order->period);
    }
    client_write(force);
    if (tick < order->ticks) {
        client_record(tick, state.position, force, proxy);
        order->taken[tick] = taken, order->since[tick] = since;
    }
    client.last = begin;
    __atomic_store_n(&client.beat, tick + 1, __ATOMIC_SEQ_CST);
    if (order->pulse) __atomic_store_n(&order->pulse->beat, tick + 1, __ATOMIC_SEQ_CST);
    /* the motors hold the last force, so every run ends with zero */
    if (g->cause || (tick >= order->ticks && !(length_of(force) > 0))) client.released++;
    int finished = client.released >= RELEASE;
    __atomic_store_n(&client.inside, 0, __ATOMIC_SEQ_CST);
    if (finished) __atomic_store_n(&client.finished, 1, __ATOMIC_SEQ_CST);
    return !finished;
}

/* Drive a pull device by the client's clock. */
static void *client_pull(void *none) {
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (client_tick(NULL)) {
        due.tv_nsec += (long)(1e9 * client.order.period + 0.5);
        if (due.tv_nsec >= 1000000000) due.tv_nsec -= 1000000000, due.tv_sec++;
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now); /* do not catch up after a late tick */
        if (now.tv_sec > due.tv_sec || (now.tv_sec == due.tv_sec && now.tv_nsec > due.tv_nsec))
            due = now;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
    return none;
}

/* Wait until the run is over. End it if no call comes, a call does not return, or a
 * signal arrives. */
static void client_wait(void) {
    const struct timespec look = {0, LOOK};
    long long seen = -1;
    double since = client_now();
    while (!__atomic_load_n(&client.finished, __ATOMIC_SEQ_CST)) {
        if (!client_real()) {
            if (client_tick(NULL)) client.device.next(&client.device);
            continue;
        }
        nanosleep(&look, NULL);
        if (client_signal) __atomic_store_n(&client.cancelled, CAUSE_INTERRUPTED, __ATOMIC_SEQ_CST);
        long long beat = __atomic_load_n(&client.beat, __ATOMIC_SEQ_CST);
        if (beat != seen) seen = beat, since = client_now();
        if (client_now() - since < client.order.patience) continue;
        __atomic_store_n(&client.cancelled, CAUSE_WATCHDOG, __ATOMIC_SEQ_CST);
        return;
    }
}

#endif

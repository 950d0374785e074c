/* Functions for bindings in other languages: bridges, causes in words, and memory layouts of
 * structures. */
#ifndef BINDING_H
#define BINDING_H

#define CLIENT_CAUSE(name, words) {#name, words},
static const struct {
    const char *name, *words;
} client_causes[] = {GUARD_CAUSES(CLIENT_CAUSE)};

/* Name and meaning of a cause; NULL beyond the last one. */
const char *client_cause_name(int cause) {
    return cause >= 0 && cause < CAUSES ? client_causes[cause].name : NULL;
}

const char *client_cause_words(int cause) {
    return cause >= 0 && cause < CAUSES ? client_causes[cause].words : NULL;
}

static const layout_entry client_entries[] = {
    LAYOUT_TYPE(guard_limits),
    LAYOUT(guard_limits, force),
    LAYOUT(guard_limits, continuous),
    LAYOUT(guard_limits, step),
    LAYOUT(guard_limits, impulse),
    LAYOUT(guard_limits, speed),
    LAYOUT(guard_limits, ramp),
    LAYOUT(guard_limits, damping),
    LAYOUT(guard_limits, encoder),
    LAYOUT(guard_limits, stiffness),
    LAYOUT(guard_limits, most_damping),
    LAYOUT(guard_limits, needs),
    LAYOUT_TYPE(device_spec),
    LAYOUT(device_spec, model),
    LAYOUT(device_spec, force),
    LAYOUT(device_spec, continuous),
    LAYOUT(device_spec, speed),
    LAYOUT(device_spec, impulse),
    LAYOUT(device_spec, rate),
    LAYOUT(device_spec, low),
    LAYOUT(device_spec, high),
    LAYOUT(device_spec, has_switch),
    LAYOUT_TYPE(simulated_spec),
    LAYOUT(simulated_spec, mass),
    LAYOUT(simulated_spec, damping),
    LAYOUT(simulated_spec, friction),
    LAYOUT(simulated_spec, encoder),
    LAYOUT(simulated_spec, force),
    LAYOUT(simulated_spec, impulse),
    LAYOUT(simulated_spec, speed),
    LAYOUT(simulated_spec, hand_stiffness),
    LAYOUT(simulated_spec, hand_damping),
    LAYOUT(simulated_spec, period),
    LAYOUT(simulated_spec, wall),
    LAYOUT(simulated_spec, delay),
    LAYOUT_TYPE(client_order),
    LAYOUT(client_order, scene),
    LAYOUT(client_order, limits),
    LAYOUT(client_order, period),
    LAYOUT(client_order, deadline),
    LAYOUT(client_order, overruns),
    LAYOUT(client_order, gap),
    LAYOUT(client_order, patience),
    LAYOUT(client_order, expected),
    LAYOUT(client_order, armed),
    LAYOUT(client_order, ticks),
    LAYOUT(client_order, positions),
    LAYOUT(client_order, forces),
    LAYOUT(client_order, taken),
    LAYOUT(client_order, since),
    LAYOUT(client_order, proxies),
    LAYOUT(client_order, bridge),
    LAYOUT(client_order, between),
    LAYOUT(client_order, every),
    LAYOUT(client_order, held),
    LAYOUT(client_order, watch),
    LAYOUT(client_order, pulse),
    LAYOUT_TYPE(client_outcome),
    LAYOUT(client_outcome, cause),
    LAYOUT(client_outcome, code),
    LAYOUT(client_outcome, stand_in),
    LAYOUT(client_outcome, simulated),
    LAYOUT(client_outcome, hangs),
    LAYOUT(client_outcome, watched),
    LAYOUT(client_outcome, ticks),
    LAYOUT(client_outcome, worst),
    LAYOUT(client_outcome, strongest),
    LAYOUT(client_outcome, steepest),
    LAYOUT(client_outcome, fastest),
    LAYOUT(client_outcome, added),
    LAYOUT(client_outcome, cut),
    LAYOUT(client_outcome, slowed),
    LAYOUT(client_outcome, damped),
    LAYOUT(client_outcome, armed_at),
    LAYOUT(client_outcome, signs),
    LAYOUT(client_outcome, spec),
    LAYOUT(client_outcome, limits),
    LAYOUT(client_outcome, why),
    LAYOUT_END,
};

/* Return the memory layout of the structures that a binding in another language mirrors. */
const layout_entry *client_layout(void) { return client_entries; }

/* For programs that create a bridge in their own memory: the size of a bridge, and the number of
 * doubles of room that it needs. */
size_t bridge_bytes(void) { return sizeof(bridge); }

size_t bridge_room(size_t count) { return bridge_doubles(count); }

void bridge_open(bridge *b, pandis_poses *poses, size_t count, double *room) {
    bridge_begin(b, poses, count, room);
}

void bridge_take(bridge *b, double *sums) { bridge_read(b, sums); }

/* The impulse that was dropped because the simulation was late, N s. */
void bridge_dropped(const bridge *b, double *impulse) {
    memcpy(impulse, b->dropped, sizeof b->dropped);
}

/* Where to write the data of the frame of poses that is handed over next: a `bridge_frame` for each
 * object. */
double *bridge_next(const bridge *b) {
    return (double *)(void *)(b->frames + (size_t)b->poses->writing * b->count);
}

#endif

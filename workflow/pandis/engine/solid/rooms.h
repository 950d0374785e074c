/* Rooms, and the doors between them: a part of solid.c.
 *
 * A room is a set of nodes that are joined by edges which no triangle and no cap cuts. A door is a
 * narrow place between open edges: two rooms that meet only there stay apart. */

#define LEAST_ROOM 1.5f /* cells: the largest ball of a room that a door can close off */
#define BINS_PER_CELL 16

static int32_t root_of(const Lattice *l, int32_t room) {
    while (l->parent[room] != room) {
        l->parent[room] = l->parent[l->parent[room]];
        room = l->parent[room];
    }
    return room;
}

static void unite(Lattice *l, int32_t one, int32_t other) {
    one = root_of(l, one), other = root_of(l, other);
    if (one < other) /* so that the outside, 0, stays a root */
        l->parent[other] = one;
    else l->parent[one] = other;
}

/* Add a room; returns its index, or -1 if memory is short. */
static int32_t add_room(Lattice *l, float radius, int64_t middle) {
    if (l->room_count >= l->room_room) {
        int64_t room = l->room_room, again = room, third = room;
        if (!grow(&l->parent, l->room_count, &room, sizeof *l->parent) ||
            !grow(&l->radius, l->room_count, &again, sizeof *l->radius) ||
            !grow(&l->middle, l->room_count, &third, sizeof *l->middle))
            return -1;
        l->room_room = room;
    }
    int32_t index = (int32_t)l->room_count++;
    l->parent[index] = index, l->radius[index] = radius, l->middle[index] = middle;
    return index;
}

static int is_border(const Lattice *l, const int32_t *at) {
    for (int k = 0; k < 3; k++)
        if (at[k] == 0 || at[k] == l->size[k] - 1) return 1;
    return 0;
}

/* Mark the nodes where a door can stand: those no farther than `widest` from the surface of which
 * the nearest place is on an open edge, and their neighbours. Returns their number. */
static int64_t mark_places(Lattice *l, const float *distance, float widest) {
    int64_t count = 0, next;
    int32_t at[3];
    for (int64_t node = 0; node < l->nodes; node++) {
        if (distance[node] > widest || !l->feet[l->nearest[node]].rim) continue;
        place_of(l, node, at);
        if (is_border(l, at)) continue;
        for (int k = 0; k < 6; k++)
            if (way_to(l, node, k, &next) && distance[next] <= widest)
                l->blocked[next] |= PLACE_BIT;
        l->blocked[node] |= PLACE_BIT;
    }
    for (int64_t node = 0; node < l->nodes; node++) {
        if (!(l->blocked[node] & PLACE_BIT)) continue;
        place_of(l, node, at);
        if (is_border(l, at)) l->blocked[node] &= (uint8_t)~PLACE_BIT;
        else count++;
    }
    return count;
}

static int is_free(const Lattice *l, int64_t node) { return !(l->blocked[node] & PLACE_BIT); }

/* Join a row's nodes to those of the row before along an axis. */
static void join_rows(Lattice *l, int64_t row, int axis) {
    int64_t before = row - l->step[axis];
    int32_t last = -1, other = -1;
    for (int32_t x = 0; x < l->size[0]; x++) {
        int32_t a = l->room[row + x], b = l->room[before + x];
        if (a < 0 || b < 0 || (a == last && b == other) || is_blocked(l, before + x, axis))
            continue;
        unite(l, a, b);
        last = a, other = b;
    }
}

/* Number the rooms among the free nodes. */
static int join_free(Lattice *l) {
    if (add_room(l, INFINITY, 0) < 0) return 0;
    for (int32_t z = 0; z < l->size[2]; z++)
        for (int32_t y = 0; y < l->size[1]; y++) {
            int64_t row = node_at(l, 0, y, z);
            int32_t room = 0;
            for (int32_t x = 0; x < l->size[0]; x++) {
                int64_t node = row + x;
                int32_t at[3] = {x, y, z};
                if (!is_free(l, node)) {
                    l->room[node] = -1;
                    continue;
                }
                int same = x && is_free(l, node - 1) && !is_blocked(l, node - 1, 0);
                if (is_border(l, at)) room = same && room ? (unite(l, 0, room), room) : 0;
                else if (!same && (room = add_room(l, 0, node)) < 0) return 0;
                l->room[node] = room;
            }
            if (y) join_rows(l, row, 1);
            if (z) join_rows(l, row, 2);
        }
    return 1;
}

/* Renumber the rooms so that each is one number, in order of first nodes; the outside stays 0. */
static int number_rooms(Lattice *l) {
    int32_t *number = malloc((size_t)l->room_count * sizeof *number), count = 0;
    if (!number) return 0;
    for (int32_t r = 0; r < l->room_count; r++) {
        int32_t root = root_of(l, r);
        if (root == r) {
            l->middle[count] = l->middle[r], l->radius[count] = l->radius[r];
            number[r] = count++;
        } else {
            number[r] = number[root]; /* roots come first */
        }
    }
    for (int64_t i = 0; i < l->nodes; i++)
        if (l->room[i] >= 0) l->room[i] = number[l->room[i]];
    for (int32_t r = 0; r < count; r++) l->parent[r] = r;
    l->room_count = count;
    free(number);
    return 1;
}

/* The node in the middle of each room's longest run along x. */
static void find_middles(Lattice *l) {
    for (int64_t row = 0; row < l->nodes; row += l->step[1])
        for (int32_t x = 0, start = 0; x < l->size[0]; x++) {
            int32_t room = l->room[row + x];
            if (x + 1 < l->size[0] && l->room[row + x + 1] == room && !is_blocked(l, row + x, 0))
                continue;
            float half = (float)(x + 1 - start) / 2;
            if (room && half > l->radius[room])
                l->radius[room] = half, l->middle[room] = row + (start + x) / 2;
            start = x + 1;
        }
}

/* The node farthest from the surface in each room. */
static void measure_rooms(Lattice *l, const float *distance) {
    for (int64_t i = 0; i < l->nodes; i++) {
        int32_t room = l->room[i];
        if (room > 0 && distance[i] > l->radius[room])
            l->radius[room] = distance[i], l->middle[room] = i;
    }
}

/* The places of doors, farthest from the surface first. */
static int64_t *sorted_places(
    const Lattice *l, const float *distance, int64_t count, float widest) {
    int64_t bins = (int64_t)(widest * BINS_PER_CELL) + 2;
    int64_t *start = calloc((size_t)bins + 1, sizeof *start);
    int64_t *order = malloc((size_t)count * sizeof *order);
    for (int fill = 0; start && order && fill < 2; fill++) {
        for (int64_t i = 0; i < l->nodes; i++) {
            if (is_free(l, i)) continue;
            int64_t bin = bins - 1 - (int64_t)(distance[i] * BINS_PER_CELL);
            if (fill) order[start[bin]++] = i;
            else start[bin + 1]++;
        }
        for (int64_t b = 0; b < bins && !fill; b++) start[b + 1] += start[b];
    }
    int failed = !start || !order;
    free(start);
    if (!failed) return order;
    free(order);
    return NULL;
}

/* Give a place to the rooms around it, which become one unless a door is shut here. Places come in
 * descending order of distance, so a door that is shut at its widest place is shut at all. */
static int join_place(Lattice *l, int64_t node, float distance, float share) {
    int32_t rooms[6], largest = -1;
    int64_t next;
    int count = 0;
    for (int k = 0; k < 6; k++) {
        if (!way_to(l, node, k, &next) || l->room[next] < 0) continue;
        int32_t room = root_of(l, l->room[next]);
        int known = 0;
        for (int i = 0; i < count; i++) known |= rooms[i] == room;
        if (known) continue;
        rooms[count++] = room;
        if (largest < 0 || l->radius[room] > l->radius[largest]) largest = room;
    }
    if (!count) return (l->room[node] = add_room(l, distance, node)) >= 0;
    for (int i = 0; i < count; i++) {
        float radius = l->radius[rooms[i]];
        if (rooms[i] == largest || (radius >= LEAST_ROOM && distance <= share * radius)) continue;
        unite(l, rooms[i], largest);
        int32_t root = root_of(l, largest), other = root == largest ? rooms[i] : largest;
        if (l->radius[other] > l->radius[root])
            l->radius[root] = l->radius[other], l->middle[root] = l->middle[other];
        largest = root;
    }
    l->room[node] = largest;
    return 1;
}

static int join_places(
    Lattice *l, const float *distance, int64_t count, float widest, float share) {
    int64_t *order = sorted_places(l, distance, count, widest);
    int done = order != NULL;
    for (int64_t i = 0; i < count && done; i++)
        done = join_place(l, order[i], distance[order[i]], share);
    free(order);
    return done && number_rooms(l);
}

/* Number all rooms. With open edges, doors up to a half width of `widest` (cells) are shut where
 * that is at most `share` of the radius of the smaller room. */
static int find_rooms(Lattice *l, int open, float widest, float share) {
    l->room = malloc((size_t)l->nodes * sizeof *l->room);
    if (!l->room) return 0;
    if (!open) {
        if (!join_free(l) || !number_rooms(l)) return 0;
        find_middles(l);
        return 1;
    }
    if (!find_feet(l)) return 0;
    float *distance = sweep_feet(l);
    if (!distance) return 0;
    int64_t places = mark_places(l, distance, widest);
    int done = join_free(l) && number_rooms(l);
    if (done) measure_rooms(l, distance);
    if (done && places) done = join_places(l, distance, places, widest, share);
    free(distance);
    return done;
}

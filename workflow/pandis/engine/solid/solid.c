/* One closed surface for any triangles: the boundary of what a person would call the solid.
 *
 * Triangles are placed in a lattice. Each edge of the lattice knows where triangles cut it, so
 * nodes that are joined by edges without a cut lie on one side of the source: they form rooms. The
 * caller decides which rooms are solid. Surfaces with air on both sides become sheets a node or two
 * thick. The result is extracted by marching cubes; its vertices lie at the cuts, so on the source.
 *
 * Everything runs on one thread, in a fixed order: the same triangles give the same bytes.
 */
#define PANDIS_NO_FILE

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "../parts/types.h"
#include "../parts/basis.h"
#include "../parts/vectors.h"
#include "../parts/triangles.h"
#include "../parts/mesh.h"

#define cross pandis__cross
#define dot pandis__dot
#define normalise pandis__normalise

#include "lattice.h"
#include "cuts.h"
#include "feet.h"
#include "rooms.h"
#include "sheets.h"
#include "loops.h"
#include "corners.h"
#include "areas.h"
#include "../faces/predicates.h"
#include "../faces/meetings.h"
#include "flips.h"
#include "surface.h"
#include "parts.h"
#include "rims.h"
#include "queue.h"
#include "simplify.h"
#include "reopen.h"

void solid_free(Lattice *l) {
    if (!l) return;
    free(l->blocked), free(l->cuts), free(l->nearest), free(l->feet), free(l->room);
    free(l->parent), free(l->radius), free(l->middle), free(l->inside);
    free(l->vertices), free(l->places), free(l->faces), free(l);
}

/* A lattice with the cuts of triangles, corners (triangles, 3, 3) in cells, at least two cells from
 * its border. The last `caps` triangles only block, of
 * which the last `strips` continue faces beyond open edges. The arrays must outlive it. */
Lattice *solid_new(const double *corners, const uint8_t *open, int64_t triangles, int64_t caps,
    int64_t strips, const int32_t *size) {
    Lattice *l = calloc(1, sizeof *l);
    if (!l) return NULL;
    memcpy(l->size, size, sizeof l->size);
    l->step[0] = 1, l->step[1] = size[0], l->step[2] = (int64_t)size[0] * size[1];
    l->nodes = l->step[2] * size[2];
    l->corners = corners, l->open = open, l->triangles = triangles, l->caps = caps;
    l->strips = strips;
    l->blocked = calloc((size_t)l->nodes, 1);
    if (l->blocked && cut_edges(l)) return l;
    solid_free(l);
    return NULL;
}

int32_t solid_rooms(Lattice *l, int open, float widest, float share) {
    return find_rooms(l, open, widest, share);
}

int32_t solid_fill(Lattice *l, const uint8_t *solid, float half) {
    if (!l->inside && !(l->inside = malloc((size_t)l->nodes))) return 0;
    for (int64_t i = 0; i < l->nodes; i++) l->inside[i] = solid[l->room[i]];
    return add_sheets(l, half);
}

int32_t solid_surface(Lattice *l, float half) { return add_surface(l, half); }

/* Numbers of rooms, cuts, vertices and faces. */
void solid_counts(const Lattice *l, int64_t *counts) {
    counts[0] = l->room_count, counts[1] = l->cut_count;
    counts[2] = l->vertex_count, counts[3] = l->face_count;
}

/* Per room: the place of a node far from its walls. */
void solid_middles(const Lattice *l, int32_t *middle) {
    for (int64_t r = 0; r < l->room_count; r++) place_of(l, l->middle[r], middle + 3 * r);
}

/* Per cut: the rooms at both ends of its edge; the triangle; whether it is the only one of its
 * edge; 1 if the triangle faces the second end, -1 if the first; places half-way to the ends. */
void solid_walls(const Lattice *l, int32_t *rooms, int32_t *triangle, uint8_t *single,
    int8_t *faces, float *beside) {
    const double apart = 1e-4; /* cuts nearer than this are neighbours' on a common edge */
    for (int64_t i = 0; i < l->cut_count; i++) {
        const Cut *c = l->cuts + i, *before = c - 1, *after = c + 1;
        int64_t node = c->edge / 3, axis = c->edge % 3;
        int32_t at[3];
        double n[3];
        place_of(l, node, at);
        for (int k = 0; k < 6; k++) beside[6 * i + k] = (float)at[k % 3];
        beside[6 * i + axis] += (float)(c->at / 2),
            beside[6 * i + 3 + axis] += (float)((1 + c->at) / 2);
        rooms[2 * i] = l->room[node], rooms[2 * i + 1] = l->room[node + l->step[axis]];
        triangle[i] = c->triangle;
        normal_of(l, c->triangle, n);
        faces[i] = n[axis] > 0 ? 1 : -1;
        single[i] = !(i && before->edge == c->edge && c->at - before->at > apart) &&
            !(i + 1 < l->cut_count && after->edge == c->edge && after->at - c->at > apart);
    }
}

/* For each edge that joins two rooms: the rooms at its ends, and its distance from the surface.
 * Returns their number; writes nothing if `rooms` is NULL. */
int64_t solid_doors(const Lattice *l, int32_t *rooms, float *distance) {
    int64_t count = 0;
    for (int64_t i = 0; i < l->nodes; i++)
        for (int axis = 0; axis < 3; axis++) {
            int64_t next = i + l->step[axis];
            if (next >= l->nodes || is_blocked(l, i, axis) || l->room[i] == l->room[next]) continue;
            count++;
            if (!rooms) continue;
            *rooms++ = l->room[i], *rooms++ = l->room[next];
            *distance++ = (float)fmin(node_distance(l, i), node_distance(l, next));
        }
    return count;
}

/* The result: places (cells), origins and rooms of vertices, and faces. */
void solid_result(
    const Lattice *l, double *places, uint8_t *origin, int32_t *room, int32_t *faces) {
    memcpy(places, l->places, (size_t)l->vertex_count * 3 * sizeof *places);
    for (int64_t i = 0; i < l->vertex_count; i++)
        origin[i] = l->vertices[i].origin, room[i] = l->vertices[i].room;
    memcpy(faces, l->faces, (size_t)l->face_count * sizeof *l->faces);
}

/* The loops of a cell: count, then for each its size and edges. For tests. */
void solid_loops(int32_t solid, int32_t *out) {
    Loops loops;
    find_loops(solid, &loops);
    *out++ = loops.count;
    for (int i = 0; i < loops.count; i++) {
        *out++ = loops.size[i];
        for (int k = 0; k < loops.size[i]; k++) *out++ = loops.edge[i][k];
    }
}

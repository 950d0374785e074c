/* Test points that determine the side of all points whose closest point is on a given corner or
 * edge: a part of packing.c.
 *
 * All points that share a closest point are on the same side, because they form a cone that the
 * surface does not enter. So the side of one of them, next to the surface, is the side of all. */

/* distance of a test point from the surface (lattice steps), less than the height of any fold */
#define BESIDE 1e-3
/* a corner is smooth if no normal around it has a smaller cosine with their mean */
#define SMOOTH 0.82
/* an edge is blunt, so that the face determines the side, if its normals have a larger cosine */
#define BLUNT 0.1

typedef struct {
    double *points;  /* (n, 3) */
    int32_t *owners; /* a vertex, or V + a half-edge */
    int64_t count, room;
    int failed;
} Rays;

typedef struct {
    double x, y;
} Ray; /* (x, y, 1) in the frame of a pyramid */

/* Find the rays in one of six pyramids around the axes that make no acute angle with any of the
 * given directions. They form a polygon, which is cut by one plane per direction. Returns the
 * number of its corners. */
static int clip(const double *directions, int64_t count, int axis, double along, double slack,
    Ray *ray, Ray *spare) {
    int corners = 4, second = (axis + 1) % 3, third = (axis + 2) % 3;
    ray[0] = (Ray){-1, -1}, ray[1] = (Ray){1, -1}, ray[2] = (Ray){1, 1}, ray[3] = (Ray){-1, 1};
    for (int64_t i = 0; i < count && corners; i++) {
        const double *e = directions + 3 * i;
        double a = e[second], b = e[third], c = along * e[axis] - slack;
        int left = 0;
        for (int k = 0; k < corners; k++) {
            Ray p = ray[k], q = ray[(k + 1) % corners];
            double at = a * p.x + b * p.y + c, next = a * q.x + b * q.y + c;
            if (at <= 0) spare[left++] = p;
            if ((at <= 0) != (next <= 0)) {
                double s = at / (at - next);
                spare[left++] = (Ray){p.x + s * (q.x - p.x), p.y + s * (q.y - p.y)};
            }
        }
        memcpy(ray, spare, (size_t)left * sizeof *ray);
        corners = left;
    }
    return corners;
}

/* Add test points next to `from`, from which the surface extends in the given directions: one in
 * each pyramid that contains points whose closest point is `from`. */
static void add_rays(Rays *rays, int32_t owner, const double *from, const double *directions,
    int64_t count, Ray *room) {
    for (int axis = 0; axis < 3; axis++)
        for (double along = -1; along <= 1; along += 2) {
            int corners = clip(directions, count, axis, along, 1e-6, room, room + count + 8);
            if (!corners) continue;
            double ray[3], x = 0, y = 0;
            for (int k = 0; k < corners; k++) x += room[k].x / corners, y += room[k].y / corners;
            ray[axis] = along, ray[(axis + 1) % 3] = x, ray[(axis + 2) % 3] = y;
            pandis__normalise(ray);
            if (rays->count == rays->room) {
                int64_t more = 2 * rays->room + 64;
                double *points = realloc(rays->points, 3 * (size_t)more * sizeof *points);
                if (points) rays->points = points;
                int32_t *owners = realloc(rays->owners, (size_t)more * sizeof *owners);
                if (owners) rays->owners = owners;
                if (!points || !owners) {
                    rays->failed = 1;
                    return;
                }
                rays->room = more;
            }
            rays->owners[rays->count] = owner;
            for (int k = 0; k < 3; k++)
                rays->points[3 * rays->count + k] = from[k] + BESIDE * ray[k];
            rays->count++;
        }
}

typedef struct {
    int32_t vertex_count, face_count;
    const int32_t *vertices, *faces;
} Mesh;

static void point(const Mesh *m, int32_t face, int k, double *out) {
    const int32_t *v = m->vertices + 3 * (size_t)m->faces[3 * (size_t)face + k];
    for (int i = 0; i < 3; i++) out[i] = v[i];
}

static int unit_normal(const Mesh *m, int32_t face, double *n) {
    double a[3], b[3], c[3];
    point(m, face, 0, a), point(m, face, 1, b), point(m, face, 2, c);
    for (int i = 0; i < 3; i++) b[i] -= a[i], c[i] -= a[i];
    cross(b, c, n);
    return pandis__normalise(n);
}

/* Find the faces around each vertex, as the half-edges (3 * face + corner) that start there. */
static int find_around(const Mesh *m, int64_t **first, int32_t **around) {
    size_t halves = 3 * (size_t)m->face_count;
    *first = calloc((size_t)m->vertex_count + 2, sizeof **first);
    *around = malloc(halves * sizeof **around);
    if (!*first || !*around) return 0;
    for (size_t h = 0; h < halves; h++) (*first)[m->faces[h] + 2]++;
    for (int32_t v = 0; v < m->vertex_count; v++) (*first)[v + 2] += (*first)[v + 1];
    for (size_t h = 0; h < halves; h++) (*around)[(*first)[m->faces[h] + 1]++] = (int32_t)h;
    return 1;
}

/* Add test points beside a vertex, unless the faces around it are nearly in one plane. */
static void look_beside_vertex(const Mesh *m, int32_t vertex, const int32_t *around, int64_t count,
    double *directions, Ray *room, Rays *rays) {
    double sum[3] = {0}, from[3], n[3];
    int smooth = 1;
    for (int64_t i = 0; i < count; i++) {
        int32_t face = around[i] / 3;
        int k = around[i] % 3;
        double *u = directions + 6 * i, *v = u + 3;
        point(m, face, k, from), point(m, face, (k + 1) % 3, u), point(m, face, (k + 2) % 3, v);
        for (int j = 0; j < 3; j++) u[j] -= from[j], v[j] -= from[j];
        pandis__normalise(u), pandis__normalise(v);
        smooth &= unit_normal(m, face, n);
        for (int j = 0; j < 3; j++) sum[j] += n[j];
    }
    smooth &= pandis__normalise(sum);
    for (int64_t i = 0; i < count && smooth; i++)
        unit_normal(m, around[i] / 3, n), smooth = dot(n, sum) >= SMOOTH;
    if (count && !smooth) add_rays(rays, vertex, from, directions, 2 * count, room);
}

/* Add test points beside the midpoint of an edge, unless the edge is blunt. `halves` are all
 * half-edges of this edge. */
static void look_beside_edge(const Mesh *m, int32_t owner, const int32_t *halves, int64_t count,
    double *directions, Ray *room, Rays *rays) {
    double n[2][3], a[3], b[3], middle[3];
    int blunt = count == 2;
    point(m, halves[0] / 3, halves[0] % 3, a), point(m, halves[0] / 3, (halves[0] % 3 + 1) % 3, b);
    for (int j = 0; j < 3; j++) middle[j] = (a[j] + b[j]) / 2, b[j] -= a[j];
    pandis__normalise(b);
    for (int64_t i = 0; i < count; i++) {
        double c[3], *inward = directions + 3 * (i + 2);
        blunt &= unit_normal(m, halves[i] / 3, n[i & 1]);
        point(m, halves[i] / 3, (halves[i] % 3 + 2) % 3, c);
        for (int j = 0; j < 3; j++) c[j] -= a[j];
        double along = dot(c, b);
        for (int j = 0; j < 3; j++) inward[j] = c[j] - along * b[j];
        pandis__normalise(inward);
    }
    if (blunt && dot(n[0], n[1]) > BLUNT) return;
    for (int j = 0; j < 3; j++) directions[j] = b[j], directions[3 + j] = -b[j];
    add_rays(rays, owner, middle, directions, count + 2, room);
}

void packing_free_rays(Rays *rays) {
    if (!rays) return;
    free(rays->points), free(rays->owners);
    free(rays);
}

/* Find test points for the sides at corners and edges; returns NULL if memory is short. */
Rays *packing_rays(
    const int32_t *vertices, int32_t vertex_count, const int32_t *faces, int32_t face_count) {
    Mesh mesh = {vertex_count, face_count, vertices, faces}, *m = &mesh;
    Rays *rays = calloc(1, sizeof *rays);
    int64_t *first = NULL, most = 0;
    int32_t *around = NULL;
    int good = rays && find_around(m, &first, &around);
    for (int32_t v = 0; good && v < vertex_count; v++)
        if (first[v + 1] - first[v] > most) most = first[v + 1] - first[v];
    double *directions = malloc((6 * (size_t)most + 18) * sizeof *directions);
    Ray *room = malloc((4 * (size_t)most + 32) * sizeof *room);
    int32_t *halves = malloc((2 * (size_t)most + 2) * sizeof *halves);
    good = good && directions && room && halves;
    for (int32_t v = 0; good && v < vertex_count; v++)
        look_beside_vertex(
            m, v, around + first[v], first[v + 1] - first[v], directions, room, rays);
    for (size_t h = 0; good && h < 3 * (size_t)face_count; h++) {
        int32_t u = faces[h], v = faces[h % 3 == 2 ? h - 2 : h + 1];
        int64_t count = 0;
        /* find all half-edges of the edge, at the end where fewer faces meet */
        int32_t end = first[u + 1] - first[u] <= first[v + 1] - first[v] ? u : v,
                far = u == end ? v : u;
        for (int64_t i = first[end]; i < first[end + 1]; i++) {
            int32_t start = around[i], before = start % 3 ? start - 1 : start + 2;
            int32_t next = faces[start % 3 == 2 ? start - 2 : start + 1];
            if (next == far) halves[count++] = start;
            if (faces[before] == far) halves[count++] = before;
        }
        look_beside_edge(m, vertex_count + (int32_t)h, halves, count, directions, room, rays);
    }
    free(first), free(around), free(directions), free(room), free(halves);
    if (!good || rays->failed) return packing_free_rays(rays), NULL;
    return rays;
}

int64_t packing_ray_count(const Rays *rays) { return rays->count; }

void packing_copy_rays(const Rays *rays, double *points, int32_t *owners) {
    memcpy(points, rays->points, 3 * (size_t)rays->count * sizeof *points);
    memcpy(owners, rays->owners, (size_t)rays->count * sizeof *owners);
}

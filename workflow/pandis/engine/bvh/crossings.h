/* The winding number of a closed mesh as the faces that a ray along an axis crosses: a part of
 * bvh.c. It is exact, or unknown where doubles cannot tell whether or where the ray meets a face.
 */

#define UNKNOWN INT32_MIN
/* Relative errors of an area and a volume of differences of coordinates. */
#define AREA_ROUNDING 0x1p-51
#define VOLUME_ROUNDING 0x1p-50
/* Steps of a leaf by which its rounded corners may be off, and more than it has. */
#define STEPS_OFF 3
#define MOST_STEPS 1e6

/* A ray: its start, its axis and whether it goes down, and a box around it. */
typedef struct {
    const double *p;
    float low[3], high[3];
    int axis, down;
} Ray;

static Ray ray_along(const double *p, int axis, int down) {
    Ray ray = {.p = p, .axis = axis, .down = down};
    for (int k = 0; k < 3; k++) {
        float at = (float)p[k], lost = 2.4e-7f * fabsf(at) + 1e-37f;
        ray.low[k] = at - lost, ray.high[k] = at + lost;
    }
    if (ray.down) ray.low[ray.axis] = -INFINITY;
    else ray.high[ray.axis] = INFINITY;
    return ray;
}

static const int32_t BITS[WIDTH] = {1, 2, 4, 8, 16, 32, 64, 128};

/* Bit mask of the boxes of a node that a ray may meet. */
static int boxes_met(const Node *restrict node, const Ray *restrict ray) {
    int32_t met[WIDTH], mask = 0;
    for (int i = 0; i < WIDTH; i++) {
        int32_t meets = node->low[0][i] <= node->high[0][i];
        for (int k = 0; k < 3; k++)
            meets &= (node->low[k][i] <= ray->high[k]) & (node->high[k][i] >= ray->low[k]);
        met[i] = meets ? BITS[i] : 0;
    }
    for (int i = 0; i < WIDTH; i++) mask |= met[i];
    return mask;
}

/* Bit mask of the faces of a leaf that a ray may meet. */
static int faces_met(const Leaf *restrict leaf, const Ray *restrict ray) {
    int32_t met[WIDTH], first[3], last[3], mask = 0;
    for (int k = 0; k < 3; k++) {
        double at = (ray->p[k] - (double)leaf->origin[k]) / (double)leaf->step;
        at = at > -MOST_STEPS ? at < MOST_STEPS ? at : MOST_STEPS : -MOST_STEPS;
        first[k] = (int32_t)at - STEPS_OFF, last[k] = (int32_t)at + STEPS_OFF;
    }
    if (ray->down) first[ray->axis] = INT32_MIN;
    else last[ray->axis] = INT32_MAX;
    for (int i = 0; i < WIDTH; i++) {
        int32_t meets = leaf->face[i] >= 0;
        for (int k = 0; k < 3; k++) {
            int32_t a = leaf->corner[0][k][i], b = leaf->corner[1][k][i];
            int32_t c = leaf->corner[2][k][i], low = a < b ? a : b, high = a < b ? b : a;
            meets &= ((low < c ? low : c) <= last[k]) & ((high > c ? high : c) >= first[k]);
        }
        met[i] = meets ? BITS[i] : 0;
    }
    for (int i = 0; i < WIDTH; i++) mask |= met[i];
    return mask;
}

/* How a ray crosses a face: 1 from behind, -1 from its front, 0 if they do not meet. */
static int face_crossing(const Bvh *t, int32_t face, const Ray *ray) {
    double c[3][3], area[3], size[3], height = 0, most = 0;
    int left = 0, right = 0;
    for (int k = 0; k < 3; k++) { /* the ray's axis is the last */
        int axis = (ray->axis + k + 1) % 3;
        for (int j = 0; j < 3; j++) c[j][k] = corner(t, face, j)[axis] - ray->p[axis];
    }
    for (int j = 0; j < 3; j++) { /* of the ray's start and the side across from corner j */
        const double *a = c[(j + 1) % 3], *b = c[(j + 2) % 3];
        double one = a[0] * b[1], other = a[1] * b[0];
        area[j] = one - other, size[j] = fabs(one) + fabs(other);
        left += area[j] > AREA_ROUNDING * size[j], right += area[j] < -AREA_ROUNDING * size[j];
        height += c[j][2] * area[j], most += fabs(c[j][2]) * size[j];
    }
    if (left && right) return 0;
    if (left < 3 && right < 3) return UNKNOWN;
    if (!(fabs(height) > VOLUME_ROUNDING * most)) return UNKNOWN;
    if (((height > 0) == (left > 0)) == ray->down) return 0; /* behind the start */
    return (left > 0) != ray->down ? 1 : -1;
}

/* The winding number at the start of a ray, or UNKNOWN. */
static int count_crossings(const Bvh *t, const Ray *ray) {
    int32_t stack[STACK];
    int top = 1, sum = 0;
    stack[0] = 0;
    while (top) {
        int32_t index = stack[--top];
        int met = index < 0 ? faces_met(t->leaves + ~index, ray) : boxes_met(t->nodes + index, ray);
        for (int i = 0; met; i++, met >>= 1) {
            if (!(met & 1)) continue;
            if (index >= 0) {
                stack[top++] = t->nodes[index].child[i];
                continue;
            }
            int crossing = face_crossing(t, t->leaves[~index].face[i], ray);
            if (crossing == UNKNOWN) return UNKNOWN;
            sum += crossing;
        }
    }
    return sum;
}

/* The winding number at a point, from rays in about a direction: along the nearest axis, or else
 * one of the others. UNKNOWN on the surface. */
static int crossings(const Bvh *t, const double *p, const double *way) {
    double x = fabs(way[0]), y = fabs(way[1]), z = fabs(way[2]);
    int axis = x > y ? (x > z ? 0 : 2) : (y > z ? 1 : 2), number = UNKNOWN;
    for (int k = 0; k < 3 && number == UNKNOWN; k++, axis = (axis + 1) % 3) {
        Ray ray = ray_along(p, axis, way[axis] < 0);
        number = count_crossings(t, &ray);
    }
    return number;
}

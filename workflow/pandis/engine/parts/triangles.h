
/* -------------------- eight boxes or triangles at once, in single precision
 *
 * Squared distances are sorted by integer keys, because non-negative floats sort like integers with
 * the same bits. The last three bits of a key are the index of the box. */

PANDIS__INLINE int32_t pandis__least(const int32_t *keys) {
    int32_t least = keys[0];
    for (int i = 1; i < PANDIS__WIDTH; i++) least = keys[i] < least ? keys[i] : least;
    return least;
}

/* Convert a squared distance to a key: boxes with larger keys are farther. */
static int32_t pandis__key(float squared) {
    int32_t key;
    memcpy(&key, &squared, sizeof key);
    return key | 7;
}

/* The distance that a key stands for. */
static double pandis__distance_of(int32_t key) {
    float squared;
    key &= ~7;
    memcpy(&squared, &key, sizeof squared);
    return sqrt((double)squared);
}

/* The part of a budget that is spent in tree order: most queries need no more. */
static int32_t pandis__soon(int32_t most) {
    int32_t soon = most / 4 > PANDIS__SOON ? most / 4 : PANDIS__SOON;
    return most < INT32_MAX && most > soon ? soon : most;
}

/* The part of a budget that is spent far from the surface. */
static int32_t pandis__few(int32_t most) {
    int32_t few = most / 16 < 4 * PANDIS__AWAY ? most / 16 : 4 * PANDIS__AWAY;
    return few > PANDIS__AWAY ? few : PANDIS__AWAY;
}

typedef struct {
    int32_t key, child;
} pandis__waiting;

static void pandis__wait(pandis__waiting *heap, int at, pandis__waiting one) {
    for (; at > 0 && heap[(at - 1) / 2].key > one.key; at = (at - 1) / 2)
        heap[at] = heap[(at - 1) / 2];
    heap[at] = one;
}

static pandis__waiting pandis__next(pandis__waiting *heap, int count) {
    pandis__waiting first = heap[0], last = heap[count - 1];
    int at = 0, below = 1;
    for (; below < count - 1; at = below, below = 2 * at + 1) {
        if (below + 1 < count - 1 && heap[below + 1].key < heap[below].key) below++;
        if (heap[below].key >= last.key) break;
        heap[at] = heap[below];
    }
    heap[at] = last;
    return first;
}

/* Queue a box. If the queue is full, drop this box or the last one, whichever is farther, store its
 * key in `out`, and return 1. */
static int pandis__wait_or_drop(
    pandis__waiting *heap, int *count, int32_t key, int32_t child, int32_t *out) {
    pandis__waiting one = {key, child};
    if (*count < PANDIS__HEAP) {
        pandis__wait(heap, (*count)++, one);
        return 0;
    }
    pandis__waiting last = heap[*count - 1];
    *out = key < last.key ? last.key : key;
    if (key < last.key) pandis__wait(heap, *count - 1, one);
    return 1;
}

PANDIS__INLINE float pandis__clamp01f(float t) {
    t = t > 0 ? t : 0;
    return t < 1 ? t : 1;
}

/* Squared distances from a point to eight triangles, given as (3 corners, 3 axes, 8). Each
 * result belongs to some point of the triangle, so it can be too small only by rounding.
 * pandis__slacks bounds how much too large it can be. */
PANDIS__INLINE void pandis__eight_distances(
    float (*v)[3][PANDIS__WIDTH], const float *PANDIS__RESTRICT q, float *PANDIS__RESTRICT out) {
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float x = q[0] - v[0][0][i], y = q[1] - v[0][1][i], z = q[2] - v[0][2][i];
        float ux = v[1][0][i] - v[0][0][i], uy = v[1][1][i] - v[0][1][i],
              uz = v[1][2][i] - v[0][2][i];
        float vx = v[2][0][i] - v[0][0][i], vy = v[2][1][i] - v[0][1][i],
              vz = v[2][2][i] - v[0][2][i];
        float wx = vx - ux, wy = vy - uy, wz = vz - uz;
        float s = pandis__clamp01f((ux * x + uy * y + uz * z) / (ux * ux + uy * uy + uz * uz));
        float rx = x - s * ux, ry = y - s * uy, rz = z - s * uz;
        float best = rx * rx + ry * ry + rz * rz;
        float t = pandis__clamp01f((vx * x + vy * y + vz * z) / (vx * vx + vy * vy + vz * vz));
        rx = x - t * vx, ry = y - t * vy, rz = z - t * vz;
        float d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        float bx = x - ux, by = y - uy, bz = z - uz;
        float r = pandis__clamp01f((wx * bx + wy * by + wz * bz) / (wx * wx + wy * wy + wz * wz));
        rx = bx - r * wx, ry = by - r * wy, rz = bz - r * wz;
        d = rx * rx + ry * ry + rz * rz;
        best = d < best ? d : best;
        float nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        float per = 1 / (nx * nx + ny * ny + nz * nz);
        s = ((y * vz - z * vy) * nx + (z * vx - x * vz) * ny + (x * vy - y * vx) * nz) * per;
        t = ((uy * z - uz * y) * nx + (uz * x - ux * z) * ny + (ux * y - uy * x) * nz) * per;
        rx = x - s * ux - t * vx, ry = y - s * uy - t * vy, rz = z - s * uz - t * vz;
        d = rx * rx + ry * ry + rz * rz;
        int inside = (s >= 0) & (t >= 0) & (s + t <= 1);
        out[i] = inside && d < best ? d : best;
    }
}

/* How much too large the distance d to any of eight triangles can be in single precision, apart
 * from the rounding of the point: at most slack[0] + slack[1] * d. With B = 1 / the sine of the
 * angle at the first corner and the unit roundoff e, the foot inside a triangle is off by less than
 * e (32 B (d + longest side) + 8 B^2 d). If half the smallest height of a triangle is less than
 * this, half the height is the bound, because an edge is at most that far from any point inside. */
static void pandis__slacks(float (*v)[3][PANDIS__WIDTH], float *slack) {
    const float e = 6e-8f;
    float off[PANDIS__WIDTH], share[PANDIS__WIDTH];
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float ux = v[1][0][i] - v[0][0][i], uy = v[1][1][i] - v[0][1][i],
              uz = v[1][2][i] - v[0][2][i];
        float vx = v[2][0][i] - v[0][0][i], vy = v[2][1][i] - v[0][1][i],
              vz = v[2][2][i] - v[0][2][i];
        float wx = vx - ux, wy = vy - uy, wz = vz - uz;
        float uu = ux * ux + uy * uy + uz * uz, vv = vx * vx + vy * vy + vz * vz,
              ww = wx * wx + wy * wy + wz * wz;
        float nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        float twice = sqrtf(nx * nx + ny * ny + nz * nz), most = uu > vv ? uu : vv;
        float longest = sqrtf(ww > most ? ww : most),
              half = longest > 0 ? twice / (2 * longest) : 0;
        float sine = sqrtf(uu) * sqrtf(vv) / (twice > 0 ? twice : 1e-30f),
              more = e * (32 * sine + 8 * sine * sine);
        float less = e * 32 * sine * longest;
        int wide = less + more * longest < half; /* false after an overflow */
        /* plus the error on edges, and of a height that has lost its digits */
        off[i] = (wide ? less : half) + 64 * e * longest, share[i] = (wide ? more : 0) + 64 * e;
    }
    slack[0] = off[0], slack[1] = share[0];
    for (int i = 1; i < PANDIS__WIDTH; i++) {
        slack[0] = off[i] > slack[0] ? off[i] : slack[0];
        slack[1] = share[i] > slack[1] ? share[i] : slack[1];
    }
}

/* Whether a segment from a point, or its extension, meets a triangle (-1: from inside, 1: from
 * outside). `at` is set to the share of the segment at which they meet. */
static int pandis__meets(const double *const *c, const double *p, const double *way, double *at) {
    double u[3], v[3], x[3], across[3], turned[3];
    for (int k = 0; k < 3; k++)
        u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k], x[k] = p[k] - c[0][k];
    pandis__cross(way, v, across), pandis__cross(x, u, turned);
    double det = pandis__dot(u, across), r = pandis__dot(x, across) / det,
           s = pandis__dot(way, turned) / det;
    *at = pandis__dot(v, turned) / det;
    if (!(r >= 0 && s >= 0 && r + s <= 1 && *at >= 0)) return 0; /* not if det is 0 */
    return det < 0 ? -1 : 1;
}

/* -------------------- B-splines */

/* Cubic B-spline weights of the four nodes around t in [0, 1), and their derivatives with respect
 * to t. */
PANDIS__INLINE void pandis__weigh(double t, double *w, double *dw) {
    double s = 1 - t;
    w[0] = s * s * s / 6, w[3] = t * t * t / 6;
    w[1] = (4 - 6 * t * t + 3 * t * t * t) / 6, w[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    dw[0] = -s * s / 2, dw[3] = t * t / 2;
    dw[1] = t * (3 * t - 4) / 2, dw[2] = -s * (3 * s - 4) / 2;
}

/* Find the cell of a point and the weights of its 4 x 4 x 4 nodes; returns 0 outside the lattice.
 */
PANDIS__INLINE int pandis__place(int32_t size, double low, double per_step, const double *p,
    int *first, double (*w)[4], double (*dw)[4]) {
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - low) * per_step, cell = floor(x);
        if (!(cell >= 1 && cell <= size - 3)) return 0; /* NaN too */
        first[k] = (int)cell - 1;
        pandis__weigh(x - cell, w[k], dw[k]);
        for (int i = 0; i < 4; i++) dw[k][i] *= per_step;
    }
    return 1;
}

/* Four numbers at once, if the compiler has vectors; each result is the same as if computed alone.
 */
#if defined(PANDIS__VECTOR) && PANDIS__VECTOR > 1
typedef double pandis__four __attribute__((vector_size(32)));
typedef float pandis__four_floats __attribute__((vector_size(16), aligned(4), may_alias));
#define PANDIS__FOUR_AT_ONCE
#endif

/* Add the value and gradient of the spline that has these 64 coefficients around a point. */
PANDIS__INLINE void pandis__tensor(
    const float *c, double (*w)[4], double (*dw)[4], double *value, double *gradient) {
#ifdef PANDIS__FOUR_AT_ONCE
    pandis__four f = {0, 0, 0, 0}, gx = f, gy = f;
#else
    double f[4] = {0}, gx[4] = {0}, gy[4] = {0};
#endif
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++) {
            double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], d = w[0][x] * dw[1][y];
            const float *row = c + 16 * x + 4 * y;
#ifdef PANDIS__FOUR_AT_ONCE
            pandis__four r =
                __builtin_convertvector(*(const pandis__four_floats *)row, pandis__four);
            f += a * r, gx += b * r, gy += d * r;
#else
            for (int z = 0; z < 4; z++) {
                double r = (double)row[z];
                f[z] += a * r, gx[z] += b * r, gy[z] += d * r;
            }
#endif
        }
    for (int z = 0; z < 4; z++) {
        *value += f[z] * w[2][z];
        gradient[0] += gx[z] * w[2][z], gradient[1] += gy[z] * w[2][z],
            gradient[2] += f[z] * dw[2][z];
    }
}

/* Read the 64 coefficients around a point from a dense lattice. */
static void pandis__gather(const float *values, int32_t size, const int *first, float *c) {
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(c + 16 * x + 4 * y,
                values + ((ptrdiff_t)(first[0] + x) * size + first[1] + y) * size + first[2],
                4 * sizeof *c);
}

/* Compute the value and gradient at a point of the box, from a lattice that covers the box. */
static void pandis__cubic(
    const pandis__lattice *l, const double *u, double *value, double *gradient) {
    double within[3], w[3][4], dw[3][4];
    float c[64];
    int first[3];
    *value = gradient[0] = gradient[1] = gradient[2] = 0;
    for (int k = 0; k < 3; k++)
        within[k] = u[k] < -PANDIS__EDGE ? -PANDIS__EDGE
            : u[k] > PANDIS__EDGE        ? PANDIS__EDGE
                                         : u[k];
    if (!pandis__place(l->size, l->low, l->per_step, within, first, w, dw)) return;
    pandis__gather(l->values, l->size, first, c);
    pandis__tensor(c, w, dw, value, gradient);
}

PANDIS__INLINE int pandis__count_bits(uint64_t x) {
#if defined(__GNUC__)
    return __builtin_popcountll(x);
#else
    int n = 0;
    for (; x; x &= x - 1) n++;
    return n;
#endif
}

/* Index of the first of a block's eight coefficients, or -1 if the block is not stored. */
PANDIS__INLINE int32_t pandis__block_of(const pandis__layout *l, uint16_t brick, int bit) {
    if (brick == PANDIS__NO_BRICK) return -1;
    uint64_t mask = l->mask[brick], one = (uint64_t)1 << bit;
    if (!(mask & one)) return -1;
    return (int32_t)((l->base[brick] + (uint32_t)pandis__count_bits(mask & (one - 1))) * 8);
}

PANDIS__INLINE int32_t pandis__block(const pandis__layout *l, int bx, int by, int bz) {
    ptrdiff_t n = l->bricks;
    uint16_t brick = l->brick[((bx >> 2) * n + (by >> 2)) * n + (bz >> 2)];
    return pandis__block_of(l, brick, ((bx & 3) << 4) | ((by & 3) << 2) | (bz & 3));
}

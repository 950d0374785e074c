/* Uniform cubic B-splines over a box: values, gradients, and their adjoint.
 *
 * Dense: coefficients at all size^3 nodes. Sparse: blocks of 2 x 2 x 2 of them are kept or not;
 * 4 x 4 x 4 blocks make a brick, whose 64 bits say which. The kept blocks of a brick lie one after
 * the other from its base on, so that a block is found by counting bits.
 *
 * Node i of an axis lies at low + i * step. A point is answered in the cells 1 to size - 3, where
 * it has two nodes on either side.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#define NO_BRICK 65535

typedef struct {
    int32_t size, bricks;  /* nodes and bricks per axis */
    double low, per_step;  /* place of node 0, nodes per length */
    const uint16_t *brick; /* of each place: which kept brick it is, or NO_BRICK */
    const uint64_t *mask;  /* of each kept brick: its blocks */
    const uint32_t *base;  /* of each kept brick: how many blocks come before it */
} Layout;

static int count_bits(uint64_t x) {
#if defined(__GNUC__)
    return __builtin_popcountll(x);
#else
    int n = 0;
    for (; x; x &= x - 1) n++;
    return n;
#endif
}

/* Cubic B-spline weights of the four nodes around t in [0, 1), and their derivatives by t. */
static void weigh(double t, double *w, double *dw) {
    double s = 1 - t;
    w[0] = s * s * s / 6, w[3] = t * t * t / 6;
    w[1] = (4 - 6 * t * t + 3 * t * t * t) / 6, w[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    dw[0] = -s * s / 2, dw[3] = t * t / 2;
    dw[1] = t * (3 * t - 4) / 2, dw[2] = -s * (3 * s - 4) / 2;
}

/* Find the cell of a point and the weights of its 4 x 4 x 4 nodes; 0 outside of the grid. */
static int place(int32_t size, double low, double per_step, const double *p, int *first, double (*w)[4],
                 double (*dw)[4]) {
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - low) * per_step, cell = floor(x);
        if (!(cell >= 1 && cell <= size - 3)) return 0; /* NaN too */
        first[k] = (int)cell - 1;
        weigh(x - cell, w[k], dw[k]);
        for (int i = 0; i < 4; i++) dw[k][i] *= per_step;
    }
    return 1;
}

/* ---------------------------------------------------------------- dense */

void spline_dense_evaluate(int32_t size, double low, double per_step, const float *coefficients, const double *points,
                           int64_t count, double *value, double *gradient) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        double w[3][4], dw[3][4], f[4] = {0}, gx[4] = {0}, gy[4] = {0}, *g = gradient + 3 * i;
        value[i] = g[0] = g[1] = g[2] = 0;
        if (!place(size, low, per_step, points + 3 * i, first, w, dw)) continue;
        for (int x = 0; x < 4; x++)
            for (int y = 0; y < 4; y++) {
                const float *row = coefficients + ((ptrdiff_t)(first[0] + x) * size + first[1] + y) * size + first[2];
                double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], c = w[0][x] * dw[1][y];
                for (int z = 0; z < 4; z++) {
                    double r = (double)row[z];
                    f[z] += a * r, gx[z] += b * r, gy[z] += c * r;
                }
            }
        for (int z = 0; z < 4; z++) {
            value[i] += f[z] * w[2][z];
            g[0] += gx[z] * w[2][z], g[1] += gy[z] * w[2][z], g[2] += f[z] * dw[2][z];
        }
    }
}

/* Add to `sums`, size^3 of them, what residuals of value and gradient at points mean for each
 * coefficient: the transpose of the above. */
void spline_dense_adjoint(int32_t size, double low, double per_step, const double *points, int64_t count,
                          const double *value, const double *gradient, double *sums) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        double w[3][4], dw[3][4], f[4], gx[4], gy[4];
        const double *g = gradient + 3 * i;
        if (!place(size, low, per_step, points + 3 * i, first, w, dw)) continue;
        for (int z = 0; z < 4; z++) {
            f[z] = value[i] * w[2][z] + g[2] * dw[2][z];
            gx[z] = g[0] * w[2][z], gy[z] = g[1] * w[2][z];
        }
        for (int x = 0; x < 4; x++)
            for (int y = 0; y < 4; y++) {
                double *row = sums + ((ptrdiff_t)(first[0] + x) * size + first[1] + y) * size + first[2];
                double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], c = w[0][x] * dw[1][y];
                for (int z = 0; z < 4; z++) row[z] += a * f[z] + b * gx[z] + c * gy[z];
            }
    }
}

/* ---------------------------------------------------------------- sparse */

/* Find the 64 coefficients around a point; those that are not kept get the index `blank`. Tells
 * how much is kept: 0 nothing, 1 some of it, 2 everything. */
static int locate(const Layout *l, const int *first, int32_t blank, int32_t *index) {
    int n = l->bricks, found = 0, missing = 0;
    for (int bx = first[0] >> 1; bx <= (first[0] + 3) >> 1; bx++)
        for (int by = first[1] >> 1; by <= (first[1] + 3) >> 1; by++)
            for (int bz = first[2] >> 1; bz <= (first[2] + 3) >> 1; bz++) {
                uint16_t brick = l->brick[((ptrdiff_t)(bx >> 2) * n + (by >> 2)) * n + (bz >> 2)];
                int bit = ((bx & 3) << 4) | ((by & 3) << 2) | (bz & 3);
                uint64_t mask = brick == NO_BRICK ? 0 : l->mask[brick], one = (uint64_t)1 << bit;
                int kept = (mask & one) != 0;
                int32_t start = kept ? (int32_t)((l->base[brick] + (uint32_t)count_bits(mask & (one - 1))) * 8) : 0;
                found |= kept, missing |= !kept;
                for (int c = 0; c < 8; c++) {
                    int x = 2 * bx + (c >> 2) - first[0], y = 2 * by + (c >> 1 & 1) - first[1],
                        z = 2 * bz + (c & 1) - first[2];
                    if (x >= 0 && x < 4 && y >= 0 && y < 4 && z >= 0 && z < 4)
                        index[(x * 4 + y) * 4 + z] = kept ? start + c : blank;
                }
            }
    return !found ? 0 : missing ? 1 : 2;
}

/* Add values and gradients at points; what is not kept counts as zero. `kept` tells how much of it
 * was kept, as above; coefficients[blank] must be 0. */
void spline_evaluate(const Layout *l, const float *coefficients, int32_t blank, const double *points, int64_t count,
                     double *value, double *gradient, uint8_t *kept) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        int32_t index[64];
        double w[3][4], dw[3][4], f[4] = {0}, gx[4] = {0}, gy[4] = {0}, *g = gradient + 3 * i;
        kept[i] = 0;
        if (!place(l->size, l->low, l->per_step, points + 3 * i, first, w, dw)) continue;
        kept[i] = (uint8_t)locate(l, first, blank, index);
        if (!kept[i]) continue;
        for (int x = 0; x < 4; x++)
            for (int y = 0; y < 4; y++) {
                const int32_t *row = index + 16 * x + 4 * y;
                double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], c = w[0][x] * dw[1][y];
                for (int z = 0; z < 4; z++) {
                    double r = (double)coefficients[row[z]];
                    f[z] += a * r, gx[z] += b * r, gy[z] += c * r;
                }
            }
        for (int z = 0; z < 4; z++) {
            value[i] += f[z] * w[2][z];
            g[0] += gx[z] * w[2][z], g[1] += gy[z] * w[2][z], g[2] += f[z] * dw[2][z];
        }
    }
}

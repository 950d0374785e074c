/* Uniform cubic B-splines over a box: values, gradients, and their adjoint.
 *
 * Dense: coefficients at all size^3 nodes. Sparse: only some blocks of 2 x 2 x 2 coefficients are
 * stored. 4 x 4 x 4 blocks make a brick, in which a bit for each block marks whether it is stored.
 * A brick's stored blocks are contiguous from its base on, so a block is located by counting bits.
 *
 * Node i of an axis is at low + i * step. The spline is defined in the cells 1 to size - 3, where a
 * point has two nodes on either side.
 */
#define PANDIS_NO_FILE

#include <stddef.h>
#include <stdint.h>

#include "../parts/types.h"
#include "../parts/basis.h"
#include "../parts/vectors.h"
#include "../parts/bsplines.h"

typedef pandis__layout Layout;

/* -------------------- dense */

void spline_dense_evaluate(int32_t size, double low, double per_step, const float *coefficients,
    const double *points, int64_t count, double *value, double *gradient) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        double w[3][4], dw[3][4], *g = gradient + 3 * i;
        float c[64];
        value[i] = g[0] = g[1] = g[2] = 0;
        if (!pandis__place(size, low, per_step, points + 3 * i, first, w, dw)) continue;
        pandis__gather(coefficients, size, first, c);
        pandis__tensor(c, w, dw, value + i, g);
    }
}

/* Add residuals of value and gradient at points to `sums`, one for each of the size^3 coefficients:
 * the transpose of spline_dense_evaluate. */
void spline_dense_adjoint(int32_t size, double low, double per_step, const double *points,
    int64_t count, const double *value, const double *gradient, double *sums) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        double w[3][4], dw[3][4], f[4], gx[4], gy[4];
        const double *g = gradient + 3 * i;
        if (!pandis__place(size, low, per_step, points + 3 * i, first, w, dw)) continue;
        for (int z = 0; z < 4; z++) {
            f[z] = value[i] * w[2][z] + g[2] * dw[2][z];
            gx[z] = g[0] * w[2][z], gy[z] = g[1] * w[2][z];
        }
        for (int x = 0; x < 4; x++)
            for (int y = 0; y < 4; y++) {
                double *row =
                    sums + ((ptrdiff_t)(first[0] + x) * size + first[1] + y) * size + first[2];
                double a = w[0][x] * w[1][y], b = dw[0][x] * w[1][y], c = w[0][x] * dw[1][y];
                for (int z = 0; z < 4; z++) row[z] += a * f[z] + b * gx[z] + c * gy[z];
            }
    }
}

/* -------------------- sparse */

/* Find the 64 coefficients around a point; those that are not stored get the index `blank`.
 * Returns 0 if none is stored, 1 if some are, 2 if all are. */
static int locate(const pandis__layout *l, const int *first, int32_t blank, int32_t *index) {
    int found = 0, missing = 0, own[3][4], blocks[3];
    int32_t start[3][3][3];
    for (int k = 0; k < 3; k++) { /* a node's block, of the two or three per axis */
        for (int i = 0; i < 4; i++) own[k][i] = ((first[k] + i) >> 1) - (first[k] >> 1);
        blocks[k] = own[k][3] + 1;
    }
    for (int i = 0; i < blocks[0]; i++)
        for (int j = 0; j < blocks[1]; j++)
            for (int k = 0; k < blocks[2]; k++) {
                int32_t at =
                    pandis__block(l, (first[0] >> 1) + i, (first[1] >> 1) + j, (first[2] >> 1) + k);
                start[i][j][k] = at;
                found |= at >= 0, missing |= at < 0;
            }
    if (!found) return 0;
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            for (int z = 0; z < 4; z++) {
                int32_t at = start[own[0][x]][own[1][y]][own[2][z]];
                int c =
                    ((first[0] + x) & 1) << 2 | ((first[1] + y) & 1) << 1 | ((first[2] + z) & 1);
                index[(x * 4 + y) * 4 + z] = at < 0 ? blank : at + c;
            }
    return missing ? 1 : 2;
}

/* Add values and gradients at points; coefficients that are not stored count as zero. `kept` gets
 * the result of locate for each point; coefficients[blank] must be 0. */
void spline_evaluate(const Layout *l, const float *coefficients, int32_t blank,
    const double *points, int64_t count, double *value, double *gradient, uint8_t *kept) {
    for (int64_t i = 0; i < count; i++) {
        int first[3];
        int32_t index[64];
        double w[3][4], dw[3][4];
        float c[64];
        kept[i] = 0;
        if (!pandis__place(l->size, l->low, l->per_step, points + 3 * i, first, w, dw)) continue;
        kept[i] = (uint8_t)locate(l, first, blank, index);
        if (!kept[i]) continue;
        for (int k = 0; k < 64; k++) c[k] = coefficients[index[k]];
        pandis__tensor(c, w, dw, value + i, gradient + 3 * i);
    }
}

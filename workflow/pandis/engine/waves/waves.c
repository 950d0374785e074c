/* Sine and cosine of a layer in one pass: all that a step of a sine network needs besides matrix
 * products.
 *
 * Arrays are rows x columns, float32, in row-major order; a row is a unit, a column a point.
 */
#define PANDIS_NO_FILE

#include <stddef.h>
#include <stdint.h>

#include "../parts/basis.h"
#include "../parts/vectors.h"
#include "../parts/sines.h"

/* z <- sin(z + bias), cosine <- cos(z + bias). */
void waves_sines(float *restrict z, const float *restrict bias, float *restrict cosine,
    int64_t from, int64_t to, int64_t columns) {
    for (int64_t row = from; row < to; row++) {
        float *restrict x = z + row * columns, *restrict y = cosine + row * columns,
                        shift = bias[row];
        for (int64_t i = 0; i < columns; i++) pandis__sine_cosine(x[i] + shift, x + i, y + i);
    }
}

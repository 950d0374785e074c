/* Sine and cosine of a layer in one pass: what a step of a sine network needs besides products.
 *
 * Arrays are rows x columns, float32, row after row; a row is a unit, a column a point.
 */
#include <math.h>
#include <stdint.h>

/* pi / 2 in three parts, the first two of few bits: whole multiples of them are exact. */
#define PART1 1.5703125f
#define PART2 4.837512969970703125e-4f
#define PART3 7.549789954891e-8f
#define TWO_OVER_PI 0.636619772367581343f

/* Sine and cosine to 1e-7 for |x| up to 1e4; minimax polynomials on [-pi/4, pi/4] (Cephes). */
static inline void sine_cosine(float x, float *sine, float *cosine) {
    float k = rintf(x * TWO_OVER_PI);
    float r = ((x - k * PART1) - k * PART2) - k * PART3, q = r * r;
    float s = ((-1.9515295891e-4f * q + 8.3321608736e-3f) * q - 1.6666654611e-1f) * q * r + r;
    float c = ((2.443315711809948e-5f * q - 1.388731625493765e-3f) * q + 4.166664568298827e-2f) * q * q -
              0.5f * q + 1;
    int32_t quarter = (int32_t)k;
    float a = quarter & 1 ? c : s, b = quarter & 1 ? s : c;
    *sine = quarter & 2 ? -a : a;
    *cosine = (quarter + 1) & 2 ? -b : b;
}

/* z <- sin(z + bias), cosine <- cos(z + bias). */
void waves_sines(float *restrict z, const float *restrict bias, float *restrict cosine, int64_t from, int64_t to,
                 int64_t columns) {
    for (int64_t row = from; row < to; row++) {
        float *restrict x = z + row * columns, *restrict y = cosine + row * columns, shift = bias[row];
        for (int64_t i = 0; i < columns; i++) sine_cosine(x[i] + shift, x + i, y + i);
    }
}

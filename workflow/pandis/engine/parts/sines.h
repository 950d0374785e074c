/* -------------------- sines */

/* pi / 2 in three parts, the first two of few bits, so that integer multiples of them are exact. */
#define PANDIS__PART1 1.5703125f
#define PANDIS__PART2 4.837512969970703125e-4f
#define PANDIS__PART3 7.549789954891e-8f

/* Compute the sine and cosine within 1.2e-7 for |x| up to 1e4. Beyond that, where no trained
 * network goes, the results are those of 0; if x is not finite, they are NaN. The minimax
 * polynomials on [-pi/4, pi/4] are from Cephes (Moshier). The code has no branch, so that it
 * vectorises. */
PANDIS__INLINE void pandis__sine_cosine(float x, float *sine, float *cosine) {
    const float whole = 12582912.0f; /* adding 1.5 * 2^23 rounds to the nearest whole number */
    float none = x - x;              /* 0, or NaN if x is not finite */
    x = fabsf(x) <= 1e4f ? x : 0.0f;
    float k = (x * 0.636619772367581343f + whole) - whole;
    float r = ((x - k * PANDIS__PART1) - k * PANDIS__PART2) - k * PANDIS__PART3, q = r * r;
    float s = ((-1.9515295891e-4f * q + 8.3321608736e-3f) * q - 1.6666654611e-1f) * q * r + r;
    float c =
        ((2.443315711809948e-5f * q - 1.388731625493765e-3f) * q + 4.166664568298827e-2f) * q * q -
        0.5f * q + 1.0f;
    int32_t quarter = (int32_t)k;
    float a = quarter & 1 ? c : s, b = quarter & 1 ? s : c;
    *sine = (quarter & 2 ? -a : a) + none;
    *cosine = ((quarter + 1) & 2 ? -b : b) + none;
}

/* Add biases to a layer's sums in all lanes, and replace them by their sines; also compute the
 * cosines. With vector types, this is the function above with the same bits: few compilers would
 * use vectors for it without -O3. */
PANDIS__INLINE void pandis__sines(float *z, const float *bias, float *cosines) {
#if PANDIS__VECTOR > 1
    const float whole = 12582912.0f;
    for (int at = 0; at < PANDIS__LANES; at += PANDIS__VECTOR) {
        pandis__vector x = pandis__load(z + at) + pandis__load(bias + at), none = x - x;
        pandis__ints small = (x >= -1e4f) & (x <= 1e4f);
        x = (pandis__vector)((pandis__ints)x & small);
        /* the last bits of this sum are those of the whole number k */
        pandis__vector sum = x * 0.636619772367581343f + whole, k = sum - whole;
        pandis__vector r = ((x - k * PANDIS__PART1) - k * PANDIS__PART2) - k * PANDIS__PART3,
                       q = r * r;
        pandis__vector s =
            ((-1.9515295891e-4f * q + 8.3321608736e-3f) * q - 1.6666654611e-1f) * q * r + r;
        pandis__vector c =
            ((2.443315711809948e-5f * q - 1.388731625493765e-3f) * q + 4.166664568298827e-2f) * q *
                q -
            0.5f * q + 1.0f;
        pandis__ints quarter = (pandis__ints)sum, odd = -(quarter & 1), change;
        change = ((pandis__ints)s ^ (pandis__ints)c) & odd; /* exchanges sine and cosine */
        pandis__ints a = (pandis__ints)s ^ change, b = (pandis__ints)c ^ change;
        a ^= -(quarter >> 1 & 1) & INT32_MIN, b ^= -((quarter + 1) >> 1 & 1) & INT32_MIN;
        s = (pandis__vector)a + none, c = (pandis__vector)b + none;
        memcpy(z + at, &s, sizeof s), memcpy(cosines + at, &c, sizeof c);
    }
#else
    for (int k = 0; k < PANDIS__LANES; k++) pandis__sine_cosine(z[k] + bias[k], z + k, cosines + k);
#endif
}

/* Check the arithmetic that this code relies on: sums are rounded in the order in which they are
 * written, and NaN stays NaN. Some options of -ffast-math break this and define no macro. */
PANDIS__ONCE static int pandis__arithmetic(void) {
    /* sines and cosines of 3 and of -100, from a loop like that of network layers */
    static const float wanted[4] = {0.141120008f, -0.989992497f, 0.506365641f, 0.862318872f};
    volatile float read[2] = {3.0f, -100.0f};
    volatile uint32_t none = 0x7fc00000u; /* NaN, made without a division, which might trap */
    uint32_t bits = none;
    volatile double large = 9007199254740992.0, one = 1;
    float sine[PANDIS__LANES], cosine[PANDIS__LANES], bias[PANDIS__LANES] = {0};
    int good = 1;
    for (int k = 0; k < PANDIS__LANES; k++) sine[k] = read[k & 1];
    memcpy(sine + 15, &bits, sizeof bits);
    pandis__sines(sine, bias, cosine);
    for (int k = 0; k < 15; k++) {
        good &= fabsf(sine[k] - wanted[2 * (k & 1)]) < 1e-6f;
        good &= fabsf(cosine[k] - wanted[2 * (k & 1) + 1]) < 1e-6f;
    }
    double sum = large + one; /* rounds back */
    double big = sum - large, nan = (double)sine[15];
    return good & (big == 0) & (nan != nan);
}

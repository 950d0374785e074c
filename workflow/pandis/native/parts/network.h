/* ---------------------------------------------------------------- networks */

/* Vectors as wide as the machine's, where the compiler has them: it would not see by itself that the
 * lanes of a sum can stay in registers. Elsewhere a vector is one number. What is added to what, and
 * in which order, is the same for every width. */
#if (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 9)) && !defined(PANDIS_NO_VECTORS)
#if defined(__AVX512F__)
#define PANDIS__VECTOR 16
#elif defined(__AVX__)
#define PANDIS__VECTOR 8
#else
#define PANDIS__VECTOR 4
#endif
typedef float pandis__vector __attribute__((vector_size(4 * PANDIS__VECTOR)));
typedef int16_t pandis__vector16 __attribute__((vector_size(2 * PANDIS__VECTOR)));

static inline pandis__vector pandis__load16(const int16_t *p) {
    pandis__vector16 v;
    memcpy(&v, p, sizeof v);
    return __builtin_convertvector(v, pandis__vector);
}

static inline pandis__vector pandis__splat(float x) {
    pandis__vector v = {0};
    for (int k = 0; k < PANDIS__VECTOR; k++) v[k] = x;
    return v;
}
#else
#define PANDIS__VECTOR 1
typedef float pandis__vector;
static inline float pandis__load16(const int16_t *p) { return (float)*p; }
static inline float pandis__splat(float x) { return x; }
#endif
#define PANDIS__PARTS (PANDIS__LANES / PANDIS__VECTOR)

static inline pandis__vector pandis__load(const float *p) {
    pandis__vector v;
    memcpy(&v, p, sizeof v);
    return v;
}

/* A network is as fast as its weights come: ask for the next rows while these are worked on. */
#if PANDIS__VECTOR > 1
#define PANDIS__FETCH(p) __builtin_prefetch(p)
#else
#define PANDIS__FETCH(p) ((void)(p))
#endif

/* Each of the following for weights of 32 and of 16 bits. */
#define PANDIS__KINDS(make) make(pandis__load, float, f) make(pandis__load16, int16_t, h)

/* out <- out + the sum over rows of h[i] * weights[i], four rows at once. */
#define PANDIS__ADD(load, type, tail)                                                                            \
    static void pandis__add_##tail(const type *w, const float *h, int rows, int stride, float *out) {            \
        int i = 0;                                                                                               \
        for (; i + 4 <= rows; i += 4, w += 4 * (ptrdiff_t)stride) {                                              \
            pandis__vector a = pandis__splat(h[i]), b = pandis__splat(h[i + 1]), c = pandis__splat(h[i + 2]),    \
                           d = pandis__splat(h[i + 3]);                                                          \
            const type *next = i + 8 <= rows ? w + 4 * (ptrdiff_t)stride : w;                                    \
            for (int j = 0; j < stride; j += PANDIS__VECTOR) {                                                   \
                for (int r = 0; r < 4; r++) PANDIS__FETCH(next + r * (ptrdiff_t)stride + j);                     \
                pandis__vector sum = pandis__load(out + j) + ((a * load(w + j) + b * load(w + stride + j)) +     \
                                                              (c * load(w + 2 * (ptrdiff_t)stride + j) +         \
                                                               d * load(w + 3 * (ptrdiff_t)stride + j)));        \
                memcpy(out + j, &sum, sizeof sum);                                                               \
            }                                                                                                    \
        }                                                                                                        \
        for (; i < rows; i++, w += stride)                                                                       \
            for (int j = 0; j < stride; j++) out[j] += h[i] * (float)w[j];                                       \
    }
PANDIS__KINDS(PANDIS__ADD)

/* Sum the lanes of four rows by halves. */
static inline void pandis__fold(float (*lanes)[PANDIS__LANES], float *out) {
    for (int n = PANDIS__LANES / 2; n; n /= 2)
        for (int r = 0; r < 4; r++)
            for (int k = 0; k < n; k++) lanes[r][k] += lanes[r][k + n];
    for (int r = 0; r < 4; r++) out[r] = lanes[r][0];
}

/* out[i] <- the product of row i and y, each summed in PANDIS__LANES lanes, four rows at once. */
#define PANDIS__DOT(load, type, tail)                                                                            \
    static void pandis__dots_##tail(const type *w, const float *y, int rows, int stride, float *out) {           \
        for (int i = 0; i < rows; i += 4) {                                                                      \
            const type *row[4];                                                                                  \
            ptrdiff_t next = i + 8 <= rows ? 4 * (ptrdiff_t)stride : 0;                                          \
            pandis__vector sum[4][PANDIS__PARTS];                                                                \
            float lanes[4][PANDIS__LANES], four[4];                                                              \
            memset(sum, 0, sizeof sum);                                                                          \
            for (int r = 0; r < 4; r++) row[r] = w + (ptrdiff_t)(i + r < rows ? i + r : i) * stride;             \
            for (int j = 0; j < stride; j += PANDIS__LANES)                                                      \
                for (int k = 0; k < PANDIS__PARTS; k++) {                                                        \
                    pandis__vector v = pandis__load(y + j + k * PANDIS__VECTOR);                                 \
                    for (int r = 0; r < 4; r++) PANDIS__FETCH(row[r] + next + j + k * PANDIS__VECTOR);           \
                    for (int r = 0; r < 4; r++) sum[r][k] += load(row[r] + j + k * PANDIS__VECTOR) * v;          \
                }                                                                                                \
            memcpy(lanes, sum, sizeof lanes);                                                                    \
            pandis__fold(lanes, four);                                                                           \
            for (int r = 0; r < 4 && i + r < rows; r++) out[i + r] = four[r];                                    \
        }                                                                                                        \
    }
PANDIS__KINDS(PANDIS__DOT)

/* x -> sin(W x + b) ... -> phi and psi, or phi and its gradient; w0 is folded into W and b. */
PANDIS__APART static int pandis__answer_network(const pandis__network *n, const double *u, double *distance, double *normal) {
    float slopes[PANDIS_MOST_DEPTH][PANDIS__ROWS], ends[2][PANDIS__ROWS];
    float *h = ends[0], *z = ends[1], x[3], result[4] = {0};
    double inside[3], value, gradient[3];
    double outside = pandis__clamp(u, inside);
    int stride = n->stride, own = n->outputs == 1;
    for (int k = 0; k < 3; k++) x[k] = (float)inside[k];
    for (int layer = 0; layer < n->depth; layer++) {
        const float *bias = n->biases + (ptrdiff_t)layer * stride;
        ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
        for (int j = 0; j < stride; j++) z[j] = 0;
        if (layer > 0 && n->hidden16)
            for (int i = 0; i < n->width; i++) h[i] *= n->scales[at + i];
        if (layer == 0)
            pandis__add_f(n->first, x, 3, stride, z);
        else if (n->hidden)
            pandis__add_f(n->hidden + at * stride, h, n->width, stride, z);
        else
            pandis__add_h(n->hidden16 + at * stride, h, n->width, stride, z);
        for (int j = 0; j < stride; j++) pandis__sine_cosine(z[j] + bias[j], z + j, slopes[layer] + j);
        float *swap = h;
        h = z, z = swap;
    }
    pandis__dots_f(n->last, h, n->outputs, stride, result);
    for (int k = 0; k < n->outputs; k++) result[k] += n->biases[(ptrdiff_t)n->depth * stride + k];
    value = (double)result[0];
    if (own) {
        for (int j = 0; j < stride; j++) h[j] = n->last[j] * slopes[n->depth - 1][j];
        for (int layer = n->depth - 1; layer > 0; layer--) {
            ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
            if (n->hidden) {
                pandis__dots_f(n->hidden + at * stride, h, n->width, stride, z);
                for (int i = 0; i < n->width; i++) z[i] *= slopes[layer - 1][i];
            } else {
                pandis__dots_h(n->hidden16 + at * stride, h, n->width, stride, z);
                for (int i = 0; i < n->width; i++) z[i] *= n->scales[at + i] * slopes[layer - 1][i];
            }
            for (int i = n->width; i < stride; i++) z[i] = 0;
            float *swap = h;
            h = z, z = swap;
        }
        pandis__dots_f(n->first, h, 3, stride, result);
        for (int k = 0; k < 3; k++) gradient[k] = (double)result[k];
    } else {
        for (int k = 0; k < 3; k++) gradient[k] = (double)result[k + 1];
    }
    if (n->base.size) {
        double more, slope[3];
        pandis__cubic(&n->base, inside, &more, slope);
        value += more;
        for (int k = 0; k < 3; k++) gradient[k] += slope[k];
    }
    *distance = value + outside;
    memcpy(normal, gradient, sizeof gradient);
    return outside > 0 ? PANDIS_BOUND : PANDIS_OK;
}


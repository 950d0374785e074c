/* -------------------- networks */

/* Reading the weights limits the speed of a network: prefetch the next rows while the current ones
 * are used. */
#if PANDIS__VECTOR > 1
#define PANDIS__FETCH(p) __builtin_prefetch(p)
#else
#define PANDIS__FETCH(p) ((void)(p))
#endif

/* Define a function for 32-bit and for 16-bit weights. */
#define PANDIS__KINDS(make)                                                                        \
    PANDIS__TWICE(make(pandis__load, float, f_plain, static)                                       \
                      make(pandis__load16, int16_t, h_plain, static),                              \
        make(pandis__load, float, f_wide, PANDIS__WIDE static)                                     \
            make(pandis__load16_wide, int16_t, h_wide, PANDIS__WIDE static))

/* out <- out + the sum over rows of h[i] * weights[i], four rows at once. */
#define PANDIS__ADD(load, type, tail, how)                                                         \
    how void pandis__add_##tail(const type *w, const float *h, int rows, int stride, float *out) { \
        int i = 0;                                                                                 \
        for (; i + 4 <= rows; i += 4, w += 4 * (ptrdiff_t)stride) {                                \
            float a = h[i], b = h[i + 1], c = h[i + 2], d = h[i + 3];                              \
            const type *next = i + 8 <= rows ? w + 4 * (ptrdiff_t)stride : w;                      \
            for (int j = 0; j < stride; j += PANDIS__VECTOR) {                                     \
                for (int r = 0; r < 4; r++) PANDIS__FETCH(next + r * (ptrdiff_t)stride + j);       \
                pandis__vector sum = pandis__load(out + j) +                                       \
                    ((a * load(w + j) + b * load(w + stride + j)) +                                \
                        (c * load(w + 2 * (ptrdiff_t)stride + j) +                                 \
                            d * load(w + 3 * (ptrdiff_t)stride + j)));                             \
                memcpy(out + j, &sum, sizeof sum);                                                 \
            }                                                                                      \
        }                                                                                          \
        for (; i < rows; i++, w += stride)                                                         \
            for (int j = 0; j < stride; j++) out[j] += h[i] * (float)w[j];                         \
    }
PANDIS__KINDS(PANDIS__ADD)

/* The same for four points, whose h and out are `stride` apart: sums stay in registers, and each
 * weight is read once for all four. The order of additions is the same as above. */
#define PANDIS__ADD_FOUR(load, type, tail, how)                                                    \
    how void pandis__add_four_##tail(                                                              \
        const type *w, const float *h, int rows, int stride, float *out) {                         \
        for (int j = 0; j < stride; j += PANDIS__LANES) {                                          \
            pandis__vector sum[4][PANDIS__PARTS];                                                  \
            const type *row = w + j;                                                               \
            int i = 0;                                                                             \
            for (int p = 0; p < 4; p++)                                                            \
                for (int k = 0; k < PANDIS__PARTS; k++)                                            \
                    sum[p][k] =                                                                    \
                        pandis__load(out + p * (ptrdiff_t)stride + j + k * PANDIS__VECTOR);        \
            for (; i + 4 <= rows; i += 4, row += 4 * (ptrdiff_t)stride)                            \
                for (int k = 0; k < PANDIS__PARTS; k++) {                                          \
                    const type *at = row + k * PANDIS__VECTOR;                                     \
                    pandis__vector w0 = load(at), w1 = load(at + stride),                          \
                                   w2 = load(at + 2 * (ptrdiff_t)stride),                          \
                                   w3 = load(at + 3 * (ptrdiff_t)stride);                          \
                    for (int p = 0; p < 4; p++) {                                                  \
                        const float *x = h + p * (ptrdiff_t)stride + i;                            \
                        sum[p][k] =                                                                \
                            sum[p][k] + ((x[0] * w0 + x[1] * w1) + (x[2] * w2 + x[3] * w3));       \
                    }                                                                              \
                }                                                                                  \
            for (; i < rows; i++, row += stride)                                                   \
                for (int p = 0; p < 4; p++)                                                        \
                    for (int k = 0; k < PANDIS__PARTS; k++)                                        \
                        sum[p][k] = sum[p][k] +                                                    \
                            h[p * (ptrdiff_t)stride + i] * load(row + k * PANDIS__VECTOR);         \
            for (int p = 0; p < 4; p++)                                                            \
                memcpy(out + p * (ptrdiff_t)stride + j, sum[p], sizeof sum[p]);                    \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__ADD_FOUR)

/* Sum the lanes of four sums by halves. */
PANDIS__INLINE void pandis__fold(float (*lanes)[PANDIS__LANES], float *out) {
    for (int n = PANDIS__LANES / 2; n; n /= 2)
        for (int r = 0; r < 4; r++)
            for (int k = 0; k < n; k++) lanes[r][k] += lanes[r][k + n];
    for (int r = 0; r < 4; r++) out[r] = lanes[r][0];
}

/* out[i] <- the product of row i and y, each summed in PANDIS__LANES lanes, four rows at once. */
#define PANDIS__DOT(load, type, tail, how)                                                         \
    how void pandis__dots_##tail(                                                                  \
        const type *w, const float *y, int rows, int stride, float *out) {                         \
        for (int i = 0; i < rows; i += 4) {                                                        \
            const type *row[4];                                                                    \
            ptrdiff_t next = i + 8 <= rows ? 4 * (ptrdiff_t)stride : 0;                            \
            pandis__vector sum[4][PANDIS__PARTS];                                                  \
            float lanes[4][PANDIS__LANES], four[4];                                                \
            memset(sum, 0, sizeof sum);                                                            \
            for (int r = 0; r < 4; r++)                                                            \
                row[r] = w + (ptrdiff_t)(i + r < rows ? i + r : i) * stride;                       \
            for (int j = 0; j < stride; j += PANDIS__LANES)                                        \
                for (int k = 0; k < PANDIS__PARTS; k++) {                                          \
                    pandis__vector v = pandis__load(y + j + k * PANDIS__VECTOR);                   \
                    for (int r = 0; r < 4; r++)                                                    \
                        PANDIS__FETCH(row[r] + next + j + k * PANDIS__VECTOR);                     \
                    for (int r = 0; r < 4; r++)                                                    \
                        sum[r][k] += load(row[r] + j + k * PANDIS__VECTOR) * v;                    \
                }                                                                                  \
            memcpy(lanes, sum, sizeof lanes);                                                      \
            pandis__fold(lanes, four);                                                             \
            for (int r = 0; r < 4 && i + r < rows; r++) out[i + r] = four[r];                      \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__DOT)

/* out[p][i] <- the product of row i and y of point p, for four points `stride` apart. */
#define PANDIS__DOT_FOUR(load, type, tail, how)                                                    \
    how void pandis__dots_four_##tail(                                                             \
        const type *w, const float *y, int rows, int stride, float *out, int apart) {              \
        for (int i = 0; i < rows; i++, w += stride) {                                              \
            pandis__vector sum[4][PANDIS__PARTS];                                                  \
            float lanes[4][PANDIS__LANES], four[4];                                                \
            memset(sum, 0, sizeof sum);                                                            \
            for (int j = 0; j < stride; j += PANDIS__LANES)                                        \
                for (int k = 0; k < PANDIS__PARTS; k++) {                                          \
                    pandis__vector v = load(w + j + k * PANDIS__VECTOR);                           \
                    for (int p = 0; p < 4; p++)                                                    \
                        sum[p][k] +=                                                               \
                            v * pandis__load(y + p * (ptrdiff_t)stride + j + k * PANDIS__VECTOR);  \
                }                                                                                  \
            memcpy(lanes, sum, sizeof lanes);                                                      \
            pandis__fold(lanes, four);                                                             \
            for (int p = 0; p < 4; p++) out[p * (ptrdiff_t)apart + i] = four[p];                   \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__DOT_FOUR)

/* Call one of the above, for one point or for four. */
#define PANDIS__EITHER(load, type, tail, how)                                                      \
    how void pandis__sums_##tail(                                                                  \
        const type *w, const float *h, int rows, int stride, float *out, int count) {              \
        if (count == 4) pandis__add_four_##tail(w, h, rows, stride, out);                          \
        else pandis__add_##tail(w, h, rows, stride, out);                                          \
    }                                                                                              \
    how void pandis__products_##tail(                                                              \
        const type *w, const float *y, int rows, int stride, float *out, int apart, int count) {   \
        if (count == 4) pandis__dots_four_##tail(w, y, rows, stride, out, apart);                  \
        else pandis__dots_##tail(w, y, rows, stride, out);                                         \
    }
PANDIS__KINDS(PANDIS__EITHER)

#define PANDIS__ROOM (PANDIS__ROWS * (PANDIS_MOST_DEPTH + 2))

/* Number of rows of memory that a network needs per point: a layer's input, its output, and slopes
 * (of every layer if the normal is the gradient). */
static int pandis__rows(const pandis__network *n) { return n->outputs == 1 ? n->depth + 2 : 3; }

/* Whether four points at a time fit into the memory that one point of the largest network needs. */
static int pandis__fits_four(const pandis__network *n) {
    return 4 * (ptrdiff_t)n->stride * pandis__rows(n) <= PANDIS__ROOM;
}

/* Go back through a network with one output: compute its gradients, stored 4 numbers apart, from
 * the slopes of its sines. `h` and `z` each have room for one layer of all points. */
PANDIS__INLINE void pandis__network_gradient(
    const pandis__network *n, int count, const float *slopes, float *h, float *z, float *gradient) {
    int stride = n->stride;
    ptrdiff_t all = (ptrdiff_t)count * stride;
    for (int p = 0; p < count; p++)
        for (int j = 0; j < stride; j++)
            h[p * (ptrdiff_t)stride + j] =
                n->last[j] * slopes[(n->depth - 1) * all + p * (ptrdiff_t)stride + j];
    for (int layer = n->depth - 1; layer > 0; layer--) {
        ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
        const float *slope = slopes + (layer - 1) * all;
        if (n->hidden)
            PANDIS__CHOOSE(pandis__products_f)(
                n->hidden + at * stride, h, n->width, stride, z, stride, count);
        else
            PANDIS__CHOOSE(pandis__products_h)(
                n->hidden16 + at * stride, h, n->width, stride, z, stride, count);
        for (int p = 0; p < count; p++, z += stride, slope += stride) {
            for (int i = 0; i < n->width; i++)
                z[i] *= n->hidden ? slope[i] : n->scales[at + i] * slope[i];
            for (int i = n->width; i < stride; i++) z[i] = 0;
        }
        z -= all;
        float *swap = h;
        h = z, z = swap;
    }
    PANDIS__CHOOSE(pandis__products_f)(n->first, h, 3, stride, gradient, 4, count);
}

/* Evaluate x -> sin(W x + b) ... -> phi and psi, or phi and its gradient; w0 is folded into W and
 * b. Four points share one pass over the weights; the answers are the same as for single points. If
 * normals are NULL, no gradient is computed. */
PANDIS__INLINE void pandis__answer_network_body(const pandis__network *n, int count, double (*u)[3],
    double *distance, double (*normal)[3], pandis_flag *flag) {
    float room[PANDIS__ROOM], result[4][4] = {{0}};
    double inside[4][3], outside[4];
    int stride = n->stride, own = n->outputs == 1;
    ptrdiff_t all = (ptrdiff_t)count * stride;
    float *h = room, *z = room + all, *slopes = z + all;
    room[0] = 0; /* also written below, which gcc for Windows does not see */
    for (int p = 0; p < count; p++) {
        outside[p] = pandis__clamp(u[p], inside[p]);
        for (int k = 0; k < 3; k++) h[p * (ptrdiff_t)stride + k] = (float)inside[p][k];
    }
    for (int layer = 0; layer < n->depth; layer++) {
        const float *bias = n->biases + (ptrdiff_t)layer * stride;
        float *slope = slopes + (own ? layer * all : 0);
        ptrdiff_t at = (ptrdiff_t)(layer - 1) * n->width;
        for (ptrdiff_t j = 0; j < all; j++) z[j] = 0;
        if (layer > 0 && n->hidden16)
            for (int p = 0; p < count; p++)
                for (int i = 0; i < n->width; i++)
                    h[p * (ptrdiff_t)stride + i] *= n->scales[at + i];
        if (layer == 0) PANDIS__CHOOSE(pandis__sums_f)(n->first, h, 3, stride, z, count);
        else if (n->hidden)
            PANDIS__CHOOSE(pandis__sums_f)(n->hidden + at * stride, h, n->width, stride, z, count);
        else
            PANDIS__CHOOSE(pandis__sums_h)(
                n->hidden16 + at * stride, h, n->width, stride, z, count);
        for (int p = 0; p < count; p++, z += stride, slope += stride)
            for (int j = 0; j < stride; j++) pandis__sine_cosine(z[j] + bias[j], z + j, slope + j);
        z -= all;
        float *swap = h;
        h = z, z = swap;
    }
    PANDIS__CHOOSE(pandis__products_f)(n->last, h, n->outputs, stride, result[0], 4, count);
    for (int p = 0; p < count; p++) {
        for (int k = 0; k < n->outputs; k++)
            result[p][k] += n->biases[(ptrdiff_t)n->depth * stride + k];
        distance[p] = (double)result[p][0];
        for (int k = 0; k < 3 && normal && !own; k++) normal[p][k] = (double)result[p][k + 1];
    }
    if (own && normal) {
        pandis__network_gradient(n, count, slopes, h, z, result[0]);
        for (int p = 0; p < count; p++)
            for (int k = 0; k < 3; k++) normal[p][k] = (double)result[p][k];
    }
    for (int p = 0; p < count; p++) {
        if (n->base.size) {
            double more, slope[3];
            pandis__cubic(&n->base, inside[p], &more, slope);
            distance[p] += more;
            for (int k = 0; k < 3 && normal; k++) normal[p][k] += slope[k];
        }
        distance[p] += outside[p];
        flag[p] = outside[p] > 0 ? PANDIS_BOUND : PANDIS_OK;
    }
}

PANDIS__COMPILE(pandis__answer_network,
    (const pandis__network *n, int count, double (*u)[3], double *distance, double (*normal)[3],
        pandis_flag *flag),
    (n, count, u, distance, normal, flag))

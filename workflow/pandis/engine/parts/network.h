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

/* The same for several points, whose h and out are `stride` apart: sums stay in registers, and each
 * weight is read once for all points. The order of additions is the same as above. */
#define PANDIS__ADD_MANY(load, type, tail, how)                                                    \
    PANDIS__ALWAYS how void pandis__add_many_##tail(                                               \
        const type *w, const float *h, int rows, int stride, float *out, const int points) {       \
        for (int j = 0; j < stride; j += PANDIS__VECTOR) {                                         \
            pandis__vector sum[PANDIS__POINTS];                                                    \
            const type *row = w + j;                                                               \
            int i = 0;                                                                             \
            for (int p = 0; p < points; p++)                                                       \
                sum[p] = pandis__load(out + p * (ptrdiff_t)stride + j);                            \
            for (; i + 4 <= rows; i += 4, row += 4 * (ptrdiff_t)stride) {                          \
                pandis__vector w0 = load(row), w1 = load(row + stride),                            \
                               w2 = load(row + 2 * (ptrdiff_t)stride),                             \
                               w3 = load(row + 3 * (ptrdiff_t)stride);                             \
                for (int p = 0; p < points; p++) {                                                 \
                    const float *x = h + p * (ptrdiff_t)stride + i;                                \
                    sum[p] = sum[p] + ((x[0] * w0 + x[1] * w1) + (x[2] * w2 + x[3] * w3));         \
                }                                                                                  \
            }                                                                                      \
            for (; i < rows; i++, row += stride)                                                   \
                for (int p = 0; p < points; p++)                                                   \
                    sum[p] = sum[p] + h[p * (ptrdiff_t)stride + i] * load(row);                    \
            for (int p = 0; p < points; p++)                                                       \
                memcpy(out + p * (ptrdiff_t)stride + j, sum + p, sizeof sum[p]);                   \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__ADD_MANY)

/* Sum the lanes of four sums by halves: k and k + 8, then k and k + 4, k and k + 2, k and k + 1. */
PANDIS__INLINE void pandis__fold(float (*lanes)[PANDIS__LANES], float *out) {
#if PANDIS__VECTOR > 1
    pandis__quad l[4][4], four[4];
    memcpy(l, lanes, sizeof l);
    for (int r = 0; r < 4; r++) four[r] = (l[r][0] + l[r][2]) + (l[r][1] + l[r][3]);
    pandis__quad two =
        PANDIS__PICK(four[0], four[1], 0, 1, 4, 5) + PANDIS__PICK(four[0], four[1], 2, 3, 6, 7);
    pandis__quad other =
        PANDIS__PICK(four[2], four[3], 0, 1, 4, 5) + PANDIS__PICK(four[2], four[3], 2, 3, 6, 7);
    two = PANDIS__PICK(two, other, 0, 2, 4, 6) + PANDIS__PICK(two, other, 1, 3, 5, 7);
    memcpy(out, &two, sizeof two);
#else
    for (int r = 0; r < 4; r++) {
        for (int n = PANDIS__LANES / 2; n; n /= 2)
            for (int k = 0; k < n; k++) lanes[r][k] += lanes[r][k + n];
        out[r] = lanes[r][0];
    }
#endif
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

/* out[p][i] <- the product of row i and y of point p, for several points `stride` apart. Four
 * points take two rows at once, because eight sums keep the arithmetic units busy. */
#define PANDIS__DOT_MANY(load, type, tail, how)                                                    \
    PANDIS__ALWAYS how void pandis__dots_many_##tail(const type *w, const float *y, int rows,      \
        int stride, float *out, int apart, const int points) {                                     \
        for (int i = 0; i < rows; i += PANDIS__POINTS / points) {                                  \
            float lanes[PANDIS__POINTS][PANDIS__LANES], sums[PANDIS__POINTS];                      \
            const type *row = w + (ptrdiff_t)i * stride;                                           \
            ptrdiff_t next = i + 1 < rows ? stride : 0;                                            \
            for (int k = 0; k < PANDIS__LANES; k += PANDIS__VECTOR) {                              \
                pandis__vector sum[PANDIS__POINTS];                                                \
                memset(sum, 0, sizeof sum);                                                        \
                for (int j = k; j < stride; j += PANDIS__LANES)                                    \
                    for (int r = 0; r < PANDIS__POINTS; r += points) {                             \
                        pandis__vector v = load(row + (r ? next : 0) + j);                         \
                        for (int p = 0; p < points; p++)                                           \
                            sum[r + p] += v * pandis__load(y + p * (ptrdiff_t)stride + j);         \
                    }                                                                              \
                for (int p = 0; p < PANDIS__POINTS; p++)                                           \
                    memcpy(lanes[p] + k, sum + p, sizeof sum[p]);                                  \
            }                                                                                      \
            for (int p = 0; p < PANDIS__POINTS; p += 4) pandis__fold(lanes + p, sums + p);         \
            for (int r = 0; r < PANDIS__POINTS && i + r / points < rows; r += points)              \
                for (int p = 0; p < points; p++)                                                   \
                    out[p * (ptrdiff_t)apart + i + r / points] = sums[r + p];                      \
        }                                                                                          \
    }
PANDIS__KINDS(PANDIS__DOT_MANY)

/* Call one of the above, for one, four or eight points. */
#define PANDIS__EITHER(load, type, tail, how)                                                      \
    how void pandis__sums_##tail(                                                                  \
        const type *w, const float *h, int rows, int stride, float *out, int count) {              \
        if (count == 8) pandis__add_many_##tail(w, h, rows, stride, out, 8);                       \
        else if (count == 4) pandis__add_many_##tail(w, h, rows, stride, out, 4);                  \
        else pandis__add_##tail(w, h, rows, stride, out);                                          \
    }                                                                                              \
    how void pandis__products_##tail(                                                              \
        const type *w, const float *y, int rows, int stride, float *out, int apart, int count) {   \
        if (count == 8) pandis__dots_many_##tail(w, y, rows, stride, out, apart, 8);               \
        else if (count == 4) pandis__dots_many_##tail(w, y, rows, stride, out, apart, 4);          \
        else pandis__dots_##tail(w, y, rows, stride, out);                                         \
    }
PANDIS__KINDS(PANDIS__EITHER)

#define PANDIS__ROOM (PANDIS__ROWS * (PANDIS_MOST_DEPTH + 2))

/* Number of rows of memory that a network needs per point: a layer's input, its output, and slopes
 * (of every layer if the normal is the gradient). */
static int pandis__rows(const pandis__network *n) { return n->outputs == 1 ? n->depth + 2 : 3; }

/* Number of points to evaluate together, of so many that are left: 8, 4 or 1. They must fit into
 * the memory that one point of the largest network needs. */
static size_t pandis__points_at_once(const pandis__network *n, size_t left) {
    size_t fit = PANDIS__ROOM / ((size_t)n->stride * (size_t)pandis__rows(n));
    size_t most = fit < left ? fit : left;
    return most >= 8 ? 8 : most >= 4 ? 4 : 1;
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
 * b. Four or eight points share one pass over the weights; the answers are the same as for single
 * points. If normals are NULL, no gradient is computed. */
PANDIS__INLINE void pandis__answer_network_body(const pandis__network *n, int count, double (*u)[3],
    double *distance, double (*normal)[3], pandis_flag *flag) {
    float room[PANDIS__ROOM], result[PANDIS__POINTS][4] = {{0}};
    double inside[PANDIS__POINTS][3], outside[PANDIS__POINTS];
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
        for (ptrdiff_t j = 0; j < all; j += PANDIS__LANES)
            pandis__sines(z + j, bias + j % stride, slope + j);
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

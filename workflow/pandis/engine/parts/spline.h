/* -------------------- banded splines */

/* Restore stored coefficients, four at a time: coarse or far ones, and fine ones. */
#ifdef PANDIS__FOUR_AT_ONCE
typedef int16_t pandis__four_shorts __attribute__((vector_size(8), aligned(2), may_alias));
typedef int8_t pandis__four_bytes __attribute__((vector_size(4), aligned(1), may_alias));
typedef int32_t pandis__four_ints __attribute__((vector_size(16)));
#define PANDIS__RESTORE(type, vector, tail)                                                        \
    PANDIS__INLINE void pandis__restore_##tail(                                                    \
        const type *stored, double offset, double scale, float *c) {                               \
        pandis__four_ints whole =                                                                  \
            __builtin_convertvector(*(const vector *)stored, pandis__four_ints);                   \
        *(pandis__four_floats *)c = __builtin_convertvector(                                       \
            offset + scale * __builtin_convertvector(whole, pandis__four), pandis__four_floats);   \
    }
#else
#define PANDIS__RESTORE(type, vector, tail)                                                        \
    PANDIS__INLINE void pandis__restore_##tail(                                                    \
        const type *stored, double offset, double scale, float *c) {                               \
        for (int i = 0; i < 4; i++) c[i] = (float)(offset + scale * (double)stored[i]);            \
    }
#endif
PANDIS__RESTORE(int16_t, pandis__four_shorts, coarse)
PANDIS__RESTORE(int8_t, pandis__four_bytes, fine)

/* Collect the 64 coefficients around a point, block by block; blocks that are not stored give
 * zeros. Returns whether any block is stored; for the coarse lattice, which is useless if
 * incomplete, whether all are. */
PANDIS__INLINE int pandis__collect(const pandis__spline *s, int level, const int *first, float *c) {
    const pandis__layout *l = s->layout + level;
    int found = 0, low[3], blocks[3];
    double offset = s->offset[level], scale = s->scale[level];
    float room[6][6][6], own[8]; /* two or three blocks per axis */
    memset(room, 0, sizeof room);
    for (int k = 0; k < 3; k++)
        low[k] = first[k] >> 1, blocks[k] = ((first[k] + 3) >> 1) - low[k] + 1;
    for (int i = 0; i < blocks[0]; i++)
        for (int j = 0; j < blocks[1]; j++) {
            int bx = low[0] + i, by = low[1] + j, within = ((bx & 3) << 4) | ((by & 3) << 2);
            const uint16_t *row =
                l->brick + ((ptrdiff_t)(bx >> 2) * l->bricks + (by >> 2)) * l->bricks;
            float *line = room[2 * i][2 * j];
            for (int k = 0; k < blocks[2]; k++, line += 2) {
                int bz = low[2] + k;
                int32_t at = pandis__block_of(l, row[bz >> 2], within | (bz & 3));
                if (at < 0 && level == 0) return 0;
                if (at < 0) continue;
                found = 1;
                for (int e = 0; e < 8; e += 4) {
                    if (level) pandis__restore_fine(s->fine + at + e, offset, scale, own + e);
                    else pandis__restore_coarse(s->coarse + at + e, offset, scale, own + e);
                    memcpy(line + 9 * e, own + e, 2 * sizeof *own); /* strides: 36 in x, 6 in y */
                    memcpy(line + 9 * e + 6, own + e + 2, 2 * sizeof *own);
                }
            }
        }
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(c + 16 * x + 4 * y, &room[x + (first[0] & 1)][y + (first[1] & 1)][first[2] & 1],
                4 * sizeof *c);
    return found;
}

/* Add one level's value and gradient; returns what pandis__collect does. With a cache `cells` of
 * this spline, coefficients around recent points are not collected again. */
PANDIS__INLINE int pandis__add_level(const pandis__spline *s, int level, const double *p,
    pandis__cells *cells, double *value, double *gradient) {
    const pandis__layout *l = s->layout + level;
    int first[3], known = 0;
    double w[3][4], dw[3][4];
    float room[64], *c = room;
    if (!pandis__place(l->size, l->low, l->per_step, p, first, w, dw)) return 0;
    int at = (first[0] & 7) << 6 | (first[1] & 7) << 3 | (first[2] & 7);
    if (cells) {
        c = cells->cell[level][at].c;
        if (!memcmp(cells->cell[level][at].first, first, sizeof first))
            known = cells->cell[level][at].known;
    }
    if (!known) {
        known = pandis__collect(s, level, first, c) + 1;
        if (cells)
            memcpy(cells->cell[level][at].first, first, sizeof first),
                cells->cell[level][at].known = known;
    }
    if (known > 1) pandis__tensor(c, w, dw, value, gradient);
    return known - 1;
}

/* Where two walls are about equally near, a spline rounds the crease between them: its gradient is
 * shorter than 1. The distance is linear towards the nearest wall. Therefore the spline is
 * evaluated nearer to that wall, where less is rounded, and its value is extrapolated back. */
#define PANDIS__LIFT 0.7   /* largest shift, in steps of the coarse lattice */
#define PANDIS__SHORT 0.02 /* smallest deficit of the squared gradient */

PANDIS__INLINE void pandis__sharpen(const pandis__spline *s, const double *p, pandis__cells *cells,
    double *value, double *gradient) {
    double missing = (1 - pandis__dot(gradient, gradient) - PANDIS__SHORT) / (1 - PANDIS__SHORT);
    if (!(missing > 0 && *value < 0)) return;
    double lift = PANDIS__LIFT / s->layout[0].per_step, q[3], found = 0, normal[3] = {0};
    lift = (lift < -*value ? lift : -*value) * missing * missing * (3 - 2 * missing);
    for (int k = 0; k < 3; k++) q[k] = p[k] + lift * gradient[k];
    if (!pandis__add_level(s, 0, q, cells, &found, normal)) return;
    pandis__add_level(s, 1, q, cells, &found, normal);
    double slope = sqrt(pandis__dot(gradient, gradient));
    if (!(slope > PANDIS__TINY) || !pandis__normalise(normal)) return;
    *value = found - lift * pandis__dot(gradient, normal);
    for (int k = 0; k < 3; k++) gradient[k] = slope * normal[k]; /* its length does not change */
}

PANDIS__INLINE void pandis__answer_spline_body(const pandis__spline *s, const double *u,
    pandis__cells *cells, double *distance, double *normal, pandis_flag *flag) {
    double p[3], outside = pandis__clamp(u, p), value = 0, gradient[3] = {0};
    for (int k = 0; k < 3; k++)
        p[k] = p[k] < -PANDIS__EDGE ? -PANDIS__EDGE : p[k] > PANDIS__EDGE ? PANDIS__EDGE : p[k];
    *flag = PANDIS_OK;
    if (outside > 0 || !pandis__add_level(s, 0, p, cells, &value, gradient)) {
        int first[3];
        double w[3][4], dw[3][4];
        float c[64];
        value = gradient[0] = gradient[1] = gradient[2] = 0;
        if (pandis__place(s->far_size, s->far_low, s->far_per_step, p, first, w, dw)) {
            for (int i = 0; i < 64; i += 4) {
                ptrdiff_t x = first[0] + (i >> 4), y = first[1] + (i >> 2 & 3);
                const int16_t *stored = s->far + (x * s->far_size + y) * s->far_size + first[2];
                pandis__restore_coarse(stored, s->offset[2], s->scale[2], c + i);
            }
            pandis__tensor(c, w, dw, &value, gradient);
        }
        const pandis__layout *l = s->layout;
        ptrdiff_t block[3], count = 4 * (ptrdiff_t)l->bricks;
        for (int k = 0; k < 3; k++) {
            double cell =
                floor(((p[k] - l->low) * l->per_step < l->size - 2 ? (p[k] - l->low) * l->per_step
                                                                   : l->size - 2) /
                    2);
            block[k] = cell > 0 ? (ptrdiff_t)cell : 0;
        }
        ptrdiff_t bit = (block[0] * count + block[1]) * count + block[2];
        if ((s->side[bit >> 3] >> (7 - (bit & 7)) & 1) || outside > 0)
            value = (value > s->outside ? value : s->outside) + outside;
        else value = value < -s->inside ? value : -s->inside;
        *flag = PANDIS_BOUND;
    } else {
        pandis__add_level(s, 1, p, cells, &value, gradient);
        pandis__sharpen(s, p, cells, &value, gradient);
    }
    *distance = value;
    memcpy(normal, gradient, sizeof gradient);
}

PANDIS__COMPILE(pandis__answer_spline,
    (const pandis__spline *s, const double *u, pandis__cells *cells, double *distance,
        double *normal, pandis_flag *flag),
    (s, u, cells, distance, normal, flag))

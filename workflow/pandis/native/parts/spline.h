/* ---------------------------------------------------------------- banded splines */

/* Coefficients from what is stored of them. */
static void pandis__restore(const pandis__spline *s, int level, const int32_t *stored, int count, float *c) {
    double offset = s->offset[level], scale = s->scale[level];
    for (int i = 0; i < count; i++) c[i] = (float)(offset + scale * (double)stored[i]);
}

/* The 64 coefficients around a point, block by block; what is not kept is zero. Tells how much is kept: 0
 * nothing, 1 some of it, 2 everything. */
static int pandis__collect(const pandis__spline *s, int level, const int *first, float *c) {
    const pandis__layout *l = s->layout + level;
    int found = 0, missing = 0, blocks[3];
    float room[6][6][6]; /* two or three blocks of an axis */
    for (int k = 0; k < 3; k++) blocks[k] = ((first[k] + 3) >> 1) - (first[k] >> 1) + 1;
    for (int i = 0; i < blocks[0]; i++)
        for (int j = 0; j < blocks[1]; j++)
            for (int k = 0; k < blocks[2]; k++) {
                int32_t at = pandis__block(l, (first[0] >> 1) + i, (first[1] >> 1) + j, (first[2] >> 1) + k);
                float own[8] = {0};
                if (at >= 0) {
                    int32_t stored[8];
                    if (level)
                        for (int e = 0; e < 8; e++) stored[e] = s->fine[at + e];
                    else
                        for (int e = 0; e < 8; e++) stored[e] = s->coarse[at + e];
                    pandis__restore(s, level, stored, 8, own);
                    found = 1;
                } else {
                    missing = 1;
                }
                for (int e = 0; e < 4; e++)
                    memcpy(&room[2 * i + (e >> 1)][2 * j + (e & 1)][2 * k], own + 2 * e, 2 * sizeof *own);
            }
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(c + 16 * x + 4 * y, &room[x + (first[0] & 1)][y + (first[1] & 1)][first[2] & 1], 4 * sizeof *c);
    return found ? 2 - missing : 0;
}

/* Add one level's value and gradient; tells how much of it is kept. */
static int pandis__add_level(const pandis__spline *s, int level, const double *p, double *value, double *gradient) {
    const pandis__layout *l = s->layout + level;
    int first[3], kept;
    double w[3][4], dw[3][4];
    float c[64];
    if (!pandis__place(l->size, l->low, l->per_step, p, first, w, dw)) return 0;
    kept = pandis__collect(s, level, first, c);
    if (kept) pandis__tensor(c, w, dw, value, gradient);
    return kept;
}

/* Where two walls are about equally near a spline rounds the crease between them, which shows in a
 * gradient shorter than 1. The field is linear along the way to the nearest wall, so the answer
 * is taken some way up, where less is rounded, and carried back down. */
#define PANDIS__LIFT 0.7    /* in steps of the coarse lattice, at most */
#define PANDIS__SHORT 0.02  /* how much of the squared gradient must be missing */

static void pandis__sharpen(const pandis__spline *s, const double *p, double *value, double *gradient) {
    double missing = (1 - pandis__dot(gradient, gradient) - PANDIS__SHORT) / (1 - PANDIS__SHORT);
    if (!(missing > 0 && *value < 0)) return;
    double lift = PANDIS__LIFT / s->layout[0].per_step, q[3], found = 0, normal[3] = {0};
    lift = (lift < -*value ? lift : -*value) * missing * missing * (3 - 2 * missing);
    for (int k = 0; k < 3; k++) q[k] = p[k] + lift * gradient[k];
    if (pandis__add_level(s, 0, q, &found, normal) < 2) return;
    pandis__add_level(s, 1, q, &found, normal);
    double slope = sqrt(pandis__dot(gradient, gradient));
    if (!(slope > PANDIS__TINY) || !pandis__normalise(normal)) return;
    *value = found - lift * pandis__dot(gradient, normal);
    for (int k = 0; k < 3; k++) gradient[k] = slope * normal[k]; /* as long as it was */
}

PANDIS__APART static int pandis__answer_spline(const pandis__spline *s, const double *u, double *distance, double *normal) {
    double p[3], outside = pandis__clamp(u, p), value = 0, gradient[3] = {0};
    for (int k = 0; k < 3; k++) p[k] = p[k] < -PANDIS__EDGE ? -PANDIS__EDGE : p[k] > PANDIS__EDGE ? PANDIS__EDGE : p[k];
    int kept = pandis__add_level(s, 0, p, &value, gradient), flag = PANDIS_OK;
    pandis__add_level(s, 1, p, &value, gradient);
    if (kept < 2 || outside > 0) {
        int first[3];
        int32_t stored[64];
        double w[3][4], dw[3][4];
        float c[64];
        value = gradient[0] = gradient[1] = gradient[2] = 0;
        if (pandis__place(s->far_size, s->far_low, s->far_per_step, p, first, w, dw)) {
            for (int i = 0; i < 64; i++) {
                ptrdiff_t x = first[0] + (i >> 4), y = first[1] + (i >> 2 & 3), z = first[2] + (i & 3);
                stored[i] = s->far[(x * s->far_size + y) * s->far_size + z];
            }
            pandis__restore(s, 2, stored, 64, c);
            pandis__tensor(c, w, dw, &value, gradient);
        }
        const pandis__layout *l = s->layout;
        ptrdiff_t block[3], count = 4 * (ptrdiff_t)l->bricks;
        for (int k = 0; k < 3; k++) {
            double cell = floor(((p[k] - l->low) * l->per_step < l->size - 2 ? (p[k] - l->low) * l->per_step : l->size - 2) / 2);
            block[k] = cell > 0 ? (ptrdiff_t)cell : 0;
        }
        ptrdiff_t bit = (block[0] * count + block[1]) * count + block[2];
        if ((s->side[bit >> 3] >> (7 - (bit & 7)) & 1) || outside > 0)
            value = (value > s->outside ? value : s->outside) + outside;
        else
            value = value < -s->inside ? value : -s->inside;
        flag = PANDIS_BOUND;
    } else {
        pandis__sharpen(s, p, &value, gradient);
    }
    *distance = value;
    memcpy(normal, gradient, sizeof gradient);
    return flag;
}


/* -------------------- grids */

enum { PANDIS__NEAREST, PANDIS__TRILINEAR, PANDIS__NORMAL, PANDIS__GRADIENT, PANDIS__TRICUBIC };

static const float *pandis__at(const pandis__grid *g, const int *i) {
    return g->nodes + (((ptrdiff_t)i[0] * g->size + i[1]) * g->size + i[2]) * g->channels;
}

static double pandis__mix(double a, double b, double t) { return a * (1 - t) + b * t; }

/* Find the corner values around a point, x slowest, and the point's position in its cell. */
static void pandis__corners(
    const pandis__grid *g, const double *p, const float **corner, double *t) {
    int first[3];
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - g->low[k]) * g->per_step[k], cell = floor(x);
        cell = cell < g->size - 2 ? cell : g->size - 2;
        first[k] = (int)cell, t[k] = x - cell;
    }
    for (int c = 0; c < 8; c++) {
        int i[3] = {first[0] + (c >> 2), first[1] + (c >> 1 & 1), first[2] + (c & 1)};
        corner[c] = pandis__at(g, i);
    }
}

static pandis_flag pandis__answer_grid(
    const pandis__grid *g, const double *u, double *distance, double *normal) {
    double p[3], t[3], value[4] = {0}, outside = pandis__clamp_to(g->low, g->high, u, p);
    const float *corner[8];
    int cell[3], force = g->rule == PANDIS__NEAREST || g->rule == PANDIS__TRILINEAR;
    if (g->rule == PANDIS__NEAREST) {
        int i[3];
        for (int k = 0; k < 3; k++) i[k] = (int)floor((p[k] - g->low[k]) * g->per_step[k] + 0.5);
        for (int k = 0; k < 3; k++) value[k + 1] = (double)pandis__at(g, i)[k];
    } else if (g->rule == PANDIS__TRICUBIC) {
        pandis__cubic(&g->cubic, p, value, value + 1);
    } else {
        pandis__corners(g, p, corner, t);
        for (int c = 0; c < g->channels; c++) {
            double line[4];
            for (int e = 0; e < 4; e++)
                line[e] = pandis__mix((double)corner[e][c], (double)corner[e + 4][c], t[0]);
            double low = pandis__mix(line[0], line[2], t[1]),
                   high = pandis__mix(line[1], line[3], t[1]);
            value[c + (force ? 1 : 0)] = pandis__mix(low, high, t[2]);
            if (g->rule != PANDIS__GRADIENT) continue;
            double rise[4];
            for (int e = 0; e < 4; e++) rise[e] = (double)corner[e + 4][c] - (double)corner[e][c];
            value[1] = g->per_step[0] *
                pandis__mix(
                    pandis__mix(rise[0], rise[2], t[1]), pandis__mix(rise[1], rise[3], t[1]), t[2]);
            value[2] = g->per_step[1] * pandis__mix(line[2] - line[0], line[3] - line[1], t[2]);
            value[3] = g->per_step[2] * pandis__mix(line[1] - line[0], line[3] - line[2], t[1]);
        }
    }
    if (force && outside > 0) memset(value, 0, sizeof value); /* the surface lies within the box */
    memcpy(normal, value + 1, 3 * sizeof *normal);
    *distance = force ? -sqrt(pandis__dot(normal, normal)) : value[0] + outside;
    int last = g->size - 2;
    for (int k = 0; k < 3; k++) {
        double x = (p[k] - g->low[k]) * g->per_step[k];
        cell[k] = x < last ? (int)x : last;
    }
    ptrdiff_t bit = ((ptrdiff_t)cell[0] * (last + 1) + cell[1]) * (last + 1) + cell[2];
    int covered = g->covered[bit >> 3] >> (7 - (bit & 7)) & 1;
    return covered && outside == 0 ? PANDIS_OK : PANDIS_BOUND;
}

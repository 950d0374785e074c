
/* -------------------- derivatives of the distance */

/* Finite-difference steps (unit frame): for gradients in single precision, for distances in single
 * precision, and for distances in double precision. */
#define PANDIS__STEP 1e-3
#define PANDIS__WIDE_STEP 4e-3
#define PANDIS__FINE_STEP 1e-4

/* Second derivatives of the weights of pandis__weigh. */
static void pandis__weigh_twice(double t, double per_step, double *ddw) {
    double square = per_step * per_step;
    ddw[0] = (1 - t) * square, ddw[1] = (3 * t - 2) * square, ddw[2] = (1 - 3 * t) * square,
    ddw[3] = t * square;
}

/* Add the second derivatives of the spline that has these 64 coefficients around a point. */
static void pandis__tensor_twice(
    const float *c, double (*w)[4], double (*dw)[4], double (*ddw)[4], double *hessian) {
    double h[3][3] = {{0}};
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            for (int z = 0; z < 4; z++) {
                double r = (double)c[16 * x + 4 * y + z];
                h[0][0] += r * ddw[0][x] * w[1][y] * w[2][z],
                    h[0][1] += r * dw[0][x] * dw[1][y] * w[2][z];
                h[1][1] += r * w[0][x] * ddw[1][y] * w[2][z],
                    h[0][2] += r * dw[0][x] * w[1][y] * dw[2][z];
                h[2][2] += r * w[0][x] * w[1][y] * ddw[2][z],
                    h[1][2] += r * w[0][x] * dw[1][y] * dw[2][z];
            }
    for (int i = 0; i < 9; i++) hessian[i] += i / 3 < i % 3 ? h[i / 3][i % 3] : h[i % 3][i / 3];
}

/* Find the cell of a point in a lattice, with all weights; returns 0 outside the lattice. */
static int pandis__place_twice(int32_t size, double low, double per_step, const double *p,
    int *first, double (*w)[4], double (*dw)[4], double (*ddw)[4]) {
    if (!pandis__place(size, low, per_step, p, first, w, dw)) return 0;
    for (int k = 0; k < 3; k++)
        pandis__weigh_twice((p[k] - low) * per_step - (first[k] + 1), per_step, ddw[k]);
    return 1;
}

/* Compute the derivatives of a spline in its band; returns 0 elsewhere, and where pandis__sharpen
 * changes the answer. */
static int pandis__bend_spline(
    const pandis__spline *s, const double *u, double *gradient, double *hessian) {
    double w[3][4], dw[3][4], ddw[3][4], value = 0;
    for (int k = 0; k < 3; k++)
        if (!(fabs(u[k]) < PANDIS__EDGE)) return 0;
    for (int level = 0; level < 2; level++) {
        const pandis__layout *l = s->layout + level;
        float c[64];
        int first[3], kept = 0;
        if (pandis__place_twice(l->size, l->low, l->per_step, u, first, w, dw, ddw))
            kept = pandis__collect(s, level, first, c);
        if (level == 0 && !kept) return 0;
        if (!kept) continue;
        pandis__tensor(c, w, dw, &value, gradient);
        pandis__tensor_twice(c, w, dw, ddw, hessian);
    }
    return !(value < 0 && 1 - pandis__dot(gradient, gradient) > PANDIS__SHORT);
}

/* Compute the derivatives of a distance grid; returns 0 outside its box. */
static int pandis__bend_grid(
    const pandis__grid *g, const double *u, double *gradient, double *hessian) {
    for (int k = 0; k < 3; k++)
        if (!(u[k] > g->low[k] && u[k] < g->high[k])) return 0;
    if (g->rule == PANDIS__TRICUBIC) {
        const pandis__lattice *l = &g->cubic;
        double w[3][4], dw[3][4], ddw[3][4], value = 0;
        float c[64];
        int first[3];
        if (!pandis__place_twice(l->size, l->low, l->per_step, u, first, w, dw, ddw)) return 0;
        pandis__gather(l->values, l->size, first, c);
        pandis__tensor(c, w, dw, &value, gradient);
        pandis__tensor_twice(c, w, dw, ddw, hessian);
        return 1;
    }
    const float *corner[8];
    double t[3];
    pandis__corners(g, u, corner, t);
    for (int i = 0; i < 8; i++) {
        double value = (double)corner[i][0], w[3], dw[3];
        for (int k = 0; k < 3; k++) {
            int high = i >> (2 - k) & 1;
            w[k] = high ? t[k] : 1 - t[k], dw[k] = high ? g->per_step[k] : -g->per_step[k];
        }
        for (int k = 0; k < 3; k++) {
            int a = (k + 1) % 3, b = (k + 2) % 3;
            gradient[k] += value * dw[k] * w[a] * w[b];
            hessian[3 * a + b] += value * w[k] * dw[a] * dw[b],
                hessian[3 * b + a] += value * w[k] * dw[a] * dw[b];
        }
    }
    return 1;
}

/* Compute the Hessian of the distance to a point or, if `along` is a unit vector, to a line; the
 * answer is in mesh units. */
static void pandis__bend_round(const pandis_answer *answer, const double *along, double *hessian) {
    for (int i = 0; i < 9; i++) {
        double rest = (i % 4 == 0) - answer->normal[i / 3] * answer->normal[i % 3];
        hessian[i] =
            answer->distance != 0 ? (rest - along[i / 3] * along[i % 3]) / answer->distance : 0;
    }
}

/* Compute the second derivatives of a closed form, which is locally flat, or round about a point or
 * a line. */
static void pandis__bend_shape(
    const pandis__shape *s, const double *p, const pandis_answer *answer, double *hessian) {
    double along[3] = {0, 0, 0};
    pandis_answer round = *answer;
    if (s->shape == PANDIS__BOX) { /* faces are flat; edges are lines; corners are points */
        int beyond[3], count = 0;
        for (int k = 0; k < 3; k++) count += beyond[k] = fabs(p[k]) > s->size[k];
        for (int k = 0; k < 3 && count == 2; k++) along[k] = !beyond[k];
        if (count > 1) pandis__bend_round(answer, along, hessian);
        return;
    }
    round.distance += s->size[s->shape == PANDIS__TORUS];
    if (s->shape == PANDIS__CAPSULE && fabs(p[2]) < s->size[1]) along[2] = 1;
    if (s->shape == PANDIS__TORUS) { /* round the tube, and round the axis */
        double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
        if (flat > PANDIS__TINY) along[0] = -p[1] / flat, along[1] = p[0] / flat;
    }
    pandis__bend_round(&round, along, hessian);
    if (s->shape != PANDIS__TORUS) return;
    double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
    double bend = flat > PANDIS__TINY
        ? (p[0] * answer->normal[0] + p[1] * answer->normal[1]) / (flat * flat)
        : 0;
    for (int i = 0; i < 9; i++) hessian[i] += bend * (along[i / 3] * along[i % 3]);
}

/* Query a point at an offset along an axis. */
static void pandis__query_beside(
    const pandis_field *field, const double *point, double step, int axis, pandis_answer *answer) {
    double beside[3] = {point[0], point[1], point[2]};
    beside[axis] += step;
    pandis_query(field, beside, answer);
}

/* Compute finite differences: of the answers' gradients if `own`, else of distances. */
static void pandis__differ(const pandis_field *field, const double *point, int own,
    const pandis_answer *here, double *gradient, double *hessian) {
    double step = own                   ? PANDIS__STEP
        : field->kind == PANDIS_NETWORK ? PANDIS__WIDE_STEP
                                        : PANDIS__FINE_STEP;
    step /= field->scale;
    pandis_answer high, low, corner[4];
    for (int i = 0; i < 3; i++) {
        pandis__query_beside(field, point, step, i, &high),
            pandis__query_beside(field, point, -step, i, &low);
        if (own) {
            gradient[i] = here->slope * here->normal[i];
            for (int k = 0; k < 3; k++) {
                double rise =
                    (high.slope * high.normal[k] - low.slope * low.normal[k]) / (4 * step);
                hessian[3 * i + k] += rise, hessian[3 * k + i] += rise;
            }
            continue;
        }
        gradient[i] = (high.distance - low.distance) / (2 * step);
        hessian[4 * i] = (high.distance - 2 * here->distance + low.distance) / (step * step);
        for (int k = i + 1; k < 3; k++) {
            for (int c = 0; c < 4; c++) {
                double beside[3] = {point[0], point[1], point[2]};
                beside[i] += c & 1 ? step : -step;
                pandis__query_beside(field, beside, c & 2 ? step : -step, k, corner + c);
            }
            double mixed =
                corner[3].distance - corner[2].distance - corner[1].distance + corner[0].distance;
            hessian[3 * i + k] = hessian[3 * k + i] = mixed / (4 * step * step);
        }
    }
}

PANDIS_API pandis_flag pandis_derivatives(
    const pandis_field *field, const double point[3], double gradient[3], double hessian[9]) {
    pandis__start begin = PANDIS__ANYWHERE;
    pandis_answer answer;
    double u[3] = {0, 0, 0}, own[3] = {0, 0, 0}, bend[9] = {0};
    int kind = field->kind, by_formula = 1;
    pandis__ask(field, point, &begin, NULL, &answer);
    if (kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR)
        answer.flag = PANDIS_INVALID;
    if (answer.flag == PANDIS_INVALID) {
        for (int i = 0; i < 3; i++) gradient[i] = (double)NAN;
        for (int i = 0; i < 9; i++) hessian[i] = (double)NAN;
        return PANDIS_INVALID;
    }
    pandis__unit(field, point, u);
    if (kind == PANDIS_MESH || kind == PANDIS_COMPACT) {
        if (begin.round && fabs(answer.distance) * field->scale > 1e-9)
            pandis__bend_round(&answer, begin.along, bend);
    } else if (kind == PANDIS_SHAPE) {
        pandis__bend_shape(&field->as.shape, point, &answer, bend);
    } else {
        if (answer.flag != PANDIS_OK || kind == PANDIS_NETWORK) by_formula = 0;
        else
            by_formula = kind == PANDIS_SPLINE
                ? pandis__bend_spline(&field->as.spline, u, own, bend)
                : pandis__bend_grid(&field->as.grid, u, own, bend);
        /* the scale is not squared, because distances are scaled, too */
        for (int i = 0; i < 9; i++) bend[i] *= field->scale;
    }
    if (kind == PANDIS_MESH || kind == PANDIS_COMPACT || kind == PANDIS_SHAPE)
        memcpy(own, answer.normal, sizeof own);
    if (!by_formula) {
        /* in the box, the normal of a network with one output is the gradient of its distance */
        int gradients =
            kind == PANDIS_NETWORK && field->as.network.outputs == 1 && answer.flag == PANDIS_OK;
        memset(bend, 0, sizeof bend);
        pandis__differ(field, point, gradients, &answer, own, bend);
    }
    memcpy(gradient, own, sizeof own), memcpy(hessian, bend, sizeof bend);
    return answer.flag;
}

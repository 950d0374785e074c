/* -------------------- queries */

PANDIS_API pandis_kind pandis_field_kind(const pandis_field *field) {
    return (pandis_kind)field->kind;
}

PANDIS_API size_t pandis_bytes(const pandis_field *field) { return field->size; }

PANDIS_API void pandis_bounds(const pandis_field *field, double low[3], double high[3]) {
    for (int k = 0; k < 3; k++) low[k] = high[k] = 0;
    for (int k = 0; field->kind && k < 3; k++) {
        low[k] = field->centre[k] + field->low[k] / field->scale;
        high[k] = field->centre[k] + field->high[k] / field->scale;
    }
}

PANDIS_API double pandis_longest_side(const pandis_field *field) {
    return field->kind ? PANDIS__LONGEST / field->scale : 0;
}

/* Transform a point into the unit frame; returns 0 if it is not finite, or too far away. */
static int pandis__unit(const pandis_field *field, const double *point, double *u) {
    int finite = 1;
    for (int k = 0; k < 3; k++) {
        u[k] = (point[k] - field->centre[k]) * field->scale;
        finite &= fabs(u[k]) < PANDIS__FAR;
    }
    return finite;
}

/* Convert a distance, a direction and a flag (unit frame) to an answer in mesh units. */
static void pandis__tell(const pandis_field *field, double d, double *n, double clear,
    pandis_flag flag, pandis_answer *answer) {
    if (flag != PANDIS_INVALID && !(fabs(d) <= 4e150 && pandis__dot(n, n) <= 1e300))
        flag = PANDIS_INVALID;
    if (flag == PANDIS_INVALID || flag == PANDIS_BEYOND) {
        answer->distance = answer->normal[0] = answer->normal[1] = answer->normal[2] = (double)NAN;
        answer->slope = (double)NAN;
        answer->clear = flag == PANDIS_BEYOND ? clear / field->scale : (double)NAN;
    } else {
        int forces = field->kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR;
        answer->slope = forces ? 0 : field->kind == PANDIS_SHAPE ? 1 : sqrt(pandis__dot(n, n));
        if (!pandis__normalise(n)) n[0] = n[1] = 0, n[2] = 1;
        answer->distance = d / field->scale;
        int mesh = field->kind == PANDIS_MESH || field->kind == PANDIS_COMPACT;
        answer->clear = mesh ? clear / field->scale : fabs(answer->distance);
        for (int k = 0; k < 3; k++) answer->normal[k] = n[k];
    }
    answer->flag = flag, answer->face = answer->region = -1;
}

/* Answer a query. `cells` is a cache for splines, used with this field only and all zero before its
 * first query; NULL: no cache. */
static void pandis__ask(const pandis_field *field, const double *point, pandis__start *begin,
    pandis__cells *cells, pandis_answer *answer) {
    double u[1][3], d = 0, n[1][3] = {{0}}, clear = 0;
    pandis_flag flag = PANDIS_INVALID;
    if (pandis__unit(field, point, u[0])) {
        switch (field->kind) {
        case PANDIS_NETWORK: pandis__answer_network(&field->as.network, 1, u, &d, n, &flag); break;
        case PANDIS_GRID: flag = pandis__answer_grid(&field->as.grid, u[0], &d, n[0]); break;
        case PANDIS_SPLINE:
            pandis__answer_spline(&field->as.spline, u[0], cells, &d, n[0], &flag);
            break;
        case PANDIS_MESH:
            flag = pandis__answer_mesh(&field->as.mesh, u[0], begin, &d, n[0], &clear);
            break;
        case PANDIS_COMPACT:
            flag = pandis__answer_compact(&field->as.compact, u[0], begin, &d, n[0], &clear);
            break;
        case PANDIS_SHAPE:
            pandis__answer_shape(&field->as.shape, point, &d, n[0]);
            d *= field->scale;
            flag = fabs(u[0][0]) <= 1 && fabs(u[0][1]) <= 1 && fabs(u[0][2]) <= 1 ? PANDIS_OK
                                                                                  : PANDIS_BOUND;
            break;
        default: break;
        }
    }
    pandis__tell(field, d, n[0], clear, flag, answer);
    if (answer->flag == PANDIS_INVALID || answer->flag == PANDIS_BEYOND) return;
    answer->face = begin->face;
    if (field->regions && begin->place >= 0) answer->region = field->regions[begin->place];
}

PANDIS_API void pandis_query(
    const pandis_field *field, const double point[3], pandis_answer *answer) {
    pandis__start begin = PANDIS__ANYWHERE;
    pandis__ask(field, point, &begin, NULL, answer);
}

PANDIS_API void pandis_query_within(
    const pandis_field *field, const double point[3], double reach, pandis_answer *answer) {
    pandis__start begin = PANDIS__WITHIN(reach >= 0 ? reach * field->scale : (double)INFINITY);
    pandis__ask(field, point, &begin, NULL, answer);
}

PANDIS_API pandis_flag pandis_distance(
    const pandis_field *field, const double point[3], double *distance) {
    pandis_answer answer;
    double u[1][3], d = 0, none[3] = {0, 0, 1};
    pandis_flag flag = PANDIS_INVALID;
    if (field->kind == PANDIS_NETWORK && field->as.network.outputs == 1) {
        if (pandis__unit(field, point, u[0]))
            pandis__answer_network(&field->as.network, 1, u, &d, NULL, &flag);
        pandis__tell(field, d, none, 0, flag, &answer);
    } else {
        pandis_query(field, point, &answer);
    }
    *distance = answer.distance;
    return answer.flag;
}

PANDIS_API pandis_flag pandis_force(
    const pandis_field *field, const double point[3], double stiffness, double force[3]) {
    pandis_answer answer;
    force[0] = force[1] = force[2] = 0;
    if (!(stiffness >= 0 && stiffness <= PANDIS__STIFFEST)) return PANDIS_INVALID;
    pandis_query(field, point, &answer);
    double push = answer.distance < 0 ? -stiffness * answer.distance : 0; /* false for NaN */
    for (int k = 0; k < 3; k++) force[k] = push > 0 ? push * answer.normal[k] : 0;
    return answer.flag;
}

/* Query several points of a network, reading every weight once. */
static void pandis__query_network(
    const pandis_field *field, const double *points, size_t count, pandis_answer *answers) {
    double u[PANDIS__POINTS][3], d[PANDIS__POINTS], n[PANDIS__POINTS][3];
    int finite[PANDIS__POINTS];
    pandis_flag flag[PANDIS__POINTS];
    for (size_t p = 0; p < count; p++) {
        finite[p] = pandis__unit(field, points + 3 * p, u[p]);
        for (int k = 0; k < 3 && !finite[p]; k++) u[p][k] = 0;
    }
    pandis__answer_network(&field->as.network, (int)count, u, d, n, flag);
    for (size_t p = 0; p < count; p++)
        pandis__tell(field, d[p], n[p], 0, finite[p] ? flag[p] : PANDIS_INVALID, answers + p);
}

PANDIS_API void pandis_query_many(const pandis_field *field, const double *points, size_t count,
    double *distances, double *normals, unsigned char *flags) {
    pandis_answer answers[PANDIS__POINTS];
    for (size_t i = 0, some; i < count; i += some) {
        some = field->kind == PANDIS_NETWORK ? pandis__points_at_once(&field->as.network, count - i)
                                             : 1;
        if (some > 1) pandis__query_network(field, points + 3 * i, some, answers);
        else pandis_query(field, points + 3 * i, answers);
        for (size_t k = 0; k < some; k++) {
            distances[i + k] = answers[k].distance;
            if (normals) memcpy(normals + 3 * (i + k), answers[k].normal, sizeof answers[k].normal);
            if (flags) flags[i + k] = (unsigned char)answers[k].flag;
        }
    }
}

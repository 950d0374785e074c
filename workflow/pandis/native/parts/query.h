/* ---------------------------------------------------------------- queries */

PANDIS_API int pandis_kind(const pandis_field *field) { return field->kind; }

PANDIS_API size_t pandis_bytes(const pandis_field *field) { return field->size; }

PANDIS_API void pandis_bounds(const pandis_field *field, double low[3], double high[3]) {
    for (int k = 0; k < 3; k++) low[k] = high[k] = 0;
    for (int k = 0; field->kind && k < 3; k++) {
        low[k] = field->centre[k] + field->low[k] / field->scale;
        high[k] = field->centre[k] + field->high[k] / field->scale;
    }
}

#define PANDIS__LONGEST 1.8 /* of the unit frame: a mesh is scaled so that its longest side is this */

PANDIS_API double pandis_longest_side(const pandis_field *field) {
    return field->kind ? PANDIS__LONGEST / field->scale : 0;
}

PANDIS_API void pandis_query(const pandis_field *field, const double point[3], pandis_answer *answer) {
    double u[3], d = 0, n[3] = {0};
    int flag = PANDIS_INVALID, finite = 1;
    for (int k = 0; k < 3; k++) {
        u[k] = (point[k] - field->centre[k]) * field->scale;
        finite &= fabs(u[k]) < PANDIS__FAR;
    }
    if (finite) {
        switch (field->kind) {
            case PANDIS_NETWORK: flag = pandis__answer_network(&field->as.network, u, &d, n); break;
            case PANDIS_GRID: flag = pandis__answer_grid(&field->as.grid, u, &d, n); break;
            case PANDIS_SPLINE: flag = pandis__answer_spline(&field->as.spline, u, &d, n); break;
            case PANDIS_MESH: flag = pandis__answer_mesh(&field->as.mesh, u, &d, n); break;
            case PANDIS_SHAPE:
                pandis__answer_shape(&field->as.shape, point, &d, n);
                d *= field->scale;
                flag = fabs(u[0]) <= 1 && fabs(u[1]) <= 1 && fabs(u[2]) <= 1 ? PANDIS_OK : PANDIS_BOUND;
                break;
            default: break;
        }
        if (!(fabs(d) <= 4e150 && pandis__dot(n, n) <= 1e300)) flag = PANDIS_INVALID;
    }
    if (flag == PANDIS_INVALID) {
        answer->distance = answer->normal[0] = answer->normal[1] = answer->normal[2] = (double)NAN;
        answer->slope = (double)NAN;
    } else {
        int forces = field->kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR;
        answer->slope = forces ? 0 : field->kind == PANDIS_SHAPE ? 1 : sqrt(pandis__dot(n, n));
        if (!pandis__normalise(n)) n[0] = n[1] = 0, n[2] = 1;
        answer->distance = d / field->scale;
        for (int k = 0; k < 3; k++) answer->normal[k] = n[k];
    }
    answer->flag = flag;
}

PANDIS_API int pandis_force(const pandis_field *field, const double point[3], double stiffness, double force[3]) {
    pandis_answer answer;
    force[0] = force[1] = force[2] = 0;
    if (!(stiffness >= 0 && stiffness <= PANDIS__STIFFEST)) return PANDIS_INVALID;
    pandis_query(field, point, &answer);
    double push = answer.distance < 0 ? -stiffness * answer.distance : 0; /* not so for NaN */
    for (int k = 0; k < 3; k++) force[k] = push > 0 ? push * answer.normal[k] : 0;
    return answer.flag;
}

PANDIS_API void pandis_query_many(const pandis_field *field, const double *points, size_t count, double *distances,
                                  double *normals, unsigned char *flags) {
    pandis_answer answer;
    for (size_t i = 0; i < count; i++) {
        pandis_query(field, points + 3 * i, &answer);
        distances[i] = answer.distance;
        if (normals) memcpy(normals + 3 * i, answer.normal, sizeof answer.normal);
        if (flags) flags[i] = (unsigned char)answer.flag;
    }
}


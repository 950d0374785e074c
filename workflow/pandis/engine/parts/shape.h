/* -------------------- closed forms */

enum { PANDIS__SPHERE, PANDIS__TORUS, PANDIS__BOX, PANDIS__CAPSULE };

/* Evaluate a closed form in the units of its sizes. Sizes: sphere (radius), torus around z (ring,
 * tube), box (half its sides), capsule along z (radius, half its axis). */
static void pandis__answer_shape(
    const pandis__shape *s, const double *p, double *distance, double *normal) {
    double offset[3] = {p[0], p[1], p[2]};
    if (s->shape == PANDIS__BOX) {
        double excess[3], out[3], most;
        int widest = 0;
        for (int k = 0; k < 3; k++) {
            excess[k] = fabs(p[k]) - s->size[k], out[k] = excess[k] > 0 ? excess[k] : 0;
            if (excess[k] > excess[widest]) widest = k;
        }
        most = excess[widest];
        double outside = sqrt(pandis__dot(out, out));
        *distance = outside + (most < 0 ? most : 0);
        if (!(outside > 0)) out[0] = out[1] = out[2] = 0, out[widest] = 1;
        for (int k = 0; k < 3; k++) normal[k] = p[k] < 0 ? -out[k] : out[k];
        return;
    }
    if (s->shape == PANDIS__TORUS) {
        double flat = sqrt(p[0] * p[0] + p[1] * p[1]);
        offset[0] -= s->size[0] * (flat > PANDIS__TINY ? p[0] / flat : 1);
        offset[1] -= s->size[0] * (flat > PANDIS__TINY ? p[1] / flat : 0);
    }
    if (s->shape == PANDIS__CAPSULE) {
        double axis = p[2] < -s->size[1] ? -s->size[1] : p[2] > s->size[1] ? s->size[1] : p[2];
        offset[2] -= axis;
    }
    double length = sqrt(pandis__dot(offset, offset));
    *distance = length - s->size[s->shape == PANDIS__TORUS];
    memcpy(normal, offset, sizeof offset);
    if (!(length > PANDIS__TINY)) normal[s->shape == PANDIS__CAPSULE ? 0 : 2] = 1;
}

/* -------------------- textures: heights over a surface */

#define PANDIS__TURN 6.283185307179586

PANDIS_API double pandis_waves(
    const void *ridges, const double point[3], int region, double gradient[3]) {
    const pandis_ridges *w = (const pandis_ridges *)ridges;
    double along = PANDIS__TURN * pandis__dot(point, w->direction) / w->length;
    (void)region;
    for (int k = 0; k < 3; k++)
        gradient[k] = w->height / 2 * PANDIS__TURN / w->length * cos(along) * w->direction[k];
    return w->height / 2 * (1 + sin(along));
}

/* A pseudo-random number from 0 to 1 for a node of the lattice. */
static double pandis__drawn(const int32_t *node) {
    uint32_t h = (uint32_t)node[0] * 0x8da6b343u ^ (uint32_t)node[1] * 0xd8163841u ^
        (uint32_t)node[2] * 0xcb1ab31fu;
    h = (h ^ h >> 15) * 0x2c1b3c6du, h = (h ^ h >> 12) * 0x297a2d39u;
    return (double)(h ^ h >> 15) / 4294967295.0;
}

PANDIS_API double pandis_noise(
    const void *bumps, const double point[3], int region, double gradient[3]) {
    const pandis_bumps *b = (const pandis_bumps *)bumps;
    double blend[3][2], change[3], sum = 0;
    int32_t low[3];
    (void)region;
    for (int k = 0; k < 3; k++) {
        double x = point[k] / b->length, t;
        if (!(fabs(x) < 1e9)) return gradient[0] = gradient[1] = gradient[2] = 0;
        low[k] = (int32_t)floor(x), t = x - floor(x);
        /* this blend has two continuous derivatives */
        blend[k][1] = t * t * t * (10 + t * (6 * t - 15)), blend[k][0] = 1 - blend[k][1];
        change[k] = 30 * t * t * (1 - t) * (1 - t) / b->length;
        gradient[k] = 0;
    }
    for (int corner = 0; corner < 8; corner++) {
        int at[3] = {corner & 1, corner >> 1 & 1, corner >> 2};
        int32_t node[3] = {low[0] + at[0], low[1] + at[1], low[2] + at[2]};
        double value = b->height * pandis__drawn(node);
        sum += value * blend[0][at[0]] * blend[1][at[1]] * blend[2][at[2]];
        for (int k = 0; k < 3; k++) {
            int i = (k + 1) % 3, j = (k + 2) % 3;
            gradient[k] += (at[k] ? value : -value) * change[k] * blend[i][at[i]] * blend[j][at[j]];
        }
    }
    return sum;
}

PANDIS_API double pandis_by_region(
    const void *patches, const double point[3], int region, double gradient[3]) {
    const pandis_patches *p = (const pandis_patches *)patches;
    const pandis_texture *t = p->textures + (region > 0 && region < p->count ? region : 0);
    if (t->height) return t->height(t->data, point, region, gradient);
    return gradient[0] = gradient[1] = gradient[2] = 0;
}

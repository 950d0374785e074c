/* Shaking: an oscillation by more than a tenth of a millimetre, at more than 30 Hz.
 *
 * Turns are counted along each axis: points where the motion has reversed by SHAKING_SIZE. Three
 * turns span a whole swing; if they take less than a thirtieth of a second, the probe shakes. A
 * knock against a wall causes only one turn, and a slow hand does not make three turns that fast.
 */
#ifndef SHAKING_H
#define SHAKING_H

#include <string.h>

#define SHAKING_SIZE 1e-4         /* m */
#define SHAKING_SPAN (1.0 / 30.0) /* s */

typedef struct {
    double low[3], high[3]; /* since the last turn */
    int up[3];              /* whether it last moved up */
    double turn[3][2];      /* times of the last two turns, s */
    double last;            /* time of the last shaking, s */
    int begun;
} shaking;

static void shaking_start(shaking *s) {
    memset(s, 0, sizeof *s);
    for (int k = 0; k < 3; k++) s->turn[k][0] = s->turn[k][1] = -1e9;
    s->last = -1e9;
}

/* Observe a position; shaking counts only during contact. */
static void shaking_see(shaking *s, const double *position, double now, int touching) {
    for (int k = 0; k < 3; k++) {
        double x = position[k];
        if (!s->begun) s->low[k] = s->high[k] = x;
        if (x < s->low[k]) s->low[k] = x;
        if (x > s->high[k]) s->high[k] = x;
        int turned = s->up[k] ? x < s->high[k] - SHAKING_SIZE : x > s->low[k] + SHAKING_SIZE;
        if (!turned) continue;
        s->up[k] = !s->up[k], s->low[k] = s->high[k] = x;
        if (touching && now - s->turn[k][1] < SHAKING_SPAN) s->last = now;
        s->turn[k][1] = s->turn[k][0], s->turn[k][0] = now;
    }
    s->begun = 1;
}

static int shaking_now(const shaking *s, double now) { return now - s->last < SHAKING_SPAN; }

#endif

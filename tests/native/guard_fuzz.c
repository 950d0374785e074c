/* A guard that is given anything: limits, periods, states, calls and forces at random, no numbers
 * among them. Usage: guard_fuzz RUNS SEED. Prints how many answers broke a rule, and the causes
 * that ended runs, as bits.
 *
 * The rules, by arithmetic of its own: an answer is finite and within the largest force; it is zero
 * once there is a cause, and while the run is not armed; a cause stays what it is; from tick to
 * tick an answer changes by no more than the limit for the time that has gone, unless the run ends
 * or is disarmed; a run ends for a number where one was given.
 */
#include "guard.h"

#include <stdio.h>
#include <stdlib.h>

static unsigned long long seed;

static double uniform(void) {
    seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(seed >> 11) / 9007199254740992.0;
}

/* One of so many; how rarely something odd is among them. */
static int one_of(int count) { return (int)(count * uniform()); }

static double odd(double usual, int rarely) {
    static const double all[] = {0, -1, 1e-300, 1e200, 1e308};
    int which = one_of(7 * rarely);
    return which < 5 ? all[which] : which == 5 ? NAN : which == 6 ? INFINITY : usual;
}

static int run(int *broken) {
    int rarely = 2 << one_of(10), steady = one_of(2);
    double period = odd((1 + one_of(4)) * 1e-3 / (1 + one_of(3)), 10 * rarely),
           k = odd(50 * (1 + one_of(20)), 10 * rarely);
    guard_limits limits;
    limits.force = odd(0.5 + 5 * uniform(), 10 * rarely),
    limits.continuous = one_of(2) ? odd(uniform(), 9 * rarely) : 0;
    limits.step = odd(5 * uniform(), 10 * rarely), limits.impulse = odd(5 * uniform(), 10 * rarely);
    limits.speed = odd(0.2 + 2 * uniform(), 10 * rarely), limits.ramp = one_of(2) ? one_of(30) : 0;
    limits.damping = odd(uniform(), 10 * rarely), limits.encoder = one_of(2) ? 3e-5 : 0;
    limits.stiffness = one_of(3) ? k : 0, limits.most_damping = odd(2 * uniform(), 10 * rarely),
    limits.needs = one_of(4);
    guard g;
    guard_start(&g, &limits, period);
    double place = 1e-3, speed = 0, last[3] = {0, 0, 0};
    int numbers = 1; /* all that was given so far are */
    double mass = 0.01 + 0.2 * uniform(), hand = 2 * uniform() - 1;
    for (int tick = 0; tick < 400; tick++) {
        device_state state;
        memset(&state, 0, sizeof state);
        double since = odd(one_of(20) ? period : 3 * period, 4 * rarely), force[3] = {0, 0, 0};
        double dt = period > 0 && period < 1 ? period : 1e-3;
        if (!one_of(100)) hand = 4 * uniform() - 2;
        speed += (last[0] + hand) / mass * dt, place += speed * dt;
        if (steady) place = fmax(-3e-3, fmin(2e-3, place));
        double seen = limits.encoder > 0 ? limits.encoder * floor(place / limits.encoder) : place;
        for (int i = 0; i < 3; i++) {
            state.position[i] = odd(i ? 0 : seen, 20 * rarely),
            state.velocity[i] = odd(i ? 0 : speed, 20 * rarely);
            force[i] = odd(i || place > 0 ? 0 : -k * place, 20 * rarely);
            numbers &= fabs(state.position[i]) < 500 && fabs(force[i]) < 1e99;
        }
        state.buttons = one_of(rarely) > 0, state.safe = one_of(rarely) > 0,
        state.temperature = odd(0.3, 40 * rarely);
        int armed = one_of(rarely) > 0, cause = g.cause;
        guard_watch(&g, &state, one_of(40 * rarely) > 0);
        if (tick == 200) g.now += 20; /* the device has slept */
        guard_pass(&g, &state, since, armed, force);
        double size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]),
               change = 0;
        for (int i = 0; i < 3; i++)
            change += (force[i] - last[i]) * (force[i] - last[i]), last[i] = force[i];
        double part = since > 0 ? fmin(1, since / period) : 0;
        int ended = g.cause || !armed || ((limits.needs & NEEDS_BUTTON) && !state.buttons) ||
            ((limits.needs & NEEDS_SWITCH) && !state.safe);
        int wrong = !(size <= limits.force * (1 + 1e-9)) && size != 0;
        wrong |= ended && size != 0;
        wrong |= cause && g.cause != cause;
        wrong |= numbers && !cause && g.cause == CAUSE_NUMBER;
        wrong |= !ended && size > 0 && sqrt(change) > limits.impulse * part * (1 + 1e-9) + 1e-12;
        *broken += wrong;
    }
    return g.cause;
}

int main(int count, char **words) {
    int broken = 0;
    long causes = 0;
    if (count < 3) return 1;
    seed = strtoull(words[2], NULL, 10);
    for (int left = atoi(words[1]); left > 0; left--) causes |= 1L << run(&broken);
    printf("%d %ld\n", broken, causes);
    return 0;
}

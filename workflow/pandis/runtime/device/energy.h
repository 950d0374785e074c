/* The observer of energy, for the guard and for the simulated device. */
#ifndef ENERGY_H
#define ENERGY_H

#include <math.h>

/* Energy between a wall and a device, since a contact began, but for the debt. */
typedef struct {
    double balance;   /* what the wall has taken and the device lost, less what is too long ago to count, J */
    double strongest; /* force of this contact, N */
    double beyond;    /* what it has taken while the force was at its largest, which F^2 / 2k does not count, J */
    double worst;     /* the least balance of all contacts: below zero the wall has given more than was lost */
    double debt;      /* what contacts before gave and none has paid back, J: at most 0 */
    double spare;     /* what the device lost beyond what is kept, J */
} energy;

static double length_of(const double *v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* Book a tick: whether the wall was touched, the force on the device, the work it did, what the device lost.
 *
 * The work on the wall is exact for a force that is held over the tick (Hannaford and Ryu 2002). Losses do not
 * accumulate: the balance is capped at what the wall may have stored, F^2 / 2k, plus what it took while the force was
 * at its largest. Otherwise a long slide along the wall would excuse shaking later. Only a debt is carried over from
 * one contact to the next. `cut`: the force was the largest that may be given. */
static void energy_book(energy *e, int touching, double force, double work, double lost, double stiffness, int cut) {
    if (!touching) {
        e->debt = fmin(0, e->debt + e->balance);
        e->balance = e->strongest = e->beyond = e->spare = 0;
        return;
    }
    e->strongest = fmax(e->strongest, force);
    /* the force is that of the depth where the tick begins, which bounds what the wall can have stored */
    double most = stiffness > 0 ? e->strongest * e->strongest / (2 * stiffness) + e->beyond : e->balance;
    if (e->balance > most) e->spare += e->balance - most, e->balance = most;
    e->balance += lost - work;
    if (cut) e->beyond = fmax(0, e->beyond - work);
    if (e->balance < e->worst) e->worst = e->balance;
}

#endif

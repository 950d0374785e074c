/* The energy observer, for the guard and for the simulated device. */
#ifndef ENERGY_H
#define ENERGY_H

#include <math.h>

/* Energy exchanged by a wall and a device since a contact began. Only `worst` and `debt` also cover
 * earlier contacts. */
typedef struct {
    double balance;   /* energy taken by the wall and lost by the device, capped as below, J */
    double strongest; /* largest force of this contact, N */
    /* energy taken while the force was at its limit, which F^2 / 2k does not include, J */
    double beyond;
    /* least balance of all contacts, J; if below zero, the wall gave more energy than it had taken
     * and the device had lost */
    double worst;
    /* energy that the wall gave in earlier contacts and has not yet got back, J, as a negative
     * number; 0 if none */
    double debt;
    double spare; /* losses of the device beyond the cap, J */
} energy;

static double length_of(const double *v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* Book a tick: whether the wall was touched, the force on the device, its work, and the device's
 * losses.
 *
 * The work on the wall is exact for a force that is held over the tick (Hannaford and Ryu 2002).
 * Losses do not accumulate: the balance is capped at what the wall may have stored, F^2 / 2k, plus
 * what it took while the force was at its largest. Otherwise a long slide along the wall would
 * excuse shaking later. Only a debt is carried over from one contact to the next. `cut`: the force
 * was the largest that may be given. */
static void energy_book(
    energy *e, int touching, double force, double work, double lost, double stiffness, int cut) {
    if (!touching) {
        e->debt = fmin(0, e->debt + e->balance);
        e->balance = e->strongest = e->beyond = e->spare = 0;
        return;
    }
    e->strongest = fmax(e->strongest, force);
    /* the force is that of the depth at the start of the tick, which bounds the energy stored in
     * the wall */
    double most =
        stiffness > 0 ? e->strongest * e->strongest / (2 * stiffness) + e->beyond : e->balance;
    if (e->balance > most) e->spare += e->balance - most, e->balance = most;
    e->balance += lost - work;
    if (cut) e->beyond = fmax(0, e->beyond - work);
    if (e->balance < e->worst) e->worst = e->balance;
}

#endif

/* A servo loop at a fixed rate: position in, force out, every tick timed.
 *
 * Deadlines are absolute, so that a late tick delays no other. The loop allocates nothing. Its only
 * system calls read the clock and sleep until shortly before a tick is due. For the rest of the
 * time it polls the clock and, if `again` is set, repeats the query at the probe's last position.
 */
#define _GNU_SOURCE
#define PANDIS_IMPLEMENTATION
#include "../../engine/pandis.h"

#include <errno.h>
#include <sched.h>
#include <sys/mman.h>
#include <time.h>

#define WARM_UP 200
#define PRIORITY 80

enum { LOCKED = 1, REALTIME = 2 };

static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void sleep_until(int64_t wake) {
    struct timespec t = {
        .tv_sec = (time_t)(wake / 1000000000), .tv_nsec = (long)(wake % 1000000000)};
    if (wake > now())
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) continue;
}

/* Run `ticks` ticks of `period` nanoseconds along a path of `count` points (mesh units),
 * repeatedly. Without a field nothing is computed, so that all lateness is due to the system.
 *
 * taken, late: seconds per tick; forces: three doubles per tick. Returns LOCKED and REALTIME, as
 * far as the system allowed them. */
int servo_run(const pandis_field *field, const double *points, int64_t count, double stiffness,
    int64_t ticks, int64_t period, int64_t spin, int again, double *taken, double *late,
    double *forces) {
    int allowed = 0, before = sched_getscheduler(0);
    struct sched_param usual, urgent = {.sched_priority = PRIORITY};
    sched_getparam(0, &usual);
    if (!mlockall(MCL_CURRENT)) allowed |= LOCKED;
    if (!sched_setscheduler(0, SCHED_FIFO, &urgent)) allowed |= REALTIME;
    memset(taken, 0, (size_t)ticks * sizeof *taken);
    memset(late, 0, (size_t)ticks * sizeof *late);
    memset(forces, 0, (size_t)ticks * 3 * sizeof *forces);
    double warm[3];
    for (int64_t k = 0; field && k < WARM_UP; k++)
        pandis_force(field, points + 3 * (k % count), stiffness, warm);
    int64_t start = now() + 10 * period;
    for (int64_t tick = 0; tick < ticks; tick++) {
        int64_t due = start + tick * period, last = tick ? tick - 1 : 0;
        sleep_until(due - spin);
        /* repeat the last query: sleeping has evicted the field's bytes from the caches */
        if (field && again && now() < due - spin / 4)
            pandis_force(field, points + 3 * (last % count), stiffness, warm);
        while (now() < due) continue;
        int64_t begin = now();
        if (field) pandis_force(field, points + 3 * (tick % count), stiffness, forces + 3 * tick);
        int64_t end = now();
        taken[tick] = 1e-9 * (double)(end - begin), late[tick] = 1e-9 * (double)(begin - due);
    }
    if (allowed & REALTIME) sched_setscheduler(0, before, &usual);
    if (allowed & LOCKED) munlockall();
    return allowed;
}

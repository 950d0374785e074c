
/* ---------------------------------------------------------------- meshes that another thread moves */

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__NEW 4

/* Put a number where another thread may do so at the same time; returns what was there. What was written before is seen
 * by whoever reads the number. */
static int32_t pandis__exchange(volatile int32_t *where, int32_t number) {
#if defined(__GNUC__)
    return __atomic_exchange_n(where, number, __ATOMIC_ACQ_REL);
#else
    return (int32_t)_InterlockedExchange((volatile long *)where, (long)number);
#endif
}

static int32_t pandis__peek(const volatile int32_t *where) {
#if defined(__GNUC__)
    return __atomic_load_n(where, __ATOMIC_RELAXED);
#else
    return *where;
#endif
}

PANDIS_API size_t pandis_handover_room(const pandis_field *field) { return 3 * pandis_refit_room(field); }

PANDIS_API int pandis_handover_open(pandis_handover *handover, const pandis_field *field, void *room) {
    size_t each = pandis_refit_room(field);
    for (int i = 0; i < 3; i++) {
        int error = pandis_refit_open(handover->shapes + i, field, (unsigned char *)room + (size_t)i * each);
        if (error) return error;
    }
    handover->writing = 0, handover->asking = 1;
    (void)pandis__exchange(&handover->waiting, 2 | PANDIS__NEW);
    return 0;
}

PANDIS_API int pandis_handover_refit(pandis_handover *handover, const double *vertices) {
    int error = pandis_refit(handover->shapes + handover->writing, vertices);
    if (!error) handover->writing = pandis__exchange(&handover->waiting, handover->writing | PANDIS__NEW) & 3;
    return error;
}

PANDIS_API int pandis_handover_take(pandis_handover *handover, pandis_field *moving) {
    int is_new = (pandis__peek(&handover->waiting) & PANDIS__NEW) != 0; /* only this thread makes it an old one */
    if (is_new) handover->asking = pandis__exchange(&handover->waiting, handover->asking) & 3;
    *moving = handover->shapes[handover->asking];
    return is_new;
}
#endif

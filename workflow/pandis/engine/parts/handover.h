
/* -------------------- meshes that another thread moves */

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__NEW 4

/* Exchange a number atomically; returns the old one. A thread that reads the number also sees all
 * earlier writes. */
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

PANDIS_API size_t pandis_handover_room(const pandis_field *field) {
    return 3 * pandis_refit_room(field);
}

PANDIS__ONCE PANDIS_API pandis_error pandis_handover_open(
    pandis_handover *handover, const pandis_field *field, void *room, size_t size) {
    pandis__handover *h = pandis__handover_of(handover);
    size_t each = pandis_refit_room(field);
    if (size < 3 * each) return PANDIS_ERROR_COUNT;
    for (int i = 0; i < 3; i++) {
        pandis_error error =
            pandis_refit_open(h->shapes + i, field, (unsigned char *)room + (size_t)i * each, each);
        if (error) return error;
    }
    h->writing = 0, h->asking = 1;
    (void)pandis__exchange(&h->waiting, 2 | PANDIS__NEW);
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_error pandis_handover_refit(
    pandis_handover *handover, const double *vertices, size_t count) {
    pandis__handover *h = pandis__handover_of(handover);
    pandis_error error = pandis_refit(h->shapes + h->writing, vertices, count);
    if (!error) h->writing = pandis__exchange(&h->waiting, h->writing | PANDIS__NEW) & 3;
    return error;
}

PANDIS_API int pandis_handover_take(pandis_handover *handover, pandis_field *moving) {
    pandis__handover *h = pandis__handover_of(handover);
    /* only this thread clears the flag */
    int is_new = (pandis__peek(&h->waiting) & PANDIS__NEW) != 0;
    if (is_new) h->asking = pandis__exchange(&h->waiting, h->asking) & 3;
    *moving = h->shapes[h->asking];
    return is_new;
}
#endif

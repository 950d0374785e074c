/* Offsets and sizes of the fields of a structure, for bindings that mirror it: a list of these
 * entries, which ends with a NULL type. */
#ifndef LAYOUT_H
#define LAYOUT_H

#include <stddef.h>

typedef struct {
    const char *type, *field; /* NULL field: the structure itself */
    size_t at, size;
} layout_entry;

#define LAYOUT(type, field) {#type, #field, offsetof(type, field), sizeof(((type *)0)->field)}
#define LAYOUT_TYPE(type) {#type, NULL, 0, sizeof(type)}
#define LAYOUT_END {NULL, NULL, 0, 0}

#endif

/* pandis.h for a web page: a field, and a probe that a hand holds. Compiled to WebAssembly (`make
 * wasm`). */
#define PANDIS_NO_FILE
#define PANDIS_NO_DISPATCH
#define PANDIS_API static inline
#define PANDIS_IMPLEMENTATION
#include "../../engine/pandis.h"

#define PAGE 65536
#define WEB __attribute__((visibility("default")))

__attribute__((no_builtin("memcpy"))) void *memcpy(void *to, const void *from, size_t size) {
    for (size_t i = 0; i < size; i++) ((char *)to)[i] = ((const char *)from)[i];
    return to;
}

__attribute__((no_builtin("memset"))) void *memset(void *to, int value, size_t size) {
    for (size_t i = 0; i < size; i++) ((char *)to)[i] = (char)value;
    return to;
}

int memcmp(const void *a, const void *b, size_t size) {
    const unsigned char *x = a, *y = b;
    for (size_t i = 0; i < size; i++)
        if (x[i] != y[i]) return x[i] < y[i] ? -1 : 1;
    return 0;
}

size_t strlen(const char *text) {
    size_t length = 0;
    while (text[length]) length++;
    return length;
}

/* Digest of the sources that this was compiled from. */
WEB const char web_digest[] = WEB_DIGEST;

/* Numbers that the page writes and reads, in one array, at the indices in these enums. */
enum { TARGET = 0, SIZE = 3, STIFFNESS, FRICTION, RADIUS, IN };
enum {
    PROBE = 8,
    PROXY = 11,
    FORCE = 14,
    NORMAL = 17,
    DEPTH = 20,
    STATE,
    OUT,
    MOST_TICKS = 64,
    TICKS = 32
};
static double numbers[TICKS + MOST_TICKS];

/* The hand: a spring from the pointer to the probe's mass, a little less than critically damped. */
static const double DT = 1e-3, MASS = 0.05, HAND = 150.0, DAMPING = 5.0;

static pandis_field field;
static pandis_object object;
static pandis_contact contact;
static pandis_material material;
static double probe[3], velocity[3], from[3];
static int has_contact;
extern unsigned char __heap_base;

WEB double *web_numbers(void) { return numbers; }

/* Memory for the bytes of a file, which must stay there as long as it is open. */
WEB void *web_room(uint32_t size) {
    uintptr_t start = ((uintptr_t)&__heap_base + 63) & ~(uintptr_t)63, end = start + size + PAGE;
    uintptr_t pages = (end + PAGE - 1) / PAGE, there = __builtin_wasm_memory_size(0);
    if (pages > there && __builtin_wasm_memory_grow(0, pages - there) == (size_t)-1) return NULL;
    return (void *)start;
}

/* Open the bytes. Returns 0 or a PANDIS_ERROR. */
WEB int web_open(const void *data, uint32_t size) {
    has_contact = 0;
    return pandis_open(&field, data, size);
}

WEB const char *web_error(int error) { return pandis_error_text((pandis_error)error); }

/* Begin a contact: the object is centred in the scene, its longest side is SIZE (m), the probe is
 * at TARGET. */
WEB int web_begin(void) {
    const double scale = numbers[SIZE] / pandis_longest_side(&field);
    memset(&object, 0, sizeof object), memset(&contact, 0, sizeof contact);
    object.field = &field, object.scale = scale, object.stiffness = numbers[STIFFNESS];
    for (int k = 0; k < 3; k++) {
        object.rotation[4 * k] = 1, object.translation[k] = -scale * field.centre[k];
        probe[k] = from[k] = numbers[TARGET + k], velocity[k] = 0;
    }
    pandis_contact_options options = pandis_contact_defaults(&object);
    options.radius = numbers[RADIUS], options.materials = &material, options.material_count = 1;
    const int error = pandis_contact_open(&contact, &object, &options);
    has_contact = !error;
    return error;
}

/* Run `count` ticks (64 at most), in which the pointer moves to the target. */
WEB int web_ticks(int count) {
    pandis_touch touch;
    int flag = PANDIS_INVALID;
    memset(&touch, 0, sizeof touch);
    object.stiffness = numbers[STIFFNESS];
    material.sticking = numbers[FRICTION], material.sliding = 0.8 * numbers[FRICTION];
    if (!has_contact || count < 1 || count > MOST_TICKS) return flag;
    for (int i = 1; i <= count; i++) {
        for (int k = 0; k < 3; k++) {
            const double hand = from[k] + (numbers[TARGET + k] - from[k]) * i / count;
            const double pull =
                HAND * (hand - probe[k]) - DAMPING * velocity[k] + numbers[FORCE + k];
            velocity[k] += DT / MASS * pull;
            probe[k] += DT * velocity[k];
        }
        flag = pandis_contact_step(&contact, &object, probe, DT, &touch);
        for (int k = 0; k < 3; k++) numbers[FORCE + k] = touch.force[k];
        numbers[TICKS + i - 1] = sqrt(pandis__dot(touch.force, touch.force));
    }
    for (int k = 0; k < 3; k++) {
        from[k] = numbers[TARGET + k], numbers[PROBE + k] = probe[k];
        numbers[PROXY + k] = touch.proxy[k], numbers[NORMAL + k] = touch.normal[k];
    }
    numbers[DEPTH] = touch.depth, numbers[STATE] = touch.state;
    return flag;
}

/* Answer points as pandis_query_many does: distances, normals and flags. */
WEB void web_query(const double *points, uint32_t count, double *distances, double *normals,
    unsigned char *flags) {
    pandis_query_many(&field, points, count, distances, normals, flags);
}

/* -------------------- contents of the opaque states */

typedef struct {
    pandis_contact_options options; /* budget 0: the contact is not open */
    int32_t state, planes, sticks, settled, close, stalled, idle, face, region;
    /* in the object's unit frame */
    pandis_object object; /* with its pose in the last step */
    double ball[5], sunk, lift, pace, rested, proxy[3], probe[3], velocity[3], pull[3], plane[8][7];
} pandis__contact;

typedef struct {
    const pandis_object *objects;
    size_t count;
    double *room;
    size_t queries;           /* in the last call */
    pandis_contact *contacts; /* one per object; NULL: none */
    double probe[3];          /* its position in the last step of the contacts */
} pandis__scene;

#if defined(__GNUC__) || defined(_MSC_VER)
typedef struct {
    pandis_object *objects;
    size_t count;
    pandis_pose *frames;
    double periods[3], *ways, period, gone;
    int32_t writing, asking;
    volatile int32_t waiting; /* a frame's index, plus 4 until it is taken */
} pandis__poses;

typedef struct {
    pandis_field shapes[3];
    int32_t writing, asking;
    volatile int32_t waiting; /* a shape's index, plus 4 until it is taken */
} pandis__handover;
#endif

/* The state behind each handle. Handles are aligned for doubles. As unions with characters, they
 * may alias anything. */
#define PANDIS__STATE(handle)                                                                      \
    typedef char handle##_fits[sizeof(pandis__##handle) <= sizeof(pandis_##handle) ? 1 : -1];      \
    PANDIS__INLINE pandis__##handle *pandis__##handle##_of(pandis_##handle *h) {                   \
        return (pandis__##handle *)(void *)h;                                                      \
    }                                                                                              \
    PANDIS__INLINE const pandis__##handle *pandis__##handle##_in(const pandis_##handle *h) {       \
        return (const pandis__##handle *)(const void *)h;                                          \
    }
PANDIS__STATE(contact)
PANDIS__STATE(scene)
#if defined(__GNUC__) || defined(_MSC_VER)
PANDIS__STATE(poses)
PANDIS__STATE(handover)
#endif

PANDIS_API const char *pandis_version(void) { return PANDIS_VERSION; }

PANDIS__ONCE PANDIS_API pandis_error pandis__check(
    const char *version, size_t field, size_t options, size_t touch) {
    int same = strlen(version) == sizeof PANDIS_VERSION - 1 &&
        !memcmp(version, PANDIS_VERSION, sizeof PANDIS_VERSION - 1);
    same = same && field == sizeof(pandis_field) && options == sizeof(pandis_contact_options) &&
        touch == sizeof(pandis_touch);
    return same ? PANDIS_SUCCESS : PANDIS_ERROR_HEADER;
}

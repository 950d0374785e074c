/* -------------------- files */

#define PANDIS__HEADER 256
#define PANDIS__SECTION 24
#define PANDIS__MOST_SECTIONS 32
#define PANDIS__ORDER 0x0a0b0c0du

static uint32_t pandis__u32(const unsigned char *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static uint64_t pandis__u64(const unsigned char *p) {
    return pandis__u32(p) | (uint64_t)pandis__u32(p + 4) << 32;
}

static double pandis__f64(const unsigned char *p) {
    uint64_t bits = pandis__u64(p);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* CRC-32 (ISO 3309, as in zip files). */
static uint32_t pandis__crc(const unsigned char *p, size_t size) {
    uint32_t table[256], crc = 0xffffffffu;
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int k = 0; k < 8; k++) c = c & 1 ? 0xedb88320u ^ (c >> 1) : c >> 1;
        table[i] = c;
    }
    for (size_t i = 0; i < size; i++) crc = table[(crc ^ p[i]) & 0xff] ^ (crc >> 8);
    return ~crc;
}

/* The k-th of the 14 integers, or of the 16 reals, of the header. */
static int32_t pandis__whole(const pandis_field *f, int k) {
    uint32_t value = pandis__u32(f->data + 72 + 4 * k);
    return value <= INT32_MAX ? (int32_t)value : -1;
}

static double pandis__real(const pandis_field *f, int k) {
    return pandis__f64(f->data + 128 + 8 * k);
}

/* Find a section by its name, and its size in bytes; NULL if there is none. */
static const unsigned char *pandis__find(const pandis_field *f, const char *name, uint64_t *bytes) {
    const unsigned char *entry = f->data + PANDIS__HEADER;
    *bytes = 0;
    for (uint32_t i = 0, sections = pandis__u32(f->data + 36); i < sections;
        i++, entry += PANDIS__SECTION) {
        if (memcmp(entry, name, 4)) continue;
        *bytes = pandis__u64(entry + 16);
        return f->data + (size_t)pandis__u64(entry + 8);
    }
    return NULL;
}

/* Find a section by its name, if it contains `count` values of `each` bytes. The table of sections
 * must have been checked. */
static const void *pandis__section(
    const pandis_field *f, const char *name, uint64_t count, uint64_t each) {
    uint64_t bytes;
    const unsigned char *section = pandis__find(f, name, &bytes);
    return bytes == count * each ? section : NULL;
}

/* Whether there is a section of this name. */
static int pandis__has_section(const pandis_field *f, const char *name) {
    uint64_t bytes;
    return pandis__find(f, name, &bytes) != NULL;
}

PANDIS_API const char *pandis_provenance(const pandis_field *field, size_t *size) {
    uint64_t bytes = 0;
    const unsigned char *text = field->kind ? pandis__find(field, "PROV", &bytes) : NULL;
    *size = (size_t)bytes;
    return (const char *)text;
}

PANDIS_API const char *pandis_region(const pandis_field *field, int region) {
    uint64_t bytes = 0;
    const char *name = field->regions ? (const char *)pandis__find(field, "RNAM", &bytes) : NULL;
    const char *end = name ? name + bytes : NULL;
    /* the last one ends with a zero */
    for (int i = 0; i < region && name < end; i++) name += strlen(name) + 1;
    return region >= 0 && name < end ? name : NULL;
}

static int pandis__finite(const float *values, uint64_t count) {
    int good = values != NULL;
    for (uint64_t i = 0; good && i < count; i++) good &= fabsf(values[i]) <= 3e38f;
    return good;
}

static int pandis__finite64(const double *values, uint64_t count) {
    int good = values != NULL;
    for (uint64_t i = 0; good && i < count; i++) good &= fabs(values[i]) <= 1e30;
    return good;
}

static uint64_t pandis__cube(int32_t n) { return (uint64_t)n * (uint64_t)n * (uint64_t)n; }

/* Open a lattice that covers the box with `cells` cells per axis. */
PANDIS__ONCE static int pandis__open_lattice(
    const pandis_field *f, const char *name, int32_t cells, pandis__lattice *l) {
    l->size = cells + 3, l->low = -1 - 2.0 / cells, l->per_step = (l->size - 1) / (-2 * l->low);
    l->values = (const float *)pandis__section(f, name, pandis__cube(l->size), sizeof(float));
    return pandis__finite(l->values, pandis__cube(l->size));
}

PANDIS__ONCE static int pandis__open_network(pandis_field *f) {
    pandis__network *n = &f->as.network;
    int32_t base = pandis__whole(f, 3), bits = pandis__whole(f, 4);
    n->width = pandis__whole(f, 0), n->depth = pandis__whole(f, 1),
    n->outputs = pandis__whole(f, 2);
    if (n->width < 1 || n->width > PANDIS_MOST_WIDTH || n->depth < 1 ||
        n->depth > PANDIS_MOST_DEPTH)
        return 0;
    if ((n->outputs != 1 && n->outputs != 4) || (bits != 16 && bits != 32) || base < 0 ||
        base > 512)
        return 0;
    n->stride = (n->width + PANDIS__LANES - 1) / PANDIS__LANES * PANDIS__LANES;
    uint64_t row = (uint64_t)n->stride, rows = (uint64_t)(n->depth - 1) * (uint64_t)n->width;
    uint64_t biases = (uint64_t)n->depth * row + 4;
    n->first = (const float *)pandis__section(f, "WIN ", 3 * row, sizeof(float));
    n->last = (const float *)pandis__section(f, "WOUT", (uint64_t)n->outputs * row, sizeof(float));
    n->biases = (const float *)pandis__section(f, "BIAS", biases, sizeof(float));
    if (!pandis__finite(n->first, 3 * row) || !pandis__finite(n->last, (uint64_t)n->outputs * row))
        return 0;
    if (!pandis__finite(n->biases, biases)) return 0;
    if (bits == 32) {
        n->hidden = (const float *)pandis__section(f, "WHID", rows * row, sizeof(float));
        if (!pandis__finite(n->hidden, rows * row)) return 0;
    } else {
        n->hidden16 = (const int16_t *)pandis__section(f, "WHID", rows * row, sizeof(int16_t));
        n->scales = (const float *)pandis__section(f, "SCAL", rows, sizeof(float));
        if (!n->hidden16 || !pandis__finite(n->scales, rows)) return 0;
    }
    return !base || pandis__open_lattice(f, "BASE", base, &n->base);
}

PANDIS__ONCE static int pandis__open_grid(pandis_field *f) {
    pandis__grid *g = &f->as.grid;
    static const int32_t channels[] = {3, 3, 4, 1, 1};
    g->rule = pandis__whole(f, 0), g->size = pandis__whole(f, 1);
    if (g->rule < 0 || g->rule > PANDIS__TRICUBIC || g->size < 2 || g->size > 1024) return 0;
    g->channels = channels[g->rule];
    int own = pandis__u32(f->data + 12) > 1; /* version 1 has only the cube */
    for (int k = 0; k < 3; k++) {
        g->low[k] = own ? pandis__real(f, k) : -1, g->high[k] = own ? pandis__real(f, 3 + k) : 1;
        if (!(g->low[k] >= -1 && g->high[k] <= 1 && g->high[k] - g->low[k] >= 1e-9)) return 0;
        if (g->rule == PANDIS__TRICUBIC && (g->low[k] > -1 || g->high[k] < 1)) return 0;
        g->per_step[k] = (g->size - 1) / (g->high[k] - g->low[k]);
    }
    uint64_t count = pandis__cube(g->size) * (uint64_t)g->channels,
             bits = pandis__cube(g->size - 1);
    g->covered = (const uint8_t *)pandis__section(f, "COVR", (bits + 7) / 8, 1);
    if (!g->covered) return 0;
    if (g->rule == PANDIS__TRICUBIC) return pandis__open_lattice(f, "NODE", g->size - 1, &g->cubic);
    g->nodes = (const float *)pandis__section(f, "NODE", count, sizeof(float));
    return pandis__finite(g->nodes, count);
}

PANDIS__ONCE static int pandis__open_layout(pandis_field *f, int level) {
    static const char *const names[2][4] = {
        {"BBRK", "BMSK", "BBAS", "BCOF"}, {"FBRK", "FMSK", "FBAS", "FCOF"}};
    pandis__spline *s = &f->as.spline;
    pandis__layout *l = s->layout + level;
    int32_t kept = pandis__whole(f, 4 + level), blocks = pandis__whole(f, 6 + level);
    l->size = pandis__whole(f, level), l->bricks = pandis__whole(f, 2 + level);
    l->low = pandis__real(f, level);
    if (l->size < 4 || l->size > 1024 || l->bricks < 1 || l->bricks != (l->size + 7) / 8) return 0;
    if (kept < 0 || kept >= PANDIS__NO_BRICK || blocks < 0 || blocks > INT32_MAX / 8 ||
        !(l->low <= -1 && l->low > -3))
        return 0;
    l->per_step = (l->size - 1) / (-2 * l->low);
    l->brick = (const uint16_t *)pandis__section(f, names[level][0], pandis__cube(l->bricks), 2);
    l->mask = (const uint64_t *)pandis__section(f, names[level][1], (uint64_t)kept, 8);
    l->base = (const uint32_t *)pandis__section(f, names[level][2], (uint64_t)kept, 4);
    const void *stored = pandis__section(f, names[level][3], (uint64_t)blocks * 8, level ? 1 : 2);
    if (level) s->fine = (const int8_t *)stored;
    else s->coarse = (const int16_t *)stored;
    if (!l->brick || !l->mask || !l->base || !stored) return 0;
    for (uint64_t i = 0; i < pandis__cube(l->bricks); i++)
        if (l->brick[i] != PANDIS__NO_BRICK && l->brick[i] >= kept) return 0;
    uint64_t before = 0;
    for (int32_t i = 0; i < kept; i++) {
        if (l->base[i] != before) return 0;
        before += (uint64_t)pandis__count_bits(l->mask[i]);
    }
    return before == (uint64_t)blocks;
}

PANDIS__ONCE static int pandis__open_spline(pandis_field *f) {
    pandis__spline *s = &f->as.spline;
    if (!pandis__open_layout(f, 0) || !pandis__open_layout(f, 1)) return 0;
    s->far_size = pandis__whole(f, 8), s->far_low = pandis__real(f, 2);
    if (s->far_size < 4 || s->far_size > 512 || !(s->far_low <= -1 && s->far_low > -3)) return 0;
    s->far_per_step = (s->far_size - 1) / (-2 * s->far_low);
    for (int k = 0; k < 3; k++) {
        s->offset[k] = pandis__real(f, 3 + k), s->scale[k] = pandis__real(f, 6 + k);
        if (!(fabs(s->offset[k]) <= 1e30 && fabs(s->scale[k]) <= 1e30)) return 0;
    }
    s->inside = pandis__real(f, 9), s->outside = pandis__real(f, 10);
    if (!(s->inside >= 0 && s->inside <= 1e30 && s->outside >= 0 && s->outside <= 1e30)) return 0;
    uint64_t blocks = pandis__cube(4 * s->layout[0].bricks);
    s->far = (const int16_t *)pandis__section(f, "RCOF", pandis__cube(s->far_size), 2);
    s->side = (const uint8_t *)pandis__section(f, "SIDE", (blocks + 7) / 8, 1);
    return s->far && s->side;
}

PANDIS__ONCE static int pandis__open_shape(pandis_field *f) {
    pandis__shape *s = &f->as.shape;
    s->shape = pandis__whole(f, 0);
    for (int k = 0; k < 3; k++) {
        s->size[k] = pandis__real(f, k);
        if (!(s->size[k] >= 0 && s->size[k] <= 1e30)) return 0;
    }
    return s->shape >= 0 && s->shape <= PANDIS__CAPSULE;
}

/* Read the box around the surface, two measured margins and a height. A probe that is farther
 * outside this box than the first margin touches nothing. At a point whose distance is known, a
 * probe touches nothing before it has moved by that distance less a margin: the second margin if
 * the answer is flagged as a bound, else the first. Where an answer in the unit box is positive and
 * flagged as a bound, no surface is nearer than the height. Without the section, nothing is known.
 */
PANDIS__ONCE static int pandis__measure(pandis_field *f) {
    const unsigned char *bounds =
        (const unsigned char *)pandis__section(f, "SAFE", 9, sizeof(double));
    for (int k = 0; k < 2; k++) {
        f->margin[k] = bounds ? pandis__f64(bounds + 48 + 8 * k) : (double)INFINITY;
        if (!(f->margin[k] >= 0)) return 0;
    }
    f->height = bounds ? pandis__f64(bounds + 64) : 0;
    if (!(f->height >= 0 && f->height <= 1e30)) return 0;
    for (int k = 0; k < 3; k++) {
        f->low[k] = bounds ? pandis__f64(bounds + 8 * k) : -1;
        f->high[k] = bounds ? pandis__f64(bounds + 24 + 8 * k) : 1;
        if (!(f->low[k] >= -1e30 && f->low[k] <= f->high[k] && f->high[k] <= 1e30)) return 0;
    }
    return 1;
}

/* Read the region of each face, and the regions' names. */
PANDIS__ONCE static int pandis__open_regions(pandis_field *f) {
    int mesh = f->kind == PANDIS_MESH;
    uint64_t count = mesh ? (uint64_t)f->as.mesh.face_count
                          : (uint64_t)f->as.compact.block_count * PANDIS__BLOCK;
    uint64_t bytes, names = 0;
    const unsigned char *text = pandis__find(f, "RNAM", &bytes);
    const uint8_t *regions = (const uint8_t *)pandis__section(f, "REGN", count, 1);
    if (!regions || !text || !bytes || text[bytes - 1]) return 0;
    for (uint64_t i = 0; i < bytes; i += strlen((const char *)text + i) + 1) names++;
    for (uint64_t i = 0; i < count; i++)
        if (regions[i] >= names) return 0;
    f->regions = regions;
    return 1;
}

PANDIS__ONCE static pandis_error pandis__open(pandis_field *field, const void *data, size_t size) {
    const unsigned char *p = (const unsigned char *)data;
    const uint32_t order = PANDIS__ORDER;
    memset(field, 0, sizeof *field);
    if (!p || size < 8 || memcmp(p, "PANDIS\r\n", 8)) return PANDIS_ERROR_FORMAT;
    if (size < PANDIS__HEADER) return PANDIS_ERROR_SIZE;
    if (pandis__u32(p + 8) != order || memcmp(p + 8, &order, 4)) return PANDIS_ERROR_ENDIAN;
    if (pandis__u32(p + 12) < 1 || pandis__u32(p + 12) > PANDIS_FORMAT_VERSION)
        return PANDIS_ERROR_VERSION;
    if (pandis__u64(p + 16) != size) return PANDIS_ERROR_SIZE;
    if (pandis__u32(p + 28) || pandis__u32(p + 24) != pandis__crc(p + 32, size - 32))
        return PANDIS_ERROR_CHECKSUM;
    if ((uintptr_t)p % 8) return PANDIS_ERROR_ALIGNMENT;
    if (!pandis__arithmetic()) return PANDIS_ERROR_ARITHMETIC;
    field->data = p, field->size = size;
    uint32_t sections = pandis__u32(p + 36);
    if (sections > PANDIS__MOST_SECTIONS ||
        PANDIS__HEADER + (size_t)sections * PANDIS__SECTION > size)
        return PANDIS_ERROR_CONTENT;
    for (uint32_t i = 0; i < sections; i++) {
        const unsigned char *entry = p + PANDIS__HEADER + (size_t)i * PANDIS__SECTION;
        uint64_t start = pandis__u64(entry + 8), bytes = pandis__u64(entry + 16);
        if (start % 8 || start > size || bytes > size - start || pandis__u32(entry + 4))
            return PANDIS_ERROR_CONTENT;
        if (bytes && start < PANDIS__HEADER + (size_t)sections * PANDIS__SECTION)
            return PANDIS_ERROR_CONTENT;
    }
    for (int k = 0; k < 3; k++) field->centre[k] = pandis__f64(p + 40 + 8 * k);
    field->scale = pandis__f64(p + 64);
    if (!(field->scale >= 1e-150 && field->scale <= 1e150)) return PANDIS_ERROR_CONTENT;
    for (int k = 0; k < 3; k++)
        if (!(fabs(field->centre[k]) <= 1e150)) return PANDIS_ERROR_CONTENT;
    int good = 0, kind = (int)pandis__u32(p + 32);
    /* leaves of meshes before version 4 have another format */
    if (kind == PANDIS_MESH && pandis__u32(p + 12) < 4) return PANDIS_ERROR_VERSION;
    if (kind == PANDIS_NETWORK && pandis__whole(field, 0) <= 1024 &&
        pandis__whole(field, 1) <= 16 &&
        (pandis__whole(field, 0) > PANDIS_MOST_WIDTH ||
            pandis__whole(field, 1) > PANDIS_MOST_DEPTH))
        return PANDIS_ERROR_LARGE;
    if (kind == PANDIS_NETWORK) good = pandis__open_network(field);
    if (kind == PANDIS_GRID) good = pandis__open_grid(field);
    if (kind == PANDIS_SPLINE) good = pandis__open_spline(field);
    if (kind == PANDIS_MESH) good = pandis__open_mesh(field);
    if (kind == PANDIS_COMPACT) good = pandis__open_compact(field);
    if (kind == PANDIS_SHAPE) good = pandis__open_shape(field);
    if (!good || !pandis__measure(field)) return PANDIS_ERROR_CONTENT;
    field->kind = kind;
    int meshes = kind == PANDIS_MESH || kind == PANDIS_COMPACT;
    return meshes && pandis__has_section(field, "REGN") && !pandis__open_regions(field)
        ? PANDIS_ERROR_CONTENT
        : PANDIS_SUCCESS;
}

PANDIS__ONCE PANDIS_API pandis_error pandis_open(
    pandis_field *field, const void *data, size_t size) {
    pandis_error error = pandis__open(field, data, size);
    if (error) memset(field, 0, sizeof *field); /* a field that is not open is all zero */
    return error;
}

#ifndef PANDIS_NO_FILE
#ifdef PANDIS__READ
/* Open a file by its UTF-8 path, which Windows requires in UTF-16. */
static FILE *pandis__open_path(const char *path) {
#ifdef _WIN32
    const unsigned char *p = (const unsigned char *)path;
    wchar_t wide[1024];
    size_t n = 0;
    while (*p) {
        static const uint32_t least[4] = {0, 0x80, 0x800, 0x10000};
        int more = *p >= 0xf0 ? 3 : *p >= 0xe0 ? 2 : *p >= 0xc0 ? 1 : 0, length = more;
        uint32_t code = more ? *p & (0x3fu >> more) : *p;
        if ((*p >= 0x80 && *p < 0xc0) || *p >= 0xf8 || n + 3 > sizeof wide / sizeof *wide)
            return NULL;
        for (p++; more; more--, p++) {
            if ((*p & 0xc0) != 0x80) return NULL;
            code = code << 6 | (*p & 0x3fu);
        }
        if (code < least[length] || code > 0x10ffffu || (code >= 0xd800u && code < 0xe000u))
            return NULL;
        if (code >= 0x10000u)
            wide[n++] = (wchar_t)(0xd7c0u + (code >> 10)), code = 0xdc00u + (code & 0x3ffu);
        wide[n++] = (wchar_t)code;
    }
    wide[n] = 0;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}
#endif

PANDIS__ONCE PANDIS_API pandis_error pandis_open_file(pandis_field *field, const char *path) {
    pandis_error error = PANDIS_ERROR_FILE;
    memset(field, 0, sizeof *field);
#ifndef PANDIS__READ
    struct stat found;
    int file = open(path, O_RDONLY);
    if (file < 0) return error;
    if (!fstat(file, &found) && found.st_size > 0) {
        size_t size = (size_t)found.st_size;
        void *data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, file, 0);
        if (data != MAP_FAILED) {
            error = pandis_open(field, data, size);
            if (error) munmap(data, size);
            field->mapped = !error;
        }
    } else if (!fstat(file, &found)) {
        error = PANDIS_ERROR_FORMAT;
    }
    close(file);
#else
    FILE *file = pandis__open_path(path);
    if (!file) return error;
    if (!fseek(file, 0, SEEK_END)) {
        long size = ftell(file);
        rewind(file);
        /* a directory may have a size, but nothing can be read from it */
        void *data = size > 0 && fgetc(file) != EOF ? malloc((size_t)size) : NULL;
        rewind(file);
        if (data && fread(data, 1, (size_t)size, file) == (size_t)size)
            error = pandis_open(field, data, (size_t)size);
        if (error) free(data);
        field->mapped = !error;
    }
    fclose(file);
#endif
    return error;
}
#endif

PANDIS__ONCE PANDIS_API void pandis_close(pandis_field *field) {
#ifndef PANDIS_NO_FILE
    void *data = (void *)(uintptr_t)field->data;
#ifndef PANDIS__READ
    if (field->mapped) munmap(data, field->size);
#else
    if (field->mapped) free(data);
#endif
#endif
    memset(field, 0, sizeof *field);
}

PANDIS__ONCE PANDIS_API const char *pandis_error_text(pandis_error error) {
    switch (error) {
    case PANDIS_SUCCESS: return "no error";
    case PANDIS_ERROR_FILE: return "the file is missing or cannot be read";
    case PANDIS_ERROR_FORMAT: return "this is not a .pandis file";
    case PANDIS_ERROR_ENDIAN: return "the byte order of the file differs from this machine's";
    case PANDIS_ERROR_VERSION:
        return "the file and this pandis.h differ in version: use the pandis.h that came with the "
               "file";
    case PANDIS_ERROR_SIZE:
        return "the file is shorter or longer than its header states: copy it again";
    case PANDIS_ERROR_CHECKSUM: return "the file is damaged: copy it again";
    case PANDIS_ERROR_CONTENT:
        return "the contents of the file are inconsistent, or this kind of field does not support "
               "the operation";
    case PANDIS_ERROR_ALIGNMENT:
        return "the bytes must begin at an address that is a multiple of 8";
    case PANDIS_ERROR_ARITHMETIC:
        return "pandis.h was compiled with flags, or called in a rounding mode, that break its "
               "arithmetic: compile without -ffast-math and the options that it implies";
    case PANDIS_ERROR_LARGE:
        return "the network is wider or deeper than pandis.h was compiled for: see "
               "PANDIS_MOST_WIDTH";
    case PANDIS_ERROR_RADIUS:
        return "the probe is larger than the known free space around the field's surface: use a "
               "smaller radius";
    case PANDIS_ERROR_KIND:
        return "a grid of forces has no distances outside the object, so it cannot have a contact";
    case PANDIS_ERROR_VERTEX: return "a vertex is not finite, or is too far away";
    case PANDIS_ERROR_POSE:
        return "an object has no field, or its rotation, scale, place or stiffness is invalid";
    case PANDIS_ERROR_OPTIONS:
        return "an option of a contact is beyond its range (budget at least 8, slide and radius at "
               "least 0, a texture's steepest at most 15, sliding friction at most the sticking "
               "friction, nothing negative)";
    case PANDIS_ERROR_COUNT: return "an array is shorter or longer than required";
    case PANDIS_ERROR_HEADER:
        return "the program and the compiled implementation differ in version or in the packing of "
               "structures: build both with the same pandis.h and the same packing";
    default: return "unknown error";
    }
}

#ifdef PANDIS__PUSHED
#pragma GCC pop_options
#endif
#if defined(__cplusplus) && defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#endif /* PANDIS_IMPLEMENTATION */

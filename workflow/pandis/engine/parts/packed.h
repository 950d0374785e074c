/* -------------------- closest points of a packed mesh
 *
 * The mesh's vertices lie on a lattice. Its faces are stored in blocks of up to 64. Each block
 * has its own corners, in as few bits as possible, and eight boxes around eight faces each; a tree
 * of eight-wide branches leads to the blocks. The nearest face is found in single precision,
 * relative to the block; its closest point and the answer are then computed in double precision.
 *
 * The side of a point whose closest point lies on an edge or a corner: all points with that closest
 * point form a convex cone that the surface does not enter, so they are on the same side. Two bits
 * store this side, so no neighbouring face is needed. Where the faces around the edge or corner are
 * nearly coplanar, and inside faces, the nearest face itself determines the side. Where rounding to
 * the lattice has folded the surface over itself, no face does; ray crossings are counted there. */

enum { PANDIS__BY_FACE, PANDIS__OUTSIDE, PANDIS__INSIDE, PANDIS__BY_RAY };

typedef struct {
    /* sides: NULL if every face determines the side */
    const unsigned char *boxes, *faces, *words, *sides;
    int32_t origin[3];
    int face_count, groups, corner_count, bits[3], stride; /* stride: bytes of a corner's word */
    int shift[3];                                          /* of its boxes */
} pandis__packed;

#define PANDIS__GROUP_BYTES 18 /* three times eight corners of six bits */

/* Shift of a box's byte coordinates, if extents need this many bits. */
static int pandis__coarse(int bits) { return bits > 8 ? bits - 8 : 0; }

PANDIS__INLINE void pandis__unpack(const pandis__compact *t, int32_t block, pandis__packed *b) {
    const pandis__block_record *record = t->blocks + block;
    b->face_count = (int)(record->counts & 63) + 1,
    b->corner_count = (int)(record->counts >> 6 & 63) + 1;
    b->groups = (b->face_count + PANDIS__WIDTH - 1) / PANDIS__WIDTH;
    for (int k = 0; k < 3; k++) {
        b->bits[k] = (int)(record->counts >> (12 + 5 * k) & 31);
        b->origin[k] = (int32_t)(record->origin >> (21 * k) & 0x1fffff);
        b->shift[k] = pandis__coarse(b->bits[k]);
    }
    b->stride = (b->bits[0] + b->bits[1] + b->bits[2]) / 8 + 1;
    b->boxes = t->packed + record->start;
    b->faces = b->boxes + 6 * PANDIS__WIDTH;
    b->words = b->faces + PANDIS__GROUP_BYTES * b->groups;
    b->sides = record->counts >> 27 & 1 ? b->words + b->stride * b->corner_count : NULL;
}

/* One of the three corners of eight faces: six bits each, an index into the block's corners. */
PANDIS__INLINE uint64_t pandis__six_bits(const unsigned char *bytes) {
    uint32_t low;
    uint16_t high;
    memcpy(&low, bytes, sizeof low), memcpy(&high, bytes + 4, sizeof high);
    return (uint64_t)high << 32 | low;
}

/* A corner's word: its coordinates one after the other, x from the lowest bit on. */
PANDIS__INLINE uint64_t pandis__word(const pandis__packed *b, int corner) {
    uint64_t word;
    memcpy(&word, b->words + b->stride * corner, sizeof word);
    return word;
}

/* Read the corners of eight faces, relative to the block's origin: (3 corners, 3 axes, 8). */
PANDIS__INLINE void pandis__group_corners(
    const pandis__packed *b, int group, float (*out)[3][PANDIS__WIDTH]) {
    const unsigned char *faces = b->faces + PANDIS__GROUP_BYTES * group;
    uint32_t xy[PANDIS__WIDTH], z[PANDIS__WIDTH], mask[3];
    int second = b->bits[0], third = second + b->bits[1];
    for (int k = 0; k < 3; k++) mask[k] = (1u << b->bits[k]) - 1;
    for (int c = 0; c < 3; c++) {
        uint64_t codes = pandis__six_bits(faces + 6 * c);
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            uint64_t word = pandis__word(b, (int)(codes >> 6 * i & 63));
            xy[i] = (uint32_t)word, z[i] = (uint32_t)(word >> third);
        }
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            out[c][0][i] = (float)(int32_t)(xy[i] & mask[0]);
            out[c][1][i] = (float)(int32_t)(xy[i] >> second & mask[1]);
            out[c][2][i] = (float)(int32_t)(z[i] & mask[2]);
        }
        if (third > 32)
            for (int i = 0; i < PANDIS__WIDTH; i++)
                out[c][1][i] =
                    (float)(int32_t)(pandis__word(b, (int)(codes >> 6 * i & 63)) >> second &
                        mask[1]);
    }
}

/* The keys of eight boxes: lower bounds of the squared distances to the faces in them. */
PANDIS__INLINE void pandis__byte_bounds(const unsigned char *PANDIS__RESTRICT boxes, int count,
    const int *shift, const float *PANDIS__RESTRICT q, int32_t *PANDIS__RESTRICT keys) {
    float out[PANDIS__WIDTH];
    float place[6 * PANDIS__WIDTH], scale[3], low[3], high[3];
    /* so that gcc uses vectors */
    for (int i = 0; i < 6 * PANDIS__WIDTH; i++) place[i] = (float)(int32_t)(uint32_t)boxes[i];
    for (int k = 0; k < 3; k++) {
        scale[k] = (float)(1 << shift[k]);
        float slack = 1e-6f * (fabsf(q[k]) + 256 * scale[k]);
        low[k] = q[k] + slack, high[k] = q[k] - slack;
    }
    for (int i = 0; i < PANDIS__WIDTH; i++) {
        float below = place[0 * PANDIS__WIDTH + i] * scale[0] - low[0],
              above = high[0] - place[3 * PANDIS__WIDTH + i] * scale[0];
        float x = below > above ? below : above;
        below = place[1 * PANDIS__WIDTH + i] * scale[1] - low[1],
        above = high[1] - place[4 * PANDIS__WIDTH + i] * scale[1];
        float y = below > above ? below : above;
        below = place[2 * PANDIS__WIDTH + i] * scale[2] - low[2],
        above = high[2] - place[5 * PANDIS__WIDTH + i] * scale[2];
        float z = below > above ? below : above;
        x = x > 0 ? x : 0, y = y > 0 ? y : 0, z = z > 0 ? z : 0;
        out[i] = (x * x + y * y + z * z) * 0.99999f;
    }
    memcpy(keys, out, sizeof out);
    for (int i = 0; i < PANDIS__WIDTH; i++) keys[i] = i < count ? (keys[i] & ~7) | i : INT32_MAX;
}

/* Squared distances to the eight triangles of a group. Their normals are exact as long as sides are
 * shorter than 2^12 steps. The error of the closest point inside a triangle is that of rounding,
 * divided by the sine of the triangle's narrowest angle. */
PANDIS__INLINE void pandis__group_distances(const pandis__packed *b, int group,
    const float *PANDIS__RESTRICT q, float *PANDIS__RESTRICT out) {
    float v[3][3][PANDIS__WIDTH];
    pandis__group_corners(b, group, v);
    pandis__eight_distances(v, q, out);
}

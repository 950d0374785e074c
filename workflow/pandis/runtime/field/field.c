/* pandis.h as a library for Python, and timing of single queries. */
#ifndef PANDIS_IMPLEMENTATION
#define _POSIX_C_SOURCE 199309L
#define PANDIS_IMPLEMENTATION
#endif
#include "../../engine/clock.h"
#include "../../engine/pandis.h"

size_t runtime_field_bytes(void) { return sizeof(pandis_field); }

size_t runtime_handover_bytes(void) { return sizeof(pandis_handover); }

void runtime_frame(const pandis_field *field, double *numbers) {
    for (int k = 0; k < 3; k++) numbers[k] = field->centre[k];
    numbers[3] = field->scale;
}

/* The same field in another frame, as if its mesh had other units and another position. Not for
 * closed forms, which are formulas in mesh units around the origin. */
void runtime_place(pandis_field *placed, const pandis_field *field, const double *numbers) {
    *placed = *field;
    placed->mapped = 0; /* the other field owns the bytes and releases them */
    for (int k = 0; k < 3; k++) placed->centre[k] = numbers[k];
    placed->scale = numbers[3];
}

/* Bytes from which answers are computed: all sections except bounds, provenance, original faces and
 * regions. */
size_t runtime_bytes(const pandis_field *field) {
    static const char *const others[] = {"COVR", "SAFE", "PROV", "BOND", "ORIG", "REGN", "RNAM"};
    size_t size = 0;
    for (uint32_t i = 0, count = pandis__u32(field->data + 36); i < count; i++) {
        const unsigned char *entry = field->data + PANDIS__HEADER + (size_t)i * PANDIS__SECTION;
        int answers = 1;
        for (int k = 0; k < 7; k++) answers &= memcmp(entry, others[k], 4) != 0;
        if (answers) size += (size_t)pandis__u64(entry + 16);
    }
    return size;
}

/* Answers at points; with `slopes` also the slopes of `pandis_answer`. */
void runtime_query(const pandis_field *field, const double *points, size_t count, double *distances,
    double *normals, unsigned char *flags, double *slopes) {
    pandis_answer answer;
    if (!slopes) {
        pandis_query_many(field, points, count, distances, normals, flags);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        pandis_query(field, points + 3 * i, &answer);
        distances[i] = answer.distance, slopes[i] = answer.slope,
        flags[i] = (unsigned char)answer.flag;
        memcpy(normals + 3 * i, answer.normal, sizeof answer.normal);
    }
}

/* Answers at points within a reach. */
void runtime_within(const pandis_field *field, const double *points, size_t count, double reach,
    double *distances, double *normals, unsigned char *flags, double *clear) {
    pandis_answer answer;
    for (size_t i = 0; i < count; i++) {
        pandis_query_within(field, points + 3 * i, reach, &answer);
        distances[i] = answer.distance, clear[i] = answer.clear,
        flags[i] = (unsigned char)answer.flag;
        memcpy(normals + 3 * i, answer.normal, sizeof answer.normal);
    }
}

/* Gradients and second derivatives of the distance; either may be NULL. */
void runtime_derivatives(const pandis_field *field, const double *points, size_t count,
    double *gradients, double *hessians) {
    double gradient[3], hessian[9];
    for (size_t i = 0; i < count; i++) {
        (void)pandis_derivatives(field, points + 3 * i, gradient, hessian);
        if (gradients) memcpy(gradients + 3 * i, gradient, sizeof gradient);
        if (hessians) memcpy(hessians + 9 * i, hessian, sizeof hessian);
    }
}

/* Duration of a refit, s; negative if it failed. */
double runtime_refit_time(pandis_field *moving, const double *vertices) {
    double start = seconds();
    return pandis_refit(moving, vertices, pandis_vertex_count(moving)) ? -1 : seconds() - start;
}

/* Radii around points that are certainly free of surface: `clear` of `pandis_answer`. */
void runtime_clear(const pandis_field *field, const double *points, size_t count, double *clear) {
    pandis_answer answer;
    for (size_t i = 0; i < count; i++) {
        pandis_query(field, points + 3 * i, &answer);
        clear[i] = answer.clear;
    }
}

/* Faces of mesh.zarr.zip that contain the closest points; -1 where they are unknown. */
void runtime_faces(const pandis_field *field, const double *points, size_t count, int32_t *faces) {
    pandis_answer answer;
    for (size_t i = 0; i < count; i++) {
        pandis_query(field, points + 3 * i, &answer);
        faces[i] = answer.face;
    }
}

/* Regions of the closest points; -1 where unknown. */
void runtime_regions(
    const pandis_field *field, const double *points, size_t count, int32_t *regions) {
    pandis_answer answer;
    for (size_t i = 0; i < count; i++) {
        pandis_query(field, points + 3 * i, &answer);
        regions[i] = answer.region;
    }
}

/* Penalty forces (three doubles each) and flags at points. */
void runtime_forces(const pandis_field *field, const double *points, size_t count, double stiffness,
    double *forces, unsigned char *flags) {
    for (size_t i = 0; i < count; i++)
        flags[i] = (unsigned char)pandis_force(field, points + 3 * i, stiffness, forces + 3 * i);
}

/* Duration (s) of each of `queries` single queries at the points in turn: within a reach if that is
 * not negative. Writing `bytes` bytes of `other` before each query empties the caches. */
void runtime_time(const pandis_field *field, const double *points, size_t count, size_t queries,
    double reach, double *taken, unsigned char *other, size_t bytes) {
    pandis_answer answer;
    volatile double sink = 0;
    for (size_t i = 0; i < queries; i++) {
        for (size_t k = 0; k < bytes; k += 16) other[k]++;
        double start = seconds();
        if (reach >= 0) pandis_query_within(field, points + 3 * (i % count), reach, &answer);
        else pandis_query(field, points + 3 * (i % count), &answer);
        taken[i] = seconds() - start;
        sink = sink + answer.distance;
    }
}

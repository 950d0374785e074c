/* Closest points by Embree's point query, for peers.py: one query at a time, timed. */
#define _POSIX_C_SOURCE 199309L
#include <embree3/rtcore.h>
#include <math.h>
#include <stddef.h>
#include <string.h>
#include <time.h>

typedef struct {
    const float (*vertices)[3];
    const int (*faces)[3];
    float nearest;
} search;

static float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Squared distance of a point from a triangle, by the region of its plane (Ericson, section 5.1.5).
 */
static float squared(const float *p, const float *a, const float *b, const float *c) {
    float ab[3], ac[3], ap[3], away[3];
    for (int k = 0; k < 3; k++) ab[k] = b[k] - a[k], ac[k] = c[k] - a[k], ap[k] = p[k] - a[k];
    float bb = dot(ab, ab), cc = dot(ac, ac), bc = dot(ab, ac);
    float d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc,
          d6 = d2 - cc;
    float va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2, s = 0, t = 0;
    if (d1 <= 0 && d2 <= 0) {
    } else if (d3 >= 0 && d4 <= d3) {
        s = 1;
    } else if (d6 >= 0 && d5 <= d6) {
        t = 1;
    } else if (vc <= 0 && d1 >= 0 && d3 <= 0) {
        s = d1 / (d1 - d3);
    } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
        t = d2 / (d2 - d6);
    } else if (va <= 0 && d4 >= d3 && d5 >= d6) {
        t = (d4 - d3) / (d4 - d3 + d5 - d6), s = 1 - t;
    } else {
        s = vb / (va + vb + vc), t = vc / (va + vb + vc);
    }
    for (int k = 0; k < 3; k++) away[k] = ap[k] - s * ab[k] - t * ac[k];
    return dot(away, away);
}

static bool visit(struct RTCPointQueryFunctionArguments *asked) {
    search *of = asked->userPtr;
    const int *f = of->faces[asked->primID];
    const float point[3] = {asked->query->x, asked->query->y, asked->query->z};
    float other = sqrtf(squared(point, of->vertices[f[0]], of->vertices[f[1]], of->vertices[f[2]]));
    if (other >= of->nearest) return false;
    of->nearest = asked->query->radius = other;
    return true;
}

/* Build the tree of a mesh. */
RTCScene embree_scene(const float *vertices, size_t many, const int *faces, size_t triangles) {
    RTCDevice device = rtcNewDevice("threads=1");
    RTCScene scene = rtcNewScene(device);
    RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    memcpy(rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, many),
        vertices, 12 * many);
    memcpy(rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles),
        faces, 12 * triangles);
    rtcSetGeometryBuildQuality(mesh, RTC_BUILD_QUALITY_HIGH);
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene, mesh);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcCommitScene(scene);
    return scene;
}

/* Distances of points, and seconds of each query. */
void embree_query(RTCScene scene, const float *vertices, const int *faces, const float *points,
    size_t count, float *distances, double *seconds) {
    for (size_t i = 0; i < count; i++) {
        struct timespec from, to;
        struct RTCPointQuery query = {
            .x = points[3 * i], .y = points[3 * i + 1], .z = points[3 * i + 2], .radius = INFINITY};
        struct RTCPointQueryContext context;
        search of = {(const float (*)[3])vertices, (const int (*)[3])faces, INFINITY};
        clock_gettime(CLOCK_MONOTONIC, &from);
        rtcInitPointQueryContext(&context);
        rtcPointQuery(scene, &query, &context, visit, &of);
        clock_gettime(CLOCK_MONOTONIC, &to);
        distances[i] = of.nearest;
        seconds[i] = (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
    }
}

#include <float.h>
#include <math.h>
#include <string.h>
#if defined(_MSC_VER)
#include <intrin.h>
#endif
#if defined(__FAST_MATH__) || defined(__RECIPROCAL_MATH__) ||                                      \
    (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0) || defined(_M_FP_FAST)
#error "pandis.h needs IEEE arithmetic: compile without -ffast-math (/fp:fast)"
#endif
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16 /* 16: only half-precision arithmetic differs */
#error "pandis.h needs arithmetic without excess precision: compile with -mfpmath=sse"
#endif
#ifndef PANDIS_NO_FILE
#if defined(_WIN32) || !defined(PANDIS_MMAP)
#define PANDIS__READ
#include <stdio.h>
#include <stdlib.h>
#else
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#endif
#endif

#if defined(__GNUC__) || defined(_MSC_VER)
#define PANDIS__RESTRICT __restrict
#elif defined(__cplusplus)
#define PANDIS__RESTRICT
#else
#define PANDIS__RESTRICT restrict
#endif

/* The code below needs only -O2. With it, GCC vectorises little, and even less if an operation
 * might trap, so further options are set here; clang needs none. Products and sums are rounded
 * separately, whatever the flags, so that all compilers, machines and vector widths give the same
 * bits. */
#if defined(__cplusplus) && defined(__GNUC__) /* the code is also C, which has no other casts */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wold-style-cast"
#pragma GCC diagnostic ignored "-Wcast-qual"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wuseless-cast"
#endif
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__INTEL_COMPILER)
#pragma GCC push_options
#pragma GCC optimize("O3", "no-trapping-math", "no-math-errno", "fp-contract=off")
#define PANDIS__PUSHED
#endif

/* without optimisation, inlining would make clang's stack frames larger */
#if defined(__GNUC__) && !(defined(__clang__) && !defined(__OPTIMIZE__))
#define PANDIS__ALWAYS inline __attribute__((always_inline))
#else
#define PANDIS__ALWAYS inline
#endif
#define PANDIS__INLINE static PANDIS__ALWAYS

/* Not inlined, so that the function keeps a separate stack frame. */
#if defined(__GNUC__)
#define PANDIS__APART __attribute__((noinline))
#elif defined(_MSC_VER)
#define PANDIS__APART __declspec(noinline)
#else
#define PANDIS__APART
#endif

/* For a function called once before a loop: compile it for size. */
#if defined(__GNUC__) && !defined(__clang__)
#define PANDIS__ONCE __attribute__((cold))
#else
#define PANDIS__ONCE
#endif

#ifndef PANDIS_MOST_WIDTH
#define PANDIS_MOST_WIDTH 1024
#endif
#ifndef PANDIS_MOST_DEPTH
#define PANDIS_MOST_DEPTH 16
#endif

#define PANDIS__LONGEST 1.8 /* longest side of a mesh in the unit frame */
#define PANDIS__HALF (PANDIS__LONGEST / 2)
#define PANDIS__FAR 1e150        /* larger coordinates overflow when squared */
#define PANDIS__EDGE (1 - 1e-12) /* the outermost faces of the box belong to its last cells */
/* number of lanes of a sum, whatever the machine's vector width */
#define PANDIS__LANES 16
/* largest number of points that share a pass over a network's weights */
#define PANDIS__POINTS 8
#define PANDIS__ROWS ((PANDIS_MOST_WIDTH + PANDIS__LANES - 1) / PANDIS__LANES * PANDIS__LANES)
/* capacity of the queue of boxes to visit; if it is full, the farthest are dropped */
#define PANDIS__HEAP 512
#define PANDIS__STACK 704
/* maximum depth of a tree: each level leaves seven entries on the stack */
#define PANDIS__DEEPEST 100
#define PANDIS__NO_BRICK 65535
#define PANDIS__MOST_BITS 20
/* number of boxes and faces that a search visits before it reads slabs or, in a packed mesh, goes
 * on best-first */
#define PANDIS__SOON 192
/* The budget of a mesh may be large because queries next to its surface need it. A search whose
 * nearest face is farther than CLOSE (unit frame) gets a sixteenth of the budget, but at least AWAY
 * and at most four times AWAY. If that is not enough, further searches, of up to CERTAIN boxes and
 * faces each, prove that nothing is nearer by more than DOUBT, or by more than a larger number. */
#define PANDIS__CLOSE 0.15
#define PANDIS__AWAY 500
#define PANDIS__CERTAIN 4000
#define PANDIS__DOUBT 0.9e-3
#define PANDIS__SLACK 16 /* bytes after the last block that are read but not used */
#define PANDIS__BLOCK 64 /* maximum number of faces, and of corners, per block of a packed mesh */

static double pandis__dot(const double *u, const double *v) {
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
}

static void pandis__cross(const double *u, const double *v, double *out) {
    out[0] = u[1] * v[2] - u[2] * v[1];
    out[1] = u[2] * v[0] - u[0] * v[2];
    out[2] = u[0] * v[1] - u[1] * v[0];
}

#define PANDIS__STIFFEST 1e100
#define PANDIS__TINY 1e-150 /* squares of smaller numbers lose digits */

/* Scale a vector to unit length; returns 0 if its length is 0. */
static int pandis__normalise(double *v) {
    double length = sqrt(pandis__dot(v, v));
    if (!(length > PANDIS__TINY)) return 0;
    for (int k = 0; k < 3; k++) v[k] /= length;
    return 1;
}

/* Move a point into a box; returns the distance moved. */
static double pandis__clamp_to(
    const double *low, const double *high, const double *u, double *inside) {
    double off[3];
    for (int k = 0; k < 3; k++) {
        inside[k] = u[k] < low[k] ? low[k] : u[k] > high[k] ? high[k] : u[k];
        off[k] = u[k] - inside[k];
    }
    return sqrt(pandis__dot(off, off));
}

static double pandis__clamp(const double *u, double *inside) {
    static const double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    return pandis__clamp_to(low, high, u, inside);
}

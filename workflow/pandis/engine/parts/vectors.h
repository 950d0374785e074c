
/* -------------------- vectors
 *
 * Sums run in lanes. If the compiler has vector types, these hold the lanes, because the compiler
 * would not keep lanes in registers by itself. Otherwise a vector is a single number. The order of
 * additions is the same for every width. */
#if (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 9)) && !defined(PANDIS_NO_VECTORS)
#if defined(__AVX512F__)
#define PANDIS__VECTOR 16
#elif defined(__AVX__) || (defined(__x86_64__) && !defined(_WIN32))
#define PANDIS__VECTOR 8
#else
#define PANDIS__VECTOR 4
#endif
typedef float pandis__vector __attribute__((vector_size(4 * PANDIS__VECTOR)));
typedef float pandis__floats
    __attribute__((vector_size(4 * PANDIS__VECTOR), aligned(4), may_alias));
typedef int16_t pandis__shorts
    __attribute__((vector_size(2 * PANDIS__VECTOR), aligned(2), may_alias));
typedef int32_t pandis__ints __attribute__((vector_size(4 * PANDIS__VECTOR)));
typedef float pandis__quad __attribute__((vector_size(16)));
typedef int32_t pandis__quad_ints __attribute__((vector_size(16)));
/* four of the eight lanes of two vectors */
#ifdef __clang__
#define PANDIS__PICK(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#else
#define PANDIS__PICK(a, b, i, j, k, l)                                                             \
    __builtin_shuffle(a, b, __extension__(pandis__quad_ints){i, j, k, l})
#endif
/* macros, because the ABI determines how a function returns a vector */
#define pandis__load(p) (*(const pandis__floats *)(p))
#define pandis__load16(p) __builtin_convertvector(*(const pandis__shorts *)(p), pandis__vector)
#else
#define PANDIS__VECTOR 1
typedef float pandis__vector;
#define pandis__load(p) (*(p))
#define pandis__load16(p) ((float)*(p))
#endif
/* GCC needs these intrinsics to convert in one instruction; clang does it by itself */
#if PANDIS__VECTOR == 8 && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define pandis__load16_wide(p)                                                                     \
    __builtin_convertvector(                                                                       \
        (pandis__ints)__builtin_ia32_pmovsxwd256(*(const pandis__shorts *)(p)), pandis__vector)
#ifdef __AVX2__
#undef pandis__load16
#define pandis__load16 pandis__load16_wide
#endif
#else
#define pandis__load16_wide pandis__load16
#if PANDIS__VECTOR == 16 && !defined(__clang__)
#undef pandis__load16
#define pandis__load16(p)                                                                          \
    __builtin_convertvector(                                                                       \
        (pandis__ints)__builtin_ia32_pmovsxwd512_mask(                                             \
            *(const pandis__shorts *)(p), __extension__(pandis__ints){0}, 0xffff),                 \
        pandis__vector)
#endif
#endif
#define PANDIS__PARTS (PANDIS__LANES / PANDIS__VECTOR)

/* Hot functions are compiled twice if the program is for any x86-64 machine: as `name_plain`, and
 * as `name_wide` for AVX2, which is used where the machine has it. Not on Windows, which does not
 * align the stack for such vectors. */
#if PANDIS__VECTOR == 8 && defined(__x86_64__) && !defined(__AVX2__) && !defined(_WIN32) &&        \
    !defined(PANDIS_NO_DISPATCH)
#define PANDIS__WIDE __attribute__((target("avx2")))
#define PANDIS__TWICE(plain, wide) plain wide
#define PANDIS__CHOOSE(name) (__builtin_cpu_supports("avx2") ? name##_wide : name##_plain)
#else
#define PANDIS__WIDE
#define PANDIS__TWICE(plain, wide) plain
#define PANDIS__CHOOSE(name) name##_plain
#endif

/* Define a function with its own stack frame from `name_body`. */
#define PANDIS__COMPILE(name, parameters, arguments)                                               \
    PANDIS__TWICE(                                                                                 \
        PANDIS__APART static void name##_plain parameters { name##_body arguments; },              \
        PANDIS__WIDE PANDIS__APART static void name##_wide parameters { name##_body arguments; })  \
    static void name parameters { PANDIS__CHOOSE(name) arguments; }

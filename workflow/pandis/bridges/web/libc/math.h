/* The libm functions that pandis.h calls: WebAssembly instructions, and for moving objects and
 * textures three functions that the page provides. */
#ifndef WEB_MATH_H
#define WEB_MATH_H
#define NAN __builtin_nanf("")
#define INFINITY __builtin_inff()
#define sqrt __builtin_sqrt
#define sqrtf __builtin_sqrtf
#define fabs __builtin_fabs
#define fabsf __builtin_fabsf
#define floor __builtin_floor
static inline double fmax(double a, double b) { return a > b || b != b ? a : b; }
static inline double fmin(double a, double b) { return a < b || b != b ? a : b; }
double sin(double x);
double cos(double x);
double atan2(double y, double x);
#endif

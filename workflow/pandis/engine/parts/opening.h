/* pandis.h: distance, normal and contact force of an object, for haptic loops.
 *
 * One header, one file per object, no library except libm, no allocation and no system call per
 * query:
 *
 *     #define PANDIS_IMPLEMENTATION            in one source file, before
 *     #include "pandis.h"
 *
 *     pandis_field bunny;
 *     pandis_error error = pandis_open_file(&bunny, "bunny.pandis");
 *     if (error) return puts(pandis_error_text(error));
 *     ...
 *     double force[3];                         every millisecond
 *     pandis_force(&bunny, position, stiffness, force);
 *     ...
 *     pandis_close(&bunny);
 *
 * Several objects; only those that the probe may touch are queried:
 *
 *     pandis_object objects[2] = {...};        fields and their poses
 *     static double room[PANDIS_SCENE_ROOM(2)];
 *     pandis_scene scene;
 *     error = pandis_scene_open(&scene, objects, 2, room, PANDIS_SCENE_ROOM(2));
 *     pandis_scene_force(&scene, position, force);
 *
 * Positions and distances are in the units of the mesh that the field was made from; distances are
 * negative inside, normals point outward and have unit length. Queries do not change a field: any
 * number of threads may query it. The file format is described in docs/format.md of pandis.
 *
 * C99 or later, or C++11 or later. No flags are needed: with -O2 alone it is about as fast as with
 * -O3 -march=native, since GCC and clang also compile the hot functions for AVX2, which is used on
 * x86-64 machines that have it (not on Windows; PANDIS_NO_DISPATCH disables this). Results are
 * bit-identical for all compilers, machines and vector widths (except clang with
 * -ffp-contract=fast). With -ffast-math or x87 arithmetic it does not compile, because answers
 * would be wrong. pandis_open tests for options of -ffast-math that define no macro. A query needs
 * at most 8 KB of stack, or 80 KB for a network. With a smaller PANDIS_MOST_WIDTH and
 * PANDIS_MOST_DEPTH (by default 1024 and 16), a network needs four bytes times (depth + 2) times
 * width. Define PANDIS_API as `static inline` to keep the names to one source file, and
 * PANDIS_NO_FILE to leave out the functions that open files.
 *
 * For a real-time loop: open fields before the loop (a file is read and checked, which
 * takes 4 ms per megabyte), lock the process's memory (mlockall(MCL_CURRENT | MCL_FUTURE); on
 * Windows raise the working set with SetProcessWorkingSetSize and VirtualLock the bytes given to
 * pandis_open), query every field at a few points, so that its pages are loaded and the caches
 * filled, and set a real-time priority for the thread (SCHED_FIFO). A query allocates nothing,
 * locks nothing and makes no system call. Its time hardly depends on the position, except for
 * meshes: where very many faces are about equally near (the middle of a finely tessellated ball), a
 * query can take some hundreds of times as long as usual. It is cut short after a limited number
 * of steps, which depends on the file: see PANDIS_CUT.
 *
 * This header comes from pandis, a workflow that makes, measures and exports distance fields of
 * triangle meshes for haptic rendering. The header needs nothing else from it.
 *
 * MIT License. Copyright (c) 2026 The pandis authors
 *
 * Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
 * associated documentation files (the "Software"), to deal in the Software without restriction,
 * including without limitation the rights to use, copy, modify, merge, publish, distribute,
 * sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
 * furnished to do so, subject to the following conditions:
 *
 * The above copyright notice and this permission notice shall be included in all copies or
 * substantial portions of the Software.
 *
 * THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
 * NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
 * NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM,
 * DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
 * OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
 */
#ifndef PANDIS_H
#define PANDIS_H

#include <stddef.h>
#include <stdint.h>

/* Version of this header; a file contains its format version (PANDIS_FORMAT_VERSION). */
#define PANDIS_VERSION_MAJOR 0
#define PANDIS_VERSION_MINOR 2
#define PANDIS_VERSION_PATCH 0
#define PANDIS_VERSION "0.2.0"
#define PANDIS_FORMAT_VERSION 4

#ifdef __cplusplus
extern "C" {
#endif

#ifndef PANDIS_API
#define PANDIS_API extern
#endif

/* A field of a .pandis file as a signed distance field of MuJoCo: the plugin `pandis.sdf`.
 *
 * While MuJoCo compiles a model, it passes only numbers to the plugin; in a simulation it passes
 * its data and the index of an instance. Therefore each file is opened once per process, stays open
 * and has a number. Each thread caches its last answers, because MuJoCo queries distance and
 * gradient of a point in succession, and then points next to it. Each state caches the spline cells
 * that it has queried, because a step queries thousands of points, most of them in a few hundred
 * cells. */
#define PANDIS_API static inline
#define PANDIS_IMPLEMENTATION
#include "../../engine/pandis.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <mujoco/mujoco.h>

/* Memory layouts differ between releases; these two share one. */
#define OLDEST 4000000
#define NEWEST 4000001
#if mjVERSION_HEADER < OLDEST || mjVERSION_HEADER > NEWEST
#error "pandis.sdf supports only MuJoCo 4.0.0 and 4.0.1"
#endif

#define NAME "pandis.sdf"
enum { FILENAME, SCALE, ATTRIBUTES };
static const char *const attributes[] = {"file", "scale"};

/* -------------------- MuJoCo */

/* The functions of MuJoCo that the plugin needs. A program linked with MuJoCo exposes them to the
 * plugins that it loads; Python does not, and passes them explicitly. */
typedef struct {
    int (*version)(void);
    void (*defaults)(mjpPlugin *);
    int (*add)(const mjpPlugin *);
    const char *(*config)(const mjModel *, int, const char *);
    void (*warn)(const char *, ...);
} pandis_mujoco;

#pragma weak mj_version
#pragma weak mjp_defaultPlugin
#pragma weak mjp_registerPlugin
#pragma weak mj_getPluginConfig
#pragma weak mju_warning
static pandis_mujoco mujoco;

/* -------------------- files */

typedef struct opened {
    struct opened *next;
    int number; /* from 1 on */
    pandis_field field;
} opened;

static opened *files;
static pthread_mutex_t files_lock = PTHREAD_MUTEX_INITIALIZER;

/* Find an open file with the same bytes, or keep the new one open. Returns NULL, or why the file
 * cannot be opened. */
static const char *find_or_open(const char *path, opened **found) {
    opened *made = calloc(1, sizeof *made);
    if (!made) return "there is not enough memory for it";
    pandis_field *field = &made->field;
    const int error = pandis_open_file(field, path);
    const char *wrong = error ? pandis_error_text(error) : NULL;
    if (error == PANDIS_ERROR_FILE)
        wrong = "it cannot be read (a relative path starts from the working directory)";
    if (!error && field->kind == PANDIS_GRID && field->as.grid.rule <= PANDIS__TRILINEAR)
        wrong = "it is a grid of forces, which has no distances outside: use another kind of field";
    for (*found = wrong ? NULL : files; *found; *found = (*found)->next) {
        const pandis_field *other = &(*found)->field;
        if (other->size == field->size && !memcmp(other->data, field->data, field->size)) break;
    }
    if (wrong || *found) {
        if (!error) pandis_close(field);
        free(made);
        return wrong;
    }
    made->number = files ? files->number + 1 : 1;
    made->next = files, files = *found = made;
    return NULL;
}

/* Return an open file, opening it if necessary; NULL, and the reason, if it cannot be opened. */
static const opened *open_file(const char *path, const char **wrong) {
    opened *found = NULL;
    pthread_mutex_lock(&files_lock);
    *wrong = path && *path ? find_or_open(path, &found)
                           : "no file is named: add <config key=\"file\" value=\"...\"/>";
    pthread_mutex_unlock(&files_lock);
    return found;
}

static const opened *file_of(double number) {
    pthread_mutex_lock(&files_lock);
    const opened *file = files;
    while (file && file->number != (int)number) file = file->next;
    pthread_mutex_unlock(&files_lock);
    return file;
}

/* Parse a scale: 1 if the text is empty, 0 if it is not a positive number. */
static double scale_of(const char *text) {
    char *end;
    if (!text || !*text) return 1;
    const double scale = strtod(text, &end);
    return !*end && scale > 1e-100 && scale < 1e100 ? scale : 0;
}

/* -------------------- answers */

/* Pose of a file's object in the frame of a geom: its scale, and the pose of its mesh, because
 * MuJoCo moves the origin of a mesh read from a file to the centre of mass. A mesh made from the
 * field itself has no such pose. */
typedef struct {
    const opened *file;
    /* point of the file = (origin + turn * point of the geom) / scale */
    double scale, origin[3], turn[9];
    int turned, asking;
    pandis__cells *cells; /* of a spline: cache of earlier queries; NULL: none */
} placed;

/* The last answers of a thread, for up to KEPT files. */
enum { KEPT = 8 };
static __thread struct {
    const opened *file;
    double point[3];
    int whole; /* the answer includes the normal */
    pandis_answer answer;
} kept[KEPT];

/* Return the answer at a point of a file, in the file's units; with the normal if `whole`. */
static const pandis_answer *ask(placed *p, const double point[3], int whole) {
    const opened *file = p->file;
    const pandis_field *field = &file->field;
    int at = file->number % KEPT;
    int again = kept[at].file == file && !memcmp(kept[at].point, point, sizeof kept[at].point);
    if (again && (kept[at].whole || !whole)) return &kept[at].answer;
    if (kept[at].file != file) memset(&kept[at], 0, sizeof kept[at]), kept[at].file = file;
    memcpy(kept[at].point, point, sizeof kept[at].point);
    /* for all other kinds, the normal takes no extra time */
    kept[at].whole = whole || field->kind != PANDIS_NETWORK;
    if (kept[at].whole) {
        /* MuJoCo queries a state from one thread; if two threads query it at once, the second one
         * does not use the cache */
        pandis__cells *cells =
            p->cells && !__atomic_exchange_n(&p->asking, 1, __ATOMIC_ACQUIRE) ? p->cells : NULL;
        pandis__start begin = PANDIS__ANYWHERE;
        pandis__ask(field, point, &begin, cells, &kept[at].answer);
        if (cells) __atomic_store_n(&p->asking, 0, __ATOMIC_RELEASE);
    } else {
        kept[at].answer.flag = pandis_distance(field, point, &kept[at].answer.distance);
    }
    return &kept[at].answer;
}

static void into_file(const placed *p, const mjtNum at[3], double point[3]) {
    for (int k = 0; k < 3; k++) {
        const double *row = p->turn + 3 * k;
        point[k] =
            (p->turned ? p->origin[k] + row[0] * at[0] + row[1] * at[1] + row[2] * at[2] : at[k]) /
            p->scale;
    }
}

static mjtNum distance_at(placed *p, const mjtNum at[3]) {
    double point[3];
    into_file(p, at, point);
    const pandis_answer *answer = ask(p, point, 0);
    return answer->flag == PANDIS_INVALID ? mjMAXVAL : answer->distance * p->scale;
}

/* -------------------- callbacks from MuJoCo */

/* Store the pose of the mesh that represents an object. */
static void take_pose(placed *p, const mjtNum at[3], const mjtNum q[4]) {
    p->turned = at[0] != 0 || at[1] != 0 || at[2] != 0 || q[0] != 1;
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double turn[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y),
        2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
    memcpy(p->turn, turn, sizeof turn), memcpy(p->origin, at, sizeof p->origin);
}

/* Largest difference between the bounds of the object's mesh in the model and of the field's
 * surface, as a share of the longest side. MuJoCo looks for contacts only where the boxes of meshes
 * meet. */
static double gap(const placed *p, const mjModel *m, int mesh) {
    const pandis_field *field = &p->file->field;
    if (field->margin[0] >= 1e300) return 0; /* the file does not store bounds of its surface */
    double low[3], high[3], box[2][3] = {{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}},
                            worst = 0;
    const float *vertices = m->mesh_vert + 3 * (size_t)m->mesh_vertadr[mesh];
    for (int i = 0; i < m->mesh_vertnum[mesh]; i++) {
        const mjtNum at[3] = {vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]};
        double point[3];
        into_file(p, at, point);
        for (int k = 0; k < 3; k++)
            box[0][k] = fmin(box[0][k], point[k]), box[1][k] = fmax(box[1][k], point[k]);
    }
    pandis_bounds(field, low, high);
    for (int k = 0; k < 3; k++)
        worst = fmax(worst, fmax(fabs(low[k] - box[0][k]), fabs(high[k] - box[1][k])));
    return worst / pandis_longest_side(field);
}

/* Store the pose of an instance whose file and scale are valid. Returns NULL, or why the instance
 * is invalid. */
static const char *take_meshes(placed *p, const mjModel *m, int instance) {
    int mesh = -1;
    for (int g = 0; g < m->ngeom; g++) {
        const int next = m->geom_plugin[g] == instance ? m->geom_dataid[g] : -1;
        if (mesh >= 0 && next >= 0 && next != mesh)
            return "geoms of one instance have different meshes: give each mesh an instance of its "
                   "own";
        if (next >= 0) mesh = next;
    }
    if (mesh < 0) return NULL;
    take_pose(p, m->mesh_pos + 3 * mesh, m->mesh_quat + 4 * mesh);
    const double apart = gap(p, m, mesh);
    if (apart > 0.02)
        mujoco.warn(NAME ": mesh %s ends elsewhere than the field's surface (their bounds are %.2g "
                         "of the longest side apart), so MuJoCo misses contacts there. Either its "
                         "scale is another one than the field's, or thin parts are missing from "
                         "it: give it the field's scale, and the mesh file that the field was made "
                         "from",
            m->names + m->name_meshadr[mesh], apart);
    return NULL;
}

static placed *placed_of(const mjData *d, int instance) {
    return (placed *)d->plugin_data[instance];
}

/* Allocate a state's cache for a spline. Without it answers are the same, but slower. */
static void make_room(placed *p) {
    p->asking = 0;
    p->cells = p->file->field.kind == PANDIS_SPLINE ? calloc(1, sizeof *p->cells) : NULL;
}

static int init(const mjModel *m, mjData *d, int instance) {
    const char *path = mujoco.config(m, instance, attributes[FILENAME]), *wrong = NULL;
    placed *made = calloc(1, sizeof *made);
    if (!made) return -1;
    made->file = open_file(path, &wrong);
    made->scale = scale_of(mujoco.config(m, instance, attributes[SCALE]));
    if (!wrong)
        wrong = made->scale ? take_meshes(made, m, instance) : "scale is not a positive number";
    if (wrong) {
        mujoco.warn(NAME ": %s: %s", path && *path ? path : "an instance", wrong);
        free(made);
        return -1;
    }
    make_room(made);
    d->plugin_data[instance] = (uintptr_t)made;
    return 0;
}

static void destroy(mjData *d, int instance) {
    placed *p = placed_of(d, instance);
    if (p) free(p->cells);
    free(p);
    d->plugin_data[instance] = 0;
}

static void copy(mjData *to, const mjModel *m, const mjData *from, int instance) {
    (void)m;
    placed *made = malloc(sizeof *made);
    if (made) *made = *placed_of(from, instance), make_room(made);
    to->plugin_data[instance] = (uintptr_t)made;
}

static int no_state(const mjModel *m, int instance) { return (void)m, (void)instance, 0; }

static void reset(const mjModel *m, mjtNum *state, void *data, int instance) {
    (void)m, (void)state, (void)data, (void)instance;
}

static void compute(const mjModel *m, mjData *d, int instance, int capability) {
    (void)m, (void)d, (void)instance, (void)capability;
}

static mjtNum sdf_distance(const mjtNum point[3], const mjData *d, int instance) {
    return distance_at(placed_of(d, instance), point);
}

static void sdf_gradient(mjtNum gradient[3], const mjtNum at[3], const mjData *d, int instance) {
    placed *p = placed_of(d, instance);
    double point[3];
    into_file(p, at, point);
    const pandis_answer *answer = ask(p, point, 1);
    const double *n = answer->normal;
    for (int k = 0; k < 3; k++) {
        gradient[k] =
            p->turned ? p->turn[k] * n[0] + p->turn[3 + k] * n[1] + p->turn[6 + k] * n[2] : n[k];
        if (answer->flag == PANDIS_INVALID) gradient[k] = 0;
    }
}

/* Open the file while a model is compiled, and pass its number on. */
static void sdf_attribute(mjtNum attribute[], const char *name[], const char *value[]) {
    const char *asked[ATTRIBUTES] = {NULL, NULL}, *wrong;
    for (int i = 0; i < ATTRIBUTES; i++) {
        for (int k = 0; k < ATTRIBUTES; k++) {
            if (name[i] && !strcmp(name[i], attributes[k])) asked[k] = value[i];
        }
    }
    const opened *file = open_file(asked[FILENAME], &wrong);
    attribute[FILENAME] = file ? file->number : 0, attribute[SCALE] = scale_of(asked[SCALE]);
}

/* A file that cannot be opened counts as a ball while its mesh is made, since MuJoCo terminates on
 * an empty box; later `init` refuses it. */
static mjtNum sdf_staticdistance(const mjtNum at[3], const mjtNum *attribute) {
    placed made = {file_of(attribute[FILENAME]), attribute[SCALE], {0}, {0}, 0, 0, NULL};
    if (made.file && made.scale) return distance_at(&made, at);
    return sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]) - 1;
}

static void sdf_aabb(mjtNum aabb[6], const mjtNum *attribute) {
    const opened *file = file_of(attribute[FILENAME]);
    const double scale = file && attribute[SCALE] ? attribute[SCALE] : 1;
    double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    if (file && attribute[SCALE]) pandis_bounds(&file->field, low, high);
    for (int k = 0; k < 3; k++)
        aabb[k] = scale * (low[k] + high[k]) / 2, aabb[3 + k] = scale * (high[k] - low[k]) / 2;
}

/* -------------------- registration */

#define SHOWN __attribute__((visibility("default")))

/* Register the plugin with the MuJoCo that these functions belong to. Returns 0 if its version is
 * not supported. */
SHOWN int pandis_mujoco_register(const pandis_mujoco *given) {
    if (given->version() < OLDEST || given->version() > NEWEST) return 0;
    mujoco = *given;
    mjpPlugin made;
    mujoco.defaults(&made);
    made.name = NAME;
    made.nattribute = ATTRIBUTES, made.attributes = attributes;
    made.capabilityflags = mjPLUGIN_SDF;
    made.nstate = no_state, made.init = init, made.destroy = destroy, made.copy = copy;
    made.reset = reset, made.compute = compute;
    made.sdf_distance = sdf_distance, made.sdf_gradient = sdf_gradient;
    made.sdf_staticdistance = sdf_staticdistance;
    made.sdf_attribute = sdf_attribute, made.sdf_aabb = sdf_aabb;
    mujoco.add(&made);
    return 1;
}

/* Runs when mj_loadPluginLibrary loads the plugin. */
__attribute__((constructor)) static void loaded(void) {
    const pandis_mujoco there = {
        mj_version, mjp_defaultPlugin, mjp_registerPlugin, mj_getPluginConfig, mju_warning};
    if (!there.version || !there.defaults || !there.add || !there.config || !there.warn) return;
    if (!pandis_mujoco_register(&there)) {
        there.warn("%s",
            NAME ": it is not registered, because it supports only MuJoCo 4.0.0 and 4.0.1, and "
                 "this is a different version");
    }
}

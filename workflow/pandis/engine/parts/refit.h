/* -------------------- meshes that move
 *
 * A refit writes only the vertices, the boxes around them, and the error bounds of leaves. Queries
 * compute triangles and vertex normals from the vertices where they need them. */

static uint64_t pandis__whole_words(uint64_t bytes) { return (bytes + 7) / 8 * 8; }

PANDIS_API size_t pandis_vertex_count(const pandis_field *field) {
    return field->kind == PANDIS_MESH ? (size_t)field->as.mesh.vertex_count : 0;
}

PANDIS_API size_t pandis_refit_room(const pandis_field *field) {
    const pandis__mesh *m = &field->as.mesh;
    if (field->kind != PANDIS_MESH) return 0;
    uint64_t v = (uint64_t)m->vertex_count, f = (uint64_t)m->face_count,
             n = (uint64_t)m->node_count;
    uint64_t leaves = (uint64_t)m->leaf_count, corners = leaves * PANDIS__WIDTH * 3;
    uint64_t lists = pandis__whole_words(
        sizeof(int32_t) * (v + 1 + 3 * f + corners) + 2 * sizeof(float) * leaves);
    return (size_t)(3 * v * sizeof(double) + n * sizeof(pandis__node) + lists);
}

/* Compute the box around a leaf, and the error bounds of its distances. */
static void pandis__refit_leaf(
    const pandis__mesh *m, int32_t leaf, float pad, float *low, float *high, float *slack) {
    float v[3][3][PANDIS__WIDTH];
    const double *base = m->vertices + 3 * (ptrdiff_t)*pandis__leaf_vertices(m, leaf);
    pandis__moved_triangles(m, leaf, base, v);
    pandis__slacks(v, slack);
    for (int k = 0; k < 3; k++) {
        float least[PANDIS__WIDTH], most[PANDIS__WIDTH];
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            float x = v[0][k][i], y = v[1][k][i], z = v[2][k][i];
            least[i] = x < y ? (x < z ? x : z) : (y < z ? y : z),
            most[i] = x > y ? (x > z ? x : z) : (y > z ? y : z);
        }
        for (int i = 1; i < PANDIS__WIDTH; i++) {
            least[0] = least[i] < least[0] ? least[i] : least[0];
            most[0] = most[i] > most[0] ? most[i] : most[0];
        }
        low[k] = (float)(base[k] + (double)least[0]) - pad,
        high[k] = (float)(base[k] + (double)most[0]) + pad;
    }
}

/* Compute the boxes of all nodes, bottom up. */
static void pandis__refit_boxes(const pandis__mesh *m, pandis__node *nodes, float (*slacks)[2]) {
    /* the float box of a point may be off by half a unit in the last place of the coordinates */
    float pad = (float)(m->reach * 4e-7);
    for (int32_t index = m->node_count - 1; index >= 0; index--) {
        pandis__node *node = nodes + index;
        for (int i = 0; i < PANDIS__WIDTH; i++) {
            if (node->low[0][i] > node->high[0][i]) continue; /* there is no child */
            float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
            int32_t child = node->child[i];
            if (child < 0) pandis__refit_leaf(m, ~child, pad, low, high, slacks[~child]);
            for (int lane = 0; child >= 0 && lane < PANDIS__WIDTH; lane++)
                for (int k = 0; k < 3; k++) {
                    float below = nodes[child].low[k][lane], above = nodes[child].high[k][lane];
                    low[k] = below < low[k] ? below : low[k],
                    high[k] = above > high[k] ? above : high[k];
                }
            for (int k = 0; k < 3; k++) node->low[k][i] = low[k], node->high[k][i] = high[k];
        }
    }
}

PANDIS__ONCE PANDIS_API pandis_error pandis_refit_open(
    pandis_field *moving, const pandis_field *field, void *room, size_t size) {
    if (field->kind != PANDIS_MESH) return PANDIS_ERROR_CONTENT;
    if (size < pandis_refit_room(field)) return PANDIS_ERROR_COUNT;
    if ((uintptr_t)room % 8) return PANDIS_ERROR_ALIGNMENT;
    const pandis__mesh *m = &field->as.mesh;
    size_t v = (size_t)m->vertex_count, f = (size_t)m->face_count, n = (size_t)m->node_count;
    double *vertices = (double *)room;
    pandis__node *nodes = (pandis__node *)(void *)(vertices + 3 * v);
    int32_t *around = (int32_t *)(void *)(nodes + n), *corners_at = around + v + 1;
    memcpy(vertices, m->vertices, 3 * v * sizeof *vertices);
    memcpy(nodes, m->nodes, n * sizeof *nodes);
    /* the corners at each vertex, in the order of faces in which the original normals were summed
     */
    memset(around, 0, (v + 1) * sizeof *around);
    for (size_t i = 0; i < 3 * f; i++) around[m->faces[i]]++;
    int32_t before = 0;
    for (size_t i = 0; i <= v; i++) {
        int32_t here = around[i];
        around[i] = before, before += here;
    }
    for (size_t i = 0; i < 3 * f; i++) corners_at[around[m->faces[i]]++] = (int32_t)i;
    for (size_t i = v; i > 0; i--) around[i] = around[i - 1];
    around[0] = 0;
    int32_t *listed = corners_at + 3 * f;
    for (int32_t leaf = 0; leaf < m->leaf_count; leaf++)
        for (int i = 0; i < 3 * PANDIS__WIDTH; i++) {
            const pandis__leaf *l = m->leaves + leaf;
            *listed++ = m->faces[3 * (ptrdiff_t)l->face[l->face[i / 3] < 0 ? 0 : i / 3] + i % 3];
        }
    float (*slacks)[2] = (float (*)[2])(void *)listed;
    for (int32_t leaf = 0; leaf < m->leaf_count; leaf++)
        slacks[leaf][0] = m->leaves[leaf].slack, slacks[leaf][1] = m->leaves[leaf].share;
    *moving = *field;
    moving->mapped = 0; /* the bytes belong to the original field, which frees them */
    pandis__mesh *own = &moving->as.mesh;
    own->vertices = vertices, own->nodes = nodes, own->around = around,
    own->corners_at = corners_at;
    own->slacks = (const float (*)[2])slacks;
    own->vertex_normals = NULL, own->slabs = NULL;
    own->most = INT32_MAX; /* no budget is known that suits all shapes */
    return PANDIS_SUCCESS;
}

PANDIS_API pandis_error pandis_refit(pandis_field *moving, const double *vertices, size_t count) {
    pandis__mesh *m = &moving->as.mesh;
    if (moving->kind != PANDIS_MESH || !m->around) return PANDIS_ERROR_CONTENT;
    if (count != (size_t)m->vertex_count) return PANDIS_ERROR_COUNT;
    int good = 1; /* 0 for NaN, too */
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < count; i++)
            good &= fabs((vertices[3 * i + (size_t)k] - moving->centre[k]) * moving->scale) <= 1e30;
    if (!good) return PANDIS_ERROR_VERTEX;
    double *own = (double *)(uintptr_t)m->vertices, most = 0; /* the room is the caller's */
    double low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = 1e300, high[k] = -1e300;
    for (size_t i = 0; i < 3 * count; i += 3)
        for (size_t k = 0; k < 3; k++) {
            double x = (vertices[i + k] - moving->centre[k]) * moving->scale;
            own[i + k] = x, low[k] = x < low[k] ? x : low[k], high[k] = x > high[k] ? x : high[k];
        }
    for (int k = 0; k < 3; k++) {
        moving->low[k] = low[k], moving->high[k] = high[k];
        most = fmax(most, fmax(-low[k], high[k]));
    }
    m->reach = most;
    pandis__refit_boxes(m, (pandis__node *)(uintptr_t)m->nodes, (float (*)[2])(uintptr_t)m->slacks);
    return PANDIS_SUCCESS;
}

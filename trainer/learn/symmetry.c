// Finds the fields of a window and computes its symmetric copies.
#include "learn/symmetry.h"

#include <string.h>

// --- the mesh ---

static bool are_same(const pm_mesh *a, const pm_mesh *b) {
    return memcmp(a->elements, b->elements, sizeof a->elements) == 0 &&
           memcmp(a->size, b->size, sizeof a->size) == 0;
}

static pm_status take_mesh(const pm_mesh *one, const char *name, const pm_mesh **mesh) {
    if (one == NULL) {
        return PM_OK;
    }
    if (*mesh != NULL && !are_same(*mesh, one)) {
        return pm_fail(PM_ECONFIG, "symmetry: %s has another mesh than the models before it", name);
    }
    *mesh = one;
    return PM_OK;
}

static pm_status find_mesh(const pm_system *system, const pm_mesh **mesh) {
    const pm_scene *scene = system->scene;
    *mesh = NULL;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY(take_mesh(system->part[i]->spec.mesh, scene->subsystem[i].name, mesh));
    }
    for (int i = 0; i < scene->nport; ++i) {
        PM_TRY(take_mesh(system->port[i]->spec.mesh, scene->port[i].name, mesh));
    }
    if (*mesh == NULL) {
        return pm_fail(PM_ECONFIG, "symmetry: no model has a mesh");
    }
    return (*mesh)->elements[1] == (*mesh)->elements[2] && (*mesh)->size[1] == (*mesh)->size[2]
               ? PM_OK
               : pm_fail(PM_ECONFIG, "symmetry: the mesh has no square section");
}

static pm_status make_copies(pm_symmetry *s, const pm_mesh *mesh, pm_arena *arena) {
    double *feature =
        pm_arena_array(arena, (size_t)mesh->nnode * PM_MESH_NODE_FEATURES, sizeof *feature);
    double *position = pm_arena_array(arena, (size_t)mesh->nnode * 3, sizeof *position);
    if (feature == NULL || position == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for symmetric copies");
    }
    pm_mesh_node_features(mesh, feature);
    for (int i = 0; i < mesh->nnode; ++i) {
        memcpy(position + 3 * (ptrdiff_t)i, feature + PM_MESH_NODE_FEATURES * (ptrdiff_t)i,
               3 * sizeof *position);
    }
    const pm_field nodes = {.nnode = mesh->nnode, .position = position};
    return pm_symmetry_copies_make(s->copy, &nodes, arena);
}

// --- fields ---

typedef struct listing {
    int nnode, count;
    pm_window_field *field; // NULL: only counted
} listing;

static void list_layout(listing *l, const pm_layout *layout, int first) {
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const int components = group->size / l->nnode;
        const bool known = components == 1 || components == 3 || components == 6;
        if (group->size % l->nnode == 0 && known) {
            if (l->field != NULL) {
                l->field[l->count] = (pm_window_field){first + group->first, components};
            }
            ++l->count;
        }
    }
}

// Lists the fields of the states of a window, then those of the boundary inputs over its steps, in
// the order of learn/samples.h.
static void list_fields(listing *l, const pm_scene *scene, int unroll, int input_order) {
    const int nz = scene->nz, nboundary_input = scene->nprescribed;
    l->count = 0;
    for (int state = 0; state <= unroll; ++state) {
        for (int i = 0; i < scene->nsubsystem; ++i) {
            const pm_scene_subsystem *s = &scene->subsystem[i];
            list_layout(l, &s->layout, state * nz + s->first);
        }
    }
    for (int k = 0; k < unroll * input_order; ++k) {
        for (int i = 0; i < scene->nboundary_input; ++i) {
            const pm_scene_boundary_input *boundary_input = &scene->boundary_input[i];
            for (int kind = 0; kind < (boundary_input->entropy ? 3 : 2); ++kind) {
                list_layout(l, &boundary_input->layout,
                            (1 + unroll) * nz + k * nboundary_input + boundary_input->first +
                                kind * boundary_input->layout.nz);
            }
        }
    }
}

pm_status pm_symmetry_make(pm_symmetry **symmetry, const pm_system *system, int unroll,
                           int input_order, pm_arena *arena) {
    const pm_mesh *mesh;
    PM_TRY(find_mesh(system, &mesh));
    pm_symmetry *s = pm_arena_alloc(arena, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for symmetric copies");
    }
    PM_TRY(make_copies(s, mesh, arena));
    listing l = {.nnode = mesh->nnode};
    list_fields(&l, system->scene, unroll, input_order);
    l.field = pm_arena_array(arena, (size_t)l.count, sizeof *l.field);
    if (l.field == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for symmetric copies");
    }
    list_fields(&l, system->scene, unroll, input_order);
    s->nnode = mesh->nnode;
    s->nfield = l.count;
    s->field = l.field;
    *symmetry = s;
    return PM_OK;
}

void pm_symmetry_image(const pm_symmetry *s, int copy, int width, const double *window,
                       double *image) {
    const pm_copy *c = &s->copy[copy];
    memcpy(image, window, (size_t)width * sizeof *image);
    for (int k = 0; k < s->nfield; ++k) {
        const double *from = window + s->field[k].first;
        double *to = image + s->field[k].first;
        if (s->field[k].components == 3) {
            pm_copy_vectors(c, s->nnode, from, 3, to);
        } else if (s->field[k].components == 6) {
            pm_copy_tensors(c, s->nnode, from, 6, to);
        } else {
            for (int i = 0; i < s->nnode; ++i) {
                to[i] = from[c->node[i]];
            }
        }
    }
}

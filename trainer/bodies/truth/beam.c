// Makes the mesh of beams, reads their configuration, loads them, and simulates their trajectories.
#include "bodies/truth/beam.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bodies/truth/beam_element.h"
#include "bodies/truth/beam_solve.h"
#include "store/solid_mesh.h"

enum { Q, V = 3, SIGMA = 6, MAX_BODIES = 8 };

// --- the mesh ---

// The grid offsets of a brick's corners from its first corner.
static const int corner[PM_BEAM_CORNERS][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                               {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};

static pm_status make_arrays(pm_beam_mesh *mesh, pm_arena *arena) {
    const size_t nnode = (size_t)mesh->nnode;
    mesh->placement = pm_arena_array(arena, (size_t)mesh->nbody, sizeof *mesh->placement);
    mesh->position = pm_arena_array(arena, nnode, sizeof *mesh->position);
    mesh->hexahedron = pm_arena_array(arena, (size_t)mesh->nelement, sizeof *mesh->hexahedron);
    mesh->clamped = pm_arena_array(arena, nnode, sizeof *mesh->clamped);
    return pm_arena_status(arena, "the mesh of beams");
}

pm_status pm_beam_mesh_place(pm_beam_mesh *mesh, const int count[3], const double size[3],
                             int nbody, const pm_placement *placement, pm_arena *arena) {
    const int row = count[0] + 1, column = count[1] + 1;
    int nnode = 1, nelement = 1;
    *mesh = (pm_beam_mesh){.nbody = nbody};
    for (int d = 0; d < 3; ++d) {
        mesh->count[d] = count[d];
        mesh->size[d] = size[d];
        nnode *= count[d] + 1;
        nelement *= count[d];
    }
    mesh->nnode = nbody * nnode;
    mesh->nelement = nbody * nelement;
    mesh->edge = size[0] / count[0];
    PM_TRY(make_arrays(mesh, arena));
    for (int b = 0; b < nbody; ++b) {
        mesh->placement[b] = placement[b];
        for (int n = 0; n < nnode; ++n) {
            const int index[3] = {n % row, n / row % column, n / row / column};
            double own[3], *x = mesh->position[b * nnode + n];
            for (int d = 0; d < 3; ++d) {
                own[d] = mesh->size[d] * index[d] / mesh->count[d];
            }
            pm_placement_point(&placement[b], own, x);
            mesh->clamped[b * nnode + n] = index[0] == 0;
        }
        for (int e = 0; e < nelement; ++e) {
            const int i = e % count[0], j = e / count[0] % count[1], l = e / count[0] / count[1];
            for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
                mesh->hexahedron[b * nelement + e][c] =
                    b * nnode +
                    pm_beam_mesh_node(mesh, i + corner[c][0], j + corner[c][1], l + corner[c][2]);
            }
        }
    }
    return PM_OK;
}

pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena) {
    return pm_beam_mesh_place(mesh, count, size, 1, &PM_PLACEMENT_IDENTITY, arena);
}

pm_status pm_beam_mesh_load(pm_beam_mesh *mesh, const char *path, pm_arena *arena) {
    pm_solid_mesh file;
    int nclamped = 0;
    PM_TRY(pm_solid_mesh_load(&file, path, arena));
    *mesh = (pm_beam_mesh){.nbody = 1, .nnode = file.nnode, .nelement = file.nelement};
    PM_TRY(make_arrays(mesh, arena));
    mesh->placement[0] = PM_PLACEMENT_IDENTITY;
    memcpy(mesh->position, file.position, (size_t)file.nnode * sizeof *mesh->position);
    memcpy(mesh->hexahedron, file.brick, (size_t)file.nelement * sizeof *mesh->hexahedron);
    for (int i = 0; i < file.nnode; ++i) {
        mesh->clamped[i] = file.clamped[i];
        nclamped += file.clamped[i];
    }
    // The size is that of the box around all nodes.
    const double *a = mesh->position[mesh->hexahedron[0][0]];
    const double *b = mesh->position[mesh->hexahedron[0][1]];
    double square = 0;
    for (int d = 0; d < 3; ++d) {
        double low = a[d], high = a[d];
        for (int i = 0; i < mesh->nnode; ++i) {
            low = fmin(low, mesh->position[i][d]);
            high = fmax(high, mesh->position[i][d]);
        }
        mesh->size[d] = high - low;
        square += (a[d] - b[d]) * (a[d] - b[d]);
    }
    mesh->edge = sqrt(square);
    return nclamped > 0 && nclamped < file.nnode
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: %d of %d nodes are clamped, expected some, but not all",
                         path, nclamped, file.nnode);
}

// --- the surface ---

// The corners of each side of an element, such that they turn to the left seen from outside.
static const int side[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                               {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

// A side of an element, and its nodes in ascending order.
typedef struct sorted_side {
    int node[4], ascending[4];
} sorted_side;

static int compare_numbers(const void *a, const void *b) {
    const int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

static int compare_sides(const void *a, const void *b) {
    const sorted_side *x = a, *y = b;
    for (int i = 0; i < 4; ++i) {
        if (x->ascending[i] != y->ascending[i]) {
            return x->ascending[i] < y->ascending[i] ? -1 : 1;
        }
    }
    return 0;
}

pm_status pm_beam_skin_make(pm_beam_skin *skin, const pm_beam_mesh *mesh, pm_arena *arena) {
    const size_t nside = 6 * (size_t)mesh->nelement, nnode = (size_t)mesh->nnode;
    *skin = (pm_beam_skin){0};
    sorted_side *all = pm_arena_array(arena, nside, sizeof *all);
    int *number = pm_arena_array(arena, nnode, sizeof *number);
    skin->face = pm_arena_array(arena, nside, sizeof *skin->face);
    skin->node = pm_arena_array(arena, nnode, sizeof *skin->node);
    skin->first = pm_arena_array(arena, nnode + 2, sizeof *skin->first);
    skin->face_at = pm_arena_array(arena, 4 * nside, sizeof *skin->face_at);
    PM_TRY(pm_arena_status(arena, "the surface of a body"));
    // Equal sides become neighbours.
    for (size_t i = 0; i < nside; ++i) {
        for (int k = 0; k < 4; ++k) {
            all[i].node[k] = mesh->hexahedron[i / 6][side[i % 6][k]];
        }
        memcpy(all[i].ascending, all[i].node, sizeof all[i].node);
        qsort(all[i].ascending, 4, sizeof *all[i].ascending, compare_numbers);
    }
    qsort(all, nside, sizeof *all, compare_sides);
    for (size_t i = 0; i < nside; ++i) {
        const bool twin = (i > 0 && compare_sides(&all[i], &all[i - 1]) == 0) ||
                          (i + 1 < nside && compare_sides(&all[i], &all[i + 1]) == 0);
        if (!twin) { // a face, with its normal, area, and distance from the clamp
            pm_beam_face *face = &skin->face[skin->nface++];
            memcpy(face->node, all[i].node, sizeof face->node);
            const double *a = mesh->position[face->node[0]], *b = mesh->position[face->node[1]];
            const double *c = mesh->position[face->node[2]], *d = mesh->position[face->node[3]];
            double cross[3], square = 0;
            for (int l = 0; l < 3; ++l) {
                const int j = (l + 1) % 3, k = (l + 2) % 3;
                cross[l] = ((c[j] - a[j]) * (d[k] - b[k]) - (c[k] - a[k]) * (d[j] - b[j])) / 2;
                square += cross[l] * cross[l];
                face->centre[l] = (a[l] + b[l] + c[l] + d[l]) / 4;
            }
            face->area = sqrt(square);
            for (int l = 0; l < 3; ++l) {
                face->outward[l] = cross[l] / face->area;
            }
            face->distance = INFINITY;
            for (int n = 0; n < mesh->nnode; ++n) {
                double away = 0;
                for (int l = 0; l < 3; ++l) {
                    const double off = mesh->position[n][l] - face->centre[l];
                    away += off * off;
                }
                face->distance =
                    mesh->clamped[n] ? fmin(face->distance, sqrt(away)) : face->distance;
            }
            skin->farthest = fmax(skin->farthest, face->distance);
        }
    }
    memset(number, -1, nnode * sizeof *number);
    for (int i = 0; i < 4 * skin->nface; ++i) {
        const int node = skin->face[i / 4].node[i % 4];
        if (number[node] < 0) {
            number[node] = skin->nnode;
            skin->node[skin->nnode++] = node;
        }
        ++skin->first[number[node] + 1];
    }
    for (int i = 0; i < skin->nnode; ++i) {
        skin->first[i + 1] += skin->first[i];
    }
    for (int i = 4 * skin->nface - 1; i >= 0; --i) {
        // first[n + 1] moves down to the start of node n.
        skin->face_at[--skin->first[number[skin->face[i / 4].node[i % 4]] + 1]] = i / 4;
    }
    memmove(skin->first, skin->first + 1, (size_t)skin->nnode * sizeof *skin->first);
    skin->first[skin->nnode] = 4 * skin->nface;
    return PM_OK;
}

const pm_beam_face *pm_beam_skin_draw(const pm_beam_skin *skin, double nearest, pm_rng *rng) {
    const double least = nearest * skin->farthest;
    const pm_beam_face *last = NULL;
    double total = 0;
    for (int i = 0; i < skin->nface; ++i) {
        total += skin->face[i].distance >= least ? skin->face[i].area : 0;
    }
    double left = total * pm_rng_uniform(rng);
    for (int i = 0; i < skin->nface; ++i) {
        if (skin->face[i].distance >= least) {
            last = &skin->face[i];
            left -= last->area;
            if (left < 0) {
                break;
            }
        }
    }
    return last; // the farthest face is always among them
}

bool pm_beam_skin_faces(const pm_beam_skin *skin, int i, const double *outward) {
    for (int k = skin->first[i]; k < skin->first[i + 1]; ++k) {
        const double *own = skin->face[skin->face_at[k]].outward;
        if (own[0] * outward[0] + own[1] * outward[1] + own[2] * outward[2] > sqrt(0.5)) {
            return true;
        }
    }
    return false;
}

// --- the configuration ---

// The largest element counts, with which a face has at most PM_BEAM_MAX_LOADED nodes.
static const int most[3] = {100, 19, 19};

// Reads several beams, and which of them carries the load.
static pm_status read_beams(pm_yaml block, pm_arena *arena, const int count[3],
                            const double size[3], pm_beam_system *system) {
    pm_yaml beams = pm_yaml_get(block, "beams"), loaded, contact;
    const int nbody = pm_yaml_count(beams);
    PM_TRY(pm_yaml_require_entries(beams));
    if (nbody > MAX_BODIES) {
        return pm_yaml_fail(beams, "expected at most %d", MAX_BODIES);
    }
    pm_placement placement[MAX_BODIES];
    const char **name = pm_arena_array(arena, (size_t)nbody + 1, sizeof *name);
    const char **text = pm_arena_array(arena, (size_t)nbody, sizeof *text);
    PM_TRY(pm_arena_status(arena, "the names of beams"));
    for (int b = 0; b < nbody; ++b) {
        pm_yaml key, map;
        pm_yaml_entry(beams, b, &key, &map);
        PM_TRY(pm_yaml_text(key, arena, &name[b]));
        PM_TRY(pm_placement_read(map, arena, &placement[b]));
        const double *o = placement[b].origin, *sign = placement[b].sign;
        const int *axis = placement[b].axis;
        text[b] =
            pm_arena_printf(arena, "origin: [%g, %g, %g], axes: [%c%c, %c%c, %c%c]", o[0], o[1],
                            o[2], sign[0] > 0 ? '+' : '-', "xyz"[axis[0]], sign[1] > 0 ? '+' : '-',
                            "xyz"[axis[1]], sign[2] > 0 ? '+' : '-', "xyz"[axis[2]]);
    }
    PM_TRY(pm_arena_status(arena, "the placements of beams"));
    system->name = name;
    system->placement = text;
    PM_TRY(pm_beam_mesh_place(&system->mesh, count, size, nbody, placement, arena));
    for (int a = 0; a < nbody; ++a) {
        for (int b = 0; b < a; ++b) {
            double low[2][3], high[2][3];
            int overlaps = 0;
            pm_beam_mesh_bounds(&system->mesh, a, low[0], high[0]);
            pm_beam_mesh_bounds(&system->mesh, b, low[1], high[1]);
            for (int d = 0; d < 3; ++d) {
                overlaps += low[0][d] < high[1][d] && low[1][d] < high[0][d];
            }
            if (overlaps == 3) {
                return pm_yaml_fail(beams, "%s and %s overlap", name[b], name[a]);
            }
        }
    }
    PM_TRY(pm_yaml_require(block, "contact", &contact));
    PM_TRY(pm_yaml_double(contact, DBL_MIN, 1e15, &system->contact));
    PM_TRY(pm_yaml_require(block, "loaded", &loaded));
    return pm_yaml_choice(loaded, name, &system->loaded);
}

// Reads a body of any shape. Its file is named relative to the folder of the truth file `path`.
static pm_status read_file(pm_yaml block, const char *path, pm_arena *arena,
                           pm_beam_system *system) {
    static const char *const of_boxes[] = {"size",   "elements", "beams", "contact",
                                           "loaded", "rows",     NULL};
    const pm_yaml file = pm_yaml_get(block, "mesh");
    const char *slash = strrchr(path, '/'), *name, *full;
    for (const char *const *key = of_boxes; *key != NULL; ++key) {
        if (pm_yaml_exists(pm_yaml_get(block, *key))) {
            return pm_yaml_fail(pm_yaml_get(block, *key), "only a box has `%s`, not a `mesh`",
                                *key);
        }
    }
    PM_TRY(pm_yaml_text(file, arena, &name));
    full = name[0] == '/' || slash == NULL
               ? name
               : pm_arena_printf(arena, "%.*s%s", (int)(slash + 1 - path), path, name);
    PM_TRY(pm_arena_status(arena, "the path of a mesh"));
    PM_TRY(pm_beam_mesh_load(&system->mesh, full, arena));
    system->file = name;
    for (int e = 0; e < system->mesh.nelement; ++e) {
        pm_beam_element brick;
        double x[PM_BEAM_FREEDOMS];
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            memcpy(x + 3 * c, system->mesh.position[system->mesh.hexahedron[e][c]], 3 * sizeof *x);
        }
        pm_beam_element_init(&brick, x);
        for (int p = 0; p < PM_BEAM_POINTS; ++p) {
            if (!(brick.weight[p] > 0)) {
                return pm_yaml_fail(file, "element %d of %s is turned inside out", e, full);
            }
        }
    }
    PM_TRY(pm_beam_skin_make(&system->skin, &system->mesh, arena));
    return system->skin.nnode <= PM_BEAM_MAX_LOADED
               ? PM_OK
               : pm_yaml_fail(file, "%s has %d nodes on its surface, expected at most %d", full,
                              system->skin.nnode, PM_BEAM_MAX_LOADED);
}

static pm_status read_mesh(pm_yaml block, const char *path, pm_arena *arena,
                           pm_beam_system *system) {
    static const char *const several[] = {"contact", "loaded", NULL};
    double size[3], number[3];
    int count[3];
    pm_yaml lengths, bricks;
    if (pm_yaml_exists(pm_yaml_get(block, "mesh"))) {
        return read_file(block, path, arena, system);
    }
    PM_TRY(pm_yaml_require(block, "size", &lengths));
    PM_TRY(pm_yaml_vector(lengths, 3, arena, size));
    PM_TRY(pm_yaml_require(block, "elements", &bricks));
    PM_TRY(pm_yaml_vector(bricks, 3, arena, number));
    for (int d = 0; d < 3; ++d) {
        if (!(number[d] >= 1 && number[d] <= most[d]) || number[d] != floor(number[d])) {
            return pm_yaml_fail(bricks, "expected 1 to %d, %d, %d elements along x, y, z", most[0],
                                most[1], most[2]);
        }
        if (!(size[d] > 0)) {
            return pm_yaml_fail(lengths, "expected lengths > 0");
        }
        count[d] = (int)number[d];
    }
    if (pm_yaml_exists(pm_yaml_get(block, "beams"))) {
        return read_beams(block, arena, count, size, system);
    }
    for (const char *const *key = several; *key != NULL; ++key) {
        if (pm_yaml_exists(pm_yaml_get(block, *key))) {
            return pm_yaml_fail(pm_yaml_get(block, *key), "expected `beams` beside it");
        }
    }
    return pm_beam_mesh_make(&system->mesh, count, size, arena);
}

static pm_status read_material(pm_yaml block, pm_arena *arena, pm_beam_material *material) {
    double *g = NULL, sum = 0;
    pm_yaml map, shares, times;
    const pm_yaml_key keys[] = {
        {PM_YAML_DOUBLE("C10", &material->C10, 1e-9, 1e15), .required = true},
        {PM_YAML_DOUBLE("C01", &material->C01, 0, 1e15), .required = true},
        {PM_YAML_DOUBLE("D1", &material->D1, 1e-15, 1e9), .required = true},
        {PM_YAML_VALUE("g", &shares)},
        {PM_YAML_VALUE("tau", &times)},
        {0}};
    PM_TRY(pm_yaml_require(block, "material", &map));
    PM_TRY(pm_yaml_read(map, arena, keys));
    // The Maxwell branches have as many shares g as relaxation times tau.
    if (!pm_yaml_exists(shares)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_doubles(shares, arena, &material->nbranch, &g));
    if (material->nbranch > PM_BEAM_MAX_BRANCHES) {
        return pm_yaml_fail(shares, "expected at most %d", PM_BEAM_MAX_BRANCHES);
    }
    PM_TRY(pm_yaml_require(map, "tau", &times));
    PM_TRY(pm_yaml_vector(times, material->nbranch, arena, material->tau));
    for (int i = 0; i < material->nbranch; ++i) {
        material->g[i] = g[i];
        sum += g[i];
        if (!(g[i] >= 0 && sum < 1 && material->tau[i] > 0)) {
            return pm_yaml_fail(shares, "expected shares >= 0 with a sum below 1, and tau > 0");
        }
    }
    return PM_OK;
}

static pm_status read_range(pm_yaml list, pm_arena *arena, double range[2]) {
    PM_TRY(pm_yaml_vector(list, 2, arena, range));
    return range[0] > 0 && range[0] <= range[1]
               ? PM_OK
               : pm_yaml_fail(list, "expected [lowest, highest], both > 0");
}

static pm_status read_patches(pm_yaml map, bool box, pm_arena *arena, pm_beam_patches *patches) {
    static const char *const faces[] = {"+y", "+z", "-y", "-z", NULL}; // as in beam.h
    pm_yaml force, length, width, ramp, hold, unload;
    patches->face = -1;
    const pm_yaml_key keys[] = {{PM_YAML_CHOICE("face", &patches->face, faces)},
                                {PM_YAML_VALUE("force", &force), .required = true},
                                {PM_YAML_VALUE("length", &length), .required = true},
                                {PM_YAML_VALUE("width", &width), .required = true},
                                {PM_YAML_DOUBLE("tilt", &patches->tilt, 0, 10), .required = true},
                                {PM_YAML_VALUE("ramp", &ramp), .required = true},
                                {PM_YAML_VALUE("hold", &hold), .required = true},
                                {PM_YAML_VALUE("unload", &unload), .required = true},
                                {0}};
    PM_TRY(pm_yaml_read(map, arena, keys));
    if (patches->face >= 0 && !box) {
        return pm_yaml_fail(pm_yaml_get(map, "face"), "only a box has a `face`, not a `mesh`");
    }
    PM_TRY(read_range(force, arena, patches->force));
    PM_TRY(read_range(length, arena, patches->length));
    PM_TRY(read_range(width, arena, patches->width));
    PM_TRY(read_range(ramp, arena, patches->ramp));
    PM_TRY(read_range(hold, arena, patches->hold));
    return read_range(unload, arena, patches->unload);
}

pm_status pm_beam_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    static const char *const keys[] = {"size",     "elements", "mesh",    "material",
                                       "substeps", "beams",    "contact", "loaded",
                                       "rows",     "patches",  NULL};
    pm_yaml substeps, rows = pm_yaml_get(block, "rows"), patches;
    pm_beam_system *system = pm_arena_alloc(arena, sizeof *system);
    PM_TRY(pm_arena_status(arena, "beams"));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_mesh(block, model->path, arena, system));
    PM_TRY(read_material(block, arena, &system->material));
    PM_TRY(pm_yaml_require(block, "substeps", &substeps));
    PM_TRY(pm_yaml_int(substeps, 1, 1000, &system->substeps));
    if (pm_yaml_exists(rows) && pm_yaml_exists(pm_yaml_get(block, "patches"))) {
        return pm_yaml_fail(rows, "expected either `rows` or `patches`, found both");
    }
    if (pm_yaml_exists(rows)) {
        const pm_yaml_key rows_keys[] = {
            {PM_YAML_DOUBLE("force", &system->force, 0, 1e15), .required = true},
            {PM_YAML_DOUBLE("ramp", &system->ramp, 1e-9, 1e9), .required = true},
            {PM_YAML_INT("positions", &system->positions, 1, system->mesh.count[0]),
             .required = true},
            {0}};
        PM_TRY(pm_yaml_read(rows, arena, rows_keys));
    } else {
        PM_TRY(pm_yaml_require(block, "patches", &patches));
        PM_TRY(read_patches(patches, system->file == NULL, arena, &system->patches));
    }
    const pm_beam_mesh *mesh = &system->mesh;
    const pm_beam_material *m = &system->material;
    const char *text = system->file != NULL
                           ? pm_arena_printf(arena, "%s, %d bricks", system->file, mesh->nelement)
                           : pm_arena_printf(arena, "%g x %g x %g m in %d x %d x %d bricks",
                                             mesh->size[0], mesh->size[1], mesh->size[2],
                                             mesh->count[0], mesh->count[1], mesh->count[2]);
    text =
        pm_arena_printf(arena, "%s; C10 %g Pa, C01 %g Pa, D1 %g 1/Pa", text, m->C10, m->C01, m->D1);
    for (int i = 0; i < m->nbranch; ++i) {
        text = pm_arena_printf(arena, "%s; g %g, tau %g s", text, m->g[i], m->tau[i]);
    }
    for (int i = 0; i < mesh->nbody && system->name != NULL; ++i) {
        text = pm_arena_printf(arena, "%s; %s: %s", text, system->name[i], system->placement[i]);
    }
    if (system->name != NULL) {
        text = pm_arena_printf(arena, "%s; contact %g Pa/m; %s is loaded", text, system->contact,
                               system->name[system->loaded]);
    }
    model->parameters = pm_arena_printf(arena, "%s; %d steps per state", text, system->substeps);
    PM_TRY(pm_arena_status(arena, "the parameters of beams"));
    model->title = system->file != NULL ? "A clamped body of viscoelastic rubber under loads"
                   : system->mesh.nbody > 1
                       ? "Clamped beams of viscoelastic rubber under loads, in contact"
                       : "A clamped beam of viscoelastic rubber under loads";
    model->units = "m;m;m;m/s;m/s;m/s;Pa;Pa;Pa;Pa;Pa;Pa";
    model->ode.data = system;
    return PM_OK;
}

// --- loads ---

// The smallest distance from the clamp to the centre of a patch, relative to the largest one.
#define NEAREST 0.4

// Returns the node of a face at indices i along the beam and j across.
static int face_node(const pm_beam_mesh *mesh, int face, int i, int j) {
    const int top = face < 2;
    return face % 2 == 0 ? pm_beam_mesh_node(mesh, i, top ? mesh->count[1] : 0, j)
                         : pm_beam_mesh_node(mesh, i, j, top ? mesh->count[2] : 0);
}

// Return the axis normal to a face, the axis across the beam within the face, and the sign with
// which the normal axis points into the beam.
static int axis_in(int face) {
    return 1 + face % 2;
}
static int axis_across(int face) {
    return 2 - face % 2;
}
static double sign_in(int face) {
    return face < 2 ? -1 : 1;
}

static void add_node(pm_beam_load *load, int node) {
    assert(load->nnode < PM_BEAM_MAX_LOADED);
    load->node[load->nnode++] = node;
}

void pm_beam_load_row(pm_beam_load *load, const pm_beam_mesh *mesh, int face, int position,
                      double force, double ramp) {
    *load = (pm_beam_load){.time = {0, ramp, ramp, ramp}, .fraction = {0, 1, 1, 1}};
    for (int j = 0; j <= mesh->count[axis_across(face)]; ++j) {
        add_node(load, face_node(mesh, face, mesh->count[0] - position, j));
    }
    load->force[axis_in(face)] = sign_in(face) * force;
}

// Draws a number from a range uniformly.
static double draw_between(pm_rng *rng, const double range[2]) {
    return range[0] + (range[1] - range[0]) * pm_rng_uniform(rng);
}

// Draws size and direction of the force. The axes `axis` [3] are perpendicular, and number `in` of
// them points into the body.
static void draw_force(pm_beam_load *load, const pm_beam_patches *patches, int in,
                       double (*axis)[3], pm_rng *rng) {
    double direction[3] = {0}, square = 0;
    for (int k = 0; k < 3; ++k) {
        const double part = k == in ? 1 : patches->tilt * pm_rng_normal(rng);
        for (int d = 0; d < 3; ++d) {
            direction[d] += part * axis[k][d];
        }
        square += part * part;
    }
    const double size = draw_between(rng, patches->force) / (load->nnode * sqrt(square));
    for (int d = 0; d < 3; ++d) {
        load->force[d] = size * direction[d];
    }
}

// Draws the times at which the force has risen, begins to fall and has fallen.
static void draw_times(pm_beam_load *load, const pm_beam_patches *patches, pm_rng *rng) {
    load->time[1] = draw_between(rng, patches->ramp);
    load->time[2] = load->time[1] + draw_between(rng, patches->hold);
    load->time[3] = load->time[2] + draw_between(rng, patches->unload);
}

void pm_beam_load_patch(pm_beam_load *load, const pm_beam_mesh *mesh,
                        const pm_beam_patches *patches, pm_rng *rng) {
    *load = (pm_beam_load){.fraction = {0, 1, 1, 0}};
    const int face = patches->face < 0 ? (int)pm_rng_below(rng, PM_BEAM_FACES) : patches->face;
    const double along[2] = {NEAREST * mesh->size[0], mesh->size[0]};
    const int wide = axis_across(face);
    const double across[2] = {0, mesh->size[wide]};
    const double spacing[2] = {mesh->size[0] / mesh->count[0],
                               mesh->size[wide] / mesh->count[wide]};
    // Separate statements, because C does not define in which order the members of a list are
    // evaluated.
    double centre[2], half[2];
    centre[0] = draw_between(rng, along);
    centre[1] = draw_between(rng, across);
    half[0] = draw_between(rng, patches->length) / 2;
    half[1] = draw_between(rng, patches->width) / 2;
    for (int i = 1; i <= mesh->count[0]; ++i) {
        for (int j = 0; j <= mesh->count[wide]; ++j) {
            if (fabs(i * spacing[0] - centre[0]) <= half[0] &&
                fabs(j * spacing[1] - centre[1]) <= half[1]) {
                add_node(load, face_node(mesh, face, i, j));
            }
        }
    }
    if (load->nnode == 0) { // a small patch between nodes
        add_node(load, face_node(mesh, face, (int)lround(centre[0] / spacing[0]),
                                 (int)lround(centre[1] / spacing[1])));
    }
    double axis[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    axis[axis_in(face)][axis_in(face)] = sign_in(face);
    draw_force(load, patches, axis_in(face), axis, rng);
    draw_times(load, patches, rng);
}

void pm_beam_load_skin(pm_beam_load *load, const pm_beam_mesh *mesh, const pm_beam_skin *skin,
                       const pm_beam_patches *patches, pm_rng *rng) {
    *load = (pm_beam_load){.fraction = {0, 1, 1, 0}};
    const pm_beam_face *face = pm_beam_skin_draw(skin, NEAREST, rng);
    // Two axes of the tangential plane and, third, the one into the body. The first one is that
    // closest to x, or to y where the plane is perpendicular to x.
    const double *outward = face->outward;
    const int along = fabs(outward[0]) < 0.9 ? 0 : 1;
    double axis[3][3], half[2], square = 0;
    for (int d = 0; d < 3; ++d) {
        axis[2][d] = -outward[d];
        axis[0][d] = (d == along) - outward[along] * outward[d];
        square += axis[0][d] * axis[0][d];
    }
    for (int d = 0; d < 3; ++d) {
        axis[0][d] /= sqrt(square);
    }
    for (int d = 0; d < 3; ++d) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        axis[1][d] = axis[2][e] * axis[0][f] - axis[2][f] * axis[0][e];
    }
    half[0] = draw_between(rng, patches->length) / 2;
    half[1] = draw_between(rng, patches->width) / 2;
    // Nodes in the rectangle around the centre of the face, but not on another side of the body.
    const double reach[3] = {half[0], half[1], fmax(half[0], half[1]) / 2};
    for (int i = 0; i < skin->nnode; ++i) {
        const int node = skin->node[i];
        bool inside = !mesh->clamped[node] && pm_beam_skin_faces(skin, i, outward);
        for (int k = 0; k < 3 && inside; ++k) {
            double off = 0;
            for (int d = 0; d < 3; ++d) {
                off += axis[k][d] * (mesh->position[node][d] - face->centre[d]);
            }
            inside = fabs(off) <= reach[k];
        }
        if (inside) {
            add_node(load, node);
        }
    }
    for (int i = 0; i < 4 && load->nnode == 0; ++i) { // a small patch between nodes
        add_node(load, face->node[i]);
    }
    draw_force(load, patches, 2, axis, rng);
    draw_times(load, patches, rng);
}

void pm_beam_load_at(const pm_beam_load *load, const pm_beam_mesh *mesh, double t, double *f) {
    double fraction = load->fraction[PM_BEAM_KNOTS - 1]; // of the full load
    for (int i = 1; i < PM_BEAM_KNOTS; ++i) {
        if (t < load->time[i]) {
            const double part = (t - load->time[i - 1]) / (load->time[i] - load->time[i - 1]);
            fraction = load->fraction[i - 1] + part * (load->fraction[i] - load->fraction[i - 1]);
            break;
        }
    }
    const int first = load->body * (mesh->nnode / mesh->nbody);
    double force[3];
    pm_placement_rotate(&mesh->placement[load->body], load->force, force);
    memset(f, 0, 3 * (size_t)mesh->nnode * sizeof *f);
    for (int i = 0; i < load->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            f[3 * (first + load->node[i]) + d] = fraction * force[d];
        }
    }
}

// --- trajectories ---

// Turns vectors [nnode][3] from the global frame into the frame of a body.
static void turn_back(const pm_placement *placement, int nnode, const double *global, double *own) {
    for (int i = 0; i < nnode; ++i) {
        pm_placement_rotate_back(placement, global + 3 * i, own + 3 * i);
    }
}

// Writes the state under the forces f into the fields, at time j of row `row`. `past` [2][nnode][3]
// are the positions of all nodes one and two steps before.
static void keep_state(const pm_beam_system *system, const pm_beam_state *now, const double *past,
                       double h, const double *f, pm_field *const *field, int row, int j) {
    const pm_beam_mesh *mesh = &system->mesh;
    for (int b = 0; b < mesh->nbody; ++b) {
        const pm_placement *placement = &mesh->placement[b];
        const pm_beam_energy *energy = &now->energy[b];
        const int nnode = mesh->nnode / mesh->nbody, first = b * nnode;
        const size_t at = (size_t)row * (size_t)field[b]->ntime + (size_t)j;
        double *z = pm_field_state(field[b], row, j);
        for (int i = first; i < first + nnode; ++i, z += PM_BODY_NVARIABLE) {
            const double *sigma = now->sigma + PM_SYMMETRIC * i;
            double relative[3], v[3];
            for (int d = 0; d < 3; ++d) {
                const double q = now->q[3 * i + d];
                relative[d] = q - placement->origin[d];
                v[d] = (3 * q - 4 * past[3 * i + d] + past[3 * (mesh->nnode + i) + d]) / (2 * h);
            }
            pm_placement_rotate_back(placement, relative, z + Q);
            pm_placement_rotate_back(placement, v, z + V);
            for (int m = 0; m < PM_SYMMETRIC; ++m) {
                const int r = pm_tensor_row[m], c = pm_tensor_column[m];
                z[SIGMA + m] = placement->sign[r] * placement->sign[c] *
                               sigma[pm_tensor_at[placement->axis[r]][placement->axis[c]]];
            }
        }
        turn_back(placement, nnode, f + 3 * first, pm_field_force(field[b], row, j));
        field[b]->energy[PM_FIELD_ENERGIES * at] = energy->stored;
        field[b]->energy[PM_FIELD_ENERGIES * at + 1] = energy->dissipated;
        field[b]->energy[PM_FIELD_ENERGIES * at + 2] = energy->work;
        if (field[b]->contact != NULL) {
            turn_back(placement, nnode, now->contact + 3 * first,
                      pm_field_contact(field[b], row, j));
            field[b]->contact_work[at] = energy->contact_work;
        }
    }
}

pm_status pm_beam_run(const pm_beam_system *system, uint64_t seed, int trajectory,
                      pm_field *const *field, int row) {
    const pm_beam_mesh *mesh = &system->mesh;
    const size_t count = 3 * (size_t)mesh->nnode;
    const double h = field[0]->dt / system->substeps;
    pm_beam *beam = NULL;
    pm_beam_load load;
    pm_status status = PM_OK;
    // The positions of all nodes one and two steps before [2][nnode][3], and forces [nnode][3].
    double *past = calloc(3 * count, sizeof *past), *f = past + 2 * count;
    PM_TRY(pm_allocated(past, "a beam"));
    if (system->positions == 0) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)trajectory);
        if (system->file != NULL) {
            pm_beam_load_skin(&load, mesh, &system->skin, &system->patches, &rng);
        } else {
            pm_beam_load_patch(&load, mesh, &system->patches, &rng);
        }
    } else if (trajectory < PM_BEAM_FACES * system->positions) {
        pm_beam_load_row(&load, mesh, trajectory / system->positions,
                         trajectory % system->positions, system->force, system->ramp);
    } else {
        PM_TRY_DONE(pm_fail(PM_ECONFIG, "beam: trajectory %d of %d: %d rows on each of %d faces",
                            trajectory, PM_BEAM_FACES * system->positions, system->positions,
                            PM_BEAM_FACES));
    }
    load.body = system->loaded;
    PM_TRY_DONE(pm_beam_new(&beam, mesh, &system->material, system->contact));
    // The bodies are at rest before the start.
    const pm_beam_state *now = pm_beam_now(beam);
    memcpy(past, now->q, count * sizeof *past);
    memcpy(past + count, now->q, count * sizeof *past);
    for (int j = 0; j < field[0]->ntime; ++j) {
        for (int k = 1; k <= system->substeps && j > 0; ++k) {
            memcpy(past + count, past, count * sizeof *past);
            memcpy(past, now->q, count * sizeof *past);
            pm_beam_load_at(&load, mesh, ((j - 1) * system->substeps + k) * h, f);
            PM_TRY_DONE(pm_beam_step(beam, h, f, NULL));
        }
        keep_state(system, now, past, h, f, field, row, j);
    }
done:
    pm_beam_free(beam);
    free(past);
    return status;
}

void pm_beam_describe(const pm_beam_system *system, int body, pm_field *field) {
    const pm_beam_mesh *mesh = &system->mesh;
    const pm_placement *placement = &mesh->placement[body];
    for (int i = 0; i < field->nnode; ++i) {
        const double *x = mesh->position[body * field->nnode + i];
        double relative[3];
        for (int d = 0; d < 3; ++d) {
            relative[d] = x[d] - placement->origin[d];
        }
        pm_placement_rotate_back(placement, relative, field->position + 3 * i);
        field->clamped[i] = mesh->clamped[i];
    }
    for (int i = 0; i < field->nelement * PM_BEAM_CORNERS; ++i) {
        field->hexahedron[i] = mesh->hexahedron[i / PM_BEAM_CORNERS][i % PM_BEAM_CORNERS];
    }
}

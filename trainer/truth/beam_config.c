// Reads and checks the `system:` block of beams.
#include "truth/beam_config.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "truth/beam_element.h"
#include "truth/numbers.h"

// The largest element counts, with which a face has at most PM_BEAM_MAX_LOADED nodes.
static const int most[3] = {100, 19, 19};

static pm_status read_box(pm_yaml block, pm_arena *arena, int count[3], double size[3]) {
    double number[3];
    PM_TRY(pm_truth_numbers(block, "size", 3, arena, size));
    PM_TRY(pm_truth_numbers(block, "elements", 3, arena, number));
    for (int d = 0; d < 3; ++d) {
        if (!(number[d] >= 1 && number[d] <= most[d]) || number[d] != floor(number[d])) {
            return pm_yaml_fail(pm_yaml_get(block, "elements"),
                                "expected 1 to %d, %d, %d elements along x, y, z", most[0], most[1],
                                most[2]);
        }
        if (!(size[d] > 0)) {
            return pm_yaml_fail(pm_yaml_get(block, "size"), "expected lengths > 0");
        }
        count[d] = (int)number[d];
    }
    return PM_OK;
}

// Reads the global axes along which the axes of a beam point, which form a rotation.
static pm_status read_axes(pm_yaml axes, pm_beam_placement *placement) {
    static const char *const names[] = {"+x", "-x", "+y", "-y", "+z", "-z", NULL};
    const int *axis = placement->axis;
    if (pm_yaml_count(axes) != 3) {
        return pm_yaml_fail(axes, "expected [+x, +y, +z] or a rotation of it");
    }
    for (int d = 0; d < 3; ++d) {
        int id = 0;
        PM_TRY(pm_yaml_choice(pm_yaml_item(axes, d), names, &id));
        placement->axis[d] = id / 2;
        placement->sign[d] = id % 2 == 0 ? 1 : -1;
    }
    const int turn = (axis[1] - axis[0] + 3) % 3; // 1: cyclic order, 2: the reverse
    const double hand = placement->sign[0] * placement->sign[1] * placement->sign[2];
    return turn != 0 && axis[0] + axis[1] + axis[2] == 3 && axis[2] != axis[0] &&
                   hand * (turn == 1 ? 1 : -1) > 0
               ? PM_OK
               : pm_yaml_fail(axes, "expected three different axes, right-handed");
}

static pm_status read_placement(pm_yaml map, pm_arena *arena, pm_beam_placement *placement,
                                const char **text) {
    static const char *const keys[] = {"origin", "axes", NULL};
    pm_yaml axes;
    double *o = placement->origin;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_truth_numbers(map, "origin", 3, arena, o));
    PM_TRY(pm_yaml_require(map, "axes", &axes));
    PM_TRY(read_axes(axes, placement));
    const int *axis = placement->axis;
    const double *sign = placement->sign;
    *text = pm_arena_printf(arena, "origin: [%g, %g, %g], axes: [%c%c, %c%c, %c%c]", o[0], o[1],
                            o[2], sign[0] > 0 ? '+' : '-', "xyz"[axis[0]], sign[1] > 0 ? '+' : '-',
                            "xyz"[axis[1]], sign[2] > 0 ? '+' : '-', "xyz"[axis[2]]);
    return *text == NULL ? pm_fail(PM_ENOMEM, "truth: out of memory") : PM_OK;
}

// Returns true if the boxes of two undeformed bodies overlap.
static bool overlap(const pm_beam_mesh *mesh, int a, int b) {
    double low[2][3], high[2][3];
    bool inside = true;
    pm_beam_mesh_bounds(mesh, a, low[0], high[0]);
    pm_beam_mesh_bounds(mesh, b, low[1], high[1]);
    for (int d = 0; d < 3; ++d) {
        inside = inside && low[0][d] < high[1][d] && low[1][d] < high[0][d];
    }
    return inside;
}

static pm_status check_apart(pm_yaml beams, const pm_beam_system *system) {
    for (int a = 0; a < system->mesh.nbody; ++a) {
        for (int b = 0; b < a; ++b) {
            if (overlap(&system->mesh, a, b)) {
                return pm_yaml_fail(beams, "%s and %s overlap", system->name[b], system->name[a]);
            }
        }
    }
    return PM_OK;
}

// Reads several beams, and which of them carries the load.
static pm_status read_beams(pm_yaml block, pm_arena *arena, const int count[3],
                            const double size[3], pm_beam_system *system) {
    pm_yaml beams = pm_yaml_get(block, "beams"), loaded;
    const int nbody = pm_yaml_count(beams);
    PM_TRY(pm_yaml_require_entries(beams));
    if (nbody > PM_BEAM_MAX_BODIES) {
        return pm_yaml_fail(beams, "expected at most %d", PM_BEAM_MAX_BODIES);
    }
    pm_beam_placement placement[PM_BEAM_MAX_BODIES];
    const char **name = pm_arena_array(arena, (size_t)nbody + 1, sizeof *name);
    const char **text = pm_arena_array(arena, (size_t)nbody, sizeof *text);
    if (name == NULL || text == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    for (int b = 0; b < nbody; ++b) {
        pm_yaml key, map;
        pm_yaml_entry(beams, b, &key, &map);
        PM_TRY(pm_yaml_text(key, arena, &name[b]));
        PM_TRY(read_placement(map, arena, &placement[b], &text[b]));
    }
    system->name = name;
    system->placement = text;
    PM_TRY(pm_beam_mesh_place(&system->mesh, count, size, nbody, placement, arena));
    PM_TRY(check_apart(beams, system));
    PM_TRY(pm_truth_number(block, "contact", DBL_MIN, 1e15, &system->contact));
    PM_TRY(pm_yaml_require(block, "loaded", &loaded));
    return pm_yaml_choice(loaded, name, &system->loaded);
}

// Returns true if all elements have a positive volume at all points.
static bool is_sound(const pm_beam_mesh *mesh, int *element) {
    for (int e = 0; e < mesh->nelement; ++e) {
        pm_beam_element brick;
        double x[PM_BEAM_FREEDOMS];
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            memcpy(x + 3 * c, mesh->position[mesh->hexahedron[e][c]], 3 * sizeof *x);
        }
        pm_beam_element_init(&brick, x);
        for (int p = 0; p < PM_BEAM_POINTS; ++p) {
            if (!(brick.weight[p] > 0)) {
                *element = e;
                return false;
            }
        }
    }
    return true;
}

// Reads a body of any shape. Its file is named relative to the folder of the truth file `path`.
static pm_status read_file(pm_yaml block, const char *path, pm_arena *arena,
                           pm_beam_system *system) {
    static const char *const of_boxes[] = {"size",   "elements", "beams", "contact",
                                           "loaded", "rows",     NULL};
    const pm_yaml file = pm_yaml_get(block, "mesh");
    const char *slash = strrchr(path, '/'), *name, *full;
    int element = 0;
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
    if (full == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    PM_TRY(pm_beam_mesh_load(&system->mesh, full, arena));
    system->file = name;
    if (!is_sound(&system->mesh, &element)) {
        return pm_yaml_fail(file, "element %d of %s is turned inside out", element, full);
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
    double size[3];
    int count[3];
    if (pm_yaml_exists(pm_yaml_get(block, "mesh"))) {
        return read_file(block, path, arena, system);
    }
    PM_TRY(read_box(block, arena, count, size));
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

// Reads the Maxwell branches, which have as many shares g as relaxation times tau.
static pm_status read_branches(pm_yaml map, pm_arena *arena, pm_beam_material *material) {
    pm_yaml shares = pm_yaml_get(map, "g");
    double *g = NULL, sum = 0;
    if (!pm_yaml_exists(shares)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_doubles(shares, arena, &material->nbranch, &g));
    if (material->nbranch > PM_BEAM_MAX_BRANCHES) {
        return pm_yaml_fail(shares, "expected at most %d", PM_BEAM_MAX_BRANCHES);
    }
    PM_TRY(pm_truth_numbers(map, "tau", material->nbranch, arena, material->tau));
    for (int i = 0; i < material->nbranch; ++i) {
        material->g[i] = g[i];
        sum += g[i];
        if (!(g[i] >= 0 && sum < 1 && material->tau[i] > 0)) {
            return pm_yaml_fail(shares, "expected shares >= 0 with a sum below 1, and tau > 0");
        }
    }
    return PM_OK;
}

static pm_status read_material(pm_yaml block, pm_arena *arena, pm_beam_material *material) {
    static const char *const keys[] = {"C10", "C01", "D1", "g", "tau", NULL};
    pm_yaml map;
    PM_TRY(pm_yaml_require(block, "material", &map));
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_truth_number(map, "C10", 1e-9, 1e15, &material->C10));
    PM_TRY(pm_truth_number(map, "C01", 0, 1e15, &material->C01));
    PM_TRY(pm_truth_number(map, "D1", 1e-15, 1e9, &material->D1));
    return read_branches(map, arena, material);
}

static pm_status read_range(pm_yaml map, const char *key, pm_arena *arena, double range[2]) {
    PM_TRY(pm_truth_numbers(map, key, 2, arena, range));
    return range[0] > 0 && range[0] <= range[1]
               ? PM_OK
               : pm_yaml_fail(pm_yaml_get(map, key), "expected [lowest, highest], both > 0");
}

static pm_status read_patches(pm_yaml map, bool box, pm_arena *arena, pm_beam_patches *patches) {
    static const char *const keys[] = {"face", "force", "length", "width", "tilt",
                                       "ramp", "hold",  "unload", NULL};
    static const char *const faces[] = {"+y", "+z", "-y", "-z", NULL}; // as in beam_load.h
    pm_yaml face = pm_yaml_get(map, "face");
    PM_TRY(pm_yaml_allow(map, keys));
    patches->face = -1;
    if (pm_yaml_exists(face) && !box) {
        return pm_yaml_fail(face, "only a box has a `face`, not a `mesh`");
    }
    if (pm_yaml_exists(face)) {
        PM_TRY(pm_yaml_choice(face, faces, &patches->face));
    }
    PM_TRY(read_range(map, "force", arena, patches->force));
    PM_TRY(read_range(map, "length", arena, patches->length));
    PM_TRY(read_range(map, "width", arena, patches->width));
    PM_TRY(pm_truth_number(map, "tilt", 0, 10, &patches->tilt));
    PM_TRY(read_range(map, "ramp", arena, patches->ramp));
    PM_TRY(read_range(map, "hold", arena, patches->hold));
    return read_range(map, "unload", arena, patches->unload);
}

static pm_status read_rows(pm_yaml map, pm_beam_system *system) {
    static const char *const keys[] = {"force", "positions", "ramp", NULL};
    pm_yaml positions;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_truth_number(map, "force", 0, 1e15, &system->force));
    PM_TRY(pm_truth_number(map, "ramp", 1e-9, 1e9, &system->ramp));
    PM_TRY(pm_yaml_require(map, "positions", &positions));
    return pm_yaml_int(positions, 1, system->mesh.count[0], &system->positions);
}

pm_status pm_beam_config_read(pm_yaml block, const char *path, pm_arena *arena,
                              pm_beam_system *system) {
    static const char *const keys[] = {"size",     "elements", "mesh",    "material",
                                       "substeps", "beams",    "contact", "loaded",
                                       "rows",     "patches",  NULL};
    pm_yaml substeps, rows = pm_yaml_get(block, "rows"), patches;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_mesh(block, path, arena, system));
    PM_TRY(read_material(block, arena, &system->material));
    PM_TRY(pm_yaml_require(block, "substeps", &substeps));
    PM_TRY(pm_yaml_int(substeps, 1, 1000, &system->substeps));
    if (pm_yaml_exists(rows)) {
        return pm_yaml_exists(pm_yaml_get(block, "patches"))
                   ? pm_yaml_fail(rows, "expected either `rows` or `patches`, found both")
                   : read_rows(rows, system);
    }
    PM_TRY(pm_yaml_require(block, "patches", &patches));
    return read_patches(patches, system->file == NULL, arena, &system->patches);
}

const char *pm_beam_config_describe(const pm_beam_system *system, pm_arena *arena) {
    const pm_beam_mesh *mesh = &system->mesh;
    const pm_beam_material *m = &system->material;
    const char *text = system->file != NULL
                           ? pm_arena_printf(arena, "%s, %d bricks", system->file, mesh->nelement)
                           : pm_arena_printf(arena, "%g x %g x %g m in %d x %d x %d bricks",
                                             mesh->size[0], mesh->size[1], mesh->size[2],
                                             mesh->count[0], mesh->count[1], mesh->count[2]);
    if (text != NULL) {
        text = pm_arena_printf(arena, "%s; C10 %g Pa, C01 %g Pa, D1 %g 1/Pa", text, m->C10, m->C01,
                               m->D1);
    }
    for (int i = 0; i < m->nbranch && text != NULL; ++i) {
        text = pm_arena_printf(arena, "%s; g %g, tau %g s", text, m->g[i], m->tau[i]);
    }
    for (int b = 0; b < mesh->nbody && system->name != NULL && text != NULL; ++b) {
        text = pm_arena_printf(arena, "%s; %s: %s", text, system->name[b], system->placement[b]);
    }
    if (system->name != NULL && text != NULL) {
        text = pm_arena_printf(arena, "%s; contact %g Pa/m; %s is loaded", text, system->contact,
                               system->name[system->loaded]);
    }
    return text == NULL ? NULL
                        : pm_arena_printf(arena, "%s; %d steps per state", text, system->substeps);
}

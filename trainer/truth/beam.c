// The beam as a simulator: its configuration, and its trajectories as fields on a mesh. Variables
// of a node: q (position), v (its rate, by backward differences of second order over the last
// steps), sigma (Cauchy stress, xx yy zz xy xz yz).
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "truth/beam_load.h"
#include "truth/beam_solve.h"
#include "truth/numbers.h"
#include "truth/truth.h"

enum { Q, V = 3, SIGMA = 6, NVARIABLE = SIGMA + PM_SYMMETRIC };

typedef struct beam_system {
    pm_beam_mesh mesh;
    pm_beam_material material;
    pm_truth_body body;
    int substeps;  // steps per state
    int positions; // rows of each face; 0: random patches
    double force, ramp;
    pm_beam_patches patches;
} beam_system;

// --- trajectories ---

static pm_status choose_load(const beam_system *system, uint64_t seed, int trajectory,
                             pm_beam_load *load) {
    if (system->positions == 0) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)trajectory);
        pm_beam_load_patch(load, &system->mesh, &system->patches, &rng);
        return PM_OK;
    }
    if (trajectory >= PM_BEAM_FACES * system->positions) {
        return pm_fail(PM_ECONFIG, "beam: trajectory %d of %d: %d rows on each of %d faces",
                       trajectory, PM_BEAM_FACES * system->positions, system->positions,
                       PM_BEAM_FACES);
    }
    pm_beam_load_row(load, &system->mesh, trajectory / system->positions,
                     trajectory % system->positions, system->force, system->ramp);
    return PM_OK;
}

// Writes the state into the field. `past` [2][nnode][3]: positions one and two steps before.
static void keep_state(const beam_system *system, const pm_beam_state *now, const double *past,
                       double h, double *z, double *energy) {
    const int nnode = system->mesh.nnode;
    for (int i = 0; i < nnode; ++i, z += NVARIABLE) {
        for (int d = 0; d < 3; ++d) {
            const double q = now->q[3 * i + d];
            z[Q + d] = q;
            z[V + d] = (3 * q - 4 * past[3 * i + d] + past[3 * (nnode + i) + d]) / (2 * h);
        }
        memcpy(z + SIGMA, now->sigma + PM_SYMMETRIC * i, PM_SYMMETRIC * sizeof *z);
    }
    energy[0] = now->stored;
    energy[1] = now->dissipated;
    energy[2] = now->work;
}

// Rest before the start is what `past` [2][nnode][3] holds first; `f` [nnode][3] is work space.
static pm_status follow(const beam_system *system, const pm_beam_load *load, pm_beam *beam,
                        pm_field *field, int row, double *past, double *f) {
    const size_t count = 3 * (size_t)system->mesh.nnode;
    const double h = field->dt / system->substeps;
    const pm_beam_state *now = pm_beam_now(beam);
    for (int k = 0; k < 2; ++k) {
        memcpy(past + (size_t)k * count, now->q, count * sizeof *past);
    }
    for (int j = 0; j < field->ntime; ++j) {
        for (int k = 1; k <= system->substeps && j > 0; ++k) {
            const double t = ((j - 1) * system->substeps + k) * h;
            memcpy(past + count, past, count * sizeof *past);
            memcpy(past, now->q, count * sizeof *past);
            pm_beam_load_at(load, &system->mesh, t, f);
            PM_TRY(pm_beam_step(beam, h, f, NULL));
        }
        keep_state(system, now, past, h, pm_field_state(field, row, j),
                   field->energy +
                       ((size_t)row * (size_t)field->ntime + (size_t)j) * PM_FIELD_ENERGIES);
        pm_beam_load_at(load, &system->mesh, field->t[j], pm_field_force(field, row, j));
    }
    return PM_OK;
}

static pm_status run(const void *data, uint64_t seed, int trajectory, pm_field *field, int row) {
    const beam_system *system = data;
    const size_t count = 3 * (size_t)system->mesh.nnode;
    pm_beam *beam = NULL;
    pm_beam_load load;
    pm_status status;
    double *work = calloc(3 * count, sizeof *work);
    if (work == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    PM_TRY_DONE(choose_load(system, seed, trajectory, &load));
    PM_TRY_DONE(pm_beam_new(&beam, &system->mesh, &system->material));
    PM_TRY_DONE(follow(system, &load, beam, field, row, work, work + 2 * count));
done:
    pm_beam_free(beam);
    free(work);
    return status;
}

static void describe(const void *data, pm_field *field) {
    const pm_beam_mesh *mesh = &((const beam_system *)data)->mesh;
    for (int i = 0; i < mesh->nnode; ++i) {
        memcpy(field->position + 3 * i, mesh->position[i], sizeof mesh->position[i]);
        field->clamped[i] = pm_beam_mesh_clamped(mesh, i);
    }
    for (int i = 0; i < mesh->nelement * PM_BEAM_CORNERS; ++i) {
        field->hexahedron[i] = mesh->hexahedron[0][i];
    }
}

// --- the configuration ---

// So that a face has at most PM_BEAM_MAX_LOADED nodes.
static const int most[3] = {100, 19, 19};

static pm_status read_mesh(pm_yaml block, pm_arena *arena, beam_system *system) {
    double size[3], number[3];
    int count[3];
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
    return pm_beam_mesh_make(&system->mesh, count, size, arena);
}

// Branches: equally many shares g and times tau.
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
            return pm_yaml_fail(shares, "expected shares >= 0, in all below 1, and tau > 0");
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

static pm_status read_patches(pm_yaml map, pm_arena *arena, pm_beam_patches *patches) {
    static const char *const keys[] = {"force", "length", "width",  "tilt",
                                       "ramp",  "hold",   "unload", NULL};
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(read_range(map, "force", arena, patches->force));
    PM_TRY(read_range(map, "length", arena, patches->length));
    PM_TRY(read_range(map, "width", arena, patches->width));
    PM_TRY(pm_truth_number(map, "tilt", 0, 10, &patches->tilt));
    PM_TRY(read_range(map, "ramp", arena, patches->ramp));
    PM_TRY(read_range(map, "hold", arena, patches->hold));
    return read_range(map, "unload", arena, patches->unload);
}

static pm_status read_rows(pm_yaml map, beam_system *system) {
    static const char *const keys[] = {"force", "positions", "ramp", NULL};
    pm_yaml positions;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_truth_number(map, "force", 0, 1e15, &system->force));
    PM_TRY(pm_truth_number(map, "ramp", 1e-9, 1e9, &system->ramp));
    PM_TRY(pm_yaml_require(map, "positions", &positions));
    return pm_yaml_int(positions, 1, system->mesh.count[0], &system->positions);
}

static pm_status read_system(pm_yaml block, pm_arena *arena, beam_system *system) {
    static const char *const keys[] = {"size", "elements", "material", "substeps",
                                       "rows", "patches",  NULL};
    pm_yaml substeps, rows = pm_yaml_get(block, "rows"), patches;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_mesh(block, arena, system));
    PM_TRY(read_material(block, arena, &system->material));
    PM_TRY(pm_yaml_require(block, "substeps", &substeps));
    PM_TRY(pm_yaml_int(substeps, 1, 1000, &system->substeps));
    if (pm_yaml_exists(rows)) {
        return pm_yaml_exists(pm_yaml_get(block, "patches"))
                   ? pm_yaml_fail(rows, "expected either rows or patches")
                   : read_rows(rows, system);
    }
    PM_TRY(pm_yaml_require(block, "patches", &patches));
    return read_patches(patches, arena, &system->patches);
}

static const char *describe_parameters(const beam_system *system, pm_arena *arena) {
    const pm_beam_material *m = &system->material;
    const char *text = pm_arena_printf(
        arena, "%g x %g x %g m in %d x %d x %d bricks; C10 %g Pa, C01 %g Pa, D1 %g 1/Pa",
        system->mesh.size[0], system->mesh.size[1], system->mesh.size[2], system->mesh.count[0],
        system->mesh.count[1], system->mesh.count[2], m->C10, m->C01, m->D1);
    for (int i = 0; i < m->nbranch && text != NULL; ++i) {
        text = pm_arena_printf(arena, "%s; g %g, tau %g s", text, m->g[i], m->tau[i]);
    }
    return text == NULL ? NULL
                        : pm_arena_printf(arena, "%s; %d steps per state", text, system->substeps);
}

pm_status pm_beam_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    beam_system *system = pm_arena_alloc(arena, sizeof *system);
    if (system == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    PM_TRY(read_system(block, arena, system));
    model->parameters = describe_parameters(system, arena);
    if (model->parameters == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    system->body = (pm_truth_body){
        .nnode = system->mesh.nnode,
        .nelement = system->mesh.nelement,
        .nvariable = NVARIABLE,
        .variable = "qx qy qz vx vy vz sxx syy szz sxy sxz syz",
        .describe = describe,
        .run = run,
    };
    model->title = "A clamped beam of viscoelastic rubber under loads";
    model->units = "m;m;m;m/s;m/s;m/s;Pa;Pa;Pa;Pa;Pa;Pa";
    model->ode.data = system;
    model->body = &system->body;
    return PM_OK;
}

// The simulator of beams, which writes the fields of each beam in its own frame. The variables of a
// node are q (position), v (velocity, by backward differences of second order over the last steps)
// and sigma (Cauchy stress, xx yy zz xy xz yz).
#include <stdlib.h>
#include <string.h>

#include "truth/beam_config.h"
#include "truth/beam_solve.h"
#include "truth/truth.h"

enum { Q, V = 3, SIGMA = 6, NVARIABLE = SIGMA + PM_SYMMETRIC };

typedef struct beam_model {
    pm_beam_system system;
    pm_truth_body body;
} beam_model;

// --- trajectories ---

// Makes the load of a trajectory: a random patch, or the next row.
static pm_status choose_load(const pm_beam_system *system, uint64_t seed, int trajectory,
                             pm_beam_load *load) {
    if (system->positions == 0) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)trajectory);
        if (system->file != NULL) {
            pm_beam_load_skin(load, &system->mesh, &system->skin, &system->patches, &rng);
        } else {
            pm_beam_load_patch(load, &system->mesh, &system->patches, &rng);
        }
    } else if (trajectory >= PM_BEAM_FACES * system->positions) {
        return pm_fail(PM_ECONFIG, "beam: trajectory %d of %d: %d rows on each of %d faces",
                       trajectory, PM_BEAM_FACES * system->positions, system->positions,
                       PM_BEAM_FACES);
    } else {
        pm_beam_load_row(load, &system->mesh, trajectory / system->positions,
                         trajectory % system->positions, system->force, system->ramp);
    }
    load->body = system->loaded;
    return PM_OK;
}

// Turns vectors [nnode][3] from the global frame into the frame of a body.
static void turn_back(const pm_beam_placement *placement, int nnode, const double *global,
                      double *own) {
    for (int i = 0; i < nnode; ++i) {
        pm_beam_placement_turn_back(placement, global + 3 * i, own + 3 * i);
    }
}

// Computes the variables of the nodes of a body, the first of which is `first`. `past`
// [2][nnode][3] are the positions of all nodes one and two steps before.
static void keep_variables(const pm_beam_system *system, const pm_beam_placement *placement,
                           int first, const pm_beam_state *now, const double *past, double h,
                           double *z) {
    const int nnode = system->mesh.nnode;
    for (int i = first; i < first + nnode / system->mesh.nbody; ++i, z += NVARIABLE) {
        const double *sigma = now->sigma + PM_SYMMETRIC * i;
        double relative[3], v[3];
        for (int d = 0; d < 3; ++d) {
            const double q = now->q[3 * i + d];
            relative[d] = q - placement->origin[d];
            v[d] = (3 * q - 4 * past[3 * i + d] + past[3 * (nnode + i) + d]) / (2 * h);
        }
        pm_beam_placement_turn_back(placement, relative, z + Q);
        pm_beam_placement_turn_back(placement, v, z + V);
        for (int m = 0; m < PM_SYMMETRIC; ++m) {
            const int r = pm_tensor_row[m], c = pm_tensor_column[m];
            z[SIGMA + m] = placement->sign[r] * placement->sign[c] *
                           sigma[pm_tensor_at[placement->axis[r]][placement->axis[c]]];
        }
    }
}

// Writes the state under the forces f into the fields, at time j of row `row`.
static void keep_state(const pm_beam_system *system, const pm_beam_state *now, const double *past,
                       double h, const double *f, pm_field *const *field, int row, int j) {
    const pm_beam_mesh *mesh = &system->mesh;
    for (int b = 0; b < mesh->nbody; ++b) {
        const pm_beam_placement *placement = &mesh->placement[b];
        const pm_beam_energy *energy = &now->energy[b];
        const int nnode = mesh->nnode / mesh->nbody, first = b * nnode;
        const size_t at = (size_t)row * (size_t)field[b]->ntime + (size_t)j;
        keep_variables(system, placement, first, now, past, h, pm_field_state(field[b], row, j));
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

// Simulates a trajectory. The bodies are at rest before the start. `past` [2][nnode][3] and
// `f` [nnode][3] are work space.
static pm_status follow(const pm_beam_system *system, const pm_beam_load *load, pm_beam *beam,
                        pm_field *const *field, int row, double *past, double *f) {
    const size_t count = 3 * (size_t)system->mesh.nnode;
    const double h = field[0]->dt / system->substeps;
    const pm_beam_state *now = pm_beam_now(beam);
    for (int k = 0; k < 2; ++k) {
        memcpy(past + (size_t)k * count, now->q, count * sizeof *past);
    }
    for (int j = 0; j < field[0]->ntime; ++j) {
        for (int k = 1; k <= system->substeps && j > 0; ++k) {
            memcpy(past + count, past, count * sizeof *past);
            memcpy(past, now->q, count * sizeof *past);
            pm_beam_load_at(load, &system->mesh, ((j - 1) * system->substeps + k) * h, f);
            PM_TRY(pm_beam_step(beam, h, f, NULL));
        }
        keep_state(system, now, past, h, f, field, row, j);
    }
    return PM_OK;
}

static pm_status run(const void *data, uint64_t seed, int trajectory, pm_field *const *field,
                     int row) {
    const pm_beam_system *system = data;
    const size_t count = 3 * (size_t)system->mesh.nnode;
    pm_beam *beam = NULL;
    pm_beam_load load;
    pm_status status;
    double *work = calloc(3 * count, sizeof *work);
    if (work == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    PM_TRY_DONE(choose_load(system, seed, trajectory, &load));
    PM_TRY_DONE(pm_beam_new(&beam, &system->mesh, &system->material, system->contact));
    PM_TRY_DONE(follow(system, &load, beam, field, row, work, work + 2 * count));
done:
    pm_beam_free(beam);
    free(work);
    return status;
}

static void describe(const void *data, int body, pm_field *field) {
    const pm_beam_mesh *mesh = &((const pm_beam_system *)data)->mesh;
    const pm_beam_placement *placement = &mesh->placement[body];
    for (int i = 0; i < field->nnode; ++i) {
        const double *x = mesh->position[body * field->nnode + i];
        double relative[3];
        for (int d = 0; d < 3; ++d) {
            relative[d] = x[d] - placement->origin[d];
        }
        pm_beam_placement_turn_back(placement, relative, field->position + 3 * i);
        field->clamped[i] = mesh->clamped[i];
    }
    for (int i = 0; i < field->nelement * PM_BEAM_CORNERS; ++i) {
        field->hexahedron[i] = mesh->hexahedron[i / PM_BEAM_CORNERS][i % PM_BEAM_CORNERS];
    }
}

// --- the simulator ---

pm_status pm_beam_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    beam_model *beams = pm_arena_alloc(arena, sizeof *beams);
    if (beams == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    pm_beam_system *system = &beams->system;
    const pm_beam_mesh *mesh = &system->mesh;
    PM_TRY(pm_beam_config_read(block, model->path, arena, system));
    model->parameters = pm_beam_config_describe(system, arena);
    if (model->parameters == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    beams->body = (pm_truth_body){
        .nbody = mesh->nbody,
        .name = system->name,
        .placement = system->placement,
        .nnode = mesh->nnode / mesh->nbody,
        .nelement = mesh->nelement / mesh->nbody,
        .nvariable = NVARIABLE,
        .variable = "qx qy qz vx vy vz sxx syy szz sxy sxz syz",
        .describe = describe,
        .run = run,
    };
    model->title = system->file != NULL ? "A clamped body of viscoelastic rubber under loads"
                   : mesh->nbody > 1
                       ? "Clamped beams of viscoelastic rubber under loads, in contact"
                       : "A clamped beam of viscoelastic rubber under loads";
    model->units = "m;m;m;m/s;m/s;m/s;Pa;Pa;Pa;Pa;Pa;Pa";
    model->ode.data = system;
    model->body = &beams->body;
    return PM_OK;
}

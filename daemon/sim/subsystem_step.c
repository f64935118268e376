// The steps of one subsystem: the start of a run, the checks at the end of a step, and the sums of
// fluxes and counts (pm_books).
#include <assert.h>

#include "sim/step_checks.h"
#include "sim/subsystem_parts.h"

// --- the books ---

// Clears the sums of the step under way. The counts continue.
static void clear_booking(pm_subsystem *s) {
    const pm_books *b = &s->booking;
    s->booking =
        (pm_books){.evaluated = b->evaluated, .skipped = b->skipped, .outside = b->outside};
    for (int i = 0; i < s->nport; ++i) {
        s->port[i].booking = s->port[i].outside_booking = (pm_flux){0};
    }
}

// Makes the sums of the step under way those of the last step, with E and S at its end.
static void close_books(pm_subsystem *s) {
    s->books = s->booking;
    s->books.energy = s->dynamics.E[0];
    s->books.entropy = pm_subsystem_value_at(s->dynamics.S, 0);
    s->books.flux = s->flux;
    s->books.nflux = s->nport;
    for (int i = 0; i < s->nport; ++i) {
        s->flux[i] = s->port[i].booking;
        if (s->port[i].boundary_input != NULL) {
            s->flux[s->books.nflux++] = s->port[i].outside_booking;
        }
    }
    clear_booking(s);
}

void pm_subsystem_set_state(pm_subsystem *s, const double *z) {
    memmove(s->z, z, (size_t)s->nz * sizeof *z);
    pm_subsystem_copy(s->stage_z, s->z, s->nz);
    pm_subsystem_copy(s->safe_z, s->z, s->nz);
    s->stage = s->substep = 0;
    pm_iteration_start(&s->iteration);
    s->step = 0;
    memset(s->size, 0, PM_MAX_GROUPS * sizeof *s->size);
    pm_local_dynamics_forget(&s->dynamics);
    if (s->dynamics.solid != NULL) {
        pm_solid_dynamics_start(s->dynamics.solid, s->z);
    }
    for (int i = 0; i < s->nport; ++i) {
        s->port[i].known = false;
    }
    pm_subsystem_show(s, pm_local_dynamics_expose_end(&s->dynamics, s->stage_z, s->z));
    s->booking = (pm_books){0};
    clear_booking(s);
    pm_invariant_projection_start(&s->projection, s->dynamics.E[0],
                                  pm_subsystem_value_at(s->dynamics.S, 0));
    s->safe_projection = s->projection;
    close_books(s);
}

// --- the end of a step ---

static pm_status check_training_range(pm_subsystem *s) {
    bool outside = false;
    const pm_status status =
        pm_step_check_range(s->system->scene, s->scene, s->range, s->z, s->step + 1, &outside);
    s->booking.outside += outside;
    return status;
}

// Fails if a solid has found no balance of forces in this step.
static pm_status check_balance(const pm_subsystem *s) {
    if (s->dynamics.solid == NULL || s->dynamics.solid->status == PM_OK) {
        return PM_OK;
    }
    return pm_fail(
        s->dynamics.solid->status,
        "subsystem %s: step %ld: no balance of forces, not even in short steps: the load "
        "is too large, or an element is turned inside out",
        s->scene->name, s->step + 1);
}

static pm_status check_boundary_input(const pm_subsystem *s) {
    if (s->boundary_input == NULL || pm_boundary_input_covers(s->boundary_input, s->step)) {
        return PM_OK;
    }
    return pm_fail(
        PM_EDATA,
        "subsystem %s: the trajectory of its boundary input ends after %ld steps: take fewer "
        "steps, or a longer trajectory",
        s->scene->name, s->boundary_input->end);
}

pm_status pm_subsystem_end_step(pm_subsystem *s) {
    assert(s->stage == 0 && s->substep == s->substeps);
    s->substep = 0;
    pm_status status = check_balance(s);
    if (status == PM_OK) {
        status = pm_step_check_finite(s->scene, s->z);
    }
    if (status == PM_OK) {
        pm_subsystem_show(s, pm_local_dynamics_expose_end(&s->dynamics, s->stage_z, s->z));
        status = pm_step_check_potentials(s->scene, s->dynamics.E[0],
                                          pm_subsystem_value_at(s->dynamics.S, 0));
    }
    if (status == PM_OK) {
        status = check_boundary_input(s);
    }
    if (status == PM_OK) {
        status = check_training_range(s);
    }
    if (status != PM_OK) {
        pm_subsystem_copy(s->z, s->safe_z, s->nz);
        pm_subsystem_copy(s->stage_z, s->z, s->nz);
        s->projection = s->safe_projection;
        s->exposed = false;
        if (s->dynamics.solid != NULL) {
            pm_solid_dynamics_start(s->dynamics.solid, s->z);
        }
        return status;
    }
    pm_subsystem_copy(s->safe_z, s->z, s->nz);
    s->safe_projection = s->projection;
    ++s->step;
    close_books(s);
    return PM_OK;
}

pm_books pm_subsystem_books(const pm_subsystem *s) {
    return s->books;
}

void pm_sample_set_books(pm_sample *sample, int id, const pm_books *books) {
    sample->energy[id] = books->energy;
    sample->entropy[id] = books->entropy;
    sample->bulk_energy[id] = books->bulk.energy;
    sample->bulk_entropy[id] = books->bulk.entropy;
    sample->bulk_gross[2 * id] = books->bulk.energy_gross;
    sample->bulk_gross[2 * id + 1] = books->bulk.entropy_gross;
    sample->evaluated[id] = books->evaluated;
    sample->skipped[id] = books->skipped;
    sample->outside[id] = books->outside;
    sample->error[id] = books->error;
}

void pm_subsystem_fill_sample(const pm_subsystem *s, pm_sample *sample) {
    const pm_books *books = &s->books;
    pm_subsystem_copy(sample->z + s->scene->first, s->z, s->nz);
    pm_sample_set_books(sample, s->id, books);
    int outside = s->nport;
    for (int k = 0; k < s->nport; ++k) {
        const pm_port_instance *j = &s->port[k];
        sample->flux[j->port_id][j->end] = books->flux[k];
        if (j->boundary_input != NULL) {
            sample->flux[j->port_id][1 - j->end] = books->flux[outside++];
        }
    }
}

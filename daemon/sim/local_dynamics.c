// Building and running the graphs of a subsystem's exposure and bulk term.
#include "sim/local_dynamics.h"

#include "sim/program_input.h"

// Builds the response d(dE)/d(rate) over a substep h, for the components whose response a port's
// prediction needs.
static pm_status build_response(pm_graph *g, pm_arena *arena, const pm_system *system, int id,
                                double h, pm_node dE, pm_node z, pm_node *result) {
    const pm_part *part = system->part[id];
    bool *wanted = pm_arena_array(arena, (size_t)part->layout.nz, sizeof *wanted);
    if (wanted == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the graphs of a subsystem");
    }
    pm_system_responding(system, id, wanted);
    const pm_node response = pm_part_response(g, part, dE, z, wanted);
    *result = response == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, response, h);
    return PM_OK;
}

#define OUTPUTS 5

// Opens the program for the wanted outputs that are not PM_NO_NODE, and stores pointers to their
// values.
static pm_status open_exposure(pm_local_dynamics *t, pm_graph *g, pm_node z, pm_node from,
                               const pm_node wanted[OUTPUTS]) {
    const double **const value[OUTPUTS] = {&t->E, &t->S, &t->dE, &t->dS, &t->response};
    pm_node output[OUTPUTS];
    int count = 0;
    for (int i = 0; i < OUTPUTS; ++i) {
        if (wanted[i] != PM_NO_NODE) {
            output[count++] = pm_broadcast_to(
                g, wanted[i], (pm_shape){true, 1, pm_graph_shape(g, wanted[i]).cols});
        }
    }
    PM_TRY(pm_program_open(&t->exposure, g, count, output, 1));
    t->exposure_z = pm_program_value(t->exposure, z);
    t->exposure_from = from == PM_NO_NODE ? NULL : pm_program_value(t->exposure, from);
    count = 0;
    for (int i = 0; i < OUTPUTS; ++i) {
        *value[i] = wanted[i] == PM_NO_NODE ? NULL : pm_program_value(t->exposure, output[count++]);
    }
    return PM_OK;
}

static pm_status build_exposure(pm_local_dynamics *t, pm_arena *arena, const pm_system *system,
                                int id, const pm_integrator *integrator, double h) {
    const pm_part *part = system->part[id];
    pm_graph *g = NULL;
    pm_status status;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, t->nz);
    const bool discrete = integrator->discrete && t->gap == NULL;
    const pm_node from = discrete ? pm_input(g, true, 1, t->nz) : PM_NO_NODE;
    pm_node dE, dS, response = PM_NO_NODE;
    const pm_node E = pm_part_energy(g, part, z), S = pm_part_entropy(g, part, z);
    pm_part_coenergies(g, part, from, z, &dE, &dS);
    if (discrete) {
        PM_TRY_DONE(build_response(g, arena, system, id, h, dE, z, &response));
    }
    status = open_exposure(t, g, z, from, (const pm_node[]){E, S, dE, dS, response});
done:
    pm_graph_close(g);
    return status;
}

static pm_status open_bulk(pm_local_dynamics *t, const pm_part *part) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, t->nz), dE = pm_input(g, true, 1, t->nz);
    const pm_node dS = t->dS == NULL ? PM_NO_NODE : pm_input(g, true, 1, t->nz);
    pm_node degeneracy = PM_NO_NODE;
    const pm_node rate = pm_part_bulk(g, part, z, dE, dS, &degeneracy);
    pm_status status = PM_OK;
    if (rate != PM_NO_NODE) {
        status = pm_program_open(&t->bulk, g, 1, &rate, 1);
    }
    if (t->bulk != NULL) {
        t->bulk_z = pm_input_of(t->bulk, z);
        t->bulk_dE = pm_input_of(t->bulk, dE);
        t->bulk_dS = pm_input_of(t->bulk, dS);
        t->bulk_rate = pm_program_value(t->bulk, rate);
    }
    pm_graph_close(g);
    return status;
}

static pm_status open_solid(pm_local_dynamics *t, pm_arena *arena, const pm_system *system,
                            int id) {
    t->solid = pm_arena_array(arena, 1, sizeof *t->solid);
    if (t->solid == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a solid");
    }
    PM_TRY(pm_solid_dynamics_open(t->solid, arena, system->part[id], system->mesh[id]));
    t->E = &t->solid->E;
    t->S = &t->solid->S;
    t->dE = t->solid->dE;
    t->dS = t->solid->dS;
    return PM_OK;
}

pm_status pm_local_dynamics_open(pm_local_dynamics *t, pm_arena *arena, const pm_system *system,
                                 int subsystem_id, const pm_integrator *integrator, double h) {
    const pm_part *part = system->part[subsystem_id];
    t->nz = part->layout.nz;
    t->h = h;
    if (part->spec.solid != NULL) {
        return open_solid(t, arena, system, subsystem_id);
    }
    if (integrator->discrete && pm_contact_gap_is(system, subsystem_id)) {
        t->gap = pm_arena_array(arena, 1, sizeof *t->gap);
        PM_TRY(t->gap == NULL ? pm_fail(PM_ENOMEM, "out of memory for a gap")
                              : pm_contact_gap_open(t->gap, arena, system, subsystem_id));
    }
    PM_TRY(build_exposure(t, arena, system, subsystem_id, integrator, h));
    if (t->gap != NULL) {
        pm_contact_gap_set_program(t->gap, t->exposure, t->exposure_z, t->E, t->dE);
        t->E = &t->gap->E;
        t->S = &t->gap->S;
        t->dE = t->gap->dE;
        t->dS = t->gap->dS;
        t->response = t->gap->response;
    }
    PM_TRY(pm_contact_broadphase_open(&t->broadphase, arena, part));
    return open_bulk(t, part);
}

void pm_local_dynamics_close(pm_local_dynamics *t) {
    if (t->solid != NULL) {
        pm_solid_dynamics_close(t->solid);
    }
    pm_program_close(t->exposure);
    pm_program_close(t->bulk);
    pm_contact_broadphase_close(&t->broadphase);
}

void pm_local_dynamics_forget(pm_local_dynamics *t) {
    t->exposure_known = t->bulk_known = false;
    if (t->gap != NULL) {
        // A run does not depend on what a run before it has learned of the bodies.
        t->gap->count = 0;
    }
}

// Returns true if z and `from` (NULL: not needed) both lie in the box.
static bool is_bounded(const pm_local_dynamics *t, const double *z, const double *from) {
    const double *centre = t->exposure_z;
    return pm_contact_broadphase_holds(&t->broadphase, centre, z) &&
           (from == NULL || pm_contact_broadphase_holds(&t->broadphase, centre, from));
}

// Puts a box around the state just evaluated. With a discrete integrator the box is kept only if it
// contains the start of the step, too, since discrete gradients depend on both states.
static void enclose(pm_local_dynamics *t, const double *rate) {
    pm_contact_broadphase_enclose(&t->broadphase, t->exposure_z, t->dE, rate);
    if (!is_bounded(t, t->exposure_z, t->exposure_from)) {
        t->broadphase.enclosed = false;
    }
}

pm_exposure pm_local_dynamics_expose(pm_local_dynamics *t, const double *z, const double *from,
                                     const double *rate) {
    if (t->solid != NULL) {
        pm_solid_dynamics_expose(t->solid, z, from, t->h);
        return PM_EXPOSURE_EVALUATED;
    }
    if (t->gap != NULL) {
        pm_contact_gap_expose(t->gap, z);
        return PM_EXPOSURE_EVALUATED;
    }
    if (t->exposure_known && is_bounded(t, z, t->exposure_from == NULL ? NULL : from)) {
        return PM_EXPOSURE_BOUNDED;
    }
    bool renewed = !t->exposure_known;
    renewed |= pm_renew(t->exposure_z, z, t->nz);
    renewed |= pm_renew(t->exposure_from, from, t->nz);
    if (!renewed) {
        return PM_EXPOSURE_SAME;
    }
    if (!t->exposure_known) {
        pm_program_prepare(t->exposure);
    }
    pm_program_run_prepared(t->exposure, 1);
    t->exposure_known = true;
    enclose(t, rate);
    return PM_EXPOSURE_EVALUATED;
}

void pm_local_dynamics_begin(pm_local_dynamics *t, const double *z) {
    if (t->gap != NULL) {
        pm_contact_gap_begin(t->gap, z);
    }
}

pm_exposure pm_local_dynamics_expose_end(pm_local_dynamics *t, const double *z,
                                         const double *from) {
    pm_contact_broadphase_forget(&t->broadphase);
    pm_local_dynamics_begin(t, z);
    const pm_exposure exposure = pm_local_dynamics_expose(t, z, from, NULL);
    if (exposure == PM_EXPOSURE_SAME) {
        enclose(t, NULL);
    }
    return exposure;
}

bool pm_local_dynamics_evaluate_bulk(pm_local_dynamics *t, const double *z) {
    bool renewed = !t->bulk_known;
    renewed |= pm_renew(t->bulk_z, z, t->nz);
    renewed |= pm_renew(t->bulk_dE, t->dE, t->nz);
    renewed |= pm_renew(t->bulk_dS, t->dS, t->nz);
    if (renewed && !t->bulk_known) {
        pm_program_prepare(t->bulk);
    }
    if (renewed) {
        pm_program_run_prepared(t->bulk, 1);
        t->bulk_known = true;
    }
    return renewed;
}

// --- checkpoint ---

void pm_local_dynamics_record(pm_local_dynamics *t, pm_record *record) {
    if (t->solid != NULL) {
        pm_solid_dynamics_record(t->solid, record);
        return;
    }
    if (t->gap != NULL) {
        pm_contact_gap_record(t->gap, record);
    }
    pm_record_put_bool(record, "bulk known", &t->bulk_known);
    pm_record_put(record, "bulk z", t->bulk_z, t->nz);
    pm_record_put(record, "bulk dE", t->bulk_dE, t->nz);
    pm_record_put(record, "bulk dS", t->bulk_dS, t->nz);
    if (pm_record_restores(record) && t->bulk_known) {
        pm_program_run(t->bulk, 1);
    }
}

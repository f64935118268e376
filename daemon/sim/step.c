// The steps of the subsystems of one process. A round is three sweeps over all groups: bulk terms,
// ports, and then the next states with what they show.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/engine.h"
#include "sim/step_controller.h"

struct pm_local_subsystems {
    pm_model model;
    pm_data data;
};

// --- opening ---

pm_status pm_local_subsystems_open(pm_local_subsystems **local, const pm_system *system, int count,
                                   const int *id) {
    const pm_physics *physics = &system->scene->physics;
    pm_local_subsystems *l = NULL;
    PM_TRY(PM_NEW(l, "the subsystems of a process"));
    pm_arena *arena = &l->model.arena;
    const int n = id == NULL ? physics->nsubsystem : count;
    double *z = pm_arena_array(arena, (size_t)physics->nz, sizeof *z);
    int *all = pm_arena_array(arena, id == NULL ? (size_t)n : 0, sizeof *all);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(arena, "the subsystems of a process"));
    for (int i = 0; i < n && id == NULL; ++i) {
        all[i] = i;
    }
    PM_TRY_DONE(pm_model_open(&l->model, &l->data, system, n, id == NULL ? all : id));
    for (int i = 0; i < n; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[l->model.id[i]];
        if (s->initial != NULL) {
            memcpy(z + s->first, s->initial, (size_t)s->layout.nz * sizeof *z);
        }
    }
    pm_local_subsystems_set_state(l, z);
    *local = l;
    l = NULL;
done:
    pm_local_subsystems_close(l);
    return status;
}

void pm_local_subsystems_close(pm_local_subsystems *local) {
    if (local != NULL) {
        pm_model_close(&local->model);
        free(local);
    }
}

int pm_local_subsystems_nremote(const pm_local_subsystems *local) {
    return local->model.nremote;
}

pm_remote_end pm_local_subsystems_remote(const pm_local_subsystems *local, int remote) {
    return local->model.remote[remote].at;
}

// --- the start of a run ---

void pm_local_subsystems_set_boundary_input(pm_local_subsystems *local,
                                            const pm_boundary_input *boundary_input) {
    local->data.boundary_input = boundary_input;
}

void pm_local_subsystems_set_substeps(pm_local_subsystems *local, int substeps) {
    local->data.substeps = substeps;
    local->data.h = local->model.system->scene->physics.dt / substeps;
}

int pm_local_subsystems_most_rounds(const pm_local_subsystems *local) {
    const pm_physics *physics = &local->model.system->scene->physics;
    return pm_step_controller_most_substeps(physics) *
           pm_integrator_most_rounds(physics->integrator) *
           (pm_integrator_iterates(physics->integrator) ? (2 << PM_MOST_HALVINGS) - 1 : 1);
}

// Sets an array of `count` items to 0. An array without items may be NULL.
static void clear(void *array, size_t count, size_t size) {
    if (count > 0) {
        memset(array, 0, count * size);
    }
}

static void clear_flux(const pm_lane_flux *flux, int64_t lanes) {
    clear(flux->energy, 4 * (size_t)lanes, sizeof *flux->energy);
}

// Begins a run at d->z.
static void start(const pm_model *m, pm_data *d) {
    d->safe_z = d->z;
    d->before.begun = false;
    for (int i = 0; i < m->ngroup; ++i) { // the weights may have changed since the last run
        if (m->group[i].exposure != NULL) {
            pm_program_prepare(m->group[i].exposure);
        }
        if (m->group[i].bulk != NULL) {
            pm_program_prepare(m->group[i].bulk);
        }
        if (m->group[i].release != NULL) {
            pm_program_prepare(m->group[i].release);
        }
    }
    for (int i = 0; i < m->nport_group; ++i) {
        if (m->port_group[i].law != NULL) {
            pm_program_prepare(m->port_group[i].law);
        }
    }
    pm_expose_all(m, d, true);
    // All counts and fluxes are those of step 0.
    const size_t lanes = (size_t)m->own_lanes;
    d->exposure_calls = d->bulk_calls = d->port_calls = d->step = 0;
    clear(d->rested, lanes, sizeof *d->rested);
    clear(d->more_exposures, lanes, sizeof *d->more_exposures);
    clear(d->out_of_range, lanes, sizeof *d->out_of_range);
    clear(d->bulk_kept, (size_t)m->nblock, sizeof *d->bulk_kept);
    clear(d->port_kept, (size_t)m->nport_block, sizeof *d->port_kept);
    clear(d->port_rested, (size_t)m->port_lanes, sizeof *d->port_rested);
    clear(d->remote_flux, (size_t)m->nremote, sizeof *d->remote_flux);
    clear_flux(&d->bulk, m->own_lanes);
    clear_flux(&d->flux[0], m->port_lanes);
    clear_flux(&d->flux[1], m->port_lanes);
    if (d->error != NULL) {
        clear(d->error, lanes, sizeof *d->error);
        clear(d->length, PM_MAX_GROUPS * lanes, sizeof *d->length);
    }
    for (size_t l = 0; l < lanes && d->projection != NULL; ++l) {
        pm_invariant_projection_start(&d->projection[l], d->E[l], d->S[l]);
    }
}

// Puts the concatenated state z [scene->nz] into the blocks of d->z.
static void put_state(const pm_model *m, const pm_data *d, const double *z) {
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int lane = 0; lane < group->nblock * group->width; ++lane) {
            const int id = group->id[lane < group->count ? lane : group->count - 1];
            double *to = d->z + group->first + lane % group->width +
                         (ptrdiff_t)(lane / group->width) * group->nz * group->width;
            for (int c = 0; c < group->nz; ++c) {
                to[(ptrdiff_t)c * group->width] =
                    z[m->system->scene->physics.subsystem[id].first + c];
            }
        }
    }
}

void pm_local_subsystems_set_state(pm_local_subsystems *local, const double *z) {
    pm_data *d = &local->data;
    d->z = d->state[0];
    put_state(&local->model, d, z);
    start(&local->model, d);
}

void pm_local_subsystems_set_step(pm_local_subsystems *local, long step) {
    local->data.step = step;
    local->data.before.begun = false;
}

// --- a step that can be undone ---

// Puts into the serializer what the objects of kinds keep from one step to the next, and the
// irreversible rates from which the laws of ports predict.
static void put_objects(const pm_model *m, pm_serializer *serializer) {
    for (int i = 0; i < m->ngroup; ++i) {
        if (m->group[i].kind->serialize != NULL) {
            m->group[i].kind->serialize(&m->group[i], serializer);
        }
    }
    for (int i = 0; i < m->nport_group; ++i) {
        if (m->port_group[i].last != NULL) {
            pm_serializer_put(serializer, "irreversible rates", m->port_group[i].last,
                              m->port_group[i].nboth);
        }
    }
}

static void swap_fluxes(pm_data *d) {
    pm_lane_flux *const now[] = {&d->bulk, &d->flux[0], &d->flux[1]};
    pm_lane_flux *const before[] = {&d->before.bulk, &d->before.flux[0], &d->before.flux[1]};
    for (int i = 0; i < 3; ++i) {
        const pm_lane_flux flux = *now[i];
        *now[i] = *before[i];
        *before[i] = flux;
    }
}

// Saves what the coming step will overwrite, so that the step can be undone. Its fluxes are summed
// in a second set of arrays, which the first round of the step initialises.
static void begin_step(const pm_model *m, pm_data *d) {
    d->safe_z = d->z;
    d->before.begun = true;
    d->before.step = d->step;
    if (d->before.kept == NULL) {
        return;
    }
    d->before.exposures = d->exposure_calls;
    d->before.bulks = d->bulk_calls;
    d->before.ports = d->port_calls;
    memcpy(d->before.kept, d->before.now, d->before.size);
    const size_t ghosts = (size_t)(m->size - m->own_size);
    for (int i = PM_SHOWN_DE; ghosts > 0 && i < PM_SHOWN_COUNT && d->shown[i] != NULL; ++i) {
        memcpy(d->before.ghost[i], d->shown[i] + m->own_size, ghosts * sizeof *d->z);
    }
    pm_serializer objects = pm_serializer_save("objects", d->before.object);
    put_objects(m, &objects);
    swap_fluxes(d);
}

pm_status pm_local_subsystems_keep_steps(pm_local_subsystems *local) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    pm_arena *arena = &local->model.arena;
    pm_serializer objects = pm_serializer_count("objects");
    put_objects(m, &objects);
    d->before.object = pm_arena_array(arena, (size_t)objects.count, sizeof *d->before.object);
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        d->before.ghost[i] =
            pm_arena_array(arena, (size_t)(m->size - m->own_size), sizeof *d->before.ghost[i]);
    }
    PM_TRY(pm_lane_flux_new(&d->before.bulk, arena, (int)m->own_lanes));
    PM_TRY(pm_lane_flux_new(&d->before.flux[0], arena, (int)m->port_lanes));
    PM_TRY(pm_lane_flux_new(&d->before.flux[1], arena, (int)m->port_lanes));
    d->before.kept = pm_arena_alloc(arena, d->before.size);
    return pm_arena_status(arena, "the step before");
}

void pm_local_subsystems_undo_step(pm_local_subsystems *local) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    if (!d->before.begun) {
        return;
    }
    d->before.begun = false;
    d->z = d->safe_z;
    d->step = d->before.step;
    pm_expose_all(m, d, false);
    if (d->before.kept == NULL) {
        return;
    }
    d->exposure_calls = d->before.exposures;
    d->bulk_calls = d->before.bulks;
    d->port_calls = d->before.ports;
    clear(d->bulk_kept, (size_t)m->nblock, sizeof *d->bulk_kept);
    clear(d->port_kept, (size_t)m->nport_block, sizeof *d->port_kept);
    memcpy(d->before.now, d->before.kept, d->before.size);
    const size_t ghosts = (size_t)(m->size - m->own_size);
    for (int i = PM_SHOWN_DE; ghosts > 0 && i < PM_SHOWN_COUNT && d->shown[i] != NULL; ++i) {
        memcpy(d->shown[i] + m->own_size, d->before.ghost[i], ghosts * sizeof *d->z);
    }
    pm_serializer objects = pm_serializer_restore("objects", d->before.object);
    put_objects(m, &objects);
    swap_fluxes(d);
}

pm_status pm_local_subsystems_check_state(pm_local_subsystems *local, const double *z) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    pm_status status = PM_OK;
    // A step that jumps there and is then undone.
    begin_step(m, d);
    d->z = d->state[d->safe_z == d->state[0] ? 1 : 0];
    put_state(m, d, z);
    pm_expose_all(m, d, false);
    for (int i = 0; i < m->count && status == PM_OK; ++i) {
        const pm_scene_subsystem *subsystem = &m->system->scene->physics.subsystem[m->id[i]];
        const pm_address at = pm_model_address(m, m->id[i]);
        const double E = d->E[at.lane], S = d->S[at.lane], *dE = d->shown[PM_SHOWN_DE] + at.first;
        int c = 0;
        while (c < subsystem->layout.nz && isfinite(dE[c * at.step])) {
            ++c;
        }
        if (!isfinite(E) || !isfinite(S) || c < subsystem->layout.nz) {
            status =
                pm_fail(PM_ENUMERIC,
                        "subsystem %s: a run cannot begin in a state of the energy %g J, the "
                        "entropy %g J/K and the co-energy %g",
                        subsystem->name, E, S, dE[(c < subsystem->layout.nz ? c : 0) * at.step]);
        }
    }
    pm_local_subsystems_undo_step(local);
    return status;
}

// --- a round ---

bool pm_local_subsystems_completes_step(const pm_local_subsystems *local) {
    return local->data.substep == local->data.substeps;
}

pm_flux pm_local_subsystems_get_boundary(const pm_local_subsystems *local, int remote, double *y,
                                         double *e, double *eta, double *response, int64_t *known) {
    const pm_data *d = &local->data;
    const pm_remote *r = &local->model.remote[remote];
    const pm_scene_port *port = &local->model.system->scene->physics.port[r->at.port_id];
    double *const to[PM_SHOWN_COUNT] = {y, e, eta, response};
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        for (int c = 0; c < port->layout[r->at.end].nz && d->shown[i] != NULL; ++c) {
            to[i][c] = d->shown[i][r->own.first + port->component[r->at.end][c] * r->own.step];
        }
    }
    if (d->iteration != NULL) {
        *known = (int64_t)d->iteration[r->own.lane].known;
    }
    return d->remote_flux[remote];
}

// Returns the weight of the present round in the mean over a step.
static double round_weight(const pm_model *m, const pm_data *d) {
    const double weight = d->iteration != NULL ? d->iteration[0].last : m->integrator->b[d->stage];
    return ldexp(weight / d->substeps, -d->halvings);
}

void pm_local_subsystems_bulk(pm_local_subsystems *local) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    double *k = pm_stage_rates(m, d);
    const double weight = round_weight(m, d);
    if (!d->before.begun || d->before.step < d->step) {
        begin_step(m, d);
    }
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int block = 0; block < group->nblock; ++block) {
            group->kind->bulk(m, d, group, block, weight,
                              k + group->first + (ptrdiff_t)block * group->nz * group->width);
        }
    }
    memset(k + m->own_size, 0, (size_t)(m->size - m->own_size) * sizeof *k);
    ++d->bulk_calls;
}

void pm_local_subsystems_set_boundary(pm_local_subsystems *local, int remote,
                                      const pm_port_values *values) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    const pm_remote *r = &m->remote[remote];
    const int *component =
        m->system->scene->physics.port[r->at.port_id].component[1 - (int)r->at.end];
    const double *const from[PM_SHOWN_COUNT] = {values->y, values->e, values->eta,
                                                values->response};
    for (int c = 0; c < values->ny; ++c) {
        const int at = r->ghost.first + component[c];
        double *const to[PM_SHOWN_COUNT] = {
            &d->ghost_z[at - m->own_size], &d->shown[PM_SHOWN_DE][at], &d->shown[PM_SHOWN_DS][at],
            d->iteration != NULL ? &d->shown[PM_SHOWN_RESPONSE][at] : NULL};
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            if (to[i] != NULL && pm_renew(to[i], &from[i][c], 1)) {
                d->changed[i][r->ghost.lane] |= (uint64_t)1 << (component[c] & 63);
            }
        }
        d->shown[PM_SHOWN_Z][at] = values->y[c];
    }
    if (d->iteration != NULL) {
        pm_iteration_hear(&d->iteration[r->own.lane], values->known);
    }
}

void pm_local_subsystems_couple(pm_local_subsystems *local) {
    pm_couple(&local->model, &local->data, round_weight(&local->model, &local->data));
    ++local->data.port_calls;
}

void pm_local_subsystems_advance(pm_local_subsystems *local) {
    local->model.method->advance(&local->model, &local->data);
}

// --- the end of a step ---

// Checks a subsystem at the end of a step. A run ends before it publishes a state that is not
// finite or that its weights know nothing of. z [nz] is work space.
static pm_status check_subsystem(const pm_model *m, const pm_data *d, int id, double *z) {
    const pm_scene *scene = m->system->scene;
    const pm_scene_subsystem *subsystem = &scene->physics.subsystem[id];
    const pm_subsystem_group *group = &m->group[m->subsystem_at[id].group];
    const pm_address at = pm_model_address(m, id);
    const double E = d->E[at.lane], S = d->S[at.lane];
    if (group->kind->check != NULL) {
        PM_TRY(group->kind->check(m, group, d->step + 1));
    }
    for (int c = 0; c < group->nz; ++c) {
        z[c] = d->z[at.first + c * at.step];
    }
    for (int i = 0; i < subsystem->layout.ngroup; ++i) {
        const pm_group *variables = &subsystem->layout.group[i];
        for (int c = 0; c < variables->size; ++c) {
            if (!isfinite(z[variables->first + c])) {
                return pm_fail(PM_ENUMERIC,
                               "subsystem %s: %s[%d] became %g: the step is too long for this "
                               "state, or the state left what the weights were trained on; try a "
                               "smaller dt or more substeps",
                               subsystem->name, variables->name, c, z[variables->first + c]);
            }
        }
    }
    if (!isfinite(E) || !isfinite(S)) {
        return pm_fail(PM_ENUMERIC,
                       "subsystem %s: energy %g, entropy %g: the state left what the weights "
                       "were trained on",
                       subsystem->name, E, S);
    }
    const pm_departure departure = pm_training_range_departure(group->range, z);
    if (departure.widths > scene->run.largest_departure) {
        const char *bar = departure.group->size > 1 ? "|" : "";
        return pm_fail(PM_ENUMERIC,
                       "subsystem %s: step %ld: %s%s%s = %.4g %s, and its weights were trained on "
                       "%.4g to %.4g: train on a wider range, or widen the scene's guard",
                       subsystem->name, d->step + 1, bar, departure.group->name, bar,
                       departure.value, departure.group->unit, departure.low, departure.high);
    }
    return PM_OK;
}

pm_status pm_local_subsystems_end_step(pm_local_subsystems *local) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    // The failure of the first subsystem, in the scene's order, whose step has failed.
    pm_status status = PM_OK;
    for (int i = 0; i < m->count && d->doubtful && status == PM_OK; ++i) {
        status = check_subsystem(m, d, m->id[i], d->scratch);
    }
    const pm_scene_boundary_input *ending =
        status == PM_OK && d->boundary_input != NULL
            ? pm_boundary_input_ending(d->boundary_input, d->step)
            : NULL;
    if (ending != NULL) {
        status = pm_fail(PM_EDATA,
                         "boundary input %s: the trajectory that it follows ends after %ld steps: "
                         "take fewer steps, or a longer trajectory",
                         ending->name, d->boundary_input->end);
    }
    if (status == PM_OK && d->unsolved > 0) {
        int i = 0;
        while (m->subsystem_at[m->id[i]].group != d->unsolved_group) {
            ++i;
        }
        status =
            pm_fail(PM_ENUMERIC,
                    "subsystem %s: step %ld: the iteration does not converge in pieces of "
                    "%.3g s: the step is too long for this state; try a smaller dt or more "
                    "substeps",
                    m->system->scene->physics.subsystem[m->id[i]].name, d->step + 1, d->unsolved);
    }
    if (status != PM_OK) {
        pm_local_subsystems_undo_step(local);
        return status;
    }
    for (int i = 0; i < m->nremote; ++i) {
        const pm_remote_end at = m->remote[i].at;
        const pm_member place = m->port_at[at.port_id][at.end];
        d->remote_flux[i] = pm_lane_flux_at(
            &d->flux[at.end], (int)m->port_group[place.group].first_lane + place.lane);
    }
    d->substep = 0;
    d->doubtful = false;
    d->unsolved = 0;
    ++d->step;
    return PM_OK;
}

// --- results ---

// Returns the lane of an end of a port in arrays of one number for each port.
static int port_lane(const pm_model *m, int port, int end) {
    const pm_member at = m->port_at[port][end];
    return (int)m->port_group[at.group].first_lane + at.lane;
}

pm_books pm_local_subsystems_books(const pm_local_subsystems *local, int i) {
    const pm_model *m = &local->model;
    const pm_data *d = &local->data;
    const pm_physics *physics = &m->system->scene->physics;
    const int id = m->id[i], nport = physics->first_end[id + 1] - physics->first_end[id];
    const int *end_at = physics->end_at + physics->first_end[id];
    const int lane = pm_model_address(m, id).lane;
    const pm_subsystem_group *group = &m->group[m->subsystem_at[id].group];
    const long exposures = d->exposure_calls + d->more_exposures[lane];
    long calls = exposures + d->bulk_calls, evaluated = exposures - d->rested[lane];
    evaluated += group->bulk == NULL ? 0 : d->bulk_calls;
    int nflux = nport;
    for (int k = 0; k < nport; ++k) {
        const int port = end_at[k] / 2, end = end_at[k] % 2, at = port_lane(m, port, end);
        d->books[k] = pm_lane_flux_at(&d->flux[end], at);
        if (physics->port[port].subsystem[1 - end] < 0) {
            d->books[nflux++] = pm_lane_flux_at(&d->flux[1 - end], at);
        }
        calls += d->port_calls;
        evaluated += d->port_calls - d->port_rested[at];
    }
    return (pm_books){.energy = d->E[lane],
                      .entropy = d->S[lane],
                      .bulk = pm_lane_flux_at(&d->bulk, lane),
                      .evaluated = evaluated,
                      .skipped = calls - evaluated,
                      .outside = d->out_of_range[lane],
                      .substeps = d->substeps,
                      .error = d->error == NULL ? 0 : d->error[lane],
                      .nflux = nflux,
                      .flux = d->books};
}

void pm_local_subsystems_state(const pm_local_subsystems *local, int i, double *z) {
    const int id = local->model.id[i];
    const pm_address at = pm_model_address(&local->model, id);
    const int nz = local->model.system->scene->physics.subsystem[id].layout.nz;
    for (int c = 0; c < nz; ++c) {
        z[c] = local->data.z[at.first + c * at.step];
    }
}

void pm_local_subsystems_efforts(pm_local_subsystems *local, double *dE, double *reaction) {
    const pm_model *m = &local->model;
    const pm_data *d = &local->data;
    const pm_physics *physics = &m->system->scene->physics;
    for (int i = 0; i < m->count; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[m->id[i]];
        const pm_address at = pm_model_address(m, m->id[i]);
        for (int c = 0; c < s->layout.nz; ++c) {
            dE[s->first + c] = d->shown[PM_SHOWN_DE][at.first + c * at.step];
        }
    }
    if (reaction == NULL) {
        return;
    }
    // The first round of a step, which is then undone.
    pm_local_subsystems_bulk(local);
    pm_local_subsystems_couple(local);
    const double *k = pm_stage_rates(m, d);
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *input = &physics->boundary_input[i];
        const pm_address at = m->input_ghost[i];
        for (int c = 0; c < input->layout.nz; ++c) {
            reaction[input->first / 3 + c] = at.step == 0 ? 0 : k[at.first + c * at.step];
        }
    }
    pm_local_subsystems_undo_step(local);
}

void pm_local_subsystems_take_fluxes(pm_local_subsystems *local, const pm_local_subsystems *from) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    const struct {
        double *to;
        const double *from;
        int64_t lanes;
    } all[] = {{d->bulk.energy, from->data.bulk.energy, m->own_lanes},
               {d->flux[0].energy, from->data.flux[0].energy, m->port_lanes},
               {d->flux[1].energy, from->data.flux[1].energy, m->port_lanes}};
    for (int i = 0; i < 3; ++i) { // each is one array of four numbers for each lane
        if (all[i].lanes > 0) {
            memcpy(all[i].to, all[i].from, 4 * (size_t)all[i].lanes * sizeof *all[i].to);
        }
    }
}

void pm_local_subsystems_fill_sample(const pm_local_subsystems *local, int count,
                                     pm_sample *sample) {
    const pm_physics *physics = &local->model.system->scene->physics;
    for (int i = 0; i < count && i < local->model.count; ++i) {
        const int id = local->model.id[i], *end_at = physics->end_at + physics->first_end[id];
        const pm_books books = pm_local_subsystems_books(local, i);
        int outside = physics->first_end[id + 1] - physics->first_end[id];
        pm_sample_set_books(sample, id, &books);
        pm_local_subsystems_state(local, i, sample->z + physics->subsystem[id].first);
        for (int k = 0; k < physics->first_end[id + 1] - physics->first_end[id]; ++k) {
            const int port = end_at[k] / 2, end = end_at[k] % 2;
            sample->flux[port][end] = books.flux[k];
            if (physics->port[port].subsystem[1 - end] < 0) {
                sample->flux[port][1 - end] = books.flux[outside++];
            }
        }
    }
}

static void add_counts(pm_tally *tally, long calls, long evaluated) {
    tally->evaluated += (double)evaluated;
    tally->skipped += (double)(calls - evaluated);
}

static void tally_subsystems(const pm_model *m, const pm_data *d, const pm_subsystem_group *group,
                             pm_tally *tally) {
    const int64_t first = group->first_lane;
    const pm_lane_flux bulk = pm_lane_flux_from(&d->bulk, first);
    long more = 0, rested = 0, outside = 0;
    for (int l = 0; l < group->count; ++l) {
        more += d->more_exposures[first + l];
        rested += d->rested[first + l];
        outside += d->out_of_range[first + l];
    }
    const long exposures = group->count * d->exposure_calls + more;
    const long bulk_terms = group->count * d->bulk_calls;
    pm_tally_add_content(tally, group->count, d->E + first, d->S + first);
    pm_tally_add_fluxes(tally, pm_tally_form_of_subsystem(m->system, group->id[0]), group->count,
                        m->system->scene->physics.nport, group->id, &bulk, NULL);
    add_counts(tally, exposures + bulk_terms,
               exposures + (group->bulk == NULL ? 0 : bulk_terms) - rested);
    for (int l = 0; l < group->count && outside > 0; ++l) {
        pm_tally_add_counts(tally, group->id[l], 0, 0, d->out_of_range[first + l]);
    }
}

// Adds the ports of a group that are inner ones, as many at a time as follow each other. A port
// counts for each subsystem here at its ends. A law that is evaluated end by end has its fluxes in
// two groups; that of end A adds them.
static void tally_ports(const pm_model *m, const pm_data *d, const pm_port_group *group,
                        pm_tally *tally) {
    const pm_scene_port *port = m->system->scene->physics.port;
    const bool both = group->end[0].computed && group->end[1].computed;
    const int form = pm_tally_form_of_port(m->system, group->id[0]);
    if (group->inner) {
        const pm_lane_flux a = pm_lane_flux_from(&d->flux[0], group->first_lane);
        const pm_lane_flux b = pm_lane_flux_from(&d->flux[1], group->first_lane);
        const long calls = group->count * d->port_calls;
        long rested = 0;
        for (int l = 0; l < group->count; ++l) {
            rested += d->port_rested[group->first_lane + l];
        }
        pm_tally_add_fluxes(tally, form, group->count, 0, group->id, &a, &b);
        add_counts(tally, 2 * calls, 2 * (calls - rested));
        return;
    }
    int begin = 0;
    for (int l = 0; l <= group->count; ++l) {
        // Whether both ends of the port are at subsystems here.
        const int *at = l < group->count ? port[group->id[l]].subsystem : NULL;
        const bool inner = at != NULL && at[0] >= 0 && at[1] >= 0 &&
                           m->subsystem_at[at[0]].group != PM_NOWHERE &&
                           m->subsystem_at[at[1]].group != PM_NOWHERE;
        if (l < group->count) {
            const long ends = both && inner ? 2 : 1;
            add_counts(tally, ends * d->port_calls,
                       ends * (d->port_calls - d->port_rested[group->first_lane + l]));
        }
        if (inner && both) {
            continue;
        }
        if (begin < l) {
            const pm_lane_flux a = pm_lane_flux_from(&d->flux[0], group->first_lane + begin);
            const pm_lane_flux b = pm_lane_flux_from(&d->flux[1], group->first_lane + begin);
            pm_tally_add_fluxes(tally, form, l - begin, 0, group->id + begin, &a, &b);
        }
        begin = l + 1;
        if (inner && group->end[0].computed) {
            const int id = group->id[l];
            const pm_lane_flux a = pm_lane_flux_from(&d->flux[0], port_lane(m, id, 0));
            const pm_lane_flux b = pm_lane_flux_from(&d->flux[1], port_lane(m, id, 1));
            pm_tally_add_fluxes(tally, form, 1, id, NULL, &a, &b);
        }
    }
}

void pm_local_subsystems_tally(const pm_local_subsystems *local, pm_tally *tally) {
    const pm_model *m = &local->model;
    for (int i = 0; i < m->ngroup; ++i) {
        tally_subsystems(m, &local->data, &m->group[i], tally);
    }
    for (int i = 0; i < m->nport_group; ++i) {
        tally_ports(m, &local->data, &m->port_group[i], tally);
    }
}

// --- checkpoints ---

// Puts 64 bits each as two whole numbers, which a double holds exactly.
static void put_changed(pm_data *d, pm_serializer *serializer, int64_t lane) {
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        uint64_t *bits = &d->changed[i][lane];
        long low = (long)(*bits & UINT32_MAX), high = (long)(*bits >> 32);
        pm_serializer_put_long(serializer, "changed", &low);
        pm_serializer_put_long(serializer, "changed", &high);
        *bits = (uint64_t)low | (uint64_t)high << 32;
    }
}

// Serializes what does not follow from the state of a subsystem: how it was exposed, its counts,
// and what its kind keeps. Co-energies, potentials and rates follow from the state.
static void put_subsystem(const pm_model *m, pm_data *d, int id, pm_serializer *serializer) {
    const pm_subsystem_group *group = &m->group[m->subsystem_at[id].group];
    const int lane = pm_model_address(m, id).lane;
    pm_serializer_put_long(serializer, "rested", &d->rested[lane]);
    pm_serializer_put_long(serializer, "more exposures", &d->more_exposures[lane]);
    pm_serializer_put_long(serializer, "out of range", &d->out_of_range[lane]);
    put_changed(d, serializer, lane);
    if (d->projection != NULL) {
        pm_serializer_put(serializer, "projected energy", &d->projection[lane].energy, 1);
        pm_serializer_put(serializer, "projected entropy", &d->projection[lane].entropy, 1);
    }
    for (int i = 0; i < PM_MAX_GROUPS && d->length != NULL; ++i) {
        pm_serializer_put(serializer, "length", &d->length[i * m->own_lanes + lane], 1);
    }
    if (group->kind->serialize != NULL) {
        group->kind->serialize(group, serializer);
    }
}

void pm_local_subsystems_record(pm_local_subsystems *local, pm_serializer *serializer) {
    const pm_model *m = &local->model;
    pm_data *d = &local->data;
    const int nghost = (int)(m->size - m->own_size);
    if (pm_serializer_restores(serializer)) {
        d->z = d->state[0];
    }
    for (int i = 0; i < m->count; ++i) {
        const pm_address at = pm_model_address(m, m->id[i]);
        const int nz = m->system->scene->physics.subsystem[m->id[i]].layout.nz;
        for (int c = 0; c < nz; ++c) {
            pm_serializer_put(serializer, "z", &d->z[at.first + c * at.step], 1);
        }
    }
    if (pm_serializer_restores(serializer)) {
        start(m, d); // the numbers below replace what it counts
    }
    pm_serializer_put_long(serializer, "step", &d->step);
    pm_serializer_put_long(serializer, "exposures", &d->exposure_calls);
    pm_serializer_put_long(serializer, "bulk terms", &d->bulk_calls);
    pm_serializer_put_long(serializer, "laws", &d->port_calls);
    for (int i = 0; i < m->count; ++i) {
        put_subsystem(m, d, m->id[i], serializer);
    }
    for (int i = 0; i < m->nport_group; ++i) {
        const pm_port_group *group = &m->port_group[i];
        for (int lane = 0; lane < group->count; ++lane) {
            pm_serializer_put_long(serializer, "rested", &d->port_rested[group->first_lane + lane]);
        }
        if (group->last != NULL) {
            pm_serializer_put(serializer, "irreversible rates", group->last, group->nboth);
        }
    }
    pm_serializer_put(serializer, "ghost z", d->ghost_z, nghost);
    for (int i = PM_SHOWN_DE; i < PM_SHOWN_COUNT; ++i) {
        pm_serializer_put(serializer, "ghost",
                          d->shown[i] == NULL ? NULL : d->shown[i] + m->own_size,
                          d->shown[i] == NULL ? 0 : nghost);
    }
    for (int64_t lane = m->own_lanes; lane < m->lanes; ++lane) {
        put_changed(d, serializer, lane);
    }
    for (int i = 0; i < m->nremote; ++i) {
        pm_serializer_put(serializer, "energy flux", &d->remote_flux[i].energy, 1);
        pm_serializer_put(serializer, "entropy flux", &d->remote_flux[i].entropy, 1);
    }
}

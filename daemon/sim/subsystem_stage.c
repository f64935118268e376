// The stages of one subsystem: three kinds of graph (exposure, bulk, one per port) around the state
// of a Runge-Kutta method.
#include <assert.h>
#include <math.h>

#include "sim/flux.h"
#include "sim/subsystem_parts.h"

// The most Newton steps of the projection onto energy and entropy. After the first one the residual
// is about the square of the method's error.
#define MOST_MOVES 3

// --- one round ---

void pm_subsystem_show(pm_subsystem *s, pm_exposure exposure) {
    s->exposed = true;
    s->booking.evaluated += exposure == PM_EXPOSURE_EVALUATED;
    s->booking.skipped += exposure != PM_EXPOSURE_EVALUATED;
    // The ports already show the values of the same state. This does not hold for a multirate
    // integrator: it also exposes within its own substeps, of which the ports show nothing.
    if (exposure == PM_EXPOSURE_SAME && !s->integrator->multirate) {
        return;
    }
    for (int c = 0; c < s->nz; ++c) {
        s->at_z[c] = s->integrator->discrete ? 0.5 * (s->z[c] + s->stage_z[c]) : s->stage_z[c];
    }
    for (int i = 0; i < s->nport; ++i) {
        pm_port_instance_expose(&s->port[i], s->at_z, s->dynamics.dE, s->dynamics.dS,
                                s->dynamics.response);
    }
}

// Returns the rate of a stage [nz]. Of an iteration only the last one is kept.
static double *rate_at(const pm_subsystem *s, int stage) {
    return s->k + (s->integrator->discrete ? 0 : (ptrdiff_t)stage * s->nz);
}

void pm_subsystem_expose(pm_subsystem *s) {
    if (!s->exposed) {
        // The rate of the previous stage is an estimate of dz/dt. The first stage of a step was
        // exposed at the end of the previous step.
        const int before = (s->stage == 0 ? s->integrator->nstage : s->stage) - 1;
        const double *rate = rate_at(s, before);
        pm_subsystem_show(s, pm_local_dynamics_expose(&s->dynamics, s->stage_z, s->z, rate));
    }
    for (int i = 0; i < s->nport; ++i) {
        s->port[i].own.shown.known = s->iteration.known;
    }
}

// Returns the weight of the present stage in the mean over a step.
static double stage_weight(const pm_subsystem *s) {
    const double weight = s->integrator->discrete ? s->iteration.last : s->integrator->b[s->stage];
    return weight / s->substeps;
}

// Books the heat of a solid or of a gap, which take their steps in pm_subsystem_advance. `entropy`
// is the component of the entropy.
static void book_heat(pm_subsystem *s, int entropy, double temperature) {
    const double production = stage_weight(s) * (s->stage_z[entropy] - s->z[entropy]) / s->h;
    s->booking.bulk.entropy += production;
    s->booking.bulk.entropy_gross += production;
    s->booking.bulk.energy_gross += temperature * production;
}

void pm_subsystem_bulk(pm_subsystem *s) {
    double *k = rate_at(s, s->stage);
    if (s->dynamics.solid != NULL) {
        memset(k, 0, (size_t)s->nz * sizeof *k);
        memset(s->dynamics.solid->end_rate, 0, (size_t)s->nz * sizeof *k);
        book_heat(s, s->dynamics.solid->s, s->dynamics.solid->temperature);
        return;
    }
    if (s->dynamics.gap != NULL) {
        memset(k, 0, (size_t)s->nz * sizeof *k);
        book_heat(s, s->dynamics.gap->s, s->dynamics.gap->temperature);
        return;
    }
    if (s->dynamics.bulk == NULL || s->integrator->multirate) {
        memset(k, 0, (size_t)s->nz * sizeof *k);
        s->booking.skipped += !s->integrator->multirate;
        return;
    }
    const bool renewed = pm_local_dynamics_evaluate_bulk(&s->dynamics, s->at_z);
    memcpy(k, s->dynamics.bulk_rate, (size_t)s->nz * sizeof *k);
    pm_flux_book(&s->booking.bulk, stage_weight(s), s->nz, s->dynamics.dE, s->dynamics.dS, k);
    s->booking.evaluated += renewed;
    s->booking.skipped += !renewed;
}

// Returns what the boundary input shows at its end of a port, at this share of the substep.
static const pm_port_values *prescribe(pm_subsystem *s, pm_port_instance *j, double share) {
    assert(s->boundary_input != NULL);
    pm_boundary_input_at(s->boundary_input, s->step, (s->substep + share) / s->substeps,
                         s->prescribed);
    return pm_port_instance_prescribe(j, s->prescribed);
}

// Does the same for the mean of the values at both ends of the substep.
static const pm_port_values *prescribe_mean(pm_subsystem *s, pm_port_instance *j) {
    const int n = s->system->scene->nprescribed;
    double *start = s->prescribed + n;
    prescribe(s, j, 0);
    memcpy(start, s->prescribed, (size_t)n * sizeof *start);
    prescribe(s, j, 1);
    for (int i = 0; i < n; ++i) {
        s->prescribed[i] = (s->prescribed[i] + start[i]) / 2;
    }
    return pm_port_instance_prescribe(j, s->prescribed);
}

void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour) {
    pm_port_instance *j = &s->port[port];
    const pm_port_values *other = neighbour;
    const bool first = s->stage == 0;
    if (j->boundary_input == NULL) {
        pm_iteration_hear(&s->iteration, neighbour->known);
    } else if (s->dynamics.solid == NULL) {
        other = prescribe(s, j, pm_integrator_time(s->integrator, s->stage));
    }
    if (s->dynamics.solid != NULL) {
        other = j->boundary_input == NULL ? pm_port_instance_end_values(j, neighbour)
                                          : prescribe(s, j, 1);
        pm_port_instance_couple(j, other, first, 0, s->dynamics.solid->end_rate);
        other = j->boundary_input == NULL ? neighbour : prescribe_mean(s, j);
    }
    const bool done =
        pm_port_instance_couple(j, other, first, stage_weight(s), rate_at(s, s->stage));
    s->booking.evaluated += done;
    s->booking.skipped += !done;
}

// to = z + h sum_i weight_i k_i over the first n stages.
static void combine(const pm_subsystem *s, int n, const double *weight, double *to) {
    for (int c = 0; c < s->nz; ++c) {
        double sum = 0;
        for (int i = 0; i < n; ++i) {
            sum += weight[i] * s->k[(ptrdiff_t)i * s->nz + c];
        }
        to[c] = s->z[c] + s->h * sum;
    }
}

static double length_of(const pm_group *group, const double *z) {
    double square = 0;
    for (int c = group->first; c < group->first + group->size; ++c) {
        square += z[c] * z[c];
    }
    return sqrt(square);
}

// Estimates the error of the substep, group by group, relative to the largest length that the group
// has had, and keeps the largest.
static void estimate_error(pm_subsystem *s) {
    const pm_layout *layout = &s->scene->layout;
    for (int c = 0; c < s->nz; ++c) {
        s->error[c] = 0;
        for (int i = 0; i < s->integrator->nstage; ++i) {
            s->error[c] += s->h * s->integrator->error_weights[i] * s->k[(ptrdiff_t)i * s->nz + c];
        }
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        s->size[i] = fmax(s->size[i], length_of(group, s->z));
        const double error = length_of(group, s->error);
        s->booking.error = fmax(s->booking.error, s->size[i] > 0 ? error / s->size[i] : 0);
    }
}

// Adds the energy and entropy that flow at the present stage to the totals of the projection.
static void book_projection(pm_subsystem *s) {
    pm_invariant_projection_book(&s->projection, s->stage == 0, s->h * s->integrator->b[s->stage],
                                 s->nz, s->dynamics.dE, s->dynamics.dS,
                                 s->k + (ptrdiff_t)s->stage * s->nz);
}

// Moves the new state to the energy and entropy that follow from the fluxes. The next stage reuses
// the last exposure.
static void project(pm_subsystem *s) {
    for (int i = 0; i < MOST_MOVES; ++i) {
        pm_subsystem_expose(s);
        if (!pm_invariant_projection_move(&s->projection, &s->scene->layout, s->z, s->dynamics.E[0],
                                          pm_subsystem_value_at(s->dynamics.S, 0), s->dynamics.dE,
                                          s->dynamics.dS, s->stage_z)) {
            return;
        }
        s->exposed = false;
    }
}

// Ends a substep.
static void end_substep(pm_subsystem *s) {
    pm_subsystem_copy(s->z, s->stage_z, s->nz);
    if (s->dynamics.solid != NULL) {
        pm_solid_dynamics_end_substep(s->dynamics.solid);
    }
    pm_local_dynamics_begin(&s->dynamics, s->z);
    s->stage = 0;
    ++s->substep;
}

// Returns true if the present iterate of a solid, which has just been computed, is the last one.
static bool stands_still(const pm_subsystem *s) {
    return s->dynamics.solid != NULL && s->stage > 0 && !s->dynamics.solid->changed;
}

// Replaces the present iterate of the new state by the next one. s->error becomes their difference.
static void find_next(pm_subsystem *s) {
    const double *next = s->dynamics.solid != NULL ? s->dynamics.solid->result : s->next;
    if (s->dynamics.solid == NULL) {
        for (int c = 0; c < s->nz; ++c) {
            s->next[c] = s->z[c] + s->h * s->k[c];
        }
    }
    if (s->dynamics.gap != NULL) {
        pm_contact_gap_next(s->dynamics.gap, s->stage_z, s->next, s->error);
        memcpy(s->next, s->error, (size_t)s->nz * sizeof *s->next);
    }
    for (int c = 0; c < s->nz; ++c) {
        s->error[c] = next[c] - s->stage_z[c];
        s->stage_z[c] = next[c];
    }
}

// Returns the change s->error of the iterate: that of the group that changes most, relative to the
// group's length.
static double change_of_iterate(pm_subsystem *s) {
    const pm_layout *layout = &s->scene->layout;
    double change = 0;
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const double size = fmax(length_of(group, s->z), length_of(group, s->stage_z));
        change = fmax(change, size > 0 ? length_of(group, s->error) / size : 0);
    }
    return s->dynamics.gap == NULL ? change : pm_contact_gap_change(s->dynamics.gap, change);
}

// Computes the next iterate of the new state. Ends the substep after the last iteration.
static void iterate(pm_subsystem *s) {
    if (s->dynamics.solid != NULL) {
        pm_solid_dynamics_balance(s->dynamics.solid, s->h, s->z, s->k);
    }
    const bool still = stands_still(s); // as in every second round in contact
    double change = 0;
    if (!still) {
        find_next(s);
        change = change_of_iterate(s);
    }
    s->exposed = still;
    const int left = s->integrator->most_iterations - ++s->stage;
    if (pm_iteration_end_round(&s->iteration, change, s->system->scene->diameter, left)) {
        end_substep(s);
        s->exposed = false;
        pm_iteration_start(&s->iteration);
    }
}

// Computes the state at the next stage, or after the last one the state after the substep.
static void reach_next_stage(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    if (rk->multirate) {
        const pm_multirate_books books = {&s->booking.bulk, &s->booking.evaluated,
                                          &s->booking.skipped,
                                          rk->balanced ? &s->projection : NULL};
        pm_multirate_advance(&s->multirate, &s->dynamics, s->stage, s->h, 1.0 / s->substeps, s->k,
                             &books, s->stage_z);
    } else if (s->stage + 1 < rk->nstage) {
        combine(s, s->stage + 1, rk->a[s->stage + 1], s->stage_z);
    } else {
        combine(s, rk->nstage, rk->b, s->stage_z);
    }
}

void pm_subsystem_advance(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    if (rk->discrete) {
        iterate(s);
        return;
    }
    if (rk->balanced) {
        book_projection(s);
    }
    reach_next_stage(s);
    s->exposed = false;
    if (++s->stage < rk->nstage) {
        return;
    }
    if (s->system->scene->tolerance > 0) {
        estimate_error(s);
    }
    if (rk->balanced) {
        project(s);
    }
    end_substep(s);
}

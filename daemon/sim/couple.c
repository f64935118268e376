// The ports of one process: a law is evaluated for a block of ports in one run, for both ends.
#include <assert.h>
#include <math.h>
#include <string.h>

#include "sim/engine.h"

// --- boundary inputs ---

// Computes the values of all boundary inputs after a share (0 to 1) of the substep.
static void prescribe_at(const pm_data *d, double share, double *value) {
    assert(d->boundary_input != NULL);
    pm_boundary_input_at(d->boundary_input, d->step,
                         (d->substep + ldexp(d->piece + share, -d->halvings)) / d->substeps, value);
}

// Lets the ghosts of all boundary inputs show d->prescribed: the state, dE and dS.
static void show_inputs(const pm_model *m, pm_data *d) {
    const pm_physics *physics = &m->system->scene->physics;
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *input = &physics->boundary_input[i];
        const int nz = input->layout.nz, first = m->input_ghost[i].first;
        const double *value = d->prescribed + input->first;
        if (m->input_ghost[i].step == 0) {
            continue;
        }
        for (int c = 0; c < nz; ++c) {
            const uint64_t bit = (uint64_t)1 << (c & 63);
            double *const before[] = {&d->ghost_z[first - m->own_size + c],
                                      &d->shown[PM_SHOWN_DE][first + c],
                                      &d->shown[PM_SHOWN_DS][first + c]};
            for (int s = 0; s < 3; ++s) {
                if (pm_renew(before[s], &value[s * nz + c], 1)) {
                    d->changed[s][m->input_ghost[i].lane] |= bit;
                }
            }
            d->shown[PM_SHOWN_Z][first + c] = value[c];
        }
    }
}

static void prescribe(const pm_model *m, pm_data *d, double share) {
    prescribe_at(d, share, d->prescribed);
    show_inputs(m, d);
}

// --- laws ---

// Returns the places of the subsystems at one end of the ports of a block.
static pm_lane_places places_of(const pm_port_group_end *end, int lane) {
    const pm_lane_places *all = &end->place;
    return (pm_lane_places){all->row + lane / PM_LANES, all->first + lane, all->step + lane,
                            all->lane + lane};
}

// Takes what both ends of a block show, and notes in which lanes an input of the law has changed.
// `end_rates_of` is the end whose rates at the end of the substep are wanted; -1: those of the
// stage are.
static void gather(const pm_data *d, const pm_port_group *group, int lane, int end_rates_of,
                   uint64_t *changed) {
    for (int e = 0; e < 2; ++e) {
        const pm_port_group_end *end = &group->end[e];
        const pm_lane_places places = places_of(end, lane);
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            if (end->shown[i] == NULL) {
                continue;
            }
            const bool responds =
                i == PM_SHOWN_DE && end_rates_of == 1 - e && group->joins_gaps && !group->outside;
            pm_lanes_gather(end->ny, group->width, end->component, &places,
                            d->shown[responds ? PM_SHOWN_RESPONSE : i], end->shown[i]);
            if (end->is_input[i]) {
                pm_lanes_gather_renewed(group->width, &places, d->changed[i], end->wanted, changed);
            }
        }
    }
    // The prediction starts from zero in the first round of a substep, and later from the result of
    // the round before.
    if (group->last != NULL && d->stage > 0) {
        changed[0] |= pm_renew(group->last, group->next, group->nboth);
    }
    for (int i = 0; i < group->nboth && group->last != NULL && d->stage == 0; ++i) {
        changed[0] |= group->last[i] != 0;
        group->last[i] = 0;
    }
}

// Adds the law's rates at the end of the substep to d->end_k of one end.
static void add_end_rates(const pm_model *m, pm_data *d, const pm_port_group *group, int e) {
    uint64_t changed[1] = {0};
    const pm_port_group_end *end = &group->end[e];
    const pm_lane_places places = places_of(end, 0);
    if (group->outside) {
        prescribe(m, d, 1);
    }
    gather(d, group, 0, e, changed);
    pm_program_run_prepared(group->law, 1);
    if (end->law_rate != NULL) {
        pm_lanes_add(end->ny, 1, end->component, &places, 0, 1, end->law_rate, d->end_k);
    }
    if (group->outside) {
        // The ports book the mean of the values at both ends of the substep.
        const int n = m->system->scene->physics.nprescribed;
        double *start = d->prescribed + n;
        prescribe_at(d, 0, start);
        prescribe_at(d, 1, d->prescribed);
        for (int i = 0; i < n; ++i) {
            d->prescribed[i] = (d->prescribed[i] + start[i]) / 2;
        }
        show_inputs(m, d);
    }
}

// Evaluates the law of a block unless its rates are known from a time with the same inputs, or
// `anew` demands it. The only block of a group finds its last rates in the program. Blocks of one
// port keep them; others do so from the first time on at which they rest, as copies of many ports
// take time.
static void run_block(const pm_model *m, pm_data *d, const pm_port_group *group, int block,
                      bool anew) {
    const int width = group->width, lane = block * width;
    uint64_t changed[PM_MOST_LANES];
    memset(changed, 0, (size_t)width * sizeof *changed);
    gather(d, group, lane, -1, changed);
    const bool any = pm_lanes_any(width, changed);
    bool *kept = &d->port_kept[group->first_block + block];
    if (!pm_lanes_all(width, changed)) {
        for (int l = 0; l < width; ++l) {
            d->port_rested[group->first_lane + lane + l] += changed[l] == 0;
        }
    }
    const bool runs = any || !*kept || anew;
    if (runs) {
        pm_program_run_prepared(group->law, width);
    }
    *kept = !any || !m->ordered || group->nblock == 1 || width == 1;
    for (int e = 0; e < 2 && runs && *kept && group->nblock > 1; ++e) {
        const pm_port_group_end *end = &group->end[e];
        const ptrdiff_t size = (ptrdiff_t)end->ny * width;
        if (end->law_rate != NULL) {
            memcpy(d->port_rate + end->first_rate + block * size, end->law_rate,
                   (size_t)size * sizeof(double));
        }
    }
}

// Returns the rates of one end of a block after run_block.
static const double *rate_of(const pm_data *d, const pm_port_group *group,
                             const pm_port_group_end *end, int block) {
    return group->nblock > 1 && d->port_kept[group->first_block + block]
               ? d->port_rate + end->first_rate + (ptrdiff_t)block * end->ny * group->width
               : end->law_rate;
}

// Adds the rates of one end of a block to k, for the lanes from number `begin` to number `last` - 1
// of the block.
static void add_end(const pm_data *d, const pm_port_group *group, int e, int block, int begin,
                    int last, double *k) {
    const pm_port_group_end *end = &group->end[e];
    if (end->law_rate != NULL) {
        const pm_lane_places places = places_of(end, block * group->width);
        pm_lanes_add(end->ny, group->width, end->component, &places, begin, last,
                     rate_of(d, group, end, block), k);
    }
}

static void add_block(const pm_data *d, const pm_port_group *group, int block, double *k) {
    const int left = group->count - block * group->width;
    const int used = left < group->width ? left : group->width;
    if (group->order[block] == PM_ORDER_PORT_BY_PORT) {
        for (int l = 0; l < used; ++l) {
            add_end(d, group, 0, block, l, l + 1, k);
            add_end(d, group, 1, block, l, l + 1, k);
        }
        return;
    }
    const int first = group->order[block] == PM_ORDER_A_FIRST ? 0 : 1;
    add_end(d, group, first, block, 0, used, k);
    add_end(d, group, 1 - first, block, 0, used, k);
}

void pm_couple(const pm_model *m, pm_data *d, double weight) {
    double *k = pm_stage_rates(m, d);
    const bool first = pm_is_first_round(d), books = first || weight != 0;
    bool prescribed = false; // the boundary inputs show the values of this stage
    // The subsystems at both ends of a port exchange what they know of the convergence of all.
    for (int i = 0; i < m->njoint && d->iteration != NULL; ++i) {
        const int *id = m->system->scene->physics.port[m->joint[i]].subsystem;
        const int64_t a = id[0] < 0 ? m->own_lanes : pm_model_address(m, id[0]).lane;
        const int64_t b = id[1] < 0 ? m->own_lanes : pm_model_address(m, id[1]).lane;
        if (a < m->own_lanes && b < m->own_lanes) {
            pm_iteration_hear(&d->iteration[a], d->iteration[b].known);
            pm_iteration_hear(&d->iteration[b], d->iteration[a].known);
        }
    }
    for (int i = 0; i < m->nport_group; ++i) {
        const pm_port_group *group = &m->port_group[i];
        const int end_rates_of = group->end[0].needs_end_rates   ? 0
                                 : group->end[1].needs_end_rates ? 1
                                                                 : -1;
        if (group->law == NULL) {
            for (int l = 0; l < group->count; ++l) {
                ++d->port_rested[group->first_lane + l];
            }
            continue;
        }
        if (end_rates_of >= 0) {
            add_end_rates(m, d, group, end_rates_of);
            prescribed = prescribed && !group->outside;
        } else if (group->outside && !prescribed) {
            prescribe(m, d, pm_integrator_time(m->integrator, d->stage));
            prescribed = true;
        }
        for (int block = 0; block < group->nblock; ++block) {
            const int64_t lane = group->first_lane + (int64_t)block * group->width;
            run_block(m, d, group, block, end_rates_of >= 0);
            for (int e = 0; e < 2; ++e) {
                const pm_port_group_end *end = &group->end[e];
                if (end->law_rate != NULL && books) {
                    const pm_lane_flux flux = pm_lane_flux_from(&d->flux[e], lane);
                    pm_lanes_book(end->ny, group->width, weight, first,
                                  end->law_e != NULL ? end->law_e : end->shown[PM_SHOWN_DE],
                                  end->shown[PM_SHOWN_DS], rate_of(d, group, end, block), &flux);
                }
            }
            if (m->ordered) {
                add_block(d, group, block, k);
            }
        }
    }
    for (int i = 0; i < m->njoint && !m->ordered; ++i) {
        for (int e = 0; e < 2; ++e) {
            const pm_member at = m->port_at[m->joint[i]][e];
            if (at.group != PM_NOWHERE && m->port_group[at.group].law != NULL) {
                const pm_port_group *group = &m->port_group[at.group];
                const int block = at.lane / group->width, lane = at.lane % group->width;
                add_end(d, group, e, block, lane, lane + 1, k);
            }
        }
    }
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        const ptrdiff_t size = (ptrdiff_t)group->nz * group->width;
        for (int block = 0; block < group->nblock && group->release != NULL; ++block) {
            const ptrdiff_t at = group->first + block * size;
            memcpy(group->release_z, d->stage_z + at, (size_t)size * sizeof *k);
            memcpy(group->release_rate, k + at, (size_t)size * sizeof *k);
            pm_program_run_prepared(group->release, group->width);
            memcpy(k + at, group->released, (size_t)size * sizeof *k);
        }
    }
}

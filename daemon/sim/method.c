// The families of integrators. A Runge-Kutta method combines the rates of its stages; it may
// estimate its error, or move each new state to the energy and entropy that follow from the fluxes.
// A discrete gradient method iterates the new state until all subsystems have converged.
#include <math.h>
#include <string.h>

#include "sim/engine.h"

// The most Newton steps of the projection onto energy and entropy. After the first one the residual
// is about the square of the method's error.
#define MOST_MOVES 3
#define EASILY 0.125    // times the tolerance: what a subsystem may leave open of its own energies
#define STRICTEST 1e-13 // tolerance of the energy in an iteration, since it has rounding errors

// --- what all families share ---

// Returns memory for the next state.
static double *free_state(const pm_data *d) {
    int i = 0;
    while (d->state[i] == d->z || d->state[i] == d->safe_z) {
        ++i;
    }
    return d->state[i];
}

// Counts the subsystems of a block that end a step outside their training range, and notes whether
// a subsystem may have to end the run.
static void check_block(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block) {
    uint64_t outside[PM_MOST_LANES];
    const int width = group->width, size = group->nz * width;
    const int64_t lane = group->first_lane + (int64_t)block * width;
    const double *z = d->stage_z + group->first + (ptrdiff_t)block * size;
    d->doubtful = d->doubtful || pm_lanes_any_not_finite(size, z) ||
                  pm_lanes_any_not_finite(width, d->E + lane) ||
                  pm_lanes_any_not_finite(width, d->S + lane) || group->kind->check != NULL;
    pm_lanes_outside(group->range, width, z, outside);
    if (pm_lanes_any(width, outside)) {
        d->doubtful = d->doubtful || m->system->scene->run.largest_departure < INFINITY;
        for (int l = 0; l < width; ++l) {
            d->out_of_range[lane + l] += outside[l] != 0;
        }
    }
}

// Marks what the ghosts show as known, until they show something else.
static void rest_ghosts(const pm_model *m, const pm_data *d) {
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        memset(d->changed[i] + m->own_lanes, 0,
               (size_t)(m->lanes - m->own_lanes) * sizeof *d->changed[i]);
    }
}

// --- Runge-Kutta: the error of a substep ---

// Estimates the errors of the substep of a block, group by group of variables, relative to the
// largest length that the group has had, and keeps the largest.
static void estimate_error(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                           int block) {
    const pm_integrator *rk = m->integrator;
    const int w = group->width;
    const int64_t lane = group->first_lane + (int64_t)block * w;
    const ptrdiff_t first = group->first + (ptrdiff_t)block * group->nz * w;
    double *worst = d->error + lane;
    if (d->substep == 0) {
        memset(worst, 0, (size_t)w * sizeof *worst);
    }
    for (int i = 0; i < group->part->layout.ngroup; ++i) {
        const pm_group *variables = &group->part->layout.group[i];
        double *length = d->length + i * m->own_lanes + lane;
        double state[PM_MOST_LANES] = {0}, error[PM_MOST_LANES] = {0};
        for (int c = variables->first; c < variables->first + variables->size; ++c) {
            const ptrdiff_t at = first + (ptrdiff_t)c * w;
            double sum[PM_MOST_LANES] = {0};
            for (int s = 0; s < rk->nstage; ++s) {
                const double weight = d->h * rk->error_weights[s];
                const double *k = d->k + at + s * m->size;
                for (int l = 0; l < w; ++l) {
                    sum[l] += weight * k[l];
                }
            }
            for (int l = 0; l < w; ++l) {
                state[l] += d->z[at + l] * d->z[at + l];
                error[l] += sum[l] * sum[l];
            }
        }
        for (int l = 0; l < w; ++l) {
            length[l] = fmax(length[l], sqrt(state[l]));
            worst[l] = fmax(worst[l], length[l] > 0 ? sqrt(error[l]) / length[l] : 0);
        }
    }
}

// --- Runge-Kutta: energy and entropy of a balanced method ---

// Copies the components of one lane, which begin at `from`, to `to` [nz].
static const double *take(const pm_subsystem_group *group, const double *from, double *to) {
    for (int c = 0; c < group->nz; ++c) {
        to[c] = from[(ptrdiff_t)c * group->width];
    }
    return to;
}

// Adds the energy and entropy that flow at the present stage to the totals of the projections of a
// block. At the last stage, keeps what the block shows there, at the state z.
static void book_projection(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                            int block, const double *z) {
    const int width = group->width, size = group->nz * width;
    const ptrdiff_t first = group->first + (ptrdiff_t)block * size;
    const double weight = d->h * m->integrator->b[d->stage];
    const double *k = pm_stage_rates(m, d);
    double *dE = d->scratch, *dS = dE + group->nz, *rate = dS + group->nz;
    for (int l = 0; l < width; ++l) {
        const ptrdiff_t at = first + l;
        pm_invariant_projection_book(
            &d->projection[group->first_lane + (int64_t)block * width + l], d->stage == 0, weight,
            group->nz, take(group, d->shown[PM_SHOWN_DE] + at, dE),
            group->S == NULL ? NULL : take(group, d->shown[PM_SHOWN_DS] + at, dS),
            take(group, k + at, rate));
    }
    const double *const from[] = {z, d->shown[PM_SHOWN_DE], d->shown[PM_SHOWN_DS]};
    for (int i = 0; i < 3 && d->stage + 1 == m->integrator->nstage; ++i) {
        memcpy(d->coupled + (ptrdiff_t)i * size, from[i] + first, (size_t)size * sizeof(double));
    }
}

// Moves the new state of the lanes of a block for which `moving` is true. Clears `moving` where no
// move is needed, and sets moved [width] to the components that have got other bits. Returns true
// if a lane was moved.
static bool move(pm_data *d, const pm_subsystem_group *group, int block, bool *moving,
                 uint64_t *moved) {
    double *start = d->scratch, *z = start + group->nz, *dE = z + group->nz, *dS = dE + group->nz;
    const int width = group->width;
    bool any = false;
    for (int l = 0; l < width; ++l) {
        moved[l] = 0;
        if (!moving[l]) {
            continue;
        }
        const int64_t lane = group->first_lane + (int64_t)block * width + l;
        const ptrdiff_t at = group->first + (ptrdiff_t)block * group->nz * width + l;
        take(group, d->stage_z + at, z);
        moving[l] = pm_invariant_projection_newton_step(
            &d->projection[lane], &group->part->layout, take(group, d->z + at, start), d->E[lane],
            d->S[lane], take(group, d->shown[PM_SHOWN_DE] + at, dE),
            group->S == NULL ? NULL : take(group, d->shown[PM_SHOWN_DS] + at, dS), z);
        any = any || moving[l];
        for (int c = 0; c < group->nz && moving[l]; ++c) {
            const uint64_t bit = (uint64_t)1 << (c & 63);
            moved[l] |= pm_renew(d->stage_z + at + (ptrdiff_t)c * width, &z[c], 1) ? bit : 0;
        }
    }
    return any;
}

// Moves the new states of a block, which has been exposed, to the energy and entropy that follow
// from the fluxes, and exposes them.
static void project(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                    bool ends_step) {
    bool moving[PM_MOST_LANES];
    uint64_t moved[PM_MOST_LANES];
    long rested[PM_MOST_LANES];
    const int width = group->width, size = group->nz * width;
    const int64_t lane = group->first_lane + (int64_t)block * width;
    memset(moving, true, sizeof moving);
    int moves = 0;
    while (moves < MOST_MOVES && move(d, group, block, moving, moved)) {
        memcpy(rested, d->rested + lane, (size_t)width * sizeof *rested);
        memcpy(d->changed[PM_SHOWN_Z] + lane, moved, (size_t)width * sizeof *moved);
        group->kind->expose(m, d, group, block, false);
        for (int l = 0; l < width; ++l) {
            d->rested[lane + l] = rested[l] + (moving[l] && moved[l] == 0);
            d->more_exposures[lane + l] += moving[l];
        }
        ++moves;
    }
    if (ends_step && group->kind->single) {
        group->kind->expose(m, d, group, block, true);
        d->rested[lane] -= 1;
    }
    // A number counts as changed if it differs from that at the last coupling.
    const double *const now[] = {d->stage_z, d->shown[PM_SHOWN_DE], d->shown[PM_SHOWN_DS]};
    for (int i = 0; i < 3 && (moves > 0 || (ends_step && group->kind->single)); ++i) {
        pm_lanes_renew(group->nz, width, now[i] + group->first + (ptrdiff_t)block * size,
                       d->coupled + (ptrdiff_t)i * size, d->changed[i] + lane);
    }
    // At the end of a step, one more look at a state that was not moved is counted.
    for (int l = 0; l < width && ends_step; ++l) {
        d->more_exposures[lane + l] += !moving[l];
        d->rested[lane + l] += !moving[l];
    }
}

// --- Runge-Kutta ---

static void advance_stage(const pm_model *m, pm_data *d) {
    const pm_integrator *rk = m->integrator;
    const bool last = d->stage + 1 == rk->nstage, ends_step = last && d->substep + 1 == d->substeps;
    const double *before = d->stage_z;
    d->stage_z = d->stage_z == d->z ? free_state(d) : d->stage_z;
    d->shown[PM_SHOWN_Z] = d->stage_z;
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int block = 0; block < group->nblock; ++block) {
            const ptrdiff_t first = group->first + (ptrdiff_t)block * group->nz * group->width;
            const int64_t lane = group->first_lane + (int64_t)block * group->width;
            if (rk->balanced) {
                book_projection(m, d, group, block, before);
            }
            pm_lanes_combine(group->nz, group->width, last ? rk->nstage : d->stage + 1,
                             last ? rk->b : rk->a[d->stage + 1], d->h, d->z + first, d->k + first,
                             m->size, before + first, d->stage_z + first,
                             d->changed[PM_SHOWN_Z] + lane);
            group->kind->expose(m, d, group, block, ends_step && !rk->balanced);
            if (last && d->error != NULL) {
                estimate_error(m, d, group, block);
            }
            if (last && rk->balanced) {
                project(m, d, group, block, ends_step);
            }
            if (ends_step) {
                check_block(m, d, group, block);
            }
        }
    }
    ++d->exposure_calls;
    rest_ghosts(m, d);
    d->stage = last ? 0 : d->stage + 1;
    d->substep += last;
    d->z = last ? d->stage_z : d->z;
}

// --- discrete gradients ---

static double length_of(const pm_group *group, const double *z) {
    double square = 0;
    for (int c = group->first; c < group->first + group->size; ++c) {
        square += z[c] * z[c];
    }
    return sqrt(square);
}

// Exposes a subsystem, and shows the mean of the states at the start of the substep and at the
// present iterate, where operators and ports are evaluated.
static void expose_iterate(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                           bool ends_step) {
    double *mean = d->scratch;
    group->kind->expose(m, d, group, 0, ends_step);
    for (int c = 0; c < group->nz; ++c) {
        mean[c] = 0.5 * (d->z[group->first + c] + d->stage_z[group->first + c]);
    }
    pm_lanes_renew(group->nz, 1, mean, d->shown[PM_SHOWN_Z] + group->first,
                   d->changed[PM_SHOWN_Z] + group->first_lane);
}

// Computes the next iterate of a subsystem. Returns its change: that of the group of variables that
// changes most, relative to the length of the group, and infinite where a number is not finite.
// *moves says whether the iterate is another one.
static double iterate(const pm_model *m, pm_data *d, const pm_subsystem_group *group, bool *moves) {
    double *next = d->scratch, *difference = next + m->most_nz;
    double *iterate = d->stage_z + group->first, change = 0;
    *moves = group->kind->iterate(m, d, group, next);
    if (!*moves) {
        return isfinite(d->E[group->first_lane]) ? 0 : INFINITY;
    }
    for (int c = 0; c < group->nz; ++c) {
        difference[c] = next[c] - iterate[c];
        iterate[c] = next[c];
    }
    for (int i = 0; i < group->part->layout.ngroup; ++i) {
        const pm_group *variables = &group->part->layout.group[i];
        const double size =
            fmax(length_of(variables, d->z + group->first), length_of(variables, iterate));
        const double part = size > 0 ? length_of(variables, difference) / size : 0;
        change = isnan(part) ? INFINITY : fmax(change, part);
    }
    return group->kind->change == NULL ? change : group->kind->change(group, change);
}

// Returns by how much the energy of the present iterate differs from that at the start of the
// substep and what the subsystem has taken in by the rates that made the iterate, in J; 0 where
// that is less than EASILY times `tolerance` of these energies.
static double open_energy(const pm_data *d, const pm_subsystem_group *group, double tolerance,
                          pm_iteration *it) {
    const double E = d->E[group->first_lane];
    const double *dE = d->shown[PM_SHOWN_DE] + group->first, *k = d->k + group->first;
    if (d->stage == 0) {
        it->start = E;
        it->taken = it->gross = 0;
    }
    const double open = fabs(E - it->start - it->taken);
    const double least = EASILY * tolerance * (fabs(E) + fabs(it->start) + it->gross);
    it->taken = it->gross = 0;
    for (int c = 0; c < group->nz; ++c) {
        const double part = d->h * dE[c] * k[c];
        it->taken += part;
        it->gross += fabs(part);
    }
    return open > least || isnan(open) ? open : 0;
}

// Chooses the length of the next piece of the substep.
static void set_length(const pm_model *m, pm_data *d) {
    d->h = ldexp(m->system->scene->physics.dt / d->substeps, -d->halvings);
}

// Begins the present piece of the substep again, as two pieces.
static void halve(const pm_model *m, pm_data *d) {
    ++d->halvings;
    d->piece *= 2;
    d->stage = 0;
    set_length(m, d);
    memcpy(d->stage_z, d->z, (size_t)m->own_size * sizeof *d->z);
    memset(d->known, 0, (size_t)m->nblock * sizeof *d->known);
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        if (group->kind->start != NULL) {
            group->kind->start(d, group, false);
        }
        pm_iteration_start(&d->iteration[group->first_lane]);
        expose_iterate(m, d, group, false);
    }
    ++d->exposure_calls;
    rest_ghosts(m, d);
}

// Ends a piece of the substep, for all subsystems in the same round. Two pieces that were one make
// room for a longer one again.
static void end_piece(const pm_model *m, pm_data *d) {
    d->z = d->stage_z;
    d->stage_z = free_state(d);
    memcpy(d->stage_z, d->z, (size_t)m->own_size * sizeof *d->z);
    d->stage = 0;
    ++d->piece;
    while (d->halvings > 0 && d->piece % 2 == 0) {
        --d->halvings;
        d->piece /= 2;
    }
    if (d->halvings == 0) {
        d->piece = 0;
        ++d->substep;
    }
    set_length(m, d);
}

static void advance_iteration(const pm_model *m, pm_data *d) {
    const int left = m->integrator->most_iterations - (d->stage + 1), halvings = d->halvings;
    const double tolerance = fmax(m->system->scene->run.energy_tolerance, STRICTEST);
    bool last = false, stuck = false;
    int slowest = 0;
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        bool *moves = &d->moves[group->first_lane];
        pm_iteration *iteration = &d->iteration[group->first_lane];
        const double open = open_energy(d, group, tolerance, iteration);
        iteration->keeps_energy = group->kind->keeps_energy;
        const double change = iterate(m, d, group, moves);
        last = pm_iteration_end_round(iteration, change, open / tolerance,
                                      m->system->scene->physics.diameter, left);
        stuck = stuck || iteration->stuck;
        slowest =
            iteration->change <= d->iteration[m->group[slowest].first_lane].change ? slowest : i;
    }
    const bool gave_up = d->iteration[m->group[0].first_lane].gave_up;
    ++d->stage;
    if (gave_up && !last && halvings < PM_MOST_HALVINGS) {
        halve(m, d);
        return;
    }
    if ((gave_up || stuck) && d->unsolved == 0) {
        d->unsolved = d->h;
        d->unsolved_group = slowest;
    }
    if (last) {
        end_piece(m, d);
    }
    if (d->halvings != halvings) { // responses belong to the length of a piece
        memset(d->known, 0, (size_t)m->nblock * sizeof *d->known);
    }
    const bool ends_step = d->substep == d->substeps;
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        if (last) {
            pm_iteration_start(&d->iteration[group->first_lane]);
            if (group->kind->end_substep != NULL) {
                group->kind->end_substep(d, group);
            }
        }
        if (last || d->moves[group->first_lane]) {
            expose_iterate(m, d, group, ends_step);
        } else {
            --d->more_exposures[group->first_lane];
            for (int s = 0; s < PM_SHOWN_COUNT; ++s) {
                d->changed[s][group->first_lane] = 0;
            }
        }
        if (ends_step) {
            check_block(m, d, group, 0);
        }
    }
    d->doubtful = d->doubtful || (ends_step && d->unsolved > 0);
    ++d->exposure_calls;
    rest_ghosts(m, d);
}

// --- the start of a run ---

static void mark_changed(const pm_model *m, const pm_data *d) {
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        memset(d->changed[i], 0xff, (size_t)m->lanes * sizeof *d->changed[i]);
    }
}

void pm_expose_all(const pm_model *m, pm_data *d, bool run) {
    const bool implicit = m->method->implicit;
    d->stage = d->substep = d->piece = 0;
    d->doubtful = false;
    d->unsolved = 0;
    if (d->halvings > 0) {
        d->halvings = 0;
        set_length(m, d);
    }
    d->stage_z = d->z;
    if (implicit) {
        d->stage_z = free_state(d);
        memcpy(d->stage_z, d->z, (size_t)m->own_size * sizeof *d->z);
    } else {
        d->shown[PM_SHOWN_Z] = d->z;
    }
    memset(d->known, 0, (size_t)m->nblock * sizeof *d->known);
    mark_changed(m, d);
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        if (group->kind->start != NULL) {
            group->kind->start(d, group, run);
        }
        if (implicit) {
            pm_iteration_start(&d->iteration[group->first_lane]);
            expose_iterate(m, d, group, true);
        }
        for (int block = 0; block < group->nblock && !implicit; ++block) {
            group->kind->expose(m, d, group, block, true);
        }
    }
    mark_changed(m, d);
}

// --- the table ---

const pm_method *pm_method_of(const pm_integrator *integrator) {
    static const pm_method methods[] = {
        [PM_RUNGE_KUTTA] = {"Runge-Kutta", false, advance_stage},
        [PM_DISCRETE_GRADIENT] = {"discrete gradient", true, advance_iteration},
    };
    return &methods[integrator->family];
}

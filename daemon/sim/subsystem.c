// One subsystem: three kinds of graph (exposure, bulk, one per port) around a Runge-Kutta state.
#include "sim/subsystem.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model/training_range.h"
#include "sim/invariant_projection.h"
#include "sim/local_dynamics.h"
#include "sim/multirate.h"
#include "sim/step_controller.h"

// Newton's steps to the booked energy and entropy. The first leaves the square of the method's
// error.
#define MOST_MOVES 3

struct pm_subsystem {
    const pm_system *system;
    const pm_scene_subsystem *scene;
    int id, nz;
    const pm_integrator *integrator;
    int substeps;
    double h; // s, one substep
    pm_arena arena;

    double *z, *stage_z, *safe_z; // [nz] state, stage state, state after the last full step
    double *at_z;                 // [nz] where operators and ports are evaluated
    double *k;                    // [nstage][nz]
    double *error_weights;        // [nz] by which the embedded method differs
    double *size;                 // [ngroup] largest length of each group so far
    int stage, substep;
    bool exposed; // dE and dS belong to stage_z
    const pm_boundary_input *boundary_input;
    double *prescribed; // [scene->nprescribed] at the stage
    long step;
    pm_invariant_projection balance, safe_balance; // now and after the last full step

    pm_local_dynamics terms;
    pm_training_range region;
    pm_multirate multirate; // of a multirate integrator

    int njoint;
    pm_port_instance *joint;
    pm_books books, booking;
    pm_flux *flux; // for books
};

// --- building ---

static pm_status open_joints(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    s->joint = pm_arena_array(&s->arena, 2 * (size_t)scene->nport, sizeof *s->joint);
    s->flux = pm_arena_array(&s->arena, 2 * (size_t)scene->nport, sizeof *s->flux);
    s->prescribed = pm_arena_array(&s->arena, (size_t)scene->nprescribed, sizeof *s->prescribed);
    if (s->joint == NULL || s->flux == NULL || s->prescribed == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the ports of %s", s->scene->name);
    }
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            if (scene->port[i].subsystem[end] == s->id) {
                PM_TRY(pm_port_instance_open(&s->joint[s->njoint++], &s->arena, s->system,
                                             s->integrator, i, (pm_end)end));
            }
        }
    }
    return PM_OK;
}

static pm_status open_state(pm_subsystem *s) {
    const size_t nz = (size_t)s->nz;
    double *memory =
        pm_arena_array(&s->arena, (5 + (size_t)s->integrator->nstage) * nz, sizeof *memory);
    s->size = pm_arena_array(&s->arena, PM_MAX_GROUPS, sizeof *s->size);
    if (memory == NULL || s->size == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the state of %s", s->scene->name);
    }
    s->z = memory;
    s->stage_z = memory + nz;
    s->safe_z = memory + 2 * nz;
    s->at_z = memory + 3 * nz;
    s->error_weights = memory + 4 * nz;
    s->k = memory + 5 * nz;
    return PM_OK;
}

static pm_status open_all(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    s->integrator = pm_integrator_find(scene->integrator);
    s->substeps = scene->substeps;
    s->h = scene->dt / scene->substeps;
    const pm_part *part = &s->system->part[s->id];
    if (s->integrator->discrete && !pm_part_is_discrete(part)) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s needs energies and entropies of the features x, |x|, "
                       "ln|x|, |x|^2, <x,y> and |min(x,0)| alone; subsystem %s has others",
                       scene->integrator_at, s->integrator->name, s->scene->name);
    }
    s->region = pm_training_range_of(part);
    if (s->integrator->multirate) {
        PM_TRY(
            pm_multirate_open(&s->multirate, &s->arena, s->nz, s->scene->substeps, s->integrator));
    } else if (s->scene->substeps > 1) {
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s asks for substeps of its own: integrator %s has none, "
                       "multirate3 and multirate3_balanced have",
                       s->scene->substeps_at, s->scene->name, s->integrator->name);
    }
    PM_TRY(open_state(s));
    PM_TRY(pm_local_dynamics_open(&s->terms, &s->arena, s->system, s->id, s->integrator, s->h));
    PM_TRY(open_joints(s));
    pm_subsystem_set_state(s, s->scene->initial != NULL ? s->scene->initial : s->z);
    return PM_OK;
}

pm_status pm_subsystem_open(pm_subsystem **subsystem, const pm_system *system, int subsystem_id) {
    pm_subsystem *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a subsystem");
    }
    s->system = system;
    s->id = subsystem_id;
    s->scene = &system->scene->subsystem[subsystem_id];
    s->nz = s->scene->layout.nz;
    const pm_status status = open_all(s);
    if (status != PM_OK) {
        pm_subsystem_close(s);
        return status;
    }
    *subsystem = s;
    return PM_OK;
}

void pm_subsystem_close(pm_subsystem *subsystem) {
    if (subsystem != NULL) {
        for (int i = 0; i < subsystem->njoint; ++i) {
            pm_port_instance_close(&subsystem->joint[i]);
        }
        pm_local_dynamics_close(&subsystem->terms);
        pm_arena_free(&subsystem->arena);
        free(subsystem);
    }
}

// --- what it is ---

int pm_subsystem_nport(const pm_subsystem *s) {
    return s->njoint;
}

int pm_subsystem_port_id(const pm_subsystem *s, int port) {
    return s->joint[port].port_id;
}

pm_end pm_subsystem_end(const pm_subsystem *s, int port) {
    return s->joint[port].end;
}

bool pm_subsystem_is_load(const pm_subsystem *s, int port) {
    return s->joint[port].boundary_input != NULL;
}

pm_status pm_subsystem_share(pm_subsystem *s, int port, pm_subsystem *peer, int peer_port) {
    return pm_port_instance_share(&s->joint[port], &peer->joint[peer_port], s->system,
                                  s->integrator);
}

void pm_subsystem_set_boundary_input(pm_subsystem *s, const pm_boundary_input *boundary_input) {
    s->boundary_input = boundary_input;
}

int pm_subsystem_rounds(const pm_subsystem *s) {
    return s->substeps * s->integrator->nstage;
}

int pm_subsystem_most_rounds(const pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    const int most = scene->tolerance > 0 ? PM_MOST_SUBSTEPS : scene->substeps;
    return most * s->integrator->nstage;
}

void pm_subsystem_set_substeps(pm_subsystem *s, int substeps) {
    s->substeps = substeps;
    s->h = s->system->scene->dt / substeps;
}

const double *pm_subsystem_state(const pm_subsystem *s) {
    return s->z;
}

const pm_port_values *pm_subsystem_values(const pm_subsystem *s, int port) {
    return &s->joint[port].own.shown;
}

// --- one round ---

static void copy(double *to, const double *from, int n) {
    if (to != NULL && from != NULL) {
        memcpy(to, from, (size_t)n * sizeof *to);
    }
}

static double value_at(const double *covector, int i) {
    return covector == NULL ? 0 : covector[i];
}

// Shows at the ports what the terms expose.
static void show(pm_subsystem *s, pm_exposure exposure) {
    s->exposed = true;
    s->booking.evaluated += exposure == PM_EXPOSURE_EVALUATED;
    s->booking.skipped += exposure != PM_EXPOSURE_EVALUATED;
    // (A part's own steps leave their exposures where the ports do not see them.)
    if (exposure == PM_EXPOSURE_SAME && !s->integrator->multirate) {
        return;
    }
    for (int c = 0; c < s->nz; ++c) {
        s->at_z[c] = s->integrator->discrete ? 0.5 * (s->z[c] + s->stage_z[c]) : s->stage_z[c];
    }
    for (int i = 0; i < s->njoint; ++i) {
        pm_port_instance_expose(&s->joint[i], s->at_z, s->terms.dE, s->terms.dS, s->terms.response);
    }
}

void pm_subsystem_expose(pm_subsystem *s) {
    if (!s->exposed) {
        // Where it moves: as in the stage before. (A step's first stage was exposed when the step
        // before it ended.)
        const int before = (s->stage == 0 ? s->integrator->nstage : s->stage) - 1;
        const double *rate = s->k + (ptrdiff_t)before * s->nz;
        show(s, pm_local_dynamics_expose(&s->terms, s->stage_z, s->z, rate));
    }
}

// The weight of the present stage in the mean over a step.
static double stage_weight(const pm_subsystem *s) {
    return s->integrator->b[s->stage] / s->substeps;
}

void pm_subsystem_bulk(pm_subsystem *s) {
    double *k = s->k + (ptrdiff_t)s->stage * s->nz;
    if (s->terms.bulk == NULL || s->integrator->multirate) {
        memset(k, 0, (size_t)s->nz * sizeof *k);
        s->booking.skipped += !s->integrator->multirate;
        return;
    }
    const bool renewed = pm_local_dynamics_evaluate_bulk(&s->terms, s->at_z);
    memcpy(k, s->terms.bulk_rate, (size_t)s->nz * sizeof *k);
    pm_flux_book(&s->booking.bulk, stage_weight(s), s->nz, s->terms.dE, s->terms.dS, k);
    s->booking.evaluated += renewed;
    s->booking.skipped += !renewed;
}

// What the world shows at its end of a port, at the time of the stage.
static const pm_port_values *prescribe(pm_subsystem *s, pm_port_instance *j) {
    assert(s->boundary_input != NULL);
    const double fraction =
        (s->substep + pm_integrator_time(s->integrator, s->stage)) / s->substeps;
    pm_boundary_input_at(s->boundary_input, s->step, fraction, s->prescribed);
    return pm_port_instance_prescribe(j, s->prescribed);
}

void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour) {
    pm_port_instance *j = &s->joint[port];
    const pm_port_values *other = j->boundary_input != NULL ? prescribe(s, j) : neighbour;
    const bool done = pm_port_instance_couple(j, other, s->stage == 0, stage_weight(s),
                                              s->k + (ptrdiff_t)s->stage * s->nz);
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

// Notes the substep's error, by group, relative to the largest length that the group has had.
static void estimate_error(pm_subsystem *s) {
    const pm_layout *layout = &s->scene->layout;
    for (int c = 0; c < s->nz; ++c) {
        s->error_weights[c] = 0;
        for (int i = 0; i < s->integrator->nstage; ++i) {
            s->error_weights[c] +=
                s->h * s->integrator->error_weights[i] * s->k[(ptrdiff_t)i * s->nz + c];
        }
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        s->size[i] = fmax(s->size[i], length_of(group, s->z));
        const double error = length_of(group, s->error_weights);
        s->booking.error = fmax(s->booking.error, s->size[i] > 0 ? error / s->size[i] : 0);
    }
}

// Energy and entropy that the stage's rate moves.
static void book_balance(pm_subsystem *s) {
    pm_invariant_projection_book(&s->balance, s->stage == 0, s->h * s->integrator->b[s->stage],
                                 s->nz, s->terms.dE, s->terms.dS,
                                 s->k + (ptrdiff_t)s->stage * s->nz);
}

// Moves the new state to where it has what was booked. Its last exposure is that of the next stage.
static void balance(pm_subsystem *s) {
    for (int i = 0; i < MOST_MOVES; ++i) {
        pm_subsystem_expose(s);
        if (!pm_invariant_projection_move(&s->balance, &s->scene->layout, s->z, s->terms.E[0],
                                          value_at(s->terms.S, 0), s->terms.dE, s->terms.dS,
                                          s->stage_z)) {
            return;
        }
        s->exposed = false;
    }
}

// The state at the next stage, or after the last.
static void reach_next_stage(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    if (rk->multirate) {
        const pm_multirate_books books = {&s->booking.bulk, &s->booking.evaluated,
                                          &s->booking.skipped, rk->balanced ? &s->balance : NULL};
        pm_multirate_advance(&s->multirate, &s->terms, s->stage, s->h, 1.0 / s->substeps, s->k,
                             &books, s->stage_z);
    } else if (s->stage + 1 < rk->nstage) {
        combine(s, s->stage + 1, rk->a[s->stage + 1], s->stage_z);
    } else {
        combine(s, rk->nstage, rk->b, s->stage_z);
    }
}

void pm_subsystem_advance(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    if (rk->balanced) {
        book_balance(s);
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
        balance(s);
    }
    copy(s->z, s->stage_z, s->nz);
    s->stage = 0;
    ++s->substep;
}

// --- one step ---

static void clear_booking(pm_subsystem *s) {
    const pm_books *b = &s->booking;
    s->booking =
        (pm_books){.evaluated = b->evaluated, .skipped = b->skipped, .outside = b->outside};
    for (int i = 0; i < s->njoint; ++i) {
        s->joint[i].booking = s->joint[i].world_booking = (pm_flux){0};
    }
}

static void close_books(pm_subsystem *s) {
    s->books = s->booking;
    s->books.energy = s->terms.E[0];
    s->books.entropy = value_at(s->terms.S, 0);
    s->books.flux = s->flux;
    s->books.nflux = s->njoint;
    for (int i = 0; i < s->njoint; ++i) {
        s->flux[i] = s->joint[i].booking;
        if (s->joint[i].boundary_input != NULL) {
            s->flux[s->books.nflux++] = s->joint[i].world_booking;
        }
    }
    clear_booking(s);
}

void pm_subsystem_set_state(pm_subsystem *s, const double *z) {
    memmove(s->z, z, (size_t)s->nz * sizeof *z);
    copy(s->stage_z, s->z, s->nz);
    copy(s->safe_z, s->z, s->nz);
    s->stage = s->substep = 0;
    s->step = 0;
    memset(s->size, 0, PM_MAX_GROUPS * sizeof *s->size);
    pm_local_dynamics_forget(&s->terms);
    for (int i = 0; i < s->njoint; ++i) {
        s->joint[i].known = false;
    }
    show(s, pm_local_dynamics_expose_end(&s->terms, s->stage_z, s->z));
    s->booking = (pm_books){0};
    clear_booking(s);
    pm_invariant_projection_start(&s->balance, s->terms.E[0], value_at(s->terms.S, 0));
    s->safe_balance = s->balance;
    close_books(s);
}

// --- memory ---

// Step, terms evaluated and skipped, steps outside; the books' own flux, those of its ports, the
// balance; what bulk and ports were evaluated with, so that the first step knows what has not
// changed; the state.
#define COUNTS 4
#define FLUX 4
#define BALANCE 4

int pm_subsystem_checkpoint_size(const pm_subsystem *s) {
    int count = COUNTS + FLUX * (1 + s->books.nflux) + BALANCE +
                pm_local_dynamics_checkpoint_size(&s->terms) + s->nz;
    for (int i = 0; i < s->njoint; ++i) {
        count += pm_port_instance_checkpoint_size(&s->joint[i]);
    }
    return count;
}

static double *put_flux(const pm_flux *flux, double *memory) {
    const double number[FLUX] = {flux->energy, flux->entropy, flux->energy_gross,
                                 flux->entropy_gross};
    memcpy(memory, number, sizeof number);
    return memory + FLUX;
}

static const double *get_flux(pm_flux *flux, const double *memory) {
    *flux = (pm_flux){memory[0], memory[1], memory[2], memory[3]};
    return memory + FLUX;
}

void pm_subsystem_save(const pm_subsystem *s, double *memory) {
    *memory++ = (double)s->step;
    *memory++ = (double)s->books.evaluated;
    *memory++ = (double)s->books.skipped;
    *memory++ = (double)s->books.outside;
    memory = put_flux(&s->books.bulk, memory);
    for (int i = 0; i < s->books.nflux; ++i) {
        memory = put_flux(&s->flux[i], memory);
    }
    *memory++ = s->balance.energy;
    *memory++ = s->balance.energy_gross;
    *memory++ = s->balance.entropy;
    *memory++ = s->balance.entropy_gross;
    pm_local_dynamics_save(&s->terms, memory);
    memory += pm_local_dynamics_checkpoint_size(&s->terms);
    for (int i = 0; i < s->njoint; ++i) {
        pm_port_instance_save(&s->joint[i], memory);
        memory += pm_port_instance_checkpoint_size(&s->joint[i]);
    }
    copy(memory, s->z, s->nz);
}

void pm_subsystem_restore(pm_subsystem *s, const double *memory) {
    const double *count = memory;
    pm_subsystem_set_state(s, memory + pm_subsystem_checkpoint_size(s) - s->nz);
    s->step = (long)count[0];
    s->booking.evaluated = s->books.evaluated = (long)count[1];
    s->booking.skipped = s->books.skipped = (long)count[2];
    s->booking.outside = s->books.outside = (long)count[3];
    memory = get_flux(&s->books.bulk, memory + COUNTS);
    for (int i = 0; i < s->books.nflux; ++i) {
        memory = get_flux(&s->flux[i], memory);
    }
    s->balance = s->safe_balance =
        (pm_invariant_projection){memory[0], memory[1], memory[2], memory[3]};
    memory += BALANCE;
    pm_local_dynamics_restore(&s->terms, memory);
    memory += pm_local_dynamics_checkpoint_size(&s->terms);
    for (int i = 0; i < s->njoint; ++i) {
        pm_port_instance_restore(&s->joint[i], memory);
        memory += pm_port_instance_checkpoint_size(&s->joint[i]);
    }
}

// --- the end of a step ---

static pm_status check_finite(const pm_subsystem *s) {
    const pm_layout *layout = &s->scene->layout;
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        for (int c = 0; c < group->size; ++c) {
            if (!isfinite(s->z[group->first + c])) {
                return pm_fail(PM_ENUMERIC,
                               "subsystem %s: %s[%d] became %g: the step is too long for this "
                               "state, or the state left what the weights were trained on; try a "
                               "smaller dt or more substeps",
                               s->scene->name, group->name, c, s->z[group->first + c]);
            }
        }
    }
    return PM_OK;
}

static pm_status check_potentials(const pm_subsystem *s) {
    if (isfinite(s->terms.E[0]) && isfinite(value_at(s->terms.S, 0))) {
        return PM_OK;
    }
    return pm_fail(PM_ENUMERIC,
                   "subsystem %s: energy %g, entropy %g: the state left what the weights were "
                   "trained on",
                   s->scene->name, s->terms.E[0], value_at(s->terms.S, 0));
}

// Counts states outside the region the weights were trained on, as far as the scene's guard allows.
static pm_status check_training_range(pm_subsystem *s) {
    const pm_departure d = pm_training_range_departure(s->region, s->z);
    s->booking.outside += d.group != NULL;
    if (!(d.widths > s->system->scene->largest_departure)) {
        return PM_OK;
    }
    return pm_fail(PM_ENUMERIC,
                   "subsystem %s: step %ld: %s%s%s = %.4g %s, and its weights were trained on %.4g "
                   "to %.4g: train on a wider range, or widen the scene's guard",
                   s->scene->name, s->step + 1, d.group->size > 1 ? "|" : "", d.group->name,
                   d.group->size > 1 ? "|" : "", d.value, d.group->unit, d.low, d.high);
}

static pm_status check_load(const pm_subsystem *s) {
    if (s->boundary_input == NULL || s->step < s->boundary_input->end) {
        return PM_OK;
    }
    return pm_fail(PM_EDATA,
                   "subsystem %s: what its load follows ends after %ld steps: take fewer steps, or "
                   "a longer trajectory",
                   s->scene->name, s->boundary_input->end);
}

pm_status pm_subsystem_end_step(pm_subsystem *s) {
    assert(s->stage == 0 && s->substep == s->substeps);
    s->substep = 0;
    pm_status status = check_finite(s);
    if (status == PM_OK) {
        show(s, pm_local_dynamics_expose_end(&s->terms, s->stage_z, s->z));
        status = check_potentials(s);
    }
    if (status == PM_OK) {
        status = check_load(s);
    }
    if (status == PM_OK) {
        status = check_training_range(s);
    }
    if (status != PM_OK) {
        copy(s->z, s->safe_z, s->nz);
        copy(s->stage_z, s->z, s->nz);
        s->balance = s->safe_balance;
        s->exposed = false;
        return status;
    }
    copy(s->safe_z, s->z, s->nz);
    s->safe_balance = s->balance;
    ++s->step;
    close_books(s);
    return PM_OK;
}

pm_books pm_subsystem_books(const pm_subsystem *s) {
    return s->books;
}

void pm_subsystem_fill_sample(const pm_subsystem *s, pm_sample *sample) {
    const pm_books *books = &s->books;
    const int i = s->id;
    copy(sample->z + s->scene->first, s->z, s->nz);
    sample->energy[i] = books->energy;
    sample->entropy[i] = books->entropy;
    sample->bulk_energy[i] = books->bulk.energy;
    sample->bulk_entropy[i] = books->bulk.entropy;
    sample->bulk_gross[2 * i] = books->bulk.energy_gross;
    sample->bulk_gross[2 * i + 1] = books->bulk.entropy_gross;
    sample->evaluated[i] = books->evaluated;
    sample->skipped[i] = books->skipped;
    sample->outside[i] = books->outside;
    sample->error[i] = books->error;
    int world = s->njoint;
    for (int k = 0; k < s->njoint; ++k) {
        const pm_port_instance *j = &s->joint[k];
        sample->flux[j->port_id][j->end] = books->flux[k];
        if (j->boundary_input != NULL) {
            sample->flux[j->port_id][1 - j->end] = books->flux[world++];
        }
    }
}

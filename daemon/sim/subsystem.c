// One subsystem: three kinds of graph (exposure, bulk, one per port) around a Runge-Kutta state.
#include "sim/subsystem.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"
#include "model/region.h"
#include "sim/balance.h"

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
    int stage, substep;
    bool exposed; // dE and dS belong to stage_z
    const pm_load *load;
    double *prescribed; // [scene->nprescribed] at the stage
    long step;
    pm_balance balance, safe_balance; // now and after the last full step

    pm_program *exposure;               // z -> E, S, dE, dS
    double *exposure_z, *exposure_from; // stage state; start of the substep if discrete, else NULL
    const double *E, *S, *dE, *dS, *response;
    pm_program *bulk; // z, dE, dS -> rate; NULL if nothing acts inside
    double *bulk_z, *bulk_dE, *bulk_dS;
    const double *bulk_rate;
    bool exposure_known, bulk_known; // what the programs hold belongs to their inputs

    int njoint;
    pm_joint *joint;
    pm_books books, booking;
    pm_flux *flux; // for books
};

// --- building the graphs ---

// By how much dE rises per unit of rate, where a port's prediction asks for it. `wanted` [nz] is
// work space.
static pm_node build_response(const pm_subsystem *s, pm_graph *g, const pm_part *part, pm_node dE,
                              pm_node z, bool *wanted) {
    if (!s->integrator->discrete) {
        return PM_NO_NODE;
    }
    pm_system_responding(s->system, s->id, wanted);
    const pm_node response = pm_part_response(g, part, dE, z, wanted);
    return response == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, response, s->h);
}

static pm_status open_exposure(pm_subsystem *s, const pm_part *part) {
    pm_graph *g = NULL;
    bool *responding = pm_arena_array(&s->arena, (size_t)s->nz, sizeof *responding);
    if (responding == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the state of %s", s->scene->name);
    }
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, s->nz);
    const pm_node from = s->integrator->discrete ? pm_input(g, true, 1, s->nz) : PM_NO_NODE;
    const pm_node E = pm_part_energy(g, part, z), S = pm_part_entropy(g, part, z);
    pm_node dE, dS;
    pm_part_coenergies(g, part, from, z, &dE, &dS);
    const pm_node wanted[] = {E, S, dE, dS, build_response(s, g, part, dE, z, responding)};
    const double **const value[] = {&s->E, &s->S, &s->dE, &s->dS, &s->response};
    pm_node output[5];
    int count = 0;
    for (int i = 0; i < 5; ++i) {
        if (wanted[i] != PM_NO_NODE) {
            output[count++] = pm_broadcast_to(
                g, wanted[i], (pm_shape){true, 1, pm_graph_shape(g, wanted[i]).cols});
        }
    }
    pm_status status = pm_program_open(&s->exposure, g, count, output, 1);
    if (status == PM_OK) {
        s->exposure_z = pm_program_value(s->exposure, z);
        s->exposure_from = from == PM_NO_NODE ? NULL : pm_program_value(s->exposure, from);
        count = 0;
        for (int i = 0; i < 5; ++i) {
            *value[i] =
                wanted[i] == PM_NO_NODE ? NULL : pm_program_value(s->exposure, output[count++]);
        }
    }
    pm_graph_close(g);
    return status;
}

static pm_status open_bulk(pm_subsystem *s, const pm_part *part) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, s->nz), dE = pm_input(g, true, 1, s->nz);
    const pm_node dS = s->dS == NULL ? PM_NO_NODE : pm_input(g, true, 1, s->nz);
    pm_node degeneracy = PM_NO_NODE;
    const pm_node rate = pm_part_bulk(g, part, z, dE, dS, &degeneracy);
    pm_status status = PM_OK;
    if (rate != PM_NO_NODE) {
        status = pm_program_open(&s->bulk, g, 1, &rate, 1);
    }
    if (s->bulk != NULL) {
        s->bulk_z = pm_program_value(s->bulk, z);
        s->bulk_dE = pm_program_value(s->bulk, dE);
        s->bulk_dS = dS == PM_NO_NODE ? NULL : pm_program_value(s->bulk, dS);
        s->bulk_rate = pm_program_value(s->bulk, rate);
    }
    pm_graph_close(g);
    return status;
}

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
                PM_TRY(pm_joint_open(&s->joint[s->njoint++], &s->arena, s->system, s->integrator, i,
                                     (pm_end)end));
            }
        }
    }
    return PM_OK;
}

static pm_status open_state(pm_subsystem *s) {
    const size_t nz = (size_t)s->nz;
    double *memory =
        pm_arena_array(&s->arena, (4 + (size_t)s->integrator->nstage) * nz, sizeof *memory);
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the state of %s", s->scene->name);
    }
    s->z = memory;
    s->stage_z = memory + nz;
    s->safe_z = memory + 2 * nz;
    s->at_z = memory + 3 * nz;
    s->k = memory + 4 * nz;
    return PM_OK;
}

static pm_status open_all(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    s->integrator = pm_integrator_find(scene->integrator);
    if (s->integrator == NULL) {
        return pm_fail(PM_ECONFIG, "%s: unknown integrator \"%s\", expected one of: %s",
                       scene->integrator_at, scene->integrator, pm_integrator_names());
    }
    s->substeps = scene->substeps;
    s->h = scene->dt / scene->substeps;
    const pm_part *part = &s->system->part[s->id];
    if (s->integrator->discrete && !pm_part_is_discrete(part)) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s needs energies and entropies of the features x, |x|, "
                       "ln|x|, |x|^2, <x,y> and |min(x,0)| alone; subsystem %s has others",
                       scene->integrator_at, s->integrator->name, s->scene->name);
    }
    PM_TRY(open_state(s));
    PM_TRY(open_exposure(s, part));
    PM_TRY(open_bulk(s, part));
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
            pm_joint_close(&subsystem->joint[i]);
        }
        pm_program_close(subsystem->exposure);
        pm_program_close(subsystem->bulk);
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
    return s->joint[port].load != NULL;
}

pm_status pm_subsystem_share(pm_subsystem *s, int port, pm_subsystem *peer, int peer_port) {
    return pm_joint_share(&s->joint[port], &peer->joint[peer_port], s->system, s->integrator);
}

void pm_subsystem_set_load(pm_subsystem *s, const pm_load *load) {
    s->load = load;
}

int pm_subsystem_rounds(const pm_subsystem *s) {
    return s->substeps * s->integrator->nstage;
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

void pm_subsystem_expose(pm_subsystem *s) {
    if (s->exposed) {
        return;
    }
    s->exposed = true;
    bool renewed = !s->exposure_known;
    renewed |= pm_renew(s->exposure_z, s->stage_z, s->nz);
    renewed |= pm_renew(s->exposure_from, s->z, s->nz);
    if (!renewed) {
        return;
    }
    pm_program_run(s->exposure, 1);
    s->exposure_known = true;
    for (int c = 0; c < s->nz; ++c) {
        s->at_z[c] = s->integrator->discrete ? 0.5 * (s->z[c] + s->stage_z[c]) : s->stage_z[c];
    }
    for (int i = 0; i < s->njoint; ++i) {
        pm_joint_expose(&s->joint[i], s->at_z, s->dE, s->dS, s->response);
    }
}

// The weight of the present stage in the mean over a step.
static double stage_weight(const pm_subsystem *s) {
    return s->integrator->b[s->stage] / s->substeps;
}

void pm_subsystem_bulk(pm_subsystem *s) {
    double *k = s->k + (ptrdiff_t)s->stage * s->nz;
    if (s->bulk == NULL) {
        memset(k, 0, (size_t)s->nz * sizeof *k);
        ++s->booking.skipped;
        return;
    }
    bool renewed = !s->bulk_known;
    renewed |= pm_renew(s->bulk_z, s->at_z, s->nz);
    renewed |= pm_renew(s->bulk_dE, s->dE, s->nz);
    renewed |= pm_renew(s->bulk_dS, s->dS, s->nz);
    if (renewed) {
        pm_program_run(s->bulk, 1);
        s->bulk_known = true;
    }
    memcpy(k, s->bulk_rate, (size_t)s->nz * sizeof *k);
    pm_flux_book(&s->booking.bulk, stage_weight(s), s->nz, s->dE, s->dS, k);
    s->booking.evaluated += renewed;
    s->booking.skipped += !renewed;
}

// What the world shows at its end of a port, at the time of the stage.
static const pm_port_values *prescribe(pm_subsystem *s, pm_joint *j) {
    assert(s->load != NULL);
    const double fraction =
        (s->substep + pm_integrator_time(s->integrator, s->stage)) / s->substeps;
    pm_load_at(s->load, s->step, fraction, s->prescribed);
    return pm_joint_prescribe(j, s->prescribed);
}

void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour) {
    pm_joint *j = &s->joint[port];
    const pm_port_values *other = j->load != NULL ? prescribe(s, j) : neighbour;
    const bool done = pm_joint_couple(j, other, s->stage == 0, stage_weight(s),
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

// Energy and entropy that the stage's rate moves.
static void book_balance(pm_subsystem *s) {
    pm_balance_book(&s->balance, s->stage == 0, s->h * s->integrator->b[s->stage], s->nz, s->dE,
                    s->dS, s->k + (ptrdiff_t)s->stage * s->nz);
}

// Moves the new state to where it has what was booked. Its last exposure is that of the next stage.
static void balance(pm_subsystem *s) {
    for (int i = 0; i < MOST_MOVES; ++i) {
        pm_subsystem_expose(s);
        if (!pm_balance_move(&s->balance, &s->scene->layout, s->z, s->E[0], value_at(s->S, 0),
                             s->dE, s->dS, s->stage_z)) {
            return;
        }
        s->exposed = false;
    }
}

void pm_subsystem_advance(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    if (rk->balanced) {
        book_balance(s);
    }
    ++s->stage;
    s->exposed = false;
    if (s->stage < rk->nstage) {
        combine(s, s->stage, rk->a[s->stage], s->stage_z);
        return;
    }
    combine(s, rk->nstage, rk->b, s->stage_z);
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
    s->books.energy = s->E[0];
    s->books.entropy = value_at(s->S, 0);
    s->books.flux = s->flux;
    s->books.nflux = s->njoint;
    for (int i = 0; i < s->njoint; ++i) {
        s->flux[i] = s->joint[i].booking;
        if (s->joint[i].load != NULL) {
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
    s->exposed = s->exposure_known = s->bulk_known = false;
    for (int i = 0; i < s->njoint; ++i) {
        s->joint[i].known = false;
    }
    s->booking = (pm_books){0};
    clear_booking(s);
    pm_subsystem_expose(s);
    pm_balance_start(&s->balance, s->E[0], value_at(s->S, 0));
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

int pm_subsystem_memory(const pm_subsystem *s) {
    int count = COUNTS + FLUX * (1 + s->books.nflux) + BALANCE + 1 + 3 * s->nz + s->nz;
    for (int i = 0; i < s->njoint; ++i) {
        count += pm_joint_memory(&s->joint[i]);
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

static double *put_bulk(const pm_subsystem *s, double *memory) {
    const double *const input[] = {s->bulk_z, s->bulk_dE, s->bulk_dS};
    *memory++ = s->bulk_known;
    for (int i = 0; i < 3; ++i, memory += s->nz) {
        for (int c = 0; c < s->nz; ++c) {
            memory[c] = value_at(input[i], c);
        }
    }
    return memory;
}

static const double *get_bulk(pm_subsystem *s, const double *memory) {
    double *const input[] = {s->bulk_z, s->bulk_dE, s->bulk_dS};
    s->bulk_known = *memory++ != 0;
    for (int i = 0; i < 3; ++i, memory += s->nz) {
        copy(input[i], memory, s->nz);
    }
    if (s->bulk_known) {
        pm_program_run(s->bulk, 1);
    }
    return memory;
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
    memory = put_bulk(s, memory);
    for (int i = 0; i < s->njoint; ++i) {
        pm_joint_save(&s->joint[i], memory);
        memory += pm_joint_memory(&s->joint[i]);
    }
    copy(memory, s->z, s->nz);
}

void pm_subsystem_restore(pm_subsystem *s, const double *memory) {
    const double *count = memory;
    pm_subsystem_set_state(s, memory + pm_subsystem_memory(s) - s->nz);
    s->step = (long)count[0];
    s->booking.evaluated = s->books.evaluated = (long)count[1];
    s->booking.skipped = s->books.skipped = (long)count[2];
    s->booking.outside = s->books.outside = (long)count[3];
    memory = get_flux(&s->books.bulk, memory + COUNTS);
    for (int i = 0; i < s->books.nflux; ++i) {
        memory = get_flux(&s->flux[i], memory);
    }
    s->balance = s->safe_balance = (pm_balance){memory[0], memory[1], memory[2], memory[3]};
    memory = get_bulk(s, memory + BALANCE);
    for (int i = 0; i < s->njoint; ++i) {
        pm_joint_restore(&s->joint[i], memory);
        memory += pm_joint_memory(&s->joint[i]);
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
    if (isfinite(s->E[0]) && isfinite(value_at(s->S, 0))) {
        return PM_OK;
    }
    return pm_fail(PM_ENUMERIC,
                   "subsystem %s: energy %g, entropy %g: the state left what the weights were "
                   "trained on",
                   s->scene->name, s->E[0], value_at(s->S, 0));
}

// Counts states outside the region the weights were trained on, as far as the scene's guard allows.
static pm_status check_region(pm_subsystem *s) {
    const pm_departure d = pm_region_departure(&s->system->part[s->id], s->z);
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
    if (s->load == NULL || s->step < s->load->end) {
        return PM_OK;
    }
    return pm_fail(PM_EDATA,
                   "subsystem %s: what its load follows ends after %ld steps: take fewer steps, or "
                   "a longer trajectory",
                   s->scene->name, s->load->end);
}

pm_status pm_subsystem_end_step(pm_subsystem *s) {
    assert(s->stage == 0 && s->substep == s->substeps);
    s->substep = 0;
    pm_status status = check_finite(s);
    if (status == PM_OK) {
        pm_subsystem_expose(s);
        status = check_potentials(s);
    }
    if (status == PM_OK) {
        status = check_load(s);
    }
    if (status == PM_OK) {
        status = check_region(s);
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
    int world = s->njoint;
    for (int k = 0; k < s->njoint; ++k) {
        const pm_joint *j = &s->joint[k];
        sample->flux[j->port_id][j->end] = books->flux[k];
        if (j->load != NULL) {
            sample->flux[j->port_id][1 - j->end] = books->flux[world++];
        }
    }
}

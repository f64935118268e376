// One subsystem: three kinds of graph (exposure, bulk, one per port) around a Runge-Kutta state.
#include "sim/subsystem.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"

// One port as this subsystem sees it.
typedef struct joint {
    int port_id;
    pm_end end;
    int ny;
    const int *component; // [ny] position in z of what is exposed
    pm_port_values shown; // what it shows: arrays below
    double *y, *e, *eta, *response;
    // The port law's graph, and where its numbers go in and out. NULL where a law needs none.
    pm_program *program;
    struct {
        double *y, *e, *eta, *response;
        int ny;
    } input[2];
    const double *rate;  // [ny]; NULL if the law gives nothing
    const double *law_e; // [ny] co-energies the law was evaluated at: own e, or its prediction
    // [nboth] irreversible rate of the iteration before, and of this one; NULL if not predicted
    double *last;
    const double *next;
    int nboth;
    pm_flux flux;    // booked over the last step
    pm_flux booking; // over the step under way
} joint;

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

    pm_program *exposure;               // z -> E, S, dE, dS
    double *exposure_z, *exposure_from; // stage state; start of the substep if discrete, else NULL
    const double *E, *S, *dE, *dS, *response;
    pm_program *bulk; // z, dE, dS -> rate; NULL if nothing acts inside
    double *bulk_z, *bulk_dE, *bulk_dS;
    const double *bulk_rate;

    int njoint;
    joint *joint;
    pm_books books, booking;
    pm_flux *flux; // [njoint] for books
};

// --- building the graphs ---

// By how much dE rises per unit of rate, where a port's prediction asks for it.
static pm_node build_response(pm_subsystem *s, pm_graph *g, const pm_part *part, pm_node dE,
                              pm_node z) {
    bool *wanted = pm_arena_array(&s->arena, (size_t)s->nz, sizeof *wanted);
    if (wanted == NULL || !s->integrator->discrete) {
        return PM_NO_NODE;
    }
    pm_system_responding(s->system, s->id, wanted);
    const pm_node response = pm_part_response(g, part, dE, z, wanted);
    return response == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, response, s->h);
}

static pm_status open_exposure(pm_subsystem *s, const pm_part *part) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, s->nz);
    const pm_node from = s->integrator->discrete ? pm_input(g, true, 1, s->nz) : PM_NO_NODE;
    const pm_node E = pm_part_energy(g, part, z), S = pm_part_entropy(g, part, z);
    pm_node dE, dS;
    pm_part_coenergies(g, part, from, z, &dE, &dS);
    const pm_node wanted[] = {E, S, dE, dS, build_response(s, g, part, dE, z)};
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

// What both ends show, as inputs of the law's graph.
static void build_inputs(const pm_subsystem *s, pm_graph *g, const joint *j, pm_port_nodes end[2]) {
    const pm_scene_port *scene = &s->system->scene->port[j->port_id];
    for (int i = 0; i < 2; ++i) {
        const int ny = scene->layout[i].nz;
        const bool entropy = pm_part_has_entropy(&s->system->part[scene->subsystem[i]]);
        end[i] = (pm_port_nodes){pm_input(g, true, 1, ny), pm_input(g, true, 1, ny),
                                 entropy ? pm_input(g, true, 1, ny) : PM_NO_NODE,
                                 s->integrator->discrete ? pm_input(g, true, 1, ny) : PM_NO_NODE};
    }
}

static double *value_of(pm_program *program, pm_node x) {
    return x == PM_NO_NODE ? NULL : pm_program_value(program, x);
}

static pm_status open_law(pm_subsystem *s, joint *j) {
    const pm_port_model *model = &s->system->port[j->port_id];
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    pm_port_nodes end[2];
    build_inputs(s, g, j, end);
    const pm_port_nodes shown[2] = {end[0], end[1]};
    const pm_node last = pm_input(g, true, 1, j->nboth);
    pm_node next, degeneracy = PM_NO_NODE;
    const pm_node rate = pm_port_rate(g, model, j->end, end, last, &next, &degeneracy);
    pm_status status = PM_OK;
    if (rate != PM_NO_NODE) {
        const pm_node output[] = {rate, end[j->end].e, next};
        status = pm_program_open(&j->program, g, next == PM_NO_NODE ? 2 : 3, output, 1);
    }
    if (j->program != NULL) {
        for (int i = 0; i < 2; ++i) {
            j->input[i].ny = model->layout[i].nz;
            j->input[i].y = value_of(j->program, shown[i].y);
            j->input[i].e = value_of(j->program, shown[i].e);
            j->input[i].eta = value_of(j->program, shown[i].eta);
            j->input[i].response = value_of(j->program, shown[i].response);
        }
        j->rate = value_of(j->program, rate);
        j->law_e = value_of(j->program, end[j->end].e);
        j->next = value_of(j->program, next);
        j->last = next == PM_NO_NODE ? NULL : value_of(j->program, last);
    }
    pm_graph_close(g);
    return status;
}

static pm_status open_joint(pm_subsystem *s, joint *j, int port_id, pm_end end) {
    const pm_scene_port *scene = &s->system->scene->port[port_id];
    *j = (joint){.port_id = port_id,
                 .end = end,
                 .ny = scene->layout[end].nz,
                 .nboth = scene->layout[0].nz + scene->layout[1].nz,
                 .component = scene->component[end]};
    const ptrdiff_t ny = j->ny;
    double *memory = pm_arena_array(&s->arena, 4 * (size_t)ny, sizeof *memory);
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for port %s", scene->name);
    }
    j->y = memory;
    j->e = memory + ny;
    j->eta = memory + 2 * ny;
    j->response = memory + 3 * ny;
    j->shown =
        (pm_port_values){j->ny, j->y, j->e, j->eta, s->integrator->discrete ? j->response : NULL};
    return open_law(s, j);
}

static pm_status open_joints(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    s->joint = pm_arena_array(&s->arena, 2 * (size_t)scene->nport, sizeof *s->joint);
    s->flux = pm_arena_array(&s->arena, 2 * (size_t)scene->nport, sizeof *s->flux);
    if (s->joint == NULL || s->flux == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the ports of %s", s->scene->name);
    }
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            if (scene->port[i].subsystem[end] == s->id) {
                PM_TRY(open_joint(s, &s->joint[s->njoint++], i, (pm_end)end));
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
                       "ln|x|, |x|^2 and <x,y> alone; subsystem %s has others",
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
            pm_program_close(subsystem->joint[i].program);
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

int pm_subsystem_rounds(const pm_subsystem *s) {
    return s->substeps * s->integrator->nstage;
}

const double *pm_subsystem_state(const pm_subsystem *s) {
    return s->z;
}

const pm_port_values *pm_subsystem_values(const pm_subsystem *s, int port) {
    return &s->joint[port].shown;
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
    copy(s->exposure_z, s->stage_z, s->nz);
    copy(s->exposure_from, s->z, s->nz);
    pm_program_run(s->exposure, 1);
    for (int c = 0; c < s->nz; ++c) {
        s->at_z[c] = s->integrator->discrete ? 0.5 * (s->z[c] + s->stage_z[c]) : s->stage_z[c];
    }
    for (int i = 0; i < s->njoint; ++i) {
        joint *j = &s->joint[i];
        for (int c = 0; c < j->ny; ++c) {
            j->y[c] = s->at_z[j->component[c]];
            j->e[c] = value_at(s->dE, j->component[c]);
            j->eta[c] = value_at(s->dS, j->component[c]);
            j->response[c] = value_at(s->response, j->component[c]);
        }
    }
    s->exposed = true;
}

// Adds one term's power and entropy production, weighted by the stage.
static void book(double weight, int n, const double *e, const double *eta, const double *rate,
                 double total[2], double gross[2]) {
    for (int i = 0; i < n; ++i) {
        const double power = value_at(e, i) * rate[i], production = value_at(eta, i) * rate[i];
        total[0] += weight * power;
        total[1] += weight * production;
        gross[0] += weight * fabs(power);
        gross[1] += weight * fabs(production);
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
    copy(s->bulk_z, s->at_z, s->nz);
    copy(s->bulk_dE, s->dE, s->nz);
    copy(s->bulk_dS, s->dS, s->nz);
    pm_program_run(s->bulk, 1);
    memcpy(k, s->bulk_rate, (size_t)s->nz * sizeof *k);
    double total[2] = {0}, gross[2] = {0};
    book(stage_weight(s), s->nz, s->dE, s->dS, k, total, gross);
    s->booking.bulk_energy += total[0];
    s->booking.bulk_entropy += total[1];
    s->booking.bulk_gross[0] += gross[0];
    s->booking.bulk_gross[1] += gross[1];
    ++s->booking.evaluated;
}

void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour) {
    joint *j = &s->joint[port];
    if (j->program == NULL) {
        ++s->booking.skipped;
        return;
    }
    const pm_port_values *shown[2];
    shown[j->end] = &j->shown;
    shown[1 - j->end] = neighbour;
    for (int i = 0; i < 2; ++i) {
        assert(shown[i]->ny == j->input[i].ny);
        copy(j->input[i].y, shown[i]->y, shown[i]->ny);
        copy(j->input[i].e, shown[i]->e, shown[i]->ny);
        copy(j->input[i].eta, shown[i]->eta, shown[i]->ny);
        copy(j->input[i].response, shown[i]->response, shown[i]->ny);
    }
    if (j->last != NULL && s->stage == 0) {
        memset(j->last, 0, (size_t)j->nboth * sizeof *j->last);
    }
    pm_program_run(j->program, 1);
    copy(j->last, j->next, j->nboth);
    double *k = s->k + (ptrdiff_t)s->stage * s->nz;
    for (int c = 0; c < j->ny; ++c) {
        k[j->component[c]] += j->rate[c];
    }
    double total[2] = {0}, gross[2] = {0};
    book(stage_weight(s), j->ny, j->law_e, j->eta, j->rate, total, gross);
    j->booking.energy += total[0];
    j->booking.entropy += total[1];
    j->booking.energy_gross += gross[0];
    j->booking.entropy_gross += gross[1];
    ++s->booking.evaluated;
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

void pm_subsystem_advance(pm_subsystem *s) {
    const pm_integrator *rk = s->integrator;
    ++s->stage;
    if (s->stage < rk->nstage) {
        combine(s, s->stage, rk->a[s->stage], s->stage_z);
    } else {
        combine(s, rk->nstage, rk->b, s->z);
        copy(s->stage_z, s->z, s->nz);
        s->stage = 0;
        ++s->substep;
    }
    s->exposed = false;
}

// --- one step ---

static void clear_booking(pm_subsystem *s) {
    const long evaluated = s->booking.evaluated, skipped = s->booking.skipped;
    s->booking = (pm_books){.evaluated = evaluated, .skipped = skipped};
    for (int i = 0; i < s->njoint; ++i) {
        s->joint[i].booking = (pm_flux){0};
    }
}

static void close_books(pm_subsystem *s) {
    s->books = s->booking;
    s->books.energy = s->E[0];
    s->books.entropy = value_at(s->S, 0);
    s->books.flux = s->flux;
    for (int i = 0; i < s->njoint; ++i) {
        s->flux[i] = s->joint[i].booking;
    }
    clear_booking(s);
}

void pm_subsystem_set_state(pm_subsystem *s, const double *z) {
    memmove(s->z, z, (size_t)s->nz * sizeof *z);
    copy(s->stage_z, s->z, s->nz);
    copy(s->safe_z, s->z, s->nz);
    s->stage = s->substep = 0;
    s->exposed = false;
    s->booking = (pm_books){0};
    clear_booking(s);
    pm_subsystem_expose(s);
    close_books(s);
}

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

pm_status pm_subsystem_end_step(pm_subsystem *s) {
    assert(s->stage == 0 && s->substep == s->substeps);
    s->substep = 0;
    pm_status status = check_finite(s);
    if (status == PM_OK) {
        pm_subsystem_expose(s);
        status = check_potentials(s);
    }
    if (status != PM_OK) {
        copy(s->z, s->safe_z, s->nz);
        copy(s->stage_z, s->z, s->nz);
        s->exposed = false;
        return status;
    }
    copy(s->safe_z, s->z, s->nz);
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
    sample->bulk_energy[i] = books->bulk_energy;
    sample->bulk_entropy[i] = books->bulk_entropy;
    sample->bulk_gross[2 * i] = books->bulk_gross[0];
    sample->bulk_gross[2 * i + 1] = books->bulk_gross[1];
    sample->evaluated[i] = books->evaluated;
    sample->skipped[i] = books->skipped;
    for (int j = 0; j < s->njoint; ++j) {
        sample->flux[s->joint[j].port_id][s->joint[j].end] = books->flux[j];
    }
}

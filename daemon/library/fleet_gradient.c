// A block of copies is carried through its rollout in the lanes of programs that compute the rates
// of the whole scene at one stage, and multiply their Jacobian from the left or from the right.
#include "library/fleet_gradient.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/lanes.h"
#include "library/rates.h"

// The most numbers of states that a reverse pass keeps, unless checkpoints at the square root of
// the number of steps need more.
#define KEPT ((int64_t)1 << 18)
#define PROGRAMS (2 * PM_RATES_TASKS) // of a worker
#define MOST_SUBSTEPS ((int64_t)1 << 40)

// A matrix of weights, and the position of its first number among all weights.
typedef struct matrix {
    const pm_param_entry *entry;
    int component, first;
} matrix;

struct pm_fleet_gradient {
    pm_arena arena;
    int nworker, lanes, nweight, nmatrix;
    matrix *matrix;               // [nmatrix]
    const pm_param_entry **entry; // [nmatrix] the same
    pm_rates *program; // [nworker][PM_RATES_TASKS][2] without and with derivatives by weights
};

// --- weights ---

// Lists the matrices, or counts them if `list` is NULL. Returns the number of weights.
static int list_matrices(const pm_system *system, int *count, matrix *list) {
    int first = 0, n = 0;
    for (int c = 0; c < pm_system_components(system); ++c) {
        const pm_params *params = pm_system_params(system, c);
        for (int i = 0; i < params->count && system->owner[c] == c; ++i) {
            const pm_param_entry *entry = &params->entry[i];
            if (entry->trained && list != NULL) {
                list[n] = (matrix){entry, c, first};
            }
            n += entry->trained;
            first += entry->trained ? entry->rows * entry->cols : 0;
        }
    }
    *count = n;
    return first;
}

int pm_fleet_weights(const pm_system *system) {
    int count;
    return list_matrices(system, &count, NULL);
}

pm_status pm_fleet_weight_names(const pm_system *system, int *count, const char ***names,
                                pm_arena *arena) {
    const pm_physics *physics = &system->scene->physics;
    list_matrices(system, count, NULL);
    matrix *list = pm_arena_array(arena, (size_t)*count, sizeof *list);
    *names = pm_arena_array(arena, (size_t)*count, sizeof **names);
    PM_TRY(pm_arena_status(arena, "the names of weights"));
    list_matrices(system, count, list);
    for (int i = 0; i < *count; ++i) {
        const int id = list[i].component, port = id - physics->nsubsystem;
        const pm_param_entry *entry = list[i].entry;
        (*names)[i] =
            pm_arena_printf(arena, "%s.%s[%d][%d]",
                            port < 0 ? physics->subsystem[id].name : physics->port[port].name,
                            entry->name, entry->rows, entry->cols);
    }
    return pm_arena_status(arena, "the names of weights");
}

// --- programs ---

static void close_programs(pm_fleet_gradient *f, int nworker) {
    for (int i = 0; i < nworker * PROGRAMS && f->program != NULL; ++i) {
        pm_rates_close(&f->program[i]);
    }
}

static void close_gradient(pm_fleet_gradient *gradient) {
    close_programs(gradient, gradient->nworker);
    PM_DELETE(gradient);
}

// Opens the programs of some tasks, for all workers, unless they are open.
static pm_status open_tasks(pm_fleet *fleet, int ntask, const pm_rates_task *tasks, bool weights) {
    if (fleet->gradient == NULL) {
        pm_fleet_gradient *f = fleet->gradient = calloc(1, sizeof *f);
        PM_TRY(pm_allocated(f, "derivatives"));
        fleet->close_gradient = close_gradient;
        f->nworker = fleet->nworker;
        f->lanes = pm_rates_lanes(fleet->count);
        f->nweight = pm_fleet_weights(fleet->setup->system);
        list_matrices(fleet->setup->system, &f->nmatrix, NULL);
        f->matrix = pm_arena_array(&f->arena, (size_t)f->nmatrix, sizeof *f->matrix);
        f->entry = pm_arena_array(&f->arena, (size_t)f->nmatrix, sizeof *f->entry);
        f->program = pm_arena_array(&f->arena, (size_t)f->nworker * PROGRAMS, sizeof *f->program);
        PM_TRY(pm_arena_status(&f->arena, "derivatives"));
        list_matrices(fleet->setup->system, &f->nmatrix, f->matrix);
        for (int i = 0; i < f->nmatrix; ++i) {
            f->entry[i] = f->matrix[i].entry;
        }
    }
    pm_fleet_gradient *f = fleet->gradient;
    bool served = true;
    for (int i = 0; i < f->nworker * ntask && served; ++i) {
        const bool with = weights && tasks[i % ntask] != PM_RATES;
        pm_rates *r = &f->program[i / ntask * PROGRAMS + 2 * (int)tasks[i % ntask] + with];
        if (r->program == NULL) {
            PM_TRY(pm_rates_open(r, fleet->setup->system, tasks[i % ntask], f->lanes,
                                 with ? f->nmatrix : 0, f->entry));
            served = r->program != NULL;
        }
    }
    if (!served) {
        close_programs(f, f->nworker);
        f->lanes = 1;
        return open_tasks(fleet, ntask, tasks, weights);
    }
    return PM_OK;
}

// --- a rollout ---

// Memory of one worker. Arrays of states are [nz][lanes].
typedef struct space {
    double *z, *dz;      // the present states and their tangents
    double *k, *dk;      // [nstage] rates of the stages
    double *kept;        // [nsegment] states before the first substep of each segment
    double *stage;       // [segment][nstage] states of the stages of a segment
    double *nu, *mu;     // [nstage + 1], and one: adjoints of the stages; the last is that of z
    double *zero;        // a state of zeros
    double *by_u, *by_w; // [nprescribed or nweight][lanes] sums over substeps
    double *row;         // [nprescribed]
    uint64_t *changed;   // [lanes] unused results of pm_lanes_combine
} space;

typedef struct call {
    pm_fleet *fleet;
    pm_fleet_gradient *f;
    const pm_fleet_rollout *rollout;
    const pm_integrator *rk;
    bool weights;
    double h;                  // s, of a substep
    int64_t piece, nsubstep;   // substeps of a piece, and of the rollout
    int64_t segment, nsegment; // substeps of a segment
    const double *in[3];       // seed; or directions of start, inputs and weights
    double *out[3];            // by_start, by_input, by_weight; or z, dz
    space *space;              // [nworker]
} call;

// A block of copies in the lanes of a worker.
typedef struct copy_block {
    const call *call;
    const space *space;
    pm_copies copies;
    pm_rates *program; // [PM_RATES_TASKS][2]
    int nz, size;      // size: nz lanes
} copy_block;

static pm_rates *program_of(const copy_block *b, pm_rates_task task) {
    return &b->program[2 * task + (b->call->weights && task != PM_RATES)];
}

static void add(int n, const double *x, double *sum) {
    for (int i = 0; i < n && x != NULL; ++i) {
        sum[i] += x[i];
    }
}

// Lets the programs see the inputs of a piece.
static void begin_piece(copy_block *b, int64_t piece) {
    const pm_fleet *fleet = b->call->fleet;
    const double *input = b->call->rollout->input;
    const int n = fleet->setup->scene->physics.nprescribed;
    b->copies.held = input == NULL ? fleet->input : input + piece * fleet->count * n;
}

// Copies a result, or zeros if it is NULL.
static void copy_state(const copy_block *b, const double *from, double *to) {
    memcpy(to, from == NULL ? b->space->zero : from, (size_t)b->size * sizeof *to);
}

// Takes substep number s from z to z, and keeps the states of its stages in stage [nstage].
static void take_substep(copy_block *b, int64_t s, double *stage) {
    const space *w = b->space;
    begin_piece(b, s / b->call->piece);
    pm_rates_substep(program_of(b, PM_RATES), &b->copies, s, w->z, w->k, stage, b->size);
}

// Takes the adjoint of the state back through substep number s, whose stages have the states stage
// [nstage]:
//     mu_i = h (b_i lambda + sum_{j > i} a_ji nu_j),   nu_i = k_z^T mu_i,   lambda += sum_i nu_i
static void reverse_substep(copy_block *b, int64_t s, const double *stage) {
    const space *w = b->space;
    const pm_integrator *rk = b->call->rk;
    pm_rates *p = program_of(b, PM_ADJOINT);
    const pm_fleet_gradient *f = b->call->f;
    double *lambda = w->nu + (ptrdiff_t)rk->nstage * b->size, weight[PM_MAX_STAGES + 1];
    begin_piece(b, s / b->call->piece);
    for (int i = rk->nstage - 1; i >= 0; --i) {
        for (int j = i + 1; j < rk->nstage; ++j) {
            weight[j - i - 1] = rk->a[j][i];
        }
        weight[rk->nstage - i - 1] = rk->b[i];
        pm_copies_combine(&b->copies, rk->nstage - i, weight, b->call->h, w->zero,
                          w->nu + (ptrdiff_t)(i + 1) * b->size, w->mu);
        if (p->seed != NULL) {
            copy_state(b, w->mu, p->seed);
        }
        pm_rates_run(p, &b->copies, s, i, stage + (ptrdiff_t)i * b->size);
        copy_state(b, p->by_z, w->nu + (ptrdiff_t)i * b->size);
        add(b->call->fleet->setup->scene->physics.nprescribed * b->copies.lanes, p->by_u, w->by_u);
        for (int k = 0; k < f->nmatrix && b->call->weights; ++k) {
            const matrix *m = &f->matrix[k];
            add(m->entry->rows * m->entry->cols * b->copies.lanes, p->by_w[k],
                w->by_w + (ptrdiff_t)m->first * b->copies.lanes);
        }
    }
    for (int i = 0; i < rk->nstage; ++i) {
        weight[i] = 1;
    }
    pm_copies_combine(&b->copies, rk->nstage, weight, 1, lambda, w->nu, lambda);
}

static void begin_block(copy_block *b, const call *c, int worker, int64_t number) {
    const pm_fleet *fleet = c->fleet;
    const space *w = &c->space[worker];
    const int lanes = c->f->lanes;
    const int64_t first = number * lanes, left = fleet->count - first;
    *b = (copy_block){.call = c, .space = w, .program = &c->f->program[worker * PROGRAMS]};
    b->copies = (pm_copies){.setup = fleet->setup,
                            .lanes = lanes,
                            .used = left < lanes ? (int)left : lanes,
                            .copy = fleet->chosen + first,
                            .step = fleet->step,
                            .row = w->row,
                            .changed = w->changed};
    b->nz = fleet->setup->scene->physics.nz;
    b->size = b->nz * lanes;
    for (int t = 0; t < PROGRAMS; ++t) {
        b->program[t].shown = NULL;
    }
    const double *start = c->rollout->start == NULL ? fleet->z : c->rollout->start;
    pm_copies_gather(&b->copies, b->nz, start, w->z);
}

static void reverse_block(void *context, int worker, int64_t number) {
    const call *c = context;
    copy_block b;
    begin_block(&b, c, worker, number);
    const space *w = b.space;
    const int n = c->fleet->setup->scene->physics.nprescribed;
    const ptrdiff_t all = c->fleet->count, substep = (ptrdiff_t)c->rk->nstage * b.size;
    double *lambda = w->nu + substep;
    for (int64_t i = 0; i < c->nsegment; ++i) {
        copy_state(&b, w->z, w->kept + i * b.size);
        for (int64_t s = 0; s < c->segment && i + 1 < c->nsegment; ++s) {
            take_substep(&b, i * c->segment + s, w->stage);
        }
    }
    copy_state(&b, NULL, lambda);
    memset(w->by_u, 0, (size_t)(n * b.copies.lanes) * sizeof *w->by_u);
    memset(w->by_w, 0, (size_t)c->f->nweight * (size_t)b.copies.lanes * sizeof *w->by_w);
    for (int64_t i = c->nsegment - 1; i >= 0; --i) {
        const int64_t begin = i * c->segment, left = c->nsubstep - begin;
        const int64_t count = left < c->segment ? left : c->segment;
        copy_state(&b, w->kept + i * b.size, w->z);
        for (int64_t s = 0; s < count; ++s) {
            take_substep(&b, begin + s, w->stage + s * substep);
        }
        for (int64_t s = begin + count - 1; s >= begin; --s) {
            const ptrdiff_t piece = s / c->piece;
            if ((s + 1) % c->piece == 0) {
                pm_copies_gather(&b.copies, b.nz, c->in[0] + piece * all * b.nz, w->mu);
                add(b.size, w->mu, lambda);
            }
            reverse_substep(&b, s, w->stage + (s - begin) * substep);
            if (s % c->piece == 0 && c->out[1] != NULL) {
                pm_copies_scatter(&b.copies, n, w->by_u, c->out[1] + piece * all * n);
                memset(w->by_u, 0, (size_t)(n * b.copies.lanes) * sizeof *w->by_u);
            }
        }
    }
    pm_copies_scatter(&b.copies, b.nz, lambda, c->out[0]);
    pm_copies_scatter(&b.copies, c->f->nweight, w->by_w, c->out[2]);
}

static void forward_block(void *context, int worker, int64_t number) {
    const call *c = context;
    copy_block b;
    begin_block(&b, c, worker, number);
    const space *w = b.space;
    const pm_integrator *rk = c->rk;
    pm_rates *p = program_of(&b, PM_TANGENT);
    const int n = c->fleet->setup->scene->physics.nprescribed;
    const ptrdiff_t all = c->fleet->count;
    pm_copies_gather(&b.copies, b.nz, c->in[0], w->dz);
    pm_copies_gather(&b.copies, c->f->nweight, c->in[2], w->by_w);
    for (int i = 0; i < c->f->nmatrix && c->weights; ++i) {
        const matrix *m = &c->f->matrix[i];
        if (p->dw[i] != NULL) {
            memcpy(p->dw[i], w->by_w + (ptrdiff_t)m->first * b.copies.lanes,
                   (size_t)(m->entry->rows * m->entry->cols * b.copies.lanes) * sizeof *w->by_w);
        }
    }
    for (int64_t s = 0; s < c->nsubstep; ++s) {
        const ptrdiff_t piece = s / c->piece;
        if (s % c->piece == 0) {
            pm_copies_gather(&b.copies, n, c->in[1] == NULL ? NULL : c->in[1] + piece * all * n,
                             p->du);
        }
        begin_piece(&b, piece);
        for (int i = 0; i < rk->nstage; ++i) {
            const ptrdiff_t at = (ptrdiff_t)i * b.size;
            pm_copies_combine(&b.copies, i, rk->a[i], c->h, w->z, w->k, w->stage);
            if (p->dz != NULL) {
                pm_copies_combine(&b.copies, i, rk->a[i], c->h, w->dz, w->dk, p->dz);
            }
            pm_rates_run(p, &b.copies, s, i, w->stage);
            copy_state(&b, p->k, w->k + at);
            copy_state(&b, p->dk, w->dk + at);
        }
        pm_copies_combine(&b.copies, rk->nstage, rk->b, c->h, w->z, w->k, w->z);
        pm_copies_combine(&b.copies, rk->nstage, rk->b, c->h, w->dz, w->dk, w->dz);
        if ((s + 1) % c->piece == 0) {
            pm_copies_scatter(&b.copies, b.nz, w->z, c->out[0] + piece * all * b.nz);
            pm_copies_scatter(&b.copies, b.nz, w->dz, c->out[1] + piece * all * b.nz);
        }
    }
}

// --- calls ---

static pm_status open_space(const call *c, space *w, bool reverse, pm_arena *arena) {
    const pm_physics *physics = &c->fleet->setup->scene->physics;
    const size_t lanes = (size_t)c->f->lanes, size = (size_t)physics->nz * lanes;
    const size_t nstage = (size_t)c->rk->nstage, segment = reverse ? (size_t)c->segment : 1;
    struct {
        double **array;
        size_t count;
    } arrays[] = {{&w->z, size},
                  {&w->dz, size},
                  {&w->k, nstage * size},
                  {&w->dk, nstage * size},
                  {&w->kept, (size_t)c->nsegment * size},
                  {&w->stage, segment * nstage * size},
                  {&w->nu, (nstage + 1) * size},
                  {&w->mu, size},
                  {&w->zero, size},
                  {&w->by_u, (size_t)physics->nprescribed * lanes + 1},
                  {&w->by_w, (size_t)c->f->nweight * lanes + 1},
                  {&w->row, (size_t)physics->nprescribed + 1}};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i) {
        *arrays[i].array = pm_arena_array(arena, arrays[i].count, sizeof(double));
    }
    w->changed = pm_arena_array(arena, lanes, sizeof *w->changed);
    return pm_arena_status(arena, "a rollout of %lld substeps", (long long)c->nsubstep);
}

// Checks a call, opens what it needs, and lets all workers share its blocks.
static pm_status take(call *c, int ntask, const pm_rates_task *tasks,
                      void (*work)(void *context, int worker, int64_t block)) {
    pm_fleet *fleet = c->fleet;
    const pm_scene *scene = fleet->setup->scene;
    const pm_fleet_rollout *r = c->rollout;
    if (r->pieces < 1 || r->steps < 1 || r->pieces > MOST_SUBSTEPS / r->steps ||
        r->pieces * r->steps > MOST_SUBSTEPS / scene->physics.substeps) {
        return pm_fail(PM_EUSAGE,
                       "scene %s: a rollout of %lld times %lld steps: expected 1 to %lld "
                       "substeps in all",
                       scene->name, (long long)r->pieces, (long long)r->steps,
                       (long long)MOST_SUBSTEPS);
    }
    if (fleet->nrecord > 0) {
        return pm_fail(PM_ECONFIG,
                       "%s: scene %s: derivatives need the integrator euler, heun, rk4 or rk6, and "
                       "a fixed number of substeps",
                       scene->physics.integrator_at, scene->name);
    }
    PM_TRY(open_tasks(fleet, ntask, tasks, c->weights));
    pm_arena arena = {0};
    pm_status status = PM_OK;
    c->f = fleet->gradient;
    c->rk = scene->physics.integrator;
    c->h = scene->physics.dt / scene->physics.substeps;
    c->piece = r->steps * scene->physics.substeps;
    c->nsubstep = r->pieces * c->piece;
    const int64_t kept = KEPT / ((int64_t)scene->physics.nz * c->f->lanes * c->rk->nstage);
    c->segment = (int64_t)ceil(sqrt((double)c->nsubstep));
    c->segment = c->segment > kept ? c->segment : kept < c->nsubstep ? kept : c->nsubstep;
    c->nsegment = (c->nsubstep + c->segment - 1) / c->segment;
    c->space = pm_arena_array(&arena, (size_t)c->f->nworker, sizeof *c->space);
    PM_TRY_DONE(pm_arena_status(&arena, "a rollout"));
    for (int i = 0; i < c->f->nworker; ++i) {
        PM_TRY_DONE(open_space(c, &c->space[i], tasks[0] == PM_RATES, &arena));
    }
    for (int64_t i = 0; i < fleet->count; ++i) {
        fleet->chosen[i] = i;
    }
    pm_fleet_share(fleet, (fleet->count + c->f->lanes - 1) / c->f->lanes, work, c);
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_fleet_vjp(pm_fleet *fleet, const pm_fleet_rollout *rollout, const double *seed,
                       double *by_start, double *by_input, double *by_weight) {
    call c = {.fleet = fleet,
              .rollout = rollout,
              .weights = by_weight != NULL,
              .in = {seed},
              .out = {by_start, by_input, by_weight}};
    return take(&c, 2, (const pm_rates_task[]){PM_RATES, PM_ADJOINT}, reverse_block);
}

pm_status pm_fleet_jvp(pm_fleet *fleet, const pm_fleet_rollout *rollout, const double *d_start,
                       const double *d_input, const double *d_weight, double *z, double *dz) {
    call c = {.fleet = fleet,
              .rollout = rollout,
              .weights = d_weight != NULL,
              .in = {d_start, d_input, d_weight},
              .out = {z, dz}};
    return take(&c, 1, (const pm_rates_task[]){PM_TANGENT}, forward_block);
}

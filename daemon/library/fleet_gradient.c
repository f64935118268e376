// A block of copies is carried through its rollout in the lanes of programs that compute the rates
// of the whole scene at one stage, and multiply their Jacobian from the left or from the right.
#include "library/fleet_gradient.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/lanes.h"
#include "graph/compile.h"
#include "sim/lanes.h"
#include "sim/step_graph.h"

// What a program computes beside the rates k(z, u, weights).
typedef enum rate_task {
    RATES,
    ADJOINT, // k_z^T seed, k_u^T seed, k_weights^T seed
    TANGENT, // k_z dz + k_u du + k_weights dweights
    TASKS
} rate_task;

// States of so many numbers are kept for a reverse pass, or more if the square root demands it.
#define KEPT ((int64_t)1 << 18)
#define MOST_LANES 32 // more would drive the numbers of an adjoint out of the cache
#define MOST_SUBSTEPS ((int64_t)1 << 40)

// A matrix of weights, and the position of its first number among all weights.
typedef struct matrix {
    const pm_param_entry *entry;
    int component, first;
} matrix;

// A program of one worker. The arrays are [numbers][lanes]; NULL: nothing depends on an input, or a
// result is zero.
typedef struct rates_program {
    pm_program *program;
    double *z, *u, *seed;              // inputs
    double *dz, *du, **dw;             // [nmatrix] inputs
    const double *k, *dk;              // results
    const double *by_z, *by_u, **by_w; // [nmatrix]
    int64_t shown;                     // the piece whose inputs u holds; -1: none
} rates_program;

struct pm_fleet_gradient {
    pm_arena arena;
    int nworker, lanes, nweight, nmatrix;
    matrix *matrix;                     // [nmatrix]
    rates_program (*program)[TASKS][2]; // [nworker] each without and with derivatives by weights
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

// Builds the rates k [1][nz] of the whole scene at z [1][nz] with the inputs u [1][nprescribed].
static pm_status build_rates(pm_graph *g, const pm_system *system, pm_node z, pm_node u,
                             pm_arena *scratch, pm_node *k) {
    const pm_physics *physics = &system->scene->physics;
    const size_t n = (size_t)physics->nsubsystem;
    pm_state_nodes *state = pm_arena_array(scratch, n, sizeof *state);
    pm_node *last = pm_arena_array(scratch, (size_t)physics->nport + 1, sizeof *last);
    pm_node *part = pm_arena_array(scratch, n, sizeof *part);
    pm_node degeneracy = PM_NO_NODE;
    PM_TRY(pm_arena_status(scratch, "the rates of a scene"));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[i];
        state[i].z = state[i].to = pm_slice(g, z, s->first, s->layout.nz);
        state[i].from = state[i].response = PM_NO_NODE;
    }
    for (int i = 0; i < physics->nport; ++i) {
        last[i] = PM_NO_NODE;
    }
    pm_build_coenergies(g, system, state);
    pm_build_rates(g, system, state, u, last, &degeneracy);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const int nz = physics->subsystem[i].layout.nz;
        const pm_node rate = state[i].zdot;
        part[i] = rate == PM_NO_NODE ? pm_constant(g, 0, 1, nz) : rate;
        part[i] = pm_broadcast_to(g, part[i], (pm_shape){true, 1, nz});
    }
    *k = pm_concat(g, physics->nsubsystem, part);
    return PM_OK;
}

// Collects a result of a program.
static void add_output(pm_node *output, int *count, pm_node x) {
    if (x != PM_NO_NODE) {
        output[(*count)++] = x;
    }
}

static const double *value_of(pm_program *program, pm_node x) {
    return x == PM_NO_NODE ? NULL : pm_program_value(program, x);
}

// Opens a program for f->lanes copies. *served is false if it cannot be run in so many lanes.
static pm_status open_program(const pm_fleet *fleet, pm_fleet_gradient *f, rates_program *p,
                              rate_task task, bool weights, bool *served) {
    const pm_system *system = fleet->setup->system;
    const pm_physics *physics = &system->scene->physics;
    const int nmatrix = weights ? f->nmatrix : 0, n = physics->nprescribed;
    enum { Z, U, WEIGHTS };
    pm_arena scratch = {0};
    pm_graph *g = NULL;
    pm_compiler *compiler = NULL;
    pm_status status;
    const size_t count = WEIGHTS + (size_t)nmatrix;
    pm_node *x = pm_arena_array(&scratch, count, sizeof *x);
    pm_node *dx = pm_arena_array(&scratch, count, sizeof *dx);
    pm_node *output = pm_arena_array(&scratch, count + 1, sizeof *output);
    p->by_w = pm_arena_array(&f->arena, (size_t)f->nmatrix + 1, sizeof *p->by_w);
    p->dw = pm_arena_array(&f->arena, (size_t)f->nmatrix + 1, sizeof *p->dw);
    PM_TRY_DONE(pm_arena_status(&scratch, "derivatives of rates"));
    PM_TRY_DONE(pm_arena_status(&f->arena, "derivatives of rates"));
    PM_TRY_DONE(pm_graph_open(&g));
    if (weights) {
        pm_graph_weights_per_item(g);
    }
    x[Z] = pm_input(g, true, 1, physics->nz);
    x[U] = n > 0 ? pm_input(g, true, 1, n) : PM_NO_NODE;
    for (int i = 0; i < nmatrix; ++i) {
        const pm_param_entry *entry = f->matrix[i].entry;
        x[WEIGHTS + i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
    pm_node k, dk = PM_NO_NODE;
    const pm_node seed = pm_input(g, true, 1, physics->nz);
    PM_TRY_DONE(build_rates(g, system, x[Z], x[U], &scratch, &k));
    int noutput = 0;
    if (task != ADJOINT) {
        add_output(output, &noutput, k);
    }
    for (size_t i = 0; i < count; ++i) {
        const pm_shape shape =
            x[i] == PM_NO_NODE ? (pm_shape){true, 1, 1} : pm_graph_shape(g, x[i]);
        dx[i] = task == TANGENT && x[i] != PM_NO_NODE ? pm_input(g, true, shape.rows, shape.cols)
                                                      : PM_NO_NODE;
    }
    if (task == TANGENT) {
        dk = pm_tangent(g, k, (int)count, x, dx);
        dk = dk == PM_NO_NODE ? dk : pm_broadcast_to(g, dk, (pm_shape){true, 1, physics->nz});
        add_output(output, &noutput, dk);
    } else if (task == ADJOINT) {
        // Without inputs, the state stands for them.
        const pm_node u = x[U];
        x[U] = u == PM_NO_NODE ? x[Z] : u;
        pm_gradient(g, k, seed, (int)count, x, dx);
        dx[U] = u == PM_NO_NODE ? PM_NO_NODE : dx[U];
        for (size_t i = 0; i < count; ++i) {
            add_output(output, &noutput, dx[i]);
        }
        x[U] = u;
    }
    add_output(output, &noutput, noutput == 0 ? k : PM_NO_NODE);
    PM_TRY_DONE(pm_program_open_lanes(&p->program, g, noutput, output, f->lanes));
    *served = p->program != NULL;
    if (system->compiled) {
        PM_TRY_DONE(pm_compiler_open(&compiler));
        PM_TRY_DONE(pm_compiler_add(compiler, p->program, g));
        PM_TRY_DONE(pm_compiler_link(compiler));
    }
    if (*served) {
        p->z = pm_program_input(p->program, x[Z]);
        p->u = pm_program_input(p->program, x[U]);
        p->seed = pm_program_input(p->program, seed);
        p->k = task == ADJOINT ? NULL : value_of(p->program, k);
        p->dk = value_of(p->program, dk);
        p->dz = task == TANGENT ? pm_program_input(p->program, dx[Z]) : NULL;
        p->du = task == TANGENT ? pm_program_input(p->program, dx[U]) : NULL;
        p->by_z = task == ADJOINT ? value_of(p->program, dx[Z]) : NULL;
        p->by_u = task == ADJOINT ? value_of(p->program, dx[U]) : NULL;
        for (int i = 0; i < nmatrix; ++i) {
            const pm_node w = dx[WEIGHTS + i];
            p->by_w[i] = task == ADJOINT ? value_of(p->program, w) : NULL;
            p->dw[i] = task == TANGENT ? pm_program_input(p->program, w) : NULL;
        }
        pm_program_prepare(p->program);
    }
done:
    pm_compiler_close(compiler);
    pm_graph_close(g);
    pm_arena_free(&scratch);
    return status;
}

static void close_programs(pm_fleet_gradient *f, int nworker) {
    for (int i = 0; i < nworker && f->program != NULL; ++i) {
        for (int k = 0; k < TASKS * 2; ++k) {
            rates_program *p = &f->program[i][k / 2][k % 2];
            pm_program_close(p->program);
            *p = (rates_program){0};
        }
    }
}

void pm_fleet_gradient_close(pm_fleet_gradient *gradient) {
    if (gradient != NULL) {
        close_programs(gradient, gradient->nworker);
        pm_arena_free(&gradient->arena);
        free(gradient);
    }
}

// Opens the programs of some tasks, for all workers, unless they are open.
static pm_status open_tasks(pm_fleet *fleet, int ntask, const rate_task *tasks, bool weights) {
    if (fleet->gradient == NULL) {
        pm_fleet_gradient *f = fleet->gradient = calloc(1, sizeof *f);
        if (f == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for derivatives");
        }
        f->nworker = fleet->nworker;
        f->lanes = fleet->count == 1 ? 1
                   : fleet->count > MOST_LANES
                       ? MOST_LANES
                       : ((int)fleet->count + PM_LANES - 1) / PM_LANES * PM_LANES;
        f->nweight = list_matrices(fleet->setup->system, &f->nmatrix, NULL);
        f->matrix = pm_arena_array(&f->arena, (size_t)f->nmatrix, sizeof *f->matrix);
        f->program = pm_arena_array(&f->arena, (size_t)f->nworker, sizeof *f->program);
        PM_TRY(pm_arena_status(&f->arena, "derivatives"));
        list_matrices(fleet->setup->system, &f->nmatrix, f->matrix);
    }
    pm_fleet_gradient *f = fleet->gradient;
    bool served = true;
    for (int i = 0; i < f->nworker * ntask && served; ++i) {
        const rate_task task = tasks[i % ntask];
        const bool with = weights && task != RATES;
        rates_program *p = &f->program[i / ntask][task][with];
        if (p->program == NULL) {
            PM_TRY(open_program(fleet, f, p, task, with, &served));
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
    const pm_rollout *rollout;
    const pm_integrator *rk;
    bool weights;
    double h;                  // s, of a substep
    int64_t piece, nsubstep;   // substeps of a piece, and of the rollout
    int64_t segment, nsegment; // substeps of a segment
    const double *in[3];       // seed; or directions of start, inputs and weights
    double *out[3];            // by_start, by_input, by_weight; or z, dz
    space *space;              // [nworker]
} call;

// A block of copies in the lanes of a worker. Lanes behind the last copy repeat it.
typedef struct block {
    const call *call;
    const space *space;
    rates_program *program[TASKS];
    int64_t first;
    int used, lanes, nz, size; // size: nz lanes
} block;

// Copies rows from [count][n] of the block's copies to lanes to [n][lanes], NULL: zeros.
static void gather(const block *b, int n, const double *from, double *to) {
    for (int c = 0; c < n && to != NULL; ++c) {
        for (int l = 0; l < b->lanes; ++l) {
            const int64_t copy = b->first + (l < b->used ? l : b->used - 1);
            to[c * b->lanes + l] = from == NULL ? 0 : from[copy * n + c];
        }
    }
}

// Copies the other way.
static void scatter(const block *b, int n, const double *from, double *to) {
    for (int c = 0; c < n && to != NULL; ++c) {
        for (int l = 0; l < b->used; ++l) {
            to[(b->first + l) * n + c] = from[c * b->lanes + l];
        }
    }
}

static void add(int n, const double *x, double *sum) {
    for (int i = 0; i < n && x != NULL; ++i) {
        sum[i] += x[i];
    }
}

// Lets a program see the inputs at a stage of substep number s.
static void show_inputs(const block *b, rates_program *p, int64_t s, int stage) {
    const call *c = b->call;
    const pm_fleet *fleet = c->fleet;
    const pm_physics *physics = &fleet->setup->scene->physics;
    const int64_t piece = s / c->piece;
    const int n = physics->nprescribed;
    pm_boundary_input input = fleet->setup->boundary_input;
    if (p->u == NULL || (p->shown == piece && input.end == LONG_MAX)) {
        return;
    }
    const double *held =
        c->rollout->input == NULL ? fleet->input : c->rollout->input + piece * fleet->count * n;
    input.copies = 1;
    for (int l = 0; l < b->lanes; ++l) {
        const int64_t copy = b->first + (l < b->used ? l : b->used - 1);
        input.held = held + copy * n;
        pm_boundary_input_at(&input, (long)(fleet->step[copy] + s / physics->substeps),
                             ((double)(s % physics->substeps) + pm_integrator_time(c->rk, stage)) /
                                 physics->substeps,
                             b->space->row);
        for (int i = 0; i < n; ++i) {
            p->u[i * b->lanes + l] = b->space->row[i];
        }
    }
    p->shown = piece;
}

// Computes to = z + h sum_i weight_i k_i for `count` states k.
static void combine(const block *b, int count, const double *weight, double h, const double *z,
                    const double *k, double *to) {
    pm_lanes_combine(b->nz, b->lanes, count, weight, h, z, k, b->size, z, to, b->space->changed);
}

// Runs a program at the states z of a stage.
static void run(const block *b, rates_program *p, int64_t s, int stage, const double *z) {
    if (p->z != NULL) {
        memcpy(p->z, z, (size_t)b->size * sizeof *z);
    }
    show_inputs(b, p, s, stage);
    pm_program_run_prepared(p->program, b->lanes);
}

// Copies a result, or zeros if it is NULL.
static void copy_state(const block *b, const double *from, double *to) {
    memcpy(to, from == NULL ? b->space->zero : from, (size_t)b->size * sizeof *to);
}

// Takes substep number s from z to z, and keeps the states of its stages in stage [nstage].
static void take_substep(const block *b, int64_t s, double *stage) {
    const space *w = b->space;
    const pm_integrator *rk = b->call->rk;
    rates_program *p = b->program[RATES];
    for (int i = 0; i < rk->nstage; ++i) {
        double *at = stage + (ptrdiff_t)i * b->size;
        combine(b, i, rk->a[i], b->call->h, w->z, w->k, at);
        run(b, p, s, i, at);
        copy_state(b, p->k, w->k + (ptrdiff_t)i * b->size);
    }
    combine(b, rk->nstage, rk->b, b->call->h, w->z, w->k, w->z);
}

// Takes the adjoint of the state back through substep number s, whose stages have the states stage
// [nstage]:
//     mu_i = h (b_i lambda + sum_{j > i} a_ji nu_j),   nu_i = k_z^T mu_i,   lambda += sum_i nu_i
static void reverse_substep(const block *b, int64_t s, const double *stage) {
    const space *w = b->space;
    const pm_integrator *rk = b->call->rk;
    rates_program *p = b->program[ADJOINT];
    const pm_fleet_gradient *f = b->call->f;
    double *lambda = w->nu + (ptrdiff_t)rk->nstage * b->size, weight[PM_MAX_STAGES + 1];
    for (int i = rk->nstage - 1; i >= 0; --i) {
        for (int j = i + 1; j < rk->nstage; ++j) {
            weight[j - i - 1] = rk->a[j][i];
        }
        weight[rk->nstage - i - 1] = rk->b[i];
        combine(b, rk->nstage - i, weight, b->call->h, w->zero,
                w->nu + (ptrdiff_t)(i + 1) * b->size, w->mu);
        if (p->seed != NULL) {
            copy_state(b, w->mu, p->seed);
        }
        run(b, p, s, i, stage + (ptrdiff_t)i * b->size);
        copy_state(b, p->by_z, w->nu + (ptrdiff_t)i * b->size);
        add(b->call->fleet->setup->scene->physics.nprescribed * b->lanes, p->by_u, w->by_u);
        for (int k = 0; k < f->nmatrix && b->call->weights; ++k) {
            const matrix *m = &f->matrix[k];
            add(m->entry->rows * m->entry->cols * b->lanes, p->by_w[k],
                w->by_w + (ptrdiff_t)m->first * b->lanes);
        }
    }
    for (int i = 0; i < rk->nstage; ++i) {
        weight[i] = 1;
    }
    combine(b, rk->nstage, weight, 1, lambda, w->nu, lambda);
}

static void begin_block(block *b, const call *c, int worker, int64_t number) {
    const pm_fleet *fleet = c->fleet;
    *b = (block){.call = c, .space = &c->space[worker], .lanes = c->f->lanes};
    b->first = number * b->lanes;
    b->used = fleet->count - b->first < b->lanes ? (int)(fleet->count - b->first) : b->lanes;
    b->nz = fleet->setup->scene->physics.nz;
    b->size = b->nz * b->lanes;
    for (int t = 0; t < TASKS; ++t) {
        b->program[t] = &c->f->program[worker][t][c->weights && t != RATES];
        b->program[t]->shown = -1;
    }
    gather(b, b->nz, c->rollout->start == NULL ? fleet->z : c->rollout->start, b->space->z);
}

static void reverse_block(void *context, int worker, int64_t number) {
    const call *c = context;
    block b;
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
    memset(w->by_u, 0, (size_t)(n * b.lanes) * sizeof *w->by_u);
    memset(w->by_w, 0, (size_t)c->f->nweight * (size_t)b.lanes * sizeof *w->by_w);
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
                gather(&b, b.nz, c->in[0] + piece * all * b.nz, w->mu);
                add(b.size, w->mu, lambda);
            }
            reverse_substep(&b, s, w->stage + (s - begin) * substep);
            if (s % c->piece == 0 && c->out[1] != NULL) {
                scatter(&b, n, w->by_u, c->out[1] + piece * all * n);
                memset(w->by_u, 0, (size_t)(n * b.lanes) * sizeof *w->by_u);
            }
        }
    }
    scatter(&b, b.nz, lambda, c->out[0]);
    scatter(&b, c->f->nweight, w->by_w, c->out[2]);
}

static void forward_block(void *context, int worker, int64_t number) {
    const call *c = context;
    block b;
    begin_block(&b, c, worker, number);
    const space *w = b.space;
    const pm_integrator *rk = c->rk;
    rates_program *p = b.program[TANGENT];
    const int n = c->fleet->setup->scene->physics.nprescribed;
    const ptrdiff_t all = c->fleet->count;
    gather(&b, b.nz, c->in[0], w->dz);
    gather(&b, c->f->nweight, c->in[2], w->by_w);
    for (int i = 0; i < c->f->nmatrix && c->weights; ++i) {
        const matrix *m = &c->f->matrix[i];
        if (p->dw[i] != NULL) {
            memcpy(p->dw[i], w->by_w + (ptrdiff_t)m->first * b.lanes,
                   (size_t)(m->entry->rows * m->entry->cols * b.lanes) * sizeof *w->by_w);
        }
    }
    for (int64_t s = 0; s < c->nsubstep; ++s) {
        const ptrdiff_t piece = s / c->piece;
        if (s % c->piece == 0) {
            gather(&b, n, c->in[1] == NULL ? NULL : c->in[1] + piece * all * n, p->du);
        }
        for (int i = 0; i < rk->nstage; ++i) {
            const ptrdiff_t at = (ptrdiff_t)i * b.size;
            combine(&b, i, rk->a[i], c->h, w->z, w->k, w->stage);
            if (p->dz != NULL) {
                combine(&b, i, rk->a[i], c->h, w->dz, w->dk, p->dz);
            }
            run(&b, p, s, i, w->stage);
            copy_state(&b, p->k, w->k + at);
            copy_state(&b, p->dk, w->dk + at);
        }
        combine(&b, rk->nstage, rk->b, c->h, w->z, w->k, w->z);
        combine(&b, rk->nstage, rk->b, c->h, w->dz, w->dk, w->dz);
        if ((s + 1) % c->piece == 0) {
            scatter(&b, b.nz, w->z, c->out[0] + piece * all * b.nz);
            scatter(&b, b.nz, w->dz, c->out[1] + piece * all * b.nz);
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
static pm_status take(call *c, int ntask, const rate_task *tasks,
                      void (*work)(void *context, int worker, int64_t block)) {
    pm_fleet *fleet = c->fleet;
    const pm_scene *scene = fleet->setup->scene;
    const pm_rollout *r = c->rollout;
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
        PM_TRY_DONE(open_space(c, &c->space[i], tasks[0] == RATES, &arena));
    }
    pm_fleet_share(fleet, (fleet->count + c->f->lanes - 1) / c->f->lanes, work, c);
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_fleet_vjp(pm_fleet *fleet, const pm_rollout *rollout, const double *seed,
                       double *by_start, double *by_input, double *by_weight) {
    call c = {.fleet = fleet,
              .rollout = rollout,
              .weights = by_weight != NULL,
              .in = {seed},
              .out = {by_start, by_input, by_weight}};
    return take(&c, 2, (const rate_task[]){RATES, ADJOINT}, reverse_block);
}

pm_status pm_fleet_jvp(pm_fleet *fleet, const pm_rollout *rollout, const double *d_start,
                       const double *d_input, const double *d_weight, double *z, double *dz) {
    call c = {.fleet = fleet,
              .rollout = rollout,
              .weights = d_weight != NULL,
              .in = {d_start, d_input, d_weight},
              .out = {z, dz}};
    return take(&c, 1, (const rate_task[]){TANGENT}, forward_block);
}

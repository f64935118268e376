// Builds the graph of the rates of a scene from the expressions of its parts and ports, and runs it
// for the copies in its lanes.
#include "library/rates.h"

#include <limits.h>
#include <string.h>

#include "graph/compile.h"
#include "sim/lanes.h"
#include "sim/step_graph.h"

// --- opening ---

// Collects a result of a program.
static void add_output(pm_node *output, int *count, pm_node x) {
    if (x != PM_NO_NODE) {
        output[(*count)++] = x;
    }
}

static const double *value_of(pm_program *program, pm_node x) {
    return x == PM_NO_NODE ? NULL : pm_program_value(program, x);
}

// Builds E and S of all subsystems, [1][nsubsystem] each.
static void build_potentials(pm_graph *g, const pm_system *system, pm_node z, pm_node *E,
                             pm_node *S) {
    const pm_physics *physics = &system->scene->physics;
    pm_node *const sum[] = {E, S};
    *E = *S = PM_NO_NODE;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[i];
        const pm_node own = pm_slice(g, z, s->first, s->layout.nz);
        const pm_node potential[] = {pm_part_energy(g, system->part[i], own),
                                     pm_part_entropy(g, system->part[i], own)};
        for (int k = 0; k < 2; ++k) {
            const pm_node x = potential[k] == PM_NO_NODE ? pm_constant(g, 0, 1, 1) : potential[k];
            *sum[k] = pm_concat_or(g, *sum[k], pm_broadcast_to(g, x, (pm_shape){true, 1, 1}));
        }
    }
}

pm_status pm_rates_open(pm_rates *rates, const pm_system *system, pm_rates_task task, int lanes,
                        int nmatrix, const pm_param_entry *const *matrix) {
    const pm_physics *physics = &system->scene->physics;
    const int n = physics->nprescribed;
    enum { Z, U, WEIGHTS };
    pm_arena scratch = {0};
    pm_graph *g = NULL;
    pm_compiler *compiler = NULL;
    pm_status status;
    const size_t count = WEIGHTS + (size_t)nmatrix;
    *rates = (pm_rates){.nmatrix = nmatrix};
    pm_rates *r = rates;
    pm_node *x = pm_arena_array(&scratch, count, sizeof *x);
    pm_node *dx = pm_arena_array(&scratch, count, sizeof *dx);
    pm_node *output = pm_arena_array(&scratch, count + 1, sizeof *output);
    r->by_w = pm_arena_array(&r->arena, (size_t)nmatrix + 1, sizeof *r->by_w);
    r->dw = pm_arena_array(&r->arena, (size_t)nmatrix + 1, sizeof *r->dw);
    PM_TRY_DONE(pm_arena_status(&scratch, "the rates of a scene"));
    PM_TRY_DONE(pm_arena_status(&r->arena, "the rates of a scene"));
    PM_TRY_DONE(pm_graph_open(&g));
    if (nmatrix > 0) {
        pm_graph_weights_per_item(g);
    }
    x[Z] = pm_input(g, true, 1, physics->nz);
    x[U] = n > 0 ? pm_input(g, true, 1, n) : PM_NO_NODE;
    for (int i = 0; i < nmatrix; ++i) {
        x[WEIGHTS + i] = pm_weight(g, matrix[i]->value, matrix[i]->rows, matrix[i]->cols);
    }
    const pm_node seed = pm_input(g, true, 1, physics->nz);
    pm_node k = PM_NO_NODE, dk = PM_NO_NODE, E = PM_NO_NODE, S = PM_NO_NODE;
    int noutput = 0;
    if (task == PM_POTENTIALS) {
        build_potentials(g, system, x[Z], &E, &S);
        add_output(output, &noutput, E);
        add_output(output, &noutput, S);
    } else {
        PM_TRY_DONE(pm_build_scene_rates(g, system, x[Z], x[U], &scratch, &k));
    }
    if (task == PM_RATES || task == PM_TANGENT) {
        add_output(output, &noutput, k);
    }
    for (size_t i = 0; i < count; ++i) {
        dx[i] = PM_NO_NODE;
        if (task == PM_TANGENT && x[i] != PM_NO_NODE) {
            const pm_shape shape = pm_graph_shape(g, x[i]);
            dx[i] = pm_input(g, true, shape.rows, shape.cols);
        }
    }
    if (task == PM_TANGENT) {
        dk = pm_tangent(g, k, (int)count, x, dx);
        dk = dk == PM_NO_NODE ? dk : pm_broadcast_to(g, dk, (pm_shape){true, 1, physics->nz});
        add_output(output, &noutput, dk);
    } else if (task == PM_ADJOINT) {
        const pm_node u = x[U];
        x[U] = u == PM_NO_NODE ? x[Z] : u; // without inputs, the state stands for them
        pm_gradient(g, k, seed, (int)count, x, dx);
        dx[U] = u == PM_NO_NODE ? PM_NO_NODE : dx[U];
        x[U] = u;
        for (size_t i = 0; i < count; ++i) {
            add_output(output, &noutput, dx[i]);
        }
        add_output(output, &noutput, noutput == 0 ? k : PM_NO_NODE);
    }
    PM_TRY_DONE(pm_program_open_lanes(&r->program, g, noutput, output, lanes));
    if (r->program == NULL) {
        goto done;
    }
    if (system->compiled) {
        PM_TRY_DONE(pm_compiler_open(&compiler));
        PM_TRY_DONE(pm_compiler_add(compiler, r->program, g));
        PM_TRY_DONE(pm_compiler_link(compiler));
    }
    r->z = pm_program_input(r->program, x[Z]);
    r->u = pm_program_input(r->program, x[U]);
    r->seed = pm_program_input(r->program, seed);
    r->k = task == PM_ADJOINT ? NULL : value_of(r->program, k);
    r->dk = value_of(r->program, dk);
    r->E = value_of(r->program, E);
    r->S = value_of(r->program, S);
    for (size_t i = 0; i < count; ++i) {
        double *in = task == PM_TANGENT ? pm_program_input(r->program, dx[i]) : NULL;
        const double *by = task == PM_ADJOINT ? value_of(r->program, dx[i]) : NULL;
        *(i == Z ? &r->dz : i == U ? &r->du : &r->dw[i - WEIGHTS]) = in;
        *(i == Z ? &r->by_z : i == U ? &r->by_u : &r->by_w[i - WEIGHTS]) = by;
    }
    pm_program_prepare(r->program);
done:
    pm_compiler_close(compiler);
    pm_graph_close(g);
    pm_arena_free(&scratch);
    return status;
}

void pm_rates_close(pm_rates *rates) {
    pm_program_close(rates->program);
    pm_arena_free(&rates->arena);
    *rates = (pm_rates){0};
}

// --- copies in lanes ---

void pm_copies_gather(const pm_copies *c, int n, const double *from, double *to) {
    for (int i = 0; i < n && to != NULL; ++i) {
        for (int l = 0; l < c->lanes; ++l) {
            to[i * c->lanes + l] =
                from == NULL ? 0 : from[c->copy[l < c->used ? l : c->used - 1] * n + i];
        }
    }
}

void pm_copies_scatter(const pm_copies *c, int n, const double *from, double *to) {
    for (int i = 0; i < n && to != NULL; ++i) {
        for (int l = 0; l < c->used; ++l) {
            to[c->copy[l] * n + i] = from[i * c->lanes + l];
        }
    }
}

// Lets a program see the inputs at a stage.
static void show_inputs(pm_rates *r, const pm_copies *c, int64_t substep, int stage) {
    const pm_physics *physics = &c->setup->scene->physics;
    const int n = physics->nprescribed;
    pm_boundary_input input = c->setup->boundary_input;
    if (r->u == NULL || (r->shown == c->held && input.end == LONG_MAX)) {
        return;
    }
    for (int l = 0; l < c->lanes; ++l) {
        const int64_t copy = c->copy[l < c->used ? l : c->used - 1];
        input.held = c->held + copy * n;
        pm_boundary_input_at(&input, (long)(c->step[copy] + substep / physics->substeps),
                             ((double)(substep % physics->substeps) +
                              pm_integrator_time(physics->integrator, stage)) /
                                 physics->substeps,
                             c->row);
        for (int i = 0; i < n; ++i) {
            r->u[i * c->lanes + l] = c->row[i];
        }
    }
    r->shown = c->held;
}

void pm_rates_run(pm_rates *r, const pm_copies *c, int64_t substep, int stage, const double *z) {
    if (r->z != NULL) {
        memcpy(r->z, z, (size_t)(c->setup->scene->physics.nz * c->lanes) * sizeof *z);
    }
    show_inputs(r, c, substep, stage);
    pm_program_run_prepared(r->program, c->lanes);
}

void pm_copies_combine(const pm_copies *c, int count, const double *weight, double h,
                       const double *z, const double *k, double *to) {
    const int nz = c->setup->scene->physics.nz;
    pm_lanes_combine(nz, c->lanes, count, weight, h, z, k, (int64_t)nz * c->lanes, z, to,
                     c->changed);
}

void pm_rates_substep(pm_rates *r, const pm_copies *c, int64_t substep, double *z, double *k,
                      double *stage, ptrdiff_t apart) {
    const pm_physics *physics = &c->setup->scene->physics;
    const pm_integrator *rk = physics->integrator;
    const double h = physics->dt / physics->substeps;
    const ptrdiff_t size = (ptrdiff_t)physics->nz * c->lanes;
    for (int i = 0; i < rk->nstage; ++i, stage += apart) {
        pm_copies_combine(c, i, rk->a[i], h, z, k, stage);
        pm_rates_run(r, c, substep, i, stage);
        memcpy(k + i * size, r->k, (size_t)size * sizeof *k);
    }
    pm_copies_combine(c, rk->nstage, rk->b, h, z, k, z);
}

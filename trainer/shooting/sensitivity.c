// Builds the graphs of the rate and of the measured columns with one reverse pass for each
// component, and carries the derivatives of the states through the stages of the integrator. A row
// of the Jacobian of a rate holds what one equation depends on, where a row of that of a step would
// hold nearly everything, once for each stage.
#include "shooting/sensitivity.h"

#include <stdlib.h>
#include <string.h>

#include "base/lanes.h"
#include "base/simd.h"
#include "data/trained.h"
#include "graph/program.h"
#include "sim/step_graph.h"

// A program with one output vector and its Jacobian.
typedef struct jacobian {
    pm_program *program;
    bool outermost; // items are; else they are innermost (pm_program_open_lanes)
    pm_node z, input, stretch, value;
    int size;            // components of the value
    const double **by_z; // [size] a row of the Jacobian at item 0, NULL where independent
    int ncell;           // numbers that depend on weights
    struct cell {
        const double *value; // at item 0
        int stride;          // to the next item
        int at;              // row*nweight + weight
    } * cell;
} jacobian;

// An implicit method is a method of one stage, whose rate is the change over the whole step.
static const pm_integrator whole = {.nstage = 1, .b = {1}};

struct pm_sensitivity {
    pm_arena arena; // owns the arrays
    pm_sensitivity_how how;
    const pm_integrator *method;
    int substeps; // of the method
    double h;     // length of these in s; 1 for whole steps
    bool derivatives;
    int nz, ny, nentry, nweight, ninput;
    pm_trained *trained; // [nentry]
    jacobian rate, columns;
    // [PM_SENSITIVITY_BATCH][nstage] the rates [nz] and their derivatives [nz][nz], [nz][nweight]
    double *k, *k_by_start, *k_by_weights;
    double *a, *stage; // [size][nz] of one item; [nz][nz] and [nz][nweight] at one stage
    double *y, *by_start, *by_weights; // [ny], [ny][nz], [ny][nweight] of one sample
    double *prescribed;                // [nprescribed]
    // Steps of which each is linearised for itself, with their states; without derivatives: unused.
    pm_sensitivity_item step[PM_SENSITIVITY_BATCH];
};

// --- opening ---

// Builds the rates of explicit methods.
static pm_status build_rate(pm_graph *g, const pm_sensitivity *f, jacobian *j, pm_arena *scratch) {
    const int n = f->how.system->scene->physics.nprescribed;
    j->input = n > 0 ? pm_input(g, true, 1, n) : PM_NO_NODE;
    return pm_build_scene_rates(g, f->how.system, j->z, j->input, scratch, &j->value);
}

// Builds the change over a whole step of the scene.
static pm_status build_step(pm_graph *g, const pm_sensitivity *f, jacobian *j, pm_arena *scratch) {
    const pm_system *system = f->how.system;
    const pm_scene *scene = system->scene;
    const int count = scene->physics.nsubsystem;
    pm_node *z = pm_arena_array(scratch, (size_t)count, sizeof *z);
    pm_step_work work = pm_step_work_new(system, scratch);
    PM_TRY(pm_arena_status(scratch, "a step"));
    j->input = f->ninput > 0 ? pm_input(g, true, 1, f->ninput) : PM_NO_NODE;
    j->stretch = f->how.stretched ? pm_input(g, true, 1, 1) : PM_NO_NODE;
    work.stretch = j->stretch;
    pm_node degeneracy = PM_NO_NODE;
    for (int i = 0; i < count; ++i) {
        z[i] = pm_slice(g, j->z, scene->physics.subsystem[i].first,
                        scene->physics.subsystem[i].layout.nz);
    }
    pm_build_step(g, system, f->how.integrator, scene->physics.dt / f->how.substeps,
                  f->how.substeps, z, j->input, &degeneracy, &work);
    j->value = pm_sub(g, pm_concat(g, count, z), j->z);
    return PM_OK;
}

// Adds the Jacobian of the value to the outputs, and opens the program.
static pm_status open_jacobian(pm_graph *g, pm_sensitivity *f, jacobian *j, pm_arena *scratch) {
    j->size = pm_graph_shape(g, j->value).cols;
    const size_t n = (size_t)f->nentry + 1, cells = (size_t)j->size * n + 1;
    size_t numbers = 0;
    pm_node *leaf = pm_arena_array(scratch, n, sizeof *leaf);
    pm_node *row = pm_arena_array(scratch, cells, sizeof *row);
    pm_node *output = pm_arena_array(scratch, cells, sizeof *output);
    PM_TRY(pm_arena_status(scratch, "a Jacobian"));
    int count = 0;
    output[count++] = j->value;
    for (int i = 0; i < f->nentry; ++i) {
        const pm_param_entry *entry = f->trained[i].entry;
        leaf[i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
    leaf[f->nentry] = j->z;
    for (size_t i = 0; i < cells; ++i) {
        row[i] = PM_NO_NODE;
    }
    for (int r = 0; r < j->size && f->derivatives; ++r) {
        pm_node *own = row + (size_t)r * n;
        pm_gradient(g, pm_slice(g, j->value, r, 1), PM_NO_NODE, f->nentry + 1, leaf, own);
        for (int i = 0; i <= f->nentry; ++i) {
            if (own[i] != PM_NO_NODE) {
                output[count++] = own[i];
                numbers += i < f->nentry ? (size_t)f->trained[i].size : 0;
            }
        }
    }
    PM_TRY(pm_program_open_lanes(&j->program, g, count, output, PM_SENSITIVITY_BATCH));
    j->outermost = j->program == NULL;
    PM_TRY(j->outermost ? pm_program_open(&j->program, g, count, output, PM_SENSITIVITY_BATCH)
                        : PM_OK);
    j->by_z = pm_arena_array(&f->arena, (size_t)j->size, sizeof *j->by_z);
    j->cell = pm_arena_array(&f->arena, numbers + 1, sizeof *j->cell);
    PM_TRY(pm_arena_status(&f->arena, "a Jacobian"));
    for (int i = 0; i < j->size * (int)n; ++i) {
        const int r = i / (int)n, k = i % (int)n;
        const double *value = row[i] == PM_NO_NODE ? NULL : pm_program_value(j->program, row[i]);
        if (k == f->nentry) {
            j->by_z[r] = value;
        }
        for (int c = 0; k < f->nentry && value != NULL && c < f->trained[k].size; ++c) {
            j->cell[j->ncell++] = (struct cell){
                .value = value + (ptrdiff_t)c * (j->outermost ? 1 : PM_SENSITIVITY_BATCH),
                .stride = j->outermost ? f->trained[k].size : 1,
                .at = r * f->nweight + f->trained[k].first + c};
        }
    }
    return PM_OK;
}

static pm_status build(pm_sensitivity *f, jacobian *j) {
    pm_graph *g = NULL;
    pm_arena scratch = {0};
    pm_status status;
    PM_TRY_DONE(pm_graph_open(&g));
    if (f->derivatives) {
        pm_graph_weights_per_item(g);
    }
    j->z = pm_input(g, true, 1, f->nz);
    j->input = j->stretch = PM_NO_NODE;
    if (j == &f->rate) {
        PM_TRY_DONE(f->method == &whole ? build_step(g, f, j, &scratch)
                                        : build_rate(g, f, j, &scratch));
    } else {
        const int n = f->how.system->scene->physics.nprescribed;
        j->input = n > 0 ? pm_input(g, true, 1, n) : PM_NO_NODE;
        j->value = pm_observation_build(g, f->how.observation, f->how.system, j->z, j->input);
    }
    status = open_jacobian(g, f, j, &scratch);
done:
    pm_graph_close(g);
    pm_arena_free(&scratch);
    return status;
}

// Returns the work of a program for one item, and of the product of its Jacobian.
static double work_of(const pm_sensitivity *f, const jacobian *j) {
    const double columns = f->nz + f->nweight;
    return pm_program_work(j->program) +
           (f->derivatives ? j->size * columns * (f->nz + 1) * PM_SENSITIVITY_DENSE : 0);
}

pm_status pm_sensitivity_open(pm_sensitivity **sensitivity, const pm_sensitivity_how *how,
                              bool derivatives, pm_sensitivity_work *work) {
    pm_sensitivity *f = calloc(1, sizeof *f);
    PM_TRY(pm_allocated(f, "derivatives"));
    const pm_scene *scene = how->system->scene;
    f->how = *how;
    const bool steps = pm_integrator_iterates(how->integrator);
    f->method = steps ? &whole : how->integrator;
    f->substeps = steps ? 1 : how->substeps;
    f->h = steps ? 1 : scene->physics.dt / how->substeps;
    f->derivatives = derivatives;
    f->nz = scene->physics.nz;
    f->ny = how->observation->count;
    f->ninput = scene->physics.nprescribed * PM_BOUNDARY_INPUT_ORDER;
    f->nentry = how->fixed ? 0 : pm_trained_list(how->system, NULL);
    f->nweight = how->fixed ? 0 : pm_trained_count(how->system);
    const size_t rows = (size_t)(f->nz > f->ny ? f->nz : f->ny);
    f->trained = pm_arena_array(&f->arena, (size_t)f->nentry + 1, sizeof *f->trained);
    const size_t nz = (size_t)f->nz, nweight = (size_t)f->nweight;
    const size_t stages = (size_t)f->method->nstage * PM_SENSITIVITY_BATCH;
    f->a = pm_arena_array(&f->arena, rows * nz, sizeof *f->a);
    f->stage = pm_arena_array(&f->arena, nz * (nz + nweight), sizeof *f->stage);
    f->k = pm_arena_array(&f->arena, stages * nz, sizeof *f->k);
    if (derivatives) {
        f->k_by_start = pm_arena_array(&f->arena, stages * nz * nz, sizeof *f->k);
        f->k_by_weights = pm_arena_array(&f->arena, stages * nz * nweight + 1, sizeof *f->k);
        pm_sensitivity_allocate(PM_SENSITIVITY_BATCH, f->step, nz, nweight, &f->arena);
    }
    f->prescribed =
        pm_arena_array(&f->arena, (size_t)scene->physics.nprescribed + 1, sizeof *f->prescribed);
    f->y = pm_arena_array(&f->arena, rows, sizeof *f->y);
    f->by_start = pm_arena_array(&f->arena, rows * nz, sizeof *f->by_start);
    f->by_weights = pm_arena_array(&f->arena, rows * nweight + 1, sizeof *f->by_weights);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&f->arena, "the derivatives of %d weights", f->nweight));
    if (!how->fixed) {
        pm_trained_list(how->system, f->trained);
    }
    PM_TRY_DONE(build(f, &f->rate));
    PM_TRY_DONE(build(f, &f->columns));
    *work = (pm_sensitivity_work){f->substeps * f->method->nstage * work_of(f, &f->rate),
                                  work_of(f, &f->columns)};
    *sensitivity = f;
    f = NULL;
done:
    pm_sensitivity_close(f);
    return status;
}

void pm_sensitivity_close(pm_sensitivity *sensitivity) {
    if (sensitivity != NULL) {
        pm_program_close(sensitivity->rate.program);
        pm_program_close(sensitivity->columns.program);
        PM_DELETE(sensitivity);
    }
}

void pm_sensitivity_allocate(int count, pm_sensitivity_item *item, size_t nz, size_t nweight,
                             pm_arena *arena) {
    for (int i = 0; i < count; ++i) {
        item[i].z = pm_arena_array(arena, nz, sizeof *item[i].z);
        item[i].by_start = pm_arena_array(arena, nz * nz, sizeof *item[i].by_start);
        item[i].by_weights = pm_arena_array(arena, nz * nweight + 1, sizeof *item[i].by_weights);
    }
}

// --- running ---

void pm_sensitivity_start(const pm_sensitivity *sensitivity, pm_sensitivity_item *item) {
    const size_t nz = (size_t)sensitivity->nz;
    if (sensitivity->derivatives) {
        memset(item->by_start, 0, nz * nz * sizeof *item->by_start);
        memset(item->by_weights, 0, nz * (size_t)sensitivity->nweight * sizeof *item->by_weights);
        for (size_t i = 0; i < nz; ++i) {
            item->by_start[i * (nz + 1)] = 1;
        }
    }
}

// Copies the numbers [size] of a node at item i of a program from `from` or to `to`.
static void put(const jacobian *j, pm_node node, int size, int i, const double *from) {
    double *to = pm_program_value(j->program, node) + (ptrdiff_t)i * (j->outermost ? size : 1);
    for (ptrdiff_t c = 0; c < size; ++c) {
        to[c * (j->outermost ? 1 : PM_SENSITIVITY_BATCH)] = from[c];
    }
}

static void get(const jacobian *j, pm_node node, int size, int i, double *to) {
    const double *from =
        pm_program_value(j->program, node) + (ptrdiff_t)i * (j->outermost ? size : 1);
    for (ptrdiff_t c = 0; c < size; ++c) {
        to[c] = from[c * (j->outermost ? 1 : PM_SENSITIVITY_BATCH)];
    }
}

// Runs a program at the states that were put into it. The boundary inputs are those at a fraction
// (0 to 1) of the coming steps for rates, polynomials for whole steps, and at the present samples
// for columns.
static void run(pm_sensitivity *f, jacobian *j, int count, pm_sensitivity_item *const *item,
                double fraction) {
    const int n = f->ninput / PM_BOUNDARY_INPUT_ORDER;
    for (int i = 0; i < count && j->input != PM_NO_NODE; ++i) {
        if (j == &f->columns) {
            put(j, j->input, n, i, item[i]->now);
        } else if (f->method == &whole) {
            put(j, j->input, f->ninput, i, item[i]->input);
        } else {
            const double *polynomial = item[i]->input;
            for (int c = 0; c < n; ++c) {
                double value = 0;
                for (int order = fraction > 0 ? PM_BOUNDARY_INPUT_ORDER : 1; order-- > 0;) {
                    value = value * fraction + polynomial[order * n + c];
                }
                f->prescribed[c] = value;
            }
            put(j, j->input, n, i, f->prescribed);
        }
    }
    for (int i = 0; i < count && j->stretch != PM_NO_NODE; ++i) {
        put(j, j->stretch, 1, i, &item[i]->duration);
    }
    pm_program_run(j->program, j->outermost ? count : PM_SENSITIVITY_BATCH);
}

// Computes WIDTH columns of a row of a product, which stay in registers.
#define ADD_COLUMNS(WIDTH)                                \
    {                                                     \
        double sum[WIDTH] = {0};                          \
        for (int l = 0; l < k; ++l) {                     \
            const double factor = a[l];                   \
            const double *row = b + (ptrdiff_t)l * n + j; \
            if (factor == 0) {                            \
                continue;                                 \
            }                                             \
            for (int x = 0; x < (WIDTH); ++x) {           \
                sum[x] += factor * row[x];                \
            }                                             \
        }                                                 \
        memcpy(c + j, sum, sizeof sum);                   \
        j += (WIDTH);                                     \
    }

// Computes c [m][n] = a b with a [m][k], many of whose entries are zero.
PM_SIMD_CLONES static void multiply(int m, int n, int k, const double *a, const double *b,
                                    double *restrict c) {
    for (int i = 0; i < m; ++i, a += k, c += n) {
        int j = 0;
        while (j + 4 * PM_LANES <= n) {
            ADD_COLUMNS(4 * PM_LANES)
        }
        while (j + PM_LANES <= n) {
            ADD_COLUMNS(PM_LANES)
        }
        while (j < n) {
            ADD_COLUMNS(1)
        }
    }
}

// Multiplies the Jacobian a, b of a program's last run at item i by the derivatives of a state:
// out_start = a by_start, out_weights = a by_weights + b.
static void chain(const pm_sensitivity *f, const jacobian *j, int i, const double *by_start,
                  const double *by_weights, double *out_start, double *out_weights) {
    const ptrdiff_t nz = f->nz, stride = j->outermost ? 1 : PM_SENSITIVITY_BATCH;
    for (int r = 0; r < j->size; ++r) {
        const double *from = j->by_z[r] + (j->by_z[r] == NULL ? 0 : i * (j->outermost ? nz : 1));
        for (ptrdiff_t c = 0; c < nz; ++c) {
            f->a[r * nz + c] = from == NULL ? 0 : from[c * stride];
        }
    }
    multiply(j->size, f->nz, f->nz, f->a, by_start, out_start);
    multiply(j->size, f->nweight, f->nz, f->a, by_weights, out_weights);
    for (const struct cell *c = j->cell; c < j->cell + j->ncell; ++c) {
        out_weights[c->at] += c->value[(ptrdiff_t)i * c->stride];
    }
}

// Returns base + h sum_i weight[i] k[i] over n stages, with base and k[i] of `size` numbers: `out`,
// or `base` if all weights are zero.
PM_SIMD_CLONES static const double *combine(size_t size, const double *base, double h, int n,
                                            const double *weight, const double *k, double *out) {
    const double *from = base;
    for (int i = 0; i < n; ++i) {
        const double factor = h * weight[i], *rate = k + (size_t)i * size;
        for (size_t c = 0; c < size && factor != 0; ++c) {
            out[c] = from[c] + factor * rate[c];
        }
        from = factor != 0 ? out : from;
    }
    return from;
}

// Computes the rates of items [count] at a stage, and their derivatives if there are any.
static void take_stage(pm_sensitivity *f, int count, pm_sensitivity_item *const *item,
                       const double *h, int substep, int stage) {
    const pm_integrator *rk = f->method;
    jacobian *j = &f->rate;
    const size_t nz = (size_t)f->nz, n = (size_t)rk->nstage, square = nz * nz;
    const size_t cells = nz * (size_t)f->nweight;
    const double *a = rk->a[stage];
    for (size_t i = 0; i < (size_t)count; ++i) {
        put(j, j->z, f->nz, (int)i,
            combine(nz, item[i]->z, h[i], stage, a, f->k + i * n * nz, f->stage));
    }
    run(f, j, count, item, (substep + pm_integrator_time(rk, stage)) / f->substeps);
    for (size_t i = 0; i < (size_t)count; ++i) {
        const size_t at = i * n + (size_t)stage;
        get(j, j->value, f->nz, (int)i, f->k + at * nz);
        if (f->derivatives) {
            const double *start = combine(square, item[i]->by_start, h[i], stage, a,
                                          f->k_by_start + i * n * square, f->stage);
            const double *weights = combine(cells, item[i]->by_weights, h[i], stage, a,
                                            f->k_by_weights + i * n * cells, f->stage + square);
            chain(f, j, (int)i, start, weights, f->k_by_start + at * square,
                  f->k_by_weights + at * cells);
        }
    }
}

// Advances the states of all items [count] by one step each, and their derivatives if there are
// any.
static void take_step(pm_sensitivity *f, int count, pm_sensitivity_item *const *item) {
    const pm_integrator *rk = f->method;
    const size_t nz = (size_t)f->nz, n = (size_t)rk->nstage, square = nz * nz;
    const size_t cells = nz * (size_t)f->nweight;
    double h[PM_SENSITIVITY_BATCH];
    for (int i = 0; i < count; ++i) {
        h[i] = f->h * (f->how.stretched && f->method != &whole ? item[i]->duration : 1);
    }
    for (int substep = 0; substep < f->substeps; ++substep) {
        for (int stage = 0; stage < rk->nstage; ++stage) {
            take_stage(f, count, item, h, substep, stage);
        }
        for (size_t i = 0; i < (size_t)count; ++i) {
            double *z = item[i]->z, *start = item[i]->by_start, *weights = item[i]->by_weights;
            (void)combine(nz, z, h[i], rk->nstage, rk->b, f->k + i * n * nz, z);
            if (f->derivatives) {
                (void)combine(square, start, h[i], rk->nstage, rk->b,
                              f->k_by_start + i * n * square, start);
                (void)combine(cells, weights, h[i], rk->nstage, rk->b,
                              f->k_by_weights + i * n * cells, weights);
            }
        }
    }
}

// Lets an item take step `k` of a track.
static void give_step(const pm_sensitivity *f, const pm_track *t, int k,
                      pm_sensitivity_item *item) {
    item->duration = t->duration[k];
    item->input = t->input == NULL ? NULL : t->input + (ptrdiff_t)k * f->ninput;
}

void pm_sensitivity_measure(pm_sensitivity *sensitivity, int count,
                            pm_sensitivity_item *const *item, double *y, double *by_start,
                            double *by_weights) {
    jacobian *j = &sensitivity->columns;
    const ptrdiff_t ny = sensitivity->ny, nz = sensitivity->nz;
    for (int i = 0; i < count; ++i) {
        put(j, j->z, (int)nz, i, item[i]->z);
    }
    run(sensitivity, j, count, item, 0);
    for (int i = 0; i < count; ++i) {
        get(j, j->value, (int)ny, i, y + i * ny);
        if (sensitivity->derivatives) {
            chain(sensitivity, j, i, item[i]->by_start, item[i]->by_weights, by_start + i * ny * nz,
                  by_weights + i * ny * sensitivity->nweight);
        }
    }
}

void pm_sensitivity_advance(pm_sensitivity *sensitivity, int count, pm_sensitivity_item *item,
                            const pm_track *const *track, const int *sample) {
    pm_sensitivity_item *moving[PM_SENSITIVITY_BATCH];
    for (int step = 0, n = 1; n > 0; ++step) {
        n = 0;
        for (int i = 0; i < count; ++i) {
            const pm_track *t = track[i];
            const int k = sample[i] < 0 ? -1 : t->first_step[sample[i]] + step;
            if (k >= 0 && sample[i] + 1 < t->count && k < t->first_step[sample[i] + 1]) {
                give_step(sensitivity, t, k, &item[i]);
                moving[n++] = &item[i];
            }
        }
        if (n > 0) {
            take_step(sensitivity, n, moving);
        }
    }
}

// Linearises the steps of one window along its path, and what is measured there.
static void follow_path(pm_sensitivity *f, int id, pm_sensitivity_item *item, const pm_track *t,
                        int from, int to, const double *path, pm_sensitivity_visit *visit,
                        void *context) {
    const int end = t->first_step[to], nprescribed = f->ninput / PM_BOUNDARY_INPUT_ORDER;
    const size_t nz = (size_t)f->nz, square = nz * nz, cells = nz * (size_t)f->nweight;
    pm_sensitivity_start(f, item);
    for (int first = t->first_step[from], sample = from; first < end;
         first += PM_SENSITIVITY_BATCH) {
        const int after = end - first < PM_SENSITIVITY_BATCH ? end : first + PM_SENSITIVITY_BATCH;
        pm_sensitivity_item look[PM_SENSITIVITY_BATCH];
        pm_sensitivity_item *steps[PM_SENSITIVITY_BATCH], *looks[PM_SENSITIVITY_BATCH];
        int nlook = 0;
        for (int k = first; k < after; ++k) {
            pm_sensitivity_item *step = steps[k - first] = &f->step[k - first];
            memcpy(step->z, path + (size_t)k * nz, nz * sizeof *path);
            pm_sensitivity_start(f, step);
            give_step(f, t, k, step);
        }
        for (int i = sample; i < to && t->first_step[i] < after; ++i) {
            put(&f->columns, f->columns.z, f->nz, nlook, path + (size_t)t->first_step[i] * nz);
            looks[nlook] = &look[nlook];
            look[nlook++] = (pm_sensitivity_item){
                .now = t->now == NULL ? NULL : t->now + (ptrdiff_t)i * nprescribed};
        }
        take_step(f, after - first, steps);
        if (nlook > 0) {
            run(f, &f->columns, nlook, looks, 0);
        }
        for (int k = first, seen = 0; k < after; ++k) {
            if (seen < nlook && t->first_step[sample] == k) {
                get(&f->columns, f->columns.value, f->ny, seen, f->y);
                chain(f, &f->columns, seen++, item->by_start, item->by_weights, f->by_start,
                      f->by_weights);
                visit(context, id, sample++, path + (size_t)k * nz, f->y, f->by_start,
                      f->by_weights);
            }
            const pm_sensitivity_item *step = steps[k - first];
            multiply(f->nz, f->nz, f->nz, step->by_start, item->by_start, f->stage);
            memcpy(item->by_start, f->stage, square * sizeof *f->stage);
            multiply(f->nz, f->nweight, f->nz, step->by_start, item->by_weights, f->stage);
            for (size_t c = 0; c < cells; ++c) {
                item->by_weights[c] = f->stage[c] + step->by_weights[c];
            }
        }
    }
}

void pm_sensitivity_along(pm_sensitivity *sensitivity, pm_sensitivity *values, int count,
                          pm_sensitivity_item *item, const pm_track *const *track, const int *first,
                          const int *last, double *const *path, pm_sensitivity_visit *visit,
                          void *context) {
    const int nz = sensitivity->nz;
    for (int step = 0, n = 1; n > 0; ++step) {
        pm_sensitivity_item *moving[PM_SENSITIVITY_BATCH];
        n = 0;
        for (int i = 0; i < count; ++i) {
            const int k = track[i]->first_step[first[i]] + step;
            if (k < track[i]->first_step[last[i]]) {
                memcpy(path[i] + (ptrdiff_t)k * nz, item[i].z, (size_t)nz * sizeof **path);
                give_step(values, track[i], k, &item[i]);
                moving[n++] = &item[i];
            }
        }
        if (n > 0) {
            take_step(values, n, moving);
        }
    }
    for (int i = 0; i < count; ++i) {
        follow_path(sensitivity, i, &item[i], track[i], first[i], last[i], path[i], visit, context);
    }
}

// Builds the graph of one step and of the measured columns with one reverse pass for each
// component, and multiplies the Jacobians of successive steps.
#include "shooting/sensitivity.h"

#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "data/trained.h"
#include "graph/program.h"
#include "sim/step_graph.h"

// A program with one output vector and its Jacobian.
typedef struct jacobian {
    pm_program *program;
    pm_node z, input, stretch, value;
    int size;          // components of the value
    pm_node *by_z;     // [size], PM_NO_NODE where independent
    pm_node *by_entry; // [size][nentry] likewise
} jacobian;

struct pm_sensitivity {
    pm_arena arena; // owns the arrays
    pm_sensitivity_how how;
    bool derivatives;
    int nz, ny, nentry, nweight, ninput;
    pm_trained *trained; // [nentry]
    jacobian step, columns;
    double *a, *b;                 // [size][nz], [size][nweight] of one item
    double *c;                     // [nz][nz or nweight] a product
    double *by_start, *by_weights; // [ny][nz], [ny][nweight] of the columns at one sample
};

// --- opening ---

// Builds the state after one step of the scene.
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
    j->value = pm_concat(g, count, z);
    return PM_OK;
}

// Adds the Jacobian of the value to the outputs, and opens the program.
static pm_status open_jacobian(pm_graph *g, pm_sensitivity *f, jacobian *j, pm_arena *scratch) {
    j->size = pm_graph_shape(g, j->value).cols;
    const size_t n = (size_t)f->nentry + 1, cells = (size_t)j->size * n + 1;
    j->by_z = pm_arena_array(&f->arena, (size_t)j->size, sizeof *j->by_z);
    j->by_entry = pm_arena_array(&f->arena, cells, sizeof *j->by_entry);
    pm_node *leaf = pm_arena_array(scratch, n, sizeof *leaf);
    pm_node *row = pm_arena_array(scratch, n, sizeof *row);
    pm_node *output = pm_arena_array(scratch, cells, sizeof *output);
    PM_TRY(pm_arena_status(&f->arena, "a Jacobian"));
    PM_TRY(pm_arena_status(scratch, "a Jacobian"));
    int count = 0;
    output[count++] = j->value;
    for (int i = 0; i < f->nentry; ++i) {
        const pm_param_entry *entry = f->trained[i].entry;
        leaf[i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
    leaf[f->nentry] = j->z;
    for (int r = 0; r < j->size && f->derivatives; ++r) {
        pm_gradient(g, pm_slice(g, j->value, r, 1), PM_NO_NODE, f->nentry + 1, leaf, row);
        j->by_z[r] = row[f->nentry];
        memcpy(j->by_entry + (ptrdiff_t)r * f->nentry, row, (size_t)f->nentry * sizeof *row);
        for (int i = 0; i <= f->nentry; ++i) {
            if (row[i] != PM_NO_NODE) {
                output[count++] = row[i];
            }
        }
    }
    return pm_program_open(&j->program, g, count, output, PM_SENSITIVITY_BATCH);
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
    if (j == &f->step) {
        PM_TRY_DONE(build_step(g, f, j, &scratch));
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
    return pm_program_work(j->program) + (f->derivatives ? j->size * columns * (f->nz + 1) : 0);
}

pm_status pm_sensitivity_open(pm_sensitivity **sensitivity, const pm_sensitivity_how *how,
                              bool derivatives, pm_sensitivity_work *work) {
    pm_sensitivity *f = calloc(1, sizeof *f);
    PM_TRY(pm_allocated(f, "derivatives"));
    const pm_scene *scene = how->system->scene;
    f->how = *how;
    f->derivatives = derivatives;
    f->nz = scene->physics.nz;
    f->ny = how->observation->count;
    f->ninput = scene->physics.nprescribed * PM_BOUNDARY_INPUT_ORDER;
    f->nentry = how->fixed ? 0 : pm_trained_list(how->system, NULL);
    f->nweight = how->fixed ? 0 : pm_trained_count(how->system);
    const size_t rows = (size_t)(f->nz > f->ny ? f->nz : f->ny);
    f->trained = pm_arena_array(&f->arena, (size_t)f->nentry + 1, sizeof *f->trained);
    f->a = pm_arena_array(&f->arena, rows * (size_t)f->nz, sizeof *f->a);
    f->b = pm_arena_array(&f->arena, rows * (size_t)f->nweight + 1, sizeof *f->b);
    f->c = pm_arena_array(&f->arena, rows * (size_t)(f->nz + f->nweight), sizeof *f->c);
    f->by_start = pm_arena_array(&f->arena, rows * (size_t)f->nz, sizeof *f->by_start);
    f->by_weights = pm_arena_array(&f->arena, rows * (size_t)f->nweight + 1, sizeof *f->by_weights);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&f->arena, "the derivatives of %d weights", f->nweight));
    if (!how->fixed) {
        pm_trained_list(how->system, f->trained);
    }
    PM_TRY_DONE(build(f, &f->step));
    PM_TRY_DONE(build(f, &f->columns));
    *work = (pm_sensitivity_work){work_of(f, &f->step), work_of(f, &f->columns)};
    *sensitivity = f;
    f = NULL;
done:
    pm_sensitivity_close(f);
    return status;
}

void pm_sensitivity_close(pm_sensitivity *sensitivity) {
    if (sensitivity != NULL) {
        pm_program_close(sensitivity->step.program);
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

// Runs a program at the states of the items.
static void run(const pm_sensitivity *f, jacobian *j, int count, pm_sensitivity_item *const *item) {
    double *z = pm_program_value(j->program, j->z);
    for (int i = 0; i < count; ++i) {
        memcpy(z + (ptrdiff_t)i * f->nz, item[i]->z, (size_t)f->nz * sizeof *z);
        if (j->input != PM_NO_NODE) {
            const bool step = j == &f->step;
            const int n = step ? f->ninput : f->ninput / PM_BOUNDARY_INPUT_ORDER;
            memcpy(pm_program_value(j->program, j->input) + (ptrdiff_t)i * n,
                   step ? item[i]->input : item[i]->now, (size_t)n * sizeof *z);
        }
        if (j->stretch != PM_NO_NODE) {
            pm_program_value(j->program, j->stretch)[i] = item[i]->duration;
        }
    }
    pm_program_run(j->program, count);
}

// Copies the Jacobian of the last run at item i to a [size][nz] and b [size][nweight].
static void copy_jacobian(const pm_sensitivity *f, const jacobian *j, int i) {
    const size_t nz = (size_t)f->nz;
    for (int r = 0; r < j->size; ++r) {
        double *a = f->a + (size_t)r * nz, *b = f->b + (ptrdiff_t)r * f->nweight;
        if (j->by_z[r] == PM_NO_NODE) {
            memset(a, 0, nz * sizeof *a);
        } else {
            memcpy(a, pm_program_value(j->program, j->by_z[r]) + (size_t)i * nz, nz * sizeof *a);
        }
        for (int k = 0; k < f->nentry; ++k) {
            const pm_node node = j->by_entry[(ptrdiff_t)r * f->nentry + k];
            const size_t size = (size_t)f->trained[k].size;
            if (node == PM_NO_NODE) {
                memset(b, 0, size * sizeof *b);
            } else {
                memcpy(b, pm_program_value(j->program, node) + (size_t)i * size, size * sizeof *b);
            }
            b += size;
        }
    }
}

// Multiplies the Jacobian in a and b by the derivatives of an item: by_start = a by_start, and
// by_weights = a by_weights + b.
static void chain(const pm_sensitivity *f, int size, const pm_sensitivity_item *item,
                  double *by_start, double *by_weights) {
    const size_t own = (size_t)size * (size_t)f->nz, all = (size_t)size * (size_t)f->nweight;
    pm_gemm(false, false, size, f->nz, f->nz, f->a, item->by_start, f->c);
    memcpy(by_start, f->c, own * sizeof *f->c);
    if (all > 0) {
        pm_gemm(false, false, size, f->nweight, f->nz, f->a, item->by_weights, f->c);
        for (size_t k = 0; k < all; ++k) {
            by_weights[k] = f->c[k] + f->b[k];
        }
    }
}

// Advances the states of all items [count] by one step each, and their derivatives if there are
// any.
static void take_step(pm_sensitivity *f, int count, pm_sensitivity_item *const *item) {
    jacobian *j = &f->step;
    run(f, j, count, item);
    const double *next = pm_program_value(j->program, j->value);
    for (int i = 0; i < count; ++i) {
        memcpy(item[i]->z, next + (ptrdiff_t)i * f->nz, (size_t)f->nz * sizeof *next);
        if (f->derivatives) {
            copy_jacobian(f, j, i);
            chain(f, f->nz, item[i], item[i]->by_start, item[i]->by_weights);
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
    const ptrdiff_t ny = sensitivity->ny;
    run(sensitivity, j, count, item);
    memcpy(y, pm_program_value(j->program, j->value), (size_t)(count * ny) * sizeof *y);
    for (int i = 0; i < count && sensitivity->derivatives; ++i) {
        copy_jacobian(sensitivity, j, i);
        chain(sensitivity, sensitivity->ny, item[i], by_start + i * ny * sensitivity->nz,
              by_weights + i * ny * sensitivity->nweight);
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

// Linearises the steps from first[0] on of one window along its path, and what is measured there.
static void follow_path(pm_sensitivity *f, int id, pm_sensitivity_item *item, const pm_track *t,
                        int from, int to, double *path, pm_sensitivity_visit *visit,
                        void *context) {
    const int end = t->first_step[to], nprescribed = f->ninput / PM_BOUNDARY_INPUT_ORDER;
    pm_sensitivity_start(f, item);
    for (int first = t->first_step[from], sample = from; first < end;
         first += PM_SENSITIVITY_BATCH) {
        const int after = end - first < PM_SENSITIVITY_BATCH ? end : first + PM_SENSITIVITY_BATCH;
        pm_sensitivity_item step[PM_SENSITIVITY_BATCH], look[PM_SENSITIVITY_BATCH];
        pm_sensitivity_item *steps[PM_SENSITIVITY_BATCH], *looks[PM_SENSITIVITY_BATCH];
        int nlook = 0;
        for (int k = first; k < after; ++k) {
            steps[k - first] = &step[k - first];
            step[k - first] = (pm_sensitivity_item){.z = path + (ptrdiff_t)k * f->nz};
            give_step(f, t, k, &step[k - first]);
        }
        for (int i = sample; i < to && t->first_step[i] < after; ++i) {
            const double *now = t->now == NULL ? NULL : t->now + (ptrdiff_t)i * nprescribed;
            looks[nlook] = &look[nlook];
            look[nlook++] =
                (pm_sensitivity_item){.z = step[t->first_step[i] - first].z, .now = now};
        }
        run(f, &f->step, after - first, steps);
        if (nlook > 0) {
            run(f, &f->columns, nlook, looks);
        }
        for (int k = first, seen = 0; k < after; ++k) {
            if (seen < nlook && t->first_step[sample] == k) {
                copy_jacobian(f, &f->columns, seen);
                chain(f, f->ny, item, f->by_start, f->by_weights);
                visit(context, id, sample++, look[seen].z,
                      pm_program_value(f->columns.program, f->columns.value) +
                          (ptrdiff_t)seen * f->ny,
                      f->by_start, f->by_weights);
                ++seen;
            }
            copy_jacobian(f, &f->step, k - first);
            chain(f, f->nz, item, item->by_start, item->by_weights);
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

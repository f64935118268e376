// Builds the graph of one step and of the measured columns with one reverse pass for each
// component, and multiplies the Jacobians of successive steps.
#include "learn/flow.h"

#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "graph/program.h"
#include "learn/step_graph.h"

// A program with one output vector and its Jacobian.
typedef struct jacobian {
    pm_program *program;
    pm_node z, input, stretch, value;
    int size;          // components of the value
    pm_node *by_z;     // [size], PM_NO_NODE where independent
    pm_node *by_entry; // [size][nentry] likewise
} jacobian;

struct pm_flow {
    pm_flow_how how;
    bool derivatives;
    int nz, ny, nentry, nweight, ninput;
    int *entry_size; // [nentry]
    jacobian step, look;
    double *a, *b; // [size][nz], [size][nweight] of one item
    double *c;     // [nz][nz or nweight] a product
};

// --- graphs ---

// Lists the matrices of trained weights as nodes of g.
static int list_entries(pm_graph *g, const pm_system *system, pm_node *leaf, int *size) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int j = 0; j < params->count; ++j) {
            const pm_param_entry *entry = &params->entry[j];
            if (entry->trained && leaf != NULL) {
                leaf[count] = pm_weight(g, entry->value, entry->rows, entry->cols);
                size[count] = entry->rows * entry->cols;
            }
            count += entry->trained;
        }
    }
    return count;
}

// Returns the state after one step of the scene.
static pm_node build_step(pm_graph *g, const pm_flow *f, jacobian *j, const pm_step_work *work,
                          pm_node *z) {
    const pm_system *system = f->how.system;
    const pm_scene *scene = system->scene;
    j->z = pm_input(g, true, 1, f->nz);
    j->input = f->ninput > 0 ? pm_input(g, true, 1, f->ninput) : PM_NO_NODE;
    j->stretch = f->how.stretched ? pm_input(g, true, 1, 1) : PM_NO_NODE;
    pm_step_work stretched = *work;
    stretched.stretch = j->stretch;
    pm_node degeneracy = PM_NO_NODE;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        z[i] = pm_slice(g, j->z, scene->subsystem[i].first, scene->subsystem[i].layout.nz);
    }
    pm_build_step(g, system, f->how.integrator, scene->dt / f->how.substeps, f->how.substeps, z,
                  j->input, &degeneracy, &stretched);
    return pm_concat(g, scene->nsubsystem, z);
}

static pm_status build_scene_step(pm_graph *g, const pm_flow *f, jacobian *j) {
    const pm_scene *scene = f->how.system->scene;
    const size_t count = (size_t)scene->nsubsystem;
    pm_node *z = calloc(count, sizeof *z);
    const pm_step_work work = {
        .state = calloc(count, sizeof *work.state),
        .k = calloc(count * PM_MAX_STAGES, sizeof *work.k),
        .last = calloc((size_t)scene->nport + 1, sizeof *work.last),
        .responding = calloc((size_t)scene->nz, sizeof *work.responding),
    };
    pm_status status = PM_OK;
    if (z == NULL || work.state == NULL || work.k == NULL || work.last == NULL ||
        work.responding == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a step");
    } else {
        j->value = build_step(g, f, j, &work, z);
    }
    free(z);
    free(work.state);
    free(work.k);
    free(work.last);
    free(work.responding);
    return status;
}

// Adds the Jacobian of the value to the outputs, and opens the program.
static pm_status open_jacobian(pm_graph *g, const pm_flow *f, jacobian *j) {
    j->size = pm_graph_shape(g, j->value).cols;
    const size_t cells = (size_t)j->size * (size_t)(f->nentry + 1) + 1;
    j->by_z = malloc((size_t)j->size * sizeof *j->by_z);
    j->by_entry = malloc(cells * sizeof *j->by_entry);
    pm_node *leaf = malloc((size_t)(f->nentry + 1) * sizeof *leaf);
    pm_node *row = malloc((size_t)(f->nentry + 1) * sizeof *row);
    pm_node *output = malloc(cells * sizeof *output);
    pm_status status = PM_OK;
    if (j->by_z == NULL || j->by_entry == NULL || leaf == NULL || row == NULL || output == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a Jacobian");
        goto done;
    }
    int count = 0;
    output[count++] = j->value;
    if (f->nentry > 0) {
        list_entries(g, f->how.system, leaf, f->entry_size);
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
    status = pm_program_open(&j->program, g, count, output, PM_FLOW_BATCH);
done:
    free(leaf);
    free(row);
    free(output);
    return status;
}

static pm_status build(pm_flow *f, bool look) {
    jacobian *j = look ? &f->look : &f->step;
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    pm_status status = PM_OK;
    if (f->derivatives) {
        pm_graph_weights_per_item(g);
    }
    if (look) {
        j->z = pm_input(g, true, 1, f->nz);
        j->input = j->stretch = PM_NO_NODE;
        j->value = pm_observation_build(g, f->how.observation, f->how.system, j->z);
    } else {
        status = build_scene_step(g, f, j);
    }
    if (status == PM_OK) {
        status = open_jacobian(g, f, j);
    }
    pm_graph_close(g);
    return status;
}

// --- opening ---

static pm_status open_flow(pm_flow *f) {
    const pm_system *system = f->how.system;
    const pm_scene *scene = system->scene;
    f->nz = scene->nz;
    f->ny = f->how.observation->count;
    f->ninput = scene->nprescribed * PM_BOUNDARY_INPUT_ORDER;
    f->nentry = f->how.fixed ? 0 : list_entries(NULL, system, NULL, NULL);
    for (int i = 0; i < pm_system_components(system) && !f->how.fixed; ++i) {
        f->nweight += (int)pm_params_trained(pm_system_params(system, i));
    }
    const size_t rows = (size_t)(f->nz > f->ny ? f->nz : f->ny);
    f->entry_size = calloc((size_t)f->nentry + 1, sizeof *f->entry_size);
    f->a = calloc(rows * (size_t)f->nz, sizeof *f->a);
    f->b = calloc(rows * (size_t)f->nweight + 1, sizeof *f->b);
    f->c = calloc(rows * (size_t)(f->nz + f->nweight), sizeof *f->c);
    if (f->entry_size == NULL || f->a == NULL || f->b == NULL || f->c == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the derivatives of %d weights", f->nweight);
    }
    PM_TRY(build(f, false));
    return build(f, true);
}

pm_status pm_flow_open(pm_flow **flow, const pm_flow_how *how, bool derivatives) {
    pm_flow *f = calloc(1, sizeof *f);
    if (f == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a flow");
    }
    f->how = *how;
    f->derivatives = derivatives;
    const pm_status status = open_flow(f);
    if (status != PM_OK) {
        pm_flow_close(f);
        return status;
    }
    *flow = f;
    return PM_OK;
}

static void close_jacobian(jacobian *j) {
    pm_program_close(j->program);
    free(j->by_z);
    free(j->by_entry);
}

void pm_flow_close(pm_flow *flow) {
    if (flow != NULL) {
        close_jacobian(&flow->step);
        close_jacobian(&flow->look);
        free(flow->entry_size);
        free(flow->a);
        free(flow->b);
        free(flow->c);
        free(flow);
    }
}

int pm_flow_weights(const pm_flow *flow) {
    return flow->nweight;
}

int pm_flow_inputs(const pm_flow *flow) {
    return flow->ninput;
}

// --- running ---

void pm_flow_start(const pm_flow *flow, pm_flow_item *item) {
    const size_t nz = (size_t)flow->nz;
    if (flow->derivatives) {
        memset(item->by_start, 0, nz * nz * sizeof *item->by_start);
        memset(item->by_weights, 0, nz * (size_t)flow->nweight * sizeof *item->by_weights);
        for (size_t i = 0; i < nz; ++i) {
            item->by_start[i * (nz + 1)] = 1;
        }
    }
}

// Runs a program at the states of the items.
static void run(const pm_flow *f, jacobian *j, int count, pm_flow_item *const *item) {
    double *z = pm_program_value(j->program, j->z);
    for (int i = 0; i < count; ++i) {
        memcpy(z + (ptrdiff_t)i * f->nz, item[i]->z, (size_t)f->nz * sizeof *z);
        if (j->input != PM_NO_NODE) {
            memcpy(pm_program_value(j->program, j->input) + (ptrdiff_t)i * f->ninput,
                   item[i]->input, (size_t)f->ninput * sizeof *z);
        }
        if (j->stretch != PM_NO_NODE) {
            pm_program_value(j->program, j->stretch)[i] = item[i]->duration;
        }
    }
    pm_program_run(j->program, count);
}

// Copies the Jacobian of the last run at item i to a [size][nz] and b [size][nweight].
static void copy_jacobian(const pm_flow *f, const jacobian *j, int i) {
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
            const size_t size = (size_t)f->entry_size[k];
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
static void chain(const pm_flow *f, int size, const pm_flow_item *item, double *by_start,
                  double *by_weights) {
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

void pm_flow_step(pm_flow *flow, int count, pm_flow_item *const *item) {
    jacobian *j = &flow->step;
    run(flow, j, count, item);
    const double *next = pm_program_value(j->program, j->value);
    for (int i = 0; i < count; ++i) {
        memcpy(item[i]->z, next + (ptrdiff_t)i * flow->nz, (size_t)flow->nz * sizeof *next);
        if (flow->derivatives) {
            copy_jacobian(flow, j, i);
            chain(flow, flow->nz, item[i], item[i]->by_start, item[i]->by_weights);
        }
    }
}

void pm_flow_look(pm_flow *flow, int count, pm_flow_item *const *item, double *y, double *by_start,
                  double *by_weights) {
    jacobian *j = &flow->look;
    const ptrdiff_t ny = flow->ny;
    run(flow, j, count, item);
    memcpy(y, pm_program_value(j->program, j->value), (size_t)(count * ny) * sizeof *y);
    for (int i = 0; i < count && flow->derivatives; ++i) {
        copy_jacobian(flow, j, i);
        chain(flow, flow->ny, item[i], by_start + i * ny * flow->nz,
              by_weights + i * ny * flow->nweight);
    }
}

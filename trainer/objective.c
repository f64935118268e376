// Building the loss graph and running it over chunks of samples in two lanes.
#include "objective.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"
#include "step_graph.h"

#define LANES 2  // threads; fixed, so that sums have one order
#define CHUNK 64 // samples per run of the graph: its values stay in the cache

// What a lane owns: a program of the graph, and its share of the sums.
typedef struct lane {
    pm_objective *objective;
    int id;
    pm_program *program;
    double *window; // [CHUNK][1 + unroll][nz], the program's input
    double loss;
    double *gradient; // [size]
    // The work at hand.
    int count;
    const int *index;
} lane;

struct pm_objective {
    pm_system *system;
    const pm_samples *samples;
    pm_loss loss;
    int ncomponent;     // parts and ports
    pm_params **params; // [ncomponent]
    int size;
    double robust_square; // d^2, read by the graph
    pm_node input, sum, residual;
    int nentry;
    pm_node *entry_gradient; // [nentry] per trained entry, PM_NO_NODE if the loss ignores it
    const pm_param_entry **entry;
    lane lane[LANES];
    double *square; // [samples->count] per-sample residuals
};

// --- the graph ---

static pm_node build_residual(pm_objective *o, pm_graph *g, const pm_step_work *work,
                              pm_node *degeneracy) {
    const pm_scene *scene = o->system->scene;
    const int nz = o->samples->nz, unroll = o->samples->unroll;
    const pm_integrator *rk = o->loss.residual == PM_RESIDUAL_DERIVATIVE
                                  ? pm_integrator_find("euler")
                                  : o->loss.integrator;
    const int substeps = o->loss.residual == PM_RESIDUAL_DERIVATIVE ? 1 : o->loss.substeps;
    o->input = pm_input(g, true, 1, (unroll + 1) * nz);
    pm_node z[256];
    for (int i = 0; i < scene->nsubsystem; ++i) {
        z[i] = pm_slice(g, o->input, scene->subsystem[i].first, scene->subsystem[i].layout.nz);
    }
    const pm_node scale = pm_param(g, o->samples->scale, 1, nz);
    pm_node sum = PM_NO_NODE;
    for (int step = 1; step <= unroll; ++step) {
        pm_build_step(g, o->system, rk, scene->dt / substeps, substeps, z, degeneracy, work);
        const pm_node target = pm_slice(g, o->input, step * nz, nz);
        const pm_node predicted = pm_concat(g, scene->nsubsystem, z);
        const pm_node r = pm_div(g, pm_sub(g, predicted, target), scale);
        sum = pm_add_or(g, sum, pm_dot(g, r, r));
    }
    if (*degeneracy != PM_NO_NODE) {
        *degeneracy = pm_scale(g, *degeneracy, 1.0 / (unroll * substeps * rk->nstage));
    }
    return pm_scale(g, sum, 1.0 / (nz * unroll));
}

static void build_loss(pm_objective *o, pm_graph *g, const pm_step_work *work) {
    pm_node degeneracy = PM_NO_NODE;
    o->residual = build_residual(o, g, work, &degeneracy);
    pm_node loss = o->residual;
    if (o->loss.robust > 0) {
        const pm_node d2 = pm_param(g, &o->robust_square, 1, 1);
        loss = pm_mul(g, d2, pm_log(g, pm_offset(g, pm_div(g, loss, d2), 1)));
    }
    if (degeneracy != PM_NO_NODE) {
        loss = pm_add(g, loss, pm_scale(g, degeneracy, o->loss.degeneracy));
    }
    o->sum = pm_sum_to(g, loss, (pm_shape){false, 1, 1});
    pm_node *leaf = o->entry_gradient; // overwritten by the gradients in place
    for (int i = 0; i < o->nentry; ++i) {
        leaf[i] = pm_param(g, o->entry[i]->value, o->entry[i]->rows, o->entry[i]->cols);
    }
}

static pm_status plan_lanes(pm_objective *o, pm_graph *g, const pm_step_work *work) {
    build_loss(o, g, work);
    pm_node *gradient = malloc((size_t)(o->nentry + 2) * sizeof *gradient);
    pm_node *output = malloc((size_t)(o->nentry + 2) * sizeof *output);
    pm_status status = PM_OK;
    if (gradient == NULL || output == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a loss");
        goto done;
    }
    pm_gradient(g, o->sum, PM_NO_NODE, o->nentry, o->entry_gradient, gradient);
    memcpy(o->entry_gradient, gradient, (size_t)o->nentry * sizeof *gradient);
    int count = 0;
    output[count++] = o->sum;
    output[count++] = o->residual;
    for (int i = 0; i < o->nentry; ++i) {
        if (gradient[i] != PM_NO_NODE) {
            output[count++] = gradient[i];
        }
    }
    for (int i = 0; i < LANES; ++i) {
        lane *l = &o->lane[i];
        l->objective = o;
        l->id = i;
        PM_TRY_DONE(pm_program_open(&l->program, g, count, output, CHUNK));
        l->window = pm_program_value(l->program, o->input);
        l->gradient = calloc((size_t)o->size + 1, sizeof *l->gradient);
        if (l->gradient == NULL) {
            status = pm_fail(PM_ENOMEM, "out of memory for a gradient");
            goto done;
        }
    }
done:
    free(gradient);
    free(output);
    return status;
}

static pm_status build(pm_objective *o) {
    const int nsubsystem = o->system->scene->nsubsystem;
    if (nsubsystem > 256) {
        return pm_fail(PM_ECONFIG, "%d subsystems are more than the trainer takes (256)",
                       nsubsystem);
    }
    const int nstage = o->loss.integrator->nstage;
    pm_step_work work = {
        .state = calloc((size_t)nsubsystem, sizeof *work.state),
        .k = calloc((size_t)nsubsystem * (size_t)(nstage > 1 ? nstage : 1), sizeof *work.k)};
    pm_graph *g = NULL;
    pm_status status = work.state == NULL || work.k == NULL
                           ? pm_fail(PM_ENOMEM, "out of memory for a loss")
                           : pm_graph_open(&g);
    if (status == PM_OK) {
        status = plan_lanes(o, g, &work);
    }
    pm_graph_close(g);
    free(work.state);
    free(work.k);
    return status;
}

// --- opening ---

static pm_status list_entries(pm_objective *o) {
    const pm_scene *scene = o->system->scene;
    o->ncomponent = scene->nsubsystem + scene->nport;
    o->params = calloc((size_t)o->ncomponent, sizeof *o->params);
    if (o->params == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a loss");
    }
    int capacity = 0;
    for (int i = 0; i < o->ncomponent; ++i) {
        o->params[i] = i < scene->nsubsystem ? &o->system->part[i].params
                                             : &o->system->port[i - scene->nsubsystem].params;
        capacity += o->params[i]->count;
        o->size += (int)pm_params_trained(o->params[i]);
    }
    o->entry = calloc((size_t)capacity + 1, sizeof *o->entry);
    o->entry_gradient = calloc((size_t)capacity + 1, sizeof *o->entry_gradient);
    o->square = calloc((size_t)o->samples->count, sizeof *o->square);
    if (o->entry == NULL || o->entry_gradient == NULL || o->square == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a loss");
    }
    for (int i = 0; i < o->ncomponent; ++i) {
        for (int j = 0; j < o->params[i]->count; ++j) {
            if (o->params[i]->entry[j].trained) {
                o->entry[o->nentry++] = &o->params[i]->entry[j];
            }
        }
    }
    return PM_OK;
}

pm_status pm_objective_open(pm_objective **objective, pm_system *system, const pm_samples *samples,
                            const pm_loss *loss) {
    pm_objective *o = calloc(1, sizeof *o);
    if (o == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a loss");
    }
    o->system = system;
    o->samples = samples;
    o->loss = *loss;
    o->robust_square = 1;
    pm_status status = list_entries(o);
    if (status == PM_OK) {
        status = build(o);
    }
    if (status != PM_OK) {
        pm_objective_close(o);
        return status;
    }
    *objective = o;
    return PM_OK;
}

void pm_objective_close(pm_objective *objective) {
    if (objective != NULL) {
        for (int i = 0; i < LANES; ++i) {
            pm_program_close(objective->lane[i].program);
            free(objective->lane[i].gradient);
        }
        free(objective->params);
        free(objective->entry);
        free(objective->entry_gradient);
        free(objective->square);
        free(objective);
    }
}

int pm_objective_size(const pm_objective *o) {
    return o->size;
}

int pm_objective_samples(const pm_objective *o) {
    return o->samples->count;
}

void pm_objective_weights(const pm_objective *o, double *theta) {
    for (int i = 0; i < o->ncomponent; ++i) {
        pm_params_gather(o->params[i], theta);
        theta += pm_params_trained(o->params[i]);
    }
}

void pm_objective_set_weights(pm_objective *o, const double *theta) {
    for (int i = 0; i < o->ncomponent; ++i) {
        pm_params_scatter(o->params[i], theta);
        theta += pm_params_trained(o->params[i]);
    }
}

// --- evaluation ---

static void add_gradient(lane *l) {
    const pm_objective *o = l->objective;
    double *to = l->gradient;
    for (int i = 0; i < o->nentry; ++i) {
        const int n = o->entry[i]->rows * o->entry[i]->cols;
        if (o->entry_gradient[i] != PM_NO_NODE) {
            const double *from = pm_program_value(l->program, o->entry_gradient[i]);
            for (int j = 0; j < n; ++j) {
                to[j] += from[j];
            }
        }
        to += n;
    }
}

static void *work(void *context) {
    lane *l = context;
    const pm_objective *o = l->objective;
    const size_t width = ((size_t)o->samples->unroll + 1) * (size_t)o->samples->nz;
    l->loss = 0;
    memset(l->gradient, 0, (size_t)o->size * sizeof *l->gradient);
    for (int first = l->id * CHUNK; first < l->count; first += LANES * CHUNK) {
        const int batch = l->count - first < CHUNK ? l->count - first : CHUNK;
        for (int i = 0; i < batch; ++i) {
            const int sample = l->index == NULL ? first + i : l->index[first + i];
            memcpy(l->window + (size_t)i * width, o->samples->z + (size_t)sample * width,
                   width * sizeof *l->window);
        }
        pm_program_run(l->program, batch);
        l->loss += *pm_program_value(l->program, o->sum);
        add_gradient(l);
        const double *square = pm_program_value(l->program, o->residual);
        for (int i = 0; i < batch; ++i) {
            o->square[l->index == NULL ? first + i : l->index[first + i]] = square[i];
        }
    }
    return NULL;
}

double pm_objective_evaluate(pm_objective *o, int count, const int *index, double *gradient) {
    pthread_t thread[LANES];
    bool started[LANES] = {false};
    for (int i = 0; i < LANES; ++i) {
        o->lane[i].count = index == NULL ? o->samples->count : count;
        o->lane[i].index = index;
    }
    for (int i = 1; i < LANES; ++i) {
        started[i] = pthread_create(&thread[i], NULL, work, &o->lane[i]) == 0;
    }
    work(&o->lane[0]);
    double loss = o->lane[0].loss;
    memcpy(gradient, o->lane[0].gradient, (size_t)o->size * sizeof *gradient);
    for (int i = 1; i < LANES; ++i) {
        if (started[i]) {
            pthread_join(thread[i], NULL);
        } else {
            work(&o->lane[i]); // no thread to be had: the same sums, later
        }
        loss += o->lane[i].loss;
        for (int j = 0; j < o->size; ++j) {
            gradient[j] += o->lane[i].gradient[j];
        }
    }
    const double mean = 1.0 / o->lane[0].count;
    for (int j = 0; j < o->size; ++j) {
        gradient[j] *= mean;
    }
    return loss * mean;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

pm_status pm_objective_residuals(pm_objective *o, double *median, double *mean) {
    const size_t n = (size_t)o->samples->count;
    double *gradient = malloc((size_t)o->size * sizeof *gradient + 1);
    if (gradient == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a gradient");
    }
    pm_objective_evaluate(o, 0, NULL, gradient);
    free(gradient);
    *mean = 0;
    for (size_t i = 0; i < n; ++i) {
        *mean += o->square[i] / (double)n;
    }
    qsort(o->square, n, sizeof *o->square, compare);
    *median = o->square[n / 2];
    return PM_OK;
}

pm_status pm_objective_rescale(pm_objective *o) {
    double median = 0, mean = 0;
    PM_TRY(pm_objective_residuals(o, &median, &mean));
    if (o->loss.robust > 0 && median > 0) {
        o->robust_square = o->loss.robust * o->loss.robust * median;
    }
    return PM_OK;
}

// Builds the graph of the loss and its gradient, and evaluates it over chunks of samples in
// lanes (learn/team.h).
#include "learn/objective.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"
#include "learn/loss_graph.h"

// Keeps the robust scale away from zero when the fit is exact to rounding.
#define SMALLEST_MEDIAN 1e-28
#define VALUES 2 // the outputs of a run without gradient
// The most samples per run of the graph, and the most bytes that its values may take, so that they
// stay in the cache.
#define CHUNK 128
#define CHUNK_BYTES 33554432

// One lane (learn/team.h): its program of the graph, and its share of the sums.
typedef struct loss_lane {
    pm_objective *objective;
    int id;
    pm_program *program;    // loss, residuals and gradient
    pm_program *value_only; // loss and residuals
    double loss;
    double *gradient; // [size]
    // The samples of the present evaluation, and whether it is without the gradient.
    int count;
    const int *index;
    bool short_run;
} loss_lane;

struct pm_objective {
    pm_system *system;
    const pm_samples *samples;
    pm_loss loss;
    int ncomponent;     // parts and ports
    pm_params **params; // [ncomponent]
    int size;
    double robust_square; // d^2, read by the graph
    pm_node input, sum, residual;
    int chunk; // samples per run at most
    int nentry;
    pm_node *entry_gradient; // [nentry] per trained entry, PM_NO_NODE if the loss ignores it
    const pm_param_entry **entry;
    pm_lanes lanes;
    loss_lane lane[PM_TEAM_LANES]; // those of this process
    double *exchange;              // [samples->count] residuals, for a team
    double *square;                // [samples->count] per-sample residuals
    const double *importance;      // [samples->count], borrowed; NULL: 1 for all
};

// --- the graph ---

static void build_loss(pm_objective *o, pm_graph *g, const pm_loss_nodes *nodes) {
    const pm_node r = nodes->residual, degeneracy = nodes->degeneracy;
    o->residual = pm_scale(g, pm_dot(g, r, r), 1.0 / pm_graph_shape(g, r).cols);
    pm_node loss = o->residual;
    if (o->loss.robust > 0) {
        const pm_node d2 = pm_param(g, &o->robust_square, 1, 1);
        loss = pm_mul(g, d2, pm_log(g, pm_offset(g, pm_div(g, loss, d2), 1)));
    }
    if (degeneracy != PM_NO_NODE) {
        const pm_node penalty = pm_dot(g, degeneracy, degeneracy);
        loss = pm_add(g, loss, pm_scale(g, penalty, o->loss.degeneracy));
    }
    o->sum = pm_sum_to(g, loss, (pm_shape){false, 1, 1});
    pm_node *leaf = o->entry_gradient; // plan_lanes replaces these nodes by their gradients
    for (int i = 0; i < o->nentry; ++i) {
        leaf[i] = pm_weight(g, o->entry[i]->value, o->entry[i]->rows, o->entry[i]->cols);
    }
}

static pm_status choose_chunk(pm_objective *o, const pm_graph *g, int count,
                              const pm_node *output) {
    pm_program *one = NULL;
    PM_TRY(pm_program_open(&one, g, count, output, 1));
    const size_t left_out = (size_t)pm_samples_left_out(o->samples) * sizeof(double);
    const size_t fit = CHUNK_BYTES / (pm_program_bytes(one) + left_out + 1);
    pm_program_close(one);
    o->chunk = fit > CHUNK ? CHUNK : fit < 1 ? 1 : (int)fit;
    return PM_OK;
}

static pm_status plan_lanes(pm_objective *o, pm_graph *g) {
    pm_loss_nodes nodes;
    PM_TRY(pm_loss_graph_build(g, o->system, o->samples, &o->loss, &nodes));
    o->input = nodes.input;
    build_loss(o, g, &nodes);
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
    output[count++] = o->sum; // the first VALUES outputs need no gradient
    output[count++] = o->residual;
    for (int i = 0; i < o->nentry; ++i) {
        if (gradient[i] != PM_NO_NODE) {
            output[count++] = gradient[i];
        }
    }
    PM_TRY_DONE(choose_chunk(o, g, count, output));
    for (int i = 0; i < o->lanes.own; ++i) {
        loss_lane *l = &o->lane[i];
        l->objective = o;
        l->id = o->lanes.first + i;
        if (o->loss.team == NULL || i == 0) {
            PM_TRY_DONE(pm_program_open(&l->program, g, count, output, o->chunk));
            PM_TRY_DONE(pm_program_open(&l->value_only, g, VALUES, output, o->chunk));
        } else { // the lanes of a member of a team take turns
            l->program = o->lane[0].program;
            l->value_only = o->lane[0].value_only;
        }
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
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_status status = plan_lanes(o, g);
    pm_graph_close(g);
    return status;
}

// --- opening ---

static pm_status list_entries(pm_objective *o) {
    o->ncomponent = pm_system_components(o->system);
    o->params = calloc((size_t)o->ncomponent, sizeof *o->params);
    if (o->params == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a loss");
    }
    int capacity = 0;
    for (int i = 0; i < o->ncomponent; ++i) {
        o->params[i] = pm_system_params(o->system, i);
        capacity += o->params[i]->count;
        o->size += (int)pm_params_trained(o->params[i]);
    }
    o->entry = calloc((size_t)capacity + 1, sizeof *o->entry);
    o->entry_gradient = calloc((size_t)capacity + 1, sizeof *o->entry_gradient);
    o->square = calloc((size_t)o->samples->count, sizeof *o->square);
    o->exchange = calloc((size_t)o->samples->count, sizeof *o->exchange);
    if (o->entry == NULL || o->entry_gradient == NULL || o->square == NULL || o->exchange == NULL) {
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
    o->lanes = pm_team_lanes(loss->team);
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
        for (int i = 0; i < objective->lanes.own; ++i) {
            if (objective->loss.team == NULL || i == 0) {
                pm_program_close(objective->lane[i].program);
                pm_program_close(objective->lane[i].value_only);
            }
            free(objective->lane[i].gradient);
        }
        free(objective->params);
        free(objective->entry);
        free(objective->entry_gradient);
        free(objective->square);
        free(objective->exchange);
        free(objective);
    }
}

int pm_objective_size(const pm_objective *o) {
    return o->size;
}

int pm_objective_samples(const pm_objective *o) {
    return o->samples->count;
}

pm_loss_context pm_objective_context(const pm_objective *o) {
    return (pm_loss_context){o->system, o->samples, &o->loss};
}

// Returns rho'(x).
static double robust_weight(const pm_objective *o, int sample) {
    return o->loss.robust > 0 ? 1 / (1 + o->square[sample] / o->robust_square) : 1;
}

double pm_objective_sample_weight(const pm_objective *o, int sample) {
    const double importance = o->importance == NULL ? 1 : o->importance[sample];
    return importance * robust_weight(o, sample);
}

double pm_objective_sample_share(const pm_objective *o, int sample) {
    return o->square[sample] * robust_weight(o, sample);
}

void pm_objective_set_importance(pm_objective *o, const double *importance) {
    o->importance = importance;
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

static void add_gradient(loss_lane *l) {
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

// Returns the number of samples per run such that all lanes have about the same number.
static int chunk_of(int count, int most, int lanes) {
    const int runs = lanes * ((count + lanes * most - 1) / (lanes * most));
    return (count + runs - 1) / runs;
}

static void *work(void *context) {
    loss_lane *l = context;
    const pm_objective *o = l->objective;
    const int chunk = chunk_of(l->count, o->chunk, o->lanes.count);
    const size_t width = (size_t)pm_samples_width(o->samples);
    pm_program *program = l->short_run ? l->value_only : l->program;
    double *window = pm_program_value(program, o->input); // [chunk][width]
    l->loss = 0;
    memset(l->gradient, 0, (size_t)o->size * sizeof *l->gradient);
    for (int first = l->id * chunk; first < l->count; first += o->lanes.count * chunk) {
        const int batch = l->count - first < chunk ? l->count - first : chunk;
        for (int i = 0; i < batch; ++i) {
            const int sample = l->index == NULL ? first + i : l->index[first + i];
            pm_samples_window(o->samples, sample, window + (size_t)i * width);
        }
        pm_program_run(program, batch);
        l->loss += *pm_program_value(program, o->sum);
        if (!l->short_run) {
            add_gradient(l);
        }
        const double *square = pm_program_value(program, o->residual);
        for (int i = 0; i < batch; ++i) {
            const int sample = l->index == NULL ? first + i : l->index[first + i];
            o->square[sample] = square[i];
        }
    }
    return NULL;
}

// Runs the lanes of this process: alone in a thread each, in a team one after the other.
static void run_lanes(pm_objective *o) {
    pthread_t thread[PM_TEAM_LANES];
    bool started[PM_TEAM_LANES] = {false};
    for (int i = 1; i < o->lanes.own && o->loss.team == NULL; ++i) {
        started[i] = pthread_create(&thread[i], NULL, work, &o->lane[i]) == 0;
    }
    work(&o->lane[0]);
    for (int i = 1; i < o->lanes.own; ++i) {
        if (started[i]) {
            pthread_join(thread[i], NULL);
        } else {
            work(&o->lane[i]); // no thread could be started: compute the same sums here
        }
    }
}

// Gives every process of a team the residuals that the others have computed.
static void share_squares(pm_objective *o) {
    const loss_lane *l = &o->lane[0];
    const int chunk = chunk_of(l->count, o->chunk, o->lanes.count);
    for (int i = 0; i < l->count; ++i) {
        const int lane = i / chunk % o->lanes.count - o->lanes.first;
        const int sample = l->index == NULL ? i : l->index[i];
        o->exchange[i] = lane >= 0 && lane < o->lanes.own ? o->square[sample] : 0;
    }
    pm_team_sum(o->loss.team, (size_t)l->count, o->exchange);
    for (int i = 0; i < l->count; ++i) {
        const int sample = l->index == NULL ? i : l->index[i];
        o->square[sample] = o->exchange[i];
    }
}

double pm_objective_evaluate(pm_objective *o, int count, const int *index, double *gradient) {
    double *loss[PM_TEAM_LANES], *sum[PM_TEAM_LANES];
    for (int i = 0; i < o->lanes.own; ++i) {
        o->lane[i].count = index == NULL ? o->samples->count : count;
        o->lane[i].index = index;
        o->lane[i].short_run = gradient == NULL;
        loss[i] = &o->lane[i].loss;
        sum[i] = o->lane[i].gradient;
    }
    run_lanes(o);
    pm_team_add(o->loss.team, 1, loss);
    if (o->loss.team != NULL) {
        share_squares(o);
    }
    const double mean = 1.0 / o->lane[0].count;
    if (gradient != NULL) {
        pm_team_add(o->loss.team, (size_t)o->size, sum);
    }
    for (int j = 0; gradient != NULL && j < o->size; ++j) {
        gradient[j] = sum[0][j] * mean;
    }
    return *loss[0] * mean;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

// The median of the residuals of these samples (all if index is NULL), as last evaluated.
static pm_status median_square(const pm_objective *o, int count, const int *index, double *median) {
    const int n = index == NULL ? o->samples->count : count;
    double *sorted = malloc((size_t)n * sizeof *sorted);
    if (sorted == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a median");
    }
    for (int i = 0; i < n; ++i) {
        sorted[i] = o->square[index == NULL ? i : index[i]];
    }
    qsort(sorted, (size_t)n, sizeof *sorted, compare);
    *median = sorted[n / 2];
    free(sorted);
    return PM_OK;
}

pm_status pm_objective_residuals(const pm_objective *o, double *median, double *mean) {
    const int n = o->samples->count;
    *mean = 0;
    for (int i = 0; i < n; ++i) {
        *mean += o->square[i] / n;
    }
    return median_square(o, 0, NULL, median);
}

double pm_objective_robust_square(const pm_objective *o) {
    return o->robust_square;
}

void pm_objective_set_robust_square(pm_objective *o, double square) {
    o->robust_square = square;
}

pm_status pm_objective_rescale(pm_objective *o, int count, const int *index) {
    if (o->loss.robust == 0) {
        return PM_OK;
    }
    double median = 0;
    PM_TRY(median_square(o, count, index, &median));
    o->robust_square = o->loss.robust * o->loss.robust * fmax(median, SMALLEST_MEDIAN);
    return PM_OK;
}

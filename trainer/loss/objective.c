// Builds the graph of the loss and its gradient, and evaluates it over chunks of samples in
// lanes (loss/team.h).
#include "loss/objective.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "data/trained.h"
#include "graph/program.h"

// Keeps the robust scale away from zero when the fit is exact to rounding.
#define SMALLEST_MEDIAN 1e-28
#define VALUES 2 // the outputs of a run without gradient

// One lane (loss/team.h): its program of the graph, and its share of the sums.
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
    pm_arena arena; // owns the arrays
    pm_system *system;
    const pm_samples *samples;
    pm_loss loss;
    int size;
    double robust_square; // d^2, read by the graph
    pm_node input, sum, residual;
    int chunk; // samples per run at most
    int nentry;
    pm_trained *entry; // [nentry]
    pm_node *gradient; // [nentry] of each trained entry, PM_NO_NODE if the loss ignores it
    pm_lanes lanes;
    loss_lane lane[PM_TEAM_LANES]; // those of this process
    double *exchange;              // [samples->count] residuals, for a team
    double *square;                // [samples->count] per-sample residuals
    const double *importance;      // [samples->count], borrowed; NULL: 1 for all
};

// --- opening ---

static pm_status open_lanes(pm_objective *o, pm_graph *g, pm_arena *scratch) {
    pm_loss_nodes nodes;
    PM_TRY(pm_loss_graph_build(g, o->system, o->samples, &o->loss, &nodes));
    pm_node *leaf = pm_arena_array(scratch, (size_t)o->nentry + 1, sizeof *leaf);
    pm_node *output = pm_arena_array(scratch, (size_t)o->nentry + VALUES, sizeof *output);
    PM_TRY(pm_arena_status(scratch, "a loss"));
    o->input = nodes.input;
    // The sum of the losses of a batch.
    const pm_node r = nodes.residual, degeneracy = nodes.degeneracy;
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
    const pm_node sum = pm_sum_to(g, loss, (pm_shape){false, 1, 1});
    for (int i = 0; i < o->nentry; ++i) {
        const pm_param_entry *entry = o->entry[i].entry;
        leaf[i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
    o->sum = sum;
    pm_gradient(g, o->sum, PM_NO_NODE, o->nentry, leaf, o->gradient);
    int count = 0;
    output[count++] = o->sum; // the first VALUES outputs need no gradient
    output[count++] = o->residual;
    for (int i = 0; i < o->nentry; ++i) {
        if (o->gradient[i] != PM_NO_NODE) {
            output[count++] = o->gradient[i];
        }
    }
    pm_program *one = NULL;
    PM_TRY(pm_program_open(&one, g, count, output, 1));
    const size_t left_out = (size_t)pm_samples_left_out(o->samples) * sizeof(double);
    const size_t fit = PM_LOSS_CHUNK_BYTES / (pm_program_bytes(one) + left_out + 1);
    pm_program_close(one);
    o->chunk = fit > PM_LOSS_CHUNK ? PM_LOSS_CHUNK : fit < 1 ? 1 : (int)fit;
    for (int i = 0; i < o->lanes.own; ++i) {
        loss_lane *l = &o->lane[i];
        l->objective = o;
        l->id = o->lanes.first + i;
        if (o->loss.team == NULL || i == 0) {
            PM_TRY(pm_program_open(&l->program, g, count, output, o->chunk));
            PM_TRY(pm_program_open(&l->value_only, g, VALUES, output, o->chunk));
        } else { // the lanes of a member of a team take turns
            l->program = o->lane[0].program;
            l->value_only = o->lane[0].value_only;
        }
    }
    return PM_OK;
}

pm_status pm_objective_open(pm_objective **objective, pm_system *system, const pm_samples *samples,
                            const pm_loss *loss) {
    pm_objective *o = NULL;
    PM_TRY(PM_NEW(o, "a loss"));
    o->system = system;
    o->samples = samples;
    o->loss = *loss;
    o->lanes = pm_team_lanes(loss->team);
    o->robust_square = 1;
    o->size = pm_trained_count(system);
    o->nentry = pm_trained_list(system, NULL);
    o->entry = pm_arena_array(&o->arena, (size_t)o->nentry + 1, sizeof *o->entry);
    o->gradient = pm_arena_array(&o->arena, (size_t)o->nentry + 1, sizeof *o->gradient);
    o->square = pm_arena_array(&o->arena, (size_t)samples->count, sizeof *o->square);
    o->exchange = pm_arena_array(&o->arena, (size_t)samples->count, sizeof *o->exchange);
    for (int i = 0; i < o->lanes.own; ++i) {
        o->lane[i].gradient =
            pm_arena_array(&o->arena, (size_t)o->size + 1, sizeof *o->lane[i].gradient);
    }
    pm_graph *g = NULL;
    pm_arena scratch = {0};
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&o->arena, "a loss"));
    pm_trained_list(system, o->entry);
    PM_TRY_DONE(pm_graph_open(&g));
    PM_TRY_DONE(open_lanes(o, g, &scratch));
    *objective = o;
    o = NULL;
done:
    pm_graph_close(g);
    pm_arena_free(&scratch);
    pm_objective_close(o);
    return status;
}

void pm_objective_close(pm_objective *objective) {
    if (objective != NULL) {
        for (int i = 0; i < (objective->loss.team == NULL ? objective->lanes.own : 1); ++i) {
            pm_program_close(objective->lane[i].program);
            pm_program_close(objective->lane[i].value_only);
        }
        PM_DELETE(objective);
    }
}

int pm_objective_size(const pm_objective *o) {
    return o->size;
}

int pm_objective_samples(const pm_objective *o) {
    return o->samples->count;
}

int pm_objective_residual_count(const pm_objective *o) {
    return o->samples->nz * o->samples->unroll + pm_loss_balances(&o->loss, o->system);
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
    pm_trained_gather(o->system, theta);
}

void pm_objective_set_weights(pm_objective *o, const double *theta) {
    pm_trained_scatter(o->system, theta);
}

// --- evaluation ---

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
            for (int i = 0; i < o->nentry; ++i) {
                const double *from =
                    o->gradient[i] == PM_NO_NODE ? NULL : pm_program_value(program, o->gradient[i]);
                double *to = l->gradient + o->entry[i].first;
                for (int j = 0; from != NULL && j < o->entry[i].size; ++j) {
                    to[j] += from[j];
                }
            }
        }
        const double *square = pm_program_value(program, o->residual);
        for (int i = 0; i < batch; ++i) {
            const int sample = l->index == NULL ? first + i : l->index[first + i];
            o->square[sample] = square[i];
        }
    }
    return NULL;
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
    pm_team_run(o->loss.team, work, o->lane, sizeof *o->lane);
    pm_team_add(o->loss.team, 1, loss);
    if (o->loss.team != NULL) {
        // Gives every process of a team the residuals that the others have computed.
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
    const double mean = 1.0 / o->lane[0].count;
    if (gradient != NULL) {
        pm_team_add(o->loss.team, (size_t)o->size, sum);
    }
    for (int j = 0; gradient != NULL && j < o->size; ++j) {
        gradient[j] = sum[0][j] * mean;
    }
    return *loss[0] * mean;
}

// The median of the residuals of these samples (all if index is NULL), as last evaluated.
static pm_status median_square(const pm_objective *o, int count, const int *index, double *median) {
    const int n = index == NULL ? o->samples->count : count;
    double *sorted = malloc((size_t)n * sizeof *sorted);
    PM_TRY(sorted != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for a median"));
    for (int i = 0; i < n; ++i) {
        sorted[i] = o->square[index == NULL ? i : index[i]];
    }
    pm_sort((size_t)n, sorted);
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

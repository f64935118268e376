// Differences of residuals, and one reverse pass. Lanes as in loss/objective.c.
#include "optimise/bending.h"

#include <stdlib.h>
#include <string.h>

#include "data/trained.h"
#include "graph/program.h"

// The part of the step by which residuals are evaluated ahead and behind.
#define PART 0.1

typedef struct bending_lane {
    pm_bending *bending;
    int id;
    pm_program *forward, *reverse;
    double *pull; // [size] sum over the samples of this lane
} bending_lane;

struct pm_bending {
    pm_arena arena; // owns the arrays
    pm_objective *objective;
    pm_loss_context context;
    int size, nresidual, nentry, chunk;
    pm_trained *trained;           // [nentry]
    pm_node input, residual, seed; // seed [1][nresidual]: the factor of the reverse pass
    pm_node *gradient;             // [nentry], PM_NO_NODE where there is no dependence
    double *trial;                 // [size]
    double *bend;                  // [most][nresidual]
    // The samples at present. Forward, residuals times `factor` are added to `bend`; 0: reverse.
    int count;
    const int *index;
    double factor;
    pm_lanes lanes;
    bending_lane lane[PM_TEAM_LANES]; // those of this process
};

static pm_status build(pm_bending *b, pm_graph *g, pm_arena *scratch) {
    pm_loss_nodes nodes;
    const pm_loss_context *c = &b->context;
    PM_TRY(pm_loss_graph_build(g, c->system, c->samples, c->loss, &nodes));
    b->input = nodes.input;
    b->residual = pm_loss_graph_rows(g, c->loss, &nodes);
    b->nresidual = pm_graph_shape(g, b->residual).cols;
    b->seed = pm_input(g, true, 1, b->nresidual);
    pm_node *leaf = pm_arena_array(scratch, (size_t)b->nentry + 1, sizeof *leaf);
    pm_node *output = pm_arena_array(scratch, (size_t)b->nentry + 1, sizeof *output);
    PM_TRY(pm_arena_status(scratch, "the bending of a loss"));
    for (int i = 0; i < b->nentry; ++i) {
        const pm_param_entry *entry = b->trained[i].entry;
        leaf[i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
    pm_gradient(g, b->residual, b->seed, b->nentry, leaf, b->gradient);
    int count = 0;
    for (int i = 0; i < b->nentry; ++i) {
        if (b->gradient[i] != PM_NO_NODE) {
            output[count++] = b->gradient[i];
        }
    }
    PM_TRY(pm_loss_chunk(g, count, output, &b->chunk));
    for (int i = 0; i < b->lanes.own; ++i) {
        bending_lane *l = &b->lane[i];
        l->bending = b;
        l->id = b->lanes.first + i;
        if (b->context.loss->team == NULL || i == 0) {
            PM_TRY(pm_program_open(&l->forward, g, 1, &b->residual, b->chunk));
            PM_TRY(pm_program_open(&l->reverse, g, count, output, b->chunk));
        } else { // the lanes of a member of a team take turns
            l->forward = b->lane[0].forward;
            l->reverse = b->lane[0].reverse;
        }
    }
    return PM_OK;
}

pm_status pm_bending_open(pm_bending **bending, pm_objective *objective, int most) {
    pm_bending *b = NULL;
    PM_TRY(PM_NEW(b, "the bending of a loss"));
    b->objective = objective;
    b->context = pm_objective_context(objective);
    b->lanes = pm_team_lanes(b->context.loss->team);
    b->size = pm_objective_size(objective);
    b->nentry = pm_trained_list(b->context.system, NULL);
    const size_t n = (size_t)b->size + 1;
    b->trained = pm_arena_array(&b->arena, (size_t)b->nentry + 1, sizeof *b->trained);
    b->gradient = pm_arena_array(&b->arena, (size_t)b->nentry + 1, sizeof *b->gradient);
    b->trial = pm_arena_array(&b->arena, n, sizeof *b->trial);
    for (int i = 0; i < b->lanes.own; ++i) {
        b->lane[i].pull = pm_arena_array(&b->arena, n, sizeof *b->lane[i].pull);
    }
    pm_graph *g = NULL;
    pm_arena scratch = {0};
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&b->arena, "the bending of a loss"));
    pm_trained_list(b->context.system, b->trained);
    PM_TRY_DONE(pm_graph_open(&g));
    PM_TRY_DONE(build(b, g, &scratch));
    b->bend = pm_arena_array(&b->arena, (size_t)most * (size_t)b->nresidual, sizeof *b->bend);
    PM_TRY_DONE(pm_arena_status(&b->arena, "the bending of a loss"));
    *bending = b;
    b = NULL;
done:
    pm_graph_close(g);
    pm_arena_free(&scratch);
    pm_bending_close(b);
    return status;
}

void pm_bending_close(pm_bending *bending) {
    if (bending != NULL) {
        for (int i = 0; i < (bending->context.loss->team == NULL ? bending->lanes.own : 1); ++i) {
            pm_program_close(bending->lane[i].forward);
            pm_program_close(bending->lane[i].reverse);
        }
        PM_DELETE(bending);
    }
}

static void *work(void *context) {
    const bending_lane *l = context;
    const pm_bending *b = l->bending;
    const bool reverse = b->factor == 0;
    const size_t width = (size_t)pm_samples_width(b->context.samples), n = (size_t)b->nresidual;
    pm_program *program = reverse ? l->reverse : l->forward;
    double *window = pm_program_value(program, b->input);
    double *seed = reverse ? pm_program_value(program, b->seed) : NULL;
    memset(l->pull, 0, (size_t)b->size * sizeof *l->pull);
    for (int first = l->id * b->chunk; first < b->count; first += b->lanes.count * b->chunk) {
        const int batch = b->count - first < b->chunk ? b->count - first : b->chunk;
        double *bend = b->bend + (size_t)first * n;
        for (int s = 0; s < batch; ++s) {
            const int sample = b->index[first + s];
            pm_samples_window(b->context.samples, sample, window + (size_t)s * width);
            const double weight = reverse ? pm_objective_sample_weight(b->objective, sample) : 0;
            for (size_t k = 0; reverse && k < n; ++k) {
                seed[(size_t)s * n + k] = weight * bend[(size_t)s * n + k];
            }
        }
        pm_program_run(program, batch);
        const double *value = reverse ? NULL : pm_program_value(program, b->residual);
        for (size_t k = 0; !reverse && k < (size_t)batch * n; ++k) {
            bend[k] += b->factor * value[k];
        }
        for (int i = 0; reverse && i < b->nentry; ++i) {
            const double *from =
                b->gradient[i] == PM_NO_NODE ? NULL : pm_program_value(program, b->gradient[i]);
            for (int k = 0; from != NULL && k < b->trained[i].size; ++k) {
                l->pull[b->trained[i].first + k] += from[k];
            }
        }
    }
    return NULL;
}

static void run(pm_bending *b, double factor) {
    b->factor = factor;
    pm_team_run(b->context.loss->team, work, b->lane, sizeof *b->lane);
}

void pm_bending_pull(pm_bending *bending, int count, const int *index, const double *theta,
                     const double *step, double *pull) {
    pm_bending *b = bending;
    b->count = count;
    b->index = index;
    memset(b->bend, 0, (size_t)count * (size_t)b->nresidual * sizeof *b->bend);
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i < b->size; ++i) {
            b->trial[i] = theta[i] + side * PART * step[i];
        }
        pm_objective_set_weights(b->objective, b->trial);
        run(b, 1 / (PART * PART));
    }
    pm_objective_set_weights(b->objective, theta);
    run(b, -2 / (PART * PART));
    pm_objective_evaluate(b->objective, count, index, NULL);
    run(b, 0);
    double *sum[PM_TEAM_LANES];
    for (int i = 0; i < b->lanes.own; ++i) {
        sum[i] = b->lane[i].pull;
    }
    pm_team_add(b->context.loss->team, (size_t)b->size, sum);
    for (int i = 0; i < b->size; ++i) {
        pull[i] = sum[0][i] / count;
    }
}

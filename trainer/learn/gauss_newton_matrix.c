// Computes Jacobians by reverse accumulation: one pass for each residual, with the weights repeated
// for each sample so that the gradients of samples stay separate. Lanes as in learn/objective.c.
#include "learn/gauss_newton_matrix.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "graph/program.h"
#include "learn/residuals.h"

#define CHUNK 32

typedef struct jacobian_lane {
    pm_gauss_newton_matrix *normal;
    int id;
    pm_program *program;
    double *jacobian; // [CHUNK * nresidual][size]
    double *hessian;  // [size][size]
    double *gradient; // [size]
    int count;
    const int *index;
} jacobian_lane;

struct pm_gauss_newton_matrix {
    pm_objective *objective;
    pm_loss_context context;
    int size, nresidual, nentry;
    pm_node input, residual; // residual [1][nresidual]
    pm_node *derivative;     // [nresidual][nentry], PM_NO_NODE where independent
    int *entry_size;         // [nentry]
    pm_lanes lanes;
    jacobian_lane lane[PM_TEAM_LANES]; // those of this process
};

// --- opening ---

static pm_status build_derivatives(pm_gauss_newton_matrix *n, pm_graph *g, const pm_node *leaf,
                                   pm_node *output, int *noutput) {
    output[(*noutput)++] = n->residual;
    for (int r = 0; r < n->nresidual; ++r) {
        pm_node *row = n->derivative + (ptrdiff_t)r * n->nentry;
        pm_gradient(g, pm_slice(g, n->residual, r, 1), PM_NO_NODE, n->nentry, leaf, row);
        for (int i = 0; i < n->nentry; ++i) {
            if (row[i] != PM_NO_NODE) {
                output[(*noutput)++] = row[i];
            }
        }
    }
    return PM_OK;
}

static pm_status open_lanes(pm_gauss_newton_matrix *n, pm_graph *g, int noutput,
                            const pm_node *output) {
    const size_t size = (size_t)n->size;
    for (int i = 0; i < n->lanes.own; ++i) {
        jacobian_lane *l = &n->lane[i];
        l->normal = n;
        l->id = n->lanes.first + i;
        if (n->context.loss->team == NULL || i == 0) {
            PM_TRY(pm_program_open(&l->program, g, noutput, output, CHUNK));
            l->jacobian = malloc((size_t)CHUNK * (size_t)n->nresidual * size * sizeof *l->jacobian);
        } else { // the lanes of a member of a team take turns
            l->program = n->lane[0].program;
            l->jacobian = n->lane[0].jacobian;
        }
        l->hessian = malloc(size * size * sizeof *l->hessian);
        l->gradient = malloc(size * sizeof *l->gradient);
        if (l->jacobian == NULL || l->hessian == NULL || l->gradient == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for the normal equations of %d weights",
                           n->size);
        }
    }
    return PM_OK;
}

static pm_status build(pm_gauss_newton_matrix *n, pm_graph *g) {
    pm_graph_weights_per_item(g);
    PM_TRY(pm_residuals_build(g, &n->context, &n->input, &n->residual));
    n->nresidual = pm_graph_shape(g, n->residual).cols;
    n->nentry = pm_residuals_weights(g, n->context.system, NULL, NULL);
    const size_t cells = (size_t)n->nresidual * (size_t)n->nentry + 1;
    n->derivative = malloc(cells * sizeof *n->derivative);
    n->entry_size = malloc((size_t)n->nentry * sizeof *n->entry_size);
    pm_node *leaf = malloc((size_t)n->nentry * sizeof *leaf);
    pm_node *output = malloc(cells * sizeof *output);
    pm_status status = PM_OK;
    if (n->derivative == NULL || n->entry_size == NULL || leaf == NULL || output == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for the normal equations");
        goto done;
    }
    pm_residuals_weights(g, n->context.system, leaf, n->entry_size);
    int noutput = 0;
    PM_TRY_DONE(build_derivatives(n, g, leaf, output, &noutput));
    PM_TRY_DONE(open_lanes(n, g, noutput, output));
done:
    free(leaf);
    free(output);
    return status;
}

pm_status pm_gauss_newton_matrix_open(pm_gauss_newton_matrix **normal, pm_objective *objective) {
    pm_gauss_newton_matrix *n = calloc(1, sizeof *n);
    if (n == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the normal equations");
    }
    n->objective = objective;
    n->context = pm_objective_context(objective);
    n->lanes = pm_team_lanes(n->context.loss->team);
    n->size = pm_objective_size(objective);
    pm_graph *g = NULL;
    pm_status status = pm_graph_open(&g);
    if (status == PM_OK) {
        status = build(n, g);
    }
    pm_graph_close(g);
    if (status != PM_OK) {
        pm_gauss_newton_matrix_close(n);
        return status;
    }
    *normal = n;
    return PM_OK;
}

void pm_gauss_newton_matrix_close(pm_gauss_newton_matrix *normal) {
    if (normal != NULL) {
        for (int i = 0; i < normal->lanes.own; ++i) {
            if (normal->context.loss->team == NULL || i == 0) {
                pm_program_close(normal->lane[i].program);
                free(normal->lane[i].jacobian);
            }
            free(normal->lane[i].hessian);
            free(normal->lane[i].gradient);
        }
        free(normal->derivative);
        free(normal->entry_size);
        free(normal);
    }
}

// --- evaluation ---

// Fills the Jacobian rows of one residual for all samples of a chunk, multiplied by the roots of
// their robust weights, root [batch].
static void fill_rows(jacobian_lane *l, int residual, int batch, const double *root) {
    const pm_gauss_newton_matrix *n = l->normal;
    size_t first = 0;
    for (int i = 0; i < n->nentry; ++i) {
        const pm_node node = n->derivative[(ptrdiff_t)residual * n->nentry + i];
        const size_t size = (size_t)n->entry_size[i];
        const double *from = node == PM_NO_NODE ? NULL : pm_program_value(l->program, node);
        for (int s = 0; s < batch; ++s) {
            double *to = l->jacobian +
                         ((size_t)residual * (size_t)batch + (size_t)s) * (size_t)n->size + first;
            for (size_t k = 0; k < size; ++k) {
                to[k] = from == NULL ? 0 : root[s] * from[(size_t)s * size + k];
            }
        }
        first += size;
    }
}

static void add_gradient(jacobian_lane *l, int batch, const double *root) {
    const pm_gauss_newton_matrix *n = l->normal;
    const double *value = pm_program_value(l->program, n->residual);
    for (int r = 0; r < n->nresidual; ++r) {
        for (int s = 0; s < batch; ++s) {
            const double factor = root[s] * value[(ptrdiff_t)s * n->nresidual + r];
            const double *row =
                l->jacobian + ((size_t)r * (size_t)batch + (size_t)s) * (size_t)n->size;
            for (int k = 0; k < n->size; ++k) {
                l->gradient[k] += factor * row[k];
            }
        }
    }
}

static void *work(void *context) {
    jacobian_lane *l = context;
    const pm_gauss_newton_matrix *n = l->normal;
    const pm_samples *samples = n->context.samples;
    const size_t width = (size_t)pm_samples_width(samples);
    memset(l->hessian, 0, (size_t)n->size * (size_t)n->size * sizeof *l->hessian);
    memset(l->gradient, 0, (size_t)n->size * sizeof *l->gradient);
    for (int first = l->id * CHUNK; first < l->count; first += n->lanes.count * CHUNK) {
        const int batch = l->count - first < CHUNK ? l->count - first : CHUNK;
        double root[CHUNK];
        double *input = pm_program_value(l->program, n->input);
        for (int s = 0; s < batch; ++s) {
            const int sample = l->index[first + s];
            pm_samples_window(samples, sample, input + (size_t)s * width);
            root[s] = sqrt(pm_objective_sample_weight(n->objective, sample));
        }
        pm_program_run(l->program, batch);
        for (int r = 0; r < n->nresidual; ++r) {
            fill_rows(l, r, batch, root);
        }
        pm_gram_add(batch * n->nresidual, n->size, l->jacobian, l->hessian);
        add_gradient(l, batch, root);
    }
    return NULL;
}

// Runs the lanes of this process: alone in a thread each, in a team one after the other.
static void run_lanes(pm_gauss_newton_matrix *n) {
    const bool alone = n->context.loss->team == NULL;
    pthread_t thread;
    const bool started = alone && pthread_create(&thread, NULL, work, &n->lane[1]) == 0;
    for (int i = 0; i < n->lanes.own; ++i) {
        if (i != 1 || !started) {
            work(&n->lane[i]);
        }
    }
    if (started) {
        pthread_join(thread, NULL);
    }
}

void pm_gauss_newton_matrix_evaluate(pm_gauss_newton_matrix *normal, int count, const int *index,
                                     double *gradient, double *hessian) {
    pm_gauss_newton_matrix *n = normal;
    const size_t size = (size_t)n->size;
    double *first[PM_TEAM_LANES], *second[PM_TEAM_LANES];
    for (int i = 0; i < n->lanes.own; ++i) {
        n->lane[i].count = count;
        n->lane[i].index = index;
        first[i] = n->lane[i].gradient;
        second[i] = n->lane[i].hessian;
    }
    run_lanes(n);
    pm_team_add(n->context.loss->team, size, first);
    pm_team_add(n->context.loss->team, size * size, second);
    for (size_t i = 0; i < size; ++i) {
        gradient[i] = first[0][i] / count;
    }
    for (size_t i = 0; i < size * size; ++i) {
        hessian[i] = second[0][i] / count;
    }
}

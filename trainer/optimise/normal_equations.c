// Jacobians by reverse accumulation, products by two programs for each lane, and the solution of
// the damped equations with or without a matrix. Lanes as in loss/objective.c.
#include "optimise/normal_equations.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "data/trained.h"
#include "graph/program.h"

// Samples per run of a program that forms Jacobians.
#define MATRIX_CHUNK 32
// Each run gives one estimate of the diagonal. Their mean over this many has an error of a fifth.
#define FEWEST_ESTIMATES 48
// A weight without any effect at present still gets a positive diagonal entry, in units of the
// largest one.
#define SMALLEST_DIAGONAL 1e-10
// Conjugate gradients end when the last tenth of the iterations, at least FEWEST, has lowered the
// quadratic model of the loss by less than PROGRESS of its decrease for each of them (Martens, ICML
// 2010, section 4.4).
#define FEWEST_ITERATIONS 10
#define PROGRESS 5e-3
// The part of a step by which residuals are evaluated ahead and behind.
#define PART 0.1
// A step is too long where twice its acceleration is more than this part of it (Transtrum, Sethna).
#define MOST_BENT 0.75
// The width of a step of a weight that is held, which is the logarithm of a constant.
#define HELD_WIDTH 0.1

typedef struct lane {
    pm_gauss_newton *form;
    int id;
    // With a matrix, `program` computes the residuals and their derivatives. Without one, it
    // computes the gradient and the squares that estimate the diagonal, and `multiply` computes
    // products.
    pm_program *program, *multiply;
    pm_program *forward, *reverse; // of the bend
    double *jacobian;              // [MATRIX_CHUNK * nresidual][size], of a matrix
    double *gradient;              // [size] sum over the samples of this lane, also of a product
    double *second;                // [size][size] the matrix, or [size] the squares
    const double *vector;          // [size] factor of the present product; NULL: no product
    int count, chunk;
    const int *index;
    uint64_t seed;
} lane;

// How residuals bend: r'' along a step, and J^T W r''.
typedef struct bend {
    pm_node input, residual, seed; // seed [1][nresidual]: the factor of the reverse pass
    pm_node *pull;                 // [nentry], PM_NO_NODE where there is no dependence
    double *second;                // [samples][nresidual]; NULL: it was not opened
    double *trial;                 // [size] weights
    double factor; // with which residuals are added to `second`; 0: the reverse pass
} bend;

struct pm_gauss_newton {
    pm_arena arena; // owns the arrays
    bool matrix;
    pm_objective *objective;
    pm_loss_context context;
    int size, nresidual, nentry, chunk;
    int active, *column; // of the matrix: its columns, and [size] the column of each weight, or -1
    pm_trained *trained; // [nentry]
    pm_node input, residual; // residual [1][nresidual]
    // Nodes are PM_NO_NODE where there is no dependence.
    pm_node *derivative;                   // [nresidual][nentry], of a matrix
    pm_node root, sign;                    // [1][1], [1][nresidual], of products, likewise below
    pm_node *gradient, *estimate, *result; // [nentry]
    double *vector;                        // [size] read by the programs
    bend bend;
    pm_lanes lanes;
    lane lane[PM_TEAM_LANES]; // those of this process
};

// Appends the nodes that exist to output and returns their number.
static int list_outputs(int count, const pm_node *node, pm_node *output, int noutput) {
    for (int i = 0; i < count; ++i) {
        if (node[i] != PM_NO_NODE) {
            output[noutput++] = node[i];
        }
    }
    return noutput;
}

// --- the matrix: one reverse pass for each residual, with the weights repeated for each sample so
// that the gradients of samples stay separate ---

static pm_status build_matrix(pm_gauss_newton *n, pm_graph *g, const pm_node *leaf,
                              pm_arena *scratch) {
    const size_t size = (size_t)n->active;
    const size_t cells = (size_t)n->nresidual * (size_t)n->nentry + 1;
    n->derivative = pm_arena_array(&n->arena, cells, sizeof *n->derivative);
    pm_node *output = pm_arena_array(scratch, cells, sizeof *output);
    PM_TRY(pm_arena_status(&n->arena, "the normal equations"));
    PM_TRY(pm_arena_status(scratch, "the normal equations"));
    int noutput = list_outputs(1, &n->residual, output, 0);
    for (int r = 0; r < n->nresidual; ++r) {
        pm_node *row = n->derivative + (ptrdiff_t)r * n->nentry;
        pm_gradient(g, pm_slice(g, n->residual, r, 1), PM_NO_NODE, n->nentry, leaf, row);
        noutput = list_outputs(n->nentry, row, output, noutput);
    }
    for (int i = 0; i < n->lanes.own; ++i) {
        lane *l = &n->lane[i];
        if (n->context.loss->team == NULL || i == 0) {
            PM_TRY(pm_program_open(&l->program, g, noutput, output, MATRIX_CHUNK));
            l->jacobian = pm_arena_array(
                &n->arena, (size_t)MATRIX_CHUNK * (size_t)n->nresidual * size, sizeof *l->jacobian);
        } else { // in a team the lanes of a process run one after the other, and share these
            l->program = n->lane[0].program;
            l->jacobian = n->lane[0].jacobian;
        }
        l->second = pm_arena_array(&n->arena, size * size, sizeof *l->second);
    }
    return pm_arena_status(&n->arena, "the normal equations of %d weights", n->size);
}

static void *work_on_matrix(void *context) {
    lane *l = context;
    const pm_gauss_newton *n = l->form;
    const pm_samples *samples = n->context.samples;
    const size_t width = (size_t)pm_samples_width(samples), size = (size_t)n->active;
    memset(l->second, 0, size * size * sizeof *l->second);
    memset(l->gradient, 0, size * sizeof *l->gradient);
    for (int first = l->id * MATRIX_CHUNK; first < l->count;
         first += n->lanes.count * MATRIX_CHUNK) {
        const int batch = l->count - first < MATRIX_CHUNK ? l->count - first : MATRIX_CHUNK;
        double root[MATRIX_CHUNK]; // of the weights of the samples
        double *input = pm_program_value(l->program, n->input);
        for (int s = 0; s < batch; ++s) {
            const int sample = l->index[first + s];
            pm_samples_window(samples, sample, input + (size_t)s * width);
            root[s] = sqrt(pm_objective_sample_weight(n->objective, sample));
        }
        pm_program_run(l->program, batch);
        // The rows of the Jacobian, [nresidual][batch][size].
        for (int r = 0; r < n->nresidual; ++r) {
            double *rows = l->jacobian + (size_t)r * (size_t)batch * size;
            for (int i = 0; i < n->nentry; ++i) {
                const pm_node node = n->derivative[(ptrdiff_t)r * n->nentry + i];
                const size_t own = (size_t)n->trained[i].size;
                const double *from = node == PM_NO_NODE ? NULL : pm_program_value(l->program, node);
                for (int s = 0; s < batch; ++s) {
                    double *to = rows + (size_t)s * size + n->trained[i].first;
                    for (size_t k = 0; k < own; ++k) {
                        to[k] = from == NULL ? 0 : root[s] * from[(size_t)s * own + k];
                    }
                }
            }
        }
        pm_gram_add(batch * n->nresidual, n->active, l->jacobian, l->second);
        const double *value = pm_program_value(l->program, n->residual);
        for (int r = 0; r < n->nresidual; ++r) {
            for (int s = 0; s < batch; ++s) {
                const double factor = root[s] * value[(ptrdiff_t)s * n->nresidual + r];
                const double *row = l->jacobian + ((size_t)r * (size_t)batch + (size_t)s) * size;
                for (size_t k = 0; k < size; ++k) {
                    l->gradient[k] += factor * row[k];
                }
            }
        }
    }
    return NULL;
}

// Writes the mean [n] of the first or the second sums of all lanes.
static void take_mean(pm_gauss_newton *p, bool second, size_t n, int count, double *mean) {
    double *value[PM_TEAM_LANES];
    for (int i = 0; i < p->lanes.own; ++i) {
        value[i] = second ? p->lane[i].second : p->lane[i].gradient;
    }
    pm_team_add(p->context.loss->team, n, value);
    for (size_t i = 0; i < n; ++i) {
        mean[i] = value[0][i] / count;
    }
}

void pm_gauss_newton_evaluate(pm_gauss_newton *form, int count, const int *index, double *gradient,
                              double *hessian) {
    const size_t size = (size_t)form->size, active = (size_t)form->active;
    for (int i = 0; i < form->lanes.own; ++i) {
        form->lane[i].count = count;
        form->lane[i].index = index;
    }
    pm_team_run(form->context.loss->team, work_on_matrix, form->lane, sizeof *form->lane);
    take_mean(form, false, active, count, gradient);
    take_mean(form, true, active * active, count, hessian);
    // Moves rows and columns to the places of their weights, which are no earlier ones.
    for (size_t i = size; i-- > 0 && active < size;) {
        const int row = form->column[i];
        gradient[i] = row < 0 ? 0 : gradient[row];
        for (size_t k = size; k-- > 0;) {
            const int column = form->column[k];
            hessian[i * size + k] =
                row < 0 || column < 0 ? 0 : hessian[(size_t)row * active + (size_t)column];
        }
    }
}

// --- products: one program for the gradient and for the squares that estimate the diagonal, and
// one for products ---

// Returns J v as the derivative of u^T J v with respect to u. `work` [nentry] is overwritten.
static pm_node build_tangent(pm_gauss_newton *p, pm_graph *g, pm_node residual, const pm_node *leaf,
                             pm_node *work) {
    const pm_node u = pm_input(g, true, 1, p->nresidual);
    pm_gradient(g, residual, u, p->nentry, leaf, work);
    pm_node sum = PM_NO_NODE, tangent = PM_NO_NODE;
    for (int i = 0; i < p->nentry; ++i) {
        if (work[i] != PM_NO_NODE) {
            const pm_shape shape = pm_graph_shape(g, leaf[i]);
            const pm_node v = pm_param(g, p->vector + p->trained[i].first, shape.rows, shape.cols);
            const pm_node term = pm_sum_to(g, pm_mul(g, work[i], v), (pm_shape){false, 1, 1});
            sum = pm_add_or(g, sum, term);
        }
    }
    pm_gradient(g, sum, PM_NO_NODE, 1, &u, &tangent);
    return tangent;
}

static pm_status build_product(pm_gauss_newton *p, pm_graph *g, const pm_node *leaf,
                               pm_arena *scratch) {
    const size_t n = (size_t)p->nentry + 1, size = (size_t)p->size + 1;
    p->gradient = pm_arena_array(&p->arena, n, sizeof *p->gradient);
    p->estimate = pm_arena_array(&p->arena, n, sizeof *p->estimate);
    p->result = pm_arena_array(&p->arena, n, sizeof *p->result);
    p->vector = pm_arena_array(&p->arena, size, sizeof *p->vector);
    for (int i = 0; i < p->lanes.own; ++i) {
        p->lane[i].second = pm_arena_array(&p->arena, size, sizeof *p->lane[i].second);
    }
    pm_node *linear = pm_arena_array(scratch, 2 * n, sizeof *linear);
    pm_node *multiply = pm_arena_array(scratch, n, sizeof *multiply);
    PM_TRY(pm_arena_status(&p->arena, "products of %d weights", p->size));
    PM_TRY(pm_arena_status(scratch, "products of %d weights", p->size));
    p->root = pm_input(g, true, 1, 1);
    const pm_node residual = pm_mul(g, p->residual, p->root);
    p->sign = pm_input(g, true, 1, p->nresidual);
    const pm_node tangent = build_tangent(p, g, residual, leaf, p->result);
    pm_gradient(g, residual, residual, p->nentry, leaf, p->gradient);
    pm_gradient(g, residual, p->sign, p->nentry, leaf, p->estimate);
    pm_gradient(g, residual, tangent, p->nentry, leaf, p->result);
    int nlinear = list_outputs(p->nentry, p->gradient, linear, 0);
    nlinear = list_outputs(p->nentry, p->estimate, linear, nlinear);
    const int nmultiply = list_outputs(p->nentry, p->result, multiply, 0);
    PM_TRY(pm_loss_chunk(g, nlinear, linear, &p->chunk));
    PM_TRY(pm_loss_chunk(g, nmultiply, multiply, &p->chunk));
    for (int i = 0; i < p->lanes.own; ++i) {
        lane *l = &p->lane[i];
        if (p->context.loss->team == NULL || i == 0) {
            PM_TRY(pm_program_open(&l->program, g, nlinear, linear, p->chunk));
            PM_TRY(pm_program_open(&l->multiply, g, nmultiply, multiply, p->chunk));
        } else { // in a team the lanes of a process run one after the other, and share these
            l->program = p->lane[0].program;
            l->multiply = p->lane[0].multiply;
        }
    }
    return PM_OK;
}

// Adds the values of `node` [nentry], or their squares, to sum [size].
static void add(const pm_gauss_newton *p, pm_program *program, const pm_node *node, bool squared,
                double *sum) {
    for (int i = 0; i < p->nentry; ++i) {
        const double *from = node[i] == PM_NO_NODE ? NULL : pm_program_value(program, node[i]);
        double *to = sum + p->trained[i].first;
        for (int k = 0; from != NULL && k < p->trained[i].size; ++k) {
            to[k] += squared ? from[k] * from[k] : from[k];
        }
    }
}

static void *work_on_product(void *context) {
    lane *l = context;
    const pm_gauss_newton *p = l->form;
    const pm_samples *samples = p->context.samples;
    const size_t width = (size_t)pm_samples_width(samples);
    const bool linearising = l->vector == NULL;
    pm_program *program = linearising ? l->program : l->multiply;
    double *window = pm_program_value(program, p->input);
    double *root = pm_program_value(program, p->root);
    memset(l->gradient, 0, (size_t)p->size * sizeof *l->gradient);
    memset(l->second, 0, (size_t)p->size * sizeof *l->second);
    for (int first = l->id * l->chunk; first < l->count; first += p->lanes.count * l->chunk) {
        const int batch = l->count - first < l->chunk ? l->count - first : l->chunk;
        for (int i = 0; i < batch; ++i) {
            const int sample = l->index[first + i];
            pm_samples_window(samples, sample, window + (size_t)i * width);
            root[i] = sqrt(pm_objective_sample_weight(p->objective, sample));
        }
        if (linearising) {
            double *sign = pm_program_value(program, p->sign);
            pm_rng rng;
            pm_rng_init(&rng, l->seed, (uint64_t)first);
            for (int i = 0; i < batch * p->nresidual; ++i) {
                sign[i] = pm_rng_below(&rng, 2) == 0 ? -1 : 1;
            }
        }
        pm_program_run(program, batch);
        add(p, program, linearising ? p->gradient : p->result, false, l->gradient);
        if (linearising) {
            add(p, program, p->estimate, true, l->second);
        }
    }
    return NULL;
}

// Runs the lanes with chunks of about equal size, at least `runs` of them.
static void run_lanes(pm_gauss_newton *p, int count, const int *index, uint64_t seed, int runs,
                      const double *vector) {
    const int most = p->lanes.count * p->chunk;
    const int needed = p->lanes.count * ((count + most - 1) / most);
    const int total = needed < runs ? runs : needed;
    for (int i = 0; i < p->lanes.own; ++i) {
        lane *l = &p->lane[i];
        l->vector = vector;
        l->count = count;
        l->index = index;
        l->seed = seed;
        l->chunk = (count + total - 1) / total;
    }
    pm_team_run(p->context.loss->team, work_on_product, p->lane, sizeof *p->lane);
}

void pm_gauss_newton_linearise(pm_gauss_newton *form, int count, const int *index, uint64_t seed,
                               double *gradient, double *diagonal) {
    run_lanes(form, count, index, seed, FEWEST_ESTIMATES, NULL);
    take_mean(form, false, (size_t)form->size, count, gradient);
    take_mean(form, true, (size_t)form->size, count, diagonal);
}

void pm_gauss_newton_apply(pm_gauss_newton *form, int count, const int *index, const double *vector,
                           double *result) {
    memcpy(form->vector, vector, (size_t)form->size * sizeof *vector);
    run_lanes(form, count, index, 0, form->lanes.count, form->vector);
    take_mean(form, false, (size_t)form->size, count, result);
}

// --- both ---

static void add_leaves(const pm_gauss_newton *n, pm_graph *g, pm_node *leaf) {
    for (int i = 0; i < n->nentry; ++i) {
        const pm_param_entry *entry = n->trained[i].entry;
        leaf[i] = pm_weight(g, entry->value, entry->rows, entry->cols);
    }
}

static pm_status build(pm_gauss_newton *n, const bool *frozen, pm_graph *g, pm_arena *scratch) {
    if (n->matrix) {
        pm_graph_weights_per_item(g);
    }
    n->nentry = pm_trained_list(n->context.system, NULL);
    n->trained = pm_arena_array(&n->arena, (size_t)n->nentry, sizeof *n->trained);
    n->column = pm_arena_array(&n->arena, (size_t)n->size + 1, sizeof *n->column);
    pm_node *leaf = pm_arena_array(scratch, (size_t)n->nentry + 1, sizeof *leaf);
    for (int i = 0; i < n->lanes.own; ++i) {
        n->lane[i].form = n;
        n->lane[i].id = n->lanes.first + i;
        n->lane[i].gradient = pm_arena_array(&n->arena, (size_t)n->size + 1, sizeof(double));
    }
    PM_TRY(pm_arena_status(&n->arena, "the normal equations"));
    PM_TRY(pm_arena_status(scratch, "the normal equations"));
    pm_trained_list(n->context.system, n->trained);
    const int all = n->nentry;
    n->nentry = 0;
    for (int i = 0; i < all; ++i) {
        pm_trained entry = n->trained[i];
        const bool kept = !n->matrix || frozen == NULL || entry.size == 0 || !frozen[entry.first];
        for (int k = 0; k < entry.size; ++k) {
            n->column[entry.first + k] = kept ? n->active + k : -1;
        }
        if (kept) {
            entry.first = n->active;
            n->active += entry.size;
            n->trained[n->nentry++] = entry;
        }
    }
    pm_loss_nodes nodes;
    const pm_loss_context *c = &n->context;
    PM_TRY(pm_loss_graph_build(g, c->system, c->samples, c->loss, &nodes));
    n->input = nodes.input;
    n->residual = pm_loss_graph_rows(g, c->loss, &nodes);
    add_leaves(n, g, leaf);
    n->nresidual = pm_graph_shape(g, n->residual).cols;
    return n->matrix ? build_matrix(n, g, leaf, scratch) : build_product(n, g, leaf, scratch);
}

pm_status pm_gauss_newton_open(pm_gauss_newton **form, pm_objective *objective, bool matrix,
                               const bool *frozen) {
    pm_gauss_newton *n = NULL;
    PM_TRY(PM_NEW(n, "the normal equations"));
    n->matrix = matrix;
    n->objective = objective;
    n->context = pm_objective_context(objective);
    n->lanes = pm_team_lanes(n->context.loss->team);
    n->size = pm_objective_size(objective);
    pm_graph *g = NULL;
    pm_arena scratch = {0};
    pm_status status;
    PM_TRY_DONE(pm_graph_open(&g));
    PM_TRY_DONE(build(n, frozen, g, &scratch));
    *form = n;
    n = NULL;
done:
    pm_graph_close(g);
    pm_arena_free(&scratch);
    pm_gauss_newton_close(n);
    return status;
}

// --- how residuals bend ---

// Prepares the bend of a matrix on `most` samples at most.
static pm_status open_bend(pm_gauss_newton *n, int most) {
    bend *b = &n->bend;
    const pm_loss_context *c = &n->context;
    pm_loss_nodes nodes;
    pm_graph *g = NULL;
    pm_arena scratch = {0};
    int count = 0;
    pm_status status;
    pm_node *leaf = pm_arena_array(&scratch, (size_t)n->nentry + 1, sizeof *leaf);
    pm_node *output = pm_arena_array(&scratch, (size_t)n->nentry + 1, sizeof *output);
    b->pull = pm_arena_array(&n->arena, (size_t)n->nentry + 1, sizeof *b->pull);
    b->trial = pm_arena_array(&n->arena, (size_t)n->size + 1, sizeof *b->trial);
    b->second = pm_arena_array(&n->arena, (size_t)most * (size_t)n->nresidual, sizeof *b->second);
    PM_TRY_DONE(pm_arena_status(&n->arena, "the bend of a loss"));
    PM_TRY_DONE(pm_arena_status(&scratch, "the bend of a loss"));
    PM_TRY_DONE(pm_graph_open(&g));
    PM_TRY_DONE(pm_loss_graph_build(g, c->system, c->samples, c->loss, &nodes));
    b->input = nodes.input;
    b->residual = pm_loss_graph_rows(g, c->loss, &nodes);
    b->seed = pm_input(g, true, 1, n->nresidual);
    add_leaves(n, g, leaf);
    pm_gradient(g, b->residual, b->seed, n->nentry, leaf, b->pull);
    count = list_outputs(n->nentry, b->pull, output, 0);
    PM_TRY_DONE(pm_loss_chunk(g, count, output, &n->chunk));
    for (int i = 0; i < n->lanes.own; ++i) {
        lane *l = &n->lane[i];
        if (n->context.loss->team == NULL || i == 0) {
            PM_TRY_DONE(pm_program_open(&l->forward, g, 1, &b->residual, n->chunk));
            PM_TRY_DONE(pm_program_open(&l->reverse, g, count, output, n->chunk));
        } else { // the lanes of a member of a team take turns
            l->forward = n->lane[0].forward;
            l->reverse = n->lane[0].reverse;
        }
    }
done:
    pm_graph_close(g);
    pm_arena_free(&scratch);
    return status;
}

static void *work_on_bend(void *context) {
    lane *l = context;
    const pm_gauss_newton *n = l->form;
    const bend *b = &n->bend;
    const bool reverse = b->factor == 0;
    const pm_samples *samples = n->context.samples;
    const size_t width = (size_t)pm_samples_width(samples), rows = (size_t)n->nresidual;
    pm_program *program = reverse ? l->reverse : l->forward;
    double *window = pm_program_value(program, b->input);
    double *seed = reverse ? pm_program_value(program, b->seed) : NULL;
    memset(l->gradient, 0, (size_t)n->size * sizeof *l->gradient);
    for (int first = l->id * n->chunk; first < l->count; first += n->lanes.count * n->chunk) {
        const int batch = l->count - first < n->chunk ? l->count - first : n->chunk;
        double *second = b->second + (size_t)first * rows;
        for (int s = 0; s < batch; ++s) {
            const int sample = l->index[first + s];
            pm_samples_window(samples, sample, window + (size_t)s * width);
            const double weight = reverse ? pm_objective_sample_weight(n->objective, sample) : 0;
            for (size_t k = (size_t)s * rows; reverse && k < ((size_t)s + 1) * rows; ++k) {
                seed[k] = weight * second[k];
            }
        }
        pm_program_run(program, batch);
        const double *value = reverse ? NULL : pm_program_value(program, b->residual);
        for (size_t k = 0; !reverse && k < (size_t)batch * rows; ++k) {
            second[k] += b->factor * value[k];
        }
        if (reverse) {
            add(n, program, b->pull, false, l->gradient);
        }
    }
    return NULL;
}

static void run_bend(pm_gauss_newton *n, double factor) {
    n->bend.factor = factor;
    pm_team_run(n->context.loss->team, work_on_bend, n->lane, sizeof *n->lane);
}

// Computes pull [active] = J^T W r'' / count at the weights theta [size] along step [size], where
// r'' is a difference of three evaluations. It leaves `theta` in the objective, whose last
// evaluation covers these samples.
static void pull_back(pm_gauss_newton *n, int count, const int *index, const double *theta,
                      const double *step, double *pull) {
    const size_t cells = (size_t)count * (size_t)n->nresidual;
    for (int i = 0; i < n->lanes.own; ++i) {
        n->lane[i].count = count;
        n->lane[i].index = index;
    }
    memset(n->bend.second, 0, cells * sizeof *n->bend.second);
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i < n->size; ++i) {
            n->bend.trial[i] = theta[i] + side * PART * step[i];
        }
        pm_objective_set_weights(n->objective, n->bend.trial);
        run_bend(n, 1 / (PART * PART));
    }
    pm_objective_set_weights(n->objective, theta);
    run_bend(n, -2 / (PART * PART));
    pm_objective_evaluate(n->objective, count, index, NULL);
    run_bend(n, 0);
    take_mean(n, false, (size_t)n->active, count, pull);
}

void pm_gauss_newton_close(pm_gauss_newton *form) {
    if (form != NULL) {
        for (int i = 0; i < (form->context.loss->team == NULL ? form->lanes.own : 1); ++i) {
            pm_program_close(form->lane[i].program);
            pm_program_close(form->lane[i].multiply);
            pm_program_close(form->lane[i].forward);
            pm_program_close(form->lane[i].reverse);
        }
        PM_DELETE(form);
    }
}

// --- damped equations ---

pm_status pm_damped_equations_open(pm_damped_equations *e, pm_objective *objective, int accelerated,
                                   bool matrix, const bool *frozen) {
    *e = (pm_damped_equations){.size = pm_objective_size(objective),
                               .objective = objective,
                               .frozen = frozen,
                               .accelerates = true};
    const size_t n = (size_t)e->size;
    const pm_system *system = pm_objective_context(objective).system;
    const int count = pm_trained_list(system, NULL);
    e->gradient = pm_arena_array(&e->arena, n, sizeof *e->gradient);
    e->diagonal = pm_arena_array(&e->arena, n, sizeof *e->diagonal);
    e->held = pm_arena_array(&e->arena, n, sizeof *e->held);
    e->shrinks = pm_arena_array(&e->arena, n, sizeof *e->shrinks);
    e->bend = pm_arena_array(&e->arena, n, sizeof *e->bend);
    pm_trained *trained = pm_arena_array(&e->arena, (size_t)count, sizeof *trained);
    e->active = pm_arena_array(&e->arena, n, sizeof *e->active);
    e->image = pm_arena_array(&e->arena, n, sizeof *e->image);
    if (matrix) {
        e->hessian = pm_arena_array(&e->arena, n * n, sizeof *e->hessian);
        e->damped = pm_arena_array(&e->arena, n * n, sizeof *e->damped);
        e->bent = pm_arena_array(&e->arena, n, sizeof *e->bent);
    } else {
        e->residual = pm_arena_array(&e->arena, n, sizeof *e->residual);
        e->conditioned = pm_arena_array(&e->arena, n, sizeof *e->conditioned);
        e->direction = pm_arena_array(&e->arena, n, sizeof *e->direction);
    }
    PM_TRY(pm_arena_status(&e->arena, "the normal equations of %zu weights", n));
    pm_trained_list(system, trained);
    for (int i = 0; i < count; ++i) {
        for (int k = trained[i].first; k < trained[i].first + trained[i].size; ++k) {
            e->shrinks[k] = trained[i].entry->shrinks;
            e->held[k] = trained[i].entry->held;
        }
    }
    for (int i = 0; i < e->size; ++i) {
        e->active[e->nactive] = i;
        e->nactive += frozen == NULL || !frozen[i];
    }
    PM_TRY(pm_gauss_newton_open(&e->form, objective, matrix, frozen));
    return matrix && accelerated > 0 ? open_bend(e->form, accelerated) : PM_OK;
}

void pm_damped_equations_close(pm_damped_equations *e) {
    pm_gauss_newton_close(e->form);
    pm_arena_free(&e->arena);
}

void pm_damped_equations_linearise(pm_damped_equations *e, int count, const int *index,
                                   uint64_t seed, double loss, const double *theta) {
    e->count = count;
    e->index = index;
    e->hold = loss / (HELD_WIDTH * HELD_WIDTH);
    if (e->hessian != NULL) {
        pm_gauss_newton_evaluate(e->form, count, index, e->gradient, e->hessian);
        for (size_t i = 0; i < (size_t)e->size; ++i) {
            e->diagonal[i] = e->hessian[i * (size_t)e->size + i];
        }
    } else {
        pm_gauss_newton_linearise(e->form, count, index, seed, e->gradient, e->diagonal);
    }
    double largest = 0;
    for (int i = 0; i < e->size; ++i) {
        largest = fmax(largest, e->diagonal[i]);
    }
    for (int i = 0; i < e->size; ++i) {
        e->diagonal[i] += SMALLEST_DIAGONAL * largest;
        e->bend[i] = 3 * e->shrinkage * e->shrinks[i] * theta[i] * theta[i];
        e->gradient[i] += e->bend[i] * theta[i] / 3;
    }
}

double pm_damped_equations_penalty(const pm_damped_equations *e, const double *theta) {
    double sum = 0;
    for (int i = 0; i < e->size; ++i) {
        sum += e->shrinks[i] * pow(theta[i], 4);
    }
    return e->shrinkage / 4 * sum;
}

// Returns entry i of the diagonal matrix R + S + near I, which is added to H (normal_equations.h).
static double ridge(const pm_damped_equations *e, size_t i) {
    return e->hold * e->held[i] + e->bend[i] + e->near;
}

// --- conjugate gradients ---

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

static bool is_frozen(const pm_damped_equations *e, int i) {
    return e->frozen != NULL && e->frozen[i];
}

// Computes image = (H + R + damping D + near I) vector without the rows of frozen weights.
static void multiply(pm_damped_equations *e, double damping, const double *vector, double *image) {
    pm_gauss_newton_apply(e->form, e->count, e->index, vector, image);
    for (int i = 0; i < e->size; ++i) {
        image[i] += (damping * e->diagonal[i] + ridge(e, (size_t)i)) * vector[i];
        image[i] = is_frozen(e, i) ? 0 : image[i];
    }
}

// Divides the residual by the diagonal of the damped matrix, and returns their product.
static double condition(pm_damped_equations *e, double damping) {
    for (int i = 0; i < e->size; ++i) {
        e->conditioned[i] = e->residual[i] / ((1 + damping) * e->diagonal[i] + ridge(e, (size_t)i));
    }
    return dot(e->size, e->residual, e->conditioned);
}

// Preconditioned conjugate gradients (Nocedal, Wright, algorithm 5.3).
static bool solve_by_products(pm_damped_equations *e, double damping, int most, double *step) {
    const int n = e->size;
    // Starts with the guess if that is better than zero, and returns the quadratic model of the
    // loss there, g.x + x.(H + damping D + near I)x / 2. The guess must be zero for frozen weights.
    const int size = e->size;
    double model = 0;
    if (dot(size, step, step) > 0) {
        multiply(e, damping, step, e->image);
        model = dot(size, e->gradient, step) + 0.5 * dot(size, step, e->image);
    }
    const bool better = model < 0;
    for (int i = 0; i < size; ++i) {
        step[i] = better ? step[i] : 0;
        e->residual[i] = is_frozen(e, i) ? 0 : -e->gradient[i] - (better ? e->image[i] : 0);
    }
    double before[PM_MOST_CONJUGATE_GRADIENTS + 1]; // the model after each iteration
    before[0] = better ? model : 0;
    double rho = condition(e, damping);
    memcpy(e->direction, e->conditioned, (size_t)n * sizeof *e->direction);
    for (int k = 1; k <= most && rho > 0; ++k) {
        multiply(e, damping, e->direction, e->image);
        const double curvature = dot(n, e->direction, e->image);
        if (!(curvature > 0) || !isfinite(curvature)) {
            return isfinite(curvature) && k > 1;
        }
        const double length = rho / curvature;
        for (int i = 0; i < n; ++i) {
            step[i] += length * e->direction[i];
            e->residual[i] -= length * e->image[i];
        }
        before[k] = before[k - 1] - 0.5 * length * rho;
        const int lag = k / 10 > FEWEST_ITERATIONS ? k / 10 : FEWEST_ITERATIONS;
        if (k > lag && before[k - lag] - before[k] < lag * PROGRESS * -before[k]) {
            break;
        }
        const double next = condition(e, damping);
        for (int i = 0; i < n; ++i) {
            e->direction[i] = e->conditioned[i] + next / rho * e->direction[i];
        }
        rho = next;
    }
    return true;
}

// Copies the rows of weights that move from [nactive] to [size].
static void put_active(const pm_damped_equations *e, const double *own, double *all) {
    memset(all, 0, (size_t)e->size * sizeof *all);
    for (int i = 0; i < e->nactive; ++i) {
        all[e->active[i]] = own[i];
    }
}

// Returns the squared length of a vector, in which each component counts by the diagonal of H.
static double square(const pm_damped_equations *e, const double *vector) {
    double sum = 0;
    for (int i = 0; i < e->size; ++i) {
        sum += e->diagonal[i] * vector[i] * vector[i];
    }
    return sum;
}

// Solves by the factor of the matrix. If the equations accelerate, adds to the step its
// acceleration, and returns false if that is so large that the step goes beyond what two
// derivatives describe.
static bool solve_by_factor(pm_damped_equations *e, const double *theta, double damping,
                            double *step) {
    const size_t size = (size_t)e->size, n = (size_t)e->nactive;
    for (size_t i = 0; i < n; ++i) {
        const size_t own = (size_t)e->active[i];
        for (size_t k = 0; k < n; ++k) {
            e->damped[i * n + k] = e->hessian[own * size + (size_t)e->active[k]];
        }
        e->damped[i * n + i] += damping * e->diagonal[own] + ridge(e, own);
        e->image[i] = -e->gradient[own];
    }
    const bool solved = n == 0 || pm_cholesky_solve((int)n, e->damped, e->image);
    put_active(e, e->image, step);
    if (n == 0 || !solved || e->form->bend.second == NULL || !e->accelerates) {
        return solved;
    }
    pull_back(e->form, e->count, e->index, theta, step, e->image);
    for (int i = 0; i < e->nactive; ++i) {
        e->image[i] *= -0.5;
    }
    pm_cholesky_back(e->nactive, e->damped, 1, e->image);
    put_active(e, e->image, e->bent);
    if (!(4 * square(e, e->bent) <= MOST_BENT * MOST_BENT * square(e, step))) {
        return false;
    }
    for (int i = 0; i < e->size; ++i) {
        step[i] += e->bent[i];
    }
    return true;
}

bool pm_damped_equations_solve(pm_damped_equations *e, const double *theta, double damping,
                               int most, double *step) {
    if (e->hessian != NULL) {
        return solve_by_factor(e, theta, damping, step);
    }
    pm_objective_set_weights(e->objective, theta);
    assert(most <= PM_MOST_CONJUGATE_GRADIENTS);
    return solve_by_products(e, damping, most, step);
}

// Two programs for each lane, as in learn/objective.c: one for the
// gradient and for the squares that estimate the diagonal, and one for products.
#include "learn/gauss_newton_product.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "graph/program.h"
#include "learn/residuals.h"

// The most samples per run of a program, and the most bytes that its values may take, so that they
// stay in the cache.
#define CHUNK 128
#define CHUNK_BYTES 33554432
// Each run gives one estimate of the diagonal. Their mean over this many has an error of a fifth.
#define FEWEST_ESTIMATES 48

typedef struct product_lane {
    pm_gauss_newton_product *product;
    int id;
    pm_program *linear, *multiply;
    double *sum, *square; // [size] sums over the samples of this lane
    const double *vector; // [size] factor of the present product; NULL while linearising
    int count, chunk;
    const int *index;
    uint64_t seed;
} product_lane;

struct pm_gauss_newton_product {
    pm_objective *objective;
    pm_loss_context context;
    int size, nresidual, nentry, chunk;
    pm_node input, root, sign;             // root [1][1], sign [1][nresidual]
    pm_node *gradient, *estimate, *result; // [nentry], PM_NO_NODE where independent
    int *entry_size;                       // [nentry]
    double *vector;                        // [size] read by the programs
    pm_lanes lanes;
    product_lane lane[PM_TEAM_LANES]; // those of this process
};

// --- opening ---

// Returns J v as the derivative of u^T J v with respect to u.
static pm_node build_tangent(pm_gauss_newton_product *p, pm_graph *g, pm_node residual,
                             const pm_node *leaf, pm_node *work) {
    const pm_node u = pm_input(g, true, 1, p->nresidual);
    pm_gradient(g, residual, u, p->nentry, leaf, work);
    pm_node sum = PM_NO_NODE, tangent = PM_NO_NODE;
    const double *at = p->vector;
    for (int i = 0; i < p->nentry; ++i) {
        if (work[i] != PM_NO_NODE) {
            const pm_shape shape = pm_graph_shape(g, leaf[i]);
            const pm_node v = pm_param(g, at, shape.rows, shape.cols);
            const pm_node term = pm_sum_to(g, pm_mul(g, work[i], v), (pm_shape){false, 1, 1});
            sum = pm_add_or(g, sum, term);
        }
        at += p->entry_size[i];
    }
    pm_gradient(g, sum, PM_NO_NODE, 1, &u, &tangent);
    return tangent;
}

static int list_outputs(int count, const pm_node *node, pm_node *output, int noutput) {
    for (int i = 0; i < count; ++i) {
        if (node[i] != PM_NO_NODE) {
            output[noutput++] = node[i];
        }
    }
    return noutput;
}

// Chooses how many samples a program of these outputs may run at once.
static pm_status choose_chunk(pm_gauss_newton_product *p, const pm_graph *g, int count,
                              const pm_node *output) {
    pm_program *one = NULL, *two = NULL;
    PM_TRY(pm_program_open(&one, g, count, output, 1));
    const pm_status status = pm_program_open(&two, g, count, output, 2);
    if (status == PM_OK) {
        // The bytes that all samples share, such as weights and gradients, do not count.
        const size_t each = pm_program_bytes(two) - pm_program_bytes(one) + 1;
        const size_t fit = CHUNK_BYTES / each;
        const int chunk = fit > CHUNK ? CHUNK : fit < 1 ? 1 : (int)fit;
        p->chunk = p->chunk == 0 || chunk < p->chunk ? chunk : p->chunk;
    }
    pm_program_close(one);
    pm_program_close(two);
    return status;
}

static pm_status open_lane(pm_gauss_newton_product *p, int id, const pm_graph *g, int count[2],
                           pm_node *const output[2]) {
    product_lane *l = &p->lane[id];
    l->product = p;
    l->id = p->lanes.first + id;
    if (p->context.loss->team == NULL || id == 0) {
        PM_TRY(pm_program_open(&l->linear, g, count[0], output[0], p->chunk));
        PM_TRY(pm_program_open(&l->multiply, g, count[1], output[1], p->chunk));
    } else { // the lanes of a member of a team take turns
        l->linear = p->lane[0].linear;
        l->multiply = p->lane[0].multiply;
    }
    l->sum = malloc(((size_t)p->size + 1) * sizeof *l->sum);
    l->square = malloc(((size_t)p->size + 1) * sizeof *l->square);
    return l->sum != NULL && l->square != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "out of memory for products of %d weights", p->size);
}

static pm_status open_lanes(pm_gauss_newton_product *p, const pm_graph *g) {
    const size_t n = (size_t)p->nentry + 1;
    pm_node *output[2] = {malloc(2 * n * sizeof(pm_node)), malloc(n * sizeof(pm_node))};
    pm_status status = PM_OK;
    if (output[0] == NULL || output[1] == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for products");
        goto done;
    }
    int count[2];
    count[0] = list_outputs(p->nentry, p->gradient, output[0], 0);
    count[0] = list_outputs(p->nentry, p->estimate, output[0], count[0]);
    count[1] = list_outputs(p->nentry, p->result, output[1], 0);
    PM_TRY_DONE(choose_chunk(p, g, count[0], output[0]));
    PM_TRY_DONE(choose_chunk(p, g, count[1], output[1]));
    for (int i = 0; i < p->lanes.own; ++i) {
        PM_TRY_DONE(open_lane(p, i, g, count, output));
    }
done:
    free(output[0]);
    free(output[1]);
    return status;
}

static pm_status build(pm_gauss_newton_product *p, pm_graph *g, pm_node *leaf) {
    pm_node unweighted;
    PM_TRY(pm_residuals_build(g, &p->context, &p->input, &unweighted));
    p->root = pm_input(g, true, 1, 1);
    const pm_node residual = pm_mul(g, unweighted, p->root);
    p->nresidual = pm_graph_shape(g, residual).cols;
    p->sign = pm_input(g, true, 1, p->nresidual);
    pm_residuals_weights(g, p->context.system, leaf, p->entry_size);
    const pm_node tangent = build_tangent(p, g, residual, leaf, p->result);
    pm_gradient(g, residual, residual, p->nentry, leaf, p->gradient);
    pm_gradient(g, residual, p->sign, p->nentry, leaf, p->estimate);
    pm_gradient(g, residual, tangent, p->nentry, leaf, p->result);
    return open_lanes(p, g);
}

static pm_status open_product(pm_gauss_newton_product *p, pm_graph *g) {
    p->nentry = pm_residuals_weights(g, p->context.system, NULL, NULL);
    const size_t n = (size_t)p->nentry + 1;
    p->gradient = malloc(n * sizeof *p->gradient);
    p->estimate = malloc(n * sizeof *p->estimate);
    p->result = malloc(n * sizeof *p->result);
    p->entry_size = malloc(n * sizeof *p->entry_size);
    p->vector = calloc((size_t)p->size + 1, sizeof *p->vector);
    pm_node *leaf = malloc(n * sizeof *leaf);
    const bool enough = p->gradient != NULL && p->estimate != NULL && p->result != NULL &&
                        p->entry_size != NULL && p->vector != NULL && leaf != NULL;
    const pm_status status =
        enough ? build(p, g, leaf) : pm_fail(PM_ENOMEM, "out of memory for products");
    free(leaf);
    return status;
}

pm_status pm_gauss_newton_product_open(pm_gauss_newton_product **product, pm_objective *objective) {
    pm_gauss_newton_product *p = calloc(1, sizeof *p);
    if (p == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for products");
    }
    p->objective = objective;
    p->context = pm_objective_context(objective);
    p->lanes = pm_team_lanes(p->context.loss->team);
    p->size = pm_objective_size(objective);
    pm_graph *g = NULL;
    pm_status status = pm_graph_open(&g);
    if (status == PM_OK) {
        status = open_product(p, g);
    }
    pm_graph_close(g);
    if (status != PM_OK) {
        pm_gauss_newton_product_close(p);
        return status;
    }
    *product = p;
    return PM_OK;
}

void pm_gauss_newton_product_close(pm_gauss_newton_product *product) {
    if (product != NULL) {
        for (int i = 0; i < product->lanes.own; ++i) {
            if (product->context.loss->team == NULL || i == 0) {
                pm_program_close(product->lane[i].linear);
                pm_program_close(product->lane[i].multiply);
            }
            free(product->lane[i].sum);
            free(product->lane[i].square);
        }
        free(product->gradient);
        free(product->estimate);
        free(product->result);
        free(product->entry_size);
        free(product->vector);
        free(product);
    }
}

// --- evaluation ---

// Adds the values of `node` [nentry], or their squares, to sum [size].
static void add(const pm_gauss_newton_product *p, pm_program *program, const pm_node *node,
                bool squared, double *sum) {
    for (int i = 0; i < p->nentry; ++i) {
        const double *from = node[i] == PM_NO_NODE ? NULL : pm_program_value(program, node[i]);
        for (int k = 0; from != NULL && k < p->entry_size[i]; ++k) {
            sum[k] += squared ? from[k] * from[k] : from[k];
        }
        sum += p->entry_size[i];
    }
}

static void fill_signs(double *sign, int count, uint64_t seed, int first) {
    pm_rng rng;
    pm_rng_init(&rng, seed, (uint64_t)first);
    for (int i = 0; i < count; ++i) {
        sign[i] = pm_rng_below(&rng, 2) == 0 ? -1 : 1;
    }
}

// Runs one chunk of samples from `first` on.
static void run_chunk(product_lane *l, int first, int batch) {
    const pm_gauss_newton_product *p = l->product;
    const bool linearising = l->vector == NULL;
    pm_program *program = linearising ? l->linear : l->multiply;
    const size_t width = (size_t)pm_samples_width(p->context.samples);
    double *window = pm_program_value(program, p->input);
    double *root = pm_program_value(program, p->root);
    for (int i = 0; i < batch; ++i) {
        const int sample = l->index[first + i];
        pm_samples_window(p->context.samples, sample, window + (size_t)i * width);
        root[i] = sqrt(pm_objective_sample_weight(p->objective, sample));
    }
    if (linearising) {
        fill_signs(pm_program_value(program, p->sign), batch * p->nresidual, l->seed, first);
    }
    pm_program_run(program, batch);
    add(p, program, linearising ? p->gradient : p->result, false, l->sum);
    if (linearising) {
        add(p, program, p->estimate, true, l->square);
    }
}

static void *work(void *context) {
    product_lane *l = context;
    const size_t size = (size_t)l->product->size;
    memset(l->sum, 0, size * sizeof *l->sum);
    memset(l->square, 0, size * sizeof *l->square);
    const int stride = l->product->lanes.count * l->chunk;
    for (int first = l->id * l->chunk; first < l->count; first += stride) {
        run_chunk(l, first, l->count - first < l->chunk ? l->count - first : l->chunk);
    }
    return NULL;
}

// Runs the lanes of this process, with chunks of about equal size, at least `runs` of them: alone
// in a thread each, in a team one after the other.
static void run_lanes(pm_gauss_newton_product *p, int count, const int *index, uint64_t seed,
                      int runs, const double *vector) {
    const int most = p->lanes.count * p->chunk;
    const int needed = p->lanes.count * ((count + most - 1) / most);
    const int total = needed < runs ? runs : needed;
    for (int i = 0; i < p->lanes.own; ++i) {
        product_lane *l = &p->lane[i];
        l->vector = vector;
        l->count = count;
        l->index = index;
        l->seed = seed;
        l->chunk = (count + total - 1) / total;
    }
    pthread_t thread;
    const bool started =
        p->context.loss->team == NULL && pthread_create(&thread, NULL, work, &p->lane[1]) == 0;
    for (int i = 0; i < p->lanes.own; ++i) {
        if (i != 1 || !started) {
            work(&p->lane[i]);
        }
    }
    if (started) {
        pthread_join(thread, NULL);
    }
}

// Writes the mean [size] of the sums, or of the squares, of all lanes.
static void take_mean(pm_gauss_newton_product *p, bool squares, int count, double *mean) {
    double *value[PM_TEAM_LANES];
    for (int i = 0; i < p->lanes.own; ++i) {
        value[i] = squares ? p->lane[i].square : p->lane[i].sum;
    }
    pm_team_add(p->context.loss->team, (size_t)p->size, value);
    for (int i = 0; i < p->size; ++i) {
        mean[i] = value[0][i] / count;
    }
}

void pm_gauss_newton_product_linearise(pm_gauss_newton_product *product, int count,
                                       const int *index, uint64_t seed, double *gradient,
                                       double *diagonal) {
    run_lanes(product, count, index, seed, FEWEST_ESTIMATES, NULL);
    take_mean(product, false, count, gradient);
    take_mean(product, true, count, diagonal);
}

void pm_gauss_newton_product_apply(pm_gauss_newton_product *product, int count, const int *index,
                                   const double *vector, double *result) {
    memcpy(product->vector, vector, (size_t)product->size * sizeof *vector);
    run_lanes(product, count, index, 0, product->lanes.count, product->vector);
    take_mean(product, false, count, result);
}

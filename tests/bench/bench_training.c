// Compares the throughput of training with the rate of dgemm in the same run. The energy is a
// network of ten features and six layers of 200 units (203,200 weights, as many as in the program
// of the method's authors), on batches of 199 samples. The loss compares dE/dz with data, so that
// its gradient with respect to the weights needs second derivatives. The bench measures first the
// graphs alone, then the objective that `fit` minimises for a subsystem integrated by euler steps.
// Only matrix products count as operations.
#include <stdio.h>
#include <stdlib.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "bench.h"
#include "graph/node.h"
#include "graph/program.h"
#include "loss/objective.h"
#include "model/network.h"
#include "scene/model_reader.h"

#define BATCH 199
#define WIDTH 200
#define NZ 10
#define LAYERS 6

// --- dgemm ---

typedef struct product {
    bool transpose_a, transpose_b;
    int m, n, k;
    const double *a, *b;
    double *c;
} product;

static void run_product(void *context) {
    const product *p = context;
    pm_gemm(p->transpose_a, p->transpose_b, p->m, p->n, p->k, p->a, p->b, p->c);
}

static double multiply_adds(const product *p) {
    return (double)p->m * p->n * p->k;
}

// --- the network ---

typedef struct network {
    pm_params params;
    pm_program *forward, *derivative, *gradient;
    double work[3]; // multiply-adds of one run of each
} network;

static void run_forward(void *context) {
    pm_program_run(((network *)context)->forward, BATCH);
}

static void run_derivative(void *context) {
    pm_program_run(((network *)context)->derivative, BATCH);
}

static void run_gradient(void *context) {
    pm_program_run(((network *)context)->gradient, BATCH);
}

// Returns the number of multiply-adds in the matrix products that the outputs need, for one run.
static double count_work(const pm_graph *g, int count, const pm_node *output) {
    bool *needed = calloc((size_t)pm_graph_size(g), sizeof *needed);
    double sum = 0;
    for (int i = 0; i < count; ++i) {
        needed[output[i]] = true;
    }
    for (pm_node x = pm_graph_size(g) - 1; x >= 0; --x) {
        const pm_graph_node *node = pm_graph_node_at(g, x);
        for (int i = 0; i < node->noperand && needed[x]; ++i) {
            needed[node->operand[i]] = true;
        }
        if (needed[x] && (node->op == PM_OP_MATMUL || node->op == PM_OP_MATMUL_SUM)) {
            const pm_shape a = pm_graph_shape(g, node->operand[0]);
            const bool by_rows = node->op == PM_OP_MATMUL_SUM || (node->first & 1) != 0;
            sum += (double)node->shape.rows * node->shape.cols * (by_rows ? a.rows : a.cols) *
                   (node->shape.batched || a.batched ? BATCH : 1);
        }
    }
    free(needed);
    return sum;
}

static pm_status open_programs(network *n, pm_graph *g, const pm_network_spec *spec,
                               pm_symbols *symbols, const pm_layout *layout) {
    const pm_node z = pm_input(g, true, 1, NZ), target = pm_input(g, true, 1, NZ);
    symbols->count = 0;
    pm_symbols_add(symbols, g, layout, "", z);
    const pm_node E = pm_network_build(g, spec, symbols, 1, &n->params, "energy");
    pm_node dE;
    pm_gradient(g, E, PM_NO_NODE, 1, &z, &dE);
    const pm_node difference = pm_sub(g, dE, target);
    const pm_node loss = pm_sum_to(g, pm_square(g, difference), (pm_shape){false, 1, 1});
    pm_node leaf[2 * LAYERS + 8], output[2 * LAYERS + 8];
    int count = 0;
    for (int i = 0; i < n->params.count; ++i) {
        const pm_param_entry *entry = &n->params.entry[i];
        if (entry->trained) {
            leaf[count++] = pm_weight(g, entry->value, entry->rows, entry->cols);
        }
    }
    pm_gradient(g, loss, PM_NO_NODE, count, leaf, output);
    int noutput = 0;
    for (int i = 0; i < count; ++i) {
        // The last bias alone: it does not change dE.
        if (output[i] != PM_NO_NODE) {
            output[noutput++] = output[i];
        }
    }
    PM_TRY(pm_program_open(&n->forward, g, 1, &E, BATCH));
    PM_TRY(pm_program_open(&n->derivative, g, 1, &dE, BATCH));
    PM_TRY(pm_program_open(&n->gradient, g, noutput, output, BATCH));
    n->work[0] = count_work(g, 1, &E);
    n->work[1] = count_work(g, 1, &dE);
    n->work[2] = count_work(g, noutput, output);
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    for (int i = 0; i < BATCH * NZ; ++i) {
        const double x = pm_rng_normal(&rng);
        pm_program_value(n->forward, z)[i] = x;
        pm_program_value(n->derivative, z)[i] = x;
        pm_program_value(n->gradient, z)[i] = x;
        pm_program_value(n->gradient, target)[i] = pm_rng_normal(&rng);
    }
    return PM_OK;
}

static pm_status open_network(network *n) {
    static const char *const feature[] = {"z"};
    static const int hidden[LAYERS] = {WIDTH, WIDTH, WIDTH, WIDTH, WIDTH, WIDTH};
    const pm_network_spec spec = {
        .nfeature = 1, .feature = feature, .nhidden = LAYERS, .hidden = hidden};
    const pm_layout layout = {
        .ngroup = 1, .group = (pm_group[]){{"z", "1", NZ, 0, PM_ROLE_OTHER, false}}, .nz = NZ};
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, NULL, &layout, "", PM_NO_NODE);
    PM_TRY(pm_network_declare(&spec, &symbols, 1, NULL, &n->params, "energy"));
    pm_rng rng;
    pm_rng_init(&rng, 1, 1);
    pm_params_randomise(&n->params, &rng);
    pm_rng_init(&rng, 1, 2);
    pm_param_entry *output = pm_params_find(&n->params, "energy.output.weight");
    for (int i = 0; i < WIDTH; ++i) {
        output->value[i] = pm_rng_normal(&rng) / WIDTH;
    }
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_status status = open_programs(n, g, &spec, &symbols, &layout);
    pm_graph_close(g);
    return status;
}

// --- the same as fit has it ---

static const char scene_text[] = "scene: wide\n"
                                 "time: {dt: 0.001, steps: 1, integrator: euler, substeps: 1}\n"
                                 "subsystems:\n"
                                 "  a:\n"
                                 "    weights: a.h5\n"
                                 "    state:\n"
                                 "      q: {unit: m, columns: [q1, q2, q3, q4, q5]}\n"
                                 "      p: {unit: kg m/s, columns: [p1, p2, p3, p4, p5]}\n";
static const char part_text[] = "energy: {features: [q, p], hidden: [200,200,200,200,200,200]}\n"
                                "reversible: {given: [[q, p, 1.0]]}\n";
static const char *const columns[NZ] = {"q1", "q2", "q3", "q4", "q5", "p1", "p2", "p3", "p4", "p5"};

typedef struct fitting {
    pm_scene *scene;
    pm_system *system;
    pm_dataset *data;
    pm_samples samples;
    pm_objective *objective;
    double *gradient;
} fitting;

static void run_objective(void *context) {
    const fitting *f = context;
    pm_objective_evaluate(f->objective, 0, NULL, f->gradient);
}

static pm_status declare_part(pm_system *system) {
    pm_yaml_document *document = NULL;
    pm_yaml block;
    PM_TRY(pm_yaml_parse(&document, part_text, "part", &block));
    const pm_status status =
        pm_part_spec_read(block, (pm_yaml){0}, &system->arena, &system->part[0]->spec);
    pm_yaml_close(document);
    PM_TRY(status);
    PM_TRY(pm_part_declare(system->part[0]));
    pm_rng rng;
    pm_rng_init(&rng, 1, 1);
    pm_params_randomise(&system->part[0]->params, &rng);
    return PM_OK;
}

static pm_status open_fitting(fitting *f) {
    PM_TRY(pm_scene_parse(&f->scene, scene_text, "scene"));
    PM_TRY(pm_system_new(&f->system, f->scene));
    PM_TRY(declare_part(f->system));
    PM_TRY(pm_dataset_new(&f->data, 1, BATCH + 1, NZ, f->scene->physics.dt, columns));
    pm_rng rng;
    pm_rng_init(&rng, 1, 3);
    for (int i = 0; i < (BATCH + 1) * NZ; ++i) {
        f->data->z[i] = pm_rng_normal(&rng);
    }
    PM_TRY(pm_samples_make(&f->samples, f->scene, f->data, 0, 1, PM_RESIDUAL_STEP, 1, 1));
    const pm_loss loss = {
        .residual = PM_RESIDUAL_STEP, .integrator = pm_integrator_find("euler"), .substeps = 1};
    PM_TRY(pm_objective_open(&f->objective, f->system, &f->samples, &loss));
    f->gradient = calloc((size_t)pm_objective_size(f->objective), sizeof *f->gradient);
    return f->gradient != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for a gradient");
}

static void close_fitting(fitting *f) {
    pm_objective_close(f->objective);
    pm_samples_free(&f->samples);
    pm_dataset_free(f->data);
    pm_system_free(f->system);
    pm_scene_free(f->scene);
    free(f->gradient);
}

static void close_network(network *n) {
    pm_program_close(n->forward);
    pm_program_close(n->derivative);
    pm_program_close(n->gradient);
    pm_params_free(&n->params);
}

// --- the table ---

static pm_status report(const network *n, const product *p, const bench_time *time,
                        const char *path) {
    static const char *const names[] = {"dgemm 199x200x200",
                                        "dgemm 199x200x200, b transposed",
                                        "dgemm 200x200x199, a transposed",
                                        "E",
                                        "E, dE/dz",
                                        "E, dE/dz, loss, gradient by all weights",
                                        "the same by fit, two threads together"};
    bench_table *table = NULL;
    PM_TRY(bench_table_open(&table, path));
    // The mean rate of one product of each kind, as a backward pass has them.
    double work = 0, seconds = 0;
    for (int i = 0; i < 3; ++i) {
        work += multiply_adds(&p[i]);
        seconds += time[i].median;
        bench_table_add(table, names[i], time[i], 2 * multiply_adds(&p[i]), 0);
    }
    const double rate = 2 * work / seconds / 1e9;
    for (int i = 0; i < 4; ++i) {
        bench_table_add(table, names[3 + i], time[3 + i], 2 * n->work[i < 3 ? i : 2], rate);
    }
    printf("%zu weights, batches of %d; G/s: 1e9 floating-point operations of matrix products per "
           "second of CPU time\n",
           pm_params_trained(&n->params), BATCH);
    bench_table_close(table);
    return PM_OK;
}

int main(int argc, char **argv) {
    pm_linalg_init();
    network n = {.forward = NULL};
    fitting f = {.scene = NULL};
    double *memory = calloc(3 * WIDTH * WIDTH, sizeof *memory);
    pm_status status = memory == NULL ? pm_fail(PM_ENOMEM, "out of memory") : open_network(&n);
    if (status == PM_OK) {
        status = open_fitting(&f);
    }
    if (status == PM_OK) {
        double *a = memory, *b = memory + WIDTH * WIDTH, *c = memory + 2 * WIDTH * WIDTH;
        for (int i = 0; i < 2 * WIDTH * WIDTH; ++i) {
            memory[i] = 1e-3 * i;
        }
        product p[3] = {{false, false, BATCH, WIDTH, WIDTH, a, b, c},
                        {false, true, BATCH, WIDTH, WIDTH, a, b, c},
                        {true, false, WIDTH, WIDTH, BATCH, a, b, c}};
        bench_work *const work[] = {run_product,    run_product,  run_product,  run_forward,
                                    run_derivative, run_gradient, run_objective};
        void *const context[] = {&p[0], &p[1], &p[2], &n, &n, &n, &f};
        bench_time time[7];
        bench_measure(7, work, context, time);
        status = report(&n, p, time, argc > 1 ? argv[1] : NULL);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_training: %s\n", pm_error());
    }
    close_fitting(&f);
    close_network(&n);
    free(memory);
    return (int)status;
}

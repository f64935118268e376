// Finds what the results need and writes it in the order of the nodes.
#include "graph/source.h"

#include "base/linalg.h"
#include "graph/source_text.h"
#include "graph/source_writer.h"

void pm_source_prelude(FILE *file) {
    for (const char *const *line = pm_source_elementary_text; *line != NULL; ++line) {
        fputs(*line, file);
    }
    for (const char *const *line = pm_source_products_text; *line != NULL; ++line) {
        fputs(*line, file);
    }
}

// Marks the nodes that the results need, from the last one down.
static void find_needed(const pm_graph *g, int nout, const pm_source_argument *output,
                        bool *needed) {
    for (int i = 0; i < nout; ++i) {
        if (output[i].node != PM_NO_NODE) {
            needed[output[i].node] = true;
        }
    }
    for (pm_node x = pm_graph_size(g) - 1; x >= 0; --x) {
        const pm_graph_node *node = pm_graph_node_at(g, x);
        for (int i = 0; needed[x] && i < node->noperand; ++i) {
            needed[node->operand[i]] = true;
        }
    }
}

// BLAS computes large products in an order that depends on the processor.
static pm_status check_product(const pm_graph *g, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    if (node->op != PM_OP_MATMUL && node->op != PM_OP_MATMUL_SUM) {
        return PM_OK;
    }
    const pm_shape a = pm_graph_node_at(g, node->operand[0])->shape;
    const bool transposed = node->op == PM_OP_MATMUL_SUM || (node->first & 1) != 0;
    const int k = transposed ? a.rows : a.cols;
    if ((long)node->shape.rows * node->shape.cols * k <= PM_SMALL_PRODUCT) {
        return PM_OK;
    }
    return pm_fail(PM_ECONFIG,
                   "a model multiplies matrices of %d x %d x %d numbers, which only BLAS does fast "
                   "and in an order of its own: expected at most %d multiply-adds",
                   node->shape.rows, k, node->shape.cols, PM_SMALL_PRODUCT);
}

static pm_status write_body(pm_source_writer *w, const bool *needed) {
    for (pm_node x = 0; x < pm_graph_size(w->g); ++x) {
        const pm_shape shape = pm_graph_node_at(w->g, x)->shape;
        if (!needed[x]) {
            continue;
        }
        PM_TRY(check_product(w->g, x));
        w->number[x] = pm_arena_array(&w->arena, (size_t)shape.rows * (size_t)shape.cols,
                                      sizeof *w->number[x]);
        if (w->number[x] == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for a source file");
        }
        pm_source_rule(w, x);
    }
    return w->exhausted ? pm_fail(PM_ENOMEM, "out of memory for a source file") : PM_OK;
}

static void write_results(pm_source_writer *w, int nout, const pm_source_argument *output) {
    for (int i = 0; i < nout; ++i) {
        for (int k = 0; k < output[i].size; ++k) {
            fprintf(w->file, "    %s[%d] = ", output[i].name, k);
            if (output[i].node == PM_NO_NODE) {
                fputs("0.0", w->file);
            } else {
                pm_source_put(w, w->number[output[i].node][k]);
            }
            fputs(";\n", w->file);
        }
    }
}

// A product with a known +0 is left out, and its other factor may then be read by nobody.
static void write_unread(pm_source_writer *w) {
    for (pm_node x = 0; x < pm_graph_size(w->g); ++x) {
        const bool is_input = pm_graph_node_at(w->g, x)->op == PM_OP_INPUT;
        if (w->name[x] != NULL && !w->read[x] && !is_input) {
            fprintf(w->file, "    (void)%s;\n", w->name[x]);
        }
    }
}

// Writes the parameters, and takes note of the names of the inputs.
static void write_parameters(pm_source_writer *w, int nin, const pm_source_argument *input,
                             int nout, const pm_source_argument *output) {
    for (int i = 0; i < nin; ++i) {
        fprintf(w->file, "%sconst double *restrict %s", i == 0 ? "(" : ", ", input[i].name);
        if (input[i].node != PM_NO_NODE) {
            w->name[input[i].node] = input[i].name;
        }
    }
    for (int i = 0; i < nout; ++i) {
        fprintf(w->file, "%sdouble *restrict %s", i == 0 && nin == 0 ? "(" : ", ", output[i].name);
    }
    fputs(") {\n", w->file);
    for (int i = 0; i < nin; ++i) {
        fprintf(w->file, "    (void)%s;\n", input[i].name);
    }
}

pm_status pm_source_write(FILE *file, const pm_graph *graph, int nin,
                          const pm_source_argument *input, int nout,
                          const pm_source_argument *output) {
    const size_t nnode = (size_t)pm_graph_size(graph);
    pm_source_writer w = {.file = file, .g = graph};
    pm_status status = PM_OK;
    bool *needed = pm_arena_array(&w.arena, nnode + 1, sizeof *needed);
    w.number = pm_arena_array(&w.arena, nnode + 1, sizeof *w.number);
    w.name = pm_arena_array(&w.arena, nnode + 1, sizeof *w.name);
    w.read = pm_arena_array(&w.arena, nnode + 1, sizeof *w.read);
    if (pm_graph_exhausted(graph) || needed == NULL || w.number == NULL || w.name == NULL ||
        w.read == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a source file");
    } else {
        find_needed(graph, nout, output, needed);
        write_parameters(&w, nin, input, nout, output);
        status = write_body(&w, needed);
    }
    if (status == PM_OK) {
        write_results(&w, nout, output);
        write_unread(&w);
        fputs("}\n", file);
    }
    pm_arena_free(&w.arena);
    return status;
}

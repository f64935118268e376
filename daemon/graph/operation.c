// Computes every operation and derives it. A sum has a fixed order, and the sum over an item's own
// numbers has the same order whether items are outermost or lanes are innermost, so that an item
// has the same bits in any company. The derivative rules use the same operations, so that
// derivatives can be differentiated again.
#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/arena.h"
#include "base/elementary.h"
#include "base/linalg.h"
#include "base/simd.h"
#include "graph/node.h"

// Returns the number of items that lie one after the other in the result.
static int items_of(const pm_instruction *x, int batch) {
    return x->shape.batched && x->lanes == 1 ? batch : 1;
}

static size_t entries(pm_shape shape, int batch) {
    return (size_t)shape.rows * (size_t)shape.cols * (size_t)(shape.batched ? batch : 1);
}

// In the derivative rules, x is the result, dx its adjoint, and i the number of the operand.

static pm_node operand(const pm_graph *g, pm_node x, int i) {
    return pm_graph_node_at(g, x)->operand[i];
}

// Sums an adjoint to the shape of operand i, where that operand was repeated.
static pm_node reduce(pm_graph *g, pm_node x, pm_node d, int i) {
    return pm_sum_to(g, d, pm_graph_shape(g, operand(g, x, i)));
}

// --- elementwise operations (node.h) ---

// A row shorter than the widest vector register is not worth a loop of its own.
#define SHORT_ROW 8

// The loops over one row differ in which operands are contiguous, and which are one number.
#define ROW(VALUE)                                               \
    if (step == 1 && step_a == 1 && step_b == 1) {               \
        for (ptrdiff_t i = 0; i < n; ++i) {                      \
            const double a = pa[i], b = pb[i];                   \
            out[i] = VALUE;                                      \
        }                                                        \
    } else if (step == 1 && step_a == 1 && step_b == 0) {        \
        const double b = pb[0];                                  \
        for (ptrdiff_t i = 0; i < n; ++i) {                      \
            const double a = pa[i];                              \
            out[i] = VALUE;                                      \
        }                                                        \
    } else if (step == 1 && step_a == 0 && step_b == 1) {        \
        const double a = pa[0];                                  \
        for (ptrdiff_t i = 0; i < n; ++i) {                      \
            const double b = pb[i];                              \
            out[i] = VALUE;                                      \
        }                                                        \
    } else {                                                     \
        for (ptrdiff_t i = 0; i < n; ++i) {                      \
            const double a = pa[i * step_a], b = pb[i * step_b]; \
            out[i * step] = VALUE;                               \
        }                                                        \
    }

// Defines a kernel with two operands. Where rows are short, the innermost loop runs over the items.
#define ROWS(NAME, VALUE)                                                                   \
    PM_SIMD_CLONES static void run_##NAME(const pm_instruction *x, int batch) {             \
        const int outer = x->size[0] > 0 ? x->size[0] : batch;                              \
        const int size[3] = {outer, x->size[1], x->size[2]};                                \
        const bool by_item = size[2] < SHORT_ROW && outer > 1;                              \
        const int d0 = by_item ? 1 : 0, d1 = by_item ? 2 : 1, d2 = by_item ? 0 : 2;         \
        const ptrdiff_t step = x->step[d2], step_a = x->step_a[d2], step_b = x->step_b[d2]; \
        const ptrdiff_t n = size[d2];                                                       \
        for (int p = 0; p < size[d0]; ++p) {                                                \
            for (int q = 0; q < size[d1]; ++q) {                                            \
                const double *pa = x->a + p * x->step_a[d0] + q * x->step_a[d1];            \
                const double *pb = x->b + p * x->step_b[d0] + q * x->step_b[d1];            \
                double *out = x->out + p * x->step[d0] + q * x->step[d1];                   \
                ROW(VALUE)                                                                  \
            }                                                                               \
        }                                                                                   \
    }

#define BINARY(OPERATION, NAME, VALUE, DERIVATIVE_A, DERIVATIVE_B)             \
    ROWS(NAME, VALUE)                                                          \
    static pm_node adjoint_##NAME(pm_graph *g, pm_node x, pm_node dx, int i) { \
        const pm_node a = operand(g, x, 0), b = operand(g, x, 1);              \
        (void)a, (void)b;                                                      \
        return reduce(g, x, i == 0 ? DERIVATIVE_A : DERIVATIVE_B, i);          \
    }
PM_BINARY_OPERATIONS(BINARY)

#define UNARY(OPERATION, NAME, VALUE, DERIVATIVE)                              \
    static pm_node adjoint_##NAME(pm_graph *g, pm_node x, pm_node dx, int i) { \
        const pm_node a = operand(g, x, i);                                    \
        const double number = pm_graph_node_at(g, x)->number;                  \
        (void)a, (void)number, (void)dx;                                       \
        return DERIVATIVE;                                                     \
    }
PM_UNARY_OPERATIONS(UNARY)

// --- sums, dots, broadcasting ---

// Adds n numbers of a, one by one, to numbers of the result that are `step` apart.
PM_SIMD_CLONES static void add_to_row(ptrdiff_t n, const double *a, double *out, ptrdiff_t step) {
    if (step == 1) {
        for (ptrdiff_t i = 0; i < n; ++i) {
            out[i] += a[i];
        }
    } else {
        for (ptrdiff_t i = 0; i < n; ++i) {
            out[i * step] += a[i];
        }
    }
}

static void run_sum_to(const pm_instruction *x, int batch) {
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    const int outer = x->size[0] > 0 ? x->size[0] : batch; // runs of the outermost loop
    const double *a = x->a;
    for (int i = 0; i < outer; ++i) {
        for (int j = 0; j < x->size[1]; ++j, a += x->size[2]) {
            double *out = x->out + i * x->step[0] + j * x->step[1];
            if (x->size[2] >= SHORT_ROW) {
                add_to_row(x->size[2], a, out, x->step[2]);
                continue;
            }
            for (int k = 0; k < x->size[2]; ++k) {
                out[k * x->step[2]] += a[k];
            }
        }
    }
}

static pm_node adjoint_sum_to(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_broadcast_to(g, dx, pm_graph_shape(g, operand(g, x, i)));
}

// The second operand is the first one again (program.c).
ROWS(broadcast_to, ((void)b, a))

static pm_node adjoint_broadcast_to(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, dx, i);
}

// --- sums of products over lanes ---

// The terms of a sum over `count` products of numbers of a and b, for all lanes. Neighbouring terms
// are `step` apart, and neighbouring lanes `lane` apart: 1, or 0 where all lanes share the number.
typedef struct lane_terms {
    const double *a, *b;
    ptrdiff_t step_a, step_b;
    bool many_a, many_b;
    int count;
} lane_terms;

// sum[v] += a_l b_l for WIDTH lanes from `v0` on; A and B say which factor all lanes share.
#define ADD_TERM(WIDTH, SUM, L, A, B)                                        \
    {                                                                        \
        const double *pa = t->a + (L)*t->step_a, *pb = t->b + (L)*t->step_b; \
        for (int v = 0; v < (WIDTH); ++v) {                                  \
            SUM[v] += pa[(A) ? v0 + v : 0] * pb[(B) ? v0 + v : 0];           \
        }                                                                    \
    }

// Writes sums in the order of l.
#define SUM_IN_ORDER(WIDTH, A, B)                  \
    for (; v0 + (WIDTH) <= lanes; v0 += (WIDTH)) { \
        double sum[WIDTH] = {0};                   \
        for (int l = 0; l < t->count; ++l)         \
            ADD_TERM(WIDTH, sum, l, A, B)          \
        memcpy(out + v0, sum, sizeof sum);         \
    }

#define WIDE 32 // lanes whose sums do not wait for each other

#define IN_ORDER(A, B)               \
    {                                \
        SUM_IN_ORDER(WIDE, A, B)     \
        SUM_IN_ORDER(PM_LANES, A, B) \
    }

PM_SIMD_CLONES static void sum_in_order(const lane_terms *t, int lanes, double *out) {
    int v0 = 0;
    if (t->many_a && t->many_b) {
        IN_ORDER(true, true)
    } else if (t->many_a) {
        IN_ORDER(true, false)
    } else {
        IN_ORDER(false, true)
    }
}

// Writes sums in the order of an inner product in pm_gemm: eight partial sums p0 to p7.
#define ADD_PART(P, A, B)                     \
    if (l + (P) < t->count) {                 \
        ADD_TERM(PM_LANES, p##P, l + P, A, B) \
    }
#define IN_PARTS(A, B)                                                                         \
    for (int v0 = 0; v0 < lanes; v0 += PM_LANES) {                                             \
        double p0[PM_LANES] = {0}, p1[PM_LANES] = {0}, p2[PM_LANES] = {0}, p3[PM_LANES] = {0}; \
        double p4[PM_LANES] = {0}, p5[PM_LANES] = {0}, p6[PM_LANES] = {0}, p7[PM_LANES] = {0}; \
        for (int l = 0; l < t->count; l += PM_LANES) {                                         \
            ADD_PART(0, A, B)                                                                  \
            ADD_PART(1, A, B)                                                                  \
            ADD_PART(2, A, B)                                                                  \
            ADD_PART(3, A, B)                                                                  \
            ADD_PART(4, A, B)                                                                  \
            ADD_PART(5, A, B)                                                                  \
            ADD_PART(6, A, B)                                                                  \
            ADD_PART(7, A, B)                                                                  \
        }                                                                                      \
        for (int v = 0; v < PM_LANES; ++v) {                                                   \
            out[v0 + v] =                                                                      \
                ((p0[v] + p4[v]) + (p1[v] + p5[v])) + ((p2[v] + p6[v]) + (p3[v] + p7[v]));     \
        }                                                                                      \
    }

PM_SIMD_CLONES static void sum_in_parts(const lane_terms *t, int lanes, double *out) {
    if (t->many_a && t->many_b) {
        IN_PARTS(true, true)
    } else if (t->many_a) {
        IN_PARTS(true, false)
    } else {
        IN_PARTS(false, true)
    }
}

static void run_dot(const pm_instruction *x, int batch) {
    const int cols = x->shape_a.cols;
    if (x->lanes > 1) {
        lane_terms t = {.step_a = x->step_a[1],
                        .step_b = x->step_b[1],
                        .many_a = x->shape_a.batched,
                        .many_b = x->shape_b.batched,
                        .count = cols};
        for (int r = 0; r < x->shape.rows; ++r) {
            t.a = x->a + r * x->step_a[0];
            t.b = x->b + r * x->step_b[0];
            sum_in_order(&t, x->lanes, x->out + (ptrdiff_t)r * x->lanes);
        }
        return;
    }
    const int items = items_of(x, batch);
    double *out = x->out;
    for (int i = 0; i < items; ++i) {
        for (int r = 0; r < x->shape.rows; ++r) {
            const double *a = x->a + i * x->step_a[0] + r * x->step_a[1];
            const double *b = x->b + i * x->step_b[0] + r * x->step_b[1];
            double sum = 0;
            for (int c = 0; c < cols; ++c) {
                sum += a[c] * b[c];
            }
            *out++ = sum;
        }
    }
}

static pm_node adjoint_dot(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, pm_mul(g, dx, operand(g, x, 1 - i)), i);
}

// --- matrix products ---

static void run_matmul(const pm_instruction *x, int batch) {
    const bool transpose_a = (x->first & 1) != 0, transpose_b = (x->first & 2) != 0;
    const int m = x->shape.rows, n = x->shape.cols;
    const int k = transpose_a ? x->shape_a.rows : x->shape_a.cols;
    const bool many_a = x->shape_a.batched, many_b = x->shape_b.batched;
    if (x->lanes > 1) {
        const ptrdiff_t la = many_a ? x->lanes : 1, lb = many_b ? x->lanes : 1;
        const ptrdiff_t row_a = (transpose_a ? 1 : k) * la, col_b = (transpose_b ? k : 1) * lb;
        lane_terms t = {.step_a = (transpose_a ? m : 1) * la,
                        .step_b = (transpose_b ? 1 : n) * lb,
                        .many_a = many_a,
                        .many_b = many_b,
                        .count = k};
        const bool parts = transpose_b && m < PM_MANY_ROWS && k >= 4;
        double *out = x->out;
        for (int i = 0; i < m; ++i) {
            for (int j = 0; j < n; ++j, out += x->lanes) {
                t.a = x->a + i * row_a;
                t.b = x->b + j * col_b;
                if (parts) {
                    sum_in_parts(&t, x->lanes, out);
                } else {
                    sum_in_order(&t, x->lanes, out);
                }
            }
        }
        return;
    }
    if (many_a && !many_b && !transpose_a) {
        pm_gemm(false, transpose_b, batch * m, n, k, x->a, x->b, x->out);
        return;
    }
    const int items = items_of(x, batch);
    const ptrdiff_t item_a = many_a ? (ptrdiff_t)m * k : 0, item_b = many_b ? (ptrdiff_t)k * n : 0;
    for (int i = 0; i < items; ++i) {
        pm_gemm(transpose_a, transpose_b, m, n, k, x->a + i * item_a, x->b + i * item_b,
                x->out + (ptrdiff_t)i * m * n);
    }
}

// x = op(a) op(b): d op(a) = dx op(b)^T and d op(b) = op(a)^T dx, each with or without transposing.
static pm_node adjoint_matmul(pm_graph *g, pm_node x, pm_node dx, int i) {
    const bool transpose_a = (pm_graph_node_at(g, x)->first & 1) != 0;
    const bool transpose_b = (pm_graph_node_at(g, x)->first & 2) != 0;
    const pm_node a = operand(g, x, 0), b = operand(g, x, 1);
    if (i == 0) {
        const pm_node da = transpose_a ? pm_matmul(g, b, transpose_b, dx, true)
                                       : pm_matmul(g, dx, false, b, !transpose_b);
        return reduce(g, x, da, 0);
    }
    const bool summed = pm_graph_shape(g, x).batched && !pm_graph_shape(g, b).batched;
    if (summed && !transpose_a) {
        return transpose_b ? pm_matmul_sum(g, dx, a) : pm_matmul_sum(g, a, dx);
    }
    const pm_node db = transpose_b ? pm_matmul(g, dx, true, a, transpose_a)
                                   : pm_matmul(g, a, !transpose_a, dx, false);
    return reduce(g, x, db, 1);
}

static void run_matmul_sum(const pm_instruction *x, int batch) {
    const int k = x->shape_a.rows * (x->shape_a.batched ? batch : 1);
    pm_gemm(true, false, x->shape.rows, x->shape.cols, k, x->a, x->b, x->out);
}

// x = sum over the batch of a^T b.
static pm_node adjoint_matmul_sum(pm_graph *g, pm_node x, pm_node dx, int i) {
    return i == 0 ? pm_matmul(g, operand(g, x, 1), false, dx, true)
                  : pm_matmul(g, operand(g, x, 0), false, dx, false);
}

// --- layout ---

// A program makes a view of every reshape.
static void run_reshape(const pm_instruction *x, int batch) {
    (void)x, (void)batch;
    assert(false);
}

static pm_node adjoint_reshape(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_shape shape = pm_graph_shape(g, operand(g, x, i));
    return pm_reshape(g, dx, shape.rows, shape.cols);
}

static size_t total_rows(const pm_instruction *x, int batch) {
    return (size_t)x->shape.rows * (size_t)items_of(x, batch);
}

// Copies `count` columns of every row from one matrix into another.
static void copy_columns(size_t rows, int count, const double *from, int from_cols, double *to,
                         int to_cols) {
    if (count < SHORT_ROW) {
        for (int c = 0; c < count; ++c) {
            for (size_t r = 0; r < rows; ++r) {
                to[r * (size_t)to_cols + (size_t)c] = from[r * (size_t)from_cols + (size_t)c];
            }
        }
        return;
    }
    for (size_t r = 0; r < rows; ++r, from += from_cols, to += to_cols) {
        memcpy(to, from, (size_t)count * sizeof *to);
    }
}

static void run_slice(const pm_instruction *x, int batch) {
    const int n = x->lanes;
    copy_columns(total_rows(x, batch), x->shape.cols * n, x->a + (ptrdiff_t)x->first * n,
                 x->shape_a.cols * n, x->out, x->shape.cols * n);
}

static pm_node adjoint_slice(pm_graph *g, pm_node x, pm_node dx, int i) {
    const int cols = pm_graph_shape(g, operand(g, x, i)).cols;
    return pm_place(g, dx, pm_graph_node_at(g, x)->first, cols);
}

static void run_place(const pm_instruction *x, int batch) {
    const int n = x->lanes;
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    copy_columns(total_rows(x, batch), x->shape_a.cols * n, x->a, x->shape_a.cols * n,
                 x->out + (ptrdiff_t)x->first * n, x->shape.cols * n);
}

static pm_node adjoint_place(pm_graph *g, pm_node x, pm_node dx, int i) {
    const int cols = pm_graph_shape(g, operand(g, x, i)).cols;
    return pm_slice(g, dx, pm_graph_node_at(g, x)->first, cols);
}

static void run_concat(const pm_instruction *x, int batch) {
    const size_t rows = total_rows(x, batch);
    double *out = x->out;
    for (int i = 0; i < x->nindex; ++i) {
        const int cols = x->part_cols[i] * x->lanes;
        if (rows == 1 && x->lanes == 1) {
            for (int c = 0; c < cols; ++c) {
                out[c] = x->part[i][c];
            }
        } else {
            copy_columns(rows, cols, x->part[i], cols, out, x->shape.cols * x->lanes);
        }
        out += cols;
    }
}

static pm_node adjoint_concat(pm_graph *g, pm_node x, pm_node dx, int i) {
    int first = 0;
    for (int j = 0; j < i; ++j) {
        first += pm_graph_shape(g, operand(g, x, j)).cols;
    }
    const int cols = pm_graph_shape(g, operand(g, x, i)).cols;
    const pm_graph_node *node = pm_graph_node_at(g, dx);
    if (node->op == PM_OP_PLACE) { // elsewhere it is zero
        const int begin = node->first, end = begin + pm_graph_shape(g, node->operand[0]).cols;
        if (end <= first || begin >= first + cols) {
            return PM_NO_NODE;
        }
    }
    return reduce(g, x, pm_slice(g, dx, first, cols), i);
}

static void run_gather_rows(const pm_instruction *x, int batch) {
    const int items = items_of(x, batch), cols = x->shape.cols * x->lanes;
    double *out = x->out;
    for (int i = 0; i < items; ++i) {
        const double *a = x->a + (ptrdiff_t)i * x->shape_a.rows * cols;
        for (int r = 0; r < x->nindex; ++r, out += cols) {
            memcpy(out, a + (ptrdiff_t)x->index[r] * cols, (size_t)cols * sizeof *out);
        }
    }
}

static pm_node adjoint_gather_rows(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    const int rows = pm_graph_shape(g, operand(g, x, i)).rows;
    return reduce(g, x, pm_scatter_add_rows(g, dx, rows, node->nindex, node->index), i);
}

static void run_scatter_add_rows(const pm_instruction *x, int batch) {
    const int items = items_of(x, batch), cols = x->shape.cols * x->lanes;
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    const double *a = x->a;
    for (int i = 0; i < items; ++i) {
        double *out = x->out + (ptrdiff_t)i * x->shape.rows * cols;
        for (int r = 0; r < x->nindex; ++r, a += cols) {
            double *row = out + (ptrdiff_t)x->index[r] * cols;
            if (cols < SHORT_ROW) {
                for (int c = 0; c < cols; ++c) {
                    row[c] += a[c];
                }
            } else {
                add_to_row(cols, a, row, 1);
            }
        }
    }
}

static pm_node adjoint_scatter_add_rows(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    return reduce(g, x, pm_gather_rows(g, dx, node->nindex, node->index), i);
}

// --- the table ---

#define OF_TWO(OPERATION, NAME, ...) [PM_OP_##OPERATION] = {run_##NAME, adjoint_##NAME, true},
#define OF_ONE(OPERATION, NAME, ...) [PM_OP_##OPERATION] = {NULL, adjoint_##NAME, true},
#define OTHER(OPERATION, NAME) [PM_OP_##OPERATION] = {run_##NAME, adjoint_##NAME, false},

// clang-format off
const pm_operation pm_operations[PM_OP_COUNT] = {
    PM_BINARY_OPERATIONS(OF_TWO)
    PM_UNARY_OPERATIONS(OF_ONE)
    PM_OTHER_OPERATIONS(OTHER)
};
// clang-format on

// --- rows ---

// A case of a kind of row. The result may take the place of an operand, number by number, so that
// the loop has no order.
#define ROW_CASE(KIND, ONE, A, B, VALUE)         \
    case (KIND): {                               \
        const double number = ONE, one = number; \
        (void)one, (void)number;                 \
        PM_SIMD_LOOP                             \
        for (ptrdiff_t i = 0; i < n; ++i) {      \
            const double a = A, b = B;           \
            (void)b;                             \
            out[i] = VALUE;                      \
        }                                        \
        break;                                   \
    }
#define BINARY_CASES(OPERATION, NAME, VALUE, ...)                               \
    ROW_CASE(PM_ROW(PM_OP_##OPERATION, PM_ROW_NEITHER), 0, pa[i], pb[i], VALUE) \
    ROW_CASE(PM_ROW(PM_OP_##OPERATION, PM_ROW_SECOND), *pb, pa[i], one, VALUE)  \
    ROW_CASE(PM_ROW(PM_OP_##OPERATION, PM_ROW_FIRST), *pa, one, pb[i], VALUE)
#define UNARY_CASE(OPERATION, NAME, VALUE, ...) \
    ROW_CASE(PM_ROW(PM_OP_##OPERATION, PM_ROW_NEITHER), row->number, pa[i], 0, VALUE)

PM_SIMD_CLONES void pm_rows_run(const pm_row *row, const pm_row *end, int batch) {
    for (; row < end; ++row) {
        if (row->kind < 0) {
            row->whole->run(row->whole, batch);
            continue;
        }
        const ptrdiff_t n = (ptrdiff_t)row->n * (row->many ? batch : 1);
        const double *pa = row->a, *pb = row->b; // pb is nothing where there is one operand
        double *out = row->out;
        switch (row->kind) {
            PM_BINARY_OPERATIONS(BINARY_CASES)
            PM_UNARY_OPERATIONS(UNARY_CASE)
            ROW_CASE(PM_ROW(PM_OP_SLICE, PM_ROW_NEITHER), 0, pa[i * row->stride], 0, a)
        }
    }
}

// --- reverse accumulation ---

// A walk over the nodes from `first`, the first one whose derivative is wanted, to `last`. Earlier
// nodes cannot depend on a wanted one. Arrays are indexed from `first`.
typedef struct reverse_walk {
    pm_node first, last;
    bool *leads;      // whether the node is wanted or depends on a wanted node
    pm_node *adjoint; // d last / d node; PM_NO_NODE: zero
} reverse_walk;

// Walks from the result to the leaves and adds up adjoints. Nodes are built only for operands that
// depend on a node whose derivative is wanted.
static void accumulate(pm_graph *g, reverse_walk *w) {
    for (pm_node x = w->last; x >= w->first; --x) {
        const pm_node adjoint = w->adjoint[x - w->first];
        if (adjoint == PM_NO_NODE || !w->leads[x - w->first]) {
            continue;
        }
        const pm_op op = pm_graph_node_at(g, x)->op;
        const int noperand = pm_graph_node_at(g, x)->noperand;
        for (int i = 0; i < noperand; ++i) {
            const pm_node operand = pm_graph_node_at(g, x)->operand[i];
            if (operand >= w->first && w->leads[operand - w->first]) {
                const pm_node term = pm_operations[op].adjoint(g, x, adjoint, i);
                pm_node *sum = &w->adjoint[operand - w->first];
                *sum = pm_add_or(g, *sum, term);
            }
        }
    }
}

void pm_gradient(pm_graph *g, pm_node y, pm_node seed, int count, const pm_node *x, pm_node *dx) {
    reverse_walk w = {.first = y, .last = y};
    for (int i = 0; i < count; ++i) {
        dx[i] = PM_NO_NODE;
        w.first = x[i] != PM_NO_NODE && x[i] < w.first ? x[i] : w.first;
    }
    if (y == PM_NO_NODE || pm_graph_exhausted(g)) {
        return;
    }
    pm_arena scratch = {0};
    const size_t size = (size_t)(w.last - w.first) + 1;
    w.leads = pm_arena_array(&scratch, size, sizeof *w.leads);
    w.adjoint = pm_arena_array(&scratch, size, sizeof *w.adjoint);
    if (scratch.failed) {
        pm_graph_exhaust(g);
        goto done;
    }
    for (int i = 0; i < count; ++i) {
        if (x[i] != PM_NO_NODE && x[i] <= y) {
            w.leads[x[i] - w.first] = true;
        }
    }
    for (pm_node at = w.first; at <= y; ++at) {
        bool *leads = &w.leads[at - w.first];
        for (int i = 0; i < pm_graph_node_at(g, at)->noperand && !*leads; ++i) {
            const pm_node operand = pm_graph_node_at(g, at)->operand[i];
            *leads = operand >= w.first && w.leads[operand - w.first];
        }
        w.adjoint[at - w.first] = PM_NO_NODE;
    }
    if (w.leads[y - w.first]) {
        const pm_shape shape = pm_graph_shape(g, y);
        w.adjoint[y - w.first] =
            seed != PM_NO_NODE ? seed : pm_broadcast_to(g, pm_constant(g, 1, 1, 1), shape);
        accumulate(g, &w);
    }
    for (int i = 0; i < count; ++i) {
        dx[i] = x[i] != PM_NO_NODE && x[i] <= y ? w.adjoint[x[i] - w.first] : PM_NO_NODE;
    }
done:
    pm_arena_free(&scratch);
}

// Reverse accumulation gives s -> s^T dy/dx for any s. It is linear in s, so that its own
// derivative by s along dx is dy/dx dx.
pm_node pm_tangent(pm_graph *g, pm_node y, int count, const pm_node *x, const pm_node *dx) {
    const pm_shape shape = pm_graph_shape(g, y);
    pm_node sum = PM_NO_NODE;
    for (int i = 0; i < count; ++i) {
        const pm_node seed = pm_input(g, shape.batched, shape.rows, shape.cols);
        pm_node slope = PM_NO_NODE, along = PM_NO_NODE;
        if (x[i] != PM_NO_NODE && dx[i] != PM_NO_NODE) {
            pm_gradient(g, y, seed, 1, &x[i], &slope);
        }
        if (slope != PM_NO_NODE) {
            pm_gradient(g, slope, dx[i], 1, &seed, &along);
        }
        sum = pm_add_or(g, sum, along);
    }
    return sum;
}

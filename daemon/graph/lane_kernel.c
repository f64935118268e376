// Computes operations for many items at once. The items are innermost: every number of a batched
// node is a row of `lanes` items, and a kernel treats all items of a row alike. The sum over an
// item's own numbers has the order that kernel.c and pm_gemm give it for one item, so that an item
// has the same bits in any company.
#include <assert.h>
#include <string.h>

#include "base/linalg.h"
#include "base/simd.h"
#include "graph/node.h"

// Returns the distance in numbers between neighbours of an operand that are one number apart.
static ptrdiff_t lanes_of(pm_shape shape, int lanes) {
    return shape.batched ? lanes : 1;
}

// --- elementwise with two operands ---

// Each operand is a row of lanes, or one number that all lanes share.
#define LANE_BINARY(NAME, EXPRESSION)                                                        \
    PM_SIMD_CLONES static void NAME##_row(int lanes, const double *pa, bool many_a,          \
                                          const double *pb, bool many_b, double *out) {      \
        if (many_a && many_b) {                                                              \
            for (int l = 0; l < lanes; ++l) {                                                \
                const double a = pa[l], b = pb[l];                                           \
                out[l] = EXPRESSION;                                                         \
            }                                                                                \
        } else if (many_a) {                                                                 \
            const double b = pb[0];                                                          \
            for (int l = 0; l < lanes; ++l) {                                                \
                const double a = pa[l];                                                      \
                out[l] = EXPRESSION;                                                         \
            }                                                                                \
        } else {                                                                             \
            const double a = pa[0];                                                          \
            for (int l = 0; l < lanes; ++l) {                                                \
                const double b = pb[l];                                                      \
                out[l] = EXPRESSION;                                                         \
            }                                                                                \
        }                                                                                    \
    }                                                                                        \
    static void NAME(const pm_instruction *x, int lanes) {                                   \
        const pm_stride sa = x->stride_a, sb = x->stride_b;                                  \
        const ptrdiff_t la = lanes_of(x->shape_a, lanes), lb = lanes_of(x->shape_b, lanes);  \
        double *out = x->out;                                                                \
        if (x->first != 0) { /* both operands have the result's shape: one long row */       \
            NAME##_row(x->shape.rows * x->shape.cols * lanes, x->a, true, x->b, true, out);  \
            return;                                                                          \
        }                                                                                    \
        for (int r = 0; r < x->shape.rows; ++r) {                                            \
            for (int c = 0; c < x->shape.cols; ++c, out += lanes) {                          \
                NAME##_row(lanes, x->a + (r * sa.row + c * sa.col) * la, x->shape_a.batched, \
                           x->b + (r * sb.row + c * sb.col) * lb, x->shape_b.batched, out);  \
            }                                                                                \
        }                                                                                    \
    }

LANE_BINARY(run_add, a + b)
LANE_BINARY(run_sub, a - b)
LANE_BINARY(run_mul, a *b)
LANE_BINARY(run_div, a / b)

// --- sums, dots, broadcasting ---

PM_SIMD_CLONES static void add_row(int lanes, const double *a, double *out) {
    for (int l = 0; l < lanes; ++l) {
        out[l] += a[l];
    }
}

// Copies a row, or repeats one number.
static void copy_row(int lanes, const double *a, bool many, double *out) {
    if (many) {
        memcpy(out, a, (size_t)lanes * sizeof *out);
        return;
    }
    for (int l = 0; l < lanes; ++l) {
        out[l] = a[0];
    }
}

static size_t row_numbers(pm_shape shape, int lanes) {
    return (size_t)shape.rows * (size_t)shape.cols * (size_t)lanes;
}

static void run_sum_to(const pm_instruction *x, int lanes) {
    const pm_stride s = x->stride_a; // of the result, while the loops walk over the operand
    memset(x->out, 0, row_numbers(x->shape, lanes) * sizeof *x->out);
    const double *a = x->a;
    for (int r = 0; r < x->shape_a.rows; ++r) {
        for (int c = 0; c < x->shape_a.cols; ++c, a += lanes) {
            add_row(lanes, a, x->out + (r * s.row + c * s.col) * lanes);
        }
    }
}

static void run_broadcast_to(const pm_instruction *x, int lanes) {
    const pm_stride s = x->stride_a;
    const ptrdiff_t la = lanes_of(x->shape_a, lanes);
    double *out = x->out;
    for (int r = 0; r < x->shape.rows; ++r) {
        for (int c = 0; c < x->shape.cols; ++c, out += lanes) {
            copy_row(lanes, x->a + (r * s.row + c * s.col) * la, x->shape_a.batched, out);
        }
    }
}

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

static void run_dot(const pm_instruction *x, int lanes) {
    const ptrdiff_t la = lanes_of(x->shape_a, lanes), lb = lanes_of(x->shape_b, lanes);
    lane_terms t = {.step_a = x->stride_a.col * la,
                    .step_b = x->stride_b.col * lb,
                    .many_a = x->shape_a.batched,
                    .many_b = x->shape_b.batched,
                    .count = x->shape_a.cols};
    for (int r = 0; r < x->shape.rows; ++r) {
        t.a = x->a + r * x->stride_a.row * la;
        t.b = x->b + r * x->stride_b.row * lb;
        sum_in_order(&t, lanes, x->out + (ptrdiff_t)r * lanes);
    }
}

// --- matrix products ---

static int inner_size(const pm_instruction *x) {
    return (x->first & 1) != 0 ? x->shape_a.rows : x->shape_a.cols;
}

static void run_matmul(const pm_instruction *x, int lanes) {
    const bool transpose_a = (x->first & 1) != 0, transpose_b = (x->first & 2) != 0;
    const int m = x->shape.rows, n = x->shape.cols, k = inner_size(x);
    const ptrdiff_t la = lanes_of(x->shape_a, lanes), lb = lanes_of(x->shape_b, lanes);
    const ptrdiff_t row_a = (transpose_a ? 1 : k) * la, col_b = (transpose_b ? k : 1) * lb;
    const bool parts = transpose_b && m < PM_MANY_ROWS && k >= 4;
    lane_terms t = {.step_a = (transpose_a ? m : 1) * la,
                    .step_b = (transpose_b ? 1 : n) * lb,
                    .many_a = x->shape_a.batched,
                    .many_b = x->shape_b.batched,
                    .count = k};
    double *out = x->out;
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j < n; ++j, out += lanes) {
            t.a = x->a + i * row_a;
            t.b = x->b + j * col_b;
            if (parts) {
                sum_in_parts(&t, lanes, out);
            } else {
                sum_in_order(&t, lanes, out);
            }
        }
    }
}

// --- layout ---

// Copies `count` columns of every row from one matrix into another.
static void copy_columns(int rows, int count, const double *from, int from_cols, double *to,
                         int to_cols, int lanes) {
    for (int r = 0; r < rows; ++r) {
        memcpy(to + (ptrdiff_t)r * to_cols * lanes, from + (ptrdiff_t)r * from_cols * lanes,
               (size_t)count * (size_t)lanes * sizeof *to);
    }
}

static void run_slice(const pm_instruction *x, int lanes) {
    copy_columns(x->shape.rows, x->shape.cols, x->a + (ptrdiff_t)x->first * lanes, x->shape_a.cols,
                 x->out, x->shape.cols, lanes);
}

static void run_place(const pm_instruction *x, int lanes) {
    memset(x->out, 0, row_numbers(x->shape, lanes) * sizeof *x->out);
    copy_columns(x->shape.rows, x->shape_a.cols, x->a, x->shape_a.cols,
                 x->out + (ptrdiff_t)x->first * lanes, x->shape.cols, lanes);
}

static void run_concat(const pm_instruction *x, int lanes) {
    double *out = x->out;
    for (int i = 0; i < x->nindex; ++i) {
        copy_columns(x->shape.rows, x->part_cols[i], x->part[i], x->part_cols[i], out,
                     x->shape.cols, lanes);
        out += (ptrdiff_t)x->part_cols[i] * lanes;
    }
}

static void run_gather_rows(const pm_instruction *x, int lanes) {
    const ptrdiff_t la = lanes_of(x->shape_a, lanes);
    double *out = x->out;
    for (int r = 0; r < x->nindex; ++r) {
        for (int c = 0; c < x->shape.cols; ++c, out += lanes) {
            copy_row(lanes, x->a + ((ptrdiff_t)x->index[r] * x->shape.cols + c) * la,
                     x->shape_a.batched, out);
        }
    }
}

static void run_scatter_add_rows(const pm_instruction *x, int lanes) {
    memset(x->out, 0, row_numbers(x->shape, lanes) * sizeof *x->out);
    const double *a = x->a;
    for (int r = 0; r < x->nindex; ++r) {
        for (int c = 0; c < x->shape.cols; ++c, a += lanes) {
            add_row(lanes, a, x->out + ((ptrdiff_t)x->index[r] * x->shape.cols + c) * lanes);
        }
    }
}

// --- which kernel ---

// NULL: the operation has none. Operations on one operand, number by number, do not depend on the
// order of the numbers and have the kernels of kernel.c.
static pm_kernel *const kernels[PM_OP_COUNT] = {
    [PM_OP_ADD] = run_add,
    [PM_OP_SUB] = run_sub,
    [PM_OP_MUL] = run_mul,
    [PM_OP_DIV] = run_div,
    [PM_OP_SCALE] = pm_run_scale,
    [PM_OP_OFFSET] = pm_run_offset,
    [PM_OP_TANH] = pm_run_tanh,
    [PM_OP_SIGMOID] = pm_run_sigmoid,
    [PM_OP_SOFTPLUS] = pm_run_softplus,
    [PM_OP_EXP] = pm_run_exp,
    [PM_OP_LOG] = pm_run_log,
    [PM_OP_SQRT] = pm_run_sqrt,
    [PM_OP_SIN] = pm_run_sin,
    [PM_OP_COS] = pm_run_cos,
    [PM_OP_IS_NEGATIVE] = pm_run_is_negative,
    [PM_OP_SUM_TO] = run_sum_to,
    [PM_OP_BROADCAST_TO] = run_broadcast_to,
    [PM_OP_DOT] = run_dot,
    [PM_OP_MATMUL] = run_matmul,
    [PM_OP_SLICE] = run_slice,
    [PM_OP_PLACE] = run_place,
    [PM_OP_CONCAT] = run_concat,
    [PM_OP_GATHER_ROWS] = run_gather_rows,
    [PM_OP_SCATTER_ADD_ROWS] = run_scatter_add_rows,
};

pm_kernel *pm_lane_kernel_of(const pm_instruction *instruction) {
    const pm_shape shape = instruction->shape;
    const bool by_blas = instruction->node->op == PM_OP_MATMUL &&
                         (long)shape.rows * shape.cols * inner_size(instruction) > PM_SMALL_PRODUCT;
    return by_blas ? NULL : kernels[instruction->node->op];
}

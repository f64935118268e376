// Computes each operation. Sums have a fixed order.
#include <math.h>
#include <string.h>

#include "base/activation.h"
#include "base/linalg.h"
#include "base/simd.h"
#include "graph/node.h"

static ptrdiff_t item_size(pm_shape shape) {
    return (ptrdiff_t)shape.rows * shape.cols;
}

static size_t entries(pm_shape shape, int batch) {
    return (size_t)item_size(shape) * (size_t)(shape.batched ? batch : 1);
}

// --- elementwise with two operands ---
//
// For each operator a macro writes four inner loops: each operand is contiguous or repeated along a
// row. Where both operands have the result's shape, all rows are one long row. Where rows are
// short, the inner loop runs over the items.

// A row shorter than the widest vector register is not worth a loop of its own.
#define SHORT_ROW 8

#define BINARY_ROW(n, EXPRESSION)              \
    if (ca == 1 && cb == 1) {                  \
        for (ptrdiff_t j = 0; j < (n); ++j) {  \
            const double a = pa[j], b = pb[j]; \
            out[j] = EXPRESSION;               \
        }                                      \
    } else if (ca == 1) {                      \
        const double b = pb[0];                \
        for (ptrdiff_t j = 0; j < (n); ++j) {  \
            const double a = pa[j];            \
            out[j] = EXPRESSION;               \
        }                                      \
    } else if (cb == 1) {                      \
        const double a = pa[0];                \
        for (ptrdiff_t j = 0; j < (n); ++j) {  \
            const double b = pb[j];            \
            out[j] = EXPRESSION;               \
        }                                      \
    } else {                                   \
        const double a = pa[0], b = pb[0];     \
        for (ptrdiff_t j = 0; j < (n); ++j) {  \
            out[j] = EXPRESSION;               \
        }                                      \
    }

#define BINARY_KERNEL(NAME, EXPRESSION)                                                            \
    PM_SIMD_CLONES static void NAME##_row(ptrdiff_t n, const double *pa, ptrdiff_t ca,             \
                                          const double *pb, ptrdiff_t cb, double *out){BINARY_ROW( \
        n, EXPRESSION)} PM_SIMD_CLONES static void NAME##_items(const pm_instruction *x,           \
                                                                ptrdiff_t items) {                 \
        const ptrdiff_t step = item_size(x->shape);                                                \
        const ptrdiff_t step_a = x->stride_a.item, step_b = x->stride_b.item;                      \
        for (int r = 0; r < x->shape.rows; ++r) {                                                  \
            for (int c = 0; c < x->shape.cols; ++c) {                                              \
                const double *pa = x->a + r * x->stride_a.row + c * x->stride_a.col;               \
                const double *pb = x->b + r * x->stride_b.row + c * x->stride_b.col;               \
                double *out = x->out + (ptrdiff_t)r * x->shape.cols + c;                           \
                for (ptrdiff_t i = 0; i < items; ++i) {                                            \
                    const double a = pa[i * step_a], b = pb[i * step_b];                           \
                    out[i * step] = EXPRESSION;                                                    \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
    }                                                                                              \
    void NAME(const pm_instruction *x, int batch) {                                                \
        const int items = x->shape.batched ? batch : 1;                                            \
        const pm_stride sa = x->stride_a, sb = x->stride_b;                                        \
        if (x->first != 0) { /* both operands have the result's shape: one long row */             \
            NAME##_row(items *item_size(x->shape), x->a, 1, x->b, 1, x->out);                      \
            return;                                                                                \
        }                                                                                          \
        if (x->shape.cols < SHORT_ROW && items > 1) {                                              \
            NAME##_items(x, items);                                                                \
            return;                                                                                \
        }                                                                                          \
        double *out = x->out;                                                                      \
        for (int i = 0; i < items; ++i) {                                                          \
            for (int r = 0; r < x->shape.rows; ++r, out += x->shape.cols) {                        \
                NAME##_row(x->shape.cols, x->a + i * sa.item + r * sa.row, sa.col,                 \
                           x->b + i * sb.item + r * sb.row, sb.col, out);                          \
            }                                                                                      \
        }                                                                                          \
    }

BINARY_KERNEL(pm_run_add, a + b)
BINARY_KERNEL(pm_run_sub, a - b)
BINARY_KERNEL(pm_run_mul, a *b)
BINARY_KERNEL(pm_run_div, a / b)

// --- elementwise with one operand ---

PM_SIMD_CLONES static void scale_array(size_t n, double factor, const double *a, double *out) {
    for (size_t i = 0; i < n; ++i) {
        out[i] = factor * a[i];
    }
}

void pm_run_scale(const pm_instruction *x, int batch) {
    scale_array(entries(x->shape, batch), x->number, x->a, x->out);
}

PM_SIMD_CLONES static void offset_array(size_t n, double term, const double *a, double *out) {
    for (size_t i = 0; i < n; ++i) {
        out[i] = a[i] + term;
    }
}

void pm_run_offset(const pm_instruction *x, int batch) {
    offset_array(entries(x->shape, batch), x->number, x->a, x->out);
}

void pm_run_tanh(const pm_instruction *x, int batch) {
    pm_array_tanh(entries(x->shape, batch), x->a, x->out);
}

void pm_run_sigmoid(const pm_instruction *x, int batch) {
    pm_array_sigmoid(entries(x->shape, batch), x->a, x->out);
}

void pm_run_softplus(const pm_instruction *x, int batch) {
    pm_array_softplus(entries(x->shape, batch), x->a, x->out);
}

void pm_run_exp(const pm_instruction *x, int batch) {
    pm_array_exp(entries(x->shape, batch), x->a, x->out);
}

void pm_run_log(const pm_instruction *x, int batch) {
    pm_array_log(entries(x->shape, batch), x->a, x->out);
}

void pm_run_sqrt(const pm_instruction *x, int batch) {
    pm_array_sqrt(entries(x->shape, batch), x->a, x->out);
}

void pm_run_sin(const pm_instruction *x, int batch) {
    const size_t n = entries(x->shape, batch);
    for (size_t i = 0; i < n; ++i) {
        x->out[i] = sin(x->a[i]);
    }
}

void pm_run_cos(const pm_instruction *x, int batch) {
    const size_t n = entries(x->shape, batch);
    for (size_t i = 0; i < n; ++i) {
        x->out[i] = cos(x->a[i]);
    }
}

void pm_run_is_negative(const pm_instruction *x, int batch) {
    const size_t n = entries(x->shape, batch);
    for (size_t i = 0; i < n; ++i) {
        x->out[i] = x->a[i] < 0;
    }
}

// --- sums, dots, broadcasting ---

void pm_run_sum_to(const pm_instruction *x, int batch) {
    const int items = x->shape_a.batched ? batch : 1;
    const pm_stride s = x->stride_a; // of the result, while the loops walk over the operand
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    const double *a = x->a;
    for (int i = 0; i < items; ++i) {
        for (int r = 0; r < x->shape_a.rows; ++r) {
            double *out = x->out + i * s.item + r * s.row;
            for (int c = 0; c < x->shape_a.cols; ++c) {
                out[c * s.col] += *a++;
            }
        }
    }
}

void pm_run_broadcast_to(const pm_instruction *x, int batch) {
    const int items = x->shape.batched ? batch : 1;
    const pm_stride s = x->stride_a;
    double *out = x->out;
    for (int i = 0; i < items; ++i) {
        for (int r = 0; r < x->shape.rows; ++r) {
            const double *a = x->a + i * s.item + r * s.row;
            for (int c = 0; c < x->shape.cols; ++c) {
                *out++ = a[c * s.col];
            }
        }
    }
}

void pm_run_dot(const pm_instruction *x, int batch) {
    const int items = x->shape.batched ? batch : 1;
    const int cols = x->shape_a.cols;
    const pm_stride sa = x->stride_a, sb = x->stride_b;
    double *out = x->out;
    for (int i = 0; i < items; ++i) {
        for (int r = 0; r < x->shape.rows; ++r) {
            const double *a = x->a + i * sa.item + r * sa.row;
            const double *b = x->b + i * sb.item + r * sb.row;
            double sum = 0;
            for (int c = 0; c < cols; ++c) {
                sum += a[c * sa.col] * b[c * sb.col];
            }
            *out++ = sum;
        }
    }
}

// --- matrix products ---

void pm_run_matmul(const pm_instruction *x, int batch) {
    const bool transpose_a = (x->first & 1) != 0, transpose_b = (x->first & 2) != 0;
    const int m = x->shape.rows, n = x->shape.cols;
    const int k = transpose_a ? x->shape_a.rows : x->shape_a.cols;
    if (x->shape_a.batched && !x->shape_b.batched && !transpose_a) {
        pm_gemm(false, transpose_b, batch * m, n, k, x->a, x->b, x->out);
        return;
    }
    const int items = x->shape.batched ? batch : 1;
    const ptrdiff_t step_a = x->shape_a.batched ? item_size(x->shape_a) : 0;
    const ptrdiff_t step_b = x->shape_b.batched ? item_size(x->shape_b) : 0;
    for (int i = 0; i < items; ++i) {
        pm_gemm(transpose_a, transpose_b, m, n, k, x->a + i * step_a, x->b + i * step_b,
                x->out + (ptrdiff_t)i * m * n);
    }
}

void pm_run_matmul_sum(const pm_instruction *x, int batch) {
    const int k = x->shape_a.rows * (x->shape_a.batched ? batch : 1);
    pm_gemm(true, false, x->shape.rows, x->shape.cols, k, x->a, x->b, x->out);
}

// --- layout ---

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

static size_t total_rows(pm_shape shape, int batch) {
    return (size_t)shape.rows * (size_t)(shape.batched ? batch : 1);
}

void pm_run_slice(const pm_instruction *x, int batch) {
    copy_columns(total_rows(x->shape, batch), x->shape.cols, x->a + x->first, x->shape_a.cols,
                 x->out, x->shape.cols);
}

void pm_run_place(const pm_instruction *x, int batch) {
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    copy_columns(total_rows(x->shape, batch), x->shape_a.cols, x->a, x->shape_a.cols,
                 x->out + x->first, x->shape.cols);
}

void pm_run_concat(const pm_instruction *x, int batch) {
    const size_t rows = total_rows(x->shape, batch);
    double *out = x->out;
    for (int i = 0; i < x->nindex; ++i) {
        const int cols = x->part_cols[i];
        if (rows == 1) {
            for (int c = 0; c < cols; ++c) {
                out[c] = x->part[i][c];
            }
        } else {
            copy_columns(rows, cols, x->part[i], cols, out, x->shape.cols);
        }
        out += cols;
    }
}

void pm_run_gather_rows(const pm_instruction *x, int batch) {
    const int items = x->shape.batched ? batch : 1;
    const int cols = x->shape.cols;
    double *out = x->out;
    for (int i = 0; i < items; ++i) {
        const double *a = x->a + i * (x->shape_a.batched ? item_size(x->shape_a) : 0);
        for (int r = 0; r < x->nindex; ++r, out += cols) {
            memcpy(out, a + (ptrdiff_t)x->index[r] * cols, (size_t)cols * sizeof *out);
        }
    }
}

void pm_run_scatter_add_rows(const pm_instruction *x, int batch) {
    const int items = x->shape.batched ? batch : 1;
    const int cols = x->shape.cols;
    memset(x->out, 0, entries(x->shape, batch) * sizeof *x->out);
    const double *a = x->a;
    for (int i = 0; i < items; ++i) {
        double *out = x->out + i * item_size(x->shape);
        for (int r = 0; r < x->nindex; ++r, a += cols) {
            double *row = out + (ptrdiff_t)x->index[r] * cols;
            for (int c = 0; c < cols; ++c) {
                row[c] += a[c];
            }
        }
    }
}

// A static graph of batched matrix operations whose derivatives are graphs again.
//
// A node stands for one matrix of `rows` x `cols` per batch item (batched), or for one matrix
// shared by all items (parameters, constants, sums over the batch). Building a graph only describes
// the computation. pm_program (program.h) plans memory for chosen outputs and runs it.
//
// Equal expressions are built once (hash-consing), so calling a builder twice costs nothing; only
// what the chosen outputs need is ever computed.
//
// Building cannot fail half-way: after running out of memory every builder returns a harmless node
// and pm_program_open reports PM_ENOMEM. Shapes that do not fit are a programmer's mistake
// (assert).
#ifndef PM_GRAPH_GRAPH_H
#define PM_GRAPH_GRAPH_H

#include <stdbool.h>

#include "base/status.h"

typedef struct pm_graph pm_graph;

// A handle into one graph. PM_NO_NODE means "identically zero" where a function says so.
typedef int pm_node;
#define PM_NO_NODE (-1)

typedef struct pm_shape {
    bool batched;
    int rows, cols; // of one item
} pm_shape;

pm_status pm_graph_open(pm_graph **graph);
void pm_graph_close(pm_graph *graph); // NULL is allowed

pm_shape pm_graph_shape(const pm_graph *g, pm_node x);
int pm_graph_size(const pm_graph *g); // nodes built so far

// --- leaves ---

// A value the caller writes before each run (pm_program_value). Each call makes a new node.
pm_node pm_input(pm_graph *g, bool batched, int rows, int cols);
// A shared matrix read from `value` [rows][cols] at every run; the caller keeps it alive. The same
// pointer always gives the same node.
pm_node pm_param(pm_graph *g, const double *value, int rows, int cols);
// The same for numbers that training changes. After pm_graph_weights_per_item such a node is the
// matrix repeated for every item, so that a gradient with respect to it is a row of the Jacobian
// per item instead of a sum over the batch.
pm_node pm_weight(pm_graph *g, const double *value, int rows, int cols);
void pm_graph_weights_per_item(pm_graph *g);
// A shared matrix with every entry `value`.
pm_node pm_constant(pm_graph *g, double value, int rows, int cols);

// --- elementwise; operands broadcast along any dimension of size 1, and shared to batched ---

pm_node pm_add(pm_graph *g, pm_node a, pm_node b);
pm_node pm_sub(pm_graph *g, pm_node a, pm_node b);
pm_node pm_mul(pm_graph *g, pm_node a, pm_node b);
pm_node pm_div(pm_graph *g, pm_node a, pm_node b);

pm_node pm_scale(pm_graph *g, pm_node x, double factor);
pm_node pm_offset(pm_graph *g, pm_node x, double term);
pm_node pm_tanh(pm_graph *g, pm_node x);
pm_node pm_sigmoid(pm_graph *g, pm_node x);
pm_node pm_softplus(pm_graph *g, pm_node x);
pm_node pm_silu(pm_graph *g, pm_node x);
pm_node pm_exp(pm_graph *g, pm_node x);
pm_node pm_log(pm_graph *g, pm_node x);
pm_node pm_sqrt(pm_graph *g, pm_node x);
// 1 where x < 0, else 0; its derivative is taken as zero.
pm_node pm_is_negative(pm_graph *g, pm_node x);

// --- sums, dots, broadcasting ---

// Sums x over every dimension in which `shape` is 1 (or shared) and x is not.
pm_node pm_sum_to(pm_graph *g, pm_node x, pm_shape shape);
// Repeats x to `shape`; the adjoint of pm_sum_to.
pm_node pm_broadcast_to(pm_graph *g, pm_node x, pm_shape shape);
// Row by row inner product of a and b [rows][cols] -> [rows][1].
pm_node pm_dot(pm_graph *g, pm_node a, pm_node b);

// --- matrix products ---

// op(a) op(b), op transposing where asked. Batched x shared multiplies all rows of all items by one
// matrix (one dgemm), batched x batched multiplies item by item.
pm_node pm_matmul(pm_graph *g, pm_node a, bool transpose_a, pm_node b, bool transpose_b);
// sum over the batch of a^T b: the derivative of a batched x shared product by the shared factor.
pm_node pm_matmul_sum(pm_graph *g, pm_node a, pm_node b);

// --- layout ---

// The same numbers, row-major, under another shape per item.
pm_node pm_reshape(pm_graph *g, pm_node x, int rows, int cols);
// Columns [first, first + count).
pm_node pm_slice(pm_graph *g, pm_node x, int first, int count);
// x as columns [first, ...) of `cols` columns, zero elsewhere; the adjoint of pm_slice.
pm_node pm_place(pm_graph *g, pm_node x, int first, int cols);
// The columns of all parts side by side.
pm_node pm_concat(pm_graph *g, int count, const pm_node *part);
// Row r of the result is row index[r] of x, within each item. `index` [count] is copied.
pm_node pm_gather_rows(pm_graph *g, pm_node x, int count, const int *index);
// Row index[r] of the result, which has `rows` rows, is the sum of those rows r of x; the adjoint.
pm_node pm_scatter_add_rows(pm_graph *g, pm_node x, int rows, int count, const int *index);

// --- derivatives ---

// Builds dx[i] = d(sum of all entries of y)/dx[i] by reverse accumulation; with `seed` (shape of y)
// the derivative of the sum of seed * y instead (seed may be PM_NO_NODE). Where y does not depend
// on x[i], dx[i] is PM_NO_NODE. A shared x sums over the batch. Each dx[i] has the shape of x[i].
void pm_gradient(pm_graph *g, pm_node y, pm_node seed, int count, const pm_node *x, pm_node *dx);

// --- conveniences made of the above, PM_NO_NODE read as zero ---

pm_node pm_add_or(pm_graph *g, pm_node a, pm_node b); // a + b, or whichever is not PM_NO_NODE
pm_node pm_square(pm_graph *g, pm_node x);
pm_node pm_magnitude(pm_graph *g, pm_node x); // |x|, its derivative 1 where x is 0
pm_node pm_transpose(pm_graph *g, pm_node x);
pm_node pm_mean_all(pm_graph *g, pm_node x); // not over the batch: mean of one item's entries

#endif

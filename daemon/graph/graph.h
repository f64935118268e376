// A static graph of batched matrix operations whose derivatives are graphs again.
//
// A node stands for a matrix of rows x cols for each item of a batch (batched), or for one matrix
// that all items share (parameters, constants, sums over the batch). Building a graph only
// describes a computation; pm_program (program.h) plans memory for chosen outputs and runs it.
//
// A builder is a function below that adds a node and returns it. Equal expressions become one node
// (hash-consing), so calling a builder twice costs nothing. A program computes only what its
// outputs need.
//
// A builder cannot fail: after memory is exhausted it returns a harmless node, and pm_program_open
// reports PM_ENOMEM. Shapes that do not fit together are a programmer's mistake (assert).
#ifndef PM_GRAPH_GRAPH_H
#define PM_GRAPH_GRAPH_H

#include <stdbool.h>

#include "base/status.h"

typedef struct pm_graph pm_graph;

// A handle of a node in one graph. PM_NO_NODE means "identically zero" where a function says so.
typedef int pm_node;
#define PM_NO_NODE (-1)

typedef struct pm_shape {
    bool batched;
    int rows, cols; // of one item
} pm_shape;

// Makes an empty graph. PM_ENOMEM.
pm_status pm_graph_open(pm_graph **graph);
void pm_graph_close(pm_graph *graph); // NULL is allowed

pm_shape pm_graph_shape(const pm_graph *g, pm_node x);
int pm_graph_size(const pm_graph *g); // number of nodes built so far
// Returns true if all entries of a node are the same number, which depends on no input and on no
// parameter, and sets *number to it.
bool pm_graph_is_number(const pm_graph *g, pm_node x, double *number);

// --- leaves ---

// Makes a value that the caller writes before each run (pm_program_value). Each call makes a new
// node.
pm_node pm_input(pm_graph *g, bool batched, int rows, int cols);
// Makes a shared matrix that every run reads from value [rows][cols], which the caller keeps alive.
// The same pointer always gives the same node.
pm_node pm_param(pm_graph *g, const double *value, int rows, int cols);
// Does the same for numbers that training changes.
pm_node pm_weight(pm_graph *g, const double *value, int rows, int cols);
// Makes all later calls of pm_weight repeat the matrix for every item of the batch. The gradient
// with respect to a weight then has one row of the Jacobian for each item, instead of their sum.
void pm_graph_weights_per_item(pm_graph *g);
// Makes a shared matrix whose entries are all `value`.
pm_node pm_constant(pm_graph *g, double value, int rows, int cols);

// --- elementwise; an operand is repeated along a dimension in which it has size 1, and a shared
// one for every item ---

pm_node pm_add(pm_graph *g, pm_node a, pm_node b);
pm_node pm_sub(pm_graph *g, pm_node a, pm_node b);
pm_node pm_mul(pm_graph *g, pm_node a, pm_node b);
pm_node pm_div(pm_graph *g, pm_node a, pm_node b);

pm_node pm_scale(pm_graph *g, pm_node x, double factor);
pm_node pm_offset(pm_graph *g, pm_node x, double term); // x + term
pm_node pm_tanh(pm_graph *g, pm_node x);
pm_node pm_sigmoid(pm_graph *g, pm_node x);
pm_node pm_softplus(pm_graph *g, pm_node x); // log(1 + exp(x))
pm_node pm_silu(pm_graph *g, pm_node x);     // x sigmoid(x)
pm_node pm_exp(pm_graph *g, pm_node x);
pm_node pm_log(pm_graph *g, pm_node x);
pm_node pm_sqrt(pm_graph *g, pm_node x);
pm_node pm_sin(pm_graph *g, pm_node x); // of an angle x in rad
pm_node pm_cos(pm_graph *g, pm_node x);
// Builds a matrix that is 1 where x < 0 and 0 elsewhere; its derivative counts as zero.
pm_node pm_is_negative(pm_graph *g, pm_node x);

// --- sums, dots, broadcasting ---

// Sums x over every dimension in which `shape` is 1 (or shared) and x is not.
pm_node pm_sum_to(pm_graph *g, pm_node x, pm_shape shape);
// Repeats x to `shape`; the adjoint of pm_sum_to.
pm_node pm_broadcast_to(pm_graph *g, pm_node x, pm_shape shape);
// Multiplies a and b [rows][cols] row by row: inner products [rows][1].
pm_node pm_dot(pm_graph *g, pm_node a, pm_node b);

// --- matrix products ---

// Computes op(a) op(b), where op transposes if asked. A batched times a shared matrix is one
// product of all rows of all items (one dgemm); two batched matrices are multiplied item by item.
pm_node pm_matmul(pm_graph *g, pm_node a, bool transpose_a, pm_node b, bool transpose_b);
// Computes the sum over the batch of a^T b. This is the derivative of a product of a batched and a
// shared matrix with respect to the shared one.
pm_node pm_matmul_sum(pm_graph *g, pm_node a, pm_node b);

// --- layout ---

// Gives the numbers of each item, in row-major order, another shape.
pm_node pm_reshape(pm_graph *g, pm_node x, int rows, int cols);
// Takes the columns [first, first + count).
pm_node pm_slice(pm_graph *g, pm_node x, int first, int count);
// Puts x into the columns from `first` on of a matrix of `cols` columns, which is zero elsewhere;
// the adjoint of pm_slice.
pm_node pm_place(pm_graph *g, pm_node x, int first, int cols);
// Puts the columns of part [count] side by side.
pm_node pm_concat(pm_graph *g, int count, const pm_node *part);
// Takes row index[r] of x as row r of the result, within each item. index [count] is copied.
pm_node pm_gather_rows(pm_graph *g, pm_node x, int count, const int *index);
// Adds row r of x to row index[r] of a result of `rows` rows; the adjoint of pm_gather_rows.
pm_node pm_scatter_add_rows(pm_graph *g, pm_node x, int rows, int count, const int *index);

// --- derivatives ---

// Builds dx[i] = d(sum of all entries of seed * y) / dx[i], i < count, by reverse accumulation.
// `seed` has the shape of y; PM_NO_NODE means a seed of ones. dx[i] has the shape of x[i]; it is
// PM_NO_NODE where y does not depend on x[i]. The derivative with respect to a shared x[i] sums
// over the batch.
void pm_gradient(pm_graph *g, pm_node y, pm_node seed, int count, const pm_node *x, pm_node *dx);
// Builds the derivative of y along directions: the sum over i < count of dy/dx[i] dx[i], in the
// shape of y. dx[i] has the shape of x[i], or is PM_NO_NODE, which stands for zero, as it does in
// x[i]. PM_NO_NODE: the derivative is zero.
pm_node pm_tangent(pm_graph *g, pm_node y, int count, const pm_node *x, const pm_node *dx);

// --- combinations of the above ---

pm_node pm_add_or(pm_graph *g, pm_node a, pm_node b); // a + b, where PM_NO_NODE is zero
// Returns the columns of a followed by those of b, where PM_NO_NODE has no columns.
pm_node pm_concat_or(pm_graph *g, pm_node a, pm_node b);
pm_node pm_square(pm_graph *g, pm_node x);
pm_node pm_magnitude(pm_graph *g, pm_node x); // |x|; its derivative at 0 is 1
pm_node pm_transpose(pm_graph *g, pm_node x);

#endif

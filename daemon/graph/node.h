// Declarations that the files of this folder share: the nodes, the instructions of a program, and
// the table of operations.
#ifndef PM_GRAPH_NODE_H
#define PM_GRAPH_NODE_H

#include <stddef.h>

#include "graph/graph.h"

typedef enum pm_op {
    PM_OP_INPUT,
    PM_OP_PARAM,
    PM_OP_CONSTANT,
    PM_OP_ADD,
    PM_OP_SUB,
    PM_OP_MUL,
    PM_OP_DIV,
    PM_OP_SCALE,
    PM_OP_OFFSET,
    PM_OP_TANH,
    PM_OP_SIGMOID,
    PM_OP_SOFTPLUS,
    PM_OP_EXP,
    PM_OP_LOG,
    PM_OP_SQRT,
    PM_OP_SIN,
    PM_OP_COS,
    PM_OP_IS_NEGATIVE,
    PM_OP_SUM_TO,
    PM_OP_BROADCAST_TO,
    PM_OP_DOT,
    PM_OP_MATMUL,
    PM_OP_MATMUL_SUM,
    PM_OP_RESHAPE,
    PM_OP_SLICE,
    PM_OP_PLACE,
    PM_OP_CONCAT,
    PM_OP_GATHER_ROWS,
    PM_OP_SCATTER_ADD_ROWS,
    PM_OP_COUNT
} pm_op;

// One node of the graph. Operands have smaller handles than their result, so that the order of
// handles is an order of evaluation.
typedef struct pm_graph_node {
    pm_op op;
    pm_shape shape;
    int noperand;
    const pm_node *operand; // [noperand]
    double number; // scale: the factor; offset: the term; constant: the value of all entries
    int first; // slice and place: the first column; matmul: bit 0 transposes a, bit 1 transposes b
    int nindex;
    const int *index;    // [nindex] rows of gather and scatter
    const double *value; // of param: [rows][cols]
} pm_graph_node;

const pm_graph_node *pm_graph_node_at(const pm_graph *g, pm_node x);
bool pm_graph_exhausted(const pm_graph *g); // returns true if memory ran out while building
void pm_graph_exhaust(pm_graph *g);         // notes that memory ran out

// The distances between neighbouring items, rows and columns of an operand while a kernel walks
// over the result, in numbers; 0 along a dimension in which the operand is repeated.
typedef struct pm_stride {
    ptrdiff_t item, row, col;
} pm_stride;

typedef struct pm_instruction pm_instruction;
typedef void pm_kernel(const pm_instruction *instruction, int batch);

// One operation to run, with its operands resolved to memory.
struct pm_instruction {
    pm_kernel *run;
    const pm_graph_node *node;
    pm_shape shape, shape_a, shape_b;
    // A kernel walks over its result, and the strides lead through a and b. The kernel of sum_to
    // walks over a, and stride_a leads through the result.
    pm_stride stride_a, stride_b;
    double *out;
    const double *a, *b;
    const double *const *part; // [nindex] the operands of concat
    const int *part_cols;      // [nindex] the number of columns of each operand
    double number;
    int first, nindex;
    const int *index;
};

// The derivative rule of an operation. Given its result and the result's adjoint, it returns the
// adjoint of operand number `operand`, in the operand's shape, or PM_NO_NODE for zero.
typedef pm_node pm_adjoint(pm_graph *g, pm_node result, pm_node adjoint, int operand);

typedef struct pm_operation {
    const char *name;
    pm_kernel *run;      // NULL: nothing to compute, as for leaves and reshape
    pm_adjoint *adjoint; // NULL: the operation has no operands
    bool in_place;       // the result may overwrite an operand of the same shape
} pm_operation;

extern const pm_operation pm_operations[PM_OP_COUNT];

// Returns the kernel that runs a batched instruction on arrays [rows][cols][lanes], in which each
// lane is one item (pm_program_open_lanes), or NULL if there is none. The kernel's `batch` is the
// number of lanes. The kernels are in lane_kernel.c.
pm_kernel *pm_lane_kernel_of(const pm_instruction *instruction);

// Kernels (kernel.c) and derivative rules (adjoint.c), one per operation, listed in operation.c.
pm_kernel pm_run_add, pm_run_sub, pm_run_mul, pm_run_div, pm_run_scale, pm_run_offset, pm_run_tanh,
    pm_run_sigmoid, pm_run_softplus, pm_run_exp, pm_run_log, pm_run_sqrt, pm_run_sin, pm_run_cos,
    pm_run_is_negative, pm_run_sum_to, pm_run_broadcast_to, pm_run_dot, pm_run_matmul,
    pm_run_matmul_sum, pm_run_slice, pm_run_place, pm_run_concat, pm_run_gather_rows,
    pm_run_scatter_add_rows;
pm_adjoint pm_adjoint_add, pm_adjoint_sub, pm_adjoint_mul, pm_adjoint_div, pm_adjoint_scale,
    pm_adjoint_offset, pm_adjoint_tanh, pm_adjoint_sigmoid, pm_adjoint_softplus, pm_adjoint_exp,
    pm_adjoint_log, pm_adjoint_sqrt, pm_adjoint_sin, pm_adjoint_cos, pm_adjoint_is_negative,
    pm_adjoint_sum_to, pm_adjoint_broadcast_to, pm_adjoint_dot, pm_adjoint_matmul,
    pm_adjoint_matmul_sum, pm_adjoint_reshape, pm_adjoint_slice, pm_adjoint_place,
    pm_adjoint_concat, pm_adjoint_gather_rows, pm_adjoint_scatter_add_rows;

#endif

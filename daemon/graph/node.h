// Declarations that the files of this folder share: the operations, the nodes, and the instructions
// of a program.
#ifndef PM_GRAPH_NODE_H
#define PM_GRAPH_NODE_H

#include <stddef.h>

#include "base/arena.h"
#include "graph/graph.h"

// The elementwise operations. A line defines an operation completely: its kernel, its derivative
// rule and its C source are made from it. `value` is a C expression of the numbers a and b of the
// operands and of the node's own `number`. A derivative builds the adjoint of an operand from the
// operands a and b, the result x, the result's adjoint dx and `number`; PM_NO_NODE is zero.
//
// clang-format off
//   X(OPERATION, name, value, derivative by a, derivative by b)
#define PM_BINARY_OPERATIONS(X)                                                                      \
    X(ADD, add, a + b, dx, dx)                                                                       \
    X(SUB, sub, a - b, dx, pm_scale(g, dx, -1))                                                      \
    X(MUL, mul, a * b, pm_mul(g, dx, b), pm_mul(g, dx, a))                                           \
    X(DIV, div, a / b, pm_div(g, dx, b), pm_scale(g, pm_mul(g, pm_div(g, dx, b), x), -1))

//   X(OPERATION, name, value, derivative by a)
#define PM_FUNCTIONS(X)                                                                              \
    X(TANH, tanh, pm_tanh_of(a), pm_sub(g, dx, pm_mul(g, dx, pm_square(g, x))))                      \
    X(SIGMOID, sigmoid, pm_sigmoid_of(a), pm_mul(g, dx, pm_sub(g, x, pm_square(g, x))))              \
    X(SOFTPLUS, softplus, pm_softplus_of(a), pm_mul(g, dx, pm_sigmoid(g, a)))                        \
    X(EXP, exp, pm_exp_of(a), pm_mul(g, dx, x))                                                      \
    X(LOG, log, pm_log_of(a), pm_div(g, dx, a))                                                      \
    X(SQRT, sqrt, sqrt(a), pm_div(g, pm_scale(g, dx, 0.5), x))                                       \
    X(SIN, sin, pm_sin_of(a), pm_mul(g, dx, pm_cos(g, a)))                                           \
    X(COS, cos, pm_cos_of(a), pm_scale(g, pm_mul(g, dx, pm_sin(g, a)), -1))                          \
    X(IS_NEGATIVE, is_negative, a < 0 ? 1.0 : 0.0, PM_NO_NODE)

#define PM_UNARY_OPERATIONS(X)                                                                       \
    PM_FUNCTIONS(X)                                                                                  \
    X(SCALE, scale, number * a, pm_scale(g, dx, number))                                             \
    X(OFFSET, offset, a + number, dx)

// The other operations have a kernel and a derivative rule in operation.c and a rule in source.c.
#define PM_OTHER_OPERATIONS(X)                                                                       \
    X(SUM_TO, sum_to) X(BROADCAST_TO, broadcast_to) X(DOT, dot) X(MATMUL, matmul)                    \
    X(MATMUL_SUM, matmul_sum) X(RESHAPE, reshape) X(SLICE, slice) X(PLACE, place) X(CONCAT, concat)  \
    X(GATHER_ROWS, gather_rows) X(SCATTER_ADD_ROWS, scatter_add_rows)

typedef enum pm_op {
    PM_OP_INPUT,
    PM_OP_PARAM,
    PM_OP_CONSTANT,
#define PM_OP_OF(OPERATION, ...) PM_OP_##OPERATION,
    PM_BINARY_OPERATIONS(PM_OP_OF)
    PM_UNARY_OPERATIONS(PM_OP_OF)
    PM_OTHER_OPERATIONS(PM_OP_OF)
#undef PM_OP_OF
    PM_OP_COUNT
} pm_op;
// clang-format on

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

// One operation to run, with its operands resolved to memory. Batched arrays are
// [batch][rows][cols], or [rows][cols][lanes] in a program of lanes (pm_program_open_lanes), in
// which each lane is one item. A kernel serves both orders.
typedef struct pm_instruction {
    void (*run)(const struct pm_instruction *x, int batch);
    pm_op op;
    pm_shape shape, shape_a, shape_b;
    int lanes; // neighbouring numbers of an item are this many numbers apart: 1 if items are
               // outermost
    // Three nested loops over the result, or over a in a sum: over items, rows and columns, or over
    // rows, columns and lanes. A step is the distance between neighbours in numbers, 0 where an
    // operand is repeated. The number of items, in size[0], is only known when the program runs.
    int size[3];
    ptrdiff_t step[3], step_a[3], step_b[3]; // of the result, a and b
    double *out;
    const double *a, *b;
    const double *const *part; // [nindex] the operands of concat
    const int *part_cols;      // [nindex] the number of columns of each operand
    double number;
    int first, nindex;
    const int *index;
} pm_instruction;

// The same in short, for what takes most time: an elementwise operation on numbers that lie one
// after the other, or are one number for all. A program of many instructions is read from memory in
// each run, which takes longer than the arithmetic where they are large.
typedef struct pm_row {
    double *out;
    const double *a;
    union {
        const double *b;
        double number;               // of an operation with one operand
        ptrdiff_t stride;            // of a slice of one column: between its rows
        const pm_instruction *whole; // what has no short form
    };
    int n;      // numbers of the result, of each item if there are `many`
    short kind; // PM_ROW; -1: there is no short form
    bool many;
} pm_row;

// Which operands are one number for all.
enum { PM_ROW_NEITHER, PM_ROW_SECOND, PM_ROW_FIRST, PM_ROW_NFORM };
#define PM_ROW(OPERATION, FORM) ((short)(PM_ROW_NFORM * (OPERATION) + (FORM)))

// Runs the instructions from `row` up to `end`.
void pm_rows_run(const pm_row *row, const pm_row *end, int batch);

typedef struct pm_operation {
    // NULL: there is nothing to compute, or each instruction has a short form.
    void (*run)(const pm_instruction *x, int batch);
    // The derivative rule. Given the result and its adjoint, it returns the adjoint of operand
    // number `i`, in the operand's shape, or PM_NO_NODE for zero. NULL: the operation has no
    // operands.
    pm_node (*adjoint)(pm_graph *g, pm_node result, pm_node adjoint, int i);
    bool in_place; // the result may overwrite an operand of the same shape
} pm_operation;

extern const pm_operation pm_operations[PM_OP_COUNT];

struct pm_program {
    pm_arena arena;
    double *memory;
    size_t memory_size; // numbers
    int ninstruction, nfixed;
    pm_instruction *instruction; // [ninstruction]; the first `nfixed` depend on weights alone
    pm_row *row;                 // [ninstruction] the same, for a run
    int nnode;
    double **value; // [nnode] where a node's numbers live; NULL: not part of the program
    bool *needed;   // [nnode] whether an output needs the node
    bool *fixed;    // [nnode] whether its numbers depend on weights alone
    int capacity;
    int noutput;
    pm_node *output; // [noutput]
    // Computes what depends on inputs, as compiled code (compile.h); NULL: the instructions do.
    void (*kernel)(double *memory);
};

#endif

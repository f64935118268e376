// The table of operations: name, kernel, derivative rule, and whether it can work in place. A new
// operation is a line here, a builder in graph.c, a kernel in kernel.c and a rule in adjoint.c.
#include "graph/node.h"

const pm_operation pm_operations[PM_OP_COUNT] = {
    [PM_OP_INPUT] = {"input", NULL, NULL, false},
    [PM_OP_PARAM] = {"param", NULL, NULL, false},
    [PM_OP_CONSTANT] = {"constant", NULL, NULL, false},
    [PM_OP_ADD] = {"add", pm_run_add, pm_adjoint_add, true},
    [PM_OP_SUB] = {"sub", pm_run_sub, pm_adjoint_sub, true},
    [PM_OP_MUL] = {"mul", pm_run_mul, pm_adjoint_mul, true},
    [PM_OP_DIV] = {"div", pm_run_div, pm_adjoint_div, true},
    [PM_OP_SCALE] = {"scale", pm_run_scale, pm_adjoint_scale, true},
    [PM_OP_OFFSET] = {"offset", pm_run_offset, pm_adjoint_offset, true},
    [PM_OP_TANH] = {"tanh", pm_run_tanh, pm_adjoint_tanh, true},
    [PM_OP_SIGMOID] = {"sigmoid", pm_run_sigmoid, pm_adjoint_sigmoid, true},
    [PM_OP_SOFTPLUS] = {"softplus", pm_run_softplus, pm_adjoint_softplus, true},
    [PM_OP_EXP] = {"exp", pm_run_exp, pm_adjoint_exp, true},
    [PM_OP_LOG] = {"log", pm_run_log, pm_adjoint_log, true},
    [PM_OP_SQRT] = {"sqrt", pm_run_sqrt, pm_adjoint_sqrt, true},
    [PM_OP_IS_NEGATIVE] = {"is_negative", pm_run_is_negative, pm_adjoint_is_negative, true},
    [PM_OP_SUM_TO] = {"sum_to", pm_run_sum_to, pm_adjoint_sum_to, false},
    [PM_OP_BROADCAST_TO] = {"broadcast_to", pm_run_broadcast_to, pm_adjoint_broadcast_to, false},
    [PM_OP_DOT] = {"dot", pm_run_dot, pm_adjoint_dot, false},
    [PM_OP_MATMUL] = {"matmul", pm_run_matmul, pm_adjoint_matmul, false},
    [PM_OP_MATMUL_SUM] = {"matmul_sum", pm_run_matmul_sum, pm_adjoint_matmul_sum, false},
    [PM_OP_RESHAPE] = {"reshape", NULL, pm_adjoint_reshape, false},
    [PM_OP_SLICE] = {"slice", pm_run_slice, pm_adjoint_slice, false},
    [PM_OP_PLACE] = {"place", pm_run_place, pm_adjoint_place, false},
    [PM_OP_CONCAT] = {"concat", pm_run_concat, pm_adjoint_concat, false},
    [PM_OP_GATHER_ROWS] = {"gather_rows", pm_run_gather_rows, pm_adjoint_gather_rows, false},
    [PM_OP_SCATTER_ADD_ROWS] = {"scatter_add_rows", pm_run_scatter_add_rows,
                                pm_adjoint_scatter_add_rows, false},
};

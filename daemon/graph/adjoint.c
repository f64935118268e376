// The derivative rule of every operation. The rules use the same operations, so that derivatives
// can be differentiated again. In each, x is the result, dx its adjoint, and i the number of the
// operand.
#include "graph/node.h"

static pm_node operand(const pm_graph *g, pm_node x, int i) {
    return pm_graph_node_at(g, x)->operand[i];
}

// Sums an adjoint to the shape of operand i, where that operand was repeated.
static pm_node reduce(pm_graph *g, pm_node x, pm_node d, int i) {
    return pm_sum_to(g, d, pm_graph_shape(g, operand(g, x, i)));
}

pm_node pm_adjoint_add(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, dx, i);
}

pm_node pm_adjoint_sub(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, i == 0 ? dx : pm_scale(g, dx, -1), i);
}

pm_node pm_adjoint_mul(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, pm_mul(g, dx, operand(g, x, 1 - i)), i);
}

pm_node pm_adjoint_div(pm_graph *g, pm_node x, pm_node dx, int i) {
    // x = a / b: da = dx / b, db = -dx x / b.
    const pm_node quotient = pm_div(g, dx, operand(g, x, 1));
    return reduce(g, x, i == 0 ? quotient : pm_scale(g, pm_mul(g, quotient, x), -1), i);
}

pm_node pm_adjoint_scale(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)i;
    return pm_scale(g, dx, pm_graph_node_at(g, x)->number);
}

pm_node pm_adjoint_offset(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)g, (void)x, (void)i;
    return dx;
}

pm_node pm_adjoint_tanh(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)i;
    return pm_sub(g, dx, pm_mul(g, dx, pm_square(g, x)));
}

pm_node pm_adjoint_sigmoid(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)i;
    return pm_mul(g, dx, pm_sub(g, x, pm_square(g, x)));
}

pm_node pm_adjoint_softplus(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_mul(g, dx, pm_sigmoid(g, operand(g, x, i)));
}

pm_node pm_adjoint_exp(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)i;
    return pm_mul(g, dx, x);
}

pm_node pm_adjoint_log(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_div(g, dx, operand(g, x, i));
}

pm_node pm_adjoint_sqrt(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)i;
    return pm_div(g, pm_scale(g, dx, 0.5), x);
}

pm_node pm_adjoint_sin(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_mul(g, dx, pm_cos(g, operand(g, x, i)));
}

pm_node pm_adjoint_cos(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_scale(g, pm_mul(g, dx, pm_sin(g, operand(g, x, i))), -1);
}

pm_node pm_adjoint_is_negative(pm_graph *g, pm_node x, pm_node dx, int i) {
    (void)g, (void)x, (void)dx, (void)i;
    return PM_NO_NODE;
}

pm_node pm_adjoint_sum_to(pm_graph *g, pm_node x, pm_node dx, int i) {
    return pm_broadcast_to(g, dx, pm_graph_shape(g, operand(g, x, i)));
}

pm_node pm_adjoint_broadcast_to(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, dx, i);
}

pm_node pm_adjoint_dot(pm_graph *g, pm_node x, pm_node dx, int i) {
    return reduce(g, x, pm_mul(g, dx, operand(g, x, 1 - i)), i);
}

// x = op(a) op(b): d op(a) = dx op(b)^T and d op(b) = op(a)^T dx, each with or without transposing.
pm_node pm_adjoint_matmul(pm_graph *g, pm_node x, pm_node dx, int i) {
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

// x = sum over the batch of a^T b.
pm_node pm_adjoint_matmul_sum(pm_graph *g, pm_node x, pm_node dx, int i) {
    return i == 0 ? pm_matmul(g, operand(g, x, 1), false, dx, true)
                  : pm_matmul(g, operand(g, x, 0), false, dx, false);
}

pm_node pm_adjoint_reshape(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_shape shape = pm_graph_shape(g, operand(g, x, i));
    return pm_reshape(g, dx, shape.rows, shape.cols);
}

pm_node pm_adjoint_slice(pm_graph *g, pm_node x, pm_node dx, int i) {
    const int cols = pm_graph_shape(g, operand(g, x, i)).cols;
    return pm_place(g, dx, pm_graph_node_at(g, x)->first, cols);
}

pm_node pm_adjoint_place(pm_graph *g, pm_node x, pm_node dx, int i) {
    const int cols = pm_graph_shape(g, operand(g, x, i)).cols;
    return pm_slice(g, dx, pm_graph_node_at(g, x)->first, cols);
}

pm_node pm_adjoint_concat(pm_graph *g, pm_node x, pm_node dx, int i) {
    int first = 0;
    for (int j = 0; j < i; ++j) {
        first += pm_graph_shape(g, operand(g, x, j)).cols;
    }
    const pm_node part = pm_slice(g, dx, first, pm_graph_shape(g, operand(g, x, i)).cols);
    return reduce(g, x, part, i);
}

pm_node pm_adjoint_gather_rows(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    const int rows = pm_graph_shape(g, operand(g, x, i)).rows;
    return reduce(g, x, pm_scatter_add_rows(g, dx, rows, node->nindex, node->index), i);
}

pm_node pm_adjoint_scatter_add_rows(pm_graph *g, pm_node x, pm_node dx, int i) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    return reduce(g, x, pm_gather_rows(g, dx, node->nindex, node->index), i);
}

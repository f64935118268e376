// Builds graphs: the rules of shapes, hash-consing, a few simplifications that derivatives need,
// and reverse accumulation.
#include "graph/graph.h"

#include <assert.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "graph/node.h"

struct pm_graph {
    pm_arena arena; // of the arrays here and in nodes; once it has failed, nothing is built
    pm_graph_node *node;
    int count, capacity; // the capacity is a power of two
    int *bucket;         // [2 capacity] hash table of handles, -1: empty
    bool weights_per_item;
};

// --- storage ---

pm_status pm_graph_open(pm_graph **graph) {
    pm_graph *g = NULL;
    PM_TRY(PM_NEW(g, "a graph"));
    *graph = g;
    return PM_OK;
}

void pm_graph_close(pm_graph *graph) {
    PM_DELETE(graph);
}

const pm_graph_node *pm_graph_node_at(const pm_graph *g, pm_node x) {
    assert(x >= 0 && x < g->count);
    return &g->node[x];
}

bool pm_graph_exhausted(const pm_graph *g) {
    return g->arena.failed;
}

void pm_graph_exhaust(pm_graph *g) {
    g->arena.failed = true;
}

pm_shape pm_graph_shape(const pm_graph *g, pm_node x) {
    // After memory is exhausted there may be no node at all, and any shape will do.
    return g->arena.failed ? (pm_shape){false, 1, 1} : pm_graph_node_at(g, x)->shape;
}

int pm_graph_size(const pm_graph *g) {
    return g->count;
}

static uint64_t mix(uint64_t hash, uint64_t word) {
    hash = (hash ^ word) * UINT64_C(0x9e3779b97f4a7c15);
    return hash ^ (hash >> 29);
}

static uint64_t hash_node(const pm_graph_node *n) {
    uint64_t bits;
    memcpy(&bits, &n->number, sizeof bits);
    uint64_t hash = mix((uint64_t)n->op, bits);
    hash = mix(hash, (uint64_t)(uintptr_t)n->value);
    hash = mix(hash, (uint64_t)n->shape.batched << 62 ^ (uint64_t)n->shape.rows << 31 ^
                         (uint64_t)n->shape.cols);
    hash = mix(hash, (uint64_t)n->first << 32 ^ (uint64_t)n->nindex);
    for (int i = 0; i < n->noperand; ++i) {
        hash = mix(hash, (uint64_t)n->operand[i]);
    }
    return hash;
}

static bool equal_shapes(pm_shape a, pm_shape b) {
    return a.batched == b.batched && a.rows == b.rows && a.cols == b.cols;
}

static bool equal_nodes(const pm_graph_node *a, const pm_graph_node *b) {
    return a->op == b->op && equal_shapes(a->shape, b->shape) && a->noperand == b->noperand &&
           memcmp(&a->number, &b->number, sizeof a->number) == 0 && a->first == b->first &&
           a->value == b->value && a->nindex == b->nindex &&
           (a->noperand == 0 ||
            memcmp(a->operand, b->operand, (size_t)a->noperand * sizeof *a->operand) == 0) &&
           (a->nindex == 0 ||
            memcmp(a->index, b->index, (size_t)a->nindex * sizeof *a->index) == 0);
}

// Returns the bucket of a node that equals `candidate`, or of none. Inputs are never shared.
static int *find_bucket(const pm_graph *g, const pm_graph_node *candidate) {
    const uint64_t mask = 2 * (uint64_t)g->capacity - 1;
    uint64_t slot = hash_node(candidate) & mask;
    while (g->bucket[slot] >= 0 &&
           (candidate->op == PM_OP_INPUT || !equal_nodes(&g->node[g->bucket[slot]], candidate))) {
        slot = (slot + 1) & mask;
    }
    return &g->bucket[slot];
}

// Makes room for one more node. The arena keeps the smaller arrays until the graph is closed.
static void grow(pm_graph *g) {
    const int capacity = g->capacity == 0 ? 256 : 2 * g->capacity;
    pm_graph_node *node = pm_arena_array(&g->arena, (size_t)capacity, sizeof *node);
    int *bucket = pm_arena_array(&g->arena, 2 * (size_t)capacity, sizeof *bucket);
    if (g->arena.failed) {
        return;
    }
    if (g->count > 0) {
        memcpy(node, g->node, (size_t)g->count * sizeof *node);
    }
    memset(bucket, 0xff, 2 * (size_t)capacity * sizeof *bucket);
    g->node = node;
    g->bucket = bucket;
    g->capacity = capacity;
    for (int i = 0; i < g->count; ++i) {
        *find_bucket(g, &node[i]) = i;
    }
}

static const int *copy_ints(pm_graph *g, int count, const int *from) {
    int *copy = count == 0 ? NULL : pm_arena_array(&g->arena, (size_t)count, sizeof *copy);
    return copy == NULL ? NULL : memcpy(copy, from, (size_t)count * sizeof *copy);
}

// Returns the node that equals `candidate`, or makes it.
static pm_node intern(pm_graph *g, pm_graph_node candidate) {
    if (g->count == g->capacity) {
        grow(g);
    }
    if (g->arena.failed) {
        return 0;
    }
    int *bucket = find_bucket(g, &candidate);
    if (*bucket >= 0) {
        return *bucket;
    }
    candidate.operand = copy_ints(g, candidate.noperand, candidate.operand);
    candidate.index = copy_ints(g, candidate.nindex, candidate.index);
    if (g->arena.failed) {
        return 0;
    }
    g->node[g->count] = candidate;
    *bucket = g->count;
    return g->count++;
}

static pm_node intern_unary(pm_graph *g, pm_op op, pm_shape shape, pm_node x, double number,
                            int first) {
    return intern(g, (pm_graph_node){.op = op,
                                     .shape = shape,
                                     .noperand = 1,
                                     .operand = &x,
                                     .number = number,
                                     .first = first});
}

static pm_node intern_binary(pm_graph *g, pm_op op, pm_shape shape, pm_node a, pm_node b,
                             int first) {
    const pm_node operand[2] = {a, b};
    return intern(g,
                  (pm_graph_node){
                      .op = op, .shape = shape, .noperand = 2, .operand = operand, .first = first});
}

static bool is_op(const pm_graph *g, pm_node x, pm_op op) {
    return !g->arena.failed && pm_graph_node_at(g, x)->op == op;
}

static bool is_constant(const pm_graph *g, pm_node x, double value) {
    return is_op(g, x, PM_OP_CONSTANT) && pm_graph_node_at(g, x)->number == value;
}

bool pm_graph_is_number(const pm_graph *g, pm_node x, double *number) {
    double a, b;
    if (g->arena.failed) {
        return false;
    }
    const pm_graph_node *n = pm_graph_node_at(g, x);
    switch (n->op) {
    case PM_OP_CONSTANT:
        *number = n->number;
        return true;
    case PM_OP_BROADCAST_TO:
    case PM_OP_SLICE:
        return pm_graph_is_number(g, n->operand[0], number);
    case PM_OP_SCALE:
        if (!pm_graph_is_number(g, n->operand[0], &a)) {
            return false;
        }
        *number = n->number * a;
        return true;
    case PM_OP_ADD:
    case PM_OP_MUL:
    case PM_OP_DIV:
        if (!pm_graph_is_number(g, n->operand[0], &a) ||
            !pm_graph_is_number(g, n->operand[1], &b)) {
            return false;
        }
        *number = n->op == PM_OP_ADD ? a + b : n->op == PM_OP_MUL ? a * b : a / b;
        return true;
    default:
        return false;
    }
}

// --- leaves ---

pm_node pm_input(pm_graph *g, bool batched, int rows, int cols) {
    return intern(g, (pm_graph_node){.op = PM_OP_INPUT, .shape = {batched, rows, cols}});
}

pm_node pm_param(pm_graph *g, const double *value, int rows, int cols) {
    return intern(g,
                  (pm_graph_node){.op = PM_OP_PARAM, .shape = {false, rows, cols}, .value = value});
}

pm_node pm_weight(pm_graph *g, const double *value, int rows, int cols) {
    const pm_node shared = pm_param(g, value, rows, cols);
    return pm_broadcast_to(g, shared, (pm_shape){g->weights_per_item, rows, cols});
}

void pm_graph_weights_per_item(pm_graph *g) {
    g->weights_per_item = true;
}

pm_node pm_constant(pm_graph *g, double value, int rows, int cols) {
    return intern(
        g, (pm_graph_node){.op = PM_OP_CONSTANT, .shape = {false, rows, cols}, .number = value});
}

// --- elementwise ---

static int broadcast_size(int a, int b) {
    assert(a == b || a == 1 || b == 1);
    return a == 1 ? b : a;
}

static pm_shape broadcast_shape(pm_shape a, pm_shape b) {
    return (pm_shape){a.batched || b.batched, broadcast_size(a.rows, b.rows),
                      broadcast_size(a.cols, b.cols)};
}

static pm_node binary(pm_graph *g, pm_op op, pm_node a, pm_node b) {
    const pm_shape shape = broadcast_shape(pm_graph_shape(g, a), pm_graph_shape(g, b));
    return intern_binary(g, op, shape, a, b, 0);
}

pm_node pm_add(pm_graph *g, pm_node a, pm_node b) {
    return binary(g, PM_OP_ADD, a, b);
}

pm_node pm_sub(pm_graph *g, pm_node a, pm_node b) {
    return binary(g, PM_OP_SUB, a, b);
}

pm_node pm_mul(pm_graph *g, pm_node a, pm_node b) {
    const pm_shape shape = broadcast_shape(pm_graph_shape(g, a), pm_graph_shape(g, b));
    // In derivatives, most seeds are ones.
    if (is_op(g, a, PM_OP_BROADCAST_TO) && is_constant(g, pm_graph_node_at(g, a)->operand[0], 1)) {
        return pm_broadcast_to(g, b, shape);
    }
    if (is_constant(g, a, 1)) {
        return pm_broadcast_to(g, b, shape);
    }
    return binary(g, PM_OP_MUL, a, b);
}

pm_node pm_div(pm_graph *g, pm_node a, pm_node b) {
    double divisor;
    if (pm_graph_is_number(g, b, &divisor) && divisor == 1) {
        return pm_broadcast_to(g, a, broadcast_shape(pm_graph_shape(g, a), pm_graph_shape(g, b)));
    }
    return binary(g, PM_OP_DIV, a, b);
}

pm_node pm_scale(pm_graph *g, pm_node x, double factor) {
    if (factor == 1) {
        return x;
    }
    if (is_op(g, x, PM_OP_SCALE)) {
        const pm_graph_node *inner = pm_graph_node_at(g, x);
        return pm_scale(g, inner->operand[0], factor * inner->number);
    }
    return intern_unary(g, PM_OP_SCALE, pm_graph_shape(g, x), x, factor, 0);
}

pm_node pm_offset(pm_graph *g, pm_node x, double term) {
    return intern_unary(g, PM_OP_OFFSET, pm_graph_shape(g, x), x, term, 0);
}

#define FUNCTION(OPERATION, NAME, ...)                                            \
    pm_node pm_##NAME(pm_graph *g, pm_node x) {                                   \
        return intern_unary(g, PM_OP_##OPERATION, pm_graph_shape(g, x), x, 0, 0); \
    }
PM_FUNCTIONS(FUNCTION)

pm_node pm_silu(pm_graph *g, pm_node x) {
    return pm_mul(g, x, pm_sigmoid(g, x));
}

// --- sums, dots, broadcasting ---

pm_node pm_sum_to(pm_graph *g, pm_node x, pm_shape shape) {
    const pm_shape from = pm_graph_shape(g, x);
    if (g->arena.failed || equal_shapes(from, shape)) {
        return x;
    }
    assert(from.batched || !shape.batched);
    assert(shape.rows == from.rows || shape.rows == 1);
    assert(shape.cols == from.cols || shape.cols == 1);
    return intern_unary(g, PM_OP_SUM_TO, shape, x, 0, 0);
}

pm_node pm_broadcast_to(pm_graph *g, pm_node x, pm_shape shape) {
    const pm_shape from = pm_graph_shape(g, x);
    if (g->arena.failed || equal_shapes(from, shape)) {
        return x;
    }
    assert(shape.batched || !from.batched);
    assert(shape.rows == from.rows || from.rows == 1);
    assert(shape.cols == from.cols || from.cols == 1);
    return intern_unary(g, PM_OP_BROADCAST_TO, shape, x, 0, 0);
}

pm_node pm_dot(pm_graph *g, pm_node a, pm_node b) {
    pm_shape shape = broadcast_shape(pm_graph_shape(g, a), pm_graph_shape(g, b));
    assert(g->arena.failed || pm_graph_shape(g, a).cols == pm_graph_shape(g, b).cols);
    shape.cols = 1;
    return intern_binary(g, PM_OP_DOT, shape, a, b, 0);
}

// --- matrix products ---

pm_node pm_matmul(pm_graph *g, pm_node a, bool transpose_a, pm_node b, bool transpose_b) {
    const pm_shape sa = pm_graph_shape(g, a), sb = pm_graph_shape(g, b);
    assert((transpose_a ? sa.rows : sa.cols) == (transpose_b ? sb.cols : sb.rows));
    const pm_shape shape = {sa.batched || sb.batched, transpose_a ? sa.cols : sa.rows,
                            transpose_b ? sb.rows : sb.cols};
    return intern_binary(g, PM_OP_MATMUL, shape, a, b,
                         (transpose_a ? 1 : 0) | (transpose_b ? 2 : 0));
}

pm_node pm_matmul_sum(pm_graph *g, pm_node a, pm_node b) {
    const pm_shape sa = pm_graph_shape(g, a), sb = pm_graph_shape(g, b);
    assert(sa.rows == sb.rows && sa.batched == sb.batched);
    return intern_binary(g, PM_OP_MATMUL_SUM, (pm_shape){false, sa.cols, sb.cols}, a, b, 0);
}

// --- layout ---

pm_node pm_reshape(pm_graph *g, pm_node x, int rows, int cols) {
    const pm_shape from = pm_graph_shape(g, x);
    const pm_shape shape = {from.batched, rows, cols};
    if (equal_shapes(from, shape)) {
        return x;
    }
    assert(g->arena.failed || from.rows * from.cols == rows * cols);
    return intern_unary(g, PM_OP_RESHAPE, shape, x, 0, 0);
}

pm_node pm_slice(pm_graph *g, pm_node x, int first, int count) {
    const pm_shape from = pm_graph_shape(g, x);
    if (g->arena.failed || (first == 0 && count == from.cols)) {
        return x;
    }
    assert(first >= 0 && count > 0 && first + count <= from.cols);
    // A slice around what pm_place placed places it. A slice of a slice stays one, since
    // derivatives by the slice are asked for.
    const pm_graph_node *node = pm_graph_node_at(g, x);
    if (is_op(g, x, PM_OP_PLACE)) {
        const int begin = node->first - first, cols = pm_graph_shape(g, node->operand[0]).cols;
        if (begin >= 0 && begin + cols <= count) {
            return pm_place(g, node->operand[0], begin, count);
        }
    }
    return intern_unary(g, PM_OP_SLICE, (pm_shape){from.batched, from.rows, count}, x, 0, first);
}

pm_node pm_place(pm_graph *g, pm_node x, int first, int cols) {
    const pm_shape from = pm_graph_shape(g, x);
    if (g->arena.failed || (first == 0 && from.cols == cols)) {
        return x;
    }
    assert(first >= 0 && first + from.cols <= cols);
    if (is_op(g, x, PM_OP_PLACE)) {
        const pm_graph_node *placed = pm_graph_node_at(g, x);
        return pm_place(g, placed->operand[0], placed->first + first, cols);
    }
    return intern_unary(g, PM_OP_PLACE, (pm_shape){from.batched, from.rows, cols}, x, 0, first);
}

pm_node pm_concat(pm_graph *g, int count, const pm_node *part) {
    if (g->arena.failed || count == 1) {
        return part[0];
    }
    pm_shape shape = {false, pm_graph_shape(g, part[0]).rows, 0};
    for (int i = 0; i < count; ++i) {
        const pm_shape s = pm_graph_shape(g, part[i]);
        assert(s.rows == shape.rows);
        shape.batched = shape.batched || s.batched;
        shape.cols += s.cols;
    }
    // Shared parts are repeated for every item first, so that concatenation only copies.
    pm_node *same = pm_arena_array(&g->arena, (size_t)count, sizeof *same);
    for (int i = 0; i < count && same != NULL; ++i) {
        pm_shape s = pm_graph_shape(g, part[i]);
        s.batched = shape.batched;
        same[i] = pm_broadcast_to(g, part[i], s);
    }
    return intern(
        g, (pm_graph_node){.op = PM_OP_CONCAT, .shape = shape, .noperand = count, .operand = same});
}

static pm_node row_operation(pm_graph *g, pm_op op, pm_node x, int rows, int count,
                             const int *index) {
    const pm_shape from = pm_graph_shape(g, x);
    return intern(g, (pm_graph_node){.op = op,
                                     .shape = {from.batched, rows, from.cols},
                                     .noperand = 1,
                                     .operand = &x,
                                     .nindex = count,
                                     .index = index});
}

pm_node pm_gather_rows(pm_graph *g, pm_node x, int count, const int *index) {
    return row_operation(g, PM_OP_GATHER_ROWS, x, count, count, index);
}

pm_node pm_scatter_add_rows(pm_graph *g, pm_node x, int rows, int count, const int *index) {
    assert(g->arena.failed || pm_graph_shape(g, x).rows == count);
    return row_operation(g, PM_OP_SCATTER_ADD_ROWS, x, rows, count, index);
}

// --- combinations ---

pm_node pm_add_or(pm_graph *g, pm_node a, pm_node b) {
    if (a == PM_NO_NODE || b == PM_NO_NODE) {
        return a == PM_NO_NODE ? b : a;
    }
    return pm_add(g, a, b);
}

pm_node pm_concat_or(pm_graph *g, pm_node a, pm_node b) {
    if (a == PM_NO_NODE || b == PM_NO_NODE) {
        return a == PM_NO_NODE ? b : a;
    }
    return pm_concat(g, 2, (const pm_node[]){a, b});
}

pm_node pm_transpose(pm_graph *g, pm_node x) {
    const pm_shape shape = pm_graph_shape(g, x);
    const int count = shape.rows * shape.cols;
    int *index = pm_arena_array(&g->arena, (size_t)count, sizeof *index);
    for (int i = 0; i < count && index != NULL; ++i) {
        index[i] = i % shape.rows * shape.cols + i / shape.rows;
    }
    const pm_node column = pm_gather_rows(g, pm_reshape(g, x, count, 1), count, index);
    return pm_reshape(g, column, shape.cols, shape.rows);
}

pm_node pm_square(pm_graph *g, pm_node x) {
    return binary(g, PM_OP_MUL, x, x);
}

pm_node pm_magnitude(pm_graph *g, pm_node x) {
    return pm_mul(g, x, pm_offset(g, pm_scale(g, pm_is_negative(g, x), -2), 1));
}

// Translates each operation of kernel.c. The order of every sum is that of kernel.c and of
// base/linalg.c for one item. A sum begins with +0, as theirs do, so that terms that are products
// with a known +0 can be left out without changing a bit of a finite result.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/linalg.h"
#include "graph/source_writer.h"

#define LARGE 48         // numbers of an elementwise result from which a loop is written
#define LARGE_PRODUCT 96 // multiply-adds of a product of matrices, likewise
#define VECTOR 4         // numbers of a transcendental function, likewise

void pm_source_number(FILE *file, double value) {
    char text[40];
    snprintf(text, sizeof text, "%.17g", value);
    const bool whole = strpbrk(text, ".en") == NULL;
    fprintf(file, signbit(value) ? "(%s%s)" : "%s%s", text, whole ? ".0" : "");
}

static int entries(const pm_source_writer *w, pm_node x) {
    const pm_shape shape = pm_graph_node_at(w->g, x)->shape;
    return shape.rows * shape.cols;
}

void pm_source_put(pm_source_writer *w, pm_source_value n) {
    if (n.node == PM_NO_NODE) {
        pm_source_number(w->file, n.value);
    } else {
        fprintf(w->file, "%s[%d]", w->name[n.node], n.at);
        w->read[n.node] = true;
    }
}

static bool is_zero(pm_source_value n) {
    return n.node == PM_NO_NODE && n.value == 0 && !signbit(n.value);
}

static pm_source_value literal(double value) {
    return (pm_source_value){PM_NO_NODE, 0, value};
}

// Declares an array for the result of x.
static void declare(pm_source_writer *w, pm_node x) {
    const int n = entries(w, x);
    w->name[x] = pm_arena_printf(&w->arena, "n%d", x);
    if (w->name[x] == NULL) {
        w->exhausted = true;
        w->name[x] = "";
    }
    fprintf(w->file, "    double n%d[%d];\n", x, n);
    for (int i = 0; i < n; ++i) {
        w->number[x][i] = (pm_source_value){x, i, 0};
    }
}

// Begins a statement that computes number i of x.
static void begin(pm_source_writer *w, pm_node x, int i) {
    fprintf(w->file, "    n%d[%d] = ", x, i);
}

// --- operands as arrays, for loops ---

static bool is_contiguous(const pm_source_value *n, int count) {
    for (int i = 0; i < count; ++i) {
        if (n[i].node != n[0].node || n[i].node == PM_NO_NODE || n[i].at != n[0].at + i) {
            return false;
        }
    }
    return true;
}

static bool is_literal(const pm_source_value *n, int count) {
    for (int i = 0; i < count; ++i) {
        if (n[i].node != PM_NO_NODE) {
            return false;
        }
    }
    return true;
}

// Returns an expression for the array of x: its own memory, or a copy that is written first.
static const char *array_of(pm_source_writer *w, pm_node x) {
    const pm_source_value *n = w->number[x];
    const int count = entries(w, x);
    const char *text;
    if (is_contiguous(n, count)) {
        w->read[n[0].node] = true;
        text = n[0].at == 0 ? w->name[n[0].node]
                            : pm_arena_printf(&w->arena, "(%s + %d)", w->name[n[0].node], n[0].at);
    } else {
        text = pm_arena_printf(&w->arena, "c%d", w->ncopy);
        fprintf(w->file, "    %sconst double c%d[%d] = {", is_literal(n, count) ? "static " : "",
                w->ncopy++, count);
        for (int i = 0; i < count; ++i) {
            fputs(i == 0 ? "" : i % 8 == 0 ? ",\n        " : ", ", w->file);
            pm_source_put(w, n[i]);
        }
        fputs("};\n", w->file);
    }
    w->exhausted |= text == NULL;
    return text == NULL ? "" : text;
}

// --- elementwise operations ---

typedef struct steps {
    int row, col;
} steps;

// Returns how far apart the rows and columns of an operand are while a result of `shape` is
// written; 0 where the operand is repeated.
static steps steps_of(pm_shape operand, pm_shape shape) {
    return (steps){operand.rows == 1 && shape.rows != 1 ? 0 : operand.cols,
                   operand.cols == 1 && shape.cols != 1 ? 0 : 1};
}

static void write_loop(pm_source_writer *w, pm_node x, const char *symbol) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const char *a = array_of(w, node->operand[0]), *b = array_of(w, node->operand[1]);
    const steps sa = steps_of(pm_graph_node_at(w->g, node->operand[0])->shape, node->shape);
    const steps sb = steps_of(pm_graph_node_at(w->g, node->operand[1])->shape, node->shape);
    declare(w, x);
    fprintf(w->file,
            "    for (int r = 0; r < %d; ++r) {\n"
            "        for (int c = 0; c < %d; ++c) {\n"
            "            n%d[r * %d + c] = %s[r * %d + c * %d] %s %s[r * %d + c * %d];\n"
            "        }\n    }\n",
            node->shape.rows, node->shape.cols, x, node->shape.cols, a, sa.row, sa.col, symbol, b,
            sb.row, sb.col);
}

static void write_binary(pm_source_writer *w, pm_node x) {
    static const char *const symbols[] = {
        [PM_OP_ADD] = "+", [PM_OP_SUB] = "-", [PM_OP_MUL] = "*", [PM_OP_DIV] = "/"};
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    if (entries(w, x) >= LARGE) {
        write_loop(w, x, symbols[node->op]);
        return;
    }
    const pm_node a = node->operand[0], b = node->operand[1];
    const steps sa = steps_of(pm_graph_node_at(w->g, a)->shape, node->shape);
    const steps sb = steps_of(pm_graph_node_at(w->g, b)->shape, node->shape);
    declare(w, x);
    for (int i = 0; i < entries(w, x); ++i) {
        const int r = i / node->shape.cols, c = i % node->shape.cols;
        begin(w, x, i);
        pm_source_put(w, w->number[a][r * sa.row + c * sa.col]);
        fprintf(w->file, " %s ", symbols[node->op]);
        pm_source_put(w, w->number[b][r * sb.row + c * sb.col]);
        fputs(";\n", w->file);
    }
}

// The text before and after the operand of an operation with one operand.
typedef struct frame {
    const char *before, *after;
} frame;

static frame frame_of(const pm_graph_node *node, char text[64]) {
    static const frame frames[PM_OP_COUNT] = {[PM_OP_TANH] = {"pm_tanh_of(", ")"},
                                              [PM_OP_SIGMOID] = {"pm_sigmoid_of(", ")"},
                                              [PM_OP_SOFTPLUS] = {"pm_softplus_of(", ")"},
                                              [PM_OP_EXP] = {"pm_exp_of(", ")"},
                                              [PM_OP_LOG] = {"pm_log_of(", ")"},
                                              [PM_OP_SQRT] = {"sqrt(", ")"},
                                              [PM_OP_SIN] = {"sin(", ")"},
                                              [PM_OP_COS] = {"cos(", ")"},
                                              [PM_OP_IS_NEGATIVE] = {"(", " < 0 ? 1.0 : 0.0)"}};
    if (node->op == PM_OP_SCALE) {
        snprintf(text, 64, "%.17g * ", node->number);
        return (frame){text, ""};
    }
    if (node->op == PM_OP_OFFSET) {
        snprintf(text, 64, " + %.17g", node->number);
        return (frame){"", text};
    }
    return frames[node->op];
}

static void write_unary(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const pm_node a = node->operand[0];
    const int n = entries(w, x);
    char text[64];
    const frame f = frame_of(node, text);
    const bool transcendental = node->op >= PM_OP_TANH && node->op <= PM_OP_EXP;
    if (n >= (transcendental ? VECTOR : LARGE)) {
        const char *from = array_of(w, a);
        declare(w, x);
        fprintf(w->file, "    for (int i = 0; i < %d; ++i) {\n        n%d[i] = %s%s[i]%s;\n    }\n",
                n, x, f.before, from, f.after);
        return;
    }
    declare(w, x);
    for (int i = 0; i < n; ++i) {
        begin(w, x, i);
        fputs(f.before, w->file);
        pm_source_put(w, w->number[a][i]);
        fprintf(w->file, "%s;\n", f.after);
    }
}

// --- sums ---

static void write_sum_to(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const pm_node a = node->operand[0];
    const pm_shape from = pm_graph_node_at(w->g, a)->shape;
    const steps s = steps_of(node->shape, from);
    if (entries(w, a) >= LARGE) {
        const char *text = array_of(w, a);
        declare(w, x);
        fprintf(w->file,
                "    memset(n%d, 0, sizeof n%d);\n"
                "    for (int r = 0; r < %d; ++r) {\n"
                "        for (int c = 0; c < %d; ++c) {\n"
                "            n%d[r * %d + c * %d] += %s[r * %d + c];\n        }\n    }\n",
                x, x, from.rows, from.cols, x, s.row, s.col, text, from.cols);
        return;
    }
    declare(w, x);
    for (int i = 0; i < entries(w, x); ++i) {
        begin(w, x, i);
        fputs("0.0", w->file);
        for (int k = 0; k < entries(w, a); ++k) {
            const int r = k / from.cols, c = k % from.cols;
            if (r * s.row + c * s.col == i && !is_zero(w->number[a][k])) {
                fputs(" + ", w->file);
                pm_source_put(w, w->number[a][k]);
            }
        }
        fputs(";\n", w->file);
    }
}

// Writes " + a * b", or nothing if a factor is +0.
static void add_product(pm_source_writer *w, pm_source_value a, pm_source_value b) {
    if (is_zero(a) || is_zero(b)) {
        return;
    }
    fputs(" + ", w->file);
    pm_source_put(w, a);
    fputs(" * ", w->file);
    pm_source_put(w, b);
}

static void write_dot(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const pm_node a = node->operand[0], b = node->operand[1];
    const pm_shape shape_a = pm_graph_node_at(w->g, a)->shape;
    const pm_shape shape_b = pm_graph_node_at(w->g, b)->shape;
    const int cols = shape_a.cols;
    const int row_a = shape_a.rows == 1 ? 0 : cols, row_b = shape_b.rows == 1 ? 0 : cols;
    if (node->shape.rows * cols >= LARGE) {
        const char *pa = array_of(w, a), *pb = array_of(w, b);
        declare(w, x);
        fprintf(w->file,
                "    for (int r = 0; r < %d; ++r) {\n        n%d[r] = 0;\n"
                "        for (int c = 0; c < %d; ++c) {\n"
                "            n%d[r] += %s[r * %d + c] * %s[r * %d + c];\n        }\n    }\n",
                node->shape.rows, x, cols, x, pa, row_a, pb, row_b);
        return;
    }
    declare(w, x);
    for (int r = 0; r < node->shape.rows; ++r) {
        begin(w, x, r);
        fputs("0.0", w->file);
        for (int c = 0; c < cols; ++c) {
            add_product(w, w->number[a][r * row_a + c], w->number[b][r * row_b + c]);
        }
        fputs(";\n", w->file);
    }
}

// --- products of matrices ---

// Shape and strides of c [m][n] = a b, and which of the loops of base/linalg.c it takes.
typedef struct product {
    const pm_source_value *a, *b;
    int m, n, k, a_row, a_col, b_row, b_col;
    bool lanes; // inner products with eight partial sums
} product;

static product product_of(const pm_source_writer *w, const pm_graph_node *node) {
    const pm_shape shape = pm_graph_node_at(w->g, node->operand[0])->shape;
    const bool sum = node->op == PM_OP_MATMUL_SUM;
    const bool ta = sum || (node->first & 1) != 0, tb = !sum && (node->first & 2) != 0;
    product p = {.a = w->number[node->operand[0]],
                 .b = w->number[node->operand[1]],
                 .m = node->shape.rows,
                 .n = node->shape.cols,
                 .k = ta ? shape.rows : shape.cols};
    p.a_row = ta ? 1 : p.k;
    p.a_col = ta ? p.m : 1;
    p.b_row = tb ? 1 : p.n;
    p.b_col = tb ? p.k : 1;
    p.lanes = tb && p.m < PM_MANY_ROWS && p.k >= 4;
    return p;
}

static void write_plain_entry(pm_source_writer *w, const product *p, int i, int j) {
    fputs("0.0", w->file);
    for (int l = 0; l < p->k; ++l) {
        add_product(w, p->a[i * p->a_row + l * p->a_col], p->b[l * p->b_row + j * p->b_col]);
    }
}

// Writes the eight partial sums and their sum in the order of linalg.c. One +0 suffices: the other
// partial sums are added to one that cannot be -0.
static void write_lane_entry(pm_source_writer *w, const product *p, int i, int j) {
    static const int order[PM_LANES] = {0, 4, 1, 5, 2, 6, 3, 7};
    static const char *const before[PM_LANES] = {"((",      " + ", ") + (", " + ",
                                                 ")) + ((", " + ", ") + (", " + "};
    for (int s = 0; s < PM_LANES; ++s) {
        bool first = s > 0;
        fprintf(w->file, "%s%s", before[s], s == 0 ? "(0.0" : "");
        for (int l = order[s]; l < p->k; l += PM_LANES) {
            const pm_source_value a = p->a[i * p->a_row + l * p->a_col];
            const pm_source_value b = p->b[l * p->b_row + j * p->b_col];
            if (is_zero(a) || is_zero(b)) {
                continue;
            }
            fputs(first ? "(" : " + ", w->file);
            first = false;
            pm_source_put(w, a);
            fputs(" * ", w->file);
            pm_source_put(w, b);
        }
        fputs(first ? "0.0" : ")", w->file);
    }
    fputs("))", w->file);
}

static void write_product(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const product p = product_of(w, node);
    if ((long)p.m * p.n * p.k >= LARGE_PRODUCT) {
        const char *a = array_of(w, node->operand[0]), *b = array_of(w, node->operand[1]);
        declare(w, x);
        if (p.lanes) {
            fprintf(w->file, "    pm_inner_products(%d, %d, %d, %s, %d, %d, %s, n%d);\n", p.m, p.n,
                    p.k, a, p.a_row, p.a_col, b, x);
        } else {
            fprintf(w->file, "    pm_product(%d, %d, %d, %s, %d, %d, %s, %d, %d, n%d);\n", p.m, p.n,
                    p.k, a, p.a_row, p.a_col, b, p.b_row, p.b_col, x);
        }
        return;
    }
    declare(w, x);
    for (int i = 0; i < p.m; ++i) {
        for (int j = 0; j < p.n; ++j) {
            begin(w, x, i * p.n + j);
            if (p.lanes) {
                write_lane_entry(w, &p, i, j);
            } else {
                write_plain_entry(w, &p, i, j);
            }
            fputs(";\n", w->file);
        }
    }
}

// --- what only moves numbers ---

static void move_broadcast(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const steps s = steps_of(pm_graph_node_at(w->g, node->operand[0])->shape, node->shape);
    for (int i = 0; i < entries(w, x); ++i) {
        const int r = i / node->shape.cols, c = i % node->shape.cols;
        w->number[x][i] = w->number[node->operand[0]][r * s.row + c * s.col];
    }
}

static void move_reshape(pm_source_writer *w, pm_node x) {
    memcpy(w->number[x], w->number[pm_graph_node_at(w->g, x)->operand[0]],
           (size_t)entries(w, x) * sizeof(pm_source_value));
}

// Copies all columns of `from` to columns of x from `first` on.
static void move_columns(pm_source_writer *w, pm_node x, pm_node from, int first) {
    const pm_shape to = pm_graph_node_at(w->g, x)->shape;
    const int cols = pm_graph_node_at(w->g, from)->shape.cols;
    for (int r = 0; r < to.rows; ++r) {
        memcpy(w->number[x] + r * to.cols + first, w->number[from] + r * cols,
               (size_t)cols * sizeof(pm_source_value));
    }
}

static void move_slice(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = pm_graph_node_at(w->g, node->operand[0])->shape.cols;
    for (int r = 0; r < node->shape.rows; ++r) {
        memcpy(w->number[x] + r * node->shape.cols,
               w->number[node->operand[0]] + r * cols + node->first,
               (size_t)node->shape.cols * sizeof(pm_source_value));
    }
}

static void move_place(pm_source_writer *w, pm_node x) {
    for (int i = 0; i < entries(w, x); ++i) {
        w->number[x][i] = literal(0);
    }
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    move_columns(w, x, node->operand[0], node->first);
}

static void move_concat(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    int first = 0;
    for (int i = 0; i < node->noperand; ++i) {
        move_columns(w, x, node->operand[i], first);
        first += pm_graph_node_at(w->g, node->operand[i])->shape.cols;
    }
}

static void move_gather(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = node->shape.cols;
    for (int r = 0; r < node->nindex; ++r) {
        memcpy(w->number[x] + r * cols, w->number[node->operand[0]] + node->index[r] * cols,
               (size_t)cols * sizeof(pm_source_value));
    }
}

static void write_scatter(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = node->shape.cols;
    declare(w, x);
    for (int i = 0; i < entries(w, x); ++i) {
        begin(w, x, i);
        fputs("0.0", w->file);
        for (int r = 0; r < node->nindex; ++r) {
            if (node->index[r] == i / cols) {
                fputs(" + ", w->file);
                pm_source_put(w, w->number[node->operand[0]][r * cols + i % cols]);
            }
        }
        fputs(";\n", w->file);
    }
}

static void take_leaf(pm_source_writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    for (int i = 0; i < entries(w, x); ++i) {
        w->number[x][i] = node->op == PM_OP_INPUT   ? (pm_source_value){x, i, 0}
                          : node->op == PM_OP_PARAM ? literal(node->value[i])
                                                    : literal(node->number);
    }
}

typedef void write_rule(pm_source_writer *w, pm_node x);

static write_rule *const rules[PM_OP_COUNT] = {
    [PM_OP_INPUT] = take_leaf,
    [PM_OP_PARAM] = take_leaf,
    [PM_OP_CONSTANT] = take_leaf,
    [PM_OP_ADD] = write_binary,
    [PM_OP_SUB] = write_binary,
    [PM_OP_MUL] = write_binary,
    [PM_OP_DIV] = write_binary,
    [PM_OP_SCALE] = write_unary,
    [PM_OP_OFFSET] = write_unary,
    [PM_OP_TANH] = write_unary,
    [PM_OP_SIGMOID] = write_unary,
    [PM_OP_SOFTPLUS] = write_unary,
    [PM_OP_EXP] = write_unary,
    [PM_OP_LOG] = write_unary,
    [PM_OP_SQRT] = write_unary,
    [PM_OP_SIN] = write_unary,
    [PM_OP_COS] = write_unary,
    [PM_OP_IS_NEGATIVE] = write_unary,
    [PM_OP_SUM_TO] = write_sum_to,
    [PM_OP_BROADCAST_TO] = move_broadcast,
    [PM_OP_DOT] = write_dot,
    [PM_OP_MATMUL] = write_product,
    [PM_OP_MATMUL_SUM] = write_product,
    [PM_OP_RESHAPE] = move_reshape,
    [PM_OP_SLICE] = move_slice,
    [PM_OP_PLACE] = move_place,
    [PM_OP_CONCAT] = move_concat,
    [PM_OP_GATHER_ROWS] = move_gather,
    [PM_OP_SCATTER_ADD_ROWS] = write_scatter,
};

void pm_source_rule(pm_source_writer *w, pm_node x) {
    rules[pm_graph_node_at(w->g, x)->op](w, x);
}

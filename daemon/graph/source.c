// Writes graphs as functions in C99: finds what the results need and writes it in the order of the
// nodes. The order of every sum is that of operation.c and of base/linalg.c for one item. A sum
// begins with +0, as theirs do, so that terms that are products with a known +0 can be left out
// without changing a bit of a finite result.
#include "graph/source.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/arena.h"
#include "base/linalg.h"
#include "graph/node.h"

// The texts that every exported source begins with: base/elementary.h and graph/source_products.h,
// line by line. The build makes them from these files. They end with NULL.
extern const char *const pm_source_elementary_text[];
extern const char *const pm_source_products_text[];

#define LARGE 48         // numbers of an elementwise result from which a loop is written
#define LARGE_PRODUCT 96 // multiply-adds of a product of matrices, likewise
#define VECTOR 4         // numbers of a transcendental function, likewise

// The source of one number of a node: an entry of an array, or a literal.
typedef struct value {
    pm_node node; // the node in whose array the number is; PM_NO_NODE: the number is `literal`
    int at;       // the number's position in this array
    double literal;
} value;

typedef struct writer {
    FILE *file;
    const pm_graph *g;
    pm_arena arena;
    value **number;    // [nodes][rows * cols]; NULL: the node is not needed
    const char **name; // [nodes] name of the node's array in the source; NULL: it has none
    int *step;         // [nodes] stride of the numbers in this array; 0: each has its own place
    bool *read;        // [nodes] a statement reads the node's array
    int ncopy;         // constant arrays so far, which gather numbers from other arrays
} writer;

void pm_source_number(FILE *file, double number) {
    char text[40];
    snprintf(text, sizeof text, "%.17g", number);
    const bool whole = strpbrk(text, ".en") == NULL;
    fprintf(file, signbit(number) ? "(%s%s)" : "%s%s", text, whole ? ".0" : "");
}

static int entries(const writer *w, pm_node x) {
    const pm_shape shape = pm_graph_node_at(w->g, x)->shape;
    return shape.rows * shape.cols;
}

// Writes one number as an expression.
static void put(writer *w, value n) {
    if (n.node == PM_NO_NODE) {
        pm_source_number(w->file, n.literal);
    } else {
        const int step = w->step[n.node];
        fprintf(w->file, "%s[%d]", w->name[n.node], step > 0 ? n.at * step : n.at);
        w->read[n.node] = true;
    }
}

static bool is_zero(value n) {
    return n.node == PM_NO_NODE && n.literal == 0 && !signbit(n.literal);
}

static value literal(double number) {
    return (value){PM_NO_NODE, 0, number};
}

// Memory may run out while a text is written, which then is of no use: pm_source_write fails.
static const char *text_or_empty(const char *text) {
    return text == NULL ? "" : text;
}

// Declares an array for the result of x.
static void declare(writer *w, pm_node x) {
    const int n = entries(w, x);
    w->name[x] = text_or_empty(pm_arena_printf(&w->arena, "n%d", x));
    fprintf(w->file, "    double n%d[%d];\n", x, n);
    for (int i = 0; i < n; ++i) {
        w->number[x][i] = (value){x, i, 0};
    }
}

// Begins a statement that computes number i of x.
static void begin(writer *w, pm_node x, int i) {
    fprintf(w->file, "    n%d[%d] = ", x, i);
}

// --- operands as arrays, for loops ---

// Returns an expression for the array of x: its own memory, or a copy that is written first.
static const char *array_of(writer *w, pm_node x) {
    const value *n = w->number[x];
    const int count = entries(w, x);
    const char *text;
    bool is_contiguous = n[0].node != PM_NO_NODE, is_literal = true;
    for (int i = 0; i < count; ++i) {
        is_contiguous = is_contiguous && n[i].node == n[0].node && n[i].at == n[0].at + i &&
                        w->step[n[0].node] == 0;
        is_literal = is_literal && n[i].node == PM_NO_NODE;
    }
    if (is_contiguous) {
        w->read[n[0].node] = true;
        text = n[0].at == 0 ? w->name[n[0].node]
                            : pm_arena_printf(&w->arena, "(%s + %d)", w->name[n[0].node], n[0].at);
    } else {
        text = pm_arena_printf(&w->arena, "c%d", w->ncopy);
        fprintf(w->file, "    %sconst double c%d[%d] = {", is_literal ? "static " : "", w->ncopy++,
                count);
        for (int i = 0; i < count; ++i) {
            fputs(i == 0 ? "" : i % 8 == 0 ? ",\n        " : ", ", w->file);
            put(w, n[i]);
        }
        fputs("};\n", w->file);
    }
    return text_or_empty(text);
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

// An operand of an expression: a text, or one number.
typedef struct expression_operand {
    const char *text; // NULL: the number
    value number;
} expression_operand;

// Writes the value of an elementwise operation (node.h) for given operands.
static void write_value(writer *w, const pm_graph_node *node, const expression_operand *operand) {
    static const char *const values[PM_OP_COUNT] = {
#define VALUE(OPERATION, NAME, VALUE, ...) [PM_OP_##OPERATION] = #VALUE,
        PM_BINARY_OPERATIONS(VALUE) PM_UNARY_OPERATIONS(VALUE)
#undef VALUE
    };
    for (const char *at = values[node->op]; *at != '\0';) {
        const size_t word = strspn(at, "abcdefghijklmnopqrstuvwxyz_"), length = word > 0 ? word : 1;
        if (word == 1 && (*at == 'a' || *at == 'b')) {
            const expression_operand *o = &operand[*at - 'a'];
            if (o->text != NULL) {
                fputs(o->text, w->file);
            } else {
                put(w, o->number);
            }
        } else if (word == strlen("number") && strncmp(at, "number", word) == 0) {
            fprintf(w->file, "%.17g", node->number);
        } else {
            fwrite(at, 1, length, w->file);
        }
        at += length;
    }
    fputs(";\n", w->file);
}

static void write_elementwise(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int n = entries(w, x), noperand = node->noperand;
    const bool transcendental = node->op >= PM_OP_TANH && node->op <= PM_OP_EXP;
    expression_operand operand[2] = {{0}, {0}};
    steps step[2];
    for (int i = 0; i < noperand; ++i) {
        step[i] = steps_of(pm_graph_node_at(w->g, node->operand[i])->shape, node->shape);
    }
    if (n >= (transcendental ? VECTOR : LARGE)) {
        for (int i = 0; i < noperand; ++i) {
            const char *array = array_of(w, node->operand[i]);
            operand[i].text =
                text_or_empty(noperand == 1 ? pm_arena_printf(&w->arena, "%s[i]", array)
                                            : pm_arena_printf(&w->arena, "%s[r * %d + c * %d]",
                                                              array, step[i].row, step[i].col));
        }
        declare(w, x);
        if (noperand == 1) {
            fprintf(w->file, "    for (int i = 0; i < %d; ++i) {\n        n%d[i] = ", n, x);
            write_value(w, node, operand);
            fputs("    }\n", w->file);
        } else {
            fprintf(w->file,
                    "    for (int r = 0; r < %d; ++r) {\n"
                    "        for (int c = 0; c < %d; ++c) {\n"
                    "            n%d[r * %d + c] = ",
                    node->shape.rows, node->shape.cols, x, node->shape.cols);
            write_value(w, node, operand);
            fputs("        }\n    }\n", w->file);
        }
        return;
    }
    declare(w, x);
    for (int k = 0; k < n; ++k) {
        const int r = k / node->shape.cols, c = k % node->shape.cols;
        for (int i = 0; i < noperand; ++i) {
            operand[i].number = w->number[node->operand[i]][r * step[i].row + c * step[i].col];
        }
        begin(w, x, k);
        write_value(w, node, operand);
    }
}

// --- sums ---

static void write_sum_to(writer *w, pm_node x) {
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
                put(w, w->number[a][k]);
            }
        }
        fputs(";\n", w->file);
    }
}

// Writes " + a * b", or nothing if a factor is +0.
static void add_product(writer *w, value a, value b) {
    if (is_zero(a) || is_zero(b)) {
        return;
    }
    fputs(" + ", w->file);
    put(w, a);
    fputs(" * ", w->file);
    put(w, b);
}

static void write_dot(writer *w, pm_node x) {
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

// The operands of c = a b, the length of the inner products, and how far apart neighbouring rows
// and columns are.
typedef struct product {
    const value *a, *b;
    int k, a_row, a_col, b_row, b_col;
} product;

// Writes the products of number (i, j) that have l = first, first + step, and so on, joined by " +
// ". `started`: something stands before them. Returns true if something stands there then.
static bool write_terms(writer *w, const product *p, int i, int j, int first, int step,
                        bool started) {
    for (int l = first; l < p->k; l += step) {
        const value a = p->a[i * p->a_row + l * p->a_col], b = p->b[l * p->b_row + j * p->b_col];
        if (!is_zero(a) && !is_zero(b)) {
            fputs(started ? " + " : "(", w->file);
            put(w, a);
            fputs(" * ", w->file);
            put(w, b);
            started = true;
        }
    }
    return started;
}

static void write_matmul(writer *w, pm_node x) {
    // The eight partial sums in the order of linalg.c. One +0 suffices: the other partial sums are
    // added to one that cannot be -0.
    static const int order[PM_LANES] = {0, 4, 1, 5, 2, 6, 3, 7};
    static const char *const before[PM_LANES] = {"((",      " + ", ") + (", " + ",
                                                 ")) + ((", " + ", ") + (", " + "};
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const pm_shape shape = pm_graph_node_at(w->g, node->operand[0])->shape;
    const bool sum = node->op == PM_OP_MATMUL_SUM;
    const bool ta = sum || (node->first & 1) != 0, tb = !sum && (node->first & 2) != 0;
    const int m = node->shape.rows, n = node->shape.cols, k = ta ? shape.rows : shape.cols;
    const product p = {.a = w->number[node->operand[0]],
                       .b = w->number[node->operand[1]],
                       .k = k,
                       .a_row = ta ? 1 : k,
                       .a_col = ta ? m : 1,
                       .b_row = tb ? 1 : n,
                       .b_col = tb ? k : 1};
    const bool parts = tb && m < PM_MANY_ROWS && k >= 4;
    const bool loops = (long)m * n * k >= LARGE_PRODUCT;
    const char *a = loops ? array_of(w, node->operand[0]) : NULL;
    const char *b = loops ? array_of(w, node->operand[1]) : NULL;
    declare(w, x);
    if (loops && parts) {
        fprintf(w->file, "    pm_inner_products(%d, %d, %d, %s, %d, %d, %s, n%d);\n", m, n, k, a,
                p.a_row, p.a_col, b, x);
    } else if (loops) {
        fprintf(w->file, "    pm_product(%d, %d, %d, %s, %d, %d, %s, %d, %d, n%d);\n", m, n, k, a,
                p.a_row, p.a_col, b, p.b_row, p.b_col, x);
    }
    for (int e = 0; e < m * n && !loops; ++e) {
        begin(w, x, e);
        fputs(parts ? "" : "0.0", w->file);
        if (!parts) {
            write_terms(w, &p, e / n, e % n, 0, 1, true);
        }
        for (int s = 0; s < PM_LANES && parts; ++s) {
            fprintf(w->file, "%s%s", before[s], s == 0 ? "(0.0" : "");
            const bool any = write_terms(w, &p, e / n, e % n, order[s], PM_LANES, s == 0);
            fputs(any ? ")" : "0.0", w->file);
        }
        fputs(parts ? "));\n" : ";\n", w->file);
    }
}

static void write_matmul_sum(writer *w, pm_node x) {
    write_matmul(w, x);
}

// --- what only moves numbers ---

static void write_broadcast_to(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const steps s = steps_of(pm_graph_node_at(w->g, node->operand[0])->shape, node->shape);
    for (int i = 0; i < entries(w, x); ++i) {
        const int r = i / node->shape.cols, c = i % node->shape.cols;
        w->number[x][i] = w->number[node->operand[0]][r * s.row + c * s.col];
    }
}

static void write_reshape(writer *w, pm_node x) {
    memcpy(w->number[x], w->number[pm_graph_node_at(w->g, x)->operand[0]],
           (size_t)entries(w, x) * sizeof(value));
}

// Copies all columns of `from` to columns of x from `first` on.
static void move_columns(writer *w, pm_node x, pm_node from, int first) {
    const pm_shape to = pm_graph_node_at(w->g, x)->shape;
    const int cols = pm_graph_node_at(w->g, from)->shape.cols;
    for (int r = 0; r < to.rows; ++r) {
        memcpy(w->number[x] + r * to.cols + first, w->number[from] + r * cols,
               (size_t)cols * sizeof(value));
    }
}

static void write_slice(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = pm_graph_node_at(w->g, node->operand[0])->shape.cols;
    for (int r = 0; r < node->shape.rows; ++r) {
        memcpy(w->number[x] + r * node->shape.cols,
               w->number[node->operand[0]] + r * cols + node->first,
               (size_t)node->shape.cols * sizeof(value));
    }
}

static void write_place(writer *w, pm_node x) {
    for (int i = 0; i < entries(w, x); ++i) {
        w->number[x][i] = literal(0);
    }
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    move_columns(w, x, node->operand[0], node->first);
}

static void write_concat(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    int first = 0;
    for (int i = 0; i < node->noperand; ++i) {
        move_columns(w, x, node->operand[i], first);
        first += pm_graph_node_at(w->g, node->operand[i])->shape.cols;
    }
}

static void write_gather_rows(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = node->shape.cols;
    for (int r = 0; r < node->nindex; ++r) {
        memcpy(w->number[x] + r * cols, w->number[node->operand[0]] + node->index[r] * cols,
               (size_t)cols * sizeof(value));
    }
}

static void write_scatter_add_rows(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    const int cols = node->shape.cols;
    declare(w, x);
    for (int i = 0; i < entries(w, x); ++i) {
        begin(w, x, i);
        fputs("0.0", w->file);
        for (int r = 0; r < node->nindex; ++r) {
            if (node->index[r] == i / cols) {
                fputs(" + ", w->file);
                put(w, w->number[node->operand[0]][r * cols + i % cols]);
            }
        }
        fputs(";\n", w->file);
    }
}

static void take_leaf(writer *w, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(w->g, x);
    for (int i = 0; i < entries(w, x); ++i) {
        w->number[x][i] = node->op == PM_OP_INPUT   ? (value){x, i, 0}
                          : node->op == PM_OP_PARAM ? literal(node->value[i])
                                                    : literal(node->number);
    }
}

static void (*const rules[PM_OP_COUNT])(writer *, pm_node) = {
    [PM_OP_INPUT] = take_leaf,
    [PM_OP_PARAM] = take_leaf,
    [PM_OP_CONSTANT] = take_leaf,
#define ELEMENTWISE(OPERATION, ...) [PM_OP_##OPERATION] = write_elementwise,
#define OTHER(OPERATION, NAME) [PM_OP_##OPERATION] = write_##NAME,
    // clang-format off
    PM_BINARY_OPERATIONS(ELEMENTWISE)
    PM_UNARY_OPERATIONS(ELEMENTWISE)
    PM_OTHER_OPERATIONS(OTHER)
    // clang-format on
};

// --- the function ---

void pm_source_prelude(FILE *file) {
    for (const char *const *line = pm_source_elementary_text; *line != NULL; ++line) {
        fputs(*line, file);
    }
    for (const char *const *line = pm_source_products_text; *line != NULL; ++line) {
        fputs(*line, file);
    }
}

// BLAS computes large products in an order that depends on the processor.
static pm_status check_product(const pm_graph *g, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(g, x);
    if (node->op != PM_OP_MATMUL && node->op != PM_OP_MATMUL_SUM) {
        return PM_OK;
    }
    const pm_shape a = pm_graph_node_at(g, node->operand[0])->shape;
    const bool transposed = node->op == PM_OP_MATMUL_SUM || (node->first & 1) != 0;
    const int k = transposed ? a.rows : a.cols;
    if ((long)node->shape.rows * node->shape.cols * k <= PM_SMALL_PRODUCT) {
        return PM_OK;
    }
    return pm_fail(PM_ECONFIG,
                   "a model multiplies matrices of %d x %d x %d numbers, which only BLAS does fast "
                   "and in an order of its own: expected at most %d multiply-adds",
                   node->shape.rows, k, node->shape.cols, PM_SMALL_PRODUCT);
}

pm_status pm_source_write(FILE *file, const pm_graph *graph, const double *const *known, int nin,
                          const pm_source_argument *input, int nout,
                          const pm_source_argument *output) {
    const int nnode = pm_graph_size(graph);
    writer w = {.file = file, .g = graph};
    pm_status status = PM_OK;
    bool *needed = pm_arena_array(&w.arena, (size_t)nnode + 1, sizeof *needed);
    w.number = pm_arena_array(&w.arena, (size_t)nnode + 1, sizeof *w.number);
    w.name = pm_arena_array(&w.arena, (size_t)nnode + 1, sizeof *w.name);
    w.step = pm_arena_array(&w.arena, (size_t)nnode + 1, sizeof *w.step);
    w.read = pm_arena_array(&w.arena, (size_t)nnode + 1, sizeof *w.read);
    w.arena.failed = w.arena.failed || pm_graph_exhausted(graph);
    PM_TRY_DONE(pm_arena_status(&w.arena, "a source file"));
    // The nodes that the results need, from the last one down.
    for (int i = 0; i < nout; ++i) {
        if (output[i].node != PM_NO_NODE) {
            needed[output[i].node] = true;
        }
    }
    for (pm_node x = nnode - 1; x >= 0; --x) {
        const pm_graph_node *node = pm_graph_node_at(graph, x);
        const bool computed = needed[x] && (known == NULL || known[x] == NULL);
        for (int i = 0; computed && i < node->noperand; ++i) {
            needed[node->operand[i]] = true;
        }
    }
    // The parameters.
    for (int i = 0; i < nin; ++i) {
        fprintf(file, "%sconst double *restrict %s", i == 0 ? "(" : ", ", input[i].name);
        if (input[i].node != PM_NO_NODE) {
            w.name[input[i].node] = input[i].name;
            w.step[input[i].node] = input[i].step;
        }
    }
    for (int i = 0; i < nout; ++i) {
        fprintf(file, "%sdouble *restrict %s", i == 0 && nin == 0 ? "(" : ", ", output[i].name);
    }
    fputs(") {\n", file);
    for (int i = 0; i < nin; ++i) {
        fprintf(file, "    (void)%s;\n", input[i].name);
    }
    // The statements.
    for (pm_node x = 0; x < nnode; ++x) {
        const bool is_known = known != NULL && known[x] != NULL;
        if (needed[x]) {
            w.number[x] = pm_arena_array(&w.arena, (size_t)entries(&w, x), sizeof *w.number[x]);
            PM_TRY_DONE(pm_arena_status(&w.arena, "a source file"));
        }
        for (int i = 0; needed[x] && is_known && i < entries(&w, x); ++i) {
            w.number[x][i] = literal(known[x][i]);
        }
        if (needed[x] && !is_known) {
            PM_TRY_DONE(check_product(graph, x));
            rules[pm_graph_node_at(graph, x)->op](&w, x);
        }
    }
    PM_TRY_DONE(pm_arena_status(&w.arena, "a source file"));
    for (int i = 0; i < nout; ++i) {
        for (int k = 0; k < output[i].size; ++k) {
            fprintf(file, "    %s[%d] = ", output[i].name,
                    output[i].step > 0 ? k * output[i].step : k);
            put(&w, output[i].node == PM_NO_NODE ? literal(0) : w.number[output[i].node][k]);
            fputs(";\n", file);
        }
    }
    // A product with a known +0 is left out. Its other factor may then be unused, of which a
    // compiler would warn.
    for (pm_node x = 0; x < nnode; ++x) {
        if (w.name[x] != NULL && !w.read[x] && pm_graph_node_at(graph, x)->op != PM_OP_INPUT) {
            fprintf(file, "    (void)%s;\n", w.name[x]);
        }
    }
    fputs("}\n", file);
done:
    pm_arena_free(&w.arena);
    return status;
}

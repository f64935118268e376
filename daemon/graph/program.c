// Plans programs: which nodes they need, in which order, and where their numbers live. A node's
// memory is reused after its last reader has run; a view shares the memory of its operand.
#include "graph/program.h"

#include <assert.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/linalg.h"
#include "graph/node.h"

#define ALIGNMENT ((size_t)8) // in numbers: one cache line

// In multiplications: a function such as tanh, and an instruction shared by a batch of items.
#define FUNCTION 8
#define CALL 1

// --- a free list of memory intervals ---

typedef struct interval {
    size_t first, size; // numbers
} interval;

typedef struct memory_pool {
    interval *space; // [count] free memory, sorted; never two that touch
    int count, capacity;
    size_t end; // of all memory handed out so far, in numbers
} memory_pool;

// Takes `size` numbers from the smallest free interval that fits, or else from new memory. Returns
// the position of the first one.
static size_t pool_take(memory_pool *pool, size_t size) {
    int best = -1;
    for (int i = 0; i < pool->count; ++i) {
        if (pool->space[i].size >= size &&
            (best < 0 || pool->space[i].size < pool->space[best].size)) {
            best = i;
        }
    }
    if (best < 0) {
        const size_t first = pool->end;
        pool->end += size;
        return first;
    }
    interval *space = &pool->space[best];
    const size_t first = space->first;
    space->first += size;
    space->size -= size;
    if (space->size == 0) {
        memmove(space, space + 1, (size_t)(pool->count - best - 1) * sizeof *space);
        --pool->count;
    }
    return first;
}

// Gives an interval back; false if memory is exhausted.
static bool pool_give(memory_pool *pool, size_t first, size_t size) {
    if (pool->count == pool->capacity) {
        const int capacity = pool->capacity == 0 ? 64 : 2 * pool->capacity;
        interval *space = realloc(pool->space, (size_t)capacity * sizeof *space);
        if (space == NULL) {
            return false;
        }
        pool->space = space;
        pool->capacity = capacity;
    }
    int i = 0;
    while (i < pool->count && pool->space[i].first < first) {
        ++i;
    }
    memmove(&pool->space[i + 1], &pool->space[i], (size_t)(pool->count - i) * sizeof(interval));
    pool->space[i] = (interval){first, size};
    ++pool->count;
    // Joins the interval with free neighbours.
    for (int j = i > 0 ? i - 1 : 0; j < i + 1 && j + 1 < pool->count;) {
        interval *a = &pool->space[j], *b = a + 1;
        if (a->first + a->size != b->first) {
            ++j;
            continue;
        }
        a->size += b->size;
        memmove(b, b + 1, (size_t)(pool->count - j - 2) * sizeof *b);
        --pool->count;
        --i;
    }
    return true;
}

// --- planning ---

// The plan for one node. `root` is the node whose memory it uses, itself unless it is a
// view.
typedef struct node_memory {
    bool needed, pinned;
    bool fixed; // the numbers depend on weights alone
    pm_node root;
    int last_use;
    size_t offset, size;
} node_memory;

typedef struct memory_plan {
    const pm_graph *g;
    int nnode, capacity;
    bool lanes; // items are innermost
    node_memory *place;
    memory_pool pool;
} memory_plan;

static bool is_leaf(pm_op op) {
    return op == PM_OP_INPUT || op == PM_OP_PARAM || op == PM_OP_CONSTANT;
}

static bool same_shape(pm_shape a, pm_shape b) {
    return a.batched == b.batched && a.rows == b.rows && a.cols == b.cols;
}

// Returns true if a node is a view, which has its operand's numbers at an offset and needs no
// instruction.
static bool is_view(const memory_plan *plan, const pm_graph_node *node) {
    if (node->op == PM_OP_RESHAPE) {
        return true;
    }
    const bool one_row =
        node->shape.rows == 1 && (!node->shape.batched || plan->capacity == 1 || plan->lanes);
    return node->op == PM_OP_SLICE && one_row;
}

// Finds the nodes that the outputs need, from the last one down, and the last reader of each.
static void find_needed(memory_plan *plan, int count, const pm_node *output) {
    for (int i = 0; i < count; ++i) {
        plan->place[output[i]].needed = true;
        plan->place[output[i]].pinned = true;
    }
    for (pm_node x = plan->nnode - 1; x >= 0; --x) {
        const pm_graph_node *node = pm_graph_node_at(plan->g, x);
        for (int i = 0; plan->place[x].needed && i < node->noperand; ++i) {
            plan->place[node->operand[i]].needed = true;
        }
    }
    for (pm_node x = 0; x < plan->nnode; ++x) {
        const pm_graph_node *node = pm_graph_node_at(plan->g, x);
        node_memory *place = &plan->place[x];
        place->root = is_view(plan, node) ? plan->place[node->operand[0]].root : x;
        place->last_use = x;
        // Numbers that depend on weights alone are kept between runs where that takes no more
        // memory than one item does.
        place->fixed =
            node->op != PM_OP_INPUT && (!node->shape.batched || plan->lanes || plan->capacity == 1);
        for (int i = 0; i < node->noperand && place->fixed; ++i) {
            place->fixed = plan->place[node->operand[i]].fixed;
        }
        // Leaves keep their memory: callers write inputs before a run, and constants are filled
        // once. So does what later runs leave out.
        place->pinned = place->pinned || place->fixed || is_leaf(node->op);
        node_memory *root = &plan->place[place->root];
        root->pinned = root->pinned || (place->needed && place->pinned);
        for (int i = 0; place->needed && i < node->noperand; ++i) {
            plan->place[plan->place[node->operand[i]].root].last_use = x;
        }
    }
}

// Returns true if nothing reads the memory of `root` after x.
static bool dies_at(const memory_plan *plan, pm_node root, pm_node x) {
    return plan->place[root].last_use == x && !plan->place[root].pinned;
}

// Returns the operand whose memory x may take over, or PM_NO_NODE: one of the same shape that
// nothing reads later, and that x does not read through a view as well.
static pm_node reusable_operand(const memory_plan *plan, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(plan->g, x);
    for (int i = 0; pm_operations[node->op].in_place && i < node->noperand; ++i) {
        const pm_node operand = node->operand[i];
        bool reusable = plan->place[operand].root == operand && dies_at(plan, operand, x) &&
                        same_shape(pm_graph_node_at(plan->g, operand)->shape, node->shape);
        for (int j = 0; j < node->noperand && reusable; ++j) {
            reusable = node->operand[j] == operand || plan->place[node->operand[j]].root != operand;
        }
        if (reusable) {
            return operand;
        }
    }
    return PM_NO_NODE;
}

static void place_own(memory_plan *plan, pm_node x) {
    node_memory *place = &plan->place[x];
    const pm_shape shape = pm_graph_node_at(plan->g, x)->shape;
    const size_t size =
        (size_t)shape.rows * (size_t)shape.cols * (size_t)(shape.batched ? plan->capacity : 1);
    place->size = (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    const pm_node kept = reusable_operand(plan, x);
    if (kept != PM_NO_NODE) {
        place->offset = plan->place[kept].offset;
        plan->place[kept].size = 0; // x has it now
    } else {
        place->offset = pool_take(&plan->pool, place->size);
    }
}

// Gives every node that the outputs need its memory. Returns false if memory is exhausted.
static bool place_nodes(memory_plan *plan) {
    // Inputs, and what depends on weights alone, come first: their numbers are written before a
    // run, so they share memory with nothing.
    for (pm_node x = 0; x < plan->nnode; ++x) {
        const node_memory *place = &plan->place[x];
        const pm_op op = pm_graph_node_at(plan->g, x)->op;
        if (op == PM_OP_INPUT ||
            (op != PM_OP_PARAM && place->needed && place->fixed && place->root == x)) {
            place_own(plan, x);
        }
    }
    for (pm_node x = 0; x < plan->nnode; ++x) {
        const pm_graph_node *node = pm_graph_node_at(plan->g, x);
        if (!plan->place[x].needed || plan->place[x].fixed || node->op == PM_OP_INPUT) {
            continue;
        }
        if (plan->place[x].root == x) {
            place_own(plan, x);
        }
        for (int i = 0; i < node->noperand; ++i) {
            const pm_node root = plan->place[node->operand[i]].root;
            node_memory *place = &plan->place[root];
            if (dies_at(plan, root, x) && place->size > 0) {
                if (!pool_give(&plan->pool, place->offset, place->size)) {
                    return false;
                }
                place->size = 0; // an operand that appears twice is given back once
            }
        }
    }
    return true;
}

// --- instructions ---

// Writes the steps through an operand or a result while the loops go over `loops`.
static void set_steps(pm_shape shape, pm_shape loops, int lanes, ptrdiff_t step[3]) {
    const ptrdiff_t row = shape.rows == 1 && loops.rows != 1 ? 0 : shape.cols;
    const ptrdiff_t col = shape.cols == 1 && loops.cols != 1 ? 0 : 1;
    const ptrdiff_t lane = shape.batched ? lanes : 1;
    const bool by_item = shape.batched && loops.batched;
    step[0] = lanes > 1 ? row * lane : by_item ? (ptrdiff_t)shape.rows * shape.cols : 0;
    step[1] = lanes > 1 ? col * lane : row;
    step[2] = lanes > 1 ? by_item : col;
}

// Joins the two inner loops of an instruction where one loop passes the same numbers.
static void join_loops(pm_instruction *x) {
    ptrdiff_t *steps[3] = {x->step, x->step_a, x->step_b};
    bool joins = true;
    for (int i = 0; i < 3 && joins && x->size[2] > 1; ++i) {
        joins = x->size[1] == 1 || steps[i][1] == x->size[2] * steps[i][2];
    }
    for (int i = 0; i < 3 && joins && x->size[2] == 1; ++i) {
        steps[i][2] = steps[i][1];
    }
    if (joins) {
        x->size[2] *= x->size[1];
        x->size[1] = 1;
    }
}

// Appends the instruction that computes a node.
static void emit(pm_program *p, const memory_plan *plan, pm_node handle) {
    pm_instruction *x = &p->instruction[p->ninstruction++];
    const pm_graph_node *node = pm_graph_node_at(plan->g, handle);
    const pm_node *operand = node->operand;
    // The second operand of an operation on one number is the first.
    const pm_node a = operand[0], b = operand[node->noperand >= 2 ? 1 : 0];
    *x = (pm_instruction){.run = pm_operations[node->op].run,
                          .op = node->op,
                          .shape = node->shape,
                          .shape_a = pm_graph_node_at(plan->g, a)->shape,
                          .shape_b = pm_graph_node_at(plan->g, b)->shape,
                          .lanes = plan->lanes && node->shape.batched ? plan->capacity : 1,
                          .out = p->value[handle],
                          .a = p->value[a],
                          .b = p->value[b],
                          .number = node->number,
                          .first = node->first,
                          .nindex = node->nindex};
    const bool sums = node->op == PM_OP_SUM_TO;
    const pm_shape loops = sums ? x->shape_a : x->shape;
    set_steps(x->shape, loops, x->lanes, x->step);
    set_steps(x->shape_a, loops, x->lanes, x->step_a);
    set_steps(x->shape_b, loops, x->lanes, x->step_b);
    const bool many = x->lanes > 1;
    x->size[0] = many ? loops.rows : loops.batched && plan->capacity > 1 ? 0 : 1;
    x->size[1] = many ? loops.cols : loops.rows;
    x->size[2] = many ? x->lanes : loops.cols;
    if (pm_operations[node->op].in_place || sums || node->op == PM_OP_BROADCAST_TO) {
        join_loops(x);
    }
    if (node->nindex > 0) {
        int *index = pm_arena_array(&p->arena, (size_t)node->nindex, sizeof *index);
        x->index =
            index == NULL ? NULL : memcpy(index, node->index, (size_t)node->nindex * sizeof *index);
    }
    if (node->op == PM_OP_CONCAT) {
        const double **part = pm_arena_array(&p->arena, (size_t)node->noperand, sizeof *part);
        int *cols = pm_arena_array(&p->arena, (size_t)node->noperand, sizeof *cols);
        for (int i = 0; i < node->noperand && cols != NULL; ++i) {
            part[i] = p->value[operand[i]];
            cols[i] = pm_graph_node_at(plan->g, operand[i])->shape.cols;
        }
        x->part = part;
        x->part_cols = cols;
        x->nindex = node->noperand;
    }
}

// Returns true if an operand with these steps has the result's numbers one by one, or one number
// for all if `one`.
static bool has_steps(const pm_instruction *x, const ptrdiff_t *step, bool one) {
    bool has = true;
    for (int i = 0; i < 3; ++i) {
        has = has && (x->size[i] == 1 || step[i] == (one ? 0 : x->step[i]));
    }
    return has;
}

// Returns the short form of an instruction.
static pm_row shorten(const pm_instruction *x) {
    pm_row row = {.out = x->out,
                  .a = x->a,
                  .n = x->shape.rows * x->shape.cols,
                  .many = x->shape.batched,
                  .whole = x,
                  .kind = -1};
    if (x->op >= PM_OP_TANH && x->op <= PM_OP_OFFSET) {
        row.number = x->number;
        row.kind = PM_ROW(x->op, PM_ROW_NEITHER);
    } else if (x->op <= PM_OP_DIV) {
        const bool a = has_steps(x, x->step_a, false), b = has_steps(x, x->step_b, false);
        const bool first = has_steps(x, x->step_a, true), second = has_steps(x, x->step_b, true);
        if ((a && (b || second)) || (first && b)) {
            row.b = x->b;
            row.kind = PM_ROW(x->op, a && b ? PM_ROW_NEITHER : a ? PM_ROW_SECOND : PM_ROW_FIRST);
        }
    } else if (x->op == PM_OP_SLICE && x->shape.cols == 1 && x->lanes == 1) {
        row.a = x->a + x->first;
        row.stride = x->shape_a.cols;
        row.kind = PM_ROW(x->op, PM_ROW_NEITHER);
    }
    return row;
}

static void resolve_values(pm_program *p, const memory_plan *plan) {
    for (pm_node x = 0; x < plan->nnode; ++x) {
        const pm_graph_node *node = pm_graph_node_at(plan->g, x);
        const node_memory *place = &plan->place[x];
        if (node->op == PM_OP_PARAM) {
            // Only read: no instruction writes to a leaf.
            p->value[x] = (double *)(uintptr_t)node->value;
        } else if (place->root != x) {
            const ptrdiff_t step = plan->lanes && node->shape.batched ? plan->capacity : 1;
            const ptrdiff_t first = node->op == PM_OP_SLICE ? node->first * step : 0;
            double *of = p->value[node->operand[0]];
            p->value[x] = of == NULL ? NULL : of + first;
        } else if (place->needed || node->op == PM_OP_INPUT) {
            p->value[x] = p->memory + place->offset;
        }
        if (node->op == PM_OP_CONSTANT && place->needed) {
            for (int i = 0; i < node->shape.rows * node->shape.cols; ++i) {
                p->value[x][i] = node->number;
            }
        }
    }
}

// Plans memory and emits the instructions: those that depend on weights alone, then all others.
static pm_status build(pm_program *p, memory_plan *plan, int count, const pm_node *output) {
    const size_t nnode = (size_t)plan->nnode;
    plan->place = calloc(nnode, sizeof *plan->place);
    p->value = pm_arena_array(&p->arena, nnode, sizeof *p->value);
    p->needed = pm_arena_array(&p->arena, nnode, sizeof *p->needed);
    p->fixed = pm_arena_array(&p->arena, nnode, sizeof *p->fixed);
    p->output = pm_arena_array(&p->arena, (size_t)count, sizeof *p->output);
    p->instruction = pm_arena_array(&p->arena, nnode, sizeof *p->instruction);
    p->row = pm_arena_array(&p->arena, nnode, sizeof *p->row);
    PM_TRY(pm_arena_status(&p->arena, "a program of %d nodes", plan->nnode));
    PM_TRY(pm_allocated(plan->place, "a program of %d nodes", plan->nnode));
    p->noutput = count;
    memcpy(p->output, output, (size_t)count * sizeof *output);
    find_needed(plan, count, output);
    if (!place_nodes(plan)) {
        return pm_fail(PM_ENOMEM, "out of memory for planning %d nodes", plan->nnode);
    }
    p->memory_size = plan->pool.end > 0 ? plan->pool.end : ALIGNMENT;
    p->memory = aligned_alloc(ALIGNMENT * sizeof(double), p->memory_size * sizeof(double));
    PM_TRY(pm_allocated(p->memory, "%zu numbers of a program", p->memory_size));
    memset(p->memory, 0, p->memory_size * sizeof(double));
    resolve_values(p, plan);
    for (int fixed = 1; fixed >= 0; --fixed) {
        for (pm_node x = 0; x < plan->nnode; ++x) {
            const pm_graph_node *node = pm_graph_node_at(plan->g, x);
            p->needed[x] = plan->place[x].needed;
            p->fixed[x] = plan->place[x].fixed;
            if (p->needed[x] && plan->place[x].fixed == (fixed == 1) && !is_leaf(node->op) &&
                !is_view(plan, node)) {
                emit(p, plan, x);
            }
        }
        p->nfixed = fixed == 1 ? p->ninstruction : p->nfixed;
    }
    for (int i = 0; i < p->ninstruction; ++i) {
        p->row[i] = shorten(&p->instruction[i]);
    }
    return pm_arena_status(&p->arena, "a program of %d nodes", plan->nnode);
}

static pm_status open_program(pm_program **program, const pm_graph *graph, int count,
                              const pm_node *output, int capacity, bool lanes) {
    if (pm_graph_exhausted(graph)) {
        return pm_fail(PM_ENOMEM, "out of memory while building a graph");
    }
    pm_program *p = NULL;
    PM_TRY(PM_NEW(p, "a program"));
    p->nnode = pm_graph_size(graph);
    p->capacity = capacity;
    memory_plan plan = {.g = graph, .nnode = p->nnode, .capacity = capacity, .lanes = lanes};
    const pm_status status = build(p, &plan, count, output);
    free(plan.place);
    free(plan.pool.space);
    if (status != PM_OK) {
        pm_program_close(p);
        return status;
    }
    *program = p;
    return PM_OK;
}

pm_status pm_program_open(pm_program **program, const pm_graph *graph, int count,
                          const pm_node *output, int capacity) {
    return open_program(program, graph, count, output, capacity, false);
}

pm_status pm_program_open_lanes(pm_program **program, const pm_graph *graph, int count,
                                const pm_node *output, int lanes) {
    assert(lanes == 1 || (lanes > 0 && lanes % PM_LANES == 0));
    if (lanes == 1) {
        return pm_program_open(program, graph, count, output, 1);
    }
    PM_TRY(open_program(program, graph, count, output, lanes, true));
    for (int i = 0; i < (*program)->ninstruction; ++i) {
        // A kernel gives all lanes their bits if it neither sums over the batch nor calls BLAS.
        const pm_instruction *x = &(*program)->instruction[i];
        bool serves = x->shape.batched || !x->shape_a.batched;
        if (x->op == PM_OP_MATMUL && x->shape.batched) {
            const int k = (x->first & 1) != 0 ? x->shape_a.rows : x->shape_a.cols;
            serves = (long)x->shape.rows * x->shape.cols * k <= PM_SMALL_PRODUCT;
        }
        if (!serves) {
            pm_program_close(*program);
            *program = NULL;
            break;
        }
    }
    return PM_OK;
}

void pm_program_close(pm_program *program) {
    if (program != NULL) {
        pm_arena_free(&program->arena);
        free(program->memory);
        free(program);
    }
}

double *pm_program_value(pm_program *program, pm_node x) {
    assert(x >= 0 && x < program->nnode && program->value[x] != NULL);
    return program->value[x];
}

double *pm_program_input(pm_program *program, pm_node x) {
    return x == PM_NO_NODE || !program->needed[x] ? NULL : pm_program_value(program, x);
}

void pm_program_prepare(pm_program *program) {
    pm_rows_run(program->row, program->row + program->nfixed, program->capacity);
}

void pm_program_run_prepared(pm_program *program, int batch) {
    assert(batch > 0 && batch <= program->capacity);
    if (program->kernel != NULL) {
        program->kernel(program->memory);
        return;
    }
    pm_rows_run(program->row + program->nfixed, program->row + program->ninstruction, batch);
}

void pm_program_run(pm_program *program, int batch) {
    pm_program_prepare(program);
    pm_program_run_prepared(program, batch);
}

double pm_program_work(const pm_program *program) {
    double work = 0;
    for (int i = program->nfixed; i < program->ninstruction; ++i) {
        const pm_instruction *x = &program->instruction[i];
        // PM_FUNCTIONS lists the functions between these two.
        const bool function = x->op >= PM_OP_TANH && x->op <= PM_OP_COS;
        const double each = function                ? FUNCTION
                            : x->op != PM_OP_MATMUL ? 1
                            : (x->first & 1) != 0   ? x->shape_a.rows
                                                    : x->shape_a.cols;
        work += CALL + each * x->shape.rows * x->shape.cols;
    }
    return work;
}

size_t pm_program_bytes(const pm_program *program) {
    return program->memory_size * sizeof(double);
}

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

struct pm_program {
    pm_arena arena;
    double *memory;
    size_t memory_size; // numbers
    int ninstruction, nfixed;
    pm_instruction *instruction; // [ninstruction]; the first `nfixed` depend on weights alone
    int nnode;
    double **value; // [nnode] where a node's numbers live; NULL: not part of the program
    bool *needed;   // [nnode] whether an output needs the node
    int capacity;
};

// --- a free list of memory intervals ---

typedef struct interval {
    size_t first, size; // numbers
} interval;

typedef struct memory_pool {
    interval *space; // [count] free memory, sorted; never two that touch
    int count, capacity;
    size_t end; // of all memory handed out so far, in numbers
} memory_pool;

// Returns the first of `size` numbers: of the smallest free interval that fits, or of new memory.
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

static size_t memory_of(const memory_plan *plan, pm_shape shape) {
    const size_t size =
        (size_t)shape.rows * (size_t)shape.cols * (size_t)(shape.batched ? plan->capacity : 1);
    return (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

static bool is_leaf(pm_op op) {
    return op == PM_OP_INPUT || op == PM_OP_PARAM || op == PM_OP_CONSTANT;
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

// Returns true if the numbers of a node depend on weights alone, and keeping them between runs
// takes no more memory than one item does.
static bool is_fixed(const memory_plan *plan, const pm_graph_node *node) {
    bool fixed =
        node->op != PM_OP_INPUT && (!node->shape.batched || plan->lanes || plan->capacity == 1);
    for (int i = 0; i < node->noperand && fixed; ++i) {
        fixed = plan->place[node->operand[i]].fixed;
    }
    return fixed;
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
        place->fixed = is_fixed(plan, node);
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

// Returns true if x also reads the memory of `operand` through a view.
static bool is_viewed_too(const memory_plan *plan, pm_node x, pm_node operand) {
    const pm_graph_node *node = pm_graph_node_at(plan->g, x);
    for (int i = 0; i < node->noperand; ++i) {
        if (node->operand[i] != operand && plan->place[node->operand[i]].root == operand) {
            return true;
        }
    }
    return false;
}

// Returns the operand whose memory x may take over, or PM_NO_NODE.
static pm_node reusable_operand(const memory_plan *plan, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(plan->g, x);
    for (int i = 0; pm_operations[node->op].in_place && i < node->noperand; ++i) {
        const pm_node root = plan->place[node->operand[i]].root;
        const pm_shape shape = pm_graph_node_at(plan->g, node->operand[i])->shape;
        if (root == node->operand[i] && dies_at(plan, root, x) && !is_viewed_too(plan, x, root) &&
            shape.batched == node->shape.batched && shape.rows == node->shape.rows &&
            shape.cols == node->shape.cols) {
            return root;
        }
    }
    return PM_NO_NODE;
}

static bool release_operands(memory_plan *plan, pm_node x) {
    const pm_graph_node *node = pm_graph_node_at(plan->g, x);
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
    return true;
}

static void place_own(memory_plan *plan, pm_node x) {
    node_memory *place = &plan->place[x];
    const pm_node kept = reusable_operand(plan, x);
    place->size = memory_of(plan, pm_graph_node_at(plan->g, x)->shape);
    place->offset =
        kept != PM_NO_NODE ? plan->place[kept].offset : pool_take(&plan->pool, place->size);
    if (kept != PM_NO_NODE) {
        plan->place[kept].size = 0; // x has it now
    }
}

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
        if (!plan->place[x].needed || plan->place[x].fixed ||
            pm_graph_node_at(plan->g, x)->op == PM_OP_INPUT) {
            continue;
        }
        if (plan->place[x].root == x) {
            place_own(plan, x);
        }
        if (!release_operands(plan, x)) {
            return false;
        }
    }
    return true;
}

// --- instructions ---

static pm_stride stride_against(pm_shape operand, pm_shape result) {
    return (pm_stride){
        operand.batched && result.batched ? (ptrdiff_t)operand.rows * operand.cols : 0,
        operand.rows == 1 && result.rows != 1 ? 0 : operand.cols,
        operand.cols == 1 && result.cols != 1 ? 0 : 1,
    };
}

static bool same_shape(pm_shape a, pm_shape b) {
    return a.batched == b.batched && a.rows == b.rows && a.cols == b.cols;
}

static pm_status resolve_parts(pm_program *p, const pm_graph *g, pm_instruction *x) {
    const int count = x->node->noperand;
    const double **part = pm_arena_array(&p->arena, (size_t)count, sizeof *part);
    int *cols = pm_arena_array(&p->arena, (size_t)count, sizeof *cols);
    if (part == NULL || cols == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a program");
    }
    for (int i = 0; i < count; ++i) {
        part[i] = p->value[x->node->operand[i]];
        cols[i] = pm_graph_node_at(g, x->node->operand[i])->shape.cols;
    }
    x->part = part;
    x->part_cols = cols;
    x->nindex = count;
    return PM_OK;
}

static pm_status emit(pm_program *p, const pm_graph *g, pm_node handle) {
    pm_instruction *x = &p->instruction[p->ninstruction++];
    const pm_graph_node *node = pm_graph_node_at(g, handle);
    pm_graph_node *copy = pm_arena_alloc(&p->arena, sizeof *copy);
    int *index = pm_arena_array(&p->arena, (size_t)node->nindex, sizeof *index);
    if (copy == NULL || index == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a program");
    }
    *copy = *node;
    if (node->nindex > 0) {
        memcpy(index, node->index, (size_t)node->nindex * sizeof *index);
    }
    *x = (pm_instruction){.run = pm_operations[node->op].run,
                          .node = copy,
                          .shape = node->shape,
                          .out = p->value[handle],
                          .number = node->number,
                          .first = node->first,
                          .nindex = node->nindex,
                          .index = index};
    x->a = p->value[node->operand[0]];
    x->shape_a = pm_graph_node_at(g, node->operand[0])->shape;
    x->stride_a = node->op == PM_OP_SUM_TO ? stride_against(node->shape, x->shape_a)
                                           : stride_against(x->shape_a, node->shape);
    if (node->noperand >= 2) {
        x->b = p->value[node->operand[1]];
        x->shape_b = pm_graph_node_at(g, node->operand[1])->shape;
        x->stride_b = stride_against(x->shape_b, node->shape);
    }
    if (node->op == PM_OP_DOT) {
        // The columns are summed, so both operands advance along them.
        x->stride_a.col = x->stride_b.col = 1;
    }
    if (node->op >= PM_OP_ADD && node->op <= PM_OP_DIV) {
        // Where nothing is repeated, the kernel treats all numbers as one long row.
        x->first = same_shape(x->shape_a, node->shape) && same_shape(x->shape_b, node->shape);
    }
    return node->op == PM_OP_CONCAT ? resolve_parts(p, g, x) : PM_OK;
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

// Emits the nodes that depend on weights alone, or all others.
static pm_status emit_all(pm_program *p, const memory_plan *plan, bool fixed) {
    for (pm_node x = 0; x < plan->nnode; ++x) {
        const pm_graph_node *node = pm_graph_node_at(plan->g, x);
        p->needed[x] = plan->place[x].needed;
        if (p->needed[x] && plan->place[x].fixed == fixed && !is_leaf(node->op) &&
            !is_view(plan, node)) {
            PM_TRY(emit(p, plan->g, x));
        }
    }
    return PM_OK;
}

static pm_status build(pm_program *p, memory_plan *plan, int count, const pm_node *output) {
    const size_t nnode = (size_t)plan->nnode;
    plan->place = calloc(nnode, sizeof *plan->place);
    p->value = calloc(nnode, sizeof *p->value);
    p->needed = calloc(nnode, sizeof *p->needed);
    p->instruction = calloc(nnode, sizeof *p->instruction);
    if (plan->place == NULL || p->value == NULL || p->needed == NULL || p->instruction == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a program of %d nodes", plan->nnode);
    }
    find_needed(plan, count, output);
    if (!place_nodes(plan)) {
        return pm_fail(PM_ENOMEM, "out of memory for planning %d nodes", plan->nnode);
    }
    p->memory_size = plan->pool.end > 0 ? plan->pool.end : ALIGNMENT;
    p->memory = aligned_alloc(ALIGNMENT * sizeof(double), p->memory_size * sizeof(double));
    if (p->memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %zu numbers of a program", p->memory_size);
    }
    memset(p->memory, 0, p->memory_size * sizeof(double));
    resolve_values(p, plan);
    PM_TRY(emit_all(p, plan, true));
    p->nfixed = p->ninstruction;
    return emit_all(p, plan, false);
}

static pm_status open_program(pm_program **program, const pm_graph *graph, int count,
                              const pm_node *output, int capacity, bool lanes) {
    if (pm_graph_exhausted(graph)) {
        return pm_fail(PM_ENOMEM, "out of memory while building a graph");
    }
    pm_program *p = calloc(1, sizeof *p);
    if (p == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a program");
    }
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
    assert(lanes > 0 && lanes % PM_LANES == 0);
    pm_program *p = NULL;
    PM_TRY(open_program(&p, graph, count, output, lanes, true));
    for (int i = 0; i < p->ninstruction; ++i) {
        pm_instruction *x = &p->instruction[i];
        if (x->shape.batched) {
            x->run = pm_lane_kernel_of(x);
        }
        if (x->run == NULL || (x->shape_a.batched && !x->shape.batched)) {
            pm_program_close(p);
            p = NULL;
            break;
        }
    }
    *program = p;
    return PM_OK;
}

void pm_program_close(pm_program *program) {
    if (program != NULL) {
        pm_arena_free(&program->arena);
        free(program->memory);
        free(program->instruction);
        free(program->value);
        free(program->needed);
        free(program);
    }
}

double *pm_program_value(pm_program *program, pm_node x) {
    assert(x >= 0 && x < program->nnode && program->value[x] != NULL);
    return program->value[x];
}

bool pm_program_depends(const pm_program *program, pm_node input) {
    return program->needed[input];
}

static void run(const pm_program *program, int begin, int end, int batch) {
    for (int i = begin; i < end; ++i) {
        program->instruction[i].run(&program->instruction[i], batch);
    }
}

void pm_program_prepare(pm_program *program) {
    run(program, 0, program->nfixed, program->capacity);
}

void pm_program_run_prepared(pm_program *program, int batch) {
    assert(batch > 0 && batch <= program->capacity);
    run(program, program->nfixed, program->ninstruction, batch);
}

void pm_program_run(pm_program *program, int batch) {
    pm_program_prepare(program);
    pm_program_run_prepared(program, batch);
}

double pm_program_multiply_adds(const pm_program *program, int batch) {
    double sum = 0;
    for (int i = 0; i < program->ninstruction; ++i) {
        const pm_instruction *x = &program->instruction[i];
        const pm_shape a = x->shape_a;
        const bool product = x->node->op == PM_OP_MATMUL || x->node->op == PM_OP_MATMUL_SUM;
        if (product) {
            const bool rows = x->node->op == PM_OP_MATMUL_SUM || (x->first & 1) != 0;
            const bool batched = x->shape.batched || a.batched;
            sum += (double)x->shape.rows * x->shape.cols * (rows ? a.rows : a.cols) *
                   (batched ? batch : 1);
        }
    }
    return sum;
}

size_t pm_program_bytes(const pm_program *program) {
    return program->memory_size * sizeof(double);
}

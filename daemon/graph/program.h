// A program is the part of a graph that chosen outputs need, in a fixed order, with memory that is
// planned once. Running it allocates nothing.
#ifndef PM_GRAPH_PROGRAM_H
#define PM_GRAPH_PROGRAM_H

#include <stddef.h>

#include "graph/graph.h"

typedef struct pm_program pm_program;

// Plans a program for output [count] and up to `capacity` batch items. It keeps pointers to the
// values of parameters, but not to the graph, which may be closed. PM_ENOMEM. The caller closes it.
pm_status pm_program_open(pm_program **program, const pm_graph *graph, int count,
                          const pm_node *output, int capacity);
void pm_program_close(pm_program *program); // NULL is allowed

// Plans a program for `lanes` items (1 or a multiple of 8) that keeps the items innermost: the
// values of its batched nodes are [rows][cols][lanes]. A run treats all lanes at once, vectorised
// across items, and gives each item the bits that a program for one item gives it. *program is NULL
// if the graph has an operation that cannot run so: a sum over the batch, or a product for which
// BLAS is faster. PM_ENOMEM.
pm_status pm_program_open_lanes(pm_program **program, const pm_graph *graph, int count,
                                const pm_node *output, int lanes);

// Returns the numbers of an input or an output, [capacity][rows][cols] if batched, else
// [rows][cols]. The program owns them. Outputs keep the result of the last run until the next one.
// An input on which no output depends has memory too, so that callers need no special case.
double *pm_program_value(pm_program *program, pm_node x);

// Returns the numbers of an input, as above. NULL: the node is PM_NO_NODE, or no output depends on
// it, so that nothing needs to be written.
double *pm_program_input(pm_program *program, pm_node x);

// Computes the outputs for `batch` items, 0 < batch <= capacity. Sums over the batch sum these
// items.
void pm_program_run(pm_program *program, int batch);

// pm_program_prepare computes what depends on the weights alone. pm_program_run_prepared computes
// the rest, for callers whose weights have not changed since. Together they are pm_program_run.
void pm_program_prepare(pm_program *program);
void pm_program_run_prepared(pm_program *program, int batch);

// Returns about how many multiplications one item takes in a run.
double pm_program_work(const pm_program *program);

// Returns the bytes of planned memory.
size_t pm_program_bytes(const pm_program *program);

#endif

// A program: the part of a graph that chosen outputs need, in a fixed order, with its memory
// planned once. Running it allocates nothing.
#ifndef PM_GRAPH_PROGRAM_H
#define PM_GRAPH_PROGRAM_H

#include <stddef.h>

#include "graph/graph.h"

typedef struct pm_program pm_program;

// Plans `count` outputs for up to `capacity` batch items. Keeps no pointer to the graph, only to
// the parameters' values. PM_ENOMEM.
pm_status pm_program_open(pm_program **program, const pm_graph *graph, int count,
                          const pm_node *output, int capacity);
void pm_program_close(pm_program *program); // NULL is allowed

// The numbers of an input or an output, [capacity][rows][cols] if batched, else [rows][cols].
// The program owns them. Outputs hold the last run's result until the next run. An input that no
// output depends on has memory all the same, so that callers need no special case.
double *pm_program_value(pm_program *program, pm_node x);

// Whether any output depends on an input.
bool pm_program_depends(const pm_program *program, pm_node input);

// Computes the outputs for `batch` items, 0 < batch <= capacity. Sums over the batch cover these.
void pm_program_run(pm_program *program, int batch);

// For reports: operations per run, the work in them, and bytes of planned memory.
int pm_program_operations(const pm_program *program);
// Multiply-adds of the matrix products of one run.
double pm_program_multiply_adds(const pm_program *program, int batch);
size_t pm_program_bytes(const pm_program *program);

#endif

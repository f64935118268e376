// Writes graphs as functions in C99. They need nothing but libm and give the same bits as a program
// (program.h) that runs one item. A small operation becomes one expression for each number of its
// result, and a large operation becomes loops. Operations that only move numbers become no code at
// all.
#ifndef PM_GRAPH_SOURCE_H
#define PM_GRAPH_SOURCE_H

#include <stdio.h>

#include "graph/graph.h"

// An argument of the function: an input of the graph or a result.
typedef struct pm_source_argument {
    const char *name;
    pm_node node; // PM_NO_NODE: the argument is not used, or the result is zero
    int size;     // numbers
    int step;     // neighbouring numbers of an input or a result are so far apart; 0: one by one
} pm_source_argument;

// Writes the declarations that all functions need: elementary functions and products.
void pm_source_prelude(FILE *file);

// Writes a function without its return type and name: the parameter list, which begins with "(const
// double *restrict z, ...", and the body. The parameters are the `nin` input arrays, which the
// function reads, and then the `nout` output arrays, which it writes. The numbers of a node for
// which `known` [nodes] has an array are written as they are there; NULL: none are known.
// PM_ENOMEM. PM_ECONFIG: a product of matrices is so large that BLAS would compute it in an order
// of its own.
pm_status pm_source_write(FILE *file, const pm_graph *graph, const double *const *known, int nin,
                          const pm_source_argument *input, int nout,
                          const pm_source_argument *output);

// Writes a number so that a C compiler reads the same bits.
void pm_source_number(FILE *file, double number);

#endif

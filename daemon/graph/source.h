// Writes graphs as functions in C99 that need nothing but libm, and give the same bits as a program
// (program.h) that runs one item. Small operations become one expression for each number, and
// whatever only moves numbers becomes no code at all; large operations become loops.
#ifndef PM_GRAPH_SOURCE_H
#define PM_GRAPH_SOURCE_H

#include <stdio.h>

#include "graph/graph.h"

// An argument of the function: an input of the graph or a result.
typedef struct pm_source_argument {
    const char *name;
    pm_node node; // PM_NO_NODE: the argument is not used, or the result is zero
    int size;     // numbers
} pm_source_argument;

// Writes the declarations that all functions need: elementary functions and products.
void pm_source_prelude(FILE *file);

// Writes the parameter list and the body of a function of `nin` constant and `nout` written arrays:
// everything from "(const double *restrict z, ...". PM_ENOMEM. PM_ECONFIG: a product of matrices is
// so large that BLAS would compute it in an order of its own.
pm_status pm_source_write(FILE *file, const pm_graph *graph, int nin,
                          const pm_source_argument *input, int nout,
                          const pm_source_argument *output);

// Writes a number so that a C compiler reads the same bits.
void pm_source_number(FILE *file, double number);

#endif

// Shared by source.c and source_rules.c: the state of a function that is being written.
#ifndef PM_GRAPH_SOURCE_WRITER_H
#define PM_GRAPH_SOURCE_WRITER_H

#include "base/arena.h"
#include "graph/node.h"
#include "graph/source.h"

// The source of one number of a node: an entry of an array, or a literal.
typedef struct pm_source_value {
    pm_node node; // whose array holds it; PM_NO_NODE: it is the literal `value`
    int at;       // in that array
    double value;
} pm_source_value;

typedef struct pm_source_writer {
    FILE *file;
    const pm_graph *g;
    pm_arena arena;
    pm_source_value **number; // [nodes][rows * cols]; NULL: not needed
    const char **name;        // [nodes] of the array of a node that has one
    bool *read;               // [nodes] whether a statement reads that array
    int ncopy;                // arrays of copies written so far
    bool exhausted;
} pm_source_writer;

// Writes the statements that compute node x, or notes where its numbers are. The operands are done.
void pm_source_rule(pm_source_writer *w, pm_node x);

// Writes one number as an expression.
void pm_source_put(pm_source_writer *w, pm_source_value value);

#endif

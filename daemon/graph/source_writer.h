// The state of a function while its source is written. source.c and source_rules.c share it.
#ifndef PM_GRAPH_SOURCE_WRITER_H
#define PM_GRAPH_SOURCE_WRITER_H

#include "base/arena.h"
#include "graph/node.h"
#include "graph/source.h"

// The source of one number of a node: an entry of an array, or a literal.
typedef struct pm_source_value {
    pm_node node; // the node in whose array the number is; PM_NO_NODE: the number is `value`
    int at;       // the number's position in this array
    double value;
} pm_source_value;

typedef struct pm_source_writer {
    FILE *file;
    const pm_graph *g;
    pm_arena arena;
    pm_source_value **number; // [nodes][rows * cols]; NULL: the node is not needed
    const char **name;        // [nodes] name of the node's array in the source; NULL: it has none
    bool *read;               // [nodes] a statement reads the node's array
    int ncopy;                // constant arrays so far, which gather numbers from other arrays
    bool exhausted;
} pm_source_writer;

// Writes the statements that compute node x, or notes where its numbers are. This must have been
// done for the operands of x before.
void pm_source_rule(pm_source_writer *w, pm_node x);

// Writes one number as an expression.
void pm_source_put(pm_source_writer *w, pm_source_value value);

#endif

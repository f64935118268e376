// Compares new inputs of a program with its present ones, bit by bit, so that a graph is not run
// again if no input has changed.
#ifndef PM_SIM_PROGRAM_INPUT_H
#define PM_SIM_PROGRAM_INPUT_H

#include <stdbool.h>

#include "graph/program.h"

// Returns the memory of an input node, which the program owns. NULL: the node is PM_NO_NODE, or no
// output depends on it, so that nothing needs to be written.
double *pm_input_of(pm_program *program, pm_node x);

// Copies `from` [n] to `to` [n]. Returns true if this changed any bit of `to`. If either array is
// NULL, it copies nothing and returns false.
bool pm_renew(double *to, const double *from, int n);

#endif

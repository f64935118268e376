// Inputs of a program that remember their bits, so that a graph is not run again while none of its
// inputs has changed.
#ifndef PM_SIM_PROGRAM_INPUT_H
#define PM_SIM_PROGRAM_INPUT_H

#include <stdbool.h>

#include "graph/program.h"

// Returns where the node's input is written, owned by the program. NULL for PM_NO_NODE, or if no
// output depends on it: then nothing needs to be written.
double *pm_input_of(pm_program *program, pm_node x);

// Copies `from` [n] to `to` [n]. Returns true if any bit of `to` was different before. If either
// array is NULL, it copies nothing and returns false.
bool pm_renew(double *to, const double *from, int n);

#endif

// Compiles programs to machine code, where a C compiler is found. A compiled program has the bits
// of an interpreted one: its source is that of source.h, in which weights are numbers, so that the
// weights of a compiled program must not change.
//
// Compiled code is kept in the folder "portmet" of $XDG_CACHE_HOME, by default ~/.cache, under a
// digest of its source, the compiler and the processor. An entry is loaded only if folder and files
// belong to this user and nobody else may write to them, if the source that it keeps is the one
// that is wanted, and if the digest of the code is the one that was noted. Any other entry is
// compiled anew.
//
// Life cycle: open; add programs; link; close. The code stays loaded until the program ends.
#ifndef PM_GRAPH_COMPILE_H
#define PM_GRAPH_COMPILE_H

#include "graph/program.h"

typedef struct pm_compiler pm_compiler;

// PM_ENOMEM. The caller closes the compiler.
pm_status pm_compiler_open(pm_compiler **compiler);
void pm_compiler_close(pm_compiler *compiler); // NULL is allowed

// Adds a program of one item or of lanes, and the graph from which it was made, whose weights are
// final. The program must stay open until the compiler is linked. A program that is too large, or
// that needs BLAS, stays interpreted. Does nothing if one of them is NULL. PM_ENOMEM.
pm_status pm_compiler_add(pm_compiler *compiler, pm_program *program, const pm_graph *graph);

// Lets the programs that were added run as compiled code; of lanes those that it makes faster. To
// be called before the programs are run for their results. PM_EFILE: there is no compiler, it
// fails, or there is no folder in which code can be kept; all programs are then interpreted.
pm_status pm_compiler_link(pm_compiler *compiler);

#endif

// Scenes for measuring: many small subsystems, one number and an energy of it each, whose ports
// pass it on to the next. Euler, one exchange per step.
#ifndef TESTS_BENCH_LATTICE_H
#define TESTS_BENCH_LATTICE_H

#include "scene/system.h"

// PAIRS: the first with the second, the third with the fourth, ...
typedef enum lattice_shape { LATTICE_CHAIN, LATTICE_RING, LATTICE_PAIRS } lattice_shape;

typedef struct lattice {
    lattice_shape shape;
    int count; // subsystems, each with one number x; a ring of two has one port, as a chain
    int window;
    double dt; // s
    // Blocks of the models, over x and over a.x and b.x.
    const char *part, *port;
} lattice;

// Models that cost next to nothing.
extern const char lattice_trivial_part[], lattice_trivial_port[];

// The scene and its models, in memory only, with x = 1 and weights drawn at random. The caller
// frees both, the system first.
pm_status lattice_make(pm_scene **scene, pm_system **system, const lattice *l);

#endif

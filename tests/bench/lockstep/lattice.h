// Scenes for measuring the lock-step: many small subsystems, each with one variable and an energy,
// coupled to their neighbours by ports. The integrator is euler, with one exchange per step.
#ifndef TESTS_BENCH_LATTICE_H
#define TESTS_BENCH_LATTICE_H

#include "scene/system.h"

// The arrangement of the ports. PAIRS couples the first subsystem with the second, the third with
// the fourth, and so on.
typedef enum lattice_shape { LATTICE_CHAIN, LATTICE_RING, LATTICE_PAIRS } lattice_shape;

typedef struct lattice {
    lattice_shape shape;
    int count; // subsystems, each with one number x; a ring of two has one port, as a chain
    int window;
    double dt; // s
    // The `model:` blocks of a subsystem (variable x) and of a port (variables a.x and b.x).
    const char *part, *port;
} lattice;

// Models whose evaluation takes almost no time.
extern const char lattice_trivial_part[], lattice_trivial_port[];

// Makes the scene and its models in memory, with x = 1 and random weights. The caller frees both,
// the system first.
pm_status lattice_make(pm_scene **scene, pm_system **system, const lattice *l);

#endif

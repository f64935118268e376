// Scenes for measuring the exchange: many trivial subsystems, one number and a quadratic energy
// each, whose ports pass it on to the next. Euler, one exchange per step.
#ifndef TESTS_BENCH_LATTICE_H
#define TESTS_BENCH_LATTICE_H

#include "store/system.h"

typedef enum lattice_shape { LATTICE_CHAIN, LATTICE_RING } lattice_shape;

// A scene of `count` subsystems and its models, in memory only. A ring of two has one port, as a
// chain. The caller frees both, the system first.
pm_status lattice_make(pm_scene **scene, pm_system **system, lattice_shape shape, int count,
                       int window);

#endif

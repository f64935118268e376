// A small scene for tests: a chain of thermoelastic pendula with random hard models, in memory
// only.
#ifndef PM_TESTS_FIXTURE_H
#define PM_TESTS_FIXTURE_H

#include "scene/system.h"

// Storage the caller owns; zero-initialise.
typedef struct fixture {
    pm_scene *scene;
    pm_system *system; // digest made from the seed
    double *z;         // [scene->nz] where it starts; in the scene's arena
} fixture;

// `nlink` subsystems link1, link2 ... with groups q[2], p[2], s[1], and bracket ports joint1
// between link1 and link2 and so on. dt 0.02 s, rk4, 2 substeps, window 1. Weights and state follow
// from `seed`. Stops the test on failure.
void fixture_open(fixture *f, int nlink, uint64_t seed);
// Deals the links out to processes 1 to `nprocess` in turn, so that neighbours are apart where they
// can be.
void fixture_deal(fixture *f, int nprocess);
void fixture_close(fixture *f);

#endif

// A small scene for tests: a chain of thermoelastic pendula with random hard models, in memory
// only.
#ifndef PM_TESTS_FIXTURE_H
#define PM_TESTS_FIXTURE_H

#include "scene/system.h"

// The caller owns this storage and initialises it with zeros.
typedef struct fixture {
    pm_scene *scene;
    pm_system *system; // its digest follows from the seed
    double *z;         // [scene->nz] initial state; in the scene's arena
} fixture;

// Makes `nlink` subsystems link1, link2 ... with groups q[2], p[2], s[1], and bracket ports: joint1
// between link1 and link2, and so on. The scene has dt 0.02 s, rk4, 2 substeps, window 1. Weights
// and initial state follow from `seed`. A failure ends the test.
void fixture_open(fixture *f, int nlink, uint64_t seed);
// Distributes the links to `nprocess` processes in turn, so that neighbouring links are in
// different processes if there are at least two.
void fixture_deal(fixture *f, int nprocess);
void fixture_close(fixture *f);

#endif

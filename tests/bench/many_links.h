// Systems of many learned links for the benches. A chain joins each link to the next one. A grid is
// a square in which a link has up to four joints. A network is a random tree with as many further
// joints between random links. The weights are the shipped ones of the double pendulum.
#ifndef TESTS_BENCH_MANY_LINKS_H
#define TESTS_BENCH_MANY_LINKS_H

#include "scene/scene.h"

typedef struct many_links {
    const char *configs;    // the folder of scenes, whose weights serve
    const char *shape;      // "chain", "grid" or "network"
    const char *integrator; // of a step of 1 us
    int links;              // of a grid, the next smaller square, at least four
    long steps;
    bool compiled; // by the bench that opens the system
} many_links;

// Reads the scene of such a system. The table of a network is a file in TMPDIR, which is removed.
// PM_EUSAGE: there is no such shape. Otherwise fails as pm_scene_parse does.
pm_status many_links_scene(pm_scene **scene, const many_links *what);

// Returns states z [nz] in which no two links are alike, so that none rests; NULL: out of memory.
// The caller frees them.
double *many_links_states(const pm_scene *scene);

#endif

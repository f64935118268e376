// Random systems for property tests: two subsystems and a port, with models drawn from all that a
// model block can say, or with given ones; weights and states follow from a seed.
#ifndef PM_TESTS_WORLD_H
#define PM_TESTS_WORLD_H

#include "base/rng.h"
#include "scene/system.h"

#define WORLD_TEXT 4096

// Storage the caller owns.
typedef struct random_system {
    uint64_t seed;
    pm_rng rng;
    pm_scene *scene;
    pm_system *system;
    double *z;                   // [scene->nz] where it starts; in the scene's arena
    char scene_text[WORLD_TEXT]; // what it was made of, for messages
    char part_text[2][WORLD_TEXT];
    char port_text[WORLD_TEXT];
} random_system;

// A system drawn from `seed`: groups q[d] p[d] s[1] and perhaps r, entropies given, learned, both
// or (in one end) none, operators given and learned, with and without a frame; dt 0.001 s, rk4.
void random_system_random(random_system *w, uint64_t seed, pm_form form);

// The system of these texts. All parts get the model `part`; `port` may be NULL if the scene has
// none.
void random_system_of_text(random_system *w, uint64_t seed, const char *scene, const char *part,
                           const char *port);

void random_system_close(random_system *w);

// Fails the test with the random_system's seed and texts.
void random_system_fail(const random_system *w, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// Fails unless |value - expected| <= tolerance.
void random_system_check(const random_system *w, const char *what, double value, double expected,
                         double tolerance);

// Two pendulum links in the plane with invariant features and a frame, and the port between them:
// for tests that need a smooth system of which everything is learned.
extern const char random_system_scene[];
extern const char random_system_part[];
extern const char random_system_port[];

#endif

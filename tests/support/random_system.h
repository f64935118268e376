// Random systems for property tests: two subsystems and a port. The models are drawn at random from
// everything that a `model:` block allows, or given by the caller. Weights and states follow from a
// seed.
#ifndef PM_TESTS_RANDOM_SYSTEM_H
#define PM_TESTS_RANDOM_SYSTEM_H

#include "base/rng.h"
#include "scene/system.h"

#define RANDOM_SYSTEM_TEXT 4096

// The caller owns this storage.
typedef struct random_system {
    uint64_t seed;
    pm_rng rng;
    pm_scene *scene;
    pm_system *system;
    double *z;                           // [scene->nz] initial state; in the scene's arena
    char scene_text[RANDOM_SYSTEM_TEXT]; // texts of scene and models, for messages
    char part_text[2][RANDOM_SYSTEM_TEXT];
    char port_text[RANDOM_SYSTEM_TEXT];
} random_system;

// Draws a system from `seed`. It has groups q[d], p[d], s[1] and sometimes r; entropies that are
// given, learned, both, or at one end absent; operators that are given and learned, with and
// without a frame; dt 0.001 s, rk4.
void random_system_random(random_system *w, uint64_t seed, pm_form form);

// Makes the system of these texts. All subsystems get the model `part`; `port` may be NULL if the
// scene has no port. Learned numbers are drawn from a normal distribution, so that units should
// make all of them of order 1.
void random_system_of_text(random_system *w, uint64_t seed, const char *scene, const char *part,
                           const char *port);

void random_system_close(random_system *w);

// Fails the test with the random_system's seed and texts.
void random_system_fail(const random_system *w, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// Fails unless |value - expected| <= tolerance.
void random_system_check(const random_system *w, const char *what, double value, double expected,
                         double tolerance);

// Texts of two pendulum links in the plane and the port between them, with invariant features and a
// frame, for tests that need a smooth system in which everything is learned.
extern const char random_system_scene[];
extern const char random_system_part[];
extern const char random_system_port[];

#endif

// The loads of a scene over time. Numbers stay; dataset columns are followed along a trajectory,
// and between its states by polynomials: from one state to the next, the one through the eight
// nearest. For a sine of angular frequency w, states dt apart, that is off by 1.1e-3 (w dt)^8 of
// its amplitude, and by twelve times as much at the ends, where all eight lie on one side; as
// continuous as the integrators need, which never step across a state.
#ifndef PM_SCENE_BOUNDARY_INPUT_H
#define PM_SCENE_BOUNDARY_INPUT_H

#include <stdint.h>

#include "scene/scene.h"
#include "store/dataset.h"

// Coefficients of a polynomial.
#define PM_BOUNDARY_INPUT_ORDER 8

// Storage the caller owns; zero-initialise. Holds nothing if the scene has no loads.
typedef struct pm_boundary_input {
    int n;      // scene->nprescribed
    int stride; // steps of the scene from one state to the next
    long end;   // steps until the columns end; LONG_MAX: there are only numbers
    // [intervals][PM_BOUNDARY_INPUT_ORDER][n], by powers of the time since the interval's beginning
    // over its length.
    double *coefficient;
    const pm_scene *scene;
    int *column;   // [n] of the dataset; -1: a number
    double *value; // [n] work space
} pm_boundary_input;

// Finds the columns, and takes memory from the arena. `stride` is the dataset's dt over the
// scene's. If all are numbers, `dataset` may be NULL. PM_ECONFIG (no dataset), PM_EDATA (a column
// it does not have, one state alone), PM_ENOMEM.
pm_status pm_boundary_input_bind(pm_boundary_input *boundary_input, const pm_scene *scene,
                                 const pm_dataset *dataset, int stride, pm_arena *arena);

// Follows this trajectory from its first state on. `dataset` is the one bound, or one of its shape.
void pm_boundary_input_follow(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              int trajectory);

// The polynomials of one interval: [PM_BOUNDARY_INPUT_ORDER][n].
const double *pm_boundary_input_interval(const pm_boundary_input *boundary_input, long interval);

// value [n] within a step of the scene, at the fraction 0 to 1 of it. Beyond the end the last
// polynomials go on.
void pm_boundary_input_at(const pm_boundary_input *boundary_input, long step, double fraction,
                          double *value);

// The digest with what is prescribed folded in.
uint64_t pm_boundary_input_digest(const pm_boundary_input *boundary_input, uint64_t digest);

#endif

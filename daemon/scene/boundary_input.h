// The values of a scene's boundary inputs over time. Each value is a constant, a dataset column, or
// the time since the first state, which has the name "time" where no column has it, or a value of a
// live input, which holds for a whole step.
// A column is interpolated along a trajectory by the polynomial through the eight states nearest in
// time. For a sine of angular frequency w and states dt apart, the error is 1.1e-3 (w dt)^8 of its
// amplitude, and twelve times as much at both ends, where all eight states lie on one side. The
// interpolant is continuous but not smooth at the states, which suffices: integrators never step
// across a state.
//
// Life cycle: zero-initialise; bind to a scene and a dataset; follow a trajectory; then ask for
// values. All memory belongs to the arena given to bind.
#ifndef PM_SCENE_BOUNDARY_INPUT_H
#define PM_SCENE_BOUNDARY_INPUT_H

#include <stdint.h>

#include "scene/scene.h"
#include "store/dataset.h"

#define PM_BOUNDARY_INPUT_ORDER 8 // coefficients of a polynomial
// What stands in place of the position of a column.
#define PM_BOUNDARY_INPUT_CONSTANT (-1)
#define PM_BOUNDARY_INPUT_TIME (-2)

typedef struct pm_boundary_input {
    int n;      // values of all boundary inputs, scene->nprescribed; 0: the scene has none
    int stride; // steps of the scene from one state of the dataset to the next
    long end;   // steps until the trajectory ends; LONG_MAX: there are only constants
    // [intervals][PM_BOUNDARY_INPUT_ORDER][n] coefficients of the powers of x, which rises from 0
    // to 1 over an interval.
    double *coefficient;
    const pm_scene *scene; // borrowed
    int *column;           // [n] in the dataset, or one of the two above
    int *live_id;          // [n] among the values of all live inputs; -1: not live
    const double *live; // [scene->nlive] borrowed, the values that hold in the present step; NULL:
                        // a live value follows its column if the dataset has one, else it stays 0
    const double *held; // [n] borrowed; a number replaces the scene's value, NaN does not; NULL:
                        // no value is replaced
    double *value;      // [n] work space
} pm_boundary_input;

// Finds the columns in the dataset and takes memory from the arena. `stride` is the dt of the
// dataset divided by the dt of the scene. `dataset` may be NULL if all values are constants.
// PM_ECONFIG: a value is a column, but there is no dataset. PM_EDATA: the dataset lacks a column,
// or has one state only. PM_ENOMEM.
pm_status pm_boundary_input_bind(pm_boundary_input *boundary_input, const pm_scene *scene,
                                 const pm_dataset *dataset, int stride, pm_arena *arena);

// Computes the polynomials of a trajectory, from its first state on. `dataset` is the one given to
// bind, or another one of the same shape.
void pm_boundary_input_follow(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              int trajectory);

// Returns the polynomials [PM_BOUNDARY_INPUT_ORDER][n] of one interval. Interval i lies between the
// states i and i + 1 of the trajectory. Owned by the object.
const double *pm_boundary_input_interval(const pm_boundary_input *boundary_input, long interval);

// Returns true if the step that begins after `step` steps lies within the trajectory, or if `held`
// replaces every value that follows a column.
bool pm_boundary_input_covers(const pm_boundary_input *boundary_input, long step);

// Writes the values at step `step` of the scene plus a fraction (0 to 1) of a step to value [n], in
// the SI units of the groups. Beyond the end of the trajectory the last polynomial continues.
void pm_boundary_input_at(const pm_boundary_input *boundary_input, long step, double fraction,
                          double *value);

// Returns the digest with all prescribed values folded in.
uint64_t pm_boundary_input_digest(const pm_boundary_input *boundary_input, uint64_t digest);

#endif

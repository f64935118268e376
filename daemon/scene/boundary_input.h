// The values of a scene's boundary inputs over time. Each value is a constant, a dataset column, or
// the time since the first state, which has the name "time" where no column has it, or a value of a
// live input, which holds for a whole step.
// The scene's key `hold` says what a column is between its samples:
//   smooth    the polynomial through the eight samples nearest in time, or the nearest four where
//             times are uneven or samples are missing. For a sine of angular frequency w and
//             samples dt apart, the error is 1.1e-3 (w dt)^8 of its amplitude, and twelve times as
//             much at both ends, where all eight samples lie on one side.
//   previous  the last sample at or before the time, as a controller or a logger's output holds it
//   linear    the straight line from one sample to the next
// With a `delay` its samples act so much later. What is before the first of them is the first one,
// and what is behind the last of them the last one.
// A column is a polynomial over each step, and steps begin at samples: an integrator never crosses
// a jump, and keeps its order. Where the times of a dataset are uneven, or no multiples of the
// scene's dt, or a delay is no multiple of their distance, a run takes for `previous` the mean over
// each step, so that the impulse of a force, or the heat of a heater, is that of the jumps within
// the step.
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

// The samples of one value along the trajectory that is followed, without those that are missing.
typedef struct pm_boundary_samples {
    int count;
    double *at;    // [ntime] positions
    double *value; // [ntime]
} pm_boundary_samples;

typedef struct pm_boundary_input {
    int n;        // values of all boundary inputs, scene->nprescribed; 0: the scene has none
    int stride;   // steps of the scene in an interval
    bool by_step; // an interval is one step of the scene
    long end;     // steps until the trajectory ends; LONG_MAX: there are only constants
    // [intervals][PM_BOUNDARY_INPUT_ORDER][n] coefficients of the powers of x, which rises from 0
    // to 1 over an interval.
    double *coefficient;
    const pm_scene *scene; // borrowed
    int *column;           // [n] in the dataset, or one of the two above
    pm_hold *hold;         // [n] of the column
    double *delay;         // [n] s, of the column
    int *live_id;          // [n] among the values of all live inputs; -1: not live
    const double *live; // [scene->nlive] borrowed, the values that hold in the present step; NULL:
                        // a live value follows its column if the dataset has one, else it stays 0
    const double *held; // [n] borrowed; a number replaces the scene's value, NaN does not; NULL: no
                        // value is replaced
    double *value;      // [n] work space
    // A position in the trajectory counts samples if these are evenly spaced, `unit` seconds apart.
    // Otherwise it is the time after the first sample in s, and `unit` is 1.
    bool even;
    int length;                   // samples of the trajectory
    double unit, origin;          // s; the time of the first sample, s
    pm_boundary_samples *samples; // [n]
} pm_boundary_input;

// Returns how many steps of the scene lie between two samples of the dataset, or 0 where times are
// uneven or are no multiples of the scene's dt.
int pm_boundary_input_stride(const pm_scene *scene, const pm_dataset *dataset);

// Finds the columns in the dataset and takes memory from the arena. An interval lies between two
// samples and has `stride` steps of the scene, the dt of the dataset divided by the dt of the
// scene. With a stride of 0, for uneven times and a dt that is no multiple, an interval is a step
// of the scene. `dataset` may be NULL if all values are constants. PM_ECONFIG: a value is a column,
// but there is no dataset. PM_EDATA: the dataset lacks a column, or has one state only, or a column
// has no sample in some trajectory. PM_ENOMEM.
pm_status pm_boundary_input_bind(pm_boundary_input *boundary_input, const pm_scene *scene,
                                 const pm_dataset *dataset, int stride, pm_arena *arena);

// Computes the polynomials of a trajectory, from its first state on. `dataset` is the one given to
// bind, or another one of the same shape.
void pm_boundary_input_follow(pm_boundary_input *boundary_input, const pm_dataset *dataset,
                              int trajectory);

// Returns the polynomials [PM_BOUNDARY_INPUT_ORDER][n] of one interval. Interval i lies between the
// samples i and i + 1 of the trajectory. Owned by the object.
const double *pm_boundary_input_interval(const pm_boundary_input *boundary_input, long interval);

// Returns the position of a time, s, in the trajectory that is followed. A time that equals that of
// a sample up to rounding has its position exactly.
double pm_boundary_input_position(const pm_boundary_input *boundary_input, double time);
// Returns the first position after `from` and before `end` at which a value jumps, or `end`.
double pm_boundary_input_jump(const pm_boundary_input *boundary_input, double from, double end);
// Returns value `i` at a time, s, in the trajectory that is followed. At a jump it is the later
// one.
double pm_boundary_input_of(const pm_boundary_input *boundary_input, int i, double time);
// Writes the polynomials over the time between two positions to coefficient
// [PM_BOUNDARY_INPUT_ORDER][n]; x rises from 0 to 1. They hold what the columns are at `from` over
// the whole time, whatever jumps between. Beyond the first and the last sample, held values stay.
void pm_boundary_input_over(const pm_boundary_input *boundary_input, double from, double end,
                            double *coefficient);

// Returns the first boundary input of the scene with a value that follows a column which has ended
// before the step that begins after `step` steps, and that neither `live` nor `held` replaces; or
// NULL.
const pm_scene_boundary_input *pm_boundary_input_ending(const pm_boundary_input *boundary_input,
                                                        long step);
// Returns true if there is no such boundary input: a run can take the step.
bool pm_boundary_input_covers(const pm_boundary_input *boundary_input, long step);

// Writes the values at step `step` of the scene plus a fraction (0 to 1) of a step to value
// [n], in the SI units of the groups. Beyond the end of the trajectory the last polynomial
// continues.
void pm_boundary_input_at(const pm_boundary_input *boundary_input, long step, double fraction,
                          double *value);

// Returns the digest with all prescribed values folded in.
uint64_t pm_boundary_input_digest(const pm_boundary_input *boundary_input, uint64_t digest);

#endif

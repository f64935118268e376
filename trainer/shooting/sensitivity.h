// The states of a system at measured times, and their sensitivities: programs that compute the
// rates of a batch of states at once, and what is measured there. Derivatives with respect to the
// state at the start and to all weights are carried along from stage to stage of the integrator
// (forward sensitivities; Bock, 1987), so that their cost grows linearly with the number of steps.
// Of an implicit method the program computes a whole step.
#ifndef PM_TRAINER_SHOOTING_SENSITIVITY_H
#define PM_TRAINER_SHOOTING_SENSITIVITY_H

#include "data/track.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"

// How a system is integrated between measured times.
typedef struct pm_sensitivity_how {
    pm_system *system;                 // borrowed; its weights at the time of a call count
    const pm_observation *observation; // borrowed
    const pm_integrator *integrator;   // borrowed
    int substeps;                      // steps of the integrator in one dt of the scene
    bool stretched;                    // steps are not all dt long
    bool fixed;                        // derivatives with respect to the weights are not computed
} pm_sensitivity_how;

// The compiled programs with their memory. Each thread needs a pm_sensitivity of its own.
typedef struct pm_sensitivity pm_sensitivity;

// The time of a multiplication in a product of matrices, whose sums stay in registers, in that of
// one in a program.
#define PM_SENSITIVITY_DENSE 0.25
#define PM_SENSITIVITY_BATCH 16 // states at a time

// About how many multiplications one step and one sample take, with their derivatives if there are
// any.
typedef struct pm_sensitivity_work {
    double step, sample;
} pm_sensitivity_work;

// Opens the programs, with derivatives or without. The caller closes. PM_ENOMEM.
pm_status pm_sensitivity_open(pm_sensitivity **sensitivity, const pm_sensitivity_how *how,
                              bool derivatives, pm_sensitivity_work *work);
void pm_sensitivity_close(pm_sensitivity *sensitivity); // NULL is allowed

// A state that the integrator advances in time, with its derivatives. The caller owns the arrays.
typedef struct pm_sensitivity_item {
    double *z;          // [nz] the state
    double *by_start;   // [nz][nz] its derivative with respect to the state at the start
    double *by_weights; // [nz][nweight] its derivative with respect to the weights
    // The boundary inputs over the coming step [PM_BOUNDARY_INPUT_ORDER][nprescribed], and at the
    // present sample [nprescribed], or NULL.
    const double *input, *now;
    double duration; // of the coming step, in dt of the scene
} pm_sensitivity_item;

// Gives `count` items arrays in the arena, for nz components and nweight weights. The caller checks
// the arena.
void pm_sensitivity_allocate(int count, pm_sensitivity_item *item, size_t nz, size_t nweight,
                             pm_arena *arena);
// Makes the state of `item` a start: by_start becomes the identity and by_weights zero.
void pm_sensitivity_start(const pm_sensitivity *sensitivity, pm_sensitivity_item *item);
// Receives sample `sample` of window `id`: the state z [nz], the measured columns y [ny], and the
// derivatives of y. It may change by_start.
typedef void pm_sensitivity_visit(void *context, int id, int sample, const double *z,
                                  const double *y, double *by_start, const double *by_weights);
// Integrates window i of `count` <= PM_SENSITIVITY_BATCH windows from its start in item[i], at
// sample first[i] of track[i], to sample last[i]. First `values`, which has no derivatives,
// integrates all windows side by side. Then each step is linearised about its path, many steps at a
// time, and the Jacobians are multiplied in turn. If windows are few, this takes much less time
// than carrying the derivatives along. path[i] [steps of track[i]][nz] receives the states before
// the steps. Calls `visit` for the samples first[i] to last[i] - 1 of each window in turn.
void pm_sensitivity_along(pm_sensitivity *sensitivity, pm_sensitivity *values, int count,
                          pm_sensitivity_item *item, const pm_track *const *track, const int *first,
                          const int *last, double *const *path, pm_sensitivity_visit *visit,
                          void *context);
// Takes item i of items [count] from sample[i] of the track track[i] to the next sample; a sample
// of -1 stays where it is.
void pm_sensitivity_advance(pm_sensitivity *sensitivity, int count, pm_sensitivity_item *item,
                            const pm_track *const *track, const int *sample);
// Computes the measured columns y [count][ny] at the present states of the items. If there are
// derivatives, also writes the derivatives of y with respect to the start, by_start
// [count][ny][nz], and with respect to the weights, by_weights [count][ny][nweight].
void pm_sensitivity_measure(pm_sensitivity *sensitivity, int count,
                            pm_sensitivity_item *const *item, double *y, double *by_start,
                            double *by_weights);

#endif

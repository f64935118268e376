// Statistics of a dataset, computed before anything is learned: how large states and rates are, how
// fast rates change, which rates depend linearly on which variables, and whether angular momentum
// is conserved.
#ifndef PM_TRAINER_PROPOSE_LOOK_H
#define PM_TRAINER_PROPOSE_LOOK_H

#include "scene/columns.h"

// Statistics of one group of a subsystem.
typedef struct pm_look_group {
    const pm_group *group; // borrowed from the scene
    int first;             // position of its first component in the state of the scene
    double deviation;      // standard deviation, pooled over its components
    double rate;           // root mean square of its rate, in its unit per s, pooled likewise
    bool constant;         // it does not change
    bool positive;         // all components are positive in all states
    bool zero;             // in some state its length is small compared with the deviation
} pm_look_group;

typedef struct pm_look {
    pm_arena arena;
    const pm_scene *scene;     // borrowed
    const pm_dataset *dataset; // borrowed
    pm_columns columns;
    int count;        // the number of examined states
    double *z, *rate; // [count][nz]; rates of the dataset, or else central differences
    double fastest;   // 1/s: the largest ratio of the change of a rate per s to this rate
    int samples;      // the number of states in all trajectories
} pm_look;

// Examines at most some thousand states, evenly chosen. `scene` and `dataset` must outlive the
// result; the caller frees it. PM_EDATA: the trajectories are too short; otherwise fails as
// pm_columns_bind does.
pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *dataset);
void pm_look_free(pm_look *look);

// Computes the statistics of group number `group` of a subsystem.
pm_look_group pm_look_at(const pm_look *look, int subsystem, int group);

// Performs a linear regression of the rate of `target` on `count` groups of the same size. Each
// group has one coefficient for all its components, and each component has a constant term. Writes
// coefficient [count] and returns the fraction of the variance that stays unexplained, 0 to 1; 1 if
// the rate does not vary. At most PM_LOOK_SOURCES groups are used.
#define PM_LOOK_SOURCES 16
double pm_look_explain(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, double *coefficient);
// Does the same with the powers 1 to `degree` of each group, without returning coefficients. count
// * degree is at most PM_LOOK_SOURCES.
double pm_look_explain_powers(const pm_look *look, const pm_look_group *target, int count,
                              const pm_look_group *source, int degree);

// Returns true if the sum of q x p over the `count` pairs, in the coordinates of the columns, is
// constant along each trajectory. Then the dynamics do not depend on directions.
bool pm_look_keeps_rotation(const pm_look *look, int count, const pm_look_group *q,
                            const pm_look_group *p);

#endif

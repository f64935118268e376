// Statistics of a dataset, computed before anything is learned: how large states and rates are, how
// fast rates change, and which rates depend linearly on which variables.
#ifndef PM_TRAINER_PROPOSE_LOOK_H
#define PM_TRAINER_PROPOSE_LOOK_H

#include "propose/input_basis.h"
#include "scene/columns.h"

// Statistics of one group of a subsystem.
typedef struct pm_look_group {
    const pm_group *group; // borrowed from the scene
    int first;             // position of its first component in the state of the scene
    double deviation;      // standard deviation over states, pooled over components, in its unit
    double rate;           // root mean square of its rate over states and components, unit per s
    bool constant;         // the group does not change
    bool positive;         // all components are positive in all examined states
    double shortest;       // smallest length of the vector in the examined states, in its unit
} pm_look_group;

// The examined states of a dataset, from which all functions below compute their statistics.
typedef struct pm_look {
    pm_arena arena;            // owns the arrays
    const pm_scene *scene;     // borrowed
    const pm_dataset *dataset; // borrowed
    pm_columns columns;
    int count;         // the number of examined states
    double *z;         // [count][nz] states, in their units
    double *rate;      // [count][nz] rates, in these units per s: those of the dataset if it has
                       // rates, else central differences
    double fastest;    // 1/s: the largest rms(change of a rate per s)/rms(rate) of all components
    int samples;       // the number of states in all trajectories
    pm_inputs *inputs; // boundary inputs in the examined states, in the arena
} pm_look;

// Copies at most some thousand states, evenly chosen, with their rates. `scene` and `dataset` must
// outlive the result, which the caller frees after success. PM_EDATA: the trajectories are too
// short. PM_ENOMEM. Otherwise fails as pm_columns_bind does. After a failure nothing is left to
// free.
pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *dataset);
void pm_look_free(pm_look *look);

// Returns the subsystem to which a component of the state of the scene belongs.
int pm_look_subsystem(const pm_look *look, int component);

// Computes the statistics of group number `group` of a subsystem.
pm_look_group pm_look_at(const pm_look *look, int subsystem, int group);

// Performs a linear regression of the rate of `target` on source [count], groups of the same size
// as `target`. Each group has one coefficient for all its components, and each component has a
// constant term and terms that are linear in the boundary inputs of its subsystem, which count
// neither as explained nor as unexplained. Writes coefficient [count], in the unit of the rate
// divided by the unit of the group, and returns the fraction of the rate's variance, without what
// is linear in the inputs, that stays unexplained, 0 to 1. Returns 1
// and writes zeros if the rate does not vary or the regression is singular. Only the first
// PM_LOOK_SOURCES groups are used; no other coefficient is written.
#define PM_LOOK_SOURCES 16
double pm_look_explain(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, double *coefficient);
// Performs a linear regression of the rate of `target` on the powers 1 to `degree` of the
// components of source [count], groups of the same size as `target`. Each power of a group has one
// coefficient for all components. Constant terms, inputs and the returned fraction are those of
// pm_look_explain. Only the first
// PM_LOOK_SOURCES/degree groups are used.
double pm_look_explain_powers(const pm_look *look, const pm_look_group *target, int count,
                              const pm_look_group *source, int degree);

// Variables by their behaviour when time runs backwards: positions in the state of the scene of the
// components that keep their sign (even) and of those that change it (odd).
typedef struct pm_parity {
    int neven, nodd;
    int even[PM_LOOK_SOURCES], odd[PM_LOOK_SOURCES];
} pm_parity;

// Returns how much of the rate of component `target` needs a term that is odd in time: the fraction
// of what a polynomial of second degree, even in time, leaves unexplained that the component `odd`
// and its products with even variables explain. Heat that friction and conduction produce is even.
// The rate of an entropy that a current carries to another place is odd. Returns 0 if the even
// polynomial leaves almost nothing, and for scenes of more than PM_MAX_LOOK_STATES components.
#define PM_MAX_LOOK_STATES 256
double pm_look_odd_part(const pm_look *look, const pm_parity *parity, int target, int odd);

// Returns the number of independent processes that the rates of `count` groups show: the rank of
// the matrix of all their components in all examined states, each divided by its root mean square.
// It is smaller than the number of components if some linear combinations do not change, such as
// the amounts of chemical elements. Returns the number of components if memory runs out.
int pm_look_rank(const pm_look *look, int count, const pm_look_group *group);

// Returns 1 or -1 if `target`, of three components, keeps its length in the examined states and
// turns like a direction in a body with the angular momentum `spin`, of three components: 1 if its
// rate is target x w, as seen from the body, and -1 if it is w x target, as seen from outside, for
// an angular velocity w whose scalar product with `spin` is positive in the mean. Returns 0
// otherwise.
int pm_look_turns(const pm_look *look, const pm_look_group *target, const pm_look_group *spin);

#endif

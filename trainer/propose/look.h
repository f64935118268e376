// Statistics of a dataset, computed before anything is learned: how large states and rates are, how
// fast rates change, and which rates depend on which variables, by linear regressions.
//
// Boundary inputs. A port adds to the rates of a subsystem terms that are linear in the co-energies
// at its other end, with coefficients that nobody knows yet. Removing the parts of a rate and of
// its explaining variables that are linear in the inputs gives the same coefficients of the latter
// as a regression on both together (Frisch and Waugh, Econometrica 1, 1933).
#ifndef PM_TRAINER_PROPOSE_LOOK_H
#define PM_TRAINER_PROPOSE_LOOK_H

#include "scene/boundary_input.h"
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

// The functions of time by which boundary inputs act on one subsystem.
typedef struct pm_input_basis {
    int count;     // 0: no input that varies acts on the subsystem
    double *value; // [count][look.count] of mean zero and orthonormal over the examined states
} pm_input_basis;

// The examined states of a dataset, from which all functions below compute their statistics.
typedef struct pm_look {
    pm_arena arena;            // owns the arrays
    const pm_scene *scene;     // borrowed
    const pm_dataset *dataset; // borrowed
    pm_columns columns;
    int count;      // the number of examined states
    double *z;      // [count][nz] states, in their units
    double *rate;   // [count][nz] rates, in these units per s: those of the dataset if it has
                    // rates, else central differences
    double fastest; // 1/s: the largest rms(change of a rate per s)/rms(rate) of all components
    double decay;   // 1/s: the fastest decay that the data show, or 0
    int samples;    // the number of states in all trajectories
    double *input;  // [count][nprescribed] values of all boundary inputs
    double *work;   // [count][PM_MAX_TERMS + 1]
    pm_boundary_input *source; // of the inputs of a trajectory
    pm_input_basis *basis;     // [nsubsystem]
} pm_look;

// Copies at most some thousand states, evenly chosen, with their rates. `scene` and `dataset` must
// outlive the result, which the caller frees after success. PM_EDATA: the trajectories are too
// short. PM_ENOMEM. Otherwise fails as pm_columns_bind does. After a failure nothing is left to
// free.
//
// Stiff dynamics hide in their data: after a short time all states are close to a slow manifold,
// where rates change slowly. How strongly rates depend on the state still tells how fast a
// deviation from this manifold would decay, and so which time steps an explicit integrator needs.
// `decay` is the largest row sum of |d rate_c/d z_d| over components d that have the unit of c (a
// bound on eigenvalues, Gershgorin), for all components c whose rate falls with c itself. It is 0
// for scenes of many components.
pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *dataset);
void pm_look_free(pm_look *look);

// Finds the co-energies of `size` components, 2 or 3, that boundary inputs show to the subsystem of
// this component of the state of the scene. Writes the positions of their components among the
// values of all boundary inputs to input [most][3], and returns how many there are, at most `most`.
int pm_look_inputs(const pm_look *look, int component, int size, int most, int (*input)[3]);

// --- least squares ---

// Linear least squares with one result and few terms, by normal equations: sums over the equations
// x . solution = y. It begins with zeros and the number of terms.
#define PM_MAX_TERMS 160
typedef struct pm_least_squares {
    int n; // terms, at most PM_MAX_TERMS
    double matrix[PM_MAX_TERMS * PM_MAX_TERMS], right[PM_MAX_TERMS];
    double square; // of y
} pm_least_squares;

// Adds the equation x [n] . solution = y.
void pm_least_squares_add(pm_least_squares *s, const double *x, double y);
// Writes solution [n] and returns the unexplained fraction of the squares of y, 0 to 1. Returns 1
// and writes zeros if there are no terms, if all y are 0 or if the equations are singular. The sums
// cannot be used afterwards.
double pm_least_squares_solve(pm_least_squares *s, double *solution);

// --- regressions of rates ---

// Performs a linear regression of the rate of `target` on the powers 1 to `degree` of the
// components of source [count], groups of the same size as `target`. Each power of a group has one
// coefficient for all its components, and each component has a constant term and terms that are
// linear in the boundary inputs of its subsystem, which count neither as explained nor as
// unexplained. Returns the fraction of the rate's variance, without what is linear in the inputs,
// that stays unexplained, 0 to 1; it is 1 if the rate does not vary or the regression is singular.
// With degree 1 it writes coefficient [count], in the unit of the rate divided by the unit of the
// group; zeros if it returns 1. With a higher degree `coefficient` is NULL. Only the first
// PM_LOOK_SOURCES/degree groups are used; no other coefficient is written.
#define PM_LOOK_SOURCES 16
double pm_regress_rate(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, int degree, double *coefficient);

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

#endif

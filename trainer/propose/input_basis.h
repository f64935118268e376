// The values of boundary inputs in the examined states of a dataset, and what a regression of rates
// must know of them. A port adds to the rates of a subsystem terms that are linear in the
// co-energies at its other end, with coefficients that nobody knows yet. Removing the parts of a
// rate and of its explaining variables that are linear in the inputs gives the same coefficients of
// the latter as a regression on both together (Frisch and Waugh, Econometrica 1, 1933).
#ifndef PM_TRAINER_PROPOSE_INPUT_BASIS_H
#define PM_TRAINER_PROPOSE_INPUT_BASIS_H

#include "scene/boundary_input.h"

#define PM_MAX_INPUT_BASIS 32 // inputs of one subsystem that are linearly independent

// The functions of time by which boundary inputs act on one subsystem.
typedef struct pm_input_basis {
    int count; // 0: no input that varies acts on the subsystem
    int stride;
    const double *value; // [count][stride] of mean zero and orthonormal over the examined states
} pm_input_basis;

typedef struct pm_inputs {
    pm_boundary_input input;
    const pm_dataset *dataset; // borrowed
    int trajectory;            // the one that `input` follows; -1: none yet
    int count, capacity;       // examined states, and the most of them
    double *value;             // [capacity][n] values of all boundary inputs
    pm_input_basis *basis;     // [nsubsystem]
} pm_inputs;

// Takes memory for `capacity` examined states from the arena. `scene` and `dataset` must outlive
// the result. Fails as pm_boundary_input_bind does.
pm_status pm_inputs_bind(pm_inputs *inputs, const pm_scene *scene, const pm_dataset *dataset,
                         int capacity, pm_arena *arena);
// Writes the values of all boundary inputs in state j of trajectory i to value [nprescribed].
void pm_inputs_at(pm_inputs *inputs, int i, int j, double *value);
// Appends state j of trajectory i to the examined states.
void pm_inputs_add(pm_inputs *inputs, int i, int j);
// Computes the bases of all subsystems from the examined states. The arena gives the memory.
// PM_ENOMEM.
pm_status pm_inputs_find_bases(pm_inputs *inputs, pm_arena *arena);

// Finds the co-energies of `size` components, 2 or 3, that boundary inputs show to a subsystem.
// Writes the positions of their components among the values of all boundary inputs to component
// [most][3], and returns how many there are, at most `most`.
int pm_inputs_vectors(const pm_inputs *inputs, int subsystem, int size, int most,
                      int (*component)[3]);

// Adds what `n` variables have in common with each function of the basis in examined state k to
// along [PM_MAX_INPUT_BASIS][n]; after all states, `along` holds the scalar products.
void pm_input_basis_project(const pm_input_basis *basis, int k, int n, const double *variable,
                            double *along);
// Subtracts from `n` variables in examined state k the parts that are linear in the inputs, with
// the scalar products of pm_input_basis_project.
void pm_input_basis_remove(const pm_input_basis *basis, int k, int n, const double *along,
                           double *variable);

#endif

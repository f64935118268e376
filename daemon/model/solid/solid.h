// A body of learned material (material.h) on any mesh of bricks (brick.h), always in equilibrium
// with its load. It is a graph network: the nodes send their displacements to the elements, each
// element answers with forces, by one learned function that all elements share, and messages travel
// until all nodes are in balance.
//
// In a step of h s the inner variables go from A to A', and the displacements from u to u', where
// the forces of the elements balance the given ones, dE/du(u', A') = f. The step keeps both laws
// whatever the weights and however long it is, because the change of energy is split exactly:
//     E(u', A') - E(u, A) = work - heat
//     work = (E(u', A') - E(u, A') + E(u', A) - E(u, A))/2     what the moving nodes take in
//     heat = (E(u, A) - E(u, A') + E(u', A) - E(u', A'))/2     what the branches lose, >= 0
// Both are discrete gradients times differences (Itoh and Abe, J. Comput. Phys. 76, 1988): work is
// the mean of the elements' forces over the motion, times the motion. A precise balance of forces
// makes the motion right, and the laws do not depend on it.
#ifndef PM_MODEL_SOLID_SOLID_H
#define PM_MODEL_SOLID_SOLID_H

#include "base/arena.h"
#include "base/serializer.h"
#include "model/solid/brick.h"
#include "model/solid/material.h"

typedef struct pm_solid pm_solid;

// What a body is and does after a step.
typedef struct pm_solid_books {
    double stored;     // J
    double work, heat; // J, of the last step
    int iterations;    // of the balance of forces in the last step
    double error;      // of the displacements, relative, as the last iteration estimates it
} pm_solid_books;

// Makes an undeformed, relaxed body. Mesh and material are borrowed; the material may change
// between two calls, but keeps its number of branches. PM_ECONFIG: an element is turned inside out,
// or no node is free. PM_ENOMEM. The caller closes.
pm_status pm_solid_open(pm_solid **solid, const pm_solid_mesh *mesh,
                        const pm_solid_material *material);
void pm_solid_close(pm_solid *solid); // NULL is allowed

// Return the displacements [nnode][3] m, and the inner variables less their values at rest
// [nelement][PM_BRICK_POINTS][nbranch][PM_SYM]. The solid owns them. pm_solid_set_state copies
// both; NULL: at rest. It returns false if an element is turned inside out.
const double *pm_solid_displacement(const pm_solid *s);
const double *pm_solid_inner(const pm_solid *s);
int pm_solid_ninner(const pm_solid *s); // the number of inner variables
bool pm_solid_set_state(pm_solid *s, const double *u, const double *inner);
// Copies both as pm_solid_set_state does, but keeps the factor of the stiffness, which may belong
// to another state.
bool pm_solid_return(pm_solid *s, const double *u, const double *inner);
// Puts what the next step needs besides the state into the record: the state in which the stiffness
// was factorised. Restoring factorises it again.
void pm_solid_record(pm_solid *s, pm_serializer *serializer);

// Takes a step of h s to balance with the forces f [nnode][3], N. Forces on clamped nodes have no
// effect. A step in which no balance is found is taken in two halves, the first one to balance with
// the mean of f and of the elements' forces at its start. PM_ENUMERIC: no balance is found in very
// short steps either; the state is then one of those in between.
pm_status pm_solid_step(pm_solid *s, double h, const double *f);
// Lets the following steps start their iteration at the displacements `guess` [nnode][3], which is
// borrowed (NULL: where the last steps lead), and stop it when a move is shorter than `precise`
// times the largest displacement.
void pm_solid_aim(pm_solid *s, const double *guess, double precise);
// Moves the nodes to u [nnode][3] within h s, and relaxes the inner variables accordingly. Computes
// the elements' forces dE/du [nnode][3], N, unless `force` is NULL. Returns false, and changes
// nothing, if an element is turned inside out or an energy is not finite.
bool pm_solid_follow(pm_solid *s, double h, const double *u, double *force);

// Returns the books of the last step.
const pm_solid_books *pm_solid_books_of(const pm_solid *s);
// Computes the Cauchy stress [nnode][PM_SYM], Pa, mean over the elements of each node.
void pm_solid_stress(const pm_solid *s, double *sigma);

// Return the number of components that are free to move, and the component (3 node + axis) of each.
int pm_solid_nfree(const pm_solid *s);
const int *pm_solid_free(const pm_solid *s);
// Factorises the stiffness at the present state for steps of h s; where it is not positive
// definite, that without the part of the stress. Returns false if neither is positive definite.
// Then solve for `count` forces on the free components, x [count][nfree], which become
// displacements.
bool pm_solid_stiffen(pm_solid *s, double h);
void pm_solid_soften(const pm_solid *s, int count, double *x);

#endif

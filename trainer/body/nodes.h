// Converts the fields of a body on a box of bricks into trajectories of nodal values and back. The
// trajectories form a dataset from which networks on the body's mesh (model/mesh/mesh.h) learn.
// The nodes of the face with the lowest x are clamped and have no columns. The other n nodes are
// free. The dataset has these columns; those of a field are ordered by node as in pm_mesh, and
// within a node by component:
//   u[0:3n]      displacement, m
//   m<k>_[0:3n]  internal variable of the relaxation time tau_k of the material, m: it follows u
//                by dm/dt = (u - m)/tau_k and starts at zero. An euler step over dt with the rate
//                (u - m) (1 - exp(-dt/tau_k))/dt reproduces it exactly.
//   sigma[0:6n]  stress, Pa
//   f[0:3n]      prescribed force, N, at the end of the step that begins here: a body in
//                equilibrium responds at once, so its next state belongs to the next load
//   s            energy dissipated so far over the temperature, J/K; 0 if it is not known
// All values are rounded to single precision, which halves the files. The rounding error is far
// below the error of the networks.
#ifndef PM_TRAINER_BODY_NODES_H
#define PM_TRAINER_BODY_NODES_H

#include "model/mesh/mesh.h"
#include "store/dataset.h"
#include "store/field.h"

#define PM_NODES_MOST_BRANCHES 4

typedef struct pm_nodes_settings {
    int nbranch;
    double tau[PM_NODES_MOST_BRANCHES]; // s, > 0
    double temperature;                 // K, > 0
    int nstate;                         // states used, from the first of a trajectory on; 0: all
} pm_nodes_settings;

// Finds the mesh of the free nodes. node [mesh->nnode] receives, for each node of the mesh, its
// number among the nodes of the field. Memory from the arena. PM_EDATA (the nodes do not form a box
// of bricks with at least one brick along each axis, or are too many), PM_ENOMEM.
pm_status pm_nodes_mesh(const pm_field *field, pm_arena *arena, const pm_mesh **mesh,
                        const int **node);

// Converts the trajectories of the fields whose numbers are `trajectory` [count]. Fails as
// pm_nodes_mesh does. PM_EDATA also if the fields have no positions qx qy qz or no stresses. The
// caller frees the dataset.
pm_status pm_nodes_dataset(pm_dataset **dataset, const pm_field *field, int count,
                           const int *trajectory, const pm_nodes_settings *settings);

// Converts a dataset of pm_nodes_dataset back into fields. Trajectory i of the result has, at the
// free nodes, the positions and stresses of trajectory i of `nodes`, and as velocities the
// differences of the positions over the last step. Everything else (clamped nodes, first
// velocities, other variables, forces) is copied from trajectory trajectory[i] of `body`. The
// result has no energies. PM_EDATA (columns or shapes that do not fit), PM_ENOMEM. The caller frees
// the fields.
pm_status pm_nodes_fields(pm_field **field, const pm_dataset *nodes, const pm_field *body,
                          const int *trajectory);

#endif

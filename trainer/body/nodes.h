// Fields of a body on a box of bricks as trajectories of nodal values, a dataset that networks on
// its mesh (model/mesh/mesh.h) learn from; and back. Only nodes that are free count: those of the
// face x = lowest are held. Columns, each by node in the order of pm_mesh, components innermost:
//   u[0:3n]      displacement, m
//   m<k>_[0:3n]  for each relaxation time tau of the material: what a branch that follows u with
//                it remembers, dm/dt = (u - m)/tau and 0 at first, such that euler's step over dt
//                is exact with the rate (u - m) (1 - exp(-dt/tau))/dt
//   sigma[0:6n]  stress, Pa
//   f[0:3n]      the world's force, N, at the end of the step that begins here: a body in
//                equilibrium answers at once, and its next state is that under the next load
//   s            dissipated so far over the temperature, J/K; 0 if not known
// All are rounded to single precision, which is far below what is learned and halves the files.
#ifndef PM_TRAINER_BODY_NODES_H
#define PM_TRAINER_BODY_NODES_H

#include "model/mesh/mesh.h"
#include "store/dataset.h"
#include "store/field.h"

#define PM_NODES_MOST_BRANCHES 4

typedef struct pm_nodes_how {
    int nbranch;
    double tau[PM_NODES_MOST_BRANCHES]; // s
    double temperature;                 // K
    int nstate;                         // of each trajectory, from its first on; 0: all
} pm_nodes_how;

// The mesh, and for each of its nodes the body's: node [mesh->nnode]; memory from the arena.
// PM_EDATA: the nodes are no box of bricks, at least one along each axis, or too many; PM_ENOMEM.
pm_status pm_nodes_mesh(const pm_field *field, pm_arena *arena, const pm_mesh **mesh,
                        const int **node);

// Trajectories which[0 .. count) of the fields. PM_EDATA (also: no displacements qx qy qz, no
// stresses), PM_ENOMEM. The caller frees.
pm_status pm_nodes_dataset(pm_dataset **dataset, const pm_field *field, int count, const int *which,
                           const pm_nodes_how *how);

// Back: positions and stresses of the free nodes, and velocities by differences over the last step.
// All else is that of `body`, of its trajectory which[i] for nodes' trajectory i: what is held, the
// first velocities, other variables, forces; energies are not known. PM_EDATA: columns or shapes
// that do not fit; PM_ENOMEM. The caller frees.
pm_status pm_nodes_fields(pm_field **field, const pm_dataset *nodes, const pm_field *body,
                          const int *which);

#endif

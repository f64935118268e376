// Converts the fields of a body on any mesh into trajectories of nodal values, which are the data
// of a scene with a solid (scene/system.c), and back. The columns of the dataset, in the
// order of the field's nodes and within a node by component, are
//   u[0:3n]      displacement, m
//   sigma[0:6n]  Cauchy stress, Pa
//   f[0:3n]      force on the node, N
//   s            energy dissipated so far over the temperature, J/K; 0 if it is not known
// All values are rounded to single precision, which halves the files.
#ifndef PM_BODIES_SOLID_SOLID_NODES_H
#define PM_BODIES_SOLID_SOLID_NODES_H

#include "bodies/solid/solid_data.h"
#include "store/dataset.h"

// Converts the first `nstate` states of the trajectories data->trajectory; `temperature` is in K.
// PM_ENOMEM. The caller frees the dataset.
pm_status pm_solid_nodes_dataset(pm_dataset **dataset, const pm_solid_data *data, int nstate,
                                 double temperature);

// Returns true if a dataset has the columns of all nodes of a field. `body` is the name in front of
// the columns of a body in an assembly, as in lower_u0; NULL: there is none.
bool pm_solid_nodes_fit(const pm_dataset *nodes, const char *body, const pm_field *field);
// Converts a dataset for which pm_solid_nodes_fit is true back into fields. Trajectory i of the
// result has the positions and stresses of trajectory i of `nodes`, and as velocities the
// differences of the positions over the last step. Its forces are those of trajectory trajectory[i]
// of `body`. `name` is that of pm_solid_nodes_fit. PM_EDATA: the numbers of states differ.
// PM_ENOMEM. The caller frees the fields.
pm_status pm_solid_nodes_fields(pm_field **field, const pm_dataset *nodes, const char *name,
                                const pm_field *body, const int *trajectory);

#endif

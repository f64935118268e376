// Corrects the fields of a simulation by a few better known fields of the same body under the same
// loads. The discrepancy between both varies smoothly with the place of the load, even where the
// fields themselves do not.
//
// The place of a load is the mean position of its forces at the last time, weighted by their size.
// Consider two known loads whose places differ in x alone and whose total forces have the same
// history, and a simulated load between them, at the fraction w of the distance from the first to
// the second. Its correction is interpolated linearly; beyond the last known load the correction is
// constant:
//     z = simulated + (1 - w) (known_0 - simulated_0) + w (known_1 - simulated_1)
// (A simulation at two levels and their discrepancy: Kennedy, O'Hagan, Biometrika 87, 2000; the
// discrepancy is interpolated here instead of regressed.)
#ifndef PM_BODIES_SOLID_CORRECTION_H
#define PM_BODIES_SOLID_CORRECTION_H

#include "bodies/field/field.h"

// Corrects all trajectories of `simulated` by the trajectories of `known` whose numbers are
// `trajectory` [count]. The result has the nodes, elements and numbering of `known`, and the caller
// frees it. Each of the known loads must also be among the simulated ones. Each simulated load must
// lie on a line along x with a known load of the same size and direction. PM_EDATA: a load has no
// such partner or is zero at the last time, or the fields differ in nodes, variables or times.
// PM_ENOMEM.
pm_status pm_correct(pm_field **corrected, const pm_field *simulated, const pm_field *known,
                     int count, const int *trajectory);

#endif

// Stress close under a load, which the modes of a whole body do not show: what forces on the nodes
// of a section do to the stress of the sections around it. In a prismatic body (all sections alike,
// at equal distances along x) that is the same everywhere but at the ends, so it is learned from
// all sections together: stress of section k += sum over offsets of kernel[offset] forces of
// section k + offset (Saint-Venant: it fades within the section's size).
#ifndef PM_TRAINER_MODAL_LOCAL_H
#define PM_TRAINER_MODAL_LOCAL_H

#include <stddef.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_LOCAL_TENSOR 6
#define PM_LOCAL_MAX_REACH 20

typedef struct pm_local {
    int nsection, nper; // sections, nodes of each; nsection 0: there is nothing of the kind
    int reach;          // offsets -reach .. reach
    int *node;          // [nsection][nper], along x; the same place in every section
    int nloaded;        // places of a section that may carry a load
    int *loaded;        // [nloaded] places
    double *kernel;     // [pm_local_features][nper][6] Pa/N
} pm_local;

// Finds the sections of a body; memory from the arena. PM_EDATA: it is not prismatic. PM_ENOMEM.
pm_status pm_local_find_sections(pm_local *local, int nnode, const double *position,
                                 pm_arena *arena);
// Then which places carry loads, from `carries` [nnode], and room for the kernel, zero. PM_ENOMEM.
pm_status pm_local_set_loaded(pm_local *local, const int *carries, int reach, pm_arena *arena);

// Forces on the loaded places of the sections around one, as numbers.
int pm_local_features(const pm_local *local);
// From the forces on all nodes f [nnode][3], N; zero beyond the ends.
void pm_local_fill_features(const pm_local *local, const double *f, int section, double *feature);

// Adds to stress [nnode][6], Pa, what the forces f [nnode][3] do. Nothing if there are no sections.
// `work` has room for pm_local_work numbers.
size_t pm_local_work(const pm_local *local);
void pm_local_add(const pm_local *local, const double *f, double *stress, double *work);

#endif

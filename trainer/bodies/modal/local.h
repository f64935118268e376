// The stress that forces cause close to where they act. The modes of a whole body cannot represent
// it, and it fades within the size of a section (Saint-Venant's principle). In a prismatic body,
// whose sections are alike and equally spaced along x, the stress depends on the forces in the same
// way everywhere but at the ends. So it is a convolution along x, whose kernel is fitted to all
// sections at once:
//     stress of section k  +=  sum over offsets of  kernel[offset] . forces of section k + offset
#ifndef PM_BODIES_MODAL_LOCAL_H
#define PM_BODIES_MODAL_LOCAL_H

#include <stddef.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_LOCAL_TENSOR 6
#define PM_LOCAL_MAX_REACH 20

typedef struct pm_local {
    int nsection, nper; // number of sections, nodes in each section; nsection 0: no kernel
    int reach;          // offsets run from -reach to reach
    int *node;          // [nsection][nper], sections along x, the same places in every section
    int nloaded;        // places of a section that may carry a load
    int *loaded;        // [nloaded] places
    double *kernel;     // [pm_local_features][nper][6] Pa/N
} pm_local;

// Finds the sections of a body with nodes at position [nnode][3], m. Memory from the arena.
// PM_EDATA (the body is not prismatic), PM_ENOMEM.
pm_status pm_local_find_sections(pm_local *local, int nnode, const double *position,
                                 pm_arena *arena);
// Sets which places of a section may carry loads, and makes a kernel of zeros that spans `reach`
// sections on either side. A place may carry a load if carries [nnode] is not 0 for one of its
// nodes. It is called after pm_local_find_sections. PM_ENOMEM.
pm_status pm_local_set_loaded(pm_local *local, const int *carries, int reach, pm_arena *arena);

// Returns the number of features of a section: the force components at the loaded places of the
// sections around it.
int pm_local_features(const pm_local *local);
// Fills feature [pm_local_features] from the forces on all nodes f [nnode][3], N. Sections beyond
// the ends of the body count as free of forces.
void pm_local_fill_features(const pm_local *local, const double *f, int section, double *feature);

// Returns the size of the work space of pm_local_add, in numbers.
size_t pm_local_work(const pm_local *local);
// Adds the stress that the forces f [nnode][3], N, cause to stress [nnode][6], Pa. Without sections
// it adds nothing. `work` [pm_local_work] belongs to the caller.
void pm_local_add(const pm_local *local, const double *f, double *stress, double *work);

#endif

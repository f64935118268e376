// The roles of variables in the subsystems and ports of a scene, as far as units and the statistics
// of a dataset show them.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_VIEW_H
#define PM_TRAINER_PROPOSE_PROPOSE_VIEW_H

#include "propose/look.h"
#include "base/unit.h"

typedef enum pm_view_kind {
    PM_VIEW_OTHER,
    PM_VIEW_ENTROPY,  // unit J/K
    PM_VIEW_HEAT,     // unit J or K, in a subsystem without a variable in J/K
    PM_VIEW_POSITION, // of a conjugate pair, the variable whose rate the other one explains better
    PM_VIEW_MOMENTUM, // of a conjugate pair, the other variable
    PM_VIEW_SPIN      // an angular momentum of three components without a conjugate variable
} pm_view_kind;

// A subsystem, with one entry for each of its groups.
typedef struct pm_part_view {
    int subsystem, count, nentropy;
    pm_look_group group[PM_MAX_GROUPS];
    pm_unit unit[PM_MAX_GROUPS];
    pm_view_kind kind[PM_MAX_GROUPS];
    int mate[PM_MAX_GROUPS];        // the conjugate group, or -1
    double sign[PM_MAX_GROUPS];     // positions: dposition/dt = sign dE/dmomentum
    bool linear[PM_MAX_GROUPS];     // positions: the rate is linear in momenta, to rounding
    bool apart[PM_MAX_GROUPS];      // positions: the rate is a function of momenta alone
    bool gyroscopic[PM_MAX_GROUPS]; // momenta: one component moves another, as in a magnetic field
    bool geometric[PM_MAX_GROUPS];  // other variables alone move it, so that friction cannot act on
                                    // it
} pm_part_view;

// A lossless coupling of a group of end a with a group of end b.
typedef struct pm_pair_view {
    int a, b;            // groups of the subsystems at the two ends
    bool momentum_first; // the momentum a moves the position b; else the momentum b moves a
    double coefficient;  // 1 or -1; 0: to be learned
} pm_pair_view;

typedef struct pm_port_view {
    int count;
    pm_pair_view pair[PM_MAX_GROUPS * PM_MAX_GROUPS];
} pm_port_view;

// Fills view [scene->nsubsystem].
void pm_view_parts(const pm_look *look, pm_part_view *view);
// Fills the couplings of one port. A port with a boundary input has none.
void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view);

// Returns true if an end of the port exposes this group.
bool pm_view_exposes(const pm_scene *scene, int port, int end, const char *group);

// Returns true if the dynamics do not depend on directions: some conjugate pairs are vectors, and
// the sum of their q x p is conserved.
bool pm_view_rotates(const pm_look *look, const pm_part_view *parts);

#endif

// What a proposal makes of the parts and ports of a scene.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_VIEW_H
#define PM_TRAINER_PROPOSE_PROPOSE_VIEW_H

#include "propose/look.h"
#include "propose/unit.h"

typedef enum pm_view_kind {
    PM_VIEW_OTHER,
    PM_VIEW_ENTROPY, // J/K
    PM_VIEW_HEAT,    // J or K, in a part without an entropy
    PM_VIEW_POSITION,
    PM_VIEW_MOMENTUM, // of a conjugate pair; either may be called so
    PM_VIEW_SPIN      // three components of an angular momentum without a conjugate
} pm_view_kind;

// A part: one entry for each of its groups.
typedef struct pm_part_view {
    int subsystem, count, nentropy;
    pm_look_group group[PM_MAX_GROUPS];
    pm_unit unit[PM_MAX_GROUPS];
    pm_view_kind kind[PM_MAX_GROUPS];
    int mate[PM_MAX_GROUPS];       // the conjugate group, or -1
    double sign[PM_MAX_GROUPS];    // of a position's pair: position' = sign dE/dmomentum
    bool linear[PM_MAX_GROUPS];    // of a position: its rate is linear in momenta, to rounding
    bool apart[PM_MAX_GROUPS];     // of a position: its rate is a function of momenta alone
    bool geometric[PM_MAX_GROUPS]; // moves as others carry it: friction does not act on it
} pm_part_view;

// What one group of a port's end a does to one of end b without loss.
typedef struct pm_pair_view {
    int a, b; // groups of the ends' parts
    bool
        momentum_first; // a is the momentum, b the position that it carries along; else the reverse
    double coefficient; // 1 or -1; 0: to be learned
} pm_pair_view;

typedef struct pm_port_view {
    int count;
    pm_pair_view pair[PM_MAX_GROUPS * PM_MAX_GROUPS];
} pm_port_view;

// view: [scene->nsubsystem].
void pm_view_parts(const pm_look *look, pm_part_view *view);
void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view);

// Whether the group stands among those that an end of the port exposes.
bool pm_view_exposes(const pm_scene *scene, int port, int end, const char *group);

// Whether nothing depends on directions: some pairs are vectors, and the sum of q x p is conserved.
bool pm_view_rotates(const pm_look *look, const pm_part_view *parts);

#endif

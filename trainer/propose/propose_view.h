// The roles of variables in the subsystems and ports of a scene, as far as units and the statistics
// of a dataset show them. All functions take the scene and the dataset from `look`.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_VIEW_H
#define PM_TRAINER_PROPOSE_PROPOSE_VIEW_H

#include "base/unit.h"
#include "propose/look.h"
#include "propose/quaternion.h"
#include "propose/rotation.h"

typedef enum pm_view_kind {
    PM_VIEW_OTHER,
    PM_VIEW_ENTROPY,  // unit J/K
    PM_VIEW_HEAT,     // unit J or K, in a subsystem without a variable in J/K
    PM_VIEW_POSITION, // of a conjugate pair, the variable whose rate the other one explains better
    PM_VIEW_MOMENTUM, // of a conjugate pair, the other variable
    PM_VIEW_SPIN,     // an angular momentum of three components without a conjugate variable
    PM_VIEW_DIRECTION // three components of constant length, or a quaternion, which a spin turns
} pm_view_kind;

// The roles of the variables of one subsystem, with one entry for each of its groups.
typedef struct pm_part_view {
    int subsystem; // index in the scene
    int count;     // number of groups
    int nentropy;  // number of components in J/K
    pm_look_group group[PM_MAX_GROUPS];
    pm_unit unit[PM_MAX_GROUPS];
    pm_view_kind kind[PM_MAX_GROUPS];
    // Index of the conjugate group in this subsystem, for directions that of the spin; or -1.
    int mate[PM_MAX_GROUPS];
    // 1 or -1. Positions: dposition/dt = sign dE/dmomentum in SI units. Directions and spins: L(z)
    // e = sign z x e; -1 where the components are those seen from outside the body.
    double sign[PM_MAX_GROUPS];
    // Directions of four components: how the spin turns the quaternion.
    pm_quaternion quaternion[PM_MAX_GROUPS];
    // Positions: momenta explain the rate linearly, but for 0.1 % of its variance.
    bool linear[PM_MAX_GROUPS];
    // Positions: the rate is a function of momenta alone, but for 0.1 % of its variance.
    bool apart[PM_MAX_GROUPS];
    // Positions of two or three components: their energy is rather a polynomial of the length than
    // of its logarithm.
    bool by_length[PM_MAX_GROUPS];
    // Momenta: two components drive each other with opposite coefficients, as in a magnetic field.
    bool gyroscopic[PM_MAX_GROUPS];
    // Momenta: a variable without a role drives it and is driven by it with the opposite sign, as
    // the flux in the winding of a motor.
    bool gyrates[PM_MAX_GROUPS];
    // The sign changes when time runs backwards, as that of momenta and fluxes does: the unit has
    // an odd power of s and A together. Without loss such a variable moves those that keep their
    // sign.
    bool odd[PM_MAX_GROUPS];
    // Lengths, areas and volumes: the rate depends on other variables alone, so that friction does
    // not act on the group.
    bool geometric[PM_MAX_GROUPS];
} pm_part_view;

// A lossless coupling of a group of end a with a group of end b.
typedef struct pm_pair_view {
    int a, b;            // indices of the groups in the subsystems at the two ends
    bool momentum_first; // true: momentum a moves position b; false: momentum b moves position a,
                         // or the direction is to be learned
    double coefficient;  // 1 or -1, in SI units; 0: to be learned
    bool guessed;        // the coefficient is where its training starts
} pm_pair_view;

// The lossless couplings that a port may have.
typedef struct pm_port_view {
    int count; // number of couplings
    pm_pair_view pair[PM_MAX_GROUPS * PM_MAX_GROUPS];
} pm_port_view;

// Writes the roles of the variables of all subsystems to view [look->scene->nsubsystem], which the
// caller owns. The groups in it are borrowed from the scene.
void pm_view_parts(const pm_look *look, pm_part_view *view);
// Writes the couplings of port number `port` to *view, which the caller owns. `parts` is the result
// of pm_view_parts. A port with a boundary input has no couplings.
void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view);

// Whether group number `group` at end `end` of a port carries entropy between two places without
// loss, as an electric current does through a thermoelectric couple, or a flow of matter: its unit
// is odd, and the rate of an entropy that the port exposes has a part that is odd in time and
// follows the group. `parts` is the result of pm_view_parts.
bool pm_view_carries_entropy(const pm_look *look, const pm_part_view *parts, int port, int end,
                             int group);

// Returns true if a variable of this unit changes its sign when time runs backwards, or if the unit
// is not known.
bool pm_view_is_odd(const pm_unit *unit);

// Returns the factor by which a coefficient of a lossless pair in SI units becomes that of the
// units of both variables.
double pm_view_coefficient_unit(const pm_unit *a, const pm_unit *b);

// Returns true if end `end` (0: a, 1: b) of port number `port` exposes the group `group`.
bool pm_view_exposes(const pm_scene *scene, int port, int end, const char *group);

// Returns how the sum of the angular momenta q x p of all conjugate pairs that are vectors behaves
// in the dataset. `parts` is the result of pm_view_parts.
pm_rotation pm_view_rotation(const pm_look *look, const pm_part_view *parts);

#endif

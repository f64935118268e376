// The roles of variables in the subsystems and ports of a scene, as far as units and the statistics
// of a dataset show them. All functions take the scene and the dataset from `look`.
#ifndef PM_TRAINER_PROPOSE_VIEW_H
#define PM_TRAINER_PROPOSE_VIEW_H

#include <string.h>

#include "base/unit.h"
#include "propose/look.h"

typedef enum pm_view_kind {
    PM_VIEW_OTHER,
    PM_VIEW_ENTROPY,  // by its role (model/spec.h)
    PM_VIEW_HEAT,     // unit J or K, in a subsystem without an entropy
    PM_VIEW_POSITION, // of a conjugate pair, the variable whose rate the other one explains better
    PM_VIEW_MOMENTUM, // of a conjugate pair, the other variable
    PM_VIEW_SPIN,     // an angular momentum of three components without a conjugate variable
    PM_VIEW_DIRECTION // three components of constant length, or a quaternion, which a spin turns
} pm_view_kind;

// Unit quaternions: the attitude of a body with an angular momentum of three components. With the
// angular velocity w, the rate of a quaternion q is q w/2 if w is seen from the body, and w q/2 if
// it is seen from outside (J. B. Kuipers, Quaternions and Rotation Sequences, 1999).
typedef struct pm_quaternion {
    int turns;        // 1: w is seen from the body; -1: from outside; 0: no quaternion
    bool scalar_last; // the scalar part is the last component, else the first
} pm_quaternion;

// Returns the term of q or w that one component of the angular velocity contributes to the rate of
// one component of the quaternion: rate_row = sum over axes of sign q_column w_axis/2. `row` and
// the result *column are positions in the group, `axis` is 0 to 2. Returns the sign, 1 or -1.
int pm_quaternion_term(pm_quaternion order, int row, int axis, int *column);

// The roles of the variables of one subsystem, with one entry for each of its groups.
typedef struct pm_part_view {
    int subsystem; // index in the scene
    int count;     // number of groups
    int nentropy;  // number of components of entropies
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
    // Positions: the rate is linear in momenta, but for 0.1 % of its variance.
    bool linear[PM_MAX_GROUPS];
    // Positions: the rate is a function of momenta alone, but for 0.1 % of its variance.
    bool apart[PM_MAX_GROUPS];
    // Positions: other momenta of the same subsystem than their own move them, too.
    bool shared[PM_MAX_GROUPS];
    // Positions of two or three components: their energy is rather a polynomial of the length than
    // of its logarithm.
    bool by_length[PM_MAX_GROUPS];
    // The sign changes when time runs backwards, as that of momenta and flux linkages does: the
    // exponents of s and A in its unit add up to an odd number. Without loss such a variable moves
    // those that keep their sign.
    bool odd[PM_MAX_GROUPS];
    bool angle[PM_MAX_GROUPS]; // the unit is one of angles
    // Lengths and angles: the rate depends on other variables alone, so that friction does not act
    // on the group.
    bool geometric[PM_MAX_GROUPS];
} pm_part_view;

// Returns the number of the group of this name in a subsystem that has it.
static inline int pm_part_view_find(const pm_part_view *view, const char *name) {
    int g = 0;
    while (g + 1 < view->count && strcmp(view->group[g].group->name, name) != 0) {
        ++g;
    }
    return g;
}

// Returns true if other groups than its conjugate one may move this group without loss. It must
// change in the data. Excluded are entropies, positions whose rates depend on momenta alone,
// angular momenta of three components, and directions that turn with one of these.
bool pm_view_may_couple(const pm_part_view *view, int group);

// How the angular momentum behaves, the sum of q x p over conjugate pairs of vectors and of what
// scalars without a role add to it, as the data show.
typedef enum pm_rotation {
    PM_ROTATION_NONE,      // forces that depend on directions change it, or there are no pairs
    PM_ROTATION_CONSERVED, // it is constant along each trajectory
    PM_ROTATION_BALANCED   // friction and boundary inputs alone change it
} pm_rotation;

// Writes the roles of the variables of all subsystems to view [look->scene->nsubsystem], which the
// caller owns. The groups in it are borrowed from the scene. Returns how the angular momentum
// behaves along each trajectory, in the coordinates of the dataset's columns: if friction and
// boundary inputs explain all its changes, the dynamics do not depend on directions.
// PM_ROTATION_NONE also if all products q x p vanish, and if memory runs out.
pm_rotation pm_view_parts(const pm_look *look, pm_part_view *view);

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
    // [end][group] The group carries entropy between the ends without loss, as an electric current
    // does through a thermoelectric couple, or a flow of matter: its unit is odd, and the rate of
    // an entropy that the port exposes has a part that is odd in time and follows the group.
    bool current[2][PM_MAX_GROUPS];
    bool carries; // any current
} pm_port_view;

// Writes the couplings of port number `port` to *view, which the caller owns. `parts` is the result
// of pm_view_parts. A port with a boundary input has no couplings.
void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view);

// Returns true if a variable of this unit changes its sign when time runs backwards, or if the unit
// is not known.
static inline bool pm_view_is_odd(const pm_unit *unit) {
    return !unit->known || (unit->power[PM_UNIT_S] + unit->power[PM_UNIT_A]) % 2 != 0;
}

#endif

// The broad phase of contact: a box around a state in which no pair of points touches
// (model/contact_bound.h). The subsystem's energy, entropy and exposed variables have the same bits
// everywhere in the box. While the state stays in the box, comparing nz numbers replaces the
// evaluation of all pairs. The box is long in each direction in which the state moves fast.
//
// Life cycle: zero-initialise; open; enclose a state; call _holds for later states; close.
#ifndef PM_SIM_CONTACT_BROADPHASE_H
#define PM_SIM_CONTACT_BROADPHASE_H

#include "base/arena.h"
#include "graph/program.h"
#include "model/part.h"

typedef struct pm_contact_broadphase {
    int nz, n; // number of components of the state; number of pairs of points that can touch
    const pm_layout *layout;
    bool *unconstrained; // [nz] components that may move in the box; NULL: the part has no contact
    double *width;       // [nz] half the length of the box, in units of z
    bool enclosed;       // there is a box
    double duration;     // s, time until the state was expected to leave the last box
    pm_program *program; // computes `value` and `spread` from `program_z` and `program_width`
    double *program_z, *program_width; // [nz] inputs
    const double *value, *spread; // [n] openings of the pairs, and their largest change in the box
} pm_contact_broadphase;

// Builds the graph of the openings of all pairs of points of a part, which is borrowed. Memory
// comes from the arena; the caller closes. PM_ENOMEM.
pm_status pm_contact_broadphase_open(pm_contact_broadphase *b, pm_arena *arena,
                                     const pm_part *part);
void pm_contact_broadphase_close(pm_contact_broadphase *b);

// Removes the box and forgets its duration.
void pm_contact_broadphase_forget(pm_contact_broadphase *b);
// Looks for a large box around z [nz]. There is none if a pair touches or nearly does. If the
// derivative dE [nz] of the energy (NULL: zero) is not zero in an unconstrained component, a pair
// touches, and the function ends without evaluating the bound. `rate` [nz] is an estimate of dz/dt;
// NULL: not known.
void pm_contact_broadphase_enclose(pm_contact_broadphase *b, const double *z, const double *dE,
                                   const double *rate);

// Returns true if there is a box around `centre` [nz] that contains z [nz]: all unconstrained
// components differ by at most `width`, and all others are bitwise equal.
bool pm_contact_broadphase_holds(const pm_contact_broadphase *b, const double *centre,
                                 const double *z);

#endif

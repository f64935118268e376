// The broad phase of contact: a box around a state in which no pair of points closes
// (model/contact_bound.h), so that the subsystem's energy and entropy, and with them all that it
// exposes, are the same everywhere in the box, to the bit. While the state stays in the box, a
// comparison of nz numbers replaces the evaluation of all pairs. The box is long in each direction
// in which the state moves fast.
//
// Life cycle: zero-initialise; open; enclose a state; ask holds for later ones; close.
#ifndef PM_SIM_CONTACT_BROADPHASE_H
#define PM_SIM_CONTACT_BROADPHASE_H

#include "base/arena.h"
#include "graph/program.h"
#include "model/part.h"

typedef struct pm_contact_broadphase {
    int nz, n; // components of the state; pairs that can close
    const pm_layout *layout;
    bool *unconstrained; // [nz] components that may move in the box; NULL: the part has no contact
    double *width;       // [nz] half the length of the box, in units of z
    bool enclosed;       // there is a box
    double duration;     // s, for which the last box was expected to last
    pm_program *program; // z, width -> value, spread
    double *program_z, *program_width; // [nz] inputs
    const double *value, *spread;      // [n] openings, and by how much they can change in the box
} pm_contact_broadphase;

// Builds the graph of the openings for a part, which is borrowed. Memory comes from the arena; the
// caller closes. PM_ENOMEM.
pm_status pm_contact_broadphase_open(pm_contact_broadphase *b, pm_arena *arena,
                                     const pm_part *part);
void pm_contact_broadphase_close(pm_contact_broadphase *b);

// Removes the box and the memory of its duration.
void pm_contact_broadphase_forget(pm_contact_broadphase *b);
// Looks for a large box around z [nz]. There is none where a pair is closed or nearly so; a dE [nz]
// other than zero (NULL: zero) tells most of these cases without an evaluation. `rate` [nz] tells
// about how z moves; NULL: not known.
void pm_contact_broadphase_enclose(pm_contact_broadphase *b, const double *z, const double *dE,
                                   const double *rate);

// Tells whether there is a box around `centre` [nz] that holds z [nz]: all unconstrained components
// within `width`, all others equal to the bit.
bool pm_contact_broadphase_holds(const pm_contact_broadphase *b, const double *centre,
                                 const double *z);

#endif

// The bounding test of contact: a box around a state in which nothing closes
// (model/contact_bound.h), so that what a part exposes is the same everywhere in it, to the bit.
// While the state stays in the box, a comparison of a few numbers takes the place of all facing
// points. A box is as long in each direction as the state moves fast.
#ifndef PM_SIM_CONTACT_BROADPHASE_H
#define PM_SIM_CONTACT_BROADPHASE_H

#include "base/arena.h"
#include "graph/program.h"
#include "model/part.h"

typedef struct pm_contact_broadphase {
    int nz, n;
    const pm_layout *layout;
    bool *unconstrained; // [nz]: may move; NULL: the part has no clearance
    double *width;       // [nz] of the box, to either side
    bool enclosed;       // there is a box
    double duration;     // s, of the last box
    pm_program *program; // z and the box's width -> value, spread
    double *program_z, *program_width;
    const double *value, *spread; // [n]
} pm_contact_broadphase;

// Memory from the arena. PM_ENOMEM. Zero-initialise before.
pm_status pm_contact_broadphase_open(pm_contact_broadphase *b, pm_arena *arena,
                                     const pm_part *part);
void pm_contact_broadphase_close(pm_contact_broadphase *b);

// No box, and nothing remembered.
void pm_contact_broadphase_forget(pm_contact_broadphase *b);
// Finds a large box around z [nz], or none where something is closed or nearly so, which dE [nz]
// there (NULL: zero) mostly tells. `rate` [nz]: about how z moves; NULL: not known.
void pm_contact_broadphase_enclose(pm_contact_broadphase *b, const double *z, const double *dE,
                                   const double *rate);

// Whether there is a box around `centre` [nz] and z [nz] is in it, with what is not unconstrained
// as it is there, to the bit.
bool pm_contact_broadphase_holds(const pm_contact_broadphase *b, const double *centre,
                                 const double *z);

#endif

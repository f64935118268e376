// The subsystem between two bodies of an assembly, as a part that a scene can serve. The state has
// four groups, in this order. The first two have the names of the bodies; A and B stand for these.
//   A, B   [nstate] each, J^0.5: the amplitudes by which each body acts on the contact. They are
//          the time integrals of the rates of the amplitudes of the body. Ports of the law
//          `contact` join them to the momenta p of the bodies.
//   creep  [npair] m: the opening that each contact pair has gained by creeping
//   s      J/K: the entropy that creeping has produced
// Five derived variables [npair] are linear in A and B (bodies/solid/contact_pairs.h): the gap g
// (m), the distances u and v (m) by which the pair has slid along the two tangents, and the slopes
// slope_u and slope_v of the surface along them. A pair has the opening x = g + creep + u slope_u +
// v slope_v. It stores the energy
//     k/2 min(x, 0)^2
// and therefore exerts the force -k min(x, 0). Its opening creeps at a rate proportional to that
// force, with the factor `creep` of pm_contact_constants in m/(N s). The stiffness k is a physical
// quantity, not a numerical penalty: it is the stiffness of the edges of the bodies, whose local
// deformation the modes cannot represent.
#ifndef PM_BODIES_MODAL_CONTACT_PART_H
#define PM_BODIES_MODAL_CONTACT_PART_H

#include "bodies/modal/body_assembly.h"
#include "model/part.h"

typedef struct pm_contact_constants {
    double stiffness;   // k, N/m, of each contact pair
    double creep;       // m/(N s), rate of creeping; 0: the pairs do not creep
    double temperature; // K, at which what creeping dissipates becomes entropy
} pm_contact_constants;

// Makes the part of an interface. Its spec lies in the arena; the caller frees the part with
// pm_part_free, also on failure. PM_ECONFIG (the name of a body is also that of another group),
// PM_ENOMEM.
pm_status pm_contact_part_make(const pm_body_assembly *assembly,
                               const pm_contact_interface *interface,
                               const pm_contact_constants *constants, pm_arena *arena,
                               pm_part *part);

// Returns the path of the weights of an interface, folder/A_B.h5, in the arena; NULL: out of
// memory.
const char *pm_contact_part_path(const pm_body_assembly *assembly,
                                 const pm_contact_interface *interface, const char *folder,
                                 pm_arena *arena);

// Reads the stiffness k, N/m, from the weights of an interface in a folder. PM_EWEIGHTS (the file
// is missing or bad, or holds another part than pm_contact_part_make makes of this interface),
// PM_EDATA (it belongs to another basis), PM_ENOMEM.
pm_status pm_contact_part_stiffness(const pm_body_assembly *assembly,
                                    const pm_contact_interface *interface, const char *folder,
                                    double *stiffness);

#endif

// The subsystem between two bodies A and B of an assembly, as a part that a scene can serve. Its
// state is, in this order,
//   A, B   [nstate] each, J^0.5: the travel of both bodies, the integral of the rates of their
//          amplitudes. Ports of the law `contact` join them to the momenta p of the bodies.
//   creep  [npair] m: the opening that each contact pair has gained by creeping
//   s      J/K: the entropy that creeping has produced
// The five quantities g, u, v, slope_u, slope_v of contact_pairs.h are derived variables, linear in
// the travel. A pair with the opening x = g + creep + u slope_u + v slope_v stores the energy
//     k/2 min(x, 0)^2
// and creeps under the force -k min(x, 0) at the rate creep_rate times that force. The stiffness k
// is not a penalty: it is that of the bodies' edges, which their modes cannot represent.
#ifndef PM_TRAINER_MODAL_CONTACT_PART_H
#define PM_TRAINER_MODAL_CONTACT_PART_H

#include "modal/body_assembly.h"
#include "model/part.h"

typedef struct pm_contact_constants {
    double stiffness; // k, N/m, of each contact pair
    double creep;     // m/(N s), rate of creeping; 0: the pairs do not creep
} pm_contact_constants;

// Makes the part of an interface. Its spec lies in the arena; the caller frees the part with
// pm_part_free, also on failure. PM_ECONFIG (the name of a body is also that of another group),
// PM_ENOMEM.
pm_status pm_contact_part_make(const pm_body_assembly *assembly,
                               const pm_contact_interface *interface,
                               const pm_contact_constants *constants, pm_arena *arena,
                               pm_part *part);

// The path of the weights of an interface, folder/A_B.h5, in the arena; NULL: out of memory.
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

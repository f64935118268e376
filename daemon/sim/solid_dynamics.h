// The steps of a subsystem that is a solid (model/solid/solid.h): a body without inertia, always in
// balance with the forces of its ports. Its state has momenta p, which are zero, so that the laws
// of ports act on it as on any body: their rates of p are forces, and its co-energy is the
// velocity.
//
// A step of h s goes from u to u', where the forces of the elements balance those that act at its
// end. The ports do the work f.(u' - u) with f, the mean force over the step; both ends of a port
// book it. The stored energy E has changed by E' - E, and the difference becomes heat:
//     T (s' - s) = f.(u' - u) - (E' - E)
// so that energy is conserved whatever u' is. The heat is that of the relaxing branches and the
// error of the trapezoidal rule, which is of third order in h. Where it would be negative, as it
// may be in a body without branches, the body moves less far; if it does not move, only the
// branches lose energy, so that a move with a heat of at least zero always exists.
//
// If a mesh names nodes of contact, the group `contact` has the momenta of these nodes again, so
// that ports of the law `contact` expose them alone. Forces of contact (contact_gap.h) depend on
// where the body moves, so that a step solves the balance several times. Each time the iteration
// starts from the last solution. While the forces at the end of the substep keep their bits, a body
// does not move; it only books the work of the mean forces.
#ifndef PM_SIM_SOLID_DYNAMICS_H
#define PM_SIM_SOLID_DYNAMICS_H

#include "base/serializer.h"
#include "model/part.h"
#include "model/solid/solid.h"

typedef struct pm_solid_dynamics {
    pm_solid *solid;
    pm_solid_material material;
    pm_layout layout;
    int nnode;
    // First component of each group; -1: the state has no such group.
    int u, p, inner, sigma, s, contact;
    int ncontact;
    const int *contact_node; // [ncontact]
    double temperature;      // K
    double E, S;             // at the last exposed state
    double *dE, *dS;         // [nz]
    double *mean, *end;      // [nnode][3] N, of the ports, with which `result` was computed
    double *work;            // [nnode][3]
    double stored;           // J, at the start of the substep
    double *end_rate;        // [nz] rates of the ports at the end of the substep, for the caller
    double *result;          // [nz] the state at the end of the substep
    bool solved;             // `result` belongs to this substep
    bool changed;            // the last balance has written `result`
    pm_status status;        // of the last balance
} pm_solid_dynamics;

// Opens the dynamics of a solid whose layout fits the mesh (scene/system.c). Memory comes
// from the arena; part and mesh are borrowed; the caller closes. PM_ECONFIG: an element is turned
// inside out, or no node is free. PM_ENOMEM.
pm_status pm_solid_dynamics_open(pm_solid_dynamics *d, pm_arena *arena, const pm_part *part,
                                 const pm_solid_mesh *mesh);
void pm_solid_dynamics_close(pm_solid_dynamics *d);

// Starts a run at the state z [nz].
void pm_solid_dynamics_start(pm_solid_dynamics *d, const double *z);
// Computes E, S, dE and dS at z, which is `from`, the start of the substep, or the last result. The
// velocity is that from `from` to z within h s.
void pm_solid_dynamics_expose(pm_solid_dynamics *d, const double *z, const double *from, double h);
// Computes d->result from the state z at the start of the substep of h s and the rates of the
// ports: mean [nz] over the substep, and d->end_rate at its end. It does nothing if the rates have
// the bits of the last call in this substep; d->changed says whether it did. Returns false, and
// fails the next end of a step, if no balance of forces is found.
bool pm_solid_dynamics_balance(pm_solid_dynamics *d, double h, const double *z, const double *mean);
// Ends a substep: the next call of pm_solid_dynamics_balance starts from d->result.
void pm_solid_dynamics_end_substep(pm_solid_dynamics *d);

// Puts what the next step needs besides the state into the serializer.
void pm_solid_dynamics_record(pm_solid_dynamics *d, pm_serializer *serializer);

#endif

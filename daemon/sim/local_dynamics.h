// The terms of a subsystem that do not involve its ports, as two graphs: the exposure evaluates E,
// S and their derivatives dE, dS at a state, and the bulk term evaluates L dE + M dS (README.md,
// equation (1)). A graph is not run again while its inputs keep their bits. The exposure is not run
// either while the state stays in a box in which its results are constant (contact_broadphase.h).
//
// Life cycle: zero-initialise; open; then at each stage expose and evaluate_bulk; close. Only the
// files of subsystem.h and multirate.c use it.
#ifndef PM_SIM_LOCAL_DYNAMICS_H
#define PM_SIM_LOCAL_DYNAMICS_H

#include "base/record.h"
#include "graph/program.h"
#include "scene/integrator.h"
#include "scene/system.h"
#include "sim/contact_broadphase.h"
#include "sim/contact_gap.h"
#include "sim/solid_dynamics.h"

typedef struct pm_local_dynamics {
    int nz;
    double h;                 // s, substep
    pm_solid_dynamics *solid; // of a solid, which has neither graph; NULL: the subsystem is none
    pm_contact_gap *gap;      // of a gap beside a solid; NULL: the subsystem is none
    // Computes the five results below from z and, for a discrete integrator, the start of the step.
    pm_program *exposure;
    double *exposure_z;    // [nz]
    double *exposure_from; // [nz] start of the step; NULL unless the integrator is discrete
    // Results of the exposure: [1], [1], [nz], [nz], [nz]. NULL: identically zero. `response` is
    // the change of dE per unit of rate, where a port's prediction needs it (model/prediction.h).
    const double *E, *S, *dE, *dS, *response;
    pm_program *bulk;                   // computes the rate from z, dE, dS; NULL: no bulk term
    double *bulk_z, *bulk_dE, *bulk_dS; // [nz]
    const double *bulk_rate;            // [nz] in units of z per second
    bool exposure_known, bulk_known;    // the results were computed from the present inputs
    pm_contact_broadphase broadphase;   // a box around exposure_z
} pm_local_dynamics;

typedef enum pm_exposure {
    PM_EXPOSURE_SAME,     // the state is the same, and the graph was not run
    PM_EXPOSURE_BOUNDED,  // the state is another one in the same box, where the results are equal
    PM_EXPOSURE_EVALUATED // the graph was run
} pm_exposure;

// Builds the graphs of subsystem number `subsystem_id` for an integrator with substeps of h (s).
// Memory for building comes from the arena. PM_ENOMEM.
pm_status pm_local_dynamics_open(pm_local_dynamics *t, pm_arena *arena, const pm_system *system,
                                 int subsystem_id, const pm_integrator *integrator, double h);
void pm_local_dynamics_close(pm_local_dynamics *t);

// Begins a run: the next evaluation runs the graphs, and a gap (contact_gap.h) knows no answers.
void pm_local_dynamics_forget(pm_local_dynamics *t);

// Evaluates E, S and their derivatives at z [nz]; for a discrete integrator the discrete gradients
// between `from` [nz] and z. `rate` [nz] is an estimate of dz/dt; NULL: not known.
pm_exposure pm_local_dynamics_expose(pm_local_dynamics *t, const double *z, const double *from,
                                     const double *rate);
// Begins a substep of a gap beside a solid at z [nz]; nothing for other subsystems.
void pm_local_dynamics_begin(pm_local_dynamics *t, const double *z);
// Does the same at the end of a step, and replaces the box of contact_broadphase.h by one that
// depends only on z. Earlier states then have no effect on later results, so that a restored run
// continues with the same bits.
pm_exposure pm_local_dynamics_expose_end(pm_local_dynamics *t, const double *z, const double *from);
// Evaluates the bulk term, which must exist, at z with the dE and dS of the last exposure. Returns
// true if the graph was run.
bool pm_local_dynamics_evaluate_bulk(pm_local_dynamics *t, const double *z);

// Puts the inputs of the bulk term into the record. The stage after restoring compares its inputs
// with these. Restoring runs the graph.
void pm_local_dynamics_record(pm_local_dynamics *t, pm_record *record);

#endif

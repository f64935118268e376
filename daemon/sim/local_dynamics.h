// What a part computes by itself, as two graphs: energy, entropy and their derivatives at a state
// (exposure), and its bulk term. A graph whose inputs have the bits of the time before is not run
// again, nor is an exposure that is known without (contact_broadphase.h). Used by subsystem.c and
// multirate.c.
#ifndef PM_SIM_LOCAL_DYNAMICS_H
#define PM_SIM_LOCAL_DYNAMICS_H

#include "graph/program.h"
#include "scene/integrator.h"
#include "scene/system.h"
#include "sim/contact_broadphase.h"

typedef struct pm_local_dynamics {
    int nz;
    pm_program *exposure;               // z -> E, S, dE, dS
    double *exposure_z, *exposure_from; // state; start of the step if discrete, else NULL
    // [1], [1], [nz], [nz], [nz]; NULL: identically zero.
    const double *E, *S, *dE, *dS, *response;
    pm_program *bulk; // z, dE, dS -> rate; NULL if nothing acts inside
    double *bulk_z, *bulk_dE, *bulk_dS;
    const double *bulk_rate;         // [nz]
    bool exposure_known, bulk_known; // what the programs hold belongs to their inputs
    pm_contact_broadphase bounding;  // around exposure_z
} pm_local_dynamics;

typedef enum pm_exposure {
    PM_EXPOSURE_SAME,     // of the same state
    PM_EXPOSURE_BOUNDED,  // of another state, at which nothing is different
    PM_EXPOSURE_EVALUATED // anew
} pm_exposure;

// Builds the graphs of a subsystem under an integrator with steps of h. Memory for building from
// the arena. PM_ENOMEM. Zero-initialise before.
pm_status pm_local_dynamics_open(pm_local_dynamics *t, pm_arena *arena, const pm_system *system,
                                 int subsystem_id, const pm_integrator *integrator, double h);
void pm_local_dynamics_close(pm_local_dynamics *t);

// What the graphs hold is of no use any more.
void pm_local_dynamics_forget(pm_local_dynamics *t);

// Energy, entropy and derivatives at z, or, if discrete, between `from` and z. `rate` [nz]: about
// how z moves; NULL: not known.
pm_exposure pm_local_dynamics_expose(pm_local_dynamics *t, const double *z, const double *from,
                                     const double *rate);
// The same at the end of a step, after which nothing depends on where it was evaluated before.
pm_exposure pm_local_dynamics_expose_end(pm_local_dynamics *t, const double *z, const double *from);
// The bulk rate at z with the dE and dS exposed last, in bulk_rate. There must be a bulk term. True
// if that was not known.
bool pm_local_dynamics_evaluate_bulk(pm_local_dynamics *t, const double *z);

// What the bulk term was evaluated with, so that another's knows it too: how many numbers, and
// these. Restoring evaluates it.
int pm_local_dynamics_checkpoint_size(const pm_local_dynamics *t);
void pm_local_dynamics_save(const pm_local_dynamics *t, double *memory);
void pm_local_dynamics_restore(pm_local_dynamics *t, const double *memory);

#endif

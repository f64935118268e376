// The parts of one subsystem. Only the files that implement subsystem.h include this header:
//     subsystem.c             opens it and returns its properties
//     subsystem_stage.c       evaluates and combines the stages of the integrator
//     subsystem_step.c        starts a run, ends a step and keeps pm_books
//     subsystem_checkpoint.c  saves and restores it
// Calls go in one direction: subsystem.c and subsystem_checkpoint.c call subsystem_step.c, which
// calls subsystem_stage.c.
#ifndef PM_SIM_SUBSYSTEM_PARTS_H
#define PM_SIM_SUBSYSTEM_PARTS_H

#include <string.h>

#include "model/training_range.h"
#include "sim/invariant_projection.h"
#include "sim/iteration.h"
#include "sim/local_dynamics.h"
#include "sim/multirate.h"
#include "sim/subsystem.h"

struct pm_subsystem {
    const pm_system *system;         // borrowed
    const pm_scene_subsystem *scene; // its entry in the scene
    int id, nz;
    const pm_integrator *integrator;
    int substeps; // of the present step
    double h;     // s, length of a substep
    pm_arena arena;

    double *z;       // [nz] after the last substep
    double *stage_z; // [nz] at the present stage
    double *safe_z;  // [nz] after the last successful step
    double *at_z;    // [nz] where operators and port laws are evaluated
    double *k;       // [nstage][nz] rates of the stages; of an iteration only the last one
    double *error;   // [nz] difference to the embedded method over a substep; of an iterate to the
                     // one before
    double *next;    // [nz] next iterate
    double *size;    // [ngroup] largest length that each group has had
    int stage, substep;
    pm_iteration iteration;                  // of the substep, if the integrator is discrete
    bool exposed;                            // dE and dS belong to stage_z
    const pm_boundary_input *boundary_input; // borrowed; NULL: the scene has none
    // [2][scene->nprescribed] values of all boundary inputs at the stage, and work space
    double *prescribed;
    long step;                                           // steps completed
    pm_invariant_projection projection, safe_projection; // now, and after the last successful step

    pm_local_dynamics dynamics;
    pm_training_range range;
    pm_multirate multirate; // only if the integrator is multirate

    int nport;
    pm_port_instance *port;  // [nport]
    pm_books books, booking; // of the last step, and of the one under way
    pm_flux *flux;           // [nflux] of books
};

// Notes that dE and dS belong to stage_z, counts the exposure, and computes the values that the
// ports show.
void pm_subsystem_show(pm_subsystem *s, pm_exposure exposure);

// Copies n numbers; nothing if either array is NULL.
static inline void pm_subsystem_copy(double *to, const double *from, int n) {
    if (to != NULL && from != NULL) {
        memcpy(to, from, (size_t)n * sizeof *to);
    }
}

// Returns covector[i], or 0 if `covector` is NULL, as S and dS are for a subsystem without entropy.
static inline double pm_subsystem_value_at(const double *covector, int i) {
    return covector == NULL ? 0 : covector[i];
}

#endif

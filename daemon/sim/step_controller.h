// Adaptive step control: chooses how many substeps all subsystems take in a step. The number for
// the next step follows from the scene's `tolerance`, from the error estimates of the subsystems
// for the last step, and from the trend of the error (a predictive controller: Gustafsson, ACM
// Trans. Math. Softw. 20 (1994) 496). A step whose error exceeds the tolerance is not repeated. The
// choice depends on the reported errors alone, so that a coordinator and a single process choose
// the same number. Without a tolerance the number is always the scene's `substeps`.
#ifndef PM_SIM_STEP_CONTROLLER_H
#define PM_SIM_STEP_CONTROLLER_H

#include "scene/integrator.h"
#include "scene/recording.h"

#define PM_MOST_SUBSTEPS 4096 // per step

typedef struct pm_step_controller {
    const pm_scene *scene;
    const pm_integrator *integrator;
    int substeps;    // of the next step
    double expected; // error of the coming step with `substeps`, if the solution behaves as in the
                     // last step; 0: no step has been taken
} pm_step_controller;

// Returns the largest number of substeps that a step can have.
static inline int pm_step_controller_most_substeps(const pm_physics *physics) {
    return pm_physics_is_adaptive(physics) ? PM_MOST_SUBSTEPS : physics->substeps;
}

// Starts a run. The controller never chooses fewer substeps than the scene names, since the method
// may be unstable with fewer. The first step takes several times as many, since its error is not
// known. PM_ECONFIG: the integrator does not estimate its error, or the scene's substeps exceed
// PM_MOST_SUBSTEPS. `scene` is borrowed.
pm_status pm_step_controller_init(pm_step_controller *controller, const pm_scene *scene);

// Chooses `substeps` for the next step from the errors in the sample of the last one.
void pm_step_controller_note(pm_step_controller *controller, const pm_sample *sample);

#endif

// The adaptive step: how many substeps all subsystems take in a step. The number is chosen after
// each step from the subsystems' estimates of its error, as the scene's `tolerance` asks. A step
// that turns out too coarse is not repeated: it informs the choice for the next one, and so does
// the trend of the error (a predictive controller: Gustafsson, ACM Trans. Math. Softw. 20 (1994)
// 496). The choice is a function of the reported errors alone, so that a coordinator and a single
// process choose alike. Without a tolerance the scene's `substeps` stay.
#ifndef PM_SIM_STEP_CONTROLLER_H
#define PM_SIM_STEP_CONTROLLER_H

#include "scene/integrator.h"
#include "scene/recording.h"

#define PM_MOST_SUBSTEPS 4096 // per step

typedef struct pm_step_controller {
    const pm_scene *scene;
    const pm_integrator *integrator;
    int substeps;    // of the next step
    double expected; // predicted error of the last step, had it had `substeps`; 0: no step before
} pm_step_controller;

// Starts a run. The scene's substeps are the fewest that may be chosen, since with fewer the method
// may be unstable. The first step takes several times as many, since nothing is known of its error.
// PM_ECONFIG: the integrator does not estimate its error, or the scene's substeps exceed
// PM_MOST_SUBSTEPS. `scene` is borrowed.
pm_status pm_step_controller_init(pm_step_controller *controller, const pm_scene *scene);

// Chooses `substeps` for the next step from the errors in the sample of the last one.
void pm_step_controller_note(pm_step_controller *controller, const pm_sample *sample);

#endif

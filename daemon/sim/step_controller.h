// An adaptive step: how many substeps all parts take in a step, chosen after each step from the
// parts' estimates of its error, as the scene's `tolerance` asks. A step that turns out too coarse
// is not taken back: it tells about the next one, and so does the way the error has gone up or down
// (a predictive controller: Gustafsson, ACM Trans. Math. Softw. 20 (1994) 496). What is chosen is a
// function of the reported errors alone, so that a coordinator and a single process choose alike.
#ifndef PM_SIM_STEP_CONTROLLER_H
#define PM_SIM_STEP_CONTROLLER_H

#include "scene/integrator.h"
#include "scene/recording.h"

#define PM_MOST_SUBSTEPS 4096

typedef struct pm_step_controller {
    const pm_scene *scene;
    const pm_integrator *integrator;
    int substeps;    // of the next step
    double expected; // error of the last step, had it been taken in `substeps`; 0: none before
} pm_step_controller;

// The scene's substeps are the fewest, below which the method may not be stable; they stay where it
// names no tolerance. The first step, of whose error nothing is known, has several times as many.
// PM_ECONFIG: the integrator has no estimate of its error, or the scene's substeps are more than
// PM_MOST_SUBSTEPS.
pm_status pm_step_controller_init(pm_step_controller *pace, const pm_scene *scene);

// After a step.
void pm_step_controller_note(pm_step_controller *pace, const pm_sample *sample);

#endif

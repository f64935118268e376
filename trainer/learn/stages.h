// Chooses the stages of a training file that says `stages: auto` or has no `stages`.
#ifndef PM_TRAINER_LEARN_STAGES_H
#define PM_TRAINER_LEARN_STAGES_H

#include "learn/training.h"

// Fills training->stage and training->nstage. The first stage fits the rates. The next one fits
// integrated steps with half the substeps of `common` and a robust loss. All other settings are
// those of `common`. Beyond some thousand weights Adam takes the place of Gauss-Newton. The models
// must have been declared, because the sizes of the batches depend on the number of weights.
void pm_stages_auto(pm_training *training, const pm_stage *common);

#endif

// The stages of a training that its file leaves to the program (`stages: auto`).
#ifndef PM_TRAINER_LEARN_STAGES_H
#define PM_TRAINER_LEARN_STAGES_H

#include "learn/training.h"

// Fills training->stage from a derivative fit to steps, all else as in `common`. The models are
// declared.
void pm_stages_auto(pm_training *training, const pm_stage *common);

#endif

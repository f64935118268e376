// The stages of a training file: reading its keys `loss` and `stages`, and the digests by which a
// resumed fit recognises its stages. Used by learn/training.c alone.
#ifndef PM_TRAINER_LEARN_TRAINING_STAGES_H
#define PM_TRAINER_LEARN_TRAINING_STAGES_H

#include "learn/training.h"
#include "store/yaml.h"

// Fills training->stage and training->nstage from `root`, the top level of the training file. With
// `stages: auto`, or without `stages`, learn/stages.h chooses the stages; with `defaults: plain`
// and without `noise` the file must list them. The caller has loaded the scene and declared the
// models. PM_ECONFIG; the error names the place in the file. PM_ENOMEM.
pm_status pm_training_read_stages(pm_training *training, pm_yaml root);

// Fills training->stage_digest for all stages. The number of iterations is not part of a digest, so
// that a resumed fit may have longer stages.
void pm_training_digest_stages(pm_training *training);

#endif

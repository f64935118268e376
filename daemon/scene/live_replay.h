// Reads back what the live inputs of a recorded run were, so that the run can be repeated.
#ifndef PM_SCENE_LIVE_REPLAY_H
#define PM_SCENE_LIVE_REPLAY_H

#include <stdint.h>

#include "scene/scene.h"

// Reads from the recording at `path` the values of the scene's live inputs in each step, from the
// first one on: value [*steps][scene->nlive], in SI units, which belongs to the arena. PM_EFILE:
// the file cannot be read, or lacks a live input of the scene. PM_EDATA: it does not hold every
// step. PM_ECONFIG: the scene has no live inputs. PM_ENOMEM.
pm_status pm_live_replay_load(const char *path, const pm_scene *scene, pm_arena *arena,
                              double **value, int64_t *steps);

#endif

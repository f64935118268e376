// Loads a training from two texts, for tests.
#ifndef PM_TESTS_SUPPORT_TRAINING_H
#define PM_TESTS_SUPPORT_TRAINING_H

#include "fit/training.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

// Loads a training from the text of its file, which names its scene "scene.yaml", and the text of
// the scene. A failure ends the test. The caller frees.
static inline pm_training *load_training(const char *scene_text, const char *training_text) {
    scratch folder;
    pm_training *t = NULL;
    scratch_open(&folder);
    const char *path = scratch_path(&folder, "train.yaml");
    scratch_write(scratch_path(&folder, "scene.yaml"), scene_text, strlen(scene_text));
    scratch_write(path, training_text, strlen(training_text));
    const pm_status status = pm_training_load(&t, path);
    scratch_close(&folder);
    if (status != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return t;
}

#endif

// Proposes a training file for a dataset, for tests that look for words in it.
#ifndef PM_TESTS_SUPPORT_PROPOSAL_H
#define PM_TESTS_SUPPORT_PROPOSAL_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "propose/propose.h"
#include "scene/scene.h"
#include "tests/support/unit.h"

#define PM_PROPOSAL_TEXT 16384

// Writes the training file that is proposed for the scene and the dataset into text. A failure ends
// the test.
static inline void propose_text(const char *scene_text, const pm_dataset *d,
                                char text[PM_PROPOSAL_TEXT]) {
    char path[] = "/tmp/test_proposeXXXXXX";
    const int id = mkstemp(path);
    assert_true(id >= 0);
    close(id);
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_parse(&scene, scene_text, "scene.yaml"), PM_OK);
    const pm_proposal p = {
        .scene = scene, .dataset = d, .scene_path = "scene.yaml", .data_path = "data.h5"};
    assert_int_equal(pm_propose(&p, path), PM_OK);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    text[fread(text, 1, PM_PROPOSAL_TEXT - 1, file)] = '\0';
    fclose(file);
    remove(path);
    pm_scene_free(scene);
}

// Fails if the text of a proposal does not contain these words.
static inline void assert_proposal_says(const char *text, const char *expected) {
    if (strstr(text, expected) == NULL) {
        fail_msg("expected \"%s\" in:\n%s", expected, text);
    }
}

// Fails if the text of a proposal contains these words.
static inline void assert_proposal_omits(const char *text, const char *unexpected) {
    if (strstr(text, unexpected) != NULL) {
        fail_msg("did not expect \"%s\" in:\n%s", unexpected, text);
    }
}

#endif

// The text of a scene file with other sections than it has. A study changes the text instead of the
// scene in memory, so that a changed scene passes every check of the reader, and can be written.
#ifndef PM_STUDY_SCENE_TEXT_H
#define PM_STUDY_SCENE_TEXT_H

#include "scene/boundary_input.h"
#include "scene/scene.h"

// Reads the file at `path` to *text, which the caller frees. PM_EFILE; PM_ENOMEM.
pm_status pm_scene_text_read(const char *path, char **text);

// Replaces the top-level section `key` of *text by the line "key: value", at the place where the
// section stood, or at the end if there was none. With `value` NULL the section is removed. *text
// is freed and replaced. PM_ENOMEM.
pm_status pm_scene_text_put(char **text, const char *key, const char *value);

// How a run steps through time.
typedef struct pm_stepping {
    const pm_integrator *integrator;
    int substeps;     // of a step; with a tolerance, their smallest number
    double tolerance; // relative error of a substep; 0: substeps are fixed
    double dt;        // s, of a step
    int steps;
} pm_stepping;

// Replaces the section `time` of *text. Fails as pm_scene_text_put.
pm_status pm_scene_text_put_time(char **text, const pm_stepping *stepping);

// Replaces the section `boundary_inputs` of *text by constants: the means of all prescribed values
// over the trajectory that `boundary_input` follows. Does nothing where all are constants already.
// Fails as pm_scene_text_put.
pm_status pm_scene_text_put_mean_inputs(char **text, const pm_boundary_input *boundary_input);

// Reads a text as the scene of the file `path`, which need not be there, with its weights
// (scene/system.h): paths in a scene count from its folder. Does nothing if `path` is NULL. Fails
// as pm_scene_parse, pm_system_load, and pm_scene_text_write do.
pm_status pm_scene_text_check(const char *text, const char *path, const char *weights);

// Writes a text to the file `path`. PM_EFILE, also if that is a file which no study has written;
// PM_EUSAGE: the program reads that file; otherwise fails as pm_scene_text_check does.
pm_status pm_scene_text_write(const char *text, const char *path, const char *weights);

#endif

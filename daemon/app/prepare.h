// Prepares a run as the command line asks for it: the setup of its scene (library/setup.h) with the
// options in place of the scene's own settings, and the files of its checkpoints.
#ifndef PM_APP_PREPARE_H
#define PM_APP_PREPARE_H

#include "app/command.h"
#include "library/setup.h"

// Loads the scene that `options` names and completes the setup for `purpose`. The options --steps
// and --in-process replace the scene's number of steps and processes. Fails as the
// functions of library/setup.h do. PM_ECONFIG, PM_EFILE: the URL or the key file cannot be used
// (connect.h). The caller frees the setup, on failure too.
pm_status pm_prepare(pm_setup *setup, const pm_run_options *options, pm_purpose purpose);

// Checks that every boundary input, and the recording that is replayed, has values for all steps of
// the run, unless a client decides how many steps it takes (--held). PM_EDATA.
pm_status pm_prepare_check_steps(const pm_setup *setup, const pm_run_options *options);

// Writes the path of the file in which `process` (NULL: the coordinator) keeps its checkpoint to
// `path`, and makes its folder. `path` becomes NULL if the options ask for no checkpoint. PM_EFILE,
// PM_ENOMEM.
pm_status pm_prepare_checkpoint(pm_setup *setup, const pm_run_options *options, const char *process,
                                const char **path);

#endif

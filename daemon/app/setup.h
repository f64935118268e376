// What every subcommand begins with: the scene, its models, where it starts, and the reference
// trajectory that it is compared with.
#ifndef PM_APP_SETUP_H
#define PM_APP_SETUP_H

#include "app/options.h"
#include "scene/boundary_input.h"
#include "scene/columns.h"
#include "scene/system.h"

// A node needs the state it starts from and its loads; whoever coordinates also compares with the
// reference, in any case; a description does without a state to start from.
typedef enum pm_purpose { PM_TO_SERVE, PM_TO_COORDINATE, PM_TO_DESCRIBE } pm_purpose;

typedef struct pm_setup {
    pm_arena arena;
    pm_scene *scene; // with the options' URL, number of steps and --in-process in place
    pm_system *system;
    pm_dataset *reference;            // NULL: the scene names none, or nobody needs it
    pm_columns columns;               // of the reference
    int stride;                       // steps between two states of the reference
    pm_boundary_input boundary_input; // what the world prescribes; empty without loads
    double *initial;                  // [scene->nz]; NULL: none to be found, and PM_TO_DESCRIBE
} pm_setup;

// Loads all of it. Each subsystem starts from its `initial`, else from the reference's first state;
// PM_ECONFIG if it has neither. A reference that is loaded has its time step checked (PM_EDATA).
// The initial state and the loads are folded into system->digest, so that hosts which look at
// different references find out. The caller frees, on failure too.
pm_status pm_setup_load(pm_setup *setup, const pm_run_options *options, pm_purpose purpose);
void pm_setup_free(pm_setup *setup);

// The file in which a process, or with `process` NULL the coordinator, keeps its checkpoint; NULL
// if none is asked for. The folder is made. PM_EFILE, PM_ENOMEM.
pm_status pm_setup_checkpoint(pm_setup *setup, const pm_run_options *options, const char *process,
                              const char **path);

// The reference's trajectory at state `time_id`: [reference->ncolumn].
const double *pm_setup_truth(const pm_setup *setup, int time_id);

#endif

// Loads what every subcommand needs: the scene, its models, the initial state, and the reference
// trajectory with which a run is compared.
#ifndef PM_APP_SETUP_H
#define PM_APP_SETUP_H

#include "app/options.h"
#include "scene/boundary_input.h"
#include "scene/columns.h"
#include "scene/system.h"

// The purpose of a setup. A node needs the initial state and its boundary inputs; a coordinator
// also needs the reference; a description can do without an initial state.
typedef enum pm_purpose { PM_TO_SERVE, PM_TO_COORDINATE, PM_TO_DESCRIBE } pm_purpose;

typedef struct pm_setup {
    pm_arena arena;
    pm_scene *scene; // the options' URL, number of steps and --in-process replace its own
    pm_system *system;
    pm_dataset *reference; // NULL: the scene names none, or it is not needed
    pm_columns columns;    // of the reference
    int stride;            // steps between two states of the reference
    pm_boundary_input
        boundary_input; // values prescribed from outside; empty without boundary inputs
    double *initial;    // [scene->nz]; NULL only for PM_TO_DESCRIBE, if there is none
} pm_setup;

// Loads the setup. Each subsystem starts from its `initial`, or else from the first state of the
// reference; PM_ECONFIG if it has neither. PM_EDATA: the time step of the reference does not fit.
// The initial state and the boundary inputs are folded into system->digest, so that the processes
// of hosts with different references refuse each other. It also fails as the functions that load
// its parts do. The caller frees the setup, after a failure too.
pm_status pm_setup_load(pm_setup *setup, const pm_run_options *options, pm_purpose purpose);
void pm_setup_free(pm_setup *setup);

// Writes the path of the file in which `process` (NULL: the coordinator) keeps its checkpoint to
// `path`, and makes its folder. `path` becomes NULL if the options ask for no checkpoint. PM_EFILE,
// PM_ENOMEM.
pm_status pm_setup_checkpoint(pm_setup *setup, const pm_run_options *options, const char *process,
                              const char **path);

// Returns the state of the reference at time `time_id`: [reference->ncolumn].
const double *pm_setup_truth(const pm_setup *setup, int time_id);

#endif

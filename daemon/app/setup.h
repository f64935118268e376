// What every subcommand begins with: the scene, its models, where it starts, and the reference
// trajectory that it is compared with.
#ifndef PM_APP_SETUP_H
#define PM_APP_SETUP_H

#include "app/options.h"
#include "store/columns.h"
#include "store/system.h"

typedef struct pm_setup {
    pm_arena arena;
    pm_scene *scene; // with the options' URL and number of steps in place
    pm_system *system;
    pm_dataset *reference; // NULL: the scene names none, or nobody needs it
    pm_columns columns;    // of the reference
    int stride;            // steps between two states of the reference
    double *initial;       // [scene->nz]
} pm_setup;

// Loads all of it. Each subsystem starts from its `initial`, else from the reference's first state;
// PM_ECONFIG if it has neither. With `compare`, a reference that the scene names is loaded in any
// case and its time step checked (PM_EDATA). The initial state is folded into system->digest, so
// that hosts which look at different references find out. The caller frees, on failure too.
pm_status pm_setup_load(pm_setup *setup, const pm_options *options, bool compare);
void pm_setup_free(pm_setup *setup);

// The reference's trajectory at state `time_id`: [reference->ncolumn].
const double *pm_setup_truth(const pm_setup *setup, int time_id);

#endif

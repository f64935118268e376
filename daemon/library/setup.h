// Loads what every run needs: the scene, its models, the initial state, and the reference
// trajectory with which a run is compared.
#ifndef PM_LIBRARY_SETUP_H
#define PM_LIBRARY_SETUP_H

#include "scene/boundary_input.h"
#include "scene/columns.h"
#include "scene/system.h"

// The purpose of a setup. A node needs the initial state and its boundary inputs; a coordinator
// also needs the reference; a description can do without an initial state.
typedef enum pm_purpose { PM_TO_SERVE, PM_TO_COORDINATE, PM_TO_DESCRIBE } pm_purpose;

typedef struct pm_setup {
    pm_arena arena;
    pm_scene *scene;
    pm_system *system;
    pm_dataset *reference; // NULL: the scene names none, or it is not needed
    pm_columns columns;    // of the reference
    int stride;            // steps between two states of the reference
    pm_boundary_input
        boundary_input; // values prescribed from outside; empty without boundary inputs
    double *initial;    // [scene->nz]; NULL only for PM_TO_DESCRIBE, if there is none
} pm_setup;

// Begins a setup with a scene and its system, which pm_system_load reads with `weights` (NULL: from
// where the scene says). Takes over the scene. The caller may change the scene's URL, number of
// steps and processes before the next call, and frees the setup, on failure too. Fails as
// pm_system_load does.
pm_status pm_setup_open(pm_setup *setup, pm_scene *scene, const char *weights);

// Completes the setup with the reference, the boundary inputs and the initial state. Each subsystem
// starts from its `initial`, or else from the first state of the reference; PM_ECONFIG if it has
// neither. PM_EDATA: the time step of the reference does not fit. The initial state and the
// boundary inputs are folded into system->digest, so that the processes of hosts with different
// references refuse each other. It also fails as the functions that load its parts do.
pm_status pm_setup_complete(pm_setup *setup, pm_purpose purpose);
void pm_setup_free(pm_setup *setup);

// Returns the path, as the scene or the caller gave it, of the file that the run reads and that is
// the same file as `path`: the scene, its key, its reference or weights. NULL: none of them is.
const char *pm_setup_input(const pm_setup *setup, const char *path);

// Returns the state of the reference at time `time_id`: [reference->ncolumn].
const double *pm_setup_truth(const pm_setup *setup, int time_id);

#endif

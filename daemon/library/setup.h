// Loads what every run needs: the scene, its models, the initial state, and the reference
// trajectory with which a run is compared.
#ifndef PM_LIBRARY_SETUP_H
#define PM_LIBRARY_SETUP_H

#include "scene/boundary_input.h"
#include "scene/columns.h"
#include "scene/system.h"

// The purpose of a setup. A node needs the initial state and its boundary inputs. A coordinator
// also needs the reference. A description of the scene can do without an initial state.
typedef enum pm_purpose { PM_TO_SERVE, PM_TO_COORDINATE, PM_TO_DESCRIBE } pm_purpose;

// The parts of a setup, which owns them. The caller owns the storage.
typedef struct pm_setup {
    pm_arena arena;
    pm_scene *scene;
    pm_system *system;
    const char *weights; // the folder of the weights; NULL: where the scene says
    // NULL: the scene names no reference, or one of measurements, or the purpose needs none
    pm_dataset *reference;
    pm_columns columns; // the columns of the reference that hold the scene's state
    int stride;         // steps of the scene between two states of the reference
    // Values prescribed from outside; empty if the scene has no boundary inputs.
    pm_boundary_input boundary_input;
    double *live; // [scene->nlive] the values of live inputs in the present step, at first `start`
    // A recording from which the values of live inputs are taken; NULL: none.
    const char *replay_path;
    double *replay; // [replayed][scene->nlive] the values in each step
    int64_t replayed;
    // [scene->nz] the state before the first step; NULL only for PM_TO_DESCRIBE, if a subsystem has
    // neither an `initial` nor a reference.
    double *initial;
} pm_setup;

// Begins a setup with a scene and its system. The setup takes over the scene. pm_system_load reads
// the weights from the folder `weights`, or from the files that the scene names if `weights` is
// NULL; the string must outlive pm_setup_complete. The caller may change the scene's URL, number of
// steps and processes before it calls pm_setup_complete. The caller frees the setup, after a
// failure too. Fails as pm_system_load does.
pm_status pm_setup_open(pm_setup *setup, pm_scene *scene, const char *weights);

// Completes the setup with the reference, the boundary inputs and the initial state. Each subsystem
// starts from its `initial`, or else from the first state of the reference, which is estimated by
// the program portmet-train if the reference holds measurements. The function updates
// system->digest with the initial state and the boundary inputs, so that the processes of hosts
// with different references refuse each other. PM_ECONFIG: a subsystem has neither an `initial` nor
// a reference, except for PM_TO_DESCRIBE; or the reference does not contain the trajectory whose
// number the scene names. PM_EDATA: the time step of the reference is not a whole multiple of the
// scene's. PM_ENOMEM. Otherwise fails as pm_dataset_load, pm_system_check_dataset, pm_columns_bind
// and pm_boundary_input_bind do.
pm_status pm_setup_complete(pm_setup *setup, pm_purpose purpose);
// Reads the values that the live inputs of the scene had in the recording at `path`; a run of the
// setup repeats them. `path` must outlive the setup. Fails as pm_live_replay_load does.
pm_status pm_setup_replay(pm_setup *setup, const char *path);

// Frees all parts of the setup, the scene included.
void pm_setup_free(pm_setup *setup);

// Returns the state with the index `time_id`, 0 to reference->ntime - 1, of the trajectory of the
// reference with which the scene is compared: one row [reference->ncolumn], in the units of the
// columns. setup->reference must not be NULL, and the result is valid until pm_setup_free.
const double *pm_setup_truth(const pm_setup *setup, int time_id);

#endif

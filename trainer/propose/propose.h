// Proposes a training file for any scene. The units, the ports and statistics of the data tell
// which variables are conjugate, which are entropies, what dissipates, and what is invariant. Where
// they may be wrong, other hypotheses are tried by short fits.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_H
#define PM_TRAINER_PROPOSE_PROPOSE_H

#include <signal.h>

#include "model/spec.h"
#include "scene/scene.h"
#include "store/dataset.h"

// The budget where none is named, s.
#define PM_PROPOSAL_BUDGET 60.0

// The input of a proposal; all pointers are borrowed.
typedef struct pm_proposal {
    const pm_scene *scene;
    const pm_dataset *dataset;
    const char *scene_path; // which the training file names as seen from its folder
    const char *data_path;
    pm_form form;
    // What the fit takes of the dataset (data/split.h); NULL: all, and every fifth for validation.
    const char *trajectories, *validation;
    double budget; // s of CPU time for trials of hypotheses (propose/search.h); 0: none is tried
    bool loud;     // print what the trials show
    const volatile sig_atomic_t *stop; // ends the search when nonzero; or NULL
} pm_proposal;

// Writes the training file `path`, with comments that give reasons. PM_EFILE; PM_EDATA and
// PM_ECONFIG (missing columns, trajectories too short); PM_EINTERRUPTED; PM_ENOMEM.
pm_status pm_propose(const pm_proposal *proposal, const char *path);

// Copies the scene file `from` to `path` and replaces the law bracket by exchange, which ports of
// the form free have. PM_EFILE.
pm_status pm_propose_scene(const char *from, const char *path);

// Returns true if one subsystem can have all groups of the scene: there are not too many, neither
// of subsystems nor of boundary inputs.
bool pm_propose_fits_one(const pm_scene *scene);
// Writes a scene to `path` that has the columns and the steps of `scene`, but a single subsystem
// without ports. Its groups are those of all subsystems in their order, called
// "<subsystem>_<group>". What boundary inputs follow becomes one of them, "outside", with one port.
// The rates of a model of the form free may then depend on all variables of the scene. With ports,
// the rates of a subsystem could depend only on its own variables and on those that its neighbours
// expose. PM_EFILE.
pm_status pm_propose_scene_of_one(const pm_scene *scene, const char *path);

// Reads a scene and a dataset and writes the training file `output`. For the form free it
// also writes the scene that this file names, "<output without its ending>_scene.yaml". Prints the
// names of the files that it wrote. `how` has the form, what is taken of the dataset, and the
// budget; its other members are not read. Fails like pm_propose.
pm_status pm_propose_files(const char *scene, const char *data, const pm_proposal *how,
                           const char *output);

// Returns true if a YAML file is a scene and not a training file: a scene has the key `time`.
bool pm_propose_is_scene(const char *path);

#endif

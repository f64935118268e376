// A scene with its models: what a run, a training or an evaluation works on.
#ifndef PM_SCENE_SYSTEM_H
#define PM_SCENE_SYSTEM_H

#include <stdint.h>

#include "model/part.h"
#include "model/port.h"
#include "model/prediction.h"
#include "scene/scene.h"
#include "scene/weights.h"
#include "store/dataset.h"

typedef struct pm_system {
    const pm_scene *scene; // borrowed
    pm_arena arena;
    pm_part *part;                  // [scene->nsubsystem]
    pm_port_model *port;            // [scene->nport]
    pm_provenance *part_provenance; // likewise, of the files they were loaded from; path NULL: none
    pm_provenance *port_provenance;
    uint64_t digest; // of topology, integrator and all weights: equal on all hosts; 0 if not loaded
} pm_system;

// Declares every model that the scene knows and loads every weights file that it names; with
// `weights_dir`, DIR/<base name of the path>
// instead. Layouts and laws must equal the scene's. Errors point at the scene's entry. PM_EWEIGHTS,
// PM_EFILE, PM_ENOMEM.
pm_status pm_system_load(pm_system **system, const pm_scene *scene, const char *weights_dir);
// Makes a system for training: it has the scene's layouts; specs and parameters are the caller's to
// set. PM_ENOMEM.
pm_status pm_system_new(pm_system **system, const pm_scene *scene);
// Declares a component whose model the scene knows, for whoever sets the others. PM_ECONFIG,
// PM_ENOMEM.
pm_status pm_system_declare_part(pm_system *system, int id);
pm_status pm_system_declare_port(pm_system *system, int id);
// All parts, then all ports, by one number: how many there are, and the numbers each carries.
int pm_system_components(const pm_system *system);
pm_params *pm_system_params(const pm_system *system, int component);
// Marks the components of a subsystem's state on which some port's irreversible exchange acts
// (prediction.h). component: [nz], all written.
void pm_system_responding(const pm_system *system, int subsystem, bool *component);
void pm_system_free(pm_system *system); // NULL is allowed

// Whether every load prescribes the dS of what a port's irreversible operator acts on: without, the
// world's end would take no part in the exchange, and the rest would be wrong. PM_ECONFIG, at the
// scene's entry. Part of pm_system_load; a caller that sets specs calls it after.
pm_status pm_system_check_loads(const pm_system *system);

// Whether each port's weights were made in the coordinates (weights.h) that those of its ends'
// parts were; where either is not known, nothing is wrong. PM_EWEIGHTS. Part of pm_system_load.
pm_status pm_system_check_coordinates(const pm_system *system);
// The same of the parts' weights and a dataset's note `coordinates`; `path` names it. PM_EDATA.
pm_status pm_system_check_dataset(const pm_system *system, const pm_dataset *dataset,
                                  const char *path);

// What the weights of a part remember of where they were trained: the digest of the names of its
// columns (0: the scene maps none), and the groups that are measured from a neighbour, joined by
// blanks, in the arena (NULL: out of memory).
uint64_t pm_system_columns_digest(const pm_scene_subsystem *subsystem);
const char *pm_system_relative_groups(const pm_scene_subsystem *subsystem, pm_arena *arena);
// Whether weights stand where they were trained: two parts have not exchanged theirs, and no group
// has lost or gained relative_to. A part that stands among columns of other names is a part used
// elsewhere, and nothing is wrong; nor where the file does not know. PM_EWEIGHTS. Part of
// pm_system_load.
pm_status pm_system_check_origin(pm_system *system);

// Whether the scene takes the steps by which such weights were trained as hold for these alone: of
// a network of nodes that says what happens `within` (spec.h) one of them, or less. Others say
// rates, of which every integrator makes steps; and where a file does not say, nothing is wrong.
// PM_EWEIGHTS. Part of pm_system_load.
pm_status pm_system_check_steps(const pm_system *system);

// Whether what one end of a port shows includes a dS.
bool pm_system_end_has_entropy(const pm_system *system, int port, int end);

// The first subsystem in which energy and entropy are not defined (form: free), so that neither are
// the totals; -1: none.
int pm_system_without_energy(const pm_system *system);

#endif

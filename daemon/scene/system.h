// A system: a scene together with the models of all its subsystems and ports. A run, a training and
// an evaluation all work on one.
//
// Life cycle: pm_system_load makes a complete system from a scene and its weights; training makes
// one with pm_system_new and sets the models itself; pm_system_free releases it.
#ifndef PM_SCENE_SYSTEM_H
#define PM_SCENE_SYSTEM_H

#include <stdint.h>

#include "model/part.h"
#include "model/port.h"
#include "model/prediction.h"
#include "scene/scene.h"
#include "scene/weights.h"
#include "store/dataset.h"
#include "store/solid_mesh.h"

typedef struct pm_system {
    const pm_scene *scene; // borrowed
    pm_arena arena;
    // The models of all subsystems, then of all ports, and what is known of their weights
    // (provenance with path NULL: there are none). Components with the same model share one that
    // belongs to the first of them, their owner. A component has a model of its own where no other
    // has the same, and in a system that pm_system_load did not make.
    pm_component *component;    // [nsubsystem + nport]
    pm_part **part;             // [nsubsystem] the same models as what they are
    pm_port_model **port;       // [nport]
    int *owner;                 // [nsubsystem + nport] the component that owns the model of each
    const pm_solid_mesh **mesh; // [nsubsystem] of each solid; NULL: the subsystem is no solid
    bool compiled; // engines of the system compile its models (graph/compile.h); false at first
    // Digest of topology, integrator and all weights, equal on all hosts; 0 unless loaded.
    uint64_t digest;
} pm_system;

// Declares every known model of the scene and loads every weights file that it names; if
// `weights_dir` is not NULL, it loads the file of the same name from that folder instead. `scene`
// is borrowed; the caller frees the system. PM_EWEIGHTS: layouts, law, coordinates or steps of the
// weights differ from the scene's; they are of another system; two subsystems have exchanged their
// weights; or the groups of a solid are not those of its mesh. PM_ECONFIG: a known model or a
// boundary input is incomplete, or a subsystem has a mesh and is no solid. PM_EDATA, PM_EFILE,
// PM_ENOMEM. Messages begin with the place in the scene.
pm_status pm_system_load(pm_system **system, const pm_scene *scene, const char *weights_dir);
// Makes a system for training, with the scene's layouts. The caller sets specs and parameters.
// PM_ENOMEM.
pm_status pm_system_new(pm_system **system, const pm_scene *scene);
void pm_system_free(pm_system *system); // NULL is allowed

// Return the number of components, and the parameters of one, which the system owns.
int pm_system_components(const pm_system *system);
pm_params *pm_system_params(const pm_system *system, int component);

// Declares the known model of one component, for a caller that sets the other models itself.
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_system_declare(pm_system *system, int component);

// Checks that the integrator can step all states. One that keeps the energy by construction cannot
// step co-energies (model/part.h). PM_ECONFIG, with the place `at` of the integrator's name.
pm_status pm_system_check_integrator(const pm_system *system, const pm_integrator *integrator,
                                     const char *at);

// Sets ports[c] for each component c of a subsystem's state: the number of ports whose irreversible
// exchange acts on it (model/prediction.h). ports: [nz].
void pm_system_responding(const pm_system *system, int subsystem, int *ports);

// Checks that every boundary input prescribes the dS of each group on which a port's irreversible
// operator acts. Without the dS the outside would take no part in the exchange. PM_ECONFIG: the
// message names the place in the scene. pm_system_load calls this function; a caller that sets the
// specs itself calls it afterwards.
pm_status pm_system_check_boundary_inputs(const pm_system *system);

// Checks that at least half of the states z [count][nz] are no further from the training ranges of
// the weights than five widths: further away are other systems and other units. Checks also that
// several states are not all a hundredth, or less, of what a training range has that keeps far from
// zero. Groups on which no potential depends may be anywhere, as may all if the scene has a guard
// for the range. `what` names the states in the message. PM_EDATA.
pm_status pm_system_check_range(const pm_system *system, int count, const double *z,
                                const char *what);

// Checks that the weights of the parts were made in the coordinates that the note `coordinates` of
// a dataset names, as far as both are known, that fewer than a thousand steps of the scene
// lie between two of its states, and pm_system_check_range for some of its states.
// `path` names the dataset in the message. PM_EDATA; PM_ENOMEM.
pm_status pm_system_check_dataset(const pm_system *system, const pm_dataset *dataset,
                                  const char *path);

// Return what a weights file records about the subsystem in the training scene. The first function
// returns the digest of the names of its columns (0: the scene maps none). The second one returns
// the groups that are measured from another subsystem, joined by blanks, in the arena (NULL: out of
// memory).
uint64_t pm_system_columns_digest(const pm_scene_subsystem *subsystem);
const char *pm_system_relative_groups(const pm_scene_subsystem *subsystem, pm_arena *arena);
// Returns true if the values that one end of a port shows include a dS.
bool pm_system_end_has_entropy(const pm_system *system, int port, int end);

// Returns the first subsystem without energy and entropy (form: free), for which the totals are not
// defined; -1: none.
int pm_system_without_energy(const pm_system *system);

// Returns the component whose weights have the worst verdict of a fit that is not "good"
// (weights.h); -1: there is none, or none is known.
int pm_system_worst_verdict(const pm_system *system);

#endif

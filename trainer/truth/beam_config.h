// The configuration of bodies: one box, several boxes in contact, or a body of any shape from a
// file, and the loads on one of them.
#ifndef PM_TRAINER_TRUTH_BEAM_CONFIG_H
#define PM_TRAINER_TRUTH_BEAM_CONFIG_H

#include "store/yaml.h"
#include "truth/beam_load.h"
#include "truth/beam_material.h"
#include "truth/beam_skin.h"

#define PM_BEAM_MAX_BODIES 8

typedef struct pm_beam_system {
    const char *file; // of the mesh, as the configuration names it; NULL: boxes
    pm_beam_mesh mesh;
    pm_beam_skin skin; // of a body from a file
    pm_beam_material material;
    const char *const *name;      // [nbody]; NULL: one beam without a name
    const char *const *placement; // [nbody] as text
    double contact;               // Pa/m, penalty stiffness per area
    int substeps;                 // time steps per state
    int loaded;                   // the body on which the load acts
    int positions;                // load positions on each face; 0: the loads are random patches
    double force;                 // N on each node of a row
    double ramp;                  // s, until a row has its full load
    pm_beam_patches patches;
} pm_beam_system;

// Reads the `system:` block of the truth file `path`. Memory from the arena. PM_ECONFIG, PM_ENOMEM;
// PM_EFILE, PM_EDATA: a mesh cannot be read.
pm_status pm_beam_config_read(pm_yaml block, const char *path, pm_arena *arena,
                              pm_beam_system *system);
// Describes the parameters as text in the arena; NULL if memory is exhausted.
const char *pm_beam_config_describe(const pm_beam_system *system, pm_arena *arena);

#endif

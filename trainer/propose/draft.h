// A training file while it is being written: the models of its subsystems and ports.
#ifndef PM_TRAINER_PROPOSE_DRAFT_H
#define PM_TRAINER_PROPOSE_DRAFT_H

#include <stdio.h>

#include "propose/propose.h"
#include "propose/view.h"

typedef struct pm_draft {
    FILE *file;
    const pm_proposal *p;
    pm_look look;
    pm_part_view *part;  // [nsubsystem]
    pm_rotation rotates; // if not PM_ROTATION_NONE, the dynamics do not depend on directions
    double *temperature; // [nz] K: of entropies (propose/temperature.h); 0: not known
} pm_draft;

// These functions write the model of a subsystem and of a port.
void pm_draft_part(const pm_draft *draft, const pm_part_view *part);
void pm_draft_port(const pm_draft *draft, int port);

// Returns whether a column tells what the outside shows in a group of a boundary input: 0 its
// value, 1 its dE, 2 its dS.
bool pm_draft_follows(const pm_scene_boundary_input *input, const pm_group *group, int which);

#endif

// A training file while it is being written, shared by the files that write its sections.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_DRAFT_H
#define PM_TRAINER_PROPOSE_PROPOSE_DRAFT_H

#include <stdio.h>

#include "propose/propose.h"
#include "propose/propose_view.h"

typedef struct pm_draft {
    FILE *file;
    const pm_proposal *p;
    pm_look look;
    pm_part_view *part; // [nsubsystem]
    bool rotates;       // the dynamics do not depend on directions
    int width;          // number of units in each hidden layer
} pm_draft;

// Returns the name of a group of a subsystem.
const char *pm_draft_name(const pm_part_view *part, int group);
// Returns true if friction, relaxation or leakage may act on the group.
bool pm_draft_may_lose(const pm_part_view *part, int group);

// Writes a list of names in brackets: _open writes `before` and the opening bracket, _add writes
// `before` and `name`, after a comma where needed. The caller writes the closing bracket.
typedef struct pm_draft_list {
    FILE *file;
    int count;
} pm_draft_list;
pm_draft_list pm_draft_open(FILE *file, const char *before);
void pm_draft_add(pm_draft_list *list, const char *before, const char *name);

// These functions write the model of a subsystem, and of a port, under the key `models`.
void pm_draft_part(const pm_draft *draft, const pm_part_view *part);
void pm_draft_port(const pm_draft *draft, int port);

#endif

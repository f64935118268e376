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
    pm_part_view *part;  // [nsubsystem]
    pm_rotation rotates; // if not PM_ROTATION_NONE, the dynamics do not depend on directions
    double decay;        // 1/s: the fastest decay (propose/decay.h)
    double *temperature; // [nz] K: of entropies (propose/temperature.h); 0: not known
    int width;           // number of units in each hidden layer
} pm_draft;

// Returns the name of a group of a subsystem.
const char *pm_draft_name(const pm_part_view *part, int group);
// Returns true if friction, relaxation or leakage may act on the group.
bool pm_draft_may_lose(const pm_part_view *part, int group);

// Writes a coefficient, with a point also where it is a whole number.
void pm_draft_number(FILE *file, double number);
// Writes the coefficient of a lossless pair, which is given in SI units, in those of its variables.
void pm_draft_coefficient(FILE *file, double coefficient, const pm_unit *a, const pm_unit *b);

// Writes a list of names in brackets: _open writes `before` and the opening bracket, _add writes
// `before` and `name`, after a comma where needed. The caller writes the closing bracket.
typedef struct pm_draft_list {
    FILE *file;
    int count;
} pm_draft_list;
pm_draft_list pm_draft_open(FILE *file, const char *before);
void pm_draft_add(pm_draft_list *list, const char *before, const char *name);

// Adds those groups of a subsystem that change in the data to a list of features, with `before` in
// front of their names. With `shown` only the groups are added that this layout has. With `single`
// the size stands for a variable that changes its sign when time runs backwards: strengths do not
// change then, so that the sign of a velocity matters only relative to that of another one.
void pm_draft_add_features(const pm_draft *draft, pm_draft_list *list, const pm_part_view *part,
                           const char *before, const pm_layout *shown, bool single);
// Returns the number of components of such variables among these groups.
int pm_draft_count_odd(const pm_part_view *part, const pm_layout *shown);
// Writes ", strength: {...}" up to its features, which the caller adds, and its end.
pm_draft_list pm_draft_open_strength(const pm_draft *draft);
void pm_draft_close_strength(const pm_draft *draft);

// These functions write the model of a subsystem, its key `reversible`, and the model of a port.
void pm_draft_part(const pm_draft *draft, const pm_part_view *part);
void pm_draft_reversible(const pm_draft *draft, const pm_part_view *part);
void pm_draft_port(const pm_draft *draft, int port);

#endif

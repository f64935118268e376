// A training file while it is being written: the models of its subsystems and ports, by the
// hypotheses that were chosen.
#ifndef PM_TRAINER_PROPOSE_DRAFT_H
#define PM_TRAINER_PROPOSE_DRAFT_H

#include <stdio.h>

#include "propose/propose.h"
#include "propose/search.h"
#include "propose/view.h"

// What may be asked about a subsystem, a port or the whole scene. Units, ports and statistics give
// the first answer; PM_AS_FOUND is that answer.
typedef enum pm_question {
    PM_ASK_REVERSIBLE,  // what L couples, and what its entries depend on
    PM_ASK_FRICTION,    // what it acts on
    PM_ASK_DIRECTIONS,  // what the directions of friction depend on
    PM_ASK_STRENGTH,    // what the strengths of dissipative processes depend on
    PM_ASK_HEAT,        // what the thermal energy depends on
    PM_ASK_ENERGY,      // how the energy depends on vectors
    PM_ASK_ANGLE,       // how functions depend on angles
    PM_ASK_KINETIC,     // which variables share a term of the energy
    PM_ASK_TEMPERATURE, // of the scene: the temperatures with which training starts
    PM_ASK_SIZE,        // of the scene: of networks, and how many processes conduct heat
    PM_QUESTIONS
} pm_question;

typedef enum pm_answer {
    PM_AS_FOUND,
    PM_CONSTANT,     // learned constants, among all that may be coupled
    PM_BY_POSITIONS, // functions of what keeps its sign when time runs backwards
    PM_BY_STATES,    // functions of all variables but entropies
    PM_BY_COENERGIES,
    PM_NONE,
    PM_ALONE, // the entropy alone
    PM_BY_COMPONENTS,
    PM_BY_BOTH, // lengths and components
    PM_BY_SINES,
    PM_JOINT,     // one function of all variables
    PM_SEPARATE,  // a function of each variable, as in networks of stores
    PM_QUADRATIC, // a quadratic form of what changes its sign when time runs backwards, else that
    PM_MIXTURE,   // those of an ideal mixture of species with constant heat capacities
    PM_OF_MOTION, // on what changes its sign when time runs backwards
    PM_REDUCED,   // 1 K, not 300 K
    PM_LARGE,     // networks that are twice as wide, and heat between any two bodies
    PM_EXCHANGE,  // what leaves one end of a port enters the other
    PM_BY_FORCES  // functions of what drives each process, and of entropies
} pm_answer;

typedef struct pm_draft {
    FILE *file;
    const pm_proposal *p;
    pm_look look;
    pm_part_view *part;  // [nsubsystem]
    pm_rotation rotates; // if not PM_ROTATION_NONE, the dynamics do not depend on directions
    pm_hypotheses space;
    int (
        *asked)[PM_QUESTIONS]; // [nsubsystem + nport] the choice, or -1; the scene's are those of 0
    pm_answer answer[PM_SEARCH_CHOICES][PM_SEARCH_ALTERNATIVES]; // of each alternative
    bool free_scale;   // nothing fixes the scale of energies; pm_draft_ask sets it
    const char *start; // the file with which the fit starts (search.h); NULL: it draws
    const int *chosen; // [space.count] the alternatives of this file; NULL: the first ones
} pm_draft;

// These functions write the model of a subsystem and of a port.
void pm_draft_part(const pm_draft *draft, const pm_part_view *part);
void pm_draft_port(const pm_draft *draft, int port);

// Finds the groups of end b of a port that may gain what those of end a lose: friction may act on
// both, and their units and sizes are the same. Writes partner [groups of a that the port shows],
// the group of b, or -1. Returns how many there are.
int pm_draft_exchange(const pm_draft *draft, int port, int partner[PM_MAX_GROUPS]);

// Returns true if a column of the data gives something of this group of a boundary input: its value
// (`which` is 0), its dE (1) or its dS (2).
bool pm_draft_follows(const pm_scene_boundary_input *input, const pm_group *group, int which);

// Fills draft->space with the hypotheses about all subsystems and ports that need a model. The
// other members must be complete.
void pm_draft_ask(pm_draft *draft);
// Returns what is chosen about subsystem `component`, or port component - nsubsystem.
static inline pm_answer pm_draft_answer(const pm_draft *d, pm_question question, int component) {
    const int id = d->asked[component][question];
    return id < 0 ? PM_AS_FOUND : d->answer[id][d->chosen == NULL ? 0 : d->chosen[id]];
}

#endif

// Writes a scene and training files for the columns of a logger. What the columns do not show
// stands in a list of choices, each with its alternatives in the order in which they are believed.
#ifndef PM_TRAINER_PROPOSE_LOGGER_DRAFT_H
#define PM_TRAINER_PROPOSE_LOGGER_DRAFT_H

#include "propose/logger_view.h"

#define PM_LOGGER_ALTERNATIVES 5

// What is chosen.
typedef enum pm_logger_choice {
    PM_LOGGER_FRICTION,   // how friction and resistance depend on what flows
    PM_LOGGER_POTENTIAL,  // the energy of positions
    PM_LOGGER_INERTIA,    // whether inertia depends on positions
    PM_LOGGER_COUPLING,   // whether what couples flows depends on them
    PM_LOGGER_CAPACITY,   // whether capacities depend on temperatures and on other co-energies
    PM_LOGGER_CONDUCTION, // how conduction depends on temperatures
    PM_LOGGER_SHARING,    // whether like co-energies share an inertia or a capacity
    PM_LOGGER_LEVELS,     // how the flow between levels depends on them
    PM_LOGGER_HOLD,       // what inputs are between samples: a choice of the scene
    PM_LOGGER_NCHOICE
} pm_logger_choice;

typedef struct pm_logger_draft {
    pm_logger_view view;
    const char *scene_path, *data_path;
    int seed;
    int most; // for a trial: the first trajectories, as measurements; 0: all
    // For a trial: of so many records each is divided, and two of five pieces are kept back; 0:
    // none.
    int divided;
    double coarse;     // what the steps of a trial cost (pm_fit_score); 0: not known
    const char *found; // where constants begin (pm_search_trial); NULL: where regressions put them
    bool lean;         // without the constants of `found` that are spare
    bool ended;        // `found` is where a fit ended: the next one begins with whole trajectories
} pm_logger_draft;

// Returns the number of alternatives that the columns leave for a choice, 1 if there is nothing to
// choose, and writes the name of the choice to *name and the names of the alternatives to
// *alternative; the texts are static.
int pm_logger_alternatives(const pm_logger_view *view, pm_logger_choice which, const char **name,
                           const char *const **alternative);

// Writes the scene. PM_EFILE.
pm_status pm_logger_write_scene(const pm_logger_draft *draft, const char *path);
// Writes the training file of chosen [PM_LOGGER_NCHOICE], with `comment` at its head. PM_EFILE.
pm_status pm_logger_write_training(const pm_logger_draft *draft, const int *chosen,
                                   const char *comment, const char *path);

#endif

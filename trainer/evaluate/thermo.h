// What thermodynamics is about, scored over the rollouts of an evaluation: the entropy that is
// produced, and what flows into each part and through each port. Truth is what the model makes of
// the true states: its own energies and entropies there. Where an entropy is a given variable of
// the state, that is the truth itself.
#ifndef PM_TRAINER_EVALUATE_THERMO_H
#define PM_TRAINER_EVALUATE_THERMO_H

#include "evaluate/evaluate.h"

// One quantity over all rollouts.
typedef struct pm_thermo_row {
    const char *kind; // "production", "energy", "entropy" of a part, "power" of a port
    const char *name; // of the part or port; "" for the whole system
    // Magnitudes of the relative errors, one per rollout: median, mean, largest; and the median of
    // the signed ones (of the production alone, else 0). Infinite where rollouts were not finite.
    double median, mean, largest, bias;
    double typical; // the median magnitude of the true quantity, J, J/K or W
} pm_thermo_row;

typedef struct pm_thermo {
    pm_arena arena;
    int count;
    pm_thermo_row *row;      // [count]
    double coldest, warmest; // K, over all rollouts; both 0 where there is no entropy
    bool given;              // every part's entropy is given, or a formula: its truth is known
} pm_thermo;

// The production is the change of the total entropy over a rollout; with loads, of the parts alone.
// The energy and the entropy of a part: its change since the beginning, as a relative L2 error over
// time. The power of a port, W, where energies of parts decide it: where no ports close a ring, and
// none is a load; likewise, over the steps. There are no rows where energy is not defined.
// PM_ENOMEM. The caller frees.
pm_status pm_thermo_make(pm_thermo *thermo, const pm_evaluation *evaluation);
void pm_thermo_free(pm_thermo *thermo);

#endif

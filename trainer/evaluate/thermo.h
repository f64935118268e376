// Scores the thermodynamic quantities of the rollouts of an evaluation: the entropy produced, the
// energy and entropy of each subsystem, and the power through each port. The reference values are
// the model's own energies and entropies in the true states; the inner variables of a solid there
// follow from the true displacements. Where an entropy is a given variable
// of the state, its reference value is the truth itself.
#ifndef PM_TRAINER_EVALUATE_THERMO_H
#define PM_TRAINER_EVALUATE_THERMO_H

#include "evaluate/evaluate.h"

// One quantity over all rollouts.
typedef struct pm_thermo_row {
    const char *kind; // "production", "energy" or "entropy" of a subsystem, "power" of a port
    const char *name; // of the subsystem or port; "" for the whole system
    // Median, mean and largest of the absolute relative errors over all rollouts. `bias` is the
    // median of the signed errors of the production (0 for other rows). Infinite if a rollout is
    // not finite.
    double median, mean, largest, bias;
    double typical; // the median absolute reference value, J, J/K or W
} pm_thermo_row;

typedef struct pm_thermo {
    pm_arena arena;
    int count;
    pm_thermo_row *row;      // [count] rows of one kind, with the same pointer `kind`, together
    double coldest, warmest; // K, over all rollouts; both 0 if there is no entropy
    bool given;              // the entropy of every subsystem is given or a formula
    // By which fraction all temperatures are too high, as the balance of energy shows: a closed
    // system keeps its energy, so that the energy of the model must not change along the true
    // states. The median over rollouts of this change, divided by the heat produced; 0 where the
    // signs differ between rollouts; NAN: not known, or a boundary input exchanges energy.
    double warmer;
} pm_thermo;

// Computes these rows:
// - production: the change of the total entropy over a rollout. With boundary inputs it is the
//   change of the entropy of the subsystems alone.
// - energy, entropy: the change of a subsystem's energy or entropy since the beginning, as a
//   relative L2 error over time.
// - power: the mean power through a port over each step, W, as a relative L2 error over time. The
//   energies of the subsystems determine it only if the port belongs to no ring of ports and no
//   boundary input is connected with it; other ports have no row.
// There are no rows if energy is not defined. The caller frees. PM_ENOMEM.
pm_status pm_thermo_make(pm_thermo *thermo, const pm_evaluation *evaluation);
void pm_thermo_free(pm_thermo *thermo);

// Summarises `count` rows of one kind. `sum` receives the median of their medians, the mean of
// their means, the largest of their largest errors and the median of their typical values, under
// the name "". `worst` receives the row with the largest median. PM_ENOMEM.
pm_status pm_thermo_summarise(const pm_thermo_row *row, int count, pm_thermo_row *sum,
                              pm_thermo_row *worst);

#endif

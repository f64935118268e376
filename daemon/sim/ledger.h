// The ledger of both laws over a run. Per step and port, with the fluxes into a and into b:
//     energy residual   |energy_a + energy_b| / max(gross_a, gross_b)
//     entropy residual  (entropy_a + entropy_b) / max(gross_a, gross_b), negative: violation
// and per subsystem the same of the bulk term: dE . zdot_bulk = 0, dS . zdot_bulk >= 0.
// The gross flux (recording.h) is the sum of the magnitudes that cancel, so that a residual of a
// few units in 1e-16 is rounding, and nothing else is. A gross flux below a trillionth of the
// step's largest is rounding itself, and has residuals 0.
//
// A load's port is balanced like any other, with the world at one end. What went out to the world
// is kept as if it were one more subsystem's, so that the totals stay those of a closed system.
#ifndef PM_SIM_LEDGER_H
#define PM_SIM_LEDGER_H

#include "scene/recording.h"
#include "scene/system.h"

typedef struct pm_ledger {
    const pm_system *system;
    long steps;
    double first_energy, energy;        // J, total at the first and the last sample
    double first_entropy, entropy;      // J/K
    double energy_drift;                // J, largest |total E - first total E|
    double world_energy, world_entropy; // of these what loads have given to the world
    double worst_energy, worst_entropy; // largest energy residual; smallest entropy residual (<= 0)
    long worst_energy_step, worst_entropy_step;
    const char *worst_energy_at, *worst_entropy_at; // name of the port or subsystem; NULL: none
    double worst_entropy_fall; // J/K, largest fall of total S over one step (>= 0)
    long violations;           // steps with a residual beyond the scene's tolerances
} pm_ledger;

void pm_ledger_init(pm_ledger *ledger, const pm_system *system);

// Books a sample (step 0 first) and sets its residuals and what the world has. PM_ELAW when a hard
// component violates a law beyond the scene's tolerance: names it, the step and the residual. Soft
// ones are only counted. PM_ENUMERIC when the total energy has strayed further than the scene's
// guard allows.
pm_status pm_ledger_book(pm_ledger *ledger, pm_sample *sample);

// What it must remember to go on after a step.
#define PM_LEDGER_MEMORY 16 // numbers
void pm_ledger_save(const pm_ledger *ledger, double *memory);
void pm_ledger_restore(pm_ledger *ledger, const double *memory);

#endif

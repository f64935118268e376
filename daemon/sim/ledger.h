// The ledger checks conservation of energy and growth of entropy over a run. For each step and
// port, with the fluxes into ends a and b:
//     energy residual   |energy_a + energy_b| / max(gross_a, gross_b)
//     entropy residual  (entropy_a + entropy_b) / max(gross_a, gross_b); negative: a violation
// and for each subsystem the residuals of dE . zdot_bulk = 0 and dS . zdot_bulk >= 0. The gross
// flux (scene/recording.h) sums the magnitudes that cancel, so that rounding leaves a residual of a
// few units in 1e-16. Where a gross flux is below about 1e-12 of the step's largest (tally.h), it
// is rounding itself, and the residuals count as 0.
//
// The energy residual of a whole step compares how far the total energy has changed with what was
// booked:
//     |E' - E - h sum of all energy fluxes| / (sum of |E_i| + h sum of all gross energy fluxes)
// It is the error of the integrator. An integrator that is discrete or balanced (integrator.h)
// keeps it at rounding. Where it exceeds the scene's tolerance, the iteration of such a method has
// not converged, and the step counts as a violation. For other methods it is only measured.
//
// A port with a boundary input is balanced like any other. The energy and entropy that left through
// it are counted as the content of one more subsystem, so that the totals are those of a closed
// system.
//
// Life cycle: init; enter every sample with pm_ledger_add_sample or pm_ledger_add_sums, from step 0
// on. The ledger owns no memory.
#ifndef PM_SIM_LEDGER_H
#define PM_SIM_LEDGER_H

#include "base/serializer.h"
#include "scene/recording.h"
#include "scene/system.h"
#include "sim/tally.h"

typedef struct pm_ledger {
    const pm_system *system; // borrowed
    bool has_energy;         // every subsystem has one
    long steps;
    double first_energy, energy;            // J, total at the first and at the last sample
    double first_entropy, entropy;          // J/K, likewise
    double energy_drift;                    // J, largest |total E - first total E|
    double outside_energy, outside_entropy; // J, J/K: share of the totals that left to the outside
    double worst_energy, worst_entropy; // largest energy residual; smallest entropy residual (<= 0)
    long worst_energy_step, worst_entropy_step;
    int worst_energy_place, worst_entropy_place; // of the port or subsystem (tally.h); -1: none
    double worst_entropy_fall; // J/K, largest fall of the total S over one step (>= 0)
    double worst_step;         // largest energy residual of a whole step
    long worst_step_at;
    long unbalanced; // steps whose energy residual exceeds the tolerance, with an integrator that
                     // keeps the energy
    long violations; // steps with any residual beyond the scene's tolerances, unbalanced ones too
} pm_ledger;

void pm_ledger_init(pm_ledger *ledger, const pm_system *system);

// Returns the name of the port or subsystem at a place; NULL: there is none.
const char *pm_ledger_name(const pm_ledger *ledger, int place);

// Enters a sample in the ledger. Writes into the sample what the ledger knows of the step
// (scene/recording.h). PM_ELAW: a component in the hard form violates a law beyond the scene's
// tolerance; the message names the worst one, the step and the residual. Violations of soft
// components are only counted. PM_ENUMERIC: the total energy has drifted further than the scene's
// guard allows.
pm_status pm_ledger_add_sample(pm_ledger *ledger, pm_sample *sample);
// Does the same for a step that was summed up in a tally of the whole scene. Of the sample it needs
// the step, and the fluxes into boundary inputs.
pm_status pm_ledger_add_sums(pm_ledger *ledger, pm_sample *sample, const pm_tally *tally);

// Notes that somebody has changed the state after the last sample. The tally has the energy and the
// entropy of the state since then: the difference came from the outside, so that the totals stay.
void pm_ledger_note_outside(pm_ledger *ledger, const pm_tally *tally);

// Puts into the serializer all numbers with which the ledger continues after a step.
void pm_ledger_record(pm_ledger *ledger, pm_serializer *serializer);

#endif

// The residuals of energy and of entropy, step by step, and the totals.
#include "sim/ledger.h"

#include <math.h>
#include <string.h>

void pm_ledger_init(pm_ledger *ledger, const pm_system *system) {
    *ledger = (pm_ledger){.system = system,
                          .has_energy = pm_system_without_energy(system) < 0,
                          .worst_energy_place = -1,
                          .worst_entropy_place = -1};
}

const char *pm_ledger_name(const pm_ledger *ledger, int place) {
    const pm_scene *scene = ledger->system->scene;
    if (place < 0 || place >= scene->physics.nport + scene->physics.nsubsystem) {
        return NULL;
    }
    return place < scene->physics.nport
               ? scene->physics.port[place].name
               : scene->physics.subsystem[place - scene->physics.nport].name;
}

// Enters the residual of the whole step, in which the total energy has become `energy`. Returns
// true if the integrator promises to keep it at rounding, and has not.
static bool book_step(pm_ledger *ledger, const pm_sample *sample, const pm_tally *tally,
                      double energy) {
    const pm_scene *scene = ledger->system->scene;
    if (!ledger->has_energy) {
        return false;
    }
    const double booked = scene->physics.dt * pm_reproducible_sum_value(&tally->booked);
    const double gross = fabs(ledger->outside_energy) +
                         pm_reproducible_sum_value(&tally->magnitude) +
                         scene->physics.dt * pm_reproducible_sum_value(&tally->gross);
    const double error = fabs(energy - ledger->energy - booked);
    const double relative_error = gross > 0 ? error / gross : 0;
    if (relative_error > ledger->worst_step) {
        ledger->worst_step = relative_error;
        ledger->worst_step_at = sample->step;
    }
    const bool unbalanced = pm_integrator_keeps_energy(scene->physics.integrator) &&
                            relative_error > scene->run.energy_tolerance;
    ledger->unbalanced += unbalanced ? 1 : 0;
    return unbalanced;
}

// Returns true if the integrator has not kept the energy that it promises to keep.
static bool book_totals(pm_ledger *ledger, pm_sample *sample, const pm_tally *tally) {
    const pm_scene *scene = ledger->system->scene;
    // Adds what left to the outside during the step, through ports with a boundary input.
    for (int i = 0; i < 2 * scene->physics.nport && scene->physics.nboundary_input > 0; ++i) {
        const pm_flux *flux = &sample->flux[i / 2][i % 2];
        if (scene->physics.port[i / 2].boundary_input[i % 2] >= 0) {
            ledger->outside_energy += scene->physics.dt * flux->energy;
            ledger->outside_entropy += scene->physics.dt * flux->entropy;
        }
    }
    sample->outside_energy = ledger->outside_energy;
    sample->outside_entropy = ledger->outside_entropy;
    bool unbalanced = false;
    const double energy = pm_reproducible_sum_value(&tally->energy) + ledger->outside_energy;
    const double entropy = pm_reproducible_sum_value(&tally->entropy) + ledger->outside_entropy;
    if (sample->step == 0) {
        ledger->first_energy = energy;
        ledger->first_entropy = entropy;
    } else {
        ledger->worst_entropy_fall = fmax(ledger->worst_entropy_fall, ledger->entropy - entropy);
        unbalanced = book_step(ledger, sample, tally, energy);
    }
    ledger->energy_drift = fmax(ledger->energy_drift, fabs(energy - ledger->first_energy));
    ledger->energy = energy;
    ledger->entropy = entropy;
    ledger->steps = sample->step;
    return unbalanced;
}

// Enters the worst residuals of a law. Returns the worst one of the hard components, and in
// `residual` that of all.
static pm_tally_worst worst_of(const pm_tally *tally, pm_tally_law law, pm_tally_worst *residual) {
    const pm_tally_worst hard = pm_tally_worst_of(tally, law, PM_TALLY_HARD);
    const pm_tally_worst soft = pm_tally_worst_of(tally, law, PM_TALLY_SOFT);
    const bool first = hard.place < soft.place;
    *residual =
        hard.residual > soft.residual || (hard.residual == soft.residual && first) ? hard : soft;
    return hard;
}

// Fails if a component that keeps a law by construction has violated it.
static pm_status check_hard(const pm_ledger *ledger, const pm_sample *sample, const char *law,
                            pm_tally_worst hard, double tolerance) {
    return hard.residual > tolerance
               ? pm_fail(PM_ELAW,
                         "step %ld, %s: %s residual %.3g (allowed %.3g) in a component that keeps "
                         "both laws by construction",
                         sample->step, pm_ledger_name(ledger, (int)hard.place), law, hard.residual,
                         tolerance)
               : PM_OK;
}

static pm_status book_residuals(pm_ledger *ledger, pm_sample *sample, const pm_tally *tally,
                                bool violated) {
    const pm_scene *scene = ledger->system->scene;
    pm_tally_worst energy, entropy;
    const pm_tally_worst hard_energy = worst_of(tally, PM_TALLY_ENERGY, &energy);
    const pm_tally_worst hard_entropy = worst_of(tally, PM_TALLY_ENTROPY, &entropy);
    sample->energy_residual = energy.residual;
    sample->entropy_residual = 0 - entropy.residual;
    if (energy.residual > ledger->worst_energy) {
        ledger->worst_energy = energy.residual;
        ledger->worst_energy_step = sample->step;
        ledger->worst_energy_place = (int)energy.place;
    }
    if (-entropy.residual < ledger->worst_entropy) {
        ledger->worst_entropy = -entropy.residual;
        ledger->worst_entropy_step = sample->step;
        ledger->worst_entropy_place = (int)entropy.place;
    }
    ledger->violations += violated || energy.residual > scene->run.energy_tolerance ||
                          entropy.residual > scene->run.entropy_tolerance;
    PM_TRY(check_hard(ledger, sample, "energy", hard_energy, scene->run.energy_tolerance));
    return check_hard(ledger, sample, "entropy", hard_entropy, scene->run.entropy_tolerance);
}

pm_status pm_ledger_add_sums(pm_ledger *ledger, pm_sample *sample, const pm_tally *tally) {
    sample->evaluated_in_all = (long)tally->evaluated;
    sample->skipped_in_all = (long)tally->skipped;
    sample->nout_of_range = (int)tally->nout_of_range;
    sample->worst_subsystem = (int)tally->worst_subsystem;
    sample->worst_steps = (long)tally->worst_steps;
    const bool unbalanced = book_totals(ledger, sample, tally);
    PM_TRY(book_residuals(ledger, sample, tally, unbalanced));
    // A step that is too long for the integrator: the fluxes of every component obey the laws, but
    // the energy of the states changes.
    const double most = ledger->system->scene->run.largest_drift;
    return ledger->energy_drift > most
               ? pm_fail(PM_ENUMERIC,
                         "step %ld: the total energy has drifted by %.3g J, and the scene's guard "
                         "allows %.3g: try a smaller dt, more substeps, or an integrator that is "
                         "balanced",
                         ledger->steps, ledger->energy_drift, most)
               : PM_OK;
}

pm_status pm_ledger_add_sample(pm_ledger *ledger, pm_sample *sample) {
    pm_tally tally = {0};
    pm_tally_add_subsystems(&tally, ledger->system, sample);
    pm_tally_add_ports(&tally, ledger->system, sample, ledger->system->scene->physics.nport, NULL);
    return pm_ledger_add_sums(ledger, sample, &tally);
}

void pm_ledger_note_outside(pm_ledger *ledger, const pm_tally *tally) {
    ledger->outside_energy = ledger->energy - pm_reproducible_sum_value(&tally->energy);
    ledger->outside_entropy = ledger->entropy - pm_reproducible_sum_value(&tally->entropy);
}

// --- checkpoint ---

void pm_ledger_record(pm_ledger *l, pm_serializer *serializer) {
    pm_serializer_put_long(serializer, "steps", &l->steps);
    pm_serializer_put(serializer, "first energy", &l->first_energy, 1);
    pm_serializer_put(serializer, "energy", &l->energy, 1);
    pm_serializer_put(serializer, "first entropy", &l->first_entropy, 1);
    pm_serializer_put(serializer, "entropy", &l->entropy, 1);
    pm_serializer_put(serializer, "energy drift", &l->energy_drift, 1);
    pm_serializer_put(serializer, "outside energy", &l->outside_energy, 1);
    pm_serializer_put(serializer, "outside entropy", &l->outside_entropy, 1);
    pm_serializer_put(serializer, "worst energy", &l->worst_energy, 1);
    pm_serializer_put(serializer, "worst entropy", &l->worst_entropy, 1);
    pm_serializer_put_long(serializer, "worst energy step", &l->worst_energy_step);
    pm_serializer_put_long(serializer, "worst entropy step", &l->worst_entropy_step);
    pm_serializer_put_int(serializer, "worst energy at", &l->worst_energy_place);
    pm_serializer_put_int(serializer, "worst entropy at", &l->worst_entropy_place);
    pm_serializer_put(serializer, "worst entropy fall", &l->worst_entropy_fall, 1);
    pm_serializer_put(serializer, "worst step", &l->worst_step, 1);
    pm_serializer_put_long(serializer, "worst step at", &l->worst_step_at);
    pm_serializer_put_long(serializer, "unbalanced", &l->unbalanced);
    pm_serializer_put_long(serializer, "violations", &l->violations);
}

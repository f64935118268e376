// The residuals of energy and of entropy, step by step, and the totals.
#include "sim/ledger.h"

#include <math.h>
#include <string.h>

#include "model/port.h"

// A gross flux below this fraction of the step's largest counts as rounding. Where the projections
// of README.md, equation (2), remove an entire rate, only rounding of either sign remains.
#define SMALLEST_SHARE 1e-12
// W and W/K: one Boltzmann constant per second, for systems in which every flux is such rounding.
#define SMALLEST_FLUX 1.380649e-23

void pm_ledger_init(pm_ledger *ledger, const pm_system *system) {
    *ledger = (pm_ledger){.system = system};
}

// fmax and fmin without a call into the C library, which took a tenth of a run of many links. If
// one number is not a number, the result is `b`.
static inline double larger(double a, double b) {
    return b > a ? b : a;
}

static inline double smaller(double a, double b) {
    return b < a ? b : a;
}

// The residuals of one port or bulk term over a step, relative to its gross flux.
typedef struct residual {
    double energy, entropy;
    bool hard; // holds by construction: a violation is an error
    const char *name;
} residual;

// The largest gross fluxes of a step over all ports and bulk terms, in W and W/K.
typedef struct turnover {
    double energy, entropy;
} turnover;

static turnover turnover_of(const pm_scene *scene, const pm_sample *sample) {
    turnover t = {0, 0};
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            t.energy = larger(t.energy, sample->flux[i][end].energy_gross);
            t.entropy = larger(t.entropy, sample->flux[i][end].entropy_gross);
        }
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        t.energy = larger(t.energy, sample->bulk_gross[2 * i]);
        t.entropy = larger(t.entropy, sample->bulk_gross[2 * i + 1]);
    }
    return t;
}

static double relative(double value, double gross, double largest) {
    return gross > larger(SMALLEST_SHARE * largest, SMALLEST_FLUX) ? value / gross : 0;
}

static residual residual_of_port(const pm_ledger *ledger, const pm_sample *sample, turnover t,
                                 int i) {
    const pm_flux *a = &sample->flux[i][0], *b = &sample->flux[i][1];
    const pm_port_model *model = ledger->system->port[i];
    return (residual){
        relative(fabs(a->energy + b->energy), larger(a->energy_gross, b->energy_gross), t.energy),
        relative(a->entropy + b->entropy, larger(a->entropy_gross, b->entropy_gross), t.entropy),
        model->law->conservative && model->spec.form == PM_HARD,
        ledger->system->scene->port[i].name,
    };
}

static residual residual_of_bulk(const pm_ledger *ledger, const pm_sample *sample, turnover t,
                                 int i) {
    const double *gross = &sample->bulk_gross[2 * i];
    return (residual){
        relative(fabs(sample->bulk_energy[i]), gross[0], t.energy),
        relative(sample->bulk_entropy[i], gross[1], t.entropy),
        ledger->system->part[i]->spec.form == PM_HARD,
        ledger->system->scene->subsystem[i].name,
    };
}

// Enters one residual in the ledger. Returns true if it exceeds the scene's tolerances.
static bool book_residual(pm_ledger *ledger, pm_sample *sample, const residual *b) {
    sample->energy_residual = larger(sample->energy_residual, b->energy);
    sample->entropy_residual = smaller(sample->entropy_residual, b->entropy);
    if (b->energy > ledger->worst_energy) {
        ledger->worst_energy = b->energy;
        ledger->worst_energy_step = sample->step;
        ledger->worst_energy_at = b->name;
    }
    if (b->entropy < ledger->worst_entropy) {
        ledger->worst_entropy = b->entropy;
        ledger->worst_entropy_step = sample->step;
        ledger->worst_entropy_at = b->name;
    }
    const pm_scene *scene = ledger->system->scene;
    return b->energy > scene->energy_tolerance || b->entropy < -scene->entropy_tolerance;
}

static pm_status fail(const pm_ledger *ledger, const pm_sample *sample, const residual *b) {
    return pm_fail(PM_ELAW,
                   "step %ld, %s: energy residual %.3g (allowed %.3g), entropy residual %.3g "
                   "(allowed %.3g) in a component that keeps both laws by construction",
                   sample->step, b->name, b->energy, ledger->system->scene->energy_tolerance,
                   b->entropy, -ledger->system->scene->entropy_tolerance);
}

// Adds the energy and entropy that left to the outside during the step, through ports with a
// boundary input.
static void book_outside(pm_ledger *ledger, pm_sample *sample) {
    const pm_scene *scene = ledger->system->scene;
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            if (scene->port[i].boundary_input[end] >= 0) {
                ledger->outside_energy += scene->dt * sample->flux[i][end].energy;
                ledger->outside_entropy += scene->dt * sample->flux[i][end].entropy;
            }
        }
    }
    sample->outside_energy = ledger->outside_energy;
    sample->outside_entropy = ledger->outside_entropy;
}

bool pm_ledger_integrator_keeps_energy(const pm_integrator *integrator) {
    return integrator->discrete || integrator->balanced;
}

// Returns the energy that all ports and bulk terms have booked during the step, in J, and adds the
// magnitudes of its terms to `gross`. In the hard form it is rounding.
static double booked_energy(const pm_scene *scene, const pm_sample *sample, double *gross) {
    double sum = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        sum += sample->bulk_energy[i];
        *gross += scene->dt * sample->bulk_gross[2 * i];
    }
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            sum += sample->flux[i][end].energy;
            *gross += scene->dt * sample->flux[i][end].energy_gross;
        }
    }
    return scene->dt * sum;
}

// Enters the residual of the whole step, in which the total energy has become `energy`. Returns
// true if the integrator promises to keep it at rounding, and has not.
static bool book_step(pm_ledger *ledger, const pm_sample *sample, double energy) {
    const pm_scene *scene = ledger->system->scene;
    if (pm_system_without_energy(ledger->system) >= 0) {
        return false;
    }
    double gross = fabs(ledger->outside_energy);
    for (int i = 0; i < scene->nsubsystem; ++i) {
        gross += fabs(sample->energy[i]);
    }
    const double error = fabs(energy - ledger->energy - booked_energy(scene, sample, &gross));
    const double relative_error = gross > 0 ? error / gross : 0;
    if (relative_error > ledger->worst_step) {
        ledger->worst_step = relative_error;
        ledger->worst_step_at = sample->step;
    }
    const bool unbalanced = pm_ledger_integrator_keeps_energy(scene->integrator) &&
                            relative_error > scene->energy_tolerance;
    ledger->unbalanced += unbalanced ? 1 : 0;
    return unbalanced;
}

// Returns true if the integrator has not kept the energy that it promises to keep.
static bool book_totals(pm_ledger *ledger, pm_sample *sample) {
    book_outside(ledger, sample);
    bool unbalanced = false;
    double energy = ledger->outside_energy, entropy = ledger->outside_entropy;
    for (int i = 0; i < ledger->system->scene->nsubsystem; ++i) {
        energy += sample->energy[i];
        entropy += sample->entropy[i];
    }
    if (sample->step == 0) {
        ledger->first_energy = energy;
        ledger->first_entropy = entropy;
    } else {
        ledger->worst_entropy_fall = larger(ledger->worst_entropy_fall, ledger->entropy - entropy);
        unbalanced = book_step(ledger, sample, energy);
    }
    ledger->energy_drift = larger(ledger->energy_drift, fabs(energy - ledger->first_energy));
    ledger->energy = energy;
    ledger->entropy = entropy;
    ledger->steps = sample->step;
    return unbalanced;
}

// Fails if the total energy has drifted too far. This catches a step that is too long for the
// integrator: the fluxes of every component then obey the laws, but the energy of the states
// changes.
static pm_status check_drift(const pm_ledger *ledger) {
    const pm_scene *scene = ledger->system->scene;
    if (!(ledger->energy_drift > scene->largest_drift)) {
        return PM_OK;
    }
    return pm_fail(PM_ENUMERIC,
                   "step %ld: the total energy has drifted by %.3g J, and the scene's guard allows "
                   "%.3g: try a smaller dt, more substeps, or an integrator that is balanced",
                   ledger->steps, ledger->energy_drift, scene->largest_drift);
}

pm_status pm_ledger_book(pm_ledger *ledger, pm_sample *sample) {
    const pm_scene *scene = ledger->system->scene;
    sample->energy_residual = sample->entropy_residual = 0;
    bool violated = book_totals(ledger, sample);
    const turnover t = turnover_of(scene, sample);
    pm_status status = PM_OK;
    for (int i = 0; i < scene->nport + scene->nsubsystem; ++i) {
        const residual b = i < scene->nport ? residual_of_port(ledger, sample, t, i)
                                            : residual_of_bulk(ledger, sample, t, i - scene->nport);
        if (book_residual(ledger, sample, &b)) {
            violated = true;
            if (b.hard && status == PM_OK) {
                status = fail(ledger, sample, &b);
            }
        }
    }
    ledger->violations += violated ? 1 : 0;
    return status == PM_OK ? check_drift(ledger) : status;
}

// --- checkpoint ---

// Returns the number of a port or subsystem, counting ports first, by its name; -1: none.
static double place_of(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nport; ++i) {
        if (scene->port[i].name == name) {
            return i;
        }
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (scene->subsystem[i].name == name) {
            return scene->nport + i;
        }
    }
    return -1;
}

static const char *name_at(const pm_scene *scene, double place) {
    if (!(place >= 0 && place < scene->nport + scene->nsubsystem)) {
        return NULL;
    }
    const int i = (int)place;
    return i < scene->nport ? scene->port[i].name : scene->subsystem[i - scene->nport].name;
}

// Puts the name of a port or subsystem as its number.
static void put_name(pm_record *record, const char *what, const pm_scene *scene,
                     const char **name) {
    double place = place_of(scene, *name);
    pm_record_put(record, what, &place, 1);
    *name = name_at(scene, place);
}

void pm_ledger_record(pm_ledger *l, pm_record *record) {
    const pm_scene *scene = l->system->scene;
    pm_record_put_long(record, "steps", &l->steps);
    pm_record_put(record, "first energy", &l->first_energy, 1);
    pm_record_put(record, "energy", &l->energy, 1);
    pm_record_put(record, "first entropy", &l->first_entropy, 1);
    pm_record_put(record, "entropy", &l->entropy, 1);
    pm_record_put(record, "energy drift", &l->energy_drift, 1);
    pm_record_put(record, "outside energy", &l->outside_energy, 1);
    pm_record_put(record, "outside entropy", &l->outside_entropy, 1);
    pm_record_put(record, "worst energy", &l->worst_energy, 1);
    pm_record_put(record, "worst entropy", &l->worst_entropy, 1);
    pm_record_put_long(record, "worst energy step", &l->worst_energy_step);
    pm_record_put_long(record, "worst entropy step", &l->worst_entropy_step);
    put_name(record, "worst energy at", scene, &l->worst_energy_at);
    put_name(record, "worst entropy at", scene, &l->worst_entropy_at);
    pm_record_put(record, "worst entropy fall", &l->worst_entropy_fall, 1);
    pm_record_put(record, "worst step", &l->worst_step, 1);
    pm_record_put_long(record, "worst step at", &l->worst_step_at);
    pm_record_put_long(record, "unbalanced", &l->unbalanced);
    pm_record_put_long(record, "violations", &l->violations);
}

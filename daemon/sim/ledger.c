// The residuals of both laws, step by step, and the totals.
#include "sim/ledger.h"

#include <math.h>
#include <string.h>

#include "model/port.h"

// A gross flux below this fraction of the step's largest may be the rounding of what cancels: where
// the projections of README.md, equation (2) remove a whole rate, its gross flux is rounding and
// has no sign.
#define SMALLEST_SHARE 1e-12
// W and W/K: one Boltzmann constant per second, for systems in which every flux is such rounding.
#define SMALLEST_FLUX 1.380649e-23

void pm_ledger_init(pm_ledger *ledger, const pm_system *system) {
    *ledger = (pm_ledger){.system = system};
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
            t.energy = fmax(t.energy, sample->flux[i][end].energy_gross);
            t.entropy = fmax(t.entropy, sample->flux[i][end].entropy_gross);
        }
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        t.energy = fmax(t.energy, sample->bulk_gross[2 * i]);
        t.entropy = fmax(t.entropy, sample->bulk_gross[2 * i + 1]);
    }
    return t;
}

static double relative(double value, double gross, double largest) {
    return gross > fmax(SMALLEST_SHARE * largest, SMALLEST_FLUX) ? value / gross : 0;
}

static residual residual_of_port(const pm_ledger *ledger, const pm_sample *sample, turnover t,
                                 int i) {
    const pm_flux *a = &sample->flux[i][0], *b = &sample->flux[i][1];
    const pm_port_model *model = &ledger->system->port[i];
    return (residual){
        relative(fabs(a->energy + b->energy), fmax(a->energy_gross, b->energy_gross), t.energy),
        relative(a->entropy + b->entropy, fmax(a->entropy_gross, b->entropy_gross), t.entropy),
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
        ledger->system->part[i].spec.form == PM_HARD,
        ledger->system->scene->subsystem[i].name,
    };
}

// Books one residual; true if it is beyond the scene's tolerances.
static bool book_residual(pm_ledger *ledger, pm_sample *sample, const residual *b) {
    sample->energy_residual = fmax(sample->energy_residual, b->energy);
    sample->entropy_residual = fmin(sample->entropy_residual, b->entropy);
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

// Books what left to the outside during the step, at the ends of ports with a boundary input.
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

static void book_totals(pm_ledger *ledger, pm_sample *sample) {
    book_outside(ledger, sample);
    double energy = ledger->outside_energy, entropy = ledger->outside_entropy;
    for (int i = 0; i < ledger->system->scene->nsubsystem; ++i) {
        energy += sample->energy[i];
        entropy += sample->entropy[i];
    }
    if (sample->step == 0) {
        ledger->first_energy = energy;
        ledger->first_entropy = entropy;
    } else {
        ledger->worst_entropy_fall = fmax(ledger->worst_entropy_fall, ledger->entropy - entropy);
    }
    ledger->energy_drift = fmax(ledger->energy_drift, fabs(energy - ledger->first_energy));
    ledger->energy = energy;
    ledger->entropy = entropy;
    ledger->steps = sample->step;
}

// Catches a step so long that the booked fluxes are not what the state did, although no component
// violates a law.
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
    book_totals(ledger, sample);
    const turnover t = turnover_of(scene, sample);
    bool violated = false;
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

void pm_ledger_save(const pm_ledger *ledger, double *memory) {
    const pm_scene *scene = ledger->system->scene;
    const double number[PM_LEDGER_MEMORY] = {
        (double)ledger->steps,
        ledger->first_energy,
        ledger->energy,
        ledger->first_entropy,
        ledger->entropy,
        ledger->energy_drift,
        ledger->outside_energy,
        ledger->outside_entropy,
        ledger->worst_energy,
        ledger->worst_entropy,
        (double)ledger->worst_energy_step,
        (double)ledger->worst_entropy_step,
        place_of(scene, ledger->worst_energy_at),
        place_of(scene, ledger->worst_entropy_at),
        ledger->worst_entropy_fall,
        (double)ledger->violations,
    };
    memcpy(memory, number, sizeof number);
}

void pm_ledger_restore(pm_ledger *ledger, const double *memory) {
    const pm_scene *scene = ledger->system->scene;
    *ledger = (pm_ledger){
        .system = ledger->system,
        .steps = (long)memory[0],
        .first_energy = memory[1],
        .energy = memory[2],
        .first_entropy = memory[3],
        .entropy = memory[4],
        .energy_drift = memory[5],
        .outside_energy = memory[6],
        .outside_entropy = memory[7],
        .worst_energy = memory[8],
        .worst_entropy = memory[9],
        .worst_energy_step = (long)memory[10],
        .worst_entropy_step = (long)memory[11],
        .worst_energy_at = name_at(scene, memory[12]),
        .worst_entropy_at = name_at(scene, memory[13]),
        .worst_entropy_fall = memory[14],
        .violations = (long)memory[15],
    };
}

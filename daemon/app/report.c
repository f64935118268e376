// Sums up the samples of a run and prints the tables.
#include "app/report.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/listed.h"
#include "base/progress.h"
#include "sim/score.h"

typedef struct energy_entropy {
    double energy, entropy; // sums over the steps, W and W/K
} energy_entropy;

struct pm_report {
    const pm_setup *setup;
    pm_arena arena;
    long steps;              // added, without the initial state
    long timed_from;         // the step at which `first` was taken
    double first, last;      // s, monotonic, when the first and the last sample came
    int nlisted;             // subsystems that the tables list: the first ones
    energy_entropy *bulk;    // [nlisted]
    energy_entropy *flux;    // [scene->first_end[nlisted]] through the ends of their ports
    long *outside;           // [nlisted] steps outside the training range, as of the last sample
    long evaluated, skipped; // terms, likewise
    int strayed, farthest;   // as in pm_sample
    long farthest_steps;
    int ncompared;        // states compared with the reference so far
    double *predicted;    // [ncolumn] the last of these states
    pm_score_sums *score; // [columns.ngroup] errors of these states
};

static pm_status allocate(pm_report *report) {
    const pm_setup *setup = report->setup;
    const pm_scene *scene = setup->scene;
    pm_arena *arena = &report->arena;
    const int n = scene->nsubsystem < PM_MOST_LISTED ? scene->nsubsystem : PM_MOST_LISTED;
    report->nlisted = n;
    report->bulk = pm_arena_array(arena, (size_t)n, sizeof report->bulk[0]);
    report->flux = pm_arena_array(arena, (size_t)scene->first_end[n], sizeof report->flux[0]);
    report->outside = pm_arena_array(arena, (size_t)n, sizeof report->outside[0]);
    if (setup->reference != NULL) {
        report->predicted =
            pm_arena_array(arena, (size_t)setup->reference->ncolumn, sizeof *report->predicted);
        report->score = pm_arena_array(arena, (size_t)setup->columns.ngroup, sizeof *report->score);
    }
    const bool complete =
        report->bulk != NULL && report->flux != NULL && report->outside != NULL &&
        (setup->reference == NULL || (report->predicted != NULL && report->score != NULL));
    return complete ? PM_OK : pm_fail(PM_ENOMEM, "report: out of memory");
}

pm_status pm_report_open(pm_report **report, const pm_setup *setup) {
    pm_report *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return pm_fail(PM_ENOMEM, "report: out of memory");
    }
    opened->setup = setup;
    const pm_status status = allocate(opened);
    if (status != PM_OK) {
        pm_report_close(opened);
        return status;
    }
    *report = opened;
    return PM_OK;
}

void pm_report_close(pm_report *report) {
    if (report != NULL) {
        pm_arena_free(&report->arena);
        free(report);
    }
}

static void score_prediction(pm_report *report, const pm_sample *sample) {
    const pm_setup *setup = report->setup;
    if (setup->reference == NULL || sample->step % setup->stride != 0) {
        return;
    }
    const long row = sample->step / setup->stride;
    if (row < setup->reference->ntime) {
        report->ncompared = (int)row + 1;
        pm_columns_to_row(&setup->columns, sample->z, report->predicted);
        for (int g = 0; g < setup->columns.ngroup; ++g) {
            pm_score_add(&setup->columns, g, report->predicted, pm_setup_truth(setup, (int)row),
                         &report->score[g]);
        }
    }
}

void pm_report_add(pm_report *report, const pm_sample *sample) {
    const pm_scene *scene = report->setup->scene;
    report->last = pm_clock();
    score_prediction(report, sample);
    if (sample->step == 0) {
        report->first = report->last;
        return;
    }
    report->steps = sample->step;
    report->evaluated = sample->evaluated_in_all;
    report->skipped = sample->skipped_in_all;
    report->strayed = sample->strayed;
    report->farthest = sample->farthest;
    report->farthest_steps = sample->farthest_steps;
    for (int i = 0; i < report->nlisted; ++i) {
        report->bulk[i].energy += sample->bulk_energy[i];
        report->bulk[i].entropy += sample->bulk_entropy[i];
        report->outside[i] = sample->outside[i];
    }
    for (int k = 0; k < scene->first_end[report->nlisted]; ++k) {
        const pm_flux *flux = &sample->flux[scene->end_at[k] / 2][scene->end_at[k] % 2];
        report->flux[k].energy += flux->energy;
        report->flux[k].entropy += flux->entropy;
    }
}

long pm_report_steps(const pm_report *report) {
    return report->steps;
}

// --- checkpoints ---

static void put_sums(pm_record *record, const char *name, energy_entropy *sums) {
    pm_record_put(record, name, &sums->energy, 1);
    pm_record_put(record, name, &sums->entropy, 1);
}

void pm_report_record(pm_report *report, pm_record *record) {
    const pm_setup *setup = report->setup;
    pm_record_put_long(record, "steps", &report->steps);
    pm_record_put_int(record, "compared", &report->ncompared);
    pm_record_put_long(record, "evaluated", &report->evaluated);
    pm_record_put_long(record, "skipped", &report->skipped);
    pm_record_put_int(record, "strayed", &report->strayed);
    pm_record_put_int(record, "farthest", &report->farthest);
    pm_record_put_long(record, "farthest steps", &report->farthest_steps);
    for (int i = 0; i < report->nlisted; ++i) {
        pm_record_put_long(record, "outside", &report->outside[i]);
        put_sums(record, "bulk", &report->bulk[i]);
    }
    for (int k = 0; k < setup->scene->first_end[report->nlisted]; ++k) {
        put_sums(record, "flux", &report->flux[k]);
    }
    for (int g = 0; report->score != NULL && g < setup->columns.ngroup; ++g) {
        pm_record_put(record, "error", &report->score[g].error, 1);
        pm_record_put(record, "norm", &report->score[g].norm, 1);
    }
    if (pm_record_restores(record)) {
        report->timed_from = report->steps;
        report->first = report->last = pm_clock();
    }
}

// --- tables ---

static void print_flux(const pm_report *report, int subsystem, const char *through,
                       energy_entropy sum) {
    const pm_setup *setup = report->setup;
    const double steps = report->steps > 0 ? (double)report->steps : 1;
    printf("  %-16s %-16s", setup->scene->subsystem[subsystem].name, through);
    if (pm_part_has_energy(setup->system->part[subsystem])) {
        printf(" %+15.6e", sum.energy / steps);
    } else {
        printf(" %15s", "no energy");
    }
    if (pm_part_has_entropy(setup->system->part[subsystem])) {
        printf(" %+15.6e\n", sum.entropy / steps);
    } else {
        printf(" %15s\n", "no entropy");
    }
}

static void print_fluxes(const pm_report *report) {
    const pm_scene *scene = report->setup->scene;
    printf("\n%-18s %-16s %15s %15s\n", "Mean flux into", "through", "energy, W", "entropy, W/K");
    for (int i = 0; i < report->nlisted; ++i) {
        for (int k = scene->first_end[i]; k < scene->first_end[i + 1]; ++k) {
            print_flux(report, i, scene->port[scene->end_at[k] / 2].name, report->flux[k]);
        }
        print_flux(report, i, "(its own bulk)", report->bulk[i]);
    }
    if (scene->nsubsystem > PM_MOST_LISTED) {
        printf("  and %d more subsystems; a recording has the fluxes of all\n",
               scene->nsubsystem - PM_MOST_LISTED);
    }
}

static void print_errors(const pm_report *report) {
    const pm_setup *setup = report->setup;
    if (setup->reference == NULL) {
        return;
    }
    printf("\nRelative L2 error over %d states of %s, trajectory %d\n", report->ncompared,
           setup->scene->reference, setup->scene->reference_trajectory);
    for (int i = 0; i < setup->columns.ngroup; ++i) {
        const char *name = setup->columns.group_name[i];
        const double score = pm_score_of(&report->score[i]);
        if (report->score[i].norm > 0) {
            printf("  %-16s %8.3f %%\n", name, 100 * score);
        } else {
            printf("  %-16s %8.3g, where the reference is zero\n", name, score);
        }
    }
}

static void print_total(const char *what, double start, double end) {
    printf("  %-16s %15.9g %15.9g %+15.3e\n", what, start, end, end - start);
}

static void print_worst(const char *what, double residual, double tolerance, const char *at,
                        long step) {
    printf("  %-16s %15.2e %15.0e", what, residual, tolerance);
    if (at == NULL) {
        printf("\n");
    } else {
        printf("   step %ld, %s\n", step, at);
    }
}

// Prints how well the integrator keeps the energy: to rounding by construction, or to its error.
static void print_step(const pm_scene *scene, const pm_ledger *ledger) {
    printf("  %-16s %15.2e ", "energy of a step", ledger->worst_step);
    if (pm_ledger_integrator_keeps_energy(scene->integrator)) {
        printf("%15.0e", scene->energy_tolerance);
    } else {
        printf("%15s", "none");
    }
    printf("   step %ld, %s\n", ledger->worst_step_at, scene->integrator->name);
    if (ledger->unbalanced > 0) {
        printf("  %s has not converged on %ld of %ld steps: take a smaller dt or more substeps\n",
               scene->integrator->name, ledger->unbalanced, ledger->steps);
    }
}

static void print_laws(const pm_report *report, const pm_ledger *ledger) {
    const pm_scene *scene = report->setup->scene;
    const int without = pm_system_without_energy(report->setup->system);
    if (without >= 0) {
        printf("\nBoth laws\n  not defined: %s is free of structure and has no energy\n",
               scene->subsystem[without].name);
        return;
    }
    printf("\n%-18s %15s %15s %15s\n", "Both laws", "start", "end", "change");
    print_total("energy, J", ledger->first_energy, ledger->energy);
    print_total("entropy, J/K", ledger->first_entropy, ledger->entropy);
    if (scene->nboundary_input > 0) {
        printf("  of these given to the outside %.6e J, %.6e J/K\n", ledger->outside_energy,
               ledger->outside_entropy);
    }
    printf("\n%-18s %15s %15s   %s\n", "Worst residual", "relative", "tolerance", "where");
    print_worst("energy", ledger->worst_energy, scene->energy_tolerance, ledger->worst_energy_at,
                ledger->worst_energy_step);
    print_worst("entropy", ledger->worst_entropy, scene->entropy_tolerance,
                ledger->worst_entropy_at, ledger->worst_entropy_step);
    print_step(scene, ledger);
    printf("  steps in violation: %ld; largest fall of the total entropy over a step: %.2e J/K\n",
           ledger->violations, ledger->worst_entropy_fall);
    printf("  largest drift of the total energy: %.2e J\n", ledger->energy_drift);
}

// Prints nothing if all states were in the training range, or if the weights do not hold it.
// Many subsystems are summed up in one line.
static void print_outside(const pm_report *report) {
    const pm_scene *scene = report->setup->scene;
    if (report->strayed > 0 && scene->nsubsystem > report->nlisted) {
        printf("\n%d of %d subsystems left the states their weights were trained on, %s on %ld of "
               "%ld steps\n",
               report->strayed, scene->nsubsystem, scene->subsystem[report->farthest].name,
               report->farthest_steps, report->steps);
        return;
    }
    for (int i = 0; i < report->nlisted; ++i) {
        if (report->outside[i] > 0) {
            printf("\n%s left the states its weights were trained on, on %ld of %ld steps",
                   scene->subsystem[i].name, report->outside[i], report->steps);
        }
    }
    printf("\n");
}

static const char *plural(int count) {
    return count == 1 ? "" : "s";
}

void pm_report_print_pace(const pm_report *report, const pm_pace *pace) {
    if (pace->interval > 0) {
        printf("Pace: %.6g simulated s per s; %lld of %ld steps ended after their deadline, by at "
               "most %.3g s\n",
               report->setup->scene->pace, (long long)pace->late, report->steps, pace->latest);
    }
}

void pm_report_print(const pm_report *report, const pm_ledger *ledger, const char *how,
                     double seconds) {
    const pm_scene *scene = report->setup->scene;
    printf("%s: %ld steps of %g s, %s with ", scene->name, report->steps, scene->dt,
           scene->integrator->name);
    if (scene->tolerance > 0) {
        printf("substeps for a tolerance of %g; ", scene->tolerance);
    } else {
        printf("%d substep%s; ", scene->substeps, plural(scene->substeps));
    }
    printf("%d subsystem%s, %d port%s; %s\n", scene->nsubsystem, plural(scene->nsubsystem),
           scene->nport, plural(scene->nport), how);
    print_fluxes(report);
    print_errors(report);
    print_laws(report, ledger);
    print_outside(report);
    const double stepping = report->last - report->first;
    printf("Speed: %.0f steps/s in %.3f s of stepping, %.3f s in all; terms evaluated %ld, "
           "skipped %ld\n",
           stepping > 0 ? (double)(report->steps - report->timed_from) / stepping : 0.0, stepping,
           seconds, report->evaluated, report->skipped);
}

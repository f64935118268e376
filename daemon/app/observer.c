// Passes samples from the coordinator to the terminal and to a file, and sums them up for the
// tables that a run prints at its end: mean fluxes, errors against the reference, the residuals of
// energy and entropy, and the speed.
#include "app/observer.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/notify.h"
#include "app/status.h"
#include "base/serializer.h"
#include "sim/score.h"

// --- the report ---

typedef struct energy_entropy {
    double energy, entropy; // sums over the steps, W and W/K
} energy_entropy;

struct pm_report {
    const pm_setup *setup;
    long steps;              // added, without the initial state
    long timed_from;         // the step at which `first` was taken
    double first, last;      // s, monotonic, when the first and the last sample came
    int nlisted;             // subsystems that the tables list: the first ones
    energy_entropy *bulk;    // [nlisted]
    energy_entropy *flux;    // [scene->first_end[nlisted]] through the ends of their ports
    long *outside;           // [nlisted] steps outside the training range, as of the last sample
    long evaluated, skipped; // terms, likewise
    int nout_of_range, worst_subsystem; // as in pm_sample
    long worst_steps;
    int ncompared;        // states compared with the reference so far
    double *predicted;    // [ncolumn] the last of these states
    pm_score_sums *score; // [columns.ngroup] errors of these states
};

// Adds one sample; step 0 comes first.
static void add_sample(pm_report *report, const pm_sample *sample) {
    const pm_setup *setup = report->setup;
    const pm_physics *physics = &setup->scene->physics;
    report->last = pm_clock();
    const long row = setup->reference == NULL || sample->step % setup->stride != 0
                         ? -1
                         : sample->step / setup->stride;
    if (row >= 0 && row < setup->reference->ntime) {
        report->ncompared = (int)row + 1;
        pm_columns_to_row(&setup->columns, sample->z, report->predicted);
        for (int g = 0; g < setup->columns.ngroup; ++g) {
            pm_score_add(&setup->columns, g, report->predicted, pm_setup_truth(setup, (int)row),
                         &report->score[g]);
        }
    }
    if (sample->step == 0) {
        report->first = report->last;
        return;
    }
    report->steps = sample->step;
    report->evaluated = sample->evaluated_in_all;
    report->skipped = sample->skipped_in_all;
    report->nout_of_range = sample->nout_of_range;
    report->worst_subsystem = sample->worst_subsystem;
    report->worst_steps = sample->worst_steps;
    for (int i = 0; i < report->nlisted; ++i) {
        report->bulk[i].energy += sample->bulk_energy[i];
        report->bulk[i].entropy += sample->bulk_entropy[i];
        report->outside[i] = sample->outside[i];
    }
    for (int k = 0; k < physics->first_end[report->nlisted]; ++k) {
        const pm_flux *flux = &sample->flux[physics->end_at[k] / 2][physics->end_at[k] % 2];
        report->flux[k].energy += flux->energy;
        report->flux[k].entropy += flux->entropy;
    }
}

static void put_sums(pm_serializer *serializer, const char *name, energy_entropy *sums) {
    pm_serializer_put(serializer, name, &sums->energy, 1);
    pm_serializer_put(serializer, name, &sums->entropy, 1);
}

// Puts all numbers that the report needs to continue after a sample into the serializer.
static void put_record(void *context, pm_serializer *serializer) {
    pm_report *report = ((const pm_observer *)context)->report;
    const pm_setup *setup = report->setup;
    pm_serializer_put_long(serializer, "steps", &report->steps);
    pm_serializer_put_int(serializer, "compared", &report->ncompared);
    pm_serializer_put_long(serializer, "evaluated", &report->evaluated);
    pm_serializer_put_long(serializer, "skipped", &report->skipped);
    pm_serializer_put_int(serializer, "strayed", &report->nout_of_range);
    pm_serializer_put_int(serializer, "farthest", &report->worst_subsystem);
    pm_serializer_put_long(serializer, "farthest steps", &report->worst_steps);
    for (int i = 0; i < report->nlisted; ++i) {
        pm_serializer_put_long(serializer, "outside", &report->outside[i]);
        put_sums(serializer, "bulk", &report->bulk[i]);
    }
    for (int k = 0; k < setup->scene->physics.first_end[report->nlisted]; ++k) {
        put_sums(serializer, "flux", &report->flux[k]);
    }
    for (int g = 0; report->score != NULL && g < setup->columns.ngroup; ++g) {
        pm_serializer_put(serializer, "error", &report->score[g].error, 1);
        pm_serializer_put(serializer, "norm", &report->score[g].norm, 1);
    }
    if (pm_serializer_restores(serializer)) {
        report->timed_from = report->steps;
        report->first = report->last = pm_clock();
    }
}

// --- tables ---

static void print_flux(const pm_report *report, int subsystem, const char *through,
                       energy_entropy sum) {
    const pm_setup *setup = report->setup;
    const double steps = report->steps > 0 ? (double)report->steps : 1;
    printf("  %-16s %-16s", setup->scene->physics.subsystem[subsystem].name, through);
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

static void print_laws(const pm_report *report, const pm_ledger *ledger) {
    const pm_scene *scene = report->setup->scene;
    const pm_integrator *integrator = scene->physics.integrator;
    const int without = pm_system_without_energy(report->setup->system);
    if (without >= 0) {
        printf("\nBoth laws\n  not defined: %s is free of structure and has no energy\n",
               scene->physics.subsystem[without].name);
        return;
    }
    printf("\n%-18s %15s %15s %15s\n", "Both laws", "start", "end", "change");
    print_total("energy, J", ledger->first_energy, ledger->energy);
    print_total("entropy, J/K", ledger->first_entropy, ledger->entropy);
    if (scene->physics.nboundary_input > 0) {
        printf("  of these given to the outside %.6e J, %.6e J/K\n", ledger->outside_energy,
               ledger->outside_entropy);
    }
    printf("\n%-18s %15s %15s   %s\n", "Worst residual", "relative", "tolerance", "where");
    print_worst("energy", ledger->worst_energy, scene->run.energy_tolerance,
                pm_ledger_name(ledger, ledger->worst_energy_place), ledger->worst_energy_step);
    print_worst("entropy", ledger->worst_entropy, scene->run.entropy_tolerance,
                pm_ledger_name(ledger, ledger->worst_entropy_place), ledger->worst_entropy_step);
    // An integrator keeps the energy to rounding by construction, or to its error.
    printf("  %-16s %15.2e ", "energy of a step", ledger->worst_step);
    if (pm_integrator_keeps_energy(integrator)) {
        printf("%15.0e", scene->run.energy_tolerance);
    } else {
        printf("%15s", "none");
    }
    printf("   step %ld, %s\n", ledger->worst_step_at, integrator->name);
    if (ledger->unbalanced > 0) {
        printf("  %s has not converged on %ld of %ld steps: take a smaller dt or more substeps\n",
               integrator->name, ledger->unbalanced, ledger->steps);
    }
    printf("  steps in violation: %ld; largest fall of the total entropy over a step: %.2e J/K\n",
           ledger->violations, ledger->worst_entropy_fall);
    printf("  largest drift of the total energy: %.2e J\n", ledger->energy_drift);
}

static const char *plural(long count) {
    return count == 1 ? "" : "s";
}

// Prints the tables. `how` names the transport; `seconds` is the wall time of the run.
static void print_report(const pm_report *report, const pm_ledger *ledger, const pm_pace *pace,
                         const char *how, double seconds) {
    const pm_setup *setup = report->setup;
    const pm_scene *scene = setup->scene;
    const pm_physics *physics = &scene->physics;
    printf("%s: %ld step%s of %g s, %s with ", scene->name, report->steps, plural(report->steps),
           physics->dt, physics->integrator->name);
    if (pm_physics_is_adaptive(physics)) {
        printf("substeps for a tolerance of %g; ", physics->tolerance);
    } else {
        printf("%d substep%s; ", physics->substeps, plural(physics->substeps));
    }
    printf("%d subsystem%s, %d port%s; %s\n", physics->nsubsystem, plural(physics->nsubsystem),
           physics->nport, plural(physics->nport), how);

    printf("\n%-18s %-16s %15s %15s\n", "Mean flux into", "through", "energy, W", "entropy, W/K");
    for (int i = 0; i < report->nlisted; ++i) {
        for (int k = physics->first_end[i]; k < physics->first_end[i + 1]; ++k) {
            print_flux(report, i, physics->port[physics->end_at[k] / 2].name, report->flux[k]);
        }
        print_flux(report, i, "(its own bulk)", report->bulk[i]);
    }
    if (physics->nsubsystem > report->nlisted) {
        printf("  and %d more subsystem%s; a recording has the fluxes of all\n",
               physics->nsubsystem - report->nlisted,
               plural(physics->nsubsystem - report->nlisted));
    }

    if (setup->reference != NULL) {
        printf("\nRelative L2 error over %d state%s of %s, trajectory %d%s\n", report->ncompared,
               plural(report->ncompared), scene->run.reference, scene->run.reference_trajectory,
               pm_columns_combine(&setup->columns, scene)
                   ? "; groups of one name in several subsystems are one row"
                   : "");
    }
    for (int i = 0; setup->reference != NULL && i < setup->columns.ngroup; ++i) {
        const char *name = setup->columns.group_name[i];
        const double score = pm_score_of(&report->score[i]);
        if (report->score[i].norm > 0) {
            printf("  %-16s %8.3g %%\n", name, 100 * score);
        } else {
            printf("  %-16s %8.3g, where the reference is zero\n", name, score);
        }
    }

    print_laws(report, ledger);

    // Nothing is said if all states were in the training range, or if the weights do not hold it.
    // Many subsystems are summed up in one line.
    if (report->nout_of_range > 0 && physics->nsubsystem > report->nlisted) {
        printf("\n%d of %d subsystems left the states their weights were trained on, %s on %ld of "
               "%ld steps",
               report->nout_of_range, physics->nsubsystem,
               physics->subsystem[report->worst_subsystem].name, report->worst_steps,
               report->steps);
    } else {
        for (int i = 0; i < report->nlisted; ++i) {
            if (report->outside[i] > 0) {
                printf("\n%s left the states its weights were trained on, on %ld of %ld steps",
                       physics->subsystem[i].name, report->outside[i], report->steps);
            }
        }
    }

    const double stepping = report->last - report->first;
    printf("\nSpeed: %.0f steps/s in %.3f s of stepping, %.3f s in all; terms evaluated %ld, "
           "skipped %ld\n",
           stepping > 0 ? (double)(report->steps - report->timed_from) / stepping : 0.0, stepping,
           seconds, report->evaluated, report->skipped);
    if (pace->interval > 0) {
        printf("Pace: %.6g simulated s per s; %lld of %ld steps ended after their deadline, by at "
               "most %.3g s\n",
               scene->run.pace, (long long)pace->late, report->steps, pace->latest);
    }
}

// --- observing ---

// A mutable global, since a signal handler can reach nothing else. The signal cannot be blocked and
// taken instead: a thread of OpenBLAS, which exists before main does, would receive it.
static volatile sig_atomic_t requested = 0;

static void request(int signal_number) {
    (void)signal_number;
    requested = 1;
}

void pm_status_install(void) {
    // System calls that the signal interrupts are restarted where that is possible.
    struct sigaction action = {.sa_handler = request, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(SIGUSR1, &action, NULL);
}

bool pm_status_requested(void) {
    const bool taken = requested != 0;
    requested = 0;
    return taken;
}

pm_status pm_observer_check_recording(const pm_run_options *options) {
    if (options->record == NULL) {
        return PM_OK;
    }
    return pm_recording_check(options->record, options->overwrite);
}

pm_status pm_observer_open(pm_observer *observer, const pm_setup *setup,
                           const pm_run_options *options) {
    *observer = (pm_observer){.options = options, .scene = setup->scene, .started = pm_clock()};
    const pm_physics *physics = &setup->scene->physics;
    pm_arena *arena = &observer->arena;
    pm_report *report = observer->report = pm_arena_alloc(arena, sizeof *report);
    PM_TRY(pm_arena_status(arena, "report"));
    const int n = physics->nsubsystem < PM_SCENE_LISTED ? physics->nsubsystem : PM_SCENE_LISTED;
    report->setup = setup;
    report->nlisted = n;
    report->bulk = pm_arena_array(arena, (size_t)n, sizeof report->bulk[0]);
    report->flux = pm_arena_array(arena, (size_t)physics->first_end[n], sizeof report->flux[0]);
    report->outside = pm_arena_array(arena, (size_t)n, sizeof report->outside[0]);
    if (setup->reference != NULL) {
        report->predicted =
            pm_arena_array(arena, (size_t)setup->reference->ncolumn, sizeof *report->predicted);
        report->score = pm_arena_array(arena, (size_t)setup->columns.ngroup, sizeof *report->score);
    }
    PM_TRY(pm_arena_status(arena, "report"));
    const int worst = pm_system_worst_verdict(setup->system);
    if (worst >= 0 && !options->quiet) {
        const pm_provenance *of = setup->system->component[worst].provenance;
        pm_journal_write(&options->log, PM_JOURNAL_WARNING, 0, NULL,
                         "the verdict on the fit of %s: %s", of->path, of->verdict);
    }
    return pm_observer_check_recording(options);
}

// Passes on the status of the recording, unless the scene wants the run to go on without it.
static pm_status outlive(pm_observer *observer, pm_status status) {
    if (status != PM_EFILE || !observer->scene->run.outlives_recording) {
        return status;
    }
    pm_journal_write(&observer->options->log, PM_JOURNAL_NOTICE, 0, NULL,
                     "the run goes on without its recording: %s", pm_error());
    (void)pm_recording_close(observer->recording);
    observer->recording = NULL;
    observer->unrecorded = true;
    return PM_OK;
}

static pm_status observe(void *context, const pm_sample *sample) {
    pm_observer *observer = context;
    add_sample(observer->report, sample);
    pm_progress_update(&observer->progress, sample->step, NULL);
    if (observer->options->record == NULL || observer->unrecorded ||
        sample->step % observer->scene->run.record_every != 0) {
        return PM_OK;
    }
    pm_status status = PM_OK;
    if (observer->recording == NULL) {
        status =
            pm_recording_open(&observer->recording, observer->options->record, observer->scene);
    }
    if (status == PM_OK) {
        status = pm_recording_append(observer->recording, sample);
    }
    return outlive(observer, status);
}

static void tell_pause(void *context, const char *silent) {
    const pm_observer *observer = context;
    if (observer->options->quiet) {
        return;
    }
    const pm_journal *log = &observer->options->log;
    const long step = observer->report->steps;
    const pm_journal_field field[] = {{.name = "step", .number = (double)step},
                                      {.name = "silent", .text = silent}};
    if (silent[0] == 0) {
        pm_journal_write(log, PM_JOURNAL_NOTICE, 1, field, "the run goes on");
    } else {
        pm_journal_write(log, PM_JOURNAL_NOTICE, 2, field,
                         "the run pauses after step %ld: no word from %s", step, silent);
    }
}

static void tell_hold(void *context, long step) {
    const pm_observer *observer = context;
    if (!observer->options->quiet) {
        const pm_journal_field field = {.name = "step", .number = (double)step};
        pm_journal_write(&observer->options->log, PM_JOURNAL_NOTICE, 1, &field,
                         "held after step %ld", step);
    }
}

static void tell_health(void *context, const portmet_health_t *health) {
    const pm_observer *observer = context;
    if (pm_status_requested()) {
        pm_status_print(stderr, &observer->options->log, observer->scene, health);
    }
    pm_notify("WATCHDOG=1\nSTATUS=step %lld of %lld, %.3g steps/s",
              (long long)(health->step < 0 ? 0 : health->step), (long long)health->steps,
              health->rate);
}

static void warn(void *context, const char *text) {
    const pm_observer *observer = context;
    if (!observer->options->quiet) {
        pm_journal_write(&observer->options->log, PM_JOURNAL_WARNING, 0, NULL, "%s", text);
    }
}

static pm_status flush(void *context) {
    pm_observer *observer = context;
    return observer->recording == NULL ? PM_OK
                                       : outlive(observer, pm_recording_flush(observer->recording));
}

static pm_status resume(void *context, long step) {
    pm_observer *observer = context;
    return observer->options->record == NULL
               ? PM_OK
               : outlive(observer,
                         pm_recording_reopen(&observer->recording, observer->options->record,
                                             observer->scene,
                                             step / observer->scene->run.record_every + 1));
}

pm_lockstep_coordinator_options pm_observer_attach(pm_observer *observer, const pm_setup *setup) {
    pm_progress_init(&observer->progress, setup->scene->name, setup->scene->run.steps);
    observer->progress.enabled =
        observer->progress.enabled && !observer->options->quiet && !observer->options->log.json;
    return (pm_lockstep_coordinator_options){
        .steps = setup->scene->run.steps,
        .session = observer->options->session,
        .want_state = observer->options->record != NULL || setup->reference != NULL,
        .replay = setup->replay,
        .replayed = setup->replayed,
        .observer = {.context = observer,
                     .step = observe,
                     .pause = tell_pause,
                     .hold = tell_hold,
                     .health = tell_health,
                     .warn = warn,
                     .record = put_record,
                     .flush = flush,
                     .resume = resume},
    };
}

pm_status pm_observer_finish(pm_observer *observer, pm_status status, const pm_ledger *ledger,
                             const pm_pace *pace, const char *how) {
    pm_progress_finish(&observer->progress);
    pm_recording *recording = observer->recording;
    observer->recording = NULL;
    const pm_status closed = outlive(observer, pm_recording_close(recording));
    if (!observer->options->quiet && ledger->steps > 0) {
        print_report(observer->report, ledger, pace, how, pm_clock() - observer->started);
    }
    if (status != PM_OK || closed != PM_OK) {
        return status != PM_OK ? status : closed;
    }
    return ledger->unbalanced == 0
               ? PM_OK
               : pm_fail(PM_ELAW,
                         "the energy was not kept on %ld of %ld steps, because %s has not "
                         "converged there: take a smaller dt or more substeps",
                         ledger->unbalanced, ledger->steps,
                         observer->scene->physics.integrator->name);
}

void pm_observer_close(pm_observer *observer) {
    pm_recording_close(observer->recording);
    pm_arena_free(&observer->arena);
}

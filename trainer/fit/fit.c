// A fit from its training file to its result: loads and divides the data, chooses the initial
// weights, and writes the folder: the checkpoint for --resume, and the best weights so far as one
// file for each subsystem and port.
#include "fit/fit.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <sys/file.h>
#include <unistd.h>

#include "base/digest.h"
#include "base/files.h"
#include "base/options.h"
#include "data/trained.h"
#include "fit/normalization.h"
#include "fit/start.h"

// --- data ---

// --- start ---

// The number of completed iterations before the initial weights are chosen.
#define NO_START -1
#define CURVES "stage,optimiser,iteration,seconds,loss,validation" // first line of fit.csv

// Draws the first weights into theta, and fixes the normalisation.
static pm_status initialise(pm_fit *f) {
    const size_t size = (size_t)f->size + 1;
    f->checkpoint = pm_arena_printf(&f->arena, "%s/fit.checkpoint", f->arguments->output);
    f->theta = pm_arena_array(&f->arena, size, sizeof *f->theta);
    f->best = pm_arena_array(&f->arena, size, sizeof *f->best);
    f->declared = pm_arena_array(&f->arena, size, sizeof *f->declared);
    f->moment = pm_arena_array(&f->arena, 2 * size, sizeof *f->moment);
    PM_TRY(pm_arena_status(&f->arena, "%d weights", f->size));
    pm_trained_gather(f->training->system, f->declared);
    pm_start_draw(f->training, 0, f->theta);
    pm_samples samples;
    PM_TRY(pm_samples_make(&samples, f->training->scene, f->dataset, 0, f->split.ntraining,
                           PM_RESIDUAL_STEP, 1, 1));
    const pm_status status =
        pm_normalization_of_system(f->training->system, &samples, f->training->plain);
    pm_samples_free(&samples);
    return status;
}

// --- the whole ---

static int least(int a, int b) {
    return a < b ? a : b;
}

pm_status pm_fit_open(pm_fit *f, const pm_fit_arguments *arguments,
                      const volatile sig_atomic_t *stop) {
    *f = (pm_fit){.arguments = arguments, .stop = stop, .folder = -1, .position = {.best = -1}};
    f->processor = pm_fit_processor_time(f);
    PM_TRY(pm_training_load(&f->training, arguments->config));
    pm_training *t = f->training;
    if (arguments->seed > 0) {
        t->seed = (uint64_t)arguments->seed;
        t->digest = pm_digest_integer(t->digest, arguments->seed);
    }
    const pm_fit_effort *e = arguments->effort;
    if (e != NULL) {
        t->tries = least(t->tries, e->tries);
        t->try_iterations = least(t->try_iterations, e->try_iterations);
        t->nstage = least(t->nstage, e->stages);
    }
    for (int i = 0; i < t->nstage && e != NULL; ++i) {
        pm_schedule *schedule = &t->stage[i].schedule;
        schedule->iterations = least(schedule->iterations, e->iterations);
        schedule->batch = least(schedule->batch, e->samples);
        schedule->thorough = false;
    }
    f->kind = t->measured ? &pm_fit_of_measurements : &pm_fit_of_states;
    if (arguments->team != NULL && f->kind == &pm_fit_of_measurements) {
        return pm_fail(PM_EUSAGE,
                       "measurements are fitted by one process: start it without mpirun");
    }
    for (int i = 0; i < t->nstage; ++i) {
        t->stage[i].loss.team = arguments->team;
    }
    PM_TRY(pm_fit_check_names(t->scene));
    const pm_training *training = f->training;
    const bool named = f->arguments->data != NULL; // on the command line
    f->data = named ? f->arguments->data : training->data;
    if (f->data == NULL) {
        return pm_fail(PM_EUSAGE, "%s names no data; name them with --data FILE",
                       f->arguments->config);
    }
    const pm_status status = f->kind->load(f);
    PM_TRY(status == PM_OK || named ? status
                                    : pm_fail(status, "%s: %s", training->data_at, pm_error()));
    // Takes the lists of the command line, or else those of the training file. Errors in the latter
    // name their place in the file.
    const pm_fit_arguments *a = f->arguments;
    const char *used = a->trajectories != NULL ? a->trajectories : training->trajectories;
    const char *kept = a->validation != NULL ? a->validation : training->validation;
    const pm_status chosen =
        pm_split_choose(&f->split, f->dataset->ntrajectory, used, kept, &f->arena);
    const char *at = a->trajectories == NULL && training->trajectories_at != NULL
                         ? training->trajectories_at
                     : a->validation == NULL ? training->validation_at
                                             : NULL;
    PM_TRY(chosen != PM_EUSAGE || at == NULL ? chosen
                                             : pm_fail(PM_ECONFIG, "%s: %s", at, pm_error()));
    PM_TRY(pm_split_reorder(&f->split, f->dataset));
    f->seen = pm_arena_array(&f->arena, (size_t)f->dataset->ntrajectory, sizeof *f->seen);
    PM_TRY(pm_arena_status(&f->arena, "digests of trajectories"));
    f->digest = training->digest;
    for (int i = 0; i < f->dataset->ntrajectory; ++i) {
        f->seen[i] = f->measured.data == NULL
                         ? pm_dataset_digest(f->dataset, i)
                         : pm_dataset_digest(f->measured.data, f->split.trajectory[i]);
        f->digest = pm_digest_integer(f->digest, (int64_t)f->seen[i]);
    }
    f->digest = pm_digest_integer(f->digest, f->split.ntraining);
    PM_TRY(f->kind->shorten == NULL ? PM_OK : f->kind->shorten(f));
    PM_TRY(pm_options_folder(arguments->output));
    // Two fits that write into one folder would leave a mixture of their weights.
    f->folder = open(arguments->output, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (f->folder >= 0 && pm_team_leads(arguments->team) &&
        flock(f->folder, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        return pm_fail(PM_EFILE, "%s: another fit writes into this folder", arguments->output);
    }
    const bool leads = pm_team_leads(arguments->team);
    const char *path =
        leads ? pm_arena_printf(&f->arena, "%s/fit.csv", arguments->output) : "/dev/null";
    PM_TRY(pm_arena_status(&f->arena, "a path"));
    PM_TRY(leads ? pm_files_check_output(path, CURVES) : PM_OK);
    f->size = pm_trained_count(t->system);
    printf("%s: %d weight%s, trajectories %s of ", arguments->config, f->size,
           f->size == 1 ? "" : "s", f->split.training);
    f->kind->describe(f);
    if (f->split.nvalidation > 0) {
        printf("; validation on %s\n", f->split.validation);
    } else {
        printf("; no validation\n");
    }
    fflush(stdout);
    f->saved = pm_clock();
    PM_TRY(initialise(f));
    f->position.done = NO_START;
    PM_TRY(arguments->resume ? pm_fit_load(f) : PM_OK);
    // Chooses the initial weights. If that is interrupted, a checkpoint says so, and the choice
    // begins again when the fit is resumed.
    if (f->position.done == NO_START) {
        f->position.done = 0;
        const pm_status begun = f->kind->start(f);
        if (begun == PM_EINTERRUPTED && f->arguments->effort == NULL) {
            f->position.done = NO_START;
            PM_TRY(pm_fit_save(f, false));
            return pm_fail(
                PM_EINTERRUPTED,
                "interrupted while choosing the initial weights; continue with --resume");
        }
        PM_TRY(begun);
    }
    const bool further = f->arguments->resume && access(path, F_OK) == 0;
    f->curves = fopen(path, further ? "a" : "w");
    if (f->curves == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be written", path);
    }
    pm_files_note_output(path);
    if (!further) {
        fprintf(f->curves, CURVES "\n");
    }
    return PM_OK;
}

pm_status pm_fit_run(pm_fit *f) {
    const pm_status status = f->kind->run(f);
    pm_trained_scatter(f->training->system, pm_fit_kept(f));
    if (status == PM_OK && f->position.best >= 0) {
        printf("Best weights on the validation part: those of stage %d after %d iterations.\n",
               f->position.best_stage + 1, f->position.best_done);
    }
    return status;
}

pm_status pm_fit_report(pm_fit *fit, const pm_measure *black_box) {
    const pm_status status = fit->kind->report(fit, black_box);
    char reason[PM_VERDICT_LENGTH];
    snprintf(reason, sizeof reason, "%s", pm_error());
    fit->saved = pm_clock(); // a report is no time of training
    const pm_status saved = pm_fit_save(fit, false);
    return status != PM_OK ? pm_fail(status, "%s", reason) : saved;
}

pm_status pm_fit_judge(pm_fit *fit, pm_fit_score *score) {
    *score = (pm_fit_score){.step = NAN, .rollout = INFINITY, .production = NAN};
    return fit->kind->judge(fit, score);
}

void pm_fit_close(pm_fit *f) {
    if (f->folder >= 0) {
        close(f->folder); // which unlocks it
    }
    if (f->curves != NULL) {
        fclose(f->curves);
    }
    pm_training_free(f->training);
    pm_dataset_free(f->dataset);
    pm_dataset_free(f->measured.data);
    pm_arena_free(&f->arena);
}

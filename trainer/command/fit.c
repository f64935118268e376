// portmet-train fit: trains the models of a scene on a dataset, stage by stage, with checkpoints,
// and prints a table of errors and a verdict.
#include "command/commands.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/options.h"
#include "base/python.h"
#include "command/tables.h"
#include "fit/fit.h"
#include "propose/advice.h"
#include "propose/propose.h"

#define ADVICE_SHARE 0.5 // of the CPU time of a fit, for what its models may lack
#define TOLD 300000000 // ns that it takes, at most, until the first process has said why it failed

// If the argument is a scene, proposes its training file and continues with that. The caller frees
// *training.
static pm_status propose(pm_fit_arguments *a, const volatile sig_atomic_t *stop, char **training) {
    if (!pm_propose_is_scene(a->config)) {
        return PM_OK;
    }
    if (a->data == NULL) {
        return pm_fail(PM_EUSAGE, "%s is a scene; name the dataset with --data FILE", a->config);
    }
    pm_proposal how = {.form = PM_HARD,
                       .trajectories = a->trajectories,
                       .validation = a->validation,
                       .budget = PM_PROPOSAL_BUDGET,
                       .loud = true,
                       .stop = stop};
    PM_TRY(pm_command_budget(a->budget, &how.budget));
    PM_TRY(pm_options_folder(a->output));
    const size_t size = strlen(a->output) + sizeof "/training.yaml";
    *training = malloc(size);
    PM_TRY(pm_allocated(*training, "a path"));
    snprintf(*training, size, "%s/training.yaml", a->output);
    pm_status status = PM_OK;
    if (pm_team_leads(a->team) && (!a->resume || access(*training, R_OK) != 0)) {
        status = pm_propose_files(a->config, a->data, &how, *training);
    }
    a->config = *training;
    // The others of a team read what the first one has written.
    if (pm_team_any(a->team, status != PM_OK) && status == PM_OK) {
        status = pm_fail(PM_ECONFIG, "%s was not written", *training);
    }
    return status;
}

static pm_status train(pm_fit *f, const pm_fit_arguments *a, const volatile sig_atomic_t *stop,
                       bool loud) {
    PM_TRY(pm_fit_open(f, a, stop));
    const pm_status status = pm_fit_run(f);
    f->interrupted = status == PM_EINTERRUPTED;
    PM_TRY(status);
    return pm_fit_save(f, loud);
}

// Trains a model without structure (form free) for the same scene on the same data for the same CPU
// time, and measures it on the validation part.
static pm_status train_black_box(pm_fit *f, const volatile sig_atomic_t *stop,
                                 pm_measure *measure) {
    char folder[PATH_MAX], config[PATH_MAX + 16];
    const char *output = f->arguments->output;
    if (snprintf(folder, sizeof folder, "%s/black_box", output) >= (int)sizeof folder) {
        return pm_fail(PM_EUSAGE, "%s: the path is too long", output);
    }
    snprintf(config, sizeof config, "%s/training.yaml", folder);
    PM_TRY(pm_options_folder(folder));
    printf("\nA black box for comparison:\n");
    const pm_proposal how = {.form = PM_FREE};
    PM_TRY(pm_propose_files(f->training->scene->path, f->data, &how, config));
    pm_fit_arguments a = {
        .config = config,
        .data = f->data,
        .output = folder,
        .trajectories = f->split.training,
        .validation = f->split.nvalidation > 0 ? f->split.validation : "none",
        .seed = f->arguments->seed,
        .limit = pm_fit_processor_time(f),
    };
    snprintf(a.line, sizeof a.line, "%s", f->arguments->line);
    pm_fit box;
    pm_status status = train(&box, &a, stop, false);
    if (status == PM_OK) {
        status = pm_fit_measure(&box, box.split.nvalidation > 0, measure);
    }
    pm_fit_close(&box);
    return status;
}

// Tries what a fit to states with this result may lack, if it is not good, for `budget` s of CPU
// time, but at most half of that of the training, and writes it to `path`. Returns the result.
static pm_status advise(const pm_fit *f, pm_status result, double budget, const char *path,
                        const volatile sig_atomic_t *stop) {
    char error[512];
    const bool good = result == PM_OK && strncmp(f->verdict, "good", strlen("good")) == 0;
    if (good || (result != PM_OK && result != PM_EUNFIT) || f->curves == NULL ||
        f->kind != &pm_fit_of_states || f->arguments->team != NULL) {
        return result;
    }
    snprintf(error, sizeof error, "%s", pm_error());
    const double share = fmin(budget, ADVICE_SHARE * pm_fit_processor_time(f));
    const pm_status status = share > 0 ? pm_advise(f, share, stop, path, stdout) : PM_OK;
    // The fit is complete, whether or not this was interrupted.
    return status != PM_OK && status != PM_EINTERRUPTED ? status
           : result == PM_OK                            ? PM_OK
                                                        : pm_fail(result, "%s", error);
}

// Proposes a training file if there is none, trains, and reports.
static pm_status fit(pm_fit_arguments *a, const volatile sig_atomic_t *stop) {
    char *training = NULL;
    pm_fit f;
    pm_measure black_box = {.ncell = 0};
    char advice[PATH_MAX];
    snprintf(advice, sizeof advice, "%s/advice.yaml", a->output);
    double budget = PM_PROPOSAL_BUDGET;
    pm_status status = pm_command_budget(a->budget, &budget);
    if (status == PM_OK && pm_team_leads(a->team)) { // before the work
        status = budget > 0 ? pm_advise_check(advice) : PM_OK;
        status = status == PM_OK ? pm_python_check_pictures("fit", a->output) : status;
    }
    status = status == PM_OK ? propose(a, stop, &training) : status;
    if (status == PM_OK) {
        status = train(&f, a, stop, true);
        if (f.interrupted && pm_team_leads(a->team)) {
            // What there is by then is worth a verdict, too.
            char error[512];
            snprintf(error, sizeof error, "%s", pm_error());
            (void)pm_fit_report(&f, NULL);
            status = pm_fail(status, "%s", error);
        } else if (status == PM_OK && pm_team_leads(a->team)) {
            // fit.png, where Python and gnuplot are installed.
            const char *const drawn[] = {"fit", a->output, NULL};
            (void)pm_python_run(&pm_python_pictures, drawn, true);
            status = a->black_box ? train_black_box(&f, stop, &black_box) : PM_OK;
            if (status == PM_OK) {
                status = pm_fit_report(&f, a->black_box ? &black_box : NULL);
            }
        }
        status = advise(&f, status, budget, advice, stop);
        pm_measure_free(&black_box);
        pm_fit_close(&f);
    }
    free(training);
    return status;
}

// Trains in a team if mpirun has started one. Its first process prints, and says why a training has
// failed.
static pm_status fit_in_team(pm_fit_arguments *a, const volatile sig_atomic_t *stop) {
    if (!pm_team_is_called()) {
        return fit(a, stop);
    }
    pm_team team = {0};
    pm_status status = pm_team_join(&team);
    if (status != PM_OK) {
    } else if (!pm_team_leads(&team) && freopen("/dev/null", "w", stdout) == NULL) {
        status = pm_fail(PM_EFILE, "/dev/null: cannot be opened");
    } else if (a->black_box) {
        status = pm_fail(PM_EUSAGE, "--black-box compares CPU times: start it without mpirun");
    } else {
        a->team = &team;
        status = fit(a, stop);
    }
    const bool together = pm_team_leave(&team, status != PM_OK);
    if (status == PM_OK || !together || pm_team_leads(&team)) {
        return status;
    }
    // mpirun ends all when one has failed: the first one has time to say why.
    nanosleep(&(struct timespec){.tv_nsec = TOLD}, NULL);
    return pm_fail(status, "%s", "");
}

// The file that a training file names as its data may be a table. The caller frees *training, which
// holds the name.
static pm_status find_table(const pm_fit_arguments *a, pm_training **training, const char **table) {
    if (pm_propose_is_scene(a->config)) {
        return PM_OK;
    }
    PM_TRY(pm_training_load(training, a->config));
    const char *name = (*training)->data;
    *table = name != NULL && access(name, R_OK) == 0 ? name : NULL;
    return PM_OK;
}

pm_status pm_command_fit(int argc, char **argv, const volatile sig_atomic_t *stop) {
    pm_fit_arguments a = {0};
    pm_words given = {0};
    const pm_option option[] = {
        {"--data", "-d", "FILE...", NULL, &a.data, false,
         .help = "dataset, or tables (see import --help), instead of the one CONFIG names"},
        {"--output", "-o", "DIR", NULL, &a.output, true,
         .help = "folder for the weights, one file per subsystem and port"},
        {"--data-set", NULL, "NAME", NULL, &a.data_set, false,
         .help = "measurements: the array of FILE to read, such as z_noise; default: z"},
        {"--trajectories", NULL, "LIST", NULL, &a.trajectories, false,
         .help = "use only these trajectories, such as 0:40 or 0:4,7"},
        {"--validation", NULL, "LIST", NULL, &a.validation, false,
         .help = "keep these back for validation, or none; default: every fifth"},
        {"--seed", NULL, "N", .count = &a.seed, .least = 1, .most = INT32_MAX,
         .help = "of the first weights and all batches, instead of the one in CONFIG"},
        {"--black-box", NULL, NULL, &a.black_box, NULL, false,
         .help = "also train a model without structure for the same CPU time"},
        {"--budget", NULL, "SECONDS", NULL, &a.budget, false,
         .help = "CPU time for trials of hypotheses: of a SCENE, and after a fit of states that is "
                 "not good; 0: none (default 60)"},
        {"--resume", NULL, NULL, &a.resume, NULL, false,
         .help = "continue from DIR/fit.checkpoint; stages may have been added, the last may be "
                 "longer"},
    };
    const pm_options options = {
        .usage = "portmet-train fit CONFIG|SCENE [--data FILE...] -o DIR [options]",
        .summary =
            "Trains the models that CONFIG gives to the subsystems and ports of its scene and\n"
            "writes their weights to DIR. From a SCENE it first proposes DIR/training.yaml (see\n"
            "propose --help) and trains by it. The weights with the best rollouts on the\n"
            "validation part are kept. The same command gives the same weights. DIR/fit.csv\n"
            "records the losses and, with gnuplot, DIR/fit.png draws them. At the end a table\n"
            "of errors and a verdict are printed. The exit code is 13 if rollouts are not finite\n"
            "or worse than persistence, a state that stays as it is. `mpirun -n N portmet-train "
            "fit`\n"
            "trains with 1, 2, 4 or 8 processes, which give the same weights.",
        .examples =
            "portmet-train fit cart/training.yaml -o cart/weights\n"
            "portmet-train fit configs/train/double_pendulum.yaml --data pendula.h5 -o weights",
        .positional_name = "CONFIG",
        .positional = &a.config,
        PM_OPTION_TABLE(option),
        .several = "--data",
        .words = &given,
    };
    char keep[PATH_MAX];
    pm_data_file data = {0};
    pm_training *training = NULL;
    const char *table = NULL;
    pm_status status;
    pm_options_line(argc, argv, a.line, (int)sizeof a.line);
    PM_TRY_DONE(pm_options_read(&options, argc, argv));
    // A proposed training file names the dataset, which is then kept beside it.
    const bool kept = given.count > 0 && pm_propose_is_scene(a.config);
    snprintf(keep, sizeof keep, "%s/training_data.h5", a.output);
    PM_TRY_DONE(kept ? pm_options_folder(a.output) : PM_OK);
    PM_TRY_DONE(given.count == 0 ? find_table(&a, &training, &table) : PM_OK);
    const pm_words named = {1, &table};
    PM_TRY_DONE(pm_data_open(&data, table != NULL ? &named : &given, kept ? keep : NULL,
                             pm_team_is_called()));
    a.data = table == NULL || data.temporary ? data.path : NULL;
    status = fit_in_team(&a, stop);
done:
    pm_data_close(&data);
    pm_training_free(training);
    free(given.word);
    return status;
}

// portmetd bench: run time against error of a scene. Every integrator that can serve the scene,
// with substeps and tolerances from coarse to fine, against a reference of its own: two methods of
// high order with many substeps.
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/command.h"
#include "app/prepare.h"
#include "base/journal.h"
#include "base/options.h"
#include "base/python.h"
#include "sim/score.h"
#include "study/rollout.h"

#define BUDGET 60.0          // s of CPU time, by default
#define ERROR 0.01           // %, that the advice is for by default
#define STARTS 48            // rollouts of each setting
#define TRAJECTORIES 16      // of the reference among the starts, besides the scene's own
#define MOST_STEPS 40        // of a rollout
#define LEAST_STEPS 4        // of a rollout, however slow the scene is
#define MOST_SETTINGS 160    // integrators with substeps or tolerances
#define LEAST_STARTS 4       // however slow the scene is, or many --steps are asked for
#define MOST_ROUNDS 128      // exchanges in a step of the finest setting, or
#define MOST_TIMES 4         // times as many as the scene makes
#define REFERENCE_ROUNDS 768 // exchanges in a step of a reference
#define ALL_ROUNDS 9000      // exchanges in a step of all settings and references together
#define ALL_TIMES 100        // or times as many as the scene makes
#define SHARE 0.7            // of the budget that they are planned to take
#define KEPT 0.1             // of the budget, for other starts
#define ALIKE 0.05           // logarithm of the ratio of two times that count as equal
#define TRIAL 0.1            // s of CPU time in which the cost of a step is measured
#define CERTAIN 100          // by how much the references agree better than the best setting
#define MOST_GROUPS 64       // names of groups
#define FRESH 4              // times as many other starts, from which the advice is measured again
#define CHOICES 3            // settings that are measured again at once
#define MOST_CHOICES 4       // times
#define BLOCK 8              // starts of a task

// A setting, and what is measured of it: medians over the starts.
typedef struct setting {
    pm_stepping stepping;
    bool served; // the scene allows it
    bool again;  // its errors are those from the other starts
    bool done;
    double error, largest;   // of the states, relative, in the worst group; of the worst start
    double sure;             // the median's upper bound, for the choice
    double energy;           // J, drift of the total
    double produced;         // relative error of the entropy produced; 0 where there is none
    double seconds;          // of CPU time for a simulated second
    double faster;           // than the scene, from the other starts; 0: not measured there
    pm_rollout_result first; // of the scene's own start
} setting;

typedef struct bench {
    const pm_run_options *options;
    pm_setup base;
    char *text;
    int nstart, steps, nsetting;
    pm_start start[STARTS];
    setting *setting;   // [MOST_SETTINGS] shared; the first is the scene's own
    double *truth;      // [nstart][steps + 1][nz] shared, by the first reference; NAN: not reached
    double *produced;   // [nstart] J/K, shared
    setting *reference; // [2] shared
    double *other;      // [nstart] shared: errors of the second reference against the first
    pm_start fresh[FRESH * STARTS]; // other starts
    int nfresh, nchoice;
    setting *choice[CHOICES];
    // [CHOICES][FRESH * STARTS] shared: errors of the choices, -1: not measured; how many times
    // faster than the scene each is
    double *error, *faster;
} bench;

// The relative error of the worst group of variables; groups of the same name are one.
static double error_of(const bench *b, const double *z, const double *truth) {
    const pm_physics *physics = &b->base.scene->physics;
    const char *name[MOST_GROUPS];
    double error[MOST_GROUPS] = {0}, norm[MOST_GROUPS] = {0}, worst = 0;
    int count = 0;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_layout *layout = &physics->subsystem[i].layout;
        for (int g = 0; g < layout->ngroup; ++g) {
            const pm_group *group = &layout->group[g];
            int k = 0;
            while (k < count && strcmp(name[k], group->name) != 0) {
                ++k;
            }
            if (k == MOST_GROUPS) {
                continue;
            }
            name[k] = group->name;
            count = k == count ? count + 1 : count;
            for (int step = 0; step <= b->steps; ++step) {
                const size_t at = (size_t)step * (size_t)physics->nz +
                                  (size_t)(physics->subsystem[i].first + group->first);
                for (int c = 0; c < group->size; ++c) {
                    const double difference = z[at + (size_t)c] - truth[at + (size_t)c];
                    error[k] += difference * difference;
                    norm[k] += truth[at + (size_t)c] * truth[at + (size_t)c];
                }
            }
        }
    }
    for (int k = 0; k < count; ++k) {
        const double relative = sqrt(error[k]) / (norm[k] > 0 ? sqrt(norm[k]) : 1);
        worst = isfinite(relative) ? fmax(worst, relative) : INFINITY;
    }
    return worst;
}

// The median over `count` starts, the worst, and a bound of the median: pm_box_of sorts the errors,
// and a median of as many other starts lies below it in nine cases of ten.
static void summarise(setting *s, int count, double *error) {
    const pm_box box = pm_box_of(count, error);
    const int at = (int)(0.5 * (count - 1) + 0.64 * sqrt(count));
    s->error = box.median;
    s->largest = box.largest;
    s->sure = error[at < count ? at : count - 1];
}

// Measures one setting in a child process. The references come first: they have negative numbers.
static void measure(void *context, int task) {
    bench *b = context;
    setting *s = task < 0 ? &b->reference[task + 2] : &b->setting[task];
    const size_t size = (size_t)(b->steps + 1) * (size_t)b->base.scene->physics.nz;
    pm_setup setup = {0};
    pm_rollout_spec spec = {.stepping = s->stepping, .factor = 1};
    double error[STARTS], energy[STARTS], produced[STARTS], seconds[STARTS];
    spec.stepping.steps = b->steps;
    double *z = calloc(size, sizeof *z);
    if (z != NULL && pm_rollout_open(&setup, &b->base, b->text, &spec.stepping) == PM_OK) {
        s->served = true;
        for (int i = 0; i < b->nstart; ++i) {
            pm_rollout_result result;
            double *truth = b->truth + (size_t)i * size;
            pm_rollout_run(&setup, &b->start[i], &spec, task == -2 ? truth : z, &result);
            const bool whole = result.status == PM_OK && result.steps == b->steps;
            if (i == 0) {
                s->first = result;
            }
            seconds[i] = result.steps > 0 ? result.seconds / ((double)result.steps * s->stepping.dt)
                                          : INFINITY;
            if (task == -2) {
                truth[0] = whole ? truth[0] : NAN;
                b->produced[i] = result.produced;
            }
            error[i] = whole && task != -2 ? error_of(b, z, truth) : INFINITY;
            energy[i] = whole ? result.drift : INFINITY;
            produced[i] =
                fabs(result.produced - b->produced[i]) / fmax(fabs(b->produced[i]), 1e-300);
            produced[i] = b->produced[i] == 0 ? 0 : produced[i];
            if (task == -1) {
                b->other[i] = error[i];
            }
        }
        summarise(s, b->nstart, error);
        s->energy = pm_box_of(b->nstart, energy).median;
        s->produced = pm_box_of(b->nstart, produced).median;
        s->seconds = pm_box_of(b->nstart, seconds).median;
    } else {
        snprintf(s->first.why, sizeof s->first.why, "%s", pm_error());
    }
    s->done = true;
    pm_setup_free(&setup);
    free(z);
}

// Measures the choices from a block of the other starts, against the first reference, and how many
// times faster than the scene each is. All settings take turns, so that whatever else the machine
// does slows them alike.
static void measure_again(void *context, int task) {
    enum { TRUTH, OWN, FIRST, LAST = FIRST + CHOICES };
    bench *b = context;
    const size_t size = (size_t)(b->steps + 1) * (size_t)b->base.scene->physics.nz;
    pm_setup setup[LAST];
    pm_rollout_spec spec[LAST];
    double *truth = calloc(2 * size, sizeof *truth), *z = truth + size;
    bool opened = truth != NULL;
    memset(setup, 0, sizeof setup);
    for (int s = 0; s < FIRST + b->nchoice; ++s) {
        spec[s] = (pm_rollout_spec){.factor = 1};
        spec[s].stepping = s == TRUTH ? b->reference[0].stepping
                           : s == OWN ? b->setting[0].stepping
                                      : b->choice[s - FIRST]->stepping;
        spec[s].stepping.steps = b->steps;
        opened =
            opened && pm_rollout_open(&setup[s], &b->base, b->text, &spec[s].stepping) == PM_OK;
    }
    for (int i = task * BLOCK; i < b->nfresh && i < (task + 1) * BLOCK && opened; ++i) {
        double own = INFINITY;
        for (int s = 0; s < FIRST + b->nchoice; ++s) {
            pm_rollout_result result;
            pm_rollout_run(&setup[s], &b->fresh[i], &spec[s], s == TRUTH ? truth : z, &result);
            const bool whole = result.status == PM_OK && result.steps == b->steps;
            if (s == TRUTH) {
                truth[0] = whole ? truth[0] : NAN;
            } else if (s == OWN) {
                own = whole ? result.seconds : INFINITY;
            } else {
                const int at = (s - FIRST) * FRESH * STARTS + i;
                b->error[at] = whole ? error_of(b, z, truth) : INFINITY;
                b->faster[at] = own / result.seconds;
            }
        }
    }
    for (int s = 0; s < FIRST + b->nchoice; ++s) {
        pm_setup_free(&setup[s]);
    }
    free(truth);
}

static int by_time(const void *left, const void *right) {
    const double a = (*(const setting *const *)left)->seconds;
    const double b = (*(const setting *const *)right)->seconds;
    return (a > b) - (a < b);
}

// The advice was chosen from few starts, as the one that looks best. Measures the fastest settings
// that look good enough from other starts, until the fastest one is.
static pm_status choose(bench *b, double target, double *left) {
    for (int turn = 0; turn < MOST_CHOICES && b->nfresh > b->nstart; ++turn) {
        setting *sorted[MOST_SETTINGS];
        int count = 0;
        for (int i = 0; i < b->nsetting; ++i) {
            setting *s = &b->setting[i];
            if (s->done && s->served && s->sure <= target) {
                sorted[count++] = s;
            }
        }
        qsort(sorted, (size_t)count, sizeof *sorted, by_time);
        b->nchoice = 0; // none if the fastest one was measured again
        for (int i = 0; i < count && i < CHOICES && !sorted[i]->again; ++i) {
            b->choice[b->nchoice++] = sorted[i];
        }
        if (b->nchoice == 0) {
            break;
        }
        for (int i = 0; i < CHOICES * FRESH * STARTS; ++i) {
            b->error[i] = -1;
        }
        PM_TRY(pm_rollout_parallel(0, (b->nfresh + BLOCK - 1) / BLOCK, measure_again, b, left,
                                   "other starts", b->options->stop));
        for (int c = 0; c < b->nchoice; ++c) {
            double *error = b->error + c * FRESH * STARTS;
            double *faster = b->faster + c * FRESH * STARTS;
            int measured = 0;
            for (int i = 0; i < b->nfresh; ++i) {
                if (error[i] >= 0) {
                    faster[measured] = faster[i];
                    error[measured++] = error[i];
                }
            }
            if (measured <= b->nstart) {
                return PM_OK; // the time is over
            }
            summarise(b->choice[c], measured, error);
            b->choice[c]->again = true;
            b->choice[c]->faster = pm_box_of(measured, faster).median;
        }
    }
    return PM_OK;
}

static const char *describe(const setting *s, char *text, size_t size) {
    if (s->stepping.tolerance != 0) {
        snprintf(text, size, "%s, at least %d, tolerance %g", s->stepping.integrator->name,
                 s->stepping.substeps, s->stepping.tolerance);
    } else {
        snprintf(text, size, "%s with %d substep%s", s->stepping.integrator->name,
                 s->stepping.substeps, s->stepping.substeps == 1 ? "" : "s");
    }
    return text;
}

static double times_faster(const setting *own, const setting *best) {
    return best == own ? 1 : best->faster > 0 ? best->faster : own->seconds / best->seconds;
}

static pm_status report(const bench *b, double target) {
    const setting *sorted[MOST_SETTINGS], *own = &b->setting[0], *best = NULL;
    double front = INFINITY, finest = INFINITY, other[STARTS];
    char text[128];
    int count = 0, left = 0;
    pm_status picture = PM_OK;
    memcpy(other, b->other, (size_t)b->nstart * sizeof *other);
    const double agreement = pm_box_of(b->nstart, other).median;
    for (int i = 0; i < b->nsetting; ++i) {
        if (b->setting[i].done && b->setting[i].served) {
            sorted[count++] = &b->setting[i];
            finest = fmin(finest, b->setting[i].error);
        }
        left += !b->setting[i].done;
    }
    if (!own->done) {
        return pm_fail(PM_EBROKEN, "bench: no setting was measured within the --budget");
    }
    qsort(sorted, (size_t)count, sizeof *sorted, by_time);
    const bool json = b->options->json;
    if (json) {
        printf("{\"scene\":\"%s\",\"steps\":%d,\"dt\":%.17g,\"starts\":%d,\"agreement\":%.3g,"
               "\"settings\":[",
               b->base.scene->name, b->steps, b->base.scene->physics.dt, b->nstart,
               fmin(agreement, DBL_MAX));
    } else {
        printf("%s: %d steps of %g s from %d starts; the references, %s and ", b->base.scene->name,
               b->steps, b->base.scene->physics.dt, b->nstart,
               describe(&b->reference[0], text, sizeof text));
        printf("%s, agree to %.1e\n\n%-44s %10s %10s %11s %10s %12s\n",
               describe(&b->reference[1], text, sizeof text), agreement, "", "error, %", "largest",
               "entropy, %", "drift, J", "CPU s per s");
    }
    for (int i = 0; i < count; ++i) {
        const setting *s = sorted[i];
        if (s->sure <= target && best == NULL) {
            best = s;
        }
        describe(s, text, sizeof text);
        if (json) {
            char error[32] = "null", seconds[32] = "null"; // JSON has no infinity
            if (isfinite(s->error)) {
                snprintf(error, sizeof error, "%.6g", s->error);
            }
            if (isfinite(s->seconds)) {
                snprintf(seconds, sizeof seconds, "%.6g", s->seconds);
            }
            printf("%s{\"integrator\":\"%s\",\"substeps\":%d,\"tolerance\":%g,\"error\":%s,"
                   "\"seconds\":%s,\"scene\":%s}",
                   i == 0 ? "" : ",", s->stepping.integrator->name, s->stepping.substeps,
                   s->stepping.tolerance, error, seconds, s == own ? "true" : "false");
        } else if (s->error < front || s == own) { // faster than all that are as good
            printf("%-44s %10.2g %10.2g %11.2g %10.1e %12.3g%s\n", text, 100 * s->error,
                   100 * s->largest, 100 * s->produced, s->energy, s->seconds,
                   s == own ? "  the scene" : "");
        }
        front = fmin(front, s->error);
    }
    if (json) {
        printf("],\"advice\":%s", best == NULL ? "null}\n" : "");
        if (best != NULL) {
            printf("{\"integrator\":\"%s\",\"substeps\":%d,\"tolerance\":%g,\"error\":%.6g,"
                   "\"times_faster\":%.3g}}\n",
                   best->stepping.integrator->name, best->stepping.substeps,
                   best->stepping.tolerance, best->error, fmin(times_faster(own, best), DBL_MAX));
        }
    } else if (left > 0) {
        printf("\n%d of %d settings are left out: they need a larger --budget.\n", left,
               b->nsetting);
    }
    if (!json && best != NULL && !(CERTAIN * agreement <= best->error)) {
        printf("\nThe references agree to %.1e only: errors below %.1e are not certain.\n",
               agreement, CERTAIN * agreement);
    }
    if (b->options->picture != NULL) {
        // A block for each method, below its title.
        const char *const drawn[] = {"bench", b->options->picture, NULL};
        FILE *file;
        PM_TRY(pm_python_table(&file, b->options->picture, ".txt"));
        const pm_stepping *last = NULL;
        int nblock = 0;
        for (int i = 0; i < b->nsetting; ++i) {
            const setting *s = &b->setting[i];
            if (!s->served || !isfinite(s->error) || s->error <= 0) {
                continue;
            }
            const bool tolerance = s->stepping.tolerance != 0;
            char least[32] = "";
            if (tolerance) {
                snprintf(least, sizeof least, ", tolerance, %d", s->stepping.substeps);
            }
            if (nblock < 2 || s->stepping.integrator != last->integrator ||
                tolerance != (last->tolerance != 0) ||
                (tolerance && s->stepping.substeps != last->substeps)) {
                fprintf(file, "%s# %s%s\n", nblock++ == 0 ? "" : "\n\n",
                        i == 0 ? "the scene" : s->stepping.integrator->name, i == 0 ? "" : least);
            }
            last = &s->stepping;
            fprintf(file, "%.6g %.6g\n", s->error, s->seconds);
        }
        fclose(file);
        picture = nblock == 0 ? PM_OK : pm_python_run(&pm_python_pictures, drawn, false);
    }
    if (best == NULL) {
        return pm_fail(PM_EBROKEN, "bench: no setting reaches %g %%: the best has %.2g %%",
                       100 * target, 100 * finest);
    }
    if (b->options->write != NULL) {
        char *changed = strdup(b->text);
        pm_stepping stepping = best->stepping;
        stepping.steps = b->base.scene->run.steps;
        pm_status status = pm_allocated(changed, "a scene");
        if (status == PM_OK) {
            status = pm_scene_text_put_time(&changed, &stepping);
        }
        if (status == PM_OK) {
            status = pm_scene_text_write(changed, b->options->write, b->options->weights);
        }
        free(changed);
        PM_TRY(status);
    }
    if (!json) {
        const double faster = times_faster(own, best);
        char scene[64] = ", which is the scene's own setting";
        if (best != own && isfinite(own->error) && fabs(log(faster)) < ALIKE) {
            snprintf(scene, sizeof scene, ": as fast as the scene");
        } else if (best != own && isfinite(own->error)) {
            snprintf(scene, sizeof scene, ": %.1f times %s than the scene",
                     faster >= 1 ? faster : 1 / faster, faster >= 1 ? "faster" : "slower");
        } else if (best != own) {
            snprintf(scene, sizeof scene, ": the scene's own setting fails");
        }
        printf("\nFor %g %% take %s%s, %.2g %% over %g s.\n", 100 * target,
               describe(best, text, sizeof text), scene, 100 * best->error,
               b->steps * best->stepping.dt);
    }
    return picture;
}

// Adds a setting with the step of the scene's own, which is there already.
static void add(bench *b, const pm_integrator *integrator, int substeps, double tolerance) {
    const pm_stepping *own = &b->setting[0].stepping;
    if (b->nsetting < MOST_SETTINGS && (integrator != own->integrator ||
                                        substeps != own->substeps || tolerance != own->tolerance)) {
        pm_stepping *added = &b->setting[b->nsetting++].stepping;
        *added = *own;
        added->integrator = integrator;
        added->substeps = substeps;
        added->tolerance = tolerance;
    }
}

static pm_status execute(const pm_run_options *options) {
    bench b = {.options = options};
    const double budget = options->budget > 0 ? options->budget : BUDGET;
    const double target = options->error > 0 ? options->error : ERROR;
    double left = budget;
    pm_setup fixed = {0};
    pm_rollout_result trial;
    pm_status status;
    if (options->processes) {
        return pm_command_test.execute(options);
    }
    PM_TRY_DONE(pm_prepare(&b.base, options, PM_TO_COORDINATE));
    PM_TRY_DONE(pm_scene_text_read(b.base.scene->path, &b.text));
    PM_TRY_DONE(pm_scene_text_check(b.text, options->write, options->weights));
    PM_TRY_DONE(options->picture == NULL ? PM_OK
                                         : pm_python_check_pictures("bench", options->picture));
    const pm_physics *physics = &b.base.scene->physics;
    if (b.base.boundary_input.end < options->steps) {
        PM_TRY_DONE(pm_fail(PM_EUSAGE,
                            "%s: --steps %g: the table of the inputs ends after %ld steps",
                            b.base.scene->path, (double)options->steps, b.base.boundary_input.end));
    }
    const int rounds = physics->substeps * physics->integrator->nstage;
    b.nstart = pm_rollout_starts(&b.base, (uint64_t)options->seed + 1, TRAJECTORIES, STARTS, 0,
                                 &b.base.arena, b.start);
    // Time a few steps to find out how many fit into the budget. They are taken without a
    // tolerance, so that the number of their exchanges is known.
    const pm_stepping own = {physics->integrator, physics->substeps, physics->tolerance,
                             physics->dt, b.base.scene->run.steps};
    pm_rollout_spec spec = {.stepping = own, .factor = 1, .seconds = TRIAL};
    spec.stepping.tolerance = 0;
    PM_TRY_DONE(pm_rollout_open(&fixed, &b.base, b.text, &spec.stepping));
    pm_rollout_run(&fixed, &b.start[0], &spec, NULL, &trial);
    if (b.nstart < 1 || trial.steps < 1) {
        PM_TRY_DONE(
            pm_fail(trial.status == PM_OK ? PM_ENOMEM : trial.status, "bench: %s", trial.why));
    }
    const double cost = trial.seconds / (double)trial.steps / rounds; // s, of an exchange
    // Each reference is the task of one worker, and all workers share the rest.
    const double alone = 2 * REFERENCE_ROUNDS;
    const double shared = fmax(ALL_ROUNDS, ALL_TIMES * rounds) - alone;
    const double fit = SHARE * budget / (cost * (alone + shared / pm_rollout_nworker()) * b.nstart);
    const int least = options->steps > 0 ? b.base.scene->run.steps : LEAST_STEPS;
    if (fit < least) {
        b.nstart = (int)fmax(fmin(LEAST_STARTS, b.nstart), b.nstart * fit / least);
    }
    b.steps = fit < LEAST_STEPS ? LEAST_STEPS : fit > MOST_STEPS ? MOST_STEPS : (int)fit;
    if (options->steps > 0 || b.base.scene->run.steps < b.steps) {
        b.steps = b.base.scene->run.steps;
    }
    const size_t size = (size_t)(b.steps + 1) * (size_t)physics->nz * (size_t)b.nstart;
    b.setting = pm_rollout_shared(MOST_SETTINGS, sizeof *b.setting);
    b.reference = pm_rollout_shared(2, sizeof *b.reference);
    b.truth = pm_rollout_shared(size, sizeof *b.truth);
    b.produced = pm_rollout_shared(2 * STARTS, sizeof *b.produced);
    b.error = pm_rollout_shared(2 * CHOICES * FRESH * STARTS, sizeof *b.error);
    b.faster = b.error == NULL ? NULL : b.error + CHOICES * FRESH * STARTS;
    b.nfresh = pm_rollout_starts(&b.base, (uint64_t)options->seed + 1 + INT32_MAX, TRAJECTORIES,
                                 FRESH * b.nstart, 0, &b.base.arena, b.fresh);
    if (b.setting == NULL || b.reference == NULL || b.truth == NULL || b.produced == NULL ||
        b.error == NULL) {
        PM_TRY_DONE(pm_fail(PM_ENOMEM, "out of memory for a bench"));
    }
    b.other = b.produced + STARTS;
    // All settings; the scene's own comes first.
    static const int ladder[] = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128};
    const int finest = MOST_TIMES * rounds;
    const int most = finest > MOST_ROUNDS ? finest : MOST_ROUNDS;
    char names[256];
    b.setting[b.nsetting++].stepping = own;
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL;) {
        const pm_integrator *rk = pm_integrator_find(name);
        // Methods of low order need more substeps than the others for the same error.
        for (size_t i = 0; i < sizeof ladder / sizeof *ladder; ++i) {
            if (ladder[i] * rk->nstage <= most) {
                add(&b, rk, ladder[i], 0);
            }
        }
        // Substeps by tolerance, and never fewer than the scene takes where its method needs them.
        for (int k = 0; k < (own.substeps > 1 ? 2 : 1) && rk->embedded > 0; ++k) {
            for (int digits = 2; digits <= 7; ++digits) {
                add(&b, rk, k == 0 ? 1 : own.substeps, pow(10, -digits));
            }
        }
    }
    static const char *const high[] = {"rk6", "rk4"};
    for (int i = 0; i < 2; ++i) {
        const pm_integrator *rk = pm_integrator_find(high[i]);
        b.reference[i].stepping =
            (pm_stepping){rk, REFERENCE_ROUNDS / rk->nstage, 0, physics->dt, b.steps};
    }
    // The second reference is compared with the first.
    for (int i = -2; i < 0; ++i) {
        PM_TRY_DONE(pm_rollout_parallel(i, 1, measure, &b, &left, "reference", options->stop));
    }
    if (!b.reference[1].done || !b.reference[0].served || !b.reference[1].served) {
        PM_TRY_DONE(pm_fail(PM_EBROKEN, "bench: no reference: %.200s",
                            b.reference[1].done
                                ? b.reference[0].first.why
                                : "it takes more than the --budget: allow more, or fewer --steps"));
    }
    left -= KEPT * budget;
    PM_TRY_DONE(pm_rollout_parallel(0, b.nsetting, measure, &b, &left, "bench", options->stop));
    left += KEPT * budget;
    PM_TRY_DONE(choose(&b, target / 100, &left));
    status = report(&b, target / 100);
done:
    free(b.text);
    pm_setup_free(&fixed);
    pm_setup_free(&b.base);
    return status;
}

const pm_command pm_command_bench = {
    .name = "bench",
    .summary = "find the integrator of a scene: run time against error",
    .arguments = "SCENE",
    .help =
        "Runs the scene in one process with every integrator that can serve it, with substeps and\n"
        "tolerances from coarse to fine, from several starts: the scene's own, the reference's, "
        "and\n"
        "random ones within the training range. Compares them with a reference of its own, two\n"
        "methods of high order with many substeps. Prints the settings that are faster than all\n"
        "that are as good, with medians over the starts: the error of the states in the worst "
        "group,\n"
        "of the entropy produced, the drift of the energy, and the CPU time for a simulated "
        "second.\n"
        "The last line is the fastest setting for the error asked for; --write writes a scene "
        "with\n"
        "it. The same --seed takes the same starts. The --budget is CPU time of the busiest "
        "process.\n"
        "Exit code 14: no setting reaches that error.\n\n"
        "With --processes it runs the scene in one process, in a process for each subsystem, and "
        "in as\n"
        "many as there are cores, cut by cost, with windows of 1 to 64 steps, and prints what a "
        "step\n"
        "costs and who waits for whom. It needs a private network, as `portmetd test` does. "
        "Inputs\n"
        "that lie in a table keep their means.",
    .examples = "portmetd bench configs/double_pendulum.yaml\n"
                "portmetd bench scene.yaml --error 1 --write faster.yaml",
    .accepts = "steps weights study error compiled json",
    .execute = execute,
};

// Validates a fit in progress: rollouts on the validation part decide which weights are kept, and
// fit.csv records losses and errors.
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "evaluate/gnuplot.h"
#include "learn/fit.h"

#define MOST_ROLLOUTS 8     // in one validation
#define MOST_VALIDATIONS 10 // in a stage
#define FEWEST_ROWS 3       // of fit.csv, below which it is not drawn
#define SHARE 0.1           // of the time at most, besides one validation at the end of each stage
// The cost of an operation of a rollout, which runs sample by sample, in operations of the
// training, which runs in batches.
#define ROLLOUT_COST 4

static int rollouts_of(const pm_fit *f) {
    return f->split.nvalidation < MOST_ROLLOUTS ? f->split.nvalidation : MOST_ROLLOUTS;
}

int pm_fit_interval(const pm_fit *f, const pm_stage *stage) {
    const pm_scene *scene = f->training->scene;
    const pm_integrator *served = scene->integrator;
    const pm_loss *loss = &stage->loss;
    const double samples = (double)f->split.ntraining * f->dataset->ntime;
    const bool least_squares = strncmp(stage->optimiser->name, "gauss_newton", 12) == 0;
    const double batch = least_squares ? fmin(stage->schedule.batch, samples) : samples;
    const double evaluations =
        loss->residual == PM_RESIDUAL_DERIVATIVE
            ? 1
            : (double)loss->substeps * loss->integrator->nstage * stage->unroll;
    const double backward = least_squares ? 2.0 * scene->nz * stage->unroll : 4;
    const double training = stage->schedule.iterations * batch * evaluations * backward;
    const double rollouts = (double)rollouts_of(f) * f->dataset->ntime * scene->substeps *
                            (served == NULL ? 4 : served->nstage) * ROLLOUT_COST;
    const double count = fmin(fmax(SHARE * training / fmax(rollouts, 1), 1), MOST_VALIDATIONS);
    return (int)ceil(stage->schedule.iterations / floor(count));
}

pm_status pm_fit_measure(const pm_fit *f, bool validation, pm_measure *measure) {
    const int training = f->split.ntraining;
    const int first = validation ? training : 0;
    const int count = validation                 ? f->split.nvalidation
                      : training < MOST_ROLLOUTS ? training
                                                 : MOST_ROLLOUTS;
    const pm_evaluate_how how = {.threads = 2, .stop = f->stop};
    return pm_measure_make(measure, f->training->system, f->dataset, first, first + count, true,
                           &how);
}

static void keep_best(pm_fit *f, double score) {
    if (f->position[PM_FIT_BEST] < 0 || score < f->position[PM_FIT_BEST]) {
        f->position[PM_FIT_BEST] = score;
        f->position[PM_FIT_BEST_STAGE] = f->stage;
        f->position[PM_FIT_BEST_DONE] = f->position[PM_FIT_DONE];
        memcpy(f->best, f->theta, (size_t)f->size * sizeof *f->best);
    }
}

pm_status pm_fit_validate(pm_fit *f, double *score) {
    *score = NAN;
    if (f->split.nvalidation == 0) {
        return PM_OK;
    }
    const double started = pm_clock();
    const int first = f->split.ntraining;
    const pm_evaluate_how how = {.threads = 2};
    pm_measure m;
    pm_fit_set_weights(f, f->theta);
    PM_TRY(pm_measure_make(&m, f->training->system, f->dataset, first, first + rollouts_of(f),
                           false, &how));
    *score = m.score;
    keep_best(f, m.score);
    pm_measure_free(&m);
    f->validated += pm_clock() - started;
    return PM_OK;
}

// --- curves ---

pm_status pm_fit_open_curves(pm_fit *f) {
    const char *path = pm_team_leads(f->arguments->team)
                           ? pm_arena_printf(&f->arena, "%s/fit.csv", f->arguments->output)
                           : "/dev/null";
    if (path == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a path");
    }
    const bool further = f->arguments->resume && access(path, F_OK) == 0;
    f->curves = fopen(path, further ? "a" : "w");
    if (f->curves == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be written", path);
    }
    if (!further) {
        fprintf(f->curves, "stage,optimiser,iteration,seconds,loss,validation\n");
    }
    return PM_OK;
}

void pm_fit_write_curves(pm_fit *f, const char *optimiser, double loss, double score) {
    fprintf(f->curves, "%d,%s,%d,%.3f,%.6e,", f->stage + 1, optimiser,
            (int)f->position[PM_FIT_DONE], f->position[PM_FIT_SECONDS] + pm_clock() - f->saved,
            loss);
    if (isfinite(score)) {
        fprintf(f->curves, "%.6e", score);
        ++f->nscore;
    }
    ++f->nrow;
    fprintf(f->curves, "\n");
    fflush(f->curves);
}

void pm_fit_draw_curves(const pm_fit *f) {
    char path[4096];
    if (f->nrow < FEWEST_ROWS) {
        return; // gnuplot warns about empty ranges
    }
    snprintf(path, sizeof path, "%s/fit.gp", f->arguments->output);
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        return;
    }
    fprintf(file, "set terminal pngcairo size 900,450 font 'DejaVu Sans,11' background 'white'\n"
                  "set output 'fit.png'\n"
                  "set datafile separator ','\n"
                  "set border 3 linecolor '#555555'\n"
                  "set tics nomirror out\n"
                  "set grid linetype 1 linecolor '#e4e4e4'\n"
                  "set logscale y\nset format y '10^{%%L}'\n"
                  "set xlabel 'time of training, s'\n"
                  "plot 'fit.csv' using 4:5 every ::1 with lines linecolor '#0072b2' title 'loss'");
    if (f->nscore > 0) {
        fprintf(file, ", 'fit.csv' using 4:6 every ::1 with points pointtype 7 linecolor '#d55e00' "
                      "title 'rollouts on the validation part: error relative to persistence'");
    }
    fputc('\n', file);
    if (fclose(file) == 0) {
        (void)pm_gnuplot_run(f->arguments->output, "fit.gp"); // a fit does not fail for its picture
    }
}

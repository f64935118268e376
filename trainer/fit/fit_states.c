// A fit to states: runs the stages, validates by rollouts on the validation part, which decide
// which weights are kept, and prints the table of errors and the verdict at the end. fit.csv
// records losses and errors.
#include <math.h>
#include <string.h>

#include "data/trained.h"
#include "data/unit_change.h"
#include "fit/fit.h"
#include "inference/spectrum.h"
#include "model/constants.h"

// Training begins again with other initial weights if the best rollouts on the validation part have
// more than this fraction of the error of persistence.
#define UNLUCKY 0.005
#define MOST_ATTEMPTS 3
// Other weights are drawn before the training where the squared residual of rates is above
// BAD_START times the square of their size, as long as that lowers it by FALLS.
#define BAD_START 1e-4
#define FALLS 0.5
// The number of substeps is doubled at most so often.
#define MOST_FINER 6
#define MOST_ROLLOUTS 8     // in one validation
#define MOST_CONSTANTS 24   // that are printed
#define MOST_VALIDATIONS 10 // in a stage
#define SHARE 0.1           // of the time at most, besides one validation at the end of each stage
// The cost of an operation of a rollout, which runs sample by sample, in operations of the
// training, which runs in batches.
#define ROLLOUT_COST 4

// An error of one step below which a group is exact in a short fit.
#define EXACT_STEP 1e-5

// A group that is worse than persistence is unfit only above this relative error. Below, the group
// hardly changes.
#define NEGLIGIBLE 0.01
// The error of one step, relative to its length, below which a verdict may be fair, and those of
// what depends on temperatures, below which it is good or fair.
#define STEP_FAIR 1.0
#define WARM_GOOD 0.05
#define WARM_FAIR 0.3

// --- data ---

static pm_status load(pm_fit *f) {
    PM_TRY(pm_dataset_load(&f->dataset, f->data));
    PM_TRY(pm_unit_change_apply(f->training->scene, f->dataset, true));
    const double dt = f->training->scene->physics.dt;
    if (f->dataset->dt < dt * (1 - 1e-9) || f->dataset->dt > dt * (1 + 1e-9)) {
        return pm_fail(PM_EDATA, "%s: states are %g s apart, the scene %s steps by %g s", f->data,
                       f->dataset->dt, f->training->scene->path, dt);
    }
    return PM_OK;
}

// Leaves out the states after the first seconds of each trajectory.
static pm_status shorten(pm_fit *f) {
    const double steps = f->training->seconds / f->dataset->dt * (1 + 1e-9);
    if (steps < 1) {
        return pm_fail(PM_EDATA, "%s: seconds: %g s are shorter than a step of %g s",
                       f->arguments->config, f->training->seconds, f->dataset->dt);
    }
    if (steps < f->dataset->ntime - 1) {
        pm_dataset_shorten(f->dataset, (int)steps + 1);
    }
    return PM_OK;
}

static void describe(const pm_fit *f) {
    printf("%d states", f->dataset->ntime);
}

// --- validation and curves ---

static int rollouts_of(const pm_fit *f) {
    return f->split.nvalidation < MOST_ROLLOUTS ? f->split.nvalidation : MOST_ROLLOUTS;
}

pm_status pm_fit_measure(const pm_fit *f, bool validation, pm_measure *measure) {
    const int training = f->split.ntraining;
    const int first = validation ? training : 0;
    const int count = validation                 ? f->split.nvalidation
                      : training < MOST_ROLLOUTS ? training
                                                 : MOST_ROLLOUTS;
    const pm_evaluate_how how = {.threads = 2, .stop = f->interrupted ? NULL : f->stop};
    return pm_measure_make(measure, f->training->system, f->dataset, first, first + count, true,
                           &how);
}

// Rolls out on the validation part with the present weights, and keeps them if they are the best so
// far. Writes their score (evaluate/measure.h) to *score, or NAN without a validation part.
static pm_status validate(pm_fit *f, double *score) {
    *score = NAN;
    if (f->split.nvalidation == 0 || f->arguments->effort != NULL) {
        return PM_OK;
    }
    const int first = f->split.ntraining;
    const pm_evaluate_how how = {.threads = 2};
    pm_measure m;
    pm_trained_scatter(f->training->system, f->theta);
    PM_TRY(pm_measure_make(&m, f->training->system, f->dataset, first, first + rollouts_of(f),
                           false, &how));
    *score = m.score;
    if (f->position.best < 0 || m.score < f->position.best) {
        f->position.best = m.score;
        f->position.best_stage = f->position.stage;
        f->position.best_done = f->position.done;
        memcpy(f->best, f->theta, (size_t)f->size * sizeof *f->best);
    }
    pm_measure_free(&m);
    return PM_OK;
}

// Writes one row of fit.csv.
static void write_curves(pm_fit *f, const char *optimiser, double loss, double score) {
    fprintf(f->curves, "%d,%s,%d,%.3f,%.6e,", f->position.stage + 1, optimiser, f->position.done,
            f->position.seconds + pm_clock() - f->saved, loss);
    if (isfinite(score)) {
        fprintf(f->curves, "%.6e", score);
    }
    fprintf(f->curves, "\n");
    fflush(f->curves);
}

// --- stages ---

static pm_status report_progress(void *context, const pm_optimisation *o, double loss) {
    pm_fit *f = context;
    char detail[64];
    snprintf(detail, sizeof detail, "loss %.3e", loss);
    pm_progress_update(&f->progress, o->done, detail);
    f->position.done = o->done;
    f->position.batches = o->batches;
    f->position.loss = o->loss;
    f->loss = loss;
    if (o->batches == 0) {
        double score = NAN;
        const bool last = o->done >= o->schedule.iterations; // validated when the stage has ended
        if (o->done % f->interval == 0 && !last) {
            PM_TRY(validate(f, &score));
        }
        if (!last) {
            write_curves(f, f->training->stage[f->position.stage].optimiser->name, loss, score);
        }
    }
    if (pm_team_any(f->arguments->team, *f->stop)) {
        PM_TRY(pm_fit_save(f, false));
        return pm_fail(PM_EINTERRUPTED, "interrupted; continue with --resume");
    }
    const double limit = f->arguments->limit;
    f->expired = limit > 0 && pm_fit_processor_time(f) > limit;
    if (f->expired) {
        return pm_fail(PM_EINTERRUPTED, "the time for training is over");
    }
    return pm_clock() - f->saved > PM_FIT_CHECKPOINT_INTERVAL ? pm_fit_save(f, false) : PM_OK;
}

static pm_status optimise(pm_fit *f, pm_objective *objective) {
    const pm_stage *stage = &f->training->stage[f->position.stage];
    // A stage begins or is resumed.
    pm_objective_set_weights(objective, f->theta);
    pm_objective_evaluate(objective, 0, NULL, NULL);       // so that all residuals are up to date
    if (f->position.done > 0 || f->position.batches > 0) { // resumed
        pm_objective_set_robust_square(objective, f->position.robust);
    } else {
        PM_TRY(pm_objective_rescale(objective, 0, NULL));
        f->position.robust = pm_objective_robust_square(objective);
    }
    pm_optimisation o = {.objective = objective,
                         .schedule = stage->schedule,
                         .seed = f->training->seed + 1000 * (uint64_t)(f->position.stage + 1),
                         .theta = f->theta,
                         .moment = f->moment,
                         .done = f->position.done,
                         .batches = f->position.batches,
                         .loss = f->position.loss,
                         .report = report_progress,
                         .context = f};
    char label[64];
    snprintf(label, sizeof label, "stage %d/%d %s", f->position.stage + 1, f->training->nstage,
             stage->optimiser->name);
    pm_progress_init(&f->progress, label, stage->schedule.iterations);
    const double started = pm_clock();
    const pm_status status = stage->optimiser->run(&o);
    pm_progress_finish(&f->progress);
    PM_TRY(f->expired ? PM_OK : status);
    double score = NAN, median = 0, mean = 0;
    pm_objective_set_weights(objective, f->theta);
    PM_TRY(validate(f, &score));
    write_curves(f, stage->optimiser->name, f->loss, score);
    pm_objective_evaluate(objective, 0, NULL, NULL); // so that all residuals are up to date
    PM_TRY(pm_objective_residuals(objective, &median, &mean));
    printf("%-16s %8d iterations %8.1f s   loss %.3e", label, o.done, pm_clock() - started,
           f->loss);
    if (isfinite(score)) {
        printf("   validation %.3g %% of persistence", 100 * score);
    }
    printf("   squared residual: median %.3e mean %.3e\n", median, mean);
    fflush(stdout);
    return f->training->plain || f->arguments->effort != NULL ||
                   f->position.stage < f->training->nstage - 1
               ? PM_OK
               : pm_spectrum_report(objective, stdout);
}

static pm_status run_stage(pm_fit *f) {
    const pm_stage *stage = &f->training->stage[f->position.stage];
    pm_samples samples;
    PM_TRY(pm_samples_make(&samples, f->training->scene, f->dataset, 0, f->split.ntraining,
                           stage->loss.residual, stage->unroll, pm_loss_input_order(&stage->loss)));
    pm_samples_rescale(&samples, stage->loss.scale);
    pm_objective *objective = NULL;
    // The number of iterations between two validations of the stage, such that validation takes at
    // most a tenth of the time. Operations are counted instead of seconds, so that results do not
    // depend on the clock.
    const pm_scene *scene = f->training->scene;
    const pm_integrator *served = scene->physics.integrator;
    const pm_loss *loss = &stage->loss;
    const double states = (double)f->split.ntraining * f->dataset->ntime;
    const bool least_squares = stage->optimiser->least_squares;
    const double batch = least_squares ? fmin(stage->schedule.batch, states) : states;
    const double evaluations =
        loss->residual == PM_RESIDUAL_DERIVATIVE
            ? 1
            : (double)loss->substeps * loss->integrator->nstage * stage->unroll;
    const double backward = least_squares ? 2.0 * scene->physics.nz * stage->unroll : 4;
    const double training = stage->schedule.iterations * batch * evaluations * backward;
    const double rollouts = (double)rollouts_of(f) * f->dataset->ntime * scene->physics.substeps *
                            (served == NULL ? 4 : served->nstage) * ROLLOUT_COST;
    const double count = fmin(fmax(SHARE * training / fmax(rollouts, 1), 1), MOST_VALIDATIONS);
    f->interval = (int)ceil(stage->schedule.iterations / floor(count));
    pm_status status = pm_objective_open(&objective, f->training->system, &samples, &stage->loss);
    if (status == PM_OK) {
        status = optimise(f, objective);
    }
    pm_objective_close(objective);
    pm_samples_free(&samples);
    return status;
}

// Doubles the number of substeps of all stages of steps.
static void refine(pm_fit *f) {
    for (int i = 0; i < f->training->nstage; ++i) {
        pm_loss *loss = &f->training->stage[i].loss;
        loss->substeps *= loss->residual == PM_RESIDUAL_STEP ? 2 : 1;
    }
}

static void begin_stage(pm_fit *f, int stage) {
    f->position.stage = stage;
    f->position.done = f->position.batches = 0;
    f->position.loss = 0;
    memset(f->moment, 0, 2 * (size_t)f->size * sizeof *f->moment);
}

static void resume(pm_fit *f) {
    printf("resumes stage %d after %d iterations\n", f->position.stage + 1, f->position.done);
    for (int i = 0; i < f->position.finer; ++i) {
        refine(f);
    }
}

// The checkpoint of the last stage remains, so that a longer last stage can be resumed from it.
static pm_status run_stages(pm_fit *f) {
    while (!f->expired) {
        const int stage = f->position.stage;
        pm_status status = run_stage(f);
        // If the stage has failed in its first iteration, its substeps are most likely too long for
        // an explicit integrator of the model, and it begins again with more of them. What the
        // training file says exactly stays as it is.
        while (status == PM_ENUMERIC && !f->training->plain && f->position.done == 0 &&
               f->position.finer < MOST_FINER &&
               f->training->stage[stage].loss.residual == PM_RESIDUAL_STEP) {
            ++f->position.finer;
            refine(f);
            printf("stage %d/%d: %s. The stage begins again with %d substeps.\n", stage + 1,
                   f->training->nstage, pm_error(), f->training->stage[stage].loss.substeps);
            status = run_stage(f);
        }
        // If it fails later, it ends, and training goes on from the best weights so far.
        if (status == PM_ENUMERIC && f->position.best >= 0) {
            printf("stage %d/%d ends after %d iterations: %s. Training goes on from the best "
                   "weights.\n",
                   stage + 1, f->training->nstage, f->position.done, pm_error());
            memcpy(f->theta, f->best, (size_t)f->size * sizeof *f->theta);
            status = PM_OK;
        }
        PM_TRY(status);
        if (!f->expired) { // also if it has settled before its last iteration
            f->position.done = f->training->stage[stage].schedule.iterations;
        }
        PM_TRY(pm_fit_save(f, false));
        if (stage + 1 == f->training->nstage) {
            break;
        }
        begin_stage(f, stage + 1);
    }
    return PM_OK;
}

// Chooses initial weights, and others where they are bad: a training that begins badly takes long
// to end badly.
static pm_status start(pm_fit *f) {
    double *best = pm_arena_array(&f->arena, (size_t)f->size + 1, sizeof *best);
    double least = INFINITY, loss = NAN;
    const int first = f->position.attempt;
    PM_TRY(pm_arena_status(&f->arena, "initial weights"));
    if (f->training->from != NULL && first == 0) {
        return pm_fit_load_start(f);
    }
    pm_status status = pm_fit_search_start(f, &loss);
    while (status == PM_OK && loss > BAD_START && loss < FALLS * least &&
           f->arguments->effort == NULL && f->position.attempt + 1 < MOST_ATTEMPTS) {
        least = loss;
        memcpy(best, f->theta, (size_t)f->size * sizeof *best);
        ++f->position.attempt;
        printf("this start is bad: other initial weights are drawn\n");
        status = pm_fit_search_start(f, &loss);
    }
    if (status != PM_OK) { // interrupted: the choice begins again
        f->position.attempt = first;
    } else if (least < INFINITY && !(loss < least)) {
        memcpy(f->theta, best, (size_t)f->size * sizeof *best);
    }
    return status;
}

static pm_status run(pm_fit *f) {
    pm_status status = run_stages(f);
    // The best weights may be so bad on the validation part that other initial weights are worth
    // the time, and so are they where the loss has not been finite from the beginning.
    const bool whole = f->arguments->effort == NULL;
    while ((status == PM_OK || status == PM_ENUMERIC) && whole && !f->expired &&
           f->training->tries > 1 && f->position.attempt + 1 < MOST_ATTEMPTS &&
           (status == PM_ENUMERIC || f->position.best > UNLUCKY)) {
        ++f->position.attempt;
        begin_stage(f, 0);
        if (status == PM_OK) {
            printf("rollouts on the validation part are bad: other initial weights are tried\n");
        } else {
            printf("%s: other initial weights are tried\n", pm_error());
        }
        status = start(f);
        status = status == PM_OK ? run_stages(f) : status;
    }
    if (status == PM_ENUMERIC && f->position.best >= 0) {
        status = PM_OK; // an attempt before was finite
    }
    return status == PM_ENUMERIC
               ? pm_fail(PM_EUNFIT, "no initial weights lead to a model: %s", pm_error())
               : status;
}

typedef struct fit_report {
    pm_fit *fit;
    pm_measure training, validation;
    const pm_measure *judged;    // the validation part, or where there is none the training part
    const pm_measure *black_box; // or NULL
    pm_measure regression;       // the black box, if none was given
    char regression_name[80];
    double regression_seconds; // of CPU
} fit_report;

// --- the table ---

static void print_number(double value) {
    if (isnan(value)) {
        printf(" %8s", "-");
    } else {
        printf(" %8.3g", 100 * value);
    }
}

static void print_rollouts(const pm_measure_cell *cell) {
    print_number(cell->rollout.median);
    print_number(cell->rollout.mean);
    print_number(cell->rollout.largest);
}

static void print_cells(const fit_report *r) {
    const bool both = r->validation.evaluation != NULL;
    printf("\nErrors, %%             one step%s rollouts: %s%s  persistence%s\n",
           both ? "          " : " ", both ? "training                   " : "training",
           both ? "validation           " : "         ", r->black_box != NULL ? "  black box" : "");
    printf("  %-18s %8s", "part, group", "training");
    printf(both ? " %8s" : "%s", both ? "valid." : "");
    for (int i = 0; i < (both ? 2 : 1); ++i) {
        printf(" %8s %8s %8s", "median", "mean", "worst");
    }
    printf(" %8s", "median");
    printf(r->black_box != NULL ? " %8s\n" : "%s\n", r->black_box != NULL ? "median" : "");
    for (int c = 0; c < r->training.ncell; ++c) {
        const pm_measure_cell *t = &r->training.cell[c];
        printf("  %-10s %-7s", t->part, t->group);
        print_number(t->one_step);
        if (both) {
            print_number(r->validation.cell[c].one_step);
        }
        print_rollouts(t);
        if (both) {
            print_rollouts(&r->validation.cell[c]);
        }
        print_number(r->judged->cell[c].persistence.median);
        if (r->black_box != NULL) {
            print_number(r->black_box->cell[c].rollout.median);
        }
        printf("\n");
    }
    if (r->training.ncell > 0 && isnan(r->training.cell[0].one_step)) {
        printf("Errors of one step are not measured where boundary inputs act.\n");
    }
}

// Returns the production of entropy; NULL: there is none.
static const pm_thermo_row *production_of(const pm_measure *m) {
    const bool first = m->thermo.count > 0 && strcmp(m->thermo.row[0].kind, "production") == 0;
    return first ? &m->thermo.row[0] : NULL;
}

static void print_production(const char *where, const pm_measure *m) {
    const pm_thermo_row *row = production_of(m);
    if (row != NULL) {
        printf("Entropy produced over a run, %s: %.3g J/K, off by %.3g %% (mean %.3g, worst %.3g; "
               "bias %+.3g)\n",
               where, row->typical, 100 * row->median, 100 * row->mean, 100 * row->largest,
               100 * row->bias);
    }
}

static void print_laws(const pm_measure *m) {
    const pm_evaluation *e = m->evaluation;
    if (pm_system_without_energy(e->system) >= 0) {
        printf("Laws: not defined, as the model is free of structure and has no energy\n");
        return;
    }
    double residual = 0, drift = 0, fall = 0;
    long violations = 0;
    for (int i = 0; i < e->count; ++i) {
        const pm_ledger *ledger = &e->rollout[i].ledger;
        residual = fmax(residual, ledger->worst_energy);
        drift = fmax(drift, ledger->energy_drift);
        fall = fmax(fall, ledger->worst_entropy_fall);
        violations += ledger->violations;
    }
    printf("Laws: largest energy residual %.2e, steps in violation %ld; the total energy drifts by "
           "%.2e J at most, the total entropy falls by %.2e J/K at most\n",
           residual, violations, drift, fall);
    if (m->thermo.warmest != 0) {
        printf("Temperatures: %.6g to %.6g K%s\n", m->thermo.coldest, m->thermo.warmest,
               m->thermo.coldest > 0 ? "" : ", NOT POSITIVE: the energy falls with the entropy");
    }
}

// Prints the learned constants.
static void print_constants(const pm_system *system) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const double value = pm_trained_constant(system, i, entry);
            if (isnan(value)) {
                continue;
            }
            if (count < MOST_CONSTANTS) {
                printf("%s  %s.%s = %.5g\n", count == 0 ? "Learned constants:\n" : "",
                       pm_trained_name(system, i), pm_constant_name(entry->name), value);
            }
            ++count;
        }
    }
    if (count > MOST_CONSTANTS) {
        printf("  and %d more\n", count - MOST_CONSTANTS);
    }
}

// --- the verdict ---

static void print_verdict(const fit_report *r, const char *where, char *record) {
    const pm_measure *m = r->judged;
    pm_verdict v = {.count = 0};
    // The group whose rollouts have the largest error relative to persistence, and that with the
    // largest error of one step, among those with more than a negligible error.
    const pm_measure_cell *worst = NULL, *step = NULL;
    double ratio = 0;
    for (int c = 0; c < m->ncell; ++c) {
        const pm_measure_cell *cell = &m->cell[c];
        const double own = cell->rollout.median / cell->persistence.median;
        if (cell->rollout.median > NEGLIGIBLE) {
            worst = own > ratio ? cell : worst;
            ratio = fmax(ratio, own);
            step = step == NULL || cell->one_step > step->one_step ? cell : step;
        }
    }
    pm_verdict_compare(&v, m->score, PM_VERDICT_GOOD, PM_VERDICT_FAIR,
                       "rollouts have %.3g %% of that error", 100 * m->score);
    if (worst != NULL) {
        pm_verdict_compare(&v, ratio, PM_VERDICT_FAIR, INFINITY,
                           "those of %s of %s have %.3g %% of it", worst->group, worst->part,
                           100 * ratio);
        pm_verdict_compare(&v, step->one_step, PM_VERDICT_STEP, STEP_FAIR,
                           "one step of %s of %s is wrong by %.3g %% of its length", step->group,
                           step->part, 100 * step->one_step);
    }
    const pm_thermo_row *produced = production_of(m);
    if (produced != NULL) {
        pm_verdict_compare(&v, produced->median, WARM_GOOD, WARM_FAIR,
                           "the entropy produced is off by %.3g %%", 100 * produced->median);
    }
    const double warmer = m->thermo.warmer;
    pm_verdict_compare(&v, fabs(warmer), WARM_GOOD, WARM_FAIR,
                       "energy is balanced in the true states only if temperatures are %.3g %% "
                       "%s, some %.2g K",
                       100 * fabs(warmer), warmer > 0 ? "lower" : "higher",
                       0.5 * (m->thermo.coldest + m->thermo.warmest) * fabs(warmer));
    if (r->black_box != NULL) {
        const double times = m->score / r->black_box->score;
        pm_verdict_compare(&v, m->score > PM_VERDICT_NEGLIGIBLE ? times : 0, PM_VERDICT_LOSES,
                           INFINITY, "the structure loses: a black box has %.3g times less error",
                           times);
    }
    char text[400];
    int n = snprintf(text, sizeof text,
                     "On the %s part rollouts have %.3g %% of the error of a state that stays as "
                     "it is (geometric mean over groups",
                     where, 100 * m->score);
    if (worst != NULL && ratio >= PM_VERDICT_GOOD) {
        n += snprintf(text + n, sizeof text - (size_t)n,
                      "; %.60s of %.60s is the worst with %.3g %%", worst->group, worst->part,
                      100 * ratio);
    }
    if (r->black_box != NULL) {
        snprintf(text + n, sizeof text - (size_t)n, "); the black box has %.3g %%.",
                 100 * r->black_box->score);
    } else {
        snprintf(text + n, sizeof text - (size_t)n, ").");
    }
    pm_verdict_print(&v, text, record);
}

static pm_status judge(const fit_report *r) {
    const pm_measure *m = r->judged;
    const char *where = m == &r->validation ? "validation" : "training";
    const pm_measure_cell *worse = NULL; // the first group that is worse than persistence
    for (int c = m->ncell - 1; c >= 0; --c) {
        const pm_measure_cell *cell = &m->cell[c];
        if (cell->rollout.median >= cell->persistence.median && cell->rollout.median > NEGLIGIBLE) {
            worse = cell;
        }
    }
    char *record = r->fit->verdict;
    if (m->failures > 0) {
        return pm_verdict_unfit(record, "%d of %d rollouts on the %s part are not finite",
                                m->failures, m->evaluation->count, where);
    }
    if (worse != NULL || m->score >= 1) {
        return pm_verdict_unfit(record,
                                "on the %s part the model is worse than a state that stays as it "
                                "is, in %s of %s",
                                where, worse == NULL ? "all groups" : worse->group,
                                worse == NULL ? "all parts" : worse->part);
    }
    print_verdict(r, where, record);
    return PM_OK;
}

static pm_status report(pm_fit *fit, const pm_measure *black_box) {
    fit_report r = {.fit = fit, .black_box = black_box};
    pm_status status;
    PM_TRY_DONE(pm_fit_measure(fit, false, &r.training));
    r.judged = &r.training;
    if (fit->split.nvalidation > 0) {
        PM_TRY_DONE(pm_fit_measure(fit, true, &r.validation));
        r.judged = &r.validation;
    }
    if (black_box == NULL) {
        const int ntraining = fit->split.ntraining;
        const int first = r.judged == &r.validation ? ntraining : 0;
        const double before = pm_fit_processor_time(fit);
        PM_TRY_DONE(pm_measure_black_box(&r.regression, fit->training->system, fit->dataset,
                                         ntraining, first, first + r.judged->evaluation->count,
                                         PM_FIT_BLACK_BOX_SECONDS, r.regression_name));
        r.black_box = r.regression.evaluation != NULL ? &r.regression : NULL;
        r.regression_seconds = pm_fit_processor_time(fit) - before;
    }
    const pm_fit *f = r.fit;
    print_constants(f->training->system);
    print_cells(&r);
    if (r.judged == &r.validation) {
        printf("Rollouts of %d training and %d validation trajectories, %d states each.\n",
               r.training.evaluation->count, r.validation.evaluation->count, f->dataset->ntime);
    }
    if (r.regression.evaluation != NULL) {
        printf("Black box: %s, a regression without structure, in %.2g s of CPU.\n",
               r.regression_name, r.regression_seconds);
    }
    print_production("training", &r.training);
    if (r.validation.evaluation != NULL) {
        print_production("validation", &r.validation);
    }
    print_laws(r.judged);
    status = judge(&r);
done:
    pm_measure_free(&r.training);
    pm_measure_free(&r.validation);
    pm_measure_free(&r.regression);
    return status;
}

// The error of one step counts each group alike, also one that is already very good.
static pm_status score_states(pm_fit *f, pm_fit_score *score) {
    const bool validation = f->split.nvalidation > 0;
    const int first = validation ? f->split.ntraining : 0;
    const int all = validation ? f->split.nvalidation : f->split.ntraining;
    const pm_evaluate_how how = {.threads = 2, .stop = f->stop};
    pm_measure m;
    PM_TRY(pm_measure_make(&m, f->training->system, f->dataset, first,
                           first + (all < PM_FIT_SCORED_ROLLOUTS ? all : PM_FIT_SCORED_ROLLOUTS),
                           true, &how));
    double sum = 0;
    int count = 0;
    for (int c = 0; c < m.ncell; ++c) {
        const pm_measure_cell *cell = &m.cell[c];
        if (cell->persistence.median > 0) {
            const double own = isnan(cell->one_step)
                                   ? cell->rollout.median / cell->persistence.median
                                   : cell->one_step;
            sum += log(cell->one_step < EXACT_STEP ? EXACT_STEP : cell->one_step);
            if (c < PM_FIT_SCORED_GROUPS) {
                score->group[c] = own < EXACT_STEP ? EXACT_STEP : own;
            }
            ++count;
        }
    }
    score->nrollout = m.evaluation->count;
    memcpy(score->each, m.each, (size_t)score->nrollout * sizeof *m.each);
    const pm_thermo_row *produced = production_of(&m);
    score->step = count > 0 ? exp(sum / count) : NAN;
    score->rollout = m.score;
    score->production = produced == NULL ? NAN : produced->median;
    pm_measure_free(&m);
    return PM_OK;
}

const pm_fit_kind pm_fit_of_states = {load,   shorten, describe, start,
                                      resume, run,     report,   score_states};

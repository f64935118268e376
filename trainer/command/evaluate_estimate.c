// Scores predictions from estimated starts against measurements and, where they exist, against
// states without noise; and draws them.
#include "command/evaluate_estimate.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/options.h"
#include "base/python.h"
#include "data/unit_change.h"
#include "evaluate/evaluate.h"
#include "inference/estimate.h"
#include "store/hdf5_io.h"

#define NINETY_PER_CENT 1.6448536269514722 // deviations of a normal distribution
#define GUESSED 0.5    // part of its guess's deviation above which a hidden component is marked
#define EQUAL 1e-6     // part of dt by which times of measurements and truth may differ
#define MOST_LISTED 16 // trajectories whose errors have a line each

// The objects of an evaluation, all owned by this structure.
typedef struct prediction {
    pm_arena arena;
    const pm_evaluate_arguments *how;
    double seconds; // the first seconds, from which starts are estimated
    pm_system *system;
    pm_dataset *data, *starts, *truth;
    pm_observation observation;
    pm_uncertainty uncertainty; // of the weights
    pm_estimate estimate;
    int count, *which;
    double *error;       // [count][ny] relative errors after the time of the estimate
    pm_columns columns;  // of the truth
    double *truth_error; // [ngroup of columns][count] relative errors over all samples; or NULL
    pm_evaluation *laws;
} prediction;

// Returns the length of trajectory `id`, s, with a little more for rounding.
static double length_of(const prediction *j, int id) {
    const int which = j->which[id], last = pm_dataset_length(j->data, which) - 1;
    return pm_dataset_time(j->data, which, last) - pm_dataset_time(j->data, which, 0) +
           EQUAL * j->system->scene->physics.dt;
}

// Returns the length of the longest trajectory, s.
static double longest(const prediction *j) {
    double length = 0;
    for (int i = 0; i < j->count; ++i) {
        length = fmax(length, length_of(j, i));
    }
    return length;
}

// --- scores ---

// Compares the states of the estimate with those at the same times in the truth, over all samples.
// This is for tests of a method, where such states exist. PM_EDATA: the truth lacks a column, a
// trajectory or a time of the measurements.
static pm_status score_truth(prediction *j) {
    const pm_estimate *e = &j->estimate;
    PM_TRY(pm_dataset_load(&j->truth, j->how->truth));
    PM_TRY(pm_unit_change_apply(j->system->scene, j->truth, false));
    PM_TRY(pm_columns_bind(&j->columns, j->system->scene, j->truth, &j->arena));
    const pm_dataset *truth = j->truth;
    const int ngroup = j->columns.ngroup;
    j->truth_error =
        pm_arena_array(&j->arena, (size_t)ngroup * (size_t)j->count, sizeof *j->truth_error);
    pm_score_sums *sums = pm_arena_array(&j->arena, (size_t)ngroup, sizeof *sums);
    double *row = pm_arena_array(&j->arena, (size_t)truth->ncolumn, sizeof *row);
    PM_TRY(pm_arena_status(&j->arena, "errors against the truth"));
    for (int i = 0; i < j->count; ++i) {
        memset(sums, 0, (size_t)ngroup * sizeof *sums);
        for (int k = 0; k < j->data->ntime; ++k) {
            const double t = pm_dataset_time(j->data, j->which[i], k);
            const double at = (t - truth->t[0]) / truth->dt, nearest = floor(at + 0.5);
            if (isnan(t)) {
                break;
            }
            if (j->which[i] >= truth->ntrajectory || nearest < 0 || nearest >= truth->ntime ||
                fabs(at - nearest) > EQUAL) {
                return pm_fail(PM_EDATA, "%s: has no state of trajectory %d at %g s", j->how->truth,
                               j->which[i], t);
            }
            pm_columns_to_row(&j->columns, e->z + ((ptrdiff_t)i * e->ntime + k) * e->nz, row);
            for (int g = 0; g < ngroup; ++g) {
                pm_score_add(&j->columns, g, row,
                             pm_dataset_state(truth, j->which[i], (int)nearest), &sums[g]);
            }
        }
        for (int g = 0; g < ngroup; ++g) {
            j->truth_error[(ptrdiff_t)g * j->count + i] = pm_score_of(&sums[g]);
        }
    }
    return PM_OK;
}

// Rolls the estimated starts out in the steps of the scene, which checks both laws.
static pm_status check_laws(prediction *j) {
    const pm_scene *scene = j->system->scene;
    const pm_estimate *e = &j->estimate;
    const int ntime = 1 + (int)(longest(j) / scene->physics.dt);
    pm_columns columns;
    const char **column = pm_arena_array(&j->arena, (size_t)scene->physics.nz, sizeof *column);
    PM_TRY(pm_arena_status(&j->arena, "an evaluation"));
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        memcpy(column + scene->physics.subsystem[i].first, scene->physics.subsystem[i].column,
               (size_t)scene->physics.subsystem[i].layout.nz * sizeof *column);
    }
    PM_TRY(pm_dataset_new(&j->starts, j->count, ntime > 2 ? ntime : 2, scene->physics.nz,
                          scene->physics.dt, column));
    PM_TRY(pm_columns_bind(&columns, scene, j->starts, &j->arena));
    for (int i = 0; i < j->count; ++i) {
        for (int k = 0; k < j->starts->ntime; ++k) {
            double *row = pm_dataset_state(j->starts, i, k);
            pm_columns_to_row(&columns, e->start + (ptrdiff_t)i * e->nz, row);
            for (int c = 0; c < j->starts->ncolumn && k * scene->physics.dt > length_of(j, i);
                 ++c) {
                row[c] = NAN;
            }
        }
    }
    const pm_evaluate_how how = {.threads = 2, .inputs = j->data, .inputs_of = j->which};
    return pm_evaluate(&j->laws, j->system, j->starts, 0, j->count, &how);
}

// --- output ---

static double coverage(const prediction *j, int column) {
    return pm_estimate_coverage(&j->estimate, &j->observation, j->data, j->which, j->seconds,
                                column, NINETY_PER_CENT);
}

// Prints the errors of all columns, and those of all states if there is a truth, and the residuals
// of both laws.
static void print_tables(prediction *j) {
    const pm_estimate *e = &j->estimate;
    const int ny = j->estimate.ny;
    printf("Starts estimated in the first %g s of %d trajector%s; error after that, %% of the "
           "deviation of the whole trajectory\n",
           j->seconds, j->count, j->count == 1 ? "y" : "ies");
    printf("%-16s %10s %10s %10s %12s %18s\n", "column", "median", "mean", "largest", "residual",
           "inside 90 % bands");
    for (int c = 0; c < ny; ++c) {
        const pm_box box =
            pm_estimate_errors(&j->estimate, &j->observation, j->data, j->which, j->seconds, c);
        printf("%-16s %10.3g %10.3g %10.3g %12.3g", j->observation.name[c], 100 * box.median,
               100 * box.mean, 100 * box.largest, j->estimate.noise[c]);
        if (j->estimate.deviation != NULL) {
            printf(" %16.1f %%", 100 * coverage(j, c));
        }
        printf("\n");
    }
    for (int i = 0; i < j->count && j->count <= MOST_LISTED; ++i) {
        printf("  trajectory %-4d", j->which[i]);
        for (int c = 0; c < ny; ++c) {
            printf(" %s %.3g", j->observation.name[c], 100 * j->error[i * ny + c]);
        }
        printf("\n");
    }
    // Hidden components of which the measurements tell no more than the scene: the root mean square
    // of the predicted deviation after the estimate is almost that of the guess.
    for (int c = 0; c < e->nz && e->state_deviation != NULL; ++c) {
        double sum = 0;
        long n = 0;
        for (ptrdiff_t i = 0; i < (ptrdiff_t)e->count * e->ntime; ++i) {
            const double deviation = e->state_deviation[i * e->nz + c];
            if (isfinite(deviation)) {
                sum += deviation * deviation;
                ++n;
            }
        }
        const double deviation = n > 0 ? sqrt(sum / (double)n) : NAN;
        const double prior = j->observation.deviation[c];
        if (j->observation.hidden[c] && deviation > GUESSED * prior) {
            printf("  %s: predictions depend on the guess in the scene, as the measurements do not "
                   "fix "
                   "it (deviation %.2g, that of the guess %.2g)\n",
                   j->observation.component_name[c], deviation, prior);
        }
    }
    if (j->truth_error != NULL) {
        printf("Relative L2 error of all states against the truth, %%\n%-16s %10s %10s %10s\n",
               "group", "median", "mean", "largest");
    }
    for (int g = 0; g < j->columns.ngroup; ++g) {
        const pm_box box = pm_box_of(j->count, j->truth_error + (ptrdiff_t)g * j->count);
        printf("%-16s %10.3g %10.3g %10.3g\n", j->columns.group_name[g], 100 * box.median,
               100 * box.mean, 100 * box.largest);
    }
    double residual = 0, drift = 0, fall = 0;
    long violations = 0;
    for (int i = 0; j->laws != NULL && i < j->laws->count; ++i) {
        const pm_ledger *ledger = &j->laws->rollout[i].ledger;
        residual = fmax(residual, ledger->worst_energy);
        drift = fmax(drift, ledger->energy_drift);
        fall = fmax(fall, ledger->worst_entropy_fall);
        violations += ledger->violations;
    }
    if (pm_system_without_energy(j->system) >= 0) {
        printf("Laws: not defined, as the model is free of structure and has no energy\n");
    } else if (j->laws != NULL) {
        printf(
            "Laws: largest energy residual %.2e, steps in violation %ld; the total energy drifts "
            "by %.2e J at most, the total entropy falls by %.2e J/K at most\n",
            residual, violations, drift, fall);
    }
}

// Prints n numbers, each `stride` after the one before, as a JSON array.
static void print_numbers(int n, const double *value, int stride) {
    for (int i = 0; i < n; ++i) {
        const double x = value[(ptrdiff_t)i * stride];
        printf(isfinite(x) ? "%s%.17g" : "%snull", i > 0 ? ", " : "[", x);
    }
    printf("]");
}

static void print_json(const prediction *j) {
    const int ny = j->estimate.ny;
    printf("{\"estimate\": %.17g, \"trajectories\": [", j->seconds);
    for (int i = 0; i < j->count; ++i) {
        printf("%s%d", i > 0 ? ", " : "", j->which[i]);
    }
    printf("], \"columns\": {");
    for (int c = 0; c < ny; ++c) {
        printf("%s\"%s\": {\"residual\": %.17g, ", c > 0 ? ", " : "", j->observation.name[c],
               j->estimate.noise[c]);
        if (j->estimate.deviation != NULL) {
            printf("\"inside_90\": %.17g, ", coverage(j, c));
        }
        printf("\"error\": ");
        print_numbers(j->count, j->error + c, ny);
        printf("}");
    }
    printf("}");
    for (int g = 0; g < j->columns.ngroup; ++g) {
        printf("%s\"%s\": ", g == 0 ? ", \"truth\": {" : ", ", j->columns.group_name[g]);
        print_numbers(j->count, j->truth_error + (ptrdiff_t)g * j->count, 1);
        printf(g + 1 < j->columns.ngroup ? "" : "}");
    }
    printf("}\n");
}

static pm_status write_record(const prediction *j, const char *path) {
    const pm_estimate *e = &j->estimate;
    const pm_dataset *d = j->data;
    const int shape[3] = {j->count, d->ntime, d->ncolumn}, states[3] = {j->count, d->ntime, e->nz};
    const size_t rows = (size_t)j->count * (size_t)d->ntime;
    pm_arena arena = {0};
    double *y = pm_arena_array(&arena, rows * (size_t)d->ncolumn, sizeof *y);
    double *t = pm_arena_array(&arena, rows, sizeof *t);
    double *number = pm_arena_array(&arena, (size_t)j->count, sizeof *number);
    const char **unit = NULL;
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_units(d, &arena, &unit));
    unit = unit != NULL ? unit : pm_arena_array(&arena, (size_t)d->ncolumn, sizeof *unit);
    PM_TRY_DONE(pm_arena_status(&arena, "predictions"));
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    for (size_t i = 0; i < rows * (size_t)d->ncolumn; ++i) {
        y[i] = NAN;
    }
    for (size_t i = 0; i < rows; ++i) {
        for (int c = 0; c < e->ny; ++c) {
            const int column = j->observation.column[c];
            y[i * (size_t)d->ncolumn + (size_t)column] =
                pm_dataset_unchanged(d, column, e->y[i * (size_t)e->ny + (size_t)c]);
        }
        t[i] = pm_dataset_time(d, j->which[i / (size_t)d->ntime], (int)(i % (size_t)d->ntime));
        number[i / (size_t)d->ntime] = j->which[i / (size_t)d->ntime];
    }
    for (int c = 0; c < d->ncolumn; ++c) {
        const char *from = d->change == NULL ? NULL : d->change[c].from; // the unit of y
        unit[c] = from != NULL ? from : unit[c] != NULL ? unit[c] : "";
    }
    PM_TRY_DONE(pm_hdf5_write_texts(file, "/", "columns", d->ncolumn, d->column));
    PM_TRY_DONE(pm_hdf5_write_texts(file, "/", "units", d->ncolumn, unit));
    PM_TRY_DONE(pm_hdf5_write_texts(file, "/", "components", e->nz, j->observation.component_name));
    PM_TRY_DONE(pm_hdf5_write(file, "/y", 3, shape, y));
    PM_TRY_DONE(pm_hdf5_write(file, "/z", 3, states, e->z));
    if (e->deviation != NULL) {
        for (size_t i = 0; i < rows * (size_t)d->ncolumn; ++i) {
            y[i] = NAN;
        }
        for (size_t i = 0; i < rows * (size_t)e->ny; ++i) {
            const int column = j->observation.column[i % (size_t)e->ny];
            y[i / (size_t)e->ny * (size_t)d->ncolumn + (size_t)column] =
                pm_dataset_unchanged(d, column, e->deviation[i]) -
                pm_dataset_unchanged(d, column, 0);
        }
        PM_TRY_DONE(pm_hdf5_write(file, "/deviation", 3, shape, y));
        PM_TRY_DONE(pm_hdf5_write(file, "/state_deviation", 3, states, e->state_deviation));
    }
    PM_TRY_DONE(pm_hdf5_write(file, "/t", 2, shape, t));
    PM_TRY_DONE(pm_hdf5_write(file, "/trajectory", 1, shape, number));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    pm_arena_free(&arena);
    return status;
}

// --- the whole ---

static pm_status run(prediction *j, const volatile sig_atomic_t *stop) {
    const char *name = j->how->data_set == NULL ? "z" : j->how->data_set;
    PM_TRY(pm_dataset_load_measured(&j->data, j->how->data, name));
    PM_TRY(pm_unit_change_apply(j->system->scene, j->data, !j->how->json));
    PM_TRY(pm_observation_bind(&j->observation, j->system, j->data, &j->arena));
    const int n = j->data->ntrajectory;
    bool known = false, found = false;
    bool *seen = pm_arena_array(&j->arena, (size_t)n, sizeof *seen);
    j->which = pm_arena_array(&j->arena, (size_t)n, sizeof *j->which);
    PM_TRY(pm_arena_status(&j->arena, "an evaluation"));
    PM_TRY(pm_seen_choose(j->system, j->data, j->how->trajectories, j->how->json, seen, &known,
                          j->which, &j->count));
    if (j->seconds >= longest(j)) {
        return pm_fail(
            PM_EUSAGE,
            "--estimate: nothing is left to predict after %g s, as the longest trajectory "
            "has %g s",
            j->seconds, longest(j));
    }
    if (j->how->weights != NULL) {
        PM_TRY(pm_uncertainty_load(&j->uncertainty, j->how->weights, j->system, &j->observation,
                                   &found));
    }
    const pm_estimate_how how = {
        .seconds = j->seconds, .uncertainty = found ? &j->uncertainty : NULL, .stop = stop};
    PM_TRY(pm_estimate_make(&j->estimate, j->system, &j->observation, j->data, j->count, j->which,
                            &how));
    const int ny = j->estimate.ny;
    j->error = pm_arena_array(&j->arena, (size_t)j->count * (size_t)ny, sizeof *j->error);
    PM_TRY(pm_arena_status(&j->arena, "an evaluation"));
    for (int i = 0; i < j->count * ny; ++i) {
        j->error[i] = pm_estimate_error(&j->estimate, &j->observation, j->data, j->which,
                                        j->seconds, i / ny, i % ny);
    }
    PM_TRY(check_laws(j));
    PM_TRY(j->how->truth == NULL ? PM_OK : score_truth(j));
    if (j->how->json) {
        print_json(j);
    } else {
        print_tables(j);
    }
    PM_TRY(j->how->record == NULL ? PM_OK : write_record(j, j->how->record));
    if (j->how->states != NULL) { // the rollouts that checked the laws
        pm_dataset *d = j->laws->predicted;
        PM_TRY(pm_dataset_note(d, "title", "Rollouts of scene %s from estimated starts",
                               j->system->scene->name));
        PM_TRY(pm_dataset_note(d, "source", "portmet-train evaluate --estimate"));
        PM_TRY(pm_dataset_save(d, j->how->states));
    }
    if (j->how->plot != NULL) {
        PM_TRY(pm_python_folder(j->how->plot));
        const char *numbers = pm_arena_printf(&j->arena, "%s/predictions.h5", j->how->plot);
        const char *from = pm_arena_printf(&j->arena, "%.17g", j->seconds);
        const char *to = pm_arena_printf(&j->arena, "%.17g", fmin(longest(j), j->estimate.until));
        PM_TRY(pm_arena_status(&j->arena, "pictures"));
        PM_TRY(write_record(j, numbers));
        const char *const drawn[] = {"estimate", j->how->plot, j->how->data, name, from, to, NULL};
        PM_TRY(pm_python_run(&pm_python_pictures, drawn, false));
    }
    const pm_rollout *violating = j->laws == NULL ? NULL : pm_evaluation_violation(j->laws);
    return violating == NULL ? PM_OK : pm_fail(PM_ELAW, "%s", violating->violation);
}

pm_status pm_evaluate_from_estimate(pm_system *system, const pm_evaluate_arguments *how,
                                    double seconds, const volatile sig_atomic_t *stop) {
    prediction j = {.how = how, .system = system, .seconds = seconds};
    const pm_status status = run(&j, stop);
    pm_dataset_free(j.truth);
    pm_evaluation_free(j.laws);
    pm_estimate_free(&j.estimate);
    pm_uncertainty_free(&j.uncertainty);
    pm_dataset_free(j.starts);
    pm_dataset_free(j.data);
    pm_arena_free(&j.arena);
    return status;
}

// Scores predictions from estimated starts against measurements.
#include "command/evaluate_estimate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "command/evaluate_bands.h"
#include "command/evaluate_truth.h"
#include "evaluate/evaluate.h"
#include "evaluate/seen.h"
#include "learn/estimate.h"
#include "store/hdf5_io.h"

// A hidden component is marked if its deviation is more than this part of that of its guess.
#define GUESSED 0.5

// The objects of an evaluation, all owned by this structure.
typedef struct prediction {
    pm_arena arena;
    const pm_evaluate_estimate *how;
    pm_system *system;
    pm_dataset *data, *starts;
    pm_observation observation;
    pm_uncertainty uncertainty; // of the weights
    pm_estimate estimate;
    int count, *which;
    double *error; // [count][ny] relative errors after the time of the estimate
    pm_truth_errors truth;
    pm_evaluation *laws;
} prediction;

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "evaluate: out of memory");
}

// --- choice ---

static pm_status choose(prediction *j) {
    const int n = j->data->ntrajectory;
    bool *seen = pm_arena_array(&j->arena, (size_t)n, sizeof *seen);
    j->which = pm_arena_array(&j->arena, (size_t)n, sizeof *j->which);
    if (seen == NULL || j->which == NULL) {
        return no_memory();
    }
    const int nseen = pm_seen_mark(j->system, j->data, seen);
    PM_TRY(pm_options_list(j->how->trajectories, n, j->which, &j->count));
    if (j->how->trajectories == NULL && nseen > 0 && nseen < n) {
        j->count = 0;
        for (int i = 0; i < n; ++i) {
            if (!seen[i]) {
                j->which[j->count++] = i;
            }
        }
    }
    int known = 0;
    for (int i = 0; i < j->count; ++i) {
        known += seen[j->which[i]];
    }
    if (!j->how->json && nseen >= 0) {
        printf(known > 0 ? "%d of these %d trajectories are ones that the weights were trained or "
                           "validated on: no test of them\n"
                         : "unseen: the weights were trained on none of these trajectories\n",
               known, j->count);
    }
    return PM_OK;
}

// Returns the length of the longest trajectory, s.
static double longest(const prediction *j) {
    double length = 0;
    for (int i = 0; i < j->count; ++i) {
        int last = j->data->ntime - 1;
        while (last > 0 && isnan(pm_dataset_time(j->data, j->which[i], last))) {
            --last;
        }
        length = fmax(length, pm_dataset_time(j->data, j->which[i], last) -
                                  pm_dataset_time(j->data, j->which[i], 0));
    }
    return length;
}

// --- scores ---

static pm_status score(prediction *j) {
    const int ny = j->estimate.ny;
    j->error = pm_arena_array(&j->arena, (size_t)j->count * (size_t)ny, sizeof *j->error);
    if (j->error == NULL) {
        return no_memory();
    }
    for (int i = 0; i < j->count; ++i) {
        for (int c = 0; c < ny; ++c) {
            j->error[i * ny + c] = pm_estimate_error(&j->estimate, &j->observation, j->data,
                                                     j->which, j->how->seconds, i, c);
        }
    }
    return PM_OK;
}

// --- laws ---

// Rolls the estimated starts out in the steps of the scene, which checks both laws.
static pm_status check_laws(prediction *j) {
    const pm_scene *scene = j->system->scene;
    const pm_estimate *e = &j->estimate;
    const int ntime = 1 + (int)(longest(j) / scene->dt * (1 + 1e-9));
    pm_columns columns;
    const char **column = pm_arena_array(&j->arena, (size_t)scene->nz, sizeof *column);
    if (column == NULL || scene->nprescribed > 0 || pm_system_without_energy(j->system) >= 0) {
        return column == NULL ? no_memory() : PM_OK;
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        memcpy(column + scene->subsystem[i].first, scene->subsystem[i].column,
               (size_t)scene->subsystem[i].layout.nz * sizeof *column);
    }
    PM_TRY(
        pm_dataset_new(&j->starts, j->count, ntime > 2 ? ntime : 2, scene->nz, scene->dt, column));
    PM_TRY(pm_columns_bind(&columns, scene, j->starts, &j->arena));
    for (int i = 0; i < j->count; ++i) {
        for (int k = 0; k < j->starts->ntime; ++k) {
            pm_columns_to_row(&columns, e->start + (ptrdiff_t)i * e->nz,
                              pm_dataset_state(j->starts, i, k));
        }
    }
    const pm_evaluate_how how = {.threads = 2};
    return pm_evaluate(&j->laws, j->system, j->starts, 0, j->count, &how);
}

// --- output ---

static double coverage(const prediction *j, int column) {
    return pm_estimate_coverage(&j->estimate, &j->observation, j->data, j->which, j->how->seconds,
                                column, PM_NINETY_PER_CENT);
}

static void print_errors(const prediction *j) {
    const int ny = j->estimate.ny;
    printf("Starts estimated in the first %g s of %d trajectories; error after that, %% of the "
           "deviation from the mean\n",
           j->how->seconds, j->count);
    printf("%-16s %10s %10s %10s %12s %18s\n", "column", "median", "mean", "largest", "residual",
           "inside 90 % bands");
    for (int c = 0; c < ny; ++c) {
        const pm_box box = pm_estimate_errors(&j->estimate, &j->observation, j->data, j->which,
                                              j->how->seconds, c);
        printf("%-16s %10.3g %10.3g %10.3g %12.3g", j->observation.name[c], 100 * box.median,
               100 * box.mean, 100 * box.largest, j->estimate.noise[c]);
        if (j->estimate.deviation != NULL) {
            printf(" %16.1f %%", 100 * coverage(j, c));
        }
        printf("\n");
    }
    for (int i = 0; i < j->count && j->count <= 16; ++i) {
        printf("  trajectory %-4d", j->which[i]);
        for (int c = 0; c < ny; ++c) {
            printf(" %s %.3g", j->observation.name[c], 100 * j->error[i * ny + c]);
        }
        printf("\n");
    }
}

// The root mean square of the predicted deviation of a state component after the estimate, NAN if
// there is none.
static double state_deviation(const prediction *j, int component) {
    const pm_estimate *e = &j->estimate;
    double sum = 0;
    long n = 0;
    for (ptrdiff_t i = 0; i < (ptrdiff_t)e->count * e->ntime && e->state_deviation != NULL; ++i) {
        const double deviation = e->state_deviation[i * e->nz + component];
        if (isfinite(deviation)) {
            sum += deviation * deviation;
            ++n;
        }
    }
    return n > 0 ? sqrt(sum / (double)n) : NAN;
}

// Marks hidden components of which the measurements tell no more than the scene.
static void print_guesses(const prediction *j) {
    for (int c = 0; c < j->estimate.nz; ++c) {
        const double deviation = state_deviation(j, c), prior = j->observation.deviation[c];
        if (j->observation.hidden[c] && deviation > GUESSED * prior) {
            printf("  %s: predictions depend on the guess in the scene, as the measurements do not "
                   "fix "
                   "it (deviation %.2g, that of the guess %.2g)\n",
                   j->observation.component_name[c], deviation, prior);
        }
    }
}

static void print_laws(const prediction *j) {
    double residual = 0, drift = 0, fall = 0;
    long violations = 0;
    if (j->laws == NULL) {
        return;
    }
    for (int i = 0; i < j->laws->count; ++i) {
        const pm_ledger *ledger = &j->laws->rollout[i].ledger;
        residual = fmax(residual, ledger->worst_energy);
        drift = fmax(drift, ledger->energy_drift);
        fall = fmax(fall, ledger->worst_entropy_fall);
        violations += ledger->violations;
    }
    printf("Laws: largest energy residual %.2e, steps in violation %ld; the total energy drifts by "
           "%.2e J at most, the total entropy falls by %.2e J/K at most\n",
           residual, violations, drift, fall);
}

static void print_json(const prediction *j) {
    const int ny = j->estimate.ny;
    printf("{\"estimate\": %.17g, \"trajectories\": [", j->how->seconds);
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
        printf("\"error\": [");
        for (int i = 0; i < j->count; ++i) {
            const double error = j->error[i * ny + c];
            printf(isfinite(error) ? "%s%.17g" : "%snull", i > 0 ? ", " : "", error);
        }
        printf("]}");
    }
    printf("}");
    for (int g = 0; g < j->truth.ngroup; ++g) {
        printf("%s\"%s\": [", g == 0 ? ", \"truth\": {" : ", ", j->truth.group[g]);
        for (int i = 0; i < j->count; ++i) {
            const double error = j->truth.error[(ptrdiff_t)g * j->count + i];
            printf(isfinite(error) ? "%s%.17g" : "%snull", i > 0 ? ", " : "", error);
        }
        printf(g + 1 < j->truth.ngroup ? "]" : "]}");
    }
    printf("}\n");
}

static pm_status write_content(const prediction *j, pm_hdf5 *file) {
    const pm_estimate *e = &j->estimate;
    const pm_dataset *d = j->data;
    const int shape[3] = {j->count, d->ntime, d->ncolumn}, states[3] = {j->count, d->ntime, e->nz};
    const size_t rows = (size_t)j->count * (size_t)d->ntime;
    double *y = malloc(rows * (size_t)d->ncolumn * sizeof *y);
    double *t = malloc(rows * sizeof *t), *number = malloc((size_t)j->count * sizeof *number);
    pm_status status = PM_OK;
    if (y == NULL || t == NULL || number == NULL) {
        status = no_memory();
        goto done;
    }
    for (size_t i = 0; i < rows * (size_t)d->ncolumn; ++i) {
        y[i] = NAN;
    }
    for (size_t i = 0; i < rows; ++i) {
        for (int c = 0; c < e->ny; ++c) {
            y[i * (size_t)d->ncolumn + (size_t)j->observation.column[c]] =
                e->y[i * (size_t)e->ny + (size_t)c];
        }
        t[i] = pm_dataset_time(d, j->which[i / (size_t)d->ntime], (int)(i % (size_t)d->ntime));
        number[i / (size_t)d->ntime] = j->which[i / (size_t)d->ntime];
    }
    PM_TRY_DONE(pm_hdf5_write_texts(file, "/", "columns", d->ncolumn, d->column));
    PM_TRY_DONE(pm_hdf5_write_texts(file, "/", "components", e->nz, j->observation.component_name));
    PM_TRY_DONE(pm_hdf5_write(file, "/y", 3, shape, y));
    PM_TRY_DONE(pm_hdf5_write(file, "/z", 3, states, e->z));
    if (e->deviation != NULL) {
        for (size_t i = 0; i < rows * (size_t)d->ncolumn; ++i) {
            y[i] = NAN;
        }
        for (size_t i = 0; i < rows * (size_t)e->ny; ++i) {
            y[i / (size_t)e->ny * (size_t)d->ncolumn +
              (size_t)j->observation.column[i % (size_t)e->ny]] = e->deviation[i];
        }
        PM_TRY_DONE(pm_hdf5_write(file, "/deviation", 3, shape, y));
        PM_TRY_DONE(pm_hdf5_write(file, "/state_deviation", 3, states, e->state_deviation));
    }
    PM_TRY_DONE(pm_hdf5_write(file, "/t", 2, shape, t));
    status = pm_hdf5_write(file, "/trajectory", 1, shape, number);
done:
    free(y);
    free(t);
    free(number);
    return status;
}

static pm_status write_record(const prediction *j) {
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_create(&file, j->how->record, PM_HDF5_ATOMIC));
    PM_TRY_DONE(write_content(j, file));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    return status;
}

// Writes the rollouts that checked the laws.
static pm_status write_states(const prediction *j) {
    if (j->laws == NULL) {
        return pm_fail(PM_EUSAGE,
                       "--states: a scene with boundary inputs, or without energy, has no "
                       "rollouts from estimates");
    }
    pm_dataset *d = j->laws->predicted;
    PM_TRY(pm_dataset_note(d, "title", "Rollouts of scene %s from estimated starts",
                           j->system->scene->name));
    PM_TRY(pm_dataset_note(d, "source", "portmet-train evaluate --estimate"));
    return pm_dataset_save(d, j->how->states);
}

// --- the whole ---

static pm_status run(prediction *j, const volatile sig_atomic_t *stop) {
    const char *name = j->how->data_set == NULL ? "z" : j->how->data_set;
    PM_TRY(pm_dataset_load_measured(&j->data, j->how->data, name));
    PM_TRY(pm_observation_bind(&j->observation, j->system->scene, j->data, &j->arena));
    PM_TRY(choose(j));
    if (j->how->seconds >= longest(j)) {
        return pm_fail(
            PM_EUSAGE,
            "--estimate: nothing is left to predict after %g s, as the longest trajectory "
            "has %g s",
            j->how->seconds, longest(j));
    }
    bool found = false;
    if (j->how->weights != NULL) {
        PM_TRY(pm_uncertainty_load(&j->uncertainty, j->how->weights, j->system, &j->observation,
                                   &found));
    }
    const pm_estimate_how how = {
        .seconds = j->how->seconds, .uncertainty = found ? &j->uncertainty : NULL, .stop = stop};
    PM_TRY(pm_estimate_make(&j->estimate, j->system, &j->observation, j->data, j->count, j->which,
                            &how));
    PM_TRY(score(j));
    PM_TRY(check_laws(j));
    if (j->how->truth != NULL) {
        PM_TRY(pm_truth_errors_make(&j->truth, j->system->scene, &j->estimate, j->data, j->which,
                                    j->how->truth));
    }
    if (j->how->json) {
        print_json(j);
    } else {
        print_errors(j);
        print_guesses(j);
        PM_TRY(j->how->truth == NULL ? PM_OK : pm_truth_errors_print(&j->truth));
        print_laws(j);
    }
    PM_TRY(j->how->record == NULL ? PM_OK : write_record(j));
    PM_TRY(j->how->states == NULL ? PM_OK : write_states(j));
    if (j->how->plot != NULL) {
        PM_TRY(pm_evaluate_bands_draw(&j->estimate, &j->observation, j->data, j->which,
                                      j->how->seconds, j->how->plot));
    }
    const pm_rollout *violating = j->laws == NULL ? NULL : pm_evaluation_violation(j->laws);
    return violating == NULL ? PM_OK : pm_fail(PM_ELAW, "%s", violating->violation);
}

pm_status pm_evaluate_from_estimate(pm_system *system, const pm_evaluate_estimate *how,
                                    const volatile sig_atomic_t *stop) {
    prediction j = {.how = how, .system = system};
    const pm_status status = run(&j, stop);
    pm_truth_errors_free(&j.truth);
    pm_evaluation_free(j.laws);
    pm_estimate_free(&j.estimate);
    pm_uncertainty_free(&j.uncertainty);
    pm_dataset_free(j.starts);
    pm_dataset_free(j.data);
    pm_arena_free(&j.arena);
    return status;
}

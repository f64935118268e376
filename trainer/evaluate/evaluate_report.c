// Prints the tables and the JSON object of an evaluation.
#include "evaluate/evaluate_report.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/journal.h"

#define MOST_LISTED 64 // subsystems that are named one by one
#define MOST_TEXT 1024 // bytes of a name in JSON
#define MOST_ROWS 8    // ports or subsystems whose quantities of one kind have a line each

// The extremes of the laws over all rollouts.
typedef struct summary {
    const pm_rollout *energy, *entropy; // with the largest residual; NULL: all residuals are 0
    long violations, steps;
    double energy_drift, entropy_change, entropy_fall; // largest, mean, largest
    double seconds_per_step;                           // mean over the rollouts
} summary;

static summary summarise(const pm_evaluation *e) {
    summary s = {.energy = NULL};
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        const pm_ledger *ledger = &r->ledger;
        if (ledger->worst_energy > (s.energy == NULL ? 0 : s.energy->ledger.worst_energy)) {
            s.energy = r;
        }
        if (ledger->worst_entropy < (s.entropy == NULL ? 0 : s.entropy->ledger.worst_entropy)) {
            s.entropy = r;
        }
        s.violations += ledger->violations;
        s.steps += ledger->steps;
        s.energy_drift = fmax(s.energy_drift, r->ledger.energy_drift);
        s.entropy_change += (ledger->entropy - ledger->first_entropy) / e->count;
        s.entropy_fall = fmax(s.entropy_fall, ledger->worst_entropy_fall);
        s.seconds_per_step += r->seconds_per_step / e->count;
    }
    return s;
}

// --- tables ---

static void print_box(const char *group, const char *kind, const pm_box *b) {
    printf("  %-8s %-11s %9.3g %9.3g %9.3g %9.3g %9.3g %9.3g", group, kind, 100 * b->low,
           100 * b->first_quartile, 100 * b->median, 100 * b->third_quartile, 100 * b->high,
           100 * b->mean);
}

// Prints which subsystems left the states that their weights were trained on, or, if these are
// many, only the one that did so most often. Prints nothing if none did, or if the weights do not
// hold their range.
static void print_out_of_range(const pm_evaluation *e) {
    const pm_scene *scene = e->system->scene;
    int nsubsystem = 0, worst = 0;
    long most = 0, steps = 0;
    for (int j = 0; j < e->count; ++j) {
        steps += e->rollout[j].ledger.steps;
    }
    for (int pass = 0; pass < 2; ++pass) { // counts, then prints
        for (int i = 0; i < scene->physics.nsubsystem; ++i) {
            long count = 0;
            int trajectories = 0;
            for (int j = 0; j < e->count; ++j) {
                count += e->rollout[j].nout_of_range[i];
                trajectories += e->rollout[j].nout_of_range[i] > 0;
            }
            if (pass == 0) {
                nsubsystem += count > 0;
                worst = count > most ? i : worst;
                most = count > most ? count : most;
            } else if (count > 0 && (nsubsystem <= MOST_LISTED || i == worst)) {
                printf("  %s on %ld of %ld steps, in %d of %d trajector%s%s\n",
                       scene->physics.subsystem[i].name, count, steps, trajectories, e->count,
                       e->count == 1 ? "y" : "ies",
                       nsubsystem > MOST_LISTED ? ", more often than any other" : "");
            }
        }
        if (pass == 0 && nsubsystem > 0) {
            printf("\n%d of %d subsystem%s left the states their weights were trained on:\n",
                   nsubsystem, scene->physics.nsubsystem,
                   scene->physics.nsubsystem == 1 ? "" : "s");
        }
    }
}

// Prints the line of one quantity; `name` stands in place of that of the row.
static void print_row(const pm_thermo_row *r, const char *name) {
    const bool production = strcmp(r->kind, "production") == 0;
    const char *unit = strcmp(r->kind, "power") == 0    ? "W"
                       : strcmp(r->kind, "energy") == 0 ? "J"
                                                        : "J/K";
    printf("  %-11s %-16s %9.3g %9.3g %9.3g ", r->kind, name, 100 * r->median, 100 * r->mean,
           100 * r->largest);
    if (production) {
        printf("%+9.3g", 100 * r->bias);
    } else {
        printf("%9s", "");
    }
    printf(" %9.3g %s\n", r->typical, unit);
}

// Prints the rows of each kind, or, if they are many, the summary over all and the one with the
// largest median.
static void print_thermo(const pm_evaluation *e, const pm_thermo *thermo) {
    if (thermo->count == 0) {
        return;
    }
    printf(
        "\nRelative error, %%                    median      mean   largest      bias   typical\n");
    for (int first = 0, next; first < thermo->count; first = next) {
        const pm_thermo_row *row = &thermo->row[first];
        for (next = first; next < thermo->count && thermo->row[next].kind == row->kind;) {
            ++next;
        }
        const int count = next - first;
        pm_thermo_row sum, worst;
        char name[300];
        for (int i = 0; i < count && count <= MOST_ROWS; ++i) {
            print_row(&row[i], strcmp(row->kind, "production") == 0 ? "of entropy" : row[i].name);
        }
        if (count > MOST_ROWS && pm_thermo_summarise(row, count, &sum, &worst) == PM_OK) {
            snprintf(name, sizeof name, "of %d %s", count,
                     strcmp(sum.kind, "power") == 0 ? "ports" : "subsystems");
            print_row(&sum, name);
            snprintf(name, sizeof name, "worst: %s", worst.name);
            print_row(&worst, name);
        }
    }
    printf("  Reference: the model in the true states%s.\n",
           thermo->given ? "; their entropies are given"
                         : ", entropies included, which are learned");
    if (thermo->warmest != 0) {
        printf("  Temperatures at true states: %.6g to %.6g K%s\n", thermo->coldest,
               thermo->warmest, thermo->coldest > 0 ? "" : ": NOT POSITIVE");
    }
    if (e->system->scene->physics.nboundary_input > 0) {
        printf("  The production does not include what boundary inputs exchange.\n");
    }
}

static void print_errors(const pm_evaluation *e, const char *title) {
    const int first = e->rollout[0].trajectory, last = e->rollout[e->count - 1].trajectory;
    if (last - first == e->count - 1) {
        printf("%s %d to %d, ", title, first, last);
    } else {
        printf("%s: %d between %d and %d, ", title, e->count, first, last);
    }
    printf("%d states %g s apart\n", e->truth->ntime, e->truth->dt);
    printf(pm_columns_combine(&e->columns, e->system->scene)
               ? "Groups of one name in several subsystems are one row.\n\n"
               : "\n");
    printf("Relative L2 error, %%   %9s %9s %9s %9s %9s %9s %11s %12s\n", "whisker", "quartile",
           "median", "quartile", "whisker", "mean", "persistence", "of deviation");
    for (int g = 0; g < e->columns.ngroup; ++g) {
        print_box(e->columns.group_name[g], "trajectory", &e->trajectory[g]);
        printf(" %11.3g %12.3g\n", 100 * e->persistence[g], 100 * e->of_deviation[g]);
    }
    for (int g = 0; g < e->columns.ngroup; ++g) {
        print_box(e->columns.group_name[g], "snapshot", &e->snapshot[g]);
        printf("\n");
    }
    for (int g = 0; g < e->columns.ngroup; ++g) {
        pm_score_sums sums = {0};
        for (long k = 0; k < (long)e->count * e->truth->ntime; ++k) {
            const pm_rollout *r = &e->rollout[k / e->truth->ntime];
            const int j = (int)(k % e->truth->ntime);
            const double *row = pm_dataset_state(e->truth, r->trajectory, j);
            if (j < r->length) {
                pm_score_add(&e->columns, g, row, row, &sums);
            }
        }
        if (sums.norm == 0) {
            printf("  %s is zero in truth: its errors are absolute, times 100\n",
                   e->columns.group_name[g]);
        }
    }
    const int failures = pm_evaluation_failures(e);
    if (failures > 0) {
        printf("\n%d of %d rollout%s became non-finite; their errors count as infinite:", failures,
               e->count, e->count == 1 ? "" : "s");
        for (int i = 0; i < e->count; ++i) {
            if (e->rollout[i].reached < e->rollout[i].length) {
                printf(" %d (after %d state%s)", e->rollout[i].trajectory, e->rollout[i].reached,
                       e->rollout[i].reached == 1 ? "" : "s");
            }
        }
        printf("\n");
    }
}

void pm_evaluation_print(const pm_evaluation *e, const pm_evaluation *trained,
                         const pm_thermo *thermo) {
    const summary s = summarise(e);
    printf("%s: ", e->system->scene->name);
    print_errors(e, "trajectories");
    if (trained != NULL) {
        print_errors(trained, "\nTrajectories that training saw:");
    }
    print_thermo(e, thermo);
    const pm_scene *scene = e->system->scene;
    const int without = pm_system_without_energy(e->system);
    printf("\nBoth laws\n");
    if (without >= 0) {
        printf("  not defined: %s is free of structure and has no energy\n",
               scene->physics.subsystem[without].name);
    } else {
        printf("  %-28s %10.2e", "worst energy residual",
               s.energy == NULL ? 0 : s.energy->ledger.worst_energy);
        if (s.energy != NULL) {
            printf("  %s, trajectory %d, step %ld",
                   pm_ledger_name(&s.energy->ledger, s.energy->ledger.worst_energy_place),
                   s.energy->trajectory, s.energy->ledger.worst_energy_step);
        }
        printf("\n  %-28s %10.2e", "worst entropy residual",
               s.entropy == NULL ? 0 : s.entropy->ledger.worst_entropy);
        if (s.entropy != NULL) {
            printf("  %s, trajectory %d, step %ld",
                   pm_ledger_name(&s.entropy->ledger, s.entropy->ledger.worst_entropy_place),
                   s.entropy->trajectory, s.entropy->ledger.worst_entropy_step);
        }
        printf("\n");
        printf("  %-28s %10ld of %ld\n", "steps in violation", s.violations, s.steps);
        printf("  %-28s %10.2e J, largest\n", "total energy drifts by", s.energy_drift);
        printf("  %-28s %+10.2e J/K, mean; largest fall over a step %.2e J/K\n",
               "total entropy changes by", s.entropy_change, s.entropy_fall);
    }
    print_out_of_range(e);
    printf("\nTime per step: %.1f us (%s, ", 1e6 * s.seconds_per_step,
           scene->physics.integrator->name);
    if (pm_physics_is_adaptive(&scene->physics)) {
        printf("tolerance %g)\n", scene->physics.tolerance);
    } else {
        printf("%d substeps)\n", scene->physics.substeps);
    }
}

// --- JSON ---

static void json_text(const char *text) {
    char quoted[MOST_TEXT];
    pm_json_quote(quoted, sizeof quoted, text);
    fputs(quoted, stdout);
}

// Prints "name": value and the text `after`.
static void json_number(const char *name, double value, const char *after) {
    json_text(name);
    if (isfinite(value)) {
        printf(": %.17g%s", value, after);
    } else {
        printf(": null%s", after);
    }
}

static void json_box(const char *name, const pm_box *b, const char *after) {
    json_text(name);
    printf(": {");
    json_number("low", b->low, ", ");
    json_number("first_quartile", b->first_quartile, ", ");
    json_number("median", b->median, ", ");
    json_number("third_quartile", b->third_quartile, ", ");
    json_number("high", b->high, ", ");
    json_number("mean", b->mean, ", ");
    json_number("max", b->largest, "}");
    printf("%s", after);
}

static void json_groups(const pm_evaluation *e, const char *name) {
    printf("  \"%s\": {\n", name);
    for (int g = 0; g < e->columns.ngroup; ++g) {
        printf("    ");
        json_text(e->columns.group_name[g]);
        printf(": {");
        json_box("trajectory", &e->trajectory[g], ", ");
        json_number("persistence", e->persistence[g], ", ");
        json_number("of_deviation", e->of_deviation[g], ", ");
        json_box("snapshot", &e->snapshot[g], g + 1 < e->columns.ngroup ? "},\n" : "}\n");
    }
    printf("  },\n");
}

void pm_evaluation_print_json(const pm_evaluation *e, const pm_evaluation *trained,
                              const pm_thermo *thermo, const bool *seen) {
    const summary s = summarise(e);
    printf("{\n  \"scene\": ");
    json_text(e->system->scene->name);
    printf(",\n  \"trajectories\": %d, \"states\": %d, ", e->count, e->truth->ntime);
    json_number("dt", e->truth->dt, ", ");
    printf("\"nonfinite\": %d, ", pm_evaluation_failures(e));
    json_number("seconds_per_step", s.seconds_per_step, ",\n");
    json_groups(e, "groups");
    if (trained != NULL) {
        json_groups(trained, "trained_groups");
    }
    if (pm_system_without_energy(e->system) >= 0) {
        printf("  \"laws\": null,\n");
    } else {
        printf("  \"laws\": {");
        json_number("worst_energy_residual", s.energy == NULL ? 0 : s.energy->ledger.worst_energy,
                    ", ");
        json_number("worst_entropy_residual",
                    s.entropy == NULL ? 0 : s.entropy->ledger.worst_entropy, ", ");
        printf("\"violations\": %ld, \"steps\": %ld, ", s.violations, s.steps);
        json_number("energy_drift", s.energy_drift, ", ");
        json_number("entropy_change", s.entropy_change, ", ");
        json_number("entropy_fall", s.entropy_fall, "},\n");
    }
    printf("  \"thermodynamics\": {\"entropy_given\": %s, ", thermo->given ? "true" : "false");
    json_number("coldest", thermo->coldest, ", ");
    json_number("warmest", thermo->warmest, ", \"quantities\": [");
    for (int i = 0; i < thermo->count; ++i) {
        const pm_thermo_row *r = &thermo->row[i];
        printf("%s\n    {\"kind\": \"%s\", \"name\": ", i > 0 ? "," : "", r->kind);
        json_text(r->name);
        printf(", ");
        json_number("median", r->median, ", ");
        json_number("mean", r->mean, ", ");
        json_number("max", r->largest, ", ");
        json_number("bias", r->bias, ", ");
        json_number("typical", r->typical, "}");
    }
    printf("]},\n  \"rollouts\": [\n");
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        printf("    {\"trajectory\": %d, \"seen\": %s, \"states\": %d, \"error\": {", r->trajectory,
               seen == NULL          ? "null"
               : seen[r->trajectory] ? "true"
                                     : "false",
               r->reached);
        for (int g = 0; g < e->columns.ngroup; ++g) {
            json_number(e->columns.group_name[g], r->error[g],
                        g + 1 < e->columns.ngroup ? ", " : "}, ");
        }
        long most = 0;
        for (int k = 0; k < e->system->scene->physics.nsubsystem; ++k) {
            most = r->nout_of_range[k] > most ? r->nout_of_range[k] : most;
        }
        printf("\"outside\": %ld, ", most);
        json_number("energy_drift", r->ledger.energy_drift, i + 1 < e->count ? "},\n" : "}\n");
    }
    printf("  ]\n}\n");
}

// Prints the end of a fit: errors of steps and rollouts for each group, entropy production, both
// laws, and a verdict relative to persistence.
#include <math.h>
#include <string.h>

#include "learn/fit_measured.h"

// A group that is worse than persistence is unfit only above this relative error. Below, the group
// hardly changes.
#define NEGLIGIBLE 0.01
// Errors relative to persistence below which a verdict is good or fair. A model is not good if one
// group alone is not fair.
#define GOOD 0.05
#define FAIR 0.3

typedef struct report {
    const pm_fit *fit;
    pm_measure training, validation;
    const pm_measure *judged;    // the validation part, or where there is none the training part
    const pm_measure *black_box; // or NULL
} report;

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

static void print_cells(const report *r) {
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

static void print_production(const char *where, const pm_measure *m) {
    const pm_thermo *t = &m->thermo;
    for (int i = 0; i < t->count; ++i) {
        if (strcmp(t->row[i].kind, "production") == 0) {
            const pm_thermo_row *row = &t->row[i];
            printf(
                "Entropy produced over a run, %s: %.3g J/K, off by %.3g %% (mean %.3g, worst %.3g; "
                "bias %+.3g)\n",
                where, row->typical, 100 * row->median, 100 * row->mean, 100 * row->largest,
                100 * row->bias);
        }
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

// --- the verdict ---

// Returns the first group that is worse than persistence, or NULL.
static const pm_measure_cell *find_worse(const pm_measure *m) {
    for (int c = 0; c < m->ncell; ++c) {
        const pm_measure_cell *cell = &m->cell[c];
        if (cell->rollout.median >= cell->persistence.median && cell->rollout.median > NEGLIGIBLE) {
            return cell;
        }
    }
    return NULL;
}

// Returns the group whose rollouts have the largest error relative to persistence, with that ratio,
// or NULL if no group has more than a negligible error.
static const pm_measure_cell *find_worst(const pm_measure *m, double *ratio) {
    const pm_measure_cell *worst = NULL;
    *ratio = 0;
    for (int c = 0; c < m->ncell; ++c) {
        const pm_measure_cell *cell = &m->cell[c];
        const double own = cell->rollout.median / cell->persistence.median;
        if (cell->rollout.median > NEGLIGIBLE && own > *ratio) {
            worst = cell;
            *ratio = own;
        }
    }
    return worst;
}

const char *pm_fit_grade(double score, double worst) {
    return score < GOOD && worst < FAIR ? "good" : score < FAIR ? "fair" : "poor";
}

static void print_verdict(const report *r, const char *where) {
    const pm_measure *m = r->judged;
    double ratio;
    const pm_measure_cell *worst = find_worst(m, &ratio);
    printf("Verdict: %s. On the %s part rollouts have %.3g %% of the error of a state that stays "
           "as it is (geometric mean over groups",
           pm_fit_grade(m->score, ratio), where, 100 * m->score);
    if (worst != NULL && ratio >= GOOD) {
        printf("; %s of %s is the worst with %.3g %%", worst->group, worst->part, 100 * ratio);
    }
    printf(")");
    if (r->black_box != NULL) {
        const double times = r->black_box->score / m->score;
        printf(times >= 1 ? "; %.3g times better than the black box"
                          : "; %.3g times WORSE than the black box",
               times >= 1 ? times : 1 / times);
    }
    printf(".\n");
}

static pm_status judge(const report *r) {
    const pm_measure *m = r->judged;
    const char *where = m == &r->validation ? "validation" : "training";
    const pm_measure_cell *worse = find_worse(m);
    if (m->failures > 0) {
        printf("Verdict: UNFIT. %d of %d rollouts on the %s part are not finite.\n", m->failures,
               m->evaluation->count, where);
        return pm_fail(PM_EUNFIT, "%d of %d rollouts on the %s part are not finite", m->failures,
                       m->evaluation->count, where);
    }
    if (worse != NULL || m->score >= 1) {
        const char *part = worse == NULL ? "all parts" : worse->part;
        const char *group = worse == NULL ? "all groups" : worse->group;
        printf(
            "Verdict: UNFIT. The model is worse than a state that stays as it is, in %s of %s.\n",
            group, part);
        return pm_fail(PM_EUNFIT,
                       "on the %s part the model is worse than a state that stays as it is, in %s "
                       "of %s",
                       where, group, part);
    }
    print_verdict(r, where);
    return PM_OK;
}

static void print_all(const report *r) {
    const pm_fit *f = r->fit;
    print_cells(r);
    if (r->judged == &r->validation) {
        printf("Rollouts of %d training and %d validation trajectories, %d states each.\n",
               r->training.evaluation->count, r->validation.evaluation->count, f->dataset->ntime);
    }
    print_production("training", &r->training);
    if (r->validation.evaluation != NULL) {
        print_production("validation", &r->validation);
    }
    print_laws(r->judged);
}

pm_status pm_fit_report(pm_fit *fit, const pm_measure *black_box) {
    if (fit->measured != NULL) {
        return pm_fit_measured_report(fit);
    }
    report r = {.fit = fit, .black_box = black_box};
    pm_status status;
    PM_TRY_DONE(pm_fit_measure(fit, false, &r.training));
    r.judged = &r.training;
    if (fit->split.nvalidation > 0) {
        PM_TRY_DONE(pm_fit_measure(fit, true, &r.validation));
        r.judged = &r.validation;
    }
    print_all(&r);
    status = judge(&r);
done:
    pm_measure_free(&r.training);
    pm_measure_free(&r.validation);
    return status;
}

// Which reactions the changes of amounts show.
#include "propose/logger_reactions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

#define PIECES 8       // of a trajectory: changes over them show reactions
#define FAINT 1e-4     // of its deviation: an amount changes clearly if it does by more
#define ACTIVE 4.0     // eigenvalue of changes that are no noise, whose eigenvalue is 1
#define ALLOWED 0.05   // of its length: a reaction changes no more of what is conserved
#define MOST_NUMBERS 4 // sum of the stoichiometric numbers of a reaction
#define LARGEST_NUMBER 2
#define HELD_CAPACITY \
    20 // of a vessel where no power is known, in units of PM_LOGGER_GAS for each mol

// Lists the amounts of a part in `column`.
static int list(const pm_logger_view *v, int part, int *column) {
    int n = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        if (v->column[c].part == part && v->column[c].kind == PM_LOGGER_AMOUNT) {
            column[n++] = c;
        }
    }
    return n;
}

// Writes the conserved combinations of n sums of amounts, divided by the sizes of their noise, to
// `kept` [n][n], and returns how many there are; -1: out of memory, or no changes.
static int find_conserved(const pm_logger_samples *w, int n, int sums[][PM_LOGGER_PARTS], int parts,
                          double *size, double *kept) {
    const pm_dataset *d = w->view->dataset;
    const int step = d->ntime > PIECES ? d->ntime / PIECES : 1;
    double matrix[PM_LOGGER_COLUMNS * PM_LOGGER_COLUMNS] = {0}, value[PM_LOGGER_COLUMNS];
    double vector[PM_LOGGER_COLUMNS * PM_LOGGER_COLUMNS];
    int count = 0, found = 0;
    for (int i = 0; i < n; ++i) {
        size[i] = 0;
        for (int k = 0; k < parts; ++k) {
            const pm_logger_column *c = &w->view->column[sums[i][k]];
            size[i] += 2 * c->noise * c->noise + FAINT * FAINT * c->deviation * c->deviation;
        }
        size[i] = sqrt(size[i]);
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k + step < d->ntime; k += step) {
            double change[PM_LOGGER_COLUMNS];
            bool whole = true;
            for (int s = 0; s < n; ++s) {
                change[s] = 0;
                for (int p = 0; p < parts; ++p) {
                    change[s] += pm_logger_row(w, i, k + step)[sums[s][p]] -
                                 pm_logger_row(w, i, k)[sums[s][p]];
                }
                change[s] /= size[s];
                whole = whole && isfinite(change[s]);
            }
            for (int s = 0; s < n * n && whole; ++s) {
                matrix[s] += change[s / n] * change[s % n];
            }
            count += whole;
        }
    }
    for (int s = 0; s < n * n; ++s) {
        matrix[s] /= count > 0 ? count : 1;
    }
    if (count == 0 || !pm_eigen_largest(n, matrix, n, value, vector)) {
        return -1;
    }
    for (int k = 0; k < n; ++k) {
        if (value[k] < ACTIVE) {
            memcpy(kept + found++ * n, vector + k * n, (size_t)n * sizeof *kept);
        }
    }
    return found;
}

// Adds `number` [n] to the basis of all reactions so far, which is orthogonal. Returns whether it
// is independent of them.
static bool extend(int n, const int *number, int *nbasis, double *basis) {
    double *own = basis + *nbasis * n, before = 0, after = 0;
    for (int i = 0; i < n; ++i) {
        own[i] = number[i];
        before += own[i] * own[i];
    }
    for (int k = 0; k < *nbasis; ++k) {
        double product = 0, square = 0;
        for (int i = 0; i < n; ++i) {
            product += basis[k * n + i] * own[i];
            square += basis[k * n + i] * basis[k * n + i];
        }
        for (int i = 0; i < n; ++i) {
            own[i] -= product / square * basis[k * n + i];
        }
    }
    for (int i = 0; i < n; ++i) {
        after += own[i] * own[i];
    }
    const bool independent = after > FAINT * before;
    *nbasis += independent;
    return independent;
}

// Makes `number` the next list of small integers, the first of which that is not 0 is positive.
// Returns false after the last one.
static bool next_numbers(int n, int *number) {
    for (;;) {
        int i = 0;
        while (i < n && number[i] == LARGEST_NUMBER) {
            number[i++] = -LARGEST_NUMBER;
        }
        if (i == n) {
            return false;
        }
        ++number[i];
        int first = 0;
        while (first < n && number[first] == 0) {
            ++first;
        }
        if (first < n && number[first] > 0) {
            return true;
        }
    }
}

static void find_in_part(pm_logger_samples *w, int part) {
    pm_logger_view *v = w->view;
    int column[PM_LOGGER_COLUMNS], sums[PM_LOGGER_COLUMNS][PM_LOGGER_PARTS], parts;
    double size[PM_LOGGER_COLUMNS], kept[PM_LOGGER_COLUMNS * PM_LOGGER_COLUMNS];
    double basis[(PM_LOGGER_AMOUNTS + 1) * PM_LOGGER_AMOUNTS];
    const int n = list(v, part, column);
    if (n < 2 || n > PM_LOGGER_AMOUNTS) {
        return;
    }
    // Diffusion does not change the sums over parts that exchange one substance.
    bool taken[PM_LOGGER_PARTS] = {false};
    taken[part] = true;
    parts = 1;
    for (int i = 0; i < n; ++i) {
        sums[i][0] = column[i];
    }
    for (bool more = true; more;) {
        more = false;
        for (int other = 0; other < v->npart && !more; ++other) {
            bool meets = false;
            for (int k = 0; k < v->npart; ++k) {
                meets = meets || (taken[k] && pm_logger_meets(v, k, other));
            }
            int own[PM_LOGGER_COLUMNS];
            if (!taken[other] && meets && list(v, other, own) == n) {
                for (int i = 0; i < n; ++i) {
                    sums[i][parts] = own[i];
                }
                ++parts;
                taken[other] = more = true;
            }
        }
    }
    const int nkept = find_conserved(w, n, sums, parts, size, kept);
    int nbasis = 0;
    // The simplest reactions that explain all changes, and all that are as simple.
    for (int sum = 2; sum <= MOST_NUMBERS && nkept >= 0 && nbasis < n - nkept; ++sum) {
        int number[PM_LOGGER_AMOUNTS];
        for (int i = 0; i < n; ++i) {
            number[i] = -LARGEST_NUMBER;
        }
        while (next_numbers(n, number)) {
            int own = 0, gains = 0, losses = 0; // something must be lost for what is gained
            bool even = true;
            for (int i = 0; i < n; ++i) {
                own += abs(number[i]);
                gains += number[i] > 0;
                losses += number[i] < 0;
                even = even && number[i] % 2 == 0;
            }
            bool allowed = own == sum && !even && gains > 0 && losses > 0;
            for (int k = 0; k < nkept; ++k) { // it changes nothing that is conserved
                double length = 0, changes = 0;
                for (int i = 0; i < n; ++i) {
                    length = hypot(length, number[i] / size[i]);
                    changes += kept[k * n + i] * number[i] / size[i];
                }
                allowed = allowed && fabs(changes) < ALLOWED * length;
            }
            if (!allowed || v->nreaction == PM_LOGGER_REACTIONS) {
                continue;
            }
            if (nbasis < n - nkept) {
                (void)extend(n, number, &nbasis, basis);
            }
            pm_logger_reaction *r = &v->reaction[v->nreaction++];
            *r = (pm_logger_reaction){.part = part};
            for (int i = 0; i < n; ++i) {
                r->number[column[i]] = number[i];
            }
        }
    }
}

pm_status pm_logger_find_reactions(pm_logger_samples *w) {
    pm_logger_view *v = w->view;
    for (int part = 0; part < v->npart; ++part) {
        find_in_part(w, part);
        int own[PM_LOGGER_COLUMNS], other[PM_LOGGER_COLUMNS];
        const int n = list(v, part, own);
        for (int k = part + 1; k < v->npart && n > 0; ++k) {
            for (int i = 0; i < n && pm_logger_meets(v, part, k) && list(v, k, other) == n; ++i) {
                v->diffuses[own[i]][other[i]] = v->diffuses[other[i]][own[i]] = true;
            }
        }
        // Without a known power the gas constant gives the scale of capacities.
        double amount = 0;
        for (int i = 0; i < n; ++i) {
            amount += v->column[own[i]].mean;
        }
        const int t = v->thermometer[part];
        if (n > 0 && t >= 0 && pm_logger_heat_is_free(v) && amount > 0) {
            pm_logger_scale_heat(v, HELD_CAPACITY * PM_LOGGER_GAS * amount / v->column[t].inertia);
        }
    }
    return pm_arena_status(&v->arena, "reactions");
}

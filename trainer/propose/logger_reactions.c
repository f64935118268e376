// Amounts of substances: which reactions the data show, and the text of their laws.
#include "propose/logger_reactions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

#define GAS 8.314462618 // J/(mol K)
#define PIECES 8        // of a trajectory: changes over them show reactions
#define FAINT 1e-4      // of its deviation: an amount changes clearly if it does by more
#define ACTIVE 4.0      // eigenvalue of changes that are no noise, whose eigenvalue is 1
#define ALLOWED 0.05    // of its length: a reaction changes no more of what is conserved
#define MOST_NUMBERS 4  // sum of the stoichiometric numbers of a reaction
#define LARGEST_NUMBER 2
#define HELD_CAPACITY 20 // of a vessel where no power is known, in units of GAS for each mol
#define SMALL 0.1
#define ROOM 293.15       // K
#define ACTIVATION 1000.0 // K
#define CURVES 10.0       // power of the temperature in a rate
#define EQUAL 1e-6        // square of half an affinity over R T, below which a rate is linear in it

int pm_logger_amounts(const pm_logger_view *view, int part) {
    return pm_logger_count(view, part, PM_LOGGER_AMOUNT);
}

int pm_logger_reactions(const pm_logger_view *view, int part) {
    int count = 0;
    for (int k = 0; k < view->nreaction; ++k) {
        count += view->reaction[k].part == part;
    }
    return count;
}

// Lists the amounts of a part in `column`.
static int list(const pm_logger_view *v, int part, int *column) {
    int n = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        if (pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            column[n++] = c;
        }
    }
    return n;
}

// Lists in sums[i] amount i of a part and of all parts that may exchange it with this one, *count
// of them: diffusion does not change their sum.
static void list_sums(const pm_logger_view *v, int part, int n, const int *column,
                      int sums[][PM_LOGGER_PARTS], int *count) {
    *count = 1;
    for (int i = 0; i < n; ++i) {
        sums[i][0] = column[i];
    }
    bool taken[PM_LOGGER_PARTS] = {false};
    taken[part] = true;
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
                    sums[i][*count] = own[i];
                }
                ++*count;
                taken[other] = more = true;
            }
        }
    }
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

// Returns true if the reaction changes nothing that is conserved.
static bool is_allowed(int n, const int *number, const double *size, int nkept,
                       const double *kept) {
    double length = 0;
    for (int i = 0; i < n; ++i) {
        length += number[i] * number[i] / (size[i] * size[i]);
    }
    bool allowed = true;
    for (int k = 0; k < nkept; ++k) {
        double changes = 0;
        for (int i = 0; i < n; ++i) {
            changes += kept[k * n + i] * number[i] / size[i];
        }
        allowed = allowed && fabs(changes) < ALLOWED * sqrt(length);
    }
    return allowed;
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
    list_sums(v, part, n, column, sums, &parts);
    const int nkept = find_conserved(w, n, sums, parts, size, kept);
    int nbasis = 0;
    // The simplest reactions that explain all changes, and all that are as simple.
    for (int sum = 2; sum <= MOST_NUMBERS && nkept >= 0 && nbasis < n - nkept; ++sum) {
        int number[PM_LOGGER_AMOUNTS];
        for (int i = 0; i < n; ++i) {
            number[i] = -LARGEST_NUMBER;
        }
        while (next_numbers(n, number)) {
            int own = 0, gains = 0;
            bool even = true;
            for (int i = 0; i < n; ++i) {
                own += abs(number[i]);
                gains += number[i] > 0;
                even = even && number[i] % 2 == 0;
            }
            // Something must be lost for what is gained.
            int losses = 0;
            for (int i = 0; i < n; ++i) {
                losses += number[i] < 0;
            }
            if (own != sum || even || gains == 0 || losses == 0 ||
                !is_allowed(n, number, size, nkept, kept) || v->nreaction == PM_LOGGER_REACTIONS) {
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
        if (n > 0 && t >= 0 && v->column[t].free_scale && amount > 0) {
            pm_logger_scale_heat(v, HELD_CAPACITY * GAS * amount / v->column[t].inertia);
        }
    }
    return pm_arena_status(&v->arena, "reactions");
}

// --- laws ---

// Writes "(A + B + C)" of the amounts of a part.
static void write_total(const pm_logger_view *v, int part, const char *of, char *text,
                        size_t size) {
    size_t n = 0;
    for (int c = 0; c < v->nvariable && n < size; ++c) {
        if (pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            n += (size_t)snprintf(text + n, size - n, "%s%s%.40s", n == 0 ? "(" : " + ", of,
                                  v->column[c].name);
        }
    }
    if (n + 1 < size) {
        snprintf(text + n, size - n, ")");
    }
}

// Returns the text of the gas constant, which is learned where concentrations stand for amounts,
// since nobody knows the volume.
static const char *gas_constant(pm_logger_writer *w, int part, char *text, size_t size) {
    const pm_unit mol = pm_unit_parse("mol");
    bool amounts = true;
    for (int c = 0; c < w->v->nvariable; ++c) {
        amounts = amounts && (!pm_logger_is(w->v, c, part, PM_LOGGER_AMOUNT) ||
                              pm_unit_equal(&w->v->column[c].dimension, &mol));
    }
    if (amounts) {
        snprintf(text, size, "%.10g", GAS);
    } else {
        pm_logger_constant(w, "mixing", w->v->part[part], GAS);
        snprintf(text, size, "mixing_%.80s", w->v->part[part]);
    }
    return text;
}

void pm_logger_write_mixture(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    const int t = v->thermometer[part];
    if (t < 0) {
        return;
    }
    const pm_logger_column *T = &v->column[t];
    char total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    double amount = 0;
    write_total(v, part, "", total, sizeof total);
    for (int c = 0; c < v->nvariable; ++c) {
        amount += pm_logger_is(v, c, part, PM_LOGGER_AMOUNT) ? v->column[c].mean : 0;
    }
    for (int c = 0; c < v->nvariable; ++c) {
        const char *n = v->column[c].name;
        if (!pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            continue;
        }
        (void)gas_constant(w, part, gas, sizeof gas);
        fprintf(w->model, "      - \"%s*(%s*%s - %s*%s*ln(%s/%s))\"\n", T->name,
                pm_logger_number(w, "entropy", n, 0, GAS), n, gas, n, n, total);
        pm_logger_constant(w, "molar", n, SMALL * T->inertia / amount);
        fprintf(w->model, "      - \"molar_%s*%s*(%s*ln(%s/%.6g) - %s + %.6g)\"\n", n, n, T->name,
                T->name, T->mean, T->name, T->mean);
    }
}

void pm_logger_write_formation(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    const int t = v->thermometer[part];
    const double T0 = t < 0 ? v->bath : v->column[t].mean;
    char total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    write_total(v, part, "", total, sizeof total);
    for (int c = 0; c < v->nvariable; ++c) {
        const char *n = v->column[c].name;
        if (!pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            continue;
        }
        fprintf(w->model, "      - \"%s*%s", pm_logger_number(w, "formation", n, 0, GAS * T0), n);
        if (t < 0) {
            fprintf(w->model, " + %s*%.6g*%s*ln(%s/%s)", gas_constant(w, part, gas, sizeof gas), T0,
                    n, n, total);
        }
        fputs("\"\n", w->model);
    }
}

void pm_logger_write_reaction(pm_logger_writer *w, int k, const char *of, const char *to) {
    const pm_logger_view *v = w->v;
    const pm_logger_reaction *r = &v->reaction[k];
    const int t = v->thermometer[r->part];
    const double T0 = t < 0 ? v->bath : v->column[t].mean;
    char name[PM_LOGGER_TEXT], T[PM_LOGGER_TEXT], total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    char affinity[PM_LOGGER_LONG_TEXT] = "", product[2 * PM_LOGGER_LONG_TEXT] = "1";
    double amount = 0;
    bool some = false;
    snprintf(name, sizeof name, "%.40s_%d", v->part[r->part], k + 1);
    if (t < 0) {
        snprintf(T, sizeof T, "%sdE.s", to);
    } else {
        snprintf(T, sizeof T, "%s%.60s", to, v->column[t].name);
    }
    write_total(v, r->part, of, total, sizeof total);
    fputs("[{", w->model);
    for (int c = 0; c < v->nvariable; ++c) {
        amount += pm_logger_is(v, c, r->part, PM_LOGGER_AMOUNT) ? v->column[c].mean : 0;
        if (r->number[c] == 0) {
            continue;
        }
        const char *n = v->column[c].name;
        size_t end = strlen(affinity);
        fprintf(w->model, "%s\"%s%s\": %d", pm_logger_separate(&some), of, n, r->number[c]);
        snprintf(affinity + end, sizeof affinity - end, "%s%d*%sdE.%.40s", end > 0 ? " + " : "",
                 r->number[c], of, n);
        end = strlen(product);
        snprintf(product + end, sizeof product - end, "*(%s%.40s/%s)^%d", of, n, total,
                 abs(r->number[c]));
    }
    (void)gas_constant(w, r->part, gas, sizeof gas);
    pm_logger_constant(w, "rate", name, amount * v->fastest);
    if (t < 0) {
        fprintf(w->model, "}, %ss, \"rate_%s", to, name);
    } else {
        fprintf(w->model, "}, %s, \"rate_%s*exp(%s*(1/%.6g - 1/%s)", T, name,
                pm_logger_number(w, "activation", name, 0, ACTIVATION), T0, T);
        fprintf(w->model, " + %s*(ln(%s/%.6g) + %.6g/%s - 1))",
                pm_logger_number(w, "power", name, 0, CURVES), T, T0, T0, T);
    }
    // Forward less backward is the root of both products times twice the hyperbolic sine of half
    // the affinity over R T; a pair multiplies by the affinity over T itself.
    char half[2 * PM_LOGGER_LONG_TEXT];
    snprintf(half, sizeof half, "sqrt(((%s)/(2*%s*%s))^2 + %.4g)", affinity, gas, T, EQUAL);
    fprintf(w->model, "*sqrt(%s)*(exp(%s) - exp(-%s))/(2*%s*%s)\"]", product, half, half, half,
            gas);
}

void pm_logger_write_diffusion(pm_logger_writer *w, const pm_logger_column *a,
                               const pm_logger_column *b) {
    char both[PM_LOGGER_TEXT], total[2][PM_LOGGER_LONG_TEXT];
    snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
    write_total(w->v, a->part, "a.", total[0], sizeof total[0]);
    write_total(w->v, b->part, "b.", total[1], sizeof total[1]);
    const double start = (a->mean + b->mean) * w->v->fastest / (GAS * ROOM);
    pm_logger_constant(w, "through", both, SMALL * start);
    pm_logger_constant(w, "diffusion", both, SMALL * start);
    fprintf(w->model, "through_%s + diffusion_%s*(a.%s/%s + b.%s/%s)", both, both, a->name,
            total[0], b->name, total[1]);
}

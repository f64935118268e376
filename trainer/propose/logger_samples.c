// Differences of samples, and the windows of the regressions.
#include "propose/logger_samples.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/linalg.h"

// The ratio of the standard deviation of a normal distribution to its median absolute value.
#define NORMAL_MEDIAN 1.4826022185056018
#define HIGHEST 6 // order of the differences that show noise, if there are enough of them
#define LOWEST 4
#define FEWEST_DIFFERENCES 50
#define WHITE 0.6          // noise by differences over noise by those of two orders less, at least
#define CLEAN 1e-4         // of the deviation: less noise than that does not count
#define ROUGH 0.01         // of the deviation: an input with larger fourth differences is held
#define NEAR 4             // samples about a row without one, of which a cubic polynomial fills it
#define EVEN 2e-3          // of a step: times that are off by less are even
#define FEWEST_JUMPS 8     // of an input, from which it shows what it drives
#define STAIRCASE 0.3      // of all steps: a column that stays as it is so often is held
#define JUMP 0.2           // of the deviation: a staircase without hints jumps so far
#define REGRESSED 400      // windows of a trajectory, at most
#define MOVES 1e-3         // of the changes: an input that explains less does not move a column
#define LATEST 20          // rows by which an input acts later, at most, in a trajectory of
#define SHORT 8            // times as many rows, at least
#define CLEARLY 10.0       // logarithm of how many times likelier a delay must be than none
#define CHANGE 10.0        // of the noise: windows are so long that changes are larger
#define LONGEST_CHANGE 0.3 // of the deviation: windows are no longer than such changes take

static double median_of(double *x, int n) {
    pm_sort((size_t)n, x);
    return n > 0 ? x[n / 2] : NAN;
}

// Returns the standard deviation of white noise that the n-th differences show. Differences over a
// jump of a held input are left out, because the motion has kinks there. If too few remain, the
// result is NaN or, with `kinks`, comes from all differences.
static double differences(const pm_logger_samples *w, int c, int n, bool kinks) {
    const pm_dataset *d = w->view->dataset;
    const int spacing = w->view->column[c].spacing;
    int count = 0;
    double square = 1; // of the coefficients: that of white noise grows by it
    for (int j = 1; j <= n; ++j) {
        square *= (double)(n + j) / j;
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k + n * spacing < d->ntime; ++k) {
            double sum = 0, coefficient = 1;
            bool kink = false;
            for (int j = 0; j <= n; ++j) {
                sum += coefficient * pm_logger_row(w, i, k + j * spacing)[c];
                coefficient *= -(double)(n - j) / (j + 1);
            }
            for (int j = 1; j < n * spacing && isfinite(sum) && !kinks; ++j) {
                for (int u = 0; u < w->view->ncolumn; ++u) {
                    const pm_logger_column *input = &w->view->column[u];
                    kink = kink ||
                           (u != c && input->kind == PM_LOGGER_INPUT && input->held &&
                            pm_logger_row(w, i, k + j)[u] != pm_logger_row(w, i, k + j - 1)[u]);
                }
            }
            if (isfinite(sum) && !kink) {
                w->sort[count++] = fabs(sum);
            }
        }
    }
    return kinks || count >= FEWEST_DIFFERENCES
               ? median_of(w->sort, count) * NORMAL_MEDIAN / sqrt(square)
               : NAN;
}

// Fills the rows between the second and the third of some samples, where -1 stands for none, unless
// more of them are missing there than usual.
static void fill_between(pm_logger_samples *w, int trajectory, int c, const int sample[NEAR]) {
    const pm_logger_column *column = &w->view->column[c];
    const int first = sample[NEAR / 2 - 1], last = sample[NEAR / 2];
    if (first < 0 || last < 0 || last - first > 2 * column->spacing) {
        return;
    }
    for (int k = first + 1; k < last; ++k) {
        double value = 0;
        for (int a = 0; a < NEAR; ++a) {
            double term = sample[a] < 0 ? 0 : pm_logger_row(w, trajectory, sample[a])[c];
            for (int b = 0; b < NEAR && sample[a] >= 0; ++b) {
                if (b != a && sample[b] >= 0) {
                    const double t = pm_logger_time(w, trajectory, sample[b]);
                    term *= (pm_logger_time(w, trajectory, k) - t) /
                            (pm_logger_time(w, trajectory, sample[a]) - t);
                }
            }
            value += term;
        }
        pm_logger_row(w, trajectory, k)[c] =
            column->held ? pm_logger_row(w, trajectory, first)[c] : value;
    }
}

// Finds range, mean and deviation of a column, how often it stays as it is, and how far it jumps.
bool pm_logger_measure(const pm_logger_samples *w, int c) {
    const pm_dataset *d = w->view->dataset;
    pm_logger_column *column = &w->view->column[c];
    double sum = 0, square = 0;
    int count = 0, steps = 0, equal = 0;
    column->least = INFINITY;
    column->largest = -INFINITY;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0, before = -1; k < d->ntime; ++k) {
            if (isfinite(pm_logger_row(w, i, k)[c])) {
                w->sort[count] = k - before;
                count += before >= 0;
                before = k;
            }
        }
    }
    column->spacing = count > 0 ? (int)median_of(w->sort, count) : 1;
    count = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k < d->ntime; ++k) {
            const double y = pm_logger_row(w, i, k)[c];
            if (!isfinite(y)) {
                continue;
            }
            column->least = fmin(column->least, y);
            column->largest = fmax(column->largest, y);
            sum += y;
            square += y * y;
            ++count;
            const int before = k - column->spacing;
            const double step = before >= 0 ? fabs(y - pm_logger_row(w, i, before)[c]) : NAN;
            equal += step == 0;
            if (step > 0) {
                w->sort[steps++] = step;
            }
        }
    }
    column->mean = sum / (count > 0 ? count : 1);
    column->deviation =
        sqrt(fmax(square / (count > 0 ? count : 1) - column->mean * column->mean, 0));
    const bool stays = equal > STAIRCASE * (steps + equal);
    const double jump = steps > 0 ? median_of(w->sort, steps) : 0;
    const double rough = differences(w, c, HIGHEST - 2, true);
    column->held = column->kind == PM_LOGGER_INPUT && (stays || rough > ROUGH * column->deviation);
    return (steps == 0 && equal > 0) || (stays && jump > JUMP * column->deviation);
}

int pm_logger_window(const pm_logger_samples *w, int target) {
    const pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    int longest = 1;
    for (int c = 0; c < view->nvariable; ++c) {
        const pm_logger_column *column = &view->column[c];
        // A hidden variable is a mixture of all measured ones.
        const bool counts = c == target || view->column[target].source == NULL;
        double change = 0;
        int m = 1;
        for (; counts && column->noise > 0 && column->source != NULL && m < d->ntime / 4; m *= 2) {
            double square = 0;
            int count = 0;
            for (int i = 0; i < d->ntrajectory; ++i) {
                for (int k = 0; k + m < d->ntime; k += m) {
                    const double step = pm_logger_row(w, i, k + m)[c] - pm_logger_row(w, i, k)[c];
                    square += isfinite(step) ? step * step : 0;
                    count += isfinite(step);
                }
            }
            change = sqrt(square / (count > 0 ? count : 1));
            if (change > CHANGE * column->noise || change > LONGEST_CHANGE * column->deviation) {
                break;
            }
        }
        longest = m > longest ? m : longest;
    }
    return longest;
}

// Fills the windows: the duration, the integrals of all columns, whose means are subtracted and
// which are divided by their deviations, and the changes of all columns.
static void divide(pm_logger_samples *w, int length) {
    w->length = length;
    const pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    w->nfeature = 1 + view->ncolumn;
    w->width = w->nfeature + PM_LOGGER_COLUMNS + 1;
    w->nwindow = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int jump = 1 + d->ntime / (length * REGRESSED);
        for (int k = 0; k + length < d->ntime; k += jump * length) {
            double *x = w->window + (ptrdiff_t)w->nwindow * w->width;
            bool whole = true;
            memset(x, 0, sizeof(double) * (size_t)w->width);
            x[w->width - 1] = k == 0;
            x[0] = pm_logger_time(w, i, k + length) - pm_logger_time(w, i, k);
            for (int c = 0; c < view->ncolumn; ++c) {
                const pm_logger_column *column = &view->column[c];
                const double scale = column->deviation > 0 ? column->deviation : 1;
                for (int j = k; j < k + length; ++j) {
                    const double first = pm_logger_row(w, i, j)[c],
                                 last = pm_logger_row(w, i, j + 1)[c];
                    const double *before = pm_logger_near(w, i, j, -1);
                    const double *after = pm_logger_near(w, i, j, 2);
                    const double y[] = {before == NULL ? NAN : before[c], first, last,
                                        after == NULL ? NAN : after[c]};
                    const double mean =
                        column->held ? first : (first + last) / 2 + pm_logger_bend(y);
                    x[1 + c] += (pm_logger_time(w, i, j + 1) - pm_logger_time(w, i, j)) *
                                (mean - column->mean) / scale;
                }
                double *change = x + w->nfeature + c;
                *change = pm_logger_row(w, i, k + length)[c] - pm_logger_row(w, i, k)[c];
                whole = whole && isfinite(x[1 + c]) && isfinite(*change);
            }
            w->nwindow += whole && x[0] > 0;
        }
    }
}

// Regresses the changes of a column on the integrals of the columns in `used`, and on the duration;
// with `turns` the difference of each change from the one before it. Writes coefficient [nfeature]
// of what is used. Returns the unexplained part of the squares.
static double regress(pm_logger_samples *w, int target, const bool *used, bool turns,
                      double *coefficient) {
    pm_least_squares *s = w->squares;
    double x[1 + PM_LOGGER_COLUMNS], solution[1 + PM_LOGGER_COLUMNS];
    const int length = pm_logger_window(w, target);
    if (w->length != length) {
        divide(w, length);
    }
    memset(s, 0, sizeof *s);
    for (int c = 0; c < w->nfeature; ++c) {
        s->n += c == 0 || used[c - 1];
    }
    for (int k = 0; k < w->nwindow; ++k) {
        const double *row = w->window + (ptrdiff_t)k * w->width;
        const double *before = turns && k > 0 && row[w->width - 1] == 0 ? row - w->width : NULL;
        const int at = w->nfeature + target;
        for (int c = 0, n = 0; c < w->nfeature; ++c) {
            if (c == 0 || used[c - 1]) {
                x[n++] = row[c] - (before != NULL ? before[c] : 0);
            }
        }
        if (!turns || before != NULL) {
            pm_least_squares_add(s, x, row[at] - (before != NULL ? before[at] : 0));
        }
    }
    const double rest = pm_least_squares_solve(s, solution);
    for (int c = 0, n = 0; c < w->nfeature && coefficient != NULL; ++c) {
        coefficient[c] = c == 0 || used[c - 1] ? solution[n++] : 0;
    }
    return rest;
}

double pm_logger_regress(pm_logger_samples *w, int target, const bool *used, double *coefficient) {
    return regress(w, target, used, false, coefficient);
}

// Returns how much of the changes in slope of variable c, at the jumps of the held input u, these
// jumps explain; 0 if there are too few jumps. A variable that the input drives changes its slope
// at once. One that is moved by this variable in turn does not.
static double answer(const pm_logger_samples *w, int c, int u) {
    const pm_dataset *d = w->view->dataset;
    double product = 0, jumps = 0, changes = 0;
    int count = 0;
    for (int i = 0; i < d->ntrajectory && w->view->column[u].held; ++i) {
        for (int k = 1; k + 1 < d->ntime; ++k) {
            const double *before = pm_logger_row(w, i, k - 1), *now = pm_logger_row(w, i, k),
                         *after = pm_logger_row(w, i, k + 1);
            const double jump = now[u] - before[u], t = pm_logger_time(w, i, k);
            const double change = (after[c] - now[c]) / (pm_logger_time(w, i, k + 1) - t) -
                                  (now[c] - before[c]) / (t - pm_logger_time(w, i, k - 1));
            if (isfinite(jump) && isfinite(change) && jump != 0) {
                product += jump * change;
                jumps += jump * jump;
                changes += change * change;
                ++count;
            }
        }
    }
    return count >= FEWEST_JUMPS && changes > 0 ? product * product / (jumps * changes) : 0;
}

// Returns minus the logarithm of the likelihood of what input u moves, from differences of windows:
// what is no linear function of the columns changes little from one to the next.
static double misfit_of(pm_logger_samples *w, int u) {
    const pm_logger_view *view = w->view;
    bool used[PM_LOGGER_COLUMNS];
    double sum = 0;
    memset(used, true, sizeof used);
    w->length = 0;
    for (int c = 0; c < view->nvariable; ++c) {
        if (view->share[c][u] > MOVES && view->column[c].source != NULL) {
            sum += log(fmax(regress(w, c, used, true, NULL), DBL_MIN)) * w->nwindow / 2;
        }
    }
    return sum;
}

// Finds which inputs explain clearly more of what they move when they act some rows later than
// their samples say, or one row earlier.
static void find_delays(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    const int n = view->dataset->ntime, most = n / SHORT < LATEST ? n / SHORT : LATEST;
    double *value = w->sort;
    for (int u = view->nvariable; u < view->ncolumn; ++u) {
        double best = misfit_of(w, u) - CLEARLY;
        for (int k = 0; k < w->nrow; ++k) {
            value[k] = w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS + u];
        }
        for (int delay = -1; delay <= most; ++delay) {
            for (int k = 0; k < w->nrow; ++k) {
                w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS + u] =
                    value[pm_logger_earlier(k, delay, n)];
            }
            const double misfit = misfit_of(w, u);
            if (misfit < best) {
                best = misfit;
                view->column[u].shows_delay = delay;
            }
        }
        for (int k = 0; k < w->nrow; ++k) {
            w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS + u] = value[k];
        }
    }
    w->length = 0;
}

// Regresses all variables on all columns.
void pm_logger_regress_all(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    bool used[PM_LOGGER_COLUMNS];
    double coefficient[1 + PM_LOGGER_COLUMNS];
    w->length = 0;
    for (int i = 0; i < view->nvariable; ++i) {
        for (int j = 0; j < view->ncolumn; ++j) {
            used[j] = true;
        }
        const double rest = pm_logger_regress(w, i, used, coefficient);
        view->column[i].constant = coefficient[0];
        view->column[i].unexplained = rest;
        for (int j = 0; j < view->ncolumn; ++j) {
            const pm_logger_column *other = &view->column[j];
            view->coupling[i][j] =
                coefficient[1 + j] / (other->deviation > 0 ? other->deviation : 1);
            view->column[i].constant -= view->coupling[i][j] * other->mean;
            used[j] = false;
            view->share[i][j] = pm_logger_regress(w, i, used, NULL) - rest;
            used[j] = true;
        }
        view->column[i].decay = -view->coupling[i][i];
        for (int u = view->nvariable; u < view->ncolumn; ++u) {
            view->answer[i][u] = answer(w, i, u);
        }
    }
    // Nothing but the current moves the charge of a cell, or what relaxes in it.
    for (int i = 0; i < view->nvariable; ++i) {
        const pm_logger_column *column = &view->column[i];
        for (int j = 0; j < view->ncolumn && (column->seen != NULL || column->relaxes > 0); ++j) {
            view->coupling[i][j] = view->coupling[j][i] = 0;
            view->share[i][j] = view->share[j][i] = 0;
        }
        if (column->relaxes > 0) {
            view->coupling[i][i] = -1 / column->relaxes;
            view->column[i].decay = 1 / column->relaxes;
        }
    }
    for (int i = 0; i < view->nvariable; ++i) {
        double rate = fabs(view->coupling[i][i]);
        for (int j = 0; j < view->nvariable; ++j) {
            rate += j == i ? 0 : sqrt(fabs(view->coupling[i][j] * view->coupling[j][i]));
        }
        view->fastest = fmax(view->fastest, rate);
    }
    if (w->seeks_delays) {
        find_delays(w);
    }
}

// Fills the rows between the samples of columns that are sampled more rarely than the others.
static void fill(pm_logger_samples *w) {
    const pm_dataset *d = w->view->dataset;
    for (int c = 0; c < w->view->ncolumn; ++c) {
        const pm_logger_column *column = &w->view->column[c];
        for (int i = 0; i < d->ntrajectory && column->spacing > 1; ++i) {
            int sample[NEAR] = {-1, -1, -1, -1}; // the last rows that have one
            // Beyond the end as many rows follow as samples wait for the one after them.
            for (int k = 0, ends = 0; ends < NEAR / 2; ++k) {
                const bool there = k < d->ntime && isfinite(pm_logger_row(w, i, k)[c]);
                if (k < d->ntime && !there) {
                    continue;
                }
                ends += k >= d->ntime;
                memmove(sample, sample + 1, (NEAR - 1) * sizeof *sample);
                sample[NEAR - 1] = there ? k : -1;
                fill_between(w, i, c, sample);
            }
        }
    }
}

// Finds out whether times are even and whether all samples are there, and the noise of variables.
// Then it fills what is between rare samples.
void pm_logger_find_noise(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    view->even = view->complete = true;
    view->noisy = false;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k < d->ntime; ++k) {
            const double off = pm_logger_time(w, i, k) - pm_logger_time(w, i, 0) - k * d->dt;
            view->even = view->even && !(fabs(off) > EVEN * d->dt);
            for (int c = 0; c < view->ncolumn; ++c) {
                view->complete = view->complete && isfinite(pm_logger_row(w, i, k)[c]);
            }
        }
    }
    for (int c = 0; c < view->nvariable; ++c) {
        pm_logger_column *column = &view->column[c];
        int n = HIGHEST;
        while (n > LOWEST && isnan(differences(w, c, n, false))) {
            --n;
        }
        const bool kinks = isnan(differences(w, c, n, false));
        n = kinks ? HIGHEST : n;
        const double high = differences(w, c, n, kinks), low = differences(w, c, n - 2, kinks);
        column->noise = high > WHITE * low && high > CLEAN * column->deviation ? high : 0;
        column->roughness = column->noise / fmax(column->deviation, DBL_MIN);
        view->noisy = view->noisy || column->noise > 0;
    }
    fill(w);
}

// Multiple shooting: its gradient agrees with finite differences, and eliminating the starts of all
// windows gives a step that solves the normal equations of all unknowns, which is bent by the
// second derivative of the residuals. A weight is spare if the quadratic model says so.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "inference/uncertainty.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define NZ 10
#define SAMPLES 41 // more windows than one batch, in two tracks
#define TRACKS 2
#define LENGTH 3 // of a window
#define SHORT 1  // so many windows that they are integrated side by side
#define LONG 22  // so few that each is linearised along its path, in more than one batch
#define DIRECTIONS 10
#define RESIDUALS (2 * TRACKS * SAMPLES * NZ) // no fewer than there are
#define DAMPING 1e-3
#define STIFF 1e3 // a damping whose step is taken, and bent
#define STEP 1e-5
// The error of central differences: STEP^2 times a third derivative, and rounding of 1e-16 / STEP.
#define TOLERANCE 2e-6

typedef struct bench {
    random_system w;
    pm_observation observation;
    int column[NZ], component[NZ], base[NZ];
    bool hidden[NZ];
    double guess[NZ], deviation[NZ];
    const pm_formula *rule[NZ];
    pm_track track[TRACKS];
    double time[SAMPLES], y[TRACKS][SAMPLES * NZ], duration[2 * SAMPLES];
    int first_step[SAMPLES + 1];
    double spread[NZ];
    pm_tracks tracks;
    pm_shooting shooting;
    size_t size; // weights and starts
    double *point, *moved, *gradient;
} bench;

// Measures all components but the last two; the sixth is measured from the first.
static void observe(bench *b) {
    for (int c = 0; c < NZ; ++c) {
        b->base[c] = c == 5 ? 0 : -1;
        b->hidden[c] = c >= NZ - 2;
        b->column[c] = b->component[c] = c;
        b->deviation[c] = 0.5;
    }
    b->observation = (pm_observation){.count = NZ - 2,
                                      .column = b->column,
                                      .component = b->component,
                                      .rule = b->rule,
                                      .base = b->base,
                                      .hidden = b->hidden,
                                      .guess = b->guess,
                                      .deviation = b->deviation};
}

// Random samples at uneven times, some of them missing, with an outlier now and then.
static void measure(bench *b) {
    const int ny = NZ - 2;
    for (int k = 0; k < SAMPLES; ++k) {
        const double length = 0.5 + 0.5 * pm_rng_uniform(&b->w.rng);
        const int steps = 1 + k % 2, first = b->first_step[k];
        b->first_step[k + 1] = first + steps;
        b->duration[first] = b->duration[first + steps - 1] = length;
        b->time[k] = k == 0 ? 0
                            : b->time[k - 1] + (first - b->first_step[k - 1]) *
                                                   b->duration[first - 1] * b->w.scene->physics.dt;
        for (int i = 0; i < TRACKS * ny; ++i) {
            const double outlier = (k + i) % 11 == 0 ? 3 : 0;
            b->y[i / ny][k * ny + i % ny] =
                (k * i) % 7 == 3 ? NAN : 0.3 * pm_rng_normal(&b->w.rng) + outlier;
        }
    }
    for (int i = 0; i < TRACKS; ++i) {
        b->track[i] = (pm_track){.count = SAMPLES - 4 * i,
                                 .time = b->time,
                                 .y = b->y[i],
                                 .first_step = b->first_step,
                                 .duration = b->duration};
    }
    b->tracks = (pm_tracks){
        .count = TRACKS, .ny = ny, .track = b->track, .stretched = true, .deviation = b->spread};
}

static void bench_open(bench *b, uint64_t seed, const char *integrator, int length) {
    memset(b, 0, sizeof *b);
    random_system_of_text(&b->w, seed, random_system_scene, random_system_part, random_system_port);
    b->w.scene->physics.dt = 0.01;
    observe(b);
    measure(b);
    const pm_sensitivity_how how = {.system = b->w.system,
                                    .observation = &b->observation,
                                    .integrator = pm_integrator_find(integrator),
                                    .substeps = 2,
                                    .stretched = true};
    pm_shooting *s = &b->shooting;
    assert_int_equal(pm_shooting_open(s, &how, &b->tracks), PM_OK);
    for (int c = 0; c < NZ; ++c) {
        s->terms.gap[c] = 0.2 + 0.05 * c;
        s->terms.prior[c] = b->hidden[c] ? 0.7 : 0;
        if (c < s->ny) {
            s->terms.noise[c] = 0.3 + 0.1 * c;
        }
    }
    assert_int_equal(pm_shooting_divide(s, length), PM_OK);
    b->size = (size_t)s->nweight + (size_t)s->nwindow * NZ;
    b->point = calloc(3 * b->size, sizeof *b->point);
    assert_non_null(b->point);
    b->moved = b->point + b->size;
    b->gradient = b->moved + b->size;
    pm_shooting_weights(s, b->point);
    for (size_t i = (size_t)s->nweight; i < b->size; ++i) {
        b->point[i] = 0.3 * pm_rng_normal(&b->w.rng);
    }
}

static void bench_close(bench *b) {
    free(b->point);
    pm_shooting_close(&b->shooting);
    random_system_close(&b->w);
}

static double value_at(bench *b, const double *point) {
    pm_shooting_set_weights(&b->shooting, point);
    return pm_shooting_evaluate(&b->shooting, point + b->shooting.nweight, false);
}

// Collects the gradient with respect to weights and starts from the normal equations.
static double gradient_at(bench *b, const double *point) {
    pm_shooting *s = &b->shooting;
    const ptrdiff_t n = s->nweight, nb = s->nborder;
    pm_shooting_set_weights(s, point);
    const double value = pm_shooting_evaluate(s, point + n, true);
    for (ptrdiff_t i = 0; i < n; ++i) {
        b->gradient[i] = s->blocks.matrix[i * nb + n];
    }
    for (ptrdiff_t w = 0; w < s->nwindow; ++w) {
        for (ptrdiff_t c = 0; c < NZ; ++c) {
            double sum = s->blocks.border[(w * NZ + c) * nb + n];
            if (s->window[w].follows) {
                sum -= s->blocks.end_by_weights[((w - 1) * NZ + c) * nb + n] / s->terms.gap[c];
            }
            b->gradient[n + w * NZ + c] = sum;
        }
    }
    return value;
}

static void check_gradient(const char *integrator, int length) {
    bench b;
    bench_open(&b, 5, integrator, length);
    const double value = gradient_at(&b, b.point);
    random_system_check(&b.w, "objective with and without derivatives", value_at(&b, b.point),
                        value, 1e-9 * value);
    for (int d = 0; d < DIRECTIONS; ++d) {
        double *v = calloc(b.size, sizeof *v), slope = 0, scale = 0;
        assert_non_null(v);
        for (size_t i = 0; i < b.size; ++i) {
            const bool weight = i < (size_t)b.shooting.nweight;
            v[i] = d % 2 == 0 || weight == (d % 4 == 1) ? pm_rng_normal(&b.w.rng) : 0;
            slope += v[i] * b.gradient[i];
            scale += fabs(v[i] * b.gradient[i]);
        }
        double difference = 0;
        for (int sign = -1; sign <= 1; sign += 2) {
            for (size_t i = 0; i < b.size; ++i) {
                b.moved[i] = b.point[i] + sign * STEP * v[i];
            }
            difference += sign * value_at(&b, b.moved) / (2 * STEP);
        }
        random_system_check(&b.w, "slope of the objective", slope, difference, TOLERANCE * scale);
        free(v);
    }
    bench_close(&b);
}

static void gradient_of_rk4(void **state) {
    (void)state;
    check_gradient("rk4", SHORT);
    check_gradient("rk4", LENGTH);
    check_gradient("rk4", LONG);
}

static void gradient_of_discrete_gradient(void **state) {
    (void)state;
    check_gradient("discrete_gradient", LENGTH);
}

// Adds the product of the damped normal matrix and a step to `product` [size]. Every block is
// multiplied where it stands, without elimination. Weights are damped by the geometric mean of
// their own diagonal and the largest one, starts by their own diagonal.
static void multiply(const bench *b, double damping, const double *step, double *product) {
    const pm_shooting *s = &b->shooting;
    const ptrdiff_t n = s->nweight, nb = s->nborder;
    double largest = 0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        largest = fmax(largest, s->blocks.matrix[i * (nb + 1)]);
    }
    for (ptrdiff_t i = 0; i < n; ++i) {
        for (ptrdiff_t k = 0; k < n; ++k) {
            const double entry = s->blocks.matrix[i < k ? i * nb + k : k * nb + i];
            product[i] += entry * step[k];
        }
        product[i] += damping * sqrt(s->blocks.matrix[i * (nb + 1)] * largest) * step[i];
    }
    for (ptrdiff_t w = 0; w < s->nwindow; ++w) {
        const double *x = step + n + w * NZ;
        double *y = product + n + w * NZ;
        for (ptrdiff_t i = 0; i < NZ; ++i) {
            for (ptrdiff_t k = 0; k < NZ; ++k) {
                double entry = s->blocks.own[(w * NZ + i) * NZ + k];
                entry +=
                    i == k && s->window[w].follows ? 1 / (s->terms.gap[i] * s->terms.gap[i]) : 0;
                y[i] += (i == k ? 1 + damping : 1) * entry * x[k];
                if (!s->window[w].ends) {
                    const double next =
                        -s->blocks.end_by_start[(w * NZ + k) * NZ + i] / s->terms.gap[k];
                    y[i] += next * x[NZ + k];
                    y[NZ + k] += next * x[i];
                }
            }
            for (ptrdiff_t k = 0; k < n; ++k) {
                double entry = s->blocks.border[(w * NZ + i) * nb + k];
                if (s->window[w].follows) {
                    entry -=
                        s->blocks.end_by_weights[((w - 1) * NZ + i) * nb + k] / s->terms.gap[i];
                }
                y[i] += entry * step[k];
                product[k] += entry * x[i];
            }
        }
    }
}

// The step solves the damped normal equations of all unknowns.
static void elimination_solves_the_equations(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 6, "rk4", LENGTH);
    pm_shooting *s = &b.shooting;
    gradient_at(&b, b.point);
    assert_true(pm_shooting_solve(s, DAMPING, b.moved, b.moved + s->nweight));
    double *product = calloc(b.size, sizeof *product), largest = 0;
    assert_non_null(product);
    multiply(&b, DAMPING, b.moved, product);
    for (size_t i = 0; i < b.size; ++i) {
        largest = fmax(largest, fabs(b.gradient[i]));
    }
    for (size_t i = 0; i < b.size; ++i) {
        random_system_check(&b.w, "product with the step, plus the gradient, relative",
                            (product[i] + b.gradient[i]) / largest, 0, 1e-7);
    }
    free(product);
    bench_close(&b);
}

// Collects the residuals of all samples, with their factors from the last linearisation, and of all
// gaps. Returns how many there are.
static int collect(bench *b, const double *point, double *residual) {
    const pm_shooting *s = &b->shooting;
    int count = 0;
    value_at(b, point);
    for (int i = 0; i < TRACKS; ++i) {
        for (ptrdiff_t k = 0; k < (ptrdiff_t)b->track[i].count * s->ny; ++k) {
            const double factor = s->row[i][(k + 1) * s->nrow - 1];
            residual[count++] = isnan(b->y[i][k]) ? 0 : factor * s->residual[i][k];
        }
    }
    for (int w = 0; w < s->nwindow; ++w) {
        for (ptrdiff_t c = 0; c < NZ && !s->window[w].ends; ++c) {
            const double next = point[s->nweight + (w + 1) * NZ + c];
            residual[count++] = (s->end[w * NZ + c] - next) / s->terms.gap[c];
        }
    }
    return count;
}

// Writes J v [count] for a direction v of all unknowns, by differences of the residuals.
static void along(bench *b, const double *v, double *slope, double *work) {
    double *point = work + RESIDUALS;
    int count = 0;
    for (int sign = -1; sign <= 1; sign += 2) {
        for (size_t i = 0; i < b->size; ++i) {
            point[i] = b->point[i] + sign * STEP * v[i];
        }
        count = collect(b, point, sign < 0 ? work : slope);
    }
    for (int k = 0; k < count; ++k) {
        slope[k] = (slope[k] - work[k]) / (2 * STEP);
    }
}

// The first step of a minimisation is that of the damped equations plus half the second derivative
// of the unknowns along it, which solves the same equations with J' r''. Here J is found by
// differences, and r'' from J and the residuals at a tenth of the step.
static void steps_are_bent(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 9, "rk4", LONG);
    pm_shooting *s = &b.shooting;
    const size_t n = (size_t)s->nweight;
    double *step = calloc(4 * b.size + 3 * RESIDUALS, sizeof *step);
    assert_non_null(step);
    double *product = step + b.size, *v = product + b.size, *r = v + b.size;
    double *slope = r + RESIDUALS, *work = slope + RESIDUALS;
    gradient_at(&b, b.point);
    assert_true(pm_shooting_solve(s, STIFF, step, step + n));
    for (size_t i = 0; i < b.size; ++i) {
        b.moved[i] = b.point[i] + 0.1 * step[i];
    }
    const int count = collect(&b, b.point, work);
    assert_true(count < RESIDUALS);
    collect(&b, b.moved, r);
    for (int k = 0; k < count; ++k) {
        r[k] -= work[k];
    }
    along(&b, step, slope, work);
    for (int k = 0; k < count; ++k) {
        r[k] = 20 * (10 * r[k] - slope[k]);
    }
    memcpy(s->z, b.point + n, (b.size - n) * sizeof *s->z);
    pm_shooting_set_weights(s, b.point);
    double damping = STIFF;
    pm_shooting_progress progress = {0};
    assert_int_equal(
        pm_shooting_minimise(s, &(pm_shooting_limits){.iterations = 1}, &damping, &progress),
        PM_OK);
    assert_true(damping < STIFF); // the first damping was taken
    pm_shooting_weights(s, b.moved);
    memcpy(b.moved + n, s->z, (b.size - n) * sizeof *s->z);
    for (size_t i = 0; i < b.size; ++i) {
        b.moved[i] -= b.point[i] + step[i];
    }
    gradient_at(&b, b.point);
    multiply(&b, STIFF, b.moved, product);
    for (int d = 0; d < DIRECTIONS; ++d) {
        double bend = 0, curve = 0, scale = 0;
        for (size_t i = 0; i < b.size; ++i) {
            v[i] = pm_rng_normal(&b.w.rng);
            bend += product[i] * v[i];
            scale += fabs(product[i] * v[i]);
        }
        along(&b, v, slope, work);
        for (int k = 0; k < count; ++k) {
            curve += 0.5 * slope[k] * r[k];
        }
        assert_true(scale > 0);
        random_system_check(&b.w, "product with the bend, and half of J' r''", bend, -curve,
                            1e-5 * scale);
    }
    free(step);
    bench_close(&b);
}

// A weight alone is spare if the rise of the objective from its minimum without it, by its
// variance, is below half the logarithm of the number of measurements. In short windows nothing is
// spare.
static void weights_are_spare(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 8, "rk4", SAMPLES);
    pm_shooting *s = &b.shooting;
    const int n = s->nweight;
    unsigned char *optional = calloc((size_t)n * (size_t)n, 1);
    int *spare = calloc((size_t)n, sizeof *spare);
    pm_uncertainty u;
    assert_true(optional != NULL && spare != NULL);
    for (int i = 0; i < n; ++i) {
        s->terms.reach[i] =
            i % 2 == 0 ? 1e3 : 1e-2; // the data fix the former, the prior the latter
    }
    memcpy(s->z, b.point + n, (size_t)s->nwindow * NZ * sizeof *s->z);
    assert_int_equal(pm_uncertainty_make(&u, s), PM_OK);
    assert_true(isfinite(pm_shooting_evaluate(s, s->z, true)));
    assert_true(pm_shooting_solve(s, 0, b.moved, b.moved + n));
    double measurements = 1;
    for (int i = 0; i < TRACKS; ++i) {
        measurements += b.track[i].count * s->ny;
    }
    int found = 0, grouped = 0;
    for (int i = 0; i < DIRECTIONS; ++i) {
        const double away = i % 2 == 0 ? u.weights[i] + b.moved[i] : fmax(1 + b.moved[i], 0);
        const double variance = u.covariance[(ptrdiff_t)i * (n + 1)] / u.inflation;
        const double rise = away * away / (2 * variance), most = log(measurements) / 2;
        unsigned char *own = &optional[i * (n + 1)];
        *own = i % 2 == 0 ? PM_WEIGHT_OPTIONAL : PM_LOGARITHM_OPTIONAL;
        assert_int_equal(pm_uncertainty_spare(s, optional, spare), PM_OK);
        for (int j = 0; j < n; ++j) {
            const bool may = i == j && fabs(rise / most - 1) < STEP;
            assert_true(may || (spare[j] != 0) == (i == j && rise < most));
        }
        found += spare[i] != 0;
        // With another weight, which stays where it is and counts, too.
        const int other = (i + 1) % n;
        const double *covariance = u.covariance;
        const double a = covariance[i * (n + 1)], c = covariance[other * (n + 1)],
                     between = covariance[i * n + other], stays = b.moved[other];
        const double both = (c * away * away - 2 * between * away * stays + a * stays * stays) /
                            (2 * (a * c - between * between) / u.inflation);
        optional[i * n + other] = PM_WEIGHT_OPTIONAL;
        assert_int_equal(pm_uncertainty_spare(s, optional, spare), PM_OK);
        assert_true(away == 0 || fabs(both / (2 * most) - 1) < STEP ||
                    spare[i] == (both < 2 * most ? 2 : 0));
        assert_int_equal(spare[other], 0);
        grouped += spare[i] != 0;
        optional[i * n + other] = *own = PM_WEIGHT_NEEDED;
    }
    assert_true(found > 0 && found < DIRECTIONS && grouped > 0 && grouped < DIRECTIONS);
    optional[0] = PM_WEIGHT_OPTIONAL;
    assert_int_equal(pm_shooting_divide(s, LENGTH), PM_OK);
    assert_int_equal(pm_uncertainty_spare(s, optional, spare), PM_OK);
    assert_int_equal(spare[0], 0);
    free(optional);
    free(spare);
    pm_uncertainty_free(&u);
    bench_close(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradient_of_rk4),
        cmocka_unit_test(gradient_of_discrete_gradient),
        cmocka_unit_test(elimination_solves_the_equations),
        cmocka_unit_test(steps_are_bent),
        cmocka_unit_test(weights_are_spare),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

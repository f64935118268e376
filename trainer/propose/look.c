// Statistics of states and rates, and linear regressions by normal equations, which leave out what
// boundary inputs contribute linearly.
#include "propose/look.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"
#include "propose/least_squares.h"

#define MOST_STATES 6000   // the most examined states
#define MARGIN 2           // states at either end, needed for central differences
#define MOVES 1e-9         // relative change over one step below which a variable is constant
#define MOST_COMPONENTS 16 // of groups whose rank is examined
#define INDEPENDENT 1e-8   // eigenvalue of an independent process, relative to the largest
#define EVEN_TERMS 64      // of a function that is even in time
#define MOST_TERMS (EVEN_TERMS + PM_LOOK_SOURCES + 2) // of a regression, and the rate
_Static_assert(MOST_TERMS <= PM_MAX_TERMS, "a regression has room for all terms");
#define SMALLEST_REST 1e-5 // unexplained fraction below which nothing is left to explain
#define UPRIGHT 0.02       // relative to |x||x'|: largest part of a rate along a turning direction

static void take_rate(const pm_look *look, int i, int j, double *rate) {
    const pm_dataset *d = look->dataset;
    const int nz = look->scene->nz;
    if (d->zdot != NULL) {
        pm_columns_to_state(&look->columns, pm_dataset_rate(d, i, j), rate);
        return;
    }
    double *around = rate + nz; // work space behind it
    memset(rate, 0, (size_t)nz * sizeof *rate);
    static const double weight[5] = {1.0 / 12, -8.0 / 12, 0, 8.0 / 12, -1.0 / 12};
    for (int k = -2; k <= 2; ++k) {
        pm_columns_to_state(&look->columns, pm_dataset_state(d, i, j + k), around);
        for (int c = 0; c < nz; ++c) {
            rate[c] += weight[k + 2] * around[c] / d->dt;
        }
    }
}

// Finds the largest ratio rms(rate' - rate)/(dt rms(rate)) over all components.
static void find_fastest(pm_look *look, const double *change) {
    const int nz = look->scene->nz;
    for (int c = 0; c < nz; ++c) {
        double square = 0;
        for (int k = 0; k < look->count; ++k) {
            const double r = look->rate[(ptrdiff_t)k * nz + c];
            square += r * r;
        }
        if (square > 0) {
            look->fastest = fmax(look->fastest, sqrt(change[c] / square) / look->dataset->dt);
        }
    }
}

pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *dataset) {
    const int nz = scene->nz, per = dataset->ntime - 2 * MARGIN - 1;
    *look = (pm_look){.scene = scene, .dataset = dataset};
    if (per < 1) {
        return pm_fail(PM_EDATA, "trajectories of %d states are too short to examine",
                       dataset->ntime);
    }
    look->samples = dataset->ntrajectory * dataset->ntime;
    const long all = (long)dataset->ntrajectory * per, stride = all / MOST_STATES + 1;
    const size_t count = (size_t)(all / stride + 1);
    look->z = pm_arena_array(&look->arena, count * (size_t)nz, sizeof *look->z);
    look->rate = pm_arena_array(&look->arena, count * (size_t)nz, sizeof *look->rate);
    double *work = pm_arena_array(&look->arena, 5 * (size_t)nz, sizeof *work);
    double *change = work == NULL ? NULL : work + 4 * nz;
    look->inputs = pm_arena_array(&look->arena, 1, sizeof *look->inputs);
    pm_status status = pm_columns_bind(&look->columns, scene, dataset, &look->arena);
    if (status == PM_OK &&
        (look->z == NULL || look->rate == NULL || work == NULL || look->inputs == NULL)) {
        status = pm_fail(PM_ENOMEM, "out of memory for a look at the data");
    }
    if (status == PM_OK) {
        status = pm_inputs_bind(look->inputs, scene, dataset, (int)count, &look->arena);
    }
    for (long k = 0; k < all && status == PM_OK; k += stride) {
        const int i = (int)(k / per), j = MARGIN + (int)(k % per);
        const ptrdiff_t at = (ptrdiff_t)look->count++ * nz;
        pm_columns_to_state(&look->columns, pm_dataset_state(dataset, i, j), look->z + at);
        pm_inputs_add(look->inputs, i, j);
        take_rate(look, i, j, work);
        memcpy(look->rate + at, work, (size_t)nz * sizeof *work);
        take_rate(look, i, j + 1, work);
        for (int c = 0; c < nz; ++c) {
            const double difference = work[c] - look->rate[at + c];
            change[c] += difference * difference;
        }
    }
    if (status == PM_OK) {
        find_fastest(look, change);
        status = pm_inputs_find_bases(look->inputs, &look->arena);
    }
    if (status != PM_OK) {
        pm_look_free(look);
    }
    return status;
}

void pm_look_free(pm_look *look) {
    pm_arena_free(&look->arena);
}

pm_look_group pm_look_at(const pm_look *look, int subsystem, int group) {
    const pm_scene_subsystem *s = &look->scene->subsystem[subsystem];
    pm_look_group g = {.group = &s->layout.group[group],
                       .first = s->first + s->layout.group[group].first,
                       .positive = true};
    const int nz = look->scene->nz, size = g.group->size;
    double square = 0, rate = 0, largest = 0, smallest = INFINITY;
    for (int c = g.first; c < g.first + size; ++c) {
        double mean = 0;
        for (int k = 0; k < look->count; ++k) {
            mean += look->z[(ptrdiff_t)k * nz + c] / look->count;
        }
        for (int k = 0; k < look->count; ++k) {
            const double z = look->z[(ptrdiff_t)k * nz + c], r = look->rate[(ptrdiff_t)k * nz + c];
            square += (z - mean) * (z - mean) / ((double)look->count * size);
            rate += r * r / ((double)look->count * size);
            largest = fmax(largest, fabs(z));
            g.positive = g.positive && z > 0;
        }
    }
    g.deviation = sqrt(square);
    g.rate = sqrt(rate);
    g.constant = !(g.rate * look->dataset->dt > MOVES * largest);
    for (int k = 0; k < look->count; ++k) {
        double length = 0;
        for (int c = g.first; c < g.first + size; ++c) {
            length = hypot(length, look->z[(ptrdiff_t)k * nz + c]);
        }
        smallest = fmin(smallest, length);
    }
    g.shortest = smallest;
    return g;
}

int pm_look_subsystem(const pm_look *look, int component) {
    int i = 0;
    while (i + 1 < look->scene->nsubsystem && look->scene->subsystem[i + 1].first <= component) {
        ++i;
    }
    return i;
}

// Returns the functions by which inputs act on the subsystem of a component.
static const pm_input_basis *inputs_of(const pm_look *look, int component) {
    return &look->inputs->basis[pm_look_subsystem(look, component)];
}

// --- regression ---

// Returns the mean of one component of the rates or states over the examined states.
static double mean_of(const pm_look *look, const double *values, int c) {
    double sum = 0;
    for (int k = 0; k < look->count; ++k) {
        sum += values[(ptrdiff_t)k * look->scene->nz + c];
    }
    return sum / look->count;
}

// Writes the powers 1 to `degree` of component c of all sources, centred and divided by their
// deviations.
static void powers(const pm_look *look, int k, int c, int count, const pm_look_group *source,
                   int degree, const double *mean, double *x) {
    for (int a = 0; a < count; ++a) {
        const double z = look->z[(ptrdiff_t)k * look->scene->nz + source[a].first + c];
        const double unit = source[a].deviation > 0 ? source[a].deviation : 1;
        for (int d = 0; d < degree; ++d) {
            x[a * degree + d] = pow((z - mean[a]) / unit, d + 1);
        }
    }
}

// Writes the powers of the sources and then the rate of component c of the target.
static void regression_row(const pm_look *look, int k, const pm_look_group *target, int c,
                           int count, const pm_look_group *source, int degree, const double *mean,
                           double *x) {
    powers(look, k, c, count, source, degree, mean, x);
    x[count * degree] = look->rate[(ptrdiff_t)k * look->scene->nz + target->first + c];
}

// Adds the equations of component c, without what is linear in the functions of the basis. Returns
// the squares of the rate before that.
static double add_component(const pm_look *look, const pm_look_group *target, int c, int count,
                            const pm_look_group *source, int degree, const pm_input_basis *basis,
                            pm_least_squares *s) {
    enum { MOST = PM_LOOK_SOURCES + 1 };
    double x[MOST], mean[PM_LOOK_SOURCES], middle[MOST] = {0};
    double along[PM_MAX_INPUT_BASIS * MOST] = {0}, square = 0;
    for (int a = 0; a < count; ++a) {
        mean[a] = mean_of(look, look->z, source[a].first + c);
    }
    for (int pass = 0; pass < 3; ++pass) {
        for (int k = 0; k < look->count && (pass != 1 || basis->count > 0); ++k) {
            regression_row(look, k, target, c, count, source, degree, mean, x);
            for (int a = 0; a < s->n; ++a) {
                middle[a] += pass == 0 ? x[a] / look->count : 0;
            }
            for (int a = 0; a <= s->n && pass > 0; ++a) {
                x[a] -= middle[a];
            }
            if (pass == 1) {
                pm_input_basis_project(basis, k, s->n + 1, x, along);
            } else if (pass == 2) {
                square += x[s->n] * x[s->n];
                pm_input_basis_remove(basis, k, s->n + 1, along, x);
                pm_least_squares_add(s, x, x[s->n]);
            }
        }
        middle[s->n] = mean_of(look, look->rate, target->first + c);
    }
    return square;
}

// Where inputs alone explain a rate, such as those of a controller that follows the state, the
// regression leaves them out.
static double explain(const pm_look *look, const pm_look_group *target, int count,
                      const pm_look_group *source, int degree, double *solution) {
    static const pm_input_basis none = {0};
    const pm_input_basis *basis = inputs_of(look, target->first);
    for (;;) {
        pm_least_squares s = {.n = count * degree};
        double square = 0;
        for (int c = 0; c < target->group->size; ++c) {
            square += add_component(look, target, c, count, source, degree, basis, &s);
        }
        if (basis->count == 0 || s.square > SMALLEST_REST * square) {
            return pm_least_squares_solve(&s, solution);
        }
        basis = &none;
    }
}

double pm_look_explain(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, double *coefficient) {
    const int n = count < PM_LOOK_SOURCES ? count : PM_LOOK_SOURCES;
    const double rest = explain(look, target, n, source, 1, coefficient);
    for (int a = 0; a < n; ++a) {
        coefficient[a] /= source[a].deviation > 0 ? source[a].deviation : 1;
    }
    return rest;
}

double pm_look_explain_powers(const pm_look *look, const pm_look_group *target, int count,
                              const pm_look_group *source, int degree) {
    double solution[PM_LOOK_SOURCES];
    const int most = PM_LOOK_SOURCES / degree;
    return explain(look, target, count < most ? count : most, source, degree, solution);
}

// --- parity ---

// Writes the terms of a function that is even in time: the even variables, the products of two of
// them, and the products of two odd ones, as far as there is room. `term` holds MOST_TERMS numbers.
// The variables are centred, the odd ones only scaled. Returns the number of terms.
static int even_terms(const pm_look *look, const pm_parity *p, int k, const double *mean,
                      const double *deviation, double *term) {
    const double *z = look->z + (ptrdiff_t)k * look->scene->nz;
    int n = 0;
    for (int degree = 1; degree <= 2; ++degree) {
        for (int i = 0; i < p->neven; ++i) {
            const double x = (z[p->even[i]] - mean[p->even[i]]) / deviation[p->even[i]];
            for (int j = i; j < (degree == 1 ? i + 1 : p->neven) && n < EVEN_TERMS; ++j) {
                const double y = (z[p->even[j]] - mean[p->even[j]]) / deviation[p->even[j]];
                term[n++] = degree == 1 ? x : x * y;
            }
        }
        for (int i = 0; i < p->nodd && degree == 1; ++i) {
            for (int j = i; j < p->nodd && n < EVEN_TERMS; ++j) {
                term[n++] =
                    z[p->odd[i]] / deviation[p->odd[i]] * z[p->odd[j]] / deviation[p->odd[j]];
            }
        }
    }
    return n;
}

// Adds the component `odd` and its products with even variables to n terms. Returns their number.
static int odd_terms(const pm_look *look, const pm_parity *p, int k, int odd, const double *mean,
                     const double *deviation, int n, double *term) {
    const double *z = look->z + (ptrdiff_t)k * look->scene->nz;
    const double x = z[odd] / deviation[odd];
    term[n++] = x;
    for (int i = 0; i < p->neven; ++i) {
        term[n++] = x * (z[p->even[i]] - mean[p->even[i]]) / deviation[p->even[i]];
    }
    return n;
}

// The regression of the rate of component `target` on the even terms and, if `with` >= 0, on
// those that are linear in the component `with`, without what is linear in inputs. Returns the
// unexplained fraction of the squares.
static double explain_even(const pm_look *look, const pm_parity *p, int target, int with,
                           const double *mean, const double *deviation) {
    const int nz = look->scene->nz;
    const pm_input_basis *basis = inputs_of(look, target);
    double middle[MOST_TERMS] = {0}, term[MOST_TERMS], solution[MOST_TERMS];
    double along[PM_MAX_INPUT_BASIS * MOST_TERMS] = {0};
    const double y = mean_of(look, look->rate, target);
    pm_least_squares s = {0};
    for (int pass = 0; pass < 3; ++pass) {
        for (int k = 0; k < look->count && (pass != 1 || basis->count > 0); ++k) {
            int n = even_terms(look, p, k, mean, deviation, term);
            if (with >= 0) {
                n = odd_terms(look, p, k, with, mean, deviation, n, term);
            }
            for (int a = 0; a < n; ++a) {
                middle[a] += pass == 0 ? term[a] / look->count : 0;
                term[a] -= pass == 0 ? 0 : middle[a];
            }
            s.n = n;
            term[n] = look->rate[(ptrdiff_t)k * nz + target] - y;
            if (pass == 1) {
                pm_input_basis_project(basis, k, n + 1, term, along);
            } else if (pass == 2) {
                pm_input_basis_remove(basis, k, n + 1, along, term);
                pm_least_squares_add(&s, term, term[n]);
            }
        }
    }
    return pm_least_squares_solve(&s, solution);
}

double pm_look_odd_part(const pm_look *look, const pm_parity *p, int target, int odd) {
    double mean[PM_MAX_LOOK_STATES], deviation[PM_MAX_LOOK_STATES];
    const int nz = look->scene->nz;
    if (nz > PM_MAX_LOOK_STATES) {
        return 0;
    }
    for (int c = 0; c < nz; ++c) {
        mean[c] = mean_of(look, look->z, c);
        deviation[c] = 0;
        for (int k = 0; k < look->count; ++k) {
            const double x = look->z[(ptrdiff_t)k * nz + c] - mean[c];
            deviation[c] += x * x / look->count;
        }
        deviation[c] = deviation[c] > 0 ? sqrt(deviation[c]) : 1;
    }
    const double without = explain_even(look, p, target, -1, mean, deviation);
    const double rest = explain_even(look, p, target, odd, mean, deviation);
    return without < SMALLEST_REST ? 0 : 1 - rest / without;
}

// --- rank ---

// Writes the scalar products of all components over the examined states to product [n][n], each
// component divided by its root mean square. Where inputs act, the components are without their
// means and without what is linear in the inputs.
static void multiply_rates(const pm_look *look, int n, const int *component, double *product) {
    const pm_input_basis *basis = inputs_of(look, component[0]);
    double mean[MOST_COMPONENTS] = {0}, rate[MOST_COMPONENTS];
    double along[PM_MAX_INPUT_BASIS * MOST_COMPONENTS] = {0};
    memset(product, 0, (size_t)n * (size_t)n * sizeof *product);
    for (int a = 0; a < n && basis->count > 0; ++a) {
        mean[a] = mean_of(look, look->rate, component[a]);
    }
    for (int pass = basis->count > 0 ? 0 : 1; pass < 2; ++pass) {
        for (int k = 0; k < look->count; ++k) {
            for (int a = 0; a < n; ++a) {
                rate[a] = look->rate[(ptrdiff_t)k * look->scene->nz + component[a]] - mean[a];
            }
            if (pass == 0) {
                pm_input_basis_project(basis, k, n, rate, along);
                continue;
            }
            pm_input_basis_remove(basis, k, n, along, rate);
            for (int a = 0; a < n * n; ++a) {
                product[a] += rate[a / n] * rate[a % n];
            }
        }
    }
    double size[MOST_COMPONENTS];
    for (int a = 0; a < n; ++a) {
        size[a] = product[a * n + a] > 0 ? sqrt(product[a * n + a]) : 1;
    }
    for (int a = 0; a < n * n; ++a) {
        product[a] /= size[a / n] * size[a % n];
    }
}

int pm_look_rank(const pm_look *look, int count, const pm_look_group *group) {
    int component[MOST_COMPONENTS], n = 0, components = 0, rank = 0;
    for (int i = 0; i < count; ++i) {
        for (int c = 0; c < group[i].group->size; ++c, ++components) {
            component[n < MOST_COMPONENTS ? n++ : 0] = group[i].first + c;
        }
    }
    double product[MOST_COMPONENTS * MOST_COMPONENTS], value[MOST_COMPONENTS];
    double vector[MOST_COMPONENTS * MOST_COMPONENTS];
    if (components > MOST_COMPONENTS || n == 0) {
        return components;
    }
    multiply_rates(look, n, component, product);
    if (!pm_eigen_largest(n, product, n, value, vector)) {
        return components;
    }
    for (int a = 0; a < n; ++a) {
        rank += value[a] > INDEPENDENT * value[0];
    }
    return rank;
}

// --- directions ---

int pm_look_turns(const pm_look *look, const pm_look_group *target, const pm_look_group *spin) {
    double along = 0, size = 0, turn = 0;
    for (int k = 0; k < look->count; ++k) {
        const double *z = look->z + (ptrdiff_t)k * look->scene->nz;
        const double *x = z + target->first, *m = z + spin->first;
        const double *rate = look->rate + (ptrdiff_t)k * look->scene->nz + target->first;
        const double product = x[0] * rate[0] + x[1] * rate[1] + x[2] * rate[2];
        along += product * product;
        size += (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) *
                (rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]);
        for (int c = 0; c < 3; ++c) {
            const int d = (c + 1) % 3, e = (c + 2) % 3;
            turn += rate[c] * (x[d] * m[e] - x[e] * m[d]);
        }
    }
    return !(along < UPRIGHT * UPRIGHT * size) ? 0 : turn > 0 ? 1 : -1;
}

// Statistics of states and rates, and linear regressions by normal equations, which leave out what
// boundary inputs contribute linearly. Every regression writes its terms to a table, row by row for
// the examined states, prepares the columns of the table, and sums up the normal equations.
#include "propose/look.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"

// At most MOST_STATES states are examined; more would cost time and change no figure that is
// printed. Central differences of fourth order need MARGIN states at either end of a trajectory.
#define MOST_STATES 6000
#define FEWEST_CALM 0.2 // of the states, away from jumps of inputs, that suffice
#define MARGIN 2
static const double difference[2 * MARGIN + 1] = {1.0 / 12, -8.0 / 12, 0, 8.0 / 12, -1.0 / 12};

// RIDGE is a ridge on normal equations, relative to the diagonal, for terms that depend on each
// other linearly. TINY keeps a row of zeros from being singular.
#define RIDGE 1e-10
#define TINY 1e-300
// Of an input: length of what is new in it, relative to its size. Less than that is rounding.
#define NEW_INPUT 1e-6
#define MOST_INPUTS 32     // inputs of one subsystem that are linearly independent
#define INPUT_KINDS 3      // values of each variable of a boundary input: state, dE and dS
#define SMALLEST_REST 1e-5 // unexplained fraction below which nothing is left to explain

// Terms of a function that is even in time; the other terms of that regression are odd.
#define EVEN_TERMS 64
_Static_assert(EVEN_TERMS + PM_LOOK_SOURCES + 2 <= PM_MAX_TERMS, "a regression has room");

// The rank of rates: the components that it examines, and the eigenvalue of an independent process,
// relative to the largest. Sums of rates that should vanish have squares of rounding errors.
#define MOST_COMPONENTS 16
#define INDEPENDENT 1e-8

// The regression that looks for a decay has at most DECAY_TERMS terms. A derivative counts if it is
// SIGNIFICANT standard errors from 0.
#define DECAY_TERMS 80
#define SIGNIFICANT 5
_Static_assert(DECAY_TERMS <= PM_MAX_TERMS, "a regression has room for all terms of the decay");

// --- least squares ---

void pm_least_squares_add(pm_least_squares *s, const double *x, double y) {
    for (int a = 0; a < s->n; ++a) {
        s->right[a] += x[a] * y;
        for (int b = a; b < s->n; ++b) {
            s->matrix[a * s->n + b] += x[a] * x[b];
        }
    }
    s->square += y * y;
}

static void add_ridge(int n, double *matrix) {
    for (int a = 0; a < n; ++a) {
        matrix[a * n + a] = matrix[a * n + a] * (1 + RIDGE) + TINY;
    }
}

double pm_least_squares_solve(pm_least_squares *s, double *solution) {
    memcpy(solution, s->right, sizeof(double) * (size_t)s->n);
    add_ridge(s->n, s->matrix);
    if (s->square == 0 || s->n == 0 || !pm_cholesky_solve(s->n, s->matrix, solution)) {
        memset(solution, 0, sizeof(double) * (size_t)s->n);
        return 1;
    }
    double explained = 0;
    for (int a = 0; a < s->n; ++a) {
        explained += solution[a] * s->right[a];
    }
    return fmax(1 - explained / s->square, 0);
}

// --- the table of a regression ---

// Returns row k of the table, which has n columns.
static double *row_of(const pm_look *look, int n, int k) {
    return look->work + (ptrdiff_t)k * n;
}

// Subtracts their means from n columns of the table.
static void centre(const pm_look *look, int n) {
    double mean[PM_MAX_TERMS + 1] = {0};
    for (int k = 0; k < look->count; ++k) {
        for (int a = 0; a < n; ++a) {
            mean[a] += row_of(look, n, k)[a] / look->count;
        }
    }
    for (int k = 0; k < look->count; ++k) {
        for (int a = 0; a < n; ++a) {
            row_of(look, n, k)[a] -= mean[a];
        }
    }
}

// Returns the functions by which inputs act on the subsystem of a component.
static const pm_input_basis *inputs_of(const pm_look *look, int component) {
    int i = 0;
    while (i + 1 < look->scene->physics.nsubsystem &&
           look->scene->physics.subsystem[i + 1].first <= component) {
        ++i;
    }
    return &look->basis[i];
}

// Subtracts from n columns of the table what is linear in the inputs.
static void remove_inputs(const pm_look *look, const pm_input_basis *basis, int n) {
    for (int b = 0; b < basis->count; ++b) {
        const double *u = basis->value + (ptrdiff_t)b * look->count;
        double along[PM_MAX_TERMS + 1] = {0};
        for (int k = 0; k < look->count; ++k) {
            for (int a = 0; a < n; ++a) {
                along[a] += u[k] * row_of(look, n, k)[a];
            }
        }
        for (int k = 0; k < look->count; ++k) {
            for (int a = 0; a < n; ++a) {
                row_of(look, n, k)[a] -= u[k] * along[a];
            }
        }
    }
}

// Adds the equations of all rows, whose last column is the result.
static void add_rows(const pm_look *look, pm_least_squares *s) {
    for (int k = 0; k < look->count; ++k) {
        const double *x = row_of(look, s->n + 1, k);
        pm_least_squares_add(s, x, x[s->n]);
    }
}

// --- boundary inputs ---

// Orthonormalises the values of the inputs that ports show to each subsystem (Golub and Van Loan,
// Matrix Computations, 5.2.8: modified Gram-Schmidt).
static pm_status find_bases(pm_look *look) {
    const pm_scene *scene = look->scene;
    const int count = look->count, n = scene->physics.nprescribed;
    for (int e = 0; e < scene->physics.first_end[scene->physics.nsubsystem]; ++e) {
        const pm_scene_port *port = &scene->physics.port[scene->physics.end_at[e] / 2];
        const int end = scene->physics.end_at[e] % 2, other = 1 - end;
        if (port->boundary_input[other] < 0) {
            continue;
        }
        pm_input_basis *basis = &look->basis[port->subsystem[end]];
        if (basis->value == NULL) {
            basis->value =
                pm_arena_array(&look->arena, MOST_INPUTS * (size_t)count, sizeof *basis->value);
            PM_TRY(pm_arena_status(&look->arena, "boundary inputs"));
        }
        const pm_scene_boundary_input *owner =
            &scene->physics.boundary_input[port->boundary_input[other]];
        const int nz = port->layout[other].nz;
        for (int v = 0; v < INPUT_KINDS * nz && basis->count < MOST_INPUTS; ++v) {
            const int id =
                owner->first + v / nz * owner->layout.nz + port->component[other][v % nz];
            double *to = basis->value + (ptrdiff_t)basis->count * count;
            double mean = 0, size = 0, square = 0;
            for (int k = 0; k < count; ++k) {
                to[k] = look->input[(ptrdiff_t)k * n + id];
                mean += to[k] / count;
                size = fmax(size, fabs(to[k]));
            }
            for (int k = 0; k < count; ++k) {
                to[k] -= mean;
            }
            for (int b = 0; b < basis->count; ++b) {
                const double *u = basis->value + (ptrdiff_t)b * count;
                double along = 0;
                for (int k = 0; k < count; ++k) {
                    along += to[k] * u[k];
                }
                for (int k = 0; k < count; ++k) {
                    to[k] -= along * u[k];
                }
            }
            for (int k = 0; k < count; ++k) {
                square += to[k] * to[k];
            }
            const double length = sqrt(square);
            for (int k = 0; k < count; ++k) {
                to[k] /= length > 0 ? length : 1;
            }
            basis->count += length > NEW_INPUT * size * sqrt(count);
        }
    }
    return PM_OK;
}

int pm_look_inputs(const pm_look *look, int component, int size, int most, int (*input)[3]) {
    const pm_scene *scene = look->scene;
    const int subsystem = (int)(inputs_of(look, component) - look->basis);
    int count = 0;
    for (int e = scene->physics.first_end[subsystem]; e < scene->physics.first_end[subsystem + 1];
         ++e) {
        const pm_scene_port *port = &scene->physics.port[scene->physics.end_at[e] / 2];
        const int other = 1 - scene->physics.end_at[e] % 2, id = port->boundary_input[other];
        for (int g = 0; id >= 0 && g < port->layout[other].ngroup; ++g) {
            const pm_group *group = &port->layout[other].group[g];
            const pm_scene_boundary_input *owner = &scene->physics.boundary_input[id];
            for (int c = 0; c < size && group->size == size && count < most; ++c) {
                input[count][c] =
                    owner->first + owner->layout.nz + port->component[other][group->first + c];
            }
            count += group->size == size && count < most;
        }
    }
    return count;
}

// --- decay ---

// Finds look->decay from a regression of all rates on the components, their squares, the logarithms
// of the lengths of vectors and the boundary inputs, which share one factorised matrix.
static pm_status find_decay(pm_look *look) {
    const pm_scene *scene = look->scene;
    const int nz = scene->physics.nz, count = look->count, ninput = scene->physics.nprescribed;
    if (2 * nz + nz / 2 > DECAY_TERMS) { // each vector has two components or more
        return PM_OK;
    }
    int n = 2 * nz, vector[DECAY_TERMS][2], nvector = 0, input[DECAY_TERMS], nvarying = 0;
    const char *unit[DECAY_TERMS];
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        for (int g = 0; g < s->layout.ngroup; ++g) {
            const pm_group *group = &s->layout.group[g];
            for (int c = 0; c < group->size; ++c) {
                unit[s->first + group->first + c] = group->unit;
            }
            if (group->size > 1) {
                vector[nvector][0] = s->first + group->first;
                vector[nvector++][1] = group->size;
            }
        }
    }
    n += nvector;
    for (int i = 0; i < ninput && n < DECAY_TERMS; ++i) {
        if (look->source->column[i] != PM_BOUNDARY_INPUT_CONSTANT) {
            input[nvarying++] = i;
            ++n;
        }
    }
    // The terms, centred and divided by their deviations. Squares of deviations differ more from
    // the components than squares of the components.
    double mean[DECAY_TERMS] = {0}, deviation[DECAY_TERMS] = {0};
    for (int k = 0; k < count; ++k) {
        for (int c = 0; c < nz; ++c) {
            mean[c] += look->z[(ptrdiff_t)k * nz + c] / count;
        }
    }
    for (int k = 0; k < count; ++k) {
        const double *z = look->z + (ptrdiff_t)k * nz;
        double *x = row_of(look, n, k);
        for (int c = 0; c < nz; ++c) {
            x[c] = z[c];
            x[nz + c] = (z[c] - mean[c]) * (z[c] - mean[c]);
        }
        for (int g = 0; g < nvector; ++g) {
            double square = 0;
            for (int c = vector[g][0]; c < vector[g][0] + vector[g][1]; ++c) {
                square += z[c] * z[c];
            }
            x[2 * nz + g] = log(square + TINY);
        }
        for (int a = 0; a < nvarying; ++a) {
            x[2 * nz + nvector + a] = look->input[(ptrdiff_t)k * ninput + input[a]];
        }
    }
    centre(look, n);
    for (int pass = 0; pass < 2; ++pass) {
        for (int k = 0; k < count; ++k) {
            double *x = row_of(look, n, k);
            for (int a = 0; a < n; ++a) {
                deviation[a] += pass == 0 ? x[a] * x[a] / count : 0;
                x[a] /= pass == 0 ? 1 : deviation[a];
            }
        }
        for (int a = 0; a < n && pass == 0; ++a) {
            deviation[a] = deviation[a] > 0 ? sqrt(deviation[a]) : 1;
        }
    }
    // The coefficients of all rates, and the inverse of the matrix.
    double *matrix = pm_arena_array(&look->arena, (size_t)(n * n), sizeof *matrix);
    double *inverse = pm_arena_array(&look->arena, (size_t)(n * n), sizeof *inverse);
    double *solution = pm_arena_array(&look->arena, (size_t)(n * nz), sizeof *solution);
    PM_TRY(pm_arena_status(&look->arena, "the regression of a decay"));
    pm_gram_add(count, n, look->work, matrix);
    pm_gemm(true, false, n, nz, count, look->work, look->rate, solution);
    add_ridge(n, matrix);
    if (!pm_cholesky_factor(n, matrix)) {
        return PM_OK;
    }
    for (int a = 0; a < n; ++a) {
        inverse[a * n + a] = 1;
    }
    pm_cholesky_back(n, matrix, nz, solution);
    pm_cholesky_back(n, matrix, n, inverse);
    for (int c = 0; c < nz; ++c) {
        double middle = 0, rest = 0, sum = 0, own = 0;
        for (int k = 0; k < count; ++k) {
            middle += look->rate[(ptrdiff_t)k * nz + c] / count;
        }
        for (int k = 0; k < count; ++k) {
            double y = look->rate[(ptrdiff_t)k * nz + c] - middle;
            for (int a = 0; a < n; ++a) {
                y -= solution[a * nz + c] * row_of(look, n, k)[a];
            }
            rest += y * y / count;
        }
        for (int d = 0; d < nz; ++d) {
            const double x = solution[d * nz + c], error = sqrt(inverse[d * n + d] * rest);
            const double derivative = fabs(x) > SIGNIFICANT * error ? x / deviation[d] : 0;
            sum += strcmp(unit[c], unit[d]) == 0 ? fabs(derivative) : 0;
            own = d == c ? derivative : own;
        }
        look->decay = own < 0 ? fmax(look->decay, sum) : look->decay;
    }
    return PM_OK;
}

// --- examined states ---

static void take_rate(const pm_look *look, int i, int j, double *rate) {
    const pm_dataset *d = look->dataset;
    const int nz = look->scene->physics.nz;
    if (d->zdot != NULL) {
        pm_columns_to_state(&look->columns, pm_dataset_rate(d, i, j), rate);
        return;
    }
    double *around = rate + nz; // work space behind it
    memset(rate, 0, (size_t)nz * sizeof *rate);
    for (int k = -MARGIN; k <= MARGIN; ++k) {
        pm_columns_to_state(&look->columns, pm_dataset_state(d, i, j + k), around);
        for (int c = 0; c < nz; ++c) {
            rate[c] += difference[k + MARGIN] * around[c] / d->dt;
        }
    }
}

// Whether the rates at sample j of trajectory i, and at the next one, are differences of states
// between which no input jumps.
static bool has_rates(const pm_look *look, int i, int j, bool jumps) {
    const pm_dataset *d = look->dataset;
    const double from = j - MARGIN, end = j + 1 + MARGIN;
    const bool inside = j + 1 + MARGIN < pm_dataset_length(d, i);
    return inside && (jumps || d->zdot != NULL || look->scene->physics.nprescribed == 0 ||
                      !(pm_boundary_input_jump(look->source, from, end) < end));
}

pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *d) {
    const int nz = scene->physics.nz, per = d->ntime - 2 * MARGIN - 1; // states of a trajectory
    *look = (pm_look){.scene = scene, .dataset = d, .samples = d->ntrajectory * d->ntime};
    if (per < 1) {
        return pm_fail(PM_EDATA, "trajectories of %d states are too short to examine", d->ntime);
    }
    const long all = (long)d->ntrajectory * per, stride = all / MOST_STATES + 1;
    const size_t count = (size_t)(all / stride + 1), n = (size_t)nz;
    double *rate, *change, *square;
    int followed = -1;
    pm_status status;
    PM_TRY_DONE(pm_columns_bind(&look->columns, scene, d, &look->arena));
    look->z = pm_arena_array(&look->arena, count * n, sizeof *look->z);
    look->rate = pm_arena_array(&look->arena, count * n, sizeof *look->rate);
    look->work = pm_arena_array(&look->arena, count * (PM_MAX_TERMS + 1), sizeof *look->work);
    look->input =
        pm_arena_array(&look->arena, count * (size_t)scene->physics.nprescribed, sizeof(double));
    look->source = pm_arena_array(&look->arena, 1, sizeof *look->source);
    look->basis =
        pm_arena_array(&look->arena, (size_t)scene->physics.nsubsystem, sizeof *look->basis);
    rate = pm_arena_array(&look->arena, 2 * n, sizeof *rate);
    change = pm_arena_array(&look->arena, n, sizeof *change);
    square = pm_arena_array(&look->arena, n, sizeof *square);
    PM_TRY_DONE(pm_arena_status(&look->arena, "a look at the data"));
    PM_TRY_DONE(pm_boundary_input_bind(look->source, scene, d, 1, &look->arena));
    // States near a jump of an input are left out, unless few others are left.
    long calm = 0;
    for (long k = 0; k < all; k += stride) {
        const int i = (int)(k / per);
        if (scene->physics.nprescribed > 0 && followed != i) {
            pm_boundary_input_follow(look->source, d, i);
            followed = i;
        }
        calm += has_rates(look, i, MARGIN + (int)(k % per), false);
    }
    const bool jumps = (double)calm < FEWEST_CALM * (double)(all / stride + 1);
    for (long k = 0; k < all; k += stride) {
        const int i = (int)(k / per), j = MARGIN + (int)(k % per);
        const ptrdiff_t at = (ptrdiff_t)look->count * nz;
        if (scene->physics.nprescribed > 0 && followed != i) {
            pm_boundary_input_follow(look->source, d, i);
            followed = i;
        }
        if (!has_rates(look, i, j, jumps)) {
            continue;
        }
        pm_columns_to_state(&look->columns, pm_dataset_state(d, i, j), look->z + at);
        if (scene->physics.nprescribed > 0) {
            pm_boundary_input_at(look->source, j, 0,
                                 look->input + (ptrdiff_t)look->count * scene->physics.nprescribed);
        }
        take_rate(look, i, j, rate);
        memcpy(look->rate + at, rate, n * sizeof *rate);
        take_rate(look, i, j + 1, rate);
        for (int c = 0; c < nz; ++c) {
            const double r = look->rate[at + c];
            change[c] += (rate[c] - r) * (rate[c] - r);
            square[c] += r * r;
        }
        ++look->count;
    }
    if (look->count == 0) {
        status = pm_fail(PM_EDATA, "trajectories of %d states are too short to examine", d->ntime);
        goto done;
    }
    for (int c = 0; c < nz; ++c) {
        if (square[c] > 0) {
            look->fastest = fmax(look->fastest, sqrt(change[c] / square[c]) / d->dt);
        }
    }
    PM_TRY_DONE(find_bases(look));
    status = find_decay(look);
done:
    if (status != PM_OK) {
        pm_look_free(look);
    }
    return status;
}

void pm_look_free(pm_look *look) {
    pm_arena_free(&look->arena);
}

// --- regressions of rates ---

double pm_regress_rate(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, int degree, double *coefficient) {
    const int nz = look->scene->physics.nz, most = PM_LOOK_SOURCES / degree;
    const int nsource = count < most ? count : most, n = nsource * degree;
    const pm_input_basis *basis = inputs_of(look, target->first);
    double solution[PM_LOOK_SOURCES];
    pm_least_squares s = {.n = n};
    // Where inputs alone explain a rate, such as those of a controller that follows the state, a
    // second pass leaves the inputs out.
    for (int pass = 0; pass < 2; ++pass) {
        double square = 0; // of the rate
        s = (pm_least_squares){.n = n};
        for (int c = 0; c < target->group->size; ++c) {
            for (int a = 0; a < nsource; ++a) { // powers of the deviation from the mean
                const double *z = look->z + source[a].first + c;
                const double unit = source[a].deviation > 0 ? source[a].deviation : 1;
                double mean = 0;
                for (int k = 0; k < look->count; ++k) {
                    mean += z[(ptrdiff_t)k * nz] / look->count;
                }
                for (int k = 0; k < look->count; ++k) {
                    for (int d = 0; d < degree; ++d) {
                        row_of(look, n + 1, k)[a * degree + d] =
                            pow((z[(ptrdiff_t)k * nz] - mean) / unit, d + 1);
                    }
                }
            }
            for (int k = 0; k < look->count; ++k) {
                row_of(look, n + 1, k)[n] = look->rate[(ptrdiff_t)k * nz + target->first + c];
            }
            centre(look, n + 1);
            for (int k = 0; k < look->count; ++k) {
                const double y = row_of(look, n + 1, k)[n];
                square += y * y;
            }
            if (pass == 0) {
                remove_inputs(look, basis, n + 1);
            }
            add_rows(look, &s);
        }
        if (basis->count == 0 || s.square > SMALLEST_REST * square) {
            break;
        }
    }
    const double rest = pm_least_squares_solve(&s, solution);
    for (int a = 0; a < nsource && coefficient != NULL; ++a) {
        coefficient[a] = solution[a] / (source[a].deviation > 0 ? source[a].deviation : 1);
    }
    return rest;
}

double pm_look_odd_part(const pm_look *look, const pm_parity *p, int target, int odd) {
    double mean[PM_MAX_LOOK_STATES], deviation[PM_MAX_LOOK_STATES], rest[2];
    const int nz = look->scene->physics.nz;
    if (nz > PM_MAX_LOOK_STATES) {
        return 0;
    }
    for (int c = 0; c < nz; ++c) {
        mean[c] = deviation[c] = 0;
        for (int k = 0; k < look->count; ++k) {
            mean[c] += look->z[(ptrdiff_t)k * nz + c] / look->count;
        }
        for (int k = 0; k < look->count; ++k) {
            const double x = look->z[(ptrdiff_t)k * nz + c] - mean[c];
            deviation[c] += x * x / look->count;
        }
        deviation[c] = deviation[c] > 0 ? sqrt(deviation[c]) : 1;
    }
    // The even variables, products of two odd ones, then of two even ones, as far as there is room;
    // and in the second pass the odd component and its products with even variables. Even variables
    // are centred, odd ones only scaled.
    int neven = p->neven + p->nodd * (p->nodd + 1) / 2 + p->neven * (p->neven + 1) / 2;
    neven = neven < EVEN_TERMS ? neven : EVEN_TERMS;
    for (int pass = 0; pass < 2; ++pass) {
        pm_least_squares s = {.n = neven + pass * (1 + p->neven)};
        double solution[PM_MAX_TERMS];
        for (int k = 0; k < look->count; ++k) {
            const double *z = look->z + (ptrdiff_t)k * nz;
            double *term = row_of(look, s.n + 1, k), even[PM_LOOK_SOURCES];
            int n = 0;
            for (int i = 0; i < p->neven; ++i) {
                even[i] = (z[p->even[i]] - mean[p->even[i]]) / deviation[p->even[i]];
                term[n++] = even[i];
            }
            for (int i = 0; i < p->nodd; ++i) {
                for (int j = i; j < p->nodd && n < neven; ++j) {
                    term[n++] =
                        z[p->odd[i]] / deviation[p->odd[i]] * z[p->odd[j]] / deviation[p->odd[j]];
                }
            }
            for (int i = 0; i < p->neven; ++i) {
                for (int j = i; j < p->neven && n < neven; ++j) {
                    term[n++] = even[i] * even[j];
                }
            }
            if (pass == 1) {
                const double x = z[odd] / deviation[odd];
                term[n++] = x;
                for (int i = 0; i < p->neven; ++i) {
                    term[n++] = x * even[i];
                }
            }
            term[n] = look->rate[(ptrdiff_t)k * nz + target];
        }
        centre(look, s.n + 1);
        remove_inputs(look, inputs_of(look, target), s.n + 1);
        add_rows(look, &s);
        rest[pass] = pm_least_squares_solve(&s, solution);
    }
    return rest[0] < SMALLEST_REST ? 0 : 1 - rest[1] / rest[0];
}

int pm_look_rank(const pm_look *look, int count, const pm_look_group *group) {
    int component[MOST_COMPONENTS], n = 0;
    for (int i = 0; i < count; ++i) {
        for (int c = 0; c < group[i].group->size; ++c, ++n) {
            component[n < MOST_COMPONENTS ? n : 0] = group[i].first + c;
        }
    }
    double product[MOST_COMPONENTS * MOST_COMPONENTS] = {0}, value[MOST_COMPONENTS];
    double vector[MOST_COMPONENTS * MOST_COMPONENTS], size[MOST_COMPONENTS];
    if (n > MOST_COMPONENTS || n == 0) {
        return n;
    }
    for (int k = 0; k < look->count; ++k) {
        for (int a = 0; a < n; ++a) {
            row_of(look, n, k)[a] =
                look->rate[(ptrdiff_t)k * look->scene->physics.nz + component[a]];
        }
    }
    const pm_input_basis *basis = inputs_of(look, component[0]);
    if (basis->count > 0) {
        centre(look, n);
        remove_inputs(look, basis, n);
    }
    for (int k = 0; k < look->count; ++k) {
        const double *rate = row_of(look, n, k);
        for (int a = 0; a < n * n; ++a) {
            product[a] += rate[a / n] * rate[a % n];
        }
    }
    for (int a = 0; a < n; ++a) {
        size[a] = product[a * n + a] > 0 ? sqrt(product[a * n + a]) : 1;
    }
    for (int a = 0; a < n * n; ++a) {
        product[a] /= size[a / n] * size[a % n];
    }
    if (!pm_eigen_largest(n, product, n, value, vector)) {
        return n;
    }
    int rank = 0;
    for (int a = 0; a < n; ++a) {
        rank += value[a] > INDEPENDENT * value[0];
    }
    return rank;
}

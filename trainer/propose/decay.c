// Regressions of all rates on the same terms share one factorised matrix.
#include "propose/decay.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"

#define MOST_TERMS 80
#define SIGNIFICANT 5 // standard errors
#define RIDGE 1e-10   // relative to the diagonal

typedef struct regression {
    const pm_look *look;
    int nterm;
    int ngroup; // vectors, whose lengths are terms
    int first[PM_MAX_LOOK_STATES], size[PM_MAX_LOOK_STATES];
    int ninput; // prescribed values of boundary inputs that are terms
    int input[MOST_TERMS];
    double mean[MOST_TERMS], deviation[MOST_TERMS]; // of the terms
    double *matrix;                                 // [nterm][nterm] its factor, then its inverse
    double *solution;                               // [nterm][nz]
    double *rest;                                   // [nz] mean squares of what is unexplained
    const char **unit;                              // [nz]
} regression;

// Writes the terms of one state: the components, their squares, the logarithms of lengths, and the
// boundary inputs.
static void write_terms(const regression *r, int k, double *term) {
    const int nz = r->look->scene->nz;
    const double *z = r->look->z + (ptrdiff_t)k * nz;
    for (int c = 0; c < nz; ++c) {
        term[c] = z[c];
        // Squares of deviations differ more from the components than squares of the components.
        term[nz + c] = (z[c] - r->mean[c]) * (z[c] - r->mean[c]);
    }
    for (int g = 0; g < r->ngroup; ++g) {
        double square = 0;
        for (int c = 0; c < r->size[g]; ++c) {
            square += z[r->first[g] + c] * z[r->first[g] + c];
        }
        term[2 * nz + g] = log(square + 1e-300);
    }
    const pm_inputs *inputs = r->look->inputs;
    for (int a = 0; a < r->ninput; ++a) {
        term[2 * nz + r->ngroup + a] = inputs->value[(ptrdiff_t)k * inputs->input.n + r->input[a]];
    }
}

// Computes the means and deviations of all terms; those of the squares need the means of the rest.
static void find_means(regression *r) {
    const int n = r->nterm;
    double term[MOST_TERMS];
    for (int pass = 0; pass < 3; ++pass) {
        double sum[MOST_TERMS] = {0};
        for (int k = 0; k < r->look->count; ++k) {
            write_terms(r, k, term);
            for (int a = 0; a < n; ++a) {
                const double x = term[a] - r->mean[a];
                sum[a] += (pass < 2 ? term[a] : x * x) / r->look->count;
            }
        }
        memcpy(pass < 2 ? r->mean : r->deviation, sum, (size_t)n * sizeof *sum);
    }
    for (int a = 0; a < n; ++a) {
        r->deviation[a] = r->deviation[a] > 0 ? sqrt(r->deviation[a]) : 1;
    }
}

static void write_scaled_terms(const regression *r, int k, double *term) {
    write_terms(r, k, term);
    for (int a = 0; a < r->nterm; ++a) {
        term[a] = (term[a] - r->mean[a]) / r->deviation[a];
    }
}

// Solves for the coefficients of all rates and replaces the matrix by its inverse.
static bool solve(regression *r) {
    const int n = r->nterm, nz = r->look->scene->nz;
    double term[MOST_TERMS];
    for (int k = 0; k < r->look->count; ++k) {
        const double *rate = r->look->rate + (ptrdiff_t)k * nz;
        write_scaled_terms(r, k, term);
        pm_gram_add(1, n, term, r->matrix);
        for (int a = 0; a < n; ++a) {
            for (int c = 0; c < nz; ++c) {
                r->solution[a * nz + c] += term[a] * rate[c];
            }
        }
    }
    for (int a = 0; a < n; ++a) {
        r->matrix[a * n + a] = r->matrix[a * n + a] * (1 + RIDGE) + 1e-300;
    }
    if (!pm_cholesky_factor(n, r->matrix)) {
        return false;
    }
    double inverse[MOST_TERMS * MOST_TERMS] = {0};
    for (int a = 0; a < n; ++a) {
        inverse[a * n + a] = 1;
    }
    pm_cholesky_back(n, r->matrix, nz, r->solution);
    pm_cholesky_back(n, r->matrix, n, inverse);
    memcpy(r->matrix, inverse, (size_t)n * (size_t)n * sizeof *inverse);
    return true;
}

// Computes what the regression leaves unexplained of each rate, apart from its mean.
static void find_rest(regression *r) {
    const int n = r->nterm, nz = r->look->scene->nz, count = r->look->count;
    double term[MOST_TERMS];
    for (int c = 0; c < nz; ++c) {
        double mean = 0;
        for (int k = 0; k < count; ++k) {
            mean += r->look->rate[(ptrdiff_t)k * nz + c] / count;
        }
        for (int k = 0; k < count; ++k) {
            double x = r->look->rate[(ptrdiff_t)k * nz + c] - mean;
            write_scaled_terms(r, k, term);
            for (int a = 0; a < n; ++a) {
                x -= r->solution[a * nz + c] * term[a];
            }
            r->rest[c] += x * x / count;
        }
    }
}

// Returns d rate_c/d z_d, or 0 if it may be 0.
static double derivative(const regression *r, int c, int d) {
    const int nz = r->look->scene->nz;
    const double x = r->solution[d * nz + c];
    const double error = sqrt(r->matrix[d * r->nterm + d] * r->rest[c]);
    return fabs(x) > SIGNIFICANT * error ? x / r->deviation[d] : 0;
}

static double fastest(const regression *r) {
    const int nz = r->look->scene->nz;
    double most = 0;
    for (int c = 0; c < nz; ++c) {
        double sum = 0;
        for (int d = 0; d < nz; ++d) {
            sum += strcmp(r->unit[c], r->unit[d]) == 0 ? fabs(derivative(r, c, d)) : 0;
        }
        most = derivative(r, c, c) < 0 ? fmax(most, sum) : most;
    }
    return most;
}

static void list_groups(regression *r) {
    const pm_scene *scene = r->look->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[i];
        for (int g = 0; g < s->layout.ngroup; ++g) {
            const pm_group *group = &s->layout.group[g];
            for (int c = 0; c < group->size; ++c) {
                r->unit[s->first + group->first + c] = group->unit;
            }
            if (group->size > 1) {
                r->first[r->ngroup] = s->first + group->first;
                r->size[r->ngroup++] = group->size;
            }
        }
    }
}

// Lists the boundary inputs that vary, as far as there is room for them.
static void list_inputs(regression *r) {
    const pm_inputs *inputs = r->look->inputs;
    const int before = 2 * r->look->scene->nz + r->ngroup;
    for (int i = 0; i < inputs->input.n; ++i) {
        const bool varies = inputs->input.column[i] != PM_BOUNDARY_INPUT_CONSTANT;
        if (varies && before + r->ninput < MOST_TERMS) {
            r->input[r->ninput++] = i;
        }
    }
}

double pm_look_decay(const pm_look *look) {
    const int nz = look->scene->nz;
    if (nz > PM_MAX_LOOK_STATES || 5 * nz > 2 * MOST_TERMS) { // each vector has two components
        return 0;
    }
    pm_arena arena = {0};
    regression r = {.look = look};
    r.unit = pm_arena_array(&arena, (size_t)nz, sizeof *r.unit);
    r.rest = pm_arena_array(&arena, (size_t)nz, sizeof *r.rest);
    r.solution = pm_arena_array(&arena, (size_t)(MOST_TERMS * nz), sizeof *r.solution);
    r.matrix = pm_arena_array(&arena, MOST_TERMS * MOST_TERMS, sizeof *r.matrix);
    double result = 0;
    if (r.unit != NULL && r.rest != NULL && r.solution != NULL && r.matrix != NULL) {
        list_groups(&r);
        list_inputs(&r);
        r.nterm = 2 * nz + r.ngroup + r.ninput;
        find_means(&r);
        if (solve(&r)) {
            find_rest(&r);
            result = fastest(&r);
        }
    }
    pm_arena_free(&arena);
    return result;
}

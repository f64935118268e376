// The least-squares problem of a learned material, and its solution.
#include "body/solid_fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

// What an error of each quantity may be, as a share of its size: their squares add up to the loss.
static const double tolerance[PM_SOLID_NSCORE] = {0.01, 0.03, 0.01, 0.03};
// The step of differences by weights, which are of order 1.
#define DIFFERENCE 1e-5
// The damping of the first iteration, and the largest with which a step is tried.
#define FIRST_DAMPING 1e-2
#define MOST_DAMPING 1e8
// The share of the sum of squares by which an iteration must reduce it for the fit to go on.
#define NO_PROGRESS 3e-3

// --- one trajectory ---

// A body with weights of its own. Variant 0 has the weights of the fit, variant 1 + k has active
// weight k changed by DIFFERENCE.
typedef struct variant {
    pm_params params;
    pm_solid_material material;
    pm_solid *solid;
    double heat;           // J, since the start
    double *force, *sigma; // [nnode][3], [nnode][6]
    double *row;           // [nrow] residuals at a time
} variant;

typedef struct problem {
    const pm_solid_fit_settings *settings;
    int nweight, nactive, nvariant;
    int *active;      // [nactive] the weights that change
    variant *variant; // [nvariant]
    double *gram;     // [nactive + 1][nactive + 1] of the residuals and their derivatives
    double *jacobian; // [nrow][nactive + 1]
    double *u;        // [nnode][3]
    double square[PM_SOLID_NSCORE]; // sums of squares of the shares
} problem;

// Fills the residuals of a variant but those of the displacement, which the caller has put into the
// first nfree rows as forces.
static void fill_rows(const pm_solid_data *data, variant *v, int i, int j,
                      const double size[PM_SOLID_NSCORE]) {
    const pm_field *field = data->field;
    const pm_solid_books *books = pm_solid_books_of(v->solid);
    double *row = v->row + pm_solid_nfree(v->solid);
    const double *z = pm_field_state(field, i, j) + data->stress;
    const double factor = 1 / (sqrt(size[PM_SOLID_STRESS]) * tolerance[PM_SOLID_STRESS]);
    pm_solid_stress(v->solid, v->sigma);
    for (int node = 0; node < field->nnode; ++node, z += field->nvariable) {
        for (int k = 0; k < 6; ++k) {
            *row++ = data->mesh.clamped[node] ? 0 : (v->sigma[6 * node + k] - z[k]) * factor;
        }
    }
    const double energy[2] = {books->stored, v->heat};
    for (int k = 0; k < 2; ++k) {
        const int which = PM_SOLID_STORED + k;
        *row++ = size[which] > 0 ? (energy[k] - pm_solid_data_energy(data, i, j, k)) /
                                       (sqrt(size[which]) * tolerance[which])
                                 : 0;
    }
}

static int rows_of(const pm_solid_data *data, int nfree) {
    return nfree + 6 * data->field->nnode + 2;
}

// Moves all variants to the displacements at time j and computes their residuals. Returns false if
// an element is turned inside out or the stiffness is not positive definite.
static bool follow(problem *p, const pm_solid_data *data, int i, int j,
                   const double size[PM_SOLID_NSCORE]) {
    const pm_field *field = data->field;
    pm_solid *first = p->variant[0].solid;
    const double *f = pm_field_force(field, i, j);
    const double unit = 1 / (sqrt(size[PM_SOLID_DISPLACEMENT]) * tolerance[PM_SOLID_DISPLACEMENT]);
    pm_solid_data_displacement(data, i, j, p->u);
    for (int k = 0; k < p->nvariant; ++k) {
        variant *v = &p->variant[k];
        if (!pm_solid_follow(v->solid, field->dt, p->u, v->force)) {
            return false;
        }
        v->heat += pm_solid_books_of(v->solid)->heat;
        fill_rows(data, v, i, j, size);
        for (int c = 0; c < pm_solid_nfree(v->solid); ++c) {
            const int at = pm_solid_free(v->solid)[c];
            v->row[c] = (v->force[at] - f[at]) * unit;
        }
    }
    if (!pm_solid_stiffen(first, field->dt)) {
        return false;
    }
    for (int k = 0; k < p->nvariant; ++k) {
        pm_solid_soften(first, 1, p->variant[k].row);
    }
    return true;
}

// Adds the squares of the shares at a time, and the products of all residuals and derivatives.
static void add_products(problem *p, int nfree, int nrow) {
    const double *row = p->variant[0].row;
    for (int r = 0; r < nrow; ++r) {
        const int which = r < nfree      ? PM_SOLID_DISPLACEMENT
                          : r < nrow - 2 ? PM_SOLID_STRESS
                                         : PM_SOLID_STORED + (r - (nrow - 2));
        const double share = row[r] * tolerance[which];
        p->square[which] += share * share;
    }
    if (p->nvariant == 1) {
        return;
    }
    const int n = p->nactive + 1;
    for (int r = 0; r < nrow; ++r) {
        for (int k = 0; k < p->nactive; ++k) {
            p->jacobian[r * n + k] = (p->variant[1 + k].row[r] - row[r]) / DIFFERENCE;
        }
        p->jacobian[r * n + p->nactive] = row[r];
    }
    pm_gram_add(nrow, n, p->jacobian, p->gram);
}

static void close_bodies(problem *p) {
    for (int k = 0; k < p->nvariant; ++k) {
        variant *v = &p->variant[k];
        pm_solid_close(v->solid);
        free(v->force);
        v->solid = NULL;
        v->force = NULL;
    }
    free(p->u);
    free(p->jacobian);
    p->u = p->jacobian = NULL;
}

static pm_status open_bodies(problem *p, const pm_solid_data *data) {
    const size_t nnode = (size_t)data->field->nnode, nrow = 9 * nnode + 2;
    for (int k = 0; k < p->nvariant; ++k) {
        variant *v = &p->variant[k];
        PM_TRY(pm_solid_open(&v->solid, &data->mesh, &v->material));
        v->force = calloc(9 * nnode + nrow, sizeof *v->force);
        if (v->force == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for the fit of a solid");
        }
        v->sigma = v->force + 3 * nnode;
        v->row = v->force + 9 * nnode;
    }
    p->u = calloc(3 * nnode, sizeof *p->u);
    p->jacobian = calloc(nrow * (size_t)(p->nactive + 1), sizeof *p->jacobian);
    return p->u == NULL || p->jacobian == NULL
               ? pm_fail(PM_ENOMEM, "out of memory for the fit of a solid")
               : PM_OK;
}

// Adds all trajectories of a field; *good becomes false if one cannot be followed.
static pm_status add_field(problem *p, const pm_solid_data *data, bool *good) {
    pm_status status;
    PM_TRY_DONE(open_bodies(p, data));
    const int nfree = pm_solid_nfree(p->variant[0].solid), nrow = rows_of(data, nfree);
    for (int k = 0; k < data->count && *good; ++k) {
        const int i = data->trajectory[k];
        double size[PM_SOLID_NSCORE];
        pm_solid_data_size(data, i, p->u, size);
        for (int v = 0; v < p->nvariant; ++v) {
            pm_solid_set_state(p->variant[v].solid, NULL, NULL);
            p->variant[v].heat = 0;
        }
        for (int j = 1; j < data->field->ntime && *good; ++j) {
            *good = follow(p, data, i, j, size);
            if (*good) {
                add_products(p, nfree, nrow);
            }
        }
    }
done:
    close_bodies(p);
    return status;
}

// --- the whole problem ---

// Computes the loss at the weights theta, with products if `derivatives`. It is INFINITY where a
// body cannot be followed.
static pm_status evaluate(problem *p, const double *theta, bool derivatives, double *loss) {
    const int n = p->nactive + 1;
    bool good = true;
    double *changed = malloc((size_t)p->nweight * sizeof *changed);
    if (changed == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the fit of a solid");
    }
    p->nvariant = derivatives ? n : 1;
    for (int k = 0; k < p->nvariant; ++k) {
        memcpy(changed, theta, (size_t)p->nweight * sizeof *theta);
        if (k > 0) {
            changed[p->active[k - 1]] += DIFFERENCE;
        }
        pm_params_scatter(&p->variant[k].params, changed);
        pm_solid_material_read(&p->settings->spec, &p->variant[k].params, &p->variant[k].material);
    }
    free(changed);
    memset(p->square, 0, sizeof p->square);
    if (derivatives) {
        memset(p->gram, 0, (size_t)(n * n) * sizeof *p->gram);
    }
    for (int d = 0; d < p->settings->ndata && good; ++d) {
        PM_TRY(add_field(p, &p->settings->data[d], &good));
    }
    *loss = 0;
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        *loss += p->square[k] / (tolerance[k] * tolerance[k]);
    }
    *loss = good && isfinite(*loss) ? *loss : INFINITY;
    return PM_OK;
}

// Returns the root mean squares of the shares over all trajectories.
static void score_of(const problem *p, double score[PM_SOLID_NSCORE]) {
    int count = 0;
    for (int d = 0; d < p->settings->ndata; ++d) {
        count += p->settings->data[d].count;
    }
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        score[k] = sqrt(p->square[k] / count);
    }
}

// Computes the next weights from the products and the damping, which is relative to the diagonal.
// Returns false if that fails.
static bool damped_step(const problem *p, double damping, const double *theta, double *next) {
    const int n = p->nactive;
    double *h = malloc((size_t)(n * n + n) * sizeof *h), most = 0;
    if (h == NULL) {
        return false;
    }
    for (int i = 0; i < n; ++i) {
        most = fmax(most, p->gram[i * (n + 1) + i]);
    }
    for (int i = 0; i < n; ++i) {
        memcpy(h + i * n, p->gram + i * (n + 1), (size_t)n * sizeof *h);
        // The second term keeps weights on which the data do not depend where they are.
        h[i * n + i] += damping * h[i * n + i] + 1e-10 * most + 1e-3;
        h[n * n + i] = -p->gram[i * (n + 1) + n];
    }
    const bool good = pm_cholesky_solve(n, h, h + n * n);
    memcpy(next, theta, (size_t)p->nweight * sizeof *next);
    for (int i = 0; i < n && good; ++i) {
        next[p->active[i]] += h[n * n + i];
    }
    free(h);
    return good;
}

static void tell(const problem *p, int iteration) {
    double score[PM_SOLID_NSCORE];
    score_of(p, score);
    if (p->settings->tell != NULL) {
        p->settings->tell(p->settings->context, iteration, score);
    }
}

// Minimises the loss by the active weights from theta, which becomes the best weights.
static pm_status minimise(problem *p, double *theta, double *next) {
    const size_t size = (size_t)p->nweight * sizeof *theta;
    double loss, damping = FIRST_DAMPING;
    PM_TRY(evaluate(p, theta, true, &loss));
    if (!isfinite(loss)) {
        return pm_fail(PM_ENUMERIC, "the fit of a solid cannot start: the first weights fail");
    }
    tell(p, 0);
    for (int k = 1; k <= p->settings->iterations; ++k) {
        double tried = INFINITY;
        for (; damping <= MOST_DAMPING; damping *= 10) {
            if (damped_step(p, damping, theta, next)) {
                PM_TRY(evaluate(p, next, false, &tried));
                if (tried < loss) {
                    break;
                }
            }
        }
        if (!(tried < loss)) {
            break;
        }
        memcpy(theta, next, size);
        const bool enough = tried > (1 - NO_PROGRESS) * loss;
        damping /= 30;
        tell(p, k);
        if (enough || (p->settings->stop != NULL && *p->settings->stop)) {
            break;
        }
        PM_TRY(evaluate(p, theta, true, &loss));
    }
    return evaluate(p, theta, false, &loss);
}

static pm_status open_problem(problem *p, double **theta) {
    const size_t n = (size_t)p->nweight + 1;
    p->variant = calloc(n, sizeof *p->variant);
    p->gram = calloc(n * n, sizeof *p->gram);
    p->active = calloc(n, sizeof *p->active);
    *theta = calloc(2 * n, sizeof **theta);
    return p->active == NULL || p->variant == NULL || p->gram == NULL || *theta == NULL
               ? pm_fail(PM_ENOMEM, "out of memory for the fit of a solid")
               : PM_OK;
}

// Makes all weights active, or only the first one of each group: stiffnesses and rates at rest.
static void activate(problem *p, const pm_params *params, bool all) {
    int at = 0;
    p->nactive = 0;
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        const bool at_rest = strstr(entry->name, "linear") || strstr(entry->name, "relaxation");
        for (int k = 0; k < entry->rows * entry->cols && entry->trained; ++k, ++at) {
            if (all || (at_rest && k == 0)) {
                p->active[p->nactive++] = at;
            }
        }
    }
}

// Copies the values of all entries of params.
static pm_status copy_params(const pm_params *from, const pm_solid_spec *spec, pm_params *to) {
    PM_TRY(pm_solid_material_declare(spec, to));
    for (int i = 0; i < from->count; ++i) {
        const pm_param_entry *entry = &from->entry[i];
        pm_param_entry *copy = pm_params_find(to, entry->name);
        if (copy != NULL) {
            memcpy(copy->value, entry->value,
                   (size_t)(entry->rows * entry->cols) * sizeof *copy->value);
        }
    }
    return PM_OK;
}

pm_status pm_solid_fit(const pm_solid_fit_settings *settings, pm_params *params,
                       double score[PM_SOLID_NSCORE]) {
    problem p = {.settings = settings, .nweight = (int)pm_params_trained(params)};
    double *theta = NULL;
    pm_status status;
    PM_TRY_DONE(open_problem(&p, &theta));
    for (int k = 0; k <= p.nweight; ++k) {
        PM_TRY_DONE(copy_params(params, &settings->spec, &p.variant[k].params));
    }
    pm_params_gather(params, theta);
    for (int all = 0; all < 2; ++all) {
        activate(&p, params, all);
        PM_TRY_DONE(minimise(&p, theta, theta + p.nweight));
    }
    pm_params_scatter(params, theta);
    score_of(&p, score);
done:
    for (int k = 0; k <= p.nweight && p.variant != NULL; ++k) {
        pm_params_free(&p.variant[k].params);
    }
    free(p.variant);
    free(p.gram);
    free(p.active);
    free(theta);
    return status;
}

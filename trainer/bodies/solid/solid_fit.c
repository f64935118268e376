// The least-squares problem of a learned material, and its solution.
#include "bodies/solid/solid_fit.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "optimise/levenberg_marquardt.h"

// What an error of each quantity may be, as a share of its size: their squares add up to the loss.
static const double tolerance[PM_SOLID_NSCORE] = {0.01, 0.03, 0.01, 0.03};
// The step of differences by weights, which are of order 1.
#define DIFFERENCE 1e-5
static const pm_damping damping_of_material = {
    .first = 1e-2, .largest = 1e8, .relax = 1 / 30.0, .stiffen = 10};
// What the diagonal gains besides the damping: a share of its largest entry, and a ridge that keeps
// weights on which the data do not depend where they are.
#define SMALLEST_CURVATURE 1e-10
#define RIDGE 1e-3
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

// Moves all variants to the displacements at time j and computes their residuals: those of the
// displacement, of the stress, and of both energies. Returns false if an element is turned inside
// out or the stiffness is not positive definite.
static bool follow(problem *p, const pm_solid_data *data, int i, int j,
                   const double size[PM_SOLID_NSCORE]) {
    const pm_field *field = data->field;
    pm_solid *first = p->variant[0].solid;
    const int nfree = pm_solid_nfree(first), *free = pm_solid_free(first);
    const double *f = pm_field_force(field, i, j);
    double unit[PM_SOLID_NSCORE];
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        unit[k] = 1 / (sqrt(size[k]) * tolerance[k]);
    }
    pm_solid_data_displacement(data, i, j, p->u);
    for (int k = 0; k < p->nvariant; ++k) {
        variant *v = &p->variant[k];
        const pm_solid_books *books = pm_solid_books_of(v->solid);
        const double *z = pm_field_state(field, i, j) + data->stress;
        double *row = v->row;
        if (!pm_solid_follow(v->solid, field->dt, p->u, v->force)) {
            return false;
        }
        v->heat += books->heat;
        for (int c = 0; c < nfree; ++c) {
            *row++ = (v->force[free[c]] - f[free[c]]) * unit[PM_SOLID_DISPLACEMENT];
        }
        pm_solid_stress(v->solid, v->sigma);
        for (int node = 0; node < field->nnode; ++node, z += field->nvariable) {
            for (int s = 0; s < 6; ++s) {
                const double off = v->sigma[6 * node + s] - z[s];
                *row++ = data->mesh.clamped[node] ? 0 : off * unit[PM_SOLID_STRESS];
            }
        }
        const double energy[2] = {books->stored, v->heat};
        for (int e = 0; e < 2; ++e) {
            const int which = PM_SOLID_STORED + e;
            const double off = energy[e] - pm_solid_data_energy(data, i, j, e);
            *row++ = size[which] > 0 ? off / (sqrt(size[which]) * tolerance[which]) : 0;
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

// Adds all trajectories of a field: the squares of the shares, and with several variants the
// products of all residuals and derivatives. *good becomes false if a trajectory cannot be
// followed.
static pm_status add_field(problem *p, const pm_solid_data *data, bool *good) {
    const size_t nnode = (size_t)data->field->nnode, most = 9 * nnode + 2;
    const int n = p->nactive + 1;
    pm_arena arena = {0};
    pm_status status;
    p->u = pm_arena_array(&arena, 3 * nnode, sizeof *p->u);
    p->jacobian = pm_arena_array(&arena, most * (size_t)n, sizeof *p->jacobian);
    for (int k = 0; k < p->nvariant; ++k) {
        variant *v = &p->variant[k];
        v->force = pm_arena_array(&arena, 3 * nnode, sizeof *v->force);
        v->sigma = pm_arena_array(&arena, 6 * nnode, sizeof *v->sigma);
        v->row = pm_arena_array(&arena, most, sizeof *v->row);
        PM_TRY_DONE(pm_solid_open(&v->solid, &data->mesh, &v->material));
    }
    PM_TRY_DONE(pm_arena_status(&arena, "the fit of a solid"));
    const double *row = p->variant[0].row;
    const int nfree = pm_solid_nfree(p->variant[0].solid);
    const int nrow = nfree + 6 * data->field->nnode + 2;
    for (int m = 0; m < data->count && *good; ++m) {
        const int i = data->trajectory[m];
        double size[PM_SOLID_NSCORE];
        pm_solid_data_size(data, i, p->u, size);
        for (int v = 0; v < p->nvariant; ++v) {
            pm_solid_set_state(p->variant[v].solid, NULL, NULL);
            p->variant[v].heat = 0;
        }
        for (int j = 1; j < data->field->ntime; ++j) {
            *good = follow(p, data, i, j, size);
            if (!*good) {
                break;
            }
            for (int r = 0; r < nrow; ++r) {
                const int which = r < nfree      ? PM_SOLID_DISPLACEMENT
                                  : r < nrow - 2 ? PM_SOLID_STRESS
                                                 : PM_SOLID_STORED + (r - (nrow - 2));
                const double share = row[r] * tolerance[which];
                p->square[which] += share * share;
            }
            for (int r = 0; r < nrow && p->nvariant > 1; ++r) {
                for (int k = 0; k < p->nactive; ++k) {
                    p->jacobian[r * n + k] = (p->variant[1 + k].row[r] - row[r]) / DIFFERENCE;
                }
                p->jacobian[r * n + p->nactive] = row[r];
            }
            if (p->nvariant > 1) {
                pm_gram_add(nrow, n, p->jacobian, p->gram);
            }
        }
    }
done:
    for (int k = 0; k < p->nvariant; ++k) {
        pm_solid_close(p->variant[k].solid);
        p->variant[k].solid = NULL;
    }
    pm_arena_free(&arena);
    return status;
}

// --- the whole problem ---

// Computes the loss at the weights theta, with products if `derivatives`. It is INFINITY where a
// body cannot be followed.
static pm_status evaluate(problem *p, const double *theta, bool derivatives, double *loss) {
    const int n = p->nactive + 1;
    bool good = true;
    double *changed = malloc((size_t)p->nweight * sizeof *changed);
    PM_TRY(changed != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for the fit of a solid"));
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

// The minimisation of the loss by the active weights.
typedef struct material_descent {
    problem *p;
    double *theta, *next; // [nweight]
    int iteration;
    double loss; // at theta
    bool over;
} material_descent;

// Computes the next weights from the products and the damping, which is relative to the diagonal.
// Returns false if that fails.
static bool solve(void *context, double damping) {
    const material_descent *d = context;
    const problem *p = d->p;
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
        h[i * n + i] += damping * h[i * n + i] + SMALLEST_CURVATURE * most + RIDGE;
        h[n * n + i] = -p->gram[i * (n + 1) + n];
    }
    const bool good = pm_cholesky_solve(n, h, h + n * n);
    memcpy(d->next, d->theta, (size_t)p->nweight * sizeof *d->next);
    for (int i = 0; i < n && good; ++i) {
        d->next[p->active[i]] += h[n * n + i];
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

static bool is_over(void *context) {
    const material_descent *d = context;
    return d->over || d->iteration >= d->p->settings->iterations;
}

static pm_status linearise(void *context, double *loss) {
    material_descent *d = context;
    PM_TRY(d->iteration == 0 ? PM_OK : evaluate(d->p, d->theta, true, &d->loss));
    *loss = d->loss;
    return PM_OK;
}

static pm_status try_step(void *context, double before, double *after, double *fraction) {
    const material_descent *d = context;
    PM_TRY(evaluate(d->p, d->next, false, after));
    *fraction = *after < before;
    return PM_OK;
}

static pm_status finish(void *context, double before, double after, bool moved) {
    material_descent *d = context;
    const pm_solid_fit_settings *settings = d->p->settings;
    d->over =
        !moved || after > (1 - NO_PROGRESS) * before || (settings->stop != NULL && *settings->stop);
    ++d->iteration;
    if (moved) {
        memcpy(d->theta, d->next, (size_t)d->p->nweight * sizeof *d->theta);
        tell(d->p, d->iteration);
    }
    return PM_OK;
}

// Minimises the loss by the active weights from theta, which becomes the best weights.
static pm_status minimise(problem *p, double *theta, double *next) {
    material_descent d = {.p = p, .theta = theta, .next = next};
    double damping = 0;
    PM_TRY(evaluate(p, theta, true, &d.loss));
    if (!isfinite(d.loss)) {
        return pm_fail(PM_ENUMERIC, "the fit of a solid cannot start: the first weights fail");
    }
    tell(p, 0);
    PM_TRY(pm_levenberg_marquardt(
        &(pm_levenberg_marquardt_problem){is_over, linearise, solve, try_step, finish, &d},
        &damping_of_material, &damping));
    return evaluate(p, theta, false, &d.loss);
}

pm_status pm_solid_fit(const pm_solid_fit_settings *settings, pm_params *params,
                       double score[PM_SOLID_NSCORE]) {
    problem p = {.settings = settings, .nweight = (int)pm_params_trained(params)};
    const size_t n = (size_t)p.nweight + 1;
    pm_arena arena = {0};
    double *theta;
    pm_status status;
    p.variant = pm_arena_array(&arena, n, sizeof *p.variant);
    p.gram = pm_arena_array(&arena, n * n, sizeof *p.gram);
    p.active = pm_arena_array(&arena, n, sizeof *p.active);
    theta = pm_arena_array(&arena, 2 * n, sizeof *theta);
    PM_TRY_DONE(pm_arena_status(&arena, "the fit of a solid"));
    for (int k = 0; k <= p.nweight; ++k) {
        pm_params *copy = &p.variant[k].params;
        PM_TRY_DONE(pm_solid_material_declare(&settings->spec, copy));
        for (int i = 0; i < params->count; ++i) {
            const pm_param_entry *entry = &params->entry[i];
            pm_param_entry *own = pm_params_find(copy, entry->name);
            if (own != NULL) {
                memcpy(own->value, entry->value,
                       (size_t)(entry->rows * entry->cols) * sizeof *own->value);
            }
        }
    }
    pm_params_gather(params, theta);
    for (int all = 0; all < 2; ++all) {
        // At first only the first weight of each group changes: stiffnesses and rates at rest.
        int at = 0;
        p.nactive = 0;
        for (int i = 0; i < params->count; ++i) {
            const pm_param_entry *entry = &params->entry[i];
            const bool at_rest = strstr(entry->name, "linear") || strstr(entry->name, "relaxation");
            for (int k = 0; k < entry->rows * entry->cols && entry->trained; ++k, ++at) {
                if (all || (at_rest && k == 0)) {
                    p.active[p.nactive++] = at;
                }
            }
        }
        PM_TRY_DONE(minimise(&p, theta, theta + p.nweight));
    }
    pm_params_scatter(params, theta);
    score_of(&p, score);
done:
    for (int k = 0; k <= p.nweight && p.variant != NULL; ++k) {
        pm_params_free(&p.variant[k].params);
    }
    pm_arena_free(&arena);
    return status;
}

// --- the constants and the first weights ---

// The largest and the mean squares of the strain and of the change of volume, the mean of the
// latter times the mean stress, and the mean stored energy.
typedef struct data_scale {
    double most_strain, most_volume, strain, volume; // no unit, squared
    double pressure;                                 // Pa
    double energy;                                   // J/m^3
    double step, whole; // s, the step and the length of the trajectories
} data_scale;

// Adds the states of a field to the scale, and counts them.
static pm_status find_scale(const pm_solid_data *data, data_scale *scale, double *count) {
    const pm_field *field = data->field;
    const pm_solid_mesh *mesh = &data->mesh;
    double *u = calloc(3 * (size_t)field->nnode, sizeof *u), body = 0;
    PM_TRY(pm_allocated(u, "the start of a fit"));
    for (int e = 0; e < data->mesh.nelement; ++e) {
        pm_brick brick;
        double x[3 * PM_BRICK_NODES];
        for (int k = 0; k < 3 * PM_BRICK_NODES; ++k) {
            x[k] = field->position[3 * data->mesh.brick[e * PM_BRICK_NODES + k / 3] + k % 3];
        }
        body += pm_brick_make(&brick, x) ? brick.volume : 0;
    }
    for (int k = 0; k < data->count * field->ntime; ++k) {
        const int i = data->trajectory[k / field->ntime], j = k % field->ntime;
        pm_solid_data_displacement(data, i, j, u);
        const double *sigma = pm_field_state(field, i, j) + data->stress;
        double strain = 0, volume = 0, pressure = 0;
        for (int e = 0; e < mesh->nelement; ++e) {
            pm_brick brick;
            double x[3 * PM_BRICK_NODES], w[3 * PM_BRICK_NODES], F[PM_BRICK_POINTS][9];
            double J = 0, mean = 0;
            for (int c = 0; c < 3 * PM_BRICK_NODES; ++c) {
                const int at = 3 * mesh->brick[e * PM_BRICK_NODES + c / 3] + c % 3;
                x[c] = mesh->position[at];
                w[c] = u[at];
                mean +=
                    sigma[(ptrdiff_t)(at / 3) * field->nvariable + at % 3] / (3 * PM_BRICK_NODES);
            }
            if (!pm_brick_make(&brick, x)) {
                continue;
            }
            pm_brick_deform(&brick, w, F);
            for (int p = 0; p < PM_BRICK_POINTS; ++p) {
                pm_solid_shape shape;
                memcpy(shape.F, F[p], sizeof F[p]);
                if (pm_solid_shape_make(&shape)) {
                    const double square = pm_sym_trace(shape.Cbar) - 3;
                    strain += square / (PM_BRICK_POINTS * mesh->nelement);
                    scale->most_strain = fmax(scale->most_strain, square);
                    J += brick.weight[p] * shape.J / brick.volume;
                }
            }
            volume += (J - 1) * (J - 1) / mesh->nelement;
            scale->most_volume = fmax(scale->most_volume, (J - 1) * (J - 1));
            pressure += (J - 1) * mean / mesh->nelement;
        }
        scale->strain += strain;
        scale->volume += volume;
        scale->pressure += pressure;
        // The stored energy; without energies, what a linear body stores under the forces.
        const double *f = pm_field_force(field, i, j);
        double work = 0;
        for (int n = 0; n < 3 * field->nnode; ++n) {
            work += f[n] * u[n] / 2;
        }
        const double stored = field->energy == NULL ? work : pm_solid_data_energy(data, i, j, 0);
        scale->energy += stored / fmax(body, DBL_MIN);
        *count += 1;
    }
    scale->step = field->dt;
    scale->whole = fmax(scale->whole, field->dt * (field->ntime - 1));
    free(u);
    return PM_OK;
}

// Sets the scales of the two inputs of a function.
static void set_scale(const pm_params *params, const char *name, double first, double second) {
    char full[64];
    snprintf(full, sizeof full, "%s.scale", name);
    double *scale = pm_params_find(params, full)->value;
    scale[0] = first > 0 ? first : 1;
    scale[1] = second > 0 ? second : 1;
}

pm_status pm_solid_fit_start(const pm_solid_fit_settings *settings, pm_params *params) {
    data_scale s = {0};
    double count = 0;
    for (int d = 0; d < settings->ndata; ++d) {
        PM_TRY(find_scale(&settings->data[d], &s, &count));
    }
    // The inputs of learned functions are at most 1 in the data.
    const double strain = s.most_strain, volume = s.most_volume;
    const double unit = s.energy > 0 ? s.energy / s.strain * strain : 1;
    const int n = settings->spec.nbranch;
    pm_params_find(params, "unit")->value[0] = unit;
    // The spring and the branches share the energy evenly. The stiffness of volume follows from the
    // mean stress, because little energy is in it.
    pm_params_find(params, "spring.linear")->value[0] = -log(n + 1.0);
    if (s.pressure > 0) {
        pm_params_find(params, "volume.linear")->value[0] =
            log(s.pressure / s.volume * volume / (2 * unit));
    }
    set_scale(params, "spring", strain, strain);
    set_scale(params, "volume", volume, volume * sqrt(volume));
    for (int b = 0; b < n; ++b) {
        char name[40];
        snprintf(name, sizeof name, "branch%d", b);
        set_scale(params, name, strain, strain * sqrt(strain));
        // The first relaxation times divide the range from a step to a trajectory evenly.
        snprintf(name, sizeof name, "branch%d.linear", b);
        pm_params_find(params, name)->value[0] = -log(n + 1.0);
        snprintf(name, sizeof name, "branch%d.relaxation", b);
        const double time = s.step * pow(s.whole / s.step, (b + 1.0) / (n + 1));
        pm_params_find(params, name)->value[0] = -log(time);
    }
    return PM_OK;
}

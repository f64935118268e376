// Tests for conserved angular momentum, by its balance along each trajectory: its change less the
// integrals of the moments that friction and boundary inputs exert.
#include "propose/rotation.h"

#include <math.h>
#include <string.h>

#include "propose/least_squares.h"

#define SAME 2e-3       // relative to |q||p|: the change below which q x p is conserved
#define MOST_MOMENTS 32 // terms of the balance

// The moment x x e of a vector e about a group x.
typedef struct moment {
    const pm_look_group *group; // x, of two or three components
    const pm_look_group *drag;  // e is this group; NULL: the co-energy of a boundary input
    int input[3];               // components of e among the values of all boundary inputs
} moment;

typedef struct balance {
    const pm_look *look;
    int npair;
    const pm_look_group *q, *p;
    int nmoment;
    moment moment[MOST_MOMENTS];
    double *input;    // [ntime][nprescribed] of one trajectory
    double *rate;     // [ntime][3 nmoment] of one trajectory, the moments
    double *integral; // [ntime][3 nmoment] of one trajectory
    pm_least_squares equations;
    double coefficient[MOST_MOMENTS];
    double change, size; // squares of what remains, and of |q||p|
} balance;

static void add_cross(const double a[3], const double b[3], double sum[3]) {
    for (int c = 0; c < 3; ++c) {
        sum[c] += a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3];
    }
}

static double square_of(const double a[3]) {
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
}

// Writes a group of one row of the dataset as a vector of three components.
static void take_vector(const pm_look *look, const double *row, const pm_look_group *group,
                        double vector[3]) {
    memset(vector, 0, 3 * sizeof *vector);
    for (int c = 0; c < group->group->size; ++c) {
        vector[c] = row[look->columns.column[group->first + c]];
    }
}

// Adds q x p of one state to J and returns |q||p|.
static double add_angular_momentum(const pm_look *look, const double *row, const pm_look_group *q,
                                   const pm_look_group *p, double J[3]) {
    double a[3], b[3];
    take_vector(look, row, q, a);
    take_vector(look, row, p, b);
    add_cross(a, b, J);
    return sqrt(square_of(a) * square_of(b));
}

// --- moments of boundary inputs ---

static void add_moment(balance *b, const pm_look_group *group, const pm_look_group *drag,
                       const int *input) {
    if (b->nmoment < MOST_MOMENTS) {
        moment *m = &b->moment[b->nmoment++];
        *m = (moment){.group = group, .drag = drag};
        for (int c = 0; c < group->group->size && drag == NULL; ++c) {
            m->input[c] = input[c];
        }
    }
}

// Finds the moments on a pair: friction, which is proportional to q x p, and those of boundary
// inputs that act on its subsystem and have as many components.
static void find_moments(balance *b, const pm_look_group *q, const pm_look_group *p) {
    int input[MOST_MOMENTS][3];
    const int count = pm_inputs_vectors(b->look->inputs, pm_look_subsystem(b->look, q->first),
                                        q->group->size, MOST_MOMENTS, input);
    add_moment(b, q, p, NULL);
    for (int k = 0; k < count; ++k) {
        add_moment(b, q, NULL, input[k]);
        add_moment(b, p, NULL, input[k]);
    }
}

// Integrates n functions over a trajectory of at least three states, exactly for polynomials of
// degree 3 (2 at the ends): each interval by the polynomial through the nearest states.
static void integrate(int ntime, double dt, int n, const double *rate, double *integral) {
    memset(integral, 0, (size_t)n * sizeof *integral);
    for (int j = 0; j + 1 < ntime; ++j) {
        for (int a = 0; a < n; ++a) {
            const double *f = rate + (ptrdiff_t)j * n + a;
            const double area = j == 0           ? 5 * f[0] + 8 * f[n] - f[2 * n]
                                : j + 2 == ntime ? 5 * f[n] + 8 * f[0] - f[-n]
                                                 : (13 * (f[0] + f[n]) - f[-n] - f[2 * n]) / 2;
            integral[(ptrdiff_t)(j + 1) * n + a] = integral[(ptrdiff_t)j * n + a] + dt * area / 12;
        }
    }
}

// Writes the vector e of a moment in one state.
static void take_drive(const balance *b, const moment *m, const double *row, const double *value,
                       double e[3]) {
    memset(e, 0, 3 * sizeof *e);
    if (m->drag != NULL) {
        take_vector(b->look, row, m->drag, e);
        return;
    }
    for (int c = 0; c < m->group->group->size; ++c) {
        e[c] = value[m->input[c]];
    }
}

static void integrate_moments(balance *b, int i) {
    const pm_dataset *d = b->look->dataset;
    const int nvalue = b->look->scene->nprescribed, n = 3 * b->nmoment;
    memset(b->rate, 0, (size_t)d->ntime * (size_t)n * sizeof *b->rate);
    for (int j = 0; j < d->ntime; ++j) {
        double *value = b->input + (ptrdiff_t)j * nvalue;
        pm_inputs_at(b->look->inputs, i, j, value);
        for (int m = 0; m < b->nmoment; ++m) {
            const double *row = pm_dataset_state(d, i, j);
            double x[3], e[3];
            take_vector(b->look, row, b->moment[m].group, x);
            take_drive(b, &b->moment[m], row, value, e);
            add_cross(x, e, b->rate + (ptrdiff_t)j * n + 3 * m);
        }
    }
    integrate(d->ntime, d->dt, n, b->rate, b->integral);
}

// --- the balance ---

// Adds the equation of one component in one state.
static void add_equation(balance *b, const double *integral, double change) {
    double x[MOST_MOMENTS];
    for (int m = 0; m < b->nmoment; ++m) {
        x[m] = integral[3 * m];
    }
    pm_least_squares_add(&b->equations, x, change);
}

// Goes through one trajectory: adds its equations, or with `measure` what the solution leaves.
static void follow(balance *b, int i, bool measure) {
    const pm_dataset *d = b->look->dataset;
    double first[3] = {0};
    if (b->nmoment > 0) {
        integrate_moments(b, i);
    }
    for (int j = 0; j < d->ntime; ++j) {
        double J[3] = {0};
        const double *integral = b->integral + (ptrdiff_t)j * 3 * b->nmoment;
        for (int k = 0; k < b->npair; ++k) {
            const double length =
                add_angular_momentum(b->look, pm_dataset_state(d, i, j), &b->q[k], &b->p[k], J);
            b->size += measure ? length * length : 0;
        }
        for (int c = 0; c < 3; ++c) {
            first[c] = j == 0 ? J[c] : first[c];
            double change = J[c] - first[c];
            for (int m = 0; m < b->nmoment && measure; ++m) {
                change -= b->coefficient[m] * integral[3 * m + c];
            }
            if (measure) {
                b->change += change * change;
            } else {
                add_equation(b, integral + c, change);
            }
        }
    }
}

// Computes the coefficients of the moments.
static void solve(balance *b) {
    b->equations = (pm_least_squares){.n = b->nmoment};
    for (int i = 0; i < b->look->dataset->ntrajectory; ++i) {
        follow(b, i, false);
    }
    (void)pm_least_squares_solve(&b->equations, b->coefficient);
}

// Returns true if the moments explain all changes.
static bool is_balanced(balance *b) {
    b->change = b->size = 0;
    if (b->nmoment > 0) {
        solve(b);
    }
    for (int i = 0; i < b->look->dataset->ntrajectory; ++i) {
        follow(b, i, true);
    }
    return b->size > 0 && b->change < SAME * SAME * b->size;
}

pm_rotation pm_look_rotation(const pm_look *look, int count, const pm_look_group *q,
                             const pm_look_group *p) {
    balance b = {.look = look, .npair = count, .q = q, .p = p};
    if (count == 0 || is_balanced(&b)) {
        return count == 0 ? PM_ROTATION_NONE : PM_ROTATION_CONSERVED;
    }
    for (int k = 0; k < count; ++k) {
        find_moments(&b, &q[k], &p[k]);
    }
    pm_arena arena = {0};
    const size_t ntime = (size_t)look->dataset->ntime, n = 3 * (size_t)b.nmoment;
    b.input = pm_arena_array(&arena, ntime * (size_t)look->scene->nprescribed, sizeof *b.input);
    b.rate = pm_arena_array(&arena, ntime * n, sizeof *b.rate);
    b.integral = pm_arena_array(&arena, ntime * n, sizeof *b.integral);
    const bool balanced =
        b.input != NULL && b.rate != NULL && b.integral != NULL && is_balanced(&b);
    pm_arena_free(&arena);
    return balanced ? PM_ROTATION_BALANCED : PM_ROTATION_NONE;
}

// Classifies the variables of a scene by their units and by linear regressions: conjugate pairs,
// what turns with an angular momentum, how energies depend on lengths, whether the dynamics depend
// on directions, and the couplings through ports.
#include "propose/view.h"

#include <math.h>
#include <string.h>

// Rules. Rates by central differences and noise leave some parts in a thousand of the variance of a
// rate unexplained; a true coupling explains more, a variable that merely correlates less.
#define EXACT 1e-3      // unexplained fraction of the variance below which a rate is a function
#define DEGREE 8        // of the polynomials that represent any function of one variable
#define TRACE 1e-4      // fraction that a coupling through a port must explain
#define CLEAR 0.05      // unexplained fraction up to which a coefficient is trusted
#define LOOSE 0.5       // likewise where only the ratio of two coefficients counts
#define NEAR_WHOLE 0.15 // largest distance of a trusted coefficient from a whole number
#define CARRIED 0.2     // of what is even in time leaves of the rate of an entropy, at least
#define UPRIGHT 0.02    // relative to |x||x'|: largest part of the rate along a turning x
#define TURNED 0.1      // of the variance of an angular velocity: what the momentum may leave
#define SAME 2e-3       // relative to |q||p|: the change below which q x p is conserved
#define MOVES 1e-9  // relative change over one step below which a variable is constant: rounding
#define CLEARLY 0.5 // what the better of two functions leaves unexplained over what the other does
#define RADIAL_DEGREE 4 // of the energy as a polynomial of a length, as for other energies

// Weights of the integral of a function over one interval, by the polynomial through the nearest
// three values (at the ends) or four: (5 f0 + 8 f1 - f2)/12 and (13 (f0 + f1) - f_1 - f2)/24.
#define FIRST 5
#define SECOND 8
#define INNER 13
#define WHOLE 12

// Room. Scenes with more than this leave the rest out of the regression.
#define MOST_SOURCES 8   // groups that explain a rate
#define OWN_SOURCES 6    // of them groups of the own subsystem, beside what a port adds
#define MOST_PAIRS 64    // conjugate pairs of vectors
#define MOST_MOMENTS 32  // terms of the balance of the angular momentum
#define MOST_SPINS 4     // scalars in it
#define MOST_ENTROPIES 4 // entropies on which the force along a length may depend
#define MOST_FORCES 16   // boundary inputs on which it may depend
#define TINY 1e-300      // keeps the logarithm of a zero length finite

static bool is_nonentropy(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY && v->kind[g] != PM_VIEW_HEAT;
}

bool pm_view_may_couple(const pm_part_view *v, int g) {
    return (v->kind[g] == PM_VIEW_OTHER || v->kind[g] == PM_VIEW_MOMENTUM ||
            (v->kind[g] == PM_VIEW_POSITION && (!v->apart[g] || v->shared[g]))) &&
           !v->group[g].constant;
}

static bool is_length(const pm_unit *unit) {
    bool only = unit->known;
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        only = only && (k == PM_UNIT_M || unit->power[k] == 0);
    }
    return only;
}

// Returns true if the product of two units is J s, that of a variable and its conjugate.
static bool makes_action(const pm_unit *a, const pm_unit *b) {
    const pm_unit action = pm_unit_parse("J s"), product = pm_unit_product(a, b);
    return pm_unit_equal(&product, &action);
}

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int c = 0; c < n; ++c) {
        sum += a[c] * b[c];
    }
    return sum;
}

// Return the state and the rate of a group in examined state k.
static const double *state_of(const pm_look *look, const pm_look_group *g, int k) {
    return look->z + (ptrdiff_t)k * look->scene->physics.nz + g->first;
}

static const double *rate_of(const pm_look *look, const pm_look_group *g, int k) {
    return look->rate + (ptrdiff_t)k * look->scene->physics.nz + g->first;
}

// --- sources of a rate ---

typedef struct sources {
    int count;
    pm_look_group group[MOST_SOURCES];
} sources;

static void add_source(sources *s, const pm_look_group *g, const pm_look_group *target) {
    for (int i = 0; i < s->count; ++i) {
        if (s->group[i].first == g->first) {
            return;
        }
    }
    if (s->count < MOST_SOURCES && g->group->size == target->group->size &&
        g->first != target->first) {
        s->group[s->count++] = *g;
    }
}

// Finds the groups with the unit `unit` in this subsystem and in those that share a port with it.
// The group `mate` of this subsystem comes first, unless it is -1.
static sources find_sources(const pm_look *look, const pm_part_view *parts, int part, int target,
                            int mate, const pm_unit *unit) {
    const pm_scene *scene = look->scene;
    sources s = {0};
    if (mate >= 0) {
        add_source(&s, &parts[part].group[mate], &parts[part].group[target]);
    }
    for (int pass = 0; pass < 2; ++pass) { // its own first
        for (int i = 0; i < scene->physics.nsubsystem; ++i) {
            bool near = i == part && pass == 0;
            for (int p = 0; p < scene->physics.nport && pass == 1; ++p) {
                const int *end = scene->physics.port[p].subsystem;
                near = near || (end[0] == part && end[1] == i) || (end[1] == part && end[0] == i);
            }
            for (int g = 0; g < parts[i].count && near; ++g) {
                if (pm_unit_equal(&parts[i].unit[g], unit)) {
                    add_source(&s, &parts[i].group[g], &parts[part].group[target]);
                }
            }
        }
    }
    return s;
}

// Returns the unexplained fraction of a regression of the rate of `target` on the sources, and
// writes a coefficient for each.
static double explain(const pm_look *look, const pm_look_group *target, const sources *s,
                      double coefficient[MOST_SOURCES]) {
    return pm_regress_rate(look, target, s->count, s->group, 1, coefficient);
}

// --- directions and quaternions ---

// Returns the position of part `i` of a quaternion, whose scalar part is part 0.
static int place_of(pm_quaternion order, int part) {
    return !order.scalar_last ? part : (part + 3) % 4;
}

int pm_quaternion_term(pm_quaternion order, int row, int axis, int *column) {
    const int part = order.scalar_last ? (row + 1) % 4 : row;
    if (part == 0) { // q0' = -(q1 w1 + q2 w2 + q3 w3)/2
        *column = place_of(order, 1 + axis);
        return -1;
    }
    if (part - 1 == axis) {
        *column = place_of(order, 0);
        return 1;
    }
    // The product of vectors is q x w from the body, and w x q from outside.
    const int other = 3 - (part - 1) - axis;
    const bool ascends = (other + 1) % 3 == axis;
    *column = place_of(order, 1 + other);
    return ascends ? order.turns : -order.turns;
}

// Computes w [3] of one state, for the rate `rate` [4] of q [4].
static void velocity_of(pm_quaternion order, const double *q, const double *rate, double *w) {
    const double square = dot(4, q, q);
    for (int axis = 0; axis < 3; ++axis) {
        w[axis] = 0;
        for (int row = 0; row < 4; ++row) {
            int column;
            const int sign = pm_quaternion_term(order, row, axis, &column);
            w[axis] += 2 * sign * q[column] * rate[row] / square;
        }
    }
}

// Returns the fraction of the variance of the angular velocity w that a linear function of the
// angular momentum leaves, both as the body sees them; 1 if they point in opposite directions.
static double leave_turning(const pm_look *look, pm_quaternion order, const pm_look_group *target,
                            const pm_look_group *spin) {
    enum { TERMS = 4 }; // three components and a constant
    const pm_quaternion body = {1, order.scalar_last};
    pm_least_squares sums[3] = {{.n = TERMS}, {.n = TERMS}, {.n = TERMS}};
    double mean[3] = {0}, along = 0, rest = 0, all = 0;
    for (int k = 0; k < look->count; ++k) {
        const double *q = state_of(look, target, k), *m = state_of(look, spin, k);
        double w[3], seen[3], rate[4] = {0};
        velocity_of(body, q, rate_of(look, target, k), w);
        // If the momentum is seen from outside, the rate that it would cause as an angular velocity
        // is also caused by its components in the body.
        for (int row = 0; row < 4; ++row) {
            for (int axis = 0; axis < 3; ++axis) {
                int column;
                const int sign = pm_quaternion_term(order, row, axis, &column);
                rate[row] += sign * q[column] * m[axis] / 2;
            }
        }
        velocity_of(body, q, rate, seen);
        const double term[TERMS] = {seen[0], seen[1], seen[2], spin->deviation};
        for (int c = 0; c < 3; ++c) {
            pm_least_squares_add(&sums[c], term, w[c]);
            mean[c] += w[c] / look->count;
            along += w[c] * seen[c];
        }
    }
    for (int c = 0; c < 3; ++c) {
        double solution[TERMS];
        const double square = sums[c].square;
        rest += square * pm_least_squares_solve(&sums[c], solution);
        all += square - look->count * mean[c] * mean[c];
    }
    return all > 0 && along > 0 ? rest / all : 1;
}

// Examines whether group g, a vector of three components or a quaternion, keeps its length and
// turns with the angular momentum `spin`. Returns 1 if its rate is that seen from the body, -1 if
// it is that seen from outside, for an angular velocity w that points along `spin` in the mean: for
// a vector x its rate is x x w or w x x. Returns 0 otherwise.
static int turns_with(const pm_look *look, pm_part_view *v, int g, const pm_look_group *spin) {
    const pm_look_group *target = &v->group[g];
    const int n = target->group->size;
    double along = 0, size = 0, turn = 0, least = TURNED;
    for (int k = 0; k < look->count; ++k) {
        const double *x = state_of(look, target, k), *rate = rate_of(look, target, k);
        const double *m = state_of(look, spin, k), product = dot(n, x, rate);
        along += product * product;
        size += dot(n, x, x) * dot(n, rate, rate);
        for (int c = 0; c < 3 && n == 3; ++c) {
            const int d = (c + 1) % 3, e = (c + 2) % 3;
            turn += rate[c] * (x[d] * m[e] - x[e] * m[d]);
        }
    }
    const bool keeps_length = along < UPRIGHT * UPRIGHT * size;
    if (n == 3) {
        return !keeps_length ? 0 : turn > 0 ? 1 : -1;
    }
    v->quaternion[g] = (pm_quaternion){0};
    for (int k = 0; k < 4 && keeps_length; ++k) {
        const pm_quaternion order = {k % 2 == 0 ? 1 : -1, k / 2 == 1};
        const double rest = leave_turning(look, order, target, spin);
        if (rest < least) {
            least = rest;
            v->quaternion[g] = order;
        }
    }
    return v->quaternion[g].turns;
}

static bool is_spin(const pm_part_view *v, int g) {
    const pm_unit action = pm_unit_parse("J s");
    return v->group[g].group->size == 3 && pm_unit_equal(&v->unit[g], &action);
}

// --- energies of lengths ---

// A regression of the virial p' . q = -|q| dE/d|q|, with E a polynomial of |q| or ln|q|.
// Friction and boundary inputs may contribute to the force.
static double leave_virial(const pm_look *look, const pm_part_view *v, int g, bool logarithm) {
    const pm_look_group *q = &v->group[g], *p = &v->group[v->mate[g]];
    const int size = q->group->size, nprescribed = look->scene->physics.nprescribed;
    const pm_look_group *entropy[MOST_ENTROPIES];
    int nentropy = 0, force[MOST_FORCES][3];
    const int nforce = pm_look_inputs(look, q->first, size, MOST_FORCES, force);
    for (int k = 0; k < v->count && nentropy < MOST_ENTROPIES; ++k) {
        if (v->kind[k] == PM_VIEW_ENTROPY) {
            entropy[nentropy++] = &v->group[k]; // the first component
        }
    }
    double mean = 0, square = 0, deviation = 1;
    pm_least_squares s = {0};
    for (int pass = 0; pass < 3; ++pass) { // mean, deviation, equations
        for (int k = 0; k < look->count; ++k) {
            const double *at = state_of(look, q, k), length = dot(size, at, at);
            const double argument = logarithm ? 0.5 * log(length + TINY) : sqrt(length);
            if (pass == 0) {
                mean += argument / look->count;
                continue;
            }
            const double x = (argument - mean) / deviation;
            if (pass == 1) {
                square += x * x / look->count;
                continue;
            }
            double term[PM_MAX_TERMS], slope = logarithm ? 1 : sqrt(length); // |q| dx/d|q|
            int n = 0;
            for (int degree = 0; degree < RADIAL_DEGREE; ++degree) {
                term[n++] = slope;
                for (int i = 0; i < nentropy && degree < 2; ++i) {
                    term[n++] = slope * *state_of(look, entropy[i], k);
                }
                slope *= x;
            }
            term[n++] = dot(size, state_of(look, p, k), at);
            for (int i = 0; i < nforce; ++i) {
                const double *value = look->input + (ptrdiff_t)k * nprescribed;
                term[n] = 0;
                for (int c = 0; c < size; ++c) {
                    term[n] += value[force[i][c]] * at[c];
                }
                ++n;
            }
            s.n = n;
            pm_least_squares_add(&s, term, dot(size, rate_of(look, p, k), at));
        }
        deviation = square > 0 ? sqrt(square) : 1;
    }
    double solution[PM_MAX_TERMS];
    return pm_least_squares_solve(&s, solution);
}

// --- conjugate pairs ---

// Regression of the rate of a group on its mate and on groups of neighbours with the same unit as
// the mate. Returns the unexplained fraction; *own is the coefficient of the mate.
static double explain_by_mate(const pm_look *look, const pm_part_view *parts, int part, int g,
                              int mate, double *own) {
    double coefficient[MOST_SOURCES] = {0};
    const sources s = find_sources(look, parts, part, g, mate, &parts[part].unit[mate]);
    const double rest = explain(look, &parts[part].group[g], &s, coefficient);
    *own = coefficient[0];
    return rest;
}

// Returns the unexplained fraction where the rate is a sum of functions of one source each.
static double explain_apart(const pm_look *look, const pm_look_group *target, const sources *s) {
    const int degree = s->count * DEGREE > PM_LOOK_SOURCES ? PM_LOOK_SOURCES / s->count : DEGREE;
    return pm_regress_rate(look, target, s->count, s->group, degree, NULL);
}

// A conjugate pair. Its position is the variable whose rate the other one explains better.
typedef struct pairing {
    int position, momentum;
    double rest, own; // unexplained fraction; coefficient of the mate
} pairing;

// Chooses, among several possible conjugate pairs, those whose variables explain each other best.
static void find_pairs(const pm_look *look, pm_part_view *parts, int part) {
    pm_part_view *v = &parts[part];
    for (;;) {
        pairing best = {.rest = INFINITY};
        for (int a = 0; a < v->count; ++a) {
            for (int b = a + 1; b < v->count; ++b) {
                const bool may = v->kind[a] != PM_VIEW_SPIN && v->kind[b] != PM_VIEW_SPIN &&
                                 v->mate[a] < 0 && v->mate[b] < 0 && is_nonentropy(v, a) &&
                                 is_nonentropy(v, b) &&
                                 v->group[a].group->size == v->group[b].group->size &&
                                 makes_action(&v->unit[a], &v->unit[b]);
                if (!may) {
                    continue;
                }
                // If only one of the two is a length or an angle, it is the position. Otherwise the
                // position is the one whose rate the other explains better. The unit comes first
                // because velocities of coupled bodies also depend on positions.
                double of_a, of_b;
                const double rest_a = explain_by_mate(look, parts, part, a, b, &of_a);
                const double rest_b = explain_by_mate(look, parts, part, b, a, &of_b);
                const bool length_a = is_length(&v->unit[a]), length_b = is_length(&v->unit[b]);
                const bool first = length_a != length_b ? length_a : rest_a <= rest_b;
                const pairing pair =
                    first ? (pairing){a, b, rest_a, of_a} : (pairing){b, a, rest_b, of_b};
                best = pair.rest < best.rest ? pair : best;
            }
        }
        if (isinf(best.rest)) {
            break;
        }
        const int position = best.position, momentum = best.momentum;
        v->mate[position] = momentum;
        v->mate[momentum] = position;
        v->kind[position] = PM_VIEW_POSITION;
        v->kind[momentum] = PM_VIEW_MOMENTUM;
        v->sign[position] = best.own < 0 ? -1 : 1;
        const sources all = find_sources(look, parts, part, position, momentum, &v->unit[momentum]);
        sources own = {.count = 0}; // without other momenta of this subsystem
        for (int k = 0; k < all.count; ++k) {
            const int first = all.group[k].first;
            const bool other =
                first >= v->group[0].first &&
                first < v->group[0].first + look->scene->physics.subsystem[part].layout.nz && k > 0;
            if (!other) {
                own.group[own.count++] = all.group[k];
            }
        }
        const double rest = explain_apart(look, &v->group[position], &all);
        v->linear[position] = best.rest < EXACT && rest > CLEARLY * best.rest;
        v->apart[position] = best.rest < EXACT || rest < EXACT;
        v->shared[position] = own.count < all.count &&
                              rest < CLEARLY * explain_apart(look, &v->group[position], &own);
    }
    for (int a = 0; a < v->count; ++a) {
        if (v->mate[a] < 0 && is_spin(v, a) && v->kind[a] != PM_VIEW_SPIN) {
            v->kind[a] = PM_VIEW_SPIN;
            v->sign[a] = 1;
        }
    }
}

// --- conserved angular momentum ---

// The moment x x e of a vector e about a group x.
typedef struct moment {
    const pm_look_group *group; // x, of two or three components
    const pm_look_group *drag;  // e is this group; NULL: the co-energy of a boundary input
    int force[3];               // components of e among the values of all boundary inputs
} moment;

// The balance of the angular momentum along each trajectory: its change less the integrals of the
// moments that friction and boundary inputs exert. Friction changes q x p at a rate that is
// proportional to it. A boundary input of as many components whose co-energy is e, such as a force
// or the velocity of a pivot, changes it at the rate a q x e + b p x e. The numbers a and b of each
// input and the factor of the friction of each pair come from a regression.
typedef struct balance {
    const pm_look *look;
    int npair;
    pm_look_group q[MOST_PAIRS], p[MOST_PAIRS];
    double size[MOST_PAIRS];     // of the product of their units, in SI units
    int nspin, spin[MOST_SPINS]; // scalars whose changes may make up for those of the sum, as the
                                 // spin of a planet does: positions in the state of the scene
    int nmoment;
    moment moment[MOST_MOMENTS];
    double *value;    // [nprescribed] of one state
    double *rate;     // [ntime][3 nmoment] of one trajectory, the moments
    double *integral; // [ntime][3 nmoment] of one trajectory
    double coefficient[MOST_MOMENTS + MOST_SPINS];
} balance;

static void add_cross(const double a[3], const double b[3], double sum[3]) {
    for (int c = 0; c < 3; ++c) {
        sum[c] += a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3];
    }
}

// Writes a group of one row of the dataset as a vector of three components.
static void take_vector(const pm_look *look, const double *row, const pm_look_group *group,
                        double vector[3]) {
    memset(vector, 0, 3 * sizeof *vector);
    for (int c = 0; c < group->group->size; ++c) {
        vector[c] = row[look->columns.column[group->first + c]];
    }
}

// Integrates the moments over trajectory i, exactly for polynomials of degree 3 (2 at the ends):
// each interval by the polynomial through the nearest states.
static void integrate_moments(balance *b, int i) {
    const pm_dataset *d = b->look->dataset;
    const int n = 3 * b->nmoment, length = pm_dataset_length(d, i);
    memset(b->rate, 0, (size_t)d->ntime * (size_t)n * sizeof *b->rate);
    if (b->look->scene->physics.nprescribed > 0) {
        pm_boundary_input_follow(b->look->source, d, i);
    }
    for (int j = 0; j < length; ++j) {
        const double *row = pm_dataset_state(d, i, j);
        if (b->look->scene->physics.nprescribed > 0) {
            pm_boundary_input_at(b->look->source, j, 0, b->value);
        }
        for (int m = 0; m < b->nmoment; ++m) {
            const moment *own = &b->moment[m];
            double x[3], e[3] = {0};
            take_vector(b->look, row, own->group, x);
            if (own->drag != NULL) {
                take_vector(b->look, row, own->drag, e);
            }
            for (int c = 0; c < own->group->group->size && own->drag == NULL; ++c) {
                e[c] = b->value[own->force[c]];
            }
            add_cross(x, e, b->rate + (ptrdiff_t)j * n + 3 * m);
        }
    }
    memset(b->integral, 0, (size_t)n * sizeof *b->integral);
    for (int j = 0; j + 1 < length; ++j) {
        for (int a = 0; a < n; ++a) {
            const double *f = b->rate + (ptrdiff_t)j * n + a;
            const double area = j == 0            ? FIRST * f[0] + SECOND * f[n] - f[2 * n]
                                : j + 2 == length ? FIRST * f[n] + SECOND * f[0] - f[-n]
                                                  : (INNER * (f[0] + f[n]) - f[-n] - f[2 * n]) / 2;
            b->integral[(ptrdiff_t)(j + 1) * n + a] =
                b->integral[(ptrdiff_t)j * n + a] + d->dt * area / WHOLE;
        }
    }
}

// Returns true if the moments explain all changes of the angular momentum.
static bool is_balanced(balance *b) {
    const pm_dataset *d = b->look->dataset;
    pm_least_squares equations = {.n = b->nmoment + b->nspin};
    double rest = 0, size = 0; // squares of what remains, and of |q||p|
    for (int pass = equations.n > 0 ? 0 : 1; pass < 2; ++pass) { // the coefficients, then the rest
        for (int i = 0; i < d->ntrajectory; ++i) {
            const double *start = pm_dataset_state(d, i, 0);
            double first[3] = {0};
            if (b->nmoment > 0) {
                integrate_moments(b, i);
            }
            for (int j = 0; j < pm_dataset_length(d, i); ++j) {
                const double *row = pm_dataset_state(d, i, j);
                double J[3] = {0};
                for (int k = 0; k < b->npair; ++k) {
                    double q[3], p[3];
                    take_vector(b->look, row, &b->q[k], q);
                    take_vector(b->look, row, &b->p[k], p);
                    for (int c = 0; c < 3; ++c) {
                        q[c] *= b->size[k];
                    }
                    add_cross(q, p, J);
                    size += pass == 1 ? dot(3, q, q) * dot(3, p, p) : 0;
                }
                for (int c = 0; c < 3; ++c) {
                    double x[MOST_MOMENTS + MOST_SPINS];
                    first[c] = j == 0 ? J[c] : first[c];
                    double change = J[c] - first[c];
                    for (int m = 0; m < equations.n; ++m) {
                        const int at =
                            m < b->nmoment ? 0 : b->look->columns.column[b->spin[m - b->nmoment]];
                        x[m] = m < b->nmoment ? b->integral[((ptrdiff_t)j * b->nmoment + m) * 3 + c]
                               : c == 2       ? row[at] - start[at]
                                              : 0;
                        change -= pass == 1 ? b->coefficient[m] * x[m] : 0;
                    }
                    if (pass == 0) {
                        pm_least_squares_add(&equations, x, change);
                    }
                    rest += pass == 1 ? change * change : 0;
                }
            }
        }
        if (pass == 0) {
            (void)pm_least_squares_solve(&equations, b->coefficient);
        }
    }
    return size > 0 && rest < SAME * SAME * size;
}

static void add_moment(balance *b, const pm_look_group *group, const pm_look_group *drag,
                       const int *force) {
    if (b->nmoment < MOST_MOMENTS) {
        moment *m = &b->moment[b->nmoment++];
        *m = (moment){.group = group, .drag = drag};
        for (int c = 0; c < group->group->size && drag == NULL; ++c) {
            m->force[c] = force[c];
        }
    }
}

static pm_rotation find_rotation(const pm_look *look, const pm_part_view *parts) {
    balance b = {.look = look};
    for (int i = 0; i < look->scene->physics.nsubsystem; ++i) {
        const pm_part_view *v = &parts[i];
        for (int g = 0; g < v->count && b.npair < MOST_PAIRS; ++g) {
            const int size = v->group[g].group->size;
            if (v->kind[g] == PM_VIEW_POSITION && (size == 2 || size == 3)) {
                b.q[b.npair] = v->group[g];
                b.size[b.npair] = v->unit[g].factor * v->unit[v->mate[g]].factor;
                b.p[b.npair++] = v->group[v->mate[g]];
            }
            if (v->kind[g] == PM_VIEW_OTHER && size == 1 && b.nspin < MOST_SPINS) {
                b.spin[b.nspin++] = v->group[g].first;
            }
        }
    }
    if (b.npair == 0 || is_balanced(&b)) {
        return b.npair == 0 ? PM_ROTATION_NONE : PM_ROTATION_CONSERVED;
    }
    // Friction on each pair, and every boundary input on its subsystem that has as many components
    // as the pair.
    for (int k = 0; k < b.npair; ++k) {
        int force[MOST_MOMENTS][3];
        const int count =
            pm_look_inputs(look, b.q[k].first, b.q[k].group->size, MOST_MOMENTS, force);
        add_moment(&b, &b.q[k], &b.p[k], NULL);
        for (int f = 0; f < count; ++f) {
            add_moment(&b, &b.q[k], NULL, force[f]);
            add_moment(&b, &b.p[k], NULL, force[f]);
        }
    }
    pm_arena arena = {0};
    const size_t ntime = (size_t)look->dataset->ntime, n = 3 * (size_t)b.nmoment;
    b.value = pm_arena_array(&arena, (size_t)look->scene->physics.nprescribed, sizeof *b.value);
    b.rate = pm_arena_array(&arena, ntime * n, sizeof *b.rate);
    b.integral = pm_arena_array(&arena, ntime * n, sizeof *b.integral);
    const bool balanced = !arena.failed && is_balanced(&b);
    pm_arena_free(&arena);
    return balanced ? PM_ROTATION_BALANCED : PM_ROTATION_NONE;
}

// --- parts ---

// Computes the statistics of group number `group` of a subsystem.
static pm_look_group look_at(const pm_look *look, int subsystem, int group) {
    const pm_scene_subsystem *s = &look->scene->physics.subsystem[subsystem];
    pm_look_group g = {.group = &s->layout.group[group],
                       .first = s->first + s->layout.group[group].first,
                       .positive = true,
                       .shortest = INFINITY};
    const int nz = look->scene->physics.nz, size = g.group->size;
    double square = 0, rate = 0, largest = 0;
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
        g.shortest = fmin(g.shortest, length);
    }
    return g;
}

pm_rotation pm_view_parts(const pm_look *look, pm_part_view *view) {
    const int n = look->scene->physics.nsubsystem;
    const pm_unit energy = pm_unit_parse("J"), temperature = pm_unit_parse("K"),
                  number = pm_unit_parse("");
    for (int i = 0; i < n; ++i) {
        const pm_layout *layout = &look->scene->physics.subsystem[i].layout;
        pm_part_view *v = &view[i];
        *v = (pm_part_view){.subsystem = i, .count = layout->ngroup};
        for (int g = 0; g < v->count; ++g) {
            v->group[g] = look_at(look, i, g);
            v->unit[g] = pm_unit_parse(layout->group[g].unit);
            v->odd[g] = pm_view_is_odd(&v->unit[g]);
            v->angle[g] = pm_unit_equal(&v->unit[g], &number) && v->unit[g].angle;
            v->mate[g] = -1;
            if (layout->group[g].role == PM_ROLE_ENTROPY) {
                v->kind[g] = PM_VIEW_ENTROPY;
                v->nentropy += layout->group[g].size;
            }
        }
        for (int g = 0; g < v->count && v->nentropy == 0; ++g) {
            if (pm_unit_equal(&v->unit[g], &energy) || pm_unit_equal(&v->unit[g], &temperature)) {
                v->kind[g] = PM_VIEW_HEAT;
            }
        }
    }
    for (int i = 0; i < n; ++i) {
        // Vectors and quaternions that turn with an angular momentum of the same subsystem, such as
        // the direction of gravity as a top sees it. Friction does not act on them.
        pm_part_view *v = &view[i];
        for (int g = 0; g < v->count; ++g) {
            const int size = v->group[g].group->size;
            const bool may =
                (size == 3 || size == 4) && !is_spin(v, g) && is_nonentropy(v, g) && v->mate[g] < 0;
            for (int m = 0; m < v->count && may && !v->group[g].constant; ++m) {
                const int turns = is_spin(v, m) ? turns_with(look, v, g, &v->group[m]) : 0;
                if (turns != 0) {
                    v->kind[g] = PM_VIEW_DIRECTION;
                    v->kind[m] = PM_VIEW_SPIN;
                    v->mate[g] = m;
                    v->sign[g] = v->sign[m] = turns;
                }
            }
        }
        find_pairs(look, view, i);
    }
    for (int i = 0; i < n; ++i) {
        pm_part_view *v = &view[i];
        // Friction does not act on lengths and angles with a conjugate variable, nor on those whose
        // rate is proportional to another variable. Volumes may leak.
        for (int g = 0; g < v->count; ++g) {
            const bool length = is_length(&v->unit[g]) && v->unit[g].power[PM_UNIT_M] < 2;
            v->geometric[g] =
                v->kind[g] == PM_VIEW_DIRECTION || (length && v->kind[g] == PM_VIEW_POSITION);
            for (int k = 0; k < n && length && v->mate[g] < 0; ++k) {
                for (int h = 0; h < view[k].count && !v->geometric[g]; ++h) {
                    double coefficient[MOST_SOURCES];
                    const sources s = find_sources(look, view, i, g, -1, &view[k].unit[h]);
                    v->geometric[g] = is_nonentropy(&view[k], h) && !is_length(&view[k].unit[h]) &&
                                      s.count > 0 &&
                                      explain(look, &v->group[g], &s, coefficient) < EXACT;
                }
            }
        }
        for (int g = 0; g < v->count; ++g) {
            const int size = v->group[g].group->size;
            v->by_length[g] =
                v->kind[g] == PM_VIEW_POSITION && (size == 2 || size == 3) &&
                leave_virial(look, v, g, false) < CLEARLY * leave_virial(look, v, g, true);
        }
    }
    return find_rotation(look, view);
}

// --- ports ---

// Returns how much more of the rate of `target` is explained when `source` is added to the
// variables of its own subsystem. Writes the coefficient of `source` and the fraction that stays
// unexplained.
static double gain(const pm_look *look, const pm_part_view *own, int target,
                   const pm_look_group *source, double *coefficient, double *rest) {
    sources s = {0};
    double value[MOST_SOURCES] = {0};
    if (own->mate[target] >= 0) {
        add_source(&s, &own->group[own->mate[target]], &own->group[target]);
    }
    for (int g = 0; g < own->count; ++g) {
        if (s.count < OWN_SOURCES) {
            add_source(&s, &own->group[g], &own->group[target]);
        }
    }
    const double without = explain(look, &own->group[target], &s, value);
    const int before = s.count;
    add_source(&s, source, &own->group[target]);
    if (s.count == before) {
        return 0;
    }
    *rest = explain(look, &own->group[target], &s, value);
    *coefficient = value[s.count - 1];
    return without - *rest;
}

// Returns 1 or -1 if the momentum of a neighbour moves a position as it moves the neighbour's own
// position, with this factor; else 0.
static double whole_coefficient(const pm_look *look, const pm_part_view *carrier, int momentum,
                                const pm_part_view *carried, int position) {
    double other, rest = 1, at_home;
    const int home = carrier->mate[momentum];
    const pm_look_group *source = &carrier->group[momentum];
    if (carrier->kind[momentum] != PM_VIEW_MOMENTUM ||
        carried->kind[position] != PM_VIEW_POSITION || home < 0 ||
        gain(look, carried, position, source, &other, &rest) < TRACE || rest > CLEAR) {
        return 0;
    }
    // The velocity per momentum of the neighbour itself, whatever else moves its position.
    const double rest_home = pm_regress_rate(look, &carrier->group[home], 1, source, 1, &at_home);
    const double units = carried->unit[position].factor / carrier->unit[home].factor;
    const double c =
        at_home == 0 || rest_home > LOOSE ? 0 : -other / at_home * units * carrier->sign[home];
    const double whole = round(c);
    return fabs(c - whole) < NEAR_WHOLE && fabs(whole) == 1 ? whole : 0;
}

// Returns 1 or -1 if the rate of a position is linear in momenta of its own subsystem and of
// neighbours, with the sign of the coefficient of this momentum, and the product of both units is
// J s; else 0. The coefficient is 1 or -1, unless there is a gear or a lever between them.
static double guess_coefficient(const pm_look *look, const pm_part_view *parts,
                                const pm_part_view *carrier, int momentum, int carried,
                                int position) {
    const pm_part_view *v = &parts[carried];
    double coefficient[MOST_SOURCES] = {0}, sign = 0, unused[MOST_SOURCES];
    if (!makes_action(&carrier->unit[momentum], &v->unit[position]) ||
        carrier->kind[momentum] == PM_VIEW_SPIN) {
        return 0;
    }
    const sources s = find_sources(look, parts, carried, position, -1, &carrier->unit[momentum]);
    sources others = {0};
    const double rest = explain(look, &v->group[position], &s, coefficient);
    for (int i = 0; i < s.count; ++i) {
        if (s.group[i].first == carrier->group[momentum].first) {
            sign = coefficient[i] < 0 ? -1 : 1;
        } else {
            others.group[others.count++] = s.group[i];
        }
    }
    const double without = explain(look, &v->group[position], &others, unused);
    return rest < CLEAR && without - rest > TRACE ? sign : 0;
}

// Returns true if a group carries entropy from each end to the other: an entropy at both ends
// changes at a rate with a part that is odd in time and follows the group.
static bool carries_entropy(const pm_look *look, const pm_part_view *const v[2],
                            const pm_scene_port *port, const pm_look_group *current) {
    pm_parity parity = {0};
    for (int e = 0; e < 2; ++e) {
        for (int g = 0; g < v[e]->count; ++g) {
            for (int c = 0; c < v[e]->group[g].group->size && !v[e]->group[g].constant; ++c) {
                if (v[e]->odd[g] && parity.nodd < PM_LOOK_SOURCES) {
                    parity.odd[parity.nodd++] = v[e]->group[g].first + c;
                } else if (!v[e]->odd[g] && parity.neven < PM_LOOK_SOURCES) {
                    parity.even[parity.neven++] = v[e]->group[g].first + c;
                }
            }
        }
    }
    for (int e = 0; e < 2; ++e) {
        bool moves = false;
        for (int g = 0; g < v[e]->count; ++g) {
            const pm_look_group *own = &v[e]->group[g];
            const bool heated = v[e]->kind[g] == PM_VIEW_ENTROPY && !own->constant &&
                                pm_layout_find(&port->layout[e], own->group->name) != NULL;
            for (int c = 0; c < own->group->size * current->group->size && heated && !moves; ++c) {
                moves = pm_look_odd_part(look, &parity, own->first + c / current->group->size,
                                         current->first + c % current->group->size) > CARRIED;
            }
        }
        if (!moves) {
            return false;
        }
    }
    return true;
}

void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view) {
    const pm_scene_port *p = &look->scene->physics.port[port];
    *view = (pm_port_view){.count = 0};
    if (p->subsystem[0] < 0 || p->subsystem[1] < 0) {
        return;
    }
    const pm_part_view *v[2] = {&parts[p->subsystem[0]], &parts[p->subsystem[1]]};
    bool shown[2][PM_MAX_GROUPS];
    for (int e = 0; e < 2; ++e) {
        for (int g = 0; g < v[e]->count; ++g) {
            const pm_look_group *group = &v[e]->group[g];
            shown[e][g] = pm_layout_find(&p->layout[e], group->group->name) != NULL;
            view->current[e][g] = shown[e][g] && v[e]->unit[g].known && v[e]->odd[g] &&
                                  !group->constant && carries_entropy(look, v, p, group);
            view->carries = view->carries || view->current[e][g];
        }
    }
    const pm_part_view *a = v[0], *b = v[1];
    for (int pair_id = 0; pair_id < a->count * b->count; ++pair_id) {
        const int ga = pair_id / b->count, gb = pair_id % b->count;
        double c, rest = 1;
        // Only dissipation couples variables with equal units, or two that are even.
        if (!is_nonentropy(a, ga) || !is_nonentropy(b, gb) || !shown[0][ga] || !shown[1][gb] ||
            pm_unit_equal(&a->unit[ga], &b->unit[gb]) || !(a->odd[ga] || b->odd[gb])) {
            continue;
        }
        const double to_b = whole_coefficient(look, a, ga, b, gb);
        const double to_a = whole_coefficient(look, b, gb, a, ga);
        const bool of_a = gain(look, a, ga, &b->group[gb], &c, &rest) > TRACE;
        const bool of_b = gain(look, b, gb, &a->group[ga], &c, &rest) > TRACE;
        const bool comparable = a->group[ga].group->size == b->group[gb].group->size;
        if (to_b == 0 && to_a == 0 && !of_a && !of_b && comparable) {
            continue;
        }
        pm_pair_view *pair = &view->pair[view->count++];
        *pair = (pm_pair_view){
            .a = ga, .b = gb, .momentum_first = to_b != 0, .coefficient = to_b != 0 ? to_b : to_a};
        if (pair->coefficient == 0 && comparable) {
            const double up = guess_coefficient(look, parts, a, ga, b->subsystem, gb);
            const double down = guess_coefficient(look, parts, b, gb, a->subsystem, ga);
            pair->guessed = up != 0 || down != 0;
            pair->momentum_first = up != 0 && !(down != 0 && is_length(&a->unit[ga]));
            pair->coefficient = pair->momentum_first ? -up : -down;
        }
    }
}

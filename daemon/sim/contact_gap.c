// The forces that a gap shows, and the search for the state at which its bodies agree with them.
#include "sim/contact_gap.h"

#include <math.h>
#include <string.h>

// At first the bodies are taken for this many times as soft as the gap: a force that is too small
// teaches as much as a larger one and does no harm.
#define SOFTER 1000
// Newton's method ends at this residual, relative to the distance from the answer of the bodies.
#define SOLVED 1e-3
#define MOST_NEWTON 30
#define MOST_HALVES 6
#define KRYLOV 30 // the most vectors of GMRES
#define KRYLOV_END 1e-6
// The length over which dE/dx is differentiated, relative to the distance from the answer.
#define DIFFERENCE 1e-4
// The bodies agree with the gap where their answer changes the forces by less than this share, or
// the travel by less than this share of it.
#define AGREED 1e-4
#define AGREED_TRAVEL 1e-9

// --- opening ---

pm_status pm_contact_gap_open(pm_contact_gap *gap, pm_arena *arena, const pm_system *system,
                              int id) {
    const pm_part *part = system->part[id];
    const pm_physics *physics = &system->scene->physics;
    const pm_potential_spec *energy = &part->spec.energy;
    const pm_group *entropy = pm_layout_find(&part->layout, "s");
    *gap = (pm_contact_gap){.nz = part->layout.nz};
    for (int i = 0; i < energy->ngiven && entropy != NULL && entropy->size == 1; ++i) {
        if (strcmp(energy->given[i], "s") == 0) {
            gap->temperature = energy->given_coefficient == NULL ? 1 : energy->given_coefficient[i];
            gap->s = entropy->first;
        }
    }
    if (!(gap->temperature > 0) || part->spec.irreversible.ngiven > 0) {
        return pm_fail(PM_ECONFIG,
                       "%s: the gap %s beside a solid needs an entropy s that takes up heat, and "
                       "no irreversible operator",
                       physics->subsystem[id].at, physics->subsystem[id].name);
    }
    const size_t n = (size_t)gap->nz, krylov = KRYLOV + 1;
    const size_t count = (9 + 2 * PM_CONTACT_GAP_PAIRS + 5 + krylov) * n;
    double *at = pm_arena_array(arena, count, sizeof *at);
    gap->component = pm_arena_array(arena, n, sizeof *gap->component);
    PM_TRY(pm_arena_status(arena, "a gap"));
    double **const array[] = {&gap->dE, &gap->dS,     &gap->response, &gap->start,      &gap->e0,
                              &gap->e,  &gap->answer, &gap->last_e,   &gap->last_answer};
    for (size_t i = 0; i < sizeof array / sizeof *array; ++i) {
        *array[i] = at;
        at += n;
    }
    gap->change_e = at;
    gap->change_y = at + PM_CONTACT_GAP_PAIRS * n;
    gap->work = at + 2 * PM_CONTACT_GAP_PAIRS * n;
    for (int i = 0; i < physics->nport; ++i) { // on which components do ports act?
        const pm_scene_port *port = &physics->port[i];
        const int ny = port->subsystem[PM_END_B] == id ? port->layout[PM_END_B].nz : 0;
        for (int k = 0; k < ny && gap->n < gap->nz; ++k) {
            gap->component[gap->n++] = port->component[PM_END_B][k];
        }
    }
    return PM_OK;
}

void pm_contact_gap_set_program(pm_contact_gap *gap, pm_program *program, double *z,
                                const double *result, const double *gradient) {
    gap->program = program;
    gap->z = z;
    gap->result = result;
    gap->gradient = gradient;
}

// --- forces ---

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

static double largest(int n, const double *x) {
    double most = 0;
    for (int i = 0; i < n; ++i) {
        most = fmax(most, fabs(x[i]));
    }
    return most;
}

static void pick(const pm_contact_gap *gap, const double *z, double *x) {
    for (int i = 0; i < gap->n; ++i) {
        x[i] = z[gap->component[i]];
    }
}

// Computes e [n] at the travel x [n].
static void evaluate(pm_contact_gap *gap, const double *x, double *e) {
    for (int i = 0; i < gap->n; ++i) {
        gap->z[gap->component[i]] = x[i];
    }
    pm_program_run_prepared(gap->program, 1);
    pick(gap, gap->gradient, e);
}

// Runs the program at z, but without entropy. Returns the energy that the pairs store, J.
static double store(pm_contact_gap *gap, const double *z) {
    memcpy(gap->z, z, (size_t)gap->nz * sizeof *z);
    gap->z[gap->s] = 0;
    pm_program_run_prepared(gap->program, 1);
    return gap->result[0];
}

void pm_contact_gap_begin(pm_contact_gap *gap, const double *z) {
    memcpy(gap->start, z, (size_t)gap->nz * sizeof *z);
    pm_program_prepare(gap->program);
    gap->stored0 = store(gap, z);
    pick(gap, gap->gradient, gap->e0);
    gap->round = 0;
    gap->heard = gap->settled = false;
    gap->change = INFINITY;
}

void pm_contact_gap_expose(pm_contact_gap *gap, const double *z) {
    const double now = store(gap, z), gain = now - gap->stored0;
    double work[2] = {0}; // of e0 and of e1
    for (int i = 0; i < gap->n; ++i) {
        const int c = gap->component[i];
        if (!gap->settled) {
            gap->e[i] = gap->gradient[c];
        }
        work[0] += gap->e0[i] * (z[c] - gap->start[c]);
        work[1] += gap->e[i] * (z[c] - gap->start[c]);
    }
    // The weights of e0 and e1 in the force with which ports book their power.
    double weight[2] = {0.5, 0.5};
    const double missing = gain - (work[0] + work[1]) / 2;
    const double size = work[0] * work[0] + work[1] * work[1];
    if (missing > 0 && size > 0 && work[1] >= gain) { // as always if the energy is convex
        weight[1] = (gain - work[0]) / (work[1] - work[0]);
        weight[0] = 1 - weight[1];
    } else if (missing > 0 && size > 0) {
        weight[0] += missing * work[0] / size;
        weight[1] += missing * work[1] / size;
    }
    for (int i = 0; i < gap->n; ++i) {
        const int c = gap->component[i];
        gap->dE[c] = weight[0] * gap->e0[i] + weight[1] * gap->e[i];
        gap->response[c] = gap->e[i];
    }
    gap->dE[gap->s] = gap->temperature;
    gap->dS[gap->s] = 1;
    gap->S = z[gap->s];
    gap->E = now + gap->temperature * gap->S;
    gap->heat = fmax(weight[0] * work[0] + weight[1] * work[1] - gain, 0);
}

// --- the compliance of the bodies ---

// Replaces x [n], changes of e, by C x; `scale` is the compliance in directions of which nothing is
// known.
static void comply(const pm_contact_gap *gap, double scale, double *x) {
    const int n = gap->n;
    double along[PM_CONTACT_GAP_PAIRS], product[PM_CONTACT_GAP_PAIRS];
    for (int k = gap->count - 1; k >= 0; --k) {
        const double *de = gap->change_e + (ptrdiff_t)k * n, *dy = gap->change_y + (ptrdiff_t)k * n;
        product[k] = dot(n, de, dy);
        along[k] = dot(n, dy, x) / product[k];
        for (int i = 0; i < n; ++i) {
            x[i] -= along[k] * de[i];
        }
    }
    for (int i = 0; i < n; ++i) {
        x[i] *= scale;
    }
    for (int k = 0; k < gap->count; ++k) {
        const double *de = gap->change_e + (ptrdiff_t)k * n, *dy = gap->change_y + (ptrdiff_t)k * n;
        const double back = along[k] - dot(n, de, x) / product[k];
        for (int i = 0; i < n; ++i) {
            x[i] += back * dy[i];
        }
    }
}

// --- the next state ---

// The equation to be solved, and work space. All arrays are [n].
typedef struct gap_equation {
    pm_contact_gap *gap;
    double scale;
    double *x, *e, *residual, *trial, *move;
    double *krylov; // [KRYLOV + 1][n]
} gap_equation;

// Computes the residual x - y + C (e(x) - e1) and q->e, and returns the norm of the residual.
static double find_residual(const gap_equation *q, const double *x, double *residual) {
    const int n = q->gap->n;
    evaluate(q->gap, x, q->e);
    for (int i = 0; i < n; ++i) {
        residual[i] = q->e[i] - q->gap->e[i];
    }
    comply(q->gap, q->scale, residual);
    for (int i = 0; i < n; ++i) {
        residual[i] += x[i] - q->gap->answer[i];
    }
    return sqrt(dot(n, residual, residual));
}

// Computes to = (1 + C d2E/dx2) v at q->x, where e is q->e, by a difference over `length`.
static void differentiate(const gap_equation *q, double length, const double *v, double *to) {
    const int n = q->gap->n;
    const double step = length / largest(n, v);
    for (int i = 0; i < n; ++i) {
        q->trial[i] = q->x[i] + step * v[i];
    }
    evaluate(q->gap, q->trial, to);
    for (int i = 0; i < n; ++i) {
        to[i] = (to[i] - q->e[i]) / step;
    }
    comply(q->gap, q->scale, to);
    for (int i = 0; i < n; ++i) {
        to[i] += v[i];
    }
}

// Computes q->move, which would make the residual of norm `norm` zero if dE/dx were linear.
static void find_move(const gap_equation *q, double length, double norm) {
    const int n = q->gap->n;
    double H[KRYLOV + 1][KRYLOV], right[KRYLOV + 1] = {-norm}, c[KRYLOV], s[KRYLOV];
    int k = 0;
    for (int i = 0; i < n; ++i) {
        q->krylov[i] = q->residual[i] / norm;
    }
    for (; k < KRYLOV && fabs(right[k]) > KRYLOV_END * norm; ++k) {
        differentiate(q, length, q->krylov + (ptrdiff_t)k * n, q->krylov + (ptrdiff_t)(k + 1) * n);
        // Makes vector k + 1 orthogonal to those before it, and column k of H.
        double *next = q->krylov + (ptrdiff_t)(k + 1) * n;
        for (int j = 0; j <= k; ++j) {
            const double *v = q->krylov + (ptrdiff_t)j * n;
            H[j][k] = dot(n, v, next);
            for (int i = 0; i < n; ++i) {
                next[i] -= H[j][k] * v[i];
            }
        }
        const double length_of_next = sqrt(dot(n, next, next));
        for (int i = 0; i < n && length_of_next > 0; ++i) {
            next[i] /= length_of_next;
        }
        H[k + 1][k] = length_of_next;
        for (int j = 0; j < k; ++j) {
            const double upper = c[j] * H[j][k] + s[j] * H[j + 1][k];
            H[j + 1][k] = c[j] * H[j + 1][k] - s[j] * H[j][k];
            H[j][k] = upper;
        }
        const double root = hypot(H[k][k], H[k + 1][k]);
        c[k] = H[k][k] / root;
        s[k] = H[k + 1][k] / root;
        H[k][k] = root;
        right[k + 1] = -s[k] * right[k];
        right[k] *= c[k];
    }
    // Solves the triangular system and sums up the move.
    double y[KRYLOV];
    memset(q->move, 0, (size_t)n * sizeof *q->move);
    for (int i = k - 1; i >= 0; --i) {
        y[i] = right[i];
        for (int j = i + 1; j < k; ++j) {
            y[i] -= H[i][j] * y[j];
        }
        y[i] /= H[i][i];
        for (int j = 0; j < n; ++j) {
            q->move[j] += y[i] * q->krylov[(ptrdiff_t)i * n + j];
        }
    }
}

// Moves q->x by the move, less far while the residual does not fall. Returns the new norm.
static double advance(gap_equation *q, double norm) {
    const int n = q->gap->n;
    double share = 1, next = norm;
    for (int k = 0; k <= MOST_HALVES; ++k) {
        for (int i = 0; i < n; ++i) {
            q->trial[i] = q->x[i] + share * q->move[i];
        }
        next = find_residual(q, q->trial, q->residual);
        if (next < norm) {
            break;
        }
        share /= 2;
    }
    memcpy(q->x, q->trial, (size_t)n * sizeof *q->x);
    return next;
}

// Returns the compliance of the bodies in directions in which they have not answered yet. It is
// that of the last pair of changes. Before the first pair it is SOFTER times the compliance of the
// gap between x and the answer.
static double first_scale(const gap_equation *q) {
    pm_contact_gap *gap = q->gap;
    const int n = gap->n;
    if (gap->count > 0) {
        const double *de = gap->change_e + (ptrdiff_t)(gap->count - 1) * n;
        const double *dy = gap->change_y + (ptrdiff_t)(gap->count - 1) * n;
        return dot(n, de, dy) / dot(n, de, de);
    }
    double force = 0, length = 0;
    evaluate(gap, gap->answer, q->e);
    for (int i = 0; i < n; ++i) {
        force = fmax(force, fabs(q->e[i] - gap->e[i]));
        length = fmax(length, fabs(gap->answer[i] - q->x[i]));
    }
    return SOFTER * length / force;
}

// Solves for the travel q->x, starting there.
static void solve(gap_equation *q) {
    const int n = q->gap->n;
    for (int i = 0; i < n; ++i) {
        q->move[i] = q->gap->answer[i] - q->x[i];
    }
    const double distance = sqrt(dot(n, q->move, q->move));
    const double length = DIFFERENCE * largest(n, q->move);
    q->scale = first_scale(q);
    double norm = find_residual(q, q->x, q->residual);
    for (int k = 0; k < MOST_NEWTON && norm > SOLVED * distance; ++k) {
        find_move(q, length, norm);
        norm = advance(q, norm);
    }
}

// Computes the next travel q->x from the answer of the bodies to the forces gap->e.
static void answer(gap_equation *q) {
    pm_contact_gap *gap = q->gap;
    const size_t size = (size_t)gap->n * sizeof(double);
    if (gap->heard) { // keeps the pair of changes
        const int n = gap->n;
        if (gap->count == PM_CONTACT_GAP_PAIRS) {
            memmove(gap->change_e, gap->change_e + n, (size_t)(gap->count - 1) * size);
            memmove(gap->change_y, gap->change_y + n, (size_t)(gap->count - 1) * size);
            --gap->count;
        }
        double *de = gap->change_e + (ptrdiff_t)gap->count * n;
        double *dy = gap->change_y + (ptrdiff_t)gap->count * n;
        for (int i = 0; i < n; ++i) {
            de[i] = gap->e[i] - gap->last_e[i];
            dy[i] = gap->last_answer[i] - gap->answer[i];
        }
        gap->count +=
            dot(n, de, dy) > 0 && largest(n, dy) > AGREED_TRAVEL * largest(n, gap->answer);
    }
    memcpy(gap->last_e, gap->e, size);
    memcpy(gap->last_answer, gap->answer, size);
    gap->heard = true;
    // The bodies agree with the gap if the forces at their answer are those that it shows.
    double change = 0, distance = 0;
    evaluate(gap, gap->answer, q->e);
    for (int i = 0; i < gap->n; ++i) {
        change = fmax(change, fabs(q->e[i] - gap->e[i]));
        distance = fmax(distance, fabs(gap->answer[i] - q->x[i]));
    }
    gap->settled = change <= AGREED * largest(gap->n, gap->e) ||
                   distance <= AGREED_TRAVEL * largest(gap->n, q->x);
    if (gap->settled) {
        memcpy(q->x, gap->answer, size);
    } else {
        solve(q);
    }
}

void pm_contact_gap_next(pm_contact_gap *gap, const double *z, const double *reached,
                         double *next) {
    const int nz = gap->nz;
    double *work = gap->work;
    gap_equation q = {gap,          0, work, work + nz, work + 2 * nz, work + 3 * nz, work + 4 * nz,
                      work + 5 * nz};
    memcpy(next, z, (size_t)nz * sizeof *z);
    pick(gap, z, q.x);
    for (int i = 0; i < gap->n; ++i) {
        gap->answer[i] = reached[gap->component[i]];
    }
    if (gap->round++ % 2 == 1) { // the rates answer the forces that the gap shows
        answer(&q);
        for (int i = 0; i < gap->n; ++i) {
            next[gap->component[i]] = q.x[i];
        }
    }
    next[gap->s] = gap->start[gap->s] + gap->heat / gap->temperature;
}

double pm_contact_gap_change(pm_contact_gap *gap, double change) {
    if (gap->round % 2 == 0) { // pm_contact_gap_next has counted the round
        gap->change = change;
    }
    return gap->change;
}

void pm_contact_gap_record(pm_contact_gap *gap, pm_serializer *serializer) {
    pm_serializer_put_int(serializer, "pairs of a gap", &gap->count);
    pm_serializer_put(serializer, "changes of the force", gap->change_e,
                      PM_CONTACT_GAP_PAIRS * gap->n);
    pm_serializer_put(serializer, "changes of the travel", gap->change_y,
                      PM_CONTACT_GAP_PAIRS * gap->n);
}

// Newton's method for the positions of all nodes, with halved steps where it does not converge.
#include "truth/beam_solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "truth/beam_contact.h"
#include "truth/beam_matrix.h"

// Equilibrium is reached when the norm of the residual falls below this share of the largest norm
// that the element forces have, or had at an earlier equilibrium. Rounding leaves about 1e-11, and
// the last iteration squares the error before it.
#define TOLERANCE 1e-9
// It is also reached when the last increment is shorter than this share of an element's length.
// Under small loads rounding leaves a larger residual than TOLERANCE, and Newton's method squares
// the increment.
#define NEGLIGIBLE 1e-9
// The number of full Newton iterations before a line search is used. Most steps need fewer.
#define FULL_ITERATIONS 6
// The largest number of times that a step may be halved.
#define MAX_HALVINGS 6

// The energies of a body in an iteration.
typedef struct body_energy {
    double stored, dissipated; // J, now and in the step
} body_energy;

struct pm_beam {
    pm_arena arena; // owns the arrays
    const pm_beam_mesh *mesh;
    pm_beam_material material;
    pm_beam_contact contact;
    pm_beam_element *element;                 // [nelement]
    pm_beam_memory (*before)[PM_BEAM_POINTS]; // [nelement] at the last equilibrium
    pm_beam_memory (*after)[PM_BEAM_POINTS];  // [nelement] of the iteration
    double (*stress)[PM_SYMMETRIC];           // [nelement] of the iteration
    pm_beam_matrix *matrix;
    pm_beam_contact_force pair; // work space: the contact of one candidate
    pm_beam_state now;
    double *f;             // [nnode][3] N, loads at the last equilibrium
    double *q;             // [nnode][3] m, positions of the iteration
    double *contact_force; // [nnode][3] N, of the iteration
    double *residual;      // [nnode][3] N, of the iteration
    double *increment;     // [nnode][3] m, of Newton's method
    body_energy *body;     // [nbody] of the iteration
    int *nelement_at;      // [nnode] elements that share the node
    double largest;        // N, largest norm of the element forces at an equilibrium
};

// --- memory ---

static bool beam_alloc(pm_beam *beam) {
    const size_t nnode = (size_t)beam->mesh->nnode, nelement = (size_t)beam->mesh->nelement;
    const size_t nbody = (size_t)beam->mesh->nbody, vector = 3 * sizeof *beam->q;
    pm_arena *arena = &beam->arena;
    beam->element = pm_arena_array(arena, nelement, sizeof *beam->element);
    beam->before = pm_arena_array(arena, nelement, sizeof *beam->before);
    beam->after = pm_arena_array(arena, nelement, sizeof *beam->after);
    beam->stress = pm_arena_array(arena, nelement, sizeof *beam->stress);
    beam->now.q = pm_arena_array(arena, nnode, vector);
    beam->now.sigma = pm_arena_array(arena, nnode, PM_SYMMETRIC * sizeof *beam->now.sigma);
    beam->now.contact = pm_arena_array(arena, nnode, vector);
    beam->now.energy = pm_arena_array(arena, nbody, sizeof *beam->now.energy);
    beam->f = pm_arena_array(arena, nnode, vector);
    beam->q = pm_arena_array(arena, nnode, vector);
    beam->contact_force = pm_arena_array(arena, nnode, vector);
    beam->residual = pm_arena_array(arena, nnode, vector);
    beam->increment = pm_arena_array(arena, nnode, vector);
    beam->body = pm_arena_array(arena, nbody, sizeof *beam->body);
    beam->nelement_at = pm_arena_array(arena, nnode, sizeof *beam->nelement_at);
    return beam->element && beam->before && beam->after && beam->stress && beam->now.q &&
           beam->now.sigma && beam->now.contact && beam->now.energy && beam->f && beam->q &&
           beam->contact_force && beam->residual && beam->increment && beam->body &&
           beam->nelement_at;
}

// Copies the rows of an element's nodes to corner [PM_BEAM_CORNERS][3].
static void gather(const int *node, const double *from, double *corner) {
    for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
        memcpy(corner + 3 * c, from + 3 * node[c], 3 * sizeof *from);
    }
}

static pm_status beam_init(pm_beam *beam, double contact) {
    const pm_beam_mesh *mesh = beam->mesh;
    if (!beam_alloc(beam)) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    PM_TRY(pm_beam_contact_make(&beam->contact, mesh, contact, &beam->arena));
    PM_TRY(pm_beam_matrix_new(&beam->matrix, mesh));
    for (int e = 0; e < mesh->nelement; ++e) {
        double x[PM_BEAM_FREEDOMS];
        gather(mesh->hexahedron[e], mesh->position[0], x);
        pm_beam_element_init(&beam->element[e], x);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            ++beam->nelement_at[mesh->hexahedron[e][c]];
        }
    }
    pm_beam_reset(beam);
    return PM_OK;
}

pm_status pm_beam_new(pm_beam **result, const pm_beam_mesh *mesh, const pm_beam_material *material,
                      double contact) {
    pm_beam *beam = calloc(1, sizeof *beam);
    if (beam == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    beam->mesh = mesh;
    beam->material = *material;
    const pm_status status = beam_init(beam, contact);
    if (status != PM_OK) {
        pm_beam_free(beam);
        return status;
    }
    *result = beam;
    return PM_OK;
}

void pm_beam_free(pm_beam *beam) {
    if (beam != NULL) {
        pm_beam_matrix_free(beam->matrix);
        pm_arena_free(&beam->arena);
        free(beam);
    }
}

void pm_beam_reset(pm_beam *beam) {
    const size_t nnode = (size_t)beam->mesh->nnode, nbody = (size_t)beam->mesh->nbody;
    pm_beam_state *now = &beam->now;
    memcpy(now->q, beam->mesh->position, 3 * nnode * sizeof *now->q);
    memset(now->sigma, 0, PM_SYMMETRIC * nnode * sizeof *now->sigma);
    memset(now->contact, 0, 3 * nnode * sizeof *now->contact);
    memset(now->energy, 0, nbody * sizeof *now->energy);
    memset(beam->f, 0, 3 * nnode * sizeof *beam->f);
    now->contact_stored = now->depth = beam->largest = 0;
    for (int e = 0; e < beam->mesh->nelement; ++e) {
        for (int p = 0; p < PM_BEAM_POINTS; ++p) {
            pm_beam_memory_init(&beam->before[e][p]);
        }
    }
}

const pm_beam_state *pm_beam_now(const pm_beam *beam) {
    return &beam->now;
}

// --- one iteration ---

// Sums over all bodies in an iteration.
typedef struct iteration_totals {
    double inner;          // N, norm of the element forces
    double contact_stored; // J
    double depth;          // m
} iteration_totals;

// Subtracts the element forces from the residual, and adds up the energy that each body stores and
// dissipates. Returns false if an element is turned inside out.
static bool add_elements(pm_beam *beam, double h, iteration_totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    double square = 0;
    memset(beam->body, 0, (size_t)mesh->nbody * sizeof *beam->body);
    for (int e = 0; e < mesh->nelement; ++e) {
        const int *node = mesh->hexahedron[e];
        body_energy *owner = &beam->body[e / (mesh->nelement / mesh->nbody)];
        double q[PM_BEAM_FREEDOMS];
        pm_beam_element_response r;
        gather(node, beam->q, q);
        if (!pm_beam_element_respond(&beam->element[e], &beam->material, h, q, beam->before[e],
                                     beam->after[e], &r)) {
            return false;
        }
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            beam->residual[3 * node[i / 3] + i % 3] -= r.force[i];
            square += r.force[i] * r.force[i];
        }
        memcpy(beam->stress[e], r.stress, sizeof r.stress);
        pm_beam_matrix_add(beam->matrix, e, r.stiffness[0]);
        owner->stored += r.energy;
        owner->dissipated += r.dissipated;
    }
    sum->inner = sqrt(square);
    return true;
}

// Adds forces, energy and stiffness of contact. Returns false if memory is exhausted.
static bool add_contact(pm_beam *beam, bool exact, iteration_totals *sum) {
    const pm_beam_contact *contact = &beam->contact;
    pm_beam_contact_force *pair = &beam->pair;
    for (int i = 0; i < contact->ncandidate; ++i) {
        if (pm_beam_contact_respond(contact, &contact->candidate[i], beam->q, exact, pair)) {
            for (int k = 0; k < 3 * pair->nnode; ++k) {
                beam->contact_force[3 * pair->node[k / 3] + k % 3] += pair->force[k / 3][k % 3];
            }
            sum->contact_stored += pair->energy;
            sum->depth = fmax(sum->depth, pair->depth);
            if (!pm_beam_matrix_couple(beam->matrix, pair->nnode, pair->node, pair->stiffness)) {
                return false;
            }
        }
    }
    return true;
}

// Assembles the residual (loads plus contact forces minus element forces) and the matrix at
// beam->q, with the exact stiffness of contact or its positive semi-definite part.
static bool assemble(pm_beam *beam, double h, const double *f, bool exact, iteration_totals *sum) {
    const size_t size = 3 * (size_t)beam->mesh->nnode * sizeof *f;
    *sum = (iteration_totals){0};
    memset(beam->contact_force, 0, size);
    pm_beam_matrix_clear(beam->matrix);
    if (!add_contact(beam, exact, sum)) {
        return false;
    }
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        beam->residual[i] = f[i] + beam->contact_force[i];
    }
    return add_elements(beam, h, sum);
}

// Returns the norm of the residual over the free nodes, N.
static double free_norm(const pm_beam *beam) {
    double square = 0;
    for (int i = 0; i < beam->mesh->nnode; ++i) {
        for (int d = 0; d < 3 && !beam->mesh->clamped[i]; ++d) {
            square += beam->residual[3 * i + d] * beam->residual[3 * i + d];
        }
    }
    return sqrt(square);
}

// --- the step ---

static bool solve(pm_beam *beam) {
    memcpy(beam->increment, beam->residual,
           3 * (size_t)beam->mesh->nnode * sizeof *beam->increment);
    return pm_beam_matrix_solve(beam->matrix, beam->increment);
}

// Computes the increment. Where bodies lie deep in each other, or slip off each other, the exact
// matrix may not be positive definite; then the other matrix is used.
static bool find_increment(pm_beam *beam, double h, const double *f, iteration_totals *sum) {
    return solve(beam) || (sum->depth > 0 && assemble(beam, h, f, false, sum) && solve(beam));
}

static void move(pm_beam *beam, double fraction) {
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        beam->q[i] += fraction * beam->increment[i];
    }
}

// Returns the product of residual and increment, J: minus the derivative of the energy along the
// increment.
static double directional_work(const pm_beam *beam) {
    double sum = 0;
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        sum += beam->residual[i] * beam->increment[i];
    }
    return sum;
}

// Moves by the increment and assembles there. With `search` the increment is shortened by the
// secant method until the directional work is no less than minus half of that before.
static bool advance(pm_beam *beam, double h, const double *f, bool search, iteration_totals *sum) {
    const int most = 8;
    const double before = directional_work(beam);
    double fraction = 1;
    move(beam, fraction);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < most && search; ++k) {
        const double now = good ? directional_work(beam) : -INFINITY;
        if (now >= -before / 2) {
            return true;
        }
        const double next = fraction * fmin(fmax(before / (before - now), 0.1), 0.5);
        move(beam, next - fraction);
        fraction = next;
        good = assemble(beam, h, f, true, sum);
    }
    return good;
}

// Returns true if the increment is negligible.
static bool increment_is_negligible(const pm_beam *beam) {
    const double most = NEGLIGIBLE * beam->mesh->edge;
    double longest = 0;
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        longest = fmax(longest, fabs(beam->increment[i]));
    }
    return longest <= most;
}

// Iterates beam->q to equilibrium. Returns false if Newton's method does not converge.
static bool iterate(pm_beam *beam, double h, const double *f, iteration_totals *sum,
                    pm_beam_convergence *convergence) {
    memcpy(beam->q, beam->now.q, 3 * (size_t)beam->mesh->nnode * sizeof *beam->q);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < PM_BEAM_MAX_ITERATIONS && good; ++k) {
        const double norm = free_norm(beam);
        convergence->residual[k] = norm;
        convergence->niteration = k + 1;
        if (norm <= TOLERANCE * fmax(beam->largest, sum->inner) ||
            (k > 0 && increment_is_negligible(beam))) {
            return true;
        }
        good = isfinite(norm) && find_increment(beam, h, f, sum) &&
               advance(beam, h, f, k >= FULL_ITERATIONS, sum);
    }
    return false;
}

// Averages the stresses of the elements at each node.
static void average_stress(pm_beam *beam) {
    memset(beam->now.sigma, 0, PM_SYMMETRIC * (size_t)beam->mesh->nnode * sizeof *beam->now.sigma);
    for (int e = 0; e < beam->mesh->nelement; ++e) {
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            const int node = beam->mesh->hexahedron[e][c];
            for (int m = 0; m < PM_SYMMETRIC; ++m) {
                beam->now.sigma[PM_SYMMETRIC * node + m] +=
                    beam->stress[e][m] / beam->nelement_at[node];
            }
        }
    }
}

// Makes the result of the iteration the state, and adds up the work since the last one.
static void accept(pm_beam *beam, const double *f, const iteration_totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    const size_t size = 3 * (size_t)mesh->nnode * sizeof *f;
    pm_beam_state *now = &beam->now;
    for (int i = 0; i < 3 * mesh->nnode; ++i) {
        pm_beam_energy *energy = &now->energy[i / (3 * mesh->nnode / mesh->nbody)];
        const double moved = beam->q[i] - now->q[i];
        energy->work += (beam->f[i] + f[i]) / 2 * moved;
        energy->contact_work += (now->contact[i] + beam->contact_force[i]) / 2 * moved;
    }
    for (int b = 0; b < mesh->nbody; ++b) {
        now->energy[b].dissipated += beam->body[b].dissipated;
        now->energy[b].stored = beam->body[b].stored;
    }
    beam->largest = fmax(beam->largest, sum->inner);
    now->contact_stored = sum->contact_stored;
    now->depth = sum->depth;
    memcpy(now->q, beam->q, size);
    memcpy(now->contact, beam->contact_force, size);
    memcpy(beam->f, f, size);
    memcpy(beam->before, beam->after, (size_t)mesh->nelement * sizeof *beam->before);
    average_stress(beam);
}

// Takes a step that is the `depth`th half of the original one.
static pm_status step(pm_beam *beam, double h, const double *f, int depth,
                      pm_beam_convergence *convergence) {
    iteration_totals sum;
    if (iterate(beam, h, f, &sum, convergence)) {
        accept(beam, f, &sum);
        return PM_OK;
    }
    if (depth == MAX_HALVINGS) {
        return pm_fail(PM_ENUMERIC, "beam: no equilibrium found, not even in steps of %g s", h);
    }
    const size_t size = 3 * (size_t)beam->mesh->nnode * sizeof *f;
    double *middle = malloc(size);
    if (middle == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        middle[i] = (beam->f[i] + f[i]) / 2;
    }
    pm_status status = step(beam, h / 2, middle, depth + 1, convergence);
    if (status == PM_OK) {
        status = step(beam, h / 2, f, depth + 1, convergence);
    }
    free(middle);
    return status;
}

pm_status pm_beam_step(pm_beam *beam, double h, const double *f, pm_beam_convergence *convergence) {
    pm_beam_convergence unused;
    return step(beam, h, f, 0, convergence == NULL ? &unused : convergence);
}

// Newton's method for the positions of all nodes, with halved steps where it does not converge. Its
// linear systems are solved by the Cholesky factorisation of CHOLMOD (Chen, Davis, Hager,
// Rajamanickam, ACM Trans. Math. Softw. 35, 2008). No other file uses CHOLMOD.
#include "bodies/truth/beam_solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

#include "bodies/truth/beam_contact.h"

// Declared here because not every compiler provides the header of OpenMP.
void omp_set_max_active_levels(int levels);

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
// The largest number of times that a line search shortens an increment.
#define MAX_SHORTENINGS 8
// Entries in the upper triangle of an element's stiffness.
#define ENTRIES (PM_BEAM_FREEDOMS * (PM_BEAM_FREEDOMS + 1) / 2)

// --- the matrix ---

// The stiffness of all bodies over the degrees of freedom that are not clamped, three for each
// node. The elements always fill the same entries, so that their places and the symbolic
// factorisation are computed once. Contact couples arbitrary nodes and changes the pattern: a
// solution with couplings computes a symbolic factorisation of its own.

typedef struct stiffness_matrix {
    const pm_beam_mesh *mesh;
    cholmod_common common;
    cholmod_sparse *K;         // upper triangle
    cholmod_factor *factor;    // whose symbolic part belongs to K
    cholmod_triplet *coupling; // added to K when solving; NULL until there is one
    cholmod_dense *b;
    int *freedom;          // [nnode] first of three degrees of freedom; -1: clamped
    int (*place)[ENTRIES]; // [nelement] places among the values of K; -1: clamped
} stiffness_matrix;

// Finds row and column in K of entry i, j of a matrix over these nodes. Returns false if one of the
// nodes is clamped.
static bool locate(const stiffness_matrix *matrix, const int *node, int i, int j, int *row,
                   int *column) {
    const int a = matrix->freedom[node[i / 3]], b = matrix->freedom[node[j / 3]];
    const int k = a + i % 3, l = b + j % 3;
    *row = k < l ? k : l;
    *column = k < l ? l : k;
    return a >= 0 && b >= 0;
}

// Returns the place of an entry among the values of K, whose rows are sorted within a column.
static int find(const cholmod_sparse *K, int row, int column) {
    const int *start = K->p, *rows = K->i;
    int low = start[column], high = start[column + 1] - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (rows[middle] < row) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

// Makes a zero matrix for the elements of `mesh`. Memory from the arena and from CHOLMOD; the
// caller frees the matrix, on failure too.
static pm_status matrix_init(stiffness_matrix *matrix, const pm_beam_mesh *mesh, pm_arena *arena) {
    const size_t capacity = (size_t)mesh->nelement * ENTRIES;
    cholmod_common *common = &matrix->common;
    int count = 0, row, column;
    matrix->mesh = mesh;
    // CHOLMOD would start four threads for every block of the factor, at more cost than gain.
    omp_set_max_active_levels(0);
    cholmod_start(common);
    common->print = 0;
    matrix->freedom = pm_arena_array(arena, (size_t)mesh->nnode, sizeof *matrix->freedom);
    matrix->place = pm_arena_array(arena, (size_t)mesh->nelement, sizeof *matrix->place);
    PM_TRY(pm_arena_status(arena, "the matrix of a beam"));
    for (int i = 0; i < mesh->nnode; ++i) {
        matrix->freedom[i] = mesh->clamped[i] ? -1 : count;
        count += mesh->clamped[i] ? 0 : 3;
    }
    // K has all entries that elements need.
    const size_t n = (size_t)count;
    cholmod_triplet *triplet = cholmod_allocate_triplet(n, n, capacity, 1, CHOLMOD_REAL, common);
    matrix->b = cholmod_zeros(n, 1, CHOLMOD_REAL, common);
    if (triplet == NULL || matrix->b == NULL) {
        cholmod_free_triplet(&triplet, common);
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    int *rows = triplet->i, *columns = triplet->j;
    memset(triplet->x, 0, capacity * sizeof(double));
    for (int e = 0; e < mesh->nelement; ++e) {
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            for (int j = i; j < PM_BEAM_FREEDOMS; ++j) {
                triplet->nnz += locate(matrix, mesh->hexahedron[e], i, j, rows + triplet->nnz,
                                       columns + triplet->nnz);
            }
        }
    }
    matrix->K = cholmod_triplet_to_sparse(triplet, 0, common);
    cholmod_free_triplet(&triplet, common);
    matrix->factor = matrix->K == NULL ? NULL : cholmod_analyze(matrix->K, common);
    PM_TRY(pm_allocated(matrix->factor, "a beam"));
    for (int e = 0; e < mesh->nelement; ++e) {
        int *place = matrix->place[e];
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            for (int j = i; j < PM_BEAM_FREEDOMS; ++j) {
                *place++ = locate(matrix, mesh->hexahedron[e], i, j, &row, &column)
                               ? find(matrix->K, row, column)
                               : -1;
            }
        }
    }
    return PM_OK;
}

// Adds a coupling between the nodes node [n] of the mesh. `stiffness` [3 n][3 n], N/m, is
// symmetric; only its upper triangle is read. Returns false if memory is exhausted.
static bool matrix_couple(stiffness_matrix *matrix, int n, const int *node,
                          const double *stiffness) {
    const size_t count = (size_t)(3 * n * (3 * n + 1) / 2), nfreedom = matrix->K->nrow;
    if (matrix->coupling == NULL) {
        matrix->coupling =
            cholmod_allocate_triplet(nfreedom, nfreedom, count, 1, CHOLMOD_REAL, &matrix->common);
    }
    cholmod_triplet *t = matrix->coupling;
    if (t == NULL || (t->nnz + count > t->nzmax &&
                      !cholmod_reallocate_triplet(2 * (t->nnz + count), t, &matrix->common))) {
        return false;
    }
    int *rows = t->i, *columns = t->j;
    double *value = t->x;
    for (int i = 0; i < 3 * n; ++i) {
        for (int j = i; j < 3 * n; ++j) {
            if (locate(matrix, node, i, j, rows + t->nnz, columns + t->nnz)) {
                value[t->nnz++] = stiffness[3 * n * i + j];
            }
        }
    }
    return true;
}

// --- the bodies ---

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
    stiffness_matrix matrix;
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

// Copies the rows of an element's nodes to corner [PM_BEAM_CORNERS][3].
static void gather(const int *node, const double *from, double *corner) {
    for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
        memcpy(corner + 3 * c, from + 3 * node[c], 3 * sizeof *from);
    }
}

pm_status pm_beam_new(pm_beam **result, const pm_beam_mesh *mesh, const pm_beam_material *material,
                      double contact) {
    const size_t nnode = (size_t)mesh->nnode, nelement = (size_t)mesh->nelement;
    const size_t nbody = (size_t)mesh->nbody;
    pm_status status = PM_OK;
    pm_beam *beam = NULL;
    PM_TRY(PM_NEW(beam, "a beam"));
    pm_arena *arena = &beam->arena;
    const size_t vector = 3 * sizeof *beam->q;
    beam->mesh = mesh;
    beam->material = *material;
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
    PM_TRY_DONE(matrix_init(&beam->matrix, mesh, arena));
    PM_TRY_DONE(pm_beam_contact_make(&beam->contact, mesh, contact, arena));
    for (int e = 0; e < mesh->nelement; ++e) {
        double x[PM_BEAM_FREEDOMS];
        gather(mesh->hexahedron[e], mesh->position[0], x);
        pm_beam_element_init(&beam->element[e], x);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            ++beam->nelement_at[mesh->hexahedron[e][c]];
        }
    }
    pm_beam_reset(beam);
    *result = beam;
    beam = NULL;
done:
    pm_beam_free(beam);
    return status;
}

void pm_beam_free(pm_beam *beam) {
    if (beam != NULL) {
        stiffness_matrix *m = &beam->matrix;
        cholmod_free_factor(&m->factor, &m->common);
        cholmod_free_dense(&m->b, &m->common);
        cholmod_free_sparse(&m->K, &m->common);
        cholmod_free_triplet(&m->coupling, &m->common);
        cholmod_finish(&m->common);
        PM_DELETE(beam);
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

// Assembles the residual (loads plus contact forces minus element forces) and the matrix at
// beam->q, with the exact stiffness of contact or its positive semi-definite part. Returns false if
// an element is turned inside out, or memory is exhausted.
static bool assemble(pm_beam *beam, double h, const double *f, bool exact, iteration_totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    const pm_beam_contact *contact = &beam->contact;
    stiffness_matrix *matrix = &beam->matrix;
    pm_beam_contact_force *pair = &beam->pair;
    double square = 0, *value = matrix->K->x;
    *sum = (iteration_totals){0};
    memset(beam->contact_force, 0, 3 * (size_t)mesh->nnode * sizeof *f);
    memset(matrix->K->x, 0, matrix->K->nzmax * sizeof(double));
    if (matrix->coupling != NULL) {
        matrix->coupling->nnz = 0;
    }
    for (int i = 0; i < contact->ncandidate; ++i) {
        if (pm_beam_contact_respond(contact, &contact->candidate[i], beam->q, exact, pair)) {
            for (int k = 0; k < 3 * pair->nnode; ++k) {
                beam->contact_force[3 * pair->node[k / 3] + k % 3] += pair->force[k / 3][k % 3];
            }
            sum->contact_stored += pair->energy;
            sum->depth = fmax(sum->depth, pair->depth);
            if (!matrix_couple(matrix, pair->nnode, pair->node, pair->stiffness)) {
                return false;
            }
        }
    }
    for (int i = 0; i < 3 * mesh->nnode; ++i) {
        beam->residual[i] = f[i] + beam->contact_force[i];
    }
    // The forces of the elements, and the energy that each body stores and dissipates.
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
        for (int i = 0, *place = matrix->place[e]; i < PM_BEAM_FREEDOMS; ++i) {
            for (int j = i; j < PM_BEAM_FREEDOMS; ++j, ++place) {
                if (*place >= 0) {
                    value[*place] += r.stiffness[i][j];
                }
            }
        }
        owner->stored += r.energy;
        owner->dissipated += r.dissipated;
    }
    sum->inner = sqrt(square);
    return true;
}

// --- the step ---

// Solves K x = b for the increment x of the positions, where b is the residual and K the sum of all
// elements and couplings. x is zero at clamped nodes. Returns false if K is not positive definite
// or memory is exhausted.
static bool solve(pm_beam *beam) {
    stiffness_matrix *m = &beam->matrix;
    cholmod_common *common = &m->common;
    const bool coupled = m->coupling != NULL && m->coupling->nnz > 0;
    double *right = m->b->x, one[2] = {1, 0};
    cholmod_sparse *coupling = NULL, *sum = NULL;
    cholmod_factor *own = NULL;
    for (int i = 0; i < beam->mesh->nnode; ++i) {
        if (m->freedom[i] >= 0) {
            memcpy(right + m->freedom[i], beam->residual + 3 * i, 3 * sizeof *right);
        }
    }
    if (coupled) {
        coupling = cholmod_triplet_to_sparse(m->coupling, 0, common);
        sum = coupling == NULL ? NULL : cholmod_add(m->K, coupling, one, one, 1, 1, common);
        own = sum == NULL ? NULL : cholmod_analyze(sum, common);
    }
    cholmod_factor *factor = coupled ? own : m->factor;
    cholmod_dense *x = factor != NULL && cholmod_factorize(coupled ? sum : m->K, factor, common) &&
                               common->status == CHOLMOD_OK
                           ? cholmod_solve(CHOLMOD_A, factor, m->b, common)
                           : NULL;
    cholmod_free_sparse(&sum, common);
    cholmod_free_sparse(&coupling, common);
    cholmod_free_factor(&own, common);
    if (x == NULL) {
        return false;
    }
    const double *solution = x->x;
    for (int i = 0; i < beam->mesh->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            beam->increment[3 * i + d] = m->freedom[i] >= 0 ? solution[m->freedom[i] + d] : 0;
        }
    }
    cholmod_free_dense(&x, common);
    return true;
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
    const double before = directional_work(beam);
    double fraction = 1;
    move(beam, fraction);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < MAX_SHORTENINGS && search; ++k) {
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

// Iterates beam->q to equilibrium. Returns false if Newton's method does not converge.
static bool iterate(pm_beam *beam, double h, const double *f, iteration_totals *sum,
                    pm_beam_convergence *convergence) {
    const pm_beam_mesh *mesh = beam->mesh;
    memcpy(beam->q, beam->now.q, 3 * (size_t)mesh->nnode * sizeof *beam->q);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < PM_BEAM_MAX_ITERATIONS && good; ++k) {
        double square = 0, longest = 0;
        for (int i = 0; i < 3 * mesh->nnode; ++i) {
            const double r = beam->residual[i];
            square += mesh->clamped[i / 3] ? 0 : r * r;
            longest = fmax(longest, fabs(beam->increment[i])); // from the second iteration on
        }
        const double norm = sqrt(square);
        convergence->residual[k] = norm;
        convergence->niteration = k + 1;
        if (norm <= TOLERANCE * fmax(beam->largest, sum->inner) ||
            (k > 0 && longest <= NEGLIGIBLE * mesh->edge)) {
            return true;
        }
        // Where bodies lie deep in each other, or slip off each other, the exact matrix may not be
        // positive definite; then the other matrix is used.
        good =
            isfinite(norm) &&
            (solve(beam) || (sum->depth > 0 && assemble(beam, h, f, false, sum) && solve(beam))) &&
            advance(beam, h, f, k >= FULL_ITERATIONS, sum);
    }
    return false;
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
    // The stress at a node is the mean over its elements.
    memset(now->sigma, 0, PM_SYMMETRIC * (size_t)mesh->nnode * sizeof *now->sigma);
    for (int e = 0; e < mesh->nelement; ++e) {
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            const int node = mesh->hexahedron[e][c];
            for (int m = 0; m < PM_SYMMETRIC; ++m) {
                now->sigma[PM_SYMMETRIC * node + m] += beam->stress[e][m] / beam->nelement_at[node];
            }
        }
    }
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
    PM_TRY(pm_allocated(middle, "a beam"));
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

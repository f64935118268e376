// Newton's method on the beam's nodes.
#include "truth/beam_solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "truth/beam_matrix.h"

// Equilibrium: the residual's norm over the largest norm of the forces within the elements so far.
// Rounding leaves about 1e-11; the last iteration squares what is left before it.
#define TOLERANCE 1e-9
// How often a step may be halved.
#define MAX_DEPTH 6

struct pm_beam {
    const pm_beam_mesh *mesh;
    pm_beam_material material;
    pm_beam_element *element;                 // [nelement]
    pm_beam_memory (*before)[PM_BEAM_POINTS]; // [nelement] at the last equilibrium
    pm_beam_memory (*after)[PM_BEAM_POINTS];  // [nelement] of the iteration
    double (*stress)[PM_SYMMETRIC];           // [nelement] of the iteration
    pm_beam_matrix *matrix;
    pm_beam_state now;
    double *f;          // [nnode][3] forces at the last equilibrium
    double *q;          // [nnode][3] of the iteration
    double *residual;   // [nnode][3] of the iteration; then its correction
    int *meeting;       // [nnode] elements that meet there
    double dissipation; // W, at the last equilibrium
    double largest;     // N, norm of the elements' forces
};

// --- life ---

static bool beam_alloc(pm_beam *beam) {
    const size_t nnode = (size_t)beam->mesh->nnode, nelement = (size_t)beam->mesh->nelement;
    beam->element = calloc(nelement, sizeof *beam->element);
    beam->before = calloc(nelement, sizeof *beam->before);
    beam->after = calloc(nelement, sizeof *beam->after);
    beam->stress = calloc(nelement, sizeof *beam->stress);
    beam->now.q = calloc(3 * nnode, sizeof *beam->now.q);
    beam->now.sigma = calloc(PM_SYMMETRIC * nnode, sizeof *beam->now.sigma);
    beam->f = calloc(3 * nnode, sizeof *beam->f);
    beam->q = calloc(3 * nnode, sizeof *beam->q);
    beam->residual = calloc(3 * nnode, sizeof *beam->residual);
    beam->meeting = calloc(nnode, sizeof *beam->meeting);
    return beam->element && beam->before && beam->after && beam->stress && beam->now.q &&
           beam->now.sigma && beam->f && beam->q && beam->residual && beam->meeting;
}

// corner [PM_BEAM_CORNERS][3]: the rows of an element's corners.
static void gather(const int *node, const double *from, double *corner) {
    for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
        memcpy(corner + 3 * c, from + 3 * node[c], 3 * sizeof *from);
    }
}

pm_status pm_beam_new(pm_beam **result, const pm_beam_mesh *mesh,
                      const pm_beam_material *material) {
    pm_beam *beam = calloc(1, sizeof *beam);
    if (beam == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    beam->mesh = mesh;
    beam->material = *material;
    if (!beam_alloc(beam)) {
        pm_beam_free(beam);
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    const pm_status status = pm_beam_matrix_new(&beam->matrix, mesh);
    if (status != PM_OK) {
        pm_beam_free(beam);
        return status;
    }
    for (int e = 0; e < mesh->nelement; ++e) {
        double x[PM_BEAM_FREEDOMS];
        gather(mesh->hexahedron[e], mesh->position[0], x);
        pm_beam_element_init(&beam->element[e], x);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            ++beam->meeting[mesh->hexahedron[e][c]];
        }
    }
    pm_beam_reset(beam);
    *result = beam;
    return PM_OK;
}

void pm_beam_free(pm_beam *beam) {
    if (beam != NULL) {
        pm_beam_matrix_free(beam->matrix);
        free(beam->element);
        free(beam->before);
        free(beam->after);
        free(beam->stress);
        free(beam->now.q);
        free(beam->now.sigma);
        free(beam->f);
        free(beam->q);
        free(beam->residual);
        free(beam->meeting);
        free(beam);
    }
}

void pm_beam_reset(pm_beam *beam) {
    const size_t nnode = (size_t)beam->mesh->nnode;
    memcpy(beam->now.q, beam->mesh->position, 3 * nnode * sizeof *beam->now.q);
    memset(beam->now.sigma, 0, PM_SYMMETRIC * nnode * sizeof *beam->now.sigma);
    memset(beam->f, 0, 3 * nnode * sizeof *beam->f);
    beam->now.stored = beam->now.dissipated = beam->now.work = 0;
    beam->dissipation = beam->largest = 0;
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

typedef struct totals {
    double stored, dissipation; // J, W
    double inner;               // N, norm of the elements' forces
} totals;

// The residual (loads less the elements' forces) and the matrix at beam->q. False if an element is
// turned inside out.
static bool assemble(pm_beam *beam, double h, const double *f, totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    double square = 0;
    *sum = (totals){0};
    memcpy(beam->residual, f, 3 * (size_t)mesh->nnode * sizeof *f);
    pm_beam_matrix_clear(beam->matrix);
    for (int e = 0; e < mesh->nelement; ++e) {
        const int *node = mesh->hexahedron[e];
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
        sum->stored += r.energy;
        sum->dissipation += r.dissipation;
    }
    sum->inner = sqrt(square);
    return true;
}

// Norm over the nodes that are free.
static double free_norm(const pm_beam *beam) {
    double square = 0;
    for (int i = 0; i < beam->mesh->nnode; ++i) {
        for (int d = 0; d < 3 && !pm_beam_mesh_clamped(beam->mesh, i); ++d) {
            square += beam->residual[3 * i + d] * beam->residual[3 * i + d];
        }
    }
    return sqrt(square);
}

// --- the step ---

// Iterates beam->q to equilibrium. False if that does not succeed.
static bool iterate(pm_beam *beam, double h, const double *f, totals *sum,
                    pm_beam_convergence *convergence) {
    memcpy(beam->q, beam->now.q, 3 * (size_t)beam->mesh->nnode * sizeof *beam->q);
    for (int k = 0; k < PM_BEAM_MAX_ITERATIONS; ++k) {
        if (!assemble(beam, h, f, sum)) {
            return false;
        }
        const double norm = free_norm(beam);
        convergence->residual[k] = norm;
        convergence->niteration = k + 1;
        beam->largest = fmax(beam->largest, sum->inner);
        if (norm <= TOLERANCE * beam->largest) {
            return true;
        }
        if (!isfinite(norm) || !pm_beam_matrix_solve(beam->matrix, beam->residual)) {
            return false;
        }
        for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
            beam->q[i] += beam->residual[i];
        }
    }
    return false;
}

static void average_stress(pm_beam *beam) {
    memset(beam->now.sigma, 0, PM_SYMMETRIC * (size_t)beam->mesh->nnode * sizeof *beam->now.sigma);
    for (int e = 0; e < beam->mesh->nelement; ++e) {
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            const int node = beam->mesh->hexahedron[e][c];
            for (int m = 0; m < PM_SYMMETRIC; ++m) {
                beam->now.sigma[PM_SYMMETRIC * node + m] +=
                    beam->stress[e][m] / beam->meeting[node];
            }
        }
    }
}

// Makes the iteration's result the state.
static void accept(pm_beam *beam, double h, const double *f, const totals *sum) {
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        beam->now.work += (beam->f[i] + f[i]) / 2 * (beam->q[i] - beam->now.q[i]);
    }
    beam->now.dissipated += h * (beam->dissipation + sum->dissipation) / 2;
    beam->now.stored = sum->stored;
    beam->dissipation = sum->dissipation;
    memcpy(beam->now.q, beam->q, 3 * (size_t)beam->mesh->nnode * sizeof *beam->q);
    memcpy(beam->f, f, 3 * (size_t)beam->mesh->nnode * sizeof *f);
    memcpy(beam->before, beam->after, (size_t)beam->mesh->nelement * sizeof *beam->before);
    average_stress(beam);
}

static pm_status step(pm_beam *beam, double h, const double *f, int depth,
                      pm_beam_convergence *convergence) {
    totals sum;
    if (iterate(beam, h, f, &sum, convergence)) {
        accept(beam, h, f, &sum);
        return PM_OK;
    }
    if (depth == MAX_DEPTH) {
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

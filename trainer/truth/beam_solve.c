// Newton's method on the bodies' nodes.
#include "truth/beam_solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "truth/beam_contact.h"
#include "truth/beam_matrix.h"

// Equilibrium: the residual's norm over the largest norm of the forces within the elements, now or
// at an equilibrium before.
// Rounding leaves about 1e-11; the last iteration squares what is left before it.
#define TOLERANCE 1e-9
// Or a way this short, by an element's length: under small loads rounding leaves more than that,
// and Newton's method squares this.
#define NEGLIGIBLE 1e-9
// Iterations after which care is taken: most steps need fewer, and full ones.
#define PATIENCE 6
// How often a step may be halved.
#define MAX_DEPTH 6

// A body in an iteration.
typedef struct body {
    double stored, dissipated; // J, now and in the step
} body;

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
    pm_beam_contact_force touch; // of the iteration
    pm_beam_state now;
    double *f;        // [nnode][3] forces at the last equilibrium
    double *q;        // [nnode][3] of the iteration
    double *pressed;  // [nnode][3] forces of contact, of the iteration
    double *residual; // [nnode][3] of the iteration
    double *way;      // [nnode][3] where Newton's method takes it from there
    body *body;       // [nbody] of the iteration
    int *meeting;     // [nnode] elements that meet there
    double largest;   // N, norm of the elements' forces
};

// --- life ---

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
    beam->pressed = pm_arena_array(arena, nnode, vector);
    beam->residual = pm_arena_array(arena, nnode, vector);
    beam->way = pm_arena_array(arena, nnode, vector);
    beam->body = pm_arena_array(arena, nbody, sizeof *beam->body);
    beam->meeting = pm_arena_array(arena, nnode, sizeof *beam->meeting);
    return beam->element && beam->before && beam->after && beam->stress && beam->now.q &&
           beam->now.sigma && beam->now.contact && beam->now.energy && beam->f && beam->q &&
           beam->pressed && beam->residual && beam->way && beam->body && beam->meeting;
}

// corner [PM_BEAM_CORNERS][3]: the rows of an element's corners.
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
            ++beam->meeting[mesh->hexahedron[e][c]];
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

typedef struct totals {
    double inner;          // N, norm of the elements' forces
    double contact_stored; // J
    double depth;          // m
} totals;

// Takes the elements' forces off the residual, and adds up what each body stores and dissipates.
// False if an element is turned inside out.
static bool add_elements(pm_beam *beam, double h, totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    double square = 0;
    memset(beam->body, 0, (size_t)mesh->nbody * sizeof *beam->body);
    for (int e = 0; e < mesh->nelement; ++e) {
        const int *node = mesh->hexahedron[e];
        body *owner = &beam->body[e / (mesh->nelement / mesh->nbody)];
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

// False: out of memory.
static bool add_contact(pm_beam *beam, bool exact, totals *sum) {
    const pm_beam_contact *contact = &beam->contact;
    pm_beam_contact_force *touch = &beam->touch;
    for (int i = 0; i < contact->ncandidate; ++i) {
        if (pm_beam_contact_respond(contact, &contact->candidate[i], beam->q, exact, touch)) {
            for (int k = 0; k < 3 * touch->nnode; ++k) {
                beam->pressed[3 * touch->node[k / 3] + k % 3] += touch->force[k / 3][k % 3];
            }
            sum->contact_stored += touch->energy;
            sum->depth = fmax(sum->depth, touch->depth);
            if (!pm_beam_matrix_couple(beam->matrix, touch->nnode, touch->node, touch->stiffness)) {
                return false;
            }
        }
    }
    return true;
}

// The residual (loads and contact less the elements' forces) and the matrix at beam->q, with the
// `exact` stiffness of contact or not.
static bool assemble(pm_beam *beam, double h, const double *f, bool exact, totals *sum) {
    const size_t size = 3 * (size_t)beam->mesh->nnode * sizeof *f;
    *sum = (totals){0};
    memset(beam->pressed, 0, size);
    pm_beam_matrix_clear(beam->matrix);
    if (!add_contact(beam, exact, sum)) {
        return false;
    }
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        beam->residual[i] = f[i] + beam->pressed[i];
    }
    return add_elements(beam, h, sum);
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

static bool solve(pm_beam *beam) {
    memcpy(beam->way, beam->residual, 3 * (size_t)beam->mesh->nnode * sizeof *beam->way);
    return pm_beam_matrix_solve(beam->matrix, beam->way);
}

// Finds the way. Where bodies have come to lie deep in each other, or slip off each other, the
// exact matrix may not be positive definite; then the other one leads on.
static bool find_way(pm_beam *beam, double h, const double *f, totals *sum) {
    return solve(beam) || (sum->depth > 0 && assemble(beam, h, f, false, sum) && solve(beam));
}

static void move(pm_beam *beam, double part) {
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        beam->q[i] += part * beam->way[i];
    }
}

// How hard the residual draws along the way, J.
static double draw(const pm_beam *beam) {
    double sum = 0;
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        sum += beam->residual[i] * beam->way[i];
    }
    return sum;
}

// Goes the way and assembles there. `careful`: not so far that the residual would draw back half as
// hard; parts by the secant.
static bool advance(pm_beam *beam, double h, const double *f, bool careful, totals *sum) {
    const int most = 8;
    const double before = draw(beam);
    double part = 1;
    move(beam, part);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < most && careful; ++k) {
        const double now = good ? draw(beam) : -INFINITY;
        if (now >= -before / 2) {
            return true;
        }
        const double next = part * fmin(fmax(before / (before - now), 0.1), 0.5);
        move(beam, next - part);
        part = next;
        good = assemble(beam, h, f, true, sum);
    }
    return good;
}

static bool way_is_short(const pm_beam *beam) {
    const double most = NEGLIGIBLE * beam->mesh->size[0] / beam->mesh->count[0];
    double longest = 0;
    for (int i = 0; i < 3 * beam->mesh->nnode; ++i) {
        longest = fmax(longest, fabs(beam->way[i]));
    }
    return longest <= most;
}

// Iterates beam->q to equilibrium. False if that does not succeed.
static bool iterate(pm_beam *beam, double h, const double *f, totals *sum,
                    pm_beam_convergence *convergence) {
    memcpy(beam->q, beam->now.q, 3 * (size_t)beam->mesh->nnode * sizeof *beam->q);
    bool good = assemble(beam, h, f, true, sum);
    for (int k = 0; k < PM_BEAM_MAX_ITERATIONS && good; ++k) {
        const double norm = free_norm(beam);
        convergence->residual[k] = norm;
        convergence->niteration = k + 1;
        if (norm <= TOLERANCE * fmax(beam->largest, sum->inner) || (k > 0 && way_is_short(beam))) {
            return true;
        }
        good =
            isfinite(norm) && find_way(beam, h, f, sum) && advance(beam, h, f, k >= PATIENCE, sum);
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
static void accept(pm_beam *beam, const double *f, const totals *sum) {
    const pm_beam_mesh *mesh = beam->mesh;
    const size_t size = 3 * (size_t)mesh->nnode * sizeof *f;
    pm_beam_state *now = &beam->now;
    for (int i = 0; i < 3 * mesh->nnode; ++i) {
        pm_beam_energy *energy = &now->energy[i / (3 * mesh->nnode / mesh->nbody)];
        const double way = beam->q[i] - now->q[i];
        energy->work += (beam->f[i] + f[i]) / 2 * way;
        energy->contact_work += (now->contact[i] + beam->pressed[i]) / 2 * way;
    }
    for (int b = 0; b < mesh->nbody; ++b) {
        now->energy[b].dissipated += beam->body[b].dissipated;
        now->energy[b].stored = beam->body[b].stored;
    }
    beam->largest = fmax(beam->largest, sum->inner);
    now->contact_stored = sum->contact_stored;
    now->depth = sum->depth;
    memcpy(now->q, beam->q, size);
    memcpy(now->contact, beam->pressed, size);
    memcpy(beam->f, f, size);
    memcpy(beam->before, beam->after, (size_t)mesh->nelement * sizeof *beam->before);
    average_stress(beam);
}

static pm_status step(pm_beam *beam, double h, const double *f, int depth,
                      pm_beam_convergence *convergence) {
    totals sum;
    if (iterate(beam, h, f, &sum, convergence)) {
        accept(beam, f, &sum);
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

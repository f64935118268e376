// Steps of a solid: the balance of forces, and the books of energy and heat.
#include "sim/solid_dynamics.h"

#include <math.h>
#include <string.h>

#include "sim/lanes.h"

// In contact a balance ends at moves shorter than this share of the largest displacement, since the
// gap multiplies them by its stiffness.
#define PRECISE_IN_CONTACT 1e-11
// A heat above minus this share of the work counts as zero: rounding.
#define ROUNDING 1e-14
// The times that a move is shortened because the heat would be negative.
#define MOST_SHORTER 8
// The first shortening aims at this many times the missing heat: how the heat depends on the length
// of the move is only estimated.
#define CAUTION 1.1

// --- opening ---

static int first_of(const pm_layout *layout, const char *name) {
    const pm_group *group = pm_layout_find(layout, name);
    return group == NULL ? -1 : group->first;
}

pm_status pm_solid_dynamics_open(pm_solid_dynamics *d, pm_arena *arena, const pm_part *part,
                                 const pm_solid_mesh *mesh) {
    const pm_layout *layout = &part->layout;
    *d = (pm_solid_dynamics){.layout = *layout,
                             .nnode = mesh->nnode,
                             .u = first_of(layout, "u"),
                             .p = first_of(layout, "p"),
                             .inner = first_of(layout, "inner"),
                             .sigma = first_of(layout, "sigma"),
                             .s = first_of(layout, "s"),
                             .contact = first_of(layout, "contact"),
                             .ncontact = mesh->ncontact,
                             .contact_node = mesh->contact,
                             .temperature = part->spec.solid->temperature};
    pm_solid_material_read(part->spec.solid, &part->params, &d->material);
    const size_t nz = (size_t)d->layout.nz, n = 3 * (size_t)d->nnode;
    double *memory = pm_arena_array(arena, 4 * nz + 3 * n, sizeof *memory);
    PM_TRY(pm_arena_status(arena, "a solid"));
    d->dE = memory;
    d->dS = memory + nz;
    d->result = memory + 2 * nz;
    d->end_rate = memory + 3 * nz;
    d->mean = memory + 4 * nz;
    d->end = d->mean + n;
    d->work = d->mean + 2 * n;
    d->dE[d->s] = d->temperature;
    d->dS[d->s] = 1;
    return pm_solid_open(&d->solid, mesh, &d->material);
}

void pm_solid_dynamics_close(pm_solid_dynamics *d) {
    pm_solid_close(d->solid);
    d->solid = NULL;
}

// --- states ---

static const double *inner_of(const pm_solid_dynamics *d, const double *z) {
    return d->inner < 0 ? NULL : z + d->inner;
}

// Writes the body's state to d->result; the entropy is not known yet.
static void take_result(pm_solid_dynamics *d) {
    const size_t n = 3 * (size_t)d->nnode;
    memcpy(d->result + d->u, pm_solid_displacement(d->solid), n * sizeof *d->result);
    memset(d->result + d->p, 0, n * sizeof *d->result);
    if (d->contact >= 0) {
        memset(d->result + d->contact, 0, 3 * (size_t)d->ncontact * sizeof *d->result);
    }
    if (d->inner >= 0) {
        memcpy(d->result + d->inner, pm_solid_inner(d->solid),
               (size_t)pm_solid_ninner(d->solid) * sizeof *d->result);
    }
    if (d->sigma >= 0) {
        pm_solid_stress(d->solid, d->result + d->sigma);
    }
}

void pm_solid_dynamics_start(pm_solid_dynamics *d, const double *z) {
    d->solved = false;
    d->status = PM_OK;
    if (!pm_solid_set_state(d->solid, z + d->u, inner_of(d, z))) {
        d->status = pm_fail(PM_ENUMERIC, "an element of a solid is turned inside out at the start");
    }
}

void pm_solid_dynamics_expose(pm_solid_dynamics *d, const double *z, const double *from, double h) {
    for (int i = 0; i < 3 * d->nnode; ++i) {
        d->dE[d->p + i] = (z[d->u + i] - from[d->u + i]) / h;
    }
    for (int i = 0; d->contact >= 0 && i < 3 * d->ncontact; ++i) {
        d->dE[d->contact + i] = d->dE[d->p + 3 * d->contact_node[i / 3] + i % 3];
    }
    d->S = z[d->s];
    d->E = pm_solid_books_of(d->solid)->stored + d->temperature * d->S;
}

// --- a step ---

// Returns the heat in J of a move from the state z, whose stored energy is `stored`, to the body's
// present state. *work becomes the work of the ports.
static double heat_of(const pm_solid_dynamics *d, const double *z, double stored, double *work) {
    const double *u = pm_solid_displacement(d->solid);
    *work = 0;
    for (int i = 0; i < 3 * d->nnode; ++i) {
        *work += d->mean[i] * (u[i] - z[d->u + i]);
    }
    return *work - (pm_solid_books_of(d->solid)->stored - stored);
}

// Moves the body less far, to where the heat is not negative. `move` [nnode][3] becomes the whole
// move from z. Returns the heat.
static double move_less(pm_solid_dynamics *d, double h, const double *z, double stored, double heat,
                        double *move) {
    const double *u = pm_solid_displacement(d->solid);
    double work;
    for (int i = 0; i < 3 * d->nnode; ++i) {
        move[i] = u[i] - z[d->u + i];
    }
    // The share of the move at which the heat becomes zero, to first order: with the balance at the
    // end of the step the heat falls along the move by (end - mean).move, J.
    double slope = 0;
    for (int i = 0; i < 3 * d->nnode; ++i) {
        slope += (d->end[i] - d->mean[i]) * move[i];
    }
    double share = 1 + CAUTION * heat / slope;
    share = slope > 0 && share > 0 ? share : 0;
    for (int k = 0; k <= MOST_SHORTER && heat < 0; ++k) {
        double *to = d->result + d->u;
        share = k == MOST_SHORTER ? 0 : share;
        for (int i = 0; i < 3 * d->nnode; ++i) {
            to[i] = z[d->u + i] + share * move[i];
        }
        pm_solid_return(d->solid, z + d->u, inner_of(d, z));
        pm_solid_follow(d->solid, h, to, NULL);
        heat = heat_of(d, z, stored, &work);
        share /= 2;
    }
    return fmax(heat, 0);
}

// Books the heat of the move to the body's present state, and keeps the state.
static void book(pm_solid_dynamics *d, double h, const double *z) {
    double work, heat = heat_of(d, z, d->stored, &work);
    if (heat < 0) {
        heat = heat >= -ROUNDING * (fabs(work) + d->stored)
                   ? 0
                   : move_less(d, h, z, d->stored, heat, d->result + d->p);
    }
    take_result(d);
    d->result[d->s] = z[d->s] + heat / d->temperature;
}

// Finds the balance at the end of the substep, and books the heat.
static bool solve(pm_solid_dynamics *d, double h, const double *z) {
    const size_t n = 3 * (size_t)d->nnode;
    if (d->contact >= 0) {
        memcpy(d->work, d->result + d->u, n * sizeof *d->work);
        pm_solid_aim(d->solid, d->solved ? d->work : NULL, PRECISE_IN_CONTACT);
    }
    if (d->solved && !pm_solid_return(d->solid, z + d->u, inner_of(d, z))) {
        return false;
    }
    if (!d->solved) {
        d->stored = pm_solid_books_of(d->solid)->stored;
    }
    d->solved = true;
    d->status = pm_solid_step(d->solid, h, d->end);
    if (d->status != PM_OK) {
        memcpy(d->result, z, (size_t)d->layout.nz * sizeof *z);
        return false;
    }
    book(d, h, z);
    return true;
}

// Adds up the forces on the nodes that follow from rates.
static const double *gather(const pm_solid_dynamics *d, const double *rate) {
    memcpy(d->work, rate + d->p, 3 * (size_t)d->nnode * sizeof *d->work);
    for (int i = 0; d->contact >= 0 && i < 3 * d->ncontact; ++i) {
        d->work[3 * d->contact_node[i / 3] + i % 3] += rate[d->contact + i];
    }
    return d->work;
}

bool pm_solid_dynamics_balance(pm_solid_dynamics *d, double h, const double *z,
                               const double *mean) {
    const int n = 3 * d->nnode;
    const bool booked = !pm_renew(d->mean, gather(d, mean), n) && d->solved;
    const bool solved = !pm_renew(d->end, gather(d, d->end_rate), n) && d->solved;
    d->changed = !solved || !booked;
    if (solved && !booked && d->status == PM_OK) {
        book(d, h, z);
    }
    return solved || solve(d, h, z);
}

void pm_solid_dynamics_end_substep(pm_solid_dynamics *d) {
    d->solved = false;
}

void pm_solid_dynamics_record(pm_solid_dynamics *d, pm_serializer *serializer) {
    const int n = 3 * d->nnode;
    pm_serializer_put(serializer, "mean force", d->mean, n);
    pm_serializer_put(serializer, "end force", d->end, n);
    pm_solid_record(d->solid, serializer);
}

// Reads trajectories, projects them on modes, and integrates the internal variables.
#include "modal/modal_trajectory.h"

#include <string.h>

#include "base/linalg.h"

pm_status pm_modal_trajectory_open(pm_modal_trajectory *p, const pm_field *field, int nmode,
                                   int nbranch, pm_load_kind loads, bool stress) {
    *p = (pm_modal_trajectory){.ntime = field->ntime,
                               .nmode = nmode,
                               .nbranch = nbranch,
                               .nnode = field->nnode,
                               .loads = loads,
                               .q = pm_field_columns(field, "qx qy qz"),
                               .sigma = stress ? pm_field_columns(field, "sxx syy szz sxy sxz syz")
                                               : -1};
    if (p->q < 0) {
        return pm_fail(PM_EDATA, "the field has no positions \"qx qy qz\" among \"%s\"",
                       field->variable);
    }
    const size_t ntime = (size_t)p->ntime, width = 3 * (size_t)p->nnode;
    p->u = pm_arena_array(&p->arena, ntime * width, sizeof *p->u);
    p->f = pm_arena_array(&p->arena, ntime * width, sizeof *p->f);
    p->a = pm_arena_array(&p->arena, ntime * (size_t)nmode, sizeof *p->a);
    p->load = pm_arena_array(&p->arena, ntime * (size_t)nmode, sizeof *p->load);
    p->c = pm_arena_array(&p->arena, ((size_t)nbranch * ntime + 1) * (size_t)nmode, sizeof *p->c);
    p->delayed =
        pm_arena_array(&p->arena, ((size_t)nbranch * ntime + 1) * (size_t)nmode, sizeof *p->c);
    p->moved = pm_arena_array(&p->arena, width, sizeof *p->moved);
    if (p->sigma >= 0) {
        p->stress = pm_arena_array(&p->arena, 2 * ntime * width, sizeof *p->stress);
    }
    if (p->u == NULL || p->f == NULL || p->a == NULL || p->load == NULL || p->c == NULL ||
        p->delayed == NULL || p->moved == NULL || (p->sigma >= 0 && p->stress == NULL)) {
        pm_modal_trajectory_close(p);
        return pm_fail(PM_ENOMEM, "out of memory for a body's trajectory");
    }
    return PM_OK;
}

void pm_modal_trajectory_close(pm_modal_trajectory *modal) {
    pm_arena_free(&modal->arena);
}

// Sets the loads on clamped nodes to zero, since they have no effect. A node is taken to be clamped
// if it never moves.
static void drop_clamped_loads(const pm_modal_trajectory *p) {
    for (int i = 0; i < p->nnode; ++i) {
        bool moves = false;
        for (int j = 0; j < p->ntime && !moves; ++j) {
            const double *u = p->u + 3 * ((ptrdiff_t)j * p->nnode + i);
            moves = u[0] != 0 || u[1] != 0 || u[2] != 0;
        }
        for (int j = 0; j < p->ntime && !moves; ++j) {
            memset(p->f + 3 * ((ptrdiff_t)j * p->nnode + i), 0, 3 * sizeof *p->f);
        }
    }
}

// Adds the contact forces at a time to f [nnode][3], N.
static void add_contact(pm_modal_trajectory *p, const pm_field *field, int trajectory, int time,
                        const pm_copy *copy, double *f) {
    pm_copy_vectors(copy, p->nnode, pm_field_contact(field, trajectory, time), 3, p->moved);
    for (int i = 0; i < 3 * p->nnode; ++i) {
        f[i] += p->moved[i];
    }
}

void pm_modal_trajectory_read(pm_modal_trajectory *p, const pm_field *field, int trajectory,
                              const pm_copy *copy) {
    const ptrdiff_t width = 3 * (ptrdiff_t)p->nnode;
    for (int j = 0; j < p->ntime; ++j) {
        const double *state = pm_field_state(field, trajectory, j);
        // Displacements are computed before they are copied, since a copy of positions would move
        // their origin.
        for (int i = 0; i < p->nnode; ++i) {
            const double *q = state + (ptrdiff_t)i * field->nvariable + p->q;
            for (int d = 0; d < 3; ++d) {
                p->moved[3 * i + d] = q[d] - field->position[3 * i + d];
            }
        }
        pm_copy_vectors(copy, p->nnode, p->moved, 3, p->u + j * width);
        pm_copy_vectors(copy, p->nnode, pm_field_force(field, trajectory, j), 3, p->f + j * width);
        if (p->loads == PM_LOADS_OF_ALL && field->contact != NULL) {
            add_contact(p, field, trajectory, j, copy, p->f + j * width);
        }
        if (p->stress != NULL) {
            pm_copy_tensors(copy, p->nnode, state + p->sigma, field->nvariable,
                            p->stress + 2 * j * width);
        }
    }
    drop_clamped_loads(p);
}

// Integrates dy/dt = (x - y)/tau for x [ntime][nmode]. The values y at successive times are
// `stride` numbers apart.
static void integrate(const pm_modal_trajectory *p, const double *x, double tau, double dt,
                      int stride, double *y) {
    const size_t row = (size_t)p->nmode * sizeof *y;
    memcpy(y, x, row);
    for (int j = 1; j < p->ntime; ++j, x += p->nmode, y += stride) {
        memcpy(y + stride, y, row);
        pm_basis_relax(p->nmode, tau, dt, x, x + p->nmode, y + stride);
    }
}

void pm_modal_trajectory_project(pm_modal_trajectory *p, const pm_basis *basis, double dt) {
    const int width = 3 * p->nnode;
    pm_gemm(false, true, p->ntime, p->nmode, width, p->u, basis->mode, p->a);
    pm_gemm(false, true, p->ntime, p->nmode, width, p->f, basis->mode, p->load);
    for (int j = 0; j < p->ntime; ++j) {
        for (int i = 0; i < p->nmode; ++i) {
            p->a[(ptrdiff_t)j * p->nmode + i] *= basis->stiffness[i];
        }
    }
    for (int k = 0; k < p->nbranch; ++k) {
        integrate(p, p->a, basis->tau[k], dt, p->nmode, p->c + (ptrdiff_t)k * p->ntime * p->nmode);
    }
    for (int k = 0; k < basis->nretardation; ++k) {
        integrate(p, p->load, basis->retardation[k], dt, basis->nretardation * p->nmode,
                  p->delayed + (ptrdiff_t)k * p->nmode);
    }
}

void pm_modal_trajectory_state(const pm_modal_trajectory *p, const pm_basis *b, int time, double *c,
                               pm_modal_state *r) {
    const ptrdiff_t at = (ptrdiff_t)time * p->nmode;
    for (int k = 0; k < b->nbranch; ++k) {
        memcpy(c + (ptrdiff_t)k * b->nstate, p->c + (ptrdiff_t)k * p->ntime * p->nmode + at,
               (size_t)b->nstate * sizeof *c);
    }
    *r = (pm_modal_state){
        .a = p->a + at, .c = c, .load = p->load + at, .delayed = p->delayed + at * b->nretardation};
}

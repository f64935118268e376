// Computes contact forces from openings, and compares their sum with that of the ground truth.
#include "modal/contact_force.h"

#include <math.h>

// Finds the end whose body has no other interface, so that its contact forces are those of this
// one.
static pm_status find_single_end(const pm_body_assembly *a, const pm_contact_interface *m,
                                 const pm_field *const *field, int *end) {
    for (*end = 0; *end < 2; ++*end) {
        const int body = m->body[*end];
        int count = 0;
        for (int i = 0; i < a->ninterface; ++i) {
            count += a->interface[i].body[0] == body || a->interface[i].body[1] == body;
        }
        if (count == 1 && field[body]->contact != NULL) {
            return PM_OK;
        }
    }
    return pm_fail(PM_EDATA,
                   "neither %s nor %s has contact forces, and those with the other body alone",
                   a->body[m->body[0]].name, a->body[m->body[1]].name);
}

// Returns the opening of a pair, m; `value` [PM_CONTACT_GROUPS][npair].
static double opening_of(const double *value, int npair, int pair) {
    const double *v = value + pair;
    return v[PM_CONTACT_GAP * npair] +
           v[PM_CONTACT_SLID_U * npair] * v[PM_CONTACT_SLOPE_U * npair] +
           v[PM_CONTACT_SLID_V * npair] * v[PM_CONTACT_SLOPE_V * npair];
}

// Returns the total normal force of an interface in a row, N.
static double force_of_openings(const pm_contact_openings *o, double stiffness, const double *row) {
    const double *value = pm_contact_openings_compute(o, row);
    const int n = o->interface->pairs.npair;
    double force = 0;
    for (int i = 0; i < n; ++i) {
        force -= stiffness * fmin(opening_of(value, n, i), 0);
    }
    return force;
}

// Returns the total contact force of the truth along the normal, N; positive if it pushes the
// bodies apart.
static double force_of_field(const pm_placed_body *body, const pm_contact_interface *m, int end,
                             const pm_field *field, int trajectory, int time) {
    const double *f = pm_field_contact(field, trajectory, time);
    const double *normal = m->pairs.pair[0].normal;
    double force = 0, own[3];
    pm_placement_rotate_back(&body->placement, normal, own);
    for (int i = 0; i < 3 * field->nnode; ++i) {
        force += f[i] * own[i % 3];
    }
    return end == 0 ? -force : force;
}

// --- on the nodes of a body ---

pm_status pm_contact_force_open(pm_contact_force *force, const pm_body_assembly *a, int body,
                                const pm_dataset *modes, const double *stiffness, pm_arena *arena) {
    int most = 0;
    *force = (pm_contact_force){.assembly = a, .body = body, .stiffness = stiffness};
    force->openings = pm_arena_array(arena, (size_t)a->ninterface, sizeof *force->openings);
    for (int i = 0; i < a->ninterface; ++i) {
        most = a->interface[i].pairs.npair > most ? a->interface[i].pairs.npair : most;
    }
    force->effort = pm_arena_array(arena, PM_CONTACT_GROUPS * (size_t)most, sizeof *force->effort);
    if (force->openings == NULL || force->effort == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for contact forces");
    }
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        if (m->body[0] == body || m->body[1] == body) {
            PM_TRY(pm_contact_openings_open(&force->openings[i], a, m, modes, arena));
        }
    }
    return PM_OK;
}

// Computes the derivatives of stiffness/2 min(x, 0)^2, where x is the opening, by the quantities.
static void fill_effort(const pm_contact_force *force, int interface, const double *row) {
    const double *value = pm_contact_openings_compute(&force->openings[interface], row);
    const int n = force->assembly->interface[interface].pairs.npair;
    for (int i = 0; i < n; ++i) {
        const double slope = force->stiffness[interface] * fmin(opening_of(value, n, i), 0);
        force->effort[PM_CONTACT_GAP * n + i] = slope;
        for (int t = 0; t < 2; ++t) {
            const int slid = PM_CONTACT_SLID_U + t, slopes = PM_CONTACT_SLOPE_U + t;
            force->effort[slid * n + i] = slope * value[slopes * n + i];
            force->effort[slopes * n + i] = slope * value[slid * n + i];
        }
    }
}

void pm_contact_force_add(const pm_contact_force *force, const double *row, double *f) {
    const pm_body_assembly *a = force->assembly;
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        for (int end = 0; end < 2; ++end) {
            if (m->body[end] == force->body) {
                fill_effort(force, i, row);
                pm_contact_pairs_add_forces(&m->pairs, end, &a->body[force->body], force->effort,
                                            f);
            }
        }
    }
}

// --- the total force ---

// Computes the error of every trajectory.
static void compare_forces(const pm_body_assembly *a, const pm_contact_openings *o, int end,
                           const pm_dataset *modes, double stiffness, const pm_field *truth,
                           const int *trajectory, double *error) {
    const pm_contact_interface *m = o->interface;
    for (int i = 0; i < modes->ntrajectory; ++i) {
        double off = 0, whole = 0;
        for (int j = 0; j < modes->ntime; ++j) {
            const double force = force_of_openings(o, stiffness, pm_dataset_state(modes, i, j));
            const double expected =
                force_of_field(&a->body[m->body[end]], m, end, truth, trajectory[i], j);
            off += (force - expected) * (force - expected);
            whole += expected * expected;
        }
        error[i] = whole > 0 ? sqrt(off / whole) : NAN;
    }
}

pm_status pm_contact_force_errors(const pm_body_assembly *a, const pm_contact_interface *m,
                                  const pm_dataset *modes, double stiffness,
                                  const pm_field *const *field, const int *trajectory,
                                  double *error) {
    pm_arena arena = {0};
    pm_contact_openings openings;
    int end = 0;
    pm_status status;
    PM_TRY_DONE(pm_contact_openings_open(&openings, a, m, modes, &arena));
    PM_TRY_DONE(pm_body_assembly_check(a, field));
    PM_TRY_DONE(find_single_end(a, m, field, &end));
    const pm_field *truth = field[m->body[end]];
    if (modes->ntime != truth->ntime) {
        status = pm_fail(PM_EDATA, "the dataset has %d states, the fields %d", modes->ntime,
                         truth->ntime);
        goto done;
    }
    compare_forces(a, &openings, end, modes, stiffness, truth, trajectory, error);
done:
    pm_arena_free(&arena);
    return status;
}

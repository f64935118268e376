// Forces of contact: on the nodes, and in all against those of the truth.
#include <math.h>

#include "modal/body_assembly.h"

// The end whose body meets nobody else.
static pm_status find_lone_end(const pm_body_assembly *a, const pm_contact_interface *m,
                               const pm_field *const *field, int *end) {
    for (*end = 0; *end < 2; ++*end) {
        const int body = m->body[*end];
        int count = 0;
        for (int i = 0; i < a->ncontact; ++i) {
            count += a->meeting[i].body[0] == body || a->meeting[i].body[1] == body;
        }
        if (count == 1 && field[body]->contact != NULL) {
            return PM_OK;
        }
    }
    return pm_fail(PM_EDATA, "neither %s nor %s has forces of contact with the other alone",
                   a->body[m->body[0]].name, a->body[m->body[1]].name);
}

// How far the points of a pair are apart; `value` [PM_CONTACT_GROUPS][npair].
static double opening_of(const double *value, int npair, int pair) {
    const double *v = value + pair;
    return v[PM_CONTACT_GAP * npair] +
           v[PM_CONTACT_SLID_U * npair] * v[PM_CONTACT_SLOPE_U * npair] +
           v[PM_CONTACT_SLID_V * npair] * v[PM_CONTACT_SLOPE_V * npair];
}

static double force_of_openings(const pm_openings *o, double stiffness, const double *row) {
    const double *value = pm_openings_at(o, row);
    const int n = o->meeting->facing.npair;
    double force = 0;
    for (int i = 0; i < n; ++i) {
        force -= stiffness * fmin(opening_of(value, n, i), 0);
    }
    return force;
}

// Of the truth, along the normal, positive where it pushes the bodies apart.
static double force_of_field(const pm_placed *body, const pm_contact_interface *m, int end,
                             const pm_field *field, int trajectory, int time) {
    const double *f = pm_field_contact(field, trajectory, time);
    const double *normal = m->facing.pair[0].normal;
    double force = 0;
    for (int i = 0; i < 3 * field->nnode; ++i) {
        const double *axis = body->axis[i % 3];
        force += f[i] * (normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2]);
    }
    return end == 0 ? -force : force;
}

// --- on the nodes of a body ---

pm_status pm_contact_force_open(pm_contact_force *touch, const pm_body_assembly *a, int body,
                                const pm_dataset *modes, double stiffness, pm_arena *arena) {
    int most = 0;
    *touch = (pm_contact_force){.assembly = a, .body = body, .stiffness = stiffness};
    touch->openings = pm_arena_array(arena, (size_t)a->ncontact, sizeof *touch->openings);
    for (int i = 0; i < a->ncontact; ++i) {
        most = a->meeting[i].facing.npair > most ? a->meeting[i].facing.npair : most;
    }
    touch->effort = pm_arena_array(arena, PM_CONTACT_GROUPS * (size_t)most, sizeof *touch->effort);
    if (touch->openings == NULL || touch->effort == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for forces of contact");
    }
    for (int i = 0; i < a->ncontact; ++i) {
        const pm_contact_interface *m = &a->meeting[i];
        if (m->body[0] == body || m->body[1] == body) {
            PM_TRY(pm_openings_open(&touch->openings[i], a, m, modes, arena));
        }
    }
    return PM_OK;
}

// The derivatives of stiffness/2 min(x,0)^2, x the opening, by the groups.
static void fill_effort(const pm_contact_force *touch, int meeting, const double *row) {
    const double *value = pm_openings_at(&touch->openings[meeting], row);
    const int n = touch->assembly->meeting[meeting].facing.npair;
    for (int i = 0; i < n; ++i) {
        const double slope = touch->stiffness * fmin(opening_of(value, n, i), 0);
        touch->effort[PM_CONTACT_GAP * n + i] = slope;
        for (int t = 0; t < 2; ++t) {
            const int slid = PM_CONTACT_SLID_U + t, slopes = PM_CONTACT_SLOPE_U + t;
            touch->effort[slid * n + i] = slope * value[slopes * n + i];
            touch->effort[slopes * n + i] = slope * value[slid * n + i];
        }
    }
}

void pm_contact_force_add_forces(const pm_contact_force *touch, const double *row, double *f) {
    const pm_body_assembly *a = touch->assembly;
    for (int i = 0; i < a->ncontact; ++i) {
        const pm_contact_interface *m = &a->meeting[i];
        for (int end = 0; end < 2; ++end) {
            if (m->body[end] == touch->body) {
                fill_effort(touch, i, row);
                pm_contact_pairs_add_forces(&m->facing, end, &a->body[touch->body], touch->effort,
                                            f);
            }
        }
    }
}

// --- in all ---

static void compare_forces(const pm_body_assembly *a, const pm_openings *o, int end,
                           const pm_dataset *modes, double stiffness, const pm_field *truth,
                           const int *trajectory, double *error) {
    const pm_contact_interface *m = o->meeting;
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

pm_status pm_contact_interface_force_errors(const pm_body_assembly *a,
                                            const pm_contact_interface *m, const pm_dataset *modes,
                                            double stiffness, const pm_field *const *field,
                                            const int *trajectory, double *error) {
    pm_arena arena = {0};
    pm_openings openings;
    int end = 0;
    pm_status status;
    PM_TRY_DONE(pm_openings_open(&openings, a, m, modes, &arena));
    PM_TRY_DONE(pm_body_assembly_check(a, field));
    PM_TRY_DONE(find_lone_end(a, m, field, &end));
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

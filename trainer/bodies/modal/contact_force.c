// Computes contact forces from openings, and compares their sum with that of the ground truth.
#include "bodies/modal/contact_force.h"

#include <math.h>
#include <string.h>

// Finds the first of `count` columns of a group of the interface; the others follow it.
static pm_status find_group(const pm_body_assembly *a, const pm_contact_interface *m,
                            const pm_dataset *d, const char *group, int count, pm_arena *arena,
                            int *first) {
    const char *name = pm_arena_printf(arena, "%s_%s_%s0", a->body[m->body[0]].name,
                                       a->body[m->body[1]].name, group);
    PM_TRY(pm_arena_status(arena, "the name of a column"));
    *first = 0;
    while (*first < d->ncolumn && strcmp(d->column[*first], name) != 0) {
        ++*first;
    }
    return *first + count <= d->ncolumn
               ? PM_OK
               : pm_fail(PM_EDATA, "the dataset has no columns from \"%s\" on", name);
}

pm_status pm_contact_openings_open(pm_contact_openings *o, const pm_body_assembly *a,
                                   const pm_contact_interface *m, const pm_dataset *modes,
                                   pm_arena *arena) {
    const size_t count = PM_CONTACT_GROUPS * (size_t)m->pairs.npair;
    *o = (pm_contact_openings){.interface = m};
    o->value = pm_arena_array(arena, count, sizeof *o->value);
    for (int end = 0; end < 2; ++end) {
        o->size[end] = pm_body_assembly_size(a, m->body[end]);
        o->matrix[end] = pm_arena_array(arena, count * (size_t)o->size[end], sizeof(double));
        PM_TRY(pm_arena_status(arena, "openings"));
        PM_TRY(pm_contact_interface_matrix(a, m, end, o->matrix[end]));
        PM_TRY(find_group(a, m, modes, a->body[m->body[end]].name, o->size[end], arena,
                          &o->travel[end]));
    }
    return find_group(a, m, modes, "creep", m->pairs.npair, arena, &o->creep);
}

const double *pm_contact_openings_compute(const pm_contact_openings *o, const double *row) {
    const int n = o->interface->pairs.npair;
    for (int i = 0; i < PM_CONTACT_GROUPS * n; ++i) {
        double sum = i < n ? o->interface->pairs.pair[i].gap + row[o->creep + i] : 0;
        for (int end = 0; end < 2; ++end) {
            for (int k = 0; k < o->size[end]; ++k) {
                sum += o->matrix[end][(ptrdiff_t)i * o->size[end] + k] * row[o->travel[end] + k];
            }
        }
        o->value[i] = sum;
    }
    return o->value;
}

// Returns the opening of a pair, m; `value` [PM_CONTACT_GROUPS][npair].
static double opening_of(const double *value, int npair, int pair) {
    const double *v = value + pair;
    return v[PM_CONTACT_GAP * npair] +
           v[PM_CONTACT_SLID_U * npair] * v[PM_CONTACT_SLOPE_U * npair] +
           v[PM_CONTACT_SLID_V * npair] * v[PM_CONTACT_SLOPE_V * npair];
}

pm_status pm_contact_force_open(pm_contact_force *force, const pm_body_assembly *a, int body,
                                const pm_dataset *modes, const double *stiffness, pm_arena *arena) {
    int most = 0;
    *force = (pm_contact_force){.assembly = a, .body = body, .stiffness = stiffness};
    force->openings = pm_arena_array(arena, (size_t)a->ninterface, sizeof *force->openings);
    for (int i = 0; i < a->ninterface; ++i) {
        most = a->interface[i].pairs.npair > most ? a->interface[i].pairs.npair : most;
    }
    force->effort = pm_arena_array(arena, PM_CONTACT_GROUPS * (size_t)most, sizeof *force->effort);
    PM_TRY(pm_arena_status(arena, "contact forces"));
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        if (m->body[0] == body || m->body[1] == body) {
            PM_TRY(pm_contact_openings_open(&force->openings[i], a, m, modes, arena));
        }
    }
    return PM_OK;
}

void pm_contact_force_add(const pm_contact_force *force, const double *row, double *f) {
    const pm_body_assembly *a = force->assembly;
    double *effort = force->effort;
    for (int i = 0; i < 2 * a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i / 2];
        if (m->body[i % 2] != force->body) {
            continue;
        }
        // The derivatives of stiffness/2 min(x, 0)^2, where x is the opening, by the quantities.
        const double *value = pm_contact_openings_compute(&force->openings[i / 2], row);
        const int n = m->pairs.npair;
        for (int k = 0; k < n; ++k) {
            const double slope = force->stiffness[i / 2] * fmin(opening_of(value, n, k), 0);
            effort[PM_CONTACT_GAP * n + k] = slope;
            for (int t = 0; t < 2; ++t) {
                const int slid = PM_CONTACT_SLID_U + t, slopes = PM_CONTACT_SLOPE_U + t;
                effort[slid * n + k] = slope * value[slopes * n + k];
                effort[slopes * n + k] = slope * value[slid * n + k];
            }
        }
        pm_contact_pairs_add_forces(&m->pairs, i % 2, &a->body[force->body], effort, f);
    }
}

pm_status pm_contact_force_errors(const pm_body_assembly *a, const pm_contact_interface *m,
                                  const pm_dataset *modes, double stiffness,
                                  const pm_field *const *field, const int *trajectory,
                                  double *error) {
    pm_arena arena = {0};
    pm_contact_openings openings;
    int end = 2;
    pm_status status;
    PM_TRY_DONE(pm_contact_openings_open(&openings, a, m, modes, &arena));
    PM_TRY_DONE(pm_body_assembly_check(a, field));
    // The contact forces of a body are those of this interface if it has no other one.
    for (int k = 1; k >= 0; --k) {
        const int body = m->body[k];
        int count = 0;
        for (int i = 0; i < a->ninterface; ++i) {
            count += a->interface[i].body[0] == body || a->interface[i].body[1] == body;
        }
        end = count == 1 && field[body]->contact != NULL ? k : end;
    }
    if (end == 2) {
        PM_TRY_DONE(pm_fail(
            PM_EDATA, "neither %s nor %s has contact forces, and those with the other body alone",
            a->body[m->body[0]].name, a->body[m->body[1]].name));
    }
    const pm_field *truth = field[m->body[end]];
    if (modes->ntime != truth->ntime) {
        PM_TRY_DONE(pm_fail(PM_EDATA, "the dataset has %d states, the fields %d", modes->ntime,
                            truth->ntime));
    }
    double own[3]; // the normal in the frame of the body
    pm_placement_rotate_back(&a->body[m->body[end]].placement, m->pairs.pair[0].normal, own);
    for (int i = 0; i < modes->ntrajectory; ++i) {
        double off = 0, whole = 0;
        for (int j = 0; j < modes->ntime; ++j) {
            // Both total forces are positive if they push the bodies apart.
            const double *value =
                pm_contact_openings_compute(&openings, pm_dataset_state(modes, i, j));
            const double *f = pm_field_contact(truth, trajectory[i], j);
            double force = 0, expected = 0;
            for (int k = 0; k < m->pairs.npair; ++k) {
                force -= stiffness * fmin(opening_of(value, m->pairs.npair, k), 0);
            }
            for (int k = 0; k < 3 * truth->nnode; ++k) {
                expected += f[k] * own[k % 3];
            }
            expected = end == 0 ? -expected : expected;
            off += (force - expected) * (force - expected);
            whole += expected * expected;
        }
        error[i] = whole > 0 ? sqrt(off / whole) : NAN;
    }
done:
    pm_arena_free(&arena);
    return status;
}

// Forces of contact, those of the openings against those of the truth.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "modal/assembly.h"

// Where the first number of each group of the meeting stands; the others follow.
static pm_status find_groups(const pm_assembly *a, const pm_meeting *m, const pm_dataset *d,
                             pm_arena *arena, int first[PM_FACING_GROUPS]) {
    for (int k = 0; k < PM_FACING_GROUPS; ++k) {
        const char *name = pm_arena_printf(arena, "%s_%s_%s0", a->body[m->body[0]].name,
                                           a->body[m->body[1]].name, pm_meeting_group[k].name);
        if (name == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for the name of a column");
        }
        first[k] = 0;
        while (first[k] < d->ncolumn && strcmp(d->column[first[k]], name) != 0) {
            ++first[k];
        }
        if (first[k] + m->facing.npair > d->ncolumn) {
            return pm_fail(PM_EDATA, "the dataset has no columns from \"%s\" on", name);
        }
    }
    return PM_OK;
}

// The end whose body meets nobody else.
static pm_status find_lone_end(const pm_assembly *a, const pm_meeting *m,
                               const pm_field *const *field, int *end) {
    for (*end = 0; *end < 2; ++*end) {
        const int body = m->body[*end];
        int count = 0;
        for (int i = 0; i < a->nmeeting; ++i) {
            count += a->meeting[i].body[0] == body || a->meeting[i].body[1] == body;
        }
        if (count == 1 && field[body]->contact != NULL) {
            return PM_OK;
        }
    }
    return pm_fail(PM_EDATA, "neither %s nor %s has forces of contact with the other alone",
                   a->body[m->body[0]].name, a->body[m->body[1]].name);
}

static double force_of_openings(const int *first, int npair, double stiffness, const double *row) {
    double force = 0;
    for (int i = 0; i < npair; ++i) {
        const double x = row[first[PM_FACING_GAP] + i] +
                         row[first[PM_FACING_SLID_U] + i] * row[first[PM_FACING_SLOPE_U] + i] +
                         row[first[PM_FACING_SLID_V] + i] * row[first[PM_FACING_SLOPE_V] + i];
        force -= stiffness * fmin(x, 0);
    }
    return force;
}

// Of the truth, along the normal, positive where it pushes the bodies apart.
static double force_of_field(const pm_placed *body, const pm_meeting *m, int end,
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

pm_status pm_meeting_force_errors(const pm_assembly *a, const pm_meeting *m,
                                  const pm_dataset *modes, double stiffness,
                                  const pm_field *const *field, const int *trajectory,
                                  double *error) {
    int first[PM_FACING_GROUPS], end = 0;
    pm_arena arena = {0};
    const pm_status status = find_groups(a, m, modes, &arena, first);
    pm_arena_free(&arena);
    PM_TRY(status);
    PM_TRY(pm_assembly_check(a, field));
    PM_TRY(find_lone_end(a, m, field, &end));
    const pm_field *truth = field[m->body[end]];
    if (modes->ntime != truth->ntime) {
        return pm_fail(PM_EDATA, "the dataset has %d states, the fields %d", modes->ntime,
                       truth->ntime);
    }
    for (int i = 0; i < modes->ntrajectory; ++i) {
        double off = 0, whole = 0;
        for (int j = 0; j < modes->ntime; ++j) {
            const double force =
                force_of_openings(first, m->facing.npair, stiffness, pm_dataset_state(modes, i, j));
            const double expected =
                force_of_field(&a->body[m->body[end]], m, end, truth, trajectory[i], j);
            off += (force - expected) * (force - expected);
            whole += expected * expected;
        }
        error[i] = whole > 0 ? sqrt(off / whole) : NAN;
    }
    return PM_OK;
}

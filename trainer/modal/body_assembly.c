// Meetings, their matrices, and datasets put side by side.
#include "modal/body_assembly.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "modal/reduce.h"

#define TIME_TOLERANCE 1e-6 // of dt: single precision

const char *const pm_contact_interface_group[PM_CONTACT_GROUPS] = {"g", "u", "v", "slope_u",
                                                                   "slope_v"};

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for an assembly");
}

static const pm_contact_interface *find_meeting(const pm_body_assembly *a, int i, int k) {
    for (int m = 0; m < a->ncontact; ++m) {
        const int *body = a->meeting[m].body;
        if ((body[0] == i && body[1] == k) || (body[0] == k && body[1] == i)) {
            return &a->meeting[m];
        }
    }
    return NULL;
}

// Whether a third body lies between: it meets both, and is closer to either.
static bool is_hidden(const pm_body_assembly *a, const pm_contact_interface *m) {
    const double gap = m->facing.pair[0].gap;
    for (int i = 0; i < a->nbody; ++i) {
        const pm_contact_interface *first = find_meeting(a, m->body[0], i);
        const pm_contact_interface *second = find_meeting(a, i, m->body[1]);
        if (first != NULL && second != NULL && first->facing.pair[0].gap < gap &&
            second->facing.pair[0].gap < gap) {
            return true;
        }
    }
    return false;
}

// Pairs of bodies that face each other, whatever lies between.
static pm_status face_all(pm_body_assembly *a) {
    for (int i = 0; i < a->nbody; ++i) {
        for (int k = i + 1; k < a->nbody; ++k) {
            pm_contact_interface *m = &a->meeting[a->ncontact];
            m->body[0] = i;
            m->body[1] = k;
            PM_TRY(pm_contact_pairs_find(&m->facing, &a->body[i], &a->body[k], &a->arena));
            a->ncontact += m->facing.npair > 0;
        }
    }
    return PM_OK;
}

pm_status pm_body_assembly_meet(pm_body_assembly *a) {
    const size_t n = (size_t)a->nbody;
    bool *hidden = pm_arena_array(&a->arena, n * n, sizeof *hidden);
    a->ncontact = 0;
    a->meeting = pm_arena_array(&a->arena, n * n, sizeof *a->meeting);
    if (a->meeting == NULL || hidden == NULL) {
        return no_memory();
    }
    PM_TRY(face_all(a));
    int count = 0;
    for (int m = 0; m < a->ncontact; ++m) {
        hidden[m] = is_hidden(a, &a->meeting[m]);
    }
    for (int m = 0; m < a->ncontact; ++m) {
        if (!hidden[m]) {
            a->meeting[count++] = a->meeting[m];
        }
    }
    a->ncontact = count;
    return PM_OK;
}

// From a side half way to the axis of the body: a quarter of its thickness along the normal.
static double depth_of(const pm_placed *body, const double normal[3]) {
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < body->nnode; ++i) {
        double at = 0;
        for (int d = 0; d < 3; ++d) {
            for (int k = 0; k < 3; ++k) {
                at += normal[d] * body->axis[k][d] * body->position[3 * i + k];
            }
        }
        low = fmin(low, at);
        high = fmax(high, at);
    }
    return (high - low) / 4;
}

// Takes what has slid half way to the axis.
static void move_slid(const pm_contact_interface *m, double depth, double *value) {
    const int n = m->facing.npair;
    for (int i = 0; i < n; ++i) {
        value[PM_CONTACT_SLID_U * n + i] += depth * value[PM_CONTACT_SLOPE_U * n + i];
        value[PM_CONTACT_SLID_V * n + i] += depth * value[PM_CONTACT_SLOPE_V * n + i];
    }
}

pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *meeting, int end,
                                      double *matrix) {
    const pm_basis *b = assembly->basis;
    const pm_placed *body = &assembly->body[meeting->body[end]];
    const double depth = depth_of(body, meeting->facing.pair[0].normal);
    const int rows = PM_CONTACT_GROUPS * meeting->facing.npair;
    double *column = malloc((size_t)rows * sizeof *column);
    if (column == NULL) {
        return no_memory();
    }
    for (int m = 0; m < b->nstate; ++m) {
        memset(column, 0, (size_t)rows * sizeof *column);
        pm_contact_pairs_measure(&meeting->facing, end, body, b->mode + 3 * (ptrdiff_t)m * b->nnode,
                                 column);
        move_slid(meeting, depth, column);
        for (int i = 0; i < rows; ++i) {
            matrix[(ptrdiff_t)i * b->nstate + m] = column[i];
        }
    }
    free(column);
    return PM_OK;
}

// --- dataset ---

// Columns of a meeting: what both bodies have travelled, what has crept, an entropy.
static int count_meeting(const pm_body_assembly *a, const pm_contact_interface *m) {
    return 2 * a->basis->nstate + m->facing.npair + 1;
}

static int count_columns(const pm_body_assembly *a, const pm_dataset *const *part) {
    int count = 0;
    for (int i = 0; i < a->nbody; ++i) {
        count += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ncontact; ++i) {
        count += count_meeting(a, &a->meeting[i]);
    }
    return count;
}

// Names of `count` columns "A_B_<group><i>".
static void name_group(const pm_body_assembly *a, const pm_contact_interface *m, const char *group,
                       int count, pm_arena *arena, const char **name) {
    for (int i = 0; i < count; ++i) {
        name[i] = pm_arena_printf(arena, "%s_%s_%s%d", a->body[m->body[0]].name,
                                  a->body[m->body[1]].name, group, i);
    }
}

static const char **name_columns(const pm_body_assembly *a, const pm_dataset *const *part,
                                 int count, pm_arena *arena) {
    const char **name = pm_arena_array(arena, (size_t)count, sizeof *name);
    const int nstate = a->basis->nstate;
    int at = 0;
    for (int i = 0; i < a->nbody && name != NULL; ++i) {
        for (int k = 0; k < part[i]->ncolumn; ++k) {
            name[at++] = pm_arena_printf(arena, "%s_%s", a->body[i].name, part[i]->column[k]);
        }
    }
    for (int i = 0; i < a->ncontact && name != NULL; ++i) {
        const pm_contact_interface *m = &a->meeting[i];
        const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
        name_group(a, m, body[0], nstate, arena, name + at);
        name_group(a, m, body[1], nstate, arena, name + at + nstate);
        name_group(a, m, "creep", m->facing.npair, arena, name + at + 2 * (ptrdiff_t)nstate);
        at += count_meeting(a, m);
        name[at - 1] = pm_arena_printf(arena, "%s_%s_s", body[0], body[1]);
    }
    for (int i = 0; i < at; ++i) {
        if (name[i] == NULL) {
            return NULL;
        }
    }
    return name;
}

// All numbers at one time of a trajectory, which is number `member` of the parts.
static void write_row(const pm_body_assembly *a, const pm_dataset *const *part, int member,
                      int time, double *row) {
    const int nstate = a->basis->nstate;
    for (int i = 0; i < a->nbody; ++i) {
        memcpy(row, pm_dataset_state(part[i], member, time),
               (size_t)part[i]->ncolumn * sizeof *row);
        row += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ncontact; ++i) {
        const pm_contact_interface *m = &a->meeting[i];
        for (int end = 0; end < 2; ++end) { // amplitudes are the first columns of a body
            memcpy(row + (ptrdiff_t)end * nstate,
                   pm_dataset_state(part[m->body[end]], member, time),
                   (size_t)nstate * sizeof *row);
        }
        row += count_meeting(a, m); // the rest is 0: the truth's contact does not dissipate
    }
}

pm_status pm_body_assembly_check(const pm_body_assembly *a, const pm_field *const *field) {
    const pm_field *first = field[0];
    for (int i = 0; i < a->nbody; ++i) {
        const pm_field *d = field[i];
        if (d->nnode != a->basis->nnode) {
            return pm_fail(PM_EDATA, "the field of %s has %d nodes, the basis %d", a->body[i].name,
                           d->nnode, a->basis->nnode);
        }
        if (d->ntrajectory != first->ntrajectory || d->ntime != first->ntime ||
            fabs(d->dt - first->dt) > TIME_TOLERANCE * first->dt) {
            return pm_fail(PM_EDATA,
                           "the field of %s has %d trajectories of %d states, %g s apart, that of "
                           "%s %d of %d, %g s",
                           a->body[i].name, d->ntrajectory, d->ntime, d->dt, a->body[0].name,
                           first->ntrajectory, first->ntime, first->dt);
        }
    }
    return PM_OK;
}

static pm_status join(pm_dataset **dataset, const pm_body_assembly *a,
                      const pm_dataset *const *part) {
    pm_arena arena = {0};
    pm_dataset *d = NULL;
    pm_status status;
    const int count = count_columns(a, part);
    const char **name = name_columns(a, part, count, &arena);
    if (name == NULL) {
        status = no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_dataset_new(&d, part[0]->ntrajectory, part[0]->ntime, count, part[0]->dt, name));
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            write_row(a, part, i, j, pm_dataset_state(d, i, j));
        }
    }
    *dataset = d;
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *a,
                                   const pm_field *const *field, int count, const int *trajectory) {
    PM_TRY(pm_body_assembly_check(a, field));
    pm_dataset **part = calloc((size_t)a->nbody, sizeof *part);
    pm_status status = part == NULL ? no_memory() : PM_OK;
    for (int i = 0; i < a->nbody && status == PM_OK; ++i) {
        status = pm_reduce_project(&part[i], a->basis, field[i], count, trajectory, false,
                                   PM_LOADS_PRESCRIBED);
    }
    if (status == PM_OK) {
        status = join(dataset, a, (const pm_dataset *const *)part);
    }
    for (int i = 0; i < a->nbody && part != NULL; ++i) {
        pm_dataset_free(part[i]);
    }
    free(part);
    return status;
}

// Finds interfaces, computes their matrices, and joins the datasets of the bodies.
#include "modal/body_assembly.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "modal/reduce.h"

#define TIME_TOLERANCE 1e-6 // relative to dt: single precision

const char *const pm_contact_group_name[PM_CONTACT_GROUPS] = {"g", "u", "v", "slope_u", "slope_v"};

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for an assembly");
}

// Returns the interface of bodies i and k; NULL if there is none.
static const pm_contact_interface *find_interface(const pm_body_assembly *a, int i, int k) {
    for (int m = 0; m < a->ninterface; ++m) {
        const int *body = a->interface[m].body;
        if ((body[0] == i && body[1] == k) || (body[0] == k && body[1] == i)) {
            return &a->interface[m];
        }
    }
    return NULL;
}

// Returns true if a third body lies between: it faces both, and is closer to either.
static bool is_hidden(const pm_body_assembly *a, const pm_contact_interface *m) {
    const double gap = m->pairs.pair[0].gap;
    for (int i = 0; i < a->nbody; ++i) {
        const pm_contact_interface *first = find_interface(a, m->body[0], i);
        const pm_contact_interface *second = find_interface(a, i, m->body[1]);
        if (first != NULL && second != NULL && first->pairs.pair[0].gap < gap &&
            second->pairs.pair[0].gap < gap) {
            return true;
        }
    }
    return false;
}

// Finds all pairs of bodies that face each other, even with a third body between them.
static pm_status find_all(pm_body_assembly *a) {
    for (int i = 0; i < a->nbody; ++i) {
        for (int k = i + 1; k < a->nbody; ++k) {
            pm_contact_interface *m = &a->interface[a->ninterface];
            m->body[0] = i;
            m->body[1] = k;
            PM_TRY(pm_contact_pairs_find(&m->pairs, &a->body[i], &a->body[k], &a->arena));
            a->ninterface += m->pairs.npair > 0;
        }
    }
    return PM_OK;
}

pm_status pm_body_assembly_find_interfaces(pm_body_assembly *a) {
    const size_t n = (size_t)a->nbody;
    bool *hidden = pm_arena_array(&a->arena, n * n, sizeof *hidden);
    a->ninterface = 0;
    a->interface = pm_arena_array(&a->arena, n * n, sizeof *a->interface);
    if (a->interface == NULL || hidden == NULL) {
        return no_memory();
    }
    PM_TRY(find_all(a));
    int count = 0;
    for (int m = 0; m < a->ninterface; ++m) {
        hidden[m] = is_hidden(a, &a->interface[m]);
    }
    for (int m = 0; m < a->ninterface; ++m) {
        if (!hidden[m]) {
            a->interface[count++] = a->interface[m];
        }
    }
    a->ninterface = count;
    return PM_OK;
}

// Half the distance from a side to the axis of the body: a quarter of its thickness along a normal
// in the global frame, m.
static double depth_of(const pm_placed_body *body, const double normal[3]) {
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < body->nnode; ++i) {
        double global[3], at = 0;
        pm_placement_rotate(&body->placement, body->position + 3 * (ptrdiff_t)i, global);
        for (int d = 0; d < 3; ++d) {
            at += normal[d] * global[d];
        }
        low = fmin(low, at);
        high = fmax(high, at);
    }
    return (high - low) / 4;
}

// Converts the sliding of a side into the sliding half way between the side and the axis.
static void move_to_axis(const pm_contact_interface *m, double depth, double *value) {
    const int n = m->pairs.npair;
    for (int i = 0; i < n; ++i) {
        value[PM_CONTACT_SLID_U * n + i] += depth * value[PM_CONTACT_SLOPE_U * n + i];
        value[PM_CONTACT_SLID_V * n + i] += depth * value[PM_CONTACT_SLOPE_V * n + i];
    }
}

pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *interface, int end,
                                      double *matrix) {
    const pm_basis *b = assembly->basis;
    const pm_placed_body *body = &assembly->body[interface->body[end]];
    const double depth = depth_of(body, interface->pairs.pair[0].normal);
    const int rows = PM_CONTACT_GROUPS * interface->pairs.npair;
    double *column = malloc((size_t)rows * sizeof *column);
    if (column == NULL) {
        return no_memory();
    }
    for (int m = 0; m < b->nstate; ++m) {
        memset(column, 0, (size_t)rows * sizeof *column);
        pm_contact_pairs_measure(&interface->pairs, end, body,
                                 b->mode + 3 * (ptrdiff_t)m * b->nnode, column);
        move_to_axis(interface, depth, column);
        for (int i = 0; i < rows; ++i) {
            matrix[(ptrdiff_t)i * b->nstate + m] = column[i];
        }
    }
    free(column);
    return PM_OK;
}

// --- dataset ---

// Counts the columns of an interface: the travel of both bodies, the creep of each pair, an
// entropy.
static int count_interface(const pm_body_assembly *a, const pm_contact_interface *m) {
    return 2 * a->basis->nstate + m->pairs.npair + 1;
}

static int count_columns(const pm_body_assembly *a, const pm_dataset *const *part) {
    int count = 0;
    for (int i = 0; i < a->nbody; ++i) {
        count += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ninterface; ++i) {
        count += count_interface(a, &a->interface[i]);
    }
    return count;
}

// Makes the names of `count` columns "A_B_<group><i>".
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
    for (int i = 0; i < a->ninterface && name != NULL; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
        name_group(a, m, body[0], nstate, arena, name + at);
        name_group(a, m, body[1], nstate, arena, name + at + nstate);
        name_group(a, m, "creep", m->pairs.npair, arena, name + at + 2 * (ptrdiff_t)nstate);
        at += count_interface(a, m);
        name[at - 1] = pm_arena_printf(arena, "%s_%s_s", body[0], body[1]);
    }
    for (int i = 0; i < at; ++i) {
        if (name[i] == NULL) {
            return NULL;
        }
    }
    return name;
}

// Fills a row with all numbers at one time of trajectory `member` of the parts.
static void write_row(const pm_body_assembly *a, const pm_dataset *const *part, int member,
                      int time, double *row) {
    const int nstate = a->basis->nstate;
    for (int i = 0; i < a->nbody; ++i) {
        memcpy(row, pm_dataset_state(part[i], member, time),
               (size_t)part[i]->ncolumn * sizeof *row);
        row += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        for (int end = 0; end < 2; ++end) { // amplitudes are the first columns of a body
            memcpy(row + (ptrdiff_t)end * nstate,
                   pm_dataset_state(part[m->body[end]], member, time),
                   (size_t)nstate * sizeof *row);
        }
        row += count_interface(a, m); // creep and entropy stay 0
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
                           "%s has %d of %d, %g s apart",
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

// Finds interfaces, computes their matrices, and joins the datasets of the bodies.
#include "modal/body_assembly.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "body/solid_nodes.h"
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

// Lists the nodes of a solid whose displacements the quantities of its interfaces contain.
static pm_status find_contact_nodes(pm_body_assembly *a, int body) {
    pm_assembled_solid *solid = &a->solid[body];
    const int nnode = a->body[body].nnode;
    bool *touches = pm_arena_array(&a->arena, (size_t)nnode, sizeof *touches);
    solid->contact = pm_arena_array(&a->arena, (size_t)nnode, sizeof *solid->contact);
    if (touches == NULL || solid->contact == NULL) {
        return no_memory();
    }
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        for (int k = 0; k < 2 * m->pairs.npair; ++k) {
            const pm_contact_point *point = &m->pairs.pair[k / 2].point[k % 2];
            for (int n = 0; n < point->nnode && m->body[k % 2] == body; ++n) {
                touches[point->node[n]] = true;
            }
        }
    }
    for (int n = 0; n < nnode; ++n) {
        if (touches[n]) {
            solid->contact[solid->ncontact++] = n;
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
    for (int i = 0; i < a->nbody; ++i) {
        PM_TRY(pm_body_assembly_is_solid(a, i) ? find_contact_nodes(a, i) : PM_OK);
    }
    return PM_OK;
}

bool pm_body_assembly_is_solid(const pm_body_assembly *a, int body) {
    return a->solid != NULL && a->solid[body].field != NULL;
}

int pm_body_assembly_size(const pm_body_assembly *a, int body) {
    return pm_body_assembly_is_solid(a, body) ? 3 * a->solid[body].ncontact : a->basis->nstate;
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

// Adds to column [PM_CONTACT_GROUPS npair] the quantities for coordinate `m` of a body. `u`
// [nnode][3] is zero before and after.
static void fill_column(const pm_body_assembly *a, const pm_contact_interface *interface, int end,
                        int m, double *u, double *column) {
    const int body_id = interface->body[end];
    const pm_placed_body *body = &a->body[body_id];
    if (pm_body_assembly_is_solid(a, body_id)) {
        double *moved = &u[3 * (ptrdiff_t)a->solid[body_id].contact[m / 3] + m % 3];
        *moved = 1;
        pm_contact_pairs_measure(&interface->pairs, end, body, u, column);
        *moved = 0;
        return;
    }
    pm_contact_pairs_measure(&interface->pairs, end, body,
                             a->basis->mode + 3 * (ptrdiff_t)m * a->basis->nnode, column);
    move_to_axis(interface, depth_of(body, interface->pairs.pair[0].normal), column);
}

pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *interface, int end,
                                      double *matrix) {
    const int body = interface->body[end], size = pm_body_assembly_size(assembly, body);
    const int rows = PM_CONTACT_GROUPS * interface->pairs.npair;
    double *column = calloc((size_t)rows + 3 * (size_t)assembly->body[body].nnode, sizeof *column);
    if (column == NULL) {
        return no_memory();
    }
    for (int m = 0; m < size; ++m) {
        memset(column, 0, (size_t)rows * sizeof *column);
        fill_column(assembly, interface, end, m, column + rows, column);
        for (int i = 0; i < rows; ++i) {
            matrix[(ptrdiff_t)i * size + m] = column[i];
        }
    }
    free(column);
    return PM_OK;
}

// --- dataset ---

// Counts the columns of an interface: the travel of both bodies, the creep of each pair, an
// entropy.
static int count_interface(const pm_body_assembly *a, const pm_contact_interface *m) {
    return pm_body_assembly_size(a, m->body[0]) + pm_body_assembly_size(a, m->body[1]) +
           m->pairs.npair + 1;
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
    int at = 0;
    for (int i = 0; i < a->nbody && name != NULL; ++i) {
        for (int k = 0; k < part[i]->ncolumn; ++k) {
            name[at++] = pm_arena_printf(arena, "%s_%s", a->body[i].name, part[i]->column[k]);
        }
    }
    for (int i = 0; i < a->ninterface && name != NULL; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
        const int size[2] = {pm_body_assembly_size(a, m->body[0]),
                             pm_body_assembly_size(a, m->body[1])};
        name_group(a, m, body[0], size[0], arena, name + at);
        name_group(a, m, body[1], size[1], arena, name + at + size[0]);
        name_group(a, m, "creep", m->pairs.npair, arena, name + at + size[0] + size[1]);
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

// Copies the coordinates of a body in contact from its row to `to`. Amplitudes are the first
// columns of a body in modes, and displacements those of a solid.
static void copy_travel(const pm_body_assembly *a, int body, const double *row, double *to) {
    const int size = pm_body_assembly_size(a, body);
    for (int k = 0; k < size; ++k) {
        to[k] =
            row[pm_body_assembly_is_solid(a, body) ? 3 * a->solid[body].contact[k / 3] + k % 3 : k];
    }
}

// Fills a row with all numbers at one time of trajectory `member` of the parts.
static void write_row(const pm_body_assembly *a, const pm_dataset *const *part, int member,
                      int time, double *row) {
    for (int i = 0; i < a->nbody; ++i) {
        memcpy(row, pm_dataset_state(part[i], member, time),
               (size_t)part[i]->ncolumn * sizeof *row);
        row += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        double *to = row;
        for (int end = 0; end < 2; ++end) {
            const int body = m->body[end];
            copy_travel(a, body, pm_dataset_state(part[body], member, time), to);
            to += pm_body_assembly_size(a, body);
        }
        row += count_interface(a, m); // creep and entropy stay 0
    }
}

pm_status pm_body_assembly_check(const pm_body_assembly *a, const pm_field *const *field) {
    const pm_field *first = field[0];
    for (int i = 0; i < a->nbody; ++i) {
        const pm_field *d = field[i];
        if (d->nnode != a->body[i].nnode) {
            return pm_fail(PM_EDATA, "the field of %s has %d nodes, the basis %d", a->body[i].name,
                           d->nnode, a->body[i].nnode);
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

// Converts the trajectories of a solid.
static pm_status convert_solid(pm_dataset **part, const pm_field *field, int count,
                               const int *trajectory, double temperature) {
    pm_arena arena = {0};
    pm_solid_data data;
    pm_status status;
    PM_TRY_DONE(pm_solid_data_open(&data, field, &arena));
    memcpy(data.trajectory, trajectory, (size_t)count * sizeof *trajectory);
    data.count = count;
    status = pm_solid_nodes_dataset(part, &data, field->ntime, temperature);
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *a,
                                   const pm_field *const *field, int count, const int *trajectory,
                                   double temperature) {
    PM_TRY(pm_body_assembly_check(a, field));
    pm_dataset **part = calloc((size_t)a->nbody, sizeof *part);
    pm_status status = part == NULL ? no_memory() : PM_OK;
    for (int i = 0; i < a->nbody && status == PM_OK; ++i) {
        status = pm_body_assembly_is_solid(a, i)
                     ? convert_solid(&part[i], field[i], count, trajectory, temperature)
                     : pm_reduce_project(&part[i], a->basis, field[i], count, trajectory, false,
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

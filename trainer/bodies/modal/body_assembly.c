// Reads which bodies a truth file places where, finds interfaces, computes their matrices, and
// joins the datasets of the bodies.
#include "bodies/modal/body_assembly.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bodies/modal/reduce.h"
#include "bodies/solid/solid_nodes.h"
#include "store/yaml.h"

#define TIME_TOLERANCE 1e-6 // relative to dt: single precision

const char *const pm_contact_group_name[PM_CONTACT_GROUPS] = {"g", "u", "v", "slope_u", "slope_v"};

// --- reading ---

pm_status pm_body_assembly_read(pm_body_assembly *a, const char *path) {
    const pm_basis *basis = a->basis;
    pm_yaml_document *document = NULL;
    pm_yaml root, system, beams, key, value;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    PM_TRY_DONE(pm_yaml_require(root, "system", &system));
    PM_TRY_DONE(pm_yaml_require(system, "beams", &beams));
    PM_TRY_DONE(pm_yaml_require_entries(beams));
    a->nbody = pm_yaml_count(beams);
    a->body = pm_arena_array(&a->arena, (size_t)a->nbody, sizeof *a->body);
    a->solid = pm_arena_array(&a->arena, (size_t)a->nbody, sizeof *a->solid);
    PM_TRY_DONE(pm_arena_status(&a->arena, "bodies"));
    for (int i = 0; i < a->nbody; ++i) {
        pm_placed_body *body = &a->body[i];
        pm_yaml_entry(beams, i, &key, &value);
        PM_TRY_DONE(pm_yaml_text(key, &a->arena, &body->name));
        PM_TRY_DONE(pm_placement_read(value, &a->arena, &body->placement));
        if (basis != NULL) {
            body->nnode = basis->nnode;
            body->nelement = basis->nelement;
            body->position = basis->position;
            body->hexahedron = basis->hexahedron;
        }
    }
done:
    pm_yaml_close(document);
    return status;
}

pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path) {
    PM_TRY(pm_body_assembly_read(assembly, path));
    return pm_body_assembly_find_interfaces(assembly);
}

pm_status pm_body_assembly_make_solid(pm_body_assembly *assembly, int body, const pm_field *field) {
    pm_placed_body *placed = &assembly->body[body];
    if (field->nelement == 0) {
        return pm_fail(PM_EDATA, "the field of %s has no mesh", placed->name);
    }
    assembly->solid[body].field = field;
    placed->nnode = field->nnode;
    placed->nelement = field->nelement;
    placed->position = field->position;
    placed->hexahedron = field->hexahedron;
    return PM_OK;
}

// --- interfaces ---

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

pm_status pm_body_assembly_find_interfaces(pm_body_assembly *a) {
    const size_t n = (size_t)a->nbody;
    bool *hidden = pm_arena_array(&a->arena, n * n, sizeof *hidden);
    int count = 0;
    a->ninterface = 0;
    a->interface = pm_arena_array(&a->arena, n * n, sizeof *a->interface);
    PM_TRY(pm_arena_status(&a->arena, "an assembly"));
    // All pairs of bodies that face each other, even with a third body between them.
    for (int i = 0; i < a->nbody; ++i) {
        for (int k = i + 1; k < a->nbody; ++k) {
            pm_contact_interface *m = &a->interface[a->ninterface];
            m->body[0] = i;
            m->body[1] = k;
            PM_TRY(pm_contact_pairs_find(&m->pairs, &a->body[i], &a->body[k], &a->arena));
            a->ninterface += m->pairs.npair > 0;
        }
    }
    // A third body that lies between faces both, and is closer to either.
    for (int m = 0; m < a->ninterface; ++m) {
        const pm_contact_interface *whole = &a->interface[m];
        const double gap = whole->pairs.pair[0].gap;
        for (int i = 0; i < a->nbody; ++i) {
            const pm_contact_interface *first = find_interface(a, whole->body[0], i);
            const pm_contact_interface *second = find_interface(a, i, whole->body[1]);
            hidden[m] =
                hidden[m] || (first != NULL && second != NULL && first->pairs.pair[0].gap < gap &&
                              second->pairs.pair[0].gap < gap);
        }
    }
    for (int m = 0; m < a->ninterface; ++m) {
        if (!hidden[m]) {
            a->interface[count++] = a->interface[m];
        }
    }
    a->ninterface = count;
    // Find the contact nodes of each solid: the nodes whose displacements occur in the openings and
    // slips of its interfaces.
    for (int i = 0; i < a->nbody; ++i) {
        if (!pm_body_assembly_is_solid(a, i)) {
            continue;
        }
        pm_assembled_solid *solid = &a->solid[i];
        const size_t nnode = (size_t)a->body[i].nnode;
        bool *touches = pm_arena_array(&a->arena, nnode, sizeof *touches);
        solid->contact = pm_arena_array(&a->arena, nnode, sizeof *solid->contact);
        PM_TRY(pm_arena_status(&a->arena, "an assembly"));
        for (int m = 0; m < a->ninterface; ++m) {
            const pm_contact_interface *own = &a->interface[m];
            for (int k = 0; k < 2 * own->pairs.npair; ++k) {
                const pm_contact_point *point = &own->pairs.pair[k / 2].point[k % 2];
                for (int p = 0; p < point->nnode && own->body[k % 2] == i; ++p) {
                    touches[point->node[p]] = true;
                }
            }
        }
        for (int p = 0; p < a->body[i].nnode; ++p) {
            if (touches[p]) {
                solid->contact[solid->ncontact++] = p;
            }
        }
    }
    return PM_OK;
}

bool pm_body_assembly_is_solid(const pm_body_assembly *a, int body) {
    return a->solid != NULL && a->solid[body].field != NULL;
}

int pm_body_assembly_size(const pm_body_assembly *a, int body) {
    return pm_body_assembly_is_solid(a, body) ? 3 * a->solid[body].ncontact : a->basis->nstate;
}

pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *interface, int end,
                                      double *matrix) {
    const int body_id = interface->body[end], size = pm_body_assembly_size(assembly, body_id);
    const int n = interface->pairs.npair, rows = PM_CONTACT_GROUPS * n;
    const pm_placed_body *body = &assembly->body[body_id];
    const double *normal = interface->pairs.pair[0].normal;
    double low = INFINITY, high = -INFINITY;
    double *column = calloc((size_t)rows + 3 * (size_t)body->nnode, sizeof *column);
    double *u = column + rows; // [nnode][3]
    PM_TRY(pm_allocated(column, "an assembly"));
    for (int i = 0; i < body->nnode; ++i) {
        double global[3], at = 0;
        pm_placement_rotate(&body->placement, body->position + 3 * (ptrdiff_t)i, global);
        for (int d = 0; d < 3; ++d) {
            at += normal[d] * global[d];
        }
        low = fmin(low, at);
        high = fmax(high, at);
    }
    const double depth = (high - low) / 4; // m, half the distance from a side to the axis
    for (int m = 0; m < size; ++m) {
        memset(column, 0, (size_t)rows * sizeof *column);
        if (pm_body_assembly_is_solid(assembly, body_id)) {
            double *moved = &u[3 * (ptrdiff_t)assembly->solid[body_id].contact[m / 3] + m % 3];
            *moved = 1;
            pm_contact_pairs_measure(&interface->pairs, end, body, u, column);
            *moved = 0;
        } else {
            const pm_basis *basis = assembly->basis;
            pm_contact_pairs_measure(&interface->pairs, end, body,
                                     basis->mode + 3 * (ptrdiff_t)m * basis->nnode, column);
            // The sliding of a side becomes that half way between the side and the axis.
            for (int i = 0; i < n; ++i) {
                column[PM_CONTACT_SLID_U * n + i] += depth * column[PM_CONTACT_SLOPE_U * n + i];
                column[PM_CONTACT_SLID_V * n + i] += depth * column[PM_CONTACT_SLOPE_V * n + i];
            }
        }
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

// Joins the datasets of the bodies, part [nbody], and adds the columns of the interfaces.
static pm_status join(pm_dataset **dataset, const pm_body_assembly *a,
                      const pm_dataset *const *part) {
    pm_arena arena = {0};
    pm_dataset *d = NULL;
    pm_status status;
    int count = 0, at = 0;
    for (int i = 0; i < a->nbody; ++i) {
        count += part[i]->ncolumn;
    }
    for (int i = 0; i < a->ninterface; ++i) {
        count += count_interface(a, &a->interface[i]);
    }
    const char **name = pm_arena_array(&arena, (size_t)count, sizeof *name);
    PM_TRY_DONE(pm_arena_status(&arena, "an assembly"));
    for (int i = 0; i < a->nbody; ++i) {
        for (int k = 0; k < part[i]->ncolumn; ++k) {
            name[at++] = pm_arena_printf(&arena, "%s_%s", a->body[i].name, part[i]->column[k]);
        }
    }
    for (int i = 0; i < a->ninterface; ++i) {
        const pm_contact_interface *m = &a->interface[i];
        const char *first = a->body[m->body[0]].name, *second = a->body[m->body[1]].name;
        const struct column_group {
            const char *name;
            int count;
        } group[] = {{first, pm_body_assembly_size(a, m->body[0])},
                     {second, pm_body_assembly_size(a, m->body[1])},
                     {"creep", m->pairs.npair}};
        for (int g = 0; g < 3; ++g) {
            for (int k = 0; k < group[g].count; ++k) {
                name[at++] = pm_arena_printf(&arena, "%s_%s_%s%d", first, second, group[g].name, k);
            }
        }
        name[at++] = pm_arena_printf(&arena, "%s_%s_s", first, second);
    }
    PM_TRY_DONE(pm_arena_status(&arena, "an assembly"));
    PM_TRY_DONE(pm_dataset_new(&d, part[0]->ntrajectory, part[0]->ntime, count, part[0]->dt, name));
    for (int i = 0; i < d->ntrajectory * d->ntime; ++i) {
        const int member = i / d->ntime, time = i % d->ntime;
        double *row = pm_dataset_state(d, member, time);
        for (int b = 0; b < a->nbody; ++b) {
            memcpy(row, pm_dataset_state(part[b], member, time),
                   (size_t)part[b]->ncolumn * sizeof *row);
            row += part[b]->ncolumn;
        }
        // The coordinates of the bodies in contact: amplitudes are the first columns of a body in
        // modes, and displacements those of a solid. Creep and entropy stay 0.
        for (int m = 0; m < a->ninterface; ++m) {
            double *to = row;
            for (int end = 0; end < 2; ++end) {
                const int body = a->interface[m].body[end], size = pm_body_assembly_size(a, body);
                const double *from = pm_dataset_state(part[body], member, time);
                for (int k = 0; k < size; ++k) {
                    *to++ = from[pm_body_assembly_is_solid(a, body)
                                     ? 3 * a->solid[body].contact[k / 3] + k % 3
                                     : k];
                }
            }
            row += count_interface(a, &a->interface[m]);
        }
    }
    *dataset = d;
done:
    pm_arena_free(&arena);
    return status;
}

pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *a,
                                   const pm_field *const *field, int count, const int *trajectory,
                                   double temperature) {
    PM_TRY(pm_body_assembly_check(a, field));
    pm_arena arena = {0};
    pm_dataset **part = pm_arena_array(&arena, (size_t)a->nbody, sizeof *part);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "an assembly"));
    for (int i = 0; i < a->nbody; ++i) {
        if (pm_body_assembly_is_solid(a, i)) {
            pm_solid_data data;
            PM_TRY_DONE(pm_solid_data_open(&data, field[i], &arena));
            memcpy(data.trajectory, trajectory, (size_t)count * sizeof *trajectory);
            data.count = count;
            PM_TRY_DONE(pm_solid_nodes_dataset(&part[i], &data, field[i]->ntime, temperature));
        } else {
            PM_TRY_DONE(pm_reduce_project(&part[i], a->basis, field[i], count, trajectory, false,
                                          PM_LOADS_PRESCRIBED));
        }
    }
    status = join(dataset, a, (const pm_dataset *const *)part);
done:
    for (int i = 0; i < a->nbody && part != NULL; ++i) {
        pm_dataset_free(part[i]);
    }
    pm_arena_free(&arena);
    return status;
}

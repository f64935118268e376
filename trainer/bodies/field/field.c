// Fields on a mesh: their memory, and the HDF5 layout that field.h describes.
#include "bodies/field/field.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store/dataset.h"
#include "store/hdf5_io.h"

#define LAYOUT "state_layout"
#define CONTACT "contact_force"
#define PLACEMENT "placement"

// --- placements ---

pm_status pm_placement_read(pm_yaml map, pm_arena *arena, pm_placement *placement) {
    static const char *const keys[] = {"origin", "axes", NULL};
    static const char *const names[] = {"+x", "-x", "+y", "-y", "+z", "-z", NULL};
    pm_yaml origin, axes;
    pm_placement read = PM_PLACEMENT_IDENTITY;
    int count = 0, seen = 0;
    double *number = NULL;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_yaml_require(map, "origin", &origin));
    PM_TRY(pm_yaml_require(map, "axes", &axes));
    PM_TRY(pm_yaml_doubles(origin, arena, &count, &number));
    if (count != 3) {
        return pm_yaml_fail(origin, "expected three numbers, found %d", count);
    }
    for (int d = 0; d < 3; ++d) {
        read.origin[d] = number[d];
    }
    // A rotation is proper if the permutation of the axes and the product of their signs have the
    // same parity.
    if (!pm_yaml_is_list(axes)) {
        return pm_yaml_fail(axes, "expected a list");
    }
    for (int d = 0; d < 3 && pm_yaml_count(axes) == 3; ++d) {
        int id = 0;
        PM_TRY(pm_yaml_choice(pm_yaml_item(axes, d), names, &id));
        read.axis[d] = id / 2;
        read.sign[d] = id % 2 == 0 ? 1 : -1;
        seen |= 1 << read.axis[d];
    }
    const bool cyclic = (read.axis[0] + 1) % 3 == read.axis[1];
    if (seen != 7 || (read.sign[0] * read.sign[1] * read.sign[2] > 0) != cyclic) {
        return pm_yaml_fail(axes,
                            "expected three axes such as [+x, +y, +z], different and right-handed");
    }
    *placement = read;
    return PM_OK;
}

// --- memory ---

void pm_field_free(pm_field *field) {
    PM_DELETE(field);
}

// Makes a field with the arrays that every field has.
static pm_status field_alloc(pm_field **field, pm_field_shape shape) {
    const size_t nstate = (size_t)shape.ntrajectory * (size_t)shape.ntime;
    const size_t nnode = (size_t)shape.nnode;
    pm_field *d = NULL;
    PM_TRY(PM_NEW(d, "a field"));
    d->ntrajectory = shape.ntrajectory;
    d->ntime = shape.ntime;
    d->nnode = shape.nnode;
    d->nvariable = shape.nvariable;
    d->nelement = shape.nelement;
    d->placement = PM_PLACEMENT_IDENTITY;
    d->t = pm_arena_array(&d->arena, (size_t)shape.ntime, sizeof *d->t);
    d->z = pm_arena_array(&d->arena, nstate * nnode, (size_t)shape.nvariable * sizeof *d->z);
    d->f = pm_arena_array(&d->arena, nstate * nnode, 3 * sizeof *d->f);
    d->position = pm_arena_array(&d->arena, nnode, 3 * sizeof *d->position);
    if (shape.contact) {
        d->contact = pm_arena_array(&d->arena, nstate * nnode, 3 * sizeof *d->contact);
    }
    PM_RETURN_NEW(field, d, "a field");
}

pm_status pm_field_new(pm_field **field, pm_field_shape shape, double dt, const char *variable) {
    pm_field *d;
    PM_TRY(field_alloc(&d, shape));
    const size_t nstate = (size_t)shape.ntrajectory * (size_t)shape.ntime;
    d->hexahedron = pm_arena_array(&d->arena, (size_t)shape.nelement, 8 * sizeof *d->hexahedron);
    d->clamped = pm_arena_array(&d->arena, (size_t)shape.nnode, sizeof *d->clamped);
    d->energy = pm_arena_array(&d->arena, nstate, PM_FIELD_ENERGIES * sizeof *d->energy);
    d->variable = pm_arena_strdup(&d->arena, variable);
    d->contact_work = pm_arena_array(&d->arena, nstate, sizeof *d->contact_work);
    d->dt = dt;
    for (int j = 0; j < d->ntime; ++j) {
        d->t[j] = j * dt;
    }
    PM_RETURN_NEW(field, d, "a field");
}

// --- loading ---

static pm_status check_finite(const double *value, size_t count, const char *path,
                              const char *name) {
    for (size_t i = 0; i < count; ++i) {
        if (!isfinite(value[i])) {
            return pm_fail(PM_EDATA, "%s: value %zu of %s is %g, expected a finite number", path, i,
                           name, value[i]);
        }
    }
    return PM_OK;
}

static pm_status read_content(pm_field *d, const pm_hdf5 *file, const char *path) {
    const int shape[4] = {d->ntrajectory, d->ntime, d->nnode, d->nvariable};
    const int position[2] = {d->nnode, 3},
              energy[3] = {d->ntrajectory, d->ntime, PM_FIELD_ENERGIES};
    const size_t ntime = (size_t)d->ntrajectory * (size_t)d->ntime, nnode = (size_t)d->nnode;
    const size_t nstate = ntime * nnode, nenergy = ntime * PM_FIELD_ENERGIES;
    const char *layout, *end;
    // The first words are the names of the variables.
    PM_TRY(pm_hdf5_read_text(file, "/", LAYOUT, &d->arena, &layout));
    end = layout;
    for (int i = 0; i < d->nvariable; ++i) {
        end += strspn(end, " \t\n");
        if (*end == '\0') {
            return pm_fail(PM_EDATA, "%s: " LAYOUT " is \"%s\", expected %d names", path, layout,
                           d->nvariable);
        }
        end += strcspn(end, " \t\n");
    }
    d->variable = pm_arena_printf(&d->arena, "%.*s", (int)(end - layout), layout);
    PM_TRY(pm_arena_status(&d->arena, "the names of variables"));
    PM_TRY(pm_hdf5_read(file, "/dt", 0, NULL, &d->dt));
    PM_TRY(pm_hdf5_read(file, "/t", 1, &shape[1], d->t));
    PM_TRY(pm_hdf5_read(file, "/z", 4, shape, d->z));
    PM_TRY(pm_hdf5_read(file, "/node_position_reference", 2, position, d->position));
    // Forces of all times, or of all but the first. Then each trajectory moves, from the last one
    // on, behind the zeros of its first time.
    int found[4];
    PM_TRY(pm_hdf5_shape(file, "/f", 4, found));
    const bool whole = found[1] != d->ntime - 1;
    const int force[4] = {d->ntrajectory, whole ? d->ntime : d->ntime - 1, d->nnode, 3};
    const size_t width = 3 * nnode, count = (size_t)force[1] * width;
    PM_TRY(pm_hdf5_read(file, "/f", 4, force, d->f));
    for (int i = d->ntrajectory - 1; i >= 0 && !whole; --i) {
        double *to = pm_field_force(d, i, 0);
        memmove(to + width, d->f + (size_t)i * count, count * sizeof *to);
        memset(to, 0, width * sizeof *to);
    }
    if (pm_hdf5_has(file, "/energy")) {
        d->energy = pm_arena_array(&d->arena, nenergy, sizeof *d->energy);
        PM_TRY(pm_arena_status(&d->arena, "a field"));
        PM_TRY(pm_hdf5_read(file, "/energy", 3, energy, d->energy));
        PM_TRY(check_finite(d->energy, nenergy, path, "energy"));
    }
    // A mesh of whole numbers, as other tools may write it, is ignored.
    int mesh[2];
    if (pm_hdf5_has(file, "/hexahedra") && pm_hdf5_shape(file, "/hexahedra", 2, mesh) == PM_OK) {
        d->nelement = mesh[0];
        mesh[1] = 8;
        d->hexahedron = pm_arena_array(&d->arena, 8 * (size_t)d->nelement, sizeof *d->hexahedron);
        PM_TRY(pm_arena_status(&d->arena, "a field"));
        PM_TRY(pm_hdf5_read(file, "/hexahedra", 2, mesh, d->hexahedron));
        for (size_t i = 0; i < 8 * (size_t)d->nelement; ++i) {
            if (!(d->hexahedron[i] >= 0 && d->hexahedron[i] < d->nnode)) {
                return pm_fail(PM_EDATA, "%s: hexahedron %zu names node %g, expected 0 to %d", path,
                               i / 8, d->hexahedron[i], d->nnode - 1);
            }
        }
    }
    PM_TRY(pm_times_check(path, d->ntime, d->t, d->dt));
    PM_TRY(check_finite(d->position, 3 * nnode, path, "node_position_reference"));
    PM_TRY(check_finite(d->f, 3 * nstate, path, "f"));
    PM_TRY(check_finite(d->z, nstate * (size_t)d->nvariable, path, "z"));
    if (d->contact != NULL) {
        const int contact[4] = {d->ntrajectory, d->ntime, d->nnode, 3};
        PM_TRY(pm_hdf5_read(file, "/" CONTACT, 4, contact, d->contact));
        PM_TRY(check_finite(d->contact, 3 * nstate, path, CONTACT));
    }
    return PM_OK;
}

static pm_status load(pm_field **field, const char *path) {
    pm_hdf5 *file = NULL;
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_field *d = NULL;
    int shape[4];
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, "/z", 4, shape));
    PM_TRY_DONE(field_alloc(&d, (pm_field_shape){.ntrajectory = shape[0],
                                                 .ntime = shape[1],
                                                 .nnode = shape[2],
                                                 .nvariable = shape[3],
                                                 .contact = pm_hdf5_has(file, "/" CONTACT)}));
    PM_TRY_DONE(read_content(d, file, path));
    d->placed = pm_hdf5_is_text(file, "/", PLACEMENT);
    if (d->placed) { // the entries of a map without its braces
        const char *text;
        PM_TRY_DONE(pm_hdf5_read_text(file, "/", PLACEMENT, &d->arena, &text));
        text = pm_arena_printf(&d->arena, "{%s}", text);
        PM_TRY_DONE(pm_arena_status(&d->arena, "a placement"));
        status = pm_yaml_parse(&document, text, "placement", &root);
        status = status == PM_OK ? pm_placement_read(root, &d->arena, &d->placement) : status;
        PM_TRY_DONE(status == PM_ECONFIG ? pm_fail(PM_EDATA, "%s: %s", path, pm_error()) : status);
    }
    *field = d;
    d = NULL;
done:
    pm_field_free(d);
    pm_yaml_close(document);
    pm_hdf5_close(file);
    return status;
}

static void try_load(const void *path) {
    pm_field *field = NULL;
    (void)load(&field, path);
    pm_field_free(field);
}

pm_status pm_field_load(pm_field **field, const char *path) {
    PM_TRY(pm_hdf5_try(path, try_load, path));
    return load(field, path);
}

int pm_field_columns(const pm_field *field, const char *names) {
    const size_t length = strlen(names);
    int column = 0;
    for (const char *at = field->variable; *at != '\0'; ++column) {
        if (strncmp(at, names, length) == 0 && (at[length] == ' ' || at[length] == '\0')) {
            return column;
        }
        at += strcspn(at, " ");
        at += strspn(at, " ");
    }
    return -1;
}

// --- saving ---

pm_status pm_field_save(const pm_field *d, const char *path, int count,
                        const char *const (*note)[2]) {
    const int shape[4] = {d->ntrajectory, d->ntime, d->nnode, d->nvariable};
    const int force[4] = {d->ntrajectory, d->ntime, d->nnode, 3};
    const int position[2] = {d->nnode, 3}, hexahedron[2] = {d->nelement, 8};
    const int energy[3] = {d->ntrajectory, d->ntime, PM_FIELD_ENERGIES};
    const int total_force[3] = {d->ntrajectory, d->ntime, 3};
    const size_t nstate = (size_t)d->ntrajectory * (size_t)d->ntime, width = 3 * (size_t)d->nnode;
    double *total = NULL; // [ntrajectory][ntime][3] N, sum of the contact forces
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    for (int i = 0; i < count; ++i) {
        PM_TRY_DONE(pm_hdf5_write_text(file, "/", note[i][0], note[i][1]));
    }
    if (d->placed) {
        const pm_placement *p = &d->placement;
        char text[160];
        snprintf(text, sizeof text, "origin: [%.17g, %.17g, %.17g], axes: [%c%c, %c%c, %c%c]",
                 p->origin[0], p->origin[1], p->origin[2], p->sign[0] > 0 ? '+' : '-',
                 "xyz"[p->axis[0]], p -> sign[1] > 0 ? '+' : '-', "xyz"[p->axis[1]],
                 p -> sign[2] > 0 ? '+' : '-', "xyz"[p->axis[2]]);
        PM_TRY_DONE(pm_hdf5_write_text(file, "/", PLACEMENT, text));
    }
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", LAYOUT, d->variable));
    PM_TRY_DONE(pm_hdf5_write(file, "/dt", 0, NULL, &d->dt));
    PM_TRY_DONE(pm_hdf5_write(file, "/t", 1, &shape[1], d->t));
    PM_TRY_DONE(pm_hdf5_write(file, "/z", 4, shape, d->z));
    PM_TRY_DONE(pm_hdf5_write(file, "/f", 4, force, d->f));
    PM_TRY_DONE(pm_hdf5_write(file, "/node_position_reference", 2, position, d->position));
    PM_TRY_DONE(pm_hdf5_write(file, "/hexahedra", 2, hexahedron, d->hexahedron));
    PM_TRY_DONE(
        pm_hdf5_write_text(file, "/z", "description", "[trajectory][time][node][variable]"));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/f", "description", "[trajectory][time][node][xyz], N"));
    // What only a simulator knows.
    if (d->clamped != NULL) {
        PM_TRY_DONE(pm_hdf5_write(file, "/clamped", 1, &d->nnode, d->clamped));
    }
    if (d->energy != NULL) {
        PM_TRY_DONE(pm_hdf5_write(file, "/energy", 3, energy, d->energy));
        PM_TRY_DONE(
            pm_hdf5_write_text(file, "/energy", "description",
                               "[trajectory][time][stored, dissipated, work of the forces], J"));
    }
    if (d->contact != NULL) {
        total = calloc(3 * nstate, sizeof *total);
        PM_TRY_DONE(pm_allocated(total, "a field"));
        for (size_t i = 0; i < nstate * width; ++i) {
            total[3 * (i / width) + i % 3] += d->contact[i];
        }
        PM_TRY_DONE(pm_hdf5_write(file, "/" CONTACT, 4, force, d->contact));
        PM_TRY_DONE(pm_hdf5_write(file, "/" CONTACT "_total", 3, total_force, total));
        PM_TRY_DONE(pm_hdf5_write(file, "/contact_work", 2, force, d->contact_work));
        PM_TRY_DONE(
            pm_hdf5_write_text(file, "/" CONTACT, "description",
                               "[trajectory][time][node][xyz], N, from the bodies in contact"));
        PM_TRY_DONE(pm_hdf5_write_text(file, "/" CONTACT "_total", "description",
                                       "[trajectory][time][xyz], N, sum over the nodes"));
        PM_TRY_DONE(pm_hdf5_write_text(file, "/contact_work", "description",
                                       "[trajectory][time], J, of the contact forces"));
    }
    status = pm_hdf5_commit(file);
done:
    free(total);
    pm_hdf5_close(file);
    return status;
}

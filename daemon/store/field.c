// Fields on a mesh: their memory, and the HDF5 layout that field.h describes.
#include "store/field.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/attempt.h"
#include "store/hdf5_io.h"
#include "store/times.h"

#define LAYOUT "state_layout"
#define CONTACT "contact_force"
#define PLACEMENT "placement"

// --- memory ---

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "field: out of memory");
}

void pm_field_free(pm_field *field) {
    if (field != NULL) {
        pm_arena_free(&field->arena);
        free(field);
    }
}

// Makes a field with the arrays that every field has.
static pm_status field_alloc(pm_field **field, pm_field_shape shape) {
    const size_t nstate = (size_t)shape.ntrajectory * (size_t)shape.ntime;
    const size_t nnode = (size_t)shape.nnode;
    pm_field *d = calloc(1, sizeof *d);
    if (d == NULL) {
        return fail_memory();
    }
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
    if (d->t == NULL || d->z == NULL || d->f == NULL || d->position == NULL ||
        (shape.contact && d->contact == NULL)) {
        pm_field_free(d);
        return fail_memory();
    }
    *field = d;
    return PM_OK;
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
    if (d->hexahedron == NULL || d->clamped == NULL || d->energy == NULL || d->variable == NULL ||
        d->contact_work == NULL) {
        pm_field_free(d);
        return fail_memory();
    }
    d->dt = dt;
    for (int j = 0; j < d->ntime; ++j) {
        d->t[j] = j * dt;
    }
    *field = d;
    return PM_OK;
}

// --- loading ---

// Returns the first `count` words of `text`. NULL: out of memory, or there are fewer words.
static const char *first_words(pm_arena *arena, const char *text, int count) {
    const char *end = text;
    for (int i = 0; i < count; ++i) {
        end += strspn(end, " \t\n");
        if (*end == '\0') {
            return NULL;
        }
        end += strcspn(end, " \t\n");
    }
    return pm_arena_printf(arena, "%.*s", (int)(end - text), text);
}

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

// Reads the forces of all times, or of all but the first.
static pm_status read_forces(pm_field *d, const pm_hdf5 *file) {
    int shape[4];
    PM_TRY(pm_hdf5_shape(file, "/f", 4, shape));
    const bool whole = shape[1] != d->ntime - 1;
    const int expected[4] = {d->ntrajectory, whole ? d->ntime : d->ntime - 1, d->nnode, 3};
    const size_t width = 3 * (size_t)d->nnode, count = (size_t)expected[1] * width;
    PM_TRY(pm_hdf5_read(file, "/f", 4, expected, d->f));
    // Moves each trajectory, from the last one on, behind the zeros of its first time.
    for (int i = d->ntrajectory - 1; i >= 0 && !whole; --i) {
        double *to = pm_field_force(d, i, 0);
        memmove(to + width, d->f + (size_t)i * count, count * sizeof *to);
        memset(to, 0, width * sizeof *to);
    }
    return PM_OK;
}

static pm_status read_contact(pm_field *d, const pm_hdf5 *file, const char *path) {
    const int shape[4] = {d->ntrajectory, d->ntime, d->nnode, 3};
    const size_t count = 3 * (size_t)d->ntrajectory * (size_t)d->ntime * (size_t)d->nnode;
    PM_TRY(pm_hdf5_read(file, "/" CONTACT, 4, shape, d->contact));
    return check_finite(d->contact, count, path, CONTACT);
}

// Reads the mesh if the file has one of floating-point numbers. A mesh of whole numbers, as other
// tools may write it, is ignored.
static pm_status read_mesh(pm_field *d, const pm_hdf5 *file, const char *path) {
    int shape[2];
    if (!pm_hdf5_has(file, "/hexahedra") || pm_hdf5_shape(file, "/hexahedra", 2, shape) != PM_OK) {
        return PM_OK;
    }
    const int expected[2] = {shape[0], 8};
    d->nelement = shape[0];
    d->hexahedron = pm_arena_array(&d->arena, 8 * (size_t)d->nelement, sizeof *d->hexahedron);
    if (d->hexahedron == NULL) {
        return fail_memory();
    }
    PM_TRY(pm_hdf5_read(file, "/hexahedra", 2, expected, d->hexahedron));
    for (size_t i = 0; i < 8 * (size_t)d->nelement; ++i) {
        if (!(d->hexahedron[i] >= 0 && d->hexahedron[i] < d->nnode)) {
            return pm_fail(PM_EDATA, "%s: hexahedron %zu names node %g, expected 0 to %d", path,
                           i / 8, d->hexahedron[i], d->nnode - 1);
        }
    }
    return PM_OK;
}

// Reads the energies if the file has them.
static pm_status read_energies(pm_field *d, const pm_hdf5 *file, const char *path) {
    const int shape[3] = {d->ntrajectory, d->ntime, PM_FIELD_ENERGIES};
    const size_t count = (size_t)d->ntrajectory * (size_t)d->ntime * PM_FIELD_ENERGIES;
    if (!pm_hdf5_has(file, "/energy")) {
        return PM_OK;
    }
    d->energy = pm_arena_array(&d->arena, count, sizeof *d->energy);
    if (d->energy == NULL) {
        return fail_memory();
    }
    PM_TRY(pm_hdf5_read(file, "/energy", 3, shape, d->energy));
    return check_finite(d->energy, count, path, "energy");
}

static pm_status read_content(pm_field *d, const pm_hdf5 *file, const char *path) {
    const int shape[4] = {d->ntrajectory, d->ntime, d->nnode, d->nvariable};
    const int position[2] = {d->nnode, 3};
    const size_t nstate = (size_t)d->ntrajectory * (size_t)d->ntime * (size_t)d->nnode;
    const char *layout;
    PM_TRY(pm_hdf5_read_text(file, "/", LAYOUT, &d->arena, &layout));
    d->variable = first_words(&d->arena, layout, d->nvariable);
    if (d->variable == NULL) {
        return pm_fail(PM_EDATA, "%s: " LAYOUT " is \"%s\", expected %d names", path, layout,
                       d->nvariable);
    }
    PM_TRY(pm_hdf5_read(file, "/dt", 0, NULL, &d->dt));
    PM_TRY(pm_hdf5_read(file, "/t", 1, &shape[1], d->t));
    PM_TRY(pm_hdf5_read(file, "/z", 4, shape, d->z));
    PM_TRY(pm_hdf5_read(file, "/node_position_reference", 2, position, d->position));
    PM_TRY(read_forces(d, file));
    PM_TRY(read_energies(d, file, path));
    PM_TRY(read_mesh(d, file, path));
    PM_TRY(pm_times_check(path, d->ntime, d->t, d->dt));
    PM_TRY(check_finite(d->position, 3 * (size_t)d->nnode, path, "node_position_reference"));
    PM_TRY(check_finite(d->f, 3 * nstate, path, "f"));
    return check_finite(d->z, nstate * (size_t)d->nvariable, path, "z");
}

static pm_status read_placement(pm_field *d, const pm_hdf5 *file, const char *path) {
    const char *text;
    d->placed = pm_hdf5_is_text(file, "/", PLACEMENT);
    if (!d->placed) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_read_text(file, "/", PLACEMENT, &d->arena, &text));
    return pm_placement_parse(text, path, &d->placement);
}

static pm_status load(pm_field **field, const char *path) {
    pm_hdf5 *file = NULL;
    pm_field *d = NULL;
    int shape[4];
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, "/z", 4, shape));
    const bool contact = pm_hdf5_has(file, "/" CONTACT);
    PM_TRY_DONE(field_alloc(&d, (pm_field_shape){.ntrajectory = shape[0],
                                                 .ntime = shape[1],
                                                 .nnode = shape[2],
                                                 .nvariable = shape[3],
                                                 .contact = contact}));
    PM_TRY_DONE(read_content(d, file, path));
    if (contact) {
        PM_TRY_DONE(read_contact(d, file, path));
    }
    PM_TRY_DONE(read_placement(d, file, path));
    *field = d;
    d = NULL;
done:
    pm_field_free(d);
    pm_hdf5_close(file);
    return status;
}

static void try_load(const void *path) {
    pm_field *field = NULL;
    (void)load(&field, path);
    pm_field_free(field);
}

// As in dataset.c, a child process first opens a file of another tool.
pm_status pm_field_load(pm_field **field, const char *path) {
    if (!pm_hdf5_is_own(path)) {
        char what[512];
        snprintf(what, sizeof what, "%s: the file is damaged: the HDF5 library crashes on it",
                 path);
        PM_TRY(pm_attempt(try_load, path, PM_EFILE, what));
    }
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

// Writes energies, clamped nodes and contact forces, which only a simulator knows.
static pm_status write_known(const pm_field *d, pm_hdf5 *file) {
    const int energy[3] = {d->ntrajectory, d->ntime, PM_FIELD_ENERGIES};
    if (d->clamped != NULL) {
        PM_TRY(pm_hdf5_write(file, "/clamped", 1, &d->nnode, d->clamped));
    }
    if (d->energy == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_write(file, "/energy", 3, energy, d->energy));
    return pm_hdf5_write_text(file, "/energy", "description",
                              "[trajectory][time][stored, dissipated, work of the forces], J");
}

static pm_status write_content(const pm_field *d, pm_hdf5 *file) {
    const int shape[4] = {d->ntrajectory, d->ntime, d->nnode, d->nvariable};
    const int force[4] = {d->ntrajectory, d->ntime, d->nnode, 3};
    const int position[2] = {d->nnode, 3}, hexahedron[2] = {d->nelement, 8};
    PM_TRY(pm_hdf5_write_text(file, "/", LAYOUT, d->variable));
    PM_TRY(pm_hdf5_write(file, "/dt", 0, NULL, &d->dt));
    PM_TRY(pm_hdf5_write(file, "/t", 1, &shape[1], d->t));
    PM_TRY(pm_hdf5_write(file, "/z", 4, shape, d->z));
    PM_TRY(pm_hdf5_write(file, "/f", 4, force, d->f));
    PM_TRY(pm_hdf5_write(file, "/node_position_reference", 2, position, d->position));
    PM_TRY(pm_hdf5_write(file, "/hexahedra", 2, hexahedron, d->hexahedron));
    PM_TRY(pm_hdf5_write_text(file, "/z", "description", "[trajectory][time][node][variable]"));
    PM_TRY(pm_hdf5_write_text(file, "/f", "description", "[trajectory][time][node][xyz], N"));
    return write_known(d, file);
}

// Sums the contact forces over the nodes: result [ntrajectory][ntime][3], N. The caller frees.
// PM_ENOMEM.
static pm_status sum_contact(const pm_field *d, double **result) {
    const size_t nstate = (size_t)d->ntrajectory * (size_t)d->ntime, width = 3 * (size_t)d->nnode;
    double *total = calloc(3 * nstate, sizeof *total);
    if (total == NULL) {
        return fail_memory();
    }
    for (size_t i = 0; i < nstate * width; ++i) {
        total[3 * (i / width) + i % 3] += d->contact[i];
    }
    *result = total;
    return PM_OK;
}

static pm_status write_contact(const pm_field *d, pm_hdf5 *file) {
    const int force[4] = {d->ntrajectory, d->ntime, d->nnode, 3};
    const int total_force[3] = {d->ntrajectory, d->ntime, 3};
    double *total = NULL;
    pm_status status;
    PM_TRY_DONE(sum_contact(d, &total));
    PM_TRY_DONE(pm_hdf5_write(file, "/" CONTACT, 4, force, d->contact));
    PM_TRY_DONE(pm_hdf5_write(file, "/" CONTACT "_total", 3, total_force, total));
    PM_TRY_DONE(pm_hdf5_write(file, "/contact_work", 2, force, d->contact_work));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/" CONTACT, "description",
                                   "[trajectory][time][node][xyz], N, from the bodies in contact"));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/" CONTACT "_total", "description",
                                   "[trajectory][time][xyz], N, sum over the nodes"));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/contact_work", "description",
                                   "[trajectory][time], J, of the contact forces"));
done:
    free(total);
    return status;
}

static pm_status write_placement(const pm_field *field, pm_hdf5 *file) {
    const pm_placement *p = &field->placement;
    const char *const axis[3] = {"x", "y", "z"};
    char text[160];
    snprintf(text, sizeof text, "origin: [%.17g, %.17g, %.17g], axes: [%s%s, %s%s, %s%s]",
             p->origin[0], p->origin[1], p->origin[2], p->sign[0] > 0 ? "+" : "-", axis[p->axis[0]],
             p->sign[1] > 0 ? "+" : "-", axis[p->axis[1]], p->sign[2] > 0 ? "+" : "-",
             axis[p->axis[2]]);
    return pm_hdf5_write_text(file, "/", PLACEMENT, text);
}

pm_status pm_field_save(const pm_field *field, const char *path, int count,
                        const char *const (*note)[2]) {
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    for (int i = 0; i < count; ++i) {
        PM_TRY_DONE(pm_hdf5_write_text(file, "/", note[i][0], note[i][1]));
    }
    PM_TRY_DONE(field->placed ? write_placement(field, file) : PM_OK);
    PM_TRY_DONE(write_content(field, file));
    if (field->contact != NULL) {
        PM_TRY_DONE(write_contact(field, file));
    }
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    return status;
}

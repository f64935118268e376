// Memory and features of a basis, and its HDF5 file, in which scalars are attributes of / and
// arrays are datasets.
#include "bodies/modal/basis.h"

#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "store/hdf5_io.h"

#define LARGEST 100000 // nodes or elements that a file may ask for

// --- memory ---

pm_status pm_basis_new(pm_basis **basis, int nnode, int nmode, int nstate, int nlead) {
    pm_basis *b = NULL;
    PM_TRY(PM_NEW(b, "a basis"));
    b->nnode = nnode;
    b->nmode = nmode;
    b->nstate = nstate;
    b->nlead = nlead;
    const size_t width = 3 * (size_t)nnode;
    b->position = pm_arena_array(&b->arena, width, sizeof *b->position);
    b->mode = pm_arena_array(&b->arena, (size_t)nmode * width, sizeof *b->mode);
    b->stiffness = pm_arena_array(&b->arena, (size_t)nmode, sizeof *b->stiffness);
    b->lead_scale = pm_arena_array(&b->arena, (size_t)nlead, sizeof *b->lead_scale);
    PM_RETURN_NEW(basis, b, "a basis");
}

pm_status pm_basis_add_mesh(pm_basis *basis, int nelement) {
    basis->nelement = nelement;
    basis->hexahedron =
        pm_arena_array(&basis->arena, 8 * (size_t)nelement, sizeof *basis->hexahedron);
    return pm_arena_status(&basis->arena, "a basis");
}

pm_status pm_basis_add_pattern(pm_basis *basis, pm_pattern *pattern, int rank, int width) {
    const size_t nfeature = (size_t)pm_basis_features(basis), r = (size_t)rank;
    pattern->rank = rank;
    pattern->width = width;
    pattern->coefficient =
        pm_arena_array(&basis->arena, nfeature * r, sizeof *pattern->coefficient);
    pattern->pattern = pm_arena_array(&basis->arena, r * (size_t)width, sizeof *pattern->pattern);
    return pm_arena_status(&basis->arena, "a basis");
}

void pm_basis_free(pm_basis *basis) {
    PM_DELETE(basis);
}

// --- identity ---

void pm_basis_coordinates(const pm_basis *b, char text[PM_BASIS_COORDINATES]) {
    const size_t nmode = (size_t)b->nmode;
    uint64_t digest = pm_digest_integer(PM_DIGEST_INIT, b->nmode);
    digest = pm_digest_integer(digest, b->nstate);
    digest = pm_digest_doubles(digest, b->mode, 3 * nmode * (size_t)b->nnode);
    digest = pm_digest_doubles(digest, b->stiffness, nmode);
    digest = pm_digest_doubles(digest, b->tau, (size_t)b->nbranch);
    digest = pm_digest_doubles(digest, &b->inertia_time, 1);
    digest = pm_digest_doubles(digest, &b->temperature, 1);
    snprintf(text, PM_BASIS_COORDINATES, "basis %016" PRIx64, digest);
}

pm_status pm_basis_check(const pm_basis *basis, const char *text, const char *what) {
    char own[PM_BASIS_COORDINATES];
    pm_basis_coordinates(basis, own);
    return text == NULL || *text == '\0' || strcmp(text, own) == 0
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: made with %.64s, but the basis given is %s", what, text,
                         own);
}

// --- internal variables ---

// The solution is  y' = r y + (m - r) before + (1 - m) now,  r = exp(-dt/tau),  m = (1 - r) tau/dt.
void pm_basis_relax(int count, double tau, double dt, const double *before, const double *now,
                    double *y) {
    const double r = exp(-dt / tau), m = (1 - r) * tau / dt;
    for (int i = 0; i < count; ++i) {
        y[i] = r * y[i] + (m - r) * before[i] + (1 - m) * now[i];
    }
}

// --- features ---

int pm_basis_features(const pm_basis *b) {
    const int n = b->nlead, products = n * (n + 1) / 2 + n * (n + 1) * (n + 2) / 6;
    return (1 + b->nbranch) * (b->nstate + products) + (1 + b->nretardation) * b->nmode;
}

// Fills in the products of two and three of the leading numbers, and returns their end.
static double *fill_products(const pm_basis *b, const double *a, double *feature) {
    for (int i = 0; i < b->nlead; ++i) {
        const double x = a[i] / b->lead_scale[i];
        for (int j = i; j < b->nlead; ++j) {
            const double xy = x * a[j] / b->lead_scale[j];
            *feature++ = xy;
            for (int k = j; k < b->nlead; ++k) {
                *feature++ = xy * a[k] / b->lead_scale[k];
            }
        }
    }
    return feature;
}

void pm_basis_fill_features(const pm_basis *b, const pm_modal_state *state, double *feature) {
    const size_t n = (size_t)b->nstate, nc = n * (size_t)b->nbranch;
    memcpy(feature, state->a, n * sizeof *feature);
    feature += n;
    if (nc > 0) {
        memcpy(feature, state->c, nc * sizeof *feature);
        feature += nc;
    }
    memcpy(feature, state->load, (size_t)b->nmode * sizeof *feature);
    feature = fill_products(b, state->a, feature + b->nmode);
    for (int k = 0; k < b->nbranch; ++k) {
        feature = fill_products(b, state->c + (size_t)k * n, feature);
    }
    if (b->nretardation > 0) {
        memcpy(feature, state->delayed,
               (size_t)b->nretardation * (size_t)b->nmode * sizeof *feature);
    }
}

void pm_pattern_add(const pm_pattern *pattern, int nfeature, const double *feature, double *value) {
    for (int r = 0; r < pattern->rank; ++r) {
        double amplitude = 0;
        for (int i = 0; i < nfeature; ++i) {
            amplitude += feature[i] * pattern->coefficient[i * pattern->rank + r];
        }
        const double *shape = pattern->pattern + (ptrdiff_t)r * pattern->width;
        for (int i = 0; i < pattern->width; ++i) {
            value[i] += amplitude * shape[i];
        }
    }
}

// --- files ---

static pm_status read_pattern(pm_basis *b, pm_pattern *p, const pm_hdf5 *file, const char *path,
                              const char *name, int width) {
    char coefficient[64], pattern[64];
    snprintf(coefficient, sizeof coefficient, "/%s/coefficient", name);
    snprintf(pattern, sizeof pattern, "/%s/pattern", name);
    int shape[2];
    PM_TRY(pm_hdf5_shape(file, coefficient, 2, shape));
    if (shape[1] > PM_BASIS_MAX_RANK) {
        return pm_fail(PM_EDATA, "%s: %s has rank %d, at most %d is possible", path, name, shape[1],
                       PM_BASIS_MAX_RANK);
    }
    PM_TRY(pm_basis_add_pattern(b, p, shape[1], width));
    const int expected[2] = {pm_basis_features(b), shape[1]}, wide[2] = {shape[1], width};
    PM_TRY(pm_hdf5_read(file, coefficient, 2, expected, p->coefficient));
    return pm_hdf5_read(file, pattern, 2, wide, p->pattern);
}

static pm_status write_pattern(const pm_basis *b, const pm_pattern *p, pm_hdf5 *file,
                               const char *name) {
    char path[64];
    const int coefficient[2] = {pm_basis_features(b), p->rank}, pattern[2] = {p->rank, p->width};
    snprintf(path, sizeof path, "/%s/coefficient", name);
    PM_TRY(pm_hdf5_write(file, path, 2, coefficient, p->coefficient));
    snprintf(path, sizeof path, "/%s/pattern", name);
    return pm_hdf5_write(file, path, 2, pattern, p->pattern);
}

static bool is_finite(size_t count, const double *value) {
    for (size_t i = 0; i < count; ++i) {
        if (!isfinite(value[i])) {
            return false;
        }
    }
    return true;
}

static bool is_positive(size_t count, const double *value) {
    for (size_t i = 0; i < count; ++i) {
        if (!(value[i] > 0 && isfinite(value[i]))) {
            return false;
        }
    }
    return true;
}

static bool pattern_is_finite(const pm_basis *b, const pm_pattern *p) {
    const size_t rank = (size_t)p->rank;
    return is_finite((size_t)pm_basis_features(b) * rank, p->coefficient) &&
           is_finite(rank * (size_t)p->width, p->pattern);
}

// Reads a list of times, which may be missing.
static pm_status read_times(const pm_hdf5 *file, const char *path, const char *name, int *count,
                            double *time) {
    int n = 0;
    if (!pm_hdf5_has(file, name)) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_shape(file, name, 1, &n));
    if (n > PM_BASIS_MAX_BRANCHES) {
        return pm_fail(PM_EDATA, "%s: %s has %d times, at most %d are possible", path, name, n,
                       PM_BASIS_MAX_BRANCHES);
    }
    *count = n;
    return pm_hdf5_read(file, name, 1, &n, time);
}

static pm_status read_content(pm_basis *b, const pm_hdf5 *file, const char *path) {
    const int position[2] = {b->nnode, 3}, mode[3] = {b->nmode, b->nnode, 3};
    PM_TRY(pm_hdf5_read_number(file, "/", "inertia_time_s", &b->inertia_time));
    PM_TRY(pm_hdf5_read_number(file, "/", "temperature_K", &b->temperature));
    PM_TRY(pm_hdf5_read(file, "/position", 2, position, b->position));
    if (!is_finite(3 * (size_t)b->nnode, b->position)) {
        return pm_fail(PM_EDATA, "%s: a position is not finite", path);
    }
    PM_TRY(pm_hdf5_read(file, "/mode", 3, mode, b->mode));
    PM_TRY(pm_hdf5_read(file, "/stiffness", 1, &b->nmode, b->stiffness));
    PM_TRY(pm_hdf5_read(file, "/lead_scale", 1, &b->nlead, b->lead_scale));
    if (pm_hdf5_has(file, "/hexahedra")) {
        int hexahedra[2];
        PM_TRY(pm_hdf5_shape(file, "/hexahedra", 2, hexahedra));
        if (hexahedra[0] > LARGEST) {
            return pm_fail(PM_EDATA, "%s: %d hexahedra, at most %d are possible", path,
                           hexahedra[0], LARGEST);
        }
        PM_TRY(pm_basis_add_mesh(b, hexahedra[0]));
        hexahedra[1] = 8;
        PM_TRY(pm_hdf5_read(file, "/hexahedra", 2, hexahedra, b->hexahedron));
    }
    PM_TRY(read_times(file, path, "/relaxation_time", &b->nbranch, b->tau));
    PM_TRY(read_times(file, path, "/retardation_time", &b->nretardation, b->retardation));
    if (b->nretardation > 0 && b->nretardation != b->nbranch) {
        return pm_fail(PM_EDATA, "%s: %d retardation times, expected 0 or %d as of relaxation",
                       path, b->nretardation, b->nbranch);
    }
    PM_TRY(read_pattern(b, &b->displacement, file, path, "displacement", 3 * b->nnode));
    if (pm_hdf5_has(file, "/stress")) {
        PM_TRY(read_pattern(b, &b->stress, file, path, "stress", PM_BASIS_TENSOR * b->nnode));
    }
    // The sections of the local stress follow from the positions.
    if (pm_hdf5_has(file, "/local")) {
        pm_local *l = &b->local;
        int nloaded = 0, kernel[4] = {0};
        PM_TRY(pm_hdf5_shape(file, "/local/carries", 1, &nloaded));
        PM_TRY(pm_hdf5_shape(file, "/local/kernel", 4, kernel));
        double *value = pm_arena_array(&b->arena, (size_t)b->nnode, sizeof *value);
        int *carries = pm_arena_array(&b->arena, (size_t)b->nnode, sizeof *carries);
        PM_TRY(pm_arena_status(&b->arena, "a basis"));
        PM_TRY(pm_hdf5_read(file, "/local/carries", 1, &b->nnode, value));
        for (int i = 0; i < b->nnode; ++i) {
            carries[i] = value[i] != 0;
        }
        if (kernel[0] % 2 == 0 || kernel[0] / 2 > PM_LOCAL_MAX_REACH) {
            return pm_fail(PM_EDATA,
                           "%s: the local kernel has %d offsets, expected an odd number up to %d",
                           path, kernel[0], 2 * PM_LOCAL_MAX_REACH + 1);
        }
        PM_TRY(pm_local_find_sections(l, b->nnode, b->position, &b->arena));
        PM_TRY(pm_local_set_loaded(l, carries, kernel[0] / 2, &b->arena));
        const int shape[4] = {2 * l->reach + 1, 3 * l->nloaded, l->nper, PM_LOCAL_TENSOR};
        PM_TRY(pm_hdf5_read(file, "/local/kernel", 4, shape, l->kernel));
    }
    // Numbers by which the program divides must be positive, and all must be finite.
    const size_t width = 3 * (size_t)b->nnode;
    bool good =
        is_positive(1, &b->inertia_time) && is_positive(1, &b->temperature) &&
        is_positive((size_t)b->nmode, b->stiffness) &&
        is_positive((size_t)b->nlead, b->lead_scale) && is_positive((size_t)b->nbranch, b->tau) &&
        is_positive((size_t)b->nretardation, b->retardation) &&
        is_finite((size_t)b->nmode * width, b->mode) && pattern_is_finite(b, &b->displacement);
    good = good && (b->stress.rank == 0 || pattern_is_finite(b, &b->stress));
    for (int i = 0; i < 8 * b->nelement; ++i) {
        good = good && b->hexahedron[i] >= 0 && b->hexahedron[i] < b->nnode &&
               b->hexahedron[i] == floor(b->hexahedron[i]);
    }
    const pm_local *l = &b->local;
    const size_t kernel = (size_t)pm_local_features(l) * PM_LOCAL_TENSOR * (size_t)l->nper;
    good = good && (l->nsection == 0 || is_finite(kernel, l->kernel));
    return good ? PM_OK
                : pm_fail(PM_EDATA,
                          "%s: a number is not finite, a time, scale or stiffness is not > 0, or "
                          "an element has a node that does not exist",
                          path);
}

pm_status pm_basis_load(pm_basis **basis, const char *path) {
    pm_hdf5 *file = NULL;
    pm_basis *b = NULL;
    uint64_t nstate = 0;
    int mode[3], nlead = 0;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_OWN, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, "/mode", 3, mode));
    PM_TRY_DONE(pm_hdf5_shape(file, "/lead_scale", 1, &nlead));
    PM_TRY_DONE(pm_hdf5_read_integer(file, "/", "state_modes", &nstate));
    if (nstate < 1 || nstate > (uint64_t)mode[0]) {
        PM_TRY_DONE(pm_fail(PM_EDATA, "%s: state_modes is %llu, expected 1 to %d", path,
                            (unsigned long long)nstate, mode[0]));
    }
    if (mode[0] > PM_BASIS_MAX_MODES || mode[2] != 3 || mode[1] > LARGEST || nlead > (int)nstate) {
        PM_TRY_DONE(pm_fail(PM_EDATA,
                            "%s: %d modes of %d nodes with %d numbers each, %d of %d leading; "
                            "expected at most %d of %d with 3",
                            path, mode[0], mode[1], mode[2], nlead, (int)nstate, PM_BASIS_MAX_MODES,
                            LARGEST));
    }
    PM_TRY_DONE(pm_basis_new(&b, mode[1], mode[0], (int)nstate, nlead));
    PM_TRY_DONE(read_content(b, file, path));
    *basis = b;
    b = NULL;
done:
    pm_basis_free(b);
    pm_hdf5_close(file);
    return status;
}

pm_status pm_basis_save(const pm_basis *b, const char *path, const char *command) {
    const pm_local *l = &b->local;
    const int position[2] = {b->nnode, 3}, mode[3] = {b->nmode, b->nnode, 3};
    double *carries = NULL;
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", "command", command));
    PM_TRY_DONE(pm_hdf5_write_integer(file, "/", "state_modes", (uint64_t)b->nstate));
    PM_TRY_DONE(pm_hdf5_write_number(file, "/", "inertia_time_s", b->inertia_time));
    PM_TRY_DONE(pm_hdf5_write_number(file, "/", "temperature_K", b->temperature));
    PM_TRY_DONE(pm_hdf5_write(file, "/position", 2, position, b->position));
    PM_TRY_DONE(pm_hdf5_write(file, "/mode", 3, mode, b->mode));
    PM_TRY_DONE(pm_hdf5_write(file, "/stiffness", 1, &b->nmode, b->stiffness));
    PM_TRY_DONE(pm_hdf5_write(file, "/lead_scale", 1, &b->nlead, b->lead_scale));
    if (b->nelement > 0) {
        const int hexahedra[2] = {b->nelement, 8};
        PM_TRY_DONE(pm_hdf5_write(file, "/hexahedra", 2, hexahedra, b->hexahedron));
    }
    if (b->nbranch > 0) {
        PM_TRY_DONE(pm_hdf5_write(file, "/relaxation_time", 1, &b->nbranch, b->tau));
    }
    if (b->nretardation > 0) {
        PM_TRY_DONE(pm_hdf5_write(file, "/retardation_time", 1, &b->nretardation, b->retardation));
    }
    PM_TRY_DONE(write_pattern(b, &b->displacement, file, "displacement"));
    if (b->stress.rank > 0) {
        PM_TRY_DONE(write_pattern(b, &b->stress, file, "stress"));
    }
    if (l->nsection > 0) {
        const int shape[4] = {2 * l->reach + 1, 3 * l->nloaded, l->nper, PM_LOCAL_TENSOR};
        carries = calloc((size_t)b->nnode, sizeof *carries);
        PM_TRY_DONE(pm_allocated(carries, "a basis"));
        for (int i = 0; i < l->nloaded; ++i) {
            carries[l->node[l->loaded[i]]] = 1; // marked in the first section, for all sections
        }
        PM_TRY_DONE(pm_hdf5_write(file, "/local/carries", 1, &b->nnode, carries));
        PM_TRY_DONE(pm_hdf5_write(file, "/local/kernel", 4, shape, l->kernel));
    }
    status = pm_hdf5_commit(file);
done:
    free(carries);
    pm_hdf5_close(file);
    return status;
}

// Any bytes must read as a basis with which a body can be reconstructed, or be refused with a
// one-line error. Only bytes that pass store/hdf5_check.h reach the reader; all others are refused
// before.
#include <string.h>

#include "bodies/modal/basis.h"
#include "bytes_file.h"
#include "tests/fuzz/target.h"

static double *ones(size_t count) {
    double *value = malloc((count + 1) * sizeof *value);
    check(value != NULL);
    for (size_t i = 0; i < count; ++i) {
        value[i] = 1;
    }
    return value;
}

// All that reconstruction does with it at one time.
static void use(const pm_basis *b) {
    const size_t nstate = (size_t)b->nstate, nnode = (size_t)b->nnode;
    double *a = ones(nstate), *c = ones(nstate * (size_t)b->nbranch),
           *boundary_input = ones((size_t)b->nmode),
           *delayed = ones((size_t)b->nretardation * (size_t)b->nmode);
    double *feature = ones((size_t)pm_basis_features(b)), *work = ones(pm_local_work(&b->local));
    double *u = ones(3 * nnode), *stress = ones(PM_BASIS_TENSOR * nnode);
    pm_basis_fill_features(b, &(pm_modal_state){a, c, boundary_input, delayed}, feature);
    pm_pattern_add(&b->displacement, pm_basis_features(b), feature, u);
    pm_pattern_add(&b->stress, pm_basis_features(b), feature, stress);
    pm_local_add(&b->local, u, stress, work);
    for (size_t i = 0; i < 8 * (size_t)b->nelement; ++i) {
        check(b->hexahedron[i] >= 0 && b->hexahedron[i] < b->nnode);
    }
    free(a);
    free(c);
    free(boundary_input);
    free(delayed);
    free(feature);
    free(work);
    free(u);
    free(stress);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    pm_basis *basis = NULL;
    bytes_file(data, size);
    if (pm_basis_load(&basis, PM_FUZZ_FILE) == PM_OK) {
        use(basis);
    } else {
        check(basis == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
    }
    pm_basis_free(basis);
    return 0;
}

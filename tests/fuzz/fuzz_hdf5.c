// Any bytes must read as weights of a part or of a port or as a dataset, or be refused with a
// one-line error. Datasets are tried only if the bytes pass store/hdf5_check.h: dataset.c opens
// other files in a child process, since the HDF5 library crashes on some of them.
#include <string.h>

#include "bytes_file.h"
#include "scene/weights.h"
#include "store/dataset.h"
#include "store/hdf5_io.h"
#include "tests/fuzz/target.h"

static void check_status(pm_status status) {
    check(status == PM_OK || (pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL));
}

// Returns the status of the part, whose reader opens files written here alone.
static pm_status try_weights(void) {
    pm_arena arena = {0};
    pm_provenance provenance;
    pm_part part = {0};
    pm_port_model port = {0};
    const pm_status status =
        pm_weights_load(PM_FUZZ_FILE, &arena, pm_component_of_part(&part), &provenance);
    check_status(status);
    check_status(pm_weights_load(PM_FUZZ_FILE, &arena, pm_component_of_port(&port), &provenance));
    pm_part_free(&part);
    pm_port_free(&port);
    pm_arena_free(&arena);
    return status;
}

static void try_dataset(void) {
    pm_dataset *dataset = NULL;
    check_status(pm_dataset_load(&dataset, PM_FUZZ_FILE));
    pm_dataset_free(dataset);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bytes_file(data, size);
    const bool own = pm_hdf5_is_own(PM_FUZZ_FILE);
    const pm_status status = try_weights();
    if (!own) {
        check(status == PM_EWEIGHTS); // as all readers of what is written here alone
        return 0;
    }
    try_dataset();
    return 0;
}

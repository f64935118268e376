// Any bytes must read as weights of a part or of a port, as a checkpoint, as a dataset, or be
// refused with one line. Datasets only if they pass for written here: others are tried in a child
// process (dataset.c), since the library itself crashes on them.
#include <stdlib.h>
#include <string.h>

#include "bytes_file.h"
#include "store/checkpoint.h"
#include "store/dataset.h"
#include "store/hdf5_io.h"
#include "store/weights.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

static void check_status(pm_status status) {
    check(status == PM_OK || (pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *const path = PM_FUZZ_FILE;
    bytes_file(data, size);
    pm_arena arena = {0};
    pm_provenance provenance;
    pm_part part = {0};
    pm_port_model port = {0};
    check_status(pm_weights_load_part(path, &arena, &part, &provenance));
    check_status(pm_weights_load_port(path, &arena, &port, &provenance));
    pm_part_free(&part);
    pm_port_free(&port);
    pm_arena_free(&arena);
    pm_dataset *dataset = NULL;
    if (pm_hdf5_is_own(path)) {
        check_status(pm_dataset_load(&dataset, path));
    }
    pm_dataset_free(dataset);
    double value[3];
    const pm_checkpoint_field field[] = {{"theta", 2, value}, {"position", 1, value + 2}};
    check_status(pm_checkpoint_load(path, "fit", 7, 2, field));
    return 0;
}

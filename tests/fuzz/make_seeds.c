// make_seeds DIR: a small dataset and a checkpoint to begin with.
#include <stdio.h>
#include <unistd.h>

#include "store/checkpoint.h"
#include "store/dataset.h"

static pm_status make_dataset(void) {
    static const char *const column[] = {"q", "p"};
    pm_dataset *dataset = NULL;
    PM_TRY(pm_dataset_new(&dataset, 2, 3, 2, 0.5, column));
    pm_status status = pm_dataset_note(dataset, "source", "made for a fuzzer");
    if (status == PM_OK) {
        status = pm_dataset_save(dataset, "dataset.h5");
    }
    pm_dataset_free(dataset);
    return status;
}

static pm_status make_checkpoint(void) {
    double value[3] = {1, 2, 3};
    const pm_checkpoint_field field[] = {{"theta", 2, value}, {"position", 1, value + 2}};
    return pm_checkpoint_save("checkpoint.h5", "fit", 7, 2, field);
}

int main(int argc, char **argv) {
    if (argc != 2 || chdir(argv[1]) != 0) {
        return PM_EUSAGE;
    }
    pm_status status = make_dataset();
    if (status == PM_OK) {
        status = make_checkpoint();
    }
    if (status != PM_OK) {
        fprintf(stderr, "make_seeds: %s\n", pm_error());
    }
    return (int)status;
}

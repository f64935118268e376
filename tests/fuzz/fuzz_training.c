// Any text must read as a training file and as a truth file, or fail with a one-line error. The
// text is written to PM_FUZZ_FILE, in a folder from which it can refer to the shipped scenes.
#include <string.h>

#include "bodies/bodies.h"
#include "bytes_file.h"
#include "fit/training.h"
#include "tests/fuzz/target.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bytes_file(data, size);
    pm_training *training = NULL;
    if (pm_training_load(&training, PM_FUZZ_FILE) != PM_OK) {
        check(training == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
    }
    pm_training_free(training);
    pm_truth *truth = NULL;
    if (pm_truth_load(&truth, PM_FUZZ_FILE, pm_body_simulators) != PM_OK) {
        check(truth == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
    }
    pm_truth_free(truth);
    return 0;
}

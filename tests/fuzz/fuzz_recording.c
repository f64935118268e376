// Any bytes must read as a recording, or be refused with a one-line error: by the view, by a run
// that goes on with it or repeats its live inputs, and by the comparison of recordings. Each reader
// opens the file in a child process first, since the HDF5 library crashes on some files; what a
// child leaves as crash-* is no finding.
#include <fcntl.h>
#include <unistd.h>

// How a view reads a recording is private to it.
#include "app/command_view.c"
#include "tests/fuzz/target.h"

#include "bytes_file.h"
#include "scene/live_replay.h"
#include "small_scene.h"
#include "study/recordings.h"

#define SAMPLES 2 // with which a run would go on

static pm_status check_status(pm_status status) {
    check(status == PM_OK || (pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL));
    return status;
}

// Reads the recording as the page shows it, and writes what it is sent.
static void try_view(pm_scene *scene) {
    const pm_run_options options = {.recording = PM_FUZZ_FILE};
    view v = {.options = &options, .scene = scene, .datagrams = -1};
    char *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    check(file != NULL && make_graph(&v) == PM_OK);
    if (check_status(pm_hdf5_try(PM_FUZZ_FILE, try_read, &v)) == PM_OK &&
        check_status(read_recording(&v)) == PM_OK) {
        pm_view_progress progress = {0};
        while (write_next(&v, &progress, file)) {
        }
    }
    fclose(file);
    free(text);
    pm_arena_free(&v.arena);
}

static void try_replay(const pm_scene *scene) {
    pm_arena arena = {0};
    double *value = NULL;
    int64_t steps = 0;
    if (check_status(pm_live_replay_load(PM_FUZZ_FILE, scene, &arena, &value, &steps)) == PM_OK) {
        for (int64_t i = 0; i < steps * scene->network.nlive; ++i) {
            check(isfinite(value[i]));
        }
    }
    pm_arena_free(&arena);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static pm_scene *scene;
    if (scene == NULL) {
        check(pm_scene_parse(&scene, SMALL_SCENE, "small.yaml") == PM_OK);
    }
    bytes_file(data, size);
    char difference[256];
    try_view(scene);
    try_replay(scene);
    check_status(pm_recordings_compare(PM_FUZZ_FILE, PM_FUZZ_FILE, false, difference,
                                       (int)sizeof difference));
    pm_recording *recording = NULL;
    if (check_status(pm_recording_reopen(&recording, PM_FUZZ_FILE, scene, SAMPLES)) == PM_OK) {
        check_status(pm_recording_close(recording));
    }
    return 0;
}

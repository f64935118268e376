// Recordings: every number of every sample arrives where it belongs, and what was flushed outlives
// a killed writer.
#include <hdf5.h>
#include <malloc.h>
#include <math.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "base/rng.h"
#include "scene/recording.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

static pm_scene_subsystem subsystem[2] = {
    {.name = "left",
     .layout = {.ngroup = 2,
                .nz = 3,
                .group = (pm_group[]){{.name = "q", .unit = "m", .size = 2},
                                      {"s", "J/K", 1, 2, PM_ROLE_ENTROPY, false}}}},
    {.name = "right",
     .layout = {.ngroup = 1,
                .nz = 1,
                .group = (pm_group[]){{.name = "p", .unit = "kg m/s", .size = 1}}},
     .first = 3},
};
static pm_scene_port port[1] = {{.name = "joint", .subsystem = {1, 0}}};
static const pm_integrator method = {.name = "rk4"};
static const pm_scene scene = {.name = "trial",
                               .physics.integrator = &method,
                               .physics.dt = 0.5,
                               .physics.substeps = 2,
                               .physics.nsubsystem = 2,
                               .physics.subsystem = subsystem,
                               .physics.nport = 1,
                               .physics.port = port,
                               .physics.nz = 4};

// Sample `step`, in which every number is different: step + 0.001 times its place below.
static void fill(pm_sample *s, long step) {
    double place = 0;
    s->step = step;
    s->time = (double)step + (place += 0.001);
    for (int i = 0; i < 4; ++i) {
        s->z[i] = (double)step + (place += 0.001);
    }
    double *const perpart[] = {s->energy, s->entropy, s->bulk_energy, s->bulk_entropy};
    for (int k = 0; k < 4; ++k) {
        for (int i = 0; i < 2; ++i) {
            perpart[k][i] = (double)step + (place += 0.001);
        }
    }
    for (int end = 0; end < 2; ++end) {
        s->flux[0][end].energy = (double)step + (place += 0.001);
        s->flux[0][end].entropy = (double)step + (place += 0.001);
    }
    s->energy_residual = (double)step + (place += 0.001);
    s->entropy_residual = (double)step + (place += 0.001);
}

// Number of samples of a series, read into value [n][width], n at most 1000.
static int read_series(const char *path, const char *name, double *value) {
    hsize_t size[2] = {0, 0};
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t id = H5Dopen2(file, name, H5P_DEFAULT);
    if (id < 0) {
        fail_msg("%s has no %s", path, name);
    }
    const hid_t space = H5Dget_space(id);
    H5Sget_simple_extent_dims(space, size, NULL);
    assert_true(size[0] <= 1000);
    assert_true(H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0);
    H5Sclose(space);
    H5Dclose(id);
    H5Fclose(file);
    return (int)size[0];
}

static void assert_series(const char *path, const char *name, int count, double offset) {
    double value[1000];
    assert_int_equal(read_series(path, name, value), count);
    const bool flows = strstr(name, "flux") != NULL || strstr(name, "bulk") != NULL;
    assert_true(isnan(value[0]) == flows); // nothing has flowed before the first step
    for (int i = flows; i < count; ++i) {
        const double error = value[i] - (i + offset);
        if (!(error < 1e-9 && error > -1e-9)) {
            fail_msg("%s[%d] is %.17g, expected %.17g", name, i, value[i], i + offset);
        }
    }
}

static void assert_all_series(const char *path, int count) {
    double z[3000], sum[1000];
    assert_series(path, "/step", count, 0);
    assert_series(path, "/time", count, 0.001);
    assert_int_equal(read_series(path, "/subsystems/left/z", z), count);
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) {
            assert_true(z[3 * i + k] - (i + 0.001 * (k + 2)) < 1e-9);
        }
    }
    assert_series(path, "/subsystems/right/z", count, 0.005);
    assert_series(path, "/subsystems/left/E", count, 0.006);
    assert_series(path, "/subsystems/right/E", count, 0.007);
    assert_series(path, "/subsystems/left/S", count, 0.008);
    assert_series(path, "/subsystems/right/S", count, 0.009);
    assert_series(path, "/subsystems/left/bulk_energy", count, 0.010);
    assert_series(path, "/subsystems/right/bulk_energy", count, 0.011);
    assert_series(path, "/subsystems/left/bulk_entropy", count, 0.012);
    assert_series(path, "/subsystems/right/bulk_entropy", count, 0.013);
    assert_series(path, "/ports/joint/energy_flux_a", count, 0.014);
    assert_series(path, "/ports/joint/entropy_flux_a", count, 0.015);
    assert_series(path, "/ports/joint/energy_flux_b", count, 0.016);
    assert_series(path, "/ports/joint/entropy_flux_b", count, 0.017);
    assert_series(path, "/ledger/energy_residual", count, 0.018);
    assert_series(path, "/ledger/entropy_residual", count, 0.019);
    assert_int_equal(read_series(path, "/ledger/energy", sum), count);
    assert_true(sum[count - 1] - (2 * (count - 1) + 0.013) < 1e-9);
    assert_int_equal(read_series(path, "/ledger/entropy", sum), count);
    assert_true(sum[count - 1] - (2 * (count - 1) + 0.017) < 1e-9);
}

// More than two blocks, not a whole number of them.
static void every_number_arrives_where_it_belongs(void **state) {
    const char *path = scratch_path(*state, "run.h5");
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    assert_int_equal(pm_sample_new(&sample, &scene), PM_OK);
    assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
    for (long step = 0; step < 600; ++step) {
        fill(sample, step);
        assert_int_equal(pm_recording_append(recording, sample), PM_OK);
    }
    assert_int_equal(pm_recording_close(recording), PM_OK);
    pm_sample_free(sample);
    assert_all_series(path, 600);
}

static void append(pm_recording *recording, long from, long to) {
    pm_sample *sample = NULL;
    assert_int_equal(pm_sample_new(&sample, &scene), PM_OK);
    for (long step = from; step < to; ++step) {
        fill(sample, step);
        assert_int_equal(pm_recording_append(recording, sample), PM_OK);
    }
    pm_sample_free(sample);
}

// Gone on with after fewer samples than were flushed, after a whole block, and from the start.
static void a_recording_goes_on_where_it_is_told(void **state) {
    const char *path = scratch_path(*state, "run.h5");
    static const long from[] = {300, 256, 120, 0};
    pm_recording *recording = NULL;
    const pid_t child = fork();
    if (child == 0) {
        assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
        append(recording, 0, 310);
        assert_int_equal(pm_recording_flush(recording), PM_OK);
        append(recording, 310, 700);
        raise(SIGKILL);
    }
    assert_int_equal(waitpid(child, NULL, 0), child);
    for (int i = 0; i < 4; ++i) {
        pm_recording *again = NULL;
        assert_int_equal(pm_recording_reopen(&again, path, &scene, from[i]), PM_OK);
        append(again, from[i], 600);
        assert_int_equal(pm_recording_close(again), PM_OK);
        assert_all_series(path, 600);
    }
    assert_int_equal(pm_recording_reopen(&recording, path, &scene, 601), PM_EFILE);
    assert_non_null(strstr(pm_error(), "600 samples are certain, expected 601"));
    subsystem[1].name = "other";
    assert_int_equal(pm_recording_reopen(&recording, path, &scene, 5), PM_EFILE);
    subsystem[1].name = "right";
}

// The bytes of a file, up to `size`; how many there are.
static size_t load_bytes(const char *path, unsigned char *data, size_t size) {
    FILE *file = fopen(path, "rb");
    const size_t count = fread(data, 1, size, file);
    fclose(file);
    return count;
}

static void save_bytes(const char *path, const unsigned char *data, size_t size) {
    FILE *file = fopen(path, "wb");
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

// A file in which bits were changed may be gone on with, or not; it does not take this process
// along, as the library would at its end for the first of these.
static void a_damaged_recording_is_an_error(void **state) {
    enum { SIZE = 1 << 18, DAMAGES = 60 };
    static const uint64_t stream[] = {46, 0, 1, 3};
    static unsigned char good[SIZE], bad[SIZE];
    const char *path = scratch_path(*state, "damaged.h5");
    pm_recording *recording = NULL;
    assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
    append(recording, 0, 100);
    assert_int_equal(pm_recording_close(recording), PM_OK);
    const size_t size = load_bytes(path, good, SIZE);
    for (size_t i = 0; i < sizeof stream / sizeof stream[0]; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, 3, stream[i]);
        memcpy(bad, good, size);
        for (int k = 0; k < DAMAGES; ++k) {
            bad[pm_rng_below(&rng, size)] ^= (unsigned char)(1 << pm_rng_below(&rng, 8));
        }
        save_bytes(path, bad, size);
        const pid_t child = fork();
        if (child == 0) {
            const pm_status status = pm_recording_reopen(&recording, path, &scene, 50);
            const pm_status end = status == PM_OK ? pm_recording_close(recording) : status;
            H5close();
            _exit((int)end);
        }
        int end;
        assert_int_equal(waitpid(child, &end, 0), child);
        assert_true(WIFEXITED(end));
        assert_true(WEXITSTATUS(end) == PM_OK || WEXITSTATUS(end) == PM_EFILE);
    }
}

static void assert_texts(const char *path, const char *object, const char *name, int count,
                         const char *const *expected) {
    char text[4][32] = {{0}};
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t id = H5Aopen_by_name(file, object, name, H5P_DEFAULT, H5P_DEFAULT);
    const hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, sizeof text[0]);
    H5Tset_cset(type, H5T_CSET_UTF8);
    assert_true(H5Aread(id, type, text) >= 0);
    for (int i = 0; i < count; ++i) {
        assert_string_equal(text[i], expected[i]);
    }
    H5Tclose(type);
    H5Aclose(id);
    H5Fclose(file);
}

static void variables_and_units_are_written(void **state) {
    const char *path = scratch_path(*state, "run.h5");
    pm_recording *recording = NULL;
    assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
    assert_int_equal(pm_recording_close(recording), PM_OK);
    const char *const variables[] = {"q[0]", "q[1]", "s"}, *const units[] = {"m", "m", "J/K"};
    const char *const ends[] = {"right", "left"}, *const watt[] = {"W"};
    assert_texts(path, "/subsystems/left/z", "variables", 3, variables);
    assert_texts(path, "/subsystems/left/z", "units", 3, units);
    assert_texts(path, "/ports/joint", "ends", 2, ends);
    assert_texts(path, "/ports/joint/energy_flux_b", "units", 1, watt);
    double none[1];
    assert_int_equal(read_series(path, "/time", none), 0);
}

static void components_of_large_states_are_named_by_group(void **state) {
    const char *path = scratch_path(*state, "run.h5");
    pm_scene_subsystem body = {
        .name = "body",
        .layout = {.ngroup = 2,
                   .nz = 10001,
                   .group = (pm_group[]){{.name = "q", .unit = "m", .size = 10000},
                                         {"s", "J/K", 1, 10000, PM_ROLE_ENTROPY, false}}}};
    pm_scene large = {.name = "large",
                      .physics.integrator = &method,
                      .physics.nsubsystem = 1,
                      .physics.subsystem = &body,
                      .physics.nz = 10001};
    pm_recording *recording = NULL;
    assert_int_equal(pm_recording_open(&recording, path, &large), PM_OK);
    assert_int_equal(pm_recording_close(recording), PM_OK);
    const char *const variables[] = {"q[0:10000]", "s"}, *const units[] = {"m", "J/K"};
    assert_texts(path, "/subsystems/body/z", "variables", 2, variables);
    assert_texts(path, "/subsystems/body/z", "units", 2, units);
}

#define FLUSH_SECONDS 1.0 // as recording.c has it
#define MORE 5            // samples

// Appends until a flush was due, tells how many samples that were, appends more, and is killed.
static void record_and_die(const char *path, int out) {
    const struct timespec pause = {.tv_nsec = 15000000};
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    if (pm_sample_new(&sample, &scene) != PM_OK ||
        pm_recording_open(&recording, path, &scene) != PM_OK) {
        _exit(1);
    }
    const double opened = pm_clock();
    long step = 0, due = 0;
    for (bool late = false; step < due + MORE; ++step) {
        due = late ? due : step;
        late = late || pm_clock() - opened >= FLUSH_SECONDS;
        fill(sample, step);
        if (pm_recording_append(recording, sample) != PM_OK) {
            _exit(1);
        }
        nanosleep(&pause, NULL);
    }
    if (write(out, &due, sizeof due) != sizeof due) {
        _exit(1);
    }
    raise(SIGKILL);
}

static void what_was_flushed_outlives_a_killed_writer(void **state) {
    const char *path = scratch_path(*state, "killed.h5");
    int file[2];
    assert_int_equal(pipe(file), 0);
    const pid_t child = fork();
    if (child == 0) {
        record_and_die(path, file[1]);
    }
    int ending;
    long due = -1;
    close(file[1]);
    assert_int_equal(read(file[0], &due, sizeof due), sizeof due);
    close(file[0]);
    assert_int_equal(waitpid(child, &ending, 0), child);
    assert_true(WIFSIGNALED(ending) && WTERMSIG(ending) == SIGKILL);
    double value[1000];
    const int count = read_series(path, "/time", value);
    assert_in_range(count, due > 1 ? due : 1, due + MORE);
    assert_all_series(path, count);
}

static void a_recording_that_cannot_be_made_says_so(void **state) {
    scratch *folder = *state;
    pm_recording *recording = NULL;
    assert_int_equal(pm_recording_open(&recording, "/nonexistent/run.h5", &scene), PM_EFILE);
    assert_null(recording);
    assert_non_null(strstr(pm_error(), "/nonexistent/run.h5: cannot create"));
    assert_int_equal(pm_recording_open(&recording, folder->folder, &scene), PM_EFILE);
    assert_int_equal(pm_recording_close(NULL), PM_OK);
    pm_sample_free(NULL);
}

static void assert_refused(const char *path, const char *part) {
    assert_int_equal(pm_recording_check(path, false), PM_EFILE);
    if (strstr(pm_error(), part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", pm_error(), part);
    }
}

static void a_check_tells_beforehand_and_changes_nothing(void **state) {
    scratch *folder = *state;
    char path[256];
    snprintf(path, sizeof path, "%s", scratch_path(folder, "run.h5"));
    assert_int_equal(pm_recording_check(path, false), PM_OK);
    assert_int_equal(access(path, F_OK), -1);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs("old", file);
    fclose(file);
    assert_refused(path, "run.h5: this file exists and is of another kind");
    assert_int_equal(pm_recording_check(path, true), PM_OK);
    struct stat there;
    assert_int_equal(stat(path, &there), 0);
    assert_int_equal(there.st_size, 3);
    assert_int_equal(pm_recording_check("run.h5", false), PM_OK);
    assert_refused("", "name");
    assert_refused("/nonexistent/run.h5", "folder /nonexistent: No such file");
    assert_refused(folder->folder, "not a file");
    assert_refused("/dev/null", "not a file");
}

// A process that may not write files beyond a limit resembles one whose disk is full. It flushes
// the first 300 samples and sets the limit, in bytes, after as many samples as `unlimited` says.
// Its exit status says what went wrong. `left`: what the error says of the file.
static void record_beyond_the_limit(const char *path, rlim_t bytes, long unlimited,
                                    const char *left) {
    const struct rlimit limit = {.rlim_cur = bytes, .rlim_max = bytes};
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    signal(SIGXFSZ, SIG_IGN);
    if (pm_sample_new(&sample, &scene) != PM_OK ||
        pm_recording_open(&recording, path, &scene) != PM_OK) {
        _exit(2);
    }
    pm_status status = PM_OK;
    for (long step = 0; status == PM_OK && step < 6000; ++step) {
        if (step == unlimited && setrlimit(RLIMIT_FSIZE, &limit) != 0) {
            _exit(2);
        }
        fill(sample, step);
        status = pm_recording_append(recording, sample);
        if (status == PM_OK && step == 299) {
            status = pm_recording_flush(recording);
        }
    }
    const bool told = strstr(pm_error(), "full.h5: cannot write") != NULL &&
                      strstr(pm_error(), "(File too large)") != NULL &&
                      strstr(pm_error(), left) != NULL;
    const bool again = pm_recording_append(recording, sample) == PM_EFILE &&
                       pm_recording_flush(recording) == PM_EFILE;
    const bool closed = pm_recording_close(recording) == PM_OK;
    pm_sample_free(sample);
    _exit(status == PM_EFILE && told && again && closed ? 0 : 3);
}

static void record_in_a_child(const char *path, rlim_t bytes, long unlimited, const char *left) {
    const pid_t child = fork();
    if (child == 0) {
        record_beyond_the_limit(path, bytes, unlimited, left);
    }
    int ending;
    assert_int_equal(waitpid(child, &ending, 0), child);
    assert_int_equal(ending, 0);
}

static int count_committed(const char *path) {
    uint64_t count = 0;
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t id = H5Aopen(file, "committed", H5P_DEFAULT);
    assert_true(file >= 0 && id >= 0 && H5Aread(id, H5T_NATIVE_UINT64, &count) >= 0);
    H5Aclose(id);
    H5Fclose(file);
    return (int)count;
}

static void append_many(pm_recording *recording, pm_sample *sample, long from, long to) {
    for (long step = from; step < to; ++step) {
        fill(sample, step);
        assert_int_equal(pm_recording_append(recording, sample), PM_OK);
    }
}

// Returns the size of a recording of so many samples.
static rlim_t bytes_of(const char *path, long samples) {
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    assert_int_equal(pm_sample_new(&sample, &scene), PM_OK);
    assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
    append_many(recording, sample, 0, samples);
    assert_int_equal(pm_recording_close(recording), PM_OK);
    pm_sample_free(sample);
    struct stat file;
    assert_int_equal(stat(path, &file), 0);
    return (rlim_t)file.st_size;
}

// The disk is full before a block is written: the file is sound, ends with a whole block, and has
// what was appended to it.
static void a_full_disk_costs_no_more_than_the_last_block(void **state) {
    const char *path = scratch_path(*state, "full.h5");
    // A recording reserves the space of whole chunks while it runs, and gives back the rest.
    const rlim_t limits[] = {bytes_of(path, 1850), bytes_of(path, 2000), bytes_of(path, 2150)};
    for (int i = 0; i < 3; ++i) {
        record_in_a_child(path, limits[i], 0, "samples are certain");
        const int count = count_committed(path);
        if (count < 300 || count > 1000) {
            fail_msg("limit %d: %d samples are certain", i, count);
        }
        assert_all_series(path, count);
    }
}

// By default the library would keep a mebibyte of each series, and much of the file's index.
static void a_long_recording_takes_no_more_memory_than_a_short_one(void **state) {
    const char *path = scratch_path(*state, "long.h5");
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    assert_int_equal(pm_sample_new(&sample, &scene), PM_OK);
    assert_int_equal(pm_recording_open(&recording, path, &scene), PM_OK);
    append_many(recording, sample, 0, 100000);
    const size_t before = mallinfo2().uordblks;
    append_many(recording, sample, 100000, 200000);
    const size_t after = mallinfo2().uordblks;
    assert_int_equal(pm_recording_close(recording), PM_OK);
    pm_sample_free(sample);
    if (after > before + 1000000) {
        fail_msg("%zu bytes after 100,000 samples, %zu after 200,000", before, after);
    }
}

// A write fails although its space was reserved: nothing crashes, and the error says what is left.
static void a_write_that_fails_halfway_ends_the_recording(void **state) {
    const char *path = scratch_path(*state, "full.h5");
    record_in_a_child(path, 40000, 560, "may be damaged");
}

int main(void) {
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(every_number_arrives_where_it_belongs, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_recording_goes_on_where_it_is_told, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_damaged_recording_is_an_error, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(variables_and_units_are_written, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(components_of_large_states_are_named_by_group,
                                        scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(what_was_flushed_outlives_a_killed_writer, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_recording_that_cannot_be_made_says_so, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_check_tells_beforehand_and_changes_nothing, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_full_disk_costs_no_more_than_the_last_block,
                                        scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(a_long_recording_takes_no_more_memory_than_a_short_one,
                                        scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(a_write_that_fails_halfway_ends_the_recording,
                                        scratch_setup, scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

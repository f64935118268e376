// Compiled models (graph/compile.h) have the bits of interpreted ones, alone and in lanes, and the
// cache of compiled code gives back nothing but what was put there.
#include <ftw.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "library/fleet.h"
#include "library/local_run.h"
#include "tests/support/row_of_bodies.h"
#include "tests/support/unit.h"

static char cache[] = "/tmp/portmet-test-XXXXXX";
static char folder[64];

static const char *const scenes[] = {"double_pendulum", "double_pendulum_soft",
                                     "driven_lower",    "gas_containers",
                                     "chain_10",        "beam",
                                     "bouncing_masses", "analytic_double_pendulum"};

static void open_setup(pm_setup *setup, const char *name, bool compiled) {
    char path[128];
    pm_scene *scene = NULL;
    snprintf(path, sizeof path, "configs/%s.yaml", name);
    *setup = (pm_setup){0};
    if (pm_scene_load(&scene, path) != PM_OK || pm_setup_open(setup, scene, NULL) != PM_OK ||
        pm_setup_complete(setup, PM_TO_SERVE) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    setup->system->compiled = compiled;
}

// Compares two samples: states, fluxes, and what was evaluated and skipped.
static void assert_same(const pm_sample *a, const pm_sample *b, const pm_physics *physics,
                        const char *what) {
    const size_t n = (size_t)physics->nsubsystem, size = n * sizeof(double);
    bool same = memcmp(a->z, b->z, (size_t)physics->nz * sizeof(double)) == 0 &&
                memcmp(a->energy, b->energy, size) == 0 &&
                memcmp(a->entropy, b->entropy, size) == 0 &&
                memcmp(a->bulk_energy, b->bulk_energy, size) == 0 &&
                memcmp(a->bulk_entropy, b->bulk_entropy, size) == 0 &&
                memcmp(a->flux, b->flux, (size_t)physics->nport * sizeof *a->flux) == 0;
    for (size_t i = 0; i < n; ++i) {
        same = same && a->evaluated[i] == b->evaluated[i] && a->skipped[i] == b->skipped[i] &&
               a->outside[i] == b->outside[i];
    }
    if (!same) {
        fail_msg("%s: other numbers in step %ld", what, a->step);
    }
}

static void scenes_have_the_same_bits(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof scenes / sizeof *scenes; ++k) {
        pm_setup setup[2];
        pm_local_run run[2];
        for (int i = 0; i < 2; ++i) {
            open_setup(&setup[i], scenes[k], i == 1);
            if (pm_local_run_open(&run[i], &setup[i], PM_LOCAL_SAMPLES) != PM_OK) {
                fail_msg("%s: %s", scenes[k], pm_error());
            }
        }
        for (int step = 0; step < 10; ++step) {
            const pm_physics *physics = &setup[0].scene->physics;
            assert_int_equal(pm_local_run_step(&run[0]), PM_OK);
            assert_int_equal(pm_local_run_step(&run[1]), PM_OK);
            assert_same(&run[0].sample, &run[1].sample, physics, scenes[k]);
        }
        for (int i = 0; i < 2; ++i) {
            pm_local_run_close(&run[i]);
            pm_setup_free(&setup[i]);
        }
    }
}

// Bodies rest until a hand pushes one of them, and the others begin to move.
static void resting_bodies_have_the_same_counts(void **state) {
    (void)state;
    static const char *const methods[] = {"integrator: rk4, substeps: 2", "integrator: euler"};
    for (int m = 0; m < 2; ++m) {
        pm_setup setup[2];
        pm_local_run run[2];
        double hands[12] = {0}, z[15] = {0};
        char text[4096];
        snprintf(text, sizeof text, PM_ROW_OF_BODIES("", ""), methods[m]);
        for (int i = 0; i < 2; ++i) {
            pm_scene *scene = NULL;
            setup[i] = (pm_setup){0};
            assert_int_equal(pm_scene_parse(&scene, text, "row.yaml"), PM_OK);
            assert_int_equal(pm_setup_open(&setup[i], scene, NULL), PM_OK);
            assert_int_equal(pm_setup_complete(&setup[i], PM_TO_SERVE), PM_OK);
            assert_int_equal(scene->physics.nprescribed, 12);
            setup[i].boundary_input.held = hands;
            setup[i].system->compiled = i == 1;
            assert_int_equal(pm_local_run_open(&run[i], &setup[i], PM_LOCAL_SAMPLES), PM_OK);
            assert_int_equal(pm_local_run_start(&run[i], z), PM_OK);
        }
        for (int step = 0; step < 12; ++step) {
            hands[2] = step == 3 || step == 4 ? 0.5 : 0;
            for (int i = 0; i < 2; ++i) {
                assert_int_equal(pm_local_run_step(&run[i]), PM_OK);
            }
            assert_same(&run[0].sample, &run[1].sample, &setup[0].scene->physics, methods[m]);
        }
        assert_true(run[0].sample.skipped[0] > 0);
        for (int i = 0; i < 2; ++i) {
            pm_local_run_close(&run[i]);
            pm_setup_free(&setup[i]);
        }
    }
}

static void copies_have_the_same_bits(void **state) {
    (void)state;
    for (size_t k = 0; k < 5; ++k) {
        pm_setup setup[2];
        pm_fleet fleet[2];
        for (int i = 0; i < 2; ++i) {
            open_setup(&setup[i], scenes[k], i == 1);
            assert_int_equal(pm_fleet_open(&fleet[i], &setup[i], 40, 2), PM_OK);
            for (int64_t c = 0; c < 40; ++c) {
                fleet[i].z[c * setup[i].scene->physics.nz] *= 1 + 1e-4 * (double)c;
            }
            pm_fleet_step(&fleet[i], 5);
            assert_string_equal(fleet[i].why, "");
        }
        assert_memory_equal(fleet[0].z, fleet[1].z,
                            40 * (size_t)setup[0].scene->physics.nz * sizeof(double));
        for (int i = 0; i < 2; ++i) {
            pm_fleet_close(&fleet[i]);
            pm_setup_free(&setup[i]);
        }
    }
}

// Opens a compiled scene and takes a step, in a process of its own, since code stays loaded.
// Returns the error.
static int compile(const char *name) {
    pm_setup setup;
    pm_local_run run;
    int end = 0;
    open_setup(&setup, name, true);
    const pid_t child = fork();
    if (child == 0) {
        const pm_status status = pm_local_run_open(&run, &setup, PM_LOCAL_SAMPLES);
        _exit(status == PM_OK ? (int)pm_local_run_step(&run) : (int)status);
    }
    assert_int_equal(waitpid(child, &end, 0), child);
    pm_setup_free(&setup);
    return WIFEXITED(end) ? WEXITSTATUS(end) : -1;
}

// The file that differs by its change time if it is made again.
static struct stat entry(char *path, size_t size) {
    glob_t found;
    char pattern[128];
    struct stat s;
    snprintf(pattern, sizeof pattern, "%s/*.so", folder);
    assert_int_equal(glob(pattern, 0, NULL, &found), 0);
    assert_int_equal(found.gl_pathc, 1);
    snprintf(path, size, "%s", found.gl_pathv[0]);
    assert_int_equal(stat(path, &s), 0);
    globfree(&found);
    return s;
}

static void only_whole_entries_of_the_user_are_loaded(void **state) {
    (void)state;
    char path[256], source[256], own[48];
    snprintf(own, sizeof own, "%s/own", cache);
    snprintf(folder, sizeof folder, "%s/portmet", own);
    setenv("XDG_CACHE_HOME", own, 1);
    assert_int_equal(compile("driven_lower"), PM_OK);
    const struct stat first = entry(path, sizeof path);
    assert_int_equal(first.st_mode & 0777, 0600);
    assert_int_equal(compile("driven_lower"), PM_OK);
    assert_int_equal(entry(path, sizeof path).st_ino, first.st_ino);
    snprintf(source, sizeof source, "%.*s.c", (int)strlen(path) - 3, path);
    for (int damage = 0; damage < 4; ++damage) {
        struct stat before = entry(path, sizeof path);
        if (damage == 0) { // a truncated entry
            assert_int_equal(truncate(path, before.st_size / 2), 0);
        } else if (damage == 1) { // one that others can change
            assert_int_equal(chmod(path, 0666), 0);
        } else if (damage == 2) { // one whose source is another
            FILE *file = fopen(source, "a");
            assert_non_null(file);
            fputs("// more\n", file);
            fclose(file);
        } else { // one that is a link
            char moved[64];
            snprintf(moved, sizeof moved, "%s/elsewhere", cache);
            assert_int_equal(rename(path, moved), 0);
            assert_int_equal(symlink(moved, path), 0);
        }
        before = entry(path, sizeof path);
        assert_int_equal(compile("driven_lower"), PM_OK);
        struct stat after;
        assert_int_equal(lstat(path, &after), 0);
        assert_true(S_ISREG(after.st_mode));
        assert_int_equal(after.st_mode & 0777, 0600);
        assert_int_not_equal(after.st_ino, before.st_ino);
    }
    assert_int_equal(chmod(folder, 0777), 0);
    assert_int_equal(compile("driven_lower"), PM_EFILE);
    assert_int_equal(chmod(folder, 0700), 0);
    setenv("CC", "/nowhere/cc", 1);
    assert_int_equal(compile("driven_lower"), PM_EFILE);
    setenv("CC", "false", 1);
    assert_int_equal(compile("driven_lower"), PM_EFILE);
    unsetenv("CC");
    assert_int_equal(compile("driven_lower"), PM_OK);
}

static int remove_one(const char *path, const struct stat *s, int kind, struct FTW *place) {
    (void)s, (void)kind, (void)place;
    return remove(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(scenes_have_the_same_bits),
        cmocka_unit_test(resting_bodies_have_the_same_counts),
        cmocka_unit_test(copies_have_the_same_bits),
        cmocka_unit_test(only_whole_entries_of_the_user_are_loaded),
    };
    if (mkdtemp(cache) == NULL || setenv("XDG_CACHE_HOME", cache, 1) != 0 || unsetenv("CC") != 0) {
        return 1;
    }
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    nftw(cache, remove_one, 8, FTW_DEPTH | FTW_PHYS);
    return failed;
}

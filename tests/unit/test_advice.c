// What a training file lacks is named after a trial: an angle on which L depends, a group that a
// port does not expose; and nothing where nothing is lacking.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/linalg.h"
#include "propose/advice.h"
#include "store/dataset.h"
#include "tests/support/unit.h"

#define NTRAJECTORY 8
#define NTIME 50
#define DT 0.1
#define SUBSTEPS 20
#define MOST 5
#define TEXT 4096
#ifdef PM_SANITIZED // its trials take some times as long
#define BUDGET 20.0 // s
#else
#define BUDGET 4.0
#endif

static char folder[] = "/tmp/test_adviceXXXXXX";

static void path_of(const char *name, char path[64]) {
    snprintf(path, 64, "%s/%s", folder, name);
}

static void write_text(const char *name, const char *text) {
    char path[64];
    path_of(name, path);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

// A sleigh on a runner that cannot slip sideways, held by a spring: x, y, phi, p along the runner
// and the angular momentum L. E = (x^2 + y^2 + p^2 + L^2)/2 - cos(phi).
static void rate_of_sleigh(const double *z, double *rate) {
    rate[0] = cos(z[2]) * z[3];
    rate[1] = sin(z[2]) * z[3];
    rate[2] = z[4];
    rate[3] = -cos(z[2]) * z[0] - sin(z[2]) * z[1];
    rate[4] = -sin(z[2]);
}

// A wheel, theta and J, whose crank pulls a spring of length x. E = (J^2 + x^2)/2.
static void rate_of_crank(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -cos(z[0]) * z[2];
    rate[2] = cos(z[0]) * z[1];
}

static void write_data(int count, const char *const *column,
                       void (*rate)(const double *z, double *rate)) {
    pm_dataset *d = NULL;
    char path[64];
    const double h = DT / SUBSTEPS;
    assert_int_equal(pm_dataset_new(&d, NTRAJECTORY, NTIME, count, DT, column), PM_OK);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double z[MOST], k[4][MOST], at[MOST];
        for (int c = 0; c < count; ++c) {
            z[c] = 1.2 * sin(3.7 * i + 2.3 * c + 0.4);
        }
        for (int j = 0; j < NTIME; ++j) {
            memcpy(pm_dataset_state(d, i, j), z, (size_t)count * sizeof *z);
            for (int s = 0; s < SUBSTEPS; ++s) { // Runge and Kutta
                for (int stage = 0; stage < 4; ++stage) {
                    for (int c = 0; c < count; ++c) {
                        at[c] = z[c] + (stage == 0   ? 0
                                        : stage == 3 ? h
                                                     : h / 2) *
                                           k[(stage + 3) % 4][c];
                    }
                    rate(stage == 0 ? z : at, k[stage]);
                }
                for (int c = 0; c < count; ++c) {
                    z[c] += h / 6 * (k[0][c] + 2 * k[1][c] + 2 * k[2][c] + k[3][c]);
                }
            }
        }
    }
    path_of("data.h5", path);
    assert_int_equal(pm_dataset_save(d, path), PM_OK);
    pm_dataset_free(d);
}

// Fits the training file and returns what is said about it.
static void advise(const char *scene, const char *training, char text[TEXT]) {
    static const volatile sig_atomic_t never = 0;
    char config[64], output[64], path[64];
    write_text("scene.yaml", scene);
    write_text("training.yaml", training);
    path_of("training.yaml", config);
    path_of("weights", output);
    path_of("advice.yaml", path);
    const pm_fit_arguments a = {.config = config, .output = output};
    pm_fit f;
    assert_int_equal(pm_fit_open(&f, &a, &never), PM_OK);
    assert_int_equal(pm_fit_run(&f), PM_OK);
    FILE *out = fmemopen(text, TEXT, "w");
    assert_non_null(out);
    assert_int_equal(pm_advise(&f, BUDGET, NULL, path, out), PM_OK);
    assert_int_equal(fclose(out), 0);
    pm_fit_close(&f);
}

static void assert_says(const char *text, const char *expected) {
    if (strstr(text, expected) == NULL) {
        fail_msg("expected \"%s\" in:\n%s", expected, text);
    }
}

// The file that was written has the change, and names nothing that is not there.
static void assert_writes(const char *name, const char *expected) {
    char path[64], text[TEXT];
    path_of(name, path);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    text[fread(text, 1, TEXT - 1, file)] = '\0';
    fclose(file);
    assert_says(text, expected);
}

#define STAGES \
    "stages:\n  - {optimiser: gauss_newton, iterations: 30, batch: 512, residual: derivative}\n"

static const char sleigh_scene[] =
    "scene: sleigh\ntime: {dt: 0.1, steps: 49, integrator: rk4, substeps: 4}\n"
    "subsystems:\n  sleigh:\n    weights: sleigh.h5\n    state:\n"
    "      x: {unit: m, columns: [x]}\n      y: {unit: m, columns: [y]}\n"
    "      phi: {unit: rad, columns: [phi]}\n      p: {unit: kg m/s, columns: [p]}\n"
    "      L: {unit: kg m^2/s, columns: [L]}\n";

#define SLEIGH(learned)                                                             \
    "# A sleigh \u2013 by hand.\n"                                                  \
    "scene: scene.yaml\ndata: {file: data.h5}\nmodels:\n  runner:\n"                \
    "    energy: \"x^2/2 + y^2/2 + p^2/2 + L^2/2 - cos(phi)\"\n"                    \
    "    reversible: {given: [[phi, L, 1.0]], learned: {acts_on: [x, y, p]" learned \
    "}}   # a coupling\nsubsystems: {sleigh: runner}\n" STAGES

static void an_angle_of_L_is_named(void **state) {
    static const char *const column[] = {"x", "y", "phi", "p", "L"};
    char text[TEXT], path[64];
    (void)state;
    write_data(5, column, rate_of_sleigh);
    advise(sleigh_scene, SLEIGH(""), text);
    assert_says(text, "Tried by short fits: L of `sleigh` depends on phi: with it the error of one "
                      "step of ");
    assert_writes("advice.yaml", "features: [\"sin(phi)\", \"cos(phi)\"]");
    assert_writes("advice.yaml", "# A sleigh \u2013 by hand.\n");
    // With this change nothing is lacking.
    advise(sleigh_scene, SLEIGH(", features: [\"sin(phi)\", \"cos(phi)\"], skip: quadratic"), text);
    assert_says(text, "A short fit of the same models is good ");
    path_of("advice.yaml", path);
    assert_int_equal(access(path, F_OK), -1);
}

static void a_group_that_is_not_exposed_is_named(void **state) {
    static const char *const column[] = {"theta", "J", "x"};
    char text[TEXT];
    (void)state;
    write_data(3, column, rate_of_crank);
    advise("scene: crank\ntime: {dt: 0.1, steps: 49, integrator: rk4, substeps: 4}\n"
           "subsystems:\n"
           "  wheel:\n    weights: wheel.h5\n    state:\n"
           "      theta: {unit: rad, columns: [theta]}\n"
           "      J: {unit: kg m^2/s, columns: [J]}\n"
           "  spring:\n    weights: spring.h5\n    state:\n      x: {unit: m, columns: [x]}\n"
           "ports:\n  joint:\n    law: bracket\n    between: [wheel, spring]\n"
           "    weights: joint.h5\n    expose:\n      wheel: J\n      spring: [x]\n",
           "scene: scene.yaml\ndata:\n  file: data.h5\nmodels:\n"
           "  wheel:\n    energy: \"J^2/2\"\n    reversible: {given: [[theta, J, 1.0]]}\n"
           "  spring:\n    energy: \"x^2/2\"\n"
           "  joint:\n    law: bracket\n    reversible:\n      learned:\n"
           "        acts_on: [a.J]\n        against: [b.x]\n"
           "subsystems: {wheel: wheel, spring: spring}\nports: {joint: joint}\n" STAGES,
           text);
    assert_says(text,
                "`expose` lacks theta of `wheel` at `joint`: L of `joint` depends on theta of "
                "`wheel`: with it ");
    assert_writes("advice_scene.yaml", "wheel: [theta, \"J\"]");
    assert_writes("advice.yaml", "_scene.yaml\"");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_angle_of_L_is_named),
        cmocka_unit_test(a_group_that_is_not_exposed_is_named),
    };
    char command[96];
    pm_linalg_init();
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    snprintf(command, sizeof command, "rm -r %s", folder);
    return system(command) == 0 ? failed : 1;
}

// The shared library as its users see it: only portmet.h and libportmet.so.
#include "library/portmet.h"
#include "tests/support/unit.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

// Two masses on springs, one of them held by a boundary input.
static const char springs[] =
    "scene: springs\n"
    "time: {dt: 0.1, steps: 10, integrator: rk4}\n"
    "models:\n"
    "  mass: {energy: \"|p|^2/2 + |q|^2/2\", reversible: {given: [[q, p, 1.0]]}}\n"
    "  pull: {law: bracket, reversible: {given: [[b.f, a.p, 1.0]]}}\n"
    "subsystems:\n"
    "  left:\n"
    "    model: mass\n"
    "    state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}\n"
    "    initial: {q: 1.0, p: 0.0}\n"
    "boundary_inputs:\n"
    "  hand: {f: {unit: m, dE: [0.5]}}\n"
    "ports:\n"
    "  grip: {law: bracket, between: [left, hand], model: pull, "
    "expose: {left: p, hand: f}}\n";

static portmet_scene *open_springs(void) {
    portmet_scene *scene = NULL;
    if (portmet_scene_parse(&scene, springs, "springs.yaml", NULL) != PORTMET_OK) {
        fail_msg("%s", portmet_error());
    }
    return scene;
}

static size_t find_input(const portmet_scene *scene, const char *name) {
    for (size_t i = 0;; ++i) {
        const char *found = portmet_scene_name(scene, PORTMET_INPUT, i);
        assert_non_null(found);
        if (strcmp(found, name) == 0) {
            return i;
        }
    }
}

static void test_names(void **state) {
    (void)state;
    portmet_scene *scene = open_springs();
    assert_string_equal(portmet_scene_name(scene, PORTMET_SCENE, 0), "springs");
    assert_string_equal(portmet_scene_name(scene, PORTMET_SUBSYSTEM, 0), "left");
    assert_null(portmet_scene_name(scene, PORTMET_SUBSYSTEM, 1));
    assert_string_equal(portmet_scene_name(scene, PORTMET_VARIABLE, 1), "left.p[0]");
    assert_string_equal(portmet_scene_name(scene, PORTMET_VARIABLE_UNIT, 1), "kg m/s");
    assert_null(portmet_scene_name(scene, PORTMET_VARIABLE, 2));
    assert_string_equal(portmet_scene_name(scene, PORTMET_PORT, 0), "grip");
    assert_string_equal(portmet_scene_name(scene, PORTMET_PORT_A, 0), "left");
    assert_string_equal(portmet_scene_name(scene, PORTMET_PORT_B, 0), "hand");
    assert_string_equal(portmet_scene_name(scene, PORTMET_INPUT, 1), "hand.dE/df[0]");
    assert_string_equal(portmet_scene_name(scene, PORTMET_INPUT_UNIT, 1), "N");
    assert_null(portmet_scene_name(scene, PORTMET_REFERENCE, 0));
    assert_null(portmet_scene_name(scene, 1000, 0));
    assert_null(portmet_scene_array(scene, 1000, NULL));
    portmet_scene_close(scene);
}

static void test_arrays_follow(void **state) {
    (void)state;
    portmet_scene *scene = open_springs();
    size_t size = 0;
    const double *z = portmet_scene_array(scene, PORTMET_STATE, &size);
    const double *energy = portmet_scene_array(scene, PORTMET_ENERGY, NULL);
    const double *ledger = portmet_scene_array(scene, PORTMET_LEDGER, NULL);
    const double *flux = portmet_scene_array(scene, PORTMET_FLUX, NULL);
    assert_int_equal(size, 2);
    assert_true(z[0] == 1 && z[1] == 0 && energy[0] == 0.5);
    assert_int_equal(portmet_scene_step(scene, 3), PORTMET_OK);
    assert_ptr_equal(z, portmet_scene_array(scene, PORTMET_STATE, NULL));
    assert_true(z[0] != 1 && portmet_scene_steps(scene) == 3);
    assert_true(portmet_scene_time(scene) == 3 * 0.1 && portmet_scene_dt(scene) == 0.1);
    assert_int_equal(portmet_scene_planned(scene), 10);
    assert_true(fabs(energy[0] - 0.5 * (z[0] * z[0] + z[1] * z[1])) < 1e-15);
    assert_true(flux[0] == -flux[4] && flux[0] != 0);
    assert_true(fabs(ledger[PORTMET_TOTAL_ENERGY] - ledger[PORTMET_OUTSIDE_ENERGY] - energy[0]) <
                1e-12);
    portmet_scene_close(scene);
}

// Many steps at once, and a run begun again, give the same bits as single steps.
static void test_same_bits(void **state) {
    (void)state;
    portmet_scene *one = open_springs(), *many = open_springs();
    const double *a = portmet_scene_array(one, PORTMET_STATE, NULL);
    const double *b = portmet_scene_array(many, PORTMET_STATE, NULL);
    const double start[2] = {1, 0}, elsewhere[2] = {-2, 3};
    for (int i = 0; i < 50; ++i) {
        assert_int_equal(portmet_scene_step(one, 1), PORTMET_OK);
    }
    assert_int_equal(portmet_scene_step(many, 50), PORTMET_OK);
    assert_memory_equal(a, b, sizeof start);
    assert_int_equal(portmet_scene_restart(many, elsewhere), PORTMET_OK);
    assert_true(b[0] == -2 && portmet_scene_steps(many) == 0);
    assert_int_equal(portmet_scene_restart(many, start), PORTMET_OK);
    assert_int_equal(portmet_scene_step(many, 50), PORTMET_OK);
    assert_memory_equal(a, b, sizeof start);
    assert_int_equal(portmet_scene_restart(one, NULL), PORTMET_OK);
    assert_memory_equal(a, start, sizeof start);
    portmet_scene_close(one);
    portmet_scene_close(many);
}

// A held value acts as the same number in the scene would; NaN gives it back.
static void test_inputs(void **state) {
    (void)state;
    portmet_scene *plain = open_springs(), *held = open_springs();
    const double *a = portmet_scene_array(plain, PORTMET_STATE, NULL);
    const double *b = portmet_scene_array(held, PORTMET_STATE, NULL);
    size_t size = 0;
    double *input = portmet_scene_inputs(held, &size);
    assert_int_equal(size, 3);
    assert_true(isnan(input[0]) && isnan(input[1]) && isnan(input[2]));
    const size_t force = find_input(held, "hand.dE/df[0]");
    input[force] = 0.5;
    portmet_scene_step(plain, 5);
    portmet_scene_step(held, 5);
    assert_memory_equal(a, b, 2 * sizeof *a);
    input[force] = 2;
    portmet_scene_step(plain, 1);
    portmet_scene_step(held, 1);
    assert_true(a[1] != b[1]);
    portmet_scene_restart(held, a);
    portmet_scene_restart(plain, a);
    input[force] = NAN;
    portmet_scene_step(plain, 5);
    portmet_scene_step(held, 5);
    assert_memory_equal(a, b, 2 * sizeof *a);
    portmet_scene_close(plain);
    portmet_scene_close(held);
}

// A run ends with the trajectory that an input follows, unless all that follow it are held.
static void test_held_beyond_the_trajectory(void **state) {
    (void)state;
    portmet_scene *scene = NULL;
    assert_int_equal(portmet_scene_open(&scene, "configs/driven_lower.yaml", NULL), PORTMET_OK);
    const int64_t planned = portmet_scene_planned(scene);
    assert_int_equal(portmet_scene_step(scene, planned), PORTMET_OK);
    assert_int_equal(portmet_scene_step(scene, 1000000), PORTMET_EDATA);
    assert_non_null(strstr(portmet_error(), "trajectory"));
    const int64_t steps = portmet_scene_steps(scene);
    size_t size;
    double *input = portmet_scene_inputs(scene, &size);
    for (size_t i = 0; i < size; ++i) {
        input[i] = 0.5;
    }
    assert_int_equal(portmet_scene_step(scene, 1), PORTMET_OK);
    assert_int_equal(portmet_scene_steps(scene), steps + 1);
    portmet_scene_close(scene);
}

static void test_failures(void **state) {
    (void)state;
    portmet_scene *scene = NULL;
    assert_int_equal(portmet_scene_open(&scene, "nowhere.yaml", NULL), PORTMET_EFILE);
    assert_non_null(strstr(portmet_error(), "nowhere.yaml"));
    assert_int_equal(portmet_scene_parse(&scene, "scene: x\ntim: 3\n", "x.yaml", NULL),
                     PORTMET_ECONFIG);
    assert_non_null(strstr(portmet_error(), "x.yaml:2"));
    assert_int_equal(portmet_scene_open(&scene, "configs/double_pendulum.yaml", "/nowhere"),
                     PORTMET_EWEIGHTS);
    assert_null(scene);
    portmet_scene_close(NULL);
    assert_string_equal(portmet_version(), PM_VERSION);
}

static void assert_same_run(const portmet_scene *a, const portmet_scene *b) {
    assert_true(portmet_scene_steps(a) == portmet_scene_steps(b));
    for (int i = PORTMET_STATE; i <= PORTMET_LEDGER; ++i) {
        size_t size = 0;
        const double *x = portmet_scene_array(a, i, &size), *y = portmet_scene_array(b, i, NULL);
        assert_memory_equal(x, y, size * sizeof *x);
    }
}

// A call that is refused changes nothing, and a call that succeeds leaves no description.
static void test_refusals(void **state) {
    (void)state;
    portmet_scene *scene = open_springs(), *plain = open_springs();
    const double nowhere[2] = {1, NAN};
    assert_int_equal(portmet_scene_step(scene, 2), PORTMET_OK);
    assert_int_equal(portmet_scene_step(plain, 2), PORTMET_OK);
    assert_int_equal(portmet_scene_step(scene, -1), PORTMET_EUSAGE);
    assert_non_null(strstr(portmet_error(), "-1 steps"));
    assert_same_run(scene, plain);
    assert_int_equal(portmet_scene_restart(scene, nowhere), PORTMET_ENUMERIC);
    assert_non_null(strstr(portmet_error(), "left.p[0] = nan"));
    assert_same_run(scene, plain);
    portmet_scene_inputs(scene, NULL)[1] = 1e308;
    assert_int_equal(portmet_scene_step(scene, 2), PORTMET_ENUMERIC);
    assert_same_run(scene, plain);
    portmet_scene_inputs(scene, NULL)[1] = NAN;
    assert_int_equal(portmet_scene_step(scene, 2), PORTMET_OK);
    assert_string_equal(portmet_error(), "");
    assert_int_equal(portmet_scene_step(plain, 2), PORTMET_OK);
    assert_same_run(scene, plain);
    portmet_scene_close(scene);
    portmet_scene_close(plain);
}

// A step that cannot be recorded is not taken.
static void test_full_disk(void **state) {
    (void)state;
    char path[] = "/tmp/test_library_XXXXXX";
    struct rlimit before;
    close(mkstemp(path));
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    portmet_scene *scene = open_springs(), *plain = open_springs();
    assert_int_equal(portmet_scene_record(scene, path), PORTMET_OK);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &(struct rlimit){65536, before.rlim_max}), 0);
    assert_int_equal(portmet_scene_step(scene, 100000), PORTMET_EFILE);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
    assert_int_equal(portmet_scene_step(plain, portmet_scene_steps(scene)), PORTMET_OK);
    assert_same_run(scene, plain);
    assert_int_equal(portmet_scene_step(scene, 1), PORTMET_EFILE);
    assert_same_run(scene, plain);
    assert_int_equal(portmet_scene_record(scene, NULL), PORTMET_OK);
    assert_int_equal(portmet_scene_step(scene, 9), PORTMET_OK);
    assert_int_equal(portmet_scene_step(plain, 9), PORTMET_OK);
    assert_same_run(scene, plain);
    portmet_scene_close(scene);
    portmet_scene_close(plain);
    unlink(path);
}

static void test_recording(void **state) {
    (void)state;
    char path[] = "/tmp/test_library_XXXXXX";
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    portmet_scene *scene = open_springs();
    assert_int_equal(portmet_scene_record(scene, "/nowhere/run.h5"), PORTMET_EFILE);
    assert_int_equal(portmet_scene_record(scene, path), PORTMET_OK);
    assert_int_equal(portmet_scene_step(scene, 7), PORTMET_OK);
    assert_int_equal(portmet_scene_record(scene, NULL), PORTMET_OK);
    portmet_scene_close(scene);
    FILE *recorded = fopen(path, "rb");
    char magic[8];
    assert_non_null(recorded);
    assert_int_equal(fread(magic, 1, sizeof magic, recorded), sizeof magic);
    assert_memory_equal(magic, "\211HDF\r\n\032\n", sizeof magic);
    fclose(recorded);
    unlink(path);
}

// The iteration of a long step ends in values that are not finite. It has not converged, and the
// step is divided.
static void test_an_iteration_may_overflow(void **state) {
    (void)state;
    static const char text[] =
        "scene: quartic\n"
        "time: {dt: 0.5, steps: 5, integrator: discrete_gradient}\n"
        "models:\n"
        "  mass: {energy: \"|p|^2/2\"}\n"
        "  spring: {energy: \"10*|q|^4\"}\n"
        "  joint: {law: bracket, reversible: {given: [[a.p, b.q, 1.0]]}}\n"
        "subsystems:\n"
        "  mass: {model: mass, state: {p: {unit: kg m/s, size: 1}}, initial: {p: 0.5}}\n"
        "  spring: {model: spring, state: {q: {unit: m, size: 1}}, initial: {q: 1.0}}\n"
        "ports:\n"
        "  joint: {law: bracket, between: [mass, spring], model: joint, "
        "expose: {mass: p, spring: q}}\n";
    portmet_scene *scene = NULL;
    if (portmet_scene_parse(&scene, text, "quartic.yaml", NULL) != PORTMET_OK ||
        portmet_scene_step(scene, 5) != PORTMET_OK) {
        fail_msg("%s", portmet_error());
    }
    const double *ledger = portmet_scene_array(scene, PORTMET_LEDGER, NULL);
    assert_true(ledger[PORTMET_ENERGY_DRIFT] < 1e-11 && ledger[PORTMET_VIOLATIONS] == 0);
    portmet_scene_close(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names),     cmocka_unit_test(test_arrays_follow),
        cmocka_unit_test(test_same_bits), cmocka_unit_test(test_inputs),
        cmocka_unit_test(test_failures),  cmocka_unit_test(test_held_beyond_the_trajectory),
        cmocka_unit_test(test_recording), cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_full_disk), cmocka_unit_test(test_an_iteration_may_overflow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

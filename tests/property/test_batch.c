// Subsystems that are evaluated together, in blocks of many lanes, have the bits, fluxes and counts
// that each has in a process of its own.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "sim/monolithic.h"
#include "sim/step_controller.h"
#include "tests/support/divided.h"
#include "tests/support/unit.h"

#define SEED 1807u
#define NZ 5
#define MOST_LINKS 300

// Five links have the weights of the upper one and ten those of the lower one, so that blocks of
// one lane and of several stand beside each other.
#define LINKS 15

static const double start[2 * NZ] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};

typedef struct subject {
    pm_scene *scene;
    pm_system *system;
    double z[MOST_LINKS * NZ];
} subject;

// Joints of a tangled chain beside those between neighbours. Each link has several joints, whose
// sum depends on the order, and the groups of joints with equal weights take turns.
static const char tangle[] =
    "  \"cross[0:%d]\": {law: bracket, between: [\"link[i+2]\", \"link[i]\"],\n"
    "    weights: weights/double_pendulum_wide/joint.h5,\n"
    "    expose: {\"link[i]\": [q, p, s], \"link[i+2]\": [q, p, s]}}\n"
    "  \"again[0:%d]\": {law: bracket, between: [\"link[i]\", \"link[i+2]\"],\n"
    "    weights: weights/double_pendulum/joint.h5,\n"
    "    expose: {\"link[i]\": [q, p, s], \"link[i+2]\": [q, p, s]}}\n";

// A chain of learned links. Every third link, from the third on, has the weights of the upper one,
// so that models alternate.
static void open_chain(subject *s, const char *integrator, int links, bool tangled, bool resting) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    assert_non_null(file);
    fprintf(file,
            "scene: chain\ntime: {dt: 0.001, steps: 1, integrator: %s, substeps: 2}\nsubsystems:\n",
            integrator);
    for (int i = 0; i < links; ++i) {
        fprintf(file,
                "  link%d: {weights: weights/double_pendulum/%s.h5, state: {q: {unit: m, size: 2}, "
                "p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n",
                i, i % 3 == 0 ? "upper" : "lower");
    }
    fprintf(file,
            "ports:\n  \"joint[0:%d]\": {law: bracket, between: [\"link[i]\", \"link[i+1]\"],\n"
            "    weights: weights/double_pendulum/joint.h5,\n"
            "    expose: {\"link[i]\": [q, p, s], \"link[i+1]\": [q, p, s]}}\n",
            links - 1);
    if (tangled) {
        fprintf(file, tangle, links - 2, links - 2);
    }
    fclose(file);
    require(pm_scene_parse(&s->scene, text, "configs/chain.yaml"));
    free(text);
    require(pm_system_load(&s->system, s->scene, NULL));
    pm_rng rng;
    pm_rng_init(&rng, SEED, 0);
    for (int i = 0; i < links * NZ; ++i) {
        s->z[i] = start[i < NZ ? i : NZ + i % NZ];
        // The second half of a resting chain begins in equal states: its joints have nothing to do.
        s->z[i] += resting && i > links * NZ / 2 ? 0 : 0.05 * pm_rng_normal(&rng);
    }
}

static void close_chain(subject *s) {
    pm_system_free(s->system);
    pm_scene_free(s->scene);
}

static void check_equal(const pm_scene *scene, const pm_sample *a, const pm_sample *b, long step) {
    const size_t n = (size_t)scene->physics.nsubsystem;
    for (int i = 0; i < scene->physics.nz; ++i) {
        if (memcmp(&a->z[i], &b->z[i], sizeof a->z[i]) != 0) {
            fail_msg("seed %u, step %ld: z[%d] is %.17g together, %.17g alone", SEED, step, i,
                     a->z[i], b->z[i]);
        }
    }
#define SAME(member, name, series, unit) assert_memory_equal(a->name, b->name, n * sizeof *a->name);
    PM_SUBSYSTEM_NUMBERS(SAME, SAME)
    assert_memory_equal(a->flux, b->flux, (size_t)scene->physics.nport * sizeof *a->flux);
}

// Compares a chain in one process with links that each have their own, over two runs of 20 steps.
static void compare_chain(const subject *s) {
    pm_monolithic *together = NULL;
    divided alone;
    pm_sample *sample = NULL;
    require(pm_monolithic_open(&together, s->system));
    divided_open(&alone, s->system, 0, NULL);
    require(pm_sample_new(&sample, s->scene));
    for (int run = 0; run < 2; ++run) { // a second run starts anew
        pm_step_controller controller;
        require(pm_step_controller_init(&controller, s->scene));
        pm_monolithic_set_state(together, s->z);
        divided_set_state(&alone, s->z);
        for (long step = 0; step <= 20; ++step) {
            for (int i = 0; i < alone.count; ++i) {
                pm_local_subsystems_set_substeps(alone.local[i], controller.substeps);
            }
            require(step > 0 ? divided_step(&alone) : PM_OK);
            require(step > 0 ? pm_monolithic_step(together) : PM_OK);
            divided_fill_sample(&alone, sample);
            check_equal(s->scene, pm_monolithic_sample(together), sample, step);
            sample->step = step;
            pm_step_controller_note(&controller, sample);
        }
    }
    pm_sample_free(sample);
    pm_monolithic_close(together);
    divided_close(&alone);
}

static void blocks_have_the_bits_of_their_lanes(void **state) {
    (void)state;
    static const char *const integrators[] = {"euler", "heun", "rk4"};
    for (size_t i = 0; i < 12; ++i) {
        subject s = {0};
        open_chain(&s, integrators[i % 3], LINKS, i % 2 == 0, i >= 6);
        compare_chain(&s);
        close_chain(&s);
    }
}

// Balanced integrators move the state once or more after a substep, and a tolerance changes the
// number of substeps.
static void balanced_and_adaptive_steps_have_these_bits(void **state) {
    (void)state;
    static const char *const integrators[] = {"heun", "rk4", "rk4_balanced", "rk6_balanced"};
    for (int i = 0; i < 14; ++i) {
        subject s = {0};
        open_chain(&s, integrators[i / 2 % 4], LINKS, true, i % 2);
        s.scene->physics.dt = 0.2;
        s.scene->physics.tolerance = i < 6 ? 1e-5 : 0;
        compare_chain(&s);
        close_chain(&s);
    }
}

// --- a web of known parts ---

#define NODES 160
#define WAKES (2 * 80) // a component of an oscillator of the second block

// Nonlinear oscillators in a web of ties and knots. Each oscillator has up to six ports, some of
// which meet it with the same end, and the sum of their rates depends on the order. At q = p = 1
// an oscillator rests, since its rates are too small to change a bit of its state, but its fluxes
// are not zero.
static const char web[] =
    "scene: web\ntime: {dt: 0.1, steps: 1, integrator: %s}\n"
    "models:\n"
    "  node: {energy: \"(p-1)^2/2 + (p-1)^4/8 + (q-1)^2/2 + (q-1)^4/4 + 1e-20*(q+p)\",\n"
    "    reversible: {given: [[q, p, 1.0]]}}\n"
    "  tie: {law: bracket, reversible: {given: [[a.p, b.p, 0.7], [a.q, b.q, 0.3]]}}\n"
    "  knot: {law: bracket, reversible: {given: [[a.p, b.q, 0.9], [a.q, b.p, 0.2]]}}\n"
    "subsystems:\n"
    "  \"n[0:160]\": {model: node, state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}}\n"
    "ports:\n"
    "  \"a[0:20]\": {law: bracket, between: [\"n[i]\", \"n[i+1]\"], model: tie,\n"
    "    expose: {\"n[i]\": [q, p], \"n[i+1]\": [q, p]}}\n"
    "  \"b[0:158]\": {law: bracket, between: [\"n[i+2]\", \"n[i]\"], model: tie,\n"
    "    expose: {\"n[i+2]\": [q, p], \"n[i]\": [q, p]}}\n"
    "  \"c[0:150]\": {law: bracket, between: [\"n[i]\", \"n[i+9]\"], model: knot,\n"
    "    expose: {\"n[i]\": [q, p], \"n[i+9]\": [q, p]}}\n";

#define MOST_PROCESSES 3

// Compares the web in one process with the web in several. The process of an oscillator is the
// number of its block of `block` ones, modulo MOST_PROCESSES; with a block of 0 each has its own.
// Now and then new processes continue from the checkpoints of the others.
static void compare_web(const char *integrator, int block) {
    char text[4096];
    subject s = {0};
    pm_monolithic *whole = NULL;
    pm_sample *sample = NULL;
    divided d;
    int process[NODES];
    snprintf(text, sizeof text, web, integrator);
    require(pm_scene_parse(&s.scene, text, "web.yaml"));
    require(pm_system_load(&s.system, s.scene, NULL));
    require(pm_monolithic_open(&whole, s.system));
    require(pm_sample_new(&sample, s.scene));
    // Only the first oscillators move at first, and whole blocks rest until the motion reaches
    // them.
    for (int i = 0; i < NODES; ++i) {
        process[i] = block == 0 ? i : i / block % MOST_PROCESSES;
        s.z[2 * i] = i < 6 ? 0.3 + 0.2 * i : 1;
        s.z[2 * i + 1] = i < 6 ? 0.4 + 0.2 * i : 1;
    }
    divided_open(&d, s.system, block == 0 ? NODES : MOST_PROCESSES, process);
    divided_set_state(&d, s.z);
    pm_monolithic_set_state(whole, s.z);
    for (long step = 1; step <= 30; ++step) {
        require(divided_step(&d));
        require(pm_monolithic_step(whole));
        divided_fill_sample(&d, sample);
        check_equal(s.scene, pm_monolithic_sample(whole), sample, step);
        assert_true(step > 1 || sample->z[WAKES] == 1);
        if (block > 0 && step % 7 == 0) {
            divided returned;
            divided_return(&returned, &d);
            divided_close(&d);
            d = returned;
        }
    }
    assert_true(sample->z[WAKES] != 1);
    divided_close(&d);
    pm_sample_free(sample);
    pm_monolithic_close(whole);
    close_chain(&s);
}

static void blocks_rest_and_sum_in_the_order_of_the_scene(void **state) {
    (void)state;
    compare_web("euler", 0);
    compare_web("rk4_balanced", 0);
}

static void several_processes_have_the_bits_of_one(void **state) {
    (void)state;
    compare_web("euler", 1);
    compare_web("rk4", 7);
    compare_web("rk4_balanced", 54);
}

// --- company and failures ---

// The first links of a long chain do not feel its end for some steps: they have the bits of a short
// chain, though they share their batch with others.
static void company_changes_no_bit(void **state) {
    (void)state;
    subject few = {0}, many = {0};
    pm_monolithic *a = NULL, *b = NULL;
    open_chain(&few, "euler", 40, false, false);
    open_chain(&many, "euler", MOST_LINKS, false, false);
    require(pm_monolithic_open(&a, few.system));
    require(pm_monolithic_open(&b, many.system));
    pm_monolithic_set_state(a, few.z);
    pm_monolithic_set_state(b, many.z);
    for (int step = 0; step < 4; ++step) { // of two substeps: eight links away
        require(pm_monolithic_step(a));
        require(pm_monolithic_step(b));
        assert_memory_equal(pm_monolithic_sample(a)->z, pm_monolithic_sample(b)->z,
                            30 * NZ * sizeof(double));
    }
    pm_monolithic_close(a);
    pm_monolithic_close(b);
    close_chain(&few);
    close_chain(&many);
}

static void a_failure_names_its_subsystem(void **state) {
    (void)state;
    subject s = {0};
    divided alone;
    pm_monolithic *together = NULL;
    char message[512];
    open_chain(&s, "euler", LINKS, false, false);
    s.scene->run.largest_departure = 0.5;
    s.z[7 * NZ + 2] = 1e3;
    require(pm_monolithic_open(&together, s.system));
    divided_open(&alone, s.system, 0, NULL);
    divided_set_state(&alone, s.z);
    pm_monolithic_set_state(together, s.z);
    assert_int_equal(divided_step(&alone), PM_ENUMERIC);
    snprintf(message, sizeof message, "%s", pm_error());
    assert_int_equal(pm_monolithic_step(together), PM_ENUMERIC);
    assert_string_equal(pm_error(), message);
    assert_non_null(strstr(message, "subsystem link7: step 1"));
    divided_close(&alone);
    pm_monolithic_close(together);
    close_chain(&s);
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_have_the_bits_of_their_lanes),
        cmocka_unit_test(balanced_and_adaptive_steps_have_these_bits),
        cmocka_unit_test(blocks_rest_and_sum_in_the_order_of_the_scene),
        cmocka_unit_test(several_processes_have_the_bits_of_one),
        cmocka_unit_test(company_changes_no_bit),
        cmocka_unit_test(a_failure_names_its_subsystem),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

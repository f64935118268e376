// A batch gives every subsystem the bits, fluxes and counts that it has when it is stepped alone.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "sim/batch.h"
#include "sim/monolithic.h"

#define SEED 1807u
#define NZ 5
#define MOST_LINKS 300

// Chains of few links are stepped one by one (monolithic.c), so that both ways can be compared.
#define LINKS 15

static const double start[2 * NZ] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};

typedef struct subject {
    pm_scene *scene;
    pm_system *system;
    double z[MOST_LINKS * NZ];
} subject;

static void require(pm_status status) {
    if (status != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// A chain of learned links. Every third link, from the third on, has the weights of the upper one,
// so that models alternate.
static void open_chain(subject *s, const char *integrator, int links, bool resting) {
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
    const size_t n = (size_t)scene->nsubsystem;
    for (int i = 0; i < scene->nz; ++i) {
        if (memcmp(&a->z[i], &b->z[i], sizeof a->z[i]) != 0) {
            fail_msg("seed %u, step %ld: z[%d] is %.17g in the batch, %.17g alone", SEED, step, i,
                     a->z[i], b->z[i]);
        }
    }
    assert_memory_equal(a->energy, b->energy, n * sizeof *a->energy);
    assert_memory_equal(a->entropy, b->entropy, n * sizeof *a->entropy);
    assert_memory_equal(a->bulk_energy, b->bulk_energy, n * sizeof *a->bulk_energy);
    assert_memory_equal(a->bulk_entropy, b->bulk_entropy, n * sizeof *a->bulk_entropy);
    assert_memory_equal(a->bulk_gross, b->bulk_gross, 2 * n * sizeof *a->bulk_gross);
    assert_memory_equal(a->flux, b->flux, (size_t)scene->nport * sizeof *a->flux);
    assert_memory_equal(a->outside, b->outside, n * sizeof *a->outside);
    for (size_t i = 0; i < n; ++i) {
        assert_int_equal(a->evaluated[i], b->evaluated[i]);
        assert_int_equal(a->skipped[i], b->skipped[i]);
    }
}

static void a_batch_has_the_bits_of_its_parts(void **state) {
    (void)state;
    static const char *const integrators[] = {"euler", "heun", "rk4"};
    for (size_t i = 0; i < 6; ++i) {
        subject s = {0};
        pm_batch *batch = NULL;
        pm_monolithic *alone = NULL;
        pm_sample *sample = NULL;
        open_chain(&s, integrators[i % 3], LINKS, i >= 3);
        require(pm_batch_open(&batch, s.system));
        assert_non_null(batch);
        require(pm_monolithic_open(&alone, s.system));
        require(pm_sample_new(&sample, s.scene));
        for (int run = 0; run < 2; ++run) { // a second run starts anew
            pm_batch_set_state(batch, s.z, sample);
            pm_monolithic_set_state(alone, s.z);
            check_equal(s.scene, sample, pm_monolithic_sample(alone), 0);
            for (long step = 1; step <= 20; ++step) {
                require(pm_batch_step(batch, sample));
                require(pm_monolithic_step(alone));
                check_equal(s.scene, sample, pm_monolithic_sample(alone), step);
            }
        }
        pm_sample_free(sample);
        pm_monolithic_close(alone);
        pm_batch_close(batch);
        close_chain(&s);
    }
}

// The first links of a long chain do not feel its end for some steps: they have the bits of a short
// chain, though they share their batch with others.
static void company_changes_no_bit(void **state) {
    (void)state;
    subject few = {0}, many = {0};
    pm_monolithic *a = NULL, *b = NULL;
    open_chain(&few, "euler", 40, false);
    open_chain(&many, "euler", MOST_LINKS, false);
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
    pm_batch *batch = NULL;
    pm_monolithic *alone = NULL;
    pm_sample *sample = NULL;
    char message[512];
    open_chain(&s, "euler", LINKS, false);
    s.scene->largest_departure = 0.5;
    s.z[7 * NZ + 2] = 1e3;
    require(pm_batch_open(&batch, s.system));
    require(pm_monolithic_open(&alone, s.system));
    require(pm_sample_new(&sample, s.scene));
    pm_batch_set_state(batch, s.z, sample);
    pm_monolithic_set_state(alone, s.z);
    assert_int_equal(pm_monolithic_step(alone), PM_ENUMERIC);
    snprintf(message, sizeof message, "%s", pm_error());
    assert_int_equal(pm_batch_step(batch, sample), PM_ENUMERIC);
    assert_string_equal(pm_error(), message);
    assert_non_null(strstr(message, "subsystem link7: step 1"));
    pm_sample_free(sample);
    pm_monolithic_close(alone);
    pm_batch_close(batch);
    close_chain(&s);
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_batch_has_the_bits_of_its_parts),
        cmocka_unit_test(company_changes_no_bit),
        cmocka_unit_test(a_failure_names_its_subsystem),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

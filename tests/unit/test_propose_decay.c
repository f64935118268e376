// Proposals for stiff data: how fast deviations decay, and how many substeps this needs.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "propose/look.h"
#include "tests/support/proposal.h"
#include "tests/support/unit.h"

#define DECAY 200 // per s
#define STATES 50

// An oscillator, and an entropy that follows its position at once: s' = -DECAY (s - x^2/10). All
// states are close to the slow manifold s = x^2/10, where nothing changes faster than 2 per s.
static const char scene_text[] = "scene: stiff\n"
                                 "time: {dt: 0.1, steps: 49, integrator: rk4, substeps: 64}\n"
                                 "subsystems:\n"
                                 "  mass:\n"
                                 "    weights: mass.h5\n"
                                 "    state:\n"
                                 "      x: {unit: m, columns: [x]}\n"
                                 "      p: {unit: kg m/s, columns: [p]}\n"
                                 "      s: {unit: J/K, columns: [s]}\n";

static pm_dataset *make_data(void) {
    static const char *const column[] = {"x", "p", "s"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 10, STATES, 3, 0.1, column), PM_OK);
    const double fine = 1e-4; // s
    for (int i = 0; i < 10; ++i) {
        const double amplitude = 0.5 + 0.15 * i;
        double s = 0.1 * amplitude * amplitude;
        for (int j = 0; j < STATES; ++j) {
            const double t = 0.1 * j;
            const double z[] = {amplitude * cos(t), -amplitude * sin(t), s};
            memcpy(pm_dataset_state(d, i, j), z, sizeof z);
            for (int k = 0; k < 1000; ++k) { // decays exactly to the manifold of the middle
                const double x = amplitude * cos(t + (k + 0.5) * fine);
                s = 0.1 * x * x + (s - 0.1 * x * x) * exp(-DECAY * fine);
            }
        }
    }
    return d;
}

static void a_decay_that_is_over_shows_in_the_rates(void **state) {
    (void)state;
    pm_dataset *d = make_data();
    pm_scene *scene = NULL;
    pm_look look;
    assert_int_equal(pm_scene_parse(&scene, scene_text, "stiff.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_OK);
    assert_true(look.fastest < 3);
    const double decay = look.decay;
    if (!(decay > 0.8 * DECAY && decay < 1.2 * DECAY)) {
        fail_msg("a decay of %g per s, expected %d", decay, DECAY);
    }
    pm_look_free(&look);
    pm_dataset_free(d);
    pm_scene_free(scene);
}

static void a_proposal_has_substeps_for_it(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *d = make_data();
    propose_text(scene_text, d, text);
    assert_non_null(strstr(text, "rk4 of the scene has 64 substeps;\n# that is enough"));
    int substeps = 0;
    const char *found = strstr(text, "substeps: ");
    assert_non_null(found);
    assert_int_equal(sscanf(found, "substeps: %d", &substeps), 1);
    assert_true(substeps > 0.8 * DECAY * 0.1 && substeps < 1.2 * DECAY * 0.1 + 1);
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_decay_that_is_over_shows_in_the_rates),
        cmocka_unit_test(a_proposal_has_substeps_for_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

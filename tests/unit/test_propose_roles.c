// Proposals of training files: directions that turn with a body, boundary inputs, and strings.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "propose/draft.h"
#include "tests/support/proposal.h"
#include "tests/support/unit.h"

// Proposes a training file for the dataset, which is freed, and returns its text.
static void propose(const char *scene_text, pm_dataset *d, char text[PM_PROPOSAL_TEXT]) {
    propose_text(scene_text, d, text);
    pm_dataset_free(d);
}

#define TOP(momentum)                                             \
    "scene: top\n"                                                \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n" \
    "subsystems:\n"                                               \
    "  top:\n"                                                    \
    "    weights: top.h5\n"                                       \
    "    state:\n"                                                \
    "      M: {unit: " momentum ", columns: [Mx, My, Mz]}\n"      \
    "      g: {unit: \"1\", columns: [gx, gy, gz]}\n"             \
    "      s: {unit: J/K, columns: [s]}\n"

// Euler's equations of a heavy top with friction, with explicit steps of `sign` times the rotation.
static pm_dataset *spin_top(double sign, double unit) {
    static const char *const column[] = {"Mx", "My", "Mz", "gx", "gy", "gz", "s"};
    static const double inertia[3] = {1, 2, 3}, lever[3] = {0, 0, 0.5};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 3, 60, 7, 0.05, column), PM_OK);
    for (int k = 0; k < 3; ++k) {
        double M[3] = {1 + k, 0.5, -1}, g[3] = {0.6, 0, 0.8}, s = 0;
        for (int i = 0; i < 60; ++i) {
            memcpy(pm_dataset_state(d, k, i),
                   (const double[]){M[0] * unit, M[1] * unit, M[2] * unit, g[0], g[1], g[2], s},
                   7 * sizeof(double));
            for (int fine = 0; fine < 200; ++fine) {
                double rate[6], w[3];
                for (int c = 0; c < 3; ++c) {
                    w[c] = M[c] / inertia[c];
                    s += 2.5e-4 * 0.1 * w[c] * w[c] / 300;
                }
                for (int c = 0; c < 3; ++c) {
                    const int a = (c + 1) % 3, b = (c + 2) % 3;
                    rate[c] =
                        sign * (M[a] * w[b] - M[b] * w[a] + g[a] * lever[b] - g[b] * lever[a]);
                    rate[c] -= 0.1 * w[c];
                    rate[3 + c] = sign * (g[a] * w[b] - g[b] * w[a]);
                }
                for (int c = 0; c < 3; ++c) {
                    M[c] += 2.5e-4 * rate[c];
                    g[c] += 2.5e-4 * rate[3 + c];
                }
            }
        }
    }
    return d;
}

// The direction of gravity turns with a heavy top, and is no conjugate variable of its momentum.
static void a_direction_turns_with_its_body(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(TOP("kg m^2/s"), spin_top(1, 1), text);
    assert_proposal_says(text, "given: [[M, M, cross], [M, g, cross]]");
    assert_proposal_says(text, "acts_on: [M, s], rank: 3");
    assert_proposal_says(text, "{features: [M], hidden");
    propose(TOP("g m^2/s"), spin_top(1, 1000), text);
    assert_proposal_says(
        text, "[\"M[0]\", \"g[1]\", \"-1000*g[2]\"], [\"M[0]\", \"g[2]\", \"1000*g[1]\"]");
}

// Seen from outside, the products have the other sign, and the energy of rotation depends on the
// direction.
static void a_direction_may_be_seen_from_outside(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(TOP("kg m^2/s"), spin_top(-1, 1), text);
    assert_proposal_says(text, "[\"M[0]\", \"g[1]\", \"1*g[2]\"]");
    assert_proposal_says(text, "{features: [M, g], hidden");
}

#define FED(input)                                                \
    "scene: fed\n"                                                \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n" \
    "subsystems:\n"                                               \
    "  store:\n"                                                  \
    "    weights: store.h5\n"                                     \
    "    state:\n"                                                \
    "      Q: {unit: uC, columns: [Q]}\n"                         \
    "      s: {unit: J/K, columns: [s]}\n"                        \
    "boundary_inputs:\n"                                          \
    "  source:\n" input "ports:\n"                                \
    "  lead:\n"                                                   \
    "    law: bracket\n"                                          \
    "    between: [source, store]\n"                              \
    "    expose: {source: [u, s], store: [Q, s]}\n"               \
    "    weights: lead.h5\n"

static pm_dataset *charge(void) {
    static const char *const column[] = {"Q", "s"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 2, 50, 2, 0.1, column), PM_OK);
    for (int i = 0; i < 2 * 100; ++i) {
        d->z[i] = sin(0.37 * i + i % 2);
    }
    return d;
}

// A voltage moves a charge through a resistor only. A current moves it without loss.
static void a_boundary_input_acts_as_its_unit_says(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(FED("    u: {unit: C, dE: [3.0], dS: [0]}\n    s: {unit: J/K, dE: [300.0], dS: [1]}\n"),
            charge(), text);
    assert_proposal_omits(text, "against: [b.Q]");
    assert_proposal_says(text, "acts_on: [a.u, b.Q, a.s, b.s]");
    propose(FED("    u: {unit: Wb, dE: [3.0]}\n    s: {unit: J/K, dE: [300.0], dS: [1]}\n"),
            charge(), text);
    assert_proposal_says(text, "learned: {acts_on: [a.u], against: [b.Q]}");
}

#define WARMED                                                            \
    "scene: warmed\n"                                                     \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n"         \
    "subsystems:\n"                                                       \
    "  wall: {weights: wall.h5, state: {s: {unit: J/K, columns: [s]}}}\n" \
    "boundary_inputs:\n"                                                  \
    "  water: {s: {unit: J/K, dE: [310.0], dS: [1]}}\n"                   \
    "ports:\n"                                                            \
    "  film:\n"                                                           \
    "    law: bracket\n"                                                  \
    "    between: [wall, water]\n"                                        \
    "    expose: {wall: [s], water: [s]}\n"                               \
    "    weights: film.h5\n"

// A boundary input shows a temperature, and no entropy on which a conductance could depend.
static void a_boundary_input_is_no_feature(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(WARMED, charge(), text);
    assert_proposal_says(text, "acts_on: [a.s, b.s], rank: 1, features: [a.s], hidden: [4]");
}

#define APART(length)                                                    \
    "scene: apart\n"                                                     \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n"        \
    "subsystems:\n"                                                      \
    "  spring: {weights: a.h5, state: {x: {unit: " length                \
    ", columns: [x]}, s: {unit: J/K, columns: [s]}}}\n"                  \
    "  mass: {weights: b.h5, state: {p: {unit: g m/s, columns: [p]}}}\n" \
    "ports:\n"                                                           \
    "  tip:\n"                                                           \
    "    law: bracket\n"                                                 \
    "    between: [spring, mass]\n"                                      \
    "    expose: {spring: [x, s], mass: [p]}\n"                          \
    "    weights: tip.h5\n"

// A mass on a spring, in other units.
static pm_dataset *swing(double length, double momentum) {
    static const char *const column[] = {"x", "p", "s"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 3, 60, 3, 0.05, column), PM_OK);
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < 60; ++i) {
            const double at = 0.1 * i + k;
            memcpy(pm_dataset_state(d, k, i),
                   (const double[]){sin(at) * length, cos(at) * momentum, 1e-4 * i},
                   3 * sizeof(double));
        }
    }
    return d;
}

// A momentum of one subsystem moves a length of another one: the product of the units is that of an
// action, so that the coefficient is 1 in SI units, unless there is a gear.
static void a_length_and_a_momentum_are_conjugate_across_a_port(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(APART("um"), swing(1e6, 1e3), text);
    assert_proposal_says(text, "constants: {lever1: {learned: -1.0}}");
    assert_proposal_says(text, "given: [[b.p, a.x, \"1000000000.0*lever1\"]]");
    assert_proposal_says(text, "irreversible: {learned: {acts_on: [b.p, a.s]");
    propose(APART("m^3"), swing(1, 1e3), text); // a piston, whose area is to be learned; it leaks
    assert_proposal_says(text, "irreversible: {learned: {acts_on: [a.x, b.p, a.s]");
    assert_proposal_says(text, "learned: {acts_on: [a.x], against: [b.p]}");
}

#define FLYWHEEL                                                                                 \
    "scene: flywheel\n"                                                                          \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n"                                \
    "subsystems:\n"                                                                              \
    "  wheel: {weights: a.h5, state: {L: {unit: kg m^2/s, columns: [x]}, q: {unit: C, columns: " \
    "[p]}, s: {unit: J/K, columns: [s]}}}\n"

// The heat of a body does not depend on how fast it turns, but it may depend on its charge.
static void momenta_do_not_warm_a_body(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(FLYWHEEL, swing(1, 1), text);
    assert_proposal_says(text, "- {features: [L, q], hidden");
    assert_proposal_says(text, "- {features: [q, s], rising: true, hidden");
}

#define STRING                                                                                    \
    "scene: string\n"                                                                             \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n"                                 \
    "subsystems:\n"                                                                               \
    "  ball: {weights: a.h5, state: {q: {unit: m, columns: [x, y]}, p: {unit: kg m/s, columns: [" \
    "u, v]}, s: {unit: J/K, columns: [s]}}}\n"

// A ball of 1 kg in air, in a field of 10 m/s^2 along y. It begins at `length` (m) below the pivot
// or at its side, on an elastic string of 1 m and 30 N/m, or if it begins nearer on one of no
// length.
static pm_dataset *hang(double length) {
    static const char *const column[] = {"x", "y", "u", "v", "s"};
    const double fine = 0.0005;
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 3, 60, 5, 0.05, column), PM_OK);
    for (int k = 0; k < 3; ++k) {
        double z[5] = {0.3 * k * length, -length, 0.2 * length, 0.1 * k * length, 0};
        for (int i = 0; i < 60; ++i) {
            memcpy(pm_dataset_state(d, k, i), z, sizeof z);
            for (int t = 0; t < 100; ++t) {
                const double r = hypot(z[0], z[1]), field = length > 0.5 ? 10 : 1;
                const double pull = length > 0.5 ? 30 * (1 - 1 / r) : 30;
                const double heat = 0.05 * (z[2] * z[2] + z[3] * z[3]) / 300;
                const double rate[5] = {z[2], z[3], -pull * z[0] - 0.05 * z[2],
                                        -pull * z[1] - 0.05 * z[3] - field, heat};
                for (int c = 0; c < 5; ++c) {
                    z[c] += fine * rate[c];
                }
            }
        }
    }
    return d;
}

// A field breaks the symmetry of a string, whose energy depends on its length as before. Where the
// ball passes the pivot, the length has no derivative.
static void a_string_in_a_field_has_a_length(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose(STRING, hang(1.2), text);
    assert_proposal_says(text, "- {features: [\"|q|\", q], hidden");
    assert_proposal_says(text, "- {features: [\"|q|\", q, s], rising: true, hidden");
    propose(STRING, hang(0.1), text);
    assert_proposal_says(text, "- {features: [q], hidden");
}

// Writes the model of the first subsystem of a scene with this answer about the whole scene.
static void draft_part(const char *text_of_scene, const pm_dataset *data, pm_question question,
                       int answer, char text[PM_PROPOSAL_TEXT]) {
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_parse(&scene, text_of_scene, "scene.yaml"), PM_OK);
    const pm_proposal p = {.scene = scene, .dataset = data};
    pm_part_view part;
    int asked[2][PM_QUESTIONS], chosen[PM_SEARCH_CHOICES] = {0};
    pm_draft d = {.p = &p, .part = &part, .asked = asked};
    assert_int_equal(pm_look_make(&d.look, scene, data), PM_OK);
    d.rotates = pm_view_parts(&d.look, &part);
    pm_draft_ask(&d);
    d.chosen = chosen;
    assert_true(asked[0][question] >= 0);
    chosen[asked[0][question]] = answer;
    d.file = fmemopen(text, PM_PROPOSAL_TEXT, "w");
    assert_non_null(d.file);
    pm_draft_part(&d, &part);
    assert_int_equal(fclose(d.file), 0);
    pm_look_free(&d.look);
    pm_scene_free(scene);
}

// Each answer about the size has as many processes as move four entropies independently, or one
// between every two of them. Training starts at 300 K, or at 1 K.
static void the_answers_about_a_scene_are_written(void **state) {
    (void)state;
    static const char *const column[] = {"a", "b", "c", "d"};
    static const char scene[] =
        "scene: heat\n"
        "time: {dt: 0.1, steps: 10, integrator: rk4, substeps: 1}\n"
        "subsystems:\n"
        "  stack: {weights: a.h5, state: {s: {unit: kJ/K, columns: [a, b, c, d]}}}\n"
        "boundary_inputs:\n"
        "  water: {t: {unit: J/K, dE: [310.0], dS: [1]}}\n"
        "ports:\n"
        "  film: {law: bracket, between: [water, stack], expose: {water: [t], stack: [s]}, "
        "weights: b.h5}\n";
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *data = NULL;
    assert_int_equal(pm_dataset_new(&data, 3, 50, 4, 0.1, column), PM_OK);
    for (int i = 0; i < 3 * 50 * 4; ++i) {
        data->z[i] = sin(0.37 * i + i % 7);
    }
    for (int i = 0; i < 2; ++i) {
        draft_part(scene, data, PM_ASK_SIZE, i, text);
        assert_proposal_says(text, i == 1 ? "acts_on: [s], rank: 6" : "acts_on: [s], rank: 3");
        draft_part(scene, data, PM_ASK_TEMPERATURE, i, text);
        assert_proposal_says(text, i == 1 ? "{features: [s], rising: true, temperature: 1e+03}"
                                          : "{features: [s], rising: true}");
    }
    pm_dataset_free(data);
}

// Amounts and entropies in J/K leave the scale of energies open: training starts at 300 K, and the
// file says so. A momentum or an energy fixes the scale, and the data decide.
static void nothing_may_fix_the_scale_of_energies(void **state) {
    (void)state;
    static const char *const column[] = {"a", "b"};
    static const char scene[] = "scene: gas\n"
                                "time: {dt: 0.1, steps: 10, integrator: rk4, substeps: 1}\n"
                                "subsystems:\n"
                                "  gas: {weights: a.h5, state: {n: {unit: %s, columns: [a]}, s: "
                                "{unit: J/K, columns: [b]}}}\n";
    static const char *const unit[] = {"mol", "kJ", "kg m/s"};
    for (int i = 0; i < 3; ++i) {
        char own[500], text[PM_PROPOSAL_TEXT];
        pm_dataset *data = NULL;
        assert_int_equal(pm_dataset_new(&data, 3, 50, 2, 0.1, column), PM_OK);
        for (int k = 0; k < 3 * 50 * 2; ++k) {
            data->z[k] = 2 + sin(0.37 * k + k % 7);
        }
        snprintf(own, sizeof own, scene, unit[i]);
        if (i == 0) {
            propose_text(own, data, text);
            assert_proposal_says(text, "do not fix the scale of energies");
            assert_proposal_omits(text, ", temperature: ");
        }
        pm_scene *s = NULL;
        assert_int_equal(pm_scene_parse(&s, own, "scene.yaml"), PM_OK);
        const pm_proposal p = {.scene = s, .dataset = data};
        pm_part_view part;
        int asked[1][PM_QUESTIONS];
        pm_draft d = {.p = &p, .part = &part, .asked = asked};
        assert_int_equal(pm_look_make(&d.look, s, data), PM_OK);
        d.rotates = pm_view_parts(&d.look, &part);
        pm_draft_ask(&d);
        assert_int_equal(asked[0][PM_ASK_TEMPERATURE] >= 0, i > 0);
        pm_look_free(&d.look);
        pm_scene_free(s);
        pm_dataset_free(data);
    }
}

// Amounts in mol make an ideal mixture, in the units of the scene, or what networks find.
static void amounts_make_a_mixture(void **state) {
    (void)state;
    static const char *const column[] = {"a", "b", "c", "s"};
    static const char scene[] =
        "scene: reactor\n"
        "time: {dt: 0.1, steps: 10, integrator: rk4, substeps: 1}\n"
        "subsystems:\n"
        "  reactor: {weights: a.h5, state: {A: {unit: mmol, columns: [a]}, n: {unit: mol, columns: "
        "[b, c]}, s: {unit: J/K, columns: [s]}}}\n";
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *data = NULL;
    assert_int_equal(pm_dataset_new(&data, 3, 50, 4, 0.1, column), PM_OK);
    for (int i = 0; i < 3 * 50 * 4; ++i) {
        data->z[i] = 2 + sin(0.37 * i + i % 7);
    }
    draft_part(scene, data, PM_ASK_KINETIC, 0, text);
    assert_proposal_says(text, "- \"2494.2*(0.001*A*u1+n[0]*u2+n[1]*u3)\"");
    assert_proposal_says(text, "- \"300*(w+0.001*A*c1+n[0]*c2+n[1]*c3)*(exp((s-s0-8.314*("
                               "0.001*A*(z1-ln(0.001*A)+ln(0.001*A+n[0]+n[1]))+n[0]*(z2-ln(n[0])"
                               "+ln(0.001*A+n[0]+n[1]))+n[1]*(z3-ln(n[1])+ln(0.001*A+n[0]+n[1]))"
                               "))/(w+0.001*A*c1+n[0]*c2+n[1]*c3))-1)\"");
    assert_proposal_says(text, "c3: {learned: 50, positive: true}, u3: {learned: 0.0}");
    draft_part(scene, data, PM_ASK_KINETIC, 1, text);
    assert_proposal_says(text, "- {features: [A, n], hidden");
    pm_dataset_free(data);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_direction_turns_with_its_body),
        cmocka_unit_test(a_direction_may_be_seen_from_outside),
        cmocka_unit_test(a_boundary_input_acts_as_its_unit_says),
        cmocka_unit_test(a_boundary_input_is_no_feature),
        cmocka_unit_test(a_length_and_a_momentum_are_conjugate_across_a_port),
        cmocka_unit_test(momenta_do_not_warm_a_body),
        cmocka_unit_test(a_string_in_a_field_has_a_length),
        cmocka_unit_test(the_answers_about_a_scene_are_written),
        cmocka_unit_test(nothing_may_fix_the_scale_of_energies),
        cmocka_unit_test(amounts_make_a_mixture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// Proposals of training files: units, regressions on data, the proposed file, and the division of
// trajectories into training and validation.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/split.h"
#include "propose/propose.h"
#include "propose/view.h"
#include "tests/support/proposal.h"
#include "tests/support/unit.h"

// --- units ---

static void assert_unit(const char *a, const char *b, bool same) {
    const pm_unit left = pm_unit_parse(a), right = pm_unit_parse(b);
    if (pm_unit_equal(&left, &right) != same) {
        fail_msg("\"%s\" and \"%s\": expected %s", a, b, same ? "one unit" : "two units");
    }
}

static void units_are_powers_of_base_units(void **state) {
    (void)state;
    assert_unit("J s", "kg m^2/s", true);
    assert_unit("C*Wb", "J s", true);
    assert_unit("N m s", "kg m2 s^-1", true);
    assert_unit("W/(K m)", "kg m/(s^3 K)", true);
    assert_unit("J/(m^3/s)", "Pa s", true);
    assert_unit("J/(J/(m^3/s))", "m^3/s", true);
    assert_unit("W/(m/s K)", "N/K", true);
    assert_unit("J/K", "J", false);
    assert_unit("rad", "1", true);
    assert_unit("1/s", "Hz", true);
    assert_unit("furlong", "furlong", false); // not known, so never equal
    assert_unit("m^x", "m", false);
    assert_unit("kg*m**2/s", "J s", true);
    assert_unit("-", "1", true);
}

// People write units without blanks, and with raised dots and digits.
static void units_are_read_as_people_write_them(void **state) {
    (void)state;
    assert_unit("Nms", "J s", true);
    assert_unit("Vs", "Wb", true);
    assert_unit("kgm\xc2\xb2/s", "J s", true);
    assert_unit("N\xc2\xb7m\xc2\xb7s", "J s", true);
    assert_unit("kg m s\xe2\x81\xbb\xc2\xb9", "N s", true);
    assert_unit("J K\xe2\x81\xbb\xc2\xb9", "J/K", true);
    assert_unit("mAh", "C", true);
    assert_unit("kWh/K", "J/K", true);
    assert_unit("steps", "1", false);
    assert_unit("\xc2\xb0"
                "C",
                "C", false); // a temperature with an offset, which is no power
}

static void assert_conversion(const char *text, const char *to, double x, double expected) {
    const pm_unit unit = pm_unit_parse(to);
    double factor = NAN, offset = NAN;
    const bool found = pm_unit_conversion(text, &unit, &factor, &offset);
    if (found != isfinite(expected) ||
        (found && fabs(factor * x + offset - expected) > 1e-13 * fabs(expected))) {
        fail_msg("%.17g %s: found %.17g %s, expected %.17g", x, text, factor * x + offset, to,
                 expected);
    }
}

static void units_are_converted(void **state) {
    (void)state;
    assert_conversion("degC", "K", 20, 293.15);
    assert_conversion("\u00b0C", "K", -273.15, 0);
    assert_conversion("C", "K", 0, 273.15);
    assert_conversion("C", "mC", 1, 1000); // a charge
    assert_conversion("degF", "degC", 212, 100);
    assert_conversion("K", "degC", 293.15, 20);
    assert_conversion("W/K", "kW/K", 500, 0.5);
    assert_conversion("rpm", "rad/s", 60, 6.283185307179586);
    assert_conversion("rev/min", "rad/s", 60, 6.283185307179586);
    assert_conversion("deg/s", "rad/s", 180, 3.141592653589793);
    assert_conversion("bar", "Pa", 1.5, 1.5e5);
    assert_conversion("L/min", "m^3/s", 60, 1e-3);
    assert_conversion("km/h", "m/s", 36, 10);
    assert_conversion("%", "1", 30, 0.3);
    assert_conversion("k\u03a9", "Ohm", 2, 2000);
    assert_conversion("Hz", "1/s", 50, 50);
    assert_conversion("Hz", "rad/s", 50, NAN); // or 2 pi times as many
    assert_conversion("V", "A", 1, NAN);
    assert_conversion("furlong", "furlong", 1, NAN);
    const pm_unit joule = pm_unit_parse("J"), metre = pm_unit_parse("m");
    const pm_unit force = pm_unit_quotient(&joule, &metre);
    assert_string_equal(pm_unit_symbol(&force), "N");
    assert_null(pm_unit_symbol(&(pm_unit){.known = true, .factor = 1}));
}

static void assert_factor(const char *text, const char *base, double factor) {
    const pm_unit unit = pm_unit_parse(text);
    assert_unit(text, base, true);
    if (fabs(unit.factor / factor - 1) > 1e-14) {
        fail_msg("\"%s\": a factor of %.17g, expected %.17g", text, unit.factor, factor);
    }
}

static void prefixes_are_factors(void **state) {
    (void)state;
    assert_factor("mm", "m", 1e-3);
    assert_factor("kJ/K", "J/K", 1e3);
    assert_factor("g mm^2/ms", "J s", 1e-6);
    assert_factor("1/min", "Hz", 1.0 / 60); // no milli-inch
    assert_factor("kg", "kg", 1);
    assert_factor("mol", "mol", 1);
    assert_factor("\xc2\xb5s", "s", 1e-6);
    assert_factor("ml", "m^3", 1e-6);
    assert_factor("hPa", "Pa", 100);
    assert_factor("mAh", "C", 3.6);
    assert_factor("kWh", "J", 3.6e6);
    assert_factor("\xc2\xb0", "1", 0.017453292519943295);
    assert_factor("deg", "1", 0.017453292519943295);
    assert_unit("kk", "1", false);
}

// --- the choice of trajectories ---

static void every_fifth_is_kept_back(void **state) {
    (void)state;
    pm_arena arena = {0};
    pm_split split;
    assert_int_equal(pm_split_choose(&split, 12, NULL, NULL, &arena), PM_OK);
    assert_string_equal(split.validation, "4,9");
    assert_string_equal(split.training, "0:4,5:9,10:12");
    assert_int_equal(pm_split_choose(&split, 12, "2:8", NULL, &arena), PM_OK);
    assert_string_equal(split.validation, "6");
    assert_string_equal(split.training, "2:6,7");
    assert_int_equal(pm_split_choose(&split, 4, NULL, NULL, &arena), PM_OK);
    assert_int_equal(split.nvalidation, 0);
    assert_int_equal(pm_split_choose(&split, 12, "0:8", "8:12", &arena), PM_OK);
    assert_int_equal(split.ntraining, 8);
    assert_int_equal(split.nvalidation, 4);
    assert_int_equal(pm_split_choose(&split, 12, NULL, "none", &arena), PM_OK);
    assert_int_equal(split.ntraining, 12);
    assert_int_equal(pm_split_choose(&split, 12, "3", "3", &arena), PM_EUSAGE);
    assert_int_equal(pm_split_choose(&split, 12, NULL, "10:20", &arena), PM_EUSAGE);
    pm_arena_free(&arena);
}

static void a_dataset_is_sorted_by_the_choice(void **state) {
    (void)state;
    static const char *const column[] = {"x"};
    pm_arena arena = {0};
    pm_split split;
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 6, 2, 1, 0.1, column), PM_OK);
    for (int i = 0; i < 6; ++i) {
        *pm_dataset_state(d, i, 0) = i;
    }
    const uint64_t digest = pm_dataset_digest(d, 1);
    assert_int_equal(pm_split_choose(&split, 6, NULL, "1", &arena), PM_OK);
    assert_int_equal(pm_split_reorder(&split, d), PM_OK);
    static const double expected[] = {0, 2, 3, 4, 5, 1};
    for (int i = 0; i < 6; ++i) {
        assert_true(*pm_dataset_state(d, i, 0) == expected[i]);
    }
    assert_true(pm_dataset_digest(d, 5) == digest);
    pm_dataset_free(d);
    pm_arena_free(&arena);
}

// --- statistics of data, and a proposal ---

// Two masses on springs. The second spring joins them, and x2 is its extension. The names of
// variables carry no information; the units and the data do.
#define PAIR(length, entropy)                                     \
    "scene: pair\n"                                               \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 2}\n" \
    "subsystems:\n"                                               \
    "  first:\n"                                                  \
    "    weights: first.h5\n"                                     \
    "    state:\n"                                                \
    "      u: {unit: kg m/s, columns: [p1]}\n"                    \
    "      v: {unit: " length ", columns: [x1]}\n"                \
    "      w: {unit: J/K, columns: [s1]}\n"                       \
    "  second:\n"                                                 \
    "    weights: second.h5\n"                                    \
    "    state:\n"                                                \
    "      v: {unit: " length ", columns: [x2]}\n"                \
    "      u: {unit: kg m/s, columns: [p2]}\n"                    \
    "      w: {unit: " entropy ", columns: [s2]}\n"               \
    "ports:\n"                                                    \
    "  joint:\n"                                                  \
    "    law: bracket\n"                                          \
    "    between: [first, second]\n"                              \
    "    expose: {first: [u, v, w], second: [u, v, w]}\n"         \
    "    weights: joint.h5\n"

static const char scene_text[] = PAIR("m", "J/K");

static pm_dataset *make_data(void) {
    static const char *const column[] = {"x1", "p1", "s1", "x2", "p2", "s2"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 5, 60, 6, 0.05, column), PM_OK);
    for (int i = 0; i < 5; ++i) {
        double z[6] = {0.3 + 0.1 * i, -0.2 * i, 0.01 * i, 0.2 - 0.1 * i, 0.3, 0.02};
        for (int j = 0; j < 60; ++j) {
            memcpy(pm_dataset_state(d, i, j), z, sizeof z);
            for (int k = 0; k < 500; ++k) { // masses of 2 and 0.5 kg
                const double h = 1e-4, spring = 3 * z[3] + z[3] * z[3] * z[3];
                const double v1 = z[1] / 2, v2 = z[4] / 0.5;
                z[1] += h * (-4 * z[0] + spring - 0.2 * v1);
                z[4] += h * (-spring - 0.1 * v2);
                z[0] += h * z[1] / 2;
                z[3] += h * (z[4] / 0.5 - z[1] / 2);
                z[2] += h * 0.2 * v1 * v1 / 300;
                z[5] += h * 0.1 * v2 * v2 / 300;
            }
        }
    }
    return d;
}

static void data_say_what_moves_with_what(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    pm_dataset *d = make_data();
    pm_look look;
    pm_part_view part[2];
    pm_port_view port;
    assert_int_equal(pm_scene_parse(&scene, scene_text, "pair.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_OK);
    pm_view_parts(&look, part);
    assert_int_equal(part[0].kind[0], PM_VIEW_MOMENTUM);
    assert_int_equal(part[0].kind[1], PM_VIEW_POSITION);
    assert_int_equal(part[0].kind[2], PM_VIEW_ENTROPY);
    assert_true(part[0].sign[1] == 1 && part[0].linear[1] && part[0].geometric[1]);
    assert_false(part[0].geometric[0]);
    pm_view_port(&look, part, 0, &port);
    int found = 0;
    for (int i = 0; i < port.count; ++i) { // first.u carries second.v: x2' = p2/m2 - p1/m1
        found += port.pair[i].a == 0 && port.pair[i].b == 0 && port.pair[i].momentum_first &&
                 port.pair[i].coefficient == 1;
    }
    assert_int_equal(found, 1);
    pm_look_free(&look);
    pm_dataset_free(d);
    pm_scene_free(scene);
}

static void a_proposal_names_them(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *d = make_data();
    propose_text(scene_text, d, text);
    assert_proposal_says(text, "given: [[v, u, 1.0]]");
    assert_proposal_says(text, "given: [[a.u, b.v, 1.0]]");
    assert_proposal_says(text, "entropy: {given: [w]}");
    assert_proposal_says(
        text, "acts_on: [u, w], rank: 1, strength: {features: [\"|u|\", v, w], hidden: [6]}");
    assert_proposal_says(text, "acts_on: [a.u, b.u, a.w, b.w], rank: 3");
    assert_proposal_says(text, "strength: {features: [a.u, a.v, a.w, b.v, b.u, b.w], hidden: [6]}");
    assert_proposal_says(text, "stages:");
    pm_dataset_free(d);
}

// Lengths in mm and entropies in kJ/K: coefficients carry the factors of the units.
static void units_with_prefixes_give_coefficients(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    static const double factor[6] = {1e3, 1, 1, 1e3, 1, 1e-3};
    pm_dataset *d = make_data();
    for (int i = 0; i < d->ntrajectory * d->ntime * 6; ++i) {
        d->z[i] *= factor[i % 6];
    }
    propose_text(PAIR("mm", "kJ/K"), d, text);
    assert_proposal_says(text, "given: [[v, u, 1000.0]]");
    assert_proposal_says(text, "given: [[a.u, b.v, 1000.0]]");
    assert_proposal_says(text, "entropy: {given: [w]}");
    assert_proposal_says(text, "entropy: {given: {w: 1000.0}}");
    pm_dataset_free(d);
}

// A body with a rotor: the momentum of the rotor is a part of that of the body, so that the energy
// depends on both together.
static void a_rotor_shares_the_energy_of_its_body(void **state) {
    (void)state;
    static const char *const column[] = {"Mx", "My", "Mz", "h", "s"};
    static const char body[] = "scene: body\n"
                               "time: {dt: 0.1, steps: 10, integrator: rk4, substeps: 1}\n"
                               "subsystems:\n"
                               "  body:\n"
                               "    weights: body.h5\n"
                               "    state:\n"
                               "      M: {unit: N m s, columns: [Mx, My, Mz]}\n"
                               "      h: {unit: N m s, columns: [h]}\n"
                               "      s: {unit: J/K, columns: [s]}\n";
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 2, 50, 5, 0.1, column), PM_OK);
    for (int i = 0; i < 5 * 100; ++i) {
        d->z[i] = sin(0.37 * i + i % 5);
    }
    propose_text(body, d, text);
    assert_proposal_says(text, "{features: [M, h], hidden");
    assert_proposal_says(text, "given: [[M, M, cross]]");
    pm_dataset_free(d);
}

// Two capacitors in a loop with a coil, one of them beside a resistor: the flux moves both charges,
// and only one of them is its conjugate variable.
static void a_flux_moves_two_charges(void **state) {
    (void)state;
    static const char *const column[] = {"q", "q1", "phi", "s"};
    static const char loop[] = "scene: loop\n"
                               "time: {dt: 0.1, steps: 49, integrator: rk4, substeps: 1}\n"
                               "subsystems:\n"
                               "  loop:\n"
                               "    weights: loop.h5\n"
                               "    state:\n"
                               "      q: {unit: C, columns: [q]}\n"
                               "      q1: {unit: C, columns: [q1]}\n"
                               "      phi: {unit: Wb, columns: [phi]}\n"
                               "      s: {unit: J/K, columns: [s]}\n";
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 3, 50, 4, 0.1, column), PM_OK);
    for (int k = 0; k < 3; ++k) {
        double q = 1 + k, q1 = 2 - k, phi = 0.3 * k, s = 0;
        for (int i = 0; i < 50; ++i) {
            memcpy(pm_dataset_state(d, k, i), (const double[]){q, q1, phi, s}, 4 * sizeof(double));
            for (int fine = 0; fine < 100; ++fine) {
                const double h = 0.001, loss = 0.3 * q1 * q1 + 0.1 * phi * phi;
                phi -= h * (q + q1 + 0.1 * phi);
                q += h * phi;
                q1 += h * (phi - 0.3 * q1);
                s += h * loss / 300;
            }
        }
    }
    propose_text(loop, d, text);
    assert_proposal_says(text, "given: [[q, phi, 1.0]]");
    assert_proposal_says(text, "learned: {acts_on: [q1, phi]}");
    pm_dataset_free(d);
}

// Two species react, so that the rate of one follows the amount of the other. Amounts keep their
// signs when time runs backwards: nothing couples them without loss.
static void amounts_are_not_coupled_without_loss(void **state) {
    (void)state;
    static const char *const column[] = {"A", "B", "s"};
    static const char cell[] = "scene: cell\n"
                               "time: {dt: 0.1, steps: 10, integrator: rk4, substeps: 1}\n"
                               "subsystems:\n"
                               "  cell:\n"
                               "    weights: cell.h5\n"
                               "    state:\n"
                               "      A: {unit: mol, columns: [A]}\n"
                               "      B: {unit: mol, columns: [B]}\n"
                               "      s: {unit: J/K, columns: [s]}\n";
    char text[PM_PROPOSAL_TEXT];
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 2, 50, 3, 0.1, column), PM_OK);
    for (int i = 0; i < 3 * 100; ++i) {
        d->z[i] = 1 + exp(-0.01 * i) * (i % 3 == 0 ? 1 : -0.5);
    }
    propose_text(cell, d, text);
    assert_proposal_says(text, "irreversible: {learned: {acts_on: [A, B, s], rank: 1, strength: "
                               "{features: [A, B, s]");
    assert_null(strstr(text, "    reversible"));
    pm_dataset_free(d);
}

// A thermoelectric couple: with a Seebeck coefficient its current carries entropy from one block to
// the other, which friction and conduction cannot describe.
static void propose_couple(double seebeck, char text[PM_PROPOSAL_TEXT]) {
    static const char *const column[] = {"Q", "phi", "s1", "s2"};
    static const char couple[] = "scene: couple\n"
                                 "time: {dt: 0.1, steps: 49, integrator: rk4, substeps: 1}\n"
                                 "subsystems:\n"
                                 "  hot:\n"
                                 "    weights: hot.h5\n"
                                 "    state:\n"
                                 "      Q: {unit: C, columns: [Q]}\n"
                                 "      phi: {unit: Wb, columns: [phi]}\n"
                                 "      s: {unit: J/K, columns: [s1]}\n"
                                 "  cold:\n"
                                 "    weights: cold.h5\n"
                                 "    state: {s: {unit: J/K, columns: [s2]}}\n"
                                 "ports:\n"
                                 "  couple:\n"
                                 "    law: bracket\n"
                                 "    between: [hot, cold]\n"
                                 "    expose: {hot: [phi, s], cold: [s]}\n"
                                 "    weights: couple.h5\n";
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 4, 60, 4, 0.1, column), PM_OK);
    for (int k = 0; k < 4; ++k) {
        double z[4] = {1 + k, 0.3 * k, 0.2 * k, -0.1 * k}; // heat capacities of 6 and 9 J/K
        for (int i = 0; i < 60; ++i) {
            memcpy(pm_dataset_state(d, k, i), z, sizeof z);
            for (int fine = 0; fine < 100; ++fine) {
                const double h = 0.001, loss = 0.1 * z[1] * z[1];
                const double hot = 300 * exp(z[2] / 6), cold = 300 * exp(z[3] / 9);
                const double heat = 0.5 * (hot - cold), carried = seebeck * z[1];
                z[1] += h * (-z[0] - 0.1 * z[1] + seebeck * (hot - cold));
                z[0] += h * z[1];
                z[2] += h * ((loss / 2 - heat) / hot - carried);
                z[3] += h * ((loss / 2 + heat) / cold + carried);
            }
        }
    }
    propose_text(couple, d, text);
    pm_dataset_free(d);
}

static void a_current_may_carry_entropy(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose_couple(0.01, text);
    assert_proposal_says(text,
                         "learned: {acts_on: [a.phi], against: [a.s, b.s], features: [a.s, b.s]");
    propose_couple(0, text);
    assert_proposal_says(text,
                         "# No variable of one end moves a variable of the other end without loss");
    assert_null(strstr(text, "against"));
}

// The scene of a black box has one subsystem with the groups and columns of all.
static void a_scene_of_one_has_all_groups(void **state) {
    (void)state;
    char path[] = "/tmp/test_proposeXXXXXX";
    const int id = mkstemp(path);
    assert_true(id >= 0);
    close(id);
    pm_scene *scene = NULL, *one = NULL;
    assert_int_equal(pm_scene_parse(&scene, scene_text, "pair.yaml"), PM_OK);
    assert_true(pm_propose_fits_one(scene));
    assert_int_equal(pm_propose_scene_of_one(scene, path), PM_OK);
    assert_int_equal(pm_scene_load(&one, path), PM_OK);
    remove(path);
    assert_int_equal(one->physics.nsubsystem, 1);
    assert_int_equal(one->physics.nport, 0);
    assert_int_equal(one->physics.nz, scene->physics.nz);
    assert_string_equal(one->physics.subsystem[0].layout.group[4].name, "second_u");
    assert_string_equal(one->physics.subsystem[0].column[4], "p2");
    pm_scene_free(one);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(units_are_powers_of_base_units),
        cmocka_unit_test(units_are_read_as_people_write_them),
        cmocka_unit_test(prefixes_are_factors),
        cmocka_unit_test(units_are_converted),
        cmocka_unit_test(every_fifth_is_kept_back),
        cmocka_unit_test(a_dataset_is_sorted_by_the_choice),
        cmocka_unit_test(data_say_what_moves_with_what),
        cmocka_unit_test(a_proposal_names_them),
        cmocka_unit_test(units_with_prefixes_give_coefficients),
        cmocka_unit_test(a_rotor_shares_the_energy_of_its_body),
        cmocka_unit_test(a_flux_moves_two_charges),
        cmocka_unit_test(amounts_are_not_coupled_without_loss),
        cmocka_unit_test(a_current_may_carry_entropy),
        cmocka_unit_test(a_scene_of_one_has_all_groups),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// The bounding test of contact: all points of a box are open; a rollout has the same bits with and
// without boxes, and evaluates far less; derived variables equal the same expressions written out.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/rng.h"
#include "model/contact_bound.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"
#include "sim/contact_broadphase.h"
#include "sim/monolithic.h"
#include "tests/support/divided.h"
#include "tests/support/unit.h"

// A body swings in the plane above a bumpy floor that creeps, 0.5 to 0.7 m below it. The gap
// between them has the travel x [2], the creep [3] and the entropy s. `OTHER` is one more summand
// of its energy.
#define SCENE(GAP, EXPOSED)                                                                \
    "scene: floor\n"                                                                       \
    "time: {dt: 0.02, steps: 1, integrator: rk4, substeps: 4}\n"                           \
    "models:\n"                                                                            \
    "  body: {energy: \"|p|^2/2 + 8*|q|^2\", reversible: {given: [[q, p, 1]]}}\n"          \
    "  meets: {law: contact, matrix: identity}\n"                                          \
    "  gap:\n"                                                                             \
    "    constants: {k: 400}\n" GAP "    entropy: s\n"                                     \
    "    irreversible: {given: [[creep, s, 0.3]]}\n"                                       \
    "subsystems:\n"                                                                        \
    "  body: {model: body, state: {q: {unit: m, size: 2}, p: {unit: m/s, size: 2}}}\n"     \
    "  gap: {model: gap, state: {x: {unit: m, size: 2}, creep: {unit: m, size: 3},\n"      \
    "                            s: {unit: J/K, size: 1}}}\n"                              \
    "ports:\n"                                                                             \
    "  floor: {law: contact, between: [body, gap], expose: {body: p, gap: " EXPOSED "},\n" \
    "          model: meets}\n"
#define IMAGES                                                                             \
    "    derived:\n"                                                                       \
    "      g: {of: x, matrix: [[0, 1], [0.1, 1], [-0.1, 0.9]], offset: [0.5, 0.6, 0.7]}\n" \
    "      u: {of: [x], size: 3, matrix: [[1, 0], [1, 0], [0.9, 0.1]]}\n"                  \
    "      slope: {of: x, matrix: [[0.2, 0], [0, -0.2], [0.1, 0.1]], offset: [0, 0.02, -0.01]}\n"
#define CONTACT "\"k/2*|min(g + creep + u*slope, 0)|^2\""
#define NZ 10
#define TRAVEL 4 // first component of the gap

static const char bounded[] = SCENE(IMAGES "    energy: [{given: {s: 300}}, " CONTACT "]\n", "x");
// A summand that is zero, but makes the energy depend on x other than through the sums.
static const char unbounded[] =
    SCENE(IMAGES "    energy: [{given: {s: 300}}, " CONTACT ", \"0*x[0]\"]\n", "x");
// Another floor: a derived variable alone, and a wall beside it.
static const char alone[] = SCENE(
    IMAGES "    energy: [{given: {s: 300}}, \"k/2*|min(g,0)|^2\", \"3*|min(g - slope, 0)|^2\"]\n",
    "x");
static const char alone_unbounded[] = SCENE(
    IMAGES "    energy: [{given: {s: 300}}, \"k/2*|min(g,0)|^2\", \"3*|min(g - slope, 0)|^2\",\n"
           "             \"0*x[0]\"]\n",
    "x");
// The derived variables written out, point by point.
static const char written_out[] =
    SCENE("    energy:\n"
          "      - {given: {s: 300}}\n"
          "      - \"k/2*|min(0.5 + x[1] + creep[0] + x[0]*0.2*x[0], 0)|^2\"\n"
          "      - \"k/2*|min(0.6 + 0.1*x[0] + x[1] + creep[1] + x[0]*(0.02 - 0.2*x[1]), 0)|^2\"\n"
          "      - \"k/2*|min(0.7 - 0.1*x[0] + 0.9*x[1] + creep[2]\n"
          "          + (0.9*x[0] + 0.1*x[1])*(0.1*x[0] + 0.1*x[1] - 0.01), 0)|^2\"\n",
          "x");

typedef struct run {
    pm_scene *scene;
    pm_system *system;
    pm_monolithic *assembly;
} run;

static void boundary_input(run *r, const char *text, const char *integrator) {
    *r = (run){0};
    require(pm_scene_parse(&r->scene, text, "floor.yaml"));
    r->scene->physics.integrator = pm_integrator_find(integrator);
    require(pm_system_load(&r->system, r->scene, NULL));
}

static void open_run(run *r, const char *text, const char *integrator, const double *start) {
    boundary_input(r, text, integrator);
    require(pm_monolithic_open(&r->assembly, r->system));
    pm_monolithic_set_state(r->assembly, start);
}

static void close_run(run *r) {
    pm_monolithic_close(r->assembly);
    pm_system_free(r->system);
    pm_scene_free(r->scene);
}

// Draws a start in which the height above the floor agrees with the travel.
static void draw_start(pm_rng *rng, double start[NZ]) {
    memset(start, 0, NZ * sizeof *start);
    for (int i = 0; i < 2; ++i) {
        start[TRAVEL + i] = start[i] = 0.2 * pm_rng_normal(rng);
        start[2 + i] = 1.5 * pm_rng_normal(rng);
    }
}

// --- boxes ---

// Draws 200 points of the box around z, corners and others, checks that all x are positive there,
// and returns the smallest x.
static double smallest_in_box(const pm_contact_broadphase *b, pm_rng *rng, const double z[6],
                              int trial) {
    double smallest = INFINITY;
    for (int point = 0; point < 200; ++point) {
        double at[6];
        for (int c = 0; c < 6; ++c) {
            const double side = pm_rng_uniform(rng) < 0.5 ? -1 : 1;
            at[c] = z[c] + b->width[c] * side * (point < 100 ? 1 : pm_rng_uniform(rng));
        }
        at[5] = z[5];
        const double u = 0.9 * at[0] + 0.1 * at[1];
        const double x[3] = {0.5 + at[1] + at[2] + at[0] * 0.2 * at[0],
                             0.6 + 0.1 * at[0] + at[1] + at[3] + at[0] * (0.02 - 0.2 * at[1]),
                             0.7 - 0.1 * at[0] + 0.9 * at[1] + at[4] +
                                 u * (0.1 * at[0] + 0.1 * at[1] - 0.01)};
        for (int i = 0; i < 3; ++i) {
            if (!(x[i] > 0)) {
                fail_msg("trial %d: x[%d] = %g in a box that should be open", trial, i, x[i]);
            }
            smallest = fmin(smallest, x[i]);
        }
    }
    return smallest;
}

// The boxes of a part whose x are those of the scene above are open, and hold only their states.
static void boxes_are_open(void **state) {
    (void)state;
    run r;
    boundary_input(&r, bounded, "rk4");
    const pm_part *part = r.system->part[1];
    pm_arena arena = {0};
    pm_contact_broadphase b = {0};
    require(pm_contact_broadphase_open(&b, &arena, part));
    assert_non_null(b.unconstrained);
    pm_rng rng;
    pm_rng_init(&rng, 11, 0);
    const double flat[6] = {0};
    int boxes = 0, closed = 0;
    double nearest = INFINITY;
    for (int trial = 0; trial < 2000; ++trial) {
        double z[6], rate[6];
        for (int c = 0; c < 6; ++c) {
            z[c] = (c < 2 ? 0.4 : 0.01) * pm_rng_normal(&rng);
            rate[c] = c < 2 ? pm_rng_normal(&rng) : 0;
        }
        pm_contact_broadphase_forget(&b);
        pm_contact_broadphase_enclose(&b, z, flat, trial % 2 == 0 ? NULL : rate);
        closed += !b.enclosed;
        assert_true(!b.enclosed || pm_contact_broadphase_holds(&b, z, z));
        if (b.enclosed) {
            nearest = fmin(nearest, smallest_in_box(&b, &rng, z, trial));
        }
        boxes += b.enclosed;
        // A state outside, or with another value of a constrained component, is not in the box.
        z[5] += 1e-9;
        double centre[6];
        memcpy(centre, z, sizeof centre);
        centre[5] -= 1e-9;
        assert_false(pm_contact_broadphase_holds(&b, centre, z));
        z[5] = centre[5];
        z[1] -= 1.01 * b.width[1];
        assert_false(b.enclosed && pm_contact_broadphase_holds(&b, centre, z));
    }
    assert_true(boxes > 1500 && closed > 50);
    assert_true(nearest < 0.1); // the boxes reach close to contact
    const double pressed[6] = {0, 1e-3, 0, 0, 0, 300}, origin[6] = {0};
    pm_contact_broadphase_enclose(&b, origin, pressed, NULL);
    assert_false(b.enclosed);
    pm_contact_broadphase_close(&b);
    pm_arena_free(&arena);
    close_run(&r);
}

// Energies of a gap that have a box, and the number of their x.
static void only_sums_are_bounded(void **state) {
    (void)state;
    static const struct {
        const char *energy, *entropy;
        int count;
    } cases[] = {
        {"\"k/2*|min(g,0)|^2\"", "s", 3},
        {"\"|min(g + 0.1, 0)|^2/2\"", "s", 3},
        {"\"-2*3*|min(g - u, 0)|^2\"", "s", 3},
        {"\"|min(g[0],0)|^2\", \"|min(g*u + slope*0.5 - creep, 0)|^2\"", "s", 4},
        {"\"|min(g,0)|^2\", \"|min(creep + 0.1, 0)|^2\", \"0*creep[0]\"", "s",
         3}, // the last is not unconstrained
        {"\"|min(g,0)|^2 + |min(u,0)|^2\"", "s", 0},
        {"\"|min(g,0)|^2.5\"", "s", 0},
        {"\"|min(g/u, 0)|^2\"", "s", 0},
        {"\"|min(g + exp(x[0]), 0)|^2\"", "s", 0},
        {"\"|min(g + ln(x[0] + 3), 0)|^2\"", "s", 0},
        {"\"|min(g + sqrt(x[0] + 3), 0)|^2\"", "s", 0},
        {"\"|min(g + |x|, 0)|^2\"", "s", 0},
        {"\"|min(g + <x,x>, 0)|^2\"", "s", 0},
        {"\"|min(g + |min(u - 1, 0)|^2, 0)|^2\"", "s", 0},
        {"\"|min(g,0)|^2\", \"x[0]\"", "s", 0},
        {"\"|min(g,0)|^2\", {given: {x: 2}}", "s", 0},
        {"\"|min(g,0)|^2\"", "\"s + 0.1*x[1]\"", 0},
        {"\"|min(g,0)|^2\"", "[s, \"0.1*u[1]\"]", 0},
        {"{given: {s: 300}}", "[s, \"|min(g,0)|^2\"]", 3},
#define TWO "\"|min(g,0)|^2\", \"|min(u,0)|^2\", "
        {TWO TWO TWO "\"|min(g,0)|^2\", \"|min(u,0)|^2\"", "s", 24},
        {TWO TWO TWO TWO "\"|min(u,0)|^2\"", "s", 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char text[8192];
        run r;
        snprintf(text, sizeof text,
                 "scene: floor\ntime: {dt: 0.02, steps: 1, integrator: rk4}\n"
                 "models:\n  gap:\n    constants: {k: 400}\n" IMAGES
                 "    energy: [%s]\n    entropy: %s\n"
                 "subsystems:\n  gap: {model: gap, state: {x: {unit: m, size: 2},\n"
                 "        creep: {unit: m, size: 3}, s: {unit: J/K, size: 1}}}\n",
                 cases[i].energy, cases[i].entropy);
        boundary_input(&r, text, "rk4");
        pm_arena arena = {0};
        pm_contact_broadphase b = {0};
        require(pm_contact_broadphase_open(&b, &arena, r.system->part[0]));
        const int count = b.unconstrained == NULL ? 0 : b.n;
        if (count != cases[i].count) {
            fail_msg("energy [%s], entropy %s: %d x, expected %d", cases[i].energy,
                     cases[i].entropy, count, cases[i].count);
        }
        pm_contact_broadphase_close(&b);
        pm_arena_free(&arena);
        close_run(&r);
    }
}

// There is no box if rounding is larger than the opening: adding 2^53 loses everything below 1.
static void rounding_is_in_the_bound(void **state) {
    (void)state;
    static const char *const formulas[] = {
        "|min(g + 9007199254740992 - 9007199254740992, 0)|^2",
        "|min(g*9007199254740992 + 1 - g*9007199254740992, 0)|^2",
        "|min(x + 9007199254740992 - 9007199254740992, 0)|^2",
    };
    for (size_t i = 0; i < sizeof formulas / sizeof *formulas; ++i) {
        char text[1024];
        run r;
        snprintf(text, sizeof text,
                 "scene: floor\ntime: {dt: 0.02, steps: 1, integrator: rk4}\n"
                 "models:\n  gap:\n    derived: {g: {of: x, matrix: [[1], [1]], offset: [3, 3]}}\n"
                 "    energy: [\"%s\"]\n"
                 "subsystems:\n  gap: {model: gap, state: {x: {unit: m, size: 1}}}\n",
                 formulas[i]);
        boundary_input(&r, text, "rk4");
        pm_arena arena = {0};
        pm_contact_broadphase b = {0};
        const double z = 4, flat = 0;
        require(pm_contact_broadphase_open(&b, &arena, r.system->part[0]));
        assert_non_null(b.unconstrained);
        pm_contact_broadphase_forget(&b);
        pm_contact_broadphase_enclose(&b, &z, &flat, NULL);
        assert_false(b.enclosed);
        pm_contact_broadphase_close(&b);
        pm_arena_free(&arena);
        close_run(&r);
    }
}

// --- rollouts ---

#define STEPS 150

// Makes a step with both.
static void step_both(const run r[2], const pm_sample **one, const pm_sample **two) {
    require(pm_monolithic_step(r[0].assembly));
    require(pm_monolithic_step(r[1].assembly));
    *one = pm_monolithic_sample(r[0].assembly);
    *two = pm_monolithic_sample(r[1].assembly);
}

static void check_same_bits(const char *const text[2], const char *integrator, uint64_t seed,
                            long *with, long *without) {
    pm_rng rng;
    run r[2];
    double start[NZ];
    bool touched = false;
    pm_rng_init(&rng, seed, 0);
    draw_start(&rng, start);
    open_run(&r[0], text[0], integrator, start);
    open_run(&r[1], text[1], integrator, start);
    for (int i = 0; i < STEPS; ++i) {
        const pm_sample *one, *two;
        step_both(r, &one, &two);
        for (int c = 0; c < NZ; ++c) {
            if (memcmp(&one->z[c], &two->z[c], sizeof one->z[c]) != 0) {
                fail_msg("%s, seed %llu, step %d: z[%d] = %.17g, without boxes %.17g", integrator,
                         (unsigned long long)seed, i + 1, c, one->z[c], two->z[c]);
            }
        }
        touched = touched || one->flux[0][0].energy_gross > 0;
    }
    if (touched) {
        *with += pm_monolithic_sample(r[0].assembly)->evaluated[1];
        *without += pm_monolithic_sample(r[1].assembly)->evaluated[1];
    }
    close_run(&r[0]);
    close_run(&r[1]);
}

static void boxes_change_no_bit(void **state) {
    (void)state;
    static const char *const integrators[] = {"rk4", "heun", "rk4_balanced", "discrete_gradient",
                                              "rk6"};
    static const char *const texts[2][2] = {{bounded, unbounded}, {alone, alone_unbounded}};
    for (size_t k = 0; k < 2 * sizeof integrators / sizeof *integrators; ++k) {
        const char *const integrator = integrators[k / 2];
        long with = 0, without = 0;
        for (uint64_t seed = 1; seed <= 10; ++seed) {
            check_same_bits(texts[k % 2], integrator, seed, &with, &without);
        }
        if (!(without > 1000 && 5 * with < 4 * without)) {
            fail_msg("%s: %ld terms of the gap evaluated, without boxes %ld", integrator, with,
                     without);
        }
    }
}

// A boundary input may also drive the components of which an x consists. Between f = -0.01 and 0.01
// a step of discrete_gradient has no slope in x, which is closed where it begins.
#define DRIVEN(OTHER)                                                                          \
    "scene: driven\n"                                                                          \
    "time: {dt: 0.02, steps: 1, integrator: discrete_gradient}\n"                              \
    "models:\n"                                                                                \
    "  body: {energy: \"p^2/2 + 80*q^4\", reversible: {given: [[q, p, 1]]}}\n"                 \
    "  meets: {law: contact, matrix: identity}\n"                                              \
    "  gap: {energy: [\"400*|min(x*f + h, 0)|^2\", \"0*f\", \"0*h\"" OTHER "]}\n"              \
    "subsystems:\n"                                                                            \
    "  body: {model: body, state: {q: {unit: m, size: 1}, p: {unit: m/s, size: 1}}}\n"         \
    "  gap: {model: gap, state: {f: {unit: \"1\", size: 1}, h: {unit: m, size: 1},\n"          \
    "                            x: {unit: m, size: 1}}}\n"                                    \
    "boundary_inputs: {hand: {y: {unit: 1/s, dE: [1]}}, other: {w: {unit: m/s, dE: [1]}}}\n"   \
    "ports:\n"                                                                                 \
    "  floor: {law: contact, between: [body, gap], expose: {body: p, gap: x}, model: meets}\n" \
    "  drive: {law: contact, between: [hand, gap], expose: {hand: y, gap: f}, model: meets}\n" \
    "  lift: {law: contact, between: [other, gap], expose: {other: w, gap: h}, model: meets}\n"

static void both_ends_of_a_step_are_in_the_box(void **state) {
    (void)state;
    static const char *const text[2] = {DRIVEN(""), DRIVEN(", \"0*x\"")};
    static const double start[] = {0.5, 1, -0.01, 0, 0.5};
    run r[2];
    pm_arena arena = {0};
    pm_boundary_input boundary_input[2];
    for (int i = 0; i < 2; ++i) {
        open_run(&r[i], text[i], "discrete_gradient", start);
        require(pm_boundary_input_bind(&boundary_input[i], r[i].scene, NULL, 1, &arena));
        pm_monolithic_set_boundary_input(r[i].assembly, &boundary_input[i]);
    }
    for (int step = 0; step < 100; ++step) {
        const pm_sample *one, *two;
        step_both(r, &one, &two);
        for (int port = 0; port < 3; ++port) {
            if (one->flux[port][1].energy != two->flux[port][1].energy) {
                fail_msg("step %d, port %d: %.17g W, without boxes %.17g", step + 1, port,
                         one->flux[port][1].energy, two->flux[port][1].energy);
            }
        }
    }
    close_run(&r[0]);
    close_run(&r[1]);
    pm_arena_free(&arena);
}

// Derived variables give the same energies and states as the expressions written out.
static void derived_variables_equal_their_expressions(void **state) {
    (void)state;
    static const char *const integrators[] = {"rk4", "discrete_gradient"};
    for (int k = 0; k < 2; ++k) {
        pm_rng rng;
        run r[2];
        double start[NZ], largest = 0;
        pm_rng_init(&rng, 7, 0);
        draw_start(&rng, start);
        start[3] = -4; // down
        open_run(&r[0], bounded, integrators[k], start);
        open_run(&r[1], written_out, integrators[k], start);
        for (int i = 0; i < STEPS; ++i) {
            const pm_sample *one, *two;
            step_both(r, &one, &two);
            for (int c = 0; c < NZ; ++c) {
                if (!(fabs(one->z[c] - two->z[c]) <= 1e-10)) {
                    fail_msg("%s, step %d: z[%d] = %.17g, written out %.17g", integrators[k], i + 1,
                             c, one->z[c], two->z[c]);
                }
            }
            largest = fmax(largest, one->energy[1] - 300 * one->z[NZ - 1]);
        }
        assert_true(largest > 0.1); // the contact is closed
        close_run(&r[0]);
        close_run(&r[1]);
    }
}

// A run that continues from a checkpoint counts evaluations like a run without interruption.
static void returns_count_alike(void **state) {
    (void)state;
    static const char *const integrators[] = {"rk4", "rk4_balanced", "discrete_gradient"};
    for (int k = 0; k < 3; ++k) {
        run r;
        // The body does not move at first, which the run may know one step earlier or later.
        double start[NZ] = {0, 0, 0, 0, 0.3, 0.2};
        boundary_input(&r, bounded, integrators[k]);
        divided kept, returned;
        divided_open(&kept, r.system, 0, NULL);
        divided_set_state(&kept, start);
        for (int step = 0; step < 40; ++step) {
            if (step == 5) { // a push
                const double pushed[NZ] = {0.3, 0.2, 0, 1};
                pm_local_subsystems_set_state(kept.local[0], pushed);
            }
            divided_return(&returned, &kept);
            require(divided_step(&kept));
            require(divided_step(&returned));
            for (int i = 0; i < 2; ++i) {
                const pm_books one = pm_local_subsystems_books(kept.local[i], 0);
                const pm_books two = pm_local_subsystems_books(returned.local[i], 0);
                if (one.evaluated != two.evaluated || one.skipped != two.skipped) {
                    fail_msg("%s, step %d, subsystem %d: %ld evaluated, %ld skipped, expected %ld, "
                             "%ld",
                             integrators[k], step + 1, i, two.evaluated, two.skipped, one.evaluated,
                             one.skipped);
                }
            }
            divided_close(&returned);
        }
        divided_close(&kept);
        close_run(&r);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_are_open),
        cmocka_unit_test(only_sums_are_bounded),
        cmocka_unit_test(rounding_is_in_the_bound),
        cmocka_unit_test(boxes_change_no_bit),
        cmocka_unit_test(both_ends_of_a_step_are_in_the_box),
        cmocka_unit_test(derived_variables_equal_their_expressions),
        cmocka_unit_test(returns_count_alike),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

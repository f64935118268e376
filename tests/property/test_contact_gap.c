// Gaps beside solids (sim/contact_gap.h): between random linear bodies, which a gap is up to 10^4
// times as stiff as, the iteration finds the state at which bodies and gap agree in 99 % of all
// steps; energy is conserved and the heat is never negative, whatever the gap's energy.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "sim/contact_gap.h"
#include "tests/support/unit.h"

#define N 12 // pairs of points
#define STIFFNESS 1e6
#define MOST_ROUNDS 50

// A gap, and the one body at its other end with the compliance C: its travel is free - C e.
typedef struct contact {
    pm_scene scene;
    pm_scene_subsystem subsystem[2];
    pm_scene_port port;
    int component[N];
    pm_system system;
    pm_solid_spec solid;
    pm_part body, gap, *part[2];
    pm_group group[2];
    pm_arena arena;
    pm_program *program;
    pm_contact_gap opened;
    double C[N][N], free[N];
    double z[N + 1], stage[N + 1];
} contact;

static const char *const constant[] = {"k"}, *const entropy[] = {"s"};
static const double stiffness = STIFFNESS, temperature = 300;
static const pm_constants constants = {.count = 1, .name = constant, .value = &stiffness};
static const pm_formula convex = {"k/2*|min(g,0)|^2", &constants, NULL};
static const pm_formula two_wells = {"k/4*|g|^4 - k/2*|g|^2", &constants, NULL};

// The gap's energy, whose s may have no temperature.
static void declare_gap(contact *c, const pm_formula *formula, bool heats) {
    c->gap = (pm_part){.layout = {.group = c->group}};
    pm_layout_add(&c->gap.layout, "g", "m", N);
    pm_layout_add(&c->gap.layout, "s", "J/K", 1);
    c->gap.spec = (pm_part_spec){.form = PM_HARD,
                                 .constants = &constants,
                                 .energy = {.nformula = 1,
                                            .formula = formula,
                                            .ngiven = heats,
                                            .given = entropy,
                                            .given_coefficient = &temperature},
                                 .entropy = {.ngiven = 1, .given = entropy}};
    assert_int_equal(pm_part_declare(&c->gap), PM_OK);
}

// Opens the program of the gap's energy and its gradient.
static pm_status open_program(contact *c) {
    pm_graph *g = NULL;
    pm_node output[2], dS;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, N + 1);
    output[0] = pm_part_energy(g, &c->gap, z);
    pm_part_coenergies(g, &c->gap, PM_NO_NODE, z, &output[1], &dS);
    const pm_status status = pm_program_open(&c->program, g, 2, output, 1);
    if (status == PM_OK) {
        pm_contact_gap_set_program(&c->opened, c->program, pm_program_value(c->program, z),
                                   pm_program_value(c->program, output[0]),
                                   pm_program_value(c->program, output[1]));
    }
    pm_graph_close(g);
    return status;
}

static pm_status open_contact(contact *c, const pm_formula *formula, bool heats) {
    memset(c, 0, sizeof *c);
    declare_gap(c, formula, heats);
    c->body.spec.solid = &c->solid;
    c->part[0] = &c->body;
    c->part[1] = &c->gap;
    for (int i = 0; i < N; ++i) {
        c->component[i] = i;
    }
    c->subsystem[1] = (pm_scene_subsystem){.name = "gap", .at = "here"};
    c->port = (pm_scene_port){.law = "contact", .subsystem = {0, 1}, .boundary_input = {-1, -1}};
    c->port.layout[1] = (pm_layout){1, c->group, N};
    c->port.component[1] = c->component;
    c->scene.physics.nsubsystem = 2;
    c->scene.physics.subsystem = c->subsystem;
    c->scene.physics.nport = 1;
    c->scene.physics.port = &c->port;
    c->system = (pm_system){.scene = &c->scene, .part = c->part};
    PM_TRY(pm_contact_gap_open(&c->opened, &c->arena, &c->system, 1));
    return open_program(c);
}

static void close_contact(contact *c) {
    pm_program_close(c->program);
    pm_part_free(&c->gap);
    pm_arena_free(&c->arena);
}

// Draws a body that bends as a whole and gives way at each point, and a gap that is open or closed.
static void draw(contact *c, pm_rng *rng) {
    const double local = pow(10, 2 * pm_rng_uniform(rng)) / STIFFNESS;
    memset(c->C, 0, sizeof c->C);
    for (int mode = 0; mode < 3; ++mode) {
        const double size = pow(10, 4 * pm_rng_uniform(rng)) / STIFFNESS;
        double shape[N];
        for (int i = 0; i < N; ++i) {
            shape[i] = pm_rng_normal(rng);
        }
        for (int i = 0; i < N * N; ++i) {
            c->C[i / N][i % N] += size / N * shape[i / N] * shape[i % N];
        }
    }
    for (int i = 0; i < N; ++i) {
        c->C[i][i] += local;
        c->z[i] = 0.1 * pm_rng_normal(rng);
        c->z[i] = c->z[i] < 0 ? 1e-4 * c->z[i] : c->z[i];
    }
    c->z[N] = 0;
}

// Takes the rounds of a step, in which the body answers the forces that it saw the round before.
// Returns the number of rounds until the gap has its final state.
static int step(contact *c) {
    pm_contact_gap *gap = &c->opened;
    double answer[N];
    memcpy(c->stage, c->z, sizeof c->z);
    pm_contact_gap_begin(&c->opened, c->z);
    memcpy(answer, c->z, sizeof answer);
    for (int round = 0; round < MOST_ROUNDS; ++round) {
        double reached[N + 1] = {0}, next[N + 1];
        pm_contact_gap_expose(&c->opened, c->stage);
        memcpy(reached, answer, sizeof answer);
        for (int i = 0; i < N; ++i) {
            answer[i] = c->free[i];
            for (int k = 0; k < N; ++k) {
                answer[i] -= c->C[i][k] * (gap->response[k]);
            }
        }
        pm_contact_gap_next(gap, c->stage, reached, next);
        const double change = memcmp(next, c->stage, sizeof next) == 0 ? 0 : 1;
        memcpy(c->stage, next, sizeof next);
        if (pm_contact_gap_change(gap, change) == 0) {
            return round;
        }
    }
    return MOST_ROUNDS;
}

static double stored(const double *z) {
    double sum = 0;
    for (int i = 0; i < N; ++i) {
        sum += STIFFNESS / 2 * pow(fmin(z[i], 0), 2);
    }
    return sum;
}

// The forces that the body has answered are those of the gap where the body is.
static void check_agreement(const contact *c) {
    const pm_contact_gap *gap = &c->opened;
    double largest = 0;
    for (int i = 0; i < N; ++i) {
        largest = fmax(largest, fabs(STIFFNESS * fmin(c->stage[i], 0)));
    }
    for (int i = 0; i < N; ++i) {
        const double shown = gap->response[i];
        assert_true(fabs(shown - STIFFNESS * fmin(c->stage[i], 0)) <= 2e-4 * largest + 1e-3);
    }
}

// What the ports bring in is stored or becomes heat.
static void check_laws(const contact *c) {
    const pm_contact_gap *gap = &c->opened;
    double work = 0, gross = 0;
    for (int i = 0; i < N; ++i) {
        work += gap->dE[i] * (c->stage[i] - c->z[i]);
        gross += fabs(gap->dE[i] * (c->stage[i] - c->z[i]));
    }
    const double heat = temperature * (c->stage[N] - c->z[N]);
    assert_true(heat >= 0);
    assert_true(fabs(stored(c->stage) - stored(c->z) + heat - work) <=
                1e-12 * (gross + stored(c->z)) + 1e-15);
}

static void bodies_and_gap_agree(void **state) {
    (void)state;
    int touching = 0, heated = 0, missed = 0;
    for (uint64_t seed = 1; seed <= 200; ++seed) {
        contact c;
        pm_rng rng;
        assert_int_equal(open_contact(&c, &convex, true), PM_OK);
        pm_rng_init(&rng, seed, 0);
        draw(&c, &rng);
        for (int k = 0; k < 6; ++k) { // pressed ever deeper, then let go
            for (int i = 0; i < N; ++i) {
                c.free[i] = 0.1 * pm_rng_normal(&rng) + (k < 4 ? -0.05 * k : 0.05);
            }
            if (step(&c) == MOST_ROUNDS) {
                ++missed;
            } else {
                check_agreement(&c);
                check_laws(&c);
            }
            touching += stored(c.stage) > 0;
            heated += c.stage[N] > c.z[N];
            memcpy(c.z, c.stage, sizeof c.z);
        }
        close_contact(&c);
    }
    assert_true(touching > 600 && heated > 300);
    if (missed > 12) {
        fail_msg("no agreement in %d of 1200 steps", missed);
    }
}

// The laws hold for an energy with two wells: from any state to any other one the gap takes in
// what it stores and what becomes heat. The heat is not negative, and the forces are weighted sums
// of those at both ends.
static void laws_need_no_convex_energy(void **state) {
    (void)state;
    int without_heat = 0;
    contact c;
    pm_rng rng;
    assert_int_equal(open_contact(&c, &two_wells, true), PM_OK);
    pm_rng_init(&rng, 5, 0);
    for (int k = 0; k < 1000; ++k) {
        const pm_contact_gap *gap = &c.opened;
        double work = 0, gross = 0;
        for (int i = 0; i < N; ++i) {
            c.z[i] = 0.2 * pm_rng_normal(&rng); // between the wells, where the energy is concave
            c.stage[i] = 0.2 * pm_rng_normal(&rng);
        }
        c.z[N] = c.stage[N] = 0;
        pm_contact_gap_begin(&c.opened, c.z);
        pm_contact_gap_expose(&c.opened, c.z);
        const double before = gap->E;
        pm_contact_gap_expose(&c.opened, c.stage);
        for (int i = 0; i < N; ++i) {
            work += gap->dE[i] * (c.stage[i] - c.z[i]);
            gross += fabs(gap->dE[i] * (c.stage[i] - c.z[i]));
        }
        without_heat += gap->heat <= 1e-12 * gross;
        if (!(gap->heat >= 0) || !(fabs(gap->E - before + gap->heat - work) <= 1e-12 * gross)) {
            fail_msg("motion %d: stored %g J, heat %g J, work %g J", k, gap->E - before, gap->heat,
                     work);
        }
    }
    if (without_heat <= 100 || without_heat >= 900) {
        fail_msg("%d of 1000 motions without heat", without_heat);
    }
    close_contact(&c);
}

static void a_gap_without_heat_is_refused(void **state) {
    (void)state;
    contact c;
    assert_int_equal(open_contact(&c, &convex, false), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "entropy s that takes up heat"));
    close_contact(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bodies_and_gap_agree),
        cmocka_unit_test(laws_need_no_convex_energy),
        cmocka_unit_test(a_gap_without_heat_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// States that hold co-energies: they move as the same system in energy variables does, their books
// balance, the trainer takes the same steps, and all divisions of a scene have the same bits.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/linalg.h"
#include "graph/program.h"
#include "model/part.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "sim/step_graph.h"
#include "tests/support/divided.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

// --- a pendulum that heats itself and two bodies ---

// Both scenes have the same subsystems in the same order: the state of a pendulum is its angle, its
// angular momentum or velocity, and its entropy or temperature; that of `bodies` two entropies or
// temperatures. The inertia of the pendulum depends on its angle.
#define TIME "time: {dt: 0.05, steps: 40, integrator: rk6, substeps: 16}\n"
#define CONSTANTS "constants: {m: 0.8, g: 9.81, c: 0.5, b: 0.2}, "
static const char in_energy_variables[] =
    "scene: momenta\n" TIME "models:\n"
    "  arm: {" CONSTANTS
    "energy: ['p^2/(2*m*(1+0.3*cos(q)))', 'm*g*(1-cos(q))', 'c*300*exp(s/c)'],\n"
    "    entropy: {given: s}, reversible: {given: [[q, p, 1.0]]},\n"
    "    irreversible: {given: [[p, s, 'b*dE.s']]}}\n"
    "  two: {energy: ['2*300*exp(s[0]/2)', '2*300*exp(s[1]/2)'], entropy: {given: s}}\n"
    "  wall: {law: bracket, irreversible: {given: [\n"
    "    ['a.s', 'b.s[0]', '4*b.dE.s[0]/a.dE.s'], ['a.s', 'b.s[1]', '9*b.dE.s[1]/a.dE.s']]}}\n"
    "subsystems:\n"
    "  arm: {model: arm, state: {q: {unit: rad, size: 1}, p: {unit: J s, size: 1},\n"
    "    s: {unit: J/K, size: 1}}}\n"
    "  bodies: {model: two, state: {s: {unit: J/K, size: 2}}}\n"
    "ports: {wall: {law: bracket, model: wall, between: [arm, bodies],\n"
    "  expose: {arm: s, bodies: s}}}\n";
static const char in_coenergies[] =
    "scene: velocities\n" TIME "models:\n"
    "  arm: {" CONSTANTS "coenergy: ['m/2*(1+0.3*cos(q))*v^2', 'c*(T*ln(T/300)-T)'],\n"
    "    energy: 'm*g*(1-cos(q))', entropy: {given: T}, reversible: {given: [[q, v, 1.0]]},\n"
    "    irreversible: {given: [[v, T, 'b*dE.T']]}}\n"
    "  two: {coenergy: {capacity: {of: T, first: 2.0}}, entropy: {given: T}}\n"
    "  wall: {law: bracket, irreversible: {given: [\n"
    "    ['a.T', 'b.T[0]', '4*b.dE.T[0]/a.dE.T'], ['a.T', 'b.T[1]', '9*b.T[1]/a.T']]}}\n"
    "subsystems:\n"
    "  arm: {model: arm, state: {q: {unit: rad, size: 1},\n"
    "    v: {unit: rad/s, size: 1, coenergy: true}, T: {unit: K, size: 1, coenergy: true}}}\n"
    "  bodies: {model: two, state: {T: {unit: K, size: 2, coenergy: true}}}\n"
    "ports: {wall: {law: bracket, model: wall, between: [arm, bodies],\n"
    "  expose: {arm: T, bodies: T}}}\n";
#define NZ 5
static const double shown[NZ] = {2.0, -1.5, 310, 285, 301};

typedef struct subject {
    pm_scene *scene;
    pm_system *system;
    pm_monolithic *simulation;
    pm_ledger ledger;
} subject;

static void open_subject(subject *s, const char *text, const double *z) {
    *s = (subject){0};
    require(pm_scene_parse(&s->scene, text, "scene.yaml"));
    require(pm_system_load(&s->system, s->scene, NULL));
    require(pm_monolithic_open(&s->simulation, s->system));
    pm_monolithic_set_state(s->simulation, z);
    pm_ledger_init(&s->ledger, s->system);
}

static void close_subject(subject *s) {
    pm_monolithic_close(s->simulation);
    pm_system_free(s->system);
    pm_scene_free(s->scene);
}

static void book(subject *s) {
    pm_sample sample = *pm_monolithic_sample(s->simulation);
    require(pm_ledger_add_sample(&s->ledger, &sample));
}

// Computes the state in energy variables.
static void to_energy_variables(const double *y, double *x) {
    x[0] = y[0];
    x[1] = 0.8 * (1 + 0.3 * cos(y[0])) * y[1];
    x[2] = 0.5 * log(y[2] / 300);
    x[3] = 2 * log(y[3] / 300);
    x[4] = 2 * log(y[4] / 300);
}

static void both_kinds_of_variables_move_alike(void **state) {
    (void)state;
    subject momenta, velocities;
    double x[NZ];
    to_energy_variables(shown, x);
    open_subject(&momenta, in_energy_variables, x);
    open_subject(&velocities, in_coenergies, shown);
    assert_int_equal(velocities.scene->physics.subsystem[0].layout.group[2].role, PM_ROLE_ENTROPY);
    book(&momenta);
    book(&velocities);
    const double energy = velocities.ledger.energy;
    for (int step = 0; step < 40; ++step) {
        require(pm_monolithic_step(momenta.simulation));
        require(pm_monolithic_step(velocities.simulation));
        book(&momenta);
        book(&velocities);
        const pm_sample *a = pm_monolithic_sample(momenta.simulation);
        const pm_sample *b = pm_monolithic_sample(velocities.simulation);
        to_energy_variables(b->z, x);
        for (int i = 0; i < NZ; ++i) {
            assert_near("state", x[i], a->z[i], 1e-9);
        }
        for (int end = 0; end < 2; ++end) {
            assert_near("energy flux", b->flux[0][end].energy, a->flux[0][end].energy, 1e-7);
            assert_near("entropy flux", b->flux[0][end].entropy, a->flux[0][end].entropy, 1e-9);
        }
        for (int i = 0; i < 2; ++i) {
            assert_near("energy", b->energy[i], a->energy[i], 1e-7);
            assert_near("entropy", b->entropy[i], a->entropy[i], 1e-9);
        }
    }
    // Both laws: no port loses energy, the drift is the error of the method alone.
    assert_near("energy residual", velocities.ledger.worst_energy, 0, 1e-14);
    assert_near("entropy residual", velocities.ledger.worst_entropy, 0, 1e-14);
    assert_near("total energy", velocities.ledger.energy, energy, 1e-8 * energy);
    assert_true(velocities.ledger.violations == 0);
    assert_true(fabs(pm_monolithic_sample(velocities.simulation)->z[1] - shown[1]) > 0.1);
    close_subject(&momenta);
    close_subject(&velocities);
}

// --- random models ---

// Three velocities share an inertia that depends on angles; two temperatures have capacities of
// their own. A formula couples a velocity with a temperature and a position.
static const char scene_text[] =
    "scene: shown\n"
    "time: {dt: 0.02, steps: 20, integrator: rk4, substeps: 2}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {q: {unit: rad, size: 2}, v: {unit: rad/s, size: 2, coenergy: "
    "true}, u: {unit: m/s, size: 1, coenergy: true}, T: {unit: K, size: 2, coenergy: true}, s: "
    "{unit: J/K, size: 1}}}\n"
    "  b: {weights: b.h5, state: {q: {unit: rad, size: 2}, v: {unit: rad/s, size: 2, coenergy: "
    "true}, u: {unit: m/s, size: 1, coenergy: true}, T: {unit: K, size: 2, coenergy: true}, s: "
    "{unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: [q, v, T], b: [v, u, "
    "T]}}\n";
static const char part_text[] =
    "coenergy:\n"
    "  - {inertia: {of: [v, u], features: [\"sin(q)\", \"cos(q)\"], hidden: [4]}}\n"
    "  - {capacity: {of: T, terms: 5}}\n"
    "  - \"u^2*(3+sin(q[0]))+0.01*u^4+0.001*T[0]*u+0.002*T[0]^2\"\n"
    "energy: [{features: [\"sin(q)\", \"cos(q)\"], hidden: [5], skip: quadratic}, \"300*exp(s)\"]\n"
    "entropy: [{given: [T, s]}]\n"
    "reversible:\n"
    "  given: [[q, v, 1.0]]\n"
    "  learned: {acts_on: [v, u], features: [v], hidden: [3]}\n"
    "irreversible: {learned: {acts_on: [v, u, T], heats: [T, s], rank: 2}}\n";
static const char port_text[] =
    "law: bracket\n"
    "reversible: {learned: {acts_on: [a.v, b.v], features: [\"sin(a.q)\"], hidden: [3]}}\n"
    "irreversible: {learned: {acts_on: [a.v, b.u, a.T, b.T], heats: [a.T, b.T], rank: 2,\n"
    "  strength: {features: [a.T, \"|b.v|\"], hidden: [3]}}}\n";
#define SHOWN_NZ 8

// Draws a system with weights of a fair size, and temperatures around 300 K.
static void open_random(random_system *w, uint64_t seed) {
    random_system_of_text(w, seed, scene_text, part_text, port_text);
    for (int k = 0; k < pm_system_components(w->system); ++k) {
        const pm_params *params = pm_system_params(w->system, k);
        for (int i = 0; i < params->count; ++i) {
            const pm_param_entry *entry = &params->entry[i];
            const bool capacity = strncmp(entry->name, "coenergy.capacity", 17) == 0;
            const bool mean = capacity && strstr(entry->name, "mean") != NULL;
            const bool deviation = capacity && strstr(entry->name, "deviation") != NULL;
            for (int j = 0; j < entry->rows * entry->cols; ++j) {
                entry->value[j] = mean              ? 300
                                  : deviation       ? 20 + 10 * pm_rng_uniform(&w->rng)
                                  : !entry->trained ? 1
                                                    : entry->value[j] * 0.3;
            }
        }
    }
    for (int i = 0; i < 2; ++i) {
        double *z = w->z + i * SHOWN_NZ;
        z[5] = 300 + 15 * z[5];
        z[6] = 300 + 15 * z[6];
        z[7] *= 0.1;
    }
}

// Returns a . b over n numbers, and adds the magnitudes of its terms to *gross.
static double dot(int n, const double *a, const double *b, double *gross) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
        *gross += fabs(a[i] * b[i]);
    }
    return sum;
}

// --- convex terms ---

// Opens a part of three groups and computes the energy variables x and, for each component of x,
// the derivative by its co-energy.
static void evaluate_part(const char *state, const char *model, const double *parameter,
                          const double *z, int nz, double *x, double *slope) {
    char text[1024];
    pm_graph *g = NULL;
    pm_program *program = NULL;
    random_system w;
    snprintf(text, sizeof text,
             "scene: convex\ntime: {dt: 1.0, steps: 1, integrator: rk4}\n"
             "subsystems: {a: {weights: a.h5, state: {%s}}}\n",
             state);
    random_system_of_text(&w, 1, text, model, NULL);
    pm_part *part = w.system->part[0];
    for (int i = 0; i < part->params.count; ++i) {
        for (int j = 0; j < part->params.entry[i].rows * part->params.entry[i].cols; ++j) {
            part->params.entry[i].value[j] = *parameter++;
        }
    }
    require(pm_graph_open(&g));
    const pm_node input = pm_input(g, true, 1, nz);
    pm_node output[2] = {pm_part_energy_variables(g, part, input), PM_NO_NODE};
    for (int c = 0; c < nz; ++c) {
        pm_node row;
        pm_gradient(g, pm_slice(g, output[0], c, 1), PM_NO_NODE, 1, &input, &row);
        output[1] = pm_concat_or(g, output[1], pm_slice(g, row, c, 1));
    }
    require(pm_program_open(&program, g, 2, output, 1));
    memcpy(pm_program_value(program, input), z, (size_t)nz * sizeof *z);
    pm_program_run(program, 1);
    memcpy(x, pm_program_value(program, output[0]), (size_t)nz * sizeof *x);
    memcpy(slope, pm_program_value(program, output[1]), (size_t)nz * sizeof *slope);
    pm_program_close(program);
    pm_graph_close(g);
    random_system_close(&w);
}

static void capacities_and_inertias_are_as_the_pages_say(void **state) {
    (void)state;
    // mean, deviation, and the logarithms of the first capacity and of the other weights
    static const double capacity[] = {310, 250, 20, 9, 1.4, 1.1, 0.5, -1, 0.2, 1, 2, -0.3, 0.7, -2};
    const double T[2] = {275, 400};
    double x[3], slope[3];
    evaluate_part("T: {unit: K, size: 2, coenergy: true}",
                  "coenergy: {capacity: {of: T, terms: 5}}\nentropy: {given: T}\n", capacity, T, 2,
                  x, slope);
    for (int c = 0; c < 2; ++c) {
        const double r = T[c] / capacity[c];
        const double f[5] = {1, r, 2 * r / (1 + r), 1 / (r * r), r * r};
        double sum = f[0], weights = 1;
        for (int k = 1; k < 5; ++k) {
            const double weight = exp(capacity[4 + 2 * k + c]);
            sum += weight * f[k];
            weights += weight;
        }
        const double expected = exp(capacity[4 + c]) * sum / weights;
        assert_near("heat capacity T ds/dT", T[c] * slope[c], expected, 1e-13 * expected);
    }
    // typical lengths of both groups, and the entries of A below the known first one
    static const double inertia[] = {2, 5, 0.3, 0.4, -0.4, 0.6, -0.35};
    const double y[3] = {0.8, -1.1, 2.3};
    evaluate_part(
        "v: {unit: m/s, size: 2, coenergy: true}, u: {unit: rad/s, size: 1, coenergy: true}",
        "coenergy: {inertia: {of: [v, u], first: 9.0}}\n", inertia, y, 3, x, slope);
    const double A[3][3] = {
        {6.0 / 2, 0, 0}, {0.3 / 2, exp(0.4) / 2, 0}, {-0.4 / 5, 0.6 / 5, exp(-0.35) / 5}};
    for (int i = 0; i < 3; ++i) {
        double momentum = 0, own = 0;
        for (int k = 0; k < 3; ++k) {
            own += A[i][k] * A[i][k];
            for (int j = 0; j < 3; ++j) {
                momentum += A[i][k] * A[j][k] * y[j];
            }
        }
        assert_near("momentum", x[i], momentum, 1e-13);
        assert_near("inertia", slope[i], own, 1e-13);
    }
}

// Released rates of the state change energy, entropy and energy variables as the inner rates do.
static void release_keeps_all_rates(void **state) {
    (void)state;
    enum { E_Z, S_Z, X_Z, DE, DS, ZDOT, COUNT };
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        random_system w;
        pm_graph *g = NULL;
        pm_program *program = NULL;
        double weight[SHOWN_NZ], inner[SHOWN_NZ];
        open_random(&w, seed);
        const pm_part *part = w.system->part[0];
        require(pm_graph_open(&g));
        const pm_node z = pm_input(g, true, 1, SHOWN_NZ), xdot = pm_input(g, true, 1, SHOWN_NZ);
        const pm_node direction = pm_input(g, true, 1, SHOWN_NZ);
        const pm_node x = pm_part_energy_variables(g, part, z);
        pm_node output[COUNT];
        pm_gradient(g, pm_part_energy(g, part, z), PM_NO_NODE, 1, &z, &output[E_Z]);
        pm_gradient(g, pm_part_entropy(g, part, z), PM_NO_NODE, 1, &z, &output[S_Z]);
        pm_gradient(g, x, direction, 1, &z, &output[X_Z]);
        pm_part_coenergies(g, part, PM_NO_NODE, z, &output[DE], &output[DS]);
        output[ZDOT] = pm_part_release(g, part, z, xdot);
        require(pm_program_open(&program, g, COUNT, output, 1));
        for (int i = 0; i < SHOWN_NZ; ++i) {
            pm_program_value(program, z)[i] = w.z[i];
            inner[i] = pm_program_value(program, xdot)[i] = pm_rng_normal(&w.rng);
            weight[i] = pm_program_value(program, direction)[i] = pm_rng_normal(&w.rng);
        }
        pm_program_run(program, 1);
        const double *value[COUNT];
        for (int i = 0; i < COUNT; ++i) {
            value[i] = pm_program_value(program, output[i]);
        }
        const double *by_inner[] = {value[DE], value[DS], weight};
        for (int i = 0; i < 3; ++i) {
            double gross = 0;
            const double shown_rate = dot(SHOWN_NZ, value[E_Z + i], value[ZDOT], &gross);
            const double inner_rate = dot(SHOWN_NZ, by_inner[i], inner, &gross);
            random_system_check(&w, "rate", shown_rate, inner_rate, 1e-12 * gross);
        }
        assert_true(memcmp(value[ZDOT] + 2, inner + 2, 5 * sizeof *inner) != 0);
        pm_program_close(program);
        pm_graph_close(g);
        random_system_close(&w);
    }
}

// The trainer's step graph releases rates as the engine does, and the ports' books balance.
static void trainer_takes_the_same_step(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 5; ++seed) {
        random_system w;
        pm_graph *g = NULL;
        pm_program *program = NULL;
        pm_monolithic *simulation = NULL;
        pm_arena arena = {0};
        pm_node part[2], degeneracy = PM_NO_NODE;
        pm_ledger ledger;
        open_random(&w, seed);
        const pm_physics *physics = &w.scene->physics;
        require(pm_monolithic_open(&simulation, w.system));
        pm_monolithic_set_state(simulation, w.z);
        pm_ledger_init(&ledger, w.system);
        pm_sample sample = *pm_monolithic_sample(simulation);
        require(pm_ledger_add_sample(&ledger, &sample));
        require(pm_monolithic_step(simulation));
        sample = *pm_monolithic_sample(simulation);
        require(pm_ledger_add_sample(&ledger, &sample));
        random_system_check(&w, "energy residual", ledger.worst_energy, 0, 1e-13);
        random_system_check(&w, "entropy residual", ledger.worst_entropy, 0, 1e-13);
        const pm_step_work work = pm_step_work_new(w.system, &arena);
        require(pm_graph_open(&g));
        const pm_node input = pm_input(g, true, 1, physics->nz);
        for (int i = 0; i < 2; ++i) {
            part[i] = pm_slice(g, input, i * SHOWN_NZ, SHOWN_NZ);
        }
        pm_build_step(g, w.system, physics->integrator, physics->dt / physics->substeps,
                      physics->substeps, part, PM_NO_NODE, &degeneracy, &work);
        const pm_node output = pm_concat(g, 2, part);
        require(pm_program_open(&program, g, 1, &output, 1));
        memcpy(pm_program_value(program, input), w.z, (size_t)physics->nz * sizeof *w.z);
        pm_program_run(program, 1);
        for (int i = 0; i < physics->nz; ++i) {
            const double served = pm_monolithic_sample(simulation)->z[i];
            random_system_check(&w, "z after a step", pm_program_value(program, output)[i], served,
                                1e-12 * (fabs(served) + 1));
        }
        assert_true(fabs(pm_program_value(program, output)[2] - w.z[2]) > 1e-6);
        pm_program_close(program);
        pm_graph_close(g);
        pm_arena_free(&arena);
        pm_monolithic_close(simulation);
        random_system_close(&w);
    }
}

// The rates of the state are those of the energy variables if all inertias are 1.
static void nothing_is_released_where_inertias_are_one(void **state) {
    (void)state;
    static const char text[] =
        "scene: free\ntime: {dt: 1.0, steps: 1, integrator: rk4}\n"
        "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 1}, v: {unit: m/s, size: 1, "
        "coenergy: true}, u: {unit: m/s, size: 1, coenergy: true}}}}\n";
    static const struct {
        const char *model;
        bool same;
    } cases[] = {{"coenergy: [\"v^2/2\", \"u^2/2\"]\nenergy: q^2\n", true},
                 {"coenergy: [\"v^2/2\", \"u^2\"]\nenergy: q^2\n", false},
                 {"coenergy: [\"v^2/2\", \"u^2/2\", \"0.1*u*v\"]\nenergy: q^2\n", false},
                 {"coenergy: [\"v^2/2\", \"u^2/2+u*q\"]\nenergy: q^2\n", false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        random_system w;
        pm_graph *g = NULL;
        random_system_of_text(&w, 1, text, cases[i].model, NULL);
        require(pm_graph_open(&g));
        const pm_node z = pm_input(g, true, 1, 3), rate = pm_input(g, true, 1, 3);
        const bool same = pm_part_release(g, w.system->part[0], z, rate) == rate;
        if (same != cases[i].same) {
            random_system_fail(&w, "released rates are %s", same ? "the same" : "others");
        }
        pm_graph_close(g);
        random_system_close(&w);
    }
}

// --- directions ---

// A reaction A + B = C and the friction between an orbit and a spin.
static const char directed[] =
    "scene: directed\ntime: {dt: 0.01, steps: 100, integrator: rk6, substeps: 4}\nmodels:\n"
    "  vessel: {coenergy: ['2*(T*ln(T/300)-T)', '0.4*T*a', '-0.2*T*c*c'],\n"
    "    energy: ['3*a^2', '40*b', '9*c^2'], entropy: {given: T}, irreversible: {given: [\n"
    "    [{a: 1, b: 1, c: -1}, T, '0.3*a*T']]}}\n"
    "  moon: {energy: ['|p|^2/4', '-5/|q|', 'L^2', '2*300*exp(s/2)'], entropy: {given: s},\n"
    "    reversible: {given: [[q, p, 1.0]]}, irreversible: {given: [\n"
    "    [{'p[0]': '-q[1]/|q|^2', 'p[1]': 'q[0]/|q|^2', L: -1}, s, '0.2/|q|^4*dE.s']]}}\n"
    "subsystems:\n"
    "  vessel: {model: vessel, state: {a: {unit: mol, size: 1}, b: {unit: mol, size: 1},\n"
    "    c: {unit: mol, size: 1}, T: {unit: K, size: 1, coenergy: true}}}\n"
    "  moon: {model: moon, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2},\n"
    "    L: {unit: J s, size: 1}, s: {unit: J/K, size: 1}}}\n";

static double total(const double *x, int n) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += x[i];
    }
    return sum;
}

static void directions_obey_both_laws(void **state) {
    (void)state;
    const double z[] = {2.0, 1.5, 0.5, 290.0, 1.0, 0.2, -0.4, 2.5, 3.0, 0.1};
    subject s;
    open_subject(&s, directed, z);
    const pm_sample *sample = NULL;
    double energy = NAN, entropy = NAN;
    for (int step = 0; step < 100; ++step) {
        require(pm_monolithic_step(s.simulation));
        sample = pm_monolithic_sample(s.simulation);
        const double e = total(sample->energy, 2), S = total(sample->entropy, 2);
        assert_true(step == 0 || fabs(e - energy) < 1e-9 * fabs(energy));
        assert_true(step == 0 || S >= entropy);
        energy = e, entropy = S;
    }
    const double *now = sample->z;
    // The atoms and the angular momentum stay; the reaction and the friction do not.
    assert_true(fabs(now[0] + now[2] - (z[0] + z[2])) < 1e-12);
    assert_true(fabs(now[1] + now[2] - (z[1] + z[2])) < 1e-12);
    assert_true(fabs(now[0] - z[0]) > 1e-2);
    const double before = z[4] * z[7] - z[5] * z[6] + z[8];
    const double after = now[4] * now[7] - now[5] * now[6] + now[8];
    assert_true(fabs(after - before) < 1e-8);
    assert_true(fabs(now[8] - z[8]) > 1e-2);
    // A direction does not name what takes up the heat.
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    require(pm_scene_parse(&scene,
                           "scene: x\n" TIME "models:\n  m: {energy: ['a^2', '300*s'], entropy: "
                           "{given: s},\n    irreversible: {given: [[{a: 1, s: 2}, s, 1.0]]}}\n"
                           "subsystems:\n  x: {model: m, state: {a: {unit: m, size: 1}, s: {unit: "
                           "J/K, size: 1}}}\n",
                           "x.yaml"));
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "a direction must name"));
    pm_scene_free(scene);
    close_subject(&s);
}

// --- bits ---

#define ARMS 20

// Twenty pendula in a row, each joined to the next by conduction: blocks of many lanes in one
// process, and a lane for each where every pendulum has a process of its own.
static void all_divisions_have_the_same_bits(void **state) {
    (void)state;
    static const char row[] =
        "scene: row\ntime: {dt: 0.02, steps: 20, integrator: rk4, substeps: 2}\nmodels:\n"
        "  arm: {coenergy: ['(1+0.3*cos(q))*v^2', '5*(T*ln(T)-T)'], energy: '7*(1-cos(q))',\n"
        "    entropy: {given: T}, reversible: {given: [[q, v, 1.0]]},\n"
        "    irreversible: {given: [[v, T, '0.3*dE.T']]}}\n"
        "  wall: {law: bracket, irreversible: {given: [['a.T', 'b.T', '3*b.dE.T/a.dE.T']]}}\n"
        "subsystems:\n"
        "  \"arm[0:20]\": {model: arm, state: {q: {unit: rad, size: 1},\n"
        "    v: {unit: rad/s, size: 1, coenergy: true}, T: {unit: K, size: 1, coenergy: true}}}\n"
        "ports:\n"
        "  \"wall[0:19]\": {law: bracket, model: wall, between: [\"arm[i]\", \"arm[i+1]\"],\n"
        "    expose: {\"arm[i]\": T, \"arm[i+1]\": T}}\n";
    subject s;
    divided alone;
    pm_sample *sample = NULL;
    double z[3 * ARMS];
    for (int i = 0; i < ARMS; ++i) {
        z[3 * i] = 0.1 * i;
        z[3 * i + 1] = 1 - 0.2 * i;
        z[3 * i + 2] = 290 + i;
    }
    open_subject(&s, row, z);
    divided_open(&alone, s.system, 0, NULL);
    divided_set_state(&alone, z);
    require(pm_sample_new(&sample, s.scene));
    for (int step = 0; step < 20; ++step) {
        require(pm_monolithic_step(s.simulation));
        require(divided_step(&alone));
        divided_fill_sample(&alone, sample);
        const pm_sample *whole = pm_monolithic_sample(s.simulation);
        assert_memory_equal(whole->z, sample->z, sizeof z);
        assert_memory_equal(whole->flux, sample->flux, 19 * sizeof *whole->flux);
        assert_memory_equal(whole->energy, sample->energy, ARMS * sizeof *whole->energy);
    }
    assert_true(fabs(sample->z[1] - z[1]) > 1e-3);
    pm_sample_free(sample);
    divided_close(&alone);
    close_subject(&s);
}

// --- mistakes ---

static void expect_refusal(const char *model, const char *v, const char *integrator,
                           const char *expected) {
    char text[1024];
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *simulation = NULL;
    snprintf(text, sizeof text,
             "scene: wrong\ntime: {dt: 0.1, steps: 1, integrator: %s}\nmodels:\n  m: {%s}\n"
             "subsystems:\n  a: {model: m, state: {q: {unit: m, size: 1}, v: {unit: m/s, size: "
             "%s}}}\n",
             integrator, model, v);
    require(pm_scene_parse(&scene, text, "wrong.yaml"));
    pm_status status = pm_system_load(&system, scene, NULL);
    status = status == PM_OK ? pm_monolithic_open(&simulation, system) : status;
    if (status != PM_ECONFIG || strstr(pm_error(), expected) == NULL ||
        strncmp(pm_error(), "wrong.yaml:", 11) != 0) {
        fail_msg("%s: status %d, %s; expected \"wrong.yaml:...%s\"", model, status, pm_error(),
                 expected);
    }
    pm_monolithic_close(simulation);
    pm_system_free(system);
    pm_scene_free(scene);
}

static void mistakes_are_refused(void **state) {
    (void)state;
    static const char shown_v[] = "1, coenergy: true";
    expect_refusal("energy: 'q^2'", shown_v, "rk4", "`coenergy` depends on v");
    expect_refusal("energy: 'q^2+v^2', coenergy: 'v^2'", shown_v, "rk4", "only `coenergy`");
    expect_refusal("energy: 'q^2', coenergy: 'v^2', entropy: 'v'", shown_v, "rk4",
                   "only `coenergy`");
    expect_refusal("energy: 'q^2', coenergy: 'v^2'", "1", "rk4", "`coenergy: true`");
    expect_refusal("energy: 'q^2', coenergy: '|v|^2'", "17, coenergy: true", "rk4",
                   "couples 17 components, at most 16");
    expect_refusal("energy: 'q^2', coenergy: {inertia: {of: [v], first: 1.0}}", shown_v, "rk4",
                   "an inertia of 1 component, expected 2 to 8");
    expect_refusal("energy: 'q^2', coenergy: 'v^2'", shown_v, "discrete_gradient",
                   "cannot step co-energies");
    expect_refusal("energy: 'q^2', coenergy: 'v^2'", shown_v, "rk4_balanced",
                   "cannot step co-energies");
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_kinds_of_variables_move_alike),
        cmocka_unit_test(capacities_and_inertias_are_as_the_pages_say),
        cmocka_unit_test(release_keeps_all_rates),
        cmocka_unit_test(nothing_is_released_where_inertias_are_one),
        cmocka_unit_test(trainer_takes_the_same_step),
        cmocka_unit_test(directions_obey_both_laws),
        cmocka_unit_test(all_divisions_have_the_same_bits),
        cmocka_unit_test(mistakes_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

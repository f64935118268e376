// A batch gives every subsystem the bits, fluxes and counts that it has when it is stepped alone,
// in one process and in several.
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
#include "sim/local_subsystems.h"
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

// Returns the positions of all subsystems.
static const int *all(void) {
    static int id[MOST_LINKS];
    for (int i = 0; i < MOST_LINKS; ++i) {
        id[i] = i;
    }
    return id;
}

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
    assert_memory_equal(a->error, b->error, n * sizeof *a->error);
    for (size_t i = 0; i < n; ++i) {
        assert_int_equal(a->evaluated[i], b->evaluated[i]);
        assert_int_equal(a->skipped[i], b->skipped[i]);
    }
}

// Compares a batch with links that are stepped alone, over two runs of 20 steps.
static void compare_chain(const subject *s) {
    pm_batch *batch = NULL;
    pm_monolithic *alone = NULL;
    pm_sample *sample = NULL;
    require(pm_batch_open(&batch, s->system, s->scene->nsubsystem, all()));
    assert_non_null(batch);
    require(pm_monolithic_open(&alone, s->system));
    require(pm_sample_new(&sample, s->scene));
    for (int run = 0; run < 2; ++run) { // a second run starts anew
        pm_batch_set_state(batch, s->z);
        pm_monolithic_set_state(alone, s->z);
        for (long step = 0; step <= 20; ++step) {
            pm_batch_set_substeps(batch, pm_monolithic_substeps(alone));
            require(step > 0 ? pm_batch_step(batch) : PM_OK);
            require(step > 0 ? pm_monolithic_step(alone) : PM_OK);
            pm_batch_fill_sample(batch, sample);
            check_equal(s->scene, sample, pm_monolithic_sample(alone), step);
        }
    }
    pm_sample_free(sample);
    pm_monolithic_close(alone);
    pm_batch_close(batch);
}

static void a_batch_has_the_bits_of_its_parts(void **state) {
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
        s.scene->dt = 0.2;
        s.scene->tolerance = i < 6 ? 1e-5 : 0;
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
// Subsystems that a plain loop steps one by one.
typedef struct one_by_one {
    const pm_scene *scene;
    pm_subsystem *node[NODES];
    int position[NODES * 4][2]; // of a port in the list of each end
} one_by_one;

static void open_alone(one_by_one *a, const pm_system *system) {
    a->scene = system->scene;
    for (int i = 0; i < NODES; ++i) {
        require(pm_subsystem_open(&a->node[i], system, i));
        for (int j = 0; j < pm_subsystem_nport(a->node[i]); ++j) {
            a->position[pm_subsystem_port_id(a->node[i], j)][pm_subsystem_end(a->node[i], j)] = j;
        }
    }
}

static void step_alone(one_by_one *a, pm_sample *sample) {
    while (!pm_subsystem_completes_step(a->node[0])) {
        for (int i = 0; i < NODES; ++i) {
            pm_subsystem_expose(a->node[i]);
        }
        for (int i = 0; i < NODES; ++i) {
            pm_subsystem *s = a->node[i];
            pm_subsystem_bulk(s);
            for (int j = 0; j < pm_subsystem_nport(s); ++j) {
                const int port = pm_subsystem_port_id(s, j),
                          other = 1 - (int)pm_subsystem_end(s, j);
                pm_subsystem *peer = a->node[a->scene->port[port].subsystem[other]];
                pm_subsystem_couple(s, j, pm_subsystem_values(peer, a->position[port][other]));
            }
        }
        for (int i = 0; i < NODES; ++i) {
            pm_subsystem_advance(a->node[i]);
        }
    }
    for (int i = 0; i < NODES; ++i) {
        require(pm_subsystem_end_step(a->node[i]));
        pm_subsystem_fill_sample(a->node[i], sample);
    }
}

static void compare_web(const char *integrator) {
    char text[4096];
    subject s = {0};
    one_by_one a = {0};
    pm_batch *batch = NULL;
    pm_sample *one = NULL, *two = NULL;
    snprintf(text, sizeof text, web, integrator);
    require(pm_scene_parse(&s.scene, text, "web.yaml"));
    require(pm_system_load(&s.system, s.scene, NULL));
    require(pm_batch_open(&batch, s.system, s.scene->nsubsystem, all()));
    assert_non_null(batch);
    open_alone(&a, s.system);
    require(pm_sample_new(&one, s.scene));
    require(pm_sample_new(&two, s.scene));
    // Only the first oscillators move at first, and whole blocks rest until the motion reaches
    // them.
    for (int i = 0; i < 2 * NODES; ++i) {
        s.z[i] = i < 12 ? 0.3 + 0.1 * i : 1;
    }
    pm_batch_set_state(batch, s.z);
    for (int i = 0; i < NODES; ++i) {
        pm_subsystem_set_state(a.node[i], s.z + 2 * (ptrdiff_t)i);
    }
    for (long step = 1; step <= 30; ++step) {
        require(pm_batch_step(batch));
        pm_batch_fill_sample(batch, one);
        step_alone(&a, two);
        check_equal(s.scene, one, two, step);
        assert_true(step > 1 || one->z[WAKES] == 1);
    }
    assert_true(one->z[WAKES] != 1);
    for (int i = 0; i < NODES; ++i) {
        pm_subsystem_close(a.node[i]);
    }
    pm_sample_free(one);
    pm_sample_free(two);
    pm_batch_close(batch);
    close_chain(&s);
}

static void blocks_rest_and_sum_in_the_order_of_the_scene(void **state) {
    (void)state;
    compare_web("euler");
    compare_web("rk4_balanced");
}

// --- several processes ---

#define PROCESSES 3

// Subsystems of several processes that exchange their values in memory.
typedef struct process {
    int id[NODES];
    pm_local_subsystems *local;
} process;

// Opens the processes. A subsystem belongs to the process whose number is the rest of its block.
static void open_processes(process *p, const pm_system *system, int block, const double *z) {
    int count[PROCESSES] = {0};
    for (int i = 0; i < NODES; ++i) {
        const int owner = i / block % PROCESSES;
        p[owner].id[count[owner]++] = i;
    }
    for (int i = 0; i < PROCESSES; ++i) {
        require(pm_local_subsystems_open(&p[i].local, system, count[i], p[i].id));
        pm_local_subsystems_set_state(p[i].local, z);
    }
}

static void close_processes(process *p) {
    for (int i = 0; i < PROCESSES; ++i) {
        pm_local_subsystems_close(p[i].local);
    }
}

// Hands over to a process what the others show at the other side of one of its remote ends.
static void hand_over(const process *p, pm_local_subsystems *to, int remote) {
    const pm_remote_end end = pm_local_subsystems_remote(to, remote);
    for (int i = 0; i < PROCESSES; ++i) {
        for (int k = 0; k < pm_local_subsystems_nremote(p[i].local); ++k) {
            const pm_remote_end other = pm_local_subsystems_remote(p[i].local, k);
            if (other.port_id == end.port_id && other.end != end.end) {
                double y[2], e[2], eta[2];
                pm_local_subsystems_show(p[i].local, k, y, e, eta, NULL, NULL);
                const pm_port_values values = {.ny = 2, .y = y, .e = e, .eta = eta};
                pm_local_subsystems_hear(to, remote, &values);
            }
        }
    }
}

// Copies the books and the state of subsystem number `i` of a process into the sample.
static void fill_sample(const pm_local_subsystems *local, int i, int id, const pm_scene *scene,
                        pm_sample *sample) {
    const pm_books books = pm_local_subsystems_books(local, i);
    pm_sample_set_books(sample, id, &books);
    for (int k = 0; k < books.nflux; ++k) {
        const int at = scene->end_at[scene->first_end[id] + k];
        sample->flux[at / 2][at % 2] = books.flux[k];
    }
    pm_local_subsystems_state(local, i, sample->z + scene->subsystem[id].first);
}

static void step_processes(process *p, const pm_scene *scene, pm_sample *sample) {
    while (!pm_local_subsystems_completes_step(p[0].local)) {
        for (int i = 0; i < PROCESSES; ++i) {
            pm_local_subsystems_expose(p[i].local);
            pm_local_subsystems_bulk(p[i].local);
            for (int k = 0; k < pm_local_subsystems_nremote(p[i].local); ++k) {
                hand_over(p, p[i].local, k);
            }
        }
        for (int i = 0; i < PROCESSES; ++i) {
            pm_local_subsystems_couple(p[i].local);
        }
        for (int i = 0; i < PROCESSES; ++i) {
            pm_local_subsystems_advance(p[i].local);
        }
    }
    for (int i = 0; i < PROCESSES; ++i) {
        require(pm_local_subsystems_end_step(p[i].local));
    }
    for (int i = 0; i < PROCESSES; ++i) {
        for (int k = 0; k < NODES && (k == 0 || p[i].id[k] > 0); ++k) {
            fill_sample(p[i].local, k, p[i].id[k], scene, sample);
        }
    }
}
// Replaces every process by a new one that continues from its checkpoint.
static void replace_processes(process *p, const pm_system *system, int block, const double *z) {
    double *saved[PROCESSES];
    for (int i = 0; i < PROCESSES; ++i) {
        pm_record count = pm_record_count("process");
        pm_local_subsystems_record(p[i].local, &count);
        saved[i] = calloc((size_t)count.count, sizeof(double));
        assert_non_null(saved[i]);
        pm_record save = pm_record_save("process", saved[i]);
        pm_local_subsystems_record(p[i].local, &save);
    }
    close_processes(p);
    memset(p, 0, PROCESSES * sizeof *p);
    open_processes(p, system, block, z);
    for (int i = 0; i < PROCESSES; ++i) {
        pm_record restore = pm_record_restore("process", saved[i]);
        pm_local_subsystems_record(p[i].local, &restore);
        free(saved[i]);
    }
}

static void compare_processes(const char *integrator, int block) {
    char text[4096];
    subject s = {0};
    pm_monolithic *whole = NULL;
    pm_sample *sample = NULL;
    process p[PROCESSES] = {0};
    snprintf(text, sizeof text, web, integrator);
    require(pm_scene_parse(&s.scene, text, "web.yaml"));
    require(pm_system_load(&s.system, s.scene, NULL));
    require(pm_monolithic_open(&whole, s.system));
    require(pm_sample_new(&sample, s.scene));
    for (int i = 0; i < 2 * NODES; ++i) {
        s.z[i] = i < 12 ? 0.3 + 0.1 * i : 1;
    }
    open_processes(p, s.system, block, s.z);
    pm_monolithic_set_state(whole, s.z);
    for (long step = 1; step <= 30; ++step) {
        step_processes(p, s.scene, sample);
        require(pm_monolithic_step(whole));
        check_equal(s.scene, sample, pm_monolithic_sample(whole), step);
        if (step % 7 == 0) {
            replace_processes(p, s.system, block, s.z);
        }
    }
    close_processes(p);
    pm_sample_free(sample);
    pm_monolithic_close(whole);
    close_chain(&s);
}

static void several_processes_have_the_bits_of_one(void **state) {
    (void)state;
    compare_processes("euler", 1);
    compare_processes("rk4", 7);
    compare_processes("rk4_balanced", 54);
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
    pm_batch *batch = NULL;
    pm_monolithic *alone = NULL;
    pm_sample *sample = NULL;
    char message[512];
    open_chain(&s, "euler", LINKS, false, false);
    s.scene->largest_departure = 0.5;
    s.z[7 * NZ + 2] = 1e3;
    require(pm_batch_open(&batch, s.system, s.scene->nsubsystem, all()));
    require(pm_monolithic_open(&alone, s.system));
    require(pm_sample_new(&sample, s.scene));
    pm_batch_set_state(batch, s.z);
    pm_batch_fill_sample(batch, sample);
    pm_monolithic_set_state(alone, s.z);
    assert_int_equal(pm_monolithic_step(alone), PM_ENUMERIC);
    snprintf(message, sizeof message, "%s", pm_error());
    assert_int_equal(pm_batch_step(batch), PM_ENUMERIC);
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
        cmocka_unit_test(balanced_and_adaptive_steps_have_these_bits),
        cmocka_unit_test(blocks_rest_and_sum_in_the_order_of_the_scene),
        cmocka_unit_test(several_processes_have_the_bits_of_one),
        cmocka_unit_test(company_changes_no_bit),
        cmocka_unit_test(a_failure_names_its_subsystem),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

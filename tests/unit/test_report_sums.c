// A run of many subsystems whose processes report sums enters the same numbers in its ledger, bit
// by bit, as a run in one process, however the subsystems are divided.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "sim/monolithic.h"
#include "tests/support/memory_hub.h"
#include "tests/support/together.h"
#include "tests/support/unit.h"

#define NODES 1100
#define STEPS 12
#define MOST_PROCESSES 3

// Oscillators with friction in baths of their own, in a chain with longer ties.
static const char chain[] =
    "scene: chain\ntime: {dt: 0.05, steps: 12, integrator: heun}\n"
    "models:\n"
    "  node: {energy: \"p^2/2 + q^2/2 + q^4/4 + exp(s)\", entropy: \"s\",\n"
    "    reversible: {given: [[q, p, 1.0]]}, irreversible: {given: [[p, s, \"0.3*dE.s\"]]}}\n"
    "  tie: {law: bracket, reversible: {given: [[a.p, b.q, 0.7]]}}\n"
    "subsystems:\n"
    "  \"n[0:1100]\": {model: node, state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1},\n"
    "    s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  \"a[0:1099]\": {law: bracket, between: [\"n[i]\", \"n[i+1]\"], model: tie,\n"
    "    expose: {\"n[i]\": [q, p], \"n[i+1]\": [q, p]}}\n"
    "  \"b[0:1080]\": {law: bracket, between: [\"n[i+20]\", \"n[i]\"], model: tie,\n"
    "    expose: {\"n[i+20]\": [q, p], \"n[i]\": [q, p]}}\n"
    "processes: %s\n";

typedef struct run {
    pm_scene *scene;
    pm_system *system;
    double z[3 * NODES];
    pm_ledger ledger;
    pm_sample *last; // of the first PM_SCENE_LISTED subsystems
} run;

static void open_run(run *r, const char *processes) {
    static char text[32768];
    memset(r, 0, sizeof *r);
    snprintf(text, sizeof text, chain, processes);
    require(pm_scene_parse(&r->scene, text, "chain.yaml"));
    require(pm_system_load(&r->system, r->scene, NULL));
    require(pm_sample_new(&r->last, r->scene));
    for (int i = 0; i < 3 * NODES; ++i) {
        r->z[i] = i % 3 == 2 ? 0.01 * i : (i * 37 % 101 - 50) / 40.0;
    }
}

static void close_run(run *r) {
    pm_sample_free(r->last);
    pm_system_free(r->system);
    pm_scene_free(r->scene);
}

// Copies the numbers of the listed subsystems.
static pm_status keep(void *context, const pm_sample *sample) {
    run *r = context;
    const size_t n = PM_SCENE_LISTED * sizeof(double);
    memcpy(r->last->energy, sample->energy, n);
    memcpy(r->last->bulk_entropy, sample->bulk_entropy, n);
    memcpy(r->last->evaluated, sample->evaluated, PM_SCENE_LISTED * sizeof(long));
    memcpy(r->last->flux, sample->flux, (PM_SCENE_LISTED - 1) * sizeof(pm_flux[2]));
    r->last->energy_residual = sample->energy_residual;
    r->last->evaluated_in_all = sample->evaluated_in_all;
    r->last->skipped_in_all = sample->skipped_in_all;
    return PM_OK;
}

static void run_here(run *r, bool sums) {
    pm_monolithic *m = NULL;
    open_run(r, "{all: \"n[0:1100]\"}");
    require(pm_monolithic_open(&m, r->system));
    pm_monolithic_set_state(m, r->z);
    pm_ledger_init(&r->ledger, r->system);
    for (int step = 0; step <= STEPS; ++step) {
        pm_tally tally;
        require(step > 0 ? pm_monolithic_step(m) : PM_OK);
        pm_sample sample = sums ? *pm_monolithic_sums(m, &tally) : *pm_monolithic_sample(m);
        require(sums ? pm_ledger_add_sums(&r->ledger, &sample, &tally)
                     : pm_ledger_add_sample(&r->ledger, &sample));
        keep(r, &sample);
    }
    pm_monolithic_close(m);
}

static void run_processes(run *r, const char *processes, bool want_state) {
    pm_hub *hub = NULL;
    pm_transport *transport[MOST_PROCESSES + 1];
    pm_lockstep_node *node[MOST_PROCESSES];
    pm_lockstep_coordinator *coordinator = NULL;
    open_run(r, processes);
    const int count = r->scene->network.nprocess;
    assert_in_range(count, 1, MOST_PROCESSES);
    require(pm_hub_open(&hub, NULL));
    for (int i = 0; i <= count; ++i) {
        require(pm_hub_connect(hub, &transport[i]));
    }
    const pm_lockstep_node_options options = {.z = r->z};
    for (int i = 0; i < count; ++i) {
        require(pm_lockstep_node_open(&node[i], r->system, i, transport[i], &options));
    }
    const pm_lockstep_coordinator_options own = {.want_state = want_state,
                                                 .observer = {.context = r, .step = keep}};
    require(pm_lockstep_coordinator_open(&coordinator, r->system, transport[count], &own));
    require(run_together(coordinator, count, node, NULL));
    r->ledger = *pm_lockstep_coordinator_ledger(coordinator);
    pm_lockstep_coordinator_close(coordinator);
    for (int i = 0; i <= count; ++i) {
        if (i < count) {
            pm_lockstep_node_close(node[i]);
        }
        pm_transport_close(transport[i]);
    }
    pm_hub_close(hub);
}

static void check_equal(const run *a, const run *b) {
    assert_int_equal(a->ledger.steps, b->ledger.steps);
    assert_memory_equal(&a->ledger.first_energy, &b->ledger.first_energy, sizeof(double));
    assert_memory_equal(&a->ledger.energy, &b->ledger.energy, sizeof(double));
    assert_memory_equal(&a->ledger.entropy, &b->ledger.entropy, sizeof(double));
    assert_memory_equal(&a->ledger.energy_drift, &b->ledger.energy_drift, sizeof(double));
    assert_memory_equal(&a->ledger.worst_energy, &b->ledger.worst_energy, sizeof(double));
    assert_memory_equal(&a->ledger.worst_entropy, &b->ledger.worst_entropy, sizeof(double));
    assert_memory_equal(&a->ledger.worst_step, &b->ledger.worst_step, sizeof(double));
    assert_int_equal(a->ledger.worst_energy_step, b->ledger.worst_energy_step);
    assert_int_equal(a->ledger.worst_energy_place, b->ledger.worst_energy_place);
    const size_t n = PM_SCENE_LISTED * sizeof(double);
    assert_memory_equal(a->last->energy, b->last->energy, n);
    assert_memory_equal(a->last->bulk_entropy, b->last->bulk_entropy, n);
    assert_memory_equal(a->last->evaluated, b->last->evaluated, PM_SCENE_LISTED * sizeof(long));
    assert_memory_equal(a->last->flux, b->last->flux, (PM_SCENE_LISTED - 1) * sizeof(pm_flux[2]));
    assert_memory_equal(&a->last->energy_residual, &b->last->energy_residual, sizeof(double));
    assert_int_equal(a->last->evaluated_in_all, b->last->evaluated_in_all);
    assert_int_equal(a->last->skipped_in_all, b->last->skipped_in_all);
}

static void sums_have_the_bits_of_all_numbers(void **state) {
    (void)state;
    static char alternating[16384] = "{even: [n0";
    for (int i = 1; i < NODES; ++i) {
        const size_t used = strlen(alternating);
        snprintf(alternating + used, sizeof alternating - used,
                 i == NODES / 2 ? "], odd: [n%d" : ", n%d",
                 i < NODES / 2 ? 2 * i : 2 * (i - NODES / 2) + 1);
    }
    strcat(alternating, "]}");
    const char *const processes[] = {"{all: \"n[0:1100]\"}",
                                     "{x: \"n[0:90]\", y: \"n[90:1000]\", z: \"n[1000:1100]\"}",
                                     alternating};
    run whole, other;
    run_here(&whole, false);
    assert_true(whole.ledger.violations == 0 && whole.ledger.worst_energy > 0);
    run_here(&other, true);
    check_equal(&whole, &other);
    close_run(&other);
    for (int i = 0; i < 6; ++i) {
        run_processes(&other, processes[i / 2], i % 2 == 1);
        check_equal(&whole, &other);
        close_run(&other);
    }
    close_run(&whole);
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {cmocka_unit_test(sums_have_the_bits_of_all_numbers)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// One driven thermoelastic link (chain.h): its pivot moves with the velocity v, a force F acts on
// its mass, and its spring conducts heat to a bath. In coordinates relative to the pivot:
//     qdot = p/m - v,   pdot = F - f q/|q|,   sdot = K (T_bath/T - 1)
// The velocity, the force and the temperature of the bath are sums of sines, whose frequencies and
// phases are drawn for each trajectory. Each sine is an oscillator in the state, which makes the
// problem autonomous:
//     v = sum_k a_k,   a_k dot = w_k b_k,   b_k dot = -w_k a_k,   w_k dot = 0
// Two more components count the energy and the entropy that the link has given to its surroundings.
// With them energy is conserved and entropy never falls.
#include <math.h>

#include "truth/link.h"
#include "truth/numbers.h"
#include "truth/truth.h"

#define MAX_SINES 16
#define PI 3.14159265358979323846

// Components of the state: first the columns, then the oscillators a, b, w by sine and load.
enum { Q, P = 2, S = 4, V, F = 7, T_BATH = 9, NCOLUMN, W_ENERGY = NCOLUMN, W_ENTROPY, OSCILLATORS };
#define NLOAD (NCOLUMN - V)

typedef struct driven_link {
    pm_chain_link link;
    pm_chain chain; // of this link
    pm_spread position, momentum, temperature;
    int nsine;
    double frequency[2];   // rad/s, drawn uniformly between these
    double mean[NLOAD];    // of v, F and the temperature of the bath
    double typical[NLOAD]; // root mean square deviations from the mean
} driven_link;

static const char *const columns[NCOLUMN] = {"qx", "qy", "px", "py", "s",
                                             "vx", "vy", "fx", "fy", "T"};
static const char *const conserved[] = {"energy"};

// --- the functions of the model ---

static void load_rate(const driven_link *system, const double *z, double *zdot) {
    for (int i = 0; i < NLOAD; ++i) {
        zdot[V + i] = 0;
    }
    for (int k = 0; k < NLOAD * system->nsine; ++k) {
        const double *oscillator = z + OSCILLATORS + 3 * k;
        double *change = zdot + OSCILLATORS + 3 * k;
        change[0] = oscillator[2] * oscillator[1];
        change[1] = -oscillator[2] * oscillator[0];
        change[2] = 0;
        zdot[V + k % NLOAD] += change[0];
    }
}

static void rate(const void *data, const double *z, double *zdot) {
    const driven_link *system = data;
    const pm_chain *chain = &system->chain;
    const double T = pm_chain_temperature(chain, z, 0);
    const double heat = chain->conductivity * (z[T_BATH] - T); // W, out of the bath
    pm_chain_rate(chain, z, zdot);
    zdot[W_ENERGY] = -heat;
    zdot[W_ENTROPY] = -heat / z[T_BATH];
    for (int i = 0; i < 2; ++i) {
        // Work is done at the pivot, at which the spring pulls, and by the force on the mass.
        zdot[W_ENERGY] += -zdot[P + i] * z[V + i] - z[F + i] * zdot[Q + i];
        zdot[Q + i] -= z[V + i];
        zdot[P + i] += z[F + i];
    }
    zdot[S] += heat / T;
    load_rate(system, z, zdot);
}

static void draw(const void *data, pm_rng *rng, double *z) {
    const driven_link *system = data;
    const double *frequency = system->frequency;
    double T = pm_spread_draw(rng, &system->temperature, 0);
    for (int i = 0; i < 2; ++i) {
        z[Q + i] = pm_spread_draw(rng, &system->position, i);
        z[P + i] = pm_spread_draw(rng, &system->momentum, i);
    }
    pm_chain_set_temperatures(&system->chain, &T, z);
    for (int i = 0; i < NLOAD; ++i) {
        z[V + i] = system->mean[i];
    }
    z[W_ENERGY] = z[W_ENTROPY] = 0;
    for (int k = 0; k < NLOAD * system->nsine; ++k) {
        double *oscillator = z + OSCILLATORS + 3 * k;
        const double phase = 2 * PI * pm_rng_uniform(rng);
        const double amplitude = system->typical[k % NLOAD] * sqrt(2.0 / system->nsine);
        oscillator[0] = amplitude * sin(phase);
        oscillator[1] = amplitude * cos(phase);
        oscillator[2] = frequency[0] + (frequency[1] - frequency[0]) * pm_rng_uniform(rng);
        z[V + k % NLOAD] += oscillator[0];
    }
}

static void conserve(const void *data, const double *z, double *value) {
    value[0] = pm_chain_energy(&((const driven_link *)data)->chain, z) + z[W_ENERGY];
}

static double entropy(const void *data, const double *z) {
    (void)data;
    return z[S] + z[W_ENTROPY];
}

// --- the configuration ---

static pm_status read_link(pm_yaml block, pm_arena *arena, driven_link *system) {
    static const char *const keys[] = {"mass",     "C",        "l0",          "b", "c",
                                       "position", "momentum", "temperature", NULL};
    pm_yaml link;
    PM_TRY(pm_yaml_require(block, "link", &link));
    PM_TRY(pm_yaml_allow(link, keys));
    PM_TRY(pm_truth_link(link, &system->link));
    PM_TRY(pm_truth_spread(link, "position", 2, arena, &system->position));
    PM_TRY(pm_truth_spread(link, "momentum", 2, arena, &system->momentum));
    return pm_truth_spread(link, "temperature", 1, arena, &system->temperature);
}

static pm_status read_load(pm_yaml block, pm_arena *arena, driven_link *system) {
    static const char *const keys[] = {"sines", "frequency",   "velocity",
                                       "force", "temperature", NULL};
    pm_yaml load, sines;
    pm_spread bath;
    double velocity, force;
    PM_TRY(pm_yaml_require(block, "load", &load));
    PM_TRY(pm_yaml_allow(load, keys));
    PM_TRY(pm_yaml_require(load, "sines", &sines));
    PM_TRY(pm_yaml_int(sines, 1, MAX_SINES, &system->nsine));
    PM_TRY(pm_truth_numbers(load, "frequency", 2, arena, system->frequency));
    PM_TRY(pm_truth_number(load, "velocity", 0, 1e9, &velocity));
    PM_TRY(pm_truth_number(load, "force", 0, 1e9, &force));
    PM_TRY(pm_truth_spread(load, "temperature", 1, arena, &bath));
    const double typical[NLOAD] = {velocity, velocity, force, force, bath.deviation[0]};
    for (int i = 0; i < NLOAD; ++i) {
        system->typical[i] = typical[i];
    }
    system->mean[NLOAD - 1] = bath.mean[0];
    return PM_OK;
}

static pm_status read_system(pm_yaml block, pm_arena *arena, driven_link *system) {
    static const char *const keys[] = {"reference_temperature", "conductivity", "link", "load",
                                       NULL};
    pm_chain *chain = &system->chain;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(
        pm_truth_number(block, "reference_temperature", 1e-3, 1e6, &chain->reference_temperature));
    PM_TRY(pm_truth_number(block, "conductivity", 0, 1e9, &chain->conductivity));
    chain->n = 1;
    chain->link = &system->link;
    PM_TRY(read_link(block, arena, system));
    return read_load(block, arena, system);
}

pm_status pm_driven_link_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    driven_link *system = pm_arena_alloc(arena, sizeof *system);
    if (system == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    PM_TRY(read_system(block, arena, system));
    const pm_chain_link *link = &system->chain.link[0];
    model->parameters = pm_arena_printf(
        arena,
        "conductivity %g W/K, reference temperature %g K; m %g kg, C %g J, l0 %g m, b %g J/K, "
        "c %g J/K; %d sines of %g to %g rad/s: %g m/s, %g N, %g K about %g K",
        system->chain.conductivity, system->chain.reference_temperature, link->mass, link->C,
        link->l0, link->b, link->c, system->nsine, system->frequency[0], system->frequency[1],
        system->typical[0], system->typical[2], system->typical[4], system->mean[4]);
    if (model->parameters == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    model->title = "A thermoelastic link under a load";
    model->ode =
        (pm_ode){.nz = OSCILLATORS + 3 * NLOAD * system->nsine, .rate = rate, .data = system};
    model->ncolumn = NCOLUMN;
    model->column = columns;
    model->units = "m;m;kg m/s;kg m/s;J/K;m/s;m/s;N;N;K";
    model->draw = draw;
    model->nconserved = 1;
    model->conserved = conserved;
    model->conserve = conserve;
    model->entropy = entropy;
    return PM_OK;
}

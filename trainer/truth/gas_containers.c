// Two containers of ideal gas that exchange heat and volume through a wall that moves without
// friction: the GENERIC benchmark of Shang and Oettinger, Proc. R. Soc. A 476 (2020)
// 20190446, and of Zhang, Shin and Karniadakis, Phil. Trans. R. Soc. A 380 (2022) 20210207.
//
// The state is z = v1 v2 p s1 s2: volumes, momentum of the wall, entropies. With the wall at q,
// v1 = A q and v2 = A (2 L - q). The gases are monatomic (Sackur-Tetrode), with R = N kB of each:
//     E_i = (exp(s_i / R) / (c v_i))^(2/3),   T_i = 2 E_i / (3 R),   P_i = 2 E_i / (3 v_i)
//     v1dot = -v2dot = A p / m,   pdot = A (P1 - P2)
//     s_i dot = alpha / T_i (1/T_i - 1/T_j), that is 9 R^2 alpha / (4 E_i) (1/E_i - 1/E_j)
#include <math.h>

#include "truth/truth.h"

enum { V1, V2, P, S1, S2, NZ };

typedef struct gas_containers {
    double wall_mass;    // m, kg
    double area;         // A, m^2
    double half_length;  // L, m: v1 + v2 = 2 A L
    double gas_constant; // R = N kB of each container, J/K
    double c;            // 1/(m^3 J^(3/2)), sets the zero of the entropies
    double conductivity; // alpha, W K
    // Initial states are drawn uniformly between a lowest and a highest value.
    double position[2]; // q, m
    double momentum[2]; // p, kg m/s
    double entropy[2];  // s1 and s2, J/K
} gas_containers;

static const char *const columns[NZ] = {"v1", "v2", "p", "s1", "s2"};
static const char *const conserved[] = {"energy", "volume"};

// Returns the energy of a gas of volume v and entropy s, J.
static double gas_energy(const gas_containers *gas, double v, double s) {
    return pow(exp(s / gas->gas_constant) / (gas->c * v), 2.0 / 3);
}

// --- the functions of the model ---

static void rate(const void *data, const double *z, double *zdot) {
    const gas_containers *gas = data;
    const double E1 = gas_energy(gas, z[V1], z[S1]), E2 = gas_energy(gas, z[V2], z[S2]);
    const double T1 = 2 * E1 / (3 * gas->gas_constant), T2 = 2 * E2 / (3 * gas->gas_constant);
    const double heat = gas->conductivity * (1 / T1 - 1 / T2); // W, into the first
    zdot[V1] = gas->area * z[P] / gas->wall_mass;
    zdot[V2] = -zdot[V1];
    zdot[P] = gas->area * 2 / 3 * (E1 / z[V1] - E2 / z[V2]);
    zdot[S1] = heat / T1;
    zdot[S2] = -heat / T2;
}

static double draw_between(pm_rng *rng, const double range[2]) {
    return range[0] + (range[1] - range[0]) * pm_rng_uniform(rng);
}

static void draw(const void *data, pm_rng *rng, double *z) {
    const gas_containers *gas = data;
    const double q = draw_between(rng, gas->position);
    z[V1] = gas->area * q;
    z[V2] = gas->area * (2 * gas->half_length - q);
    z[P] = draw_between(rng, gas->momentum);
    z[S1] = draw_between(rng, gas->entropy);
    z[S2] = draw_between(rng, gas->entropy);
}

static void conserve(const void *data, const double *z, double *value) {
    const gas_containers *gas = data;
    value[0] = z[P] * z[P] / (2 * gas->wall_mass) + gas_energy(gas, z[V1], z[S1]) +
               gas_energy(gas, z[V2], z[S2]);
    value[1] = z[V1] + z[V2];
}

static double entropy(const void *data, const double *z) {
    (void)data;
    return z[S1] + z[S2];
}

// --- the configuration ---

static pm_status check_range(pm_yaml map, const char *key, const double range[2]) {
    return range[0] <= range[1]
               ? PM_OK
               : pm_yaml_fail(pm_yaml_get(map, key), "expected [lowest, highest], found [%g, %g]",
                              range[0], range[1]);
}

pm_status pm_gas_containers_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    const double tiny = 1e-12, huge = 1e12;
    pm_yaml initial;
    gas_containers *gas = pm_arena_alloc(arena, sizeof *gas);
    PM_TRY(pm_arena_status(arena, "two gas containers"));
    const pm_yaml_key keys[] = {
        {PM_YAML_DOUBLE("wall_mass", &gas->wall_mass, tiny, huge), .required = true},
        {PM_YAML_DOUBLE("area", &gas->area, tiny, huge), .required = true},
        {PM_YAML_DOUBLE("half_length", &gas->half_length, tiny, huge), .required = true},
        {PM_YAML_DOUBLE("gas_constant", &gas->gas_constant, tiny, huge), .required = true},
        {PM_YAML_DOUBLE("c", &gas->c, tiny, huge), .required = true},
        {PM_YAML_DOUBLE("conductivity", &gas->conductivity, 0, huge), .required = true},
        {PM_YAML_VALUE("initial", &initial), .required = true},
        {0}};
    const pm_yaml_key initial_keys[] = {
        {PM_YAML_VECTOR("position", gas->position, 2), .required = true},
        {PM_YAML_VECTOR("momentum", gas->momentum, 2), .required = true},
        {PM_YAML_VECTOR("entropy", gas->entropy, 2), .required = true},
        {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    PM_TRY(pm_yaml_read(initial, arena, initial_keys));
    PM_TRY(check_range(initial, "position", gas->position));
    PM_TRY(check_range(initial, "momentum", gas->momentum));
    PM_TRY(check_range(initial, "entropy", gas->entropy));
    const double end = 2 * gas->half_length;
    if (gas->position[0] <= 0 || gas->position[1] >= end) {
        return pm_yaml_fail(pm_yaml_get(initial, "position"),
                            "expected both numbers in (0, %g) m, where the wall can be", end);
    }
    model->parameters = pm_arena_printf(
        arena, "m %g kg, A %g m^2, L %g m, N kB %g J/K, c %g 1/(m^3 J^(3/2)), alpha %g W K",
        gas->wall_mass, gas->area, gas->half_length, gas->gas_constant, gas->c, gas->conductivity);
    model->title = "Two gas containers exchanging heat and volume";
    model->ode = (pm_ode){.nz = NZ, .rate = rate, .data = gas};
    model->ncolumn = NZ;
    model->column = columns;
    model->units = "m^3;m^3;kg m/s;J/K;J/K";
    model->draw = draw;
    model->nconserved = 2;
    model->conserved = conserved;
    model->conserve = conserve;
    model->entropy = entropy;
    return pm_arena_status(arena, "the description of two gas containers");
}

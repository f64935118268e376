// Computes energy, entropy and rates of a chain by formulas written out by hand, and makes
// simulators of chains and of one driven link.
#include "truth/chain.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "truth/truth.h"

#define MOST_LINKS 100000
#define MAX_SINES 16
#define TINY 1e-12 // bounds of the constants of a link, in their units
#define LARGE 1e12
#define PI 3.14159265358979323846

// Computes the vector from one end of link k to the other, m, and returns its length.
static double stretch(const double *z, int k, double vector[2]) {
    for (int i = 0; i < 2; ++i) {
        vector[i] = z[pm_chain_q(k) + i] - (k > 0 ? z[pm_chain_q(k - 1) + i] : 0);
    }
    return hypot(vector[0], vector[1]);
}

static double log_stretch(const pm_chain *chain, const double *z, int k) {
    double vector[2];
    return log(stretch(z, k, vector) / chain->link[k].l0);
}

double pm_chain_temperature(const pm_chain *chain, const double *z, int k) {
    const pm_chain_link *link = &chain->link[k];
    const double s = z[pm_chain_s(chain, k)];
    return chain->reference_temperature * exp((s - link->b * log_stretch(chain, z, k)) / link->c);
}

void pm_chain_rate(const pm_chain *chain, const double *z, double *zdot) {
    const int n = chain->n;
    double *T = zdot + pm_chain_s(chain, 0); // in the place of sdot
    for (int k = 0; k < n; ++k) {
        T[k] = pm_chain_temperature(chain, z, k);
    }
    for (int i = 0; i < 2 * n; ++i) {
        zdot[i] = z[2 * n + i] / chain->link[i / 2].mass;
        zdot[2 * n + i] = 0;
    }
    // The tension of link k pulls its two ends together.
    for (int k = 0; k < n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        double vector[2];
        const double l = stretch(z, k, vector);
        const double warmer = T[k] - chain->reference_temperature;
        const double tension = (link->C * log(l / link->l0) - link->b * warmer) / l;
        for (int i = 0; i < 2; ++i) {
            const double force = tension * vector[i] / l;
            zdot[pm_chain_p(chain, k) + i] -= force;
            if (k > 0) {
                zdot[pm_chain_p(chain, k - 1) + i] += force;
            }
        }
    }
    // Heat conduction between neighbours gives sdot.
    double heat_before = 0; // W, into the link before
    for (int k = 0; k < n; ++k) {
        const double heat = k + 1 < n ? chain->conductivity * (T[k + 1] - T[k]) : 0;
        T[k] = heat / T[k] - heat_before / T[k];
        heat_before = heat;
    }
}

// --- the pattern of the Jacobian ---

// Adds the rates of the components `first` to `first + count - 1` of each link from number `begin`
// to number `end` - 1 that there is; the components of a link lie `step` apart from those of the
// next.
static void add_rows(const pm_chain *chain, int begin, int end, int first, int step, int count,
                     int *row, int *n) {
    for (int k = begin < 0 ? 0 : begin; k < end && k < chain->n; ++k) {
        for (int i = 0; i < count; ++i) {
            row[(*n)++] = first + step * k + i;
        }
    }
}

// Lists the rates that depend on component `column` of the state, in ascending order, in row.
static int list_rows(const pm_chain *chain, int column, int *row) {
    const int p = pm_chain_p(chain, 0), s = pm_chain_s(chain, 0);
    int n = 0;
    if (column < p) { // q_k stretches links k and k+1, which pull and conduct heat
        const int k = column / 2;
        row[n++] = column;
        add_rows(chain, k - 1, k + 2, p, 2, 2, row, &n);
        add_rows(chain, k - 1, k + 3, s, 1, 1, row, &n);
    } else if (column < s) { // p_k moves mass k
        row[n++] = column - p;
        row[n++] = column;
    } else { // s_k warms link k
        const int k = column - s;
        add_rows(chain, k - 1, k + 1, p, 2, 2, row, &n);
        add_rows(chain, k - 1, k + 2, s, 1, 1, row, &n);
    }
    return n;
}

const pm_ode_pattern *pm_chain_pattern(const pm_chain *chain, pm_arena *arena) {
    enum { MOST_ROWS = 11 };
    const int nz = 5 * chain->n;
    pm_ode_pattern *pattern = pm_arena_alloc(arena, sizeof *pattern);
    int *start = pm_arena_array(arena, (size_t)nz + 1, sizeof *start);
    int *row = pm_arena_array(arena, (size_t)nz * MOST_ROWS, sizeof *row);
    if (pm_arena_status(arena, "the pattern of a chain") != PM_OK) {
        return NULL;
    }
    for (int j = 0; j < nz; ++j) {
        start[j + 1] = start[j] + list_rows(chain, j, row + start[j]);
    }
    *pattern = (pm_ode_pattern){.start = start, .row = row};
    return pattern;
}

double pm_chain_energy(const pm_chain *chain, const double *z) {
    const double Tr = chain->reference_temperature;
    double energy = 0;
    for (int k = 0; k < chain->n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        const double *p = z + pm_chain_p(chain, k);
        const double x = log_stretch(chain, z, k);
        energy += (p[0] * p[0] + p[1] * p[1]) / (2 * link->mass);
        energy += 0.5 * link->C * x * x + link->b * Tr * x;
        energy += link->c * (pm_chain_temperature(chain, z, k) - Tr);
    }
    return energy;
}

double pm_chain_entropy(const pm_chain *chain, const double *z) {
    double entropy = 0;
    for (int k = 0; k < chain->n; ++k) {
        entropy += z[pm_chain_s(chain, k)];
    }
    return entropy;
}

double pm_chain_angular_momentum(const pm_chain *chain, const double *z) {
    double sum = 0;
    for (int k = 0; k < chain->n; ++k) {
        const double *q = z + pm_chain_q(k), *p = z + pm_chain_p(chain, k);
        sum += q[0] * p[1] - q[1] * p[0];
    }
    return sum;
}

void pm_chain_set_temperatures(const pm_chain *chain, const double *T, double *z) {
    for (int k = 0; k < chain->n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        z[pm_chain_s(chain, k)] =
            link->b * log_stretch(chain, z, k) + link->c * log(T[k] / chain->reference_temperature);
    }
}

void pm_chain_equilibrate(const pm_chain *chain, double total, double *z) {
    double elastic = 0, capacity = 0;
    for (int k = 0; k < chain->n; ++k) {
        elastic += chain->link[k].b * log_stretch(chain, z, k);
        capacity += chain->link[k].c;
    }
    double *T = z + pm_chain_s(chain, 0);
    for (int k = 0; k < chain->n; ++k) {
        T[k] = chain->reference_temperature * exp((total - elastic) / capacity);
    }
    pm_chain_set_temperatures(chain, T, z);
}

// --- settings that both simulators share ---

// The mean and the standard deviation of a normal random variable, or of two independent ones.
typedef struct normal_spread {
    double mean[2], deviation[2];
} normal_spread;

// The keys of the constants of a link.
#define LINK_KEYS(link)                                                     \
    {PM_YAML_DOUBLE("mass", &(link)->mass, TINY, LARGE), .required = true}, \
        {PM_YAML_DOUBLE("C", &(link)->C, 0, LARGE), .required = true},      \
        {PM_YAML_DOUBLE("l0", &(link)->l0, TINY, LARGE), .required = true}, \
        {PM_YAML_DOUBLE("b", &(link)->b, 0, LARGE), .required = true}, {    \
        PM_YAML_DOUBLE("c", &(link)->c, TINY, LARGE), .required = true      \
    }

#define CONDUCTION_KEYS(chain)                                                            \
    {PM_YAML_DOUBLE("reference_temperature", &(chain)->reference_temperature, 1e-3, 1e6), \
     .required = true},                                                                   \
    {                                                                                     \
        PM_YAML_DOUBLE("conductivity", &(chain)->conductivity, 0, 1e9), .required = true  \
    }

// Reads the map {mean, deviation} of `count` components (1 or 2).
static pm_status read_spread(pm_yaml map, int count, pm_arena *arena, normal_spread *result) {
    const pm_yaml_key keys[] = {
        {PM_YAML_VECTOR("mean", result->mean, count), .required = true},
        {PM_YAML_VECTOR("deviation", result->deviation, count), .required = true},
        {0}};
    return pm_yaml_read(map, arena, keys);
}

// Draws component i of the variable.
static double draw_normal(pm_rng *rng, const normal_spread *s, int i) {
    return s->mean[i] + s->deviation[i] * pm_rng_normal(rng);
}

// --- a chain of pendula ---
// Positions and momenta are drawn normally and independently. Entropies follow from temperatures
// drawn per link, or, with `total_entropy`, from one common temperature.

// What a link starts with.
typedef struct link_start {
    normal_spread position;    // m, absolute
    normal_spread momentum;    // kg m/s
    normal_spread temperature; // K; unused if equilibrated
} link_start;

typedef struct pendulum_chain {
    pm_chain chain;
    pm_chain_link *link; // [chain.n]
    link_start *start;   // [chain.n]
    bool equilibrated;
    double total_entropy; // J/K, if equilibrated
} pendulum_chain;

static const char *const chain_conserved[] = {"energy", "angular momentum"};

// Reads how many equal links an item of the list stands for.
static pm_status read_count(pm_yaml map, int *count) {
    pm_yaml value = pm_yaml_get(map, "count");
    *count = 1;
    return pm_yaml_exists(value) ? pm_yaml_int(value, 1, MOST_LINKS, count) : PM_OK;
}

// Reads an item of the list, which stands for the links from number k on. `count` receives how many
// these are.
static pm_status read_links(pm_yaml map, int k, pm_arena *arena, pendulum_chain *system,
                            int *count) {
    pm_yaml position, momentum, temperature;
    link_start *start = &system->start[k];
    double spacing[2] = {0, 0};
    PM_TRY(read_count(map, count));
    const pm_yaml_key keys[] = {
        LINK_KEYS(&system->link[k]),
        {PM_YAML_VALUE("position", &position), .required = true},
        {PM_YAML_VALUE("momentum", &momentum), .required = true},
        {PM_YAML_VALUE("temperature", &temperature), .required = !system->equilibrated},
        {PM_YAML_VALUE("count", NULL)}, // read_count
        {PM_YAML_VECTOR("spacing", spacing, 2), .required = *count > 1},
        {0}};
    PM_TRY(pm_yaml_read(map, arena, keys));
    PM_TRY(read_spread(position, 2, arena, &start->position));
    PM_TRY(read_spread(momentum, 2, arena, &start->momentum));
    if (!system->equilibrated) {
        PM_TRY(read_spread(temperature, 1, arena, &start->temperature));
    } else if (pm_yaml_exists(temperature)) {
        return pm_yaml_fail(temperature, "`total_entropy` already sets the temperatures");
    }
    for (int i = 1; i < *count; ++i) {
        system->link[k + i] = system->link[k];
        start[i] = *start;
        start[i].position.mean[0] += i * spacing[0];
        start[i].position.mean[1] += i * spacing[1];
    }
    return PM_OK;
}

static void chain_rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(&((const pendulum_chain *)data)->chain, z, zdot);
}

static void chain_draw(const void *data, pm_rng *rng, double *z) {
    const pendulum_chain *system = data;
    const pm_chain *chain = &system->chain;
    double *T = z + pm_chain_s(chain, 0); // in the place of the entropies
    for (int k = 0; k < chain->n; ++k) {
        const link_start *start = &system->start[k];
        for (int i = 0; i < 2; ++i) {
            z[pm_chain_q(k) + i] = draw_normal(rng, &start->position, i);
            z[pm_chain_p(chain, k) + i] = draw_normal(rng, &start->momentum, i);
        }
        T[k] = draw_normal(rng, &start->temperature, 0);
    }
    if (system->equilibrated) {
        pm_chain_equilibrate(chain, system->total_entropy, z);
    } else {
        pm_chain_set_temperatures(chain, T, z);
    }
}

static void chain_conserve(const void *data, const double *z, double *value) {
    const pm_chain *chain = &((const pendulum_chain *)data)->chain;
    value[0] = pm_chain_energy(chain, z);
    value[1] = pm_chain_angular_momentum(chain, z);
}

static double chain_entropy(const void *data, const double *z) {
    return pm_chain_entropy(&((const pendulum_chain *)data)->chain, z);
}

pm_status pm_pendulum_chain_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    pendulum_chain *system = pm_arena_alloc(arena, sizeof *system);
    PM_TRY(pm_arena_status(arena, "a chain of pendula"));
    pm_chain *chain = &system->chain;
    pm_yaml links;
    int n = 0;
    const pm_yaml_key keys[] = {
        CONDUCTION_KEYS(chain),
        {PM_YAML_DOUBLE("total_entropy", &system->total_entropy, -1e9, 1e9)},
        {PM_YAML_VALUE("links", &links), .required = true},
        {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    system->equilibrated = pm_yaml_exists(pm_yaml_get(block, "total_entropy"));
    for (int i = 0; pm_yaml_is_list(links) && i < pm_yaml_count(links); ++i) {
        int count;
        PM_TRY(read_count(pm_yaml_item(links, i), &count));
        n = count <= MOST_LINKS - n ? n + count : MOST_LINKS + 1;
    }
    if (n < 1 || n > MOST_LINKS) {
        return pm_yaml_fail(links, "expected a list of 1 to %d links", MOST_LINKS);
    }
    chain->n = n;
    chain->link = system->link = pm_arena_array(arena, (size_t)n, sizeof *system->link);
    system->start = pm_arena_array(arena, (size_t)n, sizeof *system->start);
    PM_TRY(pm_arena_status(arena, "%d links", n));
    for (int i = 0, k = 0, count; i < pm_yaml_count(links); ++i, k += count) {
        PM_TRY(read_links(pm_yaml_item(links, i), k, arena, system, &count));
    }
    // The columns are q1x q1y .. p1x p1y .. s1 .., as in the public data.
    const char **column = pm_arena_array(arena, (size_t)(5 * n), sizeof *column);
    char *units = pm_arena_alloc(arena, (size_t)(5 * n) * sizeof "kg m/s;"), *end = units;
    PM_TRY(pm_arena_status(arena, "%d columns", 5 * n));
    for (int i = 0; i < 5 * n; ++i) {
        const char kind = i < 2 * n ? 'q' : i < 4 * n ? 'p' : 's';
        const char *axis = kind == 's' ? "" : i % 2 == 0 ? "x" : "y";
        const int link = kind == 's' ? i - 4 * n : i % (2 * n) / 2;
        const char *unit = kind == 'q' ? "m" : kind == 'p' ? "kg m/s" : "J/K";
        column[i] = pm_arena_printf(arena, "%c%d%s", kind, link + 1, axis);
        end = stpcpy(stpcpy(end, i > 0 ? ";" : ""), unit);
    }
    // Links with equal constants are described together.
    const char *text = pm_arena_printf(arena, "conductivity %g W/K, reference temperature %g K",
                                       chain->conductivity, chain->reference_temperature);
    for (int k = 0, count; k < n; k += count) {
        const pm_chain_link *link = &chain->link[k];
        char last[32] = "";
        for (count = 1; k + count < n && memcmp(link, link + count, sizeof *link) == 0;) {
            ++count;
        }
        if (count > 1) {
            snprintf(last, sizeof last, " to %d", k + count);
        }
        text = pm_arena_printf(arena, "%s; link %d%s: m %g kg, C %g J, l0 %g m, b %g J/K, c %g J/K",
                               text, k + 1, last, link->mass, link->C, link->l0, link->b, link->c);
    }
    model->parameters = text;
    model->title = "Chain of thermoelastic pendula";
    model->ncolumn = 5 * n;
    model->column = column;
    model->units = units;
    model->ode = (pm_ode){
        .nz = 5 * n, .rate = chain_rate, .data = system, .pattern = pm_chain_pattern(chain, arena)};
    model->draw = chain_draw;
    model->nconserved = 2;
    model->conserved = chain_conserved;
    model->conserve = chain_conserve;
    model->entropy = chain_entropy;
    return pm_arena_status(arena, "the description of a chain");
}

// --- one driven link ---
// One driven thermoelastic link (chain.h): its pivot moves with the velocity v, a force F acts on
// its mass, and its spring conducts heat to a bath. In coordinates relative to the pivot:
//     qdot = p/m - v,   pdot = F - f q/|q|,   sdot = K (T_bath/T - 1)
// The velocity, the force and the temperature of the bath are sums of sines, whose frequencies and
// phases are drawn for each trajectory. Each sine is an oscillator in the state, which makes the
// problem autonomous:
//     v = sum_k a_k,   a_k dot = w_k b_k,   b_k dot = -w_k a_k,   w_k dot = 0
// Two more components count the energy and the entropy that the link has given to its surroundings.
// With them energy is conserved and entropy never falls.

// Components of the state: first the columns, then the oscillators a, b, w by sine and load.
enum { Q, P = 2, S = 4, V, F = 7, T_BATH = 9, NCOLUMN, W_ENERGY = NCOLUMN, W_ENTROPY, OSCILLATORS };
#define NLOAD (NCOLUMN - V)

typedef struct driven_link {
    pm_chain_link link;
    pm_chain chain; // of this link
    normal_spread position, momentum, temperature;
    int nsine;
    double frequency[2];   // rad/s, drawn uniformly between these
    double mean[NLOAD];    // of v, F and the temperature of the bath
    double typical[NLOAD]; // root mean square deviations from the mean
} driven_link;

static const char *const driven_columns[NCOLUMN] = {"qx", "qy", "px", "py", "s",
                                                    "vx", "vy", "fx", "fy", "T"};
static const char *const driven_conserved[] = {"energy"};

static void driven_rate(const void *data, const double *z, double *zdot) {
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

static void driven_draw(const void *data, pm_rng *rng, double *z) {
    const driven_link *system = data;
    const double *frequency = system->frequency;
    double T = draw_normal(rng, &system->temperature, 0);
    for (int i = 0; i < 2; ++i) {
        z[Q + i] = draw_normal(rng, &system->position, i);
        z[P + i] = draw_normal(rng, &system->momentum, i);
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

static void driven_conserve(const void *data, const double *z, double *value) {
    value[0] = pm_chain_energy(&((const driven_link *)data)->chain, z) + z[W_ENERGY];
}

static double driven_entropy(const void *data, const double *z) {
    (void)data;
    return z[S] + z[W_ENTROPY];
}

pm_status pm_driven_link_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    driven_link *system = pm_arena_alloc(arena, sizeof *system);
    PM_TRY(pm_arena_status(arena, "a driven link"));
    pm_yaml map, load, position, momentum, temperature, of_bath;
    normal_spread bath;
    double velocity, force;
    const pm_yaml_key keys[] = {CONDUCTION_KEYS(&system->chain),
                                {PM_YAML_VALUE("link", &map), .required = true},
                                {PM_YAML_VALUE("load", &load), .required = true},
                                {0}};
    const pm_yaml_key link_keys[] = {LINK_KEYS(&system->link),
                                     {PM_YAML_VALUE("position", &position), .required = true},
                                     {PM_YAML_VALUE("momentum", &momentum), .required = true},
                                     {PM_YAML_VALUE("temperature", &temperature), .required = true},
                                     {0}};
    const pm_yaml_key load_keys[] = {
        {PM_YAML_INT("sines", &system->nsine, 1, MAX_SINES), .required = true},
        {PM_YAML_VECTOR("frequency", system->frequency, 2), .required = true},
        {PM_YAML_DOUBLE("velocity", &velocity, 0, 1e9), .required = true},
        {PM_YAML_DOUBLE("force", &force, 0, 1e9), .required = true},
        {PM_YAML_VALUE("temperature", &of_bath), .required = true},
        {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    system->chain.n = 1;
    system->chain.link = &system->link;
    PM_TRY(pm_yaml_read(map, arena, link_keys));
    PM_TRY(read_spread(position, 2, arena, &system->position));
    PM_TRY(read_spread(momentum, 2, arena, &system->momentum));
    PM_TRY(read_spread(temperature, 1, arena, &system->temperature));
    PM_TRY(pm_yaml_read(load, arena, load_keys));
    PM_TRY(read_spread(of_bath, 1, arena, &bath));
    const double typical[NLOAD] = {velocity, velocity, force, force, bath.deviation[0]};
    memcpy(system->typical, typical, sizeof typical);
    system->mean[NLOAD - 1] = bath.mean[0];
    const pm_chain_link *link = &system->link;
    model->parameters = pm_arena_printf(
        arena,
        "conductivity %g W/K, reference temperature %g K; m %g kg, C %g J, l0 %g m, b %g J/K, "
        "c %g J/K; %d sines of %g to %g rad/s: %g m/s, %g N, %g K about %g K",
        system->chain.conductivity, system->chain.reference_temperature, link->mass, link->C,
        link->l0, link->b, link->c, system->nsine, system->frequency[0], system->frequency[1],
        system->typical[0], system->typical[2], system->typical[4], system->mean[4]);
    model->title = "A thermoelastic link under a load";
    model->ode = (pm_ode){
        .nz = OSCILLATORS + 3 * NLOAD * system->nsine, .rate = driven_rate, .data = system};
    model->ncolumn = NCOLUMN;
    model->column = driven_columns;
    model->units = "m;m;kg m/s;kg m/s;J/K;m/s;m/s;N;N;K";
    model->draw = driven_draw;
    model->nconserved = 1;
    model->conserved = driven_conserved;
    model->conserve = driven_conserve;
    model->entropy = driven_entropy;
    return pm_arena_status(arena, "the description of a driven link");
}

// The simulator of a chain of thermoelastic pendula: its configuration and its initial states.
// Positions and momenta are drawn normally and independently. Entropies follow from temperatures
// drawn per link, or, with `total_entropy`, from one common temperature.
#include "truth/truth.h"

#include "truth/link.h"
#include "truth/numbers.h"

typedef struct pendulum_chain {
    pm_chain chain;
    pm_spread position[PM_CHAIN_MAX_LINKS];    // m, absolute
    pm_spread momentum[PM_CHAIN_MAX_LINKS];    // kg m/s
    pm_spread temperature[PM_CHAIN_MAX_LINKS]; // K; unused if equilibrated
    bool equilibrated;
    double total_entropy; // J/K, if equilibrated
} pendulum_chain;

static const char *const conserved[] = {"energy", "angular momentum"};

static pm_status read_link(pm_yaml map, int k, pm_arena *arena, pendulum_chain *system) {
    static const char *const keys[] = {"mass",     "C",        "l0",          "b", "c",
                                       "position", "momentum", "temperature", NULL};
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_truth_link(map, &system->chain.link[k]));
    PM_TRY(pm_truth_spread(map, "position", 2, arena, &system->position[k]));
    PM_TRY(pm_truth_spread(map, "momentum", 2, arena, &system->momentum[k]));
    if (!system->equilibrated) {
        return pm_truth_spread(map, "temperature", 1, arena, &system->temperature[k]);
    }
    pm_yaml temperature = pm_yaml_get(map, "temperature");
    return pm_yaml_exists(temperature)
               ? pm_yaml_fail(temperature, "`total_entropy` already sets the temperatures")
               : PM_OK;
}

static pm_status read_system(pm_yaml block, pm_arena *arena, pendulum_chain *system) {
    static const char *const keys[] = {"reference_temperature", "conductivity", "total_entropy",
                                       "links", NULL};
    pm_chain *chain = &system->chain;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(
        pm_truth_number(block, "reference_temperature", 1e-3, 1e6, &chain->reference_temperature));
    PM_TRY(pm_truth_number(block, "conductivity", 0, 1e9, &chain->conductivity));
    system->equilibrated = pm_yaml_exists(pm_yaml_get(block, "total_entropy"));
    if (system->equilibrated) {
        PM_TRY(pm_truth_number(block, "total_entropy", -1e9, 1e9, &system->total_entropy));
    }
    pm_yaml links;
    PM_TRY(pm_yaml_require(block, "links", &links));
    chain->n = pm_yaml_count(links);
    if (!pm_yaml_is_list(links) || chain->n < 1 || chain->n > PM_CHAIN_MAX_LINKS) {
        return pm_yaml_fail(links, "expected a list of 1 to %d links", PM_CHAIN_MAX_LINKS);
    }
    for (int k = 0; k < chain->n; ++k) {
        PM_TRY(read_link(pm_yaml_item(links, k), k, arena, system));
    }
    return PM_OK;
}

// --- the functions of the model ---

static void rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(&((const pendulum_chain *)data)->chain, z, zdot);
}

static void draw(const void *data, pm_rng *rng, double *z) {
    const pendulum_chain *system = data;
    const pm_chain *chain = &system->chain;
    double T[PM_CHAIN_MAX_LINKS];
    for (int k = 0; k < chain->n; ++k) {
        for (int i = 0; i < 2; ++i) {
            z[pm_chain_q(k) + i] = pm_spread_draw(rng, &system->position[k], i);
            z[pm_chain_p(chain, k) + i] = pm_spread_draw(rng, &system->momentum[k], i);
        }
        T[k] = pm_spread_draw(rng, &system->temperature[k], 0);
    }
    if (system->equilibrated) {
        pm_chain_equilibrate(chain, system->total_entropy, z);
    } else {
        pm_chain_set_temperatures(chain, T, z);
    }
}

static void conserve(const void *data, const double *z, double *value) {
    const pm_chain *chain = &((const pendulum_chain *)data)->chain;
    value[0] = pm_chain_energy(chain, z);
    value[1] = pm_chain_angular_momentum(chain, z);
}

static double entropy(const void *data, const double *z) {
    return pm_chain_entropy(&((const pendulum_chain *)data)->chain, z);
}

// --- its description ---

// Names the columns q1x q1y .. p1x p1y .. s1 .., as in the public data.
static pm_status name_columns(const pm_chain *chain, pm_arena *arena, pm_truth_model *model) {
    const int n = chain->n;
    const char **column = pm_arena_array(arena, (size_t)(5 * n), sizeof *column);
    const char *units = "";
    for (int i = 0; column != NULL && i < 5 * n; ++i) {
        const char kind = i < 2 * n ? 'q' : i < 4 * n ? 'p' : 's';
        const char *axis = kind == 's' ? "" : i % 2 == 0 ? "x" : "y";
        const int link = kind == 's' ? i - 4 * n : i % (2 * n) / 2;
        const char *unit = kind == 'q' ? "m" : kind == 'p' ? "kg m/s" : "J/K";
        column[i] = pm_arena_printf(arena, "%c%d%s", kind, link + 1, axis);
        units = pm_arena_printf(arena, "%s%s%s", units, i > 0 ? ";" : "", unit);
        if (column[i] == NULL || units == NULL) {
            return pm_fail(PM_ENOMEM, "truth: out of memory");
        }
    }
    model->ncolumn = 5 * n;
    model->column = column;
    model->units = units;
    return column == NULL ? pm_fail(PM_ENOMEM, "truth: out of memory") : PM_OK;
}

static pm_status describe(const pm_chain *chain, pm_arena *arena, pm_truth_model *model) {
    const char *text = pm_arena_printf(arena, "conductivity %g W/K, reference temperature %g K",
                                       chain->conductivity, chain->reference_temperature);
    for (int k = 0; text != NULL && k < chain->n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        text = pm_arena_printf(arena, "%s; link %d: m %g kg, C %g J, l0 %g m, b %g J/K, c %g J/K",
                               text, k + 1, link->mass, link->C, link->l0, link->b, link->c);
    }
    model->parameters = text;
    model->title = "Chain of thermoelastic pendula";
    return text == NULL ? pm_fail(PM_ENOMEM, "truth: out of memory") : PM_OK;
}

pm_status pm_pendulum_chain_read(pm_yaml block, pm_arena *arena, pm_truth_model *model) {
    pendulum_chain *system = pm_arena_alloc(arena, sizeof *system);
    if (system == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    PM_TRY(read_system(block, arena, system));
    PM_TRY(name_columns(&system->chain, arena, model));
    PM_TRY(describe(&system->chain, arena, model));
    model->ode = (pm_ode){.nz = 5 * system->chain.n, .rate = rate, .data = system};
    model->draw = draw;
    model->nconserved = 2;
    model->conserved = conserved;
    model->conserve = conserve;
    model->entropy = entropy;
    return PM_OK;
}

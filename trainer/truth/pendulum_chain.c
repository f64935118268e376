// The simulator of a chain of thermoelastic pendula: its configuration and its initial states.
// Positions and momenta are drawn normally and independently. Entropies follow from temperatures
// drawn per link, or, with `total_entropy`, from one common temperature.
#include "truth/truth.h"

#include <stdio.h>
#include <string.h>

#include "truth/link.h"
#include "truth/numbers.h"

#define MOST_LINKS 100000

// What a link starts with.
typedef struct link_start {
    pm_spread position;    // m, absolute
    pm_spread momentum;    // kg m/s
    pm_spread temperature; // K; unused if equilibrated
} link_start;

typedef struct pendulum_chain {
    pm_chain chain;
    pm_chain_link *link; // [chain.n]
    link_start *start;   // [chain.n]
    bool equilibrated;
    double total_entropy; // J/K, if equilibrated
} pendulum_chain;

static const char *const conserved[] = {"energy", "angular momentum"};

// Reads how many equal links an item of the list stands for.
static pm_status read_count(pm_yaml map, int *count) {
    pm_yaml value = pm_yaml_get(map, "count");
    *count = 1;
    return pm_yaml_exists(value) ? pm_yaml_int(value, 1, MOST_LINKS, count) : PM_OK;
}

static pm_status read_start(pm_yaml map, bool equilibrated, pm_arena *arena, link_start *start) {
    PM_TRY(pm_truth_spread(map, "position", 2, arena, &start->position));
    PM_TRY(pm_truth_spread(map, "momentum", 2, arena, &start->momentum));
    if (!equilibrated) {
        return pm_truth_spread(map, "temperature", 1, arena, &start->temperature);
    }
    pm_yaml temperature = pm_yaml_get(map, "temperature");
    return pm_yaml_exists(temperature)
               ? pm_yaml_fail(temperature, "`total_entropy` already sets the temperatures")
               : PM_OK;
}

// Reads an item of the list, which stands for the links from number k on. `count` receives how many
// these are.
static pm_status read_links(pm_yaml map, int k, pm_arena *arena, pendulum_chain *system,
                            int *count) {
    static const char *const keys[] = {"mass",  "C",        "l0",       "b",
                                       "c",     "position", "momentum", "temperature",
                                       "count", "spacing",  NULL};
    double spacing[2] = {0, 0};
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(read_count(map, count));
    if (*count > 1) {
        PM_TRY(pm_truth_numbers(map, "spacing", 2, arena, spacing));
    }
    PM_TRY(pm_truth_link(map, &system->link[k]));
    PM_TRY(read_start(map, system->equilibrated, arena, &system->start[k]));
    for (int i = 1; i < *count; ++i) {
        system->link[k + i] = system->link[k];
        system->start[k + i] = system->start[k];
        system->start[k + i].position.mean[0] += i * spacing[0];
        system->start[k + i].position.mean[1] += i * spacing[1];
    }
    return PM_OK;
}

// Counts the links and makes room for them.
static pm_status make_links(pm_yaml links, pm_arena *arena, pendulum_chain *system) {
    int n = 0;
    for (int i = 0; pm_yaml_is_list(links) && i < pm_yaml_count(links); ++i) {
        int count;
        PM_TRY(read_count(pm_yaml_item(links, i), &count));
        n = count <= MOST_LINKS - n ? n + count : MOST_LINKS + 1;
    }
    if (n < 1 || n > MOST_LINKS) {
        return pm_yaml_fail(links, "expected a list of 1 to %d links", MOST_LINKS);
    }
    system->chain.n = n;
    system->chain.link = system->link = pm_arena_array(arena, (size_t)n, sizeof *system->link);
    system->start = pm_arena_array(arena, (size_t)n, sizeof *system->start);
    return system->link == NULL || system->start == NULL
               ? pm_fail(PM_ENOMEM, "truth: out of memory")
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
    PM_TRY(make_links(links, arena, system));
    for (int i = 0, k = 0, count; i < pm_yaml_count(links); ++i, k += count) {
        PM_TRY(read_links(pm_yaml_item(links, i), k, arena, system, &count));
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
    double *T = z + pm_chain_s(chain, 0); // in the place of the entropies
    for (int k = 0; k < chain->n; ++k) {
        const link_start *start = &system->start[k];
        for (int i = 0; i < 2; ++i) {
            z[pm_chain_q(k) + i] = pm_spread_draw(rng, &start->position, i);
            z[pm_chain_p(chain, k) + i] = pm_spread_draw(rng, &start->momentum, i);
        }
        T[k] = pm_spread_draw(rng, &start->temperature, 0);
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
    char *units = pm_arena_alloc(arena, (size_t)(5 * n) * sizeof "kg m/s;"), *end = units;
    if (column == NULL || units == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    for (int i = 0; i < 5 * n; ++i) {
        const char kind = i < 2 * n ? 'q' : i < 4 * n ? 'p' : 's';
        const char *axis = kind == 's' ? "" : i % 2 == 0 ? "x" : "y";
        const int link = kind == 's' ? i - 4 * n : i % (2 * n) / 2;
        const char *unit = kind == 'q' ? "m" : kind == 'p' ? "kg m/s" : "J/K";
        column[i] = pm_arena_printf(arena, "%c%d%s", kind, link + 1, axis);
        end = stpcpy(stpcpy(end, i > 0 ? ";" : ""), unit);
        if (column[i] == NULL) {
            return pm_fail(PM_ENOMEM, "truth: out of memory");
        }
    }
    model->ncolumn = 5 * n;
    model->column = column;
    model->units = units;
    return PM_OK;
}

// Returns the number of links from number k on that have the constants of link k.
static int count_equal(const pm_chain *chain, int k) {
    int count = 1;
    while (k + count < chain->n &&
           memcmp(&chain->link[k], &chain->link[k + count], sizeof *chain->link) == 0) {
        ++count;
    }
    return count;
}

static pm_status describe(const pm_chain *chain, pm_arena *arena, pm_truth_model *model) {
    const char *text = pm_arena_printf(arena, "conductivity %g W/K, reference temperature %g K",
                                       chain->conductivity, chain->reference_temperature);
    for (int k = 0, count; text != NULL && k < chain->n; k += count) {
        const pm_chain_link *link = &chain->link[k];
        char last[32] = "";
        count = count_equal(chain, k);
        if (count > 1) {
            snprintf(last, sizeof last, " to %d", k + count);
        }
        text = pm_arena_printf(arena, "%s; link %d%s: m %g kg, C %g J, l0 %g m, b %g J/K, c %g J/K",
                               text, k + 1, last, link->mass, link->C, link->l0, link->b, link->c);
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
    model->ode = (pm_ode){.nz = 5 * system->chain.n,
                          .rate = rate,
                          .data = system,
                          .pattern = pm_chain_pattern(&system->chain, arena)};
    if (model->ode.pattern == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    model->draw = draw;
    model->nconserved = 2;
    model->conserved = conserved;
    model->conserve = conserve;
    model->entropy = entropy;
    return PM_OK;
}

// Computes statistics of the features and operators of all models by evaluating their graphs on the
// training data.
#include "fit/normalization.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/magnitudes.h"
#include "graph/program.h"
#include "model/training_range.h"
#include "sim/step_graph.h"

#define MAX_SETS 256
// A feature that varies by less than this fraction of its mean counts as constant and gets
// deviation 1.
#define SMALLEST_DEVIATION 1e-12

// The most numbers in the windows that are examined. If there are more, some windows are chosen.
#define MOST_NUMBERS 100000000
// A typical difference of temperature that drives heat, relative to the temperature.
#define TYPICAL_WARMTH 0.05

// One set of constants: the parameters to fill, and the node that computes the data.
typedef struct set {
    pm_normaliser_kind kind;
    pm_param_entry *mean, *deviation; // all but features use `deviation` alone
    pm_node node;
    int count;                 // expressions
    int size[PM_MAX_FEATURES]; // components of each
    int twin[PM_MAX_FEATURES]; // of a scale: the group of the same name at the other end, or -1
    pm_group_magnitude magnitude[PM_MAX_FEATURES]; // of a scale, where they are known, else 0
    bool heated[PM_MAX_FEATURES];                  // of a scale: takes up heat
    bool input[PM_MAX_FEATURES];                   // of a scale: a boundary input has it
    pm_node effort; // co-energies of the groups of a boundary input, side by side, or PM_NO_NODE
} set;

typedef struct collection {
    pm_graph *g;
    pm_params *params; // of the component being visited
    int part, port;    // which it is, or -1
    const pm_magnitudes *magnitudes;
    bool plain;     // scales follow the size of states alone
    bool strengths; // only features of strengths that contain co-energies
    int count;
    set set[MAX_SETS];
} collection;

static pm_param_entry *entry_of(const collection *c, const char *prefix, const char *name) {
    char full[160];
    snprintf(full, sizeof full, "%s.%s", prefix, name);
    return pm_params_find(c->params, full);
}

static bool is_scale(pm_normaliser_kind kind) {
    return kind == PM_NORMALISE_SCALE || kind == PM_NORMALISE_FRICTION || kind == PM_NORMALISE_RATE;
}

// Looks up the magnitude of a group of a subsystem, of either end of a port, or of the own end of a
// boundary term, which the prefix of its parameters names.
static bool find_magnitude(const collection *c, const pm_normaliser *n, const char *name,
                           pm_group_magnitude *result) {
    if (c->part >= 0) {
        return pm_magnitudes_of_part(c->magnitudes, c->part, name, result);
    }
    char full[PM_MAX_NAME];
    const bool own = strncmp(name, "own.", 4) == 0;
    snprintf(full, sizeof full, "%c.%s", own ? n->prefix[0] : name[0], name + (own ? 4 : 2));
    return pm_magnitudes_of_port(c->magnitudes, c->port, full, result);
}

// Builds the co-energies of those groups of a port that belong to a boundary input.
static void find_efforts(const collection *c, const pm_normaliser *n, set *s) {
    char name[PM_MAX_FEATURES][PM_MAX_NAME];
    const char *list[PM_MAX_FEATURES];
    int count = 0;
    for (int i = 0; i < n->count && c->port >= 0; ++i) {
        const char *group = n->expression[i];
        const bool prefixed = (group[0] == 'a' || group[0] == 'b') && group[1] == '.';
        s->input[i] =
            prefixed && c->magnitudes->scene->physics.port[c->port].subsystem[group[0] == 'b'] < 0;
        if (s->input[i]) {
            snprintf(name[count], PM_MAX_NAME, "%.2sdE.%s", group, group + 2);
            list[count] = name[count];
            ++count;
        }
    }
    if (count > 0) {
        const pm_node node = pm_features_build(c->g, count, list, n->symbols);
        s->effort =
            pm_broadcast_to(c->g, node, (pm_shape){true, 1, pm_graph_shape(c->g, node).cols});
    }
}

static pm_status collect(void *context, const pm_normaliser *n) {
    collection *c = context;
    static const char suffix[] = ".strength";
    const size_t length = strlen(n->prefix);
    bool driven = false; // a strength with features that contain co-energies or forces
    for (int i = 0; i < n->count; ++i) {
        driven = driven || strstr(n->expression[i], "dE.") != NULL ||
                 pm_feature_mentions(n->expression[i], "force");
    }
    driven = driven && n->kind == PM_NORMALISE_FEATURES && length >= sizeof suffix &&
             strcmp(n->prefix + length + 1 - sizeof suffix, suffix) == 0;
    if (c->strengths && !driven) {
        return PM_OK;
    }
    if (c->count == MAX_SETS) {
        return pm_fail(PM_ECONFIG, "more than %d networks and operators", MAX_SETS);
    }
    static const char *const name[] = {"deviation", "scale", "along", "scale", "scale", "unit"};
    if (n->kind == PM_NORMALISE_UNIT) {
        // Fixes the unit of an energy network of a subsystem or of a boundary term. The unit of an
        // entropy is that of the energy divided by a temperature.
        const bool boundary = c->part < 0;
        const int part =
            boundary ? c->magnitudes->scene->physics.port[c->port].subsystem[n->prefix[0] == 'b']
                     : c->part;
        const bool entropy = strncmp(n->prefix + (boundary ? 2 : 0), "entropy", 7) == 0;
        const double energy = part < 0 || c->plain ? 1 : c->magnitudes->energy[part];
        *entry_of(c, n->prefix, "unit")->value = entropy ? energy / PM_DEFAULT_TEMPERATURE : energy;
        return PM_OK;
    }
    set *s = &c->set[c->count++];
    *s = (set){.kind = n->kind, .count = n->count, .effort = PM_NO_NODE};
    s->mean = n->kind == PM_NORMALISE_FEATURES ? entry_of(c, n->prefix, "mean") : NULL;
    s->deviation = entry_of(c, n->prefix, name[n->kind]);
    for (int i = 0; i < n->count; ++i) {
        PM_TRY(pm_feature_size(n->expression[i], n->symbols, &s->size[i]));
        // The group of the same name at the other end of a port.
        const char *dot = is_scale(n->kind) ? strchr(n->expression[i], '.') : NULL;
        s->twin[i] = -1;
        for (int k = 0; k < n->count && dot != NULL && s->twin[i] < 0; ++k) {
            const char *other = strchr(n->expression[k], '.');
            s->twin[i] = k != i && other != NULL && strcmp(dot, other) == 0 ? k : -1;
        }
    }
    if (is_scale(n->kind) && !c->plain) {
        // A group of a boundary input has the magnitude of the group of the same name at the other
        // end.
        for (int i = 0; i < n->count; ++i) {
            const char *group[2] = {n->expression[i],
                                    s->twin[i] < 0 ? NULL : n->expression[s->twin[i]]};
            bool found = false;
            for (int k = 0; k < 2 && group[k] != NULL && !found; ++k) {
                found = find_magnitude(c, n, group[k], &s->magnitude[i]);
            }
            for (int k = 0; k < n->nheats; ++k) {
                s->heated[i] = s->heated[i] || strcmp(n->heats[k], n->expression[i]) == 0;
            }
            if (s->heated[i] && found) {
                *entry_of(c, n->prefix, "temperature")->value = s->magnitude[i].temperature;
            }
        }
        find_efforts(c, n, s);
    }
    const pm_node node = pm_features_build(c->g, n->count, n->expression, n->symbols);
    s->node = pm_broadcast_to(c->g, node, (pm_shape){true, 1, pm_graph_shape(c->g, node).cols});
    return PM_OK;
}

// --- the kinds of statistics, over value [count][cols] ---

// Returns the root mean square over components [first, first + size).
static double pooled_rms(const double *value, int count, int cols, int first, int size) {
    double square = 0;
    for (int i = 0; i < count; ++i) {
        for (int c = first; c < first + size; ++c) {
            const double x = value[(size_t)i * (size_t)cols + (size_t)c];
            square += x * x / ((double)count * size);
        }
    }
    return sqrt(square);
}

// Returns the scale of group k of a subsystem for groups of the frequency `frequency`.
static double scale_by_rates(const set *s, int k, double frequency, bool heats) {
    const pm_group_magnitude *m = &s->magnitude[k];
    if (s->kind == PM_NORMALISE_RATE) {
        return m->rate;
    }
    if (s->heated[k]) {
        return sqrt(m->rate * m->dS / TYPICAL_WARMTH);
    }
    return m->deviation * sqrt(frequency / m->energy) *
           (s->kind == PM_NORMALISE_FRICTION && !heats ? sqrt(PM_DEFAULT_TEMPERATURE) : 1);
}

static void write_scale(const set *s, int group, double scale) {
    int first = 0;
    for (int k = 0; k < group; ++k) {
        first += s->size[k];
    }
    for (int c = first; c < first + s->size[group]; ++c) {
        s->deviation->value[c] = scale > 0 && isfinite(scale) ? scale : 1;
    }
}

// Fixes the scales of the groups of a boundary input, which has no state: their co-energies have as
// much power as those of the subsystem at the other end, whatever the units of both. `root` is the
// root of that power, and `heat` the scale of an entropy there. An input without a co-energy has
// the scale of the group of the same name.
static void fix_inputs(const set *s, const double *effort, int count, double root, double heat,
                       double frequency, bool heats) {
    int cols = 0;
    for (int k = 0; k < s->count; ++k) {
        cols += s->input[k] ? s->size[k] : 0;
    }
    for (int k = 0, first = 0; k < s->count; first += s->input[k] ? s->size[k] : 0, ++k) {
        const double size = s->input[k] ? pooled_rms(effort, count, cols, first, s->size[k]) : 0;
        if (s->input[k] && s->heated[k]) {
            write_scale(s, k, heat);
        } else if (s->input[k]) {
            write_scale(
                s, k, size > 0 && root > 0 ? root / size : scale_by_rates(s, k, frequency, heats));
        }
    }
}

static void fix(const set *s, bool by_rates, const double *value, const double *effort, int count,
                int cols) {
    switch (s->kind) {
    case PM_NORMALISE_FEATURES:
        for (int c = 0; c < cols; ++c) {
            double mean = 0, square = 0;
            for (int i = 0; i < count; ++i) {
                mean += value[(size_t)i * (size_t)cols + (size_t)c] / count;
            }
            for (int i = 0; i < count; ++i) {
                const double difference = value[(size_t)i * (size_t)cols + (size_t)c] - mean;
                square += difference * difference / count;
            }
            s->mean->value[c] = mean;
            s->deviation->value[c] =
                sqrt(square) > SMALLEST_DEVIATION * fabs(mean) ? sqrt(square) : 1;
        }
        return;
    case PM_NORMALISE_ALONG:
        for (int k = 0, first = 0; k < s->count; first += s->size[k++]) {
            const double rms = pooled_rms(value, count, cols, first, s->size[k]);
            s->deviation->value[k] = (rms > 0 ? rms : 1) * sqrt((double)s->size[k]);
        }
        return;
    case PM_NORMALISE_SCALE:
    case PM_NORMALISE_FRICTION:
    case PM_NORMALISE_RATE:
    case PM_NORMALISE_UNIT:
        break;
    }

    bool measured = false;
    for (int k = 0; k < s->count; ++k) {
        measured = measured || s->magnitude[k].deviation > 0;
    }
    if (by_rates && (measured)) {
        // Fixes the scales k of an operator such that matrix entries of size 1 give rates as large
        // as those of the data. With the frequency w of the groups, L_ij dE_j = k_i k_j E/x_j
        // equals w x_i for k = x sqrt(w/E). The same holds for friction. Irreversible operators in
        // the metric of all groups are driven by dS, which is smaller than dE by a temperature.
        // Conduction of k^2 W/K moves entropy at the rate k^2 dT/T.
        double frequency = 0, known = 0, root = 0, driven = 0, heat = 0, heated = 0;
        bool heats = false;
        for (int k = 0; k < s->count; ++k) {
            const pm_group_magnitude *m = &s->magnitude[k];
            heats = heats || s->heated[k];
            if (m->deviation > 0 && !s->heated[k]) {
                frequency += m->rate / m->deviation;
                ++known;
            }
        }
        frequency = known > 0 && frequency > 0 ? frequency / known : 1;
        for (int k = 0; k < s->count; ++k) {
            const pm_group_magnitude *m = &s->magnitude[k];
            const double scale = scale_by_rates(s, k, frequency, heats);
            write_scale(s, k, scale);
            if (!s->input[k] && m->deviation > 0) {
                root += s->heated[k] ? 0 : scale * m->energy / m->deviation;
                driven += !s->heated[k];
                heat += s->heated[k] ? scale : 0;
                heated += s->heated[k];
            }
        }
        if (effort != NULL && s->kind != PM_NORMALISE_RATE) {
            fix_inputs(s, effort, count, driven > 0 ? root / driven : 0,
                       heated > 0 ? heat / heated : 0, frequency, heats);
        }
    } else {
        double typical[PM_MAX_FEATURES], square = 0;
        for (int k = 0, first = 0; k < s->count; first += s->size[k++]) {
            typical[k] = pooled_rms(value, count, cols, first, s->size[k]);
        }
        for (int k = 0, first = 0; k < s->count; first += s->size[k++]) {
            // A boundary input has no state. Its end gets the scale of the group at the other end.
            const double own = typical[k] > 0 || s->twin[k] < 0 ? typical[k] : typical[s->twin[k]];
            const double rms = own > 0 ? own : 1;
            for (int c = first; c < first + s->size[k]; ++c) {
                s->deviation->value[c] = rms;
                square += rms * rms / cols;
            }
        }
        for (int c = 0; c < cols; ++c) {
            s->deviation->value[c] /= sqrt(square);
        }
    }
}

// --- running the graphs ---

static pm_status run_and_fix(collection *c, pm_node window, const pm_samples *samples) {
    if (c->count == 0) {
        return PM_OK;
    }
    pm_node output[2 * MAX_SETS];
    for (int i = 0; i < c->count; ++i) {
        const set *s = &c->set[i];
        output[2 * i] = s->node;
        output[2 * i + 1] = s->effort == PM_NO_NODE ? s->node : s->effort;
    }
    pm_program *program = NULL;
    // All windows, or evenly chosen ones, as many as fit into memory.
    const int most = MOST_NUMBERS / (pm_samples_width(samples) + pm_samples_left_out(samples)) + 1;
    const int count = samples->count < most ? samples->count : most;
    PM_TRY(pm_program_open(&program, c->g, 2 * c->count, output, count));

    for (int i = 0; i < count; ++i) {
        pm_samples_window(samples, (int)((long)i * samples->count / count),
                          (pm_program_value(program, window)) +
                              (size_t)i * (size_t)pm_samples_width(samples));
    }
    pm_program_run(program, count);
    for (int i = 0; i < c->count; ++i) {
        const set *s = &c->set[i];
        const double *effort =
            s->effort == PM_NO_NODE ? NULL : pm_program_value(program, s->effort);
        fix(s, !c->plain, pm_program_value(program, s->node), effort, count,
            pm_graph_shape(c->g, s->node).cols);
    }
    pm_program_close(program);
    return PM_OK;
}

static pm_status one_pass(pm_system *system, const pm_samples *samples,
                          const pm_magnitudes *magnitudes, bool plain, bool strengths) {
    const int count = system->scene->physics.nsubsystem;
    pm_graph *g = NULL;
    pm_arena arena = {0};
    collection *c = pm_arena_array(&arena, 1, sizeof *c);
    pm_state_nodes *state = pm_arena_array(&arena, (size_t)count, sizeof *state);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "normalisation"));
    PM_TRY_DONE(pm_graph_open(&g));
    c->g = g;
    c->magnitudes = magnitudes;
    c->plain = plain;
    c->strengths = strengths;
    const pm_node window = pm_input(g, true, 1, pm_samples_width(samples));
    for (int i = 0; i < count; ++i) {
        const pm_scene_subsystem *s = &system->scene->physics.subsystem[i];
        state[i].z = state[i].to = pm_slice(g, window, s->first, s->layout.nz);
        state[i].from = state[i].response = PM_NO_NODE;
    }
    pm_build_coenergies(g, system, state);
    const pm_node boundary_input = samples->nboundary_input == 0
                                       ? PM_NO_NODE
                                       : pm_slice(g, window, pm_samples_input(samples, 0),
                                                  samples->input_order * samples->nboundary_input);
    const pm_node prescribed = pm_build_boundary_input(g, system, boundary_input, 0);
    const pm_scene *scene = system->scene;
    for (int i = 0; i < count; ++i) {
        c->params = &system->part[i]->params;
        c->part = i;
        c->port = -1;
        if (system->scene->physics.subsystem[i].model != NULL) {
            continue; // the scene defines this model
        }
        PM_TRY_DONE(
            pm_part_visit(system->part[i], c->g, state[i].z, state[i].dE, state[i].dS, collect, c));
    }
    for (int i = 0; i < scene->physics.nport; ++i) {
        pm_port_nodes end[2];
        pm_build_port_nodes(c->g, system, i, state, prescribed, end);
        c->params = &system->port[i]->params;
        c->part = -1;
        c->port = i;
        if (system->scene->physics.port[i].model != NULL) {
            continue;
        }
        PM_TRY_DONE(system->port[i]->law->visit(system->port[i], c->g, end, collect, c));
    }
    PM_TRY_DONE(run_and_fix(c, window, samples));
done:
    pm_graph_close(g);
    pm_arena_free(&arena);
    return status;
}

// Notes between which values the boundary inputs of each port are.
static pm_status find_input_ranges(pm_system *system, const pm_samples *samples) {
    const pm_physics *physics = &system->scene->physics;
    for (int i = 0; i < 2 * physics->nport; ++i) { // again for another end that shares the model
        if (physics->port[i / 2].boundary_input[i % 2] >= 0) {
            PM_TRY(pm_input_range_declare(system->port[i / 2]));
            pm_input_range_clear(system->port[i / 2]);
        }
    }
    for (int i = 0; i < 2 * physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i / 2];
        const pm_end end = i % 2 == 0 ? PM_END_A : PM_END_B;
        const int ny = port->layout[end].nz, inputs = pm_samples_input(samples, 0);
        for (int c = 0; c < 3 * ny; ++c) {
            const int shown = pm_physics_shown(physics, port, i % 2, c);
            for (int k = 0; k < samples->count && shown >= 0; ++k) { // at the beginning of the step
                const double *window = samples->z + (ptrdiff_t)k * pm_samples_width(samples);
                pm_input_range_widen(system->port[i / 2], end, c / ny, c % ny,
                                     window[inputs + shown]);
            }
        }
    }
    return PM_OK;
}

pm_status pm_normalization_of_system(pm_system *system, const pm_samples *samples, bool plain) {
    pm_magnitudes magnitudes = {.scene = system->scene};
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        if (pm_training_range_of(system->part[i]).low == NULL) {
            PM_TRY(pm_training_range_declare(system->part[i]));
        }
        pm_training_range_clear(system->part[i]);
        for (int k = 0; k < samples->count; ++k) {
            const double *z = samples->z + (ptrdiff_t)k * pm_samples_width(samples);
            pm_training_range_widen(system->part[i], z + system->scene->physics.subsystem[i].first);
        }
    }
    PM_TRY(find_input_ranges(system, samples));
    PM_TRY(plain ? PM_OK : pm_magnitudes_find(&magnitudes, system, samples));
    // The first pass fixes the constants of energies and entropies, the second those of features
    // that contain co-energies.
    pm_status status = one_pass(system, samples, &magnitudes, plain, false);
    if (status == PM_OK) {
        status = one_pass(system, samples, &magnitudes, plain, false);
    }
    pm_magnitudes_free(&magnitudes);
    return status;
}

pm_status pm_normalization_of_strengths(pm_system *system, const pm_samples *samples) {
    const pm_magnitudes magnitudes = {.scene = system->scene};
    return one_pass(system, samples, &magnitudes, true, true);
}

// Statistics of the states and rates, and estimates of energies from given couplings: a coupling
// x_dot = c dE/dy of typical rate r implies an energy of about r y/c.
#include "learn/magnitudes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// The estimates of the energy of one subsystem, of which the geometric mean is used.
typedef struct estimate {
    double sum;
    int count;
} estimate;

static double pooled_deviation(const pm_samples *s, int first, int size) {
    const size_t width = (size_t)pm_samples_width(s);
    double square = 0;
    for (int c = first; c < first + size; ++c) {
        double mean = 0;
        for (int i = 0; i < s->count; ++i) {
            mean += s->z[(size_t)i * width + (size_t)c] / s->count;
        }
        for (int i = 0; i < s->count; ++i) {
            const double difference = s->z[(size_t)i * width + (size_t)c] - mean;
            square += difference * difference / ((double)s->count * size);
        }
    }
    return sqrt(square);
}

static void find_states(pm_magnitudes *m, const pm_samples *s) {
    const pm_scene *scene = m->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_layout *layout = &scene->subsystem[i].layout;
        for (int k = 0; k < layout->ngroup; ++k) {
            const int first = scene->subsystem[i].first + layout->group[k].first;
            const double deviation = pooled_deviation(s, first, layout->group[k].size);
            for (int c = first; c < first + layout->group[k].size; ++c) {
                m->deviation[c] = deviation > 0 ? deviation : 1;
                m->rate[c] = s->scale[c] / scene->dt;
            }
        }
    }
}

bool pm_magnitudes_of_part(const pm_magnitudes *m, int part, const char *group,
                           pm_group_magnitude *result) {
    const pm_scene_subsystem *subsystem = &m->scene->subsystem[part];
    const pm_group *found = pm_layout_find(&subsystem->layout, group);
    if (found == NULL) {
        return false;
    }
    const int at = subsystem->first + found->first;
    *result = (pm_group_magnitude){m->deviation[at], m->rate[at], m->energy[part],
                                   m->temperature[part], m->dS[part]};
    return true;
}

// Returns the subsystem that a prefixed name such as "a.q" of a port belongs to, and its name
// there; -1: none.
static int part_of_end(const pm_scene_port *port, const char *name, const char **group) {
    const int end = name[0] == 'b';
    *group = name + 2;
    return strlen(name) > 2 && name[1] == '.' ? port->subsystem[end] : -1;
}

bool pm_magnitudes_of_port(const pm_magnitudes *m, int port, const char *group,
                           pm_group_magnitude *result) {
    const char *name;
    const int part = part_of_end(&m->scene->port[port], group, &name);
    return part >= 0 && pm_magnitudes_of_part(m, part, name, result);
}

// --- energies ---

// Adds the estimate from a rate that a coupling drives by the co-energy of another group: the
// co-energy is about the energy divided by the deviation of that group.
static void add_estimate(estimate *e, const pm_group_magnitude *driven,
                         const pm_group_magnitude *driving, double coefficient) {
    const double energy = driven->rate * driving->deviation / fabs(coefficient);
    if (energy > 0 && isfinite(energy)) {
        e->sum += log(energy);
        ++e->count;
    }
}

// Returns the coefficient of a given pair, or 0 if it depends on the state. A learned constant has
// the value at which training starts.
static double coefficient_of(const pm_given_pair *pair) {
    const pm_constants *constants = pair->formula.constants;
    if (pair->formula.text == NULL) {
        return pair->coefficient;
    }
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        if (strcmp(constants->name[i], pair->formula.text) == 0) {
            return constants->value[i];
        }
    }
    return 0;
}

static void estimate_part(const pm_magnitudes *m, const pm_system *system, int part, estimate *e) {
    const pm_operator_spec *L = &system->part[part]->spec.reversible;
    for (int k = 0; k < L->ngiven; ++k) {
        pm_group_magnitude row, col;
        const double coefficient = coefficient_of(&L->given[k]);
        if (pm_magnitudes_of_part(m, part, L->given[k].row, &row) &&
            pm_magnitudes_of_part(m, part, L->given[k].col, &col)) {
            add_estimate(&e[part], &row, &col, coefficient);
            add_estimate(&e[part], &col, &row, coefficient);
        }
    }
}

static void estimate_port(const pm_magnitudes *m, const pm_system *system, int port, estimate *e) {
    const pm_operator_spec *L = &system->port[port]->spec.reversible;
    const pm_scene_port *scene = &m->scene->port[port];
    for (int k = 0; k < L->ngiven; ++k) {
        pm_group_magnitude row, col;
        const char *name;
        const double coefficient = coefficient_of(&L->given[k]);
        if (pm_magnitudes_of_port(m, port, L->given[k].row, &row) &&
            pm_magnitudes_of_port(m, port, L->given[k].col, &col)) {
            const int of_row = part_of_end(scene, L->given[k].row, &name);
            const int of_col = part_of_end(scene, L->given[k].col, &name);
            add_estimate(&e[of_col], &row, &col, coefficient);
            add_estimate(&e[of_row], &col, &row, coefficient);
        }
    }
}

// Returns the typical heat content of a subsystem: the temperature times the deviation of its
// entropies.
static double heat_content(const pm_magnitudes *m, const pm_system *system, int part) {
    const pm_potential_spec *energy = &system->part[part]->spec.energy;
    double content = 0;
    for (int i = 0; i < energy->nterm; ++i) {
        const pm_network_spec *term = &energy->term[i];
        for (int k = term->nfeature - term->nthermal; k < term->nfeature; ++k) {
            pm_group_magnitude of;
            if (pm_magnitudes_of_part(m, part, term->feature[k], &of)) {
                content += term->temperature * of.deviation;
            }
        }
    }
    return content;
}

static double dS_of(const pm_system *system, int part) {
    const pm_potential_spec *entropy = &system->part[part]->spec.entropy;
    return entropy->ngiven > 0 && entropy->given_coefficient != NULL &&
                   entropy->given_coefficient[0] > 0
               ? entropy->given_coefficient[0]
               : 1;
}

static double temperature_of(const pm_system *system, int part) {
    const pm_potential_spec *energy = &system->part[part]->spec.energy;
    double slope = 0; // dE/ds
    for (int i = 0; i < energy->nterm; ++i) {
        slope += energy->term[i].nthermal > 0 ? energy->term[i].temperature : 0;
    }
    return slope > 0 ? slope / dS_of(system, part) : PM_DEFAULT_TEMPERATURE;
}

static void find_energies(pm_magnitudes *m, const pm_system *system, estimate *e) {
    for (int i = 0; i < m->scene->nsubsystem; ++i) {
        m->energy[i] = 1;
        m->temperature[i] = temperature_of(system, i);
        m->dS[i] = dS_of(system, i);
        estimate_part(m, system, i, e);
    }
    for (int i = 0; i < m->scene->nport; ++i) {
        estimate_port(m, system, i, e);
    }
    for (int i = 0; i < m->scene->nsubsystem; ++i) {
        const double content = heat_content(m, system, i);
        m->energy[i] = e[i].count > 0 ? exp(e[i].sum / e[i].count) : content > 0 ? content : 1;
    }
}

pm_status pm_magnitudes_find(pm_magnitudes *m, const pm_system *system, const pm_samples *samples) {
    const pm_scene *scene = system->scene;
    const size_t nz = (size_t)scene->nz, count = (size_t)scene->nsubsystem;
    *m = (pm_magnitudes){.scene = scene};
    m->deviation = pm_arena_array(&m->arena, nz, sizeof *m->deviation);
    m->rate = pm_arena_array(&m->arena, nz, sizeof *m->rate);
    m->energy = pm_arena_array(&m->arena, count, sizeof *m->energy);
    m->temperature = pm_arena_array(&m->arena, count, sizeof *m->temperature);
    m->dS = pm_arena_array(&m->arena, count, sizeof *m->dS);
    estimate *e = pm_arena_array(&m->arena, count, sizeof *e);
    if (m->deviation == NULL || m->rate == NULL || m->energy == NULL || m->temperature == NULL ||
        m->dS == NULL || e == NULL) {
        pm_magnitudes_free(m);
        return pm_fail(PM_ENOMEM, "out of memory for normalisation");
    }
    find_states(m, samples);
    find_energies(m, system, e);
    return PM_OK;
}

void pm_magnitudes_free(pm_magnitudes *m) {
    pm_arena_free(&m->arena);
    *m = (pm_magnitudes){0};
}

// Statistics of the states and rates, and estimates of energies from given couplings: a coupling
// x_dot = c dE/dy of typical rate r implies an energy of about r y/c.
#include "data/magnitudes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"

#define MOST_STATES 4096 // at which energy variables are computed

// The estimates of the energy of one subsystem, of which the geometric mean is used.
typedef struct estimate {
    double sum;
    int count;
} estimate;

static void find_states(pm_magnitudes *m, const pm_samples *s) {
    const pm_scene *scene = m->scene;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_layout *layout = &scene->physics.subsystem[i].layout;
        for (int k = 0; k < layout->ngroup; ++k) {
            const int first = scene->physics.subsystem[i].first + layout->group[k].first;
            const int size = layout->group[k].size;
            const size_t width = (size_t)pm_samples_width(s);
            double square = 0;
            for (int c = first; c < first + size; ++c) {
                double mean = 0;
                for (int j = 0; j < s->count; ++j) {
                    mean += s->z[(size_t)j * width + (size_t)c] / s->count;
                }
                for (int j = 0; j < s->count; ++j) {
                    const double difference = s->z[(size_t)j * width + (size_t)c] - mean;
                    square += difference * difference / ((double)s->count * size);
                }
            }
            const double deviation = sqrt(square);
            for (int c = first; c < first + layout->group[k].size; ++c) {
                m->deviation[c] = deviation > 0 ? deviation : 1;
                m->rate[c] = s->scale[c] / scene->physics.dt;
            }
        }
    }
}

// What pm_magnitudes keeps of one subsystem with co-energies: the sum over all groups y of their
// root mean square times the deviation of the energy variable, which is about an energy, and the
// mean of all temperatures, 0 without one.
typedef struct shown {
    double energy, temperature;
} shown;

// Replaces deviation and rate of the co-energies of one subsystem by those of the energy variables
// x(z), which `program` computes in `variable` from the states that lie in `z`, count [nz] each.
static shown convert(pm_magnitudes *m, const pm_scene_subsystem *s, const double *z,
                     const double *variable, int count) {
    const int nz = s->layout.nz;
    shown sum = {0, 0};
    double temperatures = 0;
    for (int k = 0; k < s->layout.ngroup; ++k) {
        const pm_group *group = &s->layout.group[k];
        double deviation = 0, rms = 0, mean_shown = 0;
        if (!group->coenergy) {
            continue;
        }
        for (int c = group->first; c < group->first + group->size; ++c) {
            double mean = 0;
            for (int j = 0; j < count; ++j) {
                mean += variable[(ptrdiff_t)j * nz + c] / count;
            }
            for (int j = 0; j < count; ++j) {
                const double x = variable[(ptrdiff_t)j * nz + c] - mean;
                const double y = z[(ptrdiff_t)j * nz + c];
                deviation += x * x / ((double)count * group->size);
                rms += y * y / ((double)count * group->size);
                mean_shown += y / ((double)count * group->size);
            }
        }
        deviation = sqrt(deviation);
        if (deviation > 0 && isfinite(deviation)) {
            for (int c = s->first + group->first; c < s->first + group->first + group->size; ++c) {
                m->rate[c] *= deviation / m->deviation[c];
                m->deviation[c] = deviation;
            }
            sum.energy += sqrt(rms) * deviation;
        }
        if (group->role == PM_ROLE_ENTROPY) {
            sum.temperature = (temperatures * sum.temperature + mean_shown) / (temperatures + 1);
            ++temperatures;
        }
    }
    return sum;
}

// Computes the magnitudes of co-energies. found [nsubsystem] stays zero for the others.
static pm_status find_shown(pm_magnitudes *m, const pm_system *system, const pm_samples *samples,
                            shown *found) {
    const int count = samples->count < MOST_STATES ? samples->count : MOST_STATES;
    const size_t width = (size_t)pm_samples_width(samples);
    for (int i = 0; i < m->scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &m->scene->physics.subsystem[i];
        pm_graph *g = NULL;
        pm_program *program = NULL;
        pm_status status;
        if (!pm_part_has_coenergies(system->part[i])) {
            continue;
        }
        PM_TRY_DONE(pm_graph_open(&g));
        const pm_node z = pm_input(g, true, 1, s->layout.nz);
        const pm_node x = pm_part_energy_variables(g, system->part[i], z);
        PM_TRY_DONE(pm_program_open(&program, g, 1, &x, count));
        double *state = pm_program_value(program, z);
        for (int j = 0; j < count; ++j) {
            const size_t at = (size_t)((long)j * samples->count / count);
            memcpy(state + (ptrdiff_t)j * s->layout.nz, samples->z + at * width + s->first,
                   (size_t)s->layout.nz * sizeof *state);
        }
        pm_program_run(program, count);
        found[i] = convert(m, s, state, pm_program_value(program, x), count);
    done:
        pm_program_close(program);
        pm_graph_close(g);
        PM_TRY(status);
    }
    return PM_OK;
}

bool pm_magnitudes_of_part(const pm_magnitudes *m, int part, const char *group,
                           pm_group_magnitude *result) {
    const pm_scene_subsystem *subsystem = &m->scene->physics.subsystem[part];
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
    const int part = part_of_end(&m->scene->physics.port[port], group, &name);
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

static double dS_of(const pm_system *system, int part) {
    const pm_potential_spec *entropy = &system->part[part]->spec.entropy;
    return entropy->ngiven > 0 && entropy->given_coefficient != NULL &&
                   entropy->given_coefficient[0] > 0
               ? entropy->given_coefficient[0]
               : 1;
}

pm_status pm_magnitudes_find(pm_magnitudes *m, const pm_system *system, const pm_samples *samples) {
    const pm_scene *scene = system->scene;
    const size_t nz = (size_t)scene->physics.nz, count = (size_t)scene->physics.nsubsystem;
    *m = (pm_magnitudes){.scene = scene};
    m->deviation = pm_arena_array(&m->arena, nz, sizeof *m->deviation);
    m->rate = pm_arena_array(&m->arena, nz, sizeof *m->rate);
    m->energy = pm_arena_array(&m->arena, count, sizeof *m->energy);
    m->temperature = pm_arena_array(&m->arena, count, sizeof *m->temperature);
    m->dS = pm_arena_array(&m->arena, count, sizeof *m->dS);
    estimate *e = pm_arena_array(&m->arena, count, sizeof *e);
    shown *of_shown = pm_arena_array(&m->arena, count, sizeof *of_shown);
    pm_status status = pm_arena_status(&m->arena, "normalisation");
    if (status == PM_OK) {
        find_states(m, samples);
        status = find_shown(m, system, samples, of_shown);
    }
    if (status != PM_OK) {
        pm_magnitudes_free(m);
        return status;
    }
    for (int i = 0; i < m->scene->physics.nsubsystem; ++i) {
        m->energy[i] = 1;
        const pm_potential_spec *energy = &system->part[i]->spec.energy;
        double slope = 0; // dE/ds
        for (int k = 0; k < energy->nterm; ++k) {
            slope += energy->term[k].nthermal > 0 ? energy->term[k].temperature : 0;
        }
        m->temperature[i] = of_shown[i].temperature > 0 ? of_shown[i].temperature
                            : slope > 0                 ? slope / dS_of(system, i)
                                                        : PM_DEFAULT_TEMPERATURE;
        m->dS[i] = dS_of(system, i);
        const pm_operator_spec *L = &system->part[i]->spec.reversible;
        for (int k = 0; k < L->ngiven; ++k) {
            pm_group_magnitude row, col;
            const double coefficient = coefficient_of(&L->given[k]);
            if (pm_magnitudes_of_part(m, i, L->given[k].row, &row) &&
                pm_magnitudes_of_part(m, i, L->given[k].col, &col)) {
                add_estimate(&e[i], &row, &col, coefficient);
                add_estimate(&e[i], &col, &row, coefficient);
            }
        }
    }
    for (int i = 0; i < m->scene->physics.nport; ++i) {
        const pm_operator_spec *L = &system->port[i]->spec.reversible;
        const pm_scene_port *own = &m->scene->physics.port[i];
        for (int k = 0; k < L->ngiven; ++k) {
            pm_group_magnitude row, col;
            const char *name;
            const double coefficient = coefficient_of(&L->given[k]);
            if (pm_magnitudes_of_port(m, i, L->given[k].row, &row) &&
                pm_magnitudes_of_port(m, i, L->given[k].col, &col)) {
                const int of_row = part_of_end(own, L->given[k].row, &name);
                const int of_col = part_of_end(own, L->given[k].col, &name);
                add_estimate(&e[of_col], &row, &col, coefficient);
                add_estimate(&e[of_row], &col, &row, coefficient);
            }
        }
    }
    for (int i = 0; i < m->scene->physics.nsubsystem; ++i) {
        // The typical heat content of a subsystem: the temperature times the deviation of its
        // entropies. Other co-energies count as well.
        const pm_potential_spec *energy = &system->part[i]->spec.energy;
        double content = of_shown[i].energy;
        for (int j = 0; j < energy->nterm; ++j) {
            const pm_network_spec *term = &energy->term[j];
            for (int k = term->nfeature - term->nthermal; k < term->nfeature; ++k) {
                pm_group_magnitude of;
                if (pm_magnitudes_of_part(m, i, term->feature[k], &of)) {
                    content += term->temperature * of.deviation;
                }
            }
        }
        m->energy[i] = e[i].count > 0 ? exp(e[i].sum / e[i].count) : content > 0 ? content : 1;
    }
    return PM_OK;
}

void pm_magnitudes_free(pm_magnitudes *m) {
    pm_arena_free(&m->arena);
    *m = (pm_magnitudes){0};
}

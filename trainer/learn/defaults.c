// Rewrites models as they were read: thermal energies, heated operators, and the sizes of their
// first random weights.
#include "learn/defaults.h"

#include <string.h>

// Standard deviations of the first random weights of learned constants and skips. Entries of
// operators are in units in which 1 is a typical rate (learn/magnitudes.h).
#define OPERATOR_SPREAD 0.3
#define ENERGY_SPREAD 0.1

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a model");
}

static bool is_listed(int count, const char *const *list, const char *name) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(list[i], name) == 0) {
            return true;
        }
    }
    return false;
}

// Returns the coefficient of this group in the entropy if that is a given linear form, 1 if it is a
// formula that is the name of the group, and 0 if the group is no entropy.
static double entropy_of(const pm_potential_spec *entropy, const char *group) {
    double found = 0;
    for (int i = 0; i < entropy->ngiven && entropy->nterm == 0; ++i) {
        const double c = entropy->given_coefficient == NULL ? 1 : entropy->given_coefficient[i];
        found = strcmp(entropy->given[i], group) == 0 && c > 0 ? c : found;
    }
    for (int i = 0; i < entropy->nformula && entropy->nterm == 0; ++i) {
        found = strcmp(entropy->formula[i].text, group) == 0 ? 1 : found;
    }
    return found;
}

static bool is_entropy(const pm_potential_spec *entropy, const char *group) {
    return entropy_of(entropy, group) > 0;
}

// --- energies ---

// Moves the entropies among the features of a term to the end and makes the term thermal in them.
// The components of an entropy are bodies of their own.
static pm_status make_thermal(pm_network_spec *term, const pm_potential_spec *entropy,
                              const pm_layout *layout, pm_arena *arena) {
    const char **feature = pm_arena_array(arena, (size_t)term->nfeature + 1, sizeof *feature);
    if (feature == NULL) {
        return no_memory();
    }
    int count = 0;
    double dS = 0; // the mean over the entropies
    for (int pass = 0; pass < 2; ++pass) {
        for (int i = 0; i < term->nfeature; ++i) {
            const double own = entropy_of(entropy, term->feature[i]);
            if ((own > 0) == (pass == 1)) {
                feature[count++] = term->feature[i];
                term->nthermal += pass;
                dS += own;
                term->separate = term->separate ||
                                 (own > 0 && pm_layout_find(layout, term->feature[i])->size > 1);
            }
        }
    }
    term->feature = feature;
    if (term->nthermal > 0) {
        term->exponentials = term->exponentials > 0 ? term->exponentials : PM_DEFAULT_EXPONENTIALS;
        if (term->temperature <= 0) {
            term->temperature = PM_DEFAULT_TEMPERATURE * dS / term->nthermal;
        }
    }
    return PM_OK;
}

// Returns the number of thermal terms that have this entropy among their features.
static int count_thermal(const pm_potential_spec *energy, const char *group) {
    int count = 0;
    for (int i = 0; i < energy->nterm; ++i) {
        const pm_network_spec *term = &energy->term[i];
        const int others = term->nfeature - term->nthermal;
        count += is_listed(term->nthermal, term->feature + others, group);
    }
    return count;
}

// Turns a linear form of an entropy in the energy into the starting temperature of the thermal
// terms and removes it. If it stayed, the temperature would be the sum of both.
static pm_status absorb_given(pm_potential_spec *energy, pm_network_spec *term, pm_arena *arena) {
    const char **given = pm_arena_array(arena, (size_t)energy->ngiven + 1, sizeof *given);
    double *kept = pm_arena_array(arena, (size_t)energy->ngiven + 1, sizeof *kept);
    if (given == NULL || kept == NULL) {
        return no_memory();
    }
    int count = 0;
    for (int i = 0; i < energy->ngiven; ++i) {
        const double c = energy->given_coefficient == NULL ? 1 : energy->given_coefficient[i];
        const int terms = count_thermal(energy, energy->given[i]);
        for (int k = 0; k < energy->nterm && terms > 0 && c > 0; ++k) {
            const int others = term[k].nfeature - term[k].nthermal;
            if (is_listed(term[k].nthermal, term[k].feature + others, energy->given[i])) {
                term[k].temperature = c / terms;
            }
        }
        if (terms == 0 || c <= 0) {
            given[count] = energy->given[i];
            kept[count++] = c;
        }
    }
    energy->given = given;
    energy->given_coefficient = kept;
    energy->ngiven = count;
    return PM_OK;
}

static pm_status default_energy(pm_part_spec *spec, const pm_layout *layout, pm_arena *arena) {
    pm_potential_spec *energy = &spec->energy;
    pm_network_spec *term = pm_arena_array(arena, (size_t)energy->nterm + 1, sizeof *term);
    if (term == NULL) {
        return no_memory();
    }
    for (int i = 0; i < energy->nterm; ++i) {
        term[i] = energy->term[i];
        term[i].scaled = true;
        term[i].spread = ENERGY_SPREAD;
        if (term[i].nthermal == 0 && !term[i].zero_at_origin) {
            PM_TRY(make_thermal(&term[i], &spec->entropy, layout, arena));
        }
    }
    energy->term = term;
    return absorb_given(energy, term, arena);
}

static pm_status scale_terms(pm_potential_spec *potential, pm_arena *arena) {
    pm_network_spec *term = pm_arena_array(arena, (size_t)potential->nterm + 1, sizeof *term);
    if (term == NULL) {
        return no_memory();
    }
    for (int i = 0; i < potential->nterm; ++i) {
        term[i] = potential->term[i];
        term[i].scaled = true;
        term[i].spread = ENERGY_SPREAD;
    }
    potential->term = term;
    return PM_OK;
}

// --- operators ---

static void default_spread(pm_operator_spec *op) {
    if (op->learned) {
        op->network.spread = OPERATOR_SPREAD;
    }
}

// Returns true if a learned operator can heat these entropies: it must have a variable to act on
// besides a single entropy.
static bool can_heat(const pm_operator_spec *op, pm_form form, int components, int count,
                     const char *const *heats) {
    bool other = components > 1;
    for (int i = 0; i < op->nacts; ++i) {
        other = other || !is_listed(count, heats, op->acts_on[i]);
    }
    return op->learned && op->nheats == 0 && form == PM_HARD && count > 0 && other;
}

pm_status pm_default_part(pm_part_spec *spec, const pm_layout *layout, pm_arena *arena) {
    const char **heats = pm_arena_array(arena, PM_MAX_GROUPS, sizeof *heats);
    if (heats == NULL) {
        return no_memory();
    }
    int count = 0, components = 0;
    for (int i = 0; i < layout->ngroup; ++i) {
        if (is_entropy(&spec->entropy, layout->group[i].name)) {
            heats[count++] = layout->group[i].name;
            components += layout->group[i].size;
        }
    }
    PM_TRY(default_energy(spec, layout, arena));
    PM_TRY(scale_terms(&spec->entropy, arena));
    default_spread(&spec->reversible);
    default_spread(&spec->irreversible);
    if (can_heat(&spec->irreversible, spec->form, components, count, heats)) {
        spec->irreversible.nheats = count;
        spec->irreversible.heats = heats;
    }
    return PM_OK;
}

// Returns true if a group of one end of a port is an entropy, of a subsystem or of a boundary
// input.
static bool shows_entropy(const pm_system *system, int port, int end, const char *group) {
    const pm_scene_port *scene = &system->scene->port[port];
    if (scene->subsystem[end] >= 0) {
        return is_entropy(&system->part[scene->subsystem[end]]->spec.entropy, group);
    }
    const pm_scene_boundary_input *input =
        &system->scene->boundary_input[scene->boundary_input[end]];
    const pm_group *found = pm_layout_find(&input->layout, group);
    const pm_scene_prescribed *dS =
        found == NULL ? NULL : &input->value[2 * input->layout.nz + found->first];
    return dS != NULL && input->entropy && (dS->column != NULL || dS->number > 0);
}

pm_status pm_default_port(pm_port_spec *spec, const pm_system *system, int port, pm_arena *arena) {
    const pm_scene_port *scene = &system->scene->port[port];
    const char **heats = pm_arena_array(arena, 2 * PM_MAX_GROUPS, sizeof *heats);
    if (heats == NULL) {
        return no_memory();
    }
    int count = 0, components = 0;
    for (int end = 0; end < 2; ++end) {
        for (int i = 0; i < scene->layout[end].ngroup; ++i) {
            const pm_group *group = &scene->layout[end].group[i];
            if (shows_entropy(system, port, end, group->name)) {
                heats[count] = pm_arena_printf(arena, "%s%s", end == 0 ? "a." : "b.", group->name);
                components += group->size;
                if (heats[count++] == NULL) {
                    return no_memory();
                }
            }
        }
    }
    PM_TRY(scale_terms(&spec->energy, arena));
    PM_TRY(scale_terms(&spec->entropy, arena));
    default_spread(&spec->reversible);
    default_spread(&spec->irreversible);
    if (can_heat(&spec->irreversible, spec->form, components, count, heats) &&
        strcmp(spec->law, "bracket") == 0) {
        spec->irreversible.nheats = count;
        spec->irreversible.heats = heats;
    }
    return PM_OK;
}

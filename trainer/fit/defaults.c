// Rewrites models as they were read: thermal energies, heated operators, and the sizes of their
// first random weights.
#include "fit/defaults.h"

#include <string.h>

// Standard deviations of the first random weights of learned constants and skips. Entries of
// operators are in units in which 1 is a typical rate (data/magnitudes.h).
#define OPERATOR_SPREAD 0.3
#define ENERGY_SPREAD 0.1

static bool is_listed(int count, const char *const *list, const char *name) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(list[i], name) == 0) {
            return true;
        }
    }
    return false;
}

// Returns the coefficient of an entropy in S if that is a given linear form, 1 if S is a formula
// that is the name of the group, and 0 if the group is no entropy of this layout or S is not linear
// in it.
static double entropy_of(const pm_potential_spec *entropy, const pm_layout *layout,
                         const char *group) {
    double found = 0;
    const pm_group *own = pm_layout_find(layout, group);
    if (own == NULL || own->role != PM_ROLE_ENTROPY) {
        return 0;
    }
    for (int i = 0; i < entropy->ngiven && entropy->nterm == 0; ++i) {
        const double c = entropy->given_coefficient == NULL ? 1 : entropy->given_coefficient[i];
        found = strcmp(entropy->given[i], group) == 0 && c > 0 ? c : found;
    }
    for (int i = 0; i < entropy->nformula && entropy->nterm == 0; ++i) {
        found = strcmp(entropy->formula[i].text, group) == 0 ? 1 : found;
    }
    return found;
}

// --- energies ---

// Moves the entropies among the features of a term to the end and makes the term thermal in them.
// The components of an entropy are bodies of their own.
static pm_status make_thermal(pm_network_spec *term, const pm_potential_spec *entropy,
                              const pm_layout *layout, pm_arena *arena) {
    const char **feature = pm_arena_array(arena, (size_t)term->nfeature + 1, sizeof *feature);
    PM_TRY(pm_arena_status(arena, "a model"));
    int count = 0;
    double dS = 0; // the mean over the entropies
    for (int pass = 0; pass < 2; ++pass) {
        for (int i = 0; i < term->nfeature; ++i) {
            const double own = entropy_of(entropy, layout, term->feature[i]);
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

static pm_status scale_terms(pm_potential_spec *potential, pm_arena *arena) {
    pm_network_spec *term = pm_arena_array(arena, (size_t)potential->nterm + 1, sizeof *term);
    PM_TRY(pm_arena_status(arena, "a model"));
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
    PM_TRY(pm_arena_status(arena, "a model"));
    int count = 0, components = 0;
    for (int i = 0; i < layout->ngroup; ++i) {
        if (entropy_of(&spec->entropy, layout, layout->group[i].name) > 0) {
            heats[count++] = layout->group[i].name;
            components += layout->group[i].size;
        }
    }
    pm_potential_spec *energy = &spec->energy;
    pm_network_spec *term = pm_arena_array(arena, (size_t)energy->nterm + 1, sizeof *term);
    PM_TRY(pm_arena_status(arena, "a model"));
    for (int i = 0; i < energy->nterm; ++i) {
        term[i] = energy->term[i];
        term[i].scaled = true;
        term[i].spread = ENERGY_SPREAD;
        if (term[i].nthermal == 0 && !term[i].zero_at_origin) {
            PM_TRY(make_thermal(&term[i], &spec->entropy, layout, arena));
        }
    }
    energy->term = term;
    // Turns a linear form of an entropy in the energy into the starting temperature of the thermal
    // terms and removes it. If it stayed, the temperature would be the sum of both.
    const char **form = pm_arena_array(arena, (size_t)energy->ngiven + 1, sizeof *form);
    double *kept = pm_arena_array(arena, (size_t)energy->ngiven + 1, sizeof *kept);
    PM_TRY(pm_arena_status(arena, "a model"));
    int nkept = 0;
    for (int m = 0; m < energy->ngiven; ++m) {
        const double c = energy->given_coefficient == NULL ? 1 : energy->given_coefficient[m];
        int terms = 0; // thermal terms that have this entropy among their features
        for (int k = 0; k < energy->nterm; ++k) {
            const int others = term[k].nfeature - term[k].nthermal;
            terms += is_listed(term[k].nthermal, term[k].feature + others, energy->given[m]);
        }
        for (int k = 0; k < energy->nterm && terms > 0 && c > 0; ++k) {
            const int others = term[k].nfeature - term[k].nthermal;
            if (is_listed(term[k].nthermal, term[k].feature + others, energy->given[m])) {
                term[k].temperature = c / terms;
            }
        }
        if (terms == 0 || c <= 0) {
            form[nkept] = energy->given[m];
            kept[nkept++] = c;
        }
    }
    energy->given = form;
    energy->given_coefficient = kept;
    energy->ngiven = nkept;
    PM_TRY(scale_terms(&spec->entropy, arena));
    default_spread(&spec->reversible);
    default_spread(&spec->irreversible);
    if (can_heat(&spec->irreversible, spec->form, components, count, heats)) {
        spec->irreversible.nheats = count;
        spec->irreversible.heats = heats;
    }
    return PM_OK;
}

pm_status pm_default_port(pm_port_spec *spec, const pm_system *system, int port, pm_arena *arena) {
    const pm_scene_port *scene = &system->scene->physics.port[port];
    const char **heats = pm_arena_array(arena, 2 * PM_MAX_GROUPS, sizeof *heats);
    PM_TRY(pm_arena_status(arena, "a model"));
    int count = 0, components = 0;
    for (int end = 0; end < 2; ++end) {
        for (int i = 0; i < scene->layout[end].ngroup; ++i) {
            const pm_group *group = &scene->layout[end].group[i];
            // Whether the group is an entropy, of a subsystem or of a boundary input.
            bool entropy = false;
            if (scene->subsystem[end] >= 0) {
                const pm_part *part = system->part[scene->subsystem[end]];
                entropy = entropy_of(&part->spec.entropy, &part->layout, group->name) > 0;
            } else {
                const pm_scene_boundary_input *input =
                    &system->scene->physics.boundary_input[scene->boundary_input[end]];
                const pm_group *found = pm_layout_find(&input->layout, group->name);
                const pm_scene_prescribed *dS =
                    found == NULL ? NULL : &input->value[2 * input->layout.nz + found->first];
                entropy = dS != NULL && found->role == PM_ROLE_ENTROPY && input->entropy &&
                          (dS->column != NULL || dS->number > 0);
            }
            if (entropy) {
                heats[count] = pm_arena_printf(arena, "%s%s", end == 0 ? "a." : "b.", group->name);
                ++count;
                components += group->size;
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

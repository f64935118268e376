// Reads the `model:` block into the plain data of model/spec.h: constants, form and rate here, the
// other parts by the functions of model_block.h.
#include "scene/model_reader.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "model/port.h"
#include "model/solid/material.h"
#include "scene/model_block.h"
#include "scene/network_reader.h"

static const char *const form_names[] = {
    [PM_HARD] = "hard", [PM_SOFT] = "soft", [PM_FREE] = "free", NULL};
#define MODEL_KEYS "form", "energy", "entropy", "reversible", "irreversible", "rate", "constants"

// Reads the network of the free form. No other form has one.
static pm_status read_rate(pm_yaml block, const pm_model_context *r, pm_form form,
                           pm_network_spec *rate) {
    static const char *const network_keys[] = {PM_NETWORK_KEYS, NULL};
    pm_yaml value = pm_yaml_get(block, "rate");
    *rate = (pm_network_spec){0};
    if (form != PM_FREE) {
        return pm_yaml_exists(value) ? pm_yaml_fail(value, "only form: free has a rate") : PM_OK;
    }
    PM_TRY(pm_yaml_require(block, "rate", &value));
    PM_TRY(pm_yaml_allow(value, network_keys));
    return pm_network_read(value, r->arena, rate);
}

// Reads a constant: a number, or {learned: start, positive: true, shared: true}.
static pm_status read_constant(pm_yaml value, double *number, pm_constant_kind *kind,
                               bool *shared) {
    static const char *const keys[] = {"learned", "positive", "shared", NULL};
    *kind = PM_CONSTANT_KNOWN;
    if (!pm_yaml_is_map(value)) {
        return pm_yaml_double(value, -INFINITY, INFINITY, number);
    }
    pm_yaml start;
    const pm_yaml positive = pm_yaml_get(value, "positive");
    const pm_yaml once = pm_yaml_get(value, "shared");
    bool stays = false;
    PM_TRY(pm_yaml_allow(value, keys));
    PM_TRY(pm_yaml_require(value, "learned", &start));
    PM_TRY(pm_yaml_double(start, -INFINITY, INFINITY, number));
    PM_TRY(pm_yaml_exists(positive) ? pm_yaml_bool(positive, &stays) : PM_OK);
    PM_TRY(pm_yaml_exists(once) ? pm_yaml_bool(once, shared) : PM_OK);
    *kind = stays ? PM_CONSTANT_POSITIVE : PM_CONSTANT_LEARNED;
    if (*shared && !stays) {
        return pm_yaml_fail(once, "only a positive constant is shared");
    }
    return stays && !(*number > 0)
               ? pm_yaml_fail(start, "a positive constant starts from a number > 0")
               : PM_OK;
}

// Adds the constants of a mapping, which may be absent. A constant that is already in the list
// keeps its value.
static pm_status add_constants(pm_yaml map, pm_arena *arena, pm_constants *constants,
                               const char **name, double *value, pm_constant_kind *learned,
                               bool *shared) {
    if (pm_yaml_exists(map)) {
        PM_TRY(pm_yaml_require_entries(map));
    }
    const int before = constants->count;
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, number;
        const int last = constants->count;
        pm_yaml_entry(map, i, &key, &number);
        PM_TRY(pm_yaml_text(key, arena, &name[last]));
        PM_TRY(read_constant(number, &value[last], &learned[last], &shared[last]));
        bool there = false;
        for (int k = 0; k < before; ++k) {
            there = there || strcmp(name[k], name[last]) == 0;
        }
        constants->count += !there;
    }
    return PM_OK;
}

static pm_status read_constants(pm_yaml first, pm_yaml second, pm_arena *arena,
                                const pm_constants **result) {
    const size_t most = (size_t)pm_yaml_count(first) + (size_t)pm_yaml_count(second);
    pm_constants *constants = pm_arena_array(arena, 1, sizeof *constants);
    const char **name = pm_arena_array(arena, most, sizeof *name);
    double *value = pm_arena_array(arena, most, sizeof *value);
    pm_constant_kind *learned = pm_arena_array(arena, most, sizeof *learned);
    bool *shared = pm_arena_array(arena, most, sizeof *shared);
    if (constants == NULL || name == NULL || value == NULL || learned == NULL || shared == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    *constants = (pm_constants){0, name, value, learned, shared};
    PM_TRY(add_constants(first, arena, constants, name, value, learned, shared));
    PM_TRY(add_constants(second, arena, constants, name, value, learned, shared));
    *result = constants;
    return PM_OK;
}

// Reads the keys that the blocks of parts and of ports share. The constants `own` replace constants
// of the same name in the block.
static pm_status read_model(pm_yaml block, pm_yaml own, pm_arena *arena,
                            const pm_constants **constants, pm_form *form,
                            pm_potential_spec *energy, pm_potential_spec *entropy,
                            pm_operator_spec *reversible, pm_operator_spec *irreversible,
                            pm_network_spec *rate) {
    int choice;
    PM_TRY(read_constants(own, pm_yaml_get(block, "constants"), arena, constants));
    PM_TRY(pm_model_read_choice(block, "form", form_names, &choice));
    *form = (pm_form)choice;
    const pm_model_context r = {arena, *constants};
    PM_TRY(read_rate(block, &r, *form, rate));
    PM_TRY(pm_model_read_potential(pm_yaml_get(block, "energy"), &r, energy));
    PM_TRY(pm_model_read_potential(pm_yaml_get(block, "entropy"), &r, entropy));
    PM_TRY(pm_model_read_operator(pm_yaml_get(block, "reversible"), &r, true, reversible));
    return pm_model_read_operator(pm_yaml_get(block, "irreversible"), &r, false, irreversible);
}

// Reads the matrix of the law contact. No other law has one.
static pm_status read_law_matrix(pm_yaml value, const char *law, pm_arena *arena,
                                 pm_matrix_spec *matrix) {
    if (pm_yaml_exists(value) && strcmp(law, "contact") != 0) {
        return pm_yaml_fail(value, "only law: contact has a matrix");
    }
    if (pm_yaml_is_text(value, "identity")) {
        *matrix = (pm_matrix_spec){.identity = true};
        return pm_model_read_at(value, arena, &matrix->at);
    }
    return pm_model_read_matrix(value, arena, matrix);
}

// Reads a solid. *solid becomes NULL if the block does not exist.
static pm_status read_solid(pm_yaml block, pm_arena *arena, const pm_solid_spec **solid) {
    static const char *const keys[] = {"branches", "units", "temperature", NULL};
    *solid = NULL;
    if (!pm_yaml_exists(block)) {
        return PM_OK;
    }
    const pm_yaml branches = pm_yaml_get(block, "branches"), units = pm_yaml_get(block, "units"),
                  temperature = pm_yaml_get(block, "temperature");
    pm_solid_spec *read = pm_arena_alloc(arena, sizeof *read);
    if (read == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    *read = (pm_solid_spec){.nbranch = 2, .temperature = PM_DEFAULT_TEMPERATURE};
    PM_TRY(pm_yaml_allow(block, keys));
    if (pm_yaml_exists(branches)) {
        PM_TRY(pm_yaml_int(branches, 0, PM_SOLID_MAX_BRANCHES, &read->nbranch));
    }
    if (pm_yaml_exists(units)) {
        PM_TRY(pm_yaml_int(units, 0, PM_SOLID_MAX_UNITS, &read->nunit));
    }
    if (pm_yaml_exists(temperature)) {
        PM_TRY(pm_yaml_double(temperature, DBL_MIN, DBL_MAX, &read->temperature));
    }
    *solid = read;
    return PM_OK;
}

pm_status pm_part_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_part_spec *spec) {
    static const char *const keys[] = {MODEL_KEYS, "derived", "solid", NULL};
    pm_part_spec read;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_model_read_at(block, arena, &read.at));
    PM_TRY(read_model(block, constants, arena, &read.constants, &read.form, &read.energy,
                      &read.entropy, &read.reversible, &read.irreversible, &read.rate));
    PM_TRY(pm_model_read_derived(pm_yaml_get(block, "derived"), arena, &read));
    PM_TRY(read_solid(pm_yaml_get(block, "solid"), arena, &read.solid));
    *spec = read;
    return PM_OK;
}

// Reads which ends have a boundary term. No other law lets one choose.
static pm_status read_ends(pm_yaml block, const char *law, pm_term_ends *ends) {
    static const char *const names[] = {
        [PM_BOTH_ENDS] = "both", [PM_END_A_ALONE] = "a", [PM_END_B_ALONE] = "b", NULL};
    const pm_yaml value = pm_yaml_get(block, "ends");
    int choice;
    if (pm_yaml_exists(value) && strcmp(law, "exchange") != 0) {
        return pm_yaml_fail(value, "only law: exchange has boundary terms at chosen ends");
    }
    PM_TRY(pm_model_read_choice(block, "ends", names, &choice));
    *ends = (pm_term_ends)choice;
    return PM_OK;
}

pm_status pm_port_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_port_spec *spec) {
    static const char *const keys[] = {"law", MODEL_KEYS, "matrix", "ends", NULL};
    pm_port_spec read;
    pm_yaml law;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_model_read_at(block, arena, &read.at));
    PM_TRY(pm_yaml_require(block, "law", &law));
    PM_TRY(pm_yaml_text(law, arena, &read.law));
    if (pm_port_law_find(read.law) == NULL) {
        return pm_yaml_fail(law, "expected one of %s, found \"%.64s\"", pm_port_law_names(),
                            read.law);
    }
    PM_TRY(read_law_matrix(pm_yaml_get(block, "matrix"), read.law, arena, &read.matrix));
    PM_TRY(read_ends(block, read.law, &read.ends));
    PM_TRY(read_model(block, constants, arena, &read.constants, &read.form, &read.energy,
                      &read.entropy, &read.reversible, &read.irreversible, &read.rate));
    *spec = read;
    return PM_OK;
}

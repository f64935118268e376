// Reads the `model:` block into the plain data of model/spec.h, and writes it. What is read lies in
// the arena, so that it outlives the document; a reader fails with PM_ECONFIG, naming the place in
// the file, or with PM_ENOMEM.
#include "scene/model_reader.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/convex.h"
#include "model/port.h"
#include "model/potential.h"
#include "model/solid/material.h"

#define MAX_LAYERS 16
#define MAX_WIDTH 4096 // of a hidden layer
#define MAX_RANK 64
#define MAX_SIZE 1000000 // components of a derived variable
#define COLDEST 1e-300   // K, at which the training of a thermal energy may start
#define HOTTEST 1e300    // K

static const char *const form_names[] = {
    [PM_HARD] = "hard", [PM_SOFT] = "soft", [PM_FREE] = "free", NULL};
static const char *const activation_names[] = {
    [PM_TANH] = "tanh", [PM_SOFTPLUS] = "softplus", [PM_SILU] = "silu", NULL};
static const char *const skip_names[] = {[PM_SKIP_NONE] = "none",
                                         [PM_SKIP_LINEAR] = "linear",
                                         [PM_SKIP_QUADRATIC] = "quadratic",
                                         [PM_SKIP_QUARTIC] = "quartic",
                                         NULL};
static const char *const ends_names[] = {
    [PM_BOTH_ENDS] = "both", [PM_END_A_ALONE] = "a", [PM_END_B_ALONE] = "b", NULL};

// The data that all readers of a block share.
typedef struct context {
    pm_arena *arena;
    const pm_constants *constants; // that formulas may name
} context;

static pm_status check_memory(const pm_arena *arena) {
    return pm_arena_status(arena, "a model");
}

// Returns true if a value is absent or the word "none".
static bool is_none(pm_yaml value) {
    return !pm_yaml_exists(value) || pm_yaml_is_text(value, "none");
}

// Reads the text of a formula. Its names are checked later (pm_formula_check).
static pm_status read_formula(pm_yaml text, const context *r, pm_formula *formula) {
    formula->constants = r->constants;
    formula->at = pm_yaml_where(text, r->arena);
    return pm_yaml_text(text, r->arena, &formula->text);
}

// --- networks ---

// The values of the keys of a network, which stand among other keys of a block.
typedef struct network_values {
    pm_yaml features, hidden;
    int activation, skip;
} network_values;

#define NETWORK_KEYS(v)                                                                 \
    {PM_YAML_VALUE("features", &(v).features)}, {PM_YAML_VALUE("hidden", &(v).hidden)}, \
        {PM_YAML_CHOICE("activation", &(v).activation, activation_names)}, {            \
        PM_YAML_CHOICE("skip", &(v).skip, skip_names)                                   \
    }

// Makes a network of the values, which belong to `block`.
static pm_status make_network(const network_values *v, pm_yaml block, pm_arena *arena,
                              pm_network_spec *network) {
    const char **feature = NULL;
    int *width = NULL;
    const bool any = pm_yaml_exists(v->features);
    *network = (pm_network_spec){.activation = (pm_activation)v->activation,
                                 .skip = (pm_skip)v->skip,
                                 .at = pm_yaml_where(any ? v->features : block, arena)};
    PM_TRY(any ? pm_yaml_texts(v->features, arena, &network->nfeature, &feature) : PM_OK);
    network->feature = feature;
    if (pm_yaml_exists(v->hidden)) {
        PM_TRY(pm_yaml_ints(v->hidden, 1, MAX_WIDTH, arena, &network->nhidden, &width));
        if (network->nhidden > MAX_LAYERS) {
            return pm_yaml_fail(v->hidden, "%d layers, at most %d are possible", network->nhidden,
                                MAX_LAYERS);
        }
    }
    network->hidden = width;
    return PM_OK;
}

// Reads a block that has the keys of a network alone.
static pm_status read_network(pm_yaml block, pm_arena *arena, pm_network_spec *network) {
    network_values v = {.activation = 0};
    const pm_yaml_key keys[] = {NETWORK_KEYS(v), {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    return make_network(&v, block, arena, network);
}

// --- potentials ---

// Reads one network of a potential. With `zero_at_origin` the output and its slope vanish where all
// features are zero. The entropies of a thermal energy become the last features.
static pm_status read_term(pm_yaml item, pm_arena *arena, pm_network_spec *term) {
    network_values v = {.activation = 0};
    pm_network_spec own = {.nfeature = 0};
    const char *const *entropy = NULL;
    pm_yaml zero, thermal;
    const pm_yaml_key keys[] = {
        NETWORK_KEYS(v),
        {PM_YAML_VALUE("zero_at_origin", &zero)},
        {PM_YAML_VALUE("thermal", &thermal)},
        // Without `thermal` the physical defaults of training may still make the energy thermal.
        {PM_YAML_INT("exponentials", &own.exponentials, 1, PM_MAX_EXPONENTIALS)},
        {PM_YAML_DOUBLE("temperature", &own.temperature, COLDEST, HOTTEST)},
        {PM_YAML_BOOL("scaled", &own.scaled)},
        {PM_YAML_BOOL("separate", &own.separate)},
        {PM_YAML_BOOL("rising", &own.rising)},
        {0}};
    PM_TRY(pm_yaml_read(item, arena, keys));
    PM_TRY(make_network(&v, item, arena, term));
    term->exponentials = own.exponentials;
    term->temperature = own.temperature;
    term->scaled = own.scaled;
    term->separate = own.separate;
    term->rising = own.rising;
    if (pm_yaml_exists(thermal)) {
        const char **names = NULL;
        PM_TRY(pm_yaml_texts(thermal, arena, &term->nthermal, &names));
        entropy = names;
        if (term->nthermal < 1 || term->nthermal + term->nfeature > PM_MAX_FEATURES) {
            return pm_yaml_fail(thermal, "expected 1 to %d entropies",
                                PM_MAX_FEATURES - term->nfeature);
        }
        term->exponentials = own.exponentials > 0 ? own.exponentials : PM_DEFAULT_EXPONENTIALS;
        term->temperature = own.temperature > 0 ? own.temperature : PM_DEFAULT_TEMPERATURE;
        term->scaled = true;
        const int before = term->nfeature, count = before + term->nthermal;
        const char **all = pm_arena_array(arena, (size_t)count, sizeof *all);
        PM_TRY(check_memory(arena));
        for (int i = 0; i < count; ++i) {
            all[i] = i < before ? term->feature[i] : entropy[i - before];
        }
        term->feature = all;
        term->nfeature = count;
    }
    PM_TRY(pm_yaml_exists(zero) ? pm_yaml_bool(zero, &term->zero_at_origin) : PM_OK);
    const bool able = term->nfeature > 0 && term->nthermal == 0 && term->skip != PM_SKIP_NONE;
    return able || !term->zero_at_origin
               ? PM_OK
               : pm_yaml_fail(zero,
                              "only a network of features with a skip can be zero at the origin");
}

// Adds a linear form to a potential: a group, a list of groups, or a mapping to coefficients.
static pm_status read_given(pm_yaml given, pm_arena *arena, pm_potential_spec *potential) {
    const int before = potential->ngiven;
    const bool map = pm_yaml_is_map(given);
    const int total = before + (map || pm_yaml_is_list(given) ? pm_yaml_count(given) : 1);
    const char **group = pm_arena_array(arena, (size_t)total, sizeof *group);
    double *coefficient = pm_arena_array(arena, (size_t)total, sizeof *coefficient);
    PM_TRY(check_memory(arena));
    for (int i = 0; i < total; ++i) {
        pm_yaml key, value;
        coefficient[i] = i < before ? potential->given_coefficient[i] : 1;
        if (i < before) {
            group[i] = potential->given[i];
        } else if (map) {
            pm_yaml_entry(given, i - before, &key, &value);
            PM_TRY(pm_yaml_text(key, arena, &group[i]));
            PM_TRY(pm_yaml_double(value, -INFINITY, INFINITY, &coefficient[i]));
        } else {
            PM_TRY(pm_yaml_text(pm_yaml_item_or_self(given, i - before), arena, &group[i]));
        }
    }
    potential->given = group;
    potential->given_coefficient = coefficient;
    potential->ngiven = total;
    return PM_OK;
}

// Reads {inertia: {...}} or {capacity: {...}}.
static pm_status read_convex(pm_yaml item, pm_arena *arena, pm_convex_spec *convex) {
    network_values v = {.activation = 0};
    pm_yaml inertia, capacity, of;
    const char **group = NULL;
    convex->nterm = 1;
    const pm_yaml_key item_keys[] = {
        {PM_YAML_VALUE("inertia", &inertia)}, {PM_YAML_VALUE("capacity", &capacity)}, {0}};
    const pm_yaml_key inertia_keys[] = {{PM_YAML_VALUE("of", &of), .required = true},
                                        {PM_YAML_DOUBLE("first", &convex->first, DBL_MIN, DBL_MAX)},
                                        NETWORK_KEYS(v),
                                        {0}};
    const pm_yaml_key capacity_keys[] = {
        {PM_YAML_VALUE("of", &of), .required = true},
        {PM_YAML_INT("terms", &convex->nterm, 1, PM_MAX_TERMS)},
        {PM_YAML_DOUBLE("first", &convex->first, DBL_MIN, DBL_MAX)},
        {0}};
    PM_TRY(pm_yaml_read(item, arena, item_keys));
    const bool is_inertia = pm_yaml_exists(inertia);
    if (is_inertia == pm_yaml_exists(capacity)) {
        return pm_yaml_fail(item, "expected either \"inertia\" or \"capacity\"");
    }
    const pm_yaml block = is_inertia ? inertia : capacity;
    PM_TRY(pm_yaml_read(block, arena, is_inertia ? inertia_keys : capacity_keys));
    PM_TRY(pm_yaml_texts(of, arena, &convex->ngroup, &group));
    convex->kind = is_inertia ? PM_CONVEX_INERTIA : PM_CONVEX_CAPACITY;
    convex->group = group;
    convex->at = pm_yaml_where(block, arena);
    if (convex->ngroup < 1 || (!is_inertia && convex->ngroup > 1)) {
        return pm_yaml_fail(of, "expected %s", is_inertia ? "at least one group" : "one group");
    }
    return is_inertia ? make_network(&v, block, arena, &convex->network) : PM_OK;
}

// Reads `energy:`, `coenergy:` or `entropy:`: one summand or a list of them, each of them a
// formula, a linear form {given: ...}, a network or a convex term. A value that is absent or "none"
// gives no summand.
static pm_status read_potential(pm_yaml value, const context *r, pm_potential_spec *potential) {
    *potential = (pm_potential_spec){0};
    if (is_none(value)) {
        return PM_OK;
    }
    const int count = pm_yaml_is_list(value) ? pm_yaml_count(value) : 1;
    pm_network_spec *term = pm_arena_array(r->arena, (size_t)count, sizeof *term);
    pm_formula *formula = pm_arena_array(r->arena, (size_t)count, sizeof *formula);
    pm_convex_spec *convex = pm_arena_array(r->arena, (size_t)count, sizeof *convex);
    potential->at = pm_yaml_where(value, r->arena);
    potential->convex = convex;
    potential->term = term;
    potential->formula = formula;
    PM_TRY(check_memory(r->arena));
    for (int i = 0; i < count; ++i) {
        const pm_yaml item = pm_yaml_item_or_self(value, i);
        pm_yaml given = pm_yaml_get(item, "given");
        if (!pm_yaml_is_map(item)) {
            PM_TRY(read_formula(item, r, &formula[potential->nformula++]));
        } else if (pm_yaml_exists(pm_yaml_get(item, "inertia")) ||
                   pm_yaml_exists(pm_yaml_get(item, "capacity"))) {
            PM_TRY(read_convex(item, r->arena, &convex[potential->nconvex++]));
        } else if (!pm_yaml_exists(given)) {
            PM_TRY(read_term(item, r->arena, &term[potential->nterm++]));
        } else {
            const pm_yaml_key keys[] = {{PM_YAML_VALUE("given", &given)}, {0}};
            PM_TRY(pm_yaml_read(item, r->arena, keys));
            PM_TRY(read_given(given, r->arena, potential));
        }
    }
    return PM_OK;
}

// --- operators ---

// Reads a number, or else a formula.
static pm_status read_coefficient(pm_yaml value, const context *r, double *number,
                                  pm_formula *formula) {
    return pm_yaml_double(value, -INFINITY, INFINITY, number) == PM_OK
               ? PM_OK
               : read_formula(value, r, formula);
}

// Reads the row of a pair: a name, or a direction such as {A: 1, B: -2}.
static pm_status read_row(pm_yaml value, const context *r, pm_given_pair *pair) {
    const int count = pm_yaml_is_map(value) ? pm_yaml_count(value) : 0;
    if (count == 0) {
        return pm_yaml_text(value, r->arena, &pair->row);
    }
    pm_direction_term *term = pm_arena_array(r->arena, (size_t)count, sizeof *term);
    PM_TRY(check_memory(r->arena));
    for (int i = 0; i < count; ++i) {
        pm_yaml key, coefficient;
        pm_yaml_entry(value, i, &key, &coefficient);
        PM_TRY(pm_yaml_text(key, r->arena, &term[i].name));
        PM_TRY(read_coefficient(coefficient, r, &term[i].coefficient, &term[i].formula));
    }
    pair->row = term[0].name;
    pair->direction = term;
    pair->ndirection = count;
    return PM_OK;
}

static pm_status read_pairs(pm_yaml list, const context *r, pm_operator_spec *op) {
    if (!pm_yaml_is_list(list)) {
        return pm_yaml_fail(list, "expected a list of pairs such as [[q, p, 1.0]]");
    }
    const int count = pm_yaml_count(list);
    pm_given_pair *pair = pm_arena_array(r->arena, (size_t)count, sizeof *pair);
    PM_TRY(check_memory(r->arena));
    for (int i = 0; i < count; ++i) {
        const pm_yaml item = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(item) || pm_yaml_count(item) != 3) {
            return pm_yaml_fail(item, "expected a pair such as [q, p, 1.0]: row, column, "
                                      "coefficient");
        }
        const pm_yaml coefficient = pm_yaml_item(item, 2);
        PM_TRY(read_row(pm_yaml_item(item, 0), r, &pair[i]));
        PM_TRY(pm_yaml_text(pm_yaml_item(item, 1), r->arena, &pair[i].col));
        pair[i].cross = pm_yaml_is_text(coefficient, "cross");
        PM_TRY(pair[i].cross
                   ? PM_OK
                   : read_coefficient(coefficient, r, &pair[i].coefficient, &pair[i].formula));
    }
    op->given = pair;
    op->ngiven = count;
    return PM_OK;
}

static pm_status read_learned(pm_yaml block, pm_arena *arena, bool reversible,
                              pm_operator_spec *op) {
    network_values v = {.activation = 0};
    pm_yaml acts, strength = {0};
    op->learned = true;
    op->rank = reversible ? 0 : 1;
    const pm_yaml_key reversible_keys[] = {{PM_YAML_VALUE("acts_on", &acts), .required = true},
                                           {PM_YAML_TEXTS("against", &op->nagainst, &op->against)},
                                           {PM_YAML_TEXTS("along", &op->nalong, &op->along)},
                                           NETWORK_KEYS(v),
                                           {0}};
    const pm_yaml_key irreversible_keys[] = {
        {PM_YAML_VALUE("acts_on", &acts), .required = true},
        {PM_YAML_TEXTS("against", &op->nagainst, &op->against)},
        {PM_YAML_TEXTS("along", &op->nalong, &op->along)},
        {PM_YAML_INT("rank", &op->rank, 1, MAX_RANK)},
        {PM_YAML_TEXTS("heats", &op->nheats, &op->heats)},
        {PM_YAML_VALUE("strength", &strength)},
        NETWORK_KEYS(v),
        {0}};
    PM_TRY(pm_yaml_read(block, arena, reversible ? reversible_keys : irreversible_keys));
    const char **names = NULL;
    PM_TRY(pm_yaml_texts(acts, arena, &op->nacts, &names));
    op->acts_on = names;
    if (op->nacts == 0) {
        return pm_yaml_fail(acts, "expected at least one group");
    }
    if (pm_yaml_exists(strength)) {
        pm_network_spec *network = pm_arena_alloc(arena, sizeof *network);
        PM_TRY(check_memory(arena));
        PM_TRY(read_network(strength, arena, network));
        if (network->nfeature == 0) {
            return pm_yaml_fail(strength, "a strength needs features");
        }
        op->strength = network;
    }
    return make_network(&v, block, arena, &op->network);
}

// Reads `reversible:` or `irreversible:`: given pairs, a learned operator, or both. A block that is
// absent or "none" gives no operator.
static pm_status read_operator(pm_yaml block, const context *r, bool reversible,
                               pm_operator_spec *op) {
    *op = (pm_operator_spec){0};
    if (is_none(block)) {
        return PM_OK;
    }
    pm_yaml given, learned, heats;
    const char **names = NULL;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("given", &given)},
                                {PM_YAML_VALUE("learned", &learned)},
                                {PM_YAML_VALUE("heats", &heats)},
                                {0}};
    op->at = pm_yaml_where(block, r->arena);
    PM_TRY(pm_yaml_read(block, r->arena, keys));
    PM_TRY(pm_yaml_exists(given) ? read_pairs(given, r, op) : PM_OK);
    if (pm_yaml_exists(heats)) {
        if (reversible) {
            return pm_yaml_fail(heats, "only an irreversible operator heats");
        }
        PM_TRY(pm_yaml_texts(heats, r->arena, &op->nheats, &names));
        op->heats = names;
    }
    return is_none(learned) ? PM_OK : read_learned(learned, r->arena, reversible, op);
}

// --- matrices and derived variables ---

// Reads a matrix, row by row. If the list is absent, the matrix has no numbers. Its size is checked
// later against the groups that it couples.
static pm_status read_matrix(pm_yaml list, pm_arena *arena, pm_matrix_spec *matrix) {
    *matrix = (pm_matrix_spec){0};
    if (!pm_yaml_exists(list)) {
        return PM_OK;
    }
    matrix->at = pm_yaml_where(list, arena);
    const int rows = pm_yaml_is_list(list) ? pm_yaml_count(list) : 0;
    const int cols = rows > 0 ? pm_yaml_count(pm_yaml_item(list, 0)) : 0;
    if (cols == 0) {
        return pm_yaml_fail(list, "expected a list of rows such as [[1.0, 0.0], [0.0, 1.0]]");
    }
    for (int i = 0; i < rows; ++i) { // before memory is taken
        const pm_yaml row = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(row) || pm_yaml_count(row) != cols) {
            return pm_yaml_fail(row, "expected a row of %d numbers like the first, found %d", cols,
                                pm_yaml_count(row));
        }
    }
    double *value = pm_arena_array(arena, (size_t)rows * (size_t)cols, sizeof *value);
    PM_TRY(check_memory(arena));
    for (int i = 0; i < rows * cols; ++i) {
        PM_TRY(pm_yaml_double(pm_yaml_item(pm_yaml_item(list, i / cols), i % cols), -INFINITY,
                              INFINITY, &value[i]));
    }
    matrix->rows = rows;
    matrix->cols = cols;
    matrix->value = value;
    return PM_OK;
}

// Reads one derived variable. The block holds its matrix, or only its size if the weights file
// holds the matrix.
static pm_status read_derived(pm_yaml block, pm_arena *arena, pm_derived_spec *derived) {
    pm_yaml of, size, matrix, offset;
    const char **names = NULL;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("of", &of), .required = true},
                                {PM_YAML_VALUE("size", &size)},
                                {PM_YAML_VALUE("matrix", &matrix)},
                                {PM_YAML_VALUE("offset", &offset)},
                                {0}};
    derived->at = pm_yaml_where(block, arena);
    PM_TRY(pm_yaml_read(block, arena, keys));
    PM_TRY(pm_yaml_texts(of, arena, &derived->ngroup, &names));
    derived->group = names;
    if (derived->ngroup < 1 || derived->ngroup > PM_MAX_GROUPS) {
        return pm_yaml_fail(of, "expected 1 to %d groups", PM_MAX_GROUPS);
    }
    PM_TRY(read_matrix(matrix, arena, &derived->matrix));
    derived->size = derived->matrix.rows;
    if (pm_yaml_exists(size) || !pm_yaml_exists(matrix)) {
        PM_TRY(pm_yaml_require(block, "size", &size));
        PM_TRY(pm_yaml_int(size, 1, MAX_SIZE, &derived->size));
    }
    if (pm_yaml_exists(offset)) {
        int count;
        double *value;
        PM_TRY(pm_yaml_doubles(offset, arena, &count, &value));
        if (!pm_yaml_exists(matrix)) {
            return pm_yaml_fail(offset, "expected a matrix beside it");
        }
        if (count != derived->size) {
            return pm_yaml_fail(offset, "expected %d numbers, found %d", derived->size, count);
        }
        derived->offset = value;
    }
    return PM_OK;
}

// --- constants ---

// Reads whether a constant is optional: true, false, or a list of constants that mean nothing
// without it. These are constants of the model, which has those of the two maps.
static pm_status read_optional(pm_yaml value, const pm_yaml *map, pm_arena *arena,
                               const char **optional) {
    int count = 0;
    const char **name = NULL;
    bool is = false;
    if (!pm_yaml_is_list(value)) {
        PM_TRY(pm_yaml_exists(value) ? pm_yaml_bool(value, &is) : PM_OK);
        *optional = is ? "" : NULL;
        return PM_OK;
    }
    PM_TRY(pm_yaml_texts(value, arena, &count, &name));
    *optional = " ";
    for (int i = 0; i < count; ++i) {
        if (!pm_yaml_exists(pm_yaml_get(map[0], name[i])) &&
            !pm_yaml_exists(pm_yaml_get(map[1], name[i]))) {
            return pm_yaml_fail(pm_yaml_item(value, i),
                                "expected a constant of the model, found \"%.64s\"", name[i]);
        }
        *optional = pm_arena_printf(arena, "%s%s ", *optional, name[i]);
    }
    return check_memory(arena);
}

// Reads a constant: a number, or {learned: start, positive: true, shared: true, optional: true}.
static pm_status read_constant(pm_yaml value, const pm_yaml *map, pm_arena *arena, double *number,
                               pm_constant_kind *kind, bool *shared, const char **optional) {
    *kind = PM_CONSTANT_KNOWN;
    if (!pm_yaml_is_map(value)) {
        return pm_yaml_double(value, -INFINITY, INFINITY, number);
    }
    bool positive = false;
    pm_yaml start, once, may;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("learned", &start), .required = true},
                                {PM_YAML_BOOL("positive", &positive)},
                                {PM_YAML_VALUE("shared", &once)},
                                {PM_YAML_VALUE("optional", &may)},
                                {0}};
    PM_TRY(pm_yaml_read(value, arena, keys));
    PM_TRY(pm_yaml_double(start, -INFINITY, INFINITY, number));
    PM_TRY(pm_yaml_exists(once) ? pm_yaml_bool(once, shared) : PM_OK);
    PM_TRY(read_optional(may, map, arena, optional));
    *kind = positive ? PM_CONSTANT_POSITIVE : PM_CONSTANT_LEARNED;
    if (*shared && !positive) {
        return pm_yaml_fail(once, "only a positive constant is shared");
    }
    return positive && !(*number > 0)
               ? pm_yaml_fail(start, "a positive constant starts from a number > 0")
               : PM_OK;
}

// --- blocks ---

// The values of the keys that the blocks of parts and of ports share.
typedef struct model_values {
    int form;
    pm_yaml energy, entropy, reversible, irreversible, rate, constants;
} model_values;

#define MODEL_KEYS(v)                                                                             \
    {PM_YAML_CHOICE("form", &(v).form, form_names)}, {PM_YAML_VALUE("energy", &(v).energy)},      \
        {PM_YAML_VALUE("entropy", &(v).entropy)}, {PM_YAML_VALUE("reversible", &(v).reversible)}, \
        {PM_YAML_VALUE("irreversible", &(v).irreversible)}, {PM_YAML_VALUE("rate", &(v).rate)}, { \
        PM_YAML_VALUE("constants", &(v).constants)                                                \
    }

// Reads what these values hold. The constants `own` replace constants of the same name in the
// block.
static pm_status read_model(const model_values *v, pm_yaml block, pm_yaml own, pm_arena *arena,
                            const pm_constants **constants, pm_potential_spec *energy,
                            pm_potential_spec *entropy, pm_operator_spec *reversible,
                            pm_operator_spec *irreversible, pm_network_spec *rate) {
    const pm_yaml map[2] = {own, v->constants}; // the first takes precedence
    const size_t most = (size_t)pm_yaml_count(own) + (size_t)pm_yaml_count(v->constants);
    pm_constants *list = pm_arena_array(arena, 1, sizeof *list);
    const char **name = pm_arena_array(arena, most, sizeof *name);
    double *value = pm_arena_array(arena, most, sizeof *value);
    pm_constant_kind *learned = pm_arena_array(arena, most, sizeof *learned);
    bool *shared = pm_arena_array(arena, most, sizeof *shared);
    const char **optional = pm_arena_array(arena, most, sizeof *optional);
    PM_TRY(check_memory(arena));
    int count = 0;
    for (int m = 0; m < 2; ++m) {
        PM_TRY(pm_yaml_exists(map[m]) ? pm_yaml_require_entries(map[m]) : PM_OK);
        const int before = count;
        for (int i = 0; i < pm_yaml_count(map[m]); ++i) {
            pm_yaml key, number;
            pm_yaml_entry(map[m], i, &key, &number);
            PM_TRY(pm_yaml_text(key, arena, &name[count]));
            PM_TRY(read_constant(number, map, arena, &value[count], &learned[count], &shared[count],
                                 &optional[count]));
            bool there = false;
            for (int k = 0; k < before; ++k) {
                there = there || strcmp(name[k], name[count]) == 0;
            }
            count += !there;
        }
    }
    *list = (pm_constants){count, name, value, learned, shared, optional};
    *constants = list;
    const context r = {arena, *constants};
    if (v->form == PM_FREE) {
        pm_yaml network;
        PM_TRY(pm_yaml_require(block, "rate", &network));
        PM_TRY(read_network(network, arena, rate));
    } else if (pm_yaml_exists(v->rate)) {
        return pm_yaml_fail(v->rate, "only form: free has a rate");
    }
    PM_TRY(read_potential(v->energy, &r, energy));
    PM_TRY(read_potential(v->entropy, &r, entropy));
    PM_TRY(read_operator(v->reversible, &r, true, reversible));
    return read_operator(v->irreversible, &r, false, irreversible);
}

pm_status pm_part_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_part_spec *spec) {
    model_values v = {.form = PM_HARD};
    pm_yaml derived, solid, coenergy;
    const pm_yaml_key keys[] = {MODEL_KEYS(v),
                                {PM_YAML_VALUE("coenergy", &coenergy)},
                                {PM_YAML_VALUE("derived", &derived)},
                                {PM_YAML_VALUE("solid", &solid)},
                                {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    pm_part_spec read = {.at = pm_yaml_where(block, arena), .form = (pm_form)v.form};
    PM_TRY(read_model(&v, block, constants, arena, &read.constants, &read.energy, &read.entropy,
                      &read.reversible, &read.irreversible, &read.rate));
    const context r = {arena, read.constants};
    PM_TRY(read_potential(coenergy, &r, &read.coenergy));
    PM_TRY(pm_yaml_exists(derived) ? pm_yaml_require_entries(derived) : PM_OK);
    const int count = pm_yaml_count(derived);
    if (count > PM_MAX_DERIVED) {
        return pm_yaml_fail(derived, "%d derived variables, at most %d are possible", count,
                            PM_MAX_DERIVED);
    }
    pm_derived_spec *variable = pm_arena_array(arena, (size_t)count, sizeof *variable);
    PM_TRY(check_memory(arena));
    for (int i = 0; i < count; ++i) {
        pm_yaml key, value;
        pm_yaml_entry(derived, i, &key, &value);
        PM_TRY(pm_yaml_text(key, arena, &variable[i].name));
        PM_TRY(read_derived(value, arena, &variable[i]));
    }
    read.nderived = count;
    read.derived = variable;
    if (pm_yaml_exists(solid)) {
        pm_solid_spec *s = pm_arena_alloc(arena, sizeof *s);
        PM_TRY(check_memory(arena));
        *s = (pm_solid_spec){.nbranch = 2, .temperature = PM_DEFAULT_TEMPERATURE};
        read.solid = s;
        const pm_yaml_key solid_keys[] = {
            {PM_YAML_INT("branches", &s->nbranch, 0, PM_SOLID_MAX_BRANCHES)},
            {PM_YAML_INT("units", &s->nunit, 0, PM_SOLID_MAX_UNITS)},
            {PM_YAML_DOUBLE("temperature", &s->temperature, DBL_MIN, DBL_MAX)},
            {0}};
        PM_TRY(pm_yaml_read(solid, arena, solid_keys));
    }
    PM_TRY(check_memory(arena));
    *spec = read;
    return PM_OK;
}

pm_status pm_port_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_port_spec *spec) {
    model_values v = {.form = PM_HARD};
    pm_port_spec read = {.law = NULL};
    pm_yaml law, matrix, ends;
    int choice = PM_BOTH_ENDS;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("law", &law), .required = true},
                                MODEL_KEYS(v),
                                {PM_YAML_VALUE("matrix", &matrix)},
                                {PM_YAML_VALUE("ends", &ends)},
                                {0}};
    PM_TRY(pm_yaml_read(block, arena, keys));
    read.at = pm_yaml_where(block, arena);
    read.form = (pm_form)v.form;
    PM_TRY(pm_yaml_text(law, arena, &read.law));
    const pm_port_law *kind = pm_port_law_find(read.law);
    if (kind == NULL) {
        return pm_yaml_fail(law, "expected one of %s, found \"%.64s\"", pm_port_law_names(),
                            read.law);
    }
    if (pm_yaml_exists(matrix) && !kind->has_matrix) {
        return pm_yaml_fail(matrix, "only law: contact has a matrix");
    }
    if (pm_yaml_is_text(matrix, "identity")) {
        read.matrix = (pm_matrix_spec){.identity = true, .at = pm_yaml_where(matrix, arena)};
    } else {
        PM_TRY(read_matrix(matrix, arena, &read.matrix));
    }
    if (pm_yaml_exists(ends)) {
        if (!kind->has_ends) {
            return pm_yaml_fail(ends, "only law: exchange has boundary terms at chosen ends");
        }
        PM_TRY(pm_yaml_choice(ends, ends_names, &choice));
    }
    read.ends = (pm_term_ends)choice;
    PM_TRY(read_model(&v, block, constants, arena, &read.constants, &read.energy, &read.entropy,
                      &read.reversible, &read.irreversible, &read.rate));
    PM_TRY(check_memory(arena));
    *spec = read;
    return PM_OK;
}

// --- writing ---
//
// The text is part of the digest of weights, so that any change to it changes all digests.

// Writes a text between quotes.
static void write_quoted(FILE *file, const char *text) {
    fputc('"', file);
    for (const char *c = text; *c != '\0'; ++c) {
        if (*c == '"' || *c == '\\') {
            fputc('\\', file);
        }
        fputc(*c, file);
    }
    fputc('"', file);
}

// Writes `before`, and then a text: as it is if it consists of letters, digits, '_' and '.', and
// between quotes otherwise.
static void write_text(FILE *file, const char *before, const char *text) {
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.";
    fputs(before, file);
    if (text[0] != '\0' && text[strspn(text, plain)] == '\0') {
        fputs(text, file);
    } else {
        write_quoted(file, text);
    }
}

// Writes `before`, and then "<key>: [<names>]".
static void write_names(FILE *file, const char *before, const char *key, int count,
                        const char *const *names) {
    fprintf(file, "%s%s: [", before, key);
    for (int i = 0; i < count; ++i) {
        write_text(file, i == 0 ? "" : ", ", names[i]);
    }
    fputc(']', file);
}

// Writes `before`, and then a number with 15 significant digits if they give the same number, else
// with 17.
static void write_number(FILE *file, const char *before, double number) {
    char text[32];
    snprintf(text, sizeof text, "%.15g", number);
    fprintf(file, "%s%.*g", before, strtod(text, NULL) == number ? 15 : 17, number);
}

// Writes the keys of a network and their values, without the braces around them.
static void write_network(FILE *file, const pm_network_spec *network, int nfeature) {
    write_names(file, "", "features", nfeature, network->feature);
    fputs(", hidden: [", file);
    for (int i = 0; i < network->nhidden; ++i) {
        fprintf(file, "%s%d", i == 0 ? "" : ", ", network->hidden[i]);
    }
    fprintf(file, "], activation: %s, skip: %s%s", activation_names[network->activation],
            skip_names[network->skip], network->zero_at_origin ? ", zero_at_origin: true" : "");
}

static void write_potential(FILE *file, const char *key, const pm_potential_spec *potential) {
    if (!pm_potential_exists(potential)) {
        return;
    }
    fprintf(file, "%s:\n", key);
    for (int i = 0; i < potential->nformula; ++i) {
        fputs("  - ", file);
        write_quoted(file, potential->formula[i].text);
        fputc('\n', file);
    }
    // Each group gets a mapping of its own, since a group may occur twice.
    for (int i = 0; i < potential->ngiven; ++i) {
        const double *coefficient = potential->given_coefficient;
        write_text(file, "  - {given: {", potential->given[i]);
        fprintf(file, ": %.17g}}\n", coefficient == NULL ? 1 : coefficient[i]);
    }
    for (int i = 0; i < potential->nterm; ++i) {
        const pm_network_spec *term = &potential->term[i];
        const int others = term->nfeature - term->nthermal;
        fputs("  - {", file);
        write_network(file, term, others);
        if (term->nthermal > 0) {
            write_names(file, ", ", "thermal", term->nthermal, term->feature + others);
            fprintf(file, ", exponentials: %d", term->exponentials);
            write_number(file, ", temperature: ", term->temperature);
            fputs(term->separate ? ", separate: true" : "", file);
            fputs(term->rising ? ", rising: true" : "", file);
        } else if (term->scaled) {
            fputs(", scaled: true", file);
        }
        fputs("}\n", file);
    }
    for (int i = 0; i < potential->nconvex; ++i) {
        const pm_convex_spec *convex = &potential->convex[i];
        const bool inertia = convex->kind == PM_CONVEX_INERTIA;
        fprintf(file, "  - {%s: {", inertia ? "inertia" : "capacity");
        write_names(file, "", "of", convex->ngroup, convex->group);
        if (convex->first > 0) {
            write_number(file, ", first: ", convex->first);
        }
        if (inertia) {
            fputs(", ", file);
            write_network(file, &convex->network, convex->network.nfeature);
        } else {
            fprintf(file, ", terms: %d", convex->nterm);
        }
        fputs("}}\n", file);
    }
}

static void write_coefficient(FILE *file, const char *before, double number,
                              const pm_formula *formula) {
    fputs(before, file);
    if (formula->text != NULL) {
        write_quoted(file, formula->text);
    } else {
        fprintf(file, "%.17g", number);
    }
}

static void write_operator(FILE *file, const char *key, bool reversible,
                           const pm_operator_spec *op) {
    if (op->ngiven > 0 || op->learned) {
        fprintf(file, "%s:\n", key);
    }
    for (int i = 0; i < op->ngiven; ++i) {
        const pm_given_pair *pair = &op->given[i];
        fputs(i == 0 ? "  given: [[" : ", [", file);
        for (int k = 0; k < pair->ndirection; ++k) {
            write_text(file, k == 0 ? "{" : ", ", pair->direction[k].name);
            write_coefficient(file, ": ", pair->direction[k].coefficient,
                              &pair->direction[k].formula);
        }
        if (pair->ndirection > 0) {
            fputs("}", file);
        } else {
            write_text(file, "", pair->row);
        }
        write_text(file, ", ", pair->col);
        if (pair->cross) {
            fputs(", cross", file);
        } else {
            write_coefficient(file, ", ", pair->coefficient, &pair->formula);
        }
        fputs(i == op->ngiven - 1 ? "]]\n" : "]", file);
    }
    if (!op->learned) {
        if (op->ngiven > 0 && op->nheats > 0) {
            write_names(file, "  ", "heats", op->nheats, op->heats);
            fputc('\n', file);
        }
        return;
    }
    write_names(file, "  learned: {", "acts_on", op->nacts, op->acts_on);
    if (op->nagainst > 0) {
        write_names(file, ", ", "against", op->nagainst, op->against);
    }
    write_names(file, ", ", "along", op->nalong, op->along);
    if (!reversible) {
        fprintf(file, ", rank: %d", op->rank);
        if (op->nheats > 0) {
            write_names(file, ", ", "heats", op->nheats, op->heats);
        }
    }
    if (op->strength != NULL) {
        fputs(", strength: {", file);
        write_network(file, op->strength, op->strength->nfeature);
        fputs("}", file);
    }
    fputs(", ", file);
    write_network(file, &op->network, op->network.nfeature);
    fputs("}\n", file);
}

static void write_numbers(FILE *file, const char *before, int count, const double *value) {
    fputs(before, file);
    for (int i = 0; i < count; ++i) {
        write_number(file, i == 0 ? "[" : ", ", value[i]);
    }
    fputc(']', file);
}

// Writes "<before>matrix: <matrix><after>" if there is one.
static void write_matrix(FILE *file, const char *before, const pm_matrix_spec *matrix,
                         const char *after) {
    if (!matrix->identity && matrix->value == NULL) {
        return;
    }
    fprintf(file, "%smatrix: %s", before, matrix->identity ? "identity" : "");
    for (int i = 0; matrix->value != NULL && i < matrix->rows; ++i) {
        write_numbers(file, i == 0 ? "[" : ", ", matrix->cols,
                      matrix->value + (ptrdiff_t)i * matrix->cols);
        fputs(i == matrix->rows - 1 ? "]" : "", file);
    }
    fputs(after, file);
}

// Writes the keys that the blocks of parts and of ports share.
static void write_model(FILE *file, const pm_constants *constants, pm_form form,
                        const pm_potential_spec *energy, const pm_potential_spec *entropy,
                        const pm_operator_spec *reversible, const pm_operator_spec *irreversible,
                        const pm_network_spec *rate) {
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        const pm_constant_kind kind =
            constants->learned == NULL ? PM_CONSTANT_KNOWN : constants->learned[i];
        write_text(file, i == 0 ? "constants: {" : ", ", constants->name[i]);
        write_number(file, kind == PM_CONSTANT_KNOWN ? ": " : ": {learned: ", constants->value[i]);
        fputs(kind == PM_CONSTANT_POSITIVE ? ", positive: true" : "", file);
        fputs(constants->shared != NULL && constants->shared[i] ? ", shared: true" : "", file);
        fputs(kind == PM_CONSTANT_KNOWN ? "" : "}", file);
        fputs(i == constants->count - 1 ? "}\n" : "", file);
    }
    fprintf(file, "form: %s\n", form_names[form]);
    if (form == PM_FREE) {
        fputs("rate: {", file);
        write_network(file, rate, rate->nfeature);
        fputs("}\n", file);
    }
    write_potential(file, "energy", energy);
    write_potential(file, "entropy", entropy);
    write_operator(file, "reversible", true, reversible);
    write_operator(file, "irreversible", false, irreversible);
}

// Closes a memory stream and moves its text to the arena. Returns NULL if anything failed.
static const char *take_text(FILE *file, char **text, pm_arena *arena) {
    const bool failed = ferror(file) != 0;
    const bool closed = fclose(file) == 0;
    const char *copy = closed && !failed ? pm_arena_strdup(arena, *text) : NULL;
    free(*text);
    return copy;
}

const char *pm_part_spec_write(const pm_part_spec *spec, pm_arena *arena) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return NULL;
    }
    write_model(file, spec->constants, spec->form, &spec->energy, &spec->entropy, &spec->reversible,
                &spec->irreversible, &spec->rate);
    write_potential(file, "coenergy", &spec->coenergy);
    fputs(spec->nderived > 0 ? "derived:\n" : "", file);
    for (int i = 0; i < spec->nderived; ++i) {
        const pm_derived_spec *derived = &spec->derived[i];
        write_text(file, "  ", derived->name);
        write_names(file, ": {", "of", derived->ngroup, derived->group);
        fprintf(file, ", size: %d", derived->size);
        write_matrix(file, ", ", &derived->matrix, "");
        if (derived->offset != NULL) {
            write_numbers(file, ", offset: ", derived->size, derived->offset);
        }
        fputs("}\n", file);
    }
    if (spec->solid != NULL) {
        fprintf(file, "solid: {branches: %d, units: %d", spec->solid->nbranch, spec->solid->nunit);
        write_number(file, ", temperature: ", spec->solid->temperature);
        fputs("}\n", file);
    }
    return take_text(file, &text, arena);
}

const char *pm_port_spec_write(const pm_port_spec *spec, pm_arena *arena) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return NULL;
    }
    write_text(file, "law: ", spec->law);
    fputc('\n', file);
    write_model(file, spec->constants, spec->form, &spec->energy, &spec->entropy, &spec->reversible,
                &spec->irreversible, &spec->rate);
    write_matrix(file, "", &spec->matrix, "\n");
    if (spec->ends != PM_BOTH_ENDS) {
        fprintf(file, "ends: %s\n", ends_names[spec->ends]);
    }
    return take_text(file, &text, arena);
}

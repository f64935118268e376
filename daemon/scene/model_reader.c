// The `model:` block: from YAML to the plain data of model/spec.h, and back to text that reads
// equal.
#include "scene/model_reader.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/port.h"
#include "model/potential.h"
#include "scene/network_reader.h"

#define MAX_RANK 64
#define MAX_IMAGE 1000000 // numbers

static const char *const form_names[] = {
    [PM_HARD] = "hard", [PM_SOFT] = "soft", [PM_FREE] = "free", NULL};
#define MODEL_KEYS \
    "form", "energy", "entropy", "reversible", "irreversible", "rate", "constants", "mesh"

// --- reading ---

// What a block is read with: its constants and, if it has one, the mesh its networks are on.
typedef struct reader {
    pm_arena *arena;
    const pm_constants *constants;
    const pm_mesh *mesh;
} reader;

// Absent, or spelled "none".
static bool is_none(pm_yaml value) {
    return !pm_yaml_exists(value) || pm_yaml_is_text(value, "none");
}

// Entry i of a linear form: a group's name, or "group: coefficient".
static pm_status read_given_entry(pm_yaml given, int i, pm_arena *arena, const char **group,
                                  double *coefficient) {
    *coefficient = 1;
    if (!pm_yaml_is_map(given)) {
        return pm_yaml_text(pm_yaml_is_list(given) ? pm_yaml_item(given, i) : given, arena, group);
    }
    pm_yaml key, value;
    pm_yaml_entry(given, i, &key, &value);
    PM_TRY(pm_yaml_text(key, arena, group));
    return pm_yaml_double(value, -INFINITY, INFINITY, coefficient);
}

// Adds a linear form to a potential: a group, a list of groups, or a mapping to coefficients.
static pm_status read_given(pm_yaml given, pm_arena *arena, pm_potential_spec *potential) {
    const int before = potential->ngiven;
    const bool one = !pm_yaml_is_map(given) && !pm_yaml_is_list(given);
    const int total = before + (one ? 1 : pm_yaml_count(given));
    const char **group = pm_arena_array(arena, (size_t)total, sizeof *group);
    double *coefficient = pm_arena_array(arena, (size_t)total, sizeof *coefficient);
    if (group == NULL || coefficient == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < total; ++i) {
        if (i < before) {
            group[i] = potential->given[i];
            coefficient[i] = potential->given_coefficient[i];
        } else {
            PM_TRY(read_given_entry(given, i - before, arena, &group[i], &coefficient[i]));
        }
    }
    potential->given = group;
    potential->given_coefficient = coefficient;
    potential->ngiven = total;
    return PM_OK;
}

static pm_status read_formula(pm_yaml text, const reader *r, pm_formula *formula) {
    formula->constants = r->constants;
    PM_TRY(pm_model_read_at(text, r->arena, &formula->at));
    return pm_yaml_text(text, r->arena, &formula->text);
}

// Of a thermal energy: its entropies come after the other features.
static pm_status read_thermal(pm_yaml item, pm_arena *arena, pm_network_spec *term) {
    const pm_yaml thermal = pm_yaml_get(item, "thermal"), scaled = pm_yaml_get(item, "scaled");
    const pm_yaml count = pm_yaml_get(item, "exponentials"),
                  start = pm_yaml_get(item, "temperature");
    if (pm_yaml_exists(scaled)) {
        PM_TRY(pm_yaml_bool(scaled, &term->scaled));
    }
    if (!pm_yaml_exists(thermal)) {
        const pm_yaml other = pm_yaml_exists(count) ? count : start;
        return pm_yaml_exists(other) ? pm_yaml_fail(other, "only a thermal energy has this")
                                     : PM_OK;
    }
    if (term->message != NULL) {
        return pm_yaml_fail(thermal, "a network of nodes cannot be thermal");
    }
    const char *const *entropy;
    PM_TRY(pm_model_read_names(item, "thermal", arena, &term->nthermal, &entropy));
    if (term->nthermal < 1 || term->nthermal + term->nfeature > PM_MAX_FEATURES) {
        return pm_yaml_fail(thermal, "expected 1 to %d entropies",
                            PM_MAX_FEATURES - term->nfeature);
    }
    term->exponentials = PM_DEFAULT_EXPONENTIALS;
    term->temperature = PM_DEFAULT_TEMPERATURE;
    term->scaled = true;
    if (pm_yaml_exists(count)) {
        PM_TRY(pm_yaml_int(count, 1, PM_MAX_EXPONENTIALS, &term->exponentials));
    }
    if (pm_yaml_exists(start)) {
        PM_TRY(pm_yaml_double(start, 1e-300, 1e300, &term->temperature));
    }
    return pm_spec_append_features(term, term->nthermal, entropy, arena);
}

// A network; with "zero_at_origin" one that is at rest where its features are zero.
static pm_status read_term(pm_yaml item, const reader *r, pm_network_spec *term) {
    static const char *const keys[] = {PM_NETWORK_KEYS, "zero_at_origin", "thermal", "exponentials",
                                       "temperature",   "scaled",         NULL};
    const pm_yaml zero_at_origin = pm_yaml_get(item, "zero_at_origin");
    PM_TRY(pm_yaml_allow(item, keys));
    PM_TRY(pm_network_read(item, r->mesh, r->arena, term));
    PM_TRY(read_thermal(item, r->arena, term));
    if (pm_yaml_exists(zero_at_origin)) {
        PM_TRY(pm_yaml_bool(zero_at_origin, &term->zero_at_origin));
    }
    const bool able = term->nfeature > 0 && term->nthermal == 0 && term->message == NULL &&
                      term->skip != PM_SKIP_NONE;
    return able || !term->zero_at_origin
               ? PM_OK
               : pm_yaml_fail(zero_at_origin,
                              "only a network of features with a skip can be zero at the origin");
}

// Adds one summand to a potential; `formulas` and `terms` have room for it.
static pm_status read_summand(pm_yaml item, const reader *r, pm_potential_spec *potential,
                              pm_formula *formulas, pm_network_spec *terms) {
    static const char *const given_keys[] = {"given", NULL};
    if (!pm_yaml_is_map(item)) {
        return read_formula(item, r, &formulas[potential->nformula++]);
    }
    if (!pm_yaml_exists(pm_yaml_get(item, "given"))) {
        return read_term(item, r, &terms[potential->nterm++]);
    }
    PM_TRY(pm_yaml_allow(item, given_keys));
    return read_given(pm_yaml_get(item, "given"), r->arena, potential);
}

static pm_status read_potential(pm_yaml value, const reader *r, pm_potential_spec *potential) {
    *potential = (pm_potential_spec){0};
    if (is_none(value)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(value, r->arena, &potential->at));
    const int count = pm_yaml_is_list(value) ? pm_yaml_count(value) : 1;
    pm_network_spec *terms = pm_arena_array(r->arena, (size_t)count, sizeof *terms);
    pm_formula *formulas = pm_arena_array(r->arena, (size_t)count, sizeof *formulas);
    if (terms == NULL || formulas == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    potential->term = terms;
    potential->formula = formulas;
    for (int i = 0; i < count; ++i) {
        PM_TRY(read_summand(pm_yaml_is_list(value) ? pm_yaml_item(value, i) : value, r, potential,
                            formulas, terms));
    }
    return PM_OK;
}

// A number, or else a formula.
static pm_status read_coefficient(pm_yaml value, const reader *r, pm_given_pair *pair) {
    return pm_yaml_double(value, -INFINITY, INFINITY, &pair->coefficient) == PM_OK
               ? PM_OK
               : read_formula(value, r, &pair->formula);
}

static pm_status read_pairs(pm_yaml list, const reader *r, pm_operator_spec *op) {
    if (!pm_yaml_is_list(list)) {
        return pm_yaml_fail(list, "expected a list of pairs such as [[q, p, 1.0]]");
    }
    const int count = pm_yaml_count(list);
    pm_given_pair *pair = pm_arena_array(r->arena, (size_t)count, sizeof *pair);
    if (pair == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml item = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(item) || pm_yaml_count(item) != 3) {
            return pm_yaml_fail(item, "expected a pair such as [q, p, 1.0]: row, column, "
                                      "coefficient");
        }
        PM_TRY(pm_yaml_text(pm_yaml_item(item, 0), r->arena, &pair[i].row));
        PM_TRY(pm_yaml_text(pm_yaml_item(item, 1), r->arena, &pair[i].col));
        pair[i].cross = pm_yaml_is_text(pm_yaml_item(item, 2), "cross");
        PM_TRY(pair[i].cross ? PM_OK : read_coefficient(pm_yaml_item(item, 2), r, &pair[i]));
    }
    op->given = pair;
    op->ngiven = count;
    return PM_OK;
}

static pm_status read_learned(pm_yaml block, const reader *r, bool reversible,
                              pm_operator_spec *op) {
    static const char *const reversible_keys[] = {"acts_on", "against", "along", PM_NETWORK_KEYS,
                                                  NULL};
    static const char *const irreversible_keys[] = {"acts_on", "along",         "rank",
                                                    "heats",   PM_NETWORK_KEYS, NULL};
    pm_yaml acts;
    PM_TRY(pm_yaml_allow(block, reversible ? reversible_keys : irreversible_keys));
    PM_TRY(pm_yaml_require(block, "acts_on", &acts));
    PM_TRY(pm_model_read_names(block, "acts_on", r->arena, &op->nacts, &op->acts_on));
    if (op->nacts == 0) {
        return pm_yaml_fail(acts, "expected at least one group");
    }
    PM_TRY(pm_model_read_names(block, "against", r->arena, &op->nagainst, &op->against));
    PM_TRY(pm_model_read_names(block, "along", r->arena, &op->nalong, &op->along));
    if (pm_yaml_exists(pm_yaml_get(block, "heats"))) {
        PM_TRY(pm_model_read_names(block, "heats", r->arena, &op->nheats, &op->heats));
    }
    op->rank = reversible ? 0 : 1;
    const pm_yaml rank = pm_yaml_get(block, "rank");
    if (pm_yaml_exists(rank)) {
        PM_TRY(pm_yaml_int(rank, 1, MAX_RANK, &op->rank));
    }
    op->learned = true;
    return pm_network_read(block, r->mesh, r->arena, &op->network);
}

static pm_status read_operator(pm_yaml block, const reader *r, bool reversible,
                               pm_operator_spec *op) {
    static const char *const keys[] = {"given", "learned", "heats", NULL};
    *op = (pm_operator_spec){0};
    if (is_none(block)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(block, r->arena, &op->at));
    PM_TRY(pm_yaml_allow(block, keys));
    const pm_yaml given = pm_yaml_get(block, "given");
    if (pm_yaml_exists(given)) {
        PM_TRY(read_pairs(given, r, op));
    }
    const pm_yaml heats = pm_yaml_get(block, "heats");
    if (pm_yaml_exists(heats)) {
        if (reversible) {
            return pm_yaml_fail(heats, "only an irreversible operator heats");
        }
        PM_TRY(pm_model_read_names(block, "heats", r->arena, &op->nheats, &op->heats));
    }
    const pm_yaml learned = pm_yaml_get(block, "learned");
    return is_none(learned) ? PM_OK : read_learned(learned, r, reversible, op);
}

// The network of the free form, and of no other.
static pm_status read_rate(pm_yaml block, const reader *r, pm_form form, pm_network_spec *rate) {
    static const char *const network_keys[] = {PM_NETWORK_KEYS, NULL};
    pm_yaml value = pm_yaml_get(block, "rate");
    *rate = (pm_network_spec){0};
    if (form != PM_FREE) {
        return pm_yaml_exists(value) ? pm_yaml_fail(value, "only form: free has a rate") : PM_OK;
    }
    PM_TRY(pm_yaml_require(block, "rate", &value));
    PM_TRY(pm_yaml_allow(value, network_keys));
    return pm_network_read(value, r->mesh, r->arena, rate);
}

// A number, or {learned: start, positive: true}.
static pm_status read_constant(pm_yaml value, double *number, pm_constant_kind *kind) {
    static const char *const keys[] = {"learned", "positive", NULL};
    *kind = PM_CONSTANT_KNOWN;
    if (!pm_yaml_is_map(value)) {
        return pm_yaml_double(value, -INFINITY, INFINITY, number);
    }
    pm_yaml start;
    const pm_yaml positive = pm_yaml_get(value, "positive");
    bool stays = false;
    PM_TRY(pm_yaml_allow(value, keys));
    PM_TRY(pm_yaml_require(value, "learned", &start));
    PM_TRY(pm_yaml_double(start, -INFINITY, INFINITY, number));
    PM_TRY(pm_yaml_exists(positive) ? pm_yaml_bool(positive, &stays) : PM_OK);
    *kind = stays ? PM_CONSTANT_POSITIVE : PM_CONSTANT_LEARNED;
    return stays && !(*number > 0)
               ? pm_yaml_fail(start, "a positive constant starts from a number > 0")
               : PM_OK;
}

// Adds the entries of a mapping, if there is one, to those that are there, unless they are there.
static pm_status add_constants(pm_yaml map, pm_arena *arena, pm_constants *constants,
                               const char **name, double *value, pm_constant_kind *learned) {
    if (pm_yaml_exists(map)) {
        PM_TRY(pm_yaml_require_entries(map));
    }
    const int before = constants->count;
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, number;
        const int last = constants->count;
        pm_yaml_entry(map, i, &key, &number);
        PM_TRY(pm_yaml_text(key, arena, &name[last]));
        PM_TRY(read_constant(number, &value[last], &learned[last]));
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
    if (constants == NULL || name == NULL || value == NULL || learned == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    *constants = (pm_constants){0, name, value, learned};
    PM_TRY(add_constants(first, arena, constants, name, value, learned));
    PM_TRY(add_constants(second, arena, constants, name, value, learned));
    *result = constants;
    return PM_OK;
}

// What both blocks have in common; `own`: constants that come before the block's.
static pm_status read_model(pm_yaml block, pm_yaml own, pm_arena *arena,
                            const pm_constants **constants, const pm_mesh **mesh, pm_form *form,
                            pm_potential_spec *energy, pm_potential_spec *entropy,
                            pm_operator_spec *reversible, pm_operator_spec *irreversible,
                            pm_network_spec *rate) {
    int choice;
    PM_TRY(read_constants(own, pm_yaml_get(block, "constants"), arena, constants));
    PM_TRY(pm_mesh_read(pm_yaml_get(block, "mesh"), arena, mesh));
    PM_TRY(pm_model_read_choice(block, "form", form_names, &choice));
    *form = (pm_form)choice;
    const reader r = {arena, *constants, *mesh};
    PM_TRY(read_rate(block, &r, *form, rate));
    PM_TRY(read_potential(pm_yaml_get(block, "energy"), &r, energy));
    PM_TRY(read_potential(pm_yaml_get(block, "entropy"), &r, entropy));
    PM_TRY(read_operator(pm_yaml_get(block, "reversible"), &r, true, reversible));
    return read_operator(pm_yaml_get(block, "irreversible"), &r, false, irreversible);
}

static pm_status check_rows(pm_yaml list) {
    const bool any = pm_yaml_is_list(list) && pm_yaml_count(list) > 0;
    const int cols = any ? pm_yaml_count(pm_yaml_item(list, 0)) : 0;
    if (cols == 0) {
        return pm_yaml_fail(list, "expected a list of rows such as [[1.0, 0.0], [0.0, 1.0]]");
    }
    for (int i = 0; i < pm_yaml_count(list); ++i) {
        const pm_yaml row = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(row) || pm_yaml_count(row) != cols) {
            return pm_yaml_fail(row, "expected a row of %d numbers like the first, found %d", cols,
                                pm_yaml_count(row));
        }
    }
    return PM_OK;
}

// Its size is checked against what it joins later.
static pm_status read_matrix(pm_yaml list, pm_arena *arena, pm_matrix_spec *matrix) {
    *matrix = (pm_matrix_spec){0};
    if (!pm_yaml_exists(list)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(list, arena, &matrix->at));
    PM_TRY(check_rows(list));
    matrix->rows = pm_yaml_count(list);
    matrix->cols = pm_yaml_count(pm_yaml_item(list, 0));
    const size_t count = (size_t)matrix->rows * (size_t)matrix->cols;
    double *value = pm_arena_array(arena, count, sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < matrix->rows; ++i) {
        const pm_yaml row = pm_yaml_item(list, i);
        for (int j = 0; j < matrix->cols; ++j) {
            PM_TRY(pm_yaml_double(pm_yaml_item(row, j), -INFINITY, INFINITY,
                                  &value[i * matrix->cols + j]));
        }
    }
    matrix->value = value;
    return PM_OK;
}

// The matrix of the law contact, and of no other.
static pm_status read_law_matrix(pm_yaml value, const char *law, pm_arena *arena,
                                 pm_matrix_spec *matrix) {
    if (pm_yaml_exists(value) && strcmp(law, "contact") != 0) {
        return pm_yaml_fail(value, "only law: contact has a matrix");
    }
    if (pm_yaml_is_text(value, "identity")) {
        *matrix = (pm_matrix_spec){.identity = true};
        return pm_model_read_at(value, arena, &matrix->at);
    }
    return read_matrix(value, arena, matrix);
}

// An image of groups, its numbers here or in the weights.
static pm_status read_image(pm_yaml name, pm_yaml block, pm_arena *arena,
                            pm_derived_spec *derived) {
    static const char *const keys[] = {"of", "size", "matrix", "offset", NULL};
    pm_yaml of;
    const pm_yaml matrix = pm_yaml_get(block, "matrix"), offset = pm_yaml_get(block, "offset");
    pm_yaml size = pm_yaml_get(block, "size");
    PM_TRY(pm_yaml_text(name, arena, &derived->name));
    PM_TRY(pm_model_read_at(block, arena, &derived->at));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "of", &of));
    PM_TRY(pm_model_read_names(block, "of", arena, &derived->ngroup, &derived->group));
    if (derived->ngroup < 1 || derived->ngroup > PM_MAX_GROUPS) {
        return pm_yaml_fail(of, "expected 1 to %d groups", PM_MAX_GROUPS);
    }
    PM_TRY(read_matrix(matrix, arena, &derived->matrix));
    derived->size = derived->matrix.rows;
    if (pm_yaml_exists(size) || !pm_yaml_exists(matrix)) {
        PM_TRY(pm_yaml_require(block, "size", &size));
        PM_TRY(pm_yaml_int(size, 1, MAX_IMAGE, &derived->size));
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

static pm_status read_images(pm_yaml map, pm_arena *arena, pm_part_spec *spec) {
    spec->nderived = 0;
    spec->derived = NULL;
    if (!pm_yaml_exists(map)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(map));
    const int count = pm_yaml_count(map);
    if (count > PM_MAX_DERIVED) {
        return pm_yaml_fail(map, "%d images, at most %d are possible", count, PM_MAX_DERIVED);
    }
    pm_derived_spec *derived = pm_arena_array(arena, (size_t)count, sizeof *derived);
    if (derived == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < count; ++i) {
        pm_yaml key, value;
        pm_yaml_entry(map, i, &key, &value);
        PM_TRY(read_image(key, value, arena, &derived[i]));
    }
    spec->nderived = count;
    spec->derived = derived;
    return PM_OK;
}

pm_status pm_part_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_part_spec *spec) {
    static const char *const keys[] = {MODEL_KEYS, "derived", NULL};
    pm_part_spec read;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_model_read_at(block, arena, &read.at));
    PM_TRY(read_model(block, constants, arena, &read.constants, &read.mesh, &read.form,
                      &read.energy, &read.entropy, &read.reversible, &read.irreversible,
                      &read.rate));
    PM_TRY(read_images(pm_yaml_get(block, "derived"), arena, &read));
    *spec = read;
    return PM_OK;
}

pm_status pm_port_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_port_spec *spec) {
    static const char *const keys[] = {"law", MODEL_KEYS, "matrix", NULL};
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
    PM_TRY(read_model(block, constants, arena, &read.constants, &read.mesh, &read.form,
                      &read.energy, &read.entropy, &read.reversible, &read.irreversible,
                      &read.rate));
    *spec = read;
    return PM_OK;
}

// --- writing ---

static void write_constant(FILE *file, const pm_constants *constants, int i) {
    const bool known = constants->learned == NULL || constants->learned[i] == PM_CONSTANT_KNOWN;
    fputs(known ? "" : "{learned: ", file);
    pm_model_write_number(file, constants->value[i]);
    fputs(known                                           ? ""
          : constants->learned[i] == PM_CONSTANT_POSITIVE ? ", positive: true}"
                                                          : "}",
          file);
}

static void write_constants(FILE *file, const pm_constants *constants) {
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        fputs(i == 0 ? "constants: {" : ", ", file);
        pm_model_write_text(file, constants->name[i]);
        fputs(": ", file);
        write_constant(file, constants, i);
        fputs(i == constants->count - 1 ? "}\n" : "", file);
    }
}

static void write_term(FILE *file, const pm_network_spec *term) {
    pm_network_spec others = *term;
    others.nfeature -= term->nthermal;
    pm_network_write(file, &others);
    if (term->nthermal > 0) {
        fputs(", ", file);
        pm_model_write_names(file, "thermal", term->nthermal, term->feature + others.nfeature);
        fprintf(file, ", exponentials: %d, temperature: ", term->exponentials);
        pm_model_write_number(file, term->temperature);
    } else if (term->scaled) {
        fputs(", scaled: true", file);
    }
}

static void write_potential(FILE *file, const char *key, const pm_potential_spec *potential) {
    if (!pm_potential_exists(potential)) {
        return;
    }
    fprintf(file, "%s:\n", key);
    for (int i = 0; i < potential->nformula; ++i) {
        fputs("  - ", file);
        pm_model_write_quoted(file, potential->formula[i].text);
        fputc('\n', file);
    }
    // A mapping each: the same group may be given twice.
    for (int i = 0; i < potential->ngiven; ++i) {
        const double *coefficient = potential->given_coefficient;
        fputs("  - {given: {", file);
        pm_model_write_text(file, potential->given[i]);
        fprintf(file, ": %.17g}}\n", coefficient == NULL ? 1 : coefficient[i]);
    }
    for (int i = 0; i < potential->nterm; ++i) {
        fputs("  - {", file);
        write_term(file, &potential->term[i]);
        fputs("}\n", file);
    }
}

static void write_heats(FILE *file, const pm_operator_spec *op) {
    if (op->nheats > 0) {
        pm_model_write_names(file, "heats", op->nheats, op->heats);
    }
}

static void write_operator(FILE *file, const char *key, bool reversible,
                           const pm_operator_spec *op) {
    if (op->ngiven == 0 && !op->learned) {
        return;
    }
    fprintf(file, "%s:\n", key);
    if (op->ngiven > 0) {
        fputs("  given: [", file);
        for (int i = 0; i < op->ngiven; ++i) {
            fputs(i == 0 ? "[" : ", [", file);
            pm_model_write_text(file, op->given[i].row);
            fputs(", ", file);
            pm_model_write_text(file, op->given[i].col);
            fputs(", ", file);
            if (op->given[i].cross) {
                fputs("cross", file);
            } else if (op->given[i].formula.text != NULL) {
                pm_model_write_quoted(file, op->given[i].formula.text);
            } else {
                fprintf(file, "%.17g", op->given[i].coefficient);
            }
            fputc(']', file);
        }
        fputs("]\n", file);
        if (op->nheats > 0 && !op->learned) {
            fputs("  ", file);
            write_heats(file, op);
            fputc('\n', file);
        }
    }
    if (op->learned) {
        fputs("  learned: {", file);
        pm_model_write_names(file, "acts_on", op->nacts, op->acts_on);
        if (op->nagainst > 0) {
            fputs(", ", file);
            pm_model_write_names(file, "against", op->nagainst, op->against);
        }
        fputs(", ", file);
        pm_model_write_names(file, "along", op->nalong, op->along);
        if (!reversible) {
            fprintf(file, ", rank: %d", op->rank);
            fputs(op->nheats > 0 ? ", " : "", file);
            write_heats(file, op);
        }
        fputs(", ", file);
        pm_network_write(file, &op->network);
        fputs("}\n", file);
    }
}

static void write_numbers(FILE *file, int count, const double *value) {
    for (int i = 0; i < count; ++i) {
        fputs(i == 0 ? "[" : ", ", file);
        pm_model_write_number(file, value[i]);
    }
    fputc(']', file);
}

static void write_matrix(FILE *file, const pm_matrix_spec *matrix) {
    if (matrix->identity) {
        fputs("matrix: identity", file);
    }
    for (int i = 0; matrix->value != NULL && i < matrix->rows; ++i) {
        fputs(i == 0 ? "matrix: [" : ", ", file);
        write_numbers(file, matrix->cols, matrix->value + (ptrdiff_t)i * matrix->cols);
        fputs(i == matrix->rows - 1 ? "]" : "", file);
    }
}

static void write_images(FILE *file, const pm_part_spec *spec) {
    fputs(spec->nderived > 0 ? "derived:\n" : "", file);
    for (int i = 0; i < spec->nderived; ++i) {
        const pm_derived_spec *derived = &spec->derived[i];
        fputs("  ", file);
        pm_model_write_text(file, derived->name);
        fputs(": {", file);
        pm_model_write_names(file, "of", derived->ngroup, derived->group);
        fprintf(file, ", size: %d", derived->size);
        if (derived->matrix.value != NULL) {
            fputs(", ", file);
            write_matrix(file, &derived->matrix);
        }
        if (derived->offset != NULL) {
            fputs(", offset: ", file);
            write_numbers(file, derived->size, derived->offset);
        }
        fputs("}\n", file);
    }
}

// The parts common to both blocks.
static void write_model(FILE *file, const pm_constants *constants, const pm_mesh *mesh,
                        pm_form form, const pm_potential_spec *energy,
                        const pm_potential_spec *entropy, const pm_operator_spec *reversible,
                        const pm_operator_spec *irreversible, const pm_network_spec *rate) {
    write_constants(file, constants);
    pm_mesh_write(file, mesh);
    fprintf(file, "form: %s\n", form_names[form]);
    if (form == PM_FREE) {
        fputs("rate: {", file);
        pm_network_write(file, rate);
        fputs("}\n", file);
    }
    write_potential(file, "energy", energy);
    write_potential(file, "entropy", entropy);
    write_operator(file, "reversible", true, reversible);
    write_operator(file, "irreversible", false, irreversible);
}

// Closes a memory stream and moves its text to the arena; NULL if anything failed.
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
    write_model(file, spec->constants, spec->mesh, spec->form, &spec->energy, &spec->entropy,
                &spec->reversible, &spec->irreversible, &spec->rate);
    write_images(file, spec);
    return take_text(file, &text, arena);
}

const char *pm_port_spec_write(const pm_port_spec *spec, pm_arena *arena) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return NULL;
    }
    fputs("law: ", file);
    pm_model_write_text(file, spec->law);
    fputc('\n', file);
    write_model(file, spec->constants, spec->mesh, spec->form, &spec->energy, &spec->entropy,
                &spec->reversible, &spec->irreversible, &spec->rate);
    write_matrix(file, &spec->matrix);
    fputs(spec->matrix.identity || spec->matrix.value != NULL ? "\n" : "", file);
    return take_text(file, &text, arena);
}

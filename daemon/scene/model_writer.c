// Writes specs as the text of a `model:` block. The text is part of the digest of weights, so that
// any change to this file's output changes all digests.
#include "scene/model_reader.h"

#include <stdio.h>
#include <stdlib.h>

#include "model/potential.h"
#include "scene/network_reader.h"

static const char *const form_names[] = {
    [PM_HARD] = "hard", [PM_SOFT] = "soft", [PM_FREE] = "free", NULL};

static void write_constant(FILE *file, const pm_constants *constants, int i) {
    const bool known = constants->learned == NULL || constants->learned[i] == PM_CONSTANT_KNOWN;
    fputs(known ? "" : "{learned: ", file);
    pm_model_write_number(file, constants->value[i]);
    fputs(!known && constants->learned[i] == PM_CONSTANT_POSITIVE ? ", positive: true" : "", file);
    fputs(constants->shared != NULL && constants->shared[i] ? ", shared: true" : "", file);
    fputs(known ? "" : "}", file);
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
        fputs(term->separate ? ", separate: true" : "", file);
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
    // Each group gets a mapping of its own, since a group may occur twice.
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

static void write_pair(FILE *file, const pm_given_pair *pair) {
    fputc('[', file);
    pm_model_write_text(file, pair->row);
    fputs(", ", file);
    pm_model_write_text(file, pair->col);
    fputs(", ", file);
    if (pair->cross) {
        fputs("cross", file);
    } else if (pair->formula.text != NULL) {
        pm_model_write_quoted(file, pair->formula.text);
    } else {
        fprintf(file, "%.17g", pair->coefficient);
    }
    fputc(']', file);
}

static void write_given(FILE *file, const pm_operator_spec *op) {
    fputs("  given: [", file);
    for (int i = 0; i < op->ngiven; ++i) {
        fputs(i == 0 ? "" : ", ", file);
        write_pair(file, &op->given[i]);
    }
    fputs("]\n", file);
    if (op->nheats > 0 && !op->learned) {
        fputs("  ", file);
        write_heats(file, op);
        fputc('\n', file);
    }
}

static void write_learned(FILE *file, bool reversible, const pm_operator_spec *op) {
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
    if (op->strength != NULL) {
        fputs(", strength: {", file);
        pm_network_write(file, op->strength);
        fputs("}", file);
    }
    fputs(", ", file);
    pm_network_write(file, &op->network);
    fputs("}\n", file);
}

static void write_operator(FILE *file, const char *key, bool reversible,
                           const pm_operator_spec *op) {
    if (op->ngiven > 0 || op->learned) {
        fprintf(file, "%s:\n", key);
    }
    if (op->ngiven > 0) {
        write_given(file, op);
    }
    if (op->learned) {
        write_learned(file, reversible, op);
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

static void write_derived(FILE *file, const pm_part_spec *spec) {
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

// Writes the keys that the blocks of parts and of ports share.
static void write_model(FILE *file, const pm_constants *constants, pm_form form,
                        const pm_potential_spec *energy, const pm_potential_spec *entropy,
                        const pm_operator_spec *reversible, const pm_operator_spec *irreversible,
                        const pm_network_spec *rate) {
    write_constants(file, constants);
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
    write_derived(file, spec);
    if (spec->solid != NULL) {
        fprintf(file, "solid: {branches: %d, units: %d, temperature: ", spec->solid->nbranch,
                spec->solid->nunit);
        pm_model_write_number(file, spec->solid->temperature);
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
    fputs("law: ", file);
    pm_model_write_text(file, spec->law);
    fputc('\n', file);
    write_model(file, spec->constants, spec->form, &spec->energy, &spec->entropy, &spec->reversible,
                &spec->irreversible, &spec->rate);
    write_matrix(file, &spec->matrix);
    fputs(spec->matrix.identity || spec->matrix.value != NULL ? "\n" : "", file);
    if (spec->ends != PM_BOTH_ENDS) {
        fprintf(file, "ends: %s\n", spec->ends == PM_END_A_ALONE ? "a" : "b");
    }
    return take_text(file, &text, arena);
}

// Reads and writes the choices, names, texts and numbers of `model:` blocks.
#include <stdlib.h>
#include <string.h>

#include "scene/model_block.h"
#include "scene/network_reader.h"

bool pm_model_is_none(pm_yaml value) {
    return !pm_yaml_exists(value) || pm_yaml_is_text(value, "none");
}

pm_status pm_model_read_formula(pm_yaml text, const pm_model_context *r, pm_formula *formula) {
    formula->constants = r->constants;
    PM_TRY(pm_model_read_at(text, r->arena, &formula->at));
    return pm_yaml_text(text, r->arena, &formula->text);
}

pm_status pm_model_read_at(pm_yaml value, pm_arena *arena, const char **at) {
    *at = pm_yaml_where(value, arena);
    return *at == NULL ? pm_fail(PM_ENOMEM, "out of memory while reading a model") : PM_OK;
}

pm_status pm_model_read_choice(pm_yaml block, const char *key, const char *const *names,
                               int *result) {
    const pm_yaml value = pm_yaml_get(block, key);
    *result = 0;
    return pm_yaml_exists(value) ? pm_yaml_choice(value, names, result) : PM_OK;
}

pm_status pm_model_read_names(pm_yaml block, const char *key, pm_arena *arena, int *count,
                              const char *const **result) {
    const pm_yaml value = pm_yaml_get(block, key);
    const char **names = NULL;
    *count = 0;
    if (pm_yaml_exists(value)) {
        PM_TRY(pm_yaml_texts(value, arena, count, &names));
    }
    *result = names;
    return PM_OK;
}

void pm_model_write_quoted(FILE *file, const char *text) {
    fputc('"', file);
    for (const char *c = text; *c != '\0'; ++c) {
        if (*c == '"' || *c == '\\') {
            fputc('\\', file);
        }
        fputc(*c, file);
    }
    fputc('"', file);
}

void pm_model_write_text(FILE *file, const char *text) {
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.";
    if (text[0] != '\0' && text[strspn(text, plain)] == '\0') {
        fputs(text, file);
    } else {
        pm_model_write_quoted(file, text);
    }
}

void pm_model_write_names(FILE *file, const char *key, int count, const char *const *names) {
    fprintf(file, "%s: [", key);
    for (int i = 0; i < count; ++i) {
        fputs(i == 0 ? "" : ", ", file);
        pm_model_write_text(file, names[i]);
    }
    fputc(']', file);
}

void pm_model_write_number(FILE *file, double number) {
    char text[32];
    snprintf(text, sizeof text, "%.15g", number);
    fprintf(file, "%.*g", strtod(text, NULL) == number ? 15 : 17, number);
}

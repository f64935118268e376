// Reads a study and replaces passages of text.
#include "study.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "store/yaml.h"

#define LARGEST_FILE 65536

static const char *const truth_names[] = {"training", "validation", "growth"};

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a study");
}

// A list of [old, new]; none where it is absent.
static pm_status read_passages(pm_yaml list, pm_arena *arena, study_file *file) {
    const int count = pm_yaml_count(list);
    study_passage *passage = pm_arena_array(arena, (size_t)count + 1, sizeof *passage);
    if (passage == NULL) {
        return no_memory();
    }
    for (int i = 0; i < count; ++i) {
        int n = 0;
        const char **text = NULL;
        const pm_yaml item = pm_yaml_item(list, i);
        PM_TRY(pm_yaml_texts(item, arena, &n, &text));
        if (n != 2) {
            return pm_yaml_fail(item, "expected a passage and what replaces it");
        }
        passage[i] = (study_passage){text[0], text[1]};
    }
    file->count = count;
    file->passage = passage;
    return PM_OK;
}

static pm_status read_truth(pm_yaml root, study *s) {
    pm_yaml truth, value;
    const char *path = NULL;
    PM_TRY(pm_yaml_require(root, "truth", &truth));
    PM_TRY(pm_yaml_require(truth, "file", &value));
    PM_TRY(pm_yaml_text(value, &s->arena, &path));
    for (int i = 0; i < STUDY_TRUTHS; ++i) {
        s->truth[i].path = path;
        PM_TRY(read_passages(pm_yaml_get(truth, truth_names[i]), &s->arena, &s->truth[i]));
    }
    return PM_OK;
}

static pm_status read_text(pm_yaml block, const char *key, pm_arena *arena, const char **text) {
    pm_yaml value;
    PM_TRY(pm_yaml_require(block, key, &value));
    return pm_yaml_text(value, arena, text);
}

static pm_status read_variant(pm_yaml block, const char *training, pm_arena *arena,
                              study_variant *variant) {
    static const char *const keys[] = {"name", "predicted", "file", "replace", "growth", NULL};
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_text(block, "name", arena, &variant->name));
    PM_TRY(read_text(block, "predicted", arena, &variant->predicted));
    variant->training.path = training;
    if (pm_yaml_exists(pm_yaml_get(block, "file"))) {
        PM_TRY(read_text(block, "file", arena, &variant->training.path));
    }
    if (pm_yaml_exists(pm_yaml_get(block, "growth"))) {
        PM_TRY(pm_yaml_bool(pm_yaml_get(block, "growth"), &variant->growth));
    }
    return read_passages(pm_yaml_get(block, "replace"), arena, &variant->training);
}

static pm_status read_question(pm_yaml block, const char *training, pm_arena *arena,
                               study_question *question) {
    static const char *const keys[] = {"name", "asks", "variants", "picture", NULL};
    pm_yaml variants;
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(read_text(block, "name", arena, &question->name));
    PM_TRY(read_text(block, "asks", arena, &question->asks));
    if (pm_yaml_exists(pm_yaml_get(block, "picture"))) {
        PM_TRY(read_text(block, "picture", arena, &question->picture));
    }
    PM_TRY(pm_yaml_require(block, "variants", &variants));
    const int count = pm_yaml_count(variants);
    study_variant *variant = pm_arena_array(arena, (size_t)count + 1, sizeof *variant);
    if (variant == NULL) {
        return no_memory();
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY(read_variant(pm_yaml_item(variants, i), training, arena, &variant[i]));
    }
    question->count = count;
    question->variant = variant;
    return PM_OK;
}

static pm_status read_study(pm_yaml root, study *s) {
    static const char *const keys[] = {"truth", "training", "questions", NULL};
    const char *training = NULL;
    pm_yaml questions;
    PM_TRY(pm_yaml_allow(root, keys));
    PM_TRY(read_truth(root, s));
    PM_TRY(read_text(root, "training", &s->arena, &training));
    PM_TRY(pm_yaml_require(root, "questions", &questions));
    s->count = pm_yaml_count(questions);
    study_question *question = pm_arena_array(&s->arena, (size_t)s->count + 1, sizeof *question);
    if (question == NULL) {
        return no_memory();
    }
    s->question = question;
    for (int i = 0; i < s->count; ++i) {
        PM_TRY(read_question(pm_yaml_item(questions, i), training, &s->arena, &question[i]));
    }
    return PM_OK;
}

pm_status study_load(study *s, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    *s = (study){.count = 0};
    PM_TRY(pm_yaml_open(&document, path, &root));
    const pm_status status = read_study(root, s);
    pm_yaml_close(document);
    return status;
}

void study_free(study *s) {
    pm_arena_free(&s->arena);
}

// --- text ---

static pm_status read_file(const char *path, pm_arena *arena, const char **text) {
    char *buffer = pm_arena_alloc(arena, LARGEST_FILE + 1);
    FILE *file = fopen(path, "r");
    if (buffer == NULL || file == NULL) {
        return buffer == NULL ? no_memory() : pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    const size_t size = fread(buffer, 1, LARGEST_FILE, file);
    const bool whole = feof(file) != 0;
    fclose(file);
    *text = buffer;
    return whole ? PM_OK : pm_fail(PM_EFILE, "%s: more than %zu bytes", path, size);
}

pm_status study_replace(const study_passage *passage, const char *path, pm_arena *arena,
                        const char **text) {
    const char *at = strstr(*text, passage->old);
    if (at == NULL || strstr(at + 1, passage->old) != NULL) {
        return pm_fail(PM_ECONFIG, "%s: \"%s\" stands there %s, expected once", path, passage->old,
                       at == NULL ? "nowhere" : "more than once");
    }
    *text = pm_arena_printf(arena, "%.*s%s%s", (int)(at - *text), *text, passage->new,
                            at + strlen(passage->old));
    return *text == NULL ? no_memory() : PM_OK;
}

pm_status study_text(const study_file *file, const char *folder, pm_arena *arena,
                     const char **text) {
    const char *path = pm_arena_printf(arena, "%s/%s", folder, file->path);
    if (path == NULL) {
        return no_memory();
    }
    PM_TRY(read_file(path, arena, text));
    for (int i = 0; i < file->count; ++i) {
        PM_TRY(study_replace(&file->passage[i], path, arena, text));
    }
    return PM_OK;
}

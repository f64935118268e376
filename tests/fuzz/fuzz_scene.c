// Any text must read as a scene and as a model block, or fail with one line; a model that reads
// must write text that reads to the same text again.
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "store/model_yaml.h"
#include "store/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

// Reads the text as a port's model and writes it into the arena; NULL if it does not read.
static const char *rewritten(const char *text, pm_arena *arena) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_port_spec spec;
    const char *result = NULL;
    if (pm_yaml_parse(&document, text, "fuzz.yaml", &root) == PM_OK &&
        pm_port_spec_read(root, (pm_yaml){0}, arena, &spec) == PM_OK) {
        result = pm_port_spec_write(&spec, arena);
        check(result != NULL);
    }
    pm_yaml_close(document);
    return result;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    if (text == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(text, data, size);
    }
    text[size] = '\0';

    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, text, "folder/fuzz.yaml") != PM_OK) {
        check(scene == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
    }
    pm_scene_free(scene);

    pm_arena arena = {0};
    const char *once = rewritten(text, &arena);
    if (once != NULL) {
        const char *twice = rewritten(once, &arena);
        check(twice != NULL && strcmp(once, twice) == 0);
    }
    pm_arena_free(&arena);
    free(text);
    return 0;
}

// Any text must read as a scene, or fail with a one-line error.
#include <stddef.h>
#include <string.h>

#include "scene/scene.h"
#include "tests/fuzz/target.h"

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
    free(text);
    return 0;
}

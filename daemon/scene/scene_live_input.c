// Reads the section `live_inputs` of a scene: the values that arrive on channels during a run,
// and the layout of the messages that carry them.
#include "scene/scene_reader.h"

#include <ctype.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MOST_ITEMS 100000 // values in one message

// --- the fields of a message ---

static const struct {
    const char *name;
    pm_live_type type;
    int size; // bytes
} types[] = {
    {"double", PM_LIVE_DOUBLE, 8},   {"float", PM_LIVE_FLOAT, 4},
    {"int64_t", PM_LIVE_INTEGER, 8}, {"int32_t", PM_LIVE_INTEGER, 4},
    {"int16_t", PM_LIVE_INTEGER, 2}, {"int8_t", PM_LIVE_INTEGER, 1},
    {"byte", PM_LIVE_BYTE, 1},       {"boolean", PM_LIVE_BYTE, 1},
};

// Reads a field such as "double force[3]": the type, the name and the number of items.
static pm_status read_field(pm_yaml at, const char *text, int *type_id, char name[64], int *count) {
    const size_t length = strcspn(text, " ");
    const char *rest = text + length + strspn(text + length, " ");
    const size_t name_length = strcspn(rest, " [");
    const size_t ntype = sizeof types / sizeof types[0];
    size_t i = 0;
    while (i < ntype &&
           (strlen(types[i].name) != length || memcmp(types[i].name, text, length) != 0)) {
        ++i;
    }
    *count = 1;
    char *end = (char *)rest + name_length;
    if (*end == '[' && isdigit((unsigned char)end[1])) {
        const long number = strtol(end + 1, &end, 10);
        *count = number > 0 && number <= MOST_ITEMS && *end == ']' ? (int)number : 0;
        end += *end == ']';
    }
    if (i == ntype || name_length == 0 || name_length > 63 || *end != 0 || *count == 0) {
        return pm_yaml_fail(at,
                            "expected a field such as \"double force[3]\", with the type double, "
                            "float, int64_t, int32_t, int16_t, int8_t, byte or boolean; "
                            "found \"%.64s\"",
                            text);
    }
    memcpy(name, rest, name_length);
    name[name_length] = 0;
    *type_id = (int)i;
    return PM_OK;
}

// Gives the values that a field carries their places in the message. A field of one item carries
// the value of its name; one of several items carries "name_0", "name_1" and so on.
static void place_values(pm_scene_live_input *input, const char *name, int type_id, int count,
                         int offset) {
    const size_t length = strlen(name);
    for (int i = 0; i < input->count; ++i) {
        const char *value = input->name[i];
        char *end = (char *)value + length;
        if (strncmp(value, name, length) != 0) {
            continue;
        }
        long item = *end == 0 && count == 1 ? 0 : -1;
        if (count > 1 && *end == '_' && isdigit((unsigned char)end[1])) {
            item = strtol(end + 1, &end, 10);
            item = *end == 0 && item < count ? item : -1;
        }
        if (item >= 0) {
            input->place[i] = (pm_live_place){types[type_id].type, types[type_id].size,
                                              offset + (int)item * types[type_id].size};
        }
    }
}

// Reads the fields of a message of the user's own type. The places of values follow from the fields
// before them, whose sizes are fixed.
static pm_status read_message(pm_scene_reader *r, pm_yaml list, pm_scene_live_input *input) {
    const char **text;
    int count;
    int64_t offset = PM_LIVE_HEAD;
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &text));
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_item_or_self(list, i);
        char name[64];
        int type_id = 0, items = 0;
        PM_TRY(read_field(at, text[i], &type_id, name, &items));
        if (strcmp(name, "step") == 0 && items == 1 && types[type_id].type == PM_LIVE_INTEGER) {
            input->step = (pm_live_place){PM_LIVE_INTEGER, types[type_id].size, (int)offset};
        }
        place_values(input, name, type_id, items, (int)offset);
        offset += (int64_t)items * types[type_id].size;
        if (offset > INT32_MAX) {
            return pm_yaml_fail(at, "the message is too long");
        }
    }
    for (int i = 0; i < input->count; ++i) {
        if (input->place[i].size == 0) {
            return pm_yaml_fail(list, "no field carries the value \"%s\"", input->name[i]);
        }
    }
    if (input->waits && input->step.size == 0) {
        return pm_yaml_fail(list, "`wait` needs a field \"int64_t step\"");
    }
    input->least_size = (size_t)offset;
    return PM_OK;
}

// --- an input ---

static bool is_used(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *owner = &scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            if (owner->value[k].column != NULL && strcmp(owner->value[k].column, name) == 0) {
                return true;
            }
        }
    }
    return false;
}

static pm_status read_values(pm_scene_reader *r, pm_yaml block, pm_scene_live_input *input) {
    pm_yaml list;
    pm_scene_named *named;
    PM_TRY(pm_yaml_require(block, "values", &list));
    PM_TRY(pm_scene_read_columns(r, list, &input->count, &named));
    input->name = pm_arena_array(r->arena, (size_t)input->count, sizeof *input->name);
    input->place = pm_arena_array(r->arena, (size_t)input->count, sizeof *input->place);
    input->start = pm_arena_array(r->arena, (size_t)input->count, sizeof *input->start);
    if (input->name == NULL || input->place == NULL || input->start == NULL) {
        return pm_scene_check_memory(r);
    }
    for (int i = 0; i < input->count; ++i) {
        bool twice = pm_scene_find_live(r->scene, named[i].text) >= 0;
        for (int k = 0; k < i; ++k) {
            twice = twice || strcmp(input->name[k], named[i].text) == 0;
        }
        if (twice) {
            return pm_yaml_fail(named[i].at, "\"%s\" is the name of another live value already",
                                named[i].text);
        }
        if (!is_used(r->scene, named[i].text)) {
            return pm_yaml_fail(named[i].at, "no boundary input names the value \"%s\"",
                                named[i].text);
        }
        input->name[i] = named[i].text;
    }
    return PM_OK;
}

static pm_status read_start(pm_scene_reader *r, pm_yaml list, pm_scene_live_input *input) {
    int count;
    double *start;
    if (!pm_yaml_exists(list)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_doubles(list, r->arena, &count, &start));
    if (count != input->count) {
        return pm_yaml_fail(list, "expected %d as under \"values\", found %d", input->count, count);
    }
    input->start = start;
    input->starts = true;
    return PM_OK;
}

static pm_status read_live_input(pm_scene_reader *r, pm_yaml key, pm_yaml block,
                                 pm_scene_live_input *input) {
    static const char *const keys[] = {"values", "start", "wait", "age", "message", NULL};
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_scene_read_name(r, key, &input->channel));
    input->at = pm_yaml_where(key, r->arena);
    PM_TRY(read_values(r, block, input));
    PM_TRY(read_start(r, pm_yaml_get(block, "start"), input));
    const pm_yaml wait = pm_yaml_get(block, "wait"), age = pm_yaml_get(block, "age");
    const pm_yaml message = pm_yaml_get(block, "message");
    input->age = INFINITY;
    PM_TRY(pm_yaml_exists(wait) ? pm_yaml_bool(wait, &input->waits) : PM_OK);
    PM_TRY(pm_yaml_exists(age) ? pm_yaml_double(age, 0, INFINITY, &input->age) : PM_OK);
    if (input->waits && pm_yaml_exists(pm_yaml_get(block, "start"))) {
        return pm_yaml_fail(wait, "a run that waits for the message of each step has no `start`");
    }
    if (!pm_yaml_exists(message)) {
        // The places in a message of portmet's own type, input_t: step, number of values, values.
        input->step = (pm_live_place){PM_LIVE_INTEGER, 8, PM_LIVE_HEAD};
        for (int i = 0; i < input->count; ++i) {
            input->place[i] = (pm_live_place){PM_LIVE_DOUBLE, 8, PM_LIVE_HEAD + 12 + 8 * i};
        }
        input->least_size = PM_LIVE_HEAD + 12 + 8 * (size_t)input->count;
        input->own_type = true;
        return PM_OK;
    }
    return read_message(r, message, input);
}

pm_status pm_scene_read_live_inputs(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const pm_yaml inputs = pm_yaml_get(r->root, "live_inputs");
    if (!pm_yaml_exists(inputs)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(inputs));
    if (scene->network.key_file != NULL) {
        return pm_yaml_fail(inputs, "live inputs come from programs that have no key: a scene with "
                                    "`key_file` cannot have any");
    }
    scene->network.live_input =
        pm_arena_array(r->arena, (size_t)pm_yaml_count(inputs), sizeof *scene->network.live_input);
    if (scene->network.live_input == NULL) {
        return pm_scene_check_memory(r);
    }
    for (int i = 0; i < pm_yaml_count(inputs); ++i) {
        pm_scene_live_input *input = &scene->network.live_input[i];
        pm_yaml key, block;
        pm_yaml_entry(inputs, i, &key, &block);
        PM_TRY(read_live_input(r, key, block, input));
        input->first = scene->network.nlive;
        scene->network.nlive += input->count;
        ++scene->network.nlive_input;
    }
    return scene->network.window == 1
               ? PM_OK
               : pm_yaml_fail(inputs, "each step has values of its own: expected a "
                                      "lockstep window of 1");
}

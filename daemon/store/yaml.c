// Walks a YAML document: its lists and mappings, the keys that a mapping may have, and errors with
// file, line and column.
#include "store/yaml.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "store/yaml_document.h"

// --- errors ---

// Returns the key under which the value stands, or the list that the value is an item of; "" if
// there is none.
static const char *label_of(pm_yaml at) {
    while (at.node != 0 && at.document->key[at.node] == 0) {
        at.node = at.document->parent[at.node];
    }
    return at.node == 0 ? "" : pm_yaml_scalar(pm_yaml_sibling(at, at.document->key[at.node]));
}

pm_status pm_yaml_fail(pm_yaml at, const char *format, ...) {
    char text[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const yaml_node_t *node = pm_yaml_node(at);
    const char *label = label_of(at);
    return pm_fail(PM_ECONFIG, "%s:%zu:%zu: %.64s%s%s", at.document->name,
                   node == NULL ? 1 : node->start_mark.line + 1,
                   node == NULL ? 1 : node->start_mark.column + 1, label, *label ? ": " : "", text);
}

const char *pm_yaml_where(pm_yaml at, pm_arena *arena) {
    const yaml_node_t *node = pm_yaml_node(at);
    return pm_arena_printf(arena, "%s:%zu:%zu", at.document->name,
                           node == NULL ? 1 : node->start_mark.line + 1,
                           node == NULL ? 1 : node->start_mark.column + 1);
}

pm_status pm_yaml_fail_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading YAML");
}

pm_status pm_yaml_fail_expected(pm_yaml value, const char *what) {
    const char *text = pm_yaml_scalar(value);
    if (text == NULL) {
        return pm_yaml_fail(value, "expected %s, found %s", what,
                            pm_yaml_is_map(value)    ? "a mapping"
                            : pm_yaml_is_list(value) ? "a list"
                                                     : "nothing");
    }
    if (*text == '\0') {
        return pm_yaml_fail(value, "expected %s, found nothing", what);
    }
    const bool quoted = pm_yaml_node(value)->data.scalar.style != YAML_PLAIN_SCALAR_STYLE;
    return pm_yaml_fail(value, "expected %s, found %s\"%.40s%s\"", what, quoted ? "the text " : "",
                        text, strlen(text) > 40 ? "..." : "");
}

// --- names in messages ---

const char *pm_yaml_join(const char *const *names, char *buffer, size_t size) {
    size_t used = 0;
    buffer[0] = '\0';
    for (int i = 0; names[i] != NULL && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ", names[i]);
    }
    return buffer;
}

int pm_yaml_position(const char *const *names, pm_yaml value) {
    for (int i = 0; names[i] != NULL; ++i) {
        if (pm_yaml_is_text(value, names[i])) {
            return i;
        }
    }
    return -1;
}

// --- walking ---

bool pm_yaml_exists(pm_yaml value) {
    return value.node != 0;
}

bool pm_yaml_is_map(pm_yaml value) {
    const yaml_node_t *node = pm_yaml_node(value);
    return node != NULL && node->type == YAML_MAPPING_NODE;
}

bool pm_yaml_is_list(pm_yaml value) {
    const yaml_node_t *node = pm_yaml_node(value);
    return node != NULL && node->type == YAML_SEQUENCE_NODE;
}

bool pm_yaml_is_text(pm_yaml value, const char *text) {
    const char *own = pm_yaml_scalar(value);
    return own != NULL && strcmp(own, text) == 0;
}

int pm_yaml_count(pm_yaml value) {
    const yaml_node_t *node = pm_yaml_node(value);
    if (pm_yaml_is_list(value)) {
        return (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    }
    if (pm_yaml_is_map(value)) {
        return (int)(node->data.mapping.pairs.top - node->data.mapping.pairs.start);
    }
    return 0;
}

pm_yaml pm_yaml_item(pm_yaml list, int i) {
    return pm_yaml_sibling(list, pm_yaml_node(list)->data.sequence.items.start[i]);
}

void pm_yaml_entry(pm_yaml map, int i, pm_yaml *key, pm_yaml *value) {
    const yaml_node_pair_t *pair = &pm_yaml_node(map)->data.mapping.pairs.start[i];
    *key = pm_yaml_sibling(map, pair->key);
    *value = pm_yaml_sibling(map, pair->value);
}

pm_yaml pm_yaml_get(pm_yaml map, const char *key) {
    for (int i = 0; pm_yaml_is_map(map) && i < pm_yaml_count(map); ++i) {
        pm_yaml own, value;
        pm_yaml_entry(map, i, &own, &value);
        if (pm_yaml_is_text(own, key)) {
            return value;
        }
    }
    return pm_yaml_sibling(map, 0);
}

pm_status pm_yaml_require(pm_yaml map, const char *key, pm_yaml *value) {
    if (!pm_yaml_is_map(map)) {
        return pm_yaml_fail_expected(map, "a mapping");
    }
    const pm_yaml found = pm_yaml_get(map, key);
    if (!pm_yaml_exists(found)) {
        return pm_yaml_fail(map, "missing key \"%s\"", key);
    }
    *value = found;
    return PM_OK;
}

// Keys that have been renamed. The error for an old key names the new one.
static const struct {
    const char *before, *now;
} renamed[] = {
    {"loads", "boundary_inputs"}, {"images", "derived"},     {"rest", "zero_at_origin"},
    {"section", "symmetry"},      {"swing", "inertia_time"}, {"region", "training_range"},
};

static bool is_among(const char *const *keys, const char *key) {
    for (int i = 0; keys[i] != NULL; ++i) {
        if (strcmp(keys[i], key) == 0) {
            return true;
        }
    }
    return false;
}

static pm_status fail_unknown(pm_yaml key, const char *const *keys) {
    for (size_t i = 0; i < sizeof renamed / sizeof renamed[0]; ++i) {
        if (pm_yaml_is_text(key, renamed[i].before) && is_among(keys, renamed[i].now)) {
            return pm_yaml_fail(key, "the key \"%s\" is called \"%s\" now", renamed[i].before,
                                renamed[i].now);
        }
    }
    char list[512];
    return pm_yaml_fail(key, "unknown key \"%.64s\"; allowed: %s", pm_yaml_scalar(key),
                        pm_yaml_join(keys, list, sizeof list));
}

pm_status pm_yaml_allow(pm_yaml map, const char *const *keys) {
    if (!pm_yaml_is_map(map)) {
        return pm_yaml_fail_expected(map, "a mapping");
    }
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, value;
        pm_yaml_entry(map, i, &key, &value);
        if (pm_yaml_position(keys, key) < 0) {
            return fail_unknown(key, keys);
        }
    }
    return PM_OK;
}

pm_status pm_yaml_require_entries(pm_yaml map) {
    return pm_yaml_is_map(map) && pm_yaml_count(map) > 0
               ? PM_OK
               : pm_yaml_fail_expected(map, "a mapping with at least one entry");
}

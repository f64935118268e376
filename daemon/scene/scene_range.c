// Reads names, and texts that stand for many. A key such as "link[0:100]" or "cell[0:10][0:20]"
// means one component for each index, and a text within its block names its neighbours by
// expressions of that index: "link[i+1]", "cell[i][j-1]". The ends of ports can come from a table
// in an HDF5 file: "link[a]", "link[b]". In a list of columns "f[0:3]" stands for f0, f1, f2.
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_reader.h"
#include "store/names.h"

#define MAX_NAME 48      // characters of a name
#define MAX_EXPANDED 160 // characters of a text after its indices have become numbers
// The most components of one list, and the most column names of a scene. A range is short to write,
// so its expansion needs a limit.
#define MAX_COLUMNS_OF_LIST 100000
#define MAX_COLUMNS 1000000

static const char letters[] = "ijk"; // of the axes
static const char columns[] = "ab";  // of a table

pm_status pm_scene_check_memory(const pm_scene_reader *r) {
    return pm_arena_status(r->arena, "a scene");
}

// --- names and paths ---

static bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

pm_status pm_scene_check_name(pm_yaml at, const char *name) {
    bool good = is_letter(name[0]) && strlen(name) <= MAX_NAME;
    for (const char *c = name; *c != '\0'; ++c) {
        good = good && (is_letter(*c) || (*c >= '0' && *c <= '9') || *c == '_');
    }
    return good ? PM_OK
                : pm_yaml_fail(
                      at,
                      "expected a name of a letter, then letters, digits or '_', at most %d "
                      "in all, found \"%.64s\"",
                      MAX_NAME, name);
}

pm_status pm_scene_read_name(pm_scene_reader *r, pm_yaml at, const char **name) {
    PM_TRY(pm_yaml_text(at, r->arena, name));
    return pm_scene_check_name(at, *name);
}

// --- ranges ---

pm_status pm_scene_parse_range(pm_scene_reader *r, pm_yaml at, const char *text,
                               pm_scene_range *range) {
    *range = (pm_scene_range){.key = text, .pattern = text, .total = 1};
    const char *open = strchr(text, '[');
    if (open == NULL) {
        return PM_OK;
    }
    const char *rest = open;
    for (; *rest != '\0' && range->naxis < PM_SCENE_MAX_AXES; ++range->naxis) {
        int *count = &range->count[range->naxis];
        if (!pm_name_axis_read(&rest, PM_SCENE_MAX_INDEX, &range->first[range->naxis], count)) {
            break;
        }
        if (*count > PM_SCENE_MOST_COMPONENTS / range->total) {
            return pm_yaml_fail(at, "\"%.64s\" stands for more than %d components", text,
                                PM_SCENE_MOST_COMPONENTS);
        }
        range->total *= *count;
    }
    if (*rest != '\0' || open == text) {
        return pm_yaml_fail(at,
                            "expected a range NAME[A:B] with A < B, such as link[0:3] for link0, "
                            "link1 and link2, or two or three such axes, found \"%.64s\"",
                            text);
    }
    static const char *const axes[] = {"", "[i]", "[i][j]", "[i][j][k]"};
    range->pattern =
        pm_arena_printf(r->arena, "%.*s%s", (int)(open - text), text, axes[range->naxis]);
    return pm_scene_check_memory(r);
}

void pm_scene_enter(pm_scene_reader *r, const pm_scene_range *range, int number) {
    r->naxis = range->naxis;
    for (int axis = range->naxis - 1; axis >= 0; --axis) {
        r->index[axis] = range->first[axis] + number % range->count[axis];
        number /= range->count[axis];
    }
}

// Reads "[i+1]" and moves `text` past it. `value` receives the number. Returns false if `text`
// begins with something else.
static bool read_index(const pm_scene_reader *r, const char **text, long *value) {
    const char *rest = *text;
    const char letter = rest[0] == '[' ? rest[1] : '\0';
    const char *axis = letter == '\0' ? NULL : strchr(letters, letter);
    const char *column = letter == '\0' ? NULL : strchr(columns, letter);
    long index, offset = 0;
    if (axis != NULL && axis - letters < r->naxis) {
        index = r->index[axis - letters];
    } else if (column != NULL && r->row != NULL) {
        index = (long)r->row[column - columns];
    } else {
        return false;
    }
    rest += 2;
    if (*rest == '+' || *rest == '-') {
        const bool minus = *rest++ == '-';
        char *end = NULL;
        offset = isdigit((unsigned char)*rest) ? strtol(rest, &end, 10) : -1;
        if (offset < 0 || offset > PM_SCENE_MAX_INDEX) {
            return false;
        }
        rest = end;
        offset = minus ? -offset : offset;
    }
    if (*rest != ']') {
        return false;
    }
    *value = index + offset;
    *text = rest + 1;
    return true;
}

pm_status pm_scene_expand(pm_scene_reader *r, pm_yaml at, const char *text, const char **result) {
    *result = text;
    if (r->naxis == 0 || strchr(text, '[') == NULL) {
        return PM_OK;
    }
    char buffer[MAX_EXPANDED + 32];
    size_t used = 0;
    bool joined = false; // the last characters are those of an index
    for (const char *rest = text; *rest != '\0';) {
        const char *const before = rest;
        long value;
        if (used > MAX_EXPANDED) {
            return pm_yaml_fail(at, "expected at most %d characters, found \"%.64s\"", MAX_EXPANDED,
                                text);
        }
        if (read_index(r, &rest, &value)) {
            if (value < 0) {
                return pm_yaml_fail(at, "%.*s in \"%.64s\" is %ld, expected an index >= 0",
                                    (int)(rest - before), before, text, value);
            }
            used += (size_t)snprintf(buffer + used, 24, "%s%ld", joined ? "_" : "", value);
            joined = true;
        } else {
            buffer[used++] = *rest++;
            joined = false;
        }
    }
    buffer[used] = '\0';
    *result = pm_arena_strdup(r->arena, buffer);
    return pm_scene_check_memory(r);
}

// --- lists ---

pm_status pm_scene_visit_members(pm_scene_reader *r, pm_yaml list, pm_scene_member_visit *visit,
                                 int number) {
    int count;
    const char **text;
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &text));
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_item_or_self(list, i);
        pm_scene_range range;
        PM_TRY(pm_scene_parse_range(r, at, text[i], &range));
        for (int k = 0; k < range.total; ++k) {
            const char *name;
            pm_scene_enter(r, &range, k);
            PM_TRY(pm_scene_expand(r, at, range.pattern, &name));
            const int id = pm_scene_find_subsystem(r->scene, name);
            if (id < 0) {
                char names[512];
                return pm_yaml_fail(at, "there is no subsystem \"%.64s\"; subsystems: %s", name,
                                    pm_scene_subsystem_names(r->scene, names, sizeof names));
            }
            PM_TRY(visit(r, at, id, number));
        }
    }
    r->naxis = 0;
    return PM_OK;
}

pm_status pm_scene_read_columns(pm_scene_reader *r, pm_yaml list, int *count,
                                pm_scene_named **result) {
    const int nitem = pm_yaml_is_list(list) ? pm_yaml_count(list) : 1;
    pm_name_range *range = pm_arena_array(r->arena, (size_t)nitem, sizeof *range);
    PM_TRY(pm_scene_check_memory(r));
    *count = 0;
    for (int i = 0; i < nitem; ++i) {
        const pm_yaml at = pm_yaml_item_or_self(list, i);
        const char *text;
        PM_TRY(pm_yaml_text(at, r->arena, &text));
        PM_TRY(pm_scene_expand(r, at, text, &text));
        if (pm_name_range_parse(&range[i], text) != PM_OK) {
            return pm_yaml_fail(at, "%s", pm_error());
        }
        if (range[i].count > MAX_COLUMNS_OF_LIST - *count) {
            return pm_yaml_fail(at, "expected 1 to %d components, found more", MAX_COLUMNS_OF_LIST);
        }
        *count += range[i].count;
        if (range[i].count > MAX_COLUMNS - r->nname) {
            return pm_yaml_fail(at, "more than %d columns in all", MAX_COLUMNS);
        }
        r->nname += range[i].count;
    }
    if (*count == 0) {
        return pm_yaml_fail(list, "expected 1 to %d components, found 0", MAX_COLUMNS_OF_LIST);
    }
    pm_scene_named *named = pm_arena_array(r->arena, (size_t)*count, sizeof *named);
    PM_TRY(pm_scene_check_memory(r));
    *result = named;
    for (int i = 0; i < nitem; ++i) {
        for (int k = 0; k < range[i].count; ++k, ++named) {
            *named = (pm_scene_named){pm_name_range_text(&range[i], k, r->arena),
                                      pm_yaml_item_or_self(list, i)};
        }
    }
    return pm_scene_check_memory(r);
}

// --- lists for messages ---

const char *pm_scene_subsystem_names(const pm_scene *scene, char *buffer, size_t size) {
    size_t used = 0;
    for (int i = 0; i < scene->physics.nsubsystem && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ",
                                 scene->physics.subsystem[i].name);
    }
    return buffer;
}

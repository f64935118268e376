// Reads names that stand for many components. A key such as "link[0:100]" or "cell[0:10][0:20]"
// means one component for each index, and a text within its block names its neighbours by
// expressions of that index: "link[i+1]", "cell[i][j-1]". The ends of ports can come from a table
// in an HDF5 file: "link[a]", "link[b]".
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_reader.h"
#include "store/hdf5_io.h"

#define MAX_INDEX 1000000000L
#define MAX_EXPANDED 160 // characters of a text after its indices have become numbers

static const char letters[] = "ijk"; // of the axes
static const char columns[] = "ab";  // of a table

// Reads a whole number and moves `text` past it. Returns -1 if `text` begins with none.
static long read_number(const char **text) {
    char *end;
    if (!isdigit((unsigned char)**text)) {
        return -1;
    }
    const long number = strtol(*text, &end, 10); // saturates, and the range then refuses it
    *text = end;
    return number;
}

// Reads "[A:B]" and moves `text` past it; false if `text` begins with something else.
static bool read_axis(const char **text, int *first, int *count) {
    const char *rest = *text + (**text == '[');
    const long low = read_number(&rest);
    const bool colon = *rest == ':';
    rest += colon;
    const long end = read_number(&rest);
    if (**text != '[' || !colon || *rest != ']' || low < 0 || end <= low || end > MAX_INDEX) {
        return false;
    }
    *text = rest + 1;
    *first = (int)low;
    *count = (int)(end - low);
    return true;
}

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
        if (!read_axis(&rest, &range->first[range->naxis], count)) {
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
    return range->pattern == NULL ? pm_scene_no_memory() : PM_OK;
}

void pm_scene_enter(pm_scene_reader *r, const pm_scene_range *range, int number) {
    r->naxis = range->naxis;
    for (int axis = range->naxis - 1; axis >= 0; --axis) {
        r->index[axis] = range->first[axis] + number % range->count[axis];
        number /= range->count[axis];
    }
}

// Finds the number that a letter stands for; false if it stands for none.
static bool find_index(const pm_scene_reader *r, char letter, long *value) {
    const char *axis = letter == '\0' ? NULL : strchr(letters, letter);
    const char *column = letter == '\0' ? NULL : strchr(columns, letter);
    if (axis != NULL && axis - letters < r->naxis) {
        *value = r->index[axis - letters];
        return true;
    }
    if (column != NULL && r->row != NULL) {
        *value = (long)r->row[column - columns];
        return true;
    }
    return false;
}

// Reads "[i+1]" and moves `text` past it. `value` receives the number. Returns false if `text`
// begins with something else.
static bool read_index(const pm_scene_reader *r, const char **text, long *value) {
    const char *rest = *text;
    long index;
    if (rest[0] != '[' || !find_index(r, rest[1], &index)) {
        return false;
    }
    rest += 2;
    long offset = 0;
    if (*rest == '+' || *rest == '-') {
        const bool minus = *rest++ == '-';
        offset = read_number(&rest);
        if (offset < 0 || offset > MAX_INDEX) {
            return false;
        }
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
    return *result == NULL ? pm_scene_no_memory() : PM_OK;
}

pm_status pm_scene_read_indexed(pm_scene_reader *r, pm_yaml at, const char **text) {
    PM_TRY(pm_yaml_text(at, r->arena, text));
    return pm_scene_expand(r, at, *text, text);
}

// --- tables of ports ---

static pm_status check_numbers(const char *path, const char *dataset, int count,
                               const double *table) {
    for (int i = 0; i < 2 * count; ++i) {
        if (!(table[i] >= 0 && table[i] <= MAX_INDEX && table[i] == floor(table[i]))) {
            return pm_fail(PM_EDATA, "%s: dataset %s: row %d has %g, expected a whole number >= 0",
                           path, dataset, i / 2, table[i]);
        }
    }
    return PM_OK;
}

static pm_status load_table(pm_scene_reader *r, const char *path, const char *dataset, int count,
                            double **table) {
    const int extent[2] = {count, 2};
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    *table = pm_arena_array(r->arena, 2 * (size_t)count, sizeof **table);
    PM_TRY_DONE(*table == NULL ? pm_scene_no_memory() : PM_OK);
    PM_TRY_DONE(pm_hdf5_read(file, dataset, 2, extent, *table));
    status = check_numbers(path, dataset, count, *table);
done:
    pm_hdf5_close(file);
    return status;
}

pm_status pm_scene_read_table(pm_scene_reader *r, pm_yaml block, int count, const double **table) {
    static const char *const keys[] = {"file", "dataset", NULL};
    const pm_yaml value = pm_yaml_get(block, "table");
    const char *path, *dataset;
    pm_yaml file, name;
    double *numbers = NULL;
    *table = NULL;
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    if (r->naxis == 0) {
        return pm_yaml_fail(value, "a table needs a range of ports, such as joint[0:30]");
    }
    PM_TRY(pm_yaml_allow(value, keys));
    PM_TRY(pm_yaml_require(value, "file", &file));
    PM_TRY(pm_yaml_require(value, "dataset", &name));
    PM_TRY(pm_scene_read_path(r, file, &path));
    PM_TRY(pm_yaml_text(name, r->arena, &dataset));
    PM_TRY(load_table(r, path, dataset, count, &numbers));
    *table = numbers;
    return PM_OK;
}

// --- all entries of a mapping ---

pm_status pm_scene_read_entries(pm_scene_reader *r, pm_yaml map, pm_scene_entries *entries) {
    const int count = pm_yaml_count(map);
    *entries = (pm_scene_entries){
        .map = map,
        .count = count,
        .range = pm_arena_array(r->arena, (size_t)count, sizeof *entries->range),
        .first = pm_arena_array(r->arena, (size_t)count, sizeof *entries->first),
    };
    if (entries->range == NULL || entries->first == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < count; ++i) {
        pm_yaml key, block;
        const char *text;
        pm_yaml_entry(map, i, &key, &block);
        PM_TRY(pm_yaml_text(key, r->arena, &text));
        PM_TRY(pm_scene_parse_range(r, key, text, &entries->range[i]));
        entries->first[i] = entries->total;
        if (entries->range[i].total > PM_SCENE_MOST_COMPONENTS - entries->total) {
            return pm_yaml_fail(key, "more than %d components in all", PM_SCENE_MOST_COMPONENTS);
        }
        entries->total += entries->range[i].total;
    }
    return PM_OK;
}

int pm_scene_entry_of(const pm_scene_entries *entries, int component) {
    int low = 0, high = entries->count;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (entries->first[middle] <= component) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

const char *pm_scene_range_of(const pm_scene_entries *entries, int component) {
    const pm_scene_range *range = &entries->range[pm_scene_entry_of(entries, component)];
    return range->naxis == 0 ? NULL : range->key;
}

pm_status pm_scene_enter_entry(pm_scene_reader *r, const pm_scene_entries *entries, int id,
                               pm_yaml *key, pm_yaml *block, const char **name, int *first) {
    const int i = pm_scene_entry_of(entries, id);
    const pm_scene_range *range = &entries->range[i];
    *first = entries->first[i];
    pm_yaml_entry(entries->map, i, key, block);
    pm_scene_enter(r, range, id - *first);
    PM_TRY(pm_scene_expand(r, *key, range->pattern, name));
    return pm_scene_check_name(*key, *name);
}

pm_status pm_scene_sort_names(pm_scene_reader *r, const pm_scene_entries *entries,
                              const char *(*name_of)(const pm_scene *scene, int id),
                              pm_names *names) {
    const char **name = pm_arena_array(r->arena, (size_t)entries->total, sizeof *name);
    if (name == NULL) {
        return pm_scene_no_memory();
    }
    for (int i = 0; i < entries->total; ++i) {
        name[i] = name_of(r->scene, i);
    }
    PM_TRY(pm_names_sort(names, name, entries->total, r->arena));
    const int twice = pm_names_twice(names);
    if (twice < 0) {
        return PM_OK;
    }
    pm_yaml key, block;
    pm_yaml_entry(entries->map, pm_scene_entry_of(entries, twice), &key, &block);
    return pm_yaml_fail(key, "the name \"%s\" occurs twice", name[twice]);
}

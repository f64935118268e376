// Reads lists of dataset columns and expands their ranges: "f[0:3]" stands for f0, f1, f2.
#include <string.h>

#include "scene/scene_reader.h"
#include "store/names.h"

// The most components of one list, and the most column names of a scene. A range is short to write,
// so its expansion needs a limit.
#define MAX_COMPONENTS 100000
#define MAX_NAMES 1000000

static pm_yaml item(pm_yaml list, int i) {
    return pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
}

static pm_status read_range(pm_scene_reader *r, pm_yaml at, pm_name_range *range) {
    const char *text;
    PM_TRY(pm_scene_read_indexed(r, at, &text));
    const pm_status status = pm_name_range_parse(range, text);
    return status == PM_OK ? PM_OK : pm_yaml_fail(at, "%s", pm_error());
}

// Reads the ranges [nitem] of a list; `count` receives the number of names that they stand for.
static pm_status read_ranges(pm_scene_reader *r, pm_yaml list, int nitem, pm_name_range *range,
                             int *count) {
    *count = 0;
    for (int i = 0; i < nitem; ++i) {
        PM_TRY(read_range(r, item(list, i), &range[i]));
        if (range[i].count > MAX_COMPONENTS - *count) {
            return pm_yaml_fail(item(list, i), "expected 1 to %d components, found more",
                                MAX_COMPONENTS);
        }
        *count += range[i].count;
        if (range[i].count > MAX_NAMES - r->nname) {
            return pm_yaml_fail(item(list, i), "more than %d columns in all", MAX_NAMES);
        }
        r->nname += range[i].count;
    }
    return *count > 0 ? PM_OK
                      : pm_yaml_fail(list, "expected 1 to %d components, found 0", MAX_COMPONENTS);
}

pm_status pm_scene_read_columns(pm_scene_reader *r, pm_yaml list, int *count,
                                pm_scene_named **result) {
    const int nitem = pm_yaml_is_list(list) ? pm_yaml_count(list) : 1;
    pm_name_range *range = pm_arena_array(r->arena, (size_t)nitem, sizeof *range);
    if (range == NULL) {
        return pm_scene_no_memory();
    }
    PM_TRY(read_ranges(r, list, nitem, range, count));
    pm_scene_named *named = pm_arena_array(r->arena, (size_t)*count, sizeof *named);
    if (named == NULL) {
        return pm_scene_no_memory();
    }
    *result = named;
    for (int i = 0; i < nitem; ++i) {
        for (int k = 0; k < range[i].count; ++k, ++named) {
            *named = (pm_scene_named){pm_name_range_text(&range[i], k, r->arena), item(list, i)};
            if (named->text == NULL) {
                return pm_scene_no_memory();
            }
        }
    }
    return PM_OK;
}

pm_status pm_scene_read_places(pm_scene_reader *r, const pm_scene_named *list, int count,
                               const char **at) {
    for (int i = 0; i < count; ++i) {
        if (i > 0 && list[i].at.node == list[i - 1].at.node) {
            at[i] = at[i - 1];
        } else {
            PM_TRY(pm_scene_read_at(r, list[i].at, &at[i]));
        }
    }
    return PM_OK;
}

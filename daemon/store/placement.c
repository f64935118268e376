// Parses the text of a placement as the inside of a YAML mapping.
#include "store/placement.h"

#include "store/yaml.h"

static pm_status read_axes(pm_yaml axes, pm_placement *placement) {
    static const char *const names[] = {"+x", "-x", "+y", "-y", "+z", "-z", NULL};
    int seen = 0;
    for (int d = 0; d < 3 && pm_yaml_count(axes) == 3; ++d) {
        int id;
        PM_TRY(pm_yaml_choice(pm_yaml_item(axes, d), names, &id));
        placement->axis[d] = id / 2;
        placement->sign[d] = id % 2 == 0 ? 1 : -1;
        seen |= 1 << placement->axis[d];
    }
    return seen == 7 ? PM_OK : pm_yaml_fail(axes, "expected three axes such as [+x, +y, +z]");
}

static pm_status read_map(pm_yaml map, pm_arena *arena, pm_placement *placement) {
    static const char *const keys[] = {"origin", "axes", NULL};
    pm_yaml origin, axes;
    int count;
    double *number;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_yaml_require(map, "origin", &origin));
    PM_TRY(pm_yaml_require(map, "axes", &axes));
    PM_TRY(pm_yaml_doubles(origin, arena, &count, &number));
    if (count != 3) {
        return pm_yaml_fail(origin, "expected three numbers, found %d", count);
    }
    for (int d = 0; d < 3; ++d) {
        placement->origin[d] = number[d];
    }
    return pm_yaml_is_list(axes) ? read_axes(axes, placement)
                                 : pm_yaml_fail(axes, "expected a list");
}

pm_status pm_placement_read(const char *text, const char *name, pm_placement *placement) {
    pm_arena arena = {NULL};
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_placement read = PM_PLACEMENT_WORLD;
    pm_status status = PM_ENOMEM;
    const char *map = pm_arena_printf(&arena, "{%s}", text);
    if (map == NULL) {
        status = pm_fail(PM_ENOMEM, "%s: out of memory", name);
        goto done;
    }
    PM_TRY_DONE(pm_yaml_parse(&document, map, "placement", &root));
    PM_TRY_DONE(read_map(root, &arena, &read));
    *placement = read;
done:
    pm_yaml_close(document);
    pm_arena_free(&arena);
    return status == PM_ECONFIG ? pm_fail(PM_EDATA, "%s: %s", name, pm_error()) : status;
}

// Reads placements from YAML maps and from the text of field files.
#include "store/placement.h"

// Reads the list of axes. A rotation is proper if the permutation of the axes and the product of
// their signs have the same parity.
static pm_status read_axes(pm_yaml axes, pm_placement *placement) {
    static const char *const names[] = {"+x", "-x", "+y", "-y", "+z", "-z", NULL};
    int seen = 0;
    if (!pm_yaml_is_list(axes)) {
        return pm_yaml_fail(axes, "expected a list");
    }
    for (int d = 0; d < 3 && pm_yaml_count(axes) == 3; ++d) {
        int id = 0;
        PM_TRY(pm_yaml_choice(pm_yaml_item(axes, d), names, &id));
        placement->axis[d] = id / 2;
        placement->sign[d] = id % 2 == 0 ? 1 : -1;
        seen |= 1 << placement->axis[d];
    }
    const bool cyclic = (placement->axis[0] + 1) % 3 == placement->axis[1];
    const double sign = placement->sign[0] * placement->sign[1] * placement->sign[2];
    return seen == 7 && (sign > 0) == cyclic
               ? PM_OK
               : pm_yaml_fail(
                     axes, "expected three axes such as [+x, +y, +z], different and right-handed");
}

pm_status pm_placement_read(pm_yaml map, pm_arena *arena, pm_placement *placement) {
    static const char *const keys[] = {"origin", "axes", NULL};
    pm_yaml origin, axes;
    pm_placement read = PM_PLACEMENT_IDENTITY;
    int count = 0;
    double *number = NULL;
    PM_TRY(pm_yaml_allow(map, keys));
    PM_TRY(pm_yaml_require(map, "origin", &origin));
    PM_TRY(pm_yaml_require(map, "axes", &axes));
    PM_TRY(pm_yaml_doubles(origin, arena, &count, &number));
    if (count != 3) {
        return pm_yaml_fail(origin, "expected three numbers, found %d", count);
    }
    for (int d = 0; d < 3; ++d) {
        read.origin[d] = number[d];
    }
    PM_TRY(read_axes(axes, &read));
    *placement = read;
    return PM_OK;
}

pm_status pm_placement_parse(const char *text, const char *name, pm_placement *placement) {
    pm_arena arena = {NULL};
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    const char *map = pm_arena_printf(&arena, "{%s}", text);
    if (map == NULL) {
        status = pm_fail(PM_ENOMEM, "%s: out of memory", name);
        goto done;
    }
    PM_TRY_DONE(pm_yaml_parse(&document, map, "placement", &root));
    PM_TRY_DONE(pm_placement_read(root, &arena, placement));
done:
    pm_yaml_close(document);
    pm_arena_free(&arena);
    return status == PM_ECONFIG ? pm_fail(PM_EDATA, "%s: %s", name, pm_error()) : status;
}

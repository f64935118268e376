// Images of a state.
#include "model/image.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define MOST_NUMBERS 10000000 // of a matrix: 80 MB

typedef char entry_name[PM_MAX_NAME + 16];

static const pm_param_entry *entry_of(const pm_params *params, const pm_image_spec *image,
                                      const char *what) {
    entry_name name;
    snprintf(name, sizeof name, "image.%s.%s", image->name, what);
    return pm_params_find(params, name);
}

static pm_node node_of(pm_graph *g, const pm_params *params, const pm_image_spec *image,
                       const char *what) {
    const pm_param_entry *entry = entry_of(params, image, what);
    return pm_param(g, entry->value, entry->rows, entry->cols);
}

bool pm_image_is_of(const pm_image_spec *image, const char *group) {
    for (int i = 0; i < image->ngroup; ++i) {
        if (strcmp(image->group[i], group) == 0) {
            return true;
        }
    }
    return false;
}

// --- declaring ---

static pm_status check_groups(const pm_image_spec *image, const pm_layout *layout, int *cols) {
    *cols = 0;
    for (int i = 0; i < image->ngroup; ++i) {
        const pm_group *group = pm_layout_find(layout, image->group[i]);
        if (group == NULL) {
            return pm_fail(PM_ECONFIG, "image %s: the state has no group \"%s\"", image->name,
                           image->group[i]);
        }
        *cols += group->size;
    }
    return PM_OK;
}

static pm_status check_name(const pm_part *part, int i) {
    const char *name = part->spec.image[i].name;
    bool taken = pm_layout_find(&part->layout, name) != NULL;
    for (int k = 0; k < i; ++k) {
        taken = taken || strcmp(part->spec.image[k].name, name) == 0;
    }
    if (taken || strlen(name) >= PM_MAX_NAME) {
        return pm_fail(PM_ECONFIG, "image %.64s: its name is %s", name,
                       taken ? "that of a group, or of another image" : "too long");
    }
    return PM_OK;
}

static pm_status declare(const pm_image_spec *image, const pm_layout *layout, pm_params *params) {
    const pm_matrix_spec *matrix = &image->matrix;
    int cols;
    PM_TRY(check_groups(image, layout, &cols));
    if (cols == 0 || image->size > MOST_NUMBERS / cols) {
        return pm_fail(PM_ECONFIG, "image %s: a matrix of %d x %d, expected 1 to %d numbers",
                       image->name, image->size, cols, MOST_NUMBERS);
    }
    if (matrix->value != NULL && (matrix->rows != image->size || matrix->cols != cols)) {
        return pm_fail(PM_ECONFIG, "image %s: the matrix is %d x %d, expected %d x %d", image->name,
                       matrix->rows, matrix->cols, image->size, cols);
    }
    entry_name name;
    const bool kept = matrix->value == NULL;
    snprintf(name, sizeof name, "image.%s.matrix", image->name);
    PM_TRY(pm_params_add(params, name, image->size, cols, false, 0, NAN));
    snprintf(name, sizeof name, "image.%s.offset", image->name);
    PM_TRY(pm_params_add(params, name, 1, image->size, false, 0, kept ? NAN : 0));
    if (!kept) {
        memcpy(entry_of(params, image, "matrix")->value, matrix->value,
               (size_t)image->size * (size_t)cols * sizeof(double));
    }
    if (image->offset != NULL) {
        memcpy(entry_of(params, image, "offset")->value, image->offset,
               (size_t)image->size * sizeof(double));
    }
    return PM_OK;
}

pm_status pm_images_declare(pm_part *part) {
    for (int i = 0; i < part->spec.nimage; ++i) {
        const pm_image_spec *image = &part->spec.image[i];
        PM_TRY(pm_spec_locate(image->at, check_name(part, i)));
        PM_TRY(pm_spec_locate(image->at, declare(image, &part->layout, &part->params)));
    }
    return PM_OK;
}

// --- building ---

static int position_of(const pm_symbols *symbols, const char *name) {
    int i = 0;
    while (strcmp(symbols->symbol[i].name, name) != 0) {
        ++i;
        assert(i < symbols->count);
    }
    return i;
}

// The groups of an image side by side.
static pm_node join(pm_graph *g, const pm_image_spec *image, const pm_symbols *symbols) {
    pm_node part[PM_MAX_GROUPS];
    for (int i = 0; i < image->ngroup; ++i) {
        part[i] = symbols->symbol[position_of(symbols, image->group[i])].node;
    }
    return pm_concat(g, image->ngroup, part);
}

void pm_images_add(const pm_part *part, pm_graph *g, pm_symbols *symbols) {
    for (int i = 0; i < part->spec.nimage; ++i) {
        const pm_image_spec *image = &part->spec.image[i];
        pm_node node = PM_NO_NODE;
        if (g != NULL) {
            node = pm_add(g,
                          pm_matmul(g, join(g, image, symbols), false,
                                    node_of(g, &part->params, image, "matrix"), true),
                          node_of(g, &part->params, image, "offset"));
        }
        pm_symbols_add_one(symbols, image->name, image->size, node);
    }
}

void pm_images_pull(const pm_part *part, pm_graph *g, pm_node *covector) {
    for (int i = 0; i < part->spec.nimage; ++i) {
        const pm_image_spec *image = &part->spec.image[i];
        const pm_node own = covector[part->layout.ngroup + i];
        if (own == PM_NO_NODE) {
            continue;
        }
        const pm_node all =
            pm_matmul(g, own, false, node_of(g, &part->params, image, "matrix"), false);
        int first = 0;
        for (int k = 0; k < image->ngroup; ++k) {
            const pm_group *group = pm_layout_find(&part->layout, image->group[k]);
            pm_node *sum = &covector[group - part->layout.group];
            *sum = pm_add_or(g, *sum, pm_slice(g, all, first, group->size));
            first += group->size;
        }
    }
}

// --- how far they move ---

// The spreads of an image's groups side by side; PM_NO_NODE if none moves.
static pm_node join_spreads(const pm_part *part, pm_graph *g, const pm_image_spec *image,
                            const pm_node *radius) {
    pm_node side[PM_MAX_GROUPS];
    bool moves = false;
    for (int i = 0; i < image->ngroup; ++i) {
        const pm_group *group = pm_layout_find(&part->layout, image->group[i]);
        const pm_node own = radius[group - part->layout.group];
        side[i] = own == PM_NO_NODE ? pm_constant(g, 0, 1, group->size) : own;
        moves = moves || own != PM_NO_NODE;
    }
    return moves ? pm_concat(g, image->ngroup, side) : PM_NO_NODE;
}

void pm_images_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols,
                      pm_node *radius) {
    const int ngroup = part->layout.ngroup;
    for (int i = 0; i < ngroup; ++i) {
        if (radius[i] != PM_NO_NODE) {
            const pm_node size = pm_magnitude(g, symbols->symbol[i].node);
            radius[i] = pm_add(g, radius[i], pm_scale(g, size, PM_IMAGE_ROUNDING));
        }
    }
    for (int i = 0; i < part->spec.nimage; ++i) {
        const pm_image_spec *image = &part->spec.image[i];
        const pm_node moves = join_spreads(part, g, image, radius);
        radius[ngroup + i] = PM_NO_NODE;
        if (moves != PM_NO_NODE) {
            const pm_node values = pm_magnitude(g, join(g, image, symbols));
            const pm_node matrix = pm_magnitude(g, node_of(g, &part->params, image, "matrix"));
            const pm_node offset = pm_magnitude(g, node_of(g, &part->params, image, "offset"));
            // (Also of groups that do not move.)
            const pm_node most = pm_add(g, moves, pm_scale(g, values, PM_IMAGE_ROUNDING));
            radius[ngroup + i] = pm_add(g, pm_matmul(g, most, false, matrix, true),
                                        pm_scale(g, offset, PM_IMAGE_ROUNDING));
        }
    }
}

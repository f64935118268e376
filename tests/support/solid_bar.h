// A small body of learned material (model/solid/solid.h) with random weights, for tests.
#ifndef PM_TESTS_SUPPORT_SOLID_BAR_H
#define PM_TESTS_SUPPORT_SOLID_BAR_H

#include <string.h>

#include "base/rng.h"
#include "model/solid/solid.h"
#include "tests/support/unit.h"

#define ELEMENTS 4 // along x, with one element along y and z
#define NODES (4 * (ELEMENTS + 1))

// A distorted bar, clamped at x = 0, with a material of its own.
typedef struct bar {
    double position[NODES][3];
    int brick[ELEMENTS][PM_BRICK_NODES];
    bool clamped[NODES];
    pm_solid_mesh mesh;
    pm_solid_spec spec;
    pm_params params;
    pm_solid_material material;
    pm_solid *solid;
    pm_rng rng;
} bar;

// Makes a bar of so many branches whose weights differ by `spread` from those of a soft, relaxing
// material.
static inline void open_bar(bar *b, int nbranch, uint64_t seed, double spread) {
    static const int corner[PM_BRICK_NODES][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                                  {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    *b = (bar){.spec = {nbranch, 3, 300}};
    pm_rng_init(&b->rng, seed, 1);
    for (int i = 0; i < NODES; ++i) {
        const int at[3] = {i % (ELEMENTS + 1), i / (ELEMENTS + 1) % 2, i / (2 * (ELEMENTS + 1))};
        b->clamped[i] = at[0] == 0;
        for (int k = 0; k < 3; ++k) {
            b->position[i][k] = at[k] + 0.05 * pm_rng_normal(&b->rng);
        }
    }
    for (int e = 0; e < ELEMENTS; ++e) {
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            b->brick[e][n] = e + corner[n][0] + (ELEMENTS + 1) * (corner[n][1] + 2 * corner[n][2]);
        }
    }
    b->mesh = (pm_solid_mesh){.nnode = NODES,
                              .nelement = ELEMENTS,
                              .position = b->position[0],
                              .brick = b->brick[0],
                              .clamped = b->clamped};
    assert_int_equal(pm_solid_material_declare(&b->spec, &b->params), PM_OK);
    pm_params_find(&b->params, "unit")->value[0] = 1000;
    for (int i = 0; i < b->params.count; ++i) {
        const pm_param_entry *entry = &b->params.entry[i];
        for (int k = 0; k < entry->rows * entry->cols && entry->trained; ++k) {
            entry->value[k] += spread * pm_rng_normal(&b->rng);
        }
    }
    if (nbranch > 1) {
        pm_params_find(&b->params, "branch1.relaxation")->value[0] += 2;
    }
    pm_solid_material_read(&b->spec, &b->params, &b->material);
    assert_int_equal(pm_solid_open(&b->solid, &b->mesh, &b->material), PM_OK);
}

static inline void close_bar(bar *b) {
    pm_solid_close(b->solid);
    pm_params_free(&b->params);
}

// Adds random numbers to the free components of x [NODES][3].
static inline void shake(bar *b, double size, double *x) {
    for (int i = 0; i < 3 * NODES; ++i) {
        x[i] += b->clamped[i / 3] ? 0 : size * pm_rng_normal(&b->rng);
    }
}

#endif

// Visits trajectories and their symmetric copies one at a time.
#include "modal/reduction.h"

#include <math.h>

double pm_reduction_norm(size_t count, const double *value) {
    double sum = 0;
    for (size_t i = 0; i < count; ++i) {
        sum += value[i] * value[i];
    }
    return sqrt(sum);
}

pm_status pm_reduction_for_each(pm_reduction *r, pm_reduction_visit *visit, void *context) {
    pm_modal_trajectory *p = &r->modal;
    for (int i = 0; i < r->count; ++i) {
        for (int k = 0; k < r->ncopy; ++k) {
            pm_modal_trajectory_read(p, r->field, r->trajectory[i], &r->copy[k]);
            const double size = pm_reduction_norm(3 * (size_t)p->nnode * (size_t)p->ntime, p->u);
            if (size > 0) {
                PM_TRY(visit(r, 1 / size, context));
            }
        }
    }
    return PM_OK;
}

pm_status pm_reduction_no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a reduction");
}

pm_status pm_reduction_open(pm_reduction *r, int nmode, int nbranch, bool square,
                            pm_load_kind loads, bool stress) {
    if (square) {
        r->ncopy = PM_SYMMETRY_COPIES_OF_SQUARE;
        PM_TRY(pm_symmetry_copies_make(r->copy, r->field, &r->arena));
    } else {
        r->ncopy = 1;
        PM_TRY(pm_symmetry_copies_none(&r->copy[0], r->field, &r->arena));
    }
    return pm_modal_trajectory_open(&r->modal, r->field, nmode, nbranch, loads, stress);
}

void pm_reduction_close(pm_reduction *r) {
    pm_modal_trajectory_close(&r->modal);
    pm_arena_free(&r->arena);
}

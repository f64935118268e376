// Finds the sections of a body, and convolves forces along them.
#include "bodies/modal/local.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "base/linalg.h"

// Two places count as the same if they are this close, relative to the length of the body.
#define SAME_PLACE 1e-6

// --- sections ---

// Returns the smallest x of a node that is larger than `x`; infinity if there is none.
static double next_x(int nnode, const double *position, double x) {
    double next = INFINITY;
    for (int i = 0; i < nnode; ++i) {
        next = position[3 * i] > x ? fmin(next, position[3 * i]) : next;
    }
    return next;
}

pm_status pm_local_find_sections(pm_local *local, int nnode, const double *position,
                                 pm_arena *arena) {
    const double first = next_x(nnode, position, -INFINITY);
    double last = first;
    for (int i = 0; i < nnode; ++i) {
        last = fmax(last, position[3 * i]);
    }
    const double tolerance = SAME_PLACE * (last - first);
    const double step = next_x(nnode, position, first + tolerance) - first;
    const double intervals = isfinite(step) ? round((last - first) / step) : 0;
    if (intervals >= nnode) {
        return pm_fail(PM_EDATA, "the body is not prismatic: %g sections, %d nodes", intervals + 1,
                       nnode);
    }
    *local = (pm_local){.nsection = (int)intervals + 1};
    local->nper = nnode / local->nsection;
    local->node = pm_arena_array(arena, (size_t)nnode, sizeof *local->node);
    PM_TRY(pm_arena_status(arena, "the sections of a body"));
    int place = 0;
    for (int i = 0; i < nnode; ++i) {
        if (position[3 * i] > first + tolerance) {
            continue;
        }
        for (int k = 0; k < local->nsection && place < local->nper; ++k) {
            const double at[3] = {first + k * step, position[3 * i + 1], position[3 * i + 2]};
            int node = 0;
            for (const double *x = position;
                 node < nnode && (fabs(x[0] - at[0]) > tolerance ||
                                  fabs(x[1] - at[1]) > tolerance || fabs(x[2] - at[2]) > tolerance);
                 x += 3) {
                ++node;
            }
            if (node == nnode) {
                return pm_fail(PM_EDATA, "the body is not prismatic: no node at (%g, %g, %g)",
                               at[0], at[1], at[2]);
            }
            local->node[k * local->nper + place] = node;
        }
        ++place;
    }
    return place * local->nsection == nnode
               ? PM_OK
               : pm_fail(PM_EDATA, "the body is not prismatic: %d nodes in %d sections of %d",
                         nnode, local->nsection, place);
}

pm_status pm_local_set_loaded(pm_local *local, const int *carries, int reach, pm_arena *arena) {
    local->reach = reach;
    local->loaded = pm_arena_array(arena, (size_t)local->nper, sizeof *local->loaded);
    PM_TRY(pm_arena_status(arena, "the sections of a body"));
    for (int i = 0; i < local->nper; ++i) {
        bool any = false;
        for (int k = 0; k < local->nsection; ++k) {
            any = any || carries[local->node[k * local->nper + i]] != 0;
        }
        if (any) {
            local->loaded[local->nloaded++] = i;
        }
    }
    const size_t count = (size_t)pm_local_features(local) * (size_t)local->nper * PM_LOCAL_TENSOR;
    local->kernel = pm_arena_array(arena, count + 1, sizeof *local->kernel);
    return pm_arena_status(arena, "the sections of a body");
}

// --- forces and stress ---

int pm_local_features(const pm_local *local) {
    return (2 * local->reach + 1) * local->nloaded * 3;
}

void pm_local_fill_features(const pm_local *local, const double *f, int section, double *feature) {
    for (int offset = -local->reach; offset <= local->reach; ++offset) {
        const int from = section + offset;
        const bool there = from >= 0 && from < local->nsection;
        for (int i = 0; i < local->nloaded; ++i, feature += 3) {
            if (there) {
                const int node = local->node[from * local->nper + local->loaded[i]];
                memcpy(feature, f + 3 * (ptrdiff_t)node, 3 * sizeof *feature);
            } else {
                memset(feature, 0, 3 * sizeof *feature);
            }
        }
    }
}

size_t pm_local_work(const pm_local *local) {
    return (size_t)(pm_local_features(local) + PM_LOCAL_TENSOR * local->nper) + 1;
}

void pm_local_add(const pm_local *local, const double *f, double *stress, double *work) {
    const int count = pm_local_features(local), width = PM_LOCAL_TENSOR * local->nper;
    double *feature = work, *sum = work + count;
    for (int k = 0; k < local->nsection && count > 0; ++k) {
        pm_local_fill_features(local, f, k, feature);
        pm_gemm(false, false, 1, width, count, feature, local->kernel, sum);
        for (int i = 0; i < local->nper; ++i) {
            double *to = stress + PM_LOCAL_TENSOR * (ptrdiff_t)local->node[k * local->nper + i];
            for (int c = 0; c < PM_LOCAL_TENSOR; ++c) {
                to[c] += sum[PM_LOCAL_TENSOR * i + c];
            }
        }
    }
}

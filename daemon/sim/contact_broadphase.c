// Finds boxes in which no pair of points touches: evaluates the bound of model/contact_bound.h and
// searches for the largest box that satisfies it.
#include "sim/contact_broadphase.h"

#include <math.h>
#include <string.h>

#include "model/contact_bound.h"

#define SAFETY 0.9   // fraction of the largest box that is taken
#define ENOUGH 1.001 // least opening / spread: the rounding of the box itself is far less than this
#define LONGEST 1e6  // s, duration of a box
#define MOST_TRIES 8 // to find a box
// The assumed rate of a component is at least this fraction of the largest rate in its group.
#define ASIDE 0.05

static pm_status open_program(pm_contact_broadphase *b, const pm_part *part) {
    pm_graph *g = NULL;
    pm_status status = PM_OK;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, b->nz), width = pm_input(g, true, 1, b->nz);
    pm_node output[2];
    if (!pm_contact_bound_build(g, part, z, width, b->unconstrained, &output[0], &output[1])) {
        b->unconstrained = NULL;
        goto done;
    }
    PM_TRY_DONE(pm_program_open(&b->program, g, 2, output, 1));
    b->n = pm_graph_shape(g, output[0]).cols;
    b->program_z = pm_program_value(b->program, z);
    b->program_width = pm_program_value(b->program, width);
    b->value = pm_program_value(b->program, output[0]);
    b->spread = pm_program_value(b->program, output[1]);
done:
    pm_graph_close(g);
    return status;
}

pm_status pm_contact_broadphase_open(pm_contact_broadphase *b, pm_arena *arena,
                                     const pm_part *part) {
    b->nz = part->layout.nz;
    b->layout = &part->layout;
    b->unconstrained = pm_arena_array(arena, (size_t)b->nz, sizeof *b->unconstrained);
    b->width = pm_arena_array(arena, (size_t)b->nz, sizeof *b->width);
    return b->unconstrained == NULL || b->width == NULL
               ? pm_fail(PM_ENOMEM, "out of memory for the broad phase of contact")
               : open_program(b, part);
}

void pm_contact_broadphase_close(pm_contact_broadphase *b) {
    pm_program_close(b->program);
}

void pm_contact_broadphase_forget(pm_contact_broadphase *b) {
    b->enclosed = false;
    b->duration = 1;
}

// --- enclosing ---

void pm_contact_broadphase_enclose(pm_contact_broadphase *b, const double *z, const double *dE,
                                   const double *rate) {
    b->enclosed = false;
    bool touches = b->unconstrained == NULL;
    for (int c = 0; c < b->nz && dE != NULL && !touches; ++c) {
        touches = b->unconstrained[c] && dE[c] != 0;
    }
    if (touches) {
        return;
    }
    memcpy(b->program_z, z, (size_t)b->nz * sizeof *z);
    for (int i = 0; i < b->layout->ngroup; ++i) { // the width of a box that lasts one second
        const pm_group *group = &b->layout->group[i];
        double fastest = 0;
        for (int c = group->first; rate != NULL && c < group->first + group->size; ++c) {
            fastest = fmax(fastest, fabs(rate[c]));
        }
        for (int c = group->first; c < group->first + group->size; ++c) {
            b->width[c] = rate == NULL ? 1 : fmax(fabs(rate[c]), ASIDE * fastest);
        }
    }
    double duration = b->duration;
    for (int i = 0; i < MOST_TRIES && isnormal(duration); ++i) {
        // The smallest opening / spread in a box that lasts for this duration; 0 if a pair touches.
        double ratio = INFINITY;
        for (int c = 0; c < b->nz; ++c) {
            b->program_width[c] = duration * b->width[c];
        }
        pm_program_run(b->program, 1);
        for (int k = 0; k < b->n; ++k) {
            const double own = b->value[k] / b->spread[k];
            ratio = own >= ratio ? ratio : own; // NaN too
        }
        ratio = ratio > 0 ? ratio : 0;
        if (ratio > ENOUGH && (i > 0 || ratio < 2)) {
            b->enclosed = true;
            b->duration = duration;
            break;
        }
        duration = fmin(duration * SAFETY * ratio, LONGEST); // exact where openings are linear
    }
    for (int c = 0; c < b->nz; ++c) {
        b->width[c] *= duration;
    }
}

// --- the test ---

bool pm_contact_broadphase_holds(const pm_contact_broadphase *b, const double *centre,
                                 const double *z) {
    if (!b->enclosed) {
        return false;
    }
    for (int c = 0; c < b->nz; ++c) {
        const bool inside = b->unconstrained[c] ? fabs(z[c] - centre[c]) <= b->width[c]
                                                : memcmp(&z[c], &centre[c], sizeof z[c]) == 0;
        if (!inside) {
            return false;
        }
    }
    return true;
}

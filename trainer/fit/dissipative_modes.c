// Rotates factors pair by pair of columns. The best angle of a pair is known in closed form.
#include "fit/dissipative_modes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model/operator.h"

#define MOST_SWEEPS 30
#define SMALLEST_ANGLE 1e-12

static void rotate_pair(int rows, int rank, double *factor, int j, int k, double angle) {
    const double c = cos(angle), s = sin(angle);
    for (int i = 0; i < rows; ++i) {
        double *row = factor + (ptrdiff_t)i * rank;
        const double x = row[j], y = row[k];
        row[j] = c * x + s * y;
        row[k] = c * y - s * x;
    }
}

void pm_dissipative_modes_rotate(int rows, int rank, double *guide, double *factor) {
    double largest = INFINITY;
    for (int sweep = 0; sweep < MOST_SWEEPS && largest > SMALLEST_ANGLE; ++sweep) {
        largest = 0;
        for (int j = 0; j < rank; ++j) {
            for (int k = j + 1; k < rank; ++k) {
                // The best angle of columns j and k.
                double cosine = 0, sine = 0; // of four times the angle, up to a common factor
                for (int r = 0; r < rows; ++r) {
                    const double *row = guide + (ptrdiff_t)r * rank;
                    const double u = row[j] * row[j] - row[k] * row[k], v = 2 * row[j] * row[k];
                    cosine += u * u - v * v;
                    sine += 2 * u * v;
                }
                const double angle = atan2(sine, cosine) / 4;
                rotate_pair(rows, rank, guide, j, k, angle);
                rotate_pair(rows, rank, factor, j, k, angle);
                largest = fmax(largest, fabs(angle));
            }
        }
    }
}

// --- operators ---

// Returns whether the entry "irreversible.<name>" is absent or zero.
static bool is_zero(const pm_params *params, const char *name) {
    pm_operator_name full;
    const pm_param_entry *entry =
        pm_params_find(params, pm_operator_join(full, "irreversible", name));
    for (int i = 0; entry != NULL && i < entry->rows * entry->cols; ++i) {
        if (fabs(entry->value[i]) > 0) {
            return false;
        }
    }
    return true;
}

// Separates the processes of the operator of one component.
static pm_status separate(const pm_operator_spec *op, const pm_site *site, pm_params *params) {
    pm_param_entry *entry = pm_params_find(params, "irreversible.matrix.constant");
    if (op->nheats == 0 || op->rank < 2 || entry == NULL || !is_zero(params, "power") ||
        !is_zero(params, "ratio_power") || !is_zero(params, "split") ||
        !is_zero(params, "strength.output.weight") || !is_zero(params, "strength.output.bias")) {
        return PM_OK;
    }
    const int count = entry->rows * entry->cols;
    double *guide = malloc((size_t)count * sizeof *guide);
    PM_TRY(guide != NULL ? PM_OK
                         : pm_fail(PM_ENOMEM, "out of memory for a factor of %d entries", count));
    memcpy(guide, entry->value, (size_t)count * sizeof *guide);
    const pm_support s = pm_support_of(op, true, site);
    // Subtracts from the rows of the entropies their mean. Heat that a process takes from all
    // entropies alike has no effect (model/dissipation.h).
    for (int j = 0; j < op->rank; ++j) {
        double sum = 0;
        int heats = 0;
        for (int pass = 0; pass < 2; ++pass) {
            for (int i = 0, row = 0; i < s.ngroup; ++i) {
                const pm_site_group *group = s.group[i];
                const int rows = s.learned[i] ? pm_operator_frame_rows(op, group->size) : 0;
                const bool heat = rows > 0 && pm_is_listed(op->nheats, op->heats, group->name);
                for (int k = row; k < row + rows && heat; ++k) {
                    double *own = &guide[(ptrdiff_t)k * op->rank + j];
                    sum += pass == 0 ? *own : 0;
                    heats += pass == 0;
                    *own -= pass == 1 ? sum / heats : 0;
                }
                row += rows;
            }
        }
    }
    pm_dissipative_modes_rotate(count / op->rank, op->rank, guide, entry->value);
    free(guide);
    return PM_OK;
}

pm_status pm_dissipative_modes_separate(pm_system *system) {
    const pm_scene *scene = system->scene;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        pm_site site = {0};
        pm_site_add(&site, &scene->physics.subsystem[i].layout, "", 0);
        PM_TRY(separate(&system->part[i]->spec.irreversible, &site, &system->part[i]->params));
    }
    for (int i = 0; i < scene->physics.nport; ++i) {
        pm_site site = {0};
        pm_site_add(&site, &scene->physics.port[i].layout[0], "a.", 0);
        pm_site_add(&site, &scene->physics.port[i].layout[1], "b.", 1);
        PM_TRY(separate(&system->port[i]->spec.irreversible, &site, &system->port[i]->params));
    }
    return PM_OK;
}

// The range of each group: widened by training, compared with by a run.
#include "model/training_range.h"

#include <float.h>
#include <math.h>

static const char low_name[] = "training_range.low", high_name[] = "training_range.high";
static const char low_input[] = "input_range.low", high_input[] = "input_range.high";

// The bounds of the empty range are finite, since weights files hold finite numbers only. The first
// state replaces them.
pm_status pm_training_range_declare(pm_part *part) {
    const int n = part->layout.ngroup;
    PM_TRY(pm_params_add(&part->params, low_name, 1, n, false, 0, DBL_MAX));
    return pm_params_add(&part->params, high_name, 1, n, false, 0, -DBL_MAX);
}

// Empties the ranges of these names.
static void clear(pm_params *params, const char *low, const char *high) {
    pm_param_entry *l = pm_params_find(params, low), *h = pm_params_find(params, high);
    for (int i = 0; l != NULL && i < l->rows * l->cols; ++i) {
        l->value[i] = DBL_MAX;
        h->value[i] = -DBL_MAX;
    }
}

void pm_training_range_clear(pm_part *part) {
    clear(&part->params, low_name, high_name);
}

static double measure(const pm_group *group, const double *z) {
    const double *x = z + group->first;
    double square = 0;
    for (int c = 0; c < group->size; ++c) {
        square += x[c] * x[c];
    }
    return group->size == 1 ? x[0] : sqrt(square);
}

void pm_training_range_widen(pm_part *part, const double *z) {
    double *low = pm_params_find(&part->params, low_name)->value;
    double *high = pm_params_find(&part->params, high_name)->value;
    for (int i = 0; i < part->layout.ngroup; ++i) {
        const double value = measure(&part->layout.group[i], z);
        low[i] = fmin(low[i], value);
        high[i] = fmax(high[i], value);
    }
}

pm_training_range pm_training_range_of(const pm_part *part) {
    const pm_param_entry *low = pm_params_find(&part->params, low_name);
    const pm_param_entry *high = pm_params_find(&part->params, high_name);
    return low == NULL || high == NULL
               ? (pm_training_range){.low = NULL}
               : (pm_training_range){&part->layout, low->value, high->value};
}

pm_departure pm_training_range_of_group(pm_training_range range, int g, const double *z) {
    const pm_group *group = &range.layout->group[g];
    const double low = range.low[g], high = range.high[g];
    const double slack = group->size > 1 ? PM_RANGE_SLACK * high : 0;
    const double value = measure(group, z), width = fmax(high - low, slack);
    const double beyond = fmax(low - value, value - high);
    const double widths = beyond <= slack ? 0 : width > 0 ? beyond / width : INFINITY;
    return (pm_departure){group, value, low, high, widths};
}

pm_departure pm_training_range_departure(pm_training_range range, const double *z) {
    pm_departure worst = {.group = NULL};
    for (int i = 0; range.low != NULL && i < range.layout->ngroup; ++i) {
        const pm_departure own = pm_training_range_of_group(range, i, z);
        if (own.widths > worst.widths) {
            worst = own;
        }
    }
    return worst;
}

// --- boundary inputs ---

pm_status pm_input_range_declare(pm_port_model *port) {
    const int n = port->layout[0].nz + port->layout[1].nz;
    PM_TRY(pm_params_add(&port->params, low_input, 3, n, false, 0, DBL_MAX));
    return pm_params_add(&port->params, high_input, 3, n, false, 0, -DBL_MAX);
}

void pm_input_range_clear(pm_port_model *port) {
    clear(&port->params, low_input, high_input);
}

static double *input_bound(const pm_port_model *port, const char *name, pm_end end, int which,
                           int c) {
    const pm_param_entry *entry = pm_params_find(&port->params, name);
    const int column = c + (end == PM_END_B ? port->layout[0].nz : 0);
    return entry == NULL ? NULL : &entry->value[which * entry->cols + column];
}

void pm_input_range_widen(pm_port_model *port, pm_end end, int which, int c, double value) {
    double *low = input_bound(port, low_input, end, which, c);
    double *high = input_bound(port, high_input, end, which, c);
    *low = fmin(*low, value);
    *high = fmax(*high, value);
}

bool pm_input_range_of(const pm_port_model *port, pm_end end, int which, int c, double *low,
                       double *high) {
    const double *l = input_bound(port, low_input, end, which, c);
    const double *h = input_bound(port, high_input, end, which, c);
    if (l == NULL || h == NULL || !(*l < *h)) {
        return false;
    }
    *low = *l;
    *high = *h;
    return true;
}

// A run ends before it publishes a state that is not finite or that its weights know nothing of.
#include "sim/step_checks.h"

#include <math.h>

pm_status pm_step_check_finite(const pm_scene_subsystem *subsystem, const double *z) {
    const pm_layout *layout = &subsystem->layout;
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        for (int c = 0; c < group->size; ++c) {
            if (!isfinite(z[group->first + c])) {
                return pm_fail(PM_ENUMERIC,
                               "subsystem %s: %s[%d] became %g: the step is too long for this "
                               "state, or the state left what the weights were trained on; try a "
                               "smaller dt or more substeps",
                               subsystem->name, group->name, c, z[group->first + c]);
            }
        }
    }
    return PM_OK;
}

pm_status pm_step_check_potentials(const pm_scene_subsystem *subsystem, double E, double S) {
    return isfinite(E) && isfinite(S)
               ? PM_OK
               : pm_fail(PM_ENUMERIC,
                         "subsystem %s: energy %g, entropy %g: the state left what the weights "
                         "were trained on",
                         subsystem->name, E, S);
}

pm_status pm_step_check_range(const pm_scene *scene, const pm_scene_subsystem *subsystem,
                              pm_training_range range, const double *z, long step, bool *outside) {
    const pm_departure d = pm_training_range_departure(range, z);
    *outside = d.group != NULL;
    if (!(d.widths > scene->largest_departure)) {
        return PM_OK;
    }
    return pm_fail(PM_ENUMERIC,
                   "subsystem %s: step %ld: %s%s%s = %.4g %s, and its weights were trained on %.4g "
                   "to %.4g: train on a wider range, or widen the scene's guard",
                   subsystem->name, step, d.group->size > 1 ? "|" : "", d.group->name,
                   d.group->size > 1 ? "|" : "", d.value, d.group->unit, d.low, d.high);
}

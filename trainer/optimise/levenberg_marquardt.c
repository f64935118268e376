// The loop over dampings.
#include "optimise/levenberg_marquardt.h"

#include <math.h>

pm_status pm_levenberg_marquardt(const pm_levenberg_marquardt_problem *problem,
                                 const pm_damping *how, double *damping) {
    *damping = *damping == 0 ? how->first : *damping;
    while (!problem->is_over(problem->context)) {
        double before = 0, fraction = 0;
        PM_TRY(problem->linearise(problem->context, &before));
        double after = before;
        while (fraction == 0 && *damping <= how->largest) {
            if (problem->solve(problem->context, *damping)) {
                PM_TRY(problem->evaluate(problem->context, before, &after, &fraction));
            }
            *damping = fraction == 1 ? fmax(*damping * how->relax, how->smallest)
                                     : *damping * how->stiffen;
        }
        const bool moved = fraction > 0;
        if (!moved) {
            *damping = how->first;
        }
        PM_TRY(problem->finish(problem->context, before, moved ? after : before, moved));
    }
    return PM_OK;
}

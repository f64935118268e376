// Fields of a body, trajectory by trajectory.
#include "command_truth_body.h"

#include <math.h>
#include <stdio.h>

#include "base/progress.h"

// Prints the largest |stored + dissipated - work| of a trajectory over its largest work.
static void print_balance(const pm_field *field) {
    double worst = 0;
    const double *energy = field->energy;
    for (int i = 0; i < field->ntrajectory; ++i) {
        double lack = 0, work = 0;
        for (int j = 0; j < field->ntime; ++j, energy += PM_FIELD_ENERGIES) {
            lack = fmax(lack, fabs(energy[0] + energy[1] - energy[2]));
            work = fmax(work, fabs(energy[2]));
        }
        worst = fmax(worst, work > 0 ? lack / work : 0);
    }
    printf("energy            stored and dissipated differ from the work by %.1e of it at most\n",
           worst);
}

static pm_status simulate(const pm_truth *truth, int first, pm_field *field,
                          const volatile sig_atomic_t *stop) {
    const pm_truth_model *model = &truth->model;
    pm_status status = PM_OK;
    pm_progress progress;
    pm_progress_init(&progress, "truth", field->ntrajectory);
    for (int i = 0; i < field->ntrajectory && status == PM_OK; ++i) {
        status = *stop ? pm_fail(PM_EINTERRUPTED, "truth: interrupted, nothing written")
                       : model->body->run(model->ode.data, truth->seed, first + i, field, i);
        if (status == PM_OK) {
            pm_progress_update(&progress, i + 1, NULL);
        }
    }
    pm_progress_finish(&progress);
    return status;
}

pm_status pm_truth_body_write(const pm_truth *truth, int first, int count, const char *command,
                              const char *path, const volatile sig_atomic_t *stop) {
    const pm_truth_model *model = &truth->model;
    const pm_truth_body *body = model->body;
    const pm_field_shape shape = {count, truth->ntime, body->nnode, body->nvariable,
                                  body->nelement};
    char seed[32];
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)truth->seed);
    const char *const notes[][2] = {
        {"title", model->title},           {"source", "portmet-train truth"}, {"command", command},
        {"parameters", model->parameters}, {"units", model->units},           {"seed", seed},
    };
    pm_field *field = NULL;
    pm_status status;
    PM_TRY_DONE(pm_field_new(&field, shape, truth->dt, body->variable));
    body->describe(model->ode.data, field);
    PM_TRY_DONE(simulate(truth, first, field, stop));
    print_balance(field);
    PM_TRY_DONE(pm_field_save(field, path, (int)(sizeof notes / sizeof *notes), notes));
    printf("wrote %s: %d trajectories of %d states, %g s apart, %d nodes\n", path, count,
           truth->ntime, truth->dt, body->nnode);
done:
    pm_field_free(field);
    return status;
}

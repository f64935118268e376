// Simulates bodies trajectory by trajectory, prints balances, and saves the fields.
#include "bodies/bodies.h"

#include <math.h>
#include <stdio.h>

#include "base/path.h"
#include "base/progress.h"
#include "bodies/command/fields.h"
#include "bodies/truth/beam.h"

// Prints the largest |stored + dissipated - work| of a trajectory over its largest work, both
// summed over the bodies, field [nbody]. The work is that of loads and contact forces. With names,
// prints how often and how strongly each body is touched.
static void print_report(int nbody, const char *const *name, pm_field *const *field) {
    double worst = 0;
    for (int i = 0; i < field[0]->ntrajectory; ++i) {
        double error = 0, work = 0;
        for (int j = 0; j < field[0]->ntime; ++j) {
            const int at = i * field[0]->ntime + j;
            double sum[2] = {0};
            for (int k = 0; k < nbody; ++k) {
                const double *energy = field[k]->energy + PM_FIELD_ENERGIES * at;
                sum[0] += energy[0] + energy[1];
                sum[1] += energy[2] + field[k]->contact_work[at];
            }
            error = fmax(error, fabs(sum[0] - sum[1]));
            work = fmax(work, fabs(sum[1]));
        }
        worst = fmax(worst, work > 0 ? error / work : 0);
    }
    printf("energy            stored and dissipated differ from the work by %.1e of it at most\n",
           worst);
    for (int b = 0; b < nbody && name != NULL; ++b) {
        const pm_field *own = field[b];
        double largest = 0;
        int touching = 0, states = 0;
        for (int i = 0; i < own->ntrajectory; ++i) {
            int count = 0;
            for (int j = 0; j < own->ntime; ++j) {
                const double *force = pm_field_contact(own, i, j);
                double total[3] = {0};
                for (int k = 0; k < 3 * own->nnode; ++k) {
                    total[k % 3] += force[k];
                }
                const double size =
                    sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2]);
                largest = fmax(largest, size);
                count += size > 0;
            }
            touching += count > 0;
            states += count;
        }
        printf(
            "contact           %s: in %d of %d trajectories, %.0f %% of the time, %.3g N at most\n",
            name[b], touching, own->ntrajectory, 100.0 * states / (own->ntrajectory * own->ntime),
            largest);
    }
}

// Simulates `count` trajectories from `first` on and prints how well energy is balanced. Writes the
// fields of each body (bodies/field/field.h) to a file of its own: `path`, or for a body with a
// name `path` with the name before its ending. An XDMF file stands beside
// each.
static pm_status write_fields(const pm_truth *truth, int first, int count, const char *command,
                              const char *path, const volatile sig_atomic_t *stop) {
    const pm_truth_model *model = &truth->model;
    const pm_beam_system *system = model->ode.data;
    const pm_beam_mesh *mesh = &system->mesh;
    const int nbody = mesh->nbody, stem = (int)pm_path_stem(path);
    const bool named = system->name != NULL;
    const pm_field_shape shape = {.ntrajectory = count,
                                  .ntime = truth->ntime,
                                  .nnode = mesh->nnode / nbody,
                                  .nvariable = PM_BODY_NVARIABLE,
                                  .nelement = mesh->nelement / nbody,
                                  .contact = named};
    pm_arena arena = {0};
    pm_progress progress;
    pm_status status;
    pm_field **field = pm_arena_array(&arena, (size_t)nbody, sizeof *field);
    const char **own = pm_arena_array(&arena, (size_t)nbody, sizeof *own); // the file of each body
    PM_TRY_DONE(pm_arena_status(&arena, "bodies"));
    for (int k = 0; k < nbody; ++k) {
        PM_TRY_DONE(pm_field_new(&field[k], shape, truth->dt, PM_BODY_VARIABLES));
        pm_beam_describe(system, k, field[k]);
    }
    for (int k = 0; k < nbody; ++k) {
        own[k] =
            !named ? path
                   : pm_arena_printf(&arena, "%.*s_%s%s", stem, path, system->name[k], path + stem);
        PM_TRY_DONE(pm_arena_status(&arena, "paths"));
        PM_TRY_DONE(pm_fields_check(own[k]));
    }
    pm_progress_init(&progress, "truth", count);
    for (int i = 0; i < count && status == PM_OK; ++i) {
        status = *stop ? pm_fail(PM_EINTERRUPTED, "truth: interrupted, nothing written")
                       : pm_beam_run(system, truth->seed, first + i, field, i);
        if (status == PM_OK) {
            pm_progress_update(&progress, i + 1, NULL);
        }
    }
    pm_progress_finish(&progress);
    PM_TRY_DONE(status);
    print_report(nbody, system->name, field);
    const char *seed = pm_arena_printf(&arena, "%llu", (unsigned long long)truth->seed);
    PM_TRY_DONE(pm_arena_status(&arena, "notes"));
    for (int k = 0; k < nbody; ++k) {
        const char *const notes[][2] = {
            {"title", model->title},
            {"source", "portmet-train truth"},
            {"command", command},
            {"parameters", model->parameters},
            {"units", model->units},
            {"seed", seed},
            {"beam", named ? system->name[k] : ""},
            {"placement", named ? system->placement[k] : ""},
        };
        PM_TRY_DONE(pm_field_save(field[k], own[k],
                                  (int)(sizeof notes / sizeof *notes) - (named ? 0 : 2), notes));
        PM_TRY_DONE(pm_xdmf_save(field[k], own[k]));
        printf("wrote %s: %d trajector%s of %d states, %g s apart, %d nodes\n", own[k], count,
               count == 1 ? "y" : "ies", truth->ntime, truth->dt, field[k]->nnode);
    }
done:
    for (int k = 0; k < nbody && field != NULL; ++k) {
        pm_field_free(field[k]);
    }
    pm_arena_free(&arena);
    return status;
}

const pm_truth_simulator pm_body_simulators[] = {{"beam", pm_beam_read, write_fields}, {0}};

// Simulates bodies trajectory by trajectory, prints balances, and saves the fields.
#include "command/truth_body.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/path.h"
#include "base/progress.h"
#include "store/xdmf.h"

// The bodies, their fields and files.
typedef struct simulated_bodies {
    const pm_truth_body *kind;
    pm_field **field;  // [nbody]
    const char **path; // [nbody] of their files
} simulated_bodies;

// --- the balance of energy ---

// Returns the largest |stored + dissipated - work| of a trajectory over its largest work, both
// summed over the bodies. The work is that of loads and contact forces.
static double imbalance(const simulated_bodies *b, int trajectory) {
    double error = 0, work = 0;
    for (int j = 0; j < b->field[0]->ntime; ++j) {
        double sum[2] = {0};
        for (int k = 0; k < b->kind->nbody; ++k) {
            const pm_field *field = b->field[k];
            const int at = trajectory * field->ntime + j;
            const double *energy = field->energy + PM_FIELD_ENERGIES * at;
            sum[0] += energy[0] + energy[1];
            sum[1] += energy[2] + field->contact_work[at];
        }
        error = fmax(error, fabs(sum[0] - sum[1]));
        work = fmax(work, fabs(sum[1]));
    }
    return work > 0 ? error / work : 0;
}

static void print_balance(const simulated_bodies *b) {
    double worst = 0;
    for (int i = 0; i < b->field[0]->ntrajectory; ++i) {
        worst = fmax(worst, imbalance(b, i));
    }
    printf("energy            stored and dissipated differ from the work by %.1e of it at most\n",
           worst);
}

// --- contact ---

// Returns the total contact force on a body at one time, N.
static double contact_size(const pm_field *field, int trajectory, int j) {
    const double *force = pm_field_contact(field, trajectory, j);
    double total[3] = {0};
    for (int i = 0; i < 3 * field->nnode; ++i) {
        total[i % 3] += force[i];
    }
    return sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2]);
}

// Prints how often and how strongly each body is touched.
static void print_contact(const simulated_bodies *b) {
    for (int k = 0; k < b->kind->nbody; ++k) {
        const pm_field *field = b->field[k];
        double largest = 0;
        int touching = 0, states = 0;
        for (int i = 0; i < field->ntrajectory; ++i) {
            int count = 0;
            for (int j = 0; j < field->ntime; ++j) {
                const double size = contact_size(field, i, j);
                largest = fmax(largest, size);
                count += size > 0;
            }
            touching += count > 0;
            states += count;
        }
        printf(
            "contact           %s: in %d of %d trajectories, %.0f %% of the time, %.3g N at most\n",
            b->kind->name[k], touching, field->ntrajectory,
            100.0 * states / (field->ntrajectory * field->ntime), largest);
    }
}

// --- writing ---

static pm_status simulate(const pm_truth *truth, int first, const simulated_bodies *b,
                          const volatile sig_atomic_t *stop) {
    const pm_truth_model *model = &truth->model;
    const int count = b->field[0]->ntrajectory;
    pm_status status = PM_OK;
    pm_progress progress;
    pm_progress_init(&progress, "truth", count);
    for (int i = 0; i < count && status == PM_OK; ++i) {
        status = *stop ? pm_fail(PM_EINTERRUPTED, "truth: interrupted, nothing written")
                       : model->body->run(model->ode.data, truth->seed, first + i, b->field, i);
        if (status == PM_OK) {
            pm_progress_update(&progress, i + 1, NULL);
        }
    }
    pm_progress_finish(&progress);
    return status;
}

// Returns the path of a body's file: FILE.h5 for a body without a name, otherwise FILE_upper.h5.
static const char *path_of(const char *path, const char *name, pm_arena *arena) {
    if (name == NULL) {
        return path;
    }
    const int stem = (int)pm_path_stem(path);
    return pm_arena_printf(arena, "%.*s_%s%s", stem, path, name, path + stem);
}

static pm_status prepare(const pm_truth *truth, int count, const char *path, pm_arena *arena,
                         simulated_bodies *b) {
    const pm_truth_body *kind = b->kind;
    const pm_field_shape shape = {count,           truth->ntime,   kind->nnode,
                                  kind->nvariable, kind->nelement, kind->name != NULL};
    b->field = pm_arena_array(arena, (size_t)kind->nbody, sizeof(pm_field *));
    b->path = pm_arena_array(arena, (size_t)kind->nbody, sizeof(const char *));
    if (b->field == NULL || b->path == NULL) {
        return pm_fail(PM_ENOMEM, "truth: out of memory");
    }
    for (int k = 0; k < kind->nbody; ++k) {
        b->path[k] = path_of(path, kind->name == NULL ? NULL : kind->name[k], arena);
        if (b->path[k] == NULL) {
            return pm_fail(PM_ENOMEM, "truth: out of memory");
        }
        PM_TRY(pm_field_new(&b->field[k], shape, truth->dt, kind->variable));
        kind->describe(truth->model.ode.data, k, b->field[k]);
    }
    return PM_OK;
}

static pm_status save(const pm_truth *truth, const simulated_bodies *b, const char *command) {
    const pm_truth_model *model = &truth->model;
    char seed[32];
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)truth->seed);
    for (int k = 0; k < b->kind->nbody; ++k) {
        const bool named = b->kind->name != NULL;
        const char *const notes[][2] = {
            {"title", model->title},
            {"source", "portmet-train truth"},
            {"command", command},
            {"parameters", model->parameters},
            {"units", model->units},
            {"seed", seed},
            {"beam", named ? b->kind->name[k] : ""},
            {"placement", named ? b->kind->placement[k] : ""},
        };
        const int count = (int)(sizeof notes / sizeof *notes) - (named ? 0 : 2);
        PM_TRY(pm_field_save(b->field[k], b->path[k], count, notes));
        PM_TRY(pm_xdmf_save(b->field[k], b->path[k]));
        printf("wrote %s: %d trajectories of %d states, %g s apart, %d nodes\n", b->path[k],
               b->field[k]->ntrajectory, truth->ntime, truth->dt, b->kind->nnode);
    }
    return PM_OK;
}

pm_status pm_truth_body_write(const pm_truth *truth, int first, int count, const char *command,
                              const char *path, const volatile sig_atomic_t *stop) {
    simulated_bodies b = {.kind = truth->model.body};
    pm_arena arena = {NULL};
    pm_status status;
    PM_TRY_DONE(prepare(truth, count, path, &arena, &b));
    PM_TRY_DONE(simulate(truth, first, &b, stop));
    print_balance(&b);
    if (b.kind->name != NULL) {
        print_contact(&b);
    }
    status = save(truth, &b, command);
done:
    for (int k = 0; k < b.kind->nbody && b.field != NULL; ++k) {
        pm_field_free(b.field[k]);
    }
    pm_arena_free(&arena);
    return status;
}

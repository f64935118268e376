// Writes a proposed training file: head, models, mappings and stages.
#include "propose/propose.h"

#include <math.h>
#include <stdio.h>

#include "propose/decay.h"
#include "propose/propose_draft.h"
#include "propose/temperature.h"

// Bounds on the substep times the fastest rate of change: in the last stage, and in a scene that
// resolves its dynamics.
#define FINE 0.25
#define RESOLVED 0.5
// Bounds on the substep times the fastest decay, likewise. Explicit integrators are unstable beyond
// 2 to 2.8, and the estimate of the decay may be too small.
#define DECAYS 1.0
#define STABLE 2.0
// The most iterations on derivatives and on steps. A stage ends sooner when it makes no more
// progress.
#define DERIVATIVE_ITERATIONS 240
#define STEP_ITERATIONS 60
// The samples in a batch, and the work of an iteration, in samples times substeps times variables,
// up to which there are more iterations, at most MOST_TIMES as many.
#define DERIVATIVE_BATCH 8192
#define DERIVATIVE_WORK 20000
#define STEP_BATCH 2048
#define STEP_WORK 40000
#define MOST_TIMES 4

// Returns the number of substeps, at least 1, such that a substep times the fastest rate of change
// is at most `turn`, and times the fastest decay at most `decay`.
static double substeps_for(const pm_draft *d, double turn, double decay) {
    const double dt = d->p->scene->dt;
    return fmax(1, ceil(fmax(d->look.fastest * dt / turn, d->decay * dt / decay)));
}

static void write_head(const pm_draft *d) {
    FILE *f = d->file;
    const pm_dataset *data = d->p->dataset;
    static const char *const forms[] = {"hard: both laws hold by construction",
                                        "soft: the degeneracies are a penalty",
                                        "free: no structure at all, a baseline"};
    fprintf(
        f,
        "# Proposed by portmet-train propose from the units, the ports and %d trajectories of %d "
        "states,\n# %g s apart. Form %s.\n",
        data->ntrajectory, data->ntime, data->dt, forms[d->p->form]);
    fprintf(f, "# The fastest rate changes by a factor of %.3g per s, %.3g per step of %g s. ",
            d->look.fastest, d->look.fastest * d->p->scene->dt, d->p->scene->dt);
    if (d->decay > 0) {
        fprintf(f, "Deviations decay by a rate of up to\n# %.3g per s, %.3g per step. ", d->decay,
                d->decay * d->p->scene->dt);
    }
    const double wanted = substeps_for(d, RESOLVED, STABLE);
    fprintf(f, "%s of the scene has %d substeps;\n# %s.\n", d->p->scene->integrator->name,
            d->p->scene->substeps,
            wanted <= d->p->scene->substeps
                ? "that is enough"
                : "MORE are needed, such that a substep changes a rate by at most 0.5, and that a "
                  "decay is at most 2 per substep");
    if (d->rotates) {
        fprintf(f,
                "# %s. Nothing depends on directions, so that energies "
                "depend on the lengths of vectors.\n",
                d->rotates == PM_ROTATION_CONSERVED
                    ? "The sum of q x p is conserved"
                    : "Friction and boundary inputs alone change the sum of q x p");
    }
    fprintf(f, "scene: %s\n", d->p->scene_path);
    fprintf(f, "data: {file: %s}   # every fifth trajectory is kept back for validation\n",
            d->p->data_path);
    fprintf(f, "seed: 1\n\nmodels:\n");
}

// Returns the number of substeps for training, but no more than the scene has.
static int training_substeps(const pm_draft *d) {
    const double wanted = substeps_for(d, FINE, DECAYS);
    const int most = d->p->scene->substeps;
    return wanted < most ? (int)wanted : most;
}

// Returns the most iterations of a stage: the more, the less work each of them is.
static int iterations_of(const pm_draft *d, int fewest, int batch, int substeps, double little) {
    const int samples = d->look.samples < batch ? d->look.samples : batch;
    const double work = (double)samples * substeps * d->p->scene->nz;
    return (int)(fewest * fmin(fmax(little / work, 1), MOST_TIMES));
}

// Derivatives take all samples at once where there are not too many. A random batch lacks most of
// the rare states, and the step that is best for it is not the best one for all.
static void write_stages(const pm_draft *d) {
    FILE *f = d->file;
    fputs(d->p->form == PM_FREE
              ? "# A network alone needs no choice of initial weights. It is fitted to "
                "derivatives, then to single "
                "steps.\nstart: {tries: 1}\n"
              : "# Several initial weights are tried on derivatives. The best one is fitted to "
                "derivatives "
                "further,\n# then to single steps.\n",
          f);
    fprintf(f, "loss: {residual: step}\nstages:\n");
    fprintf(f, "  - {optimiser: gauss_newton, iterations: %d, batch: %d, residual: derivative}\n",
            iterations_of(d, DERIVATIVE_ITERATIONS, DERIVATIVE_BATCH, 1, DERIVATIVE_WORK),
            DERIVATIVE_BATCH);
    const int substeps = training_substeps(d);
    fprintf(
        f, "  - {optimiser: gauss_newton, iterations: %d, batch: %d, substeps: %d, robust: 20}\n",
        iterations_of(d, STEP_ITERATIONS, STEP_BATCH, substeps, STEP_WORK), STEP_BATCH, substeps);
}

static void write_all(const pm_draft *d) {
    const pm_scene *scene = d->p->scene;
    write_head(d);
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (scene->subsystem[i].model == NULL) {
            pm_draft_part(d, &d->part[i]);
        }
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (scene->port[i].model == NULL) {
            pm_draft_port(d, i);
        }
    }
    pm_draft_list l = {.file = d->file};
    fprintf(d->file, "\nsubsystems: {");
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const char *name = scene->subsystem[i].name;
        if (scene->subsystem[i].model == NULL) {
            fprintf(d->file, "%s%s: %s", l.count++ > 0 ? ", " : "", name, name);
        }
    }
    l.count = 0;
    fprintf(d->file, "}\nports: {");
    for (int i = 0; i < scene->nport; ++i) {
        const char *name = scene->port[i].name;
        if (scene->port[i].model == NULL) {
            fprintf(d->file, "%s%s: %s", l.count++ > 0 ? ", " : "", name, name);
        }
    }
    fprintf(d->file, "}\n\n");
    write_stages(d);
}

pm_status pm_propose(const pm_proposal *p, const char *path) {
    pm_draft d = {.p = p, .width = p->scene->nsubsystem > 2 ? 12 : 16};
    PM_TRY(pm_look_make(&d.look, p->scene, p->dataset));
    pm_status status = PM_OK;
    d.part = pm_arena_array(&d.look.arena, (size_t)p->scene->nsubsystem, sizeof *d.part);
    d.temperature = pm_arena_array(&d.look.arena, (size_t)p->scene->nz, sizeof *d.temperature);
    const bool memory = d.part != NULL && d.temperature != NULL;
    d.file = memory ? fopen(path, "w") : NULL;
    if (d.file == NULL) {
        status = !memory ? pm_fail(PM_ENOMEM, "out of memory for a proposal")
                         : pm_fail(PM_EFILE, "%s: cannot be written", path);
    } else {
        d.decay = pm_look_decay(&d.look);
        pm_view_parts(&d.look, d.part);
        d.rotates = pm_view_rotation(&d.look, d.part);
        pm_look_temperatures(&d.look, d.part, d.temperature);
        write_all(&d);
        const bool failed = ferror(d.file) != 0;
        status = fclose(d.file) == 0 && !failed ? PM_OK
                                                : pm_fail(PM_EFILE, "%s: cannot be written", path);
    }
    pm_look_free(&d.look);
    return status;
}

// Writes a proposed training file: head, models, mappings and stages; and the scene of a model
// without structure.
#include "propose/propose.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/path.h"
#include "base/unit.h"
#include "data/unit_change.h"
#include "propose/draft.h"
#include "store/yaml.h"

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
#define DERIVATIVE_ITERATIONS 500
#define STEP_ITERATIONS 240
#define TRY_ITERATIONS 40 // of each draw of the first weights: fewer leave some of them astray
// Samples of an iteration. Larger batches take longer and lead no further; small ones lack the rare
// states.
#define DERIVATIVE_BATCH 2048
#define STEP_BATCH 1024
// Median residuals beyond which a sample of a step counts less, so that few bad ones do not decide.
#define ROBUST 20

// Closes a file. PM_EFILE: it could not be opened (NULL) or written.
static pm_status close_file(FILE *file, const char *path) {
    const bool failed = file == NULL || ferror(file) != 0;
    return file != NULL && fclose(file) == 0 && !failed
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

// Returns the number of substeps, at least 1, such that a substep times the fastest rate of change
// is at most `turn`, and times the fastest decay at most `decay`.
static double substeps_for(const pm_draft *d, double turn, double decay) {
    const double dt = d->p->scene->physics.dt;
    return fmax(1, ceil(fmax(d->look.fastest * dt / turn, d->look.decay * dt / decay)));
}

// Writes the training file of a vector of hypotheses: what the data show, the models, who has them,
// and the stages. `context` is the draft.
static pm_status write_vector(void *context, const int *chosen, const char *comment,
                              const char *path) {
    pm_draft *d = context;
    FILE *f = NULL;
    PM_TRY(pm_files_create(&f, path, PM_PROPOSED));
    d->chosen = chosen;
    d->file = f;
    const pm_physics *physics = &d->p->scene->physics;
    const pm_dataset *data = d->p->dataset;
    static const char *const forms[] = {"hard: both laws hold by construction",
                                        "soft: the degeneracies are a penalty",
                                        "free: no structure at all, a baseline"};
    fprintf(f,
            PM_PROPOSED " from the units, the ports and %d trajector%s of %d "
                        "states,\n# %g s apart. Form %s.\n",
            data->ntrajectory, data->ntrajectory == 1 ? "y" : "ies", data->ntime, data->dt,
            forms[d->p->form]);
    fprintf(f, "# The fastest rate changes by a factor of %.3g per s, %.3g per step of %g s. ",
            d->look.fastest, d->look.fastest * physics->dt, physics->dt);
    if (d->look.decay > 0) {
        fprintf(f, "Deviations decay by a rate of up to\n# %.3g per s, %.3g per step. ",
                d->look.decay, d->look.decay * physics->dt);
    }
    const double wanted = substeps_for(d, RESOLVED, STABLE);
    fprintf(f, "%s of the scene has %d substeps;\n# %s.\n", physics->integrator->name,
            physics->substeps,
            wanted <= physics->substeps
                ? "that is enough"
                : "MORE are needed, such that a substep changes a rate by at most 0.5, and that a "
                  "decay is at most 2 per substep");
    if (d->rotates) {
        bool lengths = true;
        for (int i = 0; i < physics->nsubsystem; ++i) {
            lengths = lengths && pm_draft_answer(d, PM_ASK_ENERGY, i) == PM_AS_FOUND;
        }
        fprintf(f, "# %s%s.\n",
                d->rotates == PM_ROTATION_CONSERVED
                    ? "The sum of q x p is conserved"
                    : "Friction and boundary inputs alone change the sum of q x p",
                lengths ? ", so that energies depend on the lengths of vectors" : "");
    }
    if (d->free_scale) {
        fprintf(f, "# The data do not fix the scale of energies, temperatures and powers. Training "
                   "starts at 300 K;\n# `temperature:` beside the features of each heat sets "
                   "another one.\n");
    }
    fputs(comment, f);
    char named[2][PATH_MAX];
    fprintf(f, "scene: \"%s\"\ndata: {file: \"%s\"",
            pm_path_seen_from(path, d->p->scene_path, named[0]),
            pm_path_seen_from(path, d->p->data_path, named[1]));
    if (d->p->trajectories != NULL) {
        fprintf(f, ", trajectories: \"%s\"", d->p->trajectories);
    }
    if (d->p->validation != NULL) {
        fprintf(f, ", validation: \"%s\"}\n", d->p->validation);
    } else {
        fprintf(f, "}   # every fifth trajectory is kept back for validation\n");
    }
    fprintf(f, "seed: 1\n\nmodels:\n");
    for (int i = 0; i < physics->nsubsystem; ++i) {
        if (physics->subsystem[i].model == NULL) {
            pm_draft_part(d, &d->part[i]);
        }
    }
    for (int i = 0; i < physics->nport; ++i) {
        if (physics->port[i].model == NULL) {
            pm_draft_port(d, i);
        }
    }
    fprintf(f, "\nsubsystems: {");
    for (int i = 0, n = 0; i < physics->nsubsystem; ++i) {
        const char *name = physics->subsystem[i].name;
        if (physics->subsystem[i].model == NULL) {
            fprintf(f, "%s%s: %s", n++ > 0 ? ", " : "", name, name);
        }
    }
    fprintf(f, "}\nports: {");
    for (int i = 0, n = 0; i < physics->nport; ++i) {
        const char *name = physics->port[i].name;
        if (physics->port[i].model == NULL) {
            fprintf(f, "%s%s: %s", n++ > 0 ? ", " : "", name, name);
        }
    }
    fprintf(f, "}\n\n");
    fputs(d->p->form == PM_FREE
              ? "# A network alone needs no choice of initial weights. It is fitted to "
                "derivatives, then to single "
                "steps.\nstart: {tries: 1}\n"
          : d->start != NULL
              ? "# The fit starts with the weights that a short fit has left in a file, and draws "
                "others if they\n# are bad. It fits derivatives, then single steps.\n"
              : "# Several initial weights are tried on derivatives. The best one is fitted to "
                "derivatives "
                "further,\n# then to single steps.\n",
          f);
    if (d->start != NULL) {
        fprintf(f, "start: {from: \"%s\", iterations: %d}\n", d->start, TRY_ITERATIONS);
    } else if (d->p->form != PM_FREE) {
        fprintf(f, "start: {iterations: %d}\n", TRY_ITERATIONS);
    }
    fprintf(f, "loss: {residual: step}\nstages:\n");
    fprintf(f, "  - {optimiser: gauss_newton, iterations: %d, batch: %d, residual: derivative}\n",
            DERIVATIVE_ITERATIONS, DERIVATIVE_BATCH);
    // As fine as training needs, but no finer than the scene.
    const double fine = substeps_for(d, FINE, DECAYS);
    const int most = physics->substeps, substeps = fine < most ? (int)fine : most;
    fprintf(f,
            "  - {optimiser: gauss_newton, iterations: %d, batch: %d, substeps: %d, robust: %d}\n",
            STEP_ITERATIONS, STEP_BATCH, substeps, ROBUST);
    return close_file(d->file, path);
}

pm_status pm_propose(const pm_proposal *p, const char *path) {
    const pm_physics *physics = &p->scene->physics;
    pm_draft d = {.p = p};
    PM_TRY(pm_look_make(&d.look, p->scene, p->dataset));
    pm_arena *arena = &d.look.arena;
    d.part = pm_arena_array(arena, (size_t)physics->nsubsystem, sizeof *d.part);
    d.asked =
        pm_arena_array(arena, (size_t)(physics->nsubsystem + physics->nport), sizeof *d.asked);
    pm_status status = pm_arena_status(arena, "a proposal");
    if (status == PM_OK) {
        d.rotates = pm_view_parts(&d.look, d.part);
        pm_draft_ask(&d);
        d.space.write = write_vector;
        d.space.context = &d;
        d.space.start = &d.start;
        const pm_search_how how = {.budget = p->budget,
                                   .most = PM_SEARCH_SLOW * p->budget,
                                   .loud = p->loud,
                                   .stop = p->stop};
        status = pm_search_run(&d.space, &how, path, NULL);
    }
    pm_look_free(&d.look);
    return status;
}

// --- scenes without structure ---

pm_status pm_propose_scene(const char *from, const char *path) {
    FILE *in = fopen(from, "r"), *out = NULL;
    if (in == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", from, strerror(errno));
    }
    pm_status status = pm_files_create(&out, path, NULL);
    if (status != PM_OK) {
        fclose(in);
        return status;
    }
    char *line = NULL;
    size_t size = 0;
    fprintf(out, "# %s with ports of the law exchange, for models in the form free.\n", from);
    while (getline(&line, &size, in) > 0) {
        const char *law = strstr(line, "law: bracket");
        if (law != NULL) {
            fprintf(out, "%.*slaw: exchange%s", (int)(law - line), line,
                    law + strlen("law: bracket"));
        } else {
            fputs(line, out);
        }
    }
    free(line);
    const bool failed = ferror(in) != 0;
    fclose(in);
    status = close_file(out, path);
    return failed ? pm_fail(PM_EFILE, "%s: cannot be read", from) : status;
}

// Writes all groups of boundary inputs that follow columns as one input, which acts on everything,
// and returns how many there are. Without a file it only counts them.
static int write_outside(FILE *file, const pm_physics *physics) {
    static const char *const key[] = {"value", "dE", "dS"};
    int count = 0;
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *input = &physics->boundary_input[i];
        for (int g = 0; g < input->layout.ngroup; ++g) {
            const pm_group *group = &input->layout.group[g];
            if (!pm_draft_follows(input, group, 0) && !pm_draft_follows(input, group, 1)) {
                continue;
            }
            const pm_scene_prescribed *hold = &input->value[group->first];
            if (file != NULL) {
                fprintf(file, "%s    %s_%s: {unit: \"%s\"",
                        count == 0 ? "boundary_inputs:\n  outside:\n" : "", input->name,
                        group->name, group->unit);
            }
            for (int k = 0; k < 2 && file != NULL; ++k) {
                fprintf(file, ", %s: [", key[k]);
                for (int c = 0; c < group->size; ++c) {
                    const pm_scene_prescribed *value =
                        &input->value[k * input->layout.nz + group->first + c];
                    hold = value->column == NULL ? hold : value;
                    if (value->column == NULL) {
                        fprintf(file, "%s%.17g", c > 0 ? ", " : "", value->number);
                    } else {
                        fprintf(file, "%s\"%s\"", c > 0 ? ", " : "", value->column);
                    }
                }
                fputs("]", file);
            }
            if (file != NULL) {
                fprintf(file, ", hold: %s}\n", pm_hold_names[hold->hold]);
            }
            ++count;
        }
    }
    return count;
}

bool pm_propose_fits_one(const pm_scene *scene) {
    int count = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        count += scene->physics.subsystem[i].layout.ngroup;
    }
    return count <= PM_MAX_GROUPS && write_outside(NULL, &scene->physics) <= PM_MAX_GROUPS;
}

// Writes the port through which the outside acts on the one subsystem.
static void write_outside_port(FILE *file, const pm_physics *physics) {
    fputs("ports:\n  inputs:\n    law: exchange\n    between: [all, outside]\n"
          "    weights: weights/inputs.h5\n    expose:\n      all: [",
          file);
    for (int i = 0, n = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &physics->subsystem[i];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            fprintf(file, "%s%s_%s", n++ > 0 ? ", " : "", subsystem->name,
                    subsystem->layout.group[g].name);
        }
    }
    fputs("]\n      outside: [", file);
    for (int i = 0, n = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *input = &physics->boundary_input[i];
        for (int g = 0; g < input->layout.ngroup; ++g) {
            const pm_group *group = &input->layout.group[g];
            if (pm_draft_follows(input, group, 0) || pm_draft_follows(input, group, 1)) {
                fprintf(file, "%s%s_%s", n++ > 0 ? ", " : "", input->name, group->name);
            }
        }
    }
    fputs("]\n", file);
}

pm_status pm_propose_scene_of_one(const pm_scene *scene, const char *path) {
    // A model of the form free has no energy, which some methods need.
    const pm_integrator *own = scene->physics.integrator;
    const bool needs_energy = pm_integrator_keeps_energy(own);
    FILE *file = NULL;
    PM_TRY(pm_files_create(&file, path, NULL));
    fprintf(file,
            "# %s as one subsystem, for models without structure.\n"
            "scene: %s\n",
            scene->path, scene->name);
    if (scene->system != NULL) {
        fprintf(file, "system: \"%s\"\n", scene->system);
    }
    fprintf(file,
            "time: {dt: %.17g, steps: %d, integrator: %s, substeps: %d}\n"
            "subsystems:\n"
            "  all:\n"
            "    weights: weights/all.h5\n"
            "    state:\n",
            scene->physics.dt, scene->run.steps, needs_energy ? "rk4" : own->name,
            scene->physics.substeps);
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            fprintf(file, "      %s_%s: {unit: \"%s\", columns: [", subsystem->name, group->name,
                    group->unit);
            for (int c = 0; c < group->size; ++c) {
                fprintf(file, "%s\"%s\"", c > 0 ? ", " : "", subsystem->column[group->first + c]);
            }
            fputs("]}\n", file);
        }
    }
    if (write_outside(file, &scene->physics) > 0) {
        write_outside_port(file, &scene->physics);
    }
    return close_file(file, path);
}
// --- files ---

static pm_status write_proposal(const char *scene_path, const char *data, const pm_proposal *how,
                                const char *output) {
    pm_scene *scene = NULL;
    pm_dataset *dataset = NULL;
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, scene_path));
    for (int i = 0; i < scene->physics.nsubsystem && how->form != PM_FREE; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        for (int g = 0; g < s->layout.ngroup; ++g) {
            if (s->layout.group[g].coenergy) {
                status = pm_fail(PM_ECONFIG,
                                 "%s: %s.%s holds a co-energy: models for such states are proposed "
                                 "from the data alone, without a scene",
                                 s->group_at[g], s->name, s->layout.group[g].name);
                goto done;
            }
        }
    }
    PM_TRY_DONE(pm_dataset_load(&dataset, data));
    PM_TRY_DONE(pm_files_check_output(output, PM_PROPOSED)); // before the search, which takes time
    PM_TRY_DONE(pm_unit_change_apply(scene, dataset, true));
    pm_proposal proposal = *how;
    proposal.scene = scene;
    proposal.dataset = dataset;
    proposal.scene_path = scene_path;
    proposal.data_path = data;
    PM_TRY_DONE(pm_propose(&proposal, output));
    // A group whose unit is not known gets no role.
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            if (!pm_unit_parse(group->unit).known) {
                printf("%s.%s: the unit \"%s\" is not known, so that the proposal cannot tell what "
                       "the "
                       "group is. SI units with prefixes are known, such as kg m/s, mm or kJ/K.\n",
                       subsystem->name, group->name, group->unit);
            }
        }
    }
    printf("wrote %s\n", output);
done:
    pm_dataset_free(dataset);
    pm_scene_free(scene);
    return status;
}

pm_status pm_propose_files(const char *scene, const char *data, const pm_proposal *how,
                           const char *output) {
    if (how->form != PM_FREE) {
        return write_proposal(scene, data, how, output);
    }
    char exchange[PATH_MAX];
    const int length =
        snprintf(exchange, sizeof exchange, "%.*s_scene.yaml", (int)pm_path_stem(output), output);
    if (length >= (int)sizeof exchange) {
        return pm_fail(PM_EUSAGE, "%s: the path is too long", output);
    }
    // A black box has all groups in one subsystem where that is possible. Otherwise the scene keeps
    // its subsystems, and its ports have the law exchange.
    pm_scene *own = NULL;
    PM_TRY(pm_scene_load(&own, scene));
    const pm_status status = pm_propose_fits_one(own) ? pm_propose_scene_of_one(own, exchange)
                                                      : pm_propose_scene(scene, exchange);
    pm_scene_free(own);
    PM_TRY(status);
    printf("wrote %s\n", exchange);
    return write_proposal(exchange, data, how, output);
}

bool pm_propose_is_scene(const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    if (pm_yaml_open(&document, path, &root) != PM_OK) {
        return false; // the reader of the file reports the error
    }
    const bool scene = pm_yaml_exists(pm_yaml_get(root, "time"));
    pm_yaml_close(document);
    return scene;
}

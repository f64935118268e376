// Rolls out trajectories in several threads. Each thread has its own copy of the simulation
// (sim/monolithic.h) and takes the next trajectory, so that results do not depend on their number.
#include "evaluate/evaluate.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "base/progress.h"
#include "base/unit.h"
#include "graph/program.h"
#include "model/solid/solid.h"
#include "sim/monolithic.h"

// Relative. The scene has dt as decimal text, the dataset as a double.
#define DT_TOLERANCE 1e-9
#define TEMPERATURES 10   // the approximate number of states of a trajectory with temperatures
#define MOST_ENTROPIES 16 // a field with more components than this has no temperatures
#define MOST_THREADS 64

// --- the models of a thread ---

// The stored energy of a solid (model/solid/solid.h) depends on its inner variables: a body that
// was bent some time ago stores less than one that was bent just now. Where the dataset does not
// have them, they follow from the displacements of all states before, by the learned relaxation of
// the material.
typedef struct inner_body {
    int u, inner; // first components in the concatenated state
    pm_solid_material material;
    pm_solid *solid;
} inner_body;

// A thread and its objects.
typedef struct worker {
    const pm_evaluation *e;
    pm_arena arena;
    pm_monolithic *assembly;
    pm_boundary_input boundary_input;
    int nbody;
    inner_body *body; // [nbody] solids whose inner variables the dataset does not have
    // [nsubsystem] the graph of dE of the subsystems that own a model with an entropy, and its
    // input; else NULL
    pm_program **coenergy;
    double **z_in;
    double **dE; // [nsubsystem] its output, or the constant dE of a solid
    double *z;   // [nz] work space
} worker;

static bool has_temperature(const pm_group *group) {
    return group->role == PM_ROLE_ENTROPY && group->size <= MOST_ENTROPIES;
}

// Opens a body for each solid whose inner variables are no columns, and the graph of dE for each
// model that has an entropy. A solid has no graph.
static pm_status open_models(worker *w) {
    const pm_system *system = w->e->system;
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        const pm_part *part = system->part[i];
        const int first = system->scene->physics.subsystem[i].first;
        if (pm_part_kind_of(part) == PM_PART_SOLID) {
            const pm_group *group = pm_layout_find(&part->layout, "inner");
            if (group != NULL && w->e->columns.column[first + group->first] < 0) {
                inner_body *b = &w->body[w->nbody++];
                b->u = first + pm_layout_find(&part->layout, "u")->first;
                b->inner = first + group->first;
                pm_solid_material_read(part->spec.solid, &part->params, &b->material);
                PM_TRY(pm_solid_open(&b->solid, system->mesh[i], &b->material));
            }
            w->dE[i] = pm_arena_array(&w->arena, (size_t)part->layout.nz, sizeof(double));
            PM_TRY(pm_arena_status(&w->arena, "an evaluation"));
            for (int c = 0; c < part->layout.nz; ++c) { // only those of entropies are asked for
                w->dE[i][c] = part->spec.solid->temperature;
            }
            continue;
        }
        bool wanted = false;
        for (int k = 0; k < part->layout.ngroup; ++k) {
            wanted = wanted || has_temperature(&part->layout.group[k]);
        }
        if (!wanted || system->owner[i] != i) {
            continue;
        }
        pm_graph *g = NULL;
        PM_TRY(pm_graph_open(&g));
        const pm_node z = pm_input(g, true, 1, part->layout.nz);
        pm_node dE, dS;
        pm_status status = PM_OK;
        pm_part_coenergies(g, part, PM_NO_NODE, z, &dE, &dS);
        if (dE != PM_NO_NODE) {
            dE = pm_broadcast_to(g, dE, (pm_shape){true, 1, part->layout.nz});
            status = pm_program_open(&w->coenergy[i], g, 1, &dE, 1);
        }
        pm_graph_close(g);
        PM_TRY(status);
        if (dE != PM_NO_NODE) {
            w->z_in[i] = pm_program_value(w->coenergy[i], z);
            w->dE[i] = pm_program_value(w->coenergy[i], dE);
        }
    }
    return PM_OK;
}

// Takes the temperatures dE/ds at the state z into the range of the rollout, in K for any unit of
// s, or of T where the state holds T itself. They are exact: dE is a graph.
static void take_temperatures(const worker *w, pm_rollout *rollout, const double *z) {
    const pm_system *system = w->e->system;
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &system->scene->physics.subsystem[i];
        const int owner = w->dE[i] != NULL ? i : system->owner[i];
        if (w->coenergy[owner] != NULL) {
            memcpy(w->z_in[owner], z + s->first, (size_t)s->layout.nz * sizeof *z);
            pm_program_run(w->coenergy[owner], 1);
        }
        for (int g = 0; g < s->layout.ngroup; ++g) {
            const pm_group *group = &s->layout.group[g];
            const double unit = pm_unit_parse(group->unit).factor; // J/K, or K
            for (int c = 0; c < group->size && has_temperature(group); ++c) {
                const double dE = w->dE[owner] == NULL ? 0 : w->dE[owner][group->first + c];
                const double T = group->coenergy ? dE * unit : dE / unit;
                const bool first = rollout->coldest == 0 && rollout->warmest == 0;
                rollout->coldest = first ? T : fmin(rollout->coldest, T);
                rollout->warmest = first ? T : fmax(rollout->warmest, T);
            }
        }
    }
}

// --- one rollout ---

// Enters the state reached in the ledger.
static void book(pm_rollout *rollout, pm_monolithic *assembly) {
    pm_sample sample = *pm_monolithic_sample(assembly);
    memcpy(rollout->nout_of_range, sample.outside,
           (size_t)rollout->ledger.system->scene->physics.nsubsystem *
               sizeof *rollout->nout_of_range);
    if (pm_ledger_add_sample(&rollout->ledger, &sample) != PM_OK && rollout->violation[0] == 0) {
        snprintf(rollout->violation, sizeof rollout->violation, "trajectory %d: %.200s",
                 rollout->trajectory, pm_error());
    }
}

// Stores energy and entropy of the subsystems in one state, predicted (which = 0) or true (1).
static void keep_parts(const pm_evaluation *e, pm_rollout *rollout, int which, int j,
                       const pm_sample *sample) {
    const size_t n = (size_t)e->system->scene->physics.nsubsystem;
    const size_t at = ((size_t)which * (size_t)e->truth->ntime + (size_t)j) * n;
    memcpy(rollout->part_energy + at, sample->energy, n * sizeof(double));
    memcpy(rollout->part_entropy + at, sample->entropy, n * sizeof(double));
}

// Stores the predicted state. Columns that the scene does not predict, such as boundary inputs,
// keep their data.
static void keep_state(const worker *w, pm_rollout *rollout, int index) {
    const pm_evaluation *e = w->e;
    const pm_sample *sample = pm_monolithic_sample(w->assembly);
    const int j = rollout->reached++;
    double *row = pm_dataset_state(e->predicted, index, j);
    memcpy(row, pm_dataset_state(e->truth, rollout->trajectory, j),
           (size_t)e->truth->ncolumn * sizeof *row);
    pm_columns_to_row(&e->columns, sample->z, row);
    rollout->energy[j] = rollout->ledger.energy;
    rollout->entropy[j] = rollout->ledger.entropy;
    keep_parts(e, rollout, 0, j, sample);
}

// Rolls out one trajectory.
static void roll(worker *w, int index) {
    const pm_evaluation *e = w->e;
    pm_rollout *rollout = &e->rollout[index];
    const int ngroup = e->columns.ngroup, trajectory = rollout->trajectory;
    const int ntime = rollout->length;
    pm_boundary_input_follow(&w->boundary_input, e->inputs, e->inputs_of[index]);
    pm_monolithic_set_boundary_input(w->assembly, &w->boundary_input);
    // Energies, entropies and temperatures in the true states.
    for (int j = 0; j < ntime && pm_system_without_energy(e->system) < 0; ++j) {
        pm_columns_to_state(&e->columns, pm_dataset_state(e->truth, trajectory, j), w->z);
        for (int i = 0; i < w->nbody; ++i) { // writes the inner variables to their places
            const inner_body *b = &w->body[i];
            if (j == 0) {
                pm_solid_set_state(b->solid, w->z + b->u, w->z + b->inner);
            } else { // they stay where the displacements turn an element inside out
                pm_solid_follow(b->solid, e->truth->dt, w->z + b->u, NULL);
                memcpy(w->z + b->inner, pm_solid_inner(b->solid),
                       (size_t)pm_solid_ninner(b->solid) * sizeof *w->z);
            }
        }
        pm_monolithic_set_state(w->assembly, w->z);
        keep_parts(e, rollout, 1, j, pm_monolithic_sample(w->assembly));
        if (j % (ntime / TEMPERATURES + 1) == 0) {
            take_temperatures(w, rollout, w->z);
        }
    }
    // The rollout from the first state. Its last state is repeated up to the end.
    pm_columns_to_state(&e->columns, pm_dataset_state(e->truth, trajectory, 0), w->z);
    pm_monolithic_set_state(w->assembly, w->z);
    pm_ledger_init(&rollout->ledger, e->system);
    book(rollout, w->assembly);
    keep_state(w, rollout, index);
    for (bool finite = true; finite && rollout->reached < ntime;) {
        for (int i = 0; i < e->stride && finite; ++i) {
            const double before = pm_clock();
            finite = pm_monolithic_step(w->assembly) == PM_OK;
            if (finite) {
                rollout->seconds_per_step += pm_clock() - before;
                book(rollout, w->assembly);
            }
        }
        if (finite) {
            keep_state(w, rollout, index);
        }
    }
    for (int i = rollout->reached; i < e->truth->ntime; ++i) {
        memcpy(pm_dataset_state(e->predicted, index, i),
               i < ntime ? pm_dataset_state(e->predicted, index, i - 1)
                         : pm_dataset_state(e->truth, trajectory, i),
               (size_t)e->truth->ncolumn * sizeof(double));
    }
    const long steps = rollout->ledger.steps;
    rollout->seconds_per_step /= steps > 0 ? (double)steps : 1;
    // Errors are infinite from the first state on that is not finite.
    pm_score(&e->columns, ntime, e->truth->ncolumn, pm_dataset_state(e->predicted, index, 0),
             pm_dataset_state(e->truth, trajectory, 0), rollout->error, rollout->snapshot);
    for (int i = 0; i < ngroup; ++i) {
        if (rollout->reached < ntime || isnan(rollout->error[i])) {
            rollout->error[i] = INFINITY;
        }
    }
    for (int i = 0; i < ntime * ngroup; ++i) {
        if (i >= rollout->reached * ngroup || isnan(rollout->snapshot[i])) {
            rollout->snapshot[i] = INFINITY;
        }
    }
}

// --- all rollouts ---

typedef struct pool {
    pm_evaluation *evaluation;
    const pm_evaluate_how *how;
    pthread_mutex_t lock; // protects the members below
    int next, done;
    pm_status status; // the first failure, with its description
    char error[512];
} pool;

// Returns the next rollout, or -1.
static int take(pool *p) {
    pthread_mutex_lock(&p->lock);
    if (p->how->stop != NULL && *p->how->stop && p->status == PM_OK) {
        p->status = PM_EINTERRUPTED;
        snprintf(p->error, sizeof p->error, "evaluate: interrupted");
    }
    const bool more = p->status == PM_OK && p->next < p->evaluation->count;
    const int index = more ? p->next++ : -1;
    pthread_mutex_unlock(&p->lock);
    return index;
}

static void *work(void *context) {
    pool *p = context;
    const pm_system *system = p->evaluation->system;
    const size_t n = (size_t)system->scene->physics.nsubsystem;
    worker w = {.e = p->evaluation};
    w.z = pm_arena_array(&w.arena, (size_t)system->scene->physics.nz, sizeof *w.z);
    w.body = pm_arena_array(&w.arena, n, sizeof *w.body);
    w.coenergy = pm_arena_array(&w.arena, n, sizeof(pm_program *));
    w.z_in = pm_arena_array(&w.arena, n, sizeof(double *));
    w.dE = pm_arena_array(&w.arena, n, sizeof(double *));
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&w.arena, "an evaluation"));
    PM_TRY_DONE(pm_boundary_input_bind(&w.boundary_input, system->scene, w.e->inputs,
                                       w.e->inputs == w.e->truth
                                           ? w.e->stride
                                           : pm_boundary_input_stride(system->scene, w.e->inputs),
                                       &w.arena));
    PM_TRY_DONE(open_models(&w));
    PM_TRY_DONE(pm_monolithic_open(&w.assembly, system));
    for (int index = take(p); index >= 0; index = take(p)) {
        roll(&w, index);
        pthread_mutex_lock(&p->lock);
        ++p->done;
        if (p->how->progress != NULL) {
            p->how->progress(p->how->context, p->done);
        }
        pthread_mutex_unlock(&p->lock);
    }
done:
    if (status != PM_OK) {
        pthread_mutex_lock(&p->lock);
        if (p->status == PM_OK) {
            p->status = status;
            snprintf(p->error, sizeof p->error, "%s", pm_error());
        }
        pthread_mutex_unlock(&p->lock);
    }
    pm_monolithic_close(w.assembly);
    for (size_t i = 0; i < n && w.coenergy != NULL; ++i) {
        pm_program_close(w.coenergy[i]);
    }
    for (int i = 0; i < w.nbody; ++i) {
        pm_solid_close(w.body[i].solid);
    }
    pm_arena_free(&w.arena);
    return NULL;
}

// The calling thread works as well, so that the evaluation succeeds if no thread can be started.
static pm_status run_pool(pm_evaluation *e, const pm_evaluate_how *how) {
    pthread_t thread[MOST_THREADS];
    pool p = {.evaluation = e, .how = how};
    pthread_mutex_init(&p.lock, NULL);
    int started = 0;
    while (started < how->threads - 1 && started < MOST_THREADS && started < e->count - 1 &&
           pthread_create(&thread[started], NULL, work, &p) == 0) {
        ++started;
    }
    work(&p);
    for (int i = 0; i < started; ++i) {
        pthread_join(thread[i], NULL);
    }
    pthread_mutex_destroy(&p.lock);
    return p.status == PM_OK ? PM_OK : pm_fail(p.status, "%s", p.error);
}

pm_status pm_evaluation_new(pm_evaluation **evaluation, const pm_system *system,
                            const pm_dataset *truth, int count, const int *which) {
    const pm_scene *scene = system->scene;
    const double ratio = truth->dt / scene->physics.dt, whole = round(ratio);
    if (truth->ntime < 2) {
        return pm_fail(PM_EDATA, "evaluate: a trajectory of %d states leaves nothing to predict",
                       truth->ntime);
    }
    if (!(whole >= 1 && whole < 1e6 && fabs(ratio - whole) <= DT_TOLERANCE * whole)) {
        return pm_fail(PM_EDATA,
                       "%s: dt is %.12g s, and the dataset's %.12g s is no multiple of it",
                       scene->path, scene->physics.dt, truth->dt);
    }
    pm_evaluation *e = NULL;
    PM_TRY(PM_NEW(e, "an evaluation"));
    *e = (pm_evaluation){.system = system,
                         .truth = truth,
                         .count = count,
                         .stride = (int)whole,
                         .inputs = truth,
                         .inputs_of = which};
    pm_status status;
    PM_TRY_DONE(pm_columns_bind(&e->columns, scene, truth, &e->arena));
    const size_t ngroup = (size_t)e->columns.ngroup, ntime = (size_t)truth->ntime;
    const size_t npart = (size_t)scene->physics.nsubsystem;
    pm_arena *arena = &e->arena;
    e->rollout = pm_arena_array(arena, (size_t)count, sizeof *e->rollout);
    e->trajectory = pm_arena_array(arena, ngroup, sizeof *e->trajectory);
    e->snapshot = pm_arena_array(arena, ngroup, sizeof *e->snapshot);
    e->persistence = pm_arena_array(arena, ngroup, sizeof *e->persistence);
    e->of_deviation = pm_arena_array(arena, ngroup, sizeof *e->of_deviation);
    for (int i = 0; e->rollout != NULL && i < count; ++i) {
        pm_rollout *rollout = &e->rollout[i];
        rollout->trajectory = which[i];
        rollout->length = pm_dataset_length(truth, which[i]);
        rollout->error = pm_arena_array(arena, ngroup, sizeof(double));
        rollout->snapshot = pm_arena_array(arena, ntime * ngroup, sizeof(double));
        rollout->energy = pm_arena_array(arena, ntime, sizeof(double));
        rollout->nout_of_range = pm_arena_array(arena, npart, sizeof *rollout->nout_of_range);
        rollout->entropy = pm_arena_array(arena, ntime, sizeof(double));
        rollout->part_energy = pm_arena_array(arena, 2 * ntime * npart, sizeof(double));
        rollout->part_entropy = pm_arena_array(arena, 2 * ntime * npart, sizeof(double));
    }
    PM_TRY_DONE(pm_arena_status(arena, "an evaluation"));
    PM_TRY_DONE(pm_dataset_new(&e->predicted, count, truth->ntime, truth->ncolumn, truth->dt,
                               truth->column));
    memcpy(e->predicted->t, truth->t, ntime * sizeof(double));
    *evaluation = e;
    e = NULL;
done:
    pm_evaluation_free(e);
    return status;
}

pm_status pm_evaluate_list(pm_evaluation **evaluation, const pm_system *system,
                           const pm_dataset *truth, int count, const int *which,
                           const pm_evaluate_how *how) {
    pm_evaluation *e = NULL;
    PM_TRY(pm_evaluation_new(&e, system, truth, count, which));
    e->inputs = how->inputs == NULL ? truth : how->inputs;
    e->inputs_of = how->inputs == NULL ? which : how->inputs_of;
    pm_status status = run_pool(e, how);
    // Computes the distributions of the errors over all rollouts, and what they are compared with.
    const size_t ngroup = (size_t)e->columns.ngroup, ntime = (size_t)truth->ntime,
                 n = (size_t)count;
    const size_t ncolumn = (size_t)truth->ncolumn;
    pm_arena scratch = {0};
    double *value = pm_arena_array(&scratch, n * ntime, sizeof *value);
    double *other = pm_arena_array(&scratch, ntime * ncolumn, sizeof *other);
    // [count][ngroup] the errors of two predictions: always the first state, always the mean state
    double *still = pm_arena_array(&scratch, n * ngroup, sizeof *still);
    double *mean = pm_arena_array(&scratch, n * ngroup, sizeof *mean);
    status = status != PM_OK ? status : pm_arena_status(&scratch, "an evaluation");
    for (size_t i = 0; i < n && status == PM_OK; ++i) {
        const double *own = pm_dataset_state(truth, e->rollout[i].trajectory, 0);
        const size_t length = (size_t)e->rollout[i].length;
        for (size_t j = 0; j < length; ++j) {
            memcpy(other + j * ncolumn, own, ncolumn * sizeof *other);
        }
        pm_score(&e->columns, (int)length, truth->ncolumn, other, own, still + i * ngroup, NULL);
        for (size_t c = 0; c < ncolumn; ++c) {
            double sum = 0;
            for (size_t j = 0; j < length; ++j) {
                sum += own[j * ncolumn + c];
            }
            for (size_t j = 0; j < length; ++j) {
                other[j * ncolumn + c] = sum / (double)length;
            }
        }
        pm_score(&e->columns, (int)length, truth->ncolumn, other, own, mean + i * ngroup, NULL);
    }
    for (size_t g = 0; g < ngroup && status == PM_OK; ++g) {
        int m = 0;
        for (size_t i = 0; i < n; ++i) {
            value[i] = e->rollout[i].error[g];
        }
        e->trajectory[g] = pm_box_of(count, value);
        for (size_t i = 0; i < n; ++i) {
            value[i] = still[i * ngroup + g];
        }
        e->persistence[g] = pm_box_of(count, value).median;
        for (size_t i = 0; i < n; ++i) {
            const double deviation = mean[i * ngroup + g];
            value[i] = e->rollout[i].error[g] / (deviation > 0 ? deviation : 1);
        }
        e->of_deviation[g] = pm_box_of(count, value).median;
        for (size_t i = 0; i < n; ++i) {
            for (size_t j = 1; j < (size_t)e->rollout[i].length; ++j) {
                value[m++] = e->rollout[i].snapshot[j * ngroup + g];
            }
        }
        e->snapshot[g] = m > 0 ? pm_box_of(m, value) : (pm_box){0};
    }
    pm_arena_free(&scratch);
    if (status != PM_OK) {
        pm_evaluation_free(e);
        return status;
    }
    *evaluation = e;
    return PM_OK;
}

pm_status pm_evaluate(pm_evaluation **evaluation, const pm_system *system, const pm_dataset *truth,
                      int first, int end, const pm_evaluate_how *how) {
    int *which = malloc((size_t)(end - first) * sizeof *which);
    PM_TRY(which != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for an evaluation"));
    for (int i = first; i < end; ++i) {
        which[i - first] = i;
    }
    const pm_status status = pm_evaluate_list(evaluation, system, truth, end - first, which, how);
    free(which);
    return status;
}

void pm_evaluation_free(pm_evaluation *evaluation) {
    if (evaluation != NULL) {
        pm_dataset_free(evaluation->predicted);
        PM_DELETE(evaluation);
    }
}

const pm_rollout *pm_evaluation_violation(const pm_evaluation *evaluation) {
    for (int i = 0; i < evaluation->count; ++i) {
        if (evaluation->rollout[i].violation[0] != 0) {
            return &evaluation->rollout[i];
        }
    }
    return NULL;
}

int pm_evaluation_failures(const pm_evaluation *evaluation) {
    int count = 0;
    for (int i = 0; i < evaluation->count; ++i) {
        count += evaluation->rollout[i].reached < evaluation->rollout[i].length;
    }
    return count;
}

// --- trajectories of the training ---

pm_status pm_seen_choose(const pm_system *system, const pm_dataset *dataset, const char *list,
                         bool quiet, bool *seen, bool *known, int *which, int *count) {
    static const char where[] = "the weights were trained or validated on";
    *known = false;
    for (int i = 0; i < dataset->ntrajectory; ++i) {
        const uint64_t digest = pm_dataset_digest(dataset, i);
        seen[i] = false;
        for (int k = 0; k < pm_system_components(system); ++k) {
            const pm_provenance *p = system->component[k].provenance;
            *known = *known || p->nseen > 0;
            for (int s = 0; s < p->nseen; ++s) {
                seen[i] = seen[i] || p->seen[s] == digest;
            }
        }
    }
    PM_TRY(pm_options_list(list, dataset->ntrajectory, which, count));
    int nseen = 0;
    for (int i = 0; i < *count; ++i) {
        nseen += seen[which[i]];
    }
    if (list == NULL && nseen > 0 && nseen < *count) {
        *count = 0;
        for (int i = 0; i < dataset->ntrajectory; ++i) {
            if (!seen[i]) {
                which[(*count)++] = i;
            }
        }
        if (!quiet) {
            printf("%d trajector%s that %s %s left out; --trajectories names %s\n", nseen,
                   nseen == 1 ? "y" : "ies", where, nseen == 1 ? "is" : "are",
                   nseen == 1 ? "it" : "them");
        }
    } else if (*known && !quiet) {
        if (nseen > 0 && *count == 1) {
            printf("this trajectory is one that %s: no test of them\n", where);
        } else if (nseen > 0) {
            printf("%d of these %d trajectories %s that %s: no test of them\n", nseen, *count,
                   nseen == 1 ? "is one" : "are ones", where);
        } else if (*count == 1) {
            printf("unseen: the weights were not trained on this trajectory\n");
        } else {
            printf("unseen: the weights were trained on none of these %d trajectories\n", *count);
        }
    }
    return PM_OK;
}

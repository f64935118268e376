// Reads a training file: the scene, the data, the models of all subsystems and ports, the number of
// starts, and the loss and the stages. Every stage begins as a copy of the common loss and may
// override any part of it.
#include "fit/training.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "data/trained.h"
#include "fit/defaults.h"
#include "scene/model_reader.h"

// The number of initial draws, and the iterations of each in the first round.
#define DEFAULT_TRIES 8
#define DEFAULT_TRY_ITERATIONS 10
#define MOST_WEIGHTS_OF_STARTS 3000

// The default weight of the energy balance. It is enough to leave minima in which energies are
// wrong by far, where the error of the balance is of order 1 and those of the rates are of order
// 0.01. Larger weights were better on some systems and worse where few trajectories were given.
#define BALANCE 0.01

// The most weights for Gauss-Newton, which solves the normal equations of all weights; Adam beyond.
#define MOST_WEIGHTS 4000
#define MOST_PIECES 1000000 // of a trajectory
// The number of residuals per weight in a batch of each stage.
#define FIRST_RESIDUALS 64 // all samples, where there are not too many
#define LAST_RESIDUALS 12
#define ROBUST 20 // of the last stage, in medians
// The cost of an iteration grows with the square of the number of weights. Below this number there
// are more iterations.
#define MANY_WEIGHTS 800
#define SMALLEST_BATCH 512
#define LARGEST_BATCH 8192

// Resolves a path of the training file against its folder.
static const char *resolve(pm_training *t, const char *path) {
    const char *slash = strrchr(t->path, '/');
    if (path[0] == '/' || slash == NULL) {
        return path;
    }
    return pm_arena_printf(&t->arena, "%.*s/%s", (int)(slash - t->path), t->path, path);
}

// --- models ---

static pm_status check_names(pm_yaml mapping, const char *what, const pm_scene *scene,
                             int (*find)(const pm_scene *, const char *), pm_arena *arena) {
    for (int i = 0; i < pm_yaml_count(mapping); ++i) {
        const char *name = NULL;
        pm_yaml key, value;
        pm_yaml_entry(mapping, i, &key, &value);
        PM_TRY(pm_yaml_text(key, arena, &name));
        if (find(scene, name) < 0) {
            return pm_yaml_fail(key, "the scene %s has no %s \"%s\"", scene->path, what, name);
        }
    }
    return PM_OK;
}

// Adds the component's name to an error, since several components may use one model.
static pm_status name_component(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s (model of %s)", pm_error(), name) : status;
}

// Reads the model of component `id` of the system, which the map `mapping` names, or declares the
// one that the scene defines.
static pm_status read_component(pm_training *t, pm_yaml root, pm_yaml mapping, int id) {
    const pm_physics *physics = &t->scene->physics;
    const int n = physics->nsubsystem;
    const pm_scene_subsystem *part = id < n ? &physics->subsystem[id] : NULL;
    const pm_scene_port *port = part == NULL ? &physics->port[id - n] : NULL;
    const pm_component *c = &t->system->component[id];
    const char *name = pm_trained_name(t->system, id), *text = NULL;
    if (part != NULL ? part->model != NULL : port->model != NULL) {
        const pm_yaml own = pm_yaml_get(mapping, name);
        return pm_yaml_exists(own) ? pm_yaml_fail(own, "the scene itself has a model of %s", name)
                                   : pm_system_declare(t->system, id);
    }
    pm_yaml choice, models;
    PM_TRY(pm_yaml_require(mapping, name, &choice));
    PM_TRY(pm_yaml_text(choice, &t->arena, &text));
    PM_TRY(pm_yaml_require(root, "models", &models));
    const pm_yaml model = pm_yaml_get(models, text);
    if (!pm_yaml_exists(model)) {
        return pm_yaml_fail(choice, "there is no model \"%s\" under models", text);
    }
    memcpy(c->layout, part != NULL ? &part->layout : port->layout,
           (size_t)c->kind->nlayout * sizeof *c->layout);
    PM_TRY(c->kind->read_spec(model, (pm_yaml){0}, &t->arena, c->spec));
    if (part != NULL) {
        PM_TRY(t->plain ? PM_OK : pm_default_part(c->spec, c->layout, &t->arena));
        return name_component(c->kind->declare(c->model), name);
    }
    const char *law = pm_component_law(c);
    if (strcmp(law, port->law) != 0) {
        return pm_yaml_fail(model, "law %s, but port %s of the scene %s has law %s", law, name,
                            t->scene->path, port->law);
    }
    PM_TRY(t->plain ? PM_OK : pm_default_port(c->spec, t->system, id - n, &t->arena));
    PM_TRY(name_component(c->kind->declare(c->model), name));
    return name_component(
        pm_spec_locate(pm_trained_place(t->system, id), pm_params_check_given(c->params)), name);
}

// Reads the number of random draws. By default there are several, if they differ and if a short fit
// of each is affordable.
static pm_status read_start(pm_training *t, pm_yaml block) {
    size_t weights = 0;
    bool drawn = false; // whether random draws differ at all
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        const pm_params *params = pm_system_params(t->system, i);
        weights += pm_params_trained(params);
        for (int k = 0; k < params->count; ++k) {
            drawn = drawn || (params->entry[k].trained && params->entry[k].spread > 0);
        }
    }
    t->tries = t->plain || !drawn || weights > MOST_WEIGHTS_OF_STARTS ? 1 : DEFAULT_TRIES;
    t->try_iterations = DEFAULT_TRY_ITERATIONS;
    const pm_yaml_key keys[] = {{PM_YAML_TEXT("from", &t->from)},
                                {PM_YAML_INT("tries", &t->tries, 1, 1000)},
                                {PM_YAML_INT("iterations", &t->try_iterations, 1, 10000)},
                                {PM_YAML_BOOL("whole", &t->whole)},
                                {0}};
    PM_TRY(pm_yaml_read(block, &t->arena, keys));
    t->from = t->from == NULL ? NULL : resolve(t, t->from);
    return pm_arena_status(&t->arena, "a training file");
}

// --- the loss ---

// Reads entry i of a map and the text of its key.
static pm_status read_entry(pm_yaml map, int i, pm_arena *arena, pm_yaml *key, const char **name,
                            pm_yaml *value) {
    pm_yaml_entry(map, i, key, value);
    return pm_yaml_text(*key, arena, name);
}

// Reads {subsystem: {group: scale}} into scale [nz]; groups that are not named get 0.
static pm_status read_scale(pm_yaml map, pm_training *t, const double **result) {
    double *scale = pm_arena_array(&t->arena, (size_t)t->scene->physics.nz, sizeof *scale);
    PM_TRY(pm_arena_status(&t->arena, "a training file"));
    PM_TRY(pm_yaml_require_entries(map));
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, groups;
        const char *name;
        PM_TRY(read_entry(map, i, &t->arena, &key, &name, &groups));
        const int subsystem = pm_scene_find_subsystem(t->scene, name);
        if (subsystem < 0) {
            return pm_yaml_fail(key, "the scene has no subsystem \"%s\"", name);
        }
        const pm_scene_subsystem *s = &t->scene->physics.subsystem[subsystem];
        PM_TRY(pm_yaml_require_entries(groups));
        for (int k = 0; k < pm_yaml_count(groups); ++k) {
            pm_yaml value;
            PM_TRY(read_entry(groups, k, &t->arena, &key, &name, &value));
            const pm_group *group = pm_layout_find(&s->layout, name);
            if (group == NULL) {
                return pm_yaml_fail(key, "subsystem %s has no group \"%s\"", s->name, name);
            }
            // Reads one number for a group, or one for each of its components.
            int count = 1;
            double number = 0, *list = &number;
            if (pm_yaml_is_list(value)) {
                PM_TRY(pm_yaml_doubles(value, &t->arena, &count, &list));
            } else {
                PM_TRY(pm_yaml_double(value, 0, INFINITY, &number));
            }
            if (count != 1 && count != group->size) {
                return pm_yaml_fail(value, "expected one number, or %d", group->size);
            }
            for (int j = 0; j < count; ++j) {
                if (!(list[j] >= 0)) {
                    return pm_yaml_fail(value, "expected numbers >= 0, found %g", list[j]);
                }
            }
            for (int j = 0; j < group->size; ++j) {
                (scale + s->first)[group->first + j] = list[count == 1 ? 0 : j];
            }
        }
    }
    *result = scale;
    return PM_OK;
}

// The values of the keys of a loss, which stand alone or among the other keys of a stage. Settings
// without a key keep their value.
typedef struct loss_values {
    int residual;
    pm_yaml integrator, scale;
} loss_values;

static const char *const residual_names[] = {"step", "derivative",
                                             NULL}; // in the order of pm_residual

#define LOSS_KEYS(v, loss, unroll)                                                            \
    {PM_YAML_CHOICE("residual", &(v).residual, residual_names)},                              \
        {PM_YAML_VALUE("integrator", &(v).integrator)}, {PM_YAML_VALUE("scale", &(v).scale)}, \
        {PM_YAML_INT("substeps", &(loss).substeps, 1, 1000)},                                 \
        {PM_YAML_INT("unroll", &(unroll), 1, 1000)},                                          \
        {PM_YAML_DOUBLE("degeneracy", &(loss).degeneracy, 0, 1e12)},                          \
        {PM_YAML_DOUBLE("balance", &(loss).balance, 0, 1e6)}, {                               \
        PM_YAML_DOUBLE("robust", &(loss).robust, 0, 1e6)                                      \
    }

// Reads what these values hold.
static pm_status read_loss(const loss_values *v, pm_training *t, pm_loss *loss) {
    loss->residual = (pm_residual)v->residual;
    if (pm_yaml_exists(v->integrator)) {
        const char *name = NULL;
        PM_TRY(pm_yaml_text(v->integrator, &t->arena, &name));
        const pm_integrator *found = pm_integrator_find(name);
        if (found == NULL) {
            return pm_yaml_fail(v->integrator, "unknown integrator \"%s\", expected one of: %s",
                                name, pm_integrator_names());
        }
        loss->integrator = found;
        PM_TRY(
            pm_system_check_integrator(t->system, found, pm_yaml_where(v->integrator, &t->arena)));
    }
    return pm_yaml_exists(v->scale) ? read_scale(v->scale, t, &loss->scale) : PM_OK;
}

// --- the stages ---

static pm_status read_stage(pm_training *t, pm_yaml block, pm_stage *stage) {
    pm_schedule *schedule = &stage->schedule;
    loss_values v = {.residual = (int)stage->loss.residual};
    pm_yaml optimiser, rates;
    *schedule = (pm_schedule){.batch = 256,
                              .first_rate = 1e-3,
                              .last_rate = 1e-3,
                              .beta2 = 0.999,
                              .memory = 30,
                              .guarded = !t->plain,
                              .thorough = !t->plain};
    const pm_yaml_key keys[] = {
        {PM_YAML_VALUE("optimiser", &optimiser), .required = true},
        {PM_YAML_INT("iterations", &schedule->iterations, 1, 100000000), .required = true},
        {PM_YAML_INT("batch", &schedule->batch, 1, 1000000)},
        {PM_YAML_VALUE("rate", &rates)},
        {PM_YAML_DOUBLE("beta2", &schedule->beta2, 0, 0.999999)},
        {PM_YAML_DOUBLE("decay", &schedule->decay, 0, 1000)},
        {PM_YAML_INT("memory", &schedule->memory, 1, 1000)},
        LOSS_KEYS(v, stage->loss, stage->unroll),
        {0}};
    const char *name = NULL;
    PM_TRY(pm_yaml_read(block, &t->arena, keys));
    PM_TRY(pm_yaml_text(optimiser, &t->arena, &name));
    stage->optimiser = pm_optimiser_find(name);
    if (stage->optimiser == NULL) {
        return pm_yaml_fail(optimiser, "unknown optimiser \"%s\", expected one of: %s", name,
                            pm_optimiser_names());
    }
    if (pm_yaml_exists(rates)) {
        int count = 0;
        double *rate = NULL;
        PM_TRY(pm_yaml_doubles(rates, &t->arena, &count, &rate));
        if (count > 2 || rate[0] <= 0 || rate[count - 1] <= 0) {
            return pm_yaml_fail(rates, "expected one or two numbers > 0 (first and last)");
        }
        schedule->first_rate = rate[0];
        schedule->last_rate = rate[count - 1];
    }
    return read_loss(&v, t, &stage->loss);
}

static int batch_of(int residuals, int weights, int nz) {
    const int wanted = residuals * weights / nz;
    return wanted < SMALLEST_BATCH  ? SMALLEST_BATCH
           : wanted > LARGEST_BATCH ? LARGEST_BATCH
                                    : wanted;
}

static pm_stage *add_stage(pm_training *t, const pm_stage *common, const char *optimiser,
                           int iterations, int batch) {
    pm_stage *stage = &t->stage[t->nstage++];
    *stage = *common;
    stage->optimiser = pm_optimiser_find(optimiser);
    stage->schedule = (pm_schedule){.iterations = iterations,
                                    .batch = batch,
                                    .first_rate = 3e-3,
                                    .last_rate = 1e-5,
                                    .beta2 = 0.999,
                                    .memory = 30,
                                    .guarded = true,
                                    .thorough = true};
    return stage;
}

static pm_status read_stages(pm_training *t, pm_yaml root) {
    pm_stage common = {.loss = {.residual = PM_RESIDUAL_STEP,
                                .integrator = t->scene->physics.integrator,
                                .substeps = t->scene->physics.substeps,
                                .degeneracy = 1,
                                .balance = t->plain ? 0 : BALANCE},
                       .unroll = 1};
    loss_values v = {.residual = PM_RESIDUAL_STEP};
    const pm_yaml_key loss_keys[] = {LOSS_KEYS(v, common.loss, common.unroll), {0}};
    PM_TRY(pm_system_check_integrator(t->system, common.loss.integrator,
                                      t->scene->physics.integrator_at));
    PM_TRY(pm_yaml_read(pm_yaml_get(root, "loss"), &t->arena, loss_keys));
    PM_TRY(read_loss(&v, t, &common.loss));
    t->substeps = common.loss.substeps;
    pm_yaml stages = pm_yaml_get(root, "stages");
    if ((!t->plain || t->noisy) && (!pm_yaml_exists(stages) || pm_yaml_is_text(stages, "auto"))) {
        // Derivatives come first: they are cheap, and good weights are found from far away. Steps
        // that are close to those that are served follow. They include the states whose rates are
        // uncertain (data/samples.h). Their loss is robust from 20 times the median on. From 3
        // times on, rare samples of two of seven circuits had residuals of 1e5 times the median and
        // rollouts through them errors of 5 and 18 %; without a robust loss the median residual was
        // 50 times larger. All other settings are those of `common`. Beyond some thousand weights
        // Adam takes the place of Gauss-Newton.
        const int weights = pm_trained_count(t->system);
        const int nz = t->scene->physics.nz;
        t->nstage = 0;
        if (weights > MOST_WEIGHTS) {
            add_stage(t, &common, "adam", 60, 64)->loss.residual = PM_RESIDUAL_DERIVATIVE;
            add_stage(t, &common, "adam", 60, 64)->loss.substeps = 1;
            return PM_OK;
        }
        const int often = weights < MANY_WEIGHTS / 2 ? 3 : weights < MANY_WEIGHTS ? 2 : 1;
        const int first = batch_of(FIRST_RESIDUALS, weights, nz);
        const int last = batch_of(LAST_RESIDUALS, weights, nz);
        add_stage(t, &common, "gauss_newton", 60 * often, first)->loss.residual =
            PM_RESIDUAL_DERIVATIVE;
        pm_stage *end = add_stage(t, &common, "gauss_newton", 30 * often, last);
        end->loss.substeps = (common.loss.substeps + 1) / 2;
        end->loss.robust = common.loss.robust > 0 ? common.loss.robust : ROBUST;
        return PM_OK;
    }
    PM_TRY(pm_yaml_require(root, "stages", &stages));
    const int count = pm_yaml_count(stages);
    if (!pm_yaml_is_list(stages) || count < 1 || count > PM_MAX_TRAINING_STAGES) {
        return pm_yaml_fail(stages, "expected a list of 1 to %d stages", PM_MAX_TRAINING_STAGES);
    }
    for (int i = 0; i < count; ++i) {
        t->stage[i] = common;
        PM_TRY(read_stage(t, pm_yaml_item(stages, i), &t->stage[i]));
    }
    t->nstage = count;
    return PM_OK;
}

// --- the file ---

// Reads an optional text and its place.
static pm_status read_placed(pm_training *t, pm_yaml value, const char **text, const char **at) {
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_text(value, &t->arena, text));
    *at = pm_yaml_where(value, &t->arena);
    return pm_arena_status(&t->arena, "a training file");
}

// Reads `noise: estimated` or the noise of single columns.
static pm_status read_noise(pm_training *t, pm_yaml block) {
    t->noisy = pm_yaml_exists(block);
    if (!t->noisy || pm_yaml_is_text(block, "estimated")) {
        return PM_OK;
    }
    if (!pm_yaml_is_map(block)) {
        return pm_yaml_fail(block, "expected \"estimated\", or columns with their noise");
    }
    const size_t count = (size_t)pm_yaml_count(block);
    t->noise_column = pm_arena_array(&t->arena, count + 1, sizeof *t->noise_column);
    t->noise = pm_arena_array(&t->arena, count + 1, sizeof *t->noise);
    t->noise_at = pm_yaml_where(block, &t->arena);
    PM_TRY(pm_arena_status(&t->arena, "a training file"));
    for (; t->nnoise < (int)count; ++t->nnoise) {
        pm_yaml key, value;
        pm_yaml_entry(block, t->nnoise, &key, &value);
        PM_TRY(pm_yaml_text(key, &t->arena, &t->noise_column[t->nnoise]));
        PM_TRY(pm_yaml_double(value, DBL_MIN, INFINITY, &t->noise[t->nnoise]));
    }
    return PM_OK;
}

static pm_status read_all(pm_training *t, pm_yaml root) {
    static const char *const defaults[] = {"physical", "plain", NULL};
    pm_yaml scene_at, block, parts, ports, stages, noise, starts;
    int seed = 1, choice = 0;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("scene", &scene_at), .required = true},
                                {PM_YAML_VALUE("data", &block)},
                                {PM_YAML_INT("seed", &seed, 0, INT_MAX)},
                                {PM_YAML_VALUE("models", NULL)},
                                {PM_YAML_VALUE("subsystems", &parts)},
                                {PM_YAML_VALUE("ports", &ports)},
                                {PM_YAML_VALUE("loss", NULL)},
                                {PM_YAML_VALUE("stages", &stages)},
                                {PM_YAML_CHOICE("defaults", &choice, defaults)},
                                {PM_YAML_VALUE("start", &starts)},
                                {PM_YAML_VALUE("noise", &noise)},
                                {0}};
    const char *scene = NULL;
    PM_TRY(pm_yaml_read(root, &t->arena, keys));
    t->seed = (uint64_t)seed;
    t->plain = choice == 1;
    PM_TRY(pm_yaml_text(scene_at, &t->arena, &scene));
    scene = resolve(t, scene);
    PM_TRY(pm_arena_status(&t->arena, "a training file"));
    // Loads the scene. Errors inside it name their place there; a missing file names the place of
    // its path.
    const pm_status loaded = pm_scene_load(&t->scene, scene);
    if (loaded == PM_EFILE) {
        const char *where = pm_yaml_where(scene_at, &t->arena);
        PM_TRY(pm_arena_status(&t->arena, "a training file"));
        return pm_fail(loaded, "%s: %s", where, pm_error());
    }
    PM_TRY(loaded);
    PM_TRY(pm_system_new(&t->system, t->scene));
    pm_yaml file, training, validation;
    t->seconds = INFINITY;
    t->pieces = 1;
    const pm_yaml_key data_keys[] = {{PM_YAML_VALUE("file", &file)},
                                     {PM_YAML_VALUE("trajectories", &training)},
                                     {PM_YAML_VALUE("validation", &validation)},
                                     {PM_YAML_TEXT("data_set", &t->data_set)},
                                     {PM_YAML_DOUBLE("seconds", &t->seconds, DBL_MIN, INFINITY)},
                                     {PM_YAML_INT("pieces", &t->pieces, 1, MOST_PIECES)},
                                     {0}};
    PM_TRY(pm_yaml_read(block, &t->arena, data_keys));
    PM_TRY(read_placed(t, file, &t->data, &t->data_at));
    t->data = t->data == NULL ? NULL : resolve(t, t->data);
    PM_TRY(read_placed(t, training, &t->trajectories, &t->trajectories_at));
    PM_TRY(read_placed(t, validation, &t->validation, &t->validation_at));
    PM_TRY(read_noise(t, noise));
    PM_TRY(check_names(parts, "subsystem", t->scene, pm_scene_find_subsystem, &t->arena));
    PM_TRY(check_names(ports, "port", t->scene, pm_scene_find_port, &t->arena));
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        const bool part = i < t->scene->physics.nsubsystem;
        PM_TRY(read_component(t, root, part ? parts : ports, i));
    }
    pm_trained_share(t->system);
    PM_TRY(pm_system_check_boundary_inputs(t->system));
    PM_TRY(read_stages(t, root));
    t->measured = t->noisy || t->scene->run.nobservation > 0 || pm_scene_hides(t->scene);
    if (t->measured && pm_yaml_exists(stages) && !pm_yaml_is_text(stages, "auto")) {
        return pm_yaml_fail(stages, "a fit to measurements has no stages (noise, hidden groups or "
                                    "observations make it one)");
    }
    if (!t->measured && t->pieces > 1) {
        return pm_yaml_fail(pm_yaml_get(block, "pieces"), "only measurements are divided (noise, "
                                                          "hidden groups or observations make "
                                                          "them so)");
    }
    PM_TRY(read_start(t, starts));
    uint64_t digest = pm_digest_integer(PM_DIGEST_INIT, (int64_t)t->seed);
    digest = pm_digest_integer(digest, t->plain);
    digest = pm_digest_integer(digest, t->tries);
    digest = pm_digest_integer(digest, t->try_iterations);
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        const pm_component *c = &t->system->component[i];
        const char *text = c->kind->write_spec(c->spec, &t->arena);
        digest = pm_digest_text(digest, text == NULL ? "" : text);
    }
    for (int i = 0; i < t->nstage; ++i) {
        const pm_stage *s = &t->stage[i];
        const double number[] = {s->schedule.first_rate, s->schedule.last_rate, s->schedule.beta2,
                                 s->schedule.decay,      s->loss.degeneracy,    s->loss.balance,
                                 s->loss.robust};
        const int integer[] = {s->schedule.batch, s->schedule.memory, s->unroll, s->loss.substeps,
                               (int)s->loss.residual};
        uint64_t own = pm_digest_text(PM_DIGEST_INIT, s->optimiser->name);
        own = pm_digest_text(own, s->loss.integrator->name);
        if (s->loss.scale != NULL) {
            own = pm_digest_doubles(own, s->loss.scale, (size_t)t->scene->physics.nz);
        }
        own = pm_digest_doubles(own, number, sizeof number / sizeof *number);
        for (size_t k = 0; k < sizeof integer / sizeof *integer; ++k) {
            own = pm_digest_integer(own, integer[k]);
        }
        t->stage_digest[i] = (uint32_t)(own ^ (own >> 32));
    }
    t->digest = pm_digest_integer(digest, t->plain);
    return PM_OK;
}

pm_status pm_training_load(pm_training **training, const char *path) {
    pm_training *t = NULL;
    PM_TRY(PM_NEW(t, "a training file"));
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status = PM_OK;
    t->path = pm_arena_strdup(&t->arena, path);
    PM_TRY_DONE(pm_arena_status(&t->arena, "a training file"));
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    PM_TRY_DONE(read_all(t, root));
    *training = t;
    t = NULL;
done:
    pm_yaml_close(document);
    pm_training_free(t);
    return status;
}

void pm_training_free(pm_training *training) {
    if (training != NULL) {
        pm_system_free(training->system);
        pm_scene_free(training->scene);
        PM_DELETE(training);
    }
}

// Measurements in a fit: loading them, states for the scales of models, and multiple shooting.
#include "learn/fit_measured.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "learn/calibration.h"
#include "learn/directions.h"
#include "learn/shooting_start.h"
#include "learn/start.h"
#include "scene/columns.h"

#define NETWORK_REACH 10.0    // of weights, whose inputs have deviations of 1
#define TEMPERATURE_REACH 0.1 // of the logarithm of a temperature
#define POOR 0.3              // typical error of a column, of which the report warns
#define MOST_REPORTED 8       // trajectories whose starts the report estimates
#define EARLY_REACH 1.0       // of the logarithm of a positive constant, before the last level
#define FAR_REACH 1e6         // of constants whose unit and size are not known
#define SWING 16 // steps in which hidden components swing once, in states that fix scales
#define ESTIMATED_PART 0.25 // of a trajectory, from which the report estimates its start
#define MOST_SEARCHED 400   // weights; with more, short fits to windows take too long
#define SEARCHED 2          // first window lengths of the windows that choose initial weights
#define EQUAL 1e-6          // relative difference of times that count as equal

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for measurements");
}

// --- loading ---

// Assigns the noise of the training file to columns.
static pm_status bind_noise(const pm_training *t, struct pm_fit_measured *m) {
    m->noise = pm_arena_array(&m->arena, (size_t)m->observation.count, sizeof *m->noise);
    if (m->noise == NULL) {
        return no_memory();
    }
    for (int i = 0; i < t->nnoise; ++i) {
        int c = 0;
        while (c < m->observation.count &&
               strcmp(m->observation.name[c], t->noise_column[i]) != 0) {
            ++c;
        }
        if (c == m->observation.count) {
            return pm_fail(PM_ECONFIG, "%s: the scene measures no column \"%.64s\"", t->noise_at,
                           t->noise_column[i]);
        }
        m->noise[c] = t->noise[i];
    }
    return PM_OK;
}

// Whether the measurements have a column of this name; the time needs none.
static bool has_column(const pm_dataset *data, const char *name) {
    int c = 0;
    while (c < data->ncolumn && strcmp(data->column[c], name) != 0) {
        ++c;
    }
    return c < data->ncolumn;
}

// The columns of all states, followed by those of boundary inputs.
static pm_status list_columns(struct pm_fit_measured *m, const pm_scene *scene,
                              const char ***column, int *count) {
    const char **list =
        pm_arena_array(&m->arena, (size_t)(scene->nz + scene->nprescribed), sizeof *list);
    if (list == NULL) {
        return no_memory();
    }
    *count = scene->nz;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[i];
        memcpy(list + s->first, s->column, (size_t)s->layout.nz * sizeof *list);
    }
    for (int i = 0; i < scene->nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &scene->boundary_input[i];
        for (int k = 0; k < 3 * b->layout.nz; ++k) {
            const char *name = b->value[k].column;
            int same = 0;
            while (same < *count && (name == NULL || strcmp(list[same], name) != 0)) {
                ++same;
            }
            if (name != NULL && same == *count && has_column(m->data, name)) {
                list[(*count)++] = name;
            }
        }
    }
    *column = list;
    return PM_OK;
}

// Copies the columns of boundary inputs, which stand behind those of the states.
static void copy_inputs(const struct pm_fit_measured *m, const pm_track *r, int nz, int trajectory,
                        pm_dataset *states) {
    for (int k = nz; k < states->ncolumn; ++k) {
        int c = 0;
        while (c + 1 < m->data->ncolumn && strcmp(m->data->column[c], states->column[k]) != 0) {
            ++c;
        }
        for (int j = 0; j < states->ntime && j < r->count; ++j) {
            pm_dataset_state(states, trajectory, j)[k] =
                pm_dataset_state(m->data, trajectory, r->sample[j])[c];
        }
    }
}

// Lets hidden components vary by their deviation about their guess, so that the scales of models
// are those of such states: entropies rise, others swing once in SWING steps.
static void vary_hidden(const struct pm_fit_measured *m, const pm_scene *scene, int track,
                        int ntime, double *state) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_layout *layout = &scene->subsystem[i].layout;
        for (int g = 0; g < layout->ngroup; ++g) {
            const pm_group *group = &layout->group[g];
            const bool entropy = strcmp(group->unit, "J/K") == 0;
            for (int k = 0; k < group->size * ntime; ++k) {
                const int c = scene->subsystem[i].first + group->first + k % group->size;
                const int step = k / group->size;
                const double part = (double)step / ntime, turn = (step + 3.0 * (track + c)) / SWING;
                const double x = entropy ? sqrt(3) * (2 * part - 1) : sqrt(2) * sin(6.28 * turn);
                if (m->observation.hidden[c]) {
                    state[(ptrdiff_t)step * scene->nz + c] += m->observation.deviation[c] * x;
                }
            }
        }
    }
}

// Fills the dataset of states from the tracks of all trajectories.
static pm_status fill_states(pm_fit *f, const pm_tracks *tracks) {
    struct pm_fit_measured *m = f->measured;
    const pm_scene *scene = f->training->scene;
    const size_t nz = (size_t)scene->nz;
    int ntime = 0, count = 0;
    for (int i = 0; i < tracks->count; ++i) {
        const pm_track *r = &tracks->track[i];
        const double length = (r->time[r->count - 1] - r->time[0]) / scene->dt;
        const int own = 1 + (int)floor(length * (1 + EQUAL));
        ntime = i == 0 || own < ntime ? own : ntime;
    }
    const char **column = NULL;
    pm_columns columns;
    PM_TRY(list_columns(m, scene, &column, &count));
    PM_TRY(pm_dataset_new(&f->dataset, tracks->count, ntime, count, scene->dt, column));
    PM_TRY(pm_columns_bind(&columns, scene, f->dataset, &m->arena));
    double *state = malloc((size_t)ntime * nz * sizeof *state);
    if (state == NULL) {
        return no_memory();
    }
    for (int i = 0; i < tracks->count; ++i) {
        pm_track_states(tracks, i, scene, &m->observation, ntime, state);
        vary_hidden(m, scene, i, ntime, state);
        for (int j = 0; j < ntime; ++j) {
            pm_columns_to_row(&columns, state + (size_t)j * nz, pm_dataset_state(f->dataset, i, j));
        }
        copy_inputs(m, &tracks->track[i], scene->nz, i, f->dataset);
    }
    free(state);
    return PM_OK;
}

// Counts the samples of all trajectories, and those that tracks use.
static void count_samples(struct pm_fit_measured *m, const pm_tracks *tracks) {
    for (int i = 0; i < tracks->count; ++i) {
        const pm_track *r = &tracks->track[i];
        m->used += r->count;
        m->samples += r->sample[r->count - 1] + 1;
    }
}

static pm_status make_states(pm_fit *f) {
    struct pm_fit_measured *m = f->measured;
    int *all = pm_arena_array(&m->arena, (size_t)m->data->ntrajectory, sizeof *all);
    pm_tracks tracks;
    if (all == NULL) {
        return no_memory();
    }
    for (int i = 0; i < m->data->ntrajectory; ++i) {
        all[i] = i;
    }
    PM_TRY(pm_tracks_make(&tracks, f->training->scene, &m->observation, m->data,
                          m->data->ntrajectory, all, f->training->seconds, true));
    count_samples(m, &tracks);
    const pm_status status = fill_states(f, &tracks);
    pm_tracks_free(&tracks);
    return status;
}

// Makes room for a point of the course, with the starts of the shortest windows.
static pm_status allocate_level(pm_fit *f) {
    struct pm_fit_measured *m = f->measured;
    const int nz = f->training->scene->nz;
    m->level_gap = pm_arena_array(&m->arena, 2 * (size_t)nz, sizeof *m->level_gap);
    m->nstart = m->data->ntrajectory * (m->data->ntime / PM_SHOOTING_SHORTEST + 1) * nz;
    m->level_start = pm_arena_array(&m->arena, (size_t)m->nstart, sizeof *m->level_start);
    m->level_noise =
        pm_arena_array(&m->arena, (size_t)m->observation.count, sizeof *m->level_noise);
    if (m->level_start == NULL || m->level_noise == NULL || m->level_gap == NULL) {
        return no_memory();
    }
    f->extra[0] = (pm_checkpoint_field){"level", PM_FIT_MEASURED_LEVEL, m->level};
    f->extra[1] = (pm_checkpoint_field){"noise", m->observation.count, m->level_noise};
    f->extra[2] = (pm_checkpoint_field){"gaps", 2 * nz, m->level_gap};
    f->extra[3] = (pm_checkpoint_field){"starts", m->nstart, m->level_start};
    f->nextra = 4;
    return PM_OK;
}

pm_status pm_fit_measured_load(pm_fit *f, const char *path) {
    struct pm_fit_measured *m = calloc(1, sizeof *m);
    const char *name = f->arguments->data_set != NULL  ? f->arguments->data_set
                       : f->training->data_set != NULL ? f->training->data_set
                                                       : "z";
    if (m == NULL) {
        return no_memory();
    }
    f->measured = m;
    PM_TRY(pm_dataset_load_measured(&m->data, path, name));
    PM_TRY(pm_observation_bind(&m->observation, f->training->scene, m->data, &m->arena));
    PM_TRY(bind_noise(f->training, m));
    size_t weights = 1;
    for (int i = 0; i < pm_system_components(f->training->system); ++i) {
        weights += pm_params_trained(pm_system_params(f->training->system, i));
    }
    m->declared = pm_arena_array(&m->arena, weights, sizeof *m->declared);
    m->typical = pm_arena_array(&m->arena, (size_t)f->training->scene->nz, sizeof *m->typical);
    if (m->typical == NULL || m->declared == NULL) {
        return no_memory();
    }
    memcpy(m->typical, m->observation.deviation,
           (size_t)f->training->scene->nz * sizeof *m->typical);
    PM_TRY(allocate_level(f));
    return make_states(f);
}

void pm_fit_measured_close(struct pm_fit_measured *m) {
    if (m != NULL) {
        pm_dataset_free(m->data);
        pm_arena_free(&m->arena);
        free(m);
    }
}

// --- training ---

// Whether a learned constant of component i stays positive.
static bool is_positive(const pm_fit *f, int component, const char *name) {
    const pm_system *system = f->training->system;
    const int nsubsystem = system->scene->nsubsystem;
    const pm_constants *c = component < nsubsystem
                                ? system->part[component]->spec.constants
                                : system->port[component - nsubsystem]->spec.constants;
    for (int i = 0; c != NULL && c->learned != NULL && i < c->count; ++i) {
        if (strcmp(c->name[i], name) == 0) {
            return c->learned[i] == PM_CONSTANT_POSITIVE;
        }
    }
    return false;
}

// Returns how far a weight of component i is expected to be from its declared value `first`:
// weights of networks, whose inputs and outputs have deviations of about 1; logarithms of positive
// constants; other learned constants, which have units, so that little is known of them; and
// temperatures, since coupled bodies leave a common factor of them nearly free.
static double reach_of(const pm_fit *f, int i, const pm_param_entry *entry, double first) {
    const char *end = strrchr(entry->name, '.');
    if (strncmp(entry->name, "constant.", 9) == 0) {
        return is_positive(f, i, entry->name + 9) ? PM_SHOOTING_REACH
                                                  : FAR_REACH * fmax(fabs(first), 1);
    }
    return end != NULL && strcmp(end, ".amplitude") == 0 ? TEMPERATURE_REACH : NETWORK_REACH;
}

static void set_reach(const pm_fit *f, pm_shooting *s) {
    size_t at = 0;
    memcpy(s->first_weight, f->measured->declared, (size_t)s->nweight * sizeof *s->first_weight);
    for (int i = 0; i < pm_system_components(f->training->system); ++i) {
        const pm_params *params = pm_system_params(f->training->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const bool positive =
                strncmp(entry->name, "constant.", 9) == 0 && is_positive(f, i, entry->name + 9);
            for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j) {
                s->reach[at] = reach_of(f, i, entry, s->first_weight[at]);
                s->early_reach[at] = positive ? EARLY_REACH : s->reach[at];
                ++at;
            }
        }
    }
}

// Whether the initial weights are random, so that draws differ.
static bool is_random(const pm_fit *f) {
    const size_t n = (size_t)f->size;
    return n > 0 && memcmp(f->theta, f->measured->declared, n * sizeof *f->theta) != 0;
}

// Writes a draw to theta. Draws begin from the weights as declared.
static void draw(void *context, int id, double *theta) {
    pm_fit *f = context;
    pm_fit_set_weights(f, f->measured->declared);
    pm_start_draw_again(f->training, id, theta);
}

bool pm_fit_measured_searches(const pm_fit *f) {
    return f->training->tries > 1 && (f->size <= MOST_SEARCHED || pm_training_hides(f->training));
}

// Chooses the initial weights.
static pm_status search_start(pm_fit *f, pm_shooting *s) {
    const pm_shooting_search search = {.tries = f->training->tries,
                                       .iterations = f->training->try_iterations,
                                       .length = SEARCHED * pm_shooting_first_length(s),
                                       .draw = draw,
                                       .context = f,
                                       .stop = f->stop};
    const int substeps = s->how.substeps;
    if (pm_fit_measured_searches(f) && is_random(f)) {
        PM_TRY(pm_shooting_search_start(s, &search));
        s->how.substeps = substeps;
    }
    return PM_OK;
}

// A fit in progress, as the schedule sees it.
typedef struct course_context {
    pm_fit *fit;
    pm_shooting *shooting;
} course_context;

// Names constants that the data hardly tell apart, once the starts of windows are known. Gaps count
// as they will at the end, so that whole trajectories tell, and not single windows.
static pm_status foresee(const pm_fit *f, pm_shooting *s, const pm_shooting_level *level) {
    struct pm_fit_measured *m = f->measured;
    double *noise = pm_arena_array(&m->arena, (size_t)s->ny, sizeof *noise);
    double *gap = pm_arena_array(&m->arena, (size_t)s->nz, sizeof *gap);
    if (noise == NULL || gap == NULL) {
        return no_memory();
    }
    for (int c = 0; c < s->ny; ++c) {
        noise[c] = fmax(m->noise[c], PM_SHOOTING_EARLY_NOISE * s->tracks->deviation[c]);
    }
    for (int c = 0; c < s->nz; ++c) {
        gap[c] = s->gap[c] / level->factor * PM_SHOOTING_LAST_GAP;
    }
    return pm_directions_foresee(s, noise, gap);
}

// Notes a point of the course, from which the fit goes on if it is interrupted.
static pm_status keep_level(void *context, const pm_shooting_level *level) {
    const course_context *c = context;
    struct pm_fit_measured *m = c->fit->measured;
    const pm_shooting *s = c->shooting;
    if (level->part == PM_COURSE_SHORT && m->level[0] == PM_COURSE_STARTS) {
        PM_TRY(foresee(c->fit, c->shooting, level));
    }
    const double number[PM_FIT_MEASURED_LEVEL] = {level->part,          level->length,
                                                  level->round,         level->factor,
                                                  level->damping,       level->progress.iterations,
                                                  level->progress.idle, level->progress.before};
    memcpy(m->level, number, sizeof number);
    memcpy(m->level_gap, s->gap, (size_t)s->nz * sizeof *s->gap);
    memcpy(m->level_gap + s->nz, s->later, (size_t)s->nz * sizeof *s->later);
    memcpy(m->level_noise, s->noise, (size_t)s->ny * sizeof *s->noise);
    memcpy(m->level_start, s->z, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    pm_shooting_weights(s, c->fit->theta);
    return pm_clock() - c->fit->saved > PM_FIT_CHECKPOINT_INTERVAL ? pm_fit_save(c->fit, false)
                                                                   : PM_OK;
}

// Puts the shooting where keep_level found it; the system has the weights already.
static pm_status restore_level(const struct pm_fit_measured *m, pm_shooting *s,
                               pm_shooting_level *level) {
    const double *number = m->level;
    *level = (pm_shooting_level){
        .part = (int)number[0],
        .length = (int)number[1],
        .round = (int)number[2],
        .factor = number[3],
        .damping = number[4],
        .progress = {.iterations = (int)number[5], .idle = (int)number[6], .before = number[7]}};
    if (level->part == PM_COURSE_NONE) {
        return PM_OK;
    }
    PM_TRY(pm_shooting_divide(s, level->length));
    memcpy(s->z, m->level_start, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    memcpy(s->noise, m->level_noise, (size_t)s->ny * sizeof *s->noise);
    memcpy(s->gap, m->level_gap, (size_t)s->nz * sizeof *s->gap);
    memcpy(s->later, m->level_gap + s->nz, (size_t)s->nz * sizeof *s->later);
    printf("resumes with windows of %d\n", level->length);
    pm_shooting_evaluate(s, s->z, false);
    return s->failed;
}

static pm_status find_uncertainty(pm_fit *f, pm_shooting *s) {
    const struct pm_fit_measured *m = f->measured;
    pm_uncertainty u;
    PM_TRY(pm_uncertainty_make(&u, s));
    const pm_calibration_how how = {.data = m->data,
                                    .which = f->split.trajectory,
                                    .nheld = f->split.nvalidation,
                                    .held = f->split.trajectory + f->split.ntraining,
                                    .until = f->training->seconds,
                                    .stop = f->stop};
    pm_status status = pm_calibration_make(&u, s, &how);
    if (status == PM_OK) {
        pm_uncertainty_print(&u, s);
        status = pm_directions_print(&u, s);
    }
    if (status == PM_OK) {
        status = pm_uncertainty_save(&u, f->arguments->output);
    }
    pm_uncertainty_free(&u);
    return status;
}

static pm_status shoot(pm_fit *f, pm_shooting *s) {
    const struct pm_fit_measured *m = f->measured;
    course_context context = {f, s};
    pm_shooting_course course = {.given = m->noise,
                                 .typical = m->typical,
                                 .loud = true,
                                 .stop = f->stop,
                                 .keep = keep_level,
                                 .context = &context};
    for (int c = 0; c < s->nz; ++c) {
        s->prior[c] = m->observation.hidden[c] ? m->observation.deviation[c] : 0;
    }
    set_reach(f, s);
    if (m->level[0] == PM_COURSE_NONE) {
        PM_TRY(search_start(f, s));
    }
    PM_TRY(restore_level(m, s, &course.first_level));
    PM_TRY(pm_shooting_run(s, &course));
    return find_uncertainty(f, s);
}

pm_status pm_fit_measured_run(pm_fit *f) {
    const struct pm_fit_measured *m = f->measured;
    const pm_loss *loss = &f->training->stage[f->training->nstage - 1].loss;
    pm_tracks tracks;
    pm_shooting shooting = {0};
    PM_TRY(pm_tracks_make(&tracks, f->training->scene, &m->observation, m->data, f->split.ntraining,
                          f->split.trajectory, f->training->seconds, true));
    const pm_flow_how how = {.system = f->training->system,
                             .observation = &m->observation,
                             .integrator = loss->integrator,
                             .substeps = loss->substeps,
                             .stretched = tracks.stretched};
    pm_status status = pm_shooting_open(&shooting, &how, &tracks);
    if (status == PM_OK) {
        pm_fit_set_weights(f, f->theta);
        status = shoot(f, &shooting);
    }
    pm_shooting_close(&shooting);
    pm_tracks_free(&tracks);
    if (status == PM_EINTERRUPTED) {
        PM_TRY(pm_fit_save(f, false));
        return pm_fail(PM_EINTERRUPTED, "interrupted; continue with --resume");
    }
    return status;
}

pm_status pm_fit_measured_report(pm_fit *f) {
    const struct pm_fit_measured *m = f->measured;
    const bool validation = f->split.nvalidation > 0;
    const int all = validation ? f->split.nvalidation : f->split.ntraining;
    const int count = all < MOST_REPORTED ? all : MOST_REPORTED;
    const int *which = f->split.trajectory + (validation ? f->split.ntraining : 0);
    const double seconds = ESTIMATED_PART * (f->dataset->ntime - 1) * f->dataset->dt;
    pm_estimate e;
    const pm_estimate_how how = {
        .seconds = seconds, .stop = f->stop, .until = f->training->seconds};
    PM_TRY(pm_estimate_make(&e, f->training->system, &m->observation, m->data, count, which, &how));
    printf("Starts of the %s part estimated in the first %.3g s; errors after that, in %% of each "
           "column's deviation: median and largest\n",
           validation ? "validation" : "training", seconds);
    bool finite = true;
    double worst = 0;
    for (int c = 0; c < m->observation.count; ++c) {
        const pm_box box = pm_estimate_errors(&e, &m->observation, m->data, which, seconds, c);
        printf("  %-16s %10.3g %10.3g\n", m->observation.name[c], 100 * box.median,
               100 * box.largest);
        finite = finite && isfinite(box.median);
        worst =
            fmax(worst, pm_estimate_typical_error(&e, &m->observation, m->data, which, seconds, c));
    }
    if (finite && worst > POOR) {
        printf(
            "Verdict: poor. Predictions miss %.0f %% of the typical distance of a column from its "
            "median. Other first values of the constants may help, or a larger deviation of hidden "
            "starts in the scene.\n",
            100 * worst);
    }
    pm_estimate_free(&e);
    return finite ? PM_OK
                  : pm_fail(PM_EUNFIT, "predictions of the %s part are not finite",
                            validation ? "validation" : "training");
}

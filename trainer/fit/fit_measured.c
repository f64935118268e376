// Measurements in a fit: loading them, states for the scales of models, and multiple shooting.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/trained.h"
#include "data/unit_change.h"
#include "fit/fit.h"
#include "fit/start.h"
#include "inference/calibration.h"
#include "scene/columns.h"
#include "shooting/continuation.h"
#include "shooting/window_draws.h"

#define NETWORK_REACH 10.0    // of weights, whose inputs have deviations of 1
#define TEMPERATURE_REACH 0.1 // of the logarithm of a temperature
#define POOR 0.3              // typical error of a column, of which the report warns
#define MOST_REPORTED 8       // trajectories whose starts the report estimates
#define EARLY_REACH 1.0       // of the logarithm of a positive constant, before the last point
#define FAR_REACH 1e6         // of constants whose unit and size are not known
#define SWING 16 // steps in which hidden components swing once, in states that fix scales
#define ESTIMATED_PART 0.25 // of a trajectory, from which the report estimates its start
#define MOST_SEARCHED 400   // weights; with more, short fits to windows take too long
#define SEARCHED 2          // first window lengths of the windows that choose initial weights
#define EQUAL 1e-6          // relative difference of times that count as equal

// --- loading ---

// The columns of all states, followed by those of boundary inputs.
static pm_status list_columns(pm_fit *f, const char ***column, int *count) {
    const pm_scene *scene = f->training->scene;
    const char **list = pm_arena_array(
        &f->arena, (size_t)(scene->physics.nz + scene->physics.nprescribed), sizeof *list);
    PM_TRY(pm_arena_status(&f->arena, "measurements"));
    *count = scene->physics.nz;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        memcpy(list + s->first, s->column, (size_t)s->layout.nz * sizeof *list);
    }
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * b->layout.nz; ++k) {
            const char *name = b->value[k].column;
            int same = 0;
            while (same < *count && (name == NULL || strcmp(list[same], name) != 0)) {
                ++same;
            }
            // Where the measurements have this column; the time needs none.
            const pm_dataset *data = f->measured.data;
            int at = 0;
            while (name != NULL && at < data->ncolumn && strcmp(data->column[at], name) != 0) {
                ++at;
            }
            if (name != NULL && same == *count && at < data->ncolumn) {
                list[(*count)++] = name;
            }
        }
    }
    *column = list;
    return PM_OK;
}

// Lets hidden components vary by their deviation about their guess, so that the scales of models
// are those of such states: entropies rise, others swing once in SWING steps.
static void vary_hidden(const pm_fit_measured *m, const pm_scene *scene, int track, int ntime,
                        double *state) {
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_layout *layout = &scene->physics.subsystem[i].layout;
        for (int g = 0; g < layout->ngroup; ++g) {
            const pm_group *group = &layout->group[g];
            const bool entropy = group->role == PM_ROLE_ENTROPY;
            for (int k = 0; k < group->size * ntime; ++k) {
                const int c = scene->physics.subsystem[i].first + group->first + k % group->size;
                const int step = k / group->size;
                const double part = (double)step / ntime, turn = (step + 3.0 * (track + c)) / SWING;
                const double x = entropy ? sqrt(3) * (2 * part - 1) : sqrt(2) * sin(6.28 * turn);
                if (m->observation.hidden[c]) {
                    state[(ptrdiff_t)step * scene->physics.nz + c] +=
                        m->observation.deviation[c] * x;
                }
            }
        }
    }
}

// Fills the columns of boundary inputs, which stand behind those of the states.
static void fill_inputs(pm_fit *f, pm_boundary_input *input, int trajectory, double start) {
    pm_dataset *d = f->dataset;
    if (d->ncolumn > f->training->scene->physics.nz) {
        pm_boundary_input_follow(input, f->measured.data, trajectory);
    }
    for (int k = f->training->scene->physics.nz; k < d->ncolumn; ++k) {
        int i = 0; // a value that follows the column
        while (i + 1 < input->n &&
               (input->column[i] < 0 ||
                strcmp(f->measured.data->column[input->column[i]], d->column[k]) != 0)) {
            ++i;
        }
        for (int j = 0; j < d->ntime; ++j) {
            pm_dataset_state(d, trajectory, j)[k] =
                pm_boundary_input_of(input, i, start + j * d->dt);
        }
    }
}

// Fills the dataset of states from the tracks of all trajectories.
static pm_status fill_states(pm_fit *f, const pm_tracks *tracks) {
    pm_fit_measured *m = &f->measured;
    const pm_scene *scene = f->training->scene;
    const size_t nz = (size_t)scene->physics.nz;
    int ntime = 0, count = 0;
    for (int i = 0; i < tracks->count; ++i) {
        const pm_track *r = &tracks->track[i];
        const double length = (r->time[r->count - 1] - r->time[0]) / scene->physics.dt;
        const int own = 1 + (int)floor(length * (1 + EQUAL));
        ntime = i == 0 || own < ntime ? own : ntime;
    }
    const char **column = NULL;
    pm_columns columns;
    PM_TRY(list_columns(f, &column, &count));
    PM_TRY(pm_dataset_new(&f->dataset, tracks->count, ntime, count, scene->physics.dt, column));
    PM_TRY(pm_columns_bind(&columns, scene, f->dataset, &f->arena));
    pm_boundary_input input = {0};
    PM_TRY(pm_boundary_input_bind(&input, scene, m->data, pm_boundary_input_stride(scene, m->data),
                                  &f->arena));
    double *state = malloc((size_t)ntime * nz * sizeof *state);
    if (state == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for measurements");
    }
    for (int i = 0; i < tracks->count; ++i) {
        pm_track_states(tracks, i, scene, &m->observation, ntime, state);
        vary_hidden(m, scene, i, ntime, state);
        for (int j = 0; j < ntime; ++j) {
            pm_columns_to_row(&columns, state + (size_t)j * nz, pm_dataset_state(f->dataset, i, j));
        }
        fill_inputs(f, &input, i, tracks->track[i].time[0]);
    }
    free(state);
    return PM_OK;
}

static pm_status load(pm_fit *f) {
    pm_fit_measured *m = &f->measured;
    const pm_scene *scene = f->training->scene;
    const char *name = f->arguments->data_set != NULL  ? f->arguments->data_set
                       : f->training->data_set != NULL ? f->training->data_set
                                                       : "z";
    const size_t nz = (size_t)scene->physics.nz;
    PM_TRY(pm_dataset_load_measured(&m->data, f->data, name));
    PM_TRY(pm_unit_change_apply(scene, m->data, true));
    PM_TRY(pm_observation_bind(&m->observation, f->training->system, m->data, &f->arena));
    const size_t ny = (size_t)m->observation.count;
    // Room for a point of the continuation, with the starts of the shortest windows.
    m->nstart = m->data->ntrajectory * (m->data->ntime / PM_CONTINUATION_SHORTEST + 1) * (int)nz;
    m->typical = pm_arena_array(&f->arena, nz, sizeof *m->typical);
    m->noise = pm_arena_array(&f->arena, ny, sizeof *m->noise);
    m->point_gap = pm_arena_array(&f->arena, 2 * nz, sizeof *m->point_gap);
    m->point_start = pm_arena_array(&f->arena, (size_t)m->nstart, sizeof *m->point_start);
    m->point_noise = pm_arena_array(&f->arena, ny, sizeof *m->point_noise);
    PM_TRY(pm_arena_status(&f->arena, "measurements"));
    // Assigns the noise of the training file to columns.
    for (int i = 0; i < f->training->nnoise; ++i) {
        int c = 0;
        while (c < m->observation.count &&
               strcmp(m->observation.name[c], f->training->noise_column[i]) != 0) {
            ++c;
        }
        if (c == m->observation.count) {
            return pm_fail(PM_ECONFIG, "%s: the scene measures no column \"%.64s\"",
                           f->training->noise_at, f->training->noise_column[i]);
        }
        m->noise[c] = f->training->noise[i];
    }
    memcpy(m->typical, m->observation.deviation, nz * sizeof *m->typical);
    f->extra[0] = (pm_checkpoint_field){"level", PM_FIT_MEASURED_POINT, m->point};
    f->extra[1] = (pm_checkpoint_field){"noise", m->observation.count, m->point_noise};
    f->extra[2] = (pm_checkpoint_field){"gaps", 2 * (int)nz, m->point_gap};
    f->extra[3] = (pm_checkpoint_field){"starts", m->nstart, m->point_start};
    f->nextra = 4;
    pm_fit_measured *measured = &f->measured;
    int *all = pm_arena_array(&f->arena, (size_t)measured->data->ntrajectory, sizeof *all);
    pm_tracks tracks;
    PM_TRY(pm_arena_status(&f->arena, "measurements"));
    for (int i = 0; i < measured->data->ntrajectory; ++i) {
        all[i] = i;
    }
    PM_TRY(pm_tracks_make(&tracks, f->training->scene, &measured->observation, measured->data,
                          measured->data->ntrajectory, all, f->training->seconds, true));
    // Counts the samples of all trajectories, and those that tracks use.
    for (int i = 0; i < tracks.count; ++i) {
        const pm_track *r = &tracks.track[i];
        measured->used += r->count;
        measured->samples += r->sample[r->count - 1] + 1;
    }
    const pm_status status = fill_states(f, &tracks);
    pm_tracks_free(&tracks);
    return status;
}

static void describe(const pm_fit *f) {
    const pm_fit_measured *m = &f->measured;
    printf("at most %d samples", m->data->ntime);
    if (m->used < m->samples) {
        printf(", of which %.0f %% are used, about dt = %g s apart",
               100.0 * (double)m->used / (double)m->samples, f->training->scene->physics.dt);
    }
}

// --- training ---

// Whether a learned constant of component i stays positive.
static bool is_positive(const pm_fit *f, int component, const char *name) {
    const pm_system *system = f->training->system;
    const int nsubsystem = system->scene->physics.nsubsystem;
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

// Writes a draw to theta. Draws begin from the weights as declared.
static void draw(void *context, int id, double *theta) {
    pm_fit *f = context;
    pm_trained_scatter(f->training->system, f->declared);
    pm_start_draw(f->training, id, theta);
}

// Whether the initial weights are chosen by short fits to windows (shooting/window_draws.h), or by
// fits to rates or one draw.
static bool searches_windows(const pm_fit *f) {
    return f->training->tries > 1 && (f->size <= MOST_SEARCHED || pm_training_hides(f->training));
}

static pm_status start(pm_fit *f) {
    return searches_windows(f) ? PM_OK : pm_fit_search_start(f);
}

// A fit in progress, as the schedule sees it.
typedef struct continuation_context {
    pm_fit *fit;
    pm_shooting *shooting;
} continuation_context;

// Notes a point of the continuation, from which the fit goes on if it is interrupted.
static pm_status keep_point(void *context, const pm_continuation_point *point) {
    const continuation_context *c = context;
    pm_fit_measured *m = &c->fit->measured;
    const pm_shooting *s = c->shooting;
    if (point->stage == PM_CONTINUATION_SHORT && m->point[0] == PM_CONTINUATION_STARTS) {
        // Names constants that the data hardly tell apart, once the starts of windows are known.
        // Gaps count as they will at the end, so that whole trajectories tell, and not single
        // windows.
        const pm_fit_measured *measured = &c->fit->measured;
        double *noise = pm_arena_array(&c->fit->arena, (size_t)c->shooting->ny, sizeof *noise);
        double *gap = pm_arena_array(&c->fit->arena, (size_t)c->shooting->nz, sizeof *gap);
        PM_TRY(pm_arena_status(&c->fit->arena, "a note on the constants"));
        for (int i = 0; i < c->shooting->ny; ++i) {
            noise[i] = fmax(measured->noise[i],
                            PM_CONTINUATION_EARLY_NOISE * c->shooting->tracks->deviation[i]);
        }
        for (int i = 0; i < c->shooting->nz; ++i) {
            gap[i] = c->shooting->terms.gap[i] / point->factor * PM_CONTINUATION_LAST_GAP;
        }
        PM_TRY(pm_identifiability_warn(c->shooting, noise, gap));
    }
    const double number[PM_FIT_MEASURED_POINT] = {point->stage,         point->length,
                                                  point->round,         point->factor,
                                                  point->damping,       point->progress.iterations,
                                                  point->progress.idle, point->progress.before};
    memcpy(m->point, number, sizeof number);
    memcpy(m->point_gap, s->terms.gap, (size_t)s->nz * sizeof *s->terms.gap);
    memcpy(m->point_gap + s->nz, s->terms.later, (size_t)s->nz * sizeof *s->terms.later);
    memcpy(m->point_noise, s->terms.noise, (size_t)s->ny * sizeof *s->terms.noise);
    memcpy(m->point_start, s->z, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    pm_shooting_weights(s, c->fit->theta);
    return pm_clock() - c->fit->saved > PM_FIT_CHECKPOINT_INTERVAL ? pm_fit_save(c->fit, false)
                                                                   : PM_OK;
}

// Puts the shooting where keep_point found it; the system has the weights already.
static pm_status restore_point(const pm_fit_measured *m, pm_shooting *s,
                               pm_continuation_point *point) {
    const double *number = m->point;
    *point = (pm_continuation_point){
        .stage = (int)number[0],
        .length = (int)number[1],
        .round = (int)number[2],
        .factor = number[3],
        .damping = number[4],
        .progress = {.iterations = (int)number[5], .idle = (int)number[6], .before = number[7]}};
    if (point->stage == PM_CONTINUATION_NONE) {
        return PM_OK;
    }
    PM_TRY(pm_shooting_divide(s, point->length));
    memcpy(s->z, m->point_start, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    memcpy(s->terms.noise, m->point_noise, (size_t)s->ny * sizeof *s->terms.noise);
    memcpy(s->terms.gap, m->point_gap, (size_t)s->nz * sizeof *s->terms.gap);
    memcpy(s->terms.later, m->point_gap + s->nz, (size_t)s->nz * sizeof *s->terms.later);
    printf("resumes with windows of %d\n", point->length);
    pm_shooting_evaluate(s, s->z, false);
    return s->failed;
}

static pm_status find_uncertainty(pm_fit *f, pm_shooting *s) {
    const pm_fit_measured *m = &f->measured;
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
        status = pm_identifiability_print(&u, s);
    }
    if (status == PM_OK) {
        status = pm_uncertainty_save(&u, f->arguments->output);
    }
    pm_uncertainty_free(&u);
    return status;
}

static pm_status run(pm_fit *f) {
    const pm_fit_measured *m = &f->measured;
    const pm_loss *loss = &f->training->stage[f->training->nstage - 1].loss;
    pm_tracks tracks;
    pm_shooting shooting = {0};
    PM_TRY(pm_tracks_make(&tracks, f->training->scene, &m->observation, m->data, f->split.ntraining,
                          f->split.trajectory, f->training->seconds, true));
    const pm_sensitivity_how how = {.system = f->training->system,
                                    .observation = &m->observation,
                                    .integrator = loss->integrator,
                                    .substeps = loss->substeps,
                                    .stretched = tracks.stretched};
    pm_status status;
    PM_TRY_DONE(pm_shooting_open(&shooting, &how, &tracks));
    pm_trained_scatter(f->training->system, f->theta);
    continuation_context context = {f, &shooting};
    pm_continuation continuation = {.given = m->noise,
                                    .typical = m->typical,
                                    .loud = true,
                                    .stop = f->stop,
                                    .keep = keep_point,
                                    .context = &context};
    for (int c = 0; c < shooting.nz; ++c) {
        shooting.terms.prior[c] = m->observation.hidden[c] ? m->observation.deviation[c] : 0;
    }
    // How far weights are expected to be from their declared values: weights of networks, whose
    // inputs and outputs have deviations of about 1; logarithms of positive constants; other
    // learned constants, which have units, so that little is known of them; and temperatures, since
    // coupled bodies leave a common factor of them nearly free.
    pm_shooting_terms *terms = &shooting.terms;
    size_t at = 0;
    memcpy(terms->first_weight, f->declared, (size_t)f->size * sizeof *terms->first_weight);
    for (int i = 0; i < pm_system_components(f->training->system); ++i) {
        const pm_params *params = pm_system_params(f->training->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const char *end = strrchr(entry->name, '.');
            const bool constant = strncmp(entry->name, "constant.", 9) == 0;
            const bool positive = constant && is_positive(f, i, entry->name + 9);
            const bool amplitude = end != NULL && strcmp(end, ".amplitude") == 0;
            for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++at) {
                terms->reach[at] = positive    ? PM_SHOOTING_REACH
                                   : constant  ? FAR_REACH * fmax(fabs(terms->first_weight[at]), 1)
                                   : amplitude ? TEMPERATURE_REACH
                                               : NETWORK_REACH;
                terms->early_reach[at] = positive ? EARLY_REACH : terms->reach[at];
            }
        }
    }
    // Short fits choose the initial weights, if these are random, so that draws differ.
    if (m->point[0] == PM_CONTINUATION_NONE && searches_windows(f) &&
        memcmp(f->theta, f->declared, (size_t)f->size * sizeof *f->theta) != 0) {
        const pm_shooting_search search = {.tries = f->training->tries,
                                           .iterations = f->training->try_iterations,
                                           .length =
                                               SEARCHED * pm_continuation_first_length(&shooting),
                                           .draw = draw,
                                           .context = f,
                                           .stop = f->stop};
        PM_TRY_DONE(pm_shooting_search_start(&shooting, &search));
        shooting.how.substeps = loss->substeps;
    }
    PM_TRY_DONE(restore_point(m, &shooting, &continuation.first_point));
    PM_TRY_DONE(pm_continuation_run(&shooting, &continuation));
    status = find_uncertainty(f, &shooting);
done:
    pm_shooting_close(&shooting);
    pm_tracks_free(&tracks);
    if (status == PM_EINTERRUPTED) {
        PM_TRY(pm_fit_save(f, false));
        return pm_fail(PM_EINTERRUPTED, "interrupted; continue with --resume");
    }
    return status;
}

static pm_status report(pm_fit *f, const pm_measure *black_box) {
    (void)black_box;
    const pm_fit_measured *m = &f->measured;
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

const pm_fit_kind pm_fit_of_measurements = {load, NULL, describe, start, NULL, run, report};

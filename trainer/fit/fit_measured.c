// Measurements in a fit: loading them, states for the scales of models, and multiple shooting.
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/rng.h"
#include "data/trained.h"
#include "data/unit_change.h"
#include "fit/fit.h"
#include "fit/normalization.h"
#include "fit/start.h"
#include "inference/black_box.h"
#include "inference/calibration.h"
#include "model/constants.h"
#include "model/training_range.h"
#include "scene/columns.h"
#include "shooting/continuation.h"
#include "shooting/window_draws.h"

#define NETWORK_REACH 10.0    // of weights, whose inputs have deviations of 1
#define TEMPERATURE_REACH 0.1 // of the logarithm of a temperature
#define UNLUCKY 0.3 // residual, over the deviation of a column, with which another start is tried
#define LEAST_RESIDUAL 1e-9 // likewise
#define OUTLIER 1e2         // deviations of the noise, which no residual counts more than
#define MOST_ATTEMPTS 3
// The attempt whose first windows are whole trajectories. Where the model is wrong by more than the
// noise, free starts of hidden components hide that in short windows, and lead the weights astray.
#define LONG_ATTEMPT 1
#define MISLED 4.0        // residuals over noise, where hidden components are fitted
#define LEAST_MISLED 1e-2 // of the deviation: residuals that are smaller mislead nobody
// Of the residual and of the part of a trajectory that the last windows do not have: half of it at
// least, unless windows became whole trajectories.
#define STOPPED 0.5
#define DISTURBED 0.7 // deviation of a constant of another start, of its logarithm or its size
// Records are divided into pieces for the calibration of bands if they are fewer than this.
#define FEWEST_RECORDS 4
#define PIECES 5
#define SHORTEST_PIECE 4 // lengths of the first windows
#define BANDS_SHARE 0.33 // of the work of the fit, which the calibration may take
#define WIDER 2.0        // deviation of the start of a piece, in that of all pieces
// Scales of models follow fitted trajectories where hidden components move further than this, in
// deviations of their starts.
#define FURTHER 3.0
#define HELD_REACH 1e-3    // of the weights of a network that is held at zero
#define FAINT 0.1          // of a draw: a factor of M beside a formula, which cannot begin at zero
#define BETTER 0.95        // error of unseen pieces, times that without networks beside formulas
#define NEGLIGIBLE 0.01    // of the deviation of a column over all trajectories
#define LEAST_COVERAGE 0.7 // of bands of 90 %, in a good fit
#define NORMAL 1.644854    // half the width of a band of 90 %, in deviations
#define UNKNOWN_ENERGY 0.1 // standard deviation of energies that is told, over their changes
#define MOST_REPORTED 8    // trajectories whose starts the report estimates
#define EARLY_REACH 1.0    // of the logarithm of a positive constant, before the last point
#define FAR_REACH 1e6      // of constants whose unit and size are not known
#define SWING 16           // steps in which hidden components swing once, in states that fix scales
#define ESTIMATED_PART 0.25 // of a trajectory, from which the report estimates its start
#define JUDGED 0.25         // of the time of a short fit, which the judgement may take besides
#define MOST_SEARCHED 400   // weights; with more, short fits to windows take too long
#define SEARCHED 2          // first window lengths of the windows that choose initial weights
#define EQUAL 1e-6          // relative difference of times that count as equal

// The phases of a fit with networks beside formulas (pm_fit_position.finer): formulas alone, with
// the networks, and formulas alone again, if unseen pieces were not predicted better.
enum { WITHOUT_NETWORKS, WITH_NETWORKS, WITHOUT_AGAIN };

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
            // Finds this column in the measurements. The time (no name) has no column.
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
    PM_TRY(state != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for measurements"));
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

// Divides each record into as many pieces of equal length as the training file says.
static pm_status divide_records(pm_fit *f) {
    pm_dataset *whole = f->measured.data, *pieces;
    const int each = f->training->pieces, count = whole->ntrajectory * each;
    pm_piece *piece = pm_arena_array(&f->arena, (size_t)count, sizeof *piece);
    PM_TRY(pm_arena_status(&f->arena, "pieces of records"));
    for (int i = 0; i < count; ++i) {
        const int64_t length = pm_dataset_length(whole, i / each);
        piece[i] = (pm_piece){.trajectory = i / each,
                              .first = (int)(length * (i % each) / each),
                              .end = (int)(length * (i % each + 1) / each)};
        if (piece[i].end - piece[i].first < 2) {
            return pm_fail(PM_EDATA, "%s: trajectory %d has %d samples: too few for %d pieces",
                           f->data, i / each, (int)length, each);
        }
    }
    PM_TRY(pm_dataset_cut(&pieces, whole, count, piece));
    pm_dataset_free(whole);
    f->measured.data = pieces;
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
    PM_TRY(f->training->pieces > 1 ? divide_records(f) : PM_OK);
    PM_TRY(pm_unit_change_apply(scene, m->data, true));
    PM_TRY(pm_observation_bind(&m->observation, f->training->system, m->data, &f->arena));
    const size_t ny = (size_t)m->observation.count;
    // Room for a point of the continuation, with the starts of the shortest windows.
    m->nstart = m->data->ntrajectory * (m->data->ntime / PM_CONTINUATION_LEAST + 1) * (int)nz;
    m->typical = pm_arena_array(&f->arena, nz, sizeof *m->typical);
    m->noise = pm_arena_array(&f->arena, ny, sizeof *m->noise);
    m->point_gap = pm_arena_array(&f->arena, 2 * nz, sizeof *m->point_gap);
    m->point_start = pm_arena_array(&f->arena, (size_t)m->nstart, sizeof *m->point_start);
    m->point_noise = pm_arena_array(&f->arena, ny, sizeof *m->point_noise);
    m->moved = pm_arena_array(&f->arena, nz, sizeof *m->moved);
    m->left_out = pm_arena_array(&f->arena, ny, sizeof *m->left_out);
    const int nsubsystem = f->training->scene->physics.nsubsystem;
    m->energy = pm_arena_array(&f->arena, (size_t)nsubsystem, sizeof *m->energy);
    for (int i = 0; i < nsubsystem && m->energy != NULL; ++i) {
        m->energy[i] = NAN;
    }
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
    f->extra[4] = (pm_checkpoint_field){"moved", (int)nz, m->moved};
    f->nextra = 5;
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
        measured->longest = r->count > measured->longest ? r->count : measured->longest;
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

// Writes a draw of the present attempt to theta. Draws begin from the weights as declared.
static void draw(void *context, int id, double *theta) {
    pm_fit *f = context;
    pm_trained_scatter(f->training->system, f->declared);
    pm_start_draw(f->training, id + f->position.attempt * f->training->tries, theta);
    for (int i = 0; i < f->size && f->position.finer != WITH_NETWORKS; ++i) {
        theta[i] = f->measured.beside[i] == 1 ? f->declared[i] : theta[i];
    }
    pm_trained_scatter(f->training->system, theta);
}

// Whether the initial weights are chosen by short fits to windows (shooting/window_draws.h), or by
// fits to rates or one draw.
static bool searches_windows(const pm_fit *f) {
    return f->training->tries > 1 &&
           (f->size <= MOST_SEARCHED || pm_scene_hides(f->training->scene));
}

static pm_status start(pm_fit *f) {
    double loss = NAN;
    return searches_windows(f) ? PM_OK : pm_fit_search_start(f, &loss);
}

// A fit in progress, as the schedule sees it.
typedef struct continuation_context {
    pm_fit *fit;
    pm_shooting *shooting;
    int steps;  // of a short fit so far
    int length; // of its windows
    bool ended; // a short fit has come to its end
} continuation_context;

// Notes a point of the continuation, from which the fit goes on if it is interrupted.
static pm_status keep_point(void *context, const pm_continuation_point *point) {
    continuation_context *c = context;
    pm_fit_measured *m = &c->fit->measured;
    const pm_shooting *s = c->shooting;
    const pm_fit_effort *effort = c->fit->arguments->effort;
    if (effort != NULL) {
        pm_shooting_weights(s, c->fit->theta);
        c->length = point->length;
        c->ended = ++c->steps > effort->iterations ||
                   (effort->seconds > 0 && s->work > effort->seconds * PM_SHOOTING_SPEED);
        return c->ended ? pm_fail(PM_EINTERRUPTED, "a short fit has come to its end") : PM_OK;
    }
    if (point->stage >= PM_CONTINUATION_SHORT && point->stride == 1 &&
        (m->point[0] < PM_CONTINUATION_SHORT || m->point[9] != 1)) {
        // The constants that the data hardly tell apart are named once all trajectories take part
        // and the starts of windows are known. Gaps count as they will at the end, so that whole
        // trajectories tell, and not single windows.
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
    const double number[PM_FIT_MEASURED_POINT] = {point->stage,
                                                  point->length,
                                                  point->round,
                                                  point->factor,
                                                  point->damping,
                                                  point->progress.iterations,
                                                  point->progress.idle,
                                                  point->progress.before,
                                                  point->finer,
                                                  point->stride,
                                                  point->gap};
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
        .progress = {.iterations = (int)number[5], .idle = (int)number[6], .before = number[7]},
        .finer = (int)number[8],
        .stride = (int)number[9],
        .gap = number[10]};
    if (point->stage == PM_CONTINUATION_NONE) {
        return PM_OK;
    }
    s->stride = point->stride;
    PM_TRY(pm_shooting_divide(s, point->length));
    memcpy(s->z, m->point_start, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    memcpy(s->terms.noise, m->point_noise, (size_t)s->ny * sizeof *s->terms.noise);
    memcpy(s->terms.gap, m->point_gap, (size_t)s->nz * sizeof *s->terms.gap);
    memcpy(s->terms.later, m->point_gap + s->nz, (size_t)s->nz * sizeof *s->terms.later);
    printf("resumes with windows of %d\n", point->length);
    pm_shooting_evaluate(s, s->z, false);
    return s->failed;
}

// The pieces of few records, with a shooting in which each piece is a trajectory of its own.
typedef struct divided_fit {
    pm_arena arena;
    pm_dataset *data;
    pm_observation observation;
    pm_tracks tracks;
    pm_shooting shooting;
    int *which; // [tracks.count]
} divided_fit;

// Divides the records of a fit into `pieces` each, which begin in the fitted states.
static pm_status divide(divided_fit *d, const pm_fit *f, const pm_shooting *s, int pieces) {
    const pm_dataset *whole = f->measured.data;
    const size_t nz = (size_t)s->nz;
    const int count = s->tracks->count * pieces;
    double *begin = pm_arena_array(&d->arena, (size_t)count * nz, sizeof *begin);
    pm_piece *piece = pm_arena_array(&d->arena, (size_t)count, sizeof *piece);
    d->which = pm_arena_array(&d->arena, (size_t)count, sizeof *d->which);
    d->observation = s->observation[0];
    d->observation.guess = pm_arena_array(&d->arena, nz, sizeof *begin);
    d->observation.deviation = pm_arena_array(&d->arena, nz, sizeof *begin);
    PM_TRY(pm_arena_status(&d->arena, "pieces of records"));
    for (int i = 0; i < count; ++i) {
        const int from = i / pieces;
        const pm_track *t = &s->tracks->track[from];
        const int first = (int)((long)(i % pieces) * t->count / pieces);
        const int end = (int)((long)(i % pieces + 1) * t->count / pieces);
        d->which[i] = i;
        piece[i] = (pm_piece){.trajectory = f->split.trajectory[from],
                              .first = t->sample[first],
                              .end = t->sample[end - 1] + 1};
        memcpy(begin + (size_t)i * nz, s->state[from] + (size_t)first * nz, nz * sizeof *begin);
    }
    PM_TRY(pm_dataset_cut(&d->data, whole, count, piece));
    // A piece may begin wherever the fitted trajectories have been.
    for (int c = 0; c < s->nz; ++c) {
        double sum = 0, square = 0;
        for (int i = 0; i < count; ++i) {
            sum += begin[(size_t)i * nz + (size_t)c] / count;
        }
        for (int i = 0; i < count; ++i) {
            const double away = begin[(size_t)i * nz + (size_t)c] - sum;
            square += away * away / count;
        }
        d->observation.guess[c] = sum;
        d->observation.deviation[c] = fmax(
            s->observation->hidden[c] ? s->observation->deviation[c] : 0, WIDER * sqrt(square));
    }
    PM_TRY(pm_tracks_make(&d->tracks, f->training->scene, &d->observation, d->data, count, d->which,
                          f->training->seconds, true));
    pm_sensitivity_how how = s->how;
    how.observation = &d->observation;
    PM_TRY(pm_shooting_open(&d->shooting, &how, &d->tracks));
    pm_shooting_terms *terms = &d->shooting.terms;
    const size_t weights = (size_t)s->nweight * sizeof(double);
    memcpy(terms->noise, s->terms.noise, (size_t)s->ny * sizeof(double));
    memcpy(terms->gap, s->terms.gap, nz * sizeof(double));
    memcpy(terms->first_weight, s->terms.first_weight, weights);
    memcpy(terms->reach, s->terms.reach, weights);
    for (int c = 0; c < s->nz; ++c) {
        terms->prior[c] = s->observation->hidden[c] ? d->observation.deviation[c] : 0;
    }
    PM_TRY(pm_shooting_divide(&d->shooting, d->data->ntime));
    memcpy(d->shooting.z, begin, (size_t)count * nz * sizeof *begin);
    return PM_OK;
}

// Finds the covariance of the weights and calibrates the bands. If `final`, it prints and saves
// them.
static pm_status find_uncertainty(pm_fit *f, pm_shooting *s, bool final) {
    const pm_fit_measured *m = &f->measured;
    const int ntrack = s->tracks->count;
    pm_uncertainty u = {0};
    divided_fit d = {0};
    // The states that the weights were trained on are those of the fitted trajectories.
    for (int i = 0; i < f->training->scene->physics.nsubsystem; ++i) {
        pm_training_range_clear(f->training->system->part[i]);
        for (int t = 0; t < ntrack; ++t) {
            for (int k = 0; k < s->tracks->track[t].count; ++k) {
                pm_training_range_widen(f->training->system->part[i],
                                        s->state[t] + (ptrdiff_t)k * s->nz +
                                            f->training->scene->physics.subsystem[i].first);
            }
        }
    }
    pm_calibration_how how = {.data = m->data,
                              .which = f->split.trajectory,
                              .nheld = f->split.nvalidation,
                              .held = f->split.trajectory + f->split.ntraining,
                              .until = f->training->seconds,
                              .work = BANDS_SHARE * s->work,
                              .error = m->left_out,
                              .stop = f->stop};
    pm_status status;
    for (int c = 0; c < s->ny; ++c) {
        m->left_out[c] = NAN;
    }
    status = pm_uncertainty_make(&u, s);
    if (status == PM_ENUMERIC) {
        printf("there are no bands: %s\n", pm_error());
        status = PM_OK;
        goto done;
    }
    PM_TRY_DONE(status);
    // Few records are divided into pieces, so that there is something to leave out.
    const int pieces = (PIECES + ntrack - 1) / ntrack;
    int shortest = INT_MAX;
    for (int i = 0; i < ntrack; ++i) {
        const int own = s->tracks->track[i].count;
        shortest = own < shortest ? own : shortest;
    }
    const bool divides = ntrack < FEWEST_RECORDS && how.nheld < FEWEST_RECORDS &&
                         shortest / pieces >= SHORTEST_PIECE * pm_continuation_first_length(s);
    if (divides) {
        PM_TRY_DONE(divide(&d, f, s, pieces));
        how.data = d.data;
        how.which = d.which;
        how.nheld = 0;
    }
    PM_TRY_DONE(pm_calibration_make(&u, divides ? &d.shooting : s, &how));
    if (final) {
        pm_uncertainty_print(&u, s);
        PM_TRY_DONE(pm_uncertainty_energies(&u, s, m->energy));
        PM_TRY_DONE(pm_identifiability_print(&u, s));
        status = pm_uncertainty_save(&u, f->arguments->output);
    }
done:
    pm_shooting_close(&d.shooting);
    pm_tracks_free(&d.tracks);
    pm_dataset_free(d.data);
    pm_arena_free(&d.arena);
    pm_uncertainty_free(&u);
    return status;
}

// Marks weight `at` as an optional constant, with those constants of its component that mean
// nothing without it. `first` is the first weight of the component.
static void mark_optional(const pm_fit *f, const pm_params *params, size_t first, size_t at,
                          bool positive, const char *without) {
    unsigned char *own = &f->measured.optional[at * (size_t)f->size];
    for (int k = 0; k < params->count; ++k) {
        const pm_param_entry *entry = &params->entry[k];
        const char *name = entry->trained ? pm_constant_name(entry->name) : NULL;
        const size_t length = name == NULL ? 0 : strlen(name);
        for (const char *place = without; name != NULL && (place = strstr(place, name)) != NULL;
             place += length) {
            if (place[-1] == ' ' && place[length] == ' ') {
                own[first] = PM_WEIGHT_OPTIONAL;
            }
        }
        first += entry->trained ? (size_t)(entry->rows * entry->cols) : 0;
    }
    own[at] = positive ? PM_LOGARITHM_OPTIONAL : PM_WEIGHT_OPTIONAL;
}

// How far weights are expected to be from their declared values: weights of networks, whose inputs
// and outputs have deviations of about 1; logarithms of positive constants; other learned
// constants, which have units, so that little is known of them; and temperatures, since coupled
// bodies leave a common factor of them nearly free.
//
// Also marks the weights of networks beside formulas with learned constants, in the same energy or
// the same operator. Until WITH_NETWORKS they stay where they are.
static void set_reaches(const pm_fit *f, pm_shooting_terms *terms) {
    size_t at = 0;
    memcpy(terms->first_weight, f->declared, (size_t)f->size * sizeof *terms->first_weight);
    for (int i = 0; i < pm_system_components(f->training->system); ++i) {
        const pm_system *system = f->training->system;
        const int nsubsystem = system->scene->physics.nsubsystem;
        const pm_params *params = pm_system_params(f->training->system, i);
        const pm_part_spec *part = i < nsubsystem ? &system->part[i]->spec : NULL;
        const pm_port_spec *port = part == NULL ? &system->port[i - nsubsystem]->spec : NULL;
        const pm_constants *known = part != NULL ? part->constants : port->constants;
        const pm_operator_spec *M = part != NULL ? &part->irreversible : &port->irreversible;
        const bool learns = known != NULL && known->learned != NULL;
        const bool energy = learns && part != NULL && part->energy.nformula > 0;
        const bool friction = learns && M->ngiven > 0 && M->learned;
        const size_t first = at;
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const char *end = strrchr(entry->name, '.');
            const char *constant = pm_constant_name(entry->name);
            const bool beside = (energy && strncmp(entry->name, "energy.", 7) == 0) ||
                                (friction && strncmp(entry->name, "irreversible.matrix.", 20) == 0);
            const bool linear = beside && strstr(entry->name, ".layer") == NULL;
            const bool held = linear && f->position.finer != WITH_NETWORKS;
            bool positive = false;
            const char *without = NULL;
            for (int j = 0; constant != NULL && learns && j < known->count; ++j) {
                if (strcmp(known->name[j], constant) == 0) {
                    positive = known->learned[j] == PM_CONSTANT_POSITIVE;
                    without = known->optional == NULL ? NULL : known->optional[j];
                }
            }
            if (f->measured.optional != NULL && without != NULL) {
                mark_optional(f, params, first, at, positive, without);
            } else if (f->measured.optional != NULL && positive) {
                f->measured.optional[at * ((size_t)f->size + 1)] = PM_LOGARITHM_NEEDED;
            }
            const bool amplitude = end != NULL && strcmp(end, ".amplitude") == 0;
            for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++at) {
                f->measured.beside[at] = linear ? 1 : beside ? 2 : 0;
                terms->reach[at] = positive ? PM_SHOOTING_REACH
                                   : held   ? HELD_REACH
                                   : constant != NULL
                                       ? FAR_REACH * fmax(fabs(terms->first_weight[at]), 1)
                                   : amplitude ? TEMPERATURE_REACH
                                               : NETWORK_REACH;
                terms->early_reach[at] = positive ? EARLY_REACH : terms->reach[at];
            }
        }
    }
}

// Begins the next phase, with networks beside formulas or without them. f->moment keeps the weights
// of the first one.
static void begin_phase(pm_fit *f, pm_shooting *s, int phase) {
    pm_fit_position *p = &f->position;
    if (phase == WITH_NETWORKS) {
        pm_shooting_weights(s, f->moment);
    }
    p->finer = phase;
    p->attempt = 0;
    p->loss = 0;
    draw(f, 0, f->theta);
    for (int i = 0; i < f->size; ++i) {
        const double drawn = f->theta[i] - f->declared[i];
        const bool joins = f->measured.beside[i] == 1 && phase == WITH_NETWORKS;
        f->theta[i] = joins                        ? f->declared[i] + FAINT * drawn
                      : f->measured.beside[i] == 2 ? f->theta[i]
                                                   : f->moment[i];
    }
    pm_trained_scatter(f->training->system, f->theta);
    f->measured.point[0] = PM_CONTINUATION_NONE;
    pm_shooting_clear(s);
    memset(s->terms.later, 0, (size_t)s->nz * sizeof *s->terms.later);
    set_reaches(f, &s->terms);
}

// Trains from the start of the present attempt, or from where it was interrupted. *end is where the
// continuation ended.
static pm_status attempt(pm_fit *f, pm_shooting *s, pm_continuation *continuation, int substeps,
                         pm_continuation_point *end) {
    const pm_fit_measured *m = &f->measured;
    const pm_fit_position *p = &f->position;
    pm_shooting_set_substeps(s, substeps);
    if (m->point[0] == PM_CONTINUATION_NONE && p->attempt < MOST_ATTEMPTS) {
        if (p->attempt > 0) {
            draw(f, 0, f->theta);
        }
        // Short fits choose the initial weights, if these are random, so that draws differ.
        const bool drawn = p->finer == WITHOUT_NETWORKS || p->attempt > 0;
        if (drawn && searches_windows(f) &&
            memcmp(f->theta, f->declared, (size_t)f->size * sizeof *f->theta) != 0) {
            const pm_shooting_search search = {.tries = f->training->tries,
                                               .iterations = f->training->try_iterations,
                                               .length = SEARCHED * pm_continuation_first_length(s),
                                               .draw = draw,
                                               .context = f,
                                               .stop = f->stop};
            PM_TRY(pm_shooting_search_start(s, &search));
            pm_shooting_set_substeps(s, substeps);
        } else if (p->attempt > LONG_ATTEMPT) {
            // Moves the constants at random, positive ones by a factor.
            pm_rng rng;
            pm_rng_init(&rng, f->training->seed, (uint64_t)p->attempt);
            for (int i = 0; i < f->size; ++i) {
                const bool positive = s->terms.early_reach[i] < s->terms.reach[i];
                const bool constant = positive || s->terms.reach[i] >= FAR_REACH;
                const double size = positive ? 1 : constant ? fabs(f->theta[i]) : 0;
                f->theta[i] += DISTURBED * size * pm_rng_normal(&rng);
            }
            pm_trained_scatter(f->training->system, f->theta);
        }
    }
    const bool whole = p->attempt == MOST_ATTEMPTS ? p->loss < STOPPED : p->attempt == LONG_ATTEMPT;
    const pm_fit_effort *effort = f->arguments->effort;
    const bool good = effort != NULL ? effort->whole : f->training->whole && p->attempt == 0;
    continuation->first = whole || good ? pm_continuation_longest(s) : 0;
    s->terms.huber = whole ? INFINITY : f->measured.huber;
    PM_TRY(restore_point(m, s, &continuation->first_point));
    const pm_status status = pm_continuation_run(s, continuation, end);
    continuation_context *c = continuation->context;
    if (status == PM_EINTERRUPTED && c->ended) {
        *end = (pm_continuation_point){.length = c->length, .gap = INFINITY}; // not known
        c->steps = 0;
        c->ended = false;
        return PM_OK;
    }
    return status;
}

// Lets the hidden components of the states that fix the scales of models vary by m->moved, and
// fixes the scales again.
static pm_status follow_moves(pm_fit *f) {
    const pm_fit_measured *m = &f->measured;
    const pm_dataset *d = f->dataset;
    for (int c = 0; c < f->training->scene->physics.nz; ++c) { // columns are those of components
        for (long k = 0; m->moved[c] > 0 && k < (long)d->ntrajectory * d->ntime; ++k) {
            double *x = d->z + k * d->ncolumn + c;
            *x = m->observation.guess[c] + (*x - m->observation.guess[c]) * m->moved[c];
        }
    }
    pm_samples samples;
    PM_TRY(pm_samples_make(&samples, f->training->scene, f->dataset, 0, f->split.ntraining,
                           PM_RESIDUAL_STEP, 1, 1));
    const pm_status status =
        pm_normalization_of_system(f->training->system, &samples, f->training->plain);
    pm_samples_free(&samples);
    return status;
}

// Finds hidden components that move much further than their starts are uncertain. Returns whether
// there are any, and writes m->moved.
static bool find_moves(pm_fit *f, const pm_shooting *s) {
    bool any = false;
    for (int c = 0; c < s->nz; ++c) {
        double square = 0;
        long n = 0;
        for (int i = 0; i < s->tracks->count; ++i) {
            for (int k = 0; k < s->tracks->track[i].count; ++k, ++n) {
                const double away =
                    s->state[i][(ptrdiff_t)k * s->nz + c] - s->observation->guess[c];
                square += away * away;
            }
        }
        const double own = sqrt(square / (double)n) / s->observation->deviation[c];
        const bool further = s->observation->hidden[c] && isfinite(own) && own > FURTHER;
        f->measured.moved[c] = further ? own : 0;
        any = any || further;
        if (further) {
            printf("%s moves by %.3g, and its start has a deviation of %.3g: scales of networks "
                   "follow, and the fit begins again\n",
                   s->observation->component_name[c], own * s->observation->deviation[c],
                   s->observation->deviation[c]);
        }
    }
    return any;
}

static bool hides(const pm_fit *f) {
    bool any = false;
    for (int c = 0; c < f->training->scene->physics.nz; ++c) {
        any = any || f->measured.observation.hidden[c];
    }
    return any;
}

// Returns whether hidden starts may have misled the weights: residuals are much larger than what
// differs from sample to sample.
static bool misled(const pm_fit *f, const pm_shooting *s) {
    size_t all = 1;
    double excess = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        all += (size_t)s->tracks->track[i].count;
    }
    double *size = malloc(all * sizeof *size);
    for (int c = 0; c < s->ny && size != NULL; ++c) {
        double error;
        const double noise = pm_uncertainty_independent(s, c, size, &error);
        excess += noise > 0 ? log(s->terms.noise[c] / noise) / s->ny : 0;
    }
    free(size);
    return hides(f) && exp(excess) > MISLED;
}

// Returns whether a fit whose last windows have `length` of `longest` samples has not shown that it
// can predict longer ones. If the gaps together are smaller than the noise, windows are one
// solution, from which others depart too fast for longer windows.
static bool stopped_short(double length, int longest, double gap) {
    return length < longest && !(gap * sqrt(longest / length) < 1);
}

// Trains, and tries other starts where the first one does not lead to a model.
static pm_status try_starts(pm_fit *f, pm_shooting *s, pm_continuation *continuation,
                            int substeps) {
    pm_fit_position *p = &f->position;
    for (;;) {
        pm_continuation_point end = {.length = 0};
        const pm_status status = attempt(f, s, continuation, substeps, &end);
        PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
        // The root mean square residual over the deviation of a column: the geometric mean.
        // Outliers are cut.
        double residual = status == PM_OK ? 0 : INFINITY;
        for (int c = 0; c < s->ny && status == PM_OK; ++c) {
            double square = 0, most = OUTLIER * s->terms.noise[c];
            long n = 0;
            for (int i = 0; i < s->tracks->count; i += s->stride) {
                for (int k = 0; k < s->tracks->track[i].count; ++k) {
                    const ptrdiff_t at = (ptrdiff_t)k * s->ny + c;
                    const bool measured = isfinite(s->tracks->track[i].y[at]);
                    const double r = fmin(fabs(s->residual[i][at]), most);
                    square += measured ? r * r : 0;
                    n += measured;
                }
            }
            const double own = n > 0 ? sqrt(square / (double)n) / s->tracks->deviation[c] : 0;
            residual += log(fmax(own, LEAST_RESIDUAL)) / s->ny;
        }
        residual = exp(residual);
        const int longest = pm_continuation_longest(s);
        // The free starts of hidden components close any gap.
        const double gap = hides(f) ? INFINITY : end.gap;
        const bool stopped = status != PM_OK || stopped_short(end.length, longest, gap);
        residual += stopped ? 1 - end.length / (double)longest : 0;
        const bool last = p->attempt == MOST_ATTEMPTS;
        bool known = f->training->plain || s->nweight == 0;
        for (int c = 0; c < s->nz; ++c) {
            known = known || f->measured.moved[c] > 0;
        }
        double *drawn = f->moment + f->size; // room that no optimiser of this fit needs
        draw(f, 0, drawn);
        const bool random = memcmp(drawn, f->declared, (size_t)f->size * sizeof *drawn) != 0;
        pm_shooting_set_weights(s, s->theta);
        if (status == PM_OK && !known && random && p->attempt == 0 && find_moves(f, s)) {
            PM_TRY(follow_moves(f));
            draw(f, 0, f->theta);
            f->measured.point[0] = PM_CONTINUATION_NONE;
            pm_shooting_clear(s);
            memset(s->terms.later, 0, (size_t)s->nz * sizeof *s->terms.later);
            continue;
        }
        if (isfinite(residual) && (p->loss == 0 || residual < p->loss)) {
            pm_shooting_weights(s, f->best);
            p->loss = p->best = residual; // also for a fit that is interrupted in a later attempt
            p->best_done = p->attempt;
        }
        const bool spent = continuation->work > 0 && s->work > continuation->work;
        if (f->arguments->effort != NULL && (p->attempt == LONG_ATTEMPT || spent)) {
            pm_shooting_set_weights(s, p->loss > 0 ? f->best : s->theta);
            return p->loss > 0 ? PM_OK
                               : pm_fail(PM_EUNFIT, "no start leads to a model: %s", pm_error());
        }
        const bool doubted = p->attempt == 0 && residual > LEAST_MISLED && misled(f, s);
        const bool good = p->loss > 0 && p->loss < UNLUCKY && !doubted;
        const bool best = p->best_done == p->attempt && p->loss > 0;
        // The best start taken again may lead to worse weights than before.
        if (last && p->loss > 0 && !(residual <= p->loss)) {
            pm_shooting_set_weights(s, f->best);
            return PM_OK;
        }
        if ((good && best) || last || f->training->plain || f->size == 0 ||
            (p->attempt + 1 == MOST_ATTEMPTS && best)) {
            return isfinite(residual)
                       ? PM_OK
                       : pm_fail(PM_EUNFIT, "no start leads to a model: %s", pm_error());
        }
        if (p->attempt + 1 == MOST_ATTEMPTS && p->loss == 0) {
            return pm_fail(PM_EUNFIT, "no start leads to a model: %s", pm_error());
        }
        if (status == PM_OK && stopped) {
            printf("the fit stopped at windows of %d of %d samples: ", end.length, longest);
        } else if (status == PM_OK) {
            printf("the residuals are %.3g %% of the deviation, much more than noise: ",
                   100 * residual);
        } else {
            printf("%s: ", pm_error());
        }
        // A model that cannot be integrated over two samples is not tried over whole trajectories.
        const bool broken = status == PM_ENUMERIC && p->attempt + 1 == LONG_ATTEMPT;
        p->attempt = good ? MOST_ATTEMPTS : p->attempt + (broken ? 2 : 1);
        printf(p->attempt < MOST_ATTEMPTS ? "another start is tried\n"
                                          : "the best start is taken again\n");
        f->measured.point[0] = PM_CONTINUATION_NONE;
        pm_shooting_clear(s);
        memset(s->terms.later, 0, (size_t)s->nz * sizeof *s->terms.later);
        if (p->attempt == MOST_ATTEMPTS) {
            memcpy(f->theta, f->best, (size_t)f->size * sizeof *f->theta);
            pm_trained_scatter(f->training->system, f->theta);
        }
    }
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
                                    .substeps = f->training->substeps,
                                    .stretched = tracks.stretched};
    pm_status status;
    PM_TRY_DONE(pm_shooting_open(&shooting, &how, &tracks));
    pm_trained_scatter(f->training->system, f->theta);
    f->measured.huber = shooting.terms.huber;
    f->measured.misfit = NAN;
    continuation_context context = {.fit = f, .shooting = &shooting};
    pm_continuation continuation = {.given = m->noise,
                                    .typical = m->typical,
                                    .loud = true,
                                    .stop = f->stop,
                                    .work = f->arguments->effort == NULL
                                                ? 0
                                                : f->arguments->effort->seconds * PM_SHOOTING_SPEED,
                                    .keep = keep_point,
                                    .context = &context};
    for (int c = 0; c < shooting.nz; ++c) {
        shooting.terms.prior[c] = m->observation.hidden[c] ? m->observation.deviation[c] : 0;
    }
    f->measured.beside = pm_arena_array(&f->arena, (size_t)f->size + 1, 1);
    if (f->arguments->effort != NULL) {
        const size_t n = (size_t)f->size;
        f->measured.optional = pm_arena_array(&f->arena, n * n + 1, 1);
        f->measured.spare = pm_arena_array(&f->arena, n + 1, sizeof *f->measured.spare);
    }
    PM_TRY_DONE(pm_arena_status(&f->arena, "networks beside formulas"));
    set_reaches(f, &shooting.terms);
    for (int c = 0; c < shooting.nz; ++c) {
        if (m->moved[c] > 0) { // resumed
            PM_TRY_DONE(follow_moves(f));
            break;
        }
    }
    for (int i = 0; i < f->size && f->position.finer == WITHOUT_NETWORKS; ++i) {
        f->theta[i] = m->beside[i] == 1 ? f->declared[i] : f->theta[i];
    }
    pm_trained_scatter(f->training->system, f->theta);
    for (bool over = false; !over;) {
        PM_TRY_DONE(try_starts(f, &shooting, &continuation, how.substeps));
        const int phase = f->position.finer;
        // A short fit is judged by its caller.
        over = f->arguments->effort != NULL || memchr(m->beside, 1, (size_t)f->size + 1) == NULL ||
               phase == WITHOUT_AGAIN;
        if (over) {
            break;
        }
        // Networks beside formulas stay only if pieces that the fit has not seen are predicted
        // better with them.
        PM_TRY_DONE(find_uncertainty(f, &shooting, false));
        double error = 0;
        for (int c = 0; c < shooting.ny; ++c) {
            error += log(m->left_out[c]) / shooting.ny;
        }
        if (phase == WITHOUT_NETWORKS) {
            f->position.robust = exp(error);
            begin_phase(f, &shooting, WITH_NETWORKS);
            continue;
        }
        const double before = f->position.robust;
        over = exp(error) < BETTER * before || isnan(error) || isnan(before);
        printf(
            "networks beside formulas: unseen pieces are predicted to %.3g %% with them, to %.3g "
            "%% without: they %s\n",
            100 * exp(error), 100 * before, over ? "stay" : "are left out");
        if (!over) {
            begin_phase(f, &shooting, WITHOUT_AGAIN);
        }
    }
    pm_shooting_weights(&shooting, f->theta);
    f->position.best = -1;
    for (int i = 0; i < f->size; ++i) { // what is left out vanishes
        const bool out = m->beside[i] == 1 && f->position.finer == WITHOUT_AGAIN;
        f->theta[i] = out ? f->declared[i] : f->theta[i];
    }
    pm_shooting_set_weights(&shooting, f->theta);
    // The likelihood of the last residuals, each column with their root mean square as its noise.
    f->measured.misfit = 0;
    for (int c = 0; c < shooting.ny; ++c) {
        double square = 0, n = 0;
        for (int i = 0; i < tracks.count; i += shooting.stride) {
            const pm_track *track = &tracks.track[i];
            for (ptrdiff_t k = c; k < (ptrdiff_t)track->count * shooting.ny; k += shooting.ny) {
                const double r = shooting.residual[i][k];
                square += isfinite(track->y[k]) ? r * r : 0;
                n += isfinite(track->y[k]);
            }
        }
        f->measured.misfit += n > 0 ? n * log(sqrt(square / n)) : 0;
    }
    status = f->arguments->effort == NULL ? find_uncertainty(f, &shooting, true)
                                          : pm_uncertainty_spare(&shooting, m->optional, m->spare);
done:
    f->measured.seconds += shooting.work / PM_SHOOTING_SPEED;
    if (status == PM_EINTERRUPTED && context.ended) { // a short fit
        status = PM_OK;
    }
    pm_shooting_close(&shooting);
    pm_tracks_free(&tracks);
    if (status == PM_EINTERRUPTED) {
        PM_TRY(pm_fit_save(f, false));
        return pm_fail(PM_EINTERRUPTED, "interrupted; continue with --resume");
    }
    return status;
}

// Predicts the columns of the trajectories `judged` [count] by a black box that is trained on the
// training part, and writes the medians of their errors to error [ny]. PM_EDATA: there are too few
// samples for a black box; PM_ENOMEM.
static pm_status run_black_box(pm_fit *f, const pm_estimate *e, const int *judged, double seconds,
                               double *error, pm_black_box *chosen) {
    const pm_fit_measured *m = &f->measured;
    const pm_scene *scene = f->training->scene;
    const bool held = f->split.nvalidation > 0;
    const int ntraining = f->split.ntraining, count = ntraining + (held ? e->count : 0);
    const int ninput = scene->physics.nprescribed, width = e->ny + ninput;
    pm_arena arena = {0};
    pm_tracks tracks = {0};
    int *list = pm_arena_array(&arena, (size_t)count, sizeof *list);
    int *ntime = pm_arena_array(&arena, (size_t)count, sizeof *ntime);
    int *given = pm_arena_array(&arena, (size_t)count, sizeof *given);
    double **row = pm_arena_array(&arena, (size_t)count, sizeof *row);
    double **out = pm_arena_array(&arena, (size_t)count, sizeof *out);
    pm_estimate own = *e;
    own.y =
        pm_arena_array(&arena, (size_t)e->count * (size_t)e->ntime * (size_t)e->ny, sizeof *own.y);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a black box"));
    memcpy(list, f->split.trajectory, (size_t)ntraining * sizeof *list);
    memcpy(list + ntraining, judged, (size_t)(count - ntraining) * sizeof *list);
    PM_TRY_DONE(pm_tracks_make(&tracks, scene, &m->observation, m->data, count, list,
                               f->training->seconds, true));
    for (int i = 0; i < count; ++i) {
        const pm_track *t = &tracks.track[i];
        ntime[i] = 1 + (int)lround((t->time[t->count - 1] - t->time[0]) / scene->physics.dt);
        given[i] = 1 + (int)(seconds / scene->physics.dt);
        row[i] = pm_arena_array(&arena, (size_t)ntime[i] * (size_t)width, sizeof **row);
        out[i] = pm_arena_array(&arena, (size_t)ntime[i] * (size_t)e->ny, sizeof **out);
    }
    PM_TRY_DONE(pm_arena_status(&arena, "a black box"));
    for (int i = 0; i < count; ++i) {
        const pm_track *t = &tracks.track[i];
        given[i] = given[i] < ntime[i] ? given[i] : ntime[i] - 1;
        for (int k = 0; k < ntime[i] * width; ++k) {
            row[i][k] = NAN;
        }
        for (int k = 0; k < t->count; ++k) {
            const long at = lround((t->time[k] - t->time[0]) / scene->physics.dt);
            double *to = row[i] + at * width;
            memcpy(to, t->y + (ptrdiff_t)k * e->ny, (size_t)e->ny * sizeof *to);
            if (ninput > 0) {
                memcpy(to + e->ny, t->now + (ptrdiff_t)k * ninput, (size_t)ninput * sizeof *to);
            }
        }
    }
    const pm_black_box_data data = {.nvalue = e->ny,
                                    .ninput = ninput,
                                    .count = count,
                                    .ntraining = ntraining,
                                    .ntime = ntime,
                                    .row = row,
                                    .given = given};
    PM_TRY_DONE(pm_black_box_predict(&data, PM_FIT_BLACK_BOX_SECONDS, out, chosen));
    for (int i = 0; i < e->count; ++i) {
        const pm_track *t = &tracks.track[held ? ntraining + i : i];
        const double *runs = out[held ? ntraining + i : i];
        double *y = own.y + (ptrdiff_t)i * e->ntime * e->ny;
        for (int k = 0; k < t->count; ++k) {
            const long at = lround((t->time[k] - t->time[0]) / scene->physics.dt);
            memcpy(y + (ptrdiff_t)t->sample[k] * e->ny, runs + at * e->ny,
                   (size_t)e->ny * sizeof *y);
        }
    }
    for (int c = 0; c < e->ny; ++c) {
        error[c] = pm_estimate_errors(&own, &m->observation, m->data, judged, seconds, c).median;
    }
done:
    pm_tracks_free(&tracks);
    pm_arena_free(&arena);
    return status;
}

static void print_percent(double value) {
    if (isnan(value)) {
        printf(" %10s", "-");
    } else {
        printf(" %10.3g", 100 * value);
    }
}

// Writes to *error how far predictions of the trajectories `which` [count] are off with the weights
// that the models have: the geometric mean over columns, infinite where there are none.
static pm_status find_error(const pm_fit *f, const pm_estimate_how *how, int count,
                            const int *which, double *error) {
    const pm_observation *o = &f->measured.observation;
    pm_estimate e = {0};
    const pm_status status =
        pm_estimate_make(&e, f->training->system, o, f->measured.data, count, which, how);
    double sum = status == PM_OK ? 0 : INFINITY;
    for (int c = 0; c < o->count && status == PM_OK; ++c) {
        sum += log(pm_estimate_typical_error(&e, o, f->measured.data, which, how->seconds, c));
    }
    *error = isnan(sum) ? INFINITY : exp(sum / o->count);
    pm_estimate_free(&e);
    return status == PM_ENUMERIC ? PM_OK : status;
}

// A fit that goes on where a proposal ended, and is interrupted while its windows are short, may be
// worse than what it began with. The better weights are kept; the fit goes on with its own.
static pm_status keep_better(pm_fit *f, const pm_estimate_how *how, int count, const int *which) {
    const pm_fit_measured *m = &f->measured;
    if (!f->interrupted || !f->training->whole || f->position.best >= 0 ||
        !(m->point[1] < m->longest)) {
        return PM_OK;
    }
    double own = INFINITY, declared = INFINITY;
    PM_TRY(find_error(f, how, count, which, &own));
    pm_trained_scatter(f->training->system, f->declared);
    PM_TRY(find_error(f, how, count, which, &declared));
    if (declared < own) {
        memcpy(f->best, f->declared, (size_t)f->size * sizeof *f->best);
        f->position.best = declared;
        printf("The weights of the training file predict better than those of windows of %.0f of "
               "%d samples, and are kept.\n",
               m->point[1], m->longest);
    }
    pm_trained_scatter(f->training->system, pm_fit_kept(f));
    return PM_OK;
}

static pm_status report(pm_fit *f, const pm_measure *ignored) {
    (void)ignored;
    const pm_fit_measured *m = &f->measured;
    const bool validation = f->split.nvalidation > 0;
    const char *where = validation ? "validation" : "training";
    const int all = validation ? f->split.nvalidation : f->split.ntraining;
    const int count = all < MOST_REPORTED ? all : MOST_REPORTED, ny = m->observation.count;
    const int *which = f->split.trajectory + (validation ? f->split.ntraining : 0);
    const double seconds = ESTIMATED_PART * (f->dataset->ntime - 1) * f->dataset->dt;
    pm_estimate e = {0};
    pm_uncertainty u = {0};
    pm_arena arena = {0};
    pm_black_box box = {.tried = 0};
    pm_verdict v = {.count = 0};
    double *black = pm_arena_array(&arena, (size_t)ny, sizeof *black);
    bool finite = true, known = false, lost = false;
    const char *name = "it";
    double taken = 0, worst = 0, unexplained = 0, own = 0, other = 0, least = 1;
    char text[200];
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a report"));
    PM_TRY_DONE(pm_uncertainty_load(&u, f->arguments->output, f->training->system, &m->observation,
                                    &known));
    const pm_estimate_how how = {.seconds = seconds,
                                 .stop = f->interrupted ? NULL : f->stop,
                                 .uncertainty = known && !f->interrupted ? &u : NULL,
                                 .until = f->training->seconds};
    PM_TRY_DONE(keep_better(f, &how, count, which));
    status =
        pm_estimate_make(&e, f->training->system, &m->observation, m->data, count, which, &how);
    if (status == PM_ENUMERIC) {
        status =
            pm_verdict_unfit(f->verdict, "the %s part cannot be predicted: %s", where, pm_error());
    }
    PM_TRY_DONE(status);
    taken = pm_fit_processor_time(f);
    status = run_black_box(f, &e, which, seconds, black, &box);
    PM_TRY_DONE(status == PM_EDATA ? PM_OK : status); // too few samples for any
    taken = pm_fit_processor_time(f) - taken;
    printf("Starts of the %s part estimated in the first %.3g s; errors after that, in %% of each "
           "column's deviation (left out: of trajectories that a fit did not see)\n"
           "  column               median    largest   left out  black box\n",
           where, seconds);
    for (int c = 0; c < ny; ++c) {
        const pm_box errors = pm_estimate_errors(&e, &m->observation, m->data, which, seconds, c);
        const double noise = known ? u.independent[c] : 0; // it differs from sample to sample
        const double rest =
            pm_estimate_unexplained(&e, &m->observation, m->data, which, seconds, c, noise);
        const double inside =
            pm_estimate_coverage(&e, &m->observation, m->data, which, seconds, c, NORMAL);
        printf("  %-16s %10.3g %10.3g", m->observation.name[c], 100 * errors.median,
               100 * errors.largest);
        print_percent(m->left_out[c] > 0 ? m->left_out[c] : NAN);
        print_percent(box.tried > 0 ? black[c] : NAN);
        printf("\n");
        finite = finite && isfinite(errors.median);
        worst = fmax(worst, errors.median);
        // A column that hardly moves in these trajectories, beside others, is not lost.
        lost = lost || (rest >= 1 && pm_estimate_typical_error(&e, &m->observation, m->data, which,
                                                               seconds, c) > NEGLIGIBLE);
        name = rest > unexplained ? m->observation.name[c] : name;
        unexplained = fmax(unexplained, rest);
        own += log(errors.median) / ny;
        other += box.tried > 0 ? log(black[c]) / ny : 0;
        least = inside < least ? inside : least;
    }
    if (box.tried > 0) {
        printf("Black box: %s, a regression without structure, in %.2g s of CPU.\n", box.name,
               taken);
    }
    if (!finite || own > 0 || lost) {
        const char *what = finite ? "worse than the mean of the measurements" : "not finite";
        PM_TRY_DONE(pm_verdict_unfit(f->verdict, "predictions of the %s part are %s", where, what));
    }
    pm_verdict_compare(&v, unexplained, PM_VERDICT_GOOD, PM_VERDICT_FAIR,
                       "%.3g %% of %s is not explained by noise", 100 * unexplained, name);
    pm_verdict_compare(&v, stopped_short(m->point[1], m->longest, m->point[10]), 1, INFINITY,
                       "the fit stopped at windows of %.0f of %d samples", m->point[1], m->longest);
    if (validation && known && !f->interrupted) {
        pm_verdict_compare(&v, 1 - least, 1 - LEAST_COVERAGE, INFINITY,
                           "bands of 90 %% hold %.0f %% of a column", 100 * least);
    }
    if (box.tried > 0) {
        pm_verdict_compare(&v, unexplained > NEGLIGIBLE ? exp(own - other) : 0, PM_VERDICT_LOSES,
                           INFINITY, "the structure loses: a black box has %.3g times less error",
                           exp(own - other));
    }
    snprintf(
        text, sizeof text,
        "On the %s part predictions miss at most %.3g %% of a column's deviation in the median.",
        where, 100 * worst);
    pm_verdict_print(&v, text, f->verdict);
    for (int i = 0; i < f->training->scene->physics.nsubsystem; ++i) {
        if (m->energy[i] > UNKNOWN_ENERGY) {
            printf(
                "  Energies of %s, and the powers through its ports, are known to %.2g %% only.\n",
                f->training->scene->physics.subsystem[i].name, 100 * m->energy[i]);
        }
    }
done:
    pm_estimate_free(&e);
    pm_uncertainty_free(&u);
    pm_arena_free(&arena);
    return status;
}

// The starts of the validation part are those that fit whole trajectories best: what noise does to
// starts that are known from a short time only would hide what a model has wrong. Starts of pieces
// would make up for what is wrong over all of their length, so that they come from the first part.
static pm_status score_measured(pm_fit *f, pm_fit_score *score) {
    const pm_fit_measured *m = &f->measured;
    const bool validation = f->split.nvalidation > 0;
    const int all = validation ? f->split.nvalidation : f->split.ntraining;
    const int *which = f->split.trajectory + (validation ? f->split.ntraining : 0);
    pm_estimate e;
    const double limit = f->arguments->effort == NULL ? 0 : f->arguments->effort->seconds;
    const bool pieces = f->training->pieces > 1;
    const double first = ESTIMATED_PART * (f->dataset->ntime - 1) * f->dataset->dt;
    const pm_estimate_how how = {.seconds = pieces ? first : f->training->seconds,
                                 .stop = f->stop,
                                 .until = f->training->seconds,
                                 .halve = true,
                                 .work = JUDGED * limit * PM_SHOOTING_SPEED};
    PM_TRY(pm_estimate_make(&e, f->training->system, &m->observation, m->data,
                            all < MOST_REPORTED ? all : MOST_REPORTED, which, &how));
    f->measured.seconds += e.work / PM_SHOOTING_SPEED;
    double sum = 0;
    for (int c = 0; c < m->observation.count; ++c) {
        const double error =
            pm_estimate_typical_error(&e, &m->observation, m->data, which, pieces ? first : -1, c);
        const int column = m->observation.column[c];
        sum += log(error);
        if (column < PM_FIT_SCORED_GROUPS) {
            score->group[column] = error;
        }
    }
    score->rollout = exp(sum / m->observation.count);
    score->misfit = m->misfit;
    score->coarse = e.coarse;
    pm_estimate_free(&e);
    return PM_OK;
}

const pm_fit_kind pm_fit_of_measurements = {load, NULL, describe, start,
                                            NULL, run,  report,   score_measured};

// From the columns of a logger to a scene and a training file.
#include "propose/logger.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/progress.h"
#include "propose/logger_draft.h"
#include "propose/logger_laws.h"
#include "propose/search.h"

// A trial is a short fit to about SAMPLES samples, but to at least FEWEST_TRAJECTORIES
// trajectories, because some are kept back to judge it. It takes at most STEPS iterations.
#define SAMPLES 1500
#define FEWEST_SAMPLES 1024 // in a batch of single steps
#define FEWEST_TRAJECTORIES 14
#define FEWEST_KEPT_BACK 5   // records of which a fit keeps some back (data/split.h)
#define FEWEST_IN_PIECES 100 // samples of a record that is divided
#define STEPS 150
#define FEW_STEPS 8 // likewise, to compare laws
#define TRIES 4     // draws of the first weights of a trial
// A trial ends itself after at most ENDED s of CPU time. A trial that has taken SAFETY times what
// it was given, and ENDED s more, is stopped from outside.
#define ENDED 30
#define SAFETY 4
#define LEAST 1 // s of CPU time that every trial has
// A guess replaces a simpler one if its error is less than BETTER times as large. A column needs
// nothing more if its error is below NOISE_ALONE times its noise, or times ENOUGH of its deviation.
#define BETTER 0.85
#define NOISE_ALONE 1.25
#define SMALL_ERROR 0.1 // of the deviation
#define FAR 3           // times the noise: what is missing is no small part of a law
#define NOTHING 0.5     // of the deviation: an error that predicts hardly anything
#define ENOUGH 1e-3
#define MOST_TRIALS 64
// A column may be an unnamed input if the other columns leave more than the part UNEXPLAINED of its
// changes unexplained, if known inputs explain less than DRIVEN of them, and if it explains more
// than ACTS of the changes of another column.
#define UNEXPLAINED 0.5
#define DRIVEN 0.05
#define ACTS 2e-3
#define CLOSE 5e-4 // error of a short fit to clean states below which no other law is tried
// A law without spare constants may have an error that is larger by the factor HARDLY_WORSE. If it
// is worse, half as many are left out, until they are fewer than FEWEST_LEFT_OUT.
#define HARDLY_WORSE 1.1
#define FEWEST_LEFT_OUT 8
#define DECIMAL 10
// Where records are divided, up to MOST_WHOLE hypotheses are also fitted to whole records: those
// whose error is less than ALIKE times that of the best.
#define MOST_WHOLE 4
#define ALIKE 2
#define LIKELIER 3 // logarithm of how many times likelier what is no richer must be
#define PERCENT 100

// Prints what was found, one line for each column. `found` are the constants of a law without those
// that are spare, or NULL: what its inputs might have moved is named.
static void describe(const pm_logger_view *v, const char *found) {
    static const char *const kinds[] = {"a position",
                                        "a co-energy",
                                        "a temperature",
                                        "a level",
                                        "a hidden charge behind a resistance",
                                        "an amount",
                                        "an input"};
    static const char *const effects[] = {
        "drives",       "moves, with a learned factor,", "heats", "heats, with a learned factor,",
        "is a bath of", "acts through a resistance on",  "cools", "flows into"};
    // Momenta, entropies and flux linkages.
    static const char *const energy_units[] = {"kg m/s", "kg m^2/s", "J/K", "Wb"};
    bool units = false;
    for (int c = 0; c < v->ncolumn; ++c) {
        const char *unit = v->column[c].unit;
        units = units || (*unit != '\0' && strcmp(unit, "1") != 0);
    }
    if (!units) {
        printf("no column has a unit, and units tell what columns are: write, for instance, "
               "\"phi [rad]\" into the first line of a table\n");
    }
    for (int c = 0; c < v->ncolumn; ++c) {
        const pm_logger_column *column = &v->column[c];
        printf("%s [%s]: %s", column->name, column->unit, kinds[column->kind]);
        for (size_t k = 0; k < sizeof energy_units / sizeof *energy_units; ++k) {
            const pm_unit unit = pm_unit_parse(energy_units[k]);
            if (column->kind == PM_LOGGER_FLOW && pm_unit_equal(&column->dimension, &unit)) {
                fputs(", though its unit is that of an energy variable: a scene takes it as that "
                      "(propose SCENE --data)",
                      stdout);
            }
        }
        for (int k = 0; k < v->ncarrier; ++k) {
            if (v->carrier[k].flow == c) {
                printf(", which carries entropy between %s and %s",
                       v->column[v->carrier[k].from].name, v->column[v->carrier[k].to].name);
            }
        }
        for (int j = 0, some = 0; j < v->nvariable && column->guided; ++j) {
            if (pm_logger_guides(v, c, j)) {
                printf("%s %s", some++ == 0 ? ", moved as angles tell by" : " and",
                       v->column[j].name);
            }
        }
        const pm_logger_column *base = pm_logger_base(v, column);
        if (base != NULL) {
            printf(", measured from %s of %s since a spring is between them", base->name,
                   v->part[base->part]);
        }
        if (column->kind == PM_LOGGER_POSITION && !column->guided) {
            fputs(", whose rate is ", stdout);
            if (column->ratio != 1) {
                printf("%.4g times ", column->ratio);
            }
            printf("%s%s", v->column[column->mate].name,
                   v->column[column->mate].source == NULL ? ", which nobody measures" : "");
            for (int j = 0; j < v->nvariable; ++j) {
                if (v->moves[c][j] != 0 && j != column->mate) {
                    printf(" %+.4g %s", v->moves[c][j], v->column[j].name);
                }
            }
        }
        for (int j = 0; j < v->nvariable; ++j) {
            if (v->warms[c][j] && v->column[j].part != column->part) {
                printf("; its friction heats %s", v->column[j].name);
            }
            if (v->expands[j][c]) {
                printf("; its entropy depends on %s", v->column[j].name);
            }
        }
        if (column->noise > 0) {
            const double percent = 100;
            printf("; noise %.2g %% of its deviation", percent * column->roughness);
        }
        for (int a = 0; a < v->naction; ++a) {
            if (v->action[a].input == c) {
                printf("; %s %s", effects[v->action[a].effect],
                       v->column[v->action[a].target].name);
            }
        }
        for (int i = 0; i < v->nvariable; ++i) {
            if (c > 0 && v->gate[i] == c) {
                printf("; opens the outflow of %s", v->column[i].name);
            }
        }
        for (int a = 0; a < v->naction; ++a) {
            if (c > 0 && v->action[a].enters == c) {
                printf("; with this temperature %s enters %s", v->column[v->action[a].input].name,
                       v->column[v->action[a].target].name);
            }
        }
        if (column->saturates) {
            printf("; its sensor saturates at %.6g", column->largest);
        }
        for (int k = 0; k < v->nconverter; ++k) {
            const pm_logger_converter *between = &v->converter[k];
            if (between->input == c) {
                printf("; %s %s and %s", between->loses ? "is a throttle between" : "turns",
                       v->column[between->one].name, v->column[between->other].name);
            }
        }
        if (column->free_scale) {
            printf("; nothing shows its scale, which is 1");
        }
        if (column->delay != 0) {
            const double later = column->delay * v->dataset->dt;
            printf("; acts %g s %s than logged", fabs(later), later < 0 ? "earlier" : "later");
        }
        printf("%s\n", column->held ? "; held between samples" : "");
    }
    for (int k = 0; k < v->nleft; ++k) {
        printf("%s is left out, since it shows %s\n", v->left[k], v->why_left[k]);
    }
    for (const char *line = found; line != NULL && *line != '\0'; line = strchr(line, '\n') + 1) {
        const char *gain = strstr(line, ".gain_"), *end = strchr(line, '\n');
        const char *mark = strstr(line, PM_SEARCH_SPARE), *value = strchr(line, '=');
        if (gain != NULL && gain < end && mark != NULL && mark < end && value != NULL) {
            printf("%.*s is left out, since the data do not need it\n", (int)(value - gain - 1),
                   gain + 1);
        }
    }
    for (int k = 0; k < v->nidle; ++k) {
        const int *part = v->idle[k];
        int from = -1, to = -1;
        for (int q = 0; q < v->nvariable; ++q) {
            for (int p = 0; p < v->nvariable; ++p) {
                if (v->column[q].part == part[0] && v->column[p].part == part[1] &&
                    pm_logger_is_linked(v, q, p)) {
                    const int mate = v->column[p].mate;
                    const bool moves = v->share[mate][q] > PM_LOGGER_SPRINGS;
                    from = moves ? q : p, to = moves ? mate : v->column[q].mate;
                }
            }
        }
        if (from < 0) {
            printf("the data show nothing that passes between %s and %s: they have no port\n",
                   v->part[part[0]], v->part[part[1]]);
        } else {
            const char *one = v->column[from].name, *other = v->column[v->column[to].mate].name;
            printf("%s of %s moves %s of %s, a port stores no energy, and something else holds "
                   "both: make both one part, or give the distance %s - %s as a further column\n",
                   one, v->part[v->column[from].part], v->column[to].name,
                   v->part[v->column[to].part], one, other);
        }
    }
}

// Names columns that may be inputs: they move others, no input moves them, and a regression on all
// columns hardly tells how they change.
static void name_inputs(const pm_logger_view *v) {
    char list[PATH_MAX] = "";
    int count = 0;
    for (int c = 0; c < v->ncolumn; ++c) {
        const pm_logger_column *column = &v->column[c];
        double driven = 0, moves = 0;
        for (int j = 0; j < v->ncolumn && column->kind != PM_LOGGER_INPUT; ++j) {
            driven = j >= v->nvariable ? fmax(driven, v->share[c][j]) : driven;
            moves = j == c ? moves : fmax(moves, v->share[j][c]);
        }
        const bool may = column->source != NULL && column->mate < 0 &&
                         column->kind != PM_LOGGER_AMOUNT && column->unexplained > UNEXPLAINED &&
                         driven < DRIVEN && moves > ACTS;
        if (may || column->kind == PM_LOGGER_INPUT) {
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s",
                     *list == '\0' ? "" : ",", column->source);
            count += may;
        }
    }
    if (count > 0) {
        printf("columns that no other one explains may be inputs: with --inputs %s they are\n",
               list);
    }
}

// A trial supposes guesses about columns and delays of inputs, by identifier, and laws.
typedef struct hypothesis {
    int most; // trajectories; 0: all, which need not be measurements
    pm_logger_guess guess[PM_LOGGER_COLUMNS];
    int delay[PM_LOGGER_COLUMNS]; // rows
    int chosen[PM_LOGGER_NCHOICE];
} hypothesis;

static bool is_same(const hypothesis *a, const hypothesis *b) {
    return a->most == b->most && memcmp(a->guess, b->guess, sizeof a->guess) == 0 &&
           memcmp(a->delay, b->delay, sizeof a->delay) == 0 &&
           memcmp(a->chosen, b->chosen, sizeof a->chosen) == 0;
}

// The guesses of trials about what nobody measures.
typedef struct hidden_search {
    const pm_dataset *dataset;
    const pm_logger_hints *hints;
    const char *data_path;
    pm_logger_view first; // what is found first
    pm_logger_view seen;  // with the guesses and delays of `of`, if `looked` is true
    hypothesis of;
    bool looked;
    int count, best;
    int whole; // trials from this number on are of whole records; 0: none
    hypothesis what[MOST_TRIALS];
    bool simpler[MOST_TRIALS];      // it has fewer constants than the one it began with
    const char *found[MOST_TRIALS]; // where constants begin, as for pm_logger_draft; or NULL
    bool lean[MOST_TRIALS];         // likewise
    bool lean_failed[MOST_TRIALS];  // nothing can be left out of it
    bool quick[MOST_TRIALS];        // its fit has FEW_STEPS
    pm_search_trial trial[MOST_TRIALS];
    // s of CPU time: on a nominal machine, which decides what is tried, so that the result does not
    // depend on the machine; and as measured, which ends the trials on slow ones
    double spent, used;
    const char *start;  // where the constants of the best guesses begin in the fit; or NULL
    bool short_of_time; // the first trial had not ended in its time
    pm_arena arena;     // owns texts of constants
    pm_progress progress;
    int judged; // trials whose results count; the others are running
} hidden_search;

// Describes the columns with the guesses and delays of a hypothesis. What was seen last is kept, as
// hypotheses often differ by their laws alone. The search owns what the view points to.
static pm_status look_with(hidden_search *s, const hypothesis *what, pm_logger_view *view) {
    if (!s->looked || memcmp(s->of.guess, what->guess, sizeof what->guess) != 0 ||
        memcmp(s->of.delay, what->delay, sizeof what->delay) != 0) {
        pm_logger_hints hints = *s->hints;
        if (s->looked) {
            pm_logger_view_free(&s->seen);
        }
        s->of = *what;
        hints.guess = s->of.guess;
        hints.delay = s->of.delay;
        s->looked = false;
        PM_TRY(pm_logger_look(&s->seen, s->dataset, &hints));
        s->looked = true;
    }
    *view = s->seen;
    return PM_OK;
}

// Takes what is chosen of inputs between samples and of inertias over into the view.
static void take_choices(pm_logger_view *v, const int *chosen) {
    const bool sums = chosen[PM_LOGGER_INERTIA] == SUMMED_INERTIA;
    for (int c = 0; c < v->nvariable && sums; ++c) {
        v->turns[c] = v->turns[c] || pm_logger_hides_turning(v, c);
        v->column[c].twice = v->column[c].angle;
    }
    for (int i = 0; i < v->npart; ++i) {
        v->inertial[i] = v->inertial[i] || sums;
    }
    for (int u = v->nvariable; u < v->ncolumn && chosen[PM_LOGGER_HOLD] > 0; ++u) {
        v->column[u].held = true;
    }
}

// Returns true if there are too few records to keep some of them back, and these are long enough to
// keep pieces of each back.
static bool is_divided(const hidden_search *s) {
    bool all = s->dataset->ntrajectory < FEWEST_KEPT_BACK;
    for (int i = 0; i < s->dataset->ntrajectory && all; ++i) {
        all = pm_dataset_length(s->dataset, i) >= FEWEST_IN_PIECES;
    }
    return all;
}

// Writes the scene and the training file of a trial into one folder.
static pm_status write_trial(void *context, const int *chosen, const char *comment,
                             const char *path) {
    hidden_search *s = context;
    const hypothesis *what = &s->what[*chosen];
    pm_logger_draft draft = {
        .seed = s->hints->seed,
        .data_path = s->data_path,
        .most = what->most,
        .divided = what->most > 0 && is_divided(s) && s->whole == 0 ? s->dataset->ntrajectory : 0,
        .found = s->found[*chosen],
        .lean = s->lean[*chosen]};
    char scene[PATH_MAX];
    PM_TRY(look_with(s, what, &draft.view));
    take_choices(&draft.view, what->chosen);
    draft.scene_path = scene;
    snprintf(scene, sizeof scene, "%.*s_scene.yaml", (int)strlen(path) - (int)strlen(".yaml"),
             path);
    const pm_status status = pm_logger_write_scene(&draft, scene);
    return status == PM_OK ? pm_logger_write_training(&draft, what->chosen, comment, path) : status;
}

static double error_of(const hidden_search *s, int id) {
    const double error = s->trial[id].score.rollout;
    return s->trial[id].failed || isnan(error) ? INFINITY : error;
}

// Shows how much of the budget is spent, and what has come of it (search.h: pm_hypotheses).
static void show_progress(void *context, int ended, double seconds) {
    hidden_search *s = context;
    const int ntried = s->judged + ended;
    const double spent = fmin(s->spent + seconds, s->hints->budget);
    char detail[PM_SEARCH_NAME] = "";
    double least = INFINITY;
    for (int i = 0; i < ntried && i < MOST_TRIALS; ++i) {
        least = fmin(least, error_of(s, i));
    }
    if (ntried > 0) {
        const char *plural = ntried == 1 ? "is" : "es";
        const int length = snprintf(detail, sizeof detail, "%d hypothes%s tried", ntried, plural);
        if (isfinite(least)) {
            snprintf(detail + length, sizeof detail - (size_t)length, ", best error %.3g %%",
                     PERCENT * least);
        }
    }
    pm_progress_update(&s->progress, (long)spent, detail);
}

// Returns how many variables of a trial nobody measures.
static int hidden_by(const hidden_search *s, int id) {
    int count = 0;
    for (int c = 0; c < s->first.nvariable; ++c) {
        count += s->first.column[c].source == NULL;
    }
    for (int c = 0; c < PM_LOGGER_COLUMNS; ++c) {
        count += pm_logger_hides(s->what[id].guess[c]);
    }
    return count;
}

// Writes lines of `from` behind what is in `to` [2 PM_SEARCH_FOUND]: those of spare constants as
// long as at most `most` constants are left out with them, or, with a negative number, all lines
// without their marks. Returns how many are left out.
static int add_lines(char *to, const char *from, int most) {
    size_t length = strlen(to);
    int count = 0;
    for (const char *line = from, *end; *line != '\0'; line = end) {
        end = strchr(line, '\n') + 1;
        const char *mark = strstr(line, PM_SEARCH_SPARE);
        const bool marked = mark != NULL && mark < end;
        const int number = marked ? (int)strtol(mark + strlen(PM_SEARCH_SPARE), NULL, DECIMAL) : 0;
        const bool wanted = most < 0 || (marked && number <= most);
        const size_t size = (size_t)((marked && most < 0 ? mark : end - 1) - line);
        if (wanted && length + size + 1 < 2 * PM_SEARCH_FOUND) {
            memcpy(to + length, line, size);
            memcpy(to + length + size, "\n", 2);
            length += size + 1;
        }
        count = wanted && number > count ? number : count;
    }
    return count;
}

// Returns how many samples of all columns a trial has.
static double samples_of(const hidden_search *s, int id) {
    double samples = 0;
    for (int c = 0; c < s->first.nvariable; ++c) {
        const bool measured = s->first.column[c].source != NULL;
        samples += measured ? (double)s->what[id].most * s->dataset->ntime : 0;
    }
    return fmax(samples, 1);
}

// Returns the price of the constants that a trial has learned, as a logarithm of a likelihood.
static double price_of(const hidden_search *s, int id) {
    double constants = 0;
    for (const char *c = s->trial[id].found; *c != '\0'; ++c) {
        constants += *c == '\n';
    }
    return constants * log(samples_of(s, id)) / 2;
}

// Returns the constants at the end of a trial, or those at its start if it also learned networks.
// What a lean trial left out stays spare.
static const char *found_by(hidden_search *s, int id) {
    const char *own = s->trial[id].found, *first = s->found[id];
    char *found = NULL;
    if (*own != '\0' && s->lean[id]) {
        found = pm_arena_array(&s->arena, 2 * PM_SEARCH_FOUND, 1);
    }
    if (found == NULL) {
        return *own != '\0' ? own : first;
    }
    add_lines(found, first, INT_MAX);
    add_lines(found, own, -1);
    return found;
}

static const char *found_by_best(hidden_search *s) {
    return found_by(s, s->best);
}

// Returns true if all errors are below so many times the noise. Trials of measurements are judged
// column by column; those of complete states, which have no noise, as a whole.
static bool is_within(const hidden_search *s, double factor) {
    const double *error = s->trial[s->best].score.group, whole = error_of(s, s->best);
    if (s->what[s->best].most == 0) {
        return whole < factor * ENOUGH;
    }
    bool all = isfinite(whole);
    for (int c = 0; c < s->first.nvariable; ++c) {
        const pm_logger_column *column = &s->first.column[c];
        all = all && (column->id < 0 || column->id >= PM_FIT_SCORED_GROUPS ||
                      error[column->id] < factor * fmax(column->roughness, ENOUGH));
    }
    return all;
}

// Returns true if no prediction could be much better, since the rest is noise.
static bool explains(const hidden_search *s) {
    return is_within(s, NOISE_ALONE);
}

// Tries the guesses from number `from` on by fits of at most `steps` iterations, and keeps the best
// one.
static pm_status try_guesses(hidden_search *s, int from, int steps) {
    const pm_hypotheses space = {
        .count = 1, .write = write_trial, .context = s, .progress = show_progress};
    // A single guess gets at most half of the budget that is left, so that others can follow.
    // Several guesses share all of it.
    const double rest = s->hints->budget - s->spent;
    // A trial that begins where the best one ended takes about half of its time.
    const double each_takes = from > 0 && steps == STEPS ? s->trial[s->best].seconds / 2 : 0;
    while (s->count > from + 1 && (s->count - from) * each_takes > rest) {
        --s->count;
    }
    const double count = s->count - from;
    const double left = fmax(fmin(rest / 2, rest / fmax(count, 1)), LEAST);
    const double longest = fmin(ENDED, left);
    const pm_fit_effort each = {.tries = TRIES,
                                .try_iterations = 4,
                                .samples = FEWEST_SAMPLES,
                                .iterations = steps,
                                .stages = 1,
                                .seconds = longest};
    const int *vector[MOST_TRIALS] = {NULL};
    int number[MOST_TRIALS] = {0};
    pm_fit_effort effort[MOST_TRIALS];
    for (int i = from; i < s->count; ++i) {
        effort[i - from] = each;
        effort[i - from].whole = s->found[i] != NULL && !s->short_of_time;
        s->quick[i] = steps < STEPS;
        number[i] = i;
        vector[i - from] = &number[i];
    }
    PM_TRY(pm_search_try(&space, s->count - from, vector, effort, SAFETY * longest + ENDED, NULL,
                         s->hints->stop, s->trial + from, &s->used));
    for (int i = from; i < s->count; ++i) {
        s->spent += s->trial[i].unfinished ? longest : s->trial[i].seconds;
        s->short_of_time = s->short_of_time || (i == 0 && s->trial[i].cut);
        const double error = error_of(s, i);
        // Errors nearly as large as the deviation tell no guess from another.
        const double so_far = error_of(s, s->best),
                     other = isfinite(so_far) ? fmin(so_far, NOTHING) : so_far;
        // A guess that hides one more variable is taken until as many are hidden as the user names.
        const int more = s->hints->hidden > 0 ? hidden_by(s, i) - hidden_by(s, s->best) : 0;
        if (more > 0 ? isfinite(error)
                     : more == 0 && error < (s->simpler[i] ? 1 : BETTER) * other) {
            s->best = i;
        }
    }
    s->judged = s->count;
    show_progress(s, 0, 0);
    return PM_OK;
}

// Adds a trial that has the best guesses so far, and another guess for the column with identifier
// `id`, or also for the variables that are like it. A guess that was tried beside the best one
// before is tried once more if it adds to it: it may need constants that have been fitted.
static void add_guess(hidden_search *s, int id, pm_logger_guess guess, const pm_unit *alike) {
    const bool adds = pm_logger_adds(guess, s->what[s->best].guess[id]);
    if (s->count == MOST_TRIALS || (guess == PM_LOGGER_MOVED_2 && !adds)) {
        return;
    }
    const int first = s->count;
    pm_logger_guess *own = s->what[first].guess;
    s->what[first] = s->what[s->best];
    const char *found = found_by_best(s);
    for (int j = 0; j < s->first.ncolumn; ++j) {
        const pm_logger_column *other = &s->first.column[j];
        const bool same = alike != NULL && pm_unit_equal(&other->dimension, alike) &&
                          other->id >= 0 && other->nother > 0 &&
                          (j < s->first.nvariable) == (guess != PM_LOGGER_FREELY);
        if (same || other->id == id) {
            own[other->id] = guess;
        }
    }
    for (int i = 0; i < s->count; ++i) {
        const hypothesis *other = &s->what[i];
        const bool once_more = adds && (s->found[i] == NULL || strcmp(s->found[i], found) != 0);
        if (other->most == s->what[first].most &&
            memcmp(other->guess, own, sizeof other->guess) == 0 && !once_more) {
            return;
        }
    }
    // All constants begin anew where an input does something else: those that were spare may be
    // needed then. A hidden variable may add to a law that is known well, or that law may have made
    // up for it.
    const bool acts = guess == PM_LOGGER_FREELY || guess >= PM_LOGGER_OPENS;
    const bool hides = pm_logger_hides(guess) > 0, lean = s->lean[s->best];
    for (int anew = 0; anew < 2 && s->count < MOST_TRIALS; ++anew) {
        const bool keeps = anew == 0 && !acts;
        if (anew == 0 ? !hides || lean || adds : hides && !adds) {
            s->what[s->count] = s->what[first];
            s->simpler[s->count] = guess == PM_LOGGER_CYCLIC || guess == PM_LOGGER_AS_FOUND;
            s->lean[s->count] = keeps && lean;
            s->found[s->count++] = keeps ? found_by_best(s) : NULL;
        }
    }
}

// Returns true if trial `id` has the guesses and the laws of an earlier one.
static bool is_twin(const hidden_search *s, int id) {
    bool twin = false;
    for (int i = 0; i < id; ++i) {
        twin = twin || is_same(&s->what[i], &s->what[id]);
    }
    return twin;
}

// Adds up to `most` guesses that differ from the best one by a richer law. Constants that they
// share with the best one begin where its trial ended.
static pm_status add_laws(hidden_search *s, int most) {
    static const int richer[][2] = {{PM_LOGGER_SHARING, 1},
                                    {PM_LOGGER_INERTIA, SUMMED_INERTIA},
                                    {PM_LOGGER_COUPLING, LEARNED_COUPLING},
                                    {PM_LOGGER_FRICTION, WAVY_FRICTION},
                                    {PM_LOGGER_CAPACITY, LEARNED_CAPACITY},
                                    {PM_LOGGER_INERTIA, LEARNED_INERTIA},
                                    {PM_LOGGER_POTENTIAL, SPRINGS_OF_ANGLES},
                                    {PM_LOGGER_POTENTIAL, NETWORK_OF_POSITIONS},
                                    {PM_LOGGER_LEVELS, NETWORKS_OF_LEVELS}};
    const int all = sizeof richer / sizeof *richer;
    const int *chosen = s->what[s->best].chosen;
    pm_logger_view view;
    PM_TRY(look_with(s, &s->what[s->best], &view));
    for (int k = 0; k < all && k < most && s->count < MOST_TRIALS; ++k) {
        const char *name;
        const char *const *alternative;
        const int which = richer[k][0];
        const int count =
            pm_logger_alternatives(&view, (pm_logger_choice)which, &name, &alternative);
        if (chosen[which] == 0 && richer[k][1] < count) {
            s->what[s->count] = s->what[s->best];
            s->what[s->count].chosen[which] = richer[k][1];
            // Laws of each co-energy alone have made up for what they share.
            const bool anew = which == PM_LOGGER_SHARING || which == PM_LOGGER_INERTIA;
            s->found[s->count] = anew ? NULL : found_by_best(s);
            s->lean[s->count] = s->lean[s->best] && !anew;
            s->count += !is_twin(s, s->count);
        }
    }
    return PM_OK;
}

// Returns true if the budget is spent: what is left for a trial is less than any has taken that
// ended by itself and predicts something.
static bool is_late(const hidden_search *s) {
    const double left = s->hints->budget - s->spent;
    double least = INFINITY;
    for (int i = 0; i < s->count; ++i) {
        const bool ended = !s->trial[i].cut && !s->quick[i] && error_of(s, i) < NOTHING;
        least = ended ? fmin(least, s->trial[i].seconds) : least;
    }
    // A trial that has been cut needs more time than it had.
    least = isfinite(least) || !s->short_of_time ? least : s->trial[0].seconds;
    return left <= 0 || (isfinite(least) && left / 2 < least) ||
           s->used >= PM_SEARCH_SLOW * s->hints->budget;
}

// Returns true if nothing else is tried.
static bool is_over(const hidden_search *s) {
    return (explains(s) && hidden_by(s, s->best) >= s->hints->hidden) || is_late(s);
}

// Tries the first `most` of other laws as long as one of them is better. A few iterations tell
// which of several laws is worth more; where there is time for no more, they have to do.
static pm_status find_laws(hidden_search *s, int most) {
    for (int before = -1; s->best != before && !explains(s) && s->spent < s->hints->budget &&
                          s->used < PM_SEARCH_SLOW * s->hints->budget;) {
        const int from = s->count;
        before = s->best;
        PM_TRY(add_laws(s, most));
        const bool several = s->count > from + 1;
        PM_TRY(several || !is_late(s) ? try_guesses(s, from, several ? FEW_STEPS : STEPS) : PM_OK);
        int next = before;
        for (int i = from; i < s->count; ++i) {
            next = error_of(s, i) < error_of(s, next) ? i : next;
        }
        if (several && next != before && is_late(s)) {
            s->best = next;
        } else if (several && next != before && s->count < MOST_TRIALS) {
            const int last = s->count;
            s->best = before;
            s->what[last] = s->what[next];
            s->found[last] = found_by(s, next);
            s->lean[last] = s->lean[next];
            ++s->count;
            PM_TRY(try_guesses(s, last, STEPS));
        }
    }
    return PM_OK;
}

// Tries the delays of inputs that regressions show: all of them, then single ones.
static pm_status find_delays(hidden_search *s) {
    for (int only = -1; only < s->first.ncolumn && s->count < MOST_TRIALS && !is_over(s); ++only) {
        const int from = s->count, before = s->best;
        bool some = false;
        s->what[from] = s->what[before];
        for (int u = s->first.nvariable; u < s->first.ncolumn; ++u) {
            const pm_logger_column *input = &s->first.column[u];
            if (input->shows_delay != 0 && (only < 0 || only == u)) {
                s->what[from].delay[input->id] = input->shows_delay;
                some = true;
            }
        }
        if (some && !is_same(&s->what[from], &s->what[before])) {
            ++s->count;
            PM_TRY(try_guesses(s, from, STEPS));
        }
        if (only < 0 && s->best != before) {
            break;
        }
    }
    return PM_OK;
}

// Tries the best hypothesis without delays: a hidden variable, found since, may be what made an
// input act late.
static pm_status leave_delays(hidden_search *s) {
    static const int none[PM_LOGGER_COLUMNS] = {0};
    const int from = s->count;
    if (memcmp(s->what[s->best].delay, none, sizeof none) == 0 || from == MOST_TRIALS ||
        is_late(s)) {
        return PM_OK;
    }
    s->what[from] = s->what[s->best];
    memcpy(s->what[from].delay, none, sizeof none);
    s->simpler[from] = true;
    s->lean[from] = false; // what made up for the delay leads astray
    s->found[from] = NULL;
    ++s->count;
    return try_guesses(s, from, STEPS);
}

// Tries what inputs may set, the best of all again and again, at most `most` times.
static pm_status find_inputs(hidden_search *s, int most) {
    for (int before = -1, pass = 0; pass < most && s->best != before && !is_over(s); ++pass) {
        const int from = s->count;
        before = s->best;
        pm_logger_view view;
        PM_TRY(look_with(s, &s->what[s->best], &view));
        for (int u = view.nvariable; u < view.ncolumn; ++u) {
            const pm_logger_column *input = &view.column[u];
            int one, other;
            for (int i = 0; i < input->nother && input->guess == PM_LOGGER_AS_FOUND; ++i) {
                add_guess(s, input->id, input->other[i],
                          input->other[i] == PM_LOGGER_FREELY ? &input->dimension : NULL);
            }
            if (input->guess != PM_LOGGER_AS_FOUND) {
                add_guess(s, input->id, PM_LOGGER_AS_FOUND, NULL);
            }
            if (pm_logger_split(input->guess, &one, &other) == PM_LOGGER_OPENS) {
                add_guess(s, input->id, pm_logger_join(PM_LOGGER_OPENS_ALONE, one, other), NULL);
            }
        }
        PM_TRY(try_guesses(s, from, STEPS));
    }
    return PM_OK;
}

// Guesses are grouped by what may be hidden behind a column. Those that hide nothing are about the
// role of a column or about its laws.
typedef enum guess_group { UNPLACED, MOVING, THERMAL, ROLES, LAWS } guess_group;

// Tries the guesses of a group. It first tries the same guess for all columns of a unit, then for
// single ones, until no guess is better.
static pm_status find_columns(hidden_search *s, guess_group group) {
    for (int alike = 1; alike >= 0; --alike) {
        for (int c = 0; c < s->first.nvariable && !is_over(s); ++c) {
            const pm_logger_column *column = &s->first.column[c];
            const int from = s->count;
            const bool moves = column->mate >= 0 && s->first.column[column->mate].source != NULL;
            for (int i = 0; i < column->nother; ++i) {
                const bool hides = pm_logger_hides(column->other[i]) > 0;
                const bool laws =
                    column->other[i] >= PM_LOGGER_WARMER && column->other[i] < PM_LOGGER_CELL;
                const guess_group own = !hides ? (laws ? LAWS : ROLES)
                                        : column->kind == PM_LOGGER_TEMPERATURE ? THERMAL
                                        : moves                                 ? MOVING
                                                                                : UNPLACED;
                // A trial of a larger guess than one that has not ended, or that took more than
                // what is left for this one, would not end either.
                const bool late = s->hints->budget - s->spent < s->trial[0].seconds;
                const int before = s->count;
                if (own == group && !(hides && (s->short_of_time || late))) {
                    add_guess(s, column->id, column->other[i],
                              alike == 1 ? &column->dimension : NULL);
                }
                if (s->count > before && s->hints->hidden >= 0 && hides &&
                    hidden_by(s, s->count - 1) > s->hints->hidden) {
                    s->count = before;
                }
            }
            PM_TRY(try_guesses(s, from, STEPS));
        }
    }
    return PM_OK;
}

// Returns true if the column that the best trial predicts worst, by its noise, is a temperature.
static bool is_warm(const hidden_search *s) {
    double worst = 0;
    bool warm = false;
    for (int c = 0; c < s->first.nvariable; ++c) {
        const pm_logger_column *column = &s->first.column[c];
        const bool scored = column->id >= 0 && column->id < PM_FIT_SCORED_GROUPS;
        const double error = scored ? s->trial[s->best].score.group[column->id] : 0,
                     ratio = error / fmax(column->roughness, ENOUGH);
        if (ratio > worst) {
            worst = ratio;
            warm = column->kind == PM_LOGGER_TEMPERATURE;
        }
    }
    return warm;
}

// Tries the best guesses once more. With `turn` inputs that look smooth become held between
// samples, or held ones smooth. Without it the constants begin where regressions put them, because
// the constants of a worse guess may have led them astray. The likelier one wins, with the price of
// its constants, however little their errors differ.
static pm_status try_again(hidden_search *s, bool turn) {
    const char *name;
    const char *const *alternative;
    const int from = s->count, before = s->best;
    bool may = !turn || pm_logger_alternatives(&s->first, PM_LOGGER_HOLD, &name, &alternative) > 1;
    for (int i = 0; i < from && !turn; ++i) {
        may = may && !(is_same(&s->what[i], &s->what[before]) && s->found[i] == NULL);
    }
    if (!may || from == MOST_TRIALS || is_late(s)) {
        return PM_OK;
    }
    s->what[from] = s->what[before];
    s->what[from].chosen[PM_LOGGER_HOLD] ^= turn;
    s->lean[from] = turn && s->lean[before];
    s->found[s->count++] = turn ? found_by_best(s) : NULL;
    PM_TRY(try_guesses(s, from, STEPS));
    const bool likelier = s->what[from].most == 0
                              ? error_of(s, from) < error_of(s, before)
                              : s->trial[from].score.misfit + price_of(s, from) <
                                    s->trial[before].score.misfit + price_of(s, before) - LIKELIER;
    // A fit whose time was over in short windows is likely, whatever it predicts.
    const bool as_good = error_of(s, from) < HARDLY_WORSE * error_of(s, before);
    if (!s->trial[from].failed && likelier && as_good) {
        s->best = from;
    }
    return PM_OK;
}

// Tries the best guesses without the constants that the data do not need, again and again: a law
// with fewer constants takes less time, and is easier to read. It may be less likely by as much as
// so many constants are worth, unless it predicts better. If it is worse, half as many are left
// out. A fit whose time was over in short windows, far from the noise, does not tell what long ones
// need. Far from the noise a law is missing, and it is tried once, as
// with `once`.
static pm_status leave_out(hidden_search *s, bool once) {
    const int trajectories = s->what[s->best].most;
    const double samples = (double)trajectories * s->dataset->ntime * fmax(s->first.nvariable, 1);
    int most = INT_MAX;
    while (trajectories > 0 && s->count < MOST_TRIALS && !s->lean_failed[s->best] &&
           (!s->trial[s->best].cut || is_within(s, FAR)) && error_of(s, s->best) < SMALL_ERROR) {
        const int from = s->count, before = s->best;
        const pm_search_trial *full = &s->trial[before], *lean = &s->trial[from];
        char *found = pm_arena_array(&s->arena, 2 * PM_SEARCH_FOUND, 1);
        PM_TRY(pm_arena_status(&s->arena, "constants"));
        const int count = add_lines(found, full->found, most);
        if (s->lean[before]) {
            add_lines(found, s->found[before], INT_MAX);
        }
        add_lines(found, full->found, -1);
        if (count == 0) {
            s->lean_failed[before] = true;
            return PM_OK;
        }
        s->what[from] = s->what[before];
        s->lean[from] = true;
        s->found[from] = found;
        ++s->count;
        PM_TRY(try_guesses(s, from, STEPS));
        const bool likely = lean->score.misfit < full->score.misfit + count * log(samples) / 2 &&
                            lean->score.rollout < full->score.rollout * HARDLY_WORSE;
        const bool kept = !lean->failed && (likely || lean->score.rollout < full->score.rollout);
        s->best = kept ? from : before;
        s->lean_failed[before] =
            !kept && (count < FEWEST_LEFT_OUT || is_late(s) || !is_within(s, FAR));
        most = kept ? INT_MAX : count / 2;
        if (once || (kept && !is_within(s, FAR))) {
            break;
        }
    }
    return PM_OK;
}

// Adds a trial of whole records, from where trial `id` ended.
static void add_whole(hidden_search *s, int id) {
    if (s->count < MOST_TRIALS) {
        s->what[s->count] = s->what[id];
        s->lean[s->count] = s->lean[id];
        s->found[s->count++] = found_by(s, id);
    }
}

// Fits the trials from number `from` on to whole records. The likeliest one wins, with the price of
// its constants, if its error is less than `worst`.
static pm_status run_whole(hidden_search *s, int from, double worst) {
    const pm_hypotheses space = {
        .count = 1, .write = write_trial, .context = s, .progress = show_progress};
    const double rest = (s->hints->budget - s->spent) / fmax(s->count - from, 1);
    const double longest = fmin(fmax(rest, LEAST), ENDED);
    int number[MOST_TRIALS];
    const int *vector[MOST_TRIALS];
    pm_fit_effort effort[MOST_TRIALS];
    for (int i = from; i < s->count; ++i) {
        number[i - from] = i;
        vector[i - from] = &number[i - from];
        effort[i - from] = (pm_fit_effort){.whole = true,
                                           .tries = TRIES,
                                           .try_iterations = 4,
                                           .samples = FEWEST_SAMPLES,
                                           .iterations = STEPS,
                                           .stages = 1,
                                           .seconds = longest};
    }
    PM_TRY(pm_arena_status(&s->arena, "constants"));
    PM_TRY(pm_search_try(&space, s->count - from, vector, effort, SAFETY * longest + ENDED, NULL,
                         s->hints->stop, s->trial + from, &s->used));
    double least = INFINITY;
    for (int i = s->whole; i < s->count; ++i) {
        s->spent += i < from ? 0 : s->trial[i].unfinished ? longest : s->trial[i].seconds;
        const double price = samples_of(s, i) * log(error_of(s, i)) + price_of(s, i);
        if (error_of(s, i) < worst && price < least) {
            least = price;
            s->best = i;
        }
    }
    s->judged = s->count;
    return PM_OK;
}

// Fits the best hypotheses to whole records, from where their trials on pieces ended, if pieces
// hardly tell them apart: they are short, and some of them teach nothing. A fit to whole records
// that is worse than one to pieces has failed. Then a guess is tried that adds to the best one.
static pm_status try_whole(hidden_search *s) {
    const double error = error_of(s, s->best);
    bool taken[MOST_TRIALS] = {false};
    int from = s->count;
    if (s->what[s->best].most == 0 || !is_divided(s) || !isfinite(error)) {
        return PM_OK;
    }
    for (int k = 0; k < MOST_WHOLE; ++k) {
        int next = -1;
        for (int i = 0; i < from; ++i) {
            const bool may =
                !taken[i] && *s->trial[i].found != '\0' && error_of(s, i) < ALIKE * error;
            next = may && (next < 0 || error_of(s, i) < error_of(s, next)) ? i : next;
        }
        if (next >= 0) {
            taken[next] = true;
            add_whole(s, next);
        }
    }
    s->whole = from;
    PM_TRY(run_whole(s, from, error));
    from = s->count;
    for (int c = 0; c < s->first.nvariable && s->best >= s->whole; ++c) {
        const pm_logger_column *column = &s->first.column[c];
        for (int i = 0; i < column->nother && column->id >= 0; ++i) {
            if (pm_logger_adds(column->other[i], s->what[s->best].guess[column->id]) &&
                s->count < MOST_TRIALS) {
                add_whole(s, s->best);
                s->what[s->count - 1].guess[column->id] = column->other[i];
            }
        }
    }
    return s->count > from ? run_whole(s, from, error) : PM_OK;
}

// Tries delays, guesses and laws, as long as the best trial does not explain the data. A missing
// hidden variable leaves a large error, and a wrong law a small one, so that hidden variables come
// before most laws. Motion heats, but heat hardly moves, so that variables hidden behind
// temperatures come last, and inputs are looked at once more after them. Some laws come first,
// because hidden variables would make up for their lack: inertias that depend on positions or are
// shared and,
// where the error is large, couplings that depend on flows.
static pm_status search_all(hidden_search *s) {
    PM_TRY(find_delays(s));
    PM_TRY(try_again(s, true));
    PM_TRY(leave_out(s, true));
    const int first = s->best;
    // Without noise the errors do not tell whether a variable is missing or a law is wrong.
    PM_TRY(s->first.noisy && is_within(s, FAR) ? find_laws(s, MOST_TRIALS) : PM_OK);
    // Guesses about heat come first where temperatures are predicted worst.
    PM_TRY(is_warm(s) ? find_columns(s, LAWS) : PM_OK);
    if (!s->short_of_time) {
        PM_TRY(find_laws(s, 2));
        PM_TRY(leave_out(s, false));
        PM_TRY(find_laws(s, error_of(s, s->best) < SMALL_ERROR ? 0 : 3));
    }
    PM_TRY(find_inputs(s, 1));
    PM_TRY(find_columns(s, ROLES));
    const bool near = s->first.noisy ? is_within(s, FAR) : error_of(s, s->best) < SMALL_ERROR;
    PM_TRY(near ? find_columns(s, LAWS) : PM_OK);
    PM_TRY(leave_out(s, false));
    for (int pass = 0; pass < 2; ++pass) {
        if (near == (pass == 0)) {
            PM_TRY(near ? PM_OK : find_columns(s, LAWS));
            PM_TRY(find_laws(s, MOST_TRIALS));
        } else {
            PM_TRY(find_columns(s, UNPLACED));
            PM_TRY(find_columns(s, MOVING));
            PM_TRY(find_columns(s, THERMAL));
        }
        PM_TRY(leave_out(s, false));
    }
    PM_TRY(find_inputs(s, MOST_TRIALS));
    PM_TRY(hidden_by(s, s->best) > hidden_by(s, first) ? leave_delays(s) : PM_OK);
    // A better model may tell otherwise.
    PM_TRY(s->best != first ? try_again(s, true) : PM_OK);
    PM_TRY(try_again(s, false));
    return leave_out(s, false);
}

// Tries what may be hidden, and other laws.
static pm_status find_hidden(hidden_search *s) {
    const int n = s->dataset->ntrajectory, each = SAMPLES / s->dataset->ntime;
    const pm_logger_view *v = &s->first;
    if (!pm_logger_is_measured(v)) {
        // Complete states without noise are fitted by single steps.
        s->count = 1;
        PM_TRY(try_guesses(s, 0, STEPS));
        if (explains(s) && hidden_by(s, s->best) >= s->hints->hidden) {
            return try_again(s, true);
        }
    }
    const int most = each < FEWEST_TRAJECTORIES ? FEWEST_TRAJECTORIES : each;
    s->what[0].most = most < n ? most : n;
    s->count = 1;
    PM_TRY(try_guesses(s, 0, STEPS));
    bool refuted;
    do {
        PM_TRY(search_all(s));
        refuted = false;
        // Few trajectories may be explained by a law that others refute.
        for (int before = -1; s->best != before && explains(s) && s->what[s->best].most < n &&
                              s->count < MOST_TRIALS && !is_late(s);) {
            const int from = s->count;
            before = s->best;
            s->what[from] = s->what[before];
            s->what[from].most = 2 * s->what[from].most < n ? 2 * s->what[from].most : n;
            s->found[from] = found_by_best(s);
            s->lean[from] = s->lean[before];
            ++s->count;
            PM_TRY(try_guesses(s, from, STEPS));
            s->best = s->trial[from].failed ? before : from;
            refuted = !explains(s);
        }
    } while (refuted && !is_late(s));
    return try_whole(s);
}

// Returns the name of the column of this identifier.
static const char *name_of(const pm_logger_view *v, int id) {
    const char *name = "";
    for (int c = 0; c < v->ncolumn; ++c) {
        name = v->column[c].id == id ? v->column[c].name : name;
    }
    return name;
}

// Tries the best guesses with all trajectories, from where their trial ended, then from the start.
// If they cannot be integrated, the next best ones take their place.
static pm_status confirm(hidden_search *s) {
    const pm_hypotheses space = {
        .count = 1, .write = write_trial, .context = s, .progress = show_progress};
    const int most = s->what[s->best].most,
              last = s->count < MOST_TRIALS ? s->count : MOST_TRIALS - 1;
    const int *const vector[] = {&last};
    pm_fit_effort effort = {
        .tries = TRIES, .try_iterations = 4, .samples = FEWEST_SAMPLES, .stages = 1};
    s->start = found_by_best(s);
    if (most == 0 || most == s->dataset->ntrajectory || last < s->count) {
        return PM_OK;
    }
    pm_status status = PM_OK;
    for (bool fits = false; !fits && status == PM_OK && isfinite(error_of(s, s->best));) {
        s->what[last] = s->what[s->best];
        s->what[last].most = s->dataset->ntrajectory;
        for (int k = 0; k < 2 && !fits && status == PM_OK; ++k) {
            s->found[last] = k == 0 ? found_by_best(s) : NULL;
            s->lean[last] = k == 0 && s->lean[s->best];
            effort.whole = s->found[last] != NULL && !s->short_of_time;
            status = pm_search_try(&space, 1, vector, &effort, SAFETY * LEAST + ENDED, NULL,
                                   s->hints->stop, &s->trial[last], &s->used);
            // A trial that is stopped for its time has not failed to integrate.
            fits = !s->trial[last].failed || s->trial[last].unfinished;
            s->start = s->found[last];
        }
        if (!fits && status == PM_OK) {
            s->trial[s->best].failed = true;
            memcpy(s->trial[s->best].reason, s->trial[last].reason, sizeof s->trial->reason);
            for (int i = 0; i < s->count; ++i) {
                s->best = error_of(s, i) < error_of(s, s->best) ? i : s->best;
            }
        }
    }
    return status;
}

// Writes what was tried, as lines of a comment.
static void print_trials(const hidden_search *s, FILE *f) {
    static const char *const guess[PM_LOGGER_NGUESS] = {
        "",
        "complete",
        "its rate is hidden",
        "a hidden level falls into it",
        "a hidden level falls and spills into it",
        "moved by a hidden variable without loss",
        "exchanges heat with a hidden temperature",
        "moved by two hidden variables without loss",
        "its friction heats a neighbour",
        "its entropy depends on positions",
        "inertias do not depend on it",
        "acts with a learned factor",
        "moves all velocities of its part",
        "a cell with a resistance",
        "a cell with one relaxing pair",
        "a cell with two relaxing pairs"};
    fprintf(f,
            "# What nobody measures was found by short fits; error on the %s, %% of the "
            "deviation:\n",
            is_divided(s) ? "second and fourth fifth of each record" : "validation part");
    for (int i = 0; i < s->count; ++i) {
        bool any = false;
        fprintf(f, "# %s ", i == s->best ? "*" : "-");
        for (int c = 0; c < s->first.ncolumn; ++c) {
            const pm_logger_column *column = &s->first.column[c];
            const pm_logger_guess own =
                column->id >= 0 ? s->what[i].guess[column->id] : PM_LOGGER_AS_FOUND;
            int one, other;
            if (own >= PM_LOGGER_PAIRS) {
                const pm_logger_guess kind = pm_logger_split(own, &one, &other);
                const char *first = name_of(&s->first, one), *second = name_of(&s->first, other);
                const char *lead = any ? "; " : "", *u = column->name;
                if (kind == PM_LOGGER_GATES) {
                    fprintf(f, "%s%s: opens the outflow of %s", lead, u, first);
                } else if (kind == PM_LOGGER_ENTERS) {
                    fprintf(f, "%s%s: with it %s enters %s", lead, u, first, second);
                } else {
                    fprintf(f, "%s%s: acts between %s and %s%s", lead, u, first, second,
                            kind == PM_LOGGER_OPENS_ALONE ? " alone" : "");
                }
                any = true;
            } else if (own != PM_LOGGER_AS_FOUND) {
                fprintf(f, "%s%s: %s", any ? "; " : "", column->name, guess[own]);
                any = true;
            }
        }
        for (int u = s->first.nvariable; u < s->first.ncolumn; ++u) {
            const pm_logger_column *input = &s->first.column[u];
            const double later = s->what[i].delay[input->id] * s->dataset->dt;
            if (later != 0) {
                fprintf(f, "%s%s: acts %g s %s", any ? "; " : "", input->name, fabs(later),
                        later < 0 ? "earlier" : "later");
                any = true;
            }
        }
        for (int k = 0; k < PM_LOGGER_NCHOICE; ++k) {
            const char *name;
            const char *const *alternative;
            (void)pm_logger_alternatives(&s->first, (pm_logger_choice)k, &name, &alternative);
            const int chosen = s->what[i].chosen[k];
            if (chosen > 0) {
                fprintf(f, "%s%s: %s", any ? "; " : "", name, alternative[chosen]);
                any = true;
            }
        }
        fputs(any ? "" : "as units and regressions say", f);
        const bool whole = s->whole > 0 && i >= s->whole;
        if (i > 0 && s->what[i].most > s->what[i - 1].most && s->what[i - 1].most > 0) {
            fprintf(f, ", %d trajectories", s->what[i].most);
        }
        fputs(s->lean[i] ? ", without what the data do not need" : "", f);
        fputs(whole                          ? ", whole records"
              : s->lean[i] || !is_twin(s, i) ? ""
              : s->found[i] == NULL          ? ", begun anew"
                                             : ", begun where another trial ended",
              f);
        fputs(s->quick[i] ? ", a few iterations" : "", f);
        const pm_search_trial *t = &s->trial[i];
        if (t->failed) {
            fprintf(f, " (failed: %s)\n", t->reason);
        } else {
            fprintf(f, " (%.3g)\n", PERCENT * t->score.rollout);
        }
    }
    const double budget = s->hints->budget, error = error_of(s, s->best);
    if (isfinite(error)) {
        printf("tried %d hypothes%s: the best one misses %s by %.3g %% of the deviation%s\n",
               s->count, s->count == 1 ? "is" : "es",
               is_divided(s) ? "pieces that it has not seen" : "the validation part",
               PERCENT * error, error > NOTHING ? ", so that a fit of it will hardly be good" : "");
    } else if (s->count > 0) {
        printf("tried %d hypothes%s: none leads to a model (%s)\n", s->count,
               s->count == 1 ? "is" : "es", s->trial[s->best].reason);
    }
    if (!explains(s) && is_over(s)) {
        fprintf(f, "# Time was left for no other trial: --budget %.0f tries more.\n", 2 * budget);
        printf("time was left for no other trial: --budget %.0f tries more\n", 2 * budget);
    }
}

// The choices among laws that the columns leave, for the search.
typedef struct law_choices {
    const pm_logger_draft *draft;
    const char *before; // lines of a comment
    pm_hypotheses space;
    pm_logger_choice choice[PM_SEARCH_CHOICES]; // [space.count]
} law_choices;

static pm_status write_alternative(void *context, const int *chosen, const char *comment,
                                   const char *path) {
    const law_choices *laws = context;
    int all[PM_LOGGER_NCHOICE] = {0};
    for (int i = 0; i < laws->space.count; ++i) {
        all[laws->choice[i]] = chosen[i];
    }
    char *text = NULL;
    pm_status status = asprintf(&text, "%s%s", laws->before, comment) < 0
                           ? pm_fail(PM_ENOMEM, "out of memory for a comment")
                           : pm_logger_write_training(laws->draft, all, text, path);
    free(text);
    return status;
}

// Writes the training file of the laws that short fits prefer. For measurements find_laws has
// chosen already: the laws are written with all their parts, and begin where the short fit ended.
static pm_status choose_laws(pm_logger_draft *draft, const pm_logger_hints *hints,
                             const int *chosen, const char *before, const char *path) {
    const pm_logger_view *v = &draft->view;
    if (pm_logger_is_measured(v)) {
        return pm_logger_write_training(draft, chosen, before, path);
    }
    const pm_search_how how = {.budget = hints->budget,
                               .most = hints->budget,
                               .loud = true,
                               .stop = hints->stop,
                               .enough = CLOSE};
    law_choices *laws = calloc(1, sizeof *laws);
    if (laws == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a search");
    }
    *laws = (law_choices){
        .draft = draft, .before = before, .space = {.write = write_alternative, .context = laws}};
    for (int k = 0; k < PM_LOGGER_NCHOICE; ++k) {
        const char *name;
        const char *const *alternative;
        const int count = pm_logger_alternatives(v, (pm_logger_choice)k, &name, &alternative);
        // The scene is written, so that choices which change it are settled.
        const int left = k == PM_LOGGER_HOLD                                ? 1
                         : k == PM_LOGGER_INERTIA && count > SUMMED_INERTIA ? SUMMED_INERTIA
                                                                            : count;
        const int id = left > 1 ? pm_hypotheses_add(&laws->space, name, left, alternative) : -1;
        if (id >= 0) {
            laws->choice[id] = (pm_logger_choice)k;
        }
    }
    const pm_status status = pm_search_run(&laws->space, &how, path, NULL);
    free(laws);
    return status;
}

pm_status pm_propose_logger(const char *data, const pm_logger_hints *hints, const char *folder) {
    pm_logger_hints own = *hints;
    pm_logger_draft draft = {.seed = hints->seed};
    pm_dataset *dataset = NULL;
    char scene[PATH_MAX], training[PATH_MAX];
    char *text = NULL;
    size_t size = 0;
    hidden_search *search = calloc(1, sizeof *search);
    FILE *comment = open_memstream(&text, &size);
    bool looked = false, interrupted = false;
    pm_status status = search != NULL && comment != NULL
                           ? PM_OK
                           : pm_fail(PM_ENOMEM, "out of memory for a proposal");
    PM_TRY_DONE(status);
    if (snprintf(scene, sizeof scene, "%s/scene.yaml", folder) >= (int)sizeof scene ||
        snprintf(training, sizeof training, "%s/training.yaml", folder) >= (int)sizeof training) {
        status = pm_fail(PM_EUSAGE, "%s: the path is too long", folder);
        goto done;
    }
    PM_TRY_DONE(pm_dataset_load_measured(&dataset, data, "z"));
    PM_TRY_DONE(pm_files_check_output(scene, PM_PROPOSED));
    PM_TRY_DONE(pm_files_check_output(training, PM_PROPOSED));
    search->dataset = dataset;
    search->hints = hints;
    if (hints->budget > 0) {
        pm_progress_init(&search->progress, "hypotheses, s", lround(ceil(hints->budget)));
        show_progress(search, 0, 0); // regressions on many columns take a while
    }
    status = pm_logger_look(&draft.view, dataset, hints);
    looked = status == PM_OK;
    if (!looked) {
        pm_progress_finish(&search->progress);
        goto done;
    }
    search->data_path = data;
    search->first = draft.view;
    for (int u = draft.view.nvariable; u < draft.view.ncolumn; ++u) {
        const pm_logger_column *input = &draft.view.column[u];
        search->what[0].guess[input->id] = input->clear ? input->other[0] : PM_LOGGER_AS_FOUND;
    }
    if (hints->budget > 0) {
        status = find_hidden(search);
        status = status == PM_OK ? confirm(search) : status;
        pm_progress_finish(&search->progress);
        interrupted = status == PM_EINTERRUPTED;
        PM_TRY_DONE(interrupted ? PM_OK : status);
        if (interrupted) { // the best of what has been tried is written
            search->start = found_by_best(search);
            own.budget = 0;
        }
        print_trials(search, comment);
    }
    own.guess = search->what[search->best].guess;
    own.delay = search->what[search->best].delay;
    pm_logger_view_free(&draft.view);
    looked = false;
    PM_TRY_DONE(pm_logger_look(&draft.view, dataset, &own));
    looked = true;
    take_choices(&draft.view, search->what[search->best].chosen);
    if (pm_logger_is_measured(&draft.view)) {
        draft.found = search->start;
        draft.lean = draft.found != NULL && search->lean[search->best];
        draft.ended = draft.found != NULL && (error_of(search, search->best) < SMALL_ERROR ||
                                              (search->whole > 0 && search->best >= search->whole));
    }
    describe(&draft.view, draft.lean ? draft.found : NULL);
    name_inputs(&draft.view);
    draft.data_path = data;
    draft.coarse = search->trial[search->best].score.coarse;
    PM_TRY_DONE(pm_logger_write_scene(&draft, scene));
    draft.scene_path = scene;
    PM_TRY_DONE(fflush(comment) == 0 ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for a comment"));
    own.budget = fmax(own.budget - search->used, 0);
    PM_TRY_DONE(choose_laws(&draft, &own, search->what[search->best].chosen, text, training));
    printf("wrote %s\nwrote %s\n", scene, training);
    status = interrupted
                 ? pm_fail(PM_EINTERRUPTED, "interrupted: what was best until then is written")
                 : PM_OK;
done:
    if (looked) {
        pm_logger_view_free(&draft.view);
    }
    if (comment != NULL) {
        fclose(comment);
    }
    free(text);
    if (search != NULL) {
        pm_arena_free(&search->arena);
    }
    if (search != NULL && search->looked) {
        pm_logger_view_free(&search->seen);
    }
    free(search);
    pm_dataset_free(dataset);
    return status;
}

// The search: which vectors are tried, how much each trial may cost, and what is kept. A trial runs
// in a child process and a temporary folder, so that a fault or a limit ends it without harm.
#include "propose/search.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <limits.h>
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/arena.h"
#include "base/files.h"
#include "base/path.h"
#include "base/progress.h"
#include "data/trained.h"
#include "fit/fit.h"
#include "model/constants.h"

#define MOST_VECTORS 256 // that are tried
#define ROUNDS 3         // in each of which all alternatives of one choice are tried
#define FINALISTS 3      // vectors that are fitted longer
#define HOPELESS 3       // times the error of the best one: beyond it a vector is not fitted longer
// What a change must reach of the error before, to be kept: other draws of the first weights alone
// change the error of a short fit by up to two times.
#define BETTER 0.5
#define BETTER_ALIKE 0.75 // likewise of a change of all choices of a kind, of which there are few
// The error of one step and of rollouts below which nothing else is tried, since a weak friction in
// wrong directions hardly shows in one step, if a verdict would call each group good, too: where
// some groups are exact, the mean tells nothing about the others.
#define ENOUGH 3e-4
#define SAFETY 20         // the limit of CPU time of a trial over its nominal time
#define FEWEST_SECONDS 60 // of this limit
#define LEAST_SECONDS 15  // likewise, when the time of the search is nearly over
#define FOR_FINALISTS 0.3 // of the budget
#define FOR_ONE_ROUND 1.0

// The cost of an iteration of Gauss-Newton on a nominal machine: operations for each residual and
// pair of weights, for each residual and weight, and operations per second.
#define PER_PAIR 1.0
#define PER_WEIGHT 1000.0
#define SPEED 1e11
#define PER_STAGE 0.25 // of a step of an integrator, in evaluations of a rate with its derivatives

// Sizes of short fits.
#define TRIES 4
#define TRY_ITERATIONS 5
#define START_ITERATIONS \
    64 // of four draws of 5 iterations, the better half 7 more; of strengths 30
#define RESIDUALS_PER_WEIGHT 5
#define FEWEST_SAMPLES 256
#define MOST_SAMPLES 4096
#define FEWEST_ITERATIONS 30
#define MOST_ITERATIONS 120
#define OF_FINALISTS 2 // times as many samples and iterations

#define AT_ONCE 2         // trials that run side by side
#define DETAIL 32         // bytes of the text beside a bar of progress
#define NAME_OF_FILE 16   // room for the name of a file in the folder
#define OPEN_FOLDERS 8    // while a folder is removed
#define MICROSECONDS 1e-6 // s
#define NANOSECONDS 1e-9  // s
#define REPORT_EVERY 500  // ms, between two reports of progress
#define PERCENT 100

typedef struct tried_vector {
    const int *vector;           // [count]
    pm_search_trial trial, last; // of the short fit, and of the longer one
    bool tried, finalist;
} tried_vector;

typedef struct hypothesis_search {
    const pm_hypotheses *space;
    const pm_search_how *how;
    pm_arena arena;
    int ncandidate, best;
    tried_vector candidate[MOST_VECTORS];
    int nz, substeps;
    double share;        // s of nominal time for a short fit
    const char *path;    // of the training file of the winner
    double limit, spent; // s of nominal time
    double used;         // s of CPU time
    pm_progress progress;
} hypothesis_search;

// --- trials ---

// A trial in progress.
typedef struct runner {
    pid_t child; // 0: none
    int id, pipe;
    char folder[PATH_MAX];
} runner;

static int remove_one(const char *path, const struct stat *status, int kind, struct FTW *place) {
    (void)status, (void)kind, (void)place;
    return remove(path);
}

// Lists the learned constants of a system in `found` [PM_SEARCH_FOUND]. spare [weights] numbers
// those that may as well be zero (pm_uncertainty_spare); NULL: none.
static void list_constants(const pm_system *system, const int *spare, char *found) {
    size_t length = 0, at = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            if (!entry->trained) {
                continue;
            }
            const double value = pm_trained_constant(system, i, entry);
            char mark[NAME_OF_FILE + sizeof PM_SEARCH_SPARE] = "";
            if (spare != NULL && spare[at] != 0) {
                snprintf(mark, sizeof mark, "%s%d", PM_SEARCH_SPARE, spare[at]);
            }
            const int n =
                snprintf(found + length, PM_SEARCH_FOUND - length, "%s.%s=%.9g%s\n",
                         pm_trained_name(system, i), pm_constant_name(entry->name), value, mark);
            at += (size_t)(entry->rows * entry->cols);
            if (!isfinite(value) || n < 0 || length + (size_t)n >= PM_SEARCH_FOUND) {
                *found = '\0';
                return;
            }
            length += (size_t)n;
        }
    }
}

// What the child process does. It never returns.
static void work(const pm_hypotheses *space, const int *vector, const pm_fit_effort *effort,
                 double seconds, const char *start, const volatile sig_atomic_t *stop,
                 const runner *r, int pipe) {
    const rlim_t limit = (rlim_t)ceil(seconds);
    const struct rlimit most = {limit, limit}, no_core = {0, 0};
    char config[PATH_MAX + NAME_OF_FILE];
    pm_search_trial result = {
        .failed = true, .score = {.step = INFINITY, .rollout = INFINITY, .production = INFINITY}};
    const int quiet = open("/dev/null", O_WRONLY);
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    (void)setrlimit(RLIMIT_CPU, &most);
    (void)setrlimit(RLIMIT_CORE, &no_core);
    if (quiet >= 0 && dup2(quiet, STDOUT_FILENO) >= 0 && dup2(quiet, STDERR_FILENO) >= 0) {
        snprintf(config, sizeof config, "%s/training.yaml", r->folder);
        static const volatile sig_atomic_t never = 0;
        const pm_fit_arguments a = {.config = config, .output = r->folder, .effort = effort};
        pm_fit f = {0};
        pm_status status = space->write(space->context, vector, "", config);
        status = status == PM_OK ? pm_fit_open(&f, &a, stop == NULL ? &never : stop) : status;
        status = status == PM_OK ? pm_fit_run(&f) : status;
        result.cut = effort->seconds > 0 && f.measured.seconds > effort->seconds;
        const bool judged = status == PM_OK && effort->iterations > 0;
        status = judged ? pm_fit_judge(&f, &result.score) : status;
        status = status == PM_OK && start != NULL ? pm_fit_save_start(&f, start) : status;
        result.failed = status != PM_OK;
        result.iterations = f.position.done;
        result.seconds = f.measured.seconds;
        if (!result.failed) {
            list_constants(f.training->system, f.measured.spare, result.found);
        }
        // The name of the folder is another one each time.
        const size_t length = strlen(r->folder);
        const bool named = strncmp(pm_error(), r->folder, length) == 0;
        snprintf(result.reason, sizeof result.reason, "%s",
                 result.failed ? pm_error() + (named ? length + 1 : 0) : "");
    }
    const bool told = write(pipe, &result, sizeof result) == (ssize_t)sizeof result;
    _exit(told ? EXIT_SUCCESS : EXIT_FAILURE);
}

// Waits for the end of the trial `at` of those in progress, and ends it if `stop` is set. A trial
// that died without a result has failed. `before` is *used at the beginning of all trials.
static void finish(const pm_hypotheses *space, runner *running, int at,
                   const volatile sig_atomic_t *stop, pm_search_trial *trial, double before,
                   double *used) {
    runner *r = &running[at];
    struct rusage usage = {0};
    int end = 0;
    *trial =
        (pm_search_trial){.failed = true,
                          .unfinished = true,
                          .cut = true,
                          .score = {.step = INFINITY, .rollout = INFINITY, .production = INFINITY},
                          .reason = "the fit took too long or ended by a fault"};
    size_t got = 0;
    pm_search_trial result;
    for (ssize_t n = 1; n != 0 && got < sizeof result;) {
        if (stop != NULL && *stop) {
            kill(r->child, SIGTERM);
        }
        for (struct pollfd one = {.fd = r->pipe, .events = POLLIN};
             space->progress != NULL && poll(&one, 1, REPORT_EVERY) == 0;) {
            double seconds = *used - before;
            for (int k = 0; k < AT_ONCE; ++k) {
                clockid_t clock;
                struct timespec own = {0};
                if (running[k].child != 0 && clock_getcpuclockid(running[k].child, &clock) == 0 &&
                    clock_gettime(clock, &own) == 0) {
                    seconds += (double)own.tv_sec + NANOSECONDS * (double)own.tv_nsec;
                }
            }
            space->progress(space->context, r->id, seconds); // all before r have ended
        }
        n = read(r->pipe, (char *)&result + got, sizeof result - got);
        n = n < 0 && errno != EINTR ? 0 : n;
        got += n > 0 ? (size_t)n : 0;
    }
    if (got == sizeof result) {
        *trial = result;
    }
    close(r->pipe);
    while (wait4(r->child, &end, 0, &usage) < 0 && errno == EINTR) {
    }
    *used += (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
             MICROSECONDS * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    (void)nftw(r->folder, remove_one, OPEN_FOLDERS, FTW_DEPTH | FTW_PHYS);
    r->child = 0;
}

pm_status pm_search_try(const pm_hypotheses *space, int count, const int *const *vector,
                        const pm_fit_effort *effort, double seconds, const char *const *start,
                        const volatile sig_atomic_t *stop, pm_search_trial *trial, double *used) {
    runner running[AT_ONCE] = {{.child = 0}};
    const double before = *used;
    const char *root = getenv("TMPDIR");
    const int most = sysconf(_SC_NPROCESSORS_ONLN) < AT_ONCE ? 1 : AT_ONCE;
    pm_status status = PM_OK;
    for (int i = 0; i < count + most; ++i) { // whoever began first is waited for first
        runner *r = &running[i % most];
        int ends[2];
        if (r->child != 0) {
            finish(space, running, i % most, stop, &trial[r->id], before, used);
        }
        if (stop != NULL && *stop && status == PM_OK) {
            status = pm_fail(PM_EINTERRUPTED, "interrupted while hypotheses were tried");
        }
        if (i >= count || status != PM_OK) {
            continue;
        }
        *r = (runner){.id = i};
        snprintf(r->folder, sizeof r->folder, "%s/portmet_trial_XXXXXX",
                 root == NULL ? "/tmp" : root);
        if (mkdtemp(r->folder) == NULL) {
            status = pm_fail(PM_EFILE, "%s: %s", r->folder, strerror(errno));
            continue;
        }
        fflush(NULL); // else the child would write what is in the buffers again
        r->child = pipe(ends) == 0 ? fork() : -1;
        if (r->child == 0) {
            close(ends[0]);
            work(space, vector[i], &effort[i], seconds, start == NULL ? NULL : start[i], stop, r,
                 ends[1]);
        }
        if (r->child < 0) {
            status = pm_fail(PM_EFILE, "a process for a trial: %s", strerror(errno));
            r->child = 0;
            (void)rmdir(r->folder);
            continue;
        }
        close(ends[1]);
        r->pipe = ends[0];
    }
    return status;
}

// --- candidates ---

// The error by which short fits are compared: of one step, or where it is not measured of rollouts.
static double error_of(const pm_search_trial *t) {
    const double error = isnan(t->score.step) ? t->score.rollout : t->score.step;
    return t->failed || isnan(error) ? INFINITY : error;
}

// Returns the sum of the squares of the errors of all groups whose rates a choice changes: the
// error for which the choice may be responsible. The error of one group may be the fault of each
// choice that changes it, and a coupling that is wrong shows at both ends.
static double blame_of(const pm_search_trial *t, const pm_choice *c) {
    double sum = 0;
    for (int g = 0; g < PM_FIT_SCORED_GROUPS; ++g) {
        sum += (c->acts_on >> g & 1) != 0 && !t->failed ? t->score.group[g] * t->score.group[g] : 0;
    }
    return sum;
}

// Returns the geometric mean of the errors of these groups, or that of all where there are none.
static double local_error(const pm_search_trial *t, const pm_choice *c) {
    double sum = 0;
    int count = 0;
    for (int g = 0; g < PM_FIT_SCORED_GROUPS; ++g) {
        if ((c->acts_on >> g & 1) != 0 && t->score.group[g] > 0) {
            sum += log(t->score.group[g]);
            ++count;
        }
    }
    return t->failed || count == 0 ? error_of(t) : exp(sum / count);
}

// Returns whether the rollouts of a are better than those of b by more than the standard error of
// their mean difference (Breiman et al., Classification and Regression Trees, 1984: among models
// within one standard error of the best one the simplest is taken). `factor`: a must be better by.
static bool is_better(const pm_search_trial *a, const pm_search_trial *b, double factor) {
    const int n = a->score.nrollout < b->score.nrollout ? a->score.nrollout : b->score.nrollout;
    double mean = 0, square = 0;
    if (a->failed || b->failed || n < 2) {
        return !a->failed && (b->failed || a->score.rollout < factor * b->score.rollout);
    }
    for (int i = 0; i < n; ++i) {
        const double d = a->score.each[i] - b->score.each[i];
        mean += d / n;
        square += d * d / n;
    }
    return mean + sqrt(fmax(square - mean * mean, 0) / (n - 1)) < log(factor);
}

// Returns the longer fit of a finalist, or the short one if there was no time for it.
static const pm_search_trial *latest(const tried_vector *c) {
    return !c->finalist || c->last.unfinished ? &c->trial : &c->last;
}

static bool is_enough(const hypothesis_search *s, const pm_search_trial *t) {
    const double limit = s->how->enough > 0 ? s->how->enough : ENOUGH;
    bool all = error_of(t) < limit && !(t->score.rollout > limit);
    for (int g = 0; g < PM_FIT_SCORED_GROUPS; ++g) {
        all = all && t->score.group[g] < PM_VERDICT_STEP;
    }
    return all;
}

// Adds a vector unless it is among the candidates. Returns whether it was added.
static bool add_new(hypothesis_search *s, const int *vector) {
    for (int i = 0; i < s->ncandidate; ++i) {
        if (memcmp(s->candidate[i].vector, vector, (size_t)s->space->count * sizeof *vector) == 0) {
            return false;
        }
    }
    if (s->ncandidate == MOST_VECTORS) {
        return false;
    }
    s->candidate[s->ncandidate++] = (tried_vector){.vector = vector};
    return true;
}

// Adds the best vector with another alternative of one choice, or of all of its kind, or, for
// choice -1, with the first alternatives where it has the simplest ones, unless it is among the
// candidates. Returns whether it was added.
static bool add(hypothesis_search *s, int choice, int alternative, bool alike) {
    const int n = s->space->count;
    int *vector = pm_arena_array(&s->arena, (size_t)n + 1, sizeof *vector);
    if (s->arena.failed || s->ncandidate == MOST_VECTORS) {
        return false;
    }
    memcpy(vector, s->candidate[s->best].vector, (size_t)n * sizeof *vector);
    const pm_choice *like = choice < 0 ? NULL : &s->space->choice[choice];
    for (int c = 0; c < n; ++c) {
        const pm_choice *own = &s->space->choice[c];
        const bool simple = choice < 0 && vector[c] == own->simplest;
        vector[c] = c == choice ? alternative : simple ? 0 : vector[c];
        for (int a = 0; alike && a < own->count && own->kind == like->kind; ++a) {
            const bool same = strcmp(own->alternative[a], like->alternative[alternative]) == 0;
            vector[c] = same ? a : vector[c];
        }
    }
    return add_new(s, vector);
}

// --- costs ---

static double seconds_of(const hypothesis_search *s, const pm_fit_effort *e, double weights) {
    const double residuals = (double)e->samples * s->nz;
    const double one = residuals * weights * (PER_PAIR * weights + PER_WEIGHT) / SPEED;
    const double steps = e->stages > 1 ? e->iterations * (1 + PER_STAGE * s->substeps) : 0;
    return one * (START_ITERATIONS + e->iterations + steps);
}

// Returns the effort of a fit of `weights` weights that takes about `seconds`, or the least effort
// if that takes longer.
static pm_fit_effort effort_for(const hypothesis_search *s, int weights, double seconds,
                                int stages) {
    const int wanted = RESIDUALS_PER_WEIGHT * weights / s->nz;
    pm_fit_effort e = {.tries = TRIES,
                       .try_iterations = TRY_ITERATIONS,
                       .samples = wanted < FEWEST_SAMPLES ? FEWEST_SAMPLES
                                  : wanted > MOST_SAMPLES ? MOST_SAMPLES
                                                          : wanted,
                       .iterations = FEWEST_ITERATIONS,
                       .stages = stages};
    e.samples *= stages > 1 ? OF_FINALISTS : 1;
    while (e.iterations < MOST_ITERATIONS && seconds_of(s, &e, weights) < seconds) {
        ++e.iterations;
    }
    return e;
}

static bool is_over(const hypothesis_search *s) {
    return s->how->most > 0 && s->used > s->how->most;
}

// Writes to `path` [PATH_MAX] where the longer fit of a candidate leaves its weights; the winner's
// file has no number (id -1).
static void name_start(const hypothesis_search *s, int id, char *path) {
    char number[NAME_OF_FILE] = "";
    if (id >= 0) {
        snprintf(number, sizeof number, "%d", id);
    }
    snprintf(path, PATH_MAX, "%.*s.start%s", (int)pm_path_stem(s->path), s->path, number);
}

// Counts the weights that a fit of a vector learns, and notes what else its cost follows from.
static pm_status weigh(hypothesis_search *s, const int *vector, int *weights) {
    const pm_hypotheses *space = s->space;
    // Beside the training file there may be a scene with other ports.
    char folder[] = "/tmp/portmet_search_XXXXXX", path[sizeof folder + NAME_OF_FILE];
    if (mkdtemp(folder) == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    snprintf(path, sizeof path, "%s/training.yaml", folder);
    pm_training *t = NULL;
    pm_status status = space->write(space->context, vector, "", path);
    status = status == PM_OK ? pm_training_load(&t, path) : status;
    (void)nftw(folder, remove_one, OPEN_FOLDERS, FTW_DEPTH | FTW_PHYS);
    PM_TRY(status);
    const pm_loss *last = &t->stage[t->nstage - 1].loss;
    *weights = pm_trained_count(t->system);
    s->nz = t->scene->physics.nz;
    s->substeps = last->substeps * (last->integrator == NULL ? 1 : last->integrator->nstage);
    pm_training_free(t);
    return PM_OK;
}

// Tries the candidates which [count] by fits of about `seconds` each, two at a time. Stops when the
// nominal time that is left does not suffice for another fit.
static pm_status run(hypothesis_search *s, int count, const int *which, int stages,
                     double seconds) {
    static const pm_search_trial untried = {.failed = true, .reason = "interrupted"};
    const double most = s->how->most;
    for (int first = 0, n; first < count; first += n) {
        const int *vector[AT_ONCE] = {NULL};
        pm_search_trial trial[AT_ONCE];
        pm_fit_effort effort[AT_ONCE];
        char path[AT_ONCE][PATH_MAX];
        const char *start[AT_ONCE] = {NULL};
        double longest = FEWEST_SECONDS, iteration[AT_ONCE]; // s of an iteration
        for (n = 0; n < AT_ONCE && first + n < count; ++n) {
            int weights = 0;
            vector[n] = s->candidate[which[first + n]].vector;
            const pm_status weighed = weigh(s, vector[n], &weights);
            PM_TRY(which[first + n] == 0 ? weighed : PM_OK); // what fails here fails as a trial
            effort[n] = effort_for(s, weights, seconds, stages);
            const double cost = seconds_of(s, &effort[n], weights);
            if (s->spent + cost > s->limit) {
                break;
            }
            s->spent += cost;
            pm_fit_effort less = effort[n];
            less.iterations -= 1;
            iteration[n] = cost - seconds_of(s, &less, weights);
            longest = fmax(longest, SAFETY * cost);
            name_start(s, which[first + n], path[n]);
            start[n] = path[n];
            tried_vector *c = &s->candidate[which[first + n]];
            c->trial = c->tried ? c->trial : untried;
            c->tried = true; // its weights may be left, however it ends
        }
        if (n == 0) {
            return PM_OK;
        }
        // The trials end with the time that is left, if it is measured, but not at once.
        const double left = most > 0 ? fmax((most - s->used) / n, LEAST_SECONDS) : INFINITY;
        PM_TRY(pm_search_try(s->space, n, vector, effort, fmin(longest, left),
                             s->space->start != NULL ? start : NULL, s->how->stop, trial,
                             &s->used));
        for (int i = 0; i < n; ++i) {
            tried_vector *c = &s->candidate[which[first + i]];
            *(stages > 1 ? &c->last : &c->trial) = trial[i];
            s->spent -=
                trial[i].failed ? 0 : iteration[i] * (effort[i].iterations - trial[i].iterations);
            c->finalist = c->finalist || stages > 1;
        }
        if (s->how->loud) {
            char detail[DETAIL];
            snprintf(detail, sizeof detail, "%d hypothes%s", s->ncandidate,
                     s->ncandidate == 1 ? "is" : "es");
            pm_progress_update(&s->progress, lround(fmin(s->spent, s->how->budget)), detail);
        }
    }
    return PM_OK;
}

// Tries the candidates from number `first` on, as many as the time allows.
static pm_status run_new(hypothesis_search *s, int first) {
    int which[MOST_VECTORS], count = 0;
    for (int i = first; i < s->ncandidate && !is_over(s); ++i) {
        which[count++] = i;
    }
    const pm_status status = run(s, count, which, 1, s->share);
    while (s->ncandidate > first && !s->candidate[s->ncandidate - 1].tried) {
        --s->ncandidate;
    }
    return status;
}

// --- the search ---

// Fits the best candidates longer, unless the best one is good enough. The winner becomes s->best.
static pm_status decide(hypothesis_search *s, double seconds) {
    int which[FINALISTS], count = 0;
    // What was taken because it is simple is compared with what is believed more, by longer fits.
    const int last = s->ncandidate;
    bool doubt = add(s, -1, 0, false);
    s->limit = fmax(s->limit, s->spent + s->share);
    PM_TRY(run_new(s, last));
    doubt = doubt && s->ncandidate > last;
    const double best = error_of(&s->candidate[s->best].trial);
    while (count < FINALISTS && (doubt || !is_enough(s, &s->candidate[s->best].trial))) {
        int next = -1;
        for (int i = 0; i < s->ncandidate; ++i) {
            bool has = false;
            for (int k = 0; k < count; ++k) {
                has = has || which[k] == i;
            }
            const double error = error_of(&s->candidate[i].trial);
            if (!has && error < HOPELESS * best &&
                (next < 0 || error < error_of(&s->candidate[next].trial))) {
                next = i;
            }
        }
        if (next < 0) {
            break;
        }
        which[count++] = next;
    }
    if (count <= 1 || is_over(s)) {
        return PM_OK;
    }
    s->limit = s->spent + seconds;
    PM_TRY(run(s, count, which, 2, seconds / count));
    // Among equals the one that is believed more, which was tried first, wins, and the simple one.
    s->best = which[0];
    for (int k = 1; k < count; ++k) {
        const pm_search_trial *t = latest(&s->candidate[which[k]]);
        const pm_search_trial *b = latest(&s->candidate[s->best]);
        const bool is_last = doubt && which[k] == last, was_last = doubt && s->best == last;
        if (was_last             ? !is_better(b, t, BETTER)
            : which[k] < s->best ? !is_better(b, t, 1)
                                 : is_better(t, b, is_last ? BETTER : 1)) {
            s->best = which[k];
        }
    }
    return PM_OK;
}

// Tries the alternatives of all choices of one kind together, one kind after the other: what holds
// for one component often holds for the others, and shows little as long as it is there alone.
static pm_status descend_alike(hypothesis_search *s) {
    const pm_hypotheses *space = s->space;
    for (int c = 0; c < space->count; ++c) {
        const pm_choice *choice = &space->choice[c];
        int alike = 0, before = 0;
        for (int k = 0; k < space->count; ++k) {
            alike += space->choice[k].kind == choice->kind;
            before += k < c && space->choice[k].kind == choice->kind;
        }
        if (choice->kind == 0 || alike < 2 || before > 0 ||
            is_enough(s, &s->candidate[s->best].trial)) {
            continue;
        }
        const int first = s->ncandidate;
        for (int a = 0; a < choice->count; ++a) {
            (void)add(s, c, a, true);
        }
        PM_TRY(run_new(s, first));
        const double all = error_of(&s->candidate[s->best].trial);
        for (int i = first; i < s->ncandidate; ++i) {
            const double error = error_of(&s->candidate[i].trial);
            if (error < BETTER_ALIKE * all && error < error_of(&s->candidate[s->best].trial)) {
                s->best = i;
            }
        }
    }
    return PM_OK;
}

// Tries all changes of the best vector together that have lowered the error, each of them too
// little to be kept. Where several change the same choice, the one with the least error counts.
static pm_status try_together(hypothesis_search *s) {
    const int n = s->space->count, first = s->ncandidate;
    const tried_vector *best = &s->candidate[s->best];
    int *vector = pm_arena_array(&s->arena, (size_t)n + 1, sizeof *vector);
    double *least = pm_arena_array(&s->arena, (size_t)n + 1, sizeof *least);
    PM_TRY(pm_arena_status(&s->arena, "a search"));
    memcpy(vector, best->vector, (size_t)n * sizeof *vector);
    for (int i = 0; i < s->ncandidate; ++i) {
        const double error = error_of(&s->candidate[i].trial);
        for (int c = 0; c < n && error < error_of(&best->trial); ++c) {
            if (s->candidate[i].vector[c] != best->vector[c] &&
                !(error >= least[c] && least[c] > 0)) {
                vector[c] = s->candidate[i].vector[c];
                least[c] = error;
            }
        }
    }
    if (add_new(s, vector)) {
        PM_TRY(run_new(s, first));
    }
    for (int i = first; i < s->ncandidate; ++i) {
        s->best =
            error_of(&s->candidate[i].trial) < error_of(&s->candidate[s->best].trial) ? i : s->best;
    }
    return PM_OK;
}

// Tries the alternatives of one choice after the other, each time beside the best vector so far,
// until a whole round changes nothing or the best one is good enough.
static pm_status descend(hypothesis_search *s, int alternatives) {
    const pm_hypotheses *space = s->space;
    const double budget = s->how->budget;
    s->share = FOR_ONE_ROUND * budget / alternatives;
    int *simplest = pm_arena_array(&s->arena, (size_t)space->count + 1, sizeof *simplest);
    bool other = false;
    PM_TRY(pm_arena_status(&s->arena, "a search"));
    for (int c = 0; c < space->count; ++c) {
        simplest[c] = space->choice[c].simplest;
        other = other || simplest[c] > 0;
    }
    if (other) {
        s->candidate[s->ncandidate++] = (tried_vector){.vector = simplest};
    }
    s->limit = INFINITY;
    PM_TRY(run_new(s, 0));
    s->limit = (1 - FOR_FINALISTS) * budget;
    // The simplest vector, unless it is clearly worse.
    s->best = other && BETTER * error_of(&s->candidate[1].trial) < error_of(&s->candidate[0].trial);
    PM_TRY(descend_alike(s));
    PM_TRY(try_together(s));
    bool goes_on = true;
    for (int round = 0; round < ROUNDS && goes_on; ++round) {
        bool asked[PM_SEARCH_CHOICES] = {false};
        goes_on = false;
        for (int n = 0; n < space->count; ++n) {
            // The choice that may be to blame for the largest error, else the one that came first.
            const pm_search_trial *so_far = &s->candidate[s->best].trial;
            int c = -1;
            for (int k = 0; k < space->count; ++k) {
                c = !asked[k] && (c < 0 || blame_of(so_far, &space->choice[k]) >
                                               blame_of(so_far, &space->choice[c]))
                        ? k
                        : c;
            }
            asked[c] = true;
            const pm_choice *choice = &space->choice[c];
            const int first = s->ncandidate, own = s->candidate[s->best].vector[c];
            const double before = local_error(so_far, choice), all = error_of(so_far);
            if (is_enough(s, so_far)) {
                return PM_OK;
            }
            for (int a = 0; a < choice->count; ++a) {
                (void)(a != own && add(s, c, a, false));
            }
            PM_TRY(run_new(s, first));
            for (int i = first; i < s->ncandidate; ++i) {
                const pm_search_trial *tried = &s->candidate[i].trial;
                if (error_of(tried) < all && local_error(tried, choice) < BETTER * before &&
                    local_error(tried, choice) <
                        local_error(&s->candidate[s->best].trial, choice)) {
                    s->best = i;
                    goes_on = true;
                }
            }
        }
        const int before_all = s->best;
        s->limit = fmax(s->limit, s->spent + s->share);
        PM_TRY(try_together(s));
        goes_on = goes_on || s->best != before_all;
    }
    return PM_OK;
}

// --- the comment ---

static void print_trial(FILE *f, const pm_search_trial *t) {
    if (t->failed) {
        fprintf(f, "failed: %s", t->reason);
        return;
    }
    const double error[] = {t->score.step, t->score.rollout, t->score.production};
    for (int i = 0; i < 3; ++i) {
        fprintf(f, isnan(error[i]) ? "%s-" : "%s%.3g", i > 0 ? ", " : "", PERCENT * error[i]);
    }
}

// Writes what was tried. Each line has the alternatives that are not the first ones.
static void print_trials(const hypothesis_search *s, FILE *f) {
    fprintf(f,
            "# Hypotheses were tried by short fits. Errors on the validation part, in %%: of one "
            "step, of rollouts\n# relative to persistence, of the entropy produced; then those "
            "of longer fits of the best ones.\n");
    for (int i = 0; i < s->ncandidate; ++i) {
        const tried_vector *c = &s->candidate[i];
        bool any = false;
        if (!c->tried) { // interrupted before
            continue;
        }
        fprintf(f, "# %s ", i == s->best ? "*" : "-");
        for (int k = 0; k < s->space->count; ++k) {
            const pm_choice *choice = &s->space->choice[k];
            if (c->vector[k] > 0) {
                fprintf(f, "%s%s: %s", any ? "; " : "", choice->name,
                        choice->alternative[c->vector[k]]);
                any = true;
            }
        }
        fprintf(f, "%s (", any ? "" : "as proposed from units and statistics");
        print_trial(f, &c->trial);
        if (c->finalist) {
            fprintf(f, "; longer: ");
            print_trial(f, &c->last);
        }
        fprintf(f, ")\n");
    }
}

pm_status pm_search_run(const pm_hypotheses *space, const pm_search_how *how, const char *path,
                        pm_search_outcome *outcome) {
    char *text = NULL, own[PATH_MAX], start[PATH_MAX];
    size_t size = 0;
    int alternatives = 1;
    hypothesis_search *s = calloc(1, sizeof *s);
    FILE *comment = s == NULL ? NULL : open_memstream(&text, &size);
    pm_status status = PM_OK;
    if (comment == NULL) {
        free(s);
        return pm_fail(PM_ENOMEM, "out of memory for a search");
    }
    s->space = space;
    s->how = how;
    s->path = path;
    if (space->start != NULL) { // a file of somebody else stays
        name_start(s, -1, start);
        PM_TRY_DONE(pm_files_check_output(start, "portmet snapshot"));
    }
    for (int c = 0; c < space->count; ++c) {
        alternatives += space->choice[c].count - 1;
    }
    int *vector = pm_arena_array(&s->arena, (size_t)space->count + 1, sizeof *vector);
    PM_TRY_DONE(pm_arena_status(&s->arena, "a search"));
    s->candidate[s->ncandidate++] = (tried_vector){.vector = vector};
    bool interrupted = false;
    if (how->budget > 0 && alternatives > 1) {
        pm_progress_init(&s->progress, "proposal, s", lround(ceil(how->budget)));
        status = descend(s, alternatives);
        status = status == PM_OK ? decide(s, FOR_FINALISTS * how->budget) : status;
        if (how->loud) {
            pm_progress_finish(&s->progress);
        }
        interrupted = status == PM_EINTERRUPTED && outcome == NULL;
        PM_TRY_DONE(interrupted ? PM_OK : status);
        print_trials(s, comment);
        const pm_search_trial *kept = &s->candidate[s->best].trial;
        const bool loud = how->loud && !interrupted;
        if (loud && kept->failed) {
            printf("none of %d hypothes%s leads to a model (%s): the file is a beginning to edit\n",
                   s->ncandidate, s->ncandidate == 1 ? "is" : "es", kept->reason);
        } else if (loud) {
            printf("tried %d hypothes%s about %d choice%s in %.0f s of CPU; %s\n", s->ncandidate,
                   s->ncandidate == 1 ? "is" : "es", space->count, space->count == 1 ? "" : "s",
                   s->used,
                   s->best == 0 ? "the first one is kept"
                                : "the head of the file says which one is kept");
        }
    }
    if (outcome != NULL) {
        const tried_vector *first = &s->candidate[0], *best = &s->candidate[s->best];
        const bool longer = first->finalist && best->finalist;
        memcpy(outcome->chosen, best->vector, (size_t)space->count * sizeof *best->vector);
        outcome->ntried = s->ncandidate;
        outcome->first = longer ? first->last : first->trial;
        outcome->best = longer ? best->last : best->trial;
    }
    name_start(s, s->best, own);
    name_start(s, -1, start);
    // Draws may be better than bad weights.
    const bool good = s->candidate[s->best].tried &&
                      latest(&s->candidate[s->best])->score.rollout < PM_VERDICT_GOOD;
    const bool starts = space->start != NULL && good && rename(own, start) == 0;
    if (starts) {
        const char *slash = strrchr(start, '/');
        *space->start = slash == NULL ? start : slash + 1;
    }
    status = fflush(comment) == 0
                 ? space->write(space->context, s->candidate[s->best].vector, text, path)
                 : pm_fail(PM_ENOMEM, "out of memory for a comment");
    if (starts) {
        *space->start = NULL;
    }
    if (interrupted && status == PM_OK) {
        status = pm_fail(PM_EINTERRUPTED, "interrupted: what was best until then is written");
    }
done:
    for (int i = 0; i < s->ncandidate; ++i) {
        name_start(s, i, own);
        (void)(space->start != NULL && s->candidate[i].tried && remove(own));
    }
    fclose(comment);
    free(text);
    pm_arena_free(&s->arena);
    free(s);
    return status;
}

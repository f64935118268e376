// Chooses a training file by trying. A space of hypotheses is a list of choices, each with a few
// alternatives in the order in which they are believed before any trial. A writer turns a vector,
// one alternative for each choice, into a training file. A trial is a short fit of that file in a
// process of its own, measured on the validation part. The search begins with the vector of first
// alternatives or, unless it is clearly worse, that of the simplest ones, tries the same
// alternative of all choices of one kind together, then the alternatives of one choice after the
// other, first of that whose groups have the largest errors, and keeps what lowers the error of one
// step of these groups, until nothing does; the best few are then fitted longer, and their rollouts
// decide (coordinate descent, and a last round of successive halving, Jamieson, Talwalkar, AISTATS
// 2016).
//
// The same space, data and budget give the same vector: the budget is turned into a number of
// trials and of iterations by a nominal speed. A clock ends the search on slow machines alone.
#ifndef PM_TRAINER_PROPOSE_SEARCH_H
#define PM_TRAINER_PROPOSE_SEARCH_H

#include <signal.h>
#include <stdbool.h>
#include <stdio.h>

#include "base/status.h"
#include "fit/fit.h"

// What a proposal writes begins so: it replaces no other file.
#define PM_PROPOSED "# Proposed by portmet-train propose"

// How much slower than the nominal machine a machine may be without a shorter search.
#define PM_SEARCH_SLOW 1.5

#define PM_SEARCH_CHOICES 64
#define PM_SEARCH_ALTERNATIVES 8
#define PM_SEARCH_NAME 96

typedef struct pm_choice {
    char name[PM_SEARCH_NAME]; // what is chosen, such as "L of tank"
    int count;                 // number of alternatives, at least 1
    int simplest; // the alternative with the fewest functions; these are also tried all together
    const char *alternative[PM_SEARCH_ALTERNATIVES]; // [count] in words; static or borrowed texts
    int kind; // choices of one kind, not 0, ask the same about different components
    // The groups of the scene whose rates it changes (fit/fit.h: pm_fit_score), a bit for each; 0:
    // asked last.
    unsigned long long acts_on;
} pm_choice;

typedef struct pm_hypotheses {
    int count;
    pm_choice choice[PM_SEARCH_CHOICES]; // [count]
    // Writes the training file of the vector `chosen` [count] to `path`. `comment` are lines that
    // begin with "# ", for the head of the file, or "". Called in child processes, too, and for
    // files in temporary folders, so that paths in the file are as seen from its folder. It names
    // its data.
    pm_status (*write)(void *context, const int *chosen, const char *comment, const char *path);
    void *context;
    // While the file of the winner is written, *start is the name of the file beside it that holds
    // the weights of the winner's short fit, or NULL if there is none. `start` itself may be NULL.
    const char **start;
    // Called twice a second while pm_search_try runs, so that progress can be shown: `ended` trials
    // have ended, and all of them have taken `seconds` of CPU time so far. NULL: nothing is called.
    void (*progress)(void *context, int ended, double seconds);
} pm_hypotheses;

typedef struct pm_search_how {
    double budget; // s of CPU time on a nominal machine; 0: the first vector is written untried
    // s of CPU time as it is measured, after which the trials end; 0: no limit. On a machine that
    // needs longer the result depends on the machine.
    double most;
    bool loud;                         // print a line for each round
    const volatile sig_atomic_t *stop; // ends the search when nonzero; or NULL
    double enough; // error of a short fit below which nothing else is tried; 0: 1 %
} pm_search_how;

// Adds a choice with `count` alternatives, or nothing if there is one alternative only or no room.
// Returns its number, or -1.
static inline int pm_hypotheses_add(pm_hypotheses *space, const char *name, int count,
                                    const char *const *alternative) {
    if (count < 2 || count > PM_SEARCH_ALTERNATIVES || space->count == PM_SEARCH_CHOICES) {
        return -1;
    }
    pm_choice *c = &space->choice[space->count];
    snprintf(c->name, sizeof c->name, "%s", name);
    c->count = count;
    for (int i = 0; i < count; ++i) {
        c->alternative[i] = alternative[i];
    }
    return space->count++;
}

#define PM_SEARCH_FOUND 32768
// Behind the value of a constant that may as well be zero, before its number: the least first.
#define PM_SEARCH_SPARE " spare "

// The result of a trial.
typedef struct pm_search_trial {
    pm_fit_score score;      // infinite where the fit has failed
    int iterations;          // of the last stage: it ends sooner when it makes no more progress
    double seconds;          // measurements: of CPU time on a nominal machine
    bool failed, unfinished; // unfinished: it took too long, or ended by a fault
    bool cut;                // measurements: its time was over before its fit had ended
    char reason[256];        // why it has failed
    // Lines COMPONENT.CONSTANT=VALUE, one for each learned constant where the fit has left it; ""
    // if something else was learned, too.
    char found[PM_SEARCH_FOUND];
} pm_search_trial;

// Fits the training files of `count` vectors, vector[i] [space->count], each with its effort
// [count], and writes their results to trial [count], two at a time where there are as many
// processors. `seconds` is the limit of CPU time of each, a safeguard that no fit should reach,
// since it depends on the machine. The results do not depend on the order in which the fits end.
// The weights of each go to a file start[i], unless `start` is NULL. Adds their CPU time to *used.
// PM_EFILE, PM_EINTERRUPTED.
pm_status pm_search_try(const pm_hypotheses *space, int count, const int *const *vector,
                        const pm_fit_effort *effort, double seconds, const char *const *start,
                        const volatile sig_atomic_t *stop, pm_search_trial *trial, double *used);

// The result of a search.
typedef struct pm_search_outcome {
    int chosen[PM_SEARCH_CHOICES]; // [space->count] the winner
    int ntried;                    // vectors that were tried
    // The results of the first alternatives and of the winner: of longer fits if both had one, else
    // of short ones.
    pm_search_trial first, best;
} pm_search_outcome;

// Searches and writes the training file of the winner to `path`, with a comment: what was tried,
// how far each came. A trial that fails is a bad hypothesis, not a failure. `outcome` may be NULL.
// Fails as space->write does for the winner; PM_EFILE: no temporary folder; PM_EINTERRUPTED, where
// without `outcome` the best so far is written; PM_ENOMEM.
pm_status pm_search_run(const pm_hypotheses *space, const pm_search_how *how, const char *path,
                        pm_search_outcome *outcome);

#endif

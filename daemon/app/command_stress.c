// portmetd stress: where does a scene break? Rollouts from starts within the training range and
// beyond, with longer steps, other inputs, and many steps.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/command.h"
#include "app/prepare.h"
#include "base/journal.h"
#include "base/options.h"
#include "base/python.h"
#include "study/rollout.h"

#define BUDGET 60.0     // s of CPU time, by default
#define SHARE 0.4       // of the budget that all rollouts but the long one are planned to take
#define LONG_SHARE 0.25 // of the budget for the long one, or
#define LONG_MOST 0.9   // if all its steps fit into this, while another core takes the others
#define LONG 1000000    // steps of the long one, or
#define MANY 1000       // times as many as --steps
#define TRIAL 0.1       // s of CPU time in which the cost of a step is measured
#define MOST_STEPS 500  // of a rollout
#define LEAST_STEPS 20  // of a rollout, however slow the scene is
#define INSIDE 24       // starts within the training range
#define BEYOND 6        // starts for each distance from the range
#define WIDTHS 4        // distances: 0, 1, 2 and 3 widths of the range
#define TRAJECTORIES 8  // of the reference among the starts
#define LENGTHS 6       // steps: the scene's, times 2, 4, ...
#define FACTORS 3       // inputs times 2, 4, 8
#define SETS 12         // rollouts in whose middle a subsystem is set to another state
#define MOST_CASES 512  // rollouts
#define MOST_TIMES 1e6  // that a step or inputs are multiplied by
#define DRIFTS 0.01     // part of the energy moved from which the total counts as drifting
#define BREAKS 0.1      // and as broken

typedef enum verdict { GOOD, DRIFTING, BROKEN, NVERDICT } verdict;

// One rollout and how it ended.
typedef struct rollout {
    const char *kind; // a line of the table
    const pm_start *start;
    pm_rollout_spec spec;
    int length, distance; // place in the map; -1: it is not in the map
    bool own;             // within the training range, with the scene's own settings
    bool longer, larger;  // step, or inputs, are doubled until it breaks
    bool done, refused;   // refused: the scene does not allow this step
    pm_rollout_result result;
} rollout;

typedef struct stress {
    const pm_run_options *options;
    pm_setup base;
    char *text;
    char *mean; // `text` with the inputs that lie in a table at their means
    int count;
    rollout *rollout; // [MOST_CASES] shared
    int many;         // number of the long one
} stress;

// The text of the scene that a rollout runs. A table allows neither steps that cross its jumps nor
// more steps than it has.
static const char *text_of(const stress *t, const rollout *r) {
    return r->spec.stepping.dt != t->base.scene->physics.dt ||
                   r->spec.stepping.steps > t->base.boundary_input.end
               ? t->mean
               : t->text;
}

static verdict judge(const rollout *r) {
    const pm_rollout_result *result = &r->result;
    const double drift = result->drift > result->rounding ? result->drift / result->moved : 0;
    return result->status != PM_OK || result->violations > 0 || drift > BREAKS ? BROKEN
           : drift > DRIFTS                                                    ? DRIFTING
                                                                               : GOOD;
}

static void measure(void *context, int i) {
    stress *t = context;
    // The long one begins first, since it takes the longest.
    rollout *r = &t->rollout[i > t->many ? i : i > 0 ? i - 1 : t->many];
    for (double times = 1; times <= MOST_TIMES; times *= 2) {
        pm_setup setup;
        r->refused = pm_rollout_open(&setup, &t->base, text_of(t, r), &r->spec.stepping) != PM_OK;
        if (!r->refused) {
            pm_rollout_run(&setup, r->start, &r->spec, NULL, &r->result);
        } else {
            snprintf(r->result.why, sizeof r->result.why, "%s", pm_error());
        }
        pm_setup_free(&setup);
        if (r->refused || judge(r) == BROKEN || !(r->longer || r->larger)) {
            break;
        }
        r->spec.stepping.dt *= r->longer ? 2 : 1;
        r->spec.factor *= r->larger ? 2 : 1;
    }
    r->done = true;
}

// Describes how a broken rollout ended.
static const char *explain(const rollout *r, char *text, size_t size) {
    const pm_rollout_result *result = &r->result;
    if (result->status != PM_OK) {
        snprintf(text, size, "in step %ld: %s", result->steps + 1, result->why);
    } else if (result->violations > 0) {
        snprintf(text, size, "%ld of %ld steps violate a law or have not converged",
                 result->violations, result->steps);
    } else {
        snprintf(text, size, "the total energy drifts by %.2g J, where %.2g J move, in %ld steps",
                 result->drift, result->moved, result->steps);
    }
    return text;
}

// Prints how far the long one has come, and which budget would take it to its end.
static void print_many(const rollout *r) {
    const pm_rollout_result *result = &r->result;
    const double all = result->seconds * r->spec.stepping.steps / (double)result->steps;
    const double share = pm_rollout_nworker() > 1 ? LONG_MOST : LONG_SHARE;
    printf("    %ld steps", result->steps);
    if (result->steps < r->spec.stepping.steps) {
        printf(" of %d: all of them need a --budget of %.0f s", r->spec.stepping.steps,
               ceil(1.1 * all / share));
    }
    printf("\n");
}

static pm_status report(stress *t) {
    const pm_run_options *options = t->options;
    const rollout *first = NULL, *beyond = NULL; // failures
    int map[WIDTHS][LENGTHS][NVERDICT] = {{{0}}}, left = 0;
    char text[512], quoted[600];
    for (int i = 0; i < t->count; ++i) {
        const rollout *r = &t->rollout[i];
        left += !r->done;
        if (!r->done || r->refused) {
            continue;
        }
        const verdict v = judge(r);
        if (r->length >= 0) {
            map[r->distance][r->length][v] += 1;
        }
        first = first == NULL && v == BROKEN && r->own ? r : first;
        beyond = beyond == NULL && v == BROKEN && !r->own ? r : beyond;
        if (options->json) {
            pm_json_quote(quoted, sizeof quoted, v == BROKEN ? explain(r, text, sizeof text) : "");
            printf("%s{\"kind\":\"%s\",\"widths\":%g,\"dt\":%.17g,\"factor\":%g,\"verdict\":%d,"
                   "\"steps\":%ld,\"outside\":%ld,\"why\":%s}",
                   i == 0 ? "{\"rollouts\":[" : ",", r->kind, r->start->widths, r->spec.stepping.dt,
                   r->spec.factor, v, r->result.steps, r->result.outside, quoted);
        }
    }
    if (options->json) {
        printf("],\"held\":%s}\n", first == NULL ? "true" : "false");
    } else {
        // Their number depends on how fast this machine is, unless --steps says it.
        snprintf(text, sizeof text, "%s, %d steps", t->base.scene->name,
                 t->rollout[0].spec.stepping.steps);
        printf("%-44s %8s %6s %9s %7s %10s %10s %8s\n", text, "rollouts", "good", "drifting",
               "broken", "drift, J", "S falls", "outside");
    }
    for (int i = 0; i < t->count && !options->json;) {
        const char *kind = t->rollout[i].kind;
        const rollout *broken = NULL;
        int n[NVERDICT] = {0};
        long steps = 0, outside = 0;
        double drift = 0, fall = 0;
        for (; i < t->count && t->rollout[i].kind == kind; ++i) {
            const rollout *r = &t->rollout[i];
            if (r->done && !r->refused) {
                n[judge(r)] += 1;
                steps += r->result.steps;
                outside += r->result.outside;
                drift = fmax(drift, r->result.drift);
                fall = fmax(fall, r->result.fall);
                broken = broken == NULL && judge(r) == BROKEN ? r : broken;
            }
        }
        if (n[GOOD] + n[DRIFTING] + n[BROKEN] == 0) {
            continue;
        }
        printf("%-44s %8d %6d %9d %7d %10.1e %10.1e %6.1f %%\n", kind,
               n[GOOD] + n[DRIFTING] + n[BROKEN], n[GOOD], n[DRIFTING], n[BROKEN], drift, fall,
               steps > 0 ? 100.0 * (double)outside / (double)steps : 0);
        if (broken != NULL) {
            printf("    the first: dt %g s", broken->spec.stepping.dt);
            if (broken->spec.factor > 1) {
                printf(", inputs times %g", broken->spec.factor);
            }
            printf(": %s\n", explain(broken, text, sizeof text));
        } else if (i - 1 == t->many) {
            print_many(&t->rollout[t->many]);
        }
    }
    const rollout *refused = NULL;
    for (int i = 0; i < t->count && refused == NULL; ++i) {
        refused = t->rollout[i].done && t->rollout[i].refused ? &t->rollout[i] : NULL;
    }
    if (!options->json && t->base.boundary_input.end <= LONG) {
        printf("The inputs lie in a table of %ld steps: longer steps and the rollout of many steps "
               "hold their means.\n",
               t->base.boundary_input.end);
    }
    if (!options->json && refused != NULL) {
        printf("Left out: %s: %s\n", refused->kind, refused->result.why);
    }
    FILE *file = NULL;
    pm_status picture = PM_OK;
    if (options->picture != NULL) {
        PM_TRY(pm_python_table(&file, options->picture, ".txt"));
    }
    for (int k = 0; k < WIDTHS; ++k) {
        for (int l = 0; l < LENGTHS; ++l) {
            const int *n = map[k][l], all = n[GOOD] + n[DRIFTING] + n[BROKEN];
            if (!options->json && l == 0) {
                printf("%s%-18s",
                       k == 0 ? "\nMap: good/drifting/broken; to the right steps of dt "
                                "times 1, 2, 4, ...\n"
                              : "",
                       k == 0   ? "  in the range"
                       : k == 1 ? "  1 width beyond"
                       : k == 2 ? "  2 widths beyond"
                                : "  3 widths beyond");
            }
            if (!options->json) {
                snprintf(text, sizeof text, all == 0 ? "-" : "%d/%d/%d", n[GOOD], n[DRIFTING],
                         n[BROKEN]);
                printf(" %10s%s", text, l == LENGTHS - 1 ? "\n" : "");
            }
            if (file != NULL) {
                fprintf(file, "%g%s",
                        all == 0 ? NAN : (0.5 * n[DRIFTING] + n[BROKEN]) / (double)all,
                        l == LENGTHS - 1 ? "\n" : " ");
            }
        }
    }
    if (file != NULL) {
        const char *const drawn[] = {"stress", options->picture, NULL};
        fclose(file);
        picture = pm_python_run(&pm_python_pictures, drawn, false);
    }
    if (!options->json && left > 0) {
        printf("\n%d of %d rollouts are left out: they need a larger --budget.\n", left, t->count);
    }
    const rollout *shown = first != NULL ? first : beyond;
    if (options->write != NULL && shown != NULL) {
        // A scene that begins as the rollout did, or in the state that was set, with its steps.
        const pm_physics *physics = &t->base.scene->physics;
        const size_t nz = (size_t)physics->nz;
        pm_rollout_spec spec = shown->spec;
        pm_rollout_result result;
        const double *z = shown->start->z;
        spec.stepping.steps /= 2;
        spec.set = NULL;
        double *states =
            pm_arena_array(&t->base.arena, (size_t)(spec.stepping.steps + 1) * nz, sizeof *states);
        if (shown->spec.set != NULL && states != NULL) {
            const pm_scene_subsystem *s = &physics->subsystem[shown->spec.subsystem];
            double *at = states + (size_t)spec.stepping.steps * nz;
            pm_rollout_run(&t->base, shown->start, &spec, states, &result);
            memcpy(at + s->first, shown->spec.set + s->first, (size_t)s->layout.nz * sizeof *at);
            z = at;
        }
        char *scene = strdup(text_of(t, shown)), *value = NULL;
        size_t size;
        FILE *list = open_memstream(&value, &size);
        for (int i = 0; list != NULL && i < physics->nz; ++i) {
            fprintf(list, "%s%.17g%s", i == 0 ? "[" : ", ", z[i], i == physics->nz - 1 ? "]" : "");
        }
        pm_status status = list == NULL || fclose(list) != 0 || scene == NULL
                               ? pm_fail(PM_ENOMEM, "out of memory for a scene")
                               : pm_scene_text_put_time(&scene, &shown->spec.stepping);
        if (status == PM_OK) {
            status = pm_scene_text_put(&scene, "start", value);
        }
        // Its times are no multiples of another dt.
        if (status == PM_OK && shown->spec.stepping.dt != physics->dt) {
            status = pm_scene_text_put(&scene, "reference", NULL);
        }
        if (status == PM_OK) {
            status = pm_scene_text_write(scene, options->write, options->weights);
        }
        free(scene);
        free(value);
        PM_TRY(status);
        if (!options->json) {
            printf("\n%s repeats: %s, dt %g s: `portmetd run %s --in-process`\n", options->write,
                   shown->kind, shown->spec.stepping.dt, options->write);
        }
    }
    if (first != NULL) {
        return pm_fail(PM_EBROKEN, "stress: %s: %s", first->kind,
                       explain(first, text, sizeof text));
    }
    if (!options->json) {
        printf("\nThe scene's own settings held from every start inside the training range.\n");
    }
    return picture;
}

static void add(stress *t, const char *kind, const pm_start *start, const pm_stepping *stepping,
                double times, int length, int distance) {
    if (t->count < MOST_CASES) {
        rollout *r = &t->rollout[t->count++];
        *r = (rollout){.kind = kind, .start = start, .length = length, .distance = distance};
        r->spec = (pm_rollout_spec){.stepping = *stepping, .factor = 1};
        r->spec.stepping.dt = times * stepping->dt;
        r->own = times == 1 && start->widths == 0;
    }
}

static pm_status execute(const pm_run_options *options) {
    static const char *const distance[WIDTHS] = {
        "starts within the training range", "starts up to 1 width beyond",
        "starts up to 2 widths beyond", "starts up to 3 widths beyond"};
    static const char *const longer[LENGTHS] = {"",           "dt times 2",  "dt times 4",
                                                "dt times 8", "dt times 16", "dt times 32"};
    static const char *const larger[FACTORS] = {"inputs times 2", "inputs times 4",
                                                "inputs times 8"};
    static const char *const drives[PM_NDRIVE] = {"", "inputs vanish in the middle",
                                                  "inputs jump every ten steps",
                                                  "inputs change their sign every step"};
    stress t = {.options = options};
    pm_start start[WIDTHS][INSIDE];
    int nstart[WIDTHS];
    const double budget = options->budget > 0 ? options->budget : BUDGET;
    double left = budget;
    pm_rollout_result trial;
    pm_status status;
    PM_TRY_DONE(pm_prepare(&t.base, options, PM_TO_COORDINATE));
    PM_TRY_DONE(pm_scene_text_read(t.base.scene->path, &t.text));
    PM_TRY_DONE(pm_scene_text_check(t.text, options->write, options->weights));
    PM_TRY_DONE(options->picture == NULL ? PM_OK
                                         : pm_python_check_pictures("stress", options->picture));
    t.mean = strdup(t.text);
    PM_TRY_DONE(pm_allocated(t.mean, "a scene"));
    PM_TRY_DONE(pm_scene_text_put_mean_inputs(&t.mean, &t.base.boundary_input));
    const pm_physics *physics = &t.base.scene->physics;
    pm_stepping own = {physics->integrator, physics->substeps, physics->tolerance, physics->dt,
                       t.base.scene->run.steps};
    t.rollout = pm_rollout_shared(MOST_CASES, sizeof *t.rollout);
    for (int k = 0; k < WIDTHS; ++k) {
        nstart[k] = pm_rollout_starts(&t.base, (uint64_t)options->seed + 1 + (uint64_t)k,
                                      k == 0 ? TRAJECTORIES : 0, k == 0 ? INSIDE : BEYOND + 1, k,
                                      &t.base.arena, start[k]);
        if (t.rollout == NULL || nstart[k] < 1) {
            PM_TRY_DONE(pm_fail(PM_ENOMEM, "out of memory for a stress test"));
        }
    }
    const pm_rollout_spec spec = {.stepping = own, .factor = 1, .seconds = TRIAL};
    pm_rollout_run(&t.base, &start[0][0], &spec, NULL, &trial);
    const double cost = trial.steps > 0 ? trial.seconds / (double)trial.steps : TRIAL;
    bool driven = false; // by more than temperatures, which stay as they are
    for (int k = 0; k < physics->nboundary_input; ++k) {
        const pm_layout *layout = &physics->boundary_input[k].layout;
        for (int g = 0; g < layout->ngroup; ++g) {
            driven = driven || strcmp(layout->group[g].unit, "J/K") != 0;
        }
    }
    const int most = INSIDE + (WIDTHS - 1) * BEYOND + (LENGTHS - 1) * (BEYOND + WIDTHS * BEYOND);
    const double fit = SHARE * budget / (cost * most);
    own.steps = options->steps > 0  ? (int)options->steps
                : fit < LEAST_STEPS ? LEAST_STEPS
                : fit > MOST_STEPS  ? MOST_STEPS
                                    : (int)fit;
    if (t.base.boundary_input.end < own.steps) {
        own.steps = (int)t.base.boundary_input.end;
    }
    for (int k = 0; k < WIDTHS; ++k) { // what is beyond begins after the scene's own start
        for (int i = k > 0; i < nstart[k]; ++i) {
            add(&t, distance[k], &start[k][i], &own, 1, i < BEYOND + (k > 0) ? 0 : -1, k);
        }
    }
    for (int i = 0; i < SETS && (i < nstart[0] || i < physics->nsubsystem); ++i) {
        add(&t, "a subsystem set to another state", &start[0][i % nstart[0]], &own, 1, -1, 0);
        t.rollout[t.count - 1].spec.set = start[0][(i + 1) % nstart[0]].z;
        t.rollout[t.count - 1].spec.subsystem = i % physics->nsubsystem;
    }
    // Before longer steps, which may use up the budget.
    pm_stepping many = own;
    many.steps = options->steps > 0 ? MANY * own.steps : LONG;
    add(&t, "many steps from the scene's start", &start[0][0], &many, 1, -1, 0);
    t.many = t.count - 1;
    t.rollout[t.many].own = t.base.boundary_input.end >= many.steps;
    t.rollout[t.many].spec.seconds = LONG_SHARE * budget;
    t.rollout[t.many].spec.most = pm_rollout_nworker() > 1 ? LONG_MOST * budget : 0;
    for (int l = 1; l < LENGTHS; ++l) {
        for (int k = 0; k < WIDTHS; ++k) {
            for (int i = k > 0; i < nstart[k] && i < BEYOND + (k > 0); ++i) {
                add(&t, longer[l], &start[k][i], &own, 1 << l, l, k);
            }
        }
    }
    for (int f = 0; f < FACTORS && driven; ++f) {
        for (int i = 0; i < nstart[0] && i < BEYOND; ++i) {
            add(&t, larger[f], &start[0][i], &own, 1, -1, 0);
            t.rollout[t.count - 1].spec.factor = 2 << f;
            t.rollout[t.count - 1].own = false;
        }
    }
    for (int k = 0; k < (driven ? 2 : 1); ++k) {
        add(&t, k == 0 ? "dt doubled until it breaks" : "inputs doubled until it breaks",
            &start[0][0], &own, k == 0 ? 1 << LENGTHS : 1, -1, 0);
        rollout *last = &t.rollout[t.count - 1];
        last->spec.factor = k == 0 ? 1 : 2 << FACTORS;
        last->longer = k == 0;
        last->larger = k == 1;
        last->own = false;
    }
    for (int d = 1; d < PM_NDRIVE && driven; ++d) {
        for (int i = 0; i < nstart[0] && i < BEYOND; ++i) {
            add(&t, drives[d], &start[0][i], &own, 1, -1, 0);
            t.rollout[t.count - 1].spec.drive = (pm_drive)d;
            t.rollout[t.count - 1].own = false;
        }
    }
    PM_TRY_DONE(pm_rollout_parallel(0, t.count, measure, &t, &left, "stress", options->stop));
    status = report(&t);
done:
    free(t.text);
    free(t.mean);
    pm_setup_free(&t.base);
    return status;
}

const pm_command pm_command_stress = {
    .name = "stress",
    .summary = "find where a scene breaks",
    .arguments = "SCENE",
    .help =
        "Runs the scene in one process from starts within the training range and up to three\n"
        "widths of it beyond, with steps of 2, 4, ... 32 times the length, and of twice as much\n"
        "until it breaks; with inputs that are larger, vanish, jump or change their sign in\n"
        "every step; with a subsystem that is set to another state in the middle; and for a\n"
        "million steps if they fit into the --budget of CPU time of the busiest process, else\n"
        "as many as fit into a quarter of it (--compiled: three times as many), with the budget\n"
        "that all of them need. Prints for each kind how many rollouts were good, drifted (the\n"
        "total energy by more than 1 % of the energy that moves) or broke (an error, a violated\n"
        "law, no convergence, a drift of 10 %), the largest drift and fall of the entropy, the\n"
        "steps outside the training range, and a map of start and step. Where inputs lie in a\n"
        "table, rollouts end with it; those with longer or many steps hold their means. --write "
        "writes the scene of the first failure,\n"
        "with its start. The same --seed takes the same starts, and the same --steps as many\n"
        "steps on every machine.\n"
        "Exit code 14: the scene's own settings did not hold within the training range.",
    .examples = "portmetd stress configs/double_pendulum.yaml --budget 30\n"
                "portmetd stress scene.yaml --write broken.yaml",
    .accepts = "steps weights study compiled json",
    .execute = execute,
};

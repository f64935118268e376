// portmetd start, pause, resume, advance, set, reset, stop, checkpoint, restore, reload and query:
// one request each to the coordinator of `portmetd serve`.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "base/arena.h"
#include "lockstep/remote.h"
#include "scene/columns.h"

#define PATIENCE 10.0 // s without any reply, after which the command gives up

// Reads numbers with commas between them into an array of `count`; NULL is allowed.
static pm_status read_numbers(pm_arena *arena, const char *name, const char *text, int count,
                              int32_t *found, double **values) {
    if (text == NULL) {
        return PM_OK;
    }
    *values = pm_arena_array(arena, (size_t)count, sizeof **values);
    PM_TRY(pm_arena_status(arena, "%s", name));
    char *at = (char *)text;
    for (*found = 0; *found < count && at != NULL; ++*found) {
        char *end;
        errno = 0;
        (*values)[*found] = strtod(at, &end);
        if (end == at || (*end != ',' && *end != 0)) {
            return pm_fail(PM_EUSAGE, "%s: expected numbers with commas between them, found \"%s\"",
                           name, at);
        }
        at = *end == ',' ? end + 1 : NULL;
    }
    return *found == count && at == NULL
               ? PM_OK
               : pm_fail(PM_EUSAGE, "%s: expected %d numbers", name, count);
}

// Reads the first state of a trajectory.
static pm_status read_trajectory(pm_arena *arena, const pm_run_options *options,
                                 const pm_scene *scene, portmet_control_t *r) {
    if (options->trajectory == NULL) {
        return options->data == NULL ? PM_OK
                                     : pm_fail(PM_EUSAGE, "--data: expected --trajectory as well");
    }
    const char *path = options->data != NULL ? options->data : scene->run.reference;
    pm_dataset *data = NULL;
    pm_columns columns;
    pm_status status;
    char *end;
    const long k = strtol(options->trajectory, &end, 10);
    if (end == options->trajectory || *end != 0 || path == NULL || options->state != NULL) {
        return pm_fail(PM_EUSAGE,
                       "--trajectory %s: expected a number from 0, a reference in the "
                       "scene or --data, and no --state",
                       options->trajectory);
    }
    PM_TRY(pm_dataset_load(&data, path));
    if (k < 0 || k >= data->ntrajectory) {
        PM_TRY_DONE(
            pm_fail(PM_EDATA, "%s: trajectory %ld, there are %d", path, k, data->ntrajectory));
    }
    PM_TRY_DONE(pm_columns_bind(&columns, scene, data, arena));
    r->nz = scene->physics.nz;
    r->z = pm_arena_array(arena, (size_t)r->nz, sizeof *r->z);
    PM_TRY_DONE(pm_arena_status(arena, "a state"));
    pm_columns_to_state(&columns, pm_dataset_state(data, (int)k, 0), r->z);
done:
    pm_dataset_free(data);
    return status;
}

static pm_status control(const pm_run_options *options, int8_t kind, const char *word) {
    static const char *const phases[] = {"waits for processes", "idle", "running", "held", "ended"};
    pm_scene *scene = NULL;
    pm_transport *transport = NULL;
    pm_client *remote = NULL;
    pm_arena arena = {0};
    const bool names = options->name != NULL;
    portmet_control_t request = {.kind = kind}, *r = &request;
    r->file = (char *)(names ? options->name : options->record);
    const char *address;
    char host[64] = "";
    pm_status status;
    PM_TRY_DONE(options->text == NULL ? pm_scene_load(&scene, options->scene)
                                      : pm_scene_parse(&scene, options->text, options->scene));
    PM_TRY_DONE(pm_connect_check(scene));
    PM_TRY_DONE(pm_connect_listener(scene, options->url, &address));
    (void)gethostname(host, sizeof host - 1);
    const char *sender = pm_arena_printf(&arena, "%s@%s", word, host);
    PM_TRY_DONE(pm_arena_status(&arena, "a client"));
    const bool starts = kind == PORTMET_CONTROL_T_START;
    r->steps = options->steps > 0 ? options->steps
               : starts           ? scene->run.steps
                                  : kind == PORTMET_CONTROL_T_ADVANCE;
    r->steps = options->endless ? 0 : r->steps;
    r->held = options->held;
    if (options->pace != NULL) {
        char *end;
        r->pace = strtod(options->pace, &end);
        if (end == options->pace || *end != 0 || r->pace < 0) {
            PM_TRY_DONE(pm_fail(PM_EUSAGE, "--pace: expected a number of at least 0, found \"%s\"",
                                options->pace));
        }
        r->pace = r->pace == 0 ? -1 : r->pace;
    }
    PM_TRY_DONE(read_numbers(&arena, "--state", options->state, scene->physics.nz, &r->nz, &r->z));
    PM_TRY_DONE(read_trajectory(&arena, options, scene, r));
    PM_TRY_DONE(read_numbers(&arena, "--inputs", options->inputs, scene->network.nlive, &r->nlive,
                             &r->live));
    PM_TRY_DONE(pm_connect_open(&transport, scene, address, word, &options->log));
    PM_TRY_DONE(pm_remote_open(
        &remote, transport,
        &(pm_remote_options){scene->name, sender, options->session, PATIENCE, options->stop}));
    const pm_served *served = pm_remote_served(remote);
    PM_TRY_DONE(pm_remote_ask(remote, r, !starts || options->wait));
    const portmet_control_reply_t *reply = pm_remote_reply(remote);
    if (!options->quiet) {
        printf("%s: %s", scene->name,
               phases[reply->phase < 0 || reply->phase > 4 ? 0 : reply->phase]);
        if (reply->owner[0] != 0) {
            printf(", run %lld of %s, step %lld", (long long)reply->run, reply->owner,
                   (long long)reply->step);
            if (reply->steps > 0) {
                printf(" of %lld", (long long)reply->steps);
            }
            printf(", %.12g s; energy %.12g J, entropy %.12g J/K, %lld violations", reply->time,
                   reply->energy, reply->entropy, (long long)reply->violations);
        }
        printf("\n");
        for (int i = 0; i < reply->nz; ++i) {
            printf("%s%.17g%s", i == 0 ? "state " : ",", reply->z[i],
                   i + 1 == reply->nz ? "\n" : "");
        }
        if (kind == PORTMET_CONTROL_T_QUERY) {
            printf("%s\n", served->description);
        }
    }
done:
    pm_remote_close(remote);
    pm_transport_close(transport);
    pm_arena_free(&arena);
    pm_scene_free(scene);
    return status;
}

#define AT_START "state inputs held trajectory"
#define CONTROL(word, kind, text, words, more, accepted, given)                            \
    static pm_status execute_##word(const pm_run_options *options) {                       \
        return control(options, PORTMET_CONTROL_T_##kind, #word);                          \
    }                                                                                      \
    const pm_command pm_command_##word = {.name = #word,                                   \
                                          .summary = text,                                 \
                                          .arguments = words,                              \
                                          .help = more,                                    \
                                          .examples = "portmetd " #word " configs/" given, \
                                          .accepts = "session url log quiet " accepted,    \
                                          .execute = execute_##word};

CONTROL(start, START, "begin a run of a scene that is served", "SCENE",
        "Asks `portmetd serve` to begin a run, and prints the state at its start. Without --steps\n"
        "it has as many steps as the scene says. With --wait the command ends when the run does,\n"
        "with the exit code of the run. While another run is under way it is refused.",
        "steps start " AT_START, "double_pendulum.yaml --steps 200 --wait")
CONTROL(pause, PAUSE, "hold a run that is served", "SCENE",
        "Holds the run after the steps that are granted, and prints the state there.", "",
        "double_pendulum.yaml")
CONTROL(resume, RESUME, "let a run that is held go on", "SCENE",
        "Lets the run go on to its last step, or with --steps until so many are complete.", "steps",
        "double_pendulum.yaml --steps 150")
CONTROL(advance, ADVANCE, "take steps of a run that is held", "SCENE",
        "Takes one step, or as many as --steps says, and holds the run again. Prints the state.",
        "steps", "double_pendulum.yaml --steps 10")
CONTROL(
    set, SET, "set the live inputs, or the state, of a run that is served", "SCENE",
    "Inputs hold from the next step on, until others arrive. A state takes the place of the\n"
    "present one of a run that is held; what its energy and entropy differ by counts as having\n"
    "come from the outside.",
    "state inputs", "live_double_pendulum.yaml --inputs 0.5,0")
CONTROL(
    reset, RESET, "begin a run that is served anew", "SCENE",
    "Takes the run to step 0, at the scene's state or at the one given, with the same steps and\n"
    "pace.",
    AT_START, "double_pendulum.yaml --held")
CONTROL(checkpoint, CHECKPOINT, "keep where a run that is served is held", "SCENE NAME",
        "Keeps state and ledger of a run that is held as NAME (letters, digits and ._-) in the\n"
        "folder of the service.",
        "", "double_pendulum.yaml noon")
CONTROL(restore, RESTORE, "take a run that is served to what was kept", "SCENE NAME",
        "Takes the run that is under way to what `checkpoint` has kept as NAME, in this run or an\n"
        "earlier one, and prints the state there.",
        "held", "double_pendulum.yaml noon --held")
CONTROL(stop, STOP, "end a run that is served", "SCENE",
        "Ends the run after the steps that are granted. The service waits for another one.", "",
        "double_pendulum.yaml")

CONTROL(
    reload, RELOAD, "let a service read its files again", "SCENE",
    "Between two runs all processes read the scene and its weights again. If they cannot be read,\n"
    "or are of another scene, the command is refused and nothing changes.",
    "", "double_pendulum.yaml")
CONTROL(query, QUERY, "print the state of a service, and what it serves", "SCENE",
        "Prints whether a run is under way, and whose, and what is served as a line of JSON:\n"
        "subsystems with the groups of their states, ports, live inputs, digests of weights.",
        "", "double_pendulum.yaml")

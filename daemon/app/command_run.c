// portmetd run: over LCM a coordinator with the processes that it launches (serve.h), with
// --in-process all subsystems in this thread, or many copies of a scene.
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "app/serve.h"
#include "app/supervise.h"
#include "library/fleet.h"
#include "library/local_run.h"
#include "library/names.h"

#define WATCH_INTERVAL 0.05 // s between two looks at the stop flag

// --- in this thread ---

static bool is_interrupted(const pm_observer *observer) {
    return observer->options->stop != NULL && *observer->options->stop != 0;
}

// Takes all steps, as the pace allows. PM_EINTERRUPTED.
static pm_status step_to_the_end(pm_local_run *run, pm_pace *pace,
                                 const pm_lockstep_observer *tell) {
    const pm_observer *observer = tell->context;
    PM_TRY(tell->step(tell->context, &run->sample));
    pm_pace_begin(pace, pm_clock());
    while (run->sample.step < run->setup->scene->run.steps) {
        const double due = pm_pace_due(pace, run->sample.step);
        for (double now = pm_clock(); now < due && !is_interrupted(observer); now = pm_clock()) {
            const double wait = due - now < WATCH_INTERVAL ? due - now : WATCH_INTERVAL;
            nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * wait)}, NULL);
        }
        if (is_interrupted(observer)) {
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        PM_TRY(pm_local_run_step(run));
        pm_pace_note(pace, run->sample.step, pm_clock());
        PM_TRY(tell->step(tell->context, &run->sample));
    }
    return PM_OK;
}

static pm_status run_together(const pm_setup *setup, pm_observer *observer) {
    const pm_lockstep_coordinator_options as = pm_observer_attach(observer, setup);
    pm_local_run run = {0};
    pm_pace pace = pm_pace_of(setup->scene);
    pm_status status;
    if (setup->scene->network.nlive > 0 && setup->replay == NULL) {
        return pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: --in-process needs --replay");
    }
    PM_TRY_DONE(pm_local_run_open(&run, setup,
                                  pm_scene_may_report_sums(setup->scene) && !as.want_state
                                      ? PM_LOCAL_SUMS
                                      : PM_LOCAL_SAMPLES));
    status = step_to_the_end(&run, &pace, &as.observer);
    status = pm_observer_finish(observer, status, &run.ledger, &pace, "in one process");
done:
    pm_local_run_close(&run);
    return status;
}

// --- copies ---

// Gives every copy the first state of a trajectory.
static pm_status start_copies(pm_fleet *fleet, pm_setup *setup, const pm_dataset *starts,
                              const char *path) {
    pm_columns columns;
    if (starts->ntrajectory < fleet->count) {
        return pm_fail(PM_EDATA, "%s: %d trajectories, and %" PRId64 " copies need one each", path,
                       starts->ntrajectory, fleet->count);
    }
    PM_TRY(pm_system_check_dataset(setup->system, starts, path));
    PM_TRY(pm_columns_bind(&columns, setup->scene, starts, &setup->arena));
    for (int i = 0; i < fleet->count; ++i) {
        pm_columns_to_state(&columns, pm_dataset_state(starts, i, 0),
                            fleet->z + (ptrdiff_t)i * columns.nz);
    }
    return PM_OK;
}

// Makes a dataset with the scene's columns, or without them with the names of the variables.
// columns->column is then NULL.
static pm_status open_trajectories(pm_dataset **to, pm_columns *columns, pm_setup *setup,
                                   const pm_scene_variables *names, int64_t count, int ntime) {
    const pm_physics *physics = &setup->scene->physics;
    const char **name = pm_arena_array(&setup->arena, (size_t)physics->nz, sizeof(const char *));
    PM_TRY(pm_arena_status(&setup->arena, "trajectories"));
    bool mapped = true;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        mapped = mapped && physics->subsystem[i].column != NULL;
    }
    for (int i = 0; i < physics->nsubsystem; ++i) {
        for (int c = 0; c < physics->subsystem[i].layout.nz; ++c) {
            const int at = physics->subsystem[i].first + c;
            name[at] = mapped ? physics->subsystem[i].column[c] : names->state.name[at];
        }
    }
    PM_TRY(pm_dataset_new(to, (int)count, ntime, physics->nz,
                          physics->dt * setup->scene->run.record_every, name));
    *columns = (pm_columns){0};
    return mapped ? pm_columns_bind(columns, setup->scene, *to, &setup->arena) : PM_OK;
}

// Writes the present states as sample j. The trajectories of copies that have ended are over.
static void take_sample(const pm_fleet *fleet, const pm_columns *columns, pm_dataset *to, int j) {
    for (int i = 0; i < fleet->count; ++i) {
        double *row = pm_dataset_state(to, i, j);
        const double *z = fleet->z + (ptrdiff_t)i * to->ncolumn;
        for (int c = 0; c < to->ncolumn; ++c) {
            row[c] = fleet->ended[i] != 0 ? NAN : z[c];
        }
        if (columns->column != NULL && fleet->ended[i] == 0) {
            pm_columns_to_row(columns, z, row);
        }
    }
}

// Prints what the copies that have not ended are like.
static void print_copies(const pm_fleet *fleet, const pm_scene_variables *names, double seconds) {
    const pm_scene *scene = fleet->setup->scene;
    const int nz = scene->physics.nz;
    int64_t ended = 0;
    for (int i = 0; i < fleet->count; ++i) {
        ended += fleet->ended[i] != 0;
    }
    printf("%s: %d step%s of %g s of %" PRId64 " cop%s, %" PRId64 " of which ended early\n",
           scene->name, scene->run.steps, scene->run.steps == 1 ? "" : "s", scene->physics.dt,
           fleet->count, fleet->count == 1 ? "y" : "ies", ended);
    printf("\n%-24s %15s %15s %15s %15s\n", "At the end", "mean", "deviation", "least", "largest");
    for (int k = 0; k < nz && k < PM_SCENE_LISTED && ended < fleet->count; ++k) {
        const double count = (double)(fleet->count - ended);
        double sum = 0, square = 0, least = INFINITY, largest = -INFINITY;
        for (int pass = 0; pass < 2; ++pass) {
            for (int i = 0; i < fleet->count; ++i) {
                const double x = fleet->z[(ptrdiff_t)i * nz + k];
                if (fleet->ended[i] == 0 && pass == 0) {
                    sum += x;
                    least = fmin(least, x);
                    largest = fmax(largest, x);
                } else if (fleet->ended[i] == 0) {
                    square += (x - sum / count) * (x - sum / count);
                }
            }
        }
        printf("  %-14s %-7s %+15.6e %15.6e %+15.6e %+15.6e\n", names->state.name[k],
               names->state.unit[k], sum / count, sqrt(square / count), least, largest);
    }
    printf("\nSpeed: %.3g s, %.3g us for a step of a copy\n", seconds,
           1e6 * seconds / (double)(scene->run.steps < 1 ? 1 : scene->run.steps) /
               (double)fleet->count);
}

static pm_status run_copies(pm_setup *setup, const pm_run_options *options) {
    const pm_scene *scene = setup->scene;
    const int every = scene->run.record_every;
    pm_fleet fleet = {0};
    pm_dataset *starts = NULL, *to = NULL;
    pm_scene_variables names;
    pm_columns columns;
    char why[sizeof fleet.why] = "";
    pm_status status;
    if (options->checkpoint != NULL || options->held || options->replay != NULL ||
        scene->network.nlive > 0) {
        return pm_fail(PM_EUSAGE, "run: --copies and --starts go with --steps, --weights, --record "
                                  "and --overwrite, and with scenes without live inputs");
    }
    PM_TRY_DONE(pm_scene_variable_names(&names, scene, &setup->arena));
    if (options->starts != NULL) {
        PM_TRY_DONE(pm_dataset_load(&starts, options->starts));
        PM_TRY_DONE(pm_columns_convert(scene, starts));
    }
    const int64_t count = options->copies > 0 ? options->copies : starts->ntrajectory;
    PM_TRY_DONE(pm_fleet_open(&fleet, setup, count, 0));
    PM_TRY_DONE(starts == NULL ? PM_OK : start_copies(&fleet, setup, starts, options->starts));
    if (options->record != NULL) {
        PM_TRY_DONE(pm_recording_check(options->record, options->overwrite));
        PM_TRY_DONE(
            open_trajectories(&to, &columns, setup, &names, count, scene->run.steps / every + 1));
        take_sample(&fleet, &columns, to, 0);
    }
    const double begin = pm_clock();
    for (int step = 0, next; step < scene->run.steps; step = next) {
        next = step + every < scene->run.steps ? step + every : scene->run.steps;
        if (*options->stop) {
            PM_TRY_DONE(pm_fail(PM_EINTERRUPTED, "interrupted"));
        }
        pm_fleet_step(&fleet, next - step);
        memcpy(why, why[0] == '\0' ? fleet.why : why, sizeof why);
        if (to != NULL && next % every == 0) {
            take_sample(&fleet, &columns, to, next / every);
        }
    }
    if (!options->quiet) {
        print_copies(&fleet, &names, pm_clock() - begin);
        printf(why[0] == '\0' ? "%s" : "  the first copy that ended is %s\n", why);
    }
    status = to == NULL ? PM_OK : pm_dataset_save(to, options->record);
done:
    pm_dataset_free(starts);
    pm_dataset_free(to);
    pm_fleet_close(&fleet);
    return status;
}

// --- as one rank of a job of mpirun ---

// Rank 0 coordinates, and rank i + 1 serves process i of the scene. Rank 0 alone describes the
// result.
static pm_status run_rank(pm_setup *setup, const pm_run_options *options, const char *url) {
    const pm_scene *scene = setup->scene;
    const int expected = scene->network.nprocess + 1;
    pm_status status = PM_OK;
    int rank, count;
    PM_TRY(pm_transport_place(url, &rank, &count));
    if (count != expected) {
        status = pm_fail(PM_EUSAGE,
                         "scene %s has %d processes: expected %d ranks (mpirun -n %d), one for "
                         "each process and one that coordinates them, found %d",
                         scene->name, scene->network.nprocess, expected, expected, count);
    } else if (options->checkpoint != NULL || options->held) {
        status = pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                    "and mpirun ends all ranks when one dies; --held for clients, "
                                    "which do not reach them");
    } else if (scene->network.nlive > 0 && setup->replay == NULL) {
        status = pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: %s needs --replay", url);
    }
    if (status != PM_OK) {
        // Every rank opens and closes the transport, so that the job ends in order.
        pm_transport *transport;
        char reason[512];
        snprintf(reason, sizeof reason, "%s", rank == 0 ? pm_error() : "");
        PM_TRY(pm_transport_open(&transport, url));
        pm_transport_close(transport);
        return pm_fail(status, "%s", reason);
    }
    pm_run_options own = *options;
    own.elsewhere = true;
    if (rank == 0) {
        return pm_serve_coordinator(setup, &own);
    }
    own.log.part = scene->network.process[rank - 1].name;
    own.coordinator_speaks = true;
    return pm_serve_node(setup, &own, rank - 1);
}

static pm_status execute_run(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_observer observer = {0};
    pm_status status;
    if (options->in_process && (options->checkpoint != NULL || options->held)) {
        return pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                  "and --held for clients over LCM, not for --in-process");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_COORDINATE));
    PM_TRY_DONE(pm_prepare_check_steps(&setup, options));
    if (options->copies > 0 || options->starts != NULL) {
        status = run_copies(&setup, options);
        goto done;
    }
    const char *url = pm_connect_url(setup.scene, options->url);
    if (!options->in_process && pm_transport_has_ranks(url)) {
        status = run_rank(&setup, options, url);
    } else if (options->checkpoint != NULL) {
        status = pm_supervise(&setup, options);
    } else if (!options->in_process) {
        status = pm_serve_coordinator(&setup, options);
    } else {
        PM_TRY_DONE(pm_observer_open(&observer, &setup, options));
        status = run_together(&setup, &observer);
    }
done:
    pm_observer_close(&observer);
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_run = {
    .name = "run",
    .summary = "run a scene: its processes, and a coordinator",
    .arguments = "SCENE",
    .help =
        "Launches `portmetd node` once per process, by default one for each subsystem,\n"
        "coordinates them over LCM, and prints mean fluxes, errors against the scene's\n"
        "reference trajectory, the ledger of energy and entropy, and the speed. It starts\n"
        "from each subsystem's `initial`, else from the reference's first state. Ctrl-C ends all\n"
        "processes and prints the tables of the steps done so far. With --checkpoint a process\n"
        "that is killed starts again and goes on, and the result has the same bits. If the whole\n"
        "run is interrupted, the same command continues it. With --url mpi:// the processes are\n"
        "the ranks of `mpirun -n N portmetd run ...`, one more than the scene has processes.\n"
        "With --copies or --starts it runs many copies of the scene in this process, on all\n"
        "processors, and prints what they are like in the end; --record then writes their\n"
        "trajectories as a dataset.",
    .examples = "portmetd run configs/double_pendulum.yaml --record run.h5\n"
                "portmetd run configs/chain_10.yaml --in-process --steps 100\n"
                "portmetd run configs/double_pendulum.yaml --copies 1000 --record copies.h5",
    .accepts =
        "checkpoint steps record replay overwrite weights url in_process held log quiet compiled",
    .execute = execute_run,
};

// portmetd check: loads everything that a run would load, and describes it.
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/listed.h"
#include "app/prepare.h"
#include "app/skipped.h"
#include "scene/model_reader.h"
#include "sim/round_cost.h"
#include "sim/subsystem.h"
#include "store/names.h"
#include "transport/channel.h"

#define LONGEST_LINE 400 // characters shown of one line of a model; a matrix may be large

// Opens the subsystems, as nodes would; of many alike, one. `rounds` receives the number of flux
// exchanges per step.
static pm_status build_all(const pm_setup *setup, int *rounds) {
    const pm_scene *scene = setup->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        pm_subsystem *subsystem;
        if (!pm_stands_in_list(scene->nsubsystem, setup->system->part_owner, i) &&
            scene->subsystem[i].substeps == 1) {
            continue;
        }
        PM_TRY(pm_subsystem_open(&subsystem, setup->system, i));
        *rounds = pm_subsystem_most_rounds(subsystem);
        pm_subsystem_close(subsystem);
    }
    return PM_OK;
}

static void print_network(const pm_scene *scene) {
    const bool ranks = pm_transport_has_ranks(scene->url);
    printf("  %-10s %s, window %d, patience %g s\n", ranks ? "MPI" : "LCM", scene->url,
           scene->window, scene->patience);
    if (ranks) {
        printf("  ranks      %d: one for each process, and one that coordinates them\n",
               scene->nprocess + 1);
    }
    for (int i = 0; i < scene->ntap; ++i) {
        printf("%s%s%s", i == 0 ? "  tap        " : ", ", scene->tap[i],
               i + 1 == scene->ntap ? ": repeated over LCM where a run uses MPI\n" : "");
    }
}

static void print_header(const pm_setup *setup, int rounds) {
    const pm_scene *scene = setup->scene;
    printf("scene %s (%s)\n", scene->name, scene->path);
    printf("  time       %d steps of %g s, %s, ", scene->steps, scene->dt, scene->integrator->name);
    if (scene->tolerance > 0) {
        printf("substeps for a tolerance of %g, at least %d\n", scene->tolerance, scene->substeps);
    } else {
        printf("%d substeps: %s%d flux exchanges per step\n", scene->substeps,
               scene->integrator->discrete ? "at most " : "", rounds);
    }
    print_network(scene);
    if (scene->key_file != NULL) {
        printf("  key        %s: messages are sealed\n", scene->key_file);
    }
    printf("  tolerance  energy %g, entropy %g (relative residuals on hard components)\n",
           scene->energy_tolerance, scene->entropy_tolerance);
    if (setup->reference != NULL) {
        printf("  reference  %s, trajectory %d of %d, %d states of %g s\n", scene->reference,
               scene->reference_trajectory, setup->reference->ntrajectory, setup->reference->ntime,
               setup->reference->dt);
    }
    if (setup->initial != NULL) {
        printf("  digest     %016" PRIx64 "\n", setup->system->digest);
    } else {
        printf("  start      none: no reference, and not every subsystem has an `initial`; a run "
               "needs either\n");
    }
}

static const char *form_name(pm_form form) {
    static const char *const names[] = {[PM_HARD] = "hard", [PM_SOFT] = "soft", [PM_FREE] = "free"};
    return names[form];
}

// Prints a known model; `model` is its text (NULL: there was no memory for it).
static void print_model(const char *model, const pm_provenance *provenance) {
    printf("  model      known, digest %016" PRIx64 "\n", provenance->digest);
    while (model != NULL && *model != '\0') {
        const int length = (int)strcspn(model, "\n");
        const bool fits = length <= LONGEST_LINE;
        printf("             %.*s%s\n", fits ? length : LONGEST_LINE, model, fits ? "" : " ...");
        model += length + 1;
    }
}

static void print_weights(const pm_params *params, const pm_provenance *provenance) {
    printf("  weights    %s: %zu numbers, digest %016" PRIx64 "\n", provenance->path,
           pm_params_trained(params), provenance->digest);
    printf("             made by: %s\n", provenance->command);
    printf("             data %s, seed %" PRIu64 ", loss %.3g, trained for %.0f s\n",
           provenance->data, provenance->seed, provenance->loss, provenance->seconds);
    if (provenance->step > 0) {
        printf("             by steps of %.9g s of %s\n", provenance->step, provenance->integrator);
    }
    if (*provenance->coordinates != '\0') {
        printf("             in the coordinates of %s\n", provenance->coordinates);
    }
}

// Prints names; names with consecutive numbers are folded into ranges.
static void print_names(const char *const *name, int count) {
    pm_arena arena = {0};
    const char *list = pm_names_fold(name, count, &arena);
    printf(" %s", list == NULL ? "(no memory to list them)" : list);
    pm_arena_free(&arena);
}

static void print_group(const pm_scene *scene, const pm_scene_subsystem *subsystem, int group_id) {
    const pm_group *group = &subsystem->layout.group[group_id];
    printf("  %-10s %d x %-10s", group->name, group->size, group->unit);
    if (subsystem->column != NULL) {
        print_names(subsystem->column + group->first, group->size);
    }
    const int base = subsystem->relative_subsystem[group_id];
    if (base >= 0) {
        const pm_scene_subsystem *other = &scene->subsystem[base];
        printf(", measured from %s.%s", other->name,
               other->layout.group[subsystem->relative_group[group_id]].name);
    }
    printf("\n");
}

static void print_subsystem(const pm_setup *setup, int i) {
    const pm_scene_subsystem *subsystem = &setup->scene->subsystem[i];
    const pm_part *part = setup->system->part[i];
    printf("\nsubsystem %s (%s): %d variables\n", subsystem->name, form_name(part->spec.form),
           subsystem->layout.nz);
    if (subsystem->substeps > 1) {
        printf("  time       %d steps of its own between two exchanges\n", subsystem->substeps);
    }
    for (int group = 0; group < subsystem->layout.ngroup; ++group) {
        print_group(setup->scene, subsystem, group);
    }
    const pm_provenance *provenance = setup->system->part_provenance[i];
    if (subsystem->model == NULL) {
        print_weights(&part->params, provenance);
        return;
    }
    pm_arena arena = {0};
    print_model(pm_part_spec_write(&part->spec, &arena), provenance);
    pm_arena_free(&arena);
}

// Counts the values, from the first on, that are all columns, or all the same number.
static int count_alike(const pm_scene_prescribed *value, int count) {
    int n = 1;
    while (n < count && (value[n].column != NULL) == (value->column != NULL) &&
           (value->column != NULL || value[n].number == value->number)) {
        ++n;
    }
    return n;
}

static void print_alike(const pm_scene_prescribed *value, int count) {
    pm_arena arena = {0};
    const char **name = pm_arena_array(&arena, (size_t)count, sizeof *name);
    for (int i = 0; name != NULL && i < count; ++i) {
        name[i] = value[i].column;
    }
    if (value->column == NULL) {
        printf(" %g", value->number);
        if (count > 1) {
            printf(" (%d times)", count);
        }
    } else if (name != NULL) {
        print_names(name, count);
    }
    pm_arena_free(&arena);
}

// Prints a list such as "dE vx vy", unless all its values are zero.
static void print_prescribed(const char *what, const pm_scene_prescribed *value, int count) {
    if (value->column == NULL && value->number == 0 && count_alike(value, count) == count) {
        return;
    }
    printf("  %s", what);
    for (int i = 0, n; i < count; i += n) {
        n = count_alike(value + i, count - i);
        print_alike(value + i, n);
    }
}

static bool is_used(const pm_scene *scene, int input_id) {
    for (int i = 0; i < scene->nport; ++i) {
        if (scene->port[i].boundary_input[0] == input_id ||
            scene->port[i].boundary_input[1] == input_id) {
            return true;
        }
    }
    return false;
}

static void print_boundary_input(const pm_scene *scene, int input_id) {
    static const char *const what[] = {"value", "dE", "dS"};
    const pm_scene_boundary_input *boundary_input = &scene->boundary_input[input_id];
    printf("\nboundary input %s: numbers, columns of the reference or live values%s\n",
           boundary_input->name, is_used(scene, input_id) ? "" : "; no port ends at it");
    for (int g = 0; g < boundary_input->layout.ngroup; ++g) {
        const pm_group *group = &boundary_input->layout.group[g];
        printf("  %-10s %d x %-10s", group->name, group->size, group->unit);
        for (int k = 0; k < 3; ++k) {
            print_prescribed(what[k],
                             boundary_input->value + k * boundary_input->layout.nz + group->first,
                             group->size);
        }
        printf("\n");
    }
}

static void print_live_input(const pm_scene_live_input *input) {
    printf("\nlive input on channel %s:", input->channel);
    for (int i = 0; i < input->count; ++i) {
        printf(" %s", input->name[i]);
    }
    printf("\n  %s", input->waits    ? "each step waits for the message of its number"
                     : input->starts ? "the newest message holds; `start` until the first one"
                                     : "the newest message holds; the run waits for the first one");
    if (isfinite(input->age)) {
        printf("; the run ends after %g s without a message", input->age);
    }
    printf("\n");
}

static void print_port(const pm_setup *setup, int i) {
    const pm_scene_port *port = &setup->scene->port[i];
    const pm_port_model *model = setup->system->port[i];
    printf("\nport %s (%s, %s)\n", port->name, port->law, form_name(model->spec.form));
    for (int end = 0; end < 2; ++end) {
        printf("  end %c      %s exposes", 'a' + end, pm_scene_end_name(setup->scene, port, end));
        for (int group = 0; group < port->layout[end].ngroup; ++group) {
            printf(" %s", port->layout[end].group[group].name);
        }
        printf("\n");
    }
    const pm_provenance *provenance = setup->system->port_provenance[i];
    if (port->model == NULL) {
        print_weights(&model->params, provenance);
        return;
    }
    pm_arena arena = {0};
    print_model(pm_port_spec_write(&model->spec, &arena), provenance);
    pm_arena_free(&arena);
}

static void print_process(const pm_scene *scene, const pm_scene_process *process) {
    pm_arena arena = {0};
    const char **name = pm_arena_array(&arena, (size_t)process->count, sizeof *name);
    printf("  %s:", process->name);
    for (int k = 0; k < process->count && name != NULL; ++k) {
        name[k] = scene->subsystem[process->subsystem[k]].name;
    }
    if (name != NULL) {
        print_names(name, process->count);
    }
    printf("\n");
    pm_arena_free(&arena);
}

static void print_processes(const pm_scene *scene) {
    printf("\nprocesses\n");
    for (int i = 0; i < scene->nprocess && i < PM_MOST_LISTED; ++i) {
        print_process(scene, &scene->process[i]);
    }
    if (scene->nprocess > PM_MOST_LISTED) {
        printf("  and %d more\n", scene->nprocess - PM_MOST_LISTED);
    }
}

static bool sends_fluxes(const pm_scene *scene, int process_id) {
    for (int k = 0; k < 2 * scene->nport; ++k) {
        const int id = scene->port[k / 2].subsystem[k % 2];
        if (id >= 0 && scene->subsystem[id].process == process_id &&
            pm_scene_joins_processes(scene, &scene->port[k / 2])) {
            return true;
        }
    }
    return false;
}

static pm_status print_channels(const pm_scene *scene) {
    static const char *const words[] = {"HELLO",        "TICK",   "COMMAND", "REQUEST",
                                        "REQUEST_TICK", "LEDGER", "VITALS",  "HEALTH"};
    char channel[PM_CHANNEL_SIZE];
    printf("\nchannels that a spy sees\n");
    for (size_t i = 0; i < sizeof words / sizeof words[0]; ++i) {
        PM_TRY(pm_channel_scene(channel, scene, words[i]));
        printf("  %s\n", channel);
    }
    for (int i = 0; i < scene->nprocess && i < PM_MOST_LISTED; ++i) {
        if (sends_fluxes(scene, i)) {
            PM_TRY(pm_channel_process(channel, scene, "FLUX", i));
            printf("  %s\n", channel);
        }
        PM_TRY(pm_channel_process(channel, scene, "REPORT", i));
        printf("  %s\n", channel);
        PM_TRY(pm_channel_hello(channel, scene, scene->process[i].name));
        printf("  %s\n", channel);
        PM_TRY(pm_channel_request(channel, scene, scene->process[i].name));
        printf("  %s\n", channel);
    }
    if (scene->nprocess > PM_MOST_LISTED) {
        printf("  and those of %d more processes\n", scene->nprocess - PM_MOST_LISTED);
    }
    return PM_OK;
}

// Says for how many others a component stands that is listed for them.
static void print_alike_count(int count, const int *owner, int i, const char *what) {
    const int all = pm_listed_for(count, owner, i);
    if (all > 1) {
        printf("  and %d more %s with the same model\n", all - 1, what);
    }
}

static pm_status describe(const pm_setup *setup) {
    int rounds = 0;
    PM_TRY(build_all(setup, &rounds));
    PM_TRY(pm_connect_key(setup->scene, NULL));
    print_header(setup, rounds);
    const pm_scene *scene = setup->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (pm_stands_in_list(scene->nsubsystem, setup->system->part_owner, i)) {
            print_subsystem(setup, i);
            print_alike_count(scene->nsubsystem, setup->system->part_owner, i, "subsystems");
        }
    }
    for (int i = 0; i < setup->scene->nboundary_input; ++i) {
        print_boundary_input(setup->scene, i);
    }
    for (int i = 0; i < scene->nlive_input; ++i) {
        print_live_input(&scene->live_input[i]);
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (pm_stands_in_list(scene->nport, setup->system->port_owner, i)) {
            print_port(setup, i);
            print_alike_count(scene->nport, setup->system->port_owner, i, "ports");
        }
    }
    pm_skipped_print(setup);
    print_processes(setup->scene);
    return print_channels(setup->scene);
}

// Writes the costs of all models as comments, one line for each.
static void write_costs(FILE *file, const pm_setup *setup, const int *cost) {
    fprintf(file, "# Cut by measured costs of a round, in 1/8 of the cheapest subsystem:\n");
    for (int i = 0; i < setup->scene->nsubsystem; ++i) {
        if (setup->system->part_owner[i] == i) {
            fprintf(file, "#   %s, and subsystems with its model: %d\n",
                    setup->scene->subsystem[i].name, cost[i]);
        }
    }
}

static void write_lists(FILE *file, const pm_scene *scene) {
    fprintf(file, "processes:\n");
    for (int i = 0; i < scene->nprocess; ++i) {
        const pm_scene_process *process = &scene->process[i];
        fprintf(file, "  %s:\n", process->name);
        for (int k = 0; k < process->count; ++k) {
            fprintf(file, "    - %s\n", scene->subsystem[process->subsystem[k]].name);
        }
    }
}

// Measures the cost of each subsystem if the scene asks for an automatic cut, and cuts it by them.
static pm_status cut_by_cost(pm_setup *setup, pm_arena *arena, int **cost) {
    pm_scene *scene = setup->scene;
    *cost = pm_arena_array(arena, (size_t)scene->nsubsystem, sizeof **cost);
    double *zeros = pm_arena_array(arena, (size_t)scene->nz + 1, sizeof *zeros);
    if (*cost == NULL || zeros == NULL) {
        return pm_fail(PM_ENOMEM, "check: out of memory");
    }
    PM_TRY(pm_round_cost_measure(setup->system, setup->initial != NULL ? setup->initial : zeros,
                                 &setup->boundary_input, *cost));
    return pm_scene_cut_by_cost(scene, *cost);
}

// Writes the section `processes` with one list for each process.
static pm_status write_processes(pm_setup *setup, const char *path) {
    pm_arena arena = {0};
    int *cost = NULL;
    const bool automatic = setup->scene->nautomatic > 0;
    const pm_status status = automatic ? cut_by_cost(setup, &arena, &cost) : PM_OK;
    FILE *file = status == PM_OK ? fopen(path, "w") : NULL;
    if (file != NULL && automatic) {
        write_costs(file, setup, cost);
    }
    pm_arena_free(&arena);
    if (file == NULL) {
        return status != PM_OK ? status : pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    write_lists(file, setup->scene);
    const bool failed = ferror(file) != 0;
    return fclose(file) != 0 || failed ? pm_fail(PM_EFILE, "%s: %s", path, strerror(errno)) : PM_OK;
}

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_DESCRIBE));
    PM_TRY_DONE(options->processes == NULL ? PM_OK : write_processes(&setup, options->processes));
    status = describe(&setup);
done:
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Loads a scene file, its weights and its reference as a run would, and prints what they\n"
        "hold: time stepping, subsystems with their variables, units and dataset columns,\n"
        "boundary inputs, ports, the provenance of the weights, what a run will not compute, and\n"
        "the LCM channels. A scene without an initial state is described too, though it cannot "
        "run.\n"
        "The first mistake ends it with one line and the exit code of its class.",
    .accepts = PM_OPTION_WEIGHTS | PM_OPTION_PROCESSES,
    .execute = execute,
};

pm_status pm_command_check(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}

// portmetd check: loads everything that a run would load, and describes it.
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/prepare.h"
#include "model/operator.h"
#include "model/site.h"
#include "model/training_range.h"
#include "scene/model_reader.h"
#include "sim/contact_broadphase.h"
#include "sim/local_subsystems.h"
#include "store/names.h"
#include "transport/channel.h"

#define PM_COVERED 0.1   // of the width of a range, by which another one may reach beyond it
#define MOST_FLUX_ENDS 8 // of a process that are listed
#define LONGEST_LINE 400 // characters shown of one line of a model; a matrix may be large

// --- lists ---

// Returns true if a component is listed. Of many subsystems or ports only the first of those that
// share a model is.
static bool is_listed(const pm_system *system, int c) {
    const pm_physics *physics = &system->scene->physics;
    const int count = c < physics->nsubsystem ? physics->nsubsystem : physics->nport;
    return count <= PM_SCENE_LISTED || system->owner[c] == c;
}

// Says for how many others a component stands that is listed for them.
static void print_alike_count(const pm_system *system, int c) {
    int others = 0;
    for (int k = 0; k < pm_system_components(system); ++k) {
        others += !is_listed(system, k) && system->owner[k] == c;
    }
    if (others > 0) {
        printf("  and %d more %s with the same model\n", others,
               c < system->scene->physics.nsubsystem ? "subsystems" : "ports");
    }
}

// Prints names; names with consecutive numbers are folded into ranges.
static void print_names(const char *const *name, int count) {
    pm_arena arena = {0};
    const char *list = pm_names_fold(name, count, &arena);
    printf(" %s", list == NULL ? "(no memory to list them)" : list);
    pm_arena_free(&arena);
}

// --- components ---

static void print_header(const pm_setup *setup, int rounds) {
    const pm_scene *scene = setup->scene;
    printf("scene %s (%s)\n", scene->name, scene->path);
    printf("  time       %d step%s of %g s, %s, ", scene->run.steps,
           scene->run.steps == 1 ? "" : "s", scene->physics.dt, scene->physics.integrator->name);
    if (pm_physics_is_adaptive(&scene->physics)) {
        printf("substeps for a tolerance of %g, at least %d\n", scene->physics.tolerance,
               scene->physics.substeps);
    } else {
        printf("%d substep%s: %s%d flux exchange%s per step\n", scene->physics.substeps,
               scene->physics.substeps == 1 ? "" : "s",
               pm_integrator_iterates(scene->physics.integrator) ? "at most " : "", rounds,
               rounds == 1 ? "" : "s");
    }
    const char *url = pm_connect_url(scene, NULL);
    const bool ranks = pm_transport_has_ranks(url);
    printf("  %-10s %s, window %d, patience %g s\n", ranks ? "MPI" : "LCM", url,
           scene->network.window, scene->network.patience);
    if (ranks) {
        printf("  ranks      %d: one for each process, and one that coordinates them\n",
               scene->network.nprocess + 1);
    }
    for (int i = 0; i < scene->network.ntap; ++i) {
        printf("%s%s%s", i == 0 ? "  tap        " : ", ", scene->network.tap[i],
               i + 1 == scene->network.ntap ? ": repeated over LCM where a run uses MPI\n" : "");
    }
    if (scene->network.key_file != NULL) {
        printf("  key        %s: messages are sealed\n", scene->network.key_file);
    }
    printf("  tolerance  energy %g, entropy %g (relative residuals on hard components)\n",
           scene->run.energy_tolerance, scene->run.entropy_tolerance);
    if (setup->reference != NULL) {
        printf("  reference  %s, trajectory %d of %d, %d states of %g s\n", scene->run.reference,
               scene->run.reference_trajectory, setup->reference->ntrajectory,
               setup->reference->ntime, setup->reference->dt);
    } else if (scene->run.reference != NULL) {
        printf("  reference  %s, trajectory %d: measurements, whose first %g s tell the start\n",
               scene->run.reference, scene->run.reference_trajectory,
               scene->run.reference_estimate);
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

// Prints where a model comes from: its weights file, or, if it is `known`, its text (NULL: there
// was no memory for it).
static void print_model(bool known, const char *text, const pm_params *params,
                        const pm_provenance *provenance) {
    if (known) {
        printf("  model      known, digest %016" PRIx64 "\n", provenance->digest);
        while (text != NULL && *text != '\0') {
            const int length = (int)strcspn(text, "\n");
            const bool fits = length <= LONGEST_LINE;
            printf("             %.*s%s\n", fits ? length : LONGEST_LINE, text, fits ? "" : " ...");
            text += length + 1;
        }
        return;
    }
    printf("  weights    %s: %zu numbers, digest %016" PRIx64 "\n", provenance->path,
           pm_params_trained(params), provenance->digest);
    printf("             made by: %s\n", provenance->command);
    printf("             data %s, seed %" PRIu64, provenance->data, provenance->seed);
    if (provenance->loss > 0) { // a fit to measurements has none
        printf(", loss %.3g", provenance->loss);
    }
    printf(", trained for %.0f s\n", provenance->seconds);
    if (*provenance->system != '\0') {
        printf("             of the system %s\n", provenance->system);
    }
    if (*provenance->verdict != '\0') {
        printf("             the fit's verdict: %s\n", provenance->verdict);
    }
    if (provenance->step > 0) {
        printf("             by steps of %.9g s of %s\n", provenance->step, provenance->integrator);
    }
    if (*provenance->coordinates != '\0') {
        printf("             in the coordinates of %s\n", provenance->coordinates);
    }
}

static void print_subsystem(const pm_setup *setup, int i) {
    const pm_scene *scene = setup->scene;
    const pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
    const pm_part *part = setup->system->part[i];
    printf("\nsubsystem %s (%s): %d variables\n", subsystem->name, form_name(part->spec.form),
           subsystem->layout.nz);
    for (int g = 0; g < subsystem->layout.ngroup; ++g) {
        const pm_group *group = &subsystem->layout.group[g];
        printf("  %-10s %d x %-10s%s", group->name, group->size, group->unit,
               group->coenergy ? " co-energy" : "");
        if (subsystem->column != NULL) {
            print_names(subsystem->column + group->first, group->size);
        }
        const int base = subsystem->relative_subsystem[g];
        if (base >= 0) {
            const pm_scene_subsystem *other = &scene->physics.subsystem[base];
            printf(", measured from %s.%s", other->name,
                   other->layout.group[subsystem->relative_group[g]].name);
        }
        printf("\n");
    }
    pm_arena arena = {0};
    const bool known = subsystem->model != NULL;
    print_model(known, known ? pm_part_spec_write(&part->spec, &arena) : NULL, &part->params,
                setup->system->component[i].provenance);
    pm_arena_free(&arena);
    print_alike_count(setup->system, i);
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

// Prints a list such as "dE vx vy", unless all its values are zero.
static void print_prescribed(const char *what, const pm_scene_prescribed *value, int count) {
    if (value->column == NULL && value->number == 0 && count_alike(value, count) == count) {
        return;
    }
    printf("  %s", what);
    for (int n; count > 0; value += n, count -= n) {
        n = count_alike(value, count);
        if (value->column == NULL) {
            printf(" %g", value->number);
            if (n > 1) {
                printf(" (%d times)", n);
            }
            continue;
        }
        pm_arena arena = {0};
        const char **name = pm_arena_array(&arena, (size_t)n, sizeof *name);
        for (int i = 0; name != NULL && i < n; ++i) {
            name[i] = value[i].column;
        }
        if (name != NULL) {
            print_names(name, n);
        }
        pm_arena_free(&arena);
    }
}

static void print_boundary_input(const pm_scene *scene, int input_id) {
    static const char *const what[] = {"value", "dE", "dS"};
    const pm_scene_boundary_input *boundary_input = &scene->physics.boundary_input[input_id];
    bool used = false;
    for (int i = 0; i < scene->physics.nport; ++i) {
        used = used || scene->physics.port[i].boundary_input[0] == input_id ||
               scene->physics.port[i].boundary_input[1] == input_id;
    }
    printf("\nboundary input %s: numbers, columns of the reference or live values%s\n",
           boundary_input->name, used ? "" : "; no port ends at it");
    for (int g = 0; g < boundary_input->layout.ngroup; ++g) {
        const pm_group *group = &boundary_input->layout.group[g];
        printf("  %-10s %d x %-10s", group->name, group->size, group->unit);
        for (int k = 0; k < 3; ++k) {
            print_prescribed(what[k],
                             boundary_input->value + k * boundary_input->layout.nz + group->first,
                             group->size);
        }
        const pm_scene_prescribed *first = boundary_input->value + group->first;
        for (int k = 0; k < 3; ++k, first += boundary_input->layout.nz) {
            if (first->column != NULL && (first->hold != PM_HOLD_SMOOTH || first->delay != 0)) {
                printf("  (%s", pm_hold_names[first->hold]);
                printf(first->delay != 0 ? ", %+g s)" : ")", first->delay);
                break;
            }
        }
        printf("\n");
    }
}

// Says whether the quantities that both ends of a port show were trained on ranges that cover each
// other: quantities of one unit, which the law relates to each other.
static void print_coverage(const pm_setup *setup, const pm_scene_port *port) {
    const pm_part *part[2];
    pm_training_range range[2];
    int compared = 0, uncovered = 0;
    for (int end = 0; end < 2; ++end) {
        const int id = port->subsystem[end];
        part[end] = id < 0 ? NULL : setup->system->part[id];
        if (part[end] == NULL || pm_training_range_of(part[end]).low == NULL) {
            return;
        }
        range[end] = pm_training_range_of(part[end]);
    }
    for (int g = 0; g < port->layout[0].ngroup; ++g) {
        for (int h = 0; h < port->layout[1].ngroup; ++h) {
            const pm_group *group[2] = {&port->layout[0].group[g], &port->layout[1].group[h]};
            double low[2], high[2];
            for (int end = 0; end < 2; ++end) {
                const pm_layout *layout = &part[end]->layout;
                const ptrdiff_t at = pm_layout_find(layout, group[end]->name) - layout->group;
                low[end] = range[end].low[at];
                high[end] = range[end].high[at];
            }
            if (strcmp(group[0]->unit, group[1]->unit) != 0 || group[0]->size != group[1]->size ||
                !isfinite(low[0]) || !isfinite(low[1])) {
                continue;
            }
            compared += 1;
            for (int end = 0; end < 2; ++end) {
                const double width = high[end] - low[end];
                if (low[1 - end] >= low[end] - PM_COVERED * width &&
                    high[1 - end] <= high[end] + PM_COVERED * width) {
                    continue;
                }
                uncovered += 1;
                printf("  ranges     %s.%s was trained on %.3g to %.3g %s, and %s.%s reaches %.3g "
                       "to %.3g\n",
                       pm_scene_end_name(setup->scene, port, end), group[end]->name, low[end],
                       high[end], group[end]->unit, pm_scene_end_name(setup->scene, port, 1 - end),
                       group[1 - end]->name, low[1 - end], high[1 - end]);
            }
        }
    }
    if (compared > 0 && uncovered == 0) {
        printf("  ranges     both ends were trained on the same ranges\n");
    }
}

static void print_port(const pm_setup *setup, int i) {
    const pm_scene *scene = setup->scene;
    const pm_scene_port *port = &scene->physics.port[i];
    const pm_port_model *model = setup->system->port[i];
    printf("\nport %s (%s, %s)\n", port->name, port->law, form_name(model->spec.form));
    for (int end = 0; end < 2; ++end) {
        printf("  end %c      %s exposes", 'a' + end, pm_scene_end_name(scene, port, end));
        const int id = port->subsystem[end];
        const pm_part *part = id < 0 ? NULL : setup->system->part[id];
        for (int g = 0; g < port->layout[end].ngroup; ++g) {
            const pm_group *group = &port->layout[end].group[g];
            printf(" %s", group->name);
            if (part != NULL && pm_training_range_of(part).low != NULL) {
                const pm_training_range range = pm_training_range_of(part);
                const ptrdiff_t at =
                    pm_layout_find(&part->layout, group->name) - part->layout.group;
                printf(" (trained on %.3g to %.3g %s)", range.low[at], range.high[at], group->unit);
            }
        }
        printf("\n");
    }
    pm_arena arena = {0};
    const bool known = port->model != NULL;
    print_model(known, known ? pm_port_spec_write(&model->spec, &arena) : NULL, &model->params,
                setup->system->component[scene->physics.nsubsystem + i].provenance);
    pm_arena_free(&arena);
    const pm_component *component = setup->system->component;
    const pm_provenance *of = component[scene->physics.nsubsystem + i].provenance;
    bool apart = of->path == NULL; // not all that meets here was learned together
    for (int end = 0; end < 2 && of->path != NULL; ++end) {
        const int id = port->subsystem[end];
        const pm_provenance *other = id < 0 ? NULL : component[id].provenance;
        if (other != NULL && other->path != NULL) {
            const bool recorded = *of->fit != '\0' && *other->fit != '\0';
            const bool together = recorded ? strcmp(of->fit, other->fit) == 0
                                           : strcmp(of->command, other->command) == 0 &&
                                                 strcmp(of->data, other->data) == 0 &&
                                                 of->seed == other->seed;
            apart = apart || !together;
            printf("  end %c      %s was learned %s\n", 'a' + end,
                   pm_scene_end_name(scene, port, end),
                   together ? "together with this port" : "without this port, by another fit");
        }
    }
    if (apart) {
        print_coverage(setup, port);
    }
    print_alike_count(setup->system, scene->physics.nsubsystem + i);
}

// --- processes ---

static void print_processes(const pm_scene *scene) {
    printf("\nprocesses\n");
    for (int i = 0; i < scene->network.nprocess && i < PM_SCENE_LISTED; ++i) {
        const pm_scene_process *process = &scene->network.process[i];
        pm_arena arena = {0};
        const char **name = pm_arena_array(&arena, (size_t)process->count, sizeof *name);
        printf("  %s:", process->name);
        for (int k = 0; k < process->count && name != NULL; ++k) {
            name[k] = scene->physics.subsystem[process->subsystem[k]].name;
        }
        if (name != NULL) {
            print_names(name, process->count);
        }
        printf("\n");
        pm_arena_free(&arena);
    }
    if (scene->network.nprocess > PM_SCENE_LISTED) {
        printf("  and %d more\n", scene->network.nprocess - PM_SCENE_LISTED);
    }
}

// Prints the ends of ports in the order in which flux messages of process i have them, and returns
// their number. `channel` comes before them; NULL: nothing is printed.
static int print_flux_ends(const pm_scene *scene, int i, const char *channel) {
    const pm_physics *physics = &scene->physics;
    int count = 0;
    for (int id = 0; id < physics->nsubsystem; ++id) {
        if (physics->subsystem[id].process != i) {
            continue;
        }
        for (int k = physics->first_end[id]; k < physics->first_end[id + 1]; ++k) {
            const pm_scene_port *port = &physics->port[physics->end_at[k] / 2];
            if (!pm_port_crosses_processes(scene, port)) {
                continue;
            }
            if (channel != NULL && count < MOST_FLUX_ENDS) {
                printf(count == 0 ? "  %s: end %c of %s" : ", %s%c of %s",
                       count == 0 ? channel : "", physics->end_at[k] % 2 == 0 ? 'a' : 'b',
                       port->name);
            }
            ++count;
        }
    }
    if (channel != NULL && count > MOST_FLUX_ENDS) {
        printf(", and %d more", count - MOST_FLUX_ENDS);
    }
    return count;
}

static pm_status print_channels(const pm_scene *scene) {
    static const char *const words[] = {"HELLO",        "TICK",   "COMMAND", "REQUEST",
                                        "REQUEST_TICK", "LEDGER", "VITALS",  "HEALTH"};
    char channel[PM_CHANNEL_SIZE];
    printf("\nchannels that a spy sees\n");
    for (size_t i = 0; i < sizeof words / sizeof words[0]; ++i) {
        PM_TRY(pm_channel_scene(channel, scene->name, words[i]));
        printf("  %s\n", channel);
    }
    for (int i = 0; i < scene->network.nprocess && i < PM_SCENE_LISTED; ++i) {
        if (print_flux_ends(scene, i, NULL) > 0) {
            PM_TRY(pm_channel_process(channel, scene, "FLUX", i));
            (void)print_flux_ends(scene, i, channel);
            printf("\n");
        }
        PM_TRY(pm_channel_process(channel, scene, "REPORT", i));
        printf("  %s\n", channel);
        PM_TRY(pm_channel_hello(channel, scene, scene->network.process[i].name));
        printf("  %s\n", channel);
        PM_TRY(pm_channel_request(channel, scene, scene->network.process[i].name));
        printf("  %s\n", channel);
    }
    if (scene->network.nprocess > PM_SCENE_LISTED) {
        printf("  and those of %d more processes\n", scene->network.nprocess - PM_SCENE_LISTED);
    }
    return PM_OK;
}

// --- what a run skips ---

// The state of a part, or what one end of a port exposes, as an operator sees it.
typedef struct side {
    const char *prefix; // of the names of its groups in the operator
    const pm_layout *layout;
    const pm_part *part; // the part whose potentials depend on these groups; NULL: a boundary input
} side;

static bool acts_on(const pm_operator_spec *spec, const char *group) {
    return (spec->learned && (pm_is_listed(spec->nacts, spec->acts_on, group) ||
                              pm_is_listed(spec->nagainst, spec->against, group))) ||
           pm_given_names(spec, group) || pm_is_listed(spec->nheats, spec->heats, group);
}

// Prints an operator that is absent, or that has no effect: one of the hard form that acts on so
// few components that its projection (model/operator.h) leaves nothing. `what` names it, such as
// "reversible bulk".
static void print_operator(const char *owner, const char *what, const pm_operator_spec *spec,
                           pm_operator_kind kind, pm_form form, int nside, const side *sides) {
    if (!pm_operator_exists(spec)) {
        printf("  %s: %s: none\n", owner, what);
        return;
    }
    int count = 0; // components on which the operator acts
    // Whether the covector that the projection removes, dS of a reversible and dE of an
    // irreversible operator, depends on them.
    bool constrained = false;
    for (int i = 0; i < nside; ++i) {
        const pm_part *part = sides[i].part;
        for (int k = 0; k < sides[i].layout->ngroup; ++k) {
            const pm_group *group = &sides[i].layout->group[k];
            char name[PM_MAX_NAME];
            snprintf(name, sizeof name, "%s%s", sides[i].prefix, group->name);
            if (acts_on(spec, name)) {
                count += group->size;
                const pm_potential_spec *normal = part == NULL            ? NULL
                                                  : kind == PM_REVERSIBLE ? &part->spec.entropy
                                                                          : &part->spec.energy;
                constrained =
                    constrained || (part == NULL ? kind == PM_IRREVERSIBLE
                                                 : pm_part_depends(part, normal, group->name));
            }
        }
    }
    // The projection takes away one dimension. A skew matrix needs two dimensions to be anything
    // but zero, a positive semi-definite one needs one.
    if (form == PM_HARD && count - constrained < (kind == PM_REVERSIBLE ? 2 : 1)) {
        printf("  %s: %s: does nothing: it acts on %d component%s, and the projection leaves "
               "nothing of it\n",
               owner, what, count, count == 1 ? "" : "s");
    }
}

static void print_skipped(const pm_setup *setup) {
    const pm_physics *physics = &setup->scene->physics;
    const pm_system *system = setup->system;
    printf("\nskipped\n");
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const char *name = physics->subsystem[i].name;
        const pm_part *part = system->part[i];
        const pm_part_spec *spec = &part->spec;
        if (!is_listed(system, i)) {
            continue;
        }
        if (spec->form == PM_FREE) {
            printf("  %s: free: energy and entropy are not defined, and neither law is checked\n",
                   name);
            continue;
        }
        if (!pm_part_has_entropy(part)) {
            printf("  %s: no entropy: no S, no M, no entropy flux\n", name);
        }
        pm_arena arena = {0};
        pm_contact_broadphase bounding = {0};
        if (pm_contact_broadphase_open(&bounding, &arena, part) != PM_OK) {
            printf("  %s: no bounding test: %s\n", name, pm_error());
        } else if (bounding.unconstrained != NULL) {
            printf("  %s: energy and forces of its %d gaps, while a bounding test says that all "
                   "are open\n",
                   name, bounding.n);
        }
        pm_contact_broadphase_close(&bounding);
        pm_arena_free(&arena);
        const side state = {"", &part->layout, part};
        print_operator(name, "reversible bulk", &spec->reversible, PM_REVERSIBLE, spec->form, 1,
                       &state);
        print_operator(name, "irreversible bulk", &spec->irreversible, PM_IRREVERSIBLE, spec->form,
                       1, &state);
    }
    for (int i = 0; i < physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i];
        const pm_port_spec *spec = &system->port[i]->spec;
        if (!is_listed(system, physics->nsubsystem + i) || spec->form == PM_FREE ||
            system->port[i]->law->has_no_operators) {
            continue;
        }
        const int a = port->subsystem[0], b = port->subsystem[1];
        const pm_layout *layout = system->port[i]->layout;
        const side ends[2] = {{"a.", &layout[0], a < 0 ? NULL : system->part[a]},
                              {"b.", &layout[1], b < 0 ? NULL : system->part[b]}};
        print_operator(port->name, "reversible exchange", &spec->reversible, PM_REVERSIBLE,
                       spec->form, 2, ends);
        print_operator(port->name, "irreversible exchange", &spec->irreversible, PM_IRREVERSIBLE,
                       spec->form, 2, ends);
    }
    if (setup->reference == NULL) {
        printf("  %s: no error table, and no states in reports unless --record asks\n",
               setup->scene->run.reference == NULL
                   ? "no reference"
                   : "the reference holds measurements, with which `portmet-train evaluate "
                     "--estimate` compares");
    }
    printf("  no recorder unless --record names a file\n");
}

// --- the command ---

static pm_status describe(const pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    const pm_system *system = setup->system;
    pm_local_subsystems *all; // are opened as nodes would open them
    PM_TRY(pm_local_subsystems_open(&all, system, 0, NULL));
    const int rounds = pm_local_subsystems_most_rounds(all); // exchanges of fluxes per step
    pm_local_subsystems_close(all);
    PM_TRY(pm_connect_key(scene, NULL));
    print_header(setup, rounds);
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        if (is_listed(system, i)) {
            print_subsystem(setup, i);
        }
    }
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        print_boundary_input(scene, i);
    }
    for (int i = 0; i < scene->network.nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->network.live_input[i];
        printf("\nlive input on channel %s:", input->channel);
        for (int k = 0; k < input->count; ++k) {
            printf(" %s", input->name[k]);
        }
        printf("\n  %s", input->waits    ? "each step waits for the message of its number"
                         : input->starts ? "the newest message holds; `start` until the first one"
                                         : "the newest message holds; the run waits for the first "
                                           "one");
        if (isfinite(input->age)) {
            printf("; the run ends after %g s without a message", input->age);
        }
        printf("\n");
    }
    for (int i = 0; i < scene->physics.nport; ++i) {
        if (is_listed(system, scene->physics.nsubsystem + i)) {
            print_port(setup, i);
        }
    }
    print_skipped(setup);
    print_processes(scene);
    return print_channels(scene);
}

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    pm_status status = pm_prepare(&setup, options, PM_TO_DESCRIBE);
    if (status == PM_OK) {
        status = describe(&setup);
    }
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_check = {
    .name = "check",
    .summary = "validate a scene and describe it",
    .arguments = "SCENE",
    .help =
        "Loads a scene file, its weights and its reference as a run would, and prints what they\n"
        "hold: time stepping, subsystems with their variables, units and dataset columns,\n"
        "boundary inputs, ports, the provenance of the weights, what a run will not compute, and\n"
        "the LCM channels. A scene without an initial state is described too, though it cannot "
        "run.\n"
        "The first mistake ends it with one line and the exit code of its class.",
    .examples = "portmetd check configs/double_pendulum.yaml",
    .accepts = "weights",
    .execute = execute,
};

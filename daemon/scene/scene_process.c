// Reads the section `processes: {NAME: [SUBSYSTEM, ...]}`, which says which subsystems share a
// process. Each of the others has a process of its own. `processes: {auto: N}` divides the
// subsystems among N processes with METIS (G. Karypis and V. Kumar, SIAM J. Sci. Comput. 20, 1998),
// which cuts the graph of subsystems and ports.
#include "scene/scene_reader.h"

#include <stdio.h>
#include <string.h>

#ifdef PM_HAVE_METIS
#include <metis.h>
#endif

#define UNASSIGNED (-1)
#define SEED 1 // of METIS, so that every reading of a scene cuts alike

// --- an automatic cut ---

#ifdef PM_HAVE_METIS

// The graph in compressed rows: the neighbours of subsystem i are neighbour[first[i]] to
// neighbour[first[i + 1] - 1].
typedef struct graph {
    idx_t *first;     // [nsubsystem + 1]
    idx_t *neighbour; // [at most 2 nport] subsystems
    idx_t *traffic;   // of each neighbour: numbers that one round sends both ways
    idx_t *cost;      // [nsubsystem] of a stage
} graph;

// Returns the costliest process among those with several subsystems, or -1 if there is none. *empty
// receives a process without subsystems, or -1. `load` [2 count] is scratch.
static int find_costliest(const pm_physics *physics, const graph *g, int count, const int *mark,
                          long *load, int *empty) {
    long *members = load + count;
    memset(load, 0, 2 * (size_t)count * sizeof *load);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        load[mark[i]] += g->cost[i];
        members[mark[i]] += 1;
    }
    int costliest = -1;
    *empty = -1;
    for (int k = 0; k < count; ++k) {
        *empty = members[k] == 0 ? k : *empty;
        if (members[k] > 1 && (costliest < 0 || load[k] > load[costliest])) {
            costliest = k;
        }
    }
    return costliest;
}

// Divides the subsystems among `count` processes so that the processes have about equal costs and
// exchange few numbers. mark [nsubsystem] receives the process of each subsystem, from 0 to count
// - 1; every process gets at least one, as `count` is at most the number of subsystems. The same
// scene gives the same result.
static pm_status cut_graph(const pm_physics *physics, int count, int *mark) {
    _Static_assert(sizeof(idx_t) == sizeof(int), "METIS with 32-bit indices");
    pm_arena arena = {0};
    const size_t n = (size_t)physics->nsubsystem, nend = 2 * (size_t)physics->nport + 1;
    graph g = {
        .first = pm_arena_array(&arena, n + 1, sizeof *g.first),
        .neighbour = pm_arena_array(&arena, nend, sizeof *g.neighbour),
        .traffic = pm_arena_array(&arena, nend, sizeof *g.traffic),
        .cost = pm_arena_array(&arena, n, sizeof *g.cost),
    };
    long *load = pm_arena_array(&arena, 2 * (size_t)count, sizeof *load);
    idx_t nsubsystem = physics->nsubsystem, nbalance = 1, nprocess = count, traffic = 0;
    idx_t options[METIS_NOPTIONS];
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a scene"));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        // The cost is estimated: the components of the state and of all ends of its ports.
        g.cost[i] = physics->subsystem[i].layout.nz;
        g.first[i + 1] = g.first[i];
        for (int at = physics->first_end[i]; at < physics->first_end[i + 1]; ++at) {
            const int end = physics->end_at[at];
            const pm_scene_port *port = &physics->port[end / 2];
            const int neighbour = port->subsystem[1 - end % 2];
            const idx_t shown = (idx_t)(port->layout[0].nz + port->layout[1].nz);
            g.cost[i] += shown;
            if (neighbour < 0) {
                continue;
            }
            idx_t k = g.first[i]; // ports with the same neighbour are added up
            while (k < g.first[i + 1] && g.neighbour[k] != neighbour) {
                ++k;
            }
            g.neighbour[k] = neighbour;
            g.traffic[k] += 3 * shown; // y, e and eta
            g.first[i + 1] += k == g.first[i + 1];
        }
    }
    memset(mark, 0, n * sizeof *mark);
    METIS_SetDefaultOptions(options);
    options[METIS_OPTION_SEED] = SEED;
    // METIS refuses a graph for one process.
    const int result =
        count == 1
            ? METIS_OK
            : METIS_PartGraphRecursive(&nsubsystem, &nbalance, g.first, g.neighbour, g.cost, NULL,
                                       g.traffic, &nprocess, NULL, NULL, options, &traffic, mark);
    if (result != METIS_OK) {
        PM_TRY_DONE(pm_fail(PM_ECONFIG, "METIS cannot cut the scene into %d processes: %s", count,
                            result == METIS_ERROR_MEMORY ? "out of memory" : "error in METIS"));
    }
    // METIS may leave a process without subsystems where one subsystem costs more than a whole
    // process should. Each such process takes the second half of the costliest one.
    int empty;
    int from = find_costliest(physics, &g, count, mark, load, &empty);
    while (empty >= 0 && from >= 0) {
        long before = 0;
        bool first = true;
        for (int i = 0; i < physics->nsubsystem; ++i) {
            if (mark[i] == from) {
                before += g.cost[i];
                mark[i] = first || 2 * before <= load[from] ? from : empty;
                first = false;
            }
        }
        from = find_costliest(physics, &g, count, mark, load, &empty);
    }
done:
    pm_arena_free(&arena);
    return status;
}

#else

static pm_status cut_graph(const pm_physics *physics, int count, int *mark) {
    (void)physics, (void)count, (void)mark;
    return pm_fail(PM_ECONFIG,
                   "this program was built without METIS, which \"auto\" needs: list the "
                   "subsystems of each process, or build where libmetis-dev is installed");
}

#endif

// --- the section ---

// Refuses a process that has the name of a subsystem it does not serve: the channels of both would
// be the same.
static pm_status check_owner(pm_scene_reader *r, pm_yaml key, const char *name, int number) {
    const int id = pm_scene_find_subsystem(r->scene, name);
    return id < 0 || r->scene->physics.subsystem[id].process == number
               ? PM_OK
               : pm_yaml_fail(key, "a subsystem is called \"%s\" that this process does not serve",
                              name);
}

// Marks a subsystem with the position of its process in the section.
static pm_status assign(pm_scene_reader *r, pm_yaml at, int id, int number) {
    pm_scene_subsystem *subsystem = &r->scene->physics.subsystem[id];
    if (subsystem->process != UNASSIGNED) {
        return pm_yaml_fail(at, "subsystem \"%s\" has a process already", subsystem->name);
    }
    subsystem->process = number;
    return PM_OK;
}

// Reads the names of the processes and marks their subsystems.
static pm_status read_section(pm_scene_reader *r, pm_yaml section, const char **name) {
    pm_yaml key, list;
    for (int i = 0; i < pm_yaml_count(section); ++i) {
        pm_yaml_entry(section, i, &key, &list);
        PM_TRY(pm_scene_read_name(r, key, &name[i]));
        if (pm_yaml_is_list(list) && pm_yaml_count(list) == 0) {
            return pm_yaml_fail(list, "expected at least one subsystem");
        }
        PM_TRY(pm_scene_visit_members(r, list, assign, i));
    }
    for (int i = 0; i < pm_yaml_count(section); ++i) {
        pm_yaml_entry(section, i, &key, &list);
        PM_TRY(check_owner(r, key, name[i], i));
    }
    return PM_OK;
}

// Reads the number N of a section {auto: N}; 0 for other sections. Names of subsystems do not begin
// with a digit, so that `auto` may be the name of a process, too.
static pm_status read_count(pm_scene_reader *r, pm_yaml section, int *count) {
    const pm_yaml number = pm_yaml_get(section, "auto");
    const char *text = "";
    *count = 0;
    if (pm_yaml_exists(number) && !pm_yaml_is_list(number) && !pm_yaml_is_map(number)) {
        PM_TRY(pm_yaml_text(number, r->arena, &text));
    }
    if (strchr("+-.0123456789", text[0]) == NULL || text[0] == '\0') {
        return PM_OK;
    }
    if (pm_yaml_count(section) > 1) {
        return pm_yaml_fail(number, "expected no other process beside a number of processes");
    }
    return pm_yaml_int(number, 1, r->scene->physics.nsubsystem, count);
}

// --- the processes ---

// Appends an empty process with room for `count` subsystems.
static pm_scene_process *add_process(pm_scene *scene, const char *name, int count) {
    pm_scene_process *process = &scene->network.process[scene->network.nprocess++];
    *process = (pm_scene_process){
        .name = name,
        .subsystem = pm_arena_array(&scene->arena, (size_t)count, sizeof *process->subsystem)};
    return process;
}

pm_status pm_scene_read_processes(pm_scene_reader *r) {
    pm_scene *scene = r->scene;
    const int nsubsystem = scene->physics.nsubsystem;
    const pm_yaml section = pm_yaml_get(r->root, "processes");
    PM_TRY(pm_yaml_exists(section) ? pm_yaml_require_entries(section) : PM_OK);
    int automatic;
    PM_TRY(read_count(r, section, &automatic));
    // A mark is the position of a process in the section: each process has a name, a number of
    // subsystems, and its position among all processes once it is made.
    const size_t nmark = automatic > 0 ? (size_t)automatic : (size_t)pm_yaml_count(section);
    const char **name = pm_arena_array(r->arena, nmark, sizeof *name);
    int *count = pm_arena_array(r->arena, nmark, sizeof *count);
    int *made = pm_arena_array(r->arena, nmark, sizeof *made);
    scene->network.process =
        pm_arena_array(r->arena, (size_t)nsubsystem, sizeof *scene->network.process);
    PM_TRY(pm_scene_check_memory(r));
    for (size_t i = 0; i < nmark; ++i) {
        made[i] = UNASSIGNED;
    }
    for (int i = 0; i < nsubsystem; ++i) {
        scene->physics.subsystem[i].process = UNASSIGNED;
    }
    if (automatic > 0) { // the processes are called auto0, auto1, ...
        const pm_yaml at = pm_yaml_get(section, "auto");
        int *mark = pm_arena_array(r->arena, (size_t)nsubsystem, sizeof *mark);
        PM_TRY(pm_scene_check_memory(r));
        const pm_status status = cut_graph(&scene->physics, automatic, mark);
        if (status == PM_ECONFIG) {
            char reason[256];
            snprintf(reason, sizeof reason, "%s", pm_error());
            return pm_yaml_fail(at, "%s", reason);
        }
        PM_TRY(status);
        for (int i = 0; i < nsubsystem; ++i) {
            scene->physics.subsystem[i].process = mark[i];
        }
        for (int i = 0; i < automatic; ++i) {
            name[i] = pm_arena_printf(r->arena, "auto%d", i);
            PM_TRY(pm_scene_check_memory(r));
            PM_TRY(check_owner(r, at, name[i], i));
        }
    } else {
        PM_TRY(read_section(r, section, name));
    }
    for (int i = 0; i < nsubsystem; ++i) {
        const int mark = scene->physics.subsystem[i].process;
        if (mark != UNASSIGNED) {
            ++count[mark];
        }
    }
    // The processes are made in the order of their first subsystems.
    for (int i = 0; i < nsubsystem; ++i) {
        pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
        const int mark = subsystem->process;
        const bool known = mark != UNASSIGNED && made[mark] != UNASSIGNED;
        if (!known) {
            add_process(scene, mark == UNASSIGNED ? subsystem->name : name[mark],
                        mark == UNASSIGNED ? 1 : count[mark]);
            PM_TRY(pm_scene_check_memory(r));
        }
        subsystem->process = known ? made[mark] : scene->network.nprocess - 1;
        if (mark != UNASSIGNED) {
            made[mark] = subsystem->process;
        }
        pm_scene_process *process = &scene->network.process[subsystem->process];
        process->subsystem[process->count++] = i;
    }
    return PM_OK;
}

pm_status pm_scene_merge_processes(pm_scene *scene) {
    scene->network.nprocess = 0;
    pm_scene_process *all = add_process(scene, "all", scene->physics.nsubsystem);
    PM_TRY(pm_arena_status(&scene->arena, "a scene"));
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        scene->physics.subsystem[i].process = 0;
        all->subsystem[i] = i;
    }
    all->count = scene->physics.nsubsystem;
    return PM_OK;
}

// Divides the subsystems of a scene among processes with METIS (G. Karypis and V. Kumar, SIAM J.
// Sci. Comput. 20, 1998), which cuts the graph of subsystems and ports: `processes: {auto: N}`.
#include "scene/scene_reader.h"

#ifdef PM_HAVE_METIS
#include <metis.h>
#include <string.h>

#define SEED 1 // of METIS, so that every reading of a scene cuts alike

// The graph in compressed rows: the neighbours of subsystem i are neighbour[first[i]] to
// neighbour[first[i + 1] - 1].
typedef struct cut_graph {
    idx_t *first;     // [nsubsystem + 1]
    idx_t *neighbour; // [at most 2 nport] subsystems
    idx_t *traffic;   // of each neighbour: numbers that one round sends both ways
    idx_t *cost;      // [nsubsystem] of a stage
} cut_graph;

// Adds the port at one end of a subsystem. Ports with the same neighbour are added up.
static void add_end(const pm_scene *scene, cut_graph *g, int subsystem, int end_at) {
    const pm_scene_port *port = &scene->port[end_at / 2];
    const int neighbour = port->subsystem[1 - end_at % 2];
    const idx_t shown = (idx_t)(port->layout[0].nz + port->layout[1].nz);
    if (neighbour < 0) {
        return;
    }
    idx_t k = g->first[subsystem];
    while (k < g->first[subsystem + 1] && g->neighbour[k] != neighbour) {
        ++k;
    }
    g->neighbour[k] = neighbour;
    g->traffic[k] += 3 * shown; // y, e and eta
    g->first[subsystem + 1] += k == g->first[subsystem + 1];
}

// Returns an estimated cost: the number of components of the state and of all ends of its ports.
static idx_t estimate(const pm_scene *scene, int id) {
    idx_t cost = scene->subsystem[id].layout.nz;
    for (int k = scene->first_end[id]; k < scene->first_end[id + 1]; ++k) {
        const pm_scene_port *port = &scene->port[scene->end_at[k] / 2];
        cost += (idx_t)(port->layout[0].nz + port->layout[1].nz);
    }
    return cost;
}

static void fill_graph(const pm_scene *scene, const int *cost, cut_graph *g) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        g->cost[i] = cost == NULL ? estimate(scene, i) : cost[i];
        g->first[i + 1] = g->first[i];
        for (int k = scene->first_end[i]; k < scene->first_end[i + 1]; ++k) {
            add_end(scene, g, i, scene->end_at[k]);
        }
    }
}

static pm_status partition(const pm_scene *scene, cut_graph *g, int count, int *mark) {
    idx_t nsubsystem = scene->nsubsystem, nbalance = 1, nprocess = count, traffic = 0;
    idx_t options[METIS_NOPTIONS];
    METIS_SetDefaultOptions(options);
    options[METIS_OPTION_SEED] = SEED;
    // METIS refuses a graph for one process.
    const int result =
        count == 1 ? METIS_OK
                   : METIS_PartGraphRecursive(&nsubsystem, &nbalance, g->first, g->neighbour,
                                              g->cost, NULL, g->traffic, &nprocess, NULL, NULL,
                                              options, &traffic, mark);
    return result == METIS_OK
               ? PM_OK
               : pm_fail(PM_ECONFIG, "METIS cannot cut the scene into %d processes: %s", count,
                         result == METIS_ERROR_MEMORY ? "out of memory" : "error in METIS");
}

// Returns the process that costs most of those with several subsystems. `load` [2 count] is
// scratch. A process without subsystems is found as *empty; -1: there is none.
static int find_costliest(const pm_scene *scene, const cut_graph *g, int count, const int *mark,
                          long *load, int *empty) {
    long *members = load + count;
    memset(load, 0, 2 * (size_t)count * sizeof *load);
    for (int i = 0; i < scene->nsubsystem; ++i) {
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

// Gives subsystems to processes that METIS has left without, as it may where one subsystem costs
// more than a whole process should: each takes the second half of the costliest process.
static void fill_empty(const pm_scene *scene, const cut_graph *g, int count, long *load,
                       int *mark) {
    int empty;
    int from = find_costliest(scene, g, count, mark, load, &empty);
    while (empty >= 0 && from >= 0) {
        long before = 0;
        bool first = true;
        for (int i = 0; i < scene->nsubsystem; ++i) {
            if (mark[i] != from) {
                continue;
            }
            before += g->cost[i];
            mark[i] = first || 2 * before <= load[from] ? from : empty;
            first = false;
        }
        from = find_costliest(scene, g, count, mark, load, &empty);
    }
}

pm_status pm_scene_cut(const pm_scene *scene, int count, const int *cost, int *mark) {
    _Static_assert(sizeof(idx_t) == sizeof(int), "METIS with 32-bit indices");
    pm_arena arena = {0};
    const size_t n = (size_t)scene->nsubsystem, nend = 2 * (size_t)scene->nport + 1;
    cut_graph g = {
        .first = pm_arena_array(&arena, n + 1, sizeof *g.first),
        .neighbour = pm_arena_array(&arena, nend, sizeof *g.neighbour),
        .traffic = pm_arena_array(&arena, nend, sizeof *g.traffic),
        .cost = pm_arena_array(&arena, n, sizeof *g.cost),
    };
    long *load = pm_arena_array(&arena, 2 * (size_t)count, sizeof *load);
    pm_status status = pm_scene_no_memory();
    if (g.first != NULL && g.neighbour != NULL && g.traffic != NULL && g.cost != NULL &&
        load != NULL) {
        fill_graph(scene, cost, &g);
        for (int i = 0; i < scene->nsubsystem; ++i) {
            mark[i] = 0;
        }
        status = partition(scene, &g, count, mark);
        fill_empty(scene, &g, count, load, mark);
    }
    pm_arena_free(&arena);
    return status;
}

#else

pm_status pm_scene_cut(const pm_scene *scene, int count, const int *cost, int *mark) {
    (void)scene, (void)count, (void)cost, (void)mark;
    return pm_fail(PM_ECONFIG,
                   "this program was built without METIS, which \"auto\" needs: list the "
                   "subsystems of each process, or build where libmetis-dev is installed");
}

#endif

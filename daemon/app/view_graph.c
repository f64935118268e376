// Groups of subsystems, the edges between them, and the sums over both.
#include "app/view_graph.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// --- the graph ---

// Returns true if subsystem i is shown.
static bool is_shown(const bool *shown, int i) {
    return shown == NULL || shown[i];
}

static int count_shown(const pm_scene *scene, const bool *shown) {
    int count = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        count += is_shown(shown, i);
    }
    return count;
}

static void add_nodes(pm_view_graph *g, const bool *shown, int nshown) {
    const pm_scene *scene = g->scene;
    for (int i = 0, k = 0; i < scene->nsubsystem; ++i) {
        if (!is_shown(shown, i)) {
            g->node_of[i] = -1;
            continue;
        }
        const int node = (int)((long)k++ * g->npart / nshown);
        if (g->node[node].count++ == 0) {
            g->node[node].name = scene->subsystem[i].name;
        }
        g->node_of[i] = node;
    }
    for (int i = 0; i < scene->nboundary_input; ++i) {
        g->node[g->npart + i].name = scene->boundary_input[i].name;
    }
}

static int node_at(const pm_view_graph *g, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0 ? g->node_of[port->subsystem[end]]
                                     : g->npart + port->boundary_input[end];
}

// Returns the edge that the port belongs to, which may be a new one.
static int edge_for(pm_view_graph *g, int a, int b, bool summed) {
    for (int k = 0; summed && k < g->nedge; ++k) {
        if (g->edge[k].end[0] == a && g->edge[k].end[1] == b) {
            return k;
        }
    }
    g->edge[g->nedge] = (pm_view_edge){.end = {a, b}};
    return g->nedge++;
}

static void add_edges(pm_view_graph *g, bool summed) {
    for (int i = 0; i < g->scene->nport; ++i) {
        const pm_scene_port *port = &g->scene->port[i];
        const int a = node_at(g, port, 0), b = node_at(g, port, 1);
        if (a == b || a < 0 || b < 0) {
            g->edge_of[i] = -1;
            continue;
        }
        g->first_end[i] = a < b ? 0 : 1;
        const int k = a < b ? edge_for(g, a, b, summed) : edge_for(g, b, a, summed);
        g->edge_of[i] = k;
        if (g->edge[k].count++ == 0) {
            g->edge[k].name = port->name;
        }
    }
}

pm_status pm_view_graph_init(pm_view_graph *graph, pm_arena *arena, const pm_scene *scene,
                             const bool *shown) {
    const int nshown = count_shown(scene, shown);
    const bool summed = nshown > PM_VIEW_MOST;
    const size_t nport = (size_t)scene->nport + 1;
    graph->scene = scene;
    graph->npart = summed ? PM_VIEW_GROUPS : nshown;
    graph->nnode = graph->npart + scene->nboundary_input;
    graph->node = pm_arena_array(arena, (size_t)graph->nnode, sizeof *graph->node);
    graph->node_of = pm_arena_array(arena, (size_t)scene->nsubsystem, sizeof *graph->node_of);
    graph->edge = pm_arena_array(arena, nport, sizeof *graph->edge);
    graph->edge_of = pm_arena_array(arena, nport, sizeof *graph->edge_of);
    graph->first_end = pm_arena_array(arena, nport, sizeof *graph->first_end);
    if (graph->node == NULL || graph->node_of == NULL || graph->edge == NULL ||
        graph->edge_of == NULL || graph->first_end == NULL) {
        return pm_fail(PM_ENOMEM, "view: out of memory");
    }
    add_nodes(graph, shown, nshown);
    add_edges(graph, summed);
    return PM_OK;
}

void pm_view_node_name(const pm_view_graph *graph, int node_id, char *text, size_t size) {
    const pm_view_node *node = &graph->node[node_id];
    if (node->count > 1) {
        snprintf(text, size, "%s ... (%d)", node->name, node->count);
    } else {
        snprintf(text, size, "%s", node->name);
    }
}

// --- frames ---

int pm_view_frame_size(const pm_view_graph *graph) {
    return PM_VIEW_TOTALS + PM_VIEW_PER_PART * graph->npart + PM_VIEW_PER_EDGE * graph->nedge;
}

void pm_view_frame_fill(const pm_view_graph *graph, const pm_sample *sample, double *frame) {
    const int npart = graph->npart;
    double *const part = frame + PM_VIEW_TOTALS, *const edge = part + PM_VIEW_PER_PART * npart;
    const int count = pm_view_frame_size(graph) - PM_VIEW_TOTALS;
    memset(part, 0, (size_t)count * sizeof *part);
    for (int i = 0; i < graph->scene->nsubsystem; ++i) {
        const int k = graph->node_of[i];
        if (k < 0) {
            continue;
        }
        part[k] += sample->energy[i];
        part[npart + k] += sample->entropy[i];
        part[2 * npart + k] += sample->bulk_entropy[i];
    }
    for (int i = 0; i < graph->scene->nport; ++i) {
        const int k = graph->edge_of[i];
        for (int end = 0; end < 2 && k >= 0; ++end) {
            const pm_flux *flux = &sample->flux[i][graph->first_end[i] ^ end];
            edge[end * graph->nedge + k] += flux->energy;
            edge[(2 + end) * graph->nedge + k] += flux->entropy;
        }
    }
}

// A view shows a scene as a graph: nodes are subsystems or groups of subsystems, and edges are
// ports. A scene with more than PM_VIEW_MOST subsystems is summarised: consecutive
// subsystems form a group, whose energies and entropies are sums, and the ports between two groups
// form one edge, whose fluxes are sums. Ports within a group are not shown. The graph may also be
// that of some subsystems alone, with the ports between them.
#ifndef PM_APP_VIEW_GRAPH_H
#define PM_APP_VIEW_GRAPH_H

#include "scene/recording.h"

#define PM_VIEW_MOST 200  // subsystems that are shown one by one
#define PM_VIEW_GROUPS 64 // groups of a larger scene

// A subsystem, a group of them, or a boundary input.
typedef struct pm_view_node {
    const char *name; // of the subsystem, or of the first one of the group
    int count;        // number of subsystems; 0: a boundary input
} pm_view_node;

typedef struct pm_view_edge {
    const char *name; // of the port, or of the first one
    int end[2];       // nodes
    int count;        // number of ports
} pm_view_edge;

// The caller owns this storage and initialises it with zeros. The arena owns the arrays.
typedef struct pm_view_graph {
    const pm_scene *scene;
    int npart; // nodes that are subsystems or groups; they come before the boundary inputs
    int nnode;
    pm_view_node *node; // [nnode]
    int nedge;
    pm_view_edge *edge; // [nedge]
    int *node_of;       // [nsubsystem]; -1: the subsystem is not shown
    int *edge_of;       // [nport]; -1: the port is within a group, or not shown
    int *first_end;     // [nport] the end of the port at end 0 of its edge
} pm_view_graph;

// Makes the graph of a scene, which must outlive it, with memory from the arena. `shown`
// [nsubsystem] says which subsystems it has; NULL: all. PM_ENOMEM.
pm_status pm_view_graph_init(pm_view_graph *graph, pm_arena *arena, const pm_scene *scene,
                             const bool *shown);

// The numbers of a frame, in this order: the PM_VIEW_TOTALS numbers below; then the energy (J), the
// entropy (J/K) and the entropy production within (W/K) of each part; then the energy flux (W) into
// end 0 and end 1 and the entropy flux (W/K) into end 0 and end 1 of each edge.
enum {
    PM_VIEW_SESSION_HIGH, // the upper and the lower 32 bits of the session's number, since a double
    PM_VIEW_SESSION_LOW,  // cannot hold it as a whole
    PM_VIEW_STEP,
    PM_VIEW_TIME,             // s
    PM_VIEW_ENERGY,           // J, of the ledger, as the four after it
    PM_VIEW_ENTROPY,          // J/K
    PM_VIEW_ENERGY_RESIDUAL,  // 1
    PM_VIEW_ENTROPY_RESIDUAL, // 1
    PM_VIEW_VIOLATIONS,       // steps
    PM_VIEW_TOTALS
};
enum { PM_VIEW_PER_PART = 3, PM_VIEW_PER_EDGE = 4 };

// Returns the number of numbers in a frame.
int pm_view_frame_size(const pm_view_graph *graph);

// Writes the numbers of all parts and edges of a sample into frame [pm_view_frame_size], but no
// totals.
void pm_view_frame_fill(const pm_view_graph *graph, const pm_sample *sample, double *frame);

// Writes the name of a node into `text` [size]: that of the subsystem, or "first ... (count)".
void pm_view_node_name(const pm_view_graph *graph, int node_id, char *text, size_t size);

#endif

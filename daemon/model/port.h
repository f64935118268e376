// A port between two subsystems: the exposed groups of both ends, the law that couples them
// (equation (3), or a boundary term of (1)), and its parameters. A new law is one file
// laws/<name>.c, one line in the table of port.c, and one in CMakeLists.txt.
#ifndef PM_MODEL_PORT_H
#define PM_MODEL_PORT_H

#include "graph/graph.h"
#include "model/network.h"
#include "model/params.h"
#include "model/spec.h"

typedef enum pm_end { PM_END_A = 0, PM_END_B = 1 } pm_end;

typedef struct pm_port_model pm_port_model;

// The quantities that one end of a port shows to the other at a stage, as graph nodes.
typedef struct pm_port_nodes {
    pm_node y;        // [1][ny] the exposed components of the state
    pm_node e;        // [1][ny] dE/dy
    pm_node eta;      // [1][ny] dS/dy; PM_NO_NODE: the subsystem has no entropy
    pm_node response; // [1][ny] change of e during the step per unit of rate (prediction.h);
                      // PM_NO_NODE: the integrator does not use it
} pm_port_nodes;

typedef struct pm_port_law {
    const char *name;
    bool conservative;     // in the hard form the energy fluxes of both ends cancel by construction
    bool separate;         // the rate of one end can be evaluated without the rate of the other
    bool has_matrix;       // its models have the key `matrix`
    bool has_ends;         // its models have the key `ends`: which ends have boundary terms
    bool has_no_operators; // the law itself says what acts; its models name no operators
    bool joins_gaps; // a gap beside a solid shows its force at the end of a substep through it
    // Checks the spec and declares the parameters.
    pm_status (*declare)(pm_port_model *port);
    // Returns the rate [1][ny] of the components exposed by `own` from the quantities that both
    // ends show, indexed by pm_end. PM_NO_NODE: nothing acts. `degeneracy` is that of pm_part_bulk.
    pm_node (*rate)(pm_graph *g, const pm_port_model *port, pm_end own, const pm_port_nodes end[2],
                    pm_node *degeneracy);
    // Returns the irreversible part of the rates of both ends, side by side [1][ny_a + ny_b], or
    // PM_NO_NODE if nothing acts. An implicit method evaluates it at predicted co-energies
    // (prediction.h). NULL: the law has no such part.
    pm_node (*irreversible)(pm_graph *g, const pm_port_model *port, const pm_port_nodes end[2]);
    // Visits the constants that training fixes, like pm_part_visit.
    pm_status (*visit)(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2],
                       pm_normaliser_visit *visit, void *context);
} pm_port_law;

struct pm_port_model {
    pm_layout layout[2]; // exposed groups of ends a and b
    pm_port_spec spec;
    const pm_port_law *law; // set by pm_port_declare
    pm_params params;
};

// Returns the law called `name`, or NULL.
const pm_port_law *pm_port_law_find(const char *name);
// Returns the names of all laws, separated by ", ".
const char *pm_port_law_names(void);

// Looks up the law, checks the spec against both layouts and declares every parameter in
// port->params. PM_ECONFIG, PM_ENOMEM. The caller frees the port, after a failure too.
pm_status pm_port_declare(pm_port_model *port);
void pm_port_free(pm_port_model *port);

#endif

// A port between two subsystems: the exposed groups of both ends, the law that couples them, and
// its numbers. To add a law: one file law_<name>.c and one line in the table of port.c.
#ifndef PM_MODEL_PORT_H
#define PM_MODEL_PORT_H

#include "graph/graph.h"
#include "model/network.h"
#include "model/params.h"
#include "model/spec.h"

typedef enum pm_end { PM_END_A = 0, PM_END_B = 1 } pm_end;

typedef struct pm_port_model pm_port_model;

// What one end of a port shows to the other at a stage, as graph nodes: y [1][ny], the co-energies
// e = dE/dy [1][ny] and eta = dS/dy [1][ny] (PM_NO_NODE if the subsystem has no entropy), and by
// how much e rises during the step per unit of rate [1][ny] (prediction.h; PM_NO_NODE if no
// integrator asks).
typedef struct pm_port_nodes {
    pm_node y, e, eta, response;
} pm_port_nodes;

typedef struct pm_port_law {
    const char *name;
    bool conservative; // the two ends' energy fluxes cancel by construction in the hard form
    bool separate;     // the two ends' rates have no work in common: each end evaluates its own
    // Checks the spec and declares the parameters.
    pm_status (*declare)(pm_port_model *port);
    // The rate [1][ny] of the components exposed by `own`, given what both ends show, indexed by
    // pm_end. May return PM_NO_NODE. `degeneracy` as in pm_part_bulk.
    pm_node (*rate)(pm_graph *g, const pm_port_model *port, pm_end own, const pm_port_nodes end[2],
                    pm_node *degeneracy);
    // The irreversible part of both ends' rates, side by side [1][ny_a + ny_b]; PM_NO_NODE: none.
    // NULL: the law has no such part.
    pm_node (*irreversible)(pm_graph *g, const pm_port_model *port, const pm_port_nodes end[2]);
    // As pm_part_visit.
    pm_status (*visit)(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2],
                       pm_normaliser_visit *visit, void *context);
} pm_port_law;

struct pm_port_model {
    pm_layout layout[2]; // exposed groups of ends a and b
    pm_port_spec spec;
    const pm_port_law *law; // set by pm_port_declare
    pm_params params;
};

// The law called `name`, or NULL. pm_port_law_names lists all, separated by ", ".
const pm_port_law *pm_port_law_find(const char *name);
const char *pm_port_law_names(void);

// As pm_part_declare: looks up the law, checks the spec, declares parameters. PM_ECONFIG,
// PM_ENOMEM.
pm_status pm_port_declare(pm_port_model *port);
void pm_port_free(pm_port_model *port);

#endif

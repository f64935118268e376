// A learned subsystem: its layout, its model and its numbers; and the graph expressions of E, S and
// the bulk term of equation (1): zdot = L dE + M dS.
// Method: Hernandez, Badias, Chinesta, Cueto, Comput. Mech. 72 (2023) 553; hard form: operator.h.
#ifndef PM_MODEL_PART_H
#define PM_MODEL_PART_H

#include "graph/graph.h"
#include "model/feature.h"
#include "model/network.h"
#include "model/params.h"
#include "model/spec.h"

typedef struct pm_part {
    pm_layout layout;
    pm_part_spec spec; // points into the arena of whoever made it
    pm_params params;
} pm_part;

// Checks the spec against the layout (unknown groups, bad feature expressions, sizes) and declares
// every parameter in part->params with its initial value. PM_ECONFIG, PM_ENOMEM.
pm_status pm_part_declare(pm_part *part);
void pm_part_free(pm_part *part); // the parameters

// False in the free form, where energy is not defined; E is then zero, and so are the fluxes.
bool pm_part_has_energy(const pm_part *part);
// True if the subsystem has an entropy at all; otherwise S, M and eta are nowhere evaluated.
bool pm_part_has_entropy(const pm_part *part);

// Whether its energy or entropy, `potential`, depends on a group, itself or by an image of it.
bool pm_part_depends(const pm_part *part, const pm_potential_spec *potential, const char *group);

// The groups of a state z by name, and after them its images; z is PM_NO_NODE and g is NULL while a
// spec is only being checked.
pm_symbols pm_part_symbols(const pm_part *part, pm_graph *g, pm_node z);

// E [1][1] and S [1][1] per batch item, for z [1][nz] batched. S is PM_NO_NODE without entropy.
pm_node pm_part_energy(pm_graph *g, const pm_part *part, pm_node z);
pm_node pm_part_entropy(pm_graph *g, const pm_part *part, pm_node z);

// The co-energies dE and dS [1][nz] of a step from z_from to z_to: their discrete derivatives, or
// the derivatives at z_to where z_from is PM_NO_NODE. PM_NO_NODE where E or S does not depend on z.
void pm_part_coenergies(pm_graph *g, const pm_part *part, pm_node z_from, pm_node z_to, pm_node *dE,
                        pm_node *dS);
// By how much dE rises when a component of z_to does: the diagonal of its derivative [1][nz], at
// the components marked in `wanted` [nz], zero elsewhere. PM_NO_NODE if it is zero everywhere.
pm_node pm_part_response(pm_graph *g, const pm_part *part, pm_node dE, pm_node z_to,
                         const bool *wanted);
// Whether the part has discrete derivatives: all its features do.
bool pm_part_is_discrete(const pm_part *part);

// The bulk term [1][nz] (PM_NO_NODE if nothing acts), and the squared degeneracy residual
// |L dS|^2 + |M dE|^2 [1][1] in scaled coordinates (PM_NO_NODE where the form makes it zero).
// dE and dS may be PM_NO_NODE.
pm_node pm_part_bulk(pm_graph *g, const pm_part *part, pm_node z, pm_node dE, pm_node dS,
                     pm_node *degeneracy);

// Calls `visit` for every set of constants that training fixes from the data first, with the
// symbols to compute them from as nodes of g.
pm_status pm_part_visit(const pm_part *part, pm_graph *g, pm_node z, pm_node dE, pm_node dS,
                        pm_normaliser_visit *visit, void *context);

#endif

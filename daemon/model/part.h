// A learned subsystem: its layout, its spec and its parameters; and the graph expressions of E, S
// and the bulk term of equation (1): zdot = L dE + M dS. Method: Hernandez, Badias, Chinesta,
// Cueto, Comput. Mech. 72 (2023) 553; hard form: operator.h.
//
// A sensor shows a velocity or a temperature; operators and ports act on a momentum or an entropy.
// A group of the state may therefore hold the co-energy y = dE/dx in place of the energy variable
// x. A co-energy C(q, y), convex in y, joins both by Legendre's transformation (van der Schaft,
// Jeltsema, Found. Trends Syst. Control 1 (2014) 173):
//     x = C_y,   E = V(q) + y . C_y - C,   so that dE/dx = y and dE/dq = V_q - C_q
// where q are the other groups, and V is the spec's `energy`. All rates and fluxes are those of x
// and q. Last of all the rates are turned into those of the state:
//     ydot = C_yy^-1 (xdot - C_yq qdot)
#ifndef PM_MODEL_PART_H
#define PM_MODEL_PART_H

#include "graph/graph.h"
#include "model/feature.h"
#include "model/network.h"
#include "model/params.h"
#include "model/spec.h"

// The kinds of parts. A table in part.c says what each needs to be declared; one in sim/ says how
// it moves.
typedef enum pm_part_kind {
    PM_PART_GRAPH, // potentials and operators, or a rate, as expressions of a graph
    PM_PART_SOLID, // a body on a mesh, in balance with its load
    PM_PART_KINDS
} pm_part_kind;

typedef struct pm_part {
    pm_layout layout;
    pm_part_spec spec; // its pointers belong to the arena of the caller that made it
    pm_params params;
} pm_part;

// Checks the spec against the layout (names of groups, expressions, sizes) and declares every
// parameter in part->params with its initial value. PM_ECONFIG, PM_ENOMEM. The caller frees the
// part, after a failure too.
pm_status pm_part_declare(pm_part *part);
void pm_part_free(pm_part *part); // frees the parameters

pm_part_kind pm_part_kind_of(const pm_part *part);
// Returns false for the free form, which defines no energy; E and all fluxes are then zero.
bool pm_part_has_energy(const pm_part *part);
// Returns true if the subsystem has an entropy. Without one, S, M and dS are never evaluated.
bool pm_part_has_entropy(const pm_part *part);

// Returns true if the energy or entropy `potential` of the part depends on a group, either directly
// or through a derived variable.
bool pm_part_depends(const pm_part *part, const pm_potential_spec *potential, const char *group);

// Returns the symbols of a state z [1][nz]: its groups, then its derived variables, then the
// learned constants. z is PM_NO_NODE and g is NULL while a spec is only being checked.
pm_symbols pm_part_symbols(const pm_part *part, pm_graph *g, pm_node z);

// Bound of the rounding error of a sum, relative to the sum of magnitudes. It is a thousand times
// larger than double precision requires.
#define PM_PART_ROUNDING 1e-12
// Bounds the change of the derived variables if each group g changes by at most radius[g] [1][size
// of group g], or not at all if radius[g] is PM_NO_NODE. Writes the bound of derived variable i,
// with its rounding errors, to radius[ngroup + i]. `symbols` are those of pm_part_symbols.
void pm_part_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols, pm_node *radius);

// Returns true if the state has groups that are shown by their co-energies. The free form has no
// use for them: its rate is that of what is shown.
bool pm_part_has_coenergies(const pm_part *part);
// Returns the state z [1][nz] with the energy variables x in place of the co-energies y.
pm_node pm_part_energy_variables(pm_graph *g, const pm_part *part, pm_node z);
// Turns the rate of energy variables [1][nz] at the state z [1][nz], which is the sum of the bulk
// term and of all ports, into the rate of the state. Returns `rate` itself if both are the same,
// because the state has no co-energies or all inertias are 1, and PM_NO_NODE if the rate is.
pm_node pm_part_release(pm_graph *g, const pm_part *part, pm_node z, pm_node rate);

// Return E [1][1] in J and S [1][1] in J/K for z [1][nz] batched. S is PM_NO_NODE if there is no
// entropy.
pm_node pm_part_energy(pm_graph *g, const pm_part *part, pm_node z);
pm_node pm_part_entropy(pm_graph *g, const pm_part *part, pm_node z);

// Computes the co-energies dE and dS [1][nz] of a step from z_from to z_to: the discrete
// derivatives of E and S or, if z_from is PM_NO_NODE, the derivatives at z_to, with respect to the
// energy variables. *dE or *dS becomes PM_NO_NODE if the potential does not depend on z. A part
// with co-energies has no discrete derivatives.
void pm_part_coenergies(pm_graph *g, const pm_part *part, pm_node z_from, pm_node z_to, pm_node *dE,
                        pm_node *dS);
// Returns the response of the co-energies (prediction.h): the diagonal [1][nz] of the derivative of
// dE with respect to z_to, times ports[c] for each component c. PM_NO_NODE if it is zero
// everywhere.
pm_node pm_part_response(pm_graph *g, const pm_part *part, pm_node dE, pm_node z_to,
                         const int *ports);
// Returns true if the part has discrete derivatives, that is, if all its features have them.
bool pm_part_is_discrete(const pm_part *part);

// Returns the bulk term [1][nz], in units of the energy variables per second, or PM_NO_NODE if
// nothing acts. dE and dS may be PM_NO_NODE. In the soft form the components of L dS and M dE in
// scaled coordinates are appended to *degeneracy [1][...], which is PM_NO_NODE before the first
// ones.
pm_node pm_part_bulk(pm_graph *g, const pm_part *part, pm_node z, pm_node dE, pm_node dS,
                     pm_node *degeneracy);

// Calls `visit` for every set of constants that training fixes from the data (network.h). The
// symbols from which they are computed are nodes of g. Passes on the status of `visit`.
pm_status pm_part_visit(const pm_part *part, pm_graph *g, pm_node z, pm_node dE, pm_node dS,
                        pm_normaliser_visit *visit, void *context);

#endif

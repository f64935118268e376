// Networks on the graph of a mesh, in three stages: encode, process, decode (Battaglia et al. 2018,
// arXiv 1806.01261; with GENERIC operators Hernandez, Badias, Chinesta, Cueto, Comput. Mech. 72,
// 2023):
//
//   encode   h_i = tanh(linear in the fields of node i and in features of its place)
//   process  m_ij = tanh(linear in h_i, h_j, the edge's direction and the difference of the first
//            field over the edge); the sum of m_ij over the edges into node i changes h_i. This is
//            one pass; there are `passes` of them.
//   decode   outputs per node, linear in h_i; or one number, the mean of such outputs
//
// A message travels one edge with every pass, but a body in equilibrium responds everywhere at
// once. Therefore all nodes also share `patterns`, the leading proper orthogonal modes of the data.
// An amplitude measures how much of a pattern a field contains. The network computes the amplitudes
// of its first field, and of every other input with equally many components per node, in the
// patterns of the first field. The amplitudes pass through hidden layers. If the network gives one
// number, the output of the layers is added to it. If it gives rates, the output consists of
// amplitudes of each field's patterns, and the sum of these patterns is added to the field's rate.
//
// A network may have a driver, a field f such as the external forces. The outputs are then linear
// in f and vanish without it. Messages of a second kind carry numbers g_i of node i, which start as
// f times learned functions of the place. They pass through gates that depend on h at both ends and
// on the edge:
//     g_i  +=  U sum_j gate(h_i, h_j, edge) * (W g_j).
// The rates are linear in g_i and in gate(h_i) * g_i. The patterns are added with amplitudes that
// are linear in two kinds of numbers: the work of f on each pattern, and products of a component of
// f and one of the first field, summed over the nodes with learned functions of the place as
// weights. These numbers enter directly, and in combinations that are multiplied by the output of
// the hidden layers.
//
// In all functions `spec` has a message (spec.h), `symbols` are the groups that it may read, and
// parameters are named "<prefix>.<...>". Declaring checks the spec and adds the parameters; it
// fails with PM_ECONFIG if a feature is not a field on the mesh, if a setting would have no effect,
// or if the network is too large, and with PM_ENOMEM. Building returns a node of g.
#ifndef PM_MODEL_MESH_MESSAGE_H
#define PM_MODEL_MESH_MESSAGE_H

#include "model/network.h"

// Fields: groups that have one or more components at each node of the mesh. Borrowed.
typedef struct pm_fields {
    int count;
    const char *const *name; // [count]
} pm_fields;

// Declares a network that gives the rates of the fields `out`; its patterns are those of these
// fields. The first of them must be the first input of the network, and the driver must not be an
// input.
pm_status pm_message_declare_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                    pm_fields out, pm_params *params, const char *prefix);
// Returns the rates [1][components of all fields], per second.
pm_node pm_message_build_fields(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                pm_fields out, const pm_params *params, const char *prefix);
// Calls `visit` for the constants that training fixes from the data: the scales of fields, and the
// patterns. Passes on the status of `visit`.
pm_status pm_message_visit_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                  pm_fields out, const char *prefix, pm_normaliser_visit *visit,
                                  void *context);

// Declare and build a network that gives one number [1][1]. The number is multiplied by the square
// of a constant that training fixes: the root mean square of the first input over the training
// data.
pm_status pm_message_declare_sum(const pm_network_spec *spec, const pm_symbols *symbols,
                                 pm_params *params, const char *prefix);
pm_node pm_message_build_sum(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                             const pm_params *params, const char *prefix);

// Declare and build a network that gives `nout` numbers per node [nnode][nout], without patterns.
pm_status pm_message_declare_nodes(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                                   pm_params *params, const char *prefix);
pm_node pm_message_build_nodes(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                               int nout, const pm_params *params, const char *prefix);

// Calls `visit` for the constants of a network that gives one number, or numbers per node. Passes
// on the status of `visit`.
pm_status pm_message_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

#endif

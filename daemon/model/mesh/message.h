// Networks on the graph of a mesh, as encode, process, decode (Battaglia et al. 2018; with GENERIC
// operators Hernandez, Badias, Chinesta, Cueto, Comput. Mech. 72, 2023):
//
//   encode   h_i = tanh(fields of node i, and where i is)
//   process  m_ij = tanh(h_i, h_j, direction of the edge, difference of the first field), summed
//            over the edges into each node, changes h; `passes` times
//   decode   outputs per node: linear in h_i; or one number: the mean of such outputs
//
// Messages reach as far as there are passes, but a body in equilibrium answers everywhere at once.
// So all nodes also meet in `patterns` of a field, the leading ones of the data (proper orthogonal
// decomposition): the amplitudes of the fields in those of the first, as far as they have as many
// components as it, go through the hidden layers, whose output adds to the number, or to the rates
// as patterns again.
//
// With a driver, a field f such as the forces of the world, outputs are proportional to f: messages
// of a second kind carry g, at first f times functions of the place, through gates that are
// functions of the h at both ends and of the edge,
//     g_i  +=  U sum_j gate(h_i, h_j, edge) * (W g_j),
// and rates are linear in g_i and in gate(h_i) * g_i. In patterns nodes meet with the work of f on
// each, and with products of the components of f and of the first field, summed over the nodes with
// functions of the place as weights; these enter as they are, and combined and multiplied by
// functions of the amplitudes. Without a driving field the outputs vanish.
#ifndef PM_MODEL_MESH_MESSAGE_H
#define PM_MODEL_MESH_MESSAGE_H

#include "model/network.h"

// Fields: named groups of one component or more per node of the mesh.
typedef struct pm_fields {
    int count;
    const char *const *name;
} pm_fields;

// A network whose outputs are fields `out` (rates of these), whose patterns are theirs; the first
// of them must be the network's first input. PM_ECONFIG: also, what the network would ignore, or a
// driver that is one of its inputs; PM_ENOMEM.
pm_status pm_message_declare_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                    pm_fields out, pm_params *params, const char *prefix);
// The rates [1][components of all fields], per second.
pm_node pm_message_build_fields(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                pm_fields out, const pm_params *params, const char *prefix);
pm_status pm_message_visit_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                  pm_fields out, const char *prefix, pm_normaliser_visit *visit,
                                  void *context);

// A network whose output is one number [1][1], in units of the squared length of its first input.
pm_status pm_message_declare_sum(const pm_network_spec *spec, const pm_symbols *symbols,
                                 pm_params *params, const char *prefix);
pm_node pm_message_build_sum(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                             const pm_params *params, const char *prefix);

// A network with `nout` outputs per node [nnode][nout], without patterns.
pm_status pm_message_declare_nodes(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                                   pm_params *params, const char *prefix);
pm_node pm_message_build_nodes(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                               int nout, const pm_params *params, const char *prefix);

// For the latter two.
pm_status pm_message_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

#endif

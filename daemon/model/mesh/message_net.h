// A network on a mesh while its graph is built. Only the three files that implement message.h
// include this header: message_net.c encodes and processes, message_decode.c decodes, message.c
// checks and declares. Each calls only functions of the files named before it.
#ifndef PM_MODEL_MESH_MESSAGE_NET_H
#define PM_MODEL_MESH_MESSAGE_NET_H

#include "model/mesh/message.h"

// The initial gain of messages. The sum over six neighbours is then about as large as the value to
// which it is added.
#define PM_MESSAGE_GATHER_GAIN 0.4

typedef char pm_message_name[160]; // of a parameter

typedef struct pm_message_net {
    pm_graph *g;
    const pm_network_spec *spec;
    const pm_mesh *mesh;
    int width;          // of the hidden states
    const char *prefix; // of all parameter names
    const pm_params *params;
    pm_params *declaring; // receives new parameters; NULL: all of them exist
    pm_status status;     // of declaring; after a failure nothing more is declared
    const pm_symbols *symbols;
    pm_node where;                  // [nnode][width] learned features of each node's place
    pm_node field[PM_MAX_FEATURES]; // [nnode][components] input fields, scaled to rms 1
    pm_node h;                      // [nnode][width] hidden states
    pm_node hidden; // [1][..] hidden layer on the amplitudes of patterns; PM_NO_NODE: no patterns
} pm_message_net;

// The shape of a parameter, and the standard deviation of its initial values if it is trained.
typedef struct pm_message_shape {
    int rows, cols;
    bool trained;
    double spread;
} pm_message_shape;

// Starts a network on the graph g: encodes the fields and runs all message passes, so that h holds
// the final hidden states. With `declaring` not NULL all parameters are added to it.
pm_message_net pm_message_begin(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                const pm_params *params, const char *prefix, pm_params *declaring);

// Returns the parameter "<prefix>.<name>". While the network is being declared, declares it first.
pm_node pm_message_parameter(pm_message_net *n, const char *name, pm_message_shape s);
// Returns x [rows][..] times a trained matrix with `nout` columns. Initially the results are about
// `gain` times as large as x.
pm_node pm_message_linear(pm_message_net *n, const char *name, pm_node x, int nout, double gain);
// Returns x plus a trained bias.
pm_node pm_message_bias(pm_message_net *n, const char *name, pm_node x);
// Writes "<stage><pass>.<name>" to the buffer and returns it.
const char *pm_message_join(pm_message_name buffer, const char *stage, int pass, const char *name);

// Returns the size of the group `name` over all nodes: nnode times its components at a node. The
// declaring functions of message.h have checked the name.
int pm_message_field_size(const pm_symbols *symbols, const char *name);
// Returns field number `which`, the group `name`, as a matrix [nnode][components], divided by the
// root mean square of its components.
pm_node pm_message_field(pm_message_net *n, int which, const char *name);

// Returns one row per edge [nedge][cols]: `at_source` of its source plus `at_target` of its target
// plus learned features of its direction.
pm_node pm_message_gather(pm_message_net *n, const char *stage, int pass, pm_node at_source,
                          pm_node at_target);
// Returns the sum of the messages [nedge][cols] into each node, [nnode][cols].
pm_node pm_message_scatter(pm_message_net *n, pm_node messages);

// Decode the hidden states: rates of the fields `out` [1][components of all], per second; one
// number [1][1]; `nout` numbers per node [nnode][nout].
pm_node pm_message_decode_fields(pm_message_net *n, pm_fields out);
pm_node pm_message_decode_sum(pm_message_net *n);
pm_node pm_message_decode_nodes(pm_message_net *n, int nout);

#endif

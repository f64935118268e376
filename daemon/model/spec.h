// What a learned component is made of, as plain data: the layout of a state and the choice of
// potentials, operators and networks. Read from the `model:` block of a training file and from a
// weights file (scene/model_reader.h writes and reads the same text in both); turned into graphs by
// part.h and port.h. Everything lives in an arena the reader of the block owns.
#ifndef PM_MODEL_SPEC_H
#define PM_MODEL_SPEC_H

#include <stdbool.h>

#include "base/status.h"
#include "model/mesh/mesh.h"

// --- layout of a state ---

#define PM_MAX_GROUPS 16
#define PM_MAX_FEATURES 32
#define PM_MAX_DERIVED 16
#define PM_MAX_LEARNED 32 // constants of one model
#define PM_MAX_EXPONENTIALS 8
#define PM_DEFAULT_EXPONENTIALS 2
#define PM_DEFAULT_TEMPERATURE 300.0 // K

// A named group of components that belong together: a vector (position, momentum) or a scalar.
typedef struct pm_group {
    const char *name; // identifier, e.g. "q"
    const char *unit; // e.g. "kg m/s"
    int size;         // components
    int first;        // of its first component in the state
} pm_group;

typedef struct pm_layout {
    int ngroup;
    pm_group group[PM_MAX_GROUPS];
    int nz; // components in all
} pm_layout;

// The group called `name`, or NULL.
const pm_group *pm_layout_find(const pm_layout *layout, const char *name);
// Same name, unit and size.
bool pm_group_equal(const pm_group *a, const pm_group *b);
// Same groups, names, units and sizes in the same order.
bool pm_layout_equal(const pm_layout *a, const pm_layout *b);

// --- where a spec was read ---

// A member `at` is the place, "file:line:column", where something stands that may prove wrong once
// the layout is known; NULL: not read from a file. This puts it in front of the description of a
// failure with PM_ECONFIG, and returns `status`.
pm_status pm_spec_locate(const char *at, pm_status status);

// --- formulas ---

// A number that is known, or learned from where it starts; a positive one stays so.
typedef enum pm_constant_kind {
    PM_CONSTANT_KNOWN,
    PM_CONSTANT_LEARNED,
    PM_CONSTANT_POSITIVE
} pm_constant_kind;

// Named numbers.
typedef struct pm_constants {
    int count;
    const char *const *name;
    const double *value;
    const pm_constant_kind *learned; // NULL: all are known
} pm_constants;

// A known expression of named groups and constants (formula.h).
typedef struct pm_formula {
    const char *text;              // NULL: none
    const pm_constants *constants; // of its model; NULL: none
    const char *at;
} pm_formula;

// --- matrices and images ---

// A known matrix.
typedef struct pm_matrix_spec {
    int rows, cols;
    bool identity;       // of whatever size; no numbers
    const double *value; // [rows][cols]; NULL: none, or kept in a weights file
    const char *at;
} pm_matrix_spec;

// Numbers that depend linearly on groups of a state, by name, for potentials to use as if they were
// a group: how far two surfaces are apart, say, where the state is in modes.
//     image = offset + matrix (the groups side by side)
typedef struct pm_derived_spec {
    const char *name;
    int size;
    int ngroup;
    const char *const *group;
    pm_matrix_spec matrix; // [size][sizes of the groups]
    const double *offset;  // [size]; NULL: zero, or kept in a weights file with the matrix
    const char *at;
} pm_derived_spec;

// --- networks ---

// The function after each hidden layer: tanh(x), ln(1 + exp(x)), x/(1 + exp(-x)).
typedef enum pm_activation { PM_TANH, PM_SOFTPLUS, PM_SILU } pm_activation;

// What is added to the hidden layers' output: nothing, a linear form of the normalised features, or
// a quadratic one. A good skip lets the hidden layers learn only what is left, and extrapolates.
typedef enum pm_skip { PM_SKIP_NONE, PM_SKIP_LINEAR, PM_SKIP_QUADRATIC } pm_skip;

// What a network on the graph of a mesh has beyond layers: message.h.
typedef struct pm_message_spec {
    const pm_mesh *mesh;
    int width;          // of what nodes and edges pass on
    int passes;         // of messages
    int patterns;       // in which all nodes answer together; 0: none
    const char *driver; // the field that its outputs are proportional to, or NULL
    double within;      // s: rates are what the network gives divided by this; of rates only
} pm_message_spec;

// A network from features to numbers. Features are expressions over named groups (feature.h):
// "q", "|q|", "ln|q|", "|p|^2", "<q,p>". No features: the network is a learned constant.
typedef struct pm_network_spec {
    const pm_message_spec *message; // NULL: features go straight into the layers; else they are
                                    // groups, each a field on the mesh's nodes
    int nfeature;
    const char *const *feature;
    int nhidden; // hidden layers; 0: the skip alone. On a mesh, of the patterns' amplitudes
    const int *hidden;
    pm_activation activation;
    pm_skip skip;
    bool zero_at_origin; // less its tangent at features of 0, where it is 0 and flat then: of
                         // energies
    int nthermal;        // the last features are entropies, in which the energy rises and is convex
                         // whatever the weights (thermal.h); 0: an energy without this property
    int exponentials;    // of a thermal energy
    double temperature;  // K, where the training of a thermal energy starts
    bool scaled;         // an energy that carries its unit as the parameter ".unit"
    double spread;       // of the values training starts from; 0: as usual. Not kept in weights
    const char *at;      // its features
} pm_network_spec;

// --- potentials and operators ---

// E or S: absent (no summand of any kind), or the sum of formulas, a known linear form (an entropy
// variable as S, a reference temperature times an entropy in E) and the outputs of its networks.
typedef struct pm_potential_spec {
    int nformula;
    const pm_formula *formula;
    int ngiven;
    const char *const *given;        // groups; the sum of each one's components ...
    const double *given_coefficient; // ... times this [ngiven]; NULL: all 1
    int nterm;
    const pm_network_spec *term;
    const char *at;
} pm_potential_spec;

// A known coupling between two groups, of coefficient c. Reversible, between groups of equal size:
//     rate_row += c e_col,  rate_col -= c e_row
// Irreversible, c >= 0: what moves in `row` takes or gives energy, and `col`, of one component,
// gives or takes it, so that c e_col is the coefficient of friction of a momentum `row`, and
// c e_row/e_col the conductivity between entropies `row` and `col`:
//     rate_row += c (eta_row - eta_col e_row/e_col),  rate_col -= rate_row . e_row/e_col
// Where neither takes up heat, which are then of equal size, friction by the difference of their
// flows, whose heat the operator's `heats` share, or where it names none all groups whose unit is
// J/K:
//     rate_row -= c (e_row - e_col),  rate_col += c (e_row - e_col)
// Components of groups are named "m[0]". A reversible pair of three components each may be a
// `cross` product (Lie-Poisson brackets of rotations), as of a rigid body [m, m, cross] and a top
// [m, g, cross]:
//     rate_row += z_col x e_col and, where row and col differ, rate_col += z_col x e_row
typedef struct pm_given_pair {
    const char *row, *col;
    bool cross;
    double coefficient;
    pm_formula formula; // if it has a text, the coefficient
} pm_given_pair;

// A skew operator (reversible: L) or a positive semi-definite one (irreversible: M), acting on the
// groups `acts_on`. Its matrix is U^T (C - C^T) U or U^T G G^T U in scaled coordinates, where a
// network gives C or G (of `rank` columns); a network on a mesh gives one for each node, of the
// node's components of the groups, and U is the identity. The frame U is
//   - without `along`: the identity, so C is a plain matrix (of any features);
//   - with `along`: for each vector group in acts_on one row per vector of `along` (expressions:
//     "q", "q/|q|", "q/|q|^2"), for each scalar group one row. With invariant features, rotating
//     the state then rotates the result.
// A reversible one between the ends of a port may act on groups of one end `against` groups of the
// other: C has rows for the former and columns for the latter, which drive each other as in a pair.
typedef struct pm_operator_spec {
    int ngiven;
    const pm_given_pair *given;
    bool learned;
    pm_network_spec network;
    int nacts;
    const char *const *acts_on;
    int nagainst; // reversible operators of ports
    const char *const *against;
    int nalong;
    const char *const *along;
    int rank;                 // irreversible operators; columns of the factor G
    int nheats;               // irreversible hard operators: the groups that take up the heat
    const char *const *heats; // (dissipation.h); none: a projection in the metric of all groups
    const char *at;
} pm_operator_spec;

// hard: degeneracy by projection, both laws hold whatever the weights. soft: degeneracy is a
// penalty. free: no structure at all, the rate is a network; a baseline.
typedef enum pm_form { PM_HARD, PM_SOFT, PM_FREE } pm_form;

// A subsystem: zdot_bulk = L dE + M dS; free: zdot_bulk = rate, and there is nothing else.
typedef struct pm_part_spec {
    pm_form form;
    const pm_constants *constants; // of all its formulas; NULL: none
    const pm_mesh *mesh;           // its networks may be on; NULL: none
    int nderived;
    const pm_derived_spec *derived; // of its state, for energy and entropy
    pm_potential_spec energy, entropy;
    pm_operator_spec reversible, irreversible;
    pm_network_spec rate; // free only
    const char *at;
} pm_part_spec;

// A port between ends a and b; groups are named "a.q", "b.s", co-energies "a.dE.s".
// bracket: reversible and irreversible act on the exposed groups of both ends.
// exchange (soft or free): the same block describes each end's own boundary term, with its own
// weights: potentials and operators, or a rate, over own groups "own.q" and the neighbour's
// "other.q".
// contact: a matrix from what a exposes to what b does, or the identity.
typedef struct pm_port_spec {
    const char *law;
    pm_form form;
    const pm_constants *constants;
    const pm_mesh *mesh;
    pm_potential_spec energy, entropy; // exchange only
    pm_operator_spec reversible, irreversible;
    pm_network_spec rate;  // exchange, free only
    pm_matrix_spec matrix; // contact only
    const char *at;
} pm_port_spec;

#endif

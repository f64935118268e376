// The specification of a learned component as plain data: the layout of its state, and its
// potentials, operators and networks. scene/model_reader.h reads it from the `model:` block of a
// training file, or from the copy of this block in a weights file; part.h and port.h make graphs of
// it. All pointers belong to the arena that the caller passed to the reader.
#ifndef PM_MODEL_SPEC_H
#define PM_MODEL_SPEC_H

#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"

// --- layout of a state ---

#define PM_MAX_GROUPS 16
#define PM_MAX_FEATURES 32
#define PM_MAX_DERIVED 16
#define PM_MAX_LEARNED 512 // learned constants of one model
#define PM_MAX_EXPONENTIALS 8
#define PM_DEFAULT_EXPONENTIALS 2
#define PM_DEFAULT_TEMPERATURE 300.0 // K

// The physical role of a group. It follows from the dimension of the unit alone: an entropy has the
// dimension of J/K, in whatever unit (kJ/K, eV/K). Nothing else decides which group is an entropy.
// A group that is shown by its co-energy has the role of its energy variable: if its unit has the
// dimension of K, it is an entropy.
typedef enum pm_role { PM_ROLE_OTHER, PM_ROLE_ENTROPY } pm_role;

// A group: named components that belong together, such as a vector (position, momentum) or a
// scalar.
typedef struct pm_group {
    const char *name; // identifier, e.g. "q"
    const char *unit; // e.g. "kg m/s"
    int size;         // components
    int first;        // position of its first component in the state
    pm_role role;
    // The state holds the co-energy dE/dx, which a sensor shows, in place of the energy variable x:
    // a velocity in place of a momentum, a temperature in place of an entropy (part.h).
    bool coenergy;
} pm_group;

// A list of at most PM_MAX_GROUPS groups. A copy of a layout refers to the same groups.
typedef struct pm_layout {
    int ngroup;
    pm_group *group; // [ngroup] belongs to the arena of the caller that made the layout
    int nz;          // components in all
} pm_layout;

// Appends a group behind the others of a layout, which has room for it, and sets its role. The
// layout borrows both texts.
void pm_layout_add(pm_layout *layout, const char *name, const char *unit, int size);
// Marks the last group of a layout as one that is shown by its co-energy, and renews its
// role, which then follows from the unit of the co-energy.
void pm_layout_mark_coenergy(pm_layout *layout);
// Returns the group called `name`, or NULL.
const pm_group *pm_layout_find(const pm_layout *layout, const char *name);
// Returns true if both have the same name, unit and size, and both or neither are co-energies.
bool pm_group_equal(const pm_group *a, const pm_group *b);
// Returns true if both have equal groups in the same order.
bool pm_layout_equal(const pm_layout *a, const pm_layout *b);
// Returns `digest` (base/digest.h) with the names, units and sizes of all groups folded in, and
// with which of them are co-energies.
uint64_t pm_layout_digest(const pm_layout *layout, uint64_t digest);

// --- where a spec was read ---

// Puts the place `at` in front of the error message if `status` is PM_ECONFIG, and returns
// `status`. `at` is a text "file:line:column", for errors that are found only when the layout is
// known; NULL: the spec was not read from a file. All members called `at` below are such places.
pm_status pm_spec_locate(const char *at, pm_status status);

// --- formulas ---

// A constant is known, or training changes it from its starting value; a positive one stays
// positive.
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
    const bool *shared;              // learned once for all components that name it; NULL: none is
    // A constant with a text is optional: what it multiplies may not be there at all. Without it
    // the constants that the text names mean nothing: "", or " NAME NAME ... ". NULL: the constant
    // is needed; no list: all are.
    const char *const *optional;
} pm_constants;

// A known expression of named groups and constants (formula.h).
typedef struct pm_formula {
    const char *text;              // NULL: none
    const pm_constants *constants; // that the text may name; NULL: none
    const char *at;
} pm_formula;

// --- matrices and derived variables ---

// A known matrix.
typedef struct pm_matrix_spec {
    int rows, cols;
    bool identity;       // the identity of any size; `value` is NULL
    const double *value; // [rows][cols]; NULL: none, or kept in a weights file
    const char *at;
} pm_matrix_spec;

// A derived variable: a named vector that depends linearly on groups of the state. Potentials name
// it like a group. An example is the opening between two surfaces, where the state consists of
// modes.
//     derived variable = offset + matrix (the groups side by side)
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

// The skip connection of a network adds to the output of the hidden layers nothing, a linear form
// of the normalised features, a linear and a quadratic form, or these with the third and fourth
// power of each feature. The hidden layers then learn only the remainder, and the network
// extrapolates better.
typedef enum pm_skip { PM_SKIP_NONE, PM_SKIP_LINEAR, PM_SKIP_QUADRATIC, PM_SKIP_QUARTIC } pm_skip;

// A network from features to numbers. Features are expressions over named groups (feature.h):
// "q", "|q|", "ln|q|", "|p|^2", "<q,p>". A network without features is a learned constant.
typedef struct pm_network_spec {
    int nfeature;
    const char *const *feature;
    int nhidden;       // hidden layers; 0: only the skip
    const int *hidden; // [nhidden] units
    pm_activation activation;
    pm_skip skip;
    bool zero_at_origin; // of energies: subtract the tangent at features of 0, so that value and
                         // slope vanish there
    // The number of features, the last ones, that are entropies. The energy is then thermal: it
    // rises with them and is convex in them for all weights (thermal.h). 0: it is not.
    int nthermal;
    int exponentials;   // of a thermal energy: number of summands
    bool separate;      // of a thermal energy: each component has summands of its own
    bool rising;        // of a thermal energy: heat capacities may rise with the temperature
    double temperature; // K, of a thermal energy: the temperature with which training starts
    bool scaled;        // the output is multiplied by the constant ".unit", which training fixes
    double spread;      // standard deviation of the initial values; 0: the default. Not in files
    const char *at;     // place of the features
} pm_network_spec;

// --- convex terms ---

typedef enum pm_convex_kind { PM_CONVEX_INERTIA, PM_CONVEX_CAPACITY } pm_convex_kind;

// A term of a co-energy that is convex for all weights (convex.h). An inertia is shared by all
// components of its groups, which are flows. A heat capacity belongs to each component of a group
// of temperatures alone.
typedef struct pm_convex_spec {
    pm_convex_kind kind;
    int ngroup;
    const char *const *group; // [ngroup] one of a capacity
    pm_network_spec network;  // of the entries of an inertia
    int nterm;                // of a capacity
    double first; // the known inertia of the first component, or capacity at the mean temperature
                  // in J/K; 0: it is learned as the rest is
    const char *at;
} pm_convex_spec;

// --- potentials and operators ---

// A potential, E or S: the sum of formulas, of a known linear form (such as an entropy variable in
// S, or a reference temperature times an entropy in E), and of the outputs of networks. Without any
// summand the potential does not exist.
typedef struct pm_potential_spec {
    int nformula;
    const pm_formula *formula;
    int ngiven;
    const char *const *given;        // [ngiven] groups, of which the components are summed up
    const double *given_coefficient; // [ngiven] factor of each sum; NULL: all 1
    int nterm;
    const pm_network_spec *term;
    int nconvex; // of a co-energy, which has formulas and these alone
    const pm_convex_spec *convex;
    const char *at;
} pm_potential_spec;

// A known coupling with coefficient c between two groups `row` and `col`, or between two
// components, which are named "m[0]". There are four kinds.
//
// A reversible pair couples groups of equal size:
//     rate_row += c e_col,  rate_col -= c e_row
// A reversible `cross` pair couples groups of three components, as the Lie-Poisson brackets of
// rotations do: a rigid body is [m, m, cross], a top has also [m, g, cross]:
//     rate_row += z_col x e_col  and, if row and col differ,  rate_col += z_col x e_row
// An irreversible pair, c >= 0, couples `row` to an entropy `col` of one component. The entropy
// takes up the energy that `row` loses:
//     r = c (eta_row - eta_col e_row/e_col),  rate_row += r,  rate_col -= r . e_row/e_col
// If S is the sum of the entropies and `row` is a momentum, this is friction with the coefficient
// c/e_col. If `row` is an entropy, it is the conduction of heat with the conductance c e_row/e_col.
// An irreversible pair of two groups of equal size, neither of which takes up heat, is friction by
// the difference of their co-energies, which are velocities if the groups are momenta:
//     rate_row -= c (e_row - e_col),  rate_col += c (e_row - e_col)
// The groups in the operator's `heats`, or all groups in J/K where it names none, take up the heat
// in equal parts.
// With a direction an irreversible pair acts along the vector a of its coefficients, as a chemical
// reaction does along its stoichiometric numbers, or friction along a direction that turns:
//     r = c (a . eta - eta_col a . e/e_col),  rate_k += a_k r,  rate_col -= r a . e/e_col
typedef struct pm_direction_term {
    const char *name; // of a variable of one component
    double coefficient;
    pm_formula formula; // replaces the coefficient if it has a text
} pm_direction_term;

typedef struct pm_given_pair {
    const char *row, *col; // row: the first name of a direction
    int ndirection;
    const pm_direction_term *direction; // [ndirection]; NULL: none
    bool cross;
    double coefficient;
    pm_formula formula; // replaces the coefficient if it has a text
} pm_given_pair;

// An operator: skew if it is reversible (L), positive semi-definite if it is irreversible (M). It
// is the sum of given pairs and of a learned matrix on the groups `acts_on`, which in scaled
// coordinates is U^T (C - C^T) U or U^T G G^T U. A network gives C, or G with `rank` columns. The
// frame U is
//   - without `along`: the identity; the network may have any features;
//   - with `along`: one row for each scalar group of acts_on, and for each vector group one row for
//     each vector of `along` ("q", "q/|q|", "q/|q|^2"). If the features are invariant, the result
//     rotates with the state.
// A reversible operator may act on some groups `against` others, which acts_on
// does not list: C has rows for `acts_on` and columns for `against`. The groups of the two lists
// drive each other like the two groups of a pair. In an irreversible operator what leaves group k
// of acts_on enters group k of `against`, and the difference of their co-energies drives it.
typedef struct pm_operator_spec {
    int ngiven;
    const pm_given_pair *given;
    bool learned;
    pm_network_spec network;
    int nacts;
    const char *const *acts_on;
    int nagainst; // in an irreversible operator, which needs `heats`, at most as many as acts_on
    const char *const *against;
    int nalong;
    const char *const *along;
    int rank; // columns of the factor G; only irreversible operators
    // [nheats] groups that take up the heat (dissipation.h); only irreversible operators of the
    // hard form. None: a projection shares the heat among all groups.
    int nheats;
    const char *const *heats;
    // With `heats`: a network with `rank` outputs, the logarithms of a further factor of each
    // process. NULL: none.
    const pm_network_spec *strength;
    const char *at;
} pm_operator_spec;

// In the hard form energy is conserved and entropy grows for all weights, by projection (equation
// (2)). In the soft form the loss has a penalty on violations of the degeneracy conditions L dS = 0
// and M dE = 0. In the free form the rate is a network without structure; it serves for comparison.
typedef enum pm_form { PM_HARD, PM_SOFT, PM_FREE } pm_form;

// A body of learned material on a mesh of bricks (solid/solid.h), always in balance with its load.
typedef struct pm_solid_spec {
    int nbranch;        // relaxing branches, 0 to PM_SOLID_MAX_BRANCHES
    int nunit;          // hidden units of each learned function, 0 to PM_SOLID_MAX_UNITS
    double temperature; // K, at which what the branches lose becomes entropy
} pm_solid_spec;

// A subsystem: zdot_bulk = L dE + M dS, equation (1). In the free form zdot_bulk = rate, and the
// spec has nothing else.
typedef struct pm_part_spec {
    pm_form form;
    const pm_constants *constants; // of all formulas; NULL: none
    const pm_solid_spec *solid;    // a solid, and then nothing else but the form; NULL: none
    int nderived;
    const pm_derived_spec *derived; // [nderived] that energy and entropy may name
    pm_potential_spec energy, entropy;
    pm_potential_spec coenergy; // of the groups that are shown by their co-energies (part.h)
    pm_operator_spec reversible, irreversible;
    pm_network_spec rate; // only in the free form
    const char *at;
} pm_part_spec;

// Says which ends of a port of the law `exchange` have a boundary term. The end of a boundary input
// needs no term, because the outside is prescribed.
typedef enum pm_term_ends { PM_BOTH_ENDS, PM_END_A_ALONE, PM_END_B_ALONE } pm_term_ends;

// A port between the ends a and b. Groups are named "a.q", "b.s", co-energies "a.dE.s".
//   bracket   The operators act on the exposed groups of both ends, equation (3).
//   exchange  Soft or free. The block describes a boundary term of equation (1), which each end has
//             with weights of its own: potentials and operators, or a rate. It names the groups of
//             its end "own.q" and those of the neighbour "other.q".
//   contact   A matrix, or the identity, maps the exposed components of a to those of b.
typedef struct pm_port_spec {
    const char *law;
    pm_form form;
    const pm_constants *constants;
    pm_potential_spec energy, entropy; // exchange only
    pm_operator_spec reversible, irreversible;
    pm_network_spec rate;  // exchange in the free form only
    pm_matrix_spec matrix; // contact only
    pm_term_ends ends;     // exchange only
    const char *at;
} pm_port_spec;

#endif

// The two operators of GENERIC, L (reversible, skew) and M (irreversible, positive semi-definite),
// and how the degeneracies are enforced. THE SECOND LAW IS ENFORCED HERE, in pm_operator_build.
//
// With the driving co-energy d and the normal n (L: d = dE, n = dS; M: d = dS, n = dE), both over
// the groups the operator touches, and the metric W = diag(scale^2) that makes their units
// comparable:
//     hard:  rate = P^T K P d,   P = 1 - n (W n)^T / (n . W n),   so n . rate = 0 for any weights
//     soft:  rate = K d,         and |K n|^2 is the penalty
// where K is skew (C - C^T in the frame, plus given pairs) or a sum of squares (G G^T in the
// frame). P is the projection of equation (2), orthogonal in scaled coordinates. It is applied
// twice, since the rounding error of the first pass is proportional to the part that the pass
// removes. Given irreversible pairs are degenerate by themselves and are added without projection.
// A learned irreversible operator that names the groups which take up its heat needs no projection
// either (dissipation.h).
#ifndef PM_MODEL_OPERATOR_H
#define PM_MODEL_OPERATOR_H

#include "model/formula.h"
#include "model/network.h"
#include "model/site.h"

typedef enum pm_operator_kind { PM_REVERSIBLE, PM_IRREVERSIBLE } pm_operator_kind;

// One operator of a component.
typedef struct pm_operator {
    const pm_operator_spec *spec;
    pm_operator_kind kind;
    pm_form form;
    const char *prefix; // of its parameters "<prefix>.scale", ".along", ".matrix.<...>", and with
                        // `heats` ".temperature", ".power", ".ratio_power", ".split",
                        // ".strength.<...>"
} pm_operator;

// Returns true if the operator has given pairs or a learned matrix.
bool pm_operator_exists(const pm_operator_spec *spec);

// Checks the spec against the site and declares the parameters. PM_ECONFIG, PM_ENOMEM.
pm_status pm_operator_declare(const pm_operator *op, const pm_site *site, pm_params *params);

// Returns the rate [1][site->n] of the operator, in the units of the groups per second, or
// PM_NO_NODE if there is no operator or no driving. driving, normal: [1][site->n]. If the normal is
// PM_NO_NODE the operator need not be degenerate, and is not projected. In the soft form the
// components of K n in scaled coordinates are appended to *degeneracy [1][...], which is PM_NO_NODE
// before the first ones.
pm_node pm_operator_build(pm_graph *g, const pm_operator *op, const pm_site *site,
                          const pm_params *params, pm_node driving, pm_node normal,
                          pm_node *degeneracy);

// Visits the constants that training fixes from the data: the scales, the lengths of `along`, and
// those of the networks. `driving` and `normal` are those of pm_operator_build. Passes on the
// status of `visit`.
pm_status pm_operator_visit(pm_graph *g, const pm_operator *op, const pm_site *site,
                            const pm_params *params, pm_node driving, pm_node normal,
                            pm_normaliser_visit *visit, void *context);

// Returns the number of rows that a group of this size has in the frame (spec.h): one for each
// vector of `along` if the group is a vector, else one for each component.
int pm_operator_frame_rows(const pm_operator_spec *spec, int group_size);

// Writes "<prefix>.<name>", the name of a parameter, to the buffer and returns it.
typedef char pm_operator_name[96];
const char *pm_operator_join(pm_operator_name buffer, const char *prefix, const char *name);

#endif

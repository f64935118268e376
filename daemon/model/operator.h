// The two operators of GENERIC, L (reversible, skew) and M (irreversible, positive semi-definite),
// and how the degeneracies are enforced. THE SECOND LAW IS ENFORCED HERE, in pm_operator_build.
//
// With the driving co-energy d and the normal n (L: d = dE, n = dS; M: d = dS, n = dE), both over
// the groups the operator touches, and the metric W = diag(scale^2) that makes their units
// comparable:
//     hard:  rate = P^T K P d,   P = 1 - n (W n)^T / (n . W n),   so n . rate = 0 for any weights
//     soft:  rate = K d,         and |K n|^2 is the penalty
// where K is skew (C - C^T in the frame, plus given pairs) or a sum of squares (G G^T in the
// frame). An irreversible pair that is given is degenerate as it stands (spec.h) and is added to
// that. P is equation (2) of the hard form, a projection orthogonal in scaled coordinates.
// A learned irreversible operator that names the groups which take up its heat is built by
// dissipation.h instead, and couplings that are known by given.h.
// The projection is applied twice, since the first pass leaves the rounding of what it takes away.
#ifndef PM_MODEL_OPERATOR_H
#define PM_MODEL_OPERATOR_H

#include "model/formula.h"
#include "model/network.h"
#include "model/support.h"

typedef enum pm_operator_kind { PM_REVERSIBLE, PM_IRREVERSIBLE } pm_operator_kind;

// One operator of a component.
typedef struct pm_operator {
    const pm_operator_spec *spec;
    pm_operator_kind kind;
    pm_form form;
    const char *prefix; // of its parameters: ".scale", ".along", ".matrix.<network>"
} pm_operator;

bool pm_operator_exists(const pm_operator_spec *spec);

// Checks the spec against the site and declares the parameters. PM_ECONFIG, PM_ENOMEM.
pm_status pm_operator_declare(const pm_operator *op, const pm_site *site, pm_params *params);

// The rate [1][site->n] it causes. driving, normal: [1][site->n]. A missing normal (PM_NO_NODE)
// asks for no degeneracy. PM_NO_NODE if there is no operator or nothing drives it. In the soft form
// *degeneracy gains |K n|^2 in scaled coordinates (it may start as PM_NO_NODE).
pm_node pm_operator_build(pm_graph *g, const pm_operator *op, const pm_site *site,
                          const pm_params *params, pm_node driving, pm_node normal,
                          pm_node *degeneracy);

pm_status pm_operator_visit(const pm_operator *op, const pm_site *site, pm_normaliser_visit *visit,
                            void *context);

#endif

// The port law `exchange`, the boundary terms of equation (1):
//     rate = -(L_boun dE_boun + M_boun dS_boun)
// Each end has potentials and operators of its own over its exposed groups ("own.q"). Their
// networks also read the groups and co-energies that the neighbour shows ("other.q", "other.dE.s").
// In the free form the rate is one network of all these. The fluxes of the two ends cancel only as
// well as the training makes them; the ledger reports the remainder.
#include "model/constants.h"
#include "model/port.h"
#include "model/potential.h"
#include "model/unstructured_rate.h"

// The boundary term of one end: the names of its parameters, and its operators.
typedef struct boundary {
    const char *energy, *entropy, *rate;
    pm_operator L, M;
} boundary;

static boundary boundary_of(const pm_port_model *port, pm_end own) {
    const bool a = own == PM_END_A;
    const pm_port_spec *spec = &port->spec;
    return (boundary){
        a ? "a.energy" : "b.energy",
        a ? "a.entropy" : "b.entropy",
        a ? "a.rate" : "b.rate",
        {&spec->reversible, PM_REVERSIBLE, PM_SOFT, a ? "a.reversible" : "b.reversible"},
        {&spec->irreversible, PM_IRREVERSIBLE, PM_SOFT, a ? "a.irreversible" : "b.irreversible"},
    };
}

static pm_site site_of(const pm_port_model *port, pm_graph *g, pm_end own,
                       const pm_port_nodes end[2]) {
    const pm_end other = own == PM_END_A ? PM_END_B : PM_END_A;
    const pm_layout *mine = &port->layout[own], *theirs = &port->layout[other];
    pm_site site = {0};
    pm_site_add(&site, mine, "own.", 0);
    pm_symbols_add(&site.symbols, g, mine, "own.", end[own].y);
    pm_symbols_add(&site.symbols, g, theirs, "other.", end[other].y);
    pm_symbols_add(&site.symbols, g, theirs, "other.dE.", end[other].e);
    pm_symbols_add(&site.symbols, g, theirs, "other.dS.", end[other].eta);
    pm_constants_add(port->spec.constants, g, &port->params, &site.symbols);
    return site;
}

// Returns true if this end has a boundary term.
static bool has_term(const pm_port_model *port, pm_end own) {
    return port->spec.ends != (own == PM_END_A ? PM_END_B_ALONE : PM_END_A_ALONE);
}

static pm_status check_form(const pm_port_spec *spec) {
    if (spec->form == PM_HARD) {
        return pm_fail(PM_ECONFIG, "law exchange cannot be hard: nothing in it makes the two ends' "
                                   "fluxes cancel; use law bracket, or form: soft");
    }
    if (spec->form == PM_FREE &&
        (pm_potential_exists(&spec->energy) || pm_potential_exists(&spec->entropy) ||
         pm_operator_exists(&spec->reversible) || pm_operator_exists(&spec->irreversible))) {
        return pm_fail(PM_ECONFIG, "form: free has a rate and nothing else: no energy, entropy, "
                                   "reversible or irreversible operator");
    }
    return PM_OK;
}

static pm_status declare(pm_port_model *port) {
    PM_TRY(pm_spec_locate(port->spec.at, check_form(&port->spec)));
    PM_TRY(
        pm_spec_locate(port->spec.at, pm_constants_declare(port->spec.constants, &port->params)));
    static const pm_port_nodes none[2] = {{PM_NO_NODE, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE},
                                          {PM_NO_NODE, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE}};
    for (int own = 0; own < 2; ++own) {
        const boundary b = boundary_of(port, (pm_end)own);
        const pm_site site = site_of(port, NULL, (pm_end)own, none);
        if (!has_term(port, (pm_end)own)) {
            continue;
        }
        if (port->spec.form == PM_FREE) {
            PM_TRY(pm_unstructured_rate_declare(&port->spec.rate, &site, &port->params, b.rate));
            continue;
        }
        PM_TRY(pm_potential_declare(&port->spec.energy, &site.symbols, &port->params, b.energy));
        PM_TRY(pm_potential_declare(&port->spec.entropy, &site.symbols, &port->params, b.entropy));
        PM_TRY(pm_operator_declare(&b.L, &site, &port->params));
        PM_TRY(pm_operator_declare(&b.M, &site, &port->params));
    }
    return PM_OK;
}

static pm_node rate(pm_graph *g, const pm_port_model *port, pm_end own, const pm_port_nodes end[2],
                    pm_node *degeneracy) {
    const boundary b = boundary_of(port, own);
    const pm_site site = site_of(port, g, own, end);
    const pm_params *params = &port->params;
    if (!has_term(port, own)) {
        return PM_NO_NODE;
    }
    if (port->spec.form == PM_FREE) {
        return pm_unstructured_rate_build(g, &port->spec.rate, &site, params, b.rate);
    }
    const pm_node E = pm_potential_build(g, &port->spec.energy, &site.symbols, params, b.energy);
    const pm_node S = pm_potential_build(g, &port->spec.entropy, &site.symbols, params, b.entropy);
    pm_node dE = PM_NO_NODE, dS = PM_NO_NODE;
    pm_gradient(g, E, PM_NO_NODE, 1, &end[own].y, &dE);
    pm_gradient(g, S, PM_NO_NODE, 1, &end[own].y, &dS);
    // Boundary operators need not be degenerate, so that they have no normal.
    const pm_node sum =
        pm_add_or(g, pm_operator_build(g, &b.L, &site, params, dE, PM_NO_NODE, degeneracy),
                  pm_operator_build(g, &b.M, &site, params, dS, PM_NO_NODE, degeneracy));
    return sum == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, sum, -1);
}

static pm_status visit(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2],
                       pm_normaliser_visit *visitor, void *context) {
    for (int own = 0; own < 2; ++own) {
        const boundary b = boundary_of(port, (pm_end)own);
        const pm_site site = site_of(port, g, (pm_end)own, end);
        const pm_symbols *symbols = &site.symbols;
        if (!has_term(port, (pm_end)own)) {
            continue;
        }
        if (port->spec.form == PM_FREE) {
            PM_TRY(pm_unstructured_rate_visit(&port->spec.rate, &site, b.rate, visitor, context));
            continue;
        }
        PM_TRY(pm_potential_visit(&port->spec.energy, symbols, b.energy, visitor, context));
        PM_TRY(pm_potential_visit(&port->spec.entropy, symbols, b.entropy, visitor, context));
        PM_TRY(pm_operator_visit(g, &b.L, &site, &port->params, PM_NO_NODE, PM_NO_NODE, visitor,
                                 context));
        PM_TRY(pm_operator_visit(g, &b.M, &site, &port->params, PM_NO_NODE, PM_NO_NODE, visitor,
                                 context));
    }
    return PM_OK;
}

const pm_port_law pm_law_exchange = {
    .name = "exchange",
    .has_ends = true,
    .declare = declare,
    .rate = rate,
    .visit = visit,
};

// The port law `bracket`, equation (3): one reversible and one irreversible operator over the
// exposed groups of both ends together. Each end evaluates both operators on the same numbers and
// takes its own components of the rate. In the hard form the energy fluxes cancel, and the sum of
// the entropy fluxes is a production >= 0.
#include "model/constants.h"
#include "model/operator.h"
#include "model/port.h"
#include "model/potential.h"

static const char *const prefix[2][3] = {{"a.", "a.dE.", "a.dS."}, {"b.", "b.dE.", "b.dS."}};

static pm_site site_of(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2]) {
    pm_site site = {0};
    for (int i = 0; i < 2; ++i) {
        const pm_layout *layout = &port->layout[i];
        pm_site_add(&site, layout, prefix[i][0], i);
        pm_symbols_add(&site.symbols, g, layout, prefix[i][0], end[i].y);
        pm_symbols_add(&site.symbols, g, layout, prefix[i][1], end[i].e);
        pm_symbols_add(&site.symbols, g, layout, prefix[i][2], end[i].eta);
    }
    pm_constants_add(port->spec.constants, g, &port->params, &site.symbols);
    return site;
}

static pm_operator reversible(const pm_port_model *port) {
    return (pm_operator){&port->spec.reversible, PM_REVERSIBLE, port->spec.form, "reversible"};
}

static pm_operator irreversible(const pm_port_model *port) {
    return (pm_operator){&port->spec.irreversible, PM_IRREVERSIBLE, port->spec.form,
                         "irreversible"};
}

static pm_status declare(pm_port_model *port) {
    const pm_port_spec *spec = &port->spec;
    if (spec->form == PM_FREE) {
        return pm_spec_locate(spec->at,
                              pm_fail(PM_ECONFIG, "law bracket cannot be free: it has a structure; "
                                                  "use law exchange"));
    }
    if (pm_potential_exists(&spec->energy) || pm_potential_exists(&spec->entropy)) {
        return pm_spec_locate(
            spec->at, pm_fail(PM_ECONFIG, "a bracket port stores no energy: energy and entropy "
                                          "belong to law exchange, or into the subsystems"));
    }
    static const pm_port_nodes none[2] = {{PM_NO_NODE, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE},
                                          {PM_NO_NODE, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE}};
    const pm_site site = site_of(port, NULL, none);
    const pm_operator L = reversible(port), M = irreversible(port);
    PM_TRY(
        pm_spec_locate(port->spec.at, pm_constants_declare(port->spec.constants, &port->params)));
    PM_TRY(pm_operator_declare(&L, &site, &port->params));
    return pm_operator_declare(&M, &site, &port->params);
}

// Returns the co-vectors of both ends side by side, with zeros for an end that has none.
static pm_node both_ends(pm_graph *g, const pm_port_model *port, pm_node a, pm_node b) {
    if (a == PM_NO_NODE && b == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    const pm_node part[2] = {
        a != PM_NO_NODE ? a : pm_constant(g, 0, 1, port->layout[0].nz),
        b != PM_NO_NODE ? b : pm_constant(g, 0, 1, port->layout[1].nz),
    };
    return pm_concat(g, 2, part);
}

// Returns the rate of both ends from one operator: e drives L, and eta drives M.
static pm_node build(pm_graph *g, const pm_port_model *port, const pm_operator *op,
                     const pm_port_nodes end[2], pm_node *degeneracy) {
    const pm_site site = site_of(port, g, end);
    const pm_node e = both_ends(g, port, end[0].e, end[1].e);
    const pm_node eta = both_ends(g, port, end[0].eta, end[1].eta);
    return op->kind == PM_REVERSIBLE
               ? pm_operator_build(g, op, &site, &port->params, e, eta, degeneracy)
               : pm_operator_build(g, op, &site, &port->params, eta, e, degeneracy);
}

static pm_node rate(pm_graph *g, const pm_port_model *port, pm_end own, const pm_port_nodes end[2],
                    pm_node *degeneracy) {
    const pm_operator L = reversible(port), M = irreversible(port);
    pm_node residual = PM_NO_NODE;
    const pm_node from_energy = build(g, port, &L, end, &residual);
    const pm_node sum = pm_add_or(g, from_energy, build(g, port, &M, end, &residual));
    // Both ends build the same residuals. They count once.
    if (own == PM_END_A) {
        *degeneracy = pm_concat_or(g, *degeneracy, residual);
    }
    return sum == PM_NO_NODE
               ? PM_NO_NODE
               : pm_slice(g, sum, own == PM_END_A ? 0 : port->layout[0].nz, port->layout[own].nz);
}

static pm_node irreversible_rate(pm_graph *g, const pm_port_model *port,
                                 const pm_port_nodes end[2]) {
    const pm_operator M = irreversible(port);
    pm_node counted_in_rate = PM_NO_NODE;
    return build(g, port, &M, end, &counted_in_rate);
}

static pm_status visit(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2],
                       pm_normaliser_visit *visitor, void *context) {
    const pm_site site = site_of(port, g, end);
    const pm_operator L = reversible(port), M = irreversible(port);
    const pm_node e = both_ends(g, port, end[0].e, end[1].e);
    const pm_node eta = both_ends(g, port, end[0].eta, end[1].eta);
    PM_TRY(pm_operator_visit(g, &L, &site, &port->params, e, eta, visitor, context));
    return pm_operator_visit(g, &M, &site, &port->params, eta, e, visitor, context);
}

const pm_port_law pm_law_bracket = {
    .name = "bracket",
    .conservative = true,
    .declare = declare,
    .rate = rate,
    .irreversible = irreversible_rate,
    .visit = visit,
};

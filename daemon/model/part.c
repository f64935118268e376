// E, S and the bulk term of a subsystem, built from potentials and operators.
#include "model/part.h"

#include "model/constants.h"
#include "model/derived.h"
#include "model/potential.h"
#include "model/solid/material.h"
#include "model/unstructured_rate.h"

// Returns the site of the state: its groups, and the symbols of groups and co-energies, which are
// called "dE.<group>" and "dS.<group>".
static pm_site site_of(const pm_part *part, pm_graph *g, pm_node z, pm_node dE, pm_node dS) {
    pm_site site = {0};
    pm_site_add(&site, &part->layout, "", 0);
    pm_symbols_add(&site.symbols, g, &part->layout, "", z);
    pm_symbols_add(&site.symbols, g, &part->layout, "dE.", dE);
    pm_symbols_add(&site.symbols, g, &part->layout, "dS.", dS);
    pm_constants_add(part->spec.constants, g, &part->params, &site.symbols);
    return site;
}

pm_symbols pm_part_symbols(const pm_part *part, pm_graph *g, pm_node z) {
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, g, &part->layout, "", z);
    pm_derived_add(part, g, &symbols);
    pm_constants_add(part->spec.constants, g, &part->params, &symbols);
    return symbols;
}

static pm_operator reversible(const pm_part *part) {
    return (pm_operator){&part->spec.reversible, PM_REVERSIBLE, part->spec.form, "reversible"};
}

static pm_operator irreversible(const pm_part *part) {
    return (pm_operator){&part->spec.irreversible, PM_IRREVERSIBLE, part->spec.form,
                         "irreversible"};
}

static pm_status check_free(const pm_part_spec *spec) {
    if (spec->nderived > 0 || pm_potential_exists(&spec->energy) ||
        pm_potential_exists(&spec->entropy) || pm_operator_exists(&spec->reversible) ||
        pm_operator_exists(&spec->irreversible)) {
        return pm_fail(PM_ECONFIG,
                       "form: free has a rate and nothing else: no derived variables, energy, "
                       "entropy, reversible or irreversible operator");
    }
    return PM_OK;
}

static pm_status check_solid(const pm_part_spec *spec) {
    if (spec->form != PM_HARD || spec->nderived > 0 || pm_potential_exists(&spec->energy) ||
        pm_potential_exists(&spec->entropy) || pm_operator_exists(&spec->reversible) ||
        pm_operator_exists(&spec->irreversible)) {
        return pm_fail(PM_ECONFIG, "a solid is hard, and has no energy, entropy, operators or "
                                   "derived variables beside it");
    }
    return PM_OK;
}

static pm_status check_spec(const pm_part_spec *spec) {
    if (spec->solid != NULL) {
        return check_solid(spec);
    }
    if (spec->form == PM_FREE) {
        return check_free(spec);
    }
    if (!pm_potential_exists(&spec->energy)) {
        return pm_fail(PM_ECONFIG, "a subsystem needs an energy");
    }
    if (pm_operator_exists(&spec->irreversible) && !pm_potential_exists(&spec->entropy)) {
        return pm_fail(PM_ECONFIG, "an irreversible operator needs an entropy");
    }
    return PM_OK;
}

pm_status pm_part_declare(pm_part *part) {
    PM_TRY(pm_spec_locate(part->spec.at, check_spec(&part->spec)));
    if (part->spec.solid != NULL) {
        return pm_solid_material_declare(part->spec.solid, &part->params);
    }
    const pm_site site = site_of(part, NULL, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE);
    if (part->spec.form == PM_FREE) {
        return pm_unstructured_rate_declare(&part->spec.rate, &site, &part->params, "rate");
    }
    PM_TRY(pm_derived_declare(part));
    PM_TRY(
        pm_spec_locate(part->spec.at, pm_constants_declare(part->spec.constants, &part->params)));
    const pm_symbols symbols = pm_part_symbols(part, NULL, PM_NO_NODE);
    PM_TRY(pm_potential_declare(&part->spec.energy, &symbols, &part->params, "energy"));
    PM_TRY(pm_potential_declare(&part->spec.entropy, &symbols, &part->params, "entropy"));
    const pm_operator L = reversible(part), M = irreversible(part);
    PM_TRY(pm_operator_declare(&L, &site, &part->params));
    return pm_operator_declare(&M, &site, &part->params);
}

void pm_part_free(pm_part *part) {
    pm_params_free(&part->params);
}

bool pm_part_has_energy(const pm_part *part) {
    return part->spec.form != PM_FREE;
}

bool pm_part_has_entropy(const pm_part *part) {
    return part->spec.solid != NULL || pm_potential_exists(&part->spec.entropy);
}

bool pm_part_depends(const pm_part *part, const pm_potential_spec *potential, const char *group) {
    bool depends = pm_potential_mentions(potential, group);
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        depends = depends || (pm_derived_is_of(derived, group) &&
                              pm_potential_mentions(potential, derived->name));
    }
    return depends;
}

pm_node pm_part_energy(pm_graph *g, const pm_part *part, pm_node z) {
    if (!pm_part_has_energy(part)) {
        return pm_constant(g, 0, 1, 1);
    }
    const pm_symbols symbols = pm_part_symbols(part, g, z);
    return pm_potential_build(g, &part->spec.energy, &symbols, &part->params, "energy");
}

pm_node pm_part_entropy(pm_graph *g, const pm_part *part, pm_node z) {
    const pm_symbols symbols = pm_part_symbols(part, g, z);
    return pm_potential_build(g, &part->spec.entropy, &symbols, &part->params, "entropy");
}

bool pm_part_is_discrete(const pm_part *part) {
    if (part->spec.solid != NULL) {
        return true;
    }
    return pm_potential_is_discrete(&part->spec.energy) &&
           pm_potential_is_discrete(&part->spec.entropy);
}

static pm_node discrete(pm_graph *g, const pm_part *part, const pm_potential_spec *spec,
                        const char *prefix, pm_node z_from, pm_node z_to) {
    const pm_symbols from = pm_part_symbols(part, g, z_from), to = pm_part_symbols(part, g, z_to);
    pm_node covector[PM_MAX_SYMBOLS];
    for (int i = 0; i < from.count; ++i) {
        covector[i] = PM_NO_NODE;
    }
    pm_potential_discrete(g, spec, &from, &to, &part->params, prefix, covector);
    pm_derived_pull(part, g, covector);
    pm_node sum = PM_NO_NODE;
    for (int i = 0; i < part->layout.ngroup; ++i) {
        if (covector[i] != PM_NO_NODE) {
            const int first = part->layout.group[i].first;
            sum = pm_add_or(g, sum, pm_place(g, covector[i], first, part->layout.nz));
        }
    }
    return sum;
}

void pm_part_coenergies(pm_graph *g, const pm_part *part, pm_node z_from, pm_node z_to, pm_node *dE,
                        pm_node *dS) {
    if (z_from != PM_NO_NODE) {
        *dE = discrete(g, part, &part->spec.energy, "energy", z_from, z_to);
        *dS = discrete(g, part, &part->spec.entropy, "entropy", z_from, z_to);
        return;
    }
    pm_gradient(g, pm_part_energy(g, part, z_to), PM_NO_NODE, 1, &z_to, dE);
    pm_gradient(g, pm_part_entropy(g, part, z_to), PM_NO_NODE, 1, &z_to, dS);
}

pm_node pm_part_response(pm_graph *g, const pm_part *part, pm_node dE, pm_node z_to,
                         const bool *wanted) {
    const int nz = part->layout.nz;
    pm_node diagonal = PM_NO_NODE;
    for (int c = 0; c < nz && dE != PM_NO_NODE; ++c) {
        pm_node row = PM_NO_NODE;
        if (wanted[c]) {
            pm_gradient(g, pm_slice(g, dE, c, 1), PM_NO_NODE, 1, &z_to, &row);
        }
        if (row != PM_NO_NODE) {
            diagonal = pm_add_or(g, diagonal, pm_place(g, pm_slice(g, row, c, 1), c, nz));
        }
    }
    return diagonal;
}

pm_node pm_part_bulk(pm_graph *g, const pm_part *part, pm_node z, pm_node dE, pm_node dS,
                     pm_node *degeneracy) {
    const pm_site site = site_of(part, g, z, dE, dS);
    if (part->spec.form == PM_FREE) {
        return pm_unstructured_rate_build(g, &part->spec.rate, &site, &part->params, "rate");
    }
    const pm_operator L = reversible(part), M = irreversible(part);
    const pm_node from_energy = pm_operator_build(g, &L, &site, &part->params, dE, dS, degeneracy);
    const pm_node from_entropy = pm_operator_build(g, &M, &site, &part->params, dS, dE, degeneracy);
    return pm_add_or(g, from_energy, from_entropy);
}

pm_status pm_part_visit(const pm_part *part, pm_graph *g, pm_node z, pm_node dE, pm_node dS,
                        pm_normaliser_visit *visit, void *context) {
    const pm_site site = site_of(part, g, z, dE, dS);
    if (part->spec.form == PM_FREE) {
        return pm_unstructured_rate_visit(&part->spec.rate, &site, "rate", visit, context);
    }
    const pm_operator L = reversible(part), M = irreversible(part);
    PM_TRY(pm_potential_visit(&part->spec.energy, &site.symbols, "energy", visit, context));
    PM_TRY(pm_potential_visit(&part->spec.entropy, &site.symbols, "entropy", visit, context));
    PM_TRY(pm_operator_visit(&L, &site, visit, context));
    return pm_operator_visit(&M, &site, visit, context);
}

// E, S and the bulk term of a subsystem, built from potentials and operators; derived variables.
#include "model/part.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model/constants.h"
#include "model/potential.h"
#include "model/solid/material.h"
#include "model/unstructured_rate.h"

#define MOST_DERIVED_NUMBERS 10000000 // of a matrix, which then takes 80 MB
#define MOST_COUPLED 16               // components of co-energies that C may couple

// --- derived variables ---
//
// Matrix and offset of a derived variable are the parameters "derived.<name>.matrix" and
// "derived.<name>.offset".

typedef char entry_name[PM_MAX_NAME + 16];

static const pm_param_entry *entry_of(const pm_params *params, const pm_derived_spec *derived,
                                      const char *what) {
    entry_name name;
    snprintf(name, sizeof name, "derived.%s.%s", derived->name, what);
    return pm_params_find(params, name);
}

static pm_node node_of(pm_graph *g, const pm_params *params, const pm_derived_spec *derived,
                       const char *what) {
    const pm_param_entry *entry = entry_of(params, derived, what);
    return pm_param(g, entry->value, entry->rows, entry->cols);
}

// Checks names, groups and sizes of a derived variable and declares its parameters.
static pm_status declare_derived(pm_part *part, int i) {
    const pm_derived_spec *derived = &part->spec.derived[i];
    const pm_matrix_spec *matrix = &derived->matrix;
    bool taken = pm_layout_find(&part->layout, derived->name) != NULL;
    for (int k = 0; k < i; ++k) {
        taken = taken || strcmp(part->spec.derived[k].name, derived->name) == 0;
    }
    if (taken || strlen(derived->name) >= PM_MAX_NAME) {
        return pm_fail(PM_ECONFIG, "derived variable %.64s: its name is %s", derived->name,
                       taken ? "that of a group, or of another one" : "too long");
    }
    int cols = 0;
    for (int k = 0; k < derived->ngroup; ++k) {
        const pm_group *group = pm_layout_find(&part->layout, derived->group[k]);
        if (group == NULL) {
            return pm_fail(PM_ECONFIG, "derived variable %s: the state has no group \"%s\"",
                           derived->name, derived->group[k]);
        }
        cols += group->size;
    }
    if (cols == 0 || derived->size > MOST_DERIVED_NUMBERS / cols) {
        return pm_fail(PM_ECONFIG,
                       "derived variable %s: a matrix of %d x %d, expected 1 to %d numbers",
                       derived->name, derived->size, cols, MOST_DERIVED_NUMBERS);
    }
    if (matrix->value != NULL && (matrix->rows != derived->size || matrix->cols != cols)) {
        return pm_fail(PM_ECONFIG, "derived variable %s: the matrix is %d x %d, expected %d x %d",
                       derived->name, matrix->rows, matrix->cols, derived->size, cols);
    }
    entry_name name;
    const bool kept = matrix->value == NULL;
    snprintf(name, sizeof name, "derived.%s.matrix", derived->name);
    PM_TRY(pm_params_add(&part->params, name, derived->size, cols, false, 0, NAN));
    snprintf(name, sizeof name, "derived.%s.offset", derived->name);
    PM_TRY(pm_params_add(&part->params, name, 1, derived->size, false, 0, kept ? NAN : 0));
    if (!kept) {
        memcpy(entry_of(&part->params, derived, "matrix")->value, matrix->value,
               (size_t)derived->size * (size_t)cols * sizeof(double));
    }
    if (derived->offset != NULL) {
        memcpy(entry_of(&part->params, derived, "offset")->value, derived->offset,
               (size_t)derived->size * sizeof(double));
    }
    return PM_OK;
}

// Returns the groups of a derived variable side by side.
static pm_node join(pm_graph *g, const pm_derived_spec *derived, const pm_symbols *symbols) {
    pm_node part[PM_MAX_GROUPS];
    for (int i = 0; i < derived->ngroup; ++i) {
        int k = 0;
        while (strcmp(symbols->symbol[k].name, derived->group[i]) != 0) {
            ++k;
            assert(k < symbols->count);
        }
        part[i] = symbols->symbol[k].node;
    }
    return pm_concat(g, derived->ngroup, part);
}

// Applies the chain rule: adds the covector of each derived variable, multiplied by the transposed
// matrix, to the covectors of its groups. `covector` holds one node per group, then one per derived
// variable.
static void pull_derived(const pm_part *part, pm_graph *g, pm_node *covector) {
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        const pm_node own = covector[part->layout.ngroup + i];
        if (own == PM_NO_NODE) {
            continue;
        }
        const pm_node all =
            pm_matmul(g, own, false, node_of(g, &part->params, derived, "matrix"), false);
        int first = 0;
        for (int k = 0; k < derived->ngroup; ++k) {
            const pm_group *group = pm_layout_find(&part->layout, derived->group[k]);
            pm_node *sum = &covector[group - part->layout.group];
            *sum = pm_add_or(g, *sum, pm_slice(g, all, first, group->size));
            first += group->size;
        }
    }
}

void pm_part_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols, pm_node *radius) {
    const int ngroup = part->layout.ngroup;
    for (int i = 0; i < ngroup; ++i) {
        if (radius[i] != PM_NO_NODE) {
            const pm_node size = pm_magnitude(g, symbols->symbol[i].node);
            radius[i] = pm_add(g, radius[i], pm_scale(g, size, PM_PART_ROUNDING));
        }
    }
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        // The radii of its groups, zero where a group does not move.
        pm_node side[PM_MAX_GROUPS];
        bool any = false;
        for (int k = 0; k < derived->ngroup; ++k) {
            const pm_group *group = pm_layout_find(&part->layout, derived->group[k]);
            const pm_node own = radius[group - part->layout.group];
            side[k] = own == PM_NO_NODE ? pm_constant(g, 0, 1, group->size) : own;
            any = any || own != PM_NO_NODE;
        }
        // PM_NO_NODE if none of them moves.
        const pm_node moves = any ? pm_concat(g, derived->ngroup, side) : PM_NO_NODE;
        radius[ngroup + i] = PM_NO_NODE;
        if (moves != PM_NO_NODE) {
            const pm_node values = pm_magnitude(g, join(g, derived, symbols));
            const pm_node matrix = pm_magnitude(g, node_of(g, &part->params, derived, "matrix"));
            const pm_node offset = pm_magnitude(g, node_of(g, &part->params, derived, "offset"));
            // Values of groups that do not move are rounded too.
            const pm_node most = pm_add(g, moves, pm_scale(g, values, PM_PART_ROUNDING));
            radius[ngroup + i] = pm_add(g, pm_matmul(g, most, false, matrix, true),
                                        pm_scale(g, offset, PM_PART_ROUNDING));
        }
    }
}

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
    for (int i = 0; i < part->spec.nderived; ++i) { // behind the groups, on which they depend
        const pm_derived_spec *derived = &part->spec.derived[i];
        pm_node node = PM_NO_NODE;
        if (g != NULL) {
            node = pm_add(g,
                          pm_matmul(g, join(g, derived, &symbols), false,
                                    node_of(g, &part->params, derived, "matrix"), true),
                          node_of(g, &part->params, derived, "offset"));
        }
        pm_symbols_add_one(&symbols, derived->name, derived->size, node);
    }
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

// --- kinds ---

typedef struct part_kind {
    pm_status (*check)(const pm_part_spec *spec);
    pm_status (*declare)(pm_part *part);
    // A potential exists, or has discrete derivatives, beyond what the spec says of it.
    bool has_entropy, is_discrete;
} part_kind;

// Returns true if the spec has nothing but its form, and what is not listed here.
static bool is_bare(const pm_part_spec *spec) {
    return spec->nderived == 0 && !pm_potential_exists(&spec->energy) &&
           !pm_potential_exists(&spec->entropy) && !pm_potential_exists(&spec->coenergy) &&
           !pm_operator_exists(&spec->reversible) && !pm_operator_exists(&spec->irreversible);
}

static pm_status check_graph(const pm_part_spec *spec) {
    if (spec->form == PM_FREE) {
        return is_bare(spec)
                   ? PM_OK
                   : pm_fail(
                         PM_ECONFIG,
                         "form: free has a rate and nothing else: no derived variables, energy, "
                         "coenergy, entropy, reversible or irreversible operator");
    }
    if (!pm_potential_exists(&spec->energy) && !pm_potential_exists(&spec->coenergy)) {
        return pm_fail(PM_ECONFIG, "a subsystem needs an energy");
    }
    if (pm_operator_exists(&spec->irreversible) && !pm_potential_exists(&spec->entropy)) {
        return pm_fail(PM_ECONFIG, "an irreversible operator needs an entropy");
    }
    return PM_OK;
}

// Returns true if C depends on a group through heat capacities alone, if at all: each component of
// its energy variable then depends on the same component of the group and on nothing else.
static bool is_separate(const pm_part *part, const char *group) {
    pm_potential_spec others = part->spec.coenergy;
    others.nconvex = 0;
    bool coupled = pm_part_depends(part, &others, group);
    for (int i = 0; i < part->spec.coenergy.nconvex; ++i) {
        const pm_convex_spec *convex = &part->spec.coenergy.convex[i];
        const pm_potential_spec alone = {.nconvex = 1, .convex = convex};
        coupled =
            coupled || (convex->kind == PM_CONVEX_INERTIA && pm_part_depends(part, &alone, group));
    }
    return !coupled;
}

// Checks that C depends on all co-energies and that nothing else does, but the entropy by its
// linear form, which stands for the energy variables.
static pm_status check_coenergies(const pm_part *part) {
    const pm_part_spec *spec = &part->spec;
    pm_potential_spec beside = spec->entropy; // what the entropy has beside its linear form
    int coupled = 0;
    bool some = false;
    beside.ngiven = 0;
    for (int i = 0; i < part->layout.ngroup; ++i) {
        const pm_group *group = &part->layout.group[i];
        some = some || group->coenergy;
        if (!group->coenergy) {
            continue;
        }
        if (!pm_part_depends(part, &spec->coenergy, group->name)) {
            return pm_spec_locate(
                spec->at,
                pm_fail(PM_ECONFIG,
                        "the scene shows the group %s by its co-energy: expected a model whose "
                        "`coenergy` depends on %s",
                        group->name, group->name));
        }
        if (pm_part_depends(part, &spec->energy, group->name) ||
            pm_part_depends(part, &beside, group->name)) {
            return pm_spec_locate(
                spec->at, pm_fail(PM_ECONFIG,
                                  "the group %s is shown by its co-energy: only `coenergy` and the "
                                  "linear form of the entropy may name it",
                                  group->name));
        }
        coupled += is_separate(part, group->name) ? 0 : group->size;
    }
    if (coupled > MOST_COUPLED) {
        return pm_spec_locate(spec->at,
                              pm_fail(PM_ECONFIG,
                                      "`coenergy` couples %d components, at most %d are possible",
                                      coupled, MOST_COUPLED));
    }
    if (spec->coenergy.nterm > 0 || spec->coenergy.ngiven > 0 || spec->energy.nconvex > 0 ||
        spec->entropy.nconvex > 0) {
        return pm_spec_locate(
            spec->at, pm_fail(PM_ECONFIG, "inertias and capacities belong to `coenergy`, which has "
                                          "nothing but these and formulas"));
    }
    return some || !pm_potential_exists(&spec->coenergy)
               ? PM_OK
               : pm_spec_locate(spec->at,
                                pm_fail(PM_ECONFIG, "`coenergy` needs a group of the scene with "
                                                    "`coenergy: true`"));
}

static pm_status declare_graph(pm_part *part) {
    const pm_site site = site_of(part, NULL, PM_NO_NODE, PM_NO_NODE, PM_NO_NODE);
    if (part->spec.form == PM_FREE) {
        return pm_unstructured_rate_declare(&part->spec.rate, &site, &part->params, "rate");
    }
    for (int i = 0; i < part->spec.nderived; ++i) {
        PM_TRY(pm_spec_locate(part->spec.derived[i].at, declare_derived(part, i)));
    }
    PM_TRY(
        pm_spec_locate(part->spec.at, pm_constants_declare(part->spec.constants, &part->params)));
    const pm_symbols symbols = pm_part_symbols(part, NULL, PM_NO_NODE);
    PM_TRY(pm_potential_declare(&part->spec.energy, &symbols, &part->params, "energy"));
    PM_TRY(pm_potential_declare(&part->spec.entropy, &symbols, &part->params, "entropy"));
    PM_TRY(pm_potential_declare(&part->spec.coenergy, &symbols, &part->params, "coenergy"));
    PM_TRY(check_coenergies(part));
    const pm_operator L = reversible(part), M = irreversible(part);
    PM_TRY(pm_operator_declare(&L, &site, &part->params));
    return pm_operator_declare(&M, &site, &part->params);
}

static pm_status check_solid(const pm_part_spec *spec) {
    return spec->form == PM_HARD && is_bare(spec)
               ? PM_OK
               : pm_fail(PM_ECONFIG, "a solid is hard, and has no energy, coenergy, entropy, "
                                     "operators or derived variables beside it");
}

static pm_status declare_solid(pm_part *part) {
    return pm_solid_material_declare(part->spec.solid, &part->params);
}

static const part_kind kinds[PM_PART_KINDS] = {
    [PM_PART_GRAPH] = {check_graph, declare_graph, false, false},
    [PM_PART_SOLID] = {check_solid, declare_solid, true, true},
};

pm_part_kind pm_part_kind_of(const pm_part *part) {
    return part->spec.solid != NULL ? PM_PART_SOLID : PM_PART_GRAPH;
}

pm_status pm_part_declare(pm_part *part) {
    const part_kind *kind = &kinds[pm_part_kind_of(part)];
    PM_TRY(pm_spec_locate(part->spec.at, kind->check(&part->spec)));
    return kind->declare(part);
}

void pm_part_free(pm_part *part) {
    pm_params_free(&part->params);
}

bool pm_part_has_energy(const pm_part *part) {
    return part->spec.form != PM_FREE;
}

bool pm_part_has_entropy(const pm_part *part) {
    return kinds[pm_part_kind_of(part)].has_entropy || pm_potential_exists(&part->spec.entropy);
}

bool pm_part_depends(const pm_part *part, const pm_potential_spec *potential, const char *group) {
    bool depends = pm_potential_mentions(potential, group);
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        depends = depends || (pm_is_listed(derived->ngroup, derived->group, group) &&
                              pm_potential_mentions(potential, derived->name));
    }
    return depends;
}

// --- co-energies ---

// A state with co-energies. The symbols of its groups come first, in the order of the layout. The
// energy variable of group i is x[i]; PM_NO_NODE if the group is one itself.
typedef struct shown_state {
    pm_symbols symbols;
    pm_node C; // [1][1]
    pm_node x[PM_MAX_GROUPS];
} shown_state;

bool pm_part_has_coenergies(const pm_part *part) {
    bool some = false;
    for (int i = 0; i < part->layout.ngroup && part->spec.form != PM_FREE; ++i) {
        some = some || part->layout.group[i].coenergy;
    }
    return some;
}

static void group_nodes(const shown_state *s, const pm_part *part, pm_node *node) {
    for (int i = 0; i < part->layout.ngroup; ++i) {
        node[i] = s->symbols.symbol[i].node;
    }
}

static void build_shown(pm_graph *g, const pm_part *part, pm_node z, shown_state *s) {
    pm_node group[PM_MAX_GROUPS];
    s->symbols = pm_part_symbols(part, g, z);
    s->C = pm_potential_build(g, &part->spec.coenergy, &s->symbols, &part->params, "coenergy");
    group_nodes(s, part, group);
    pm_gradient(g, s->C, PM_NO_NODE, part->layout.ngroup, group, s->x);
    for (int i = 0; i < part->layout.ngroup; ++i) {
        s->x[i] = part->layout.group[i].coenergy ? s->x[i] : PM_NO_NODE;
    }
}

// Returns the groups side by side [1][nz]; PM_NO_NODE is zero, and all together are.
static pm_node join_groups(pm_graph *g, const pm_part *part, const pm_node *node) {
    pm_node side[PM_MAX_GROUPS];
    bool some = false;
    for (int i = 0; i < part->layout.ngroup; ++i) {
        const pm_shape shape = {true, 1, part->layout.group[i].size};
        some = some || node[i] != PM_NO_NODE;
        side[i] = node[i] == PM_NO_NODE ? pm_constant(g, 0, 1, shape.cols)
                                        : pm_broadcast_to(g, node[i], shape);
    }
    return some ? pm_concat(g, part->layout.ngroup, side) : PM_NO_NODE;
}

pm_node pm_part_energy_variables(pm_graph *g, const pm_part *part, pm_node z) {
    if (!pm_part_has_coenergies(part)) {
        return z;
    }
    shown_state s;
    pm_node group[PM_MAX_GROUPS];
    build_shown(g, part, z, &s);
    group_nodes(&s, part, group);
    for (int i = 0; i < part->layout.ngroup; ++i) {
        group[i] = part->layout.group[i].coenergy ? s.x[i] : group[i];
    }
    return join_groups(g, part, group);
}

// Returns V - C.
static pm_node free_of(pm_graph *g, const pm_part *part, const shown_state *s) {
    const pm_node V =
        pm_potential_build(g, &part->spec.energy, &s->symbols, &part->params, "energy");
    return V == PM_NO_NODE ? pm_scale(g, s->C, -1) : pm_sub(g, V, s->C);
}

// Returns a - l b, where PM_NO_NODE is zero.
static pm_node subtract(pm_graph *g, pm_node a, pm_node l, pm_node b) {
    if (l == PM_NO_NODE || b == PM_NO_NODE) {
        return a;
    }
    const pm_node product = pm_mul(g, l, b);
    return a == PM_NO_NODE ? pm_scale(g, product, -1) : pm_sub(g, a, product);
}

// Solves the symmetric positive definite system H x = r for n unknowns by an unrolled L D L^T
// factorisation (Golub, van Loan, Matrix Computations, 4.1.2), and replaces each r by x. The lower
// triangle of H is at matrix[i * n + j], j <= i; every node is [1][1], and PM_NO_NODE is zero,
// which takes no operations. The matrix is overwritten.
static void solve(pm_graph *g, int n, pm_node *matrix, pm_node *r) {
    for (int k = 0; k < n; ++k) {
        for (int i = k + 1; i < n; ++i) {
            const pm_node below = matrix[i * n + k];
            if (below == PM_NO_NODE) {
                continue;
            }
            matrix[i * n + k] = pm_div(g, below, matrix[k * n + k]); // of L
            for (int j = k + 1; j <= i; ++j) {
                matrix[i * n + j] = subtract(g, matrix[i * n + j], below, matrix[j * n + k]);
            }
            r[i] = subtract(g, r[i], matrix[i * n + k], r[k]);
        }
    }
    for (int k = n - 1; k >= 0; --k) {
        r[k] = pm_div(g, r[k], matrix[k * n + k]);
        for (int i = k + 1; i < n; ++i) {
            r[k] = subtract(g, r[k], matrix[i * n + k], r[i]);
        }
    }
}

pm_node pm_part_release(pm_graph *g, const pm_part *part, pm_node z, pm_node rate) {
    if (rate == PM_NO_NODE || !pm_part_has_coenergies(part)) {
        return rate;
    }
    const pm_layout *layout = &part->layout;
    shown_state s;
    pm_node group[PM_MAX_GROUPS], own[PM_MAX_GROUPS];
    pm_node matrix[MOST_COUPLED * MOST_COUPLED], r[MOST_COUPLED];
    int unknown[PM_MAX_GROUPS], n = 0;
    bool same = true;
    build_shown(g, part, z, &s);
    group_nodes(&s, part, group);
    for (int i = 0; i < layout->ngroup; ++i) {
        own[i] = pm_slice(g, rate, layout->group[i].first, layout->group[i].size);
        unknown[i] = -1;
        if (layout->group[i].coenergy && !is_separate(part, layout->group[i].name)) {
            unknown[i] = n;
            n += layout->group[i].size;
        }
    }
    for (int i = 0; i < MOST_COUPLED * MOST_COUPLED; ++i) {
        matrix[i] = PM_NO_NODE;
    }
    // The rows of C_yy, and the right-hand sides xdot - C_yq qdot.
    for (int i = 0; i < layout->ngroup; ++i) {
        for (int c = 0; c < layout->group[i].size && unknown[i] >= 0; ++c) {
            const int at = unknown[i] + c;
            pm_node slope[PM_MAX_GROUPS];
            pm_gradient(g, pm_slice(g, s.x[i], c, 1), PM_NO_NODE, layout->ngroup, group, slope);
            r[at] = pm_slice(g, own[i], c, 1);
            for (int k = 0; k < layout->ngroup; ++k) {
                for (int d = 0; slope[k] != PM_NO_NODE && d < layout->group[k].size; ++d) {
                    if (unknown[k] >= 0) {
                        matrix[at * n + unknown[k] + d] = pm_slice(g, slope[k], d, 1);
                    }
                }
                if (slope[k] != PM_NO_NODE && unknown[k] < 0) {
                    r[at] = pm_sub(g, r[at], pm_dot(g, slope[k], own[k]));
                }
            }
        }
    }
    solve(g, n, matrix, r);
    for (int i = 0; i < layout->ngroup; ++i) {
        if (unknown[i] >= 0) {
            own[i] = pm_concat(g, layout->group[i].size, &r[unknown[i]]);
        } else if (layout->group[i].coenergy) { // C_yy is diagonal, and C_yq is zero
            pm_node slope;
            pm_gradient(g, s.x[i], PM_NO_NODE, 1, &group[i], &slope);
            own[i] = pm_div(g, own[i], slope);
        }
        const pm_node before = pm_slice(g, rate, layout->group[i].first, layout->group[i].size);
        same = same && own[i] == before;
    }
    return same ? rate : join_groups(g, part, own);
}

// --- potentials ---

pm_node pm_part_energy(pm_graph *g, const pm_part *part, pm_node z) {
    if (!pm_part_has_energy(part)) {
        return pm_constant(g, 0, 1, 1);
    }
    if (pm_part_has_coenergies(part)) {
        shown_state s;
        build_shown(g, part, z, &s);
        pm_node E = free_of(g, part, &s);
        for (int i = 0; i < part->layout.ngroup; ++i) {
            E = s.x[i] == PM_NO_NODE ? E
                                     : pm_add(g, E, pm_dot(g, s.symbols.symbol[i].node, s.x[i]));
        }
        return E;
    }
    const pm_symbols symbols = pm_part_symbols(part, g, z);
    return pm_potential_build(g, &part->spec.energy, &symbols, &part->params, "energy");
}

pm_node pm_part_entropy(pm_graph *g, const pm_part *part, pm_node z) {
    // The entropy names no co-energies but the energy variables inside (check_coenergies).
    const pm_node own =
        pm_potential_exists(&part->spec.entropy) ? pm_part_energy_variables(g, part, z) : z;
    const pm_symbols symbols = pm_part_symbols(part, g, own);
    return pm_potential_build(g, &part->spec.entropy, &symbols, &part->params, "entropy");
}

bool pm_part_is_discrete(const pm_part *part) {
    return kinds[pm_part_kind_of(part)].is_discrete ||
           (pm_potential_is_discrete(&part->spec.energy) &&
            pm_potential_is_discrete(&part->spec.entropy) && !pm_part_has_coenergies(part));
}

static pm_node discrete(pm_graph *g, const pm_part *part, const pm_potential_spec *spec,
                        const char *prefix, pm_node z_from, pm_node z_to) {
    const pm_symbols from = pm_part_symbols(part, g, z_from), to = pm_part_symbols(part, g, z_to);
    pm_node covector[PM_MAX_SYMBOLS];
    for (int i = 0; i < from.count; ++i) {
        covector[i] = PM_NO_NODE;
    }
    pm_potential_discrete(g, spec, &from, &to, &part->params, prefix, covector);
    pull_derived(part, g, covector);
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
    const pm_potential_spec *entropy = &part->spec.entropy;
    const int ngroup = part->layout.ngroup;
    if (pm_part_has_coenergies(part)) {
        assert(z_from == PM_NO_NODE);
        shown_state s;
        pm_node group[PM_MAX_GROUPS], of_energy[PM_MAX_GROUPS], of_entropy[PM_MAX_GROUPS];
        build_shown(g, part, z_to, &s);
        group_nodes(&s, part, group);
        pm_gradient(g, free_of(g, part, &s), PM_NO_NODE, ngroup, group, of_energy);
        // The linear form stands for the energy variables; all else depends on other groups alone.
        pm_gradient(g, pm_potential_build(g, entropy, &s.symbols, &part->params, "entropy"),
                    PM_NO_NODE, ngroup, group, of_entropy);
        for (int i = 0; i < ngroup; ++i) {
            of_energy[i] = part->layout.group[i].coenergy ? group[i] : of_energy[i];
        }
        *dE = join_groups(g, part, of_energy);
        *dS = join_groups(g, part, of_entropy);
        return;
    }
    if (z_from != PM_NO_NODE) {
        *dE = discrete(g, part, &part->spec.energy, "energy", z_from, z_to);
        *dS = discrete(g, part, entropy, "entropy", z_from, z_to);
        return;
    }
    pm_gradient(g, pm_part_energy(g, part, z_to), PM_NO_NODE, 1, &z_to, dE);
    pm_gradient(g, pm_part_entropy(g, part, z_to), PM_NO_NODE, 1, &z_to, dS);
}

pm_node pm_part_response(pm_graph *g, const pm_part *part, pm_node dE, pm_node z_to,
                         const int *ports) {
    const int nz = part->layout.nz;
    pm_node diagonal = PM_NO_NODE;
    for (int c = 0; c < nz && dE != PM_NO_NODE; ++c) {
        pm_node row = PM_NO_NODE;
        if (ports[c] > 0) {
            pm_gradient(g, pm_slice(g, dE, c, 1), PM_NO_NODE, 1, &z_to, &row);
        }
        if (row != PM_NO_NODE) {
            const pm_node one = pm_slice(g, row, c, 1);
            const pm_node all = ports[c] > 1 ? pm_scale(g, one, ports[c]) : one;
            diagonal = pm_add_or(g, diagonal, pm_place(g, all, c, nz));
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
    const pm_symbols symbols = pm_part_symbols(part, g, z); // with the derived variables
    PM_TRY(pm_potential_visit(&part->spec.energy, &symbols, "energy", visit, context));
    PM_TRY(pm_potential_visit(&part->spec.entropy, &symbols, "entropy", visit, context));
    PM_TRY(pm_potential_visit(&part->spec.coenergy, &symbols, "coenergy", visit, context));
    PM_TRY(pm_operator_visit(g, &L, &site, &part->params, dE, dS, visit, context));
    return pm_operator_visit(g, &M, &site, &part->params, dS, dE, visit, context);
}

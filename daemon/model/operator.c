// L and M: the frame, the matrix in it, and the projection that makes the laws hold.
#include "model/operator.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/dissipation.h"
#include "model/given.h"
#include "model/mesh/message.h"
#include "model/mesh/nodal.h"

// Keeps the projection finite where the normal vanishes: then there is nothing to project out.
#define SMALLEST_NORMAL 1e-300
// Where a learned M starts: not at zero, where its factor would have no gradient, and with signs
// that alternate, since the projection takes away what all have in common. (On a mesh the decoder's
// weights are drawn.)
#define FACTOR_START 1.0
#define MAX_ENTRIES (1 << 24) // of a learned matrix

bool pm_operator_exists(const pm_operator_spec *spec) {
    return spec->ngiven > 0 || spec->learned;
}

// With a frame, a vector group (size > 1) counts one row per vector of `along`.
static int frame_rows(const pm_operator_spec *spec, int group_size) {
    return spec->nalong > 0 && group_size > 1 ? spec->nalong : group_size;
}

// Rows of the frame in groups of the list.
static int listed_rows(const pm_operator_spec *spec, const pm_support *s, int count,
                       const char *const *list) {
    int rows = 0;
    for (int i = 0; i < s->ngroup; ++i) {
        const bool counts = s->learned[i] && pm_is_listed(count, list, s->group[i]->name);
        rows += counts ? frame_rows(spec, s->group[i]->size) : 0;
    }
    return rows;
}

// Matrices one for each node of a mesh, this many.
static int matrix_count(const pm_operator *op) {
    const pm_message_spec *message = op->spec->network.message;
    return message == NULL ? 1 : message->mesh->nnode;
}

// Rows and columns of a matrix that the network gives.
static int matrix_rows(const pm_operator *op, const pm_support *s) {
    return listed_rows(op->spec, s, op->spec->nacts, op->spec->acts_on) / matrix_count(op);
}

static int matrix_columns(const pm_operator *op, const pm_support *s) {
    const pm_operator_spec *spec = op->spec;
    if (op->kind == PM_IRREVERSIBLE) {
        return spec->rank;
    }
    return spec->nagainst > 0 ? listed_rows(spec, s, spec->nagainst, spec->against)
                              : matrix_rows(op, s);
}

// --- declaration ---

// All of acts_on are groups of one end of a port ("a.p"), and this is one of the other.
static bool is_other_end(const pm_operator_spec *spec, const char *name) {
    for (int i = 0; i < spec->nacts; ++i) {
        if (name[0] == spec->acts_on[i][0] || name[1] != '.' || spec->acts_on[i][1] != '.') {
            return false;
        }
    }
    return true;
}

static pm_status check_heats(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    if (spec->nheats == 0 || !spec->learned) {
        return PM_OK;
    }
    if (op->form != PM_HARD || spec->network.message != NULL) {
        return pm_fail(PM_ECONFIG, "%s: heats belongs to form: hard, not on a mesh", op->prefix);
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < s.ngroup; ++i) {
        if (s.learned[i]) {
            return pm_support_heats(spec, site) <= PM_MAX_HEATS
                       ? PM_OK
                       : pm_fail(PM_ECONFIG, "%s: at most %d components can take up heat",
                                 op->prefix, PM_MAX_HEATS);
        }
    }
    return pm_fail(PM_ECONFIG, "%s: a single entropy has nothing to exchange heat with",
                   op->prefix);
}

static pm_status check_groups(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < spec->nacts; ++i) {
        if (pm_support_find(&s, spec->acts_on[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: acts_on names \"%s\", which is not a group here",
                           op->prefix, spec->acts_on[i]);
        }
    }
    for (int i = 0; i < spec->nheats; ++i) {
        if (pm_support_find(&s, spec->heats[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: heats names \"%s\", which is not a group here",
                           op->prefix, spec->heats[i]);
        }
    }
    PM_TRY(check_heats(op, site));
    for (int i = 0; i < spec->nagainst; ++i) {
        const int at = pm_support_find(&s, spec->against[i]);
        if (at == s.ngroup || !is_other_end(spec, spec->against[i])) {
            return pm_fail(PM_ECONFIG,
                           "%s: against names \"%s\", which is not a group of the other end",
                           op->prefix, spec->against[i]);
        }
    }
    return pm_given_check(spec, op->kind == PM_REVERSIBLE, site, op->prefix);
}

// On a mesh an operator acts on fields, and has no frame.
static pm_status check_nodal(const pm_operator *op, const pm_support *s) {
    const int nnode = matrix_count(op);
    if (op->spec->network.message == NULL) {
        return PM_OK;
    }
    if (op->spec->nalong > 0 || op->spec->nagainst > 0) {
        return pm_fail(PM_ECONFIG, "%s: an operator on a mesh has no along and no against",
                       op->prefix);
    }
    for (int i = 0; i < s->ngroup; ++i) {
        if (s->learned[i] && s->group[i]->size % nnode != 0) {
            return pm_fail(PM_ECONFIG, "%s: acts_on names \"%s\", which is no field on %d nodes",
                           op->prefix, s->group[i]->name, nnode);
        }
    }
    return PM_OK;
}

static pm_status check_formulas(const pm_operator_spec *spec, const pm_site *site) {
    for (int i = 0; i < spec->ngiven; ++i) {
        if (spec->given[i].formula.text != NULL) {
            PM_TRY(pm_formula_check(&spec->given[i].formula, &site->symbols));
        }
    }
    return PM_OK;
}

static pm_status check_along(const pm_operator *op, const pm_site *site, const pm_support *s) {
    const pm_operator_spec *spec = op->spec;
    int total = 0;
    PM_TRY(pm_features_size(spec->nalong, spec->along, &site->symbols, &total));
    for (int k = 0; k < spec->nalong; ++k) {
        int size = 0;
        PM_TRY(pm_feature_size(spec->along[k], &site->symbols, &size));
        if (size * spec->nalong != total) {
            return pm_fail(PM_ECONFIG, "%s: the vectors of along differ in size: \"%s\" has %d",
                           op->prefix, spec->along[k], size);
        }
        for (int i = 0; i < s->ngroup; ++i) {
            if (s->learned[i] && s->group[i]->size > 1 && s->group[i]->size != size) {
                return pm_fail(PM_ECONFIG, "%s: \"%s\" has %d components, %s has %d", op->prefix,
                               spec->along[k], size, s->group[i]->name, s->group[i]->size);
            }
        }
    }
    return PM_OK;
}

typedef char operator_name[96];

static const char *join(operator_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(operator_name), "%s.%s", prefix, name);
    return buffer;
}

// How the heat of each process is shared among entropies, and how it depends on temperature.
static pm_status declare_split(const pm_operator *op, const pm_site *site, pm_params *params) {
    const int nheat = pm_support_heats(op->spec, site);
    operator_name name;
    PM_TRY(pm_params_add(params, join(name, op->prefix, "temperature"), 1, 1, false, 0,
                         PM_DEFAULT_TEMPERATURE));
    PM_TRY(pm_params_add(params, join(name, op->prefix, "power"), 1, op->spec->rank, true, 0, 0));
    return nheat < 2 ? PM_OK
                     : pm_params_add(params, join(name, op->prefix, "split"), op->spec->rank,
                                     nheat - 1, true, 0, 0);
}

static pm_status declare_matrix(const pm_operator *op, const pm_site *site, const pm_support *s,
                                pm_params *params) {
    operator_name name;
    join(name, op->prefix, "matrix");
    const pm_network_spec *network = &op->spec->network;
    const int rows = matrix_rows(op, s), cols = matrix_columns(op, s);
    if ((int64_t)rows * cols > MAX_ENTRIES) {
        return pm_spec_locate(op->spec->at, pm_fail(PM_ECONFIG,
                                                    "%s: a learned matrix of %d x %d, at most %d "
                                                    "entries are possible",
                                                    op->prefix, rows, cols, MAX_ENTRIES));
    }
    const int nout = rows * cols;
    if (op->spec->nheats > 0) {
        PM_TRY(declare_split(op, site, params));
    }
    if (network->message != NULL) {
        return pm_message_declare_nodes(network, &site->symbols, nout, params, name);
    }
    if (op->kind == PM_REVERSIBLE) {
        return pm_network_declare(network, &site->symbols, nout, NULL, params, name);
    }
    double *start = malloc((size_t)nout * sizeof *start);
    if (start == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an operator");
    }
    for (int i = 0; i < nout; ++i) {
        start[i] = i / op->spec->rank % 2 == 0 ? FACTOR_START : -FACTOR_START;
        start[i] = op->spec->nheats > 0 ? 0 : start[i]; // drawn, with the network's spread
    }
    const pm_status status = pm_network_declare(network, &site->symbols, nout, start, params, name);
    free(start);
    return status;
}

pm_status pm_operator_declare(const pm_operator *op, const pm_site *site, pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    PM_TRY(pm_spec_locate(spec->at, check_groups(op, site)));
    PM_TRY(check_formulas(spec, site));
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    PM_TRY(pm_spec_locate(spec->at, check_along(op, site, &s)));
    PM_TRY(pm_spec_locate(spec->at, check_nodal(op, &s)));
    operator_name name;
    PM_TRY(pm_params_add(params, join(name, op->prefix, "scale"), 1, s.n, false, 0, 1));
    if (spec->nalong > 0) {
        join(name, op->prefix, "along");
        PM_TRY(pm_params_add(params, name, 1, spec->nalong, false, 0, 1));
    }
    return spec->learned ? declare_matrix(op, site, &s, params) : PM_OK;
}

pm_status pm_operator_visit(const pm_operator *op, const pm_site *site, pm_normaliser_visit *visit,
                            void *context) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    const char *group[2 * PM_MAX_GROUPS];
    for (int i = 0; i < s.ngroup; ++i) {
        group[i] = s.group[i]->name;
    }
    const pm_normaliser scale = {.kind = op->kind == PM_REVERSIBLE ? PM_NORMALISE_SCALE
                                                                   : PM_NORMALISE_FRICTION,
                                 .prefix = op->prefix,
                                 .count = s.ngroup,
                                 .expression = group,
                                 .symbols = &site->symbols,
                                 .nheats = spec->nheats,
                                 .heats = spec->heats};
    PM_TRY(visit(context, &scale));
    if (spec->nalong > 0) {
        const pm_normaliser along = {.kind = PM_NORMALISE_ALONG,
                                     .prefix = op->prefix,
                                     .count = spec->nalong,
                                     .expression = spec->along,
                                     .symbols = &site->symbols};
        PM_TRY(visit(context, &along));
    }
    operator_name name;
    if (spec->learned && spec->network.message != NULL) {
        return pm_message_visit(&spec->network, &site->symbols, join(name, op->prefix, "matrix"),
                                visit, context);
    }
    if (spec->learned && spec->network.nfeature > 0) {
        const pm_normaliser features = {.kind = PM_NORMALISE_FEATURES,
                                        .prefix = join(name, op->prefix, "matrix"),
                                        .count = spec->network.nfeature,
                                        .expression = spec->network.feature,
                                        .symbols = &site->symbols};
        PM_TRY(visit(context, &features));
    }
    return PM_OK;
}

// --- building ---

// Everything about one operator while its expression is built.
typedef struct construction {
    pm_graph *g;
    const pm_operator *op;
    const pm_site *site;
    pm_support support;
    pm_node scale;  // [1][support.n]
    pm_node matrix; // C - C^T [rows][rows] or G [rows][rank]; PM_NO_NODE: nothing learned; on a
                    // mesh of each node C or G
    pm_node along;  // [nalong][size]; PM_NO_NODE: the frame is the identity
} construction;

static pm_node part_of(const construction *c, pm_node x, int i) {
    return pm_slice(c->g, x, c->support.first[i], c->support.group[i]->size);
}

// The vectors of the frame as rows, each divided by its typical length.
static pm_node build_along(pm_graph *g, const pm_operator *op, const pm_site *site,
                           const pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    if (spec->nalong == 0) {
        return PM_NO_NODE;
    }
    const pm_node side_by_side = pm_features_build(g, spec->nalong, spec->along, &site->symbols);
    const int size = pm_graph_shape(g, side_by_side).cols / spec->nalong;
    const pm_node length = pm_network_param(g, params, op->prefix, "along");
    return pm_div(g, pm_reshape(g, side_by_side, spec->nalong, size),
                  pm_reshape(g, length, spec->nalong, 1));
}

static pm_node build_matrix(pm_graph *g, const pm_operator *op, const pm_site *site,
                            const pm_support *s, const pm_params *params) {
    if (!op->spec->learned) {
        return PM_NO_NODE;
    }
    operator_name name;
    const int rows = matrix_rows(op, s), columns = matrix_columns(op, s), nout = rows * columns;
    join(name, op->prefix, "matrix");
    if (op->spec->network.message != NULL) {
        return pm_message_build_nodes(g, &op->spec->network, &site->symbols, nout, params, name);
    }
    const pm_node entries =
        pm_network_build(g, &op->spec->network, &site->symbols, nout, params, name);
    const pm_node matrix = pm_reshape(g, entries, rows, columns);
    // C - C^T is formed before it is applied: C x and C^T x share the diagonal's terms, whose
    // rounding would stay behind.
    return op->kind == PM_REVERSIBLE && op->spec->nagainst == 0
               ? pm_sub(g, matrix, pm_transpose(g, matrix))
               : matrix;
}

// U: components of the support, in scaled coordinates -> rows of the frame.
static pm_node to_frame(const construction *c, pm_node scaled) {
    pm_node part[2 * PM_MAX_GROUPS];
    int count = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        if (c->support.learned[i]) {
            const pm_node x = part_of(c, scaled, i);
            part[count++] = c->along != PM_NO_NODE && c->support.group[i]->size > 1
                                ? pm_matmul(c->g, x, false, c->along, true)
                                : x;
        }
    }
    return pm_concat(c->g, count, part);
}

// U^T: rows of the frame -> components of the support, line by line; zero in groups that are only
// given.
static pm_node from_frame(const construction *c, pm_node rows) {
    const int lines = pm_graph_shape(c->g, rows).rows;
    pm_node part[2 * PM_MAX_GROUPS];
    int first = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        const int size = c->support.group[i]->size;
        if (!c->support.learned[i]) {
            part[i] = pm_constant(c->g, 0, lines, size);
            continue;
        }
        const int nrow = frame_rows(c->op->spec, size);
        const pm_node x = pm_slice(c->g, rows, first, nrow);
        part[i] =
            c->along != PM_NO_NODE && size > 1 ? pm_matmul(c->g, x, false, c->along, false) : x;
        first += nrow;
    }
    return pm_concat(c->g, c->support.ngroup, part);
}

// Two ends' rows, one of which drives the other: C times those of `against` into those of acts_on,
// and -C^T times the latter into the former.
static pm_node apply_across(const construction *c, pm_node x) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const int rows = matrix_rows(c->op, &c->support), columns = matrix_columns(c->op, &c->support);
    const bool against_first = spec->against[0][0] < spec->acts_on[0][0];
    const pm_node own = pm_slice(g, x, against_first ? columns : 0, rows);
    const pm_node other = pm_slice(g, x, against_first ? 0 : rows, columns);
    const pm_node into_own = pm_matmul(g, other, false, c->matrix, true);
    const pm_node into_other = pm_scale(g, pm_matmul(g, own, false, c->matrix, false), -1);
    const pm_node part[2] = {against_first ? into_other : into_own,
                             against_first ? into_own : into_other};
    return pm_concat(g, 2, part);
}

// Each node's matrix times its part of x.
static pm_node apply_nodal(const construction *c, pm_node x) {
    int components[2 * PM_MAX_GROUPS];
    pm_nodal_fields fields = {matrix_count(c->op), 0, components};
    for (int i = 0; i < c->support.ngroup; ++i) {
        if (c->support.learned[i]) {
            components[fields.count++] = c->support.group[i]->size / fields.nnode;
        }
    }
    return c->op->kind == PM_REVERSIBLE
               ? pm_nodal_skew(c->g, fields, c->matrix, x)
               : pm_nodal_square(c->g, fields, c->op->spec->rank, c->matrix, x);
}

// The matrix times x, or G G^T x, for a row x.
static pm_node apply_matrix(const construction *c, pm_node x) {
    pm_graph *g = c->g;
    if (c->op->spec->network.message != NULL) {
        return apply_nodal(c, x);
    }
    if (c->op->spec->nagainst > 0) {
        return apply_across(c, x);
    }
    if (c->op->kind == PM_REVERSIBLE) {
        return pm_matmul(g, x, false, c->matrix, true);
    }
    return pm_matmul(g, pm_matmul(g, x, false, c->matrix, false), false, c->matrix, true);
}

// K d over the support.
static pm_node apply(const construction *c, pm_node d) {
    pm_node rate = c->op->kind == PM_REVERSIBLE
                       ? pm_given_reversible(c->g, c->op->spec, c->site, &c->support, d)
                       : PM_NO_NODE;
    if (c->matrix != PM_NO_NODE) {
        const pm_node rows = apply_matrix(c, to_frame(c, pm_mul(c->g, d, c->scale)));
        rate = pm_add_or(c->g, rate, pm_mul(c->g, from_frame(c, rows), c->scale));
    }
    return rate;
}

// P^T K P d: nothing of the rate is left along the normal.
static pm_node apply_projected(const construction *c, pm_node d, pm_node normal) {
    pm_graph *g = c->g;
    const pm_node weighted = pm_mul(g, normal, pm_square(g, c->scale)); // W n
    const pm_node square = pm_offset(g, pm_dot(g, normal, weighted), SMALLEST_NORMAL);
    const pm_node along = pm_div(g, pm_dot(g, d, weighted), square);
    pm_node rate = apply(c, pm_sub(g, d, pm_mul(g, along, normal)));
    // Twice: what the first leaves is rounding of what it took away, not of what remains.
    for (int i = 0; i < 2; ++i) {
        const pm_node excess = pm_div(g, pm_dot(g, rate, normal), square);
        rate = pm_sub(g, rate, pm_mul(g, excess, weighted));
    }
    return rate;
}

// The rate of an operator with `heats` (dissipation.h).
static pm_node apply_dissipation(const construction *c, const pm_params *params, pm_node d,
                                 pm_node normal) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const pm_node rows = from_frame(c, pm_transpose(g, c->matrix));
    const pm_shape shape = {true, 1, c->support.n};
    pm_dissipation dissipation = {
        .driving = pm_broadcast_to(g, d, shape),
        .normal = pm_broadcast_to(g, normal, shape),
        .factor = pm_mul(g, rows, c->scale),
        .power = pm_network_param(g, params, c->op->prefix, "power"),
        .reference = pm_network_param(g, params, c->op->prefix, "temperature"),
        .split = pm_support_heats(spec, c->site) > 1
                     ? pm_network_param(g, params, c->op->prefix, "split")
                     : PM_NO_NODE,
    };
    for (int i = 0; i < c->support.ngroup; ++i) {
        const bool heated = pm_is_listed(spec->nheats, spec->heats, c->support.group[i]->name);
        for (int k = 0; k < c->support.group[i]->size && heated; ++k) {
            dissipation.heat[dissipation.nheat++] = c->support.first[i] + k;
        }
    }
    return pm_dissipation_build(g, &dissipation);
}

// [1][site->n] -> [1][support.n] and back.
static pm_node restrict_to(const construction *c, pm_node x) {
    pm_node part[2 * PM_MAX_GROUPS];
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        part[i] = pm_slice(c->g, x, group->first, group->size);
    }
    return pm_concat(c->g, c->support.ngroup, part);
}

static pm_node extend(const construction *c, const pm_site *site, pm_node rate) {
    pm_node part[2 * PM_MAX_GROUPS];
    for (int i = 0; i < site->ngroup; ++i) {
        const int k = pm_support_find(&c->support, site->group[i].name);
        part[i] = k < c->support.ngroup ? part_of(c, rate, k)
                                        : pm_constant(c->g, 0, 1, site->group[i].size);
    }
    return pm_concat(c->g, site->ngroup, part);
}

// The rate over the support of all that needs a projection, or the penalty, to be degenerate.
static pm_node build_rate(const construction *c, pm_node d, pm_node normal, pm_node *degeneracy) {
    if (c->op->kind == PM_IRREVERSIBLE && c->matrix == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    if (normal == PM_NO_NODE) {
        return apply(c, d);
    }
    if (c->op->form == PM_HARD) {
        return apply_projected(c, d, normal);
    }
    const pm_node residual = pm_div(c->g, apply(c, normal), c->scale);
    *degeneracy = pm_add_or(c->g, *degeneracy, pm_dot(c->g, residual, residual));
    return apply(c, d);
}

pm_node pm_operator_build(pm_graph *g, const pm_operator *op, const pm_site *site,
                          const pm_params *params, pm_node driving, pm_node normal,
                          pm_node *degeneracy) {
    if (!pm_operator_exists(op->spec) || driving == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    construction c = {.g = g,
                      .op = op,
                      .site = site,
                      .support = pm_support_of(op->spec, op->kind == PM_IRREVERSIBLE, site)};
    c.scale = pm_network_param(g, params, op->prefix, "scale");
    c.along = build_along(g, op, site, params);
    c.matrix = build_matrix(g, op, site, &c.support, params);
    const pm_node d = restrict_to(&c, driving);
    const pm_node n = normal == PM_NO_NODE ? PM_NO_NODE : restrict_to(&c, normal);
    const bool heats = op->spec->nheats > 0 && c.matrix != PM_NO_NODE && n != PM_NO_NODE;
    pm_node rate = heats ? apply_dissipation(&c, params, d, n) : build_rate(&c, d, n, degeneracy);
    if (op->kind == PM_IRREVERSIBLE && n != PM_NO_NODE) {
        rate = pm_add_or(g, rate, pm_given_irreversible(g, op->spec, site, &c.support, d, n));
    }
    return rate == PM_NO_NODE ? PM_NO_NODE : extend(&c, site, rate);
}

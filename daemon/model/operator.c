// Builds the rate of an operator: the frame, the matrix in it, and the projection of equation (2)
// that makes the laws hold.
#include "model/dissipation.h"
#include "model/given.h"
#include "model/operator_shape.h"

// Keeps the projection finite where the normal vanishes and there is nothing to project out.
#define SMALLEST_NORMAL 1e-300

// One operator while its expression is built.
typedef struct construction {
    pm_graph *g;
    const pm_operator *op;
    const pm_site *site;
    pm_support support;
    pm_node scale;  // [1][support.n]
    pm_node matrix; // C - C^T [rows][rows] or G [rows][rank]; PM_NO_NODE: nothing learned
    pm_node along;  // [nalong][size]; PM_NO_NODE: the frame is the identity
} construction;

static pm_node part_of(const construction *c, pm_node x, int i) {
    return pm_slice(c->g, x, c->support.first[i], c->support.group[i]->size);
}

// Returns the vectors of `along` as rows [nalong][size], each divided by its typical length.
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
    pm_operator_name name;
    const pm_operator_shape shape = pm_operator_shape_of(op, s);
    const int nout = shape.rows * shape.columns;
    pm_operator_join(name, op->prefix, "matrix");
    const pm_node entries =
        pm_network_build(g, &op->spec->network, &site->symbols, nout, params, name);
    const pm_node matrix = pm_reshape(g, entries, shape.rows, shape.columns);
    // C - C^T is formed before it is multiplied by x. In C x - C^T x the terms of the diagonal
    // would cancel only up to rounding.
    return op->kind == PM_REVERSIBLE && op->spec->nagainst == 0
               ? pm_sub(g, matrix, pm_transpose(g, matrix))
               : matrix;
}

// Applies U: scaled components of the support -> rows of the frame.
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

// Applies U^T to each line: rows of the frame -> components of the support, with zeros in groups
// that the learned matrix does not touch.
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
        const int nrow = pm_operator_frame_rows(c->op->spec, size);
        const pm_node x = pm_slice(c->g, rows, first, nrow);
        part[i] =
            c->along != PM_NO_NODE && size > 1 ? pm_matmul(c->g, x, false, c->along, false) : x;
        first += nrow;
    }
    return pm_concat(c->g, c->support.ngroup, part);
}

// Returns those rows of the frame whose groups are in the list, side by side.
static pm_node select_rows(const construction *c, pm_node x, int count, const char *const *list) {
    pm_node part[2 * PM_MAX_GROUPS];
    int found = 0, first = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        const int rows = pm_operator_frame_rows(c->op->spec, group->size);
        if (c->support.learned[i] && pm_is_listed(count, list, group->name)) {
            part[found++] = pm_slice(c->g, x, first, rows);
        }
        first += c->support.learned[i] ? rows : 0;
    }
    return pm_concat(c->g, found, part);
}

// Returns the rows of the frame for an operator with `against`, in which the two lists drive each
// other: C times the rows of `against` for those of acts_on, and -C^T times the rows of acts_on for
// the others.
static pm_node apply_across(const construction *c, pm_node x) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const pm_node own = select_rows(c, x, spec->nacts, spec->acts_on);
    const pm_node other = select_rows(c, x, spec->nagainst, spec->against);
    const pm_node into_own = pm_matmul(g, other, false, c->matrix, true);
    const pm_node into_other = pm_scale(g, pm_matmul(g, own, false, c->matrix, false), -1);
    pm_node part[2 * PM_MAX_GROUPS];
    int count = 0, at[2] = {0, 0};
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        const int rows = pm_operator_frame_rows(spec, group->size);
        const bool acts = pm_is_listed(spec->nacts, spec->acts_on, group->name);
        if (c->support.learned[i]) {
            part[count++] = pm_slice(g, acts ? into_own : into_other, at[acts], rows);
            at[acts] += rows;
        }
    }
    return pm_concat(g, count, part);
}

// Returns (C - C^T) x or G G^T x for a row x.
static pm_node apply_matrix(const construction *c, pm_node x) {
    pm_graph *g = c->g;
    if (c->op->spec->nagainst > 0) {
        return apply_across(c, x);
    }
    if (c->op->kind == PM_REVERSIBLE) {
        return pm_matmul(g, x, false, c->matrix, true);
    }
    return pm_matmul(g, pm_matmul(g, x, false, c->matrix, false), false, c->matrix, true);
}

// Returns K d over the support.
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

// Returns x minus its component along `direction`: the share (x . measure) / square of it.
static pm_node remove_along(pm_graph *g, pm_node x, pm_node measure, pm_node direction,
                            pm_node square) {
    const pm_node share = pm_div(g, pm_dot(g, x, measure), square);
    return pm_sub(g, x, pm_mul(g, share, direction));
}

// Returns P^T K P d, which is orthogonal to the normal. Each second pass removes the rounding error
// of the first one, which is proportional to the part that the first pass removed. A learned skew
// matrix may be much larger than what is left of its effect; the rate therefore loses its component
// along P d, too, which is nothing but rounding.
static pm_node apply_projected(const construction *c, pm_node d, pm_node normal) {
    pm_graph *g = c->g;
    const pm_node metric = pm_square(g, c->scale);
    const pm_node weighted = pm_mul(g, normal, metric); // W n
    const pm_node square = pm_offset(g, pm_dot(g, normal, weighted), SMALLEST_NORMAL);
    const bool learned = c->matrix != PM_NO_NODE;
    pm_node projected = d;
    for (int i = 0; i < (learned ? 2 : 1); ++i) {
        projected = remove_along(g, projected, weighted, normal, square);
    }
    pm_node rate = apply(c, projected);
    for (int i = 0; i < 2; ++i) {
        rate = remove_along(g, rate, normal, weighted, square);
    }
    if (learned && c->op->kind == PM_REVERSIBLE) {
        const pm_node own = pm_mul(g, projected, metric);
        const pm_node size = pm_offset(g, pm_dot(g, projected, own), SMALLEST_NORMAL);
        rate = remove_along(g, rate, projected, own, size);
    }
    return rate;
}

// Returns the rate of an operator with `heats` (dissipation.h).
static pm_node apply_dissipation(const construction *c, const pm_params *params, pm_node d,
                                 pm_node normal) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const pm_node rows = from_frame(c, pm_transpose(g, c->matrix));
    const pm_shape shape = {true, 1, c->support.n};
    const bool shared = pm_support_heats(spec, c->site) > 1;
    pm_dissipation dissipation = {
        .driving = pm_broadcast_to(g, d, shape),
        .normal = pm_broadcast_to(g, normal, shape),
        .factor = pm_mul(g, rows, c->scale),
        .power = pm_network_param(g, params, c->op->prefix, "power"),
        .reference = pm_network_param(g, params, c->op->prefix, "temperature"),
        .warmth = pm_warmth(g, params),
        .split = shared ? pm_network_param(g, params, c->op->prefix, "split") : PM_NO_NODE,
        .ratio_power =
            shared ? pm_network_param(g, params, c->op->prefix, "ratio_power") : PM_NO_NODE,
        .strength = PM_NO_NODE,
    };
    if (spec->strength != NULL) {
        pm_operator_name name;
        pm_operator_join(name, c->op->prefix, "strength");
        dissipation.strength =
            pm_network_build(g, spec->strength, &c->site->symbols, spec->rank, params, name);
    }
    for (int i = 0; i < c->support.ngroup; ++i) {
        const bool heated = pm_is_listed(spec->nheats, spec->heats, c->support.group[i]->name);
        for (int k = 0; k < c->support.group[i]->size && heated; ++k) {
            dissipation.heat[dissipation.nheat++] = c->support.first[i] + k;
        }
    }
    return pm_dissipation_build(g, &dissipation);
}

// Restrict a row [1][site->n] to the support [1][support.n], and extend it again with zeros.
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

// Returns the rate over the support of the operator without given irreversible pairs: with the
// projection in the hard form, and with the penalty in the soft form.
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
    *degeneracy = pm_concat_or(c->g, *degeneracy, residual);
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

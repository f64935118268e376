// Builds the rate of all dissipative processes (dissipation.h) at once.
#include "model/dissipation.h"

// Keeps the square roots differentiable where a temperature is zero.
#define SMALLEST_SQUARE 1e-200

// Returns the columns of x [rows][n] at the places of the entropies, side by side [rows][nheat].
static pm_node heats_of(pm_graph *g, const pm_dissipation *d, pm_node x) {
    pm_node part[PM_MAX_HEATS];
    for (int k = 0; k < d->nheat; ++k) {
        part[k] = pm_slice(g, x, d->heat[k], 1);
    }
    return pm_concat(g, d->nheat, part);
}

// Returns x [rows][n] with zeros at the places of the entropies.
static pm_node others_of(pm_graph *g, const pm_dissipation *d, pm_node x) {
    const pm_shape shape = pm_graph_shape(g, x);
    pm_node part[2 * PM_MAX_HEATS + 1];
    int count = 0, at = 0;
    for (int k = 0; k < d->nheat; ++k) {
        if (d->heat[k] > at) {
            part[count++] = pm_slice(g, x, at, d->heat[k] - at);
        }
        part[count++] = pm_constant(g, 0, shape.rows, 1);
        at = d->heat[k] + 1;
    }
    if (at < shape.cols) {
        part[count++] = pm_slice(g, x, at, shape.cols - at);
    }
    return pm_concat(g, count, part);
}

// Returns a row [1][n] with x [1][nheat] at the places of the entropies, and zeros elsewhere.
static pm_node place_heats(pm_graph *g, const pm_dissipation *d, pm_node x, int n) {
    pm_node sum = PM_NO_NODE;
    for (int k = 0; k < d->nheat; ++k) {
        sum = pm_add_or(g, sum, pm_place(g, pm_slice(g, x, k, 1), d->heat[k], n));
    }
    return sum;
}

static pm_node positive(pm_graph *g, pm_node x) {
    return pm_sqrt(g, pm_offset(g, pm_square(g, x), SMALLEST_SQUARE));
}

// The nodes that the rate and the forces of all processes share.
typedef struct processes {
    pm_node share;       // lambda [rank][nheat]: each row has the sum 1
    pm_node rest;        // 1 - lambda
    pm_node temperature; // [1][nheat]
    pm_node mean;        // m [1][rank]
    pm_node warmth;      // w [1][1]
    pm_node u;           // [rank][n]
    pm_node h, root;     // [rank][nheat], sqrt(m w) [1][rank]; PM_NO_NODE: one entropy
    pm_node force;       // [1][rank]
} processes;

static processes find_processes(pm_graph *g, const pm_dissipation *d) {
    const pm_node dh = heats_of(g, d, d->driving), nh = heats_of(g, d, d->normal);
    const int rank = pm_graph_shape(g, d->factor).rows;
    processes p = {.h = PM_NO_NODE, .root = PM_NO_NODE};
    if (d->split == PM_NO_NODE) {
        p.share = pm_constant(g, 1.0 / d->nheat, rank, d->nheat);
    } else {
        const pm_node part[2] = {pm_constant(g, 1, rank, 1), pm_exp(g, d->split)};
        const pm_node weight = pm_concat(g, 2, part);
        const pm_node one = pm_constant(g, 1, rank, d->nheat);
        p.share = pm_div(g, weight, pm_dot(g, weight, one));
    }
    p.u = others_of(g, d, d->factor);
    p.force = pm_matmul(g, d->normal, false, p.u, true);
    p.temperature = pm_div(g, nh, dh);
    p.rest = pm_offset(g, pm_scale(g, p.share, -1), 1);
    p.mean =
        positive(g, d->nheat > 1 ? pm_scale(g, pm_matmul(g, p.temperature, false, p.rest, true),
                                            1.0 / (d->nheat - 1))
                                 : pm_matmul(g, p.temperature, false, p.share, true));
    p.warmth = d->warmth == PM_NO_NODE ? pm_constant(g, 1, 1, 1) : pm_exp(g, d->warmth);
    if (d->nheat > 1) { // with one entropy heat has nowhere to go
        p.h = heats_of(g, d, d->factor);
        p.root = pm_sqrt(g, pm_mul(g, p.mean, p.warmth));
        p.force = pm_add(g, p.force, pm_mul(g, p.root, pm_matmul(g, dh, false, p.h, true)));
    }
    return p;
}

pm_node pm_dissipation_force(pm_graph *g, const pm_dissipation *d) {
    return find_processes(g, d).force;
}

pm_node pm_dissipation_build(pm_graph *g, const pm_dissipation *d) {
    const pm_node dh = heats_of(g, d, d->driving), nh = heats_of(g, d, d->normal);
    const pm_node coldness = pm_div(g, dh, nh); // 1/T [1][nheat]
    const int n = pm_graph_shape(g, d->factor).cols;
    const processes p = find_processes(g, d);
    const pm_node theta = pm_matmul(g, coldness, false, p.share, true); // [1][rank]
    pm_node drive = pm_matmul(g, d->driving, false, p.u, true);
    if (d->nheat > 1) {
        drive = pm_add(g, drive,
                       pm_mul(g, p.root, pm_matmul(g, pm_mul(g, dh, coldness), false, p.h, true)));
    }
    const pm_node size = positive(g, theta);
    pm_node flow = pm_div(g, pm_sub(g, drive, pm_mul(g, p.force, theta)), size);
    if (d->power != PM_NO_NODE) {
        const pm_node relative = pm_div(g, p.mean, pm_mul(g, d->reference, p.warmth));
        pm_node exponent = pm_mul(g, d->power, pm_log(g, relative));
        if (d->ratio_power != PM_NO_NODE) {
            const pm_node size_of = pm_log(g, positive(g, p.temperature));
            const pm_node ratio = pm_sub(
                g, pm_log(g, p.mean),
                pm_scale(g, pm_matmul(g, size_of, false, p.rest, true), 1.0 / (d->nheat - 1)));
            exponent = pm_add(g, exponent, pm_mul(g, d->ratio_power, ratio));
        }
        flow = pm_mul(g, flow, pm_exp(g, exponent));
    }
    if (d->strength != PM_NO_NODE) {
        flow = pm_mul(g, flow, pm_exp(g, d->strength));
    }
    pm_node heat = pm_scale(
        g, pm_div(g, pm_matmul(g, pm_mul(g, flow, p.force), false, p.share, false), nh), -1);
    if (p.h != PM_NO_NODE) {
        const pm_node carried = pm_matmul(g, pm_mul(g, flow, p.root), false, p.h, false);
        heat = pm_add(g, heat, pm_mul(g, carried, coldness));
    }
    const pm_node moved = pm_matmul(g, flow, false, p.u, false);
    const pm_node rate = pm_add(g, moved, place_heats(g, d, heat, n));
    // Subtracts the rounding error of the energy balance n . rate from the heat.
    const pm_node excess = pm_scale(g, pm_dot(g, rate, d->normal), 1.0 / d->nheat);
    return pm_sub(g, rate, place_heats(g, d, pm_div(g, excess, nh), n));
}

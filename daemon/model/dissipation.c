// Builds the rate of the processes of dissipation.h, all of them at once.
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

pm_node pm_dissipation_build(pm_graph *g, const pm_dissipation *d) {
    const pm_node dh = heats_of(g, d, d->driving), nh = heats_of(g, d, d->normal);
    const pm_node coldness = pm_div(g, dh, nh); // 1/T [1][nheat]
    const pm_shape shape = pm_graph_shape(g, d->factor);
    const int rank = shape.rows, n = shape.cols;
    // lambda [rank][nheat]: positive numbers, of which each row has the sum 1.
    pm_node share;
    if (d->split == PM_NO_NODE) {
        share = pm_constant(g, 1.0 / d->nheat, rank, d->nheat);
    } else {
        const pm_node part[2] = {pm_constant(g, 1, rank, 1), pm_exp(g, d->split)};
        const pm_node weight = pm_concat(g, 2, part);
        const pm_node one = pm_constant(g, 1, rank, d->nheat);
        share = pm_div(g, weight, pm_dot(g, weight, one));
    }
    const pm_node theta = pm_matmul(g, coldness, false, share, true); // [1][rank]
    const pm_node u = others_of(g, d, d->factor);
    pm_node power = pm_matmul(g, d->normal, false, u, true); // F [1][rank]
    pm_node drive = pm_matmul(g, d->driving, false, u, true);
    const pm_node temperature = pm_div(g, nh, dh);
    const pm_node rest = pm_offset(g, pm_scale(g, share, -1), 1); // 1 - lambda
    const pm_node mean =
        positive(g, d->nheat > 1 ? pm_scale(g, pm_matmul(g, temperature, false, rest, true),
                                            1.0 / (d->nheat - 1))
                                 : pm_matmul(g, temperature, false, share, true)); // m [1][rank]
    const pm_node warmth = d->warmth == PM_NO_NODE ? pm_constant(g, 1, 1, 1) : pm_exp(g, d->warmth);
    pm_node root = PM_NO_NODE, h = PM_NO_NODE;
    if (d->nheat > 1) { // with one entropy heat has nowhere to go
        h = heats_of(g, d, d->factor);
        root = pm_sqrt(g, pm_mul(g, mean, warmth));
        power = pm_add(g, power, pm_mul(g, root, pm_matmul(g, dh, false, h, true)));
        drive = pm_add(g, drive,
                       pm_mul(g, root, pm_matmul(g, pm_mul(g, dh, coldness), false, h, true)));
    }
    const pm_node size = positive(g, theta);
    pm_node flow = pm_div(g, pm_sub(g, drive, pm_mul(g, power, theta)), size);
    if (d->power != PM_NO_NODE) {
        const pm_node relative = pm_div(g, mean, pm_mul(g, d->reference, warmth));
        pm_node exponent = pm_mul(g, d->power, pm_log(g, relative));
        if (d->ratio_power != PM_NO_NODE) {
            const pm_node size_of = pm_log(g, positive(g, temperature));
            const pm_node ratio =
                pm_sub(g, pm_log(g, mean),
                       pm_scale(g, pm_matmul(g, size_of, false, rest, true), 1.0 / (d->nheat - 1)));
            exponent = pm_add(g, exponent, pm_mul(g, d->ratio_power, ratio));
        }
        flow = pm_mul(g, flow, pm_exp(g, exponent));
    }
    if (d->strength != PM_NO_NODE) {
        flow = pm_mul(g, flow, pm_exp(g, d->strength));
    }
    pm_node heat =
        pm_scale(g, pm_div(g, pm_matmul(g, pm_mul(g, flow, power), false, share, false), nh), -1);
    if (h != PM_NO_NODE) {
        const pm_node carried = pm_matmul(g, pm_mul(g, flow, root), false, h, false);
        heat = pm_add(g, heat, pm_mul(g, carried, coldness));
    }
    const pm_node moved = pm_matmul(g, flow, false, u, false);
    const pm_node rate = pm_add(g, moved, place_heats(g, d, heat, n));
    // Subtracts the rounding error of the energy balance n . rate from the heat.
    const pm_node excess = pm_scale(g, pm_dot(g, rate, d->normal), 1.0 / d->nheat);
    return pm_sub(g, rate, place_heats(g, d, pm_div(g, excess, nh), n));
}

// Computes energy, entropy and rates of a chain by formulas written out by hand.
#include "truth/chain.h"

#include <math.h>

// Computes the vector from one end of link k to the other, m, and returns its length.
static double stretch(const double *z, int k, double vector[2]) {
    for (int i = 0; i < 2; ++i) {
        vector[i] = z[pm_chain_q(k) + i] - (k > 0 ? z[pm_chain_q(k - 1) + i] : 0);
    }
    return hypot(vector[0], vector[1]);
}

static double log_stretch(const pm_chain *chain, const double *z, int k) {
    double vector[2];
    return log(stretch(z, k, vector) / chain->link[k].l0);
}

double pm_chain_temperature(const pm_chain *chain, const double *z, int k) {
    const pm_chain_link *link = &chain->link[k];
    const double s = z[pm_chain_s(chain, k)];
    return chain->reference_temperature * exp((s - link->b * log_stretch(chain, z, k)) / link->c);
}

// Sets qdot = p/m and pdot: the tension of link k pulls its two ends together.
static void mechanical_rate(const pm_chain *chain, const double *z, const double *T, double *zdot) {
    const int n = chain->n;
    for (int i = 0; i < 2 * n; ++i) {
        zdot[i] = z[2 * n + i] / chain->link[i / 2].mass;
        zdot[2 * n + i] = 0;
    }
    for (int k = 0; k < n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        double vector[2];
        const double l = stretch(z, k, vector);
        const double warmer = T[k] - chain->reference_temperature;
        const double tension = (link->C * log(l / link->l0) - link->b * warmer) / l;
        for (int i = 0; i < 2; ++i) {
            const double force = tension * vector[i] / l;
            zdot[pm_chain_p(chain, k) + i] -= force;
            if (k > 0) {
                zdot[pm_chain_p(chain, k - 1) + i] += force;
            }
        }
    }
}

// Replaces the temperatures T [n] by sdot, which heat conduction between neighbours gives.
static void thermal_rate(const pm_chain *chain, double *T) {
    double heat_before = 0; // W, into the link before
    for (int k = 0; k < chain->n; ++k) {
        const double heat = k + 1 < chain->n ? chain->conductivity * (T[k + 1] - T[k]) : 0;
        T[k] = heat / T[k] - heat_before / T[k];
        heat_before = heat;
    }
}

void pm_chain_rate(const pm_chain *chain, const double *z, double *zdot) {
    double *T = zdot + pm_chain_s(chain, 0); // in the place of sdot
    for (int k = 0; k < chain->n; ++k) {
        T[k] = pm_chain_temperature(chain, z, k);
    }
    mechanical_rate(chain, z, T, zdot);
    thermal_rate(chain, T);
}

// --- the pattern of the Jacobian ---

// Adds the rates of the components `first` to `first + count - 1` of each link from number `begin`
// to number `end` - 1 that there is; the components of a link lie `step` apart from those of the
// next.
static void add_rows(const pm_chain *chain, int begin, int end, int first, int step, int count,
                     int *row, int *n) {
    for (int k = begin < 0 ? 0 : begin; k < end && k < chain->n; ++k) {
        for (int i = 0; i < count; ++i) {
            row[(*n)++] = first + step * k + i;
        }
    }
}

// Lists the rates that depend on component `column` of the state, in ascending order, in row.
static int list_rows(const pm_chain *chain, int column, int *row) {
    const int p = pm_chain_p(chain, 0), s = pm_chain_s(chain, 0);
    int n = 0;
    if (column < p) { // q_k stretches links k and k+1, which pull and conduct heat
        const int k = column / 2;
        row[n++] = column;
        add_rows(chain, k - 1, k + 2, p, 2, 2, row, &n);
        add_rows(chain, k - 1, k + 3, s, 1, 1, row, &n);
    } else if (column < s) { // p_k moves mass k
        row[n++] = column - p;
        row[n++] = column;
    } else { // s_k warms link k
        const int k = column - s;
        add_rows(chain, k - 1, k + 1, p, 2, 2, row, &n);
        add_rows(chain, k - 1, k + 2, s, 1, 1, row, &n);
    }
    return n;
}

const pm_ode_pattern *pm_chain_pattern(const pm_chain *chain, pm_arena *arena) {
    enum { MOST_ROWS = 11 };
    const int nz = 5 * chain->n;
    pm_ode_pattern *pattern = pm_arena_alloc(arena, sizeof *pattern);
    int *start = pm_arena_array(arena, (size_t)nz + 1, sizeof *start);
    int *row = pm_arena_array(arena, (size_t)nz * MOST_ROWS, sizeof *row);
    if (pattern == NULL || start == NULL || row == NULL) {
        return NULL;
    }
    for (int j = 0; j < nz; ++j) {
        start[j + 1] = start[j] + list_rows(chain, j, row + start[j]);
    }
    *pattern = (pm_ode_pattern){.start = start, .row = row};
    return pattern;
}

double pm_chain_energy(const pm_chain *chain, const double *z) {
    const double Tr = chain->reference_temperature;
    double energy = 0;
    for (int k = 0; k < chain->n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        const double *p = z + pm_chain_p(chain, k);
        const double x = log_stretch(chain, z, k);
        energy += (p[0] * p[0] + p[1] * p[1]) / (2 * link->mass);
        energy += 0.5 * link->C * x * x + link->b * Tr * x;
        energy += link->c * (pm_chain_temperature(chain, z, k) - Tr);
    }
    return energy;
}

double pm_chain_entropy(const pm_chain *chain, const double *z) {
    double entropy = 0;
    for (int k = 0; k < chain->n; ++k) {
        entropy += z[pm_chain_s(chain, k)];
    }
    return entropy;
}

double pm_chain_angular_momentum(const pm_chain *chain, const double *z) {
    double sum = 0;
    for (int k = 0; k < chain->n; ++k) {
        const double *q = z + pm_chain_q(k), *p = z + pm_chain_p(chain, k);
        sum += q[0] * p[1] - q[1] * p[0];
    }
    return sum;
}

void pm_chain_set_temperatures(const pm_chain *chain, const double *T, double *z) {
    for (int k = 0; k < chain->n; ++k) {
        const pm_chain_link *link = &chain->link[k];
        z[pm_chain_s(chain, k)] =
            link->b * log_stretch(chain, z, k) + link->c * log(T[k] / chain->reference_temperature);
    }
}

void pm_chain_equilibrate(const pm_chain *chain, double total, double *z) {
    double elastic = 0, capacity = 0;
    for (int k = 0; k < chain->n; ++k) {
        elastic += chain->link[k].b * log_stretch(chain, z, k);
        capacity += chain->link[k].c;
    }
    double *T = z + pm_chain_s(chain, 0);
    for (int k = 0; k < chain->n; ++k) {
        T[k] = chain->reference_temperature * exp((total - elastic) / capacity);
    }
    pm_chain_set_temperatures(chain, T, z);
}

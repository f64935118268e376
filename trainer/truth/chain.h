// The physics of a chain of thermoelastic links in the plane, in absolute coordinates. Link k is a
// logarithmic spring with an entropy, from mass k-1 (link 0: from a fixed pivot at the origin) to
// mass k; neighbouring links conduct heat. Two links: the double thermoelastic pendulum of Romero,
// Int. J. Numer. Meth. Engng 79 (2009) 706.
//
// With l the length, s the entropy, Tr the reference temperature and x = ln(l/l0):
//     T = Tr exp((s - b x) / c)                        temperature, K
//     e = C/2 x^2 + b Tr x + c (T - Tr)                internal energy, J; T = de/ds
//     f = de/dl = (C x - b (T - Tr)) / l               tension, N
// conduction between neighbours i, j: sdot_i = K (T_j/T_i - 1), so that T_i sdot_i + T_j sdot_j =
// 0.
#ifndef PM_TRAINER_TRUTH_CHAIN_H
#define PM_TRAINER_TRUTH_CHAIN_H

#define PM_CHAIN_MAX_LINKS 32

typedef struct pm_chain_link {
    double mass; // kg, at the link's far end
    double C;    // J
    double l0;   // m
    double b;    // J/K
    double c;    // J/K
} pm_chain_link;

// The state z [5n]: q_1 .. q_n [2] m, p_1 .. p_n [2] kg m/s, s_1 .. s_n J/K.
typedef struct pm_chain {
    int n;
    double conductivity;          // K, W/K
    double reference_temperature; // Tr, K
    pm_chain_link link[PM_CHAIN_MAX_LINKS];
} pm_chain;

// Where each kind of variable of link k begins in the state.
static inline int pm_chain_q(int k) {
    return 2 * k;
}
static inline int pm_chain_p(const pm_chain *chain, int k) {
    return 2 * (chain->n + k);
}
static inline int pm_chain_s(const pm_chain *chain, int k) {
    return 4 * chain->n + k;
}

// zdot [5n] at z [5n].
void pm_chain_rate(const pm_chain *chain, const double *z, double *zdot);

double pm_chain_energy(const pm_chain *chain, const double *z);           // J
double pm_chain_entropy(const pm_chain *chain, const double *z);          // J/K
double pm_chain_angular_momentum(const pm_chain *chain, const double *z); // kg m^2/s, at the pivot
double pm_chain_temperature(const pm_chain *chain, const double *z, int k); // K

// Sets the entropies of z from its positions: link k gets temperature T [n] ...
void pm_chain_set_temperatures(const pm_chain *chain, const double *T, double *z);
// ... or all get the one temperature for which the entropies sum to `total` J/K.
void pm_chain_equilibrate(const pm_chain *chain, double total, double *z);

#endif

// The physics of a chain of thermoelastic links in the plane, in absolute coordinates. Link k is a
// spring with an entropy, between mass k-1 (for link 0 a fixed pivot at the origin) and mass k.
// Neighbouring links conduct heat. With two links this is the double thermoelastic pendulum of
// Romero, Int. J. Numer. Meth. Engng 79 (2009) 706.
//
// With the length l, the entropy s, the reference temperature Tr and x = ln(l/l0):
//     T = Tr exp((s - b x) / c)                        temperature, K
//     e = C/2 x^2 + b Tr x + c (T - Tr)                internal energy, J; T = de/ds
//     f = de/dl = (C x - b (T - Tr)) / l               tension, N
// Conduction with the conductance K between neighbours i and j conserves energy:
//     sdot_i = K (T_j/T_i - 1),   so that T_i sdot_i + T_j sdot_j = 0
#ifndef PM_TRAINER_TRUTH_CHAIN_H
#define PM_TRAINER_TRUTH_CHAIN_H

#include "base/arena.h"
#include "truth/ode.h"

typedef struct pm_chain_link {
    double mass; // kg, at the link's far end
    double C;    // J
    double l0;   // m
    double b;    // J/K
    double c;    // J/K
} pm_chain_link;

// The state z [5n] of a chain of n links holds the positions q_1 to q_n (m, two components each),
// then the momenta p_1 to p_n (kg m/s, two components each), then the entropies s_1 to s_n (J/K).
// The links are borrowed.
typedef struct pm_chain {
    int n;
    double conductivity;          // K, W/K
    double reference_temperature; // Tr, K
    const pm_chain_link *link;    // [n]
} pm_chain;

// Returns the first component of position, momentum and entropy of link k in the state.
static inline int pm_chain_q(int k) {
    return 2 * k;
}
static inline int pm_chain_p(const pm_chain *chain, int k) {
    return 2 * (chain->n + k);
}
static inline int pm_chain_s(const pm_chain *chain, int k) {
    return 4 * chain->n + k;
}

// Computes zdot [5n] at the state z [5n].
void pm_chain_rate(const pm_chain *chain, const double *z, double *zdot);

// Returns, in the arena, on which components of the state each rate depends. A link depends on its
// two neighbours on either side, so that the work for a Jacobian grows with n and not with its
// square. NULL: out of memory.
const pm_ode_pattern *pm_chain_pattern(const pm_chain *chain, pm_arena *arena);

double pm_chain_energy(const pm_chain *chain, const double *z);  // total energy, J
double pm_chain_entropy(const pm_chain *chain, const double *z); // total entropy, J/K
double pm_chain_angular_momentum(const pm_chain *chain,
                                 const double *z); // about the pivot, kg m^2/s
double pm_chain_temperature(const pm_chain *chain, const double *z, int k); // of link k, K

// Sets the entropies of z, given its positions, such that link k has the temperature T[k], T [n] K.
// T may be the place of the entropies in z.
void pm_chain_set_temperatures(const pm_chain *chain, const double *T, double *z);
// Sets the entropies of z, given its positions, such that all links have the same temperature and
// the entropies sum to `total` J/K.
void pm_chain_equilibrate(const pm_chain *chain, double total, double *z);

#endif

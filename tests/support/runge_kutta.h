// The classical Runge-Kutta method of order 4, by which tests simulate their own data.
#ifndef PM_TESTS_SUPPORT_RUNGE_KUTTA_H
#define PM_TESTS_SUPPORT_RUNGE_KUTTA_H

#define RUNGE_KUTTA_MOST 8 // components

// Advances z [n] by one step of h s. `rates` writes the rate [n] of a state [n], per s.
static inline void runge_kutta_step(int n, void (*rates)(const double *z, double *rate), double h,
                                    double *z) {
    double k[4][RUNGE_KUTTA_MOST], at[RUNGE_KUTTA_MOST];
    for (int stage = 0; stage < 4; ++stage) {
        const double part = stage == 0 ? 0 : stage == 3 ? h : h / 2;
        for (int c = 0; c < n; ++c) {
            at[c] = z[c] + (stage == 0 ? 0 : part * k[stage - 1][c]);
        }
        rates(at, k[stage]);
    }
    for (int c = 0; c < n; ++c) {
        z[c] += h / 6 * (k[0][c] + 2 * k[1][c] + 2 * k[2][c] + k[3][c]);
    }
}

#endif

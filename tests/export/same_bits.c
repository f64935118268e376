// same_bits SCENE STEPS: an exported scene, whose name is the macro NAME, takes the steps of the
// same scene in libportmet with the same bits. Its rates have the derivatives that its tangent
// says. Built by test_export.sh as strictly as an exported source must be.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <portmet.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define MEMBER(suffix) JOIN(NAME, suffix)
enum {
    STATES = MEMBER(_states),
    INPUTS = MEMBER(_inputs),
    SUBSYSTEMS = MEMBER(_subsystems),
    FLUXES = 4 * MEMBER(_ports)
};

static int failures;

static void fail(const char *what, long step, int i, double found, double expected) {
    if (failures++ < 10) {
        printf("FAILED: %s %d after step %ld: %.17g, expected %.17g\n", what, i, step, found,
               expected);
    }
}

static void compare(const char *what, long step, int n, const double *found,
                    const double *expected) {
    for (int i = 0; i < n; ++i) {
        if (memcmp(found + i, expected + i, sizeof *found) != 0) {
            fail(what, step, i, found[i], expected[i]);
        }
    }
}

// The tangent against a central difference, whose error is that of rounding and of its step.
static void check_tangent(const NAME *s) {
    const double h = 1e-6;
    double dz[STATES], du[INPUTS + 1], z[STATES], u[INPUTS + 1], scale = 0;
    double d_rate[STATES], d_energy[SUBSYSTEMS], d_entropy[SUBSYSTEMS], d_flux[FLUXES + 1];
    double rate[2][STATES], energy[2][SUBSYSTEMS], entropy[2][SUBSYSTEMS], flux[2][FLUXES + 1];
    for (int i = 0; i < STATES; ++i) {
        dz[i] = sin(1.0 + i);
    }
    for (int i = 0; i < INPUTS; ++i) {
        du[i] = s->u[i] != 0 ? cos(1.0 + i) : 0; // a dS that is zero may have no derivative
    }
    MEMBER(_tangent)(s->z, dz, s->u, du, d_rate, d_energy, d_entropy, d_flux);
    for (int side = 0; side < 2; ++side) {
        const double step = side == 0 ? -h : h;
        for (int i = 0; i < STATES; ++i) {
            z[i] = s->z[i] + step * dz[i];
        }
        for (int i = 0; i < INPUTS; ++i) {
            u[i] = s->u[i] + step * du[i];
        }
        MEMBER(_rates)(z, u, rate[side]);
        MEMBER(_outputs)(z, u, energy[side], entropy[side], flux[side]);
    }
    for (int i = 0; i < STATES; ++i) {
        scale = fmax(scale, fabs(d_rate[i]));
    }
    for (int i = 0; i < STATES; ++i) {
        const double slope = (rate[1][i] - rate[0][i]) / (2 * h);
        if (!(fabs(slope - d_rate[i]) < 1e-5 * scale)) {
            fail("tangent of rate", s->step, i, d_rate[i], slope);
        }
    }
    for (int i = 0; i < SUBSYSTEMS; ++i) {
        const double slope = (energy[1][i] - energy[0][i]) / (2 * h);
        if (!(fabs(slope - d_energy[i]) < 1e-5 * fmax(1, fabs(slope)))) {
            fail("tangent of energy", s->step, i, d_energy[i], slope);
        }
    }
    double most = 1e-3;
    for (int i = 0; i < FLUXES; i += 2) {
        most = fmax(most, fabs(d_flux[i]));
    }
    for (int i = 0; i < FLUXES; i += 2) {
        const double slope = (flux[1][i] - flux[0][i]) / (2 * h);
        if (!(fabs(slope - d_flux[i]) < 1e-5 * most)) {
            fail("tangent of flux", s->step, i, d_flux[i], slope);
        }
    }
}

int main(int argc, char **argv) {
    portmet_scene *scene;
    NAME s;
    double energy[SUBSYSTEMS], entropy[SUBSYSTEMS], flux[FLUXES + 1];
    if (argc != 3 || portmet_scene_open(&scene, argv[1], NULL) != PORTMET_OK) {
        printf("FAILED: %s\n", portmet_error());
        return 1;
    }
    const long steps = atol(argv[2]);
    double *held = portmet_scene_inputs(scene, NULL);
    MEMBER(_init)(&s);
    for (long k = 0; k <= steps && failures == 0; ++k) {
        MEMBER(_outputs)(s.z, s.u, energy, entropy, flux);
        compare("state", k, STATES, s.z, portmet_scene_array(scene, PORTMET_STATE, NULL));
        compare("energy", k, SUBSYSTEMS, energy, portmet_scene_array(scene, PORTMET_ENERGY, NULL));
        compare("entropy", k, SUBSYSTEMS, entropy,
                portmet_scene_array(scene, PORTMET_ENTROPY, NULL));
        if (k % 20 == 0) {
            check_tangent(&s);
        }
        // Inputs change from step to step, and hold over each.
        for (int i = 0; i < INPUTS; ++i) {
            s.u[i] += 0.01 * fabs(s.u[i]) * sin(0.1 * (double)k + i);
            held[i] = s.u[i];
        }
        if (portmet_scene_step(scene, 1) != PORTMET_OK) {
            printf("FAILED: %s\n", portmet_error());
            return 1;
        }
        MEMBER(_step)(&s);
    }
    portmet_scene_close(scene);
    return failures > 0;
}

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

// Compares derivatives with central differences, whose error is that of rounding and of their step.
static void check_slopes(const char *what, long step, int n, const double *found,
                         const double *before, const double *behind, double h, double least) {
    double most = least;
    for (int i = 0; i < n; ++i) {
        most = fmax(most, fabs(found[i]));
    }
    for (int i = 0; i < n; ++i) {
        const double slope = (behind[i] - before[i]) / (2 * h);
        if (!(fabs(slope - found[i]) < 1e-5 * most)) {
            fail(what, step, i, found[i], slope);
        }
    }
}

static void check_tangent(const NAME *s) {
    const double h = 1e-6;
    double dz[STATES], du[INPUTS + 1], z[STATES], u[INPUTS + 1];
    MEMBER(_results) d, side[2];
    for (int i = 0; i < STATES; ++i) {
        dz[i] = sin(1.0 + i);
    }
    for (int i = 0; i < INPUTS; ++i) {
        du[i] = s->u[i] != 0 ? cos(1.0 + i) : 0; // a dS that is zero may have no derivative
    }
    MEMBER(_tangent)(s->z, dz, s->u, du, &d);
    for (int k = 0; k < 2; ++k) {
        const double step = k == 0 ? -h : h;
        for (int i = 0; i < STATES; ++i) {
            z[i] = s->z[i] + step * dz[i];
        }
        for (int i = 0; i < INPUTS; ++i) {
            u[i] = s->u[i] + step * du[i];
        }
        MEMBER(_outputs)(z, u, &side[k]);
    }
#define CHECK(member, n, least)                                                                  \
    check_slopes("tangent of " #member, s->step, n, d.member, side[0].member, side[1].member, h, \
                 least)
    CHECK(rate, STATES, 0);
    CHECK(energy, SUBSYSTEMS, 1);
    CHECK(flux, FLUXES, 1e-3);
    CHECK(dE, STATES, 1e-3);
    CHECK(reaction, INPUTS / 3, 1e-3);
}

int main(int argc, char **argv) {
    portmet_scene *scene;
    NAME s;
    MEMBER(_results) results;
    double rate[STATES], coenergy[STATES], reaction[INPUTS / 3 + 1];
    if (argc != 3 || portmet_scene_open(&scene, argv[1], NULL) != PORTMET_OK) {
        printf("FAILED: %s\n", portmet_error());
        return 1;
    }
    const long steps = atol(argv[2]);
    double *held = portmet_scene_inputs(scene, NULL);
    MEMBER(_init)(&s);
    for (long k = 0; k <= steps && failures == 0; ++k) {
        MEMBER(_outputs)(s.z, s.u, &results);
        MEMBER(_rates)(s.z, s.u, rate);
        compare("rate", k, STATES, results.rate, rate);
        compare("state", k, STATES, s.z, portmet_scene_array(scene, PORTMET_STATE, NULL));
        compare("energy", k, SUBSYSTEMS, results.energy,
                portmet_scene_array(scene, PORTMET_ENERGY, NULL));
        compare("entropy", k, SUBSYSTEMS, results.entropy,
                portmet_scene_array(scene, PORTMET_ENTROPY, NULL));
        if (portmet_scene_efforts(scene, coenergy, reaction) != PORTMET_OK) {
            printf("FAILED: %s\n", portmet_error());
            return 1;
        }
        compare("co-energy", k, STATES, results.dE, coenergy);
        compare("reaction", k, INPUTS / 3, results.reaction, reaction);
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

// Proposals of training files: quaternions, for both orders of their components and angular momenta
// in both frames.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "propose/view.h"
#include "tests/support/proposal.h"
#include "tests/support/unit.h"

#define BODY                                                      \
    "scene: body\n"                                               \
    "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 1}\n" \
    "subsystems:\n"                                               \
    "  body:\n"                                                   \
    "    weights: body.h5\n"                                      \
    "    state:\n"                                                \
    "      q: {unit: \"1\", columns: [a, b, c, d]}\n"             \
    "      M: {unit: kg m^2/s, columns: [x, y, z]}\n"             \
    "      s: {unit: J/K, columns: [s]}\n"

// Writes the product of the quaternions a and b, whose scalar parts come first.
static void multiply(const double a[4], const double b[4], double product[4]) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        product[1 + i] =
            a[0] * b[1 + i] + b[0] * a[1 + i] + a[1 + j] * b[1 + k] - a[1 + k] * b[1 + j];
    }
}

// Turns a body-fixed vector m into the space-fixed one q m q*.
static void turn(const double q[4], const double m[3], double turned[3]) {
    const double pure[4] = {0, m[0], m[1], m[2]}, back[4] = {q[0], -q[1], -q[2], -q[3]};
    double half[4], whole[4];
    multiply(q, pure, half);
    multiply(half, back, whole);
    memcpy(turned, whole + 1, 3 * sizeof *turned);
}

// A rigid body that a little friction brakes, by explicit steps. The scalar part of the quaternion
// comes first or last, and the angular momentum is seen from the body or from outside.
static pm_dataset *spin(bool scalar_last, bool outside) {
    static const char *const column[] = {"a", "b", "c", "d", "x", "y", "z", "s"};
    static const double inertia[3] = {0.5, 1, 2};
    const double fine = 0.0005;
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 12, 40, 8, 0.05, column), PM_OK);
    for (int k = 0; k < 12; ++k) {
        const double across = sin(k) * sin(3 * k);
        double q[4] = {cos(k), sin(k) * cos(3 * k), across * cos(2 * k), across * sin(2 * k)};
        double M[3] = {1 - 0.2 * k, cos(2 * k), 0.7}, s = 0;
        for (int i = 0; i < 40; ++i) {
            double seen[3];
            memcpy(seen, M, sizeof seen);
            if (outside) {
                turn(q, M, seen);
            }
            const int first = scalar_last ? 1 : 0;
            double *z = pm_dataset_state(d, k, i);
            for (int c = 0; c < 4; ++c) {
                z[c] = q[(c + first) % 4];
            }
            memcpy(z + 4, seen, sizeof seen);
            z[7] = s;
            for (int t = 0; t < 100; ++t) {
                const double w[4] = {0, M[0] / inertia[0], M[1] / inertia[1], M[2] / inertia[2]};
                double rate[4], length = 0, torque[3];
                multiply(q, w, rate);
                for (int c = 0; c < 3; ++c) {
                    const int e = (c + 1) % 3, f = (c + 2) % 3;
                    torque[c] = M[e] * w[1 + f] - M[f] * w[1 + e] - 0.05 * w[1 + c];
                    s += fine * 0.05 * w[1 + c] * w[1 + c] / 300;
                }
                for (int c = 0; c < 3; ++c) {
                    M[c] += fine * torque[c];
                }
                for (int c = 0; c < 4; ++c) {
                    q[c] += fine * rate[c] / 2;
                    length += q[c] * q[c];
                }
                for (int c = 0; c < 4; ++c) {
                    q[c] /= sqrt(length);
                }
            }
        }
    }
    return d;
}

// One of the twelve pairs shows the order and the frame: the second part of the vector, which the
// third component of the angular momentum moves.
static void a_quaternion_is_found_in_each_order_and_frame(void **state) {
    (void)state;
    static const struct {
        bool scalar_last, outside;
        const char *pair;
    } form[] = {{false, false, "[\"q[2]\", \"M[2]\", \"-0.5*q[1]\"]"},
                {false, true, "[\"q[2]\", \"M[2]\", \"0.5*q[1]\"]"},
                {true, false, "[\"q[1]\", \"M[2]\", \"-0.5*q[0]\"]"},
                {true, true, "[\"q[1]\", \"M[2]\", \"0.5*q[0]\"]"}};
    for (size_t i = 0; i < sizeof form / sizeof form[0]; ++i) {
        char text[PM_PROPOSAL_TEXT];
        pm_dataset *d = spin(form[i].scalar_last, form[i].outside);
        propose_text(BODY, d, text);
        pm_dataset_free(d);
        if (strstr(text, "; a quaternion, which turns with M") == NULL ||
            strstr(text, form[i].pair) == NULL || strstr(text, "acts_on: [q") != NULL) {
            fail_msg("expected %s in:\n%s", form[i].pair, text);
        }
    }
}

// The terms are those of the products q w/2 and w q/2.
static void the_terms_are_those_of_products(void **state) {
    (void)state;
    const double q[4] = {0.3, -0.7, 1.1, 0.4}, w[4] = {0, 0.9, -0.2, 0.6};
    for (int k = 0; k < 4; ++k) {
        const pm_quaternion order = {k % 2 == 0 ? 1 : -1, k / 2 == 1};
        double product[4];
        multiply(order.turns > 0 ? q : w, order.turns > 0 ? w : q, product);
        for (int row = 0; row < 4; ++row) {
            const int shift = order.scalar_last ? 1 : 0;
            double rate = 0;
            for (int axis = 0; axis < 3; ++axis) {
                int column;
                const int sign = pm_quaternion_term(order, row, axis, &column);
                rate += sign * q[(column + shift) % 4] * w[1 + axis];
            }
            assert_float_equal(rate, product[(row + shift) % 4], 1e-14);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_quaternion_is_found_in_each_order_and_frame),
        cmocka_unit_test(the_terms_are_those_of_products),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

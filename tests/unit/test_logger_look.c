// The columns of a logger are told apart: positions whose rates several velocities or a lever
// explain, energies of angles, and what passes between parts.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "propose/logger_view.h"

enum { TRAJECTORIES = 10, SAMPLES = 200, MOST = 4 };

typedef struct logged {
    int nz, hidden; // columns, and states that none shows
    const char *const *column;
    const char *unit; // separated by ';'
    double dt;
    void (*rate)(const double *z, double *rate);
} logged;

// Trajectories of a system by the classical method of Runge and Kutta.
static pm_dataset *record(const logged *s) {
    pm_dataset *d = NULL;
    enum { FINE = 10 };
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    assert_int_equal(pm_dataset_new(&d, TRAJECTORIES, SAMPLES, s->nz, s->dt, s->column), PM_OK);
    assert_int_equal(pm_dataset_note(d, "units", "%s", s->unit), PM_OK);
    const double h = s->dt / FINE;
    const int n = s->nz + s->hidden;
    assert_true(n <= MOST);
    for (int i = 0; i < TRAJECTORIES; ++i) {
        double z[MOST];
        for (int c = 0; c < n; ++c) {
            z[c] = 0.6 * cos(1.7 * i + 2.3 * c);
        }
        for (int j = 0; j < FINE * SAMPLES; ++j) {
            double k[MOST] = {0}, sum[MOST] = {0}, y[MOST];
            if (j % FINE == 0) {
                memcpy(pm_dataset_state(d, i, j / FINE), z, (size_t)s->nz * sizeof *z);
            }
            for (int stage = 0; stage < 4; ++stage) {
                for (int c = 0; c < n; ++c) {
                    y[c] = z[c] + h * at[stage] * k[c];
                }
                s->rate(y, k);
                for (int c = 0; c < n; ++c) {
                    sum[c] += weight[stage] * k[c] / 6;
                }
            }
            for (int c = 0; c < n; ++c) {
                z[c] += h * sum[c];
            }
        }
    }
    return d;
}

static void look(pm_logger_view *v, const pm_dataset *d, const pm_logger_hints *hints) {
    assert_int_equal(pm_logger_look(v, d, hints), PM_OK);
}

// --- two bodies of 1 and 3 kg with a spring and a damper between them ---

static void pair_rate(const double *z, double *rate) {
    const double force = 40 * z[2] + 30 * z[2] * z[2] * z[2], rub = 0.8 * (z[1] - z[0]);
    rate[0] = force + rub;
    rate[1] = -(force + rub) / 3;
    rate[2] = z[1] - z[0];
}

static void the_length_of_a_spring_has_two_velocities(void **state) {
    (void)state;
    static const char *const column[] = {"v1", "v2", "d"};
    static const char *const part[] = {"one=v1,d", "two=v2"};
    static const char *const port[] = {"one,two"};
    pm_dataset *d = record(&(logged){3, 0, column, "m/s;m/s;m", 0.02, pair_rate});
    const pm_logger_hints hints = {
        .npart = 2, .part = part, .nport = 1, .port = port, .hidden = -1};
    pm_logger_view v;
    look(&v, d, &hints);
    assert_int_equal(v.column[2].kind, PM_LOGGER_POSITION);
    assert_int_equal(v.column[2].mate, 0); // of its own part
    assert_true(v.column[2].ratio == -1);
    assert_true(v.moves[2][1] == 1);
    assert_true(v.moves[2][0] == 0);
    assert_true(pm_logger_joins(&v, 2, 1));
    assert_true(v.column[0].rubs);
    assert_int_equal(v.nport, 1);
    // The spring pushes both, which tells one inertia from the other.
    assert_true(fabs(v.column[1].inertia / v.column[0].inertia / 3 - 1) < 0.1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a rack on a spring, moved by a shaft ---

#define RADIUS 0.05 // m

static void rack_rate(const double *z, double *rate) {
    rate[0] = -RADIUS * z[1];
    rate[1] = RADIUS * 400 * z[0] - 0.1 * z[1];
}

static void a_shaft_moves_a_rack(void **state) {
    (void)state;
    static const char *const column[] = {"x", "w"};
    pm_dataset *d = record(&(logged){2, 0, column, "m;rad/s", 0.1, rack_rate});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.column[0].kind, PM_LOGGER_POSITION);
    assert_int_equal(v.column[0].mate, 1);
    assert_true(fabs(v.column[0].ratio / -RADIUS - 1) < 0.05);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- angles with a weight and with a spring ---

static void weight_rate(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -90 * sin(2 * z[0]) - 0.05 * z[1];
}

static void spring_rate(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -5 * z[0] - 200 * z[0] * z[0] * z[0] - 0.05 * z[1];
}

static void data_tell_a_weight_from_a_spring(void **state) {
    (void)state;
    static const char *const column[] = {"q", "w"};
    void (*const rate[])(const double *, double *) = {weight_rate, spring_rate};
    for (int k = 0; k < 2; ++k) {
        pm_dataset *d = record(&(logged){2, 0, column, "rad;rad/s", 0.005, rate[k]});
        pm_logger_view v;
        look(&v, d, &(pm_logger_hints){.hidden = -1});
        assert_int_equal(v.column[0].kind, PM_LOGGER_POSITION);
        assert_true(v.column[0].waves == (k == 0));
        assert_true(v.column[0].springs == (k == 1));
        pm_logger_view_free(&v);
        pm_dataset_free(d);
    }
}

// --- parts that do not meet ---

static void apart_rate(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -30 * z[0] - 0.3 * z[1];
    rate[2] = z[3];
    rate[3] = -11 * z[2] - 0.2 * z[3];
}

static void nothing_passes_between_two_springs(void **state) {
    (void)state;
    static const char *const column[] = {"x1", "v1", "x2", "v2"};
    static const char *const part[] = {"one=x1,v1", "two=x2,v2"};
    static const char *const port[] = {"one,two"};
    pm_dataset *d = record(&(logged){4, 0, column, "m;m/s;m;m/s", 0.03, apart_rate});
    const pm_logger_hints hints = {
        .npart = 2, .part = part, .nport = 1, .port = port, .hidden = -1};
    pm_logger_view v;
    look(&v, d, &hints);
    assert_int_equal(v.nport, 0);
    assert_int_equal(v.nidle, 1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a circuit whose resistor heats the housing, which is another part ---

static void heating_rate(const double *z, double *rate) {
    rate[0] = 20 * z[1];
    rate[1] = -20 * z[0] - 2 * z[1];
    rate[2] = 0.5 * z[1] * z[1];
}

static void a_loss_heats_another_part(void **state) {
    (void)state;
    static const char *const column[] = {"i", "u", "T"};
    static const char *const part[] = {"loop=i,u", "housing=T"};
    static const char *const port[] = {"loop,housing"};
    pm_dataset *d = record(&(logged){3, 0, column, "A;V;K", 0.005, heating_rate});
    pm_logger_view v;
    for (int apart = 0; apart < 2; ++apart) {
        const pm_logger_hints hints = {
            .npart = 2 * apart, .part = part, .nport = apart, .port = port, .hidden = -1};
        look(&v, d, &hints);
        assert_true(v.warms[1][2]);
        assert_int_equal(v.nport, apart);
        assert_true(pm_logger_joins(&v, 1, 2) == (apart == 1));
        pm_logger_view_free(&v);
    }
    pm_dataset_free(d);
}

// --- a mass on a spring beside a spring and a damper in series ---

static void relaxing_rate(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -4 * z[0] - z[2];
    rate[2] = 6 * z[1] - 3 * z[2];
}

static void a_hidden_force_is_what_no_column_explains(void **state) {
    (void)state;
    static const char *const column[] = {"x", "v"};
    static const pm_logger_guess guess[] = {PM_LOGGER_AS_FOUND, PM_LOGGER_MOVED};
    pm_dataset *d = record(&(logged){2, 1, column, "m;m/s", 0.02, relaxing_rate});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.column[1].nother, 1);
    assert_int_equal(v.column[1].other[0], PM_LOGGER_MOVED);
    pm_logger_view_free(&v);
    look(&v, d, &(pm_logger_hints){.hidden = -1, .guess = guess});
    assert_int_equal(v.nvariable, 3);
    assert_string_equal(v.column[2].name, "v_behind");
    assert_string_equal(v.column[2].unit, "N");
    // It relaxes, and acts against the velocity that moves it.
    assert_true(v.column[2].decay > 1);
    assert_true(v.coupling[1][2] * v.coupling[2][1] < 0);
    assert_true(v.column[2].unexplained < 0.1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a brake of 5 J/K on a body of 3 kg, in a room ---

static void brake_rate(const double *z, double *rate) {
    rate[0] = (z[2] - 2 * z[0]) / 3;
    rate[1] = (2 * z[0] * z[0] - 0.4 * (z[1] - z[3])) / 5;
    rate[2] = 1.3 * z[3]; // the force and the room
    rate[3] = -1.3 * z[2];
}

// The power of the friction tells how large the capacity is, and so what the room conducts.
static void conduction_has_the_scale_of_capacities(void **state) {
    (void)state;
    static const char *const column[] = {"v", "T", "F", "room"};
    pm_dataset *d = record(&(logged){4, 0, column, "m/s;degC;N;degC", 0.02, brake_rate});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "F,room", .hidden = -1});
    const pm_logger_action *bath = NULL;
    for (int a = 0; a < v.naction; ++a) {
        bath = v.action[a].effect == PM_LOGGER_BATH ? &v.action[a] : bath;
    }
    assert_non_null(bath);
    assert_int_equal(bath->target, 1);
    assert_false(v.column[1].free_scale);
    assert_true(fabs(v.column[1].inertia / 5 - 1) < 0.5);
    assert_true(fabs(bath->gain / v.column[1].inertia / (0.4 / 5) - 1) < 0.2);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_length_of_a_spring_has_two_velocities),
        cmocka_unit_test(a_shaft_moves_a_rack),
        cmocka_unit_test(data_tell_a_weight_from_a_spring),
        cmocka_unit_test(nothing_passes_between_two_springs),
        cmocka_unit_test(a_loss_heats_another_part),
        cmocka_unit_test(a_hidden_force_is_what_no_column_explains),
        cmocka_unit_test(conduction_has_the_scale_of_capacities),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

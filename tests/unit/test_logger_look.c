// The columns of a logger are told apart: positions whose rates several velocities or a lever
// explain, energies of angles, and what passes between parts.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"
#include "propose/logger_draft.h"
#include "tests/support/unit.h"

enum { TRAJECTORIES = 10, SAMPLES = 200, MOST = 10 };

typedef struct logged {
    int nz, hidden; // columns, and states that none shows
    const char *const *column;
    const char *unit; // separated by ';'
    double dt;
    void (*rate)(const double *z, double *rate);
    void (*start)(int trajectory, double *z); // NULL: waves
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
        if (s->start != NULL) {
            s->start(i, z);
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
    pm_dataset *d = record(&(logged){3, 0, column, "m/s;m/s;m", 0.02, pair_rate, NULL});
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
    pm_dataset *d = record(&(logged){2, 0, column, "m;rad/s", 0.1, rack_rate, NULL});
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
        pm_dataset *d = record(&(logged){2, 0, column, "rad;rad/s", 0.005, rate[k], NULL});
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

static void a_named_port_passes_at_least_friction(void **state) {
    (void)state;
    static const char *const column[] = {"x1", "v1", "x2", "v2"};
    static const char *const part[] = {"one=x1,v1", "two=x2,v2"};
    static const char *const port[] = {"one,two"};
    pm_dataset *d = record(&(logged){4, 0, column, "m;m/s;m;m/s", 0.03, apart_rate, NULL});
    for (int named = 0; named < 2; ++named) {
        const pm_logger_hints hints = {
            .npart = 2, .part = part, .nport = named, .port = port, .hidden = -1};
        pm_logger_view v;
        look(&v, d, &hints);
        assert_int_equal(v.nport, named);
        assert_int_equal(v.nidle, 0);
        assert_true(pm_logger_is_coupled(&v, 1, 3, true) == (named == 1));
        pm_logger_view_free(&v);
    }
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
    pm_dataset *d = record(&(logged){3, 0, column, "A;V;K", 0.005, heating_rate, NULL});
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
    static const pm_logger_guess both[] = {PM_LOGGER_AS_FOUND, PM_LOGGER_MOVED_2};
    pm_dataset *d = record(&(logged){2, 1, column, "m;m/s", 0.02, relaxing_rate, NULL});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.column[1].nother, 2);
    assert_int_equal(v.column[1].other[0], PM_LOGGER_MOVED);
    assert_int_equal(v.column[1].other[1], PM_LOGGER_MOVED_2);
    pm_logger_view_free(&v);
    look(&v, d, &(pm_logger_hints){.hidden = -1, .guess = guess});
    assert_int_equal(v.nvariable, 3);
    assert_string_equal(v.column[2].name, "v_behind");
    assert_string_equal(v.column[2].unit, "N");
    // It relaxes, and acts against the velocity that moves it.
    assert_true(v.column[2].decay > 1);
    assert_true(v.coupling[1][2] * v.coupling[2][1] < 0);
    assert_true(v.column[2].unexplained < 0.1);
    const pm_logger_column alone = v.column[2];
    pm_logger_view_free(&v);
    // A second one leaves the first as it is, is slower, and acts likewise.
    look(&v, d, &(pm_logger_hints){.hidden = -1, .guess = both});
    assert_int_equal(v.nvariable, 4);
    assert_string_equal(v.column[3].name, "v_slower");
    assert_true(v.column[2].deviation == alone.deviation && v.column[2].decay == alone.decay);
    assert_true(v.column[3].deviation == alone.deviation && v.column[3].decay < alone.decay);
    assert_true(v.coupling[1][3] * v.coupling[3][1] < 0);
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
    pm_dataset *d = record(&(logged){4, 0, column, "m/s;degC;N;degC", 0.02, brake_rate, NULL});
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

// A piston and a flow change a volume, whose pressure pushes the piston.
static void filled_rate(const double *z, double *rate) {
    rate[0] = -0.2 * z[1] + z[2];
    rate[1] = z[0] - 0.1 * z[1];
    rate[2] = z[3]; // the flow is a wave
    rate[3] = -4 * z[2];
}

static void a_flow_fills_a_volume(void **state) {
    (void)state;
    static const char *const column[] = {"V", "v", "Q"};
    pm_dataset *d = record(&(logged){3, 1, column, "m^3;m/s;m^3/s", 0.02, filled_rate, NULL});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "Q", .hidden = -1});
    assert_int_equal(v.column[0].kind, PM_LOGGER_POSITION);
    assert_int_equal(v.column[0].mate, 1);
    assert_true(fabs(v.column[0].ratio / -0.2 - 1) < 0.02);
    bool fills = false;
    for (int a = 0; a < v.naction; ++a) {
        fills = fills || (v.action[a].effect == PM_LOGGER_FILLS && v.action[a].target == 0 &&
                          v.action[a].gain == 1);
    }
    assert_true(fills);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a mass whose friction heats a body of 2 J/K, which exchanges heat with one of 5 J/K ---

static void warming_rate(const double *z, double *rate) {
    rate[0] = -9 * z[1] - 0.4 * z[0];
    rate[1] = z[0];
    rate[2] = -0.3 * (z[2] - z[3]) / 5;
    rate[3] = (0.4 * z[0] * z[0] + 0.3 * (z[2] - z[3])) / 2;
}

// Nothing shows how large the mass is, which is the unit. The capacities then have a scale, too,
// also that of a body which no friction heats.
static void friction_gives_all_capacities_their_scale(void **state) {
    (void)state;
    static const char *const column[] = {"v", "x", "T1", "T2"};
    pm_dataset *d = record(&(logged){4, 0, column, "m/s;m;K;K", 0.05, warming_rate, NULL});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_true(v.warms[0][3]);
    assert_true(v.column[0].free_scale);
    assert_false(pm_logger_heat_is_free(&v));
    assert_true(fabs(v.column[3].inertia / v.column[0].inertia / 2 - 1) < 0.5);
    assert_true(fabs(v.column[2].inertia / v.column[3].inertia / 2.5 - 1) < 0.5);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- two masses, the second of which is measured from the first ---

static void measured_rate(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -20 * z[0] + 20 * z[2] - 0.2 * z[1];
    rate[2] = z[3] - z[1];
    rate[3] = -10 * z[2] - 0.1 * z[3];
}

static void a_distance_is_not_measured_again(void **state) {
    (void)state;
    static const char *const column[] = {"x1", "v1", "d", "v2"};
    static const char *const part[] = {"one=x1,v1", "two=d,v2"};
    pm_dataset *d = record(&(logged){4, 0, column, "m;m/s;m;m/s", 0.03, measured_rate, NULL});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.npart = 2, .part = part, .hidden = -1});
    assert_null(pm_logger_base(&v, &v.column[0]));
    assert_null(pm_logger_base(&v, &v.column[2]));
    assert_true(v.column[0].ratio == 1 && v.column[2].ratio == 1 && v.moves[2][1] == -1);
    assert_int_equal(v.nport, 1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a pump and a hose, whose capacity depends on the head ---

static void hose_rate(const double *z, double *rate) {
    rate[0] = 3 * z[1] - 0.2 * z[0];
    rate[1] = -3 * z[0] / (1 + 9 * z[1] * z[1]);
}

static void a_head_that_changes_its_sign_is_no_level(void **state) {
    (void)state;
    static const char *const column[] = {"w", "h"};
    static const char *const part[] = {"pump=w", "hose=h"};
    pm_dataset *d = record(&(logged){2, 0, column, "rad/s;m", 0.03, hose_rate, NULL});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.npart = 2, .part = part, .hidden = -1});
    assert_int_equal(v.column[1].kind, PM_LOGGER_FLOW);
    assert_int_equal(v.nport, 1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a gas that is warmed by the friction of its piston, in another part ---

static void piston_rate(const double *z, double *rate) {
    rate[0] = 20 * (z[3] / 300 / z[2] - 0.7) - 50 * z[1] - 0.5 * z[0];
    rate[1] = z[0];
    rate[2] = 2 * z[0];
    rate[3] = -0.4 * z[3] / z[2] * 2 * z[0] + 0.5 * z[0] * z[0];
}

static void some_gas(int i, double *z) {
    z[0] = 0.5 * cos(1.7 * i), z[1] = 0.1 * cos(2.3 * i);
    z[2] = 1.4 + 0.4 * cos(2.9 * i), z[3] = 300 + 10 * cos(1.1 * i);
}

// The work of the gas is much larger than the heat, and noise hides this over short times.
static void friction_heats_a_gas(void **state) {
    (void)state;
    static const char *const column[] = {"v", "x", "V", "T"};
    static const char *const part[] = {"rod=v,x", "gas=V,T"};
    static const double noise[] = {5e-3, 1e-3, 1e-3, 0.05};
    pm_dataset *d = record(&(logged){4, 0, column, "m/s;m;m^3;K", 0.02, piston_rate, some_gas});
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int k = 0; k < TRAJECTORIES * SAMPLES; ++k) {
        for (int c = 0; c < 4; ++c) {
            pm_dataset_state(d, 0, 0)[4 * k + c] += noise[c] * pm_rng_normal(&rng);
        }
    }
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.npart = 2, .part = part, .hidden = -1});
    assert_true(v.expands[2][3]);
    assert_true(v.warms[0][3]);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a mass on a spring beside a body that cools ---

static void apart_and_cool(const double *z, double *rate) {
    rate[0] = z[1];
    rate[1] = -30 * z[0] - 2 * z[1];
    rate[2] = -0.8 * (z[2] - 300);
}

static void some_heat(int i, double *z) {
    z[0] = 0.2 * cos(1.7 * i), z[1] = 0.3 * cos(2.3 * i), z[2] = 310 + 8 * cos(1.1 * i);
}

static bool offers(const pm_logger_column *column, pm_logger_guess guess) {
    bool found = false;
    for (int k = 0; k < column->nother; ++k) {
        found = found || column->other[k] == guess;
    }
    return found;
}

// What regressions do not show may be assumed: trials decide.
static void heat_may_be_assumed(void **state) {
    (void)state;
    static const char *const column[] = {"x", "v", "T"};
    static const char *const part[] = {"rod=x,v", "housing=T"};
    static const char *const port[] = {"rod,housing"};
    pm_dataset *d = record(&(logged){3, 0, column, "m;m/s;K", 0.02, apart_and_cool, some_heat});
    for (int apart = 0; apart < 2; ++apart) {
        // In one part the temperature may depend on the position, else friction may heat it.
        const pm_logger_guess guess[2][3] = {{[2] = PM_LOGGER_EXPANDED}, {[1] = PM_LOGGER_WARMER}};
        pm_logger_hints hints = {
            .npart = 2 * apart, .part = part, .nport = apart, .port = port, .hidden = -1};
        pm_logger_view v;
        look(&v, d, &hints);
        assert_false(v.expands[0][2]);
        assert_true(offers(&v.column[2], PM_LOGGER_EXPANDED) == (apart == 0));
        assert_true(offers(&v.column[1], PM_LOGGER_WARMER) == (apart == 1));
        const int nvariable = v.nvariable;
        pm_logger_view_free(&v);
        hints.guess = guess[apart];
        look(&v, d, &hints);
        assert_int_equal(v.nvariable, nvariable);
        assert_true(apart == 0 ? v.expands[0][2] : v.warms[1][2]);
        pm_logger_view_free(&v);
    }
    pm_dataset_free(d);
}

// --- two vessels that a pipe connects ---

static void vessels_rate(const double *z, double *rate) {
    const double flow = copysign(0.3 * sqrt(fabs(z[0] - z[1])), z[0] - z[1]);
    rate[0] = (z[2] - flow) / 2;
    rate[1] = (flow - 0.2 * sqrt(fabs(z[1]))) / 1.5;
    rate[2] = 0.6 * z[3]; // the inflow is a wave
    rate[3] = -0.6 * (z[2] - 0.2);
}

static void some_levels(int i, double *z) {
    z[0] = 1 + 0.6 * cos(1.7 * i), z[1] = 1 + 0.6 * cos(2.3 * i);
    z[2] = 0.2 + 0.15 * cos(i), z[3] = 0.15 * sin(i);
}

static void connected_vessels_exchange_by_their_difference(void **state) {
    (void)state;
    static const char *const column[] = {"h1", "h2", "Q"};
    static const char *const part[] = {"one=h1", "two=h2"};
    pm_dataset *d = record(&(logged){3, 1, column, "m;m;m^3/s", 0.1, vessels_rate, some_levels});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "Q", .npart = 2, .part = part, .hidden = 0});
    assert_int_equal(v.column[0].kind, PM_LOGGER_LEVEL);
    assert_true(pm_logger_is_coupled(&v, 0, 1, true));
    assert_false(v.falls[0][1] || v.falls[1][0]);
    assert_int_equal(v.nport, 1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- reactions ---

// A + B = 2 C
static void reaction_rate(const double *z, double *rate) {
    const double r = z[0] * z[1] - 0.5 * z[2] * z[2];
    rate[0] = rate[1] = -r;
    rate[2] = 2 * r;
    rate[3] = 10 * r;
}

static void some_amounts(int i, double *z) {
    for (int c = 0; c < 4; ++c) {
        z[c] = c == 3 ? 300 : 1 + 0.6 * cos(1.7 * i + 2.3 * c);
    }
}

static void amounts_change_by_small_integers(void **state) {
    (void)state;
    static const char *const column[] = {"A", "B", "C", "T"};
    pm_dataset *d =
        record(&(logged){4, 0, column, "mol;mol;mol;K", 0.01, reaction_rate, some_amounts});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.column[0].kind, PM_LOGGER_AMOUNT);
    assert_int_equal(v.nreaction, 1);
    assert_true(v.reaction[0].number[0] == 1 && v.reaction[0].number[1] == 1);
    assert_true(v.reaction[0].number[2] == -2 && v.reaction[0].number[3] == 0);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- orbits ---

// Friction between a spin w and the orbit of a moon, which falls with the distance.
static void tide_rate(const double *z, double *rate) {
    const double *q = z + 1, *v = z + 3;
    const double r2 = q[0] * q[0] + q[1] * q[1];
    const double orbit = (q[0] * v[1] - q[1] * v[0]) / r2;
    const double moment = 0.004 * pow(r2, -2) * (orbit - z[0]);
    rate[0] = moment / 0.3;
    for (int c = 0; c < 2; ++c) {
        rate[1 + c] = v[c];
        rate[3 + c] = -q[c] / (r2 * sqrt(r2)) - moment * (c == 0 ? -q[1] : q[0]) / r2;
    }
    rate[5] = 5 * moment * (orbit - z[0]);
}

static void some_orbit(int i, double *z) {
    const double angle = 2.4 * i, radius = 1 + 0.35 * cos(1.3 * i), speed = 0.9 / sqrt(radius);
    const double start[] = {4 + cos(2.9 * i),    radius * cos(angle), radius * sin(angle),
                            -speed * sin(angle), speed * cos(angle),  300};
    memcpy(z, start, sizeof start);
}

static void a_spin_rubs_against_an_orbit(void **state) {
    (void)state;
    static const char *const column[] = {"w", "x", "y", "vx", "vy", "T"};
    pm_dataset *d =
        record(&(logged){6, 0, column, "rad/s;m;m;m/s;m/s;K", 0.1, tide_rate, some_orbit});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.ntide, 1);
    assert_true(v.tide[0].spin == 0 && v.tide[0].first == 1 && v.tide[0].second == 2);
    assert_int_equal(v.tide[0].heat, 5);
    assert_true(v.orbits[1]);
    assert_false(v.gyrates[0][3] || v.gyrates[0][4] || v.circles[3][4]);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a brake and a heater ---

#define WHEEL 0.02   // kg m^2
#define CAPACITY 8.0 // J/K of the brake

// A wheel is braked, which heats; a heater of slowly changing power heats, too.
static void braked_rate(const double *z, double *rate) {
    const double moment = 0.01 * z[0];
    rate[0] = -moment / WHEEL;
    rate[1] = (moment * z[0] + z[2]) / CAPACITY;
    rate[2] = z[3];
    rate[3] = -2 * z[2];
}

static void some_turns(int i, double *z) {
    const double start[] = {30 + 10 * cos(2.1 * i), 300, 2 * cos(1.3 * i), 2 * sin(0.7 * i)};
    memcpy(z, start, sizeof start);
}

static void a_heater_shows_the_inertia_of_what_is_braked(void **state) {
    (void)state;
    static const char *const column[] = {"w", "T", "P"};
    pm_dataset *d = record(&(logged){3, 1, column, "rad/s;K;W", 0.02, braked_rate, some_turns});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "P", .hidden = -1});
    assert_false(v.column[0].free_scale);
    const double ratio = v.column[0].inertia / v.column[1].inertia;
    assert_true(fabs(ratio / (WHEEL / CAPACITY) - 1) < 0.02);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- noise ---

// Noise shows between the jumps of an input, however often it jumps.
static void noise_shows_beside_inputs_that_jump(void **state) {
    (void)state;
    static const char *const column[] = {"x", "u"};
    for (int length = 1; length <= 8; ++length) {
        pm_dataset *d = NULL;
        pm_rng rng;
        pm_rng_init(&rng, 7, (uint64_t)length);
        assert_int_equal(pm_dataset_new(&d, TRAJECTORIES, SAMPLES, 2, 0.1, column), PM_OK);
        assert_int_equal(pm_dataset_note(d, "units", "K;V"), PM_OK);
        for (int noisy = 0; noisy < 2; ++noisy) {
            for (int i = 0; i < TRAJECTORIES; ++i) {
                double u = 0;
                for (int k = 0; k < SAMPLES; ++k) {
                    double *z = pm_dataset_state(d, i, k);
                    u = k % length == 0 ? pm_rng_normal(&rng) : u;
                    z[0] = 300 + cos(0.03 * k + i) + 0.01 * noisy * pm_rng_normal(&rng);
                    z[1] = u;
                }
            }
            pm_logger_view v;
            look(&v, d, &(pm_logger_hints){.inputs = "u", .hidden = 0});
            if (noisy ? fabs(v.column[0].noise / 0.01 - 1) > 0.2 : v.column[0].noise > 0) {
                fail_msg("an input that jumps each %d samples: noise %g", length,
                         v.column[0].noise);
            }
            pm_logger_view_free(&v);
        }
        pm_dataset_free(d);
    }
}

// --- a weight whose speed is sampled rarely, beside columns that are no variables ---

static void still_rate(const double *z, double *rate) {
    weight_rate(z, rate);
    rate[2] = rate[3] = rate[4] = rate[5] = 0;
}

static void rare_samples_count_and_noise_and_rates_do_not(void **state) {
    (void)state;
    enum { RARELY = 4 };
    static const char *const column[] = {"q", "w", "battery", "a", "count", "flag"};
    pm_dataset *d =
        record(&(logged){6, 0, column, "rad;rad/s;V;rad/s^2;1;1", 0.01, still_rate, NULL});
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    for (int i = 0; i < TRAJECTORIES; ++i) {
        for (int k = 0; k < SAMPLES; ++k) {
            double *z = pm_dataset_state(d, i, k), rate[6];
            still_rate(z, rate);
            z[3] = rate[1];
            z[1] += k % RARELY == 0 ? 0 : NAN;
            z[2] = 3.7 + 0.01 * pm_rng_normal(&rng);
            z[4] = k;
            z[5] = k / 7 % 2;
        }
    }
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "", .hidden = -1});
    assert_int_equal(v.nvariable, 2);
    assert_int_equal(v.nleft, 4);
    assert_string_equal(v.left[0], "battery");
    assert_string_equal(v.left[1], "a");
    assert_int_equal(v.column[1].spacing, RARELY);
    assert_int_equal(v.column[0].mate, 1);
    assert_true(fabs(v.column[0].ratio - 1) < 0.02);
    assert_false(v.complete);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- two temperatures in a room, of which one is heated ---

static void room_rate(const double *z, double *rate) {
    const double between = 4 * (z[0] - z[1]);
    rate[0] = (z[2] - between - 0.3 * (z[0] - z[3])) / 300;
    rate[1] = (between - 3 * (z[1] - z[3])) / 200;
    rate[2] = rate[3] = 0;
}

static void some_room(int i, double *z) {
    z[0] = 300 + 3 * cos(1.7 * i);
    z[1] = 298 + 3 * cos(2.1 * i);
    z[2] = 30 + 30 * cos(2.9 * i);
    z[3] = 290 + 3 * cos(0.7 * i);
}

static void a_bath_reaches_all_temperatures_of_a_part(void **state) {
    (void)state;
    static const char *const column[] = {"T1", "T2", "heater", "room"};
    pm_dataset *d = record(&(logged){4, 0, column, "K;K;W;K", 4, room_rate, some_room});
    pm_rng rng;
    pm_rng_init(&rng, 2, 0);
    for (int i = 0; i < TRAJECTORIES; ++i) {
        for (int k = 0; k < SAMPLES; ++k) {
            pm_dataset_state(d, i, k)[0] += 0.05 * pm_rng_normal(&rng);
            pm_dataset_state(d, i, k)[1] += 0.05 * pm_rng_normal(&rng);
        }
    }
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "heater,room", .hidden = -1});
    bool reached[2] = {false};
    for (int a = 0; a < v.naction; ++a) {
        const pm_logger_action *action = &v.action[a];
        if (action->effect == PM_LOGGER_BATH && action->input == 3) {
            reached[action->target] = true;
        }
    }
    assert_true(reached[0] && reached[1]);
    // A power that a fit has left beside a vanishing factor may be anything: it begins anew.
    static const int chosen[PM_LOGGER_NCHOICE] = {0};
    char text[16384], path[] = "/tmp/test_logger_look_XXXXXX";
    const int file = mkstemp(path);
    assert_true(file >= 0);
    const pm_logger_draft draft = {.view = v,
                                   .scene_path = "scene.yaml",
                                   .data_path = "data.h5",
                                   .found = "system_room.convection_room_T1=1e-15\n"
                                            "system_room.power_room_T1=3.8\n"
                                            "system_room.power_room_T2=0.21\n"};
    assert_int_equal(unlink(path), 0);
    assert_int_equal(pm_logger_write_training(&draft, chosen, "", path), PM_OK);
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    text[fread(text, 1, sizeof text - 1, f)] = '\0';
    fclose(f);
    close(file);
    assert_int_equal(unlink(path), 0);
    const char *first = strstr(text, "power_room_T1: {learned: ");
    assert_non_null(first);
    assert_true(strtod(first + strlen("power_room_T1: {learned: "), NULL) < 1);
    assert_non_null(strstr(text, "power_room_T2: {learned: 0.21,"));
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a load behind a gear ---

static void gear_rate(const double *z, double *rate) {
    rate[0] = (6 * z[1] - z[2] - 0.3 * z[0]) / 2;
    rate[1] = rate[2] = 0;
}

static void some_torques(int i, double *z) {
    z[0] = 3 * cos(1.7 * i);
    z[1] = cos(2.1 * i);
    z[2] = 2 * cos(2.9 * i);
}

static void the_torque_before_a_gear_has_a_factor(void **state) {
    (void)state;
    static const char *const column[] = {"w", "motor", "load"};
    pm_dataset *d = record(&(logged){3, 0, column, "rad/s;N*m;N*m", 0.05, gear_rate, some_torques});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.inputs = "motor,load", .hidden = -1});
    assert_false(v.column[1].clear);
    assert_true(v.column[2].clear);
    assert_int_equal(v.column[2].other[0], PM_LOGGER_SCALED);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- a pipe that fills a tank ---

static void pipe_rate(const double *z, double *rate) {
    rate[0] = (5e4 - 9810 * z[1] - 3e9 * z[0] * fabs(z[0])) / 2e7;
    rate[1] = (z[0] - 2e-3 * sqrt(fabs(z[1]))) / 0.2;
}

static void some_flow(int i, double *z) {
    z[0] = 3e-3 + 2e-3 * cos(1.7 * i);
    z[1] = 2 + cos(2.1 * i);
}

static void a_pipe_fills_a_tank(void **state) {
    (void)state;
    static const char *const column[] = {"Q", "h"};
    pm_dataset *d = record(&(logged){2, 0, column, "m^3/s;m", 0.2, pipe_rate, some_flow});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_int_equal(v.column[0].kind, PM_LOGGER_FLOW);
    assert_int_equal(v.column[1].kind, PM_LOGGER_LEVEL);
    assert_true(pm_logger_is_coupled(&v, 0, 1, false));
    assert_true(fabs(v.coupling[1][0] * 0.2 - 1) < 0.02);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// --- bodies in the plane and in space ---

// Adds the force of a spring of this stiffness and length along d [n] to a [n], with a factor.
static void pull(int n, const double *d, double stiffness, double length, double factor,
                 double *a) {
    double square = 1e-3;
    for (int k = 0; k < n; ++k) {
        square += d[k] * d[k];
    }
    for (int k = 0; k < n; ++k) {
        a[k] -= factor * stiffness * (1 - length / sqrt(square)) * d[k];
    }
}

// Two bodies in the plane: x1, y1, their velocities, x2, y2, their velocities. The first is held by
// a spring to the origin, the second one by a spring to the first one.
static void two_bodies(const double *z, double *rate) {
    const double d[2] = {z[4] - z[0], z[5] - z[1]};
    for (int k = 0; k < 2; ++k) {
        rate[k] = z[2 + k];
        rate[2 + k] = -0.1 * z[2 + k];
        rate[4 + k] = z[6 + k];
        rate[6 + k] = -0.2 * z[6 + k];
    }
    pull(2, z, 6, 0.5, 1, rate + 2);
    pull(2, d, 9, 0.6, -1, rate + 2);
    pull(2, d, 9, 0.6, 0.5, rate + 6);
}

static void a_spring_between_bodies_in_the_plane_is_found(void **state) {
    (void)state;
    static const char *const column[] = {"x1", "y1", "u1", "v1", "x2", "y2", "u2", "v2"};
    static const char *const part[] = {"a=x1,y1,u1,v1", "b=x2,y2,u2,v2"}, *const port[] = {"a,b"};
    pm_dataset *d =
        record(&(logged){8, 0, column, "m;m;m/s;m/s;m;m;m/s;m/s", 0.05, two_bodies, NULL});
    pm_logger_view v;
    look(&v, d,
         &(pm_logger_hints){.hidden = -1, .npart = 2, .part = part, .nport = 1, .port = port});
    for (int k = 0; k < 2; ++k) { // measured from the first body, whose place nothing else tells
        assert_int_equal(v.column[4 + k].base, k);
        assert_int_equal(v.column[4 + k].mate, 6 + k);
        assert_true(v.moves[4 + k][2 + k] == -1);
        assert_int_equal(v.column[k].base, -1);
    }
    assert_true(v.central[0][1] && v.central[4][5]);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

// A mass on a spring in space, which stays at about the same distance from the centre, and a
// temperature that its friction heats.
static void in_space(const double *z, double *rate) {
    double power = 0;
    for (int k = 0; k < 3; ++k) {
        rate[k] = z[3 + k];
        rate[3 + k] = -0.3 * z[3 + k];
        power += 0.3 * z[3 + k] * z[3 + k];
    }
    pull(3, z, 30, 1, 1, rate + 3);
    rate[6] = power / 0.4;
}

static void start_in_space(int trajectory, double *z) {
    const double a = 1.7 * trajectory, b = 0.4 * cos(2.3 * trajectory);
    z[0] = cos(a) * cos(b), z[1] = sin(a) * cos(b), z[2] = sin(b);
    z[3] = -sin(a) + 0.3 * cos(b), z[4] = cos(a), z[5] = 0.8 * cos(3.1 * trajectory);
    z[6] = 300 + trajectory;
}

static void three_lengths_are_judged_together(void **state) {
    (void)state;
    static const char *const column[] = {"x", "y", "z", "u", "v", "w", "T"};
    pm_dataset *d =
        record(&(logged){7, 0, column, "m;m;m;m/s;m/s;m/s;K", 0.05, in_space, start_in_space});
    pm_logger_view v;
    look(&v, d, &(pm_logger_hints){.hidden = -1});
    assert_true(v.central[0][1] && v.central[0][2] && v.central[1][2]);
    for (int i = 3; i < 6; ++i) { // no friction between the axes
        for (int j = 3; j < i; ++j) {
            assert_false(pm_logger_is_coupled(&v, i, j, true));
        }
        assert_true(v.warms[i][6]);
    }
    int units = 0; // of all energies, although three velocities heat
    for (int c = 0; c < v.nvariable; ++c) {
        units += v.column[c].free_scale;
    }
    assert_int_equal(units, 1);
    pm_logger_view_free(&v);
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_length_of_a_spring_has_two_velocities),
        cmocka_unit_test(a_shaft_moves_a_rack),
        cmocka_unit_test(data_tell_a_weight_from_a_spring),
        cmocka_unit_test(a_named_port_passes_at_least_friction),
        cmocka_unit_test(a_loss_heats_another_part),
        cmocka_unit_test(a_hidden_force_is_what_no_column_explains),
        cmocka_unit_test(conduction_has_the_scale_of_capacities),
        cmocka_unit_test(a_flow_fills_a_volume),
        cmocka_unit_test(friction_gives_all_capacities_their_scale),
        cmocka_unit_test(a_distance_is_not_measured_again),
        cmocka_unit_test(a_head_that_changes_its_sign_is_no_level),
        cmocka_unit_test(friction_heats_a_gas),
        cmocka_unit_test(heat_may_be_assumed),
        cmocka_unit_test(connected_vessels_exchange_by_their_difference),
        cmocka_unit_test(amounts_change_by_small_integers),
        cmocka_unit_test(a_spin_rubs_against_an_orbit),
        cmocka_unit_test(a_heater_shows_the_inertia_of_what_is_braked),
        cmocka_unit_test(noise_shows_beside_inputs_that_jump),
        cmocka_unit_test(a_pipe_fills_a_tank),
        cmocka_unit_test(the_torque_before_a_gear_has_a_factor),
        cmocka_unit_test(rare_samples_count_and_noise_and_rates_do_not),
        cmocka_unit_test(a_bath_reaches_all_temperatures_of_a_part),
        cmocka_unit_test(a_spring_between_bodies_in_the_plane_is_found),
        cmocka_unit_test(three_lengths_are_judged_together),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

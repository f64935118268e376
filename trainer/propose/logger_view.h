// What the columns of a logger are: velocities with their positions, temperatures, levels, other
// co-energies, and inputs; which of them move each other, and where a fit may begin. Units come
// first, and linear regressions decide the rest (logger_samples.h).
#ifndef PM_TRAINER_PROPOSE_LOGGER_VIEW_H
#define PM_TRAINER_PROPOSE_LOGGER_VIEW_H

#include <math.h>
#include <signal.h>
#include <stdbool.h>

#include "base/arena.h"
#include "base/unit.h"
#include "model/spec.h"
#include "store/dataset.h"

#define PM_LOGGER_COLUMNS 32 // columns beside the times, hidden velocities included
#define PM_LOGGER_PARTS 8
#define PM_LOGGER_ACTIONS 64
#define PM_LOGGER_GUIDES 96
#define PM_LOGGER_CARRIERS 8
#define PM_LOGGER_AMOUNTS 6 // of a part, among which reactions are sought
#define PM_LOGGER_REACTIONS 16
#define PM_LOGGER_GAS 8.314462618 // J/(mol K)
#define PM_LOGGER_COLDEST 200.0   // K, of surroundings
#define PM_LOGGER_HOTTEST 400.0
#define PM_LOGGER_TURN 6.283 // rad
// A position of another part has no spring if it explains less than this part of the changes.
#define PM_LOGGER_SPRINGS 2e-3

typedef enum pm_logger_kind {
    PM_LOGGER_POSITION,    // dq/dt = v, where v is its mate; or of a charge and a current
    PM_LOGGER_FLOW,        // a co-energy such as a velocity, a current, a voltage or a pressure
    PM_LOGGER_TEMPERATURE, // the co-energy of an entropy
    PM_LOGGER_LEVEL,       // the co-energy of a volume, but for the weight of the fluid
    PM_LOGGER_CHARGE,      // an energy variable; its rate is an input
    PM_LOGGER_AMOUNT,      // an energy variable: of a substance, or its concentration
    PM_LOGGER_INPUT
} pm_logger_kind;

// What a measured variable may be, beside what its unit and regressions say.
#define PM_LOGGER_PAIRS (PM_LOGGER_COLUMNS * PM_LOGGER_COLUMNS)
typedef enum pm_logger_guess {
    PM_LOGGER_AS_FOUND, // what units and regressions say first
    PM_LOGGER_COMPLETE, // nothing is hidden behind it
    PM_LOGGER_RATE,     // a position, whose rate is hidden
    PM_LOGGER_FED,      // a level, into which fluid falls from a hidden one
    PM_LOGGER_SPILLED,  // likewise; the hidden one spills over, and part of that falls into it, too
    PM_LOGGER_MOVED,    // a co-energy, moved without loss by a hidden one of another kind
    PM_LOGGER_BESIDE,   // a temperature, which exchanges heat with a hidden one
    PM_LOGGER_MOVED_2,  // a velocity, moved without loss by two hidden forces, of which one is
                        // slower
    PM_LOGGER_WARMER,   // a co-energy, whose friction heats the temperature of a neighbour
    PM_LOGGER_EXPANDED, // a temperature, whose entropy depends on the positions of its part
    PM_LOGGER_CYCLIC,   // a length, on which inertias and levers do not depend
    PM_LOGGER_SCALED,   // an input, whose product with what it drives is no power: it has a factor
    // An input that also moves other velocities of its part, such as a wheel's torque a vehicle:
    // with learned factors, which may depend on positions.
    PM_LOGGER_FREELY,
    // The voltage of a hidden charge behind a resistance, as of a cell, with 0 to 2 pairs of a
    // resistance and a capacity in series. The current is the input with which the column jumps.
    PM_LOGGER_CELL,
    PM_LOGGER_CELL_1,
    PM_LOGGER_CELL_2,
    PM_LOGGER_NGUESS,
    // The input sets how strongly two variables exchange something (pm_logger_converter): OPENS
    // beside the effect that was found for it, OPENS_ALONE instead of it. ENTERS: the input is the
    // temperature with which the flow of another input enters a variable. pm_logger_join adds the
    // numbers of the two columns.
    PM_LOGGER_OPENS = PM_LOGGER_PAIRS,
    PM_LOGGER_OPENS_ALONE = 2 * PM_LOGGER_PAIRS,
    PM_LOGGER_ENTERS = 3 * PM_LOGGER_PAIRS,
    PM_LOGGER_GATES = 4 * PM_LOGGER_PAIRS // a level, twice: the input opens its outflow
} pm_logger_guess;

// Joins a guess about an input with the identifiers of two columns, and takes it apart.
static inline pm_logger_guess pm_logger_join(pm_logger_guess guess, int one, int other) {
    return (pm_logger_guess)((int)guess + one * PM_LOGGER_COLUMNS + other);
}
static inline pm_logger_guess pm_logger_split(pm_logger_guess guess, int *one, int *other) {
    const int pair = (int)guess % PM_LOGGER_PAIRS;
    *one = pair / PM_LOGGER_COLUMNS;
    *other = pair % PM_LOGGER_COLUMNS;
    return (pm_logger_guess)((int)guess - pair);
}

// Returns how many hidden variables a guess adds.
static inline int pm_logger_hides(pm_logger_guess guess) {
    return guess == PM_LOGGER_MOVED_2 ? 2 : guess > PM_LOGGER_COMPLETE && guess < PM_LOGGER_MOVED_2;
}

// Returns true if a guess is another one with a further law or a further hidden variable.
static inline bool pm_logger_adds(pm_logger_guess guess, pm_logger_guess other) {
    return (guess == PM_LOGGER_SPILLED && other == PM_LOGGER_FED) ||
           (guess == PM_LOGGER_MOVED_2 && other == PM_LOGGER_MOVED);
}

typedef struct pm_logger_column {
    const char *name;   // of a group of the scene
    const char *source; // column of the dataset; NULL: nobody measures it
    int id;             // of this column; -1
    int base;           // the column of a position of another part, from which it is measured; -1
    const char *unit;   // SI; values of the dataset are converted
    pm_unit dimension;
    bool angle;
    int harmonics; // of an angle: of energies, inertias and levers that depend on it
    bool twice;    // of an angle: inertias that velocities share depend on twice the angle, too
    pm_logger_kind kind;
    int mate;            // of a position its velocity, of a velocity its position; -1
    double ratio;        // of a position: its rate over its velocity, such as a radius; 1 by units
    bool guided;         // a position, moved by velocities that angles turn
    bool waves, springs; // of an angle: energies of sines and cosines, of powers
    int behind;          // of a hidden variable that is no rate: the measured one that it moves; -1
    int twin;            // of the slower of two hidden variables: the faster one; 0: it has none
    int part;            // of variables; -1: an input
    pm_logger_guess guess; // of measured variables
    // Other guesses about the variable or the input, the likeliest first. With `clear` the first of
    // them is tried before the guess that regressions gave.
    int nother;
    pm_logger_guess other[PM_LOGGER_NGUESS];
    bool clear;
    bool held;       // inputs: a staircase, or no smooth function
    int delay;       // inputs: rows by which the column acts later than its samples say
    int shows_delay; // inputs: such a number that regressions prefer; 0: none
    double least, largest, mean, deviation; // in its unit
    double noise;                           // standard deviation of white noise; 0: none is seen
    bool saturates;                         // its sensor shows no more than `largest`
    // Co-energies: `inertia` is the derivative of the energy variable by the co-energy with which a
    // fit begins. If no input fixes its size, `free_scale` is true, and it is the unit of all
    // energies that depend on it.
    double inertia;
    bool free_scale;
    // A hidden charge whose voltage dE/dq is measured only behind a resistance: `seen` is the
    // column of the dataset that shows it, NULL for other variables. `current` is the identifier of
    // the input that is the current. `resistance` is negative if this current discharges the cell.
    // A variable with `relaxes` > 0 is a further summand of the column.
    const char *seen;
    int current;
    double resistance, voltage, slope; // at the mean charge, and its derivative
    double relaxes;                    // s: of a voltage in series with a cell; 0: none
    double roughness;                  // of a measured column: noise over deviation
    int spacing;  // of a measured column: from sample to sample, in rows of the dataset; the median
    double decay; // 1/s: minus the coefficient of the variable in its own rate
    bool feeds;   // a level from which fluid falls into another part
    bool rubs;   // a co-energy that loses energy to one of another part; its part takes up the heat
    bool spills; // a level whose vessel has a brim
    // Regressions show whether a co-energy loses energy (damped), whether its resistance depends on
    // it (curved), and whether its inductance or capacity does (bent).
    bool damped, curved, bent;
    double constant;    // the rate that depends on nothing, in its unit per s
    double unexplained; // part of its changes that no column explains, itself included
} pm_logger_column;

typedef enum pm_logger_effect {
    PM_LOGGER_DRIVES,  // the product of the units is a power: it acts with the factor 1
    PM_LOGGER_GAIN,    // acts with a factor that is learned
    PM_LOGGER_HEATS,   // a power that becomes heat
    PM_LOGGER_WARMS,   // heats with a factor that is learned
    PM_LOGGER_BATH,    // a temperature that exchanges heat
    PM_LOGGER_THROUGH, // a co-energy of the same kind, through a resistance
    PM_LOGGER_COOLS,   // sets how well heat is conducted to a bath, as the flow of a coolant
    PM_LOGGER_FILLS // it is the rate of a charge, or of that of a relaxing pair; gain is its sign
} pm_logger_effect;

// An input that acts on a variable.
typedef struct pm_logger_action {
    int input, target;
    pm_logger_effect effect;
    double gain; // with which a fit begins, in units of the energy variable of the target per s
    bool lever;  // of PM_LOGGER_GAIN: the factor depends on positions
    bool valve;  // likewise: it depends on the target and on the size of the input
    double bath; // K, of PM_LOGGER_COOLS
    int enters;  // likewise: the input that is this temperature; 0: it is `bath`
} pm_logger_action;

// An input that couples two co-energies: its product with each of them moves the other one.
// Co-energies of different kinds are coupled without loss, as in a switched converter, and two of
// one kind with loss, as by a throttle.
typedef struct pm_logger_converter {
    int input, one, other;
    bool loses;
    bool alone; // the input does nothing else to the two
} pm_logger_converter;

// A term of the rate of a position: a velocity, times a factor, times a function of positions, as
// for a wheel that rolls where its axle points, or for a crank.
typedef struct pm_logger_guide {
    int position, velocity;
    char function; // '1', 's'ine or 'c'osine of an angle, or 'x': of a pure number itself
    int harmonic, angle, other, sign; // of harmonic*angle + sign*other; other is -1 if sign is 0
    double factor;
} pm_logger_guide;

// A flow that carries entropy from one temperature to another, as an electric current does between
// two metals. `entropy` is what a unit of it carries, with which a fit begins.
typedef struct pm_logger_carrier {
    int flow, from, to;
    double entropy;
} pm_logger_carrier;

// Friction between a spin and the motion about a centre of two lengths that store energy together,
// as tides cause it.
typedef struct pm_logger_tide {
    int spin, first, second; // columns
    int heat;                // the temperature that takes up the heat; -1: the surroundings
} pm_logger_tide;

// A reaction between the amounts of a part.
typedef struct pm_logger_reaction {
    int part;
    int number[PM_LOGGER_COLUMNS]; // stoichiometric numbers; 0: takes no part
} pm_logger_reaction;

typedef struct pm_logger_view {
    pm_arena arena;            // owns all that follows
    const pm_dataset *dataset; // borrowed
    int ncolumn, nvariable;    // variables stand first, then inputs
    pm_logger_column column[PM_LOGGER_COLUMNS];
    int npart;
    const char *part[PM_LOGGER_PARTS];
    int thermometer[PM_LOGGER_PARTS]; // the first temperature that is measured in a part; -1
    int nport;
    int port[PM_LOGGER_PARTS * PM_LOGGER_PARTS][2]; // parts that move each other
    int nidle;
    // Columns that are left out, and why: they show nothing but noise, a rate, or what a logger
    // adds, such as a counter.
    const char *left[PM_LOGGER_COLUMNS], *why_left[PM_LOGGER_COLUMNS];
    int nleft;
    int idle[PM_LOGGER_PARTS * PM_LOGGER_PARTS][2]; // parts of the hints that do not
    int naction;
    pm_logger_action action[PM_LOGGER_ACTIONS];
    // coupling[i][j] in 1/s times the unit of i per unit of j: how variable j changes the rate of
    // variable i; share[i][j], 0 to 1: the part of the changes of i that only column j explains.
    double coupling[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    double share[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][u] how much of i's changes in slope where input u jumps these jumps explain (0 to 1).
    double answer[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j] fluid falls from level i into level j: i moves j, and j does not move i.
    bool falls[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    int gate[PM_LOGGER_COLUMNS]; // of a level: the input that opens its outflow; 0: none does
    bool even, complete; // times are evenly spaced; no sample is missing, all runs are equally long
    bool noisy;          // some variable is
    bool hides;          // some variable is not measured
    double fastest;      // 1/s: of linear rates
    double bath;         // K: the temperature of the surroundings
    bool leaks[PM_LOGGER_COLUMNS];  // temperatures that tend towards the surroundings
    double leak[PM_LOGGER_COLUMNS]; // 1/s: how fast
    bool joined;                    // the scales of heat and of motion depend on each other
    // [i][j], i < j: the factor k with which co-energy j is added to i in the energy a (i + k
    // j)^2/2. Such co-energies share an inertia, like two coils, so that an input to one moves
    // both. 0: they share none.
    double mutual[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [q][v] how velocity v, beside its mate, changes position q, such as the length of a spring
    // between two bodies; 0: not at all.
    double moves[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j] the lever of a spring between two positions of a part, whose length is lever*i - j. A
    // belt or a gear between them makes the lever differ from 1. 0: there is no spring. [j][i] is
    // the inverse.
    double lever[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j] the largest |lever*i - j| of two positions, with a lever of 1 where there is no spring
    double apart[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j], i < j: two lengths of a part store an energy together, as a spring in a plane does.
    bool central[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [q][p] a spring acts along the distance of two bodies, of which q and p are one coordinate.
    bool tethered[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    bool orbits[PM_LOGGER_COLUMNS]; // [first of such lengths] they move around their centre
    // [q][T] the entropy of temperature T depends on position q, as that of a gas on its volume.
    bool expands[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    int ncarrier;
    pm_logger_carrier carrier[PM_LOGGER_CARRIERS];
    int ntide;
    pm_logger_tide tide[PM_LOGGER_CARRIERS];
    int nreaction;
    pm_logger_reaction reaction[PM_LOGGER_REACTIONS];
    bool diffuses[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS]; // amounts of one substance in two parts
    int nguide;
    pm_logger_guide guide[PM_LOGGER_GUIDES];
    // What regressions on products of columns show (logger_terms.h).
    int nconverter;
    pm_logger_converter converter[PM_LOGGER_ACTIONS];
    bool turns[PM_LOGGER_COLUMNS];  // co-energies whose inertia or capacity depends on positions
    bool inertial[PM_LOGGER_PARTS]; // parts in which inertias depend on several positions
    bool pushes[PM_LOGGER_COLUMNS]; // co-energies that something constant moves
    bool crank[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS]; // [i][j] an angle tells how j moves i
    // [i][j] velocities i and j turn into each other by a factor that depends on velocities, as
    // those of a rigid body.
    bool gyrates[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // Likewise, by a constant factor, as those of a charge in a magnetic field.
    bool circles[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j] co-energies of two units move each other by a factor that depends on what flows, as
    // the currents and the shaft of a machine do.
    bool multiplies[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    // [i][j] a loss between two co-energies is assumed, since a user has named the port.
    bool assumed[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS];
    bool warms[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS]; // [i][j] the loss of i heats temperature j
} pm_logger_view;

// Returns true if a fit takes the columns as measurements: with noise, gaps or hidden variables.
static inline bool pm_logger_is_measured(const pm_logger_view *view) {
    return view->noisy || !view->even || !view->complete || view->hides;
}

static inline bool pm_logger_is(const pm_logger_view *v, int c, int part, pm_logger_kind kind) {
    return v->column[c].part == part && v->column[c].kind == kind;
}

// Returns true if two co-energies act on each other. With `same_kind` it looks for a loss between
// two of the same unit, as between two voltages that a resistor joins. Without it, it looks for a
// coupling without loss between two of different units, as of a current and an angular velocity.
bool pm_logger_is_coupled(const pm_logger_view *view, int i, int j, bool same_kind);
// Returns the temperature that takes up the heat of a loss between two co-energies; -1: none.
int pm_logger_heated(const pm_logger_view *view, int i, int j);
// Returns true if two columns of two parts act on each other by the port of the parts.
bool pm_logger_joins(const pm_logger_view *view, int i, int j);

// Returns true if a tide acts through the port of two parts, or, for one == other, in a part.
static inline bool pm_logger_has_tide(const pm_logger_view *view, const pm_logger_tide *tide,
                                      int one, int other) {
    const int spin = view->column[tide->spin].part, orbit = view->column[tide->first].part;
    return (spin == one && orbit == other) || (spin == other && orbit == one);
}

// Returns true if nothing shows yet how large heat capacities are. The heat capacity of one
// temperature is then the unit of all others.
static inline bool pm_logger_heat_is_free(const pm_logger_view *view) {
    bool free = false;
    for (int k = 0; k < view->nvariable; ++k) {
        const pm_logger_column *c = &view->column[k];
        free = free || (c->kind == PM_LOGGER_TEMPERATURE && c->free_scale);
    }
    return free;
}

// Multiplies the heat capacities of all temperatures, and what acts on them, by a factor that fixes
// their scale.
static inline void pm_logger_scale_heat(pm_logger_view *view, double factor) {
    for (int k = 0; k < view->nvariable; ++k) {
        pm_logger_column *c = &view->column[k];
        if (c->kind == PM_LOGGER_TEMPERATURE) {
            c->inertia *= factor;
            c->free_scale = false;
        }
    }
    for (int a = 0; a < view->naction; ++a) {
        const pm_logger_column *target = &view->column[view->action[a].target];
        view->action[a].gain *= target->kind == PM_LOGGER_TEMPERATURE ? factor : 1;
    }
}

// Multiplies the inertias of all co-energies but temperatures, and what acts on them, by a factor
// that fixes their scale. Does nothing unless the inertia of a measured one was the unit.
static inline void pm_logger_scale_motion(pm_logger_view *view, double factor) {
    bool free = false;
    for (int k = 0; k < view->nvariable; ++k) {
        const pm_logger_column *c = &view->column[k];
        free = free || (c->kind != PM_LOGGER_TEMPERATURE && c->behind < 0 && c->free_scale);
    }
    for (int k = 0; k < view->nvariable && free; ++k) {
        pm_logger_column *c = &view->column[k];
        if (c->kind != PM_LOGGER_TEMPERATURE && c->kind != PM_LOGGER_POSITION && c->behind < 0) {
            c->inertia *= factor;
            c->free_scale = false;
        }
    }
    for (int a = 0; a < view->naction && free; ++a) {
        const pm_logger_column *target = &view->column[view->action[a].target];
        view->action[a].gain *= target->kind == PM_LOGGER_TEMPERATURE ? 1 : factor;
    }
}

static inline bool pm_logger_has_ends(const int *port, int one, int other) {
    return (port[0] == one && port[1] == other) || (port[0] == other && port[1] == one);
}

// Returns true if two parts are one, or have a port.
static inline bool pm_logger_meets(const pm_logger_view *view, int one, int other) {
    bool found = one == other;
    for (int k = 0; k < view->nport; ++k) {
        found = found || pm_logger_has_ends(view->port[k], one, other);
    }
    return found;
}

// Returns the position of another part from which a column is measured, or NULL.
static inline const pm_logger_column *pm_logger_base(const pm_logger_view *view,
                                                     const pm_logger_column *column) {
    const pm_logger_column *base = NULL;
    for (int c = 0; c < view->nvariable && column->source != NULL && column->base >= 0; ++c) {
        base = view->column[c].id == column->base ? &view->column[c] : base;
    }
    return base;
}

// Returns true if a belt or a gear joins two velocities, which is the case if a spring with a lever
// joins their positions.
static inline bool pm_logger_is_geared(const pm_logger_view *view, int i, int j) {
    const int q = view->column[i].mate, p = view->column[j].mate;
    return q >= 0 && p >= 0 && view->column[i].kind == PM_LOGGER_FLOW &&
           view->column[j].kind == PM_LOGGER_FLOW && view->lever[q][p] != 0 &&
           view->lever[q][p] != 1;
}

// Returns true if a spring between two positions of two parts moves one of their velocities. A
// position whose rate has the velocity of the other one is a distance already.
static inline bool pm_logger_is_linked(const pm_logger_view *view, int q, int p) {
    const pm_logger_column *a = &view->column[q], *b = &view->column[p];
    return a->kind == PM_LOGGER_POSITION && b->kind == PM_LOGGER_POSITION && a->part != b->part &&
           a->source != NULL && b->source != NULL && !a->guided && !b->guided &&
           view->column[a->mate].part == a->part && view->column[b->mate].part == b->part &&
           pm_unit_equal(&a->dimension, &b->dimension) && view->moves[q][b->mate] == 0 &&
           view->moves[p][a->mate] == 0 &&
           fmax(view->share[a->mate][p], view->share[b->mate][q]) > PM_LOGGER_SPRINGS;
}

// Returns how many reactions a part has.
static inline int pm_logger_reactions(const pm_logger_view *view, int part) {
    int count = 0;
    for (int k = 0; k < view->nreaction; ++k) {
        count += view->reaction[k].part == part;
    }
    return count;
}

static inline bool pm_logger_is_velocity(const pm_logger_column *c) {
    const pm_unit speed = pm_unit_parse("m/s"), turn = pm_unit_parse("rad/s");
    return pm_unit_equal(&c->dimension, &speed) || pm_unit_equal(&c->dimension, &turn);
}

// Returns true if velocity v moves position q by what angles tell.
static inline bool pm_logger_guides(const pm_logger_view *view, int q, int v) {
    bool found = false;
    for (int k = 0; k < view->nguide; ++k) {
        found = found || (view->guide[k].position == q && view->guide[k].velocity == v);
    }
    return found;
}

// Returns the first of the lengths that store energy together with position q, or q.
static inline int pm_logger_leader(const pm_logger_view *view, int q) {
    int first = 0;
    while (first < q && !view->central[first][q]) {
        ++first;
    }
    return first;
}

// Returns true if the inertia of velocity v is taken as constant. This holds for velocities that
// guide positions and for those that turn into other velocities.
static inline bool pm_logger_is_rigid(const pm_logger_view *view, int v) {
    bool found = false;
    for (int k = 0; k < view->nvariable; ++k) {
        found = found || view->gyrates[v][k] || view->gyrates[k][v] || pm_logger_guides(view, k, v);
    }
    return found;
}

// Returns true if the inertia of a velocity, or the capacity of another co-energy, may depend on
// positions although regressions do not show it.
static inline bool pm_logger_hides_turning(const pm_logger_view *view, int c) {
    const pm_logger_column *y = &view->column[c];
    bool places = false;
    for (int q = 0; q < view->nvariable; ++q) {
        const pm_logger_column *place = &view->column[q];
        places = places || (place->kind == PM_LOGGER_POSITION && !place->guided &&
                            (y->mate >= 0 ? y->mate == q : place->part == y->part));
    }
    return y->kind == PM_LOGGER_FLOW && y->relaxes == 0 && places && !pm_logger_is_rigid(view, c) &&
           !view->turns[c] && !(y->mate >= 0 && view->inertial[y->part]);
}

// Returns true if co-energies i < j may share an inertia or a capacity, although no input shows it:
// they are alike, and no positions belong to them.
static inline bool pm_logger_may_share(const pm_logger_view *view, int i, int j) {
    const pm_logger_column *a = &view->column[i], *b = &view->column[j];
    return i < j && a->part == b->part && a->kind == PM_LOGGER_FLOW && b->kind == PM_LOGGER_FLOW &&
           a->mate < 0 && b->mate < 0 && a->relaxes == 0 && b->relaxes == 0 &&
           pm_unit_equal(&a->dimension, &b->dimension);
}

// Returns true if an angle may have a spring: it does not turn around.
static inline bool pm_logger_may_spring(const pm_logger_column *angle) {
    return angle->angle && angle->largest - angle->least < PM_LOGGER_TURN;
}

// Returns true if a carrier acts through the port of two parts, or, for one == other, in a part.
static inline bool pm_logger_carries(const pm_logger_view *view, const pm_logger_carrier *c,
                                     int one, int other) {
    bool first = false, second = false, none = false;
    const int members[] = {c->flow, c->from, c->to};
    for (int k = 0; k < 3; ++k) {
        const int part = view->column[members[k]].part;
        first = first || part == one;
        second = second || part == other;
        none = none || (part != one && part != other);
    }
    return first && second && !none;
}

// What the user says about the columns.
typedef struct pm_logger_hints {
    const char *inputs; // "F,u"; NULL: columns that are staircases are inputs
    int npart, nport;
    const char *const *part;      // [npart] "arm=q1,w1", ...; none: one part
    const char *const *port;      // [nport] "arm,hand", ...; none: data tell
    int hidden;                   // variables that nobody measures; -1: data tell
    int seed;                     // of the training file
    double budget;                // s of CPU time for trials of what is hidden; 0: none is tried
    const pm_logger_guess *guess; // [columns of the dataset]; NULL: all as found
    const int *delay;             // [columns of the dataset] of inputs, in rows; NULL: none is
    const volatile sig_atomic_t *stop;
} pm_logger_hints;

// Describes the columns of measurements. `dataset` and the texts of `hints` must outlive the view.
// PM_EUSAGE: a hint names no column or part; PM_EDATA: too many columns, or too few samples;
// PM_ENOMEM. After a failure nothing is left to free.
pm_status pm_logger_look(pm_logger_view *view, const pm_dataset *dataset,
                         const pm_logger_hints *hints);
static inline void pm_logger_view_free(pm_logger_view *view) {
    pm_arena_free(&view->arena);
}

#endif

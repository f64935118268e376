// Writes the laws of a training file for a logger's columns: energies, friction, conduction and
// flow. Their learned constants begin at values that regressions give.
#ifndef PM_TRAINER_PROPOSE_LOGGER_LAWS_H
#define PM_TRAINER_PROPOSE_LOGGER_LAWS_H

#include <math.h>
#include <stdio.h>

#include "propose/logger_draft.h"

#define PM_LOGGER_TEXT 128      // room for a name
#define PM_LOGGER_NUMBERS 8     // texts of pm_logger_number that are kept
#define PM_LOGGER_LONG_TEXT 512 // room for a law

// The alternatives of the choices, in the order in which they are believed.
enum { BENT_FRICTION, WAVY_FRICTION, DRY_FRICTION, QUADRATIC_FRICTION, LINEAR_FRICTION };
enum { SUMS_OF_POSITIONS, NETWORK_OF_POSITIONS, SPRINGS_OF_ANGLES };
enum { SHOWN_INERTIA, CONSTANT_INERTIA, LEARNED_INERTIA, SUMMED_INERTIA };
enum { CONSTANT_COUPLING, LEARNED_COUPLING };
enum { SHOWN_CAPACITY, CONSTANT_CAPACITY, LEARNED_CAPACITY };
enum { RADIATION, CONVECTION, CONSTANT_CONDUCTION };
enum { POWERS_OF_LEVELS, NETWORKS_OF_LEVELS };

// A training file while it is being written. Constants of a model are collected in a text of their
// own, since they stand before the formulas that name them.
typedef struct pm_logger_writer {
    FILE *f;
    const pm_logger_view *v;
    const int *chosen;
    const char *found; // values of constants (pm_search_trial); or NULL
    bool lean;         // without those of them that are spare
    char *constants;
    size_t size;
    FILE *list; // writes to `constants`
    char *body;
    size_t body_size;
    FILE *model; // writes to `body`
    int nnumber;
    char number[PM_LOGGER_NUMBERS][2 * PM_LOGGER_TEXT]; // the last ones that were written
} pm_logger_writer;

static inline int pm_logger_count(const pm_logger_view *v, int part, pm_logger_kind kind) {
    int count = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        count += pm_logger_is(v, c, part, kind);
    }
    return count;
}

// Returns true if co-energy c loses energy to the surroundings. What relaxes in a cell heats the
// thermometer of its part instead, if there is one.
static inline bool pm_logger_loses(const pm_logger_view *v, int c) {
    const pm_logger_column *y = &v->column[c];
    return y->kind == PM_LOGGER_FLOW && (y->relaxes == 0 || v->thermometer[y->part] < 0);
}

static inline double pm_logger_highest(const pm_logger_view *v) {
    double highest = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        highest =
            v->column[c].kind == PM_LOGGER_LEVEL ? fmax(highest, v->column[c].largest) : highest;
    }
    return highest;
}

bool pm_logger_begin(pm_logger_writer *w);

// Ends a model: writes its constants, then its body.
void pm_logger_end(pm_logger_writer *w, const char *name);

// Adds a positive learned constant "<kind>_<name>" to the model, unless it is there. `more` is "",
// or one of the texts below.
void pm_logger_constant(pm_logger_writer *w, const char *kind, const char *name, double start,
                        const char *more);
#define PM_LOGGER_SHARED ", shared: true"     // by all models that have it
#define PM_LOGGER_OPTIONAL ", optional: true" // of a part of a law that may not be there at all

// Adds a learned constant of either sign, whose size is about `size` in its unit. The constant in
// the file is a number about 1, since a fit moves it by no more than 1 at once. Returns the text by
// which a formula names the value, which the next PM_LOGGER_NUMBERS calls leave as it is.
const char *pm_logger_number(pm_logger_writer *w, const char *kind, const char *name, double start,
                             double size);

// Return the sizes of the rate of the energy variable that belongs to y, and of a coefficient by
// which two co-energies move each other.
static inline double pm_logger_rate(const pm_logger_writer *w, const pm_logger_column *y) {
    return y->inertia * y->deviation * w->v->fastest;
}
static inline double pm_logger_between(const pm_logger_writer *w, const pm_logger_column *a,
                                       const pm_logger_column *b) {
    return sqrt(a->inertia * b->inertia) * w->v->fastest;
}

static inline const char *pm_logger_separate(bool *some) {
    const char *separator = *some ? ", " : "";
    *some = true;
    return separator;
}

// Writes C: the co-energy of velocities, temperatures and the like.
void pm_logger_write_coenergy(pm_logger_writer *w, int part);

// Writes V, the energy of positions.
void pm_logger_write_energy(pm_logger_writer *w, int part);

// Writes what couples positions with velocities, and co-energies of different kinds.
void pm_logger_write_reversible(pm_logger_writer *w, int part);

// Writes pairs, after a separator, for guides and carriers through the port of two parts, or of one
// part if both are the same: how velocities move positions, and what a flow carries. Sets *some if
// there are any.
void pm_logger_write_turns(pm_logger_writer *w, const int *parts, bool *some);

// Writes a pair that conducts heat between two temperatures, or a temperature and a bath: x and y
// are the names of the groups with their prefixes, dx and dy those of their co-energies. The
// conductance is the sum of a constant, of that of radiation, and of that of natural convection,
// a power of the difference of the temperatures. The input `opening` multiplies it, unless it is
// NULL.
void pm_logger_write_conduction(pm_logger_writer *w, const char *name, const char *x, const char *y,
                                const char *dx, const char *dy, double start,
                                const pm_logger_column *opening);

// Writes the coefficient by which an input moves a co-energy, with a lever and a valve where the
// data show them: "name" is that of the coefficient.
void pm_logger_write_gain(pm_logger_writer *w, const char *name, const pm_logger_action *action);

// Writes to `text` the resistance of a cell: it rises where the cell is nearly empty, and falls
// with heat. `of` and `at` are the prefixes of constants and of groups.
void pm_logger_cell_resistance(char *text, size_t size, const pm_logger_view *v,
                               const pm_logger_column *cell, const char *of, const char *at);

// Writes to `text` the factor of the resistance of a cell: the current plus an inverse hyperbolic
// sine of it, which stands for the exchange of charge (Butler and Volmer).
static inline void pm_logger_cell_current(char *text, size_t size, const pm_logger_column *cell,
                                          const char *of, const char *current) {
    char x[PM_LOGGER_LONG_TEXT];
    snprintf(x, sizeof x, "%.40s/%.100sexchange_%.40s", current, of, cell->name);
    snprintf(text, size, "(%s + %sactivation_%s*ln(%s + sqrt((%s)^2 + 1)))", current, of,
             cell->name, x, x);
}

// Writes to `flow` [size] the entropy with which a unit of an input warms a temperature, and to
// `lost` [size] the strength of its loss ("": it has none); end b of the port has the input. An
// electric current carries entropy, so that one direction may cool (Peltier), and loses power in a
// resistance and in a drop of voltage. Another input that is never negative warms in proportion.
// Any other one has two parts: heat that changes sign with it, as that of a reaction, and heat that
// grows with its square. The second part is the loss in the resistance of a cell if the input is
// its current, and otherwise has a learned coefficient.
void pm_logger_write_heat(pm_logger_writer *w, char *flow, char *lost, size_t size,
                          const char *name, const pm_logger_action *action);

// Writes the coefficient of friction or resistance, which depends on x, a co-energy or a difference
// of two: "(linear_name + ...)". y describes the co-energy, `other` the one that is subtracted or
// is NULL, and `start` is where the linear part begins.
void pm_logger_write_resistance(pm_logger_writer *w, const char *name, const char *x,
                                const pm_logger_column *y, const pm_logger_column *other,
                                double start, const pm_logger_column *opening);

// Writes friction and resistance of co-energy c whose heat goes to the surroundings, or to
// temperature t if it is not -1. `of` and `to` stand before the names of the groups: "a." and "b."
// in a port.
void pm_logger_write_friction(pm_logger_writer *w, int c, const char *of, int t, const char *to);

// Writes the loss between co-energies i and j, and the temperature that it heats, if there is one.
// `one` and `two` stand before the names of the groups of their parts.
void pm_logger_write_rubbing(pm_logger_writer *w, int i, int j, const char *one, const char *two);

// Writes the two pairs of friction of a tide: along the orbit less the spin, and along the radius.
// `spin`, `orbit` and `heat` stand before the names of groups.
void pm_logger_write_tide(pm_logger_writer *w, const pm_logger_tide *tide, const char *spin,
                          const char *orbit, const char *heat);

// Returns the law by which fluid leaves a level, and adds its constants: a power of it, such as
// Torricelli's root. It is smooth where the vessel is empty.
const char *pm_logger_flow(pm_logger_writer *w, char *text, size_t size, char end,
                           const pm_logger_column *h);

// Returns the law by which fluid spills over the brim of a level of end a; "0": it has none.
const char *pm_logger_spill(pm_logger_writer *w, char *text, size_t size,
                            const pm_logger_column *h);

// Writes what falls from a level through an outflow that an input opens: with loss, or into the
// levels below.
void pm_logger_write_gate(pm_logger_writer *w, int level, int input, bool loses);

#endif

// The text of laws and of the constants in them.
#include "propose/logger_laws.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAST_CONSTANT 1e-12 // a positive constant begins at no less
#define SMALL 0.1 // with which a part of a law begins that may not be there, relative to the rest
#define DRY 0.02  // of the deviation of a velocity: dry friction is smooth below it
#define COUPLED 1e-3          // of the changes that one co-energy explains of another one's
#define WIDTH 25              // a temperature counts as varying by at least 1/25 of it
#define LEAST_POWER 1.5       // of a temperature
#define ROOT 0.5              // power of a level with which its outflow begins
#define EMPTY 1e-3            // of the highest level: below it a vessel is empty
#define CONVECTION_POWER 0.33 // power of a difference of temperatures with which a fit begins
#define STILL 0.01            // K, below which convection no longer depends on it
#define ROOM_TEMPERATURE 293.15
#define BENDS 3 // bends of a function of one variable, each of which has a place and a width

bool pm_logger_is(const pm_logger_view *v, int c, int part, pm_logger_kind kind) {
    return v->column[c].part == part && v->column[c].kind == kind;
}

int pm_logger_count(const pm_logger_view *v, int part, pm_logger_kind kind) {
    int count = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        count += pm_logger_is(v, c, part, kind);
    }
    return count;
}

// Returns true if two co-energies move each other: those of one kind by a loss, as the voltage
// across a resistor, those of different kinds, such as a current and an angular velocity, without
// loss.
bool pm_logger_is_coupled(const pm_logger_view *v, int i, int j, bool same_kind) {
    const pm_logger_column *a = &v->column[i], *b = &v->column[j];
    const bool same = pm_unit_equal(&a->dimension, &b->dimension);
    return a->kind == PM_LOGGER_FLOW && b->kind == PM_LOGGER_FLOW && same == same_kind &&
           (same || a->mate < 0 || b->mate < 0) && fmax(v->share[i][j], v->share[j][i]) > COUPLED;
}

double pm_logger_highest(const pm_logger_view *v) {
    double highest = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        highest =
            v->column[c].kind == PM_LOGGER_LEVEL ? fmax(highest, v->column[c].largest) : highest;
    }
    return highest;
}

bool pm_logger_begin(pm_logger_writer *w) {
    w->list = open_memstream(&w->constants, &w->size);
    w->model = open_memstream(&w->body, &w->body_size);
    return w->list != NULL && w->model != NULL;
}

// Ends a model: writes its constants, then its body, unless it could not begin.
void pm_logger_end(pm_logger_writer *w, const char *name) {
    const bool begun = w->list != NULL && w->model != NULL;
    if (w->list != NULL) {
        fclose(w->list);
    }
    if (w->model != NULL) {
        fclose(w->model);
    }
    if (begun) {
        fprintf(w->f, "  %s:\n", name);
        if (w->size > 0) {
            fprintf(w->f, "    constants:\n%s", w->constants);
        }
        fputs(w->body, w->f);
    }
    free(w->constants);
    free(w->body);
    w->list = w->model = NULL;
    w->constants = w->body = NULL;
}

// Adds a learned constant "<kind>_<name>" to the model.
void pm_logger_constant(pm_logger_writer *w, const char *kind, const char *name, double start,
                        bool positive) {
    fprintf(w->list, "      %s_%s: {learned: %.6g%s}\n", kind, name,
            positive ? fmax(fabs(start), LEAST_CONSTANT) : start,
            positive ? ", positive: true" : "");
}

const char *pm_logger_separate(bool *some) {
    const char *separator = *some ? ", " : "";
    *some = true;
    return separator;
}

// Returns true if an inertia of this part may depend on its positions: it is that of velocities.
static bool shares_inertia(const pm_logger_writer *w, int c) {
    const pm_logger_column *y = &w->v->column[c];
    return w->chosen[PM_LOGGER_INERTIA] == LEARNED_INERTIA && y->mate >= 0 &&
           y->kind == PM_LOGGER_FLOW && pm_logger_count(w->v, y->part, PM_LOGGER_POSITION) > 1;
}

// Writes features of all positions of a part: sine and cosine of angles, and other positions.
static void write_position_features(const pm_logger_writer *w, int part, const char *prefix) {
    bool some = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        if (!pm_logger_is(w->v, c, part, PM_LOGGER_POSITION)) {
        } else if (q->angle) {
            fprintf(w->model, "%s\"sin(%s%s)\", \"cos(%s%s)\"", pm_logger_separate(&some), prefix,
                    q->name, prefix, q->name);
        } else {
            fprintf(w->model, "%s%s%s", pm_logger_separate(&some), prefix, q->name);
        }
    }
}

// Writes the co-energy of a temperature: a constant heat capacity and, if it `bends`, powers of the
// temperature, so that the capacity is positive at all temperatures.
static void write_capacity(pm_logger_writer *w, const pm_logger_column *y, bool bends) {
    const char *T = y->name;
    const double T0 = y->mean, width = 2 * y->deviation + T0 / WIDTH;
    const double power[] = {1, LEAST_POWER + T0 / width, -LEAST_POWER - T0 / width};
    static const char *const names[] = {"linear", "rising", "falling"};
    if (y->free_scale) {
        fprintf(w->model,
                "      - \"%s*ln(%s/%.6g) - %s\"   # no power is known: the capacity is 1 J/K\n", T,
                T, T0, T);
    } else {
        pm_logger_constant(w, "capacity", T, y->inertia, true);
        fprintf(w->model, "      - \"capacity_%s*(%s*ln(%s/%.6g) - %s)\"\n", T, T, T, T0, T);
    }
    if (!bends) {
        return;
    }
    for (size_t k = 0; k < sizeof power / sizeof *power; ++k) {
        const double p = power[k];
        pm_logger_constant(w, names[k], T, SMALL * y->inertia, true);
        fprintf(w->model, "      - \"%s_%s*%.6g*(%s/%.6g)^(%.6g)\"\n", names[k], T,
                T0 / (p * (p + 1)), T, T0, p + 1);
    }
    pm_logger_constant(w, "inverse", T, SMALL * y->inertia, true);
    fprintf(w->model, "      - \"inverse_%s*%.6g*ln(%.6g/%s)\"\n", T, T0, T0, T);
}

// Writes the co-energy of what an inductance or a capacity adds that depends on the co-energy
// itself: it is positive, grows outside the data, and has bells of learned places and widths.
static void write_bends(pm_logger_writer *w, const pm_logger_column *y, double inertia) {
    const char *name = y->name;
    const double d = fmax(fabs(y->least), fabs(y->largest));
    pm_logger_constant(w, "more", name, SMALL * inertia, true);
    fprintf(w->model, "      - \"more_%s*%s^4/%.4g\"\n", name, name, 4 * 3 * d * d);
    for (int k = 0; k < BENDS; ++k) {
        char numbered[PM_LOGGER_TEXT];
        snprintf(numbered, sizeof numbered, "%.40s_%d", name, k + 1);
        const char *n = numbered;
        pm_logger_constant(w, "bell", n, SMALL * inertia, true);
        pm_logger_constant(w, "place", n, y->mean + (k - BENDS / 2) * y->deviation, false);
        pm_logger_constant(w, "width", n, y->deviation, true);
        fprintf(w->model,
                "      - \"bell_%s*width_%s*(sqrt((%s - place_%s)^2 + width_%s^2) - width_%s)\"\n",
                n, n, name, n, n, n);
    }
}

// Writes C: the co-energy of velocities, temperatures and the like.
void pm_logger_write_coenergy(pm_logger_writer *w, int part) {
    const bool bends = w->chosen[PM_LOGGER_CAPACITY] == LEARNED_CAPACITY;
    bool some = false, shared = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *y = &w->v->column[c];
        if (y->part != part || y->kind == PM_LOGGER_POSITION) {
            continue;
        }
        const double own = y->inertia;
        if (!some) {
            fputs("    coenergy:\n", w->model);
        }
        some = true;
        if (y->kind == PM_LOGGER_TEMPERATURE) {
            write_capacity(w, y, bends);
        } else if (shares_inertia(w, c)) {
            shared = true;
        } else {
            if (y->free_scale) {
                fprintf(w->model, "      - \"%s^2/2\"   # nothing fixes its scale, which is 1\n",
                        y->name);
            } else {
                pm_logger_constant(w, "inertia", y->name, own, true);
                fprintf(w->model, "      - \"inertia_%s*%s^2/2\"\n", y->name, y->name);
            }
            if (bends && y->kind == PM_LOGGER_LEVEL) {
                pm_logger_constant(w, "wider", y->name, SMALL * own, true);
                fprintf(w->model, "      - \"wider_%s*%s^3/%.4g\"\n", y->name, y->name,
                        2 * 3 * y->largest);
            } else if (bends && y->mate < 0) {
                write_bends(w, y, own);
            }
        }
    }
    if (shared) {
        double first = 0;
        bool listed = false;
        fputs("      - {inertia: {of: [", w->model);
        for (int c = 0; c < w->v->nvariable; ++c) {
            const pm_logger_column *y = &w->v->column[c];
            if (y->part == part && shares_inertia(w, c)) {
                first = !listed && y->free_scale ? 1 : first;
                fprintf(w->model, "%s%s", pm_logger_separate(&listed), y->name);
            }
        }
        fputs("], features: [", w->model);
        write_position_features(w, part, "");
        fputs("], hidden: [6], skip: quadratic", w->model);
        fputs(first > 0 ? ", first: 1.0}}\n" : "}}\n", w->model);
    }
}

// Writes V, the energy of positions.
void pm_logger_write_energy(pm_logger_writer *w, int part) {
    const int positions = pm_logger_count(w->v, part, PM_LOGGER_POSITION);
    bool feeds = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        feeds = feeds || (w->v->column[c].part == part && w->v->column[c].feeds);
    }
    if (positions == 0 && !feeds) {
        return;
    }
    if (positions > 0 && w->chosen[PM_LOGGER_POTENTIAL] == NETWORK_OF_POSITIONS) {
        fputs("    energy:\n      - {features: [", w->model);
        write_position_features(w, part, "");
        fputs("], hidden: [8], skip: quadratic}\n", w->model);
        return;
    }
    fputs("    energy:\n", w->model);
    for (int c = 0; c < w->v->nvariable; ++c) {
        if (w->v->column[c].part == part && w->v->column[c].feeds) {
            fprintf(w->model, "      - \"%.4g*z_%s\"   # of the height through which fluid falls\n",
                    pm_logger_highest(w->v), w->v->column[c].name);
        }
    }
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        if (!pm_logger_is(w->v, c, part, PM_LOGGER_POSITION)) {
            continue;
        }
        const pm_logger_column *v = &w->v->column[q->mate];
        const double stiffness = -v->inertia * w->v->coupling[q->mate][c];
        if (q->angle) {
            pm_logger_constant(w, "cos1", q->name, -stiffness * cos(q->mean), false);
            pm_logger_constant(w, "sin1", q->name, -stiffness * sin(q->mean), false);
            pm_logger_constant(w, "cos2", q->name, 0, false);
            pm_logger_constant(w, "sin2", q->name, 0, false);
            fprintf(w->model,
                    "      - \"cos1_%s*cos(%s) + sin1_%s*sin(%s) + cos2_%s*cos(2*%s) + "
                    "sin2_%s*sin(2*%s)\"\n",
                    q->name, q->name, q->name, q->name, q->name, q->name, q->name, q->name);
        } else {
            const double d = fmax(fabs(q->least), fabs(q->largest));
            const double force = v->inertia * v->constant;
            pm_logger_constant(w, "k1", q->name, -force * d, false);
            pm_logger_constant(w, "k2", q->name, stiffness * d * d, false);
            pm_logger_constant(w, "k3", q->name, 0, false);
            pm_logger_constant(w, "k4", q->name, 0, false);
            fprintf(w->model,
                    "      - \"k1_%s*(%s/%.6g) + k2_%s*(%s/%.6g)^2/2 + k3_%s*(%s/%.6g)^3 + "
                    "k4_%s*(%s/%.6g)^4\"\n",
                    q->name, q->name, d, q->name, q->name, d, q->name, q->name, d, q->name, q->name,
                    d);
        }
    }
    // What two positions store together: a spring between them, or angles that add up.
    for (int i = 0; i < w->v->nvariable; ++i) {
        for (int j = i + 1; j < w->v->nvariable; ++j) {
            const pm_logger_column *a = &w->v->column[i], *b = &w->v->column[j];
            if (!pm_logger_is(w->v, i, part, PM_LOGGER_POSITION) ||
                !pm_logger_is(w->v, j, part, PM_LOGGER_POSITION) || a->angle != b->angle) {
                continue;
            }
            char both[PM_LOGGER_TEXT];
            snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
            const double together = -w->v->column[a->mate].inertia * w->v->coupling[a->mate][j];
            if (a->angle) {
                static const char *const kinds[] = {"cosp", "sinp", "cosm", "sinm"};
                for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
                    pm_logger_constant(w, kinds[k], both, 0, false);
                }
                fprintf(w->model,
                        "      - \"cosp_%s*cos(%s + %s) + sinp_%s*sin(%s + %s) + cosm_%s*cos(%s - "
                        "%s) + sinm_%s*sin(%s - %s)\"\n",
                        both, a->name, b->name, both, a->name, b->name, both, a->name, b->name,
                        both, a->name, b->name);
            } else {
                // A spring between two points acts on their difference.
                const double da = fmax(fabs(a->least), fabs(a->largest));
                const double db = fmax(fabs(b->least), fabs(b->largest));
                const bool alike = pm_unit_equal(&a->dimension, &b->dimension);
                pm_logger_constant(w, "k", both, together * da * db * (alike ? -1 : 1), false);
                if (alike) {
                    pm_logger_constant(w, "k3", both, 0, false);
                    pm_logger_constant(w, "k4", both, 0, false);
                    fprintf(w->model,
                            "      - \"k_%s*(%s - %s)^2/%.6g + k3_%s*((%s - %s)/%.6g)^3 + "
                            "k4_%s*((%s - %s)/%.6g)^4\"\n",
                            both, a->name, b->name, 2 * da * db, both, a->name, b->name, da + db,
                            both, a->name, b->name, da + db);
                } else {
                    fprintf(w->model, "      - \"k_%s*(%s/%.6g)*(%s/%.6g)\"\n", both, a->name, da,
                            b->name, db);
                }
            }
        }
    }
}

// Writes what couples positions with velocities, and co-energies of different kinds.
void pm_logger_write_reversible(pm_logger_writer *w, int part) {
    bool some = false;
    for (int i = 0; i < w->v->nvariable; ++i) {
        const pm_logger_column *a = &w->v->column[i];
        if (a->part != part) {
            continue;
        }
        if (a->kind == PM_LOGGER_POSITION) {
            fprintf(w->model, "%s[%s, %s, 1.0]", some ? ", " : "    reversible: {given: [", a->name,
                    w->v->column[a->mate].name);
            some = true;
        }
        for (int j = i + 1; j < w->v->nvariable; ++j) {
            const pm_logger_column *b = &w->v->column[j];
            if (b->part == part && pm_logger_is_coupled(w->v, i, j, false)) {
                char both[PM_LOGGER_TEXT];
                snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
                pm_logger_constant(
                    w, "coupling", both,
                    (a->inertia * w->v->coupling[i][j] - b->inertia * w->v->coupling[j][i]) / 2,
                    false);
                fprintf(w->model, "%s[%s, %s, \"coupling_%s\"]",
                        some ? ", " : "    reversible: {given: [", a->name, b->name, both);
                some = true;
            }
        }
    }
    fputs(some ? "]}\n" : "", w->model);
}

// Writes a pair that conducts heat between two temperatures, or a temperature and a bath: x and y
// are the names of the groups with their prefixes, dx and dy those of their co-energies. The
// conductance is the sum of a constant, of that of radiation, and of that of natural convection,
// a power of the difference of the temperatures.
void pm_logger_write_conduction(pm_logger_writer *w, const char *name, const char *x, const char *y,
                                const char *dx, const char *dy, double start) {
    const double T0 = ROOM_TEMPERATURE;
    pm_logger_constant(w, "conductance", name, start, true);
    fprintf(w->model, "[%s, %s, \"(conductance_%s", x, y, name);
    if (w->chosen[PM_LOGGER_CONDUCTION] == RADIATION) {
        pm_logger_constant(w, "radiation", name, SMALL * fabs(start), true);
        fprintf(w->model, " + radiation_%s*(%s + %s)*(%s^2 + %s^2)/%.6g", name, dx, dy, dx, dy,
                4 * T0 * T0 * T0);
    }
    if (w->chosen[PM_LOGGER_CONDUCTION] <= CONVECTION) {
        pm_logger_constant(w, "convection", name, SMALL * fabs(start), true);
        pm_logger_constant(w, "power", name, CONVECTION_POWER / 2, true);
        fprintf(w->model, " + convection_%s*exp(power_%s*ln((%s - %s)^2 + %.4g))", name, name, dx,
                dy, STILL * STILL);
    }
    fprintf(w->model, ")*%s/%s\"]", dy, dx);
}

// Writes a positive factor that depends on the variable x: an exponential of bends with learned
// places and widths. It begins with 1.
static void write_factor(pm_logger_writer *w, const char *name, const char *x, double mean,
                         double deviation) {
    fputs("*exp(", w->model);
    for (int k = 0; k < BENDS; ++k) {
        char numbered[PM_LOGGER_TEXT];
        snprintf(numbered, sizeof numbered, "%.40s_%d", name, k + 1);
        const char *n = numbered;
        pm_logger_constant(w, "bend", n, 0, false);
        pm_logger_constant(w, "middle", n, mean + (k - BENDS / 2) * deviation, false);
        pm_logger_constant(w, "range", n, deviation, true);
        fprintf(w->model, "%sbend_%s*(%s - middle_%s)/sqrt((%s - middle_%s)^2 + range_%s^2)",
                k > 0 ? " + " : "", n, x, n, x, n, n);
    }
    fputs(")", w->model);
}

// Writes friction and resistance of one co-energy.
void pm_logger_write_friction(pm_logger_writer *w, int c) {
    const pm_logger_column *y = &w->v->column[c];
    const char *name = y->name;
    const double start = fmax(y->inertia * y->decay, SMALL * y->inertia * w->v->fastest * SMALL);
    const double d = fmax(fabs(y->least), fabs(y->largest)), dry = DRY * y->deviation;
    const int law = w->chosen[PM_LOGGER_FRICTION];
    pm_logger_constant(w, "linear", name, start, true);
    fprintf(w->model, "[a.%s, b.s, \"(linear_%s", name, name);
    if (law <= QUADRATIC_FRICTION) {
        pm_logger_constant(w, "quadratic", name, SMALL * start, true);
        fprintf(w->model, " + quadratic_%s*|a.%s|/%.4g", name, name, d);
    }
    if (law == DRY_FRICTION) {
        pm_logger_constant(w, "dry", name, SMALL * start, true);
        pm_logger_constant(w, "width", name, dry, true); // of the step at rest
        fprintf(w->model, " + dry_%s*%.4g/sqrt(a.%s^2 + width_%s^2)", name, d, name, name);
    }
    fputs(")", w->model);
    if (law == DRY_FRICTION && y->mate < 0) {
        char x[PM_LOGGER_TEXT];
        snprintf(x, sizeof x, "a.%.40s", name);
        write_factor(w, name, x, y->mean, y->deviation);
    }
    fputs("*b.dE.s\"]", w->model);
}

static bool shows_no_length(const pm_logger_column *h) {
    const pm_unit length = pm_unit_parse("m");
    return h->source != NULL && !h->feeds && !pm_unit_equal(&h->dimension, &length);
}

// Returns the law by which fluid leaves a level: a power of it, such as Torricelli's root. It is
// smooth where the vessel is empty.
const char *pm_logger_flow(char *text, size_t size, char end, const pm_logger_column *h) {
    // A sensor that shows no length may have another zero.
    char zero[PM_LOGGER_TEXT] = "";
    if (shows_no_length(h)) {
        snprintf(zero, sizeof zero, " - zero_%s", h->name);
    }
    snprintf(text, size, "outflow_%s*exp(power_%s*ln(((%c.%s%s)/%.4g)^2 + %.4g))", h->name, h->name,
             end, h->name, zero, h->largest, EMPTY * EMPTY);
    return text;
}

void pm_logger_flow_constants(pm_logger_writer *w, const pm_logger_column *h) {
    // At its mean the derivative of the flow by the level is that of the regression.
    const double part = pow(fmax(h->mean / h->largest, SMALL), ROOT);
    fprintf(w->list, "      outflow_%s: {learned: %.6g, positive: true, shared: true}\n", h->name,
            fmax(h->inertia * fabs(h->decay) * h->mean / (ROOT * part), LEAST_CONSTANT));
    fprintf(w->list, "      power_%s: {learned: %.6g, positive: true, shared: true}\n", h->name,
            ROOT / 2);
    if (shows_no_length(h)) {
        fprintf(w->list, "      zero_%s: {learned: 0}\n", h->name);
    }
}

// Writes what leaves one level and falls into another one. The fluid that falls loses its energy
// before it arrives; the height through which it falls gives the energy of the other level.
void pm_logger_write_falls(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    const double highest = pm_logger_highest(v);
    bool some = false;
    for (int i = 0; i < v->nvariable; ++i) {
        const pm_logger_column *h = &v->column[i];
        if (!pm_logger_is(v, i, part, PM_LOGGER_LEVEL)) {
            continue;
        }
        pm_logger_flow_constants(w, h);
        for (int j = 0; j < v->nvariable; ++j) {
            char flow[PM_LOGGER_LONG_TEXT];
            if (pm_logger_is(v, j, part, PM_LOGGER_LEVEL) && v->falls[i][j]) {
                fprintf(w->model, "%s[a.%s, b.z, \"%s/%.4g\"]",
                        some ? ", " : "    reversible: {given: [", v->column[j].name,
                        pm_logger_flow(flow, sizeof flow, 'a', h), highest);
                some = true;
            }
        }
    }
    fputs(some ? "]}\n" : "", w->model);
}

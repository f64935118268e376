// The text of a scene and of a training file for a logger's columns.
#include "propose/logger_draft.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/digest.h"
#include "base/files.h"
#include "base/path.h"
#include "propose/logger_laws.h"
#include "propose/logger_mixture.h"
#include "propose/search.h"

#define FINE 0.15        // substep times the fastest linear rate, where steps are fitted
#define MEDIUM 0.25      // likewise for noisy data
#define COARSE 0.5       // likewise for trials
#define LEAST_START 1e-9 // deviation of a hidden start
#define MOST_SUBSTEPS 32
#define MOST_COARSE 1e-4 // of the deviation of a column: what steps may cost over a trajectory
#define STIFFER 4        // times as many substeps at most as regressions ask for
#define SMALL 0.1 // with which a part of a law begins that may not be there, relative to the rest
#define ITERATIONS 400
#define PIECES 5            // of a record that both teaches and judges
#define TRIES 6             // draws of the first weights of a fit of noisy data
#define ESTIMATED_PART 0.05 // of a trajectory: from it follows its start
#define FEWEST_SAMPLES 20   // likewise
#define BATCH 4096
#define SCENE_NAME 24 // bytes of the name of a scene, so that a channel also has room for a part's
#define EMPTY 1e-3    // of the highest level: below it a vessel is empty
#define ROUND 0.05    // of the deviation: the edge where a sensor begins to saturate

// --- which columns ---

// Returns true if the part needs a port to the surroundings, which take up the heat of a co-energy
// that loses energy.
static bool loses(const pm_logger_view *v, int part) {
    bool some = pm_logger_count(v, part, PM_LOGGER_LEVEL) > 0 ||
                (pm_logger_reactions(v, part) > 0 && v->thermometer[part] < 0);
    for (int c = 0; c < v->nvariable; ++c) {
        some = some || (v->column[c].part == part && (v->leaks[c] || pm_logger_loses(v, c)));
    }
    return some;
}

// Returns true if an input opens the outflow of a level of the part, or of any if it is -1.
static bool gates(const pm_logger_view *v, int input, int part) {
    bool some = false;
    for (int c = 0; c < v->nvariable; ++c) {
        some = some || (v->gate[c] == input && (part < 0 || v->column[c].part == part));
    }
    return some;
}

static bool acts_on(const pm_logger_view *v, int input, int part) {
    bool acts = false;
    for (int a = 0; a < v->naction; ++a) {
        acts = acts || (v->action[a].input == input && v->column[v->action[a].target].part == part);
    }
    for (int k = 0; k < v->nconverter; ++k) {
        acts =
            acts || (v->converter[k].input == input && v->column[v->converter[k].one].part == part);
    }
    return acts || gates(v, input, part);
}

// The levels of a part exchange fluid if there are several; it then falls from one to the next.
static bool falls(const pm_logger_view *v, int part) {
    return pm_logger_count(v, part, PM_LOGGER_LEVEL) > 1;
}

// Returns true if something constant moves a co-energy of the part, or of any part if it is -1.
static bool pushed(const pm_logger_view *v, int part) {
    bool some = false;
    for (int c = 0; c < v->nvariable; ++c) {
        some = some || ((v->pushes[c] || v->leaks[c]) && (part < 0 || v->column[c].part == part));
    }
    return some;
}

// Writes what an input is between its samples, and how much later it acts, as the scene has them.
static void write_hold(const pm_logger_view *v, const pm_logger_column *input,
                       char text[PM_LOGGER_TEXT]) {
    const char *hold = input->held ? "previous" : "smooth";
    if (input->delay == 0) {
        snprintf(text, PM_LOGGER_TEXT, "%s", hold);
    } else {
        snprintf(text, PM_LOGGER_TEXT, "%s, delay: %.9g", hold, input->delay * v->dataset->dt);
    }
}

// Returns true if the input has one of two effects on this part, or on any part if it is -1.
static bool has_effect(const pm_logger_view *v, int input, int part, pm_logger_effect one,
                       pm_logger_effect other) {
    bool has = false;
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        has = has ||
              (action->input == input && (part < 0 || v->column[action->target].part == part) &&
               (action->effect == one || action->effect == other));
    }
    return has;
}

// Returns true if heat leaves through an input: it acts through a resistance, opens one between two
// co-energies, or cools. *bath, unless it is NULL, receives the temperature at which it leaves, as
// the scene has it: that of the input, if it is a bath elsewhere.
static bool takes_heat(const pm_logger_view *v, int input, int part, char bath[PM_LOGGER_TEXT]) {
    bool takes =
        has_effect(v, input, part, PM_LOGGER_THROUGH, PM_LOGGER_COOLS) || gates(v, input, part);
    double T = v->bath;
    int enters = 0;
    for (int k = 0; k < v->nconverter; ++k) {
        const pm_logger_converter *c = &v->converter[k];
        takes = takes ||
                (c->input == input && c->loses && (part < 0 || v->column[c->one].part == part));
    }
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        if (action->input == input && action->effect == PM_LOGGER_COOLS) {
            T = action->bath;
            enters = action->enters > 0 ? action->enters : enters;
        }
    }
    enters = has_effect(v, input, part, PM_LOGGER_BATH, PM_LOGGER_BATH) ? input : enters;
    if (bath != NULL && enters > 0) {
        char hold[PM_LOGGER_TEXT];
        write_hold(v, &v->column[enters], hold);
        snprintf(bath, PM_LOGGER_TEXT, "[\"%.40s\"], hold: %.60s", v->column[enters].source, hold);
    } else if (bath != NULL) {
        snprintf(bath, PM_LOGGER_TEXT, "[%.6g]", takes ? T : 0.0);
    }
    return takes;
}

// Lists the groups of the boundary input of an input, for a part or for all (-1): x carries energy,
// s entropy, z the fluid that falls from one level to another.
static const char *groups_of(const pm_logger_view *v, int input, int part) {
    bool bath = false, other = false;
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        const bool acts =
            action->input == input && (part < 0 || v->column[action->target].part == part);
        bath = bath || (acts && action->effect == PM_LOGGER_BATH);
        other = other || (acts && action->effect != PM_LOGGER_BATH);
    }
    for (int k = 0; k < v->nconverter; ++k) {
        const pm_logger_converter *c = &v->converter[k];
        other = other || (c->input == input && (part < 0 || v->column[c->one].part == part));
    }
    return gates(v, input, part) ? "x, s, z"
           : !other              ? "s"
           : bath || has_effect(v, input, part, PM_LOGGER_HEATS, PM_LOGGER_WARMS) ||
                   takes_heat(v, input, part, NULL)
               ? "x, s"
               : "x";
}

// --- choices ---

// All alternatives of a choice, in the order in which they are believed.
typedef struct choice {
    const char *name;
    int count;
    const char *alternative[PM_LOGGER_ALTERNATIVES];
} choice;

static const choice choices[PM_LOGGER_NCHOICE] = {
    {"friction",
     5,
     {"what regressions show", "linear, quadratic and dry, with many bends",
      "linear, quadratic and dry", "linear and quadratic", "linear"}},
    {"energy of positions",
     3,
     {"a sum over positions", "a network of all positions",
      "a sum over positions, with springs of angles"}},
    {"inertia",
     4,
     {"sums over positions where velocities or inputs show it", "constant",
      "a network of positions", "sums over positions"}},
    {"coupling of flows", 2, {"constant", "of what flows"}},
    {"capacities",
     3,
     {"of what they hold, where regressions show it", "constant", "of what they hold"}},
    {"conduction",
     3,
     {"a power of the temperature, radiation and convection", "constant and convection",
      "constant"}},
    {"inertia of like co-energies", 2, {"each its own", "shared"}},
    {"flow between levels", 2, {"powers of levels", "learned"}},
    {"inputs between samples", 2, {"as they look", "held"}}};

int pm_logger_alternatives(const pm_logger_view *v, pm_logger_choice which, const char **name,
                           const char *const **alternative) {
    int flows = 0, mechanical = 0, temperatures = 0, levels = 0, others = 0, pairs = 0, shared = 0;
    bool springs = false; // an angle may have one, and has none yet
    bool smooth = false, unshown = false;
    for (int u = v->nvariable; u < v->ncolumn; ++u) {
        smooth = smooth || !v->column[u].held;
    }
    for (int c = 0; c < v->nvariable; ++c) {
        const pm_logger_column *column = &v->column[c];
        springs = springs || (column->kind == PM_LOGGER_POSITION && !column->springs &&
                              pm_logger_may_spring(column));
        unshown = unshown || pm_logger_hides_turning(v, c);
        flows += column->kind == PM_LOGGER_FLOW;
        mechanical += column->kind == PM_LOGGER_POSITION;
        temperatures += column->kind == PM_LOGGER_TEMPERATURE;
        levels += column->kind == PM_LOGGER_LEVEL;
        others += column->kind == PM_LOGGER_FLOW && column->mate < 0;
        for (int j = 0; j < c; ++j) {
            pairs += v->column[j].part == column->part && pm_logger_is_coupled(v, j, c, false);
            shared += pm_logger_may_share(v, j, c);
        }
    }
    const bool some[PM_LOGGER_NCHOICE] = {flows > 0,
                                          mechanical > 0,
                                          mechanical > 0,
                                          pairs > 0,
                                          temperatures + levels + others > 0,
                                          temperatures > 0,
                                          shared > 0,
                                          levels > 0,
                                          smooth};
    *name = choices[which].name;
    *alternative = choices[which].alternative;
    const bool fewer =
        which == PM_LOGGER_POTENTIAL ? !springs : which == PM_LOGGER_INERTIA && !unshown;
    return !some[which] ? 1 : choices[which].count - fewer;
}

// --- the scene ---

static pm_status close_file(FILE *file, const char *path) {
    const bool failed = file == NULL || ferror(file) != 0;
    return file != NULL && fclose(file) == 0 && !failed
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

static void write_exposed(FILE *f, const pm_logger_view *v, int part, int input) {
    const char *separator = "";
    for (int c = 0; c < v->nvariable; ++c) {
        bool exposed = v->column[c].part == part;
        if (input < 0) {
            const pm_logger_kind kind = v->column[c].kind;
            const bool reacts = kind == PM_LOGGER_AMOUNT && v->thermometer[part] < 0;
            bool orbits = false;
            for (int k = 0; k < v->ntide; ++k) {
                orbits = orbits ||
                         (v->tide[k].heat < 0 && pm_logger_has_tide(v, &v->tide[k], part, part) &&
                          (v->tide[k].first == c || v->tide[k].second == c));
            }
            exposed = exposed && (pm_logger_loses(v, c) || kind == PM_LOGGER_LEVEL || reacts ||
                                  orbits || v->leaks[c] ||
                                  (kind == PM_LOGGER_POSITION &&
                                   (v->turns[v->column[c].mate] ||
                                    pm_logger_count(v, part, PM_LOGGER_POSITION) > 1)));
        } else {
            bool target = false;
            for (int a = 0; a < v->naction; ++a) {
                target =
                    target || (v->action[a].input == input &&
                               (v->action[a].target == c ||
                                (v->action[a].lever && v->column[c].kind == PM_LOGGER_POSITION)));
            }
            for (int k = 0; k < v->nconverter; ++k) {
                target = target || (v->converter[k].input == input &&
                                    (v->converter[k].one == c || v->converter[k].other == c));
            }
            for (int i = 0; i < v->nvariable; ++i) {
                target = target || (v->gate[i] == input && (i == c || v->falls[i][c]));
            }
            exposed = exposed && target;
        }
        if (exposed) {
            fprintf(f, "%s%s", separator, v->column[c].name);
            separator = ", ";
        }
    }
}

pm_status pm_logger_write_scene(const pm_logger_draft *draft, const char *path) {
    const pm_logger_view *v = &draft->view;
    const pm_dataset *d = v->dataset;
    FILE *f = NULL;
    PM_TRY(pm_files_create(&f, path, PM_PROPOSED));
    double fastest = v->fastest;
    for (int c = 0; c < v->nvariable; ++c) {
        // An inertia that depends on an angle changes as fast as the angle turns.
        if (v->column[c].mate >= 0 && v->turns[c] && v->column[v->column[c].mate].angle) {
            fastest =
                fmax(fastest, v->column[c].deviation * v->column[v->column[c].mate].harmonics);
        }
    }
    const double least = fmax(ceil(d->dt * fastest / COARSE), 1);
    double wanted = fmax(ceil(d->dt * fastest / (v->noisy ? MEDIUM : FINE)), 1);
    // The error of a step is of order 4. Laws may be stiffer in places than regressions show.
    const double finer = ceil(least * sqrt(sqrt(draft->coarse / MOST_COARSE)));
    wanted = draft->most > 0 ? least : fmin(fmax(wanted, finer), STIFFER * wanted);
    uint64_t digest = PM_DIGEST_INIT;
    for (int i = 0; i < d->ntrajectory; ++i) {
        digest = pm_digest_integer(digest, (int64_t)pm_dataset_digest(d, i));
    }
    char name[SCENE_NAME];
    pm_path_folder_name(path, "logger", name, sizeof name);
    int shortest = d->ntime;
    bool surroundings = false, level = false;
    for (int i = 0; i < d->ntrajectory; ++i) {
        int k = 0;
        while (k < d->ntime && !isnan(pm_dataset_time(d, i, k))) {
            ++k;
        }
        shortest = i == 0 && k > 1 ? k : shortest;
    }
    fprintf(f,
            PM_PROPOSED
            " from %d trajector%s of at most %d samples.\n"
            "# Sensors show co-energies: velocities, temperatures, currents. The momenta, "
            "entropies and\n"
            "# fluxes that belong to them are inside (`coenergy: true`).\n"
            "scene: %s\n"
            "system: \"data %016" PRIx64 "\"   # weights of other data are refused\n"
            "time: {dt: %.17g, steps: %d, integrator: rk4, substeps: %d}\n"
            "subsystems:\n",
            d->ntrajectory, d->ntrajectory == 1 ? "y" : "ies", d->ntime, name, digest, d->dt,
            shortest > 1 ? shortest - 1 : 1, (int)fmin(fmax(wanted, 1), MOST_SUBSTEPS));
    for (int i = 0; i < v->npart; ++i) {
        fprintf(f, "  %s:\n    weights: weights/%s.h5\n    state:\n", v->part[i], v->part[i]);
        for (int c = 0; c < v->nvariable; ++c) {
            const pm_logger_column *column = &v->column[c];
            if (column->part != i) {
                continue;
            }
            fprintf(f, "      %s: {unit: \"%s\"", column->name,
                    *column->unit == '\0' ? "1" : column->unit);
            fputs(column->kind == PM_LOGGER_POSITION || column->kind == PM_LOGGER_CHARGE ||
                          column->kind == PM_LOGGER_AMOUNT
                      ? ""
                      : ", coenergy: true",
                  f);
            if (column->saturates) {
                fprintf(f, ", hidden: {guess: %.6g, deviation: %.3g}}   # its sensor saturates\n",
                        column->mean, 2 * column->deviation);
            } else if (column->source != NULL) {
                fprintf(f, ", columns: [\"%s\"]", column->source);
                const pm_logger_column *base = pm_logger_base(v, column);
                if (base != NULL) {
                    fprintf(f, ", relative_to: %s.%s", v->part[base->part], base->name);
                }
                fputs("}\n", f);
            } else {
                fputs(", hidden: {", f);
                if (column->behind >= 0) {
                    fprintf(f, "guess: %.6g, ", column->mean);
                }
                fprintf(f, "deviation: %.3g}}   # nobody measures it\n",
                        fmax(column->deviation, LEAST_START));
            }
            if (column->feeds) {
                fprintf(f,
                        "      z_%s: {unit: m^3, hidden: true}   # gives the energy of fluid "
                        "that falls into another part\n",
                        column->name);
            }
            if (column->rubs) {
                fprintf(f,
                        "      s_%s: {unit: J/K, hidden: true}   # the heat of friction against "
                        "another part\n",
                        column->name);
            }
        }
        surroundings = surroundings || loses(v, i);
        level = level || falls(v, i);
    }
    // The column of a sensor that saturates shows no more than its largest value.
    bool any = false;
    for (int c = 0; c < v->nvariable; ++c) {
        const pm_logger_column *y = &v->column[c];
        if (y->saturates) {
            const char *part = v->part[y->part];
            const double edge = ROUND * y->deviation;
            fprintf(f, "%s  %s: \"(%s.%s + %.6g - sqrt((%s.%s - %.6g)^2 + %.3g))/2\"\n",
                    any ? "" : "observations:\n", y->source, part, y->name, y->largest, part,
                    y->name, y->largest, edge * edge);
            any = true;
        }
    }
    // The column of a cell shows V = dE/dq + what relaxes + R I.
    for (int c = 0; c < v->nvariable; ++c) {
        const pm_logger_column *cell = &v->column[c];
        if (cell->seen == NULL) {
            continue;
        }
        const char *part = v->part[cell->part];
        fputs(any ? "" : "observations:\n", f);
        any = true;
        fprintf(f, "  %s: \"%s.dE.%s", cell->seen, part, cell->name);
        for (int k = 0; k < v->nvariable; ++k) {
            if (v->column[k].relaxes > 0 && v->column[k].behind == c) {
                fprintf(f, " + %s.%s", part, v->column[k].name);
            }
        }
        char prefix[PM_LOGGER_TEXT], resistance[PM_LOGGER_LONG_TEXT];
        snprintf(prefix, sizeof prefix, "%.100s.", part);
        pm_logger_cell_resistance(resistance, sizeof resistance, v, cell, prefix, prefix);
        for (int u = v->nvariable; u < v->ncolumn; ++u) {
            if (v->column[u].id == cell->current) {
                char current[4 * PM_LOGGER_LONG_TEXT];
                pm_logger_cell_current(current, sizeof current, cell, prefix, v->column[u].source);
                fprintf(f, " %c %s*%s", cell->resistance < 0 ? '-' : '+', resistance, current);
            }
        }
        fputs("\"\n", f);
    }
    if (surroundings || v->naction > 0) {
        fputs("boundary_inputs:\n", f);
    }
    if (surroundings) {
        fprintf(f,
                "  surroundings:   # they take up heat at a constant temperature\n"
                "    s: {unit: J/K, dE: [%.6g], dS: [1]}\n",
                v->bath);
    }
    if (pushed(v, -1)) {
        fputs("    x: {unit: J, dE: [1], dS: [0]}   # what is constant outside\n", f);
    }
    if (level) {
        fprintf(
            f,
            "    z: {unit: m^3, dE: [%.4g], dS: [0]}   # m, the height through which fluid falls\n",
            pm_logger_highest(v));
    }
    for (int u = v->nvariable; u < v->ncolumn; ++u) {
        const pm_logger_column *input = &v->column[u];
        const char *groups = groups_of(v, u, -1);
        char hold[PM_LOGGER_TEXT];
        write_hold(v, input, hold);
        const char *unit = *input->unit == '\0' ? "1" : input->unit;
        bool acts = false;
        for (int i = 0; i < v->npart; ++i) {
            acts = acts || acts_on(v, u, i);
        }
        if (acts && *groups == 's') {
            fprintf(f, "  %s_source: {s: {unit: J/K, dE: [\"%s\"], dS: [1], hold: %s}}\n",
                    input->name, input->source, hold);
        } else if (acts) {
            char bath[PM_LOGGER_TEXT];
            const bool through = takes_heat(v, u, -1, bath);
            fprintf(f, "  %s_source:\n    x: {unit: \"J/(%s)\", dE: [\"%s\"]%s, hold: %s}\n",
                    input->name, unit, input->source,
                    through || strlen(groups) > 1 ? ", dS: [0]" : "", hold);
            if (strlen(groups) > 1) {
                fprintf(f, "    s: {unit: J/K, dE: %s, dS: [1]}\n", bath);
            }
            if (gates(v, u, -1)) {
                fprintf(f, "    z: {unit: m^3, dE: [%.4g], dS: [0]}\n", pm_logger_highest(v));
            }
        }
    }
    fputs(surroundings || v->naction > 0 || v->nport > 0 ? "ports:\n" : "", f);
    for (int k = 0; k < v->nport; ++k) {
        const int *parts = v->port[k];
        fprintf(f, "  %s_%s:\n    law: bracket\n    between: [%s, %s]\n    expose: {",
                v->part[parts[0]], v->part[parts[1]], v->part[parts[0]], v->part[parts[1]]);
        for (int end = 0; end < 2; ++end) {
            fprintf(f, "%s: [", v->part[parts[end]]);
            bool listed = false;
            for (int i = 0; i < v->nvariable; ++i) {
                bool acts = false;
                for (int j = 0; j < v->nvariable; ++j) {
                    acts =
                        acts || (v->column[j].part == parts[1 - end] && pm_logger_joins(v, i, j));
                    for (int n = 0; n < v->nvariable; ++n) { // what the friction of two heats
                        acts =
                            acts ||
                            (v->column[j].part == parts[0] && v->column[n].part == parts[1] &&
                             pm_logger_is_coupled(v, j, n, true) && pm_logger_heated(v, j, n) == i);
                    }
                }
                for (int n = 0; n < v->ncarrier; ++n) {
                    const pm_logger_carrier *c = &v->carrier[n];
                    acts = acts || ((c->flow == i || c->from == i || c->to == i) &&
                                    pm_logger_carries(v, c, parts[0], parts[1]));
                }
                for (int n = 0; n < v->ntide; ++n) {
                    const pm_logger_tide *t = &v->tide[n];
                    const bool own = t->spin == i || t->first == i || t->second == i ||
                                     v->column[t->first].mate == i ||
                                     v->column[t->second].mate == i || t->heat == i;
                    acts = acts || (own && pm_logger_has_tide(v, t, parts[0], parts[1]));
                }
                for (int n = 0; n < v->nguide; ++n) { // angles that tell how
                    const pm_logger_guide *g = &v->guide[n];
                    const int one = v->column[g->position].part;
                    const int other = v->column[g->velocity].part;
                    acts = acts || ((g->angle == i || g->other == i) && one != other &&
                                    (one == parts[0] || one == parts[1]) &&
                                    (other == parts[0] || other == parts[1]));
                }
                if (acts && v->column[i].part == parts[end]) {
                    fprintf(f, "%s%s", pm_logger_separate(&listed), v->column[i].name);
                    if (v->column[i].feeds) {
                        fprintf(f, ", z_%s", v->column[i].name);
                    }
                    if (v->column[i].rubs) {
                        fprintf(f, ", s_%s", v->column[i].name);
                    }
                }
            }
            fputs(end == 0 ? "], " : "]}\n", f);
        }
        fprintf(f, "    weights: weights/%s_%s.h5\n", v->part[parts[0]], v->part[parts[1]]);
    }
    for (int i = 0; i < v->npart; ++i) {
        if (loses(v, i)) {
            fprintf(f,
                    "  %s_losses:\n    law: bracket\n    between: [%s, surroundings]\n    expose: "
                    "{%s: [",
                    v->part[i], v->part[i], v->part[i]);
            write_exposed(f, v, i, -1);
            fprintf(f, "], surroundings: [s%s%s]}\n    weights: weights/%s_losses.h5\n",
                    falls(v, i) ? ", z" : "", pushed(v, i) ? ", x" : "", v->part[i]);
        }
        for (int u = v->nvariable; u < v->ncolumn; ++u) {
            if (acts_on(v, u, i)) {
                const char *input = v->column[u].name;
                fprintf(
                    f,
                    "  %s_%s:\n    law: bracket\n    between: [%s, %s_source]\n    expose: {%s: [",
                    v->part[i], input, v->part[i], input, v->part[i]);
                write_exposed(f, v, i, u);
                fprintf(f, "], %s_source: [%s]}\n    weights: weights/%s_%s.h5\n", input,
                        groups_of(v, u, i), v->part[i], input);
            }
        }
    }
    char named[PATH_MAX];
    fprintf(f, "reference: {file: \"%s\", trajectory: 0",
            pm_path_seen_from(path, draft->data_path, named));
    if (v->hides || !v->even || !v->complete) {
        // Find the starts of hidden variables from the first samples.
        const double first = fmax(ceil(shortest * ESTIMATED_PART), FEWEST_SAMPLES);
        fprintf(f, ", estimate: %.6g", d->dt * fmin(first, shortest - 1));
    }
    fputs("}\n", f);
    return close_file(f, path);
}

// --- the training file ---

static void write_part(pm_logger_writer *w, int part) {
    bool some = false;
    if (!pm_logger_begin(w)) {
        return;
    }
    pm_logger_write_coenergy(w, part);
    pm_logger_write_mixture(w, part, false);
    pm_logger_write_energy(w, part);
    pm_logger_write_mixture(w, part, true);
    for (int c = 0; c < w->v->nvariable; ++c) {
        if (pm_logger_is(w->v, c, part, PM_LOGGER_TEMPERATURE)) {
            fprintf(w->model, "%s%s", some ? ", " : "    entropy: {given: [", w->v->column[c].name);
            some = true;
        }
        if (w->v->column[c].part == part && w->v->column[c].rubs) {
            fprintf(w->model, "%ss_%s", some ? ", " : "    entropy: {given: [",
                    w->v->column[c].name);
            some = true;
        }
    }
    fputs(some ? "]}\n" : "", w->model);
    pm_logger_write_reversible(w, part);
    // Conduction between the temperatures, and what heats them.
    some = false;
    for (int i = 0; i < w->v->nvariable; ++i) {
        for (int j = 0; j < w->v->nvariable; ++j) {
            const bool own = pm_logger_is(w->v, j, part, PM_LOGGER_TEMPERATURE);
            if (j > i && w->v->column[i].part == part && w->v->column[j].part == part &&
                pm_logger_is_coupled(w->v, i, j, true) && pm_logger_heated(w->v, i, j) >= 0) {
                fputs(some ? ",\n        " : "    irreversible:\n      given:\n        [",
                      w->model);
                some = true;
                pm_logger_write_rubbing(w, i, j, "", "");
            } else if (own && w->v->warms[i][j] && w->v->column[i].part == part) {
                fputs(some ? ",\n        " : "    irreversible:\n      given:\n        [",
                      w->model);
                some = true;
                pm_logger_write_friction(w, i, "", j, "");
            } else if (own && j > i && pm_logger_is(w->v, i, part, PM_LOGGER_TEMPERATURE)) {
                const char *a = w->v->column[i].name, *b = w->v->column[j].name;
                char both[PM_LOGGER_TEXT], da[PM_LOGGER_TEXT], db[PM_LOGGER_TEXT];
                snprintf(both, sizeof both, "%.40s_%.40s", a, b);
                snprintf(da, sizeof da, "dE.%.40s", a);
                snprintf(db, sizeof db, "dE.%.40s", b);
                fputs(some ? ",\n        " : "    irreversible:\n      given:\n        [",
                      w->model);
                some = true;
                pm_logger_write_conduction(w, both, a, b, da, db,
                                           w->v->column[i].inertia * fabs(w->v->coupling[i][j]),
                                           NULL);
            }
        }
    }
    for (int k = 0; k < w->v->ntide; ++k) {
        if (pm_logger_has_tide(w->v, &w->v->tide[k], part, part) && w->v->tide[k].heat >= 0) {
            fputs(some ? ",\n        " : "    irreversible:\n      given:\n        [", w->model);
            some = true;
            pm_logger_write_tide(w, &w->v->tide[k], "", "", "");
        }
    }
    for (int k = 0; k < w->v->nreaction; ++k) {
        if (w->v->reaction[k].part == part && w->v->thermometer[part] >= 0) {
            fputs(some ? ",\n        " : "    irreversible:\n      given:\n        [", w->model);
            some = true;
            pm_logger_write_reaction(w, k, "", "");
        }
    }
    fputs(some ? "]\n" : "", w->model);
    pm_logger_end(w, w->v->part[part]);
}

// Writes a constant power into the temperature T, for each unit of b.x, by which a bath is warmer
// or colder than the scene says. The conductance is that to the bath.
static void write_shift(pm_logger_writer *w, const char *name, const char *T, double conductance) {
    char power[PM_LOGGER_TEXT];
    snprintf(power, sizeof power, "%s/a.dE.%.40s",
             pm_logger_number(w, "shift", name, 0, conductance), T);
    fprintf(w->model, "[a.%s, b.x, \"%s\"], [b.s, b.x, \"-%s\"]", T, power, power);
}

// Writes what moves a part from outside without loss: constant rates, and fluid that leaves one
// level and falls into another one, unless networks describe it. The fluid loses its energy before
// it arrives; the height through which it falls gives the energy of the other level.
static void write_pushes(pm_logger_writer *w, int part, bool falls) {
    static const char *const first = "    reversible: {given: [";
    const pm_logger_view *v = w->v;
    const double highest = pm_logger_highest(v);
    bool some = false;
    for (int i = 0; i < v->nvariable; ++i) {
        const pm_logger_column *h = &v->column[i];
        if (h->part == part && v->pushes[i]) {
            fprintf(w->model, "%s[a.%s, b.x, \"%s\"]", some ? ", " : first, h->name,
                    pm_logger_number(w, "push", h->name,
                                     h->source == NULL ? 0 : h->inertia * h->constant,
                                     pm_logger_rate(w, h)));
            some = true;
        }
        if (h->part == part && v->leaks[i]) {
            fputs(some ? ", " : first, w->model);
            some = true;
            write_shift(w, h->name, h->name, h->inertia * v->leak[i]);
        }
        if (!falls || !pm_logger_is(v, i, part, PM_LOGGER_LEVEL)) {
            continue;
        }
        for (int j = 0; j < v->nvariable; ++j) {
            char flow[PM_LOGGER_LONG_TEXT], spill[PM_LOGGER_LONG_TEXT];
            if (pm_logger_is(v, j, part, PM_LOGGER_LEVEL) && v->falls[i][j] && v->gate[i] == 0) {
                fprintf(w->model, "%s[a.%s, b.z, \"(%s", some ? ", " : first, v->column[j].name,
                        pm_logger_flow(w, flow, sizeof flow, 'a', h));
                if (h->spills) {
                    fprintf(w->model, " + caught_%s/(1 + caught_%s)*%s", h->name, h->name,
                            pm_logger_spill(w, spill, sizeof spill, h));
                }
                fprintf(w->model, ")/%.4g\"]", highest);
                some = true;
            }
        }
    }
    fputs(some ? "]}\n" : "", w->model);
}

// Writes the port by which a part loses energy to the surroundings.
static void write_losses(pm_logger_writer *w, int part) {
    static const char *const first = "    irreversible:\n      given:\n        [",
                             *const next = ",\n        ";
    const pm_logger_view *v = w->v;
    const int levels = pm_logger_count(v, part, PM_LOGGER_LEVEL);
    const bool networks = w->chosen[PM_LOGGER_LEVELS] == NETWORKS_OF_LEVELS && levels > 0;
    bool some = false;
    char name[PATH_MAX];
    if (!pm_logger_begin(w)) {
        return;
    }
    fputs("    law: bracket\n", w->model);
    write_pushes(w, part, !networks);
    for (int i = 0; i < v->nvariable; ++i) {
        const pm_logger_column *y = &v->column[i];
        if (y->part != part) {
            continue;
        }
        const bool drains = y->kind == PM_LOGGER_LEVEL && !networks && v->gate[i] == 0;
        if (pm_logger_loses(v, i) || v->leaks[i] || drains) {
            fputs(some ? next : first, w->model);
            some = true;
        }
        if (v->leaks[i]) {
            char dx[PM_LOGGER_TEXT], x[PM_LOGGER_TEXT];
            snprintf(x, sizeof x, "a.%.40s", y->name);
            snprintf(dx, sizeof dx, "a.dE.%.40s", y->name);
            pm_logger_write_conduction(w, y->name, x, "b.s", dx, "b.dE.s", y->inertia * v->leak[i],
                                       NULL);
        } else if (pm_logger_loses(v, i)) {
            pm_logger_write_friction(w, i, "a.", -1, "b.");
        } else if (drains) {
            char flow[PM_LOGGER_LONG_TEXT], spill[PM_LOGGER_LONG_TEXT];
            fprintf(w->model, "[a.%s, b.s, \"(%s + %s)/sqrt(a.%s^2 + %.4g)*b.dE.s\"]", y->name,
                    pm_logger_flow(w, flow, sizeof flow, 'a', y),
                    pm_logger_spill(w, spill, sizeof spill, y), y->name,
                    EMPTY * EMPTY * y->largest * y->largest);
        }
        for (int j = i + 1; j < v->nvariable; ++j) {
            const pm_logger_column *other = &v->column[j];
            if (other->part == part && pm_logger_is_coupled(v, i, j, true) &&
                pm_logger_heated(v, i, j) < 0) {
                fputs(some ? next : first, w->model);
                some = true;
                pm_logger_write_rubbing(w, i, j, "a.", "a.");
            }
        }
    }
    for (int k = 0; k < v->ntide; ++k) {
        if (pm_logger_has_tide(v, &v->tide[k], part, part) && v->tide[k].heat < 0) {
            fputs(some ? next : first, w->model);
            some = true;
            pm_logger_write_tide(w, &v->tide[k], "a.", "a.", "b.");
        }
    }
    for (int k = 0; k < v->nreaction; ++k) {
        if (v->reaction[k].part == part && v->thermometer[part] < 0) {
            fputs(some ? next : first, w->model);
            some = true;
            pm_logger_write_reaction(w, k, "a.", "b.");
        }
    }
    fputs(some ? "]\n" : networks ? "    irreversible:\n" : "", w->model);
    if (networks) {
        bool listed = false;
        fputs("      learned: {acts_on: [", w->model);
        for (int c = 0; c < v->nvariable; ++c) {
            if (pm_logger_is(v, c, part, PM_LOGGER_LEVEL)) {
                fprintf(w->model, "%sa.%s", pm_logger_separate(&listed), v->column[c].name);
            }
        }
        fprintf(w->model, "%s], rank: %d, heats: [b.s], strength: {features: [",
                falls(v, part) ? ", b.z" : "", levels);
        listed = false;
        for (int c = 0; c < v->nvariable; ++c) {
            if (pm_logger_is(v, c, part, PM_LOGGER_LEVEL)) {
                fprintf(w->model, "%s\"ln|a.%s|\"", pm_logger_separate(&listed), v->column[c].name);
            }
        }
        fputs("], hidden: [4], skip: linear}}\n", w->model);
    }
    snprintf(name, sizeof name, "%s_losses", v->part[part]);
    pm_logger_end(w, name);
}

// Writes the port between two parts.
static void write_port(pm_logger_writer *w, const int *parts) {
    const pm_logger_view *v = w->v;
    char name[PATH_MAX];
    for (int thermal = 0; thermal < 2; ++thermal) {
        bool some = false;
        if (thermal == 0 && !pm_logger_begin(w)) {
            return;
        }
        fputs(thermal == 0 ? "    law: bracket\n" : "", w->model);
        for (int i = 0; i < v->nvariable; ++i) {
            for (int j = 0; j < v->nvariable; ++j) {
                const pm_logger_column *a = &v->column[i], *b = &v->column[j];
                char both[PM_LOGGER_TEXT], x[PM_LOGGER_TEXT], y[PM_LOGGER_TEXT];
                char dx[PM_LOGGER_TEXT], dy[PM_LOGGER_TEXT];
                const bool rubs = pm_logger_is_coupled(v, i, j, true);
                const bool warms = v->warms[i][j] || v->warms[j][i];
                if (a->part != parts[0] || b->part != parts[1] || !pm_logger_joins(v, i, j) ||
                    (a->kind == PM_LOGGER_TEMPERATURE || rubs || warms || v->diffuses[i][j]) !=
                        (thermal == 1) ||
                    pm_logger_guides(v, i, j) || pm_logger_guides(v, j, i)) {
                    continue;
                }
                fputs(some           ? ", "
                      : thermal == 1 ? "    irreversible: {given: ["
                                     : "    reversible: {given: [",
                      w->model);
                some = true;
                snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
                snprintf(x, sizeof x, "a.%.40s", a->name);
                snprintf(y, sizeof y, "b.%.40s", b->name);
                snprintf(dx, sizeof dx, "a.dE.%.40s", a->name);
                snprintf(dy, sizeof dy, "b.dE.%.40s", b->name);
                const bool falls = v->falls[i][j];
                if (falls || v->falls[j][i]) {
                    const pm_logger_column *from = falls ? a : b, *to = falls ? b : a;
                    const char end = falls ? 'a' : 'b';
                    char flow[PM_LOGGER_LONG_TEXT];
                    fprintf(w->model, "[%c.%s, %c.z_%s, \"%s/%.4g\"]", falls ? 'b' : 'a', to->name,
                            end, from->name, pm_logger_flow(w, flow, sizeof flow, end, from),
                            pm_logger_highest(v));
                } else if (v->moves[i][j] != 0 || v->moves[j][i] != 0) {
                    const double rate = v->moves[i][j] != 0 ? v->moves[i][j] : -v->moves[j][i];
                    if (fabs(rate) == 1) {
                        fprintf(w->model, "[%s, %s, %.1f]", x, y, rate);
                    } else {
                        fprintf(w->model, "[%s, %s, \"%s\"]", x, y,
                                pm_logger_number(w, "rate", both, rate, fabs(rate)));
                    }
                } else if (warms) { // the loss of one heats the other
                    const bool first = v->warms[i][j];
                    pm_logger_write_friction(w, first ? i : j, first ? "a." : "b.", first ? j : i,
                                             first ? "b." : "a.");
                } else if (v->diffuses[i][j]) {
                    fprintf(w->model, "[%s, %s, \"", x, y);
                    pm_logger_write_diffusion(w, a, b);
                    fputs("\"]", w->model);
                } else if (rubs) {
                    pm_logger_write_rubbing(w, i, j, "a.", "b.");
                } else if (thermal == 1) {
                    pm_logger_write_conduction(w, both, x, y, dx, dy,
                                               a->inertia * fabs(v->coupling[i][j]), NULL);
                } else {
                    fprintf(
                        w->model, "[%s, %s, \"%s\"]", x, y,
                        pm_logger_number(
                            w, "coupling", both,
                            (a->inertia * v->coupling[i][j] - b->inertia * v->coupling[j][i]) / 2,
                            pm_logger_between(w, a, b)));
                }
            }
        }
        if (thermal == 0) {
            pm_logger_write_turns(w, parts, &some);
        }
        for (int k = 0; k < v->ntide && thermal == 1; ++k) {
            const pm_logger_tide *tide = &v->tide[k];
            if (pm_logger_has_tide(v, tide, parts[0], parts[1])) {
                const int column[] = {tide->spin, tide->first,
                                      tide->heat >= 0 ? tide->heat : tide->spin};
                const char *end[3];
                for (int c = 0; c < 3; ++c) {
                    end[c] = v->column[column[c]].part == parts[0] ? "a." : "b.";
                }
                fputs(some ? ", " : "    irreversible: {given: [", w->model);
                some = true;
                pm_logger_write_tide(w, tide, end[0], end[1], end[2]);
            }
        }
        fputs(some ? "]}\n" : "", w->model);
    }
    snprintf(name, sizeof name, "%s_%s", v->part[parts[0]], v->part[parts[1]]);
    pm_logger_end(w, name);
}

// Writes the port by which an input acts on a part.
static void write_input(pm_logger_writer *w, int part, int input) {
    const pm_logger_view *v = w->v;
    const char *u = v->column[input].name;
    char name[PATH_MAX];
    if (!pm_logger_begin(w)) {
        return;
    }
    fputs("    law: bracket\n", w->model);
    // What acts without loss first, then what acts through a resistance.
    for (int lossy = 0; lossy < 2; ++lossy) {
        const char *const first =
            lossy ? "    irreversible: {given: [" : "    reversible: {given: [";
        bool some = false;
        for (int a = 0; a < v->naction; ++a) {
            const pm_logger_action *action = &v->action[a];
            const pm_logger_column *y = &v->column[action->target];
            char both[PM_LOGGER_TEXT], x[PM_LOGGER_TEXT], dx[PM_LOGGER_TEXT];
            const bool loses_some = action->effect == PM_LOGGER_BATH ||
                                    action->effect == PM_LOGGER_THROUGH ||
                                    action->effect == PM_LOGGER_COOLS;
            const bool shifts = action->effect == PM_LOGGER_COOLS && action->enters == 0;
            char flow[4 * PM_LOGGER_LONG_TEXT], lost[4 * PM_LOGGER_LONG_TEXT] = "";
            if (action->input != input || y->part != part) {
                continue;
            }
            snprintf(both, sizeof both, "%.40s_%.40s", u, y->name);
            snprintf(x, sizeof x, "a.%.40s", y->name);
            snprintf(dx, sizeof dx, "a.dE.%.40s", y->name);
            if (action->effect == PM_LOGGER_WARMS) {
                pm_logger_write_heat(w, flow, lost, sizeof lost, both, action);
            }
            if (loses_some != lossy && !(shifts && !lossy) && !(lossy && *lost != '\0')) {
                continue;
            }
            fputs(some ? ", " : first, w->model);
            some = true;
            if (shifts && !lossy) {
                write_shift(w, both, y->name, action->gain);
                continue;
            }
            switch (action->effect) {
            case PM_LOGGER_FILLS:
                fprintf(w->model, "[%s, b.x, %.1f]", x, action->gain);
                break;
            case PM_LOGGER_DRIVES:
                fprintf(w->model, "[%s, b.x, %.1f]", x, action->gain < 0 ? -1.0 : 1.0);
                break;
            case PM_LOGGER_GAIN:
                fprintf(w->model, "[%s, b.x, \"", x);
                pm_logger_write_gain(w, both, action);
                fputs("\"]", w->model);
                break;
            case PM_LOGGER_HEATS:
                fprintf(w->model, "[%s, b.x, \"1/%s\"], [b.s, b.x, \"-1/%s\"]", x, dx, dx);
                break;
            case PM_LOGGER_WARMS:
                if (lossy) {
                    fprintf(w->model, "[b.x, %s, \"%s\"]", x, lost);
                } else {
                    fprintf(w->model, "[%s, b.x, \"%s\"], [b.s, b.x, \"-%s\"]", x, flow, flow);
                }
                break;
            case PM_LOGGER_BATH:
            case PM_LOGGER_COOLS:
                pm_logger_write_conduction(w, both, x, "b.s", dx, "b.dE.s", action->gain,
                                           action->effect == PM_LOGGER_COOLS ? &v->column[input]
                                                                             : NULL);
                break;
            case PM_LOGGER_THROUGH: {
                char drop[PM_LOGGER_TEXT];
                snprintf(drop, sizeof drop, "%.60s - b.dE.x", x);
                fprintf(w->model, "[%s, b.x, \"", x);
                pm_logger_write_resistance(w, both, drop, y, &v->column[input], action->gain, NULL);
                fputs("\"]", w->model);
                break;
            }
            }
        }
        for (int i = 0; i < v->nvariable; ++i) {
            bool falls_on = false;
            for (int j = 0; j < v->nvariable; ++j) {
                falls_on = falls_on || v->falls[i][j];
            }
            if (v->gate[i] == input && v->column[i].part == part && (lossy == 1 || falls_on)) {
                fputs(some ? ", " : first, w->model);
                pm_logger_write_gate(w, i, input, lossy == 1);
                some = true;
            }
        }
        for (int k = 0; k < v->nconverter; ++k) {
            const pm_logger_converter *turn = &v->converter[k];
            const pm_logger_column *one = &v->column[turn->one], *other = &v->column[turn->other];
            if (turn->input == input && one->part == part && turn->loses == (lossy == 1)) {
                char both[PM_LOGGER_TEXT], drop[PM_LOGGER_TEXT];
                snprintf(both, sizeof both, "%.40s_%.40s_%.40s", u, one->name, other->name);
                if (lossy) {
                    const pm_logger_column *opening = &v->column[input];
                    const double mean = fmax(fabs(opening->mean), opening->deviation);
                    const double start = one->inertia *
                                         fmax(fabs(v->coupling[turn->one][turn->other]),
                                              SMALL * SMALL * v->fastest) /
                                         mean;
                    fputs(some ? ", " : first, w->model);
                    some = true;
                    if (one->kind == PM_LOGGER_TEMPERATURE) {
                        char end[4][PM_LOGGER_TEXT];
                        for (int n = 0; n < 4; ++n) {
                            snprintf(end[n], sizeof end[n], n < 2 ? "a.%.40s" : "a.dE.%.40s",
                                     n % 2 == 0 ? one->name : other->name);
                        }
                        pm_logger_write_conduction(w, both, end[0], end[1], end[2], end[3], start,
                                                   opening);
                        continue;
                    }
                    snprintf(drop, sizeof drop, "a.%.40s - a.%.40s", one->name, other->name);
                    fprintf(w->model, "[a.%s, a.%s, \"", one->name, other->name);
                    pm_logger_write_resistance(w, both, drop, one, other, start, opening);
                    fputs("\"]", w->model);
                    continue;
                }
                fprintf(w->model, "%s[a.%s, a.%s, \"%s*b.dE.x\"]", some ? ", " : first, one->name,
                        other->name,
                        pm_logger_number(w, "turns", both, 0,
                                         pm_logger_between(w, one, other) /
                                             fmax(fabs(v->column[input].least),
                                                  fabs(v->column[input].largest))));
                some = true;
            }
        }
        fputs(some ? "]}\n" : "", w->model);
    }
    snprintf(name, sizeof name, "%s_%s", v->part[part], u);
    pm_logger_end(w, name);
}

pm_status pm_logger_write_training(const pm_logger_draft *draft, const int *chosen,
                                   const char *comment, const char *path) {
    const pm_logger_view *v = &draft->view;
    pm_logger_writer w = {.v = v, .chosen = chosen, .found = draft->found, .lean = draft->lean};
    PM_TRY(pm_files_create(&w.f, path, PM_PROPOSED));
    fprintf(w.f, PM_PROPOSED " from the columns of a logger.\n%s", comment);
    for (int k = 0; k < PM_LOGGER_NCHOICE; ++k) {
        const char *name;
        const char *const *alternative;
        const int count = pm_logger_alternatives(v, (pm_logger_choice)k, &name, &alternative);
        if (count > 1) {
            fprintf(w.f, "# %s: %s; also possible:", name, alternative[chosen[k]]);
        }
        for (int i = 0, n = 0; i < count && count > 1; ++i) {
            if (i != chosen[k]) {
                fprintf(w.f, "%s %s", n++ > 0 ? ";" : "", alternative[i]);
            }
        }
        fputs(count > 1 ? "\n" : "", w.f);
    }
    char named[2][PATH_MAX];
    fprintf(w.f, "scene: \"%s\"\ndata: {file: \"%s\"",
            pm_path_seen_from(path, draft->scene_path, named[0]),
            pm_path_seen_from(path, draft->data_path, named[1]));
    if (draft->divided > 0) {
        char teaches[PM_LOGGER_TEXT] = "", judges[PM_LOGGER_TEXT] = "";
        size_t n = 0, m = 0;
        for (int k = 0; k < PIECES * draft->divided; ++k) {
            const bool own = k % PIECES % 2 == 1;
            char *text = own ? judges + m : teaches + n;
            const int length = snprintf(text, PM_LOGGER_TEXT - (own ? m : n), "%s%d:%d",
                                        (own ? m : n) > 0 ? "," : "", k, k + 1);
            *(own ? &m : &n) += (size_t)length;
        }
        fprintf(w.f, ", pieces: %d, trajectories: \"%s\", validation: \"%s\"", PIECES, teaches,
                judges);
    } else if (draft->most > 0) {
        fprintf(w.f, ", trajectories: \"0:%d\"", draft->most);
    }
    fprintf(w.f, "}\nseed: %d\n", draft->seed);
    if (draft->most > 0 || pm_logger_is_measured(v)) {
        fputs("noise: estimated\n", w.f);
    }
    fputs("\nmodels:\n", w.f);
    for (int i = 0; i < v->npart; ++i) {
        write_part(&w, i);
        if (loses(v, i)) {
            write_losses(&w, i);
        }
        for (int u = v->nvariable; u < v->ncolumn; ++u) {
            if (acts_on(v, u, i)) {
                write_input(&w, i, u);
            }
        }
    }
    for (int k = 0; k < v->nport; ++k) {
        write_port(&w, v->port[k]);
    }
    bool some = false;
    fputs("\nsubsystems: {", w.f);
    for (int i = 0; i < v->npart; ++i) {
        fprintf(w.f, "%s%s: %s", pm_logger_separate(&some), v->part[i], v->part[i]);
    }
    fputs("}\nports: {", w.f);
    some = false;
    for (int i = 0; i < v->npart; ++i) {
        if (loses(v, i)) {
            fprintf(w.f, "%s%s_losses: %s_losses", pm_logger_separate(&some), v->part[i],
                    v->part[i]);
        }
        for (int u = v->nvariable; u < v->ncolumn; ++u) {
            if (acts_on(v, u, i)) {
                const char *input = v->column[u].name;
                fprintf(w.f, "%s%s_%s: %s_%s", pm_logger_separate(&some), v->part[i], input,
                        v->part[i], input);
            }
        }
    }
    for (int k = 0; k < v->nport; ++k) {
        const char *a = v->part[v->port[k][0]], *b = v->part[v->port[k][1]];
        fprintf(w.f, "%s%s_%s: %s_%s", pm_logger_separate(&some), a, b, a, b);
    }
    fputs("}\n", w.f);
    if (!(draft->most > 0 || pm_logger_is_measured(v))) {
        fprintf(w.f,
                "\nstart: {tries: 1}\nloss: {residual: step}\nstages:\n"
                "  - {optimiser: gauss_newton, iterations: %d, batch: %d}\n",
                ITERATIONS, BATCH);
    } else {
        // All but the networks begins where regressions or a trial put it.
        fprintf(w.f, "\nstart: {tries: %d%s}\n", TRIES, draft->ended ? ", whole: true" : "");
    }
    return close_file(w.f, path);
}

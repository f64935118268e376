// Writes the model of a subsystem in a proposed training file: comments on its variables, energy,
// entropy and what is dissipated.
#include <math.h>

#include "model/feature.h"
#include "propose/propose_draft.h"

#define STRENGTH_WIDTH 6   // hidden units of the strengths of dissipative processes
#define HEAT_WIDTH 6       // and of the dependence of heat on other variables
#define SOFT_WIDTH 8       // and of M in the form soft
#define NEAR_ZERO 0.02     // a vector that comes so near zero, relative to its deviation
#define AWAY_FROM_ZERO 0.5 // a vector that stays so far from zero
#define NEAR_ROOM 2.0      // ratio to 300 K up to which a temperature need not be given

static bool is_state(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY;
}

// Adds a feature of a group, in quotes.
static void add_quoted(pm_draft_list *l, const char *before, const char *name, const char *after) {
    fprintf(l->file, "%s\"%s%s%s\"", l->count++ > 0 ? ", " : "", before, name, after);
}

// --- comments ---

// Returns the mean temperature in K of the components of an entropy; 0 if it is not known.
static double temperature_of(const pm_draft *d, const pm_part_view *v, int g) {
    const int size = v->group[g].group->size;
    double sum = 0;
    for (int c = 0; c < size; ++c) {
        sum += d->temperature[v->group[g].first + c] / size;
    }
    return sum;
}

static void explain_part(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    for (int g = 0; g < v->count; ++g) {
        const pm_group *group = v->group[g].group;
        fprintf(f, "    # %s, %s: deviation %.3g, rate %.3g per s", group->name,
                *group->unit == '\0' ? "a number" : group->unit, v->group[g].deviation,
                v->group[g].rate);
        switch (v->kind[g]) {
        case PM_VIEW_ENTROPY:
            fprintf(f, "; an entropy by its unit");
            if (temperature_of(d, v, g) > 0) {
                fprintf(f, "; about %.3g K by conservation of energy", temperature_of(d, v, g));
            }
            break;
        case PM_VIEW_HEAT:
            fprintf(f, "; takes up heat by its unit, since there is no entropy");
            break;
        case PM_VIEW_POSITION:
            fprintf(f, "; conjugate to %s: the product of the units is J s",
                    pm_draft_name(v, v->mate[g]));
            fprintf(f, "%s",
                    v->linear[g]  ? "; its rate is linear in momenta"
                    : v->apart[g] ? "; its rate depends on momenta alone"
                                  : "");
            break;
        case PM_VIEW_SPIN:
            fprintf(f, "; an angular momentum of three components: L = %sm x",
                    v->sign[g] < 0 ? "-" : "");
            break;
        case PM_VIEW_DIRECTION:
            fprintf(f, "; a %s, which turns with %s",
                    v->quaternion[g].turns != 0 ? "quaternion" : "direction",
                    pm_draft_name(v, v->mate[g]));
            break;
        default:
            fprintf(f, "%s",
                    v->unit[g].known ? "" : "; the unit is NOT KNOWN, so that it says nothing");
            break;
        }
        fprintf(f, "%s", v->gyroscopic[g] ? "; its components move each other" : "");
        fprintf(f, "%s",
                v->gyrates[g] ? "; it and a variable without a role drive each other" : "");
        fprintf(f, "%s%s\n",
                v->geometric[g] && v->kind[g] == PM_VIEW_OTHER
                    ? "; other variables move it, friction does not act on it"
                    : "",
                v->group[g].constant
                    ? "; CONSTANT in these data, so that nothing can be learned about it"
                    : "");
    }
}

// --- energies ---

// Adds the entropies, or only those that change and can thus take up heat.
static void add_entropies(pm_draft_list *l, const pm_part_view *v, bool changing) {
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_ENTROPY && !(changing && v->group[g].constant)) {
            pm_draft_add(l, "", pm_draft_name(v, g));
        }
    }
}

// Adds a group as a feature: the length of a vector if nothing depends on directions, the logarithm
// of a volume as in the entropy of gases, else the group itself.
static void add_feature(const pm_draft *d, pm_draft_list *l, const pm_part_view *v,
                        const char *before, int g) {
    const pm_unit volume = pm_unit_parse("m^3");
    const pm_look_group *group = &v->group[g];
    const bool length = d->rotates && group->group->size > 1 && v->mate[g] >= 0;
    if (length || (group->positive && pm_unit_equal(&v->unit[g], &volume))) {
        char name[2 * PM_MAX_NAME];
        snprintf(name, sizeof name, "%s%s", before, pm_draft_name(v, g));
        const bool zero = group->shortest < NEAR_ZERO * group->deviation;
        add_quoted(l, length && (zero || v->by_length[g]) ? "|" : "ln|", name, "|");
    } else {
        pm_draft_add(l, before, pm_draft_name(v, g));
    }
}

// Returns true if the energy may depend on the length of a vector and on its direction, too, as
// that of a spring in a field does. Near zero the length has no derivative.
static bool has_length_too(const pm_draft *d, const pm_part_view *v, int g) {
    const pm_unit metre = pm_unit_parse("m");
    const pm_look_group *group = &v->group[g];
    const int size = group->group->size;
    return !d->rotates && v->kind[g] == PM_VIEW_POSITION && (size == 2 || size == 3) &&
           pm_unit_equal(&v->unit[g], &metre) &&
           group->shortest > AWAY_FROM_ZERO * group->deviation;
}

// Adds the groups on which a term of the energy depends. Returns the number of components.
static int add_energy_feature(const pm_draft *d, pm_draft_list *l, const pm_part_view *v, int g) {
    const bool both = has_length_too(d, v, g);
    if (both) {
        add_quoted(l, "|", pm_draft_name(v, g), "|");
    }
    add_feature(d, l, v, "", g);
    return d->rotates && v->mate[g] >= 0 ? 1 : v->group[g].group->size + both;
}

int pm_draft_count_odd(const pm_part_view *v, const pm_layout *shown) {
    int count = 0;
    for (int g = 0; g < v->count; ++g) {
        const bool seen = shown == NULL || pm_layout_find(shown, pm_draft_name(v, g)) != NULL;
        count += seen && v->odd[g] && !v->group[g].constant ? v->group[g].group->size : 0;
    }
    return count;
}

// Adds a feature of a strength, which is even in time: of a velocity without any other only the
// size counts. The friction of a turbulent flow grows with it.
static void add_strength_feature(const pm_draft *d, pm_draft_list *l, const pm_part_view *v,
                                 const char *before, int g, bool single) {
    if (single && v->unit[g].known && v->odd[g]) {
        char name[2 * PM_MAX_NAME];
        snprintf(name, sizeof name, "%s%s", before, pm_draft_name(v, g));
        add_quoted(l, "|", name, "|");
    } else {
        add_feature(d, l, v, before, g);
    }
}

void pm_draft_add_features(const pm_draft *d, pm_draft_list *l, const pm_part_view *v,
                           const char *before, const pm_layout *shown, bool single) {
    for (int g = 0; g < v->count; ++g) {
        const bool seen = shown == NULL || pm_layout_find(shown, pm_draft_name(v, g)) != NULL;
        if (seen && !v->group[g].constant) {
            add_strength_feature(d, l, v, before, g, single);
        }
    }
}

// In the form soft M acts on dS alone, so that friction needs a factor of M that grows with the
// velocity.
pm_draft_list pm_draft_open_strength(const pm_draft *d) {
    return pm_draft_open(d->file,
                         d->p->form == PM_SOFT ? ", features: " : ", strength: {features: ");
}

void pm_draft_close_strength(const pm_draft *d) {
    if (d->p->form == PM_SOFT) {
        fprintf(d->file, "], hidden: [%d], skip: linear", SOFT_WIDTH);
    } else {
        fprintf(d->file, "], hidden: [%d]}", STRENGTH_WIDTH);
    }
}

// Returns the hidden layers for a number of inputs. Networks that are too large train slowly.
static const char *hidden_of(int inputs) {
    return inputs == 1 ? "[8, 8]" : inputs <= 3 ? "[12, 12]" : "[16, 16]";
}

// Returns true if the subsystem has variables on which the energy of rotation may depend: some
// without a role, such as the angular momentum of a rotor in a body, or the axis of a body seen
// from outside.
static bool moves_spin(const pm_part_view *v) {
    for (int g = 0; g < v->count; ++g) {
        const bool axis = v->kind[g] == PM_VIEW_DIRECTION && v->sign[g] < 0;
        if ((v->kind[g] == PM_VIEW_OTHER || axis) && !v->group[g].constant) {
            return true;
        }
    }
    return false;
}

// Writes the terms of the energy that depend on one group alone, and marks these groups in done
// [count].
static void write_apart(const pm_draft *d, const pm_part_view *v, bool *done) {
    const bool alone = !moves_spin(v);
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_SPIN && alone) { // rotation alone does not warm a body
            done[g] = true;
            fprintf(d->file, "      - {features: [%s], hidden: [8], skip: quartic}\n",
                    pm_draft_name(v, g));
        }
        if (v->kind[g] != PM_VIEW_POSITION || !v->apart[g]) {
            continue;
        }
        const int p = v->mate[g];
        done[p] = true;
        if (v->linear[g]) {
            fprintf(d->file, "      - {features: [\"|%s|^2\"], skip: linear}", pm_draft_name(v, p));
            fprintf(d->file, "                  # kinetic: velocities are linear in momenta\n");
        } else {
            fprintf(d->file, "      - {features: [%s], hidden: %s, skip: quartic}\n",
                    pm_draft_name(v, p), hidden_of(v->group[p].group->size));
        }
    }
}

static int count_rest(const pm_part_view *v, const bool *done) {
    int count = 0;
    for (int g = 0; g < v->count; ++g) {
        count += is_state(v, g) && !done[g];
    }
    return count;
}

// Writes the temperature with which training starts where it is far from that of a room.
static void write_temperature(const pm_draft *d, const pm_part_view *v, int entropy) {
    const double kelvin = temperature_of(d, v, entropy), room = PM_DEFAULT_TEMPERATURE;
    if (kelvin > 0 && fmax(kelvin, room) > NEAR_ROOM * fmin(kelvin, room)) {
        fprintf(d->file, ", temperature: %.3g", kelvin * v->unit[entropy].factor);
    }
}

// Writes the thermal energy of one entropy, and its dependence on the rest of the state. The energy
// of motion and of currents, which is even in momenta and fluxes, does not depend on the
// temperature. If it could, a large heat content would take the place of a small kinetic energy.
static void write_heat(const pm_draft *d, const pm_part_view *v, int entropy, const bool *done) {
    pm_draft_list l = pm_draft_open(d->file, "      - {features: ");
    for (int g = 0; g < v->count; ++g) {
        const bool moves = v->odd[g] && v->unit[g].known;
        if (is_state(v, g) && !done[g] && !moves) {
            (void)add_energy_feature(d, &l, v, g);
        }
    }
    const bool coupled = l.count > 0;
    pm_draft_add(&l, "", pm_draft_name(v, entropy));
    fprintf(d->file, "]");
    if (coupled) {
        fprintf(d->file, ", hidden: [%d], skip: quartic", HEAT_WIDTH);
    }
    write_temperature(d, v, entropy);
    fprintf(d->file, coupled ? "}   # heat, and its dependence on the rest: temperatures are "
                               "positive\n"
                             : "}   # heat: temperatures are positive by construction\n");
}

static void write_energy(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    bool done[PM_MAX_GROUPS] = {false};
    fprintf(f, "    energy:\n");
    write_apart(d, v, done);
    const int rest = count_rest(v, done);
    int inputs = 0;
    if (rest > 0) {
        pm_draft_list l = pm_draft_open(f, "      - {features: ");
        for (int g = 0; g < v->count; ++g) {
            if (is_state(v, g) && !done[g]) {
                inputs += add_energy_feature(d, &l, v, g);
            }
        }
        fprintf(f, "], hidden: %s, skip: quartic}\n", hidden_of(inputs));
    }
    for (int k = 0; k < v->count; ++k) {
        if (v->kind[k] == PM_VIEW_ENTROPY) {
            write_heat(d, v, k, done);
        }
    }
}

static bool has_heat(const pm_part_view *v) {
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_HEAT) {
            return true;
        }
    }
    return false;
}

// Writes S as the sum of the entropies, with coefficients where they are not in J/K.
static void write_given_entropy(FILE *f, const pm_part_view *v) {
    bool scaled = false;
    for (int g = 0; g < v->count; ++g) {
        scaled = scaled || (v->kind[g] == PM_VIEW_ENTROPY &&
                            (v->unit[g].factor < 1 || v->unit[g].factor > 1));
    }
    if (!scaled) {
        pm_draft_list l = pm_draft_open(f, "    entropy: {given: ");
        add_entropies(&l, v, false);
        fprintf(f, "]}\n");
        return;
    }
    fprintf(f, "    entropy: {given: {");
    for (int g = 0, n = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_ENTROPY) {
            fprintf(f, "%s%s: ", n++ > 0 ? ", " : "", pm_draft_name(v, g));
            pm_draft_number(f, v->unit[g].factor);
        }
    }
    fprintf(f, "}}\n");
}

static void write_entropy(const pm_draft *d, const pm_part_view *v) {
    if (v->nentropy > 0) {
        write_given_entropy(d->file, v);
    } else if (has_heat(v)) {
        pm_draft_list l = pm_draft_open(d->file, "    entropy:\n      - {features: ");
        for (int g = 0; g < v->count; ++g) {
            pm_draft_add(&l, "", pm_draft_name(v, g));
        }
        fprintf(d->file, "], hidden: [12], skip: quadratic}\n");
    } else {
        fprintf(d->file, "    # No variable takes up heat, so that this subsystem conserves its "
                         "energy. If it should "
                         "not, the scene lacks an entropy.\n");
    }
}

// --- dissipation ---

bool pm_draft_may_lose(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY && !v->geometric[g] && !v->group[g].constant;
}

static void write_irreversible(const pm_draft *d, const pm_part_view *v) {
    pm_look_group lossy[PM_MAX_GROUPS] = {0};
    int n = 0, heats = 0;
    for (int g = 0; g < v->count; ++g) {
        const bool heat = v->kind[g] == PM_VIEW_ENTROPY && !v->group[g].constant;
        if (pm_draft_may_lose(v, g)) {
            lossy[n++] = v->group[g];
        }
        heats += heat ? v->group[g].group->size : 0;
    }
    const int rank = pm_look_rank(&d->look, n, lossy) + (heats > 1 ? heats - 1 : 0);
    if ((heats == 0 && !has_heat(v)) || rank == 0) {
        return;
    }
    pm_draft_list l = pm_draft_open(d->file, "    irreversible: {learned: {acts_on: ");
    for (int g = 0; g < v->count; ++g) {
        if (pm_draft_may_lose(v, g)) {
            pm_draft_add(&l, "", pm_draft_name(v, g));
        }
    }
    add_entropies(&l, v, true);
    fprintf(d->file, "], rank: %d", rank);
    if (d->p->form == PM_SOFT || heats > 0) {
        l = pm_draft_open_strength(d);
        pm_draft_add_features(d, &l, v, "", NULL,
                              d->p->form == PM_HARD && pm_draft_count_odd(v, NULL) == 1);
        pm_draft_close_strength(d);
    }
    fprintf(d->file, "}}   # dissipative processes, whose strengths may vary with the state\n");
}

void pm_draft_part(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    fprintf(f, "  %s:\n", d->p->scene->subsystem[v->subsystem].name);
    explain_part(d, v);
    if (d->p->form == PM_FREE) {
        pm_draft_list l = pm_draft_open(f, "    form: free\n    rate: {features: ");
        for (int g = 0; g < v->count; ++g) {
            pm_draft_add(&l, "", pm_draft_name(v, g));
        }
        fprintf(f, "], hidden: [%d], skip: linear}\n", 2 * d->width);
        return;
    }
    fprintf(f, "    form: %s\n", d->p->form == PM_HARD ? "hard" : "soft");
    write_energy(d, v);
    write_entropy(d, v);
    pm_draft_reversible(d, v);
    write_irreversible(d, v);
}

// Writes the models in a proposed training file: of a subsystem comments on its variables, its
// energy, entropy and both operators; of a port its operators, or a network in the form free.
#include <math.h>
#include <string.h>

#include "model/feature.h"
#include "propose/draft.h"

// Hidden units. Networks that are too large train slowly; these were enough for all systems of the
// zoo (tests/bench/zoo).
#define ENERGY_OF_ONE "[8]" // the energy of one input, of two or three, and of more
#define ENERGY_OF_FEW "[16]"
#define ENERGY_OF_MANY "[32]"
#define ENERGY_OF_LARGE "[24, 24]" // any energy, where larger networks are tried
#define STRENGTH_WIDTH 6           // of the strengths of dissipative processes
#define FORCES_WIDTH 8             // likewise, as functions of what drives them
#define HEAT_WIDTH 6               // of the dependence of heat on other variables
#define SOFT_WIDTH 8               // of M in the form soft
#define SPIN_WIDTH 8               // of the energy of rotation
#define ENTROPY_WIDTH 12           // of a learned entropy
#define CARRIED_WIDTH 4            // of the entropy that a current carries
#define HEAT_PORT_WIDTH 4          // of a conductance that varies with the entropies
// Of the rates in the form free: twice what an energy of many variables has, and less where
// there are many subsystems.
#define FREE_WIDTH 32
#define FREE_WIDTH_OF_MANY 24
#define MANY_SUBSYSTEMS 3

#define GAS_CONSTANT 8.314       // J/(mol K)
#define CAPACITY_OF_SPECIES 50.0 // J/(mol K), with which training starts
#define CAPACITY_OF_VESSEL 800.0 // likewise, relative to the deviations of the amounts
#define MOST_BODIES 5 // up to which any two of one operator may exchange heat by a law of their own
#define NEAR_ZERO 0.02     // a vector that comes so near zero, relative to its deviation
#define AWAY_FROM_ZERO 0.5 // a vector that stays so far from zero
#define WHOLE 1e-14        // relative: a number that is so close to a whole one is this one
#define LARGE 1e9          // a whole number up to which all digits are written

static const char *const ends[2] = {"a.", "b."};

static const char *name_of(const pm_part_view *v, int g) {
    return v->group[g].group->name;
}

static int size_of(const pm_part_view *v, int g) {
    return v->group[g].group->size;
}

static bool is_entropy(const pm_part_view *v, int g) {
    return v->kind[g] == PM_VIEW_ENTROPY;
}

// Returns true if the group keeps its sign when time runs backwards.
static bool is_even(const pm_part_view *v, int g) {
    return v->unit[g].known && !v->odd[g];
}

// Returns true if friction, relaxation or leakage may act on the group.
static bool may_lose(const pm_part_view *v, int g) {
    return !is_entropy(v, g) && !v->geometric[g] && !v->group[g].constant;
}

// --- names, lists and numbers ---

// A list of names in brackets. The caller writes the closing bracket.
typedef struct list {
    FILE *file;
    int count;
} list;

static list open_list(FILE *file, const char *before) {
    fprintf(file, "%s[", before);
    return (list){.file = file};
}

static void add_name(list *l, const char *before, const char *name) {
    fprintf(l->file, "%s%s%s", l->count++ > 0 ? ", " : "", before, name);
}

// Adds a function of a group, in quotes.
static void add_quoted(list *l, const char *function, const char *before, const char *name) {
    fprintf(l->file, "%s\"%s%s%s|\"", l->count++ > 0 ? ", " : "", function, before, name);
}

// Writes a coefficient, with a point also where it is a whole number.
static void write_number(FILE *file, double number) {
    const double nearest = round(number);
    const bool whole = fabs(number - nearest) <= WHOLE * fabs(number); // but for rounding
    fprintf(file, whole && fabs(nearest) <= LARGE ? "%.1f" : "%.17g", whole ? nearest : number);
}

// Returns the factor by which a coefficient of a lossless pair in SI units becomes that of the
// units of both variables.
static double coefficient_unit(const pm_unit *a, const pm_unit *b) {
    return 1 / (a->factor * b->factor);
}

// --- features ---

static pm_answer ask(const pm_draft *d, pm_question question, const pm_part_view *v) {
    return pm_draft_answer(d, question, v->subsystem);
}

static void add_sines(list *l, const char *before, const char *name) {
    fprintf(l->file, "%s\"sin(%s%s)\", \"cos(%s%s)\"", l->count++ > 0 ? ", " : "", before, name,
            before, name);
}

// Adds a group as a feature: the length of a vector if nothing depends on directions, the logarithm
// of a volume as in the entropy of gases, else the group itself.
static void add_feature(const pm_draft *d, list *l, const pm_part_view *v, const char *before,
                        int g) {
    const pm_unit volume = pm_unit_parse("m^3");
    const pm_look_group *group = &v->group[g];
    const bool length = d->rotates && size_of(v, g) > 1 && v->mate[g] >= 0 &&
                        ask(d, PM_ASK_ENERGY, v) == PM_AS_FOUND;
    if (v->angle[g] && ask(d, PM_ASK_ANGLE, v) == PM_BY_SINES) {
        add_sines(l, before, name_of(v, g));
    } else if (length || (group->positive && pm_unit_equal(&v->unit[g], &volume))) {
        const bool zero = group->shortest < NEAR_ZERO * group->deviation;
        add_quoted(l, length && (zero || v->by_length[g]) ? "|" : "ln|", before, name_of(v, g));
    } else {
        add_name(l, before, name_of(v, g));
    }
}

// Adds the groups on which a term of the energy depends. Returns the number of components. The
// energy may depend on the length of a vector and on its direction, too, as that of a spring in a
// field does. Near zero the length has no derivative.
static int add_energy_feature(const pm_draft *d, list *l, const pm_part_view *v, int g) {
    const pm_unit metre = pm_unit_parse("m");
    const pm_look_group *group = &v->group[g];
    const pm_answer answer = ask(d, PM_ASK_ENERGY, v);
    const bool vector = size_of(v, g) == 2 || size_of(v, g) == 3;
    const bool both = answer == PM_BY_BOTH
                          ? vector && is_even(v, g)
                          : answer == PM_AS_FOUND && !d->rotates && vector &&
                                v->kind[g] == PM_VIEW_POSITION &&
                                pm_unit_equal(&v->unit[g], &metre) &&
                                group->shortest > AWAY_FROM_ZERO * group->deviation;
    if (both) {
        add_quoted(l, "|", "", name_of(v, g));
    }
    add_feature(d, l, v, "", g);
    return d->rotates && v->mate[g] >= 0 && answer == PM_AS_FOUND ? 1 : size_of(v, g) + both;
}

// Returns the number of components that change their sign when time runs backwards, among the
// groups of a layout; NULL: all.
static int count_odd(const pm_part_view *v, const pm_layout *shown) {
    int count = 0;
    for (int g = 0; g < v->count; ++g) {
        const bool seen = shown == NULL || pm_layout_find(shown, name_of(v, g)) != NULL;
        count += seen && v->odd[g] && !v->group[g].constant ? size_of(v, g) : 0;
    }
    return count;
}

// Adds the groups of a subsystem but for entropies, of a layout if `shown` is not NULL, to the
// features of an operator; with PM_BY_POSITIONS those that are even in time, with PM_BY_SINES the
// angles.
static void add_states(list *l, const pm_part_view *v, const char *before, const pm_layout *shown,
                       pm_answer answer) {
    for (int g = 0; g < v->count; ++g) {
        const bool seen = shown == NULL || pm_layout_find(shown, name_of(v, g)) != NULL;
        if (!seen || v->group[g].constant || is_entropy(v, g) ||
            (answer == PM_BY_POSITIONS && !is_even(v, g)) ||
            (answer == PM_BY_SINES && !v->angle[g])) {
            continue;
        }
        if (v->angle[g]) {
            add_sines(l, before, name_of(v, g));
        } else {
            add_name(l, before, name_of(v, g));
        }
    }
}

// Returns the polynomial of an operator: of angles alone also products of sines and cosines count.
static const char *skip_of(pm_answer answer) {
    return answer == PM_BY_SINES ? "quadratic" : "linear";
}

// Begins ", strength: {...}". In the form soft M acts on dS alone, so that friction needs a factor
// of M that grows with the velocity.
static list open_strength(const pm_draft *d) {
    return open_list(d->file, d->p->form == PM_SOFT ? ", features: " : ", strength: {features: ");
}

static void close_strength(const pm_draft *d, pm_answer answer) {
    if (d->p->form == PM_SOFT) {
        fprintf(d->file, "], hidden: [%d], skip: linear", SOFT_WIDTH);
    } else { // powers of co-energies are linear in their logarithms; of a difference, which may be
        // zero, they are so in a range alone
        fprintf(d->file, "], hidden: [%d]%s}",
                answer == PM_BY_FORCES ? FORCES_WIDTH : STRENGTH_WIDTH,
                answer == PM_AS_FOUND ? "" : ", skip: linear");
    }
}

// Adds the force that drives each process to the features of a strength. With its logarithm the
// network learns powers, and with its sign processes that run one way alone, as a valve or a diode.
static void add_forces(list *l) {
    add_name(l, "", "force");
    fprintf(l->file, ", \"ln(force)\"");
}

// Adds those groups of a subsystem that change in the data, of a layout if `shown` is not NULL, to
// the features of a strength, which is even in time. With `single` only the size of a variable
// counts that changes its sign when time runs backwards: the sign of a velocity matters only
// relative to that of another one. The friction of a turbulent flow grows with it.
static void add_strength(const pm_draft *d, list *l, const pm_part_view *v, const char *before,
                         const pm_layout *shown, bool single, pm_answer answer) {
    for (int g = 0; g < v->count; ++g) {
        const bool seen = shown == NULL || pm_layout_find(shown, name_of(v, g)) != NULL;
        if (!seen || v->group[g].constant || (answer == PM_BY_FORCES && !is_entropy(v, g))) {
            continue;
        }
        if (answer == PM_BY_COENERGIES) {
            // Of velocities and currents the size counts, not the sign.
            const char *size = v->odd[g] ? "\"|" : "", *end = v->odd[g] ? "|\"" : "";
            if (is_entropy(v, g) || may_lose(v, g)) {
                fprintf(l->file, "%s%s%sdE.%s%s", l->count++ > 0 ? ", " : "", size, before,
                        name_of(v, g), end);
            }
        } else if (single && v->unit[g].known && v->odd[g]) {
            add_quoted(l, "|", before, name_of(v, g));
        } else {
            add_feature(d, l, v, before, g);
        }
    }
}

bool pm_draft_follows(const pm_scene_boundary_input *input, const pm_group *group, int which) {
    bool any = false;
    for (int c = 0; c < group->size; ++c) {
        any = any || input->value[which * input->layout.nz + group->first + c].column != NULL;
    }
    return any;
}

// Writes the rates of a model without structure. At a port with a boundary input, its end `own`
// alone has a rate, which reads what the input follows.
static void write_free(const pm_draft *d, const pm_layout *const layout[2],
                       const pm_scene_boundary_input *input, int own) {
    fputs("    form: free\n", d->file);
    if (input != NULL) {
        fprintf(d->file, "    ends: %c\n", own == 0 ? 'a' : 'b');
    }
    list l = open_list(d->file, "    rate: {features: ");
    for (int k = 0; k < 2; ++k) {
        const pm_layout *shown = layout[k == 0 ? own : 1 - own];
        const char *before = layout[1] == NULL ? "" : k == 0 ? "own." : "other.";
        for (int g = 0; shown != NULL && g < shown->ngroup; ++g) {
            const char *name = shown->group[g].name;
            const pm_group *given =
                k == 0 || input == NULL ? NULL : pm_layout_find(&input->layout, name);
            if (given == NULL || pm_draft_follows(input, given, 0)) {
                add_name(&l, before, name);
            }
            if (given != NULL && pm_draft_follows(input, given, 1)) {
                add_name(&l, "other.dE.", name);
            }
        }
    }
    fprintf(d->file, "], hidden: [%d], skip: linear}\n",
            d->p->scene->physics.nsubsystem >= MANY_SUBSYSTEMS ? FREE_WIDTH_OF_MANY : FREE_WIDTH);
}

// --- subsystems: comments ---

// --- subsystems: energy and entropy ---

// Returns the hidden layers of an energy of so many inputs.
static const char *hidden_of(const pm_draft *d, int inputs) {
    const bool large = pm_draft_answer(d, PM_ASK_SIZE, 0) == PM_LARGE;
    return large         ? ENERGY_OF_LARGE
           : inputs == 1 ? ENERGY_OF_ONE
           : inputs <= 3 ? ENERGY_OF_FEW
                         : ENERGY_OF_MANY;
}

// Writes a component of a variable in SI units.
static void write_component(const pm_draft *d, const pm_part_view *v, int g, int c) {
    if (v->unit[g].factor < 1 || v->unit[g].factor > 1) {
        write_number(d->file, v->unit[g].factor);
        fputc('*', d->file);
    }
    fprintf(d->file, size_of(v, g) > 1 ? "%s[%d]" : "%s", name_of(v, g), c);
}

// Writes a sum over all amounts, each multiplied by a constant of this name and the number of the
// species, or by nothing if the name is empty.
static void write_sum(const pm_draft *d, const pm_part_view *v, const char *constant) {
    for (int g = 0, k = 0; g < v->count; ++g) {
        for (int c = 0; !is_entropy(v, g) && c < size_of(v, g); ++c) {
            fprintf(d->file, k++ > 0 ? "+" : "");
            write_component(d, v, g, c);
            if (*constant != '\0') {
                fprintf(d->file, "*%s%d", constant, k);
            }
        }
    }
}

// Writes the energy of an ideal mixture of species with constant heat capacities in a vessel, as a
// function of the entropy: with the capacity C = w + sum c n and the entropy of mixing S0 = s0 +
// R sum n (z - ln x) it is sum u n + 300 K C (exp((s - S0)/C) - 1).
static void write_mixture(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    double amount = 0; // mol, a typical one
    int species = 0, entropy = 0;
    for (int g = 0; g < v->count; ++g) {
        entropy = is_entropy(v, g) ? g : entropy;
        amount += is_entropy(v, g) ? 0 : size_of(v, g) * v->group[g].deviation * v->unit[g].factor;
        species += is_entropy(v, g) ? 0 : size_of(v, g);
    }
    fprintf(f, "    constants: {w: {learned: %.3g, positive: true}, s0: {learned: 0.0}",
            CAPACITY_OF_VESSEL * amount);
    for (int i = 1; i <= species; ++i) {
        fprintf(f,
                ", c%d: {learned: %.3g, positive: true}, u%d: {learned: 0.0}, z%d: {learned: 0.0}",
                i, CAPACITY_OF_SPECIES, i, i);
    }
    fprintf(f, "}\n    energy:\n      - \"%g*(", GAS_CONSTANT * PM_DEFAULT_TEMPERATURE);
    write_sum(d, v, "u");
    fprintf(f, ")\"\n      - \"%g*(w+", PM_DEFAULT_TEMPERATURE);
    write_sum(d, v, "c");
    fprintf(f, ")*(exp((");
    write_component(d, v, entropy, 0);
    fprintf(f, "-s0-%g*(", GAS_CONSTANT);
    for (int g = 0, k = 0; g < v->count; ++g) {
        for (int c = 0; !is_entropy(v, g) && c < size_of(v, g); ++c) {
            fprintf(f, k > 0 ? "+" : "");
            write_component(d, v, g, c);
            fprintf(f, "*(z%d-ln(", ++k);
            write_component(d, v, g, c);
            fprintf(f, ")+ln(");
            write_sum(d, v, "");
            fprintf(f, "))");
        }
    }
    fprintf(f, "))/(w+");
    write_sum(d, v, "c");
    fprintf(f, "))-1)\"\n");
}

static void write_energy(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    if (ask(d, PM_ASK_KINETIC, v) == PM_MIXTURE) {
        write_mixture(d, v);
        return;
    }
    bool done[PM_MAX_GROUPS] = {false};
    fprintf(f, "    energy:\n");
    // The energy of rotation may depend on variables without a role, such as the angular momentum
    // of a rotor in a body, or on the axis of a body seen from outside.
    bool moved = false;
    for (int g = 0; g < v->count; ++g) {
        const bool axis = v->kind[g] == PM_VIEW_DIRECTION && v->sign[g] < 0;
        moved = moved || ((v->kind[g] == PM_VIEW_OTHER || axis) && !v->group[g].constant);
    }
    const pm_answer terms = ask(d, PM_ASK_KINETIC, v);
    list l = {.file = f};
    for (int g = 0; g < v->count && terms == PM_QUADRATIC; ++g) {
        if (v->odd[g] && v->unit[g].known && !is_entropy(v, g)) {
            done[g] = true;
            l = l.count == 0 ? open_list(f, "      - {features: ") : l;
            add_name(&l, "", name_of(v, g));
        }
    }
    fprintf(f, l.count > 0 ? "], skip: quadratic}   # kinetic\n" : "");
    // Terms that depend on one group alone.
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_SPIN && !moved &&
            !done[g]) { // rotation alone does not warm a body
            done[g] = true;
            fprintf(f, "      - {features: [%s], hidden: [%d], skip: quartic}\n", name_of(v, g),
                    SPIN_WIDTH);
        }
        if (v->kind[g] != PM_VIEW_POSITION || !v->apart[g] || terms == PM_JOINT) {
            continue;
        }
        const int p = v->mate[g];
        done[p] = true;
        if (v->linear[g]) {
            fprintf(f,
                    "      - {features: [\"|%s|^2\"], skip: linear}                  "
                    "# kinetic: velocities are linear in momenta\n",
                    name_of(v, p));
        } else {
            fprintf(f, "      - {features: [%s], hidden: %s, skip: quartic}\n", name_of(v, p),
                    hidden_of(d, size_of(v, p)));
        }
    }
    // Terms of the rest, and the heat.
    const bool separate = terms == PM_SEPARATE || terms == PM_QUADRATIC;
    int inputs = 0;
    l.count = 0;
    for (int g = 0; g < v->count; ++g) {
        if (!is_entropy(v, g) && !done[g]) {
            l = l.count == 0 ? open_list(f, "      - {features: ") : l;
            inputs += add_energy_feature(d, &l, v, g);
        }
        if (l.count > 0 && (separate || g == v->count - 1)) {
            fprintf(f, "], hidden: %s, skip: quartic}\n", hidden_of(d, separate ? 1 : inputs));
            l.count = inputs = 0;
        }
    }
    // The thermal energy of each entropy, and its dependence on the rest of the state. The energy
    // of motion and of currents, which is even in momenta and fluxes, does not depend on the
    // temperature. If it could, a large heat content would take the place of a small kinetic
    // energy.
    for (int g = 0; g < v->count; ++g) {
        if (!is_entropy(v, g)) {
            continue;
        }
        l = open_list(f, "      - {features: ");
        for (int h = 0; h < v->count; ++h) {
            const bool moves = v->odd[h] && v->unit[h].known;
            if (!is_entropy(v, h) && !done[h] && !moves && ask(d, PM_ASK_HEAT, v) != PM_ALONE) {
                (void)add_energy_feature(d, &l, v, h);
            }
        }
        const bool coupled = l.count > 0;
        add_name(&l, "", name_of(v, g));
        fprintf(f, "], rising: true");
        if (coupled) {
            fprintf(f, ", hidden: [%d], skip: quartic", HEAT_WIDTH);
        }
        // The temperature with which training starts, if not 300 K.
        if (pm_draft_answer(d, PM_ASK_TEMPERATURE, 0) == PM_REDUCED) {
            fprintf(f, ", temperature: %.3g", v->unit[g].factor);
        }
        fprintf(f, coupled ? "}   # heat, and its dependence on the rest: temperatures are "
                             "positive\n"
                           : "}   # heat: temperatures are positive by construction\n");
    }
}

// Returns how many conductions a model of this many bodies has: one less than bodies, which is
// enough to reach any of their entropies from any other; in a large model one for each pair.
static int conductions_of(const pm_draft *d, int bodies) {
    const bool large = pm_draft_answer(d, PM_ASK_SIZE, 0) == PM_LARGE && bodies <= MOST_BODIES;
    return bodies < 2 ? 0 : large ? bodies * (bodies - 1) / 2 : bodies - 1;
}

// --- subsystems: operators ---

static bool is_free(const pm_part_view *v, int g) {
    return v->kind[g] == PM_VIEW_OTHER && !v->group[g].constant;
}

// Whether the lossless coupling of this group with others, or among its components, is learned. A
// momentum may also move variables besides its position, such as the charge of a second capacitor
// in a loop, the stretch of a spring in series with a dashpot, or the flux of a motor.
static bool is_coupled(const pm_part_view *v, int g, pm_answer answer) {
    if (answer != PM_AS_FOUND) {
        return pm_view_may_couple(v, g);
    }
    bool coupled = is_free(v, g);
    for (int k = 0; k < v->count && v->kind[g] == PM_VIEW_MOMENTUM; ++k) {
        coupled = coupled || (is_free(v, k) && size_of(v, k) == size_of(v, g));
    }
    return coupled;
}

// Writes L for an angular momentum z, sign z x, and for what turns with it: a direction z,
// likewise, or a quaternion. In other units than kg m^2/s the cross product has a factor.
static void write_turning(const pm_draft *d, const char *before, const pm_part_view *v, int g) {
    const int spin = v->kind[g] == PM_VIEW_SPIN ? g : v->mate[g];
    const double factor = v->unit[spin].factor * v->sign[g];
    const char *m = name_of(v, spin), *name = name_of(v, g);
    const bool quaternion = v->quaternion[g].turns != 0;
    if (!quaternion && !(factor < 1 || factor > 1)) {
        fprintf(d->file, "%s[%s, %s, cross]", before, m, name);
        return;
    }
    for (int k = 0; k < 4 * 3 && quaternion; ++k) {
        int column;
        const int sign = pm_quaternion_term(v->quaternion[g], k / 3, k % 3, &column);
        fprintf(d->file, "%s[\"%s[%d]\", \"%s[%d]\", \"%.17g*%s[%d]\"]", k == 0 ? before : ", ",
                name, k / 3, m, k % 3, sign * (0.5 / v->unit[spin].factor), name, column);
    }
    for (int c = 0, n = 0; c < 3 && !quaternion; ++c) {
        for (int k = 1; k <= (g == spin ? 1 : 2); ++k) {
            fprintf(d->file, "%s[\"%s[%d]\", \"%s[%d]\", \"%.17g*%s[%d]\"]",
                    n++ == 0 ? before : ", ", m, c, name, (c + k) % 3, (k == 1 ? -1 : 1) / factor,
                    name, (c + 3 - k) % 3);
        }
    }
}

// Writes that two momenta of one component move each other by what is linear in both, as those
// along the axes of a body do that turns or rolls: first the constants, then the pairs. Returns
// their number.
static int write_momenta(const pm_draft *d, const pm_part_view *v, bool constants,
                         const char *before) {
    int count = 0;
    for (int g = 0; g < v->count; ++g) {
        for (int h = g + 1; h < v->count; ++h) {
            if (!pm_view_may_couple(v, g) || !pm_view_may_couple(v, h) || !v->odd[g] ||
                !v->odd[h] || size_of(v, g) > 1 || size_of(v, h) > 1) {
                continue;
            }
            const char *a = name_of(v, g), *b = name_of(v, h);
            fprintf(d->file, "%s", count == 0 ? before : ", ");
            ++count;
            if (constants) {
                fprintf(d->file, "turn_%s_%s: {learned: 0.0}, turn_%s_%s: {learned: 0.0}", a, b, b,
                        a);
            } else {
                fprintf(d->file, "[%s, %s, \"turn_%s_%s*%s+turn_%s_%s*%s\"]", a, b, a, b, a, b, a,
                        b);
            }
        }
    }
    return count;
}

// Writes conjugate pairs, what turns with an angular momentum, and couplings that are to be
// learned.
static void write_reversible(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    const pm_answer answer = ask(d, PM_ASK_REVERSIBLE, v);
    int given = 0, others = 0;
    bool odd = false;
    for (int g = 0; g < v->count; ++g) {
        const char *before = given > 0 ? ", " : "    reversible:\n      given: [";
        if (v->kind[g] == PM_VIEW_POSITION) {
            fprintf(f, "%s[%s, %s, ", before, name_of(v, g), name_of(v, v->mate[g]));
            write_number(f, v->sign[g] * coefficient_unit(&v->unit[g], &v->unit[v->mate[g]]));
            fputc(']', f);
            ++given;
        } else if (v->kind[g] == PM_VIEW_SPIN || v->kind[g] == PM_VIEW_DIRECTION) {
            write_turning(d, before, v, g);
            ++given;
        }
        const bool coupled = is_coupled(v, g, answer);
        others += coupled ? size_of(v, g) : 0;
        odd = odd || (coupled && v->odd[g]);
    }
    if (answer == PM_BY_SINES) {
        given += write_momenta(d, v, false, given > 0 ? ", " : "    reversible:\n      given: [");
    }
    fprintf(f, given > 0 ? "]\n" : "");
    if (others < 2 || !odd) { // such as the amounts of two species
        return;
    }
    // Functions of angles are even in time, so that they couple what is even with what is odd.
    bool parity = answer == PM_BY_SINES;
    for (int g = 0; g < v->count; ++g) {
        parity = parity && (!is_coupled(v, g, answer) || v->unit[g].known);
    }
    list l = open_list(f, given > 0 ? "      learned: {acts_on: "
                                    : "    reversible:\n      learned: {acts_on: ");
    for (int pass = 0; pass < 1 + parity; ++pass) {
        l = pass == 0 ? l : open_list(f, "], against: ");
        for (int g = 0; g < v->count; ++g) {
            if (is_coupled(v, g, answer) && (!parity || v->odd[g] == (pass == 1))) {
                add_name(&l, "", name_of(v, g));
            }
        }
    }
    if (answer != PM_AS_FOUND && answer != PM_CONSTANT) {
        l = open_list(f, "], features: ");
        add_states(&l, v, "", NULL, answer);
        fprintf(f, "], skip: %s}\n", skip_of(answer));
    } else {
        fprintf(f, "]}\n");
    }
}

static void write_irreversible(const pm_draft *d, const pm_part_view *v, bool heat) {
    pm_look_group lossy[PM_MAX_GROUPS] = {{0}};
    bool loses[PM_MAX_GROUPS];
    int n = 0, heats = 0;
    for (int g = 0; g < v->count; ++g) {
        loses[g] = may_lose(v, g) && (ask(d, PM_ASK_FRICTION, v) == PM_AS_FOUND || !is_even(v, g));
        if (loses[g]) {
            lossy[n++] = v->group[g];
        }
        heats += is_entropy(v, g) && !v->group[g].constant ? size_of(v, g) : 0;
    }
    const int rank = pm_look_rank(&d->look, n, lossy) + conductions_of(d, heats);
    if ((heats == 0 && !heat) || rank == 0) {
        return;
    }
    list l = open_list(d->file, "    irreversible: {learned: {acts_on: ");
    for (int pass = 0; pass < 2; ++pass) { // what is dissipated, then the entropies
        for (int g = 0; g < v->count; ++g) {
            if (pass == 0 ? loses[g] : is_entropy(v, g) && !v->group[g].constant) {
                add_name(&l, "", name_of(v, g));
            }
        }
    }
    fprintf(d->file, "], rank: %d", rank);
    if (ask(d, PM_ASK_DIRECTIONS, v) == PM_BY_POSITIONS) {
        l = open_list(d->file, ", features: ");
        add_states(&l, v, "", NULL, PM_BY_POSITIONS);
        fprintf(d->file, "], skip: quadratic");
    }
    if (d->p->form == PM_SOFT || heats > 0) {
        const pm_answer answer = ask(d, PM_ASK_STRENGTH, v);
        l = open_strength(d);
        if (answer == PM_BY_FORCES) {
            add_forces(&l);
        }
        add_strength(d, &l, v, "", NULL, d->p->form == PM_HARD && count_odd(v, NULL) == 1, answer);
        close_strength(d, answer);
    }
    fprintf(d->file, "}}   # dissipative processes, whose strengths may vary with the state\n");
}

void pm_draft_part(const pm_draft *d, const pm_part_view *v) {
    const pm_scene_subsystem *subsystem = &d->p->scene->physics.subsystem[v->subsystem];
    FILE *f = d->file;
    bool heat = false; // some variable takes up heat
    for (int g = 0; g < v->count; ++g) {
        heat = heat || v->kind[g] == PM_VIEW_HEAT;
    }
    fprintf(f, "  %s:\n", subsystem->name);
    for (int g = 0; g < v->count; ++g) {
        const pm_group *group = v->group[g].group;
        fprintf(f, "    # %s, %s: deviation %.3g, rate %.3g per s", group->name,
                *group->unit == '\0' ? "a number" : group->unit, v->group[g].deviation,
                v->group[g].rate);
        switch (v->kind[g]) {
        case PM_VIEW_ENTROPY:
            fprintf(f, "; an entropy by its unit");
            break;
        case PM_VIEW_HEAT:
            fprintf(f, "; takes up heat by its unit, since there is no entropy");
            break;
        case PM_VIEW_POSITION:
            fprintf(f, "; conjugate to %s: the product of the units is J s%s",
                    name_of(v, v->mate[g]),
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
                    name_of(v, v->mate[g]));
            break;
        default:
            fprintf(f, "%s",
                    v->unit[g].known ? "" : "; the unit is NOT KNOWN, so that it says nothing");
            break;
        }
        fprintf(f, "%s%s\n",
                v->geometric[g] && v->kind[g] == PM_VIEW_OTHER
                    ? "; other variables move it, friction does not act on it"
                    : "",
                v->group[g].constant
                    ? "; CONSTANT in these data, so that nothing can be learned about it"
                    : "");
    }
    if (d->p->form == PM_FREE) {
        write_free(d, (const pm_layout *const[2]){&subsystem->layout, NULL}, NULL, 0);
        return;
    }
    fprintf(f, "    form: %s\n", d->p->form == PM_HARD ? "hard" : "soft");
    if (ask(d, PM_ASK_REVERSIBLE, v) == PM_BY_SINES &&
        write_momenta(d, v, true, "    constants: {") > 0) {
        fprintf(f, "}\n");
    }
    write_energy(d, v);
    // S is the sum of the entropies, with coefficients where they are not in J/K, or a function of
    // variables that take up heat.
    list l = {.file = f};
    if (v->nentropy > 0) {
        bool scaled = false;
        for (int g = 0; g < v->count; ++g) {
            scaled =
                scaled || (is_entropy(v, g) && (v->unit[g].factor < 1 || v->unit[g].factor > 1));
        }
        fprintf(f, "    entropy: {given: %s", scaled ? "{" : "[");
        for (int g = 0; g < v->count; ++g) {
            if (is_entropy(v, g)) {
                add_name(&l, "", name_of(v, g));
                if (scaled) {
                    fprintf(f, ": ");
                    write_number(f, v->unit[g].factor);
                }
            }
        }
        fprintf(f, scaled ? "}}\n" : "]}\n");
    } else if (heat) {
        l = open_list(f, "    entropy:\n      - {features: ");
        for (int g = 0; g < v->count; ++g) {
            add_name(&l, "", name_of(v, g));
        }
        fprintf(f, "], hidden: [%d], skip: quadratic}\n", ENTROPY_WIDTH);
    } else {
        fprintf(f, "    # No variable takes up heat, so that this subsystem conserves its "
                   "energy. If it should "
                   "not, the scene lacks an entropy.\n");
    }
    write_reversible(d, v);
    write_irreversible(d, v, heat);
}

// --- ports ---

// A port that is being written.
typedef struct port_draft {
    const pm_draft *d;
    FILE *f;
    const pm_scene_port *scene;
    const pm_layout *shown[2];     // the groups that each end exposes
    const pm_part_view *part[2];   // the subsystem at each end; NULL: a boundary input
    bool heats[2][PM_MAX_GROUPS];  // groups shown: entropies that take part in dissipation
    bool losses[2][PM_MAX_GROUPS]; // groups shown: on which dissipation may act
    // Those of heats with an entropy that a feature may name; a boundary input has only a
    // temperature.
    bool entropies[2][PM_MAX_GROUPS];
} port_draft;

static pm_answer ask_port(const port_draft *p, pm_question question) {
    const pm_physics *physics = &p->d->p->scene->physics;
    return pm_draft_answer(p->d, question, physics->nsubsystem + (int)(p->scene - physics->port));
}

static void add_states_of_both(const port_draft *p, list *l, pm_answer answer) {
    for (int end = 0; end < 2; ++end) {
        if (p->part[end] != NULL) {
            add_states(l, p->part[end], ends[end], p->shown[end], answer);
        }
    }
}

// Returns true if a variable of one end may move this group of the other end without loss: their
// units differ, and one of them changes its sign when time runs backwards. A voltage at the end of
// a resistor moves a charge by dissipation alone.
static bool may_move(const pm_layout *other, const pm_group *group) {
    const pm_unit unit = pm_unit_parse(group->unit);
    bool moves = false;
    for (int g = 0; g < other->ngroup && group->role != PM_ROLE_ENTROPY; ++g) {
        const pm_unit of_other = pm_unit_parse(other->group[g].unit);
        moves =
            moves || (other->group[g].role != PM_ROLE_ENTROPY && !pm_unit_equal(&unit, &of_other) &&
                      (pm_view_is_odd(&unit) || pm_view_is_odd(&of_other)));
    }
    return moves;
}

// Writes a learned coupling. Currents couple with the entropies of both ends: without loss only
// variables that change their sign when time runs backwards move those that keep it, and the
// entropy that a current carries depends on the latter. Otherwise the groups of the pairs couple.
static void write_learned(const port_draft *p, const pm_port_view *view, bool given) {
    static const char *const before[] = {
        "      learned: {acts_on: ", "], against: ", "], features: "};
    bool paired[2][PM_MAX_GROUPS] = {{false}};
    for (int i = 0; i < view->count && !given; ++i) {
        paired[0][view->pair[i].a] = paired[1][view->pair[i].b] = true;
    }
    fprintf(p->f,
            view->carries
                ? "      # Rates of entropies at both ends have a part that is odd in time and "
                  "follows a current.\n"
                : "      # How variables of both ends move each other is learned.\n");
    for (int k = 0; k < (view->carries ? 3 : 2); ++k) {
        list l = open_list(p->f, before[k]);
        for (int end = 0; end < 2; ++end) {
            const pm_part_view *v = p->part[end];
            for (int g = 0; g < v->count; ++g) {
                const pm_group *shown = pm_layout_find(p->shown[end], name_of(v, g));
                const bool heats = shown != NULL && p->heats[end][shown - p->shown[end]->group];
                const bool feature = k == 2 && shown != NULL && !v->group[g].constant;
                const bool coupled = view->current[end][g] || paired[end][g] || heats || feature;
                if (view->carries ? coupled && v->odd[g] == (k == 0) : paired[end][g] && end == k) {
                    add_name(&l, ends[end], name_of(v, g));
                }
            }
        }
    }
    if (view->carries) {
        fprintf(p->f, "], hidden: [%d], skip: linear}\n", CARRIED_WIDTH);
    } else {
        fprintf(p->f, "]}\n");
    }
}

static void write_port_reversible(const port_draft *p, int port) {
    const pm_answer answer = ask_port(p, PM_ASK_REVERSIBLE);
    if (answer == PM_NONE) {
        return;
    }
    if (answer != PM_AS_FOUND) { // a learned coupling of all that both ends expose but entropies
        fprintf(p->f, "    reversible:\n");
        for (int end = 0; end < 2; ++end) {
            list l = open_list(p->f, end == 0 ? "      learned: {acts_on: " : "], against: ");
            for (int g = 0; g < p->part[end]->count; ++g) {
                const char *name = name_of(p->part[end], g);
                if (pm_layout_find(p->shown[end], name) != NULL && !is_entropy(p->part[end], g) &&
                    !p->part[end]->group[g].constant) {
                    add_name(&l, ends[end], name);
                }
            }
        }
        if (answer != PM_CONSTANT) {
            list l = open_list(p->f, "], features: ");
            add_states_of_both(p, &l, answer);
            fprintf(p->f, "], skip: %s}\n", skip_of(answer));
        } else {
            fprintf(p->f, "]}\n");
        }
        return;
    }
    if (p->part[0] == NULL || p->part[1] == NULL) {
        // The values of a boundary input are not among the states that propose/look.h examines.
        bool any = false;
        for (int g = 0; g < p->shown[0]->ngroup; ++g) {
            any = any || may_move(p->shown[1], &p->shown[0]->group[g]);
        }
        if (!any) {
            return;
        }
        fprintf(
            p->f,
            "    reversible:\n      # How the boundary input acts on the subsystem is learned.\n");
        for (int end = 0; end < 2; ++end) {
            list l = open_list(p->f, end == 0 ? "      learned: {acts_on: " : ", against: ");
            for (int g = 0; g < p->shown[end]->ngroup; ++g) {
                if (may_move(p->shown[1 - end], &p->shown[end]->group[g])) {
                    add_name(&l, ends[end], p->shown[end]->group[g].name);
                }
            }
            fprintf(p->f, "]");
        }
        fprintf(p->f, "}\n");
        return;
    }
    pm_port_view view;
    pm_view_port(&p->d->look, p->d->part, port, &view);
    // Given are the coefficients that the data show, or else the guessed ones if nothing else is to
    // be learned. The others become 0.
    bool shown = false, all = !view.carries;
    for (int i = 0; i < view.count; ++i) {
        shown = shown || (view.pair[i].coefficient != 0 && !view.pair[i].guessed);
        all = all && view.pair[i].coefficient != 0;
    }
    for (int i = 0; i < view.count; ++i) {
        pm_pair_view *pair = &view.pair[i];
        if (pair->guessed && (shown || !all)) {
            *pair = (pm_pair_view){.a = pair->a, .b = pair->b};
        }
    }
    const bool given = shown || (all && view.count > 0);
    if (view.count == 0 && !view.carries) {
        fprintf(p->f,
                "    # No variable of one end moves a variable of the other end without loss.\n");
        return;
    }
    if (given) {
        // Write the pairs whose coefficients the data show. Coefficients that are only guessed
        // become learned constants. Friction accounts for the rest.
        int nlever = 0;
        for (int i = 0; i < view.count; ++i) {
            if (view.pair[i].guessed) {
                fprintf(p->f, nlever++ == 0 ? "    constants: {" : ", ");
                fprintf(p->f, "lever%d: {learned: ", nlever);
                write_number(p->f, view.pair[i].coefficient);
                fputc('}', p->f);
            }
        }
        fprintf(p->f, nlever > 0 ? "}   # of size 1, unless there is a gear or a lever\n" : "");
        fprintf(
            p->f,
            "    reversible:\n"
            "      # The data show that a momentum of one end moves a position of the other end.\n"
            "      given: [");
        for (int i = 0, n = 0, levers = 0; i < view.count; ++i) {
            const pm_pair_view *pair = &view.pair[i];
            if (pair->coefficient == 0) {
                continue;
            }
            const int group[2] = {pair->a, pair->b}, first = pair->momentum_first ? 0 : 1;
            const double units =
                coefficient_unit(&p->part[0]->unit[pair->a], &p->part[1]->unit[pair->b]);
            const bool plain = pair->guessed && !(units < 1 || units > 1);
            fprintf(p->f, "%s[%s%s, %s%s, %s", n++ > 0 ? ", " : "", ends[first],
                    name_of(p->part[first], group[first]), ends[1 - first],
                    name_of(p->part[1 - first], group[1 - first]),
                    pair->guessed && !plain ? "\"" : "");
            if (!plain) {
                write_number(p->f, pair->guessed ? units : pair->coefficient * units);
            }
            if (pair->guessed) {
                fprintf(p->f, plain ? "lever%d" : "*lever%d\"", ++levers);
            }
            fputc(']', p->f);
        }
        fprintf(p->f, "]\n");
    } else {
        fprintf(p->f, "    reversible:\n");
    }
    if (view.carries || !given) {
        write_learned(p, &view, given);
    }
}

// Adds the groups of both ends that are marked.
static void add_marked(const port_draft *p, list *l, bool marked[2][PM_MAX_GROUPS]) {
    for (int end = 0; end < 2; ++end) {
        for (int g = 0; g < p->shown[end]->ngroup; ++g) {
            if (marked[end][g]) {
                add_name(l, ends[end], p->shown[end]->group[g].name);
            }
        }
    }
}

int pm_draft_exchange(const pm_draft *d, int port, int partner[PM_MAX_GROUPS]) {
    const pm_scene_port *p = &d->p->scene->physics.port[port];
    int count = 0;
    bool taken[PM_MAX_GROUPS] = {false};
    for (int g = 0; g < p->layout[0].ngroup; ++g) {
        partner[g] = -1;
        if (p->subsystem[0] < 0 || p->subsystem[1] < 0) {
            continue;
        }
        const pm_part_view *a = &d->part[p->subsystem[0]], *b = &d->part[p->subsystem[1]];
        const int own = pm_part_view_find(a, p->layout[0].group[g].name);
        for (int h = 0; h < p->layout[1].ngroup && may_lose(a, own) && partner[g] < 0; ++h) {
            const int other = pm_part_view_find(b, p->layout[1].group[h].name);
            const double ratio = a->unit[own].factor / b->unit[other].factor;
            if (!taken[h] && may_lose(b, other) && size_of(a, own) == size_of(b, other) &&
                a->unit[own].known && pm_unit_equal(&a->unit[own], &b->unit[other]) &&
                fabs(ratio - 1) < WHOLE) {
                partner[g] = h;
                taken[h] = true;
                ++count;
            }
        }
    }
    return count;
}

static void write_port_irreversible(port_draft *p, int port) {
    const pm_draft *d = p->d;
    int lossy = 0, heats = 0, odd = 0, partner[PM_MAX_GROUPS];
    const int npair = pm_draft_exchange(d, port, partner);
    const bool exchange =
        npair > 0 && d->p->form == PM_HARD && ask_port(p, PM_ASK_FRICTION) == PM_EXCHANGE;
    // List the variables that are dissipated: first those that both ends exchange, then the others,
    // then the entropies.
    bool first[2][PM_MAX_GROUPS] = {{false}}, rest[2][PM_MAX_GROUPS];
    memcpy(rest, p->losses, sizeof rest);
    for (int g = 0; g < p->shown[0]->ngroup && exchange; ++g) {
        if (partner[g] >= 0) {
            first[0][g] = true;
            rest[0][g] = rest[1][partner[g]] = false;
        }
    }
    for (int end = 0; end < 2; ++end) {
        for (int g = 0; g < p->shown[end]->ngroup; ++g) {
            const int size = p->shown[end]->group[g].size;
            heats += p->heats[end][g] ? size : 0;
            lossy += first[end][g] || rest[end][g] ? size : 0;
        }
        odd += p->part[end] == NULL ? 0 : count_odd(p->part[end], p->shown[end]);
    }
    // The port gets as many irreversible processes as it has variables: with the smallest
    // sufficient number, fits end in poor minima.
    const int rank = lossy + conductions_of(d, heats);
    if (heats == 0 || rank == 0) {
        if (lossy > 0) {
            bool any = false;
            for (int end = 0; end < 2; ++end) {
                for (int g = 0; g < p->shown[end]->ngroup; ++g) {
                    any = any || p->shown[end]->group[g].role == PM_ROLE_ENTROPY;
                }
            }
            fprintf(p->f,
                    "    # Nothing takes up heat here, since the port exposes no entropy%s.\n",
                    any ? " that changes in the data or is given a dS" : "");
        }
        return;
    }
    list l = open_list(p->f, "    irreversible: {learned: {acts_on: ");
    add_marked(p, &l, first);
    add_marked(p, &l, rest);
    add_marked(p, &l, p->heats);
    if (exchange) {
        l = open_list(p->f, "], against: ");
        for (int g = 0; g < p->shown[0]->ngroup; ++g) {
            if (partner[g] >= 0) {
                add_name(&l, ends[1], p->shown[1]->group[partner[g]].name);
            }
        }
    }
    fprintf(p->f, "], rank: %d", rank);
    if (ask_port(p, PM_ASK_DIRECTIONS) == PM_BY_POSITIONS) {
        l = open_list(p->f, ", features: ");
        add_states_of_both(p, &l, PM_BY_POSITIONS);
        fprintf(p->f, "], skip: quadratic");
    }
    const pm_answer strength = ask_port(p, PM_ASK_STRENGTH);
    if (lossy == 0 && d->p->form == PM_HARD && strength == PM_AS_FOUND) {
        l = open_list(p->f, ", features: ");
        add_marked(p, &l, p->entropies);
        fprintf(p->f, "], hidden: [%d]", HEAT_PORT_WIDTH);
    } else { // functions of what both ends expose; a boundary input is no feature
        l = open_strength(d);
        if (strength == PM_BY_FORCES) {
            add_forces(&l);
            add_marked(p, &l, p->entropies);
        }
        for (int end = 0; end < 2 && strength != PM_BY_FORCES; ++end) {
            if (p->part[end] != NULL) {
                add_strength(d, &l, p->part[end], ends[end], p->shown[end],
                             d->p->form == PM_HARD && odd == 1, strength);
            }
        }
        close_strength(d, strength);
    }
    fprintf(p->f, "}}   # %s%s\n", lossy > 0 ? "friction between the ends" : "",
            heats < 2   ? ""
            : lossy > 0 ? ", and heat"
                        : "heat; the conductance may vary with the entropies");
}

void pm_draft_port(const pm_draft *d, int port) {
    port_draft p = {.d = d, .f = d->file, .scene = &d->p->scene->physics.port[port]};
    for (int end = 0; end < 2; ++end) {
        const int id = p.scene->subsystem[end];
        p.part[end] = id < 0 ? NULL : &d->part[id];
        p.shown[end] = &p.scene->layout[end];
        for (int g = 0; g < p.shown[end]->ngroup; ++g) {
            const pm_group *group = &p.shown[end]->group[g];
            bool constant = false, loses = false, known = true;
            if (id < 0) { // without dS it takes no part in dissipation
                const pm_scene_boundary_input *input =
                    &d->p->scene->physics.boundary_input[p.scene->boundary_input[end]];
                known =
                    input->value[2 * input->layout.nz + p.scene->component[end][group->first]].at !=
                    NULL;
                loses = known && group->role != PM_ROLE_ENTROPY;
            }
            for (int k = 0; id >= 0 && k < p.part[end]->count; ++k) {
                if (strcmp(name_of(p.part[end], k), group->name) == 0) {
                    constant = p.part[end]->group[k].constant;
                    loses =
                        may_lose(p.part[end], k) &&
                        (!is_even(p.part[end], k) || ask_port(&p, PM_ASK_FRICTION) != PM_OF_MOTION);
                }
            }
            p.heats[end][g] = group->role == PM_ROLE_ENTROPY && known && !constant;
            p.losses[end][g] = loses;
            p.entropies[end][g] = p.heats[end][g] && id >= 0;
        }
    }
    fprintf(d->file, "  %s:\n    law: %s\n", p.scene->name,
            d->p->form == PM_FREE ? "exchange" : "bracket");
    if (d->p->form == PM_FREE) {
        const int own = p.scene->subsystem[0] < 0, outside = p.scene->boundary_input[!own];
        write_free(d, p.shown,
                   p.scene->subsystem[!own] >= 0 ? NULL
                                                 : &d->p->scene->physics.boundary_input[outside],
                   own);
        return;
    }
    fprintf(d->file, d->p->form == PM_SOFT ? "    form: soft\n" : "");
    write_port_reversible(&p, port);
    write_port_irreversible(&p, port);
}

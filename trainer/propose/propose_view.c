// Classifies the variables of a scene by their units, and finds conjugate pairs and couplings
// through ports by linear regression of their rates.
#include "propose/propose_view.h"

#include <math.h>
#include <string.h>

#include "propose/gyration.h"
#include "propose/radial.h"

#define EXACT 1e-3      // unexplained fraction of the variance below which a rate is linear
#define DEGREE 8        // of the polynomials that represent any function
#define TRACE 1e-4      // fraction that a coupling must explain
#define CARRIED 0.2     // of what is even in time leaves of the rate of an entropy, at least
#define CLEAR 0.05      // unexplained fraction up to which a coefficient is trusted
#define NEAR_WHOLE 0.15 // largest distance of a trusted coefficient from a whole number

static bool is_nonentropy(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY && v->kind[g] != PM_VIEW_HEAT;
}

bool pm_view_is_odd(const pm_unit *unit) {
    return !unit->known || (unit->power[PM_UNIT_S] + unit->power[PM_UNIT_A]) % 2 != 0;
}

bool pm_view_exposes(const pm_scene *scene, int port, int end, const char *group) {
    return pm_layout_find(&scene->port[port].layout[end], group) != NULL;
}

// --- sources of a rate ---

typedef struct sources {
    int count;
    pm_look_group group[8];
} sources;

static void add_source(sources *s, const pm_look_group *g, const pm_look_group *target) {
    for (int i = 0; i < s->count; ++i) {
        if (s->group[i].first == g->first) {
            return;
        }
    }
    if (s->count < 8 && g->group->size == target->group->size && g->first != target->first) {
        s->group[s->count++] = *g;
    }
}

// Finds the groups with the unit `unit` in this subsystem and in those that share a port with it.
static sources find_sources(const pm_look *look, const pm_part_view *parts, int part, int target,
                            const pm_unit *unit) {
    const pm_scene *scene = look->scene;
    sources s = {0};
    for (int pass = 0; pass < 2; ++pass) { // its own first
        for (int i = 0; i < scene->nsubsystem; ++i) {
            bool near = i == part && pass == 0;
            for (int p = 0; p < scene->nport && pass == 1; ++p) {
                const int *end = scene->port[p].subsystem;
                near = near || (end[0] == part && end[1] == i) || (end[1] == part && end[0] == i);
            }
            for (int g = 0; g < parts[i].count && near; ++g) {
                if (pm_unit_equal(&parts[i].unit[g], unit)) {
                    add_source(&s, &parts[i].group[g], &parts[part].group[target]);
                }
            }
        }
    }
    return s;
}

// --- parts ---

// Regression of the rate of a group on its mate and on groups of neighbours with the same unit as
// the mate. Returns the unexplained fraction; *own is the coefficient of the mate.
static double explain_by_mate(const pm_look *look, const pm_part_view *parts, int part, int g,
                              int mate, double *own) {
    double coefficient[8] = {0};
    const sources s = find_sources(look, parts, part, g, &parts[part].unit[mate]);
    const double rest = pm_look_explain(look, &parts[part].group[g], s.count, s.group, coefficient);
    *own = coefficient[0];
    return rest;
}

static bool is_length(const pm_unit *unit) {
    bool only = unit->known;
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        only = only && (k == PM_UNIT_M || unit->power[k] == 0);
    }
    return only;
}

// A conjugate pair. Its position is the variable whose rate the other one explains better.
typedef struct pairing {
    int position, momentum;
    double rest, own; // unexplained fraction; coefficient of the mate
} pairing;

// One of two variables that is a length or an angle is the position, for which it need not be
// easier to explain: velocities of coupled bodies depend on positions, too.
static pairing try_pair(const pm_look *look, const pm_part_view *parts, int part, int a, int b) {
    double of_a, of_b;
    const double rest_a = explain_by_mate(look, parts, part, a, b, &of_a);
    const double rest_b = explain_by_mate(look, parts, part, b, a, &of_b);
    const bool length_a = is_length(&parts[part].unit[a]);
    const bool length_b = is_length(&parts[part].unit[b]);
    const bool first = length_a != length_b ? length_a : rest_a <= rest_b;
    return first ? (pairing){a, b, rest_a, of_a} : (pairing){b, a, rest_b, of_b};
}

static void name_pair(const pm_look *look, pm_part_view *parts, int part, const pairing *pair) {
    pm_part_view *v = &parts[part];
    const int position = pair->position, momentum = pair->momentum;
    v->mate[position] = momentum;
    v->mate[momentum] = position;
    v->kind[position] = PM_VIEW_POSITION;
    v->kind[momentum] = PM_VIEW_MOMENTUM;
    v->sign[position] = pair->own < 0 ? -1 : 1;
    v->linear[position] = pair->rest < EXACT;
    v->gyroscopic[momentum] = pm_look_gyroscopic(look, &v->group[position], &v->group[momentum]);
    const sources s = find_sources(look, parts, part, position, &v->unit[momentum]);
    v->apart[position] = v->linear[position] ||
                         pm_look_explain_powers(look, &v->group[position],
                                                s.count < 2 ? s.count : 2, s.group, DEGREE) < EXACT;
}

// Finds vectors whose energy is a polynomial of their lengths.
static void find_lengths(const pm_look *look, pm_part_view *v) {
    pm_look_group entropy[PM_MAX_GROUPS];
    int count = 0;
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_ENTROPY) {
            entropy[count++] = v->group[g];
        }
    }
    for (int g = 0; g < v->count; ++g) {
        const int size = v->group[g].group->size;
        v->by_length[g] =
            v->kind[g] == PM_VIEW_POSITION && (size == 2 || size == 3) &&
            pm_look_prefers_length(look, &v->group[g], &v->group[v->mate[g]], count, entropy);
    }
}

// Finds a variable without a role and a momentum that drive each other like a current and a torque.
static void find_gyrators(const pm_look *look, pm_part_view *v) {
    for (int p = 0; p < v->count; ++p) {
        for (int g = 0; g < v->count && v->kind[p] == PM_VIEW_MOMENTUM; ++g) {
            v->gyrates[p] =
                v->gyrates[p] ||
                (v->kind[g] == PM_VIEW_OTHER && !v->group[g].constant &&
                 v->group[g].group->size == v->group[p].group->size &&
                 pm_look_gyrates(look, &v->group[v->mate[p]], &v->group[p], &v->group[g]));
        }
    }
}

static bool may_pair(const pm_part_view *v, int a, int b) {
    const pm_unit action = pm_unit_parse("J s");
    const pm_unit product = pm_unit_product(&v->unit[a], &v->unit[b]);
    const bool spins = v->kind[a] == PM_VIEW_SPIN || v->kind[b] == PM_VIEW_SPIN;
    return !spins && v->mate[a] < 0 && v->mate[b] < 0 && is_nonentropy(v, a) &&
           is_nonentropy(v, b) && v->group[a].group->size == v->group[b].group->size &&
           pm_unit_equal(&product, &action);
}

static bool is_spin(const pm_part_view *v, int g) {
    const pm_unit action = pm_unit_parse("J s");
    return v->group[g].group->size == 3 && pm_unit_equal(&v->unit[g], &action);
}

// Returns 1 or -1 if group g turns with the angular momentum m, as sign says; 0 if it does not.
static int turns_with(const pm_look *look, pm_part_view *v, int g, int m) {
    if (v->group[g].group->size == 3) {
        return pm_look_turns(look, &v->group[g], &v->group[m]);
    }
    v->quaternion[g] = pm_look_at_quaternion(look, &v->group[g], &v->group[m]);
    return v->quaternion[g].turns;
}

// Finds vectors and quaternions that turn with an angular momentum of the same subsystem, such as
// the direction of gravity as a top sees it. Friction does not act on them.
static void find_directions(const pm_look *look, pm_part_view *v) {
    for (int g = 0; g < v->count; ++g) {
        const int size = v->group[g].group->size;
        const bool may =
            (size == 3 || size == 4) && !is_spin(v, g) && is_nonentropy(v, g) && v->mate[g] < 0;
        for (int m = 0; m < v->count && may && !v->group[g].constant; ++m) {
            const int turns = is_spin(v, m) ? turns_with(look, v, g, m) : 0;
            if (turns != 0) {
                v->kind[g] = PM_VIEW_DIRECTION;
                v->kind[m] = PM_VIEW_SPIN;
                v->mate[g] = m;
                v->sign[g] = v->sign[m] = turns;
            }
        }
    }
}

// Chooses, among several possible conjugate pairs, those whose variables explain each other best.
static void find_pairs(const pm_look *look, pm_part_view *parts, int part) {
    pm_part_view *v = &parts[part];
    bool found = true;
    find_directions(look, v);
    while (found) {
        pairing best = {.rest = INFINITY};
        found = false;
        for (int a = 0; a < v->count; ++a) {
            for (int b = a + 1; b < v->count; ++b) {
                const pairing pair = may_pair(v, a, b) ? try_pair(look, parts, part, a, b)
                                                       : (pairing){.rest = INFINITY};
                if (pair.rest < best.rest) {
                    best = pair;
                    found = true;
                }
            }
        }
        if (found) {
            name_pair(look, parts, part, &best);
        }
    }
    for (int a = 0; a < v->count; ++a) {
        if (v->mate[a] < 0 && is_spin(v, a) && v->kind[a] != PM_VIEW_SPIN) {
            v->kind[a] = PM_VIEW_SPIN;
            v->sign[a] = 1;
        }
    }
}

// Friction does not act on lengths and angles with a conjugate variable, nor on lengths, areas and
// volumes whose rate is proportional to another variable.
static void find_geometric(const pm_look *look, pm_part_view *parts, int part) {
    pm_part_view *v = &parts[part];
    for (int g = 0; g < v->count; ++g) {
        v->geometric[g] = v->kind[g] == PM_VIEW_DIRECTION;
        if (!is_length(&v->unit[g]) || v->geometric[g]) {
            continue;
        }
        v->geometric[g] = v->kind[g] == PM_VIEW_POSITION;
        for (int i = 0; i < look->scene->nsubsystem && v->mate[g] < 0; ++i) {
            for (int k = 0; k < parts[i].count; ++k) {
                double coefficient[8];
                const sources s = find_sources(look, parts, part, g, &parts[i].unit[k]);
                v->geometric[g] =
                    v->geometric[g] ||
                    (is_nonentropy(&parts[i], k) && !is_length(&parts[i].unit[k]) && s.count > 0 &&
                     pm_look_explain(look, &v->group[g], s.count, s.group, coefficient) < EXACT);
            }
        }
    }
}

static void begin_part(const pm_look *look, int subsystem, pm_part_view *v) {
    const pm_unit entropy = pm_unit_parse("J/K"), energy = pm_unit_parse("J");
    const pm_unit temperature = pm_unit_parse("K");
    const pm_layout *layout = &look->scene->subsystem[subsystem].layout;
    *v = (pm_part_view){.subsystem = subsystem, .count = layout->ngroup};
    for (int g = 0; g < v->count; ++g) {
        v->group[g] = pm_look_at(look, subsystem, g);
        v->unit[g] = pm_unit_parse(layout->group[g].unit);
        v->odd[g] = pm_view_is_odd(&v->unit[g]);
        v->mate[g] = -1;
        if (pm_unit_equal(&v->unit[g], &entropy)) {
            v->kind[g] = PM_VIEW_ENTROPY;
            v->nentropy += layout->group[g].size;
        }
    }
    for (int g = 0; g < v->count && v->nentropy == 0; ++g) {
        if (pm_unit_equal(&v->unit[g], &energy) || pm_unit_equal(&v->unit[g], &temperature)) {
            v->kind[g] = PM_VIEW_HEAT;
        }
    }
}

void pm_view_parts(const pm_look *look, pm_part_view *view) {
    const int n = look->scene->nsubsystem;
    for (int i = 0; i < n; ++i) {
        begin_part(look, i, &view[i]);
    }
    for (int i = 0; i < n; ++i) {
        find_pairs(look, view, i);
    }
    for (int i = 0; i < n; ++i) {
        find_geometric(look, view, i);
        find_gyrators(look, &view[i]);
        find_lengths(look, &view[i]);
    }
}

pm_rotation pm_view_rotation(const pm_look *look, const pm_part_view *parts) {
    enum { MOST = 64 };
    pm_look_group q[MOST], p[MOST];
    int count = 0;
    for (int i = 0; i < look->scene->nsubsystem; ++i) {
        const pm_part_view *v = &parts[i];
        for (int g = 0; g < v->count && count < MOST; ++g) {
            const int size = v->group[g].group->size;
            if (v->kind[g] == PM_VIEW_POSITION && (size == 2 || size == 3)) {
                q[count] = v->group[g];
                p[count++] = v->group[v->mate[g]];
            }
        }
    }
    return pm_look_rotation(look, count, q, p);
}

// --- ports ---

double pm_view_coefficient_unit(const pm_unit *a, const pm_unit *b) {
    return 1 / (a->factor * b->factor);
}

// Returns how much more of the rate of `target` is explained when `source` is added to the
// variables of its own subsystem, and writes the coefficients of `source` and of the mate.
static double gain(const pm_look *look, const pm_part_view *own, int target,
                   const pm_look_group *source, double *coefficient, double *of_mate,
                   double *rest) {
    sources s = {0};
    double value[8] = {0};
    if (own->mate[target] >= 0) {
        add_source(&s, &own->group[own->mate[target]], &own->group[target]);
    }
    for (int g = 0; g < own->count; ++g) {
        if (s.count < 6) {
            add_source(&s, &own->group[g], &own->group[target]);
        }
    }
    const double without = pm_look_explain(look, &own->group[target], s.count, s.group, value);
    const int before = s.count;
    add_source(&s, source, &own->group[target]);
    if (s.count == before) {
        return 0;
    }
    *rest = pm_look_explain(look, &own->group[target], s.count, s.group, value);
    *coefficient = value[s.count - 1];
    *of_mate = value[0];
    return without - *rest;
}

// Returns 1 or -1 if the momentum of a neighbour moves a position as it moves the neighbour's own
// position, with this factor; else 0.
static double whole_coefficient(const pm_look *look, const pm_part_view *carrier, int momentum,
                                const pm_part_view *carried, int position) {
    double other, mate, rest = 1, at_home;
    const int home = carrier->mate[momentum];
    if (carrier->kind[momentum] != PM_VIEW_MOMENTUM ||
        carried->kind[position] != PM_VIEW_POSITION || home < 0 ||
        gain(look, carried, position, &carrier->group[momentum], &other, &mate, &rest) < TRACE ||
        rest > CLEAR) {
        return 0;
    }
    // The velocity per momentum of the neighbour itself, whatever else moves its position.
    const pm_look_group *source = &carrier->group[momentum];
    const double rest_home = pm_look_explain(look, &carrier->group[home], 1, source, &at_home);
    const double units = carried->unit[position].factor / carrier->unit[home].factor;
    const double c =
        at_home == 0 || rest_home > 0.5 ? 0 : -other / at_home * units * carrier->sign[home];
    const double whole = round(c);
    return fabs(c - whole) < NEAR_WHOLE && fabs(whole) == 1 ? whole : 0;
}

// Returns 1 or -1 if the rate of a position is linear in momenta of its own subsystem and of
// neighbours, with the sign of the coefficient of this momentum, and the product of both units is
// J s; else 0. The coefficient is 1 or -1, unless there is a gear or a lever between them.
static double guess_coefficient(const pm_look *look, const pm_part_view *parts,
                                const pm_part_view *carrier, int momentum, int carried,
                                int position) {
    const pm_part_view *v = &parts[carried];
    const pm_unit action = pm_unit_parse("J s");
    const pm_unit product = pm_unit_product(&carrier->unit[momentum], &v->unit[position]);
    double coefficient[8] = {0};
    if (!pm_unit_equal(&product, &action) || carrier->kind[momentum] == PM_VIEW_SPIN) {
        return 0;
    }
    const sources s = find_sources(look, parts, carried, position, &carrier->unit[momentum]);
    sources others = {0};
    const double rest = pm_look_explain(look, &v->group[position], s.count, s.group, coefficient);
    double sign = 0, unused[8];
    for (int i = 0; i < s.count; ++i) {
        if (s.group[i].first == carrier->group[momentum].first) {
            sign = coefficient[i] < 0 ? -1 : 1;
        } else {
            others.group[others.count++] = s.group[i];
        }
    }
    const double without =
        pm_look_explain(look, &v->group[position], others.count, others.group, unused);
    return rest < CLEAR && without - rest > TRACE ? sign : 0;
}

static void view_pair(const pm_look *look, const pm_part_view *parts, const pm_part_view *a, int ga,
                      const pm_part_view *b, int gb, pm_port_view *view) {
    double c, mate, rest = 1;
    if (pm_unit_equal(&a->unit[ga], &b->unit[gb]) || !(a->odd[ga] || b->odd[gb])) {
        return; // only dissipation couples variables with equal units, or two that are even
    }
    const double to_b = whole_coefficient(look, a, ga, b, gb);
    const double to_a = whole_coefficient(look, b, gb, a, ga);
    const bool of_a = gain(look, a, ga, &b->group[gb], &c, &mate, &rest) > TRACE;
    const bool of_b = gain(look, b, gb, &a->group[ga], &c, &mate, &rest) > TRACE;
    const bool comparable = a->group[ga].group->size == b->group[gb].group->size;
    if (to_b == 0 && to_a == 0 && !of_a && !of_b && comparable) {
        return;
    }
    pm_pair_view *pair = &view->pair[view->count++];
    *pair = (pm_pair_view){
        .a = ga, .b = gb, .momentum_first = to_b != 0, .coefficient = to_b != 0 ? to_b : to_a};
    if (pair->coefficient == 0 && comparable) {
        const double up = guess_coefficient(look, parts, a, ga, b->subsystem, gb);
        const double down = guess_coefficient(look, parts, b, gb, a->subsystem, ga);
        pair->guessed = up != 0 || down != 0;
        pair->momentum_first = up != 0 && !(down != 0 && is_length(&a->unit[ga]));
        pair->coefficient = pair->momentum_first ? -up : -down;
    }
}

void pm_view_port(const pm_look *look, const pm_part_view *parts, int port, pm_port_view *view) {
    const int *end = look->scene->port[port].subsystem;
    view->count = 0;
    if (end[0] < 0 || end[1] < 0) {
        return;
    }
    const pm_part_view *a = &parts[end[0]], *b = &parts[end[1]];
    for (int i = 0; i < a->count; ++i) {
        for (int k = 0; k < b->count; ++k) {
            if (is_nonentropy(a, i) && is_nonentropy(b, k) &&
                pm_view_exposes(look->scene, port, 0, a->group[i].group->name) &&
                pm_view_exposes(look->scene, port, 1, b->group[k].group->name)) {
                view_pair(look, parts, a, i, b, k, view);
            }
        }
    }
}

// --- entropy carried by currents ---

// Adds the components of all groups of a subsystem that change.
static void add_parity(const pm_part_view *v, pm_parity *p) {
    for (int g = 0; g < v->count; ++g) {
        for (int c = 0; c < v->group[g].group->size && !v->group[g].constant; ++c) {
            if (v->odd[g] && p->nodd < PM_LOOK_SOURCES) {
                p->odd[p->nodd++] = v->group[g].first + c;
            } else if (!v->odd[g] && p->neven < PM_LOOK_SOURCES) {
                p->even[p->neven++] = v->group[g].first + c;
            }
        }
    }
}

bool pm_view_carries_entropy(const pm_look *look, const pm_part_view *parts, int port, int end,
                             int group) {
    const pm_scene_port *scene = &look->scene->port[port];
    if (scene->subsystem[0] < 0 || scene->subsystem[1] < 0) {
        return false;
    }
    const pm_part_view *own = &parts[scene->subsystem[end]];
    const pm_look_group *current = &own->group[group];
    if (!own->unit[group].known || !own->odd[group] || current->constant ||
        !pm_view_exposes(look->scene, port, end, current->group->name)) {
        return false;
    }
    pm_parity parity = {0};
    add_parity(&parts[scene->subsystem[0]], &parity);
    add_parity(&parts[scene->subsystem[1]], &parity);
    bool carries = true;
    for (int e = 0; e < 2; ++e) { // what leaves one end arrives at the other
        const pm_part_view *v = &parts[scene->subsystem[e]];
        bool moves = false;
        for (int g = 0; g < v->count; ++g) {
            const bool heated = v->kind[g] == PM_VIEW_ENTROPY && !v->group[g].constant &&
                                pm_view_exposes(look->scene, port, e, v->group[g].group->name);
            for (int c = 0; c < v->group[g].group->size && heated; ++c) {
                for (int k = 0; k < current->group->size; ++k) {
                    moves = moves || pm_look_odd_part(look, &parity, v->group[g].first + c,
                                                      current->first + k) > CARRIED;
                }
            }
        }
        carries = carries && moves;
    }
    return carries;
}

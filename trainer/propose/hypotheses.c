// The hypotheses about a scene: which questions are worth asking about each subsystem and port, and
// their answers in the order of belief.
#include <math.h>
#include <string.h>

#include "propose/draft.h"

#define COUPLINGS 5 // hypotheses about L of a port
#define TURNS 1.5   // rad: the deviation of an angle beyond which sine and cosine are believed more

// The answers in words.
static const char *const words[] = {[PM_AS_FOUND] = "as found",
                                    [PM_CONSTANT] = "learned constants",
                                    [PM_BY_POSITIONS] = "a function of positions",
                                    [PM_BY_STATES] = "a function of the state",
                                    [PM_BY_COENERGIES] = "a function of co-energies",
                                    [PM_NONE] = "none",
                                    [PM_ALONE] = "of the entropy alone",
                                    [PM_BY_COMPONENTS] = "of components",
                                    [PM_BY_BOTH] = "of lengths and components",
                                    [PM_BY_SINES] = "of sine and cosine",
                                    [PM_JOINT] = "one function of all variables",
                                    [PM_SEPARATE] = "a function of each variable",
                                    [PM_QUADRATIC] = "a quadratic form of momenta",
                                    [PM_MIXTURE] = "those of an ideal mixture",
                                    [PM_OF_MOTION] = "on momenta and fluxes alone",
                                    [PM_REDUCED] = "1 K, as in reduced units",
                                    [PM_LARGE] = "larger",
                                    [PM_EXCHANGE] = "by what one end loses and the other gains",
                                    [PM_BY_FORCES] = "a function of what drives it"};

// Adds a question with `count` answers.
static void ask(pm_draft *d, pm_question question, int component, int count,
                const pm_answer *answer) {
    static const char *const what[PM_QUESTIONS] = {[PM_ASK_REVERSIBLE] = "L",
                                                   [PM_ASK_FRICTION] = "friction",
                                                   [PM_ASK_DIRECTIONS] = "directions of friction",
                                                   [PM_ASK_STRENGTH] = "strength of friction",
                                                   [PM_ASK_HEAT] = "heat",
                                                   [PM_ASK_ENERGY] = "energy",
                                                   [PM_ASK_ANGLE] = "angles",
                                                   [PM_ASK_KINETIC] = "terms of the energy",
                                                   [PM_ASK_TEMPERATURE] = "temperature at first",
                                                   [PM_ASK_SIZE] = "size"};
    const pm_physics *physics = &d->p->scene->physics;
    const int port = component - physics->nsubsystem;
    const char *text[PM_SEARCH_ALTERNATIVES];
    char name[PM_SEARCH_NAME];
    const char *of = question >= PM_ASK_TEMPERATURE ? "the scene"
                     : port >= 0                    ? physics->port[port].name
                                                    : physics->subsystem[component].name;
    snprintf(name, sizeof name, "%s of %s", what[question], of);
    for (int i = 0; i < count; ++i) {
        text[i] = words[answer[i]];
    }
    const int id = pm_hypotheses_add(&d->space, name, count, text);
    if (id >= 0) {
        d->space.choice[id].kind = 1 + (int)question;
    }
    for (int i = 0; id >= 0 && i < count; ++i) {
        const bool separate = answer[i] == PM_SEPARATE && answer[0] != PM_MIXTURE;
        const bool simple = answer[i] == PM_ALONE || answer[i] == PM_OF_MOTION ||
                            answer[i] == PM_EXCHANGE || separate || answer[i] == PM_QUADRATIC;
        d->space.choice[id].simplest = simple ? i : d->space.choice[id].simplest;
    }
    // The groups of the subsystem, or those that the ends of the port expose.
    for (int i = 0, cell = 0; id >= 0 && i < physics->nsubsystem; ++i) {
        const pm_layout *own = &physics->subsystem[i].layout;
        for (int g = 0; g < own->ngroup && question < PM_ASK_TEMPERATURE; ++g, ++cell) {
            bool moved = i == component;
            for (int end = 0; port >= 0 && end < 2; ++end) {
                const pm_scene_port *p = &physics->port[port];
                moved = moved || (p->subsystem[end] == i &&
                                  pm_layout_find(&p->layout[end], own->group[g].name) != NULL);
            }
            if (moved && cell < PM_FIT_SCORED_GROUPS) {
                d->space.choice[id].acts_on |= 1ULL << cell;
            }
        }
    }
    if (id >= 0) {
        memcpy(d->answer[id], answer, (size_t)count * sizeof *answer);
        d->asked[component][question] = id;
    }
}

// Properties of the groups of a subsystem, or of those that one end of a port exposes. They decide
// which questions make sense.
typedef struct inventory {
    int coupled;     // components that a learned L may couple
    int lossy, heat; // components on which friction may act, and of entropies
    bool odd;        // some of the coupled change their sign when time runs backwards
    bool stays;      // friction may act on something that does not
    bool position;   // a variable that does not, and is no entropy
    bool vector;     // such a variable of two or three components
    bool angle, turns, apart;
    int shares;          // variables that may share a term of the energy
    bool named;          // a variable has the name of the feature "force"
    int amounts, others; // components in mol, and of all that is neither this nor an entropy
    bool moves, spins;   // friction may act on an odd vector, and on an odd scalar
    bool rotates;        // an angular momentum of three components
} inventory;

static void count(inventory *n, const pm_part_view *v, const pm_layout *shown) {
    const pm_unit mol = pm_unit_parse("mol");
    for (int g = 0; g < v->count; ++g) {
        const pm_group *group = v->group[g].group;
        const bool even = v->unit[g].known && !v->odd[g];
        const bool amount = pm_unit_equal(&v->unit[g], &mol);
        n->amounts += amount ? group->size : 0;
        n->others += amount || v->kind[g] == PM_VIEW_ENTROPY ? 0 : group->size;
        if (v->group[g].constant || (shown != NULL && pm_layout_find(shown, group->name) == NULL)) {
            continue;
        }
        if (v->kind[g] == PM_VIEW_ENTROPY) {
            n->heat += group->size;
            continue;
        }
        const bool couples = shown != NULL || pm_view_may_couple(v, g);
        n->coupled += couples ? group->size : 0;
        n->odd = n->odd || (couples && v->odd[g]);
        n->lossy += v->geometric[g] ? 0 : group->size;
        n->position = n->position || even;
        n->stays = n->stays || (even && !v->geometric[g]);
        n->vector = n->vector || (even && (group->size == 2 || group->size == 3) &&
                                  v->kind[g] != PM_VIEW_DIRECTION);
        const bool slows = v->odd[g] && !v->geometric[g];
        n->moves = n->moves || (slows && (group->size == 2 || group->size == 3));
        n->spins = n->spins || (slows && group->size == 1);
        n->rotates = n->rotates || v->kind[g] == PM_VIEW_SPIN;
        n->angle = n->angle || v->angle[g];
        n->turns = n->turns || (v->angle[g] && v->group[g].deviation * v->unit[g].factor > TURNS);
        n->shares += 1;
        n->named = n->named || (shown == NULL && strcmp(group->name, "force") == 0);
        n->apart = n->apart || (v->kind[g] == PM_VIEW_POSITION && v->apart[g]);
    }
}

// Returns whether the rates of all pairs of an exchange are opposite to each other in the data.
static bool opposite(const pm_draft *d, const pm_scene_port *port, const int *partner) {
    const pm_part_view *a = &d->part[port->subsystem[0]], *b = &d->part[port->subsystem[1]];
    bool all = true;
    for (int g = 0; g < port->layout[0].ngroup; ++g) {
        if (partner[g] >= 0) {
            const pm_look_group pair[2] = {
                a->group[pm_part_view_find(a, port->layout[0].group[g].name)],
                b->group[pm_part_view_find(b, port->layout[1].group[partner[g]].name)]};
            all = all && pm_look_rank(&d->look, 2, pair) == pair[0].group->size;
        }
    }
    return all;
}

// Returns true if there are entropies and nothing fixes the scale of energies: no variable changes
// its sign when time runs backwards or is an energy, all units are known, and there is neither a
// boundary input nor a given model. Models whose energies and temperatures are all larger by one
// factor then have the same rates.
static bool is_scale_free(const pm_draft *d) {
    const pm_physics *physics = &d->p->scene->physics;
    const pm_unit energy = pm_unit_parse("J");
    bool warm = false, free = physics->nboundary_input == 0;
    for (int i = 0; i < physics->nport; ++i) {
        free = free && physics->port[i].model == NULL;
    }
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_part_view *v = &d->part[i];
        free = free && physics->subsystem[i].model == NULL;
        for (int g = 0; g < v->count; ++g) {
            warm = warm || v->kind[g] == PM_VIEW_ENTROPY;
            free = free && v->unit[g].known && !v->odd[g] && !pm_unit_equal(&v->unit[g], &energy);
        }
    }
    return warm && free;
}

void pm_draft_ask(pm_draft *d) {
    static const pm_answer reversible[] = {PM_AS_FOUND, PM_BY_STATES, PM_BY_POSITIONS, PM_CONSTANT,
                                           PM_NONE},
                           turning[] = {PM_AS_FOUND,     PM_BY_SINES, PM_BY_STATES,
                                        PM_BY_POSITIONS, PM_CONSTANT, PM_NONE},
                           strength[] = {PM_AS_FOUND, PM_BY_COENERGIES, PM_BY_FORCES},
                           exchange[] = {PM_EXCHANGE, PM_AS_FOUND, PM_EXCHANGE},
                           // Friction between an orbit and a spin that favours no direction
                           // turns with the orbit.
        directions[] = {PM_BY_POSITIONS, PM_AS_FOUND, PM_BY_POSITIONS},
                           friction[] = {PM_AS_FOUND, PM_OF_MOTION},
                           heat[] = {PM_AS_FOUND, PM_ALONE},
                           energy[] = {PM_AS_FOUND, PM_BY_BOTH, PM_BY_COMPONENTS},
                           angle[] = {PM_AS_FOUND, PM_BY_SINES, PM_AS_FOUND},
                           terms[] = {PM_AS_FOUND, PM_SEPARATE, PM_JOINT},
                           spinning[] = {PM_AS_FOUND, PM_SEPARATE, PM_QUADRATIC},
                           mixture[] = {PM_MIXTURE, PM_AS_FOUND, PM_SEPARATE};
    static const pm_answer joint[] = {PM_AS_FOUND, PM_JOINT},
                           temperature[] = {PM_AS_FOUND, PM_REDUCED},
                           size[] = {PM_AS_FOUND, PM_LARGE};
    const pm_physics *physics = &d->p->scene->physics;
    for (int i = 0; i < physics->nsubsystem + physics->nport; ++i) {
        for (int q = 0; q < PM_QUESTIONS; ++q) {
            d->asked[i][q] = -1;
        }
    }
    if (d->p->form == PM_FREE) {
        return;
    }
    for (int component = 0; component < physics->nsubsystem + physics->nport; ++component) {
        const pm_scene_port *port = component < physics->nsubsystem
                                        ? NULL
                                        : &physics->port[component - physics->nsubsystem];
        if (port == NULL ? physics->subsystem[component].model != NULL : port->model != NULL) {
            continue;
        }
        inventory n = {.odd = false};
        bool lossless = true; // both ends have what a lossless port may couple
        for (int end = 0; end < (port == NULL ? 1 : 2); ++end) {
            const int id = port == NULL ? component : port->subsystem[end];
            const int before = n.coupled;
            if (id >= 0) {
                count(&n, &d->part[id], port == NULL ? NULL : &port->layout[end]);
            }
            lossless = lossless && n.coupled > before;
        }
        if (n.odd && lossless && (port != NULL || n.coupled > 1)) {
            ask(d, PM_ASK_REVERSIBLE, component, COUPLINGS - (port == NULL) + n.angle,
                n.angle ? turning : reversible);
        }
        if (port == NULL && n.angle) {
            ask(d, PM_ASK_ANGLE, component, 2, n.turns ? angle + 1 : angle);
        }
        if (port == NULL && n.heat > 0 && n.position) {
            ask(d, PM_ASK_HEAT, component, 2, heat);
        }
        if (n.heat > 0 && n.heat + n.lossy > 1) {
            int partner[PM_MAX_GROUPS];
            const int pairs =
                port == NULL ? 0 : pm_draft_exchange(d, component - physics->nsubsystem, partner);
            if (pairs > 0) {
                ask(d, PM_ASK_FRICTION, component, 2, exchange + !opposite(d, port, partner));
            } else if (n.stays && n.odd) {
                ask(d, PM_ASK_FRICTION, component, 2, friction);
            }
            ask(d, PM_ASK_STRENGTH, component, d->p->form == PM_HARD && !n.named ? 3 : 2, strength);
            const int id = d->asked[component][PM_ASK_STRENGTH];
            if (pairs > 0 && d->p->form == PM_HARD && id >= 0) { // with what an end loses
                d->space.choice[id].simplest = 2;
            }
        }
        if (n.heat > 0 && n.lossy > 1 && n.position) {
            const bool turns = d->rotates != PM_ROTATION_NONE && n.moves && n.spins;
            ask(d, PM_ASK_DIRECTIONS, component, 2, directions + !turns);
        }
        if (port == NULL && n.vector) {
            ask(d, PM_ASK_ENERGY, component, d->rotates != PM_ROTATION_NONE ? 3 : 2, energy);
        }
        if (port == NULL && n.amounts > 1 && n.others == 0 && n.heat == 1) {
            ask(d, PM_ASK_KINETIC, component, 3, mixture);
        } else if (port == NULL && n.rotates && !n.apart) {
            ask(d, PM_ASK_KINETIC, component, 3, spinning);
        } else if (port == NULL && n.shares > (n.apart ? 2 : 1)) {
            ask(d, PM_ASK_KINETIC, component, n.apart ? 3 : 2, terms);
        } else if (port == NULL && n.apart) {
            ask(d, PM_ASK_KINETIC, component, 2, joint);
        }
    }
    bool warm = false;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        for (int g = 0; g < d->part[i].count; ++g) {
            warm = warm || (d->part[i].kind[g] == PM_VIEW_ENTROPY && !d->part[i].group[g].constant);
        }
    }
    // Where no variable has the scale of an energy, errors cannot tell 1 K from 300 K, and the unit
    // of the entropy decides: J/K means 300 K.
    d->free_scale = is_scale_free(d);
    if (warm && !d->free_scale) {
        ask(d, PM_ASK_TEMPERATURE, 0, 2, temperature);
    }
    ask(d, PM_ASK_SIZE, 0, 2, size);
}

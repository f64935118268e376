// Writes the model of a port in a proposed training file: its reversible and its irreversible
// operator in the forms hard and soft, a network for the boundary term in the form free.
#include <string.h>

#include "propose/propose_draft.h"

#define CARRIED_WIDTH 4 // hidden units of the entropy that a current carries

static const char *const ends[2] = {"a.", "b."};

// Returns the groups that one end of a port exposes, those of a subsystem or of a boundary input.
static const pm_layout *shown(const pm_draft *d, int port, int end) {
    return &d->p->scene->port[port].layout[end];
}

static bool is_entropy_unit(const pm_group *group) {
    const pm_unit entropy = pm_unit_parse("J/K"), unit = pm_unit_parse(group->unit);
    return pm_unit_equal(&entropy, &unit);
}

// Returns true if a variable of one end may move this group of the other end without loss: their
// units differ, and one of them changes its sign when time runs backwards. A voltage at the end of
// a resistor moves a charge by dissipation alone.
static bool may_move(const pm_layout *other, const pm_group *group) {
    const pm_unit unit = pm_unit_parse(group->unit);
    bool moves = false;
    for (int g = 0; g < other->ngroup && !is_entropy_unit(group); ++g) {
        const pm_unit of_other = pm_unit_parse(other->group[g].unit);
        moves = moves || (!is_entropy_unit(&other->group[g]) && !pm_unit_equal(&unit, &of_other) &&
                          (pm_view_is_odd(&unit) || pm_view_is_odd(&of_other)));
    }
    return moves;
}

// Writes a learned coupling with a boundary input, whose values are not among the states that
// propose/look.h examines.
static void write_boundary_input_pairs(const pm_draft *d, int port) {
    const pm_layout *layout[2] = {shown(d, port, 0), shown(d, port, 1)};
    bool any = false;
    for (int g = 0; g < layout[0]->ngroup; ++g) {
        any = any || may_move(layout[1], &layout[0]->group[g]);
    }
    if (!any) {
        return;
    }
    fprintf(d->file,
            "    reversible:\n      # How the boundary input acts on the subsystem is learned.\n");
    for (int end = 0; end < 2; ++end) {
        pm_draft_list l =
            pm_draft_open(d->file, end == 0 ? "      learned: {acts_on: " : ", against: ");
        for (int g = 0; g < layout[end]->ngroup; ++g) {
            if (may_move(layout[1 - end], &layout[end]->group[g])) {
                pm_draft_add(&l, ends[end], layout[end]->group[g].name);
            }
        }
        fprintf(d->file, "]");
    }
    fprintf(d->file, "}\n");
}

// A pair as the file names it: the momentum, the position, and their units.
typedef struct written_pair {
    const char *end[2], *name[2];
    const pm_unit *unit[2];
} written_pair;

static written_pair order_pair(const pm_part_view *a, const pm_part_view *b,
                               const pm_pair_view *p) {
    const written_pair w = {{ends[0], ends[1]},
                            {pm_draft_name(a, p->a), pm_draft_name(b, p->b)},
                            {&a->unit[p->a], &b->unit[p->b]}};
    const written_pair swapped = {
        {w.end[1], w.end[0]}, {w.name[1], w.name[0]}, {w.unit[1], w.unit[0]}};
    return p->momentum_first ? w : swapped;
}

// Writes the learned coefficients of pairs as constants.
static void write_levers(FILE *f, const pm_port_view *view) {
    int count = 0;
    for (int i = 0; i < view->count; ++i) {
        if (view->pair[i].guessed) {
            fprintf(f, count++ == 0 ? "    constants: {" : ", ");
            fprintf(f, "lever%d: {learned: ", count);
            pm_draft_number(f, view->pair[i].coefficient);
            fputc('}', f);
        }
    }
    fprintf(f, count > 0 ? "}   # of size 1, unless there is a gear or a lever\n" : "");
}

// Writes the pairs whose coefficients the data show. Friction accounts for the rest.
static void write_given_pairs(FILE *f, const pm_part_view *a, const pm_part_view *b,
                              const pm_port_view *view) {
    fprintf(f,
            "      # The data show that a momentum of one end moves a position of the other end.\n"
            "      given: [");
    for (int i = 0, n = 0, levers = 0; i < view->count; ++i) {
        const pm_pair_view *p = &view->pair[i];
        if (p->coefficient != 0) {
            const written_pair w = order_pair(a, b, p);
            fprintf(f, "%s[%s%s, %s%s, ", n++ > 0 ? ", " : "", w.end[0], w.name[0], w.end[1],
                    w.name[1]);
            const double units = pm_view_coefficient_unit(w.unit[0], w.unit[1]);
            const bool plain = p->guessed && !(units < 1 || units > 1);
            fprintf(f, p->guessed && !plain ? "\"" : "");
            if (!plain) {
                pm_draft_number(f, p->guessed ? units : p->coefficient * units);
            }
            if (p->guessed) {
                fprintf(f, plain ? "lever%d" : "*lever%d\"", ++levers);
            }
            fputc(']', f);
        }
    }
    fprintf(f, "]\n");
}

// Writes the list of those groups of one end that some pair of the view names.
static void write_named_groups(FILE *f, const char *before, const pm_part_view *part, int end,
                               const pm_port_view *view) {
    pm_draft_list l = pm_draft_open(f, before);
    for (int g = 0; g < part->count; ++g) {
        bool named = false;
        for (int i = 0; i < view->count; ++i) {
            named = named || (end == 0 ? view->pair[i].a : view->pair[i].b) == g;
        }
        if (named) {
            pm_draft_add(&l, ends[end], pm_draft_name(part, g));
        }
    }
}

// Returns true if dS of this group is known. A boundary input without dS takes no part in
// dissipation.
static bool has_coentropy(const pm_draft *d, int port, int end, const pm_group *group) {
    const pm_scene_port *scene = &d->p->scene->port[port];
    if (scene->subsystem[end] >= 0) {
        return true;
    }
    const pm_scene_boundary_input *input = &d->p->scene->boundary_input[scene->boundary_input[end]];
    return input->value[2 * input->layout.nz + scene->component[end][group->first]].at != NULL;
}

// Whether a group of a subsystem does not change in the data.
static bool is_constant(const pm_draft *d, int port, int end, const pm_group *group) {
    const int id = d->p->scene->port[port].subsystem[end];
    for (int g = 0; id >= 0 && g < d->part[id].count; ++g) {
        if (strcmp(pm_draft_name(&d->part[id], g), group->name) == 0) {
            return d->part[id].group[g].constant;
        }
    }
    return false;
}

static bool port_heats(const pm_draft *d, int port, int end, const pm_group *group) {
    return is_entropy_unit(group) && has_coentropy(d, port, end, group) &&
           !is_constant(d, port, end, group);
}

// The groups of both ends that a learned reversible operator couples.
typedef struct coupling {
    bool current[2][PM_MAX_GROUPS]; // these carry entropy between the ends
    bool named[2][PM_MAX_GROUPS];   // these belong to pairs whose coefficients are to be learned
    bool carries;                   // any current
} coupling;

static bool carries_entropy(const pm_draft *d, int port) {
    bool carries = false;
    for (int end = 0; end < 2; ++end) {
        const int id = d->p->scene->port[port].subsystem[end];
        for (int g = 0; g < d->part[id].count; ++g) {
            carries = carries || pm_view_carries_entropy(&d->look, d->part, port, end, g);
        }
    }
    return carries;
}

static coupling find_coupling(const pm_draft *d, int port, const pm_port_view *view, bool given) {
    const pm_scene_port *scene = &d->p->scene->port[port];
    coupling c = {.carries = false};
    for (int end = 0; end < 2; ++end) {
        const pm_part_view *part = &d->part[scene->subsystem[end]];
        for (int g = 0; g < part->count; ++g) {
            c.current[end][g] = pm_view_carries_entropy(&d->look, d->part, port, end, g);
            c.carries = c.carries || c.current[end][g];
        }
    }
    for (int i = 0; i < view->count && !given; ++i) {
        c.named[0][view->pair[i].a] = true;
        c.named[1][view->pair[i].b] = true;
    }
    return c;
}

// Writes a learned coupling of the currents with the entropies of both ends. Without loss only
// variables that change their sign when time runs backwards move those that keep it. The entropy
// that a current carries depends on the latter.
static void write_carried(const pm_draft *d, int port, const coupling *c) {
    const pm_scene_port *scene = &d->p->scene->port[port];
    pm_draft_list l = {.file = d->file};
    fprintf(d->file, "      # In the data a current carries entropy from one end to the other.\n");
    for (int list = 0; list < 3; ++list) {
        static const char *const before[] = {
            "      learned: {acts_on: ", "], against: ", "], features: "};
        l = pm_draft_open(d->file, before[list]);
        for (int end = 0; end < 2; ++end) {
            const pm_part_view *part = &d->part[scene->subsystem[end]];
            for (int g = 0; g < part->count; ++g) {
                const pm_group *group = part->group[g].group;
                const bool heats = port_heats(d, port, end, group);
                const bool coupled = c->current[end][g] || c->named[end][g] || heats;
                const bool shows = list == 2 && pm_layout_find(shown(d, port, end), group->name) &&
                                   !part->group[g].constant;
                if ((coupled || shows) && part->odd[g] == (list == 0)) {
                    pm_draft_add(&l, ends[end], group->name);
                }
            }
        }
    }
    fprintf(d->file, "], hidden: [%d], skip: linear}\n", CARRIED_WIDTH);
}

// Keeps the coefficients of pairs that are to be given, and sets the others to 0. Given are those
// that the data show, or else the guessed ones if nothing else is to be learned. Returns true if
// any is left.
static bool choose_given(pm_port_view *view, bool carries) {
    bool given = false, all = !carries;
    for (int i = 0; i < view->count; ++i) {
        given = given || (view->pair[i].coefficient != 0 && !view->pair[i].guessed);
        all = all && view->pair[i].coefficient != 0;
    }
    for (int i = 0; i < view->count; ++i) {
        pm_pair_view *pair = &view->pair[i];
        if (pair->guessed && (given || !all)) {
            *pair = (pm_pair_view){.a = pair->a, .b = pair->b};
        }
    }
    return given || (all && view->count > 0);
}

// Writes the reversible operator of a port between two subsystems, or of one with a boundary input.
static void write_reversible(const pm_draft *d, int port) {
    FILE *f = d->file;
    const pm_scene_port *scene = &d->p->scene->port[port];
    if (scene->subsystem[0] < 0 || scene->subsystem[1] < 0) {
        write_boundary_input_pairs(d, port);
        return;
    }
    pm_port_view view;
    pm_view_port(&d->look, d->part, port, &view);
    const bool given = choose_given(&view, carries_entropy(d, port));
    const coupling c = find_coupling(d, port, &view, given);
    if (view.count == 0 && !c.carries) {
        fprintf(f,
                "    # No variable of one end moves a variable of the other end without loss.\n");
        return;
    }
    const pm_part_view *a = &d->part[scene->subsystem[0]], *b = &d->part[scene->subsystem[1]];
    if (given) {
        write_levers(f, &view);
    }
    fprintf(f, "    reversible:\n");
    if (given) {
        write_given_pairs(f, a, b, &view);
    }
    if (c.carries) {
        write_carried(d, port, &c);
    } else if (!given) {
        fprintf(f, "      # In the data, rates of one end follow variables of the other end. The "
                   "strength is learned.\n");
        write_named_groups(f, "      learned: {acts_on: ", a, 0, &view);
        write_named_groups(f, "], against: ", b, 1, &view);
        fprintf(f, "]}\n");
    }
}

// Returns true if the dissipation of a port may act on this group of one end.
static bool port_may_lose(const pm_draft *d, int port, int end, const pm_group *group) {
    const int id = d->p->scene->port[port].subsystem[end];
    for (int g = 0; id >= 0 && g < d->part[id].count; ++g) {
        if (strcmp(pm_draft_name(&d->part[id], g), group->name) == 0) {
            return pm_draft_may_lose(&d->part[id], g);
        }
    }
    return !is_entropy_unit(group) && has_coentropy(d, port, end, group);
}

// Writes the strengths of the processes, or in the form soft their factors, as functions of what
// both ends expose. A boundary input is no feature.
static void write_strength(const pm_draft *d, int port) {
    const pm_scene_port *scene = &d->p->scene->port[port];
    int odd = 0;
    for (int end = 0; end < 2; ++end) {
        odd += scene->subsystem[end] < 0
                   ? 0
                   : pm_draft_count_odd(&d->part[scene->subsystem[end]], shown(d, port, end));
    }
    pm_draft_list l = pm_draft_open_strength(d);
    for (int end = 0; end < 2; ++end) {
        if (scene->subsystem[end] >= 0) {
            pm_draft_add_features(d, &l, &d->part[scene->subsystem[end]], ends[end],
                                  shown(d, port, end), d->p->form == PM_HARD && odd == 1);
        }
    }
    pm_draft_close_strength(d);
}

static void write_port_irreversible(const pm_draft *d, int port) {
    FILE *f = d->file;
    int lossy[2] = {0}, heats = 0;
    for (int end = 0; end < 2; ++end) {
        const pm_layout *layout = shown(d, port, end);
        for (int g = 0; g < layout->ngroup; ++g) {
            heats += port_heats(d, port, end, &layout->group[g]) ? layout->group[g].size : 0;
            lossy[end] +=
                port_may_lose(d, port, end, &layout->group[g]) ? layout->group[g].size : 0;
        }
    }
    // The port gets as many irreversible processes as it has variables: with the smallest
    // sufficient number, fits end in poor minima.
    const int both = lossy[0] + lossy[1];
    const int rank = both + (heats > 1 ? heats - 1 : 0);
    if (heats == 0 || rank == 0) {
        fprintf(f, "    # No heat passes through this port, since it exposes no entropy.\n");
        return;
    }
    pm_draft_list l = pm_draft_open(f, "    irreversible: {learned: {acts_on: ");
    for (int pass = 0; pass < 2; ++pass) {
        for (int end = 0; end < 2; ++end) {
            const pm_layout *layout = shown(d, port, end);
            for (int g = 0; g < layout->ngroup; ++g) {
                if (pass == 0 ? port_may_lose(d, port, end, &layout->group[g])
                              : port_heats(d, port, end, &layout->group[g])) {
                    pm_draft_add(&l, ends[end], layout->group[g].name);
                }
            }
        }
    }
    fprintf(f, "], rank: %d", rank);
    if (both == 0 && d->p->form == PM_HARD) {
        l = pm_draft_open(f, ", features: ");
        for (int end = 0; end < 2; ++end) {
            const pm_layout *layout = shown(d, port, end);
            for (int g = 0; g < layout->ngroup; ++g) {
                // A boundary input has a temperature, and no entropy that could be a feature.
                if (d->p->scene->port[port].subsystem[end] >= 0 &&
                    port_heats(d, port, end, &layout->group[g])) {
                    pm_draft_add(&l, ends[end], layout->group[g].name);
                }
            }
        }
        fprintf(f, "], hidden: [4]");
    } else {
        write_strength(d, port);
    }
    fprintf(f, "}}   # %s%s\n", both > 0 ? "friction between the ends" : "",
            heats < 2  ? ""
            : both > 0 ? ", and heat"
                       : "heat; the conductance may vary with the entropies");
}

static void write_exchange(const pm_draft *d, int port) {
    static const char *const name[2] = {"own.", "other."};
    pm_draft_list l = pm_draft_open(d->file, "    form: free\n    rate: {features: ");
    for (int end = 0; end < 2; ++end) {
        const pm_layout *layout = shown(d, port, end);
        for (int g = 0; g < layout->ngroup; ++g) {
            pm_draft_add(&l, name[end], layout->group[g].name);
        }
    }
    fprintf(d->file, "], hidden: [%d], skip: linear}\n", 2 * d->width);
}

void pm_draft_port(const pm_draft *d, int port) {
    fprintf(d->file, "  %s:\n    law: %s\n", d->p->scene->port[port].name,
            d->p->form == PM_FREE ? "exchange" : "bracket");
    if (d->p->form != PM_FREE) {
        fprintf(d->file, d->p->form == PM_SOFT ? "    form: soft\n" : "");
        write_reversible(d, port);
        write_port_irreversible(d, port);
    } else {
        write_exchange(d, port);
    }
}

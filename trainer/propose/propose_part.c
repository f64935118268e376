// Writes the model of a subsystem in a proposed training file: comments on its variables, energy,
// entropy and both operators.
#include "propose/propose_draft.h"

const char *pm_draft_name(const pm_part_view *v, int g) {
    return v->group[g].group->name;
}

static bool is_state(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY;
}

// --- lists ---

typedef struct list {
    FILE *file;
    int count;
} list;

pm_draft_list pm_draft_open(FILE *file, const char *before) {
    fprintf(file, "%s[", before);
    return (pm_draft_list){.file = file};
}

void pm_draft_add(pm_draft_list *l, const char *before, const char *name) {
    fprintf(l->file, "%s%s%s", l->count++ > 0 ? ", " : "", before, name);
}

static void add_quoted(pm_draft_list *l, const char *before, const char *name, const char *after) {
    fprintf(l->file, "%s\"%s%s%s\"", l->count++ > 0 ? ", " : "", before, name, after);
}

// --- comments ---

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
            fprintf(f, "; an angular momentum of three components: L = m x");
            break;
        default:
            break;
        }
        fprintf(f, "%s", v->gyroscopic[g] ? "; its components move each other" : "");
        fprintf(f, "%s%s\n",
                v->geometric[g] && v->kind[g] != PM_VIEW_POSITION
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
static void add_feature(const pm_draft *d, pm_draft_list *l, const pm_part_view *v, int g) {
    const pm_unit volume = pm_unit_parse("m^3");
    const bool length = d->rotates && v->group[g].group->size > 1 && v->mate[g] >= 0;
    if (length || (v->group[g].positive && pm_unit_equal(&v->unit[g], &volume))) {
        add_quoted(l, length && v->group[g].zero ? "|" : "ln|", pm_draft_name(v, g), "|");
    } else {
        pm_draft_add(l, "", pm_draft_name(v, g));
    }
}

// Returns the hidden layers for a number of inputs. Networks that are too large train slowly.
static const char *hidden_of(int inputs) {
    return inputs == 1 ? "[8, 8]" : inputs <= 3 ? "[12, 12]" : "[16, 16]";
}

// Writes the terms of the energy that depend on one group alone, and marks these groups in done
// [count].
static void write_apart(const pm_draft *d, const pm_part_view *v, bool *done) {
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] == PM_VIEW_SPIN) { // rotation alone does not warm a body
            done[g] = true;
            fprintf(d->file, "      - {features: [%s], hidden: [8], skip: quadratic}\n",
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
            fprintf(d->file, "      - {features: [%s], hidden: %s, skip: quadratic}\n",
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

// Writes the thermal energy of one entropy, and its dependence on the rest of the state.
static void write_heat(const pm_draft *d, const pm_part_view *v, int entropy, const bool *done) {
    pm_draft_list l = pm_draft_open(d->file, "      - {features: ");
    for (int g = 0; g < v->count; ++g) {
        if (is_state(v, g) && !done[g]) {
            add_feature(d, &l, v, g);
        }
    }
    const bool coupled = l.count > 0;
    pm_draft_add(&l, "", pm_draft_name(v, entropy));
    fprintf(d->file, coupled ? "], skip: quadratic}   # heat, and its dependence on the rest: "
                               "temperatures are positive\n"
                             : "]}   # heat: temperatures are positive by construction\n");
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
                add_feature(d, &l, v, g);
                inputs += d->rotates && v->mate[g] >= 0 ? 1 : v->group[g].group->size;
            }
        }
        fprintf(f, "], hidden: %s, skip: quadratic}\n", hidden_of(inputs));
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

static void write_entropy(const pm_draft *d, const pm_part_view *v) {
    if (v->nentropy > 0) {
        pm_draft_list l = pm_draft_open(d->file, "    entropy: {given: ");
        add_entropies(&l, v, false);
        fprintf(d->file, "]}\n");
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

// --- operators of parts ---

// Whether the lossless coupling of this group with others, or among its components, is learned.
static bool is_coupled(const pm_part_view *v, int g) {
    return (v->kind[g] == PM_VIEW_OTHER && !v->group[g].constant) || v->gyroscopic[g];
}

static void write_reversible(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    int given = 0, others = 0;
    for (int g = 0; g < v->count; ++g) {
        const char *name = pm_draft_name(v, g), *before = given > 0 ? ", " : "given: [";
        if (given == 0 && (v->kind[g] == PM_VIEW_POSITION || v->kind[g] == PM_VIEW_SPIN)) {
            fprintf(f, "    reversible:\n      ");
        }
        if (v->kind[g] == PM_VIEW_POSITION) {
            fprintf(f, "%s[%s, %s, %.1f]", before, name, pm_draft_name(v, v->mate[g]), v->sign[g]);
            ++given;
        } else if (v->kind[g] == PM_VIEW_SPIN) {
            fprintf(f, "%s[%s, %s, cross]", before, name, name);
            ++given;
        }
        others += is_coupled(v, g) ? v->group[g].group->size : 0;
    }
    fprintf(f, given > 0 ? "]\n" : "");
    if (others < 2) {
        return;
    }
    pm_draft_list l = pm_draft_open(f, given > 0 ? "      learned: {acts_on: "
                                                 : "    reversible:\n      learned: {acts_on: ");
    for (int g = 0; g < v->count; ++g) {
        if (is_coupled(v, g)) {
            pm_draft_add(&l, "", pm_draft_name(v, g));
        }
    }
    fprintf(f, "]}\n");
}

bool pm_draft_may_lose(const pm_part_view *v, int g) {
    return v->kind[g] != PM_VIEW_ENTROPY && !v->geometric[g] && !v->group[g].constant;
}

static void write_irreversible(const pm_draft *d, const pm_part_view *v) {
    int n = 0, heats = 0;
    for (int g = 0; g < v->count; ++g) {
        const bool heat = v->kind[g] == PM_VIEW_ENTROPY && !v->group[g].constant;
        n += pm_draft_may_lose(v, g) ? v->group[g].group->size : 0;
        heats += heat ? v->group[g].group->size : 0;
    }
    const int rank = n + (heats > 1 ? heats - 1 : 0);
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
    fprintf(d->file, "], rank: %d}}", rank);
    fprintf(d->file, "   # one constant for each dissipative process\n");
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
    write_reversible(d, v);
    write_irreversible(d, v);
}

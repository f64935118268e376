// Finds three cases: operators that are absent; operators of the hard form that act on so few
// components that their projection (model/operator.h) leaves nothing; and parts with a bounding
// test.
#include "app/skipped.h"

#include <stdio.h>
#include <string.h>

#include "app/listed.h"
#include "model/given.h"
#include "model/operator.h"
#include "sim/contact_broadphase.h"

// --- operators that do nothing ---

// The state of a part, or what one end of a port exposes, as an operator sees it.
typedef struct side {
    const char *prefix; // of the names of its groups in the operator
    const pm_layout *layout;
    const pm_part *part; // the part whose potentials depend on these groups; NULL: a boundary input
} side;

static bool acts_on(const pm_operator_spec *spec, const char *group) {
    for (int i = 0; i < spec->nacts && spec->learned; ++i) {
        if (strcmp(spec->acts_on[i], group) == 0) {
            return true;
        }
    }
    for (int i = 0; i < spec->nagainst && spec->learned; ++i) {
        if (strcmp(spec->against[i], group) == 0) {
            return true;
        }
    }
    return pm_given_names(spec, group) || pm_is_listed(spec->nheats, spec->heats, group);
}

// Counts the components on which an operator acts. `constrained` tells whether the covector that
// the projection removes, dS of a reversible and dE of an irreversible operator, depends on them.
static int count_components(const pm_operator_spec *spec, pm_operator_kind kind, int nside,
                            const side *sides, bool *constrained) {
    int count = 0;
    *constrained = false;
    for (int i = 0; i < nside; ++i) {
        const pm_part *part = sides[i].part;
        for (int k = 0; k < sides[i].layout->ngroup; ++k) {
            const pm_group *group = &sides[i].layout->group[k];
            char name[PM_MAX_NAME];
            snprintf(name, sizeof name, "%s%s", sides[i].prefix, group->name);
            if (acts_on(spec, name)) {
                count += group->size;
                const pm_potential_spec *normal = part == NULL            ? NULL
                                                  : kind == PM_REVERSIBLE ? &part->spec.entropy
                                                                          : &part->spec.energy;
                *constrained =
                    *constrained || (part == NULL ? kind == PM_IRREVERSIBLE
                                                  : pm_part_depends(part, normal, group->name));
            }
        }
    }
    return count;
}

// Prints an operator that is absent or has no effect; `what` names it, such as "reversible bulk".
static void print_operator(const char *owner, const char *what, const pm_operator_spec *spec,
                           pm_operator_kind kind, pm_form form, int nside, const side *sides) {
    if (!pm_operator_exists(spec)) {
        printf("  %s: %s: none\n", owner, what);
        return;
    }
    bool constrained;
    const int count = count_components(spec, kind, nside, sides, &constrained);
    // The projection removes the direction of the covector; a skew matrix needs two more.
    if (form == PM_HARD && count - constrained < (kind == PM_REVERSIBLE ? 2 : 1)) {
        printf("  %s: %s: does nothing: it acts on %d component%s, and the projection leaves "
               "nothing of it\n",
               owner, what, count, count == 1 ? "" : "s");
    }
}

// --- the list ---

// Prints whether a part has a bounding test (sim/contact_broadphase.h).
static void print_bounding_test(const char *name, const pm_part *part) {
    pm_arena arena = {0};
    pm_contact_broadphase bounding = {0};
    if (pm_contact_broadphase_open(&bounding, &arena, part) != PM_OK) {
        printf("  %s: no bounding test: %s\n", name, pm_error());
    } else if (bounding.unconstrained != NULL) {
        printf("  %s: energy and forces of its %d gaps, while a bounding test says that all are "
               "open\n",
               name, bounding.n);
    }
    pm_contact_broadphase_close(&bounding);
    pm_arena_free(&arena);
}

static void print_part(const char *name, const pm_part *part) {
    if (part->spec.form == PM_FREE) {
        printf("  %s: free: energy and entropy are not defined, and neither law is checked\n",
               name);
        return;
    }
    if (!pm_part_has_entropy(part)) {
        printf("  %s: no entropy: no S, no M, no entropy flux\n", name);
    }
    print_bounding_test(name, part);
    const side state = {"", &part->layout, part};
    print_operator(name, "reversible bulk", &part->spec.reversible, PM_REVERSIBLE, part->spec.form,
                   1, &state);
    print_operator(name, "irreversible bulk", &part->spec.irreversible, PM_IRREVERSIBLE,
                   part->spec.form, 1, &state);
}

static const pm_part *part_at(const pm_system *system, int subsystem_id) {
    return subsystem_id < 0 ? NULL : system->part[subsystem_id];
}

static void print_port(const pm_scene_port *port, const pm_system *system,
                       const pm_port_model *model) {
    const pm_port_spec *spec = &model->spec;
    if (spec->form == PM_FREE || strcmp(spec->law, "contact") == 0) {
        return; // without operators
    }
    const side ends[2] = {
        {"a.", &model->layout[0], part_at(system, port->subsystem[0])},
        {"b.", &model->layout[1], part_at(system, port->subsystem[1])},
    };
    print_operator(port->name, "reversible exchange", &spec->reversible, PM_REVERSIBLE, spec->form,
                   2, ends);
    print_operator(port->name, "irreversible exchange", &spec->irreversible, PM_IRREVERSIBLE,
                   spec->form, 2, ends);
}

void pm_skipped_print(const pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    printf("\nskipped\n");
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (pm_stands_in_list(scene->nsubsystem, setup->system->part_owner, i)) {
            print_part(scene->subsystem[i].name, setup->system->part[i]);
        }
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (pm_stands_in_list(scene->nport, setup->system->port_owner, i)) {
            print_port(&scene->port[i], setup->system, setup->system->port[i]);
        }
    }
    if (setup->reference == NULL) {
        printf("  no reference: no error table, and no states in reports unless --record asks\n");
    }
    printf("  no recorder unless --record names a file\n");
}

// The space of what a training file may lack: for each subsystem and port, and each group that
// exists there, a dependence or an action that its operators do not have. A hypothesis is a change
// of the text of the training file, and of the scene where a port has to expose more.
#include "propose/advice.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/files.h"
#include "base/path.h"
#include "data/trained.h"
#include "propose/search.h"
#include "propose/view.h"
#include "store/yaml.h"

#define ADVISED \
    "# Advised by portmet-train fit" // the first line of advice, which replaces no other file
#define MOST_CHANGES 256
#define MUCH_BETTER 0.5 // what the errors must fall to, so that a hypothesis is named
#define PERCENT 100

// What is lacking. Each is an alternative of a choice, behind "as it is".
typedef enum lack {
    LACKS_NOTHING,
    LACKS_IN_L,          // L depends on the group
    LACKS_FRICTION,      // friction or conduction acts on the group
    LACKS_IN_STRENGTH,   // the strength of friction depends on the group
    LACKS_IN_DIRECTIONS, // the directions of friction depend on the group
    LACKS_ENERGY,        // a term of all variables of the subsystem but entropies
    LACKS_HEAT           // a term of all its variables
} lack;

// A choice about a group of a component; `group` -1: about the whole subsystem.
typedef struct question {
    int component, end, group;
    lack lacks[PM_SEARCH_ALTERNATIVES];
} question;

typedef struct advice {
    const pm_fit *fit;
    pm_arena arena;
    pm_look look;
    pm_part_view *part; // [nsubsystem]
    pm_yaml_document *training_document, *scene_document;
    pm_yaml training, scene;
    pm_hypotheses space;
    question about[PM_SEARCH_CHOICES];
    const char *data, *named; // the dataset of trials, and that of the file that is kept
    pid_t process;            // which writes the file that is kept
} advice;

// --- components ---

// The subsystem at an end of a component, 0 of a subsystem itself; -1: a boundary input.
static int subsystem_at(const advice *a, int component, int end) {
    const pm_physics *physics = &a->fit->training->scene->physics;
    return component < physics->nsubsystem
               ? component
               : physics->port[component - physics->nsubsystem].subsystem[end];
}

static int ends_of(const advice *a, int component) {
    return component < a->fit->training->scene->physics.nsubsystem ? 1 : 2;
}

// Returns the model of a component in the training file, or an absent value.
static pm_yaml model_of(const advice *a, int component) {
    const bool port = ends_of(a, component) == 2;
    const pm_yaml models = pm_yaml_get(a->training, "models");
    const pm_yaml choice = pm_yaml_get(pm_yaml_get(a->training, port ? "ports" : "subsystems"),
                                       pm_trained_name(a->fit->training->system, component));
    for (int i = 0; pm_yaml_exists(choice) && i < pm_yaml_count(models); ++i) {
        pm_yaml key, value;
        const char *name;
        pm_arena arena = {0};
        pm_yaml_entry(models, i, &key, &value);
        const bool same =
            pm_yaml_text(choice, &arena, &name) == PM_OK && pm_yaml_is_text(key, name);
        pm_arena_free(&arena);
        if (same) {
            return value;
        }
    }
    return pm_yaml_get(models, "");
}

// Returns whether the port shows the group; a subsystem shows all of its own.
static bool is_shown(const advice *a, int component, int end, const char *group) {
    const pm_physics *physics = &a->fit->training->scene->physics;
    return component < physics->nsubsystem ||
           pm_layout_find(&physics->port[component - physics->nsubsystem].layout[end], group) !=
               NULL;
}

static bool is_entropy(const pm_part_view *v, int g) {
    return v->kind[g] == PM_VIEW_ENTROPY;
}

// Returns whether a list of names or features of the model has one that names the group.
static bool names_group(pm_yaml list, const char *before, const char *group) {
    static const char word[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.";
    pm_arena arena = {0};
    int count = 0;
    const char **text = NULL;
    bool found = false;
    const char *own = pm_arena_printf(&arena, "%s%s", before, group);
    if (pm_yaml_exists(list) && own != NULL &&
        pm_yaml_texts(list, &arena, &count, &text) == PM_OK) {
        for (int i = 0; i < count; ++i) { // each whole word in a feature is the name of a group
            for (const char *at = text[i]; *at != '\0' && !found;) {
                at += strcspn(at, word);
                const size_t length = strspn(at, word);
                found = length == strlen(own) && strncmp(at, own, length) == 0;
                at += length;
            }
        }
    }
    pm_arena_free(&arena);
    return found;
}

// --- the space ---

static const char *const ends[] = {"a.", "b."};

static const char *before_of(const advice *a, int component, int end) {
    return ends_of(a, component) == 1 ? "" : ends[end];
}

// Adds a choice between "as it is" and what may be lacking.
static void add(advice *a, question q, int count, const char *name) {
    static const char *const words[] = {
        [LACKS_NOTHING] = "as it is",
        [LACKS_IN_L] = "L depends on it",
        [LACKS_FRICTION] = "friction acts on it",
        [LACKS_IN_STRENGTH] = "the strength of friction depends on it",
        [LACKS_IN_DIRECTIONS] = "the directions of friction depend on it",
        [LACKS_ENERGY] = "a term of all variables but entropies",
        [LACKS_HEAT] = "a term of all variables"};
    const pm_physics *physics = &a->fit->training->scene->physics;
    const char *text[PM_SEARCH_ALTERNATIVES];
    for (int i = 0; i < count; ++i) {
        text[i] = words[q.lacks[i]];
    }
    const int id = pm_hypotheses_add(&a->space, name, count, text);
    if (id < 0) {
        return;
    }
    a->about[id] = q;
    // The groups whose rates may change: those of the subsystem, or those that the port shows.
    for (int i = 0, cell = 0; i < physics->nsubsystem; ++i) {
        for (int g = 0; g < physics->subsystem[i].layout.ngroup; ++g, ++cell) {
            for (int end = 0; end < ends_of(a, q.component); ++end) {
                if (subsystem_at(a, q.component, end) == i && cell < PM_FIT_SCORED_GROUPS &&
                    is_shown(a, q.component, end, physics->subsystem[i].layout.group[g].name)) {
                    a->space.choice[id].acts_on |= 1ULL << cell;
                }
            }
        }
    }
}

// Asks what the operators of a component lack about one group.
static void ask_about(advice *a, int component, int end, int g, pm_yaml model) {
    const pm_part_view *v = &a->part[subsystem_at(a, component, end)];
    const char *name = v->group[g].group->name, *before = before_of(a, component, end);
    const char *of = pm_trained_name(a->fit->training->system, component);
    const pm_yaml learned[] = {pm_yaml_get(pm_yaml_get(model, "reversible"), "learned"),
                               pm_yaml_get(pm_yaml_get(model, "irreversible"), "learned")};
    char text[PM_SEARCH_NAME];
    int coupled = 0, heats = 0;
    bool both = true;
    for (int e = 0; e < ends_of(a, component); ++e) {
        const int id = subsystem_at(a, component, e), had = coupled;
        for (int k = 0; id >= 0 && k < a->part[id].count; ++k) {
            const bool shown = is_shown(a, component, e, a->part[id].group[k].group->name);
            coupled += shown && !is_entropy(&a->part[id], k) ? a->part[id].group[k].group->size : 0;
            heats += (shown || (e == end && k == g)) && is_entropy(&a->part[id], k);
        }
        both = both && coupled > had;
    }
    question q = {.component = component, .end = end, .group = g};
    if (!is_entropy(v, g) && both && coupled > 1 &&
        !names_group(pm_yaml_get(learned[0], "features"), before, name)) {
        q.lacks[1] = LACKS_IN_L;
        snprintf(text, sizeof text, "L of %s and %s%s", of, before, name);
        add(a, q, 2, text);
    }
    int count = 1;
    if (heats > 0 && !v->geometric[g] &&
        !names_group(pm_yaml_get(learned[1], "acts_on"), before, name)) {
        q.lacks[count++] = LACKS_FRICTION;
    }
    if (heats > 0 && pm_yaml_exists(learned[1]) &&
        !pm_yaml_is_text(pm_yaml_get(model, "form"), "soft") &&
        !names_group(pm_yaml_get(pm_yaml_get(learned[1], "strength"), "features"), before, name)) {
        q.lacks[count++] = LACKS_IN_STRENGTH;
    }
    if (heats > 0 && pm_yaml_exists(learned[1]) && v->unit[g].known && !v->odd[g] &&
        !is_entropy(v, g) && !names_group(pm_yaml_get(learned[1], "features"), before, name)) {
        q.lacks[count++] = LACKS_IN_DIRECTIONS;
    }
    snprintf(text, sizeof text, "friction of %s and %s%s", of, before, name);
    add(a, q, count, text);
}

static void ask_all(advice *a) {
    const pm_physics *physics = &a->fit->training->scene->physics;
    const int count = physics->nsubsystem + physics->nport;
    for (int component = 0; component < count; ++component) {
        const pm_yaml model = model_of(a, component);
        bool again = !pm_yaml_is_map(model) ||
                     pm_yaml_is_text(pm_yaml_get(model, "form"), "free") ||
                     pm_yaml_exists(pm_yaml_get(model, "solid"));
        for (int c = 0; c < component; ++c) { // components that share a model change together
            again = again || model_of(a, c).node == model.node;
        }
        if (again || (component >= physics->nsubsystem &&
                      strcmp(physics->port[component - physics->nsubsystem].law, "bracket") != 0)) {
            continue;
        }
        for (int end = 0; end < ends_of(a, component); ++end) {
            const int id = subsystem_at(a, component, end);
            for (int g = 0; id >= 0 && g < a->part[id].count; ++g) {
                if (!a->part[id].group[g].constant) {
                    ask_about(a, component, end, g, model);
                }
            }
        }
        if (component < physics->nsubsystem && pm_yaml_exists(pm_yaml_get(model, "energy")) &&
            a->part[component].count > 1) {
            char text[PM_SEARCH_NAME];
            snprintf(text, sizeof text, "energy of %s",
                     pm_trained_name(a->fit->training->system, component));
            add(a,
                (question){.component = component,
                           .group = -1,
                           .lacks = {LACKS_NOTHING, LACKS_ENERGY, LACKS_HEAT}},
                2 + (a->part[component].nentropy > 0), text);
        }
    }
}

// --- changes of the files ---

// The changes of a vector of hypotheses.
typedef struct changes {
    pm_arena *arena;
    int count[2]; // of the training file and of the scene
    pm_yaml_change change[2][MOST_CHANGES];
} changes;

static void change(changes *c, int file, pm_yaml at, bool replaces, const char *text) {
    if (c->count[file] < MOST_CHANGES && text != NULL) {
        c->change[file][c->count[file]++] = (pm_yaml_change){at, replaces, text};
    }
}

// Joins two lists whose items have commas between them. Either may be empty.
static const char *joined(pm_arena *arena, const char *a, const char *b) {
    return pm_arena_printf(arena, "%s%s%s", a, *a != '\0' && *b != '\0' ? ", " : "", b);
}

// Adds an entry to a mapping that may be absent, under a key of another mapping.
static void put(changes *c, pm_yaml map, const char *key, const char *entry) {
    const pm_yaml own = pm_yaml_get(map, key);
    if (pm_yaml_is_map(own)) {
        change(c, 0, own, false, entry);
    } else if (pm_yaml_exists(own)) { // none
        change(c, 0, own, true, pm_arena_printf(c->arena, "{%s}", entry));
    } else {
        change(c, 0, map, false, pm_arena_printf(c->arena, "%s: {%s}", key, entry));
    }
}

// Adds items to a list under a key of a mapping, or to a single item. Returns false if there is
// none.
static bool extend(changes *c, int file, pm_yaml map, const char *key, const char *items) {
    const pm_yaml own = pm_yaml_get(map, key);
    const char *text;
    if (pm_yaml_is_list(own)) {
        change(c, file, own, false, items);
    } else if (pm_yaml_exists(own) && pm_yaml_text(own, c->arena, &text) == PM_OK) {
        change(c, file, own, true, pm_arena_printf(c->arena, "[%s, \"%s\"]", items, text));
    }
    return pm_yaml_exists(own);
}

// Adds features to the network of a learned operator, which may have had none.
static void depend(changes *c, pm_yaml learned, const char *features) {
    if (!extend(c, 0, learned, "features", features)) {
        change(c, 0, learned, false, pm_arena_printf(c->arena, "features: [%s]", features));
        if (!pm_yaml_exists(pm_yaml_get(learned, "skip"))) {
            change(c, 0, learned, false, "skip: quadratic");
        }
    }
}

// Lists the names of those groups of a component, with their end, that are entropies or are not.
// Ends are separated where `end` is 0 or 1; -1: both.
static const char *list_groups(const advice *a, pm_arena *arena, int component, int end,
                               bool entropies) {
    const char *list = "";
    for (int e = 0; e < ends_of(a, component); ++e) {
        const int id = subsystem_at(a, component, e);
        for (int g = 0; id >= 0 && (end < 0 || end == e) && g < a->part[id].count; ++g) {
            const pm_part_view *v = &a->part[id];
            const char *name = v->group[g].group->name;
            if (is_entropy(v, g) == entropies && !v->group[g].constant &&
                is_shown(a, component, e, name)) {
                list = joined(arena, list,
                              pm_arena_printf(arena, "%s%s", before_of(a, component, e), name));
            }
        }
    }
    return list;
}

// What a vector adds to a component, as lists of items.
typedef struct additions {
    const char *features[LACKS_HEAT + 1]; // by what is lacking
    int acts;                             // components on which friction acts, too
} additions;

static void change_model(const advice *a, changes *c, int component, const additions *add,
                         pm_yaml model) {
    pm_arena *arena = c->arena;
    const pm_yaml reversible = pm_yaml_get(model, "reversible");
    const pm_yaml irreversible = pm_yaml_get(model, "irreversible");
    const char *features = add->features[LACKS_IN_L];
    const pm_yaml couples = pm_yaml_get(reversible, "learned");
    if (*features != '\0' && pm_yaml_is_map(couples)) {
        depend(c, couples, features);
    } else if (*features != '\0') {
        const bool port = ends_of(a, component) == 2;
        const char *against = port ? pm_arena_printf(arena, ", against: [%s]",
                                                     list_groups(a, arena, component, 1, false))
                                   : "";
        put(c, model, "reversible",
            pm_arena_printf(arena, "learned: {acts_on: [%s]%s, features: [%s], skip: quadratic}",
                            list_groups(a, arena, component, 0, false), against, features));
    }
    const pm_yaml loses = pm_yaml_get(irreversible, "learned");
    const char *acts = add->features[LACKS_FRICTION];
    if (pm_yaml_is_map(loses)) {
        int rank = 1;
        if (*acts != '\0') {
            const pm_yaml own = pm_yaml_get(loses, "rank");
            const bool has = pm_yaml_exists(own) && pm_yaml_int(own, 1, INT_MAX, &rank) == PM_OK;
            const char *more =
                pm_arena_printf(arena, "%s%d", has ? "" : "rank: ", rank + add->acts);
            extend(c, 0, loses, "acts_on", acts);
            change(c, 0, has ? own : loses, has, more);
        }
        if (*add->features[LACKS_IN_DIRECTIONS] != '\0') {
            depend(c, loses, add->features[LACKS_IN_DIRECTIONS]);
        }
        const char *strength = add->features[LACKS_IN_STRENGTH];
        if (*strength != '\0' &&
            !extend(c, 0, pm_yaml_get(loses, "strength"), "features", strength)) {
            change(c, 0, loses, false,
                   pm_arena_printf(arena, "strength: {features: [%s], hidden: [6]}", strength));
        }
    } else if (*acts != '\0') {
        const char *heats = list_groups(a, arena, component, -1, true);
        put(c, model, "irreversible",
            pm_arena_printf(arena, "learned: {acts_on: [%s], rank: %d}", joined(arena, acts, heats),
                            add->acts));
    }
    // A further term of the energy.
    const bool heat = *add->features[LACKS_HEAT] != '\0';
    if (heat || *add->features[LACKS_ENERGY] != '\0') {
        const char *all = list_groups(a, arena, component, -1, false);
        all = heat ? joined(arena, all, list_groups(a, arena, component, -1, true)) : all;
        const char *term =
            pm_arena_printf(arena, "{features: [%s], hidden: [8], skip: quartic}", all);
        const pm_yaml own = pm_yaml_get(model, "energy");
        const char *formula;
        if (pm_yaml_is_list(own)) {
            change(c, 0, own, false, term);
        } else if (!pm_yaml_is_map(own) && pm_yaml_text(own, arena, &formula) == PM_OK) {
            change(c, 0, own, true, pm_arena_printf(arena, "[\"%s\", %s]", formula, term));
        }
    }
}

// Adds what the answer to a question asks for.
static void apply(const advice *a, changes *c, const question *q, lack lacks, additions *to) {
    if (lacks == LACKS_NOTHING) {
        return;
    }
    if (q->group < 0) {
        to->features[lacks] = "all";
        return;
    }
    const pm_physics *physics = &a->fit->training->scene->physics;
    const pm_part_view *v = &a->part[subsystem_at(a, q->component, q->end)];
    const char *name = v->group[q->group].group->name;
    const char *own = pm_arena_printf(c->arena, "%s%s", before_of(a, q->component, q->end), name);
    const bool angle = v->angle[q->group] && lacks != LACKS_FRICTION;
    const bool even = lacks == LACKS_IN_STRENGTH && (v->odd[q->group] || !v->unit[q->group].known);
    to->acts += lacks == LACKS_FRICTION ? v->group[q->group].group->size : 0;
    to->features[lacks] =
        joined(c->arena, to->features[lacks],
               angle  ? pm_arena_printf(c->arena, "\"sin(%s)\", \"cos(%s)\"", own, own)
               : even ? pm_arena_printf(c->arena, "\"|%s|\"", own)
                      : own);
    if (!is_shown(a, q->component, q->end, name)) {
        const pm_scene_port *port = &physics->port[q->component - physics->nsubsystem];
        const pm_yaml at = pm_yaml_get(pm_yaml_get(a->scene, "ports"), port->name);
        extend(c, 1, pm_yaml_get(at, "expose"), port->between[q->end], name);
    }
}

// Writes a file with changes.
static pm_status write_changed(const char *path, const char *comment, pm_yaml root, int count,
                               pm_yaml_change *list) {
    FILE *file;
    PM_TRY(pm_files_create(&file, path, ADVISED));
    fprintf(file, ADVISED ".\n%s", comment);
    pm_yaml_write_changed(root.document, count, list, file);
    const bool failed = ferror(file) != 0;
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

// Writes the training file of a vector (propose/search.h). `context` is the advice.
static pm_status write_vector(void *context, const int *chosen, const char *comment,
                              const char *path) {
    const advice *a = context;
    const pm_training *t = a->fit->training;
    const pm_split *split = &a->fit->split;
    pm_arena arena = {0};
    changes *c = calloc(1, sizeof *c);
    pm_status status = c == NULL ? pm_fail(PM_ENOMEM, "out of memory for a hypothesis") : PM_OK;
    for (int component = 0; status == PM_OK && component < a->look.scene->physics.nsubsystem +
                                                               a->look.scene->physics.nport;
         ++component) {
        additions to = {.features = {"", "", "", "", "", "", ""}};
        bool any = false;
        c->arena = &arena;
        for (int i = 0; i < a->space.count; ++i) {
            const lack lacks = a->about[i].lacks[chosen[i]];
            if (a->about[i].component == component && lacks != LACKS_NOTHING) {
                apply(a, c, &a->about[i], lacks, &to);
                any = true;
            }
        }
        if (any) {
            change_model(a, c, component, &to, model_of(a, component));
        }
    }
    if (status == PM_OK) {
        const char *scene = t->scene->path;
        char seen[PATH_MAX];
        if (c->count[1] > 0) {
            scene = pm_arena_printf(&arena, "%.*s_scene.yaml", (int)pm_path_stem(path), path);
            const pm_yaml file = pm_yaml_get(pm_yaml_get(a->scene, "reference"), "file");
            if (pm_yaml_exists(file)) {
                change(c, 1, file, true,
                       pm_arena_printf(&arena, "\"%s\"",
                                       pm_path_seen_from(path, t->scene->run.reference, seen)));
            }
            status = pm_arena_status(&arena, "a hypothesis");
            status = status == PM_OK ? write_changed(scene, "", a->scene, c->count[1], c->change[1])
                                     : status;
        }
        const char *data = getpid() == a->process ? a->named : a->data;
        change(c, 0, pm_yaml_get(a->training, "scene"), true,
               pm_arena_printf(&arena, "\"%s\"", pm_path_seen_from(path, scene, seen)));
        if (t->from != NULL) { // weights of these models, which are not those of others
            change(c, 0, pm_yaml_get(a->training, "start"), true,
                   pm_arena_printf(&arena, "{tries: %d, iterations: %d}", t->tries,
                                   t->try_iterations));
        }
        const pm_yaml block = pm_yaml_get(a->training, "data");
        const char *named =
            pm_arena_printf(&arena, "{file: \"%s\", trajectories: \"%s\", validation: \"%s\"}",
                            pm_path_seen_from(path, data, seen), split->training,
                            split->nvalidation > 0 ? split->validation : "none");
        if (pm_yaml_exists(block)) {
            change(c, 0, block, true, named);
        } else {
            change(c, 0, a->training, false, pm_arena_printf(&arena, "data: %s", named));
        }
        status = status == PM_OK ? pm_arena_status(&arena, "a hypothesis") : status;
        status = status == PM_OK
                     ? write_changed(path, comment, a->training, c->count[0], c->change[0])
                     : status;
    }
    pm_arena_free(&arena);
    free(c);
    return status;
}

// --- the whole ---

// Writes what was lacking, and the error of one step of the group that gains most.
static void print_outcome(const advice *a, const pm_search_outcome *o, const char *path,
                          FILE *out) {
    static const char *const what[] = {
        [LACKS_IN_L] = "L of `%s` depends on ",
        [LACKS_FRICTION] = "friction of `%s` acts on ",
        [LACKS_IN_STRENGTH] = "the strength of friction of `%s` depends on ",
        [LACKS_IN_DIRECTIONS] = "the directions of friction of `%s` depend on ",
        [LACKS_ENERGY] = "the energy of `%s` has a term of all its variables but entropies",
        [LACKS_HEAT] = "the energy of `%s` has a term of all its variables"};
    const pm_physics *physics = &a->fit->training->scene->physics;
    int count = 0, best = -1;
    fprintf(out, "Tried by short fits: ");
    for (int i = 0; i < a->space.count; ++i) {
        const question *q = &a->about[i];
        const lack lacks = q->lacks[o->chosen[i]];
        if (lacks == LACKS_NOTHING) {
            continue;
        }
        const char *of = pm_trained_name(a->fit->training->system, q->component);
        const int id = subsystem_at(a, q->component, q->end);
        const char *group = q->group < 0 ? "" : a->part[id].group[q->group].group->name;
        const char *owner = ends_of(a, q->component) == 2 ? physics->subsystem[id].name : NULL;
        fprintf(out, "%s", count++ > 0 ? "; " : "");
        if (q->group >= 0 && !is_shown(a, q->component, q->end, group)) {
            fprintf(out, "`expose` lacks %s of `%s` at `%s`: ", group, owner, of);
        }
        fprintf(out, what[lacks], of);
        fprintf(out, owner == NULL ? "%s" : "%s of `%s`", group, owner);
    }
    fprintf(out, ": with %s ", count > 1 ? "them" : "it");
    if (o->first.failed) {
        fprintf(out, "the short fit succeeds, which fails without (%s)", o->first.reason);
    }
    for (int g = 0; g < PM_FIT_SCORED_GROUPS && !o->first.failed; ++g) {
        const double *before = o->first.score.group, *after = o->best.score.group;
        best =
            before[g] > after[g] && (best < 0 || before[g] * after[best] > before[best] * after[g])
                ? g
                : best;
    }
    for (int i = 0, cell = 0; i < physics->nsubsystem; ++i) {
        const pm_layout *layout = &physics->subsystem[i].layout;
        for (int g = 0; g < layout->ngroup; ++g, ++cell) {
            if (cell == best) {
                fprintf(out, "the error of one step of %s of `%s` falls from %.3g to %.3g %%, and ",
                        layout->group[g].name, physics->subsystem[i].name,
                        PERCENT * o->first.score.group[best], PERCENT * o->best.score.group[best]);
            }
        }
    }
    if (!o->first.failed) {
        fprintf(out, "that of rollouts falls from %.3g to %.3g %% of persistence",
                PERCENT * o->first.score.rollout, PERCENT * o->best.score.rollout);
    }
    fprintf(out, ". %s has the change.\n", path);
}

pm_status pm_advise_check(const char *path) {
    char scene[PATH_MAX];
    snprintf(scene, sizeof scene, "%.*s_scene.yaml", (int)pm_path_stem(path), path);
    PM_TRY(pm_files_check_output(path, ADVISED));
    return pm_files_check_output(scene, ADVISED);
}

pm_status pm_advise(const pm_fit *fit, double budget, const volatile sig_atomic_t *stop,
                    const char *path, FILE *out) {
    const pm_training *t = fit->training;
    const pm_search_how how = {.budget = budget, .most = budget, .stop = stop};
    advice *a = calloc(1, sizeof *a);
    char scene[PATH_MAX];
    pm_status status;
    bool looked = false;
    PM_TRY_DONE(a == NULL ? pm_fail(PM_ENOMEM, "out of memory for advice") : PM_OK);
    PM_TRY_DONE(pm_advise_check(path)); // what is left of an earlier fit may be removed
    PM_TRY_DONE(pm_look_make(&a->look, t->scene, fit->dataset));
    looked = true;
    a->fit = fit;
    a->data = fit->data;
    // The data of the command line may be a table; fit->data is then the dataset made from it.
    a->named = t->data == NULL ? fit->data : t->data;
    a->process = getpid();
    a->space.write = write_vector;
    a->space.context = a;
    a->part = pm_arena_array(&a->arena, (size_t)t->scene->physics.nsubsystem, sizeof *a->part);
    PM_TRY_DONE(pm_arena_status(&a->arena, "advice"));
    PM_TRY_DONE(pm_yaml_open(&a->training_document, fit->arguments->config, &a->training));
    PM_TRY_DONE(pm_yaml_open(&a->scene_document, t->scene->path, &a->scene));
    (void)pm_view_parts(&a->look, a->part);
    ask_all(a);
    if (a->space.count == 0) {
        goto done;
    }
    pm_search_outcome o;
    PM_TRY_DONE(pm_search_run(&a->space, &how, path, &o));
    const pm_fit_score *before = &o.first.score, *after = &o.best.score;
    if (!o.best.failed && (o.first.failed || (after->rollout < MUCH_BETTER * before->rollout &&
                                              !(after->step >= MUCH_BETTER * before->step)))) {
        print_outcome(a, &o, path, out);
        goto done;
    }
    if (o.ntried <= 1) {
        fprintf(out, "A short fit of the same models is good on the validation part, so that "
                     "nothing that they may lack was tried.\n");
    } else {
        fprintf(out,
                "None of %d hypothes%s about what the models and ports may lack halves the error "
                "of a short fit.\n",
                o.ntried - 1, o.ntried == 2 ? "is" : "es");
    }
    snprintf(scene, sizeof scene, "%.*s_scene.yaml", (int)pm_path_stem(path), path);
    (void)remove(path);
    (void)remove(scene);
done:
    if (a != NULL) {
        pm_yaml_close(a->training_document);
        pm_yaml_close(a->scene_document);
        pm_arena_free(&a->arena);
    }
    if (looked) {
        pm_look_free(&a->look);
    }
    free(a);
    return status;
}

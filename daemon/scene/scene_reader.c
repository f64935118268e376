// Reads a scene file, section by section: plain settings, subsystems, boundary inputs and ports.
// The section `subsystems` comes before those that refer to it, and what a group is measured from
// (relative_to) after all subsystems. Other files read `live_inputs` and `processes`.
#include "scene/scene_reader.h"

#include <ctype.h>
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "model/port.h"
#include "scene/component.h"
#include "store/hdf5_io.h"

#define MAX_COMPONENTS 1000000 // of one group
#define MAX_STEPS 1000000000
#define MAX_SUBSTEPS 100000
#define MAX_WINDOW 1000000
#define MAX_PATIENCE 1e6       // s
#define MAX_ESTIMATE 1e9       // s
#define LARGEST_RESIDUAL 1e-12 // relative, of a law of a hard port, where the scene says nothing
#define DEFAULT_PATIENCE 10    // s
#define DEFAULT_CHECKPOINT 100 // steps
#define MAX_SYSTEM 80          // characters of the name of a system
#define MAX_MESSAGE 512        // characters of a list in a message
#define MOST_VISITS 10000000   // of ends of ports, to find the farthest two subsystems

// Reads a path and resolves it against the folder of the scene file.
static pm_status read_path(pm_scene_reader *r, pm_yaml at, const char **path) {
    PM_TRY(pm_yaml_text(at, r->arena, path));
    const char *slash = strrchr(r->scene->path, '/');
    if (**path != '/' && slash != NULL) {
        const int folder = (int)(slash - r->scene->path) + 1;
        *path = pm_arena_printf(r->arena, "%.*s%s", folder, r->scene->path, *path);
    }
    return pm_scene_check_memory(r);
}

// --- plain settings ---

static pm_status read_network(pm_scene_reader *r) {
    pm_network *network = &r->scene->network;
    const pm_yaml url = pm_yaml_get(r->root, "url"), tap = pm_yaml_get(r->root, "tap");
    const pm_yaml key_file = pm_yaml_get(r->root, "key_file");
    if (pm_yaml_exists(url)) {
        PM_TRY(pm_yaml_text(url, r->arena, &network->url));
        network->url_at = pm_yaml_where(url, r->arena);
    }
    PM_TRY(pm_yaml_exists(tap) ? pm_yaml_texts(tap, r->arena, &network->ntap, &network->tap)
                               : PM_OK);
    if (pm_yaml_exists(key_file)) {
        PM_TRY(read_path(r, key_file, &network->key_file));
        network->key_file_at = pm_yaml_where(key_file, r->arena);
    }
    network->window = 1;
    network->patience = DEFAULT_PATIENCE;
    network->checkpoint = DEFAULT_CHECKPOINT;
    const pm_yaml_key keys[] = {
        {PM_YAML_INT("window", &network->window, 1, MAX_WINDOW)},
        {PM_YAML_DOUBLE("patience", &network->patience, DBL_MIN, MAX_PATIENCE)},
        {PM_YAML_INT("checkpoint", &network->checkpoint, 1, MAX_STEPS)},
        {0}};
    return pm_yaml_read(pm_yaml_get(r->root, "lockstep"), r->arena, keys);
}

static pm_status read_time(pm_scene_reader *r) {
    pm_physics *physics = &r->scene->physics;
    pm_run *run = &r->scene->run;
    pm_yaml time, integrator, tolerance;
    physics->substeps = 1;
    const pm_yaml_key keys[] = {
        {PM_YAML_DOUBLE("dt", &physics->dt, DBL_MIN, INFINITY), .required = true},
        {PM_YAML_INT("steps", &run->steps, 1, MAX_STEPS), .required = true},
        {PM_YAML_VALUE("integrator", &integrator), .required = true},
        {PM_YAML_INT("substeps", &physics->substeps, 1, MAX_SUBSTEPS)},
        {PM_YAML_VALUE("tolerance", &tolerance)},
        {PM_YAML_DOUBLE("pace", &run->pace, DBL_MIN, INFINITY)},
        {0}};
    PM_TRY(pm_yaml_require(r->root, "time", &time));
    PM_TRY(pm_yaml_read(time, r->arena, keys));
    const char *name = NULL;
    PM_TRY(pm_yaml_text(integrator, r->arena, &name));
    physics->integrator_at = pm_yaml_where(integrator, r->arena);
    physics->integrator = pm_integrator_find(name);
    if (physics->integrator == NULL) {
        return pm_yaml_fail(integrator, "expected one of %s, found \"%.64s\"",
                            pm_integrator_names(), name);
    }
    PM_TRY(pm_yaml_exists(tolerance) ? pm_yaml_double(tolerance, DBL_MIN, 1, &physics->tolerance)
                                     : PM_OK);
    return pm_physics_is_adaptive(physics) && r->scene->network.window > 1
               ? pm_yaml_fail(tolerance, "each step tells how long the next one's substeps are: "
                                         "expected a lockstep window of 1")
               : PM_OK;
}

static pm_status record(pm_scene_reader *r, pm_yaml at, int id, int number) {
    (void)at, (void)number;
    r->scene->run.recorded[id] = true;
    return PM_OK;
}

static pm_status read_run(pm_scene_reader *r) {
    pm_run *run = &r->scene->run;
    run->energy_tolerance = run->entropy_tolerance = LARGEST_RESIDUAL;
    run->largest_drift = run->largest_departure = INFINITY;
    const pm_yaml_key law_keys[] = {
        {PM_YAML_DOUBLE("energy", &run->energy_tolerance, 0, INFINITY)},
        {PM_YAML_DOUBLE("entropy", &run->entropy_tolerance, 0, INFINITY)},
        {0}};
    const pm_yaml_key guard_keys[] = {
        {PM_YAML_DOUBLE("energy_drift", &run->largest_drift, DBL_MIN, INFINITY)},
        {PM_YAML_DOUBLE("training_range", &run->largest_departure, 0, INFINITY)},
        {0}};
    pm_yaml file, trajectory;
    const pm_yaml reference = pm_yaml_get(r->root, "reference");
    const pm_yaml_key reference_keys[] = {
        {PM_YAML_VALUE("file", &file), .required = true},
        {PM_YAML_VALUE("trajectory", &trajectory)},
        {PM_YAML_DOUBLE("estimate", &run->reference_estimate, DBL_MIN, MAX_ESTIMATE)},
        {0}};
    PM_TRY(pm_yaml_read(pm_yaml_get(r->root, "laws"), r->arena, law_keys));
    PM_TRY(pm_yaml_read(pm_yaml_get(r->root, "guards"), r->arena, guard_keys));
    if (pm_yaml_exists(reference)) {
        PM_TRY(pm_yaml_read(reference, r->arena, reference_keys));
        PM_TRY(read_path(r, file, &run->reference));
        pm_files_note_input(run->reference); // many programs do not open it
        run->reference_at = pm_yaml_where(file, r->arena);
        const bool named = pm_yaml_exists(trajectory);
        run->reference_trajectory_at = pm_yaml_where(named ? trajectory : reference, r->arena);
        PM_TRY(named ? pm_yaml_int(trajectory, 0, MAX_STEPS, &run->reference_trajectory) : PM_OK);
    }

    // Which subsystems a recording keeps, and how often; an empty list records the totals alone.
    static const char *const choices[] = {"stop", "go_on", NULL};
    pm_yaml parts;
    int choice = 0;
    run->record_every = 1;
    const pm_yaml_key record_keys[] = {{PM_YAML_CHOICE("on_error", &choice, choices)},
                                       {PM_YAML_VALUE("parts", &parts)},
                                       {PM_YAML_INT("every", &run->record_every, 1, MAX_STEPS)},
                                       {0}};
    PM_TRY(pm_yaml_read(pm_yaml_get(r->root, "record"), r->arena, record_keys));
    run->outlives_recording = choice == 1;
    if (pm_yaml_exists(parts)) {
        run->recorded =
            pm_arena_array(r->arena, (size_t)r->scene->physics.nsubsystem, sizeof *run->recorded);
        PM_TRY(pm_scene_check_memory(r));
        PM_TRY(pm_scene_visit_members(r, parts, record, 0));
    }

    // The columns of measurements that are functions of the state.
    const pm_yaml observations = pm_yaml_get(r->root, "observations");
    if (!pm_yaml_exists(observations)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(observations));
    const int count = pm_yaml_count(observations);
    pm_scene_observation *o = pm_arena_array(r->arena, (size_t)count, sizeof *o);
    PM_TRY(pm_scene_check_memory(r));
    run->observation = o;
    run->nobservation = count;
    for (int i = 0; i < count; ++i) {
        pm_yaml key, value;
        pm_yaml_entry(observations, i, &key, &value);
        PM_TRY(pm_yaml_text(key, r->arena, &o[i].column));
        PM_TRY(pm_yaml_text(value, r->arena, &o[i].formula.text));
        o[i].formula.at = pm_yaml_where(value, r->arena);
    }
    return PM_OK;
}

// --- components: subsystems or ports ---

// The entries of a mapping whose keys are names or ranges.
typedef struct entries {
    pm_yaml map;
    int count;             // entries
    pm_scene_range *range; // [count]
    int *first;            // [count] position of the entry's first component among all
    int total;             // components of all entries
} entries;

// Parses the keys of a mapping.
static pm_status read_entries(pm_scene_reader *r, pm_yaml map, entries *e) {
    PM_TRY(pm_yaml_require_entries(map));
    const int count = pm_yaml_count(map);
    *e = (entries){
        .map = map,
        .count = count,
        .range = pm_arena_array(r->arena, (size_t)count, sizeof *e->range),
        .first = pm_arena_array(r->arena, (size_t)count, sizeof *e->first),
    };
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < count; ++i) {
        pm_yaml key, block;
        const char *text;
        pm_yaml_entry(map, i, &key, &block);
        PM_TRY(pm_yaml_text(key, r->arena, &text));
        PM_TRY(pm_scene_parse_range(r, key, text, &e->range[i]));
        e->first[i] = e->total;
        if (e->range[i].total > PM_SCENE_MOST_COMPONENTS - e->total) {
            return pm_yaml_fail(key, "more than %d components in all", PM_SCENE_MOST_COMPONENTS);
        }
        e->total += e->range[i].total;
    }
    return PM_OK;
}

// Returns the entry to which a component belongs.
static int entry_of(const entries *e, int component) {
    int low = 0, high = e->count;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (e->first[middle] <= component) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

// Makes component number `id` of all entries the one that is being read, and reads its name. `key`
// and `block` receive its entry, and `range` the key if it is a range, or NULL. Returns through
// `first` the first component of the same entry.
static pm_status enter_entry(pm_scene_reader *r, const entries *e, int id, pm_yaml *key,
                             pm_yaml *block, const char **name, const char **range, int *first) {
    const int i = entry_of(e, id);
    *first = e->first[i];
    *range = e->range[i].naxis == 0 ? NULL : e->range[i].key;
    pm_yaml_entry(e->map, i, key, block);
    pm_scene_enter(r, &e->range[i], id - *first);
    PM_TRY(pm_scene_expand(r, *key, e->range[i].pattern, name));
    return pm_scene_check_name(*key, *name);
}

// Sorts the names of all components, name [e->total], and refuses a name that occurs twice.
static pm_status sort_names(pm_scene_reader *r, const entries *e, const char *const *name,
                            pm_names *names) {
    PM_TRY(pm_names_sort(names, name, e->total, r->arena));
    const int twice = pm_names_twice(names);
    if (twice < 0) {
        return PM_OK;
    }
    pm_yaml key, block;
    pm_yaml_entry(e->map, entry_of(e, twice), &key, &block);
    return pm_yaml_fail(key, "the name \"%s\" occurs twice", name[twice]);
}

// Reads the source of a component's model: a weights file, or a known model of the section
// `models`, which several components may use, each with constants of its own.
static pm_status read_maker(pm_scene_reader *r, pm_yaml block, const char **weights,
                            const char **at, pm_component *known) {
    const pm_yaml file = pm_yaml_get(block, "weights"), model = pm_yaml_get(block, "model");
    const pm_yaml constants = pm_yaml_get(block, "constants");
    if (pm_yaml_exists(file) == pm_yaml_exists(model)) {
        return pm_yaml_fail(block, "expected either \"weights\", a file, or \"model\", a name");
    }
    *at = pm_yaml_where(pm_yaml_exists(file) ? file : model, r->arena);
    if (pm_yaml_exists(file)) {
        known->spec = NULL;
        return pm_yaml_exists(constants) ? pm_yaml_fail(constants, "only a model has constants")
                                         : read_path(r, file, weights);
    }
    const char *name;
    PM_TRY(pm_yaml_text(model, r->arena, &name));
    const pm_yaml made_by = pm_yaml_get(pm_yaml_get(r->root, "models"), name);
    if (!pm_yaml_exists(made_by)) {
        return pm_yaml_fail(model, "there is no model \"%.64s\" under models", name);
    }
    known->spec = pm_arena_alloc(r->arena, known->kind->spec_size);
    PM_TRY(pm_scene_check_memory(r));
    return known->kind->read_spec(made_by, constants, r->arena, known->spec);
}

// Writes the names of groups as "a, b, c" to the buffer, for messages.
static const char *group_names(const pm_layout *layout, char *buffer, size_t size) {
    size_t used = 0;
    for (int i = 0; i < layout->ngroup && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ",
                                 layout->group[i].name);
    }
    return buffer;
}

// --- columns of groups ---

// Concatenates the groups' columns to those of the state.
static pm_status join_columns(pm_scene_reader *r, pm_scene_subsystem *subsystem,
                              pm_scene_named *const *columns) {
    const pm_layout *layout = &subsystem->layout;
    const char **column = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *column);
    const char **at = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *at);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const pm_scene_named *list = columns[i];
        for (int j = 0; j < group->size; ++j) { // the columns of one range share their place
            column[group->first + j] = list[j].text;
            at[group->first + j] = j > 0 && list[j].at.node == list[j - 1].at.node
                                       ? at[group->first + j - 1]
                                       : pm_yaml_where(list[j].at, r->arena);
        }
    }
    subsystem->column = column;
    subsystem->column_at = at;
    return PM_OK;
}

// --- one subsystem ---

// Reads the key `hidden` of the last group of the layout. A hidden group that names no columns gets
// columns named "subsystem.group" (or "subsystem.group_0", ...).
static pm_status read_hidden(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml block,
                             pm_yaml hidden, pm_scene_named **columns) {
    const int id = subsystem->layout.ngroup - 1;
    const pm_group *group = &subsystem->layout.group[id];
    const pm_yaml_key keys[] = {
        {PM_YAML_DOUBLE("guess", &subsystem->guess[id], -INFINITY, INFINITY)},
        {PM_YAML_DOUBLE("deviation", &subsystem->deviation[id], DBL_MIN, INFINITY)},
        {0}};
    bool yes = true;
    PM_TRY(pm_yaml_count(hidden) > 0 ? pm_yaml_read(hidden, r->arena, keys)
                                     : pm_yaml_bool(hidden, &yes));
    subsystem->hidden[id] = yes;
    if (*columns != NULL) {
        return PM_OK;
    }
    if (!yes) {
        return pm_yaml_fail(block, "expected \"columns\": the group is not hidden");
    }
    *columns = pm_arena_array(r->arena, (size_t)group->size, sizeof **columns);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < group->size; ++i) {
        (*columns)[i].at = hidden;
        (*columns)[i].text =
            group->size == 1
                ? pm_arena_printf(r->arena, "%s.%s", subsystem->name, group->name)
                : pm_arena_printf(r->arena, "%s.%s_%d", subsystem->name, group->name, i);
    }
    return pm_scene_check_memory(r);
}

// Reads one group of a state; `columns` receives its dataset columns [size], or NULL.
static pm_status read_group(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml key,
                            pm_yaml block, pm_scene_named **columns) {
    const char *name, *unit_text;
    pm_yaml unit, list, size, hidden;
    int count = 1;
    bool coenergy = false;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("unit", &unit), .required = true},
                                {PM_YAML_BOOL("coenergy", &coenergy)},
                                {PM_YAML_VALUE("columns", &list)},
                                {PM_YAML_VALUE("size", &size)},
                                {PM_YAML_VALUE("relative_to", NULL)}, // read_relatives
                                {PM_YAML_VALUE("hidden", &hidden)},
                                {0}};
    PM_TRY(pm_scene_read_name(r, key, &name));
    PM_TRY(pm_yaml_read(block, r->arena, keys));
    PM_TRY(pm_yaml_text(unit, r->arena, &unit_text));
    if (strchr(unit_text, ';') != NULL) {
        return pm_yaml_fail(unit, "expected a unit without ';', found \"%.64s\"", unit_text);
    }
    if (pm_yaml_exists(list) == pm_yaml_exists(size) &&
        !(pm_yaml_exists(hidden) && !pm_yaml_exists(list))) {
        return pm_yaml_fail(block, "expected either \"columns\" (of a dataset) or \"size\"");
    }
    *columns = NULL;
    if (pm_yaml_exists(size)) {
        PM_TRY(pm_yaml_int(size, 1, MAX_COMPONENTS, &count));
    } else if (pm_yaml_exists(list)) {
        PM_TRY(pm_scene_read_columns(r, list, &count, columns));
    }
    pm_layout_add(&subsystem->layout, name, unit_text, count);
    if (coenergy) {
        pm_layout_mark_coenergy(&subsystem->layout);
    }
    return pm_yaml_exists(hidden) ? read_hidden(r, subsystem, block, hidden, columns) : PM_OK;
}

// Lets no group [count] be measured from another.
static pm_status make_relative(pm_scene_reader *r, pm_scene_subsystem *s, int count) {
    s->relative_subsystem = pm_arena_array(r->arena, (size_t)count, sizeof *s->relative_subsystem);
    s->relative_group = pm_arena_array(r->arena, (size_t)count, sizeof *s->relative_group);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < count; ++i) {
        s->relative_subsystem[i] = s->relative_group[i] = -1;
    }
    return PM_OK;
}

static pm_status read_state(pm_scene_reader *r, pm_scene_subsystem *s, pm_yaml state) {
    pm_scene_named *columns[PM_MAX_GROUPS] = {NULL};
    const pm_scene_subsystem *first = r->scene->physics.subsystem;
    PM_TRY(pm_yaml_require_entries(state));
    const int count = pm_yaml_count(state);
    if (count > PM_MAX_GROUPS) {
        return pm_yaml_fail(state, "%d groups, at most %d are possible", count, PM_MAX_GROUPS);
    }
    s->layout.group = pm_arena_array(r->arena, (size_t)count, sizeof *s->layout.group);
    s->group_at = pm_arena_array(r->arena, (size_t)count, sizeof *s->group_at);
    s->hidden = pm_arena_array(r->arena, (size_t)count, sizeof *s->hidden);
    s->guess = pm_arena_array(r->arena, (size_t)count, sizeof *s->guess);
    s->deviation = pm_arena_array(r->arena, (size_t)count, sizeof *s->deviation);
    PM_TRY(make_relative(r, s, count));
    for (int i = 0; i < count; ++i) {
        pm_yaml key, block;
        pm_yaml_entry(state, i, &key, &block);
        PM_TRY(read_group(r, s, key, block, &columns[i]));
        s->group_at[i] = pm_yaml_where(key, r->arena);
        const bool mapped = s == first ? columns[0] != NULL : first->column != NULL;
        if ((columns[i] != NULL) != mapped) {
            return pm_yaml_fail(block,
                                "expected \"%s\" as in the groups before: either all groups "
                                "of a scene name dataset columns or none does",
                                mapped ? "columns" : "size");
        }
    }
    return columns[0] == NULL ? PM_OK : join_columns(r, s, columns);
}

// Reads a subsystem; its name has been read.
static pm_status read_subsystem(pm_scene_reader *r, pm_scene_subsystem *s, pm_yaml key,
                                pm_yaml block) {
    pm_yaml mesh, state, initial;
    pm_part part;
    pm_component known = pm_component_of_part(&part);
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("weights", NULL)},
                                {PM_YAML_VALUE("model", NULL)},
                                {PM_YAML_VALUE("constants", NULL)},
                                {PM_YAML_VALUE("mesh", &mesh)},
                                {PM_YAML_VALUE("state", NULL)},
                                {PM_YAML_VALUE("initial", &initial)},
                                {0}};
    s->at = pm_yaml_where(key, r->arena);
    PM_TRY(pm_yaml_read(block, r->arena, keys));
    PM_TRY(read_maker(r, block, &s->weights, &s->weights_at, &known));
    s->model = known.spec;
    if (pm_yaml_exists(mesh)) {
        PM_TRY(read_path(r, mesh, &s->mesh));
        s->mesh_at = pm_yaml_where(mesh, r->arena);
    }
    PM_TRY(pm_yaml_require(block, "state", &state));
    PM_TRY(read_state(r, s, state));
    if (!pm_yaml_exists(initial)) {
        return PM_OK;
    }
    const pm_layout *layout = &s->layout;
    const char *groups[PM_MAX_GROUPS + 1] = {NULL};
    double *z = pm_arena_array(r->arena, (size_t)layout->nz, sizeof *z);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < layout->ngroup; ++i) {
        groups[i] = layout->group[i].name;
    }
    PM_TRY(pm_yaml_allow(initial, groups));
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        pm_yaml list;
        PM_TRY(pm_yaml_require(initial, group->name, &list));
        PM_TRY(pm_yaml_vector(list, group->size, r->arena, z + group->first));
    }
    s->initial = z;
    return PM_OK;
}

// Makes a subsystem like the first one of its range. It has a name and columns of its own.
static pm_status repeat_subsystem(pm_scene_reader *r, const pm_scene_subsystem *first,
                                  pm_scene_subsystem *subsystem, pm_yaml block) {
    pm_scene_named *columns[PM_MAX_GROUPS] = {NULL};
    const char *name = subsystem->name;
    *subsystem = *first;
    subsystem->name = name;
    const pm_yaml state = pm_yaml_get(block, "state");
    bool relative = false;
    for (int i = 0; i < first->layout.ngroup; ++i) {
        pm_yaml key, group;
        pm_yaml_entry(state, i, &key, &group);
        relative = relative || pm_yaml_exists(pm_yaml_get(group, "relative_to"));
        if (first->column == NULL) {
            continue;
        }
        const pm_yaml list = pm_yaml_get(group, "columns");
        int count;
        PM_TRY(pm_scene_read_columns(r, list, &count, &columns[i]));
        if (count != first->layout.group[i].size) {
            return pm_yaml_fail(list, "%d columns, and %s has %d", count, first->name,
                                first->layout.group[i].size);
        }
    }
    PM_TRY(relative ? make_relative(r, subsystem, first->layout.ngroup) : PM_OK);
    return first->column == NULL ? PM_OK : join_columns(r, subsystem, columns);
}

// --- groups measured from another ---

static pm_status read_relative(pm_scene_reader *r, pm_scene_subsystem *subsystem, int group_id,
                               pm_yaml at) {
    const pm_scene *scene = r->scene;
    const pm_group *group = &subsystem->layout.group[group_id];
    char names[MAX_MESSAGE];
    const char *text;
    PM_TRY(pm_yaml_text(at, r->arena, &text));
    PM_TRY(pm_scene_expand(r, at, text, &text));
    const char *dot = strchr(text, '.');
    if (dot == NULL) {
        return pm_yaml_fail(at, "expected SUBSYSTEM.GROUP, found \"%.64s\"", text);
    }
    const char *name = pm_arena_printf(r->arena, "%.*s", (int)(dot - text), text);
    PM_TRY(pm_scene_check_memory(r));
    const int other_id = pm_scene_find_subsystem(scene, name);
    if (other_id < 0) {
        return pm_yaml_fail(at, "there is no subsystem \"%.64s\"; subsystems: %s", name,
                            pm_scene_subsystem_names(scene, names, sizeof names));
    }
    const pm_layout *layout = &scene->physics.subsystem[other_id].layout;
    const pm_group *other = pm_layout_find(layout, dot + 1);
    if (other == NULL) {
        return pm_yaml_fail(at, "%s has no group \"%.64s\"; groups: %s", name, dot + 1,
                            group_names(layout, names, sizeof names));
    }
    if (other->size != group->size || strcmp(other->unit, group->unit) != 0) {
        return pm_yaml_fail(at, "%.64s has %d components in %.32s, expected %d in %.32s", text,
                            other->size, other->unit, group->size, group->unit);
    }
    subsystem->relative_subsystem[group_id] = other_id;
    subsystem->relative_group[group_id] = (int)(other - layout->group);
    return PM_OK;
}

// Returns what a group is measured from in the file, if anything.
static pm_yaml relative_of(const entries *e, int subsystem_id, int group_id) {
    pm_yaml key, value;
    pm_yaml_entry(e->map, entry_of(e, subsystem_id), &key, &value);
    pm_yaml_entry(pm_yaml_get(value, "state"), group_id, &key, &value);
    return pm_yaml_get(value, "relative_to");
}

static pm_status read_relatives(pm_scene_reader *r, const entries *e) {
    const pm_physics *physics = &r->scene->physics;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const int entry = entry_of(e, i);
        pm_scene_enter(r, &e->range[entry], i - e->first[entry]);
        for (int g = 0; g < physics->subsystem[i].layout.ngroup; ++g) {
            const pm_yaml at = relative_of(e, i, g);
            PM_TRY(pm_yaml_exists(at) ? read_relative(r, &physics->subsystem[i], g, at) : PM_OK);
        }
    }
    r->naxis = 0;
    pm_arena arena = {0};
    int *walk = pm_arena_array(&arena, (size_t)physics->nsubsystem * PM_MAX_GROUPS, sizeof *walk);
    pm_status status = pm_arena_status(&arena, "a scene");
    for (int i = 0; i < physics->nsubsystem && status == PM_OK; ++i) {
        for (int g = 0; g < physics->subsystem[i].layout.ngroup && status == PM_OK; ++g) {
            // walk [nsubsystem][PM_MAX_GROUPS] keeps by which walk a group was first reached,
            // counting from 1: a walk that reaches a group of its own is in a cycle, and one that
            // reaches a group of an earlier walk ends.
            const int own = i * PM_MAX_GROUPS + g + 1;
            int subsystem_id = i, group_id = g, *reached = &walk[own - 1];
            while (*reached == 0 &&
                   physics->subsystem[subsystem_id].relative_subsystem[group_id] >= 0) {
                const pm_scene_subsystem *subsystem = &physics->subsystem[subsystem_id];
                *reached = own;
                subsystem_id = subsystem->relative_subsystem[group_id];
                group_id = subsystem->relative_group[group_id];
                reached = &walk[(ptrdiff_t)subsystem_id * PM_MAX_GROUPS + group_id];
            }
            if (*reached == own) {
                status = pm_yaml_fail(relative_of(e, i, g),
                                      "a cycle: each group of this chain is measured from the "
                                      "next, none from the origin");
            }
        }
    }
    pm_arena_free(&arena);
    return status;
}

static pm_status read_subsystems(pm_scene_reader *r) {
    pm_physics *physics = &r->scene->physics;
    pm_yaml subsystems;
    entries e;
    PM_TRY(pm_yaml_require(r->root, "subsystems", &subsystems));
    PM_TRY(read_entries(r, subsystems, &e));
    physics->nsubsystem = e.total;
    physics->subsystem = pm_arena_array(r->arena, (size_t)e.total, sizeof *physics->subsystem);
    const char **name = pm_arena_array(r->arena, (size_t)e.total, sizeof *name);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < e.total; ++i) {
        pm_scene_subsystem *subsystem = &physics->subsystem[i];
        pm_yaml key, block;
        int first;
        const char *range;
        PM_TRY(enter_entry(r, &e, i, &key, &block, &subsystem->name, &range, &first));
        name[i] = subsystem->name;
        PM_TRY(first == i ? read_subsystem(r, subsystem, key, block)
                          : repeat_subsystem(r, &physics->subsystem[first], subsystem, block));
        subsystem->range = range;
        subsystem->first = physics->nz;
        physics->nz += subsystem->layout.nz;
        if (physics->nz > PM_SCENE_MOST_STATE) {
            return pm_yaml_fail(key, "more than %d components in all", PM_SCENE_MOST_STATE);
        }
    }
    PM_TRY(sort_names(r, &e, name, &physics->subsystem_names));
    if (physics->subsystem->column != NULL) { // no column may hold two components
        pm_names names;
        const char **column = pm_arena_array(r->arena, (size_t)physics->nz, sizeof *column);
        PM_TRY(pm_scene_check_memory(r));
        for (int i = 0; i < e.total; ++i) {
            const pm_scene_subsystem *subsystem = &physics->subsystem[i];
            memcpy(column + subsystem->first, subsystem->column,
                   (size_t)subsystem->layout.nz * sizeof *column);
        }
        PM_TRY(pm_names_sort(&names, column, physics->nz, r->arena));
        const int twice = pm_names_twice(&names);
        const pm_scene_subsystem *owner = physics->subsystem;
        while (twice >= owner->first + owner->layout.nz) {
            ++owner;
        }
        if (twice >= 0) {
            return pm_fail(PM_ECONFIG, "%s: columns: dataset column \"%.64s\" occurs twice",
                           owner->column_at[twice - owner->first], column[twice]);
        }
    }
    return read_relatives(r, &e);
}

// --- boundary inputs ---

const char *const pm_hold_names[] = {"smooth", "previous", "linear", NULL};

enum { VALUE, DE, DS, NLIST }; // in the order of pm_scene_boundary_input.value

// The lists of one group: columns and numbers, [size of the group] each. NULL: all are the number
// 0.
typedef struct group_lists {
    pm_scene_named *list[NLIST];
    int hold; // pm_hold
    double delay;
} group_lists;

static pm_status read_prescribed_group(pm_scene_reader *r, pm_scene_boundary_input *input,
                                       pm_yaml key, pm_yaml block, group_lists *read) {
    const char *name, *unit;
    pm_yaml list[NLIST];
    int size = 0;
    const pm_yaml_key keys[] = {{PM_YAML_TEXT("unit", &unit), .required = true},
                                {PM_YAML_VALUE("dE", &list[DE]), .required = true},
                                {PM_YAML_VALUE("dS", &list[DS])},
                                {PM_YAML_VALUE("value", &list[VALUE])},
                                {PM_YAML_CHOICE("hold", &read->hold, pm_hold_names)},
                                {PM_YAML_DOUBLE("delay", &read->delay, -INFINITY, INFINITY)},
                                {0}};
    PM_TRY(pm_scene_read_name(r, key, &name));
    PM_TRY(pm_yaml_read(block, r->arena, keys));
    PM_TRY(pm_scene_read_columns(r, list[DE], &size, &read->list[DE]));
    for (int k = 0; k < NLIST; ++k) {
        int count;
        if (k == DE || !pm_yaml_exists(list[k])) {
            continue;
        }
        PM_TRY(pm_scene_read_columns(r, list[k], &count, &read->list[k]));
        if (count != size) {
            return pm_yaml_fail(list[k], "expected %d as under \"dE\", found %d", size, count);
        }
    }
    pm_layout_add(&input->layout, name, unit, size);
    input->entropy = input->entropy || read->list[DS] != NULL;
    return PM_OK;
}

static pm_status read_boundary_input(pm_scene_reader *r, pm_scene_boundary_input *input,
                                     pm_yaml key, pm_yaml groups) {
    group_lists written[PM_MAX_GROUPS] = {0};
    pm_layout *layout = &input->layout;
    PM_TRY(pm_scene_read_name(r, key, &input->name));
    if (pm_scene_find_subsystem(r->scene, input->name) >= 0) {
        return pm_yaml_fail(key, "\"%s\" is the name of a subsystem already", input->name);
    }
    PM_TRY(pm_yaml_require_entries(groups));
    const int count = pm_yaml_count(groups);
    if (count > PM_MAX_GROUPS) {
        return pm_yaml_fail(groups, "%d groups, at most %d are possible", count, PM_MAX_GROUPS);
    }
    layout->group = pm_arena_array(r->arena, (size_t)count, sizeof *layout->group);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < count; ++i) {
        pm_yaml name, block;
        pm_yaml_entry(groups, i, &name, &block);
        PM_TRY(read_prescribed_group(r, input, name, block, &written[i]));
    }
    pm_scene_prescribed *value =
        pm_arena_array(r->arena, NLIST * (size_t)layout->nz, sizeof *value);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < count * NLIST; ++i) {
        const pm_group *group = &layout->group[i / NLIST];
        const pm_scene_named *list = written[i / NLIST].list[i % NLIST];
        pm_scene_prescribed *own = &value[i % NLIST * layout->nz + group->first];
        for (int k = 0; k < group->size && list != NULL; ++k) {
            own[k].at = k > 0 && list[k].at.node == list[k - 1].at.node
                            ? own[k - 1].at
                            : pm_yaml_where(list[k].at, r->arena);
            if (strchr("+-.0123456789", list[k].text[0]) == NULL) { // no number
                own[k].column = list[k].text;
                own[k].hold = (pm_hold)written[i / NLIST].hold;
                own[k].delay = written[i / NLIST].delay;
            } else {
                PM_TRY(pm_yaml_double(list[k].at, -INFINITY, INFINITY, &own[k].number));
            }
        }
    }
    input->value = value;
    return PM_OK;
}

static pm_status read_boundary_inputs(pm_scene_reader *r) {
    pm_physics *physics = &r->scene->physics;
    const pm_yaml inputs = pm_yaml_get(r->root, "boundary_inputs");
    if (!pm_yaml_exists(inputs)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(inputs));
    physics->boundary_input =
        pm_arena_array(r->arena, (size_t)pm_yaml_count(inputs), sizeof *physics->boundary_input);
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < pm_yaml_count(inputs); ++i) {
        pm_scene_boundary_input *input = &physics->boundary_input[physics->nboundary_input++];
        pm_yaml key, groups;
        pm_yaml_entry(inputs, i, &key, &groups);
        PM_TRY(read_boundary_input(r, input, key, groups));
        input->first = physics->nprescribed;
        physics->nprescribed += NLIST * input->layout.nz;
    }
    return PM_OK;
}

// --- ports ---

typedef struct port_table {
    const char *path, *dataset;
    int count;
    double *number; // [count][2]
} port_table;

static pm_status read_rows(const port_table *t) {
    const int extent[2] = {t->count, 2};
    pm_hdf5 *opened = NULL;
    PM_TRY(pm_hdf5_open(&opened, t->path, PM_HDF5_ANY, PM_EDATA));
    const pm_status status = pm_hdf5_read(opened, t->dataset, 2, extent, t->number);
    pm_hdf5_close(opened);
    return status;
}

static void try_rows(const void *context) {
    (void)read_rows(context);
}

// Reads the key `table` of an entry that stands for `count` ports: a dataset of an HDF5 file whose
// rows are the numbers for [a] and [b] in each port. `table` [count][2] lies in the arena; NULL:
// the entry has no table.
static pm_status read_table(pm_scene_reader *r, pm_yaml value, int count, const double **table) {
    port_table t = {.count = count};
    pm_yaml file;
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("file", &file), .required = true},
                                {PM_YAML_TEXT("dataset", &t.dataset), .required = true},
                                {0}};
    *table = NULL;
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    if (r->naxis == 0) {
        return pm_yaml_fail(value, "a table needs a range of ports, such as joint[0:30]");
    }
    PM_TRY(pm_yaml_read(value, r->arena, keys));
    PM_TRY(read_path(r, file, &t.path));
    t.number = pm_arena_array(r->arena, 2 * (size_t)count, sizeof *t.number);
    PM_TRY(pm_scene_check_memory(r));
    PM_TRY(pm_hdf5_try(t.path, try_rows, &t));
    PM_TRY(read_rows(&t));
    for (int i = 0; i < 2 * count; ++i) {
        const double id = t.number[i];
        if (!(id >= 0 && id <= PM_SCENE_MAX_INDEX && id == floor(id))) {
            return pm_fail(PM_EDATA, "%s: dataset %s: row %d has %g, expected a whole number >= 0",
                           t.path, t.dataset, i / 2, id);
        }
    }
    *table = t.number;
    return PM_OK;
}

// Reads the two ends; `text` receives their names as they stand in the file.
static pm_status read_between(pm_scene_reader *r, pm_scene_port *port, pm_yaml block,
                              const char *text[2]) {
    const pm_physics *physics = &r->scene->physics;
    pm_yaml between;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(block, "between", &between));
    PM_TRY(pm_yaml_texts(between, r->arena, &count, &name));
    if (count != 2) {
        return pm_yaml_fail(between, "expected two subsystems [a, b], found %d", count);
    }
    for (int end = 0; end < 2; ++end) {
        const pm_yaml at = pm_yaml_item(between, end);
        text[end] = port->between[end] = name[end];
        PM_TRY(pm_scene_expand(r, at, name[end], &name[end]));
        port->subsystem[end] = pm_scene_find_subsystem(r->scene, name[end]);
        port->boundary_input[end] = pm_scene_find_boundary_input(r->scene, name[end]);
        if (port->subsystem[end] >= 0 || port->boundary_input[end] >= 0) {
            continue;
        }
        char names[MAX_MESSAGE];
        size_t used = strlen(pm_scene_subsystem_names(r->scene, names, sizeof names));
        for (int i = 0; i < physics->nboundary_input && used < sizeof names; ++i) {
            used += (size_t)snprintf(names + used, sizeof names - used, ", %s",
                                     physics->boundary_input[i].name);
        }
        return pm_yaml_fail(at, "there is no subsystem or boundary input \"%.64s\"; there are: %s",
                            name[end], names);
    }
    if (port->boundary_input[0] >= 0 && port->boundary_input[1] >= 0) {
        return pm_yaml_fail(between, "expected a subsystem at one end, found two boundary inputs");
    }
    return port->subsystem[0] != port->subsystem[1]
               ? PM_OK
               : pm_yaml_fail(between, "expected two different subsystems, found \"%s\" twice",
                              name[0]);
}

// Reads the exposed groups of one end, in the order written, and the positions of their components
// in the end's whole state. `key` is the name of the end as it stands in the file.
static pm_status read_exposed(pm_scene_reader *r, pm_scene_port *port, int end, pm_yaml expose,
                              const char *key) {
    const char *owner = pm_scene_end_name(r->scene, port, end);
    const pm_layout *whole = pm_scene_end_layout(r->scene, port, end);
    pm_layout *layout = &port->layout[end];
    pm_yaml list;
    int count;
    const char **name;
    PM_TRY(pm_yaml_require(expose, key, &list));
    port->expose_at[end] = pm_yaml_where(list, r->arena);
    PM_TRY(pm_yaml_texts(list, r->arena, &count, &name));
    if (count == 0) {
        return pm_yaml_fail(list, "expected at least one group of %s", owner);
    }
    int *component = pm_arena_array(r->arena, (size_t)whole->nz, sizeof *component);
    *layout = (pm_layout){
        .group = pm_arena_array(r->arena, (size_t)whole->ngroup, sizeof *layout->group)};
    PM_TRY(pm_scene_check_memory(r));
    for (int i = 0; i < count; ++i) {
        const pm_yaml at = pm_yaml_item_or_self(list, i);
        const pm_group *group = pm_layout_find(whole, name[i]);
        if (group == NULL) {
            char names[MAX_MESSAGE];
            return pm_yaml_fail(at, "%s has no group \"%.64s\"; groups: %s", owner, name[i],
                                group_names(whole, names, sizeof names));
        }
        if (pm_layout_find(layout, name[i]) != NULL) {
            return pm_yaml_fail(at, "group \"%s\" occurs twice", name[i]);
        }
        for (int j = 0; j < group->size; ++j) {
            component[layout->nz + j] = group->first + j;
        }
        pm_layout_add(layout, group->name, group->unit, group->size);
        if (group->coenergy) {
            pm_layout_mark_coenergy(layout);
        }
    }
    port->component[end] = component;
    return PM_OK;
}

// Reads the exposed groups of both ends, whose names in the file are `text`.
static pm_status read_expose(pm_scene_reader *r, pm_scene_port *port, pm_yaml block,
                             const char *const text[2]) {
    pm_yaml expose;
    PM_TRY(pm_yaml_require(block, "expose", &expose));
    const char *const ends[] = {text[0], text[1], NULL};
    PM_TRY(pm_yaml_allow(expose, ends));
    PM_TRY(read_exposed(r, port, 0, expose, text[0]));
    return read_exposed(r, port, 1, expose, text[1]);
}

// Reads a port; its name has been read. `table` has been read for all ports of its range.
static pm_status read_port(pm_scene_reader *r, pm_scene_port *port, pm_yaml block) {
    const char *text[2];
    pm_yaml law;
    pm_port_model made;
    pm_component known = pm_component_of_port(&made);
    const pm_yaml_key keys[] = {{PM_YAML_VALUE("law", &law), .required = true},
                                {PM_YAML_VALUE("between", NULL)},
                                {PM_YAML_VALUE("expose", NULL)},
                                {PM_YAML_VALUE("weights", NULL)},
                                {PM_YAML_VALUE("model", NULL)},
                                {PM_YAML_VALUE("constants", NULL)},
                                {PM_YAML_VALUE("table", NULL)},
                                {0}};
    PM_TRY(pm_yaml_read(block, r->arena, keys));
    PM_TRY(pm_yaml_text(law, r->arena, &port->law));
    port->law_at = pm_yaml_where(law, r->arena);
    if (pm_port_law_find(port->law) == NULL) {
        return pm_yaml_fail(law, "expected one of %s, found \"%.64s\"", pm_port_law_names(),
                            port->law);
    }
    PM_TRY(read_between(r, port, block, text));
    PM_TRY(read_expose(r, port, block, text));
    PM_TRY(read_maker(r, block, &port->weights, &port->weights_at, &known));
    port->model = known.spec;
    return PM_OK;
}

// Makes a port like the first one of its range. It has a name and ends of its own.
static pm_status repeat_port(pm_scene_reader *r, const pm_scene_port *first, pm_scene_port *port,
                             pm_yaml block) {
    const char *name = port->name, *text[2];
    *port = *first;
    port->name = name;
    PM_TRY(read_between(r, port, block, text));
    bool alike = true;
    for (int end = 0; end < 2; ++end) {
        alike = alike && pm_layout_equal(pm_scene_end_layout(r->scene, port, end),
                                         pm_scene_end_layout(r->scene, first, end));
    }
    return alike ? PM_OK : read_expose(r, port, block, text);
}

// Returns the number of ports from subsystem `from` to the one that is farthest away, and INT_MAX
// if no ports lead to some. `found` and `ring` have one number for each subsystem.
static int find_farthest(const pm_physics *physics, int from, int *found, int *ring) {
    int count = 1;
    memset(ring, 0, (size_t)physics->nsubsystem * sizeof *ring); // rings count from 1
    found[0] = from;                                             // in the order of finding
    ring[from] = 1;
    for (int k = 0; k < count; ++k) {
        for (int i = physics->first_end[found[k]]; i < physics->first_end[found[k] + 1]; ++i) {
            const int end = physics->end_at[i];
            const int other = physics->port[end / 2].subsystem[1 - end % 2];
            if (other >= 0 && ring[other] == 0) {
                ring[other] = ring[found[k]] + 1;
                found[count++] = other;
            }
        }
    }
    return count < physics->nsubsystem ? INT_MAX : ring[found[count - 1]] - 1;
}

static pm_status read_ports(pm_scene_reader *r) {
    pm_physics *physics = &r->scene->physics;
    const pm_yaml ports = pm_yaml_get(r->root, "ports");
    entries e = {.total = 0};
    PM_TRY(pm_yaml_exists(ports) ? read_entries(r, ports, &e) : PM_OK);
    physics->nport = e.total;
    physics->port = pm_arena_array(r->arena, (size_t)e.total, sizeof *physics->port);
    const char **name = pm_arena_array(r->arena, (size_t)e.total, sizeof *name);
    PM_TRY(pm_scene_check_memory(r));
    const double *table = NULL;
    for (int i = 0; i < e.total; ++i) {
        pm_scene_port *port = &physics->port[i];
        pm_yaml key, block;
        int first;
        const char *range;
        r->row = NULL;
        PM_TRY(enter_entry(r, &e, i, &key, &block, &port->name, &range, &first));
        name[i] = port->name;
        if (first == i) {
            PM_TRY(
                read_table(r, pm_yaml_get(block, "table"), e.range[entry_of(&e, i)].total, &table));
        }
        r->row = table == NULL ? NULL : &table[2 * (i - first)];
        PM_TRY(first == i ? read_port(r, port, block)
                          : repeat_port(r, &physics->port[first], port, block));
        port->range = range;
    }
    r->naxis = 0;
    r->row = NULL;
    PM_TRY(e.total > 0 ? sort_names(r, &e, name, &physics->port_names) : PM_OK);

    // The ends of ports at each subsystem.
    const size_t n = (size_t)physics->nsubsystem, nend = 2 * (size_t)physics->nport;
    physics->first_end = pm_arena_array(r->arena, n + 2, sizeof *physics->first_end);
    physics->end_at = pm_arena_array(r->arena, nend, sizeof *physics->end_at);
    PM_TRY(pm_scene_check_memory(r));
    // Counts first, one place further on, so that filling moves each start to where it belongs.
    int *next = physics->first_end + 1;
    for (int k = 0; k < 2 * physics->nport; ++k) {
        const int id = physics->port[k / 2].subsystem[k % 2];
        if (id >= 0) {
            ++next[id + 1];
        }
    }
    for (int i = 0; i < physics->nsubsystem; ++i) {
        next[i + 1] += next[i];
    }
    for (int k = 0; k < 2 * physics->nport; ++k) {
        const int id = physics->port[k / 2].subsystem[k % 2];
        if (id >= 0) {
            physics->end_at[next[id]++] = k;
        }
    }

    // The farthest two subsystems are looked for only if an iteration needs them (sim/iteration.h)
    // and that takes little time. Twice the distance from the first one to the farthest is a bound,
    // and so is the number of subsystems.
    pm_arena arena = {0};
    int *found = pm_arena_array(&arena, n + 1, sizeof *found);
    int *ring = pm_arena_array(&arena, n + 1, sizeof *ring);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a scene"));
    const bool exact = pm_integrator_iterates(physics->integrator) && n * nend <= MOST_VISITS;
    const size_t sources = exact ? n : 1;
    int distance = 0;
    for (size_t i = 0; i < sources; ++i) {
        const int farthest = find_farthest(physics, (int)i, found, ring);
        distance = farthest > distance ? farthest : distance;
    }
    const int most = physics->nsubsystem - 1;
    physics->diameter = exact || distance == INT_MAX ? distance
                        : 2 * distance < most        ? 2 * distance
                                                     : most;
done:
    pm_arena_free(&arena);
    return status;
}

// --- the whole ---

// Reads the name of the system, which other programs write between quotation marks.
static pm_status read_system(pm_scene_reader *r) {
    const pm_yaml value = pm_yaml_get(r->root, "system");
    if (!pm_yaml_exists(value)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_text(value, r->arena, &r->scene->system));
    const char *at = r->scene->system;
    while (*at != '\0' && isprint((unsigned char)*at) && *at != '"' && *at != '\\') {
        ++at;
    }
    return at > r->scene->system && *at == '\0' && at - r->scene->system <= MAX_SYSTEM
               ? PM_OK
               : pm_yaml_fail(value,
                              "expected 1 to %d printable ASCII characters without quotation marks "
                              "and backslashes",
                              MAX_SYSTEM);
}

static pm_status scene_from(pm_scene **result, pm_yaml root, const char *path) {
    static const char *const keys[] = {
        "scene",    "url",    "key_file",     "time",        "subsystems", "boundary_inputs",
        "models",   "ports",  "processes",    "reference",   "laws",       "guards",
        "lockstep", "record", "observations", "live_inputs", "tap",        "start",
        "system",   NULL};
    pm_yaml value;
    pm_scene *scene = NULL;
    PM_TRY(PM_NEW(scene, "a scene"));
    pm_scene_reader r = {.scene = scene, .arena = &scene->arena, .root = root};
    pm_status status;
    scene->path = pm_arena_strdup(&scene->arena, path);
    PM_TRY_DONE(pm_scene_check_memory(&r));
    PM_TRY_DONE(pm_yaml_allow(r.root, keys));
    PM_TRY_DONE(pm_yaml_require(r.root, "scene", &value));
    PM_TRY_DONE(pm_scene_read_name(&r, value, &r.scene->name));
    PM_TRY_DONE(read_system(&r));
    PM_TRY_DONE(read_network(&r));
    PM_TRY_DONE(read_time(&r));
    PM_TRY_DONE(read_subsystems(&r));
    value = pm_yaml_get(root, "start");
    if (pm_yaml_exists(value)) { // in place of each `initial` and of the reference
        double *z = pm_arena_array(r.arena, (size_t)scene->physics.nz, sizeof *z);
        PM_TRY_DONE(pm_scene_check_memory(&r));
        PM_TRY_DONE(pm_yaml_vector(value, scene->physics.nz, r.arena, z));
        for (int i = 0; i < scene->physics.nsubsystem; ++i) {
            scene->physics.subsystem[i].initial = z + scene->physics.subsystem[i].first;
        }
    }
    PM_TRY_DONE(read_boundary_inputs(&r));
    PM_TRY_DONE(read_ports(&r));
    PM_TRY_DONE(pm_scene_read_live_inputs(&r));
    PM_TRY_DONE(read_run(&r));
    PM_TRY_DONE(pm_scene_read_processes(&r));
    PM_TRY_DONE(pm_scene_check_memory(&r));
    *result = scene;
    scene = NULL;
done:
    pm_scene_free(scene);
    return status;
}

pm_status pm_scene_load(pm_scene **scene, const char *path) {
    pm_yaml_document *document;
    pm_yaml root;
    PM_TRY(pm_yaml_open(&document, path, &root));
    const pm_status status = scene_from(scene, root, path);
    pm_yaml_close(document);
    return status;
}

pm_status pm_scene_parse(pm_scene **scene, const char *text, const char *path) {
    pm_yaml_document *document;
    pm_yaml root;
    PM_TRY(pm_yaml_parse(&document, text, path, &root));
    const pm_status status = scene_from(scene, root, path);
    pm_yaml_close(document);
    return status;
}

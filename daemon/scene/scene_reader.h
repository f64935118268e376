// Declarations shared by the files that read a scene (scene.c and scene_*.c). Only these files
// include this header. scene.c calls the readers of the sections, and these call scene_yaml.c,
// scene_names.c and scene_lookup.c.
#ifndef PM_SCENE_SCENE_READER_H
#define PM_SCENE_SCENE_READER_H

#include <stddef.h>

#include "scene/scene.h"
#include "store/yaml.h"

#define PM_SCENE_MAX_AXES 3
#define PM_SCENE_MOST_COMPONENTS 1000000 // subsystems or ports that a key stands for

// A scene while it is read.
typedef struct pm_scene_reader {
    pm_scene *scene;
    pm_arena *arena; // the scene's
    pm_yaml root;
    int nname;                    // column names read so far
    int naxis;                    // of the range whose block is being read; 0: there is no range
    int index[PM_SCENE_MAX_AXES]; // [naxis] of the component that is being read
    const double *row; // [2] of the table, for the port that is being read; NULL: it has no table
} pm_scene_reader;

// The components that a key means: one, or with NAME[A:B] one for each index from A up to, not
// including, B. Up to three axes may follow each other; the last one runs fastest.
typedef struct pm_scene_range {
    const char *key;     // as it stands in the file
    const char *pattern; // of the names: "link", "link[i]", "cell[i][j]"
    int naxis;           // 0: a single component
    int first[PM_SCENE_MAX_AXES], count[PM_SCENE_MAX_AXES]; // [naxis]
    int total;                                              // components
} pm_scene_range;

// A text and the place where it stands.
typedef struct pm_scene_named {
    const char *text;
    pm_yaml at;
} pm_scene_named;

// Each reads one section into the scene. The section `subsystems` is read first, since the others
// refer to it. PM_ECONFIG: the message names the place in the file. PM_ENOMEM.
pm_status pm_scene_read_subsystems(pm_scene_reader *r);
pm_status pm_scene_read_boundary_inputs(pm_scene_reader *r);
pm_status pm_scene_read_live_inputs(pm_scene_reader *r);
pm_status pm_scene_read_ports(pm_scene_reader *r);
pm_status pm_scene_read_processes(pm_scene_reader *r);
pm_status pm_scene_read_record(pm_scene_reader *r);
pm_status pm_scene_read_observations(pm_scene_reader *r);

// Reads the key `hidden` of the last group of a subsystem's layout, if there is one. A hidden group
// that names no columns gets columns [size] named "subsystem.group" (or "subsystem.group_0", ...),
// which `columns` receives. PM_ECONFIG, PM_ENOMEM.
pm_status pm_scene_read_hidden(pm_scene_reader *r, pm_scene_subsystem *subsystem, pm_yaml block,
                               pm_scene_named **columns);

// Each reads the source of a component's model: a weights file, or a known model with its
// constants.
pm_status pm_scene_read_part_maker(pm_scene_reader *r, pm_yaml block,
                                   pm_scene_subsystem *subsystem);
pm_status pm_scene_read_port_maker(pm_scene_reader *r, pm_yaml block, pm_scene_port *port);

// Parses the text of a key. PM_ECONFIG: it is neither a name nor a range, or it stands for more
// than PM_SCENE_MOST_COMPONENTS components.
pm_status pm_scene_parse_range(pm_scene_reader *r, pm_yaml at, const char *text,
                               pm_scene_range *range);
// Makes component `number` of a range the one that is being read.
void pm_scene_enter(pm_scene_reader *r, const pm_scene_range *range, int number);
// Replaces every index in a text by its number in the component that is being read: "link[i+1]"
// becomes link8, and "cell[i][j]" becomes cell3_7. With a row of a table, [a] and [b] are its two
// numbers. Other brackets stay. PM_ECONFIG: an index is negative.
pm_status pm_scene_expand(pm_scene_reader *r, pm_yaml at, const char *text, const char **result);
// Reads the key `table` of an entry that stands for `count` ports: a dataset of an HDF5 file whose
// rows are the numbers for [a] and [b] in each port. `table` [count][2] lies in the arena; NULL:
// the entry has no table. PM_ECONFIG, PM_EFILE, PM_EDATA: a number is not whole or negative;
// PM_ENOMEM.
pm_status pm_scene_read_table(pm_scene_reader *r, pm_yaml block, int count, const double **table);
// Reads a text and expands it.
pm_status pm_scene_read_indexed(pm_scene_reader *r, pm_yaml at, const char **text);

// The entries of a mapping whose keys are names or ranges.
typedef struct pm_scene_entries {
    pm_yaml map;
    int count;             // entries
    pm_scene_range *range; // [count]
    int *first;            // [count] position of the entry's first component among all
    int total;             // components of all entries
} pm_scene_entries;
// Parses the keys of a mapping. PM_ECONFIG, PM_ENOMEM.
pm_status pm_scene_read_entries(pm_scene_reader *r, pm_yaml map, pm_scene_entries *entries);
// Returns the entry to which a component belongs.
int pm_scene_entry_of(const pm_scene_entries *entries, int component);
// Makes component number `id` of all entries the one that is being read, and reads its name. `key`
// and `block` receive its entry. Returns through `first` the first component of the same entry.
pm_status pm_scene_enter_entry(pm_scene_reader *r, const pm_scene_entries *entries, int id,
                               pm_yaml *key, pm_yaml *block, const char **name, int *first);
// Returns the key of a component's entry if it is a range, or NULL.
const char *pm_scene_range_of(const pm_scene_entries *entries, int component);
// Sorts the names of components [count] and refuses a name that occurs twice. `name_of` returns the
// name of one component.
pm_status pm_scene_sort_names(pm_scene_reader *r, const pm_scene_entries *entries,
                              const char *(*name_of)(const pm_scene *scene, int id),
                              pm_names *names);

// Checks a name: a letter, then letters, digits or '_'.
pm_status pm_scene_check_name(pm_yaml at, const char *name);
// Reads a name: a letter, then letters, digits or '_'.
pm_status pm_scene_read_name(pm_scene_reader *r, pm_yaml at, const char **name);
// Reads a path and resolves it against the folder of the scene file.
pm_status pm_scene_read_path(pm_scene_reader *r, pm_yaml at, const char **path);
// Writes the place of a value as text into the arena, for errors found after the scene was read.
pm_status pm_scene_read_at(pm_scene_reader *r, pm_yaml value, const char **at);

// Reads a list of columns or a single one, in which "f[0:180]" stands for f0, f1, ... f179. The
// result [count] lies in the arena.
pm_status pm_scene_read_columns(pm_scene_reader *r, pm_yaml list, int *count,
                                pm_scene_named **result);
// Writes the places of the columns to at [count]. Columns of one range share the text.
pm_status pm_scene_read_places(pm_scene_reader *r, const pm_scene_named *list, int count,
                               const char **at);

// Each writes the names that exist as "a, b, c" to the buffer, for messages, and returns the
// buffer: all subsystems; all subsystems and boundary inputs; all groups of a layout.
const char *pm_scene_subsystem_names(const pm_scene *scene, char *buffer, size_t size);
const char *pm_scene_end_names(const pm_scene *scene, char *buffer, size_t size);
const char *pm_scene_group_names(const pm_layout *layout, char *buffer, size_t size);

// Divides the subsystems among `count` processes so that the processes have about equal costs and
// exchange few numbers. cost [nsubsystem] is that of each subsystem; NULL: it is estimated from the
// numbers of components. mark [nsubsystem] receives the process of each subsystem, from 0 to count
// - 1; every process gets at least one, as `count` is at most the number of subsystems. The same
// scene and costs give the same result. The ends of ports (scene->end_at) must have been listed.
// PM_ECONFIG: the program was built without METIS. PM_ENOMEM.
pm_status pm_scene_cut(const pm_scene *scene, int count, const int *cost, int *mark);

// Fails with PM_ENOMEM.
pm_status pm_scene_no_memory(void);

#endif

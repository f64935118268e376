// Declarations shared by the files that read a scene. Only these files include this header:
// scene_reader.c reads the file section by section, scene_process.c and scene_live_input.c read the
// sections `processes` and `live_inputs`, and scene_range.c the names and ranges of all of them.
// Readers fail with PM_ECONFIG, and name the place in the file, or with PM_ENOMEM. Places and other
// texts that nobody reads in between may be NULL after memory has run out: pm_scene_check_memory
// fails in the end.
#ifndef PM_SCENE_SCENE_READER_H
#define PM_SCENE_SCENE_READER_H

#include <stddef.h>

#include "scene/scene.h"
#include "store/yaml.h"

#define PM_SCENE_MAX_AXES 3
#define PM_SCENE_MAX_INDEX 1000000000L
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

// Each reads one section into the scene, after the subsystems and ports.
pm_status pm_scene_read_live_inputs(pm_scene_reader *r);
pm_status pm_scene_read_processes(pm_scene_reader *r);

// Fails with PM_ENOMEM if an allocation for the scene failed.
pm_status pm_scene_check_memory(const pm_scene_reader *r);

// Checks a name: a letter, then letters, digits or '_'.
pm_status pm_scene_check_name(pm_yaml at, const char *name);
// Reads a name.
pm_status pm_scene_read_name(pm_scene_reader *r, pm_yaml at, const char **name);

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

// Calls `visit` with `number` for each subsystem that a list names, one by one or by ranges, at the
// place `at`. PM_ECONFIG: there is no such subsystem. Passes on the status of `visit`.
typedef pm_status pm_scene_member_visit(pm_scene_reader *r, pm_yaml at, int id, int number);
pm_status pm_scene_visit_members(pm_scene_reader *r, pm_yaml list, pm_scene_member_visit *visit,
                                 int number);
// Reads a list of columns or a single one, in which "f[0:180]" stands for f0, f1, ... f179. The
// result [count] lies in the arena.
pm_status pm_scene_read_columns(pm_scene_reader *r, pm_yaml list, int *count,
                                pm_scene_named **result);

// Writes the names of all subsystems as "a, b, c" to the buffer, for messages, and returns it.
const char *pm_scene_subsystem_names(const pm_scene *scene, char *buffer, size_t size);

#endif

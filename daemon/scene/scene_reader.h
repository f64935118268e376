// Declarations shared by the files that read a scene (scene.c and scene_*.c). Only these files
// include this header. scene.c calls the readers of the sections, and these call scene_yaml.c,
// scene_names.c and scene_lookup.c.
#ifndef PM_SCENE_SCENE_READER_H
#define PM_SCENE_SCENE_READER_H

#include <stddef.h>

#include "scene/scene.h"
#include "store/yaml.h"

// A scene while it is read.
typedef struct pm_scene_reader {
    pm_scene *scene;
    pm_arena *arena; // the scene's
    pm_yaml root;
    int nname; // column names read so far
} pm_scene_reader;

// A text and the place where it stands.
typedef struct pm_scene_named {
    const char *text;
    pm_yaml at;
} pm_scene_named;

// Each reads one section into the scene. The section `subsystems` is read first, since the others
// refer to it. PM_ECONFIG: the message names the place in the file. PM_ENOMEM.
pm_status pm_scene_read_subsystems(pm_scene_reader *r);
pm_status pm_scene_read_boundary_inputs(pm_scene_reader *r);
pm_status pm_scene_read_ports(pm_scene_reader *r);
pm_status pm_scene_read_processes(pm_scene_reader *r);
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

// Fails with PM_ENOMEM.
pm_status pm_scene_no_memory(void);

#endif

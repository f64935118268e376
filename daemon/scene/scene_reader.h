// Shared by the files that read a scene (scene.c, scene_names.c, scene_subsystem.c,
// scene_boundary_input.c, scene_model.c, scene_port.c, scene_process.c), and by them only.
#ifndef PM_SCENE_SCENE_READER_H
#define PM_SCENE_SCENE_READER_H

#include <stddef.h>

#include "scene/scene.h"
#include "store/yaml.h"

// A scene being read.
typedef struct pm_scene_reader {
    pm_scene *scene;
    pm_arena *arena; // the scene's
    pm_yaml root;
    int nname; // of columns, read so far
} pm_scene_reader;

// Text and where it stands.
typedef struct pm_scene_named {
    const char *text;
    pm_yaml at;
} pm_scene_named;

// Read the sections `subsystems`, and after it `boundary_inputs`, `ports` and `processes`.
pm_status pm_scene_read_subsystems(pm_scene_reader *r);
pm_status pm_scene_read_boundary_inputs(pm_scene_reader *r);
pm_status pm_scene_read_ports(pm_scene_reader *r);
pm_status pm_scene_read_processes(pm_scene_reader *r);

// What makes a component: its weights, or its model and constants.
pm_status pm_scene_read_part_maker(pm_scene_reader *r, pm_yaml block,
                                   pm_scene_subsystem *subsystem);
pm_status pm_scene_read_port_maker(pm_scene_reader *r, pm_yaml block, pm_scene_port *port);

// A name: a letter, then letters, digits or '_'.
pm_status pm_scene_read_name(pm_scene_reader *r, pm_yaml at, const char **name);
// A path, resolved against the folder of the scene file.
pm_status pm_scene_read_path(pm_scene_reader *r, pm_yaml at, const char **path);
// Where a value stands, for errors found after the scene was read.
pm_status pm_scene_read_at(pm_scene_reader *r, pm_yaml value, const char **at);
// A list of columns, or a single one, in which "f[0:180]" stands for f0, f1, ... f179.
pm_status pm_scene_read_columns(pm_scene_reader *r, pm_yaml list, int *count,
                                pm_scene_named **result);
// Where each of them stands: at [count]. Columns of one range share the text.
pm_status pm_scene_read_places(pm_scene_reader *r, const pm_scene_named *list, int count,
                               const char **at);

// "a, b, c" in the buffer, for messages that name what exists.
const char *pm_scene_subsystem_names(const pm_scene *scene, char *buffer, size_t size);
const char *pm_scene_end_names(const pm_scene *scene, char *buffer, size_t size); // and loads
const char *pm_scene_group_names(const pm_layout *layout, char *buffer, size_t size);

pm_status pm_scene_no_memory(void);

#endif

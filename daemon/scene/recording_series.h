// The series of a recording (recording.h): which quantities it keeps, where they stand in the file,
// and the buffers between a sample and the file. The subsystems, or ports, that one key of the
// scene stands for share their series; the others have series of their own.
#ifndef PM_SCENE_RECORDING_SERIES_H
#define PM_SCENE_RECORDING_SERIES_H

#include "scene/recording.h"
#include "store/hdf5_io.h"

// One series of the file.
typedef struct pm_recorded_series {
    const char *path, *unit; // unit NULL: none is written
    int rank, extent[PM_HDF5_SERIES_RANK];
    int count;              // numbers per sample
    int rows;               // samples in a chunk of the file
    double *buffer;         // [depth][count]
    pm_hdf5_series in_file; // of the open file
} pm_recorded_series;

// Neighbours in the scene that share their series, or a single subsystem or port.
typedef struct pm_recorded_family {
    const char *name; // in the file
    int first, count; // positions in the scene
    bool is_range;    // the series have an axis for the members
} pm_recorded_family;

// The families of all subsystems and ports that a recording of a scene keeps.
typedef struct pm_recorded_families {
    int nsubsystem, nport;
    pm_recorded_family *subsystem, *port; // [nsubsystem], [nport]
} pm_recorded_families;

// Finds the families of a scene. Their arrays lie in the arena, their names in the scene.
// PM_ENOMEM.
pm_status pm_recorded_families_find(pm_recorded_families *families, pm_arena *arena,
                                    const pm_scene *scene);

typedef struct pm_recorded_list {
    pm_arena *arena;
    const pm_scene *scene;
    pm_recorded_families families;
    int count;
    pm_recorded_series *series; // [count] in the order in which a sample fills them
    int depth;                  // samples in a buffer
    int64_t bytes;              // by which the file grows at most when the buffers are written
} pm_recorded_list;

// Lists the series of a scene and makes their buffers in the arena. The scene is borrowed.
// PM_ENOMEM.
pm_status pm_recorded_list_init(pm_recorded_list *list, pm_arena *arena, const pm_scene *scene);
// Makes the series in an empty file, with the attributes that describe them. PM_EFILE, PM_ENOMEM.
pm_status pm_recorded_list_create(pm_recorded_list *list, pm_hdf5 *file);
// Opens the series of a file and truncates them to their first `count` samples. PM_EFILE.
pm_status pm_recorded_list_open(pm_recorded_list *list, pm_hdf5 *file, long count);
// Copies a sample to row `row`, less than depth, of all buffers.
void pm_recorded_list_put(const pm_recorded_list *list, int row, const pm_sample *sample);
// Appends the first `rows` rows of all buffers to the file. PM_EFILE.
pm_status pm_recorded_list_append(pm_recorded_list *list, int rows);

#endif

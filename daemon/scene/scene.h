// A scene: which subsystems there are, how ports join them, and how time is stepped. Topology, and
// the models that are known; what is learned comes from weights files (system.h).
// configs/double_pendulum.yaml shows the file format.
#ifndef PM_SCENE_SCENE_H
#define PM_SCENE_SCENE_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"
#include "model/spec.h"

// A member `x_at` is the place, "file:line:column", where the scene names x: for errors found
// later.
typedef struct pm_scene_subsystem {
    const char *name, *at;
    // Path of the weights, resolved against the scene's folder, or NULL: it has a known model.
    const char *weights, *weights_at; // at: of either
    const pm_part_spec *model;
    pm_layout layout;
    const char *group_at[PM_MAX_GROUPS];
    // [nz] dataset column of each component, e.g. "q1x"; NULL if the scene maps no columns.
    const char *const *column;
    const char *const *column_at;
    // [ngroup] a position measured from another subsystem's group: that subsystem (-1: none) and
    // group. The dataset's column then holds own + (that group's own column value).
    int relative_subsystem[PM_MAX_GROUPS];
    int relative_group[PM_MAX_GROUPS];
    const double *initial; // [nz] or NULL
    // Steps of its own between two exchanges, for multirate integrators.
    int substeps;
    const char *substeps_at;
    int first;   // of its first component in the concatenated state of the scene
    int process; // which process serves it
} pm_scene_subsystem;

// Subsystems that one process serves; by default each has its own, of the same name.
typedef struct pm_scene_process {
    const char *name;
    int count;
    int *subsystem; // [count] positions in the scene, rising
} pm_scene_process;

// One number that the world prescribes: itself, or a column of the dataset that a run follows.
typedef struct pm_scene_prescribed {
    double number;
    const char *column, *at; // column NULL: the number
} pm_scene_prescribed;

// The world's end of a port: what a neighbour would show there is prescribed over time
// (boundary_input.h).
typedef struct pm_scene_boundary_input {
    const char *name;
    pm_layout layout;
    bool entropy;                     // it prescribes dS
    const pm_scene_prescribed *value; // [3][layout.nz]: state, dE, dS
    int first;                        // of its values among those of all loads
} pm_scene_boundary_input;

typedef struct pm_scene_port {
    const char *name;
    const char *law, *law_at;
    const char *weights, *weights_at; // as of a subsystem
    const pm_port_spec *model;
    int subsystem[2];         // ends a and b; -1: a load
    int boundary_input[2];    // likewise; -1: a subsystem
    pm_layout layout[2];      // exposed groups of each end
    const char *expose_at[2]; // the list of them
    const int *component[2];  // [layout.nz] position of each exposed component in the end's state
} pm_scene_port;

typedef struct pm_scene {
    pm_arena arena;                     // owns all that follows
    const char *path;                   // as given
    const char *name;                   // letters, digits, '_' only
    const char *url, *url_at;           // the address at which processes meet, or NULL
    const char *key_file, *key_file_at; // of the messages' seals (transport/seal.h), or NULL: none
    double dt;                          // s
    int steps;
    const char *integrator, *integrator_at; // looked up later, by the layer that has the table
    int substeps;                           // per step; with a tolerance, the fewest
    double tolerance; // of a substep's error, relative; 0: substeps stay as they are
    int window;       // steps that a process may be ahead of another
    double patience;  // s to wait for a silent peer before giving up
    int checkpoint;   // steps between two snapshots of a process
    const char *reference, *reference_at; // dataset to compare with, or NULL
    int reference_trajectory;
    const char *reference_trajectory_at;        // the whole reference where no trajectory is named
    double energy_tolerance, entropy_tolerance; // relative residuals of the laws on a hard port
    double largest_drift;     // J, of the total energy, beyond which a run ends; infinite: none
    double largest_departure; // from the regions of training, in their widths, likewise
    int nsubsystem;
    pm_scene_subsystem *subsystem;
    int nboundary_input;
    pm_scene_boundary_input *boundary_input;
    int nport;
    pm_scene_port *port;
    int nprocess;
    pm_scene_process *process; // by their first subsystems
    int nz;                    // components of all subsystems
    int nprescribed;           // values of all loads
} pm_scene;

// Reads and checks a scene: keys, types, names, neighbours, units, ports. The caller frees it.
// PM_EFILE, PM_ECONFIG, PM_ENOMEM. Neither weights nor the reference need to exist.
pm_status pm_scene_load(pm_scene **scene, const char *path);
// The same from text, as if it stood in the file `path`.
pm_status pm_scene_parse(pm_scene **scene, const char *text, const char *path);
void pm_scene_free(pm_scene *scene); // NULL is allowed

// The position of a subsystem, load, port or process, or -1.
int pm_scene_find_subsystem(const pm_scene *scene, const char *name);
int pm_scene_find_boundary_input(const pm_scene *scene, const char *name);
int pm_scene_find_port(const pm_scene *scene, const char *name);
int pm_scene_find_process(const pm_scene *scene, const char *name);

// Returns the time in s after `step` steps of a run that begins at t0 (s): t0 + step dt. Every part
// of the program takes the time from here and never sums up steps, so that it has the same bits
// everywhere.
double pm_scene_time(const pm_scene *scene, double t0, long step);

// Whether the port's ends are served by different processes, which then exchange fluxes.
bool pm_scene_joins_processes(const pm_scene *scene, const pm_scene_port *port);

// Gives all subsystems to one process, "all". PM_ENOMEM.
pm_status pm_scene_join_processes(pm_scene *scene);

// The subsystem or load at one end of a port: its name, and all its groups.
const char *pm_scene_end_name(const pm_scene *scene, const pm_scene_port *port, int end);
const pm_layout *pm_scene_end_layout(const pm_scene *scene, const pm_scene_port *port, int end);

#endif

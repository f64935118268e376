// A scene: the subsystems, the ports that couple them, and the integration in time. It holds the
// content of the scene file: topology, settings and known models. Learned models come from weights
// files (system.h). The keys of the file are described in daemon/SCENE.md.
//
// Life cycle: pm_scene_load reads and checks a file; only pm_scene_merge_processes changes the
// scene afterwards; pm_scene_free releases it.
#ifndef PM_SCENE_SCENE_H
#define PM_SCENE_SCENE_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"
#include "model/spec.h"
#include "scene/integrator.h"
#include "store/names.h"

// In all structures below a member `x_at` is the place, "file:line:column", at which the scene
// gives x, for errors that are found after the scene was read.
typedef struct pm_scene_subsystem {
    const char *name, *at;
    const char *range;          // key that stands for it and others, "link[0:9]"; NULL: its name
    const char *weights;        // path, resolved against the scene's folder; NULL: a known model
    const pm_part_spec *model;  // known model; NULL: it comes from weights
    const char *weights_at;     // place of the weights or of the known model
    const char *mesh, *mesh_at; // file of the mesh of a solid; NULL: none
    pm_layout layout;           // groups of the state
    const char **group_at;      // [ngroup]
    const char *const *column;  // [nz] dataset column of each component; NULL: none are mapped
    const char *const *column_at;
    // [ngroup] subsystem and group from which a group is measured (relative_to); -1: none. A column
    // of the group in the dataset then holds the sum of the group's value and of the value in the
    // column of the other group.
    int *relative_subsystem;
    int *relative_group;
    // [ngroup] groups that are not measured. A fit looks for the initial value of such a group
    // around the guess, in the unit of the group, with this standard deviation (0: not given).
    bool *hidden;
    double *guess, *deviation;
    const double *initial; // [nz] state at step 0; NULL: not given
    int first;             // position of its first component in the concatenated state of the scene
    int process;           // position of the process that serves it
} pm_scene_subsystem;

// The subsystems that one process serves. By default each has its own process, of the same name.
typedef struct pm_scene_process {
    const char *name;
    int count;
    int *subsystem; // [count] positions in the scene, ascending
} pm_scene_process;

// A column of a boundary input is, between its samples (boundary_input.h), a polynomial through the
// nearest samples, the last sample, or a straight line from one sample to the next.
typedef enum pm_hold { PM_HOLD_SMOOTH, PM_HOLD_PREVIOUS, PM_HOLD_LINEAR } pm_hold;

// One prescribed number: a constant, or a column of the dataset that a run follows.
typedef struct pm_scene_prescribed {
    double number;
    const char *column, *at; // column NULL: the value is `number`
    pm_hold hold;            // of the column
    double delay;            // s: the column acts so much later than its samples say
} pm_scene_prescribed;

// The names of the values of pm_hold, which the scene's key `hold` takes, and a NULL.
extern const char *const pm_hold_names[];

// A boundary input prescribes, over time (boundary_input.h), the state and co-energies that the
// outside shows at its end of a port.
typedef struct pm_scene_boundary_input {
    const char *name;
    pm_layout layout;                 // groups that it prescribes
    bool entropy;                     // it prescribes a dS
    const pm_scene_prescribed *value; // [3][layout.nz] state, dE, dS
    int first;                        // position of its values among those of all boundary inputs
} pm_scene_boundary_input;

// The type of a number in a message of a live input, where numbers are big-endian.
typedef enum pm_live_type {
    PM_LIVE_DOUBLE,
    PM_LIVE_FLOAT,
    PM_LIVE_INTEGER, // with a sign
    PM_LIVE_BYTE     // without a sign
} pm_live_type;

#define PM_LIVE_HEAD 8 // bytes before the first field of such a message: its type's fingerprint

// The place of a number in a message.
typedef struct pm_live_place {
    pm_live_type type;
    int size;   // bytes of the number; 0: the message has no such number
    int offset; // bytes from the start of the message
} pm_live_place;

// A live input: values that a program sends on a channel while the run goes on
// (lockstep/live_inputs.h). Boundary inputs refer to them by name, as to columns of a dataset.
typedef struct pm_scene_live_input {
    const char *channel, *at;
    int count;            // values
    const char **name;    // [count]
    pm_live_place *place; // [count]
    pm_live_place step;   // where the message has the number of the step for which it holds
    size_t least_size;    // bytes of a message that holds all fields
    bool own_type;        // the messages are of portmet's type input_t, and have exactly that size
    bool waits;           // each step waits for the message of that step; else the newest holds
    bool starts;          // `start` holds until the first message; else the run waits for it
    double *start;        // [count]
    double age;           // s, without a message, after which the run fails; infinite: never
    int first;            // position of its values among those of all live inputs
} pm_scene_live_input;

// A port joins ends a (0) and b (1), which are two subsystems, or a subsystem and a boundary input.
typedef struct pm_scene_port {
    const char *name;
    const char *range;                // key that stands for it and others; NULL: its name
    const char *between[2];           // names of the ends as the file has them: "link[i]"
    const char *law, *law_at;         // name of the port law (model/laws)
    const char *weights, *weights_at; // path of the weights; NULL: a known model
    const pm_port_spec *model;        // known model; NULL: it comes from weights
    int subsystem[2];                 // position in the scene; -1: a boundary input
    int boundary_input[2];            // position in the scene; -1: a subsystem
    pm_layout layout[2];              // exposed groups of each end
    const char *expose_at[2];         // place of the list of exposed groups
    const int *component[2];          // [layout.nz] exposed components in the end's state
} pm_scene_port;

// A column of measurements that is a function of the state instead of a component of it. Its
// formula may name groups "subsystem.group" and co-energies "subsystem.dE.group".
typedef struct pm_scene_observation {
    const char *column;
    pm_formula formula;
} pm_scene_observation;

// The equations: subsystems, the ports between them, and how time is discretised.
typedef struct pm_physics {
    double dt;                       // s, of a step
    const pm_integrator *integrator; // of the table in integrator.h; nobody frees it
    const char *integrator_at;
    int substeps;     // of a step; with a tolerance, their smallest number
    double tolerance; // relative error of a substep; 0: substeps are fixed
    int nsubsystem;
    pm_scene_subsystem *subsystem; // [nsubsystem]
    int nboundary_input;
    pm_scene_boundary_input *boundary_input; // [nboundary_input]
    int nport;
    pm_scene_port *port; // [nport]
    int nz;              // components of all subsystems
    int nprescribed;     // values of all boundary inputs
    // The names of all subsystems and ports, sorted; empty until the reader has read them all.
    pm_names subsystem_names, port_names;
    // The ends of ports at each subsystem as numbers 2 * port + end, in ascending order. Those of
    // subsystem i begin at end_at[first_end[i]] and end before end_at[first_end[i + 1]].
    int *first_end, *end_at; // [nsubsystem + 1], [2 nport]
    // An upper bound on the number of ports between any two subsystems; INT_MAX if there are two
    // that no ports connect.
    int diameter;
} pm_physics;

// Returns the position among all prescribed values of what a boundary input shows to an end of a
// port: entry k [3][layout.nz] of its state, dE and dS. -1: a subsystem is at this end.
static inline int pm_physics_shown(const pm_physics *physics, const pm_scene_port *port, int end,
                                   int k) {
    const int ny = port->layout[end].nz, id = port->boundary_input[end];
    const pm_scene_boundary_input *input = id >= 0 ? &physics->boundary_input[id] : NULL;
    return input == NULL ? -1
                         : input->first + k / ny * input->layout.nz + port->component[end][k % ny];
}

// Returns true if the number of substeps of each step follows from the error that a step estimates.
static inline bool pm_physics_is_adaptive(const pm_physics *physics) {
    return physics->tolerance > 0;
}

// A run of these equations: how long, from where, what it is compared with, when it ends, and what
// its recording keeps.
typedef struct pm_run {
    int steps;
    double pace;                          // simulated s per s of the clock; 0: as fast as possible
    const char *reference, *reference_at; // dataset to compare with; NULL: none
    int reference_trajectory;
    // s: the reference holds measurements, whose first seconds determine the initial state. 0: the
    // reference holds states
    double reference_estimate;
    const char *reference_trajectory_at; // place of `reference` if the scene names no trajectory
    int nobservation;
    pm_scene_observation *observation;          // [nobservation]
    double energy_tolerance, entropy_tolerance; // largest relative residuals of a hard port
    // A run ends when the total energy has drifted by more than largest_drift (J), or when a state
    // is further from its training range than largest_departure times the width of the range.
    // Infinite: there is no limit.
    double largest_drift, largest_departure;
    bool outlives_recording; // a run whose recording cannot be written goes on without it
    bool *recorded;          // [nsubsystem] whether a recording keeps it; NULL: it keeps all
    int record_every;        // steps between two samples of a recording
} pm_run;

// The processes that serve a scene, and how they reach each other and the outside.
typedef struct pm_network {
    const char *url, *url_at; // address at which processes meet; NULL: not given
    int ntap;
    const char **tap; // [ntap] patterns of channels that are repeated where listeners hear the run
    const char *key_file, *key_file_at; // key that seals messages (transport/seal.h); NULL: none
    int window;      // steps granted beyond the last step that all processes have completed
    double patience; // s to wait for a silent peer before giving up
    int checkpoint;  // steps between two checkpoints of a process
    int nlive_input;
    pm_scene_live_input *live_input; // [nlive_input]
    int nlive;                       // values of all live inputs
    int nprocess;
    pm_scene_process *process; // [nprocess] in the order of their first subsystems
} pm_network;

typedef struct pm_scene {
    pm_arena arena;   // owns all that follows
    const char *path; // as given to pm_scene_load
    const char *name; // letters, digits, '_' only
    // The system of the world that the scene describes, as the weights of its fits record it; NULL:
    // not said.
    const char *system;
    pm_physics physics;
    pm_run run;
    pm_network network;
} pm_scene;

// Reads the scene file at `path` and checks keys, types, names, units, neighbours and ports. The
// caller frees the scene. Neither the weights nor the reference need to exist. PM_EFILE: the file
// cannot be read. PM_ECONFIG: it is not a scene; the message begins with the place. PM_ENOMEM.
pm_status pm_scene_load(pm_scene **scene, const char *path);
// Reads a scene from text, as if the text were the file `path`. It fails as pm_scene_load does.
pm_status pm_scene_parse(pm_scene **scene, const char *text, const char *path);
void pm_scene_free(pm_scene *scene); // NULL is allowed

// Return the position of the subsystem, boundary input, port or process of this name, or -1.
int pm_scene_find_subsystem(const pm_scene *scene, const char *name);
int pm_scene_find_boundary_input(const pm_scene *scene, const char *name);
int pm_scene_find_port(const pm_scene *scene, const char *name);
int pm_scene_find_process(const pm_scene *scene, const char *name);
// The position of a value of this name among the values of all live inputs.
int pm_scene_find_live(const pm_scene *scene, const char *name);

// Returns the time in s after `step` steps of a run: step dt. All code computes times with this
// function instead of summing up steps, so that times are bitwise the same in all processes.
double pm_scene_time(const pm_scene *scene, long step);

// Returns true if the state has a group that nobody measures.
bool pm_scene_hides(const pm_scene *scene);

// Return true if a recording keeps a subsystem, or a port. It keeps a port if it keeps the
// subsystem at one of its ends.
bool pm_scene_records(const pm_scene *scene, int subsystem);
bool pm_scene_records_port(const pm_scene *scene, int port);

#define PM_SCENE_MOST_STATE 1000000 // components of a scene

// A scene with more subsystems than this reports sums instead of every subsystem, unless somebody
// records it or compares it with a reference. Of its subsystems the first PM_SCENE_LISTED are
// listed one by one all the same.
#define PM_SCENE_MOST_REPORTED 1000
#define PM_SCENE_LISTED 64

// Returns true if the processes of a scene may report sums.
bool pm_scene_may_report_sums(const pm_scene *scene);
// Returns true if a report of sums holds the numbers of a subsystem as well: it is one of the
// first, or it has a port to another process.
bool pm_scene_lists_subsystem(const pm_scene *scene, int id);

// Returns true if different processes serve the two ends of a port. These processes then exchange
// fluxes.
bool pm_port_crosses_processes(const pm_scene *scene, const pm_scene_port *port);

// Replaces all processes by a single one, "all", which serves every subsystem. PM_ENOMEM.
pm_status pm_scene_merge_processes(pm_scene *scene);

// Return the name, and the layout with all groups of variables, of the subsystem or boundary input
// at end `end` (0 or 1) of a port. The scene owns the results.
const char *pm_scene_end_name(const pm_scene *scene, const pm_scene_port *port, int end);
const pm_layout *pm_scene_end_layout(const pm_scene *scene, const pm_scene_port *port, int end);

#endif

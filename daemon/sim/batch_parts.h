// The parts of a batch. Only the files that implement batch.h include this header:
//     batch.c         opens and steps it, and fills samples
//     batch_layout.c  groups subsystems and ports, and lays out their arrays
//     batch_part.c    evaluates the subsystems of one model
//     batch_port.c    evaluates the ports of one model
#ifndef PM_SIM_BATCH_PARTS_H
#define PM_SIM_BATCH_PARTS_H

#include "graph/program.h"
#include "model/training_range.h"
#include "sim/batch.h"
#include "sim/lanes.h"

// The subsystems of one model, `width` in a block. Lanes behind the last subsystem repeat its
// initial state and do not move. The arrays are pieces of the batch's: [nblock][nz][width], or
// [nblock][width] for one number for each lane.
typedef struct pm_batch_part {
    int count, width, nblock, nz;
    const int *id;    // [count] positions in the scene, ascending
    pm_layout layout; // of the state
    pm_training_range range;
    double *z, *stage_z, *safe_z; // after the last substep, at the present stage, after the step
    double *dE, *dS;              // at stage_z; dS is NULL without entropy
    double *rate;                 // of the bulk term
    double *one;                  // [nz] the state of one subsystem, while it is checked
    double *E, *S;                // S is NULL without entropy
    uint64_t *changed;            // not 0: stage_z has changed since the last exposure
    uint64_t *renewed;            // not 0: an input of the bulk term has changed since its last run
    long *evaluated;              // exposures and bulk terms so far
    long *outside;                // steps outside the training range so far
    pm_lane_flux bulk;            // of the step under way
    pm_program *exposure;         // z -> E, S, dE, dS
    double *exposure_z;
    const double *exposure_E, *exposure_S, *exposure_dE, *exposure_dS;
    pm_program *bulk_term; // z, dE, dS -> rate; NULL: there is none
    double *bulk_z, *bulk_dE, *bulk_dS;
    const double *bulk_rate;
} pm_batch_part;

// One end of the ports of one model.
typedef struct pm_batch_end {
    int ny;
    const int *component;   // [ny] of the state of its subsystem
    int *first, *step;      // [nblock width] where the subsystem's state begins, and its width
    double *input[3];       // y, e, eta of the program; NULL: it does not depend on it
    const double *law_rate; // result of the program
    double *shown;          // [nblock][3][ny][width] y, e, eta that the end shows
    double *rate;           // [nblock][ny][width]
    pm_lane_flux flux;      // into this end, during the step under way
} pm_batch_end;

// The ports of one model.
typedef struct pm_batch_port {
    int count, width, nblock;
    const int *id; // [count] positions in the scene, ascending
    bool entropy[2];
    pm_batch_end end[2];
    bool known;        // the results belong to the inputs
    uint64_t *renewed; // [width]
    long *evaluated;   // [nblock width] so far
    pm_program *law;
} pm_batch_port;

// Where the lane of a subsystem or port is.
typedef struct pm_batch_place {
    int group, lane; // lane counts through all blocks of the group
} pm_batch_place;

struct pm_batch {
    const pm_system *system; // borrowed
    const pm_integrator *integrator;
    double h; // s, length of a substep
    pm_arena arena;
    int npart, nport;
    pm_batch_part *part;                     // [npart]
    pm_batch_port *port;                     // [nport]
    int64_t size;                            // numbers of a state, with all lanes
    double *z, *stage_z, *safe_z, *dE, *dS;  // [size] of all groups
    double *k;                               // [nstage][size] rates of the stages
    pm_batch_place *part_at;                 // [scene->nsubsystem]
    pm_batch_place *port_at;                 // [scene->nport]
    long part_calls, bulk_calls, port_calls; // graphs that a subsystem, and each of its ports, had
    bool exposed;                            // dE and dS belong to stage_z
    long step;
};

// Builds the graphs of a group, of which count, width, nblock, nz, id and the arrays are set. The
// program stays NULL if a batch cannot serve it. PM_ENOMEM.
pm_status pm_batch_part_open(pm_batch_part *part, pm_arena *arena, const pm_system *system);
void pm_batch_part_close(pm_batch_part *part);
// Evaluates E, S, dE and dS where stage_z has changed.
void pm_batch_part_expose(pm_batch_part *part);
// Sets k [nblock][nz][width] to the bulk term, and adds its fluxes, times `weight`, to the sums.
void pm_batch_part_bulk(pm_batch_part *part, double weight, double *k);
// Checks subsystem number `lane` of the group at the end of a step, as pm_subsystem_end_step does.
pm_status pm_batch_part_check(const pm_batch_part *part, const pm_scene *scene, int lane,
                              long step);

// Likewise for ports, with count, width, nblock, id and the ends' component, first and step set.
pm_status pm_batch_port_open(pm_batch_port *port, pm_arena *arena, const pm_system *system);
void pm_batch_port_close(pm_batch_port *port);
// Evaluates the law at the values that all ends show, and adds the fluxes to the sums.
void pm_batch_port_couple(pm_batch_port *port, const pm_batch *batch, double weight);

// Lanes of a block: enough that the start of an operation does not count, few enough that a graph's
// numbers stay in the cache.
#define PM_BATCH_MOST_LANES 64

// Group the subsystems and ports of the batch's system, take their arrays from its arena, and open
// the groups. Subsystems come first. PM_ENOMEM. PM_ECONFIG: there are too many numbers.
pm_status pm_batch_open_parts(pm_batch *batch);
pm_status pm_batch_open_ports(pm_batch *batch);

#endif

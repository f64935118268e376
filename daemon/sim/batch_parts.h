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

// A part of a batch: a group of subsystems with the same model, in `nblock` blocks of `width`
// lanes. Each lane holds one subsystem. Lanes behind the last subsystem repeat its initial state
// and do not move. Arrays of states, co-energies and rates are [nblock][nz][width]; arrays of one
// number for each lane are [nblock][width]. All arrays lie in the batch's arena; z, stage_z,
// safe_z, dE and dS are pieces of the batch's arrays of these names.
typedef struct pm_batch_part {
    int count, width, nblock, nz;
    const int *id;    // [count] positions in the scene, ascending
    pm_layout layout; // of the state
    pm_training_range range;
    // States after the last substep, at the present stage, and after the last completed step.
    double *z, *stage_z, *safe_z;
    double *dE, *dS;      // at stage_z; dS stays zero without entropy
    double *rate;         // of the bulk term
    double *one;          // [nz] the state of one subsystem, while it is checked
    double *E, *S;        // J and J/K, at stage_z; S stays zero without entropy
    uint64_t *changed;    // not 0: stage_z has changed since the last exposure
    uint64_t *renewed;    // not 0: an input of the bulk term has changed since its last run
    long *evaluated;      // exposures and bulk terms evaluated so far in this run
    long *outside;        // steps of this run that ended outside the training range
    pm_lane_flux bulk;    // fluxes of the bulk term during the present step
    pm_program *exposure; // computes E, S, dE, dS from z, for one block
    double *exposure_z;   // input of `exposure`
    const double *exposure_E, *exposure_S, *exposure_dE, *exposure_dS; // results; NULL: no entropy
    pm_program *bulk_term; // computes the rate from z, dE, dS, for one block; NULL: no bulk term
    double *bulk_z, *bulk_dE, *bulk_dS; // inputs of `bulk_term`; NULL: it does not depend on them
    const double *bulk_rate;            // result of `bulk_term`
} pm_batch_part;

// One end of the ports of one group.
typedef struct pm_batch_end {
    int ny;
    const int *component; // [ny] exposed components of the state of the end's subsystem
    // [nblock width] each: where the subsystem's state begins in the arrays of the batch, and the
    // distance there between two components, which is the width of the subsystem's group.
    int *first, *step;
    double *input[3];       // inputs y, e, eta of the law; NULL: the law does not depend on it
    const double *law_rate; // result of the law: the rate of y
    double *shown;          // [nblock][3][ny][width] y, e, eta that the end exposes
    double *rate;           // [nblock][ny][width] rate of y
    pm_lane_flux flux;      // fluxes into the subsystem through this end during the present step
} pm_batch_end;

// A group of ports with the same model, in `nblock` blocks of `width` lanes.
typedef struct pm_batch_port {
    int count, width, nblock;
    const int *id;   // [count] positions in the scene, ascending
    bool entropy[2]; // whether the subsystem at each end has an entropy
    pm_batch_end end[2];
    bool known;        // the law has been evaluated at least once in this run
    uint64_t *renewed; // [width] not 0: an input of the law has changed; work space for one block
    long *evaluated;   // [nblock width] evaluations of the law so far in this run
    pm_program *law;   // computes the rates of both ends, for one block
} pm_batch_port;

// The place of a subsystem or port in a batch.
typedef struct pm_batch_place {
    int group; // index in part or port of pm_batch
    int lane;  // counted through all blocks of the group
} pm_batch_place;

struct pm_batch {
    const pm_system *system; // borrowed
    const pm_integrator *integrator;
    double h; // s, length of a substep
    pm_arena arena;
    int npart, nport;
    pm_batch_part *part;                    // [npart]
    pm_batch_port *port;                    // [nport]
    int64_t size;                           // number of components of all lanes of all parts
    double *z, *stage_z, *safe_z, *dE, *dS; // [size] of all parts, one after the other
    double *k;                              // [nstage][size] rates of the stages
    pm_batch_place *part_at;                // [scene->nsubsystem]
    pm_batch_place *port_at;                // [scene->nport]
    // How often in this run each subsystem's exposure and bulk term, and each port's law, could
    // have been evaluated.
    long part_calls, bulk_calls, port_calls;
    bool exposed; // dE and dS belong to stage_z
    long step;    // steps completed in this run
};

// Builds the graphs of a part and takes its other arrays from the arena. The caller has set
// `count`, `width`, `nblock`, `nz`, `id`, `z`, `stage_z`, `safe_z`, `dE` and `dS`, and closes the
// part, after a failure too. Returns PM_OK with part->exposure NULL if a batch cannot serve the
// model of this part. PM_ENOMEM.
pm_status pm_batch_part_open(pm_batch_part *part, pm_arena *arena, const pm_system *system);
void pm_batch_part_close(pm_batch_part *part);
// Evaluates E, S, dE and dS of the blocks in which stage_z has changed.
void pm_batch_part_expose(pm_batch_part *part);
// Sets k [nblock][nz][width] to the rate of the bulk term, in the units of z per s, and adds the
// fluxes of this rate, times `weight`, to part->bulk. `weight` is the weight of the present stage
// in the mean over the step.
void pm_batch_part_bulk(pm_batch_part *part, double weight, double *k);
// Checks the subsystem in lane number `lane` of the part at the end of step number `step`, as
// pm_subsystem_end_step does. PM_ENUMERIC: its state or a potential is not finite, or its state is
// further outside the training range than the scene's guard allows.
pm_status pm_batch_part_check(const pm_batch_part *part, const pm_scene *scene, int lane,
                              long step);

// Builds the graph of a group of ports and takes its other arrays from the arena. The caller has
// set `count`, `width`, `nblock`, `id` and `entropy`, and in both ends `ny`, `component`, `first`
// and `step`, and closes the port, after a failure too. Returns PM_OK with port->law NULL if a
// batch cannot serve the model of this port. PM_ENOMEM.
pm_status pm_batch_port_open(pm_batch_port *port, pm_arena *arena, const pm_system *system);
void pm_batch_port_close(pm_batch_port *port);
// Gathers what both ends of every port expose, evaluates the law of the blocks in which an input
// has changed, and adds the fluxes through each end, times `weight`, to the end's `flux`. The rates
// stay in the ends.
void pm_batch_port_couple(pm_batch_port *port, const pm_batch *batch, double weight);

// The largest number of lanes of a block. So many lanes make the cost of starting an operation
// negligible, and so few keep the values of a graph in the cache.
#define PM_BATCH_MOST_LANES 64

// Group the subsystems, and the ports, of the batch's system, take the arrays from the batch's
// arena, and open all groups. pm_batch_open_parts must be called first. PM_ENOMEM. PM_ECONFIG, from
// pm_batch_open_parts: the states have more components than an int can count.
pm_status pm_batch_open_parts(pm_batch *batch);
pm_status pm_batch_open_ports(pm_batch *batch);

#endif

// The parts of a batch. Only the files that implement batch.h include this header:
//     batch.c         opens and steps it, and fills samples
//     batch_layout.c  groups subsystems and ports, and lays out their arrays
//     batch_part.c    evaluates the subsystems of one model
//     batch_port.c    evaluates the ports of one model
//     batch_substep.c ends substeps: adaptive steps and balanced integrators
//     batch_remote.c  exchanges the values of ports with other processes
//     batch_record.c  saves and restores it
//     batch_tally.c   sums up a step for the ledger
#ifndef PM_SIM_BATCH_PARTS_H
#define PM_SIM_BATCH_PARTS_H

#include "graph/program.h"
#include "model/training_range.h"
#include "sim/batch.h"
#include "sim/invariant_projection.h"
#include "sim/lanes.h"

// The states at which the subsystems of a batch are, or the co-energies there.
typedef enum pm_batch_shown { PM_SHOWN_Z, PM_SHOWN_DE, PM_SHOWN_DS, PM_SHOWN_COUNT } pm_batch_shown;

// A part of a batch: a group of subsystems with the same model, in `nblock` blocks of `width`
// lanes. Each lane holds one subsystem. Lanes behind the last subsystem repeat its initial state
// and do not move. Arrays of states, co-energies and rates are [nblock][nz][width]; arrays of one
// number for each lane are [nblock][width]. All arrays lie in the batch's arena. Those of the batch
// (pm_batch) hold all parts one after the other.
typedef struct pm_batch_part {
    int count, width, nblock, nz;
    const int *id;      // [count] positions in the scene, ascending
    int64_t first;      // where the part begins in the batch's arrays of states
    int64_t first_lane; // where it begins in the batch's arrays of one number for each lane
    pm_layout layout;   // of the state
    pm_training_range range;
    double *one;          // [nz] the state of one subsystem, while it is checked
    double *E, *S;        // J and J/K, at stage_z; S stays zero without entropy
    double *rate;         // of the bulk term, where `kept` says so
    bool *kept;           // [nblock] rate holds the bulk term of a block that rests
    long *rested;         // exposures and bulk terms that were not needed so far in this run
    long *outside;        // steps of this run that ended outside the training range
    pm_lane_flux bulk;    // fluxes of the bulk term during the last step
    pm_program *exposure; // computes E, S, dE, dS from z, for one block
    double *exposure_z;   // input of `exposure`
    const double *exposure_E, *exposure_S, *exposure_dE, *exposure_dS; // results; NULL: no entropy
    pm_program *bulk_term; // computes the rate from z, dE, dS, for one block; NULL: no bulk term
    double *bulk_input[PM_SHOWN_COUNT]; // z, dE, dS; NULL: the bulk term does not depend on it
    const double *bulk_rate;            // result of `bulk_term`
    // Scenes with a tolerance have these; others have NULL. They are the largest relative error of
    // a substep in the present step, and [ngroup][nblock][width] the largest length that each group
    // has had.
    double *error, *size;
    // Balanced integrators have these; others have NULL. They are the projection now and after the
    // last successful step, and exposures in this run beyond one for each stage.
    pm_invariant_projection *projection, *safe_projection;
    long *again;
    double *lane_values; // [4 nz] the numbers of one lane
    double *coupled;     // [PM_SHOWN_COUNT][nz][width] what a block showed when it was coupled last
} pm_batch_part;

// One end of the ports of one group.
typedef struct pm_batch_end {
    int ny;
    const int *component;          // [ny] exposed components of the state of the end's subsystem
    uint64_t wanted;               // bit c % 64 is set for each component c
    pm_lane_places place;          // [nblock width] the subsystem at the end of each port
    bool is_input[PM_SHOWN_COUNT]; // whether the law depends on y, e, eta
    // [ny][width] y, e and eta of the present block, which are the inputs of the law; NULL: neither
    // the law nor the fluxes need it.
    double *shown[PM_SHOWN_COUNT];
    const double *law_rate; // result of the law: the rate of y
    double *rate;           // [nblock][ny][width] rate of y, where `kept` says so
    pm_lane_flux flux;      // fluxes into the subsystem through this end during the last step
} pm_batch_end;

// In which order the rates of a block of ports are added to the subsystems, so that each subsystem
// sums them up in the scene's order.
typedef enum pm_batch_order {
    PM_ORDER_A_FIRST,     // all ends A, then all ends B
    PM_ORDER_B_FIRST,     // all ends B, then all ends A
    PM_ORDER_PORT_BY_PORT // both ends of the first port, then those of the second one, ...
} pm_batch_order;

// A group of ports with the same model, in `nblock` blocks of `width` lanes.
typedef struct pm_batch_port {
    int count, width, nblock;
    const int *id;   // [count] positions in the scene, ascending
    bool entropy[2]; // whether the subsystem at each end has an entropy
    pm_batch_end end[2];
    unsigned char *order; // [nblock] a pm_batch_order each
    bool *kept;           // [nblock] `rate` of both ends holds what the law gives in the block
    long *rested;         // [nblock width] evaluations of the law that were not needed in this run
    pm_program *law;      // computes the rates of both ends, for one block
} pm_batch_port;

// The place of a subsystem or port in a batch.
typedef struct pm_batch_place {
    int group; // index in part or port of pm_batch; PM_BATCH_NOWHERE: in another process
    int lane;  // counted through all blocks of the group; of a subsystem in another process the
               // index of its ghost, or PM_BATCH_NOWHERE
} pm_batch_place;

#define PM_BATCH_NOWHERE (-1)

// An address says where the numbers of a subsystem or of a ghost lie in the batch's arrays:
// component c of its state is number `first` + c `step`, and its lane, counted through all parts,
// is `lane`.
typedef struct pm_batch_address {
    int first, step, lane;
} pm_batch_address;

// An end of a port at a subsystem of the batch, if the subsystem at the port's other end is in
// another process.
typedef struct pm_batch_remote {
    int port, end;               // position in the scene; 0: end A, 1: end B
    pm_batch_address own, ghost; // of the subsystem at this end, and of what the other end shows
    pm_flux flux;                // into the subsystem through this end during the last step
    pm_flux hidden[2];           // scratch of pm_batch_tally
} pm_batch_remote;

struct pm_batch {
    const pm_system *system; // borrowed
    int count;               // number of subsystems
    const int *id;           // [count] their positions in the scene, borrowed
    const pm_integrator *integrator;
    int substeps; // of the present step
    double h;     // s, length of a substep
    pm_arena arena;
    int npart, nport;
    pm_batch_part *part; // [npart]
    pm_batch_port *port; // [nport]
    int njoint;
    int *joint; // [njoint] positions in the scene of all ports at these subsystems, ascending
    int nghost;
    int *ghost_first; // [nghost] where the ghost begins in the batch's arrays of states
    double *ghost_z;  // [size - parts_size] what the ghosts have shown last of z
    int nremote;
    pm_batch_remote *remote; // [nremote] by subsystem, then by port, as in the scene
    int64_t size;            // number of components of all lanes of all parts, and of all ghosts
    int64_t lanes;           // number of lanes of all parts, and of ghosts
    int64_t parts_size, parts_lanes; // the same without ghosts, which lie behind all parts
    double *state[3];                // [size] each: memory for the states below
    // States after the last substep, at the present stage, and after the last completed step. Each
    // is one of `state`, two may be the same.
    double *z, *stage_z, *safe_z;
    double *dE, *dS; // [size] at stage_z; dS stays zero without entropy
    double *k;       // [nstage][size] rates of the stages
    // [lanes] bit c % 64 is set if component c of z, dE or dS changed in the last exposure.
    uint64_t *renewed[PM_SHOWN_COUNT];
    pm_batch_place *part_at; // [scene->nsubsystem]
    pm_batch_place *port_at; // [scene->nport]
    // Every subsystem has its ports in the order of the groups of ports. Otherwise the rates of all
    // ports are kept, and added port by port in the scene's order.
    bool ordered;
    // How often in this run each subsystem's exposure and bulk term, and each port's law, could
    // have been evaluated.
    long part_calls, bulk_calls, port_calls;
    bool doubtful;      // a check of the present step has found something
    int substep, stage; // of the present round
    long step;          // steps completed in this run
    pm_flux *flux;      // [largest number of ports of a subsystem] of pm_batch_books
};

// Returns the address of a subsystem of the batch, or of the ghost of another one.
static inline pm_batch_address pm_batch_address_of(const pm_batch *b, int id) {
    const pm_batch_place at = b->part_at[id];
    if (at.group == PM_BATCH_NOWHERE) {
        return (pm_batch_address){b->ghost_first[at.lane], 1, (int)b->parts_lanes + at.lane};
    }
    const pm_batch_part *p = &b->part[at.group];
    const int64_t block = p->first + (int64_t)(at.lane / p->width) * p->nz * p->width;
    return (pm_batch_address){(int)block + at.lane % p->width, p->width,
                              (int)p->first_lane + at.lane};
}

// Exposes all subsystems at z, as if they had never been exposed.
void pm_batch_expose_anew(pm_batch *b);
// Sets all counts and fluxes to those of step 0.
void pm_batch_clear(pm_batch *b);

// Finds the ports between the batch and other processes. It sets `remote`, `nremote`, `nghost` and
// the places of the ghosts in part_at, with memory from the batch's arena. PM_ENOMEM.
pm_status pm_batch_find_remote(pm_batch *b);
// Sets the addresses in `remote` when all arrays have been laid out.
void pm_batch_open_remote(pm_batch *b);
// Keeps the fluxes through the remote ends during the step that ends.
void pm_batch_keep_remote_fluxes(pm_batch *b);

// Builds the graphs of a part and takes its other arrays from the arena. The caller has set
// `count`, `width`, `nblock`, `nz`, `id`, `first` and `first_lane`, and closes the part, after a
// failure too. Returns PM_OK with part->exposure NULL if a batch cannot serve the model of this
// part. PM_ENOMEM.
pm_status pm_batch_part_open(pm_batch_part *part, pm_arena *arena, const pm_system *system);
void pm_batch_part_close(pm_batch_part *part);
// Evaluates E, S, dE and dS of a block if its stage_z has changed, which b->renewed[PM_SHOWN_Z]
// says, and notes in b->renewed what has changed of dE and dS.
void pm_batch_part_expose(pm_batch *b, pm_batch_part *part, int block);
// Sets k [nblock][nz][width] to the rate of the bulk term, in the units of z per s, and adds the
// fluxes of this rate, times `weight`, to part->bulk, which counts as zero if `anew` is true.
// `weight` is the weight of the present stage in the mean over the step.
void pm_batch_part_bulk(const pm_batch *b, pm_batch_part *part, double weight, bool anew,
                        double *k);
// Checks the subsystem in lane number `lane` of the part at the end of step number `step`, as
// pm_subsystem_end_step does. PM_ENUMERIC: its state or a potential is not finite, or its state is
// further outside the training range than the scene's guard allows.
pm_status pm_batch_part_check(const pm_batch *b, const pm_batch_part *part, int lane, long step);

// Takes the arrays that the end of a substep needs from the arena, for a part that is open.
// PM_ENOMEM.
pm_status pm_batch_substep_open(pm_batch_part *part, pm_arena *arena, const pm_scene *scene);
// Starts a run: the subsystems have the potentials part->E and part->S.
void pm_batch_substep_start(pm_batch_part *part);
// Keep the projections at the end of a successful step, and return to them after a step that
// failed.
void pm_batch_substep_keep(pm_batch_part *part);
void pm_batch_substep_return(pm_batch_part *part);
// Estimates the errors of the substep that begins at b->z with the rates b->k, for a block.
void pm_batch_substep_estimate(const pm_batch *b, pm_batch_part *part, int block);
// Adds the energy and entropy that flow at the present stage, where the states are z, to the totals
// of the projections of a block.
void pm_batch_substep_book(const pm_batch *b, pm_batch_part *part, int block, const double *z);
// Moves the new states b->stage_z of a block, which has been exposed, to the energy and entropy
// that follow from the fluxes, and exposes them. The substep begins at b->z.
void pm_batch_substep_project(pm_batch *b, pm_batch_part *part, int block, bool ends_step);

// Builds the graph of a group of ports and takes its other arrays from the arena. The caller has
// set `count`, `width`, `nblock`, `id` and `entropy`, and in both ends `ny`, `component`, `wanted`
// and `place`, and closes the port, after a failure too. Returns PM_OK with port->law NULL if a
// batch cannot serve the model of this port. PM_ENOMEM.
pm_status pm_batch_port_open(pm_batch_port *port, pm_arena *arena, const pm_system *system);
void pm_batch_port_close(pm_batch_port *port);
// Gathers what both ends of every port expose, evaluates the law of the blocks in which an input
// has changed, adds the fluxes through each end, times `weight`, to the end's `flux`, which counts
// as zero if `anew` is true, and adds the rates to k if the batch is ordered.
void pm_batch_port_couple(const pm_batch *b, pm_batch_port *port, double weight, bool anew,
                          double *k);
// Adds the rates of all ports to k, port by port in the scene's order, for a batch that is not
// ordered.
void pm_batch_ports_add(const pm_batch *b, double *k);

// The largest number of lanes of a block. So many lanes make the cost of starting an operation
// negligible, and so few keep the values of a graph in the cache.
#define PM_BATCH_MOST_LANES 64

// Group the subsystems, and the ports, of the batch's system, take the arrays from the batch's
// arena, and open all groups. pm_batch_open_parts must be called first. PM_ENOMEM. PM_ECONFIG, from
// pm_batch_open_parts: the states have more components than an int can count.
pm_status pm_batch_open_parts(pm_batch *batch);
pm_status pm_batch_open_ports(pm_batch *batch);

#endif

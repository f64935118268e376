// The engine that steps the subsystems of one process (local_subsystems.h): a model, which is
// constant once it was opened, and its data, which change. Only the files of the engine include
// this header:
//     kind.c    what each kind of subsystem does: graph, graph with contact, solid, gap
//     model.c   groups subsystems and ports, lays out their arrays, opens the graphs of laws
//     couple.c  evaluates the laws of ports
//     method.c  what each family of integrators does in a round: Runge-Kutta, discrete gradient
//     step.c    the rounds of a step, its end, results, and checkpoints
// Calls go in one direction: step.c calls method.c, couple.c and model.c; model.c calls kind.c.
//
// Subsystems with the same model form a group, and so do ports with the same model. A group is
// divided into blocks of `width` lanes; each lane is one subsystem or port. Arrays of states,
// co-energies and rates are [nblock][nz][width] for each group, with the lane as their last index,
// so that one run of a graph serves all lanes of a block. Arrays of one number for each subsystem
// are indexed by its lane, counted through all groups. Indices, not pointers, lead from a port to
// its ends. Lanes behind the last member of a group repeat it and do not move.
//
// A group of few members has a width of 1. Some kinds, and implicit methods, need a group for each
// subsystem. All widths give a subsystem the same bits, fluxes, and counts of evaluated and skipped
// graphs. A block is not evaluated if no input of its lanes has changed.
//
// A *ghost* takes the place of what the engine does not compute: a subsystem of another process
// with a port to one here, or a boundary input. Ghosts lie behind all groups, one lane each.
#ifndef PM_SIM_ENGINE_H
#define PM_SIM_ENGINE_H

#include "base/lanes.h"
#include "graph/compile.h"
#include "model/training_range.h"
#include "sim/invariant_projection.h"
#include "sim/iteration.h"
#include "sim/lanes.h"
#include "sim/local_subsystems.h"

// A subsystem shows at its ports the state at which ports and bulk terms are evaluated, dE, dS and,
// with an implicit method, the response of dE to a rate (model/prediction.h).
typedef enum pm_shown {
    PM_SHOWN_Z,
    PM_SHOWN_DE,
    PM_SHOWN_DS,
    PM_SHOWN_RESPONSE,
    PM_SHOWN_COUNT
} pm_shown;

typedef struct pm_kind pm_kind;
typedef struct pm_method pm_method;
typedef struct pm_model pm_model;
typedef struct pm_data pm_data;

// Subsystems with the same model. The graphs compute one block. A result that is identically zero
// is NULL, as is an input on which nothing depends.
typedef struct pm_subsystem_group {
    const pm_kind *kind;
    const pm_part *part;
    int count, width, nblock, nz;
    const int *id;      // [count] positions in the scene, ascending
    int64_t first;      // where the group begins in arrays of states
    int64_t first_lane; // where it begins in arrays of one number for each subsystem
    int first_block;    // where it begins in arrays of one number for each block
    pm_training_range range;
    pm_program *exposure;                // NULL: the kind has none
    double *z, *from;                    // [nz][width] the state, and that at the substep's start
    const double *E, *S;                 // [width]
    const double *shown[PM_SHOWN_COUNT]; // [nz][width] dE, dS, response
    pm_program *bulk;                    // NULL: no bulk term
    double *bulk_input[PM_SHOWN_COUNT];  // [nz][width]
    const double *bulk_rate;             // [nz][width] L dE + M dS
    // Turns rates of energy variables into rates of the state (part.h); NULL: they are the same.
    pm_program *release;
    double *release_z, *release_rate; // [nz][width]
    const double *released;           // [nz][width]
    void *object;                     // of the kind; such a group has one member
} pm_subsystem_group;

// One end of the ports of a group.
typedef struct pm_port_group_end {
    bool computed; // the group computes the rates of this end
    // A body at this end is in balance at the end of the substep, and needs the rates there too.
    bool needs_end_rates;
    int ny;
    const int *component;          // [ny] exposed components of the state of the end's subsystem
    uint64_t wanted;               // bit c % 64 is set for each of these components
    pm_lane_places place;          // [nblock width] the subsystem at the end of each port
    bool is_input[PM_SHOWN_COUNT]; // whether the law depends on y, e, eta, response
    // [ny][width] what the end shows in the present block; NULL: neither the law nor the fluxes
    // need it.
    double *shown[PM_SHOWN_COUNT];
    // [ny][width] results of the law: the rate of y, and the predicted co-energies at which the law
    // was evaluated; NULL: it was evaluated with e.
    const double *law_rate, *law_e;
    int64_t first_rate; // where the rates of this end begin in arrays of rates
} pm_port_group_end;

// In which order the rates of a block of ports are added to the subsystems, so that each subsystem
// sums them up in the scene's order.
typedef enum pm_port_order {
    PM_ORDER_A_FIRST,     // all ends A, then all ends B
    PM_ORDER_B_FIRST,     // all ends B, then all ends A
    PM_ORDER_PORT_BY_PORT // both ends of the first port, then those of the second one, ...
} pm_port_order;

// Ports with the same model. A group computes both ends of its ports, or one of them (model.c).
typedef struct pm_port_group {
    int count, width, nblock;
    const int *id; // [count] positions in the scene, ascending
    int64_t first_lane;
    int first_block;
    bool outside;    // one end is a boundary input
    bool inner;      // the group computes both ends of its ports, which are all at subsystems here
    bool joins_gaps; // of the law: a gap shows its force at the end of the substep
    pm_port_group_end end[2];
    unsigned char *order; // [nblock] a pm_port_order each
    pm_program *law;      // computes the rates, for one block; NULL: nothing acts
    // [nboth] irreversible rates of both ends from which the law predicts co-energies: those of the
    // last iteration, and those of this one. NULL without prediction.
    double *last;
    const double *next;
    int nboth;
} pm_port_group;

#define PM_NOWHERE (-1)

// The place of a subsystem, or of one end of a port, in the groups.
typedef struct pm_member {
    int group; // PM_NOWHERE: it is not computed here
    int lane;  // counted through all blocks of the group
} pm_member;

// Component c of a subsystem's or ghost's state is number `first` + c `step` of arrays of states;
// its lane, counted through all groups, is `lane`.
typedef struct pm_address {
    int first, step, lane;
} pm_address;

// An end of a port at a subsystem here whose other end is in another process.
typedef struct pm_remote {
    pm_remote_end at;
    pm_address own, ghost; // of the subsystem here, and of what the other end shows
} pm_remote;

struct pm_model {
    const pm_system *system; // borrowed
    pm_arena arena;
    pm_compiler *compiler; // of all graphs while they are opened; NULL: they are interpreted
    int count;             // subsystems here
    const int *id;         // [count] their positions in the scene, ascending
    const pm_integrator *integrator;
    const pm_method *method;
    int ngroup, nport_group;
    pm_subsystem_group *group; // [ngroup]
    pm_port_group *port_group; // [nport_group]
    int njoint, *joint;        // [njoint] positions in the scene of the ports here, ascending
    pm_member *subsystem_at;   // [scene->nsubsystem]
    pm_member (*port_at)[2];   // [scene->nport][end]
    // The addresses of the ghosts of subsystems and of boundary inputs. Where there is no ghost,
    // the address has a step of 0.
    pm_address *subsystem_ghost, *input_ghost; // [scene->nsubsystem], [scene->nboundary_input]
    int nremote;
    pm_remote *remote;         // [nremote] by subsystem, then by port, as in the scene
    int64_t size, own_size;    // components of all lanes; the same without ghosts
    int64_t lanes, own_lanes;  // lanes; the same without ghosts
    int64_t port_lanes, rates; // lanes of ports, and components of the rates of both ends
    int nblock, nport_block, most_nz, most_nport;
    bool needs_end_rates; // of a body at some end
    // Every subsystem has its ports in the order of the groups of ports. Otherwise the rates of all
    // ports are kept, and added port by port in the scene's order.
    bool ordered;
};

struct pm_data {
    int substeps;       // of the present step
    double h;           // s, length of a substep, or of a piece of it
    int substep, stage; // of the present round
    // A substep whose iteration does not converge is divided into 2^halvings pieces of h s; the
    // present one is number `piece`.
    int halvings, piece;
    long step;     // steps completed in this run
    bool doubtful; // a check of the present step has found something
    // The iteration of a piece of the present step has not converged: the length of that piece, s
    // (0: all have), and the group that changed most.
    double unsolved;
    int unsolved_group;
    double *state[3]; // [size] each: memory for the states below
    // States after the last substep, at the present stage, and at the start of the step that was
    // begun last. Each is one of `state`; an explicit method lets two of them be the same.
    double *z, *stage_z, *safe_z;
    double *shown[PM_SHOWN_COUNT]; // [size]; NULL: there is no response
    double *k;                     // [stages][size] rates of the stages; of an iteration the last
    double *end_k;                 // [size] rates at the end of the substep; NULL: nobody asks
    // [lanes] bit c % 64 is set if component c of what is shown changed in the last exposure.
    uint64_t *changed[PM_SHOWN_COUNT];
    double *ghost_z;      // [size - own_size] what the ghosts showed last of z
    bool *known;          // [nblock] the exposure's results belong to its inputs
    double *E, *S;        // [own_lanes] J, J/K at stage_z; S stays zero without entropy
    pm_lane_flux bulk;    // [own_lanes] fluxes of the bulk term during the step
    double *bulk_rate;    // [own_size] of the bulk term, in blocks that are `bulk_kept`
    bool *bulk_kept;      // [nblock]
    long *rested;         // [own_lanes] exposures and bulk terms that were not needed
    long *more_exposures; // [own_lanes] exposures beyond one for each round
    long *out_of_range;   // [own_lanes] steps that ended outside the training range
    // [own_lanes], [PM_MAX_GROUPS][own_lanes] largest relative error of a substep in the present
    // step, and the largest length that each group of variables has had; NULL: not estimated.
    double *error, *length;
    pm_invariant_projection *projection; // [own_lanes]; NULL: not balanced
    double *coupled; // [3][most_nz][PM_MOST_LANES] what a block showed when it was coupled
    // [own_lanes] of an implicit method; NULL: the method is explicit. The second says whether the
    // last iterate differs from the one before.
    pm_iteration *iteration;
    bool *moves;
    pm_lane_flux flux[2]; // [port_lanes] through each end during the step
    double *port_rate;    // [rates] of ports, in blocks that are `port_kept`
    bool *port_kept;      // [nport_block]
    long *port_rested;    // [port_lanes] evaluations of laws that were not needed
    pm_flux *remote_flux; // [nremote] into the subsystem here during the last step
    // How often in this run an exposure, a bulk term and a law could have been evaluated.
    long exposure_calls, bulk_calls, port_calls;
    // A step overwrites these values. They are kept here, so that the step can be undone. What
    // follows from the state alone is computed again. All is NULL unless steps are kept.
    struct {
        bool begun;                         // a step has begun that can be undone
        long step, exposures, bulks, ports; // of the counts above
        size_t size;                        // bytes of `kept`
        void *now, *kept;                   // [size] all arrays of counts and of what changed
        double *ghost[PM_SHOWN_COUNT];      // [size - own_size] what the ghosts showed
        pm_lane_flux bulk, flux[2];         // fluxes of the step before
        double *object;                     // of the objects of kinds, and of predictions
    } before;
    double *scratch;    // [4 most_nz]
    double *prescribed; // [2][scene->nprescribed] values of all boundary inputs, and work space
    pm_flux *books;     // [2 most_nport] the fluxes of pm_books
    const pm_boundary_input *boundary_input; // borrowed; NULL: the scene has none
};

// --- model.c ---

// Opens the model of the subsystems id [count], which are borrowed, with its data. The caller
// closes both, after a failure too. PM_ECONFIG: the integrator cannot serve a subsystem, or the
// states have more components than an int can count. PM_ENOMEM.
pm_status pm_model_open(pm_model *m, pm_data *d, const pm_system *system, int count, const int *id);
void pm_model_close(pm_model *m);

// Returns the address of a subsystem here or of the ghost of another one.
pm_address pm_model_address(const pm_model *m, int id);

// --- kind.c ---

// A kind of subsystems. The functions work on one block of a group, whose state is at d->z at the
// start of the substep and at d->stage_z at the present stage.
struct pm_kind {
    const char *name;
    bool single; // each subsystem needs a group of its own
    bool needs_end_rates;
    bool keeps_energy; // an implicit step that has converged leaves no energy open
    // Returns true if subsystem number `id` is of this kind.
    bool (*is)(const pm_model *m, int id);
    // Opens graphs and object. It may return with group->width = 0 if the group needs another
    // width.
    pm_status (*open)(pm_model *m, pm_subsystem_group *group, int width);
    void (*close)(pm_subsystem_group *group);
    // Begins a run at d->z, or goes back there after a step that failed; NULL: nothing to do, also
    // below.
    void (*start)(const pm_data *d, const pm_subsystem_group *group, bool run);
    // Computes d->E, d->S and what is shown, and notes what has changed. `ends_step`: the state is
    // that at the end of a step, and later results may depend on nothing else.
    void (*expose)(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                   bool ends_step);
    // Sets k [nz][width] to the rate of the bulk term, and adds its fluxes, times `weight`, to
    // those of the step, which count as zero in its first round.
    void (*bulk)(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                 double weight, double *k);
    // Writes the next iterate of an implicit method to `next` [nz]. Returns false if the iterate
    // stays as it is.
    bool (*iterate)(const pm_model *m, pm_data *d, const pm_subsystem_group *group, double *next);
    // Returns the change of the iterate that decides whether the iteration has converged, where
    // that of the state is `change`.
    double (*change)(const pm_subsystem_group *group, double change);
    void (*end_substep)(const pm_data *d, const pm_subsystem_group *group);
    // Checks the end of step number `step`.
    pm_status (*check)(const pm_model *m, const pm_subsystem_group *group, long step);
    void (*serialize)(const pm_subsystem_group *group, pm_serializer *serializer);
};

// Returns the kind of a subsystem.
const pm_kind *pm_kind_of(const pm_model *m, int id);

// --- couple.c ---

// Adds the rates of all ports to d->k, and their fluxes, times `weight`, to those of the step. Then
// turns all rates, which are those of energy variables, into rates of the states.
void pm_couple(const pm_model *m, pm_data *d, double weight);

// --- method.c ---

// A family of integrators.
struct pm_method {
    const char *name;
    bool implicit;
    // Computes the states of the next stage, and exposes them.
    void (*advance)(const pm_model *m, pm_data *d);
};
const pm_method *pm_method_of(const pm_integrator *integrator);

// A substep is halved no more often than this.
#define PM_MOST_HALVINGS 6

// Returns true in the first round of a step, in which the fluxes of the step begin at zero.
static inline bool pm_is_first_round(const pm_data *d) {
    return d->substep == 0 && d->piece == 0 && d->stage == 0;
}
// Returns the rates of the present stage [size].
static inline double *pm_stage_rates(const pm_model *m, const pm_data *d) {
    return d->k + (d->iteration != NULL ? 0 : d->stage * m->size);
}
// Exposes all subsystems at d->z, as if they had never been exposed. `run`: a run begins there.
void pm_expose_all(const pm_model *m, pm_data *d, bool run);

#endif

// Integrates one subsystem in time. It owns the state z, the graphs that evaluate one stage of the
// integrator, and the sums of the fluxes over a step. It does no input or output: its driver
// (monolithic.h in one process, lockstep/ in several) passes the values of the ports between
// neighbours.
//
// Life cycle: open; set_boundary_input if the scene has any; set_state; then steps; close. A step
// consists of rounds, one for each stage of each substep, until pm_subsystem_completes_step:
//     pm_subsystem_expose   evaluates dE and dS at the stage's state, and what every port shows
//     pm_subsystem_bulk     evaluates L dE + M dS while the neighbours' values travel
//     pm_subsystem_couple   once per port, in the order of ports: adds the port's term to the rate
//                           and its fluxes to the sums of the step
//     pm_subsystem_advance  combines the stages so far; after the last one the substep ends
// and then pm_subsystem_end_step. Together they integrate README.md, equation (1).
//
// The order of sums is fixed, so that the same calls give the same bits in one process and in many.
// A graph is not run again while its inputs keep their bits, so that a subsystem at rest takes
// almost no time. The weights must therefore not change between two calls of
// pm_subsystem_set_state.
#ifndef PM_SIM_SUBSYSTEM_H
#define PM_SIM_SUBSYSTEM_H

#include "base/record.h"
#include "sim/port_instance.h"

typedef struct pm_subsystem pm_subsystem;

// Builds the graphs of the scene's subsystem number `subsystem_id` and starts it at the initial
// state of the scene, or at zero. `system` is borrowed and must outlive it; the caller closes.
// PM_ECONFIG: the integrator cannot serve this subsystem. PM_ENOMEM.
pm_status pm_subsystem_open(pm_subsystem **subsystem, const pm_system *system, int subsystem_id);
void pm_subsystem_close(pm_subsystem *subsystem); // NULL is allowed

// Returns the number of ports of this subsystem. The arguments `port` below are positions in the
// list of these ports, from 0 to this number less 1, in the scene's order.
int pm_subsystem_nport(const pm_subsystem *s);
// Return the position of a port in the scene, and the end of the port at which this subsystem is.
int pm_subsystem_port_id(const pm_subsystem *s, int port);
pm_end pm_subsystem_end(const pm_subsystem *s, int port);
// Returns true if the other end of the port is a boundary input.
bool pm_subsystem_has_boundary_input(const pm_subsystem *s, int port);

// Lets `s` evaluate the law of a port for both ends, for two subsystems that step together. The
// port is number `port` of s and number `peer_port` of peer. In every round s must be coupled
// before peer, and neither may step once the other is closed. PM_ENOMEM.
pm_status pm_subsystem_share(pm_subsystem *s, int port, pm_subsystem *peer, int peer_port);

// Returns true after the last round of a step. It is the same round for all subsystems of a scene.
bool pm_subsystem_completes_step(const pm_subsystem *s);
// Returns the largest number of rounds that a step can have.
int pm_subsystem_most_rounds(const pm_subsystem *s);
// Sets the number of substeps of every step from the next one on (step_controller.h), until it is
// called again. It may only be called between two steps.
void pm_subsystem_set_substeps(pm_subsystem *s, int substeps);

// Sets the source of the scene's boundary inputs, which is borrowed and must outlive the subsystem.
void pm_subsystem_set_boundary_input(pm_subsystem *s, const pm_boundary_input *boundary_input);

// Sets z [nz] at step 0, evaluates E and S there, and sets all fluxes and counts of pm_books to
// zero.
void pm_subsystem_set_state(pm_subsystem *s, const double *z);
// Returns the state z [nz] after the last complete substep. The subsystem owns the array, and the
// next complete substep overwrites it.
const double *pm_subsystem_state(const pm_subsystem *s);

void pm_subsystem_expose(pm_subsystem *s);
// Returns what a port shows since the last pm_subsystem_expose. Owned by the subsystem.
const pm_port_values *pm_subsystem_values(const pm_subsystem *s, int port);
void pm_subsystem_bulk(pm_subsystem *s);
// Adds the port's term to the rate of the stage. `neighbour` is what the other end shows at this
// stage. It is NULL where the other end is a boundary input; the function then takes the values of
// the boundary input at the time of the stage.
void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour);
void pm_subsystem_advance(pm_subsystem *s);

// Ends a step after its last round: evaluates E and S at the new state, which is also the first
// exposure of the next step, and makes the fluxes of the step available to pm_subsystem_books.
// PM_ENUMERIC: the state or a potential is not finite, or the state is further outside the training
// range than the scene's guard allows. PM_EDATA: the dataset behind a boundary input is over. On
// failure the state is that of the last successful step.
pm_status pm_subsystem_end_step(pm_subsystem *s);

// The quantities of the last step that enter the ledger and the report. `energy` (J) and `entropy`
// (J/K) are values at the state after the step. `bulk` and `flux` are means over the step: energy
// fluxes in W, entropy fluxes in W/K. `evaluated`, `skipped` and `outside` count from the start of
// the run. `error` has no unit.
typedef struct pm_books {
    double energy, entropy;  // J, J/K at the state
    pm_flux bulk;            // of the bulk term L dE + M dS
    long evaluated, skipped; // graphs that were run, and those that did not have to be
    long outside;            // steps that ended outside the training range of the weights
    double error; // largest estimate of a substep's relative error (step_controller.h); 0: none
    int nflux;
    // [nflux] into this subsystem, port by port; then, for each port with a boundary input, into
    // the outside. Owned by the subsystem.
    const pm_flux *flux;
} pm_books;
pm_books pm_subsystem_books(const pm_subsystem *s);

// Copies the quantities of the books of the subsystem at position `id` into its places of the
// sample, without the fluxes through ports.
void pm_sample_set_books(pm_sample *sample, int id, const pm_books *books);

// Copies the state and the quantities of pm_books into this subsystem's places of the sample.
void pm_subsystem_fill_sample(const pm_subsystem *s, pm_sample *sample);

// Counts, saves or restores, as `record` demands (base/record.h), all numbers that the subsystem
// needs to continue from the end of a step with the same bits. Saving is allowed between two steps,
// restoring at any time.
void pm_subsystem_record(pm_subsystem *s, pm_record *record);

#endif

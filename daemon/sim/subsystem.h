// One subsystem in time: its state, the graphs of one stage, and what it books. No I/O: whoever
// drives it (body_assembly.h in one process, net/lockstep in many) carries the neighbours' values.
//
// A step is `substeps` x stages rounds. A round is
//     pm_subsystem_expose   stage state -> dE, dS and the values every port shows
//     pm_subsystem_bulk     L dE + M dS, while the neighbours' values travel
//     pm_subsystem_couple   once per port, in order of ports: the port law's term, and its fluxes
//                           (at a load the values of the world take the place of a neighbour's)
//     pm_subsystem_advance  the Runge-Kutta combination; ends the substep after its last stage
// The order of sums is fixed, so the same calls give the same bits in one process or in many. A
// graph whose inputs have the bits of the time before is not run again: a subsystem at rest costs
// next to nothing. (Weights must not change between two pm_subsystem_set_state.)
#ifndef PM_SIM_SUBSYSTEM_H
#define PM_SIM_SUBSYSTEM_H

#include "sim/port_instance.h"

typedef struct pm_subsystem pm_subsystem;

// Builds the graphs of subsystem `subsystem_id` and starts it at its initial state (zero if the
// scene has none; pm_subsystem_set_state). `system` must outlive it. PM_ECONFIG, PM_ENOMEM.
pm_status pm_subsystem_open(pm_subsystem **subsystem, const pm_system *system, int subsystem_id);
void pm_subsystem_close(pm_subsystem *subsystem); // NULL is allowed

// Its ports, in the scene's order: how many, and for each the scene's port and which end it is.
int pm_subsystem_nport(const pm_subsystem *s);
int pm_subsystem_port_id(const pm_subsystem *s, int port);
pm_end pm_subsystem_end(const pm_subsystem *s, int port);

bool pm_subsystem_is_load(const pm_subsystem *s, int port); // the other end is the world

// For two subsystems that step together: the law of the port between them, `port` of one and
// `peer_port` of the other, is evaluated once for both, by `s`, which in every round is coupled
// first. Neither is stepped once the other is closed. PM_ENOMEM.
pm_status pm_subsystem_share(pm_subsystem *s, int port, pm_subsystem *peer, int peer_port);

int pm_subsystem_rounds(const pm_subsystem *s); // of the present step
int pm_subsystem_most_rounds(const pm_subsystem *s);
// Between two steps: how many substeps the next one has (step_controller.h).
void pm_subsystem_set_substeps(pm_subsystem *s, int substeps);

// What the world prescribes, in a scene with loads; it must outlive the subsystem. A run that is
// not over when it ends fails (pm_subsystem_end_step).
void pm_subsystem_set_boundary_input(pm_subsystem *s, const pm_boundary_input *boundary_input);

// Sets z [nz] at step 0 and zeroes what was booked.
void pm_subsystem_set_state(pm_subsystem *s, const double *z);
const double *pm_subsystem_state(const pm_subsystem *s); // after the last full substep

void pm_subsystem_expose(pm_subsystem *s);
const pm_port_values *pm_subsystem_values(const pm_subsystem *s, int port);
void pm_subsystem_bulk(pm_subsystem *s);
// `neighbour`: NULL at a load.
void pm_subsystem_couple(pm_subsystem *s, int port, const pm_port_values *neighbour);
void pm_subsystem_advance(pm_subsystem *s);

// After the last round of a step: checks that the new state is finite (PM_ENUMERIC: subsystem,
// component, value) and the load reached so far (PM_EDATA), evaluates E and S there (this is also
// the next step's first exposure), and closes the step's books. On failure the state stays at the
// last good step's.
pm_status pm_subsystem_end_step(pm_subsystem *s);

// What the last step left, to be copied into a pm_sample.
typedef struct pm_books {
    double energy, entropy; // at the state
    pm_flux bulk;           // its own terms
    long evaluated, skipped;
    long outside; // steps that ended outside the region the weights were trained on
    double error; // largest estimate of a substep's error (step_controller.h); 0: not estimated
    int nflux;
    const pm_flux *flux; // [nflux]: into this subsystem by port, then into the world by load
} pm_books;
pm_books pm_subsystem_books(const pm_subsystem *s);

// What it must remember to go on from the end of a step with the same bits: how many numbers, and
// these. Restoring is allowed at any time.
int pm_subsystem_checkpoint_size(const pm_subsystem *s);
void pm_subsystem_save(const pm_subsystem *s, double *memory);
void pm_subsystem_restore(pm_subsystem *s, const double *memory);

// E and S at the present state, before any step. Same as books after a step.
void pm_subsystem_fill_sample(const pm_subsystem *s, pm_sample *sample);

#endif

// The subsystems that one process serves, and how they reach their neighbours: each other by
// pointers, those of other processes by one flux message per round.
#ifndef PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H
#define PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H

#include "lockstep/flux_link.h"
#include "lockstep/resend_buffer.h"
#include "sim/subsystem.h"

// A port as one of the subsystems sees it: what is at its other end.
typedef struct pm_process_subsystems_port {
    bool boundary_input; // the world: nothing to send, nobody to wait for; else
    int peer, peer_port; // a subsystem of this group and which of its ports; peer -1: elsewhere
    int link, first, ny; // elsewhere: which neighbour, where its values are in its messages
} pm_process_subsystems_port;

typedef struct pm_process_subsystems_part {
    pm_subsystem *subsystem;
    int nport;
    pm_process_subsystems_port *port; // [nport]
} pm_process_subsystems_part;

// Storage the caller owns; zero-initialise.
typedef struct pm_process_subsystems {
    int count;
    pm_process_subsystems_part *part; // [count], in the scene's order
    int nlink;
    pm_flux_link *link; // [nlink], one for each neighbouring process
    portmet_flux_t shown;
    pm_resend_buffer sent; // own fluxes, by round
    int part_id, port_id;  // the next port to couple in this round
} pm_process_subsystems;

// Opens the subsystems of a process at the state z [scene->nz] (NULL: the scene's initial one),
// under `load` (NULL: the scene has none); memory from the arena. It keeps its fluxes of the last
// `depth` rounds. PM_ECONFIG, PM_ENOMEM, and what pm_subsystem_open returns.
pm_status pm_process_subsystems_init(pm_process_subsystems *group, pm_arena *arena,
                                     const pm_system *system, int process_id, const double *z,
                                     const pm_boundary_input *boundary_input, int depth);
void pm_process_subsystems_free(pm_process_subsystems *group);

// A round, counted from the start of the run by `key`: exposes, publishes what neighbours elsewhere
// need (`head` has session, step, round and time; PM_ENUMERIC: not finite), and computes the bulk
// terms while the neighbours' fluxes travel.
pm_status pm_process_subsystems_start_round(pm_process_subsystems *group, pm_transport *transport,
                                            int64_t key, const portmet_flux_t *head);

// Couples ports in their order as far as the neighbours' fluxes have arrived: true when all are
// coupled. `used` receives whether any was.
bool pm_process_subsystems_couple(pm_process_subsystems *group, int64_t key, bool *used);

// A neighbour whose flux of this round has not arrived, or NULL.
const pm_flux_link *pm_process_subsystems_misses(const pm_process_subsystems *group, int64_t key);

// Between two steps: how many substeps the next one has, and rounds in the present one.
void pm_process_subsystems_set_substeps(pm_process_subsystems *group, int substeps);
int pm_process_subsystems_rounds(const pm_process_subsystems *group);

// After all ports: the Runge-Kutta combination. _end_step after the last round of a step.
// PM_ENUMERIC.
void pm_process_subsystems_advance(pm_process_subsystems *group);
pm_status pm_process_subsystems_end_step(pm_process_subsystems *group);

// Puts all that the subsystems need to go on from the end of a step with the same bits.
void pm_process_subsystems_record(pm_process_subsystems *group, pm_record *record);

#endif

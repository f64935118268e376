// The subsystems that one process serves, and how they reach their neighbours: each other by
// pointers, those of other processes by one flux message per round.
#ifndef PM_NET_CREW_H
#define PM_NET_CREW_H

#include "net/flux_link.h"
#include "net/outbox.h"
#include "sim/subsystem.h"

// A port as one of the subsystems sees it: what is at its other end.
typedef struct pm_crew_port {
    bool load;           // the world: nothing to send, nobody to wait for; else
    int peer, peer_port; // a subsystem of this crew and which of its ports; peer -1: elsewhere
    int link, first, ny; // elsewhere: which neighbour, where its values are in its messages
} pm_crew_port;

typedef struct pm_crew_part {
    pm_subsystem *subsystem;
    int nport;
    pm_crew_port *port; // [nport]
} pm_crew_part;

// Storage the caller owns; zero-initialise.
typedef struct pm_crew {
    int count;
    pm_crew_part *part; // [count], in the scene's order
    int nlink;
    pm_flux_link *link; // [nlink], one for each neighbouring process
    portmet_flux_t shown;
    pm_outbox sent;       // own fluxes, by round
    int part_id, port_id; // the next port to couple in this round
} pm_crew;

// Opens the subsystems of a process at the state z [scene->nz] (NULL: the scene's initial one),
// under `load` (NULL: the scene has none); memory from the arena. It keeps its fluxes of the last
// `depth` rounds. PM_ECONFIG, PM_ENOMEM, and what pm_subsystem_open returns.
pm_status pm_crew_init(pm_crew *crew, pm_arena *arena, const pm_system *system, int process_id,
                       const double *z, const pm_load *load, int depth);
void pm_crew_free(pm_crew *crew);

// A round, counted from the start of the run by `key`: exposes, publishes what neighbours elsewhere
// need (`head` has session, step, round and time; PM_ENUMERIC: not finite), and computes the bulk
// terms while the neighbours' fluxes travel.
pm_status pm_crew_start_round(pm_crew *crew, pm_transport *transport, int64_t key,
                              const portmet_flux_t *head);

// Couples ports in their order as far as the neighbours' fluxes have arrived: true when all are
// coupled. `used` receives whether any was.
bool pm_crew_couple(pm_crew *crew, int64_t key, bool *used);

// A neighbour whose flux of this round has not arrived, or NULL.
const pm_flux_link *pm_crew_misses(const pm_crew *crew, int64_t key);

// Between two steps: how many substeps the next one has, and rounds in the present one.
void pm_crew_set_substeps(pm_crew *crew, int substeps);
int pm_crew_rounds(const pm_crew *crew);

// After all ports: the Runge-Kutta combination. _end_step after the last round of a step.
// PM_ENUMERIC.
void pm_crew_advance(pm_crew *crew);
pm_status pm_crew_end_step(pm_crew *crew);

// As pm_subsystem_memory and its companions, for all of them.
int pm_crew_memory(const pm_crew *crew);
void pm_crew_save(const pm_crew *crew, double *memory);
void pm_crew_restore(pm_crew *crew, const double *memory);

#endif

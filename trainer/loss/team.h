// The processes that train together: the ranks of one job, which mpirun starts. Each computes its
// share of every sum over samples, and all of them take the same steps of the optimiser, so that no
// weights travel.
//
// A sum is divided into lanes: lane i takes the chunks i, i + L, i + 2 L, ... of the samples, where
// L is the number of lanes. The lanes are added in a binary tree. A process that trains alone has
// two lanes, one thread each. A team has PM_TEAM_LANES, whatever its size, and each process has as
// many of them; so the bits of a sum do not depend on the size of the team.
#ifndef PM_TRAINER_LOSS_TEAM_H
#define PM_TRAINER_LOSS_TEAM_H

#include <stdbool.h>
#include <stddef.h>

#include "base/status.h"

#define PM_TEAM_LANES 8 // the most processes, and a power of two

// What a team asks of MPI: to join and leave it (pm_team_leave), and to send own [n] to the process
// `partner` and receive other [n] from it.
typedef struct pm_team_exchange {
    void (*join)(int *rank, int *count);
    bool (*leave)(bool failed);
    void (*exchange)(int partner, size_t n, const double *own, double *other);
} pm_team_exchange;
// It lies in a module that pm_team_join loads.
extern const pm_team_exchange pm_team_mpi __attribute__((visibility("default")));

// A member of a team. Functions that take a team accept NULL: this process trains alone.
typedef struct pm_team {
    int rank, count; // this process, from 0 on, and the number of processes
    const pm_team_exchange *mpi;
} pm_team;

// True if mpirun has started this process, as its environment tells.
bool pm_team_is_called(void);

// Joins the team. PM_EUSAGE: it has not 1, 2, 4 or 8 processes. PM_ECONFIG: the module for MPI is
// not installed.
pm_status pm_team_join(pm_team *team);

// Leaves the team: waits until all processes do, after a failure for a few seconds at most. Returns
// false if some did not come; then this process must end, and mpirun ends the others.
bool pm_team_leave(const pm_team *team, bool failed);

// True if this process writes the files: it trains alone or has rank 0.
bool pm_team_leads(const pm_team *team);

// The lanes of a sum, and those of this process: `own` lanes from number `first` on.
typedef struct pm_lanes {
    int count, first, own;
} pm_lanes;
pm_lanes pm_team_lanes(const pm_team *team);

// Calls `work` for each lane of this process, an element of the array `lane` with elements of
// `size` bytes: alone in a thread each, in a team one after the other.
void pm_team_run(const pm_team *team, void *(*work)(void *lane), void *lane, size_t size);

// Adds the arrays value [own][n] of the lanes of this process in a fixed tree, and then those of
// all processes. The sum is in value[0] of each process; the other arrays are overwritten.
void pm_team_add(const pm_team *team, size_t n, double *const *value);

// Adds the arrays value [n] of all processes.
void pm_team_sum(const pm_team *team, size_t n, double *value);

// True if `holds` is true in any process.
bool pm_team_any(const pm_team *team, bool holds);

#endif

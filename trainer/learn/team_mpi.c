// A team over MPI. This is the only file of the trainer that calls MPI.
#include <math.h>
#include <mpi.h>
#include <time.h>

#include "base/progress.h"
#include "learn/team_table.h"

#define FAILED_GRACE 5.0 // s that a process waits for the others after a failure
#define NAP 2000000      // ns between two looks

pm_status pm_team_begin(pm_team *team) {
    MPI_Init(NULL, NULL);
    MPI_Comm_rank(MPI_COMM_WORLD, &team->rank);
    MPI_Comm_size(MPI_COMM_WORLD, &team->count);
    return PM_OK;
}

void pm_team_exchange(int partner, size_t n, const double *own, double *other) {
    MPI_Sendrecv(own, (int)n, MPI_DOUBLE, partner, 0, other, (int)n, MPI_DOUBLE, partner, 0,
                 MPI_COMM_WORLD, MPI_STATUS_IGNORE);
}

// Processes that wait for the report of the first one sleep between two looks.
bool pm_team_leave(const pm_team *team, bool failed) {
    (void)team;
    MPI_Request request;
    int met = 0;
    const double end = failed ? pm_clock() + FAILED_GRACE : INFINITY;
    MPI_Ibarrier(MPI_COMM_WORLD, &request);
    while (!met && pm_clock() < end) {
        nanosleep(&(struct timespec){.tv_nsec = NAP}, NULL);
        MPI_Test(&request, &met, MPI_STATUS_IGNORE);
    }
    if (met) {
        MPI_Finalize();
    }
    return met != 0;
}

// What a team asks of MPI, in the module that portmet-train loads where mpirun has started it.
#include <math.h>
#include <mpi.h>
#include <time.h>

#include "base/progress.h"
#include "loss/team.h"

#define FAILED_GRACE 5.0 // s that a process waits for the others after a failure
#define NAP 2000000      // ns between two looks

static void join(int *rank, int *count) {
    MPI_Init(NULL, NULL);
    MPI_Comm_rank(MPI_COMM_WORLD, rank);
    MPI_Comm_size(MPI_COMM_WORLD, count);
}

static bool leave(bool failed) {
    // Processes that wait for the report of the first one sleep between two looks.
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

static void exchange(int partner, size_t n, const double *own, double *other) {
    MPI_Sendrecv(own, (int)n, MPI_DOUBLE, partner, 0, other, (int)n, MPI_DOUBLE, partner, 0,
                 MPI_COMM_WORLD, MPI_STATUS_IGNORE);
}

const pm_team_exchange pm_team_mpi = {join, leave, exchange};

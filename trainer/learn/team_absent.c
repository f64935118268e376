// The team of a program that was built without MPI: nobody can join it.
#include <string.h>

#include "learn/team_table.h"

pm_status pm_team_begin(pm_team *team) {
    (void)team;
    return pm_fail(PM_EUSAGE, "mpirun has started this program, which was built without MPI "
                              "(libopenmpi-dev)");
}

void pm_team_exchange(int partner, size_t n, const double *own, double *other) {
    (void)partner;
    memcpy(other, own, n * sizeof *own);
}

bool pm_team_leave(const pm_team *team, bool failed) {
    (void)team, (void)failed;
    return true;
}

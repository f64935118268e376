// What a team needs of MPI; private to learn/team*.c.
#ifndef PM_TRAINER_LEARN_TEAM_TABLE_H
#define PM_TRAINER_LEARN_TEAM_TABLE_H

#include "learn/team.h"

// Begins MPI and finds the rank of this process. PM_EUSAGE: this program was built without MPI.
pm_status pm_team_begin(pm_team *team);

// Sends own [n] to the process `partner`, and receives other [n] from it.
void pm_team_exchange(int partner, size_t n, const double *own, double *other);

#endif

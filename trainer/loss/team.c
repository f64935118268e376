// The tree of the lanes of one process, on which that of the team is built.
#include "loss/team.h"

#include <pthread.h>
#include <stdlib.h>

#include "base/plugin.h"

#define LANES_ALONE 2

bool pm_team_is_called(void) {
    // Open MPI, and the managers of MPICH and Intel MPI.
    return getenv("OMPI_COMM_WORLD_SIZE") != NULL || getenv("PMI_SIZE") != NULL;
}

pm_status pm_team_join(pm_team *team) {
    const void *mpi = NULL;
    PM_TRY(pm_plugin_find("portmet-mpi.so", "pm_team_mpi", &mpi));
    team->mpi = mpi;
    team->mpi->join(&team->rank, &team->count);
    if (team->count > PM_TEAM_LANES || (team->count & (team->count - 1)) != 0) {
        const int count = team->count;
        return pm_fail(PM_EUSAGE, "expected 1, 2, 4 or 8 ranks (mpirun -n), found %d", count);
    }
    return PM_OK;
}

bool pm_team_leave(const pm_team *team, bool failed) {
    return team->mpi == NULL || team->mpi->leave(failed);
}

bool pm_team_leads(const pm_team *team) {
    return team == NULL || team->rank == 0;
}

pm_lanes pm_team_lanes(const pm_team *team) {
    if (team == NULL) {
        return (pm_lanes){LANES_ALONE, 0, LANES_ALONE};
    }
    const int own = PM_TEAM_LANES / team->count;
    return (pm_lanes){PM_TEAM_LANES, team->rank * own, own};
}

void pm_team_run(const pm_team *team, void *(*work)(void *lane), void *lane, size_t size) {
    const int own = pm_team_lanes(team).own;
    pthread_t thread[PM_TEAM_LANES];
    bool started[PM_TEAM_LANES] = {false};
    for (int i = 1; i < own && team == NULL; ++i) {
        started[i] = pthread_create(&thread[i], NULL, work, (char *)lane + (size_t)i * size) == 0;
    }
    for (int i = 0; i < own; ++i) {
        if (started[i]) {
            pthread_join(thread[i], NULL);
        } else { // the first one, those of a team, and those whose thread could not be started
            work((char *)lane + (size_t)i * size);
        }
    }
}

void pm_team_add(const pm_team *team, size_t n, double *const *value) {
    const int own = pm_team_lanes(team).own;
    for (int stride = 1; stride < own; stride *= 2) {
        for (int i = 0; i + stride < own; i += 2 * stride) {
            for (size_t k = 0; k < n; ++k) {
                value[i][k] += value[i + stride][k];
            }
        }
    }
    pm_team_sum(team, n, value[0]);
}

// Each process adds the array of a partner, then that of a partner twice as far away, and so on.
// Both partners compute the same sum, since a + b has the bits of b + a.
void pm_team_sum(const pm_team *team, size_t n, double *value) {
    double other[1024];
    const size_t most = sizeof other / sizeof *other;
    for (int distance = 1; team != NULL && distance < team->count; distance *= 2) {
        for (size_t first = 0; first < n; first += most) {
            const size_t count = n - first < most ? n - first : most;
            team->mpi->exchange(team->rank ^ distance, count, value + first, other);
            for (size_t k = 0; k < count; ++k) {
                value[first + k] += other[k];
            }
        }
    }
}

bool pm_team_any(const pm_team *team, bool holds) {
    double count = holds;
    pm_team_sum(team, 1, &count);
    return count > 0;
}

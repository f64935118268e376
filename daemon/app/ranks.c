// Gives each rank its part of a run.
#include "app/ranks.h"

#include <stdio.h>

#include "app/serve.h"
#include "transport/transport.h"

// Ends a rank of a job that cannot run. Only rank 0 says why.
static pm_status refuse(const pm_setup *setup, int rank, pm_status status) {
    pm_transport *transport;
    char reason[512];
    snprintf(reason, sizeof reason, "%s", rank == 0 ? pm_error() : "");
    PM_TRY(pm_transport_open(&transport, setup->scene->url, NULL));
    pm_transport_close(transport);
    return pm_fail(status, "%s", reason);
}

static pm_status check(const pm_setup *setup, const pm_run_options *options, int count) {
    const pm_scene *scene = setup->scene;
    if (count != scene->nprocess + 1) {
        return pm_fail(PM_EUSAGE,
                       "scene %s has %d processes: expected %d ranks (mpirun -n %d), one for each "
                       "process and one that coordinates them, found %d",
                       scene->name, scene->nprocess, scene->nprocess + 1, scene->nprocess + 1,
                       count);
    }
    if (options->checkpoint != NULL) {
        return pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, and "
                                  "mpirun ends all ranks when one dies");
    }
    if (scene->nlive > 0 && setup->replay == NULL) {
        return pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: %s needs --replay",
                       scene->url);
    }
    return PM_OK;
}

pm_status pm_ranks_run(pm_setup *setup, const pm_run_options *options) {
    int rank, count;
    PM_TRY(pm_transport_place(setup->scene->url, &rank, &count));
    const pm_status status = check(setup, options, count);
    if (status != PM_OK) {
        return refuse(setup, rank, status);
    }
    if (rank == 0) {
        return pm_serve_coordinator(setup, options);
    }
    pm_run_options own = *options;
    own.log.part = setup->scene->process[rank - 1].name;
    own.coordinator_speaks = true;
    return pm_serve_node(setup, &own, rank - 1);
}

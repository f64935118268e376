// Steps the monolithic system and books every step.
#include "library/local_run.h"

#include <string.h>

static pm_status book(pm_local_run *run) {
    pm_tally tally;
    run->sample = run->sums ? *pm_monolithic_sums(run->monolithic, &tally)
                            : *pm_monolithic_sample(run->monolithic);
    run->sample.live = run->setup->live;
    return run->sums ? pm_ledger_add_sums(&run->ledger, &run->sample, &tally)
                     : pm_ledger_add_sample(&run->ledger, &run->sample);
}

pm_status pm_local_run_open(pm_local_run *run, const pm_setup *setup, bool sums) {
    *run = (pm_local_run){.setup = setup, .sums = sums};
    PM_TRY(pm_monolithic_open(&run->monolithic, setup->system));
    pm_monolithic_set_boundary_input(run->monolithic, &setup->boundary_input);
    return pm_local_run_start(run, setup->initial);
}

void pm_local_run_close(pm_local_run *run) {
    pm_monolithic_close(run->monolithic);
    run->monolithic = NULL;
}

pm_status pm_local_run_start(pm_local_run *run, const double *z) {
    pm_monolithic_set_state(run->monolithic, z);
    pm_ledger_init(&run->ledger, run->setup->system);
    return book(run);
}

pm_status pm_local_run_step(pm_local_run *run) {
    const pm_setup *setup = run->setup;
    if (setup->replay != NULL) {
        const size_t n = (size_t)setup->scene->network.nlive;
        const long step = run->sample.step;
        if (step >= setup->replayed) {
            return pm_fail(PM_EDATA, "%s: the recording that is replayed ends after step %lld",
                           setup->replay_path, (long long)setup->replayed);
        }
        memcpy(setup->live, setup->replay + (size_t)step * n, n * sizeof *setup->live);
    }
    PM_TRY(pm_monolithic_step(run->monolithic));
    return book(run);
}

// Steps the monolithic system and books every step.
#include "library/local_run.h"

#include <string.h>

static pm_status book(pm_local_run *run) {
    pm_tally tally;
    const bool sums = run->need == PM_LOCAL_SUMS;
    run->sample = sums ? *pm_monolithic_sums(run->monolithic, &tally)
                       : *pm_monolithic_sample(run->monolithic);
    run->sample.live = run->setup->live;
    return sums ? pm_ledger_add_sums(&run->ledger, &run->sample, &tally)
                : pm_ledger_add_sample(&run->ledger, &run->sample);
}

pm_status pm_local_run_open(pm_local_run *run, const pm_setup *setup, pm_local_need need) {
    *run = (pm_local_run){.setup = setup, .need = need};
    PM_TRY(pm_monolithic_open(&run->monolithic, setup->system));
    pm_monolithic_set_boundary_input(run->monolithic, &setup->boundary_input);
    PM_TRY(need == PM_LOCAL_UNDO ? pm_monolithic_keep_steps(run->monolithic) : PM_OK);
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
    const pm_ledger ledger = run->ledger;
    const pm_sample sample = run->sample;
    pm_status status = book(run);
    if (status == PM_OK && run->recording != NULL) {
        status = pm_recording_append(run->recording, &run->sample);
    }
    if (status != PM_OK && run->need == PM_LOCAL_UNDO) {
        pm_monolithic_undo_step(run->monolithic);
        (void)pm_monolithic_sample(run->monolithic); // fills the arrays of the sample
        run->ledger = ledger;
        run->sample = sample;
    }
    return status;
}

// Steps the monolithic system and books every step.
#include "library/local_run.h"

static pm_status book(pm_local_run *run) {
    run->sample = *pm_monolithic_sample(run->monolithic);
    return pm_ledger_book(&run->ledger, &run->sample);
}

pm_status pm_local_run_open(pm_local_run *run, const pm_setup *setup) {
    *run = (pm_local_run){.setup = setup};
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
    PM_TRY(pm_monolithic_step(run->monolithic));
    return book(run);
}

// Opens the transport and the state machine of a process, and drives it (lockstep/lockstep.h).
#include "app/serve.h"

#include <stddef.h>

#include "app/connect.h"
#include "app/notify.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "lockstep/lockstep.h"

static void tell_alive(void *context, int64_t step) {
    (void)context;
    pm_notify("WATCHDOG=1\nSTATUS=step %lld", (long long)step);
}

pm_status pm_serve_node(pm_setup *setup, const pm_run_options *options, int process_id) {
    const char *name = setup->scene->process[process_id].name;
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_lockstep_node_options node_options = {
        .z = setup->initial,
        .session = options->session,
        .alive = tell_alive,
        .boundary_input = &setup->boundary_input,
        .live = setup->live,
    };
    pm_status status;
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, name, &node_options.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, name, &options->log));
    PM_TRY_DONE(pm_lockstep_node_open(&node, setup->system, process_id, transport, &node_options));
    status = pm_lockstep_run_node(node, options->stop);
    pm_connect_warn(transport, pm_lockstep_node_drops(node), &options->log);
    if (options->coordinator_speaks && status != PM_OK && status != PM_ETIMEOUT) {
        status = pm_fail(status, "%s", "");
    }
done:
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

static pm_status conduct(pm_setup *setup, pm_observer *observer) {
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_lockstep_coordinator_options options = pm_observer_attach(observer, setup);
    pm_status status;
    PM_TRY_DONE(pm_prepare_checkpoint(setup, observer->options, NULL, &options.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, "coordinator", &observer->options->log));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &options));
    status = pm_lockstep_run_coordinator(coordinator, observer->options->stop);
    status = pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(coordinator),
                                pm_lockstep_coordinator_pace(coordinator),
                                pm_transport_has_ranks(setup->scene->url) ? "a rank each, over MPI"
                                                                          : "over LCM");
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(coordinator), &observer->options->log);
done:
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

pm_status pm_serve_coordinator(pm_setup *setup, const pm_run_options *options) {
    pm_observer observer = {0};
    pm_status status;
    PM_TRY_DONE(pm_observer_open(&observer, setup, options));
    status = conduct(setup, &observer);
done:
    pm_observer_close(&observer);
    return status;
}

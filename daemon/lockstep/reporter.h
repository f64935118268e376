// Publishes the reports of a process to the coordinator. A DONE report holds one or more steps: at
// most half the lookahead (lookahead.h), so that the next grant arrives before the last one is used
// up. FAILED and BYE reports carry no steps. The last DONE reports are kept for requests.
#ifndef PM_LOCKSTEP_REPORTER_H
#define PM_LOCKSTEP_REPORTER_H

#include "lockstep/codec.h"
#include "lockstep/process_subsystems.h"
#include "lockstep/report_shape.h"
#include "lockstep/resend_buffer.h"

// The caller owns this storage.
typedef struct pm_reporter {
    const pm_scene *scene;
    const pm_scene_process *process;
    pm_transport *transport;
    pm_resend_buffer sent;      // the last DONE reports; a report's key is its number from 0
    int64_t *first, *last;      // [sent.depth] first and last step of each report in `sent`
    int64_t count;              // DONE reports published
    portmet_report_t done;      // the report being filled
    pm_report_shape shape[2];   // of reports without and with sums
    bool sums;                  // the report being filled has sums
    int rows;                   // steps in the report being filled
    portmet_report_t notice;    // FAILED or BYE
    unsigned char *notice_data; // [notice_capacity] the encoded notice
    size_t notice_capacity;
} pm_reporter;

// Opens a reporter. Memory comes from the arena, for as many reports as the coordinator may miss
// plus `more`. `instance` is the instance number in the sender's hello. PM_ECONFIG, PM_ENOMEM.
pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int process_id, pm_transport *transport, int64_t instance, int more);

// Publishes a report of `kind` FAILED, with code and message, or BYE, for the instance
// `coordinator`. PM_ENET.
pm_status pm_reporter_notify(pm_reporter *reporter, int64_t session, int64_t coordinator,
                             int8_t kind, pm_status code, const char *message);

// Adds one step to the report being filled: the fluxes, the energies and, with `with_state`, the
// state. Publishes the report when it is full. `head` gives the session, the coordinator, the step
// and the time (s) of the added step. PM_ENUMERIC: a number is not finite; PM_ENET.
pm_status pm_reporter_add_step(pm_reporter *reporter, const portmet_report_t *head,
                               const pm_process_subsystems *subsystems, bool with_state);

// Publishes the report being filled, unless it is empty. PM_ENUMERIC: a number is not finite;
// PM_ENET.
pm_status pm_reporter_flush(pm_reporter *reporter);

// Publishes the report that holds `step` again. Sets `kept` to false if the report is no longer
// kept. PM_ENET.
pm_status pm_reporter_repeat(const pm_reporter *reporter, int64_t step, bool *kept);

#endif

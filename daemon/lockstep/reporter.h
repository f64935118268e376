// A process's word to the coordinator. Steps are gathered into reports of as many steps as half the
// lead (lookahead.h), so that the next grant comes before the last is used up; the last reports are
// kept for requests.
#ifndef PM_LOCKSTEP_REPORTER_H
#define PM_LOCKSTEP_REPORTER_H

#include "lockstep/codec.h"
#include "lockstep/process_subsystems.h"
#include "lockstep/resend_buffer.h"

// Storage the caller owns.
typedef struct pm_reporter {
    const pm_scene *scene;
    const pm_scene_process *process;
    pm_transport *transport;
    pm_resend_buffer sent;    // by number of the report
    int64_t *first, *last;    // [sent.depth] steps that it is about
    int64_t count;            // reports sent
    portmet_report_t done;    // being gathered: `rows` of them
    int rows, capacity;       // steps
    int npart, nend, nz;      // numbers of a step
    portmet_report_t word;    // without numbers
    unsigned char *word_data; // [word_capacity]
    size_t word_capacity;
} pm_reporter;

// Steps of one report at most, and a report with memory (from the arena) for them; npart, nend and
// nz are then their largest counts. PM_ENOMEM.
int pm_report_rows(const pm_scene *scene, int process_id);
pm_status pm_report_make(portmet_report_t *report, pm_arena *arena, const pm_scene *scene,
                         int process_id);

// Names of channels, and memory (from the arena) for the reports of as many steps as the
// coordinator may miss, and `more`. `instance` as in the sender's hello. PM_ECONFIG, PM_ENOMEM.
pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int process_id, pm_transport *transport, int64_t instance, int more);

// FAILED (with code and message) or BYE.
pm_status pm_reporter_say(pm_reporter *reporter, int64_t session, int8_t kind, pm_status code,
                          const char *message);

// `step` steps are complete: gathers their books and, with `with_state`, the state; publishes when
// the report is full. PM_ENUMERIC if a number is not finite.
pm_status pm_reporter_done(pm_reporter *reporter, int64_t session, int64_t step, double time,
                           const pm_process_subsystems *group, bool with_state);

// Publishes what is gathered, if anything. PM_ENUMERIC.
pm_status pm_reporter_flush(pm_reporter *reporter);

// Publishes the report about a step again if it is kept; `kept` receives whether it is.
pm_status pm_reporter_repeat(const pm_reporter *reporter, int64_t step, bool *kept);

#endif

// A node's word to the coordinator: reports and states, the last of them kept for requests.
#ifndef PM_NET_REPORTER_H
#define PM_NET_REPORTER_H

#include "net/codec.h"
#include "net/outbox.h"
#include "sim/subsystem.h"

// Storage the caller owns.
typedef struct pm_reporter {
    const pm_scene_subsystem *subsystem;
    pm_transport *transport;
    int64_t digest;           // of scene, weights and initial state; in every report
    pm_outbox report, state;  // by step
    portmet_report_t done;    // with arrays [nport], as pm_books.flux
    portmet_report_t word;    // without numbers: its arrays stay zero
    unsigned char *word_data; // [word_capacity]
    size_t word_capacity;
} pm_reporter;

// Names of channels, and memory (from the arena) for the reports of as many steps as the
// coordinator may miss. `nport`: pm_books.nflux. PM_ECONFIG, PM_ENOMEM.
pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int subsystem_id, int nport, pm_transport *transport);

// HELLO, FAILED (with code and message) or BYE.
pm_status pm_reporter_say(pm_reporter *reporter, int64_t session, int8_t kind, pm_status code,
                          const char *message);

// DONE: `step` steps are complete; with `z` (NULL: nobody records) the state as well. PM_ENUMERIC
// if a number is not finite.
pm_status pm_reporter_done(pm_reporter *reporter, int64_t session, int64_t step, double time,
                           const pm_books *books, const double *z);

// Answers a request if it is for one of the reports or states kept.
pm_status pm_reporter_repeat(const pm_reporter *reporter, const portmet_request_t *request);

#endif

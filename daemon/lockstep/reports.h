// The reports of the processes: what they hold, how a process fills and publishes them, how the
// coordinator or a listener decodes them, and the window in which the samples of several steps are
// put together from them.
#ifndef PM_LOCKSTEP_REPORTS_H
#define PM_LOCKSTEP_REPORTS_H

#include "lockstep/process_subsystems.h"
#include "scene/sample.h"
#include "sim/tally.h"

// --- what a report holds ---

// The shape of a process's reports: which of its subsystems and ends of ports they list, and how
// many numbers that makes. Every subsystem is listed, unless the reports have sums (lcmtypes/
// portmet.lcm, report_t). Reports of sums list the subsystems of pm_scene_lists_subsystem. The
// arena owns the arrays.
typedef struct pm_report_shape {
    int npart, nend, nz, ntally; // numbers of one step: subsystems, ends, components, of the tally
    int *part;                   // [npart] positions among the subsystems of the process, ascending
    // [nend] 2 * position of the port in the scene + end: for each listed subsystem its own ends,
    // by port, and then the outside ends of its ports with a boundary input.
    int *end;
    int rows; // the most steps of one report
} pm_report_shape;

// --- the reports of one process: its side ---

// The reporter publishes the reports of a process to the coordinator. A DONE report holds one or
// more steps: at most half the lookahead (lookahead.h), so that the next grant arrives before the
// last one is used up. FAILED and BYE reports carry no steps. The last DONE reports are kept for
// requests. The caller owns this storage.
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

// --- the reports of one process: the side of those who read them ---

#define PM_REMOTE_GREETED 4 // instances that are remembered
#define PM_REMOTE_SEEN 64   // steps whose reports are remembered

// The coordinator's view of one process: the channels of its messages, the messages into which its
// reports and fluxes are decoded, and whether it is alive and makes progress. The caller owns this
// storage and initialises it with zeros.
typedef struct pm_remote_process {
    struct pm_lockstep_coordinator *coordinator; // context of the message handlers
    int id;                                      // of the process in the scene
    const char *name;
    const pm_scene *scene;
    char channel[PM_CHANNEL_SIZE];      // on which the process publishes reports
    char flux_channel[PM_CHANNEL_SIZE]; // on which the process publishes fluxes
    char address[PM_CHANNEL_SIZE];      // on which the process receives requests
    pm_report_shape shape[2];           // of its reports, without and with sums
    portmet_report_t largest;           // arrays and largest counts of a report
    portmet_report_t report;            // the report decoded last
    int rows;                           // steps in it
    bool sums;                          // it has sums, and lists only some subsystems
    portmet_flux_t flux;                // the flux decoded last
    bool alive;                         // the process sent a message since the last poll
    bool moved;                         // a message since the last poll shows progress
    int64_t asked[4];                   // instance, attempt, step and round of its last request
    int64_t reported;                   // first step of its last report
    int64_t done;                       // steps completed, by report or flux; -1: none
    bool left;                          // the process has sent BYE
    double heard;                       // s, when a message last arrived
    int64_t instance;                   // the instance that reported step 0; 0: none
    int64_t greeted[PM_REMOTE_GREETED]; // the last instances whose hello fitted the run; 0: none
    int64_t seen_step[PM_REMOTE_SEEN];  // the last reported steps, at step % PM_REMOTE_SEEN; -1:
                                        // none
    uint64_t seen[PM_REMOTE_SEEN];      // digest of the reported numbers of that step
} pm_remote_process;

// Sets the channel names and allocates the messages for process `process_id`, with memory from the
// arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_remote_process_init(pm_remote_process *remote, pm_arena *arena, const pm_scene *scene,
                                 int process_id);

// Decodes the message `data` [size] into remote->report. Returns PM_KEEP if it is accepted, and
// else the reason for which it is dropped. A report of the kind DONE has one row for each of its
// steps. Each row must be complete. It must hold the state z if `with_state` is true, and must not
// otherwise; a report of a scene that may report sums then has sums. A report with another number
// of values is dropped with PM_DROP_COUNT.
pm_drop pm_remote_process_decode(pm_remote_process *remote, const void *data, size_t size,
                                 bool with_state);

// --- the samples of several steps ---

// The report window holds the steps whose reports are collected at the same time. Each step has a
// sample, which is complete when every process has reported the step. A coordinator collects as
// many steps as it may grant ahead (lookahead.h), and one more. It takes the samples out in the
// order of their steps, and the window then advances by one step. A listener (listener.h) may miss
// reports: a later step takes the place of an earlier one, complete or not.

// One step of the window.
typedef struct pm_report_window_slot {
    int64_t step;
    int missing; // number of processes that have not reported the step
    bool *has;   // [nprocess] true for each process that has reported the step
    pm_sample *sample;
    pm_tally tally; // the sums of the reports so far
} pm_report_window_slot;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_report_window {
    const pm_scene *scene;
    int depth;                   // steps
    pm_report_window_slot *slot; // [depth], by step modulo depth
} pm_report_window;

// Makes a window of `depth` steps, the first of which is `first`. PM_ENOMEM. The caller frees the
// window, on failure too.
pm_status pm_report_window_init(pm_report_window *window, pm_arena *arena, const pm_scene *scene,
                                int depth, int64_t first);
void pm_report_window_free(pm_report_window *window);

// Writes row `row` of the report that was decoded last into the sample and the tally of its step.
// Returns false, and writes nothing, if the step is outside the window or the process has reported
// it already.
bool pm_report_window_add(pm_report_window *window, const pm_remote_process *remote, int row);

// Returns true if the step is in the window and the process has reported it.
bool pm_report_window_has(const pm_report_window *window, int64_t step, int process_id);

// Returns the last step, at most `most`, up to which the reports of all steps after `step` have
// arrived; `step` if the next one is incomplete.
int64_t pm_report_window_complete(const pm_report_window *window, int64_t step, int64_t most);

// Returns the sample of a step in the window, which owns it.
pm_sample *pm_report_window_sample(const pm_report_window *window, int64_t step);

// Returns the tally of a step in the window, which owns it.
pm_tally *pm_report_window_tally(const pm_report_window *window, int64_t step);

// Discards all samples; the window then begins at the step `first`.
void pm_report_window_restart(pm_report_window *window, int64_t first);

// Makes room for `step` by discarding the earlier step that has its place. Returns that earlier
// step, or -1 if the window holds `step` already, or holds a later step in its place.
int64_t pm_report_window_reach(pm_report_window *window, int64_t step);

// Returns true if the step is in the window and every process has reported it.
bool pm_report_window_is_complete(const pm_report_window *window, int64_t step);

// Discards the sample of `step` and gives its place to the step `step + depth`, where `depth` is
// the number of steps in the window.
void pm_report_window_advance(pm_report_window *window, int64_t step);

#endif

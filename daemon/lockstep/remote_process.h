// The coordinator's view of one process: the channels of its messages, the numbers of a sample that
// it reports, and whether it is alive and makes progress. The struct also owns the messages into
// which reports and fluxes of the process are decoded.
#ifndef PM_LOCKSTEP_REMOTE_PROCESS_H
#define PM_LOCKSTEP_REMOTE_PROCESS_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "lockstep/report_shape.h"
#include "scene/recording.h"
#include "transport/transport.h"

#define PM_REMOTE_GREETED 4 // instances that are remembered
#define PM_REMOTE_SEEN 64   // steps whose reports are remembered

// The caller owns this storage and initialises it with zeros.
typedef struct pm_remote_process {
    struct pm_lockstep_coordinator *coordinator; // context of the message handlers
    int id;                                      // of the process in the scene
    const char *name;
    const pm_scene *scene;
    char channel[PM_CHANNEL_SIZE];                   // on which the process publishes reports
    char flux_channel[PM_CHANNEL_SIZE];              // on which the process publishes fluxes
    char address[PM_CHANNEL_SIZE];                   // on which the process receives requests
    pm_report_shape shape[2];                        // of its reports, without and with sums
    portmet_report_t report;                         // the report decoded last
    portmet_flux_t flux;                             // the flux decoded last
    int32_t most_part, most_end, most_z, most_tally; // largest counts of a report
    bool alive;                         // the process sent a message since the last poll
    bool moved;                         // a message since the last poll shows progress
    int64_t asked[4];                   // instance, attempt, step and round of its last request
    int64_t reported;                   // first step of its last report
    int64_t done;                       // steps completed, by report or flux; -1: none
    bool left;                          // the process has sent BYE
    double heard;                       // s, when a message last arrived
    int64_t instance;                   // the instance that reported step 0; 0: none
    int64_t greeted[PM_REMOTE_GREETED]; // the last instances that were greeted; 0: none
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

// Returns the number of steps in `report`.
int pm_remote_process_rows(const pm_remote_process *remote);

// Returns true if `report` has sums, and lists only some subsystems.
bool pm_remote_process_has_sums(const pm_remote_process *remote);

// Adds the sums in row `row` of `report`, if it has any, to the tally of that step.
void pm_remote_process_add_tally(const pm_remote_process *remote, int row, pm_tally *tally);

// Remembers row `row` of `report`, which is of `step`. Returns false if another report of that
// step, one of the last PM_REMOTE_SEEN, had other numbers.
bool pm_remote_process_agrees(pm_remote_process *remote, int row, int64_t step);

// Remembers an instance of the process whose hello fits the run. Only the last PM_REMOTE_GREETED
// instances are remembered.
void pm_remote_process_greet(pm_remote_process *remote, int64_t instance);
// Returns true if the instance is remembered.
bool pm_remote_process_is_greeted(const pm_remote_process *remote, int64_t instance);

// Writes what this process lists in row `row` of `report` into the sample of that step.
void pm_remote_process_fill(const pm_remote_process *remote, int row, pm_sample *sample);

#endif

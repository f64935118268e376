// What the coordinator knows of one process: its channel, which numbers of a sample are its, and
// whether it is alive.
#ifndef PM_LOCKSTEP_REMOTE_PROCESS_H
#define PM_LOCKSTEP_REMOTE_PROCESS_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/recording.h"
#include "transport/transport.h"

// Storage the caller owns.
typedef struct pm_remote_process {
    struct pm_lockstep_coordinator *coordinator; // whose it is
    int id;                                      // of the process
    const char *name;
    const pm_scene *scene;
    char channel[PM_CHANNEL_SIZE];       // of its reports
    char flux_channel[PM_CHANNEL_SIZE];  // of its fluxes
    char address[PM_CHANNEL_SIZE];       // of requests to it
    int nend, nz;                        // ends of ports and components of its subsystems
    int *end;                            // [nend] 2 * position of the port in the scene + end
    portmet_report_t scratch;            // being decoded
    portmet_flux_t shown;                // likewise
    int32_t most_part, most_end, most_z; // numbers in a report
    bool alive;                          // heard of since the last poll
    bool moved;                          // and it had got on, or begun again
    int64_t asked[4];                    // instance, attempt, step and round of its last request
    int64_t reported;                    // the step of its last report
    int64_t done;                        // steps that it told of, by report or flux; -1: none
    bool left;                           // said BYE
    double heard;                        // s, when heard of
    int64_t instance;                    // that reported the initial state; 0: none
} pm_remote_process;

// Name, shape and memory (from the arena). PM_ECONFIG, PM_ENOMEM.
pm_status pm_remote_process_init(pm_remote_process *remote, pm_arena *arena, const pm_scene *scene,
                                 int process_id);

// Decodes a report into `scratch`; a DONE is found to be of whole rows, with the state or without
// it as `with_state` says.
pm_drop pm_remote_process_decode(pm_remote_process *remote, const void *data, size_t size,
                                 bool with_state);

int pm_remote_process_rows(const pm_remote_process *remote); // steps in `scratch`
// Writes this process's part of a step's sample: row `row` of `scratch`.
void pm_remote_process_fill(const pm_remote_process *remote, int row, pm_sample *sample);

#endif

// The shape of a process's reports: which of its subsystems and ends of ports they list, and how
// many numbers that makes. Every subsystem is listed, unless the reports have sums (lcmtypes/
// portmet.lcm, report_t). Reports of sums list the subsystems of pm_scene_lists_subsystem.
#ifndef PM_LOCKSTEP_REPORT_SHAPE_H
#define PM_LOCKSTEP_REPORT_SHAPE_H

#include "lockstep/codec.h"
#include "scene/scene.h"
#include "sim/tally.h"

// The arena owns the arrays.
typedef struct pm_report_shape {
    int npart, nend, nz, ntally; // numbers of one step: subsystems, ends, components, of the tally
    int *part;                   // [npart] positions among the subsystems of the process, ascending
    // [nend] 2 * position of the port in the scene + end: for each listed subsystem its own ends,
    // by port, and then the outside ends of its ports with a boundary input.
    int *end;
    int rows; // the most steps of one report
} pm_report_shape;

// Sets the shapes of the reports of a process: shape[0] without sums, and shape[1] with sums, which
// is zero if the scene may not report sums. PM_ENOMEM.
pm_status pm_report_shapes_init(pm_report_shape shape[2], pm_arena *arena, const pm_scene *scene,
                                int process_id);

// Makes a report message with memory from the arena for as many steps as a report of either shape
// may hold. Its counts are the largest possible ones. PM_ENOMEM.
pm_status pm_report_message_alloc(portmet_report_t *report, pm_arena *arena,
                                  const pm_report_shape shape[2]);

// Lists the ports between two processes, which no report sums up, in the arena. port [count] are
// their positions in the scene. PM_ENOMEM.
pm_status pm_report_ports_between(const pm_scene *scene, pm_arena *arena, int *count, int **port);

#endif

// A recording is an HDF5 file of all samples (sample.h) of a run:
//   /time [sample] s, /step [sample]
//   /subsystems/<name>/z [sample][variable], with the attributes variables and units: one entry for
//     each component, "q[0]"; for more than 1000 components one for each group, "q[0:5000]"
//   /subsystems/<name>/E J, S J/K, bulk_energy W, bulk_entropy W/K [sample]: the series of
//     PM_SUBSYSTEM_NUMBERS (sample.h)
//   /ports/<name>/energy_flux_a, energy_flux_b W, entropy_flux_a, entropy_flux_b W/K [sample]:
//     the series of PM_END_NUMBERS
//   /live/<name> [sample]: the value of a live input during the step before, in SI units; NaN
//       in the sample of step 0
//   /ledger/energy J, entropy J/K, energy_residual, entropy_residual [sample]: the residuals are
//     relative (sim/ledger.h); the totals include what has left through boundary inputs
// The subsystems, or ports, for which one key of the scene stands, such as "link[0:9]", share their
// series, whose name is that key. These have another axis: z [sample][member][variable], E
// [sample][member]. A scene may name the subsystems that the recording keeps. Each then has series
// of its own. The recording keeps only the ports at these subsystems, and always /ledger. The
// attribute `committed` of "/" says how many samples are certain. A run that was killed, or whose
// disk became full, may leave more rows than that in some series; readers stop at `committed`. The
// file has the earliest HDF5 format. Samples are appended in chunks and flushed about once a
// second. After a run was killed, every flushed sample is readable. Space for a chunk is reserved
// before it is written: on a full disk the file stays sound and holds all samples but the last few.
// On a file system that cannot reserve space (FAT, NFS before 4.2) it may be damaged.
#ifndef PM_SCENE_RECORDING_H
#define PM_SCENE_RECORDING_H

#include "scene/sample.h"

// Neighbours in the scene that share their series, or a single subsystem or port.
typedef struct pm_recorded_family {
    const char *name; // in the file
    int first, count; // positions in the scene
    bool is_range;    // the series have an axis for the members
    int state;        // of subsystems: position of the series of their states
} pm_recorded_family;

// The families of all subsystems and ports that a recording of a scene keeps.
typedef struct pm_recorded_families {
    int nsubsystem, nport;
    pm_recorded_family *subsystem, *port; // [nsubsystem], [nport]
} pm_recorded_families;

// Finds the families of a scene. Their arrays lie in the arena, their names in the scene.
// PM_ENOMEM.
pm_status pm_recorded_families_find(pm_recorded_families *families, pm_arena *arena,
                                    const pm_scene *scene);

typedef struct pm_recording pm_recording;

// Checks that a recording can be made at `path`, without changing anything: the folder is writable,
// and `path` is absent, an empty file, or an earlier recording; with `overwrite`, any regular file
// that can be written. PM_EFILE.
pm_status pm_recording_check(const char *path, bool overwrite);
// Opens a recording that replaces the file at `path`. `scene` is borrowed and must outlive it. The
// caller closes it with pm_recording_close. PM_EFILE, PM_ENOMEM.
pm_status pm_recording_open(pm_recording **recording, const char *path, const pm_scene *scene);
// Opens the file at `path` to go on after its first `count` samples; later ones are removed.
// PM_EFILE: fewer samples are certain, or the file is of another scene or damaged. PM_ENOMEM.
pm_status pm_recording_reopen(pm_recording **recording, const char *path, const pm_scene *scene,
                              long count);
// Appends a copy of the sample. PM_EFILE: the disk is full, or writing failed for another reason.
// The description tells how many samples are certain. From then on, only pm_recording_close may
// follow.
pm_status pm_recording_append(pm_recording *recording, const pm_sample *sample);
// Writes all samples so far to the file, so that they stay readable if this process is killed.
// PM_EFILE.
pm_status pm_recording_flush(pm_recording *recording);
// Flushes the samples, closes the file and frees the recording, which is freed after a failure,
// too. PM_EFILE. If an earlier append or flush has failed, nothing is flushed and the result is
// PM_OK. NULL is allowed.
pm_status pm_recording_close(pm_recording *recording);

#endif

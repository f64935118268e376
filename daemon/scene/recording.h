// A sample holds the state and the fluxes of one step of a run. A recording is an HDF5 file of all
// samples:
//   /time [sample] s, /step [sample]
//   /subsystems/<name>/z [sample][variable], with the attributes variables and units: one entry for
//     each component, "q[0]"; for more than 1000 components one for each group, "q[0:5000]"
//   /subsystems/<name>/E J, S J/K, bulk_energy W, bulk_entropy W/K [sample]
//   /ports/<name>/energy_flux_a, energy_flux_b W, entropy_flux_a, entropy_flux_b W/K [sample]
//   /live/<name> [sample]: the value of a live input during the step before, in SI units
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

#include "scene/scene.h"

// The fluxes through one end of a port, positive into the subsystem. Each is a mean over one step
// with the weights of the integrator:
//     energy   of sum_j e_j ydot_j       energy_gross   of sum_j |e_j ydot_j|
//     entropy  of sum_j eta_j ydot_j     entropy_gross  of sum_j |eta_j ydot_j|
// The gross fluxes are the scale of rounding.
typedef struct pm_flux {
    double energy;        // W
    double entropy;       // W/K
    double energy_gross;  // W
    double entropy_gross; // W/K
} pm_flux;

// The state of the whole scene after a step, and what flowed during it.
typedef struct pm_sample {
    long step;            // 0: the initial state, before any step; its fluxes are zero
    double time;          // s, pm_scene_time
    double *z;            // [scene->nz]
    double *energy;       // [nsubsystem] J
    double *entropy;      // [nsubsystem] J/K
    double *bulk_energy;  // [nsubsystem] W, dE . zdot_bulk: 0 to rounding in the hard form
    double *bulk_entropy; // [nsubsystem] W/K, dS . zdot_bulk: production >= 0
    double *bulk_gross;   // [nsubsystem][2] sum_j |dE_j zdot_j|, sum_j |dS_j zdot_j| of the bulk
    pm_flux (*flux)[2];   // [nport][end]
    long *evaluated;      // [nsubsystem] graphs (exposure, bulk, ports) run so far
    long *skipped;        // [nsubsystem] graphs that did not have to be run so far
    long *outside;        // [nsubsystem] steps so far that ended outside the training range
    double *error;        // [nsubsystem] largest relative error of a substep; 0: not estimated
    const double *live;   // [scene->nlive] borrowed: the values of the live inputs during the step
    // The ledger writes these: the worst residuals of the step, what has left through boundary
    // inputs so far, and the counts above of all subsystems.
    double energy_residual, entropy_residual;
    double outside_energy, outside_entropy; // J, J/K
    long evaluated_in_all, skipped_in_all;
    int strayed;  // subsystems that have ended steps outside the training range
    int farthest; // the subsystem with the largest number of such steps, and this number
    long farthest_steps;
} pm_sample;

// Makes a sample of zeros for a scene. The caller frees it. PM_ENOMEM.
pm_status pm_sample_new(pm_sample **sample, const pm_scene *scene);
void pm_sample_free(pm_sample *sample); // NULL is allowed

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

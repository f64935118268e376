// What one step of a run leaves behind, and the HDF5 recording of it:
//   /time [sample] s, /step [sample]
//   /subsystems/<name>/z [sample][variable] (attributes variables, units: an entry for each,
//   "q[0]";
//     of more than 1000 one for each group, "q[0:5000]"), E J, S J/K,
//     bulk_energy W, bulk_entropy W/K [sample]
//   /ports/<name>/energy_flux_a, energy_flux_b W, entropy_flux_a, entropy_flux_b W/K [sample]
//   /ledger/energy J, entropy J/K, energy_residual, entropy_residual [sample] (relative, see
//   ledger.h; the totals hold what loads have given to the world)
// Earliest HDF5 format, appended in chunks and flushed about once a second: a killed run leaves
// every flushed sample readable.
#ifndef PM_SCENE_RECORDING_H
#define PM_SCENE_RECORDING_H

#include "scene/scene.h"

// Fluxes through one end of a port, positive into the subsystem: the integrator's weighted mean
// over one step. gross: the same mean of sum |e_j ydot_j| and sum |eta_j ydot_j|, the scale of
// rounding.
typedef struct pm_flux {
    double energy;  // W
    double entropy; // W/K
    double energy_gross, entropy_gross;
} pm_flux;

// The state of the whole scene after a step, and what flowed during it. Arrays belong to whoever
// made the sample.
typedef struct pm_sample {
    long step;            // 0: the initial state, before any step; its fluxes are zero
    double time;          // s, t0 + step dt
    double *z;            // [scene->nz]
    double *energy;       // [nsubsystem] J
    double *entropy;      // [nsubsystem] J/K
    double *bulk_energy;  // [nsubsystem] W, dE . zdot_bulk: 0 to rounding in the hard form
    double *bulk_entropy; // [nsubsystem] W/K, dS . zdot_bulk: production >= 0
    double *bulk_gross;   // [nsubsystem][2] sum |dE_j zdot_j|, sum |dS_j zdot_j| of the bulk
    pm_flux (*flux)[2];   // [nport][end]
    long *evaluated; // [nsubsystem] exposures, bulk and port terms evaluated so far, and skipped
    long *skipped;
    long *outside; // [nsubsystem] steps so far that ended outside what the weights were trained on
    double *error; // [nsubsystem] largest estimate of a substep's error, relative; 0: not estimated
    // Filled in by the ledger: the step's worst, and what loads have given to the world so far.
    double energy_residual, entropy_residual;
    double outside_energy, outside_entropy; // J, J/K
} pm_sample;

pm_status pm_sample_new(pm_sample **sample, const pm_scene *scene);
void pm_sample_free(pm_sample *sample); // NULL is allowed

typedef struct pm_recording pm_recording;

// Whether a recording could be made at `path`: its folder can be written to, and what stands there,
// if anything, is a file that may be overwritten. Changes nothing. PM_EFILE.
pm_status pm_recording_check(const char *path);
// Replaces the file at `path`. `scene` must outlive it. PM_EFILE, PM_ENOMEM.
pm_status pm_recording_open(pm_recording **recording, const char *path, const pm_scene *scene);
// Goes on with the file at `path` after its first `count` samples; later ones are removed.
// PM_EFILE: it holds fewer, or is of another scene.
pm_status pm_recording_reopen(pm_recording **recording, const char *path, const pm_scene *scene,
                              long count);
pm_status pm_recording_append(pm_recording *recording, const pm_sample *sample);
// All samples so far are in the file, and readable if this process is killed. PM_EFILE.
pm_status pm_recording_flush(pm_recording *recording);
// Flushes and closes. PM_EFILE. NULL is allowed.
pm_status pm_recording_close(pm_recording *recording);

#endif

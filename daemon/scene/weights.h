// Weights files: one HDF5 file per subsystem or port, readable by a person with h5dump.
//   attributes of /: format "portmet weights", version, kind (subsystem | port), model (YAML text),
//     digest (over kind, layout, model text and values as read into double), command, seed,
//     data (what they were trained on), loss, seconds (training time), created (UTC); where steps
//     were fitted, integrator and step (s); of the data the trajectories, and seen, a digest of
//     each; of the state columns, a digest of their names, and relative, the groups measured from
//     a neighbour; and, where the numbers of a state mean nothing without
//     another file, coordinates (which)
//   /layout (port: /layout_a, /layout_b): attributes names, units, sizes
//   /parameters/<name>: [rows][cols] double (float32 is read too), attribute trained
// Written under a temporary name, synced and renamed: never half-written.
#ifndef PM_SCENE_WEIGHTS_H
#define PM_SCENE_WEIGHTS_H

#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"
#include "model/part.h"
#include "model/port.h"

#define PM_MOST_SEEN 7000 // digests of trajectories; an attribute holds no more

// Where weights come from. Text is the caller's on saving, in the arena on loading.
typedef struct pm_provenance {
    const char *path;    // on loading: the file
    const char *command; // that made them
    const char *data;    // the data they were trained on
    // Whose coordinates the variables are, e.g. "basis 0123456789abcdef" (a dataset's note says the
    // same); "" or, on saving, NULL: the variables' names say all.
    const char *coordinates;
    // By what steps they were trained: the method ("" or, on saving, NULL: not known, or rates were
    // fitted and no steps), and the length of one of its steps.
    const char *integrator;
    double step; // s; 0 without integrator
    // Which trajectories of the data they were trained on: as text, such as "0:4,5:9" ("" or, on
    // saving, NULL: not known), and the digest of each (dataset.h), so that evaluations know them
    // again in any file.
    const char *trajectories;
    int nseen; // at most PM_MOST_SEEN are kept
    const uint64_t *seen;
    // Of subsystems: the digest of the columns that were its state (0: not known), and the groups
    // that were measured from a neighbour, joined by blanks (system.h).
    uint64_t columns;
    const char *relative;
    uint64_t seed;
    double loss;
    double seconds;  // training time
    uint64_t digest; // of spec, layout and values; computed by _save, checked by _load
} pm_provenance;

// Loads spec, layout and values and declares the model; on failure the model is untouched.
// PM_EWEIGHTS (file missing, foreign, truncated, wrong version or kind, missing or extra or
// non-finite values, digest), PM_ENOMEM. The caller frees the model (pm_part_free, pm_port_free);
// spec, layout and provenance live in the arena.
pm_status pm_weights_load_part(const char *path, pm_arena *arena, pm_part *part,
                               pm_provenance *provenance);
pm_status pm_weights_load_port(const char *path, pm_arena *arena, pm_port_model *port,
                               pm_provenance *provenance);

// The digest that a file of the model has.
pm_status pm_weights_digest_part(const pm_part *part, uint64_t *digest); // PM_ENOMEM
pm_status pm_weights_digest_port(const pm_port_model *port, uint64_t *digest);

// PM_EFILE, PM_EWEIGHTS (a value that is not finite), PM_ENOMEM.
pm_status pm_weights_save_part(const char *path, const pm_part *part,
                               const pm_provenance *provenance);
pm_status pm_weights_save_port(const char *path, const pm_port_model *port,
                               const pm_provenance *provenance);

#endif

// Weights files: one HDF5 file for each subsystem or port, which h5dump prints readably.
//   Attributes of /:
//     format "portmet weights", version, kind ("subsystem" or "port")
//     model         the YAML text of the model (model_reader.h)
//     digest        over kind, layouts, text of the model, and values as read into double
//     command, seed, loss, seconds (time of training), created (UTC)
//     data          the data of the training
//     integrator, step (s)       only if the training fitted steps
//     verdict       of the fit that made them, beginning with a word such as "good" or "UNFIT"
//     fit           a digest that all files of one fit share, and the names of these files
//     system        the system that the scene of the fit describes: its key `system`, or its name
//     trajectories, seen         the trajectories of the training, as text, and a digest of each
//     columns       a digest of the names of the state's columns
//     relative      the groups that are measured from a neighbour (relative_to)
//     coordinates   names the file without which the variables have no meaning, if there is one
//   /layout, or for a port /layout_a and /layout_b: attributes names, units, sizes, and where some
//     group is shown by its co-energy `coenergies`, 1 for each such group and 0 for the others
//   /parameters/<name>: [rows][cols] double (float32 is read too), attribute trained
// A file is written under a temporary name, synchronised and renamed, so that it is never
// half-written.
#ifndef PM_SCENE_WEIGHTS_H
#define PM_SCENE_WEIGHTS_H

#include <stdint.h>

#include "scene/component.h"

#define PM_MOST_SEEN 7000 // digests of trajectories: an attribute of HDF5 cannot hold more

// The first words of verdicts, from the best to the worst. "unfinished": the fit has not ended.
#define PM_VERDICT_WORDS \
    { "good", "fair", "poor", "unfinished", "UNFIT" }
#define PM_VERDICT_LENGTH 600 // bytes of a verdict, with its end

// The origin of weights. The caller owns the texts when it saves; they live in the arena after
// loading.
struct pm_provenance {
    const char *path;    // of the file; set by loading, ignored by saving
    const char *command; // that made the weights
    const char *data;    // on which they were trained
    // Names the file without which the variables have no meaning, such as the basis of modes, by
    // its digest: "basis 0123456789abcdef". Datasets have the same text as their note
    // `coordinates`. "" or, when saving, NULL: there is no such file.
    const char *coordinates;
    // The integrator whose steps the training fitted, and the length of one step. "" or, when
    // saving, NULL: the training fitted rates, or nothing is known.
    const char *integrator;
    double step; // s; 0 if there is no integrator
    // The verdict of the fit that made the weights: a word of PM_VERDICT_WORDS and, unless that is
    // "good", ": " and the reason. "" or, when saving, NULL: not known.
    const char *verdict;
    // "0123456789abcdef upper.h5 lower.h5": a digest that all files of one fit share, and the names
    // of these files. "" or, when saving, NULL: not known.
    const char *fit;
    // The system that the scene of the fit describes. "" or, when saving, NULL: not known.
    const char *system;
    // The trajectories of the training: as text, such as "0:4,5:9" ("" or, when saving, NULL: not
    // known), and the digest of each (dataset.h), by which evaluations recognise them in any file.
    const char *trajectories;
    int nseen;            // a file keeps at most PM_MOST_SEEN
    const uint64_t *seen; // [nseen]
    // Only for subsystems: the digest of the names of the columns that were its state (0: not
    // known), and the groups that were measured from a neighbour, joined by blanks (system.h).
    uint64_t columns;
    const char *relative;
    uint64_t seed;
    double loss;
    double seconds;  // time of training
    uint64_t digest; // of the content; ignored by saving, checked and set by loading
};

// Loads a model from a file: its spec and layouts, the parameters that these require, and their
// values. On failure the model and `provenance` are untouched. PM_EWEIGHTS: the file is missing,
// truncated or not a weights file, or has another version or kind; a parameter of the model is
// missing, a parameter in the file is none of the model's, or a value is not finite; or the digest
// differs. PM_ENOMEM. The caller frees the model (pm_part_free, pm_port_free); spec, layouts and
// provenance live in the arena.
pm_status pm_weights_load(const char *path, pm_arena *arena, pm_component component,
                          pm_provenance *provenance);

// Saves a model; an existing file is replaced. PM_EFILE, PM_EWEIGHTS (a value is not finite),
// PM_ENOMEM.
pm_status pm_weights_save(const char *path, pm_component component,
                          const pm_provenance *provenance);

#endif

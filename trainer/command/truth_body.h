// The part of `portmet-train truth` that simulates and writes bodies on a mesh.
#ifndef PM_TRAINER_COMMAND_TRUTH_BODY_H
#define PM_TRAINER_COMMAND_TRUTH_BODY_H

#include <signal.h>

#include "truth/truth.h"

// Simulates `count` trajectories from `first` on and prints how well energy is balanced. Writes the
// fields of each body (store/field.h) to a file of its own: `path`, or for a body with a name
// `path` with the name before its ending. An XDMF file (store/xdmf.h) stands beside each. `command`
// is the command line, for the notes. PM_EINTERRUPTED if *stop becomes non-zero, PM_ECONFIG,
// PM_ENUMERIC, PM_EFILE, PM_ENOMEM.
pm_status pm_truth_body_write(const pm_truth *truth, int first, int count, const char *command,
                              const char *path, const volatile sig_atomic_t *stop);

#endif

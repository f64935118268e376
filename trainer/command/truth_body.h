// The part of `portmet-train truth` that is for bodies on a mesh.
#ifndef PM_TRAINER_COMMAND_TRUTH_BODY_H
#define PM_TRAINER_COMMAND_TRUTH_BODY_H

#include <signal.h>

#include "truth/truth.h"

// Simulates `count` trajectories from `first` on, writes them as fields (store/field.h), a file for
// each body (PATH, or with bodies that have names PATH with the name before its ending), beside
// each its XDMF (store/xdmf.h), and prints how well energy is balanced. PM_EINTERRUPTED, and what
// simulating and saving give.
pm_status pm_truth_body_write(const pm_truth *truth, int first, int count, const char *command,
                              const char *path, const volatile sig_atomic_t *stop);

#endif

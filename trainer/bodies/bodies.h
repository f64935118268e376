// What bodies on a mesh add to portmet-train: subcommands, and the ground truth of beams. Only main
// includes this header; nothing else outside this folder knows of bodies.
#ifndef PM_BODIES_BODIES_H
#define PM_BODIES_BODIES_H

#include <signal.h>

#include "truth/truth.h"

// The subcommands, as command/commands.h describes them.
pm_status pm_command_correct(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_reduce(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_nodes(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_reconstruct(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_contact(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_solid(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_respond(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_picture(int argc, char **argv, const volatile sig_atomic_t *stop);

// The simulators of bodies for pm_truth_load; the last row has no name.
extern const pm_truth_simulator pm_body_simulators[];

#endif

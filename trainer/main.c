// portmet-train: the offline tools.
#include "base/linalg.h"
#include "base/subcommand.h"
#include "bodies/bodies.h"
#include "command/commands.h"

static pm_status truth(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_truth(pm_body_simulators, argc, argv, stop);
}

static const pm_subcommand commands[] = {
    {"truth", "simulate ground truth into a dataset", truth},
    {"correct", "correct a simulation by known fields", pm_command_correct},
    {"reduce", "find the modes of a body in its fields", pm_command_reduce},
    {"nodes", "write fields of a body as nodal values", pm_command_nodes},
    {"reconstruct", "turn modes or nodal values into fields of the body", pm_command_reconstruct},
    {"contact", "find where bodies face each other", pm_command_contact},
    {"import", "turn tables of measurements into a dataset", pm_command_import},
    {"inspect", "describe measurements", pm_command_inspect},
    {"propose", "write a training file for a scene and its data", pm_command_propose},
    {"fit", "train weights on a dataset", pm_command_fit},
    {"evaluate", "score rollouts of a scene against a dataset", pm_command_evaluate},
    {"solid", "learn the material of a body from its fields", pm_command_solid},
    {"respond", "compute how a body of learned material responds to forces", pm_command_respond},
    {"picture", "draw bodies on a mesh, coloured by stress", pm_command_picture},
};

static const pm_subcommands program = {
    .program = "portmet-train",
    .about =
        "Makes the weights of learned thermodynamic subsystems: simulates ground truth, prepares\n"
        "data, trains models, and scores their rollouts.",
    .codes =
        "0 success, 2 command line, 3 configuration, 4 file, 5 data, 6 weights,\n"
        "9 numerics, 10 a law violated, 11 memory, 12 interrupted, 13 the trained model is unfit.",
    .second_signal_ends = true,
    .count = sizeof commands / sizeof *commands,
    .command = commands,
};

int main(int argc, char **argv) {
    pm_linalg_init();
    return pm_subcommand_main(&program, argc, argv);
}

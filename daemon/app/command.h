// The subcommands of portmetd, and the options with which they are called. There is one table of
// options (main.c), of which each subcommand accepts some. A new subcommand needs a file, a line
// here and a line in main.c.
#ifndef PM_APP_COMMAND_H
#define PM_APP_COMMAND_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/journal.h"
#include "base/status.h"

// The options that a subcommand was given. Text points into argv; text that was not given is NULL.
typedef struct pm_run_options {
    const char *scene, *name; // positional; `name` only where the subcommand has two
    const char *weights, *url, *record, *replay, *checkpoint, *c_folder, *output;
    const char *bind, *recording;
    const char *pace;              // of a run; NULL: the scene's
    const char *state;             // numbers of a state
    const char *trajectory, *data; // number of the trajectory in whose first state a run begins,
                                   // and its dataset; NULL: the reference
    const char *inputs;            // values of live inputs
    const char *hosts;             // of the processes, for `emit`
    const char *fmi;               // version of the FMU that is written
    const char *author;            // of its model; NULL: not named
    const char *text;              // of the scene; NULL: that of the file `scene`
    const char *other;             // folder of the weights that another host has
    double budget;                 // s, of a study; 0: not given
    double error;                  // %, that advice is for; 0: not given
    const char *write;             // file of a scene
    const char *starts;            // dataset of the states in which copies start
    const char *picture;           // name of a picture, without its ending
    const char *control;           // who may control a service besides clients; NULL: nobody
    int64_t seed;                  // of random starts
    int64_t steps;                 // number of steps of the run; 0: as the scene says
    int64_t session;   // number of the session to join or to open; 0: no session was given
    int64_t address;   // the session that the user has given, by which clients address a run
    int64_t port, udp; // numbers of ports; 0: not given
    int64_t copies;    // of the scene; 0: a run of one, or as many as `starts` has
    bool in_process, quiet, overwrite;
    bool compiled;            // models become machine code
    bool stays;               // a node serves one run after another
    bool elsewhere;           // nobody launches the nodes here
    bool held, endless, wait; // a run is held at its start; it has no last step; until it ends
    bool here;                // a test uses the network that is there
    bool processes;           // a bench measures cuts into processes
    bool json;                // results are printed as JSON
    bool coordinator_speaks;  // a node leaves it to the coordinator to print why the run has failed
    pm_journal log;           // of the lines on standard error
    const volatile sig_atomic_t *stop; // becomes non-zero when the user interrupts the program
} pm_run_options;

typedef struct pm_command {
    const char *name;
    const char *summary;   // half a line
    const char *arguments; // positional, "SCENE" or "SCENE NAME"
    const char *help;      // paragraphs
    const char *examples;  // commands, one a line
    const char *accepts;   // words of options in the table of main.c, separated by blanks
    // Returns PM_EINTERRUPTED soon after *options->stop becomes non-zero.
    pm_status (*execute)(const pm_run_options *options);
} pm_command;

extern const pm_command pm_command_run, pm_command_serve, pm_command_node, pm_command_coordinator,
    pm_command_status, pm_command_view, pm_command_export, pm_command_emit, pm_command_check,
    pm_command_start, pm_command_pause, pm_command_resume, pm_command_advance, pm_command_set,
    pm_command_reset, pm_command_stop, pm_command_query, pm_command_reload, pm_command_checkpoint,
    pm_command_restore, pm_command_test, pm_command_bench, pm_command_stress;

#endif

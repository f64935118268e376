// The command line of a subcommand: one table gives the parser, the checks and the help.
#ifndef PM_TRAINER_COMMAND_OPTIONS_H
#define PM_TRAINER_COMMAND_OPTIONS_H

#include <stdbool.h>

#include "base/status.h"

// An option: a switch, or one with a value. Exactly one of `on` and `text` is set.
typedef struct pm_option {
    const char *name;  // e.g. "--output"
    const char *brief; // e.g. "-o"; NULL: none
    const char *value; // what its value is called in the help, e.g. "FILE"; NULL: a switch
    bool *on;          // set true when the switch is given
    const char **text; // set to the value when the option is given
    bool required;
    const char *help;
} pm_option;

typedef struct pm_options {
    const char *usage;           // e.g. "portmet-train truth CONFIG -o FILE [options]"
    const char *summary;         // a paragraph for the help
    const char *positional_name; // the positional argument, required, e.g. "CONFIG"
    const char **positional;     // [most], NULL to begin with
    int most;                    // how many there may be; 0: one
    int count;
    const pm_option *option;
} pm_options;

// Reads the arguments; "--name=value" works as well. PM_EUSAGE names the offending argument. With
// --help or -h the help is printed to standard output and *helped becomes true: nothing else to do.
pm_status pm_options_read(const pm_options *options, int argc, char **argv, bool *helped);

// "A:B", "A:", ":B" or "A": A up to, not including, B, out of 0 .. count-1; NULL means all.
// PM_EUSAGE.
pm_status pm_options_range(const char *text, int count, int *first, int *end);

// The same, or several of these joined by commas, "0:4,7,9:": which [count], and how
// many there are. One named twice is an error.
pm_status pm_options_list(const char *text, int count, int *which, int *nwhich);

// A number > 0, the value of option `name`. PM_EUSAGE.
pm_status pm_options_positive(const char *name, const char *text, double *result);

// At most `most` of them joined by commas: result [most], and how many there are.
pm_status pm_options_positives(const char *name, const char *text, int most, double *result,
                               int *count);

// Makes the folder `path` and those above it, where they are missing. PM_EFILE: it cannot be made
// or written; PM_ENOMEM.
pm_status pm_options_folder(const char *path);

// The arguments joined by blanks into `line` (cut to `size`), for provenance.
void pm_options_line(int argc, char **argv, char *line, int size);

#endif

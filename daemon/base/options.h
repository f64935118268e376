// Reads the command line of a subcommand. One table of options gives the parser, the checks and the
// help. Values remain text; the functions below turn text into numbers.
#ifndef PM_BASE_OPTIONS_H
#define PM_BASE_OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"

// One option: a switch, which sets `on`, or an option with a value, which sets `text` or a number.
// Exactly one of the places is not NULL.
typedef struct pm_option {
    const char *name;  // such as "--output"
    const char *brief; // such as "-o"; NULL: the option has no short form
    const char *value; // what the help calls the value, such as "FILE"; NULL: a switch
    bool *on;          // becomes true when the switch is given
    const char **text; // becomes the value when the option is given
    bool required;     // of a text
    const char *help;
    bool is_output;   // the text is the path of a file that is written at the end, in a folder that
                      // must exist: a command that works for minutes must not find out that late.
    double *positive; // becomes the value, a number > 0
    int64_t *count;   // becomes the value, a whole number from `least` to `most`
    int64_t least, most;
    const char *kind; // of the output (base/files.h); NULL: the command checks it
    const char *word; // by which the commands that have the option name it, in a table for several
} pm_option;

// Several values of an option; they point into argv.
typedef struct pm_words {
    int count;
    const char **word; // [count]; the caller frees it
} pm_words;

typedef struct pm_options {
    const char *usage;           // such as "portmet-train truth CONFIG -o FILE [options]"
    const char *summary;         // paragraphs for the help
    const char *examples;        // commands for the help, one a line; NULL: none
    const char *positional_name; // names of the positional arguments, such as "SCENE NAME"
    const char **positional;     // receives the arguments; NULL before reading
    // Bounds of the number of arguments; both 0: as many arguments as positional_name has names;
    // least -1: none is needed.
    int least, most;
    int count;
    const pm_option *option; // [count]
    // The name of an option that may have several values, up to the next option, or NULL. `words`,
    // which is empty before reading, receives them all, and the option's `text` the first. If
    // positional arguments are missing in the end, the last values are taken for them.
    const char *several;
    pm_words *words;
    // Further such options, whose last one has no name, or NULL. Their values are never arguments.
    const struct pm_several {
        const char *name;
        pm_words *words;
    } * others;
} pm_options;

// The members `count` and `option` for an array of options.
#define PM_OPTION_TABLE(table) .count = sizeof(table) / sizeof *(table), .option = (table)

// Reads what follows a subcommand's name, argv[0]. An option's value may follow it or be joined to
// it by "=". After "--" all arguments are positional. Texts point into argv. PM_HELPED: --help or
// -h was among the arguments, and the help went to standard output. PM_EUSAGE names the offending
// argument. Notes the positional arguments and the values of `several` as inputs, and fails for an
// output with a kind as pm_files_check_output does. PM_EFILE: there is no folder for an output.
pm_status pm_options_read(const pm_options *options, int argc, char **argv);

// Reads a range of the trajectories 0 ... count - 1: "A:B" means A up to, not including, B; "A:"
// means from A on, ":B" means up to B, "A" means one trajectory, and NULL means all. PM_EUSAGE: the
// text has another form or leaves the range.
pm_status pm_options_range(const char *text, int count, int *first, int *end);

// Reads ranges joined by commas, such as "0:4,7,9:". Writes the numbers of the trajectories, in the
// order of the text, to which [count], and their number to `nwhich`. PM_EUSAGE: a range is wrong,
// or a trajectory is named twice.
pm_status pm_options_list(const char *text, int count, int *which, int *nwhich);

// Checks that there is a folder for the file `path`, the value of the option `name`, as
// pm_options_read does for an output. NULL is allowed and means that the option was not given.
// PM_EFILE.
pm_status pm_options_output(const char *name, const char *path);

// Makes the folder `path` and its parents if they do not exist. PM_EFILE: it cannot be made or
// written; PM_ENOMEM.
pm_status pm_options_folder(const char *path);

// Writes the program's name and the arguments, joined by blanks, into `line` [size]. Output files
// keep this line as a record of their provenance. A longer line is cut.
void pm_options_line(int argc, char **argv, char *line, int size);

#endif

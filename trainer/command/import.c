// portmet-train import: turns tables of measurements into a dataset.
#include "command/commands.h"

#include <stdlib.h>

#include "base/options.h"
#include "command/tables.h"

#define MOST_FILES 10000

pm_status pm_command_import(int argc, char **argv, const volatile sig_atomic_t *stop) {
    const char **file = calloc(MOST_FILES + 1, sizeof *file), *output = NULL, *log = NULL;
    pm_tables_how how = {0};
    (void)stop; // the reader is interrupted by the same signal
    PM_TRY(pm_allocated(file, "an import"));
    const pm_option option[] = {
        {"--output", "-o", "FILE", NULL, &output, true, .help = "dataset to write (HDF5)",
         .is_output = true},
        {"--time", NULL, "NAME", NULL, &how.time, false,
         .help = "the column with times, also as \"NAME [UNIT]\"; default: t, time or time stamps"},
        {"--dt", NULL, "SECONDS", NULL, &how.dt, false,
         .help = "the time between two rows, where no column has times"},
        {"--missing", NULL, "VALUES", NULL, &how.missing, false,
         .help = "what stands for missing samples: numbers or words, such as -999,9999,OVL"},
        {"--runs", NULL, "NAME", NULL, &how.runs, false,
         .help =
             "the array of structs whose elements are the runs, or the column that numbers them"},
        {"--log", NULL, "FILE", NULL, &log, false, .help = "an LCM log, one more table"},
        {"--types", NULL, "FILE", NULL, &how.types, false,
         .help = "the message types of LCM logs: FILE.lcm, several joined by commas, or a folder"},
        {"--units", NULL, "NAME=UNIT,...", NULL, &how.units, false,
         .help = "units of columns, in place of the table's, such as q=rad,w=rad/s"},
    };
    const pm_options options = {
        .usage = "portmet-train import TABLE... -o FILE [options]",
        .summary =
            "Turns tables of measurements into a dataset, one trajectory from each. A table is a\n"
            "text file of a logger or a spreadsheet (CSV), a MATLAB file, an LCM log, a recording\n"
            "or a dataset of portmet, a Parquet file, or a folder of these. In a text file a line\n"
            "names the columns, with units in brackets, t [s], theta (rad), or in the line below.\n"
            "Lines above the table, comments, columns of words and the index of pandas are left\n"
            "out. Separators, decimal commas, time stamps (2024-01-31T12:00:00.5+01:00) and "
            "places\n"
            "without a sample (nothing, nan, N/A) are found. Times may be in s, ms or us, and "
            "need\n"
            "not be even; of rows with the same time the first one counts. In MATLAB files,\n"
            "vectors and matrices are columns, also in structs, and the elements of an array of\n"
            "structs are runs. Python reads the files: python3-h5py, for MATLAB python3-scipy.",
        .examples = "portmet-train import run_1.csv run_2.csv -o runs.h5\n"
                    "portmet-train import --log LOG --types T.lcm --units ARM.q=rad,ARM.w=rad/s "
                    "-o runs.h5",
        .positional_name = "TABLE",
        .positional = file,
        .least = -1,
        .most = MOST_FILES,
        PM_OPTION_TABLE(option),
    };
    int count = 0;
    pm_status status;
    PM_TRY_DONE(pm_options_read(&options, argc, argv));
    while (file[count] != NULL) {
        ++count;
    }
    if (log != NULL) {
        file[count++] = log;
    }
    status = count > 0 ? pm_tables_import(count, file, output, &how, false)
                       : pm_fail(PM_EUSAGE, "import: no TABLE is given; usage: %s", options.usage);
done:
    free(file);
    return status;
}

// Tables: files of loggers and other programs (text, MATLAB, LCM logs, ...) that are turned into a
// dataset. A program in Python reads them (daemon/python/portmet/tables), as a child process.
#ifndef PM_TRAINER_COMMAND_TABLES_H
#define PM_TRAINER_COMMAND_TABLES_H

#include <limits.h>
#include <stdbool.h>

#include "base/options.h"

// What the reader may be told about tables; NULL: nothing.
typedef struct pm_tables_how {
    const char *time;    // the column with times
    const char *dt;      // s between two rows, where there are no times
    const char *missing; // numbers that stand for missing samples, such as "-999,9999"
    const char *runs;    // the array of structs, or the column, that divides a file into runs
    const char *types;   // .lcm file with the types of an LCM log
    const char *units;   // of columns, such as "q=rad,w=rad/s"
    bool temporary;      // the dataset is removed soon, so that its name is not printed
} pm_tables_how;

// Turns tables [count] into the dataset `output`. The reader prints what it leaves out and changes,
// unless `quiet`. A failure of the reader was printed by it: pm_error() is then "". PM_EFILE: a
// table or the reader is missing or cannot be read; PM_EDATA: the content of a table is wrong;
// PM_EINTERRUPTED; PM_ENOMEM.
pm_status pm_tables_import(int count, const char *const *table, const char *output,
                           const pm_tables_how *how, bool quiet);

// The dataset that the option --data of a command names.
typedef struct pm_data_file {
    const char *path;  // NULL: the option was not given
    bool temporary;    // pm_data_close removes the file
    const char *table; // the first of the tables that were imported
    char own[PATH_MAX];
} pm_data_file;

// Finds the dataset of the files `given`: a single dataset is used as it is; tables, and several
// files, are imported. The new dataset is kept as `keep`, or is temporary if that is NULL. Fails as
// pm_tables_import does.
pm_status pm_data_open(pm_data_file *data, const pm_words *given, const char *keep, bool quiet);
// Removes a temporary dataset. An error that begins with its path then begins with that of the
// first table. A zeroed structure is allowed.
void pm_data_close(pm_data_file *data);

#endif

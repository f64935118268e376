// A table of numbers: what `portmet-train import` reads from a file.
#ifndef PM_TRAINER_COMMAND_TABLE_H
#define PM_TRAINER_COMMAND_TABLE_H

#include "base/arena.h"
#include "base/status.h"

#define PM_MOST_TABLE_COLUMNS 1000

typedef struct pm_table {
    pm_arena arena; // owns all
    int nrow, ncolumn;
    const char **name; // [ncolumn]
    const char **unit; // [ncolumn] "" if the file gives none
    double *value;     // [nrow][ncolumn] NaN where the file has nothing
} pm_table;

// Reads the real matrices of numbers of a MATLAB file (version 4 to 7.3) as a zeroed table, also
// those that are fields of a struct. A vector becomes a column with the name of the variable or
// field; a matrix x becomes the columns x_1, x_2, and so on. The table has as many samples as the
// longest variable. Samples are the rows of a matrix, or its columns if only these are as many.
// What has another size or kind is left out, and a line of the output names it. The caller frees
// the arena, after a failure, too. PM_EFILE: the file cannot be read, or the program was built
// without libmatio; PM_EDATA: nothing is left, or two columns have the same name; PM_ENOMEM.
pm_status pm_table_read_matlab(pm_table *table, const char *path);

#endif

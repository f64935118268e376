// Programs of the Python package (daemon/python/portmet) that the programs call: the reader of
// tables, and the one that draws pictures with gnuplot.
#ifndef PM_BASE_PYTHON_H
#define PM_BASE_PYTHON_H

#include <stdbool.h>
#include <stdio.h>

#include "base/status.h"

// A program: its folder in the package, and what is said where Python is not installed.
typedef struct pm_python_program {
    const char *folder, *missing;
} pm_python_program;

// Draws pictures: python/portmet/pictures/__main__.py describes its arguments.
extern const pm_python_program pm_python_pictures;

// Runs a program with the arguments, whose last one is NULL. With `quiet` nobody sees what it
// prints. A failure of the program was printed by it, so that pm_error() is then "". PM_EFILE: it
// is not installed, or it says so; PM_EDATA, PM_EUSAGE, PM_EINTERRUPTED, PM_ENOMEM: it says so.
pm_status pm_python_run(const pm_python_program *program, const char *const *argument, bool quiet);

// Makes `folder`, if it is missing, in one that exists. PM_EFILE.
pm_status pm_python_folder(const char *folder);
// Opens the table of numbers `name` in `folder` for writing, and closes it. PM_EFILE.
pm_status pm_python_table(FILE **file, const char *folder, const char *name);
pm_status pm_python_table_close(FILE *file, const char *folder);
// Opens NAME.txt, the table of the picture NAME, for writing; with file == NULL it only checks that
// it may. The caller closes it. PM_EUSAGE: the program reads this file; PM_EFILE, also if it is
// none that this function has begun.
pm_status pm_python_picture_table(FILE **file, const char *name);

#endif

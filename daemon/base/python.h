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
// Checks that the pictures of a `kind`, with their scripts and tables, may be written. `start` is
// the folder for which the program of pictures is called, or for the kinds bench, stress, bodies
// and xdmf the path without its ending. To be called before the work that leads to the pictures.
// PM_EUSAGE: the program reads one of the files. PM_EFILE: one is of no picture
// (base/files.h: PM_FILES_PICTURE), or cannot be written.
pm_status pm_python_check_pictures(const char *kind, const char *start);
// Opens the file `start``end`, such as "folder" and "/errors.txt", for writing, begins it as the
// table of a picture, and closes it. PM_EFILE; PM_EUSAGE: the program reads this file.
pm_status pm_python_table(FILE **file, const char *start, const char *end);
pm_status pm_python_table_close(FILE *file, const char *start);

#endif

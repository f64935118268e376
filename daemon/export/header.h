// Writes the header of an exported scene: its interface, and what each number means.
#ifndef PM_EXPORT_HEADER_H
#define PM_EXPORT_HEADER_H

#include <stdio.h>

#include "library/setup.h"

// Writes the header to the file. PM_ENOMEM.
pm_status pm_export_header(FILE *file, const pm_setup *setup);

#endif

// Writes a scene as an FMU of FMI 3.0 for Model Exchange and Co-Simulation: the exported C source,
// its description, and a binary for this kind of machine.
#ifndef PM_EXPORT_FMU_H
#define PM_EXPORT_FMU_H

#include "library/setup.h"

// Writes the FMU of a completed setup to the file `path`, which is replaced. *compiled tells
// whether it has a binary: without a C compiler (the command CC, or cc) it has sources alone, which
// importers compile themselves. Fails as pm_export_source does, and with PM_EFILE.
pm_status pm_export_fmu(const pm_setup *setup, const char *path, bool *compiled);

#endif

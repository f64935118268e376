// Writes a scene as an FMU of FMI 3.0 or 2.0 for Model Exchange and Co-Simulation: the exported C
// source, its description, and a binary for this kind of machine.
#ifndef PM_EXPORT_FMU_H
#define PM_EXPORT_FMU_H

#include "library/setup.h"

// Writes the FMU of a completed setup, of the version 2 or 3, to the file `path`, which is
// replaced. `author` is the author of the model; NULL: not named. Sets *compiled to true if the FMU
// holds a binary. Where there is no C compiler (the command in the environment variable CC, or cc),
// the FMU holds only sources, which importers compile themselves. Fails as pm_export_c does.
pm_status pm_export_fmu(const pm_setup *setup, int version, const char *author, const char *path,
                        bool *compiled);

#endif

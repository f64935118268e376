// The XML files of an FMU: modelDescription.xml, buildDescription.xml and terminalsAndIcons.xml of
// FMI 3.0.1.
#ifndef PM_EXPORT_DESCRIPTION_H
#define PM_EXPORT_DESCRIPTION_H

#include <stdio.h>

#include "library/setup.h"

// The value references of an FMU (fmi/fmi3.c). Each member is the reference of the first variable
// of its kind; the others follow it. The reference 0 is the time.
typedef struct pm_fmu_references {
    int state, derivative, input, energy, entropy, flux;
} pm_fmu_references;

// Returns the value references of the FMU of a scene.
pm_fmu_references pm_fmu_references_of(const pm_scene *scene);

// Returns the instantiationToken of FMI 3.0, a text in the arena by which an importer checks that
// description and binary belong together. NULL: out of memory.
const char *pm_fmu_token(const pm_setup *setup, pm_arena *arena);

// Each function writes one of the three XML files. PM_ENOMEM.
pm_status pm_fmu_model_description(FILE *file, const pm_setup *setup);
pm_status pm_fmu_build_description(FILE *file, const pm_setup *setup);
pm_status pm_fmu_terminals(FILE *file, const pm_setup *setup);

#endif

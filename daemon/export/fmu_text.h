// The sources that every FMU holds, as arrays of lines. The build generates the arrays from the
// files in the folder fmi.
#ifndef PM_EXPORT_FMU_TEXT_H
#define PM_EXPORT_FMU_TEXT_H

extern const char *const pm_fmu_types_text[];     // ends with NULL
extern const char *const pm_fmu_interface_text[]; // ends with NULL
extern const char *const pm_fmu_state_text[];     // ends with NULL
extern const char *const pm_fmu_unused_text[];    // ends with NULL

#endif

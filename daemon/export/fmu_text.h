// The sources that every FMU holds: the files of the folder fmi, line by line. The build makes
// them from these files.
#ifndef PM_EXPORT_FMU_TEXT_H
#define PM_EXPORT_FMU_TEXT_H

extern const char *const pm_fmu_types_text[];     // ends with NULL
extern const char *const pm_fmu_interface_text[]; // ends with NULL
extern const char *const pm_fmu_state_text[];     // ends with NULL
extern const char *const pm_fmu_unused_text[];    // ends with NULL

#endif

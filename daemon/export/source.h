// Writes a scene as standalone C99: a header and a source that need only a compiler and libm,
// allocate nothing, and step with the same bits as `portmetd run --in-process`.
#ifndef PM_EXPORT_SOURCE_H
#define PM_EXPORT_SOURCE_H

#include <stdio.h>

#include "library/setup.h"

// Checks that the scene has an integrator that can be exported: an explicit Runge-Kutta method with
// a fixed number of substeps. PM_ECONFIG.
pm_status pm_export_check(const pm_scene *scene);

// Writes the source SCENE.c of a completed setup to an open file; header.h writes SCENE.h. Fails as
// pm_export_check and pm_export_functions_write do.
pm_status pm_export_source(FILE *file, const pm_setup *setup);

// Writes SCENE.c and SCENE.h into `folder`, which it makes if it does not exist. Fails as
// pm_export_source and pm_export_header do. PM_EFILE: a file cannot be written.
pm_status pm_export_c(const pm_setup *setup, const char *folder);

#endif

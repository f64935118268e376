// Stands in for the library of Gmsh where it was not found.
#include "bodies/mesh/gmsh_file.h"

pm_status pm_gmsh_read(pm_solid_mesh *mesh, const char *path, const char *clamped, bool split,
                       pm_arena *arena) {
    (void)mesh;
    (void)clamped;
    (void)split;
    (void)arena;
    return pm_fail(PM_ECONFIG,
                   "%s: this program was built without Gmsh (Debian: libgmsh-dev), which reads it",
                   path);
}

// Reads the hexahedra of a mesh or of a geometry by the library of Gmsh (Geuzaine and Remacle, Int.
// J. Numer. Methods Eng. 79, 2009), which knows MSH, UNV, Nastran, VTK and other formats.
#ifndef PM_BODIES_MESH_GMSH_FILE_H
#define PM_BODIES_MESH_GMSH_FILE_H

#include "base/arena.h"
#include "base/status.h"
#include "store/solid_mesh.h"

// Reads the mesh of the file `path`; a geometry without elements is meshed. The nodes of the
// physical groups with the name `clamped` do not move, or those in a plane such as "x=0". With
// `split`, tetrahedra, prisms and hexahedra become smaller hexahedra. The arrays lie in the arena.
// PM_EFILE: Gmsh cannot read the file. PM_EDATA: an element of the volume is no hexahedron with
// eight nodes or has no positive volume, no element is there, no group has the name, or no node
// lies in the plane. PM_ENOMEM. PM_ECONFIG: the program was built without Gmsh.
pm_status pm_gmsh_read(pm_solid_mesh *mesh, const char *path, const char *clamped, bool split,
                       pm_arena *arena);

#endif

// The mesh of a body in HDF5: its nodes, its bricks and the nodes that do not move. Files of fields
// (field.h) that `portmet-train truth` writes have all three, too, and are read as meshes.
//   /node_position_reference  [node][3]    m, undeformed
//   /hexahedra                [element][8] nodes, numbered as in VTK
//   /clamped                  [node]       1: the node does not move; 0: it does
//   /contact                  [n]          nodes on which ports of the law `contact` act; may be
//   missing
#ifndef PM_STORE_SOLID_MESH_H
#define PM_STORE_SOLID_MESH_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_BRICK_NODES 8

// Plain data; the caller owns the arrays.
typedef struct pm_solid_mesh {
    int nnode, nelement;
    const double *position; // [nnode][3] m, undeformed
    const int *brick;       // [nelement][PM_BRICK_NODES] nodes, numbered as in VTK
    const bool *clamped;    // [nnode] nodes that do not move
    int ncontact;
    const int *contact; // [ncontact] nodes on which ports of the law `contact` act
} pm_solid_mesh;

// Loads a mesh; its arrays lie in the arena. PM_EFILE: the file cannot be read. PM_EDATA: it is no
// mesh, or an element or the list of contact nodes names a node that does not exist. PM_ENOMEM.
pm_status pm_solid_mesh_load(pm_solid_mesh *mesh, const char *path, pm_arena *arena);
// Writes a mesh; the file appears whole or not at all. PM_EFILE, PM_ENOMEM.
pm_status pm_solid_mesh_save(const pm_solid_mesh *mesh, const char *path);

// Returns the digest with the content of the mesh folded in.
uint64_t pm_solid_mesh_digest(const pm_solid_mesh *mesh, uint64_t digest);

#endif

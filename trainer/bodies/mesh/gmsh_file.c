// Reads meshes by the library of Gmsh.
#include "bodies/mesh/gmsh_file.h"

#include <gmshc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/solid/brick.h"

// Gmsh's number of the hexahedron with eight nodes. It orders them as VTK does.
#define HEXAHEDRON 5
// Nodes closer to a plane than this share of the body's largest coordinate range lie in it. Some
// formats have seven digits.
#define IN_PLANE 1e-5

// What Gmsh gives of a mesh. It owns the arrays until they are freed.
typedef struct gmsh_mesh {
    size_t *node;                // [nnode] tags
    double *x;                   // [nnode][3]
    size_t nnode, most;          // the largest tag
    int *type;                   // [ntype] of elements of the volume
    size_t **element, *nelement; // [ntype] tags, and their numbers
    size_t **corner, *ncorner;   // [ntype] tags of their nodes
    size_t ntype, nlist;
} gmsh_mesh;

static void free_lists(size_t **list, size_t count) {
    for (size_t i = 0; i < count; ++i) {
        gmshFree(list[i]);
    }
    gmshFree(list);
}

static void close_mesh(gmsh_mesh *g) {
    gmshFree(g->node);
    gmshFree(g->x);
    gmshFree(g->type);
    free_lists(g->element, g->nlist);
    free_lists(g->corner, g->nlist);
    gmshFree(g->nelement);
    gmshFree(g->ncorner);
}

static pm_status fail(const char *path) {
    char *text = NULL, *version = NULL;
    int error = 0;
    gmshLoggerGetLastError(&text, &error);
    const bool known = text != NULL && text[0] != 0;
    gmshOptionGetString("General.Version", &version, &error);
    // A file of a format that Gmsh does not know is read as a script.
    const pm_status status =
        known && strstr(text, "syntax error") != NULL
            ? pm_fail(PM_EFILE,
                      "%s: Gmsh: %s: the file is damaged, or Gmsh %s does not read its format",
                      path, text, version == NULL ? "" : version)
            : pm_fail(PM_EFILE, "%s: Gmsh: %s", path, known ? text : "unknown error");
    gmshFree(text);
    gmshFree(version);
    return status;
}

// --- reading ---

static pm_status read_elements(gmsh_mesh *g, const char *path) {
    int error = 0;
    gmshModelMeshGetElements(&g->type, &g->ntype, &g->element, &g->nelement, &g->nlist, &g->corner,
                             &g->ncorner, &g->nlist, 3, -1, &error);
    return error != 0 ? fail(path) : PM_OK;
}

// Opens a mesh, or meshes a geometry.
static pm_status read_all(gmsh_mesh *g, const char *path, bool split) {
    int error = 0;
    FILE *file = fopen(path, "r"); // Gmsh would start a new model
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: the file cannot be read", path);
    }
    fclose(file);
    gmshOpen(path, &error);
    PM_TRY(error != 0 ? fail(path) : read_elements(g, path));
    const bool meshed = g->ntype > 0;
    if (split) {
        gmshOptionSetNumber("Mesh.SubdivisionAlgorithm", 2, &error);
    }
    if (!meshed) {
        gmshModelMeshGenerate(3, &error); // splits elements, too
    } else if (split) {
        // New nodes lie on straight edges: a mesh has no curves to put them on.
        gmshOptionSetNumber("Mesh.SecondOrderLinear", 1, &error);
        gmshModelMeshRefine(&error);
    }
    PM_TRY(error != 0 ? fail(path) : PM_OK);
    if (!meshed || split) {
        close_mesh(g);
        *g = (gmsh_mesh){0};
        PM_TRY(read_elements(g, path));
    }
    double *parameter = NULL;
    size_t ncoordinate = 0, nparameter = 0;
    gmshModelMeshGetNodes(&g->node, &g->nnode, &g->x, &ncoordinate, &parameter, &nparameter, -1, -1,
                          0, 0, &error);
    gmshFree(parameter);
    for (size_t i = 0; i < g->nnode; ++i) {
        g->most = g->node[i] > g->most ? g->node[i] : g->most;
    }
    return error != 0 ? fail(path) : PM_OK;
}

// --- checks ---

// Refuses elements of the volume that are not hexahedra with eight nodes, and finds the place of
// these.
static pm_status find_bricks(const gmsh_mesh *g, const char *path, size_t *at) {
    *at = g->ntype;
    for (size_t i = 0; i < g->ntype; ++i) {
        char *name = NULL;
        double *local = NULL;
        size_t nlocal = 0;
        int dimension, order, nnode, nprimary, error = 0;
        if (g->type[i] == HEXAHEDRON) {
            *at = i;
            continue;
        }
        gmshModelMeshGetElementProperties(g->type[i], &name, &dimension, &order, &nnode, &local,
                                          &nlocal, &nprimary, &error);
        const pm_status status =
            pm_fail(PM_EDATA,
                    "%s: element %zu (one of %zu) is a %s, expected hexahedra with eight nodes; "
                    "--split makes them of elements of first order",
                    path, g->element[i][0], g->nelement[i], name == NULL ? "different one" : name);
        gmshFree(name);
        gmshFree(local);
        return status;
    }
    return *at < g->ntype
               ? PM_OK
               : pm_fail(PM_EDATA,
                         "%s: no element of a volume, expected hexahedra; a surface becomes a "
                         "volume by a .geo file (TRUTH.md, Meshes)",
                         path);
}

// Returns true if an element with these nodes [PM_BRICK_NODES] has positive volume everywhere.
static bool is_good(const pm_solid_mesh *mesh, const int *node) {
    double x[3 * PM_BRICK_NODES];
    pm_brick brick;
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        memcpy(x + 3 * n, mesh->position + 3 * (ptrdiff_t)node[n], 3 * sizeof *x);
    }
    return pm_brick_make(&brick, x);
}

// Marks the nodes of the physical groups with a name, by the numbers of their tags, `number`
// [most + 1] or -1.
static pm_status clamp_groups(const char *wanted, const int *number, size_t most, const char *path,
                              bool *clamped) {
    int *pair = NULL, error = 0;
    size_t count = 0, found = 0;
    char names[200] = ""; // of the other groups, for a message
    gmshModelGetPhysicalGroups(&pair, &count, -1, &error);
    for (size_t i = 0; i + 1 < count && error == 0; i += 2) {
        char *name = NULL;
        gmshModelGetPhysicalName(pair[i], pair[i + 1], &name, &error);
        if (name != NULL && strcmp(name, wanted) == 0) {
            size_t *tag = NULL, ntag = 0, ncoordinate = 0;
            double *x = NULL;
            gmshModelMeshGetNodesForPhysicalGroup(pair[i], pair[i + 1], &tag, &ntag, &x,
                                                  &ncoordinate, &error);
            for (size_t k = 0; k < ntag && error == 0; ++k) {
                if (tag[k] <= most && number[tag[k]] >= 0) {
                    clamped[number[tag[k]]] = true;
                }
            }
            gmshFree(tag);
            gmshFree(x);
            ++found;
        } else if (name != NULL) {
            const size_t used = strlen(names);
            snprintf(names + used, sizeof names - used, "%s%s", used > 0 ? ", " : "", name);
        }
        gmshFree(name);
    }
    gmshFree(pair);
    if (error != 0) {
        return fail(path);
    }
    return found > 0 ? PM_OK
                     : pm_fail(PM_EDATA,
                               "%s: no physical group \"%s\", found: %s; --clamped also takes a "
                               "plane such as x=0",
                               path, wanted, names[0] != 0 ? names : "none");
}

static pm_status make_mesh(const gmsh_mesh *g, const char *path, const char *wanted,
                           pm_arena *arena, pm_solid_mesh *mesh) {
    enum { HALF = PM_BRICK_NODES / 2 };
    size_t at;
    PM_TRY(find_bricks(g, path, &at));
    const size_t ncorner = g->ncorner[at];
    double *x = pm_arena_array(arena, 3 * g->nnode, sizeof *x);
    bool *clamped = pm_arena_array(arena, g->nnode, sizeof *clamped);
    int *brick = pm_arena_array(arena, ncorner, sizeof *brick);
    int *number = pm_arena_array(arena, g->most + 1, sizeof *number), nnode = 0;
    PM_TRY(pm_arena_status(arena, "a mesh"));
    if (ncorner > INT32_MAX) {
        return pm_fail(PM_ENOMEM, "out of memory for a mesh");
    }
    // The nodes of the bricks are numbered in the order of their tags.
    for (size_t i = 0; i <= g->most; ++i) {
        number[i] = -1;
    }
    for (size_t i = 0; i < ncorner; ++i) {
        number[g->corner[at][i]] = 0;
    }
    for (size_t i = 0; i < g->nnode; ++i) {
        if (number[g->node[i]] == 0) {
            memcpy(x + 3 * nnode, g->x + 3 * i, 3 * sizeof *x);
            number[g->node[i]] = nnode++;
        }
    }
    for (size_t i = 0; i < ncorner; ++i) {
        brick[i] = number[g->corner[at][i]];
    }
    *mesh = (pm_solid_mesh){.nnode = nnode,
                            .nelement = (int)(ncorner / PM_BRICK_NODES),
                            .position = x,
                            .brick = brick,
                            .clamped = clamped};
    // A plane such as "x=0.5", or the name of a group.
    char *end = NULL;
    const bool plane = wanted[0] >= 'x' && wanted[0] <= 'z' && wanted[1] == '=' && wanted[2] != 0;
    const double place = plane ? strtod(wanted + 2, &end) : NAN;
    if (plane && *end == 0 && isfinite(place)) {
        double low = INFINITY, high = -INFINITY;
        int count = 0;
        for (int i = 0; i < 3 * nnode; ++i) {
            low = fmin(low, x[i]);
            high = fmax(high, x[i]);
        }
        for (int i = 0; i < nnode; ++i) {
            clamped[i] = fabs(x[3 * i + wanted[0] - 'x'] - place) <= IN_PLANE * (high - low);
            count += clamped[i];
        }
        PM_TRY(count > 0 ? PM_OK
                         : pm_fail(PM_EDATA, "%s: no node lies in the plane %s", path, wanted));
    } else {
        PM_TRY(clamp_groups(wanted, number, g->most, path, clamped));
    }
    // Bottom and top of elements that are numbered as in a mirror change places.
    for (int e = 0; e < mesh->nelement; ++e) {
        int *node = brick + (ptrdiff_t)PM_BRICK_NODES * e, bottom[HALF];
        if (is_good(mesh, node)) {
            continue;
        }
        memcpy(bottom, node, sizeof bottom);
        memcpy(node, node + HALF, sizeof bottom);
        memcpy(node + HALF, bottom, sizeof bottom);
        if (!is_good(mesh, node)) {
            return pm_fail(PM_EDATA, "%s: element %zu has no positive volume everywhere", path,
                           g->element[at][e]);
        }
    }
    return PM_OK;
}

pm_status pm_gmsh_read(pm_solid_mesh *mesh, const char *path, const char *clamped, bool split,
                       pm_arena *arena) {
    gmsh_mesh g = {0};
    int error = 0;
    gmshInitialize(0, NULL, 0, &error);
    if (error != 0) {
        return pm_fail(PM_EFILE, "%s: Gmsh does not start", path);
    }
    gmshOptionSetNumber("General.Terminal", 0, &error); // libraries do not print
    pm_status status = read_all(&g, path, split);
    if (status == PM_OK) {
        status = make_mesh(&g, path, clamped, arena, mesh);
    }
    close_mesh(&g);
    gmshFinalize(&error);
    return status;
}

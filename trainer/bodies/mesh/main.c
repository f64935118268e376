// portmet-mesh: turns meshes and geometries that Gmsh reads into meshes for scenes and truth files.
// It is a program of its own, because the library of Gmsh takes longer to load than most commands
// of portmet-train take.
#include <stdio.h>
#include <string.h>

#include "base/options.h"
#include "base/subcommand.h"
#include "bodies/mesh/gmsh_file.h"

static pm_status run(int argc, char **argv) {
    const char *input = NULL, *output = NULL, *clamped = NULL;
    bool split = false;
    const pm_option table[] = {
        {"--clamped", NULL, "NAME", NULL, &clamped, false,
         .help = "the physical group whose nodes do not move (default: clamped), or their plane, "
                 "such as "
                 "x=0"},
        {"--split", NULL, NULL, &split, NULL, false,
         .help = "split tetrahedra, prisms and hexahedra into smaller hexahedra"},
        {"--output", "-o", "FILE", NULL, &output, true, .help = "mesh to write (HDF5)",
         .is_output = true},
    };
    const pm_options options = {
        .usage = "portmet-mesh FILE -o MESH [options]",
        .summary =
            "Reads a mesh of hexahedra from any FILE that Gmsh reads, such as .msh, .unv, .vtk or\n"
            ".bdf, or meshes a geometry such as .geo or .step. Lengths are in m. Scenes and truth\n"
            "files take MESH as `mesh:`.",
        .examples = "portmet-mesh configs/meshes/l_body.geo -o l_mesh.h5",
        .positional_name = "FILE",
        .positional = &input,
        PM_OPTION_TABLE(table),
    };
    pm_arena arena = {0};
    pm_solid_mesh mesh;
    PM_TRY(pm_options_read(&options, argc, argv));
    pm_status status =
        pm_gmsh_read(&mesh, input, clamped == NULL ? "clamped" : clamped, split, &arena);
    if (status == PM_OK) {
        status = pm_solid_mesh_save(&mesh, output);
    }
    if (status == PM_OK) {
        int nclamped = 0;
        for (int i = 0; i < mesh.nnode; ++i) {
            nclamped += mesh.clamped[i];
        }
        printf("wrote %s: %d hexahedra, %d nodes, of which %d are clamped\n", output, mesh.nelement,
               mesh.nnode, nclamped);
    }
    pm_arena_free(&arena);
    return status;
}

int main(int argc, char **argv) {
    if (argc == 2 && strcmp(argv[1], "--version") == 0) {
        printf("portmet-mesh %s\n", PM_VERSION);
        return pm_subcommand_end("portmet-mesh", PM_OK);
    }
    char name[] = "command line"; // in messages, where other programs have a subcommand
    argv[0] = name;
    return pm_subcommand_end("portmet-mesh", run(argc, argv));
}

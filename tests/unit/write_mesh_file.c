// write_mesh_file FROM TO VERSION BINARY: reads a mesh or meshes a geometry by the library of Gmsh,
// and writes it in the format that the ending of TO names. VERSION of MSH files, such as 4.1;
// BINARY is 0 or 1.
#include <gmshc.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    int error = 0, dimension = -1;
    if (argc != 5) {
        return 2;
    }
    gmshInitialize(0, NULL, 0, &error);
    gmshOptionSetNumber("General.Terminal", 0, &error);
    gmshOpen(argv[1], &error);
    size_t count = 0, *tag = NULL, nparameter = 0, ncoordinate = 0;
    double *x = NULL, *parameter = NULL;
    gmshModelMeshGetNodes(&tag, &count, &x, &ncoordinate, &parameter, &nparameter, dimension, -1, 0,
                          0, &error);
    gmshFree(tag);
    gmshFree(x);
    gmshFree(parameter);
    if (count == 0) {
        gmshModelMeshGenerate(3, &error);
    }
    gmshOptionSetNumber("Mesh.MshFileVersion", atof(argv[3]), &error);
    gmshOptionSetNumber("Mesh.Binary", atof(argv[4]), &error);
    gmshWrite(argv[2], &error);
    const int failed = error;
    gmshFinalize(&error);
    return failed != 0;
}

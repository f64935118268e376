// Writes scenes of many links as text, with names that stand for many, and reads them.
#include "many_links.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"
#include "store/hdf5_io.h"

#define NZ 5 // of a link
#define SEED 18u

#define STATE "state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}"
#define LOWER "{weights: weights/double_pendulum/lower.h5, " STATE "}"
#define JOINT(a, b)                                                              \
    "between: [\"" a "\", \"" b "\"], expose: {\"" a "\": [q, p, s], \"" b "\":" \
    " [q, p, s]},\n    law: bracket, weights: weights/double_pendulum/joint.h5}\n"

// Links one and two of a pair. Further ones start near the second.
static const double start[2 * NZ] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};

static void write_chain(FILE *file, const many_links *what) {
    const int n = what->links;
    fprintf(file,
            "subsystems:\n"
            "  link0: {weights: weights/double_pendulum/upper.h5, " STATE "}\n"
            "  \"link[1:%d]\": " LOWER "\nports:\n"
            "  \"joint[0:%d]\": {" JOINT("link[i]", "link[i+1]"),
            n, n - 1);
}

static void write_grid(FILE *file, const many_links *what) {
    const int side = (int)fmax(2, floor(sqrt((double)what->links) + 1e-9));
    fprintf(file,
            "subsystems:\n  \"link[0:%d][0:%d]\": " LOWER "\nports:\n"
            "  \"right[0:%d][0:%d]\": {" JOINT(
                "link[i][j]", "link[i][j+1]") "  \"down[0:%d][0:%d]\": {" JOINT("link[i][j]",
                                                                                "link[i+1][j]"),
            side, side, side, side - 1, side - 1, side);
}

// Draws a random tree and as many further joints, and writes them to a table.
static pm_status write_table(const char *path, int links) {
    const int count = 2 * (links - 1), extent[2] = {count, 2};
    double *edge = malloc(2 * (size_t)count * sizeof *edge);
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(edge != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for %d joints", count));
    pm_rng rng;
    pm_rng_init(&rng, SEED, 1);
    for (int k = 0; k < count; ++k) {
        const int a = 1 + k % (links - 1); // joined to one of the links before it
        edge[2 * k] = a;
        edge[2 * k + 1] = floor(pm_rng_uniform(&rng) * a);
    }
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(pm_hdf5_write(file, "joints", 2, extent, edge));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    free(edge);
    return status;
}

static void write_network(FILE *file, const many_links *what, const char *table) {
    fprintf(file,
            "subsystems:\n  \"link[0:%d]\": " LOWER "\nports:\n"
            "  \"joint[0:%d]\": {table: {file: \"%s\", dataset: joints},\n    " JOINT("link[a]",
                                                                                      "link[b]"),
            what->links, 2 * (what->links - 1), table);
}

static pm_status parse(pm_scene **scene, const many_links *what, const char *table) {
    char path[4096], *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a scene");
    }
    fprintf(file, "scene: many\ntime: {dt: 1.0e-6, steps: %ld, integrator: %s}\n", what->steps,
            what->integrator);
    if (strcmp(what->shape, "chain") == 0) {
        write_chain(file, what);
    } else if (strcmp(what->shape, "grid") == 0) {
        write_grid(file, what);
    } else {
        write_network(file, what, table);
    }
    fclose(file);
    snprintf(path, sizeof path, "%s/many.yaml", what->configs);
    const pm_status status = pm_scene_parse(scene, text, path);
    free(text);
    return status;
}

pm_status many_links_scene(pm_scene **scene, const many_links *what) {
    if (strcmp(what->shape, "chain") == 0 || strcmp(what->shape, "grid") == 0) {
        return parse(scene, what, NULL);
    }
    if (strcmp(what->shape, "network") != 0) {
        return pm_fail(PM_EUSAGE, "expected chain, grid or network, found \"%s\"", what->shape);
    }
    char table[256];
    const char *folder = getenv("TMPDIR");
    snprintf(table, sizeof table, "%s/many_links_%ld.h5", folder != NULL ? folder : "/tmp",
             (long)getpid());
    PM_TRY(write_table(table, what->links));
    const pm_status status = parse(scene, what, table);
    unlink(table);
    return status;
}

double *many_links_states(const pm_scene *scene) {
    double *z = malloc((size_t)scene->physics.nz * sizeof *z);
    pm_rng rng;
    pm_rng_init(&rng, SEED, 0);
    for (int i = 0; z != NULL && i < scene->physics.nz; ++i) {
        z[i] = start[i < NZ ? i : NZ + i % NZ] + 0.05 * pm_rng_normal(&rng);
    }
    return z;
}

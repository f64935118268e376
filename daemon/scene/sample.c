// The memory of a sample (recording.h): one block for all of its arrays.
#include <stdlib.h>

#include "scene/recording.h"

// Takes the next `count` elements of 8-byte aligned memory.
static void *carve(char **memory, size_t count, size_t size) {
    void *piece = *memory;
    *memory += (count * size + 7) / 8 * 8;
    return piece;
}

pm_status pm_sample_new(pm_sample **sample, const pm_scene *scene) {
    const size_t nz = (size_t)scene->nz, n = (size_t)scene->nsubsystem;
    const size_t nport = (size_t)scene->nport;
    const size_t size = sizeof(pm_sample) + (nz + 7 * n) * sizeof(double) + 3 * n * sizeof(long) +
                        nport * sizeof(pm_flux[2]);
    pm_sample *s = calloc(1, size);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "sample: out of memory");
    }
    char *memory = (char *)(s + 1);
    s->z = carve(&memory, nz, sizeof *s->z);
    s->energy = carve(&memory, n, sizeof *s->energy);
    s->entropy = carve(&memory, n, sizeof *s->entropy);
    s->bulk_energy = carve(&memory, n, sizeof *s->bulk_energy);
    s->bulk_entropy = carve(&memory, n, sizeof *s->bulk_entropy);
    s->bulk_gross = carve(&memory, 2 * n, sizeof *s->bulk_gross);
    s->error = carve(&memory, n, sizeof *s->error);
    s->flux = carve(&memory, nport, sizeof *s->flux);
    s->evaluated = carve(&memory, n, sizeof *s->evaluated);
    s->skipped = carve(&memory, n, sizeof *s->skipped);
    s->outside = carve(&memory, n, sizeof *s->outside);
    *sample = s;
    return PM_OK;
}

void pm_sample_free(pm_sample *sample) {
    free(sample);
}

// The memory of a sample: one block for all of its arrays, each of numbers of eight bytes.
#include "scene/sample.h"

#include <stdlib.h>

_Static_assert(sizeof(long) == 8 && sizeof(double) == 8, "a column has numbers of eight bytes");

#define COUNT_ONE(type, name, series, unit) +1
#define NCOLUMN (0 PM_SUBSYSTEM_NUMBERS(COUNT_ONE, COUNT_ONE))

pm_status pm_sample_new(pm_sample **sample, const pm_scene *scene) {
    const size_t nz = (size_t)scene->physics.nz, n = (size_t)scene->physics.nsubsystem;
    const size_t nport = (size_t)scene->physics.nport;
    pm_sample *s = calloc(1, sizeof *s + 8 * (nz + NCOLUMN * n) + nport * sizeof *s->flux);
    PM_TRY(pm_allocated(s, "a sample"));
    double *memory = (double *)(s + 1);
    s->z = memory;
    s->flux = (pm_flux(*)[2])(memory + nz);
    memory = (double *)(s->flux + nport);
#define PLACE(type, name, series, unit) \
    s->name = (void *)memory;           \
    memory += n;
    PM_SUBSYSTEM_NUMBERS(PLACE, PLACE)
    *sample = s;
    return PM_OK;
}

void pm_sample_free(pm_sample *sample) {
    free(sample);
}

void pm_sample_set_books(pm_sample *sample, int id, const pm_books *books) {
#define SET(type, name, series, unit) sample->name[id] = books->name;
#define SET_BULK(member, name, series, unit) sample->name[id] = books->bulk.member;
    PM_SUBSYSTEM_NUMBERS(SET, SET_BULK)
}

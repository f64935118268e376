// The series of a recording. A sample fills them in the order of the list: the scene, the families
// of subsystems, the families of ports, and the live inputs.
#include "scene/recording_series.h"

#include <string.h>

#include "base/reproducible_sum.h"

#define BLOCK 256             // most samples in a buffer and in a chunk of the file
#define CHUNK 131072          // most numbers of a chunk: large states have fewer samples in it
#define MOST_BUFFERED 8388608 // numbers in all buffers, unless a single sample has more
#define MAX_NAMED 1000        // components whose names fit into an attribute of 64 KiB
#define INDEX_BYTES 8192      // most by which a block makes the file's index of a series grow

#define SCENE_SERIES 6
#define SUBSYSTEM_SERIES 5
#define PORT_SERIES 4

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "recording: out of memory");
}

// --- families ---

// Adds a member: to the last family if it is of the same range and all are recorded, or else as a
// family of its own. `last` is the range of the last member.
static void add_member(pm_recorded_family *family, int *count, int id, const char *name,
                       const char *range, const char **last) {
    if (range != NULL && range == *last) {
        ++family[*count - 1].count;
        return;
    }
    family[(*count)++] = (pm_recorded_family){
        .name = range != NULL ? range : name, .first = id, .count = 1, .is_range = range != NULL};
    *last = range;
}

pm_status pm_recorded_families_find(pm_recorded_families *families, pm_arena *arena,
                                    const pm_scene *scene) {
    const bool whole = scene->recorded == NULL;
    pm_recorded_families f = {
        .subsystem = pm_arena_array(arena, (size_t)scene->nsubsystem, sizeof *f.subsystem),
        .port = pm_arena_array(arena, (size_t)scene->nport, sizeof *f.port),
    };
    if (f.subsystem == NULL || f.port == NULL) {
        return fail_memory();
    }
    const char *last = NULL;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (pm_scene_records(scene, i)) {
            add_member(f.subsystem, &f.nsubsystem, i, scene->subsystem[i].name,
                       whole ? scene->subsystem[i].range : NULL, &last);
        }
    }
    last = NULL;
    for (int i = 0; i < scene->nport; ++i) {
        if (pm_scene_records_port(scene, i)) {
            add_member(f.port, &f.nport, i, scene->port[i].name,
                       whole ? scene->port[i].range : NULL, &last);
        }
    }
    *families = f;
    return PM_OK;
}

// --- the list ---

// Adds the series `folder`/`name` whose samples have an extent for the members of a family that is
// a range, and another for the `width` variables of each (0: one number).
static pm_status add(pm_recorded_list *l, const char *folder, const char *name,
                     const pm_recorded_family *family, int width, const char *unit) {
    pm_recorded_series *s = &l->series[l->count++];
    s->path = pm_arena_printf(l->arena, "%s/%s", folder, name);
    s->unit = unit;
    s->count = 1;
    if (family != NULL && family->is_range) {
        s->extent[s->rank++] = family->count;
        s->count *= family->count;
    }
    if (width > 0) {
        s->extent[s->rank++] = width;
        s->count *= width;
    }
    s->rows = s->count <= CHUNK / BLOCK ? BLOCK : 1 + (CHUNK - 1) / s->count;
    return s->path == NULL ? fail_memory() : PM_OK;
}

static pm_status add_subsystems(pm_recorded_list *l, const pm_recorded_family *family) {
    const char *folder = pm_arena_printf(l->arena, "/subsystems/%s", family->name);
    if (folder == NULL) {
        return fail_memory();
    }
    PM_TRY(add(l, folder, "z", family, l->scene->subsystem[family->first].layout.nz, NULL));
    PM_TRY(add(l, folder, "E", family, 0, "J"));
    PM_TRY(add(l, folder, "S", family, 0, "J/K"));
    PM_TRY(add(l, folder, "bulk_energy", family, 0, "W"));
    return add(l, folder, "bulk_entropy", family, 0, "W/K");
}

static pm_status add_ports(pm_recorded_list *l, const pm_recorded_family *family) {
    const char *folder = pm_arena_printf(l->arena, "/ports/%s", family->name);
    if (folder == NULL) {
        return fail_memory();
    }
    PM_TRY(add(l, folder, "energy_flux_a", family, 0, "W"));
    PM_TRY(add(l, folder, "energy_flux_b", family, 0, "W"));
    PM_TRY(add(l, folder, "entropy_flux_a", family, 0, "W/K"));
    return add(l, folder, "entropy_flux_b", family, 0, "W/K");
}

static pm_status add_all(pm_recorded_list *l) {
    PM_TRY(add(l, "", "time", NULL, 0, "s"));
    PM_TRY(add(l, "", "step", NULL, 0, NULL));
    PM_TRY(add(l, "/ledger", "energy", NULL, 0, "J"));
    PM_TRY(add(l, "/ledger", "entropy", NULL, 0, "J/K"));
    PM_TRY(add(l, "/ledger", "energy_residual", NULL, 0, "1"));
    PM_TRY(add(l, "/ledger", "entropy_residual", NULL, 0, "1"));
    for (int i = 0; i < l->families.nsubsystem; ++i) {
        PM_TRY(add_subsystems(l, &l->families.subsystem[i]));
    }
    for (int i = 0; i < l->families.nport; ++i) {
        PM_TRY(add_ports(l, &l->families.port[i]));
    }
    for (int i = 0; i < l->scene->nlive_input; ++i) {
        const pm_scene_live_input *input = &l->scene->live_input[i];
        for (int k = 0; k < input->count; ++k) {
            PM_TRY(add(l, "/live", input->name[k], NULL, 0, NULL));
        }
    }
    return PM_OK;
}

static pm_status make_buffers(pm_recorded_list *l) {
    int64_t sample = 0;
    for (int i = 0; i < l->count; ++i) {
        sample += l->series[i].count;
    }
    const int64_t depth = MOST_BUFFERED / sample;
    l->depth = depth < 1 ? 1 : depth < BLOCK ? (int)depth : BLOCK;
    for (int i = 0; i < l->count; ++i) {
        pm_recorded_series *s = &l->series[i];
        // The rows of a buffer fill their share of chunks, and may begin one more.
        l->bytes += (int64_t)s->count * (l->depth + s->rows) * (int64_t)sizeof *s->buffer;
        l->bytes += INDEX_BYTES;
        s->buffer =
            pm_arena_array(l->arena, (size_t)s->count * (size_t)l->depth, sizeof *s->buffer);
        if (s->buffer == NULL) {
            return fail_memory();
        }
    }
    return PM_OK;
}

pm_status pm_recorded_list_init(pm_recorded_list *list, pm_arena *arena, const pm_scene *scene) {
    *list = (pm_recorded_list){.arena = arena, .scene = scene};
    PM_TRY(pm_recorded_families_find(&list->families, arena, scene));
    const size_t count = SCENE_SERIES + SUBSYSTEM_SERIES * (size_t)list->families.nsubsystem +
                         PORT_SERIES * (size_t)list->families.nport + (size_t)scene->nlive;
    list->series = pm_arena_array(arena, count, sizeof *list->series);
    if (list->series == NULL) {
        return fail_memory();
    }
    PM_TRY(add_all(list));
    return make_buffers(list);
}

// --- the file ---

// Writes names and units of the components of z: "s", or "q[0]" in a group of several. Where there
// are too many components for an attribute, writes those of the groups: "q[0:5000]".
static pm_status describe_state(const pm_recorded_list *l, pm_hdf5 *file, const char *path,
                                const pm_layout *layout) {
    const bool whole = layout->nz > MAX_NAMED;
    const size_t capacity = (size_t)(whole ? layout->ngroup : layout->nz);
    const char **name = pm_arena_array(l->arena, capacity, sizeof *name);
    const char **unit = pm_arena_array(l->arena, capacity, sizeof *unit);
    if (name == NULL || unit == NULL) {
        return fail_memory();
    }
    int count = 0;
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        for (int i = 0; i < (whole ? 1 : group->size); ++i, ++count) {
            name[count] = group->size == 1 ? group->name
                          : whole ? pm_arena_printf(l->arena, "%s[0:%d]", group->name, group->size)
                                  : pm_arena_printf(l->arena, "%s[%d]", group->name, i);
            unit[count] = group->unit;
            if (name[count] == NULL) {
                return fail_memory();
            }
        }
    }
    PM_TRY(pm_hdf5_write_texts(file, path, "variables", count, name));
    return pm_hdf5_write_texts(file, path, "units", count, unit);
}

// Writes the names of the ends; of a range as the scene file has them, "link[i]" and "link[i+1]".
static pm_status describe_ports(const pm_recorded_list *l, pm_hdf5 *file,
                                const pm_recorded_family *family) {
    const pm_scene_port *port = &l->scene->port[family->first];
    const char *folder = pm_arena_printf(l->arena, "/ports/%s", family->name);
    const char *const ends[2] = {pm_scene_end_name(l->scene, port, 0),
                                 pm_scene_end_name(l->scene, port, 1)};
    return folder == NULL ? fail_memory()
                          : pm_hdf5_write_texts(file, folder, "ends", 2,
                                                family->is_range ? port->between : ends);
}

pm_status pm_recorded_list_create(pm_recorded_list *list, pm_hdf5 *file) {
    for (int i = 0; i < list->count; ++i) {
        pm_recorded_series *s = &list->series[i];
        PM_TRY(pm_hdf5_series_create(&s->in_file, file, s->path, s->rank, s->extent, s->rows,
                                     strcmp(s->path, "/step") == 0));
        if (s->unit != NULL) {
            PM_TRY(pm_hdf5_write_text(file, s->path, "units", s->unit));
        }
    }
    for (int i = 0; i < list->families.nsubsystem; ++i) {
        const pm_scene_subsystem *first =
            &list->scene->subsystem[list->families.subsystem[i].first];
        const char *path = list->series[SCENE_SERIES + SUBSYSTEM_SERIES * i].path;
        PM_TRY(describe_state(list, file, path, &first->layout));
    }
    for (int i = 0; i < list->families.nport; ++i) {
        PM_TRY(describe_ports(list, file, &list->families.port[i]));
    }
    return PM_OK;
}

pm_status pm_recorded_list_open(pm_recorded_list *list, pm_hdf5 *file, long count) {
    for (int i = 0; i < list->count; ++i) {
        pm_recorded_series *s = &list->series[i];
        PM_TRY(pm_hdf5_series_open(&s->in_file, file, s->path, s->rank, s->extent, s->rows, count));
    }
    return PM_OK;
}

pm_status pm_recorded_list_append(pm_recorded_list *list, int rows) {
    for (int i = 0; i < list->count; ++i) {
        PM_TRY(pm_hdf5_series_append(&list->series[i].in_file, rows, list->series[i].buffer));
    }
    return PM_OK;
}

// --- samples ---

// The place in its buffer of the row that a sample fills, series after series.
typedef struct cursor {
    const pm_recorded_series *series;
    int row;
} cursor;

static double *next(cursor *at) {
    const pm_recorded_series *s = at->series++;
    return s->buffer + (size_t)at->row * (size_t)s->count;
}

static void put(cursor *at, const double *value) {
    const size_t size = (size_t)at->series->count * sizeof *value;
    memcpy(next(at), value, size);
}

// Returns the total of the subsystems with the bits that it has in the ledger.
static double total(int n, const double *value) {
    pm_reproducible_sum sum = {0};
    pm_reproducible_sum_add(&sum, n, value, false);
    return pm_reproducible_sum_value(&sum);
}

static void put_fluxes(cursor *at, const pm_recorded_family *family, const pm_sample *sample) {
    double *value[PORT_SERIES];
    for (int k = 0; k < PORT_SERIES; ++k) {
        value[k] = next(at);
    }
    for (int i = 0; i < family->count; ++i) {
        const pm_flux *flux = sample->flux[family->first + i];
        value[0][i] = flux[0].energy;
        value[1][i] = flux[1].energy;
        value[2][i] = flux[0].entropy;
        value[3][i] = flux[1].entropy;
    }
}

void pm_recorded_list_put(const pm_recorded_list *list, int row, const pm_sample *sample) {
    const pm_scene *scene = list->scene;
    cursor at = {list->series, row};
    *next(&at) = sample->time;
    *next(&at) = (double)sample->step;
    *next(&at) = sample->outside_energy + total(scene->nsubsystem, sample->energy);
    *next(&at) = sample->outside_entropy + total(scene->nsubsystem, sample->entropy);
    *next(&at) = sample->energy_residual;
    *next(&at) = sample->entropy_residual;
    for (int i = 0; i < list->families.nsubsystem; ++i) {
        const int first = list->families.subsystem[i].first;
        put(&at, sample->z + scene->subsystem[first].first);
        put(&at, sample->energy + first);
        put(&at, sample->entropy + first);
        put(&at, sample->bulk_energy + first);
        put(&at, sample->bulk_entropy + first);
    }
    for (int i = 0; i < list->families.nport; ++i) {
        put_fluxes(&at, &list->families.port[i], sample);
    }
    for (int i = 0; i < scene->nlive; ++i) {
        *next(&at) = sample->live[i];
    }
}

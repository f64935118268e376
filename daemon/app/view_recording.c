// Reads one series after the other and keeps every so many samples of it.
#include "app/view_recording.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "scene/recording_series.h"
#include "store/hdf5_io.h"

#define NAME_SIZE 256

typedef struct recording_reader {
    pm_hdf5 *file;
    const char *path;
    const pm_view_graph *graph;
    int rows;      // complete samples in the file
    int stride;    // one of so many is kept
    int count;     // samples kept
    int width;     // numbers in a frame
    double *frame; // [count][width]
} recording_reader;

static pm_status check_rows(const recording_reader *r, const char *name, int rows) {
    return rows >= r->rows ? PM_OK
                           : pm_fail(PM_EFILE, "%s: %s has %d samples, expected %d", r->path, name,
                                     rows, r->rows);
}

// Adds the series `name` to the numbers at position `at` of all frames. Without the series they
// become NaN.
static pm_status add_series(const recording_reader *r, const char *name, int at) {
    int rows = 0;
    double *value = NULL;
    pm_status status = PM_OK;
    if (pm_hdf5_has(r->file, name)) {
        PM_TRY(pm_hdf5_shape(r->file, name, 1, &rows));
        PM_TRY(check_rows(r, name, rows));
        value = calloc((size_t)rows, sizeof *value);
        status = value == NULL ? pm_fail(PM_ENOMEM, "%s: out of memory", r->path)
                               : pm_hdf5_read(r->file, name, 1, &rows, value);
    }
    for (int i = 0; i < r->count && status == PM_OK; ++i) {
        const long from = (long)i * r->stride;
        r->frame[(long)i * r->width + at] += value == NULL ? (double)NAN : value[from];
    }
    free(value);
    return status;
}

static pm_status add_totals(const recording_reader *r) {
    static const struct {
        const char *name;
        int at;
    } series[] = {{"/time", PM_VIEW_TIME},
                  {"/ledger/energy", PM_VIEW_ENERGY},
                  {"/ledger/entropy", PM_VIEW_ENTROPY},
                  {"/ledger/energy_residual", PM_VIEW_ENERGY_RESIDUAL},
                  {"/ledger/entropy_residual", PM_VIEW_ENTROPY_RESIDUAL}};
    for (size_t i = 0; i < sizeof series / sizeof series[0]; ++i) {
        PM_TRY(add_series(r, series[i].name, series[i].at));
    }
    for (int i = 0; i < r->count; ++i) {
        double *frame = r->frame + (long)i * r->width;
        frame[PM_VIEW_STEP] = round(frame[PM_VIEW_TIME] / r->graph->scene->dt);
        frame[PM_VIEW_VIOLATIONS] = NAN; // no series has their number
    }
    return PM_OK;
}

// Adds a series of the `count` members of a range. Member k belongs to the numbers at position
// at[k] of all frames; -1: to none.
static pm_status add_members(const recording_reader *r, const char *name, int count,
                             const int *at) {
    double *value = calloc((size_t)count, sizeof *value);
    pm_status status = value == NULL ? pm_fail(PM_ENOMEM, "%s: out of memory", r->path) : PM_OK;
    for (int i = 0; i < r->count && status == PM_OK; ++i) {
        double *frame = r->frame + (long)i * r->width;
        status = pm_hdf5_read_row(r->file, name, i * r->stride, count, value);
        for (int k = 0; k < count && status == PM_OK; ++k) {
            if (at[k] >= 0) {
                frame[at[k]] += value[k];
            }
        }
    }
    free(value);
    return status;
}

// Adds the series `quantity` of a family. `at` [count] are positions in frames, as above.
static pm_status add_family(const recording_reader *r, const char *folder,
                            const pm_recorded_family *family, const char *quantity, const int *at) {
    char name[NAME_SIZE];
    snprintf(name, sizeof name, "/%s/%s/%s", folder, family->name, quantity);
    if (family->is_range) {
        return add_members(r, name, family->count, at);
    }
    return *at < 0 ? PM_OK : add_series(r, name, *at);
}

static pm_status add_parts(const recording_reader *r, const pm_recorded_families *families,
                           int *at) {
    static const char *const series[PM_VIEW_PER_PART] = {"E", "S", "bulk_entropy"};
    const pm_view_graph *graph = r->graph;
    for (int i = 0; i < families->nsubsystem * PM_VIEW_PER_PART; ++i) {
        const pm_recorded_family *family = &families->subsystem[i / PM_VIEW_PER_PART];
        const int first = PM_VIEW_TOTALS + i % PM_VIEW_PER_PART * graph->npart;
        for (int k = 0; k < family->count; ++k) {
            const int node = graph->node_of[family->first + k];
            at[k] = node < 0 ? -1 : first + node;
        }
        PM_TRY(add_family(r, "subsystems", family, series[i % PM_VIEW_PER_PART], at));
    }
    return PM_OK;
}

static pm_status add_edges(const recording_reader *r, const pm_recorded_families *families,
                           int *at) {
    static const char *const series[PM_VIEW_PER_EDGE] = {"energy_flux_a", "energy_flux_b",
                                                         "entropy_flux_a", "entropy_flux_b"};
    const pm_view_graph *graph = r->graph;
    const int first = PM_VIEW_TOTALS + PM_VIEW_PER_PART * graph->npart;
    for (int i = 0; i < families->nport * PM_VIEW_PER_EDGE; ++i) {
        const pm_recorded_family *family = &families->port[i / PM_VIEW_PER_EDGE];
        const int quantity = i % PM_VIEW_PER_EDGE;
        for (int k = 0; k < family->count; ++k) {
            const int id = family->first + k, edge = graph->edge_of[id];
            const int shown = quantity ^ graph->first_end[id];
            at[k] = edge < 0 ? -1 : first + shown * graph->nedge + edge;
        }
        PM_TRY(add_family(r, "ports", family, series[quantity], at));
    }
    return PM_OK;
}

static pm_status add_components(const recording_reader *r) {
    const pm_scene *scene = r->graph->scene;
    pm_arena arena = {0};
    pm_recorded_families families;
    pm_status status;
    const int most = scene->nsubsystem > scene->nport ? scene->nsubsystem : scene->nport;
    int *at = pm_arena_array(&arena, (size_t)most, sizeof *at);
    PM_TRY_DONE(at == NULL ? pm_fail(PM_ENOMEM, "%s: out of memory", r->path) : PM_OK);
    PM_TRY_DONE(pm_recorded_families_find(&families, &arena, scene));
    PM_TRY_DONE(add_parts(r, &families, at));
    PM_TRY_DONE(add_edges(r, &families, at));
done:
    pm_arena_free(&arena);
    return status;
}

// Checks that the file is a recording of the scene: it has the scene's first subsystem.
static pm_status check_scene(const recording_reader *r) {
    const pm_scene *scene = r->graph->scene;
    const char *range = scene->subsystem[0].range;
    char part[NAME_SIZE];
    snprintf(part, sizeof part, "/subsystems/%s", range == NULL ? scene->subsystem[0].name : range);
    return scene->recorded != NULL || pm_hdf5_has(r->file, part)
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: no recording of scene %s: it has no %s", r->path,
                         scene->name, part);
}

static pm_status read_frames(recording_reader *r, int capacity) {
    uint64_t committed;
    PM_TRY(pm_hdf5_read_integer(r->file, "/", "committed", &committed));
    PM_TRY(pm_hdf5_shape(r->file, "/time", 1, &r->rows));
    if (committed < 1 || committed > (uint64_t)r->rows) {
        return pm_fail(PM_EFILE, "%s: %" PRIu64 " of %d samples are complete", r->path, committed,
                       r->rows);
    }
    PM_TRY(check_scene(r));
    r->rows = (int)committed;
    r->stride = (r->rows + capacity - 1) / capacity;
    r->count = (r->rows + r->stride - 1) / r->stride;
    r->frame = calloc((size_t)r->count * (size_t)r->width, sizeof *r->frame);
    if (r->frame == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", r->path);
    }
    PM_TRY(add_totals(r));
    return add_components(r);
}

pm_status pm_view_recording_read(const char *path, const pm_view_graph *graph,
                                 pm_view_history *history) {
    recording_reader r = {.path = path, .graph = graph, .width = history->width};
    pm_status status;
    PM_TRY(pm_hdf5_open(&r.file, path, PM_HDF5_ANY, PM_EFILE));
    PM_TRY_DONE(read_frames(&r, history->capacity));
    for (int i = 0; i < r.count; ++i) {
        pm_view_history_add(history, r.frame + (long)i * r.width);
    }
done:
    free(r.frame);
    pm_hdf5_close(r.file);
    return status;
}

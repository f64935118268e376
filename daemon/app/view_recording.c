// Reads one series after the other and keeps every so many samples of it.
#include "app/view_recording.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

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

static pm_status add_parts(const recording_reader *r) {
    static const char *const series[PM_VIEW_PER_PART] = {"E", "S", "bulk_entropy"};
    const pm_scene *scene = r->graph->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        for (int k = 0; k < PM_VIEW_PER_PART; ++k) {
            char name[NAME_SIZE];
            snprintf(name, sizeof name, "/subsystems/%s/%s", scene->subsystem[i].name, series[k]);
            PM_TRY(
                add_series(r, name, PM_VIEW_TOTALS + k * r->graph->npart + r->graph->node_of[i]));
        }
    }
    return PM_OK;
}

static pm_status add_edges(const recording_reader *r) {
    static const char *const series[PM_VIEW_PER_EDGE] = {"energy_flux_a", "energy_flux_b",
                                                         "entropy_flux_a", "entropy_flux_b"};
    const pm_scene *scene = r->graph->scene;
    const int first = PM_VIEW_TOTALS + PM_VIEW_PER_PART * r->graph->npart;
    for (int i = 0; i < scene->nport; ++i) {
        const int edge = r->graph->edge_of[i];
        for (int k = 0; k < PM_VIEW_PER_EDGE && edge >= 0; ++k) {
            char name[NAME_SIZE];
            snprintf(name, sizeof name, "/ports/%s/%s", scene->port[i].name,
                     series[k ^ r->graph->first_end[i]]);
            PM_TRY(add_series(r, name, first + k * r->graph->nedge + edge));
        }
    }
    return PM_OK;
}

static pm_status read_frames(recording_reader *r, int capacity) {
    uint64_t committed;
    PM_TRY(pm_hdf5_read_integer(r->file, "/", "committed", &committed));
    PM_TRY(pm_hdf5_shape(r->file, "/time", 1, &r->rows));
    if (committed < 1 || committed > (uint64_t)r->rows) {
        return pm_fail(PM_EFILE, "%s: %" PRIu64 " of %d samples are complete", r->path, committed,
                       r->rows);
    }
    char part[NAME_SIZE];
    snprintf(part, sizeof part, "/subsystems/%s", r->graph->scene->subsystem[0].name);
    if (r->graph->scene->recorded == NULL && !pm_hdf5_has(r->file, part)) {
        return pm_fail(PM_EFILE, "%s: no recording of scene %s: it has no %s", r->path,
                       r->graph->scene->name, part);
    }
    r->rows = (int)committed;
    r->stride = (r->rows + capacity - 1) / capacity;
    r->count = (r->rows + r->stride - 1) / r->stride;
    r->frame = calloc((size_t)r->count * (size_t)r->width, sizeof *r->frame);
    if (r->frame == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", r->path);
    }
    PM_TRY(add_totals(r));
    PM_TRY(add_parts(r));
    return add_edges(r);
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

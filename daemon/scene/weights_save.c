// Writes weights files in the layout described in weights.h.
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "scene/model_reader.h"
#include "scene/weights_content.h"
#include "store/hdf5_io.h"

static pm_status write_layout(pm_hdf5 *file, const char *path, const pm_layout *layout) {
    const char *name[PM_MAX_GROUPS], *unit[PM_MAX_GROUPS];
    uint64_t size[PM_MAX_GROUPS];
    for (int g = 0; g < layout->ngroup; ++g) {
        name[g] = layout->group[g].name;
        unit[g] = layout->group[g].unit;
        size[g] = (uint64_t)layout->group[g].size;
    }
    PM_TRY(pm_hdf5_write_group(file, path));
    PM_TRY(pm_hdf5_write_texts(file, path, "names", layout->ngroup, name));
    PM_TRY(pm_hdf5_write_texts(file, path, "units", layout->ngroup, unit));
    return pm_hdf5_write_integers(file, path, "sizes", layout->ngroup, size);
}

static pm_status write_params(pm_hdf5 *file, const pm_params *params, pm_arena *arena) {
    PM_TRY(pm_hdf5_write_group(file, "/parameters"));
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        const int shape[2] = {entry->rows, entry->cols};
        const char *path = pm_arena_printf(arena, "/parameters/%s", entry->name);
        if (path == NULL) {
            return pm_weights_no_memory("weights");
        }
        PM_TRY(pm_hdf5_write(file, path, 2, shape, entry->value));
        PM_TRY(pm_hdf5_write_integer(file, path, "trained", entry->trained));
    }
    return PM_OK;
}

static pm_status write_origin(pm_hdf5 *file, const pm_provenance *p) {
    if (p->trajectories != NULL && *p->trajectories != '\0') {
        PM_TRY(pm_hdf5_write_text(file, "/", "trajectories", p->trajectories));
    }
    if (p->nseen > 0) {
        const int count = p->nseen < PM_MOST_SEEN ? p->nseen : PM_MOST_SEEN;
        PM_TRY(pm_hdf5_write_integers(file, "/", "seen", count, p->seen));
    }
    if (p->columns != 0) {
        char text[32];
        snprintf(text, sizeof text, "%016llx", (unsigned long long)p->columns);
        PM_TRY(pm_hdf5_write_text(file, "/", "columns", text));
        PM_TRY(pm_hdf5_write_text(file, "/", "relative", p->relative == NULL ? "" : p->relative));
    }
    return PM_OK;
}

static pm_status write_provenance(pm_hdf5 *file, const pm_provenance *p, uint64_t digest) {
    char text[32], created[32];
    const time_t now = time(NULL);
    struct tm utc;
    snprintf(text, sizeof text, "%016llx", (unsigned long long)digest);
    strftime(created, sizeof created, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &utc));
    PM_TRY(pm_hdf5_write_text(file, "/", "digest", text));
    PM_TRY(pm_hdf5_write_text(file, "/", "created", created));
    PM_TRY(pm_hdf5_write_text(file, "/", "command", p->command == NULL ? "" : p->command));
    PM_TRY(pm_hdf5_write_text(file, "/", "data", p->data == NULL ? "" : p->data));
    if (p->coordinates != NULL && *p->coordinates != '\0') {
        PM_TRY(pm_hdf5_write_text(file, "/", "coordinates", p->coordinates));
    }
    if (p->integrator != NULL && *p->integrator != '\0') {
        PM_TRY(pm_hdf5_write_text(file, "/", "integrator", p->integrator));
        PM_TRY(pm_hdf5_write_number(file, "/", "step", p->step));
    }
    PM_TRY(write_origin(file, p));
    PM_TRY(pm_hdf5_write_integer(file, "/", "seed", p->seed));
    PM_TRY(pm_hdf5_write_number(file, "/", "loss", p->loss));
    return pm_hdf5_write_number(file, "/", "seconds", p->seconds);
}

static pm_status write_component(pm_hdf5 *file, const pm_weights_content *c, const pm_provenance *p,
                                 pm_arena *arena) {
    PM_TRY(pm_hdf5_write_text(file, "/", "format", PM_WEIGHTS_FORMAT));
    PM_TRY(pm_hdf5_write_integer(file, "/", "version", PM_WEIGHTS_VERSION));
    PM_TRY(pm_hdf5_write_text(file, "/", "kind", c->kind));
    PM_TRY(pm_hdf5_write_text(file, "/", "model", c->model));
    PM_TRY(write_provenance(file, p, pm_weights_digest(c)));
    for (int i = 0; i < c->nlayout; ++i) {
        PM_TRY(write_layout(file, pm_weights_layout_path(c, i), c->layout[i]));
    }
    return write_params(file, c->params, arena);
}

static pm_status save(const char *path, const pm_weights_content *c, const pm_provenance *p,
                      pm_arena *arena) {
    if (c->model == NULL) {
        return pm_weights_no_memory(path);
    }
    PM_TRY(pm_weights_check_values(c, path));
    pm_hdf5 *file = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(write_component(file, c, p, arena));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    return status;
}

pm_status pm_weights_save_part(const char *path, const pm_part *part,
                               const pm_provenance *provenance) {
    pm_arena arena = {0};
    pm_part copy = *part;
    pm_weights_content c = pm_weights_of_part(&copy);
    c.model = pm_part_spec_write(&part->spec, &arena);
    const pm_status status = save(path, &c, provenance, &arena);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_weights_save_port(const char *path, const pm_port_model *port,
                               const pm_provenance *provenance) {
    pm_arena arena = {0};
    pm_port_model copy = *port;
    pm_weights_content c = pm_weights_of_port(&copy);
    c.model = pm_port_spec_write(&port->spec, &arena);
    const pm_status status = save(path, &c, provenance, &arena);
    pm_arena_free(&arena);
    return status;
}

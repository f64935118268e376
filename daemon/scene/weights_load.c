// Reads weights files in the layout described in weights.h, and checks everything in them.
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/training_range.h"
#include "scene/model_reader.h"
#include "scene/weights_content.h"
#include "store/hdf5_io.h"

#define MAX_COMPONENTS 100000 // of one group

static pm_status check_header(const pm_hdf5 *file, const char *path, const char *kind,
                              pm_arena *arena) {
    const char *format, *found;
    uint64_t version;
    PM_TRY(pm_hdf5_read_text(file, "/", "format", arena, &format));
    if (strcmp(format, PM_WEIGHTS_FORMAT) != 0) {
        return pm_fail(PM_EWEIGHTS, "%s: format is \"%.40s\", expected \"" PM_WEIGHTS_FORMAT "\"",
                       path, format);
    }
    PM_TRY(pm_hdf5_read_integer(file, "/", "version", &version));
    if (version != PM_WEIGHTS_VERSION) {
        return pm_fail(PM_EWEIGHTS, "%s: version of the format is %llu, expected %d", path,
                       (unsigned long long)version, PM_WEIGHTS_VERSION);
    }
    PM_TRY(pm_hdf5_read_text(file, "/", "kind", arena, &found));
    if (strcmp(found, kind) != 0) {
        return pm_fail(PM_EWEIGHTS, "%s: weights of a \"%.40s\", expected those of a %s", path,
                       found, kind);
    }
    return PM_OK;
}

static bool is_identifier(const char *text) {
    bool good = isalpha((unsigned char)text[0]) || text[0] == '_';
    for (; good && *text != '\0'; ++text) {
        good = isalnum((unsigned char)*text) || *text == '_';
    }
    return good;
}

static pm_status read_layout(const pm_hdf5 *file, const char *path, const char *object,
                             pm_arena *arena, pm_layout *layout) {
    const char **name, **unit;
    uint64_t size[PM_MAX_GROUPS];
    int nname, nunit, nsize;
    PM_TRY(pm_hdf5_read_texts(file, object, "names", arena, &nname, &name));
    PM_TRY(pm_hdf5_read_texts(file, object, "units", arena, &nunit, &unit));
    PM_TRY(pm_hdf5_read_integers(file, object, "sizes", PM_MAX_GROUPS, size, &nsize));
    if (nname != nunit || nname != nsize) {
        return pm_fail(PM_EWEIGHTS, "%s: %s has %d names, %d units and %d sizes", path, object,
                       nname, nunit, nsize);
    }
    *layout = (pm_layout){.group = pm_arena_array(arena, (size_t)nsize, sizeof *layout->group)};
    PM_TRY(layout->group == NULL ? pm_weights_no_memory("weights") : PM_OK);
    for (int g = 0; g < nsize; ++g) {
        if (!is_identifier(name[g]) || pm_layout_find(layout, name[g]) != NULL) {
            return pm_fail(PM_EWEIGHTS, "%s: %s: group \"%.40s\" is not a name, or there twice",
                           path, object, name[g]);
        }
        if (size[g] < 1 || size[g] > MAX_COMPONENTS) {
            return pm_fail(PM_EWEIGHTS, "%s: %s: group %s has %llu components, expected 1 to %d",
                           path, object, name[g], (unsigned long long)size[g], MAX_COMPONENTS);
        }
        layout->group[g] =
            (pm_group){.name = name[g], .unit = unit[g], .size = (int)size[g], .first = layout->nz};
        layout->nz += (int)size[g];
        layout->ngroup = g + 1;
    }
    return PM_OK;
}

// Reads the integrator and the step of training, if the file has them.
static pm_status read_steps(const pm_hdf5 *file, const char *path, pm_arena *arena,
                            pm_provenance *p) {
    if (!pm_hdf5_is_text(file, "/", "integrator")) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_read_text(file, "/", "integrator", arena, &p->integrator));
    PM_TRY(pm_hdf5_read_number(file, "/", "step", &p->step));
    return p->step > 0 && isfinite(p->step)
               ? PM_OK
               : pm_fail(PM_EWEIGHTS, "%s: step is %g s, expected a time > 0", path, p->step);
}

// Reads the record of the training data and of the state's columns. Older files have no such
// record.
static pm_status read_origin(const pm_hdf5 *file, pm_arena *arena, pm_provenance *p) {
    int count = 0;
    const char **name;
    PM_TRY(pm_hdf5_attributes(file, "/", arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strcmp(name[i], "seen") == 0) {
            uint64_t *seen = pm_arena_array(arena, PM_MOST_SEEN, sizeof *seen);
            p->seen = seen;
            PM_TRY(seen == NULL ? pm_weights_no_memory("weights") : PM_OK);
            PM_TRY(pm_hdf5_read_integers(file, "/", "seen", PM_MOST_SEEN, seen, &p->nseen));
        }
    }
    if (pm_hdf5_is_text(file, "/", "trajectories")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "trajectories", arena, &p->trajectories));
    }
    if (pm_hdf5_is_text(file, "/", "columns") && pm_hdf5_is_text(file, "/", "relative")) {
        const char *text = NULL;
        PM_TRY(pm_hdf5_read_text(file, "/", "columns", arena, &text));
        PM_TRY(pm_hdf5_read_text(file, "/", "relative", arena, &p->relative));
        p->columns = strtoull(text, NULL, 16);
    }
    return PM_OK;
}

static pm_status read_provenance(const pm_hdf5 *file, const char *path, pm_arena *arena,
                                 pm_provenance *p) {
    *p = (pm_provenance){.path = pm_arena_strdup(arena, path),
                         .coordinates = "",
                         .integrator = "",
                         .trajectories = "",
                         .relative = ""};
    PM_TRY(read_origin(file, arena, p));
    if (pm_hdf5_is_text(file, "/", "coordinates")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "coordinates", arena, &p->coordinates));
    }
    PM_TRY(read_steps(file, path, arena, p));
    PM_TRY(pm_hdf5_read_text(file, "/", "command", arena, &p->command));
    PM_TRY(pm_hdf5_read_text(file, "/", "data", arena, &p->data));
    PM_TRY(pm_hdf5_read_integer(file, "/", "seed", &p->seed));
    PM_TRY(pm_hdf5_read_number(file, "/", "loss", &p->loss));
    PM_TRY(pm_hdf5_read_number(file, "/", "seconds", &p->seconds));
    return p->path == NULL ? pm_weights_no_memory(path) : PM_OK;
}

// Reads the head of a file: kind, layouts, text of the model, provenance and digest.
static pm_status read_head(const pm_hdf5 *file, const char *path, pm_arena *arena,
                           pm_weights_content *c, pm_provenance *p) {
    PM_TRY(check_header(file, path, c->kind, arena));
    PM_TRY(pm_hdf5_read_text(file, "/", "model", arena, &c->model));
    for (int i = 0; i < c->nlayout; ++i) {
        PM_TRY(read_layout(file, path, pm_weights_layout_path(c, i), arena, c->layout[i]));
    }
    return read_provenance(file, path, arena, p);
}

static pm_status read_params(const pm_hdf5 *file, const char *path, pm_arena *arena,
                             const pm_params *params) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        const int shape[2] = {entry->rows, entry->cols};
        const char *object = pm_arena_printf(arena, "/parameters/%s", entry->name);
        if (object == NULL) {
            return pm_weights_no_memory(path);
        }
        PM_TRY(pm_hdf5_read(file, object, 2, shape, entry->value));
    }
    int count;
    const char **name;
    PM_TRY(pm_hdf5_members(file, "/parameters", arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (pm_params_find(params, name[i]) == NULL) {
            return pm_fail(PM_EWEIGHTS, "%s: parameter %s is not one of this model", path, name[i]);
        }
    }
    return PM_OK;
}

static pm_status check_digest(const pm_hdf5 *file, const char *path, pm_arena *arena,
                              const pm_weights_content *c, uint64_t *digest) {
    char text[32];
    const char *stored;
    *digest = pm_weights_digest(c);
    snprintf(text, sizeof text, "%016llx", (unsigned long long)*digest);
    PM_TRY(pm_hdf5_read_text(file, "/", "digest", arena, &stored));
    if (strcmp(stored, text) != 0) {
        return pm_fail(PM_EWEIGHTS, "%s: digest of the content is %s, expected %.40s: changed",
                       path, text, stored);
    }
    return PM_OK;
}

// Reads and checks the values of a declared model.
static pm_status read_values(const pm_hdf5 *file, const char *path, pm_arena *arena,
                             const pm_weights_content *c, pm_provenance *p) {
    PM_TRY(read_params(file, path, arena, c->params));
    PM_TRY(pm_weights_check_values(c, path));
    return check_digest(file, path, arena, c, &p->digest);
}

// Turns an error in the text of the model, which is part of the file, into an error of the weights.
static pm_status blame_weights(pm_status status, const char *path) {
    return status == PM_ECONFIG ? pm_fail(PM_EWEIGHTS, "%s: model: %s", path, pm_error()) : status;
}

static pm_status open_weights(pm_hdf5 **file, const char *path) {
    const pm_status status = pm_hdf5_open(file, path, PM_HDF5_OWN, PM_EWEIGHTS);
    return status == PM_EFILE ? pm_fail(PM_EWEIGHTS, "weights %s", pm_error()) : status;
}

static pm_status declare_part(pm_part *part, const char *model, pm_arena *arena) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_parse(&document, model, "text", &root));
    PM_TRY_DONE(pm_part_spec_read(root, (pm_yaml){0}, arena, &part->spec));
    status = pm_part_declare(part);
done:
    pm_yaml_close(document);
    return status;
}

static pm_status declare_port(pm_port_model *port, const char *model, pm_arena *arena) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_parse(&document, model, "text", &root));
    PM_TRY_DONE(pm_port_spec_read(root, (pm_yaml){0}, arena, &port->spec));
    status = pm_port_declare(port);
done:
    pm_yaml_close(document);
    return status;
}

// Declares the training range, if the file has one.
static pm_status declare_training_range(const pm_hdf5 *file, pm_part *part, pm_arena *arena) {
    int count;
    const char **name;
    PM_TRY(pm_hdf5_members(file, "/parameters", arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strncmp(name[i], "training_range.", strlen("training_range.")) == 0) {
            return pm_training_range_declare(part);
        }
    }
    return PM_OK;
}

pm_status pm_weights_load_part(const char *path, pm_arena *arena, pm_part *part,
                               pm_provenance *provenance) {
    pm_hdf5 *file = NULL;
    pm_part loaded = {0};
    pm_provenance p;
    pm_weights_content c = pm_weights_of_part(&loaded);
    pm_status status;
    PM_TRY_DONE(open_weights(&file, path));
    PM_TRY_DONE(read_head(file, path, arena, &c, &p));
    PM_TRY_DONE(blame_weights(declare_part(&loaded, c.model, arena), path));
    PM_TRY_DONE(declare_training_range(file, &loaded, arena));
    PM_TRY_DONE(read_values(file, path, arena, &c, &p));
    *part = loaded;
    loaded = (pm_part){0};
    *provenance = p;
done:
    pm_part_free(&loaded);
    pm_hdf5_close(file);
    return status;
}

pm_status pm_weights_load_port(const char *path, pm_arena *arena, pm_port_model *port,
                               pm_provenance *provenance) {
    pm_hdf5 *file = NULL;
    pm_port_model loaded = {0};
    pm_provenance p;
    pm_weights_content c = pm_weights_of_port(&loaded);
    pm_status status;
    PM_TRY_DONE(open_weights(&file, path));
    PM_TRY_DONE(read_head(file, path, arena, &c, &p));
    PM_TRY_DONE(blame_weights(declare_port(&loaded, c.model, arena), path));
    PM_TRY_DONE(read_values(file, path, arena, &c, &p));
    *port = loaded;
    loaded = (pm_port_model){0};
    *provenance = p;
done:
    pm_port_free(&loaded);
    pm_hdf5_close(file);
    return status;
}

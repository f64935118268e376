// Weights files: writing and checked reading of the layout described in weights.h.
#include "scene/weights.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/digest.h"
#include "model/training_range.h"
#include "scene/model_reader.h"
#include "store/hdf5_io.h"

#define FORMAT "portmet weights"
#define VERSION 1 // of the layout; a model that an older program does not know it refuses by key
#define MAX_COMPONENTS 100000 // of one group

// What a subsystem and a port have in common.
typedef struct component {
    const char *kind;
    int nlayout;
    pm_layout *layout[2];
    pm_params *params;
    const char *model; // YAML text
} component;

static const char *layout_path(const component *c, int i) {
    return c->nlayout == 1 ? "/layout" : i == 0 ? "/layout_a" : "/layout_b";
}

static component part_component(pm_part *part) {
    return (component){.kind = "subsystem",
                       .nlayout = 1,
                       .layout = {&part->layout, NULL},
                       .params = &part->params};
}

static component port_component(pm_port_model *port) {
    return (component){.kind = "port",
                       .nlayout = 2,
                       .layout = {&port->layout[0], &port->layout[1]},
                       .params = &port->params};
}

static pm_status fail_memory(const char *path) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", path);
}

static uint64_t component_digest(const component *c) {
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, c->kind);
    for (int i = 0; i < c->nlayout; ++i) {
        const pm_layout *layout = c->layout[i];
        digest = pm_digest_integer(digest, layout->ngroup);
        for (int g = 0; g < layout->ngroup; ++g) {
            digest = pm_digest_text(digest, layout->group[g].name);
            digest = pm_digest_text(digest, layout->group[g].unit);
            digest = pm_digest_integer(digest, layout->group[g].size);
        }
    }
    digest = pm_digest_text(digest, c->model);
    for (int i = 0; i < c->params->count; ++i) {
        const pm_param_entry *entry = &c->params->entry[i];
        digest = pm_digest_text(digest, entry->name);
        digest = pm_digest_integer(digest, entry->rows);
        digest = pm_digest_integer(digest, entry->cols);
        digest = pm_digest_doubles(digest, entry->value, (size_t)entry->rows * (size_t)entry->cols);
    }
    return digest;
}

static pm_status digest_of(component c, const char *model, uint64_t *digest) {
    if (model == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the text of a model");
    }
    c.model = model;
    *digest = component_digest(&c);
    return PM_OK;
}

pm_status pm_weights_digest_part(const pm_part *part, uint64_t *digest) {
    pm_arena arena = {0};
    pm_part copy = *part;
    const pm_status status =
        digest_of(part_component(&copy), pm_part_spec_write(&part->spec, &arena), digest);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_weights_digest_port(const pm_port_model *port, uint64_t *digest) {
    pm_arena arena = {0};
    pm_port_model copy = *port;
    const pm_status status =
        digest_of(port_component(&copy), pm_port_spec_write(&port->spec, &arena), digest);
    pm_arena_free(&arena);
    return status;
}

static pm_status check_values(const component *c, const char *path) {
    for (int i = 0; i < c->params->count; ++i) {
        const pm_param_entry *entry = &c->params->entry[i];
        const size_t count = (size_t)entry->rows * (size_t)entry->cols;
        for (size_t k = 0; k < count; ++k) {
            if (!isfinite(entry->value[k])) {
                return pm_fail(PM_EWEIGHTS,
                               "%s: parameter %s [%zu][%zu] is %g, expected a finite number", path,
                               entry->name, k / (size_t)entry->cols, k % (size_t)entry->cols,
                               entry->value[k]);
            }
        }
    }
    return PM_OK;
}

// --- saving ---

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
            return fail_memory("weights");
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

static pm_status write_component(pm_hdf5 *file, const component *c, const pm_provenance *p,
                                 pm_arena *arena) {
    PM_TRY(pm_hdf5_write_text(file, "/", "format", FORMAT));
    PM_TRY(pm_hdf5_write_integer(file, "/", "version", VERSION));
    PM_TRY(pm_hdf5_write_text(file, "/", "kind", c->kind));
    PM_TRY(pm_hdf5_write_text(file, "/", "model", c->model));
    PM_TRY(write_provenance(file, p, component_digest(c)));
    for (int i = 0; i < c->nlayout; ++i) {
        PM_TRY(write_layout(file, layout_path(c, i), c->layout[i]));
    }
    return write_params(file, c->params, arena);
}

static pm_status save(const char *path, const component *c, const pm_provenance *p,
                      pm_arena *arena) {
    if (c->model == NULL) {
        return fail_memory(path);
    }
    PM_TRY(check_values(c, path));
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
    component c = part_component(&copy);
    c.model = pm_part_spec_write(&part->spec, &arena);
    const pm_status status = save(path, &c, provenance, &arena);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_weights_save_port(const char *path, const pm_port_model *port,
                               const pm_provenance *provenance) {
    pm_arena arena = {0};
    pm_port_model copy = *port;
    component c = port_component(&copy);
    c.model = pm_port_spec_write(&port->spec, &arena);
    const pm_status status = save(path, &c, provenance, &arena);
    pm_arena_free(&arena);
    return status;
}

// --- loading ---

static pm_status check_header(const pm_hdf5 *file, const char *path, const char *kind,
                              pm_arena *arena) {
    const char *format, *found;
    uint64_t version;
    PM_TRY(pm_hdf5_read_text(file, "/", "format", arena, &format));
    if (strcmp(format, FORMAT) != 0) {
        return pm_fail(PM_EWEIGHTS, "%s: format is \"%.40s\", expected \"" FORMAT "\"", path,
                       format);
    }
    PM_TRY(pm_hdf5_read_integer(file, "/", "version", &version));
    if (version != VERSION) {
        return pm_fail(PM_EWEIGHTS, "%s: version of the format is %llu, expected %d", path,
                       (unsigned long long)version, VERSION);
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
    *layout = (pm_layout){0};
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

// By what steps, if the file knows it.
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

// What the file knows of the data and of the state, which older ones do not.
static pm_status read_origin(const pm_hdf5 *file, pm_arena *arena, pm_provenance *p) {
    int count = 0;
    const char **name;
    PM_TRY(pm_hdf5_attributes(file, "/", arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strcmp(name[i], "seen") == 0) {
            uint64_t *seen = pm_arena_array(arena, PM_MOST_SEEN, sizeof *seen);
            p->seen = seen;
            PM_TRY(seen == NULL ? fail_memory("weights") : PM_OK);
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

// The digest read stands for the file; check_digest compares it with the content.
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
    return p->path == NULL ? fail_memory(path) : PM_OK;
}

// All that comes before the model can be declared.
static pm_status read_head(const pm_hdf5 *file, const char *path, pm_arena *arena, component *c,
                           pm_provenance *p) {
    PM_TRY(check_header(file, path, c->kind, arena));
    PM_TRY(pm_hdf5_read_text(file, "/", "model", arena, &c->model));
    for (int i = 0; i < c->nlayout; ++i) {
        PM_TRY(read_layout(file, path, layout_path(c, i), arena, c->layout[i]));
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
            return fail_memory(path);
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
                              const component *c, uint64_t *digest) {
    char text[32];
    const char *stored;
    *digest = component_digest(c);
    snprintf(text, sizeof text, "%016llx", (unsigned long long)*digest);
    PM_TRY(pm_hdf5_read_text(file, "/", "digest", arena, &stored));
    if (strcmp(stored, text) != 0) {
        return pm_fail(PM_EWEIGHTS, "%s: digest of the content is %s, expected %.40s: changed",
                       path, text, stored);
    }
    return PM_OK;
}

// All that comes after the model was declared.
static pm_status read_values(const pm_hdf5 *file, const char *path, pm_arena *arena,
                             const component *c, pm_provenance *p) {
    PM_TRY(read_params(file, path, arena, c->params));
    PM_TRY(check_values(c, path));
    return check_digest(file, path, arena, c, &p->digest);
}

// The model's text was written by us: what is wrong with it is the file's fault, not the scene's.
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

// The region that the weights were trained on, if the file knows it.
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
    component c = part_component(&loaded);
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
    component c = port_component(&loaded);
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

// Writes and reads weights files in the layout described in weights.h, and checks everything that
// it reads.
#include "scene/weights.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/files.h"
#include "model/training_range.h"
#include "store/hdf5_io.h"

// The version of the layout. A new key in the text of a model needs no new version: older programs
// refuse a key that they do not know.
#define VERSION 1
#define MAX_COMPONENTS 100000 // of one group

static void write_digest(char text[32], uint64_t digest) {
    snprintf(text, 32, "%016llx", (unsigned long long)digest);
}

static pm_status check_values(const pm_params *params, const char *path) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
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

// --- writing ---

static bool is_given(const char *text) {
    return text != NULL && *text != '\0';
}

static pm_status write_provenance(pm_hdf5 *file, const pm_provenance *p, uint64_t digest) {
    char text[32], created[32];
    const time_t now = time(NULL);
    struct tm utc;
    write_digest(text, digest);
    strftime(created, sizeof created, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &utc));
    PM_TRY(pm_hdf5_write_text(file, "/", "digest", text));
    PM_TRY(pm_hdf5_write_text(file, "/", "created", created));
    PM_TRY(pm_hdf5_write_text(file, "/", "command", p->command == NULL ? "" : p->command));
    PM_TRY(pm_hdf5_write_text(file, "/", "data", p->data == NULL ? "" : p->data));
    if (is_given(p->coordinates)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "coordinates", p->coordinates));
    }
    if (is_given(p->integrator)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "integrator", p->integrator));
        PM_TRY(pm_hdf5_write_number(file, "/", "step", p->step));
    }
    if (is_given(p->verdict)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "verdict", p->verdict));
    }
    if (is_given(p->fit)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "fit", p->fit));
    }
    if (is_given(p->system)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "system", p->system));
    }
    if (is_given(p->trajectories)) {
        PM_TRY(pm_hdf5_write_text(file, "/", "trajectories", p->trajectories));
    }
    if (p->nseen > 0) {
        const int count = p->nseen < PM_MOST_SEEN ? p->nseen : PM_MOST_SEEN;
        PM_TRY(pm_hdf5_write_integers(file, "/", "seen", count, p->seen));
    }
    if (p->columns != 0) {
        write_digest(text, p->columns);
        PM_TRY(pm_hdf5_write_text(file, "/", "columns", text));
        PM_TRY(pm_hdf5_write_text(file, "/", "relative", p->relative == NULL ? "" : p->relative));
    }
    PM_TRY(pm_hdf5_write_integer(file, "/", "seed", p->seed));
    PM_TRY(pm_hdf5_write_number(file, "/", "loss", p->loss));
    return pm_hdf5_write_number(file, "/", "seconds", p->seconds);
}

pm_status pm_weights_save(const char *path, pm_component c, const pm_provenance *provenance) {
    pm_arena arena = {0};
    pm_hdf5 *file = NULL;
    pm_status status;
    const char *text = c.kind->write_spec(c.spec, &arena);
    PM_TRY_DONE(pm_allocated(text, "%s", path));
    PM_TRY_DONE(check_values(c.params, path));
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_WEIGHTS));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", "format", PM_FILES_WEIGHTS));
    PM_TRY_DONE(pm_hdf5_write_integer(file, "/", "version", VERSION));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", "kind", c.kind->name));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", "model", text));
    PM_TRY_DONE(write_provenance(file, provenance, pm_component_digest(&c, text)));
    for (int i = 0; i < c.kind->nlayout; ++i) {
        const pm_layout *layout = &c.layout[i];
        const char *where = c.kind->layout_path[i], *name[PM_MAX_GROUPS], *unit[PM_MAX_GROUPS];
        uint64_t size[PM_MAX_GROUPS], coenergy[PM_MAX_GROUPS];
        bool some = false; // co-energies
        for (int g = 0; g < layout->ngroup; ++g) {
            name[g] = layout->group[g].name;
            unit[g] = layout->group[g].unit;
            size[g] = (uint64_t)layout->group[g].size;
            coenergy[g] = layout->group[g].coenergy;
            some = some || layout->group[g].coenergy;
        }
        PM_TRY_DONE(pm_hdf5_write_group(file, where));
        PM_TRY_DONE(pm_hdf5_write_texts(file, where, "names", layout->ngroup, name));
        PM_TRY_DONE(pm_hdf5_write_texts(file, where, "units", layout->ngroup, unit));
        PM_TRY_DONE(pm_hdf5_write_integers(file, where, "sizes", layout->ngroup, size));
        if (some) {
            PM_TRY_DONE(
                pm_hdf5_write_integers(file, where, "coenergies", layout->ngroup, coenergy));
        }
    }
    PM_TRY_DONE(pm_hdf5_write_group(file, "/parameters"));
    for (int i = 0; i < c.params->count; ++i) {
        const pm_param_entry *entry = &c.params->entry[i];
        const int shape[2] = {entry->rows, entry->cols};
        const char *object = pm_arena_printf(&arena, "/parameters/%s", entry->name);
        PM_TRY_DONE(pm_arena_status(&arena, "weights"));
        PM_TRY_DONE(pm_hdf5_write(file, object, 2, shape, entry->value));
        PM_TRY_DONE(pm_hdf5_write_integer(file, object, "trained", entry->trained));
    }
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    pm_arena_free(&arena);
    return status;
}

// --- reading ---

static pm_status read_layout(const pm_hdf5 *file, const char *path, const char *object,
                             pm_arena *arena, pm_layout *layout) {
    const char **name, **unit, **attribute;
    uint64_t size[PM_MAX_GROUPS], coenergy[PM_MAX_GROUPS] = {0};
    int nname, nunit, nsize, ncoenergy = 0, nattribute;
    PM_TRY(pm_hdf5_read_texts(file, object, "names", arena, &nname, &name));
    PM_TRY(pm_hdf5_read_texts(file, object, "units", arena, &nunit, &unit));
    PM_TRY(pm_hdf5_read_integers(file, object, "sizes", PM_MAX_GROUPS, size, &nsize));
    PM_TRY(pm_hdf5_attributes(file, object, arena, &nattribute, &attribute));
    for (int i = 0; i < nattribute; ++i) { // a layout without co-energies has no such list
        if (strcmp(attribute[i], "coenergies") == 0) {
            PM_TRY(pm_hdf5_read_integers(file, object, "coenergies", PM_MAX_GROUPS, coenergy,
                                         &ncoenergy));
        }
    }
    if (nname != nunit || nname != nsize || (ncoenergy != 0 && ncoenergy != nsize)) {
        return pm_fail(PM_EWEIGHTS, "%s: %s has %d names, %d units, %d sizes and %d co-energies",
                       path, object, nname, nunit, nsize, ncoenergy);
    }
    *layout = (pm_layout){.group = pm_arena_array(arena, (size_t)nsize, sizeof *layout->group)};
    PM_TRY(pm_arena_status(arena, "weights"));
    for (int g = 0; g < nsize; ++g) {
        bool good = isalpha((unsigned char)name[g][0]) || name[g][0] == '_';
        for (const char *at = name[g]; good && *at != '\0'; ++at) {
            good = isalnum((unsigned char)*at) || *at == '_';
        }
        if (!good || pm_layout_find(layout, name[g]) != NULL) {
            return pm_fail(PM_EWEIGHTS, "%s: %s: group \"%.40s\" is not a name, or there twice",
                           path, object, name[g]);
        }
        if (size[g] < 1 || size[g] > MAX_COMPONENTS) {
            return pm_fail(PM_EWEIGHTS, "%s: %s: group %s has %llu components, expected 1 to %d",
                           path, object, name[g], (unsigned long long)size[g], MAX_COMPONENTS);
        }
        pm_layout_add(layout, name[g], unit[g], (int)size[g]);
        if (coenergy[g] != 0) {
            pm_layout_mark_coenergy(layout);
        }
    }
    return PM_OK;
}

static pm_status read_provenance(const pm_hdf5 *file, const char *path, pm_arena *arena,
                                 pm_provenance *p) {
    *p = (pm_provenance){.path = pm_arena_strdup(arena, path),
                         .coordinates = "",
                         .integrator = "",
                         .verdict = "",
                         .fit = "",
                         .system = "",
                         .trajectories = "",
                         .relative = ""};
    // Older files have no record of the training data and of the columns of the state.
    int count = 0;
    const char **name;
    PM_TRY(pm_hdf5_attributes(file, "/", arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strcmp(name[i], "seen") == 0) {
            uint64_t *seen = pm_arena_array(arena, PM_MOST_SEEN, sizeof *seen);
            p->seen = seen;
            PM_TRY(pm_arena_status(arena, "weights"));
            PM_TRY(pm_hdf5_read_integers(file, "/", "seen", PM_MOST_SEEN, seen, &p->nseen));
        }
    }
    if (pm_hdf5_is_text(file, "/", "verdict")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "verdict", arena, &p->verdict));
    }
    if (pm_hdf5_is_text(file, "/", "fit")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "fit", arena, &p->fit));
    }
    if (pm_hdf5_is_text(file, "/", "system")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "system", arena, &p->system));
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
    if (pm_hdf5_is_text(file, "/", "coordinates")) {
        PM_TRY(pm_hdf5_read_text(file, "/", "coordinates", arena, &p->coordinates));
    }
    if (pm_hdf5_is_text(file, "/", "integrator")) { // of the training, and its step
        PM_TRY(pm_hdf5_read_text(file, "/", "integrator", arena, &p->integrator));
        PM_TRY(pm_hdf5_read_number(file, "/", "step", &p->step));
        if (!(p->step > 0 && isfinite(p->step))) {
            return pm_fail(PM_EWEIGHTS, "%s: step is %g s, expected a time > 0", path, p->step);
        }
    }
    PM_TRY(pm_hdf5_read_text(file, "/", "command", arena, &p->command));
    PM_TRY(pm_hdf5_read_text(file, "/", "data", arena, &p->data));
    PM_TRY(pm_hdf5_read_integer(file, "/", "seed", &p->seed));
    PM_TRY(pm_hdf5_read_number(file, "/", "loss", &p->loss));
    PM_TRY(pm_hdf5_read_number(file, "/", "seconds", &p->seconds));
    return pm_arena_status(arena, "weights");
}

// Reads the text of the model, which is part of the file, and declares the model.
static pm_status declare(const pm_component *c, const char *text, const char *path,
                         pm_arena *arena) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_parse(&document, text, "text", &root));
    PM_TRY_DONE(c->kind->read_spec(root, (pm_yaml){0}, arena, c->spec));
    status = c->kind->declare(c->model);
done:
    pm_yaml_close(document);
    return status == PM_ECONFIG ? pm_fail(PM_EWEIGHTS, "%s: model: %s", path, pm_error()) : status;
}

// Reads the values of a declared model. A part or port has a training range where the file has one.
static pm_status read_params(const pm_hdf5 *file, const char *path, pm_arena *arena,
                             const pm_component *c) {
    static const char *const range[2] = {"training_range.", "input_range."};
    pm_part *part = pm_component_part(c);
    int count;
    const char **name;
    PM_TRY(pm_hdf5_members(file, "/parameters", arena, &count, &name));
    bool ranged = false;
    for (int i = 0; i < count; ++i) {
        const char *own = range[part == NULL];
        ranged = ranged || strncmp(name[i], own, strlen(own)) == 0;
    }
    if (ranged) {
        PM_TRY(part != NULL ? pm_training_range_declare(part) : pm_input_range_declare(c->model));
    }
    for (int i = 0; i < c->params->count; ++i) {
        const pm_param_entry *entry = &c->params->entry[i];
        const int shape[2] = {entry->rows, entry->cols};
        const char *object = pm_arena_printf(arena, "/parameters/%s", entry->name);
        PM_TRY(pm_arena_status(arena, "weights"));
        PM_TRY(pm_hdf5_read(file, object, 2, shape, entry->value));
    }
    for (int i = 0; i < count; ++i) {
        if (pm_params_find(c->params, name[i]) == NULL) {
            return pm_fail(PM_EWEIGHTS, "%s: parameter %s is not one of this model", path, name[i]);
        }
    }
    return check_values(c->params, path);
}

pm_status pm_weights_load(const char *path, pm_arena *arena, pm_component component,
                          pm_provenance *provenance) {
    union {
        pm_part part;
        pm_port_model port;
    } loaded;
    memset(&loaded, 0, sizeof loaded);
    pm_hdf5 *file = NULL;
    pm_provenance p;
    const char *text, *stored;
    char digest[32];
    uint64_t version;
    pm_status status;
    const pm_component c = pm_component_in(&component, &loaded);
    status = pm_hdf5_open(&file, path, PM_HDF5_OWN, PM_EWEIGHTS);
    PM_TRY_DONE(status == PM_EFILE ? pm_fail(PM_EWEIGHTS, "weights %s", pm_error()) : status);
    PM_TRY_DONE(pm_hdf5_read_text(file, "/", "format", arena, &text));
    if (strcmp(text, PM_FILES_WEIGHTS) != 0) {
        PM_TRY_DONE(pm_fail(
            PM_EWEIGHTS, "%s: format is \"%.40s\", expected \"" PM_FILES_WEIGHTS "\"", path, text));
    }
    PM_TRY_DONE(pm_hdf5_read_integer(file, "/", "version", &version));
    if (version != VERSION) {
        PM_TRY_DONE(pm_fail(PM_EWEIGHTS, "%s: version of the format is %llu, expected %d", path,
                            (unsigned long long)version, VERSION));
    }
    PM_TRY_DONE(pm_hdf5_read_text(file, "/", "kind", arena, &text));
    if (strcmp(text, c.kind->name) != 0) {
        PM_TRY_DONE(pm_fail(PM_EWEIGHTS, "%s: weights of a \"%.40s\", expected those of a %s", path,
                            text, c.kind->name));
    }
    PM_TRY_DONE(pm_hdf5_read_text(file, "/", "model", arena, &text));
    for (int i = 0; i < c.kind->nlayout; ++i) {
        PM_TRY_DONE(read_layout(file, path, c.kind->layout_path[i], arena, &c.layout[i]));
    }
    PM_TRY_DONE(read_provenance(file, path, arena, &p));
    PM_TRY_DONE(declare(&c, text, path, arena));
    PM_TRY_DONE(read_params(file, path, arena, &c));
    p.digest = pm_component_digest(&c, text);
    write_digest(digest, p.digest);
    PM_TRY_DONE(pm_hdf5_read_text(file, "/", "digest", arena, &stored));
    if (strcmp(stored, digest) != 0) {
        PM_TRY_DONE(pm_fail(PM_EWEIGHTS, "%s: digest of the content is %s, expected %.40s: changed",
                            path, digest, stored));
    }
    memcpy(component.model, &loaded, c.kind->model_size);
    memset(&loaded, 0, sizeof loaded);
    *provenance = p;
done:
    pm_params_free(c.params);
    pm_hdf5_close(file);
    return status;
}

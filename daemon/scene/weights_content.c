// The content of weights and its digest.
#include "scene/weights_content.h"

#include <math.h>

#include "base/digest.h"
#include "scene/model_reader.h"

const char *pm_weights_layout_path(const pm_weights_content *c, int i) {
    return c->nlayout == 1 ? "/layout" : i == 0 ? "/layout_a" : "/layout_b";
}

pm_weights_content pm_weights_of_part(pm_part *part) {
    return (pm_weights_content){.kind = "subsystem",
                                .nlayout = 1,
                                .layout = {&part->layout, NULL},
                                .params = &part->params};
}

pm_weights_content pm_weights_of_port(pm_port_model *port) {
    return (pm_weights_content){.kind = "port",
                                .nlayout = 2,
                                .layout = {&port->layout[0], &port->layout[1]},
                                .params = &port->params};
}

pm_status pm_weights_no_memory(const char *path) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", path);
}

uint64_t pm_weights_digest(const pm_weights_content *c) {
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

static pm_status digest_of(pm_weights_content c, const char *model, uint64_t *digest) {
    if (model == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the text of a model");
    }
    c.model = model;
    *digest = pm_weights_digest(&c);
    return PM_OK;
}

pm_status pm_weights_digest_part(const pm_part *part, uint64_t *digest) {
    pm_arena arena = {0};
    pm_part copy = *part;
    const pm_status status =
        digest_of(pm_weights_of_part(&copy), pm_part_spec_write(&part->spec, &arena), digest);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_weights_digest_port(const pm_port_model *port, uint64_t *digest) {
    pm_arena arena = {0};
    pm_port_model copy = *port;
    const pm_status status =
        digest_of(pm_weights_of_port(&copy), pm_port_spec_write(&port->spec, &arena), digest);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_weights_check_values(const pm_weights_content *c, const char *path) {
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

// The two kinds of components.
#include "scene/component.h"

#include "base/digest.h"
#include "scene/model_reader.h"

static pm_status read_part(pm_yaml block, pm_yaml constants, pm_arena *arena, void *spec) {
    return pm_part_spec_read(block, constants, arena, spec);
}

static pm_status read_port(pm_yaml block, pm_yaml constants, pm_arena *arena, void *spec) {
    return pm_port_spec_read(block, constants, arena, spec);
}

static const char *write_part(const void *spec, pm_arena *arena) {
    return pm_part_spec_write(spec, arena);
}

static const char *write_port(const void *spec, pm_arena *arena) {
    return pm_port_spec_write(spec, arena);
}

static pm_status declare_part(void *model) {
    return pm_part_declare(model);
}

static pm_status declare_port(void *model) {
    return pm_port_declare(model);
}

static const pm_component_kind kinds[] = {
    {"subsystem",
     1,
     {"/layout"},
     sizeof(pm_part),
     sizeof(pm_part_spec),
     read_part,
     write_part,
     declare_part},
    {"port",
     2,
     {"/layout_a", "/layout_b"},
     sizeof(pm_port_model),
     sizeof(pm_port_spec),
     read_port,
     write_port,
     declare_port},
};

pm_component pm_component_of_part(pm_part *part) {
    return (pm_component){&kinds[0], part, &part->spec, &part->layout, &part->params, NULL};
}

pm_component pm_component_of_port(pm_port_model *port) {
    return (pm_component){&kinds[1], port, &port->spec, port->layout, &port->params, NULL};
}

pm_component pm_component_in(const pm_component *like, void *memory) {
    return like->kind == &kinds[0] ? pm_component_of_part(memory) : pm_component_of_port(memory);
}

pm_part *pm_component_part(const pm_component *component) {
    return component->kind == &kinds[0] ? component->model : NULL;
}

const char *pm_component_law(const pm_component *component) {
    const pm_port_model *port = component->kind == &kinds[1] ? component->model : NULL;
    return port == NULL ? NULL : port->spec.law;
}

uint64_t pm_component_digest(const pm_component *c, const char *text) {
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, c->kind->name);
    for (int i = 0; i < c->kind->nlayout; ++i) {
        digest = pm_layout_digest(&c->layout[i], digest);
    }
    digest = pm_digest_text(digest, text);
    for (int i = 0; i < c->params->count; ++i) {
        const pm_param_entry *entry = &c->params->entry[i];
        digest = pm_digest_text(digest, entry->name);
        digest = pm_digest_integer(digest, entry->rows);
        digest = pm_digest_integer(digest, entry->cols);
        digest = pm_digest_doubles(digest, entry->value, (size_t)entry->rows * (size_t)entry->cols);
    }
    return digest;
}

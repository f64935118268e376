// A component: the model of a subsystem or of a port, as what both have in common. Weights files,
// systems and fits treat all components alike; the table in component.c says what differs.
#ifndef PM_SCENE_COMPONENT_H
#define PM_SCENE_COMPONENT_H

#include <stdint.h>

#include "base/arena.h"
#include "model/part.h"
#include "model/port.h"
#include "store/yaml.h"

typedef struct pm_provenance pm_provenance;

typedef struct pm_component_kind {
    const char *name; // "subsystem" or "port", also in weights files
    int nlayout;
    const char *layout_path[2]; // [nlayout] objects of a weights file
    size_t model_size, spec_size;
    // Reads a spec from a block (model_reader.h), and writes one as YAML text into the arena.
    pm_status (*read_spec)(pm_yaml block, pm_yaml constants, pm_arena *arena, void *spec);
    const char *(*write_spec)(const void *spec, pm_arena *arena);
    // Checks the spec against the layouts, and declares the parameters.
    pm_status (*declare)(void *model);
} pm_component_kind;

// The members point into the model, which is a pm_part or a pm_port_model.
typedef struct pm_component {
    const pm_component_kind *kind;
    void *model;
    void *spec;        // pm_part_spec or pm_port_spec
    pm_layout *layout; // [kind->nlayout] groups of the state, or exposed groups of ends a and b
    pm_params *params;
    pm_provenance *provenance; // of the parameters (weights.h); NULL outside of a system
} pm_component;

// Return a part or a port model as a component.
pm_component pm_component_of_part(pm_part *part);
pm_component pm_component_of_port(pm_port_model *port);
// Makes an empty model of the same kind as `like` in zeroed memory [like->kind->model_size].
pm_component pm_component_in(const pm_component *like, void *memory);
// Returns the part if the component is one, else NULL.
pm_part *pm_component_part(const pm_component *component);

// Returns the law of a port's spec, or NULL for a part.
const char *pm_component_law(const pm_component *component);

// Returns the digest over kind, layouts, `text` of the spec, and names, shapes and values of all
// parameters, which identifies weights.
uint64_t pm_component_digest(const pm_component *component, const char *text);

#endif

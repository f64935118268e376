// Chains and rings as scene text.
#include "lattice.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/rng.h"
#include "store/model_yaml.h"

static const char part_text[] = "energy: {features: [\"|x|^2\"], skip: linear}\n";
static const char port_text[] = "law: bracket\n"
                                "reversible: {given: [[a.x, b.x, 1.0]]}\n";

// The caller frees it; NULL: out of memory.
static char *write_scene(lattice_shape shape, int count, int window) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return NULL;
    }
    fprintf(file,
            "scene: lattice\n"
            "time: {dt: 0.001, steps: 1, integrator: euler}\n"
            "lockstep: {window: %d, patience: 10}\n"
            "subsystems:\n",
            window);
    for (int i = 0; i < count; ++i) {
        fprintf(file, "  n%d: {weights: n.h5, initial: {x: 1.0}, state: {x: {unit: m, size: 1}}}\n",
                i);
    }
    const int nport = shape == LATTICE_RING && count > 2 ? count : count - 1;
    fprintf(file, nport > 0 ? "ports:\n" : "");
    for (int i = 0; i < nport; ++i) {
        const int next = (i + 1) % count;
        fprintf(file,
                "  p%d: {law: bracket, between: [n%d, n%d], weights: p.h5, expose: {n%d: x, n%d: "
                "x}}\n",
                i, i, next, i, next);
    }
    fclose(file);
    return text;
}

static pm_status make_models(pm_system *system) {
    pm_yaml_document *part_document = NULL, *port_document = NULL;
    pm_yaml part_block, port_block;
    pm_status status;
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    PM_TRY_DONE(pm_yaml_parse(&part_document, part_text, "lattice", &part_block));
    PM_TRY_DONE(pm_yaml_parse(&port_document, port_text, "lattice", &port_block));
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        pm_part *part = &system->part[i];
        PM_TRY_DONE(pm_part_spec_read(part_block, &system->arena, &part->spec));
        PM_TRY_DONE(pm_part_declare(part));
        pm_params_randomise(&part->params, &rng);
    }
    for (int i = 0; i < system->scene->nport; ++i) {
        pm_port_model *port = &system->port[i];
        PM_TRY_DONE(pm_port_spec_read(port_block, &system->arena, &port->spec));
        PM_TRY_DONE(pm_port_declare(port));
    }
done:
    pm_yaml_close(part_document);
    pm_yaml_close(port_document);
    return status;
}

pm_status lattice_make(pm_scene **scene, pm_system **system, lattice_shape shape, int count,
                       int window) {
    char *text = write_scene(shape, count, window);
    if (text == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a lattice");
    }
    const pm_status status = pm_scene_parse(scene, text, "lattice.yaml");
    free(text);
    PM_TRY(status);
    PM_TRY(pm_system_new(system, *scene));
    return make_models(*system);
}

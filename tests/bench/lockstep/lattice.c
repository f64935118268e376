// Writes chains, rings and pairs as the text of a scene.
#include "lattice.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/rng.h"
#include "scene/model_reader.h"

const char lattice_trivial_part[] = "energy: {features: [\"|x|^2\"], skip: linear}\n";
const char lattice_trivial_port[] = "law: bracket\n"
                                    "reversible: {given: [[a.x, b.x, 1.0]]}\n";

static void write_port(FILE *file, int from, int to) {
    fprintf(file,
            "  p%d: {law: bracket, between: [n%d, n%d], weights: p.h5, expose: {n%d: x, n%d: x}}\n",
            from, from, to, from, to);
}

// Returns the text of a scene, which the caller frees; NULL: out of memory.
static char *write_scene(const lattice *l) {
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return NULL;
    }
    fprintf(file,
            "scene: lattice\n"
            "time: {dt: %g, steps: 1, integrator: euler}\n"
            "lockstep: {window: %d, patience: 10}\n"
            "subsystems:\n",
            l->dt, l->window);
    for (int i = 0; i < l->count; ++i) {
        fprintf(file, "  n%d: {weights: n.h5, initial: {x: 1.0}, state: {x: {unit: m, size: 1}}}\n",
                i);
    }
    fprintf(file, "ports:\n");
    for (int i = 0; i + 1 < l->count; i += l->shape == LATTICE_PAIRS ? 2 : 1) {
        write_port(file, i, i + 1);
    }
    if (l->shape == LATTICE_RING && l->count > 2) {
        write_port(file, l->count - 1, 0);
    }
    fclose(file);
    return text;
}

// Unlike those that training starts from, such weights make everything move.
static void draw_weights(pm_params *params, pm_rng *rng) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        for (int k = 0; entry->trained && k < entry->rows * entry->cols; ++k) {
            entry->value[k] = pm_rng_normal(rng) / sqrt(entry->rows);
        }
    }
}

static pm_status make_models(pm_system *system, const lattice *l) {
    pm_yaml_document *part_document = NULL, *port_document = NULL;
    pm_yaml part_block, port_block;
    pm_status status;
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    PM_TRY_DONE(pm_yaml_parse(&part_document, l->part, "lattice", &part_block));
    PM_TRY_DONE(pm_yaml_parse(&port_document, l->port, "lattice", &port_block));
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        pm_part *part = system->part[i];
        PM_TRY_DONE(pm_part_spec_read(part_block, (pm_yaml){0}, &system->arena, &part->spec));
        PM_TRY_DONE(pm_part_declare(part));
        draw_weights(&part->params, &rng);
    }
    for (int i = 0; i < system->scene->physics.nport; ++i) {
        pm_port_model *port = system->port[i];
        PM_TRY_DONE(pm_port_spec_read(port_block, (pm_yaml){0}, &system->arena, &port->spec));
        PM_TRY_DONE(pm_port_declare(port));
        draw_weights(&port->params, &rng);
    }
done:
    pm_yaml_close(part_document);
    pm_yaml_close(port_document);
    return status;
}

pm_status lattice_make(pm_scene **scene, pm_system **system, const lattice *l) {
    char *text = write_scene(l);
    if (text == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a lattice");
    }
    const pm_status status = pm_scene_parse(scene, text, "lattice.yaml");
    free(text);
    PM_TRY(status);
    PM_TRY(pm_system_new(system, *scene));
    return make_models(*system, l);
}

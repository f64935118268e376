// Makes a chain of pendula. Each link has an energy of its momentum and of its spring, a given
// entropy, and a canonical L. Each joint couples the momentum of one link with the extension of the
// next one, and conducts heat between them.
#include "tests/support/fixture.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/digest.h"
#include "base/linalg.h"
#include "base/rng.h"
#include "scene/model_reader.h"

#define TEXT_SIZE 16384

static const char part_text[] = "energy:\n"
                                "  - {features: [\"|p|^2\"], hidden: [5], skip: linear}\n"
                                "  - {features: [\"ln|q|\", s], hidden: [6, 6], skip: quadratic}\n"
                                "entropy: {given: s}\n"
                                "reversible: {given: [[q, p, 1.0]]}\n";

static const char port_text[] =
    "law: bracket\n"
    "reversible: {given: [[a.p, b.q, 1.0]]}\n"
    "irreversible:\n"
    "  learned: {acts_on: [a.s, b.s], features: [a.dE.s, b.dE.s], hidden: [4], rank: 1}\n";

static void require(pm_status status) {
    if (status != PM_OK) {
        fprintf(stderr, "fixture: %s\n", pm_error());
        abort();
    }
}

__attribute__((format(printf, 3, 4))) static void append(char *text, size_t *used,
                                                         const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    *used += (size_t)vsnprintf(text + *used, TEXT_SIZE - *used, format, arguments);
    va_end(arguments);
}

static pm_scene *make_scene(int nlink) {
    char text[TEXT_SIZE];
    size_t used = 0;
    append(text, &used,
           "scene: chain\n"
           "time: {dt: 0.02, steps: 20, integrator: rk4, substeps: 2}\n"
           "subsystems:\n");
    for (int i = 1; i <= nlink; ++i) {
        append(text, &used,
               "  link%d:\n"
               "    weights: link%d.h5\n"
               "    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, "
               "size: 1}}\n",
               i, i);
    }
    append(text, &used, nlink > 1 ? "ports:\n" : "");
    for (int i = 1; i < nlink; ++i) {
        append(text, &used,
               "  joint%d:\n"
               "    law: bracket\n"
               "    between: [link%d, link%d]\n"
               "    expose: {link%d: [p, s], link%d: [q, s]}\n"
               "    weights: joint%d.h5\n",
               i, i, i + 1, i, i + 1, i);
    }
    pm_scene *scene = NULL;
    require(pm_scene_parse(&scene, text, "fixture.yaml"));
    return scene;
}

static pm_yaml parse(const char *text, pm_yaml_document **document) {
    pm_yaml block;
    require(pm_yaml_parse(document, text, "fixture", &block));
    return block;
}

static void make_models(pm_system *system, pm_rng *rng) {
    pm_yaml_document *part_document, *port_document;
    const pm_yaml part_block = parse(part_text, &part_document);
    const pm_yaml port_block = parse(port_text, &port_document);
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        pm_part *part = system->part[i];
        require(pm_part_spec_read(part_block, (pm_yaml){0}, &system->arena, &part->spec));
        require(pm_part_declare(part));
        pm_params_randomise(&part->params, rng);
    }
    for (int i = 0; i < system->scene->physics.nport; ++i) {
        pm_port_model *port = system->port[i];
        require(pm_port_spec_read(port_block, (pm_yaml){0}, &system->arena, &port->spec));
        require(pm_port_declare(port));
        pm_params_randomise(&port->params, rng);
    }
    pm_yaml_close(part_document);
    pm_yaml_close(port_document);
}

void fixture_open(fixture *f, int nlink, uint64_t seed) {
    pm_linalg_init();
    pm_rng rng;
    pm_rng_init(&rng, seed, 0);
    f->scene = make_scene(nlink);
    require(pm_system_new(&f->system, f->scene));
    make_models(f->system, &rng);
    f->system->digest = pm_digest_integer(PM_DIGEST_INIT, (int64_t)seed);
    f->z = pm_arena_array(&f->scene->arena, (size_t)f->scene->physics.nz, sizeof *f->z);
    if (f->z == NULL) {
        abort();
    }
    for (int i = 0; i < f->scene->physics.nz; ++i) {
        f->z[i] = pm_rng_normal(&rng);
    }
}

void fixture_deal(fixture *f, int nprocess) {
    static const char *const names[] = {"one", "two", "three", "four", "five"};
    pm_scene *scene = f->scene;
    const size_t size = (size_t)scene->physics.nsubsystem;
    scene->network.process =
        pm_arena_array(&scene->arena, (size_t)nprocess, sizeof *scene->network.process);
    scene->network.nprocess = nprocess;
    for (int i = 0; i < nprocess; ++i) {
        int *list = pm_arena_array(&scene->arena, size, sizeof *list);
        scene->network.process[i] = (pm_scene_process){.name = names[i], .subsystem = list};
    }
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        pm_scene_process *process = &scene->network.process[i % nprocess];
        scene->physics.subsystem[i].process = i % nprocess;
        process->subsystem[process->count++] = i;
    }
}

void fixture_close(fixture *f) {
    pm_system_free(f->system);
    pm_scene_free(f->scene);
    *f = (fixture){0};
}

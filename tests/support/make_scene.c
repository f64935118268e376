// make_scene DIR: writes a small complete scene for tests of the command line: scene.yaml, random
// hard weights, others for `right` (idle.h5, slow.h5), the reference trajectory that the weights of
// the scene produce, and a copy of it with a value that is not finite.
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/linalg.h"
#include "scene/columns.h"
#include "scene/model_reader.h"
#include "scene/weights.h"
#include "sim/monolithic.h"
#include "store/dataset.h"

#define STATES 21
#define COLUMNS 6
#define SEED 7

static const char scene_text[] = "scene: pair\n"
                                 "time: {dt: 0.05, steps: 20, integrator: rk4, substeps: 2}\n"
                                 "subsystems:\n"
                                 "  left:\n"
                                 "    weights: left.h5\n"
                                 "    state:\n"
                                 "      q: {unit: m, columns: [q1]}\n"
                                 "      p: {unit: kg m/s, columns: [p1]}\n"
                                 "      s: {unit: J/K, columns: [s1]}\n"
                                 "  right:\n"
                                 "    weights: right.h5\n"
                                 "    state:\n"
                                 "      q: {unit: m, columns: [q2], relative_to: left.q}\n"
                                 "      p: {unit: kg m/s, columns: [p2]}\n"
                                 "      s: {unit: J/K, columns: [s2]}\n"
                                 "ports:\n"
                                 "  joint:\n"
                                 "    law: bracket\n"
                                 "    between: [left, right]\n"
                                 "    expose: {left: [p, s], right: [q, p, s]}\n"
                                 "    weights: joint.h5\n"
                                 "reference: {file: reference.h5, trajectory: 0}\n";

#define POTENTIALS                                               \
    "energy: {features: [q, p, s], hidden: [4], skip: linear}\n" \
    "entropy: {given: s}\n"                                      \
    "reversible: {given: [[q, p, 1.0]]}\n"

static const char *const part_text[] = {
    POTENTIALS,
    POTENTIALS "irreversible: {learned: {acts_on: [p, s], features: [q], hidden: [4], rank: 1}}\n",
};

// Operators of which the projection leaves nothing.
static const char idle_text[] =
    "energy: {features: [q, p, s], hidden: [4], skip: linear}\n"
    "entropy: {given: s}\n"
    "reversible: {learned: {acts_on: [p, s], features: [q], hidden: [4]}}\n"
    "irreversible: {learned: {acts_on: [s], features: [q], hidden: [4], rank: 1}}\n";

// Networks that take milliseconds a step.
static const char slow_text[] = "energy: {features: [q, p, s], hidden: [600, 600], skip: linear}\n"
                                "entropy: {given: s}\n"
                                "reversible: {given: [[q, p, 1.0]]}\n";

static const char port_text[] =
    "law: bracket\n"
    "reversible: {learned: {acts_on: [a.p, a.s, b.q, b.p], features: [b.q], hidden: [4]}}\n"
    "irreversible: {learned: {acts_on: [a.s, b.s], features: [b.q], hidden: [4], rank: 1}}\n";

static const pm_provenance provenance = {
    .command = "make_scene", .data = "none", .seed = SEED, .verdict = "good"};

static pm_status make_part(pm_system *system, pm_part *part, const char *text, uint64_t stream,
                           const char *path) {
    pm_yaml_document *document;
    pm_yaml block;
    pm_rng rng;
    PM_TRY(pm_yaml_parse(&document, text, "part", &block));
    const pm_status status = pm_part_spec_read(block, (pm_yaml){0}, &system->arena, &part->spec);
    pm_yaml_close(document);
    PM_TRY(status);
    PM_TRY(pm_part_declare(part));
    pm_rng_init(&rng, SEED, stream);
    pm_params_randomise(&part->params, &rng);
    return pm_weights_save(path, pm_component_of_part(part), &provenance);
}

// Writes weights of another part with the state of `right`.
static pm_status make_another(pm_system *system, const char *text, uint64_t stream,
                              const char *path) {
    pm_part part = {.layout = system->part[1]->layout};
    const pm_status status = make_part(system, &part, text, stream, path);
    pm_part_free(&part);
    return status;
}

static pm_status make_port(pm_system *system, const char *path) {
    pm_port_model *port = system->port[0];
    pm_yaml_document *document;
    pm_yaml block;
    pm_rng rng;
    PM_TRY(pm_yaml_parse(&document, port_text, "port", &block));
    const pm_status status = pm_port_spec_read(block, (pm_yaml){0}, &system->arena, &port->spec);
    pm_yaml_close(document);
    PM_TRY(status);
    PM_TRY(pm_port_declare(port));
    pm_rng_init(&rng, SEED, 2);
    pm_params_randomise(&port->params, &rng);
    return pm_weights_save(path, pm_component_of_port(port), &provenance);
}

static pm_status fill_reference(const pm_system *system, pm_dataset *dataset) {
    static const double z0[COLUMNS] = {1, 0.5, 0.2, 1, -0.3, 0.1};
    pm_columns columns;
    pm_monolithic *assembly;
    PM_TRY(pm_columns_bind(&columns, system->scene, dataset, &dataset->arena));
    PM_TRY(pm_monolithic_open(&assembly, system));
    pm_monolithic_set_state(assembly, z0);
    pm_status status = PM_OK;
    pm_columns_to_row(&columns, z0, pm_dataset_state(dataset, 0, 0));
    for (int i = 1; i < STATES && status == PM_OK; ++i) {
        status = pm_monolithic_step(assembly);
        pm_columns_to_row(&columns, pm_monolithic_sample(assembly)->z,
                          pm_dataset_state(dataset, 0, i));
    }
    pm_monolithic_close(assembly);
    return status;
}

// Copies a file with the bytes of one double replaced: the library itself writes no such file.
static pm_status spoil_value(const char *from, const char *to, double value, double other) {
    char bytes[65536];
    FILE *in = fopen(from, "rb"), *out = fopen(to, "wb");
    if (in == NULL || out == NULL) {
        return pm_fail(PM_EFILE, "%s or %s: cannot open", from, to);
    }
    const size_t size = fread(bytes, 1, sizeof bytes, in);
    char *at = memmem(bytes, size, &value, sizeof value);
    if (size == sizeof bytes || at == NULL) {
        return pm_fail(PM_EFILE, "%s: too large, or %g is not in it", from, value);
    }
    memcpy(at, &other, sizeof other);
    fwrite(bytes, 1, size, out);
    fclose(in);
    return fclose(out) == 0 ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", to);
}

static pm_status make_reference(const pm_system *system) {
    static const char *const column[COLUMNS] = {"q1", "p1", "s1", "q2", "p2", "s2"};
    pm_dataset *dataset = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_new(&dataset, 1, STATES, COLUMNS, system->scene->physics.dt, column));
    PM_TRY_DONE(fill_reference(system, dataset));
    PM_TRY_DONE(pm_dataset_save(dataset, "reference.h5"));
    status = spoil_value("reference.h5", "nan.h5", pm_dataset_state(dataset, 0, 3)[2], NAN);
done:
    pm_dataset_free(dataset);
    return status;
}

static pm_status make_scene(void) {
    FILE *file = fopen("scene.yaml", "w");
    if (file == NULL || fputs(scene_text, file) < 0 || fclose(file) != 0) {
        return pm_fail(PM_EFILE, "scene.yaml: cannot write");
    }
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, "scene.yaml"));
    PM_TRY_DONE(pm_system_new(&system, scene));
    PM_TRY_DONE(make_part(system, system->part[0], part_text[0], 0, "left.h5"));
    PM_TRY_DONE(make_part(system, system->part[1], part_text[1], 1, "right.h5"));
    PM_TRY_DONE(make_another(system, idle_text, 3, "idle.h5"));
    PM_TRY_DONE(make_another(system, slow_text, 4, "slow.h5"));
    PM_TRY_DONE(make_port(system, "joint.h5"));
    status = make_reference(system);
done:
    pm_system_free(system);
    pm_scene_free(scene);
    return status;
}

int main(int argc, char **argv) {
    if (argc != 2 || chdir(argv[1]) != 0) {
        fputs("usage: make_scene DIR\n", stderr);
        return PM_EUSAGE;
    }
    pm_linalg_init();
    const pm_status status = make_scene();
    if (status != PM_OK) {
        fprintf(stderr, "make_scene: %s\n", pm_error());
    }
    return (int)status;
}

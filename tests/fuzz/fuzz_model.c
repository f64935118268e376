// Any text must read as the model of a subsystem and of a port, or fail with a one-line error. A
// model that was read must be written as text that reads back to the same text. If its parameters
// can be declared, all its graphs must build.
#include <stddef.h>
#include <string.h>

#include "graph/program.h"
#include "model/contact_bound.h"
#include "model/part.h"
#include "model/port.h"
#include "scene/model_reader.h"
#include "tests/fuzz/target.h"

// Models with more than this many numbers are legal, but too slow to try.
#define LARGEST_MODEL 20000

static const pm_layout layout = {3,
                                 (pm_group[]){{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                                              {"p", "kg m/s", 2, 2, PM_ROLE_OTHER, false},
                                              {"s", "J/K", 1, 4, PM_ROLE_ENTROPY, false}},
                                 5};
static bool is_small_network(const pm_network_spec *spec) {
    long numbers = spec->skip >= PM_SKIP_QUADRATIC ? 100L * spec->nfeature * spec->nfeature : 0;
    int width = 5 * spec->nfeature;
    for (int i = 0; i < spec->nhidden; ++i) {
        numbers += (long)width * spec->hidden[i];
        width = spec->hidden[i];
    }
    return numbers + 64L * width < LARGEST_MODEL;
}

static bool is_small_potential(const pm_potential_spec *spec) {
    bool small = spec->nterm < 8 && spec->ngiven < 8;
    for (int i = 0; i < spec->nterm && small; ++i) {
        small = is_small_network(&spec->term[i]);
    }
    return small;
}

static bool is_small_operator(const pm_operator_spec *spec) {
    return spec->nacts < 16 && spec->nagainst < 16 && spec->nalong < 16 && spec->ngiven < 16 &&
           is_small_network(&spec->network);
}

static bool are_small_images(const pm_part_spec *spec) {
    bool small = true;
    for (int i = 0; i < spec->nderived && small; ++i) {
        small = spec->derived[i].size < LARGEST_MODEL / 100 && spec->derived[i].ngroup < 8;
    }
    return small;
}

// Plans and runs what there is of two nodes.
static void run(pm_graph *g, pm_node first, pm_node second) {
    pm_node output[2];
    int count = 0;
    if (first != PM_NO_NODE) {
        output[count++] = first;
    }
    if (second != PM_NO_NODE) {
        output[count++] = second;
    }
    pm_program *program = NULL;
    if (count > 0 && pm_program_open(&program, g, count, output, 1) == PM_OK) {
        pm_program_run(program, 1);
    }
    pm_program_close(program);
}

// What is written of a model, once it was read from `text` as a part or as a port.
static const char *part_again(const char *text, pm_arena *arena) {
    pm_yaml_document *document;
    pm_yaml root;
    pm_part_spec spec;
    check(pm_yaml_parse(&document, text, "again.yaml", &root) == PM_OK &&
          pm_part_spec_read(root, (pm_yaml){0}, arena, &spec) == PM_OK);
    pm_yaml_close(document);
    return pm_part_spec_write(&spec, arena);
}

static const char *port_again(const char *text, pm_arena *arena) {
    pm_yaml_document *document;
    pm_yaml root;
    pm_port_spec spec;
    check(pm_yaml_parse(&document, text, "again.yaml", &root) == PM_OK &&
          pm_port_spec_read(root, (pm_yaml){0}, arena, &spec) == PM_OK);
    pm_yaml_close(document);
    return pm_port_spec_write(&spec, arena);
}

static void try_part(pm_yaml root, pm_arena *arena) {
    pm_part part = {0};
    if (pm_part_spec_read(root, (pm_yaml){0}, arena, &part.spec) != PM_OK) {
        return;
    }
    const char *text = pm_part_spec_write(&part.spec, arena);
    check(strcmp(text, part_again(text, arena)) == 0);
    if (!is_small_potential(&part.spec.energy) || !is_small_potential(&part.spec.entropy) ||
        !is_small_operator(&part.spec.reversible) || !is_small_operator(&part.spec.irreversible) ||
        !are_small_images(&part.spec)) {
        return;
    }
    part.layout = layout;
    pm_graph *g = NULL;
    if (pm_part_declare(&part) == PM_OK && pm_graph_open(&g) == PM_OK) {
        const pm_node z = pm_input(g, true, 1, part.layout.nz);
        pm_node dE, dS, degeneracy = PM_NO_NODE;
        pm_gradient(g, pm_part_energy(g, &part, z), PM_NO_NODE, 1, &z, &dE);
        pm_gradient(g, pm_part_entropy(g, &part, z), PM_NO_NODE, 1, &z, &dS);
        const pm_node rate = pm_part_bulk(g, &part, z, dE, dS, &degeneracy);
        run(g, rate, degeneracy);
        const pm_node width = pm_input(g, true, 1, part.layout.nz);
        bool unconstrained[64];
        pm_node value, spread;
        check(part.layout.nz <= 64);
        if (pm_contact_bound_build(g, &part, z, width, unconstrained, &value, &spread)) {
            run(g, value, spread);
        }
    }
    pm_graph_close(g);
    pm_part_free(&part);
}

static void try_port(pm_yaml root, pm_arena *arena) {
    pm_port_model port = {0};
    if (pm_port_spec_read(root, (pm_yaml){0}, arena, &port.spec) != PM_OK) {
        return;
    }
    const char *text = pm_port_spec_write(&port.spec, arena);
    check(strcmp(text, port_again(text, arena)) == 0);
    if (!is_small_potential(&port.spec.energy) || !is_small_potential(&port.spec.entropy) ||
        !is_small_operator(&port.spec.reversible) || !is_small_operator(&port.spec.irreversible)) {
        return;
    }
    const int nz = layout.nz;
    port.layout[0] = port.layout[1] = layout;
    pm_graph *g = NULL;
    if (pm_port_declare(&port) == PM_OK && pm_graph_open(&g) == PM_OK) {
        pm_port_nodes end[2];
        for (int i = 0; i < 2; ++i) {
            end[i] = (pm_port_nodes){pm_input(g, true, 1, nz), pm_input(g, true, 1, nz),
                                     pm_input(g, true, 1, nz), PM_NO_NODE};
        }
        pm_node degeneracy = PM_NO_NODE;
        const pm_node rate = port.law->rate(g, &port, PM_END_A, end, &degeneracy);
        run(g, rate, degeneracy);
    }
    pm_graph_close(g);
    pm_port_free(&port);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    check(text != NULL);
    if (size > 0) {
        memcpy(text, data, size);
    }
    text[size] = '\0';
    pm_arena arena = {0};
    pm_yaml_document *document = NULL;
    pm_yaml root;
    if (pm_yaml_parse(&document, text, "fuzz.yaml", &root) == PM_OK) {
        try_part(root, &arena);
        try_port(root, &arena);
    }
    check(strchr(pm_error(), '\n') == NULL);
    pm_yaml_close(document);
    pm_arena_free(&arena);
    free(text);
    return 0;
}

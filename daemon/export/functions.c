// Builds the graphs of local_dynamics.c and port_instance.c for an explicit integrator, and of
// their derivatives, and writes each as a function unless an equal one is there.
#include "export/functions.h"

#include <stdlib.h>
#include <string.h>

#include "graph/source.h"
#include "model/prediction.h"

#define MOST_ARGUMENTS 6

struct pm_export_function {
    const char *name, *text; // text: all that follows the name
    pm_export_function *older;
};

// A function to write: its inputs and its results.
typedef struct blueprint {
    pm_graph *g;
    int nin, nout;
    pm_source_argument input[2 * MOST_ARGUMENTS], output[2];
} blueprint;

static void add_input(blueprint *b, const char *name, pm_node node, int size) {
    b->input[b->nin++] = (pm_source_argument){name, node, size};
}

static void add_output(blueprint *b, const char *name, pm_node node, int size) {
    // A result may be shared by all items of a batch, or a number for all columns.
    const pm_shape shape = {true, 1, size};
    b->output[b->nout++] = (pm_source_argument){
        name, node == PM_NO_NODE ? PM_NO_NODE : pm_broadcast_to(b->g, node, shape), size};
}

// Replaces each result y by its derivative along a direction of all inputs, sum_x dy/dx d_x.
// Reverse accumulation gives s -> s^T dy/dx for any s; it is linear in s, so that its own
// derivative by s along d_x is dy/dx d_x.
static pm_status take_tangent(blueprint *b, pm_arena *arena) {
    pm_source_argument value[MOST_ARGUMENTS];
    const int n = b->nin;
    memcpy(value, b->input, (size_t)n * sizeof *value);
    b->nin = 0;
    pm_node direction[MOST_ARGUMENTS];
    for (int i = 0; i < n; ++i) {
        const char *name = pm_arena_printf(arena, "d_%s", value[i].name);
        if (name == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for a source file");
        }
        direction[i] =
            value[i].node == PM_NO_NODE ? PM_NO_NODE : pm_input(b->g, true, 1, value[i].size);
        add_input(b, value[i].name, value[i].node, value[i].size);
        add_input(b, name, direction[i], value[i].size);
    }
    for (int k = 0; k < b->nout; ++k) {
        pm_node sum = PM_NO_NODE;
        for (int i = 0; i < n && b->output[k].node != PM_NO_NODE; ++i) {
            const pm_node seed = pm_input(b->g, true, 1, b->output[k].size);
            pm_node slope = PM_NO_NODE, along = PM_NO_NODE;
            if (value[i].node != PM_NO_NODE) {
                pm_gradient(b->g, b->output[k].node, seed, 1, &value[i].node, &slope);
            }
            if (slope != PM_NO_NODE) {
                pm_gradient(b->g, slope, direction[i], 1, &seed, &along);
            }
            sum = pm_add_or(b->g, sum, along);
        }
        b->output[k].node = sum;
    }
    return PM_OK;
}

// Writes the function under `name`, or finds an equal one; *used is the name of either.
static pm_status write(pm_export_functions *f, FILE *file, const blueprint *b, const char *name,
                       const char **used) {
    char *text = NULL;
    size_t size = 0;
    FILE *memory = open_memstream(&text, &size);
    if (memory == NULL || name == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    pm_status status = pm_source_write(memory, b->g, b->nin, b->input, b->nout, b->output);
    if (fclose(memory) != 0 && status == PM_OK) {
        status = pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    for (const pm_export_function *old = f->written; status == PM_OK && old != NULL;
         old = old->older) {
        if (strcmp(old->text, text) == 0) {
            *used = old->name;
            free(text);
            return PM_OK;
        }
    }
    if (status == PM_OK) {
        pm_export_function *function = pm_arena_alloc(f->arena, sizeof *function);
        const char *kept = pm_arena_strdup(f->arena, text);
        if (function == NULL || kept == NULL) {
            status = pm_fail(PM_ENOMEM, "out of memory for a source file");
        } else {
            *function = (pm_export_function){name, kept, f->written};
            f->written = function;
            fprintf(file, "\nstatic void %s%s", name, text);
            *used = name;
        }
    }
    free(text);
    return status;
}

// Writes a function and, with `tangent` not NULL, its tangent.
static pm_status write_both(pm_export_functions *f, FILE *file, blueprint *b, const char *owner,
                            const char *what, const char **name, const char **tangent) {
    PM_TRY(write(f, file, b, pm_arena_printf(f->arena, "%s_%s", owner, what), name));
    if (tangent == NULL) {
        return PM_OK;
    }
    PM_TRY(take_tangent(b, f->arena));
    return write(f, file, b, pm_arena_printf(f->arena, "%s_%s_tangent", owner, what), tangent);
}

// --- subsystems ---

static pm_status write_potentials(pm_export_functions *f, FILE *file, const pm_part *part,
                                  const char *owner, pm_export_part *names) {
    blueprint b = {0};
    PM_TRY(pm_graph_open(&b.g));
    const int nz = part->layout.nz;
    const pm_node z = pm_input(b.g, true, 1, nz);
    add_input(&b, "z", z, nz);
    add_output(&b, "E", pm_part_energy(b.g, part, z), 1);
    add_output(&b, "S", pm_part_entropy(b.g, part, z), 1);
    const pm_status status = write_both(f, file, &b, owner, "potentials", &names->potentials, NULL);
    pm_graph_close(b.g);
    return status;
}

static pm_status write_coenergies(pm_export_functions *f, FILE *file, const pm_part *part,
                                  const char *owner, pm_export_part *names, bool *has_dS) {
    blueprint b = {0};
    PM_TRY(pm_graph_open(&b.g));
    const int nz = part->layout.nz;
    const pm_node z = pm_input(b.g, true, 1, nz);
    pm_node dE, dS;
    pm_part_coenergies(b.g, part, PM_NO_NODE, z, &dE, &dS);
    *has_dS = dS != PM_NO_NODE;
    add_input(&b, "z", z, nz);
    add_output(&b, "dE", dE, nz);
    add_output(&b, "dS", dS, nz);
    const pm_status status = write_both(f, file, &b, owner, "coenergies", &names->coenergies,
                                        &names->coenergies_tangent);
    pm_graph_close(b.g);
    return status;
}

static pm_status write_bulk(pm_export_functions *f, FILE *file, const pm_part *part,
                            const char *owner, bool has_dS, pm_export_part *names) {
    blueprint b = {0};
    PM_TRY(pm_graph_open(&b.g));
    const int nz = part->layout.nz;
    const pm_node z = pm_input(b.g, true, 1, nz), dE = pm_input(b.g, true, 1, nz);
    const pm_node dS = has_dS ? pm_input(b.g, true, 1, nz) : PM_NO_NODE;
    pm_node degeneracy = PM_NO_NODE;
    const pm_node rate = pm_part_bulk(b.g, part, z, dE, dS, &degeneracy);
    pm_status status = PM_OK;
    if (rate != PM_NO_NODE) {
        add_input(&b, "z", z, nz);
        add_input(&b, "dE", dE, nz);
        add_input(&b, "dS", dS, nz);
        add_output(&b, "rate", rate, nz);
        status = write_both(f, file, &b, owner, "bulk", &names->bulk, &names->bulk_tangent);
    }
    pm_graph_close(b.g);
    return status;
}

static pm_status write_part(pm_export_functions *f, FILE *file, int id) {
    const pm_part *part = f->system->part[id];
    const char *owner = pm_arena_printf(f->arena, "part_%s", f->system->scene->subsystem[id].name);
    bool has_dS = false;
    PM_TRY(write_potentials(f, file, part, owner, &f->part[id]));
    PM_TRY(write_coenergies(f, file, part, owner, &f->part[id], &has_dS));
    return write_bulk(f, file, part, owner, has_dS, &f->part[id]);
}

// --- ports ---

static pm_status write_port(pm_export_functions *f, FILE *file, int id) {
    static const char *const names[2][3] = {{"y_a", "e_a", "eta_a"}, {"y_b", "e_b", "eta_b"}};
    const pm_port_model *model = f->system->port[id];
    blueprint b = {0};
    PM_TRY(pm_graph_open(&b.g));
    pm_port_nodes end[2];
    for (int i = 0; i < 2; ++i) {
        const int ny = model->layout[i].nz;
        const bool entropy = pm_system_end_has_entropy(f->system, id, i);
        end[i] = (pm_port_nodes){pm_input(b.g, true, 1, ny), pm_input(b.g, true, 1, ny),
                                 entropy ? pm_input(b.g, true, 1, ny) : PM_NO_NODE, PM_NO_NODE};
        add_input(&b, names[i][0], end[i].y, ny);
        add_input(&b, names[i][1], end[i].e, ny);
        add_input(&b, names[i][2], end[i].eta, ny);
    }
    pm_node rate[2], next, degeneracy = PM_NO_NODE;
    for (int i = 0; i < 2; ++i) {
        pm_port_nodes both[2] = {end[0], end[1]};
        rate[i] = pm_port_rate(b.g, model, (pm_end)i, both, PM_NO_NODE, &next, &degeneracy);
    }
    pm_status status = PM_OK;
    if (rate[0] != PM_NO_NODE || rate[1] != PM_NO_NODE) {
        add_output(&b, "rate_a", rate[0], model->layout[0].nz);
        add_output(&b, "rate_b", rate[1], model->layout[1].nz);
        const char *owner = pm_arena_printf(f->arena, "port_%s", f->system->scene->port[id].name);
        status = write_both(f, file, &b, owner, "law", &f->port[id].law, &f->port[id].law_tangent);
    }
    pm_graph_close(b.g);
    return status;
}

static pm_status with_name(pm_status status, const char *name) {
    return status == PM_ECONFIG ? pm_fail(status, "%s: %s", name, pm_error()) : status;
}

pm_status pm_export_functions_write(pm_export_functions *functions, FILE *file) {
    pm_export_functions *f = functions;
    const pm_scene *scene = f->system->scene;
    f->part = pm_arena_array(f->arena, (size_t)scene->nsubsystem, sizeof *f->part);
    f->port = pm_arena_array(f->arena, (size_t)scene->nport, sizeof *f->port);
    if (f->part == NULL || f->port == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY(with_name(write_part(f, file, i), scene->subsystem[i].name));
    }
    for (int i = 0; i < scene->nport; ++i) {
        PM_TRY(with_name(write_port(f, file, i), scene->port[i].name));
    }
    return PM_OK;
}

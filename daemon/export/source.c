// Writes the functions of all subsystems and ports and puts them together in the order of
// monolithic.c. The texts around them stand in the folder text.
//
// The functions are written from the same graph expressions that portmetd evaluates (model/part.h,
// model/port.h). Each that is not a potential has a second version, the tangent, that multiplies
// its Jacobian by a direction. Subsystems with the same model and weights share their functions.
#include "export/source.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/files.h"
#include "base/template.h"
#include "graph/source.h"
#include "library/names.h"
#include "model/prediction.h"
#include "model/training_range.h"

#define MOST_ARGUMENTS 6
// How every exported file begins.
#define EXPORTED "// SPDX-License-Identifier: MIT\n// The scene "

// The texts, which the build embeds as arrays of lines that end with NULL.
extern const char *const pm_export_source_text[];
extern const char *const pm_export_header_text[];

// The names of the functions of one subsystem. NULL: what the function computes is zero. With z,
// dE, dS and rate [nz]:
//     potentials(z, E, S)             E [1] in J, S [1] in J/K
//     coenergies(z, dE, dS)
//     bulk(z, dE, dS, rate)           L dE + M dS
//     release(z, inner, rate)         rates of the state from those of energy variables
// The arguments of a tangent are those of its function, except that each input is followed by its
// direction: "d_z" follows "z". The results are then the Jacobian times the direction.
typedef struct exported_part {
    const char *potentials, *coenergies, *coenergies_tangent, *bulk, *bulk_tangent;
    // Only of a state with co-energies. The dE and dS of others are the derivatives by the state.
    const char *potentials_tangent, *release, *release_tangent;
} exported_part;

// The names of the functions of one port: law(y_a, e_a, eta_a, y_b, e_b, eta_b, rate_a, rate_b),
// and its tangent. NULL: the port has no effect.
typedef struct exported_port {
    const char *law, *law_tangent;
    int first; // position of the port's rates, end a before end b
} exported_port;

typedef struct exported_function {
    const char *name, *text; // text: all that follows the name
    struct exported_function *older;
} exported_function;

typedef struct scene_writer {
    const pm_setup *setup;
    const pm_scene *scene;
    pm_arena arena;
    exported_function *written; // the newest one, which links to the older ones
    exported_part *part;        // [nsubsystem]
    exported_port *port;        // [nport]
    pm_scene_variables names;
    char *functions; // all functions, as text
    bool inner;      // the rates of some state differ from those of its energy variables
} scene_writer;

// --- functions ---

// A function to write: its inputs and its results.
typedef struct blueprint {
    pm_graph *g;
    int nin, nout;
    pm_source_argument input[2 * MOST_ARGUMENTS], output[2];
} blueprint;

static void add_input(blueprint *b, const char *name, pm_node node, int size) {
    b->input[b->nin++] = (pm_source_argument){name, node, size, 0};
}

static void add_output(blueprint *b, const char *name, pm_node node, int size) {
    // A result may be shared by all items of a batch, or a number for all columns.
    const pm_shape shape = {true, 1, size};
    b->output[b->nout++] = (pm_source_argument){
        name, node == PM_NO_NODE ? PM_NO_NODE : pm_broadcast_to(b->g, node, shape), size, 0};
}

// Replaces each result by its derivative along a direction of all inputs.
static void take_tangent(blueprint *b, pm_arena *arena) {
    pm_source_argument input[MOST_ARGUMENTS];
    pm_node value[MOST_ARGUMENTS], direction[MOST_ARGUMENTS];
    const int n = b->nin;
    memcpy(input, b->input, (size_t)n * sizeof *input);
    b->nin = 0;
    for (int i = 0; i < n; ++i) {
        value[i] = input[i].node;
        direction[i] = value[i] == PM_NO_NODE ? PM_NO_NODE : pm_input(b->g, true, 1, input[i].size);
        add_input(b, input[i].name, value[i], input[i].size);
        add_input(b, pm_arena_printf(arena, "d_%s", input[i].name), direction[i], input[i].size);
    }
    for (int k = 0; k < b->nout; ++k) {
        pm_node *node = &b->output[k].node;
        *node = *node == PM_NO_NODE ? PM_NO_NODE : pm_tangent(b->g, *node, n, value, direction);
    }
}

// Writes the function OWNER_WHAT, or finds an equal one; *used is the name of either.
static pm_status write_function(scene_writer *w, FILE *file, const blueprint *b, const char *owner,
                                const char *what, const char **used) {
    char *text = NULL;
    size_t size = 0;
    FILE *memory = open_memstream(&text, &size);
    pm_status status =
        memory == NULL ? pm_fail(PM_ENOMEM, "out of memory for a source file")
                       : pm_source_write(memory, b->g, NULL, b->nin, b->input, b->nout, b->output);
    if (memory != NULL && fclose(memory) != 0 && status == PM_OK) {
        status = pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    const exported_function *found = w->written;
    while (status == PM_OK && found != NULL && strcmp(found->text, text) != 0) {
        found = found->older;
    }
    if (status == PM_OK && found == NULL) {
        exported_function *function = pm_arena_alloc(&w->arena, sizeof *function);
        const char *name = pm_arena_printf(&w->arena, "%s_%s", owner, what);
        const char *kept = pm_arena_strdup(&w->arena, text);
        status = pm_arena_status(&w->arena, "a source file");
        if (status == PM_OK) {
            *function = (exported_function){name, kept, w->written};
            found = w->written = function;
            fprintf(file, "\nstatic void %s%s", name, text);
        }
    }
    if (status == PM_OK) {
        *used = found->name;
    }
    free(text);
    return status;
}

// Writes a function and its tangent.
static pm_status write_both(scene_writer *w, FILE *file, blueprint *b, const char *owner,
                            const char *what, const char **name, const char **tangent) {
    PM_TRY(write_function(w, file, b, owner, what, name));
    take_tangent(b, &w->arena);
    const char *of_tangent = pm_arena_printf(&w->arena, "%s_tangent", what);
    PM_TRY(pm_arena_status(&w->arena, "a source file"));
    return write_function(w, file, b, owner, of_tangent, tangent);
}

static pm_status write_part(scene_writer *w, FILE *file, int id) {
    const pm_part *part = w->setup->system->part[id];
    const int nz = part->layout.nz;
    const char *owner = pm_arena_printf(&w->arena, "part_%s", w->scene->physics.subsystem[id].name);
    blueprint b[4] = {0};
    pm_node z[4], dE, dS, degeneracy = PM_NO_NODE;
    pm_status status;
    for (int i = 0; i < 4; ++i) {
        PM_TRY_DONE(pm_graph_open(&b[i].g));
        z[i] = pm_input(b[i].g, true, 1, nz);
        add_input(&b[i], "z", z[i], nz);
    }
    add_output(&b[0], "E", pm_part_energy(b[0].g, part, z[0]), 1);
    add_output(&b[0], "S", pm_part_entropy(b[0].g, part, z[0]), 1);
    exported_part *names = &w->part[id];
    if (pm_part_has_coenergies(part)) {
        PM_TRY_DONE(write_both(w, file, &b[0], owner, "potentials", &names->potentials,
                               &names->potentials_tangent));
        const pm_node inner = pm_input(b[3].g, true, 1, nz);
        add_input(&b[3], "inner", inner, nz);
        const pm_node released = pm_part_release(b[3].g, part, z[3], inner);
        add_output(&b[3], "rate", released, nz);
        if (released != inner) {
            w->inner = true;
            PM_TRY_DONE(write_both(w, file, &b[3], owner, "release", &names->release,
                                   &names->release_tangent));
        }
    } else {
        PM_TRY_DONE(write_function(w, file, &b[0], owner, "potentials", &names->potentials));
    }
    pm_part_coenergies(b[1].g, part, PM_NO_NODE, z[1], &dE, &dS);
    add_output(&b[1], "dE", dE, nz);
    add_output(&b[1], "dS", dS, nz);
    PM_TRY_DONE(write_both(w, file, &b[1], owner, "coenergies", &names->coenergies,
                           &names->coenergies_tangent));
    const bool has_dS = dS != PM_NO_NODE;
    dE = pm_input(b[2].g, true, 1, nz);
    dS = has_dS ? pm_input(b[2].g, true, 1, nz) : PM_NO_NODE;
    const pm_node rate = pm_part_bulk(b[2].g, part, z[2], dE, dS, &degeneracy);
    if (rate != PM_NO_NODE) {
        add_input(&b[2], "dE", dE, nz);
        add_input(&b[2], "dS", dS, nz);
        add_output(&b[2], "rate", rate, nz);
        status = write_both(w, file, &b[2], owner, "bulk", &names->bulk, &names->bulk_tangent);
    }
done:
    for (int i = 0; i < 4; ++i) {
        pm_graph_close(b[i].g);
    }
    return status;
}

static pm_status write_port(scene_writer *w, FILE *file, int id) {
    static const char *const names[2][3] = {{"y_a", "e_a", "eta_a"}, {"y_b", "e_b", "eta_b"}};
    const pm_system *system = w->setup->system;
    const pm_port_model *model = system->port[id];
    blueprint b = {0};
    pm_port_nodes end[2];
    PM_TRY(pm_graph_open(&b.g));
    for (int i = 0; i < 2; ++i) {
        const int ny = model->layout[i].nz;
        const bool entropy = pm_system_end_has_entropy(system, id, i);
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
        const char *owner = pm_arena_printf(&w->arena, "port_%s", w->scene->physics.port[id].name);
        status = write_both(w, file, &b, owner, "law", &w->port[id].law, &w->port[id].law_tangent);
    }
    pm_graph_close(b.g);
    return status;
}

// Writes what all functions need, the sizes, and all functions to w->functions.
static pm_status write_functions(scene_writer *w) {
    const pm_physics *physics = &w->scene->physics;
    const char *owner = "";
    int rates = 0;
    for (int i = 0; i < physics->nport; ++i) {
        w->port[i].first = rates;
        rates += physics->port[i].layout[0].nz + physics->port[i].layout[1].nz;
    }
    size_t size = 0;
    FILE *file = open_memstream(&w->functions, &size);
    PM_TRY(pm_allocated(file, "a source file"));
    pm_source_prelude(file);
    int outside = 0; // numbers that leave: energy and entropy through each end
    for (int i = 0; i < 2 * physics->nport; ++i) {
        outside += physics->port[i / 2].boundary_input[i % 2] >= 0 ? 2 : 0;
    }
    fprintf(file, "\nenum { STATES = %d, SUBSYSTEMS = %d, PORT_RATES = %d, OUTSIDE = %d };\n",
            physics->nz, physics->nsubsystem, rates + 1, outside);
    pm_status status = PM_OK;
    for (int i = 0; i < physics->nsubsystem && status == PM_OK; ++i) {
        owner = physics->subsystem[i].name;
        status = write_part(w, file, i);
    }
    for (int i = 0; i < physics->nport && status == PM_OK; ++i) {
        owner = physics->port[i].name;
        status = write_port(w, file, i);
    }
    if (fclose(file) != 0 && status == PM_OK) {
        status = pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    return status == PM_ECONFIG ? pm_fail(status, "%s: %s", owner, pm_error()) : status;
}

// --- values of the texts ---

// A part of the source that has a second version, the tangent.
typedef struct section {
    const scene_writer *w;
    const char *d; // in front of the names of results: "", or "d_" for the tangent
} section;

static void write_text(FILE *file, const void *context) {
    fputs(context, file);
}

// Writes the arrays that one end of a port shows: numbers of z, dE and dS, or of the inputs u.
static void write_end(FILE *file, const scene_writer *w, const pm_scene_port *port, int end,
                      const char *d) {
    static const char *const names[] = {"y", "e", "eta"};
    static const char *const arrays[] = {"z", "dE", "dS"};
    const pm_physics *physics = &w->scene->physics;
    const int subsystem = port->subsystem[end];
    for (int k = 0; k < 3; ++k) {
        fprintf(file, "        const double %s%s_%c[] = {", d, names[k], 'a' + end);
        for (int c = 0; c < port->layout[end].nz; ++c) {
            const int at = port->component[end][c];
            const char *comma = c == 0 ? "" : ", ";
            if (subsystem >= 0) {
                fprintf(file, "%s%s%s[%d]", comma, d, arrays[k],
                        physics->subsystem[subsystem].first + at);
            } else {
                const pm_scene_boundary_input *b =
                    &physics->boundary_input[port->boundary_input[end]];
                fprintf(file, "%s%su[%d]", comma, d, b->first + k * b->layout.nz + at);
            }
        }
        fputs("};\n", file);
    }
}

// Writes the release of the rates of one subsystem, whose states begin at number i.
static void write_release_of(FILE *file, const exported_part *f, int i, int nz, bool tangent) {
    if (f->release == NULL) {
        return;
    }
    if (!tangent) {
        fprintf(file, "    memcpy(inner + %d, rate + %d, %d * sizeof *z);\n", i, i, nz);
        fprintf(file, "    %s(z + %d, inner + %d, rate + %d);\n", f->release, i, i, i);
        return;
    }
    fprintf(file, "    {\n        double d_inner[%d];\n", nz);
    fprintf(file, "        memcpy(d_inner, d_rate + %d, sizeof d_inner);\n", i);
    fprintf(file, "        %s(z + %d, d_z + %d, inner + %d, d_inner, d_rate + %d);\n    }\n",
            f->release_tangent, i, i, i, i);
}

// Writes the body of evaluate() or of its tangent.
static void write_rates(FILE *file, const void *context) {
    const section *s = context;
    const scene_writer *w = s->w;
    const pm_physics *physics = &w->scene->physics;
    const bool tangent = *s->d != '\0';
    for (int id = 0; id < physics->nsubsystem; ++id) {
        const exported_part *f = &w->part[id];
        const int i = physics->subsystem[id].first;
        if (tangent) {
            fprintf(file, "    %s(z + %d, d_z + %d, d_dE + %d, d_dS + %d);\n",
                    f->coenergies_tangent, i, i, i, i);
        } else {
            fprintf(file, "    %s(z + %d, dE + %d, dS + %d);\n", f->coenergies, i, i, i);
        }
        if (f->bulk == NULL) {
            fprintf(file, "    memset(%srate + %d, 0, %d * sizeof *z);\n", s->d, i,
                    physics->subsystem[id].layout.nz);
        } else if (tangent) {
            fprintf(file,
                    "    %s(z + %d, d_z + %d, dE + %d, d_dE + %d, dS + %d, d_dS + %d, d_rate + "
                    "%d);\n",
                    f->bulk_tangent, i, i, i, i, i, i, i);
        } else {
            fprintf(file, "    %s(z + %d, dE + %d, dS + %d, rate + %d);\n", f->bulk, i, i, i, i);
        }
    }
    for (int id = 0; id < physics->nport; ++id) {
        const pm_scene_port *port = &physics->port[id];
        const exported_port *f = &w->port[id];
        if (f->law == NULL) {
            continue;
        }
        fputs("    {\n", file);
        for (int end = 0; end < 2; ++end) {
            write_end(file, w, port, end, "");
            if (tangent) {
                write_end(file, w, port, end, s->d);
            }
        }
        if (tangent) {
            fprintf(file,
                    "        %s(y_a, d_y_a, e_a, d_e_a, eta_a, d_eta_a, y_b, d_y_b, e_b, d_e_b, "
                    "eta_b, d_eta_b,\n            ",
                    f->law_tangent);
        } else {
            fprintf(file, "        %s(y_a, e_a, eta_a, y_b, e_b, eta_b, ", f->law);
        }
        fprintf(file, "%sport + %d, %sport + %d);\n    }\n", s->d, f->first, s->d,
                f->first + port->layout[0].nz);
    }
    // The rates of all ports are added to those of each subsystem, in the order of ports.
    for (int id = 0; id < physics->nsubsystem; ++id) {
        for (int i = 0; i < physics->nport; ++i) {
            const pm_scene_port *port = &physics->port[i];
            int at = w->port[i].first;
            for (int end = 0; end < 2; at += port->layout[end].nz, ++end) {
                if (port->subsystem[end] != id || w->port[i].law == NULL) {
                    continue;
                }
                for (int c = 0; c < port->layout[end].nz; ++c) {
                    fprintf(file, "    %srate[%d] += %sport[%d];\n", s->d,
                            physics->subsystem[id].first + port->component[end][c], s->d, at + c);
                }
            }
        }
        write_release_of(file, &w->part[id], physics->subsystem[id].first,
                         physics->subsystem[id].layout.nz, tangent);
    }
}

// Writes the energies, entropies and fluxes, or their derivatives.
static void write_outputs(FILE *file, const void *context) {
    static const char *const co[] = {"dE", "dS"};
    const section *s = context;
    const scene_writer *w = s->w;
    const pm_physics *physics = &w->scene->physics;
    const bool tangent = *s->d != '\0';
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &physics->subsystem[i];
        if (tangent && w->part[i].potentials_tangent != NULL) {
            fprintf(file, "    %s(z + %d, d_z + %d, d_energy + %d, d_entropy + %d);\n",
                    w->part[i].potentials_tangent, subsystem->first, subsystem->first, i, i);
        } else if (tangent) { // the sums of dE d_z and dS d_z
            fprintf(file,
                    "    for (int i = %d; i < %d; ++i) {\n"
                    "        d_energy[%d] += dE[i] * d_z[i];\n"
                    "        d_entropy[%d] += dS[i] * d_z[i];\n    }\n",
                    subsystem->first, subsystem->first + subsystem->layout.nz, i, i);
        } else {
            fprintf(file, "    %s(z + %d, energy + %d, entropy + %d);\n", w->part[i].potentials,
                    subsystem->first, i, i);
        }
    }
    // The flux is the sum of e * rate at both ends of every port.
    for (int i = 0; i < physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i];
        int at = w->port[i].first;
        for (int end = 0; end < 2; at += port->layout[end].nz, ++end) {
            const bool inside = port->subsystem[end] >= 0;
            const int first = inside ? physics->subsystem[port->subsystem[end]].first
                                     : physics->boundary_input[port->boundary_input[end]].first;
            const int nz = pm_scene_end_layout(w->scene, port, end)->nz;
            for (int k = 0; k < 2; ++k) {
                fprintf(file, "    %sflux[%d] = 0.0", s->d, 4 * i + 2 * end + k);
                for (int c = 0; c < port->layout[end].nz && w->port[i].law != NULL; ++c) {
                    const char *array = inside ? co[k] : "u";
                    const int from = first + port->component[end][c] + (inside ? 0 : (k + 1) * nz);
                    if (tangent) {
                        fprintf(file, " + (d_%s[%d] * port[%d] + %s[%d] * d_port[%d])", array, from,
                                at + c, array, from, at + c);
                    } else {
                        fprintf(file, " + %s[%d] * port[%d]", array, from, at + c);
                    }
                }
                fputs(";\n", file);
            }
        }
    }
    // The rates that all ports give to the outside are summed up.
    for (int id = 0; id < physics->nboundary_input; ++id) {
        const pm_scene_boundary_input *b = &physics->boundary_input[id];
        fprintf(file, "    memset(%sreaction + %d, 0, %d * sizeof *z);\n", s->d, b->first / 3,
                b->layout.nz);
        for (int i = 0; i < physics->nport; ++i) {
            const pm_scene_port *port = &physics->port[i];
            int at = w->port[i].first;
            for (int end = 0; end < 2; at += port->layout[end].nz, ++end) {
                const bool here = port->boundary_input[end] == id && w->port[i].law != NULL;
                for (int c = 0; c < port->layout[end].nz && here; ++c) {
                    fprintf(file, "    %sreaction[%d] += %sport[%d];\n", s->d,
                            b->first / 3 + port->component[end][c], s->d, at + c);
                }
            }
        }
    }
}

// Writes the range of each group of each subsystem in training, and a row that ends the list.
static void write_ranges(FILE *file, const void *context) {
    const scene_writer *w = context;
    for (int i = 0; i < w->scene->physics.nsubsystem; ++i) {
        const pm_training_range range = pm_training_range_of(w->setup->system->part[i]);
        for (int g = 0; range.low != NULL && g < range.layout->ngroup; ++g) {
            fprintf(file, "    {%d, %d, ",
                    w->scene->physics.subsystem[i].first + range.layout->group[g].first,
                    range.layout->group[g].size);
            pm_source_number(file, range.low[g]);
            fputs(", ", file);
            pm_source_number(file, range.high[g]);
            fputs("},\n", file);
        }
    }
}

bool pm_export_input_range(const pm_setup *setup, int prescribed, double *low, double *high) {
    const pm_physics *physics = &setup->scene->physics;
    bool known = false;
    *low = -INFINITY;
    *high = INFINITY;
    for (int i = 0; i < 2 * physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i / 2];
        const pm_end end = i % 2 == 0 ? PM_END_A : PM_END_B;
        const int ny = port->layout[end].nz;
        for (int c = 0; c < 3 * ny; ++c) {
            double l, h;
            if (pm_physics_shown(physics, port, i % 2, c) == prescribed &&
                pm_input_range_of(setup->system->port[i / 2], end, c / ny, c % ny, &l, &h)) {
                *low = fmax(*low, l);
                *high = fmin(*high, h);
                known = true;
            }
        }
    }
    return known && *low < *high;
}

// Writes the range of each input that has one, and a row that ends the list.
static void write_input_ranges(FILE *file, const void *context) {
    const scene_writer *w = context;
    for (int i = 0; i < w->scene->physics.nprescribed; ++i) {
        double low, high;
        if (pm_export_input_range(w->setup, i, &low, &high)) {
            fprintf(file, "    {%d, 1, ", i);
            pm_source_number(file, low);
            fputs(", ", file);
            pm_source_number(file, high);
            fputs("},\n", file);
        }
    }
}

// Writes to = z + h sum_i weight_i k_i over the first n stages.
static void write_combination(FILE *file, int n, const double *weight, const char *to) {
    fprintf(file, "        for (int i = 0; i < STATES; ++i) {\n            %s[i] = z[i] + h * (0.0",
            to);
    for (int i = 0; i < n; ++i) {
        if (weight[i] != 0) {
            fputs(" + ", file);
            pm_source_number(file, weight[i]);
            fprintf(file, " * k[%d][i]", i);
        }
    }
    fputs(");\n        }\n", file);
}

static void write_substep(FILE *file, const void *context) {
    const scene_writer *w = context;
    const pm_physics *physics = &w->scene->physics;
    const pm_integrator *rk = physics->integrator;
    for (int stage = 0; stage < rk->nstage; ++stage) {
        double at = 0;
        for (int i = 0; i < stage; ++i) {
            at += rk->a[stage][i];
        }
        if (stage > 0) {
            write_combination(file, stage, rk->a[stage], "next");
        }
        fputs("        if (update != NULL) {\n            update(context, begin + h * (substep + ",
              file);
        pm_source_number(file, at);
        fprintf(file, "), %d);\n        }\n", stage);
        fprintf(file, "        evaluate(%s, s->u, dE, dS, k[%d], port%s);\n",
                stage == 0 ? "z" : "next", stage, w->inner ? ", inner" : "");
        // The stage adds to the fluxes into the outside, by the terms in the order of
        // sim/lanes.c.
        fputs("        weight = ", file);
        pm_source_number(file, rk->b[stage]);
        fputs(" / substeps;\n", file);
        int out = 0;
        for (int i = 0; i < physics->nport; ++i) {
            const pm_scene_port *port = &physics->port[i];
            for (int end = 0, from = w->port[i].first; end < 2;
                 from += port->layout[end].nz, ++end) {
                if (port->boundary_input[end] < 0) {
                    continue;
                }
                const pm_scene_boundary_input *b =
                    &physics->boundary_input[port->boundary_input[end]];
                for (int k = 1; k <= 2; ++k) {
                    fprintf(file, "    out[%d] += 0.0", out++);
                    for (int c = 0; c < port->layout[end].nz && w->port[i].law != NULL; ++c) {
                        fprintf(file, " + weight * (s->u[%d] * port[%d])",
                                b->first + k * b->layout.nz + port->component[end][c], from + c);
                    }
                    fputs(";\n", file);
                }
            }
        }
    }
    write_combination(file, rk->nstage, rk->b, "z");
}

typedef struct numbers {
    int count;
    const double *value;
} numbers;

static void write_numbers(FILE *file, const void *context) {
    const numbers *n = context;
    for (int i = 0; i < n->count; ++i) {
        fputs(i == 0 ? "" : ", ", file);
        pm_source_number(file, n->value[i]);
    }
}

static void write_list(FILE *file, const char *title, int count, const char *const *name,
                       const char *const *unit) {
    if (count > 0) {
        fprintf(file, "//\n// %s:\n", title);
    }
    for (int i = 0; i < count; ++i) {
        fprintf(file, "//   %3d  %s, %s\n", i, name[i], unit[i]);
    }
}

// Says in the header what each number means.
static void write_meanings(FILE *file, const void *context) {
    const scene_writer *w = context;
    const pm_physics *physics = &w->scene->physics;
    write_list(file, "z, the states", physics->nz, w->names.state.name, w->names.state.unit);
    write_list(file, "u, the inputs", physics->nprescribed, w->names.input.name,
               w->names.input.unit);
    write_list(file, "reaction, the rates that the ports give to the outside",
               physics->nprescribed / 3, w->names.reaction.name, w->names.reaction.unit);
    if (physics->nport > 0) {
        fputs("//\n// flux, four numbers for each port: energy in W and entropy in W/K into end a, "
              "then into end b:\n",
              file);
    }
    for (int i = 0; i < physics->nport; ++i) {
        fprintf(file, "//   %3d  %s: a is %s, b is %s\n", 4 * i, physics->port[i].name,
                pm_scene_end_name(w->scene, &physics->port[i], 0),
                pm_scene_end_name(w->scene, &physics->port[i], 1));
    }
}

// --- the files ---

// Writes one of the files into `folder`, under the scene's name and `suffix`.
static pm_status write_file(scene_writer *w, const char *folder, const char *suffix,
                            const char *const *text, int nvalue, const pm_template_value *value) {
    const char *path = pm_arena_printf(&w->arena, "%s/%s%s", folder, w->scene->name, suffix);
    PM_TRY(pm_arena_status(&w->arena, "a source file"));
    FILE *file = NULL;
    PM_TRY(pm_files_create(&file, path, EXPORTED));
    pm_template_write(file, text, INT_MAX, nvalue, value);
    const bool bad = ferror(file) != 0;
    if (fclose(file) != 0 || bad) {
        const int error = errno;
        remove(path);
        return pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(error));
    }
    return PM_OK;
}

static const char *number(scene_writer *w, int n) {
    return pm_arena_printf(&w->arena, "%d", n);
}

pm_status pm_export_c(const pm_setup *setup, const char *folder) {
    const pm_scene *scene = setup->scene;
    const pm_physics *physics = &scene->physics;
    if (pm_integrator_keeps_energy(physics->integrator)) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s cannot be exported: expected euler, heun, rk4 or rk6",
                       physics->integrator_at, physics->integrator->name);
    }
    if (pm_physics_is_adaptive(physics)) {
        return pm_fail(PM_ECONFIG,
                       "scene %s has a tolerance: an exported scene has a fixed number of substeps",
                       scene->name);
    }
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno));
    }
    scene_writer w = {.setup = setup, .scene = scene};
    pm_status status;
    const pm_integrator *rk = physics->integrator;
    const int ninput = physics->nprescribed;
    w.part = pm_arena_array(&w.arena, (size_t)physics->nsubsystem, sizeof *w.part);
    w.port = pm_arena_array(&w.arena, (size_t)physics->nport, sizeof *w.port);
    // One more number than there are inputs, since C has no empty arrays.
    double *input = pm_arena_array(&w.arena, (size_t)ninput + 1, sizeof *input);
    PM_TRY_DONE(pm_arena_status(&w.arena, "a source file"));
    PM_TRY_DONE(pm_scene_variable_names(&w.names, scene, &w.arena));
    PM_TRY_DONE(write_functions(&w));
    if (ninput > 0) {
        pm_boundary_input_at(&w.setup->boundary_input, 0, 0, input);
    }
    const double substep = physics->dt / physics->substeps;
    const section plain = {&w, ""}, tangent = {&w, "d_"};
    const numbers initial = {physics->nz, w.setup->initial}, first_input = {ninput + 1, input};
    const numbers h = {1, &substep}, dt = {1, &physics->dt};
    const pm_template_value value[] = {
        {"%NAME%", .text = scene->name},
        {"%VERSION%", .text = PM_VERSION},
        {"%STATES%", .text = number(&w, physics->nz)},
        {"%INPUTS%", .text = number(&w, ninput)},
        {"%INPUT_ROOM%", .text = number(&w, ninput > 0 ? ninput : 1)},
        {"%SUBSYSTEMS%", .text = number(&w, physics->nsubsystem)},
        {"%PORTS%", .text = number(&w, physics->nport)},
        {"%FLUX_ROOM%", .text = number(&w, physics->nport > 0 ? 4 * physics->nport : 1)},
        {"%REACTION_ROOM%", .text = number(&w, ninput > 0 ? ninput / 3 : 1)},
        {"%SUBSTEPS%", .text = number(&w, physics->substeps)},
        {"%METHOD%", .text = rk->name},
        {"%STEP%", .text = pm_arena_printf(&w.arena, "%.17g", physics->dt)},
        {"%STAGES%", .text = number(&w, rk->nstage)},
        {"%NEXT%", .text = rk->nstage > 1 ? "next[STATES], " : ""},
        {"%FIRST_INPUTS%", .text = number(&w, ninput + 1)},
        {"%FUNCTIONS%", .write = write_text, .context = w.functions},
        {"%RATES%", .write = write_rates, .context = &plain},
        {"%RATES_TANGENT%", .write = write_rates, .context = &tangent},
        {"%OUTPUTS%", .write = write_outputs, .context = &plain},
        {"%OUTPUTS_TANGENT%", .write = write_outputs, .context = &tangent},
        {"%SUBSTEP%", .write = write_substep, .context = &w},
        {"%RANGES%", .write = write_ranges, .context = &w},
        {"%INPUT_RANGES%", .write = write_input_ranges, .context = &w},
        {"%INNER_RESULT%", .text = w.inner ? ", double *inner" : ""},
        {"%INNER_ARGUMENT%", .text = w.inner ? ", const double *inner" : ""},
        {"%INNER_ROOM%", .text = w.inner ? "inner[STATES], " : ""},
        {"%INNER%", .text = w.inner ? ", inner" : ""},
        {"%INITIAL%", .write = write_numbers, .context = &initial},
        {"%FIRST_INPUT%", .write = write_numbers, .context = &first_input},
        {"%H%", .write = write_numbers, .context = &h},
        {"%DT%", .write = write_numbers, .context = &dt},
        {"%MEANINGS%", .write = write_meanings, .context = &w},
    };
    const int count = (int)(sizeof value / sizeof value[0]);
    PM_TRY_DONE(write_file(&w, folder, ".c", pm_export_source_text, count, value));
    status = write_file(&w, folder, ".h", pm_export_header_text, count, value);
done:
    free(w.functions);
    pm_arena_free(&w.arena);
    return status;
}

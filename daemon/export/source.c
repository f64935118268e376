// Puts the functions of all subsystems and ports together in the order of monolithic.c.
#include "export/source.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "export/functions.h"
#include "export/header.h"
#include "graph/source.h"

typedef struct scene_writer {
    FILE *file;
    const pm_setup *setup;
    const pm_scene *scene;
    pm_arena arena;
    pm_export_functions functions;
    const int *port_first; // [nport] position of a port's rates, end a before end b
} scene_writer;

pm_status pm_export_check(const pm_scene *scene) {
    const pm_integrator *rk = scene->integrator;
    if (rk->discrete || rk->multirate || rk->balanced) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s cannot be exported: expected euler, heun, rk4 or rk6",
                       scene->integrator_at, rk->name);
    }
    if (scene->tolerance > 0) {
        return pm_fail(PM_ECONFIG,
                       "scene %s has a tolerance: an exported scene has a fixed number of substeps",
                       scene->name);
    }
    return PM_OK;
}

// --- the rates of all subsystems ---

// Writes the arrays that one end of a port shows: numbers of z, dE and dS, or of the inputs u.
// `prefix` is "" or, for a direction, "d_".
static void write_end(scene_writer *w, const pm_scene_port *port, int end, const char *prefix) {
    static const char *const names[] = {"y", "e", "eta"};
    static const char *const arrays[] = {"z", "dE", "dS"};
    const int subsystem = port->subsystem[end];
    for (int k = 0; k < 3; ++k) {
        fprintf(w->file, "        const double %s%s_%c[] = {", prefix, names[k], 'a' + end);
        for (int c = 0; c < port->layout[end].nz; ++c) {
            const int at = port->component[end][c];
            const char *comma = c == 0 ? "" : ", ";
            if (subsystem >= 0) {
                fprintf(w->file, "%s%s%s[%d]", comma, prefix, arrays[k],
                        w->scene->subsystem[subsystem].first + at);
            } else {
                const pm_scene_boundary_input *b =
                    &w->scene->boundary_input[port->boundary_input[end]];
                fprintf(w->file, "%s%su[%d]", comma, prefix, b->first + k * b->layout.nz + at);
            }
        }
        fputs("};\n", w->file);
    }
}

static void write_law(scene_writer *w, int id, bool tangent) {
    const pm_scene_port *port = &w->scene->port[id];
    const pm_export_port *f = &w->functions.port[id];
    if (f->law == NULL) {
        return;
    }
    fputs("    {\n", w->file);
    for (int end = 0; end < 2; ++end) {
        write_end(w, port, end, "");
        if (tangent) {
            write_end(w, port, end, "d_");
        }
    }
    const int first = w->port_first[id], second = first + port->layout[0].nz;
    if (tangent) {
        fprintf(w->file,
                "        %s(y_a, d_y_a, e_a, d_e_a, eta_a, d_eta_a, y_b, d_y_b, e_b, d_e_b, eta_b, "
                "d_eta_b,\n            d_port + %d, d_port + %d);\n",
                f->law_tangent, first, second);
    } else {
        fprintf(w->file, "        %s(y_a, e_a, eta_a, y_b, e_b, eta_b, port + %d, port + %d);\n",
                f->law, first, second);
    }
    fputs("    }\n", w->file);
}

static void write_part(scene_writer *w, int id, bool tangent) {
    const pm_scene_subsystem *s = &w->scene->subsystem[id];
    const pm_export_part *f = &w->functions.part[id];
    const int i = s->first;
    if (tangent) {
        fprintf(w->file, "    %s(z + %d, d_z + %d, d_dE + %d, d_dS + %d);\n", f->coenergies_tangent,
                i, i, i, i);
    } else {
        fprintf(w->file, "    %s(z + %d, dE + %d, dS + %d);\n", f->coenergies, i, i, i);
    }
    if (f->bulk == NULL) {
        fprintf(w->file, "    memset(%s + %d, 0, %d * sizeof *z);\n", tangent ? "d_rate" : "rate",
                i, s->layout.nz);
    } else if (tangent) {
        fprintf(w->file,
                "    %s(z + %d, d_z + %d, dE + %d, d_dE + %d, dS + %d, d_dS + %d, d_rate + %d);\n",
                f->bulk_tangent, i, i, i, i, i, i, i);
    } else {
        fprintf(w->file, "    %s(z + %d, dE + %d, dS + %d, rate + %d);\n", f->bulk, i, i, i, i);
    }
}

// Adds the rates of all ports to those of a subsystem, in the order of ports.
static void write_sums(scene_writer *w, int id, const char *prefix) {
    for (int i = 0; i < w->scene->nport; ++i) {
        const pm_scene_port *port = &w->scene->port[i];
        int at = w->port_first[i];
        for (int end = 0; end < 2; at += port->layout[end].nz, ++end) {
            if (port->subsystem[end] != id || w->functions.port[i].law == NULL) {
                continue;
            }
            for (int c = 0; c < port->layout[end].nz; ++c) {
                fprintf(w->file, "    %srate[%d] += %sport[%d];\n", prefix,
                        w->scene->subsystem[id].first + port->component[end][c], prefix, at + c);
            }
        }
    }
}

static void write_rates(scene_writer *w, bool tangent) {
    if (tangent) {
        fputs("\n// The derivatives of all these along the direction d_z, d_u.\n"
              "static void evaluate_tangent(const double *z, const double *d_z, const double *u, "
              "const double *d_u,\n    const double *dE, const double *dS, double *d_dE, "
              "double *d_dS, double *d_rate, double *d_port) {\n    (void)u;\n    (void)d_u;\n    "
              "(void)d_port;\n",
              w->file);
    } else {
        fputs("\n// The co-energies, the rates of the state, and the rates through every end of a "
              "port.\nstatic void evaluate(const double *z, const double *u, double *dE, double "
              "*dS, double *rate,\n    double *port) {\n    (void)u;\n    (void)port;\n",
              w->file);
    }
    for (int i = 0; i < w->scene->nsubsystem; ++i) {
        write_part(w, i, tangent);
    }
    for (int i = 0; i < w->scene->nport; ++i) {
        write_law(w, i, tangent);
    }
    for (int i = 0; i < w->scene->nsubsystem; ++i) {
        write_sums(w, i, tangent ? "d_" : "");
    }
    fputs("}\n", w->file);
}

// --- stepping ---

// Writes to = z + h sum_i weight_i k_i over the first n stages.
static void write_combination(scene_writer *w, int n, const double *weight, const char *to) {
    fprintf(w->file, "        for (int i = 0; i < STATES; ++i) {\n            %s[i] = z[i] + ", to);
    fputs("h * (0.0", w->file);
    for (int i = 0; i < n; ++i) {
        if (weight[i] != 0) {
            fputs(" + ", w->file);
            pm_source_number(w->file, weight[i]);
            fprintf(w->file, " * k[%d][i]", i);
        }
    }
    fputs(");\n        }\n", w->file);
}

static void write_advance(scene_writer *w) {
    const pm_integrator *rk = w->scene->integrator;
    fprintf(w->file,
            "\nvoid %s_advance(%s *s, double h, int substeps) {\n    double *z = s->z;\n"
            "    double k[%d][STATES], %sdE[STATES], dS[STATES], port[PORT_RATES];\n"
            "    for (int substep = 0; substep < substeps; ++substep) {\n",
            w->scene->name, w->scene->name, rk->nstage, rk->nstage > 1 ? "next[STATES], " : "");
    for (int stage = 0; stage < rk->nstage; ++stage) {
        if (stage > 0) {
            write_combination(w, stage, rk->a[stage], "next");
        }
        fprintf(w->file, "        evaluate(%s, s->u, dE, dS, k[%d], port);\n",
                stage == 0 ? "z" : "next", stage);
    }
    write_combination(w, rk->nstage, rk->b, "z");
    fputs("    }\n    s->time += h * substeps;\n}\n", w->file);
}

static void write_step(scene_writer *w) {
    const pm_scene *scene = w->scene;
    write_advance(w);
    fprintf(w->file, "\nvoid %s_step(%s *s) {\n    %s_advance(s, ", scene->name, scene->name,
            scene->name);
    pm_source_number(w->file, scene->dt / scene->substeps);
    fprintf(w->file, ", %d);\n    ++s->step;\n    s->time = ", scene->substeps);
    pm_source_number(w->file, scene->dt);
    fputs(" * (double)s->step;\n}\n", w->file);
}

static void write_initial(scene_writer *w) {
    fputs("\nstatic const double initial[STATES] = {", w->file);
    for (int i = 0; i < w->scene->nz; ++i) {
        fputs(i == 0 ? "" : ", ", w->file);
        pm_source_number(w->file, w->setup->initial[i]);
    }
    fputs("};\n", w->file);
    const int n = w->scene->nprescribed;
    double *u = pm_arena_array(&w->arena, (size_t)n, sizeof *u);
    if (u != NULL && n > 0) {
        pm_boundary_input_at(&w->setup->boundary_input, 0, 0, u);
    }
    fprintf(w->file, "static const double first_input[%d] = {", n + 1);
    for (int i = 0; u != NULL && i < n; ++i) {
        pm_source_number(w->file, u[i]);
        fputs(", ", w->file);
    }
    fprintf(w->file,
            "0.0};\n\nvoid %s_init(%s *s) {\n    s->time = 0;\n    s->step = 0;\n"
            "    memcpy(s->z, initial, sizeof s->z);\n"
            "    memcpy(s->u, first_input, sizeof s->u);\n}\n",
            w->scene->name, w->scene->name);
}

// --- what it shows ---

static void write_potentials(scene_writer *w) {
    for (int i = 0; i < w->scene->nsubsystem; ++i) {
        fprintf(w->file, "    %s(z + %d, energy + %d, entropy + %d);\n",
                w->functions.part[i].potentials, w->scene->subsystem[i].first, i, i);
    }
}

// Writes flux[..] = sum e * rate for both ends of every port. With `tangent`, its derivative.
static void write_fluxes(scene_writer *w, bool tangent) {
    static const char *const co[] = {"dE", "dS"};
    for (int i = 0; i < w->scene->nport; ++i) {
        const pm_scene_port *port = &w->scene->port[i];
        int at = w->port_first[i];
        for (int end = 0; end < 2; at += port->layout[end].nz, ++end) {
            const int first = port->subsystem[end] >= 0
                                  ? w->scene->subsystem[port->subsystem[end]].first
                                  : w->scene->boundary_input[port->boundary_input[end]].first;
            const int nz = pm_scene_end_layout(w->scene, port, end)->nz;
            for (int k = 0; k < 2; ++k) {
                fprintf(w->file, "    %sflux[%d] = 0.0", tangent ? "d_" : "", 4 * i + 2 * end + k);
                for (int c = 0; c < port->layout[end].nz && w->functions.port[i].law != NULL; ++c) {
                    const bool inside = port->subsystem[end] >= 0;
                    const char *array = inside ? co[k] : "u";
                    const int from = first + port->component[end][c] + (inside ? 0 : (k + 1) * nz);
                    fprintf(w->file,
                            tangent ? " + (d_%s[%d] * port[%d] + %s[%d] * d_port[%d])"
                                    : " + %s[%d] * port[%d]",
                            array, from, at + c, array, from, at + c);
                }
                fputs(";\n", w->file);
            }
        }
    }
}

static void write_outputs(scene_writer *w) {
    const char *name = w->scene->name;
    fprintf(w->file,
            "\nvoid %s_rates(const double *z, const double *u, double *rate) {\n"
            "    double dE[STATES], dS[STATES], port[PORT_RATES];\n"
            "    evaluate(z, u, dE, dS, rate, port);\n}\n",
            name);
    fprintf(w->file,
            "\nvoid %s_outputs(const double *z, const double *u, double *energy, double *entropy,\n"
            "    double *flux) {\n"
            "    double dE[STATES], dS[STATES], rate[STATES], port[PORT_RATES];\n"
            "    (void)flux;\n    evaluate(z, u, dE, dS, rate, port);\n",
            name);
    write_potentials(w);
    write_fluxes(w, false);
    fputs("}\n", w->file);
}

// The sums of dE d_z and dS d_z are the derivatives of energy and entropy.
static void write_output_tangent(scene_writer *w) {
    fprintf(w->file,
            "\nvoid %s_tangent(const double *z, const double *d_z, const double *u, "
            "const double *d_u,\n    double *d_rate, double *d_energy, double *d_entropy, double "
            "*d_flux) {\n"
            "    double dE[STATES], dS[STATES], rate[STATES], port[PORT_RATES] = {0};\n"
            "    double d_dE[STATES], d_dS[STATES], d_port[PORT_RATES] = {0};\n"
            "    (void)d_flux;\n    evaluate(z, u, dE, dS, rate, port);\n"
            "    evaluate_tangent(z, d_z, u, d_u, dE, dS, d_dE, d_dS, d_rate, d_port);\n"
            "    memset(d_energy, 0, SUBSYSTEMS * sizeof *d_energy);\n"
            "    memset(d_entropy, 0, SUBSYSTEMS * sizeof *d_entropy);\n",
            w->scene->name);
    for (int i = 0; i < w->scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &w->scene->subsystem[i];
        fprintf(w->file,
                "    for (int i = %d; i < %d; ++i) {\n        d_energy[%d] += dE[i] * d_z[i];\n"
                "        d_entropy[%d] += dS[i] * d_z[i];\n    }\n",
                s->first, s->first + s->layout.nz, i, i);
    }
    write_fluxes(w, true);
    fputs("}\n", w->file);
}

// --- the files ---

static pm_status place_ports(scene_writer *w, int *count) {
    int *first = pm_arena_array(&w->arena, (size_t)w->scene->nport, sizeof *first);
    if (first == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a source file");
    }
    *count = 0;
    for (int i = 0; i < w->scene->nport; ++i) {
        first[i] = *count;
        *count += w->scene->port[i].layout[0].nz + w->scene->port[i].layout[1].nz;
    }
    w->port_first = first;
    return PM_OK;
}

static pm_status write_all(scene_writer *w) {
    int rates = 0;
    PM_TRY(pm_export_check(w->scene));
    PM_TRY(place_ports(w, &rates));
    fprintf(w->file,
            "// The scene %s, exported by portmetd %s. %s.h describes it.\n#include \"%s.h\"\n\n"
            "#include <math.h>\n\n#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#pragma clang "
            "diagnostic ignored \"-Wunused-function\"\n#endif\n\n",
            w->scene->name, PM_VERSION, w->scene->name, w->scene->name);
    pm_source_prelude(w->file);
    fprintf(w->file, "\nenum { STATES = %d, SUBSYSTEMS = %d, PORT_RATES = %d };\n", w->scene->nz,
            w->scene->nsubsystem, rates + 1);
    PM_TRY(pm_export_functions_write(&w->functions, w->file));
    write_rates(w, false);
    write_rates(w, true);
    write_initial(w);
    write_step(w);
    write_outputs(w);
    write_output_tangent(w);
    return PM_OK;
}

pm_status pm_export_source(FILE *file, const pm_setup *setup) {
    scene_writer w = {.file = file, .setup = setup, .scene = setup->scene};
    w.functions = (pm_export_functions){.system = setup->system, .arena = &w.arena};
    const pm_status status = write_all(&w);
    pm_arena_free(&w.arena);
    return status;
}

// Writes one of the files into `folder`, under the scene's name and `suffix`.
static pm_status write_file(const pm_setup *setup, const char *folder, const char *suffix,
                            pm_status (*write)(FILE *, const pm_setup *)) {
    pm_arena arena = {0};
    const char *path = pm_arena_printf(&arena, "%s/%s%s", folder, setup->scene->name, suffix);
    FILE *file = path == NULL ? NULL : fopen(path, "w");
    pm_status status;
    if (file == NULL) {
        status = path == NULL
                     ? pm_fail(PM_ENOMEM, "out of memory")
                     : pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
    } else {
        status = write(file, setup);
        const bool bad = ferror(file) != 0;
        if ((fclose(file) != 0 || bad) && status == PM_OK) {
            status = pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
        }
        if (status != PM_OK) {
            remove(path);
        }
    }
    pm_arena_free(&arena);
    return status;
}

pm_status pm_export_c(const pm_setup *setup, const char *folder) {
    PM_TRY(pm_export_check(setup->scene));
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno));
    }
    PM_TRY(write_file(setup, folder, ".c", pm_export_source));
    return write_file(setup, folder, ".h", pm_export_header);
}

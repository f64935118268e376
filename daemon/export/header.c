// Lists states, inputs, subsystems and ports with their names and units.
#include "export/header.h"

#include "library/names.h"

static void write_list(FILE *file, const char *title, int count, const char *const *name,
                       const char *const *unit) {
    if (count > 0) {
        fprintf(file, "//\n// %s:\n", title);
    }
    for (int i = 0; i < count; ++i) {
        fprintf(file, "//   %3d  %s, %s\n", i, name[i], unit[i]);
    }
}

static void write_ports(FILE *file, const pm_scene *scene) {
    if (scene->nport > 0) {
        fputs("//\n// flux, four numbers for each port: energy in W and entropy in W/K into end a, "
              "then into end b:\n",
              file);
    }
    for (int i = 0; i < scene->nport; ++i) {
        fprintf(file, "//   %3d  %s: a is %s, b is %s\n", 4 * i, scene->port[i].name,
                pm_scene_end_name(scene, &scene->port[i], 0),
                pm_scene_end_name(scene, &scene->port[i], 1));
    }
}

static void write_interface(FILE *file, const pm_scene *scene) {
    const char *name = scene->name;
    fprintf(file,
            "\nenum {\n    %s_states = %d,\n    %s_inputs = %d,\n    %s_subsystems = %d,\n"
            "    %s_ports = %d\n};\n",
            name, scene->nz, name, scene->nprescribed, name, scene->nsubsystem, name, scene->nport);
    fprintf(file,
            "\ntypedef struct %s {\n    double time; // s\n    long step;   // steps taken\n"
            "    double z[%d]; // states\n    double u[%d]; // inputs; the caller may write them "
            "between two steps\n} %s;\n",
            name, scene->nz, scene->nprescribed > 0 ? scene->nprescribed : 1, name);
    fprintf(
        file,
        "\n// Takes `substeps` steps of the integrator of h s each, for steps of another length. "
        "It does not\n// count them in `step`.\n"
        "void %s_advance(%s *s, double h, int substeps);\n",
        name, name);
    fprintf(file,
            "\n// Sets the initial state and the first values of the inputs.\n"
            "void %s_init(%s *s);\n"
            "\n// Takes a step of %.17g s: %s with %d substeps, and the inputs as they are.\n"
            "void %s_step(%s *s);\n",
            name, name, scene->dt, scene->integrator->name, scene->substeps, name, name);
    fprintf(
        file,
        "\n// Computes the rates of the states, in their units per second.\n"
        "void %s_rates(const double *z, const double *u, double *rate);\n"
        "\n// Computes the energy (J) and the entropy (J/K) of each subsystem and the flux through "
        "each end of\n// each port, positive into the subsystem.\n"
        "void %s_outputs(const double *z, const double *u, double *energy, double *entropy,\n"
        "    double *flux);\n",
        name, name);
    fprintf(
        file,
        "\n// Computes the derivatives of all these along the direction d_z, d_u.\n"
        "void %s_tangent(const double *z, const double *d_z, const double *u, const double *d_u,"
        "\n    double *d_rate, double *d_energy, double *d_entropy, double *d_flux);\n",
        name);
}

pm_status pm_export_header(FILE *file, const pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    pm_scene_variables names;
    pm_arena arena = {0};
    const pm_status status = pm_scene_variable_names(&names, scene, &arena);
    if (status == PM_OK) {
        fprintf(file,
                "// The scene %s in C99, exported by portmetd %s. It needs a compiler and libm, "
                "allocates nothing and\n// has no state but its structure. Its steps have the bits "
                "of `portmetd run --in-process`.\n",
                scene->name, PM_VERSION);
        write_list(file, "z, the states", scene->nz, names.name, names.unit);
        write_list(file, "u, the inputs", scene->nprescribed, names.input_name, names.input_unit);
        write_ports(file, scene);
        fprintf(file, "#ifndef PORTMET_%s_H\n#define PORTMET_%s_H\n", scene->name, scene->name);
        write_interface(file, scene);
        fputs("\n#endif\n", file);
    }
    pm_arena_free(&arena);
    return status;
}

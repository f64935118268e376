// portmet-train contact: finds where bodies face each other, writes the weights of the subsystems
// between them and a dataset of the assembly, and scores contact forces.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"
#include "bodies/modal/contact_force.h"
#include "bodies/modal/contact_part.h"
#include "bodies/solid/solid_data.h"
#include "scene/weights.h"
#include "sim/score.h"

// At which bodies without a basis dissipate, K.
#define ROOM 300

typedef struct contact_arguments {
    const char *configuration, *basis, *solid, *data, *modes, *weights, *trajectories, *output;
    pm_contact_constants constants;
} contact_arguments;

static pm_status save_part(const pm_body_assembly *assembly, const pm_contact_interface *m,
                           const contact_arguments *a, const char *command) {
    char coordinates[PM_BASIS_COORDINATES] = "";
    if (assembly->basis != NULL) {
        pm_basis_coordinates(assembly->basis, coordinates);
    }
    const pm_provenance provenance = {.command = command,
                                      .data = a->basis != NULL ? a->basis : a->data,
                                      .coordinates = coordinates[0] != 0 ? coordinates : NULL};
    pm_arena arena = {0};
    pm_part part = {0};
    pm_status status;
    const char *path = pm_contact_part_path(assembly, m, a->output, &arena);
    PM_TRY_DONE(pm_arena_status(&arena, "a path"));
    PM_TRY_DONE(pm_contact_part_make(assembly, m, &a->constants, &arena, &part));
    PM_TRY_DONE(pm_weights_save(path, pm_component_of_part(&part), &provenance));
    printf("wrote %s: %d contact pairs, %g m apart\n", path, m->pairs.npair, m->pairs.pair[0].gap);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    return status;
}

// Writes the mesh of a solid.
static pm_status save_mesh(const pm_body_assembly *assembly, int body, const char *folder) {
    const pm_assembled_solid *solid = &assembly->solid[body];
    pm_arena arena = {0};
    pm_solid_data data;
    pm_status status;
    const char *path = pm_arena_printf(&arena, "%s/%s.h5", folder, assembly->body[body].name);
    PM_TRY_DONE(pm_arena_status(&arena, "a path"));
    PM_TRY_DONE(pm_solid_data_open(&data, solid->field, &arena));
    data.mesh.ncontact = solid->ncontact;
    data.mesh.contact = solid->contact;
    PM_TRY_DONE(pm_solid_mesh_save(&data.mesh, path));
    printf("wrote %s: %d nodes, %d of them in contact, %d bricks\n", path, data.mesh.nnode,
           data.mesh.ncontact, data.mesh.nelement);
done:
    pm_arena_free(&arena);
    return status;
}

// Scores the contact forces of all interfaces, and prints the spread of their errors over the
// trajectories in which the bodies touch.
static pm_status score(const pm_body_assembly *assembly, const pm_field *const *field, int count,
                       const int *trajectory, const contact_arguments *a) {
    const char *weights = a->weights == NULL ? a->output : a->weights;
    pm_arena arena = {0};
    pm_dataset *modes = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_load(&modes, a->modes));
    PM_TRY_DONE(assembly->basis == NULL
                    ? PM_OK
                    : pm_basis_check(assembly->basis, pm_dataset_find_note(modes, "coordinates"),
                                     a->modes));
    if (count != modes->ntrajectory) {
        PM_TRY_DONE(pm_fail(PM_EUSAGE,
                            "trajectories: %d of modes, %d of the fields (--trajectories)",
                            modes->ntrajectory, count));
    }
    double *error = pm_arena_array(&arena, (size_t)count, sizeof *error);
    PM_TRY_DONE(pm_arena_status(&arena, "errors"));
    for (int i = 0; i < assembly->ninterface; ++i) {
        const pm_contact_interface *m = &assembly->interface[i];
        double stiffness = 0;
        int touching = 0;
        PM_TRY_DONE(pm_contact_part_stiffness(assembly, m, weights, &stiffness));
        PM_TRY_DONE(
            pm_contact_force_errors(assembly, m, modes, stiffness, field, trajectory, error));
        for (int k = 0; k < count; ++k) {
            if (!isnan(error[k])) {
                error[touching++] = error[k];
            }
        }
        printf("force %s on %s: ", assembly->body[m->body[0]].name,
               assembly->body[m->body[1]].name);
        if (touching == 0) {
            printf("they touch in none of %d trajector%s\n", count, count == 1 ? "y" : "ies");
            continue;
        }
        const pm_box b = pm_box_of(touching, error);
        printf("relative L2 error, %%, in %d of %d trajector%s: median %.3g, quartiles %.3g %.3g, "
               "mean %.3g\n",
               touching, count, count == 1 ? "y" : "ies", 100 * b.median, 100 * b.first_quartile,
               100 * b.third_quartile, 100 * b.mean);
    }
done:
    pm_dataset_free(modes);
    pm_arena_free(&arena);
    return status;
}

// Returns what follows the name and `mark` in `list`, "NAME,NAME" or "NAME=FILE,NAME=FILE", with
// the mark ',' or '='; NULL if the name is not there or the list is NULL.
static const char *find_name(const char *list, const char *name, char mark) {
    const size_t length = strlen(name);
    for (const char *at = list; at != NULL; at = strchr(at, ',')) {
        at += *at == ',';
        if (strncmp(at, name, length) == 0 &&
            (at[length] == mark || (mark == ',' && at[length] == 0))) {
            return at + length + (at[length] != 0);
        }
    }
    return NULL;
}

pm_status pm_command_contact(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    contact_arguments a;
    memset(&a, 0, sizeof a);
    const pm_option table[] = {
        {"--basis", "-b", "FILE", NULL, &a.basis, false,
         .help = "the basis that `reduce` made and all bodies in modes share"},
        {"--solid", NULL, "NAME,...", NULL, &a.solid, false,
         .help = "these bodies are solids on the meshes of their fields; needs --data"},
        {"--output", "-o", "DIR", NULL, &a.output, false,
         .help = "write the weights into DIR, and with --data also modes.h5"},
        {"--stiffness", "-k", "K", .positive = &a.constants.stiffness,
         .help = "N/m, stiffness of a contact pair (of the bodies' edges); required with -o"},
        {"--creep", "-c", "C", .positive = &a.constants.creep,
         .help = "m/(N s), > 0, rate at which a pressed pair creeps open (default: no creep)"},
        {"--data", "-d", "NAME=FILE,...", NULL, &a.data, false,
         .help = "the fields of every body (HDF5)"},
        {"--score", NULL, "MODES", NULL, &a.modes, false,
         .help = "print the errors of the contact forces in this recording; needs --data"},
        {"--weights", "-w", "DIR", NULL, &a.weights, false,
         .help = "the weights that the recording was made with (default: those in the -o folder)"},
        {"--trajectories", NULL, "LIST", NULL, &a.trajectories, false,
         .help = "use only these trajectories of the fields, such as 0:4,7,9:"},
    };
    const pm_options options = {
        .usage = "portmet-train contact CONFIG {-o DIR -k K | --score MODES} [options]",
        .summary =
            "Places bodies as `beams` under `system` of CONFIG says, and finds which of them face\n"
            "each other. For any two of these, A and B, it writes the weights A_B.h5 of the\n"
            "subsystem between them. The groups A and B of this subsystem are the travel of both\n"
            "bodies, mode by mode, or node by node of a solid. Ports of the law contact join them\n"
            "to the momenta of the bodies: the group p of a body in modes, the group `contact` of\n"
            "a solid. For a solid A it also writes the mesh A.h5, which names the nodes of\n"
            "`contact`. The group `creep` is the opening that each contact pair has gained by\n"
            "creeping. The opening of a pair is\n"
            "g + creep + u slope_u + v slope_v, where g, u, v and the slopes are derived "
            "variables,\n"
            "linear in the travel. Sliding is assumed to be small.",
        .examples = "portmet-train contact configs/truth/crossed_beams.yaml --basis "
                    "configs/weights/beam/basis.h5 --stiffness 1e6 -o contact",
        .positional_name = "CONFIG",
        .positional = &a.configuration,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    // The options must ask for at least one result, and give all inputs for it.
    if (a.output == NULL && a.modes == NULL) {
        return pm_fail(PM_EUSAGE, "contact: nothing to do: give --output or --score");
    }
    if (a.modes != NULL && a.data == NULL) {
        return pm_fail(PM_EUSAGE, "contact: --score needs --data");
    }
    if (a.output == NULL && (a.constants.stiffness > 0 || a.constants.creep > 0)) {
        return pm_fail(PM_EUSAGE, "contact: --stiffness and --creep are constants of weights that "
                                  "are written, and need --output");
    }
    if (a.solid != NULL && (a.data == NULL || a.constants.creep > 0)) {
        return pm_fail(PM_EUSAGE, "contact: --solid needs --data, and no --creep: solids creep");
    }
    if (a.output == NULL && a.weights == NULL) {
        return pm_fail(PM_EUSAGE, "contact: --score needs the --weights of the recording");
    }
    if (a.output != NULL && a.constants.stiffness == 0) {
        return pm_fail(PM_EUSAGE, "contact: --output needs --stiffness");
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_basis *basis = NULL;
    pm_body_assembly assembly = {0};
    pm_field **field = NULL;
    pm_dataset *modes = NULL;
    int count = 0, *trajectory = NULL;
    pm_status status;
    PM_TRY_DONE(a.basis == NULL ? PM_OK : pm_basis_load(&basis, a.basis));
    assembly.basis = basis;
    a.constants.temperature = basis == NULL ? ROOM : basis->temperature;
    PM_TRY_DONE(pm_body_assembly_read(&assembly, a.configuration));
    field = pm_arena_array(&assembly.arena, (size_t)assembly.nbody, sizeof *field);
    PM_TRY_DONE(pm_arena_status(&assembly.arena, "fields"));
    const pm_field *const *fields = (const pm_field *const *)field;
    for (int i = 0; i < assembly.nbody && a.data != NULL; ++i) {
        const char *name = assembly.body[i].name, *file = find_name(a.data, name, '=');
        if (file == NULL) {
            PM_TRY_DONE(pm_fail(PM_EUSAGE, "--data: expected %s=FILE in \"%s\"", name, a.data));
        }
        const char *path = pm_arena_printf(&assembly.arena, "%.*s", (int)strcspn(file, ","), file);
        PM_TRY_DONE(pm_arena_status(&assembly.arena, "a path"));
        PM_TRY_DONE(pm_field_load(&field[i], path));
    }
    if (a.data != NULL) {
        PM_TRY_DONE(pm_trajectories_list(a.trajectories, field[0]->ntrajectory, &assembly.arena,
                                         &trajectory, &count));
    }
    for (int i = 0; i < assembly.nbody; ++i) {
        const char *name = assembly.body[i].name;
        if (find_name(a.solid, name, ',') != NULL) {
            PM_TRY_DONE(pm_body_assembly_make_solid(&assembly, i, field[i]));
        } else if (basis == NULL) {
            PM_TRY_DONE(pm_fail(PM_EUSAGE,
                                "contact: %s is neither in modes (--basis) nor a solid (--solid)",
                                name));
        }
    }
    PM_TRY_DONE(pm_body_assembly_find_interfaces(&assembly));
    PM_TRY_DONE(a.data == NULL ? PM_OK : pm_body_assembly_check(&assembly, fields));
    PM_TRY_DONE(a.output == NULL ? PM_OK : pm_options_folder(a.output));
    for (int i = 0; i < assembly.ninterface && a.output != NULL; ++i) {
        PM_TRY_DONE(save_part(&assembly, &assembly.interface[i], &a, command));
    }
    for (int i = 0; i < assembly.nbody && a.output != NULL; ++i) {
        PM_TRY_DONE(pm_body_assembly_is_solid(&assembly, i) ? save_mesh(&assembly, i, a.output)
                                                            : PM_OK);
    }
    if (a.output != NULL && a.data != NULL) {
        PM_TRY_DONE(pm_body_assembly_project(&modes, &assembly, fields, count, trajectory,
                                             a.constants.temperature));
        PM_TRY_DONE(pm_modes_save(modes, basis, a.data, "contact", command, a.output));
    }
    status = a.modes == NULL ? PM_OK : score(&assembly, fields, count, trajectory, &a);
done:
    pm_dataset_free(modes);
    for (int i = 0; i < assembly.nbody && field != NULL; ++i) {
        pm_field_free(field[i]);
    }
    pm_arena_free(&assembly.arena);
    pm_basis_free(basis);
    return status;
}

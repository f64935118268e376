// portmet-train contact: where bodies face each other, as weights of ports and columns of a
// dataset.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "command/commands.h"
#include "command/options.h"
#include "modal/body_assembly.h"
#include "modal/save_modes.h"
#include "scene/weights.h"
#include "sim/score.h"

typedef struct arguments {
    const char *configuration, *basis, *data, *modes, *stiffness, *creep, *trajectories, *output;
    pm_gap_constants gap;
} arguments;

static pm_status read_arguments(arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--basis", "-b", "FILE", NULL, &a->basis, true, "the bodies' basis, made by `reduce`"},
        {"--data", "-d", "NAME=FILE,...", NULL, &a->data, false,
         "fields of every body; write modes.h5, a dataset of the assembly"},
        {"--output", "-o", "DIR", NULL, &a->output, false, "write into DIR"},
        {"--score", NULL, "MODES", NULL, &a->modes, false,
         "print how far off forces of contact are in this recording (needs --data)"},
        {"--stiffness", "-k", "K", NULL, &a->stiffness, true,
         "N/m, of a pair of points: of the bodies' edges, which their modes do not have"},
        {"--creep", "-c", "C", NULL, &a->creep, false,
         "m/(N s), by which a pair of points opens while it is pressed (> 0); without, it does "
         "not"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these of the fields, such as 0:4,7,9:; for --score the recording's"},
    };
    const pm_options options = {
        .usage = "portmet-train contact CONFIG --basis FILE [options]",
        .summary =
            "Finds where bodies with the same basis, placed as CONFIG says under system: beams:,\n"
            "face each other, and writes for each two of them A and B the weights A_B.h5 of the\n"
            "subsystem that lies between: its groups A and B say how far either has travelled,\n"
            "mode by mode (ports of the law contact join them to the bodies' p), `creep` what "
            "each\n"
            "pair of facing points has crept; they are open by g + creep + u slope_u + v slope_v,\n"
            "images of the travel. Sliding is taken to be small.",
        .positional_name = "CONFIG",
        .positional = &a->configuration,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

// That there is something to do, and what it needs.
static pm_status check_arguments(arguments *a) {
    if (a->output == NULL && a->modes == NULL) {
        return pm_fail(PM_EUSAGE, "contact: nothing to do: give -o or --score");
    }
    if (a->modes != NULL && a->data == NULL) {
        return pm_fail(PM_EUSAGE, "--score needs --data");
    }
    PM_TRY(pm_options_positive("--stiffness", a->stiffness, &a->gap.stiffness));
    return a->creep == NULL ? PM_OK : pm_options_positive("--creep", a->creep, &a->gap.creep);
}

// --- weights ---

static pm_status save_gap(const pm_body_assembly *assembly, const pm_contact_interface *m,
                          const arguments *a, const char *command) {
    char coordinates[PM_BASIS_COORDINATES];
    pm_basis_coordinates(assembly->basis, coordinates);
    const pm_provenance provenance = {
        .command = command, .data = a->basis, .coordinates = coordinates};
    pm_arena arena = {0};
    pm_part part = {0};
    pm_status status;
    const char *path =
        pm_arena_printf(&arena, "%s/%s_%s.h5", a->output, assembly->body[m->body[0]].name,
                        assembly->body[m->body[1]].name);
    if (path == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a path");
        goto done;
    }
    PM_TRY_DONE(pm_contact_interface_part(assembly, m, &a->gap, &arena, &part));
    PM_TRY_DONE(pm_weights_save_part(path, &part, &provenance));
    printf("wrote %s: %d pairs of points, %g m apart\n", path, m->facing.npair,
           m->facing.pair[0].gap);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    return status;
}

// --- dataset ---

// The file of a body in "NAME=FILE,NAME=FILE".
static pm_status find_file(const char *list, const char *name, pm_arena *arena, const char **path) {
    const size_t length = strlen(name);
    for (const char *at = list; at != NULL; at = strchr(at, ',')) {
        at += *at == ',';
        if (strncmp(at, name, length) == 0 && at[length] == '=') {
            const char *const file = at + length + 1;
            *path = pm_arena_printf(arena, "%.*s", (int)strcspn(file, ","), file);
            return *path == NULL ? pm_fail(PM_ENOMEM, "out of memory for a path") : PM_OK;
        }
    }
    return pm_fail(PM_EUSAGE, "--data: expected %s=FILE in \"%s\"", name, list);
}

// Trajectories of the fields.
typedef struct chosen {
    int count, *trajectory;
} chosen;

// The fields of all bodies, field [nbody], and which of their trajectories are wanted; also on
// failure the caller frees what fields there are.
static pm_status load_fields(pm_body_assembly *assembly, const arguments *a, pm_field **field,
                             chosen *c) {
    for (int i = 0; i < assembly->nbody; ++i) {
        const char *path;
        PM_TRY(find_file(a->data, assembly->body[i].name, &assembly->arena, &path));
        PM_TRY(pm_field_load(&field[i], path));
    }
    PM_TRY(pm_body_assembly_check(assembly, (const pm_field *const *)field));
    c->trajectory =
        pm_arena_array(&assembly->arena, (size_t)field[0]->ntrajectory, sizeof *c->trajectory);
    if (c->trajectory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
    }
    return pm_options_list(a->trajectories, field[0]->ntrajectory, c->trajectory, &c->count);
}

static pm_status save_dataset(const pm_body_assembly *assembly, const pm_field *const *field,
                              const chosen *c, const arguments *a, const char *command) {
    pm_dataset *modes = NULL;
    PM_TRY(pm_body_assembly_project(&modes, assembly, field, c->count, c->trajectory));
    const pm_status status =
        pm_modes_save(modes, assembly->basis, a->data, "contact", command, a->output);
    pm_dataset_free(modes);
    return status;
}

static pm_status save_all(const pm_body_assembly *assembly, const pm_field *const *field,
                          const chosen *c, const arguments *a, const char *command) {
    PM_TRY(pm_options_folder(a->output));
    for (int i = 0; i < assembly->ncontact; ++i) {
        PM_TRY(save_gap(assembly, &assembly->meeting[i], a, command));
    }
    return a->data == NULL ? PM_OK : save_dataset(assembly, field, c, a, command);
}

// --- scores ---

static void print_errors(const pm_body_assembly *assembly, const pm_contact_interface *m, int count,
                         double *error) {
    int touching = 0;
    for (int i = 0; i < count; ++i) {
        if (!isnan(error[i])) {
            error[touching++] = error[i];
        }
    }
    printf("force %s on %s: ", assembly->body[m->body[0]].name, assembly->body[m->body[1]].name);
    if (touching == 0) {
        printf("they touch in none of %d trajectories\n", count);
        return;
    }
    const pm_box b = pm_box_of(touching, error);
    printf("relative L2 error, %%, in %d of %d trajectories: median %.3g, quartiles %.3g %.3g, "
           "mean %.3g\n",
           touching, count, 100 * b.median, 100 * b.first_quartile, 100 * b.third_quartile,
           100 * b.mean);
}

static pm_status score(const pm_body_assembly *assembly, const pm_field *const *field,
                       const chosen *c, const char *path, double stiffness) {
    pm_dataset *modes = NULL;
    double *error = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_load(&modes, path));
    PM_TRY_DONE(pm_basis_check(assembly->basis, pm_dataset_find_note(modes, "coordinates"), path));
    if (c->count != modes->ntrajectory) {
        status = pm_fail(PM_EUSAGE, "%d trajectories of modes, %d of the fields (--trajectories)",
                         modes->ntrajectory, c->count);
        goto done;
    }
    error = calloc((size_t)modes->ntrajectory, sizeof *error);
    if (error == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for errors");
        goto done;
    }
    for (int i = 0; i < assembly->ncontact; ++i) {
        PM_TRY_DONE(pm_contact_interface_force_errors(assembly, &assembly->meeting[i], modes,
                                                      stiffness, field, c->trajectory, error));
        print_errors(assembly, &assembly->meeting[i], c->count, error);
    }
done:
    free(error);
    pm_dataset_free(modes);
    return status;
}

// --- all of it ---

pm_status pm_command_contact(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    PM_TRY(check_arguments(&a));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_basis *basis = NULL;
    pm_body_assembly assembly = {0};
    pm_field **field = NULL;
    chosen c = {0};
    pm_status status;
    PM_TRY_DONE(pm_basis_load(&basis, a.basis));
    assembly.basis = basis;
    PM_TRY_DONE(pm_body_assembly_load(&assembly, a.configuration));
    field = pm_arena_array(&assembly.arena, (size_t)assembly.nbody, sizeof *field);
    if (field == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for fields");
        goto done;
    }
    PM_TRY_DONE(a.data == NULL ? PM_OK : load_fields(&assembly, &a, field, &c));
    const pm_field *const *fields = (const pm_field *const *)field;
    PM_TRY_DONE(a.output == NULL ? PM_OK : save_all(&assembly, fields, &c, &a, command));
    status = a.modes == NULL ? PM_OK : score(&assembly, fields, &c, a.modes, a.gap.stiffness);
done:
    for (int i = 0; i < assembly.nbody && field != NULL; ++i) {
        pm_field_free(field[i]);
    }
    pm_arena_free(&assembly.arena);
    pm_basis_free(basis);
    return status;
}

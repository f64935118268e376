// portmet-train correct: corrects the fields of a simulation by better known fields.
#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"
#include "bodies/solid/correction.h"

typedef struct correct_arguments {
    const char *fields, *known, *trajectories, *output;
} correct_arguments;

pm_status pm_command_correct(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    correct_arguments a = {0};
    bool helped = false;
    const pm_option table[] = {
        {"--by", NULL, "FILE", NULL, &a.known, true, "better known fields of the same body"},
        {"--trajectories", NULL, "LIST", NULL, &a.trajectories, false,
         "use only these of the known trajectories, such as 0,3,6:9"},
        {"--output", "-o", "FILE", NULL, &a.output, true, "write the corrected fields (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train correct FIELDS --by FILE -o FILE [options]",
        .summary =
            "Adds to the fields of a simulation their discrepancy from better known fields under\n"
            "the same loads. For a load between two known ones that differ in x alone, the\n"
            "discrepancy is interpolated. The result has the node numbers of the known fields.",
        .positional_name = "FIELDS",
        .positional = &a.fields,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, &helped));
    PM_TRY(pm_options_output("--output", a.output));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_field *own = NULL, *known = NULL, *corrected = NULL;
    pm_arena arena = {0};
    int count = 0, *which = NULL;
    pm_status status;
    PM_TRY_DONE(pm_field_load(&own, a.fields));
    PM_TRY_DONE(pm_field_load(&known, a.known));
    PM_TRY_DONE(pm_trajectories_list(a.trajectories, known->ntrajectory, &arena, &which, &count));
    PM_TRY_DONE(pm_correct(&corrected, own, known, count, which));
    status = pm_fields_save(corrected, a.output,
                            "Fields of a simulation, corrected by better known ones",
                            "portmet-train correct", command);
done:
    pm_arena_free(&arena);
    pm_field_free(own);
    pm_field_free(known);
    pm_field_free(corrected);
    return status;
}

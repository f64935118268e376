// portmet-train correct: corrects the fields of a simulation by better known fields.
#include "base/options.h"
#include "base/python.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"

pm_status pm_command_correct(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    const char *fields = NULL, *better = NULL, *trajectories = NULL, *output = NULL;
    const pm_option table[] = {
        {"--by", NULL, "FILE", NULL, &better, true, .help = "better known fields of the same body"},
        {"--trajectories", NULL, "LIST", NULL, &trajectories, false,
         .help = "use only these of the known trajectories, such as 0,3,6:9"},
        {"--output", "-o", "FILE", NULL, &output, true, .help = "write the corrected fields (HDF5)",
         .is_output = true},
    };
    const pm_options options = {
        .usage = "portmet-train correct FIELDS --by FILE -o FILE [options]",
        .summary =
            "Adds to the fields of a simulation their discrepancy from better known fields under\n"
            "the same loads. For a load between two known ones that differ in x alone, the\n"
            "discrepancy is interpolated. The result has the node numbers of the known fields.",
        .examples = "portmet-train correct simulated.h5 --by known.h5 -o corrected.h5",
        .positional_name = "FIELDS",
        .positional = &fields,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    // The fields are checked here, and corrected by the Python package.
    pm_field *own = NULL, *known = NULL;
    pm_arena arena = {0};
    int count = 0, *which = NULL;
    const char *list = "";
    pm_status status;
    PM_TRY_DONE(pm_field_load(&own, fields));
    PM_TRY_DONE(pm_field_load(&known, better));
    PM_TRY_DONE(pm_trajectories_list(trajectories, known->ntrajectory, &arena, &which, &count));
    PM_TRY_DONE(pm_fields_check(output));
    for (int i = 0; i < count && list != NULL; ++i) {
        list = pm_arena_printf(&arena, "%s%s%d", list, i > 0 ? "," : "", which[i]);
    }
    PM_TRY_DONE(pm_arena_status(&arena, "a list of trajectories"));
    const char *const argument[] = {"correct", output, command, list, fields, better, NULL};
    status = pm_python_run(&pm_python_pictures, argument, false);
done:
    pm_arena_free(&arena);
    pm_field_free(own);
    pm_field_free(known);
    return status;
}

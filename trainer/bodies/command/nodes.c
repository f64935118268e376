// portmet-train nodes: writes fields of a body as trajectories of nodal values.
#include <inttypes.h>
#include <stdio.h>

#include "base/files.h"
#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/solid/solid_nodes.h"

pm_status pm_command_nodes(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    const char *fields = NULL, *mesh = NULL, *trajectories = NULL, *output = NULL;
    double temperature = PM_DEFAULT_TEMPERATURE;
    int64_t nstate = 0; // 0: all
    const pm_option table[] = {
        {"--mesh", NULL, "FILE", NULL, &mesh, true, .help = "mesh to write (HDF5)",
         .is_output = true, .kind = PM_FILES_HDF5},
        {"--temperature", NULL, "T", .positive = &temperature,
         .help = "K, at which dissipated energy becomes entropy (default: 300)"},
        {"--states", NULL, "N", .count = &nstate, .least = 1, .most = INT32_MAX,
         .help = "write only the first N states of each trajectory"},
        {"--trajectories", NULL, "LIST", NULL, &trajectories, false,
         .help = "only these, such as 0:40 (not including 40), 0,3,6:9, or 40: (to the last)"},
        {"--output", "-o", "FILE", NULL, &output, true, .help = "dataset to write (HDF5)",
         .is_output = true, .kind = PM_FILES_HDF5},
    };
    const pm_options options = {
        .usage = "portmet-train nodes FIELDS --mesh FILE -o FILE [options]",
        .summary = "Writes the fields of a body as trajectories of the values at its nodes,\n"
                   "a dataset for `evaluate`, and the mesh, which a scene with a solid names.\n"
                   "`reconstruct` turns nodal values into fields again.",
        .examples = "portmet-train nodes fields.h5 --mesh mesh.h5 -o nodes.h5",
        .positional_name = "FIELDS",
        .positional = &fields,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_arena arena = {0};
    pm_field *field = NULL;
    pm_dataset *nodes = NULL;
    pm_solid_data data;
    pm_status status;
    PM_TRY_DONE(pm_field_load(&field, fields));
    nstate = nstate == 0 ? field->ntime : nstate;
    if (nstate > field->ntime) {
        PM_TRY_DONE(pm_fail(PM_EUSAGE, "--states: expected a whole number up to %d, found %" PRId64,
                            field->ntime, nstate));
    }
    PM_TRY_DONE(pm_solid_data_open(&data, field, &arena));
    PM_TRY_DONE(pm_options_list(trajectories, field->ntrajectory, data.trajectory, &data.count));
    PM_TRY_DONE(pm_solid_mesh_save(&data.mesh, mesh));
    printf("wrote %s: %d nodes, %d bricks\n", mesh, data.mesh.nnode, data.mesh.nelement);
    PM_TRY_DONE(pm_solid_nodes_dataset(&nodes, &data, (int)nstate, temperature));
    PM_TRY_DONE(pm_dataset_note(nodes, "title", "Nodal values of %s", fields));
    PM_TRY_DONE(pm_dataset_note(nodes, "source", "portmet-train nodes"));
    PM_TRY_DONE(pm_dataset_note(nodes, "command", "%s", command));
    PM_TRY_DONE(pm_dataset_save(nodes, output));
    printf("wrote %s: %d trajector%s of %d states, %d columns\n", output, nodes->ntrajectory,
           nodes->ntrajectory == 1 ? "y" : "ies", nodes->ntime, nodes->ncolumn);
done:
    pm_dataset_free(nodes);
    pm_field_free(field);
    pm_arena_free(&arena);
    return status;
}

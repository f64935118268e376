// Reads and writes networks and meshes, which are parts of the `model:` block (model_reader.h), and
// the names, choices and numbers of which all parts of the block consist. Plain data lives in the
// arena. Readers fail with PM_ECONFIG, naming the place in the file, or with PM_ENOMEM.
#ifndef PM_SCENE_NETWORK_READER_H
#define PM_SCENE_NETWORK_READER_H

#include <stdio.h>

#include "model/spec.h"
#include "store/yaml.h"

#define PM_NETWORK_KEYS                                                                 \
    "features", "hidden", "activation", "skip", "nodes", "width", "passes", "patterns", \
        "driven_by", "within"

// Reads the keys of a network. The block may hold other keys, which the caller has checked. `mesh`
// is the mesh of the model, or NULL if there is none.
pm_status pm_network_read(pm_yaml block, const pm_mesh *mesh, pm_arena *arena,
                          pm_network_spec *network);
// Writes the keys of a network, within braces that the caller writes.
void pm_network_write(FILE *file, const pm_network_spec *network);

// Appends names [count] to the features of a network. PM_ENOMEM.
pm_status pm_spec_append_features(pm_network_spec *network, int count, const char *const *name,
                                  pm_arena *arena);

// Reads a mesh; *mesh becomes NULL if the block does not exist.
pm_status pm_mesh_read(pm_yaml block, pm_arena *arena, const pm_mesh **mesh);
// Writes the mesh as a line of the block, or nothing if it is NULL.
void pm_mesh_write(FILE *file, const pm_mesh *mesh);

// --- words ---

// Writes the place "file:line:column" of a value to *at, for errors that are found later.
pm_status pm_model_read_at(pm_yaml value, pm_arena *arena, const char **at);
// Reads an optional choice as its position in `names`, which ends with NULL; 0 if the key is
// absent.
pm_status pm_model_read_choice(pm_yaml block, const char *key, const char *const *names,
                               int *result);
// Reads an optional list of names; *count is 0 if the key is absent.
pm_status pm_model_read_names(pm_yaml block, const char *key, pm_arena *arena, int *count,
                              const char *const **result);

// Writes a text between quotes.
void pm_model_write_quoted(FILE *file, const char *text);
// Writes a text: a name as it is, everything else between quotes.
void pm_model_write_text(FILE *file, const char *text);
// Writes "<key>: [<names>]".
void pm_model_write_names(FILE *file, const char *key, int count, const char *const *names);
// Writes a number with 15 digits if these give the same number, else with 17.
void pm_model_write_number(FILE *file, double number);

#endif

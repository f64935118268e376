// Networks, and the meshes they are on, as text: part of the `model:` block (model_reader.h), with
// the words that all of its blocks are read and written with.
#ifndef PM_SCENE_NETWORK_READER_H
#define PM_SCENE_NETWORK_READER_H

#include <stdio.h>

#include "model/spec.h"
#include "store/yaml.h"

#define PM_NETWORK_KEYS                                                                 \
    "features", "hidden", "activation", "skip", "nodes", "width", "passes", "patterns", \
        "driven_by", "within"

// The keys of a network; its block may hold others, which the caller has checked. `mesh` is NULL
// where there is none. PM_ECONFIG, PM_ENOMEM.
pm_status pm_network_read(pm_yaml block, const pm_mesh *mesh, pm_arena *arena,
                          pm_network_spec *network);
// Within braces that the caller writes.
void pm_network_write(FILE *file, const pm_network_spec *network);

// Appends names to a network's features. PM_ENOMEM.
pm_status pm_spec_append_features(pm_network_spec *network, int count, const char *const *name,
                                  pm_arena *arena);

// *mesh is NULL where the block does not exist, and then nothing is written.
pm_status pm_mesh_read(pm_yaml block, pm_arena *arena, const pm_mesh **mesh);
void pm_mesh_write(FILE *file, const pm_mesh *mesh);

// --- words ---

// The place of a value, for errors found later.
pm_status pm_model_read_at(pm_yaml value, pm_arena *arena, const char **at);
// The position of an optional choice; the first name where it is absent.
pm_status pm_model_read_choice(pm_yaml block, const char *key, const char *const *names,
                               int *result);
// An optional list of names; none where it is absent.
pm_status pm_model_read_names(pm_yaml block, const char *key, pm_arena *arena, int *count,
                              const char *const **result);

void pm_model_write_quoted(FILE *file, const char *text);
// Names stand as they are, everything else between quotes.
void pm_model_write_text(FILE *file, const char *text);
void pm_model_write_names(FILE *file, const char *key, int count, const char *const *names);
// As people write it, where that is the same number.
void pm_model_write_number(FILE *file, double number);

#endif

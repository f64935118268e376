// Reads and writes networks, which are parts of the `model:` block (model_reader.h), and
// the names, choices and numbers of which all parts of the block consist. Readers copy all that
// they return into the arena, so that the result outlives the document. A reader returns
// PM_ECONFIG, with the place in the file in its message, if a value is not allowed, and PM_ENOMEM.
// After a failure its result is undefined, but needs no freeing.
#ifndef PM_SCENE_NETWORK_READER_H
#define PM_SCENE_NETWORK_READER_H

#include <stdio.h>

#include "model/spec.h"
#include "store/yaml.h"

// The keys of a network, for the list of keys that a caller allows in a block.
#define PM_NETWORK_KEYS "features", "hidden", "activation", "skip"

// Reads the keys of a network and sets *network, with defaults for the keys that are absent. The
// block may hold other keys, which the caller has checked. PM_ECONFIG: a key has a value
// that is not allowed. PM_ENOMEM. After a failure *network is undefined.
pm_status pm_network_read(pm_yaml block, pm_arena *arena, pm_network_spec *network);
// Writes the keys of a network and their values, without the braces around them.
void pm_network_write(FILE *file, const pm_network_spec *network);

// Appends name [count] to the features of a network. The texts are borrowed; the new list lies in
// the arena. PM_ENOMEM: the network is as before.
pm_status pm_spec_append_features(pm_network_spec *network, int count, const char *const *name,
                                  pm_arena *arena);

// --- words ---

// Sets *at to the place "file:line:column" of a value, for errors that are found later. The text
// lies in the arena. PM_ENOMEM.
pm_status pm_model_read_at(pm_yaml value, pm_arena *arena, const char **at);
// Sets *result to the position in `names` of the text under `key`; 0 if the key is absent. `names`
// ends with NULL. PM_ECONFIG: the text is none of the names.
pm_status pm_model_read_choice(pm_yaml block, const char *key, const char *const *names,
                               int *result);
// Reads the list of names under `key` into the arena: result [count]. If the key is absent, *count
// is 0 and *result NULL. PM_ECONFIG, PM_ENOMEM.
pm_status pm_model_read_names(pm_yaml block, const char *key, pm_arena *arena, int *count,
                              const char *const **result);

// Writes a text between quotes.
void pm_model_write_quoted(FILE *file, const char *text);
// Writes a text as it is if it consists of letters, digits, '_' and '.', and between quotes
// otherwise.
void pm_model_write_text(FILE *file, const char *text);
// Writes "<key>: [<names>]".
void pm_model_write_names(FILE *file, const char *key, int count, const char *const *names);
// Writes a number with 15 significant digits if they give the same number, else with 17.
void pm_model_write_number(FILE *file, double number);

#endif

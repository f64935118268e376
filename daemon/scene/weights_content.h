// The content that weights files of subsystems and of ports have in common. Only the files that
// implement weights.h include this header: weights_content.c computes the digest, weights_save.c
// writes files and weights_load.c reads them.
#ifndef PM_SCENE_WEIGHTS_CONTENT_H
#define PM_SCENE_WEIGHTS_CONTENT_H

#include "scene/weights.h"

#define PM_WEIGHTS_FORMAT "portmet weights"
// The version of the layout. A new key in the text of a model needs no new version: older programs
// refuse a key that they do not know.
#define PM_WEIGHTS_VERSION 1

typedef struct pm_weights_content {
    const char *kind; // "subsystem" or "port"
    int nlayout;
    pm_layout *layout[2]; // [nlayout], borrowed
    pm_params *params;    // borrowed
    const char *model;    // YAML text; NULL: not known yet
} pm_weights_content;

// Return the content of a part or a port, which is borrowed, without the model's text.
pm_weights_content pm_weights_of_part(pm_part *part);
pm_weights_content pm_weights_of_port(pm_port_model *port);

// Returns the digest over kind, layouts, text of the model, and names, shapes and values of all
// parameters.
uint64_t pm_weights_digest(const pm_weights_content *c);
// Returns the object of a file that holds layout i: "/layout", or of a port "/layout_a",
// "/layout_b".
const char *pm_weights_layout_path(const pm_weights_content *c, int i);
// Checks that all values are finite. PM_EWEIGHTS; `path` names the file in the message.
pm_status pm_weights_check_values(const pm_weights_content *c, const char *path);
// Fails with PM_ENOMEM; `path` names the file in the message.
pm_status pm_weights_no_memory(const char *path);

#endif

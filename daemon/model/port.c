// The table of port laws.
#include "model/port.h"

#include <string.h>

// The table of laws: laws/<name>.c defines pm_law_<name>.
#define LAWS(LAW) LAW(bracket) LAW(exchange) LAW(contact)

#define DECLARATION(name) extern const pm_port_law pm_law_##name;
#define ENTRY(name) &pm_law_##name,
#define LISTED(name) ", " #name

LAWS(DECLARATION)
static const pm_port_law *const laws[] = {LAWS(ENTRY)};

const pm_port_law *pm_port_law_find(const char *name) {
    for (size_t i = 0; i < sizeof laws / sizeof *laws; ++i) {
        if (strcmp(laws[i]->name, name) == 0) {
            return laws[i];
        }
    }
    return NULL;
}

const char *pm_port_law_names(void) {
    return &(LAWS(LISTED))[2]; // without the first comma
}

pm_status pm_port_declare(pm_port_model *port) {
    port->law = pm_port_law_find(port->spec.law);
    if (port->law == NULL) {
        return pm_fail(PM_ECONFIG, "unknown port law \"%s\", expected one of: %s", port->spec.law,
                       pm_port_law_names());
    }
    return port->law->declare(port);
}

void pm_port_free(pm_port_model *port) {
    pm_params_free(&port->params);
}

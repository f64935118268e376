// The functions of an exported scene that evaluate one subsystem or one port, as C source. Each is
// written from the same graph expressions that portmetd evaluates (model/part.h, model/port.h), and
// has a second version, the tangent, that multiplies its Jacobian by a direction. Subsystems with
// the same model and weights share their functions.
#ifndef PM_EXPORT_FUNCTIONS_H
#define PM_EXPORT_FUNCTIONS_H

#include <stdio.h>

#include "base/arena.h"
#include "scene/system.h"

typedef struct pm_export_function pm_export_function;

// The names of the functions of one subsystem. NULL: what the function computes is zero. With z,
// dE, dS and rate [nz]:
//     potentials(z, E, S)             E [1] in J, S [1] in J/K
//     coenergies(z, dE, dS)
//     bulk(z, dE, dS, rate)           L dE + M dS
// The arguments of a tangent are those of its function, except that each input is followed by its
// direction: "d_z" follows "z". The results are then the Jacobian times the direction.
typedef struct pm_export_part {
    const char *potentials, *coenergies, *coenergies_tangent, *bulk, *bulk_tangent;
} pm_export_part;

// The names of the functions of one port: law(y_a, e_a, eta_a, y_b, e_b, eta_b, rate_a, rate_b),
// and its tangent. NULL: the port has no effect.
typedef struct pm_export_port {
    const char *law, *law_tangent;
} pm_export_port;

// The caller owns this storage, sets `system` and `arena`, and initialises the rest with zeros.
typedef struct pm_export_functions {
    const pm_system *system;     // borrowed
    pm_arena *arena;             // borrowed; owns all names
    pm_export_function *written; // the newest one, which links to the older ones
    pm_export_part *part;        // [nsubsystem]
    pm_export_port *port;        // [nport]
} pm_export_functions;

// Writes all functions to the file. Fails as pm_source_write does; the message begins with the name
// of the subsystem or port.
pm_status pm_export_functions_write(pm_export_functions *functions, FILE *file);

#endif

// The physical defaults of a training file. The functions complete the models of the file with what
// physics suggests, so that a first draft trains well. With `defaults: plain` in the training file
// they are not called, and the models stay as written.
#ifndef PM_TRAINER_FIT_DEFAULTS_H
#define PM_TRAINER_FIT_DEFAULTS_H

#include "base/arena.h"
#include "model/part.h"
#include "model/port.h"
#include "scene/system.h"

// Rewrites the model of a subsystem with the state `layout`. In a subsystem with a given entropy s,
// energy networks that have s among their features become thermal (model/thermal.h): they start at
// the temperature that a linear form of s in the energy names, and the linear form is removed. They
// are separate if an entropy among their features has several components. A learned irreversible
// operator heats s (model/dissipation.h). All energies get a unit that fit/normalization.h fixes
// from the data. New arrays of `spec` live in the arena. PM_ENOMEM.
pm_status pm_default_part(pm_part_spec *spec, const pm_layout *layout, pm_arena *arena);

// Rewrites the model of port number `port`. The models of the subsystems at both ends must have
// been rewritten before. A learned irreversible operator heats the entropies that the ends expose.
// New arrays of `spec` live in the arena. PM_ENOMEM.
pm_status pm_default_port(pm_port_spec *spec, const pm_system *system, int port, pm_arena *arena);

#endif
